//! Kills: bakes that are ended without warning at moments spread over their whole run, and taken up again.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use clerestory_transport::archive::{PartState, part_of, part_state};

use super::desk::{Desk, program};

/// Scene of the repository, and how it is baked: some seconds on two threads, 48 blocks.
const SCENE: &str = "crates/editor/tests/room.gltf";
const OPTIONS: [&str; 6] = ["--size", "128x96", "--spp", "128", "--threads", "2"];
/// Blocks under way at any moment: one a thread.
const THREADS: usize = 2;
const SEED: u64 = 1;
/// How often the file of a running bake is looked at.
const POLL: Duration = Duration::from_millis(1);

/// What became of a killed bake.
struct Kill {
    /// When, from its start, seconds.
    at_secs: f64,
    /// What was found afterwards; `None` if the bake had not begun to write, or had ended.
    found: Option<PartState>,
    ended: bool,
    /// Bytes that were seen in the file before the kill and not found after it.
    lost_bytes: u64,
    /// What finishing took, seconds.
    resume_secs: f64,
    same_bytes: bool,
}

/// Kills bakes and tells what was lost.
///
/// # Errors
/// If a bake cannot be run, or cannot be finished after a kill.
pub fn write(desk: &Desk) -> Result<String> {
    let bench = Bench::new(desk)?;
    let (reference, first_secs) = bench.finish("uninterrupted")?;
    // The shorter of two, so that the last kills meet bakes that are under way.
    let run_secs = first_secs.min(bench.finish("uninterrupted-again")?.1);
    let n_kills = desk.choose(5, 50);
    let mut kills: Vec<Kill> = Vec::new();
    let (mut n_late, mut longest) = (0, run_secs);
    while kills.len() < n_kills {
        // One moment in each n-th of the run; a draw that meets a bake which has ended is not a kill and is drawn again.
        let nth = kills.len();
        let share = (nth as f64 + uniform(SEED, nth + n_late * n_kills)) / n_kills as f64;
        desk.say(&format!("kill {} of {n_kills}, at {:.0} % of the run", nth + 1, 100.0 * share));
        let kill = bench.kill(&format!("killed-{nth}"), share * longest, &reference)?;
        if kill.ended {
            // That bake was shorter, so all later moments are.
            longest = longest.min(kill.at_secs);
            n_late += 1;
            ensure!(n_late < 4 * n_kills, "the bakes end before they can be killed");
        } else {
            kills.push(kill);
        }
    }
    words(desk, &kills, n_late, run_secs)
}

fn words(desk: &Desk, kills: &[Kill], n_late: usize, run_secs: f64) -> Result<String> {
    let found = || kills.iter().filter_map(|kill| kill.found.as_ref());
    let n_blocks = found().map(|state| state.n_blocks).max().unwrap_or(0);
    let kept = found().map(|state| state.n_done);
    let (least, most) = (kept.clone().min().unwrap_or(0), kept.max().unwrap_or(0));
    let n_torn = found().filter(|state| state.n_torn_bytes > 0).count();
    let count = |what: fn(&Kill) -> bool| kills.iter().filter(|kill| what(kill)).count();
    let wasted = kills.iter().map(|kill| kill.at_secs + kill.resume_secs - run_secs);
    let rows = [
        ("kills (SIGKILL, one in each part of the run, moments drawn from a seed)", kills.len().to_string()),
        ("of them before anything was kept", count(|kill| kill.found.is_none()).to_string()),
        ("further draws that met a bake which had ended, and were drawn again", n_late.to_string()),
        ("finished bakes that equal the uninterrupted one byte for byte", count(|kill| kill.same_bytes).to_string()),
        ("blocks of the bake", n_blocks.to_string()),
        ("blocks that were kept, least and most", format!("{least}, {most}")),
        ("kills after which something was gone that had been kept", count(|kill| kill.lost_bytes > 0).to_string()),
        ("kills that left a block half written", n_torn.to_string()),
        (
            "blocks under way, the most that a kill can cost (one a thread; by design, not measured)",
            THREADS.to_string(),
        ),
        ("time lost at most", format!("{:.1} s of {run_secs:.1} s", wasted.fold(0.0, f64::max))),
    ];
    let rows: String = rows.iter().map(|(what, figure)| format!("| {what} | {figure} |\n")).collect();
    Ok(format!(
        "## Kills\n\n\
         `{SCENE}` baked with `{}`, seed {SEED}. Each killed bake is finished by the same command. Time lost is what kill and\n\
         finish took together beyond an uninterrupted run; a finish reads the scene again and has no preview.\n\n\
         {}\n\n| | |\n|---|---|\n{rows}",
        OPTIONS.join(" "),
        desk.provenance("reliability")?,
    ))
}

/// Where bakes are killed.
struct Bench<'a> {
    desk: &'a Desk,
    binary: PathBuf,
}

impl Bench<'_> {
    fn new(desk: &Desk) -> Result<Bench<'_>> {
        Ok(Bench { desk, binary: program()? })
    }

    fn output(&self, name: &str) -> PathBuf {
        self.desk.file(&format!("{name}.transport")).into()
    }

    fn start(&self, name: &str) -> Result<Child> {
        let mut command = Command::new(&self.binary);
        command.arg("bake").arg(self.desk.root.join(SCENE)).arg("-o").arg(self.output(name)).args(OPTIONS);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().with_context(|| format!("cannot start {}", self.binary.display()))
    }

    /// Runs to the end: the bytes, and how long it took.
    fn finish(&self, name: &str) -> Result<(Vec<u8>, f64)> {
        let begun = Instant::now();
        let status = self.start(name)?.wait()?;
        let secs = begun.elapsed().as_secs_f64();
        if !status.success() {
            bail!("the bake {name} ended with {status}");
        }
        let output = self.output(name);
        ensure!(!part_of(&output).exists(), "{} stays behind", part_of(&output).display());
        Ok((std::fs::read(output)?, secs))
    }

    fn kill(&self, name: &str, at_secs: f64, reference: &[u8]) -> Result<Kill> {
        let part = part_of(&self.output(name));
        let begun = Instant::now();
        let mut child = self.start(name)?;
        let mut seen = 0;
        while begun.elapsed().as_secs_f64() < at_secs {
            seen = length(&part).max(seen);
            std::thread::sleep(POLL);
        }
        let at_secs = begun.elapsed().as_secs_f64();
        child.kill()?;
        child.wait()?;
        let ended = self.output(name).exists();
        let lost_bytes = if ended { 0 } else { seen.saturating_sub(length(&part)) };
        let found = if ended { None } else { part_state(&part).ok() };
        // The same command on a finished bake would bake again.
        let (bytes, resume_secs) = if ended { (std::fs::read(self.output(name))?, 0.0) } else { self.finish(name)? };
        let same_bytes = bytes == reference;
        std::fs::remove_file(self.output(name))?;
        Ok(Kill { at_secs, found, ended, lost_bytes, resume_secs, same_bytes })
    }
}

fn length(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |found| found.len())
}

/// A number in 0…1 from a seed and a count. \[Steele2014\]
fn uniform(seed: u64, nth: usize) -> f64 {
    let mut bits = seed.wrapping_add((nth as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((bits ^ (bits >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kills_are_counted_where_something_was_lost() {
        let folder = tempfile::tempdir().unwrap();
        let desk = Desk::new(true, Some(folder.path())).unwrap();
        let kill = |lost_bytes: u64| Kill {
            at_secs: 1.0,
            found: None,
            ended: false,
            lost_bytes,
            resume_secs: 2.0,
            same_bytes: true,
        };
        let told = words(&desk, &[kill(0), kill(4096), kill(8192)], 0, 2.0).unwrap();
        assert!(told.contains("| kills after which something was gone that had been kept | 2 |"), "{told}");
        assert!(told.contains("| kills that left a block half written | 0 |"), "{told}");
    }
}
