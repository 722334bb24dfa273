//! Names of methods, as a command line takes them: `svd`, `aca-full`, `alg4:qr`, `alg4:pinv=0.01`, `kernel=0.25`,
//! `kernel:rcond=0.01`.

use std::fmt;
use std::str::FromStr;

use super::{Core, Method};

/// A name that no method has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no method `{0}`; there are {names}", names = all_names())]
pub struct UnknownMethod(String);

fn all_names() -> String {
    Method::every().map(|method| method.to_string()).collect::<Vec<_>>().join(", ")
}

impl Core {
    /// Share of the largest singular value below which the pseudo-inverse takes the others for zero, unless told.
    pub const RCOND: f64 = 1e-3;
    /// Damping as a share of the largest singular value, unless told. Of 10⁻¹ to 10⁻⁴ the one that serves Algorithm 4 best on two
    /// dense matrices in blocks of 768 × 256, hardly any noise in them: at ranks 4, 16 and 32 what it leaves of one is 12.0, 23.3
    /// and 27.6 dB below its energy, of the other −2.8, 1.5 and 7.5 dB (10⁻³: 4.1, 19.8, 27.7 and −17.1, −2.6, 0.7; 10⁻¹: 12.2, 17.0,
    /// 17.8 and 1.3, 4.6, 7.8). Much noise calls for more.
    pub const LAMBDA: f64 = 1e-2;

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
    /// Share of the largest singular value up to which the kernel takes the others for zero, unless told. Of 10⁻¹ to 10⁻⁴ the best on
    /// the matrices that [`Core::LAMBDA`] was measured on: 11.8, 23.3, 27.2 and −2.5, 5.8, 11.2 dB at ranks 4, 16 and 32 (10⁻³: −19.1,
    /// 22.3, 28.5 and −56.4, 3.2, 12.7; 10⁻¹: 11.9, 16.7, 16.8 and 1.3, 4.1, 7.3). Much noise calls for more.
    pub const KERNEL_RCOND: f64 = 1e-2;

    /// The kernel with its usual threshold, the power found.
    pub const KERNEL: Method = Method::Kernel { gamma: None, rcond: Method::KERNEL_RCOND };

    /// Every method, the chosen rows and columns with every core; but for [`Method::Alg4Union`], a variant to be held against
    /// [`Method::Alg4`].
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
            Method::KERNEL,
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

    /// Those of [`Method::ALL`], and the variants that it leaves out: all that a name which does not exist is answered with.
    pub fn every() -> impl Iterator<Item = Method> {
        Method::ALL.into_iter().chain(Core::ALL.map(Method::Alg4Union))
    }

    /// Keys of the papers that it follows, see `docs/references.md`.
    pub fn papers(self) -> &'static [&'static str] {
        match self {
            Method::Alg1(core) | Method::Alg2(core) | Method::Alg4(core) | Method::Alg4Union(core) => match core {
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

    /// Why its result is no pair of low-rank factors of a block, whose entries are all kept in their place; `None` where it is.
    pub fn without_factors(self) -> Option<&'static str> {
        match self {
            Method::Kernel { .. } => Some(
                "its entries are roots of a product, which no factors give: every product with a vector takes all entries",
            ),
            Method::CompressedSensing => Some(
                "each row has a few coefficients of its own in Haar's basis: enough for products, but no factors of a low rank",
            ),
            _ => None,
        }
    }

    /// Whether it is one of a kind: no algorithm that takes a core.
    pub fn is_by_itself(self) -> bool {
        !matches!(self, Method::Alg1(_) | Method::Alg2(_) | Method::Alg3(_) | Method::Alg4(_) | Method::Alg4Union(_))
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
            Method::Alg4Union(core) => return write!(f, "alg4-union:{core}"),
            Method::Kernel { gamma, rcond } => {
                let power = gamma.map_or(String::new(), |gamma| format!("={gamma}"));
                let threshold = if *rcond == Method::KERNEL_RCOND { String::new() } else { format!(":rcond={rcond}") };
                return write!(f, "kernel{power}{threshold}");
            }
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
        let with_core = |algorithm: fn(Core) -> Method, core: &str| core.parse().map(algorithm).map_err(|_| unknown());
        match text.split_once(':') {
            Some(("alg1", core)) => with_core(Method::Alg1, core),
            Some(("alg2", core)) => with_core(Method::Alg2, core),
            Some(("alg3", core)) => with_core(Method::Alg3, core),
            Some(("alg4", core)) => with_core(Method::Alg4, core),
            Some(("alg4-union", core)) => with_core(Method::Alg4Union, core),
            Some((kernel, threshold)) => match (with_positive(kernel), with_positive(threshold)) {
                (Ok(("kernel", gamma)), Ok(("rcond", Some(rcond)))) => Ok(Method::Kernel { gamma, rcond }),
                _ => Err(unknown()),
            },
            None => match with_positive(text)? {
                ("kernel", gamma) => Ok(Method::Kernel { gamma, rcond: Method::KERNEL_RCOND }),
                // The others are called by the name that they have.
                _ => Method::ALL.into_iter().find(|method| method.to_string() == text).ok_or_else(unknown),
            },
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
        for method in Method::every() {
            assert_eq!(method.to_string().parse(), Ok(method));
            assert!(!method.papers().is_empty());
            names.push(method.to_string());
        }
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), Method::ALL.len() + Core::ALL.len());
        let told = UnknownMethod("svd:qr".into()).to_string();
        assert!(names.iter().all(|name| told.contains(&format!(" {name}"))), "{told}");
        for (told, name) in [
            (Method::Alg2(Core::PseudoInverse { rcond: 0.25 }), "alg2:pinv=0.25"),
            (Method::Alg4Union(Core::Qr), "alg4-union:qr"),
            (Method::Kernel { gamma: Some(0.25), rcond: Method::KERNEL_RCOND }, "kernel=0.25"),
            (Method::Kernel { gamma: None, rcond: 0.5 }, "kernel:rcond=0.5"),
            (Method::Kernel { gamma: Some(0.25), rcond: 0.5 }, "kernel=0.25:rcond=0.5"),
        ] {
            assert_eq!((told.to_string().as_str(), name.parse()), (name, Ok(told)));
        }
    }

    #[test]
    fn other_names_are_refused() {
        let of_cores = ["alg5:qr", "alg4", "alg4:", "alg4:pinv=0", "alg4:qr=1", "alg4-union", "svd:qr"];
        let of_kernels = ["kernel=nan", "kernel=-1", "kernel:", "kernel:rcond", "kernel:rcond=0", "kernel:pinv=1"];
        for name in ["", "SVD", "svd=2"].into_iter().chain(of_cores).chain(of_kernels) {
            assert_eq!(name.parse::<Method>().map_err(|error| error.0), Err(name.to_string()));
        }
    }
}
