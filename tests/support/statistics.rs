//! Means with their uncertainty, so that tolerances are derived and not chosen by eye.

/// A mean of independent values.
#[derive(Clone, Copy, Debug)]
pub struct Mean {
    /// The mean.
    pub value: f64,
    /// Its standard error.
    pub error: f64,
}

impl Mean {
    /// Mean of values that are independent of each other.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Mean {
        let values: Vec<f64> = values.into_iter().collect();
        let n = values.len() as f64;
        let value = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - value).powi(2)).sum::<f64>() / (n - 1.0);
        Mean { value, error: (variance / n).sqrt() }
    }

    /// Asserts that the mean is `expected`: within four standard errors plus `slack`, a bias that is known and allowed.
    /// The standard error must be below `sharpness`, or the test could not fail.
    #[track_caller]
    pub fn assert_is(&self, expected: f64, slack: f64, sharpness: f64) {
        let off = self.value - expected;
        let told = format!("{} ± {} for {expected}: off by {off:+.2e}, slack {slack:.1e}", self.value, self.error);
        println!("{told}");
        assert!(self.error < sharpness, "{told}: too blurred to say anything, wanted below ± {sharpness:.1e}");
        assert!(off.abs() <= 4.0 * self.error + slack, "{told}: more than four standard errors");
    }
}

/// Means of square tiles of a picture, row by row; border tiles are left out where they are not whole.
pub fn block_means(values: &[f64], width: usize, tile: usize) -> Vec<f64> {
    let (tiles_x, tiles_y) = (width / tile, values.len() / width / tile);
    let mut means = vec![0.0; tiles_x * tiles_y];
    for (row, line) in values.chunks_exact(width).take(tiles_y * tile).enumerate() {
        for (column, value) in line.iter().take(tiles_x * tile).enumerate() {
            means[row / tile * tiles_x + column / tile] += value / (tile * tile) as f64;
        }
    }
    means
}
