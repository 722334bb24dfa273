//! Names of methods, as a command line takes them: `svd`, `aca-full`, `alg4:qr`, `alg4:pinv=0.01`, `kernel=0.25`.

use std::fmt;
use std::str::FromStr;

use super::{Core, Method};

/// A name that no method has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no method `{0}`; there are {names}", names = all_names())]
pub struct UnknownMethod(String);

fn all_names() -> String {
    Method::ALL.map(|method| method.to_string()).join(", ")
}

impl Core {
    /// Share of the largest singular value below which the pseudo-inverse takes the others for zero, unless told.
    pub const RCOND: f64 = 1e-3;
    /// Damping as a share of the largest singular value, unless told.
    pub const LAMBDA: f64 = 1e-3;

    /// Every core with its usual threshold.
    pub const ALL: [Core; 5] = [
        Core::Inverse,
        Core::PseudoInverse { rcond: Core::RCOND },
        Core::Tikhonov { lambda: Core::LAMBDA },
        Core::Qr,
        Core::Projection,
    ];
}

impl Method {
    /// Every method, the chosen rows and columns with every core.
    pub const ALL: [Method; 29] = {
        let mut all = [Method::Svd; 29];
        let mut i = 0;
        while i < Core::ALL.len() {
            all[i] = Method::Alg1(Core::ALL[i]);
            all[i + 5] = Method::Alg2(Core::ALL[i]);
            all[i + 10] = Method::Alg3(Core::ALL[i]);
            all[i + 15] = Method::Alg4(Core::ALL[i]);
            i += 1;
        }
        let others = [
            Method::Kernel { gamma: None },
            Method::Svd,
            Method::RowId,
            Method::DeimCur,
            Method::AcaPartial,
            Method::AcaFull,
            Method::GeneralizedNystrom,
            Method::CompressedSensing,
            Method::Projected,
        ];
        let mut i = 0;
        while i < others.len() {
            all[i + 20] = others[i];
            i += 1;
        }
        all
    };

    /// Keys of the papers that it follows, see `docs/references.md`.
    pub fn papers(self) -> &'static [&'static str] {
        match self {
            Method::Alg1(core) | Method::Alg2(core) | Method::Alg4(core) => match core {
                Core::Inverse | Core::PseudoInverse { .. } => &["Drineas2005", "Zhang2008"],
                Core::Tikhonov { .. } => &["Tikhonov1963", "Zhang2008"],
                Core::Qr => &["Stewart1999", "Zhang2008"],
                Core::Projection => &["Halko2011", "Zhang2008"],
            },
            Method::Alg3(core) => match core {
                Core::Inverse | Core::PseudoInverse { .. } => &["Drineas2005"],
                Core::Tikhonov { .. } => &["Tikhonov1963"],
                Core::Qr => &["Stewart1999"],
                Core::Projection => &["Halko2011"],
            },
            Method::Kernel { .. } => &["Wang2009"],
            Method::Svd => &["Eckart1936"],
            Method::RowId => &["Gu1996", "Cheng2005"],
            Method::DeimCur => &["Sorensen2016"],
            Method::AcaPartial | Method::AcaFull => &["Bebendorf2000"],
            Method::GeneralizedNystrom => &["Nakatsukasa2020"],
            Method::CompressedSensing => &["Peers2009", "Sen2009", "Tropp2007"],
            Method::Projected => &["Halko2011"],
        }
    }

    /// Why its result is no pair of low-rank factors, so that all entries of a block are kept where it makes factors of one;
    /// `None` where it is.
    pub fn without_factors(self) -> Option<&'static str> {
        match self {
            Method::Kernel { .. } => Some(
                "its entries are roots of a product, which no factors give: every product with a vector takes all entries",
            ),
            Method::CompressedSensing => {
                Some("its result is as many sparse coefficients per row, in a basis as wide as the matrix")
            }
            _ => None,
        }
    }

    /// Whether it is one of a kind: no algorithm that takes a core.
    pub fn is_by_itself(self) -> bool {
        !matches!(self, Method::Alg1(_) | Method::Alg2(_) | Method::Alg3(_) | Method::Alg4(_))
    }

    /// Whether the approximation is a product of factors, so that a product with a vector needs no entry of it.
    pub fn has_factors(self) -> bool {
        !matches!(self, Method::Kernel { .. })
    }
}

impl fmt::Display for Core {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Core::Inverse => f.write_str("inverse"),
            Core::PseudoInverse { rcond } => with_value(f, "pinv", *rcond, Core::RCOND),
            Core::Tikhonov { lambda } => with_value(f, "tikhonov", *lambda, Core::LAMBDA),
            Core::Qr => f.write_str("qr"),
            Core::Projection => f.write_str("projection"),
        }
    }
}

fn with_value(f: &mut fmt::Formatter<'_>, name: &str, value: f64, usual: f64) -> fmt::Result {
    if value == usual { f.write_str(name) } else { write!(f, "{name}={value}") }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self {
            Method::Alg1(core) => return write!(f, "alg1:{core}"),
            Method::Alg2(core) => return write!(f, "alg2:{core}"),
            Method::Alg3(core) => return write!(f, "alg3:{core}"),
            Method::Alg4(core) => return write!(f, "alg4:{core}"),
            Method::Kernel { gamma: Some(gamma) } => return write!(f, "kernel={gamma}"),
            Method::Kernel { gamma: None } => "kernel",
            Method::Svd => "svd",
            Method::RowId => "row-id",
            Method::DeimCur => "deim-cur",
            Method::AcaPartial => "aca-partial",
            Method::AcaFull => "aca-full",
            Method::GeneralizedNystrom => "generalized-nystrom",
            Method::CompressedSensing => "compressed-sensing",
            Method::Projected => "projected",
        };
        f.write_str(name)
    }
}

impl FromStr for Core {
    type Err = UnknownMethod;

    fn from_str(text: &str) -> Result<Self, UnknownMethod> {
        let (name, value) = with_positive(text)?;
        match (name, value) {
            ("inverse", None) => Ok(Core::Inverse),
            ("pinv", value) => Ok(Core::PseudoInverse { rcond: value.unwrap_or(Core::RCOND) }),
            ("tikhonov", value) => Ok(Core::Tikhonov { lambda: value.unwrap_or(Core::LAMBDA) }),
            ("qr", None) => Ok(Core::Qr),
            ("projection", None) => Ok(Core::Projection),
            _ => Err(UnknownMethod(text.into())),
        }
    }
}

impl FromStr for Method {
    type Err = UnknownMethod;

    fn from_str(text: &str) -> Result<Self, UnknownMethod> {
        let unknown = || UnknownMethod(text.into());
        if let Some((algorithm, core)) = text.split_once(':') {
            let core = core.parse().map_err(|_| unknown())?;
            return match algorithm {
                "alg1" => Ok(Method::Alg1(core)),
                "alg2" => Ok(Method::Alg2(core)),
                "alg3" => Ok(Method::Alg3(core)),
                "alg4" => Ok(Method::Alg4(core)),
                _ => Err(unknown()),
            };
        }
        match with_positive(text)? {
            ("kernel", gamma) => Ok(Method::Kernel { gamma }),
            // The others are called by the name that they have.
            _ => Method::ALL.into_iter().find(|method| method.to_string() == text).ok_or_else(unknown),
        }
    }
}

/// A name, and the positive number that follows it after an equals sign.
fn with_positive(text: &str) -> Result<(&str, Option<f64>), UnknownMethod> {
    let Some((name, value)) = text.split_once('=') else { return Ok((text, None)) };
    let value = value.parse::<f64>().ok().filter(|value| value.is_finite() && *value > 0.0);
    value.map(|value| (name, Some(value))).ok_or_else(|| UnknownMethod(text.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_read_back_and_no_two_are_alike() {
        let mut names = Vec::new();
        for method in Method::ALL {
            assert_eq!(method.to_string().parse(), Ok(method));
            assert!(!method.papers().is_empty());
            names.push(method.to_string());
        }
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), Method::ALL.len());
        for told in [Method::Alg2(Core::PseudoInverse { rcond: 0.01 }), Method::Kernel { gamma: Some(0.25) }] {
            assert_eq!(told.to_string().parse(), Ok(told));
        }
    }

    #[test]
    fn other_names_are_refused() {
        for name in
            ["", "SVD", "alg5:qr", "alg4", "alg4:", "alg4:pinv=0", "alg4:qr=1", "kernel=nan", "svd=2", "kernel=-1"]
        {
            assert_eq!(name.parse::<Method>().map_err(|error| error.0), Err(name.to_string()));
        }
    }
}
