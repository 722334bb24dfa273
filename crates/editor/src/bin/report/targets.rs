//! What the method aims at, and what it reaches: on the shared matrices, beside the best there is and other methods; and, as a
//! section of its own, in bakes of the scenes of its evaluation.

mod at_tolerance;
pub mod baked;
pub mod coded;
mod grid;
pub mod judged;
mod many;
mod shared_right;
pub mod soft;
mod times;
mod told;
mod traced;

use std::cmp::Ordering;
use std::path::Path;

use anyhow::{Context, Result, anyhow};
use clerestory_nystrom::CompressConfig;
use clerestory_nystrom::rivals::{Core, Method};
use serde::{Deserialize, Serialize};

use self::coded::{Coded, Coding, Subject};
use self::grid::Grid;
use self::judged::{Judged, decibels};
use super::desk::Desk;
use super::fit::{hundredths, tenths, wholes};
use super::methods::checksums;
use super::methods::dense::Picture;

/// Ours first, then the best there is, then the others; before them stands the paper's Algorithm 4.
const METHODS: [Method; 4] = [Method::Projected, Method::Svd, Method::Alg4(Core::Projection), Method::RowId];
/// Thresholds of the pseudo-inverse that Algorithm 4 is tried with: for each target that counts which comes nearest, and which
/// stores least where several reach it.
const RCONDS: [f64; 3] = [1e-2, 1e-3, 1e-4];
/// A method reached its target if it lacks no more than this, dB.
const SLACK_DB: f64 = 0.5;
/// Shared matrices, tolerances in dB, and the ratios that are aimed at.
const RATIOS: [(&str, f64, Option<f64>); 6] = [
    ("reflect", 45.0, Some(98.0)),
    ("reflect", 40.0, Some(130.0)),
    ("reflect", 35.0, None),
    ("mixed", 45.0, Some(116.0)),
    ("mixed", 40.0, Some(188.0)),
    ("mixed", 35.0, None),
];
/// Times as large a ratio as is aimed at would be better yet.
const STRETCH: f64 = 1.25;
/// Times that ours is measured.
const ROUNDS: usize = 3;
/// Seeds of Algorithm 4's k-means, from 0 on.
const N_SEEDS: u64 = 3;
/// Tolerances that noisy halves are asked for, in dB, and who is asked for them beside us. Of the first both halves can tell; what is asked
/// for by the next ones is below what they can tell apart.
const NOISY: [(f64, &[Method]); 4] =
    [(25.0, &BESIDE_NOISE), (30.0, &BESIDE_NOISE), (35.0, &[Method::Svd]), (40.0, &[Method::Svd])];
/// Others know no noise from signal and fit it with great ranks, so that all of them at all tolerances would take too long.
const BESIDE_NOISE: [Method; 3] = [Method::Svd, Method::Alg4(Core::PseudoInverse { rcond: RCONDS[0] }), Method::RowId];
/// No block is aimed to be worse than what is asked for by more than so many dB.
const WORST_BELOW_DB: f64 = 4.0;
/// What is asked for so many dB is looked at for a grid: no border of blocks is aimed to step by so many levels of 8 bits more than within.
const GRID_DB: f64 = 35.0;
const GRID_LEVELS: f64 = 0.5;

/// One method's results.
type Results = Vec<(Method, Result<Coded>)>;
/// A figure of what was judged.
type Figure = fn(&Judged) -> f64;
/// The text of a part, and its rows of the table of targets.
type Told = (String, Goals);

/// Those that are tried on traced blocks.
fn rconds(desk: &Desk) -> &'static [f64] {
    &RCONDS[..desk.choose(1, RCONDS.len())]
}

fn rconds_words(rconds: &[f64]) -> String {
    rconds.iter().map(f64::to_string).collect::<Vec<_>>().join(", ")
}

/// Measures everything that one page can hold.
///
/// # Errors
/// If a matrix cannot be read, or our own method finds no factors.
pub fn write(desk: &Desk) -> Result<String> {
    let mut told: Vec<Told> = Vec::new();
    let names: &[&str] = desk.choose(&["mixed"], &["reflect", "mixed"]);
    let checksums = checksums(desk, names)?;
    for name in names {
        let Some(path) = desk.shared(&format!("matrices/{name}.npz")) else { continue };
        told.push(desk.part("targets", name, || of_matrix(desk, name, &path))?);
        if *name == "mixed" {
            told.push(desk.part("targets", "noisy-halves", || noisy(desk, &path))?);
        }
    }
    told.push(told::write(desk)?);
    told.push(at_tolerance::write(desk)?);
    told.push(desk.part("targets", "many-columns", || many::sharp(desk))?);
    told.push(desk.part("targets", "many-columns, baked", || many::baked(desk))?);
    let (times, share): (String, f64) = desk.part("targets", "times", || times::write(desk))?;
    let (mut text, mut goals) = (String::new(), Goals::default());
    for (of_part, goals_of_part) in told {
        text += &of_part;
        goals.rows.extend(goals_of_part.rows);
    }
    goals.at_most("compressing over tracing".into(), 5.0, 100.0 * share, format!("{:.1} %", 100.0 * share));
    text += &times;
    Ok(format!(
        "## Targets\n\n\
         What the method aims at, on `mixed` and `reflect` (see the head of this page) of 128 × 96 pixels and 256 columns without the emitters seen. They were traced,\n\
         too, so that what is asked for here counts noise of theirs as matter to be kept. No halves of them are at hand, so that noise is not measured here. Where it lies\n\
         6 dB or more below an error that is told, it adds 1 dB at most to that; this limits what is told of noisy halves alone, since where the converged matrix itself is compressed its noise is no error. {checksums}dB are 10·log10(pk² / mean ΔT²)\n\
         over all entries, pk the median over columns of their 99.5 percentile. Every method is asked for the same tolerance, block by block of\n\
         16 × 16 pixels; what it finds is packed as a bake is, read back, and held against the converged matrix; *short of it* is what lacks more than {SLACK_DB} dB of what was asked for. The ratio is the dense matrix in\n\
         single precision over all bytes of the packed one; its picture under all columns is kept far better than asked, which is counted. `svd` is the\n\
         best there is at equal rank (Eckart–Young), packed alike; `row-id` is the next best at equal rank on blocks of both matrices, as Methods has it. The least rank is that of all singular values of all\n\
         blocks under one threshold, at the error that was reached. Multiply-adds are those of a product with three channels of light, per pixel: with\n\
         factors as they are unpacked, which is what the relighters do, and with right factors in cosines, zeros left out (`PackedProduct`).\n\
         Seams: the step of the error from pixel to pixel, root mean square, across borders of blocks over within.\n\
         Grid: whether borders of blocks show on a display. The picture under all columns at 1 is exposed so that the {} percentile of its luminance is white, clipped there and encoded in sRGB without a tone curve, in levels of 8 bits\n\
         that are not rounded, so that nothing hides in the rounding. Steps of the error are taken across each border of two blocks, in two ways, averaged over the channels: the mean of their sizes over the pixels along it, and the size of their mean, which\n\
         the eye follows along a border even where single pixels step more. Each is told less the mean of the same between the lines of pixels within both blocks, and the greater of both counts. Aimed at is that not even the worst of all borders has {GRID_LEVELS} levels:\n\
         what is less is rounded off more often than not. As that picture is kept far better than asked, the same is told under each column alone, exposed by itself: medians over the columns of the worst border and of the mean. That has no goal, since errors as large\n\
         as asked for are seen within blocks as well, and seams judge how these step. Told: blocks that tell their error to\n\
         between 0.8 and 1.25 of it; ours is told the converged matrix as both halves, but for the noisy halves and in bakes, so that only there its estimate can be wrong. Milliseconds of one core per block, factors + bytes:\n\
         of ours the shortest of {} rounds, one round for the noisy halves and for the many columns; of others one round, which holds the search for the rank that\n\
         the tolerance takes, which ours finds on the way. Algorithm 4 has for each target that threshold of its pseudo-inverse of {} that suits it best; chapters that try others tell them. Seed {}; below the tables Algorithm 4 with more of them, and each chapter that traces tells its own.\n\
         What is missed: of sharp shadows in many columns and of multiply-adds [decision 0040](decisions/0040-no-right-basis-is-shared.md) tells why, of the errors that noisy halves tell [decision 0041](decisions/0041-no-block-is-worse-than-its-samples.md);\n\
         milliseconds per block stand beside those of tracing in the last row, as [decision 0046](decisions/0046-blocks-are-traced-whole.md) weighs them. {}\n\n{}{text}",
        grid::WHITE_PERCENT,
        desk.choose(1, ROUNDS),
        rconds_words(&RCONDS),
        CompressConfig::default().seed,
        desk.load_words(),
        goals.table(),
    ))
}

/// All methods on a shared matrix, at each of its targets.
fn of_matrix(desk: &Desk, name: &str, path: &Path) -> Result<Told> {
    let subject = Subject::new(Picture::shared(path, "T")?, None);
    let (mut text, mut goals) = (String::new(), Goals::default());
    for (_, target_db, aim) in RATIOS.into_iter().filter(|(of, ..)| *of == name) {
        let results = results(desk, name, &subject, target_db);
        text += &format!("\n### `{name}` at {target_db} dB\n\n{}", table(&subject, target_db, &results));
        text += &seeds_words(desk, (name, &subject), target_db, &results);
        goals.of_ratio(name, &subject, (target_db, aim), &results)?;
        if target_db == GRID_DB {
            goals.of_grid(name, &subject, &results);
        }
    }
    Ok((text, goals))
}

/// All methods in turn, ours first and more than once: what it finds is the same, and the shortest time counts.
fn results(desk: &Desk, name: &str, subject: &Subject, target_db: f64) -> Results {
    let coded = |method: Method| coded_by(desk, method, (name, subject), target_db);
    let [ours, best, others @ ..] = METHODS;
    let fourth = best_fourth(RCONDS.map(|rcond| coded(Method::Alg4(Core::PseudoInverse { rcond }))).into(), target_db);
    let mut results: Results = [ours, best].map(coded).into_iter().chain(fourth).chain(others.map(coded)).collect();
    for _ in 1..desk.choose(1, ROUNDS) {
        if let (Some((_, Ok(found))), Ok(again)) = (results.first_mut(), coded(ours).1) {
            found.millis = [0, 1].map(|which| found.millis[which].min(again.millis[which]));
        }
    }
    results
}

/// How far Algorithm 4 lies apart with other seeds of its k-means, a sentence; nothing in a quick report.
fn seeds_words(desk: &Desk, (name, subject): (&str, &Subject), target_db: f64, results: &Results) -> String {
    let is_fourth = |method: &Method| matches!(method, Method::Alg4(Core::PseudoInverse { .. }));
    let Some((method, Ok(first))) = results.iter().find(|(method, _)| is_fourth(method)) else { return String::new() };
    let figures = |coded: &Coded| [decibels(coded.judged.mean_square()), coded.ratio, coded.mean_rank];
    let mut found = vec![figures(first)];
    for seed in 1..desk.choose(1, N_SEEDS) {
        desk.say(&format!("{method} on {name} at {target_db} dB, seed {seed}"));
        match subject.coded_as(Coding { method: *method, seed, ..Coding::default() }, target_db) {
            Ok(coded) => found.push(figures(&coded)),
            Err(error) => return format!("\n`{method}` with seed {seed}: {error:#}.\n"),
        }
    }
    if found.len() < 2 {
        return String::new();
    }
    let all = |nth: usize| found.iter().map(|figures| figures[nth]).collect::<Vec<f64>>();
    format!(
        "\n`{method}` with {} seeds, median (least…greatest): {} dB, dense / bytes {}×, mean rank {}.\n",
        found.len(),
        tenths(all(0)),
        wholes(all(1)),
        hundredths(all(2)),
    )
}

/// Of those that reach the target that of fewest bytes, else that of least error.
fn best_fourth(tried: Results, target_db: f64) -> Option<(Method, Result<Coded>)> {
    let merit = |(_, result): &(Method, Result<Coded>)| match result {
        Ok(coded) => merit(decibels(coded.judged.mean_square()), coded.ratio, target_db),
        Err(_) => [-1.0, 0.0],
    };
    tried.into_iter().max_by(|a, b| order(merit(a), merit(b)))
}

/// What counts of two results, the more the better: a ratio of those that reach the target, else the error.
fn merit(db: f64, ratio: f64, target_db: f64) -> [f64; 2] {
    if db >= target_db - SLACK_DB { [1.0, ratio] } else { [0.0, db] }
}

fn order(a: [f64; 2], b: [f64; 2]) -> Ordering {
    a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]))
}

const HEAD: &str = "| method | dB | worst block over what is asked | dense / bytes | mean rank | over the least | multiply-adds | seams | told | ms |\n\
    |---|---|---|---|---|---|---|---|---|---|\n";

fn table(subject: &Subject, target_db: f64, results: &Results) -> String {
    let row = |of: &(Method, Result<Coded>)| format!("| {}", row(subject, target_db, of));
    format!("{HEAD}{}", results.iter().map(row).collect::<String>())
}

/// A row of the table, from the name of the method on.
fn row(subject: &Subject, target_db: f64, (method, result): &(Method, Result<Coded>)) -> String {
    match result {
        Ok(coded) => format!("`{method}` {}\n", cells(subject, target_db, coded)),
        Err(error) => format!("`{method}` | {error:#} | | | | | | | | |\n"),
    }
}

/// A value of each method, in words.
fn words_of<'a>(
    results: impl Iterator<Item = &'a (Method, Result<Coded>)>,
    value: &dyn Fn(&Coded) -> String,
) -> String {
    let words = |(method, result): &(Method, Result<Coded>)| {
        format!("`{method}` {}", result.as_ref().map_or("none".into(), value))
    };
    results.map(words).collect::<Vec<_>>().join(", ")
}

/// What a method makes of something of that name.
fn coded_by(desk: &Desk, method: Method, (name, subject): (&str, &Subject), target_db: f64) -> (Method, Result<Coded>) {
    desk.say(&format!("{method} on {name} at {target_db} dB"));
    (method, subject.coded(method, target_db))
}

fn cells(subject: &Subject, target_db: f64, coded: &Coded) -> String {
    let judged = &coded.judged;
    let reached = decibels(judged.mean_square());
    format!(
        "| {reached:.1}{} | {:+.1} | {:.0}× | {:.2} | {} | {:.0} / {:.0} | {:.2} | {:.0} % | {:.1} + {:.1} |",
        if reached < target_db - SLACK_DB { ", short of it" } else { "" },
        judged.worst_db() - target_db,
        coded.ratio,
        coded.mean_rank,
        over_least_words(over_least(subject, coded), "×"),
        coded.multiply_adds[0],
        coded.multiply_adds[1],
        judged.seams,
        100.0 * judged.told_well(),
        coded.millis[0],
        coded.millis[1],
    )
}

/// Mean rank over the least at the error that was reached; `None` where a rank of 0 has no more error.
fn over_least(subject: &Subject, coded: &Coded) -> Option<f64> {
    let least = subject.spectrum.least_mean_rank(coded.judged.mean_square());
    (least > 0.0).then(|| coded.mean_rank / least)
}

fn over_least_words(ratio: Option<f64>, unit: &str) -> String {
    ratio.map_or("—".into(), |ratio| format!("{ratio:.2}{unit}"))
}

/// Two noisy halves against the converged matrix.
fn noisy(desk: &Desk, path: &Path) -> Result<Told> {
    let halves = [Picture::shared(path, "A")?, Picture::shared(path, "B")?];
    let subject = Subject::new(Picture::shared(path, "T")?, Some(halves));
    let sampled = Sampled::new(&subject);
    let before = decibels(sampled.judged.mean_square());
    let (mut rows, mut goals, mut best) = (String::new(), Goals::default(), f64::NEG_INFINITY);
    let mut reached = Vec::new();
    for (target_db, beside) in NOISY {
        desk.say(&format!("the noisy halves of mixed at {target_db} dB"));
        let coded = subject.coded(Method::Projected, target_db)?;
        best = best.max(decibels(coded.judged.mean_square()));
        rows += &format!("| {target_db} dB {}\n", cells(&subject, target_db, &coded));
        let others: Results = desk
            .choose(&[][..], beside)
            .iter()
            .map(|&method| coded_by(desk, method, ("the noisy halves of mixed", &subject), target_db))
            .collect();
        rows +=
            &others.iter().map(|of| format!("| {target_db} dB, {}", row(&subject, target_db, of))).collect::<String>();
        reached.extend(others.iter().filter_map(|(method, result)| {
            let coded = result.as_ref().ok()?;
            Some((*method, decibels(coded.judged.mean_square())))
        }));
        goals.of_noise(target_db, &coded, &others);
        goals.never_worse((&subject, &sampled), target_db, &coded, &others);
    }
    let what = "`mixed`: noisy halves to the converged matrix, dB, best of what was asked";
    goals.at_least(what.into(), 31.0, best, format!("{best:.1}, their mean: {before:.1}"));
    goals.beside(best_words(&reached));
    let text = format!(
        "\n### Noisy halves of `mixed`\n\n\
         Two path-traced halves, the mean of which is at {before:.1} dB, asked for several tolerances: ours{}. The noise of the converged matrix\n\
         counts as error of blocks that come near it. The picture under all columns at 1 is at {:.1} dB as it was sampled, below the value that 99.5 % of the true one do not exceed.\n\n{}{rows}",
        desk.choose(String::new(), beside_words()),
        sampled.all_columns_db,
        HEAD.replacen("method", "asked for, by", 1)
    );
    Ok((text, goals))
}

/// Who is beside ours on noisy halves.
fn beside_words() -> String {
    format!(
        ", and others that fit that mean as it is, Algorithm 4 with the threshold {} alone; where more than {} dB are asked for, the best of them at equal rank (`svd`) alone, for the time that all take",
        RCONDS[0], NOISY[1].0,
    )
}

/// The best of each method over all that it was asked for; nothing of none.
fn best_words(reached: &[(Method, f64)]) -> String {
    let best = |method: Method| {
        let best = reached.iter().filter(|(of, _)| *of == method).map(|(_, db)| *db).reduce(f64::max);
        best.map(|db| format!("`{method}` {db:.1}"))
    };
    BESIDE_NOISE.into_iter().filter_map(best).collect::<Vec<_>>().join(", ")
}

/// How far the samples of a matrix are from it before anything is made of them.
struct Sampled {
    /// Of the picture under all columns at 1.
    all_columns_db: f64,
    /// Entry by entry.
    judged: Judged,
}

impl Sampled {
    fn new(subject: &Subject) -> Sampled {
        let mean = subject.sampled();
        let all_columns_db = all_columns_db(&subject.truth, &mean);
        Sampled { all_columns_db, judged: Judged::of_samples(&subject.truth, mean) }
    }
}

/// Error of the picture under all columns at 1, in dB below its peak.
fn all_columns_db(truth: &Picture, found: &Picture) -> f64 {
    let [truth, found] = [truth, found].map(|picture| {
        let values = picture.values.chunks_exact(picture.n_cols).map(|row| row.iter().sum::<f32>()).collect();
        Picture { n_cols: 1, values, ..*picture }
    });
    let squares: f64 = truth.values.iter().zip(&found.values).map(|(t, x)| f64::from(x - t).powi(2)).sum();
    decibels(squares / truth.values.len() as f64 / truth.peak().powi(2))
}

/// To a tenth, as it is told: what packing rounds is less.
fn tenth(db: f64) -> f64 {
    (10.0 * db).round() / 10.0
}

/// Rows of the table of targets: what, asked for, ours, whether that keeps it, and what is beside it.
#[derive(Default, Serialize, Deserialize)]
struct Goals {
    rows: Vec<[String; 5]>,
}

impl Goals {
    fn at_least(&mut self, what: String, goal: f64, value: f64, words: String) {
        self.push(what, format!("≥ {goal}"), words, (value >= goal, "—".into()));
    }

    fn at_most(&mut self, what: String, goal: f64, value: f64, words: String) {
        self.push(what, format!("≤ {goal}"), words, (value <= goal, "—".into()));
    }

    /// A figure that nothing is aimed at, and why.
    fn figure(&mut self, what: String, why: &str, words: String) {
        self.rows.push([what, why.into(), words, "—".into(), "—".into()]);
    }

    /// Why the last one is neither kept nor missed.
    fn not_tested(&mut self, why: &str) {
        if let Some([.., verdict, _]) = self.rows.last_mut() {
            *verdict = why.into();
        }
    }

    /// What is beside the last one, if anything is.
    fn beside(&mut self, words: String) {
        if let Some([.., beside]) = self.rows.last_mut().filter(|_| !words.is_empty()) {
            *beside = words;
        }
    }

    /// What noisy halves come to that are asked for a tolerance.
    fn of_noise(&mut self, target_db: f64, coded: &Coded, others: &Results) {
        let beside = |digits: usize, value: Figure| {
            words_of(others.iter(), &|coded| format!("{:.digits$}", value(&coded.judged)))
        };
        let judged = &coded.judged;
        let at = |what: &str| format!("{what}, noisy halves of `mixed` asked for {target_db} dB");
        let asked: [(&str, f64, Figure); 2] = [
            ("dB reached", target_db, |judged| decibels(judged.mean_square())),
            ("worst block, dB", target_db - WORST_BELOW_DB, Judged::worst_db),
        ];
        for (what, goal, value) in asked {
            let words = format!("{:.1}", value(judged));
            if target_db == NOISY[0].0 {
                self.at_least(at(what), goal, value(judged), words);
            } else {
                self.figure(at(what), "below what the halves can tell apart", words);
            }
            self.beside(beside(1, value));
        }
        self.at_most(at("seams"), 1.2, judged.seams, format!("{:.2}", judged.seams));
        self.beside(beside(2, |judged| judged.seams));
        let told = 100.0 * judged.told_well();
        self.at_least(at("errors that the halves tell to 0.8 … 1.25, %"), 90.0, told, format!("{told:.1}"));
        self.beside(beside(1, |judged| 100.0 * judged.told_well()));
    }

    /// Whether noisy halves that are asked for a tolerance come to more than their mean was: block by block, and under all columns.
    fn never_worse(
        &mut self,
        (subject, sampled): (&Subject, &Sampled),
        target_db: f64,
        coded: &Coded,
        others: &Results,
    ) {
        let at = |what: &str| format!("{what}, noisy halves of `mixed` asked for {target_db} dB");
        let all_columns = |coded: &Coded| all_columns_db(&subject.truth, &subject.truth.unpacked(&coded.matrix));
        let (goal, ours) = (tenth(sampled.all_columns_db), tenth(all_columns(coded)));
        self.at_least(at("picture under all columns, dB, no worse than sampled"), goal, ours, format!("{ours:.1}"));
        self.beside(words_of(others.iter(), &|coded| format!("{:.1}", all_columns(coded))));
        let n_farther = |coded: &Coded| coded.judged.n_farther(&sampled.judged);
        let words = n_farther(coded).to_string();
        self.at_most(at("blocks farther off than sampled"), 0.0, n_farther(coded) as f64, words);
        self.beside(words_of(others.iter(), &|coded| n_farther(coded).to_string()));
    }

    fn push(&mut self, what: String, goal: String, ours: String, (is_kept, beside): (bool, String)) {
        let verdict = if is_kept { "kept" } else { "**missed**" };
        self.rows.push([what, goal, ours, verdict.into(), beside]);
    }

    fn of_ratio(
        &mut self,
        name: &str,
        subject: &Subject,
        (target_db, aim): (f64, Option<f64>),
        results: &Results,
    ) -> Result<()> {
        let (method, ours) = results.first().context("no method was asked")?;
        let ours = ours.as_ref().map_err(|error| anyhow!("{method} on {name} at {target_db} dB: {error:#}"))?;
        let beside = |value: &dyn Fn(&Coded) -> String| {
            words_of(results.iter().filter(|(method, _)| *method != METHODS[0]), value)
        };
        let at = format!("`{name}` at {target_db} dB");
        let mut push = |what: &str, asked: String, is_kept: bool, value: &dyn Fn(&Coded) -> String| {
            self.push(format!("{what}, {at}"), asked, value(ours), (is_kept, beside(value)));
        };
        if let Some(aim) = aim {
            let goal = format!("≥ {aim}×, stretch {:.0}×", STRETCH * aim);
            push("dense / bytes", goal, ours.ratio >= aim, &|coded| format!("{:.0}×", coded.ratio));
        }
        let is_kept = over_least(subject, ours).is_some_and(|ratio| ratio <= 1.25);
        push("mean rank over the least", "≤ 1.25".into(), is_kept, &|coded| {
            over_least_words(over_least(subject, coded), "")
        });
        let (reached, worst) = (decibels(ours.judged.mean_square()), ours.judged.worst_db());
        push(
            "dB reached, worst block",
            format!("{target_db} … {}, ≥ {}", target_db + 2.0, target_db - WORST_BELOW_DB),
            (target_db..=target_db + 2.0).contains(&reached) && worst >= target_db - WORST_BELOW_DB,
            &|coded| format!("{:.1}, {:.1}", decibels(coded.judged.mean_square()), coded.judged.worst_db()),
        );
        push("seams", "≤ 1.2".into(), ours.judged.seams <= 1.2, &|coded| format!("{:.2}", coded.judged.seams));
        if target_db == 45.0 {
            let is_kept = ours.multiply_adds[0] <= 45.0;
            push("multiply-adds, as unpacked / in cosines", "≤ 45".into(), is_kept, &|coded| {
                let [unpacked, in_cosines] = coded.multiply_adds;
                format!("{unpacked:.0} / {in_cosines:.0}")
            });
        }
        if aim.is_some() {
            push("ms per block", "≤ 2".into(), ours.millis.iter().sum::<f64>() <= 2.0, &|coded| {
                format!("{:.1} + {:.1}", coded.millis[0], coded.millis[1])
            });
        }
        let told = |coded: &Coded| format!("{:.1} %", 100.0 * coded.judged.told_well());
        let what = format!("errors that the halves tell to 0.8 … 1.25, {at}");
        let words = beside(&told);
        self.figure(what, "both halves are the matrix", told(ours));
        self.beside(words);
        Ok(())
    }

    /// Whether borders of blocks show in pictures as a display has them: under all columns, and under each alone.
    fn of_grid(&mut self, name: &str, subject: &Subject, results: &Results) {
        // Where ours finds nothing the section has ended.
        let Some(((_, Ok(ours)), others)) = results.split_first() else { return };
        let at = |what: &str| format!("{what}, 8-bit levels: worst border, mean, `{name}` at {GRID_DB} dB");
        let words = |[worst, mean]: [f64; 2]| format!("{worst:.2}, {mean:.2}");
        let found = |coded: &Coded| subject.truth.unpacked(&coded.matrix);
        let under_all = |coded: &Coded| Grid::under_all(&subject.truth, &found(coded)).worst_and_mean();
        let all = under_all(ours);
        let beside = words_of(others.iter(), &|coded| words(under_all(coded)));
        let goal = format!("< {GRID_LEVELS}");
        self.push(at("grid under all columns"), goal, words(all), (all[0] < GRID_LEVELS, beside));
        let under_one = |coded: &Coded| words(grid::under_one(&subject.truth, &found(coded)));
        self.figure(at("grid under one column"), "no goal: its seams are judged", under_one(ours));
        self.beside(words_of(others.iter(), &under_one));
    }

    fn table(&self) -> String {
        let row = |cells: &[String; 5]| format!("| {} |\n", cells.join(" | "));
        let rows: String = self.rows.iter().map(row).collect();
        format!("| | aimed at | ours | | beside it |\n|---|---|---|---|---|\n{rows}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A truth of 1 in four columns, and halves that are both off by so much in turn.
    fn subject(off: [f32; 2]) -> Subject {
        let picture = |off: [f32; 2]| Picture {
            width: 16,
            height: 16,
            n_cols: 4,
            values: (0..16 * 16 * 3 * 4).map(|i| 1.0 + off[i % 2]).collect(),
        };
        Subject::new(picture([0.0; 2]), Some([picture(off), picture(off)]))
    }

    #[test]
    fn errors_of_columns_that_cancel_are_none_under_all_of_them() {
        let [alike, by_turns] = [[0.1, 0.1], [0.1, -0.1]].map(|off| Sampled::new(&subject(off)));
        for sampled in [&alike, &by_turns] {
            assert!((decibels(sampled.judged.mean_square()) - 20.0).abs() < 1e-3);
        }
        assert!((alike.all_columns_db - 20.0).abs() < 1e-3, "{}", alike.all_columns_db);
        assert!(by_turns.all_columns_db > 100.0, "{}", by_turns.all_columns_db);
    }

    #[test]
    fn what_is_no_worse_than_its_samples_is_told_as_kept() {
        let subject = subject([0.5; 2]);
        let sampled = Sampled::new(&subject);
        let coded = subject.coded(METHODS[0], 60.0).unwrap();
        let others: Results = vec![(METHODS[1], subject.coded(METHODS[1], 60.0))];
        let mut goals = Goals::default();
        goals.never_worse((&subject, &sampled), 60.0, &coded, &others);
        let told: Vec<[&str; 4]> = goals.rows.iter().map(|row| [1, 2, 3, 4].map(|cell| row[cell].as_str())).collect();
        assert_eq!(told[0], ["≥ 6", "6.0", "kept", "`svd` 6.0"]);
        assert_eq!((told[1][0], told.len()), ("≤ 0", 2));
    }

    #[test]
    fn a_border_of_blocks_that_shows_misses_its_goal() {
        let told = |right: f32| {
            let picture = |right: f32| Picture {
                width: 32,
                height: 16,
                n_cols: 4,
                values: (0..32 * 16 * 3 * 4).map(|i| if i / 12 % 32 < 16 { 1.0 } else { right }).collect(),
            };
            let subject = Subject::new(picture(1.0), Some([picture(right), picture(right)]));
            let results: Results = METHODS[..2].iter().map(|&method| (method, subject.coded(method, 60.0))).collect();
            let mut goals = Goals::default();
            goals.of_grid("mixed", &subject, &results);
            let [all, one] = [0, 1].map(|row| [1, 2, 3, 4].map(|cell| goals.rows[row][cell].clone()));
            assert_eq!((goals.rows.len(), one[2].as_str()), (2, "—"));
            assert!(one[3].starts_with("`svd` "), "{one:?}");
            all
        };
        let [goal, _, verdict, _] = told(1.0);
        assert_eq!([goal, verdict], ["< 0.5", "kept"]);
        // 0.9 is 243.4 of 255 levels.
        let [_, ours, verdict, beside] = told(0.9);
        assert_eq!((&ours[..3], verdict.as_str(), &beside[..9]), ("11.", "**missed**", "`svd` 11."));
    }

    #[test]
    fn the_best_of_each_rival_counts_whatever_it_was_asked_for() {
        let [svd, _, row_id] = BESIDE_NOISE;
        assert_eq!(best_words(&[(svd, 18.42), (row_id, 17.0), (svd, 18.57)]), "`svd` 18.6, `row-id` 17.0");
        assert_eq!(best_words(&[]), "");
    }

    #[test]
    fn what_is_worse_than_black_has_no_rank_over_the_least() {
        let over_least_of = |off: f32| {
            let subject = subject([off; 2]);
            let coded = subject.coded(METHODS[0], 60.0).unwrap();
            over_least(&subject, &coded)
        };
        assert_eq!([0.0, 2.0].map(|off| over_least_of(off).is_some()), [true, false]);
        assert_eq!([Some(1.25), None].map(|ratio| over_least_words(ratio, "×")), ["1.25×", "—"]);
    }

    #[test]
    fn a_section_ends_where_ours_finds_nothing() {
        let picture = Picture { width: 16, height: 16, n_cols: 1, values: vec![1.0; 16 * 16 * 3] };
        let subject = Subject::new(picture, None);
        let results: Results = vec![(METHODS[0], Err(anyhow!("no end")))];
        let told = Goals::default().of_ratio("mixed", &subject, (45.0, None), &results);
        assert_eq!(told.unwrap_err().to_string(), "projected on mixed at 45 dB: no end");
    }
}
