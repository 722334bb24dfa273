//! Numbers in the window, typed a key in a frame as people do, and dragged.

use clerestory::app::{App, Start};
use clerestory::export::options::Region;
use clerestory::look::Look;
use clerestory::look::wishes::Wanted;
use clerestory::session::{BakeState, Source};
use clerestory_transport::camera::{Film, Pose};
use clerestory_transport::lamps::LampShape;
use eframe::egui::{Event, Key, Modifiers, PointerButton, Role, ViewportCommand, ViewportEvent, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};

use crate::desk::{
    Dropped, Window, ask_for, baked, baked_larger, click, drag, reach, room, save_as, there_and_back, type_keys,
    type_over, wait,
};

fn intensity(window: &Window) -> f32 {
    window.state().look().lights.own_setting("lamp").intensity
}

/// The room with the size and the quality of those who never chose any; its bake is stopped.
fn unset() -> Window {
    let start = Start::alone(Source::Bytes { name: "room.gltf".into(), bytes: room() }, None);
    let mut window = Harness::builder().with_size(vec2(1440.0, 900.0)).build_eframe(|cc| App::new(cc, start).unwrap());
    wait(&mut window, |app| app.session().bake.is_running());
    click(&mut window, "Stop the bake");
    wait(&mut window, |app| !app.session().bake.is_running());
    window
}

#[test]
fn the_height_goes_with_a_width_that_is_typed_or_dragged() {
    let mut window = unset();
    let film = |app: &App| app.settings().film;
    assert_eq!(film(window.state()), Film { width: 640, height: 480 });
    for (text, width, height) in [("1920", 1920, 1440), ("16", 16, 16), ("800", 800, 600)] {
        type_over(&mut window, "Width", text);
        assert_eq!(film(window.state()), Film { width, height }, "{text}");
    }
    let least = there_and_back(&mut window, "Width", 3300.0, |app| film(app).width);
    assert!(least < 30, "{least}");
    assert_eq!(film(window.state()), Film { width: 800, height: 600 });
    // A height of one's own makes proportions of one's own.
    type_over(&mut window, "Height", "200");
    type_over(&mut window, "Width", "1600");
    assert_eq!(film(window.state()), Film { width: 1600, height: 400 });
}

#[test]
fn intensities_are_what_was_typed_in_every_unit_and_view() {
    let mut window = baked();
    // What a factor is in each unit, which the file does not tell exactly.
    let cases = [
        (
            "EV, stops above the file",
            "stops",
            [("0.25", 0.25f64.exp2()), ("1.25", 1.25f64.exp2()), ("-0,5", (-0.5f64).exp2())],
        ),
        ("lm, luminous flux", "lm", [("1.5", 1.5), ("12.5", 12.5), ("2k", 2000.0)]),
        ("W, electrical power", "W", [("0.25", 0.25), ("1.5 W", 1.5), ("0.05", 0.05)]),
    ];
    for view in ["List", "Board", "Table"] {
        click(&mut window, view);
        for (words, unit, typed) in cases {
            click(&mut window, "Unit of intensities");
            click(&mut window, words);
            let label = format!("lamp {unit}");
            type_over(&mut window, &label, "100 %");
            // One in the unit.
            type_over(&mut window, &label, "1");
            let one = if unit == "stops" { 1.0 } else { f64::from(intensity(&window)) };
            for (text, wanted) in typed {
                type_over(&mut window, &label, text);
                let found = f64::from(intensity(&window));
                assert!((found / (wanted * one) - 1.0).abs() < 1e-3, "{view}: {text} {unit} is {found}, not {wanted}");
            }
            type_over(&mut window, &label, "50 %");
            assert!((intensity(&window) - 0.5).abs() < 1e-5, "{view}: {}", intensity(&window));
            type_over(&mut window, &label, "off");
            assert_eq!(intensity(&window), 0.0);
        }
    }
    // All that are selected at once.
    click(&mut window, "List");
    let mute = window.get_by_label("Mute lamp").rect();
    let name = eframe::egui::pos2(mute.right() + 20.0, mute.center().y);
    window.hover_at(name);
    window.run_steps(2);
    window.drag_at(name);
    window.drop_at(name);
    window.run_steps(3);
    type_over(&mut window, "Selected lights W", "0.25");
    let quarter = intensity(&window);
    type_over(&mut window, "Selected lights W", "0.5");
    assert!(quarter > 0.0 && (intensity(&window) / quarter - 2.0).abs() < 1e-4, "{quarter}");
}

#[test]
fn escape_gives_up_what_was_typed_tab_takes_it_and_digits_alone_change_nothing() {
    let mut window = baked();
    type_over(&mut window, "lamp factor", "0.123456");
    assert_eq!(intensity(&window), 0.123_456);
    let look = window.state().look().clone();
    for leave in [Key::Tab, Key::Enter, Key::Escape] {
        type_keys(&mut window, "lamp factor", "");
        window.key_press(leave);
        window.run_steps(4);
        assert_eq!(*window.state().look(), look, "{leave:?} leaves the digits that are not shown");
    }
    type_keys(&mut window, "lamp factor", "7");
    assert_eq!(*window.state().look(), look, "not before all of it is there");
    window.key_press(Key::Escape);
    window.run_steps(4);
    assert_eq!(*window.state().look(), look);
    type_keys(&mut window, "lamp factor", "7");
    window.key_press(Key::Tab);
    window.run_steps(4);
    assert_eq!(intensity(&window), 7.0);
    type_keys(&mut window, "lamp factor", "8");
    click(&mut window, "Mute panel");
    assert_eq!(intensity(&window), 8.0, "a click elsewhere takes it");
    assert!(window.state().look().lights.lights["panel"].muted, "and is a click");
    type_over(&mut window, "lamp factor", "1..5");
    assert_eq!(intensity(&window), 8.0, "what is no number changes nothing");
    // A drag changes it at once.
    let seen = there_and_back(&mut window, "lamp factor", 60.0, |app| app.look().lights.own_setting("lamp").intensity);
    assert!(seen < 7.0, "{seen}");
}

#[test]
fn a_light_above_its_fader_is_dragged_from_where_it_is() {
    let mut window = baked();
    type_over(&mut window, "lamp factor", "100");
    let handle = window.get_by_label("lamp intensity").rect().right_center() - vec2(6.5, 0.0);
    drag(&mut window, handle, handle - vec2(3.0, 0.0));
    assert!((40.0..100.0).contains(&intensity(&window)), "{}", intensity(&window));
}

#[test]
fn stops_of_a_light_that_is_off_are_dragged_up_from_the_file() {
    let mut window = baked();
    click(&mut window, "Unit of intensities");
    click(&mut window, "EV, stops above the file");
    type_over(&mut window, "lamp stops", "off");
    assert_eq!(intensity(&window), 0.0);
    let field = window.get_by_label("lamp stops").rect().center();
    drag(&mut window, field, field + vec2(60.0, 0.0));
    assert!((1.0..4.0).contains(&intensity(&window)), "{}", intensity(&window));
}

#[test]
fn the_camera_takes_angles_and_lenses_with_a_point_and_leaves_what_was_not_typed() {
    let mut window = baked();
    click(&mut window, "Numbers");
    reach(&mut window, "Straighten verticals");
    let pose = |window: &Window| Pose::of(window.state().camera().unwrap());
    type_over(&mut window, "Yaw", "12.5");
    assert!((pose(&window).yaw_rad.to_degrees() - 12.5).abs() < 1e-3, "{}", pose(&window).yaw_rad.to_degrees());
    type_over(&mut window, "Pitch", "-7.25°");
    assert!((pose(&window).pitch_rad.to_degrees() + 7.25).abs() < 1e-3, "{}", pose(&window).pitch_rad.to_degrees());
    type_over(&mut window, "Focal length", "35.5");
    let focal_mm = |window: &Window| 13.5 / (0.5 * window.state().camera().unwrap().yfov_rad).tan();
    assert!((focal_mm(&window) - 35.5).abs() < 1e-2, "{}", focal_mm(&window));
    type_over(&mut window, "Camera X", "1e39");
    assert_eq!(pose(&window).position.x, 1e6, "as far as a look keeps it");
    type_over(&mut window, "Camera X", "1.25");
    assert_eq!(pose(&window).position.x, 1.25);
    let camera = window.state().camera().unwrap().clone();
    for label in ["Camera X", "Yaw", "Pitch", "Roll", "Field of view", "Focal length", "Shift X"] {
        type_keys(&mut window, label, "");
        window.key_press(Key::Tab);
        window.run_steps(3);
    }
    assert_eq!(*window.state().camera().unwrap(), camera, "to be looked at is no change");
}

#[test]
fn an_angle_of_view_stays_as_it_is_typed_whatever_focal_length_that_is() {
    let mut window = baked();
    click(&mut window, "Numbers");
    // 1.8 mm, less than can be typed as one.
    for degrees in [165.0f32, 60.0] {
        type_over(&mut window, "Field of view", &degrees.to_string());
        let found = window.state().camera().unwrap().yfov_rad.to_degrees();
        assert!((found - degrees).abs() < 1e-3, "{found}");
    }
    type_over(&mut window, "Focal length", "0.5");
    let focal_mm = 13.5 / (0.5 * window.state().camera().unwrap().yfov_rad).tan();
    assert!((focal_mm - 2.0).abs() < 1e-3, "what is typed is brought in: {focal_mm}");
}

#[test]
fn a_bookmark_has_another_name_once_it_is_typed_and_no_two_have_the_same() {
    let mut window = baked();
    for yaw in ["10", "20"] {
        if yaw == "10" {
            click(&mut window, "Numbers");
        }
        type_over(&mut window, "Yaw", yaw);
        reach(&mut window, "Bookmark");
    }
    let names = |window: &Window| -> Vec<String> {
        window.state().look().bookmarks.iter().map(|bookmark| bookmark.name.clone()).collect()
    };
    assert_eq!(names(&window), ["Bookmark 1", "Bookmark 2"]);
    reach(&mut window, "View");
    click(&mut window, "Bookmark 2");
    type_keys(&mut window, "Name of the bookmark", "");
    window.key_press(Key::Backspace);
    window.run_steps(2);
    let text = window.get_by_label("Name of the bookmark").accesskit_node().value().unwrap_or_default();
    assert_eq!(text, "", "the field may be empty on the way");
    for key in ["D", "o", "o", "r"] {
        window.event(Event::Text(key.into()));
        window.run_steps(2);
    }
    window.key_press(Key::Enter);
    window.run_steps(4);
    assert_eq!(names(&window), ["Bookmark 1", "Door"]);
    assert_eq!(window.state().camera().unwrap().name, "Door");
    for text in ["Bookmark 1", " ", "room camera"] {
        type_over(&mut window, "Name of the bookmark", text);
        if text != "room camera" {
            assert_eq!(names(&window), ["Bookmark 1", "Door"], "{text}");
        }
    }
    assert_eq!(names(&window), ["Bookmark 1", "room camera"]);
}

#[test]
fn an_outer_cone_that_is_typed_or_dragged_keeps_the_inner_one() {
    let mut window = baked();
    click(&mut window, "Add lamp");
    click(&mut window, "Spot");
    wait(&mut window, App::is_settled);
    let cone = |app: &App| match app.look().lights.lamps[0].shape {
        LampShape::Spot { inner_rad, outer_rad } => [inner_rad, outer_rad].map(f32::to_degrees),
        ref other => panic!("{other:?}"),
    };
    let inner = cone(window.state())[0];
    type_over(&mut window, "Spot lamp 1 outer angle", "52.5");
    assert_eq!(cone(window.state()), [inner, 52.5]);
    let least = there_and_back(&mut window, "Spot lamp 1 outer angle", 240.0, cone);
    assert!(least[0] < inner && least[1] < inner, "it goes along while it must: {least:?}");
    let [back, outer] = cone(window.state());
    assert!((back - inner).abs() < 1e-4 && (outer - 52.5).abs() < 1.0, "{back} {outer}");
    type_over(&mut window, "Spot lamp 1 outer angle", "5");
    assert_eq!(cone(window.state()), [5.0, 5.0]);
}

#[test]
fn the_scale_of_false_color_keeps_its_lower_end() {
    let mut window = baked();
    click(&mut window, "False color");
    click(&mut window, "Luminance");
    reach(&mut window, "Fit range");
    let range = |app: &App| app.look().display.false_color.unwrap().range.unwrap();
    type_over(&mut window, "Scale to", "1000");
    type_over(&mut window, "Scale from", "100");
    type_over(&mut window, "Scale to", "500 cd/m²");
    assert_eq!(range(window.state()), [100.0, 500.0]);
    let least = there_and_back(&mut window, "Scale to", 95.0, range);
    assert!(least[0] < 100.0, "{least:?}");
    assert_eq!(range(window.state())[0], 100.0);
}

#[test]
fn a_part_of_the_picture_stays_the_same_part_at_another_width() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = baked_larger();
    ask_for(&mut window, "Export…", &folder.path().join("room.png"));
    click(&mut window, "Region");
    let region = |app: &App| app.export_options().region.unwrap();
    for (label, text) in [("Region width", "40"), ("Region left", "16"), ("Region height", "24"), ("Region top", "8")] {
        type_over(&mut window, label, text);
    }
    let whole = Region { x: 16, y: 8, width: 40, height: 24 };
    assert_eq!(region(window.state()), whole);
    type_over(&mut window, "Width of the file", "32");
    assert_eq!(region(window.state()), Region { x: 8, y: 4, width: 20, height: 12 });
    let least = there_and_back(&mut window, "Width of the file", 200.0, region);
    assert!(least.width < 10, "{least:?}");
    assert_eq!(region(window.state()), Region { x: 8, y: 4, width: 20, height: 12 });
    type_over(&mut window, "Width of the file", "64");
    assert_eq!(region(window.state()), whole);
    type_over(&mut window, "Region width", "9999");
    assert_eq!(region(window.state()).width, 64, "what is typed is brought in");
}

#[test]
fn the_largest_factor_of_solve_may_begin_with_a_small_digit() {
    let mut window = baked();
    click(&mut window, "Solve for light");
    let bounds = |app: &App| app.look().wishes.bounds;
    type_over(&mut window, "Least factor", "5");
    type_over(&mut window, "Largest factor", "20");
    assert_eq!(bounds(window.state()), [5.0, 20.0]);
    type_over(&mut window, "Least factor", "30");
    assert_eq!(bounds(window.state()), [30.0, 30.0]);
}

#[test]
fn the_efficacy_of_the_schedule_is_typed_with_its_unit_or_without() {
    let mut window = baked();
    click(&mut window, "Measure");
    for (text, wanted) in [("80", 80.0), ("95 lm/W", 95.0), ("12 lm", 95.0)] {
        type_over(&mut window, "Efficacy", text);
        let found = window.get_by_label("Efficacy").accesskit_node().numeric_value();
        assert_eq!(found, Some(wanted), "{text}");
    }
}

#[test]
fn numbers_of_a_look_that_no_hand_would_set_stay() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bright.look");
    let json = r#"{"clerestory": 1, "lights": {"lamp": {"intensity": 2e6}},
        "display": {"false_color": {"quantity": "luminance", "range": [1e-5, 1e10]}},
        "wishes": {"keep": 0, "list": [{"name": "bright", "cd_m2": 2e6, "weight": 500}]}}"#;
    std::fs::write(&path, json).unwrap();
    let mut window = baked();
    click(&mut window, "Solve for light");
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(path)));
    wait(&mut window, |app| !app.look().wishes.list.is_empty());
    window.run_steps(8);
    assert_eq!(intensity(&window), 2e6);
    let wishes = &window.state().look().wishes;
    assert_eq!((wishes.keep, wishes.list[0].weight), (0.0, 500.0));
    assert_eq!(wishes.list[0].wanted, Wanted::Luminance(2e6));
    let range = |window: &Window| window.state().look().display.false_color.unwrap().range.unwrap();
    assert_eq!(range(&window), [1e-5, 1e10]);
    // The other end may lie beyond the panel, so long is its number.
    type_over(&mut window, "Scale from", "1000");
    let [low, high] = range(&window);
    assert!(high == 1e10 && (low - 1e4).abs() < 1.0, "what is edited can be told apart: {low} {high}");
}

#[test]
fn what_is_typed_in_a_dialog_counts_for_the_button_that_is_clicked_next() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.png");
    let mut window = baked_larger();
    ask_for(&mut window, "Export…", &path);
    type_keys(&mut window, "Width of the file", "32");
    click(&mut window, "Save");
    wait(&mut window, |_| path.exists());
    assert_eq!(image::open(&path).unwrap().width(), 32);
    type_keys(&mut window, "Samples per pixel", "8");
    click(&mut window, "Start bake");
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    assert_eq!(window.state().settings().config.spp, 8);
    assert_eq!(window.state().look().lights, Look::default().lights);
}

#[test]
fn a_number_beside_a_slider_is_typed_like_any_other() {
    let mut window = baked();
    let look = window.state().look().clone();
    let field = |window: &Window| {
        let all = window.get_all_by_role_and_label(Role::SpinButton, "Exposure");
        all.last().unwrap().rect().center()
    };
    let at = field(&window);
    let begin = |window: &mut Window| {
        window.hover_at(at);
        window.run_steps(2);
        window.drag_at(at);
        window.drop_at(at);
        window.run_steps(3);
    };
    begin(&mut window);
    window.key_press(Key::Tab);
    window.run_steps(3);
    assert_eq!(*window.state().look(), look, "to be passed by Tab does not end the automatic exposure");
    begin(&mut window);
    for key in ["-", "0", ".", "1", "5"] {
        window.event(Event::Text(key.into()));
        window.run_steps(2);
    }
    assert_eq!(*window.state().look(), look);
    window.key_press(Key::Enter);
    window.run_steps(3);
    assert_eq!(window.state().look().display.exposure_ev, Some(-0.15));
}

#[test]
fn a_press_elsewhere_takes_what_was_typed_though_a_drag_comes_of_it() {
    let mut window = baked();
    let picture = window.get_by_label("Picture").rect().center();
    type_keys(&mut window, "lamp factor", "7");
    window.hover_at(picture);
    window.run_steps(2);
    assert_eq!(intensity(&window), 1.0);
    window.drag_at(picture);
    window.run_steps(1);
    assert_eq!(intensity(&window), 7.0, "the press takes it");
    window.drop_at(picture);
    window.run_steps(3);
    type_keys(&mut window, "lamp factor", "5");
    drag(&mut window, picture, picture + vec2(30.0, 12.0));
    assert_eq!(intensity(&window), 5.0);
    // Another view has other fields.
    type_keys(&mut window, "lamp factor", "4");
    click(&mut window, "Table");
    assert_eq!(intensity(&window), 4.0);
    click(&mut window, "List");
    let look = window.state().look().clone();
    for name in ["lamp", "panel"] {
        let is_name = |node: &egui_kittest::Node<'_>| node.accesskit_node().role() == Role::Label;
        window.query_all_by_label(name).find(is_name).unwrap().click_accesskit();
        window.run_steps(3);
        if name == "lamp" {
            type_over(&mut window, "Selected lights factor", "1");
            type_keys(&mut window, "Selected lights factor", "9");
        }
    }
    window.key_press(Key::Enter);
    window.run_steps(3);
    let now = &window.state().look().lights;
    assert_eq!(now.own_setting("panel"), look.lights.own_setting("panel"), "what was typed for one is not for another");
}

#[test]
fn a_spot_is_no_larger_and_no_brighter_than_a_look_holds() {
    let mut window = baked();
    click(&mut window, "Spots");
    let mut set = |label: &str, value: f64| {
        window.get_all_by_role_and_label(Role::SpinButton, label).last().unwrap().set_value_accesskit(value);
        window.run_steps(3);
        window.state().look().lights.panels["panel"][0]
    };
    assert_eq!([-1.0, 1e39].map(|typed| set("panel spot radius", typed).radius), [0.0, 1000.0]);
    assert_eq!([-1.0, 1e39].map(|typed| set("panel spot intensity", typed).intensity), [0.0, 1e9]);
    let json = window.state().look().to_json();
    assert!(Look::from_json(&json).is_ok(), "{json}");
}

#[test]
fn what_is_typed_for_a_spot_goes_to_that_spot() {
    let mut window = baked();
    click(&mut window, "Spots");
    reach(&mut window, "Add spot to panel");
    let spots = |window: &Window| window.state().look().lights.panels["panel"].clone();
    let before = spots(&window);
    assert_eq!((before.len(), before[0].radius), (2, before[1].radius));
    let field = window.get_all_by_role_and_label(Role::SpinButton, "panel spot radius").last().unwrap().rect().center();
    window.hover_at(field);
    window.run_steps(2);
    window.drag_at(field);
    window.drop_at(field);
    window.run_steps(3);
    for key in ["0", ".", "5"] {
        window.event(Event::Text(key.into()));
        window.run_steps(2);
    }
    let pad = window.get_by_label("Spots on panel").rect();
    let [u, v] = before[0].position;
    let first = pad.min + vec2(u, v) * pad.size();
    window.hover_at(first);
    window.run_steps(2);
    // Within one frame, as where frames take long.
    for pressed in [true, false] {
        let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
        window.input_mut().events.push(Event::PointerButton { pos: first, button, pressed, modifiers });
    }
    window.run_steps(4);
    window.get_by_label("Spot 1 of 2");
    assert_eq!(spots(&window).iter().map(|spot| spot.radius).collect::<Vec<_>>(), [before[0].radius, 0.5]);
}

#[test]
fn keys_that_bake_save_and_close_wait_until_what_is_typed_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.look");
    let mut window = baked_larger();
    save_as(&mut window, "Save look…", &path);
    wait(&mut window, |_| path.exists());
    type_keys(&mut window, "lamp factor", "7");
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.run_steps(4);
    let saved = |path: &std::path::Path| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
    };
    wait(&mut window, |_| saved(&path)["lights"]["lamp"]["intensity"] == 7.0);

    type_keys(&mut window, "Width", "32");
    window.key_press_modifiers(Modifiers::COMMAND, Key::B);
    window.run_steps(4);
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    assert_eq!(window.state().session().shown.as_ref().unwrap().header.width, 32);

    type_keys(&mut window, "lamp factor", "8");
    let close = |window: &mut Window| {
        let input = window.input_mut();
        let id = input.viewport_id;
        input.viewports.entry(id).or_default().events.push(ViewportEvent::Close);
    };
    close(&mut window);
    window.step();
    let sends = |window: &Window, wanted: &ViewportCommand| {
        window.output().viewport_output.values().any(|output| output.commands.contains(wanted))
    };
    assert!(sends(&window, &ViewportCommand::CancelClose) && !sends(&window, &ViewportCommand::Close));
    window.step();
    assert!(sends(&window, &ViewportCommand::Close), "it asks again");
    assert_eq!(intensity(&window), 8.0);
    close(&mut window);
    window.run_steps(3);
    window.get_by_label("Save the look?");
}

#[test]
fn a_number_that_a_click_takes_is_a_step_of_its_own() {
    let mut window = baked();
    type_keys(&mut window, "lamp factor", "7");
    click(&mut window, "Mute panel");
    let is_muted = |window: &Window| window.state().look().lights.own_setting("panel").muted;
    assert_eq!((intensity(&window), is_muted(&window)), (7.0, true));
    click(&mut window, "Undo");
    assert_eq!((intensity(&window), is_muted(&window)), (7.0, false));
    click(&mut window, "Undo");
    assert_eq!((intensity(&window), is_muted(&window)), (1.0, false));
}

#[test]
fn numbers_of_two_lights_are_two_steps_however_soon_they_follow() {
    let mut window = baked();
    for (label, factor) in [("lamp factor", 2.0), ("lamp factor", 3.0), ("panel factor", 4.0)] {
        window.get_by_label(label).set_value_accesskit(factor);
        // Half a second, in which no state rests.
        window.run_steps(2);
    }
    let factors =
        |window: &Window| ["lamp", "panel"].map(|key| window.state().look().lights.own_setting(key).intensity);
    assert_eq!(factors(&window), [3.0, 4.0]);
    click(&mut window, "Undo");
    assert_eq!(factors(&window), [3.0, 1.0]);
    click(&mut window, "Undo");
    assert_eq!(factors(&window), [1.0, 1.0], "the same number twice is one step");
}

#[test]
fn digits_that_are_shown_count_where_they_are_typed() {
    let mut window = baked();
    type_over(&mut window, "lamp factor", "0.123456");
    let shown = window.get_by_label("lamp factor").accesskit_node().value().unwrap();
    let digits = shown.trim_end_matches('×').to_owned();
    let wanted: f32 = digits.parse().unwrap();
    assert_ne!(wanted, 0.123_456, "{shown}");
    type_over(&mut window, "lamp factor", &digits);
    assert_eq!(intensity(&window), wanted);
}

#[test]
fn escape_that_closes_the_list_of_keys_gives_up_what_is_typed_below_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = baked_larger();
    ask_for(&mut window, "Export…", &folder.path().join("room.png"));
    type_keys(&mut window, "Width of the file", "32");
    window.key_press(Key::F1);
    window.run_steps(3);
    window.get_by_label("Keyboard and mouse");
    window.key_press(Key::Escape);
    window.run_steps(4);
    assert!(window.query_by_label("Keyboard and mouse").is_none());
    window.get_by_label("Width of the file");
    assert_eq!(window.state().export_options().width_px, None);
}

#[test]
fn what_cannot_be_read_as_a_number_is_told_and_points_between_thousands_are_read() {
    let mut window = baked();
    click(&mut window, "Unit of intensities");
    click(&mut window, "lm, luminous flux");
    type_over(&mut window, "lamp lm", "1");
    let one = f64::from(intensity(&window));
    type_over(&mut window, "lamp lm", "1.500,5");
    assert!((f64::from(intensity(&window)) / one / 1500.5 - 1.0).abs() < 1e-3, "{}", intensity(&window));
    let before = intensity(&window);
    for text in ["nan", "1e30", "1.5,000"] {
        type_over(&mut window, "lamp lm", text);
        assert_eq!(intensity(&window), before, "{text}");
        let words = format!("“{text}” cannot be read as a number here; what was there stays");
        assert!(window.query_all_by_label(&words).next().is_some(), "{text}");
    }
    type_keys(&mut window, "lamp lm", "no");
    window.key_press(Key::Escape);
    window.run_steps(4);
    assert!(window.query_all_by_label_contains("“no”").next().is_none(), "given up is not refused");
}
