//! How long a graphics device that failed is left alone before it is tried again.

/// Seconds of the first rest; each that follows a failure at once is twice as long.
const FIRST_SECS: f64 = 2.0;
/// Seconds of the longest.
const LONGEST_SECS: f64 = 64.0;

/// A device that works, or rests.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Rest {
    /// When it may be tried again, seconds; none while it works.
    until: Option<f64>,
    secs: f64,
}

impl Rest {
    /// It failed.
    pub fn begin(&mut self, now: f64) {
        self.secs = (2.0 * self.secs).clamp(FIRST_SECS, LONGEST_SECS);
        self.until = Some(now + self.secs);
    }

    /// Whether it is left alone, tried again or not.
    pub fn lasts(&self) -> bool {
        self.until.is_some()
    }

    /// Lets it be tried again if it has rested long enough; if it fails, it rests longer.
    pub fn try_again(&mut self, now: f64) {
        self.until = self.until.filter(|until| now < *until);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_that_fails_again_and_again_rests_longer_and_longer() {
        let mut rest = Rest::default();
        rest.try_again(0.0);
        assert!(!rest.lasts());
        let mut now = 10.0;
        for secs in [2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 64.0] {
            rest.begin(now);
            rest.try_again(now + secs - 0.1);
            assert!(rest.lasts(), "{secs}");
            now += secs;
            rest.try_again(now);
            assert!(!rest.lasts(), "{secs}");
        }
        rest = Rest::default();
        rest.begin(now);
        rest.try_again(now + 2.0);
        assert!(!rest.lasts(), "one that worked meanwhile starts over");
    }
}
