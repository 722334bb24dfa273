//! Pictures made smaller or cut out, in linear light: what a pixel covers is averaged.

use std::borrow::Cow;

use clerestory_relight::Radiance;
use rayon::prelude::*;

use super::options::Region;

/// Height that goes with a width, at the shape of a picture; at least a pixel.
pub(super) fn height_of(width: u32, [baked_width, baked_height]: [u32; 2]) -> u32 {
    let height = f64::from(width) * f64::from(baked_height) / f64::from(baked_width.max(1));
    (height.round() as u32).max(1)
}

/// The pixels that each new one covers, from its first on, and the share of each; the shares of one are 1 together.
fn shares(n_old: u32, n_new: u32) -> Vec<(usize, Vec<f32>)> {
    let step = f64::from(n_old) / f64::from(n_new.max(1));
    let covered = |nth: u32| {
        let (start, end) = (f64::from(nth) * step, (f64::from(nth + 1) * step).min(f64::from(n_old)));
        let (first, last) = (start.floor() as usize, (end.ceil() as usize).min(n_old as usize));
        let share = |old: usize| ((end.min(old as f64 + 1.0) - start.max(old as f64)).max(0.0) / step) as f32;
        (first, (first..last).map(share).collect())
    };
    (0..n_new).map(covered).collect()
}

/// The picture with fewer pixels.
pub(super) fn shrunk(picture: &Radiance, [width, height]: [u32; 2]) -> Cow<'_, Radiance> {
    if (width, height) == (picture.width, picture.height) {
        return Cow::Borrowed(picture);
    }
    let (across, down) = (shares(picture.width, width), shares(picture.height, height));
    let old_row = |y: usize| &picture.pixels[y * picture.width as usize..][..picture.width as usize];
    let row = |(first, shares): &(usize, Vec<f32>)| -> Vec<[f32; 3]> {
        let mut sum = vec![[0.0; 3]; picture.width as usize];
        for (y, share) in (*first..).zip(shares) {
            for (sum, rgb) in sum.iter_mut().zip(old_row(y)) {
                (0..3).for_each(|c| sum[c] += share * rgb[c]);
            }
        }
        let pixel = |(first, shares): &(usize, Vec<f32>)| {
            let covered = sum[*first..].iter().zip(shares);
            covered.fold([0.0; 3], |mean, (rgb, share)| std::array::from_fn(|c| mean[c] + share * rgb[c]))
        };
        across.iter().map(pixel).collect()
    };
    let rows: Vec<Vec<[f32; 3]>> = down.par_iter().map(row).collect();
    Cow::Owned(Radiance { width, height, pixels: rows.concat() })
}

/// A part of the picture, which must lie within it.
pub(super) fn cropped(picture: &Radiance, Region { x, y, width, height }: Region) -> Radiance {
    let row = |y: u32| &picture.pixels[(y * picture.width + x) as usize..][..width as usize];
    Radiance { width, height, pixels: (y..y + height).flat_map(row).copied().collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbered(width: u32, height: u32) -> Radiance {
        let pixels = (0..width * height).map(|i| [i as f32, 1.0, (i % width) as f32]).collect();
        Radiance { width, height, pixels }
    }

    #[test]
    fn a_picture_of_half_the_size_has_the_means_of_four_pixels() {
        let small = shrunk(&numbered(4, 2), [2, 1]).into_owned();
        assert_eq!(small.pixels, [[2.5, 1.0, 0.5], [4.5, 1.0, 2.5]]);
    }

    #[test]
    fn light_is_neither_lost_nor_made_at_odd_sizes() {
        let picture = numbered(31, 17);
        for size in [[30, 16], [7, 4], [1, 1], [31, 17]] {
            let small = shrunk(&picture, size);
            let mean = |picture: &Radiance, c: usize| {
                picture.pixels.iter().map(|rgb| f64::from(rgb[c])).sum::<f64>() / picture.pixels.len() as f64
            };
            for c in 0..3 {
                let (old, new) = (mean(&picture, c), mean(&small, c));
                assert!((old - new).abs() < 1e-4 * old, "{size:?}: {new} against {old}");
            }
            assert!(small.pixels.iter().all(|rgb| (rgb[1] - 1.0).abs() < 1e-5), "white stays white");
        }
    }

    #[test]
    fn a_region_holds_its_own_pixels() {
        let part = cropped(&numbered(5, 4), Region { x: 2, y: 1, width: 2, height: 3 });
        assert_eq!(part.pixels.iter().map(|rgb| rgb[0]).collect::<Vec<_>>(), [7.0, 8.0, 12.0, 13.0, 17.0, 18.0]);
    }
}
