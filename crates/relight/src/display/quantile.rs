//! Quantiles of many values at once on all cores: counted by their leading bits, then those with the right ones by the rest.

use rayon::prelude::*;

/// Values that one thread counts at a time.
const RUN: usize = 1 << 15;
/// Bits of the first and of the second count; what is left is sorted.
const BITS: [u32; 2] = [11, 11];

/// The value at place `round(q · (n − 1))`, counted from the smallest, q from 0 to 1, in the order of `f32::total_cmp`; 0 of none.
pub(super) fn quantile(values: &[f32], q: f32) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let mut place = (q.clamp(0.0, 1.0) * (values.len() - 1) as f32).round() as usize;
    place = place.min(values.len() - 1);

    // All values share the leading bits of the one that is looked for, which are found a digit at a time.
    let (mut known, mut n_known) = (0u32, 0);
    for n_bits in BITS {
        let shift = 32 - n_known - n_bits;
        let counts = count(values, |key| {
            let is_known = n_known == 0 || key >> (32 - n_known) == known;
            is_known.then_some((key >> shift) as usize & ((1 << n_bits) - 1))
        });
        let mut digit = 0;
        while place >= counts[digit] {
            place -= counts[digit];
            digit += 1;
        }
        (known, n_known) = (known << n_bits | digit as u32, n_known + n_bits);
    }
    let runs = values.par_chunks(RUN);
    let left = runs.flat_map_iter(|run| run.iter().map(|v| key(*v)).filter(|key| key >> (32 - n_known) == known));
    let mut left: Vec<u32> = left.collect();
    let (_, found, _) = left.select_nth_unstable(place);
    value(*found)
}

/// How many values have each digit.
fn count(values: &[f32], digit: impl Fn(u32) -> Option<usize> + Sync) -> Vec<usize> {
    let none = || vec![0usize; 1 << BITS[0]];
    let count = |mut counts: Vec<usize>, run: &[f32]| {
        run.iter().filter_map(|v| digit(key(*v))).for_each(|digit| counts[digit] += 1);
        counts
    };
    let sum = |mut a: Vec<usize>, b: Vec<usize>| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        a
    };
    values.par_chunks(RUN).fold(none, count).reduce(none, sum)
}

/// An integer that orders as the value does.
fn key(value: f32) -> u32 {
    let bits = value.to_bits();
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

fn value(key: u32) -> f32 {
    f32::from_bits(if key >> 31 == 1 { key & !(1 << 31) } else { !key })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::Random;

    #[test]
    fn a_quantile_is_the_value_at_its_place() {
        let mut random = Random(3);
        for n in [1, 2, 3, 1000, 100_001] {
            let mut values: Vec<f32> = (0..n).map(|_| random.signed() * (20.0 * random.signed()).exp2()).collect();
            values.extend([0.0, -0.0, 1.0, 1.0, 1.0 + f32::EPSILON]);
            let mut sorted = values.clone();
            sorted.sort_by(f32::total_cmp);
            for q in [0.0, 0.001, 0.25, 0.5, 0.9, 0.995, 1.0] {
                let place = (q * (sorted.len() - 1) as f32).round() as usize;
                assert_eq!(quantile(&values, q).to_bits(), sorted[place].to_bits(), "{q} of {n}");
            }
        }
        assert_eq!(quantile(&[], 0.5), 0.0);
    }
}
