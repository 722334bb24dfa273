//! A building open to a measured sky, which turns after the bake.

use anyhow::{Context, Result};
use clerestory::compare::{compare, read_exr};
use clerestory_relight::Radiance;
use serde_json::{Value, json};

use crate::desk::{Desk, clerestory, number};
use crate::errors::pictures_beside_two;
use crate::fit::{spread, tenths};
use crate::prints::jpeg;

/// Of bakes, and of both traced pictures.
const BAKE_SEEDS: [&str; 3] = ["1", "2", "3"];
const TRACE_SEEDS: [&str; 2] = ["7", "8"];
/// Turns of the sky in degrees.
const TURNS_DEG: [u32; 3] = [0, 90, 200];

/// A table and a sheet of pictures.
///
/// # Errors
/// If the scene cannot be baked.
pub(super) fn write(desk: &Desk) -> Result<String> {
    let files = desk.shared("scenes/sponza-dabrovic.glb").zip(desk.shared("env/vestibule_1k.hdr"));
    let Some((scene, sky)) = files else { return Ok(String::new()) };
    let [scene, sky] = [scene, sky].map(|path| path.display().to_string());
    let (text, sheet): (String, Vec<u8>) = desk.part("paper", "open", || measured(desk, &scene, &sky))?;
    Ok(text + &desk.show("paper-sky.jpg", "traced and relit, the sky as it is and turned", &sheet)?)
}

/// The text, and the bytes of the sheet.
fn measured(desk: &Desk, scene: &str, sky: &str) -> Result<(String, Vec<u8>)> {
    let (size, spp, trace_spp) = desk.choose(("64x48", "8", "64"), ("128x96", "64", "512"));
    let (mut transports, mut bake_secs) = (Vec::new(), Vec::new());
    for &seed in &BAKE_SEEDS[..desk.choose(1, BAKE_SEEDS.len())] {
        let transport = desk.file(&format!("open-{seed}.transport"));
        desk.say(&format!("baking a building under a measured sky, seed {seed}"));
        let bake = ["bake", scene, "-o", &transport, "--sky", sky, "--size", size, "--spp", spp, "--seed", seed];
        let baked = clerestory(&[&bake[..], &["--fresh", "--json"]].concat())?;
        bake_secs.push(number(&baked, "/bake_secs"));
        transports.push(transport);
    }
    let told = clerestory(&["info", &transports[0], "--json"])?;
    let keys = told.pointer("/lights").and_then(Value::as_array).context("no lights")?;
    let lamps = keys.iter().filter_map(Value::as_str).filter(|key| *key != "sky");
    let off: serde_json::Map<String, Value> = lamps.map(|key| (key.into(), json!({ "intensity": 0 }))).collect();
    let (mut rows, mut first) = (String::new(), None);
    // A row of the sheet each.
    let (mut all_traced, mut all_relit) = (Vec::new(), Vec::new());
    for turn in TURNS_DEG {
        let look = desk.file("open.look");
        std::fs::write(&look, json!({ "clerestory": 1, "lights": off, "sky": { "rotation_deg": turn } }).to_string())?;
        desk.say(&format!("the building with its sky turned by {turn}°"));
        let options = ["--look", &look, "--json"];
        let mut relit = Vec::new();
        for transport in &transports {
            let file = desk.file("open-relit.exr");
            clerestory(&[&["relight", transport, "-o", &file, "--device", "cpu"][..], &options].concat())?;
            relit.push(read_exr(file.as_ref())?);
        }
        let traced = |seed: &str| {
            let file = desk.file("open-traced.exr");
            let trace = ["trace", scene, "-o", &file, "--sky", sky, "--size", size, "--spp", trace_spp, "--seed", seed];
            clerestory(&[&trace[..], &options].concat())?;
            read_exr(file.as_ref())
        };
        let traced = [traced(TRACE_SEEDS[0])?, traced(TRACE_SEEDS[1])?];
        let row = row(&relit, &traced, first.get_or_insert_with(|| relit[0].clone()))?;
        rows += &format!("| {turn}° | {row} |\n");
        let [traced, _] = traced;
        all_traced.push((format!("traced, {turn}°"), traced));
        all_relit.push((format!("relit, {turn}°"), relit.swap_remove(0)));
    }
    let text = format!(
        "\n### A building under a measured sky\n\n\
         `sponza-dabrovic` under `vestibule_1k.hdr`, {} columns, {size} pixels, {spp} samples per pixel (seed {}) in {} s, {:.2} MB in the first file; then its lamp is turned off and the sky is\n\
         turned. Beside it path-traced pictures a and b under the same sky, {trace_spp} samples each (seeds {}). The error of the relit picture x is the mean of (x − a)(x − b), that of a traced one\n\
         the mean of (a − x)(a − b), below the square of the 99.5 percentile; neither counts the noise of what it is held against, and both are told as no less than their standard errors. Of several bakes median (least…greatest); ± is the standard error\n\
         of the traced means. The sky as it was baked has a column of its own, a turned one is made of patches about 12° wide: what of a patch gets in through an opening depends on where in it\n\
         the light stands, so that a turned sky is only as right as its patches are ([decision 0025](decisions/0025-the-baked-sky-has-a-column-of-its-own.md)).\n\n\
         | turned by | relit, dB | traced, dB | means off, R / G / B, % | against the first relit picture, PSNR, dB |\n|---|---|---|---|---|\n{rows}",
        number(&told, "/columns"),
        BAKE_SEEDS[..transports.len()].join(", "),
        tenths(bake_secs),
        number(&told, "/file_bytes") / 1e6,
        TRACE_SEEDS.join(" and "),
    );
    let pictures = all_traced.iter().chain(&all_relit);
    let pictures: Vec<_> = pictures.map(|(name, picture)| (name.as_str(), Radiance::clone(picture))).collect();
    Ok((text, jpeg(&pictures)?))
}

/// What is told of one sky, relit from each bake.
fn row(relit: &[Radiance], traced: &[Radiance; 2], first: &Radiance) -> Result<String> {
    let [a, b] = traced;
    let db = |x: &Radiance, beside: [&Radiance; 2]| pictures_beside_two(x, beside).context("a picture has pixels");
    let own = relit.iter().map(|x| db(x, [a, b])).collect::<Result<Vec<f64>>>()?;
    let of_trace = relit.iter().map(|x| db(a, [x, b])).collect::<Result<Vec<f64>>>()?;
    let moved = compare(&relit[0], first)?.psnr_db.map_or("the same".into(), |db| format!("{db:.1}"));
    let colors = [0, 1, 2].map(|channel| means_off(relit, traced, channel)).join(" / ");
    Ok(format!("{} | {} | {colors} | {moved}", tenths(own), tenths(of_trace)))
}

/// How far the means of one channel are off those of both traced pictures in %, and the standard error of these.
fn means_off(relit: &[Radiance], [a, b]: &[Radiance; 2], channel: usize) -> String {
    let sum = |picture: &Radiance| picture.pixels.iter().map(|rgb| f64::from(rgb[channel])).sum::<f64>();
    let both = sum(a) + sum(b);
    let off: Vec<f64> = relit.iter().map(|x| 100.0 * (2.0 * sum(x) / both - 1.0)).collect();
    let [least, median, greatest] = spread(&off);
    let apart = |(a, b): (&[f32; 3], &[f32; 3])| (f64::from(a[channel]) - f64::from(b[channel])).powi(2);
    let squares: f64 = a.pixels.iter().zip(&b.pixels).map(apart).sum();
    let ends = if off.len() > 1 { format!(" ({least:+.1}…{greatest:+.1})") } else { String::new() };
    format!("{median:+.1}{ends} ± {:.1}", 100.0 * squares.sqrt() / both)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_told_with_the_spread_of_bakes_and_the_noise_of_what_they_are_held_against() {
        let picture = |of: &dyn Fn(usize) -> f32| Radiance {
            width: 100,
            height: 1,
            pixels: (0..100).map(|nth| [of(nth); 3]).collect(),
        };
        // A fifth apart in each of a hundred pixels, 1 in the mean.
        let traced = [0, 1].map(|half| picture(&|nth| if nth % 2 == half { 1.1 } else { 0.9 }));
        let relit = [1.1, 1.05, 1.2].map(|level| picture(&|_| level));
        assert_eq!(means_off(&relit, &traced, 1), "+10.0 (+5.0…+20.0) ± 1.0");
        assert_eq!(means_off(&relit[..1], &traced, 1), "+10.0 ± 1.0", "one bake has no ends");
    }
}
