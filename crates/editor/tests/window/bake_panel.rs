//! The bake panel and the manners of the window: forecasts, maps of colors, going on, reloading, welcoming.

use std::path::PathBuf;
use std::sync::Arc;

use clerestory::app::{App, Start};
use clerestory::bake_cache::BakeCache;
use clerestory::legend::number_words;
use clerestory::panels::status::duration;
use clerestory::platform::resident_bytes;
use clerestory::session::estimate::Forecast;
use clerestory::session::{BakeSettings, BakeState, Source, Stage};
use clerestory_transport::archive::{UnderWay, part_state};
use clerestory_transport::bake::BakeConfig;
use clerestory_transport::basis::SourceKind;
use clerestory_transport::camera::Film;
use eframe::egui::{Event, Key, Modifiers, PointerButton, Role, pos2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};

use crate::desk::{
    Dropped, Kept, SMALL, Window, ask_to_close, baked, baked_larger, click, drag, hints, open, open_again, open_with,
    quick, reach, replace_and_reload, room, save_as, wait, wait_until,
};

fn source() -> Source {
    Source::Bytes { name: "room.gltf".into(), bytes: room() }
}

#[test]
fn what_a_bake_will_take_is_told_before_it_starts() {
    let mut window = baked_larger();
    assert_eq!(*window.state().session().forecast(), Forecast::None, "it was baked with these settings");
    let before = window.state().settings().config.tolerance_db;
    window.get_by_label("Tolerance").set_value_accesskit(26.0);
    wait(&mut window, |app| matches!(app.session().forecast(), Forecast::Told(_)));
    let Forecast::Told(estimate) = window.state().session().forecast().clone() else { panic!() };
    assert_eq!((estimate.n_blocks, estimate.n_tried), (12, 12));
    assert!(estimate.secs > 0.0 && estimate.file_bytes > 1000, "{estimate:?}");
    window.get_by_label_contains("of memory, a file of");
    window.get_by_label("Tolerance").set_value_accesskit(f64::from(before));
    wait(&mut window, |app| *app.session().forecast() == Forecast::None);
}

#[test]
fn a_quality_is_chosen_by_its_name() {
    let mut window = baked();
    reach(&mut window, "Quality");
    click(&mut window, "Draft");
    let config = &window.state().settings().config;
    assert_eq!((config.spp, config.tolerance_db), (64, 32.0));
}

#[test]
fn of_illuminance_that_a_finished_bake_lacks_that_alone_is_foreseen() {
    let mut window = baked_larger();
    let told = |app: &App| match app.session().forecast() {
        Forecast::Told(estimate) => Some(*estimate),
        _ => None,
    };
    reach(&mut window, "Illuminance");
    assert!(window.state().settings().illuminance);
    wait(&mut window, |app| told(app).is_some());
    let of_rest = told(window.state()).unwrap();
    assert_eq!((of_rest.preview_secs, of_rest.n_blocks, of_rest.n_tried), (0.0, 12, 12), "the picture is there");
    window.get_by_label_contains("of memory, a file of");
    window.get_by_label("Tolerance").set_value_accesskit(26.0);
    wait(&mut window, |app| told(app).is_some_and(|estimate| estimate.preview_secs > 0.0));
    let of_all = told(window.state()).unwrap();
    assert!(of_rest.secs < of_all.secs, "{} of {} seconds", of_rest.secs, of_all.secs);
}

#[test]
fn what_was_baked_before_is_not_tried() {
    let home = tempfile::tempdir().unwrap();
    let mut window = open_with(source(), quick(), Some(home.path()));
    let is_baked = |app: &App, db: f32| {
        let shown = app.session().shown.as_ref().filter(|_| app.session().bake == BakeState::Done);
        shown.is_some_and(|shown| shown.header.config.tolerance_db == db)
    };
    wait(&mut window, |app| is_baked(app, 20.0) && app.is_settled());
    window.get_by_label("Tolerance").set_value_accesskit(26.0);
    window.run_steps(3);
    reach(&mut window, "Start bake");
    wait(&mut window, |app| is_baked(app, 26.0) && app.is_settled());
    window.get_by_label("Tolerance").set_value_accesskit(20.0);
    wait(&mut window, |app| *app.session().forecast() == Forecast::There);
    window.get_by_label("Baked before, there at once");
    reach(&mut window, "Start bake");
    wait(&mut window, |app| is_baked(app, 20.0) && *app.session().forecast() == Forecast::None);
}

#[test]
fn a_bake_that_does_not_fit_the_memory_says_so_and_is_not_begun() {
    let mut window = baked_larger();
    window.get_by_label("Tolerance").set_value_accesskit(26.0);
    wait(&mut window, |app| matches!(app.session().forecast(), Forecast::Told(_)));
    reach(&mut window, "At most");
    assert_eq!(window.state().session().memory_limit, Some(8_000_000_000));
    window.get_by_label("Memory limit").set_value_accesskit(0.02);
    window.run_steps(3);
    assert_eq!(window.state().session().memory_limit, Some(20_000_000));
    // The program itself takes more.
    window.get_by_label_contains("of memory, and 0 B may be taken");
    reach(&mut window, "Start bake");
    let BakeState::Failed(why) = window.state().session().bake.clone() else { panic!() };
    assert!(why.contains("make the picture smaller"), "{why}");
    reach(&mut window, "At most");
    assert_eq!(window.state().session().memory_limit, None);
    reach(&mut window, "Start bake");
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
}

#[test]
fn a_size_that_was_chosen_stays_for_the_next_scene() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.gltf");
    std::fs::write(&path, room()).unwrap();
    let start = Start::alone(source(), None);
    let mut window = Harness::builder().with_size(vec2(1440.0, 900.0)).build_eframe(|cc| App::new(cc, start).unwrap());
    wait(&mut window, |app| app.session().bake.is_running());
    assert_eq!(window.state().settings().film.width, 640);
    click(&mut window, "Stop the bake");
    window.get_by_label("Width").set_value_accesskit(48.0);
    window.get_by_label("Samples per pixel").set_value_accesskit(4.0);
    window.run_steps(3);
    let film = window.state().settings().film;
    assert_eq!(film.width, 48);
    window.input_mut().dropped_files.push(Arc::new(Dropped(path)));
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    assert_eq!(window.state().settings().film, film);
    assert_eq!(window.state().session().shown.as_ref().unwrap().header.width, 48);
}

#[test]
fn the_size_and_the_quality_that_were_chosen_are_there_at_the_next_start() {
    let opened = |kept: Kept| {
        // A window borrows it for as long as it lives.
        let kept: &'static Kept = Box::leak(Box::new(kept));
        let builder = Harness::builder().with_size(vec2(1440.0, 900.0));
        let mut window: Window = builder.build_eframe(|cc| {
            cc.storage = Some(kept);
            App::new(cc, Start::alone(source(), None)).unwrap()
        });
        wait(&mut window, |app| app.session().bake.is_running() || app.session().bake == BakeState::Done);
        window
    };
    let mut window = opened(Kept::default());
    assert_eq!(window.state().settings().film, Film { width: 640, height: 480 });
    click(&mut window, "Stop the bake");
    for (label, number) in [("Width", 48.0), ("Samples per pixel", 4.0), ("Tolerance", 18.0)] {
        window.get_by_label(label).set_value_accesskit(number);
        window.run_steps(3);
    }
    let kept = Kept::by(&mut window);
    drop(window);
    let mut window = opened(kept);
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    let BakeSettings { film, config, .. } = window.state().settings().clone();
    assert_eq!((film, config.spp, config.tolerance_db), (Film { width: 48, height: 36 }, 4, 18.0));
    assert_eq!(window.state().session().shown.as_ref().unwrap().header.width, 48, "it is baked like that");
    // A height of one's own stays as well.
    window.get_by_label("Height").set_value_accesskit(20.0);
    window.run_steps(3);
    let kept = Kept::by(&mut window);
    drop(window);
    assert_eq!(opened(kept).state().settings().film, Film { width: 48, height: 20 });
}

#[test]
fn maps_of_rank_layers_of_error_and_samples_lie_over_the_picture() {
    let mut window = baked_larger();
    let at = window.get_by_label("Picture").rect().center();
    let (header, maps) = {
        let shown = window.state().session().shown.as_ref().unwrap();
        (shown.header.clone(), shown.bake().error_maps())
    };
    let choices = [
        ("Rank", "Scale of rank from", None),
        ("Total error", "Scale of total error from", Some(&maps.total)),
        ("Lost detail", "Scale of lost detail from", Some(&maps.truncation)),
        ("Noise left", "Scale of noise left from", Some(&maps.sampling)),
        ("Noise sampled", "Scale of noise sampled from", Some(&maps.noise)),
        ("Samples", "Scale of samples from", None),
    ];
    for (name, scale, layer) in choices {
        reach(&mut window, "Heat map");
        // The figures have a row of that name, too.
        let is_figure = |node: &egui_kittest::Node<'_>| node.accesskit_node().role() == Role::Label;
        let n_figures = window.get_all_by_label(name).filter(is_figure).count();
        assert_eq!(n_figures, usize::from(!matches!(name, "Noise sampled" | "Samples")), "the same words for {name}");
        let is_choice = |node: &egui_kittest::Node<'_>| !is_figure(node);
        window.get_all_by_label(name).find(is_choice).unwrap().click();
        window.run_steps(3);
        let bar = window.get_by_label_contains(scale).accesskit_node().label().unwrap();
        assert_eq!(bar.ends_with("dB below peak"), layer.is_some(), "{bar}");
        // The block under the pointer tells its number.
        window.hover_at(at);
        window.run_steps(4);
        let pixel = window.get_by_label_contains("cd/m²").accesskit_node().value().unwrap();
        let place: Vec<u32> = pixel.split("   ").next().unwrap().split(", ").map(|n| n.parse().unwrap()).collect();
        let block_idx = place[1] / header.tile * header.partition().tiles_x() + place[0] / header.tile;
        let words = window.get_by_label_contains(" of this block: ").accesskit_node().value().unwrap();
        let number = layer.map_or(String::new(), |layer| match layer[block_idx as usize].unwrap() {
            db if db >= 100.0 => "none".into(),
            db => format!("{} dB below peak", number_words(db)),
        });
        assert!(words.starts_with(name) && words.ends_with(&number), "{words}, {number}");
    }
    reach(&mut window, "Heat map");
    click(&mut window, "Off");
    assert!(window.query_by_label_contains("Scale of").is_none());
}

#[test]
fn a_heat_map_hides_false_color_and_one_that_is_chosen_takes_its_place() {
    let mut window = baked();
    let scales = |window: &Window| {
        ["Scale of rank", "Scale of luminance"].map(|words| window.query_all_by_label_contains(words).count())
    };
    let show_rank = |window: &mut Window| {
        reach(window, "Heat map");
        let is_choice = |node: &egui_kittest::Node<'_>| node.accesskit_node().role() != Role::Label;
        window.get_all_by_label("Rank").find(is_choice).unwrap().click();
        window.run_steps(3);
        wait(window, App::is_settled);
    };
    show_rank(&mut window);
    assert_eq!(scales(&window), [1, 0]);
    reach(&mut window, "False color");
    click(&mut window, "Luminance");
    wait(&mut window, App::is_settled);
    assert_eq!(scales(&window), [0, 1]);
    show_rank(&mut window);
    assert_eq!(scales(&window), [1, 0]);
    assert!(window.state().look().display.false_color.is_some(), "a way of looking edits nothing");
    reach(&mut window, "Heat map");
    click(&mut window, "Off");
    wait(&mut window, App::is_settled);
    assert_eq!(scales(&window), [0, 1]);
    // Where the way back leads to false color, nothing lies over it.
    click(&mut window, "Undo");
    assert_eq!(window.state().look().display.false_color, None);
    show_rank(&mut window);
    assert_eq!(scales(&window), [1, 0]);
    click(&mut window, "Redo");
    wait(&mut window, App::is_settled);
    assert_eq!(scales(&window), [0, 1]);
}

#[test]
fn the_start_of_a_bake_is_in_sight_whatever_is_unfolded() {
    let mut window = baked();
    for section in ["Measure", "Solve for light", "Navigation", "Numbers"] {
        for height in [900.0, 600.0] {
            window.set_size(vec2(1440.0, height));
            window.run_steps(4);
            let (start, bar) = (window.get_by_label("Start bake").rect(), window.get_by_label("Messages").rect());
            assert!(start.top() > 40.0 && start.bottom() < bar.top(), "{start} above {bar} of {height}");
        }
        window.set_size(vec2(1440.0, 900.0));
        reach(&mut window, section);
    }
    // And so is what stops it, beside how far it is.
    let config = BakeConfig { spp: 128, tolerance_db: 60.0, ..BakeConfig::default() };
    let mut window = open_with(source(), config, None);
    window.set_size(vec2(640.0, 450.0));
    let tells_all = |app: &App| app.session().error_db.is_some() && app.n_pictures() > 0;
    wait(&mut window, |app| matches!(app.session().bake, BakeState::Running { .. }) && tells_all(app));
    let [messages, baking] = ["Messages", "Baking"].map(|label| window.get_by_label(label).rect());
    assert!(baking.left() > messages.right(), "large letters leave room: {messages} {baking}");
    window.key_press(Key::N);
    window.run_steps(4);
    let cancel = window.get_by_label("Cancel bake").rect();
    assert!(cancel.bottom() < window.get_by_label("Messages").rect().top(), "{cancel}");
    click(&mut window, "Cancel bake");
    wait(&mut window, |app| app.session().bake == BakeState::Stopped);
}

#[test]
fn the_bar_tells_the_memory_and_the_time_that_is_left_while_a_bake_runs() {
    let config = BakeConfig { spp: 512, tolerance_db: 60.0, ..BakeConfig::default() };
    let mut window = open_with(source(), config, None);
    // Nothing of the panels lies below the window, where the bar is.
    window.set_size(vec2(1440.0, 2600.0));
    let secs_left = |window: &Window| match window.state().session().bake {
        BakeState::Running { secs_left, .. } => secs_left,
        _ => None,
    };
    wait_until(&mut window, |window| secs_left(window).is_some());
    let bar = window.get_by_label("Messages").rect();
    let words = format!("{} left", duration(secs_left(&window).unwrap()));
    let left = window.get_by_role_and_label(Role::ProgressIndicator, &words).rect();
    assert!(bar.y_range().contains(left.center().y), "{words} stands in the bar: {left} beside {bar}");

    let is_memory = |node: &egui_kittest::Node<'_>| {
        let words = node.accesskit_node().value().unwrap_or_default();
        bar.y_range().contains(node.rect().center().y) && (words.ends_with(" MB") || words.ends_with(" GB"))
    };
    // Where the system is not asked there is none to tell.
    if let Some(resident) = resident_bytes() {
        let label = window.query_all_by_role(Role::Label).find(is_memory).unwrap();
        let (words, at) = (label.accesskit_node().value().unwrap(), label.rect().center());
        let (number, unit) = words.split_once(' ').unwrap();
        let told = number.parse::<f64>().unwrap() * if unit == "GB" { 1e9 } else { 1e6 };
        assert!((0.5..2.0).contains(&(told / resident as f64)), "{words} of {resident} bytes");
        window.event(Event::PointerMoved(at));
        window.run_steps(10);
        window.get_by_label("Memory of the program");
    }
    click(&mut window, "Stop the bake");
    wait(&mut window, |app| app.session().bake == BakeState::Stopped);
    assert!(window.query_by_label("Baking").is_none(), "nothing is left");
}

/// A bake whose last pass is under way.
fn in_its_last_pass() -> Window {
    let config = BakeConfig { spp: 128, tolerance_db: 60.0, ..BakeConfig::default() };
    let mut window = open_with(source(), config, None);
    wait(&mut window, |app| match app.session().bake {
        BakeState::Running { pass, n_passes, pass_done, .. } => pass + 1 == n_passes && pass_done > 0.2,
        _ => false,
    });
    window
}

/// Stops the bake; answers how many blocks of its last pass are there.
fn stopped(window: &mut Window) -> usize {
    click(window, "Stop the bake");
    wait(window, |app| app.session().bake == BakeState::Stopped);
    let settings = window.state().settings().clone();
    window.state().session().n_resumable(&settings, window.state().camera())
}

#[test]
fn a_bake_that_was_stopped_is_started_over() {
    let mut window = in_its_last_pass();
    let n_kept = stopped(&mut window);
    assert!(n_kept > 0, "there was something to go on with");
    reach(&mut window, "Start over");
    assert!(window.state().session().bake.is_running());
    let n_now = stopped(&mut window);
    assert!(n_now < n_kept, "{n_now} blocks of the last pass after {n_kept}");
}

#[test]
fn a_bake_that_was_stopped_goes_on_and_its_error_is_plotted() {
    let mut window = in_its_last_pass();
    // The key of a bake that runs does not begin it again.
    window.key_press_modifiers(Modifiers::COMMAND, Key::B);
    window.run_steps(1);
    let goes_on =
        |app: &App| matches!(app.session().bake, BakeState::Running { pass, n_passes, .. } if pass + 1 == n_passes);
    assert!(goes_on(window.state()), "it was begun again");
    let n_kept = stopped(&mut window);
    assert!(n_kept > 0 && n_kept < 12, "{n_kept} blocks of the last pass were there");
    // The key of one that was stopped goes on with it.
    window.key_press_modifiers(Modifiers::COMMAND, Key::B);
    window.run_steps(1);
    assert!(stopped(&mut window) >= n_kept, "it was begun anew");
    // Another view begins anew.
    window.key_press(Key::C);
    window.run_steps(3);
    let middle = window.get_by_label("View of the camera").rect().center();
    drag(&mut window, middle, middle + vec2(60.0, 15.0));
    assert!(window.query_by_label("Resume bake").is_none() && window.query_by_label("Start bake").is_some());
    window.key_press(Key::Escape);
    window.run_steps(3);
    assert!(hints(&mut window, "Start over", "Bakes from the beginning"));
    reach(&mut window, "Resume bake");
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    let error_db = window.state().session().error_db.unwrap().total;
    let told = window.get_by_label_contains(&format!("{error_db:.1} dB, median ")).rect().center();
    window.event(Event::PointerMoved(told));
    window.run_steps(10);
    window.get_by_label_contains("Least is known of ");
    let plotted = window.query_all_by_label_contains("Error over time, ").count();
    assert_eq!(plotted, 1, "the plot tells what it shows");
}

#[test]
fn what_the_pointer_rests_on_is_baked_first() {
    let home = tempfile::tempdir().unwrap();
    // Ten blocks by six. From the middle outwards the last one comes last.
    let film = Film { width: 160, height: 96 };
    let config = BakeConfig { spp: 32, tolerance_db: 60.0, ..BakeConfig::default() };
    let settings = BakeSettings { camera_idx: 0, film, config, illuminance: false, work_plane: None };
    let cache = Some(BakeCache::new(home.path().into(), 1 << 24));
    let start = Start { cache, ..Start::alone(source(), Some(settings)) };
    let mut window = Harness::builder().with_size(vec2(1440.0, 900.0)).build_eframe(|cc| App::new(cc, start).unwrap());
    wait(&mut window, |app| app.n_pictures() > 0);
    let area = window.get_by_label("Picture").rect();
    let (size, room) = (vec2(160.0, 96.0), area.size() - vec2(28.0, 28.0));
    let scale = (room.x / size.x).min(room.y / size.y);
    window.hover_at(area.center() + (size - vec2(1.0, 1.0)) * 0.5 * scale);
    window.run_steps(3);

    // The file of a bake under way holds the blocks of its last pass as they came.
    let part = || -> Option<PathBuf> {
        let mut files = std::fs::read_dir(home.path()).unwrap().flatten().map(|file| file.path());
        files.find(|path| path.extension().is_some_and(|ending| ending == "part"))
    };
    let is_half_done = |path: PathBuf| part_state(&path).is_ok_and(|state| 2 * state.n_done > state.n_blocks);
    wait(&mut window, |_| part().is_some_and(is_half_done));
    assert!(window.state().session().bake.is_running(), "it ended before it could be given up: make it longer");
    drop(window);
    let (_, begun) = UnderWay::beside(&part().unwrap().with_extension("")).unwrap();
    let blocks: Vec<usize> = begun.unwrap().blocks.iter().map(|(block_idx, _)| *block_idx).collect();
    assert!(blocks.len() < 60 && blocks.contains(&59), "{blocks:?}");
}

#[test]
fn a_file_that_changed_on_disk_is_offered_and_the_look_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.gltf");
    std::fs::write(&path, room()).unwrap();
    let mut window = open(Source::File(path.clone()));
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    click(&mut window, "Mute lamp");
    let look = window.state().look().clone();
    let fingerprint = |app: &App| app.session().shown.as_ref().map(|shown| shown.header.fingerprint.clone());
    let before = fingerprint(window.state());
    assert!(window.query_by_label_contains("has changed on disk").is_none());

    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    gltf["materials"][0]["pbrMetallicRoughness"] = serde_json::json!({ "baseColorFactor": [0.2, 0.3, 0.4, 1.0] });
    replace_and_reload(&mut window, &path, &gltf);
    wait(&mut window, |app| fingerprint(app) != before && app.session().bake == BakeState::Done);
    assert_eq!(*window.state().look(), look);
    assert!(window.query_by_label_contains("has changed on disk").is_none());
}

#[test]
fn lights_are_never_written_into_another_scene_than_is_open() {
    let folder = tempfile::tempdir().unwrap();
    let (path, lit) = (folder.path().join("room.gltf"), folder.path().join("lit.glb"));
    std::fs::write(&path, room()).unwrap();
    let mut window = open(Source::File(path.clone()));
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    gltf["nodes"][1]["name"] = "second".into();
    std::fs::write(&path, serde_json::to_vec(&gltf).unwrap()).unwrap();
    save_as(&mut window, "Save as glTF…", &lit);
    window.run_steps(3);
    assert!(window.query_by_label_contains("was written anew since it was opened").is_some());
    assert!(!lit.exists());
}

#[test]
fn after_a_reload_only_a_new_lamp_is_traced() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.gltf");
    std::fs::write(&path, room()).unwrap();
    let mut window = open(Source::File(path.clone()));
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    let blocks = |app: &App| app.session().shown.as_ref().unwrap().frame.groups[0].blocks.clone();
    let before = blocks(window.state());
    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    let mut lamp = gltf["nodes"][1].clone();
    (lamp["name"], lamp["translation"]) = ("second".into(), serde_json::json!([-0.4, 0.1, -0.3]));
    let nodes = gltf["nodes"].as_array_mut().unwrap();
    nodes.push(lamp);
    let n_nodes = nodes.len();
    gltf["scenes"][0]["nodes"].as_array_mut().unwrap().push((n_nodes - 1).into());
    replace_and_reload(&mut window, &path, &gltf);
    let n_reused = |app: &App| app.session().figures.as_ref().map_or(0, |figures| figures.skipped.reused_columns);
    wait(&mut window, |app| app.session().bake == BakeState::Done && n_reused(app) == 17 && app.is_settled());
    assert!(blocks(window.state()) == before, "what was there is the same to the last bit");
    window.get_by_label("Mute second");
    window.get_by_label("17 of 18 columns");
}

#[test]
fn the_lights_that_a_bake_knows_least_well_are_named_behind_it() {
    let mut window = baked_larger();
    let told = window.state().session().figures.as_ref().unwrap().column_error_db.clone().unwrap();
    let line = |light: &str, db: f32| format!("{light}, {db:.1} dB below peak");
    let worst = line(&told.worst[0].light, told.worst[0].db);
    window.get_by_label(&worst).scroll_to_me();
    window.run_steps(8);
    for light in &told.worst {
        window.get_by_label(&line(&light.light, light.db));
    }
    window.hover_at(window.get_by_label(&worst).rect().center());
    window.run_steps(60);
    window.get_by_label_contains(&format!("half are worse than {:.1} dB", told.median));
    reach(&mut window, "Least known lights");
    window.run_steps(30);
    assert!(window.query_by_label(&worst).is_none(), "they are folded");
}

#[test]
fn who_is_new_is_welcomed_once_and_text_grows_as_wished() {
    let settings = BakeSettings { camera_idx: 0, film: SMALL, config: quick(), illuminance: false, work_plane: None };
    let start = Start { welcome: true, ..Start::alone(source(), Some(settings)) };
    let mut window = Harness::builder().with_size(vec2(1440.0, 900.0)).build_eframe(|cc| App::new(cc, start).unwrap());
    wait(&mut window, |app| app.session().stage == Stage::Ready);
    window.get_by_label_contains("Drop a glTF file here");
    click(&mut window, "Got it");
    assert!(window.query_by_label_contains("Drop a glTF file here").is_none());
    click(&mut window, "Text size");
    click(&mut window, "150 %");
    assert!((window.ctx.zoom_factor() - 1.5).abs() < 1e-3);
    window.get_by_label("Theme");
}

/// The room with a shining rectangle that its file does not make a panel, in a file.
fn plain_room(folder: &std::path::Path) -> std::path::PathBuf {
    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    for node in gltf["nodes"].as_array_mut().unwrap() {
        node.as_object_mut().unwrap().remove("extras");
    }
    let path = folder.join("room.gltf");
    std::fs::write(&path, serde_json::to_vec(&gltf).unwrap()).unwrap();
    path
}

/// Texels along each side of the panel that is baked; none of a rectangle that is none.
fn texels(app: &App) -> Option<u32> {
    let shown = app.session().shown.as_ref().filter(|_| app.session().bake == BakeState::Done && app.is_settled())?;
    match shown.header.basis.source("panel")?.kind {
        SourceKind::Panel { resolution, .. } => Some(resolution),
        _ => Some(0),
    }
}

fn make_panel(window: &mut Window) {
    from_menu_of_panel(window, "Make it a panel");
    click(window, "8 × 8 texels");
}

fn from_menu_of_panel(window: &mut Window, item: &str) {
    let name = window.get_by_label("Mute panel").rect();
    let at = pos2(name.right() + 20.0, name.center().y);
    window.hover_at(at);
    window.run_steps(2);
    for pressed in [true, false] {
        let (button, modifiers) = (PointerButton::Secondary, Modifiers::NONE);
        window.event(Event::PointerButton { pos: at, button, pressed, modifiers });
        window.run_steps(2);
    }
    click(window, item);
    window.run_steps(3);
}

#[test]
fn a_panel_that_was_made_comes_back_with_the_look_and_goes_with_undo() {
    let folder = tempfile::tempdir().unwrap();
    let (path, look) = (plain_room(folder.path()), folder.path().join("a.look"));
    let mut window = open(Source::File(path.clone()));
    wait(&mut window, |app| texels(app) == Some(0));
    make_panel(&mut window);
    wait(&mut window, |app| texels(app) == Some(8));
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    wait(&mut window, |app| texels(app) == Some(0));
    window.key_press_modifiers(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
    wait(&mut window, |app| texels(app) == Some(8));
    window.state().look().save(&look).unwrap();
    drop(window);

    let mut window = open(Source::File(path));
    wait(&mut window, |app| texels(app) == Some(0));
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(look)));
    wait(&mut window, |app| texels(app) == Some(8));
    assert_eq!(window.state().look().scene.panels["panel"], 8);
}

#[test]
fn what_cannot_be_made_a_panel_is_told_and_stands_in_the_way_of_no_bake() {
    let folder = tempfile::tempdir().unwrap();
    let (path, look) = (plain_room(folder.path()), folder.path().join("a.look"));
    let mut gltf: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    // A box that shines on all sides is no rectangle.
    let of_room = gltf["meshes"][0]["primitives"][0].clone();
    let last = gltf["meshes"].as_array().unwrap().len() - 1;
    let material = gltf["meshes"][last]["primitives"][0]["material"].clone();
    gltf["meshes"][last]["primitives"][0] = of_room;
    gltf["meshes"][last]["primitives"][0]["material"] = material;
    std::fs::write(&path, serde_json::to_vec(&gltf).unwrap()).unwrap();
    let mut window = open(Source::File(path));
    wait(&mut window, |app| texels(app) == Some(0));
    make_panel(&mut window);
    wait(&mut window, |app| app.look().scene.panels.is_empty());
    assert!(window.query_all_by_label_contains("cannot be a panel").count() > 0);
    // A look from a file keeps it, and the bake starts without.
    std::fs::write(&look, r#"{"clerestory": 1, "scene": {"panels": {"panel": 8}}}"#).unwrap();
    window.input_mut().dropped_files.push(Arc::new(Dropped(look)));
    wait(&mut window, |app| app.look().scene.panels.contains_key("panel"));
    for _ in 0..100 {
        window.step();
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    click(&mut window, "Start bake");
    wait(&mut window, |app| app.session().bake.is_running() || texels(app) == Some(0));
    assert_eq!(window.state().look().scene.panels["panel"], 8);
}

#[test]
fn panels_and_units_that_were_chosen_are_there_when_the_scene_is_opened_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = plain_room(folder.path());
    let opened = |kept: Kept| open_again(&path, kept);
    let mut window = opened(Kept::default());
    wait(&mut window, |app| texels(app) == Some(0));
    make_panel(&mut window);
    wait(&mut window, |app| texels(app) == Some(8));
    let kept = Kept::by(&mut window);
    drop(window);
    let mut window = opened(kept);
    wait(&mut window, |app| texels(app) == Some(8));
    assert_eq!(window.state().look().scene.panels["panel"], 8, "the look says so");
    ask_to_close(&mut window);
    assert!(window.query_by_label("Save the look?").is_none(), "nothing was done yet");
}

#[test]
fn a_panel_is_made_finer_and_a_plain_surface_again_after_a_restart() {
    let folder = tempfile::tempdir().unwrap();
    let path = plain_room(folder.path());
    let mut window = open_again(&path, Kept::default());
    wait(&mut window, |app| texels(app) == Some(0));
    make_panel(&mut window);
    wait(&mut window, |app| texels(app) == Some(8));
    let kept = Kept::by(&mut window);
    let mut window = open_again(&path, kept);
    wait(&mut window, |app| texels(app) == Some(8));
    from_menu_of_panel(&mut window, "Change the panel");
    assert!(window.query_by_label("8 × 8 texels").is_none(), "it is one of these");
    click(&mut window, "16 × 16 texels");
    wait(&mut window, |app| texels(app) == Some(16));
    from_menu_of_panel(&mut window, "Change the panel");
    click(&mut window, "Back to a plain surface");
    wait(&mut window, |app| texels(app) == Some(0));
    assert!(window.state().look().scene.panels.is_empty());
    let kept = Kept::by(&mut window);
    click(&mut window, "Undo");
    wait(&mut window, |app| texels(app) == Some(16));
    let mut window = open_again(&path, kept);
    wait(&mut window, |app| texels(app) == Some(0));
}

#[test]
fn every_file_that_a_scene_is_made_of_is_watched_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.gltf");
    // Its buffer lies beside it, and an image that is still missing.
    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    let uri = gltf["buffers"][0]["uri"].as_str().unwrap().to_owned();
    let bytes = base64(uri.split_once(',').unwrap().1);
    std::fs::write(folder.path().join("room.bin"), &bytes).unwrap();
    gltf["buffers"][0]["uri"] = "room.bin".into();
    gltf["images"] = serde_json::json!([{ "uri": "wall.png" }]);
    gltf["textures"] = serde_json::json!([{ "source": 0 }]);
    gltf["materials"][0]["pbrMetallicRoughness"] = serde_json::json!({ "baseColorTexture": { "index": 0 } });
    std::fs::write(&path, serde_json::to_vec(&gltf).unwrap()).unwrap();
    let mut window = open(Source::File(path));
    let is_there = |app: &App| app.session().bake == BakeState::Done && app.is_settled();
    wait(&mut window, is_there);
    let told = |window: &mut Window, name: &str| {
        let words = format!("{name} has changed on disk");
        for _ in 0..200 {
            window.step();
            if window.query_by_label(&words).is_some() {
                return;
            }
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        panic!("nobody told that {words}");
    };
    assert_eq!(window.query_all_by_label_contains("has changed on disk").count(), 0);
    let longer = [bytes, vec![0; 4]].concat();
    std::fs::write(folder.path().join("room.bin"), longer).unwrap();
    told(&mut window, "room.bin");
    click(&mut window, "Keep what is open");
    assert_eq!(window.query_all_by_label_contains("has changed on disk").count(), 0);
    image::RgbImage::from_pixel(2, 2, image::Rgb([90; 3])).save(folder.path().join("wall.png")).unwrap();
    told(&mut window, "wall.png");
    let before = window.state().session().shown.as_ref().unwrap().header.fingerprint.clone();
    click(&mut window, "Reload");
    let fingerprint = |app: &App| app.session().shown.as_ref().map(|shown| shown.header.fingerprint.clone());
    wait(&mut window, |app| fingerprint(app).is_some_and(|now| now != before) && is_there(app));
}

#[test]
fn a_sky_that_another_program_wrote_is_read_again_as_it_is_set() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("day.hdr");
    let write = |level: f32, width: u32| {
        let pixels = vec![image::Rgb([level; 3]); (width * width / 2) as usize];
        let file = std::fs::File::create(&path).unwrap();
        image::codecs::hdr::HdrEncoder::new(file).encode(&pixels, width as usize, width as usize / 2).unwrap();
    };
    write(1.0, 8);
    let mut window = baked();
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(path.clone())));
    wait(&mut window, |app| app.look().lights.sky.is_some());
    let map = |app: &App| app.look().lights.sky.as_ref().and_then(|sky| sky.map.clone()).map(|map| map.width());
    assert_eq!(map(window.state()), Some(8));
    write(3.0, 16);
    for _ in 0..200 {
        window.step();
        if window.query_by_label("day.hdr has changed on disk").is_some() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    click(&mut window, "Reload");
    wait(&mut window, |app| map(app) == Some(16));
    assert!(window.query_by_label_contains("has changed on disk").is_none());
}

/// Bytes of a data URI.
fn base64(text: &str) -> Vec<u8> {
    let digit = |byte: u8| match byte {
        b'A'..=b'Z' => byte - b'A',
        b'a'..=b'z' => byte - b'a' + 26,
        b'0'..=b'9' => byte - b'0' + 52,
        b'+' => 62,
        _ => 63,
    };
    let bytes = text.trim_end_matches('=').as_bytes().chunks(4).flat_map(|four| {
        let number = four.iter().fold(0u32, |sum, byte| sum << 6 | u32::from(digit(*byte))) << (6 * (4 - four.len()));
        number.to_be_bytes()[1..four.len()].to_vec()
    });
    bytes.collect()
}
