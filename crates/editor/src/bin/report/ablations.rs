//! Ablations: one part of the compression left out or changed at a time, and other ways to take and to judge the samples.

mod judging;
mod samples;

use std::path::Path;

use anyhow::Result;
use clerestory_nystrom::rivals::{Core, Method};
use clerestory_nystrom::{NoisyColumns, Selection};
use clerestory_transport::camera::Film;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::desk::Desk;
use super::errors::{Sum, decibels, quantile};
use super::fit::{hundredths, listed, median, tenths, tenths_known};
use super::methods::dense::Picture;
use super::methods::own;
use super::reference::Sampling;
use super::targets::coded::{Coding, Storage, Subject};
use super::targets::judged;

const SCENES: [&str; 4] = ["diffuse", "reflections", "caustics", "mixed"];
/// What is asked for in dB: about what so many samples can hold.
const TOLERANCE_DB: f64 = 30.0;
/// Of what results are held against.
const SEED: u64 = 1;
/// Of what is compressed; in a hurry the first of them alone.
const SEEDS: [u64; 3] = [SEED + 1, SEED + 2, SEED + 3];

/// What was measured of samples with one seed.
#[derive(Serialize, Deserialize)]
struct Measured {
    /// Of the samples themselves: see [`Row`].
    db: f64,
    single_db: Option<f64>,
    /// In the order of [`codings`].
    rows: Vec<Row>,
}

/// What one coding made of one matrix.
#[derive(Serialize, Deserialize)]
struct Row {
    /// Of all texels alike, and the median over single ones, each below its own peak.
    db: f64,
    single_db: Option<f64>,
    kilobytes: f64,
    mean_rank: f64,
    /// Per block: factors, then bytes.
    millis: [f64; 2],
}

/// What is done otherwise, in words.
fn codings() -> [(&'static str, Coding); 14] {
    let usual = Coding::default();
    [
        ("as a bake does it", usual),
        ("told of no noise: the mean as both halves", Coding { halves: false, ..usual }),
        ("no noise taken out of what is smooth", Coding { smooths: false, ..usual }),
        ("noisy columns not divided by their noise", Coding { noisy_columns: NoisyColumns::AsSampled, ..usual }),
        ("16-bit factors, not packed", Coding { storage: Storage::SixteenBits, ..usual }),
        ("factors in single precision, not quantized", Coding { storage: Storage::Single, ..usual }),
        ("packed without cosines over the texels", Coding { grid: false, ..usual }),
        ("one right basis for all blocks", Coding { storage: Storage::SharedRight, ..usual }),
        ("blocks of 8 × 8 pixels", Coding { tile: 8, ..usual }),
        ("blocks of 32 × 32 pixels", Coding { tile: 32, ..usual }),
        ("landmarks by Algorithm 3: at random", Coding { selection: Selection::Alg3, ..usual }),
        ("core of Algorithm 4, W⁺", Coding { method: Method::Alg4(Core::PseudoInverse { rcond: 1e-2 }), ..usual }),
        ("all rows onto those of Algorithm 4", Coding { method: Method::Alg4(Core::Projection), ..usual }),
        ("leading singular vectors", Coding { method: Method::Svd, ..usual }),
    ]
}

/// A mean square beside the mean of two halves, the noise of that mean taken out: what (x − a)(x − b) has as its mean.
fn beyond(noise: f64, mean_square: f64) -> f64 {
    (mean_square - noise).max(0.1 * noise)
}

/// The median over columns of their errors in dB, each below its own peak, beside two references whose noise is their own; `None`
/// where no column is lit.
fn single_lights_db(found: &Picture, references: &[Picture; 2]) -> Option<f64> {
    let square = |column: usize| {
        let entries = |picture: &Picture| -> Vec<f64> {
            picture.values.iter().skip(column).step_by(picture.n_cols).map(|value| f64::from(*value)).collect()
        };
        let (x, [a, b]) = (entries(found), references.each_ref().map(entries));
        let sum = Sum::of_pixels(x.len(), |at| (x[at] - a[at]) * (x[at] - b[at]));
        let peak = quantile(a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)).collect());
        (peak > 0.0).then(|| sum.mean_at_least_known() / (peak * peak))
    };
    let squares: Vec<f64> = (0..found.n_cols).into_par_iter().filter_map(square).collect();
    median(&squares).map(|square| decibels(1.0, square))
}

/// A table of the compression, one of the samples and one of what ends them.
///
/// # Errors
/// If a scene cannot be sampled, compressed or baked.
pub fn write(desk: &Desk) -> Result<String> {
    let film = desk.choose(Film { width: 32, height: 32 }, Film { width: 64, height: 64 });
    let (spp, reference_spp) = desk.choose((8, 32), (32, 256));
    let with = |spp: u32| Sampling { film, step: 1, bounces: None, spp };
    let seeds = &SEEDS[..desk.choose(1, SEEDS.len())];
    let mut rows = String::new();
    for name in &SCENES[..desk.choose(1, SCENES.len())] {
        let path = desk.root.join(format!("assets/scenes/{name}.glb"));
        let of_seed = |&seed: &u64| {
            desk.part("ablations", &format!("{name}-{seed}"), || {
                desk.say(&format!("{name}: compression of samples of seed {seed}"));
                measured(desk, &path, [with(reference_spp), with(spp)], seed)
            })
        };
        rows += &table(name, &seeds.iter().map(of_seed).collect::<Result<Vec<_>>>()?);
    }
    let (samples, judging) = (samples::write(desk)?, judging::write(desk)?);
    Ok(format!(
        "## Ablations\n\n\
         What each part is worth; those that leave out work of a bake are in the section Work that is skipped.\n\n\
         ### Compression\n\n\
         {} × {} pixels × 256 texels, {} samples per pixel in two halves, asked for {TOLERANCE_DB} dB: one thing at a time left out or done otherwise. Error of single\n\
         texels in dB against {} samples with another seed, their noise taken out as both halves tell it (no error is told as less than a tenth of it); *single lights*: the median over texels, each\n\
         below its own peak, as in the section Error against time (factors in single precision rounded to 16 bits for it); bytes of the picture's matrix; milliseconds of one core per block, factors +\n\
         bytes. Median (least…greatest) of samples of the seeds {}; the reference has seed {SEED}. {}\n\n\
         Columns that are not divided are found as they were sampled in blocks whose samples do not suffice, too ([decision 0051](decisions/0051-noisy-columns-are-divided-first.md)).\n\
         A right basis that all blocks share is made for its row alone, of as many vectors as leave a quarter of what is allowed; its bytes, one an entry, are\n\
         counted, and its milliseconds are among those of the bytes. [Decision 0040](decisions/0040-no-right-basis-is-shared.md) tells what it does for 4096 columns.\n\n\
         | scene | what | dB | single lights, dB | kB | mean rank | ms |\n|---|---|---|---|---|---|---|\n{rows}{samples}{judging}",
        film.width,
        film.height,
        2 * spp,
        2 * reference_spp,
        listed(seeds),
        desk.load_words(),
    ))
}

/// Samples of a seed by every coding, held against a reference.
fn measured(desk: &Desk, path: &Path, [reference, samples]: [Sampling; 2], seed: u64) -> Result<Measured> {
    let references = own::halves(desk, path, None, (reference, SEED))?;
    let (truth, noise) = own::mean_and_noise(&references);
    let unit = truth.peak();
    let noise = noise / unit.powi(2);
    let halves = own::halves(desk, path, None, (samples, seed))?;
    let sampled = own::mean_and_noise(&halves).0;
    let squares = truth.values.iter().zip(&sampled.values).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
    let square = squares / truth.values.len() as f64 / unit.powi(2);
    let subject = Subject::new(truth, Some(halves));
    let row = |(_, coding): (&str, Coding)| {
        let coded = subject.coded_as(coding, TOLERANCE_DB)?;
        let mut found = subject.truth.unpacked(&coded.matrix);
        found.values.iter_mut().for_each(|value| *value *= unit as f32);
        Ok(Row {
            db: judged::decibels(beyond(noise, coded.judged.mean_square())),
            single_db: single_lights_db(&found, &references),
            kilobytes: (4 * subject.truth.values.len()) as f64 / coded.ratio / 1e3,
            mean_rank: coded.mean_rank,
            millis: coded.millis,
        })
    };
    Ok(Measured {
        db: judged::decibels(beyond(noise, square)),
        single_db: single_lights_db(&sampled, &references),
        rows: codings().into_iter().map(row).collect::<Result<_>>()?,
    })
}

/// Rows of a scene, of all seeds together.
fn table(name: &str, of_seeds: &[Measured]) -> String {
    let all = |of: &dyn Fn(&Measured) -> f64| of_seeds.iter().map(of).collect::<Vec<f64>>();
    let single = |of: &dyn Fn(&Measured) -> Option<f64>| tenths_known(&of_seeds.iter().map(of).collect::<Vec<_>>());
    let sampled = single(&|measured| measured.single_db);
    let mut rows = format!("| {name} | *as sampled* | {} | {sampled} | | | |\n", tenths(all(&|measured| measured.db)));
    for (nth, (what, _)) in codings().iter().enumerate() {
        rows += &format!(
            "| {name} | {what} | {} | {} | {} | {} | {} + {} |\n",
            tenths(all(&|measured| measured.rows[nth].db)),
            single(&|measured| measured.rows[nth].single_db),
            tenths(all(&|measured| measured.rows[nth].kilobytes)),
            hundredths(all(&|measured| measured.rows[nth].mean_rank)),
            tenths(all(&|measured| measured.rows[nth].millis[0])),
            tenths(all(&|measured| measured.rows[nth].millis[1])),
        );
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two columns, the second ten times as bright.
    fn picture(errors: [f32; 2]) -> Picture {
        let values = (0..3 * 400).flat_map(|_| [1.0 + errors[0], 10.0 + errors[1]]).collect();
        Picture { width: 20, height: 20, n_cols: 2, values }
    }

    #[test]
    fn single_lights_are_each_below_their_own_peak() {
        let truth = || picture([0.0; 2]);
        let told = single_lights_db(&picture([0.1, 1.0]), &[truth(), truth()]).expect("both are lit");
        assert!((told - 20.0).abs() < 1e-4, "{told}");
        // The median of two lies between: (1e-2 + 1e-4) / 2.
        let told = single_lights_db(&picture([0.1, 0.1]), &[truth(), truth()]).expect("both are lit");
        assert!((told + 10.0 * 5.05e-3f64.log10()).abs() < 1e-4, "{told}");
        let dark = || Picture { values: vec![0.0; 2400], ..truth() };
        assert_eq!(single_lights_db(&truth(), &[dark(), dark()]), None);
    }

    #[test]
    fn what_is_known_of_single_lights_is_counted_by_pixels() {
        // The truth is 1, both references are off by a tenth in patterns of their own: 0.01 over the root of 400 pixels.
        let off = |pixel: usize, bit: usize| if pixel >> bit & 1 == 0 { 1.1 } else { 0.9 };
        let of = |value: &dyn Fn(usize) -> f32| {
            let values = (0..400).flat_map(|pixel| [value(pixel); 6]).collect();
            Picture { values, ..picture([0.0; 2]) }
        };
        let told = single_lights_db(&of(&|_| 1.0), &[of(&|pixel| off(pixel, 0)), of(&|pixel| off(pixel, 1))]);
        assert!((told.expect("both are lit") - decibels(1.1, 0.01 / 20.0)).abs() < 1e-3, "{told:?}");
    }

    #[test]
    fn a_row_tells_all_seeds() {
        let row = |db: f64| Row { db, single_db: Some(db), kilobytes: 2.0, mean_rank: 1.5, millis: [1.0, 0.5] };
        let of_seed =
            |db: f64| Measured { db: db - 1.0, single_db: None, rows: codings().iter().map(|_| row(db)).collect() };
        let told = table("a hall", &[of_seed(31.0), of_seed(30.0), of_seed(32.0)]);
        assert!(told.starts_with("| a hall | *as sampled* | 30.0 (29.0…31.0) | — | | | |\n"), "{told}");
        let usual =
            "| a hall | as a bake does it | 31.0 (30.0…32.0) | 31.0 (30.0…32.0) | 2.0 (2.0…2.0) | 1.50 (1.50…1.50) |";
        assert!(told.contains(usual), "{told}");
        assert_eq!(told.lines().count(), 1 + codings().len());
    }
}
