//! Rows of the matrix, read straight from the factors: what each column adds to some pixels.

use std::borrow::Borrow;
use std::collections::BTreeMap;

use clerestory_nystrom::{BlockFactors, BlockLowRank};

/// The mean over some pixels of the matrix' rows: per group and column what a coefficient of 1 in each channel brings to
/// that channel. The picture's mean over these pixels is the sum over columns of this times the coefficient.
///
/// `None` without pixels, for pixels outside, and where a block of any group is not there.
pub fn mean_row<G: Borrow<BlockLowRank>>(groups: &[G], pixels: &[u32]) -> Option<Vec<Vec<[f32; 3]>>> {
    let weight = 1.0 / pixels.len().max(1) as f32;
    weighed_row(groups, pixels.iter().map(|pixel| (*pixel, weight)))
}

/// The sum of the matrix' rows of some pixels, each times its weight; see [`mean_row`].
pub fn weighed_row<G: Borrow<BlockLowRank>>(
    groups: &[G],
    pixels: impl IntoIterator<Item = (u32, f32)>,
) -> Option<Vec<Vec<[f32; 3]>>> {
    let partition = &groups.first()?.borrow().partition;
    let mut blocks: BTreeMap<usize, Vec<(u32, f32)>> = BTreeMap::new();
    for (pixel, weight) in pixels {
        let (block, within) = partition.place(pixel)?;
        blocks.entry(block).or_default().push((within, weight));
    }
    let sum_of = |group: &BlockLowRank| {
        let mut row = vec![[0.0; 3]; group.n_cols as usize];
        for (block, within) in &blocks {
            add_rows(group.blocks.get(*block)?.as_ref()?, within, &mut row);
        }
        Some(row)
    };
    (!blocks.is_empty()).then(|| groups.iter().map(|group| sum_of(group.borrow())).collect()).flatten()
}

/// Adds the weighted rows of some pixels of a block: left factors are summed first, so that right ones are read once.
fn add_rows(block: &BlockFactors, pixels: &[(u32, f32)], out: &mut [[f32; 3]]) {
    let (rank, n_cols) = (block.rank as usize, block.n_cols as usize);
    let mut left = vec![[0.0f32; 3]; rank];
    let mut weights = vec![0.0f32; block.n_rows as usize / 3];
    for &(pixel, weight) in pixels {
        weights[pixel as usize] += weight;
        for channel in 0..3 {
            let row = &block.left[(3 * pixel as usize + channel) * rank..][..rank];
            left.iter_mut().zip(row).for_each(|(sum, value)| sum[channel] += weight * value.to_f32());
        }
    }
    for (r, sum) in left.iter().enumerate() {
        let sum = sum.map(|value| value * block.scale[r]);
        for (out, right) in out.iter_mut().zip(&block.right[r * n_cols..][..n_cols]) {
            (0..3).for_each(|channel| out[channel] += sum[channel] * right.to_f32());
        }
    }
    for entry in &block.sparse {
        out[entry.col as usize][entry.row as usize % 3] += weights[entry.row as usize / 3] * entry.value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Ranks, Recipe};
    use crate::{CpuRelighter, Radiance, Relight};

    #[test]
    fn rows_times_coefficients_are_the_picture() {
        let recipe =
            Recipe { width: 45, height: 37, n_cols: vec![9, 1, 70], rank: Ranks::Fixed(5), ..Recipe::default() };
        let (frame, coefficients) = (recipe.frame(), recipe.coefficients(3));
        let mut picture = Radiance::default();
        CpuRelighter::new(&frame).unwrap().relight(&coefficients, &mut picture).unwrap();
        // A single pixel in every corner, and areas over several blocks, one of them with a pixel that counts twice.
        let area = |x: std::ops::Range<u32>, y: std::ops::Range<u32>| -> Vec<u32> {
            y.flat_map(|y| x.clone().map(move |x| y * 45 + x)).collect()
        };
        let corners = [0, 44, 36 * 45, 37 * 45 - 1].map(|pixel| vec![pixel]);
        let areas = [area(10..40, 3..30), vec![7, 7, 900]];
        for pixels in corners.into_iter().chain(areas) {
            let row = mean_row(&frame.groups, &pixels).unwrap();
            for channel in 0..3 {
                let terms = row.iter().flatten().zip(coefficients.iter().flatten());
                let sum: f32 = terms.map(|(row, x)| row[channel] * x[channel]).sum();
                let shown = pixels.iter().map(|&pixel| picture.pixels[pixel as usize][channel]).sum::<f32>();
                let shown = shown / pixels.len() as f32;
                assert!((sum - shown).abs() < 1e-3 * shown.abs().max(1.0), "{pixels:?}: {sum} {shown}");
            }
        }
    }

    #[test]
    fn what_is_not_there_has_no_row() {
        let mut frame = Recipe { width: 20, height: 20, rank: Ranks::Fixed(4), ..Recipe::default() }.frame();
        assert_eq!(mean_row(&frame.groups, &[]), None);
        assert_eq!(mean_row(&frame.groups, &[400]), None);
        assert!(mean_row(&frame.groups, &[399]).is_some());
        frame.groups[0].blocks[8] = None;
        assert_eq!(mean_row(&frame.groups, &[0, 399]), None);
        assert!(mean_row(&frame.groups, &[0]).is_some());
    }
}
