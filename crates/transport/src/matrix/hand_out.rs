//! Adds the light of many walks to the rows of many pixels, with the vector instructions of the machine.
#![cfg_attr(
    target_arch = "x86_64",
    expect(unsafe_code, reason = "AVX2 behind run-time detection; `plain` is the safe twin with the same results")
)]

use std::ops::Range;

use super::CHANNELS;

/// Columns that are worked on at a time.
const WIDE: usize = 32;

/// Light of some walks, and who gets how much of it.
#[derive(Clone, Copy)]
pub(super) struct HandOut<'a> {
    /// Walk by walk, three rows of all columns.
    pub light: &'a [f32],
    /// Walk by walk, the share of each receiver in red, green and blue.
    pub shares: &'a [[f32; CHANNELS]],
    /// Whose rows: which three of the output.
    pub receivers: &'a [usize],
    pub n_cols: usize,
}

impl HandOut<'_> {
    /// Adds to the rows of `out`, three of all columns for each place.
    pub fn add_to(self, out: &mut [f32]) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: AVX2 was found.
            return unsafe { add_avx2(self, out) };
        }
        self.add_plain(out);
    }

    fn add_plain(self, out: &mut [f32]) {
        self.add_everything(out);
    }

    #[inline(always)]
    fn add_everything(self, out: &mut [f32]) {
        if self.receivers.is_empty() || self.shares.is_empty() {
            return;
        }
        let (wide, narrow) = (self.n_cols / WIDE * WIDE, self.n_cols / 8 * 8);
        let mut shares = Vec::new();
        for channel in 0..CHANNELS {
            self.gather_shares(channel, &mut shares);
            self.add_columns::<WIDE>((channel, 0..wide), &shares, out);
            self.add_columns::<8>((channel, wide..narrow), &shares, out);
            self.add_columns::<1>((channel, narrow..self.n_cols), &shares, out);
        }
    }

    /// The shares of a channel, receiver by receiver.
    #[inline(always)]
    fn gather_shares(self, channel: usize, shares: &mut Vec<f32>) {
        let n_receivers = self.receivers.len();
        let of_receiver = |number: usize| self.shares.iter().skip(number).step_by(n_receivers);
        shares.clear();
        shares.extend((0..n_receivers).flat_map(of_receiver).map(|share| share[channel]));
    }

    /// Columns whose number `N` divides: stretch by stretch, so that sums stay in registers. The light of a stretch is brought
    /// together first: rows of 1024 columns lie multiples of 4 KiB apart, which a cache holds few of.
    #[inline(always)]
    fn add_columns<const N: usize>(self, (channel, columns): (usize, Range<usize>), shares: &[f32], out: &mut [f32]) {
        let (row_len, n_walks) = (CHANNELS * self.n_cols, self.shares.len() / self.receivers.len());
        let mut stretch = Vec::with_capacity(n_walks);
        for first in columns.step_by(N).map(|column| channel * self.n_cols + column) {
            stretch.clear();
            let light = self
                .light
                .chunks_exact(row_len)
                .map(|light| *light[first..].first_chunk::<N>().expect("`N` divides the columns"));
            stretch.extend(light);
            for (place, shares) in self.receivers.iter().zip(shares.chunks_exact(n_walks)) {
                let mut sum = [0.0; N];
                for (light, share) in stretch.iter().zip(shares) {
                    for i in 0..N {
                        sum[i] += share * light[i];
                    }
                }
                let out = &mut out[place * row_len + first..][..N];
                out.iter_mut().zip(sum).for_each(|(out, sum)| *out += sum);
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn add_avx2(hand_out: HandOut<'_>, out: &mut [f32]) {
    hand_out.add_everything(out);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::uniform_hash;

    #[test]
    fn every_receiver_gets_its_share_of_every_walk_whatever_the_instructions() {
        for n_cols in [1, 7, 20, 64, 77] {
            let (n_walks, receivers, n_places) = (5, [2, 0, 3], 4);
            let numbers = |n: usize, key: u64| (0..n as u64).map(move |i| uniform_hash(key << 32 | i));
            let light: Vec<f32> = numbers(n_walks * CHANNELS * n_cols, 1).collect();
            let shares: Vec<[f32; CHANNELS]> =
                (0..n_walks * receivers.len()).map(|i| [0, 1, 2].map(|c| uniform_hash((i * 3 + c) as u64))).collect();
            let before: Vec<f32> = numbers(n_places * CHANNELS * n_cols, 2).collect();
            let hand_out = HandOut { light: &light, shares: &shares, receivers: &receivers, n_cols };
            let (mut plain, mut fast) = (before.clone(), before.clone());
            hand_out.add_plain(&mut plain);
            hand_out.add_to(&mut fast);
            assert_eq!(plain, fast, "{n_cols} columns");
            for (at, (after, before)) in plain.iter().zip(&before).enumerate() {
                let (place, of_place) = (at / (CHANNELS * n_cols), at % (CHANNELS * n_cols));
                let number = receivers.iter().position(|&receiver| receiver == place);
                let share =
                    |walk: usize| number.map_or(0.0, |n: usize| shares[walk * receivers.len() + n][of_place / n_cols]);
                let got: f32 = (0..n_walks).map(|walk| share(walk) * light[walk * CHANNELS * n_cols + of_place]).sum();
                assert!((after - before - got).abs() < 1e-5, "{n_cols} columns, entry {at}: {after} after {before}");
            }
        }
    }
}
