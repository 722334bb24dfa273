//! `clerestory relight --look SHOTS.look -o frame_####.png`: the frames of a look's timeline.

use std::ops::RangeInclusive;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

use anyhow::{Result, bail};
use clap::Args;
use clerestory_transport::archive::beside::discard;
use clerestory_transport::bake::BakeHeader;
use clerestory_transport::basis::LightBasis;
use clerestory_transport::camera::Film;
use indicatif::ProgressBar;
use serde_json::json;

use super::args::{Layers, RelightArgs};
use super::bake::merge;
use super::console::{Answer, Console, advance, duration_words};
use super::interrupt::nothing_kept;
use super::lamps;
use super::picture;
use super::relight::open_graphics;
use super::view::{files_of_look, files_of_scene, load_bake, load_look, warn_of_unknown_lights};
use crate::look::Look;
use crate::look::lamps::resolve;
use crate::look::timeline::FPS;
use crate::sequence::{Pattern, Sequence, Written};
use crate::session::lamps::LampView;
use crate::stills::{Stills, Subject};

/// Which frames of a timeline are written.
#[derive(Clone, Debug, Default, Args)]
pub struct FramesArgs {
    /// First and last frame of the look's timeline; write # for their digits in -o [default: all where -o has #].
    #[arg(long, value_name = "FIRST..LAST", requires = "look", conflicts_with_all = ["name", "at", "preset"],
        value_parser = parse_frames)]
    pub frames: Option<RangeInclusive<u32>>,
    /// Frames of a second [default: as the look says, else 24].
    #[arg(long, value_name = "N", requires = "look", value_parser = parse_fps, allow_negative_numbers = true)]
    pub fps: Option<f32>,
}

impl FramesArgs {
    /// Whether many files are meant.
    pub(super) fn are_meant(&self, output: &Path) -> bool {
        self.frames.is_some() || self.fps.is_some() || Pattern::is_meant(output)
    }
}

fn parse_frames(text: &str) -> Result<RangeInclusive<u32>, String> {
    let problem = "write FIRST..LAST such as 0..48, both of which are written";
    let (first, last) = text.split_once("..").ok_or(problem)?;
    let number = |text: &str| text.trim().parse::<u32>().map_err(|_| problem);
    let (first, last) = (number(first)?, number(last.trim_start_matches('='))?);
    if first > last { Err(problem.into()) } else { Ok(first..=last) }
}

fn parse_fps(text: &str) -> Result<f32, String> {
    let fps = text.parse::<f64>().ok().filter(|fps| FPS.contains(fps));
    fps.map(|fps| fps as f32).ok_or_else(|| format!("write {} to {}", FPS.start(), FPS.end()))
}

/// Refuses frames of no look, and options that mean nothing to frames.
fn refuse_others(args: &RelightArgs) -> Result<()> {
    let options = &args.options;
    if options.look.is_none() {
        bail!(
            "# in {} asks for the frames of a timeline, which is that of a look; name one with --look, or leave out # for one picture",
            options.output.display()
        );
    }
    if options.layers.iter().any(|layer| *layer != Layers::None) {
        bail!("frames hold no layers; leave out --layers, or relight one moment with --at");
    }
    let choice = &options.choice;
    if choice.name.is_some() || choice.at.is_some() || choice.preset.is_some() {
        bail!("--name, --at and --preset light one picture; leave them out to write frames, or # in -o for one file");
    }
    if args.lamp_samples != lamps::DEFAULT_SAMPLES {
        bail!("--lamp-samples is for one picture or a sheet; leave it out to write frames, or # in -o for one file");
    }
    Ok(())
}

/// Writes the frames.
pub(super) fn sequence(args: &RelightArgs, console: &mut Console) -> Result<Answer> {
    refuse_others(args)?;
    let options = &args.options;
    let pattern = Pattern::new(&options.output)?;
    let mut look = load_look(options.look.as_deref(), console)?;
    let folder = options.look.as_deref().and_then(Path::parent).unwrap_or(Path::new("")).to_path_buf();
    let mut named = files_of_look(options.look.as_deref(), &look);
    // Where no frame is there yet, none takes a place, and the scene need not be read for that.
    if let Some(scene) = args.scene.as_deref().filter(|_| pattern.has_files()) {
        named.extend(files_of_scene(scene));
    }
    look.rigs_mut().for_each(|rig| console.warn_all(resolve(&mut rig.lamps, &folder)));
    let file = picture::options(pattern.format, options.depth, options.cut, &options.layers)?;
    let sequence = Sequence::new(look, pattern, args.frames.frames.clone(), args.frames.fps)?;
    let sequence = Sequence { options: file, ..sequence };
    let read = [
        ("transport", Some(args.transport.as_path())),
        ("look", options.look.as_deref()),
        ("scene", args.scene.as_deref()),
    ];
    let mut inputs: Vec<(&'static str, &Path)> =
        read.into_iter().filter_map(|(what, path)| Some((what, path?))).collect();
    inputs.extend(named.iter().map(|(what, file)| (*what, file.as_path())));
    sequence.spare(&inputs)?;

    let interrupt = console.interrupt.heeded()?;
    let opened = || opened(args, &sequence, console);
    let (mut stills, header) = interrupt.watched(&ProgressBar::hidden(), &nothing_kept, opened)?;
    let file = sequence.options.window([header.width, header.height])?;
    let (begun, n_frames) = (Instant::now(), sequence.n_frames());
    let written = written(&sequence, &mut stills, &header.basis, console)?;
    console.warn_all(written.warning(&header.basis));
    stills.relighter().into_iter().for_each(|relighter| relighter.warn_of_refusal(console));
    let device = stills.relighter().map_or_else(String::new, |relighter| format!(" on the {}", relighter.words()));
    let (secs, output) = (begun.elapsed().as_secs_f64(), options.output.display().to_string());
    let words =
        format!("{output}: {n_frames} frames, {}×{}, in {}{device}", file.width, file.height, duration_words(secs));
    let mut json = json!({
        "output": output, "frames": n_frames, "first": sequence.frames.start(), "last": sequence.frames.end(), "fps": sequence.fps,
        "width": file.width, "height": file.height, "relight_secs": secs, "warnings": console.warnings(),
    });
    stills.relighter().into_iter().for_each(|relighter| merge(&mut json, relighter.json()));
    Ok(Answer { json, words })
}

/// Reads what the frames are lit with, and says what of the look means nothing to it. Answers the head of the bake as well.
fn opened(args: &RelightArgs, sequence: &Sequence, console: &mut Console) -> Result<(Stills, Arc<BakeHeader>)> {
    let graphics = open_graphics(args.options.device)?;
    let bake = load_bake(&args.transport)?;
    let header = bake.header.clone();
    // A size that the bake does not have is told before the scene is read.
    sequence.options.window([header.width, header.height])?;
    for snapshot in &sequence.look.snapshots {
        let (names, scene) = (sequence.look.names.clone(), sequence.look.scene.clone());
        warn_of_unknown_lights(&header.basis, &Look { names, scene, ..snapshot.look() }, console);
    }
    let rigs = sequence.look.snapshots.iter().map(|snapshot| &snapshot.lights);
    lamps::warn_of_no_lamps(rigs, lamps::options_of_lamps(args), console);
    let all: Vec<_> = sequence.look.seen_in_time().flat_map(|snapshot| snapshot.lights.shining_lamps()).collect();
    let measures = bake.pixel_irradiance().is_some();
    let view = lamps::stage(&bake, &all, args.scene.as_deref(), console)?.map(|(scene, camera)| LampView {
        scene: Arc::new(scene),
        camera,
        film: Film { width: header.width, height: header.height },
        patches: header.patches.clone(),
        measures,
        bounces: header.config.bounces,
        device: None,
    });
    lamps::warn_of_remarks(&all, console);
    view.iter().for_each(|view| lamps::warn_of_lacking(&all, args.options.look.as_deref(), &view.scene, console));
    Ok((Stills::new(Arc::new(Subject { bake, view }), graphics), header))
}

/// Writes all frames; a signal ends that, and of the frame that is not whole then nothing stays.
fn written(sequence: &Sequence, stills: &mut Stills, basis: &LightBasis, console: &mut Console) -> Result<Written> {
    let interrupt = console.interrupt.heeded()?;
    let (n_frames, n_whole, bar) = (sequence.n_frames(), AtomicU32::new(0), console.start_progress("frames"));
    let mut on_frame = |n: u32| {
        n_whole.store(n, Ordering::Relaxed);
        advance(&bar, n as f32 / n_frames as f32);
        bar.set_message(format!("{n} of {n_frames}"));
    };
    let words = |n: u32| format!("{n} of {n_frames} frames were written, each of them whole");
    let kept = || {
        let n_whole = n_whole.load(Ordering::Relaxed);
        discard(&sequence.pattern.file(sequence.frames.start().saturating_add(n_whole)));
        words(n_whole)
    };
    let write = || sequence.write(stills, basis, &|| interrupt.came(), &mut on_frame);
    let written = interrupt.watched(&bar, &kept, write);
    console.end_progress();
    let written = written?;
    if written.n_frames < n_frames { Err(interrupt.stopped(words(written.n_frames))) } else { Ok(written) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_typed_with_both_ends() {
        assert_eq!(parse_frames("0..48"), Ok(0..=48));
        assert_eq!(parse_frames("7..=7"), Ok(7..=7));
        for bad in ["", "5", "5..", "9..3", "-1..3", "a..b"] {
            assert!(parse_frames(bad).is_err(), "{bad}");
        }
        assert!(parse_fps("23.976").is_ok() && parse_fps("0").is_err() && parse_fps("nan").is_err());
    }
}
