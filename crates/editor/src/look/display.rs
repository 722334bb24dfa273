//! How radiance becomes a picture, from JSON and back.

use std::ops::RangeInclusive;

use anyhow::{Result, bail};
use clerestory_relight::Radiance;
use clerestory_relight::display::{ColorScale, DisplayParams, Dither, Metering, Spacing, Tone, WhitePoint};
use clerestory_transport::basis::LightBasis;
use serde_json::Value;

use super::parse::Reader;
use super::write::{member, value};
use crate::isolux::Isolux;

/// Exposure in stops.
const EXPOSURE_EV: RangeInclusive<f64> = -60.0..=60.0;
/// Stops that may be added to a metered exposure.
pub const COMPENSATION_EV: RangeInclusive<f64> = -10.0..=10.0;
/// Percentage of pixels.
const PERCENT: RangeInclusive<f64> = 0.0..=100.0;
/// Percentile that is metered if none is named.
pub const PERCENT_DEFAULT: f32 = 99.0;
/// Correlated color temperature of the white point; beyond this the locus is not known.
pub const WHITE_KELVIN: RangeInclusive<f64> = 1667.0..=25_000.0;
/// Distance of the white point from the Planckian locus; beyond this no light is called white.
pub const WHITE_DUV: RangeInclusive<f64> = -0.05..=0.05;
/// Temperature of the display's own white, where a look gives a tint alone.
pub const DISPLAY_KELVIN: f32 = 6504.0;
/// Ends of a scale of false color, cd/m² or lux.
const SCALE_END: RangeInclusive<f64> = 0.0..=1e12;

/// How radiance becomes a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Display {
    /// Stops; `None` finds an exposure that suits the picture.
    pub exposure_ev: Option<f32>,
    /// How that exposure is found.
    pub metering: Metering,
    /// Stops that are added to it: a night is to be darker than a day.
    pub compensation_ev: f32,
    /// Tone curve.
    pub tone: Tone,
    /// Light that is shown as neutral; `None` leaves colors as they are.
    pub white: Option<WhitePoint>,
    /// Rounding to bytes.
    pub dither: Dither,
    /// Amounts of light as colors, instead of a picture.
    pub false_color: Option<FalseColor>,
}

/// Amounts of light as colors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FalseColor {
    /// Of what.
    pub quantity: Quantity,
    /// How values are spread over the colors.
    pub spacing: Spacing,
    /// Ends of the scale in the quantity's unit; `None` finds some that suit the picture.
    pub range: Option<[f32; 2]>,
    /// Lines over it, where it shows illuminance.
    pub isolux: Isolux,
}

/// What false color shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Quantity {
    /// Light that is seen.
    #[default]
    Luminance,
    /// Light that arrives at the surfaces seen.
    Illuminance,
}

/// What the numbers of a picture count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Units {
    /// Candela and lux.
    #[default]
    Photometric,
    /// What a camera took: nobody knows how much light a 1 is.
    Relative,
}

impl Units {
    /// Those of what a bake with these columns shows.
    pub fn of(basis: &LightBasis) -> Units {
        if basis.is_measured() { Units::Relative } else { Units::Photometric }
    }
}

impl Quantity {
    /// Symbol of the unit.
    pub fn unit(self) -> &'static str {
        match self {
            Quantity::Luminance => "cd/m²",
            Quantity::Illuminance => "lx",
        }
    }

    /// The same, or a word for what has none.
    pub fn unit_in(self, units: Units) -> &'static str {
        match (self, units) {
            (Quantity::Luminance, Units::Relative) => "relative",
            _ => self.unit(),
        }
    }

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Quantity::Luminance => "luminance",
            Quantity::Illuminance => "illuminance",
        }
    }
}

impl Display {
    /// What false color shows, if it is on.
    pub fn quantity(&self) -> Option<Quantity> {
        self.false_color.map(|false_color| false_color.quantity)
    }

    /// Without the false color of the light that arrives, which a picture of the light that is seen cannot show.
    pub fn of_seen_light(self) -> Display {
        let shown = self.false_color.filter(|false_color| false_color.quantity != Quantity::Illuminance);
        Display { false_color: shown, ..self }
    }

    /// Which lines lie over the picture.
    pub fn isolux(&self) -> Isolux {
        let shown = self.false_color.filter(|false_color| false_color.quantity == Quantity::Illuminance);
        shown.map_or(Isolux::Off, |false_color| false_color.isolux)
    }

    /// Whether something of it depends on the picture.
    pub fn meters(&self) -> bool {
        self.exposure_ev.is_none() || self.false_color.is_some_and(|false_color| false_color.range.is_none())
    }

    /// Whether something of it depends on the darkest pixels as much as on those that are seen well: the log-average, and a
    /// scale of false color that is fitted.
    pub fn follows_every_pixel(&self) -> bool {
        let is_fitted = self.false_color.is_some_and(|false_color| false_color.range.is_none());
        is_fitted || (self.exposure_ev.is_none() && self.metering == Metering::LogAverage)
    }

    /// What suits `picture`, where this leaves it open: radiance, or irradiance where that is shown.
    pub fn metered(&self, picture: &Radiance) -> DisplayParams {
        let exposure_ev = self.exposure_ev.unwrap_or_else(|| self.metering.exposure_ev(picture) + self.compensation_ev);
        let fitting = |f: FalseColor| ColorScale::fitting(picture, f.spacing);
        self.with(exposure_ev, self.false_color.map(|f| f.given().unwrap_or_else(|| fitting(f))))
    }

    /// The same at an exposure and on a scale that were metered earlier, where this leaves them open.
    pub fn as_metered(&self, earlier: &DisplayParams) -> DisplayParams {
        let usable = earlier.false_color.filter(|scale| self.false_color.is_some_and(|f| f.spacing == scale.spacing));
        let scale = |f: FalseColor| {
            f.given().or(usable).unwrap_or_else(|| ColorScale::fitting(&Radiance::default(), f.spacing))
        };
        self.with(self.exposure_ev.unwrap_or(earlier.exposure_ev), self.false_color.map(scale))
    }

    fn with(&self, exposure_ev: f32, false_color: Option<ColorScale>) -> DisplayParams {
        DisplayParams { tone: self.tone, exposure_ev, white: self.white, dither: self.dither, false_color }
    }
}

impl FalseColor {
    fn given(&self) -> Option<ColorScale> {
        self.range.map(|[low, high]| ColorScale { spacing: self.spacing, low, high })
    }
}

impl Reader<'_> {
    /// The member `display`.
    pub(super) fn display(&mut self, value: &Value) -> Result<Display> {
        let object = self.object(value)?;
        let known = [
            "exposure_ev",
            "metering",
            "compensation_ev",
            "tone",
            "white_kelvin",
            "white_duv",
            "dither",
            "false_color",
        ];
        self.report_unknown(object, &known);
        let compensation_ev = self.optional(object, "compensation_ev", |r, v| r.number(v, &COMPENSATION_EV))?;
        let kelvin = self.optional(object, "white_kelvin", |r, v| r.number(v, &WHITE_KELVIN))?;
        let duv = self.optional(object, "white_duv", |r, v| r.number(v, &WHITE_DUV))?;
        let white = WhitePoint { kelvin: kelvin.unwrap_or(DISPLAY_KELVIN), duv: duv.unwrap_or(0.0) };
        let dithered = self.optional(object, "dither", |r, v| r.truth(v))?.unwrap_or(false);
        Ok(Display {
            exposure_ev: self.optional(object, "exposure_ev", |r, v| r.number(v, &EXPOSURE_EV))?,
            metering: self.optional(object, "metering", |r, v| r.metering(v))?.unwrap_or_default(),
            compensation_ev: compensation_ev.unwrap_or_default(),
            tone: self.optional(object, "tone", |r, v| r.one_of(v, &Tone::ALL))?.flatten().unwrap_or_default(),
            white: (kelvin.is_some() || duv.is_some()).then_some(white),
            dither: if dithered { Dither::Ordered } else { Dither::Off },
            false_color: self.optional(object, "false_color", |r, v| r.false_color(v))?.flatten(),
        })
    }

    /// A rule by its name, or `{"percentile": 95}`.
    fn metering(&mut self, value: &Value) -> Result<Metering> {
        if let Some(object) = value.as_object() {
            self.report_unknown(object, &["percentile"]);
            let percent = self.optional(object, "percentile", |r, v| r.number(v, &PERCENT))?;
            return Ok(percent.map_or(Metering::Auto, Metering::Percentile));
        }
        let names = [
            ("auto", Metering::Auto),
            ("log_average", Metering::LogAverage),
            ("percentile", Metering::Percentile(PERCENT_DEFAULT)),
        ];
        Ok(self.by_name(value, names)?.unwrap_or_default())
    }

    /// None where the quantity is not known: another one would be a lie.
    fn false_color(&mut self, value: &Value) -> Result<Option<FalseColor>> {
        let object = self.object(value)?;
        self.report_unknown(object, &["quantity", "spacing", "range", "isolux"]);
        let quantities = [Quantity::Luminance, Quantity::Illuminance].map(|quantity| (quantity.name(), quantity));
        let quantity = match object.get("quantity") {
            None | Some(Value::Null) => Some(Quantity::default()),
            Some(_) => self.optional(object, "quantity", |r, v| r.by_name(v, quantities))?.flatten(),
        };
        let spacings = [Spacing::Log, Spacing::Linear];
        let spacing = self.optional(object, "spacing", |r, v| r.one_of(v, &spacings))?.flatten().unwrap_or_default();
        let range = self.optional(object, "range", |r, v| r.scale_range(v, spacing))?;
        let lines = Isolux::ALL.map(|isolux| (isolux.name(), isolux));
        let isolux = self.optional(object, "isolux", |r, v| r.by_name(v, lines))?.flatten().unwrap_or_default();
        Ok(quantity.map(|quantity| FalseColor { quantity, spacing, range, isolux }))
    }

    fn scale_range(&mut self, value: &Value, spacing: Spacing) -> Result<[f32; 2]> {
        let [low, high] = self.numbers(value, &SCALE_END)?;
        if low >= high {
            bail!("`{}` must go from a lower to a higher value, not from {low} to {high}", self.name());
        }
        if spacing == Spacing::Log && low <= 0.0 {
            bail!("`{}` must begin above 0 on a logarithmic scale; use \"spacing\": \"linear\" for 0", self.name());
        }
        Ok([low, high])
    }
}

/// Members of the object `display` that differ from the default.
pub(super) fn members(display: &Display) -> Vec<String> {
    let default = Display::default();
    let metering = match display.metering {
        Metering::Auto => None,
        Metering::LogAverage => Some(member("metering", "log_average")),
        Metering::Percentile(percent) => Some(format!("\"metering\": {{ {} }}", member("percentile", &percent))),
    };
    let members = [
        display.exposure_ev.map(|ev| member("exposure_ev", &ev)),
        metering,
        (display.compensation_ev != 0.0).then(|| member("compensation_ev", &display.compensation_ev)),
        (display.tone != default.tone).then(|| member("tone", &display.tone)),
        display.white.map(|white| member("white_kelvin", &white.kelvin)),
        display.white.filter(|white| white.duv != 0.0).map(|white| member("white_duv", &white.duv)),
        (display.dither == Dither::Ordered).then(|| member("dither", &true)),
        display.false_color.map(|false_color| format!("\"false_color\": {{ {} }}", false_color_members(&false_color))),
    ];
    members.into_iter().flatten().collect()
}

fn false_color_members(false_color: &FalseColor) -> String {
    let range = false_color.range.map(|[low, high]| format!("\"range\": [{}, {}]", value(&low), value(&high)));
    let members = [
        Some(member("quantity", false_color.quantity.name())),
        (false_color.spacing != Spacing::default()).then(|| member("spacing", &false_color.spacing)),
        range,
        (false_color.isolux != Isolux::default()).then(|| member("isolux", false_color.isolux.name())),
    ];
    members.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::Look;

    fn read(display: &str) -> (Display, Vec<String>) {
        let (look, warnings) = Look::from_json(&format!(r#"{{"clerestory": 1, "display": {display}}}"#)).unwrap();
        (look.display, warnings)
    }

    #[test]
    fn every_setting_comes_back() {
        let white = WhitePoint { kelvin: 3000.0, duv: -0.004 };
        let false_color = FalseColor {
            quantity: Quantity::Illuminance,
            spacing: Spacing::Linear,
            range: Some([0.0, 500.0]),
            isolux: Isolux::FootCandles,
        };
        let rich = Display {
            exposure_ev: Some(-1.5),
            metering: Metering::Percentile(95.0),
            compensation_ev: -1.25,
            tone: Tone::Reinhard,
            white: Some(white),
            dither: Dither::Ordered,
            false_color: Some(false_color),
        };
        let plain = WhitePoint { duv: 0.0, ..white };
        let log = Display {
            metering: Metering::LogAverage,
            white: Some(plain),
            false_color: Some(FalseColor::default()),
            ..rich
        };
        for display in [Display::default(), rich, log] {
            let json = Look { display, ..Look::default() }.to_json();
            let (back, warnings) = Look::from_json(&json).unwrap();
            assert_eq!(back.display, display, "{json}");
            assert!(warnings.is_empty(), "{warnings:?}");
        }
    }

    #[test]
    fn what_is_metered_is_compensated_and_what_is_fixed_is_not() {
        let picture = Radiance { width: 1, height: 1, pixels: vec![[2.0; 3]] };
        let ev = |display: Display| display.metered(&picture).exposure_ev;
        let darker = Display { compensation_ev: -1.5, ..Display::default() };
        assert_eq!(ev(darker), ev(Display::default()) - 1.5);
        assert_eq!(ev(Display { exposure_ev: Some(3.0), ..darker }), 3.0);
    }

    #[test]
    fn looks_of_before_read_as_they_did() {
        let (old, warnings) = read(r#"{"exposure_ev": 2, "tone": "neutral"}"#);
        assert_eq!(old, Display { exposure_ev: Some(2.0), tone: Tone::Neutral, ..Display::default() });
        assert!(warnings.is_empty());
        assert_eq!(members(&old), [r#""exposure_ev": 2.0"#, r#""tone": "neutral""#]);
    }

    #[test]
    fn unknown_names_are_reported_and_leave_the_rest_alone() {
        let json = r#"{"exposure_ev": 1, "tone": "sepia", "metering": "spot", "false_color": {"quantity": "glare"}}"#;
        let (display, warnings) = read(json);
        assert_eq!(display, Display { exposure_ev: Some(1.0), ..Display::default() });
        for (key, name) in [("tone", "sepia"), ("metering", "spot"), ("false_color.quantity", "glare")] {
            let told =
                warnings.iter().any(|w| w.contains(&format!("`display.{key}`")) && w.contains(&format!("`{name}`")));
            assert!(told, "{key} is not in {warnings:?}");
        }
        assert_eq!(warnings.len(), 3);
    }

    #[test]
    fn short_forms_mean_what_the_manual_says() {
        assert_eq!(read(r#"{"metering": "percentile"}"#).0.metering, Metering::Percentile(99.0));
        assert_eq!(read(r#"{"false_color": {}}"#).0.quantity(), Some(Quantity::Luminance));
        assert_eq!(read(r#"{"white_duv": 0.01}"#).0.white, Some(WhitePoint { kelvin: 6504.0, duv: 0.01 }));
        assert_eq!(read(r#"{"white_kelvin": null, "false_color": null}"#).0, Display::default());
    }

    #[test]
    fn bad_values_are_refused_by_name() {
        let cases = [
            (r#"{"tone": 3}"#, "`display.tone`"),
            (r#"{"metering": {"percentile": 101}}"#, "`display.metering.percentile`"),
            (r#"{"compensation_ev": 11}"#, "`display.compensation_ev`"),
            (r#"{"white_kelvin": 100}"#, "`display.white_kelvin`"),
            (r#"{"white_duv": 1}"#, "`display.white_duv`"),
            (r#"{"dither": 1}"#, "`display.dither`"),
            (r#"{"false_color": "luminance"}"#, "`display.false_color`"),
            (r#"{"false_color": {"range": [5, 5]}}"#, "`display.false_color.range`"),
            (r#"{"false_color": {"range": [0, 5]}}"#, "above 0"),
            (r#"{"false_color": {"range": [1]}}"#, "2 numbers"),
        ];
        for (display, wanted) in cases {
            let json = format!(r#"{{"clerestory": 1, "display": {display}}}"#);
            let error = format!("{:#}", Look::from_json(&json).unwrap_err());
            assert!(error.contains(wanted), "{json}: {error}");
        }
    }

    #[test]
    fn a_lamp_of_the_white_point_is_shown_gray() {
        use clerestory_relight::encode;
        for kelvin in [2700.0, 4000.0, 10_000.0] {
            let tint = clerestory_transport::light::planckian_tint(kelvin);
            let wall = Radiance { width: 1, height: 1, pixels: vec![(0.3 * tint).to_array()] };
            let display =
                Display { exposure_ev: Some(0.0), white: Some(WhitePoint { kelvin, duv: 0.0 }), ..Display::default() };
            let [r, g, b, _] = encode(&wall, &display.metered(&wall))[..] else { panic!() };
            assert!(r.abs_diff(g) <= 1 && g.abs_diff(b) <= 1, "{kelvin} K: {r} {g} {b}");
        }
    }
}
