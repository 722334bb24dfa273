//! `clerestory bake`: light transport into a file.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use clerestory_transport::archive::{self, ArchiveError, Restart};
use clerestory_transport::bake::focus::Focus;
use clerestory_transport::bake::stack::{MEMORY_BYTES, StackJob, SurveyedStack};
use clerestory_transport::bake::{Bake, BakeConfig, BakeError, BakeEvent, BakeJob, Indirect, Passes};
use clerestory_transport::basis::LightBasis;
use clerestory_transport::import::stack::ImageStack;
use clerestory_transport::irradiance::IrradianceFigures;
use clerestory_transport::sensors::{IrradianceRequest, OfFile};
use indicatif::ProgressBar;
use serde_json::{Value, json};

use super::args::{BakeArgs, BakeOptions, IrradianceArgs};
use super::console::{Answer, Console, advance, duration_words};
use super::estimate;
use super::reuse::Earlier;
use super::view::{
    View, inputs_of, load_look, on_threads, open_view, requested_sky, spare_look, spare_scene_by_all, warn_of_no_sky,
};
use crate::black::black_words;
use crate::look::Look;
use crate::output::{PendingFile, spare_inputs, spare_others};
use crate::platform::memory_bytes;
use crate::session::glimpse;
use crate::sizes::bytes_words;
use crate::words::columns_words;

/// What a bake took.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct BakeTimes {
    /// From the start of the bake to its end.
    pub bake_secs: f64,
    /// From the start of the command to the first whole picture; none of a bake without a preview.
    pub preview_secs: Option<f64>,
    has_preview: bool,
}

pub(super) fn bake(args: &BakeArgs, console: &mut Console) -> Result<Answer> {
    let output = match (&args.output, &args.scene) {
        (Some(output), _) => output,
        (None, Some(scene)) => {
            let look = load_look(args.look.as_deref(), console)?;
            let job = scene_job(scene, args, &look, console)?;
            return Ok(estimate::told(&estimate::forecast(&job, args, console)?, &job.config, console));
        }
        (None, None) => bail!("name the file to write with -o"),
    };
    let (bake, times, earlier) = match (&args.images, &args.scene) {
        (Some(folder), _) => bake_images(folder, output, args, console)?,
        (None, Some(scene)) => bake_scene(scene, output, args, console)?,
        (None, None) => bail!("name a scene, or a folder of pictures with --images"),
    };
    if bake.is_dark() {
        console.warn(&black_words("the picture is", &bake.header.basis));
    }
    let mut answer = baked(&bake, times, &args.options, console)?;
    if let Some(earlier) = earlier {
        answer.json["reuse"] = earlier.json();
        answer.words += &earlier.words();
    }
    answer.json["output"] = json!(output.display().to_string());
    answer.words = format!("{}: {}", output.display(), answer.words);
    Ok(answer)
}

/// What is to be baked of a scene.
fn scene_job(scene: &Path, args: &BakeArgs, look: &Look, console: &mut Console) -> Result<BakeJob> {
    if scene.is_dir() {
        bail!("{0} is a folder; name a scene, or bake the pictures in it with --images {0}", scene.display());
    }
    let asked = args.options.view.as_in(look);
    let sky = requested_sky(&asked, look.lights.sky.as_ref(), args.options.sky_form(look), console)?;
    warn_of_no_sky(sky.as_ref(), args.options.sky_patches, console);
    let view = open_view(scene, &asked, sky.as_ref(), console)?;
    let unheeded = Look { scene: look.scene.clone(), ..Look::default() }.unheeded(&view.scene.lighting.basis);
    console.warn_all(unheeded);
    console.warn_all(direct_alone(look, args.options.patches));
    let mut request = requested(&args.irradiance);
    if request.of_file == OfFile::All && request.work_planes.is_empty() {
        let plane = look.scene.work_plane.as_ref().and_then(|plane| plane.on(&view.scene.scene, None));
        request.work_planes.extend(plane);
        console.warn_all(look.missing_floor(&view.scene.scene));
    }
    let rows = request.rows(&view.scene);
    let irradiance = rows.with_context(|| format!("cannot measure light in {}", scene.display()))?;
    Ok(BakeJob { irradiance, ..job(view, &args.options, Passes::PreviewAndFinal) })
}

/// What gives the first whole picture of a bake that is to have one, in place of a preview, which takes several times as long; none of
/// one that is as small itself.
pub(super) fn first_look(job: &mut BakeJob) -> Option<BakeJob> {
    let look = glimpse::job(job).filter(|_| job.passes == Passes::PreviewAndFinal)?;
    job.passes = Passes::FinalOnly;
    Some(look)
}

/// What is said of a look whose lamps a bake with so many patches will show by less than all of their light.
fn direct_alone(look: &Look, n_patches: u32) -> Option<String> {
    let n_lamps = look.lights.shining_lamps().len();
    (n_patches == 0 && n_lamps > 0).then(|| {
        let lamps = if n_lamps == 1 { "a lamp".into() } else { format!("{n_lamps} lamps") };
        format!(
            "the look has {lamps} of its own, which this bake will show by direct light alone, without what surfaces make of it; \
             bake with --patches 4096 for that"
        )
    })
}

/// A bake, what it took, and the earlier one that it looked at.
type Baked = (Bake, BakeTimes, Option<Earlier>);

fn bake_scene(scene: &Path, output: &Path, args: &BakeArgs, console: &mut Console) -> Result<Baked> {
    let inputs: Vec<_> = inputs_of(&args.options.view).collect();
    spare_scene_by_all(&places_of(output), scene)?;
    reserve(output, &inputs)?;
    spare_half_done(output, &args.options)?;
    let look = load_look(args.look.as_deref(), console)?;
    places_of(output).iter().try_for_each(|place| spare_look(place, args.look.as_deref(), &look))?;
    let mut job = scene_job(scene, args, &look, console)?;
    let mut options = args.options.clone();
    if let Some(limit_bytes) = args.memory {
        options.view.threads = Some(estimate::fit(limit_bytes, &mut job, args, console)?);
    }
    let earlier = Earlier::find(&job, args, output, console)?;
    job.passes = from_now(job.passes, args.options.seconds);
    let (kept, restart) = (|| left_behind(output, restart(&args.options)), restart(&args.options));
    // What a first look takes of memory is not among what a limit is held against.
    let may_look = args.memory.is_none();
    let is_new = earlier.as_ref().is_none_or(|earlier| earlier.reuse.is_err())
        && (restart == Restart::Fresh || !archive::part_of(output).exists());
    let first_look = (is_new && may_look).then(|| first_look(&mut job)).flatten();
    let (bake, times) = run_with_progress(console, &options, &kept, |on_event| {
        if let Some(look) = first_look
            && glimpse::run(look, job.film, &Focus::default(), &mut *on_event)?.is_none()
        {
            return Ok(None);
        }
        match earlier.as_ref().and_then(|earlier| earlier.reuse.as_ref().ok()) {
            Some(reuse) => archive::rebake_to_file(job, reuse, output, restart, on_event),
            None => archive::bake_to_file(job, output, restart, on_event),
        }
    })
    .with_context(|| format!("cannot bake {} to {}", scene.display(), output.display()))?;
    Ok((bake, times, earlier))
}

fn bake_images(folder: &Path, output: &Path, args: &BakeArgs, console: &mut Console) -> Result<Baked> {
    let stack = open_stack(folder, console)?;
    let inputs: Vec<_> = stack.images.iter().map(|image| ("picture", image.path.as_path())).collect();
    reserve(output, &inputs)?;
    let kept = || left_behind(output, restart(&args.options));
    let (bake, times) = run_stack(&stack, &args.options, &kept, console, |surveyed, on_event| {
        archive::stack_to_file(surveyed, output, restart(&args.options), on_event)
    })
    .with_context(|| format!("cannot bake {} to {}", folder.display(), output.display()))?;
    Ok((bake, times, None))
}

/// Reads a stack, bakes it by `run`, and says what was done with the numbers of its pictures, also where that fails. `kept` is as in
/// [`run_with_progress`].
pub(crate) fn run_stack<R>(
    stack: &Arc<ImageStack>,
    options: &BakeOptions,
    kept: &(dyn Fn() -> String + Sync),
    console: &mut Console,
    run: R,
) -> Result<(Bake, BakeTimes)>
where
    R: FnOnce(SurveyedStack, &mut (dyn FnMut(BakeEvent) -> ControlFlow<()> + Send)) -> Result<Option<Bake>, BakeError>
        + Send,
{
    let job = stack_job(stack, options);
    job.check_memory(memory_bytes())?;
    let mut remarks = Vec::new();
    let baked = run_with_progress(console, options, kept, |on_event| {
        let Some(surveyed) = job.survey(on_event)? else { return Ok(None) };
        remarks = surveyed.remarks();
        run(surveyed, on_event)
    });
    console.warn_all(remarks);
    baked
}

/// Opens a folder of pictures and says what else is in it.
pub(crate) fn open_stack(folder: &Path, console: &mut Console) -> Result<Arc<ImageStack>> {
    let stack = ImageStack::open(folder)?;
    console.warn_all(stack.remarks());
    Ok(Arc::new(stack))
}

/// The job that was asked for.
fn stack_job(stack: &Arc<ImageStack>, options: &BakeOptions) -> StackJob {
    let BakeOptions { tolerance: tolerance_db, method, block, .. } = *options;
    let (stack, seed) = (stack.clone(), options.view.seed);
    StackJob { stack, tolerance_db, method, block, seed, memory_bytes: MEMORY_BYTES }
}

/// Where a bake writes: its file, and what is done of it.
fn places_of(output: &Path) -> [PathBuf; 2] {
    [output.to_path_buf(), archive::part_of(output)]
}

/// A place that cannot be written, or is an input, is found out before the long work, not after it.
fn reserve(output: &Path, inputs: &[(&'static str, &Path)]) -> Result<()> {
    places_of(output).iter().try_for_each(|place| spare_inputs(place, inputs.iter().copied()))?;
    spare_others(output, &["transport"], archive::is_transport)?;
    drop(PendingFile::create(output)?);
    Ok(())
}

/// A bake within a time starts over, but not in the place of a half-done one that nobody gave up.
fn spare_half_done(output: &Path, options: &BakeOptions) -> Result<()> {
    let part = archive::part_of(output);
    if options.seconds.is_none() || options.fresh || !part.exists() {
        return Ok(());
    }
    match archive::part_state(&part) {
        Ok(state) if state.n_done > 0 => bail!(
            "{} has {} of {} blocks of another bake, and --seconds goes on with none; finish that one, or start over with --fresh",
            part.display(),
            state.n_done,
            state.n_blocks,
        ),
        // Nothing of it is there yet, or all of it is lost.
        Ok(_) | Err(ArchiveError::Damaged { .. }) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

fn restart(options: &BakeOptions) -> Restart {
    // Within a time, blocks of the last pass alone are no start.
    if options.fresh || options.seconds.is_some() { Restart::Fresh } else { Restart::Resume }
}

/// What a bake that is stopped leaves behind; of a file that it was writing nothing.
fn left_behind(output: &Path, restart: Restart) -> String {
    archive::beside::discard(output);
    kept_words(output, restart)
}

fn kept_words(output: &Path, restart: Restart) -> String {
    let part = archive::part_of(output);
    match part.exists() {
        true if restart == Restart::Fresh => "the same command starts over".into(),
        true => format!("what is done is kept in {}, and the same command goes on with it", part.display()),
        false => "nothing was done yet".into(),
    }
}

/// The irradiance that was asked for.
fn requested(args: &IrradianceArgs) -> IrradianceRequest {
    IrradianceRequest {
        of_file: if args.irradiance { OfFile::All } else { OfFile::Nothing },
        nodes: args.sensors.clone(),
        work_planes: args.work_planes.clone(),
    }
}

/// The job that was asked for, without irradiance.
pub(crate) fn job(view: View, options: &BakeOptions, passes: Passes) -> BakeJob {
    let config = BakeConfig {
        spp: options.view.spp,
        tolerance_db: options.tolerance,
        bounces: options.view.bounces,
        seed: options.view.seed,
        indirect: if options.fast { Indirect::Shared } else { Indirect::Traced },
        method: options.method,
        patches: options.patches,
        denoise: !options.exact && !options.no_denoise,
        smooth: !options.exact,
        block: options.block,
    };
    let passes = options.seconds.map_or(passes, |limit| Passes::Until(Instant::now() + limit));
    BakeJob { scene: view.scene, camera: view.camera, film: view.film, config, passes, irradiance: Vec::new() }
}

/// The passes of a bake that begins now: what was read and tried before takes nothing of its time.
fn from_now(passes: Passes, limit: Option<Duration>) -> Passes {
    match (passes, limit) {
        (Passes::Until(_), Some(limit)) => Passes::Until(Instant::now() + limit),
        (passes, _) => passes,
    }
}

/// Runs a bake with a bar, on the threads asked for, and keeps the time. `kept` says what is left of it when it is
/// interrupted.
pub(crate) fn run_with_progress<R>(
    console: &mut Console,
    options: &BakeOptions,
    kept: &(dyn Fn() -> String + Sync),
    run: R,
) -> Result<(Bake, BakeTimes)>
where
    R: FnOnce(&mut (dyn FnMut(BakeEvent) -> ControlFlow<()> + Send)) -> Result<Option<Bake>, BakeError> + Send,
{
    let begun = std::time::Instant::now();
    let bar = console.start_progress("baking");
    let mut times = BakeTimes::default();
    let interrupt = console.interrupt.heeded()?;
    let result = interrupt.watched(&bar, kept, || {
        on_threads(options.view.threads, || {
            run(&mut |event| {
                observe(event, &bar, &mut times, console);
                if interrupt.came() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            })
        })
    });
    console.end_progress();
    let Some(bake) = result?? else {
        return Err(interrupt.stopped(kept()));
    };
    times.bake_secs = begun.elapsed().as_secs_f64();
    Ok((bake, times))
}

fn observe(event: BakeEvent, bar: &ProgressBar, times: &mut BakeTimes, console: &mut Console) {
    match event {
        // What has one pass ends with it.
        BakeEvent::Started { n_passes, .. } => times.has_preview = n_passes > 1,
        BakeEvent::PassDone { pass: 0, .. } if times.has_preview => {
            times.preview_secs.get_or_insert(console.started.elapsed().as_secs_f64());
        }
        BakeEvent::Progress { done, secs_left, .. } => {
            advance(bar, done);
            if let Some(secs) = secs_left {
                bar.set_message(format!("{} left", duration_words(f64::from(secs))));
            }
        }
        _ => {}
    }
}

/// Times and figures of a finished bake.
pub(crate) fn baked(bake: &Bake, times: BakeTimes, options: &BakeOptions, console: &Console) -> Result<Answer> {
    let figures = serde_json::to_value(bake.figures()).context("the figures of a bake always have a JSON form")?;
    let threads = options.view.threads.map_or_else(rayon::current_num_threads, usize::from);
    let mut json = json!({
        "bake_secs": times.bake_secs,
        "preview_secs": times.preview_secs,
        "device": "cpu",
        "threads": threads,
        "warnings": console.warnings(),
    });
    merge(&mut json, figures.clone());
    let irradiance = bake.irradiance_figures();
    json["irradiance"] = json!(irradiance);
    let words = format!(
        "baked in {} on {threads} threads\n{}{}",
        duration_words(times.bake_secs),
        figure_words(&figures, &bake.header.basis),
        irradiance_words(&irradiance),
    );
    Ok(Answer { json, words })
}

/// Adds the members of one object to another.
pub(crate) fn merge(into: &mut Value, from: Value) {
    if let (Some(into), Value::Object(from)) = (into.as_object_mut(), from) {
        into.extend(from);
    }
}

/// The figures of irradiance for people, a line for each matrix.
pub(crate) fn irradiance_words(figures: &[IrradianceFigures]) -> String {
    let line = |f: &IrradianceFigures| {
        format!(
            "\nirradiance  {}: {}×{}, {} (dense {}), error {:.1} dB",
            f.name,
            f.width,
            f.height,
            bytes_words(f.bytes as u64),
            bytes_words(f.dense_bytes as u64),
            f.error_db.total,
        )
    };
    figures.iter().map(line).collect()
}

/// The figures of a transport for people.
pub(crate) fn figure_words(figures: &Value, basis: &LightBasis) -> String {
    let number = |name: &str| figures[name].as_f64().unwrap_or(f64::NAN);
    let size = |name: &str| figures[name].as_u64().map_or("an unknown size".into(), bytes_words);
    let columns = figures["columns"].as_u64().map_or("an unknown number of columns".into(), columns_words);
    format!(
        "pixels      {} with {columns}\n\
         blocks      {}, mean rank {:.2}, highest {}\n\
         size        {}{} in memory (dense {}, {:.1} times as large)\n\
         error       {}{}{}{}{}{}{}{}",
        number("pixels"),
        number("blocks"),
        number("mean_rank"),
        number("max_rank"),
        figures["file_bytes"].as_u64().map_or(String::new(), |bytes| bytes_words(bytes) + " packed, "),
        size("bytes"),
        size("dense_bytes"),
        number("ratio"),
        error_words(&figures["error_db"], basis),
        preview_words(figures),
        block_words(&figures["block_error_db"], basis),
        column_words(&figures["column_error_db"]),
        together_words(figures),
        reconstruction_words(&figures["reconstruction"]),
        patch_words(&figures["patches"]),
        skipped_words(&figures["skipped"]),
    )
}

/// Whose own form the file does not hold, a line of its own; nothing where it does.
pub(super) fn reconstruction_words(reconstruction: &Value) -> String {
    let word = |name: &str| reconstruction[name].as_str();
    let Some((method, why)) = word("method").zip(word("why")) else { return String::new() };
    format!(
        "\nmethod      {method}: {why}; the file holds its reconstruction in full, so that the error \
         is the method's and ranks and size say nothing of it"
    )
}

/// What free lamps light, a line of its own.
fn patch_words(figures: &Value) -> String {
    let number = |name: &str| figures[name].as_f64();
    let Some((patches, columns)) = number("patches").zip(figures["columns"].as_u64()) else { return String::new() };
    format!(
        "\npatches     {patches} with {} points in {}, mean rank {:.2}{}; error {:.1} dB, of lamps never seen {:.1} %",
        number("samples").unwrap_or(f64::NAN),
        columns_words(columns),
        number("mean_rank").unwrap_or(f64::NAN),
        figures["file_bytes"].as_u64().map_or(String::new(), |bytes| format!(", {}", bytes_words(bytes))),
        figures["error_db"]["total"].as_f64().unwrap_or(f64::NAN),
        100.0 * number("held_out_error").unwrap_or(f64::NAN),
    )
}

fn error_words(error_db: &Value, basis: &LightBasis) -> String {
    let decibels = |name: &str| error_db[name].as_f64().map_or("unmeasured".into(), |db| format!("{db:.1} dB"));
    let total = decibels("total");
    if basis.is_measured() {
        return format!("{total} against the pictures, all of it truncation; their own noise is not known");
    }
    let bias = error_db["bias"].as_f64().map_or(String::new(), |db| format!(", bias of shared light {db:.1} dB"));
    let (truncation, sampling, noise) = (decibels("truncation"), decibels("sampling"), decibels("noise"));
    format!("{total} in all: truncation {truncation}, sampling {sampling}{bias}; noise of the samples {noise}")
}

/// Blocks that a time left as the preview made them, a line of its own; nothing where there are none.
fn preview_words(figures: &Value) -> String {
    let Some(n_blocks) = figures["preview_blocks"].as_u64().filter(|n| *n > 0) else { return String::new() };
    format!(
        "\npreview     {n_blocks} of the blocks, which time left as the preview made them: their indirect light is shared and clamped"
    )
}

/// The worst blocks, a line of its own: each layer has one.
fn block_words(block_error_db: &Value, basis: &LightBasis) -> String {
    let worst = |layer: &str| block_error_db[layer]["worst"].as_f64().unwrap_or(f64::NAN);
    let total = format!("\nworst block {:.1} dB in all", worst("total"));
    if basis.is_measured() {
        return total;
    }
    let [truncation, sampling, noise] = ["truncation", "sampling", "noise"].map(worst);
    format!(
        "{total}; worst truncation {truncation:.1} dB, sampling {sampling:.1} dB, noise of the samples {noise:.1} dB"
    )
}

/// The worst lights, a line of its own; nothing where the file does not tell.
fn column_words(column_error_db: &Value) -> String {
    let word = |light: &Value| Some(format!("{} {:.1} dB", light["light"].as_str()?, light["db"].as_f64()?));
    let worst: Vec<String> = column_error_db["worst"].as_array().into_iter().flatten().filter_map(word).collect();
    let Some(median) = column_error_db["median"].as_f64().filter(|_| !worst.is_empty()) else { return String::new() };
    format!("\nworst light {}; median of all columns {median:.1} dB, each below its own peak", worst.join(", "))
}

/// Lamps that are not kept apart, a line of its own; nothing where each is as it was sampled.
fn together_words(figures: &Value) -> String {
    let Some(n_lamps) = figures["lamps_together"].as_u64().filter(|n| *n > 0) else { return String::new() };
    format!(
        "\nlamps       {n_lamps} have a rank in common in each block: one alone may lack what is weak of it, or show squares; a higher \
         --tolerance, more samples or fewer lamps help (up to 32 are kept apart where noise is taken out)"
    )
}

/// What a bake found needless, a line for people; nothing where it found nothing.
fn skipped_words(skipped: &Value) -> String {
    let number = |name: &str| skipped[name].as_f64().unwrap_or(0.0);
    let parts: Vec<String> = [
        ("samples_saved", 100.0, "% of the samples"),
        ("closed_sky_columns", 1.0, "columns of a sky behind walls"),
        ("dark_lamp_columns", 1.0, "columns of lamps that light nothing"),
        ("sky_patches", 1.0, "unseen patches of the sky"),
        ("empty_pixels", 1.0, "empty pixels"),
        ("idle_images", 1.0, "images"),
        ("reused_columns", 1.0, "columns of an earlier bake"),
    ]
    .into_iter()
    .filter(|(name, ..)| number(name) > 0.0)
    .map(|(name, scale, what)| format!("{:.0} {what}", number(name) * scale))
    .collect();
    if parts.is_empty() { String::new() } else { format!("\nskipped     {}", parts.join(", ")) }
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use clerestory_transport::camera::Film;

    use super::*;
    use crate::cli::args::{Arguments, Command};
    use crate::support::room_job;

    fn options(more: &[&str]) -> BakeOptions {
        let line = ["clerestory", "bake", "room.gltf", "-o", "a.transport"].iter().chain(more);
        let Some(Command::Bake(args)) = Arguments::try_parse_from(line).unwrap().command else { panic!("it is bake") };
        args.options
    }

    /// Leaves a bake after its first block.
    fn begin(output: &Path) {
        let config = BakeConfig { spp: 2, tolerance_db: 20.0, ..BakeConfig::default() };
        let job = room_job(Film { width: 32, height: 24 }, config);
        let stopped = archive::bake_to_file(job, output, Restart::Resume, |event| match event {
            BakeEvent::BlockDone { .. } => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        });
        assert!(stopped.unwrap().is_none());
    }

    #[test]
    fn lamps_of_a_look_are_told_to_lack_what_surfaces_make_of_them_without_patches() {
        let lamps = r#"{"clerestory": 1, "lamps": [
            {"key": "a", "type": "point", "position": [0, 1, 0], "strength": 5},
            {"key": "b", "type": "point", "position": [0, 1, 0], "strength": 5, "muted": true}]}"#;
        let look = Look::from_json(lamps).unwrap().0;
        let told = direct_alone(&look, 0).expect("one of them shines");
        assert!(told.contains("a lamp of its own") && told.contains("--patches 4096"), "{told}");
        assert_eq!((direct_alone(&look, 4096), direct_alone(&Look::default(), 0)), (None, None));
    }

    #[test]
    fn a_bake_within_a_time_starts_no_half_done_one_over() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("a.transport");
        let within_a_time = options(&["--seconds", "1"]);
        spare_half_done(&output, &within_a_time).unwrap();
        begin(&output);
        let said = spare_half_done(&output, &within_a_time).unwrap_err().to_string();
        assert!(said.contains("of 4 blocks") && said.contains("--fresh"), "{said}");
        let free: [&[&str]; 2] = [&[], &["--seconds", "1", "--fresh"]];
        free.into_iter().for_each(|free| spare_half_done(&output, &options(free)).unwrap());
        std::fs::write(archive::part_of(&output), "a letter to a friend").unwrap();
        let said = spare_half_done(&output, &within_a_time).unwrap_err().to_string();
        assert!(said.contains("in the way"), "{said}");
    }

    #[test]
    fn a_bake_that_is_stopped_while_it_writes_leaves_no_temporary_file() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("a.transport");
        let (temporary, _file) = archive::beside::temporary(&output).unwrap();
        std::fs::write(archive::part_of(&output), "").unwrap();
        let said = left_behind(&output, Restart::Resume);
        assert!(said.contains("a.transport.part") && !temporary.exists(), "{said}");
        assert!(archive::part_of(&output).exists());
    }

    #[test]
    fn the_time_of_a_bake_begins_with_it() {
        let (begun, hour) = (Instant::now(), Duration::from_secs(3600));
        let Passes::Until(at) = from_now(Passes::Until(begun), Some(hour)) else { panic!("it has a time") };
        assert!(at >= begun + hour);
        assert_eq!(from_now(Passes::FinalOnly, Some(hour)), Passes::FinalOnly);
        assert_eq!(from_now(Passes::PreviewAndFinal, None), Passes::PreviewAndFinal);
    }

    #[test]
    fn lamps_that_are_not_kept_apart_are_told_where_there_are_some() {
        let told = |n_lamps: usize| together_words(&json!({ "lamps_together": n_lamps }));
        assert!(told(64).starts_with("\nlamps       64 have a rank in common"), "{}", told(64));
        assert_eq!(told(0) + &together_words(&json!({})), "");
    }

    #[test]
    fn blocks_of_the_preview_are_told_where_there_are_some() {
        let told = |n_blocks: u32| preview_words(&json!({ "preview_blocks": n_blocks }));
        assert!(told(7).starts_with("\npreview     7 of the blocks"), "{}", told(7));
        assert_eq!(told(0) + &preview_words(&json!({})), "");
    }
}
