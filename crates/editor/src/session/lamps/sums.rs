//! The light of lamps, summed: what stands from one sum to the next is not summed again.

use std::collections::HashSet;

use rayon::prelude::*;

/// The light of a lamp as a sum takes it.
pub(super) struct Term<'a> {
    /// Lamp and number of passes: two terms that share them have the same light.
    pub of: (u64, u32),
    /// What of it counts, per channel.
    pub weight: [f32; 3],
    /// Per channel at each pixel.
    pub light: &'a [[f32; 3]],
}

/// A term by its light and the bits of its weight.
type Key = ((u64, u32), [u32; 3]);

impl Term<'_> {
    fn key(&self) -> Key {
        (self.of, self.weight.map(f32::to_bits))
    }

    fn add_to(&self, sum: &mut [[f32; 3]]) {
        let pixels = sum.par_iter_mut().zip(self.light.par_iter());
        pixels.for_each(|(sum, light)| (0..3).for_each(|c| sum[c] += self.weight[c] * light[c]));
    }
}

/// A sum that is asked for again and again while few of its terms change.
#[derive(Default)]
pub(super) struct Sums {
    /// Terms that were summed last.
    last: HashSet<Key>,
    /// Terms that stand.
    standing: HashSet<Key>,
    /// Their sum; empty without any.
    sum: Vec<[f32; 3]>,
}

impl Sums {
    /// The sum at so many pixels, the same number each time.
    pub fn of(&mut self, terms: &[Term<'_>], n_pixels: usize) -> Vec<[f32; 3]> {
        let keys: HashSet<Key> = terms.iter().map(Term::key).collect();
        // Nothing is taken out of a sum again: that would leave what rounding made of it.
        if !self.standing.is_subset(&keys) {
            (self.standing, self.sum) = (HashSet::new(), Vec::new());
        }
        // What is as it was last time is expected to stay so.
        for term in terms {
            if self.last.contains(&term.key()) && self.standing.insert(term.key()) {
                self.sum.resize(n_pixels, [0.0; 3]);
                term.add_to(&mut self.sum);
            }
        }
        let mut sum = if self.standing.is_empty() { vec![[0.0; 3]; n_pixels] } else { self.sum.clone() };
        let moved = terms.iter().filter(|term| !self.standing.contains(&term.key()));
        moved.for_each(|term| term.add_to(&mut sum));
        self.last = keys;
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const N_PIXELS: usize = 7;

    fn light(lamp: u64, pass: u32) -> Vec<[f32; 3]> {
        let value = |pixel: usize| 0.1 + (pixel as f32 * 1.3 + lamp as f32).sin().abs() * pass as f32;
        (0..N_PIXELS).map(|pixel| [value(pixel), value(pixel + 1), value(pixel + 2)]).collect()
    }

    /// Lamps as numbers, passes and weights, summed; without the light of those from `n_shown` on.
    fn summed(sums: &mut Sums, lamps: &[(u64, u32, f32)], n_shown: usize) -> Vec<[f32; 3]> {
        let lights: Vec<_> = lamps.iter().map(|(lamp, pass, _)| light(*lamp, *pass)).collect();
        let terms = lamps.iter().zip(&lights).enumerate().map(|(nth, ((lamp, pass, weight), light))| {
            let light = if nth < n_shown { light.as_slice() } else { &[] };
            Term { of: (*lamp, *pass), weight: [*weight, 0.5 * weight, 0.0], light }
        });
        sums.of(&terms.collect::<Vec<_>>(), N_PIXELS)
    }

    /// Whether it is what all lamps sum up to, one after the other.
    fn is_whole(sum: &[[f32; 3]], lamps: &[(u64, u32, f32)]) -> bool {
        let plain = summed(&mut Sums::default(), lamps, lamps.len());
        let mut pairs = sum.as_flattened().iter().zip(plain.as_flattened());
        sum.len() == N_PIXELS && pairs.all(|(a, b)| (a - b).abs() <= 1e-4 * (1.0 + b.abs()))
    }

    #[test]
    fn lamps_that_stand_are_not_summed_again_while_one_moves() {
        let with = |moving: (u64, u32, f32)| -> Vec<_> {
            std::iter::once(moving).chain((1..100u64).map(|lamp| (lamp, 3, 0.2 + lamp as f32))).collect()
        };
        let mut sums = Sums::default();
        for lamp in [200, 201] {
            let lamps = with((lamp, 1, 2.0));
            let sum = summed(&mut sums, &lamps, lamps.len());
            assert!(is_whole(&sum, &lamps));
        }
        for lamp in 202..210 {
            let lamps = with((lamp, 1, 2.0));
            let sum = summed(&mut sums, &lamps, 1);
            assert!(is_whole(&sum, &lamps), "of the others nothing is looked at");
        }
    }

    #[test]
    fn a_sum_is_that_of_its_terms_whatever_became_of_them() {
        let mut sums = Sums::default();
        let mut lamps = vec![(1, 1, 1.0), (2, 1, 1.0), (3, 1, 1.0)];
        for change in 0..8 {
            match change {
                2 => lamps[0].2 = 3.0,
                3 => lamps[1].1 = 2,
                4 => _ = lamps.remove(0),
                6 => lamps.push((1, 1, 1.0)),
                7 => lamps.clear(),
                _ => {}
            }
            let sum = summed(&mut sums, &lamps, lamps.len());
            assert!(is_whole(&sum, &lamps), "after change {change}");
        }
    }
}
