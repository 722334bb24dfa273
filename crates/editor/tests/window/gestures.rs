//! Wheel, fingers and buttons over the picture and with the camera in hand: each gesture does what it is said to do.

use clerestory::session::{BakeState, Source};
use clerestory::viewport::orbit::Turn;
use clerestory_transport::camera::{Camera, Film};
use eframe::egui::{
    Event, Key, Modifiers, MouseWheelSource, MouseWheelUnit, PointerButton, Pos2, TouchPhase, Vec2, vec2,
};
use egui_kittest::kittest::Queryable;
use glam::Vec3;
use serde_json::{Value, json};

use crate::desk::{Window, baked, drag, on_screen, open, reach, room, wait};

/// The room with its lamp in the middle of the view, baked.
fn with_mark() -> Window {
    let mut gltf: Value = serde_json::from_slice(&room()).unwrap();
    gltf["nodes"][1]["translation"] = json!([0.2, -0.1, -0.6]);
    let bytes = serde_json::to_vec(&gltf).unwrap();
    let mut window = open(Source::Bytes { name: "room.gltf".into(), bytes });
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    window
}

/// Where the lamp is seen: it tells how the picture lies. It is marked while the pointer is in the picture.
fn mark(window: &Window) -> Pos2 {
    window.get_by_label("lamp in the picture").rect().center()
}

fn point_at(window: &mut Window, at: Pos2) {
    window.hover_at(at);
    window.run_steps(3);
}

fn press(window: &mut Window, key: Key) {
    window.key_press(key);
    window.run_steps(3);
}

/// Scrolls by so many points, with keys held.
fn scroll(window: &mut Window, at: Pos2, delta: Vec2, modifiers: Modifiers) {
    window.event(Event::ModifiersChanged(modifiers));
    point_at(window, at);
    let (unit, phase, source) = (MouseWheelUnit::Point, TouchPhase::Move, MouseWheelSource::Unknown);
    window.event(Event::MouseWheel { unit, delta, phase, source, modifiers });
    // It comes smoothly, over several frames.
    window.run_steps(6);
    window.event(Event::ModifiersChanged(Modifiers::NONE));
    window.run_steps(3);
}

/// Two fingers that part by a factor.
fn pinch(window: &mut Window, at: Pos2, factor: f32) {
    point_at(window, at);
    window.event(Event::Zoom(factor));
    window.run_steps(3);
}

/// Drags with a button and with keys held; the pointer stays there.
fn drag_with(window: &mut Window, (button, modifiers): (PointerButton, Modifiers), from: Pos2, travel: Vec2) {
    let button_event = |pos: Pos2, pressed: bool| Event::PointerButton { pos, button, pressed, modifiers };
    window.event(Event::ModifiersChanged(modifiers));
    point_at(window, from);
    window.event(button_event(from, true));
    window.run_steps(2);
    for step in 1..=5 {
        window.hover_at(from + travel * (step as f32 / 5.0));
        window.run_steps(2);
    }
    window.event(button_event(from + travel, false));
    window.event(Event::ModifiersChanged(Modifiers::NONE));
    window.run_steps(3);
}

/// The same place, but for rounding.
#[track_caller]
fn assert_at(found: Pos2, expected: Pos2, why: &str) {
    assert!(found.distance(expected) < 0.5, "{why}: {found:?} instead of {expected:?}");
}

#[test]
fn a_wheel_and_a_pinch_zoom_at_the_pointer_until_the_whole_picture_is_asked_for() {
    let mut window = with_mark();
    let at = window.get_by_label("Picture").rect().center() - vec2(120.0, 60.0);
    point_at(&mut window, at);
    let whole = mark(&window);
    scroll(&mut window, at, vec2(0.0, 100.0), Modifiers::NONE);
    let factor = (mark(&window) - at).length() / (whole - at).length();
    assert!(factor > 1.2, "the wheel comes nearer: {factor}");
    assert_at(mark(&window), at + (whole - at) * factor, "what is under the pointer stays there");
    scroll(&mut window, at, vec2(0.0, -100.0), Modifiers::NONE);
    assert_at(mark(&window), whole, "and goes back");
    scroll(&mut window, at, vec2(0.0, -100.0), Modifiers::NONE);
    assert_at(mark(&window), at + (whole - at) / factor, "as far as it came");

    press(&mut window, Key::F);
    assert_at(mark(&window), whole, "all of it");
    pinch(&mut window, at, 1.5);
    assert_at(mark(&window), at + (whole - at) * 1.5, "fingers that part");
    point_at(&mut window, at);
    for pressed in [true, false, true, false] {
        let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
        // All in one frame, as quick as two clicks are.
        window.input_mut().events.push(Event::PointerButton { pos: at, button, pressed, modifiers });
    }
    window.run_steps(3);
    assert_at(mark(&window), whole, "a double click");
}

#[test]
fn the_picture_is_moved_by_the_middle_button_or_with_space_and_no_light_with_it() {
    let mut window = with_mark();
    let look = window.state().look().clone();
    // On the panel, where a drag without Space places a spot.
    let (from, travel) = (on_screen(&window, Vec3::new(-0.2, 0.4, -0.5)), vec2(60.0, 35.0));
    point_at(&mut window, from);
    let before = mark(&window);
    drag_with(&mut window, (PointerButton::Middle, Modifiers::NONE), from, travel);
    assert_at(mark(&window), before + travel, "the middle button");
    press(&mut window, Key::F);
    assert_at(mark(&window), before, "all of it");

    window.key_down(Key::Space);
    drag(&mut window, from, from - travel);
    window.key_up(Key::Space);
    point_at(&mut window, from);
    assert_at(mark(&window), before - travel, "Space");
    assert_eq!(*window.state().look(), look);
}

#[test]
fn a_region_that_begins_at_the_mark_of_a_lamp_is_zoomed_to_and_the_lamp_stays() {
    let mut window = with_mark();
    let middle = window.get_by_label("Picture").rect().center();
    point_at(&mut window, middle);
    let (before, look) = (mark(&window), window.state().look().clone());
    let from = before - vec2(4.0, 4.0);
    point_at(&mut window, from);
    window.key_down(Key::Z);
    window.run_steps(2);
    drag(&mut window, from, from + vec2(100.0, 70.0));
    window.key_up(Key::Z);
    point_at(&mut window, middle);
    assert_eq!(*window.state().look(), look);
    assert!(mark(&window).distance(before) > 50.0, "{:?} after {before:?}", mark(&window));
}

#[test]
fn on_a_trackpad_two_fingers_move_the_picture_once_it_is_larger_than_its_place() {
    let mut window = with_mark();
    navigate_as(&mut window, "Trackpad");
    let at = window.get_by_label("Picture").rect().center() - vec2(120.0, 60.0);
    point_at(&mut window, at);
    let whole = mark(&window);
    scroll(&mut window, at, vec2(-30.0, 20.0), Modifiers::NONE);
    assert_at(mark(&window), whole, "all of it is seen");
    pinch(&mut window, at, 1.5);
    let before = mark(&window);
    assert_at(before, at + (whole - at) * 1.5, "fingers that part");
    scroll(&mut window, at, vec2(-30.0, 20.0), Modifiers::NONE);
    let way = mark(&window) - before;
    assert!(way.x < -10.0 && way.y > 6.0, "it goes along: {way}");
}

/// A film of the shape of the room's pictures.
const FILM: Film = Film { width: 64, height: 48 };
/// What is in the middle of the view of the room, and how far away.
const WALL: Vec3 = Vec3::new(0.0, 0.0, -1.0);
const WALL_M: f32 = 1.9;

/// Takes the camera in hand where the room was baked from.
fn take_in_hand(window: &mut Window) -> Camera {
    press(window, Key::Escape);
    press(window, Key::C);
    window.get_by_label("View of the camera");
    window.state().camera().unwrap().clone()
}

fn middle(window: &Window) -> Pos2 {
    window.get_by_label("View of the camera").rect().center()
}

fn forward(camera: &Camera) -> Vec3 {
    -camera.world_from_camera.z_axis.truncate()
}

/// How a camera was moved from one view to the other.
fn turn_between(before: &Camera, after: &Camera) -> Option<Turn> {
    let (way, ahead) = (after.position() - before.position(), forward(before));
    let (is_elsewhere, is_turned) = (way.length() > 0.01, forward(after).distance(ahead) > 0.01);
    let is_little = |part: f32| part < 1e-3 * way.length();
    match (is_elsewhere, is_turned) {
        (false, true) => Some(Turn::Look),
        (true, true) => Some(Turn::Orbit),
        (true, false) if is_little(way.dot(ahead).abs()) => Some(Turn::Pan),
        (true, false) if is_little(way.cross(ahead).length()) => Some(Turn::Dolly),
        _ => None,
    }
}

/// Chooses whose gestures move the camera.
fn navigate_as(window: &mut Window, habit: &str) {
    if window.query_by_label(habit).is_none() {
        reach(window, "Navigation");
    }
    reach(window, habit);
}

#[test]
fn every_habit_drags_the_camera_in_its_own_ways() {
    let mut window = baked();
    let drags = [
        ("Blender", PointerButton::Primary, Modifiers::NONE, Turn::Look),
        ("Blender", PointerButton::Primary, Modifiers::SHIFT, Turn::Pan),
        ("Blender", PointerButton::Middle, Modifiers::NONE, Turn::Orbit),
        ("Blender", PointerButton::Middle, Modifiers::SHIFT, Turn::Pan),
        ("Blender", PointerButton::Middle, Modifiers::COMMAND, Turn::Dolly),
        ("Alt + mouse", PointerButton::Primary, Modifiers::NONE, Turn::Look),
        ("Alt + mouse", PointerButton::Primary, Modifiers::ALT, Turn::Orbit),
        ("Alt + mouse", PointerButton::Middle, Modifiers::ALT, Turn::Pan),
        ("Alt + mouse", PointerButton::Secondary, Modifiers::ALT, Turn::Dolly),
    ];
    for (habit, button, modifiers, turn) in drags {
        navigate_as(&mut window, habit);
        let before = take_in_hand(&mut window);
        let from = middle(&window);
        drag_with(&mut window, (button, modifiers), from, vec2(40.0, 30.0));
        let after = window.state().camera().unwrap();
        assert_eq!(turn_between(&before, after), Some(turn), "{habit}: {button:?} with {modifiers:?}");
    }
}

#[test]
fn the_camera_turns_around_what_is_in_the_middle_and_moves_it_along_with_the_pointer() {
    let mut window = baked();
    let before = take_in_hand(&mut window);
    assert!((before.position().distance(WALL) - WALL_M).abs() < 1e-3);
    let (area, travel) = (window.get_by_label("View of the camera").rect(), vec2(60.0, -20.0));
    let center = glam::Vec2::new(0.5 * FILM.width as f32, 0.5 * FILM.height as f32);
    drag_with(&mut window, (PointerButton::Middle, Modifiers::NONE), area.center(), travel);
    let turned = window.state().camera().unwrap();
    assert!((turned.position().distance(WALL) - WALL_M).abs() < 1e-3, "at its distance: {}", turned.position());
    assert!(turned.project(FILM, WALL).unwrap().distance(center) < 0.05, "in the middle of the view");
    assert!(turned.position().x < -0.3, "drawn to the right, it goes to the left: {}", turned.position());

    take_in_hand(&mut window);
    drag_with(&mut window, (PointerButton::Middle, Modifiers::SHIFT), area.center(), travel);
    let moved = window.state().camera().unwrap();
    let scale = ((area.width() - 28.0) / FILM.width as f32).min((area.height() - 28.0) / FILM.height as f32);
    let seen = (moved.project(FILM, WALL).unwrap() - center) * scale;
    assert!(seen.distance(glam::Vec2::new(travel.x, travel.y)) < 0.5, "it goes along: {seen}");
}

#[test]
fn the_wheel_and_a_pinch_bring_the_camera_nearer_and_back() {
    let mut window = baked();
    let before = take_in_hand(&mut window);
    let at = middle(&window);
    let ahead =
        |window: &Window| (window.state().camera().unwrap().position() - before.position()).dot(forward(&before));
    scroll(&mut window, at, vec2(0.0, 60.0), Modifiers::NONE);
    assert_eq!(turn_between(&before, window.state().camera().unwrap()), Some(Turn::Dolly));
    assert!(ahead(&window) > 0.1, "up is nearer: {}", ahead(&window));
    scroll(&mut window, at, vec2(0.0, -120.0), Modifiers::NONE);
    assert!(ahead(&window) < -0.1, "down is farther: {}", ahead(&window));

    take_in_hand(&mut window);
    pinch(&mut window, at, 1.25);
    assert_eq!(turn_between(&before, window.state().camera().unwrap()), Some(Turn::Dolly));
    assert!(ahead(&window) > 0.05, "fingers that part come nearer: {}", ahead(&window));
}

#[test]
fn on_a_trackpad_two_fingers_turn_the_camera_and_with_keys_they_move_it() {
    let mut window = baked();
    navigate_as(&mut window, "Trackpad");
    let scrolls = [
        (vec2(30.0, 20.0), Modifiers::NONE, Turn::Orbit),
        (vec2(40.0, 0.0), Modifiers::SHIFT, Turn::Pan),
        (vec2(0.0, 40.0), Modifiers::SHIFT, Turn::Pan),
        (vec2(0.0, 40.0), Modifiers::COMMAND, Turn::Dolly),
    ];
    for (delta, modifiers, turn) in scrolls {
        let before = take_in_hand(&mut window);
        let at = middle(&window);
        scroll(&mut window, at, delta, modifiers);
        let after = window.state().camera().unwrap();
        assert_eq!(turn_between(&before, after), Some(turn), "{delta:?} with {modifiers:?}");
    }
    // Up and down, too: the toolkit makes a way to the side of what is scrolled with Shift.
    let before = take_in_hand(&mut window);
    window.get_by_label("Camera: two fingers turn it, with Shift they move it, a pinch comes nearer");
    let at = middle(&window);
    scroll(&mut window, at, vec2(0.0, 40.0), Modifiers::SHIFT);
    let way = window.state().camera().unwrap().position() - before.position();
    assert!(way.y.abs() > 0.01 && way.with_y(0.0).length() < 0.1 * way.y.abs(), "{way}");
    let before = take_in_hand(&mut window);
    let at = middle(&window);
    pinch(&mut window, at, 1.25);
    assert_eq!(turn_between(&before, window.state().camera().unwrap()), Some(Turn::Dolly));
}
