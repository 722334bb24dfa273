//! A building open to a measured sky, which turns after the bake.

use anyhow::Result;
use clerestory::compare::{compare, read_exr};

use crate::desk::{Desk, clerestory, number};
use crate::prints::jpeg;

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
    let (size, spp, trace_spp) = desk.choose(("64x48", "8", "64"), ("256x192", "64", "256"));
    let transport = desk.file("open.transport");
    desk.say("baking a building under a measured sky");
    let bake = ["bake", &scene, "-o", &transport, "--sky", &sky, "--size", size, "--spp", spp, "--fresh", "--json"];
    let baked = clerestory(&bake)?;
    let told = clerestory(&["info", &transport, "--json"])?;
    let (mut rows, mut pictures, mut first) = (String::new(), Vec::new(), None);
    for turn in TURNS_DEG {
        let look = desk.file("open.look");
        std::fs::write(&look, format!("{{\"clerestory\": 1, \"sky\": {{\"rotation_deg\": {turn}}}}}"))?;
        let [relit, traced] = ["open-relit.exr", "open-traced.exr"].map(|name| desk.file(name));
        desk.say(&format!("the building with its sky turned by {turn}°"));
        let options = ["--look", &look, "--json"];
        clerestory(&[&["relight", &transport, "-o", &relit, "--device", "cpu"][..], &options].concat())?;
        let trace = ["trace", &scene, "-o", &traced, "--sky", &sky, "--size", size, "--spp", trace_spp, "--seed", "7"];
        clerestory(&[&trace[..], &options].concat())?;
        let compared = clerestory(&["compare", &relit, &traced, "--json"])?;
        let shown = read_exr(relit.as_ref())?;
        let moved = compare(&shown, first.get_or_insert_with(|| shown.clone()))?.psnr_db;
        let moved = moved.map_or("the same".into(), |db| format!("{db:.1}"));
        rows += &format!("| {turn}° | {:.1} | {moved} |\n", number(&compared, "/psnr_db"));
        if turn != TURNS_DEG[1] {
            for (name, path) in [("traced", &traced), ("relit", &relit)] {
                pictures.push((name, read_exr(path.as_ref())?));
            }
        }
    }
    Ok(format!(
        "\n### A building under a measured sky\n\n\
         `sponza-dabrovic` under `vestibule_1k.hdr`, {} columns, {size} pixels, {spp} samples per pixel in {:.1} s, {:.2} MB in the file; then the sky is turned. PSNR of the\n\
         relit picture against a path-traced one of {trace_spp} samples under the sky as it is, whose own noise counts.\n\n| turned by | PSNR, dB | against the first relit picture, dB |\n|---|---|---|\n{rows}{}",
        number(&told, "/columns"),
        number(&baked, "/bake_secs"),
        number(&told, "/file_bytes") / 1e6,
        desk.show("paper-sky.jpg", "traced and relit, the sky as it is and turned", &jpeg(&pictures)?)?,
    ))
}
