//! A building open to a measured sky, which turns after the bake.

use anyhow::{Context, Result};
use clerestory::compare::{compare, read_exr};
use clerestory_relight::Radiance;
use serde_json::{Value, json};

use crate::desk::{Desk, clerestory, number};
use crate::errors::pictures_beside_two;
use crate::prints::jpeg;

/// Of the bake, and of both traced pictures.
const BAKE_SEED: &str = "1";
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
    let transport = desk.file("open.transport");
    desk.say("baking a building under a measured sky");
    let bake = ["bake", scene, "-o", &transport, "--sky", sky, "--size", size, "--spp", spp, "--seed", BAKE_SEED];
    let baked = clerestory(&[&bake[..], &["--fresh", "--json"]].concat())?;
    let told = clerestory(&["info", &transport, "--json"])?;
    let keys = told.pointer("/lights").and_then(Value::as_array).context("no lights")?;
    let lamps = keys.iter().filter_map(Value::as_str).filter(|key| *key != "sky");
    let off: serde_json::Map<String, Value> = lamps.map(|key| (key.into(), json!({ "intensity": 0 }))).collect();
    let (mut rows, mut pictures, mut first) = (String::new(), Vec::new(), None);
    for turn in TURNS_DEG {
        let look = desk.file("open.look");
        std::fs::write(&look, json!({ "clerestory": 1, "lights": off, "sky": { "rotation_deg": turn } }).to_string())?;
        let relit = desk.file("open-relit.exr");
        desk.say(&format!("the building with its sky turned by {turn}°"));
        let options = ["--look", &look, "--json"];
        clerestory(&[&["relight", &transport, "-o", &relit, "--device", "cpu"][..], &options].concat())?;
        let traced = |seed: &str| {
            let file = desk.file("open-traced.exr");
            let trace = ["trace", scene, "-o", &file, "--sky", sky, "--size", size, "--spp", trace_spp, "--seed", seed];
            clerestory(&[&trace[..], &options].concat())?;
            read_exr(file.as_ref())
        };
        let (shown, traced) = (read_exr(relit.as_ref())?, [traced(TRACE_SEEDS[0])?, traced(TRACE_SEEDS[1])?]);
        let moved = compare(&shown, first.get_or_insert_with(|| shown.clone()))?.psnr_db;
        let moved = moved.map_or("the same".into(), |db| format!("{db:.1}"));
        let percent_off = |channel: usize| {
            let mean = |picture: &Radiance| picture.pixels.iter().map(|rgb| f64::from(rgb[channel])).sum::<f64>();
            format!("{:+.1}", 100.0 * (2.0 * mean(&shown) / (mean(&traced[0]) + mean(&traced[1])) - 1.0))
        };
        let (own, of_trace) = (db(&shown, &traced), db(&traced[0], &[shown.clone(), traced[1].clone()]));
        let colors = [0, 1, 2].map(percent_off).join(" / ");
        rows += &format!("| {turn}° | {own} | {of_trace} | {colors} | {moved} |\n");
        if turn != TURNS_DEG[1] {
            let [traced, _] = traced;
            pictures.extend([("traced", traced), ("relit", shown)]);
        }
    }
    let text = format!(
        "\n### A building under a measured sky\n\n\
         `sponza-dabrovic` under `vestibule_1k.hdr`, {} columns, {size} pixels, {spp} samples per pixel (seed {BAKE_SEED}) in {:.1} s, {:.2} MB in the file; then its lamp is turned off and the sky is\n\
         turned. Beside it path-traced pictures a and b under the same sky, {trace_spp} samples each (seeds {}). The error of the relit picture x is the mean of (x − a)(x − b), that of a traced one\n\
         the mean of (a − x)(a − b), below the square of the 99.5 percentile; neither counts the noise of what it is held against.\n\n\
         | turned by | relit, dB | traced, dB | means off, R / G / B, % | against the first relit picture, PSNR, dB |\n|---|---|---|---|---|\n{rows}",
        number(&told, "/columns"),
        number(&baked, "/bake_secs"),
        number(&told, "/file_bytes") / 1e6,
        TRACE_SEEDS.join(" and "),
    );
    Ok((text, jpeg(&pictures)?))
}

/// How far a picture is off two pictures whose noise is their own.
fn db(picture: &Radiance, [a, b]: &[Radiance; 2]) -> String {
    pictures_beside_two(picture, [a, b]).map_or("within noise".into(), |db| format!("{db:.1}"))
}
