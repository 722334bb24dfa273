//! The sky in the window, driven by its labels: baked, turned, exchanged, moved by hand and by the clock.

use clerestory::look::Look;
use clerestory::session::{BakeState, Source};
use clerestory_transport::basis::SourceKind;
use clerestory_transport::sky::{SkySetting, SunPlace, SunPosition, SunTime, sun_direction};
use eframe::egui::{Event, Key, Modifiers, Vec2, pos2, vec2};
use egui_kittest::kittest::{NodeT, Queryable};

use crate::desk::{
    Dropped, Kept, Window, click, click_at, drag, is_framed, open, open_again, type_over, wait, wait_until,
};

/// The room without ceiling, front and back, so that the sky is seen and lights it.
fn court() -> Source {
    let gltf = include_str!("../room.gltf").replace("\"count\": 36", "\"count\": 18");
    Source::Bytes { name: "court.gltf".into(), bytes: gltf.into() }
}

fn settle(window: &mut Window) {
    wait(window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
}

/// The court, baked with the sky that the button gives.
fn under_the_sky() -> Window {
    let mut window = open(court());
    settle(&mut window);
    click(&mut window, "Sky");
    click(&mut window, "Bake with sky");
    wait(&mut window, |app| app.session().basis().is_some_and(|basis| basis.sky.is_some()));
    settle(&mut window);
    window
}

#[test]
fn a_sky_that_was_baked_goes_with_undo_and_comes_back_with_its_scene_and_with_its_look() {
    let folder = tempfile::tempdir().unwrap();
    let [path, look, plain] = ["court.gltf", "day.look", "plain.look"].map(|name| folder.path().join(name));
    let Source::Bytes { bytes, .. } = court() else { panic!("it comes as bytes") };
    std::fs::write(&path, bytes).unwrap();
    let is_under_one = |app: &clerestory::app::App| app.session().basis().is_some_and(|basis| basis.sky.is_some());
    let mut window = open_again(&path, Kept::default());
    settle(&mut window);
    click(&mut window, "Sky");
    click(&mut window, "Bake with sky");
    wait(&mut window, is_under_one);
    let baked = sky(&window);
    click(&mut window, "Undo");
    wait(&mut window, |app| !is_under_one(app));
    assert_eq!(*window.state().look(), Look::default(), "it is one step");
    click(&mut window, "Redo");
    wait(&mut window, is_under_one);
    settle(&mut window);
    window.state().look().save(&look).unwrap();
    let kept = Kept::by(&mut window);

    let mut window = open_again(&path, kept);
    settle(&mut window);
    assert!(is_under_one(window.state()) && window.state().look().scene.sky == Some(1));
    let as_baked = window.state().session().basis().unwrap().sky.clone().unwrap();
    assert_eq!(as_baked.sun, baked.light(None).unwrap().sun);
    choose(&mut window, "Kind of sky", "Without a sky");
    wait(&mut window, |app| !is_under_one(app));
    settle(&mut window);
    assert!(window.state().look().lights.sky.is_none(), "the look never named it");
    click(&mut window, "Undo");
    wait(&mut window, is_under_one);
    settle(&mut window);
    click(&mut window, "Redo");
    wait(&mut window, |app| !is_under_one(app));
    settle(&mut window);
    let kept = Kept::by(&mut window);
    let mut window = open_again(&path, kept);
    settle(&mut window);
    assert!(!is_under_one(window.state()) && window.state().look().scene.sky.is_none());

    let opened_with = |file: &std::path::Path| {
        let mut window = open_again(&path, Kept::default());
        settle(&mut window);
        assert!(!is_under_one(window.state()));
        window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(file.into())));
        wait(&mut window, |app| app.look().lights.sky.is_some());
        window
    };
    let mut window = opened_with(&look);
    wait(&mut window, is_under_one);
    assert_eq!(sky(&window), baked);
    assert!(window.query_by_label_contains("which was not baked").is_none());
    // A look that says nothing of patches has its sky in vain, and that is told.
    std::fs::write(&plain, r#"{"clerestory": 1, "sky": {"sun": {"azimuth_deg": 135, "elevation_deg": 40}}}"#).unwrap();
    let window = opened_with(&plain);
    assert!(window.query_all_by_label_contains("the look has a sky, which was not baked").count() > 0);
}

fn sky(window: &Window) -> SkySetting {
    window.state().look().lights.sky.clone().unwrap_or_default()
}

fn angles(window: &Window) -> (f64, f64) {
    match sky(window).sun.unwrap().place {
        SunPlace::Angles { azimuth_deg, elevation_deg } => (azimuth_deg, elevation_deg),
        SunPlace::Time { .. } => panic!("the sun stands by time"),
    }
}

fn time(window: &Window) -> SunTime {
    match sky(window).sun.unwrap().place {
        SunPlace::Time { time, .. } => time,
        SunPlace::Angles { .. } => panic!("the sun stands by angle"),
    }
}

/// Where the sun of the look stands in the scene.
fn position(window: &Window) -> SunPosition {
    sky(window).sun.unwrap().position().unwrap()
}

/// The picture that the window shows, by way of the clipboard.
fn copied(window: &mut Window) -> eframe::egui::ColorImage {
    use eframe::egui::OutputCommand;
    window.event(Event::Copy);
    for _ in 0..2000 {
        window.step();
        let picture = window.output().platform_output.commands.iter().find_map(|command| match command {
            OutputCommand::CopyImage(image) => Some(image.clone()),
            _ => None,
        });
        if let Some(picture) = picture {
            return picture;
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    panic!("nothing was copied");
}

fn choose(window: &mut Window, combo: &str, item: &str) {
    click(window, combo);
    click(window, item);
    settle(window);
}

#[test]
fn the_numbers_of_the_sky_stay_within_their_panel() {
    let mut window = under_the_sky();
    // Unfolded it is so in every view.
    click(&mut window, "Board");
    window.get_by_label("Turn of the sky");
    click(&mut window, "List");
    for letters in [1.0, 1.25, 1.5, 2.0] {
        window.set_size(vec2(1440.0, 900.0) / letters);
        window.run_steps(8);
        let edge = window.get_by_label("Picture").rect().left();
        for label in ["Turn of the sky", "Intensity of the sky", "Intensity of the sky in EV"] {
            let right = window.get_by_label(label).rect().right();
            assert!(right < edge - 8.0, "{label} ends at {right} of {edge}, at {letters}");
        }
    }
}

#[test]
fn a_scene_without_a_sky_gets_one_by_a_button_and_the_sun_keeps_its_column() {
    let mut window = open(court());
    settle(&mut window);
    assert!(window.query_by_label("Dome of the sky").is_none());
    click(&mut window, "Sky");
    window.get_by_label_contains("this bake has none");
    click(&mut window, "Bake with sky");
    wait(&mut window, |app| app.session().basis().is_some_and(|basis| basis.sky.is_some()));
    settle(&mut window);
    assert_eq!(angles(&window), (135.0, 40.0));
    let basis = window.state().session().basis().unwrap().clone();
    assert!(basis.keeps_its_sun(&basis.sky_light(&window.state().look().lights).unwrap()));
    window.get_by_label("Dome of the sky");
    assert!(window.query_by_label_contains("no column of its own").is_none());
    click(&mut window, "Undo");
    assert_eq!(*window.state().look(), Look::default(), "the sky of the look is one step");
}

#[test]
fn a_sky_that_was_turned_is_marked_in_the_list_and_reset_there() {
    let mut window = under_the_sky();
    choose(&mut window, "Kind of sky", "As baked");
    assert!(window.query_by_label("Differs from the file").is_none());
    type_over(&mut window, "Turn of the sky", "30");
    settle(&mut window);
    assert_ne!(sky(&window), SkySetting::default());
    window.get_by_label("Differs from the file");

    window.get_by_label("Mute sky").scroll_to_me();
    window.run_steps(8);
    let mute = window.get_by_label("Mute sky").rect();
    let name = pos2(mute.right() + 20.0, mute.center().y);
    click_at(&mut window, name);
    click(&mut window, "Reset selected lights");
    assert_eq!(window.state().look().lights.sky, None, "it is as baked");
    assert!(window.query_by_label("Differs from the file").is_none());
}

#[test]
fn a_sky_that_was_baked_turned_keeps_its_turn_where_the_look_names_none() {
    let mut window = under_the_sky();
    type_over(&mut window, "Turn of the sky", "30");
    settle(&mut window);
    click(&mut window, "Bake this sky");
    let turn = |app: &clerestory::app::App| Some(app.session().basis()?.sky.as_ref()?.rotation_deg);
    wait(&mut window, |app| turn(app) == Some(30.0));
    settle(&mut window);
    choose(&mut window, "Kind of sky", "As baked");
    assert_eq!(window.state().look().lights.sky, None, "it is as baked");
    type_over(&mut window, "Intensity of the sky", "2");
    settle(&mut window);
    assert_eq!((sky(&window).rotation_deg, sky(&window).intensity), (30.0, 2.0));
    type_over(&mut window, "Intensity of the sky", "1");
    type_over(&mut window, "Turn of the sky", "0");
    settle(&mut window);
    assert_eq!(window.state().look().lights.sky, Some(SkySetting::default()), "it is turned back");
}

#[test]
fn a_preset_dims_the_sky_that_was_chosen() {
    let mut window = under_the_sky();
    let chosen = sky(&window);
    assert!(chosen.sun.is_some());
    click(&mut window, "Presets");
    click(&mut window, "Dusk");
    let lights = &window.state().look().lights;
    assert_eq!(lights.sky.as_ref(), Some(&chosen));
    assert!(lights.lights["sky"].intensity < 0.1, "{lights:?}");
}

#[test]
fn a_sky_over_closed_rooms_says_that_it_lights_nothing() {
    let room = Source::Bytes { name: "room.gltf".into(), bytes: include_bytes!("../room.gltf").to_vec() };
    for (source, is_shut_out) in [(room, true), (court(), false)] {
        let mut window = open(source);
        settle(&mut window);
        click(&mut window, "Sky");
        click(&mut window, "Bake with sky");
        wait(&mut window, |app| app.session().shown.as_ref().is_some_and(|shown| shown.header.basis.sky.is_some()));
        settle(&mut window);
        assert_eq!(window.query_by_label_contains("rooms are closed").is_some(), is_shut_out);
    }
}

#[test]
fn the_sun_is_dragged_on_the_dome_and_says_that_it_is_soft_there() {
    let mut window = under_the_sky();
    let before = copied(&mut window);
    let dome = window.get_by_label("Dome of the sky").rect().center();
    drag(&mut window, dome + vec2(40.0, 0.0), dome + vec2(0.0, 32.0));
    settle(&mut window);
    let (azimuth, elevation) = angles(&window);
    // Half of the way from the zenith to the horizon, on the side of +Z.
    assert!((azimuth - 180.0).abs() < 0.1 && (elevation - 45.0).abs() < 0.1, "{azimuth} {elevation}");
    window.get_by_label_contains("no column of its own");
    window.get_by_label_contains("In the south, azimuth 180.0°, 45.0° high");
    wait(&mut window, |app| app.is_settled());
    assert_ne!(copied(&mut window).pixels, before.pixels, "another sun is another picture");
    click(&mut window, "Undo");
    assert_eq!(angles(&window), (135.0, 40.0), "a drag is one step");

    click(&mut window, "Redo");
    click(&mut window, "Bake this sky");
    settle(&mut window);
    wait(&mut window, |app| {
        let light = |app: &clerestory::app::App| app.session().basis()?.sky_light(&app.look().lights);
        app.session().basis().zip(light(app)).is_some_and(|(basis, light)| basis.keeps_its_sun(&light))
    });
}

#[test]
fn the_dome_goes_by_arrow_keys_too() {
    const DOME: &str = "Dome of the sky";
    let mut window = under_the_sky();
    let step = |window: &mut Window, modifiers: Modifiers, key: Key| {
        window.get_by_label(DOME).focus();
        window.run_steps(2);
        window.key_press_modifiers(modifiers, key);
        window.run_steps(3);
        settle(window);
    };
    assert!(!is_framed(&window, DOME));
    step(&mut window, Modifiers::NONE, Key::ArrowRight);
    step(&mut window, Modifiers::NONE, Key::ArrowUp);
    step(&mut window, Modifiers::SHIFT, Key::ArrowLeft);
    assert!(is_framed(&window, DOME));
    assert_eq!(angles(&window), (135.9, 41.0));

    click(&mut window, "By date and place");
    settle(&mut window);
    let before = time(&window).hour;
    step(&mut window, Modifiers::NONE, Key::ArrowRight);
    assert!((time(&window).hour - before - 1.0 / 6.0).abs() < 1e-9, "{} {before}", time(&window).hour);

    choose(&mut window, "Kind of sky", "Uniform");
    step(&mut window, Modifiers::NONE, Key::ArrowRight);
    assert_eq!(sky(&window).rotation_deg, -1.0, "clockwise, as a drag turns it");
}

#[test]
fn a_sun_that_was_baked_anew_goes_with_undo_and_the_one_before_has_its_column_again() {
    let mut window = under_the_sky();
    let baked = |app: &clerestory::app::App| app.session().basis().and_then(|basis| basis.sky.as_ref()?.sun);
    let (first, at_first) = (baked(window.state()), sky(&window));
    let dome = window.get_by_label("Dome of the sky").rect().center();
    drag(&mut window, dome + vec2(40.0, 0.0), dome + vec2(0.0, 32.0));
    settle(&mut window);
    let dragged = sky(&window);
    click(&mut window, "Bake this sky");
    wait(&mut window, |app| baked(app) != first);
    settle(&mut window);
    let second = baked(window.state());
    window.get_by_label_contains("This sun has its own column");

    click(&mut window, "Undo");
    wait(&mut window, |app| baked(app) == first);
    settle(&mut window);
    assert_eq!(sky(&window), dragged, "the bake alone is undone");
    window.get_by_label_contains("no column of its own");
    click(&mut window, "Undo");
    settle(&mut window);
    assert_eq!((sky(&window), baked(window.state())), (at_first, first));
    window.get_by_label_contains("This sun has its own column");

    click(&mut window, "Redo");
    click(&mut window, "Redo");
    wait(&mut window, |app| baked(app) == second);
    settle(&mut window);
    assert_eq!(sky(&window), dragged);
    window.get_by_label_contains("This sun has its own column");
}

#[test]
fn a_sky_without_a_sun_is_turned_by_hand_and_kept_in_looks() {
    let folder = std::env::temp_dir().join(format!("clerestory-sky-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let map = image::Rgb32FImage::from_fn(16, 8, |x, _| image::Rgb([if x < 8 { 0.1 } else { 4.0 }; 3]));
    image::DynamicImage::ImageRgb32F(map).save(folder.join("half.hdr")).unwrap();

    let mut window = under_the_sky();
    let file = std::sync::Arc::new(Dropped(folder.join("half.hdr")));
    window.input_mut().dropped_files.push(file);
    wait(&mut window, |app| app.look().lights.sky.as_ref().is_some_and(|sky| sky.file.is_some()) && app.is_settled());
    assert_eq!(sky(&window).sun, None);
    let before = copied(&mut window);
    let dome = window.get_by_label("Dome of the sky").rect().center();
    // A quarter clockwise as seen from above, in steps of the pointer along the circle.
    let at = |share: f32| dome + 40.0 * Vec2::angled(share * std::f32::consts::FRAC_PI_2);
    window.hover_at(at(0.0));
    window.run_steps(2);
    window.drag_at(at(0.0));
    window.run_steps(2);
    for step in 1..=6 {
        window.hover_at(at(step as f32 / 6.0));
        window.run_steps(2);
    }
    window.drop_at(at(1.0));
    window.run_steps(3);
    assert!((sky(&window).rotation_deg + 90.0).abs() < 2.0, "{}", sky(&window).rotation_deg);
    wait(&mut window, |app| app.is_settled());
    assert_ne!(copied(&mut window).pixels, before.pixels);

    let path = folder.join("evening.look");
    window.state().look().save(&path).unwrap();
    let json = std::fs::read_to_string(&path).unwrap();
    assert!(json.contains("\"half.hdr\""), "named within its folder: {json}");
    let (back, warnings) = Look::load_readable(&path).unwrap();
    assert_eq!((&back, warnings.len()), (window.state().look(), 0));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn the_sun_follows_the_clock_and_a_played_day_is_one_step() {
    let mut window = under_the_sky();
    click(&mut window, "By date and place");
    settle(&mut window);
    let (at_ten, ev) = (sky(&window), window.state().shown_ev());
    assert_eq!(time(&window).hour, 10.0);
    click(&mut window, "Play the day");
    wait(&mut window, |app| match app.look().lights.sky.as_ref().unwrap().sun.unwrap().place {
        SunPlace::Time { time, .. } => time.hour > 20.0,
        SunPlace::Angles { .. } => false,
    });
    click(&mut window, "Play the day");
    settle(&mut window);
    let evening = time(&window).hour;
    window.run_steps(20);
    assert_eq!(time(&window).hour, evening, "it stays where it was paused");
    assert!(window.state().shown_ev() > ev + 0.5, "an evening is darker: {} {ev}", window.state().shown_ev());
    assert!(sky(&window).map.unwrap() != at_ten.map.clone().unwrap(), "the sky goes with its sun");
    click(&mut window, "Undo");
    assert_eq!(sky(&window), at_ten);
}

#[test]
fn a_map_of_the_sky_is_opened_by_its_path() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("half.hdr");
    let map = image::Rgb32FImage::from_pixel(16, 8, image::Rgb([1.0; 3]));
    image::DynamicImage::ImageRgb32F(map).save(&path).unwrap();
    let mut window = under_the_sky();
    click(&mut window, "Kind of sky");
    click(&mut window, "Picture…");
    window.get_by_label("Path").set_text_value_accesskit(&path.display().to_string());
    window.run_steps(3);
    click(&mut window, "Open");
    wait(&mut window, |app| app.look().lights.sky.as_ref().is_some_and(|sky| sky.file.is_some()) && app.is_settled());
    assert!(sky(&window).file.is_some_and(|file| file.ends_with("half.hdr")));
}

#[test]
fn the_sun_is_set_by_its_angles_or_by_a_place_on_earth() {
    let mut window = under_the_sky();
    let type_all = |window: &mut Window, numbers: &[(&str, &str)]| {
        for (field, number) in numbers {
            type_over(window, field, number);
            settle(window);
        }
    };
    type_all(&mut window, &[("Azimuth of the sun", "180"), ("Elevation of the sun", "30")]);
    assert_eq!(angles(&window), (180.0, 30.0));
    window.get_by_label_contains("In the south, azimuth 180.0°");
    click(&mut window, "By date and place");
    settle(&mut window);
    // Cape Town on a morning in winter.
    type_all(&mut window, &[("Latitude", "-33.9"), ("Longitude", "18.4"), ("Offset from universal time", "2")]);
    let SunPlace::Time { time, .. } = sky(&window).sun.unwrap().place else { panic!("by angle") };
    assert_eq!((time.latitude_deg, time.longitude_deg, time.utc_offset_h), (-33.9, 18.4, 2.0));
    click(&mut window, "By angle");
    settle(&mut window);
    let (azimuth, elevation) = angles(&window);
    assert!((azimuth - 40.0).abs() < 15.0 && (elevation - 20.0).abs() < 5.0, "{azimuth} {elevation}");
}

#[test]
fn the_sun_goes_with_the_hour_the_date_and_the_latitude() {
    let mut window = under_the_sky();
    click(&mut window, "By date and place");
    settle(&mut window);
    let morning = position(&window);
    window.get_by_label("Time of day").set_value_accesskit(870.0);
    window.run_steps(3);
    settle(&mut window);
    let summer = position(&window);
    assert_eq!(time(&window).hour, 14.5);
    assert!(morning.azimuth_deg < 180.0 && summer.azimuth_deg > 180.0, "{morning:?} {summer:?}");
    window.get_by_label_contains(&format!("In the southwest, azimuth {:.1}°", summer.azimuth_deg));

    choose(&mut window, "Month", "January");
    type_over(&mut window, "Year", "2030");
    settle(&mut window);
    let winter = position(&window);
    assert_eq!(time(&window).date, (2030, 1, 21));
    assert!(winter.elevation_deg < summer.elevation_deg - 30.0, "{winter:?} {summer:?}");

    // As far south of the equator it is summer, and the sun stands in the north at noon.
    type_over(&mut window, "Latitude", "-51.48");
    settle(&mut window);
    let beyond = position(&window);
    assert_eq!(time(&window).latitude_deg, -51.48);
    assert!(beyond.elevation_deg > winter.elevation_deg + 30.0, "{winter:?} {beyond:?}");
    window.get_by_label_contains(&format!("In the northwest, azimuth {:.1}°", beyond.azimuth_deg));
}

#[test]
fn north_turns_the_sun_of_a_place_on_earth() {
    let mut window = under_the_sky();
    click(&mut window, "By date and place");
    settle(&mut window);
    let shines_from = |window: &Window| {
        let (app, wanted) = (window.state(), sun_direction(position(window)));
        let light = app.session().basis().unwrap().sky_light(&app.look().lights).unwrap();
        (light.sun_direction().unwrap() - wanted).length() < 1e-3
    };
    let (before, at_first, picture) = (position(&window), sky(&window), copied(&mut window));
    assert!(shines_from(&window));
    window.get_by_label_contains(&format!("In the southeast, azimuth {:.1}°", before.azimuth_deg));

    type_over(&mut window, "North", "90");
    settle(&mut window);
    let after = position(&window);
    assert!((after.azimuth_deg - before.azimuth_deg - 90.0).abs() < 1e-9, "{before:?} {after:?}");
    assert_eq!(after.elevation_deg, before.elevation_deg);
    assert!(shines_from(&window));
    assert!(sky(&window).map != at_first.map, "the sky goes with its sun");
    // The wind is still that of the place.
    window.get_by_label_contains(&format!("In the southeast, azimuth {:.1}°", after.azimuth_deg));
    assert_ne!(copied(&mut window).pixels, picture.pixels);
    click(&mut window, "Undo");
    assert_eq!(sky(&window), at_first, "it is one step");
}

#[test]
fn patches_of_the_sky_are_chosen_beside_its_bake_and_come_with_it() {
    let divisions = |app: &clerestory::app::App| {
        app.session().basis()?.sources.iter().find_map(|source| match source.kind {
            SourceKind::Dome { divisions } => Some(divisions),
            _ => None,
        })
    };
    let chosen = |window: &Window| window.get_by_label("Patches of the sky").accesskit_node().value();
    let mut window = open(court());
    settle(&mut window);
    assert!(window.query_by_label("Patches of the sky").is_none(), "the sky is folded away");
    click(&mut window, "Sky");
    assert_eq!(chosen(&window).as_deref(), Some("145 patches"));
    choose(&mut window, "Patches of the sky", "577 patches");
    assert_eq!(chosen(&window).as_deref(), Some("577 patches"));
    assert_eq!(*window.state().look(), Look::default(), "they are those of the next bake");

    click(&mut window, "Bake with sky");
    wait(&mut window, |app| divisions(app).is_some());
    assert_eq!((divisions(window.state()), window.state().look().scene.sky), (Some(2), Some(2)));
    window.get_by_label("Bake this sky");
    assert_eq!(chosen(&window).as_deref(), Some("577 patches"), "they stay chosen");
    type_over(&mut window, "Azimuth of the sun", "180");
    wait_until(&mut window, |window| window.query_by_label_contains("6° wide, with soft shadows").is_some());
}

#[test]
fn a_sky_that_is_looked_at_stays_as_its_look_has_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hazy.look");
    let json = r#"{"clerestory": 1, "scene": {"sky_patches": 145}, "sky": {"intensity": 1e8,
        "sun": {"azimuth_deg": 135, "elevation_deg": 40, "turbidity": 2.25}}}"#;
    std::fs::write(&path, json).unwrap();
    let mut window = open(court());
    settle(&mut window);
    click(&mut window, "Sky");
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(path)));
    wait(&mut window, |app| app.session().basis().is_some_and(|basis| basis.sky.is_some()));
    settle(&mut window);
    window.run_steps(10);
    assert!(window.query_all_by_label("Haze").next().is_some(), "it is looked at");
    settle(&mut window);
    let SkySetting { intensity, sun, .. } = sky(&window);
    assert_eq!((intensity, sun.map(|sun| sun.turbidity)), (1e8, Some(2.25)));
}

#[test]
fn kinds_of_sky_intensity_and_days_are_set_by_their_fields() {
    let mut window = under_the_sky();
    choose(&mut window, "Kind of sky", "Uniform");
    assert_eq!((sky(&window).file.as_deref(), sky(&window).sun), (Some("uniform"), None));
    let pi = window.get_by_label("3.1 lx").rect();
    assert!(pi.width() > 0.0, "1 cd/m² from everywhere gives π lx");
    let typed = |window: &mut Window, field: &str, text: &str| {
        click(window, field);
        window.run_steps(2);
        window.event(Event::Text(text.into()));
        window.key_press(eframe::egui::Key::Enter);
        window.run_steps(3);
        settle(window);
    };
    typed(&mut window, "Intensity of the sky in EV", "2");
    assert_eq!(sky(&window).intensity, 4.0);
    window.get_by_label("12.6 lx");
    choose(&mut window, "Kind of sky", "As baked");
    assert_eq!(sky(&window), SkySetting { intensity: 4.0, ..SkySetting::default() });
    choose(&mut window, "Kind of sky", "Sun and clear sky");
    click(&mut window, "By date and place");
    settle(&mut window);
    typed(&mut window, "Day", "31");
    choose(&mut window, "Month", "February");
    let SunPlace::Time { time, .. } = sky(&window).sun.unwrap().place else { panic!("by angle") };
    assert_eq!(time.date, (2026, 2, 28), "there is no 31st of February");
    typed(&mut window, "Year", "2030");
    type_over(&mut window, "Intensity of the sun", "0.5");
    settle(&mut window);
    let sun = sky(&window).sun.unwrap();
    let SunPlace::Time { time, .. } = sun.place else { panic!("by angle") };
    assert_eq!((time.date, sun.intensity), ((2030, 2, 28), 0.5));
    assert!(window.get_by_label("Time of day").accesskit_node().numeric_value() == Some(600.0));
}
