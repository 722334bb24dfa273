//! White furnaces: rough metal and rough glass that absorb nothing lose nothing, and what they would lose without
//! compensation is what it is known to be.

use super::super::furnace::{furnace_loss, returned};
use super::*;
use crate::scene::{Finish, Material, Scene};

const ROUGHNESS: [f32; 10] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0];
const ANGLES: [f32; 3] = [0.0, 60.0, 80.0];

fn once(params: SurfaceParams) -> SurfaceParams {
    SurfaceParams { facet_scattering: FacetScattering::Single, ..params }
}

fn white_metal(roughness: f32) -> SurfaceParams {
    SurfaceParams { base_color: Vec3::ONE, ..metal(roughness) }
}

fn white_wall(roughness: f32) -> SurfaceParams {
    SurfaceParams { base_color: Vec3::ONE, ..thin(roughness) }
}

/// Asserts that light comes back as a whole, within 1 %, at every angle on the given sides.
fn assert_kept(params: &SurfaceParams, sides: &[f32]) {
    for cos in [1.0f32, 0.9, 0.75, 0.6, 0.45, 0.3, 0.2, 0.1, 0.05] {
        for side in sides {
            let wo = towards((cos * side).acos(), 0.3);
            let bsdf = Bsdf::new(params, Vec3::Z, Vec3::Z, wo);
            let (mean, error) = energy(&bsdf, squeeze(params, wo), 1 << 13);
            assert!(
                (mean - 1.0).abs() < 0.011 + 3.0 * error,
                "roughness {}, index {} at {cos} of side {side}: {mean} ± {error}",
                params.roughness,
                params.ior
            );
        }
    }
}

#[test]
fn rough_white_metal_returns_all_light() {
    for roughness in (1..=40).map(|nth| nth as f32 / 40.0) {
        assert_kept(&white_metal(roughness), &[1.0]);
    }
}

#[test]
fn rough_clear_glass_reflects_and_refracts_all_light_from_both_sides() {
    for roughness in [0.05, 0.1, 0.25, 0.4, 0.55, 0.65, 0.8, 0.95, 1.0] {
        assert_kept(&white_wall(roughness), &[1.0, -1.0]);
        for ior in [1.05, 1.2, 1.33, 1.45, 1.5, 1.9, 2.42, 4.0, 1000.0] {
            assert_kept(&SurfaceParams { ior, ..glass(roughness) }, &[1.0, -1.0]);
        }
    }
}

#[test]
fn rough_glass_of_any_specular_factor_and_color_keeps_light() {
    for (specular, specular_color) in
        [(0.0, Vec3::ONE), (0.5, Vec3::new(1.0, 0.5, 0.1)), (1.0, Vec3::new(6.0, 3.0, 0.0)), (1.0, Vec3::splat(0.2))]
    {
        for roughness in [0.25, 0.65, 1.0] {
            let params = SurfaceParams { specular, specular_color, ..glass(roughness) };
            for cos in [1.0f32, 0.6, 0.2, -0.2, -0.6, -1.0] {
                let wo = towards(cos.acos(), 0.3);
                let (mean, error) = energy(&Bsdf::new(&params, Vec3::Z, Vec3::Z, wo), squeeze(&params, wo), 1 << 12);
                assert!((mean - 1.0).abs() < 0.02 + 3.0 * error, "{params:?} at {cos}: {mean} ± {error}");
            }
        }
    }
}

#[test]
fn light_followed_to_one_facet_is_lost_as_much_as_is_known() {
    // Mean over all angles of what rough white metal loses at α = 1, by an independent integral over both directions.
    let n = 64;
    let lost: f32 =
        (0..n).map(|nth| 1.0 - returned(&once(white_metal(1.0)), 0.0, ((nth as f32 + 0.5) / n as f32).sqrt())).sum();
    let lost = lost / n as f32;
    assert!((lost - by_quadrature()).abs() < 0.01, "{lost} against {}", by_quadrature());
    // No roughness, no loss.
    assert!(returned(&once(white_metal(0.1)), 0.0, 1.0) > 0.995);
}

/// Over pairs of directions, `f·cosθ` summed without any sampling of facets.
fn by_quadrature() -> f32 {
    let (n_cos, n_phi) = (48, 96);
    let mut kept = 0.0;
    for (o, i) in (0..n_cos).flat_map(|o| (0..n_cos).map(move |i| (o, i))) {
        let [cos_o, cos_i] = [o, i].map(|k| ((k as f32 + 0.5) / n_cos as f32).sqrt());
        let bsdf = Bsdf::new(&once(white_metal(1.0)), Vec3::Z, Vec3::Z, towards(cos_o.acos(), 0.0));
        for k in 0..n_phi {
            let phi = (k as f32 + 0.5) / n_phi as f32 * 2.0 * PI;
            // Cells of equal projected solid angle.
            kept += bsdf.eval(towards(cos_i.acos(), phi)).0.x / cos_i * PI / (n_cos * n_cos * n_phi) as f32;
        }
    }
    1.0 - kept
}

#[test]
fn colored_metal_gets_what_its_color_leaves_bounce_after_bounce() {
    // Light that stays is reflected again and again: A = F·E / (1 − F·(1 − E)) for a reflectance that is the same at all angles.
    for f in [0.05f32, 0.3, 0.6, 0.9, 1.0] {
        let gray = SurfaceParams { base_color: Vec3::splat(f), ..white_metal(1.0) };
        for cos in [1.0f32, 0.5, 0.2] {
            let kept = returned(&once(white_metal(1.0)), 0.0, cos);
            let single = returned(&once(gray), 0.0, cos);
            let mean = f + (1.0 - f) / 21.0;
            let expected = single / (1.0 - mean * (1.0 - kept));
            let found = returned(&gray, 0.0, cos);
            assert!((found / expected - 1.0).abs() < 0.04, "{f} at {cos}: {found} against {expected}");
            assert!(found >= single && found <= 1.005);
        }
    }
    // Red and blue apart, as the light of gold grows more golden.
    let gold = SurfaceParams { base_color: Vec3::new(1.0, 0.7, 0.3), ..white_metal(1.0) };
    let wo = towards(0.3, 0.0);
    let ratio = |params: &SurfaceParams| {
        let value = Bsdf::new(params, Vec3::Z, Vec3::Z, wo).eval(towards(0.9, 2.0)).0;
        value.z / value.x
    };
    assert!(ratio(&gold) < 0.85 * ratio(&once(gold)), "{} against {}", ratio(&gold), ratio(&once(gold)));
}

#[test]
fn what_is_no_rough_metal_and_no_rough_glass_is_as_it_was() {
    for params in [lambert(), coat(0.0), coat(0.7), coat(1.0), metal(0.0), thin(0.0), glass(0.0)] {
        for wo in viewers() {
            let [many, single] = [params, once(params)].map(|params| Bsdf::new(&params, Vec3::Z, Vec3::Z, wo));
            for index in 0..50 {
                let wi = uniform_sphere(Sampler::new(SEED, 12, index).next_2d());
                assert_eq!(many.eval(wi), single.eval(wi));
            }
        }
    }
}

#[test]
fn the_loss_of_a_scene_is_that_of_its_roughest_metal_or_glass() {
    let material =
        |metallic, transmission, roughness| Material { metallic, transmission, roughness, ..Material::default() };
    let loss = |materials: Vec<Material>| furnace_loss(&Scene { materials, ..Scene::default() });
    assert_eq!(loss(vec![material(0.0, 0.0, 1.0), material(1.0, 0.0, 0.0), material(0.0, 1.0, 0.0)]), None);
    let mut scene = Scene { materials: vec![material(1.0, 0.0, 0.4), material(1.0, 0.0, 1.0)], ..Scene::default() };
    let known = furnace_loss(&scene).unwrap();
    assert!(known.n_materials == 2 && known.at_most < 0.01 && known.single > 0.4, "{known:?}");
    scene.set_facet_scattering(FacetScattering::Single);
    let single = furnace_loss(&scene).unwrap();
    assert_eq!((single.at_most, single.single), (known.single, known.single));
    // Stretched facets are compensated as their narrower width is, so some of the loss stays.
    let finish = Some(Box::new(Finish { anisotropy: 1.0, ..Finish::default() }));
    let brushed = loss(vec![Material { finish, ..material(1.0, 0.0, 0.3) }]).unwrap();
    assert!(brushed.at_most > 0.02 && brushed.at_most < brushed.single + 1e-3, "{brushed:?}");
}

/// Prints the table of the decision page: `cargo test --release furnace_table -- --ignored --nocapture`.
#[test]
#[ignore = "prints a table"]
fn furnace_table() {
    type Row<'a> = (&'a str, fn(f32) -> SurfaceParams, f32);
    let rows: [Row; 4] = [
        ("metal", white_metal, 1.0),
        ("thin wall", white_wall, 1.0),
        ("glass, from outside", glass, 1.0),
        ("glass, from inside", glass, -1.0),
    ];
    for (name, make, side) in rows {
        for roughness in ROUGHNESS {
            let cell = |params: SurfaceParams| {
                ANGLES
                    .map(|angle| {
                        format!("{:.2}", 100.0 * (1.0 - returned(&params, 0.0, side * angle.to_radians().cos())))
                    })
                    .join(" | ")
            };
            println!("| {name} | {roughness} | {} | {} |", cell(once(make(roughness))), cell(make(roughness)));
        }
    }
}
