//! The schedule as comma-separated values, as RFC 4180 has them; no cell of text begins as a formula does.

use std::io::Write;

use anyhow::{Result, bail};
use glam::Vec3;

use super::{Luminaire, LuminaireType, Schedule, ScheduleBy, WattSource};
use crate::table::text_cell;

/// Names of the columns, and which of them hold what is counted, lumen and watt.
struct Columns {
    names: &'static str,
    count: usize,
    lumen: usize,
    watt: usize,
}

const BY_LAMP: Columns = Columns {
    names: "key,name,kind,count,on,lumen,watt,x_m,y_m,z_m,aim_x,aim_y,aim_z,kelvin,red,green,blue,profile,watt_source",
    count: 3,
    lumen: 5,
    watt: 6,
};
const BY_TYPE: Columns = Columns {
    names: "type,kind,profile,count,on,lumen,watt,lumen_total,watt_total,lumen_per_watt,kelvin,red,green,blue,watt_source,lamps",
    count: 3,
    lumen: 7,
    watt: 8,
};

impl Schedule {
    /// Writes it, and what all lamps that are on sum up to.
    ///
    /// # Errors
    /// If it cannot be written, or the lumen or watts of a lamp are no finite number.
    pub fn write(&self, writer: &mut impl Write, by: ScheduleBy) -> Result<()> {
        let is_beyond = |lamp: &&Luminaire| [lamp.lumen, lamp.watt].iter().flatten().any(|value| !value.is_finite());
        if let Some(lamp) = self.luminaires.iter().find(is_beyond) {
            bail!(
                "the lumen of `{}` are no finite number, so no table was written; check the intensities of the look",
                lamp.key
            );
        }
        let columns = match by {
            ScheduleBy::Lamp => BY_LAMP,
            ScheduleBy::Type => BY_TYPE,
        };
        writeln!(writer, "{}", columns.names)?;
        match by {
            ScheduleBy::Lamp => self.luminaires.iter().try_for_each(|lamp| writeln!(writer, "{}", lamp_row(lamp)))?,
            ScheduleBy::Type => self.types().iter().try_for_each(|of| writeln!(writer, "{}", type_row(of)))?,
        }
        for total in self.totals(&columns) {
            writeln!(writer, "{total}")?;
        }
        Ok(())
    }

    fn totals(&self, columns: &Columns) -> Vec<String> {
        let n_on = self.shining().count();
        let n_unknown = self.n_unknown_watt();
        let count = |n: usize| (columns.count, n.to_string());
        let watt = |words: String| (columns.watt, words);
        let all = [count(n_on), (columns.lumen, format!("{:.1}", self.lumen())), watt(format!("{:.1}", self.watt()))];
        let mut rows = vec![
            columns.row("total of lamps that are on", &all),
            columns.row("lamps of unknown wattage", &[count(n_unknown)]),
        ];
        if let Some(efficacy) = self.lumen_per_watt() {
            let cells = [count(self.n_known_efficacy()), watt(format!("{efficacy:.1}"))];
            rows.push(columns.row("luminous efficacy of known wattage (lm/W)", &cells));
        }
        if let Some(efficacy) = self.efficacy_lm_w {
            let label = "watts by efficacy (lm/W)";
            let n = self.shining().filter(|lamp| lamp.watt_source == Some(WattSource::Efficacy)).count();
            rows.push(columns.row(label, &[count(n), watt(format!("{efficacy:.1}"))]));
        }
        if let Some(area) = self.floor_m2 {
            rows.push(columns.row("floor area (m²)", &[watt(format!("{area:.2}"))]));
        }
        if let Some(density) = self.watt_per_m2() {
            rows.push(columns.row("power density (W/m²)", &[watt(format!("{density:.2}"))]));
        }
        rows
    }

    /// Lamps that shine and tell both flux and power.
    fn n_known_efficacy(&self) -> usize {
        self.shining().filter(|lamp| lamp.lumen.is_some() && lamp.watt.is_some()).count()
    }
}

impl Columns {
    /// A row of a label and some cells; the others are empty.
    fn row(&self, label: &str, known: &[(usize, String)]) -> String {
        let cell = |nth: usize| match known.iter().find(|(column, _)| *column == nth) {
            Some((_, words)) => words.as_str(),
            None if nth == 0 => label,
            None => "",
        };
        let cells: Vec<&str> = self.names.split(',').enumerate().map(|(nth, _)| cell(nth)).collect();
        cells.join(",")
    }
}

fn lamp_row(lamp: &Luminaire) -> String {
    let profile = lamp.profile.as_deref().unwrap_or_default();
    [
        text_cell(&lamp.key),
        text_cell(&lamp.name),
        text_cell(&lamp.kind),
        "1".into(),
        on_cell(lamp.is_on),
        number_cell(lamp.lumen),
        number_cell(lamp.watt),
        three_cells(lamp.position, 3),
        three_cells(lamp.direction, 4),
        kelvin_cell(lamp.kelvin),
        color_cells(lamp.color),
        text_cell(profile),
        source_cell(lamp.watt_source),
    ]
    .join(",")
}

fn type_row(of: &LuminaireType) -> String {
    let per_watt = of.lumen.zip(of.watt).filter(|(_, watt)| *watt > 0.0).map(|(lumen, watt)| lumen / watt);
    [
        text_cell(&of.letters),
        text_cell(&of.kind),
        text_cell(of.profile.as_deref().unwrap_or_default()),
        of.lamps.len().to_string(),
        on_cell(of.is_on),
        number_cell(of.lumen),
        number_cell(of.watt),
        number_cell(of.all(of.lumen)),
        number_cell(of.all(of.watt)),
        number_cell(per_watt),
        kelvin_cell(of.kelvin),
        color_cells(of.color),
        source_cell(of.watt_source),
        text_cell(&of.lamps.join("; ")),
    ]
    .join(",")
}

fn on_cell(is_on: bool) -> String {
    if is_on { "yes" } else { "no" }.into()
}

/// A number with one digit, or nothing.
pub(super) fn number_cell(number: Option<f64>) -> String {
    number.map_or(String::new(), |number| format!("{number:.1}"))
}

fn kelvin_cell(kelvin: Option<f32>) -> String {
    kelvin.map_or(String::new(), |kelvin| format!("{kelvin:.0}"))
}

/// Red, green and blue.
pub(super) fn color_cells(color: Vec3) -> String {
    three_cells(Some(color), 4)
}

fn three_cells(v: Option<Vec3>, digits: usize) -> String {
    match v {
        // Plus zero, so that there is but one zero.
        Some(v) => v.to_array().map(|x| format!("{:.digits$}", x + 0.0)).join(","),
        None => ",,".into(),
    }
}

fn source_cell(source: Option<WattSource>) -> String {
    match source {
        Some(WattSource::Profile) => "profile",
        Some(WattSource::Efficacy) => "efficacy",
        None => "",
    }
    .into()
}
