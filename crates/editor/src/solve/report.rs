//! What came of the wishes, for people and programs.

use clerestory_transport::light::{LightRig, LightSetting};
use serde_json::{Value, json};

use crate::legend::number_words;
use crate::look::Look;

/// A miss over what is wanted that counts as met.
const MET: f64 = 0.02;
/// A picture that is off by so much counts as matched.
const MATCHED: f64 = 0.05;

/// What a wish came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Of which wish.
    pub name: String,
    /// Unit of the numbers.
    pub unit: &'static str,
    /// What was wanted.
    pub wanted: f64,
    /// What it was.
    pub before: f64,
    /// What it is now.
    pub reached: f64,
    /// Whether that is as good as wanted.
    pub is_met: bool,
    /// Why it is not, or what else there is to say.
    pub remark: Option<String>,
    /// Exposure that suits a picture best, EV.
    pub exposure_ev: Option<f64>,
}

/// What became of a light.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// Key of the light.
    pub key: String,
    /// As it was.
    pub before: LightSetting,
    /// As it is to be.
    pub after: LightSetting,
    /// Whether it is at the lower (0) or the upper bound (1).
    pub at_bound: Option<usize>,
}

/// The lights that come closest to some wishes.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// All lights as they are to be.
    pub rig: LightRig,
    /// Every light that was free to change.
    pub changes: Vec<Change>,
    /// Every wish but those to keep.
    pub outcomes: Vec<Outcome>,
    /// Root mean square of how far wishes are missed, over what is wanted.
    pub misfit: f64,
    /// What there is to know.
    pub notes: Vec<String>,
}

/// What the miss of a mean is measured by: what is wanted, at least a hundredth of what there was, of any size but zero.
pub(super) fn size_of(wanted: f64, before: f64) -> f64 {
    wanted.abs().max(0.01 * before.abs()).max(f64::from(f32::MIN_POSITIVE))
}

impl Outcome {
    /// Of a mean that lights can bring to any value of a range.
    pub(super) fn of_mean(
        (name, unit): (&str, &'static str),
        [wanted, before, reached]: [f64; 3],
        [least, most]: [f64; 2],
        [_, upper]: [f64; 2],
    ) -> Outcome {
        let is_met = (reached - wanted).abs() <= MET * size_of(wanted, before);
        let remark = (!is_met).then(|| {
            if wanted > most {
                let most = number_words(most as f32);
                format!(
                    "cannot be reached: these lights give {most} {unit} at most, all of them at {}×",
                    number_words(upper as f32)
                )
            } else if wanted < least {
                format!("cannot be reached: {} {unit} stay whatever these lights do", number_words(least as f32))
            } else {
                "other wishes, or what is to be kept, are in the way".into()
            }
        });
        Outcome { name: name.into(), unit, wanted, before, reached, is_met, remark, exposure_ev: None }
    }

    /// Of a picture, in percent that it is off; `trust` is the share of it that could be matched.
    pub(super) fn of_picture(name: &str, [before, reached]: [f64; 2], exposure_ev: f64, trust: f64) -> Outcome {
        let remark = (trust < 0.8).then(|| {
            format!(
                "{:.0} % of it counted for little: no setting of these lights looks like that",
                100.0 * (1.0 - trust)
            )
        });
        Outcome {
            name: name.into(),
            unit: "% off",
            wanted: 0.0,
            before,
            reached,
            is_met: reached <= 100.0 * MATCHED,
            remark,
            exposure_ev: Some(exposure_ev),
        }
    }

    /// Of a picture without light, given how much light there was and how much is left: there is nothing to tell that over but what there
    /// was. It is met as a mean of nothing is.
    pub(super) fn of_black(name: &str, [before, left]: [f64; 2]) -> Outcome {
        let there = before.max(f64::from(f32::MIN_POSITIVE));
        let off = |light: f64| 100.0 * light / there;
        Outcome {
            name: name.into(),
            unit: "% off",
            wanted: 0.0,
            before: off(before),
            reached: off(left),
            is_met: left <= MET * size_of(0.0, before),
            remark: Some("it is black, so that the light that is left is told over what there was".into()),
            exposure_ev: Some(0.0),
        }
    }

    /// How far it is missed: over what is wanted, of a picture what it is off.
    pub fn miss(&self) -> f64 {
        match self.exposure_ev {
            Some(_) => 0.01 * self.reached,
            None => (self.reached - self.wanted).abs() / size_of(self.wanted, self.before),
        }
    }

    /// In words: what was wanted, and what it came to.
    pub fn words(&self) -> String {
        let number = |x: f64| number_words(x as f32);
        let remark = self.remark.as_ref().map_or(String::new(), |remark| format!("; {remark}"));
        match self.exposure_ev {
            Some(ev) => format!(
                "{}: {} % off, was {} % (at {:+.2} EV){remark}",
                self.name,
                number(self.reached),
                number(self.before),
                // Not "-0.00".
                (100.0 * ev).round() / 100.0 + 0.0
            ),
            None => format!(
                "{}: {} {unit} of {} {unit} wanted, was {} {unit}{remark}",
                self.name,
                number(self.reached),
                number(self.wanted),
                number(self.before),
                unit = self.unit
            ),
        }
    }
}

impl Change {
    /// Whether anything of it is seen.
    pub fn is_change(&self) -> bool {
        let (a, b) = (self.before.intensity, self.after.intensity);
        (a - b).abs() > 1e-3 * a.max(b)
            || self.before.color != self.after.color
            || self.before.kelvin != self.after.kelvin
    }

    /// In words, for a light of that name: from, to, and whether a bound holds it.
    pub fn words(&self, name: &str) -> String {
        let number = |x: f32| number_words(x);
        let color = match self.after.color {
            Some([r, g, b]) if self.after.color != self.before.color => {
                format!(", color {} {} {}", number(r), number(g), number(b))
            }
            _ => String::new(),
        };
        let bound = match self.at_bound {
            Some(0) if self.after.intensity > 0.0 => ", its least",
            Some(0) => ", off",
            Some(_) => ", its most",
            None => "",
        };
        format!("{name}: {}× to {}×{color}{bound}", number(self.before.intensity), number(self.after.intensity))
    }
}

impl Solution {
    /// A table for people, with lights as a look calls them.
    pub fn words(&self, look: &Look) -> String {
        let mut lines: Vec<String> = self.outcomes.iter().map(Outcome::words).collect();
        lines.push(format!("Residual {:.2} %", 100.0 * self.misfit));
        let changed = self.changes.iter().filter(|change| change.is_change());
        let changed: Vec<String> = changed.map(|change| change.words(look.name_of(&change.key))).collect();
        lines.push(format!("{} of {} lights change", changed.len(), self.changes.len()));
        lines.extend(changed.into_iter().map(|line| format!("  {line}")));
        lines.join("\n")
    }

    /// For programs.
    pub fn json(&self) -> Value {
        let outcome = |o: &Outcome| {
            json!({ "name": o.name, "unit": o.unit, "wanted": o.wanted, "before": o.before, "reached": o.reached, "met": o.is_met,
                "remark": o.remark, "exposure_ev": o.exposure_ev })
        };
        let change = |c: &Change| {
            let bound = c.at_bound.map(|which| ["least", "most"][which]);
            json!({ "light": c.key, "before": c.before.intensity, "after": c.after.intensity, "color": c.after.color, "bound": bound })
        };
        json!({
            "wishes": self.outcomes.iter().map(outcome).collect::<Vec<_>>(),
            "lights": self.changes.iter().map(change).collect::<Vec<_>>(),
            "residual": self.misfit,
            "notes": self.notes,
        })
    }
}
