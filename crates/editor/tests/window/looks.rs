//! Looks in the window, driven by their labels: kept, taken over, named, put in order, and made of what the scene has.

use clerestory::app::App;
use clerestory::look::Look;
use clerestory::look::snapshot::Mark;
use clerestory::session::BakeState;
use clerestory::session::shares::sum;
use clerestory::viewport::probe::Reading;
use clerestory_transport::light::{LightRig, LightSetting};
use eframe::egui::gui_zoom::kb_shortcuts::ZOOM_IN;
use eframe::egui::{
    Event, Key, Modifiers, MouseWheelSource, MouseWheelUnit, PointerButton, Pos2, Rect, TouchPhase, vec2,
};
use egui_kittest::kittest::{NodeT, Queryable};

use crate::desk::{
    Dropped, Kept, Window, ask_for, ask_to_close, baked, baked_larger, click, drag, hints, open_again, pull,
    quit_by_key, room, save_as, type_over, wait, wait_until,
};

fn names(window: &Window) -> Vec<&str> {
    window.state().look().snapshots.iter().map(|snapshot| snapshot.name.as_str()).collect()
}

fn is_muted(window: &Window) -> bool {
    window.state().look().lights.lights.get("lamp").is_some_and(|setting| setting.muted)
}

/// The room with two looks: as it is, and without its lamp, which is on.
fn two_looks() -> Window {
    kept_twice(baked())
}

/// The same of a room that is baked already.
fn kept_twice(mut window: Window) -> Window {
    click(&mut window, "Keep look");
    click(&mut window, "Mute lamp");
    click(&mut window, "Keep look");
    assert_eq!(names(&window), ["Look", "Look 2"]);
    window
}

/// The same with both on the timeline.
fn two_keys() -> Window {
    on_the_timeline(two_looks())
}

fn on_the_timeline(mut window: Window) -> Window {
    click(&mut window, "Timeline");
    for name in ["Look", "Look 2"] {
        click(&mut window, "Add key");
        click(&mut window, name);
    }
    window
}

/// All that the strip of looks can show, in what letters of a size leave of a window of 1440 × 900 points.
fn all_of_the_strip(letters: f32) -> Window {
    let mut window = two_looks();
    for label in ["Timeline", "Compare", "Cross-fade"] {
        click(&mut window, label);
    }
    window.set_size(eframe::egui::vec2(1440.0, 900.0) / letters);
    window.run_steps(4);
    window
}

#[test]
fn at_one_and_a_half_times_the_size_everything_of_the_strip_can_be_clicked() {
    let window = all_of_the_strip(1.5);
    let edge = window.get_by_label("Metering").rect().left();
    let ends = ["Timeline", "Contact sheet…", "Save as glTF…", "Side by side", "Fade to", "Export frames…"];
    for label in ends {
        let right = window.get_by_label(label).rect().right();
        assert!(right < edge, "{label} ends at {right}, and the panel beside it begins at {edge}");
    }
}

#[test]
fn with_large_letters_the_picture_keeps_room_and_the_panels_can_go() {
    let mut window = all_of_the_strip(2.0);
    let whole = window.ctx.content_rect();
    let picture = |window: &Window| window.get_by_label("Picture").rect();
    let narrow = picture(&window);
    assert!(narrow.height() > 0.2 * whole.height() && narrow.width() > 0.5 * whole.width(), "{narrow} of {whole}");
    window.key_press(Key::H);
    window.run_steps(4);
    assert!(picture(&window).width() > 0.98 * whole.width(), "{}", picture(&window));
    let is_there = |window: &Window, label: &str| window.query_by_label(label).is_some();
    assert!(!is_there(&window, "Mute lamp") && !is_there(&window, "Timeline"));
    click(&mut window, "Picture only");
    assert!(is_there(&window, "Mute lamp") && is_there(&window, "Timeline"));
}

#[test]
fn a_narrow_window_has_room_for_one_panel_and_both_are_at_hand() {
    let mut window = all_of_the_strip(2.0);
    let seen = |window: &Window| ["Mute lamp", "Metering"].map(|label| window.query_by_label(label).is_some());
    assert_eq!(seen(&window), [true, false]);
    click(&mut window, "Settings panel");
    window.run_steps(4);
    assert_eq!(seen(&window), [false, true]);
    let picture = window.get_by_label("Picture").rect();
    assert!(picture.width() > 0.5 * window.ctx.content_rect().width(), "{picture}");
    window.key_press(Key::T);
    window.run_steps(4);
    assert_eq!(seen(&window), [true, false]);
    window.set_size(eframe::egui::vec2(1440.0, 900.0));
    window.run_steps(4);
    assert_eq!(seen(&window), [true, true]);
    window.key_press(Key::N);
    window.run_steps(4);
    assert_eq!(seen(&window), [true, false]);
    click(&mut window, "Panels");
    window.run_steps(4);
    click(&mut window, "Settings panel");
    window.run_steps(4);
    assert_eq!(seen(&window), [true, true]);
}

#[test]
fn the_list_of_keys_fits_the_window_tells_what_there_is_and_esc_closes_it() {
    let mut window = baked();
    click(&mut window, "Shortcuts");
    window.run_steps(4);
    let (title, whole) = (window.get_by_label("Keyboard and mouse").rect(), window.ctx.content_rect());
    assert!(whole.contains_rect(title), "{title} of {whole}");
    let rows = ["W A S D, Q E, with Shift", "Shift, Alt while marking", "Camera by Alt + mouse"];
    for keys in rows.into_iter().chain(["Arrow keys on colors and the sky, with Shift"]) {
        window.get_by_label(keys);
    }
    window.get_by_label_contains(&window.ctx.format_shortcut(&ZOOM_IN));
    for (key, factor) in [(Key::Plus, 1.1), (Key::Num0, 1.0), (Key::Minus, 0.9), (Key::Num0, 1.0)] {
        window.key_press_modifiers(Modifiers::COMMAND, key);
        window.run_steps(3);
        assert_eq!(window.ctx.zoom_factor(), factor);
    }
    window.key_press(Key::Escape);
    window.run_steps(4);
    assert!(window.query_by_label("Keyboard and mouse").is_none());
}

fn context_menu(window: &mut Window, card: &str, item: &str) {
    window.get_by_label(card).click_button(PointerButton::Secondary);
    window.run_steps(4);
    click(window, item);
}

#[test]
fn what_a_look_or_the_timeline_cannot_do_says_why() {
    let mut window = two_keys();
    assert!(hints(&mut window, "Back to the lights", "The lights are shown as they are now"));
    for (card, item, why) in [
        ("Look Look", "Move left", "It is the first one"),
        ("Look Look 2", "Move right", "It is the last one"),
        ("Look Look 2", "Update", "Nothing was changed since"),
    ] {
        window.get_by_label(card).click_button(PointerButton::Secondary);
        window.run_steps(4);
        assert!(hints(&mut window, item, why), "{item}");
        window.key_press(Key::Escape);
        window.run_steps(4);
    }
}

#[test]
fn a_click_brings_a_look_back_and_is_one_step_of_undo() {
    let mut window = two_looks();
    wait(&mut window, |app| app.is_settled());
    let ev = window.state().shown_ev();
    click(&mut window, "Look Look");
    assert!(!is_muted(&window));
    assert!(window.query_all_by_label_contains("The look “Look” is on").next().is_some());
    wait(&mut window, |app| app.is_settled() && (app.shown_ev() - ev).abs() > 1e-2);
    click(&mut window, "Undo");
    assert!(is_muted(&window), "one click is one step");
    assert!(window.query_by_label("The look “Look” is on").is_none(), "what was taken back is not told any more");
    window.key_press_modifiers(Modifiers::COMMAND, Key::Num1);
    window.run_steps(3);
    assert!(!is_muted(&window));
    click(&mut window, "Undo");
    assert_eq!((is_muted(&window), names(&window).len()), (true, 2), "a key is one step, too");
}

#[test]
fn a_look_that_is_on_tells_that_it_was_changed_and_can_be_updated() {
    let mut window = two_looks();
    let mark = |window: &Window, idx: usize| {
        let look = window.state().look();
        look.mark(&look.snapshots[idx])
    };
    assert_eq!((mark(&window, 0), mark(&window, 1)), (Mark::Off, Mark::On));
    click(&mut window, "Mute panel");
    assert_eq!(mark(&window, 1), Mark::Changed);
    context_menu(&mut window, "Look Look 2", "Update");
    assert_eq!(mark(&window, 1), Mark::On);
    assert!(window.state().look().snapshots[1].lights.lights["panel"].muted);
}

#[test]
fn looks_are_renamed_duplicated_put_in_order_and_deleted() {
    let mut window = two_looks();
    context_menu(&mut window, "Look Look", "Rename");
    window.get_by_label("Name of the look").focus();
    window.run_steps(2);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.get_by_label("Name of the look").type_text("Day");
    window.run_steps(2);
    window.key_press(Key::Enter);
    window.run_steps(3);
    assert_eq!(names(&window), ["Day", "Look 2"]);
    context_menu(&mut window, "Look Day", "Duplicate");
    assert_eq!(names(&window), ["Day", "Day 2", "Look 2"]);
    let (from, to) = (window.get_by_label("Look Look 2").rect().center(), window.get_by_label("Look Day").rect());
    drag(&mut window, from, to.left_center());
    assert_eq!(names(&window), ["Look 2", "Day", "Day 2"]);
    context_menu(&mut window, "Look Day 2", "Move left");
    assert_eq!(names(&window), ["Look 2", "Day 2", "Day"]);
    context_menu(&mut window, "Look Day 2", "Move right");
    assert_eq!(names(&window), ["Look 2", "Day", "Day 2"]);
    context_menu(&mut window, "Look Day 2", "Delete");
    assert_eq!(names(&window), ["Look 2", "Day"]);
    click(&mut window, "Undo");
    assert_eq!(names(&window).len(), 3);
}

/// Two clicks as quick as a double-click is.
fn double_click(window: &mut Window, at: eframe::egui::Pos2) {
    window.hover_at(at);
    window.run_steps(2);
    for pressed in [true, false, true, false] {
        let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
        // All in one frame: those of a test are long.
        window.input_mut().events.push(eframe::egui::Event::PointerButton { pos: at, button, pressed, modifiers });
    }
    window.run_steps(3);
}

#[test]
fn a_double_click_on_the_name_of_a_look_renames_it_and_leaves_the_lights() {
    let mut window = two_looks();
    click(&mut window, "Mute panel");
    let look = window.state().look().clone();
    for name in ["Look Look 2", "Look Look"] {
        let card = window.get_by_label(name).rect();
        double_click(&mut window, card.left_bottom() + eframe::egui::vec2(20.0, -8.0));
        window.get_by_label("Name of the look");
        assert_eq!(*window.state().look(), look, "{name}");
        window.key_press(Key::Escape);
        window.run_steps(3);
    }
    let picture = window.get_by_label("Look Look").rect().center_top() + eframe::egui::vec2(0.0, 20.0);
    double_click(&mut window, picture);
    assert!(window.query_by_label("Name of the look").is_none());
    assert!(!is_muted(&window), "the picture is taken");
}

#[test]
fn a_look_that_is_compared_or_faded_may_be_renamed() {
    let mut window = two_looks();
    click(&mut window, "Compare");
    click(&mut window, "Cross-fade");
    for (card, name) in [("Look Look", "Day"), ("Look Look 2", "Night")] {
        context_menu(&mut window, card, "Rename");
        crate::desk::type_over(&mut window, "Name of the look", name);
    }
    assert_eq!(names(&window), ["Day", "Night"]);
    let chosen = |label: &str| window.get_by_label(label).accesskit_node().value().unwrap_or_default();
    assert_eq!(["Left look", "Right look"].map(chosen), ["Day", "Now"]);
    assert_eq!(["Fade from", "Fade to"].map(chosen), ["Night", "Day"]);
}

#[test]
fn a_look_is_compared_with_now_from_its_menu() {
    let mut window = two_looks();
    let chosen = |window: &Window| {
        ["Left look", "Right look"].map(|label| window.get_by_label(label).accesskit_node().value().unwrap_or_default())
    };
    context_menu(&mut window, "Look Look", "Compare with now");
    assert_eq!(chosen(&window), ["Look", "Now"]);
    click(&mut window, "Side by side");
    context_menu(&mut window, "Look Look 2", "Compare with now");
    assert_eq!(chosen(&window), ["Look 2", "Now"]);
    let is_side_by_side = window.get_by_label("Side by side").accesskit_node().toggled();
    assert_ne!(is_side_by_side, window.get_by_label("Wipe").accesskit_node().toggled(), "the way stays");
}

#[test]
fn what_is_compared_and_faded_goes_on_when_a_name_is_taken_back() {
    let mut window = two_looks();
    click(&mut window, "Compare");
    click(&mut window, "Cross-fade");
    context_menu(&mut window, "Look Look", "Rename");
    crate::desk::type_over(&mut window, "Name of the look", "Day");
    for (step, name) in [("Undo", "Look"), ("Redo", "Day"), ("Undo", "Look")] {
        click(&mut window, step);
        assert_eq!(names(&window), [name, "Look 2"], "{step}");
        let chosen = |label: &str| window.get_by_label(label).accesskit_node().value().unwrap_or_default();
        assert_eq!(["Left look", "Right look"].map(chosen), [name, "Now"], "{step}");
        assert_eq!(["Fade from", "Fade to"].map(chosen), ["Look 2", name], "{step}");
    }
}

#[test]
fn a_look_with_a_file_is_saved_at_once_or_as_another() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second] = ["first.look", "second.look"].map(|name| folder.path().join(name));
    let mut window = baked();
    assert!(window.query_by_label("Save look as…").is_none());
    save_as(&mut window, "Save look…", &first);
    assert!(first.exists() && window.query_by_label("Save look…").is_none());
    click(&mut window, "Mute lamp");
    click(&mut window, "Save look");
    assert!(window.query_by_label("Path").is_none(), "it has a file");
    assert!(std::fs::read_to_string(&first).unwrap().contains("muted"));
    click(&mut window, "Mute lamp");
    save_as(&mut window, "Save look as…", &second);
    assert!(std::fs::read_to_string(&first).unwrap().contains("muted"));
    assert!(!std::fs::read_to_string(&second).unwrap().contains("muted"));
    // Looks are recent files as scenes are.
    click(&mut window, "Recent");
    click(&mut window, "first.look");
    wait(&mut window, |app| app.look().lights.lights.get("lamp").is_some_and(|setting| setting.muted));
}

#[test]
fn a_look_whose_folder_is_gone_is_asked_for_another_place() {
    let folder = tempfile::tempdir().unwrap();
    let (gone, other) = (folder.path().join("gone"), folder.path().join("b.look"));
    std::fs::create_dir(&gone).unwrap();
    let mut window = baked();
    save_as(&mut window, "Save look…", &gone.join("a.look"));
    std::fs::remove_dir_all(&gone).unwrap();
    click(&mut window, "Mute lamp");
    click(&mut window, "Save look");
    window.get_by_label("Path").set_text_value_accesskit(&other.display().to_string());
    window.run_steps(3);
    click(&mut window, "Save");
    assert!(other.exists());
}

#[test]
fn looks_of_a_file_come_behind_those_that_there_are() {
    let folder = tempfile::tempdir().unwrap();
    let (file, mut other) = (folder.path().join("evening.look"), Look::default());
    other.keep("Look");
    other.lights.lights.insert("panel".into(), LightSetting { muted: true, ..LightSetting::default() });
    other.save(&file).unwrap();
    let mut window = two_looks();
    let before = window.state().look().clone();
    click(&mut window, "Presets");
    ask_for(&mut window, "Looks of a file…", &file);
    click(&mut window, "Open");
    wait(&mut window, |app| app.look().snapshots.len() == 4);
    assert_eq!(names(&window), ["Look", "Look 2", "Look 3", "evening"]);
    let look = window.state().look();
    assert_eq!((&look.lights, &look.on), (&before.lights, &before.on), "the lights stay as they are");
    assert!(look.snapshots[3].lights.lights["panel"].muted);
    click(&mut window, "Undo");
    assert_eq!(*window.state().look(), before, "one step");
}

#[test]
fn a_look_that_is_opened_first_goes_with_the_scene_that_was_open_last() {
    let folder = tempfile::tempdir().unwrap();
    let [scene, file] = ["room.gltf", "evening.look"].map(|name| folder.path().join(name));
    std::fs::write(&scene, room()).unwrap();
    let mut look = Look::default();
    look.lights.lights.insert("panel".into(), LightSetting { muted: true, ..LightSetting::default() });
    look.save(&file).unwrap();
    let mut window = open_again(&scene, Kept::default());
    wait(&mut window, |app| app.session().bake == BakeState::Done);
    let kept = Kept::by(&mut window);
    drop(window);
    let mut window = open_again(&file, kept);
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.look().lights.lights.contains_key("panel"));
    assert!(window.state().look().lights.lights["panel"].muted);
    window.get_by_label("Mute panel");
}

#[test]
fn a_document_that_is_full_of_looks_takes_no_more() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("full.look");
    let looks: Vec<_> = (1..=500).map(|nth| serde_json::json!({ "name": format!("L{nth}") })).collect();
    std::fs::write(&path, serde_json::json!({ "clerestory": 1, "looks": looks }).to_string()).unwrap();
    let mut window = baked();
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(path)));
    wait(&mut window, |app| app.look().snapshots.len() == 500);
    let is_full = |window: &Window| window.get_by_label("Keep look").accesskit_node().is_disabled();
    assert!(is_full(&window), "a file with more could not be opened");
    context_menu(&mut window, "Look L1", "Delete");
    assert!(!is_full(&window));
}

#[test]
fn a_look_that_is_kept_is_seen_however_many_there_are() {
    let mut window = baked();
    for _ in 0..14 {
        click(&mut window, "Keep look");
    }
    window.run_steps(20);
    let (card, edge) = (area_of(&window, "Look Look 14"), area_of(&window, "Metering").left());
    assert!(card.right() < edge, "{card} ends behind {edge}");
}

#[test]
fn presets_are_made_of_the_lights_of_the_scene() {
    let mut window = baked();
    click(&mut window, "Presets");
    assert!(hints(&mut window, "Night", "Warm lamps, hardly anything from outside"));
    window.key_press(Key::Escape);
    window.run_steps(4);
    click(&mut window, "Presets");
    click(&mut window, "All four");
    assert_eq!(names(&window), ["Day", "Dusk", "Night", "Exhibition"]);
    assert_eq!(window.state().look().on.as_deref(), Some("Day"));
    click(&mut window, "Look Night");
    let look = window.state().look();
    assert!(look.lights.lights["lamp"].kelvin.unwrap() < 3000.0, "{:?}", look.lights);
    let on = window.get_by_label("Look Night").accesskit_node().toggled();
    assert_ne!(on, window.get_by_label("Look Day").accesskit_node().toggled());
    click(&mut window, "Undo");
    click(&mut window, "Undo");
    assert!(names(&window).is_empty(), "all four are one step");
}

#[test]
fn two_looks_are_compared_and_the_divider_is_dragged() {
    let mut window = two_looks();
    click(&mut window, "Compare");
    window.get_by_label("Left look");
    // The first side is a look that is not on, which the printer makes at full size.
    wait(&mut window, |app| app.is_settled());
    window.run_steps(4);
    // Who does not see them is told which look is on which side.
    window.get_by_label("On the left: Look");
    window.get_by_label("On the right: Now");
    let divider = window.get_by_label("Compare divider").rect();
    let picture = window.get_by_label("Picture").rect();
    assert!((divider.center().x - picture.center().x).abs() < 2.0, "{divider} {picture}");
    let look = window.state().look().clone();
    drag(&mut window, divider.center(), divider.center() + eframe::egui::vec2(90.0, 0.0));
    let moved = window.get_by_label("Compare divider").rect();
    assert!((moved.center().x - divider.center().x - 90.0).abs() < 6.0, "{moved}");
    assert_eq!(*window.state().look(), look, "nothing of it is part of the look");
    click(&mut window, "Side by side");
    window.run_steps(3);
    assert!(window.query_by_label("Compare divider").is_none());
    assert!(window.get_by_label("Picture").rect().width() < 0.6 * picture.width());
    click(&mut window, "Compare");
    assert_eq!(window.get_by_label("Picture").rect().width(), picture.width());
}

/// What is told under the pointer: the side where two are compared, the pixel, and what is read there.
fn told(window: &mut Window, at: Pos2) -> Vec<String> {
    window.hover_at(at);
    window.run_steps(6);
    let words = window.get_by_label_contains("cd/m²").accesskit_node().value().unwrap();
    words.split("   ").map(str::to_owned).collect()
}

/// What a pixel, `x, y`, reads under some lights.
fn reading(window: &Window, rig: &LightRig, pixel: &str) -> String {
    let (x, y) = pixel.split_once(", ").unwrap();
    let px: [u32; 2] = [x.parse().unwrap(), y.parse().unwrap()];
    let shown = window.state().session().shown.as_ref().unwrap();
    let shares = shown.shares(rig, None, &[px[1] * shown.header.width + px[0]]).unwrap();
    Reading { px, radiance: sum(&shares), lux: None, unit: "cd/m²" }.words()
}

fn area_of(window: &Window, label: &str) -> Rect {
    window.get_by_label(label).rect()
}

/// Clicks in the picture, so often in one frame.
fn click_in_picture(window: &mut Window, at: Pos2, times: usize) {
    window.hover_at(at);
    window.run_steps(2);
    for pressed in [true, false].repeat(times) {
        let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
        window.input_mut().events.push(Event::PointerButton { pos: at, button, pressed, modifiers });
    }
    window.run_steps(6);
}

fn come_nearer(window: &mut Window, at: Pos2) {
    window.hover_at(at);
    window.run_steps(2);
    let (unit, phase, source) = (MouseWheelUnit::Point, TouchPhase::Move, MouseWheelSource::Unknown);
    let (delta, modifiers) = (vec2(0.0, 100.0), Modifiers::NONE);
    window.event(Event::MouseWheel { unit, delta, phase, source, modifiers });
    window.run_steps(8);
}

/// Compares, once both pictures are there.
fn compare(window: &mut Window) {
    click(window, "Compare");
    wait(window, |app| app.is_settled());
    window.run_steps(4);
}

#[test]
fn each_side_of_a_comparison_in_false_color_has_a_scale_of_its_own() {
    let mut window = baked();
    click(&mut window, "False color");
    click(&mut window, "Luminance");
    wait(&mut window, |app| app.is_settled());
    click(&mut window, "Fit range");
    type_over(&mut window, "Scale to", "777");
    click(&mut window, "Keep look");
    type_over(&mut window, "Scale to", "5000");
    compare(&mut window);
    let scale_to = |window: &Window, high: &str| {
        let end = format!(" to {high} cd/m²");
        let mut scales = window.query_all_by_label_contains("Scale of luminance");
        let is_it = |words: String| words.ends_with(&end);
        scales.find(|scale| scale.accesskit_node().label().is_some_and(is_it)).unwrap().rect()
    };
    let divider = area_of(&window, "Compare divider").center();
    assert!(scale_to(&window, "777").right() < divider.x && scale_to(&window, "5000").left() > divider.x);
    click(&mut window, "Side by side");
    for (picture, high) in [("Picture", "777"), ("Picture on the right", "5000")] {
        let (area, scale) = (area_of(&window, picture), scale_to(&window, high));
        assert!(area.contains_rect(scale), "{scale} in {area}");
    }
}

#[test]
fn what_is_read_in_a_comparison_is_of_the_side_under_the_pointer() {
    let mut window = kept_twice(baked_larger());
    compare(&mut window);
    let middle = area_of(&window, "Picture").center();
    let places = [middle + vec2(-170.0, 90.0), middle + vec2(170.0, 90.0)];
    let rigs = {
        let look = window.state().look();
        [look.snapshots[0].lights.clone(), look.lights.clone()]
    };
    for ((at, name), (rig, other)) in places.iter().zip(["Look", "Now"]).zip([(0, 1), (1, 0)]) {
        let told = told(&mut window, *at);
        let expected = [rig, other].map(|rig| reading(&window, &rigs[rig], &told[1]));
        assert_eq!((told[0].as_str(), &told[2]), (name, &expected[0]));
        assert_ne!(expected[0], expected[1]);
    }

    // Who lights a place is told of the same side.
    let n_of_lamp = |window: &Window| {
        window
            .query_all_by_label_contains("lamp ")
            .filter(|row| {
                row.accesskit_node().label().is_some_and(|words| words.starts_with("lamp ") && words.contains('%'))
            })
            .count()
    };
    click_in_picture(&mut window, places[0], 1);
    assert_eq!(n_of_lamp(&window), 1);
    click_in_picture(&mut window, places[1], 1);
    assert_eq!(n_of_lamp(&window), 0, "it is off now");
    window.key_press(Key::Escape);
    window.run_steps(3);

    // One beside the other has both, of one and the same pixel; so has a probe that stays.
    click(&mut window, "Side by side");
    let sides = ["Picture", "Picture on the right"].map(|label| area_of(&window, label).center() + vec2(30.0, 60.0));
    let both = sides.map(|at| told(&mut window, at));
    assert!(both[0][1] == both[1][1] && both[0][2] != both[1][2], "{both:?}");
    assert_eq!([&both[0][0], &both[1][0]], ["Look", "Now"]);
    window.key_press(Key::P);
    window.run_steps(4);
    window.hover_at(Pos2::new(5.0, 5.0));
    window.run_steps(3);
    for words in both {
        window.get_by_label(&format!("Probe 1, {}, {}", words[0], words[2]));
    }
}

#[test]
fn a_solo_counts_on_both_sides_of_a_comparison() {
    let mut window = kept_twice(baked_larger());
    click(&mut window, "Solo panel");
    compare(&mut window);
    click(&mut window, "Side by side");
    let sides = ["Picture", "Picture on the right"].map(|label| area_of(&window, label).center() + vec2(30.0, 60.0));
    let both = sides.map(|at| told(&mut window, at));
    assert_eq!(both[0][1..], both[1][1..], "the looks differ by a lamp that is not heard");
}

#[test]
fn a_lamp_that_one_side_alone_has_is_counted_there() {
    let mut window = baked_larger();
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    wait(&mut window, |app| app.is_settled());
    click(&mut window, "Keep look");
    window.key_press(Key::Delete);
    window.run_steps(3);
    assert!(window.state().look().lights.lamps.is_empty());
    compare(&mut window);
    click(&mut window, "Side by side");
    let sides = ["Picture", "Picture on the right"].map(|label| area_of(&window, label).center() + vec2(20.0, 30.0));
    let read = sides.map(|at| told(&mut window, at)[2].split(' ').next().unwrap().parse::<f32>().unwrap());
    assert!(read[0] > 1.5 * read[1] && read[1] > 0.0, "{read:?}");
    click_in_picture(&mut window, sides[0], 1);
    for light in ["panel ", "Point lamp 1 "] {
        let is_share = |row: &egui_kittest::Node<'_>| row.accesskit_node().label().is_some_and(|of| of.contains('%'));
        window.query_all_by_label_contains(light).find(is_share).expect("it has a share").click();
        window.run_steps(3);
        assert_eq!(window.state().chosen_light(), Some("panel"), "{light}: the lamp is not among the lights now");
    }
}

#[test]
fn lights_have_handles_on_the_side_that_shows_them_as_they_are() {
    const HANDLE: &str = "Move Point lamp 1 along X";
    let mut window = baked();
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    wait(&mut window, |app| app.is_settled());
    click(&mut window, "Keep look");
    compare(&mut window);
    // The lamp hangs in the middle, and the lights as they are now are right of the divider.
    for (travel, is_there) in [(-150.0, true), (300.0, false), (-300.0, true)] {
        let divider = area_of(&window, "Compare divider").center();
        drag(&mut window, divider, divider + vec2(travel, 0.0));
        assert_eq!(window.query_by_label(HANDLE).is_some(), is_there, "the divider went by {travel}");
    }

    click(&mut window, "Side by side");
    let is_in = |window: &Window, picture: &str| area_of(window, picture).contains(area_of(window, HANDLE).center());
    assert!(is_in(&window, "Picture on the right"));
    let place = |window: &Window| {
        let look = window.state().look();
        [&look.lights, &look.snapshots[0].lights].map(|rig| rig.lamps[0].position)
    };
    let [before, kept] = place(&window);
    let from = area_of(&window, HANDLE).center();
    drag(&mut window, from, from + vec2(40.0, 0.0));
    let [after, still] = place(&window);
    assert!(after.x > before.x + 0.02 && still == kept, "{before} {after}");
    click(&mut window, "Undo");
    assert_eq!(place(&window), [before, kept], "one step");

    let choose = |window: &mut Window, side: &str, look: &str| {
        click(window, side);
        click(window, look);
        wait(window, |app| app.is_settled());
        window.run_steps(4);
    };
    choose(&mut window, "Left look", "Now");
    choose(&mut window, "Right look", "Look");
    assert!(is_in(&window, "Picture"));
    choose(&mut window, "Left look", "Look");
    assert!(window.query_by_label(HANDLE).is_none(), "what was kept is not what is dragged");
}

#[test]
fn the_picture_on_the_right_is_zoomed_and_moved_as_that_on_the_left() {
    let mut window = kept_twice(baked_larger());
    compare(&mut window);
    click(&mut window, "Side by side");
    let [left, right] = ["Picture", "Picture on the right"].map(|label| area_of(&window, label).center());
    let offset = vec2(70.0, 50.0);
    let (held, other) = (told(&mut window, right + offset), told(&mut window, left - offset));
    come_nearer(&mut window, right + offset);
    assert_eq!(told(&mut window, right + offset), held, "what is under the pointer stays there");
    assert_eq!(told(&mut window, left + offset)[1], held[1], "in both");
    let nearer = told(&mut window, left - offset);
    assert_ne!(nearer[1], other[1]);
    drag(&mut window, right, right + vec2(60.0, 0.0));
    let [moved, beside] = [left, right].map(|middle| told(&mut window, middle - offset)[1].clone());
    assert!(moved != nearer[1] && moved == beside, "a drag moves both: {moved} {beside}");
    click_in_picture(&mut window, right, 2);
    assert_eq!(told(&mut window, left - offset), other, "a double-click shows all of it");
}

#[test]
fn the_second_button_moves_no_key_of_the_timeline() {
    let mut window = two_keys();
    let before = window.state().look().timeline.clone();
    let at = window.query_all_by_label_contains("Key 2: Look 2 at").next().unwrap().rect().center();
    let button = |window: &mut Window, pos: Pos2, pressed: bool| {
        let (button, modifiers) = (PointerButton::Secondary, Modifiers::NONE);
        window.input_mut().events.push(Event::PointerButton { pos, button, pressed, modifiers });
        window.run_steps(2);
    };
    window.hover_at(at);
    window.run_steps(2);
    button(&mut window, at, true);
    for x in [10.0, 20.0, 40.0] {
        window.hover_at(at - vec2(x, 0.0));
        window.run_steps(2);
    }
    button(&mut window, at - vec2(40.0, 0.0), false);
    assert_eq!(window.state().look().timeline, before);
}

#[test]
fn the_looks_for_a_key_are_scrolled_to_what_the_keyboard_comes_to() {
    let mut window = baked();
    for _ in 0..20 {
        click(&mut window, "Keep look");
    }
    click(&mut window, "Timeline");
    click(&mut window, "Add key");
    let bottom = |window: &Window| area_of(window, "Look 20").bottom();
    let before = bottom(&window);
    window.get_by_label("Look 20").focus();
    window.run_steps(12);
    assert!(bottom(&window) < before - 50.0, "{} was {before}", bottom(&window));
}

#[test]
fn esc_puts_back_a_key_of_the_timeline_or_a_look_that_is_dragged() {
    let mut window = two_keys();
    let before = window.state().look().clone();
    let key = window.query_all_by_label_contains("Key 2: Look 2 at").next().unwrap().rect().center();
    let [second, first] = ["Look Look 2", "Look Look"].map(|card| area_of(&window, card));
    for (from, to, is_key) in [(key, key - vec2(200.0, 0.0), true), (second.center(), first.left_center(), false)] {
        pull(&mut window, from, to);
        assert_eq!(*window.state().look() != before, is_key, "a look goes where it is dropped");
        window.key_press(Key::Escape);
        window.run_steps(2);
        window.drop_at(to);
        window.run_steps(3);
        assert_eq!(*window.state().look(), before, "{is_key}");
    }
}

#[test]
fn a_look_that_is_dragged_and_every_other_one_stay_where_a_step_is_undone() {
    let mut window = two_looks();
    click(&mut window, "Keep look");
    context_menu(&mut window, "Look Look", "Delete");
    assert_eq!(names(&window), ["Look 2", "Look 3"]);
    let [last, first] = ["Look Look 3", "Look Look 2"].map(|card| area_of(&window, card));
    pull(&mut window, last.center(), first.left_center());
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.run_steps(4);
    let undone = window.state().look().clone();
    assert_eq!(undone.snapshots[0].name, "Look");
    window.drop_at(first.left_center());
    window.run_steps(3);
    assert_eq!(*window.state().look(), undone);
}

#[test]
fn a_drag_is_over_where_its_button_comes_up_while_the_panels_are_hidden() {
    let mut window = two_keys();
    let key = window.query_all_by_label_contains("Key 2: Look 2 at").next().unwrap().rect().center();
    let [second, first] = ["Look Look 2", "Look Look"].map(|card| area_of(&window, card));
    for (from, to) in [(key, key - vec2(200.0, 0.0)), (second.center(), first.left_center())] {
        pull(&mut window, from, to);
        let look = window.state().look().clone();
        window.key_press(Key::H);
        window.run_steps(3);
        window.drop_at(to);
        window.run_steps(3);
        for key in [Key::H, Key::Escape] {
            window.key_press(key);
            window.run_steps(3);
        }
        assert_eq!(*window.state().look(), look);
    }
}

#[test]
fn a_double_click_shows_the_whole_picture_where_no_light_can_be_dragged() {
    let mut window = two_keys();
    wait(&mut window, |app| app.is_settled());
    let track = area_of(&window, "Timeline ruler");
    drag(&mut window, track.left_top() + vec2(60.0, 8.0), track.left_top() + vec2(12.0, 8.0));
    wait(&mut window, |app| app.is_settled());
    let middle = area_of(&window, "Picture").center();
    let at = middle + vec2(-150.0, 40.0);
    let whole = told(&mut window, at)[0].clone();
    come_nearer(&mut window, middle);
    assert_ne!(told(&mut window, at)[0], whole);
    click_in_picture(&mut window, middle, 2);
    assert_eq!(told(&mut window, at)[0], whole);
}

#[test]
fn arrow_keys_move_the_divider_for_as_long_as_it_has_the_focus() {
    let mut window = two_looks();
    compare(&mut window);
    let x = |window: &Window| area_of(window, "Compare divider").center().x;
    let before = x(&window);
    window.get_by_label("Compare divider").focus();
    window.run_steps(2);
    let mut at = vec![before];
    for key in [Key::ArrowRight, Key::ArrowRight, Key::ArrowRight, Key::ArrowLeft] {
        window.key_press(key);
        window.run_steps(2);
        at.push(x(&window));
    }
    let step = at[1] - at[0];
    assert!(step > 2.0 && (at[3] - at[0] - 3.0 * step).abs() < 0.5 && (at[4] - at[2]).abs() < 0.5, "{at:?}");
}

#[test]
fn a_cross_fade_lights_the_scene_and_is_one_step_of_undo() {
    let mut window = two_looks();
    click(&mut window, "Look Look");
    click(&mut window, "Cross-fade");
    let before = window.state().look().clone();
    let slider = window.get_by_label("Share of the second look").rect();
    drag(&mut window, slider.left_center() + eframe::egui::vec2(5.0, 0.0), slider.center());
    let level = window.state().look().lights.lights["lamp"].intensity;
    assert!(level > 0.05 && level < 0.95, "{level}");
    click(&mut window, "Keep look");
    assert_eq!(names(&window).len(), 3);
    click(&mut window, "Undo");
    click(&mut window, "Undo");
    assert_eq!(window.state().look().lights, before.lights, "one drag is one step");
    let share = |window: &Window| window.get_by_label("Share of the second look").accesskit_node().numeric_value();
    assert_eq!(share(&window), Some(0.0), "the first look is on again");
    click(&mut window, "Look Look 2");
    assert_eq!(share(&window), Some(1.0));
}

#[test]
fn the_timeline_is_shown_played_and_written_without_an_edit() {
    let mut window = on_the_timeline(kept_twice(baked_larger()));
    assert_eq!(window.state().look().timeline.end_secs(), 2.0);
    wait(&mut window, |app| app.is_settled());
    let (look, ev_dark) = (window.state().look().clone(), window.state().shown_ev());
    // The start of the ruler is the first look, which is brighter than the present one.
    let track = window.get_by_label("Timeline ruler").rect();
    drag(
        &mut window,
        track.left_top() + eframe::egui::vec2(60.0, 8.0),
        track.left_top() + eframe::egui::vec2(12.0, 8.0),
    );
    wait(&mut window, |app| app.is_settled() && (app.shown_ev() - ev_dark).abs() > 1e-2);
    window.get_by_label_contains("0.00 s, frame 0");
    for (modifiers, key, words) in [
        (Modifiers::NONE, Key::ArrowRight, "0.04 s, frame 1"),
        (Modifiers::SHIFT, Key::ArrowRight, "0.46 s, frame 11"),
        (Modifiers::NONE, Key::ArrowLeft, "0.42 s, frame 10"),
        (Modifiers::SHIFT, Key::ArrowLeft, "0.00 s, frame 0"),
    ] {
        window.key_press_modifiers(modifiers, key);
        window.run_steps(3);
        window.get_by_label(words);
    }
    // Shift that is let go in the frame of its arrow counts; that of the next arrow is no longer held.
    for modifiers in [Modifiers::SHIFT, Modifiers::NONE] {
        let (key, pressed, repeat) = (Key::ArrowRight, true, false);
        let event = eframe::egui::Event::Key { key, physical_key: None, pressed, repeat, modifiers };
        window.input_mut().events.push(event);
    }
    window.run_steps(3);
    window.get_by_label("0.46 s, frame 11");
    window.key_press_modifiers(Modifiers::SHIFT, Key::ArrowLeft);
    window.key_press(Key::ArrowLeft);
    window.run_steps(3);
    assert_eq!(*window.state().look(), look, "looking is no edit");
    click(&mut window, "Play the timeline");
    wait(&mut window, |app| app.is_settled() && (app.shown_ev() - ev_dark).abs() < 1e-3);
    click(&mut window, "Back to the lights");

    let folder = tempfile::tempdir().unwrap();
    save_as(&mut window, "Export frames…", &folder.path().join("f_###.png"));
    wait(&mut window, |app| app.session().frames().is_none() && folder.path().join("f_048.png").exists());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 49);
    // Frames are as large as a single picture would be, and the same part; what is there is told before it is replaced.
    ask_for(&mut window, "Export…", &folder.path().join("one.png"));
    window.get_by_label("Width of the file").set_value_accesskit(32.0);
    window.run_steps(3);
    click(&mut window, "Region");
    window.get_by_label("Region left").set_value_accesskit(20.0);
    window.run_steps(3);
    click(&mut window, "Cancel");
    ask_for(&mut window, "Export frames…", &folder.path().join("f_###.png"));
    assert!(window.query_by_label_contains("saving replaces them").is_none(), "nothing is replaced unasked");
    window.get_by_label("49 at 24 fps");
    window.get_by_label("First frame").set_value_accesskit(40.0);
    window.run_steps(3);
    window.get_by_label("9 at 24 fps");
    window.get_by_label("Path").set_text_value_accesskit(&folder.path().join("f.png").display().to_string());
    window.run_steps(3);
    window.get_by_label_contains("write # for the digits");
    window.get_by_label("Path").set_text_value_accesskit(&folder.path().join("g_##.png").display().to_string());
    window.run_steps(3);
    window.get_by_label_contains("does not lie within the picture of 32 × 24");
    assert!(window.get_by_label("Save").accesskit_node().is_disabled());
    window.get_by_label("Region width").set_value_accesskit(12.0);
    window.run_steps(3);
    click(&mut window, "Save");
    wait(&mut window, |app| app.session().frames().is_none() && folder.path().join("g_48.png").exists());
    assert!(folder.path().join("g_40.png").exists() && !folder.path().join("g_39.png").exists());
    let [part, whole] = ["g_48.png", "f_048.png"].map(|name| image::open(folder.path().join(name)).unwrap().to_rgb8());
    assert_eq!((part.dimensions(), whole.dimensions()), ((12, 24), (64, 48)));
    // Of the picture of half the size, the twelve columns at its right.
    let mean =
        |x: u32, y: u32| (0..4).map(|i| f32::from(whole.get_pixel(2 * x + i % 2, 2 * y + i / 2)[1])).sum::<f32>() / 4.0;
    let off = |left: u32| {
        let pixels = (0..12 * 24).map(|i| (i % 12, i / 12));
        pixels.map(|(x, y)| (mean(left + x, y) - f32::from(part.get_pixel(x, y)[1])).abs()).sum::<f32>()
    };
    assert!(off(20) < 0.5 * off(0), "{} {}", off(20), off(0));
    replace_frames(&mut window, &folder.path().join("g_##.png"));
}

/// Exports frames that are there: they are replaced only once somebody says so.
fn replace_frames(window: &mut Window, path: &std::path::Path) {
    for answer in ["Choose another name", "Replace"] {
        if window.query_by_label("Path").is_none() {
            click(window, "Export frames…");
        }
        window.get_by_label("Path").set_text_value_accesskit(&path.display().to_string());
        window.run_steps(3);
        window.get_by_label("Files of these names are there; saving asks whether to replace them");
        click(window, "Save");
        window.get_by_label_contains("Files named g_##.png are there");
        click(window, answer);
    }
    wait(window, |app| app.session().frames().is_none());
}

#[test]
fn the_look_of_a_key_is_another_one_once_it_is_chosen() {
    let mut window = two_keys();
    wait(&mut window, |app| app.is_settled());
    let (look, ev_dark) = (window.state().look().clone(), window.state().shown_ev());
    let looks_of_keys =
        |look: &Look| look.timeline.keys.iter().map(|key| (key.secs, key.look.clone())).collect::<Vec<_>>();
    let with = |second: &str| vec![(0.0f32, "Look".to_owned()), (2.0, second.to_owned())];
    assert_eq!(looks_of_keys(&look), with("Look 2"));
    // The moment of the second key, whose look is without the lamp.
    let track = area_of(&window, "Timeline ruler");
    let at = track.left_top() + vec2(12.0 + 0.4 * (track.width() - 24.0), 8.0);
    drag(&mut window, at - vec2(30.0, 0.0), at);
    window.get_by_label("2.00 s, frame 48");
    window.query_all_by_label_contains("Key 2: Look 2 at").next().unwrap().click();
    window.run_steps(3);
    wait(&mut window, |app| app.is_settled() && (app.shown_ev() - ev_dark).abs() < 1e-3);

    click(&mut window, "Look of the key");
    click(&mut window, "Look");
    assert_eq!(looks_of_keys(window.state().look()), with("Look"));
    assert!(window.query_all_by_label_contains("Key 2: Look at").next().is_some());
    window.get_by_label("2.00 s, frame 48");
    wait(&mut window, |app| app.is_settled() && (app.shown_ev() - ev_dark).abs() > 1e-2);
    assert_eq!(window.state().look().lights, look.lights, "the lights stay");
    click(&mut window, "Undo");
    assert_eq!(looks_of_keys(window.state().look()), with("Look 2"), "one step");
}

#[test]
fn a_timeline_that_loops_begins_again_at_its_end() {
    let mut window = two_keys();
    let frame = |window: &Window| -> Option<u32> {
        let told = window.query_by_label_contains(" s, frame ")?.accesskit_node().value()?;
        told.rsplit(' ').next()?.parse().ok()
    };
    click(&mut window, "Loop");
    click(&mut window, "Play the timeline");
    wait_until(&mut window, |window| frame(window).is_some_and(|frame| frame > 30));
    wait_until(&mut window, |window| frame(window).is_some_and(|frame| frame < 30));
    click(&mut window, "Play the timeline");
    let paused = frame(&window);
    window.run_steps(8);
    assert_eq!(frame(&window), paused);
}

#[test]
fn a_timeline_of_too_many_frames_is_asked_for_in_parts() {
    let mut window = two_keys();
    window.get_by_label("Time of the key").set_value_accesskit(86_400.0);
    window.run_steps(3);
    click(&mut window, "Export frames…");
    window.get_by_label_contains("ask for fewer");
    window.get_by_label("Last frame").set_value_accesskit(10.0);
    window.run_steps(3);
    assert!(window.query_by_label_contains("ask for fewer").is_none());
    window.get_by_label("11 at 24 fps");
}

#[test]
fn frames_that_end_early_say_which_one_did_it_what_is_there_and_what_helps() {
    let mut window = two_keys();
    let folder = tempfile::tempdir().unwrap();
    // What is in the way of a later frame is found once the dialog is gone.
    std::fs::create_dir(folder.path().join("f_02.png")).unwrap();
    save_as(&mut window, "Export frames…", &folder.path().join("f_##.png"));
    click(&mut window, "Replace");
    wait_until(&mut window, |window| window.query_by_label_contains("frame 2 stopped the sequence").is_some());
    window.get_by_label_contains("frame 2 stopped the sequence, with 2 saved: cannot write");
    window.get_by_label_contains("it is a folder");
}

#[test]
fn a_moment_is_taken_over_as_the_way_to_the_next_key_has_it_and_frames_are_cancelled() {
    let mut window = two_keys();
    let take_over = |window: &mut Window| {
        let track = window.get_by_label("Timeline ruler").rect();
        let at = track.left_top() + eframe::egui::vec2(12.0 + 0.2 * (track.width() - 24.0), 8.0);
        drag(window, at - eframe::egui::vec2(30.0, 0.0), at);
        window.get_by_label("1.00 s, frame 24");
        click(window, "Take over");
        assert!(window.query_by_label("Take over").is_none(), "the present look is seen again");
        let look = window.state().look();
        assert_eq!(look.on, None);
        look.lights.own_setting("lamp")
    };
    let half_way = take_over(&mut window);
    assert!((half_way.intensity - 0.5).abs() < 0.05 && !half_way.muted, "{half_way:?}");
    click(&mut window, "Undo");
    assert!(is_muted(&window), "one step");
    let first = window.query_all_by_label_contains("Key 1: Look at").next().unwrap();
    first.click();
    window.run_steps(3);
    click(&mut window, "Way to the next key");
    click(&mut window, "Hold");
    let held = take_over(&mut window);
    assert!(held.intensity == 1.0 && !held.muted, "the first look until the next key: {held:?}");

    window.get_by_label("Frames per second").set_value_accesskit(240.0);
    window.get_by_label("Time of the key").set_value_accesskit(120.0);
    window.run_steps(3);
    let folder = tempfile::tempdir().unwrap();
    save_as(&mut window, "Export frames…", &folder.path().join("f_#####.png"));
    wait(&mut window, |app| app.session().frames().is_some_and(|(n_written, n)| n_written > 0 && n > 20_000));
    click(&mut window, "Cancel the frames");
    assert!(window.state().session().frames().is_none());
    window.get_by_label("Export frames…");
    let mut counts = (0..100).map(|_| {
        std::thread::sleep(std::time::Duration::from_millis(100));
        std::fs::read_dir(folder.path()).unwrap().count()
    });
    let mut before = 0;
    let is_still = counts.any(|n| std::mem::replace(&mut before, n) == n);
    assert!(is_still && before > 0, "{before} files, and more of them still come");
}

/// Frames of two minutes that are being written, more than any test waits for.
fn writing_for_long() -> (Window, tempfile::TempDir) {
    let mut window = on_the_timeline(kept_twice(baked_larger()));
    window.get_by_label("Frames per second").set_value_accesskit(240.0);
    window.get_by_label("Time of the key").set_value_accesskit(120.0);
    window.run_steps(3);
    let folder = tempfile::tempdir().unwrap();
    save_as(&mut window, "Export frames…", &folder.path().join("f_#####.png"));
    (window, folder)
}

#[test]
fn frames_are_told_and_stopped_in_the_bar_when_the_timeline_is_closed() {
    let (mut window, _folder) = writing_for_long();
    click(&mut window, "Timeline");
    assert!(window.query_by_label("Cancel the frames").is_none());
    window.get_by_label_contains("Writing frames, ");
    click(&mut window, "Stop the frames");
    assert!(window.state().session().frames().is_none());
    assert!(window.query_by_label("Stop the frames").is_none());
}

#[test]
fn closing_asks_before_frames_are_given_up_and_then_for_the_look() {
    let (mut window, _folder) = writing_for_long();
    assert!(!ask_to_close(&mut window));
    window.get_by_label_contains("frames are written; those stay");
    click(&mut window, "Go on writing");
    assert!(window.query_by_label("Stop writing frames?").is_none() && window.state().session().frames().is_some());
    assert!(!ask_to_close(&mut window));
    window.get_by_label("Stop and close").click();
    window.run_steps(3);
    assert!(!ask_to_close(&mut window), "the look is not saved either");
    assert!(window.query_by_label("Stop writing frames?").is_none());
    window.get_by_label("Save the look?");
    click(&mut window, "Discard");
    assert!(ask_to_close(&mut window));
}

#[test]
fn the_key_that_closes_asks_before_frames_are_given_up_and_those_that_are_there_are_whole() {
    let (mut window, folder) = writing_for_long();
    let n_written = |app: &App| app.session().frames().map_or(0, |(n_written, _)| n_written);
    wait(&mut window, |app| n_written(app) > 0);
    assert!(!quit_by_key(&mut window));
    click(&mut window, "Go on writing");
    let before = n_written(window.state());
    wait(&mut window, |app| n_written(app) > before);
    assert!(!quit_by_key(&mut window));
    click(&mut window, "Stop and close");
    assert!(!ask_to_close(&mut window), "the look is not saved either");
    click(&mut window, "Discard");
    assert!(ask_to_close(&mut window));
    eframe::App::on_exit(window.state_mut());
    drop(window);
    let n_files = std::fs::read_dir(folder.path()).unwrap().count();
    assert!(n_files > before as usize, "{n_files} files, and {before} frames were written before it was asked again");
    // Whole, in order, and nothing beside them.
    for frame in 0..n_files {
        let picture = image::open(folder.path().join(format!("f_{frame:05}.png"))).unwrap();
        assert_eq!((picture.width(), picture.height()), (64, 48), "frame {frame}");
    }
}

#[test]
fn a_sheet_shows_every_look_once() {
    let mut window = kept_twice(baked_larger());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sheet.png");
    save_as(&mut window, "Contact sheet…", &path);
    wait(&mut window, |_| path.exists());
    let sheet = image::open(&path).unwrap().to_rgb8();
    // Two pictures of 64 × 48 between gaps as high as a line of letters.
    let gap = sheet.width() / 3 - 64 * 2 / 3;
    let part = |nth: u32| image::imageops::crop_imm(&sheet, gap + nth * (64 + gap), gap, 64, 48).to_image();
    let (bright, dark) = (part(0), part(1));
    let n_other = bright.pixels().zip(dark.pixels()).filter(|(one, other)| one != other).count();
    assert!(n_other > 64 * 48 / 2, "{n_other} pixels tell the looks apart on {:?}", sheet.dimensions());
}

#[test]
fn the_scene_is_saved_with_its_lights() {
    let mut window = two_looks();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dark.gltf");
    save_as(&mut window, "Save as glTF…", &path);
    wait(&mut window, |_| path.exists());
    let written: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    assert_eq!(written["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"], 0.0);
}

#[test]
fn a_look_that_another_editor_changed_is_not_overwritten_unasked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.look");
    let text = || std::fs::read_to_string(&path).unwrap();
    let save_again = |window: &mut Window| {
        window.key_press_modifiers(Modifiers::COMMAND, Key::S);
        window.run_steps(3);
    };
    let (mut first, mut second) = (baked(), baked());
    save_as(&mut first, "Save look…", &path);
    second.input_mut().dropped_files.push(std::sync::Arc::new(crate::desk::Dropped(path.clone())));
    wait(&mut second, |app| !app.is_reading_look());
    click(&mut first, "Mute lamp");
    save_again(&mut first);
    assert!(first.query_by_label("Replace").is_none(), "nobody else wrote");
    let of_first = text();

    click(&mut second, "Mute panel");
    save_again(&mut second);
    assert!(second.query_by_label_contains("Another program changed room.look").is_some());
    click(&mut second, "Cancel");
    assert_eq!(text(), of_first, "nothing is lost before there is an answer");
    save_again(&mut second);
    click(&mut second, "Replace");
    assert!(text().contains("panel") && !text().contains("lamp"), "{}", text());

    click(&mut first, "Solo panel");
    click(&mut first, "Mute panel");
    save_again(&mut first);
    let other = folder.path().join("other.look");
    save_as(&mut first, "Save as…", &other);
    assert!(text().contains("panel") && !text().contains("lamp"), "that of the second stays: {}", text());
    assert!(std::fs::read_to_string(&other).unwrap().contains("lamp"));
    save_again(&mut first);
    assert!(first.query_by_label("Replace").is_none(), "it has a file of its own now");
}

#[test]
fn a_look_that_was_read_in_part_does_not_replace_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("torn.look");
    let text = r#"{"clerestory": 1, "lights": {"lamp": {"muted": true}, "panel": {"intensity": "much"}}}"#;
    std::fs::write(&path, text).unwrap();
    let mut window = baked();
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(path.clone())));
    wait(&mut window, |app| app.look().lights.lights.contains_key("lamp"));
    window.run_steps(3);
    assert!(window.query_by_label_contains("saving asks for another file").is_some());
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.run_steps(3);
    window.get_by_label("Path");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
}

#[test]
fn opening_a_look_over_unsaved_work_asks_and_undo_brings_back_the_file_too() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second] = ["first.look", "second.look"].map(|name| folder.path().join(name));
    let dim = r#"{"clerestory": 1, "lights": {"lamp": {"intensity": 0.25}}}"#;
    std::fs::write(&second, dim).unwrap();
    let mut window = baked();
    let save = |window: &mut Window| {
        window.key_press_modifiers(Modifiers::COMMAND, Key::S);
        window.run_steps(3);
    };
    save(&mut window);
    window.get_by_label("Path").set_text_value_accesskit(&first.display().to_string());
    window.run_steps(3);
    click(&mut window, "Save");
    assert!(first.exists());
    click(&mut window, "Mute lamp");

    let drop_it = |window: &mut Window| {
        window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(second.clone())));
        window.run_steps(3);
    };
    drop_it(&mut window);
    window.get_by_label("Save the look?");
    click(&mut window, "Cancel");
    assert!(is_muted(&window) && !window.state().is_reading_look());
    drop_it(&mut window);
    click(&mut window, "Discard");
    wait(&mut window, |app| app.look().lights.lights.get("lamp").is_some_and(|lamp| lamp.intensity == 0.25));
    assert!(!is_muted(&window));

    // What was not saved is there again, and goes where it belongs.
    click(&mut window, "Undo");
    assert!(is_muted(&window));
    save(&mut window);
    assert!(std::fs::read_to_string(&first).unwrap().contains("muted"));
    assert_eq!(std::fs::read_to_string(&second).unwrap(), dim);
    click(&mut window, "Redo");
    click(&mut window, "Mute panel");
    save(&mut window);
    assert!(std::fs::read_to_string(&second).unwrap().contains("panel"));
    assert!(!std::fs::read_to_string(&first).unwrap().contains("0.25"));
}

#[test]
fn an_edit_that_is_taken_back_is_seen_though_a_moment_of_the_timeline_was() {
    let mut window = two_keys();
    click(&mut window, "Mute panel");
    let track = area_of(&window, "Timeline ruler");
    drag(&mut window, track.left_top() + vec2(60.0, 8.0), track.left_top() + vec2(12.0, 8.0));
    window.get_by_label("Take over");
    click(&mut window, "Undo");
    assert!(!window.state().look().lights.own_setting("panel").muted);
    assert!(window.query_by_label("Take over").is_none(), "the lights are seen that were changed");
}

#[test]
fn the_delete_key_is_for_what_was_chosen_last() {
    let mut window = two_keys();
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    assert_eq!(window.state().look().lights.lamps.len(), 1);
    let key = window.query_all_by_label_contains("Key 2: Look 2").next().unwrap().rect().center();
    drag(&mut window, key, key + eframe::egui::vec2(6.0, 0.0));
    window.key_press(Key::Delete);
    window.run_steps(3);
    let counts =
        |window: &Window| (window.state().look().timeline.keys.len(), window.state().look().lights.lamps.len());
    assert_eq!(counts(&window), (1, 1), "the key of the timeline went");
    window.key_press(Key::Delete);
    window.run_steps(3);
    assert_eq!(counts(&window), (1, 1), "nothing is chosen");
    click(&mut window, "Undo");
    assert_eq!(counts(&window), (2, 1));
    drag(&mut window, key, key + eframe::egui::vec2(6.0, 0.0));
    click(&mut window, "Timeline");
    window.key_press(Key::Delete);
    window.run_steps(3);
    assert_eq!(counts(&window), (2, 1), "a key of the timeline that is not seen stays");
}

#[test]
fn a_key_that_is_hidden_with_the_panels_stays() {
    let mut window = two_keys();
    let at = window.query_all_by_label_contains("Key 2: Look 2").next().unwrap().rect().center();
    drag(&mut window, at, at + vec2(6.0, 0.0));
    for (key, n_left) in [(Key::H, 2), (Key::Delete, 2), (Key::H, 2), (Key::Delete, 1)] {
        window.key_press(key);
        window.run_steps(3);
        assert_eq!(window.state().look().timeline.keys.len(), n_left, "{key:?}");
    }
}

#[test]
fn no_key_is_chosen_that_nobody_touched() {
    let n_keys = |window: &Window| window.state().look().timeline.keys.len();
    let delete = |window: &mut Window| {
        window.key_press(Key::Delete);
        window.run_steps(3);
    };
    let mut window = two_keys();
    // One between both is added and taken back: the last one has its place again.
    let track = area_of(&window, "Timeline ruler");
    drag(&mut window, track.left_top() + vec2(90.0, 8.0), track.left_top() + vec2(60.0, 8.0));
    click(&mut window, "Add key");
    click(&mut window, "Look");
    assert_eq!(n_keys(&window), 3);
    click(&mut window, "Undo");
    delete(&mut window);
    assert_eq!(n_keys(&window), 2);

    // Nor is the one that comes to stand where that of a look stood which is deleted.
    window.query_all_by_label_contains("Key 1: Look at").next().unwrap().click();
    window.run_steps(3);
    context_menu(&mut window, "Look Look", "Delete");
    assert_eq!(n_keys(&window), 1);
    delete(&mut window);
    assert_eq!(n_keys(&window), 1);
    click(&mut window, "Undo");
    assert_eq!(n_keys(&window), 2);

    // Nor is one of a look that is opened.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("two.look");
    save_as(&mut window, "Save look…", &file);
    window.query_all_by_label_contains("Key 2: Look 2").next().unwrap().click();
    window.run_steps(3);
    window.get_by_label("Delete key");
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(file)));
    window.run_steps(3);
    wait(&mut window, |app| !app.is_reading_look());
    delete(&mut window);
    assert_eq!(n_keys(&window), 2);
}
