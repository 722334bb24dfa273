//! A matrix beside two references instead of one, so that their noise drops out.

use super::lights::lights;
use crate::errors::psnr_db;
use crate::methods::dense::Picture;

/// Mean over all lights of the PSNR in dB of a matrix beside two.
pub(super) fn mean_psnr_db(halves: &[Picture; 2], found: &Picture) -> f64 {
    let lights = lights(found.n_cols.isqrt());
    let psnr = |light: &Vec<[f32; 3]>| {
        let [a, b] = halves.each_ref().map(|half| half.relit(light));
        psnr_db(&found.relit(light), [&a, &b])
    };
    lights.iter().map(psnr).sum::<f64>() / lights.len() as f64
}
