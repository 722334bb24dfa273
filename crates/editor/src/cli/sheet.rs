//! `clerestory relight --contact-sheet`: one bake under several looks, side by side on one sheet.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use serde_json::json;

use super::args::{Layers, RelightArgs};
use super::console::{Answer, Console, duration_words};
use super::lamps::{Arriving, LampLight, added_lux, options_of_lamps, warn_of_no_lamps};
use super::picture::options;
use super::relight::{Lit, irradiance_for};
use super::view::{load_bake, load_look, spare_look, warn_of_black, warn_of_unknown_lights};
use crate::contact_sheet::{Print, check_size, write_sheet};
use crate::export::{ExportOptions, ImageFormat, Picture};
use crate::look::{Look, Units};
use crate::output::PendingFile;

/// Relights under each of the looks and writes the sheet.
pub(super) fn sheet(args: &RelightArgs, console: &mut Console) -> Result<Answer> {
    let output = &args.options.output;
    let format = ImageFormat::of(output)?;
    if format != ImageFormat::Png || args.options.layers.iter().any(|layer| *layer != Layers::None) {
        bail!("a contact sheet is a .png without layers; change the name of the output, or leave out --layers");
    }
    let options = options(format, args.options.depth, args.options.cut, &args.options.layers)?;
    if options.depth != ExportOptions::default().depth {
        bail!("a contact sheet has 8 bits per channel; leave out --bits");
    }
    let place = PendingFile::create(output)?;
    let paths = &args.contact_sheet;
    let looks: Vec<(String, &Path, Look)> = paths
        .iter()
        .map(|path| {
            let look = load_look(Some(path), console)?;
            spare_look(output, Some(path), &look)?;
            Ok((caption(path, paths), path.as_path(), look))
        })
        .collect::<Result<_>>()?;
    let bake = load_bake(&args.transport)?;
    warn_of_no_lamps(looks.iter().map(|(_, _, look)| &look.lights), options_of_lamps(args), console);
    let file = options.window([bake.header.width, bake.header.height])?;
    check_size(looks.len(), [file.width, file.height])?;
    let graphics = super::relight::open_graphics(args.options.device)?;
    let begun = Instant::now();
    let (mut prints, mut told) = (Vec::new(), Vec::new());
    for (name, path, look) in looks {
        warn_of_unknown_lights(&bake.header.basis, &look, console);
        let quality = (Arriving::of(&bake, look.shows_irradiance(format)), args.lamp_samples);
        let lamps = LampLight::of(&bake, &look, (Some(path), args.scene.as_deref()), quality, console)?;
        let lit = Lit::new(&bake, &look, &lamps, graphics.as_ref())?;
        lit.relighter.warn_of_refusal(console);
        let which = format!("the picture of `{name}` is");
        warn_of_black(&which, &lit.radiance, (&bake.header.basis, &look.lights), console);
        let irradiance = irradiance_for(&bake, &look, &added_lux(&lamps), format, &options)?;
        let picture = Picture {
            radiance: &lit.radiance,
            layers: &[],
            irradiance: irradiance.as_ref(),
            look: &look,
            units: Units::of(&bake.header.basis),
        };
        let (picture, shown) =
            picture.developed(&options).with_context(|| format!("cannot show {}", path.display()))?;
        told.push(json!({ "name": name, "look": path.display().to_string(), "exposure_ev": shown.exposure_ev }));
        prints.push(Print { name, picture });
    }
    let (width, height) = write_sheet(&prints, place)?;
    let (secs, output) = (begun.elapsed().as_secs_f64(), output.display().to_string());
    let words = format!("{output}: {} looks on {width}×{height} in {}", prints.len(), duration_words(secs));
    let json = json!({
        "output": output, "width": width, "height": height, "relight_secs": secs, "looks": told,
        "warnings": console.warnings(),
    });
    Ok(Answer { json, words })
}

/// What stands under the picture of a look: its file's name, with its folders where another look's is called the same.
fn caption(path: &Path, all: &[PathBuf]) -> String {
    let is_shared = all.iter().any(|other| other != path && other.file_stem() == path.file_stem());
    let stem = path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    if is_shared { path.with_extension("").display().to_string() } else { stem }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_are_called_by_their_files_and_told_apart_by_their_folders() {
        let all = ["a/day.look", "b/day.look", "b/night.look"].map(PathBuf::from);
        let captions = all.each_ref().map(|path| caption(path, &all));
        assert_eq!(captions, ["a/day", "b/day", "night"]);
    }
}
