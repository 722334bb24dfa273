//! PSNR beside two references instead of one, so that their noise drops out.

use clerestory::compare::white_level;
use clerestory_relight::Radiance;

use super::lights::lights;
use crate::errors::{Sum, decibels};
use crate::methods::dense::Picture;

/// PSNR in dB of a picture x beside two pictures a and b whose noise is their own: all exposed to four times the median luminance of the
/// mean of a and b and clipped at white, the mean of (x − a)(x − b), told as no less than its standard error.
pub(super) fn psnr_db(x: &Radiance, [a, b]: [&Radiance; 2]) -> f64 {
    let pair = |(a, b): (&[f32; 3], &[f32; 3])| std::array::from_fn(|c| 0.5 * (a[c] + b[c]));
    let both = Radiance { pixels: a.pixels.iter().zip(&b.pixels).map(pair).collect(), ..*a };
    let white = white_level(&both);
    let shown = |value: &f32| (f64::from(*value) / white).clamp(0.0, 1.0);
    let mut sum = Sum::default();
    for ((x, a), b) in x.pixels.iter().zip(&a.pixels).zip(&b.pixels) {
        for ((x, a), b) in x.iter().zip(a).zip(b) {
            let [x, a, b] = [x, a, b].map(shown);
            sum.add((x - a) * (x - b));
        }
    }
    decibels(1.0, sum.mean_at_least_known())
}

/// Mean over all lights of the PSNR in dB of a matrix beside two.
pub(super) fn mean_psnr_db(halves: &[Picture; 2], found: &Picture) -> f64 {
    let lights = lights(found.n_cols.isqrt());
    let psnr = |light: &Vec<[f32; 3]>| {
        let [a, b] = halves.each_ref().map(|half| half.relit(light));
        psnr_db(&found.relit(light), [&a, &b])
    };
    lights.iter().map(psnr).sum::<f64>() / lights.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_of_the_references_drops_out_and_white_is_clipped() {
        // The truth is 1 everywhere, so white is 4; both references are off by ±0.5 in patterns of their own.
        let picture = |value: &dyn Fn(usize) -> f32| Radiance {
            width: 4096,
            height: 1,
            pixels: (0..4096).map(|i| [value(i); 3]).collect(),
        };
        let noisy = |bit: usize| picture(&|i: usize| if i >> bit & 1 == 0 { 0.5 } else { 1.5 });
        let (a, b) = (noisy(0), noisy(1));
        let off = psnr_db(&picture(&|_| 1.4), [&a, &b]);
        assert!((off - 20.0).abs() < 1e-3, "a tenth of white: {off}");
        let exact = psnr_db(&picture(&|_| 1.0), [&a, &b]);
        // What is left is how well it is known: (1/8)² over the root of all values.
        assert!((exact - 10.0 * (64.0 * f64::sqrt(3.0 * 4096.0)).log10()).abs() < 1e-3, "{exact}");
        let ends = [4.0, 40.0].map(|value| psnr_db(&picture(&|_| value), [&a, &b]));
        assert_eq!(ends[0], ends[1], "white is white");
    }
}
