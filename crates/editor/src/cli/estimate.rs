//! `clerestory bake --estimate` and `--memory`: what a bake will take, before it is made.

use std::time::Duration;

use anyhow::{Context, Result, bail};
use clerestory_transport::bake::BakeJob;
use clerestory_transport::bake::estimate::BakeEstimate;
use indicatif::ProgressBar;
use serde_json::json;

use super::args::BakeArgs;
use super::console::{Answer, Console, bytes_words, duration_words};
use super::interrupt::nothing_kept;
use super::view::on_threads;
use crate::platform::resident_bytes;

/// How long blocks of a pass are tried.
const BUDGET: Duration = Duration::from_secs(20);

/// Tries some blocks of a bake.
pub(super) fn estimate(job: &BakeJob, args: &BakeArgs, console: &mut Console) -> Result<BakeEstimate> {
    let interrupt = console.interrupt.heeded()?;
    let tried = interrupt.watched(&ProgressBar::hidden(), &nothing_kept, || {
        on_threads(args.options.view.threads, || job.estimate(BUDGET, || !interrupt.came()))
    });
    let estimate = tried?.context("cannot estimate the bake")?;
    estimate.ok_or_else(|| interrupt.stopped(nothing_kept()))
}

/// Refuses a bake that would take more memory than allowed; what the program holds already counts as well.
pub(super) fn keep_within(limit_bytes: u64, estimate: &BakeEstimate) -> Result<()> {
    let held = resident_bytes().unwrap_or(0);
    let needed = held + estimate.memory_bytes;
    if needed <= limit_bytes {
        return Ok(());
    }
    bail!(
        "the bake would take about {} of memory ({} of it for the scene), more than the {} that --memory allows; make the picture smaller \
         (--size), give panels and sky fewer parts (--panel NODE=8, --sky-patches 145), take fewer threads (--threads), or allow more",
        bytes_words(needed as f64),
        bytes_words(held as f64),
        bytes_words(limit_bytes as f64),
    )
}

/// For people and programs.
pub(super) fn told(estimate: &BakeEstimate, args: &BakeArgs, console: &Console) -> Answer {
    let threads = args.options.view.threads.map_or_else(rayon::current_num_threads, usize::from);
    let held = resident_bytes();
    let words = format!(
        "time        about {} on {threads} threads, the preview after {}\n\
         memory      about {} while it bakes{}, {} afterwards\n\
         file        about {}\n\
         tried       {} of {} blocks",
        duration_words(f64::from(estimate.secs)),
        duration_words(f64::from(estimate.preview_secs)),
        bytes_words(estimate.memory_bytes as f64),
        held.map_or(String::new(), |held| format!(" beside {} for the scene", bytes_words(held as f64))),
        bytes_words(estimate.result_bytes as f64),
        bytes_words(estimate.file_bytes as f64),
        estimate.n_tried,
        estimate.n_blocks,
    );
    let mut json = json!({ "threads": threads, "scene_bytes": held, "warnings": console.warnings() });
    super::bake::merge(&mut json, json!(estimate));
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
    fn a_limit_is_kept_or_refused_in_words() {
        let estimate = BakeEstimate {
            secs: 1.0,
            preview_secs: 0.1,
            memory_bytes: 3_000_000_000,
            result_bytes: 1_000_000_000,
            file_bytes: 1,
            n_blocks: 1,
            n_tried: 1,
        };
        keep_within(1 << 40, &estimate).unwrap();
        let said = keep_within(1 << 30, &estimate).unwrap_err().to_string();
        assert!(said.contains("--memory allows") && said.contains("--size"), "{said}");
    }
}
