//! How the error of a block is spread over its columns.
//!
//! With L the left factor, D its noise and V the right factor, the halves A and B tell of column c that
//! `Σ a·b − v_cᵀ (LᵀL − DᵀD) v_c` is left out of it and that `v_cᵀ DᵀD v_c` of noise stays in it. Neither counts that noise has
//! turned the basis, nor what weights of a smoothing lose; so the error that was measured of the whole block is shared out in
//! proportion to their sum.

use crate::{dense::Dense, means::Means, product::product, unpacked::Unpacked};

/// Mean square error of each column, as [`BlockFactors::column_errors`](crate::BlockFactors::column_errors) has it.
pub(crate) fn column_errors(means: &Means, factors: &Unpacked) -> Vec<f32> {
    let n_cols = means.mean.n_cols;
    let (whole, noise) = (squares(&factors.left, &factors.right), squares(&factors.doubt, &factors.right));
    let mut shares = crossed(means);
    for (share, (whole, noise)) in shares.iter_mut().zip(whole.iter().zip(&noise)) {
        *share = (*share - (whole - noise)).max(0.0) + noise;
    }
    let sum: f64 = shares.iter().sum();
    let mean = (factors.error() + factors.packing) * factors.unit * factors.unit;
    let share_out = |share: f64| if sum > 0.0 { mean * n_cols as f64 * share / sum } else { mean };
    shares.into_iter().map(|share| share_out(share).clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32).collect()
}

/// Sum over each column of the product of the halves: its energy, free of the bias of noise.
fn crossed(means: &Means) -> Vec<f64> {
    let mut sums = vec![0.0; means.mean.n_cols];
    for row in 0..means.mean.n_rows {
        for (sum, (a, b)) in sums.iter_mut().zip(means.a.row(row).iter().zip(means.b.row(row))) {
            *sum += f64::from(a * b);
        }
    }
    sums
}

/// ‖left · right_c‖² of each column c.
fn squares(left: &Dense<f32>, right: &Dense<f32>) -> Vec<f64> {
    let mut sums = vec![0.0; right.n_cols];
    if left.n_cols == 0 {
        return sums;
    }
    let (left, right) = (left.to_f64(), right.to_f64());
    let along = product(product(left.t(), left.view()).view(), right.view());
    for r in 0..right.n_rows {
        for (sum, (x, y)) in sums.iter_mut().zip(right.row(r).iter().zip(along.row(r))) {
            *sum += x * y;
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use crate::{BlockSamples, ColumnGroup, CompressConfig, Tolerance, compress_block, random::Random};

    const N_ROWS: usize = 600;
    const N_COLS: usize = 12;

    /// A matrix of three components, whose columns have noise of their own in each half; and the truth.
    fn halves(noise: impl Fn(usize) -> f32) -> ([Vec<f32>; 2], Vec<f32>) {
        let mut rng = Random::new([31, 0]);
        let mut values = |n: usize| (0..n).map(|_| rng.normal()).collect::<Vec<f32>>();
        let (left, right) = (values(N_ROWS * 3), values(3 * N_COLS));
        let entry = |i: usize| (0..3).map(|r| left[i / N_COLS * 3 + r] * right[r * N_COLS + i % N_COLS]).sum::<f32>();
        let truth: Vec<f32> = (0..N_ROWS * N_COLS).map(entry).collect();
        let mut rng = Random::new([32, 0]);
        let mut half = || truth.iter().enumerate().map(|(i, x)| x + noise(i % N_COLS) * rng.normal()).collect();
        ([half(), half()], truth)
    }

    fn errors(noise: impl Fn(usize) -> f32, tolerance: Tolerance) -> (Vec<f32>, Vec<f64>, f32) {
        let ([a, b], truth) = halves(noise);
        let samples =
            BlockSamples { halves: [&a, &b], sparse: [&[], &[]], n_cols: N_COLS, bundle_len: 1, n_samples: [1; 2] };
        let group = ColumnGroup { columns: 0..N_COLS, tolerance, preserved: Vec::new(), share: 1.0, apart: 0.0 };
        let config = CompressConfig { groups: vec![group], ..CompressConfig::default() };
        let block = compress_block(&samples, &config, 0).unwrap().remove(0);
        let mut found = vec![0.0; N_COLS];
        for (i, (x, y)) in block.dense().iter().zip(&truth).enumerate() {
            found[i % N_COLS] += f64::from(x - y).powi(2) / N_ROWS as f64;
        }
        (block.column_errors, found, block.error.truncation + block.error.sampling)
    }

    #[test]
    fn each_column_is_told_the_error_that_it_has() {
        // One column is far noisier than the others; then the rank leaves something out.
        let noises: [&dyn Fn(usize) -> f32; 2] = [&|col| if col == 7 { 2.0 } else { 0.1 }, &|_| 0.1];
        for (noise, tolerance) in noises.into_iter().zip([Tolerance::AbsoluteMeanSquare(1e-4), Tolerance::Rank(2)]) {
            let (told, found, total) = errors(noise, tolerance);
            let worst = |errors: &[f64]| (0..N_COLS).max_by(|&a, &b| errors[a].total_cmp(&errors[b]));
            assert_eq!(worst(&told.iter().map(|x| f64::from(*x)).collect::<Vec<_>>()), worst(&found));
            assert!((told.iter().sum::<f32>() / N_COLS as f32 / total - 1.0).abs() < 1e-4, "{told:?} in all {total}");
            for (col, (told, found)) in told.iter().zip(&found).enumerate() {
                let ratio = f64::from(*told) / found;
                assert!((0.25..4.0).contains(&ratio), "column {col}: {told} told, {found} found");
            }
        }
    }
}
