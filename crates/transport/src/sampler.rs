//! Counter-based random numbers: what a number is depends on seed, stream, sample index and dimension alone.
//!
//! Every pair of dimensions is an Owen-scrambled Sobol (0,2)-sequence with its own shuffled index, so that consecutive
//! samples of a stream are stratified in each pair and different pairs know nothing of each other. \[Burley2020\]

use std::f32::consts::TAU;

use glam::Vec3;

/// A cursor over the dimensions of one sample of a stream. Cheap to copy.
#[derive(Clone, Copy, Debug)]
pub struct Sampler {
    key: u64,
    reversed_index: u32,
    pair: u32,
}

impl Sampler {
    /// Sample `index` of a stream. Samples 0, 1, 2, … of one stream are stratified together; streams are independent.
    pub fn new(seed: u64, stream: u64, index: u32) -> Sampler {
        Sampler { key: mix(mix(seed).wrapping_add(stream)), reversed_index: index.reverse_bits(), pair: 0 }
    }

    /// The same for a sample that knows nothing of the others of its stream: there to be compared with.
    pub(crate) fn lone(seed: u64, stream: u64, index: u32) -> Sampler {
        let Sampler { key, .. } = Sampler::new(seed, stream, 0);
        Sampler {
            key: mix(key ^ mix(u64::from(index).wrapping_add(0x5851_F42D_4C95_7F2D))),
            reversed_index: 0,
            pair: 0,
        }
    }

    /// The next dimension, uniform in [0, 1).
    #[inline]
    pub fn next_1d(&mut self) -> f32 {
        let (index, seeds) = self.next_pair();
        to_unit(scramble(index, seeds as u32).reverse_bits())
    }

    /// The next two dimensions, uniform in [0, 1)² and stratified together.
    #[inline]
    pub fn next_2d(&mut self) -> [f32; 2] {
        let (index, seeds) = self.next_pair();
        let first = scramble(index, seeds as u32).reverse_bits();
        let second = scramble(sobol_reversed(index), (seeds >> 32) as u32).reverse_bits();
        [to_unit(first), to_unit(second)]
    }

    /// The numbers of one of `n` continuations, a power of two: those of all continuations of consecutive samples are
    /// stratified together.
    pub fn fork(&self, nth: u32, n: u32) -> Sampler {
        let place = u64::from(self.pair) << 32;
        let key = mix(self.key ^ mix(place.wrapping_add(0x9E6C_63D0_876A_68DE)));
        let index = self.reversed_index.reverse_bits().wrapping_mul(n).wrapping_add(nth);
        Sampler { key, reversed_index: index.reverse_bits(), pair: 0 }
    }

    /// Shuffled index of the next pair, and the seeds of its two dimensions.
    #[inline]
    fn next_pair(&mut self) -> (u32, u64) {
        self.pair += 1;
        let seeds = mix(self.key.wrapping_add(u64::from(self.pair).wrapping_mul(0x9E37_79B9_7F4A_7C15)));
        let shuffle = (seeds.wrapping_mul(0xD6E8_FEB8_6659_FD93) >> 32) as u32;
        (scramble(self.reversed_index, shuffle).reverse_bits(), seeds)
    }
}

/// A uniform number in [0, 1) for a key: the same for the same key.
pub fn uniform_hash(key: u64) -> f32 {
    to_unit((mix(key) >> 32) as u32)
}

/// The highest 24 bits as a fraction, at most 1 − 2⁻²⁴.
#[inline]
fn to_unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// A permutation of 64-bit words whose every output bit depends on every input bit. \[Steele2014\]
#[inline]
fn mix(key: u64) -> u64 {
    let x = (key ^ (key >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

/// Nested uniform scramble of bit-reversed words: each bit is flipped depending on the lower ones alone. \[Laine2011\]
#[inline]
fn scramble(reversed: u32, seed: u32) -> u32 {
    let mut x = reversed ^ reversed.wrapping_mul(0x3D20_ADEA);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6C56);
    x ^ x.wrapping_mul(0x53A2_2864)
}

/// Bit-reversed second Sobol dimension: its matrix is Pascal's triangle modulo 2, a sum over supersets of bit positions.
#[inline]
fn sobol_reversed(index: u32) -> u32 {
    let mut x = index;
    x ^= (x >> 1) & 0x5555_5555;
    x ^= (x >> 2) & 0x3333_3333;
    x ^= (x >> 4) & 0x0F0F_0F0F;
    x ^= (x >> 8) & 0x00FF_00FF;
    x ^ (x >> 16)
}

/// A unit vector from two uniform numbers, all directions alike.
pub(crate) fn uniform_sphere([u, v]: [f32; 2]) -> Vec3 {
    let z = 1.0 - 2.0 * u;
    let (sin, cos) = (TAU * v).sin_cos();
    let radius = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(radius * cos, radius * sin, z)
}

/// A unit vector from two uniform numbers, with density cosθ/π around a normal.
pub(crate) fn cosine_around(normal: Vec3, [u, v]: [f32; 2]) -> Vec3 {
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let (sin, cos) = (TAU * v).sin_cos();
    tangent * (u.sqrt() * cos) + bitangent * (u.sqrt() * sin) + normal * (1.0 - u).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pairs(seed: u64, stream: u64, n: u32, pair: u32) -> Vec<[f32; 2]> {
        let nth = |index| {
            let mut sampler = Sampler::new(seed, stream, index);
            for _ in 0..pair {
                sampler.next_2d();
            }
            sampler.next_2d()
        };
        (0..n).map(nth).collect()
    }

    fn cells(points: &[[f32; 2]], columns: u32, rows: u32) -> Vec<u32> {
        let mut count = vec![0; (columns * rows) as usize];
        for [x, y] in points {
            count[((y * rows as f32) as u32 * columns + (x * columns as f32) as u32) as usize] += 1;
        }
        count
    }

    #[test]
    fn every_prefix_of_a_power_of_two_fills_every_elementary_interval_once() {
        for stream in 0..50 {
            for pair in [0, 1, 7] {
                let points = pairs(3, stream, 64, pair);
                for (columns, rows) in [(4, 4), (16, 1), (1, 16), (2, 8), (8, 2)] {
                    assert!(cells(&points[..16], columns, rows).iter().all(|&n| n == 1), "{columns}×{rows}");
                }
                assert!(cells(&points, 8, 8).iter().all(|&n| n == 1));
                assert!(cells(&points[48..], 4, 4).iter().all(|&n| n == 1), "an aligned block is stratified too");
            }
        }
    }

    #[test]
    fn single_dimensions_are_stratified_over_the_samples_of_a_stream() {
        let mut count = [0; 32];
        for index in 0..32 {
            let mut sampler = Sampler::new(1, 2, index);
            sampler.next_2d();
            count[(sampler.next_1d() * 32.0) as usize] += 1;
        }
        assert_eq!(count, [1; 32]);
    }

    #[test]
    fn lone_samples_are_even_and_not_stratified() {
        let points = |stream: u64, n: u32| -> Vec<[f32; 2]> {
            (0..n).map(|index| Sampler::lone(3, stream, index).next_2d()).collect()
        };
        for stream in 0..50 {
            assert!(cells(&points(stream, 16), 4, 4).iter().any(|&n| n != 1), "stream {stream}");
        }
        let (many, n_cells) = (points(0, 4096), 64);
        let expected = many.len() as f32 / n_cells as f32;
        let chi_squared: f32 = cells(&many, 8, 8).iter().map(|&n| (n as f32 - expected).powi(2) / expected).sum();
        // Of 63 degrees of freedom one in ten thousand is above 112.
        assert!(chi_squared < 112.0, "{chi_squared}");
        assert_eq!(Sampler::lone(3, 1, 2).next_2d(), Sampler::lone(3, 1, 2).next_2d());
    }

    #[test]
    fn the_same_place_gives_the_same_number_and_another_place_another_one() {
        let first = |seed, stream, index| Sampler::new(seed, stream, index).next_2d();
        assert_eq!(first(1, 2, 3), first(1, 2, 3));
        assert_ne!(first(1, 2, 3), first(2, 2, 3));
        assert_ne!(first(1, 2, 3), first(1, 3, 3));
        assert_ne!(first(1, 2, 3), first(1, 2, 4));
        let (parent, again) = (Sampler::new(1, 2, 3), Sampler::new(1, 2, 3));
        assert_eq!(parent.fork(1, 4).next_1d(), again.fork(1, 4).next_1d());
        assert_ne!(parent.fork(1, 4).next_1d(), parent.fork(2, 4).next_1d());
    }

    #[test]
    fn continuations_of_consecutive_samples_are_stratified_together() {
        let mut count = [0; 32];
        for (index, nth) in (0..8).flat_map(|index| (0..4).map(move |nth| (index, nth))) {
            let mut parent = Sampler::new(1, 2, index);
            parent.next_2d();
            count[(parent.fork(nth, 4).next_1d() * 32.0) as usize] += 1;
        }
        assert_eq!(count, [1; 32]);
    }

    #[test]
    fn streams_pairs_and_forks_are_uncorrelated() {
        let n = 4096;
        let correlation = |draw: &dyn Fn(u64) -> [f32; 2]| {
            let sum: f64 = (0..n).map(draw).map(|[x, y]| (f64::from(x) - 0.5) * (f64::from(y) - 0.5)).sum();
            12.0 * sum / n as f64
        };
        let limit = 5.0 / (n as f64).sqrt();
        let across = [
            correlation(&|s| [Sampler::new(9, s, 0).next_1d(), Sampler::new(9, s + 1, 0).next_1d()]),
            correlation(&|s| [Sampler::new(9, s, 0).next_1d(), Sampler::new(10, s, 0).next_1d()]),
            correlation(&|s| Sampler::new(9, s, 5).next_2d()),
            correlation(&|s| {
                let mut sampler = Sampler::new(9, s, 1);
                [sampler.next_2d()[1], sampler.next_2d()[1]]
            }),
            correlation(&|s| [Sampler::new(9, s, 0).next_1d(), Sampler::new(9, s, 0).fork(0, 4).next_1d()]),
            correlation(&|i| {
                let mut sampler = Sampler::new(9, 4, i as u32);
                [sampler.next_2d()[0], sampler.next_2d()[0]]
            }),
        ];
        assert!(across.iter().all(|c| c.abs() < limit), "{across:?} against {limit}");
    }

    #[test]
    fn numbers_stay_below_one() {
        assert!(to_unit(u32::MAX) < 1.0);
        assert_eq!(to_unit(u32::MAX), 1.0 - f32::EPSILON / 2.0);
        assert!((0..1000).map(uniform_hash).all(|u| (0.0..1.0).contains(&u)));
    }
}
