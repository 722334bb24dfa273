//! Light adds up, and every lamp answers to its own setting alone.

use clerestory_transport::bake::BakeConfig;
use clerestory_transport::camera::Film;
use clerestory_transport::light::{LightRig, LightSetting, PanelSpot};
use clerestory_transport::trace::TraceConfig;
use glam::Vec3;

use crate::support::{Mean, SceneFile, baked, prepare, relit, traced, two_lamps_and_a_panel};

const FILM: Film = Film { width: 32, height: 24 };

fn only(key: &str) -> LightRig {
    let mut rig = LightRig::default();
    for other in ["warm", "cool", "panel"].into_iter().filter(|other| *other != key) {
        rig.lights.insert(other.into(), LightSetting { muted: true, ..LightSetting::default() });
    }
    rig
}

fn largest_difference(a: &[[f32; 3]], b: &[[f32; 3]]) -> f32 {
    let pairs = a.iter().flatten().zip(b.iter().flatten());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

fn sum(pictures: &[Vec<[f32; 3]>]) -> Vec<[f32; 3]> {
    let pixel = |idx: usize| std::array::from_fn(|c| pictures.iter().map(|p| p[idx][c]).sum());
    (0..pictures[0].len()).map(pixel).collect()
}

#[test]
fn two_lamps_together_equal_two_lamps_apart() {
    let scene = prepare(&two_lamps_and_a_panel().glb());
    let bake = baked(&scene, FILM, BakeConfig { spp: 16, ..BakeConfig::default() });
    let apart = ["warm", "cool", "panel"].map(|key| relit(&bake, &only(key)).pixels);
    let together = relit(&bake, &LightRig::default()).pixels;
    let brightest = together.iter().flatten().copied().fold(0.0, f32::max);
    assert!(apart.iter().all(|p| p.iter().flatten().any(|v| *v > 0.01 * brightest)), "a lamp shows nothing");
    assert!(largest_difference(&sum(&apart), &together) < 1e-4 * brightest);
}

#[test]
fn traced_lamps_add_up_too() {
    let scene = prepare(&two_lamps_and_a_panel().glb());
    // Light that was scattered twice is as linear as what goes on, and less noisy.
    let picture = |rig: &LightRig, seed| traced(&scene, rig, FILM, &TraceConfig { spp: 192, bounces: Some(1), seed });
    let apart = sum(&[picture(&only("warm"), 1), picture(&only("cool"), 2), picture(&only("panel"), 3)]);
    let together = picture(&LightRig::default(), 4);
    let differences = apart.iter().zip(&together).map(|(a, b)| f64::from(a[1] - b[1]));
    let scale = Mean::of(together.iter().map(|rgb| f64::from(rgb[1]))).value;
    Mean::of(differences).assert_is(0.0, 1e-4 * scale, 2.5e-3 * scale);
}

#[test]
fn a_red_lamp_can_turn_blue_after_the_bake() {
    let file = SceneFile::default()
        .surface("room", &crate::support::Shape::room(Vec3::ONE), SceneFile::lambert([0.6; 3], [0.0; 3]))
        .point_lamp("red", Vec3::new(0.2, 0.5, 0.0), [1.0, 0.0, 0.0], 2.0)
        .camera("inside", Vec3::new(0.0, 0.0, 0.8), 1.0);
    let bake = baked(&prepare(&file.glb()), FILM, BakeConfig { spp: 8, ..BakeConfig::default() });
    let red = relit(&bake, &LightRig::default()).pixels;
    let mut rig = LightRig::default();
    rig.lights.insert("red".into(), LightSetting { color: Some([0.0, 0.0, 1.0]), ..LightSetting::default() });
    let blue = relit(&bake, &rig).pixels;
    assert!(red.iter().all(|rgb| rgb[0] > 0.0 && rgb[2].abs() <= 1e-4 * rgb[0]));
    assert!(red.iter().zip(&blue).all(|(r, b)| (r[0] - b[2]).abs() <= 2e-2 * r[0] && b[0].abs() <= 1e-4 * b[2]));
}

#[test]
fn a_spot_as_wide_as_its_panel_is_the_uniform_panel() {
    let scene = prepare(&two_lamps_and_a_panel().glb());
    let bake = baked(&scene, FILM, BakeConfig { spp: 8, ..BakeConfig::default() });
    let mut rig = LightRig::default();
    rig.panels
        .insert("panel".into(), vec![PanelSpot { position: [0.5; 2], radius: 50.0, color: None, intensity: 1.0 }]);
    let uniform = relit(&bake, &LightRig::default()).pixels;
    let brightest = uniform.iter().flatten().copied().fold(0.0, f32::max);
    assert!(largest_difference(&uniform, &relit(&bake, &rig).pixels) < 1e-4 * brightest);
}
