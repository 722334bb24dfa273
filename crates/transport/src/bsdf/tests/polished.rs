//! Lobes that have a density and are far narrower than the cells of the other laws: the same laws, in cells and for directions close to
//! those in which a mirror or clear glass would show a picture.

use super::finishes::{brushed, lacquered, oily, with};
use super::*;

/// From where a lobe has a density (about 0.03) to where the other laws begin.
const ROUGHNESS: [f32; 3] = [0.05, 0.1, 0.2];
const N_RINGS: usize = 24;
const N_SECTORS: usize = 12;
/// Steps of the integral across a ring, and across a sector: near grazing angles, where a lobe is six times as long as wide, and more if it
/// is brushed, it is met in few directions.
const FINE: [usize; 2] = [8, 48];
/// A tenth of them, the least that goes to a coat, are two dozen in each cell that its lobe covers.
const N_SAMPLES: u32 = 40_000;

/// Every kind of narrow lobe, alone and mixed.
fn narrow_table(roughness: f32) -> [(&'static str, Surface); 11] {
    let plain = |params: SurfaceParams| with(params, FinishParams::default());
    let half = SurfaceParams { metallic: 0.3, transmission: 0.5, ..coat(roughness) };
    [
        ("coat", plain(coat(roughness))),
        ("metal", plain(metal(roughness))),
        ("thin wall", plain(thin(roughness))),
        ("glass", plain(glass(roughness))),
        ("half of everything", plain(SurfaceParams { thickness: 1.0, ..half })),
        ("half of a thin everything", plain(half)),
        ("lacquer over matte", with(lambert(), lacquered(roughness))),
        ("lacquer over metal", with(metal(0.6), lacquered(roughness))),
        ("brushed metal", with(metal(roughness), brushed(roughness))),
        ("oil on metal", with(metal(roughness), oily(400.0))),
        ("oil on glass", with(glass(roughness), oily(500.0))),
    ]
}

/// All of them, each with its roughness.
fn narrow_surfaces() -> impl Iterator<Item = (String, Surface, f32)> {
    ROUGHNESS.into_iter().flat_map(|roughness| {
        let named = move |(name, surface): (&str, Surface)| (format!("{name} of {roughness}"), surface, roughness);
        narrow_table(roughness).into_iter().map(named)
    })
}

/// Where smooth facets would show a picture, on the viewer's side and on the other.
fn pictures(params: &SurfaceParams, wo: Vec3) -> [Vec3; 2] {
    let mirrored = Vec3::new(-wo.x, -wo.y, wo.z);
    if params.thickness <= 0.0 {
        return [mirrored, -wo];
    }
    let eta = if wo.z > 0.0 { params.ior } else { 1.0 / params.ior };
    // Beyond total reflection the few facets that let light pass send it about along the surface.
    let along = (Vec3::new(-wo.x, -wo.y, 0.0) / eta).clamp_length_max(1.0);
    let up = (1.0 - along.length_squared()).max(0.0).sqrt();
    [mirrored, Vec3::new(along.x, along.y, if wo.z > 0.0 { -up } else { up })]
}

/// Cells around a direction: rings of equal steps of ln(1 + δ/s), δ the angle to it, so that they are finest in the lobe and still cover
/// the sphere.
struct Rings {
    center: Vec3,
    across: [Vec3; 2],
    /// s in radians.
    scale: f32,
    /// The logarithm of the opposite direction.
    end: f32,
}

impl Rings {
    fn around(center: Vec3, scale: f32) -> Rings {
        Rings { center, across: center.any_orthonormal_pair().into(), scale, end: (1.0 + PI / scale).ln() }
    }

    fn cell(&self, wi: Vec3) -> usize {
        let [x, y] = self.across.map(|axis| wi.dot(axis));
        let angle = self.center.cross(wi).length().atan2(self.center.dot(wi));
        let ring = ((1.0 + angle / self.scale).ln() / self.end * N_RINGS as f32) as usize;
        let sector = ((y.atan2(x) / (2.0 * PI)).rem_euclid(1.0) * N_SECTORS as f32) as usize;
        ring.min(N_RINGS - 1) * N_SECTORS + sector.min(N_SECTORS - 1)
    }

    /// ∫ pdf over each cell, of directions that count, midpoint rule.
    fn expected(&self, bsdf: &Bsdf, counts: impl Fn(Vec3) -> bool) -> Vec<f64> {
        let [fine_rings, fine_sectors] = FINE;
        let (rows, columns) = (N_RINGS * fine_rings, N_SECTORS * fine_sectors);
        let steps = f64::from(self.end) / rows as f64 * 2.0 * f64::from(PI) / columns as f64;
        let [x, y] = self.across;
        let mut mass = vec![0.0; N_RINGS * N_SECTORS];
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            // δ + s grows as the exponential does, and so does the width of a step.
            let stretched = self.scale * ((row as f32 + 0.5) / rows as f32 * self.end).exp();
            let angle = stretched - self.scale;
            let (sin, cos) = ((column as f32 + 0.5) / columns as f32 * 2.0 * PI).sin_cos();
            let wi = self.center * angle.cos() + (x * cos + y * sin) * angle.sin();
            if counts(wi) {
                let density = f64::from(bsdf.eval(wi).1 * angle.sin() * stretched);
                mass[row / fine_rings * N_SECTORS + column / fine_sectors] += density * steps;
            }
        }
        mass
    }
}

#[test]
fn samples_of_narrow_lobes_are_distributed_as_their_density_says() {
    for (nth, (name, surface, roughness)) in narrow_surfaces().enumerate() {
        for wo in viewers().into_iter().skip(nth % 2).step_by(2) {
            let bsdf = surface.bsdf(Vec3::Z, Vec3::Z, wo);
            // Refraction turns light by about a third of what the facets are tilted: rings are finer than that.
            let rings = pictures(&surface.params, wo).map(|center| Rings::around(center, 0.25 * roughness * roughness));
            let side = |wi: Vec3| usize::from(wi.z * wo.z < 0.0);
            let mut counts = vec![0; rings.len() * N_RINGS * N_SECTORS];
            let n_other = each_sample(&bsdf, N_SAMPLES, |wi| {
                counts[side(wi) * N_RINGS * N_SECTORS + rings[side(wi)].cell(wi)] += 1;
            });
            let of_side = |(own, rings): (usize, &Rings)| rings.expected(&bsdf, |wi| side(wi) == own);
            let mass: Vec<f64> = rings.iter().enumerate().flat_map(of_side).collect();
            assert_counts(&format!("{name} from {wo}"), &counts, &mass, n_other);
        }
    }
}

/// Rounding turns the normal of a facet by less than 10⁻⁶, so the narrowest lobe changes by less than a thousandth, away from grazing angles.
#[test]
fn narrow_lobes_are_reciprocal_up_to_the_squared_index() {
    for (name, surface, _) in narrow_surfaces() {
        let mut met = [0, 0];
        for index in 0..2000 {
            let mut sampler = Sampler::new(SEED, 13, index);
            let a = uniform_sphere(sampler.next_2d());
            let sample = surface.bsdf(Vec3::Z, Vec3::Z, a).sample(sampler.next_1d(), sampler.next_2d());
            let Some(b) = sample.filter(|sample| sample.kind == ScatterKind::Smooth).map(|sample| sample.wi) else {
                continue;
            };
            if a.z.abs() < 0.1 || b.z.abs() < 0.1 {
                continue;
            }
            met[usize::from(a.z * b.z < 0.0)] += u32::from(assert_reciprocal(&name, &surface, [a, b]));
        }
        assert!(met[0] > 100, "{name}: {met:?} pairs were compared");
        assert_eq!(met[1] > 0, surface.transmits(), "{name}: {met:?} pairs were compared");
    }
}
