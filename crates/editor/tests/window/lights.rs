//! The panel of lights in the window: groups and masters, names, many lights at once, solo, units, board and table.

use clerestory::app::App;
use clerestory::look::Look;
use clerestory::session::{BakeState, Source};
use eframe::egui::{Event, Key, Modifiers, PointerButton, Pos2, Role, pos2, vec2};
use egui_kittest::kittest::{NodeT, Queryable};
use serde_json::{Value, json};

use crate::desk::{Window, baked, click, drag, hints, is_framed, open, quit_by_key, reach, room, type_over, wait};

/// The room with three more lamps below a node: instances of one lamp.
fn lit_room() -> Vec<u8> {
    let mut gltf: Value = serde_json::from_slice(&room()).unwrap();
    let lights = gltf["extensions"]["KHR_lights_punctual"]["lights"].as_array_mut().unwrap();
    lights.push(json!({"type": "point", "name": "Bulb", "intensity": 2}));
    let light = lights.len() - 1;
    let nodes = gltf["nodes"].as_array_mut().unwrap();
    let first = nodes.len();
    for (idx, name) in ["left", "middle", "right"].into_iter().enumerate() {
        nodes.push(json!({"name": name, "translation": [0.4 * idx as f32 - 0.4, 0.3, -0.6],
            "extensions": {"KHR_lights_punctual": {"light": light}}}));
    }
    nodes.push(json!({"name": "Counter", "children": [first, first + 1, first + 2]}));
    gltf["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(first + 3));
    serde_json::to_vec(&gltf).unwrap()
}

/// That room, baked, with its first picture.
fn lit() -> Window {
    let mut window = open(Source::Bytes { name: "room.gltf".into(), bytes: lit_room() });
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    window
}

fn intensity(window: &Window, key: &str) -> f32 {
    window.state().look().lights.own_setting(key).intensity
}

/// A click with keys held.
fn click_with(window: &mut Window, at: Pos2, button: PointerButton, modifiers: Modifiers) {
    window.hover_at(at);
    window.run_steps(2);
    for pressed in [true, false] {
        window.event(Event::PointerButton { pos: at, button, pressed, modifiers });
        window.run_steps(1);
    }
    window.run_steps(3);
}

/// Where the name of a light stands in the list.
fn name(window: &Window, name: &str) -> Pos2 {
    let mute = window.get_by_label(&format!("Mute {name}")).rect();
    pos2(mute.right() + 20.0, mute.center().y)
}

/// Clicks the names of lights, the first alone and the others with Ctrl.
fn select(window: &mut Window, names: &[&str]) {
    for (idx, of) in names.iter().enumerate() {
        let modifiers = if idx == 0 { Modifiers::NONE } else { Modifiers::COMMAND };
        window.event(Event::ModifiersChanged(modifiers));
        let at = name(window, of);
        click_with(window, at, PointerButton::Primary, modifiers);
        window.event(Event::ModifiersChanged(Modifiers::NONE));
    }
}

/// Chooses from the menu of a name.
fn from_menu(window: &mut Window, of: Pos2, item: &str) {
    click_with(window, of, PointerButton::Secondary, Modifiers::NONE);
    click(window, item);
}

#[test]
fn lights_below_one_node_are_a_group_with_a_master() {
    let mut window = lit();
    let ev = window.state().shown_ev();
    let fader = window.get_by_label("Group Counter intensity").rect();
    let from = pos2(fader.left() + 0.6 * fader.width(), fader.center().y);
    drag(&mut window, from, pos2(fader.right() - 6.0, fader.center().y));
    let group = window.state().look().lights.groups["place:Counter"].clone();
    assert!(group.intensity > 4.0, "{}", group.intensity);
    assert_eq!(group.lights.iter().map(String::as_str).collect::<Vec<_>>(), ["left", "middle", "right"]);
    assert_eq!(intensity(&window, "left"), 1.0, "its lights keep what they are set to");
    wait(&mut window, |app| app.is_settled() && app.shown_ev() < ev - 0.2);

    // The master counts however the list is sorted, and the list says so.
    click(&mut window, "Group lights by");
    click(&mut window, "Instance");
    window.get_by_label("Group Bulb intensity");
    assert_eq!(window.query_all_by_label_contains("Counter turns by").count(), 1);
    click(&mut window, "Undo");
    assert_eq!(*window.state().look(), Look::default(), "one drag is one step");

    click(&mut window, "Mute group Bulb");
    assert!(window.state().look().lights.setting("left").muted);
    click(&mut window, "Mute group Bulb");
    assert_eq!(*window.state().look(), Look::default(), "what changes nothing leaves no trace");
    click(&mut window, "Collapse Bulb");
    assert!(window.query_by_label("Mute left").is_none());
    click(&mut window, "Expand Bulb");
    window.get_by_label("Mute left");
    // By the keyboard, which stays on the name.
    window.get_by_label("Bulb").focus();
    window.run_steps(2);
    for (key, is_open) in [(Key::ArrowLeft, false), (Key::ArrowRight, true), (Key::ArrowLeft, false)] {
        window.key_press(key);
        window.run_steps(3);
        assert_eq!(window.query_by_label("Mute left").is_some(), is_open, "{key:?}");
    }
}

#[test]
fn many_lights_are_changed_by_stops_and_set_to_one_value() {
    let mut window = lit();
    select(&mut window, &["left", "right"]);
    click(&mut window, "Brighter by ⅓ EV");
    let third = 2f32.powf(1.0 / 3.0);
    assert!((intensity(&window, "left") - third).abs() < 1e-4);
    assert_eq!(intensity(&window, "middle"), 1.0);
    click(&mut window, "Darker by ⅓ EV");
    assert_eq!(intensity(&window, "left"), 1.0);
    click(&mut window, "Brighter by ⅓ EV");

    // With another light the values are mixed, and an offset keeps their ratio.
    select(&mut window, &["left", "right", "middle"]);
    window.key_press(Key::CloseBracket);
    window.run_steps(3);
    assert!((intensity(&window, "left") / intensity(&window, "middle") - third).abs() < 1e-4);
    assert!(window.get_by_label("Selected lights factor").accesskit_node().value().unwrap().contains("mixed"));

    window.get_by_label("Selected lights factor").click();
    window.run_steps(2);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.get_by_label("Selected lights factor").type_text("0.5");
    window.run_steps(2);
    window.key_press(Key::Enter);
    window.run_steps(3);
    for key in ["left", "middle", "right"] {
        assert_eq!(intensity(&window, key), 0.5, "{key}");
    }
    assert_eq!(intensity(&window, "lamp"), 1.0);

    click(&mut window, "Mute selected lights");
    assert!(window.state().look().lights.setting("middle").muted);
    click(&mut window, "Reset selected lights");
    assert_eq!(*window.state().look(), Look::default());
    click(&mut window, "Undo");
    assert!(window.state().look().lights.setting("middle").muted, "all of them are one step");
}

#[test]
fn shift_selects_all_up_to_there_and_a_light_has_another_name() {
    let mut window = lit();
    select(&mut window, &["left"]);
    window.event(Event::ModifiersChanged(Modifiers::SHIFT));
    let at = name(&window, "right");
    click_with(&mut window, at, PointerButton::Primary, Modifiers::SHIFT);
    window.event(Event::ModifiersChanged(Modifiers::NONE));
    window.get_by_label("3 lights selected");
    click(&mut window, "Select nothing");
    assert!(window.query_by_label("3 lights selected").is_none());

    let at = name(&window, "left");
    from_menu(&mut window, at, "Rename…");
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.get_by_label("Name of left").type_text("Desk lamp");
    window.run_steps(2);
    window.key_press(Key::Enter);
    window.run_steps(3);
    assert_eq!(window.state().look().names["left"], "Desk lamp");
    click(&mut window, "Mute Desk lamp");
    assert!(window.state().look().lights.lights["left"].muted, "the key stays");
}

#[test]
fn arrow_keys_take_the_selection_up_and_down_and_shift_extends_it() {
    let mut window = lit();
    // After a click nothing has the keyboard.
    select(&mut window, &["left"]);
    window.key_press(Key::ArrowDown);
    window.run_steps(3);
    assert_eq!(window.state().chosen_light(), Some("middle"));
    window.key_press_modifiers(Modifiers::SHIFT, Key::ArrowDown);
    window.run_steps(3);
    window.get_by_label("2 lights selected");
    window.key_press(Key::ArrowUp);
    window.run_steps(3);
    assert_eq!(window.state().chosen_light(), Some("middle"));

    // From a name that has the keyboard, which goes along.
    let has_keyboard =
        |window: &Window, label: &str| window.query_all_by_label(label).any(|node| node.accesskit_node().is_focused());
    window.query_all_by_label("right").next().unwrap().focus();
    window.run_steps(2);
    window.key_press(Key::ArrowUp);
    window.run_steps(4);
    assert_eq!(window.state().chosen_light(), Some("middle"));
    assert!(has_keyboard(&window, "middle") && !has_keyboard(&window, "right"));
    assert_eq!(*window.state().look(), Look::default(), "no light was changed");
}

#[test]
fn several_solos_show_a_banner_that_clears_them() {
    let mut window = lit();
    let ev = window.state().shown_ev();
    assert!(window.query_by_label("Clear solo").is_none());
    click(&mut window, "Solo left");
    click(&mut window, "Solo right");
    window.get_by_label("Solo: left, right");
    wait(&mut window, |app| app.is_settled() && (app.shown_ev() - ev).abs() > 1e-2);
    click(&mut window, "Clear solo");
    wait(&mut window, |app| app.is_settled() && (app.shown_ev() - ev).abs() < 1e-3);
    click(&mut window, "Solo group Counter");
    window.get_by_label("Solo: left, middle, right");
    assert_eq!(*window.state().look(), Look::default());
}

#[test]
fn faders_take_keys_and_fine_drags_and_go_back() {
    let mut window = lit();
    window.get_by_label("left intensity").focus();
    window.run_steps(2);
    window.key_press(Key::ArrowRight);
    window.run_steps(2);
    assert!((intensity(&window, "left") - 2f32.powf(1.0 / 3.0)).abs() < 1e-3, "{}", intensity(&window, "left"));
    window.key_press(Key::ArrowLeft);
    window.run_steps(2);
    assert_eq!(*window.state().look(), Look::default());

    // With Shift a drag goes a tenth of the way.
    let fader = window.get_by_label("left intensity").rect();
    let from = pos2(fader.left() + 0.4 * fader.width(), fader.center().y);
    window.event(Event::ModifiersChanged(Modifiers::SHIFT));
    drag(&mut window, from, from + eframe::egui::vec2(0.3 * fader.width(), 0.0));
    window.event(Event::ModifiersChanged(Modifiers::NONE));
    let stops = intensity(&window, "left").log2();
    assert!(stops > 0.1 && stops < 0.8, "{stops}");
    let at = name(&window, "left");
    from_menu(&mut window, at, "Reset");
    assert_eq!(*window.state().look(), Look::default());
}

#[test]
fn a_fader_says_what_its_way_is() {
    let mut window = lit();
    assert!(hints(&mut window, "left intensity", "Intensity in stops (EV)"));
}

#[test]
fn the_hint_of_a_fader_goes_when_a_question_comes() {
    let mut window = lit();
    click(&mut window, "Mute left");
    assert!(hints(&mut window, "left intensity", "Intensity in stops (EV)"));
    assert!(!quit_by_key(&mut window));
    window.run_steps(4);
    window.get_by_label("Discard");
    assert!(window.query_all_by_label_contains("Intensity in stops (EV)").next().is_none());
}

#[test]
fn a_number_of_thousands_fits_beside_the_color() {
    let mut window = lit();
    click(&mut window, "Unit of intensities");
    click(&mut window, "lm, luminous flux");
    for (typed, told) in [("1274", "1274"), ("15694", "15.7k"), ("99900", "99.9k")] {
        type_over(&mut window, "left lm", typed);
        let number = window.get_by_label("left lm");
        assert!(number.accesskit_node().value().unwrap().starts_with(told), "{told}");
        let swatch = window.get_by_label("left color").rect();
        assert!(number.rect().right() <= swatch.left(), "{} reaches {}", number.rect(), swatch);
    }
}

#[test]
fn intensities_are_told_in_the_unit_that_is_chosen() {
    let mut window = lit();
    click(&mut window, "Unit of intensities");
    click(&mut window, "cd, luminous intensity");
    let value = |window: &Window, label: &str| window.get_by_label(label).accesskit_node().value().unwrap();
    assert!(value(&window, "left cd").starts_with("2.00"), "{}", value(&window, "left cd"));
    click(&mut window, "Unit of intensities");
    click(&mut window, "lm, luminous flux");
    // 4π lumen all around are 1 candela.
    assert!(value(&window, "left lm").starts_with("25.1"), "{}", value(&window, "left lm"));
    click(&mut window, "Unit of intensities");
    click(&mut window, "W, electrical power");
    window.get_by_label("Luminous efficacy").set_value_accesskit(100.0);
    window.run_steps(3);
    assert!(value(&window, "left W").starts_with("0.25"), "{}", value(&window, "left W"));
    click(&mut window, "Unit of intensities");
    click(&mut window, "EV, stops above the file");
    assert!(value(&window, "left stops").starts_with("+0.00"), "{}", value(&window, "left stops"));
}

#[test]
fn board_and_table_edit_the_same_look() {
    let mut window = lit();
    click(&mut window, "Board");
    let fader = window.get_by_label("Group Counter intensity").rect();
    assert!(fader.height() > 2.0 * fader.width(), "it stands: {fader:?}");
    let top = pos2(fader.center().x, fader.top() + 8.0);
    drag(&mut window, pos2(fader.center().x, fader.center().y), top);
    assert!(window.state().look().lights.groups["place:Counter"].intensity > 8.0);
    click(&mut window, "Undo");

    click(&mut window, "Table");
    assert!(hints(&mut window, "Color", "That of the file, another one"));
    click(&mut window, "Sort by lm");
    click(&mut window, "Mute middle");
    assert!(window.state().look().lights.lights["middle"].muted);
    assert!(window.query_all_by_label("0.00, 0.30, -0.60").count() == 1, "where it stands");
    click(&mut window, "List");
    window.get_by_label("Group Counter intensity");
    wait(&mut window, App::is_settled);
}

#[test]
fn a_light_that_is_dragged_is_seen_to_change_and_metered_once_it_rests() {
    let mut window = lit();
    let ev = window.state().shown_ev();
    let fader = window.get_by_label("lamp intensity").rect();
    window.hover_at(fader.center());
    window.run_steps(2);
    window.drag_at(fader.center());
    window.run_steps(2);
    let pictures = window.state().n_pictures();
    window.hover_at(pos2(fader.right(), fader.center().y));
    wait(&mut window, |app| app.n_pictures() > pictures);
    // However long it is held.
    window.run_steps(40);
    assert!(intensity(&window, "lamp") > 4.0);
    assert_eq!(window.state().shown_ev(), ev, "what a brighter lamp does is not metered away");
    window.drop_at(pos2(fader.right(), fader.center().y));
    wait(&mut window, |app| app.is_settled() && app.shown_ev() < ev - 0.5);
}

#[test]
fn the_rows_of_lights_and_groups_share_their_columns() {
    let mut window = lit();
    for width in [1440.0, 960.0] {
        window.set_size(eframe::egui::vec2(width, 900.0));
        window.run_steps(4);
        let place = |label: &str| window.get_by_label(label).rect();
        let [group, member, single] =
            ["Group Counter intensity", "left intensity", "lamp intensity"].map(|label| place(label).x_range());
        assert_eq!([group, member], [single; 2], "the faders in a window of {width} points");
        assert!(single.span() >= 72.0, "{}", single.span());
        let letters = ["Mute group Counter", "Mute left", "Mute lamp"].map(|label| place(label).left());
        assert_eq!([letters[0], letters[1]], [letters[2]; 2], "the letters in a window of {width} points");
        let color = place("lamp color");
        assert!(color.right() < 0.5 * width && single.max <= color.right() + 0.5, "{color} {single:?}");
    }
}

#[test]
fn what_a_right_click_offers_is_there_for_the_keyboard_too() {
    let mut window = baked();
    select(&mut window, &["lamp"]);
    let more = window.get_by_label("More for lamp");
    more.focus();
    window.run_steps(2);
    window.key_press(Key::Enter);
    window.run_steps(3);
    for name in ["Solo this alone", "Rename…", "Make movable"] {
        window.get_by_label(name);
    }
    click(&mut window, "Make movable");
    assert_eq!(window.state().look().lights.lamps[0].key, "lamp movable 1");
}

/// Gives the keyboard to something and has its menu opened by a key.
fn menu_by_key(window: &mut Window, label: &str, modifiers: Modifiers, key: Key) {
    window.get_by_label(label).focus();
    window.run_steps(2);
    window.key_press_modifiers(modifiers, key);
    window.run_steps(4);
}

/// Presses a key and looks what comes of it.
fn press(window: &mut Window, key: Key) {
    window.key_press(key);
    window.run_steps(3);
}

#[test]
fn a_master_is_handed_down_unseen_and_a_group_is_reset_with_its_lights() {
    let mut window = lit();
    let fader = window.get_by_label("Group Counter intensity").rect();
    drag(
        &mut window,
        pos2(fader.left() + 0.6 * fader.width(), fader.center().y),
        pos2(fader.right(), fader.center().y),
    );
    click(&mut window, "Mute middle");
    let set = |window: &Window| {
        let lights = &window.state().look().lights;
        ["left", "middle", "right"].map(|key| lights.setting(key)).map(|of| (of.intensity, of.muted))
    };
    let before = set(&window);
    assert!(before[0].0 > 4.0 && intensity(&window, "left") == 1.0, "{before:?}");
    menu_by_key(&mut window, "Counter", Modifiers::NONE, Key::Menu);
    click(&mut window, "Hand the master down");
    assert_eq!(set(&window), before);
    assert!(window.state().look().lights.groups.is_empty() && intensity(&window, "left") == before[0].0);

    click(&mut window, "Mute group Counter");
    menu_by_key(&mut window, "Counter", Modifiers::NONE, Key::Menu);
    click(&mut window, "Reset the group");
    assert_eq!(*window.state().look(), Look::default(), "its master and its lights");
    click(&mut window, "Undo");
    assert!(set(&window).iter().all(|(intensity, muted)| *intensity > 4.0 && *muted), "in one step");
}

#[test]
fn menus_open_choose_and_close_without_a_pointer() {
    let mut window = lit();
    window.hover_at(pos2(5.0, 400.0));
    menu_by_key(&mut window, "lamp", Modifiers::SHIFT, Key::F10);
    let (menu, row) = (window.get_by_label("Solo this alone").rect(), window.get_by_label("lamp").rect());
    assert!((menu.left() - row.left()).abs() < 20.0 && menu.top() > row.top(), "below the name: {menu} {row}");
    for key in [Key::ArrowDown, Key::ArrowDown, Key::Enter] {
        press(&mut window, key);
    }
    window.get_by_label("Solo: lamp");
    assert!(window.query_by_label("Rename…").is_none(), "what was chosen closes it");
    click(&mut window, "Clear solo");

    menu_by_key(&mut window, "Counter", Modifiers::NONE, Key::Menu);
    window.get_by_label("Reset the master");
    press(&mut window, Key::Escape);
    assert!(window.query_by_label("Reset the master").is_none());
    assert!(window.get_by_label("Counter").accesskit_node().is_focused(), "the keyboard goes on where it was");
    // Without the key in the hand of anything no menu opens.
    press(&mut window, Key::Tab);
    window.get_by_label("Undo").focus();
    window.run_steps(2);
    press(&mut window, Key::Menu);
    assert!(window.query_by_label("Reset the master").is_none() && window.query_by_label("Rename…").is_none());

    click(&mut window, "Keep look");
    menu_by_key(&mut window, "Look Look", Modifiers::NONE, Key::Menu);
    click(&mut window, "Duplicate");
    assert_eq!(window.state().look().snapshots.len(), 2);

    menu_by_key(&mut window, "Picture", Modifiers::SHIFT, Key::F10);
    press(&mut window, Key::ArrowDown);
    press(&mut window, Key::ArrowRight);
    click(&mut window, "Point");
    let lamp = window.state().look().lights.lamps[0].clone();
    assert!(lamp.position.x.abs() < 0.05, "in the middle of the view: {}", lamp.position);

    press(&mut window, Key::F1);
    window.get_by_label("The menu of what has the focus");
}

/// Gives a light another name.
fn rename(window: &mut Window, from: &str, to: &str) {
    let at = name(window, from);
    from_menu(window, at, "Rename…");
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    // The chosen lamp has a second field, which does not have the keyboard.
    let label = format!("Name of {from}");
    window.get_all_by_label(&label).find(|field| field.accesskit_node().is_focused()).unwrap().type_text(to);
    window.run_steps(2);
    press(window, Key::Enter);
}

#[test]
fn a_light_that_was_renamed_is_called_so_everywhere() {
    let mut window = baked();
    rename(&mut window, "panel", "Wash");
    click(&mut window, "Spots");
    for label in ["Spots on Wash", "Wash spot radius", "Delete spot of Wash", "Add spot to Wash"] {
        window.get_by_label(label);
    }
    let at = window.get_by_label_contains("Wash, spot 1 at").rect();
    assert!(window.get_by_label("Picture").rect().contains_rect(at));

    // Messages, and lamps that are made of others.
    rename(&mut window, "lamp", "Pendant");
    let at = name(&window, "Pendant");
    from_menu(&mut window, at, "Make movable");
    window.get_by_label("Pendant movable 1 stands in for Pendant, which is off now");
    rename(&mut window, "Pendant movable 1", "Door");
    for label in ["Door strength", "Door unit", "Door position X"] {
        window.get_by_label(label);
    }
    click(&mut window, "Duplicate");
    window.get_by_label("Added Door 1");
    wait(&mut window, App::is_settled);
    click(&mut window, "Solve for light");
    let lights = window.get_by_label_contains("Lights to change");
    lights.scroll_to_me();
    window.run_steps(6);
    window.get_by_label_contains("Lights to change").click();
    window.run_steps(4);
    for name in ["Wash", "Door", "Door 1"] {
        window.get_by_label(&format!("{name} may change"));
    }
    press(&mut window, Key::Delete);
    window.get_by_label("Deleted Door 1");
}

#[test]
fn a_light_is_renamed_in_a_group_that_was_folded() {
    let mut window = lit();
    select(&mut window, &["left"]);
    click(&mut window, "Collapse Counter");
    assert!(window.query_by_label("Mute left").is_none());
    press(&mut window, Key::F2);
    window.run_steps(4);
    window.get_by_label("Name of left");
}

#[test]
fn a_click_in_the_picture_adds_to_what_is_selected_with_shift_or_ctrl_and_else_selects_one() {
    let mut window = lit();
    let lamp = |window: &mut Window, name: &str| {
        // Marks of lamps are there while the pointer is in the picture.
        window.hover_at(window.get_by_label("Picture").rect().center());
        window.run_steps(2);
        window.get_by_label(&format!("{name} in the picture")).rect().center()
    };
    let pick = |window: &mut Window, name: &str, modifiers: Modifiers| {
        let at = lamp(window, name);
        window.event(Event::ModifiersChanged(modifiers));
        click_with(window, at, PointerButton::Primary, modifiers);
        window.event(Event::ModifiersChanged(Modifiers::NONE));
        window.run_steps(3);
        let selected = window.query_all_by_label_contains(" lights selected").next();
        selected.map(|title| title.accesskit_node().value().unwrap_or_default())
    };
    select(&mut window, &["lamp", "panel"]);
    assert_eq!(pick(&mut window, "left", Modifiers::SHIFT).as_deref(), Some("3 lights selected"));
    assert_eq!(pick(&mut window, "right", Modifiers::COMMAND).as_deref(), Some("4 lights selected"));
    assert_eq!(pick(&mut window, "right", Modifiers::NONE), None, "this one alone");
    assert_eq!(pick(&mut window, "left", Modifiers::SHIFT).as_deref(), Some("2 lights selected"));
    assert_eq!(pick(&mut window, "middle", Modifiers::NONE), None);

    // A surface adds what lights it most.
    select(&mut window, &["lamp", "panel"]);
    let at = window.get_by_label("Picture").rect().center();
    window.event(Event::ModifiersChanged(Modifiers::SHIFT));
    click_with(&mut window, at, PointerButton::Primary, Modifiers::SHIFT);
    window.event(Event::ModifiersChanged(Modifiers::NONE));
    window.run_steps(6);
    assert_eq!(window.query_all_by_label_contains(" lights selected").count(), 1, "they stay selected");
    click_with(&mut window, at, PointerButton::Primary, Modifiers::NONE);
    window.run_steps(6);
    assert_eq!(window.query_all_by_label_contains(" lights selected").count(), 0);
}

#[test]
fn lights_that_are_selected_in_the_list_are_shown_where_they_are() {
    let mut window = lit();
    let shown = |window: &Window| -> Vec<&'static str> {
        let labels = ["left in the picture", "middle in the picture", "right in the picture", "panel is here"];
        labels.into_iter().filter(|label| window.query_by_label(label).is_some()).collect()
    };
    assert!(shown(&window).is_empty());
    select(&mut window, &["left", "right", "panel"]);
    assert_eq!(shown(&window), ["left in the picture", "right in the picture", "panel is here"]);
    click(&mut window, "Select nothing");
    assert!(shown(&window).is_empty());

    // A name that is pointed at is enough.
    for (of, words) in [("panel", "panel is here"), ("left", "left is here")] {
        let at = name(&window, of);
        window.hover_at(at);
        window.run_steps(3);
        window.get_by_label(words);
    }
    window.hover_at(pos2(5.0, 400.0));
    window.run_steps(3);
    assert!(shown(&window).is_empty() && window.query_by_label("left is here").is_none());

    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.run_steps(3);
    window.get_by_label("5 lights selected");
    assert_eq!(shown(&window).len(), 4);
}

/// Where the handle of a fader is that stands at the file's value.
fn handle(window: &Window, label: &str) -> Pos2 {
    let fader = window.get_by_label(label).rect();
    let way = fader.width() - 13.0;
    pos2(fader.left() + 6.5 + way * (0.03 + 0.97 * 7.0 / 11.0), fader.center().y)
}

#[test]
fn a_press_on_a_handle_moves_nothing_and_other_buttons_only_offer_a_menu() {
    let mut window = lit();
    let at = handle(&window, "left intensity");
    let beside = at + eframe::egui::vec2(4.0, 0.0);
    click_with(&mut window, beside, PointerButton::Primary, Modifiers::NONE);
    assert_eq!(*window.state().look(), Look::default(), "it was taken hold of where it is");
    drag(&mut window, beside, beside + eframe::egui::vec2(20.0, 0.0));
    let brighter = intensity(&window, "left");
    assert!(brighter > 2.0, "{brighter}");

    let fader = window.get_by_label("left intensity").rect();
    for button in [PointerButton::Secondary, PointerButton::Middle] {
        click_with(&mut window, fader.left_center() + eframe::egui::vec2(3.0, 0.0), button, Modifiers::NONE);
        assert_eq!(intensity(&window, "left"), brighter, "{button:?}");
        window.key_press(Key::Escape);
        window.run_steps(3);
    }
    from_menu(&mut window, fader.center(), "Reset to the file's value");
    assert_eq!(*window.state().look(), Look::default());
}

#[test]
fn a_double_click_on_a_fader_brings_the_files_value_back() {
    let mut window = lit();
    let from = handle(&window, "left intensity");
    drag(&mut window, from, from - eframe::egui::vec2(25.0, 0.0));
    assert!(intensity(&window, "left") < 0.5);
    let at = from - eframe::egui::vec2(25.0, 0.0);
    window.hover_at(at);
    window.run_steps(2);
    for pressed in [true, false, true, false] {
        let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
        // All in one frame, as quick as two clicks are.
        window.input_mut().events.push(Event::PointerButton { pos: at, button, pressed, modifiers });
    }
    window.run_steps(3);
    assert_eq!(*window.state().look(), Look::default());
}

#[test]
fn a_number_is_taken_in_its_own_unit_and_in_no_other() {
    let mut window = lit();
    click(&mut window, "Unit of intensities");
    click(&mut window, "cd, luminous intensity");
    for (text, expected) in [("4 cd", 2.0), ("50 %", 0.5), ("3 lm", 0.5), ("1,000", 500.0), ("off", 0.0)] {
        type_over(&mut window, "left cd", text);
        assert!((intensity(&window, "left") - expected).abs() < 1e-4, "{text}: {}", intensity(&window, "left"));
    }
}

#[test]
fn a_light_has_a_color_temperature_a_color_of_six_digits_or_that_of_its_file() {
    let mut window = lit();
    click(&mut window, "left color");
    click(&mut window, "Kelvin");
    click(&mut window, "Warm");
    assert_eq!(window.state().look().lights.own_setting("left").kelvin, Some(2700.0));
    click(&mut window, "Color");
    type_over(&mut window, "left hex", "#00FF00");
    let setting = window.state().look().lights.own_setting("left");
    assert_eq!((setting.color, setting.kelvin), (Some([0.0, 1.0, 0.0]), None));
    wait(&mut window, App::is_settled);
    // The square and the bar of hues take the pointer.
    let bar = window.get_by_label("Hue").rect();
    drag(&mut window, bar.left_center() + eframe::egui::vec2(bar.width() / 3.0, 0.0), bar.left_center());
    let [r, g, b] = window.state().look().lights.own_setting("left").color.unwrap();
    assert!(r > 0.99 && g < 0.01 && b < 0.01, "{r} {g} {b}");
    click(&mut window, "From file");
    assert_eq!(*window.state().look(), Look::default());
}

#[test]
fn a_color_is_picked_by_arrow_keys_and_what_has_the_keyboard_is_framed() {
    let mut window = lit();
    assert!(!is_framed(&window, "left color"));
    window.get_by_label("left color").focus();
    window.run_steps(2);
    assert!(is_framed(&window, "left color"));
    click(&mut window, "left color");
    click(&mut window, "Color");
    type_over(&mut window, "left hex", "#FF0000");
    let color = |window: &Window| window.state().look().lights.own_setting("left").color.unwrap();
    window.get_by_label("Hue").focus();
    window.run_steps(2);
    assert!(is_framed(&window, "Hue"));
    press(&mut window, Key::ArrowUp);
    assert_eq!(color(&window), [1.0, 0.0, 0.0], "a bar of hues has no way up");
    press(&mut window, Key::ArrowRight);
    let [r, g, b] = color(&window);
    assert!(r > 0.99 && g > 0.0 && b < 1e-3, "towards yellow: {r} {g} {b}");
    let told = |window: &Window, label: &str| window.get_by_label(label).accesskit_node().value();
    assert_eq!(told(&window, "Hue").as_deref(), Some("7°"));
    window.get_by_label("Saturation and value").focus();
    window.run_steps(2);
    assert!(is_framed(&window, "Saturation and value") && !is_framed(&window, "Hue"));
    press(&mut window, Key::ArrowLeft);
    let paler = color(&window);
    assert!(paler[2] > b + 1e-4, "{paler:?}");
    press(&mut window, Key::ArrowDown);
    assert!(color(&window)[0] < paler[0] - 1e-3, "{:?}", color(&window));
}

#[test]
fn a_light_that_gets_a_color_is_as_bright_as_in_its_file_at_first() {
    let mut gltf: Value = serde_json::from_slice(&room()).unwrap();
    let shining = gltf["materials"].as_array_mut().unwrap().last_mut().unwrap();
    shining["emissiveFactor"] = json!([0.5, 0.25, 0.125]);
    let mut window = open(Source::Bytes { name: "room.gltf".into(), bytes: serde_json::to_vec(&gltf).unwrap() });
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    click(&mut window, "panel color");
    click(&mut window, "Color");
    let color = window.state().look().lights.own_setting("panel").color.unwrap();
    assert!(color.iter().zip([0.5, 0.25, 0.125]).all(|(found, own)| (found - own).abs() < 1e-4), "{color:?}");
}

#[test]
fn a_long_list_is_searched_by_a_part_of_a_name() {
    let mut gltf: Value = serde_json::from_slice(&lit_room()).unwrap();
    let nodes = gltf["nodes"].as_array_mut().unwrap();
    let first = nodes.len();
    for idx in 0..8 {
        nodes.push(json!({"name": format!("spot {idx}"), "translation": [0.1 * f64::from(idx), 0.1, -0.6],
            "extensions": {"KHR_lights_punctual": {"light": 0}}}));
    }
    let roots = gltf["scenes"][0]["nodes"].as_array_mut().unwrap();
    roots.extend((first..first + 8).map(|node| json!(node)));
    let bytes = serde_json::to_vec(&gltf).unwrap();
    let mut window = open(Source::Bytes { name: "room.gltf".into(), bytes });
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    let n_shown = |window: &Window, part: &str| window.query_all_by_label_contains(&format!("Mute {part}")).count();
    assert!(n_shown(&window, "left") == 1 && n_shown(&window, "spot") > 0);
    window.get_by_label("Filter lights").click();
    window.run_steps(2);
    window.get_by_label("Filter lights").type_text("LEF");
    window.run_steps(3);
    assert_eq!((n_shown(&window, "left"), n_shown(&window, "spot")), (1, 0));
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.get_by_label("Filter lights").type_text("spot 3");
    window.run_steps(3);
    assert_eq!((n_shown(&window, "left"), n_shown(&window, "spot")), (0, 1));

    // What is selected and not shown is told, since it is changed as well.
    click(&mut window, "Clear the filter");
    assert!(n_shown(&window, "left") == 1 && n_shown(&window, "spot") > 1);
    assert!(window.query_by_label("Clear the filter").is_none());
    select(&mut window, &["left", "right"]);
    window.get_by_label("Filter lights").click();
    window.run_steps(2);
    window.get_by_label("Filter lights").type_text("LEF");
    window.run_steps(3);
    window.get_by_label("2 lights selected, 1 not shown");
}

#[test]
fn two_lights_can_be_searched_and_one_needs_no_search() {
    let mut window = baked();
    window.get_by_label("Filter lights").click();
    window.run_steps(2);
    window.get_by_label("Filter lights").type_text("LAM");
    window.run_steps(3);
    assert!(window.query_by_label("Mute lamp").is_some() && window.query_by_label("Mute panel").is_none());

    let mut gltf: Value = serde_json::from_slice(&room()).unwrap();
    gltf["scenes"][0]["nodes"].as_array_mut().unwrap().pop();
    let mut window = open(Source::Bytes { name: "room.gltf".into(), bytes: serde_json::to_vec(&gltf).unwrap() });
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    assert!(window.query_by_label("Mute lamp").is_some() && window.query_by_label("Filter lights").is_none());
}

#[test]
fn in_the_sorted_table_a_light_that_is_changed_stays_under_the_hand() {
    let mut window = lit();
    click(&mut window, "Table");
    click(&mut window, "Sort by value");
    let top = |window: &Window, name: &str| window.get_by_label(&format!("Mute {name}")).rect().top();
    let others = ["middle", "right", "lamp", "panel"];
    let are_as_in_the_file = |window: &Window| others.iter().all(|key| intensity(window, key) == 1.0);
    let before = top(&window, "left");
    assert!(before < top(&window, "right"));

    // Dragged past all the others, and typed.
    let at = window.get_by_label("left factor").rect().center();
    window.hover_at(at);
    window.run_steps(2);
    window.drag_at(at);
    window.run_steps(2);
    for x in [10.0, 40.0, 80.0] {
        window.hover_at(at + eframe::egui::vec2(x, 0.0));
        window.run_steps(3);
        assert_eq!(top(&window, "left"), before, "it stays while it is held");
    }
    let held = intensity(&window, "left");
    assert!(held > 1.05 && are_as_in_the_file(&window), "{held}");
    window.drop_at(at + eframe::egui::vec2(80.0, 0.0));
    window.run_steps(4);
    assert!(top(&window, "left") > top(&window, "right"), "and then goes where it belongs");
    type_over(&mut window, "left factor", "0.25");
    assert!(intensity(&window, "left") == 0.25 && are_as_in_the_file(&window));
    assert!(top(&window, "left") < top(&window, "middle"));

    // The keyboard and the window of a color go with their light.
    click(&mut window, "Sort by lm");
    click(&mut window, "Sort by lm");
    window.get_by_label("Mute right").focus();
    window.run_steps(2);
    for _ in 0..2 {
        press(&mut window, Key::Space);
    }
    let muted = |window: &Window, key: &str| window.state().look().lights.own_setting(key).muted;
    assert!(!["left", "middle", "right", "lamp"].iter().any(|key| muted(&window, key)), "on and off is the same light");
    click(&mut window, "Sort by kelvin");
    click(&mut window, "right color");
    click(&mut window, "Kelvin");
    click(&mut window, "Warm");
    click(&mut window, "Candle");
    let kelvin = |key: &str| window.state().look().lights.own_setting(key).kelvin;
    assert_eq!((kelvin("right"), kelvin("left"), kelvin("middle")), (Some(1900.0), None, None));
}

#[test]
fn board_and_table_have_the_details_the_masters_and_the_way_back() {
    let mut window = lit();
    click(&mut window, "Add lamp");
    click(&mut window, "Spot");
    wait(&mut window, App::is_settled);
    click(&mut window, "Mute group Counter");
    for view in ["Board", "Table"] {
        click(&mut window, view);
        window.run_steps(4);
        let panel = window.get_by_label("Picture").rect().left();
        for label in ["Spot lamp 1 strength", "Spot lamp 1 outer angle", "Spot lamp 1 aim Z"] {
            let field = window.get_by_label(label).rect();
            assert!(field.right() < panel && field.bottom() < 900.0, "{view}: {label} at {field}");
        }
        assert_eq!(window.query_all_by_label_contains("Counter mutes").count(), usize::from(view == "Table"), "{view}");
        window.get_by_label("Reset all lights");
    }
    type_over(&mut window, "Spot lamp 1 outer angle", "50");
    click(&mut window, "Reset master Counter");
    assert!(window.state().look().lights.groups.is_empty());
    click(&mut window, "Reset all lights");
    assert_eq!(*window.state().look(), Look::default());
    assert!(window.query_by_label("Reset all lights").is_none());
    // A panel has its spots there, too.
    window.get_all_by_label("panel").next().unwrap().click();
    window.run_steps(4);
    click(&mut window, "Spots");
    window.get_by_label("Spots on panel");
}

/// That room with 320 more lamps.
fn crowded_room() -> Window {
    let mut gltf: Value = serde_json::from_slice(&lit_room()).unwrap();
    let nodes = gltf["nodes"].as_array_mut().unwrap();
    let first = nodes.len();
    nodes.extend((0..320).map(|idx| {
        json!({"name": format!("spot {idx:03}"), "translation": [0.001 * f64::from(idx), 0.1, -0.6],
            "extensions": {"KHR_lights_punctual": {"light": 0}}})
    }));
    let roots = gltf["scenes"][0]["nodes"].as_array_mut().unwrap();
    roots.extend((first..first + 320).map(|node| json!(node)));
    open(Source::Bytes { name: "room.gltf".into(), bytes: serde_json::to_vec(&gltf).unwrap() })
}

#[test]
fn the_table_brings_what_is_clicked_in_the_picture_into_view() {
    let mut window = crowded_room();
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    click(&mut window, "Table");
    for _ in 0..2 {
        click(&mut window, "Sort by name");
    }
    assert!(window.query_by_label("Mute left").is_none(), "below 320 others");
    window.hover_at(window.get_by_label("Picture").rect().center());
    window.run_steps(2);
    let at = window.get_by_label("left in the picture").rect().center();
    click_with(&mut window, at, PointerButton::Primary, Modifiers::NONE);
    window.run_steps(60);
    let [above, line, below] =
        ["Group lights by", "Mute left", "Select nothing"].map(|label| window.get_by_label(label).rect());
    assert!(above.bottom() < line.top() && line.bottom() < below.top(), "{line} between {above} and {below}");
}

#[test]
fn a_long_table_draws_the_lines_that_are_seen() {
    let mut window = crowded_room();
    wait(&mut window, |app| app.session().basis().is_some());
    click(&mut window, "Table");
    click(&mut window, "Sort by name");
    let n_drawn = |window: &Window| window.query_all_by_label_contains("Mute spot").count();
    assert!((10..60).contains(&n_drawn(&window)), "{}", n_drawn(&window));
    let kinds = |window: &Window| window.get_by_label("Sort by kind").rect().x_range();
    let before = kinds(&window);
    assert!(window.query_by_label("Mute spot 319").is_none());
    let at = window.get_by_label("Mute spot 000").rect().center();
    window.hover_at(at);
    window.event(Event::MouseWheel {
        unit: eframe::egui::MouseWheelUnit::Point,
        delta: eframe::egui::vec2(0.0, -20_000.0),
        phase: eframe::egui::TouchPhase::Move,
        source: eframe::egui::MouseWheelSource::Unknown,
        modifiers: Modifiers::NONE,
    });
    window.run_steps(60);
    window.get_by_label("Mute spot 319");
    assert!(window.query_by_label("Mute spot 000").is_none());
    assert_eq!(kinds(&window), before, "the columns stay");
}

#[test]
fn the_square_of_colors_stays_where_it_is_pressed() {
    let mut window = lit();
    click(&mut window, "left color");
    click(&mut window, "Color");
    let place = |window: &Window| window.get_by_label("Saturation and value").rect();
    let before = place(&window);
    window.drag_at(before.center());
    window.run_steps(3);
    assert_eq!(place(&window), before);
    window.get_by_label("left hex");
    window.hover_at(before.center() + eframe::egui::vec2(20.0, 10.0));
    window.run_steps(3);
    assert_eq!(place(&window), before);
    window.drop_at(before.center());
    window.run_steps(3);
    assert_eq!(place(&window), before);
}

#[test]
fn the_keyboard_stays_with_its_light_while_rows_come_and_go() {
    let mut window = lit();
    for view in ["List", "Board"] {
        click(&mut window, view);
        click(&mut window, "Add lamp");
        click(&mut window, "Point");
        wait(&mut window, App::is_settled);
        let before = window.get_by_label("Mute panel").rect();
        window.get_by_label("Mute panel").focus();
        window.run_steps(2);
        window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
        window.run_steps(4);
        assert!(window.state().look().lights.lamps.is_empty());
        let mute = window.get_by_label("Mute panel");
        assert!(mute.rect() != before && mute.accesskit_node().is_focused(), "in the {view}");
        press(&mut window, Key::Space);
        assert!(window.state().look().lights.own_setting("panel").muted);
        let toggled = window.get_by_label("Mute panel").accesskit_node().toggled();
        assert_eq!(format!("{toggled:?}"), "Some(True)", "and who does not see it is told");
        click(&mut window, "Undo");
    }

    // A window of a color stays with its light as well.
    click(&mut window, "List");
    click(&mut window, "panel color");
    window.get_by_label("Collapse Counter").click_accesskit();
    window.run_steps(4);
    assert!(window.query_by_label("Mute left").is_none());
    click(&mut window, "Kelvin");
    assert!(window.state().look().lights.own_setting("panel").kelvin.is_some());
}

/// Where the number beside a slider is.
fn number_beside(window: &Window, label: &str) -> Pos2 {
    window.get_all_by_role_and_label(Role::SpinButton, label).last().unwrap().rect().center()
}

#[test]
fn a_color_temperature_beyond_the_slider_stays_until_another_one_is_typed() {
    let mut window = lit();
    select(&mut window, &["left"]);
    let kelvin = |window: &Window| window.state().look().lights.own_setting("left").kelvin;
    // The first one is what a light counts from that has none.
    for (text, wanted) in [("3000", 3000.0), ("20000", 20_000.0), ("3333.4", 3333.4), ("1000 K", 1000.0)] {
        type_over(&mut window, "Selected lights color temperature", text);
        assert_eq!(kelvin(&window), Some(wanted), "{text}");
        click(&mut window, "left color");
        window.run_steps(4);
        let number = window.get_all_by_role_and_label(Role::SpinButton, "left kelvin").last().unwrap();
        let shown = number.accesskit_node().value().unwrap();
        assert!(shown.starts_with(&format!("{wanted:.0}")), "{shown}");
        press(&mut window, Key::Escape);
        assert_eq!(kelvin(&window), Some(wanted), "a look at it changes nothing");
    }
    for (text, wanted) in [("15000", 15_000.0), ("2.7k", 2700.0), ("200000", 100_000.0)] {
        click(&mut window, "left color");
        let at = number_beside(&window, "left kelvin");
        window.hover_at(at);
        window.run_steps(2);
        window.drag_at(at);
        window.drop_at(at);
        window.run_steps(3);
        window.key_press_modifiers(Modifiers::COMMAND, Key::A);
        window.run_steps(1);
        window.event(Event::Text(text.into()));
        window.run_steps(2);
        press(&mut window, Key::Enter);
        assert_eq!(kelvin(&window), Some(wanted), "{text}");
        press(&mut window, Key::Escape);
    }
}

#[test]
fn a_color_temperature_leaves_a_colored_light_of_the_file_its_lumen() {
    let mut gltf: Value = serde_json::from_slice(&lit_room()).unwrap();
    let bulb = gltf["extensions"]["KHR_lights_punctual"]["lights"].as_array_mut().unwrap().last_mut().unwrap();
    bulb["color"] = json!([1, 0.7, 0.4]);
    let mut window = open(Source::Bytes { name: "room.gltf".into(), bytes: serde_json::to_vec(&gltf).unwrap() });
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    click(&mut window, "Unit of intensities");
    click(&mut window, "lm, luminous flux");
    let lumens = |window: &Window| {
        let number = window.get_by_label("left lm").accesskit_node().value().unwrap();
        number.split_whitespace().next().unwrap().parse::<f64>().unwrap()
    };
    let of_file = lumens(&window);
    click(&mut window, "left color");
    click(&mut window, "Kelvin");
    assert!((lumens(&window) - of_file).abs() < 1e-6, "{} instead of {of_file}", lumens(&window));
    assert!((intensity(&window, "left") - 0.742).abs() < 1e-3, "{}", intensity(&window, "left"));
    click(&mut window, "Candle");
    assert!((lumens(&window) - of_file).abs() < 1e-6);
    click(&mut window, "From file");
    assert_eq!(*window.state().look(), Look::default());
}

#[test]
fn what_is_set_for_many_lights_counts_for_all_where_the_first_has_it_already() {
    let mut window = lit();
    let all = ["left", "middle", "right"];
    type_over(&mut window, "middle factor", "0.5");
    select(&mut window, &all);
    type_over(&mut window, "Selected lights factor", "1");
    assert_eq!(*window.state().look(), Look::default());

    let kelvins = |window: &Window| all.map(|key| window.state().look().lights.own_setting(key).kelvin);
    click(&mut window, "left color");
    click(&mut window, "Kelvin");
    click(&mut window, "Warm");
    press(&mut window, Key::Escape);
    assert_eq!(kelvins(&window), [Some(2700.0), None, None]);
    type_over(&mut window, "Selected lights color temperature", "2700");
    assert_eq!(kelvins(&window), [Some(2700.0); 3]);

    click(&mut window, "left color");
    click(&mut window, "From file");
    press(&mut window, Key::Escape);
    click(&mut window, "Selected lights color");
    click(&mut window, "From file");
    press(&mut window, Key::Escape);
    assert_eq!(*window.state().look(), Look::default());
}

#[test]
fn an_offset_that_is_dragged_there_and_back_leaves_no_trace() {
    let mut window = lit();
    type_over(&mut window, "left factor", "0.3");
    select(&mut window, &["left", "right"]);
    let look = window.state().look().clone();
    let from = window.get_by_label("Change selected lights by EV").rect().center();
    window.hover_at(from);
    window.run_steps(2);
    window.drag_at(from);
    window.run_steps(2);
    for x in [8.0, 400.0, 1100.0] {
        window.hover_at(from + eframe::egui::vec2(x, 0.0));
        window.run_steps(2);
    }
    assert!(intensity(&window, "right") > 1e5 && intensity(&window, "left") > 1e5);
    for x in [400.0, 8.0, 0.0] {
        window.hover_at(from + eframe::egui::vec2(x, 0.0));
        window.run_steps(2);
    }
    window.drop_at(from);
    window.run_steps(3);
    assert_eq!(*window.state().look(), look);
}

#[test]
fn shift_selects_what_lies_between_in_a_sorted_table() {
    let mut window = lit();
    click(&mut window, "Table");
    for _ in 0..2 {
        click(&mut window, "Sort by name");
    }
    select(&mut window, &["right"]);
    window.event(Event::ModifiersChanged(Modifiers::SHIFT));
    let at = name(&window, "middle");
    click_with(&mut window, at, PointerButton::Primary, Modifiers::SHIFT);
    window.event(Event::ModifiersChanged(Modifiers::NONE));
    window.get_by_label("3 lights selected");
    click(&mut window, "Mute selected lights");
    let muted = |key: &str| window.state().look().lights.own_setting(key).muted;
    assert_eq!(["right", "panel", "middle", "left", "lamp"].map(muted), [true, true, true, false, false]);
}

#[test]
fn lights_and_groups_get_their_names_and_marks_on_the_board_and_in_the_table_too() {
    let mut window = lit();
    select(&mut window, &["left"]);
    for (view, from, to) in [("Board", "left", "Desk"), ("Table", "Desk", "Shelf")] {
        click(&mut window, view);
        press(&mut window, Key::F2);
        window.key_press_modifiers(Modifiers::COMMAND, Key::A);
        window.get_by_label(&format!("Name of {from}")).type_text(to);
        window.run_steps(2);
        press(&mut window, Key::Enter);
        assert_eq!(window.state().look().names["left"], to, "{view}");
        window.get_by_label(&format!("Mute {to}"));
    }
    click(&mut window, "Board");
    menu_by_key(&mut window, "Counter", Modifiers::NONE, Key::Menu);
    click(&mut window, "Rename…");
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.get_by_label("Name of Counter").type_text("Bar");
    window.run_steps(2);
    press(&mut window, Key::Enter);
    window.get_by_label("Mute group Bar");

    let n_marked = |window: &Window| {
        ["Differs from the file", "Something in it differs from the file"]
            .map(|words| window.query_all_by_label(words).count())
    };
    for view in ["Board", "List"] {
        click(&mut window, view);
        assert_eq!(n_marked(&window), [0, 0], "{view}");
        click(&mut window, "Mute middle");
        assert_eq!(n_marked(&window), [1, 1], "{view}");
        click(&mut window, "Mute middle");
    }
}

#[test]
fn the_banner_of_a_solo_of_long_names_keeps_its_button_within_the_picture() {
    let mut gltf: Value = serde_json::from_slice(&lit_room()).unwrap();
    let long = |name: &str| format!("{name} of the collection of lamps below the ceiling of the entrance hall");
    for node in gltf["nodes"].as_array_mut().unwrap() {
        let name = node["name"].as_str().unwrap_or_default().to_owned();
        if ["left", "middle", "right"].contains(&name.as_str()) {
            node["name"] = json!(long(&name));
        }
    }
    let bytes = serde_json::to_vec(&gltf).unwrap();
    let mut window = open(Source::Bytes { name: "room.gltf".into(), bytes });
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    click(&mut window, "Solo group Counter");
    window.run_steps(4);
    let [button, picture] = ["Clear solo", "Picture"].map(|label| window.get_by_label(label).rect());
    assert!(picture.contains_rect(button), "{button} of {picture}");
    click(&mut window, "Clear solo");
    assert!(window.query_by_label("Clear solo").is_none());
}

#[test]
fn the_name_of_a_lamp_that_was_reset_away_is_not_that_of_the_next_one() {
    let mut window = lit();
    let add = |window: &mut Window| {
        click(window, "Add lamp");
        click(window, "Point");
        wait(window, App::is_settled);
    };
    add(&mut window);
    rename(&mut window, "Point lamp 1", "Door");
    reach(&mut window, "Reset all lights");
    assert_eq!(*window.state().look(), Look::default());
    add(&mut window);
    window.get_by_label("Mute Point lamp 1");
}

#[test]
fn what_many_lights_differ_in_is_told_in_a_small_window() {
    let mut window = lit();
    select(&mut window, &["left"]);
    type_over(&mut window, "Selected lights color temperature", "2700");
    select(&mut window, &["right", "left"]);
    window.set_size(vec2(900.0, 600.0));
    window.run_steps(5);
    let end = window.get_by_label("Picture").rect().left();
    let is_words = |node: &egui_kittest::Node<'_>| node.accesskit_node().role() == Role::Label;
    let told = window.query_all_by_label("mixed").find(is_words).unwrap().rect();
    assert!(told.width() > 10.0 && told.right() <= end, "{told:?} ends behind {end}");
}

/// Presses keys so many times within one frame, as where frames take long.
fn press_at_once(window: &mut Window, modifiers: Modifiers, key: Key, n_times: usize) {
    for pressed in [true, false].repeat(n_times) {
        window.input_mut().events.push(Event::Key { key, physical_key: None, pressed, repeat: false, modifiers });
    }
    window.run_steps(4);
}

#[test]
fn keys_that_are_pressed_several_times_in_a_frame_count_as_often() {
    let mut window = lit();
    select(&mut window, &["left"]);
    press_at_once(&mut window, Modifiers::NONE, Key::CloseBracket, 9);
    assert!((intensity(&window, "left") - 8.0).abs() < 1e-3, "{}", intensity(&window, "left"));
    press_at_once(&mut window, Modifiers::NONE, Key::OpenBracket, 6);
    assert!((intensity(&window, "left") - 2.0).abs() < 1e-3, "{}", intensity(&window, "left"));
    click(&mut window, "Reset selected lights");
    for label in ["Mute left", "Mute middle", "Mute right"] {
        click(&mut window, label);
    }
    let muted =
        |window: &Window| ["left", "middle", "right"].map(|key| window.state().look().lights.own_setting(key).muted);
    press_at_once(&mut window, Modifiers::COMMAND, Key::Z, 2);
    assert_eq!(muted(&window), [true, false, false]);
    press_at_once(&mut window, Modifiers::COMMAND, Key::Y, 2);
    assert_eq!(muted(&window), [true; 3]);
    press_at_once(&mut window, Modifiers::NONE, Key::T, 2);
    assert!(window.query_by_label("Mute left").is_some(), "closed and opened again");
}
