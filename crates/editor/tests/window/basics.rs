//! The window, driven by its labels: a tiny room with a lamp and a panel is opened, baked and relit.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clerestory::app::{App, Start};
use clerestory::look::Look;
use clerestory::panels::shortcuts::full_screen;
use clerestory::session::{BakeSettings, BakeState, Source, Stage};
use clerestory_transport::archive::{self, part_state};
use clerestory_transport::bake::BakeConfig;
use clerestory_transport::camera::Film;
use eframe::egui::{
    Event, Key, KeyboardShortcut, Memory, Modifiers, Role, ThemePreference, ViewportCommand, pos2, vec2,
};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use glam::Vec3;

use crate::desk::{
    Dropped, Kept, SMALL, Window, ask_for, ask_for_menu, ask_to_close, baked, baked_larger, click, click_at, drag,
    hints, noisy_stage, on_screen, open, open_with, pull, quick, quit_by_key, reach, replace_and_reload, room, save_as,
    type_over, wait,
};

#[test]
fn a_dragged_slider_relights_and_is_one_step_of_undo() {
    let mut window = baked();
    let slider = window.get_by_label("lamp intensity").rect();
    let n_before = window.state().n_pictures();
    let ev_before = window.state().shown_ev();
    let from = pos2(slider.left() + 0.6 * slider.width(), slider.center().y);
    drag(&mut window, from, pos2(slider.right() - 6.0, slider.center().y));
    let intensity = window.state().look().lights.lights["lamp"].intensity;
    assert!(intensity > 2.0, "{intensity}");
    wait(&mut window, |app| app.n_pictures() > n_before && app.shown_ev() < ev_before - 0.2);

    click(&mut window, "Undo");
    assert_eq!(*window.state().look(), Look::default(), "one drag is one step");
    assert!(window.query_all_by_label_contains("Undone: `lamp`, intensity").next().is_some());
    wait(&mut window, |app| (app.shown_ev() - ev_before).abs() < 1e-3);
    window.key_press_modifiers(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
    window.run_steps(3);
    assert_eq!(window.state().look().lights.lights["lamp"].intensity, intensity);
}

#[test]
fn a_disabled_button_says_why() {
    let mut window = baked();
    assert!(hints(&mut window, "Undo", "Nothing was changed yet"));
    assert!(hints(&mut window, "Redo", "Nothing was undone"));
    assert!(hints(&mut window, "Open look…", "Light what is open by a .look file"));
    assert!(hints(&mut window, "Export…", "The scene itself"));
    click(&mut window, "Measure");
    assert!(hints(&mut window, "Clear", "Nothing is marked"));
}

#[test]
fn what_was_undone_cannot_be_done_again_once_something_else_was_done() {
    let mut window = baked();
    let slider = window.get_by_label("lamp intensity").rect();
    let at = |share: f32| pos2(slider.left() + share * slider.width(), slider.center().y);
    let can_redo = |window: &Window| !window.get_by_label("Redo").accesskit_node().is_disabled();
    for other in ["a drag", "a lamp"] {
        drag(&mut window, at(0.6), at(0.9));
        click(&mut window, "Undo");
        assert!(can_redo(&window) && *window.state().look() == Look::default());
        if other == "a drag" {
            drag(&mut window, at(0.6), at(0.3));
        } else {
            click(&mut window, "Add lamp");
            click(&mut window, "Point");
        }
        let look = window.state().look().clone();
        assert!(look != Look::default() && !can_redo(&window), "{other}");
        window.key_press_modifiers(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
        window.run_steps(3);
        assert_eq!(*window.state().look(), look, "{other}");
        click(&mut window, "Undo");
        assert_eq!(*window.state().look(), Look::default(), "{other}");
    }
}

#[test]
fn keys_fill_the_screen_and_close_the_window() {
    let mut window = baked();
    let sent = |window: &mut Window, keys: KeyboardShortcut, wanted: ViewportCommand| {
        let KeyboardShortcut { logical_key: key, modifiers } = keys;
        // All in one frame, whose commands are seen.
        window.input_mut().events.push(Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers });
        window.step();
        window.output().viewport_output.values().any(|output| output.commands.contains(&wanted))
    };
    let keys = full_screen(&window.ctx);
    assert!(sent(&mut window, keys, ViewportCommand::Fullscreen(true)));
    let keys = KeyboardShortcut::new(Modifiers::COMMAND, Key::Q);
    assert!(sent(&mut window, keys, ViewportCommand::Close));
}

/// Files in the cache of a home with some ending.
fn in_cache(home: &Path, ending: &str) -> Vec<PathBuf> {
    let listed = std::fs::read_dir(home.join("bakes")).into_iter().flatten().flatten().map(|file| file.path());
    listed.filter(|path| path.extension().is_some_and(|found| found == ending)).collect()
}

#[test]
fn a_bake_goes_on_where_an_editor_ended_and_ends_with_the_same_bytes() {
    let [whole, broken] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let config = BakeConfig { spp: 128, tolerance_db: 60.0, ..BakeConfig::default() };
    let opened =
        |home: &Path| open_with(Source::Bytes { name: "room.gltf".into(), bytes: room() }, config.clone(), Some(home));
    let finished = |home: &Path| {
        let mut window = opened(home);
        wait(&mut window, |app| app.session().bake == BakeState::Done && !in_cache(home, "transport").is_empty());
        let report = window.state().session().opened.as_ref().unwrap().report.join("; ");
        drop(window);
        (std::fs::read(&in_cache(home, "transport")[0]).unwrap(), report)
    };
    const TAKEN_UP: &str = "blocks were baked before; the rest follows";
    let (reference, report) = finished(whole.path());
    assert!(!report.contains(TAKEN_UP), "{report}");
    let mut window = opened(broken.path());
    let has_blocks = |home: &Path| {
        let parts = in_cache(home, "part");
        parts.first().and_then(|part| part_state(part).ok()).is_some_and(|state| state.n_done > 1)
    };
    wait(&mut window, |_| has_blocks(broken.path()));
    assert!(window.state().session().bake.is_running(), "it ended before it could be given up: make it longer");
    drop(window);
    assert!(has_blocks(broken.path()) && in_cache(broken.path(), "transport").is_empty());
    let (bytes, report) = finished(broken.path());
    assert!(report.contains(TAKEN_UP), "{report}");
    assert!(bytes == reference, "an interrupted bake has other bytes");
    assert_eq!(in_cache(broken.path(), "part"), Vec::<PathBuf>::new());
}

#[test]
fn the_next_start_finds_the_window_as_it_was_left_and_welcomes_nobody_twice() {
    let opened = |kept: Kept| {
        // A window borrows it for as long as it lives.
        let kept: &'static Kept = Box::leak(Box::new(kept));
        let config = quick();
        let settings = BakeSettings { camera_idx: 0, film: SMALL, config, illuminance: false, work_plane: None };
        let source = Source::Bytes { name: "room.gltf".into(), bytes: room() };
        let start = Start { welcome: true, ..Start::alone(source, Some(settings)) };
        let builder = Harness::builder().with_size(vec2(1440.0, 900.0));
        let mut window: Window = builder.build_eframe(|cc| {
            cc.storage = Some(kept);
            App::new(cc, start).unwrap()
        });
        wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
        window
    };
    let mut window = opened(Kept::default());
    // Who did not read the welcome yet finds it again.
    let mut window_again = opened(Kept::by(&mut window));
    drop(window);
    click(&mut window_again, "Got it");
    window_again.get_by_label("Mute lamp");
    window_again.key_press(Key::T);
    window_again.run_steps(3);
    let kept = Kept::by(&mut window_again);
    drop(window_again);
    assert_eq!(kept.0["device"], "auto");
    let mut window = opened(kept);
    assert!(window.query_by_label("Got it").is_none() && window.query_by_label("Mute lamp").is_none());
    let kept = Kept(HashMap::from([("device".into(), "cpu".into())]));
    drop(window);
    window = opened(kept);
    assert_eq!(Kept::by(&mut window).0["device"], "cpu", "the choice of a device stays");
}

#[test]
fn what_is_noted_about_a_scene_is_said_when_it_opens() {
    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    let of = |gltf: &mut serde_json::Value, list: &str, members: &[&str]| {
        for item in gltf[list].as_array_mut().unwrap() {
            members.iter().for_each(|member| _ = item.as_object_mut().unwrap().remove(*member));
        }
    };
    of(&mut gltf, "materials", &["emissiveFactor"]);
    of(&mut gltf, "nodes", &["extensions", "extras"]);
    let mut window = open(Source::Bytes { name: "dark.gltf".into(), bytes: serde_json::to_vec(&gltf).unwrap() });
    wait(&mut window, |app| app.session().opened.is_some());
    assert!(window.query_all_by_label_contains("Opened dark.gltf: ").next().is_some());
    let report = &window.state().session().opened.as_ref().unwrap().report;
    assert!(report.iter().any(|note| note.contains("no light")), "{report:?}");
}

#[test]
fn a_folder_that_is_opened_from_within_has_its_name() {
    // Tests run in the folder of their package, which holds no pictures.
    for (path, name) in [(".", "editor"), ("..", "crates")] {
        let source = Source::File(path.into());
        assert_eq!(source.name(), name);
        let mut window = open(source);
        wait(&mut window, |app| matches!(app.session().stage, Stage::Failed(..)));
        assert!(window.query_all_by_label(&format!("Could not open {name}")).next().is_some());
    }
}

#[test]
fn the_theme_that_was_chosen_is_there_at_the_next_start() {
    let opened = |kept: Kept| {
        // A window borrows it for as long as it lives.
        let kept: &'static Kept = Box::leak(Box::new(kept));
        let source = Source::Bytes { name: "letter.glb".into(), bytes: b"Dear Sir".to_vec() };
        let mut theme = None;
        let window: Window = Harness::builder().with_size(vec2(1440.0, 900.0)).build_eframe(|cc| {
            // What the toolkit keeps of itself is there before the window has any content.
            if let Some(memory) = eframe::get_value::<Memory>(kept, "egui") {
                cc.egui_ctx.memory_mut(|own| *own = memory);
            }
            cc.storage = Some(kept);
            let app = App::new(cc, Start::alone(source, None)).unwrap();
            // From here on the window of a test is dark.
            theme = Some(cc.egui_ctx.options(|options| options.theme_preference));
            app
        });
        (window, theme.unwrap())
    };
    let (mut window, theme) = opened(Kept::default());
    assert_eq!(theme, ThemePreference::Dark, "nobody has chosen yet");
    click(&mut window, "Theme");
    click(&mut window, "Light");
    assert_eq!(window.ctx.options(|options| options.theme_preference), ThemePreference::Light);
    assert!(eframe::App::persist_egui_memory(window.state()), "the toolkit keeps it with its own");
    let mut kept = Kept::by(&mut window);
    window.ctx.memory(|memory| eframe::set_value(&mut kept, "egui", memory));
    drop(window);
    assert_eq!(opened(kept).1, ThemePreference::Light);
}

#[test]
fn two_windows_of_a_user_keep_what_was_chosen_in_either() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("app.ron");
    let opened = |name: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, room()).unwrap();
        let config = quick();
        let settings = BakeSettings { camera_idx: 0, film: SMALL, config, illuminance: false, work_plane: None };
        let start = Start { state: Some(state.clone()), ..Start::alone(Source::File(path), Some(settings)) };
        let builder = Harness::builder().with_size(vec2(1440.0, 900.0));
        let mut window: Window = builder.build_eframe(|cc| App::new(cc, start).unwrap());
        wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
        window
    };
    let (mut older, mut newer) = (opened("older.gltf"), opened("newer.gltf"));
    older.key_press(Key::T);
    older.run_steps(3);
    click(&mut newer, "Theme");
    click(&mut newer, "Light");
    newer.run_steps(3);
    std::fs::write(&state, serde_json::to_string(&Kept::by(&mut newer).0).unwrap()).unwrap();
    drop(newer);
    let Kept(kept) = Kept::by(&mut older);
    assert_eq!(kept["theme"], "Light", "the older window chose none");
    assert!(kept["panels"].contains("false"), "{}", kept["panels"]);
    let recent: Vec<PathBuf> = serde_json::from_str(&kept["recent"]).unwrap();
    assert_eq!(recent, ["older.gltf", "newer.gltf"].map(|name| folder.path().join(name)));
    // What was left once is no change any more, and what others chose since stays.
    std::fs::write(&state, serde_json::json!({"panels": "(lights:true)"}).to_string()).unwrap();
    assert_eq!(Kept::by(&mut older).0["panels"], "(lights:true)");
}

/// The room, opened by a user whose folder is named.
fn room_of(home: &Path) -> Window {
    open_with(Source::Bytes { name: "room.gltf".into(), bytes: room() }, quick(), Some(home))
}

/// The same, once it is there.
fn ready_of(home: &Path) -> Window {
    let mut window = room_of(home);
    wait(&mut window, |app| app.session().stage == Stage::Ready);
    window
}

#[test]
fn unsaved_lights_are_offered_after_the_editor_ended_without_asking() {
    let home = tempfile::tempdir().unwrap();
    let open = || ready_of(home.path());
    let mut window = open();
    assert!(window.query_by_label("Recover").is_none());
    click(&mut window, "Mute lamp");
    let look = window.state().look().clone();
    wait(&mut window, |_| home.path().join("unsaved/0.json").exists());
    drop(window);

    let mut window = open();
    window.get_by_label("Recover");
    window.key_press(Key::C);
    window.run_steps(3);
    assert!(window.query_by_label("View of the camera").is_none(), "keys are for the question");
    click(&mut window, "Recover");
    assert_eq!(*window.state().look(), look);
    drop(window);

    let mut window = open();
    click(&mut window, "Ask again later");
    assert_eq!(*window.state().look(), Look::default());
    drop(window);

    let mut window = open();
    click(&mut window, "Discard");
    drop(window);
    assert!(open().query_by_label("Recover").is_none());
}

#[test]
fn lights_are_kept_at_once_where_the_system_ends_the_program_without_asking() {
    let home = tempfile::tempdir().unwrap();
    let mut window = ready_of(home.path());
    click(&mut window, "Mute lamp");
    let look = window.state().look().clone();
    // Nobody waits until it has been unsaved for a while.
    eframe::App::on_exit(window.state_mut());
    drop(window);
    let mut window = ready_of(home.path());
    click(&mut window, "Recover");
    assert_eq!(*window.state().look(), look);
}

#[test]
fn what_a_second_window_left_is_offered_once_that_of_the_first_is_saved() {
    let home = tempfile::tempdir().unwrap();
    let open = || ready_of(home.path());
    let (mut first, mut second) = (open(), open());
    click(&mut first, "Mute lamp");
    wait(&mut first, |_| home.path().join("unsaved/0.json").exists());
    click(&mut second, "Mute panel");
    wait(&mut second, |_| home.path().join("unsaved/1.json").exists());
    drop((first, second));

    let mut window = open();
    click(&mut window, "Recover");
    let muted = |window: &Window| window.state().look().lights.lights.keys().cloned().collect::<Vec<_>>();
    let newer = muted(&window);
    window.run_steps(3);
    assert!(window.query_by_label("Recover").is_none(), "what was recovered is not saved yet");
    save_as(&mut window, "Save look…", &home.path().join("newer.look"));
    click(&mut window, "Recover");
    assert_ne!(muted(&window), newer);
    assert_eq!([newer, muted(&window)].concat().len(), 2);
}

#[test]
fn who_takes_back_what_was_recovered_does_not_save_over_its_file() {
    let home = tempfile::tempdir().unwrap();
    let evening = home.path().join("evening.look");
    let mut window = ready_of(home.path());
    click(&mut window, "Mute lamp");
    save_as(&mut window, "Save look…", &evening);
    let saved = std::fs::read_to_string(&evening).unwrap();
    click(&mut window, "Mute panel");
    let changed = window.state().look().clone();
    let is_kept = |text: String| text.contains("panel");
    wait(&mut window, |_| std::fs::read_to_string(home.path().join("unsaved/0.json")).is_ok_and(is_kept));
    drop(window);

    let mut window = ready_of(home.path());
    click(&mut window, "Recover");
    assert_eq!(*window.state().look(), changed);
    click(&mut window, "Undo");
    assert_eq!(*window.state().look(), Look::default());
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.run_steps(3);
    assert_eq!(std::fs::read_to_string(&evening).unwrap(), saved);
    click(&mut window, "Cancel");
    click(&mut window, "Redo");
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.run_steps(3);
    assert!(std::fs::read_to_string(&evening).unwrap().contains("panel"));
}

#[test]
fn two_editors_on_one_scene_keep_their_work_apart() {
    let home = tempfile::tempdir().unwrap();
    let open = || room_of(home.path());
    let is_baked = |app: &App| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled();
    // Both bake the same at the same time, into one cache.
    let (mut first, mut second) = (open(), open());
    for _ in 0..40_000 {
        first.step();
        second.step();
        if is_baked(first.state()) && is_baked(second.state()) {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    wait(&mut first, is_baked);
    wait(&mut second, is_baked);
    click(&mut first, "Mute lamp");
    click(&mut second, "Mute panel");
    wait(&mut first, |_| home.path().join("unsaved/0.json").exists());
    wait(&mut second, |_| home.path().join("unsaved/1.json").exists());

    let mut third = open();
    wait(&mut third, is_baked);
    assert!(third.query_by_label_contains("Baked before").is_some(), "one of the same bakes was kept whole");
    assert!(third.query_by_label("Recover").is_none(), "both of the others live");
    drop((third, first));
    let mut fourth = open();
    wait(&mut fourth, |app| app.session().stage == Stage::Ready);
    click(&mut fourth, "Recover");
    assert!(fourth.state().look().lights.lights["lamp"].muted, "that of the one that is gone");
    assert!(fourth.query_by_label("Recover").is_none(), "and no other");
    assert!(second.state().look().lights.lights["panel"].muted);
}

#[test]
fn a_finished_bake_is_found_again() {
    let home = tempfile::tempdir().unwrap();
    let open = || {
        let mut window = room_of(home.path());
        wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
        window
    };
    let ev = {
        let window = open();
        assert!(window.query_by_label_contains("Baked at").is_some());
        window.state().shown_ev()
    };
    let mut window = open();
    assert!(window.query_by_label_contains("Baked before").is_some());
    assert!((window.state().shown_ev() - ev).abs() < 1e-3);
    // It answers to the lights as the one that was just baked.
    let n_before = window.state().n_pictures();
    click(&mut window, "Mute lamp");
    wait(&mut window, |app| app.n_pictures() > n_before && (app.shown_ev() - ev).abs() > 1e-2);
}

#[test]
fn a_whole_picture_is_there_long_before_the_preview_and_no_file_is_made_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let film = Film { width: 480, height: 360 };
    let settings = BakeSettings { camera_idx: 0, film, config: quick(), illuminance: false, work_plane: None };
    let source = Source::Bytes { name: "room.gltf".into(), bytes: room() };
    let start = Start::alone(source, Some(settings));
    let mut window: Window =
        Harness::builder().with_size(vec2(1440.0, 900.0)).build_eframe(|cc| App::new(cc, start).unwrap());
    let shown = |app: &App| app.session().shown.as_ref().map(|shown| shown.film());
    wait(&mut window, |app| app.session().is_glimpse() && app.n_pictures() > 0);
    window.get_by_label("A first look: sharper in a moment");
    click(&mut window, "Stop the bake");
    assert!(shown(window.state()) == Some(film) && window.state().session().shown.as_ref().unwrap().is_whole());
    // It answers to the lights as any picture does.
    let n_before = window.state().n_pictures();
    click(&mut window, "Mute lamp");
    wait(&mut window, |app| app.n_pictures() > n_before);
    click(&mut window, "Export…");
    assert!(window.query_by_label("Path").is_none());
    assert!(window.query_all_by_label_contains("wait until the bake has a whole picture").count() > 0);
    // What was found out stays while the bake is made, and makes way for its preview, in the same place of the list of views.
    let zoomed = |window: &Window| on_screen(window, Vec3::ZERO);
    let before = zoomed(&window);
    window.get_by_label("Start bake").scroll_to_me();
    window.run_steps(8);
    click(&mut window, "Start bake");
    wait(&mut window, |app| app.session().bake.is_running() || app.session().bake == BakeState::Done);
    wait(&mut window, |app| !app.session().is_glimpse());
    assert_eq!((shown(window.state()), window.state().session().views().len()), (Some(film), 1));
    assert!((zoomed(&window) - before).length() < 2.0, "{before:?} {:?}", zoomed(&window));
    save_as(&mut window, "Export…", &folder.path().join("a.png"));
    wait(&mut window, |_| folder.path().join("a.png").exists());
    assert_eq!(image::image_dimensions(folder.path().join("a.png")).unwrap(), (480, 360));
}

#[test]
fn mute_is_in_the_look_and_solo_is_not() {
    let mut window = baked();
    let ev_before = window.state().shown_ev();
    let row = window.get_by_label("Mute panel").rect();
    click(&mut window, "Solo panel");
    assert_eq!(*window.state().look(), Look::default());
    assert_eq!(window.get_by_label("Mute panel").rect(), row, "rows stay under the pointer");
    wait(&mut window, |app| (app.shown_ev() - ev_before).abs() > 1e-2);
    click(&mut window, "Clear solo");
    wait(&mut window, |app| (app.shown_ev() - ev_before).abs() < 1e-3);

    click(&mut window, "Mute lamp");
    assert!(window.state().look().lights.lights["lamp"].muted);
    click(&mut window, "Mute lamp");
    assert_eq!(*window.state().look(), Look::default(), "what is as the scene has it leaves no trace");
}

#[test]
fn a_lamp_that_is_off_in_the_file_is_muted_until_somebody_turns_it_on() {
    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    gltf["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"] = 0.into();
    gltf["nodes"][1]["extras"] =
        serde_json::json!({"clerestory": {"muted": {"lamp": {"color": [1, 1, 1], "strength": 3}}}});
    let mut window = open(Source::Bytes { name: "room.gltf".into(), bytes: serde_json::to_vec(&gltf).unwrap() });
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    let file = window.state().look().clone();
    assert!(file.lights.lights["lamp"].muted);
    assert_eq!(window.state().session().basis().unwrap().source("lamp").unwrap().strength, 3.0);
    assert!(window.query_by_label("Reset all lights").is_none(), "that is how the file has it");
    click(&mut window, "Mute lamp");
    assert_eq!(*window.state().look(), Look::default());
    click(&mut window, "Reset all lights");
    assert_eq!(*window.state().look(), file);
}

#[test]
fn a_spot_is_placed_and_dragged_in_the_picture() {
    let mut window = baked();
    let panel = |x: f32, z: f32| Vec3::new(x, 0.4, z);
    let (from, to) = (on_screen(&window, panel(-0.2, -0.7)), on_screen(&window, panel(0.2, -0.3)));
    drag(&mut window, from, to);
    let spots = window.state().look().lights.panels["panel"].clone();
    assert_eq!(spots.len(), 1);
    // The panel spans x from −0.4 to 0.4 and z from −0.9 to −0.1; its first edge runs along x, the second along z.
    let [u, v] = spots[0].position;
    assert!((u - 0.75).abs() < 0.02 && (v - 0.75).abs() < 0.02, "{u} {v}");

    // What is painted alone is told to those who cannot see it.
    window.get_by_label("panel, spot 1 at 75 %, 75 %");
    window.hover_at(to);
    window.run_steps(3);
    window.get_by_label("panel, spot 1, drag to move it");

    // Arrow keys go on from there, as it is seen from below: a quarter of one of 4 texels.
    let position = |window: &Window| window.state().look().lights.panels["panel"][0].position;
    let mut press = |modifiers, key, (du, dv): (f32, f32)| {
        let [u, v] = position(&window);
        window.key_press_modifiers(modifiers, key);
        window.run_steps(2);
        let [now_u, now_v] = position(&window);
        assert!((now_u - u - du).abs() < 1e-5 && (now_v - v - dv).abs() < 1e-5, "{key:?}: {u} {v} to {now_u} {now_v}");
    };
    press(Modifiers::NONE, Key::ArrowRight, (0.0625, 0.0));
    press(Modifiers::SHIFT, Key::ArrowLeft, (-0.00625, 0.0));
    press(Modifiers::NONE, Key::ArrowDown, (0.0, -0.0625));
    window.get_by_label("Spots on panel").focus();
    window.run_steps(2);
    let before = position(&window);
    window.key_press(Key::ArrowDown);
    window.run_steps(2);
    assert_eq!(position(&window), [before[0], before[1] + 0.0625]);

    click(&mut window, "Add spot to panel");
    assert_eq!(window.state().look().lights.panels["panel"].len(), 2);
    click(&mut window, "Delete spot of panel");
    click(&mut window, "Uniform");
    assert_eq!(*window.state().look(), Look::default());
}

#[test]
fn spots_that_the_file_marks_are_told_and_taken_hold_of() {
    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    let panel = gltf["nodes"].as_array_mut().unwrap().iter_mut().find(|node| node["name"] == "panel").unwrap();
    panel["extras"]["clerestory"]["spots"] =
        serde_json::json!([{"position": [0.25, 0.25], "radius": 0.2}, {"position": [0.5, 0.75], "radius": 0.1}]);
    let mut window = open(Source::Bytes { name: "room.gltf".into(), bytes: serde_json::to_vec(&gltf).unwrap() });
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    window.get_by_label("As in the file");
    let panel = |x: f32, z: f32| Vec3::new(x, 0.4, z);
    let (from, to) = (on_screen(&window, panel(-0.2, -0.7)), on_screen(&window, panel(0.2, -0.3)));
    window.hover_at(from);
    window.run_steps(3);
    window.get_by_label("panel, spot 1, drag to move it");
    drag(&mut window, from, to);
    let spots = window.state().look().lights.panels["panel"].clone();
    let [u, v] = spots[0].position;
    assert!((u - 0.75).abs() < 0.02 && (v - 0.75).abs() < 0.02, "{u} {v}");
    assert_eq!((spots.len(), spots[1].position), (2, [0.5, 0.75]), "the other one stays");
    click(&mut window, "As in the file");
    assert_eq!(*window.state().look(), Look::default());
}

#[test]
fn a_spot_that_is_dragged_goes_finely_with_shift_and_back_with_escape() {
    let mut window = baked();
    let panel = |x: f32, z: f32| Vec3::new(x, 0.4, z);
    let (from, to) = (on_screen(&window, panel(-0.2, -0.7)), on_screen(&window, panel(0.2, -0.3)));
    drag(&mut window, from, to);
    let placed = window.state().look().clone();
    let u = |window: &Window| window.state().look().lights.panels["panel"][0].position[0];
    pull(&mut window, to, from);
    assert!((u(&window) - 0.25).abs() < 0.02, "{}", u(&window));
    window.key_press(Key::Escape);
    window.run_steps(2);
    assert_eq!(*window.state().look(), placed);
    window.hover_at(from + (to - from) * 0.5);
    window.run_steps(2);
    window.drop_at(from);
    window.run_steps(3);
    assert_eq!(*window.state().look(), placed, "a drag that was put back is over");

    window.event(Event::ModifiersChanged(Modifiers::SHIFT));
    pull(&mut window, to, from);
    window.drop_at(from);
    window.event(Event::ModifiersChanged(Modifiers::NONE));
    window.run_steps(3);
    let way = 0.75 - u(&window);
    assert!((0.01..0.15).contains(&way), "about a tenth of the way: {way}");
}

#[test]
fn spots_are_added_and_deleted_by_the_menu_of_the_picture() {
    let mut window = baked();
    let panel = |x: f32, z: f32| Vec3::new(x, 0.4, z);
    let (first, second) = (on_screen(&window, panel(-0.2, -0.7)), on_screen(&window, panel(0.2, -0.3)));
    for at in [first, second] {
        ask_for_menu(&mut window, at);
        assert!(window.query_by_label("Delete this spot").is_none(), "there is none yet");
        click(&mut window, "Add a spot here");
    }
    let spots = |window: &Window| window.state().look().lights.panels["panel"].clone();
    assert_eq!(spots(&window).len(), 2);
    ask_for_menu(&mut window, first);
    click(&mut window, "Delete this spot");
    assert!(spots(&window).len() == 1 && spots(&window)[0].position[0] > 0.5, "{:?}", spots(&window));
}

#[test]
fn with_large_letters_a_hint_about_a_long_name_is_read_to_its_end() {
    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    let panel = gltf["nodes"].as_array_mut().unwrap().iter_mut().find(|node| node["name"] == "panel").unwrap();
    panel["name"] = "Luminous ceiling above the counter of the bar in the foyer".into();
    let mut window = open(Source::Bytes { name: "room.gltf".into(), bytes: serde_json::to_vec(&gltf).unwrap() });
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    window.set_size(vec2(1440.0, 900.0) / 2.0);
    window.run_steps(4);
    let at = on_screen(&window, Vec3::new(-0.2, 0.4, -0.7));
    window.hover_at(at);
    window.run_steps(3);
    let hint = window.get_by_label_contains("drag to place a spot of light").rect();
    let picture = window.get_by_label("Picture").rect();
    assert!(picture.contains_rect(hint), "{hint} in {picture}");
}

#[test]
fn the_spot_that_is_chosen_stays_so_while_another_one_is_deleted() {
    let mut window = baked();
    let places = [(-0.2, -0.7), (0.2, -0.3), (0.2, -0.7)].map(|(x, z)| on_screen(&window, Vec3::new(x, 0.4, z)));
    for at in places {
        ask_for_menu(&mut window, at);
        click(&mut window, "Add a spot here");
    }
    window.get_by_label("Spot 3 of 3");
    drag(&mut window, places[1], places[1] + vec2(10.0, 0.0));
    window.get_by_label("Spot 2 of 3");
    ask_for_menu(&mut window, places[0]);
    click(&mut window, "Delete this spot");
    window.get_by_label("Spot 1 of 2");
}

#[test]
fn a_spot_that_something_hides_has_no_handle() {
    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    let nodes = gltf["nodes"].as_array_mut().unwrap();
    let panel = nodes.iter_mut().find(|node| node["name"] == "panel").unwrap();
    panel["extras"]["clerestory"]["spots"] =
        serde_json::json!([{"position": [0.25, 0.25], "radius": 0.2}, {"position": [0.5, 0.75], "radius": 0.1}]);
    let of_panel = panel["mesh"].as_u64().unwrap() as usize;
    // A board below the back half of the panel.
    let mut board = gltf["meshes"][of_panel].clone();
    board["primitives"][0]["material"] = 0.into();
    let meshes = gltf["meshes"].as_array_mut().unwrap();
    meshes.push(board);
    let mesh = meshes.len() - 1;
    let nodes = gltf["nodes"].as_array_mut().unwrap();
    nodes.push(serde_json::json!(
        {"name": "board", "mesh": mesh, "scale": [0.6, 0.2, 0.6], "translation": [0, 0.05, -0.5]}));
    let node = nodes.len() - 1;
    gltf["scenes"][0]["nodes"].as_array_mut().unwrap().push(node.into());
    let mut window = open(Source::Bytes { name: "room.gltf".into(), bytes: serde_json::to_vec(&gltf).unwrap() });
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    window.get_by_label("panel, spot 2 at 50 %, 75 %");
    assert!(window.query_by_label("panel, spot 1 at 25 %, 25 %").is_none());
    let hidden = on_screen(&window, Vec3::new(-0.2, 0.4, -0.7));
    drag(&mut window, hidden, hidden + vec2(40.0, 10.0));
    assert_eq!(*window.state().look(), Look::default(), "nor is it taken hold of");
}

#[test]
fn exposure_and_tone_are_part_of_the_look() {
    let mut window = baked();
    let suits = window.state().shown_ev();
    // An arrow on a number that has the focus changes it by a step.
    window.get_by_label("Exposure compensation").focus();
    window.run_steps(2);
    (0..50).for_each(|_| window.key_press(Key::ArrowDown));
    window.run_steps(3);
    let added = window.state().look().display.compensation_ev;
    assert!(added < -0.3, "{added}");
    wait(&mut window, |app| (app.shown_ev() - suits - added).abs() < 0.01);
    let ev = window.state().shown_ev();
    click(&mut window, "Auto");
    let kept = window.state().look().display.exposure_ev.unwrap();
    assert!((kept - ev).abs() < 0.01, "{kept} {ev}");
    click(&mut window, "Tone curve");
    click(&mut window, "Neutral");
    assert_eq!(window.state().look().display.tone, clerestory_relight::Tone::Neutral);
    let dither = window.state().look().display.dither;
    reach(&mut window, "Dither");
    assert!(window.state().look().display.dither != dither);
}

#[test]
fn the_bar_tells_the_error_of_the_whole_and_of_half_of_it() {
    let window = baked_larger();
    let figures = window.state().session().figures.as_ref().unwrap();
    let (total, median) = (figures.error_db.total, figures.block_error_db.total.median);
    assert!(median > total, "a mean of squares is ruled by the worst: {median} {total}");
    window.get_by_label(&format!("{total:.1} dB, median {median:.1} dB"));
}

#[test]
fn the_bar_tells_the_device_its_time_and_the_size_of_the_picture() {
    let window = baked_larger();
    for words in ["Relight: CPU", " ms", "64 × 48"] {
        assert!(window.query_all_by_label_contains(words).next().is_some(), "{words}");
    }
}

fn show_false_color_of_lux(window: &mut Window) {
    click(window, "False color");
    let in_the_list = |node: &egui_kittest::Node<'_>| node.accesskit_node().role() == eframe::egui::Role::Button;
    window.query_all_by_label("Illuminance").find(in_the_list).unwrap().click();
    window.run_steps(3);
}

#[test]
fn false_color_of_lux_that_were_not_baked_offers_to_bake_them() {
    let mut window = baked();
    show_false_color_of_lux(&mut window);
    click(&mut window, "Bake with illuminance");
    let has_lux = |app: &App| app.session().shown.as_ref().is_some_and(|shown| shown.pixel_irradiance().is_some());
    wait(&mut window, |app| app.session().bake == BakeState::Done && has_lux(app) && app.is_settled());
    window.run_steps(2);
    assert_eq!(window.query_all_by_label_contains("Scale of illuminance").count(), 1);
    assert!(window.query_by_label("Bake with illuminance").is_none());
}

#[test]
fn false_color_of_lux_says_while_they_are_a_preview() {
    let mut window = baked_larger();
    show_false_color_of_lux(&mut window);
    for (label, number) in [("Samples per pixel", 4096.0), ("Tolerance", 80.0)] {
        window.get_by_label(label).set_value_accesskit(number);
        window.run_steps(3);
    }
    assert!(window.query_by_label("As far as the bake is").is_none());
    click(&mut window, "Bake with illuminance");
    let has_lux = |app: &App| app.session().shown.as_ref().is_some_and(|shown| shown.pixel_irradiance().is_some());
    wait(&mut window, |app| app.session().bake.is_running() && has_lux(app));
    window.get_by_label("As far as the bake is");
    click(&mut window, "Stop the bake");
    wait(&mut window, |app| app.session().bake == BakeState::Stopped);
    assert!(window.query_by_label("As far as the bake is").is_none());
}

#[test]
fn white_balance_metering_and_false_color_are_part_of_the_look() {
    let mut window = baked();
    click(&mut window, "Metering");
    click(&mut window, "Log average");
    click(&mut window, "Balance");
    click(&mut window, "False color");
    assert_eq!(window.query_all_by_label("Illuminance").count(), 2, "in the list, and the box of the bake panel");
    click(&mut window, "Luminance");
    wait(&mut window, App::is_settled);
    let display = window.state().look().display;
    assert_eq!(display.metering, clerestory_relight::display::Metering::LogAverage);
    assert_eq!(display.white.map(|white| white.kelvin), Some(6504.0));
    assert_eq!(display.quantity(), Some(clerestory::look::Quantity::Luminance));
    window.run_steps(2);
    assert_eq!(window.query_all_by_label_contains("Scale of luminance").count(), 1);
    click(&mut window, "Fit range");
    let [low, high] = window.state().look().display.false_color.unwrap().range.unwrap();
    assert!(low > 0.0 && low < high, "{low} {high}");

    type_over(&mut window, "Tint", "0.01");
    click(&mut window, "Metering");
    click(&mut window, "Percentile");
    type_over(&mut window, "Below white", "90");
    let display = window.state().look().display;
    assert_eq!(display.metering, clerestory_relight::display::Metering::Percentile(90.0));
    assert_eq!(display.white.map(|white| white.duv), Some(0.01));
}

#[test]
fn the_bake_tells_its_figures_and_can_be_started_again() {
    let mut window = baked_larger();
    let figures = window.state().session().figures.clone().unwrap();
    assert_eq!((figures.pixels, figures.columns, figures.blocks), (64 * 48, 17, 12));
    window.get_by_label("Save bake…");
    click(&mut window, "Start bake");
    assert!(window.state().session().shown.is_some(), "the picture stays until the next one is whole");
    wait(&mut window, |app| app.session().bake == BakeState::Done);
}

#[test]
fn an_opened_bake_tells_the_figures_of_its_file() {
    let window = baked();
    let shown = window.state().session().shown.as_ref().unwrap();
    let bake = shown.bake();
    let figures = bake.figures();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.transport");
    archive::write(&bake, &path).unwrap();

    let mut window = open(Source::File(path));
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0);
    for words in [
        format!("{:.1} mean, {} most", figures.mean_rank, figures.max_rank),
        format!("{:.1} dB below peak", figures.error_db.sampling),
        format!("{:.1} dB below peak", figures.error_db.total),
    ] {
        assert!(window.query_all_by_label(&words).next().is_some(), "{words:?} is not told");
    }
    click(&mut window, "Recent");
    assert!(window.query_by_label("room.transport").is_some(), "what the command line opened is recent, too");
}

#[test]
fn a_click_on_a_recent_file_opens_it() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second] = ["first.gltf", "second.gltf"].map(|name| folder.path().join(name));
    for path in [&first, &second] {
        std::fs::write(path, room()).unwrap();
    }
    let is_open = |app: &App, path: &Path| {
        let opened = app.session().opened.as_ref().and_then(|opened| opened.path.as_deref());
        app.session().stage == Stage::Ready && opened == Some(path)
    };
    // Where the newest stands above the one before it.
    let tops = |window: &mut Window| {
        click(window, "Recent");
        ["first.gltf", "second.gltf"].map(|name| window.get_by_label(name).rect().top())
    };
    let mut window = open(Source::File(first.clone()));
    wait(&mut window, |app| is_open(app, &first));
    window.input_mut().dropped_files.push(Arc::new(Dropped(second.clone())));
    wait(&mut window, |app| is_open(app, &second));
    let [older, newer] = tops(&mut window);
    assert!(newer < older, "{newer} {older}");
    click(&mut window, "first.gltf");
    wait(&mut window, |app| is_open(app, &first));
    let [newer, older] = tops(&mut window);
    assert!(newer < older, "it is the newest now, and listed once: {newer} {older}");
}

/// A folder of three gray pictures of 32 × 24 pixels and a file that is none.
fn stage() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (light, gray) in [("left_2", 60), ("left_10", 120), ("right", 180)] {
        let shade = |x: u32, y: u32| image::Luma([gray + (x + y) as u8]);
        image::GrayImage::from_fn(32, 24, shade).save(folder.path().join(format!("{light}.png"))).unwrap();
    }
    std::fs::write(folder.path().join("notes.txt"), "f/8").unwrap();
    folder
}

#[test]
fn a_dropped_folder_of_pictures_is_baked_and_each_light_has_a_slider() {
    let folder = stage();
    let mut window = baked();
    window.input_mut().dropped_files.push(Arc::new(Dropped(folder.path().into())));
    let is_measured = |app: &App| app.session().shown.as_ref().is_some_and(|shown| shown.header.basis.is_measured());
    wait(&mut window, |app| is_measured(app) && app.session().bake == BakeState::Done && app.is_settled());
    window.get_by_label("3 of 32 × 24");
    let sliders = ["left_2", "left_10", "right"].map(|key| window.get_by_label(&format!("{key} intensity")).rect());
    assert!(
        sliders[0].top() < sliders[1].top() && sliders[1].top() < sliders[2].top(),
        "in natural order: {sliders:?}"
    );
    // The report is the last of a long panel.
    window.set_size(vec2(1440.0, 1800.0));
    window.run_steps(3);
    click(&mut window, "Report (2)");
    // The first of them was said as well.
    for words in ["notes.txt", "sRGB"] {
        assert!(window.query_all_by_label_contains(words).next().is_some(), "{words}");
    }

    let (ev_before, slider) = (window.state().shown_ev(), sliders[2]);
    let from = pos2(slider.left() + 0.6 * slider.width(), slider.center().y);
    drag(&mut window, from, pos2(slider.right() - 6.0, slider.center().y));
    assert!(window.state().look().lights.lights["right"].intensity > 2.0);
    wait(&mut window, |app| app.shown_ev() < ev_before - 0.2);

    // A light without a place has no handle: what is dragged in the picture is the picture.
    let (look, area) = (window.state().look().clone(), window.get_by_label("Picture").rect());
    drag(&mut window, area.center(), area.center() + vec2(40.0, 20.0));
    assert_eq!(*window.state().look(), look);
    click(&mut window, "Start bake");
    wait(&mut window, |app| app.session().bake == BakeState::Done);
    window.get_by_label("Save bake…");
    reach(&mut window, "Measure");
    window.get_by_label("Pictures that were taken tell no illuminance");
}

#[test]
fn a_bake_of_pictures_that_runs_is_not_given_up_unasked() {
    let (folder, home) = (noisy_stage(), tempfile::tempdir().unwrap());
    let other = home.path().join("room.gltf");
    std::fs::write(&other, room()).unwrap();
    let mut window = open(Source::File(folder.path().into()));
    wait(&mut window, |app| app.session().bake.is_running());
    ask_to_close(&mut window);
    window.get_by_label("Give up the bake?");
    click(&mut window, "Go on baking");
    assert!(window.query_by_label("Give up the bake?").is_none() && window.state().session().bake.is_running());
    window.input_mut().dropped_files.push(Arc::new(Dropped(other)));
    window.run_steps(3);
    window.get_by_label("Give up the bake?");
    click(&mut window, "Discard");
    wait(&mut window, |app| app.session().has_scene());
}

#[test]
fn the_key_that_closes_asks_before_a_bake_of_pictures_is_given_up_and_no_part_of_it_stays_behind() {
    let (home, pictures) = (tempfile::tempdir().unwrap(), noisy_stage());
    let folder = home.path().join("stage");
    std::fs::rename(pictures.path(), &folder).unwrap();
    let mut window = open(Source::File(folder.clone()));
    wait(&mut window, |app| app.session().bake.is_running());
    assert!(!quit_by_key(&mut window));
    window.get_by_label("Give up the bake?");
    assert!(window.state().session().bake.is_running(), "it goes on while that is asked");
    click(&mut window, "Discard");
    assert!(ask_to_close(&mut window), "nothing else would be lost");
    eframe::App::on_exit(window.state_mut());
    drop(window);
    let n_files = |folder: &Path| std::fs::read_dir(folder).unwrap().count();
    assert_eq!((n_files(home.path()), n_files(&folder)), (1, 16));
}

#[test]
fn frames_that_are_given_up_do_not_take_a_bake_of_pictures_along() {
    let (folder, frames) = (stage(), tempfile::tempdir().unwrap());
    let mut window = open(Source::File(folder.path().into()));
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    for label in ["Keep look", "Timeline", "Add key", "Look"] {
        click(&mut window, label);
    }
    window.get_by_label("Frames per second").set_value_accesskit(240.0);
    window.get_by_label("Time of the key").set_value_accesskit(120.0);
    window.run_steps(3);
    save_as(&mut window, "Export frames…", &frames.path().join("f_#####.png"));
    ask_to_close(&mut window);
    click(&mut window, "Stop and close");
    ask_to_close(&mut window);
    window.get_by_label("Save the bake?");
    click(&mut window, "Cancel");
    assert!(window.state().session().frames().is_some(), "who stays loses nothing");
    ask_to_close(&mut window);
    window.get_by_label("Stop writing frames?");
}

#[test]
fn a_folder_of_pictures_is_opened_by_its_path() {
    let folder = stage();
    let mut window = baked();
    ask_for(&mut window, "Open pictures…", folder.path());
    window.get_by_label_contains("A folder with one EXR, HDR, PNG or JPEG");
    click(&mut window, "Open");
    let is_measured = |app: &App| app.session().shown.as_ref().is_some_and(|shown| shown.header.basis.is_measured());
    wait(&mut window, |app| is_measured(app) && app.session().bake == BakeState::Done);
    window.get_by_label("3 of 32 × 24");
}

#[test]
fn the_legend_of_photographs_names_no_unit() {
    let folder = stage();
    let mut window = open(Source::File(folder.path().into()));
    let is_measured = |app: &App| app.session().shown.as_ref().is_some_and(|shown| shown.header.basis.is_measured());
    wait(&mut window, |app| is_measured(app) && app.session().bake == BakeState::Done && app.is_settled());
    click(&mut window, "False color");
    click(&mut window, "Luminance");
    wait(&mut window, App::is_settled);
    let legend = window.get_by_label_contains("Scale of luminance").accesskit_node().label().unwrap();
    assert!(legend.ends_with("relative"), "{legend}");
}

#[test]
fn wishes_for_photographs_name_no_unit() {
    let folder = stage();
    let mut window = open(Source::File(folder.path().into()));
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    window.set_size(vec2(1440.0, 1800.0));
    window.run_steps(3);
    reach(&mut window, "Solve for light");
    window.get_all_by_label("Rectangle").next().unwrap().click();
    window.run_steps(3);
    let middle = window.get_by_label("Picture").rect().center();
    drag(&mut window, middle, middle + vec2(60.0, 40.0));
    reach(&mut window, "Kind of wish");
    click(&mut window, "Times as bright");
    reach(&mut window, "Add wish");
    reach(&mut window, "Kind of wish");
    click(&mut window, "Luminance");
    let wanted = window.get_by_label("Wanted").accesskit_node().value().unwrap();
    assert!(wanted.ends_with("relative"), "{wanted}");
    reach(&mut window, "Solve");
    wait(&mut window, |app| app.solution().is_some());
    let words = window.state().solution().unwrap().outcomes[0].words();
    assert!(words.contains(" relative wanted") && !words.contains("cd/m²"), "{words}");
}

#[test]
fn a_bake_of_pictures_is_in_no_cache_and_so_it_is_asked_for_before_it_is_lost() {
    let folder = stage();
    let home = tempfile::tempdir().unwrap();
    let (saved, other) = (home.path().join("stage.transport"), home.path().join("room.gltf"));
    std::fs::write(&other, room()).unwrap();
    let mut window = open(Source::File(folder.path().into()));
    let is_baked = |app: &App| app.session().bake == BakeState::Done && app.is_settled();
    wait(&mut window, is_baked);
    ask_to_close(&mut window);
    window.get_by_label("Save the bake?");
    click(&mut window, "Cancel");
    window.get_by_label("Save bake…").scroll_to_me();
    window.run_steps(8);
    save_as(&mut window, "Save bake…", &saved);
    wait(&mut window, |app| !app.session().has_unsaved_stack());
    assert!(saved.exists());
    ask_to_close(&mut window);
    assert!(window.query_by_label("Save the bake?").is_none(), "it is in a file");
    // Another one is not, and goes when something else is opened.
    reach(&mut window, "Start bake");
    wait(&mut window, |app| app.session().has_unsaved_stack() && is_baked(app));
    window.input_mut().dropped_files.push(Arc::new(Dropped(other)));
    window.run_steps(3);
    window.get_by_label("Save the bake?");
    click(&mut window, "Discard");
    wait(&mut window, |app| app.session().has_scene());
    ask_to_close(&mut window);
    assert!(window.query_by_label("Save the bake?").is_none());
}

#[test]
fn a_bake_of_pictures_gets_a_file_where_the_system_ends_the_program_without_asking() {
    let (home, pictures) = (tempfile::tempdir().unwrap(), stage());
    let (folder, saved) = (home.path().join("stage"), home.path().join("stage.transport"));
    std::fs::rename(pictures.path(), &folder).unwrap();
    let mut window = open(Source::File(folder));
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    eframe::App::on_exit(window.state_mut());
    assert_eq!(archive::read(&saved).unwrap().header.width, 32);
    std::fs::remove_file(&saved).unwrap();
    ask_to_close(&mut window);
    window.get_by_label("Save the bake?");
    click(&mut window, "Discard");
    eframe::App::on_exit(window.state_mut());
    assert!(!saved.exists(), "somebody said that it may go");
}

#[test]
fn files_of_a_hidden_folder_of_pictures_are_called_by_its_name() {
    let (home, pictures) = (tempfile::tempdir().unwrap(), stage());
    let folder = home.path().join(".stage");
    std::fs::rename(pictures.path(), &folder).unwrap();
    let mut window = open(Source::File(folder));
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    let suggested = |window: &Window| window.get_by_label("Path").accesskit_node().value();
    click(&mut window, "Export…");
    assert_eq!(suggested(&window).as_deref(), Some("stage.png"));
    click(&mut window, "Cancel");
    reach(&mut window, "Save bake…");
    assert_eq!(suggested(&window).as_deref(), Some("stage.transport"));
}

#[test]
fn a_folder_that_is_no_stack_is_told_in_words() {
    let folder = stage();
    image::GrayImage::new(8, 8).save(folder.path().join("wrong.png")).unwrap();
    let mut window = open(Source::File(folder.path().into()));
    wait(&mut window, |app| matches!(app.session().stage, Stage::Failed(..)));
    assert_eq!(window.query_all_by_label_contains("wrong.png` has 8 × 8").count(), 1);
    let name = folder.path().file_name().unwrap().to_string_lossy().into_owned();
    click(&mut window, "Recent");
    assert!(window.query_by_label("Built-in gallery").is_some() && window.query_by_label(&name).is_none());
}

#[test]
fn lamps_without_units_shine_683_times_as_bright_and_back() {
    let mut window = baked();
    let strength = |window: &Window| window.state().session().basis().unwrap().source("lamp").unwrap().strength;
    let of_file = strength(&window);
    click(&mut window, "Mute panel");
    reach(&mut window, "Unitless lamps");
    wait(&mut window, |app| app.session().basis().unwrap().source("lamp").unwrap().strength > 100.0);
    assert_eq!(strength(&window), 683.0 * of_file);
    assert!(window.state().look().lights.lights["panel"].muted, "the look stays");
    reach(&mut window, "Unitless lamps");
    wait(&mut window, |app| app.session().basis().unwrap().source("lamp").unwrap().strength < 100.0);
    assert_eq!(strength(&window), of_file);
}

#[test]
fn a_file_that_is_no_scene_is_told_in_words_and_another_can_be_opened() {
    let mut window = open(Source::Bytes { name: "letter.glb".into(), bytes: b"Dear Sir".to_vec() });
    wait(&mut window, |app| matches!(app.session().stage, Stage::Failed(..)));
    window.get_by_label("Could not open letter.glb");
    window.get_by_label("Open another scene…");
    assert!(window.get_by_label("Export…").accesskit_node().is_disabled(), "there is nothing to export");
}

#[test]
fn the_keys_are_listed() {
    let mut window = open(Source::Bytes { name: "room.gltf".into(), bytes: room() });
    window.run_steps(2);
    assert!(window.query_by_label("Keyboard and mouse").is_none());
    window.key_press(Key::F1);
    window.run_steps(3);
    window.get_by_label("Keyboard and mouse");
}

#[test]
fn a_question_mark_lists_the_keys_on_any_keyboard_and_types_itself_into_a_field() {
    let mut window = open(Source::Bytes { name: "room.gltf".into(), bytes: room() });
    wait(&mut window, |app| app.session().stage == Stage::Ready);
    let typed = |window: &mut Window, with_key: bool| {
        if with_key {
            window.key_down(Key::Questionmark);
        }
        window.event(eframe::egui::Event::Text("?".into()));
        window.run_steps(3);
        if with_key {
            window.key_up(Key::Questionmark);
        }
        window.query_by_label("Keyboard and mouse").is_some()
    };
    // Keyboards tell it as a key and as a letter, or as a letter alone: it is one and the same wish.
    for with_key in [true, false] {
        assert!(typed(&mut window, with_key));
        window.key_press(Key::Escape);
        window.run_steps(3);
    }
    click(&mut window, "Open…");
    window.get_by_label("Path").focus();
    window.run_steps(3);
    assert!(!typed(&mut window, false), "it belongs to the field");
}

#[test]
fn the_keys_are_listed_over_a_question_and_closing_them_leaves_it() {
    let home = tempfile::tempdir().unwrap();
    let open = || ready_of(home.path());
    let mut window = open();
    click(&mut window, "Mute lamp");
    wait(&mut window, |_| home.path().join("unsaved/0.json").exists());
    drop(window);
    let mut window = open();
    window.get_by_label("Recover unsaved lights?");
    window.key_press(Key::F1);
    window.run_steps(3);
    // The list is in front: its button hears the pointer where it covers the question.
    let close = window.get_by_label("Close window").rect().center();
    window.hover_at(close);
    window.run_steps(2);
    window.drag_at(close);
    window.run_steps(1);
    window.drop_at(close);
    window.run_steps(3);
    assert!(window.query_by_label("Keyboard and mouse").is_none(), "a click closes it");
    window.key_press(Key::F1);
    window.run_steps(3);
    window.get_by_label("Keyboard and mouse");
    window.key_press(Key::Escape);
    window.run_steps(3);
    assert!(window.query_by_label("Keyboard and mouse").is_none());
    window.get_by_label("Recover unsaved lights?");
}

#[test]
fn keys_do_nothing_behind_the_list_of_keys() {
    let mut window = baked();
    click(&mut window, "Mute lamp");
    let name = window.get_by_label("Mute lamp").rect().right_center() + vec2(20.0, 0.0);
    click_at(&mut window, name);
    window.get_by_label("lamp intensity").focus();
    window.run_steps(2);
    let look = window.state().look().clone();
    window.key_press(Key::F1);
    window.run_steps(3);
    for key in [Key::CloseBracket, Key::ArrowRight, Key::F2, Key::H, Key::C] {
        window.key_press(key);
        window.run_steps(3);
        assert_eq!(*window.state().look(), look, "{key:?}");
    }
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.run_steps(3);
    assert_eq!(*window.state().look(), look, "nothing is undone");
    // It is open still, and what lies behind it is as it was.
    window.get_by_label("Keyboard and mouse");
    window.get_by_label("Mute lamp");
    window.get_by_label("Picture");
    window.key_press(Key::F1);
    window.run_steps(3);
    assert!(window.query_by_label("Keyboard and mouse").is_none());
    window.key_press(Key::CloseBracket);
    window.run_steps(3);
    assert!(window.state().look().lights.own_setting("lamp").intensity > 1.0, "the light is selected still");
}

#[test]
fn messages_wait_for_their_reader_and_nothing_goes_while_a_slider_is_held() {
    let mut window = baked();
    let folder = tempfile::tempdir().unwrap();
    let told = |window: &Window, words: &str| window.query_all_by_label_contains(words).count();
    for name in ["one.look", "two.look"] {
        let path = folder.path().join(name);
        std::fs::write(&path, "nothing").unwrap();
        drop_all(&mut window, &[&path]);
        wait(&mut window, |app| !app.is_reading_look());
        window.run_steps(2);
    }
    assert_eq!((told(&window, "one.look"), told(&window, "two.look")), (1, 1), "the second leaves the first");
    save_as(&mut window, "Save look…", &folder.path().join("three.look"));
    assert_eq!(told(&window, "Saved"), 1);
    // Six seconds are 24 steps. A slider in hand holds everything where it is.
    let slider = window.get_by_role_and_label(Role::Slider, "Exposure").rect().center();
    window.hover_at(slider);
    window.run_steps(2);
    window.drag_at(slider);
    let before = window.get_all_by_label("Close message").map(|node| node.rect()).collect::<Vec<_>>();
    window.run_steps(60);
    let after = window.get_all_by_label("Close message").map(|node| node.rect()).collect::<Vec<_>>();
    assert!(before.len() == 3 && before == after, "{before:?} {after:?}");
    window.drop_at(slider);
    window.hover_at(pos2(700.0, 300.0));
    window.run_steps(40);
    assert_eq!(window.query_all_by_label("Close message").count(), 2, "what went wrong stays");
    window.query_all_by_label("Close message").next().unwrap().click();
    window.run_steps(3);
    assert_eq!((told(&window, "one.look"), told(&window, "two.look")), (1, 0), "the newest was on top");
    click(&mut window, "Messages");
    assert_eq!((told(&window, "one.look"), told(&window, "two.look")), (2, 1), "the list has it still");
}

#[test]
fn a_dropped_look_lights_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dim.look");
    std::fs::write(&path, r#"{"clerestory": 1, "lights": {"lamp": {"intensity": 0.25}}}"#).unwrap();
    let mut window = baked();
    window.input_mut().dropped_files.push(Arc::new(Dropped(path)));
    // It is read beside the window.
    wait(&mut window, |app| !app.look().lights.lights.is_empty());
    assert_eq!(window.state().look().lights.lights["lamp"].intensity, 0.25);
}

/// Drops files on the window, and lets a frame see them.
fn drop_all(window: &mut Window, paths: &[&Path]) {
    window.input_mut().dropped_files.extend(paths.iter().map(|path| Arc::new(Dropped(path.to_path_buf())) as _));
    window.step();
}

fn name_of_open(app: &App) -> Option<&str> {
    app.session().opened.as_ref().map(|opened| opened.name.as_str())
}

#[test]
fn a_look_that_is_dropped_with_its_scene_lights_that_scene() {
    let folder = tempfile::tempdir().unwrap();
    let [scene, look] = ["hall.gltf", "dim.look"].map(|name| folder.path().join(name));
    std::fs::write(&scene, room()).unwrap();
    std::fs::write(&look, r#"{"clerestory": 1, "lights": {"lamp": {"intensity": 0.25}}}"#).unwrap();
    let is_lit = |app: &App| app.look().lights.lights.get("lamp").is_some_and(|lamp| lamp.intensity == 0.25);
    let mut window = baked();
    drop_all(&mut window, &[&look, &scene]);
    wait(&mut window, |app| name_of_open(app) == Some("hall.gltf") && is_lit(app));

    // What is asked about the look that goes is asked once, and for both.
    let mut window = baked();
    click(&mut window, "Mute panel");
    drop_all(&mut window, &[&look, &scene]);
    window.run_steps(3);
    click(&mut window, "Cancel");
    assert_eq!(name_of_open(window.state()), Some("room.gltf"));
    drop_all(&mut window, &[&look, &scene]);
    window.run_steps(3);
    click(&mut window, "Discard");
    wait(&mut window, |app| name_of_open(app) == Some("hall.gltf") && is_lit(app));
    assert!(!window.state().look().lights.lights.contains_key("panel"));
}

#[test]
fn a_look_whose_scene_cannot_be_opened_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let [scene, look] = ["torn.glb", "dim.look"].map(|name| folder.path().join(name));
    std::fs::write(&scene, b"glTF, but no more").unwrap();
    std::fs::write(&look, r#"{"clerestory": 1, "lights": {"lamp": {"intensity": 0.25}}}"#).unwrap();
    let mut window = baked();
    drop_all(&mut window, &[&look, &scene]);
    wait(&mut window, |app| app.session().stage == Stage::Ready);
    assert!(window.query_all_by_label_contains("torn.glb could not be opened").next().is_some());
    assert!(window.query_all_by_label_contains("dim.look was not opened").next().is_some());
    assert_eq!(*window.state().look(), Look::default());
}

/// The gallery in a file: it takes a while to open.
fn gallery(folder: &Path) -> PathBuf {
    let path = folder.join("gallery.glb");
    std::fs::write(&path, clerestory::headless::GALLERY).unwrap();
    path
}

#[track_caller]
fn assert_is_opening(window: &Window) {
    assert!(window.state().session().is_opening(), "{:?}", window.state().session().stage);
}

#[track_caller]
fn wait_for_question(window: &mut Window) {
    for _ in 0..5000 {
        window.step();
        if window.query_by_label("Save the look?").is_some() {
            return window.run_steps(2);
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    panic!("nobody asked");
}

#[test]
fn what_is_changed_while_a_file_is_opened_is_not_lost_unasked() {
    let folder = tempfile::tempdir().unwrap();
    let path = gallery(folder.path());
    let mut window = baked();
    drop_all(&mut window, &[&path]);
    assert_is_opening(&window);
    click(&mut window, "Mute lamp");
    wait_for_question(&mut window);
    click(&mut window, "Cancel");
    assert_eq!(window.state().session().stage, Stage::Ready);
    assert_eq!(name_of_open(window.state()), Some("room.gltf"));
    assert!(window.state().look().lights.lights["lamp"].muted);

    // What was agreed to be lost is lost, but no more than that.
    drop_all(&mut window, &[&path]);
    window.run_steps(2);
    click(&mut window, "Discard");
    assert_is_opening(&window);
    click(&mut window, "Mute panel");
    wait_for_question(&mut window);
    assert_is_opening(&window);
    click(&mut window, "Discard");
    wait(&mut window, |app| name_of_open(app) == Some("gallery.glb"));
    assert!(!window.state().look().lights.lights.contains_key("panel"));
}

#[test]
fn a_scene_that_comes_waits_until_the_look_before_it_is_saved() {
    let folder = tempfile::tempdir().unwrap();
    let (path, look) = (gallery(folder.path()), folder.path().join("room.look"));
    let mut window = baked();
    click(&mut window, "Mute lamp");
    drop_all(&mut window, &[&path]);
    window.run_steps(2);
    click(&mut window, "Discard");
    assert_is_opening(&window);
    window.key_press_modifiers(Modifiers::COMMAND | Modifiers::SHIFT, Key::S);
    window.run_steps(3);
    window.get_by_label("Path").set_text_value_accesskit(&look.display().to_string());
    wait(&mut window, |app| app.session().has_arrived() || !app.session().is_opening());
    assert_is_opening(&window);
    click(&mut window, "Save");
    wait(&mut window, |app| name_of_open(app) == Some("gallery.glb"));
    assert!(std::fs::read_to_string(&look).unwrap().contains("muted"));
}

#[test]
fn a_scene_that_comes_waits_until_the_file_of_the_one_before_it_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let (path, picture) = (gallery(folder.path()), folder.path().join("room.png"));
    let mut window = baked_larger();
    drop_all(&mut window, &[&path]);
    assert_is_opening(&window);
    ask_for(&mut window, "Export…", &picture);
    wait(&mut window, |app| app.session().has_arrived() || !app.session().is_opening());
    assert_is_opening(&window);
    click(&mut window, "Save");
    wait(&mut window, |app| name_of_open(app) == Some("gallery.glb"));
    wait(&mut window, |_| picture.exists());
    assert_eq!(image::image_dimensions(&picture).unwrap(), (64, 48));
}

#[test]
fn a_profile_for_a_lamp_that_went_with_its_scene_goes_to_nothing_and_that_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let (path, look, ies) = (gallery(folder.path()), folder.path().join("a.look"), folder.path().join("down.ies"));
    std::fs::write(&ies, "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 10\n0 45 90\n0\n100 50 0\n")
        .unwrap();
    let mut window = baked();
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    save_as(&mut window, "Save look…", &look);
    let lamp = window.get_by_label("Move Point lamp 1 over surfaces").rect().center();
    ask_for_menu(&mut window, lamp);
    drop_all(&mut window, &[&path]);
    assert_is_opening(&window);
    ask_for(&mut window, "Give it a profile…", &ies);
    wait(&mut window, |app| name_of_open(app) == Some("gallery.glb"));
    click(&mut window, "Open");
    assert!(window.query_all_by_label_contains("is there no longer").next().is_some());
    assert!(window.state().look().lights.lamps.is_empty());
}

#[test]
fn the_opening_of_a_file_is_stopped_and_what_is_open_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = gallery(folder.path());
    let mut window = baked();
    drop_all(&mut window, &[&path]);
    assert_is_opening(&window);
    click(&mut window, "Stop opening");
    assert_eq!(window.state().session().stage, Stage::Ready);
    assert!(window.query_by_label("Stop opening").is_none());
    for _ in 0..100 {
        window.step();
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    assert_eq!(name_of_open(window.state()), Some("room.gltf"));
    assert_eq!(window.state().session().bake, BakeState::Done);
}

#[test]
fn what_is_chosen_about_a_scene_does_not_stop_another_from_being_opened() {
    let folder = tempfile::tempdir().unwrap();
    let path = gallery(folder.path());
    let mut window = baked();
    window.get_by_label("Unitless lamps").scroll_to_me();
    window.run_steps(8);
    drop_all(&mut window, &[&path]);
    assert_is_opening(&window);
    click(&mut window, "Unitless lamps");
    assert!(window.query_all_by_label_contains("a file is being opened").count() > 0);
    wait(&mut window, |app| name_of_open(app) == Some("gallery.glb"));
}

#[test]
fn closing_asks_only_when_the_look_would_be_lost() {
    let mut window = baked();
    ask_to_close(&mut window);
    assert!(window.query_by_label("Save the look?").is_none());
    click(&mut window, "Mute lamp");
    ask_to_close(&mut window);
    window.get_by_label("Save the look?");
    click(&mut window, "Cancel");
    assert!(window.query_by_label("Save the look?").is_none());
}

#[test]
fn why_a_file_cannot_be_opened_is_told_once() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = baked();
    window.input_mut().dropped_files.push(Arc::new(Dropped(folder.path().join("nothing.glb"))));
    window.run_steps(3);
    wait(&mut window, |app| app.session().stage == Stage::Ready);
    window.run_steps(3);
    let told = window.get_by_label_contains("nothing.glb could not be opened").accesskit_node().value().unwrap();
    assert_eq!(told.matches("os error").count(), 1, "{told}");
}

#[test]
fn work_that_may_be_lost_is_unsaved_still_where_what_was_to_replace_it_cannot_be_opened() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("torn.glb");
    std::fs::write(&path, b"glTF, but no more").unwrap();
    let mut window = baked();
    click(&mut window, "Mute lamp");
    let look = window.state().look().clone();
    let drop_and_discard = |window: &mut Window| {
        window.input_mut().dropped_files.push(Arc::new(Dropped(path.clone())));
        window.run_steps(3);
        click(window, "Discard");
        wait(window, |app| app.session().stage == Stage::Ready);
        window.run_steps(3);
    };
    for _ in 0..2 {
        // The second time it asks again: what may be lost is lost once.
        drop_and_discard(&mut window);
    }
    assert_eq!(*window.state().look(), look);
    ask_to_close(&mut window);
    window.get_by_label("Save the look?");
}

#[test]
fn keys_are_for_the_question_that_waits() {
    let mut window = baked();
    click(&mut window, "Mute lamp");
    let name = window.get_by_label("Mute lamp").rect().right_center() + vec2(20.0, 0.0);
    click_at(&mut window, name);
    let look = window.state().look().clone();
    ask_to_close(&mut window);
    window.get_by_label("Save the look?");
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.run_steps(3);
    assert_eq!(*window.state().look(), look, "nothing is undone behind it");
    window.key_press(Key::CloseBracket);
    window.run_steps(3);
    assert_eq!(*window.state().look(), look, "nor is the selected light made brighter");
    click(&mut window, "Cancel");
    window.key_press(Key::CloseBracket);
    window.run_steps(3);
    assert!(window.state().look().lights.own_setting("lamp").intensity > 1.0);
    click(&mut window, "Undo");
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.run_steps(3);
    assert!(*window.state().look() != look);
}

#[test]
fn what_was_to_follow_a_save_that_failed_does_not_follow_a_later_one() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = baked();
    click(&mut window, "Mute lamp");
    ask_to_close(&mut window);
    window.get_all_by_label("Save look…").last().unwrap().click();
    window.run_steps(3);
    window.get_by_label("Path").set_text_value_accesskit(&folder.path().join("missing/a.look").display().to_string());
    window.run_steps(3);
    click(&mut window, "Save");
    window.get_by_label_contains("missing does not exist; create it first");
    click(&mut window, "Cancel");
    let closes = |window: &Window| {
        let commands = window.output().viewport_output.values().flat_map(|output| output.commands.iter());
        commands.filter(|command| matches!(command, eframe::egui::ViewportCommand::Close)).count()
    };
    let path = folder.path().join("b.look");
    window.key_press_modifiers(Modifiers::COMMAND | Modifiers::SHIFT, Key::S);
    window.run_steps(3);
    window.get_by_label("Path").set_text_value_accesskit(&path.display().to_string());
    window.run_steps(3);
    window.get_by_label("Save").click();
    for _ in 0..4 {
        window.step();
        assert_eq!(closes(&window), 0, "the window stays");
    }
    assert!(path.exists());
}

#[test]
fn without_a_picture_nobody_is_asked_where_it_is_to_go() {
    let mut window = open(Source::File("none.glb".into()));
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(3);
    assert!(window.query_by_label_contains("There is no picture to write yet").is_some());
    assert!(window.query_by_label("Path").is_none());
}

#[test]
fn a_file_that_is_dropped_while_one_is_asked_for_is_taken_as_the_answer() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dim.look");
    std::fs::write(&path, r#"{"clerestory": 1, "lights": {"lamp": {"intensity": 0.25}}}"#).unwrap();
    let mut window = baked();
    click(&mut window, "Open look…");
    drop_all(&mut window, &[&path]);
    window.run_steps(2);
    assert!(window.state().look().lights.lights.is_empty(), "nothing is opened behind the question");
    click(&mut window, "Open");
    wait(&mut window, |app| !app.look().lights.lights.is_empty());
    assert!(window.query_by_label("Path").is_none());
}

#[test]
fn work_that_was_recovered_in_part_is_offered_again() {
    let home = tempfile::tempdir().unwrap();
    let open = || ready_of(home.path());
    let mut window = open();
    click(&mut window, "Mute lamp");
    let kept = home.path().join("unsaved/0.json");
    wait(&mut window, |_| kept.exists());
    drop(window);
    let mut work: serde_json::Value = serde_json::from_slice(&std::fs::read(&kept).unwrap()).unwrap();
    work["look"] = r#"{"clerestory": 1, "lights": {"lamp": {"muted": true}}, "sky": {"file": "none.hdr"}}"#.into();
    let own = home.path().join("own.look");
    std::fs::write(&own, "{}").unwrap();
    work["look_path"] = own.to_str().unwrap().into();
    std::fs::write(&kept, work.to_string()).unwrap();
    let mut window = open();
    click(&mut window, "Recover");
    assert!(window.state().look().lights.lights["lamp"].muted && kept.exists());
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.run_steps(3);
    assert!(window.query_by_label("Path").is_some(), "its own file holds what was left out");
    assert_eq!(std::fs::read_to_string(&own).unwrap(), "{}");
    drop(window);
    let window = open();
    window.get_by_label("Recover");
}

#[test]
fn what_the_keyboard_comes_to_is_scrolled_into_sight() {
    let mut window = baked();
    window.set_size(vec2(1440.0, 420.0));
    window.run_steps(4);
    let place = |window: &Window| window.get_by_label("Denoise").rect();
    assert!(place(&window).top() > 420.0, "it is below what is seen");
    window.get_by_label("Denoise").focus();
    window.run_steps(20);
    let seen = place(&window);
    assert!(seen.top() > 0.0 && seen.bottom() < 420.0, "{seen}");
}

#[test]
fn what_a_reload_told_goes_with_the_next_one() {
    let home = tempfile::tempdir().unwrap();
    let path = home.path().join("room.gltf");
    let without: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    let mut with = without.clone();
    let mut lamp = with["nodes"][1].clone();
    (lamp["name"], lamp["translation"]) = ("second".into(), serde_json::json!([-0.4, 0.1, -0.3]));
    let nodes = with["nodes"].as_array_mut().unwrap();
    nodes.push(lamp);
    let n_nodes = nodes.len();
    with["scenes"][0]["nodes"].as_array_mut().unwrap().push((n_nodes - 1).into());
    std::fs::write(&path, serde_json::to_vec(&with).unwrap()).unwrap();
    let mut window = open(Source::File(path.clone()));
    let is_done = |app: &App| app.session().bake == BakeState::Done && app.is_settled();
    wait(&mut window, is_done);
    click(&mut window, "Mute second");
    let told = "Opened again: the look sets `second`, which this scene does not have; it is ignored";
    replace_and_reload(&mut window, &path, &without);
    wait(&mut window, |app| !has_light(app, "second") && is_done(app));
    assert!(window.query_all_by_label(told).next().is_some());
    replace_and_reload(&mut window, &path, &with);
    wait(&mut window, |app| has_light(app, "second") && is_done(app));
    assert!(window.query_all_by_label(told).next().is_none(), "it is there again");
    window.get_by_label("Mute second");
}

fn has_light(app: &App, key: &str) -> bool {
    app.session().basis().is_some_and(|basis| basis.source(key).is_some())
}
