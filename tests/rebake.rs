//! A bake again, through the command line: what the file says of its lights has changed, or more than that.

use glam::Vec3;
use serde_json::Value;

use crate::pipeline::Desk;
use crate::support::{SceneFile, two_lamps_and_a_panel};

const BAKE: &str = "bake @room.glb -o @room.transport --size 48x32 --spp 32";

fn write(desk: &Desk, scene: &SceneFile) {
    std::fs::write(desk.path("room.glb"), scene.glb()).unwrap();
}

fn with_a_third_lamp() -> SceneFile {
    two_lamps_and_a_panel().point_lamp("third", Vec3::new(0.2, -0.5, 0.4), [1.0; 3], 0.6)
}

#[test]
fn a_lamp_added_to_a_scene_is_all_that_is_traced() {
    let desk = Desk::new();
    assert_eq!(desk.json(BAKE)["reuse"], Value::Null);
    write(&desk, &with_a_third_lamp());
    std::fs::copy(desk.path("room.transport"), desk.path("earlier.transport")).unwrap();
    let again = desk.json(BAKE);
    assert_eq!((&again["reuse"]["columns"], &again["reuse"]["traced_columns"]), (&18.into(), &1.into()), "{again}");
    assert_eq!((&again["skipped"]["reused_columns"], &again["columns"]), (&18.into(), &19.into()));
    let info = desk.json("info @room.transport");
    assert_eq!(info["skipped"]["reused_columns"], 18, "{info}");
    let said = desk.run(&BAKE.replace("@room.transport", "@named.transport --reuse @earlier.transport"));
    assert!(said.stdout.contains("18 of 19 columns from") && said.stdout.contains(", 1 traced"), "{}", said.stdout);
    assert_eq!(
        std::fs::read(desk.path("named.transport")).unwrap(),
        std::fs::read(desk.path("room.transport")).unwrap()
    );
    // A bake from scratch is the same picture, but for noise.
    let full = desk.json(&BAKE.replace("@room.transport", "@full.transport --no-skip=reuse"));
    assert_eq!(full["skipped"]["reused_columns"], 0);
    for name in ["room", "full"] {
        desk.json(&format!("relight @{name}.transport -o @{name}.exr"));
    }
    let compared = desk.json("compare @room.exr @full.exr");
    let bias = compared["mean_bias"].as_array().unwrap().iter().map(|bias| bias.as_f64().unwrap().abs());
    assert!(bias.fold(0.0, f64::max) < 0.02, "{compared}");
    assert!(compared["psnr_db"].as_f64().unwrap() > 25.0, "{compared}");
}

#[test]
fn a_wall_that_moved_is_traced_with_everything_and_the_answer_says_why() {
    let desk = Desk::new();
    desk.json(BAKE);
    let other = SceneFile::lambert([0.2; 3], [0.0; 3]);
    let shape = crate::support::Shape::room(Vec3::splat(0.1));
    write(&desk, &two_lamps_and_a_panel().surface("box", &shape, other));
    let again = desk.json(BAKE);
    assert!(again["reuse"]["why_not"].as_str().unwrap().contains("surfaces or materials"), "{again}");
    assert_eq!(again["skipped"]["reused_columns"], 0);
    let fresh = desk.json(&BAKE.replace("@room.transport", "@fresh.transport"));
    assert_eq!(fresh["reuse"], Value::Null);
    let bytes = |name: &str| std::fs::read(desk.path(name)).unwrap();
    assert_eq!(bytes("room.transport"), bytes("fresh.transport"), "nothing of the earlier bake is in it");
    // The same scene again: all of it is there, unless somebody wants to start over.
    let same = desk.json(BAKE);
    assert_eq!(same["reuse"]["traced_columns"], 0, "{same}");
    assert_eq!(desk.json(&format!("{BAKE} --fresh"))["reuse"], Value::Null);
    assert_eq!(desk.json(&format!("{BAKE} --no-skip"))["skipped"]["reused_columns"], 0);
}

#[test]
fn what_cannot_be_taken_over_is_told() {
    let desk = Desk::new();
    std::fs::write(desk.path("none.transport"), "no bake").unwrap();
    desk.fails(&format!("{BAKE} --reuse @none.transport"), 1, "cannot take anything over");
    desk.fails(&format!("{BAKE} --reuse @none.transport --fresh"), 2, "--fresh");
    desk.json(&BAKE.replace("@room.transport", "@other.transport --bounces 1"));
    let said = desk.json(&format!("{BAKE} --reuse @other.transport"));
    assert!(said["warnings"][0].as_str().unwrap().contains("settings"), "{said}");
}
