//! Lamps of one type, as an order lists them.

use glam::Vec3;
use serde::Serialize;

use super::csv::{color_cells, number_cell};
use super::{Luminaire, Schedule, WattSource};

/// Lamps of one kind, distribution, flux, power and color.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LuminaireType {
    /// Its sign in the schedule: A to Z, then AA and so on.
    pub letters: String,
    /// What its lamps are, for people.
    pub kind: String,
    /// Name of the file of their measured distribution.
    pub profile: Option<String>,
    /// Whether they shine.
    pub is_on: bool,
    /// Names of its lamps.
    pub lamps: Vec<String>,
    /// Luminous flux of one in lumen.
    pub lumen: Option<f64>,
    /// Power of one in watt.
    pub watt: Option<f64>,
    /// Where the power comes from.
    pub watt_source: Option<WattSource>,
    /// Correlated color temperature that they are set to.
    pub kelvin: Option<f32>,
    /// Linear Rec. 709 color.
    pub color: Vec3,
}

impl LuminaireType {
    fn of(lamp: &Luminaire, letters: String) -> LuminaireType {
        LuminaireType {
            letters,
            kind: lamp.kind.clone(),
            profile: lamp.profile.clone(),
            is_on: lamp.is_on,
            lamps: Vec::new(),
            lumen: lamp.lumen,
            watt: lamp.watt,
            watt_source: lamp.watt_source,
            kelvin: lamp.kelvin,
            color: lamp.color,
        }
    }

    /// Whether a lamp is one of them: what the table tells of both is the same to the last digit.
    fn holds(&self, lamp: &Luminaire) -> bool {
        let is_alike = |a: Option<f64>, b: Option<f64>| number_cell(a) == number_cell(b);
        self.kind == lamp.kind
            && self.profile == lamp.profile
            && self.is_on == lamp.is_on
            && self.watt_source == lamp.watt_source
            && self.kelvin.map(f32::round) == lamp.kelvin.map(f32::round)
            && is_alike(self.lumen, lamp.lumen)
            && is_alike(self.watt, lamp.watt)
            && color_cells(self.color) == color_cells(lamp.color)
    }

    /// So much of each, for all of them.
    pub(super) fn all(&self, of_one: Option<f64>) -> Option<f64> {
        of_one.map(|of_one| of_one * self.lamps.len() as f64)
    }
}

impl Schedule {
    /// The types of its lamps, in the order in which they first come.
    pub fn types(&self) -> Vec<LuminaireType> {
        let mut types: Vec<LuminaireType> = Vec::new();
        for lamp in &self.luminaires {
            let nth = types.iter().position(|kept| kept.holds(lamp)).unwrap_or_else(|| {
                types.push(LuminaireType::of(lamp, letters(types.len())));
                types.len().saturating_sub(1)
            });
            types[nth].lamps.push(lamp.name.clone());
        }
        types
    }
}

/// A to Z, AA to AZ and so on, as columns of spreadsheets count.
fn letters(nth: usize) -> String {
    let last = char::from(b"ABCDEFGHIJKLMNOPQRSTUVWXYZ"[nth % 26]);
    match (nth / 26).checked_sub(1) {
        Some(before) => format!("{}{last}", letters(before)),
        None => last.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_go_on_after_z() {
        assert_eq!([0, 25, 26, 51, 52, 701, 702].map(letters), ["A", "Z", "AA", "AZ", "BA", "ZZ", "AAA"]);
    }
}
