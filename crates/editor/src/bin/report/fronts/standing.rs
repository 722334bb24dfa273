//! What the fronts say: who stands on them most often, and how far ours is from them where it does not.

use std::cmp::Reverse;

use super::{OURS, Point, front};
use crate::fit::tenths;

/// How many methods are named.
const N_NAMED: usize = 4;

/// What is counted as cost, and whether that of a point is within what repeats of another one differ by.
pub(super) type Measure = (fn(&Point) -> f64, fn(&Point, &Point) -> bool);

/// A point of ours beside the cheapest one that has no more error.
struct Off<'a> {
    ours: &'a Point,
    /// What it costs more than that one, in percent of it.
    percent: f64,
    is_within: bool,
}

/// A sentence about the fronts of all matrices, and a table with a row of each.
pub(super) fn words(found: &[(String, Vec<Point>)], measure: Measure) -> String {
    let (mut rows, mut names, mut all_off, mut n_ours) = (String::new(), Vec::new(), Vec::new(), 0);
    for (matrix, points) in found {
        let on_it: Vec<&str> = front(points, measure.0).into_iter().map(|point| point.name.as_str()).collect();
        let of_matrix = points.iter().filter(|point| point.name == OURS).count();
        let off = off(points, measure);
        let places: Vec<String> = off.iter().map(|off| format!("{} +{:.1} %", off.ours.at, off.percent)).collect();
        rows += &format!(
            "| {matrix} | {} | {} | {} of {of_matrix} | {} |\n",
            on_it.len(),
            most_often(&on_it),
            of_matrix - off.len(),
            if places.is_empty() { String::from("—") } else { places.join(", ") },
        );
        names.extend(on_it);
        all_off.extend(off);
        n_ours += of_matrix;
    }
    format!(
        "\nOn the fronts of all matrices are {} points, most often: {}. {}\n\n\
         | matrix | points | most often | ours on the front | off it: more than the least with no more error |\n|---|---|---|---|---|\n{rows}",
        names.len(),
        most_often(&names),
        words_of_ours(&all_off, n_ours),
    )
}

/// Where ours is, in all.
fn words_of_ours(off: &[Off<'_>], n_ours: usize) -> String {
    if off.is_empty() {
        return format!("Ours is on the front at each of its {n_ours} points.");
    }
    let percents = off.iter().map(|off| off.percent).collect();
    let n_within = off.iter().filter(|off| off.is_within).count();
    let within = if n_within > 0 {
        format!(", {n_within} of them by no more than the rounds of that one differ")
    } else {
        String::new()
    };
    format!(
        "Ours is on the front at {} of its {n_ours} points; at the others it takes {} % more than the least with no more error{within}.",
        n_ours - off.len(),
        tenths(percents),
    )
}

/// The most frequent names with their numbers; those that are as frequent in the order of the front.
fn most_often(names: &[&str]) -> String {
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for &name in names {
        match counts.iter_mut().find(|(known, _)| *known == name) {
            Some((_, count)) => *count += 1,
            None => counts.push((name, 1)),
        }
    }
    counts.sort_by_key(|(_, count)| Reverse(*count));
    let words: Vec<String> = counts.iter().take(N_NAMED).map(|(name, count)| format!("`{name}` {count}")).collect();
    words.join(", ")
}

/// Points of ours that are not on the front.
fn off(points: &[Point], (cost, is_within): Measure) -> Vec<Off<'_>> {
    let on_front = front(points, cost);
    let is_off = |point: &&Point| point.name == OURS && !on_front.iter().any(|other| std::ptr::eq(*other, *point));
    let beside = points.iter().filter(is_off).filter_map(|ours| {
        let no_worse = points.iter().filter(|point| point.db >= ours.db);
        let least = no_worse.min_by(|a, b| cost(a).total_cmp(&cost(b)))?;
        Some(Off { ours, percent: 100.0 * (cost(ours) / cost(least) - 1.0), is_within: is_within(ours, least) })
    });
    beside.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(name: &str, at: &str, [bytes, db]: [f64; 2]) -> Point {
        let point = Point::new(name.into(), at.into(), vec![[bytes, db]]);
        Point { millis: bytes, most_millis: 1.1 * bytes, ..point }
    }

    #[test]
    fn who_is_on_the_front_is_counted_and_ours_beside_it_tells_by_how_much() {
        let points = vec![
            point("svd", "rank 2", [10.0, 10.0]),
            point(OURS, "20 dB", [20.0, 20.0]),
            point("svd", "rank 4", [40.0, 31.0]),
            // One that is cheaper has less error: 42 for 40.
            point(OURS, "30 dB", [42.0, 30.0]),
            point("row-id", "rank 8", [90.0, 39.0]),
        ];
        let found = [("a room".to_string(), points)];
        let bytes: Measure = (|point| point.bytes, |_, _| false);
        let told = words(&found, bytes);
        assert!(told.contains(
            "On the fronts of all matrices are 4 points, most often: `svd` 2, `ours, packed` 1, `row-id` 1."
        ));
        assert!(
            told.contains("at 1 of its 2 points; at the others it takes 5.0 % more than the least with no more error.")
        );
        assert!(
            told.ends_with("| a room | 4 | `svd` 2, `ours, packed` 1, `row-id` 1 | 1 of 2 | 30 dB +5.0 % |\n"),
            "{told}"
        );
        let time: Measure = (|point| point.millis, |ours, other| ours.millis <= other.most_millis);
        let told = words(&found, time);
        assert!(told.contains("no more error, 1 of them by no more than the rounds of that one differ."), "{told}");
        assert_eq!(words_of_ours(&[], 6), "Ours is on the front at each of its 6 points.");
    }
}
