//! Whether what is aimed at is kept.

use super::fit::{median, to_tenths};

/// Which side of a number is good.
#[derive(Clone, Copy)]
pub enum Goal {
    Most(f64),
    Least(f64),
}

impl Goal {
    /// `kept` or `missed`.
    pub fn word(self, value: f64) -> &'static str {
        if self.is_kept(value) { "kept" } else { "missed" }
    }

    /// Whether a value is on the right side.
    pub fn is_kept(self, value: f64) -> bool {
        match self {
            Goal::Most(most) => value <= most,
            Goal::Least(least) => value >= least,
        }
    }

    /// Whether all keep it, else how many do; and the median.
    pub fn of_many(self, values: &[f64], words: impl Fn(f64) -> String) -> String {
        let Some(median) = median(values).map(words) else { return "none".into() };
        let (n_kept, n) = (values.iter().filter(|value| self.is_kept(**value)).count(), values.len());
        if n_kept == n {
            format!("kept by all {n}, median {median}")
        } else {
            format!("missed: kept by {n_kept} of {n}, median {median}")
        }
    }
}

/// Whether no gain in dB falls below nothing, to the tenth that it is told to, and where the least is.
pub fn gains_words(gains: &[(String, f64)]) -> String {
    let worst = gains.iter().min_by(|a, b| a.1.total_cmp(&b.1));
    worst.map_or("nothing to tell".into(), |(name, db)| {
        let db = to_tenths(*db);
        format!("{}: {db:+.1} dB at worst ({name})", Goal::Least(0.0).word(db))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_goal_is_kept_where_all_keep_it() {
        let told = |goal: Goal, values: &[f64]| goal.of_many(values, |share| format!("{:.1} %", 100.0 * share));
        assert_eq!(told(Goal::Most(0.05), &[0.02, 0.04, 0.09]), "missed: kept by 2 of 3, median 4.0 %");
        assert_eq!(told(Goal::Least(0.05), &[0.02, 0.09]), "missed: kept by 1 of 2, median 5.5 %");
        assert_eq!(told(Goal::Least(0.02), &[0.02, 0.09]), "kept by all 2, median 5.5 %");
        assert_eq!(told(Goal::Most(0.05), &[]), "none");
    }

    #[test]
    fn the_worst_gain_is_named_with_whether_it_is_one() {
        let gains = |db: [f64; 2]| gains_words(&[("a hall".into(), db[0]), ("a room".into(), db[1])]);
        assert_eq!(gains([2.0, -0.5]), "missed: -0.5 dB at worst (a room)");
        assert_eq!(gains([0.0, 1.5]), "kept: +0.0 dB at worst (a hall)");
        assert_eq!(gains([-0.001, 1.5]), "kept: +0.0 dB at worst (a hall)");
        assert_eq!(gains_words(&[]), "nothing to tell");
    }
}
