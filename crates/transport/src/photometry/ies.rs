//! IES LM-63 of 1986, 1991, 1995, 2002 and 2019. \[LM63\]

use super::numbers::{Comma, Fault, Numbers};
use super::table::{Measured, Planes, Symmetry};
use super::{Read, remarks_on};

/// Most angles of a kind, and most tilt angles.
const MAX_ANGLES: usize = 2000;
/// Most intensities.
const MAX_VALUES: usize = 1 << 20;
/// Angles of a file closer than this are meant to be equal, degrees.
const NEAR_DEG: f64 = 0.01;

/// Index of the line that ends the head of an IES file.
pub(super) fn tilt_line(lines: &[&str]) -> Option<usize> {
    lines.iter().position(|line| tilt_of(line).is_some())
}

/// What stands behind `TILT=`.
fn tilt_of(line: &str) -> Option<&str> {
    let (name, tilt) = line.split_once('=')?;
    name.trim().eq_ignore_ascii_case("TILT").then(|| tilt.trim())
}

/// What is said of a file that the format does not allow.
const DECIMAL_COMMAS: &str = "its decimals have commas for points, and are read so";
/// What is said of a lamp whose light depends on how it hangs.
const TILTED: &str =
    "its table of how the light changes as the lamp is tilted is passed over: it shines as it was measured";

/// Reads what follows the head; `tilt` is the index of its last line. Commas stand between numbers, unless the file holds just as many
/// as it announces, or can be read at all, only with commas for decimal points.
pub(super) fn read(lines: &[&str], tilt: usize) -> Result<Read, Fault> {
    let separated = read_by(lines, tilt, Comma::Separates);
    if matches!(separated, Ok((_, 0))) {
        return separated.map(|(read, _)| read);
    }
    match read_by(lines, tilt, Comma::Decimal) {
        Ok((mut read, n_left)) if n_left == 0 || separated.is_err() => {
            read.remarks.push(DECIMAL_COMMAS.to_owned());
            Ok(read)
        }
        _ => separated.map(|(read, _)| read),
    }
}

/// The same by what a comma means, and how many numbers are left over.
#[expect(clippy::arithmetic_side_effects, reason = "a line number, and counts of at most `MAX_ANGLES`")]
fn read_by(lines: &[&str], tilt: usize, comma: Comma) -> Result<(Read, usize), Fault> {
    let mut numbers = Numbers::new(lines, tilt + 1, comma);
    let changes_as_it_tilts = match tilt_of(lines[tilt]).unwrap_or_default() {
        included if included.eq_ignore_ascii_case("INCLUDE") => skip_tilt(&mut numbers)?,
        none_or_file => !none_or_file.is_empty() && !none_or_file.eq_ignore_ascii_case("NONE"),
    };
    numbers.next("the number of lamps")?;
    numbers.next("the lumens of a lamp")?;
    let multiplier = numbers.factor("the multiplier")?;
    let n_vertical = numbers.count("the number of vertical angles", 2..=MAX_ANGLES)?;
    let n_horizontal = numbers.count("the number of horizontal angles", 1..=MAX_ANGLES)?;
    if n_vertical * n_horizontal > MAX_VALUES {
        return Err(numbers.fault(format!("{n_vertical} × {n_horizontal} intensities are more than can be read")));
    }
    let planes = match numbers.count("the type of photometry", 1..=3)? {
        1 => Planes::C,
        2 => Planes::B,
        _ => {
            return Err(numbers.fault(
                "it is of type A, which is made for vehicle lamps and not read: have it converted to type C".into(),
            ));
        }
    };
    for what in ["the unit of length", "the width", "the length", "the height"] {
        numbers.next(what)?;
    }
    let ballast = numbers.factor("the ballast factor")?;
    let ballast_lamp = numbers.next("the ballast lamp factor")?;
    let scale = multiplier * ballast * if has_ballast_lamp_factor(&lines[..tilt]) { ballast_lamp } else { 1.0 };
    let input_watts = numbers.next("the power in watts")?;
    if scale <= 0.0 {
        return Err(numbers.fault("the ballast lamp factor before is not more than 0".into()));
    }
    let ranges = match planes {
        Planes::C => [(0.0, 180.0), (0.0, 360.0)],
        Planes::B => [(-180.0, 180.0), (-90.0, 90.0)],
    };
    let vertical_deg = numbers.angles(n_vertical, "vertical angle", ranges[0])?;
    let horizontal_deg = numbers.angles(n_horizontal, "horizontal angle", ranges[1])?;
    let line = numbers.line;
    let (candela, n_negative) = numbers.candela(n_vertical * n_horizontal, scale)?;
    let measured = Measured { planes, vertical_deg, horizontal_deg, candela };
    let (measured, n_repeats) = measured.without_repeats(line)?;
    let symmetry = symmetry(planes, &measured.horizontal_deg).map_err(|reason| Fault { line, reason })?;
    let table = measured.into_table(symmetry);
    let n_left = numbers.n_left();
    let mut remarks = remarks_on(n_negative, n_repeats, n_left);
    if changes_as_it_tilts {
        remarks.push(TILTED.to_owned());
    }
    Ok((Read { table, watts: Some(input_watts), remarks }, n_left))
}

/// Passes over how intensities change as the luminaire is tilted, and tells whether they do; it hangs here as it was measured.
fn skip_tilt(numbers: &mut Numbers) -> Result<bool, Fault> {
    numbers.next("the lamp's place in the luminaire")?;
    let n = numbers.count("the number of tilt angles", 1..=MAX_ANGLES)?;
    numbers.list(n, "tilt angle")?;
    let factors = numbers.list(n, "tilt factor")?;
    Ok(factors.iter().any(|&factor| factor != 1.0))
}

/// Up to 1995 the field is a factor; it is reserved in 2002 and a code for the origin of the file in 2019. The year stands in
/// the first line of the head that names the format and is no keyword.
fn has_ballast_lamp_factor(head: &[&str]) -> bool {
    let head = head.iter().map(|line| line.trim().to_ascii_uppercase()).filter(|line| !line.starts_with('['));
    let year = head.filter_map(|line| Some(line.rsplit_once("LM-63-")?.1.to_owned())).next();
    !year.is_some_and(|year| ["02", "2002", "19", "2019"].contains(&year.as_str()))
}

/// What the first and the last horizontal angle say about the planes between the others.
fn symmetry(planes: Planes, angles: &[f64]) -> Result<Symmetry, String> {
    #[expect(clippy::arithmetic_side_effects, reason = "there is an angle")]
    let (first, last) = (angles[0], angles[angles.len() - 1]);
    let spans = |from: f64, to: f64| (first - from).abs() < NEAR_DEG && (last - to).abs() < NEAR_DEG;
    match planes {
        Planes::B if angles.len() < 2 => Err("a file of type B needs two horizontal angles or more".to_owned()),
        Planes::B => Ok(Symmetry::None),
        Planes::C if angles.len() == 1 => Ok(Symmetry::Rotational),
        Planes::C if spans(0.0, 90.0) => Ok(Symmetry::Quadrant),
        Planes::C if spans(0.0, 180.0) => Ok(Symmetry::AboutC0),
        Planes::C if spans(90.0, 270.0) => Ok(Symmetry::AboutC90),
        Planes::C if first < NEAR_DEG && last > 180.0 => Ok(Symmetry::None),
        Planes::C => Err(format!(
            "horizontal angles from {first}° to {last}° are none of 0°, 0° to 90°, 0° to 180°, 90° to 270°, 0° to 360°"
        )),
    }
}
