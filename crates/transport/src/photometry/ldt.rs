//! EULUMDAT. \[Stockmar1990\]
//!
//! One value a line, known by the number of its line. Intensities are candela per 1000 lumen of the lamps; of several sets of
//! lamps the first is taken.

use super::numbers::{Comma, Fault, Numbers};
use super::table::{Measured, Planes, Symmetry};
use super::{Read, remarks_on};

/// Most angles of a kind.
const MAX_ANGLES: usize = 2000;
/// Most sets of lamps.
const MAX_SETS: usize = 20;
/// Lines of a set of lamps.
const SET_LINES: usize = 6;
/// Direct ratios after the sets of lamps, a line each.
const N_RATIOS: usize = 10;

/// Numbers of lines, from 1.
const SYMMETRY: usize = 3;
const N_PLANES: usize = 4;
const N_ANGLES: usize = 6;
const FACTOR: usize = 24;
const N_SETS: usize = 26;
const FLUX: usize = 29;
const WATTS: usize = 32;

/// Reads all lines.
#[expect(clippy::arithmetic_side_effects, reason = "line numbers from 1 on, and counts of at most `MAX_ANGLES`")]
pub(super) fn read(lines: &[&str]) -> Result<Read, Fault> {
    let line = |number: usize| Numbers::new(&lines[..number.min(lines.len())], number - 1, Comma::Decimal);
    let isym = line(SYMMETRY).count("the symmetry", 0..=4)?;
    let n_planes = line(N_PLANES).count("the number of C planes", 1..=MAX_ANGLES)?;
    let n_angles = line(N_ANGLES).count("the number of angles in a plane", 2..=MAX_ANGLES)?;
    let (factor, unused) = factor(line(FACTOR))?;
    let n_sets = line(N_SETS).count("the number of sets of lamps", 1..=MAX_SETS)?;
    let flux_lm = line(FLUX).factor("the luminous flux of the lamps")?;
    // Some makers write words here, or nothing; the light does not depend on it.
    let watts = line(WATTS).next("the power in watts").ok();

    let first = N_SETS + n_sets * SET_LINES + N_RATIOS;
    let mut numbers = Numbers::new(lines, first, Comma::Decimal);
    let all_planes_deg = numbers.angles(n_planes, "C plane", (0.0, 360.0))?;
    let vertical_deg = numbers.angles(n_angles, "angle", (0.0, 180.0))?;
    let line_of_angles = numbers.line;
    let (symmetry, held) = held_planes(isym, n_planes).map_err(|reason| Fault { line: N_PLANES, reason })?;
    let horizontal_deg: Vec<f64> = held.map(|plane| all_planes_deg[plane % n_planes]).collect();
    let (candela, n_negative) = numbers.candela(horizontal_deg.len() * n_angles, factor * flux_lm / 1000.0)?;
    let measured = Measured { planes: Planes::C, vertical_deg, horizontal_deg, candela };
    let (measured, n_repeats) = measured.without_repeats(line_of_angles)?;
    let sets = (n_sets > 1).then(|| format!("it has {n_sets} sets of lamps: the first one counts, of {flux_lm} lm"));
    let remarks = remarks_on(n_negative, n_repeats, numbers.n_left());
    let remarks = unused.into_iter().chain(sets).chain(remarks).collect();
    Ok(Read { table: measured.into_table(symmetry), watts, remarks })
}

/// The conversion factor; makers who do not use it write 0 for 1, and that is said.
fn factor(mut numbers: Numbers) -> Result<(f64, Option<String>), Fault> {
    let what = "the conversion factor";
    match numbers.next(what)? {
        0.0 => Ok((1.0, Some(format!("{what} (line {FACTOR}) is 0: it counts as 1")))),
        factor if factor > 0.0 => Ok((factor, None)),
        factor => Err(numbers.fault(format!("{what} is {factor}; it must be more than 0"))),
    }
}

/// Which of the planes, counted from 0 and on round the circle, have intensities in the file.
#[expect(clippy::arithmetic_side_effects, reason = "at most `MAX_ANGLES` planes")]
fn held_planes(isym: usize, n_planes: usize) -> Result<(Symmetry, std::ops::Range<usize>), String> {
    let quarters = if matches!(isym, 3 | 4) { 4 } else { 2 };
    if isym >= 2 && !n_planes.is_multiple_of(quarters) {
        return Err(format!("{n_planes} C planes cannot have symmetry {isym}, which needs a multiple of {quarters}"));
    }
    Ok(match isym {
        0 => (Symmetry::None, 0..n_planes),
        1 => (Symmetry::Rotational, 0..1),
        2 => (Symmetry::AboutC0, 0..n_planes / 2 + 1),
        3 => (Symmetry::AboutC90, 3 * n_planes / 4..3 * n_planes / 4 + n_planes / 2 + 1),
        _ => (Symmetry::Quadrant, 0..n_planes / 4 + 1),
    })
}
