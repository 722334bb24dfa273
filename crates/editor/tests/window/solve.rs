//! Marking, measuring and solving for light in the window, driven by its labels.

use clerestory::app::{App, Start};
use clerestory::look::Look;
use clerestory::look::scene::PlaneChoice;
use clerestory::look::wishes::{Wanted, Where};
use clerestory::marks::Marks;
use clerestory::session::lamps::{LampLight, LampView, StillLamps};
use clerestory::session::{BakeSettings, BakeState, Source};
use clerestory::solve::Solution;
use clerestory_relight::Tone;
use clerestory_transport::bake::BakeConfig;
use clerestory_transport::camera::Film;
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit};
use clerestory_transport::light::{LightRig, LightSetting, luminance};
use eframe::egui::{Key, Modifiers, PointerButton, Pos2, Rect, Role, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use glam::Vec3;
use serde_json::json;

use crate::desk::{
    Dropped, Kept, SMALL, Window, baked, click, click_at, drag, on_screen, pull, quick, reach, replace_and_reload,
    room, save_as, type_over, wait, wait_until,
};

/// The room, baked with the light that arrives.
fn measured() -> Window {
    measured_in(Film { width: 64, height: 48 }, quick())
}

/// The same in few pixels, for those who count none.
fn measured_small() -> Window {
    measured_in(SMALL, quick())
}

fn measured_in(film: Film, config: BakeConfig) -> Window {
    measured_of(Source::Bytes { name: "room.gltf".into(), bytes: room() }, film, config)
}

/// The same from anywhere, at a multiple of its usual size.
fn measured_at(source: Source, scale: u32) -> Window {
    measured_of(source, Film { width: 64 * scale, height: 48 * scale }, quick())
}

/// The same in few pixels.
fn measured_small_at(source: Source) -> Window {
    measured_of(source, SMALL, quick())
}

fn measured_of(source: Source, film: Film, config: BakeConfig) -> Window {
    let settings = BakeSettings { camera_idx: 0, film, config, illuminance: true, work_plane: None };
    let start = Start::alone(source, Some(settings));
    let size = vec2(1440.0, 1400.0);
    let mut window = Harness::builder().with_size(size).build_eframe(|cc| App::new(cc, start).unwrap());
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    window
}

/// A place in the picture, as shares of its width and height.
fn place(window: &Window, x: f32, y: f32) -> Pos2 {
    let area: Rect = window.get_by_label("Picture").rect();
    let scale = ((area.width() - 28.0) / 64.0).min((area.height() - 28.0) / 48.0);
    area.center() + vec2((x - 0.5) * 64.0, (y - 0.5) * 48.0) * scale
}

/// Marks a rectangle in the middle of the picture.
fn mark(window: &mut Window) {
    window.get_all_by_label("Rectangle").next().unwrap().click();
    window.run_steps(3);
    let (from, to) = (place(window, 0.3, 0.6), place(window, 0.7, 0.9));
    drag(window, from, to);
    wait(window, |app| app.marked_lux().is_some() && !app.is_solving());
}

#[test]
fn a_marked_rectangle_is_measured_in_lux_and_follows_the_lights() {
    let mut window = measured();
    click(&mut window, "Measure");
    mark(&mut window);
    let figures = window.state().marked_lux().unwrap();
    assert!(figures.points > 100 && figures.average > 0.1 && figures.minimum <= figures.average, "{figures:?}");
    assert!(figures.maximum >= figures.average && figures.area_m2.is_some_and(|area| area > 0.0 && area < 24.0));
    assert_eq!(window.query_all_by_label_contains(" fc").count(), 3, "average, minimum and maximum");
    let told = window.state().session().shown.as_ref().unwrap().bake().irradiance_figures()[0].error_db.total;
    window.get_by_label(&format!("Illuminance: {told:.1} dB"));
    // A light that goes out takes its lux along.
    click(&mut window, "Mute lamp");
    wait(&mut window, |app| {
        !app.is_solving() && app.marked_lux().is_some_and(|now| now.average < 0.99 * figures.average)
    });
    click(&mut window, "Clear");
    wait(&mut window, |app| app.marked_lux().is_none());
}

#[test]
fn a_rectangle_that_the_camera_takes_out_of_hand_marks_nothing() {
    let mut window = measured_small();
    click(&mut window, "Measure");
    window.get_all_by_label("Rectangle").next().unwrap().click();
    window.run_steps(3);
    let (from, to) = (place(&window, 0.3, 0.6), place(&window, 0.7, 0.9));
    pull(&mut window, from, to);
    window.key_press(Key::C);
    window.run_steps(3);
    window.drop_at(to);
    window.run_steps(3);
    window.key_press(Key::C);
    window.run_steps(3);
    assert!(window.query_by_label("Picture").is_some(), "the camera is put down");
    assert!(window.state().look().marks.is_none());
}

#[test]
fn the_lights_of_a_place_tell_their_lux_and_together_they_are_those_there() {
    let mut window = measured();
    let (rig, pixel) = (LightRig::default(), [64 * 38 + 32]);
    let shown = window.state().session().shown.as_ref().unwrap();
    let mut shares = shown.shares(&rig, None, &pixel).unwrap();
    shown.add_lux(&mut shares, &rig, None, &pixel);
    let all = luminance(shown.irradiance_at(&rig, None, &pixel).unwrap());
    let sum: f32 = shares.iter().map(|share| share.lux.unwrap()).sum();
    assert!(all > 0.0 && (sum / all - 1.0).abs() < 1e-3, "{sum} lx of {all}");

    let at = place(&window, 32.5 / 64.0, 38.5 / 48.0);
    click_at(&mut window, at);
    let rows = window.query_all_by_label_contains("lamp ").filter_map(|row| row.accesskit_node().label());
    let rows: Vec<String> = rows.filter(|words| words.contains(" % ")).collect();
    assert!(rows.len() == 1 && rows[0].ends_with(" lx"), "{rows:?}");
}

#[test]
fn no_lux_is_told_of_a_place_while_the_light_of_lamps_is_not_there_yet() {
    let window = measured();
    let session = window.state().session();
    let (shown, scene) = (session.shown.as_ref().unwrap(), session.lamp_scene().unwrap().clone());
    let (camera, film) = (scene.scene.cameras[0].clone(), shown.film());
    let view = LampView { scene, camera, film, patches: None, measures: true, bounces: None, device: None };
    let position = Vec3::new(0.0, 0.2, -0.3);
    let lamp = FreeLamp {
        key: "a".into(),
        shape: LampShape::Point,
        position,
        aim: position - Vec3::Y,
        turn_rad: 0.0,
        strength: 100.0,
        unit: LampUnit::Lumen,
        setting: LightSetting::default(),
        replaces: None,
    };
    let light = StillLamps::new(std::sync::Arc::new(view)).light(std::slice::from_ref(&lamp), &|| false).unwrap();
    let (rig, pixel) = (LightRig::default(), [64 * 38 + 32]);
    assert!(shown.irradiance_at(&rig, Some(&light), &pixel).is_some());
    let partial = LampLight { left_out: vec![lamp], ..light };
    assert!(shown.irradiance_at(&rig, Some(&partial), &pixel).is_none());
}

#[test]
fn figures_say_that_they_are_of_the_lights_now_while_another_look_is_seen_beside_them() {
    const WORDS: &str = "Under the lights as they are now";
    let mut window = measured_small();
    click(&mut window, "Measure");
    mark(&mut window);
    click(&mut window, "Keep look");
    click(&mut window, "Mute lamp");
    assert!(window.query_by_label(WORDS).is_none());
    click(&mut window, "Compare");
    window.get_by_label(WORDS);
}

#[test]
fn figures_are_of_the_moment_of_the_timeline_while_that_is_seen() {
    let mut window = measured();
    click(&mut window, "Measure");
    mark(&mut window);
    let bright = window.state().marked_lux().unwrap().average;
    let is_dark = |app: &App| !app.is_solving() && app.marked_lux().is_some_and(|lux| lux.average < 0.9 * bright);
    click(&mut window, "Keep look");
    click(&mut window, "Mute lamp");
    wait(&mut window, is_dark);
    click(&mut window, "Timeline");
    click(&mut window, "Add key");
    click(&mut window, "Look");
    let start = window.get_by_label("Timeline ruler").rect().left_top();
    drag(&mut window, start + vec2(60.0, 8.0), start + vec2(12.0, 8.0));
    wait(&mut window, |app| {
        !app.is_solving() && app.marked_lux().is_some_and(|lux| (lux.average / bright - 1.0).abs() < 1e-3)
    });
    click(&mut window, "Back to the lights");
    wait(&mut window, is_dark);
}

#[test]
fn a_wish_is_solved_previewed_and_one_step_of_undo() {
    let mut window = measured();
    click(&mut window, "Solve for light");
    mark(&mut window);
    // Where there is little room, what was found would lie below the fold.
    window.set_size(vec2(1440.0, 700.0));
    window.run_steps(3);
    window.get_by_label("Kind of wish").scroll_to_me();
    window.run_steps(10);
    let before = window.state().marked_lux().unwrap().average;
    let ev = window.state().shown_ev();
    click(&mut window, "Kind of wish");
    click(&mut window, "Times as bright");
    click(&mut window, "Add wish");
    click(&mut window, "Solve");
    wait(&mut window, |app| app.solution().is_some());
    let found = window.state().solution().unwrap().clone();
    assert!(found.outcomes[0].is_met, "{}", found.words(window.state().look()));
    assert!(window.query_all_by_label_contains("wanted, was").count() == 1);
    window.run_steps(12);
    let (accept, start) = (window.get_by_label("Accept").rect(), window.get_by_label("Start bake").rect());
    assert!(accept.top() > 40.0 && accept.bottom() < start.top(), "it comes in sight: {accept} above {start}");
    // The picture shows it, the look does not have it yet.
    wait(&mut window, |app| app.is_settled() && app.shown_ev() < ev - 0.5);
    assert_eq!(window.state().look().lights, Look::default().lights);
    wait(&mut window, |app| {
        !app.is_solving() && app.marked_lux().is_some_and(|now| (now.average / before - 2.0).abs() < 0.3)
    });
    click(&mut window, "Preview");
    wait(&mut window, |app| app.is_settled() && (app.shown_ev() - ev).abs() < 1e-2);
    click(&mut window, "Accept");
    assert_eq!(window.state().look().lights, found.rig);
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.run_steps(3);
    assert_eq!(window.state().look().lights, Look::default().lights, "one step");
    assert_eq!(window.state().look().wishes.list.len(), 1, "the wish is another step");
}

/// Asks for the solution of the wishes that are there.
fn solved(window: &mut Window) -> Solution {
    click(window, "Solve");
    wait(window, |app| !app.is_solving() && app.solution().is_some());
    window.state().solution().unwrap().clone()
}

/// Wishes for what is marked to be so many times as bright.
fn wish_times(window: &mut Window, times: f64) {
    click(window, "Kind of wish");
    click(window, "Times as bright");
    window.get_by_label("Wanted").set_value_accesskit(times);
    window.run_steps(3);
    click(window, "Add wish");
}

#[test]
fn no_light_gets_below_its_least_factor_and_the_rest_is_kept_as_much_as_asked() {
    let mut window = measured();
    click(&mut window, "Solve for light");
    mark(&mut window);
    wish_times(&mut window, 0.2);
    let set = |window: &mut Window, label: &str, value: f64| {
        window.get_by_label(label).set_value_accesskit(value);
        window.run_steps(3);
    };
    let least =
        |found: &Solution| found.changes.iter().map(|change| change.after.intensity).fold(f32::INFINITY, f32::min);
    let free = solved(&mut window);
    assert!(least(&free) < 0.5, "{free:?}");
    set(&mut window, "Least factor", 0.8);
    let bounded = solved(&mut window);
    assert!((least(&bounded) - 0.8).abs() < 1e-4 && !bounded.outcomes[0].is_met, "{bounded:?}");

    set(&mut window, "Least factor", 0.0);
    let rest = |window: &Window| {
        let number = window.get_all_by_role_and_label(Role::SpinButton, "Keep the rest").last().unwrap();
        number.accesskit_node().numeric_value()
    };
    assert_eq!(rest(&window), Some(window.state().look().wishes.keep), "it is read, too");
    set(&mut window, "Keep the rest", 1.0);
    assert_eq!(rest(&window), Some(1.0));
    let kept = solved(&mut window);
    let [kept, free] = [kept, free].map(|found| found.outcomes[0].reached);
    assert!(kept > 1.05 * free, "{kept} {free}");
}

#[test]
fn colors_may_change_where_that_is_wished_and_within_a_saturation() {
    let mut window = measured_small();
    click(&mut window, "Solve for light");
    let colors = |window: &Window| window.state().look().wishes.colors;
    assert_eq!(colors(&window), None);
    reach(&mut window, "Colors too");
    assert!(colors(&window).is_some());
    window.get_by_label("Most saturation").set_value_accesskit(0.25);
    window.run_steps(3);
    assert_eq!(colors(&window), Some(0.25));
    reach(&mut window, "Colors too");
    assert_eq!(colors(&window), None);
}

#[test]
fn none_of_the_lights_may_change_or_all_of_them() {
    let mut window = measured_small();
    click(&mut window, "Solve for light");
    window.get_by_label("Lights to change (2 of 2)").scroll_to_me();
    window.run_steps(8);
    click(&mut window, "Lights to change (2 of 2)");
    reach(&mut window, "None");
    window.get_by_label("Lights to change (0 of 2)");
    assert_eq!(window.state().look().wishes.held.len(), 2);
    reach(&mut window, "All");
    window.get_by_label("Lights to change (2 of 2)");
    click(&mut window, "Undo");
    window.get_by_label("Lights to change (0 of 2)");
}

#[test]
fn solving_waits_until_all_lights_are_heard() {
    let mut window = measured_small();
    click(&mut window, "Solve for light");
    mark(&mut window);
    click(&mut window, "Add wish");
    let is_offered = |window: &Window| !window.get_by_label("Solve").accesskit_node().is_disabled();
    assert!(is_offered(&window));
    click(&mut window, "Solo lamp");
    assert!(!is_offered(&window));
    click(&mut window, "Clear solo");
    assert!(is_offered(&window));
}

/// A wish, and a lamp that is added in the very frame in which “Solve” is pressed: nothing of its light can be there.
fn asked_too_soon() -> Window {
    let mut window = measured();
    click(&mut window, "Solve for light");
    mark(&mut window);
    wish_times(&mut window, 2.0);
    click(&mut window, "Add lamp");
    window.get_by_label("Point").click_accesskit();
    window.get_by_label("Solve").click_accesskit();
    window
}

#[test]
fn a_lamp_whose_light_is_on_its_way_is_waited_for_and_counts_as_it_is_set() {
    let mut window = asked_too_soon();
    window.run_steps(3);
    assert_eq!(window.state().look().lights.lamps.len(), 1);
    wait(&mut window, |app| !app.is_solving() && app.solution().is_some());
    let found = window.state().solution().unwrap().clone();
    let lamp = |found: &Solution| {
        let of = found.changes.iter().find(|change| change.key == "Point lamp 1").unwrap();
        [of.before.intensity, of.after.intensity]
    };
    assert!(lamp(&found)[1] > 1.2, "it does its part: {found:?}");

    // While the picture shows the lamp as it was found to be, it is still set as before.
    wait(&mut window, App::is_settled);
    let again = solved(&mut window);
    let off = (lamp(&again)[1] / lamp(&found)[1] - 1.0).abs();
    assert!(lamp(&again)[0] == 1.0 && off < 0.05, "{found:?} {again:?}");
}

#[test]
fn solving_that_waits_is_given_up_where_other_lights_are_shown() {
    let mut window = asked_too_soon();
    window.step();
    window.get_by_label("Solo lamp").click_accesskit();
    window.step();
    // Drawn in the frame in which the solo began, so that it was still waiting then.
    if window.query_by_label("Waiting for the light of the lamps").is_none() {
        return println!("skipped: the light of the lamp was there too soon");
    }
    let words = window.get_by_label("Waiting for the light of the lamps").rect();
    assert!(words.right() < 1435.5, "{words} is cut off at 1435");
    window.run_steps(3);
    window.get_by_label_contains("other lights were shown meanwhile; solve again");
    click(&mut window, "Clear solo");
    wait(&mut window, App::is_settled);
    assert!(window.state().solution().is_none(), "nobody asked again");
}

#[test]
fn why_nothing_was_found_is_said_until_something_else_is_wished_for() {
    const WHY: &str = "no light may change; choose one that is not muted";
    let mut window = measured_small();
    click(&mut window, "Solve for light");
    mark(&mut window);
    wish_times(&mut window, 2.0);
    window.get_by_label_contains("Lights to change").click();
    window.run_steps(8);
    for light in ["lamp may change", "panel may change"] {
        reach(&mut window, light);
    }
    reach(&mut window, "Solve");
    wait(&mut window, |app| !app.is_solving());
    window.get_by_label(WHY);
    reach(&mut window, "lamp may change");
    assert!(window.query_by_label(WHY).is_none());
}

#[test]
fn what_was_found_can_be_left_and_wishes_removed() {
    let mut window = measured_small();
    click(&mut window, "Solve for light");
    mark(&mut window);
    click(&mut window, "Add wish");
    click(&mut window, "Solve");
    wait(&mut window, |app| app.solution().is_some());
    let outdated = "The wishes have changed since; solve again";
    assert!(window.query_by_label(outdated).is_none());
    window.get_by_label("Wish wanted").set_value_accesskit(123.0);
    window.run_steps(3);
    window.get_by_label(outdated);
    // The board leaves the least room for the settings.
    click(&mut window, "Board");
    window.run_steps(8);
    for label in ["Remove Wish", "Wish weight", "Start bake", "Discard"] {
        let right = window.get_by_label(label).rect().right();
        assert!(right < 1435.5, "{label} ends at {right}, and is cut off at 1435");
    }
    click(&mut window, "Discard");
    assert!(window.state().solution().is_none());
    assert_eq!(window.state().look().lights, Look::default().lights);
    click(&mut window, "Remove Wish");
    assert!(window.query_by_label("Remove Wish").is_none());
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.run_steps(3);
    assert!(window.query_by_label("Remove Wish").is_some(), "undo brings a wish back");
}

#[test]
fn the_place_of_a_wish_is_seen_again_and_can_be_another() {
    let mut window = measured();
    click(&mut window, "Solve for light");
    mark(&mut window);
    click(&mut window, "Add wish");
    let marked = |window: &Window| -> Marks { (*window.state().look().marks.as_ref().unwrap().marks).clone() };
    let wished = |window: &Window| match &window.state().look().wishes.list[0].place {
        Where::Marked(marked) => (*marked.marks).clone(),
        other => panic!("{other:?}"),
    };
    let first = marked(&window);
    let mark_elsewhere = |window: &mut Window| {
        let (from, to) = (place(window, 0.1, 0.1), place(window, 0.4, 0.4));
        drag(window, from, to);
    };
    mark_elsewhere(&mut window);
    let second = marked(&window);
    assert!(second != first && wished(&window) == first);
    click(&mut window, "Wish");
    assert!(marked(&window) == first, "a click shows where it is");
    mark_elsewhere(&mut window);
    window.get_by_label("Wish").click_button(PointerButton::Secondary);
    window.run_steps(4);
    click(&mut window, "Use what is marked");
    assert!(wished(&window) == second);
    click(&mut window, "Undo");
    assert!(wished(&window) == first, "one step");
}

#[test]
fn a_picture_that_is_dropped_is_to_be_matched() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wanted.png");
    let mut window = baked();
    save_as(&mut window, "Export…", &path);
    wait(&mut window, |_| path.exists());
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(path)));
    wait(&mut window, |app| app.look().wishes.list.len() == 1);
    assert!(matches!(window.state().look().wishes.list[0].wanted, Wanted::Match { .. }));
}

#[test]
fn a_picture_to_match_becomes_a_wish_and_what_is_none_is_told() {
    let mut window = measured();
    let folder = tempfile::tempdir().unwrap();
    click(&mut window, "Solve for light");
    let mut ask_for = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        click(&mut window, "Match picture…");
        window.get_by_label("Path").set_text_value_accesskit(&path.display().to_string());
        window.run_steps(3);
        click(&mut window, "Open");
        wait(&mut window, |app| !app.is_solving());
        window.run_steps(2);
        let told = window.query_all_by_label_contains("torn.png").count();
        (window.query_by_label(&format!("Remove {name}")).is_some(), told)
    };
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(64, 48, image::Rgb([90; 3])).write_to(&mut png, image::ImageFormat::Png).unwrap();
    assert_eq!(ask_for("wanted.png", png.get_ref()), (true, 0));
    let (is_wish, n_told) = ask_for("torn.png", &png.get_ref()[..40]);
    assert!(!is_wish && n_told > 0, "{n_told} words about it");
}

#[test]
fn a_picture_to_match_that_another_program_wrote_is_offered_and_read_again() {
    let mut window = measured();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wanted.png");
    let write = |size: [u32; 2]| {
        image::RgbImage::from_pixel(size[0], size[1], image::Rgb([90; 3])).save(&path).unwrap();
    };
    write([64, 48]);
    click(&mut window, "Solve for light");
    click(&mut window, "Match picture…");
    window.get_by_label("Path").set_text_value_accesskit(&path.display().to_string());
    window.run_steps(3);
    click(&mut window, "Open");
    wait(&mut window, |app| !app.is_solving() && app.look().wishes.list.len() == 1);
    let wishes = window.state().look().wishes.clone();
    // What stands there now is no picture any more.
    std::fs::write(&path, b"torn").unwrap();
    for _ in 0..200 {
        window.step();
        if window.query_by_label("wanted.png has changed on disk").is_some() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    click(&mut window, "Reload");
    wait(&mut window, |app| !app.is_solving());
    window.run_steps(3);
    assert!(window.query_all_by_label_contains("cannot use").next().is_some(), "what stands there now is none");
    assert_eq!(window.state().look().wishes, wishes, "the wish stays");
}

#[test]
fn a_picture_to_match_was_shown_with_the_tone_curve_that_is_chosen() {
    let folder = tempfile::tempdir().unwrap();
    let [own, plain] = ["own.png", "plain.png"].map(|name| folder.path().join(name));
    let mut window = measured();
    assert_eq!(window.state().look().display.tone, Tone::Agx);
    type_over(&mut window, "lamp factor", "0.25");
    save_as(&mut window, "Export…", &own);
    wait(&mut window, |_| own.exists());
    click(&mut window, "Undo");
    assert_eq!(window.state().look().lights, LightRig::default());
    // Other programs throw away what it says of itself.
    image::open(&own).unwrap().save(&plain).unwrap();
    click(&mut window, "Solve for light");
    let match_picture = |window: &mut Window, path: &std::path::Path| {
        window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(path.into())));
        wait(window, |app| !app.is_solving() && app.look().wishes.list.len() == 1);
    };
    match_picture(&mut window, &own);
    assert!(window.query_by_label("own.png tone curve").is_none(), "it tells how it was shown");
    reach(&mut window, "Remove own.png");
    match_picture(&mut window, &plain);
    let as_a_photograph = solved(&mut window);

    reach(&mut window, "plain.png tone curve");
    click(&mut window, "AgX");
    let wanted = &window.state().look().wishes.list[0].wanted;
    assert!(matches!(wanted, Wanted::Match { tone: Some(Tone::Agx), .. }), "{wanted:?}");
    window.get_by_label("The wishes have changed since; solve again");
    let as_shown = solved(&mut window);
    let [misfit, of_photograph] = [&as_shown, &as_a_photograph].map(|solution| solution.misfit);
    assert!(misfit < 0.5 * of_photograph, "{misfit} after {of_photograph}");
    // The exposure is not known: one light beside the other is.
    let [lamp, panel] = ["lamp", "panel"].map(|key| as_shown.rig.setting(key).intensity);
    assert!((lamp / panel / 0.25 - 1.0).abs() < 0.1, "{lamp} beside {panel}");
}

#[test]
fn a_surface_is_marked_by_a_click_and_the_pointer_then_marks_instead_of_panning() {
    let mut window = measured();
    click(&mut window, "Measure");
    window.get_all_by_label("Surface").next().unwrap().click();
    window.run_steps(3);
    let at = place(&window, 0.5, 0.8);
    window.hover_at(at);
    window.run_steps(2);
    window.drag_at(at);
    window.run_steps(2);
    window.drop_at(at);
    window.run_steps(2);
    wait(&mut window, |app| app.marked_lux().is_some() && !app.is_solving());
    assert!(window.query_by_label("room").is_some(), "the surface is named");
    let whole = window.state().marked_lux().unwrap();
    // All six walls but what the lamp and the panel hide: most of the picture.
    assert!(whole.points > 2000, "{whole:?}");
    mark(&mut window);
    assert!(window.query_by_label("room").is_none(), "a rectangle is no surface");
}

#[test]
fn isolux_lines_lie_over_the_lux_while_they_are_wanted_and_follow_the_lights() {
    // In fewer pixels the light jumps from one to the next.
    let mut window = measured_in(Film { width: 128, height: 96 }, BakeConfig { spp: 12, ..quick() });
    let choose = |window: &mut Window, list: &str, choice: &str| {
        click(window, list);
        let in_the_list = |node: &egui_kittest::Node<'_>| node.accesskit_node().role() == eframe::egui::Role::Button;
        window.query_all_by_label(choice).find(in_the_list).unwrap().click();
        window.run_steps(3);
        wait(window, |app| !app.is_solving() && app.is_settled());
    };
    let lines = |window: &Window| window.query_all_by_label_contains("Isolux lines at").count();
    choose(&mut window, "False color", "Illuminance");
    assert_eq!(lines(&window), 0);
    choose(&mut window, "Isolux lines", "Lux");
    assert_eq!(lines(&window), 1);
    assert_eq!(window.state().look().display.isolux(), clerestory::isolux::Isolux::Lux);
    let units = |window: &Window| {
        [" lx", " fc"].map(|unit| {
            let told = window.get_by_label_contains("Isolux lines at").accesskit_node().label().unwrap_or_default();
            told.contains(unit)
        })
    };
    assert_eq!(units(&window), [true, false]);
    choose(&mut window, "Isolux lines", "Foot-candles");
    assert_eq!(units(&window), [false, true]);
    // In the dark there is none.
    click(&mut window, "Mute lamp");
    click(&mut window, "Mute panel");
    wait(&mut window, |app| !app.is_solving() && app.is_settled());
    assert_eq!((lines(&window), window.query_all_by_label("No isolux line").count()), (0, 1));
    choose(&mut window, "Isolux lines", "Off");
    assert_eq!(window.query_all_by_label("No isolux line").count(), 0);
}

#[test]
fn a_work_plane_on_a_marked_floor_is_baked_and_tells_its_uniformity() {
    let mut window = measured();
    click(&mut window, "Measure");
    assert!(window.query_by_label("U0").is_none() && window.query_by_label("Bake work plane").is_none());
    window.get_all_by_label("Surface").next().unwrap().click();
    window.run_steps(3);
    let at = place(&window, 0.5, 0.8);
    drag(&mut window, at, at);
    wait(&mut window, |app| app.marked_lux().is_some() && !app.is_solving());
    click(&mut window, "Work plane");
    let plane = window.state().settings().work_plane.unwrap();
    assert!(plane.height_m == 0.75 && plane.spacing_m.is_none() && plane.floor.is_some(), "{plane:?}");
    click(&mut window, "Whole scene");
    click(&mut window, "Stand on what is marked");
    assert_eq!(window.state().settings().work_plane, Some(plane));
    click(&mut window, "Bake work plane");
    let grid = "work plane 0.75 m over room";
    let has_grid = |app: &App| {
        let shown = app.session().shown.as_ref();
        shown.is_some_and(|shown| shown.header.grids(shown.irradiance.len()).any(|(_, of)| of.name == grid))
    };
    wait(&mut window, |app| app.session().bake == BakeState::Done && has_grid(app) && !app.is_solving());
    window.run_steps(2);
    assert!(window.query_all_by_label(grid).count() > 0);
    // One U0 for what is marked, one for the plane.
    assert_eq!(window.query_all_by_label("U0").count(), 2);
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("lux.csv");
    save_as(&mut window, "Save values…", &table);
    let table = std::fs::read_to_string(table).unwrap();
    let is_point = |line: &str| line.starts_with(&format!("{grid},")) && line.split(',').count() == 5;
    assert!(table.starts_with("grid,x,y,z,lux\n") && table.lines().skip(1).all(is_point), "{table}");
    assert!(table.lines().count() > 4, "{table}");
    // Of a lamp whose profile is gone nothing is in the table, which is told.
    let ies = folder.path().join("down.ies");
    let file = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 10\n0 45 90\n0\n100 50 0\n";
    std::fs::write(&ies, file).unwrap();
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(ies.clone())));
    wait(&mut window, |app| app.look().lights.lamps.len() == 1);
    std::fs::remove_file(&ies).unwrap();
    click(&mut window, "Mute panel");
    let lacks = |window: &Window, words: &str| window.query_all_by_label_contains(words).next().is_some();
    wait_until(&mut window, |window| lacks(window, "these figures lack it"));
    save_as(&mut window, "Save values…", &folder.path().join("lacking.csv"));
    assert!(lacks(&window, "lacking.csv; "));
    click(&mut window, "Work plane");
    assert_eq!(window.state().settings().work_plane, None);
}

/// The room with a table of 0.8 m × 0.8 m, in a file.
fn with_table(folder: &std::path::Path) -> (std::path::PathBuf, serde_json::Value) {
    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    let push = |list: &mut serde_json::Value, item: serde_json::Value| {
        let list = list.as_array_mut().unwrap();
        list.push(item);
        list.len() - 1
    };
    // The third quad of the box faces up.
    let quad = json!({"bufferView": 1, "byteOffset": 24, "componentType": 5123, "count": 6, "type": "SCALAR"});
    let indices = push(&mut gltf["accessors"], quad);
    let primitive = json!({"attributes": {"POSITION": 0}, "indices": indices, "material": 0});
    let mesh = push(&mut gltf["meshes"], json!({"primitives": [primitive]}));
    let table = json!({"name": "table", "mesh": mesh, "scale": [0.4, 0.2, 0.4], "translation": [0, -0.3, -0.4]});
    let node = push(&mut gltf["nodes"], table);
    push(&mut gltf["scenes"][0]["nodes"], json!(node));
    let path = folder.join("room.gltf");
    std::fs::write(&path, serde_json::to_vec(&gltf).unwrap()).unwrap();
    (path, gltf)
}

/// Marks the table of the room.
fn mark_table(window: &mut Window) {
    window.get_all_by_label("Surface").next().unwrap().click();
    window.run_steps(3);
    let at = on_screen(window, Vec3::new(0.0, -0.5, -0.4));
    drag(window, at, at);
    wait(window, |app| app.marked_lux().is_some() && !app.is_solving());
    window.get_by_label("table");
}

#[test]
fn a_click_marks_the_same_object_or_the_same_material_as_asked() {
    let folder = tempfile::tempdir().unwrap();
    let (path, mut gltf) = with_table(folder.path());
    // Room and table are of one material.
    gltf["materials"][0]["name"] = json!("plaster");
    std::fs::write(&path, serde_json::to_vec(&gltf).unwrap()).unwrap();
    let mut window = measured_at(Source::File(path), 1);
    click(&mut window, "Measure");
    assert!(window.query_by_label("Same material").is_none(), "it is a choice of the tool");
    mark_table(&mut window);
    let of_table = window.state().marked_lux().unwrap().points;
    let at = on_screen(&window, Vec3::new(0.0, -0.5, -0.4));

    window.get_all_by_label("Same material").next().unwrap().click();
    window.run_steps(3);
    assert_eq!(window.state().marked_lux().unwrap().points, of_table, "what is marked stays until the next click");
    drag(&mut window, at, at);
    wait(&mut window, |app| app.marked_lux().is_some_and(|now| now.points > 2000) && !app.is_solving());
    window.get_by_label("plaster");
    assert!(of_table < 1000, "{of_table} pixels see the table");

    window.get_all_by_label("Same object").next().unwrap().click();
    window.run_steps(3);
    drag(&mut window, at, at);
    wait(&mut window, |app| app.marked_lux().is_some_and(|now| now.points == of_table) && !app.is_solving());
    window.get_by_label("table");
}

#[test]
fn powers_are_divided_by_the_floor_of_the_scene_or_of_what_is_marked() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = measured_at(Source::File(with_table(folder.path()).0), 1);
    click(&mut window, "Measure");
    let floor = |window: &mut Window, name: &str| -> f64 {
        let path = folder.path().join(name);
        save_as(window, "Save schedule…", &path);
        let table = std::fs::read_to_string(path).unwrap();
        let row = table.lines().find(|line| line.starts_with("floor area (m²)")).unwrap().to_owned();
        row.split(',').find_map(|cell| cell.parse().ok()).unwrap()
    };
    assert_eq!(floor(&mut window, "scene.csv"), 4.0);
    mark(&mut window);
    assert_eq!(floor(&mut window, "part.csv"), 4.0, "what is seen of a part is no floor");
    mark_table(&mut window);
    assert_eq!(floor(&mut window, "table.csv"), 0.64);
    window.get_by_label("Floor area").set_value_accesskit(2.5);
    window.run_steps(3);
    assert_eq!(floor(&mut window, "typed.csv"), 2.5);
}

#[test]
fn a_floor_area_that_was_typed_is_that_of_one_scene() {
    let folder = tempfile::tempdir().unwrap();
    let path = with_table(folder.path()).0;
    let other = folder.path().join("other.gltf");
    std::fs::copy(&path, &other).unwrap();
    let mut window = measured_small_at(Source::File(path));
    click(&mut window, "Measure");
    window.get_by_label("Floor area").set_value_accesskit(2.5);
    window.run_steps(3);
    let typed = |window: &Window| window.get_by_label("Floor area").accesskit_node().numeric_value();
    assert_eq!(typed(&window), Some(2.5));
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(other)));
    let is_other = |app: &App| app.session().opened.as_ref().is_some_and(|opened| opened.name.contains("other"));
    wait(&mut window, |app| is_other(app) && app.session().bake == BakeState::Done && app.is_settled());
    assert_eq!(typed(&window), Some(0.0));
}

#[test]
fn the_floor_is_measured_once_somebody_looks_where_its_area_is_told() {
    let mut window = measured_small();
    window.run_steps(20);
    assert!(window.state().floor_area_m2().is_none() && !window.state().is_solving(), "nobody asked");
    click(&mut window, "Measure");
    wait(&mut window, |app| app.floor_area_m2().is_some());
    assert_eq!(window.state().floor_area_m2(), Some(4.0));
    assert!(!window.state().is_solving());
}

#[test]
fn a_work_plane_stays_on_its_object_when_the_file_changes_and_goes_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let (path, mut gltf) = with_table(folder.path());
    let mut window = measured_small_at(Source::File(path.clone()));
    click(&mut window, "Measure");
    mark_table(&mut window);
    click(&mut window, "Work plane");
    let before = window.state().settings().work_plane.unwrap();
    let key_of =
        |app: &App, node: Option<u32>| app.session().lamp_scene().unwrap().scene.nodes[node.unwrap() as usize].key();
    assert_eq!(key_of(window.state(), before.floor), "table");
    // A node before all others, far below.
    let step = json!({"name": "step", "mesh": 1, "translation": [0, -40, 0]});
    gltf["nodes"].as_array_mut().unwrap().insert(0, step);
    let roots = gltf["scenes"][0]["nodes"].as_array_mut().unwrap();
    roots.iter_mut().for_each(|root| *root = json!(root.as_u64().unwrap() + 1));
    roots.insert(0, json!(0));
    let has_grid = |app: &App| {
        let shown = app.session().shown.as_ref().filter(|_| app.session().bake == BakeState::Done);
        shown.is_some_and(|shown| {
            shown.header.grids(shown.irradiance.len()).any(|(_, of)| of.name.ends_with("over table"))
        })
    };
    replace_and_reload(&mut window, &path, &gltf);
    wait(&mut window, has_grid);
    let after = window.state().settings().work_plane.unwrap();
    assert_eq!(key_of(window.state(), after.floor), "table");
    assert_eq!(after.height_m, before.height_m);
    assert_ne!(after.floor, before.floor, "nodes have other numbers now");
    // It is called otherwise now.
    gltf["nodes"].as_array_mut().unwrap().iter_mut().for_each(|node| {
        if node["name"] == "table" {
            node["name"] = "desk".into();
        }
    });
    replace_and_reload(&mut window, &path, &gltf);
    wait(&mut window, |app| app.settings().work_plane.is_none() && app.session().bake == BakeState::Done);
    assert!(window.query_all_by_label_contains("work plane on `table`, which this scene does not have").count() > 0);
    window.get_by_label("table is not in this scene");
    assert!(window.state().look().scene.work_plane.is_some(), "it is there again with the table");
}

#[test]
fn a_work_plane_is_part_of_the_look_with_undo_and_comes_back_with_it_and_with_its_scene() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, look) = (with_table(folder.path()).0, folder.path().join("a.look"));
    let mut window = measured_small_at(Source::File(scene.clone()));
    click(&mut window, "Measure");
    mark_table(&mut window);
    click(&mut window, "Work plane");
    // What rests for a second is a step of undo.
    window.run_steps(10);
    // The other one is that of the picture, below.
    window.get_all_by_label("Height").next().unwrap().set_value_accesskit(0.2);
    window.run_steps(10);
    let plane = PlaneChoice { height_m: 0.2, spacing_m: None, floor: Some("table".into()) };
    assert_eq!(window.state().look().scene.work_plane.as_ref(), Some(&plane));
    for (name, wanted) in [("Undo", 0.75), ("Redo", 0.2)] {
        click(&mut window, name);
        assert_eq!(window.state().settings().work_plane.map(|plane| plane.height_m), Some(wanted), "{name}");
    }
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.run_steps(3);
    window.get_by_label("Path").set_text_value_accesskit(&look.display().to_string());
    window.run_steps(3);
    click(&mut window, "Save");
    click(&mut window, "Bake work plane");
    let has_grid = |app: &App| {
        let shown = app.session().shown.as_ref().filter(|_| app.session().bake == BakeState::Done);
        shown.is_some_and(|shown| {
            shown.header.grids(shown.irradiance.len()).any(|(_, of)| of.name.ends_with("over table"))
        })
    };
    wait(&mut window, has_grid);
    let kept = Kept::by(&mut window);
    drop(window);

    let mut window = crate::desk::open_again(&scene, kept);
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    assert_eq!(window.state().look().scene.work_plane.as_ref(), Some(&plane), "it was kept for the scene");
    assert!(window.state().settings().work_plane.is_some_and(|plane| plane.floor.is_some()));
    click(&mut window, "Measure");
    click(&mut window, "Work plane");
    let kept = Kept::by(&mut window);
    drop(window);
    let mut window = crate::desk::open_again(&scene, kept);
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    assert_eq!(window.state().look().scene.work_plane, None, "what was taken away stays away");
    drop(window);

    let mut window = measured();
    assert_eq!(window.state().look().scene.work_plane, None);
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(look)));
    wait(&mut window, |app| !app.is_reading_look() && app.look().scene.work_plane.is_some());
    assert_eq!(window.state().look().scene.work_plane.as_ref(), Some(&plane), "and with the look");
    assert_eq!(window.state().settings().work_plane, None, "this room has no table");
    assert!(window.query_all_by_label_contains("work plane on `table`, which this scene does not have").count() > 0);
}

#[test]
fn what_is_set_for_the_schedule_is_there_at_the_next_start() {
    let folder = tempfile::tempdir().unwrap();
    let scene = with_table(folder.path()).0;
    let mut window = measured_small_at(Source::File(scene.clone()));
    click(&mut window, "Measure");
    click(&mut window, "Per type");
    window.get_by_label("Efficacy").set_value_accesskit(80.0);
    window.get_by_label("Floor area").set_value_accesskit(2.5);
    window.run_steps(3);
    let kept = Kept::by(&mut window);
    drop(window);
    let mut window = crate::desk::open_again(&scene, kept);
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    crate::desk::reach(&mut window, "Measure");
    let value = |label: &str| window.get_by_label(label).accesskit_node().numeric_value();
    assert_eq!((value("Efficacy"), value("Floor area")), (Some(80.0), Some(0.0)), "that floor was of the other room");
    let is_on = window.get_by_label("Per type").accesskit_node().toggled();
    assert_eq!(is_on, Some(eframe::egui::accesskit::Toggled::True));
}

#[test]
fn a_schedule_is_written_by_lamp_or_by_type() {
    let mut window = measured_small();
    let folder = tempfile::tempdir().unwrap();
    click(&mut window, "Measure");
    let written = |window: &mut Window, name: &str| {
        let path = folder.path().join(name);
        save_as(window, "Save schedule…", &path);
        std::fs::read_to_string(path).unwrap()
    };
    assert!(written(&mut window, "lamps.csv").starts_with("key,name,"));
    click(&mut window, "Per type");
    let types = written(&mut window, "types.csv");
    assert!(types.starts_with("type,kind,") && types.contains("\nA,Point lamp,,1,yes,37.7,,37.7,,,"), "{types}");
    assert!(types.contains("\nlamps of unknown wattage,,,2,"), "{types}");
}

#[test]
fn without_illuminance_the_panel_says_so_and_offers_the_bake() {
    let mut window = baked();
    click(&mut window, "Measure");
    assert!(window.query_by_label("This bake holds no illuminance").is_some());
    click(&mut window, "Bake with illuminance");
    assert!(window.state().settings().illuminance);
    wait(&mut window, |app| {
        app.session().bake == BakeState::Done
            && app.session().shown.as_ref().is_some_and(|shown| shown.pixel_irradiance().is_some())
    });
    assert!(window.query_by_label("This bake holds no illuminance").is_none());
    let figures = window.state().session().figures.as_ref().unwrap();
    assert_eq!(figures.skipped.reused_columns, figures.columns, "the picture is not traced again");
    // The same for a work plane: the illuminance of the pixels stays, too.
    let of_pixels = window.state().session().shown.as_ref().unwrap().irradiance[0].clone();
    click(&mut window, "Work plane");
    reach(&mut window, "Bake work plane");
    wait(&mut window, |app| {
        app.session().bake == BakeState::Done
            && app.session().shown.as_ref().is_some_and(|shown| shown.irradiance.len() == 2)
    });
    assert!(window.state().session().shown.as_ref().unwrap().irradiance[0] == of_pixels);
}

#[test]
fn illuminance_is_there_while_it_is_baked_and_no_other_bake_is_offered() {
    let mut window = measured_in(Film { width: 64, height: 48 }, quick());
    click(&mut window, "Measure");
    mark(&mut window);
    let words = "As far as the bake is";
    assert!(window.query_by_label(words).is_none(), "it is all there");
    window.get_by_label("Samples per pixel").set_value_accesskit(512.0);
    window.get_by_label("Tolerance").set_value_accesskit(60.0);
    window.run_steps(3);
    click(&mut window, "Start bake");
    let is_previewed = |app: &App| {
        let shown = app.session().shown.as_ref().filter(|shown| shown.packed.is_none());
        let has_lux = shown.is_some_and(|shown| shown.pixel_irradiance().is_some());
        has_lux && matches!(app.session().bake, BakeState::Running { pass: 1.., .. })
    };
    wait(&mut window, is_previewed);
    wait(&mut window, |app| app.marked_lux().is_some());
    window.run_steps(3);
    assert!(window.query_by_label(words).is_some() && window.query_by_label("Bake with illuminance").is_none());
    click(&mut window, "Cancel bake");
    wait(&mut window, |app| app.session().bake == BakeState::Stopped);
    assert!(window.query_by_label(words).is_none() && window.query_by_label("Bake with illuminance").is_none());
}

/// The room in a file, with a wish for what is marked and a probe.
fn wished(path: &std::path::Path) -> Window {
    std::fs::write(path, room()).unwrap();
    let mut window = measured_at(Source::File(path.into()), 1);
    click(&mut window, "Solve for light");
    mark(&mut window);
    click(&mut window, "Kind of wish");
    click(&mut window, "Times as bright");
    click(&mut window, "Add wish");
    window.hover_at(place(&window, 0.2, 0.3));
    window.run_steps(3);
    window.key_press(Key::P);
    window.run_steps(4);
    window
}

#[test]
fn wishes_marks_and_probes_come_back_with_the_look_at_any_size() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, look) = (folder.path().join("room.gltf"), folder.path().join("a.look"));
    let mut first = wished(&scene);
    assert_eq!(first.query_all_by_label_contains("Probe 1, ").count(), 1);
    first.key_press_modifiers(Modifiers::COMMAND, Key::S);
    first.run_steps(3);
    first.get_by_label("Path").set_text_value_accesskit(&look.display().to_string());
    first.run_steps(3);
    click(&mut first, "Save");
    let kept = first.state().look().clone();
    assert!(kept.wishes.list.len() == 1 && kept.marks.is_some() && kept.probes.len() == 1, "{kept:?}");
    let small = first.state().marked_lux().unwrap();
    drop(first);

    let mut second = measured_at(Source::File(scene), 2);
    second.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(look)));
    wait(&mut second, |app| !app.is_reading_look() && app.marked_lux().is_some() && !app.is_solving());
    assert_eq!(*second.state().look(), kept);
    assert_eq!(second.query_all_by_label_contains("Probe 1, ").count(), 1);
    let large = second.state().marked_lux().unwrap();
    let area = large.area_m2.unwrap() / small.area_m2.unwrap();
    assert!(large.points == 4 * small.points && (area - 1.0).abs() < 0.05, "{large:?} {small:?}");
    click(&mut second, "Solve for light");
    click(&mut second, "Solve");
    wait(&mut second, |app| app.solution().is_some());
    assert!(second.state().solution().unwrap().outcomes[0].is_met);
}

#[test]
fn what_no_longer_fits_the_view_of_a_reloaded_file_is_told_and_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.gltf");
    let mut window = wished(&path);
    click(&mut window, "Measure");
    let kept = window.state().look().clone();
    let told = |window: &Window| {
        let words = ["Marked in another view", "What was marked is in another view", "A probe is in another view"];
        words.map(|words| window.query_all_by_label_contains(words).count())
    };
    assert_eq!(told(&window), [0; 3]);
    let as_it_was: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    let reload = |window: &mut Window, x: f32| {
        let mut gltf = as_it_was.clone();
        gltf["nodes"][2]["translation"][0] = serde_json::json!(x);
        replace_and_reload(window, &path, &gltf);
        let is_there = |app: &App| app.session().shown.as_ref()?.camera.as_ref().map(|camera| camera.position().x);
        wait(window, |app| is_there(app) == Some(x) && app.session().bake == BakeState::Done && app.is_settled());
        assert_eq!(*window.state().look(), kept);
    };
    reload(&mut window, 0.1);
    assert_eq!(told(&window).map(|n| n > 0), [true; 3]);
    assert_eq!(window.query_all_by_label_contains("Probe 1, ").count(), 0);
    reload(&mut window, 0.0);
    assert_eq!(told(&window), [0; 3]);
    assert_eq!(window.query_all_by_label_contains("Probe 1, ").count(), 1);
    wait(&mut window, |app| app.marked_lux().is_some());
}

#[test]
fn the_brush_marks_what_the_pointer_passes_over_and_esc_puts_it_down() {
    let mut window = measured();
    click(&mut window, "Measure");
    window.get_all_by_label("Brush").next().unwrap().click();
    window.run_steps(3);
    let (from, to) = (place(&window, 0.3, 0.7), place(&window, 0.6, 0.7));
    drag(&mut window, from, to);
    wait(&mut window, |app| app.marked_lux().is_some() && !app.is_solving());
    let stroke = window.state().marked_lux().unwrap().points;
    let (from, to) = (place(&window, 0.3, 0.85), place(&window, 0.6, 0.85));
    drag(&mut window, from, to);
    wait(&mut window, |app| !app.is_solving() && app.marked_lux().is_some_and(|lux| lux.points > stroke));
    let both = window.state().marked_lux().unwrap().points;
    assert!(both < 64 * 48 / 2, "{both} of all pixels");

    // A wider brush marks more by the same stroke.
    click(&mut window, "Clear");
    wait(&mut window, |app| app.marked_lux().is_none() && !app.is_solving());
    type_over(&mut window, "Radius", "4");
    let (from, to) = (place(&window, 0.3, 0.7), place(&window, 0.6, 0.7));
    drag(&mut window, from, to);
    wait(&mut window, |app| app.marked_lux().is_some() && !app.is_solving());
    let wide = window.state().marked_lux().unwrap().points;
    assert!(wide > stroke, "{wide} {stroke}");

    window.key_press(Key::Escape);
    window.run_steps(3);
    let (from, to) = (place(&window, 0.3, 0.2), place(&window, 0.6, 0.2));
    drag(&mut window, from, to);
    window.run_steps(5);
    wait(&mut window, |app| !app.is_solving());
    assert_eq!(window.state().marked_lux().unwrap().points, wide, "the pointer marks no more");
}
