//! A whole matrix laid out for its product with light, read once from front to back: what a rival does that compresses nothing.

use clerestory_relight::Radiance;
use clerestory_relight::bandwidth::prefetch;
use rayon::prelude::*;

use super::dense::{CHANNELS, Picture};

/// Pixels whose sums stay in registers: a line of the cache.
const LANES: usize = 16;
/// Pixels of a run, which a thread takes at once.
const RUN: usize = 64 * LANES;
/// Planes that lie this far ahead are asked for where memory is.
const AHEAD: usize = 64;

/// A picture's matrix in planes.
pub struct Planes {
    width: u32,
    height: u32,
    n_cols: usize,
    /// For every [`LANES`] pixels the channels, of each the columns, of each an entry per pixel; the last pixels are filled up with zeros.
    values: Vec<f32>,
}

impl Planes {
    /// The same entries in another order.
    pub fn new(picture: &Picture) -> Planes {
        let Picture { width, height, n_cols, ref values } = *picture;
        let row_len = CHANNELS * n_cols;
        let mut planes = vec![0.0; (width * height).div_ceil(LANES) * LANES * row_len];
        planes.par_chunks_exact_mut(LANES * row_len).zip(values.par_chunks(LANES * row_len)).for_each(|(set, rows)| {
            for (pixel, rows) in rows.chunks_exact(row_len).enumerate() {
                rows.iter().enumerate().for_each(|(plane, &value)| set[plane * LANES + pixel] = value);
            }
        });
        Planes { width: width as u32, height: height as u32, n_cols, values: planes }
    }

    /// Bytes that a product reads.
    pub fn n_bytes(&self) -> usize {
        size_of_val(&self.values[..])
    }

    /// The picture under a coefficient per column and channel, on all threads.
    pub fn relight(&self, light: &[[f32; CHANNELS]], out: &mut Radiance) {
        assert_eq!(light.len(), self.n_cols, "one coefficient per column");
        (out.width, out.height) = (self.width, self.height);
        out.pixels.resize(self.width as usize * self.height as usize, [0.0; CHANNELS]);
        let lights: [Vec<f32>; CHANNELS] =
            std::array::from_fn(|channel| light.iter().map(|light| light[channel]).collect());
        let runs = self.values.par_chunks(RUN * CHANNELS * self.n_cols);
        out.pixels.par_chunks_mut(RUN).zip(runs).for_each(|(pixels, run)| {
            let (planes, _) = run.as_chunks::<LANES>();
            for (nth, pixels) in pixels.chunks_mut(LANES).enumerate() {
                for (channel, light) in lights.iter().enumerate() {
                    let sums = summed(planes, (nth * CHANNELS + channel) * self.n_cols, light);
                    pixels.iter_mut().zip(sums).for_each(|(pixel, sum)| pixel[channel] = sum);
                }
            }
        });
    }
}

/// The planes of all columns from the `first` on, each times its light.
#[inline]
fn summed(planes: &[[f32; LANES]], first: usize, light: &[f32]) -> [f32; LANES] {
    let mut sums = [0.0; LANES];
    for (at, (plane, light)) in planes[first..].iter().zip(light).enumerate() {
        prefetch(planes.get(first + at + AHEAD..first + at + AHEAD + 1).unwrap_or_default());
        sums.iter_mut().zip(plane).for_each(|(sum, x)| *sum += light * x);
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_give_the_picture_of_their_rows() {
        // A run and a part of one, whose last pixels are not as many as are summed at once.
        let (width, height, n_cols) = (43, 25, 6);
        let values = (0..width * height * CHANNELS * n_cols).map(|i| (i % 101) as f32 - 17.0).collect();
        let picture = Picture { width, height, n_cols, values };
        let planes = Planes::new(&picture);
        assert_eq!(planes.n_bytes(), 4 * 1088 * CHANNELS * n_cols);
        let mut shown = Radiance::default();
        for turn in [1.0, 3.0] {
            let light: Vec<[f32; CHANNELS]> = (0..n_cols).map(|i| [i as f32, turn, 2.0 - i as f32]).collect();
            planes.relight(&light, &mut shown);
            // Small whole numbers: sums are exact in any order.
            assert_eq!(shown.pixels, picture.relit(&light).pixels);
        }
        assert_eq!((shown.width, shown.height), (43, 25));
    }
}
