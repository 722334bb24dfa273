//! Laws of lamps close to surfaces: what they throw on patches is their light, no less and no more, and moves as they do.

use clerestory_nystrom::BlockLowRank;
use glam::Vec3;

use super::patches::{FILM, furnace, furnished, furnished_and_baked, middles, peak};
use super::stage::{Stage, lambert, pane, quad, room};
use crate::bake::Bake;
use crate::bake::focus::Focus;
use crate::lamps::tests::ONE_SIDED;
use crate::lamps::{FreeLamp, LampShape, LampUnit, PreparedLamps};
use crate::light::LightSetting;
use crate::patches::{NARROW_ALPHA, PatchSample, Patches, Request, learn};
use crate::prepared::PreparedScene;
use crate::sampler::uniform_hash;
use crate::scene::Material;
use crate::slabs::IN_A_ROW;
use crate::visible::{VisibleConfig, VisiblePoints};

/// Flux of the lamps, lm.
const FLUX: f32 = 100.0;
const FLOOR: f32 = -1.2;
/// Size of the bodies: radius, or half a side, m.
const SIZE: f32 = 0.02;

fn shapes() -> [LampShape; 5] {
    [
        LampShape::Point,
        LampShape::Spot { inner_rad: 0.3, outer_rad: 0.6 },
        LampShape::Sphere { radius_m: SIZE },
        LampShape::Disk { radius_m: SIZE },
        LampShape::Rectangle { size_m: [40.0 * SIZE, 2.0 * SIZE] },
    ]
}

/// Lamps that look down.
fn prepared(shape: &LampShape, position: Vec3) -> PreparedLamps {
    aimed(shape, position, position - Vec3::Y)
}

fn aimed(shape: &LampShape, position: Vec3, aim: Vec3) -> PreparedLamps {
    let (setting, unit) = (LightSetting::default(), LampUnit::Lumen);
    let shape = shape.clone();
    let lamp = FreeLamp {
        key: "close".into(),
        shape,
        position,
        aim,
        strength: FLUX,
        unit,
        setting,
        turn_rad: 0.0,
        replaces: None,
    };
    PreparedLamps::new(&[lamp], None).expect("a lamp that makes sense").0
}

fn learned(scene: &PreparedScene, n_patches: u32) -> Patches {
    let request = Request { n_patches, bounces: None, seed: 5, narrow_alpha: NARROW_ALPHA };
    learn(scene, &scene.scene.cameras[0], FILM, request, &Focus::default()).expect("the room has patches")
}

/// Irradiance of patches.
fn thrown(scene: &PreparedScene, patches: &Patches, lamps: &PreparedLamps) -> Vec<Vec3> {
    lamps.irradiance_of_patches(scene, patches, None)
}

/// Share of the light that patches receive, by their areas, red.
fn received(patches: &Patches, light: &[Vec3]) -> f32 {
    let areas = patches.layout().expect("patches that were just learned").areas_m2();
    light.iter().zip(areas).map(|(light, area)| light.x * area).sum::<f32>() / FLUX
}

fn range(values: impl Iterator<Item = f32> + Clone) -> (f32, f32) {
    (values.clone().fold(f32::INFINITY, f32::min), values.fold(0.0, f32::max))
}

/// Places over the floor.
fn feet(n: u64) -> impl Iterator<Item = Vec3> {
    let at = |key: u64| 2.0 * uniform_hash(key) - 1.0;
    (0..n).map(move |nth| Vec3::new(1.5 * at(2 * nth), FLOOR, 1.3 * at(2 * nth + 1)))
}

/// How far its middle is above the floor where the lowest point of the lamp is.
fn raised(shape: &LampShape, height: f32) -> f32 {
    if matches!(shape, LampShape::Sphere { .. }) { height + SIZE } else { height }
}

#[test]
fn patches_of_a_closed_room_have_its_area() {
    let patches = learned(&furnace(0.6).prepared(), 1024);
    let area: f32 = patches.layout().expect("patches that were just learned").areas_m2().sum();
    let whole = 2.0 * (4.0 * 2.4 + 4.0 * 3.0 + 2.4 * 3.0);
    println!("{area} m², {whole} m²");
    assert!((area / whole - 1.0).abs() < 0.05, "{area} m² of {whole}");
}

#[test]
fn surfaces_receive_what_a_lamp_close_to_them_sends() {
    let scene = furnace(0.6).prepared();
    let patches = learned(&scene, 1024);
    for shape in shapes() {
        for height in [1e-3, 4e-3, 0.02, 0.1, 0.3, 0.6] {
            // A point is no brighter than 1 cm away: half of its light goes down, less of which arrives.
            let kept = (height / 0.01f32).min(1.0);
            let all = match shape {
                LampShape::Point => 0.5 * (1.0 + 2.0 * kept - kept * kept),
                LampShape::Spot { .. } => kept * kept,
                _ => 1.0,
            };
            let shares = feet(12).map(|foot| {
                let lamps = prepared(&shape, foot + Vec3::Y * raised(&shape, height));
                received(&patches, &thrown(&scene, &patches, &lamps)) / all
            });
            let shares: Vec<f32> = shares.collect();
            let found = range(shares.iter().copied());
            println!("{shape:?} at {height} m: {found:.3?} of the light");
            // Near the rim of a beam at 1 mm light goes farther, and less is lost.
            let most = if matches!(shape, LampShape::Spot { .. }) && kept < 1.0 { 1.25 } else { 1.05 };
            assert!(found.0 > 0.95 && found.1 < most, "{shape:?} at {height} m: {found:.3?} of the light");
        }
    }
}

#[test]
fn far_from_the_origin_surfaces_receive_as_much_of_a_lamp_close_to_them() {
    let height = 0.05;
    // Ten kilometers away samples lie 5 mm above their surface, a tenth of the lamp's height: so much less reaches those beside it.
    let [near, far] = [Vec3::ZERO, Vec3::new(1e4, -1e4, 1e4)].map(|middle| {
        let scene = furnace(0.6).moved(middle).prepared();
        let patches = learned(&scene, 512);
        shapes().map(|shape| {
            let places = feet(8).map(|foot| middle + foot + Vec3::Y * raised(&shape, height));
            let share = |place| received(&patches, &thrown(&scene, &patches, &prepared(&shape, place)));
            places.map(share).sum::<f32>() / 8.0
        })
    });
    println!("{near:.3?} of the light, {far:.3?} far away");
    for ((near, far), shape) in near.into_iter().zip(far).zip(shapes()) {
        assert!((far / near - 1.0).abs() < 0.1, "{shape:?}: {far:.3} of the light far away, {near:.3} near the origin");
    }
}

/// A closed room with a sheet of solid glass above its floor.
fn with_sheet() -> PreparedScene {
    let sheet = room(Vec3::new(1.2, 0.02, 1.0)).into_iter().rev().map(|corner| corner + Vec3::Y * (FLOOR + 0.1));
    let glass = Material { thickness: 1.0, ..pane() };
    let scene = furnace(0.6).surface("sheet", &sheet.collect::<Vec<_>>(), glass).prepared();
    assert_eq!(scene.slabs.len(), 1);
    scene
}

#[test]
fn faces_of_solid_panes_before_patches_count_as_bounces() {
    let scene = with_sheet();
    let patches = learned(&scene, 1024);
    // Thrown, and asked for at samples as well.
    for (angles, height) in [([0.3, 0.6], 0.3), ([0.1, 0.2], 2.2)] {
        let spot = LampShape::Spot { inner_rad: angles[0], outer_rad: angles[1] };
        let lamps = prepared(&spot, Vec3::new(0.1, FLOOR + height, 0.05));
        let share = |bounces| received(&patches, &lamps.irradiance_of_patches(&scene, &patches, bounces));
        let all = share(None);
        assert!(all > 0.5 && share(Some(3)) == all, "{height} m: two faces and a patch are three of {all}");
        assert_eq!([1, 2].map(|few| share(Some(few))), [0.0; 2], "{height} m");
    }
}

#[test]
fn beams_pass_a_sheet_of_solid_glass() {
    let scene = with_sheet();
    let patches = learned(&scene, 1024);
    let lamps = prepared(&LampShape::Spot { inner_rad: 0.3, outer_rad: 0.6 }, Vec3::new(0.1, FLOOR + 0.3, 0.05));
    let share = received(&patches, &thrown(&scene, &patches, &lamps));
    println!("{share:.3} of the light");
    // Two faces let pass 96 % each.
    assert!((share - 0.92).abs() < 0.05, "{share:.3} of the light");
}

#[test]
fn a_lamp_on_a_sample_is_no_flash() {
    let scene = furnished().prepared();
    let patches = learned(&scene, 512);
    for shape in shapes() {
        let most = |heights: &[f32]| {
            let samples = patches.samples().iter().step_by(41);
            let places = samples.flat_map(|at| heights.iter().map(|h| at.position + at.normal * *h));
            let share = |place| received(&patches, &thrown(&scene, &patches, &prepared(&shape, place)));
            places.map(share).fold(0.0, f32::max)
        };
        let (beside, within) = (most(&[-0.5 * SIZE, 1e-3, 0.7 * SIZE]), most(&[0.0, 1e-6]));
        println!("{shape:?}: {beside:.3} of the light; in a surface {within:.3}");
        assert!(beside < 1.06, "{shape:?}: {beside:.3} of the light");
        // What lies in a surface lights both of its sides: rays from elsewhere end a little before it.
        assert!(within < 2.06, "{shape:?}: {within:.3} of the light");
    }
}

#[test]
fn few_points_of_a_body_far_away_tell_what_many_tell() {
    let scene = furnished().prepared();
    let patches = learned(&scene, 512);
    for shape in [LampShape::Sphere { radius_m: 0.1 }, LampShape::Rectangle { size_m: [0.2, 0.1] }] {
        let lamps = prepared(&shape, Vec3::new(0.3, 0.6, -0.2));
        let plain = patches.samples().iter().map(|at| PatchSample { grazing: 0.0, ..*at });
        let (mut apart, mut all) = (0.0, 0.0);
        for at in plain {
            let many = lamps.irradiance(&scene, at.position, at.normal, None).x;
            apart += (lamps.light_on(&scene, &at, IN_A_ROW).x - many).abs();
            all += many;
        }
        println!("{shape:?}: {:.2} %", 100.0 * apart / all);
        assert!(apart < 0.03 * all, "{shape:?}: {apart} of {all}");
    }
}

/// The picture of a lamp by way of patches.
fn picture(bake: &Bake, light: &[Vec3]) -> Vec<f32> {
    let patches = bake.header.patches.as_ref().expect("patches");
    let red: Vec<f32> = patches.coefficients_of(light).iter().map(|rgb| rgb[0]).collect();
    let group: &BlockLowRank = bake.groups.last().expect("a group of patches");
    group.apply(&red)
}

fn size(picture: &[f32]) -> f64 {
    picture.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt()
}

/// The largest change from one picture of a lamp to the next by some measure, and behind which of them.
fn jump(frames: &[Vec<f32>], measure: fn(&[f32]) -> f64) -> (f64, usize) {
    let change = |w: &[Vec<f32>]| measure(&w[0].iter().zip(&w[1]).map(|(a, b)| a - b).collect::<Vec<_>>());
    let changes = frames.windows(2).map(change).enumerate();
    changes.fold((0.0, 0), |most, (nth, change)| if change > most.0 { (change, nth) } else { most })
}

#[test]
fn while_a_lamp_moves_close_to_a_floor_the_picture_does_not_jump() {
    let (scene, bake) = furnished_and_baked();
    let patches = bake.header.patches.as_ref().expect("patches");
    for shape in shapes() {
        let typical = picture(bake, &thrown(scene, patches, &prepared(&shape, Vec3::new(0.3, 0.7, 0.2))));
        let frame = |step_m: f32| {
            let place = Vec3::new(-1.5 + step_m, FLOOR + raised(&shape, 0.02), 0.9);
            picture(bake, &thrown(scene, patches, &prepared(&shape, place)))
        };
        let frames: Vec<Vec<f32>> = (0..128).map(|nth| frame(5e-3 * nth as f32)).collect();
        let measures: [fn(&[f32]) -> f64; 2] = [size, peak];
        let [whole, pixel] = measures.map(|measure| {
            let (coarse, at) = jump(&frames, measure);
            // A jump stays as large as it is where its step is divided.
            let divided: Vec<Vec<f32>> = (0..=5).map(|nth| frame(5e-3 * at as f32 + 1e-3 * nth as f32)).collect();
            [coarse, jump(&divided, measure).0].map(|change| change / measure(&typical))
        });
        println!("{shape:?}: changes of {whole:.3?} of the light in 5 mm and in 1 mm, of {pixel:.3?} of a pixel");
        assert!(whole[0] < 0.15 && whole[1] < 0.05, "{shape:?}: changes of {whole:.3?} of the light");
        // A narrow cone two centimeters above a floor moves on by a third of its spot in 5 mm.
        assert!(pixel[0] < 1.0 && pixel[1] < 0.25, "{shape:?}: changes of {pixel:.3?} of the brightest pixel");
    }
}

/// A room with a wall of 20 cm in its middle, closed all around.
fn walled() -> Stage {
    let wall: Vec<Vec3> = room(Vec3::new(0.1, 0.8, 1.0)).into_iter().map(|corner| corner - Vec3::Y * 0.2).collect();
    furnace(0.6).surface("wall", &wall, Material { double_sided: true, ..lambert(0.6, 0.0) })
}

/// Lamps of which plates fit into the wall, and look along it.
fn slim_shapes() -> [LampShape; 5] {
    shapes().map(|shape| match shape {
        LampShape::Rectangle { .. } => LampShape::Rectangle { size_m: [0.1; 2] },
        other => other,
    })
}

#[test]
fn a_lamp_that_is_pushed_through_a_wall_is_dark_within_and_no_flash_before_and_behind() {
    let scene = walled().prepared();
    let patches = learned(&scene, 512);
    for shape in slim_shapes() {
        let steps = (-60..=60).map(|step| 5e-3 * step as f32);
        let shares: Vec<(f32, f32)> = steps
            .map(|x| {
                let lamps = prepared(&shape, Vec3::new(x, 0.03, 0.11));
                (x, received(&patches, &thrown(&scene, &patches, &lamps)))
            })
            .collect();
        let most = shares.iter().map(|(_, share)| *share).fold(0.0, f32::max);
        let within = shares.iter().filter(|(x, _)| x.abs() < 0.04).map(|(_, share)| *share).fold(0.0, f32::max);
        let jump = shares.windows(2).map(|w| (w[0].1 - w[1].1).abs()).fold(0.0, f32::max);
        println!("{shape:?}: {most:.3} at most, {within:.4} within, jumps of {jump:.3}");
        // The gap below the wall is narrower than a patch, whose area lacks what its samples do not see there.
        assert!(most < 1.12 && within < 0.01, "{shape:?}: {most:.3} at most, {within:.4} within");
        assert!(jump < 0.6, "{shape:?}: jumps of {jump:.3}");
    }
}

/// A stage with a box, given by its middle and half of its size, that has both sides.
fn boxed(stage: Stage, middle: Vec3, half: Vec3) -> Stage {
    let corners: Vec<Vec3> = room(half).into_iter().map(|corner| middle + corner).collect();
    stage.surface("box", &corners, Material { double_sided: true, ..lambert(0.6, 0.0) })
}

#[test]
fn a_lamp_within_a_thin_board_or_a_closed_cupboard_lights_no_patches_outside() {
    let (board, cupboard) = (Vec3::new(0.2, -0.4, 0.1), Vec3::new(-1.3, -0.7, -0.9));
    let with_board = boxed(furnace(0.6), board, Vec3::new(0.7, 2.5e-3, 0.6));
    let with_outside = boxed(with_board, cupboard, Vec3::new(0.4, 0.5, 0.3));
    let scene = boxed(with_outside, cupboard, Vec3::new(0.38, 0.48, 0.28)).prepared();
    let patches = learned(&scene, 512);
    let share = |shape: &LampShape, place: Vec3| received(&patches, &thrown(&scene, &patches, &prepared(shape, place)));
    for aside in [Vec3::ZERO, Vec3::new(0.3, 0.0, 0.2), Vec3::new(-0.5, 0.0, 0.1), Vec3::new(0.1, 0.0, -0.4)] {
        let (within, above) =
            (share(&LampShape::Point, board + aside), share(&LampShape::Point, board + aside + Vec3::Y * 0.05));
        println!("point: {within:.4} within the board, {above:.3} above it");
        assert!(within < 1e-3, "{within} of the light comes out of the board");
        assert!((0.8..1.1).contains(&above), "{above} of the light above the board");
    }
    for shape in [LampShape::Point, LampShape::Sphere { radius_m: SIZE }, LampShape::Disk { radius_m: SIZE }] {
        for height in [-0.45, 0.0, 0.4] {
            let within = share(&shape, cupboard + Vec3::new(0.1, height, 0.05));
            assert!(within < 1e-3, "{shape:?}: {within} of the light comes out of the cupboard");
        }
    }
}

#[test]
fn no_patch_beyond_a_wall_gets_light_of_a_lamp_beside_it() {
    // It stands on the floor and below the ceiling that both of its sides share, and leaves a way around it.
    let scene = boxed(furnace(0.6), Vec3::new(0.0, 0.0, -0.5), Vec3::new(0.02, 1.2, 1.0)).prepared();
    let patches = learned(&scene, 512);
    for (shape, y, aim) in
        [(&shapes()[0], 1.1, Vec3::Y), (&shapes()[0], -1.1, Vec3::Y), (&shapes()[1], -0.4, Vec3::NEG_Y)]
    {
        for x in [0.05, 0.12, 0.2] {
            let place = Vec3::new(x, y, -0.8);
            let light = thrown(&scene, &patches, &aimed(shape, place, place + aim));
            let beyond: Vec<Vec3> = light
                .iter()
                .enumerate()
                .map(|(patch, light)| {
                    let is_beyond = patches
                        .samples_of(patch as u32)
                        .iter()
                        .all(|sample| sample.position.x < -0.015 && sample.position.z < 0.0);
                    if is_beyond { *light } else { Vec3::ZERO }
                })
                .collect();
            let [all, beyond] = [&light, &beyond].map(|light| received(&patches, light));
            println!("{shape:?} at {x} m, {y} m: {all:.3} of the light, {beyond:.5} beyond the wall");
            assert!(beyond < 2e-3, "{shape:?} at {x} m, {y} m: {beyond} of the light goes through the wall");
            assert!(all > 0.8, "{shape:?} at {x} m, {y} m: {all} of the light arrives");
        }
    }
}

#[test]
fn a_narrow_beam_onto_a_column_is_received_wherever_it_falls() {
    const SIDES: usize = 24;
    let around = |nth: usize| {
        let (sin, cos) = (std::f32::consts::TAU * (nth % SIDES) as f32 / SIDES as f32).sin_cos();
        Vec3::new(cos, 0.0, sin)
    };
    let corner = |nth: usize, y: f32| around(nth) * 0.25 + Vec3::Y * y;
    let face = |nth: usize| quad(corner(nth + 1, FLOOR), corner(nth, FLOOR) - corner(nth + 1, FLOOR), Vec3::Y * 2.4);
    let column: Vec<Vec3> = (0..SIDES).flat_map(face).collect();
    let both = Material { double_sided: true, ..lambert(0.6, 0.0) };
    let scene = furnace(0.6).surface("column", &column, both).prepared();
    let patches = learned(&scene, 512);
    let shape = LampShape::Spot { inner_rad: 0.05, outer_rad: 0.1 };
    for nth in 0..SIDES {
        let aim = Vec3::Y * (0.08 * (nth % 7) as f32 - 0.3);
        let lamps = aimed(&shape, aim + around(nth) * 0.6, aim);
        let share = received(&patches, &thrown(&scene, &patches, &lamps));
        // Where no camera looks there may be no patches.
        println!("{nth}: {share:.3} of the light");
        assert!(share < 1.1, "{share} of the light from side {nth}");
        let outward = around(nth);
        let has_patch = patches
            .samples()
            .iter()
            .any(|sample| sample.normal.dot(outward) > 0.95 && sample.position.distance(aim + outward * 0.25) < 0.15);
        assert!(share > 0.2 || !has_patch, "{share} of the light from side {nth}");
    }
}

/// Lamps of no size and of no angle, and one that a file measures.
fn shapes_without_size(profile: String) -> [LampShape; 5] {
    [
        LampShape::Rectangle { size_m: [0.0; 2] },
        LampShape::Disk { radius_m: 0.0 },
        LampShape::Sphere { radius_m: 0.0 },
        LampShape::Spot { inner_rad: 0.0, outer_rad: 0.0 },
        LampShape::Profile { file: profile },
    ]
}

#[test]
fn lamps_without_size_where_none_should_be_throw_no_more_than_their_light() {
    let folder = tempfile::tempdir().expect("a folder");
    let profile = folder.path().join("one-sided.ies");
    std::fs::write(&profile, ONE_SIDED).expect("the folder can be written");
    let scene = walled().prepared();
    let patches = learned(&scene, 512);
    let asked = patches.samples().iter().step_by(83).map(|sample| (sample.position, sample.normal));
    let places: Vec<(Vec3, Vec3)> = asked.chain(middles(patches.samples()).into_iter().step_by(31)).collect();
    for shape in shapes_without_size(profile.display().to_string()) {
        let share = |place: Vec3| {
            let light = thrown(&scene, &patches, &prepared(&shape, place));
            assert!(light.iter().all(|light| light.is_finite()), "{shape:?} at {place}");
            received(&patches, &light)
        };
        let most = |heights: [f32; 2]| {
            let above = places.iter().flat_map(|(place, normal)| heights.map(|above| *place + *normal * above));
            above.map(share).fold(0.0, f32::max)
        };
        let (beside, within) = (most([1e-3, 0.02]), most([0.0, 1e-6]));
        let dark = [Vec3::new(0.02, 0.03, 0.11), Vec3::new(2.5, 0.0, 0.0), Vec3::splat(9e5)];
        let [in_a_wall, outside, far_away] = dark.map(share);
        println!("{shape:?}: {beside:.3} of the light, in a surface {within:.3}");
        println!("in a wall {in_a_wall:.4}, outside {outside:.4}, far away {far_away:.4}");
        // Rays bring the light of a lamp once, twice where it lies in a surface. Patches farther away may find a quarter more by their samples.
        assert!(beside < 1.25 && within < 2.25, "{shape:?}: {beside:.3} of the light; in a surface {within:.3}");
        assert!(in_a_wall < 0.01, "{shape:?}: {in_a_wall:.4} of the light out of a wall");
        assert!(outside < 1e-3 && far_away < 1e-3, "{shape:?}: {outside:.4} from outside, {far_away:.4} from far away");
    }
}

#[test]
fn a_lamp_within_a_wall_lights_nothing_that_is_seen() {
    let scene = walled().prepared();
    let config = VisibleConfig { samples: 2, narrow_alpha: NARROW_ALPHA, ..VisibleConfig::default() };
    let camera = &scene.scene.cameras[0];
    let points = VisiblePoints::new(&scene, camera, FILM, config, &|| false).expect("nobody stops it");
    for shape in slim_shapes() {
        let n_lit = |x: f32| {
            let lamps = prepared(&shape, Vec3::new(x, 0.03, 0.11));
            let passes = (0..4).map(|pass| points.direct(&scene, &lamps, pass, &|| false).expect("nobody stops it"));
            passes.flatten().filter(|rgb| *rgb != [0.0; 3]).count()
        };
        assert!(n_lit(0.3) > 0, "{shape:?} is dark before the wall");
        for x in [-0.04, 0.0, 0.02] {
            assert_eq!(n_lit(x), 0, "{shape:?} shines out of the wall from {x}");
        }
    }
}
