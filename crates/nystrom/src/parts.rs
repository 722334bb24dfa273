//! The parts of a block, each sampled for as long as it takes: all bundles together, or in two colors.
//!
//! A half with a single sample does not know how noisy it is. But where the colors have noise of their own, bundles on the white
//! squares of a chessboard tell how noisy those on the black ones are: what the halves differ by in the one color decides whether
//! the *other* one goes on. So most of a block may be done with one sample of each half, and how many samples a row has still
//! knows nothing of the values that they have. From then on each color is by itself, for the same reason.

use crate::{
    matrix::{SampledMatrix, SparseEntry},
    partition::Partition,
    sums::Sums,
};

/// Bundles of a color that are asked how noisy it is, at most: where colors are told apart, no bundle's noise is rare and great.
const MOST_ASKED: usize = 64;

/// Bundles of a block that get as many samples.
#[derive(Default)]
pub(crate) struct Part {
    /// Places of the bundles in the block.
    places: Vec<usize>,
    pub(crate) bundles: Vec<u32>,
    pub(crate) halves: [Sums; 2],
    /// The sums that count of a half that was closed before the other one.
    pub(crate) kept: Vec<f32>,
    is_color: bool,
}

/// Whether the bundles of a block can be told apart in two colors before a half knows itself how noisy it is.
pub(crate) fn has_colors<M: SampledMatrix>(matrix: &M, bundles: &[u32]) -> bool {
    bundles.len() > 1 && matrix.colors_are_independent(bundles)
}

/// Begins a block: all bundles in the first part, or each color in one.
pub(crate) fn start(
    parts: &mut [Part],
    (partition, block_idx): (&Partition, u32),
    bundles: &[u32],
    bundle_size: usize,
) {
    let width = partition.rect(block_idx as usize)[2] as usize;
    let n_parts = parts.len();
    for (color, part) in parts.iter_mut().enumerate() {
        part.is_color = n_parts > 1;
        part.places.clear();
        part.places.extend((0..bundles.len()).filter(|place| (place % width + place / width) % n_parts == color));
        part.bundles.clear();
        part.bundles.extend(part.places.iter().map(|&place| bundles[place]));
        let n_entries = part.places.len() * bundle_size;
        part.halves.iter_mut().for_each(|sums| sums.start(n_entries));
    }
}

/// The samples of a whole block that count.
pub(crate) struct Counted<'a> {
    /// Sums of both halves.
    pub(crate) halves: [&'a [f32]; 2],
    pub(crate) sparse: [&'a [SparseEntry]; 2],
    /// What sums of each half are to be divided by.
    pub(crate) n_samples: [u32; 2],
    /// Samples of both halves that a bundle has in the mean.
    pub(crate) mean_samples: u32,
}

/// Buffers to bring parts together.
#[derive(Default)]
pub(crate) struct Together {
    halves: [Vec<f32>; 2],
    sparse: [Vec<SparseEntry>; 2],
}

impl Part {
    /// The rows of the bundles that are asked how noisy all are: all, or some of a color, evenly spread, which `some` takes.
    pub(crate) fn asked<'a>(&self, rows: &'a [f32], bundle_size: usize, some: &'a mut Vec<f32>) -> &'a [f32] {
        let bundles = rows.chunks_exact(bundle_size);
        let step = self.step(bundles.len());
        if step == 1 {
            return rows;
        }
        some.clear();
        bundles.step_by(step).for_each(|bundle| some.extend_from_slice(bundle));
        some
    }

    /// Which row of the block a row of those is that are [asked](Self::asked).
    pub(crate) fn row_of_block(&self, row: usize, bundle_len: usize) -> usize {
        let place = self.places[row / bundle_len * self.step(self.places.len())];
        place * bundle_len + row % bundle_len
    }

    /// From one bundle that is asked to the next.
    fn step(&self, n_bundles: usize) -> usize {
        if self.is_color { n_bundles.div_ceil(MOST_ASKED).max(1) } else { 1 }
    }

    fn counted(&self, half: usize) -> (&[f32], u32) {
        self.halves[half].counted(&self.kept)
    }

    /// After a [`Sums::join`] of both halves, where this part is the block.
    pub(crate) fn whole(&self) -> Counted<'_> {
        let [(a, n_a), (b, n_b)] = [self.counted(0), self.counted(1)];
        let sparse = self.halves.each_ref().map(Sums::sparse);
        Counted { halves: [a, b], sparse, n_samples: [n_a, n_b], mean_samples: n_a + n_b }
    }
}

impl Together {
    /// After a [`Sums::join`] of all halves: both parts, as if each had as many samples as the one that has more.
    pub(crate) fn bring(&mut self, parts: &[Part], (bundle_len, bundle_size): (usize, usize)) -> Counted<'_> {
        let n_bundles: usize = parts.iter().map(|part| part.places.len()).sum();
        let n_samples = [0, 1].map(|half| parts.iter().map(|part| part.counted(half).1).max().unwrap_or(0));
        let mut taken = 0;
        for half in [0, 1] {
            let (rows, entries) = (&mut self.halves[half], &mut self.sparse[half]);
            rows.resize(n_bundles * bundle_size, 0.0);
            entries.clear();
            for part in parts {
                let (sums, n) = part.counted(half);
                taken += part.places.len() as u64 * u64::from(n);
                let times = n_samples[half] as f32 / n as f32;
                for (&place, sums) in part.places.iter().zip(sums.chunks_exact(bundle_size)) {
                    let out = rows[place * bundle_size..][..bundle_size].iter_mut();
                    out.zip(sums).for_each(|(out, sum)| *out = times * sum);
                }
                entries.extend(part.halves[half].sparse().iter().map(|entry| {
                    let (place, row) = (part.places[entry.row as usize / bundle_len], entry.row as usize % bundle_len);
                    SparseEntry { row: (place * bundle_len + row) as u32, value: times * entry.value, ..*entry }
                }));
            }
        }
        let mean_samples = (taken as f64 / n_bundles as f64).round() as u32;
        let (halves, sparse) = (self.halves.each_ref().map(Vec::as_slice), self.sparse.each_ref().map(Vec::as_slice));
        Counted { halves, sparse, n_samples, mean_samples }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_take_turns_across_and_down() {
        let partition = Partition { width: 5, height: 4, tile: 3 };
        let places = |block_idx| {
            let (mut parts, mut bundles) = ([Part::default(), Part::default()], Vec::new());
            partition.bundles(block_idx as usize, &mut bundles);
            start(&mut parts, (&partition, block_idx), &bundles, 2);
            parts.map(|part| part.places)
        };
        assert_eq!(places(0), [vec![0, 2, 4, 6, 8], vec![1, 3, 5, 7]]);
        // The last one is two across and one down.
        assert_eq!(places(3), [vec![0], vec![1]]);
    }

    #[test]
    fn few_bundles_are_asked_and_they_are_spread_evenly() {
        let rows: Vec<f32> = (0..800).map(|i| i as f32).collect();
        let color = Part { is_color: true, ..Part::default() };
        let mut some = Vec::new();
        let asked = color.asked(&rows, 2, &mut some);
        assert_eq!((asked.len(), &asked[..4]), (116, &[0.0, 1.0, 14.0, 15.0][..]));
        assert_eq!(color.asked(&rows[..20], 2, &mut some), &rows[..20]);
        assert_eq!(Part::default().asked(&rows, 2, &mut some), rows);
    }
}
