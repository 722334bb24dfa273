//! Measured light distributions of luminaires: IES LM-63 \[LM63\] and EULUMDAT \[Stockmar1990\] files.
//!
//! A luminaire aims along −Z, as a spot of glTF does; EXT_lights_ies puts the zero point of a profile there and its zero
//! plane into X/Z. Directions are found from the angles of a file so:
//! - C planes (LM-63 type C, EULUMDAT): the vertical angle γ counts from −Z, the horizontal angle φ from +X towards +Y, which
//!   is counterclockwise for who looks from behind along the aim: (sin γ cos φ, sin γ sin φ, −cos γ).
//! - Type B, of floodlights: the vertical angle V turns half planes about the Y axis, from −Z towards +X; the horizontal
//!   angle H counts within them from the X/Z plane towards −Y: (cos H sin V, −sin H, −cos H cos V), so that tan V = cos φ tan γ
//!   and sin H = −sin φ sin γ.
//!
//! Type A, made for vehicle lamps, is refused with advice.

// What is read here was written by strangers, so no integer may wrap in silence.
#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]
#![cfg_attr(not(test), deny(clippy::cast_possible_truncation, clippy::cast_sign_loss))]

mod assign;
mod ies;
mod ldt;
mod numbers;
mod table;
#[cfg(test)]
mod tests;

use glam::Vec3;
use thiserror::Error;

pub use assign::{AssignError, assign};
use numbers::Fault;
use table::Table;

/// Largest file that is read; the largest ones of makers have a few hundred kilobytes.
const MAX_BYTES: usize = 32 << 20;

/// Largest power that is believed, watt: the largest lamps ever built have a few hundred kilowatt.
const MAX_WATTS: f64 = 1e6;

/// Why a photometric file cannot be used.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum PhotometryError {
    /// More bytes than any such file has.
    #[error("{name} has {n_bytes} bytes, which is more than a photometric file can have: is it another kind of file?")]
    TooLarge {
        /// Name of the file.
        name: String,
        /// Its size.
        n_bytes: usize,
    },
    /// Neither format.
    #[error(
        "{name} is neither an IES file (it has no line `TILT=`) nor an EULUMDAT file (its name does not end in .ldt)"
    )]
    UnknownFormat {
        /// Name of the file.
        name: String,
    },
    /// Something in a line is wrong.
    #[error("line {line} of {name}: {reason}")]
    Line {
        /// Name of the file.
        name: String,
        /// Number of the line, from 1.
        line: usize,
        /// What is wrong.
        reason: String,
    },
    /// A lamp that sends no light.
    #[error("{name} measures 0 candela in every direction: ask its maker for another file")]
    Dark {
        /// Name of the file.
        name: String,
    },
}

/// Luminous intensity over all directions, in the frame of the luminaire (see the module's page).
#[derive(Clone, Debug, PartialEq)]
pub struct PhotometricProfile {
    name: String,
    table: Table,
    max_candela: f32,
    watts: Option<f32>,
    remarks: Vec<String>,
}

/// What a file says.
struct Read {
    table: Table,
    /// Electrical power, as the file has it.
    watts: Option<f64>,
    /// What had to be mended, in words.
    remarks: Vec<String>,
}

impl PhotometricProfile {
    /// Reads an IES or EULUMDAT file. `file_name` tells the format where the bytes leave it open, and stands in errors.
    ///
    /// # Errors
    /// When the file is neither, is broken (the line is named), is of type A, or is dark.
    pub fn parse(bytes: &[u8], file_name: &str) -> Result<PhotometricProfile, PhotometryError> {
        let name = file_name.to_owned();
        if bytes.len() > MAX_BYTES {
            return Err(PhotometryError::TooLarge { name, n_bytes: bytes.len() });
        }
        // Names of makers may be in any encoding; what counts here is ASCII.
        let text = String::from_utf8_lossy(bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes));
        // A file that went through two systems ends its lines twice; EULUMDAT counts them.
        let text = text.replace("\r\r\n", "\n").replace("\r\n", "\n").replace('\r', "\n");
        let lines: Vec<&str> = text.lines().collect();
        let is_ldt = file_name.rsplit('.').next().is_some_and(|end| end.eq_ignore_ascii_case("ldt"));
        let read = match ies::tilt_line(&lines) {
            Some(tilt) => ies::read(&lines, tilt),
            None if is_ldt => ldt::read(&lines),
            None => return Err(PhotometryError::UnknownFormat { name }),
        };
        let Read { table, watts, remarks } = match read {
            Ok(read) => read,
            Err(Fault { line, reason }) => return Err(PhotometryError::Line { name, line, reason }),
        };
        let max_candela = table.max();
        if max_candela <= 0.0 {
            return Err(PhotometryError::Dark { name });
        }
        Ok(PhotometricProfile { name, table, max_candela, watts: watts.and_then(believed_watts), remarks })
    }

    /// Name of the file.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Luminous intensity in candela towards a direction of any length in the luminaire's frame; bilinear in the angles, and
    /// 0 where the file measures nothing.
    pub fn candela(&self, direction: Vec3) -> f32 {
        self.table.at(direction)
    }

    /// Largest luminous intensity in candela; more than 0.
    pub fn max_candela(&self) -> f32 {
        self.max_candela
    }

    /// Luminous flux in lumen, integrated over all directions.
    #[expect(clippy::cast_possible_truncation, reason = "a flux in single precision")]
    pub fn flux_lm(&self) -> f32 {
        self.table.flux_lm() as f32
    }

    /// So many unit directions in the luminaire's frame, more of them where it sends more, and the flux of each over the largest intensity,
    /// lm/cd. `place` of a direction's number, two numbers in 0…1, sets those side by side apart.
    pub(crate) fn rays(&self, n: u32, place: impl Fn(u32) -> [f32; 2]) -> Vec<(Vec3, f32)> {
        let rays = self.table.rays(n, place).into_iter();
        rays.map(|(direction, lumen)| (direction, lumen / self.max_candela)).collect()
    }

    /// Electrical power of the whole luminaire in watt, ballast and driver included, as the file states it; `None` where it
    /// states none, or 0.
    pub fn watts(&self) -> Option<f32> {
        self.watts
    }

    /// What is odd about the file and was taken as it was meant, in words.
    pub fn remarks(&self) -> &[String] {
        &self.remarks
    }

    /// For a device: numbers of vertical and of horizontal angles, and 1 for type B, else 0; then these angles in radians, and intensities
    /// over the largest, horizontal × vertical.
    pub(crate) fn words(&self) -> ([u32; 3], Vec<f32>) {
        self.table.words()
    }

    /// All that its light depends on, as bytes.
    pub(crate) fn light_bytes(&self) -> Vec<u8> {
        self.table.bytes()
    }
}

/// What is said of intensities below 0, of angles that stand there twice, and of numbers behind the last one.
fn remarks_on(n_negative: usize, n_repeats: usize, n_left: usize) -> Vec<String> {
    let negative = (n_negative > 0)
        .then(|| format!("{n_negative} intensities are a little less than 0, as noise leaves them: they count as 0"));
    let repeats = (n_repeats > 0)
        .then(|| format!("{n_repeats} angles stand there twice with the same intensities: they count once"));
    let left = (n_left > 0)
        .then(|| format!("{n_left} numbers follow the last intensity that it announces: they are passed over"));
    negative.into_iter().chain(repeats).chain(left).collect()
}

/// Power as it may be: makers who do not know it write 0.
#[expect(clippy::cast_possible_truncation, reason = "a power in single precision")]
fn believed_watts(watts: f64) -> Option<f32> {
    (watts > 0.0 && watts <= MAX_WATTS).then_some(watts as f32)
}
