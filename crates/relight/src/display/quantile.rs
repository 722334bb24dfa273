//! Quantiles of many values at once on all cores: a sample says between which two values the one that is looked for lies, and of all
//! others it is enough to know how many are smaller \[Floyd1975\].

use rayon::prelude::*;

/// Items that one thread looks at in one go.
const RUN: usize = 1 << 14;
/// Keys that are made together, so that the compiler can use vector registers.
const LANES: usize = 64;
/// Values of which it is known how they are ordered.
const SAMPLES: usize = 1 << 12;
/// Places in the sample by which the bounds lie below and above: five standard deviations of the middle one of a random sample.
const MARGIN: usize = 160;

/// The value at place `round(q · (n − 1))`, counted from the smallest, q from 0 to 1, in the order of `f32::total_cmp`; 0 of none.
pub(super) fn quantile<T: Sync>(items: &[T], value_of: impl Fn(&T) -> f32 + Sync, q: f32) -> f32 {
    let Some(last) = items.len().checked_sub(1) else { return 0.0 };
    let place = ((q.clamp(0.0, 1.0) * last as f32).round() as usize).min(last);
    let key_of = |item: &T| key(value_of(item));
    let (mut n_below, mut between) = split(items, key_of, bounds(items, key_of, place));
    if !(n_below..n_below + between.len()).contains(&place) {
        // What is seldom led the sample astray.
        (n_below, between) = split(items, key_of, (0, u32::MAX));
    }
    value(*between.select_nth_unstable(place - n_below).1)
}

/// Keys between which the one of a place is likely to lie.
fn bounds<T>(items: &[T], key_of: impl Fn(&T) -> u32, place: usize) -> (u32, u32) {
    // Not a multiple of what a row has of pixels, or it would be few columns of the picture.
    let stride = (items.len() / SAMPLES) | 1;
    if stride == 1 {
        return (0, u32::MAX);
    }
    let mut sample: Vec<u32> = items.iter().step_by(stride).map(key_of).collect();
    sample.sort_unstable();
    let middle = place / stride;
    let below = middle.checked_sub(MARGIN).map_or(0, |i| sample[i]);
    (below, sample.get(middle + MARGIN).copied().unwrap_or(u32::MAX))
}

/// How many keys lie below two bounds, and those that lie between them or on one.
fn split<T: Sync>(items: &[T], key_of: impl Fn(&T) -> u32 + Sync, (low, high): (u32, u32)) -> (usize, Vec<u32>) {
    let look = |(mut n_below, mut between): (usize, Vec<u32>), run: &[T]| {
        let mut keys = [0; LANES];
        for items in run.chunks(LANES) {
            keys.iter_mut().zip(items).for_each(|(key, item)| *key = key_of(item));
            let keys = &keys[..items.len()];
            n_below += keys.iter().map(|key| u32::from(*key < low)).sum::<u32>() as usize;
            between.extend(keys.iter().filter(|key| (low..=high).contains(key)));
        }
        (n_below, between)
    };
    let join = |(n_a, mut a): (usize, Vec<u32>), (n_b, mut b): (usize, Vec<u32>)| {
        a.append(&mut b);
        (n_a + n_b, a)
    };
    let none = || (0, Vec::new());
    items.par_chunks(RUN).fold(none, look).reduce(none, join)
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
                assert_eq!(quantile(&values, |v| *v, q).to_bits(), sorted[place].to_bits(), "{q} of {n}");
            }
        }
        assert_eq!(quantile(&[], |v: &f32| *v, 0.5), 0.0);
    }

    #[test]
    fn a_sample_that_tells_nothing_costs_time_and_nothing_else() {
        // Every item of the sample is small, and all others are large.
        let n = 3 * SAMPLES;
        let values: Vec<f32> = (0..n).map(|i| if i % 3 == 0 { 1.0 } else { 2.0 + i as f32 }).collect();
        let (low, high) = bounds(&values, |v| key(*v), n / 2);
        assert_eq!((value(low), value(high)), (1.0, 1.0));
        assert_eq!(
            quantile(&values, |v| *v, 0.5),
            2.0 + (0..n).filter(|i| i % 3 != 0).nth(n / 2 - n / 3).unwrap() as f32
        );
        let flat = vec![7.0; 2 * n];
        assert_eq!(quantile(&flat, |v| *v, 0.3), 7.0);
    }
}
