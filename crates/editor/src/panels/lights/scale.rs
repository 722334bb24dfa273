//! In what the numbers of intensities are told: times the file, stops, or photometric units.

use clerestory_transport::lamps::LampUnit;
use clerestory_transport::light::LightSetting;
use eframe::egui::{Response, Ui};
use serde::{Deserialize, Serialize};

use super::listed::Listed;
use crate::panels::number::{Number, beside};

/// What a designer counts in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Scale {
    /// Times what the file says.
    #[default]
    Factor,
    /// Stops above what the file says.
    Stops,
    /// Luminous flux.
    Lumen,
    /// Luminous intensity.
    Candela,
    /// Illuminance of parallel light.
    Lux,
    /// Luminance.
    Nit,
    /// Power that a profile states, else that at a luminous efficacy.
    Watt,
}

/// Power of ideal white light by glTF's and Blender's count, lumen per watt.
pub(super) const IDEAL_EFFICACY: f32 = clerestory_transport::lamp_units::LUMENS_PER_WATT;
/// Points on either side of a number in its field.
const PADDING: f32 = 4.0;
/// Upper end of factors in numbers.
const FACTOR_MAX: f64 = 1e6;
/// Stops at which a light counts as off.
const OFF_EV: f64 = -20.0;

impl Scale {
    /// All of them, in the order of the menu.
    pub const ALL: [Scale; 7] =
        [Scale::Factor, Scale::Stops, Scale::Lumen, Scale::Candela, Scale::Lux, Scale::Nit, Scale::Watt];

    /// As it stands behind a number.
    pub fn name(self) -> &'static str {
        match self {
            Scale::Factor => "×",
            Scale::Stops => "EV",
            Scale::Lumen => "lm",
            Scale::Candela => "cd",
            Scale::Lux => "lx",
            Scale::Nit => "nit",
            Scale::Watt => "W",
        }
    }

    /// For the menu.
    pub fn words(self) -> &'static str {
        match self {
            Scale::Factor => "× the file",
            Scale::Stops => "EV, stops above the file",
            Scale::Lumen => "lm, luminous flux",
            Scale::Candela => "cd, luminous intensity",
            Scale::Lux => "lx, of parallel light",
            Scale::Nit => "nit, luminance",
            Scale::Watt => "W, electrical power",
        }
    }

    fn unit(self) -> Option<LampUnit> {
        match self {
            Scale::Lumen | Scale::Watt => Some(LampUnit::Lumen),
            Scale::Candela => Some(LampUnit::Candela),
            Scale::Lux => Some(LampUnit::Lux),
            Scale::Nit => Some(LampUnit::Nit),
            Scale::Factor | Scale::Stops => None,
        }
    }

    /// How a light is counted on this scale. Where that does not follow from its kind, it is counted as its file does, else in
    /// factors.
    pub(super) fn measure(self, light: &Listed, setting: &LightSetting, efficacy: f32) -> Measure {
        let Some(unit) = self.unit() else { return self.of_group() };
        if self == Scale::Watt
            && let Some(watts) = light.watts()
        {
            return Measure::Amount { at_one: f64::from(watts), unit: self.name() };
        }
        let one = LightSetting { intensity: 1.0, ..*setting };
        let amount = |unit| light.amount(&one, unit).filter(|at_one| *at_one > 0.0).map(f64::from);
        if let Some(at_one) = amount(unit) {
            let efficacy = if self == Scale::Watt { f64::from(efficacy) } else { 1.0 };
            return Measure::Amount { at_one: at_one / efficacy, unit: self.name() };
        }
        let own = light.own_unit().and_then(|unit| Some((amount(unit)?, unit.name())));
        own.map_or(Measure::Factor, |(at_one, unit)| Measure::Amount { at_one, unit })
    }

    /// How a group is counted: it has no units of its own.
    pub fn of_group(self) -> Measure {
        if self == Scale::Stops { Measure::Stops } else { Measure::Factor }
    }
}

/// How the intensity of one light becomes a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measure {
    /// The number is the factor.
    Factor,
    /// The number is its logarithm to base 2.
    Stops,
    /// The number is an amount of light.
    Amount {
        /// Amount at intensity 1.
        at_one: f64,
        /// Its unit.
        unit: &'static str,
    },
}

impl Measure {
    /// The number of an intensity.
    pub fn number(self, intensity: f32) -> f64 {
        match self {
            Measure::Factor => f64::from(intensity),
            Measure::Stops => f64::from(intensity).log2().max(OFF_EV),
            Measure::Amount { at_one, .. } => at_one * f64::from(intensity),
        }
    }

    /// The intensity of a number.
    pub fn intensity(self, number: f64) -> f32 {
        let factor = match self {
            Measure::Factor => number,
            Measure::Stops if number <= OFF_EV => 0.0,
            Measure::Stops => number.exp2(),
            Measure::Amount { at_one, .. } => number / at_one,
        };
        factor.clamp(0.0, FACTOR_MAX) as f32
    }

    /// What stands behind the number.
    pub fn unit(self) -> &'static str {
        match self {
            Measure::Factor => Scale::Factor.name(),
            Measure::Stops => Scale::Stops.name(),
            Measure::Amount { unit, .. } => unit,
        }
    }

    /// Digits of a number, without its unit.
    pub fn digits(self, number: f64) -> String {
        match self {
            Measure::Stops if number <= OFF_EV => "off".into(),
            Measure::Stops => format!("{number:+.2}"),
            Measure::Factor | Measure::Amount { .. } => digits(number),
        }
    }

    /// Number and unit of an intensity.
    pub fn words(self, intensity: f32) -> String {
        let space = if self == Measure::Factor { "" } else { " " };
        format!("{}{space}{}", self.digits(self.number(intensity)), self.unit())
    }
}

/// As many digits as are told apart, in a width that does not change under a fader that is dragged.
pub(super) fn digits(number: f64) -> String {
    match number {
        n if n < 9.995 => format!("{n:.2}"),
        n if n < 99.95 => format!("{n:.1}"),
        n if n < 9999.5 => format!("{n:.0}"),
        n if n < 99_950.0 => format!("{:.1}k", n / 1000.0),
        n => format!("{:.0}k", n / 1000.0),
    }
}

/// Other words for units.
const ALIASES: [(&str, &[&str]); 7] = [
    ("lm", &["lumen", "lumens"]),
    ("cd", &["candela", "candelas"]),
    ("lx", &["lux"]),
    ("nit", &["nits", "cd/m²", "cd/m2"]),
    ("W", &["w", "watt", "watts"]),
    ("EV", &["ev", "stops", "stop"]),
    ("×", &["x", "times"]),
];

/// A number that was typed, in a measure. `k` behind it stands for thousands, `%` for a share of what the file says, and its own unit may
/// follow; another unit is no answer.
fn typed(text: &str, measure: Measure) -> Option<f64> {
    let text = text.trim();
    if text.eq_ignore_ascii_case("off") {
        return Some(measure.number(0.0));
    }
    let end = text.find(|c: char| !(c.is_ascii_digit() || "+-.,".contains(c))).unwrap_or(text.len());
    let (number, unit) = (&text[..end], text[end..].trim());
    let number = with_a_point(number, measure)?.parse::<f64>().ok().filter(|number| number.is_finite())?;
    if unit == "%" {
        return Some(measure.number((number / 100.0).clamp(0.0, FACTOR_MAX) as f32));
    }
    let (thousands, unit) = unit.strip_prefix('k').map_or((1.0, unit), |rest| (1000.0, rest.trim_start()));
    let own = measure.unit();
    let is_alias = || ALIASES.iter().any(|(name, words)| *name == own && words.contains(&unit));
    (unit.is_empty() || unit == own || is_alias()).then_some(number * thousands)
}

/// Digits with a point before the fraction and nothing between thousands. Of a point and a comma the later one stands before the fraction;
/// a mark that stands several times sets thousands apart, and so does a single comma of an amount where it can. Nothing where marks stand
/// otherwise.
fn with_a_point(number: &str, measure: Measure) -> Option<String> {
    let is_amount = matches!(measure, Measure::Amount { .. });
    let at = match [number.matches('.').count(), number.matches(',').count()] {
        [1, 0] => number.find('.'),
        [0, 1] if !(is_amount && are_thousands(number)) => number.find(','),
        [_, 0] | [0, _] => None,
        _ => number.rfind(['.', ',']),
    };
    let (whole, fraction) = at.map_or((number, ""), |at| (&number[..at], &number[at + 1..]));
    let is_plain = !whole.contains(['.', ',']);
    (is_plain || are_thousands(whole)).then(|| format!("{}.{fraction}", whole.replace(['.', ','], "")))
}

/// Whether marks of one kind stand where they set thousands apart: 5,000 but not 0,125.
fn are_thousands(whole: &str) -> bool {
    let digits = whole.trim_start_matches(['+', '-']);
    let mark = if digits.contains('.') { '.' } else { ',' };
    let is_group = |group: &str| group.len() == 3 && group.chars().all(|c| c.is_ascii_digit());
    let mut groups = digits.split(mark);
    let first = groups.next().unwrap_or_default();
    (1..=3).contains(&first.len())
        && first.chars().all(|c| c.is_ascii_digit())
        && !first.starts_with('0')
        && groups.all(is_group)
}

/// How a number is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shown {
    /// With its unit behind it.
    WithUnit,
    /// Its unit stands elsewhere.
    Bare,
    /// The lights have several; a word stands in its place.
    Mixed,
}

/// The number of an intensity, to drag (with Shift finely) and to type. Answers whether it was changed.
pub(super) fn number_ui(
    ui: &mut Ui,
    label: &str,
    (measure, shown): (Measure, Shown),
    intensity: &mut f32,
    width: f32,
) -> Response {
    // Stops of a light that is off are counted from the file: where they are off, twenty more would not be seen.
    let is_off = measure == Measure::Stops && *intensity == 0.0;
    let mut number = if is_off { beside(0.0, OFF_EV) } else { measure.number(*intensity) };
    let off = Some(number).filter(|_| is_off);
    let range = match measure {
        Measure::Stops => OFF_EV..=FACTOR_MAX.log2(),
        Measure::Factor | Measure::Amount { .. } => 0.0..=measure.number(FACTOR_MAX as f32),
    };
    if shown == Shown::Mixed {
        number = beside(number, *range.start());
    }
    let speed = if measure == Measure::Stops { 0.02 } else { (0.01 * number).max(measure.number(0.002)) };
    let suffix = match (shown, measure) {
        (Shown::WithUnit, Measure::Factor) => "×".to_owned(),
        (Shown::WithUnit, _) => format!(" {}", measure.unit()),
        (Shown::Bare | Shown::Mixed, _) => String::new(),
    };
    let drag = Number::new(&mut number).range(range).leaves_what_is_outside().speed(speed).suffix(suffix);
    let drag = drag.read(move |text| typed(text, measure));
    let drag = drag.words(move |number, _| match shown {
        Shown::Mixed => "mixed".into(),
        Shown::WithUnit | Shown::Bare if Some(number) == off => measure.digits(OFF_EV),
        Shown::WithUnit | Shown::Bare => measure.digits(number),
    });
    let tip = match measure {
        Measure::Factor => "Times the light of the file".to_owned(),
        Measure::Stops => "Stops (EV) above the light of the file: one more is twice as bright".to_owned(),
        Measure::Amount { unit, .. } => format!("In {unit}"),
    };
    // Number and unit fit into the width, beside what stands there.
    let padding = std::mem::replace(&mut ui.spacing_mut().button_padding.x, PADDING);
    let response = ui.add_sized([width, 22.0], drag).on_hover_text(tip);
    ui.spacing_mut().button_padding.x = padding;
    let response = response.accessible_name(format!("{label} {}", unit_words(measure)));
    if response.changed() {
        *intensity = measure.intensity(number);
    }
    response
}

/// What the number is, for who does not see it.
fn unit_words(measure: Measure) -> &'static str {
    match measure {
        Measure::Factor => "factor",
        Measure::Stops => "stops",
        Measure::Amount { unit, .. } => unit,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_any_size_have_three_digits_or_four() {
        assert_eq!(
            [0.0, 1.0, 9.99, 9.999, 12.34, 99.96, 5000.0, 9999.4].map(digits),
            ["0.00", "1.00", "9.99", "10.0", "12.3", "100", "5000", "9999"]
        );
        assert_eq!([9999.6, 15_694.0, 99_960.0, 250_000.0].map(digits), ["10.0k", "15.7k", "100k", "250k"]);
    }

    #[test]
    fn a_number_and_its_intensity_are_told_from_each_other() {
        let lumen = Measure::Amount { at_one: 800.0, unit: "lm" };
        for measure in [Measure::Factor, Measure::Stops, lumen] {
            for intensity in [0.0, 0.125, 1.0, 3.7] {
                assert!((measure.intensity(measure.number(intensity)) - intensity).abs() < 1e-5, "{measure:?}");
            }
        }
        assert_eq!([Measure::Stops.words(0.0), Measure::Stops.words(2.0)], ["off EV", "+1.00 EV"]);
        assert_eq!([lumen.words(0.5), Measure::Factor.words(0.5)], ["400 lm", "0.50×"]);
    }

    #[test]
    fn what_is_typed_may_carry_its_own_unit_and_no_other() {
        let lumen = Measure::Amount { at_one: 800.0, unit: "lm" };
        let of = |measure: Measure, texts: [&str; 6]| texts.map(|text| typed(text, measure));
        assert_eq!(
            of(lumen, ["1.5", " 1,5 lm", "250k", "2 klm", "off", "5,000 lumen"]),
            [Some(1.5), Some(1.5), Some(250_000.0), Some(2000.0), Some(0.0), Some(5000.0)]
        );
        assert_eq!(
            of(lumen, ["50 %", "0,125", "1,234,567.5", "2 W", "mixed", ""]),
            [Some(400.0), Some(0.125), Some(1_234_567.5), None, None, None]
        );
        assert_eq!(
            of(Measure::Factor, ["50%", "1,125", "2x", "3 ×", "2 lm", "1..2"]),
            [Some(0.5), Some(1.125), Some(2.0), Some(3.0), None, None]
        );
        assert_eq!(
            of(Measure::Stops, ["-1 EV", "+0,5", "off", "200 %", "2 stops", "-1 lx"]),
            [Some(-1.0), Some(0.5), Some(OFF_EV), Some(1.0), Some(2.0), None]
        );
    }

    #[test]
    fn the_later_of_a_point_and_a_comma_stands_before_the_fraction() {
        let lumen = Measure::Amount { at_one: 800.0, unit: "lm" };
        for measure in [lumen, Measure::Factor, Measure::Stops] {
            let of = |text: &str| typed(text, measure);
            assert_eq!(["1.500,5", "1,500.5", "+1.500,5"].map(of), [Some(1500.5); 3], "{measure:?}");
            assert_eq!(["1.234.567", "1,234,567", "1.234.567,0"].map(of), [Some(1_234_567.0); 3], "{measure:?}");
            assert_eq!(["1.500", "1,5", "1.5"].map(of), [Some(1.5); 3], "{measure:?}");
            let odd = ["1.5,000", "1.500,500,5", "1.234,567.8", "0.500,5", "12.34.567", "1,5,2", ".,5", "nan", "1e30"];
            assert_eq!(odd.map(of), [None; 9], "{measure:?}");
        }
        assert_eq!(["1.500", "1,500"].map(|text| typed(text, lumen)), [Some(1.5), Some(1500.0)]);
    }
}
