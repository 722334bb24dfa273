//! Clear coat, sheen, films, stretched highlights and diffuse transmission: that they are under the laws of all lobes, and
//! laws of their own.

use super::*;

pub(super) fn with(params: SurfaceParams, finish: FinishParams) -> Surface {
    Surface { params, finish }
}

pub(super) fn lacquered(roughness: f32) -> FinishParams {
    FinishParams { clearcoat: 1.0, clearcoat_roughness: roughness, ..FinishParams::default() }
}

fn velvet(roughness: f32) -> FinishParams {
    FinishParams { sheen_color: Vec3::new(1.0, 0.7, 0.4), sheen_roughness: roughness, ..FinishParams::default() }
}

pub(super) fn brushed(strength: f32) -> FinishParams {
    let anisotropy_direction = Vec3::new(0.6, 0.8, 0.0);
    FinishParams { anisotropy: strength, anisotropy_direction, ..FinishParams::default() }
}

pub(super) fn oily(thickness_nm: f32) -> FinishParams {
    FinishParams { iridescence: 0.9, film_ior: 1.6, film_thickness_nm: thickness_nm, ..FinishParams::default() }
}

fn leaf(share: f32) -> FinishParams {
    let diffuse_transmission_color = Vec3::new(0.9, 0.8, 0.3);
    FinishParams { diffuse_transmission: share, diffuse_transmission_color, ..FinishParams::default() }
}

/// Everything at once.
fn everything() -> FinishParams {
    FinishParams {
        clearcoat: 0.7,
        clearcoat_roughness: 0.5,
        sheen_color: Vec3::new(0.3, 0.5, 0.2),
        sheen_roughness: 0.6,
        diffuse_transmission: 0.4,
        ..FinishParams { iridescence: 0.8, ..brushed(0.6) }
    }
}

/// Finishes whose every value is the same seen from either side.
pub(super) fn table() -> Vec<(&'static str, Surface)> {
    let mixed = SurfaceParams { metallic: 0.3, transmission: 0.4, ..coat(0.5) };
    vec![
        ("lacquer over matte", with(lambert(), lacquered(0.5))),
        ("mirror lacquer over a coat", with(coat(0.6), lacquered(0.0))),
        ("half a lacquer over metal", with(metal(0.6), FinishParams { clearcoat: 0.5, ..lacquered(0.4) })),
        ("lacquer over a clear wall", with(thin(0.0), lacquered(0.5))),
        ("fine velvet", with(lambert(), velvet(0.3))),
        ("velvet over a coat", with(coat(0.8), velvet(1.0))),
        ("velvet over a thin wall", with(thin(0.5), velvet(0.5))),
        ("brushed metal", with(metal(0.4), brushed(0.8))),
        ("brushed coat", with(coat(0.5), brushed(0.5))),
        ("brushed glass", with(glass(0.5), brushed(0.5))),
        ("oil on metal", with(metal(0.5), oily(400.0))),
        ("oil on a coat", with(coat(0.5), oily(300.0))),
        ("oil on glass", with(glass(0.5), oily(500.0))),
        ("leaf", with(lambert(), leaf(0.6))),
        ("waxed leaf", with(coat(0.5), leaf(1.0))),
        ("wax", with(SurfaceParams { thickness: 1.0, ..coat(0.5) }, leaf(0.7))),
        ("everything", with(mixed, everything())),
    ]
}

#[test]
fn samples_of_finishes_are_distributed_as_their_density_says() {
    for (nth, (name, surface)) in table().into_iter().enumerate() {
        for wo in viewers().into_iter().skip(nth % 3).step_by(3) {
            assert_distributed(name, &surface, wo, Effort { n_samples: 12_000, fine: 12 });
        }
    }
}

const COSINES: [f32; 11] = [1.0, 0.8, 0.5, 0.3, 0.15, 0.05, 0.02, -0.03, -0.2, -0.7, -1.0];

/// Asserts that a white surface returns at most what it got, to every viewer.
fn assert_no_gain(surface: &Surface, what: &str) {
    for cos in COSINES {
        for phi in [0.3, 1.9] {
            let wo = towards(cos.acos(), phi);
            let bsdf = surface.bsdf(Vec3::Z, Vec3::Z, wo);
            let (mean, error) = energy(&bsdf, squeeze(&surface.params, wo), 1024);
            assert!(mean <= 1.015 + 4.0 * error, "{what} at {cos}: {mean} ± {error}");
            assert!(mean > 0.1, "{what} at {cos} is nearly black: {mean}");
        }
    }
}

#[test]
fn white_finishes_return_no_more_than_they_got() {
    for roughness in [0.0, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0] {
        let white = FinishParams { sheen_color: Vec3::ONE, diffuse_transmission_color: Vec3::ONE, ..velvet(roughness) };
        let leaf = FinishParams { diffuse_transmission_color: Vec3::ONE, ..leaf(0.5) };
        for base in [SurfaceParams { roughness, ..WHITE }, SurfaceParams { metallic: 1.0, roughness: 0.4, ..WHITE }] {
            assert_no_gain(&with(base, lacquered(roughness)), &format!("lacquer of {roughness}"));
            assert_no_gain(&with(base, white), &format!("sheen of {roughness}"));
            assert_no_gain(&with(SurfaceParams { roughness, ..base }, brushed(0.7)), &format!("brushed {roughness}"));
            assert_no_gain(&with(SurfaceParams { roughness, ..base }, brushed(0.2)), &format!("brushed {roughness}"));
            assert_no_gain(&with(SurfaceParams { roughness, ..base }, oily(350.0)), &format!("oil {roughness}"));
            assert_no_gain(&with(base, leaf), &format!("leaf of {roughness}"));
        }
        let stacked = FinishParams { clearcoat: 1.0, clearcoat_roughness: 0.3, iridescence: 1.0, ..white };
        let stacked = FinishParams { diffuse_transmission: 0.5, anisotropy: 0.5, ..stacked };
        assert_no_gain(&with(SurfaceParams { roughness, ..WHITE }, stacked), &format!("all over {roughness}"));
    }
}

#[test]
fn lobes_of_every_roughness_have_a_density_of_one() {
    for roughness in [0.3, 0.5, 0.8, 1.0] {
        let metal = metal(roughness);
        for (nth, finish) in [lacquered(roughness), velvet(roughness), brushed(roughness), oily(900.0 * roughness)]
            .into_iter()
            .enumerate()
        {
            let wo = towards([0.3, 0.9, 1.2, 1.4][nth], 0.7);
            let effort = Effort { n_samples: 12_000, fine: 20 };
            assert_distributed(&format!("lobe {nth} of {roughness}"), &with(metal, finish), wo, effort);
            let wo = towards([1.3, 0.1, 0.8, 1.2][nth], 2.7);
            assert_distributed(&format!("lobe {nth} of {roughness}"), &with(lambert(), finish), wo, effort);
        }
    }
}

#[test]
fn a_finish_without_strength_changes_nothing() {
    let absent = FinishParams { film_thickness_nm: 0.0, iridescence: 1.0, ..FinishParams::default() };
    for params in [lambert(), coat(0.5), metal(0.3), thin(0.5), glass(0.5)] {
        for wo in viewers() {
            let (bare, finished) =
                (Bsdf::new(&params, Vec3::Z, Vec3::Z, wo), Bsdf::finished(&params, &absent, Vec3::Z, Vec3::Z, wo));
            for index in 0..50 {
                let wi = uniform_sphere(Sampler::new(SEED, 6, index).next_2d());
                assert_eq!(bare.eval(wi), finished.eval(wi));
            }
        }
    }
}

#[test]
fn a_lacquer_head_on_is_the_formula_of_the_extension() {
    let (wo, wi) = (towards(0.15, 0.0), towards(0.3, 2.0));
    for roughness in [0.3, 0.6] {
        let surface = with(lambert(), FinishParams { clearcoat: 0.8, ..lacquered(roughness) });
        let value = surface.bsdf(Vec3::Z, Vec3::Z, wo).eval(wi).0 / wi.z;
        // The lobe alone, of a coat of index 1.5 over nothing.
        let black = SurfaceParams { base_color: Vec3::ZERO, roughness, ..WHITE };
        let lobe = Bsdf::new(&black, Vec3::Z, Vec3::Z, wo).eval(wi).0 / wi.z;
        let expected = lambert().base_color * (FRAC_1_PI * (1.0 - 0.8 * 0.04)) + lobe * 0.8;
        assert!((value - expected).abs().max_element() < 6e-3 * expected.max_element(), "{value} against {expected}");
    }
}

#[test]
fn sheen_is_the_formula_of_the_extension() {
    let (wo, wi) = (towards(0.6, 0.0), towards(0.9, 2.0));
    // Λ of the fit at roughness 1: α = 1 leaves its first set of coefficients.
    let fit = |x: f64| 21.5473 / (1.0 + 3.82987 * x.powf(0.19823)) - 1.97760 * x - 4.32054;
    let lambda = |cos: f64| if cos < 0.5 { fit(cos).exp() } else { (2.0 * fit(0.5) - fit(1.0 - cos)).exp() };
    let (cos_o, cos_i) = (f64::from(wo.z), f64::from(wi.z));
    let half = (wo + wi).normalize();
    let d = 3.0 * f64::from(1.0 - half.z * half.z).sqrt() / (2.0 * std::f64::consts::PI);
    let expected = d / ((1.0 + lambda(cos_o) + lambda(cos_i)) * 4.0 * cos_o * cos_i);
    let black = SurfaceParams { base_color: Vec3::ZERO, ..lambert() };
    let color = Vec3::new(1.0, 0.5, 0.25);
    let surface = with(black, FinishParams { sheen_color: color, ..velvet(1.0) });
    let value = surface.bsdf(Vec3::Z, Vec3::Z, wo).eval(wi).0 / wi.z;
    let difference = (value - color * expected as f32).abs().max_element();
    assert!(difference < 1e-4 * expected as f32, "{value} against {expected}");
}

#[test]
fn a_leaf_splits_its_light_between_both_sides() {
    let (wo, up, down) = (towards(0.4, 0.0), towards(0.9, 2.0), towards(PI - 0.9, 2.0));
    let surface = with(lambert(), leaf(0.25));
    for wo in [wo, -wo] {
        let bsdf = surface.bsdf(Vec3::Z, Vec3::Z, wo);
        let (near, far) = if wo.z > 0.0 { (up, down) } else { (down, up) };
        let reflected = bsdf.eval(near).0 - lambert().base_color * (0.75 * FRAC_1_PI * near.z.abs());
        let passed = bsdf.eval(far).0 - leaf(0.25).diffuse_transmission_color * (0.25 * FRAC_1_PI * far.z.abs());
        assert!(reflected.abs().max_element() < 1e-6 && passed.abs().max_element() < 1e-6);
        assert!((bsdf.base_albedo() - lambert().base_color * 0.75).abs().max_element() < 1e-5);
        assert!(bsdf.reflects() && bsdf.transmits() && !bsdf.is_diffuse());
    }
}

#[test]
fn brushed_metal_spreads_light_along_its_direction() {
    let wo = towards(0.0, 0.0);
    let along = Vec3::new(0.6, 0.8, 0.0);
    let bsdf = with(metal(0.3), brushed(0.8)).bsdf(Vec3::Z, Vec3::Z, wo);
    let tilted = |direction: Vec3| bsdf.eval((Vec3::Z + direction * 0.5).normalize()).0.max_element();
    let across = along.cross(Vec3::Z);
    assert!(tilted(along) > 20.0 * tilted(across), "{} along, {} across", tilted(along), tilted(across));
    assert!((tilted(along) - tilted(-along)).abs() < 1e-4 * tilted(along));
}

#[test]
fn the_base_and_the_rest_of_a_stack_add_up() {
    for (name, surface) in table() {
        for wo in viewers() {
            let bsdf = surface.bsdf(Vec3::Z, Vec3::Z, wo);
            let (mut base, mut coat_pdf, n) = (0.0, 0.0, 8_000);
            for index in 0..n {
                let wi = uniform_sphere(Sampler::new(SEED, 7, index).next_2d());
                let (parts, (f_cos, pdf)) = (bsdf.eval_parts(wi), bsdf.eval(wi));
                assert!((parts.base + parts.coat - f_cos).abs().max_element() <= 1e-4 * f_cos.max_element(), "{name}");
                assert!(parts.coat_pdf <= pdf * 1.0001, "{name}");
                base += f64::from(parts.base.max_element()) * 4.0 * std::f64::consts::PI / f64::from(n);
                coat_pdf += f64::from(parts.coat_pdf);
            }
            assert!(coat_pdf.is_finite());
            let share = f64::from(bsdf.base_albedo().max_element());
            assert!((share - base).abs() < 0.03, "{name}: a base of {share} was measured as {base}");
        }
    }
}

#[test]
fn sampling_the_base_and_all_but_the_base_finds_each_of_them() {
    for ((name, surface), of_base) in
        table().into_iter().flat_map(|surface| [false, true].map(|of_base| (surface, of_base)))
    {
        let wo = towards(0.7, 0.4);
        let bsdf = surface.bsdf(Vec3::Z, Vec3::Z, wo);
        let (mut sampled, mut squares, mut integral, n) = (0.0, 0.0, 0.0, 20_000);
        for index in 0..n {
            let mut sampler = Sampler::new(SEED, 8, index);
            let (u_lobe, u) = (sampler.next_1d(), sampler.next_2d());
            let sample = if of_base { bsdf.sample_base(u_lobe, u) } else { bsdf.sample_coat(u_lobe, u) };
            let weight = match sample {
                Some(sample) if sample.kind == ScatterKind::Smooth => f64::from(sample.weight.y),
                _ => 0.0,
            };
            sampled += weight / f64::from(n);
            squares += weight * weight / f64::from(n);
        }
        let side = 300;
        for (row, column) in (0..side).flat_map(|row| (0..side).map(move |column| (row, column))) {
            let theta = (row as f32 + 0.5) / side as f32 * PI;
            let wi = towards(theta, (column as f32 + 0.5) / side as f32 * 2.0 * PI);
            let parts = bsdf.eval_parts(wi);
            integral += f64::from((if of_base { parts.base } else { parts.coat }).y * theta.sin());
        }
        integral *= 2.0 * f64::from(PI * PI) / f64::from(side * side);
        let error = (squares / f64::from(n)).sqrt();
        assert!((sampled - integral).abs() < 5.0 * error + 5e-3, "{name}: {sampled} ± {error} against {integral}");
    }
}

#[test]
fn extreme_finishes_stay_finite() {
    for strength in [1e-40f32, 1e-6, 0.5, 1.0] {
        for roughness in [0.0, 0.03, 0.05, 0.2, 1.0] {
            let finish = FinishParams {
                clearcoat: strength,
                clearcoat_roughness: roughness,
                clearcoat_normal: Vec3::new(0.9, 0.0, 0.436),
                sheen_color: Vec3::splat(strength),
                sheen_roughness: roughness,
                anisotropy: strength,
                iridescence: strength,
                film_thickness_nm: 1.0 / strength.max(1e-20),
                ..leaf(strength)
            };
            let shapes = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 1.0)];
            for (metallic, transmission, thickness) in shapes {
                let params = SurfaceParams { metallic, transmission, thickness, roughness, ..WHITE };
                for cos in [1.0f32, 1e-2, 1e-4, 1e-7, 0.0, -1e-7, -1e-3, -1.0] {
                    assert_finite(&with(params, finish).bsdf(Vec3::Z, Vec3::Z, towards(cos.acos(), 0.1)));
                }
            }
        }
    }
}
