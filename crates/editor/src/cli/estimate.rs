//! `clerestory bake --estimate` and `--memory`: what a bake will take, before it is made.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail};
use clerestory_transport::bake::estimate::BakeEstimate;
use clerestory_transport::bake::focus::Focus;
use clerestory_transport::bake::{BakeConfig, BakeError, BakeJob, Indirect, Passes};
use indicatif::ProgressBar;
use serde_json::json;

use super::args::BakeArgs;
use super::bake::{first_look, merge, reconstruction_words};
use super::console::{Answer, Console, duration_words};
use super::interrupt::nothing_kept;
use super::view::on_threads;
use crate::platform::{peak_bytes, resident_bytes};
use crate::room::Needs;
use crate::session::glimpse;
use crate::sizes::bytes_words;

/// How long blocks of a pass are tried.
const BUDGET: Duration = Duration::from_secs(20);

/// What a bake will take, and what the program took before it was asked.
pub(super) struct Forecast {
    estimate: BakeEstimate,
    n_threads: usize,
    /// Memory that is held for the scene, bytes; `None` where the system does not tell.
    held_bytes: Option<u64>,
    /// Most memory so far: while the scene was read, or while blocks were tried.
    peak_bytes: u64,
}

impl Forecast {
    /// Most memory at a time, the scene and the reading of it included, bytes: what was taken while blocks were tried, and the
    /// factors of those that were not.
    fn most_bytes(&self) -> u64 {
        let estimate = &self.estimate;
        let untried = 1.0 - estimate.n_tried as f64 / estimate.n_blocks.max(1) as f64;
        let sampling = self.peak_bytes + (untried * estimate.result_bytes as f64) as u64;
        sampling.max(self.held_bytes.unwrap_or(0) + estimate.ending_bytes)
    }

    /// The most threads on which a bake keeps to a limit, all of those that it was estimated for or fewer; `None` if a single one
    /// takes more.
    fn threads_within(&self, limit_bytes: u64) -> Option<usize> {
        let room = limit_bytes.checked_sub(self.held_bytes.unwrap_or(0))?;
        Needs::estimated(&self.estimate, self.n_threads).threads_within(room, self.n_threads)
    }
}

/// Tries some blocks of a bake, on as many threads as were asked for and a limit of memory leaves room for.
pub(super) fn forecast(job: &BakeJob, args: &BakeArgs, console: &mut Console) -> Result<Forecast> {
    let held_bytes = resident_bytes();
    let room = args.memory.map(|limit| limit.saturating_sub(held_bytes.unwrap_or(0)));
    let (asked, needs) = (asked_threads(args), Needs::at_least(job));
    let n_threads = room.map_or(asked, |room| needs.threads_within(room, asked).unwrap_or(1));
    let interrupt = console.interrupt.heeded()?;
    let tried = interrupt.watched(&ProgressBar::hidden(), &nothing_kept, || {
        on_threads(u16::try_from(n_threads).ok(), || match args.memory {
            Some(_) => job.estimate(BUDGET, &Focus::default()),
            None => estimated(job.clone()),
        })
    });
    let estimate = tried?.context("cannot estimate the bake")?.ok_or_else(|| interrupt.stopped(nothing_kept()))?;
    Ok(Forecast { estimate, n_threads, held_bytes, peak_bytes: peak_bytes().unwrap_or(0) })
}

/// Of a first look it is known what it takes: it is made.
fn estimated(mut job: BakeJob) -> Result<Option<BakeEstimate>, BakeError> {
    let (begun, focus) = (Instant::now(), Focus::default());
    let Some(look) = first_look(&mut job) else { return job.estimate(BUDGET, &focus) };
    glimpse::run(look, job.film, &focus, |_| ControlFlow::Continue(()))?;
    let preview_secs = begun.elapsed().as_secs_f32();
    let of_bake =
        |estimate: BakeEstimate| BakeEstimate { secs: preview_secs + estimate.secs, preview_secs, ..estimate };
    Ok(job.estimate(BUDGET, &focus)?.map(of_bake))
}

fn asked_threads(args: &BakeArgs) -> usize {
    args.options.view.threads.map_or_else(rayon::current_num_threads, usize::from)
}

/// Makes a bake keep within a limit of memory: without a preview if need be, and on the number of threads that is answered.
///
/// # Errors
/// In words, if it cannot.
pub(super) fn fit(limit_bytes: u64, job: &mut BakeJob, args: &BakeArgs, console: &mut Console) -> Result<u16> {
    let (held, read) = (resident_bytes().unwrap_or(0), peak_bytes().unwrap_or(0));
    if read > limit_bytes {
        bail!(
            "reading the scene alone took {} of memory, more than the {} that --memory allows; allow more, or make the scene smaller",
            bytes_words(read),
            bytes_words(limit_bytes),
        );
    }
    if held + job.thread_bytes() > limit_bytes {
        return Err(refusal(held + job.thread_bytes(), held, limit_bytes));
    }
    let with_preview = held + job.thread_bytes() + job.shared_bytes();
    if job.config.indirect == Indirect::Traced && with_preview > limit_bytes {
        job.passes = without_preview(job.passes).ok_or_else(|| no_room_for_preview(with_preview, limit_bytes))?;
    }
    let mut told = forecast(job, args, console)?;
    // All that a preview takes is known only now.
    if told.threads_within(limit_bytes).is_none()
        && job.config.indirect == Indirect::Traced
        && job.passes != Passes::FinalOnly
        && let Some(passes) = without_preview(job.passes)
    {
        job.passes = passes;
        told = forecast(job, args, console)?;
    }
    let Some(n_threads) = told.threads_within(limit_bytes) else {
        return Err(refusal(held + told.estimate.least_memory_bytes, held, limit_bytes));
    };
    let n_asked = asked_threads(args);
    if n_threads < n_asked {
        let limit = bytes_words(limit_bytes);
        console
            .note(&format!("{n_threads} of {n_asked} threads bake, to stay within the {limit} that --memory allows"));
    }
    Ok(u16::try_from(n_threads).unwrap_or(u16::MAX))
}

/// The passes of a bake that has no room for a preview; `None` if it cannot do without.
fn without_preview(passes: Passes) -> Option<Passes> {
    // What is not done when time is up stays as in the preview.
    (!matches!(passes, Passes::Until(_))).then_some(Passes::FinalOnly)
}

fn no_room_for_preview(needed_bytes: u64, limit_bytes: u64) -> anyhow::Error {
    anyhow!(
        "the preview that --seconds begins with would take about {} of memory, more than the {} that --memory allows; make the picture \
         smaller (--size), allow more, or leave --seconds out",
        bytes_words(needed_bytes),
        bytes_words(limit_bytes),
    )
}

fn refusal(needed_bytes: u64, held_bytes: u64, limit_bytes: u64) -> anyhow::Error {
    anyhow!(
        "the bake would take about {} of memory on a single thread ({} of it for the scene), more than the {} that --memory allows; make the \
         picture smaller (--size), give panels and sky fewer parts (--panel NODE=8, --sky-patches 145), or allow more",
        bytes_words(needed_bytes),
        bytes_words(held_bytes),
        bytes_words(limit_bytes),
    )
}

/// For people and programs.
pub(super) fn told(forecast: &Forecast, config: &BakeConfig, console: &Console) -> Answer {
    let Forecast { estimate, n_threads, held_bytes, .. } = forecast;
    let words = format!(
        "time        about {} on {n_threads} threads, the preview after {}\n\
         memory      about {} at most{}, {} for the result\n\
         file        about {}\n\
         tried       {} of {} blocks{}",
        duration_words(f64::from(estimate.secs)),
        duration_words(f64::from(estimate.preview_secs)),
        bytes_words(forecast.most_bytes()),
        held_bytes.map_or(String::new(), |held| format!(", {} of it for the scene", bytes_words(held))),
        bytes_words(estimate.result_bytes),
        bytes_words(estimate.file_bytes),
        estimate.n_tried,
        estimate.n_blocks,
        reconstruction_words(&json!(config.reconstruction())),
    );
    let peak_bytes = forecast.most_bytes();
    let mut json = json!({
        "threads": n_threads,
        "scene_bytes": held_bytes,
        "peak_bytes": peak_bytes,
        "warnings": console.warnings(),
    });
    merge(&mut json, json!(estimate));
    if let Some(reconstruction) = config.reconstruction() {
        json["reconstruction"] = json!(reconstruction);
    }
    Answer { json, words }
}

/// Bytes as people write them: `800MB`, `1.5GB`, `2GiB`.
pub(super) fn parse_bytes(text: &str) -> Result<u64, String> {
    let problem = || "write a size such as 800MB, 1.5GB or 2GiB".to_string();
    let text = text.trim();
    let split = text.find(|c: char| c.is_ascii_alphabetic()).ok_or_else(problem)?;
    let (number, unit) = (text[..split].trim(), text[split..].to_ascii_lowercase());
    let factor = match unit.as_str() {
        "mb" | "m" => 1e6,
        "gb" | "g" => 1e9,
        "mib" => f64::from(1 << 20),
        "gib" => f64::from(1 << 30),
        _ => return Err(problem()),
    };
    let bytes = number.parse::<f64>().ok().map(|number| number * factor);
    bytes.filter(|bytes| (1e6..1e15).contains(bytes)).map(|bytes| bytes as u64).ok_or_else(problem)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_as_people_write_them() {
        let read = ["800MB", "1.5 GB", "2GiB", "512mib"].map(|text| parse_bytes(text).unwrap());
        assert_eq!(read, [800_000_000, 1_500_000_000, 2 << 30, 512 << 20]);
        for bad in ["", "12", "GB", "-1GB", "1TBx", "nanMB", "0MB"] {
            assert!(parse_bytes(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_bake_within_a_time_keeps_its_end_whatever_memory_there_is() {
        assert_eq!(without_preview(Passes::PreviewAndFinal), Some(Passes::FinalOnly));
        assert_eq!(without_preview(Passes::Until(Instant::now())), None);
        let said = no_room_for_preview(3 << 30, 2 << 30).to_string();
        assert!(said.contains("--seconds") && said.contains("--memory"), "{said}");
    }

    #[test]
    fn a_limit_leaves_as_many_threads_as_fit() {
        let gigabytes = |n: u64| n << 30;
        let estimate = BakeEstimate {
            secs: 1.0,
            preview_secs: 0.1,
            memory_bytes: gigabytes(9),
            least_memory_bytes: gigabytes(2),
            thread_bytes: gigabytes(1),
            ending_bytes: gigabytes(2),
            result_bytes: gigabytes(1),
            file_bytes: 1,
            n_blocks: 1,
            n_tried: 1,
        };
        let forecast = Forecast { estimate, n_threads: 8, held_bytes: Some(gigabytes(1)), peak_bytes: gigabytes(7) };
        let threads = [100, 10, 9, 6, 3, 2].map(|limit| forecast.threads_within(gigabytes(limit)));
        assert_eq!(threads, [Some(8), Some(8), Some(7), Some(4), Some(1), None]);
        // Every block was tried: what that took is what it takes.
        assert_eq!(forecast.most_bytes(), gigabytes(7));
        assert_eq!(Forecast { peak_bytes: 0, ..forecast }.most_bytes(), gigabytes(3));
    }
}
