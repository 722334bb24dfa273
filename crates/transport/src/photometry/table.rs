//! Intensities over two angles: completed by their symmetry when they are read, looked up bilinearly, integrated exactly.

use std::f32::consts::TAU;

use glam::Vec3;

use super::numbers::{Fault, MIN_STEP_DEG};

/// How the planes of a file lie; see the page of [`super`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Planes {
    /// All planes meet in the aim.
    C,
    /// All planes meet in the Y axis, across the aim.
    B,
}

/// Which C planes a file leaves out because they equal others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Symmetry {
    /// None.
    None,
    /// All but one.
    Rotational,
    /// The mirror images of its planes in the plane C0–C180.
    AboutC0,
    /// The mirror images of its planes in the plane C90–C270.
    AboutC90,
    /// Both kinds of mirror images.
    Quadrant,
}

/// Intensities as a file has them.
pub(super) struct Measured {
    pub planes: Planes,
    /// Rising, at least two once those that are there twice count once; degrees.
    pub vertical_deg: Vec<f64>,
    /// At least one for C planes and two for B planes, likewise; degrees.
    pub horizontal_deg: Vec<f64>,
    /// Planes × vertical angles.
    pub candela: Vec<f32>,
}

/// Intensities over a grid of angles that covers all that was measured or is known by symmetry.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Table {
    planes: Planes,
    /// Rising, at least two; radians.
    vertical: Vec<f32>,
    /// Rising, at least two, radians; C planes go once round, so that the last is the first.
    horizontal: Vec<f32>,
    /// Horizontal × vertical.
    candela: Vec<f32>,
}

/// Two angles of a file closer than this are one, degrees.
const SAME_DEG: f64 = 1e-3;
/// Directions so little outside of the table are within, radians.
const SLACK: f32 = 1e-4;

/// Angles in degrees with the index of the row or column that holds their values.
type Places = Vec<(f64, usize)>;

impl Measured {
    /// Takes angles that stand there twice once, and says how many do. `line` is that of the last angle, from 1.
    ///
    /// # Errors
    /// An angle whose intensities are not the same both times, or but one vertical angle.
    pub fn without_repeats(self, line: usize) -> Result<(Measured, usize), Fault> {
        let (n_rows, n_columns) = (self.horizontal_deg.len(), self.vertical_deg.len());
        #[expect(clippy::arithmetic_side_effects, reason = "indices in a table of angles by angles")]
        let value = |row: usize, column: usize| self.candela.get(row * n_columns + column);
        let twice = |angle| Fault {
            line,
            reason: format!("the angle {angle}° stands there twice with different intensities"),
        };
        let is_same_row = |a, b| (0..n_columns).all(|column| value(a, column) == value(b, column));
        let is_same_column = |a, b| (0..n_rows).all(|row| value(row, a) == value(row, b));
        let rows = distinct(&self.horizontal_deg, is_same_row).map_err(twice)?;
        let columns = distinct(&self.vertical_deg, is_same_column).map_err(twice)?;
        if columns.len() < 2 {
            return Err(Fault { line, reason: "there is but one vertical angle".into() });
        }
        #[expect(clippy::arithmetic_side_effects, reason = "counts of angles, and of some of them")]
        let n_repeats = (n_rows - rows.len()) + (n_columns - columns.len());
        let row = |&row: &usize| columns.iter().filter_map(move |&column| value(row, column).copied());
        let measured = Measured {
            planes: self.planes,
            candela: rows.iter().flat_map(row).collect(),
            vertical_deg: columns.iter().map(|&column| self.vertical_deg[column]).collect(),
            horizontal_deg: rows.iter().map(|&row| self.horizontal_deg[row]).collect(),
        };
        Ok((measured, n_repeats))
    }

    /// Completes C planes by a symmetry. B planes say by their first angle, 0, that they are mirrored.
    #[expect(clippy::arithmetic_side_effects, reason = "indices in a table of angles by angles")]
    #[expect(clippy::cast_possible_truncation, reason = "angles in single precision")]
    pub fn into_table(self, symmetry: Symmetry) -> Table {
        let (rows, columns) = match self.planes {
            Planes::C => (full_circle(&self.horizontal_deg, symmetry), as_they_are(&self.vertical_deg)),
            Planes::B => (mirrored(&self.horizontal_deg), mirrored(&self.vertical_deg)),
        };
        let n_vertical = self.vertical_deg.len();
        let row = |&(_, row): &(f64, usize)| {
            let values = &self.candela[row * n_vertical..][..n_vertical];
            columns.iter().map(move |&(_, column)| values[column])
        };
        let radians = |places: &Places| places.iter().map(|(angle, _)| angle.to_radians() as f32).collect();
        Table {
            planes: self.planes,
            vertical: radians(&columns),
            horizontal: radians(&rows),
            candela: rows.iter().flat_map(row).collect(),
        }
    }
}

/// Places of angles, without those that are the one before them once more; an angle that is, with other values, is an error.
fn distinct(angles: &[f64], is_same: impl Fn(usize, usize) -> bool) -> Result<Vec<usize>, f64> {
    let mut places: Vec<usize> = Vec::new();
    for (place, &angle) in angles.iter().enumerate() {
        match places.last() {
            Some(&last) if (angle - angles[last]).abs() < MIN_STEP_DEG => {
                if !is_same(last, place) {
                    return Err(angle);
                }
            }
            _ => places.push(place),
        }
    }
    Ok(places)
}

fn as_they_are(angles: &[f64]) -> Places {
    angles.iter().copied().zip(0..).collect()
}

/// Angles that begin at 0 with their negatives.
fn mirrored(angles: &[f64]) -> Places {
    let mut places = as_they_are(angles);
    if angles.first().is_some_and(|first| first.abs() < SAME_DEG) {
        places.extend(as_they_are(angles).into_iter().map(|(angle, index)| (-angle, index)));
    }
    sorted(places)
}

/// All C planes from the first one round to itself.
fn full_circle(angles: &[f64], symmetry: Symmetry) -> Places {
    let mut places = Places::new();
    for (index, &angle) in angles.iter().enumerate() {
        let images = match symmetry {
            Symmetry::None | Symmetry::Rotational => &[angle][..],
            Symmetry::AboutC0 => &[angle, -angle],
            Symmetry::AboutC90 => &[angle, 180.0 - angle],
            Symmetry::Quadrant => &[angle, -angle, 180.0 - angle, 180.0 + angle],
        };
        places.extend(images.iter().map(|image| (once_round(*image), index)));
    }
    let mut places = sorted(places);
    let (first, index) = places[0];
    places.push((first + 360.0, index));
    places
}

/// The same angle from 0 to less than 360.
fn once_round(angle: f64) -> f64 {
    let angle = angle.rem_euclid(360.0);
    if angle > 360.0 - SAME_DEG { 0.0 } else { angle }
}

fn sorted(mut places: Places) -> Places {
    places.sort_by(|a, b| a.0.total_cmp(&b.0));
    places.dedup_by(|next, kept| next.0 - kept.0 < SAME_DEG);
    places
}

impl Table {
    /// Candela towards a direction of any length.
    #[expect(clippy::arithmetic_side_effects, reason = "indices in a table of angles by angles")]
    pub fn at(&self, direction: Vec3) -> f32 {
        let Vec3 { x, y, z } = direction;
        let (vertical, horizontal) = match self.planes {
            Planes::C => {
                let first = self.horizontal[0];
                (x.hypot(y).atan2(-z), first + (y.atan2(x) - first).rem_euclid(TAU))
            }
            // Along the axis every plane is met, and the signs of the zeros would choose one.
            Planes::B if x == 0.0 && z == 0.0 => (0.0, (-y).atan2(0.0)),
            Planes::B => (x.atan2(-z), (-y).atan2(x.hypot(z))),
        };
        let (Some((column, v)), Some((row, h))) =
            (bracket(&self.vertical, vertical), bracket(&self.horizontal, horizontal))
        else {
            return 0.0;
        };
        let along = |row: usize| {
            let at = row * self.vertical.len() + column;
            self.candela[at] * (1.0 - v) + self.candela[at + 1] * v
        };
        along(row) * (1.0 - h) + along(row + 1) * h
    }

    /// Largest value in candela.
    pub fn max(&self) -> f32 {
        self.candela.iter().copied().fold(0.0, f32::max)
    }

    /// The integral over all directions, lumen.
    pub fn flux_lm(&self) -> f64 {
        self.cells().map(|cell| self.flux_of(cell)).sum()
    }

    /// So many unit directions, of which each cell of the grid has as many as suit its flux, and lumen of each, together all. `place` of a
    /// direction's number, two numbers in 0…1, says where it lies in its cell.
    #[expect(clippy::arithmetic_side_effects, reason = "a count up to the number that is asked for")]
    #[expect(clippy::cast_possible_truncation, reason = "a flux in single precision")]
    pub fn rays(&self, n: u32, place: impl Fn(u32) -> [f32; 2]) -> Vec<(Vec3, f32)> {
        let all = self.flux_lm();
        let (mut rays, mut nth, mut reached, mut sum) = (Vec::new(), 0, 0.0, 0.0);
        for cell in self.cells() {
            let flux = self.flux_of(cell);
            reached += flux;
            while nth < n && (f64::from(nth) + 0.5) * all < reached * f64::from(n) {
                let (direction, solid_angle) = self.direction_in(cell, place(nth));
                // Within a cell some send more than its mean.
                let over_mean = f64::from(self.at(direction)) * solid_angle / flux;
                rays.push((direction, over_mean));
                (nth, sum) = (nth + 1, sum + over_mean);
            }
        }
        let lumen = |over_mean: f64| if sum > 0.0 { (all * over_mean / sum) as f32 } else { 0.0 };
        rays.into_iter().map(|(direction, over_mean)| (direction, lumen(over_mean))).collect()
    }

    /// Row and column at which each cell of the grid begins.
    #[expect(clippy::arithmetic_side_effects, reason = "at least two angles each way")]
    fn cells(&self) -> impl Iterator<Item = (usize, usize)> {
        let (n_rows, n_columns) = (self.horizontal.len() - 1, self.vertical.len() - 1);
        (0..n_rows).flat_map(move |row| (0..n_columns).map(move |column| (row, column)))
    }

    /// Horizontal and vertical angles between which a cell lies.
    #[expect(clippy::arithmetic_side_effects, reason = "indices in a table of angles by angles")]
    fn angles_of(&self, (row, column): (usize, usize)) -> [&[f32]; 2] {
        [&self.horizontal[row..row + 2], &self.vertical[column..column + 2]]
    }

    /// The integral over the directions of a cell, lumen.
    #[expect(clippy::arithmetic_side_effects, reason = "indices in a table of angles by angles")]
    fn flux_of(&self, (row, column): (usize, usize)) -> f64 {
        let ([h, v], n) = (self.angles_of((row, column)), self.vertical.len());
        let at = |row: usize, column: usize| f64::from(self.candela[row * n + column]);
        let of_column = |column: usize| 0.5 * (at(row, column) + at(row + 1, column));
        let of_row = |row: usize| 0.5 * (at(row, column) + at(row, column + 1));
        match self.planes {
            Planes::C => width(h) * across_sine(v, [of_column(column), of_column(column + 1)]),
            Planes::B => width(v) * across_cosine(h, [of_row(row), of_row(row + 1)]),
        }
    }

    /// A unit direction of a cell, all of them alike for two even numbers in 0…1, and the solid angle of the cell.
    #[expect(clippy::cast_possible_truncation, reason = "a direction in single precision")]
    fn direction_in(&self, cell: (usize, usize), [along, around]: [f32; 2]) -> (Vec3, f64) {
        let [h, v] = self.angles_of(cell);
        let (along, around) = (f64::from(along), f64::from(around));
        let (direction, solid_angle) = match self.planes {
            Planes::C => {
                let [first, last] = [v[0], v[1]].map(|angle| f64::from(angle).cos());
                let (cos, angle) = (first + (last - first) * along, f64::from(h[0]) + width(h) * around);
                let sin = (1.0 - cos * cos).max(0.0).sqrt();
                ([sin * angle.cos(), sin * angle.sin(), -cos], width(h) * (first - last))
            }
            Planes::B => {
                let [first, last] = [h[0], h[1]].map(|angle| f64::from(angle).sin());
                let (sin, angle) = (first + (last - first) * along, f64::from(v[0]) + width(v) * around);
                let cos = (1.0 - sin * sin).max(0.0).sqrt();
                ([cos * angle.sin(), -sin, -cos * angle.cos()], width(v) * (last - first))
            }
        };
        (Vec3::from(direction.map(|x| x as f32)), solid_angle)
    }

    /// For a device that looks it up as [`Table::at`] does: numbers of vertical and of horizontal angles, and 1 of B planes, else 0; then
    /// these angles, and all values over the largest.
    #[expect(clippy::cast_possible_truncation, reason = "a file has some thousand angles at most")]
    pub fn words(&self) -> ([u32; 3], Vec<f32>) {
        let counts = [self.vertical.len() as u32, self.horizontal.len() as u32, u32::from(self.planes == Planes::B)];
        let (angles, most) = (self.vertical.iter().chain(&self.horizontal).copied(), self.max());
        (counts, angles.chain(self.candela.iter().map(|&candela| candela / most)).collect())
    }

    /// Everything as bytes.
    pub fn bytes(&self) -> Vec<u8> {
        // 1 stood for type B as long as it was read with its angles the other way round.
        let mut bytes = vec![if self.planes == Planes::B { 2 } else { 0 }];
        for values in [&self.vertical, &self.horizontal, &self.candela] {
            bytes.extend_from_slice(&(values.len() as u64).to_le_bytes());
            bytes.extend_from_slice(bytemuck::cast_slice(values));
        }
        bytes
    }
}

fn width(angles: &[f32]) -> f64 {
    f64::from(angles[1]) - f64::from(angles[0])
}

/// What is linear from one polar angle to another, times its sine, integrated.
fn across_sine(angles: &[f32], [first, last]: [f64; 2]) -> f64 {
    let [from, to] = [f64::from(angles[0]), f64::from(angles[1])];
    first * from.cos() - last * to.cos() + (last - first) / (to - from) * (to.sin() - from.sin())
}

/// What is linear from one latitude to another, times its cosine, integrated.
fn across_cosine(angles: &[f32], [first, last]: [f64; 2]) -> f64 {
    let [from, to] = [f64::from(angles[0]), f64::from(angles[1])];
    last * to.sin() - first * from.sin() + (last - first) / (to - from) * (to.cos() - from.cos())
}

/// Index of the angle below, and how far it is to the next one, 0…1; `None` outside.
#[expect(clippy::arithmetic_side_effects, reason = "indices in a table of angles by angles")]
fn bracket(angles: &[f32], angle: f32) -> Option<(usize, f32)> {
    let (first, last) = (*angles.first()?, *angles.last()?);
    if !(first - SLACK..=last + SLACK).contains(&angle) {
        return None;
    }
    let upper = angles.partition_point(|&a| a <= angle).clamp(1, angles.len() - 1);
    let share = (angle - angles[upper - 1]) / (angles[upper] - angles[upper - 1]);
    Some((upper - 1, share.clamp(0.0, 1.0)))
}
