//! The sky as light: directions to sample, and what arrives from one.

use std::sync::Arc;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::environment::direction_at;
use super::patch_sampler::PatchSampler;
use super::{Dome, Environment, MapSampler, SUN_RADIUS_RAD, SkyLight, Turn};
use crate::light::luminance;

/// A map as it is turned.
#[derive(Clone, Debug)]
struct TurnedMap {
    map: Arc<Environment>,
    turn: Turn,
}

impl TurnedMap {
    fn of(light: &SkyLight) -> TurnedMap {
        TurnedMap { map: light.map.clone(), turn: light.turn() }
    }

    /// Radiance from a unit direction of the scene, nit.
    fn radiance(&self, direction: Vec3) -> Vec3 {
        self.map.radiance(self.turn.sky_from_world(direction))
    }
}

/// A map as it is, one column.
#[derive(Clone, Debug)]
pub struct MapEmitter {
    turned: TurnedMap,
    sampler: Arc<MapSampler>,
}

impl MapEmitter {
    /// Of a sky as it is turned; its intensity is the column's.
    pub fn new(light: &SkyLight) -> MapEmitter {
        let sampler = Arc::new(MapSampler::new(&light.map));
        MapEmitter { turned: TurnedMap::of(light), sampler }
    }

    /// Radiance from a unit direction, nit.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        self.turned.radiance(direction)
    }

    /// Solid-angle density of a unit direction.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        self.sampler.pdf(self.turned.turn.sky_from_world(direction))
    }

    /// A unit direction and its solid-angle density.
    pub fn sample(&self, u: Vec2) -> (Vec3, f32) {
        let (direction, pdf) = self.sampler.sample(u);
        (self.turned.turn.world_from_sky(direction), pdf)
    }

    /// Mean luminance over all directions, nit.
    pub fn mean_luminance(&self) -> f32 {
        self.sampler.mean_luminance()
    }
}

/// Patches of 1 nit, one column each, after them the column of the map as it is baked, and that of what the camera sees.
///
/// Whoever looks towards a patch sees the map there as well: one direction serves both columns. Where the map is about even over
/// a patch, so are the directions. Else half of them are spread evenly, and half in proportion to the map, so that neither column
/// has a sample of more than about twice its weight.
#[derive(Clone, Debug)]
pub struct DomeEmitter {
    /// The patches.
    pub dome: Dome,
    turned: TurnedMap,
    /// Of each patch that the map is not even over.
    uneven: Arc<Vec<Option<PatchSampler>>>,
    /// Mean luminance of the map over each patch, nit.
    luminance: Arc<Vec<f32>>,
}

/// How many times as bright as in the mean a map may be in a patch that it is called even over: samples of less contrast are not
/// worth a look into the map for each.
const EVEN: f32 = 4.0;

impl DomeEmitter {
    /// A dome for a sky as it is turned.
    pub fn new(divisions: u32, light: &SkyLight) -> DomeEmitter {
        let (dome, turned) = (Dome::new(divisions), TurnedMap::of(light));
        let TurnedMap { map, turn } = &turned;
        let luminances: Vec<f32> = dome.means(map, *turn).into_iter().map(|mean| luminance(Vec3::from(mean))).collect();
        let of_patch = |patch: u32| {
            let sampler = PatchSampler::new(map, *turn, &dome, patch);
            (sampler.brightest() > EVEN * luminances[patch as usize]).then_some(sampler)
        };
        let uneven: Vec<_> = (0..dome.n_patches()).into_par_iter().map(of_patch).collect();
        DomeEmitter { dome, turned, uneven: Arc::new(uneven), luminance: Arc::new(luminances) }
    }

    /// Radiance of the map as it is baked, from a unit direction, nit.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        self.turned.radiance(direction)
    }

    /// Mean luminance of the map as it is baked over each patch, nit.
    pub fn luminances(&self) -> &[f32] {
        &self.luminance
    }

    /// At most about how bright the map is where a direction of a patch has that density, nit: directions are the denser the
    /// brighter it is there.
    pub fn shining(&self, patch: u32, density: f32) -> f32 {
        2.0 * self.luminance[patch as usize] * density * self.dome.solid_angle(patch)
    }

    /// A unit direction in a patch and its solid-angle density.
    pub fn sample(&self, patch: u32, u: Vec2) -> (Vec3, f32) {
        let direction = match &self.uneven[patch as usize] {
            None => self.dome.direction(patch, u),
            Some(_) if u.x < 0.5 => self.dome.direction(patch, Vec2::new(2.0 * u.x, u.y)),
            Some(sampler) => {
                let uv = sampler.sample(&self.turned.map, Vec2::new(2.0 * u.x - 1.0, u.y));
                self.turned.turn.world_from_sky(direction_at(uv))
            }
        };
        (direction, self.density(patch, direction))
    }

    /// The patch that a unit direction lies in, and the solid-angle density of the direction among those of the patch.
    pub fn place(&self, direction: Vec3) -> (u32, f32) {
        let patch = self.dome.patch(direction);
        (patch, self.density(patch, direction))
    }

    fn density(&self, patch: u32, direction: Vec3) -> f32 {
        let even = 1.0 / self.dome.solid_angle(patch);
        match &self.uneven[patch as usize] {
            None => even,
            Some(sampler) => 0.5 * (even + sampler.pdf(direction, luminance(self.radiance(direction)))),
        }
    }
}

/// A disk that sends 1 lx to what faces it, one column.
#[derive(Clone, Copy, Debug)]
pub struct SunEmitter {
    /// Unit vector towards its middle.
    pub direction: Vec3,
    /// Angle from its middle to its rim, radians, more than 0 and less than π/2.
    pub radius_rad: f64,
}

impl SunEmitter {
    /// As large as the sun is seen from the earth.
    pub fn new(direction: Vec3) -> SunEmitter {
        SunEmitter { direction, radius_rad: SUN_RADIUS_RAD }
    }

    /// Its radiance in nit.
    pub fn radiance(&self) -> f32 {
        // Its solid angle, each part times its cosine.
        (1.0 / (std::f64::consts::PI * self.radius_rad.sin().powi(2))) as f32
    }

    /// Density of a direction in the disk, 1/sr.
    pub fn pdf(&self) -> f32 {
        (1.0 / (2.0 * std::f64::consts::TAU * (0.5 * self.radius_rad).sin().powi(2))) as f32
    }

    /// Whether a unit direction meets the disk.
    pub fn contains(&self, direction: Vec3) -> bool {
        // The chord is exact where the cosine of so small an angle is not.
        let chord = 2.0 * (0.5 * self.radius_rad).sin();
        (direction - self.direction).length_squared() <= (chord * chord) as f32
    }

    /// A unit direction, uniform over the disk.
    pub fn sample(&self, u: Vec2) -> Vec3 {
        let below_one = u.x * (1.0 - self.radius_rad.cos()) as f32;
        let sin = (below_one * (2.0 - below_one)).sqrt();
        let (sin_phi, cos_phi) = (std::f32::consts::TAU * u.y).sin_cos();
        let (tangent, bitangent) = self.direction.any_orthonormal_pair();
        tangent * (sin * cos_phi) + bitangent * (sin * sin_phi) + self.direction * (1.0 - below_one)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::Sampler;
    use crate::sky::environment::uv_of;

    #[test]
    fn directions_of_the_sun_fill_its_disk_evenly() {
        let sun = SunEmitter::new(Vec3::new(0.3, 0.8, -0.5).normalize());
        let (n, mut inner) = (4096, 0);
        for i in 0..n {
            let d = sun.sample(Vec2::from(Sampler::new(1, 1, i).next_2d()));
            let angle = f64::from((d - sun.direction).length());
            assert!(angle <= SUN_RADIUS_RAD * 1.001, "{angle}");
            inner += u32::from(angle < SUN_RADIUS_RAD / 2.0);
        }
        assert!((f64::from(inner) / f64::from(n) - 0.25).abs() < 0.01, "a quarter of the area: {inner}");
        let beside = sun.direction.any_orthonormal_vector();
        let at = |radii: f32| (sun.direction + beside * (radii * SUN_RADIUS_RAD as f32)).normalize();
        assert!(sun.contains(at(0.99)) && !sun.contains(at(1.01)));
    }

    #[test]
    fn a_turned_map_is_sampled_where_it_shines() {
        let map = Environment::from_fn(64, 32, |d| Vec3::splat(if d.dot(Vec3::X) > 0.9 { 50.0 } else { 0.1 }));
        let light = SkyLight { rotation_deg: 90.0, ..SkyLight::new("spot", map) };
        let emitter = MapEmitter::new(&light);
        assert!(emitter.radiance(Vec3::NEG_Z).x > 40.0 && emitter.radiance(Vec3::X).x < 1.0);
        let samples: Vec<_> = (0..100).map(|i| emitter.sample(Vec2::from(Sampler::new(2, 3, i).next_2d()))).collect();
        assert!(samples.iter().filter(|(d, _)| d.dot(Vec3::NEG_Z) > 0.8).count() > 85);
        // Rounding may carry a sample over the edge of its pixel.
        assert!(samples.iter().filter(|(d, pdf)| emitter.pdf(*d) == *pdf).count() > 95);
    }

    /// A sun of one pixel in a dim sky, turned, and the patch it stands in.
    fn dome_with_a_sun() -> (DomeEmitter, u32) {
        let sun = Vec3::new(0.4, 0.5, -0.6).normalize();
        let map = Environment::from_fn(256, 128, |d| Vec3::splat(if d.dot(sun) > 0.9998 { 3e4 } else { 1.0 + d.y }));
        assert!(map.pixels().iter().any(|rgb| rgb[0] > 1e4));
        let emitter = DomeEmitter::new(1, &SkyLight { rotation_deg: 33.0, ..SkyLight::new("sun", map) });
        let luminance = |patch: u32| emitter.luminances()[patch as usize];
        let brightest = (0..290).max_by(|&a, &b| luminance(a).total_cmp(&luminance(b))).unwrap();
        (emitter, brightest)
    }

    #[test]
    fn directions_of_a_patch_fall_where_their_density_says() {
        const CELLS: usize = 16;
        const FINE: usize = 24;
        let ((emitter, brightest), n) = (dome_with_a_sun(), 20_000u32);
        let place = |at: usize, side: usize| (Vec2::new((at % side) as f32, (at / side) as f32) + 0.5) / side as f32;
        for patch in [0, 17, 200, brightest, 289] {
            let mut counts = [0.0; CELLS * CELLS];
            for index in 0..n {
                let (d, pdf) = emitter.sample(patch, Vec2::from(Sampler::new(3, u64::from(patch), index).next_2d()));
                let (found, within) = emitter.dome.place(d);
                // Rounding may carry a sample over the edge of its patch.
                if found == patch {
                    assert_eq!(emitter.place(d), (patch, pdf));
                    let [x, y] = (within * CELLS as f32).to_array().map(|at| (at as usize).min(CELLS - 1));
                    counts[y * CELLS + x] += 1.0;
                }
            }
            let lost = f64::from(n) - counts.iter().sum::<f64>();
            assert!(lost < 0.01 * f64::from(n), "patch {patch}: {lost} samples beside their patch");
            let mut shares = [0.0; CELLS * CELLS];
            for at in 0..(CELLS * FINE).pow(2) {
                let within = place(at, CELLS * FINE);
                let density = emitter.density(patch, emitter.dome.direction(patch, within));
                let [x, y] = (within * CELLS as f32).to_array().map(|at| at as usize);
                shares[y * CELLS + x] += f64::from(density * emitter.dome.solid_angle(patch));
            }
            let per_cell = ((CELLS * FINE) as f64).powi(2);
            let total = shares.iter().sum::<f64>() / per_cell;
            assert!((total - 1.0).abs() < 0.01, "patch {patch}: {total}");
            let expected = shares.map(|share| f64::from(n) * share / per_cell);
            let chi_square: f64 = counts.iter().zip(expected).map(|(count, e)| (count - e) * (count - e) / e).sum();
            let freedom = (CELLS * CELLS) as f64 - 1.0;
            assert!(chi_square < freedom + 6.0 * f64::sqrt(2.0 * freedom), "patch {patch}: {chi_square}");
        }
    }

    #[test]
    fn a_sun_of_one_pixel_is_worth_as_much_wherever_it_stands() {
        let n = 256u32;
        // Among them suns on an edge of a patch, and on a corner.
        for place in [[0.5, 0.5], [0.5, 1.0], [0.0, 0.4], [0.0, 1.0], [0.31, 0.69]] {
            let dome = Dome::new(1);
            let toward = dome.direction(200, Vec2::from(place));
            let mut pixels = vec![[1.0; 3]; 500 * 300];
            let uv = uv_of(toward);
            let (x, y) = ((uv.x * 500.0) as usize % 500, (uv.y * 299.0).round() as usize);
            pixels[y * 500 + x] = [1e6; 3];
            let map = Environment::new(500, 300, pixels).unwrap().0;
            let means = map.cell_means();
            let light: f64 =
                means.iter().zip(0..).map(|(mean, at)| f64::from(mean[0]) * map.solid_angle(at / 500)).sum();
            let emitter = DomeEmitter::new(1, &SkyLight::new("sun", map));
            let (mut sum, mut most) = (0.0, 0.0f64);
            for patch in 0..dome.n_patches() {
                for index in 0..n {
                    let (d, pdf) =
                        emitter.sample(patch, Vec2::from(Sampler::new(5, u64::from(patch), index).next_2d()));
                    let counts = f64::from(luminance(emitter.radiance(d)) / pdf);
                    sum += counts / f64::from(n);
                    most = most.max(counts);
                }
            }
            assert!((sum / light - 1.0).abs() < 0.02, "{place:?}: {sum} for {light}");
            assert!(most < 2.5 * light, "{place:?}: a sample of {most} for {light}");
        }
    }

    #[test]
    fn half_of_the_directions_of_a_patch_go_where_a_sun_stands_in_it() {
        let (emitter, brightest) = dome_with_a_sun();
        let sampled = |i| emitter.sample(brightest, Vec2::from(Sampler::new(2, 3, i).next_2d()));
        let samples: Vec<_> = (0..1000).map(sampled).collect();
        let bright = samples.iter().filter(|(d, _)| emitter.radiance(*d).x > 1e3).count();
        assert!(bright > 100, "{bright} of 1000 near the sun");
        // No sample of a patch of 1 nit counts more than twice its share.
        let least = 0.499 / emitter.dome.solid_angle(brightest);
        assert!(samples.iter().all(|(_, pdf)| *pdf > least));
        // What samples tell of the map is its mean over the patch.
        let n = 100_000;
        let mean: f64 =
            (0..n).map(sampled).map(|(d, pdf)| f64::from(luminance(emitter.radiance(d)) / pdf) / f64::from(n)).sum();
        let fine = 400;
        let at = |i: u32| (Vec2::new((i % fine) as f32, (i / fine) as f32) + 0.5) / fine as f32;
        let seen = |i| luminance(emitter.radiance(emitter.dome.direction(brightest, at(i))));
        let expected: f64 = (0..fine * fine).map(|i| f64::from(seen(i)) / f64::from(fine * fine)).sum();
        let expected = expected * f64::from(emitter.dome.solid_angle(brightest));
        assert!((mean / expected - 1.0).abs() < 0.03, "{mean} for {expected}");
    }

    #[test]
    fn patches_of_an_even_or_black_map_are_sampled_evenly() {
        for radiance in [Vec3::ZERO, Vec3::ONE] {
            let emitter = DomeEmitter::new(2, &SkyLight::new("even", Environment::uniform(radiance)));
            for patch in [0, 140, 300, emitter.dome.n_patches() - 1] {
                let (_, pdf) = emitter.sample(patch, Vec2::new(0.7, 0.2));
                assert!((pdf * emitter.dome.solid_angle(patch) - 1.0).abs() < 1e-3);
            }
        }
    }
}
