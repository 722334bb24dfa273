//! Ablations: one part of the compression left out or changed at a time, and other ways to take the samples.

mod samples;

use anyhow::Result;
use clerestory_nystrom::Selection;
use clerestory_nystrom::rivals::{Core, Method};
use clerestory_transport::camera::Film;
use serde::{Deserialize, Serialize};

use super::desk::Desk;
use super::methods::own;
use super::reference::Sampling;
use super::targets::coded::{Coding, Storage, Subject};
use super::targets::judged;

const SCENES: [&str; 4] = ["diffuse", "reflections", "caustics", "mixed"];
/// What is asked for in dB: about what so many samples can hold.
const TOLERANCE_DB: f64 = 30.0;
const SEED: u64 = 1;

/// What one coding made of one matrix.
#[derive(Serialize, Deserialize)]
struct Row {
    db: f64,
    kilobytes: f64,
    mean_rank: f64,
    /// Per block: factors, then bytes.
    millis: [f64; 2],
}

/// What is done otherwise, in words.
fn codings() -> [(&'static str, Coding); 13] {
    let usual = Coding::default();
    [
        ("as a bake does it", usual),
        ("told of no noise: the mean as both halves", Coding { halves: false, ..usual }),
        ("no noise taken out of what is smooth", Coding { smooths: false, ..usual }),
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

/// A table of the compression and one of the samples.
///
/// # Errors
/// If a scene cannot be sampled or compressed.
pub fn write(desk: &Desk) -> Result<String> {
    let film = desk.choose(Film { width: 32, height: 32 }, Film { width: 64, height: 64 });
    let (spp, reference_spp) = desk.choose((8, 32), (32, 256));
    let with = |spp: u32| Sampling { film, step: 1, bounces: None, spp };
    let mut rows = String::new();
    for name in &SCENES[..desk.choose(1, SCENES.len())] {
        let (sampled_db, measured): (f64, Vec<Row>) = desk.part("ablations", name, || {
            let path = desk.root.join(format!("assets/scenes/{name}.glb"));
            let reference = own::halves(desk, &path, None, (with(reference_spp), SEED))?;
            let (truth, noise) = own::mean_and_noise(&reference);
            let noise = noise / truth.peak().powi(2);
            let halves = own::halves(desk, &path, None, (with(spp), SEED + 1))?;
            let sampled = own::mean_and_noise(&halves).0;
            let squares = truth.values.iter().zip(&sampled.values).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
            let sampled = squares / truth.values.len() as f64 / truth.peak().powi(2);
            let sampled_db = judged::decibels(beyond(noise, sampled));
            let subject = Subject::new(truth, Some(halves));
            let row = |(what, coding): (&str, Coding)| {
                desk.say(&format!("{name}: {what}"));
                let coded = subject.coded_as(coding, TOLERANCE_DB)?;
                Ok(Row {
                    db: judged::decibels(beyond(noise, coded.judged.mean_square())),
                    kilobytes: (4 * subject.truth.values.len()) as f64 / coded.ratio / 1e3,
                    mean_rank: coded.mean_rank,
                    millis: coded.millis,
                })
            };
            Ok((sampled_db, codings().into_iter().map(row).collect::<Result<_>>()?))
        })?;
        rows += &format!("| {name} | *as sampled* | {sampled_db:.1} | | | |\n");
        for ((what, _), Row { db, kilobytes, mean_rank, millis: [factors, bytes] }) in codings().iter().zip(&measured) {
            rows += &format!(
                "| {name} | {what} | {db:.1} | {kilobytes:.1} | {mean_rank:.2} | {factors:.1} + {bytes:.1} |\n"
            );
        }
    }
    let samples = samples::write(desk)?;
    Ok(format!(
        "## Ablations\n\n\
         What each part is worth; those that leave out work of a bake are in the section Work that is skipped.\n\n\
         ### Compression\n\n\
         {} × {} pixels × 256 texels, {} samples per pixel in two halves, asked for {TOLERANCE_DB} dB: one thing at a time left out or done otherwise. Error of single\n\
         texels in dB against {} samples with another seed, their noise taken out as both halves tell it (no error is told as less than a tenth of it); bytes of the picture's matrix; milliseconds of one core per block, factors +\n\
         bytes. Seeds {SEED} and {}, each row measured once. {}\n\n\
         A right basis that all blocks share is made for its row alone, of as many vectors as leave a quarter of what is allowed; its bytes, one an entry, are\n\
         counted, and its milliseconds are among those of the bytes. [Decision 0040](decisions/0040-no-right-basis-is-shared.md) tells what it does for 4096 columns.\n\n\
         | scene | what | dB | kB | mean rank | ms |\n|---|---|---|---|---|---|\n{rows}{samples}",
        film.width,
        film.height,
        2 * spp,
        2 * reference_spp,
        SEED + 1,
        desk.load_words(),
    ))
}
