//! Error against bytes and against the time of a product: what every method reaches, and which of them nobody beats.

mod standing;

use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;
use clerestory_nystrom::rivals::{Approximation, Core, DMatrix, Method, approximate};
use clerestory_nystrom::{BlockFactors, BlockLowRank, Partition};
use clerestory_relight::{CpuRelighter, Frame, Radiance, Relight};
use clerestory_transport::camera::Film;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::desk::Desk;
use super::errors::decibels;
use super::fit::{listed, median, spread, tenths, wholes};
use super::methods::dense::{CHANNELS, Picture, squared_error};
use super::methods::{methods, own};
use super::plot::{Axis, Panel, Scale, Series};
use super::reference::Sampling;
use super::targets::coded::{Coded, Coding, Subject, single_threaded};
use super::targets::judged;
use standing::Measure;

const RANKS: [usize; 5] = [2, 4, 8, 16, 32];
const TOLERANCES_DB: [f64; 6] = [20.0, 25.0, 30.0, 35.0, 40.0, 45.0];
/// Bytes of a number of a rival, whose rounding is not held against it.
const BYTES: f64 = 2.0;
/// Times that each product is measured, all of a matrix in turn; the shortest counts.
const TURNS: usize = 5;
const SEED: u64 = 1;
/// What methods that draw at random are repeated with, on the same matrix.
const SEEDS: &[u64] = &[SEED, 2, 3];
const OURS: &str = "ours, packed";
/// Rivals that are packed as ours is, too, with a rank for each block, and what they are asked for in dB.
const PACKED: [Method; 6] = [
    Method::Svd,
    Method::Alg4(Core::PseudoInverse { rcond: 1e-2 }),
    Method::Alg4(Core::PseudoInverse { rcond: 1e-3 }),
    Method::Alg4(Core::PseudoInverse { rcond: 1e-4 }),
    Method::Alg4(Core::Projection),
    Method::RowId,
];
/// Methods with a color of their own in the plots.
const NAMED: [&str; 7] =
    [OURS, "svd, packed", "row-id, packed", "alg4:pinv=0.01, packed", "svd", "alg4:pinv=0.01", "kernel"];

/// A method at a rank, or ours at a tolerance.
#[derive(Clone, Serialize, Deserialize)]
struct Point {
    name: String,
    /// Its rank or tolerance in words.
    at: String,
    /// The median over its seeds, as that of dB.
    bytes: f64,
    /// The shortest time with the first seed, and the longest.
    millis: f64,
    most_millis: f64,
    db: f64,
    /// Bytes and dB with each seed.
    of_seeds: Vec<[f64; 2]>,
}

impl Point {
    /// Without the times, which are measured later.
    fn new(name: String, at: String, of_seeds: Vec<[f64; 2]>) -> Point {
        let point =
            Point { name, at, bytes: f64::NAN, millis: f64::NAN, most_millis: f64::NAN, db: f64::NAN, of_seeds };
        let [bytes, db] = [0, 1].map(|which| median(&point.all(which)).unwrap_or(f64::NAN));
        Point { bytes, db, ..point }
    }

    /// Bytes of all seeds, or their dB.
    fn all(&self, which: usize) -> Vec<f64> {
        self.of_seeds.iter().map(|figures| figures[which]).collect()
    }
}

/// A cost that is told.
struct Cost {
    title: &'static str,
    label: &'static str,
    /// Name of the plot.
    file: &'static str,
    measure: Measure,
    /// By which of several figures points are compared.
    by: &'static str,
    words: fn(&Point) -> String,
}

const COSTS: [Cost; 2] = [
    Cost {
        title: "bytes",
        label: "bytes of the picture's matrix",
        file: "fronts-bytes",
        measure: (|point| point.bytes, |_, _| false),
        by: "",
        words: |point| told(point.all(0), wholes),
    },
    Cost {
        title: "time to relight",
        label: "ms per picture",
        file: "fronts-time",
        measure: (|point| point.millis, |ours, other| ours.millis <= other.most_millis),
        by: ", by the least of all rounds",
        words: |point| format!("{:.3}…{:.3}", point.millis, point.most_millis),
    },
];

/// Two plots and the methods that nobody beats.
///
/// # Errors
/// If a matrix cannot be read or sampled, or ours finds no factors.
pub fn write(desk: &Desk) -> Result<String> {
    let mut found = Vec::new();
    for (name, picture) in pictures(desk)? {
        let points: Vec<Point> = desk.part("fronts", &name, || measured(desk, &name, picture))?;
        found.push((name, points));
    }
    let Sampling { film, spp, .. } = own_sampling(desk);
    let mut text = format!(
        "## What nobody beats\n\n\
         Every method of the section Methods, block by block of 16 × 16 pixels at ranks {}, two bytes for each number that it stores; and ours as a file has\n\
         it, asked for {} dB, all bytes counted, with a rank for each block. So that methods are compared and not formats alone, some rivals are packed like ours, too (\"packed\"), asked for the same. The error is that of single texels, as in Methods. The time is that of our relighter on one\n\
         thread with the factors of each method, all lights new, least…greatest of {TURNS} rounds over all methods and ranks, of which the least counts; methods whose entries are no product of factors make all entries anew for each picture. The matrix of `diffuse.glb` is of {} × {} pixels, {spp} samples per pixel and half, sampled with seed {SEED} alone.\n\
         Methods that draw at random have {}; the time is that of the first. One seed is enough for {}: they draw nothing, and make the same of the same matrix. Single precision. {}\n",
        RANKS.map(|rank| rank.to_string()).join(", "),
        TOLERANCES_DB.map(|db| db.to_string()).join(", "),
        film.width,
        film.height,
        desk.choose(
            format!("seed {SEED}"),
            format!("the seeds {}, of which bytes and dB are median (least…greatest) where they differ", listed(SEEDS))
        ),
        without_chance(desk),
        desk.load_words(),
    );
    for Cost { title, label, file, measure, by, words } in COSTS {
        let cost = measure.0;
        let panels: Vec<Panel> = found.iter().map(|(name, points)| panel(name, label, points, cost)).collect();
        text += &format!("\n### Error against {title}\n");
        text += &desk.plot(file, &format!("error of all methods against {title}"), &panels)?;
        text += &standing::words(&found, measure);
        text += &format!(
            "\nNobody has less error at less of it{by}:\n\n| matrix | method | at | {label} | dB |\n|---|---|---|---|---|\n"
        );
        for (name, points) in &found {
            for point in front(points, cost) {
                let Point { name: method, at, .. } = point;
                text +=
                    &format!("| {name} | `{method}` | {at} | {} | {} |\n", words(point), told(point.all(1), tenths));
            }
        }
    }
    Ok(text)
}

/// Whether chance has a part in a method.
fn draws(method: Method) -> bool {
    !matches!(method, Method::Svd | Method::RowId | Method::DeimCur | Method::AcaFull)
}

/// What a method is repeated with; nothing where it makes the same of the same matrix.
fn seeds(desk: &Desk, method: Method) -> &'static [u64] {
    &SEEDS[..if draws(method) { desk.choose(1, SEEDS.len()) } else { 1 }]
}

/// The names of methods in which chance has no part.
fn without_chance(desk: &Desk) -> String {
    let names = methods(desk).into_iter().filter(|method| !draws(*method)).map(|method| format!("`{method}`"));
    names.collect::<Vec<_>>().join(", ")
}

/// Median (least…greatest), or one figure where all of them are told alike.
fn told(values: Vec<f64>, words: fn(Vec<f64>) -> String) -> String {
    let first = words(values.iter().take(1).copied().collect());
    let differ = values.iter().any(|value| words(vec![*value]) != first);
    if differ { words(values) } else { first }
}

/// Converged matrices, and one of ours.
fn pictures(desk: &Desk) -> Result<Vec<(String, Picture)>> {
    let mut found = Vec::new();
    for name in ["mixed", "reflect"] {
        if let Some(path) = desk.shared(&format!("matrices/{name}.npz")).filter(|_| !desk.quick) {
            found.push((name.to_string(), Picture::shared(&path, "T")?));
        }
    }
    let path = desk.root.join("assets/scenes/diffuse.glb");
    let halves = own::halves(desk, &path, None, (own_sampling(desk), SEED))?;
    found.push(("diffuse.glb".into(), own::mean_and_noise(&halves).0));
    Ok(found)
}

/// How the matrix of ours is sampled.
fn own_sampling(desk: &Desk) -> Sampling {
    let (film, spp) = desk.choose((Film { width: 32, height: 32 }, 32), (Film { width: 64, height: 48 }, 256));
    Sampling { film, step: 1, bounces: None, spp }
}

fn measured(desk: &Desk, name: &str, picture: Picture) -> Result<Vec<Point>> {
    let (peak, blocks) = (picture.peak(), picture.blocks::<f32>(1));
    let mut runners = Vec::new();
    for method in methods(desk) {
        desk.say(&format!("{method} on {name}"));
        for rank in RANKS {
            // What has no answer is no point.
            runners.extend(runner((method, seeds(desk, method)), (&picture, &blocks), rank, peak)?);
        }
    }
    let subject = Subject::new(picture, None);
    let mut pack = |method: Method, name: String, tolerance: f64| -> Result<()> {
        let with_seed = |&seed: &u64| subject.coded_as(Coding { method, seed, ..Coding::default() }, tolerance);
        let coded = match seeds(desk, method).iter().map(with_seed).collect::<Result<Vec<Coded>>>() {
            Ok(coded) => coded,
            Err(error) if method == Method::Projected => return Err(error),
            // What has no answer is no point.
            Err(_) => return Ok(()),
        };
        let dense_bytes = (4 * subject.truth.values.len()) as f64;
        let figures = |coded: &Coded| [dense_bytes / coded.ratio, judged::decibels(coded.judged.mean_square())];
        let point = Point::new(name, format!("{tolerance:.0} dB"), coded.iter().map(figures).collect());
        let first = coded.into_iter().next();
        runners.extend(first.map(|coded| Runner::new(point, coded.matrix)).transpose()?);
        Ok(())
    };
    desk.say(&format!("ours on {name}, packed"));
    TOLERANCES_DB.into_iter().try_for_each(|tolerance| pack(Method::Projected, OURS.into(), tolerance))?;
    for method in PACKED.into_iter().take(desk.choose(1, PACKED.len())) {
        desk.say(&format!("{method} on {name}, packed"));
        let named = format!("{method}, packed");
        TOLERANCES_DB.into_iter().try_for_each(|tolerance| pack(method, named.clone(), tolerance))?;
    }
    desk.say(&format!("pictures by all factors of {name}, in turn"));
    raced(runners)
}

/// A method at a rank; `None` where it has no answer with one of its seeds.
fn runner(
    (method, seeds): (Method, &[u64]),
    (picture, blocks): (&Picture, &[DMatrix<f32>]),
    rank: usize,
    peak: f64,
) -> Result<Option<Runner>> {
    let (mut first, mut of_seeds) = (None, Vec::new());
    for &seed in seeds {
        let found =
            blocks.par_iter().map(|block| approximate(method, block, rank, seed)).collect::<Result<Vec<_>, _>>();
        let Ok(found) = found else { return Ok(None) };
        let (mut n_values, mut squares) = (0.0, 0.0);
        for (block, found) in blocks.iter().zip(&found) {
            n_values += found.n_values() as f64;
            squares += squared_error(block, &found.to_dense());
        }
        of_seeds.push([BYTES * n_values, decibels(peak, squares / picture.values.len() as f64)]);
        first = first.or(Some(found));
    }
    let Some(found) = first else { return Ok(None) };
    let point = Point::new(method.to_string(), format!("rank {rank}"), of_seeds);
    if !method.has_factors() {
        return Ok(Some(Runner::anew(point, found)));
    }
    let mut matrix = BlockLowRank::new(picture.partition(), CHANNELS as u32, picture.n_cols as u32);
    for (found, factors) in found.iter().zip(&mut matrix.blocks) {
        *factors = found.factors().map(|(left, right)| Arc::new(block_factors(left, right)));
    }
    Ok(Some(Runner::new(point, matrix)?))
}

/// A point whose time is still to be measured.
struct Runner {
    point: Point,
    product: Product,
    millis: Vec<f64>,
}

/// What makes a picture of lights.
enum Product {
    /// Factors of so many columns.
    Factors(Box<CpuRelighter>, usize),
    /// Blocks all entries of which are made anew for every picture.
    Anew(Vec<Approximation<f32>>),
}

impl Runner {
    fn new(point: Point, matrix: BlockLowRank) -> Result<Runner> {
        let Partition { width, height, .. } = matrix.partition;
        let n_cols = matrix.n_cols as usize;
        let relighter = CpuRelighter::new(&Frame { width, height, groups: vec![matrix] })?;
        Ok(Runner { point, product: Product::Factors(Box::new(relighter), n_cols), millis: Vec::new() })
    }

    fn anew(point: Point, blocks: Vec<Approximation<f32>>) -> Runner {
        Runner { point, product: Product::Anew(blocks), millis: Vec::new() }
    }

    /// Relights under lights that are new in every turn, on one thread.
    fn run(&mut self, turn: usize) -> Result<()> {
        let levels = [0.5, 1.0].map(|level| level + turn as f32);
        let secs = single_threaded(|| match &mut self.product {
            Product::Factors(relighter, n_cols) => {
                let light = |level: f32| vec![vec![[level, 2.0, 2.0 + level]; *n_cols]];
                let ([before, now], mut shown) = (levels.map(light), Radiance::default());
                // The first picture of all copies factors into streams, and each one brings what it needs into the caches.
                relighter.relight(&before, &mut shown)?;
                let begun = Instant::now();
                relighter.relight(&now, &mut shown).map(|()| begun.elapsed().as_secs_f64())
            }
            Product::Anew(blocks) => {
                let [_, secs] = levels.map(|level| blocks.iter().map(|block| anew_secs(block, level)).sum::<f64>());
                Ok(secs)
            }
        })??;
        self.millis.push(1e3 * secs);
        Ok(())
    }
}

/// All points with their times, each measured once in every round.
fn raced(mut runners: Vec<Runner>) -> Result<Vec<Point>> {
    for turn in 0..TURNS {
        runners.iter_mut().try_for_each(|runner| runner.run(turn))?;
    }
    let timed = |Runner { mut point, millis, .. }: Runner| {
        [point.millis, _, point.most_millis] = spread(&millis);
        point
    };
    Ok(runners.into_iter().map(timed).collect())
}

/// Factors as they lie in memory.
pub fn block_factors(left: &DMatrix<f32>, right: &DMatrix<f32>) -> BlockFactors {
    // What nalgebra holds column by column is wanted row by row.
    let [rows, columns] = [left, right].map(|factor| factor.transpose().as_slice().to_vec());
    BlockFactors::from_f32(&rows, &columns, left.nrows(), right.ncols(), left.ncols())
}

/// Seconds in which all entries of a block are made, and their product with light.
fn anew_secs(found: &Approximation<f32>, level: f32) -> f64 {
    let begun = Instant::now();
    std::hint::black_box(under_light(&found.to_dense(), level));
    begun.elapsed().as_secs_f64()
}

/// The rows of a block under an even light: each is of one channel, and meets the light of no other.
fn under_light(dense: &DMatrix<f32>, level: f32) -> DMatrix<f32> {
    dense * DMatrix::from_element(dense.ncols(), 1, level)
}

/// Points than which none has less error at as little cost, the cheapest first; those worse than black are none.
fn front(points: &[Point], cost: fn(&Point) -> f64) -> Vec<&Point> {
    let mut sorted: Vec<&Point> = points.iter().filter(|point| point.db > 0.0).collect();
    sorted.sort_by(|a, b| cost(a).total_cmp(&cost(b)).then(b.db.total_cmp(&a.db)));
    let mut best = f64::NEG_INFINITY;
    sorted.retain(|point| {
        let is_better = point.db > best;
        best = best.max(point.db);
        is_better
    });
    sorted
}

fn panel(name: &str, label: &'static str, points: &[Point], cost: fn(&Point) -> f64) -> Panel {
    let of = |is_named: &dyn Fn(&Point) -> bool| -> Vec<[f64; 2]> {
        let shown = points.iter().filter(|point| point.db > 0.0 && is_named(point));
        shown.map(|point| [cost(point), point.db]).collect()
    };
    let others = Series {
        name: "other methods".into(),
        points: of(&|point| !NAMED.contains(&point.name.as_str())),
        is_joined: false,
    };
    let named =
        NAMED.map(|named| Series { name: named.into(), points: of(&|point| point.name == named), is_joined: true });
    Panel {
        title: name.into(),
        x: Axis { label, scale: Scale::Log },
        y: Axis { label: "dB", scale: Scale::Linear },
        series: named.into_iter().chain([others]).filter(|series| !series.points.is_empty()).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rivals_that_are_packed_have_colors_of_their_own() {
        let packed: Vec<String> = PACKED.iter().map(|method| format!("{method}, packed")).collect();
        let named = NAMED.iter().filter(|name| **name != OURS && name.ends_with(", packed"));
        assert!(named.clone().all(|name| packed.iter().any(|packed| packed == name)), "{packed:?}");
        assert_eq!(named.count(), 3);
    }

    #[test]
    fn methods_that_draw_nothing_make_the_same_with_every_seed() {
        let matrix = DMatrix::<f32>::from_fn(40, 30, |i, j| 1.0 / (1 + i + j) as f32 + ((7 * i + 11 * j) % 13) as f32);
        let made = |method, seed| approximate(method, &matrix, 6, seed).unwrap().to_dense();
        let drawn: Vec<Method> = Method::ALL.into_iter().filter(|method| draws(*method)).collect();
        for method in Method::ALL.into_iter().filter(|method| !drawn.contains(method)) {
            assert_eq!(made(method, SEEDS[0]), made(method, SEEDS[1]), "{method}");
        }
        assert!(drawn.contains(&Method::Projected) && drawn.len() + 4 == Method::ALL.len(), "{drawn:?}");
        let differ = |method| made(method, SEEDS[0]) != made(method, SEEDS[1]);
        assert!(differ(Method::GeneralizedNystrom), "two sketches of normal numbers are not the same");
    }

    #[test]
    fn rows_of_a_rival_without_factors_meet_the_light_of_their_channel_alone() {
        let dense = DMatrix::from_element(2 * CHANNELS, 4, 2.0);
        assert_eq!(under_light(&dense, 0.5), DMatrix::from_element(2 * CHANNELS, 1, 4.0));
    }

    #[test]
    fn seeds_of_a_point_are_told_by_their_middle_and_ends_where_they_differ() {
        let of_seeds = vec![[1200.0, 30.02], [1100.0, 30.04], [1150.0, 29.96]];
        let point = Point::new("m".into(), "rank 2".into(), of_seeds);
        assert_eq!((point.bytes, point.db), (1150.0, 30.02));
        assert_eq!((COSTS[0].words)(&point), "1150 (1100…1200)");
        assert_eq!(told(point.all(1), tenths), "30.0");
        assert_eq!(told(vec![29.9, 30.0, 31.0], tenths), "30.0 (29.9…31.0)");
    }

    #[test]
    fn only_what_is_better_than_all_that_is_cheaper_is_in_front() {
        let point = |bytes: f64, db: f64| Point::new("m".into(), String::new(), vec![[bytes, db]]);
        let points = [
            point(4.0, 30.0),
            point(1.0, 10.0),
            point(2.0, 25.0),
            point(3.0, 24.0),
            point(2.0, 20.0),
            point(0.5, -3.0),
        ];
        let kept: Vec<f64> = front(&points, |point| point.bytes).iter().map(|point| point.db).collect();
        assert_eq!(kept, [10.0, 25.0, 30.0]);
    }
}
