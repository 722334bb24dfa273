//! What one half of a block says of its own samples. It decides whether the *other* half goes on.
//!
//! A half that decided on itself would stop when a rare, large sample happens to be missing, and go on when there is one: the
//! mean of its values would be too small. So the halves change places. A half that is told to stop is still sampled while the
//! other one waits for its word, but these samples count in no mean: how many they are depends on their own values.

use crate::{
    compress::{BlockSamples, CompressConfig, CompressError, fill},
    means::Means,
    project::{error_share, noise_share, product_noise_share},
    random::Random,
};

/// Share of what is allowed up to which an error is enough: fits to a part are a little worse than those to a half.
const ENOUGH: f64 = 1.05;
/// Share of what is allowed up to which an error that was not fitted is believed to be enough, and from which too much.
const BELIEVED: [f64; 2] = [0.75, 1.5];
/// An error that was fitted with more noise than this many times the present one says nothing of what would be enough.
const MOST_NOISE: f64 = 3.0;

/// What one half has said of a block so far.
#[derive(Default)]
pub(crate) struct Judge {
    /// The group that was not content: it is asked first.
    group: usize,
    fitted: Option<Fitted>,
}

/// What a fit told of the group that was not content, over what is allowed.
#[derive(Clone, Copy)]
struct Fitted {
    noise: f64,
    error: f64,
}

impl Judge {
    /// Is every group of columns exact enough, and the product that it preserves by itself, if what is not asked is as noisy as what
    /// is? `parts` are two samplings that were not compared before, and `remaining` the share of the variance of their mean that the
    /// mean of all will have.
    ///
    /// # Errors
    /// Samples that are not finite.
    pub(crate) fn is_content(
        &mut self,
        parts: &BlockSamples<'_>,
        remaining: f64,
        config: &CompressConfig,
        block_idx: u32,
        means: &mut Means,
    ) -> Result<bool, CompressError> {
        if parts.n_samples.contains(&0) {
            return Ok(false);
        }
        let first = self.group;
        for nth in (first..config.groups.len()).chain(0..first) {
            let group = &config.groups[nth];
            let tolerance = group.tolerance;
            fill(means, parts, group, block_idx)?;
            let known = self.fitted.filter(|_| nth == first);
            // One column may be all that a product asks for: its noise is little in the mean of many.
            if remaining * product_noise_share(means, &group.preserved, tolerance) > ENOUGH {
                *self = Self { group: nth, fitted: known };
                return Ok(false);
            }
            let noise = remaining * noise_share(means, tolerance);
            if let Some(is_content) = without_fit(noise, means.mean.n_rows.min(means.mean.n_cols), known) {
                if is_content {
                    continue;
                }
                *self = Self { group: nth, fitted: known };
                return Ok(false);
            }
            let rng = Random::new([config.seed, u64::from(block_idx)]);
            let error = error_share(means, parts.bundle_len, tolerance, remaining, config, rng);
            if error > ENOUGH {
                *self = Self { group: nth, fitted: Some(Fitted { noise, error }) };
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// What noise alone tells, or noise and an earlier fit: errors fall about as noise does.
fn without_fit(noise: f64, smaller_side: usize, known: Option<Fitted>) -> Option<bool> {
    if noise <= 0.5 {
        return Some(true);
    }
    // A single component carries so much of the noise.
    if noise > smaller_side as f64 {
        return Some(false);
    }
    let known = known?;
    let error = known.error * noise / known.noise;
    if error > BELIEVED[1] {
        return Some(false);
    }
    (error <= BELIEVED[0] && known.noise <= MOST_NOISE * noise).then_some(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fit_is_asked_for_only_where_it_decides() {
        let fitted = |error| Some(Fitted { noise: 20.0, error });
        assert_eq!(without_fit(0.5, 64, None), Some(true));
        assert_eq!(without_fit(65.0, 64, None), Some(false));
        assert_eq!(without_fit(64.0, 64, None), None);
        // Half of the noise, half of the error.
        assert_eq!(without_fit(10.0, 64, fitted(1.4)), Some(true));
        assert_eq!(without_fit(10.0, 64, fitted(2.0)), None);
        assert_eq!(without_fit(10.0, 64, fitted(3.2)), Some(false));
        // Another large sample; a fit of long ago.
        assert_eq!(without_fit(40.0, 64, fitted(1.4)), Some(false));
        assert_eq!(without_fit(2.0, 64, fitted(6.0)), None);
    }
}
