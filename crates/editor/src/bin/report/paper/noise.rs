//! PSNR against the samples of a bake, and what noise does to pictures with mirrors and caustics.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_nystrom::rivals::Method;
use clerestory_transport::bake::{BakeConfig, Indirect};
use clerestory_transport::import;
use clerestory_transport::prepared::PreparedScene;
use serde::{Deserialize, Serialize};

use super::beside::mean_psnr_db;
use super::lights::lights;
use super::{Repeats, SEED, approximated, middle, sampling, told};
use crate::desk::Desk;
use crate::fit::listed;
use crate::goal::gains_words;
use crate::matrix::baked;
use crate::methods::dense::Picture;
use crate::methods::own;
use crate::plot::{Axis, Panel, Scale, Series};
use crate::prints::{enlarged, jpeg};
use crate::targets::coded::{Coding, Subject};

/// Rank of the rival; what ours and bakes are asked for in dB, as a bake is that is told nothing: mostly more than noise lets them reach.
const RANK: usize = 16;
const TOLERANCE_DB: f32 = 40.0;
/// Of all that is held against the reference, which has the usual one; in a hurry the first of them alone.
const OTHER_SEEDS: [u64; 3] = [SEED + 1, SEED + 2, SEED + 3];
const NAMES: [&str; 5] = ["as sampled", "kernel", "ours", "a bake as by default", "a bake, `--fast`"];
/// Of these, what is made of the samples: none should be worse.
const OURS: [usize; 3] = [2, 3, 4];
/// Pixels on the page, across and down, that show one.
const ENLARGED: usize = 4;

/// Decibels of each way; `None` where it has no answer.
type Answers = [Option<f64>; NAMES.len()];

/// What was measured of a scene with one seed.
#[derive(Serialize, Deserialize)]
struct Measured {
    /// By number of samples.
    curves: Vec<Answers>,
    /// Pictures, as the bytes of a file.
    sheet: Vec<u8>,
}

/// A plot, a table and sheets of pictures.
///
/// # Errors
/// If a scene cannot be sampled, compressed or baked.
pub(super) fn write(desk: &Desk) -> Result<String> {
    let (spp, reference_spp): (&[u32], u32) = desk.choose((&[2, 8], 32), (&[2, 8, 32, 128], 256));
    let scenes: &[&str] = desk.choose(&["caustics"], &["diffuse", "reflections", "caustics"]);
    let (mut panels, mut rows, mut sheets) = (Vec::new(), String::new(), String::new());
    let mut gains: [Vec<(String, f64)>; OURS.len()] = Default::default();
    let seeds = &OTHER_SEEDS[..desk.choose(1, OTHER_SEEDS.len())];
    for name in scenes {
        let of_seed = |&seed: &u64| {
            let part = || measured(desk, name, (spp, reference_spp), seed);
            desk.part("paper", &format!("noise-{name}-{seed}"), part)
        };
        let found: Vec<Measured> = seeds.iter().map(of_seed).collect::<Result<_>>()?;
        let mut curves: Vec<[Repeats; NAMES.len()]> = Vec::new();
        for (nth, spp) in spp.iter().enumerate() {
            let all: Vec<Answers> = found.iter().map(|found| found.curves[nth]).collect();
            let repeats = repeats(&all);
            rows += &format!("| {name} | {} | {} |\n", 2 * spp, repeats.each_ref().map(told).join(" | "));
            curves.push(repeats);
            for (seed, dbs) in seeds.iter().zip(&all) {
                for (gains, way) in gains.iter_mut().zip(OURS) {
                    let place = || format!("{name}, {} samples, seed {seed}", 2 * spp);
                    gains.extend(gain(dbs, way).map(|gain| (place(), gain)));
                }
            }
        }
        let point = |(spp, dbs): (&u32, &Repeats)| Some([f64::from(2 * spp), middle(dbs)?]);
        let series = (0..NAMES.len()).map(|way| Series {
            name: NAMES[way].replace('`', ""),
            points: spp.iter().zip(curves.iter().map(|dbs| &dbs[way])).filter_map(point).collect(),
            is_joined: true,
        });
        panels.push(Panel {
            title: (*name).into(),
            x: Axis { label: "samples per pixel", scale: Scale::Log },
            y: Axis { label: "PSNR, dB", scale: Scale::Linear },
            series: series.collect(),
        });
        let words = format!("{name} under a small spot, converged and with {} samples per pixel", 2 * spp[1]);
        sheets += &desk.show(&format!("paper-noise-{name}.jpg"), &words, &found[0].sheet)?;
    }
    let gains: Vec<String> =
        OURS.iter().zip(&gains).map(|(way, gains)| format!("{} {}", NAMES[*way], gains_words(gains))).collect();
    Ok(format!(
        "\n### Noise\n\n\
         PSNR in dB of matrices of few samples: as sampled, after Nyström's method on powers of the entries at rank {RANK} (`kernel`), and after ours, which is told\n\
         both halves, block by block. Then what bakes of as many samples give, whose blocks tell each other, too: as they are made by default, and with\n\
         `--fast`, indirect light shared between pixels; blocks that reach the {TOLERANCE_DB} dB that ours and bakes are asked for take fewer. All have {}, and lights that are seen left out. They are held against two references of {reference_spp} samples\n\
         per pixel each (both halves of seed {SEED}): the mean of (x − a)(x − b) of the clipped values, told as no less than its standard error, so that noise of the\n\
         references does not count. 256 texels. Aimed at is never to be worse than as sampled, rounded to tenths ([decision 0041](decisions/0041-no-block-is-worse-than-its-samples.md) tells where it is, [decision 0006](decisions/0006-indirect-light-is-traced-unless-sharing-is-asked-for.md) what sharing costs), told of the rows in which that is below {TOLERANCE_DB} dB, as bakes of the others stop sooner: {}.\n\
         The pictures have {} samples per pixel, seed {} and one small spot; each pixel is shown as {ENLARGED} × {ENLARGED}.\n{}\n\
         | scene | samples per pixel | {} |\n|---|---|{}\n{rows}{sheets}",
        seeds_words(seeds),
        gains.join("; "),
        2 * spp[1],
        seeds[0],
        desk.plot("paper-noise", "PSNR against samples per pixel, by scene", &panels)?,
        NAMES.join(" | "),
        "---|".repeat(NAMES.len()),
    ))
}

/// The same ways with all seeds.
fn repeats(all: &[Answers]) -> [Repeats; NAMES.len()] {
    std::array::from_fn(|way| all.iter().map(|dbs| dbs[way]).collect())
}

/// Which seeds all have that is held against the reference.
fn seeds_words(seeds: &[u64]) -> String {
    match seeds {
        [seed] => format!("seed {seed}"),
        _ => format!("the seeds {}, told as median (least…greatest) where they differ", listed(seeds)),
    }
}

/// How many dB more a way has than the samples; nothing where these reach what it stops at.
fn gain(dbs: &Answers, way: usize) -> Option<f64> {
    let (sampled, found) = dbs[0].zip(dbs[way])?;
    (sampled < f64::from(TOLERANCE_DB)).then_some(found - sampled)
}

fn measured(desk: &Desk, name: &str, (spp, reference_spp): (&[u32], u32), seed: u64) -> Result<Measured> {
    let path = desk.root.join(format!("assets/scenes/{name}.glb"));
    let references = own::halves(desk, &path, None, (sampling(desk, reference_spp), SEED))?;
    let (mut curves, mut sheet) = (Vec::new(), Vec::new());
    for &spp in spp {
        desk.say(&format!("{name} with {spp} samples per pixel and half, seed {seed}"));
        let found = answers(desk, &path, spp, seed)?;
        curves.push(found.each_ref().map(|found| Some(mean_psnr_db(&references, found.as_ref()?))));
        // The second is noisy, but not so noisy that nothing can be seen.
        if curves.len() == 2 && seed == OTHER_SEEDS[0] {
            sheet = shown(own::mean_and_noise(&references).0, &found)?;
        }
    }
    Ok(Measured { curves, sheet })
}

/// Everything under one small spot.
fn shown(converged: Picture, found: &[Option<Picture>]) -> Result<Vec<u8>> {
    let light = &lights(converged.n_cols.isqrt())[0];
    let picture = |matrix: &Picture| enlarged(&matrix.relit(light), ENLARGED);
    let mut pictures = vec![("converged", picture(&converged))];
    let names = NAMES.map(|name| name.replace('`', ""));
    pictures
        .extend(names.iter().zip(found).filter_map(|(name, found)| Some((name.as_str(), picture(found.as_ref()?)))));
    jpeg(&pictures)
}

/// As sampled, after the rival if it has an answer, after ours, and two bakes.
fn answers(desk: &Desk, path: &Path, spp: u32, seed: u64) -> Result<[Option<Picture>; NAMES.len()]> {
    let halves = own::halves(desk, path, None, (sampling(desk, spp), seed))?;
    let mean = own::mean_and_noise(&halves).0;
    let kernel = approximated(&mean, &mean.blocks(1), Method::KERNEL, (RANK, seed)).ok();
    let sampled = Picture { values: mean.values.clone(), ..mean };
    let unit = mean.peak();
    let subject = Subject::new(mean, Some(halves));
    let coding = Coding { seed, ..Coding::default() };
    let mut ours = subject.truth.unpacked(&subject.coded_as(coding, TOLERANCE_DB.into())?.matrix);
    ours.values.iter_mut().for_each(|value| *value *= unit as f32);
    let scene = import::load(path).with_context(|| format!("cannot load {}", path.display()))?.scene;
    let scene = Arc::new(PreparedScene::new(scene, &[])?.0);
    let bake = |indirect: Indirect| {
        let config = BakeConfig { spp: 2 * spp, tolerance_db: TOLERANCE_DB, seed, indirect, ..BakeConfig::default() };
        Ok::<_, anyhow::Error>(Some(own::scattered(&baked(&scene, sampling(desk, spp).film, config)?.1)))
    };
    let [traced, shared] = [bake(Indirect::Traced)?, bake(Indirect::Shared)?];
    Ok([Some(sampled), kernel.map(|(found, _)| found), Some(ours), traced, shared])
}

#[cfg(test)]
mod tests {
    use clerestory_transport::camera::Film;
    use clerestory_transport::light::LightRig;

    use super::*;
    use crate::methods::dense::CHANNELS;
    use crate::rendered::as_in_file;

    #[test]
    fn gains_are_those_over_samples_that_do_not_reach_the_tolerance() {
        let dbs = |sampled: f64| [Some(sampled), None, Some(29.0), Some(31.0), Some(32.0)];
        assert_eq!(OURS.map(|way| gain(&dbs(30.0), way)), [Some(-1.0), Some(1.0), Some(2.0)]);
        assert_eq!((gain(&dbs(30.0), 1), gain(&dbs(41.0), 2)), (None, None));
    }

    #[test]
    fn seeds_are_told_together_way_by_way() {
        let all =
            [[Some(30.0), None, Some(29.0), Some(31.0), Some(32.0)], [Some(31.0), None, Some(29.0), None, Some(30.0)]];
        let words = repeats(&all).each_ref().map(told);
        assert_eq!(words, ["30.5 (30.0…31.0)", "singular", "29.0", "singular", "31.0 (30.0…32.0)"]);
        assert_eq!(seeds_words(&[2]), "seed 2");
        assert_eq!(seeds_words(&[2, 3]), "the seeds 2, 3, told as median (least…greatest) where they differ");
    }

    #[test]
    fn entries_of_a_bake_under_the_light_of_the_file_are_its_picture() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/scenes/diffuse.glb");
        let scene = Arc::new(PreparedScene::new(import::load(&path).unwrap().scene, &[]).unwrap().0);
        let config = BakeConfig { spp: 2, ..BakeConfig::default() };
        let bake = baked(&scene, Film { width: 24, height: 18 }, config).unwrap().1;
        let light = scene.lighting.basis.project(&LightRig::default());
        let entries = own::scattered(&bake).relit(&light).pixels;
        let shown = as_in_file(&bake);
        let is_seen = |pixel: usize| {
            let at = [pixel % 24, pixel / 24].map(|at| at / 16);
            let rows = (pixel / 24 % 16 * (24 - at[0] * 16).min(16) + pixel % 24 % 16) * CHANNELS;
            let blocks = bake.groups.iter().filter_map(|group| group.blocks[at[1] * 2 + at[0]].as_ref());
            blocks.flat_map(|block| &block.sparse).any(|entry| (rows..rows + 3).contains(&(entry.row as usize)))
        };
        let compared: Vec<usize> = (0..24 * 18).filter(|&pixel| !is_seen(pixel)).collect();
        assert!(compared.len() > 300, "{}", compared.len());
        for pixel in compared {
            for channel in 0..CHANNELS {
                let (entry, shown) = (entries[pixel][channel], shown[3 * pixel + channel]);
                assert!((entry - shown).abs() <= 1e-3 * shown.abs() + 1e-3, "{pixel}: {entry} {shown}");
            }
        }
    }
}
