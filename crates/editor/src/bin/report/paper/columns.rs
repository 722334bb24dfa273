//! PSNR against the number of rows and columns that a method may choose.

use anyhow::Result;
use clerestory_nystrom::rivals::Method;

use super::lights::psnr_db;
use super::{METHODS, RCOND, Repeats, SCENES, SEED, approximated, middle, repeated, sampling, told};
use crate::desk::Desk;
use crate::errors::decibels;
use crate::methods::own;
use crate::plot::{Axis, Panel, Scale, Series};

const RANKS: [usize; 5] = [2, 4, 8, 16, 32];

/// A plot by scene, and a table.
///
/// # Errors
/// If a scene cannot be sampled.
pub(super) fn write(desk: &Desk) -> Result<String> {
    let spp = desk.choose(32, 256);
    let (mut panels, mut rows) = (Vec::new(), String::new());
    for name in &SCENES[..desk.choose(1, 4)] {
        let (noise_db, curves): (f64, Vec<Vec<Repeats>>) = desk.part("paper", &format!("columns-{name}"), || {
            let path = desk.root.join(format!("assets/scenes/{name}.glb"));
            let halves = own::halves(desk, &path, None, (sampling(desk, spp), SEED))?;
            let (picture, noise) = own::mean_and_noise(&halves);
            let blocks = picture.blocks::<f32>(1);
            let curve = |method| {
                desk.say(&format!("{method} on {name}"));
                let psnr = |rank: usize, seed: u64| {
                    Some(psnr_db(&picture, &approximated(&picture, &blocks, method, (rank, seed)).ok()?.0))
                };
                RANKS.map(|rank| repeated(desk, method, |seed| psnr(rank, seed))).into()
            };
            Ok((decibels(picture.peak(), noise), METHODS.map(curve).into()))
        })?;
        for (method, curve) in METHODS.iter().zip(&curves) {
            let words: Vec<String> = curve.iter().map(told).collect();
            rows += &format!("| {name} | {noise_db:.1} | `{method}` | {} |\n", words.join(" | "));
        }
        // Ours is the last of them, and uppermost.
        let series = METHODS.iter().zip(&curves).rev().map(|(&method, curve)| Series {
            name: if method == Method::Projected { "ours".into() } else { method.to_string() },
            points: RANKS.iter().zip(curve).filter_map(|(&rank, db)| Some([rank as f64, middle(db)?])).collect(),
            is_joined: true,
        });
        panels.push(Panel {
            title: format!("{name} (texels {noise_db:.0} dB above noise)"),
            x: Axis { label: "columns per block", scale: Scale::Log },
            y: Axis { label: "PSNR, dB", scale: Scale::Linear },
            series: series.collect(),
        });
    }
    let film = sampling(desk, spp).film;
    Ok(format!(
        "\n### Columns\n\n\
         PSNR in dB against the full matrix, {} × {} pixels × 256 texels of {} samples per pixel, in blocks of 16 × 16 pixels; as many rows as\n\
         columns, or components of `svd` and of ours (`{}`). Between rows and columns Algorithms 1 to 4 have the pseudo-inverse of their intersection, as Nyström's method has it, without singular values up to {RCOND} of the\n\
         largest. Other cores suit them better: Algorithm 4 stands with the projection onto its rows, too, and the section [Methods](#methods) has every algorithm with every core. The matrix of each scene lies so many dB of single texels above its own noise, which has\n\
         full rank: what a method leaves out beyond that may be noise.\n{}\n| scene | above noise | method | {} |\n|---|---|---|{}\n{rows}",
        film.width,
        film.height,
        2 * spp,
        Method::Projected,
        desk.plot("paper-columns", "PSNR against the number of columns, by scene", &panels)?,
        RANKS.map(|rank| rank.to_string()).join(" | "),
        "---|".repeat(RANKS.len()),
    ))
}
