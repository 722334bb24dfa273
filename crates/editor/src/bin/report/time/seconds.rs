//! The first seconds at the desk: the preview, and what some seconds make of it, by the clock on the wall.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use clerestory::session::glimpse;
use clerestory_transport::bake::focus::Focus;
use clerestory_transport::bake::{BakeConfig, BakeJob, Indirect, Passes};
use clerestory_transport::camera::Film;
use serde::{Deserialize, Serialize};

use super::runs::{Judge, REFERENCE_SPP, job};
use super::{SECONDS, Subject, prepared};
use crate::desk::Desk;
use crate::fit::{hundredths, median, spread_words};
use crate::goal::Goal;
use crate::matrix::process_cpu_secs;
use crate::under_way::{OF_WINDOW, ends_a_pass, run_until};

/// What is aimed at: seconds by the clock, and the error of single lights, dB.
type Aim = (f64, f64);

const PREVIEW: Aim = (1.5, 27.0);
const SOON: Aim = (5.0, 35.0);
/// When a bake is left, seconds: it ends with the next block, so that what is left at the very end of an aim never keeps it.
const LEFT_AFTER_SECS: f64 = 4.9;

/// One scene by the clock, seconds.
#[derive(Serialize, Deserialize)]
struct Clocked {
    prepare: Vec<f64>,
    /// Nothing where the bake is as small itself.
    look: Vec<f64>,
    look_db: Vec<Option<f64>>,
    preview: Vec<f64>,
    preview_cpu: Vec<f64>,
    preview_db: Vec<Option<f64>>,
    soon: Vec<f64>,
    soon_db: Vec<Option<f64>>,
}

/// A table over the scenes that the aims speak of.
///
/// # Errors
/// As [`super::write`].
pub fn write(desk: &Desk) -> Result<String> {
    let (film, step) = desk.choose((Film { width: 64, height: 48 }, 1), (Film { width: 512, height: 384 }, 4));
    let bench = ["bench-conf64", "bench-sponza20"].map(|name| (name, desk.shared(&format!("references/{name}.glb"))));
    let gallery = ("gallery", Some(desk.root.join("assets/scenes/gallery.glb")));
    let mut rows = String::new();
    let all = bench.into_iter().chain([gallery]);
    for (name, path) in at_hand(all).take(desk.choose(1, usize::MAX)) {
        let (sky, panel, reference_spp, n_seeds) = (None, None, REFERENCE_SPP, repeats(desk) as usize);
        let subject = Subject { name, path, sky, panel, film, step, reference_spp, n_seeds };
        for (indirect, how) in OF_WINDOW {
            let part = || clock(desk, &subject, indirect);
            let clocked: Clocked = desk.part(SECONDS, &format!("{name}{how}"), part)?;
            rows += &format!(
                "| {name}{how} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |\n",
                spread_words(clocked.prepare),
                if clocked.look.is_empty() { "—".into() } else { hundredths(clocked.look.clone()) },
                decibels(&clocked.look_db),
                if clocked.look.is_empty() { "—" } else { verdict(PREVIEW, &clocked.look, &clocked.look_db) },
                hundredths(clocked.preview.clone()),
                spread_words(clocked.preview_cpu),
                decibels(&clocked.preview_db),
                verdict(PREVIEW, &clocked.preview, &clocked.preview_db),
                hundredths(clocked.soon.clone()),
                decibels(&clocked.soon_db),
                verdict(SOON, &clocked.soon, &clocked.soon_db),
            );
        }
    }
    Ok(format!(
        "## The first seconds\n\n\
         {}×{} pixels, baked in the passes of a window (a first look, a preview, a sixteenth of the samples, then all of them) at its quality *Final*, which is what `clerestory bake` does that is told nothing, and\n\
         once more with indirect light shared. Seconds by the clock on the wall once the file is read: until the hierarchy is built and the lights are found, until the first look\n\
         ([decision 0039](decisions/0039-a-first-look-comes-before-the-preview.md)) and until the preview are whole (each with all before it, of the preview the CPU seconds beside). The bake goes on and is left\n\
         {LEFT_AFTER_SECS} s after the scene was prepared, so that the block that ends it comes within {} s, but not before its preview is whole: blocks that the pass under way has reached stand beside those of the pass before. A window keeps a core to itself, and starts with *Draft* on fewer than eight; here all of them bake. Median\n\
         (least…greatest) of {} repeats with seeds of their own; error of single lights in dB of each. A first look has all pixels, told by fewer that are traced. Aimed at: a whole picture of {} dB within {} s, be it the first look or the preview, and {} dB within {} s, which the medians keep or\n\
         miss: in seconds, in dB, or in both. [Decision 0035](decisions/0035-colors-of-a-chessboard-judge-each-other.md) tells what the fastest bakes wait for, and why those of scenes with coats, metal or glass wait longer. {}\n\n\
         | scene | prepared | first look | its dB | aim | preview | its CPU s | its dB | aim | left | its dB | aim |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n{rows}",
        film.width,
        film.height,
        SOON.0,
        repeats(desk),
        PREVIEW.1,
        PREVIEW.0,
        SOON.1,
        SOON.0,
        desk.load_words(),
    ))
}

/// Scenes whose files are there: in a hurry the first of these is measured, not the first of all.
fn at_hand(
    scenes: impl Iterator<Item = (&'static str, Option<PathBuf>)>,
) -> impl Iterator<Item = (&'static str, PathBuf)> {
    scenes.filter_map(|(name, path)| Some((name, path?)))
}

/// The error of each repeat.
fn decibels(errors: &[Option<f64>]) -> String {
    let words = errors.iter().map(|db| db.map_or("—".into(), |db| format!("{db:.1}")));
    words.collect::<Vec<_>>().join(", ")
}

/// Whether the medians keep an aim, and if not, what misses it.
fn verdict((most_secs, least_db): Aim, secs: &[f64], errors: &[Option<f64>]) -> &'static str {
    let known: Vec<f64> = errors.iter().flatten().copied().collect();
    let is_kept = |goal: Goal, values: &[f64]| median(values).is_some_and(|value| goal.is_kept(value));
    match (is_kept(Goal::Most(most_secs), secs), is_kept(Goal::Least(least_db), &known)) {
        (true, true) => "kept",
        (true, false) => "missed (dB)",
        (false, true) => "missed (s)",
        (false, false) => "missed (both)",
    }
}

fn repeats(desk: &Desk) -> u64 {
    desk.choose(1, 3)
}

fn clock(desk: &Desk, subject: &Subject, indirect: Indirect) -> Result<Clocked> {
    let judge = Judge::new(desk, subject, &prepared(subject)?)?;
    let mut clocked = Clocked {
        prepare: Vec::new(),
        look: Vec::new(),
        look_db: Vec::new(),
        preview: Vec::new(),
        preview_cpu: Vec::new(),
        preview_db: Vec::new(),
        soon: Vec::new(),
        soon_db: Vec::new(),
    };
    let imported = clerestory_transport::import::load(&subject.path)?.scene;
    for seed in 1..=repeats(desk) {
        desk.say(&format!("the first seconds of {}, seed {seed}", subject.name));
        let copy = imported.clone();
        let (begun, cpu) = (Instant::now(), process_cpu_secs()?);
        let scene = Arc::new(clerestory_transport::prepared::PreparedScene::new(copy, &[])?.0);
        let prepared = Instant::now();
        clocked.prepare.push(prepared.duration_since(begun).as_secs_f64());
        let config = BakeConfig { seed, indirect, ..BakeConfig::default() };
        let job = BakeJob { passes: Passes::Progressive, ..job(subject, &scene, config) };
        let mut looked = None;
        if let Some(look) = glimpse::job(&job) {
            let look = glimpse::run(look, job.film, &Focus::default(), |_| ControlFlow::Continue(()))?;
            looked = Some(look.context("nobody stops a first look of the report")?);
            clocked.look.push(begun.elapsed().as_secs_f64());
        }
        let mut previewed_cpu = None;
        let bake = run_until(job, |event| {
            if previewed_cpu.is_none() && ends_a_pass(event) {
                previewed_cpu = Some(process_cpu_secs());
            }
            previewed_cpu.is_some() && prepared.elapsed().as_secs_f64() >= LEFT_AFTER_SECS
        })?;
        clocked.look_db.extend(looked.map(|look| judge.of_bake(&look.header, &look.groups)[0]));
        let preview = bake.passes.first().context("a bake has a preview")?;
        clocked.preview.push(preview.ended.duration_since(begun).as_secs_f64());
        clocked.preview_cpu.push(previewed_cpu.context("a preview has ended")?? - cpu);
        clocked.preview_db.push(judge.of_bake(&bake.header, &preview.groups)[0]);
        clocked.soon.push(bake.ended.duration_since(prepared).as_secs_f64());
        clocked.soon_db.push(judge.of_bake(&bake.header, &bake.groups)[0]);
    }
    Ok(clocked)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn in_a_hurry_the_first_scene_that_is_there_is_measured() {
        let gallery = PathBuf::from("gallery.glb");
        let scenes = [("bench-conf64", None), ("bench-sponza20", None), ("gallery", Some(gallery.clone()))];
        assert_eq!(at_hand(scenes.into_iter()).take(1).collect::<Vec<_>>(), [("gallery", gallery)]);
    }

    #[test]
    fn a_bake_that_is_left_can_keep_its_aim() {
        // Blocks of bakes come some hundredths of a second after each other.
        let ends = LEFT_AFTER_SECS + 0.05;
        assert_eq!(verdict(SOON, &[ends], &[Some(SOON.1)]), "kept");
    }

    #[test]
    fn an_aim_is_kept_only_in_time_and_with_its_error() {
        let errors = |db: f64| vec![Some(db), None, Some(db)];
        assert_eq!(verdict((5.0, 35.0), &[4.0, 9.0, 5.0], &errors(35.0)), "kept");
        assert_eq!(verdict((5.0, 35.0), &[4.0], &errors(34.9)), "missed (dB)");
        assert_eq!(verdict((5.0, 35.0), &[5.1], &errors(36.0)), "missed (s)");
        assert_eq!(verdict((5.0, 35.0), &[5.1], &[None]), "missed (both)");
    }
}
