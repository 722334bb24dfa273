//! Laws of adaptive sampling: when to stop may depend on what was sampled, the result's expectation must not.

use std::{
    ops::{ControlFlow, Range},
    sync::atomic::{AtomicUsize, Ordering},
};

use crate::{random::Random, *};

/// Chance of a large sample.
const CHANCE: f64 = 1.0 / 64.0;
/// Columns that large samples reach, and the one in which they are kept as sparse entries.
const N_REACHED: usize = 3;

/// Smooth, but for large samples that are rare and bring 1 to every entry in the mean.
struct RareLarge {
    n_rows: usize,
    seed: u64,
    /// Whether it tells that its rows are independent, which they are.
    independent: bool,
}

impl RareLarge {
    fn smooth(row: usize, col: usize) -> f32 {
        0.5 + 0.125 * (row % 4 * col) as f32
    }
}

impl SampledMatrix for RareLarge {
    fn n_rows(&self) -> usize {
        self.n_rows
    }
    fn n_cols(&self) -> usize {
        N_REACHED + 1
    }
    fn bundle_len(&self) -> usize {
        1
    }
    fn colors_are_independent(&self, _bundles: &[u32]) -> bool {
        self.independent
    }
    fn add_rows(
        &self,
        bundles: &[u32],
        samples: Range<u32>,
        half: Half,
        out: &mut [f32],
        sparse: &mut Vec<SparseEntry>,
    ) {
        for (place, (&row, out)) in bundles.iter().zip(out.chunks_mut(N_REACHED + 1)).enumerate() {
            for sample in samples.clone() {
                let key = [u64::from(row) * 2 + u64::from(half == Half::B), u64::from(sample) + (self.seed << 32)];
                let large = if Random::new(key).unit() < CHANCE { 1.0 / CHANCE as f32 } else { 0.0 };
                for (col, out) in out[..N_REACHED].iter_mut().enumerate() {
                    *out += Self::smooth(row as usize, col) + large;
                }
                if large > 0.0 {
                    sparse.push(SparseEntry { row: place as u32, col: N_REACHED as u32, value: large });
                }
            }
        }
    }
}

#[test]
fn rare_large_samples_are_worth_as_much_whenever_sampling_stops() {
    let [absolute, relative] = [Tolerance::AbsoluteMeanSquare(0.05), Tolerance::RelativeFrobenius(0.1)];
    let cases = [(absolute, false), (relative, false), (absolute, true), (relative, true)];
    for (seed, (tolerance, independent)) in cases.into_iter().enumerate() {
        let plan = SamplePlan { batch: 8, min: if independent { 1 } else { 2 }, max: 64 };
        // Three thousand blocks of four rows.
        let matrix = RareLarge { n_rows: 12000, seed: seed as u64, independent };
        let partition = Partition { width: 12000, height: 1, tile: 4 };
        let blocks: Vec<u32> = (0..partition.n_blocks() as u32).collect();
        let group = ColumnGroup {
            columns: 0..N_REACHED + 1,
            tolerance,
            preserved: vec![1.0; N_REACHED + 1],
            share: 1.0,
            apart: 0.0,
        };
        let config = CompressConfig { groups: vec![group], samples: plan, ..CompressConfig::default() };
        let (mut low_rank, mut sparse, mut n_samples, mut n_parted) = (0.0, 0.0, 0.0, 0);
        let flow = compress(&matrix, &partition, &blocks, &config, |_, mut factors| {
            let mut factors = factors.remove(0);
            sparse += factors.sparse.drain(..).map(|entry| f64::from(entry.value)).sum::<f64>();
            // The preserved product: what was sampled, whatever the rank.
            low_rank += factors.apply(&[1.0; N_REACHED + 1]).iter().map(|&x| f64::from(x)).sum::<f64>();
            n_samples += f64::from(factors.n_samples) / blocks.len() as f64;
            // Two rows of two samples and two of more.
            n_parted += usize::from(factors.n_samples == 3);
            ControlFlow::Continue(())
        });
        assert_eq!(flow, Ok(ControlFlow::Continue(())));
        let smooth = |row| (0..N_REACHED).map(|col| f64::from(RareLarge::smooth(row, col))).sum::<f64>();
        let smooth: f64 = (0..matrix.n_rows).map(smooth).sum();
        let per_row = 1.0 / matrix.n_rows as f64;
        let [reached, sparse] = [(low_rank - smooth) * per_row / N_REACHED as f64, sparse * per_row];
        // The variance of one sample, over the least number of samples of both halves.
        let deviation = ((1.0 / CHANCE - 1.0) * per_row / f64::from(2 * plan.min)).sqrt();
        println!(
            "{tolerance:?}: large samples bring {reached:.3}, sparse ones {sparse:.3} ± {deviation:.3}, bias of the mean {:+.1} %, {n_samples:.1} samples",
            100.0 * (reached - 1.0) / (1.0 + smooth * per_row / N_REACHED as f64)
        );
        assert_eq!(n_parted > 0, independent, "{tolerance:?}: {n_parted} blocks have rows of both kinds");
        assert!(n_samples < 0.9 * f64::from(2 * plan.max), "{tolerance:?} stops nowhere");
        assert!((reached - 1.0).abs() < 4.0 * deviation, "{tolerance:?}: {reached} for 1 ± {deviation}");
        assert!((sparse - 1.0).abs() < 4.0 * deviation, "{tolerance:?}: sparse {sparse} for 1 ± {deviation}");
    }
}

/// All 1, but for columns 2 and 3 in the noisy half. Column 4 is sparse: the number of the sample in the noisy half, counted
/// from 1, and 10 in the quiet one.
struct OneSided {
    noisy: Half,
    sampled: [AtomicUsize; 2],
}

impl SampledMatrix for OneSided {
    fn n_rows(&self) -> usize {
        32
    }
    fn n_cols(&self) -> usize {
        5
    }
    fn bundle_len(&self) -> usize {
        2
    }
    fn add_rows(
        &self,
        bundles: &[u32],
        samples: Range<u32>,
        half: Half,
        out: &mut [f32],
        sparse: &mut Vec<SparseEntry>,
    ) {
        let noisy = half == self.noisy;
        self.sampled[usize::from(noisy)].fetch_add(samples.len(), Ordering::Relaxed);
        for sample in samples {
            for (row, out) in out.chunks_mut(5).enumerate() {
                let key = u64::from(bundles[row / 2]) * 2 + row as u64 % 2;
                let mut rng = Random::new([key, u64::from(sample)]);
                out[..2].iter_mut().for_each(|x| *x += 1.0);
                out[2..4].iter_mut().for_each(|x| *x += if noisy { 4.0 * rng.normal() } else { 1.0 });
                let value = if noisy { 1.0 + sample as f32 } else { 10.0 };
                sparse.push(SparseEntry { row: row as u32, col: 4, value });
            }
        }
    }
}

fn one_sided(noisy: Half, samples: SamplePlan) -> (Vec<BlockFactors>, [usize; 2]) {
    let matrix = OneSided { noisy, sampled: Default::default() };
    let group = |columns: Range<usize>| {
        let preserved = vec![1.0; columns.len()];
        ColumnGroup { columns, tolerance: Tolerance::AbsoluteMeanSquare(1e-3), preserved, share: 1.0, apart: 0.0 }
    };
    let config = CompressConfig { groups: vec![group(0..2), group(2..5)], samples, ..CompressConfig::default() };
    let mut found = Vec::new();
    let flow = compress(&matrix, &Partition { width: 4, height: 4, tile: 4 }, &[0], &config, |_, factors| {
        found = factors;
        ControlFlow::Continue(())
    });
    assert_eq!(flow, Ok(ControlFlow::Continue(())));
    (found, matrix.sampled.map(AtomicUsize::into_inner))
}

#[test]
fn a_noisy_half_sends_the_other_one_on_and_stops_itself() {
    for noisy in [Half::A, Half::B] {
        let (factors, sampled) = one_sided(noisy, SamplePlan { batch: 3, min: 2, max: 32 });
        // The quiet half counts with all samples, the noisy one with the first two; it has to be asked until 16.
        assert_eq!((factors[0].n_samples, factors[1].n_samples, sampled), (34, 34, [32, 16]));
        // The mean of 1 and 2 in one half, 10 in the other.
        assert_eq!(factors[1].sparse.len(), 32);
        assert!(factors[1].sparse.iter().all(|entry| entry.value == 5.75), "{:?}", factors[1].sparse);
        let (got, mut first_two) = (factors[1].apply(&[1.0; 3]), vec![0.0; 32 * 5]);
        let matrix = OneSided { noisy, sampled: Default::default() };
        let bundles: Vec<u32> = (0..16).collect();
        matrix.add_rows(&bundles, 0..2, noisy, &mut first_two, &mut Vec::new());
        for (row, got) in got.iter().enumerate() {
            let noise = &first_two[row * 5 + 2..row * 5 + 4];
            let want = 0.5 * (0.5 * (noise[0] + noise[1]) + 2.0) + 5.75;
            assert!((got - want).abs() < 0.02, "row {row}: {got} for {want}");
        }
    }
}

#[test]
fn a_single_sample_says_nothing_of_its_noise() {
    let [one, two] = [1, 2].map(|max| one_sided(Half::A, SamplePlan { batch: 1, min: 1, max }));
    assert_eq!([one.1, two.1], [[1, 1], [2, 2]]);
    assert_eq!([one.0[0].n_samples, two.0[0].n_samples], [2, 4]);
    let quiet = one_sided(Half::A, SamplePlan { batch: 1, min: 1, max: 8 });
    // The quiet half stops the noisy one as soon as it has two samples of its own.
    assert_eq!((quiet.0[0].n_samples, quiet.1), (10, [8, 4]));
}

/// All 1; bundles of one color have noise. Column 2 is sparse: the number of the sample, from some sample on.
struct Chessboard {
    first_sparse: u32,
}

impl SampledMatrix for Chessboard {
    fn n_rows(&self) -> usize {
        48
    }
    fn n_cols(&self) -> usize {
        3
    }
    fn bundle_len(&self) -> usize {
        2
    }
    fn colors_are_independent(&self, _bundles: &[u32]) -> bool {
        true
    }
    fn add_rows(
        &self,
        bundles: &[u32],
        samples: Range<u32>,
        half: Half,
        out: &mut [f32],
        sparse: &mut Vec<SparseEntry>,
    ) {
        for sample in samples {
            for (row, out) in out.chunks_mut(3).enumerate() {
                let bundle = bundles[row / 2];
                let is_noisy = (bundle % 6 + bundle / 6) % 2 == 1;
                let key = u64::from(bundle) * 4 + row as u64 % 2 * 2 + u64::from(half == Half::B);
                let noise = if is_noisy { 4.0 * Random::new([key, u64::from(sample)]).normal() } else { 0.0 };
                out[..2].iter_mut().for_each(|x| *x += 1.0 + noise);
                if sample >= self.first_sparse {
                    sparse.push(SparseEntry { row: row as u32, col: 2, value: sample as f32 });
                }
            }
        }
    }
}

fn of_chessboard(matrix: &Chessboard) -> BlockFactors {
    let group = ColumnGroup {
        columns: 0..3,
        tolerance: Tolerance::AbsoluteMeanSquare(1e-3),
        preserved: vec![1.0; 3],
        share: 1.0,
        apart: 0.0,
    };
    let samples = SamplePlan { batch: 3, min: 1, max: 8 };
    let config = CompressConfig { groups: vec![group], samples, ..CompressConfig::default() };
    let mut found = Vec::new();
    let partition = Partition { width: 6, height: 4, tile: 6 };
    let flow = compress(matrix, &partition, &[0], &config, |_, mut factors| {
        found.push(factors.remove(0));
        ControlFlow::Continue(())
    });
    assert_eq!(flow, Ok(ControlFlow::Continue(())));
    found.remove(0)
}

#[test]
fn a_quiet_color_ends_the_other_one_after_a_sample_and_goes_on_itself() {
    let matrix = Chessboard { first_sparse: 1 };
    let bundles: Vec<u32> = (0..24).collect();
    let mut once = vec![0.0; 48 * 3];
    for half in [Half::A, Half::B] {
        matrix.add_rows(&bundles, 0..1, half, &mut once, &mut Vec::new());
    }
    let factors = of_chessboard(&matrix);
    // Half of the bundles have a sample of each half, half of them two.
    assert_eq!(factors.n_samples, 3);
    let mut sparse = [0.0; 48];
    factors.sparse.iter().for_each(|entry| sparse[entry.row as usize] += entry.value);
    for (row, got) in factors.apply(&[1.0; 3]).into_iter().enumerate() {
        let is_noisy = (row / 2 % 6 + row / 12) % 2 == 1;
        assert_eq!(sparse[row], if is_noisy { 0.0 } else { 0.5 }, "row {row}");
        let want = 0.5 * (once[row * 3] + once[row * 3 + 1]) + sparse[row];
        assert!((got - want).abs() < 0.02, "row {row}: {got} for {want}");
    }
}

#[test]
fn a_block_with_sparse_entries_is_not_done_after_one_sample() {
    // The quiet color after two samples of each half, the noisy one after all eight.
    assert_eq!(of_chessboard(&Chessboard { first_sparse: 0 }).n_samples, (4 + 16) / 2);
}

/// All 1, but for an entry of one row that is no number; colors tell each other.
struct OddRow(usize);

impl SampledMatrix for OddRow {
    fn n_rows(&self) -> usize {
        400
    }
    fn n_cols(&self) -> usize {
        3
    }
    fn bundle_len(&self) -> usize {
        2
    }
    fn colors_are_independent(&self, _bundles: &[u32]) -> bool {
        true
    }
    fn add_rows(&self, bundles: &[u32], samples: Range<u32>, _: Half, out: &mut [f32], _sparse: &mut Vec<SparseEntry>) {
        for (row, out) in out.chunks_mut(3).enumerate() {
            out.iter_mut().for_each(|x| *x += samples.len() as f32);
            if bundles[row / 2] as usize * 2 + row % 2 == self.0 {
                out[1] = f32::NAN;
            }
        }
    }
}

/// Of a hundred bundles of a color every other one is asked how noisy it is.
#[test]
fn an_odd_row_has_the_number_that_it_has_in_the_block_whatever_its_color() {
    let group =
        ColumnGroup { columns: 0..3, tolerance: Tolerance::Rank(2), preserved: Vec::new(), share: 1.0, apart: 0.0 };
    let samples = SamplePlan { batch: 1, min: 1, max: 4 };
    let config = CompressConfig { groups: vec![group], samples, ..CompressConfig::default() };
    let partition = Partition { width: 20, height: 10, tile: 20 };
    for row in [0, 1, 2, 5, 8, 43, 46, 211, 398, 399] {
        let found = compress(&OddRow(row), &partition, &[0], &config, |_, _| ControlFlow::Continue(()));
        assert_eq!(found, Err(CompressError::NonFinite { block: 0, row: row as u32, col: 1 }));
    }
}

#[test]
fn who_leaves_in_the_middle_of_a_block_is_not_sampled_for() {
    let matrix = OneSided { noisy: Half::A, sampled: Default::default() };
    let taken = || matrix.sampled.iter().map(|n| n.load(Ordering::Relaxed)).sum::<usize>();
    let group =
        ColumnGroup { columns: 0..2, tolerance: Tolerance::Rank(2), preserved: Vec::new(), share: 1.0, apart: 0.0 };
    let samples = SamplePlan { batch: 1, min: 1 << 12, max: 1 << 12 };
    let config = CompressConfig { groups: vec![group], samples, ..CompressConfig::default() };
    let guide = Guide { goes_on: &|| taken() < 8, ..Guide::default() };
    let partition = Partition { width: 4, height: 4, tile: 4 };
    let flow = compress_by(guide, &matrix, &partition, &[0], &config, |_, _| panic!("nobody wants the block"));
    assert_eq!((flow, taken()), (Ok(ControlFlow::Break(())), 8));
}

/// Columns of [`OneNoisy`], and the one that has noise.
const N_COLS: usize = 256;
const NOISY: usize = 7;

/// All 1; one column of many has noise.
struct OneNoisy;

impl SampledMatrix for OneNoisy {
    fn n_rows(&self) -> usize {
        32
    }
    fn n_cols(&self) -> usize {
        N_COLS
    }
    fn bundle_len(&self) -> usize {
        1
    }
    fn add_rows(
        &self,
        bundles: &[u32],
        samples: Range<u32>,
        half: Half,
        out: &mut [f32],
        _sparse: &mut Vec<SparseEntry>,
    ) {
        for sample in samples {
            for (&bundle, out) in bundles.iter().zip(out.chunks_mut(N_COLS)) {
                let key = u64::from(bundle) * 2 + u64::from(half == Half::B);
                out.iter_mut().for_each(|x| *x += 1.0);
                out[NOISY] += Random::new([key, u64::from(sample)]).normal();
            }
        }
    }
}

#[test]
fn a_noisy_column_that_is_all_of_a_product_does_not_hide_among_quiet_ones() {
    fn n_samples(weight: impl Fn(usize) -> f32) -> u32 {
        let group = ColumnGroup {
            columns: 0..N_COLS,
            tolerance: Tolerance::AbsoluteMeanSquare(2e-3),
            preserved: (0..N_COLS).map(weight).collect(),
            share: 1.0,
            apart: 0.0,
        };
        let samples = SamplePlan { batch: 8, min: 4, max: 64 };
        let config = CompressConfig { groups: vec![group], samples, ..CompressConfig::default() };
        let mut found = 0;
        let flow = compress(&OneNoisy, &Partition { width: 32, height: 1, tile: 32 }, &[0], &config, |_, factors| {
            found = factors[0].n_samples;
            ControlFlow::Continue(())
        });
        assert_eq!(flow, Ok(ControlFlow::Continue(())));
        found
    }
    assert_eq!(n_samples(|_| 1.0), 8, "it is little beside all the others");
    // It takes 250 samples of each half.
    assert_eq!(n_samples(|col| f32::from(u8::from(col == NOISY))), 128, "it is all there is");
}
