//! Dialogs and panels in the window of a small laptop: at every size of letters all of them can be read and answered.

use std::collections::{BTreeSet, HashMap};

use clerestory::session::{BakeState, Source, Stage};
use eframe::egui::{Key, Modifiers, Rangef, Rect, Role, Vec2, vec2};
use egui_kittest::Node;
use egui_kittest::kittest::{NodeT, Queryable};

use crate::desk::{
    Kept, Window, ask_for, ask_to_close, baked, click, hints, open, open_again, open_with, quick, room, save_as, wait,
};

/// Size of the window in points, with letters of the usual size.
const SCREEN: Vec2 = vec2(1280.0, 800.0);
/// Sizes of letters, of the usual one.
const LETTERS: [f32; 3] = [1.0, 1.5, 2.0];

/// Buttons, one after the other, that lead to questions about files.
const WAYS: [&[&str]; 13] = [
    &["Open…"],
    &["Open pictures…"],
    &["Open look…"],
    &["Presets", "Looks of a file…"],
    &["Save look…"],
    &["Export…"],
    &["Export frames…"],
    &["Contact sheet…"],
    &["Save as glTF…"],
    &["Save bake…"],
    &["Match picture…"],
    &["Save schedule…"],
    &["Add lamp", "IES or LDT…"],
];

/// What letters of a size leave of the window; no hint lies over it.
fn with_letters(window: &mut Window, letters: f32) {
    window.remove_cursor();
    window.set_size(SCREEN / letters);
    window.run_steps(5);
}

/// A window in which nothing has to be scrolled to.
fn with_room(window: &mut Window) {
    window.set_size(vec2(1440.0, 3200.0));
    window.run_steps(5);
}

/// A look, a key of the timeline, and the sections of the right panel unfolded.
fn unfold(window: &mut Window) {
    with_room(window);
    for label in ["Keep look", "Timeline", "Add key", "Look", "Measure", "Solve for light", "Navigation", "Numbers"] {
        click(window, label);
    }
}

/// What something is called, or says.
fn name_of(node: &Node<'_>) -> String {
    let node = node.accesskit_node();
    node.label().or_else(|| node.value()).unwrap_or_default()
}

/// Whether a hand can do anything with it.
fn is_for_hands(node: &Node<'_>) -> bool {
    matches!(
        node.accesskit_node().role(),
        Role::Button | Role::CheckBox | Role::RadioButton | Role::ComboBox | Role::SpinButton | Role::TextInput
    )
}

/// All words and buttons of the dialog that is open, from its title on.
fn widgets(window: &Window) -> Vec<Node<'_>> {
    let is_widget = |node: &Node<'_>| is_for_hands(node) || node.accesskit_node().role() == Role::Label;
    window.get_by_role(Role::Dialog).children_recursive().filter(is_widget).collect()
}

/// Holds that a question about a file is whole within the window, and what is asked beside the path once it is scrolled to, between that
/// and the title.
fn assert_fits(window: &mut Window, what: &str) {
    let whole = window.ctx.content_rect();
    let (title, path) = (widgets(window)[0].rect(), window.get_by_label("Path").rect());
    assert!(whole.contains_rect(title) && whole.contains_rect(path), "{what}: {title} and {path} of {whole}");
    let n_above = widgets(window).iter().position(|node| name_of(node) == "Path").unwrap();
    for nth in 1..widgets(window).len() {
        let is_above = nth < n_above;
        if is_above {
            widgets(window)[nth].scroll_to_me();
            window.run_steps(3);
        }
        let node = widgets(window)[nth];
        let (name, place) = (name_of(&node), node.rect());
        let rows =
            if is_above { Rangef::new(title.bottom(), path.top()) } else { Rangef::new(path.top(), whole.bottom()) };
        let seen = Rect::from_x_y_ranges(path.x_range(), rows).expand(2.0);
        assert!(seen.contains_rect(place), "{what}: {name} at {place} of {seen}");
    }
}

#[test]
fn every_question_about_a_file_can_be_read_and_answered_in_a_small_window() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = baked();
    unfold(&mut window);
    for way in WAYS {
        with_room(&mut window);
        way.iter().for_each(|label| click(&mut window, label));
        if way == ["Export…"] {
            // Most is asked about a part of an EXR.
            let path = folder.path().join("room.exr").display().to_string();
            window.get_by_label("Path").set_text_value_accesskit(&path);
            window.run_steps(3);
            click(&mut window, "Region");
        }
        for letters in LETTERS {
            with_letters(&mut window, letters);
            assert_fits(&mut window, &format!("{way:?} at {letters}"));
        }
        click(&mut window, "Cancel");
        assert!(window.query_by_label("Path").is_none(), "{way:?} is closed by a click");
    }
    // And so is the click that does it.
    for (label, name) in [("Save look…", "a.look"), ("Export…", "a.png"), ("Contact sheet…", "sheet.png")] {
        let path = folder.path().join(name);
        with_room(&mut window);
        ask_for(&mut window, label, &path);
        with_letters(&mut window, 2.0);
        click(&mut window, "Save");
        assert!(window.query_by_label("Path").is_none());
        wait(&mut window, |_| path.exists());
    }
}

#[test]
fn a_button_that_opens_no_dialog_of_the_desktop_says_why() {
    let mut window = baked();
    click(&mut window, "Open…");
    assert!(window.get_by_label("Browse…").accesskit_node().is_disabled());
    assert!(hints(&mut window, "Browse…", "type the path in the field"));
}

#[test]
fn the_list_of_keys_can_be_read_and_closed_in_a_small_window() {
    let mut window = baked();
    for letters in LETTERS {
        with_letters(&mut window, letters);
        let before: BTreeSet<_> =
            window.query_all_by_role(Role::Label).map(|node| node.accesskit_node().id()).collect();
        window.key_press(Key::F1);
        window.run_steps(6);
        let (whole, close) = (window.ctx.content_rect(), window.get_by_label("Close window").rect());
        assert!(whole.contains_rect(close), "{close} of {whole}");
        let lines = window.query_all_by_role(Role::Label).filter(|node| !before.contains(&node.accesskit_node().id()));
        let lines: Vec<(String, Rangef)> = lines.map(|node| (name_of(&node), node.rect().x_range())).collect();
        assert!(lines.len() > 80, "{} words", lines.len());
        for (words, columns) in lines {
            let is_whole = columns.min >= whole.left() && columns.max <= whole.right();
            assert!(is_whole, "{words} at {columns:?} of {whole}");
        }
        window.get_by_label("This list").scroll_to_me();
        window.run_steps(4);
        let last = window.get_by_label("This list").rect();
        assert!(last.top() > close.bottom() && last.bottom() < whole.bottom(), "{last} of {whole}");
        click(&mut window, "Close window");
        assert!(window.query_by_label("Keyboard and mouse").is_none(), "a click closes it");
    }
}

#[test]
fn all_recent_files_are_reached_in_the_least_window() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.gltf");
    std::fs::write(&path, room()).unwrap();
    let halls: Vec<String> = (0..11).map(|nth| format!("\"/rooms/hall {nth}.glb\"")).collect();
    let kept = Kept(HashMap::from([("recent".into(), format!("[{}]", halls.join(", ")))]));
    let mut window = open_again(&path, kept);
    wait(&mut window, |app| app.session().stage == Stage::Ready);
    window.set_size(vec2(900.0, 600.0) / 2.0);
    window.run_steps(5);
    click(&mut window, "Recent");
    let whole = window.ctx.content_rect();
    for label in ["room.gltf", "hall 10.glb", "Built-in gallery"] {
        window.get_by_label(label).scroll_to_me();
        window.run_steps(4);
        let place = window.get_by_label(label).rect();
        assert!(whole.contains_rect(place), "{label} at {place} of {whole}");
    }
}

/// Holds that a question is whole within the window and nothing of it lies over something else; answers it by a click.
fn answer(window: &mut Window, title: &str, label: &str) {
    for letters in LETTERS {
        with_letters(window, letters);
        let whole = window.ctx.content_rect();
        let places: Vec<(String, Rect)> =
            widgets(window).iter().map(|node| (name_of(node), node.rect().shrink(0.5))).collect();
        assert_eq!(places[0].0, title);
        for (nth, (name, place)) in places.iter().enumerate() {
            assert!(whole.contains_rect(*place), "{name} at {place} of {whole}");
            let below = places[..nth].iter().find(|(_, other)| other.intersects(*place));
            assert!(below.is_none(), "{name} at {place} lies over {below:?}");
        }
    }
    window.get_by_role(Role::Dialog).get_by_label(label).click();
    window.run_steps(4);
    assert!(window.query_by_label(title).is_none(), "{title} is answered");
    with_room(window);
}

/// A folder of two gray pictures.
fn stage() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (light, gray) in [("left", 60), ("right", 120)] {
        let shade = |x: u32, y: u32| image::Luma([gray + (x + y) as u8]);
        image::GrayImage::from_fn(32, 24, shade).save(folder.path().join(format!("{light}.png"))).unwrap();
    }
    folder
}

#[test]
fn every_question_about_work_can_be_read_and_answered_in_a_small_window() {
    let (home, pictures) = (tempfile::tempdir().unwrap(), stage());
    let look = home.path().join("room.look");
    let opened = || {
        let source = Source::Bytes { name: "room.gltf".into(), bytes: room() };
        let mut window = open_with(source, quick(), Some(home.path()));
        wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
        with_room(&mut window);
        window
    };
    let mut window = opened();
    click(&mut window, "Mute lamp");
    assert!(!ask_to_close(&mut window));
    answer(&mut window, "Save the look?", "Cancel");
    std::fs::write(&look, "precious").unwrap();
    save_as(&mut window, "Save look…", &look);
    answer(&mut window, "Replace the file?", "Replace");
    assert!(std::fs::read_to_string(&look).unwrap().contains("muted"));

    std::fs::write(&look, r#"{"clerestory": 1}"#).unwrap();
    click(&mut window, "Mute panel");
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.run_steps(3);
    answer(&mut window, "Replace the look?", "Cancel");

    for label in ["Keep look", "Timeline", "Add key", "Look"] {
        click(&mut window, label);
    }
    window.get_by_label("Frames per second").set_value_accesskit(240.0);
    window.get_by_label("Time of the key").set_value_accesskit(120.0);
    window.run_steps(3);
    save_as(&mut window, "Export frames…", &home.path().join("f_#####.png"));
    assert!(!ask_to_close(&mut window));
    answer(&mut window, "Stop writing frames?", "Go on writing");

    // What is left behind is offered at the next start.
    eframe::App::on_exit(window.state_mut());
    drop(window);
    let mut window = opened();
    answer(&mut window, "Recover unsaved lights?", "Ask again later");
    drop(window);

    let mut window = open(Source::File(pictures.path().into()));
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    assert!(!ask_to_close(&mut window));
    answer(&mut window, "Save the bake?", "Cancel");
}

/// The panel that something stands in.
fn panel_of<'tree>(node: &Node<'tree>) -> Node<'tree> {
    let mut above = std::iter::successors(node.parent(), |node| node.parent());
    above.find(|node| node.accesskit_node().role() == Role::Pane).unwrap()
}

#[test]
fn nothing_of_the_panels_is_cut_off_in_a_small_window() {
    let mut window = baked();
    unfold(&mut window);
    click(&mut window, "Movable lamps");
    for letters in LETTERS {
        with_letters(&mut window, letters);
        // Where there is room for one panel, a key brings the other.
        for (sign, key) in [("Mute lamp", Key::T), ("Metering", Key::N)] {
            if window.query_by_label(sign).is_none() {
                window.key_press(key);
                window.run_steps(6);
            }
            let (whole, picture) = (window.ctx.content_rect(), window.get_by_label("Picture").rect());
            let columns = match key {
                Key::T => Rangef::new(whole.left(), picture.left() - 4.0),
                _ => Rangef::new(picture.right(), whole.right() - 4.5),
            };
            let panel = panel_of(&window.get_by_label(sign));
            let widgets: Vec<Node<'_>> = panel.children_recursive().filter(is_for_hands).collect();
            assert!(widgets.len() > 5, "{} at {letters}", widgets.len());
            for widget in widgets {
                let own = widget.rect().x_range();
                let is_whole = own.min >= columns.min && own.max <= columns.max;
                assert!(is_whole, "{} at {own:?} of {columns:?}, {letters}", name_of(&widget));
            }
        }
    }
}

#[test]
fn the_folder_below_the_field_is_that_of_the_path() {
    let mut window = baked();
    click(&mut window, "Export…");
    // A scene that lies in no file is written where the program was started.
    let started_in = std::env::current_dir().unwrap();
    let told = |folder: &std::path::Path| format!("In {}", folder.display());
    let type_path = |window: &mut Window, path: &str| {
        window.get_by_label("Path").set_text_value_accesskit(path);
        window.run_steps(3);
    };
    type_path(&mut window, "picture.png");
    window.get_by_label(&told(&started_in));
    type_path(&mut window, "new/folder/picture.png");
    window.get_by_label(&told(&started_in.join("new/folder")));
    type_path(&mut window, "/elsewhere/picture.png");
    assert!(window.query_by_label(&told(&started_in)).is_none(), "a whole path says it itself");
}
