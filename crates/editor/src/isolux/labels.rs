//! Where the labels of lines stand, so that none covers another.

use super::{Isoline, distance, length};

/// A label in the middle of a place.
#[derive(Clone, Debug, PartialEq)]
pub struct Label<'a> {
    /// What it says.
    pub words: &'a str,
    /// Its middle.
    pub middle: [f32; 2],
    /// Width and height.
    pub size: [f32; 2],
}

/// Places along a line where a label may stand, as shares of its length; the first that is free is taken.
const PLACES: [f32; 7] = [0.5, 0.25, 0.75, 0.375, 0.625, 0.125, 0.875];
/// A line that is shorter than so many widths of its label has none.
const LEAST_WIDTHS: f32 = 3.0;
/// Room between labels, as a share of their height.
const AIR: f32 = 1.5;

/// Places a label on each line that is long enough, the longest lines first. Points of lines become places by `place`, and labels stay
/// within `bounds`, left, top, right and bottom.
pub fn place_labels<'a>(
    lines: &'a [Isoline],
    place: impl Fn([f32; 2]) -> [f32; 2],
    bounds: [f32; 4],
    mut size_of: impl FnMut(&str) -> [f32; 2],
) -> Vec<Label<'a>> {
    let mut by_length: Vec<(f32, Vec<[f32; 2]>, &str)> = Vec::new();
    for line in lines {
        let points: Vec<[f32; 2]> = line.points.iter().map(|point| place(*point)).collect();
        by_length.push((length(&points), points, line.words.as_str()));
    }
    by_length.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut placed: Vec<Label> = Vec::new();
    for (whole, points, words) in by_length {
        let size = size_of(words);
        if whole < LEAST_WIDTHS * size[0] {
            continue;
        }
        let labels = PLACES.iter().map(|share| Label { words, middle: along(&points, share * whole), size });
        let free =
            labels.into_iter().find(|label| label.is_within(bounds) && !placed.iter().any(|other| label.meets(other)));
        placed.extend(free);
    }
    placed
}

impl Label<'_> {
    fn is_within(&self, [left, top, right, bottom]: [f32; 4]) -> bool {
        let ([x, y], [width, height]) = (self.middle, self.size);
        x - width / 2.0 >= left && x + width / 2.0 <= right && y - height / 2.0 >= top && y + height / 2.0 <= bottom
    }

    fn meets(&self, other: &Label) -> bool {
        let air = AIR * self.size[1];
        (0..2).all(|axis| {
            (self.middle[axis] - other.middle[axis]).abs() < (self.size[axis] + other.size[axis]) / 2.0 + air
        })
    }
}

/// The place at some way along a line.
fn along(points: &[[f32; 2]], way: f32) -> [f32; 2] {
    let mut left = way;
    for ends in points.windows(2) {
        let step = distance(ends[0], ends[1]);
        if step >= left && step > 0.0 {
            let share = left / step;
            return [0, 1].map(|axis| ends[0][axis] + share * (ends[1][axis] - ends[0][axis]));
        }
        left -= step;
    }
    points.last().copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(words: &str, points: &[[f32; 2]]) -> Isoline {
        Isoline { lux: 1.0, words: words.into(), points: points.to_vec() }
    }

    #[test]
    fn labels_stand_on_their_lines_and_none_covers_another() {
        let lines = [
            line("long", &[[0.0, 50.0], [200.0, 50.0]]),
            line("near", &[[10.0, 55.0], [190.0, 55.0]]),
            line("short", &[[0.0, 90.0], [30.0, 90.0]]),
        ];
        let bounds = [0.0, 0.0, 100.0, 50.0];
        let labels = place_labels(&lines, |[x, y]| [x / 2.0, y / 2.0], bounds, |_| [20.0, 8.0]);
        let told: Vec<(&str, [f32; 2])> = labels.iter().map(|label| (label.words, label.middle)).collect();
        // The second one gives way to an eighth of its line, 2.5 below the first.
        assert_eq!(told, [("long", [50.0, 25.0]), ("near", [16.25, 27.5])]);
        assert!(!labels[0].meets(&labels[1]));
        assert!(labels.iter().all(|label| label.words != "short"), "its line is no longer than its label");
    }
}
