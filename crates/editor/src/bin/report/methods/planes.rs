//! A whole matrix laid out for its product with light, at the speed of memory: what a rival does that compresses nothing.

use clerestory_relight::Radiance;
use rayon::prelude::*;

use super::dense::{CHANNELS, Picture};

/// Pixels of a run, whose sums stay in the nearest cache.
const RUN: usize = 1024;
/// Columns that are added at once, so that sums are read and written less often than entries are.
const AT_ONCE: usize = 4;

/// A picture's matrix in planes.
pub struct Planes {
    width: u32,
    height: u32,
    n_cols: usize,
    /// Run by run, of each the channels, of each the columns, of each an entry per pixel; the last run is filled up with zeros.
    values: Vec<f32>,
}

impl Planes {
    /// The same entries in another order.
    pub fn new(picture: &Picture) -> Planes {
        let Picture { width, height, n_cols, ref values } = *picture;
        let row_len = CHANNELS * n_cols;
        let mut planes = vec![0.0; (width * height).div_ceil(RUN) * RUN * row_len];
        planes.par_chunks_exact_mut(RUN * row_len).zip(values.par_chunks(RUN * row_len)).for_each(|(run, rows)| {
            for (pixel, rows) in rows.chunks_exact(row_len).enumerate() {
                rows.iter().enumerate().for_each(|(plane, &value)| run[plane * RUN + pixel] = value);
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
        let runs = self.values.par_chunks_exact(RUN * CHANNELS * self.n_cols);
        out.pixels.par_chunks_mut(RUN).zip(runs).for_each(|(pixels, run)| {
            for (channel, planes) in run.chunks_exact(RUN * self.n_cols).enumerate() {
                let mut sums = [0.0; RUN];
                add(planes, light, channel, &mut sums);
                pixels.iter_mut().zip(sums).for_each(|(pixel, sum)| pixel[channel] = sum);
            }
        });
    }
}

/// Adds the planes of all columns, each times its light.
fn add(planes: &[f32], light: &[[f32; CHANNELS]], channel: usize, sums: &mut [f32; RUN]) {
    let (planes, _) = planes.as_chunks::<RUN>();
    let (sets, rest) = planes.as_chunks::<AT_ONCE>();
    let (lights, last) = light.as_chunks::<AT_ONCE>();
    for ([a, b, c, d], light) in sets.iter().zip(lights) {
        let [of_a, of_b, of_c, of_d] = light.map(|light| light[channel]);
        for (at, sum) in sums.iter_mut().enumerate() {
            *sum += (of_a * a[at] + of_b * b[at]) + (of_c * c[at] + of_d * d[at]);
        }
    }
    for (plane, light) in rest.iter().zip(last) {
        sums.iter_mut().zip(plane).for_each(|(sum, x)| *sum += light[channel] * x);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_give_the_picture_of_their_rows() {
        // A run and a part of one; a set of columns and a part of one.
        let (width, height, n_cols) = (43, 25, 6);
        let values = (0..width * height * CHANNELS * n_cols).map(|i| (i % 101) as f32 - 17.0).collect();
        let picture = Picture { width, height, n_cols, values };
        let planes = Planes::new(&picture);
        assert_eq!(planes.n_bytes(), 4 * 2 * RUN * CHANNELS * n_cols);
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
