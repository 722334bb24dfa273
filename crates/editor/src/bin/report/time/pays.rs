//! After how many changes of light a bake has cost less than a render of each.

use super::runs::SEEDS;
use super::{CHAPTERS, CLASSES, Measured, Subject, TARGETS_DB, Way};
use crate::fit::{secs_between, spread};

/// What is made once for all looks; ours first.
const BAKES: [Way; 5] = [Way::Default, Way::Fast, Way::Exact, Way::Dense, Way::Renders];
const N_OURS: usize = 3;

/// A table over all kinds of light and scenes, and what it says of ours.
pub(super) fn table(scenes: &[(Subject, Measured)], of: &str) -> String {
    let mut text = format!(
        "\n### Where a bake pays for itself{of}\n\n\
         Looks after which the bake has cost less CPU time than a render of each at the same error: of looks that are one single light, all\n\
         lights of the file, or a spot on a panel. Relighting itself takes milliseconds (see Relighting) and is not counted. \"≤\" and \">\": one of\n\
         the two reached the error before the first point that was measured, or would have after the last; \"—\": nothing follows from them. Errors beyond what the\n\
         reference can tell have no row. All of it is of seed {} alone; how far seeds lie apart stands under Repeats.\n\n\
         | looks | scene | dB | {} |\n|---|---|---|{}\n",
        SEEDS[0],
        BAKES.map(Way::name).join(" | "),
        "---|".repeat(BAKES.len()),
    );
    let mut told = String::new();
    for (class, ..) in CHAPTERS {
        let (rows, ours) = of_class(scenes, class);
        text += &rows;
        told += &ours;
    }
    text += "\nA bake of ours is ahead after at most so many looks, median (least…greatest) of the rows whose points tell it:\n\n";
    text + &told
}

/// The rows of a class of light that its references can judge, and what they say of ours; nothing where no scene has such light.
fn of_class(scenes: &[(Subject, Measured)], class: usize) -> (String, String) {
    let mut rows = String::new();
    let (mut most, mut n_rows, mut n_beyond): ([Vec<f64>; N_OURS], usize, usize) = Default::default();
    for (subject, measured) in scenes {
        let render = measured.curve(Way::Plain, class);
        let bakes = BAKES.map(|way| measured.curve(way, class));
        for target in TARGETS_DB {
            let Some(render) = secs_between(target, &render) else { continue };
            if measured.is_beyond(target, class) {
                n_beyond += 1;
                continue;
            }
            let bakes = bakes.each_ref().map(|curve| secs_between(target, curve));
            for (most, bake) in most.iter_mut().zip(bakes) {
                most.extend(bake.and_then(|bake| most_looks(bake, render)));
            }
            let words = |bake: Option<[f64; 2]>| looks_words(bake?, render);
            let cells = bakes.map(|bake| words(bake).unwrap_or_else(|| "—".into()));
            rows += &format!("| {} | {} | {target:.0} | {} |\n", CLASSES[class], subject.name, cells.join(" | "));
            n_rows += 1;
        }
    }
    if n_rows + n_beyond == 0 {
        return Default::default();
    }
    let told: Vec<String> = BAKES.into_iter().zip(&most).map(|(way, most)| most_words(way, most)).collect();
    let beyond =
        if n_beyond > 0 { format!("; {n_beyond} are beyond what the reference can tell") } else { String::new() };
    (rows, format!("- {}: {}; of {n_rows} rows{beyond}.\n", CLASSES[class], told.join("; ")))
}

/// After how many looks at most a way is ahead, and how many rows tell it.
fn most_words(way: Way, most: &[f64]) -> String {
    let [least, median, greatest] = spread(most);
    match most.len() {
        0 => format!("*{}* in none", way.name()),
        // The median of an even number of rows may be a half, which is told as it is.
        n => format!("*{}* {median} ({least:.0}…{greatest:.0}) in {n}", way.name()),
    }
}

/// The most looks that a bake costs, given the same; nothing where there is no most.
fn most_looks(bake: [f64; 2], render: [f64; 2]) -> Option<f64> {
    let looks = up(bake[1] / render[0]);
    looks.is_finite().then_some(looks)
}

/// So many looks that a bake costs, given the least and the greatest seconds of the bake and of a render; nothing where all is possible.
fn looks_words(bake: [f64; 2], render: [f64; 2]) -> Option<String> {
    let [least, greatest] = [bake[0] / render[1], bake[1] / render[0]];
    match (least == greatest, greatest.is_finite(), least >= 1.0) {
        (true, ..) => Some(format!("{:.0}", up(greatest))),
        (_, true, _) => Some(format!("≤ {:.0}", up(greatest))),
        (_, _, true) => Some(format!("> {:.0}", least.floor())),
        _ => None,
    }
}

/// The next whole number; what is one but for rounding stays it.
fn up(looks: f64) -> f64 {
    (looks * (1.0 - 1e-9)).ceil()
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use clerestory_transport::camera::Film;

    use super::super::Point;
    use super::*;

    #[test]
    fn a_bake_pays_after_as_many_looks_of_a_kind_as_it_costs_renders_of_one() {
        let point = |way: Way, cpu_secs: f64, db: [Option<f64>; 3]| Point { way, seed: 1, spp: Some(4), cpu_secs, db };
        let both = |db: f64| [Some(db), None, Some(db)];
        let points = vec![
            point(Way::Fast, 1.0, both(20.0)),
            point(Way::Fast, 16.0, both(40.0)),
            point(Way::Plain, 0.1, [None, None, Some(20.0)]),
            point(Way::Plain, 1.6, [None, None, Some(40.0)]),
            point(Way::Renders, 2.0, both(20.0)),
            point(Way::Renders, 32.0, both(40.0)),
        ];
        let (film, path) = (Film { width: 4, height: 3 }, PathBuf::new());
        let subject =
            Subject { name: "hall", path, sky: None, panel: None, film, step: 1, reference_spp: 64, n_seeds: 3 };
        let mut scenes = [(subject, Measured { n_cols: 8, points, ends: [None; 3] })];
        let told = table(&scenes, ", in a test");
        assert!(told.starts_with("\n### Where a bake pays for itself, in a test\n"), "{told}");
        assert!(told.contains("of seed 1 alone"), "{told}");
        assert!(told.contains("| all lights of the file | hall | 30 | — | 10 | — | — | 20 |"), "{told}");
        assert!(told.contains("| single lights | hall | 30 | — | 4 | — | — | 8 |"), "one of eight lights: {told}");
        assert!(!told.contains("| spots on a panel |"), "the scene has none: {told}");
        let ours = "- all lights of the file: *ours, by default* in none; *ours, indirect light shared* 10 (10…10) in 3; \
                    *ours, traced, not denoised* in none; of 3 rows.\n";
        assert!(told.ends_with(ours), "{told}");
        // As far as the reference tells, and no farther.
        scenes[0].1.ends[2] = Some(32.0);
        let told = table(&scenes, ", in a test");
        assert!(told.contains("| all lights of the file | hall | 30 |"), "{told}");
        assert!(!told.contains("| all lights of the file | hall | 35 |"), "{told}");
        assert!(told.ends_with("in none; of 1 rows; 2 are beyond what the reference can tell.\n"), "{told}");
    }

    #[test]
    fn looks_are_told_as_far_as_the_points_tell_them() {
        let endless = f64::INFINITY;
        let looks = |bake, render| looks_words(bake, render).unwrap_or_default();
        assert_eq!(looks([10.0, 10.0], [98.0, endless]), "≤ 1", "a render takes more");
        assert_eq!(looks([0.0, 1.4], [0.5, 0.5]), "≤ 3", "the first point is good enough");
        assert_eq!(looks([70.0, endless], [20.0, 20.0]), "> 3");
        assert_eq!(looks([70.0, endless], [20.0, endless]), "");
        assert_eq!(looks([7.0, endless], [20.0, 20.0]), "", "more than none says nothing");
        assert_eq!(most_looks([70.0, endless], [20.0, 20.0]), None);
        assert_eq!(most_looks([0.0, 1.4], [0.5, 0.5]), Some(3.0));
        let told = [vec![2.0, 3.0], vec![9.0, 1.0, 2.0]].map(|most| most_words(Way::Fast, &most));
        assert_eq!(told, ["2.5 (2…3) in 2", "2 (1…9) in 3"].map(|looks| format!("*{}* {looks}", Way::Fast.name())));
    }
}
