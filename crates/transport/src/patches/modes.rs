//! Combinations of light on patches that the columns are pictures of.
//!
//! Let T be what a few pixels take of the irradiance of all patches, by all ways, and Φ the irradiance that hundreds of
//! lamps throw on the patches. The pictures TΦ have the singular values Σ, and few of them matter. With V the strongest
//! right vectors, the columns are the pictures of the mixtures R = ΦV, and the coefficients of any light e are those by
//! which these pictures come nearest to that of e in the few pixels, Q = (TR)⁺T. So what the columns leave out of a light is
//! what the pixels do not notice: the balanced truncation of a linear system. \[Rowley2005\]

use clerestory_nystrom::spectrum::leading_pairs;
use rayon::prelude::*;

use super::codec::rounded;
use super::exchange::{Exchange, Row, Share, Tint, taken};
use super::strips::{Link, Strips};
use crate::matrix::CHANNELS;

/// Columns for each lamp that is learned from.
const COLUMNS_PER_LEARNED: f32 = 1.0 / 3.0;
/// Share of all light below which a mixture holds nothing but rounding; of many lamps [`leading_pairs`] leaves out more.
const FAINTEST: f64 = 1e-9;

/// Mixtures of lamps that columns are pictures of.
pub(super) struct Modes {
    pub n_columns: usize,
    /// Patches × columns: irradiance of the mixtures, straight from their lamps.
    pub mixtures: Vec<f32>,
    /// Patches × columns: what a patch brings to each coefficient per unit of irradiance.
    pub shares: Vec<f32>,
    pub held_out_error: f32,
}

impl Modes {
    /// `of_lamps` is patches × lamps, the first of which are learned from; `None` where no lamp lights anything.
    pub fn find(
        exchange: &Exchange,
        pixels: &[Row],
        mut of_lamps: Vec<f32>,
        [n_learned, n_lamps]: [usize; 2],
    ) -> Option<Modes> {
        let (all, bounces) = exchange.solve(&of_lamps, Tint::Gray);
        let mut pictures = taken(pixels, [&all, &of_lamps], n_lamps, Tint::Gray);
        drop(all);
        let scale = normalize(&mut pictures, n_lamps);
        of_lamps.par_chunks_mut(n_lamps).for_each(|row| row.iter_mut().zip(&scale).for_each(|(x, s)| *x *= s));
        let lit: Vec<usize> = (0..n_lamps).filter(|&lamp| scale[lamp] > 0.0).collect();
        let (learned, held_out): (Vec<usize>, Vec<usize>) = lit.into_iter().partition(|&lamp| lamp < n_learned);
        let n = learned.len();
        let gram = gram(&pictures, n_lamps, &learned);
        let (mut values, vectors) = leading_pairs(n, &gram, (COLUMNS_PER_LEARNED * n as f32) as usize);
        values.retain(|value| *value > FAINTEST * trace(&gram, n));
        let n_columns = values.len();
        if n_columns == 0 {
            return None;
        }
        // So that the coefficients of a lamp that fills the picture with light 1 have a sum of squares of about 1.
        let size = (n_columns as f64 / n as f64).sqrt();
        let mut mix = vec![0.0f32; n_lamps * n_columns];
        for (nth, &lamp) in learned.iter().enumerate() {
            for k in 0..n_columns {
                mix[lamp * n_columns + k] = (vectors[k * n + nth] * size) as f32;
            }
        }
        let mixtures = product(&of_lamps, &mix, n_columns);
        let columns = product(&pictures, &mix, n_columns);
        // The pseudoinverse of the columns: they are orthogonal, each as long as the root of its value.
        let lengths: Vec<f32> = values.iter().map(|value| (value * size * size * pixels.len() as f64) as f32).collect();
        let inverse: Vec<f32> = columns.iter().zip(lengths.iter().cycle()).map(|(x, length)| x / length).collect();
        let n_patches = of_lamps.len() / n_lamps;
        let gathered = |of: fn(&Row) -> &Vec<Share>| gather(pixels, of, &inverse, n_columns, n_patches);
        let (known, straight) = (gathered(|row| &row.known), gathered(|row| &row.straight));
        let mut shares = exchange.solve_transposed([&known, &straight], bounces, Tint::Gray);
        rounded(&mut shares, n_columns);
        let mut modes = Modes { n_columns, mixtures, shares, held_out_error: 0.0 };
        modes.held_out_error = modes.error_of(&held_out, (&of_lamps, &pictures, n_lamps), &columns);
        Some(modes)
    }

    /// Root mean square over lamps of the relative error of their pictures.
    fn error_of(
        &self,
        lamps: &[usize],
        (of_lamps, pictures, n_lamps): (&[f32], &[f32], usize),
        columns: &[f32],
    ) -> f32 {
        let k = self.n_columns;
        let error = |&lamp: &usize| {
            let mut c = vec![0.0f32; k];
            for (row, shares) in of_lamps.chunks_exact(n_lamps).zip(self.shares.chunks_exact(k)) {
                c.iter_mut().zip(shares).for_each(|(c, share)| *c += share * row[lamp]);
            }
            let [mut off, mut whole] = [0.0f64; 2];
            for (row, columns) in pictures.chunks_exact(n_lamps).zip(columns.chunks_exact(k)) {
                let found: f32 = columns.iter().zip(&c).map(|(x, c)| x * c).sum();
                off += f64::from(found - row[lamp]).powi(2);
                whole += f64::from(row[lamp]).powi(2);
            }
            off / whole
        };
        let errors: Vec<f64> = lamps.par_iter().map(error).collect();
        (errors.iter().sum::<f64>() / errors.len().max(1) as f64).sqrt() as f32
    }

    /// All irradiance of the mixtures: patches × channels × columns.
    pub fn all(&self, exchange: &Exchange) -> Vec<f32> {
        let k = self.n_columns;
        let mut all = vec![0.0; CHANNELS * self.mixtures.len()];
        for channel in 0..CHANNELS {
            let (solved, _) = exchange.solve(&self.mixtures, Tint::Channel(channel));
            for (out, row) in all.chunks_exact_mut(CHANNELS * k).zip(solved.chunks_exact(k)) {
                out[channel * k..(channel + 1) * k].copy_from_slice(row);
            }
        }
        all
    }
}

/// Brings each column to a root mean square of 1; what it was multiplied by, 0 where there is nothing.
fn normalize(pictures: &mut [f32], n_lamps: usize) -> Vec<f32> {
    let n_rows = pictures.len() / n_lamps;
    let mut squares = vec![0.0f64; n_lamps];
    for row in pictures.chunks_exact(n_lamps) {
        squares.iter_mut().zip(row).for_each(|(sum, x)| *sum += f64::from(*x).powi(2));
    }
    let scale = |&sum: &f64| {
        let scale = (sum / n_rows as f64).sqrt().recip() as f32;
        if scale.is_finite() { scale } else { 0.0 }
    };
    let scale: Vec<f32> = squares.iter().map(scale).collect();
    pictures.par_chunks_mut(n_lamps).for_each(|row| row.iter_mut().zip(&scale).for_each(|(x, s)| *x *= s));
    scale
}

/// Sums that a scalar product is made of side by side.
const SUMS: usize = 16;

/// Mean over pixels of the products of some lamps' pictures.
fn gram(pictures: &[f32], n_lamps: usize, lamps: &[usize]) -> Vec<f64> {
    let (n, n_rows) = (lamps.len(), pictures.len() / n_lamps);
    let columns: Vec<Vec<f32>> =
        lamps.iter().map(|&lamp| pictures.iter().skip(lamp).step_by(n_lamps).copied().collect()).collect();
    let mut gram = vec![0.0; n * n];
    gram.par_chunks_mut(n.max(1)).enumerate().for_each(|(a, row)| {
        for (out, column) in row.iter_mut().zip(&columns[..=a]) {
            *out = scalar_product(&columns[a], column) / n_rows as f64;
        }
    });
    for a in 0..n {
        for b in 0..a {
            gram[b * n + a] = gram[a * n + b];
        }
    }
    gram
}

/// The product of two columns; short sums keep it exact.
fn scalar_product(x: &[f32], y: &[f32]) -> f64 {
    let mut sums = [0.0f32; SUMS];
    let (whole_x, rest_x) = x.as_chunks::<SUMS>();
    let (whole_y, rest_y) = y.as_chunks::<SUMS>();
    for (x, y) in whole_x.iter().zip(whole_y) {
        (0..SUMS).for_each(|k| sums[k] += x[k] * y[k]);
    }
    let rest: f64 = rest_x.iter().zip(rest_y).map(|(x, y)| f64::from(x * y)).sum();
    sums.iter().map(|sum| f64::from(*sum)).sum::<f64>() + rest
}

/// Sum of the eigenvalues of a matrix.
fn trace(gram: &[f64], n: usize) -> f64 {
    gram.iter().step_by(n + 1).sum()
}

/// Product of two row-major matrices, the second of `n_cols` columns.
fn product(a: &[f32], b: &[f32], n_cols: usize) -> Vec<f32> {
    let inner = b.len() / n_cols;
    let nonzero = |row: &[f32]| -> Vec<Link> { (0..).zip(row.iter().copied()).filter(|(_, x)| *x != 0.0).collect() };
    let links: Vec<Vec<Link>> = a.par_chunks(inner).map(nonzero).collect();
    Strips::zeros(links.len(), n_cols).plus(&links, &Strips::of(b, n_cols)).row_major()
}

/// The transpose of gray rows times a matrix of pixels × columns: patches × columns.
fn gather(
    pixels: &[Row],
    of: fn(&Row) -> &Vec<Share>,
    weights: &[f32],
    n_columns: usize,
    n_patches: usize,
) -> Vec<f32> {
    let mut out = vec![0.0; n_patches * n_columns];
    for (row, weights) in pixels.iter().zip(weights.chunks_exact(n_columns)) {
        for share in of(row) {
            let weight = Tint::Gray.of(share.weight);
            let out = &mut out[share.patch as usize * n_columns..][..n_columns];
            out.iter_mut().zip(weights).for_each(|(out, w)| *out += weight * w);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::uniform_hash;

    #[test]
    fn products_agree_with_the_definition() {
        let numbers = |n: u64, key: u64| -> Vec<f32> { (0..n).map(|nth| uniform_hash(key + nth) - 0.5).collect() };
        let (mut a, b) = (numbers(5 * 30, 1), numbers(30 * 19, 1000));
        // Many lamps light no patch.
        a.iter_mut().filter(|x| **x < 0.0).for_each(|x| *x = 0.0);
        for (at, found) in product(&a, &b, 19).iter().enumerate() {
            let expected: f32 = (0..30).map(|k| a[at / 19 * 30 + k] * b[k * 19 + at % 19]).sum();
            assert!((found - expected).abs() < 1e-5, "{found} for {expected}");
        }
    }
}
