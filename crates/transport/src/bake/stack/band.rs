//! Some rows of every picture of a stack, as a matrix that can be sampled.

use std::ops::Range;

use clerestory_nystrom::{Half, SampledMatrix, SparseEntry};
use rayon::prelude::*;

use crate::camera::Film;
use crate::fingerprint::digest;
use crate::import::stack::{ImageStack, Picture, StackError};
use crate::matrix::CHANNELS;

/// Values beyond so many times the peak of their picture are kept apart, entry by entry: a glint or a hot pixel would take all of the
/// digits of its block.
const GLINT: f32 = 16.0;

/// Some rows of pixels of every picture.
pub(super) struct Band {
    /// Rows of pixels.
    pub rows: Range<u32>,
    /// One per picture: red, green and blue of each pixel, row by row.
    pub columns: Vec<Vec<f32>>,
}

impl Band {
    /// Reads all pictures again; each has to be what it was when its bytes had the given hash.
    pub fn read(stack: &ImageStack, rows: Range<u32>, digests: &[u64]) -> Result<Band, StackError> {
        let read = |(image, known): (_, &u64)| {
            let (picture, bytes) = stack.read(image)?;
            match digest(&bytes) == *known {
                true => Ok(column(&picture, &rows)),
                false => Err(StackError::Changed { path: image.path.clone() }),
            }
        };
        let columns = stack.images.par_iter().zip(digests).map(read).collect::<Result<_, _>>()?;
        Ok(Band { rows, columns })
    }
}

/// Some rows of a picture.
pub(super) fn column(picture: &Picture, rows: &Range<u32>) -> Vec<f32> {
    let width = picture.size[0] as usize;
    picture.pixels[rows.start as usize * width..rows.end as usize * width].as_flattened().to_vec()
}

/// The pictures as columns, each times its scale. Only the rows of the band can be asked for.
pub(super) struct StackMatrix<'a> {
    /// Size of the pictures.
    pub film: Film,
    /// One per picture.
    pub column_scale: &'a [f32],
    /// What is in memory.
    pub band: &'a Band,
}

impl SampledMatrix for StackMatrix<'_> {
    fn n_rows(&self) -> usize {
        CHANNELS * self.film.n_pixels()
    }

    fn n_cols(&self) -> usize {
        self.column_scale.len()
    }

    fn bundle_len(&self) -> usize {
        CHANNELS
    }

    /// Every sample of either half is the value itself.
    fn add_rows(&self, bundles: &[u32], samples: Range<u32>, _: Half, out: &mut [f32], sparse: &mut Vec<SparseEntry>) {
        let n_cols = self.n_cols();
        let first_pixel = self.band.rows.start * self.film.width;
        for (column, (values, scale)) in self.band.columns.iter().zip(self.column_scale).enumerate() {
            for (nth, (&pixel, rows)) in bundles.iter().zip(out.chunks_exact_mut(CHANNELS * n_cols)).enumerate() {
                let at = CHANNELS * (pixel - first_pixel) as usize;
                for (channel, value) in values[at..at + CHANNELS].iter().enumerate() {
                    let (scaled, weight) = (scale * value, samples.len() as f32);
                    if scaled.abs() > GLINT {
                        let row = (nth * CHANNELS + channel) as u32;
                        sparse.push(SparseEntry { row, col: column as u32, value: weight * scaled });
                    } else {
                        rows[channel * n_cols + column] += weight * scaled;
                    }
                }
            }
        }
    }
}
