//! What every section works with: the repository, a folder for files that come and go, and the command line.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use serde::{Serialize, de::DeserializeOwned};
use serde_json::Value;

use super::complain;
use super::kept::Kept;
use super::plot::{Panel, figure};

/// Where a report is made.
pub struct Desk {
    /// Root of the repository.
    pub root: PathBuf,
    /// Small pictures and few samples.
    pub quick: bool,
    /// What is kept between runs.
    pub kept: Kept,
    scratch: PathBuf,
}

impl Desk {
    /// Makes a folder for what comes and goes.
    ///
    /// # Errors
    /// If it cannot be made.
    pub fn new(quick: bool) -> Result<Desk> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize()?;
        let scratch = std::env::temp_dir().join(format!("clerestory-report-{}", std::process::id()));
        std::fs::create_dir_all(&scratch).with_context(|| format!("cannot make the folder {}", scratch.display()))?;
        Ok(Desk { root, quick, kept: Kept::of_user()?, scratch })
    }

    /// One of two: for a quick report or for a full one.
    pub fn choose<T>(&self, quick: T, full: T) -> T {
        if self.quick { quick } else { full }
    }

    /// A file that comes and goes.
    pub fn file(&self, name: &str) -> String {
        self.scratch.join(name).display().to_string()
    }

    /// A file of the shared data, if there is such data.
    pub fn shared(&self, path: &str) -> Option<PathBuf> {
        let found = std::env::var_os("CLERESTORY_SHARED").map(|folder| Path::new(&folder).join(path));
        found.filter(|path| path.exists())
    }

    /// Says on the terminal what is being measured.
    pub fn say(&self, words: &str) {
        complain(&format!("{words} …"));
    }

    /// The command that writes a section, its version, and the threads that it ran on.
    pub fn provenance(&self, section: &str) -> String {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let quick = if self.quick { "--quick " } else { "" };
        format!(
            "*Written by `cargo run --release -p clerestory --bin report -- {quick}{section}`, version {}, on {threads} threads of {}.*",
            env!("CARGO_PKG_VERSION"),
            cpu_name(),
        )
    }

    /// What was measured of a part of a section, if an interrupted run of this program has it, else measured now.
    ///
    /// # Errors
    /// As [`Kept::part`].
    pub fn part<T: Serialize + DeserializeOwned>(
        &self,
        section: &str,
        part: &str,
        measure: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        self.kept.part(&self.parts_of(section), part, measure)
    }

    /// A section was written: the next run measures it again.
    ///
    /// # Errors
    /// As [`Kept::finish`].
    pub fn finish(&self, section: &str) -> Result<()> {
        self.kept.finish(&self.parts_of(section))
    }

    fn parts_of(&self, section: &str) -> String {
        format!("{section}-{}", self.choose("quick", "full"))
    }

    /// Writes a plot beside the page; the line of the page that shows it.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn plot(&self, name: &str, words: &str, panels: &[Panel]) -> Result<String> {
        self.show(&format!("{name}.svg"), words, figure(panels).as_bytes())
    }

    /// Writes a picture beside the page; the line of the page that shows it.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn show(&self, name: &str, words: &str, bytes: &[u8]) -> Result<String> {
        let folder = self.root.join("docs/plots");
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        clerestory::output::write_whole(&folder.join(name), bytes)?;
        Ok(format!("\n![{words}](plots/{name})\n"))
    }
}

impl Drop for Desk {
    fn drop(&mut self) {
        // Best effort: it lies among the temporary files of the system anyway.
        let _ = std::fs::remove_dir_all(&self.scratch);
    }
}

/// Runs the command line in this process and reads the JSON that it prints.
pub fn clerestory(args: &[&str]) -> Result<Value> {
    let (mut out, mut err) = (Vec::new(), Vec::new());
    let args = std::iter::once("clerestory").chain(args.iter().copied()).map(String::from);
    let code = clerestory::cli::run(args, &mut out, &mut err);
    if code != ExitCode::SUCCESS {
        bail!("{}", String::from_utf8_lossy(&err));
    }
    serde_json::from_slice(&out).with_context(|| format!("not JSON: {}", String::from_utf8_lossy(&out)))
}

/// A number of an answer; not a number where it has none.
pub fn number(value: &Value, pointer: &str) -> f64 {
    value.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN)
}

/// Says how busy the machine is with work of others, where the system tells.
pub fn load_words() -> String {
    let told = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load = told.split(' ').next().and_then(|load| load.parse::<f64>().ok());
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    match load {
        Some(load) if load > 0.25 * threads as f64 => {
            format!("Measured under load: {load:.1} other processes wanted the {threads} threads when it began.")
        }
        _ => String::new(),
    }
}

/// What the system calls its processor.
pub fn cpu_name() -> String {
    let told = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = told.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or(std::env::consts::ARCH.into(), |(_, name)| name.trim().into())
}
