//! Directions of a map in proportion to its luminance.

use glam::{Vec2, Vec3};

use super::Environment;
use super::environment::uv_of;
use crate::light::luminance;

/// A density over directions that is constant over each pixel of a map: that pixel's mean luminance. Wherever the
/// bilinear map shines the density is positive, and `pdf` is exactly that of `sample`.
#[derive(Clone, Debug)]
pub struct MapSampler {
    width: usize,
    /// Sines of the elevations between which each row lies, the upper one first.
    sines: Vec<[f32; 2]>,
    /// Summed probabilities of the rows.
    rows: Vec<f32>,
    /// Summed probabilities of the pixels of each row, within their row.
    cells: Vec<f32>,
    /// Solid-angle density over each pixel.
    density: Vec<f32>,
    /// Mean luminance over all directions in nit.
    mean_luminance: f32,
}

impl MapSampler {
    /// For a map; a black one is sampled uniformly.
    pub fn new(map: &Environment) -> MapSampler {
        let width = map.width();
        let mut density: Vec<f32> = map.cell_means().into_iter().map(|rgb| luminance(Vec3::from(rgb))).collect();
        let row_sum = |row: &[f32]| row.iter().map(|&v| f64::from(v)).sum::<f64>();
        let flux = |density: &[f32]| -> Vec<f64> {
            density.chunks_exact(width).enumerate().map(|(y, row)| row_sum(row) * map.solid_angle(y)).collect()
        };
        let mut fluxes = flux(&density);
        let mut total: f64 = fluxes.iter().sum();
        let mean_luminance = (total / (4.0 * std::f64::consts::PI)) as f32;
        if total <= 0.0 {
            density.fill(1.0);
            fluxes = flux(&density);
            total = fluxes.iter().sum();
        }
        let mut cells = Vec::with_capacity(density.len());
        for row in density.chunks_exact(width) {
            let (sum, mut so_far) = (row_sum(row).max(f64::MIN_POSITIVE), 0.0);
            cells.extend(row.iter().map(|&v| {
                so_far += f64::from(v) / sum;
                so_far as f32
            }));
        }
        let mut so_far = 0.0;
        let summed = |flux: f64| {
            so_far += flux / total;
            so_far as f32
        };
        let rows = fluxes.into_iter().map(summed).collect();
        density.iter_mut().for_each(|d| *d = (f64::from(*d) / total) as f32);
        let sines = (0..map.height()).map(|row| map.row_sines(row)).map(|[low, high]| [high as f32, low as f32]);
        MapSampler { width, sines: sines.collect(), rows, cells, density, mean_luminance }
    }

    /// Mean luminance over all directions in nit.
    pub fn mean_luminance(&self) -> f32 {
        self.mean_luminance
    }

    /// A unit direction of the map and its solid-angle density; `u` uniform in [0, 1)².
    pub fn sample(&self, u: Vec2) -> (Vec3, f32) {
        let (row, v) = pick(&self.rows, u.x);
        let start = row * self.width;
        let (column, u) = pick(&self.cells[start..start + self.width], u.y);
        let [upper, lower] = self.sines[row];
        let y = upper + (lower - upper) * v;
        let phi = std::f32::consts::TAU * ((column as f32 + u) / self.width as f32 - 0.5);
        let (sin, cos) = phi.sin_cos();
        let r = (1.0 - y * y).max(0.0).sqrt();
        (Vec3::new(r * cos, y, r * sin), self.density[start + column])
    }

    /// Solid-angle density of a unit direction of the map.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        let last = self.sines.len() - 1;
        let at = uv_of(direction) * Vec2::new(self.width as f32, last as f32);
        let (x, y) = ((at.x as usize).min(self.width - 1), ((at.y + 0.5) as usize).min(last));
        self.density[y * self.width + x]
    }
}

/// Which of some stretches, given by their summed probabilities, a number falls into, and where in it, 0…1.
pub(super) fn pick(summed: &[f32], u: f32) -> (usize, f32) {
    let u = u * summed.last().copied().unwrap_or(1.0);
    let at = summed.partition_point(|&sum| sum <= u).min(summed.len() - 1);
    let start = if at == 0 { 0.0 } else { summed[at - 1] };
    (at, ((u - start) / (summed[at] - start).max(f32::MIN_POSITIVE)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::Sampler;

    /// Dim everywhere, a hundredfold in one corner, black in a quarter.
    fn map() -> Environment {
        Environment::from_fn(16, 8, |d| match () {
            () if d.x > 0.0 && d.z > 0.0 => Vec3::ZERO,
            () if d.y > 0.6 && d.x < 0.0 => Vec3::splat(100.0),
            () => Vec3::splat(1.0 + 0.5 * d.z),
        })
    }

    #[test]
    fn the_density_of_a_map_integrates_to_one() {
        let (map, sampler) = (map(), MapSampler::new(&map()));
        let total: f64 = (0..16 * 8).map(|i| f64::from(sampler.density[i]) * map.solid_angle(i / 16)).sum();
        assert!((total - 1.0).abs() < 1e-6, "{total}");
    }

    #[test]
    fn samples_of_a_map_fall_where_their_density_says() {
        let (map, sampler, n) = (map(), MapSampler::new(&map()), 100_000u32);
        let mut counts = vec![0.0; 16 * 8];
        for index in 0..n {
            let (d, pdf) = sampler.sample(Vec2::from(Sampler::new(7, 0, index).next_2d()));
            assert!((d.length() - 1.0).abs() < 1e-5);
            let at = map.place(d);
            let cell = ((at.y + 0.5) as usize).min(7) * 16 + (at.x as usize).min(15);
            // Rounding may carry a sample over the edge of its pixel.
            if pdf == sampler.pdf(d) {
                counts[cell] += 1.0;
            }
        }
        let lost = f64::from(n) - counts.iter().sum::<f64>();
        assert!(lost < 20.0, "{lost} samples beside their pixel");
        let (mut chi_square, mut freedom) = (0.0, -1.0);
        for (cell, count) in counts.iter().enumerate() {
            let expected = f64::from(n) * f64::from(sampler.density[cell]) * map.solid_angle(cell / 16);
            if expected >= 5.0 {
                chi_square += (count - expected) * (count - expected) / expected;
                freedom += 1.0;
            } else {
                assert!(*count < 30.0);
            }
        }
        // Mean and deviation of chi-square are its degrees of freedom and the root of twice as many.
        let limit = freedom + 5.0 * f64::sqrt(2.0 * freedom);
        assert!(chi_square < limit, "{chi_square} above {limit}");
    }

    #[test]
    fn weighted_samples_give_the_irradiance_of_the_map() {
        let (map, sampler, n) = (map(), MapSampler::new(&map()), 20_000);
        let mut sum = 0.0;
        for index in 0..n {
            let (d, pdf) = sampler.sample(Vec2::from(Sampler::new(3, 0, index).next_2d()));
            sum += f64::from(map.radiance(d).x / pdf * d.y.max(0.0)) / f64::from(n);
        }
        let fine = 512;
        let exact: f64 = (0..fine * fine)
            .map(|i| {
                let uv = (Vec2::new((i % fine) as f32, (i / fine) as f32) + 0.5) / fine as f32;
                let d = super::super::environment::direction_at(uv);
                let area = 2.0 * std::f64::consts::PI.powi(2) / f64::from(fine * fine);
                f64::from(map.radiance(d).x * d.y.max(0.0) * (1.0 - d.y * d.y).sqrt()) * area
            })
            .sum();
        assert!((sum / exact - 1.0).abs() < 0.01, "{sum} against {exact}");
    }

    #[test]
    fn a_black_map_is_sampled_uniformly() {
        let sampler = MapSampler::new(&Environment::uniform(Vec3::ZERO));
        let (_, pdf) = sampler.sample(Vec2::splat(0.3));
        assert!((pdf - 0.25 / std::f32::consts::PI).abs() < 1e-6);
        assert_eq!(sampler.mean_luminance(), 0.0);
    }
}
