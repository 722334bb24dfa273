//! What a method made of a case, and how a table tells it.

use anyhow::{Context, Result};
use clerestory_nystrom::rivals::{Method, MethodError, Real};
use clerestory_nystrom::stress::{Case, FLOOR, Ours, Stored, ours, rival, stored};
use serde::{Deserialize, Serialize};

/// What a method made of a case.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub enum Answer {
    /// Error over the optimum, and whether it is within twice the optimum and a millionth of the norm.
    Error { ratio: f64, is_within: bool },
    /// It named an entry that is no number.
    Refused,
    /// It found W without an inverse.
    Singular,
    /// It gave up for another reason.
    GaveUp,
}

/// A case with what is known of it.
pub struct Measured {
    /// The case.
    pub case: Case,
    /// Distance of the best approximation.
    pub optimum: f64,
    /// What ours made of it.
    pub ours: Ours,
    /// What a bake would.
    pub stored: Stored,
}

impl Measured {
    /// Compresses it, to its rank and as a bake does.
    ///
    /// # Errors
    /// If ours has no answer.
    pub fn new(case: Case) -> Result<Self> {
        let ours = ours(&case).with_context(|| format!("the case {}", case.name))?;
        let stored = stored(&case).with_context(|| format!("the case {}", case.name))?;
        Ok(Self { optimum: case.optimum(), case, ours, stored })
    }

    /// An error as the tables tell it.
    pub fn answer(&self, error: f64) -> Answer {
        // An optimum below what single precision holds counts as that.
        let least = self.optimum.max(FLOOR * self.case.norm());
        // A matrix of zeros that comes out as zeros.
        let ratio = if error == 0.0 { 0.0 } else { error / least };
        Answer::Error { ratio, is_within: error <= self.case.allowed_beside(self.optimum) }
    }

    /// What another method makes of it.
    pub fn rival<S: Real>(&self, method: Method) -> Answer {
        match rival::<S>(&self.case, method, super::SEED) {
            Ok(error) => self.answer(error),
            Err(error) => refusal(&error),
        }
    }
}

/// A method without an answer.
pub fn refusal(error: &MethodError) -> Answer {
    match error {
        MethodError::NonFinite { .. } => Answer::Refused,
        MethodError::Singular { .. } => Answer::Singular,
        _ => Answer::GaveUp,
    }
}

impl Answer {
    /// Few characters.
    pub fn words(self) -> String {
        match self {
            Answer::Error { ratio, .. } => figure(ratio),
            Answer::Refused => "refused".into(),
            Answer::Singular => "singular".into(),
            Answer::GaveUp => "gave up".into(),
        }
    }

    /// For the worst and the middle of many: no answer is worse than any.
    pub fn ratio(self) -> f64 {
        if let Answer::Error { ratio, .. } = self { ratio } else { f64::INFINITY }
    }

    /// Whether it keeps the bound.
    pub fn is_within(self) -> bool {
        matches!(self, Answer::Error { is_within: true, .. })
    }
}

/// Three digits at most, few characters at any magnitude.
pub fn figure(x: f64) -> String {
    if !x.is_finite() {
        "inf".into()
    } else if x == 0.0 {
        "0".into()
    } else if (0.005..9.95).contains(&x) {
        format!("{x:.2}")
    } else if (9.95..999.5).contains(&x) {
        format!("{x:.0}")
    } else {
        format!("{x:.0e}")
    }
}
