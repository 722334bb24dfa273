//! What factors would take if each of their vectors had a scale of its own and as few bits as its block's error permits, as
//! decision 0010 has it.
//!
//! `cargo run --release -p clerestory-transport --example few_bits -- FILE.transport…`
#![expect(clippy::print_stdout, reason = "a program for people")]

use std::path::Path;

use clerestory_nystrom::BlockFactors;
use clerestory_transport::archive;
use rayon::prelude::*;

/// Shares of a block's own error that rounding may add.
const SHARES: [f64; 2] = [1.0 / 32.0, 1.0 / 16.0];
/// Bits of a vector: any, or those that lie in words without a seam.
const WIDTHS: [&[u32]; 3] = [&[4, 5, 6, 7, 8, 9, 10, 11, 12], &[4, 8, 12], &[8]];
/// Bits of a vector that needs more.
const HALF: u32 = 16;

/// Mean square of the rounding of both factors to halves, relative to what they multiply to.
const HALVES: f64 = 7e-8;

/// Bytes and errors, summed over blocks.
#[derive(Clone, Copy, Default)]
struct Sum {
    /// Left, right.
    half_bytes: [f64; 2],
    few_bytes: [f64; 2],
    /// Squared errors over all entries.
    own: f64,
    added: f64,
}

impl Sum {
    fn plus(mut self, other: Self) -> Self {
        for side in 0..2 {
            self.half_bytes[side] += other.half_bytes[side];
            self.few_bytes[side] += other.few_bytes[side];
        }
        (self.own, self.added) = (self.own + other.own, self.added + other.added);
        self
    }
}

fn main() -> Result<(), archive::ArchiveError> {
    println!("| file | MB in it | may add | bits | halves: left + right, MB | few bits | ratio | error grows by |");
    println!("|---|---|---|---|---|---|---|---|");
    for path in std::env::args().skip(1) {
        let bake = archive::read(Path::new(&path))?;
        let in_file = bake.figures().file_bytes.unwrap_or(0) as f64 / 1e6;
        let blocks: Vec<_> = bake.groups.iter().flat_map(|group| group.blocks.iter().flatten()).collect();
        for share in SHARES {
            for widths in WIDTHS {
                let of_block = |block: &&std::sync::Arc<BlockFactors>| few_bits(block, share, widths);
                let sum = blocks.par_iter().map(of_block).reduce(Sum::default, Sum::plus);
                let mega = |bytes: [f64; 2]| format!("{:.2} + {:.2}", bytes[0] / 1e6, bytes[1] / 1e6);
                let ratio = sum.half_bytes.iter().sum::<f64>() / sum.few_bytes.iter().sum::<f64>();
                let grows = 10.0 * ((sum.own + sum.added) / sum.own).log10();
                println!(
                    "| {path} | {in_file:.2} | 1/{:.0} | {widths:?} | {} | {} | {ratio:.2} | {grows:.2} dB |",
                    1.0 / share,
                    mega(sum.half_bytes),
                    mega(sum.few_bytes),
                );
            }
        }
    }
    println!("\n| file | asked for, dB | halves add, below all of its error, dB | below that of the worst block, dB |");
    println!("|---|---|---|---|");
    for path in std::env::args().skip(1) {
        let bake = archive::read(Path::new(&path))?;
        let blocks: Vec<_> = bake.groups.iter().flat_map(|group| group.blocks.iter().flatten()).collect();
        let errors: Vec<[f64; 2]> = blocks.par_iter().map(|block| halves(block)).collect();
        let below = |[added, own]: [f64; 2]| 10.0 * (own / added).log10();
        let all = errors.iter().fold([0.0; 2], |sum, error| [sum[0] + error[0], sum[1] + error[1]]);
        let worst =
            errors.iter().filter(|[added, _]| *added > 0.0).map(|error| below(*error)).fold(f64::INFINITY, f64::min);
        println!("| {path} | {} | {:.1} | {worst:.1} |", bake.header.config.tolerance_db, below(all));
    }
    Ok(())
}

/// Squared errors over all entries of a block: what halves add, and what is measured, their share included.
fn halves(block: &BlockFactors) -> [f64; 2] {
    let (rank, n_cols) = (block.rank as usize, block.n_cols as usize);
    let kept = |k: usize| {
        let left =
            mean_square(block.left.iter().skip(k).step_by(rank).map(|x| x.to_f64()).collect::<Vec<_>>().into_iter());
        let right = mean_square(block.right[k * n_cols..][..n_cols].iter().map(|x| x.to_f64()));
        f64::from(block.scale[k]).powi(2) * left * right
    };
    let own = f64::from(block.error.truncation.max(0.0) + block.error.sampling.max(0.0));
    let n_entries = f64::from(block.n_rows) * n_cols as f64;
    [HALVES * (0..rank).map(kept).sum::<f64>(), own].map(|mean| mean * n_entries)
}

/// Every vector of a block gets the fewest bits with which it adds no more than its part.
fn few_bits(block: &BlockFactors, share: f64, widths: &[u32]) -> Sum {
    let (rank, n_cols) = (block.rank as usize, block.n_cols as usize);
    let own = f64::from(block.error.truncation.max(0.0) + block.error.sampling.max(0.0));
    let part = share * own / (2 * rank).max(1) as f64;
    let n_entries = f64::from(block.n_rows) * n_cols as f64;
    let mut sum = Sum { own: own * n_entries, ..Sum::default() };
    for k in 0..rank {
        let left: Vec<f64> = block.left.iter().skip(k).step_by(rank).map(|x| x.to_f64()).collect();
        let right: Vec<f64> = block.right[k * n_cols..][..n_cols].iter().map(|x| x.to_f64()).collect();
        let scale = f64::from(block.scale[k]).powi(2);
        for (side, (vector, other)) in [(&left, &right), (&right, &left)].into_iter().enumerate() {
            // An error of one factor comes out multiplied by the other.
            let weight = scale * mean_square(other.iter().copied());
            let error = |bits: u32| weight * rounding_error(vector, bits);
            let bits = widths.iter().copied().find(|bits| error(*bits) <= part);
            sum.added += bits.map_or(0.0, error) * n_entries;
            sum.half_bytes[side] += 2.0 * vector.len() as f64;
            sum.few_bytes[side] += f64::from(bits.unwrap_or(HALF)) * vector.len() as f64 / 8.0;
        }
    }
    sum
}

/// Mean square error of a vector that is rounded to so many bits, a sign among them, of its largest magnitude.
fn rounding_error(vector: &[f64], bits: u32) -> f64 {
    let largest = vector.iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
    let step = (largest / f64::from((1u32 << (bits - 1)) - 1)).max(f64::MIN_POSITIVE);
    mean_square(vector.iter().map(|x| x - (x / step).round() * step))
}

fn mean_square(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = values.len().max(1) as f64;
    values.map(|x| x * x).sum::<f64>() / n
}
