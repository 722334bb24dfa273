//! CPU seconds to an error, by every way, and which of them is the soonest.

use clerestory_transport::camera::Film;

use super::runs::SEEDS;
use super::{CLASSES, Measured, PLAIN, Subject, TARGETS_DB, Way};
use crate::fit::{secs_between, secs_words};

/// CPU seconds to the targets, the least in bold.
pub(super) fn words(scenes: &[(Subject, Measured)], class: usize) -> String {
    let ways: Vec<&str> = Way::ALL.iter().map(|way| way.name()).collect();
    let mut text = format!(
        "\nCPU seconds to an error of {}, of seed {} alone, between measured points; \"<\" and \">\": it was reached before the first point, or would be after the last, which has the dB behind it; \"—\": not measured, \
         as it takes too long; \"†\": more dB than the reference can tell, see below: such rows tell of no way that it is the soonest. The least of each row in bold, where the points tell which it is{}.\n\n| scene | size | dB | {} |\n|---|---|---|{}\n",
        CLASSES[class],
        SEEDS[0],
        if class == 0 { ", a render of one of the lights aside" } else { "" },
        ways.join(" | "),
        "---|".repeat(ways.len()),
    );
    let (mut ahead, mut n_rows, mut n_beyond) = ([0; Way::ALL.len()], 0, 0);
    for (subject, measured) in scenes {
        let curves = Way::ALL.map(|way| measured.curve(way, class));
        if curves.iter().all(Vec::is_empty) {
            continue;
        }
        for target in TARGETS_DB {
            let mut secs = curves.each_ref().map(|curve| secs_between(target, curve));
            if class == 0 {
                secs[PLAIN] = None;
            }
            let is_beyond = measured.is_beyond(target, class);
            let soonest = if is_beyond { None } else { soonest(secs) };
            n_rows += 1;
            n_beyond += usize::from(is_beyond);
            soonest.into_iter().for_each(|nth| ahead[nth] += 1);
            let cell = |nth: usize| match secs_words(target, &curves[nth]) {
                words if soonest == Some(nth) => format!("**{words}**"),
                words => words + &short_of(target, &curves[nth]),
            };
            let cells: Vec<String> = (0..curves.len()).map(cell).collect();
            let Film { width, height } = subject.film;
            let mark = if is_beyond { " †" } else { "" };
            text += &format!("| {} | {width}×{height} | {target:.0}{mark} | {} |\n", subject.name, cells.join(" | "));
        }
    }
    text + &ahead_words(ahead, n_rows, n_beyond)
}

/// Which way is the soonest in how many rows, given how many the reference cannot judge.
fn ahead_words(ahead: [usize; Way::ALL.len()], n_rows: usize, n_beyond: usize) -> String {
    let mut ways: Vec<(usize, &str)> = ahead.into_iter().zip(Way::ALL.map(Way::name)).filter(|way| way.0 > 0).collect();
    ways.sort_by_key(|way| std::cmp::Reverse(way.0));
    let mut told: Vec<String> = ways.iter().map(|(n, name)| format!("{name} in {n}")).collect();
    told.push(format!("the points do not tell in {}", n_rows - n_beyond - ahead.iter().sum::<usize>()));
    told.extend((n_beyond > 0).then(|| format!("{n_beyond} are beyond what the reference can tell")));
    format!("\nThe soonest of {n_rows} rows: {}.\n", told.join("; "))
}

/// What the last point has of an error that it does not reach; nothing where it is reached.
fn short_of(target_db: f64, curve: &[[f64; 2]]) -> String {
    match (secs_between(target_db, curve), curve.last()) {
        (Some([_, greatest]), Some([_, db])) if greatest.is_infinite() => format!(" ({db:.1} dB)"),
        _ => String::new(),
    }
}

/// Which of several certainly takes the fewest seconds, given the least and the greatest that each can take.
fn soonest<const N: usize>(secs: [Option<[f64; 2]>; N]) -> Option<usize> {
    let is_first = |&nth: &usize| {
        let mut others = secs.iter().enumerate().filter(|(other, _)| *other != nth).filter_map(|(_, secs)| *secs);
        secs[nth].is_some_and(|[_, most]| most.is_finite() && others.all(|[least, _]| most <= least))
    };
    (0..N).find(is_first)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::tests::{point, subject};

    #[test]
    fn the_soonest_way_is_bold_and_what_no_reference_can_tell_is_marked() {
        let points = vec![
            point(Way::Fast, 1.0, 20.0),
            point(Way::Fast, 16.0, 40.0),
            point(Way::Plain, 0.1, 20.0),
            point(Way::Plain, 1.6, 40.0),
        ];
        let scenes = [(subject("hall"), Measured { n_cols: 1, points, ends: [Some(30.0), None, Some(32.25)] })];
        let rows = words(&scenes, 2);
        assert!(rows.starts_with("\nCPU seconds to an error of all lights of the file, of seed 1 alone,"), "{rows}");
        assert!(rows.contains("| hall | 4×3 | 30 | — | 4.0 | — | — | — | **0.40** |"), "{rows}");
        assert!(rows.contains("| hall | 4×3 | 35 † | — | 8.0 | — | — | — | 0.80 |"), "nothing is bold: {rows}");
        let told = "The soonest of 3 rows: a render of one look in 1; the points do not tell in 0; \
                    2 are beyond what the reference can tell.\n";
        assert!(rows.ends_with(told), "{rows}");
        assert!(!words(&scenes, 0).contains("hall"), "no single lights were measured");
        let curve = [[1.0, 20.0], [103.0, 21.6]];
        assert_eq!([21.0, 30.0].map(|db| short_of(db, &curve)), ["", " (21.6 dB)"]);
        let endless = f64::INFINITY;
        assert_eq!(soonest([Some([4.0, 4.0]), None, Some([3.0, endless])]), None, "the last may take 3 or 300");
        assert_eq!(soonest([Some([0.0, 1.4]), Some([1.7, 1.7])]), Some(0));
        assert_eq!(soonest([Some([9.0, endless]), None]), None);
    }
}
