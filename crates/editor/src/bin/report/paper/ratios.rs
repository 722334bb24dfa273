//! PSNR against the ratio of compression on panels of many texels, and rank against their number.

use anyhow::{Context, Result};
use clerestory_nystrom::rivals::{Approximation, Method, approximate};
use clerestory_transport::camera::Film;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::lights::psnr_db;
use super::{SEED, approximated, sampling};
use crate::desk::Desk;
use crate::methods::dense::Picture;
use crate::methods::own;
use crate::plot::{Axis, Panel, Scale, Series};
use crate::targets::coded::Subject;
use crate::targets::soft;

/// Ranks of the rivals, and what ours is asked for in dB.
const RANKS: [usize; 5] = [2, 4, 8, 16, 32];
const TOLERANCES_DB: [f64; 5] = [5.0, 10.0, 15.0, 20.0, 30.0];
/// Error of the ranks that are told, in dB of single texels.
const RANK_DB: f64 = 40.0;
/// Bytes of a number of a rival: rounding is not held against them.
const BYTES: f64 = 2.0;
const KERNEL: Method = Method::KERNEL;

/// (dense in single precision over bytes, PSNR in dB).
type Curve = Vec<[f64; 2]>;

/// What is known of one number of texels.
#[derive(Serialize, Deserialize)]
struct Resolution {
    side: usize,
    /// Of ours, of `svd` and of the transform.
    curves: Vec<Curve>,
    /// Mean rank of the blocks: the least for the error that is told, and that of ours.
    ranks: [f64; 2],
}

/// A plot and two tables.
///
/// # Errors
/// If the scene cannot be sampled or compressed.
pub(super) fn write(desk: &Desk) -> Result<String> {
    let (finest, spp) = desk.choose((16, 16), (64, 64));
    let path = desk.root.join("assets/scenes/diffuse.glb");
    let mut found = Vec::new();
    let mut side = finest;
    while side >= 8 {
        found.push(desk.part("paper", &format!("ratios-{side}"), || {
            let halves = own::halves(desk, &path, Some(finest as u32), (sampling(desk, spp), SEED))?;
            resolution(desk, halves.map(|half| summed(half, side)), desk.choose(8, 32))
        })?);
        side /= 2;
    }
    found.reverse();
    let exact: Vec<[f64; 2]> = desk.part("paper", "ranks-exact", || exact_ranks(desk, finest))?;
    let names = ["ours, packed", "`svd` in 16-bit numbers", "`kernel` in 16-bit numbers"];
    let (mut panels, mut rows, mut ranks) = (Vec::new(), String::new(), String::new());
    for (Resolution { side, curves, ranks: [least, ours] }, [least_exact, ours_exact]) in found.iter().zip(&exact) {
        ranks += &format!("| {side} × {side} | {least_exact:.1} | {ours_exact:.1} | {least:.1} | {ours:.1} |\n");
        for (name, curve) in names.iter().zip(curves) {
            let words: Vec<String> = curve.iter().map(|[ratio, db]| format!("{ratio:.0}× {db:.1}")).collect();
            if !words.is_empty() {
                rows += &format!("| {side} × {side} | {name} | {} |\n", words.join(" | "));
            }
        }
        let series = names.iter().zip(curves).filter(|(_, curve)| !curve.is_empty()).map(|(name, curve)| Series {
            name: name.replace('`', ""),
            points: curve.clone(),
            is_joined: true,
        });
        let panel = Panel {
            title: format!("{side} × {side} texels"),
            x: Axis { label: "dense / bytes", scale: Scale::Log },
            y: Axis { label: "PSNR, dB", scale: Scale::Linear },
            series: series.collect(),
        };
        panels.extend(Some(panel).filter(|panel| !panel.series.is_empty()));
    }
    let film = sampling(desk, spp).film;
    Ok(format!(
        "\n### Ratios\n\n\
         `diffuse`, {} × {} pixels under a panel of {finest} × {finest} texels of {} samples per pixel; coarser panels are its texels summed. Ratio of\n\
         the dense matrix in single precision to the bytes, and PSNR against it: ours asked for {} dB of single texels and packed as a file has it;\n\
         principal components (`svd`) and Nyström's method after a transform (`kernel`) at ranks {}, two bytes for each number.\n{}\n\
         | texels | method | | | | | |\n|---|---|---|---|---|---|---|\n{rows}\n\
         ### Rank against texels\n\n\
         Mean rank of blocks of 16 × 16 pixels for {RANK_DB} dB of single texels, the least there is and that of ours. First of a matrix without noise: the floor, wall\n\
         and balls of the section Targets. Then of `diffuse` as sampled: the least for the mean of both halves, whose noise counts as something to be kept, and\n\
         ours, which is told both halves and keeps what they agree about.\n\n\
         | texels | without noise: least | ours | `diffuse`: least | ours |\n|---|---|---|---|---|\n{ranks}",
        film.width,
        film.height,
        2 * spp,
        TOLERANCES_DB.map(|db| db.to_string()).join(", "),
        RANKS.map(|rank| rank.to_string()).join(", "),
        desk.plot("paper-ratios", "PSNR against the ratio of compression, by number of texels", &panels)?,
    ))
}

fn summed(mut picture: Picture, side: usize) -> Picture {
    while picture.n_cols > side * side {
        picture = picture.coarser();
    }
    picture
}

/// Curves of panels of at least so many texels along a side, and ranks of all.
fn resolution(desk: &Desk, halves: [Picture; 2], least_of_curves: usize) -> Result<Resolution> {
    let side = halves[0].n_cols.isqrt();
    desk.say(&format!("ratios and ranks of {side} × {side} texels"));
    let mean = || own::mean_and_noise(&halves).0;
    let mut curves = vec![Curve::new(); 3];
    if side >= least_of_curves {
        let subject = Subject::new(mean(), None);
        for tolerance in TOLERANCES_DB {
            let coded = subject.coded(Method::Projected, tolerance)?;
            curves[0].push([coded.ratio, psnr_db(&subject.truth, &subject.truth.unpacked(&coded.matrix))]);
        }
        let blocks = subject.truth.blocks::<f32>(1);
        let best = blocks.par_iter().map(|block| approximate(Method::Svd, block, RANKS[RANKS.len() - 1], SEED));
        let best = best.collect::<Result<Vec<_>, _>>()?;
        for rank in RANKS {
            let (found, n_values) = leading(&subject.truth, &best, rank)?;
            curves[1].push(point(&subject.truth, &found, n_values));
            // What has no answer is no point of the curve.
            if let Ok((found, n_values)) = approximated(&subject.truth, &blocks, KERNEL, rank) {
                curves[2].push(point(&subject.truth, &found, n_values));
            }
        }
    }
    let subject = Subject::new(mean(), Some(halves));
    let least = subject.spectrum.least_mean_rank(10f64.powf(-RANK_DB / 10.0));
    let ours = subject.coded(Method::Projected, RANK_DB)?.mean_rank;
    Ok(Resolution { side, curves, ranks: [least, ours] })
}

/// Mean ranks of a matrix without noise, the least and ours, of panels from 8 × 8 texels to `finest`.
fn exact_ranks(desk: &Desk, finest: usize) -> Result<Vec<[f64; 2]>> {
    let Film { width, height } = sampling(desk, 1).film;
    let mut found = Vec::new();
    let mut picture = soft::picture(width as usize, height as usize, finest);
    loop {
        let side = picture.n_cols.isqrt();
        desk.say(&format!("ranks of {side} × {side} texels without noise"));
        let next = (side > 8).then(|| picture.coarser());
        let subject = Subject::new(picture, None);
        let ours = subject.coded(Method::Projected, RANK_DB)?;
        // Both at the error that ours has reached.
        found.push([subject.spectrum.least_mean_rank(ours.judged.mean_square()), ours.mean_rank]);
        match next {
            Some(next) => picture = next,
            None => break,
        }
    }
    found.reverse();
    Ok(found)
}

fn point(truth: &Picture, found: &Picture, n_values: usize) -> [f64; 2] {
    [4.0 * truth.values.len() as f64 / (BYTES * n_values as f64), psnr_db(truth, found)]
}

/// The leading components of decomposed blocks: of lower rank they are the same, but fewer.
fn leading(picture: &Picture, found: &[Approximation<f32>], rank: usize) -> Result<(Picture, usize)> {
    let (mut dense, mut n_values) = (Vec::new(), 0);
    for found in found {
        let (left, right) = found.factors().context("components are factors")?;
        let rank = rank.min(left.ncols());
        dense.push(left.columns(0, rank) * right.rows(0, rank));
        n_values += rank * (left.nrows() + right.ncols());
    }
    Ok((picture.with_blocks(&dense), n_values))
}
