//! The picture as something to look into: who lights what, probes, regions; and the camera, its views and their bakes.

use clerestory::app::{App, Start};
use clerestory::session::estimate::Forecast;
use clerestory::session::shares::sum;
use clerestory::session::{BakeState, Source};
use clerestory_relight::{CpuRelighter, Radiance, Relight};
use clerestory_transport::archive;
use clerestory_transport::camera::{Camera, Film, Pose};
use clerestory_transport::lamps::LampShape;
use clerestory_transport::light::{LightRig, LightSetting};
use eframe::egui::{Key, Modifiers, Pos2, Role, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use glam::Vec3;

use crate::desk::{
    Window, ask_for_menu, ask_to_close, baked, baked_larger, click, click_at, drag, is_framed, on_screen, open,
    open_larger, reach, replace_and_reload, room, type_keys, wait,
};

/// A place on the back wall that no panel hides.
const WALL: Vec3 = Vec3::new(-0.6, -0.4, -1.0);

#[test]
fn what_the_lights_bring_to_a_pixel_is_the_pixel() {
    let window = baked_larger();
    let shown = window.state().session().shown.as_ref().unwrap();
    let mut rig = LightRig::default();
    let setting = LightSetting { intensity: 0.3, color: Some([0.2, 1.0, 0.1]), ..LightSetting::default() };
    rig.lights.insert("lamp".into(), setting);
    let mut picture = Radiance::default();
    let coefficients = shown.coefficients(&rig, None);
    CpuRelighter::new(&shown.frame).unwrap().relight(&coefficients, &mut picture).unwrap();
    for pixel in [0u32, 77, 1500, 64 * 48 - 1] {
        let shares = shown.shares(&rig, None, &[pixel]).unwrap();
        let (sum, seen) = (sum(&shares), Vec3::from(picture.pixels[pixel as usize]));
        assert!((sum - seen).length() < 1e-3 * seen.length().max(1e-3), "{pixel}: {sum} {seen}");
        assert!(shares[0].luminance() >= shares[1].luminance(), "the brightest comes first");
    }
    // A square of pixels is the mean of its pixels, and a muted light brings nothing.
    let mean = sum(&shown.shares(&rig, None, &[70, 71]).unwrap());
    let each = (Vec3::from(picture.pixels[70]) + Vec3::from(picture.pixels[71])) / 2.0;
    assert!((mean - each).length() < 1e-3 * each.length());
    rig.lights.entry("lamp".into()).or_default().muted = true;
    let shares = shown.shares(&rig, None, &[1500]).unwrap();
    assert_eq!(shares.iter().find(|share| share.key == "lamp").unwrap().radiance, Vec3::ZERO);
    assert_eq!(shown.shares(&rig, None, &[64 * 48]), None, "there is no such pixel");
}

#[test]
fn a_click_tells_who_lights_a_place_and_chooses_a_light() {
    let mut window = baked();
    assert!(window.query_by_label("Light here").is_none());
    let at = on_screen(&window, WALL);
    click_at(&mut window, at);
    window.get_by_label("Light here");
    let rows: Vec<String> =
        window.query_all_by_label_contains(" %").map(|row| row.accesskit_node().label().unwrap()).collect();
    assert_eq!(rows.len(), 2, "{rows:?}");
    let key_of = |row: &str| row.split(' ').next().unwrap().to_owned();
    let key = key_of(&rows[0]);
    assert_eq!(window.state().chosen_light(), Some(key.as_str()), "what lights it most is picked");
    for row in [1, 0] {
        click(&mut window, &rows[row]);
        assert_eq!(window.state().chosen_light(), Some(key_of(&rows[row]).as_str()), "and stays what was chosen then");
    }

    // It follows the lights.
    let n_before = window.state().n_pictures();
    click(&mut window, &format!("Mute {key}"));
    wait(&mut window, |app| app.n_pictures() > n_before && app.is_settled());
    let rows: Vec<String> =
        window.query_all_by_label_contains(" %").map(|row| row.accesskit_node().label().unwrap()).collect();
    assert!(rows.len() == 1 && rows[0].contains("100 %") && !rows[0].starts_with(&key), "{rows:?}");
    window.key_press(Key::Escape);
    window.run_steps(3);
    assert!(window.query_by_label("Light here").is_none());
}

#[test]
fn light_here_pins_its_place_and_is_closed_by_its_buttons() {
    let mut window = baked();
    let at = on_screen(&window, WALL);
    click_at(&mut window, at);
    let is_row = |node: &egui_kittest::Node<'_>| node.accesskit_node().role() == Role::Button;
    let row = window.query_all_by_label_contains(" %").find(is_row).unwrap().accesskit_node().label().unwrap();
    assert!(!is_framed(&window, &row));
    window.get_by_label(&row).focus();
    window.run_steps(2);
    assert!(is_framed(&window, &row), "it is seen where the keyboard is");
    click(&mut window, "Pin");
    let pin = window.get_by_label_contains("Probe 1, ").accesskit_node().label().unwrap();
    click(&mut window, "Close Light here");
    assert!(window.query_by_label("Light here").is_none());
    window.get_by_label(&pin).focus();
    window.run_steps(2);
    assert!(is_framed(&window, &pin));
    click(&mut window, "Undo");
    assert!(window.query_by_label_contains("Probe 1, ").is_none(), "a probe belongs to the look");
}

#[test]
fn all_lights_that_reach_a_place_are_listed() {
    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    let nodes = gltf["nodes"].as_array_mut().unwrap();
    let first = nodes.len();
    nodes.extend((0..10).map(|idx| {
        serde_json::json!({"name": format!("bulb {idx}"), "translation": [0.1 * f64::from(idx) - 0.5, 0.0, -0.3],
            "extensions": {"KHR_lights_punctual": {"light": 0}}})
    }));
    let roots = gltf["scenes"][0]["nodes"].as_array_mut().unwrap();
    roots.extend((first..first + 10).map(serde_json::Value::from));
    let source = Source::Bytes { name: "room.gltf".into(), bytes: serde_json::to_vec(&gltf).unwrap() };
    let mut window = open_larger(source);
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    let at = on_screen(&window, WALL);
    click_at(&mut window, at);
    let bulbs = window
        .query_all_by_label_contains("bulb ")
        .filter(|row| row.accesskit_node().label().is_some_and(|words| words.contains('%')));
    assert_eq!(bulbs.count(), 10);
    assert!(window.query_by_label_contains(" more, ").is_none());
    // What the keyboard comes to is scrolled into sight.
    let lowest = |window: &Window| {
        let rows = window.query_all_by_label_contains(" %").filter(|row| row.accesskit_node().role() == Role::Button);
        rows.map(|row| row.rect().bottom()).fold(0.0, f32::max)
    };
    let before = lowest(&window);
    window.query_all_by_label_contains(" %").filter(|row| row.rect().bottom() == before).for_each(|row| row.focus());
    window.run_steps(12);
    assert!(lowest(&window) < before - 50.0, "{} was {before}", lowest(&window));
}

#[test]
fn free_lamps_have_their_share() {
    let mut window = baked();
    click(&mut window, "Add lamp");
    click(&mut window, "Point");
    wait(&mut window, |app| app.is_settled());
    assert!(matches!(window.state().look().lights.lamps[0].shape, LampShape::Point));
    // The first click puts the handles away, the second asks.
    let at = on_screen(&window, WALL);
    click_at(&mut window, at);
    assert!(window.query_by_label("Light here").is_none());
    std::thread::sleep(std::time::Duration::from_millis(400));
    click_at(&mut window, at);
    let row = window
        .query_all_by_label_contains("Point lamp 1 ")
        .filter(|row| row.accesskit_node().label().unwrap().contains('%'));
    assert_eq!(row.count(), 1);
}

#[test]
fn a_probe_follows_the_pointer_and_can_be_pinned() {
    let mut window = baked();
    let at = on_screen(&window, WALL);
    window.hover_at(at);
    window.run_steps(4);
    let under = window.get_by_label_contains("cd/m²").accesskit_node().value().unwrap();
    window.key_press(Key::P);
    window.run_steps(4);
    let value = under.split("   ").nth(1).unwrap();
    let pinned = window.get_by_label(&format!("Probe 1, {value}")).rect().center();
    // The pin stays where it is and reads what the lights make of it.
    window.hover_at(on_screen(&window, Vec3::new(0.5, -0.4, -1.0)));
    let n_before = window.state().n_pictures();
    click(&mut window, "Mute panel");
    wait(&mut window, |app| app.n_pictures() > n_before && app.is_settled());
    let pin = window.get_by_label_contains("Probe 1, ");
    assert!(pin.accesskit_node().label().unwrap() != format!("Probe 1, {value}") && pin.rect().center() == pinned);
    click_at(&mut window, pinned);
    assert!(window.query_by_label_contains("Probe 1, ").is_none());
}

/// The pixel that is measured now, and what stands there.
fn measured(window: &Window) -> Option<([i32; 2], String)> {
    let told = window.query_all_by_label_contains("cd/m²").filter_map(|node| node.accesskit_node().value());
    let words: Vec<String> = told.filter(|words| words.contains("   ")).collect();
    let (px, value) = words.first()?.split_once("   ")?;
    let (x, y) = px.split_once(", ")?;
    Some(([x.parse().unwrap(), y.parse().unwrap()], value.to_owned()))
}

#[test]
fn a_picture_that_has_the_keyboard_is_asked_without_a_pointer() {
    let mut window = baked_larger();
    let press = |window: &mut Window, modifiers: Modifiers, key: Key| {
        window.key_press_modifiers(modifiers, key);
        window.run_steps(4);
    };
    let place = |window: &Window| measured(window).unwrap().0;
    assert_eq!(measured(&window), None);
    press(&mut window, Modifiers::NONE, Key::F6);
    assert!(is_framed(&window, "Picture"), "it is seen where the keyboard is");
    let [x, y] = place(&window);
    assert!((x - 32).abs() <= 1 && (y - 24).abs() <= 1, "the middle of 64 × 48: {x}, {y}");

    press(&mut window, Modifiers::NONE, Key::ArrowRight);
    press(&mut window, Modifiers::SHIFT, Key::ArrowUp);
    press(&mut window, Modifiers::NONE, Key::ArrowDown);
    assert_eq!(place(&window), [x + 1, y - 9]);
    press(&mut window, Modifiers::NONE, Key::Enter);
    window.get_by_label("Light here");
    press(&mut window, Modifiers::SHIFT, Key::ArrowLeft);
    let (at, value) = measured(&window).unwrap();
    assert_eq!(at, [x - 9, y - 9]);
    window.get_by_label(&value);
    press(&mut window, Modifiers::NONE, Key::P);
    window.get_by_label(&format!("Probe 1, {value}"));
    press(&mut window, Modifiers::NONE, Key::Escape);
    assert!(window.query_by_label("Light here").is_none() && measured(&window).is_none(), "it is left");

    // A pointer that moves in the picture is asked, and keys go on from there.
    window.get_by_label("Picture").focus();
    window.run_steps(4);
    assert_eq!(place(&window), at);
    window.hover_at(on_screen(&window, WALL));
    window.run_steps(4);
    let [x, y] = place(&window);
    assert_ne!([x, y], at);
    press(&mut window, Modifiers::NONE, Key::ArrowDown);
    assert_eq!(place(&window), [x, y + 1]);
}

/// What is said of the pixel under a pointer that moves there.
fn under(window: &mut Window, at: Pos2) -> String {
    window.hover_at(at);
    window.run_steps(4);
    let words = window.get_by_label_contains("cd/m²").accesskit_node().value().unwrap();
    words.split("   ").next().unwrap().to_owned()
}

#[test]
fn a_region_is_zoomed_to_and_the_whole_picture_comes_back() {
    let mut window = baked_larger();
    let area = window.get_by_label("Picture").rect();
    let from = area.center() + vec2(40.0, 20.0);
    let (middle, corner) = (from + vec2(50.0, 35.0), area.center() - vec2(200.0, 150.0));
    let (at_middle, at_corner) = (under(&mut window, middle), under(&mut window, corner));
    let look = window.state().look().clone();
    window.key_down(Key::Z);
    drag(&mut window, from, from + vec2(100.0, 70.0));
    window.key_up(Key::Z);
    window.run_steps(2);
    assert_eq!(*window.state().look(), look, "a region moves no light");
    assert_eq!(under(&mut window, area.center()), at_middle);
    window.key_press(Key::Home);
    window.run_steps(2);
    assert_eq!(under(&mut window, corner), at_corner);
    // One to one the 64 × 48 pixels are a stamp in the middle.
    window.key_press(Key::Num1);
    window.run_steps(2);
    window.hover_at(area.center() + vec2(33.0, 0.0));
    window.run_steps(4);
    assert!(window.query_by_label_contains("cd/m²").is_none());
    assert_eq!(under(&mut window, area.center() + vec2(-31.5, -23.5)), "0, 0");
}

#[test]
fn the_menu_of_the_picture_pins_a_probe_and_shows_each_pixel_or_all_of_them() {
    let mut window = baked_larger();
    let from_menu = |window: &mut Window, pos: Pos2, item: &str| {
        ask_for_menu(window, pos);
        click(window, item);
        window.run_steps(2);
    };
    let pin = |window: &Window| window.get_by_label_contains("Probe 1, ").rect().center();
    let (at, middle) = (on_screen(&window, WALL), window.get_by_label("Picture").rect().center());
    from_menu(&mut window, at, "Pin a probe here");
    let pinned = pin(&window);
    assert!(pinned.distance(at) < 10.0, "{pinned} for {at}");
    // One to one the 64 × 48 pixels are a stamp in the middle.
    let beside = at + vec2(60.0, 0.0);
    from_menu(&mut window, beside, "Show it pixel by pixel");
    assert!(pin(&window).distance(middle) < 40.0, "{}", pin(&window));
    from_menu(&mut window, beside, "Show the whole picture");
    assert_eq!(pin(&window), pinned);
}

#[test]
fn the_menu_of_the_picture_zooms_to_the_rectangle_that_is_dragged_next() {
    let mut window = baked_larger();
    let ask = |window: &mut Window, at: Pos2| {
        ask_for_menu(window, at);
        click(window, "Zoom to a rectangle");
    };
    let (at, middle) = (on_screen(&window, WALL), window.get_by_label("Picture").rect().center());
    let from = middle + vec2(40.0, 20.0);
    let (at_middle, at_region) = (under(&mut window, middle), under(&mut window, from + vec2(50.0, 35.0)));
    assert_ne!(at_middle, at_region);
    let look = window.state().look().clone();
    ask(&mut window, at);
    drag(&mut window, from, from + vec2(100.0, 70.0));
    assert_eq!(under(&mut window, middle), at_region);
    assert_eq!(*window.state().look(), look, "a region moves no light");
    // What was asked for can be left.
    window.key_press(Key::Home);
    window.run_steps(2);
    ask(&mut window, at);
    window.key_press(Key::Escape);
    window.run_steps(2);
    window.key_down(Key::Space);
    drag(&mut window, from, from + vec2(100.0, 70.0));
    window.key_up(Key::Space);
    window.run_steps(2);
    assert_ne!(under(&mut window, middle), at_region, "it moves the picture again");
}

#[test]
fn beside_the_picture_its_menu_offers_no_lamp() {
    let mut window = baked();
    let area = window.get_by_label("Picture").rect();
    for (at, is_offered) in [(area.left_top() + vec2(5.0, 5.0), false), (area.center() + vec2(60.0, 90.0), true)] {
        ask_for_menu(&mut window, at);
        window.get_by_label("Show the whole picture");
        assert_eq!(window.query_by_label_contains("Add lamp here").is_some(), is_offered, "{at}");
        window.key_press(Key::Escape);
        window.run_steps(3);
    }
}

/// The camera of the picture that is shown.
fn shown_camera(window: &Window) -> Camera {
    window.state().session().shown.as_ref().unwrap().camera.clone().unwrap()
}

/// Takes the camera in hand and turns it.
fn turn_camera(window: &mut Window) {
    window.key_press(Key::C);
    window.run_steps(3);
    let middle = window.get_by_label("View of the camera").rect().center();
    drag(window, middle, middle + vec2(60.0, 15.0));
}

/// Bakes the view of the camera in hand.
fn bake_view(window: &mut Window) {
    click(window, "Bake this view");
    wait(window, |app| app.session().bake == BakeState::Done && app.is_settled());
}

#[test]
fn a_view_is_looked_for_baked_and_kept_beside_the_first() {
    let mut window = baked_larger();
    let first = shown_camera(&window);
    click(&mut window, "Mute panel");
    let look = window.state().look().clone();
    turn_camera(&mut window);
    assert!(window.query_by_label("Picture").is_none());
    assert_eq!(window.query_all_by_label_contains("needs a new bake").count(), 1, "it is told plainly");
    assert_eq!((window.state().session().bake.clone(), shown_camera(&window)), (BakeState::Done, first.clone()));
    let turned = window.state().camera().unwrap().clone();
    assert!(turned != first && turned.name == "View 1" && turned.position() == first.position());

    bake_view(&mut window);
    assert_eq!(shown_camera(&window), turned);
    assert_eq!(*window.state().look(), look, "lights stay");
    window.get_by_label("Picture");
    assert_eq!(window.query_all_by_label_contains("2 baked views").count(), 1);
    assert_eq!(window.query_all_by_label_contains("64 × 48, ").count(), 2, "each tells size and memory");

    // Both switch at once, without a bake.
    let (n_before, n_whole) = (window.state().n_pictures(), window.state().session().n_whole);
    click(&mut window, &format!("Show view {}", first.name));
    assert_eq!(shown_camera(&window), first);
    assert!(window.state().session().n_whole > n_whole, "thumbnails are of the view that is shown");
    assert_eq!(window.state().session().bake, BakeState::Done);
    wait(&mut window, |app| app.n_pictures() > n_before && app.is_settled());
    assert_eq!(window.state().camera(), Some(&first));
    for (key, camera) in
        [(Key::PageDown, &turned), (Key::PageDown, &first), (Key::PageUp, &turned), (Key::PageUp, &first)]
    {
        window.key_press(key);
        window.run_steps(3);
        assert_eq!(shown_camera(&window), *camera, "{key:?}");
    }
    click(&mut window, "Forget view View 1");
    assert_eq!(window.state().session().views().len(), 1);
}

#[test]
fn what_another_view_will_take_is_told_and_nothing_of_those_that_are_baked() {
    let mut window = baked();
    let first = shown_camera(&window);
    let is_told = |app: &App| matches!(app.session().forecast(), Forecast::Told(_));
    assert_eq!(*window.state().session().forecast(), Forecast::None);
    turn_camera(&mut window);
    wait(&mut window, is_told);
    assert_eq!(window.query_all_by_label_contains("of memory, a file of").count(), 1);
    bake_view(&mut window);
    assert_eq!(*window.state().session().forecast(), Forecast::None);
    click(&mut window, &format!("Show view {}", first.name));
    assert_eq!(*window.state().session().forecast(), Forecast::None, "it is there as well");
}

#[test]
fn the_cameras_of_the_file_are_listed_and_the_room_is_seen_from_the_one_that_is_chosen() {
    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    let nodes = gltf["nodes"].as_array_mut().unwrap();
    let n_nodes = nodes.len();
    // Turned by a quarter to the right, and by the half.
    let turned = [0.0, -std::f32::consts::FRAC_1_SQRT_2, 0.0, std::f32::consts::FRAC_1_SQRT_2];
    let cameras =
        [("from the left", [-0.9, 0.0, 0.0], turned), ("from behind", [0.0, 0.0, -0.9], [0.0, 1.0, 0.0, 0.0])];
    for (name, position, rotation) in cameras {
        nodes.push(serde_json::json!({ "name": name, "camera": 0, "translation": position, "rotation": rotation }));
    }
    let roots = gltf["scenes"][0]["nodes"].as_array_mut().unwrap();
    roots.push(n_nodes.into());
    roots.push((n_nodes + 1).into());
    let bytes = serde_json::to_vec(&gltf).unwrap();
    let mut window = open(Source::Bytes { name: "room.gltf".into(), bytes });
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    let first = shown_camera(&window);
    assert!(first.name == "door" && window.query_by_label("from the left").is_none());
    click(&mut window, "View");
    for name in ["door", "from the left", "from behind"] {
        assert!(window.query_all_by_label(name).next().is_some(), "{name} is not listed");
    }
    click(&mut window, "from the left");
    window.get_by_label("View of the camera");
    let chosen = window.state().camera().unwrap().clone();
    assert_eq!((chosen.name.as_str(), chosen.position()), ("from the left", Vec3::new(-0.9, 0.0, 0.0)));
    let forward = -chosen.world_from_camera.z_axis.truncate();
    assert!(forward.distance(Vec3::X) < 1e-4, "{forward}");

    bake_view(&mut window);
    assert_eq!(shown_camera(&window), chosen);
    // The one that is baked is there again at once.
    click(&mut window, "View");
    click(&mut window, "door");
    assert_eq!((shown_camera(&window), window.state().session().bake.clone()), (first, BakeState::Done));
}

#[test]
fn another_view_can_be_looked_at_while_one_is_baked() {
    let mut window = baked_larger();
    let first = shown_camera(&window);
    turn_camera(&mut window);
    let turned = window.state().camera().unwrap().clone();
    click(&mut window, "Bake this view");
    wait(&mut window, |app| app.session().views().len() == 2);
    click(&mut window, &format!("Show view {}", first.name));
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    assert_eq!(shown_camera(&window), first, "a bake that ends elsewhere takes nothing away");
    let views = window.state().session().views();
    assert!(views.len() == 2 && views.iter().all(|view| view.error_db.is_some() && !view.is_baking), "{views:?}");
    click(&mut window, "Show view View 1");
    assert_eq!(shown_camera(&window), turned);
    window.get_by_label("Save bake…");
}

#[test]
fn the_camera_goes_back_to_the_baked_view() {
    let mut window = baked();
    let first = shown_camera(&window);
    turn_camera(&mut window);
    window.key_press(Key::Escape);
    window.run_steps(3);
    window.get_by_label("Picture");
    assert_eq!(window.state().camera(), Some(&first));
}

#[test]
fn a_solo_says_so_while_the_camera_is_in_hand_too() {
    let mut window = baked();
    click(&mut window, "Solo lamp");
    turn_camera(&mut window);
    let [banner, bake] = ["Solo: lamp", "Bake this view"].map(|label| window.get_by_label(label).rect());
    assert!(banner.top() > bake.bottom(), "{banner} below {bake}");
    click(&mut window, "Clear solo");
    assert!(window.query_by_label("Solo: lamp").is_none());
}

#[test]
fn with_large_letters_the_view_in_hand_can_be_baked_and_left() {
    let mut window = baked();
    window.set_size(vec2(1440.0, 900.0) / 2.0);
    window.run_steps(4);
    turn_camera(&mut window);
    let view = window.get_by_label("View of the camera").rect();
    for label in ["Bake this view", "Back"] {
        let button = window.get_by_label(label).rect();
        assert!(view.contains_rect(button), "{label} at {button} of {view}");
    }
}

#[test]
fn esc_that_closes_a_question_leaves_the_camera_in_hand() {
    let mut window = baked();
    click(&mut window, "Mute panel");
    turn_camera(&mut window);
    let turned = window.state().camera().unwrap().clone();
    ask_to_close(&mut window);
    window.get_by_label("Save the look?");
    window.key_press(Key::Escape);
    window.run_steps(3);
    assert!(window.query_by_label("Save the look?").is_none());
    window.get_by_label("View of the camera");
    assert_eq!(window.state().camera(), Some(&turned));
}

#[test]
fn esc_that_closes_a_list_leaves_the_camera_in_hand() {
    let mut window = baked();
    turn_camera(&mut window);
    click(&mut window, "Theme");
    window.get_by_label("As the system");
    window.key_press(Key::Escape);
    window.run_steps(3);
    assert!(window.query_by_label("As the system").is_none());
    window.get_by_label("View of the camera");
    window.key_press(Key::Escape);
    window.run_steps(3);
    window.get_by_label("Picture");
}

#[test]
fn esc_that_closes_the_list_of_keys_leaves_the_camera_in_hand() {
    let mut window = baked();
    turn_camera(&mut window);
    let turned = window.state().camera().unwrap().clone();
    window.key_press(Key::F1);
    window.run_steps(3);
    window.get_by_label("Keyboard and mouse");
    window.key_press(Key::Escape);
    window.run_steps(3);
    assert!(window.query_by_label("Keyboard and mouse").is_none());
    window.get_by_label("View of the camera");
    assert_eq!(window.state().camera(), Some(&turned));
    window.key_press(Key::Escape);
    window.run_steps(3);
    window.get_by_label("Picture");
}

#[test]
fn esc_that_gives_up_what_is_typed_leaves_the_camera_in_hand() {
    let mut window = baked();
    click(&mut window, "Numbers");
    turn_camera(&mut window);
    let turned = window.state().camera().unwrap().clone();
    type_keys(&mut window, "Camera X", "3");
    window.key_press(Key::Escape);
    window.run_steps(4);
    window.get_by_label("View of the camera");
    assert_eq!(window.state().camera(), Some(&turned));
    window.key_press(Key::Escape);
    window.run_steps(4);
    window.get_by_label("Picture");
}

#[test]
fn what_the_camera_did_is_undone_step_by_step_and_a_view_that_was_left_comes_back() {
    let mut window = baked();
    let first = shown_camera(&window);
    turn_camera(&mut window);
    let turned = window.state().camera().unwrap().clone();
    let middle = window.get_by_label("View of the camera").rect().center();
    drag(&mut window, middle, middle + vec2(-20.0, 40.0));
    let further = window.state().camera().unwrap().clone();
    assert!(first != turned && turned != further);
    for (name, expected) in [("Undo", &turned), ("Undo", &first), ("Redo", &turned), ("Redo", &further)] {
        click(&mut window, name);
        assert_eq!(window.state().camera(), Some(expected), "{name}");
        window.get_by_label("View of the camera");
    }
    window.key_press(Key::Escape);
    window.run_steps(3);
    window.get_by_label("Picture");
    assert_eq!(window.state().camera(), Some(&first));
    click(&mut window, "Undo");
    assert_eq!(window.state().camera(), Some(&further), "the view that was not baked");
    window.get_by_label("View of the camera");
    // Before it was taken in hand.
    for _ in 0..3 {
        click(&mut window, "Undo");
    }
    window.get_by_label("Picture");
    assert_eq!(window.state().camera(), Some(&first));
}

#[test]
fn numbers_of_the_camera_are_a_step_each_however_soon_they_follow() {
    let mut window = baked();
    let first = shown_camera(&window).position();
    click(&mut window, "Numbers");
    for (label, meters) in [("Camera X", 0.1), ("Camera X", 0.2), ("Camera Y", 0.3)] {
        window.get_by_label(label).set_value_accesskit(meters);
        // Half a second, in which no state rests.
        window.run_steps(2);
    }
    let way = |window: &Window| window.state().camera().unwrap().position() - first;
    assert!(way(&window).distance(Vec3::new(0.2, 0.3, 0.0)) < 1e-5, "{}", way(&window));
    click(&mut window, "Undo");
    assert!(way(&window).distance(Vec3::new(0.2, 0.0, 0.0)) < 1e-5, "{}", way(&window));
    click(&mut window, "Undo");
    assert_eq!(way(&window), Vec3::ZERO, "the same number twice is one step");
}

#[test]
fn a_view_of_another_shape_brings_its_film_and_undo_that_of_the_one_before() {
    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    let perspective = serde_json::json!({ "yfov": 1.0, "aspectRatio": 2.0, "znear": 0.01 });
    let cameras = gltf["cameras"].as_array_mut().unwrap();
    cameras.push(serde_json::json!({ "type": "perspective", "perspective": perspective }));
    let n_cameras = cameras.len();
    let nodes = gltf["nodes"].as_array_mut().unwrap();
    nodes.push(serde_json::json!({ "name": "wide", "camera": n_cameras - 1, "translation": [0, 0.2, 0.9] }));
    let n_nodes = nodes.len();
    gltf["scenes"][0]["nodes"].as_array_mut().unwrap().push((n_nodes - 1).into());
    let source = Source::Bytes { name: "room.gltf".into(), bytes: serde_json::to_vec(&gltf).unwrap() };
    let builder = Harness::builder().with_size(vec2(1440.0, 900.0));
    let mut window: Window = builder.build_eframe(|cc| App::new(cc, Start::alone(source, None)).unwrap());
    wait(&mut window, |app| app.session().bake.is_running());
    click(&mut window, "Stop the bake");
    for (label, number) in [("Width", 48.0), ("Samples per pixel", 4.0)] {
        window.get_by_label(label).set_value_accesskit(number);
        window.run_steps(3);
    }
    reach(&mut window, "Start bake");
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.is_settled());
    let film = |window: &Window| window.state().settings().film;
    assert_eq!(film(&window), Film { width: 48, height: 36 });
    click(&mut window, "View");
    click(&mut window, "wide");
    let wide = Film { width: 48, height: 24 };
    assert_eq!(film(&window), wide);
    for (name, wanted) in [("Undo", Film { width: 48, height: 36 }), ("Redo", wide)] {
        click(&mut window, name);
        assert_eq!(film(&window), wanted, "{name}");
    }
    window.key_press(Key::Escape);
    window.run_steps(3);
    assert_eq!(film(&window), Film { width: 48, height: 36 }, "and so has the view that is shown");

    // A view that is baked brings it as well, from the list of them and from that of the cameras.
    click(&mut window, "View");
    click(&mut window, "wide");
    bake_view(&mut window);
    assert_eq!(film(&window), wide);
    click(&mut window, "Show view door");
    assert_eq!(film(&window), Film { width: 48, height: 36 });
    click(&mut window, "View");
    click(&mut window, "wide");
    assert_eq!((film(&window), window.query_by_label("View of the camera").is_none()), (wide, true));
    for (label, number) in [("Width", 60.0), ("Height", 60.0)] {
        window.get_by_label(label).set_value_accesskit(number);
        window.run_steps(3);
    }
    click(&mut window, "Show view door");
    assert_eq!(film(&window), Film { width: 60, height: 60 }, "what was typed stays");
}

#[test]
fn a_reload_keeps_the_view_and_what_was_chosen() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.gltf");
    std::fs::write(&path, room()).unwrap();
    let mut window = open(Source::File(path.clone()));
    let strength = |app: &App| app.session().basis().and_then(|basis| basis.source("lamp")).map_or(0.0, |s| s.strength);
    let is_ready = |app: &App| app.session().bake == BakeState::Done && app.is_settled();
    wait(&mut window, is_ready);
    reach(&mut window, "Unitless lamps");
    wait(&mut window, |app| strength(app) > 100.0 && is_ready(app));
    turn_camera(&mut window);
    bake_view(&mut window);
    click(&mut window, "Solo lamp");
    let (turned, bright) = (shown_camera(&window), strength(window.state()));

    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    gltf["materials"][0]["pbrMetallicRoughness"] = serde_json::json!({ "baseColorFactor": [0.2, 0.3, 0.4, 1.0] });
    let fingerprint = |app: &App| app.session().shown.as_ref().map(|shown| shown.header.fingerprint.clone());
    let before = fingerprint(window.state());
    replace_and_reload(&mut window, &path, &gltf);
    wait(&mut window, |app| fingerprint(app).is_some_and(|now| Some(now) != before) && is_ready(app));
    assert_eq!((shown_camera(&window), strength(window.state())), (turned, bright));
    window.get_by_label("Solo: lamp");
}

/// Columns that the bake of the view that is shown did not trace.
fn taken_over(window: &Window) -> usize {
    window.state().session().figures.as_ref().unwrap().skipped.reused_columns
}

#[test]
fn a_bookmark_that_is_renamed_keeps_its_baked_view() {
    let mut window = baked();
    turn_camera(&mut window);
    click(&mut window, "Bookmark");
    click(&mut window, "View");
    click(&mut window, "Bookmark 1");
    bake_view(&mut window);
    assert_eq!(taken_over(&window), 0);
    window.get_by_label("Name of the bookmark").set_text_value_accesskit("Door");
    window.run_steps(3);
    for (step, name) in [("Undo", "Bookmark 1"), ("Redo", "Door")] {
        click(&mut window, step);
        assert_eq!(window.state().camera().unwrap().name, name, "{step}");
        window.get_by_label("Name of the bookmark");
    }
    reach(&mut window, "Start bake");
    let is_renamed = |app: &App| app.session().shown.as_ref().is_some_and(|shown| shown.header.camera == "Door");
    wait(&mut window, |app| is_renamed(app) && app.session().bake == BakeState::Done && app.is_settled());
    assert_eq!(taken_over(&window), window.state().session().basis().unwrap().n_cols() as usize);
    assert_eq!(window.state().session().views().len(), 2, "in place of what it was called before");
}

#[test]
fn a_view_that_is_looked_for_is_called_as_no_bookmark_is() {
    let mut window = baked();
    turn_camera(&mut window);
    click(&mut window, "Bookmark");
    window.get_by_label("Name of the bookmark").set_text_value_accesskit("View 1");
    window.run_steps(3);
    assert_eq!(window.state().look().bookmarks[0].name, "View 1");
    let middle = window.get_by_label("View of the camera").rect().center();
    drag(&mut window, middle, middle + vec2(60.0, 15.0));
    assert_eq!(window.state().camera().unwrap().name, "View 2");
}

#[test]
fn a_bake_finds_its_scene_whose_camera_was_renamed() {
    let window = baked();
    let bake = window.state().session().shown.as_ref().unwrap().bake();
    drop(window);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.transport");
    archive::write(&bake, &path).unwrap();
    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    let nodes = gltf["nodes"].as_array_mut().unwrap();
    nodes.iter_mut().filter(|node| node["name"] == "door").for_each(|node| node["name"] = "gate".into());
    // The camera is not the first one any more; the lamp keeps its number.
    nodes.insert(2, serde_json::json!({ "name": "hatch", "camera": 0, "translation": [0, 0.4, 0.9] }));
    let n_nodes = nodes.len();
    gltf["scenes"][0]["nodes"] = (0..n_nodes).collect();
    std::fs::write(folder.path().join("room.gltf"), gltf.to_string()).unwrap();
    let start = Start::alone(Source::File(path), None);
    let mut window = Harness::builder().build_eframe(|cc| App::new(cc, start).unwrap());
    wait(&mut window, |app| app.session().has_scene());
    assert_eq!(window.state().camera().unwrap().name, "gate");
    assert_eq!(window.state().settings().camera_idx, 1);
}

#[test]
fn who_wants_to_walks_with_the_keys() {
    let mut window = baked();
    click(&mut window, "Numbers");
    window.get_by_role_and_label(Role::SpinButton, "Yaw").set_value_accesskit(-45.0);
    window.run_steps(3);
    let stepped = |window: &mut Window, key: Key| {
        let before = window.state().camera().unwrap().position();
        window.key_down(key);
        window.run_steps(4);
        window.key_up(key);
        window.run_steps(2);
        window.state().camera().unwrap().position() - before
    };
    assert_eq!(stepped(&mut window, Key::W), Vec3::ZERO, "nobody asked for it yet");
    reach(&mut window, "Navigation");
    reach(&mut window, "Walk with W A S D");
    let ahead = Vec3::new(-1.0, 0.0, -1.0).normalize();
    let right = Vec3::new(1.0, 0.0, -1.0).normalize();
    let ways =
        [(Key::W, ahead), (Key::S, -ahead), (Key::D, right), (Key::A, -right), (Key::E, Vec3::Y), (Key::Q, -Vec3::Y)];
    for (key, way) in ways {
        let step = stepped(&mut window, key);
        assert!(step.length() > 0.05 && step.normalize().dot(way) > 0.999, "{key:?} goes {step}");
    }
}

#[test]
fn a_view_that_is_left_by_a_key_before_it_rests_comes_back_by_undo() {
    let mut window = baked();
    let first = shown_camera(&window);
    reach(&mut window, "Navigation");
    reach(&mut window, "Walk with W A S D");
    turn_camera(&mut window);
    bake_view(&mut window);
    window.key_press(Key::C);
    // Two seconds, in which the view that was baked rests.
    window.run_steps(8);
    window.key_down(Key::W);
    window.run_steps(2);
    window.key_up(Key::W);
    window.run_steps(1);
    let walked = window.state().camera().unwrap().clone();
    assert!(walked.position() != first.position());
    window.key_press(Key::PageDown);
    window.run_steps(3);
    assert_eq!((shown_camera(&window), window.state().camera()), (first.clone(), Some(&first)));
    let hint = "Undo brings back the view that was not baked";
    assert!(window.query_all_by_label(hint).next().is_some());
    click(&mut window, "Undo");
    assert_eq!(window.state().camera(), Some(&walked));
    window.get_by_label("View of the camera");
}

#[test]
fn focal_length_and_shift_are_those_of_the_lens() {
    let mut window = baked();
    let first = shown_camera(&window);
    click(&mut window, "Numbers");
    let set = |window: &mut Window, name: &str, value: f64| {
        window.get_by_role_and_label(Role::SpinButton, name).set_value_accesskit(value);
        window.run_steps(3);
        window.state().camera().unwrap().clone()
    };
    // A picture of 4 : 3 is 27 mm high on film that is 36 mm wide.
    let long = set(&mut window, "Focal length", 24.0);
    assert!((long.yfov_rad - 2.0 * (13.5f32 / 24.0).atan()).abs() < 1e-4, "{}", long.yfov_rad);
    window.get_by_label("View of the camera");
    let shifted = set(&mut window, "Shift X", 0.25);
    assert_eq!((shifted.shift, shifted.yfov_rad), ([0.25, 0.0], long.yfov_rad));
    let ahead = first.position() + Vec3::NEG_Z;
    let px = shifted.project(Film { width: 64, height: 48 }, ahead).unwrap();
    assert!(px.distance(glam::Vec2::new(16.0, 24.0)) < 1e-3, "the middle went to the left: {px}");
}

#[test]
fn verticals_are_straightened_and_bookmarks_are_kept() {
    let mut window = baked();
    turn_camera(&mut window);
    click(&mut window, "Bookmark");
    let tilted = window.state().camera().unwrap().clone();
    let kept = window.state().look().bookmarks.clone();
    assert!(kept.len() == 1 && kept[0].world_from_camera == tilted.world_from_camera, "the look has it");
    click(&mut window, "Undo");
    assert!(window.state().look().bookmarks.is_empty(), "one step");
    click(&mut window, "Redo");
    assert_eq!(window.state().look().bookmarks, kept);
    assert!(Pose::of(&tilted).pitch_rad.abs() > 0.02);
    assert!(window.query_by_label("Copy as options").is_none(), "the numbers are folded");
    click(&mut window, "Straighten verticals");
    let upright = window.state().camera().unwrap().clone();
    assert!(Pose::of(&upright).pitch_rad.abs() < 1e-5 && upright.shift[1] != 0.0, "{upright:?}");
    click(&mut window, "View");
    click(&mut window, "Bookmark 1");
    let back = window.state().camera().unwrap();
    assert_eq!((back.world_from_camera, back.shift), (tilted.world_from_camera, [0.0; 2]));
    window.get_by_label("Name of the bookmark");
    reach(&mut window, "Remove");
    assert!(window.state().look().bookmarks.is_empty() && window.query_by_label("Name of the bookmark").is_none());
    click(&mut window, "Undo");
    assert_eq!(window.state().look().bookmarks, kept, "one step");
}
