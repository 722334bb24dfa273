//! Whether borders of blocks show in a picture as a display has it: steps of its error across them over those within, in levels of 8 bits.

use std::ops::Range;

use clerestory_relight::Radiance;
use clerestory_relight::display::{Metering, srgb_from_linear};
use rayon::prelude::*;

use crate::fit::median;
use crate::methods::dense::{CHANNELS, Picture, TILE};

/// The luminance that so many percent of the pixels stay below is white.
pub const WHITE_PERCENT: f32 = 99.5;
/// White in 8 bits.
const MOST_LEVEL: f64 = 255.0;

/// How much more the error of a picture steps across each border of two blocks than within both, in levels of 8-bit sRGB.
pub struct Grid {
    excesses: Vec<f64>,
}

impl Grid {
    /// Of pictures under all columns at 1.
    pub fn under_all(truth: &Picture, found: &Picture) -> Grid {
        let light = vec![[1.0; CHANNELS]; truth.n_cols];
        Grid::new(&truth.relit(&light), &found.relit(&light))
    }

    /// Both are exposed as suits the truth. Levels are not rounded.
    fn new(truth: &Radiance, found: &Radiance) -> Grid {
        let gain = Metering::Percentile(WHITE_PERCENT).exposure_ev(truth).exp2();
        let level = |value: f32| MOST_LEVEL * f64::from(srgb_from_linear((gain * value).clamp(0.0, 1.0)));
        let error = |(found, truth): (&[f32; 3], &[f32; 3])| std::array::from_fn(|c| level(found[c]) - level(truth[c]));
        let values = found.pixels.iter().zip(&truth.pixels).map(error).collect();
        let errors = Errors { size: [truth.width as usize, truth.height as usize], values };
        Grid { excesses: [0, 1].map(|axis| errors.excesses(axis)).concat() }
    }

    /// Of all borders.
    pub fn worst_and_mean(&self) -> [f64; 2] {
        let worst = self.excesses.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        [worst, self.excesses.iter().sum::<f64>() / self.excesses.len() as f64]
    }
}

/// Medians over the columns of the worst border and of the mean, each column by itself at 1.
pub fn under_one(truth: &Picture, found: &Picture) -> [f64; 2] {
    let of_column = |column: usize| {
        let [truth, found] = [truth, found].map(|picture| under_column(picture, column));
        Grid::new(&truth, &found).worst_and_mean()
    };
    let grids: Vec<[f64; 2]> = (0..truth.n_cols).into_par_iter().map(of_column).collect();
    [0, 1].map(|which| median(&grids.iter().map(|grid| grid[which]).collect::<Vec<_>>()).unwrap_or(f64::NAN))
}

fn under_column(picture: &Picture, column: usize) -> Radiance {
    let n_cols = picture.n_cols;
    let pixel = |rows: &[f32]| std::array::from_fn(|channel| rows[channel * n_cols + column]);
    let pixels = picture.values.chunks_exact(CHANNELS * n_cols).map(pixel).collect();
    Radiance { width: picture.width as u32, height: picture.height as u32, pixels }
}

/// Errors of the pixels of a picture.
struct Errors {
    /// Pixels across and down.
    size: [usize; 2],
    values: Vec<[f64; CHANNELS]>,
}

impl Errors {
    /// Of every border that is crossed along an axis, 0 across and 1 down.
    fn excesses(&self, axis: usize) -> Vec<f64> {
        let [n_lines, n_places] = [self.size[axis], self.size[1 - axis]];
        let mut excesses = Vec::new();
        for start in (0..n_places).step_by(TILE) {
            let places = start..(start + TILE).min(n_places);
            for border in (TILE..n_lines).step_by(TILE) {
                // The lines of both blocks but the first one of each, which is crossed into.
                let within = (border + 1 - TILE..border).chain(border + 1..(border + TILE).min(n_lines));
                let within: Vec<[f64; 2]> = within.map(|line| self.steps(axis, line, places.clone())).collect();
                let across = self.steps(axis, border, places.clone());
                let excess = [0, 1].map(|which| {
                    across[which] - within.iter().map(|steps| steps[which]).sum::<f64>() / within.len() as f64
                });
                excesses.push(excess[0].max(excess[1]));
            }
        }
        excesses
    }

    /// The step from the line of pixels before to one, at some places along them: the mean of its sizes, and the size of its mean, each the
    /// mean over the channels.
    fn steps(&self, axis: usize, line: usize, places: Range<usize>) -> [f64; 2] {
        let (n_steps, mut sizes, mut sums) = ((CHANNELS * places.len()) as f64, 0.0, [0.0; CHANNELS]);
        for place in places {
            let (from, to) = (self.at(axis, line - 1, place), self.at(axis, line, place));
            for (sum, (from, to)) in sums.iter_mut().zip(from.iter().zip(to)) {
                sizes += f64::abs(to - from);
                *sum += to - from;
            }
        }
        [sizes / n_steps, sums.into_iter().map(f64::abs).sum::<f64>() / n_steps]
    }

    fn at(&self, axis: usize, line: usize, place: usize) -> &[f64; CHANNELS] {
        let [x, y] = if axis == 0 { [line, place] } else { [place, line] };
        &self.values[y * self.size[0] + x]
    }
}

#[cfg(test)]
mod tests {
    use clerestory_transport::texture::srgb_to_linear;

    use super::*;

    /// Four blocks whose truth is white, of which 10 levels are lacking, and more or less of them by the place across and down.
    fn grid(error: impl Fn(usize, usize) -> f64) -> Grid {
        let picture = |level: &dyn Fn(usize, usize) -> f64| {
            let value = |i: usize| srgb_to_linear(level(i % 32, i / 32) / MOST_LEVEL) as f32;
            Radiance { width: 32, height: 32, pixels: (0..32 * 32).map(|i| [value(i); 3]).collect() }
        };
        Grid::new(&picture(&|_, _| MOST_LEVEL), &picture(&|x, y| MOST_LEVEL - 10.0 + error(x, y)))
    }

    fn assert_near(found: [f64; 2], expected: [f64; 2]) {
        assert!(found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 0.01), "{found:?}");
    }

    #[test]
    fn a_step_between_blocks_shows_and_the_same_between_all_pixels_does_not() {
        // Of four borders the two that are crossed from left to right.
        assert_near(grid(|x, _| if x < 16 { 0.0 } else { 2.0 }).worst_and_mean(), [2.0, 1.0]);
        assert_near(grid(|_, y| if y < 16 { 0.0 } else { 2.0 }).worst_and_mean(), [2.0, 1.0]);
        assert_near(grid(|x, y| 0.1 * (x + y) as f64).worst_and_mean(), [0.0, 0.0]);
        assert_near(grid(|_, _| 5.0).worst_and_mean(), [0.0, 0.0]);
        // One of four blocks is off: two borders of four.
        assert_near(grid(|x, y| if x < 16 && y < 16 { 2.0 } else { 0.0 }).worst_and_mean(), [2.0, 1.0]);
    }

    #[test]
    fn steps_that_change_sign_count_and_so_do_those_that_noise_hides_from_pixel_to_pixel() {
        let sign = |at: usize| if at.is_multiple_of(2) { 1.0 } else { -1.0 };
        // Up in the one row and down in the next: the mean along the border is nothing, and from row to row of the right blocks as much
        // steps across as within.
        assert_near(grid(|x, y| if x < 16 { 0.0 } else { sign(y) }).worst_and_mean(), [1.0, 0.5]);
        // Steps of 4 either way within, across by 1 more in one row and by 1 less in the next.
        assert_near(grid(|x, y| 2.0 * sign(x + y) + if x < 16 { 0.0 } else { 1.0 }).worst_and_mean(), [1.0, 0.5]);
    }

    #[test]
    fn errors_of_columns_that_cancel_show_under_each_alone() {
        let picture = |off: f32| {
            let value = |i: usize| if i / 6 % 32 < 16 { 1.0 } else { 1.0 + off * [1.0, -1.0][i % 2] };
            Picture { width: 32, height: 16, n_cols: 2, values: (0..32 * 16 * 3 * 2).map(value).collect() }
        };
        let (truth, found) = (picture(0.0), picture(0.1));
        assert_near(Grid::under_all(&truth, &found).worst_and_mean(), [0.0, 0.0]);
        // The one is clipped at white, the other lacks a tenth, which is 11.55 levels there: the median is the mean of both.
        assert_near(under_one(&truth, &found), [5.78, 5.78]);
        assert_near(under_one(&truth, &truth), [0.0, 0.0]);
    }
}
