mod finishes;
mod furnace;
mod polished;

use std::f32::consts::PI;

use glam::Vec3;

use super::*;
use crate::sampler::{Sampler, uniform_sphere};

const SEED: u64 = 20_231;

/// What surfaces of tests are made of by changing some of it.
pub(crate) const WHITE: SurfaceParams = SurfaceParams {
    base_color: Vec3::ONE,
    metallic: 0.0,
    roughness: 1.0,
    transmission: 0.0,
    ior: 1.5,
    specular: 1.0,
    specular_color: Vec3::ONE,
    thickness: 0.0,
    facet_scattering: FacetScattering::Multiple,
};

fn lambert() -> SurfaceParams {
    SurfaceParams { base_color: Vec3::new(0.8, 0.5, 0.2), specular: 0.0, ..WHITE }
}

fn coat(roughness: f32) -> SurfaceParams {
    SurfaceParams { base_color: Vec3::new(0.7, 0.4, 0.1), roughness, ..WHITE }
}

fn metal(roughness: f32) -> SurfaceParams {
    SurfaceParams { base_color: Vec3::new(0.9, 0.6, 0.3), metallic: 1.0, roughness, ..WHITE }
}

fn thin(roughness: f32) -> SurfaceParams {
    SurfaceParams { transmission: 1.0, roughness, base_color: Vec3::new(0.9, 0.8, 0.7), ..WHITE }
}

fn glass(roughness: f32) -> SurfaceParams {
    SurfaceParams { transmission: 1.0, roughness, thickness: 1.0, ..WHITE }
}

/// A point of a surface, with what its finish adds.
#[derive(Clone, Copy, Debug)]
struct Surface {
    params: SurfaceParams,
    finish: FinishParams,
}

impl Surface {
    fn bsdf(&self, ng: Vec3, ns: Vec3, wo: Vec3) -> Bsdf {
        Bsdf::finished(&self.params, &self.finish, ng, ns, wo)
    }

    fn transmits(&self) -> bool {
        self.params.transmission > 0.0 || self.finish.diffuse_transmission > 0.0
    }
}

/// Every kind of lobe without a finish that has a density, alone and mixed.
fn plain_table() -> Vec<(&'static str, Surface)> {
    let plain = [
        ("lambert", lambert()),
        ("mirror coat", coat(0.0)),
        ("narrow coat", coat(0.35)),
        ("coat", coat(0.6)),
        ("broad coat", coat(1.0)),
        ("metal", metal(0.4)),
        ("broad metal", metal(1.0)),
        ("thin wall", thin(0.5)),
        ("glass", glass(0.5)),
        ("half of everything", SurfaceParams { metallic: 0.3, transmission: 0.5, thickness: 1.0, ..coat(0.6) }),
        ("half of a thin everything", SurfaceParams { metallic: 0.3, transmission: 0.5, ..coat(0.6) }),
    ];
    plain.into_iter().map(|(name, params)| (name, Surface { params, finish: FinishParams::default() })).collect()
}

/// The same, and every kind of finish.
fn table() -> Vec<(&'static str, Surface)> {
    plain_table().into_iter().chain(finishes::table()).collect()
}

fn towards(theta: f32, phi: f32) -> Vec3 {
    Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
}

/// Normal incidence, oblique and near grazing, from the front and from the back.
fn viewers() -> [Vec3; 6] {
    [0.05, 0.8, 1.4, PI - 0.1, PI - 0.8, PI - 1.35].map(|theta| towards(theta, 0.7))
}

/// Mean and standard error of the albedo of one color channel mean, delta lobes included; `eta2` undoes the squeezing of
/// transmitted radiance.
fn energy(bsdf: &Bsdf, eta2: f32, n: u32) -> (f64, f64) {
    let (mut sum, mut squares) = (0.0, 0.0);
    for index in 0..n {
        let mut sampler = Sampler::new(SEED, 1, index);
        let Some(sample) = bsdf.sample(sampler.next_1d(), sampler.next_2d()) else { continue };
        let weight = f64::from(sample.weight.max_element() * if sample.transmitted { eta2 } else { 1.0 });
        sum += weight;
        squares += weight * weight;
    }
    let mean = sum / f64::from(n);
    (mean, ((squares / f64::from(n) - mean * mean).max(0.0) / f64::from(n)).sqrt())
}

/// η² of the side behind the surface over the side of the viewer.
fn squeeze(params: &SurfaceParams, wo: Vec3) -> f32 {
    match params.thickness > 0.0 && params.transmission > 0.0 {
        true if wo.z > 0.0 => params.ior * params.ior,
        true => 1.0 / (params.ior * params.ior),
        false => 1.0,
    }
}

const BANDS: usize = 12;
const SECTORS: usize = 16;

/// Cells are bands of polar angle, so that narrow lobes around the poles are resolved.
fn cell(wi: Vec3) -> usize {
    let band = (wi.z.clamp(-1.0, 1.0).acos() / PI * BANDS as f32) as usize;
    let sector = ((wi.y.atan2(wi.x) / (2.0 * PI)).rem_euclid(1.0) * SECTORS as f32) as usize;
    band.min(BANDS - 1) * SECTORS + sector.min(SECTORS - 1)
}

/// ∫ pdf over each cell of the sphere, midpoint rule.
fn expected(bsdf: &Bsdf, fine: usize) -> Vec<f64> {
    let (rows, columns) = (BANDS * fine, SECTORS * fine);
    let mut mass = vec![0.0; BANDS * SECTORS];
    let steps = f64::from(PI) / rows as f64 * 2.0 * f64::from(PI) / columns as f64;
    for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
        let theta = (row as f32 + 0.5) / rows as f32 * PI;
        let wi = towards(theta, (column as f32 + 0.5) / columns as f32 * 2.0 * PI);
        mass[row / fine * SECTORS + column / fine] += f64::from(bsdf.eval(wi).1 * theta.sin()) * steps;
    }
    mass
}

/// Pearson's statistic and its degrees of freedom; cells that expect few are pooled.
fn chi_square(counts: &[u32], expected: &[f64]) -> (f64, f64) {
    let (mut pooled, mut statistic, mut cells) = ((0.0, 0.0), 0.0, 0.0);
    for (&count, &mean) in counts.iter().zip(expected) {
        if mean < 8.0 {
            pooled = (pooled.0 + f64::from(count), pooled.1 + mean);
            continue;
        }
        statistic += (f64::from(count) - mean).powi(2) / mean;
        cells += 1.0;
    }
    if pooled.1 > 8.0 {
        statistic += (pooled.0 - pooled.1).powi(2) / pooled.1;
        cells += 1.0;
    } else {
        assert!(pooled.0 <= pooled.1 + 6.0 * pooled.1.sqrt() + 6.0, "samples where none are expected: {pooled:?}");
    }
    (statistic, cells)
}

/// How samples are held against their density.
#[derive(Clone, Copy)]
struct Effort {
    n_samples: u32,
    /// Steps of the integral along each axis of a cell.
    fine: usize,
}

fn assert_distributed(name: &str, surface: &Surface, wo: Vec3, effort: Effort) {
    let bsdf = surface.bsdf(Vec3::Z, Vec3::Z, wo);
    let mut counts = vec![0; BANDS * SECTORS];
    let n_other = each_sample(&bsdf, effort.n_samples, |wi| counts[cell(wi)] += 1);
    assert_counts(&format!("{name} from {wo}"), &counts, &expected(&bsdf, effort.fine), n_other);
}

/// Gives the directions of samples that have a density; returns how many have none.
fn each_sample(bsdf: &Bsdf, n_samples: u32, mut on_direction: impl FnMut(Vec3)) -> u32 {
    let mut n_other = 0;
    for stream in 0..n_samples {
        // One sample per stream: independent, as the test assumes.
        let mut sampler = Sampler::new(SEED, stream.into(), 0);
        match bsdf.sample(sampler.next_1d(), sampler.next_2d()) {
            Some(sample) if sample.kind == ScatterKind::Smooth => on_direction(sample.wi),
            _ => n_other += 1,
        }
    }
    n_other
}

/// Asserts that samples fell into cells as the integral of their density over each says; `n_other` samples have none.
fn assert_counts(what: &str, counts: &[u32], mass: &[f64], n_other: u32) {
    let n = f64::from(counts.iter().sum::<u32>() + n_other);
    let (total, other) = (mass.iter().sum::<f64>(), f64::from(n_other) / n);
    assert!((total + other - 1.0).abs() < 0.012, "{what}: ∫pdf {total}, other {other}");
    let means: Vec<f64> = mass.iter().map(|mass| mass * n).collect();
    let (statistic, cells) = chi_square(counts, &means);
    // The mean of the statistic is the number of cells, its variance twice that.
    let limit = cells + 5.0 * (2.0 * cells).sqrt() + 10.0;
    assert!(statistic < limit, "{what}: χ² {statistic} of {cells} cells");
}

#[test]
fn samples_are_distributed_as_their_density_says() {
    for (name, surface) in plain_table() {
        for wo in viewers() {
            assert_distributed(name, &surface, wo, Effort { n_samples: 40_000, fine: 30 });
        }
    }
}

#[test]
fn the_weight_of_a_sample_is_its_value_over_its_density() {
    for (name, surface) in table() {
        for wo in viewers() {
            let tilted = Vec3::new(0.2, -0.1, 1.0).normalize();
            let bsdf = surface.bsdf(Vec3::Z, tilted, wo);
            for index in 0..500 {
                let mut sampler = Sampler::new(SEED, 2, index);
                let Some(sample) = bsdf.sample(sampler.next_1d(), sampler.next_2d()) else { continue };
                assert_eq!(sample.transmitted, sample.wi.z * wo.z < 0.0, "{name}");
                assert!((sample.wi.length() - 1.0).abs() < 1e-4, "{name}");
                if sample.kind != ScatterKind::Smooth {
                    assert_eq!(sample.pdf, 0.0);
                    continue;
                }
                // Directions that graze the surface are rounded to either side of it.
                if sample.wi.z.abs() < 1e-3 || sample.wi.dot(tilted).abs() < 1e-3 {
                    continue;
                }
                let (f_cos, pdf) = bsdf.eval(sample.wi);
                assert!((pdf - sample.pdf).abs() <= 1e-2 * pdf, "{name}: pdf {pdf} against {}", sample.pdf);
                let difference = (f_cos / pdf - sample.weight).abs().max_element();
                assert!(difference <= 1e-3 * sample.weight.max_element() + 1e-5, "{name}: {difference}");
            }
        }
    }
}

/// Asserts that as much light goes from one direction into another as back; returns whether there is any.
fn assert_reciprocal(name: &str, surface: &Surface, [a, b]: [Vec3; 2]) -> bool {
    let value = |wo: Vec3, wi: Vec3| surface.bsdf(Vec3::Z, Vec3::Z, wo).eval(wi).0 / wi.z.abs();
    let (forth, mut back) = (value(a, b), value(b, a));
    if a.z * b.z < 0.0 {
        back /= squeeze(&surface.params, a);
    }
    let (difference, scale) = ((forth - back).abs().max_element(), forth.max_element().max(back.max_element()));
    let share = difference / scale;
    assert!(difference <= 2e-3 * scale + 1e-6, "{name}: {forth} against {back} for {a} and {b}, off by {share:e}");
    forth != Vec3::ZERO
}

#[test]
fn scattering_is_reciprocal_up_to_the_squared_index() {
    for (name, surface) in table() {
        let mut met = [0, 0];
        for index in 0..4000 {
            let mut sampler = Sampler::new(SEED, 3, index);
            let (a, b) = (uniform_sphere(sampler.next_2d()), uniform_sphere(sampler.next_2d()));
            if a.z.abs() < 0.02 || b.z.abs() < 0.02 {
                continue;
            }
            met[usize::from(a.z * b.z < 0.0)] += u32::from(assert_reciprocal(name, &surface, [a, b]));
        }
        assert!(met[0] > 0, "{name}: nothing was compared");
        assert_eq!(met[1] > 0, surface.bsdf(Vec3::Z, Vec3::Z, Vec3::Z).transmits(), "{name}");
    }
}

#[test]
fn white_surfaces_return_no_more_than_they_got() {
    for (metallic, transmission, thickness) in
        [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 1.0), (0.3, 0.5, 1.0)]
    {
        for roughness in [0.0, 0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0] {
            for cos in [1.0f32, 0.8, 0.5, 0.3, 0.15, 0.05, 0.02, -0.03, -0.2, -0.7, -1.0] {
                for (ior, specular_color) in [(1.5, Vec3::ONE), (1.0, Vec3::ONE), (2.4, Vec3::new(2.0, 1.0, 0.2))] {
                    let params =
                        SurfaceParams { metallic, transmission, thickness, roughness, ior, specular_color, ..WHITE };
                    let wo = towards(cos.acos(), 0.3);
                    let bsdf = Bsdf::new(&params, Vec3::Z, Vec3::Z, wo);
                    let (mean, error) = energy(&bsdf, squeeze(&params, wo), 1024);
                    // Tables of what facets lose are that exact.
                    assert!(mean <= 1.01 + 4.0 * error, "{params:?} at {cos}: {mean} ± {error}");
                    let once = SurfaceParams { facet_scattering: FacetScattering::Single, ..params };
                    let (mean, error) = energy(&Bsdf::new(&once, Vec3::Z, Vec3::Z, wo), squeeze(&params, wo), 1024);
                    assert!(mean <= 1.0 + 1e-3 + 4.0 * error, "{once:?} at {cos}: {mean} ± {error}");
                    assert!(mean > 0.2, "{params:?} at {cos} is nearly black: {mean}");
                }
            }
        }
    }
}

#[test]
fn clear_glass_and_clear_walls_keep_every_photon() {
    for params in [glass(0.0), SurfaceParams { transmission: 1.0, roughness: 0.0, ..WHITE }] {
        for wo in viewers() {
            let bsdf = Bsdf::new(&params, Vec3::Z, Vec3::Z, wo);
            assert!(!bsdf.has_smooth_lobes());
            let (mean, error) = energy(&bsdf, squeeze(&params, wo), 64);
            assert!((mean - 1.0).abs() < 1e-4 && error < 1e-4, "{wo}: {mean} ± {error}");
        }
    }
}

#[test]
fn clear_glass_reflects_what_its_specular_factor_and_color_say() {
    for specular in [0.0, 0.5, 1.0] {
        let params = SurfaceParams { specular, specular_color: Vec3::new(2.0, 1.0, 0.5), ..glass(0.0) };
        for wo in viewers() {
            let bsdf = Bsdf::new(&params, Vec3::Z, Vec3::Z, wo);
            let of_side = |transmitted: bool| {
                let lobes = bsdf.deltas().filter(|lobe| lobe.transmitted == transmitted);
                lobes.map(|lobe| lobe.share).sum::<Vec3>()
            };
            let [reflected, passed] = [of_side(false), of_side(true)];
            let whole = reflected.x + passed.x * squeeze(&params, wo);
            assert!((whole - 1.0).abs() < 1e-4, "{specular} from {wo}: {whole}");
            let exact = fresnel::dielectric(wo.z.abs(), if wo.z > 0.0 { 1.5 } else { 1.0 / 1.5 });
            let expected = if exact < 1.0 { specular * exact } else { 1.0 };
            assert!((reflected.y - expected).abs() < 1e-4, "{specular} from {wo}: {reflected}, not {expected}");
            // Lamps behind slabs are lit by the same.
            let refracted = Bsdf::refracted(&params, Vec3::Z, Vec3::Z, wo);
            assert!((refracted - passed).abs().max_element() < 1e-4, "{specular} from {wo}: {refracted}, not {passed}");
        }
    }
}

#[test]
fn clear_glass_bends_by_snells_law_and_reflects_totally_inside() {
    let wo = towards(0.7, 0.2);
    let through = |bsdf: &Bsdf| bsdf.sample(0.9999, [0.5, 0.5]).expect("glass absorbs nothing");
    let entered = through(&Bsdf::new(&glass(0.0), Vec3::Z, Vec3::Z, wo));
    assert!(entered.transmitted && entered.kind == ScatterKind::Delta);
    assert!((entered.wi.truncate() * 1.5 + wo.truncate()).length() < 1e-6);
    let fresnel = fresnel::dielectric(wo.z, 1.5);
    assert!((entered.weight.x * 2.25 - 1.0).abs() < 1e-4, "chosen with probability 1 − {fresnel}: {}", entered.weight);
    let inside = towards(PI - 0.8, 0.2);
    let trapped = through(&Bsdf::new(&glass(0.0), Vec3::Z, Vec3::Z, inside));
    assert!(!trapped.transmitted && trapped.wi.z < 0.0 && (trapped.weight - Vec3::ONE).length() < 1e-5);
}

#[test]
fn an_index_of_one_and_a_thin_wall_let_light_go_straight_on() {
    let tint = Vec3::new(0.9, 0.5, 0.1);
    for thickness in [0.0, 1.0] {
        for roughness in [0.0, 0.5] {
            let params = SurfaceParams { ior: 1.0, base_color: tint, thickness, ..glass(roughness) };
            for wo in viewers() {
                let bsdf = Bsdf::new(&params, Vec3::Z, Vec3::Z, wo);
                for u_lobe in [0.0, 0.5, 0.9999] {
                    let sample = bsdf.sample(u_lobe, [0.3, 0.6]).expect("nothing is absorbed");
                    assert!(sample.kind == ScatterKind::Through && sample.transmitted);
                    assert!((sample.wi + wo).length() < 1e-5 && (sample.weight - tint).length() < 1e-5);
                }
            }
        }
    }
    let wall = Bsdf::new(&thin(0.0), Vec3::Z, Vec3::Z, Vec3::Z).sample(0.9999, [0.5; 2]).expect("nothing is absorbed");
    assert!(wall.transmitted && (wall.wi + Vec3::Z).length() < 1e-6);
}

#[test]
fn no_coat_and_no_metal_is_exactly_lambert() {
    let params = lambert();
    for wo in viewers() {
        let bsdf = Bsdf::new(&params, Vec3::Z, Vec3::Z, wo);
        assert!(bsdf.is_diffuse() && bsdf.reflects() && !bsdf.transmits());
        assert!((bsdf.albedo_estimate() - params.base_color).abs().max_element() < 1e-6);
        for theta in [0.0, 0.5, 1.2, 2.0, 3.0] {
            let wi = towards(theta, 2.0);
            let cos = if wi.z * wo.z > 0.0 { wi.z.abs() } else { 0.0 };
            assert_eq!(bsdf.eval(wi), (params.base_color * FRAC_1_PI * cos, cos * FRAC_1_PI));
        }
    }
    assert!(
        !Bsdf::new(&SurfaceParams { base_color: Vec3::ZERO, ..params }, Vec3::Z, Vec3::Z, Vec3::Z).has_smooth_lobes()
    );
}

#[test]
fn a_dielectric_head_on_is_gltfs_own_formula() {
    for roughness in [0.3f32, 0.7, 1.0] {
        let params = coat(roughness);
        let (wo, wi) = (towards(0.2, 0.0), towards(0.4, 2.0));
        let half = (wo + wi).normalize();
        let alpha2 = roughness.powi(4);
        let schlick = 0.04 + 0.96 * (1.0 - wo.dot(half)).powi(5);
        let d = alpha2 / (PI * (half.z * half.z * (alpha2 - 1.0) + 1.0).powi(2));
        let shadowed = |a: f32, b: f32| a * (alpha2 + (1.0 - alpha2) * b * b).sqrt();
        let visibility = 0.5 / (shadowed(wi.z, wo.z) + shadowed(wo.z, wi.z));
        let expected = params.base_color * ((1.0 - schlick) / PI) + Vec3::splat(schlick * d * visibility);
        let value = Bsdf::new(&params, Vec3::Z, Vec3::Z, wo).eval(wi).0 / wi.z;
        assert!((value - expected).abs().max_element() < 5e-3 * expected.max_element(), "{value} against {expected}");
    }
}

#[test]
fn light_never_leaks_through_the_geometry() {
    let (ng, ns) = (Vec3::Z, Vec3::new(0.8, 0.0, 0.6));
    for (name, surface) in table() {
        for wo in viewers() {
            let bsdf = surface.bsdf(ng, ns, wo);
            for index in 0..300 {
                let mut sampler = Sampler::new(SEED, 4, index);
                if let Some(sample) = bsdf.sample(sampler.next_1d(), sampler.next_2d()) {
                    let crosses = sample.wi.z * wo.z < 0.0;
                    assert_eq!(crosses, sample.transmitted, "{name}");
                    assert!(!crosses || surface.transmits(), "{name}");
                }
                let wi = uniform_sphere(sampler.next_2d());
                let (f_cos, pdf) = bsdf.eval(wi);
                if !surface.transmits() && wi.z * wo.z <= 0.0 {
                    assert_eq!((f_cos, pdf), (Vec3::ZERO, 0.0), "{name}");
                }
            }
        }
    }
}

#[test]
fn grazing_angles_and_extreme_parameters_stay_finite() {
    let shapes = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 1.0), (0.5, 0.5, 1.0)];
    for (metallic, transmission, thickness) in shapes {
        for roughness in [0.0, 0.03, 0.0317, 0.04, 0.1, 0.5, 1.0] {
            for ior in [0.0, 1.0, 1.0002, 1.5, 4.0] {
                let params = SurfaceParams { metallic, transmission, thickness, roughness, ior, ..WHITE };
                for cos in [1.0f32, 1e-2, 1e-4, 1e-7, 0.0, -1e-7, -1e-3, -1.0] {
                    assert_finite(&Bsdf::new(&params, Vec3::Z, Vec3::Z, towards(cos.acos(), 0.1)));
                }
            }
        }
    }
}

fn assert_finite(bsdf: &Bsdf) {
    assert!(bsdf.albedo_estimate().is_finite() && bsdf.peak_estimate().is_finite() && bsdf.base_albedo().is_finite());
    for index in 0..24 {
        let mut sampler = Sampler::new(SEED, 9, index);
        if let Some(sample) = bsdf.sample(sampler.next_1d(), sampler.next_2d()) {
            assert!(sample.weight.is_finite() && sample.wi.is_finite() && sample.pdf.is_finite());
            assert!(sample.weight.min_element() >= 0.0);
        }
        let wi = uniform_sphere(sampler.next_2d());
        for wi in [wi, Vec3::new(wi.x, wi.y, wi.z * 1e-6).normalize(), Vec3::Z, -Vec3::Z] {
            let (f_cos, pdf) = bsdf.eval(wi);
            assert!(f_cos.is_finite() && pdf.is_finite() && f_cos.min_element() >= 0.0 && pdf >= 0.0);
        }
    }
}

#[test]
fn the_albedo_estimate_is_close_to_the_sampled_albedo() {
    // Of stretched facets only an upper bound is known.
    for (name, surface) in table().into_iter().filter(|(_, surface)| surface.finish.anisotropy == 0.0) {
        for wo in [towards(0.1, 0.0), towards(0.9, 0.0), towards(1.3, 0.0)] {
            let bsdf = surface.bsdf(Vec3::Z, Vec3::Z, wo);
            let estimate = bsdf.albedo_estimate().max_element();
            let (mean, _) = energy(&bsdf, squeeze(&surface.params, wo), 4096);
            // Of a film only the reflectance in the mirror direction is looked at.
            let tolerance = if surface.finish.iridescence > 0.0 { 0.15 } else { 0.08 };
            assert!((f64::from(estimate) - mean).abs() < tolerance, "{name}: {estimate} against {mean}");
        }
    }
}
