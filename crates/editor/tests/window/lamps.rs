//! Free lamps in the window, driven by its labels: added, dragged, aimed, copied, taken away, and made of lamps of the file.

use std::cell::Cell;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clerestory::app::App;
use clerestory::look::Look;
use clerestory::session::{BakeState, Source};
use clerestory_transport::archive;
use clerestory_transport::bake::{BakeConfig, BakeJob, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit};
use clerestory_transport::prepared::PreparedScene;
use eframe::egui::{Event, Key, Modifiers, PointerButton, Pos2, Vec2, vec2};
use egui_kittest::kittest::{NodeT, Queryable};
use glam::Vec3;
use serde_json::{Value, json};

use crate::desk::{
    Dropped, Window, ask_for, ask_for_menu, baked, baked_larger, click, drag, hints, is_framed, on_screen, open,
    open_with, quick, reach, replace_and_reload, room, type_keys, type_over, wait, wait_until,
};

fn lamps(window: &Window) -> Vec<FreeLamp> {
    window.state().look().lights.lamps.clone()
}

/// The room with a lamp from the menu, shown.
fn with_lamp(kind: &str) -> Window {
    let mut window = baked();
    click(&mut window, "Add lamp");
    click(&mut window, kind);
    wait(&mut window, App::is_settled);
    window
}

fn middle(window: &Window, label: &str) -> Pos2 {
    window.get_by_label(label).rect().center()
}

fn pull(window: &mut Window, label: &str, travel: Vec2) {
    let from = middle(window, label);
    drag(window, from, from + travel);
}

fn click_at(window: &mut Window, at: Pos2, modifiers: Modifiers) {
    window.hover_at(at);
    window.run_steps(2);
    for pressed in [true, false] {
        let button = PointerButton::Primary;
        window.event_modifiers(eframe::egui::Event::PointerButton { pos: at, button, pressed, modifiers }, modifiers);
        window.run_steps(1);
    }
    window.run_steps(3);
}

#[test]
fn a_lamp_from_the_menu_lights_the_room_and_is_one_step_of_undo() {
    let mut window = baked();
    let ev = window.state().shown_ev();
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    wait(&mut window, |app| app.is_settled() && app.shown_ev() < ev - 0.5);
    let added = lamps(&window);
    assert_eq!((added.len(), added[0].key.as_str(), &added[0].shape), (1, "Point lamp 1", &LampShape::Point));
    // In the middle of the view is the far wall; the lamp stands before it.
    assert!(added[0].position.x.abs() < 0.05 && added[0].position.z > -1.0, "{}", added[0].position);
    assert!(window.query_all_by_label_contains("Lamps: direct light only").count() == 1, "the bake has no patches");

    click(&mut window, "Undo");
    assert_eq!(*window.state().look(), Look::default());
    wait(&mut window, |app| app.is_settled() && (app.shown_ev() - ev).abs() < 1e-3);
    window.key_press_modifiers(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
    window.run_steps(3);
    assert_eq!(lamps(&window), added);
}

#[test]
fn a_lamp_from_the_menu_of_the_picture_hangs_just_before_what_was_pointed_at() {
    let mut window = baked();
    let wall = Vec3::new(-1.0, -0.2, -0.8);
    let at = on_screen(&window, wall);
    ask_for_menu(&mut window, at);
    click(&mut window, "Add lamp here");
    click(&mut window, "Point");
    let [lamp] = &lamps(&window)[..] else { panic!("{:?}", lamps(&window)) };
    assert_eq!(lamp.shape, LampShape::Point);
    // A hand's breadth away, seen from 2 m.
    let off = lamp.position - wall;
    assert!(off.y.abs() < 0.03 && off.z.abs() < 0.03 && off.x > 0.02 && off.x < 0.12, "{off}");
    click(&mut window, "Undo");
    assert_eq!(*window.state().look(), Look::default(), "it is one step");
}

#[test]
fn a_handle_goes_by_arrow_keys_and_takes_what_is_selected_along() {
    let mut window = with_two_lamps("Point", ["Point lamp 1", "Point lamp 2"]);
    let before = lamps(&window);
    let step = |window: &mut Window, modifiers: Modifiers, key: Key| -> Vec<Vec3> {
        window.get_by_label("Move Point lamp 2 along X").focus();
        window.run_steps(2);
        window.key_press_modifiers(modifiers, key);
        window.run_steps(3);
        lamps(window).iter().zip(&before).map(|(now, was)| now.position - was.position).collect()
    };
    let right = step(&mut window, Modifiers::NONE, Key::ArrowRight);
    assert!(right[0].distance(right[1]) < 1e-5, "{right:?}");
    assert!(right[0].x > 1e-3 && right[0].with_x(0.0).length() < 1e-5, "{right:?}");
    let back = step(&mut window, Modifiers::SHIFT, Key::ArrowLeft);
    assert!(back[0].x < right[0].x && back[0].x > 0.8 * right[0].x, "with Shift finely: {back:?} {right:?}");
    assert!(back[0].distance(back[1]) < 1e-5, "{back:?}");
}

#[test]
fn the_kinds_of_lamps_say_what_they_are() {
    let mut window = baked();
    click(&mut window, "Add lamp");
    assert!(hints(&mut window, "Spot", "A cone of light with a soft rim"));
}

#[test]
fn the_handle_that_has_the_keyboard_is_framed() {
    const BODY: &str = "Move Point lamp 1 over surfaces";
    let mut window = with_lamp("Point");
    assert!(!is_framed(&window, BODY));
    window.get_by_label(BODY).focus();
    window.run_steps(2);
    assert!(is_framed(&window, BODY));
}

#[test]
fn caustics_that_a_lamp_lacks_are_named_beside_the_picture() {
    for is_mirror in [false, true] {
        let mut gltf: Value = serde_json::from_slice(&room()).unwrap();
        if is_mirror {
            let panel = gltf["materials"].as_array_mut().unwrap().last_mut().unwrap();
            panel["pbrMetallicRoughness"] = json!({"metallicFactor": 1, "roughnessFactor": 0});
        }
        let source = Source::Bytes { name: "room.gltf".into(), bytes: serde_json::to_vec(&gltf).unwrap() };
        let mut window = open_with(source, BakeConfig { patches: 64, ..quick() }, None);
        wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
        let n_named = |window: &Window| window.query_all_by_label_contains("Lamps: without caustics").count();
        assert_eq!(n_named(&window), 0, "no lamp was added");
        click(&mut window, "Add lamp");
        click(&mut window, "Point");
        wait(&mut window, App::is_settled);
        assert_eq!(n_named(&window), usize::from(is_mirror));
        if is_mirror {
            click(&mut window, "Lamps: without caustics");
            let missing = "% of its light onto mirrors and clear glass, whose caustics are not carried";
            assert!(says(&window, missing) && !says(&window, "sends 0 %"));
        }
    }
}

#[test]
fn light_of_a_lamp_that_a_pane_mirrors_is_named_beside_the_picture() {
    let mut gltf: Value = serde_json::from_slice(&room()).unwrap();
    let mut push = |list: &str, item: Value| {
        let list = gltf[list].as_array_mut().unwrap();
        list.push(item);
        list.len() - 1
    };
    push("extensionsUsed", json!("KHR_materials_transmission"));
    let glass = json!({"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0},
        "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}});
    let material = push("materials", glass);
    // Its quad is the ceiling's, as that of the panel; here it lies level below the eye.
    let quad = json!({"bufferView": 1, "byteOffset": 36, "componentType": 5123, "count": 6, "type": "SCALAR"});
    let indices = push("accessors", quad);
    let primitive = json!({"attributes": {"POSITION": 0}, "indices": indices, "material": material});
    let mesh = push("meshes", json!({"primitives": [primitive]}));
    let pane = json!({"name": "pane", "mesh": mesh, "scale": [0.95, 1, 0.95], "translation": [0, -1.15, 0]});
    let node = push("nodes", pane);
    gltf["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(node));
    let source = Source::Bytes { name: "room.gltf".into(), bytes: serde_json::to_vec(&gltf).unwrap() };
    let mut window = open_with(source, BakeConfig { patches: 64, ..quick() }, None);
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    let n_named = |window: &Window| window.query_all_by_label_contains("Lamps: without mirrored light").count();
    assert_eq!(n_named(&window), 0, "no lamp was added");
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    wait(&mut window, App::is_settled);
    assert_eq!(n_named(&window), 1);
    click(&mut window, "Undo");
    wait(&mut window, App::is_settled);
    assert_eq!(n_named(&window), 0);
}

#[test]
fn a_lamp_that_stands_still_costs_nothing_in_the_end() {
    let mut window = with_lamp("Sphere");
    let shown = window.state().n_pictures();
    std::thread::sleep(std::time::Duration::from_millis(400));
    window.run_steps(5);
    assert!(window.state().is_settled() && window.state().n_pictures() == shown, "no picture is made any more");
    // Frames that were asked for meanwhile end as well: the window sleeps.
    let asked = |window: &Window| window.output().viewport_output.values().map(|viewport| viewport.repaint_delay).min();
    for _ in 0..2000 {
        if asked(&window) == Some(std::time::Duration::MAX) {
            break;
        }
        window.step();
    }
    assert_eq!(asked(&window), Some(std::time::Duration::MAX), "it asks for another frame all the time");
    assert_eq!(window.state().n_pictures(), shown);
}

#[test]
fn an_arrow_drags_along_its_axis_and_esc_puts_back() {
    let mut window = with_lamp("Point");
    let before = lamps(&window)[0].position;
    pull(&mut window, "Move Point lamp 1 along X", vec2(60.0, 25.0));
    let after = lamps(&window)[0].position;
    assert!(after.x > before.x + 0.02 && (after.y, after.z) == (before.y, before.z), "{before} {after}");
    click(&mut window, "Undo");
    assert_eq!(lamps(&window)[0].position, before, "one drag is one step");

    pull(&mut window, "Move Point lamp 1 across Z", vec2(-40.0, -30.0));
    let across = lamps(&window)[0].position;
    assert!(across.x < before.x && across.y > before.y && across.z == before.z, "{before} {across}");

    let from = middle(&window, "Move Point lamp 1 along Y");
    window.hover_at(from);
    window.run_steps(2);
    window.drag_at(from);
    window.run_steps(2);
    for step in 1..4 {
        window.hover_at(from + vec2(0.0, -20.0 * step as f32));
        window.run_steps(2);
    }
    assert!(lamps(&window)[0].position.y > across.y + 0.02);
    window.key_press(Key::Escape);
    window.run_steps(2);
    assert_eq!(lamps(&window)[0].position, across);
    window.hover_at(from + vec2(0.0, -120.0));
    window.run_steps(2);
    window.drop_at(from + vec2(0.0, -120.0));
    window.run_steps(3);
    assert_eq!(lamps(&window)[0].position, across, "a drag that was put back is over");
}

/// Takes something and pulls it in some steps, without letting go; answers where the pointer is.
fn hold(window: &mut Window, label: &str, step: Vec2) -> Pos2 {
    let from = middle(window, label);
    window.hover_at(from);
    window.run_steps(2);
    window.drag_at(from);
    window.run_steps(2);
    for nth in 1..4 {
        window.hover_at(from + nth as f32 * step);
        window.run_steps(2);
    }
    from + 3.0 * step
}

/// Takes over the first look, and goes on with what was a drag: through Esc, and until the button comes up.
fn go_on_in_the_first_look(window: &mut Window, at: Pos2, step: Vec2) {
    window.key_press_modifiers(Modifiers::COMMAND, Key::Num1);
    window.run_steps(4);
    window.hover_at(at + step);
    window.run_steps(2);
    window.key_press(Key::Escape);
    window.run_steps(2);
    window.drop_at(at + step);
    window.run_steps(3);
}

#[test]
fn a_lamp_that_is_dragged_stays_in_its_look_where_another_one_comes() {
    let mut window = with_lamp("Point");
    click(&mut window, "Keep look");
    let kept = lamps(&window);
    pull(&mut window, "Move Point lamp 1 along X", vec2(60.0, 25.0));
    let before = lamps(&window);
    let step = vec2(0.0, -20.0);
    let at = hold(&mut window, "Move Point lamp 1 along Y", step);
    let dragged = lamps(&window);
    assert!(dragged != before && before != kept);
    go_on_in_the_first_look(&mut window, at, step);
    assert_eq!(lamps(&window), kept);
    click(&mut window, "Undo");
    assert_eq!(lamps(&window), dragged, "the drag was a step of its own");
}

#[test]
fn what_is_dragged_in_the_list_is_not_carried_into_another_look() {
    for label in ["Point lamp 1 strength", "Point lamp 1 intensity"] {
        let mut window = with_lamp("Point");
        click(&mut window, "Keep look");
        let kept = lamps(&window);
        window.get_by_label(label).scroll_to_me();
        window.run_steps(8);
        let step = vec2(10.0, 0.0);
        let at = hold(&mut window, label, step);
        assert!(lamps(&window) != kept, "{label}");
        go_on_in_the_first_look(&mut window, at, step);
        assert_eq!(lamps(&window), kept, "{label}");
    }
}

#[test]
fn a_lamp_that_is_dragged_stays_where_it_is_once_the_camera_is_in_hand() {
    let mut window = with_lamp("Point");
    let from = middle(&window, "Move Point lamp 1 along Y");
    window.hover_at(from);
    window.run_steps(2);
    window.drag_at(from);
    window.run_steps(2);
    window.hover_at(from + vec2(0.0, -20.0));
    window.run_steps(2);
    let dragged = lamps(&window)[0].position;
    window.key_press(Key::C);
    window.run_steps(3);
    window.hover_at(from + vec2(0.0, -120.0));
    window.run_steps(2);
    window.drop_at(from + vec2(0.0, -120.0));
    window.run_steps(3);
    window.key_press(Key::C);
    window.run_steps(3);
    assert!(window.query_by_label("Picture").is_some(), "the camera is put down");
    assert_eq!(lamps(&window)[0].position, dragged);
}

#[test]
fn a_lamp_is_dragged_over_surfaces_and_chosen_by_a_click() {
    let mut window = with_lamp("Point");
    let wall = Vec3::new(-1.0, -0.2, -0.8);
    let (from, to) = (middle(&window, "Move Point lamp 1 over surfaces"), on_screen(&window, wall));
    drag(&mut window, from, to);
    let off = lamps(&window)[0].position - wall;
    assert!(off.y.abs() < 0.03 && off.z.abs() < 0.03 && off.x > 0.0 && off.x < 0.31, "{off}");

    // A click on nothing lets go, a click on the lamp takes hold again.
    let away = on_screen(&window, Vec3::new(-0.7, -0.6, -1.0));
    click_at(&mut window, away, Modifiers::NONE);
    assert!(window.query_by_label("Move Point lamp 1 along X").is_none());
    let lamp = middle(&window, "Point lamp 1 in the picture");
    click_at(&mut window, lamp, Modifiers::NONE);
    window.get_by_label("Move Point lamp 1 along X");
}

#[test]
fn a_click_in_the_list_brings_the_handles_of_a_lamp() {
    let mut window = with_lamp("Point");
    let away = on_screen(&window, Vec3::new(-0.7, -0.6, -1.0));
    click_at(&mut window, away, Modifiers::NONE);
    assert!(window.query_by_label("Move Point lamp 1 along X").is_none());
    let name = window.get_by_label("Mute Point lamp 1").rect().right_center() + vec2(20.0, 0.0);
    click_at(&mut window, name, Modifiers::NONE);
    window.get_by_label("Move Point lamp 1 along X");
}

#[test]
fn the_ring_at_what_a_lamp_lights_is_dragged_over_surfaces() {
    let mut window = with_lamp("Spot");
    // Where the picture shows it; what it lights, in the middle of the far wall, stays.
    reach(&mut window, "Keep the aim");
    for (axis, meters) in [("X", 0.0), ("Y", 0.2), ("Z", -0.5)] {
        window.get_by_label(&format!("Spot lamp 1 position {axis}")).set_value_accesskit(meters);
        window.run_steps(3);
    }
    let (before, side) = (lamps(&window), Vec3::new(-1.0, -0.2, -0.8));
    assert!(before[0].aim.distance(Vec3::NEG_Z) < 0.03, "{}", before[0].aim);
    let (from, to) = (middle(&window, "Aim Spot lamp 1"), on_screen(&window, side));
    drag(&mut window, from, to);
    let after = lamps(&window);
    assert!(after[0].aim.distance(side) < 0.03, "{}", after[0].aim);
    assert_eq!(after[0].position, before[0].position, "it hangs where it hung");
}

#[test]
fn a_lamp_is_aimed_at_what_is_clicked() {
    let mut window = with_lamp("Spot");
    let (wall, side) = (Vec3::new(0.5, -0.3, -1.0), Vec3::new(-1.0, -0.2, -0.8));
    click(&mut window, "Aim at…");
    let at = on_screen(&window, wall);
    click_at(&mut window, at, Modifiers::NONE);
    assert!(lamps(&window)[0].aim.distance(wall) < 0.03, "{}", lamps(&window)[0].aim);
    window.key_press(Key::A);
    window.run_steps(3);
    let at = on_screen(&window, side);
    click_at(&mut window, at, Modifiers::NONE);
    assert!(lamps(&window)[0].aim.distance(side) < 0.03, "{}", lamps(&window)[0].aim);
    let at = on_screen(&window, wall);
    click_at(&mut window, at, Modifiers::COMMAND);
    assert!(lamps(&window)[0].aim.distance(side) < 0.03, "a click with Ctrl adds to what is selected");
    click_at(&mut window, at, Modifiers::NONE);
    assert!(lamps(&window)[0].aim.distance(side) < 0.03, "aiming is over");
}

#[test]
fn what_another_lamp_hangs_before_is_aimed_at_too() {
    let mut window = with_lamp("Point");
    let from = middle(&window, "Move Point lamp 1 over surfaces");
    let side = on_screen(&window, Vec3::new(-1.0, -0.2, -0.8));
    drag(&mut window, from, side);
    click(&mut window, "Add lamp");
    click(&mut window, "Spot");
    wait(&mut window, App::is_settled);
    let before = lamps(&window);
    let at = middle(&window, "Point lamp 1 in the picture");
    window.key_press(Key::A);
    window.run_steps(3);
    click_at(&mut window, at, Modifiers::NONE);
    let after = lamps(&window);
    assert_eq!(after[0], before[0], "it is only in the way");
    assert!(after[1].aim.distance(before[1].aim) > 0.2, "{} and {}", after[1].aim, before[1].aim);
    window.get_by_label("Spot lamp 1 strength");
}

#[test]
fn keys_are_for_the_lamp_of_the_file_that_was_clicked_last() {
    let mut window = with_lamp("Point");
    window.get_by_label("Move Point lamp 1 along X");
    let lamp = on_screen(&window, Vec3::new(0.3, 0.6, -0.2));
    click_at(&mut window, lamp, Modifiers::NONE);
    assert_eq!(window.state().chosen_light(), Some("lamp"));
    assert!(window.query_by_label("Move Point lamp 1 along X").is_none(), "its handles are gone");
    window.key_press(Key::Delete);
    window.run_steps(3);
    assert_eq!(lamps(&window).len(), 1, "nothing that is chosen can be deleted");
    let why = "lamp is a light of the file, which cannot be deleted; mute it instead";
    assert!(window.query_all_by_label(why).next().is_some());
}

#[test]
fn keys_do_nothing_behind_an_open_menu() {
    let mut window = with_lamp("Point");
    let before = window.state().look().clone();
    let in_picture = middle(&window, "Move Point lamp 1 over surfaces");
    let in_list = window.get_by_label("Mute Point lamp 1").rect().right_center() + vec2(20.0, 0.0);
    for at in [in_picture, in_list] {
        ask_for_menu(&mut window, at);
        for key in [Key::Delete, Key::Backspace, Key::H, Key::CloseBracket] {
            window.key_press(key);
            window.run_steps(3);
            assert_eq!(*window.state().look(), before, "{key:?}");
        }
        window.key_press_modifiers(Modifiers::COMMAND, Key::D);
        window.run_steps(3);
        assert_eq!(*window.state().look(), before, "nothing is copied");
        // It is open still, and the panels are seen.
        window.get_by_label("Give it a profile…");
        window.get_by_label("Mute lamp");
        window.key_press(Key::Escape);
        window.run_steps(3);
        assert!(window.query_by_label("Give it a profile…").is_none());
    }
    window.key_press(Key::Delete);
    window.run_steps(3);
    assert!(lamps(&window).is_empty(), "without a menu the key is for the lamp");
}

#[test]
fn a_lamp_of_the_file_is_copied_by_key_and_menu_and_stays_as_it_is() {
    let mut window = baked();
    let at = on_screen(&window, Vec3::new(0.3, 0.6, -0.2));
    click_at(&mut window, at, Modifiers::NONE);
    window.key_press_modifiers(Modifiers::COMMAND, Key::D);
    window.run_steps(3);
    ask_for_menu(&mut window, at);
    click(&mut window, "Duplicate");
    let copies = lamps(&window);
    let keys: Vec<&str> = copies.iter().map(|lamp| lamp.key.as_str()).collect();
    assert_eq!(keys, ["lamp 1", "lamp 2"]);
    let look = window.state().look();
    assert!(!look.lights.is_replaced("lamp") && !look.lights.setting("lamp").muted, "it shines as before");
    for copy in &copies {
        assert_eq!((copy.strength, copy.unit, copy.replaces.as_deref()), (3.0, LampUnit::Candela, None));
        assert!(copy.position.distance(Vec3::new(0.3, 0.6, -0.2)) > 0.01, "{}", copy.position);
    }
    assert!(copies[0].position.distance(copies[1].position) > 0.01, "both are seen");
    for n_left in [1, 0] {
        click(&mut window, "Undo");
        assert_eq!(lamps(&window).len(), n_left);
    }
}

#[test]
fn who_duplicates_what_is_no_lamp_hears_why_there_is_no_copy() {
    let mut window = baked();
    let name = window.get_by_label("Mute panel").rect().right_center() + vec2(20.0, 0.0);
    click_at(&mut window, name, Modifiers::NONE);
    window.key_press_modifiers(Modifiers::COMMAND, Key::D);
    window.run_steps(3);
    assert!(lamps(&window).is_empty());
    assert!(says(&window, "panel is no lamp; only lamps can be duplicated"));
}

#[test]
fn a_light_in_whose_place_a_lamp_shines_is_made_movable_once_and_its_copies_shine() {
    let mut window = baked();
    make_movable(&mut window, "lamp");
    // What belongs to the chosen lamp stands in the list, and moves rows.
    let name = |window: &Window| window.get_by_label("Mute lamp").rect().right_center() + vec2(20.0, 0.0);
    let at = name(&window);
    click_at(&mut window, at, Modifiers::NONE);
    let at = name(&window);
    ask_for_menu(&mut window, at);
    assert!(window.get_by_label("Make movable").accesskit_node().is_disabled());
    click(&mut window, "Duplicate");
    let [moved, copy] = &lamps(&window)[..] else { panic!("{:?}", lamps(&window)) };
    assert_eq!((moved.replaces.as_deref(), copy.replaces.as_deref()), (Some("lamp"), None));
    assert!(!copy.setting.muted, "the light is off only because it was moved");
}

#[test]
fn a_light_that_is_reset_does_not_shine_beside_the_lamp_in_its_place() {
    let mut window = baked();
    make_movable(&mut window, "lamp");
    assert!(window.state().look().lights.is_replaced("lamp") && lamps(&window).len() == 1);
    let row = window.get_by_label("Mute lamp").rect();
    ask_for_menu(&mut window, Pos2::new(row.right() + 20.0, row.center().y));
    click(&mut window, "Reset");
    assert_eq!(*window.state().look(), Look::default(), "as in the file");
    click(&mut window, "Undo");
    assert!(window.state().look().lights.is_replaced("lamp"), "one step");
}

#[test]
fn who_deletes_a_lamp_hears_that_the_light_in_whose_place_it_shone_stays_off() {
    let mut window = baked();
    make_movable(&mut window, "lamp");
    window.key_press(Key::Delete);
    window.run_steps(3);
    assert!(lamps(&window).is_empty() && window.state().look().lights.setting("lamp").muted);
    let words = "Deleted lamp movable 1; lamp, in whose place it shone, stays off";
    assert!(window.query_all_by_label(words).next().is_some());
}

#[test]
fn a_measured_lamp_of_the_file_promises_no_drag() {
    let mut gltf: Value = serde_json::from_slice(&room()).unwrap();
    let profile = "data:application/x-ies-lm-63,IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 10\n0 90 180\n0\n9 9 9\n";
    gltf["extensions"]["EXT_lights_ies"] = json!({ "lights": [{ "uri": profile }] });
    gltf["nodes"][1]["extensions"]["EXT_lights_ies"] = json!({ "light": 0 });
    gltf["extensionsUsed"].as_array_mut().unwrap().push("EXT_lights_ies".into());
    let mut window = open(Source::Bytes { name: "room.gltf".into(), bytes: serde_json::to_vec(&gltf).unwrap() });
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    let lamp = on_screen(&window, Vec3::new(0.3, 0.6, -0.2));
    window.hover_at(lamp);
    window.run_steps(3);
    window.get_by_label("lamp, click to choose it, it is measured and stays where it is");
    drag(&mut window, lamp, lamp + vec2(60.0, 30.0));
    assert_eq!(*window.state().look(), Look::default());
    assert!(window.query_by_label_contains("cannot be made movable").is_none(), "nothing was promised");
    let row = window.get_by_label("Mute lamp").rect();
    for at in [lamp, Pos2::new(row.right() + 20.0, row.center().y)] {
        ask_for_menu(&mut window, at);
        assert!(window.get_by_label("Make movable").accesskit_node().is_disabled());
        window.key_press(Key::Escape);
        window.run_steps(3);
    }
}

#[test]
fn lamps_are_copied_renamed_muted_and_deleted() {
    let mut window = with_lamp("Disk");
    window.key_press_modifiers(Modifiers::COMMAND, Key::D);
    window.run_steps(3);
    let names: Vec<String> = lamps(&window).into_iter().map(|lamp| lamp.key).collect();
    assert_eq!(names, ["Disk lamp 1", "Disk lamp 2"]);
    assert!(lamps(&window)[0].position.distance(lamps(&window)[1].position) > 0.01);

    window.get_by_label("Name of Disk lamp 2").focus();
    window.run_steps(2);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.get_by_label("Name of Disk lamp 2").type_text("lamp");
    window.run_steps(2);
    window.key_press(Key::Enter);
    window.run_steps(3);
    assert!(window.state().look().names.is_empty(), "a light of the scene has that name");
    window.get_by_label("Name of Disk lamp 2").focus();
    window.run_steps(2);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.get_by_label("Name of Disk lamp 2").type_text("Desk");
    window.run_steps(2);
    window.key_press(Key::Enter);
    window.run_steps(3);
    assert_eq!(lamps(&window)[1].key, "Disk lamp 2", "keys stay");
    assert_eq!(window.state().look().names["Disk lamp 2"], "Desk");

    click(&mut window, "Mute Desk");
    assert!(lamps(&window)[1].setting.muted);
    window.key_press(Key::Delete);
    window.run_steps(3);
    assert_eq!(lamps(&window).len(), 1);
    click(&mut window, "Undo");
    assert_eq!(lamps(&window).len(), 2);
}

#[test]
fn another_unit_leaves_the_light_as_it_is() {
    let mut window = with_lamp("Point");
    let lumen = lamps(&window)[0].strength;
    assert_eq!(lamps(&window)[0].unit, LampUnit::Lumen);
    click(&mut window, "Point lamp 1 unit");
    click(&mut window, "cd");
    let lamp = &lamps(&window)[0];
    let candela = lumen / (4.0 * std::f32::consts::PI);
    assert!((lamp.strength - candela).abs() < 1e-3 && lamp.unit == LampUnit::Candela, "{lamp:?}");
}

#[test]
fn a_unit_that_the_strength_has_no_room_in_is_not_offered() {
    let mut window = with_lamp("Rectangle");
    for (label, value) in [("width", 0.001), ("height", 0.001), ("strength", 4000.0)] {
        window.get_by_label(&format!("Rectangle lamp 1 {label}")).set_value_accesskit(value);
        window.run_steps(3);
    }
    let before = lamps(&window);
    assert_eq!((before[0].strength, before[0].unit), (4000.0, LampUnit::Lumen));
    click(&mut window, "Rectangle lamp 1 unit");
    click(&mut window, "nit");
    window.run_steps(3);
    assert_eq!(lamps(&window), before, "1.3·10⁹ nit");
}

#[test]
fn solo_darkens_what_is_not_soloed_among_lamps_and_lights_alike() {
    let mut window = with_lamp("Point");
    let ev = window.state().shown_ev();
    click(&mut window, "Solo lamp");
    wait(&mut window, |app| app.is_settled() && app.shown_ev() > ev + 0.2);
    let of_file = window.state().shown_ev();
    assert!(window.query_by_label("Lamps: lighting").is_none(), "nobody waits for a lamp that is not heard");
    click(&mut window, "Solo lamp");
    click(&mut window, "Solo Point lamp 1");
    wait(&mut window, |app| app.is_settled() && app.shown_ev() > ev + 0.05 && (app.shown_ev() - of_file).abs() > 0.05);
    assert!(!lamps(&window)[0].setting.muted, "solo is not in the look");
}

#[test]
fn a_lamp_of_the_file_is_made_movable_and_shines_as_before() {
    let mut window = baked_larger();
    let before = window.state().shown_ev();
    click(&mut window, "Mute lamp");
    wait(&mut window, |app| app.is_settled() && app.shown_ev() > before + 0.5);
    let dark = window.state().shown_ev();
    click(&mut window, "Mute lamp");
    wait(&mut window, |app| app.is_settled() && (app.shown_ev() - before).abs() < 1e-3);
    make_movable(&mut window, "lamp");
    let look = window.state().look().clone();
    assert!(look.lights.lights["lamp"].muted);
    let lamp = &look.lights.lamps[0];
    assert_eq!((lamp.key.as_str(), lamp.strength, lamp.unit), ("lamp movable 1", 3.0, LampUnit::Candela));
    assert!(lamp.position.distance(Vec3::new(0.3, 0.6, -0.2)) < 1e-5);
    let brightest = Cell::new(f32::MIN);
    wait(&mut window, |app| {
        brightest.set(brightest.get().max(app.shown_ev()));
        app.is_settled() && app.shown_ev() != before
    });
    // Without patches its indirect light is missing. It never goes out in between, or the exposure would rise further.
    let after = window.state().shown_ev();
    assert!(after > before - 0.1 && after < dark - 0.5, "{before} {after} {dark}");
    assert!(brightest.get() < 0.5 * (after + dark), "{before} {} {after} {dark}", brightest.get());
    click(&mut window, "Undo");
    assert_eq!(*window.state().look(), Look::default(), "both at once");
}

#[test]
fn a_lamp_of_the_file_is_dragged_as_it_hangs_and_comes_back_by_one_undo() {
    let mut window = baked();
    let (at, wall) = (Vec3::new(0.3, 0.6, -0.2), Vec3::new(-1.0, -0.2, -0.8));
    let (from, to) = (on_screen(&window, at), on_screen(&window, wall));
    window.hover_at(from);
    window.run_steps(3);
    window.get_by_label("lamp in the picture");
    drag(&mut window, from, to);
    let look = window.state().look().clone();
    assert!(look.lights.lights["lamp"].muted, "its own light is off");
    let [lamp] = &look.lights.lamps[..] else { panic!("{:?}", look.lights.lamps) };
    assert_eq!((lamp.key.as_str(), lamp.strength, lamp.unit), ("lamp movable 1", 3.0, LampUnit::Candela));
    let off = lamp.position - wall;
    assert!(off.y.abs() < 0.04 && off.z.abs() < 0.04 && off.x > 0.0 && off.x < 0.31, "{off}");
    // It is chosen, and goes on as any free lamp.
    window.get_by_label("Move lamp movable 1 along X");
    click(&mut window, "Undo");
    assert_eq!(*window.state().look(), Look::default(), "the exchange and the way at once");
}

#[test]
fn esc_puts_a_lamp_back_into_the_file_that_was_pulled_out_of_it() {
    let mut window = with_lamp("Point");
    let before = window.state().look().clone();
    let from = on_screen(&window, Vec3::new(0.3, 0.6, -0.2));
    window.hover_at(from);
    window.run_steps(3);
    window.drag_at(from);
    window.run_steps(2);
    for step in 1..4 {
        window.hover_at(from + vec2(-20.0 * step as f32, 15.0));
        window.run_steps(2);
    }
    assert_eq!(lamps(&window).len(), 2);
    assert!(window.query_all_by_label_contains("stands in for").next().is_some());
    window.key_press(Key::Escape);
    window.run_steps(3);
    assert_eq!(*window.state().look(), before);
    assert!(window.query_all_by_label_contains("stands in for").next().is_none(), "it does not any more");
    window.get_by_label("Move Point lamp 1 along X");
    let to = from + vec2(-120.0, 15.0);
    window.hover_at(to);
    window.run_steps(2);
    window.drop_at(to);
    window.run_steps(3);
    assert_eq!(*window.state().look(), before, "a pull that was put back is over");
    click(&mut window, "Undo");
    assert!(lamps(&window).is_empty(), "it left no step");
}

#[test]
fn a_lamp_that_is_added_is_not_called_as_one_of_a_look_that_was_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("globes.look");
    let globe = json!({"key": "Point lamp 1", "type": "point", "position": [0, 0.2, 0], "strength": 40});
    let kept = json!({"name": "Globes", "lamps": [globe]});
    let look = json!({"clerestory": 1, "names": {"Point lamp 1": "Globe"}, "looks": [kept]});
    std::fs::write(&path, look.to_string()).unwrap();
    let mut window = baked();
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(path)));
    wait(&mut window, |app| app.look().snapshots.len() == 1);
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    assert_eq!(lamps(&window)[0].key, "Point lamp 2");
}

#[test]
fn a_lamp_that_is_added_is_not_held_by_what_was_wished_of_one_that_was_deleted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("globes.look");
    let globe = json!({"key": "Point lamp 1", "type": "point", "position": [0, 0.2, 0], "strength": 40});
    let look = json!({"clerestory": 1, "lamps": [globe], "wishes": {"held": ["Point lamp 1", "lamp"]}});
    std::fs::write(&path, look.to_string()).unwrap();
    let mut window = baked();
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(path)));
    wait(&mut window, |app| app.look().wishes.held.len() == 2 && app.is_settled());
    let at = window.get_by_label("Mute Point lamp 1").rect().right_center() + vec2(20.0, 0.0);
    click_at(&mut window, at, Modifiers::NONE);
    let before = window.state().look().clone();
    window.key_press(Key::Delete);
    window.run_steps(3);
    let held = |window: &Window| Vec::from_iter(window.state().look().wishes.held.clone());
    assert_eq!((lamps(&window).len(), held(&window)), (0, vec!["lamp".to_owned()]));
    click(&mut window, "Undo");
    assert_eq!(*window.state().look(), before, "it is held again");
    window.key_press_modifiers(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
    window.run_steps(3);
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    assert_eq!((lamps(&window)[0].key.as_str(), held(&window)), ("Point lamp 1", vec!["lamp".to_owned()]));
}

/// Drags the lamp of the file to the wall on the left.
fn drag_to_the_wall(window: &mut Window) {
    let (at, wall) = (Vec3::new(0.3, 0.6, -0.2), Vec3::new(-1.0, -0.2, -0.8));
    let (from, to) = (on_screen(window, at), on_screen(window, wall));
    drag(window, from, to);
    assert_eq!(lamps(window)[0].key, "lamp movable 1");
}

#[test]
fn a_soloed_lamp_of_the_file_that_is_dragged_stays_soloed_and_moves_its_light() {
    let mut window = baked_larger();
    click(&mut window, "Solo lamp");
    wait(&mut window, App::is_settled);
    let alone = window.state().shown_ev();
    drag_to_the_wall(&mut window);
    window.get_by_label("Solo: lamp movable 1");
    wait(&mut window, |app| app.is_settled() && (app.shown_ev() - alone).abs() > 0.1);
    click(&mut window, "Undo");
    window.get_by_label("Solo: lamp");
    wait(&mut window, |app| app.is_settled() && (app.shown_ev() - alone).abs() < 1e-3);
    click(&mut window, "Redo");
    window.get_by_label("Solo: lamp movable 1");
    wait(&mut window, |app| app.is_settled() && (app.shown_ev() - alone).abs() > 0.1);
}

#[test]
fn a_lamp_that_is_added_during_a_solo_joins_it() {
    let mut window = baked();
    click(&mut window, "Solo panel");
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    assert!(says(&window, "Added Point lamp 1; it joins the solo"));
    window.get_by_label("Solo: Point lamp 1, panel");
    click(&mut window, "Undo");
    window.get_by_label("Solo: panel");
    // One of the file that is made movable was not heard, and stays so.
    make_movable(&mut window, "lamp");
    window.get_by_label("Solo: panel");
    click(&mut window, "Clear solo");
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    assert!(window.query_by_label("Clear solo").is_none(), "without a solo there is none to join");
}

#[test]
fn solo_ends_with_the_lamp_whose_adding_is_taken_back() {
    let mut window = baked();
    let ev = window.state().shown_ev();
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    click(&mut window, "Solo Point lamp 1");
    window.get_by_label("Solo: Point lamp 1");
    click(&mut window, "Undo");
    assert!(lamps(&window).is_empty() && window.query_by_label("Clear solo").is_none());
    wait(&mut window, |app| app.is_settled() && (app.shown_ev() - ev).abs() < 1e-3);
}

#[test]
fn solo_of_an_added_lamp_outlasts_a_reload() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.gltf");
    std::fs::write(&path, room()).unwrap();
    let mut window = open(Source::File(path.clone()));
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    click(&mut window, "Solo Point lamp 1");
    let mut gltf: Value = serde_json::from_slice(&room()).unwrap();
    gltf["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"] = json!(4);
    replace_and_reload(&mut window, &path, &gltf);
    wait_until(&mut window, |window| says(window, "Opened room.gltf"));
    assert_eq!(lamps(&window).len(), 1);
    window.get_by_label("Solo: Point lamp 1");
}

#[test]
fn a_preset_leaves_a_lamp_dark_that_was_moved() {
    let mut window = baked();
    drag_to_the_wall(&mut window);
    let at = on_screen(&window, Vec3::new(0.3, 0.6, -0.2));
    window.hover_at(at);
    window.run_steps(3);
    assert!(window.query_by_label("lamp in the picture").is_none(), "it hangs there no longer");
    click(&mut window, "Presets");
    click(&mut window, "Night");
    let lights = &window.state().look().lights;
    assert!(lights.lights["lamp"].muted && !lights.lamps[0].setting.muted, "{lights:?}");
    assert!(lights.lamps[0].setting.kelvin.is_some(), "the other one is set for the night");
}

/// A measured lamp that shines down, in a file.
fn profile(folder: &Path) -> PathBuf {
    let ies = folder.join("down.IES");
    std::fs::write(&ies, "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 10\n0 45 90\n0\n100 50 0\n")
        .unwrap();
    ies
}

#[test]
fn a_spot_lamp_is_set_in_numbers_and_keeps_its_aim_or_its_direction() {
    let mut window = with_lamp("Spot");
    let set = |window: &mut Window, label: &str, value: f64| {
        window.get_by_label(&format!("Spot lamp 1 {label}")).set_value_accesskit(value);
        window.run_steps(3);
        lamps(window)[0].clone()
    };
    let ev = window.state().shown_ev();
    for (label, degrees, expected) in [
        ("inner angle", 10.0, [10.0, 0.6f32.to_degrees()]),
        ("outer angle", 70.0, [10.0, 70.0]),
        ("inner angle", 80.0, [70.0, 70.0]),
        ("outer angle", 5.0, [5.0, 5.0]),
    ] {
        let LampShape::Spot { inner_rad, outer_rad } = set(&mut window, label, degrees).shape else { panic!("a spot") };
        let off = [inner_rad, outer_rad].map(f32::to_degrees);
        assert!((0..2).all(|i| (off[i] - expected[i]).abs() < 1e-3), "{label} {degrees}: {off:?}");
    }
    wait(&mut window, |app| app.is_settled() && (app.shown_ev() - ev).abs() > 0.02);

    let before = lamps(&window)[0].clone();
    let moved = set(&mut window, "position X", f64::from(before.position.x) + 0.25);
    let way = moved.position - before.position;
    assert!(way.x > 0.2 && (moved.aim - before.aim).distance(way) < 1e-5, "it lights the same way");
    reach(&mut window, "Keep the aim");
    let back = set(&mut window, "position X", f64::from(before.position.x));
    assert!(back.position.distance(before.position) < 1e-5 && back.aim == moved.aim, "it lights the same place");
}

#[test]
fn parallel_light_gets_the_angle_under_which_it_is_seen() {
    let mut window = with_lamp("Directional");
    assert_eq!(lamps(&window)[0].shape, LampShape::Directional { radius_rad: 0.0 });
    window.get_by_label("Directional lamp 1 angle").set_value_accesskit(0.5);
    window.run_steps(3);
    let LampShape::Directional { radius_rad } = lamps(&window)[0].shape else {
        panic!("it shines along one direction")
    };
    assert!((radius_rad.to_degrees() - 0.25).abs() < 1e-5, "{radius_rad}");
    wait(&mut window, App::is_settled);
}

#[test]
fn a_rectangle_is_turned_about_its_aim_and_keeps_its_frame_while_the_aim_is_typed() {
    let mut window = with_lamp("Rectangle");
    let set = |window: &mut Window, label: &str, value: f64| {
        window.get_by_label(&format!("Rectangle lamp 1 {label}")).set_value_accesskit(value);
        window.run_steps(3);
        lamps(window)[0].clone()
    };
    let before = lamps(&window)[0].clone();
    let turned = set(&mut window, "turn", 30.0);
    assert!((turned.turn_rad.to_degrees() - 30.0).abs() < 1e-3, "{}", turned.turn_rad);
    click(&mut window, "Undo");
    assert_eq!(lamps(&window)[0], before);

    // Straight below, and from there to the side: the long side stays where it is.
    for (axis, along) in
        [("aim X", before.position.x), ("aim Z", before.position.z), ("aim Y", before.position.y - 1.0)]
    {
        set(&mut window, axis, f64::from(along));
    }
    let below = lamps(&window)[0].clone();
    let aside = set(&mut window, "aim X", f64::from(before.position.x) + 0.01);
    assert!(aside.frame()[0].distance(below.frame()[0]) < 0.02, "{:?} {:?}", below.frame(), aside.frame());
}

#[test]
fn a_profile_from_the_menu_becomes_a_lamp() {
    let folder = tempfile::tempdir().unwrap();
    let ies = profile(folder.path());
    let mut window = baked_larger();
    let ev = window.state().shown_ev();
    click(&mut window, "Add lamp");
    ask_for(&mut window, "IES or LDT…", &ies);
    click(&mut window, "Open");
    let [lamp] = &lamps(&window)[..] else { panic!("{:?}", lamps(&window)) };
    assert_eq!(lamp.shape, LampShape::Profile { file: ies.display().to_string() });
    wait(&mut window, |app| app.is_settled() && app.shown_ev() < ev - 0.05);
    window.get_by_label("down.IES");
}

#[test]
fn a_lamp_that_hangs_gets_a_profile_by_its_menu() {
    let folder = tempfile::tempdir().unwrap();
    let ies = profile(folder.path());
    let mut window = with_lamp("Point");
    let before = lamps(&window);
    let at = middle(&window, "Move Point lamp 1 over surfaces");
    ask_for_menu(&mut window, at);
    ask_for(&mut window, "Give it a profile…", &ies);
    click(&mut window, "Open");
    let [lamp] = &lamps(&window)[..] else { panic!("{:?}", lamps(&window)) };
    assert_eq!(lamp.shape, LampShape::Profile { file: ies.display().to_string() });
    assert_eq!((lamp.strength, lamp.unit), (100.0, LampUnit::Candela));
    assert_eq!((&lamp.key, lamp.position), (&before[0].key, before[0].position));
    click(&mut window, "Undo");
    assert_eq!(lamps(&window), before, "one step");

    // The next one that is dropped is a lamp of its own.
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(ies)));
    window.run_steps(3);
    assert_eq!(lamps(&window).len(), 2);
}

#[test]
fn a_profile_that_is_dropped_on_the_window_becomes_a_lamp() {
    let folder = tempfile::tempdir().unwrap();
    let ies = profile(folder.path());
    let mut window = with_lamp("Point");
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(ies.clone())));
    window.run_steps(3);
    let [_, lamp] = &lamps(&window)[..] else { panic!("{:?}", lamps(&window)) };
    assert_eq!(lamp.shape, LampShape::Profile { file: ies.display().to_string() });
    assert_eq!((lamp.strength, lamp.unit), (100.0, LampUnit::Candela));
    assert!(window.query_by_label("Save").is_none(), "the look is not in the way");
}

#[test]
fn what_moves_in_the_frame_of_the_release_is_part_of_the_step() {
    let mut window = with_lamp("Point");
    let before = window.state().look().clone();
    let from = middle(&window, "Move Point lamp 1 over surfaces");
    let [half, to] = [Vec3::new(-0.4, -0.2, -1.0), Vec3::new(-1.0, -0.2, -0.8)].map(|at| on_screen(&window, at));
    window.hover_at(from);
    window.run_steps(2);
    window.drag_at(from);
    window.run_steps(2);
    window.hover_at(half);
    window.run_steps(2);
    // A slow frame gets both at once.
    window.event(eframe::egui::Event::PointerMoved(to));
    window.drop_at(to);
    window.run_steps(3);
    assert!(lamps(&window)[0].position.x < -0.6, "{}", lamps(&window)[0].position);
    click(&mut window, "Undo");
    assert_eq!(*window.state().look(), before, "one drag is one step");
}

#[test]
fn with_patches_a_lamp_that_becomes_movable_leaves_the_picture_as_it_is() {
    let source = Source::Bytes { name: "room.gltf".into(), bytes: room() };
    let mut window =
        open_with(source, BakeConfig { spp: 64, tolerance_db: 30.0, patches: 256, ..BakeConfig::default() }, None);
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    let before = window.state().shown_ev();
    make_movable(&mut window, "lamp");
    wait(&mut window, |app| app.is_settled() && app.shown_ev() != before);
    let after = window.state().shown_ev();
    assert!((after - before).abs() < 0.15, "{before} {after}");
    assert!(window.query_by_label("Lamps: direct light only").is_none());
}

/// Chooses it from the menu of a light in the list.
fn make_movable(window: &mut Window, key: &str) {
    let row = window.get_by_label(&format!("Mute {key}")).rect();
    ask_for_menu(window, Pos2::new(row.right() + 20.0, row.center().y));
    click(window, "Make movable");
}

#[test]
fn the_strength_of_a_lamp_is_told_to_be_that_at_its_mark() {
    let mut window = baked();
    type_over(&mut window, "lamp factor", "6.4");
    make_movable(&mut window, "lamp");
    let lamp = lamps(&window)[0].clone();
    assert_eq!((lamp.strength, lamp.setting.intensity), (3.0, 6.4));
    window.get_by_label("Strength at 1×");
    click(&mut window, "Undo");
    assert!(lamps(&window).is_empty() && window.query_by_label("Strength at 1×").is_none());
    assert_eq!(window.state().look().lights.own_setting("lamp").intensity, 6.4);
}

#[test]
fn a_lamp_of_the_file_has_a_menu_where_it_hangs() {
    let mut window = baked();
    let lamp = on_screen(&window, Vec3::new(0.3, 0.6, -0.2));
    ask_for_menu(&mut window, lamp);
    click(&mut window, "Solo this alone");
    window.get_by_label_contains("Solo: lamp");
    click(&mut window, "Clear solo");
    ask_for_menu(&mut window, lamp);
    // It stays while the pointer is elsewhere.
    window.hover_at(Pos2::new(20.0, 20.0));
    window.run_steps(3);
    click(&mut window, "Make movable");
    assert_eq!(lamps(&window).len(), 1);
    click(&mut window, "Undo");
    assert_eq!(*window.state().look(), Look::default());
}

#[test]
fn lamps_are_muted_and_soloed_where_they_hang() {
    let mut window = with_lamp("Point");
    let is_muted = |window: &Window, key: &str| window.state().look().lights.own_setting(key).muted;
    let added = middle(&window, "Move Point lamp 1 over surfaces");
    for (key, at) in [("Point lamp 1", added), ("lamp", on_screen(&window, Vec3::new(0.3, 0.6, -0.2)))] {
        for (words, muted) in [("Mute", true), ("Unmute", false)] {
            ask_for_menu(&mut window, at);
            click(&mut window, words);
            assert_eq!(is_muted(&window, key), muted, "{key}");
        }
        ask_for_menu(&mut window, at);
        click(&mut window, "Solo this alone");
        window.get_by_label(&format!("Solo: {key}"));
    }
}

#[test]
fn a_lamp_that_its_file_has_since_the_bake_says_so_instead_of_being_set() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.transport");
    archive::write(&baked().state().session().shown.as_ref().unwrap().bake(), &path).unwrap();
    let mut gltf: Value = serde_json::from_slice(&room()).unwrap();
    let nodes = gltf["nodes"].as_array_mut().unwrap();
    nodes.push(json!({"name": "newer", "translation": [-0.4, 0.5, -0.2],
        "extensions": {"KHR_lights_punctual": {"light": 0}}}));
    let node = nodes.len() - 1;
    gltf["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(node));
    std::fs::write(folder.path().join("room.gltf"), gltf.to_string()).unwrap();

    let mut window = open(Source::File(path));
    wait(&mut window, |app| app.session().lamp_scene().is_some() && app.n_pictures() > 0);
    wait(&mut window, App::is_settled);
    let places = [Vec3::new(0.3, 0.6, -0.2), Vec3::new(-0.4, 0.5, -0.2)];
    let [known, newer] = places.map(|at| on_screen(&window, at));
    ask_for_menu(&mut window, known);
    click(&mut window, "Mute");
    assert!(window.state().look().lights.own_setting("lamp").muted);
    let before = window.state().look().clone();
    ask_for_menu(&mut window, newer);
    window.get_by_label_contains("bake it again to set this lamp");
    for offered in ["Mute", "Solo this alone", "Make movable", "Duplicate"] {
        assert!(window.query_by_label(offered).is_none(), "{offered}");
    }
    assert_eq!(*window.state().look(), before);
}

#[test]
fn a_panel_that_its_file_has_since_the_bake_says_so_instead_of_taking_spots() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.transport");
    archive::write(&baked().state().session().shown.as_ref().unwrap().bake(), &path).unwrap();
    let mut gltf: Value = serde_json::from_slice(&room()).unwrap();
    gltf["nodes"].as_array_mut().unwrap().last_mut().unwrap()["name"] = json!("newer");
    // With another lamp the file is that of the bake by its surfaces alone, and has panels of its own.
    gltf["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"] = json!(7);
    std::fs::write(folder.path().join("room.gltf"), gltf.to_string()).unwrap();

    let mut window = open(Source::File(path));
    wait(&mut window, |app| app.session().lamp_scene().is_some() && app.n_pictures() > 0);
    wait(&mut window, App::is_settled);
    let before = window.state().look().clone();
    let [from, to] = [Vec3::new(-0.2, 0.4, -0.7), Vec3::new(0.2, 0.4, -0.3)].map(|at| on_screen(&window, at));
    window.hover_at(from);
    window.run_steps(3);
    window.get_by_label("newer, it is not in this bake");
    ask_for_menu(&mut window, from);
    assert!(window.query_by_label("Add a spot here").is_none());
    window.key_press(Key::Escape);
    window.run_steps(3);
    drag(&mut window, from, to);
    assert_eq!(*window.state().look(), before);
}

#[test]
fn a_light_tells_its_name_where_the_pointer_is_on_it() {
    const OF_LAMP: &str = "lamp, click to choose it, drag to move it";
    const OF_PANEL: &str = "panel, drag to place a spot of light";
    const OF_SURFACE: &str = "panel, click to see what lights this";
    let told = |window: &mut Window, at: Vec3, words: [&str; 2]| {
        window.hover_at(on_screen(window, at));
        window.run_steps(3);
        words.map(|words| window.query_by_label(words).is_some())
    };
    let (lamp, panel, wall) = (Vec3::new(0.3, 0.6, -0.2), Vec3::new(-0.2, 0.4, -0.5), Vec3::new(-0.7, -0.6, -1.0));
    let mut window = with_lamp("Point");
    assert_eq!(told(&mut window, wall, [OF_LAMP, OF_PANEL]), [false, false]);
    assert_eq!(told(&mut window, lamp, [OF_LAMP, OF_PANEL]), [true, false]);
    assert_eq!(told(&mut window, panel, [OF_LAMP, OF_PANEL]), [false, true]);
    let added = middle(&window, "Move Point lamp 1 over surfaces");
    window.hover_at(added);
    window.run_steps(3);
    window.get_by_label("Point lamp 1, drag to move it over surfaces, with Alt freely");

    // A surface that shines evenly tells its name as well.
    let mut gltf: Value = serde_json::from_slice(&room()).unwrap();
    for node in gltf["nodes"].as_array_mut().unwrap() {
        node.as_object_mut().unwrap().remove("extras");
    }
    let mut window = open(Source::Bytes { name: "room.gltf".into(), bytes: serde_json::to_vec(&gltf).unwrap() });
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    assert_eq!(told(&mut window, wall, [OF_LAMP, OF_SURFACE]), [false, false]);
    assert_eq!(told(&mut window, panel, [OF_LAMP, OF_SURFACE]), [false, true]);
}

#[test]
fn a_bake_from_a_file_asks_for_its_scene_and_finds_it_beside_it() {
    let window = baked();
    let bake = window.state().session().shown.as_ref().unwrap().bake();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.transport");
    archive::write(&bake, &path).unwrap();
    drop(window);

    let mut window = open(Source::File(path.clone()));
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0);
    wait(&mut window, |app| app.session().lamp_scene().is_none() && app.is_settled());
    wait_until(&mut window, |window| says(window, "need the scene of this bake, room.gltf"));
    window.get_by_label("Choose the scene…");
    drop(window);

    std::fs::write(folder.path().join("room.gltf"), room()).unwrap();
    let mut window = open(Source::File(path.clone()));
    wait(&mut window, |app| app.session().lamp_scene().is_some() && app.n_pictures() > 0);
    click(&mut window, "Add lamp");
    click(&mut window, "Sphere");
    wait(&mut window, App::is_settled);
    window.get_by_label("Move Sphere lamp 1 along X");
    drop(window);

    // Where its own lamps were changed, others light its surfaces; it is not open to be baked.
    let mut lit_otherwise: Value = serde_json::from_slice(&room()).unwrap();
    lit_otherwise["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"] = json!(5);
    std::fs::write(folder.path().join("room.gltf"), lit_otherwise.to_string()).unwrap();
    let mut window = open(Source::File(path.clone()));
    wait(&mut window, |app| app.session().lamp_scene().is_some() && app.n_pictures() > 0);
    assert!(window.state().session().opened.as_ref().unwrap().scene.is_none());
    wait(&mut window, App::is_settled);
    let at = on_screen(&window, Vec3::new(0.3, 0.6, -0.2));
    ask_for_menu(&mut window, at);
    click(&mut window, "Make movable");
    assert!(says(&window, "lamp cannot be made movable: in its file it shines otherwise than in this bake"));
    assert!(lamps(&window).is_empty());
    click(&mut window, "Add lamp");
    click(&mut window, "Sphere");
    wait(&mut window, App::is_settled);
    window.get_by_label("Move Sphere lamp 1 along X");
    drop(window);

    // Another scene of the same name is refused.
    std::fs::write(folder.path().join("room.gltf"), include_bytes!("../room.gltf")).unwrap();
    let mut window = open(Source::File(path));
    wait_until(&mut window, |window| says(window, "its geometry, materials or camera differ"));
}

#[test]
fn a_directional_lamp_that_was_baked_with_a_size_is_made_movable_with_it() {
    let mut gltf: Value = serde_json::from_slice(&room()).unwrap();
    let lights = gltf["extensions"]["KHR_lights_punctual"]["lights"].as_array_mut().unwrap();
    lights.push(json!({ "type": "directional", "intensity": 3 }));
    let nodes = gltf["nodes"].as_array_mut().unwrap();
    nodes.push(json!({ "name": "sun", "extensions": { "KHR_lights_punctual": { "light": 1 } } }));
    let node = nodes.len() - 1;
    gltf["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(node));
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("room.gltf"), gltf.to_string()).unwrap();

    // As `--sun-size` does.
    let mut scene = import::load(&folder.path().join("room.gltf")).unwrap().scene;
    assert_eq!(scene.set_sun_radius(0.05), 1);
    let scene = Arc::new(PreparedScene::new(scene, &[]).unwrap().0);
    let (camera, film) = (scene.scene.cameras[0].clone(), Film { width: 32, height: 24 });
    let job = BakeJob { scene, camera, film, config: quick(), passes: Passes::FinalOnly, irradiance: Vec::new() };
    let path = folder.path().join("room.transport");
    archive::write(&job.run(|_| ControlFlow::Continue(())).unwrap().unwrap(), &path).unwrap();

    let mut window = open(Source::File(path));
    wait(&mut window, |app| app.session().lamp_scene().is_some() && app.n_pictures() > 0 && app.is_settled());
    make_movable(&mut window, "sun");
    let lamps = lamps(&window);
    let [sun] = &lamps[..] else { panic!("{lamps:?}") };
    assert_eq!((&sun.shape, sun.strength), (&LampShape::Directional { radius_rad: 0.05 }, 3.0));
    assert_eq!(sun.replaces.as_deref(), Some("sun"));
}

fn says(window: &Window, words: &str) -> bool {
    window.query_all_by_label_contains(words).next().is_some()
}

#[test]
fn a_profile_that_another_program_wrote_is_read_again_where_the_lamp_hangs() {
    let folder = tempfile::tempdir().unwrap();
    let (ies, look) = (folder.path().join("down.ies"), folder.path().join("a.look"));
    // Straight down alone, then as much to all sides.
    let write = |at_45: u32, at_90: u32| {
        let file = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 10\n0 45 90\n0\n";
        std::fs::write(&ies, format!("{file}100 {at_45} {at_90}\n")).unwrap();
    };
    write(0, 0);
    let lamp = json!({ "key": "down", "type": "ies", "position": [0.0, 0.9, 0.0], "aim": [0.0, -1.0, 0.0], "strength": 3000,
        "unit": "cd", "file": "down.ies" });
    let document = json!({ "clerestory": 1, "lights": { "lamp": { "muted": true } }, "lamps": [lamp] });
    std::fs::write(&look, document.to_string()).unwrap();
    let mut window = baked_larger();
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(look)));
    wait(&mut window, |app| app.look().lights.lamps.len() == 1 && app.is_settled());
    let (narrow, before) = (window.state().shown_ev(), lamps(&window));
    write(100, 100);
    for _ in 0..200 {
        window.step();
        if window.query_by_label("down.ies has changed on disk").is_some() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    click(&mut window, "Reload");
    wait(&mut window, |app| app.is_settled() && app.shown_ev() < narrow - 1.0);
    assert_eq!(lamps(&window), before, "it hangs and shines as it was set");
    assert!(window.query_by_label_contains("has changed on disk").is_none());
}

#[test]
fn a_lamp_with_a_remark_is_not_called_dark_and_one_without_light_is() {
    let folder = tempfile::tempdir().unwrap();
    let (ies, look) = (folder.path().join("tilted.ies"), folder.path().join("a.look"));
    let tilts = "IESNA:LM-63-2002\nTILT=INCLUDE\n1\n2\n0 90\n1 0.8\n";
    std::fs::write(&ies, format!("{tilts}1 1000 1 3 1 1 2 0 0 0\n1 1 10\n0 45 90\n0\n100 100 100\n")).unwrap();
    let with = |lamps: &[Value]| {
        let (document, n_lamps) = (json!({ "clerestory": 1, "lamps": lamps }), lamps.len());
        std::fs::write(&look, document.to_string()).unwrap();
        let mut window = baked();
        window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(look.clone())));
        wait(&mut window, |app| app.look().lights.lamps.len() == n_lamps && app.is_settled());
        window
    };
    let is_noted = |window: &Window, label: &str| window.query_by_label(label).is_some();

    let tilted = json!({ "key": "tilted", "type": "ies", "position": [0.0, 0.9, 0.0], "aim": [0.0, -1.0, 0.0],
        "strength": 3000, "unit": "cd", "file": "tilted.ies" });
    let mut window = with(&[tilted]);
    wait_until(&mut window, |window| is_noted(window, "Lamps: 1 remark"));
    assert!(!is_noted(&window, "Lamps: not all shine"), "it shines");
    assert!(is_noted(&window, "Lamps: direct light only"), "and what its light lacks is told as well");
    click(&mut window, "Lamps: 1 remark");
    assert!(says(&window, "it shines as it was measured"));

    let flat = |key: &str| {
        json!({ "key": key, "type": "rectangle", "position": [0.0, 0.9, 0.0], "aim": [0.0, -1.0, 0.0],
            "strength": 3000, "unit": "nit", "size_m": [1.0, 0.0] })
    };
    let mut window = with(&[flat("flat"), flat("thin")]);
    wait_until(&mut window, |window| is_noted(window, "Lamps: not all shine"));
    assert!(!is_noted(&window, "Lamps: 1 remark"));
    assert!(hints(&mut window, "Lamps: not all shine", "`thin`"), "why is told of each");
}

/// Clicks the names of two lamps in the list, the second with Ctrl.
fn select(window: &mut Window, names: [&str; 2]) {
    for (name, modifiers) in names.into_iter().zip([Modifiers::NONE, Modifiers::COMMAND]) {
        let mute = window.get_by_label(&format!("Mute {name}")).rect();
        window.event(Event::ModifiersChanged(modifiers));
        click_at(window, mute.right_center() + vec2(20.0, 0.0), modifiers);
        window.event(Event::ModifiersChanged(Modifiers::NONE));
        window.run_steps(3);
    }
}

/// The room with two lamps of a kind, both selected.
fn with_two_lamps(kind: &str, names: [&str; 2]) -> Window {
    let mut window = with_lamp(kind);
    window.key_press_modifiers(Modifiers::COMMAND, Key::D);
    window.run_steps(3);
    select(&mut window, names);
    window
}

#[test]
fn all_lamps_that_are_selected_move_together_and_go_back_together() {
    let mut window = with_two_lamps("Point", ["Point lamp 1", "Point lamp 2"]);
    let before = lamps(&window);
    let ways = |window: &Window| -> Vec<Vec3> {
        lamps(window).iter().zip(&before).map(|(now, was)| now.position - was.position).collect()
    };
    let alike = |ways: &[Vec3]| ways[0].distance(ways[1]) < 1e-5 && ways[0].length() > 0.02;
    pull(&mut window, "Move Point lamp 2 along X", vec2(60.0, 25.0));
    assert!(alike(&ways(&window)), "{:?}", ways(&window));
    click(&mut window, "Undo");
    assert_eq!(lamps(&window), before, "one drag is one step");

    // One that has no handles yet takes the others along as well, and all stay selected.
    pull(&mut window, "Point lamp 1 in the picture", vec2(-50.0, 30.0));
    assert!(alike(&ways(&window)), "{:?}", ways(&window));
    assert_eq!(window.query_all_by_label_contains("2 lights selected").count(), 1);
    click(&mut window, "Undo");
    let from = middle(&window, "Move Point lamp 1 along Y");
    window.hover_at(from);
    window.run_steps(2);
    window.drag_at(from);
    window.run_steps(2);
    for step in 1..4 {
        window.hover_at(from + vec2(0.0, -20.0 * step as f32));
        window.run_steps(2);
    }
    assert!(alike(&ways(&window)), "{:?}", ways(&window));
    window.key_press(Key::Escape);
    window.run_steps(2);
    assert_eq!(lamps(&window), before);
    window.drop_at(from);
    window.run_steps(3);
    assert_eq!(lamps(&window), before);
}

#[test]
fn all_lamps_that_are_selected_are_aimed_together() {
    let mut window = with_two_lamps("Spot", ["Spot lamp 1", "Spot lamp 2"]);
    let (before, side) = (lamps(&window), Vec3::new(-1.0, -0.2, -0.8));
    window.key_press(Key::A);
    window.run_steps(3);
    let at = on_screen(&window, side);
    window.hover_at(at);
    window.run_steps(3);
    window.get_by_label("Click what Spot lamp 2 and 1 more are to light, Esc to leave it");
    click_at(&mut window, at, Modifiers::NONE);
    for lamp in lamps(&window) {
        assert!(lamp.aim.distance(side) < 0.03, "{} at {}", lamp.key, lamp.aim);
    }
    click(&mut window, "Undo");
    assert_eq!(lamps(&window), before, "it is one step");
}

#[test]
fn the_menu_of_a_selected_lamp_in_the_picture_leaves_the_others_selected() {
    let mut window = with_two_lamps("Point", ["Point lamp 1", "Point lamp 2"]);
    let at = middle(&window, "Point lamp 1 in the picture");
    ask_for_menu(&mut window, at);
    assert_eq!(window.query_all_by_label_contains("2 lights selected").count(), 1);
    // The numbers of the chosen lamp have a button of this name, too.
    let picture = window.get_by_label("Picture").rect();
    window.get_all_by_label("Delete").find(|item| picture.contains(item.rect().center())).unwrap().click();
    window.run_steps(3);
    assert!(lamps(&window).is_empty(), "as by the menu of its name");
    click(&mut window, "Undo");
    assert_eq!(lamps(&window).len(), 2, "one step");
}

#[test]
fn copies_that_are_selected_are_aimed_by_the_key_though_none_of_them_was_clicked() {
    let mut window = with_two_lamps("Spot", ["Spot lamp 1", "Spot lamp 2"]);
    window.key_press_modifiers(Modifiers::COMMAND, Key::D);
    window.run_steps(3);
    let (before, side) = (lamps(&window), Vec3::new(-1.0, -0.2, -0.8));
    window.key_press(Key::A);
    window.run_steps(3);
    let at = on_screen(&window, side);
    click_at(&mut window, at, Modifiers::NONE);
    let after = lamps(&window);
    assert_eq!(after[..2], before[..2], "they are selected no longer");
    for lamp in &after[2..] {
        assert!(lamp.aim.distance(side) < 0.03, "{} at {}", lamp.key, lamp.aim);
    }
}

#[test]
fn esc_that_gives_up_what_is_typed_leaves_a_lamp_to_be_aimed() {
    let mut window = with_lamp("Spot");
    window.key_press(Key::A);
    window.run_steps(3);
    let strength = lamps(&window)[0].strength;
    type_keys(&mut window, "Spot lamp 1 strength", "7");
    let at = on_screen(&window, Vec3::new(-1.0, -0.2, -0.8));
    for is_aimed in [true, false] {
        window.key_press(Key::Escape);
        window.run_steps(4);
        window.hover_at(at);
        window.run_steps(3);
        let hint = window.query_by_label("Click what Spot lamp 1 is to light, Esc to leave it");
        assert_eq!((hint.is_some(), lamps(&window)[0].strength), (is_aimed, strength));
    }
}

#[test]
fn all_lamps_that_are_selected_are_copied_and_deleted_together() {
    let mut window = with_lamp("Point");
    window.key_press_modifiers(Modifiers::COMMAND, Key::D);
    window.run_steps(3);
    assert_eq!(lamps(&window).len(), 2);
    select(&mut window, ["Point lamp 1", "Point lamp 2"]);
    window.key_press_modifiers(Modifiers::COMMAND, Key::D);
    window.run_steps(3);
    assert_eq!(lamps(&window).len(), 4, "both have a copy");
    window.key_press(Key::Delete);
    window.run_steps(3);
    let names: Vec<String> = lamps(&window).into_iter().map(|lamp| lamp.key).collect();
    assert_eq!(names, ["Point lamp 1", "Point lamp 2"], "the copies were selected, and are gone");
    click(&mut window, "Undo");
    assert_eq!(lamps(&window).len(), 4, "in one step");
}

#[test]
fn a_lamp_that_is_clicked_while_the_panels_are_hidden_is_selected_alone() {
    let mut window = with_two_lamps("Point", ["Point lamp 1", "Point lamp 2"]);
    window.key_press(Key::H);
    window.run_steps(3);
    let at = middle(&window, "Point lamp 1 in the picture");
    click_at(&mut window, at, Modifiers::NONE);
    window.key_press(Key::Delete);
    window.run_steps(3);
    let names: Vec<String> = lamps(&window).into_iter().map(|lamp| lamp.key).collect();
    assert_eq!(names, ["Point lamp 2"], "the other one was selected before");
}

#[test]
fn a_lamp_that_is_added_below_a_master_is_below_it() {
    let mut window = with_lamp("Point");
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    click(&mut window, "Mute group Added lamps");
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    let keys: Vec<String> = lamps(&window).into_iter().map(|lamp| lamp.key).collect();
    assert_eq!(keys.len(), 3);
    for key in keys {
        assert!(window.state().look().lights.setting(&key).muted, "{key}");
    }
}

#[test]
fn a_look_takes_no_more_lamps_than_it_could_be_opened_with() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("full.look");
    let lamp = |nth: usize| json!({"key": format!("l{nth}"), "type": "point", "position": [0, 0, 0], "strength": 1, "muted": true});
    let all: Vec<Value> = (0..1000).map(lamp).collect();
    std::fs::write(&path, json!({ "clerestory": 1, "lamps": all }).to_string()).unwrap();
    let mut window = baked();
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(path)));
    wait(&mut window, |app| app.look().lights.lamps.len() == 1000);
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    assert_eq!(lamps(&window).len(), 1000);
    assert!(says(&window, "a look holds 1000 lamps at most"));
}

#[test]
fn a_lamp_of_a_kept_look_that_has_the_name_of_a_light_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.look");
    let lamp = json!({"key": "lamp", "type": "point", "position": [0, 0, 0], "strength": 1});
    let look = json!({"clerestory": 1, "looks": [{"name": "Evening", "lamps": [lamp]}]});
    std::fs::write(&path, look.to_string()).unwrap();
    let mut window = baked();
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(path)));
    wait(&mut window, |app| !app.look().snapshots.is_empty());
    assert!(says(&window, "looks that were kept have a lamp `lamp`, but a light of the scene has this name"));
    assert!(window.state().look().snapshots[0].lights.lamps.is_empty());
}

#[test]
fn a_light_that_takes_the_name_of_a_lamp_of_a_kept_look_is_told_after_a_reload() {
    let folder = tempfile::tempdir().unwrap();
    let [path, of_look] = ["room.gltf", "a.look"].map(|name| folder.path().join(name));
    std::fs::write(&path, room()).unwrap();
    let desk = json!({"key": "desk", "type": "point", "position": [0, 0, 0], "strength": 1});
    let look = json!({"clerestory": 1, "looks": [{"name": "Evening", "lamps": [desk]}]});
    std::fs::write(&of_look, look.to_string()).unwrap();
    let mut window = open(Source::File(path.clone()));
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(of_look)));
    wait(&mut window, |app| !app.look().snapshots.is_empty());
    const TOLD: &str = "looks that were kept have a lamp `desk`, but a light of the scene has this name";
    assert!(!says(&window, TOLD));
    let mut gltf: Value = serde_json::from_slice(&room()).unwrap();
    gltf["nodes"][1]["name"] = json!("desk");
    replace_and_reload(&mut window, &path, &gltf);
    wait_until(&mut window, |window| says(window, TOLD));
    assert_eq!(window.state().look().snapshots[0].lights.lamps.len(), 1, "it is kept");
}

#[test]
fn what_is_said_of_lamps_is_of_the_moment_of_the_timeline_that_is_seen() {
    const DIRECT: &str = "Lamps: direct light only";
    let mut window = baked();
    click(&mut window, "Keep look");
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    wait(&mut window, App::is_settled);
    assert!(window.query_by_label(DIRECT).is_some());
    click(&mut window, "Timeline");
    click(&mut window, "Add key");
    click(&mut window, "Look");
    let start = window.get_by_label("Timeline ruler").rect().left_top();
    drag(&mut window, start + vec2(60.0, 8.0), start + vec2(12.0, 8.0));
    wait(&mut window, App::is_settled);
    for words in [DIRECT, "Lamps: lighting"] {
        assert!(window.query_by_label(words).is_none(), "no lamp shines there, but: {words}");
    }
    click(&mut window, "Back to the lights");
    wait(&mut window, App::is_settled);
    assert!(window.query_by_label(DIRECT).is_some());
}

#[test]
fn what_a_moved_lamp_lacks_is_baked_from_where_it_is_told() {
    let mut window = with_lamp("Point");
    wait(&mut window, App::is_settled);
    click(&mut window, "Lamps: direct light only");
    click(&mut window, "Bake the rest of their light");
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    assert!(window.state().session().shown.as_ref().is_some_and(|shown| shown.patches().is_some()));
    assert!(window.query_by_label("Lamps: direct light only").is_none());
    assert_eq!(lamps(&window).len(), 1, "the look stays");
}
