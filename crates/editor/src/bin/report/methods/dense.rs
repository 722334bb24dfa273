//! A whole matrix of a picture, and how far an approximation is from it.

use std::path::Path;

use anyhow::{Result, ensure};
use clerestory_nystrom::rivals::{DMatrix, Real};
use clerestory_relight::Radiance;
use rayon::prelude::*;

use super::npz;
use crate::fit::median;

/// Channels of a pixel.
pub const CHANNELS: usize = 3;
/// Side of a block in pixels.
pub const TILE: usize = 16;
/// What values of the shared matrices are multiplied by.
const SHARED_UNIT: f32 = 1024.0;
/// Products that are summed side by side.
const LANES: usize = 8;
/// Share of a column's entries that are no brighter than its peak.
const PEAK_QUANTILE: f64 = 0.995;

/// All rows of a picture: its pixels from left to right and top to bottom, three channels each.
pub struct Picture {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Columns.
    pub n_cols: usize,
    /// Row-major, channels of pixels × columns.
    pub values: Vec<f32>,
}

impl Picture {
    /// A matrix of an archive of the shared data: `T` is the converged one.
    ///
    /// # Errors
    /// If it cannot be read or has another shape.
    pub fn shared(path: &Path, name: &str) -> Result<Picture> {
        let array = npz::read(path, name)?;
        let [height, width, channels, n_cols] = array.shape[..] else {
            anyhow::bail!("{} has a matrix of {} axes, not 4", path.display(), array.shape.len());
        };
        ensure!(channels == CHANNELS, "{} has {channels} channels", path.display());
        let values = array.values.iter().map(|x| x / SHARED_UNIT).collect();
        Ok(Picture { width, height, n_cols, values })
    }

    /// Columns of a square panel in the order of Morton's curve, so that neighbors in the plane are neighbors in the matrix.
    pub fn in_z_order(mut self) -> Picture {
        let side = self.n_cols.isqrt();
        if side * side == self.n_cols && side.is_power_of_two() {
            let spread = |x: usize| (0..16).map(|bit| (x >> bit & 1) << (2 * bit)).sum::<usize>();
            let place = |column: usize| spread(column % side) | spread(column / side) << 1;
            let places: Vec<usize> = (0..self.n_cols).map(place).collect();
            for row in self.values.chunks_exact_mut(self.n_cols) {
                let old = row.to_vec();
                old.into_iter().zip(&places).for_each(|(value, &place)| row[place] = value);
            }
        }
        self
    }

    /// Median over the columns of the value that 99.5 % of a column's entries do not exceed.
    pub fn peak(&self) -> f64 {
        let peak = |column: usize| {
            let mut values: Vec<f32> = self.values.iter().skip(column).step_by(self.n_cols).copied().collect();
            let nth = ((values.len() - 1) as f64 * PEAK_QUANTILE).round() as usize;
            f64::from(*values.select_nth_unstable_by(nth, f32::total_cmp).1)
        };
        median(&(0..self.n_cols).map(peak).collect::<Vec<f64>>()).expect("a picture has columns")
    }

    /// Every `step`-th block of 16 × 16 pixels, counted along the rows of blocks.
    pub fn blocks<S: Real>(&self, step: usize) -> Vec<DMatrix<S>> {
        let (across, down) = (self.width / TILE, self.height / TILE);
        let block = |block: usize| {
            let (left, top) = (block % across * TILE, block / across * TILE);
            self.part((top..top + TILE).flat_map(|y| (left..left + TILE).map(move |x| (x, y))).collect())
        };
        (0..across * down).step_by(step).map(block).collect()
    }

    /// One matrix of every `step`-th pixel across and down.
    pub fn thinned<S: Real>(&self, step: usize) -> DMatrix<S> {
        let rows = (0..self.height).step_by(step);
        self.part(rows.flat_map(|y| (0..self.width).step_by(step).map(move |x| (x, y))).collect())
    }

    /// The same with the values of all blocks, as [`Picture::blocks`] cuts them with step 1.
    pub fn with_blocks<S: Real>(&self, blocks: &[DMatrix<S>]) -> Picture {
        let (across, mut values) = (self.width / TILE, vec![0.0; self.values.len()]);
        for (block_idx, block) in blocks.iter().enumerate() {
            let (left, top) = (block_idx % across * TILE, block_idx / across * TILE);
            for row in 0..block.nrows() {
                let (nth, channel) = (row / CHANNELS, row % CHANNELS);
                let pixel = (top + nth / TILE) * self.width + left + nth % TILE;
                let start = (pixel * CHANNELS + channel) * self.n_cols;
                let out = &mut values[start..start + self.n_cols];
                out.iter_mut().enumerate().for_each(|(column, x)| *x = block[(row, column)].to_f64() as f32);
            }
        }
        Picture { values, ..*self }
    }

    /// Columns of a square panel of texels twice as large: the light of four together.
    pub fn coarser(&self) -> Picture {
        let side = self.n_cols.isqrt();
        let n_cols = self.n_cols / 4;
        let coarse = |column: usize| {
            let first = 2 * (column / (side / 2)) * side + 2 * (column % (side / 2));
            [first, first + 1, first + side, first + side + 1]
        };
        let row = |row: &[f32]| (0..n_cols).map(|column| coarse(column).iter().map(|&at| row[at]).sum()).collect();
        let rows: Vec<Vec<f32>> = self.values.par_chunks_exact(self.n_cols).map(row).collect();
        Picture { n_cols, values: rows.concat(), ..*self }
    }

    /// The picture under a coefficient per column and channel.
    pub fn relit(&self, light: &[[f32; CHANNELS]]) -> Radiance {
        let lights: [Vec<f32>; CHANNELS] =
            std::array::from_fn(|channel| light.iter().map(|light| light[channel]).collect());
        let pixel = |rows: &[f32]| {
            std::array::from_fn(|channel| dot(&rows[channel * self.n_cols..][..self.n_cols], &lights[channel]))
        };
        let pixels = self.values.par_chunks_exact(CHANNELS * self.n_cols).map(pixel).collect();
        Radiance { width: self.width as u32, height: self.height as u32, pixels }
    }

    fn part<S: Real>(&self, pixels: Vec<(usize, usize)>) -> DMatrix<S> {
        DMatrix::from_fn(pixels.len() * CHANNELS, self.n_cols, |row, column| {
            let (x, y) = pixels[row / CHANNELS];
            let row = (y * self.width + x) * CHANNELS + row % CHANNELS;
            S::nearest(f64::from(self.values[row * self.n_cols + column]))
        })
    }
}

/// In as many sums side by side as no sum waits for the one before it.
fn dot(row: &[f32], light: &[f32]) -> f32 {
    let ((rows, last), (lights, of_last)) = (row.as_chunks::<LANES>(), light.as_chunks::<LANES>());
    let mut sums = [0.0; LANES];
    for (row, light) in rows.iter().zip(lights) {
        sums.iter_mut().zip(row).zip(light).for_each(|((sum, x), light)| *sum += x * light);
    }
    sums.iter().sum::<f32>() + last.iter().zip(of_last).map(|(x, light)| x * light).sum::<f32>()
}

/// Sum of squared differences. What is not finite is infinitely far away.
pub fn squared_error<S: Real>(truth: &DMatrix<S>, found: &DMatrix<S>) -> f64 {
    let square = |(x, y): (&S, &S)| (x.to_f64() - y.to_f64()).powi(2);
    let sum: f64 = truth.iter().zip(found).map(square).sum();
    if sum.is_finite() { sum } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Picture {
        let values = (0..32 * 48 * 3 * 4).map(|i| i as f32).collect();
        Picture { width: 32, height: 48, n_cols: 4, values }
    }

    #[test]
    fn blocks_and_pixels_are_where_they_belong() {
        let blocks = picture().blocks::<f64>(1);
        assert_eq!((blocks.len(), blocks[0].shape()), (6, (768, 4)));
        // Block 3 begins at pixel (16, 16), its second row of pixels one below.
        assert_eq!(blocks[3][(1, 2)], ((16 * 32 + 16) * 3 + 1) as f64 * 4.0 + 2.0);
        assert_eq!(blocks[3][(16 * 3, 0)], ((17 * 32 + 16) * 3) as f64 * 4.0);
        let thinned = picture().thinned::<f32>(16);
        assert_eq!((thinned.shape(), thinned[(3, 0)]), ((2 * 3 * 3, 4), 16.0 * 3.0 * 4.0));
    }

    #[test]
    fn blocks_go_back_where_they_came_from() {
        let picture = picture();
        assert_eq!(picture.with_blocks(&picture.blocks::<f64>(1)).values, picture.values);
    }

    #[test]
    fn texels_twice_as_large_send_the_light_of_four() {
        let values = (0..3 * 16).map(|i| (i % 16) as f32).collect();
        let picture = Picture { width: 1, height: 1, n_cols: 16, values };
        let coarser = picture.coarser();
        assert_eq!((coarser.n_cols, &coarser.values[..4]), (4, &[10.0, 18.0, 42.0, 50.0][..]));
        let all = |n: usize| vec![[1.0, 2.0, 0.5]; n];
        assert_eq!(picture.relit(&all(16)), coarser.relit(&all(4)));
    }

    #[test]
    fn the_peak_is_the_median_of_the_columns() {
        // 200 entries a column: the 199th, by size.
        let values = (0..200).flat_map(|i| [i as f32, 10.0 * i as f32, 100.0 * i as f32]).collect();
        assert_eq!(Picture { width: 1, height: 200, n_cols: 3, values }.peak(), 1980.0);
        // Of two columns the mean of both.
        let values = (0..200).flat_map(|i| [i as f32, 3.0 * i as f32]).collect();
        assert_eq!(Picture { width: 1, height: 200, n_cols: 2, values }.peak(), 396.0);
    }

    #[test]
    fn neighbors_in_the_plane_come_together() {
        let picture = Picture { width: 1, height: 1, n_cols: 16, values: (0..16).map(|i| i as f32).collect() };
        assert_eq!(picture.in_z_order().values[..8], [0.0, 1.0, 4.0, 5.0, 2.0, 3.0, 6.0, 7.0]);
    }
}
