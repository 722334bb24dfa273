//! `clerestory trace`: a picture by plain path tracing, the reference of everything else.

use std::ops::ControlFlow;
use std::time::Instant;

use anyhow::{Result, bail};
use clerestory_relight::Radiance;
use clerestory_transport::sky::SkyForm;
use clerestory_transport::trace::{self, TraceConfig};
use indicatif::ProgressBar;
use serde_json::json;

use super::args::TraceArgs;
use super::console::{Answer, Console, advance, duration_words};
use super::interrupt::discarded;
use super::lamps;
use super::picture::{CutArgs, options};
use super::view::{
    inputs_of, load_look, on_threads, open_view, or_of_file, requested_sky, spare_look, spare_scene, warn_of_black,
    warn_of_unknown_lights,
};
use crate::export::{ImageFormat, Picture};
use crate::look::Units;
use crate::output::{PendingFile, spare_inputs};

pub(super) fn trace(args: &TraceArgs, console: &mut Console) -> Result<Answer> {
    let format = ImageFormat::of(&args.output)?;
    let options = options(format, args.depth, CutArgs::default(), &[])?;
    spare_scene(&args.output, &args.scene)?;
    spare_inputs(&args.output, inputs_of(&args.view))?;
    let interrupt = console.interrupt.heeded()?;
    let place = PendingFile::create(&args.output)?;
    let kept = || discarded(&args.output);
    let quiet = ProgressBar::hidden();
    let document = interrupt.watched(&quiet, &kept, || load_look(args.look.as_deref(), console))?;
    spare_look(&args.output, args.look.as_deref(), &document)?;
    let look = args.choice.of(&document, None)?;
    if look.shows_irradiance(format) {
        bail!("trace measures no light that arrives, which the look shows in false color; use `clerestory render`");
    }
    let asked = args.view.as_in(&document);
    let mut view = interrupt.watched(&quiet, &kept, || {
        let sky = requested_sky(&asked, look.lights.sky.as_ref(), SkyForm::Whole, console)?;
        open_view(&args.scene, &asked, sky.as_ref(), console)
    })?;
    let basis = &view.scene.lighting.basis;
    // The sky was mixed with what was typed, not with what shines of both.
    let sky = look.lights.sky;
    let mut look = args.choice.of(&or_of_file(document, args.look.as_deref(), basis), Some(basis))?;
    look.lights.sky = sky;
    warn_of_unknown_lights(basis, &look, console);
    let mut rig = look.lights.clone();
    lamps::install(&mut view, &mut rig, args.look.as_deref(), console)?;
    let coefficients = view.scene.lighting.basis.project(&rig);

    let config = TraceConfig { spp: args.view.spp, bounces: args.view.bounces, seed: args.view.seed };
    let begun = Instant::now();
    let bar = console.start_progress("tracing");
    let progress = |done: f32| {
        advance(&bar, done);
        if interrupt.came() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let pixels = interrupt.watched(&bar, &kept, || {
        on_threads(args.view.threads, || {
            trace::trace(&view.scene, &view.camera, view.film, &coefficients, &config, &progress)
        })
    });
    console.end_progress();
    let pixels = pixels?.ok_or_else(|| interrupt.stopped(kept()))?;
    let trace_secs = begun.elapsed().as_secs_f64();

    let radiance = Radiance { width: view.film.width, height: view.film.height, pixels };
    warn_of_black("the picture is", &radiance, (&view.scene.lighting.basis, &rig), console);
    let picture =
        Picture { radiance: &radiance, layers: &[], irradiance: None, look: &look, units: Units::Photometric };
    let shown = interrupt.watched(&quiet, &kept, || picture.write(place, format, &options))?;
    let output = args.output.display().to_string();
    let [width, height] = shown.size_px;
    let words = format!("{output}: {width}×{height} at {} spp in {}", config.spp, duration_words(trace_secs));
    let json = json!({
        "output": output, "width": width, "height": height, "spp": config.spp,
        "trace_secs": trace_secs, "exposure_ev": shown.exposure_ev, "false_color": shown.legend.map(|legend| legend.json()), "device": "cpu",
        "warnings": console.warnings(),
    });
    Ok(Answer { json, words })
}
