//! What every section works with: the repository, a folder for files that come and go, and the command line.

use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use clerestory::platform::memory_bytes;
use serde::{Serialize, de::DeserializeOwned};
use serde_json::Value;

use super::built::commit;
use super::complain;
use super::kept::{Kept, Numbers};
use super::plot::{Panel, figure};
use super::yardstick;

/// Where a report is made.
pub struct Desk {
    /// Root of the repository.
    pub root: PathBuf,
    /// Where pages are written, with their plots: the repository's `docs` unless another folder is named.
    pub pages: PathBuf,
    /// Small pictures and few samples.
    pub quick: bool,
    /// The folder of the shared data, if one is named.
    shared: Option<PathBuf>,
    /// What is kept between runs.
    kept: Kept,
    /// A hash of the files that sections read and of the program that they call.
    inputs: String,
    scratch: PathBuf,
    /// When the section began that is measured now.
    begun_at: Mutex<Instant>,
    /// What had been computed then.
    begun: Mutex<Option<Computed>>,
    /// Milliseconds of the yardstick before the section that is measured now.
    yardstick_before: Mutex<f64>,
    /// The commit in words, as it was when the report began, and whether the program is built from it.
    commit: String,
    /// Seconds that parts of the section took that lay there from a run that was interrupted.
    earlier_secs: Mutex<f64>,
    /// What the section was held against.
    references: Mutex<References>,
}

/// By key, the seconds that earlier sections or runs took to make numbers: none where the section made them, and unknown where nobody
/// noted them.
type References = BTreeMap<String, Option<f64>>;

/// A section that takes longer says so.
const LONG_SECS: f64 = 1800.0;

impl Desk {
    /// Makes a folder for what comes and goes.
    ///
    /// # Errors
    /// If it cannot be made.
    pub fn new(quick: bool, pages: Option<&Path>) -> Result<Desk> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize()?;
        let scratch = std::env::temp_dir().join(format!("clerestory-report-{}", std::process::id()));
        std::fs::create_dir_all(&scratch).with_context(|| format!("cannot make the folder {}", scratch.display()))?;
        let pages = pages.map_or_else(|| root.join("docs"), Path::to_path_buf);
        std::fs::create_dir_all(&pages).with_context(|| format!("cannot make the folder {}", pages.display()))?;
        let shared = std::env::var_os("CLERESTORY_SHARED").map(PathBuf::from);
        Ok(Desk {
            inputs: hash_of_files(inputs(&root, shared.as_deref()))?,
            commit: commit(&root).unwrap_or_default(),
            earlier_secs: Mutex::new(0.0),
            references: Mutex::default(),
            root,
            pages,
            quick,
            shared,
            kept: Kept::of_user()?,
            scratch,
            begun_at: Mutex::new(Instant::now()),
            begun: Mutex::new(Computed::now()),
            yardstick_before: Mutex::new(f64::NAN),
        })
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
        self.shared.as_ref().map(|folder| folder.join(path)).filter(|path| path.exists())
    }

    /// The same where there is no such data.
    #[cfg(test)]
    pub fn without_shared(mut self) -> Desk {
        self.shared = None;
        self
    }

    /// Says on the terminal what is being measured.
    pub fn say(&self, words: &str) {
        complain(&format!("{words} …"));
    }

    /// The command that writes a section, its version, commit and compiler, the machine that it ran on, how long it took, how long
    /// what it is held against had taken before, and how fast the machine was.
    ///
    /// # Errors
    /// As [`yardstick::millis`].
    pub fn provenance(&self, section: &str) -> Result<String> {
        let secs = secs_words(self.secs(), *held(&self.earlier_secs));
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let quick = if self.quick { "--quick " } else { "" };
        Ok(format!(
            "*Written by `cargo run --release -p clerestory --bin report -- {quick}{section}`, version {}{}, built by {}, on {threads} threads of {} ({}){}, in {secs}{}; {}.*",
            env!("CARGO_PKG_VERSION"),
            self.commit,
            env!("CLERESTORY_RUSTC"),
            cpu_name(),
            std::env::consts::OS,
            memory_words(memory_bytes()),
            references_words(&held(&self.references)),
            yardstick::words(*held(&self.yardstick_before), yardstick::millis()?),
        ))
    }

    /// Seconds that the section took, in this run and, as far as its parts were kept, before an interruption.
    pub fn secs(&self) -> f64 {
        let now = held(&self.begun_at).elapsed().as_secs_f64();
        now + *held(&self.earlier_secs)
    }

    /// Those of its parts that were kept from a run that was interrupted.
    pub fn earlier_secs(&self) -> f64 {
        *held(&self.earlier_secs)
    }

    /// A section begins: what others compute is counted from here on.
    ///
    /// # Errors
    /// As [`yardstick::millis`].
    pub fn begin(&self) -> Result<()> {
        *held(&self.yardstick_before) = yardstick::millis()?;
        *held(&self.earlier_secs) = 0.0;
        held(&self.references).clear();
        *held(&self.begun_at) = Instant::now();
        *held(&self.begun) = Computed::now();
        Ok(())
    }

    /// Says how busy others kept the machine since the section began, where the system tells; nothing where they hardly did.
    pub fn load_words(&self) -> String {
        let taken = self
            .begun
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .zip(Computed::now())
            .and_then(|(before, now)| now.others_since(&before));
        match taken {
            Some((taken, all)) if taken > 0.1 * all => {
                format!("Measured under load: other work took {taken:.1} of {all:.0} processors meanwhile.")
            }
            _ => String::new(),
        }
    }

    /// What was measured of a part of a section, if an interrupted run of this program on this machine has it, with the same files, else
    /// measured now.
    ///
    /// # Errors
    /// As [`Kept::part`].
    pub fn part<T: Serialize + DeserializeOwned>(
        &self,
        section: &str,
        part: &str,
        measure: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        let measure = || {
            let before = std::mem::take(&mut *held(&self.references));
            let value = measure();
            // Which references a part has is written down with it: an interrupted run has none of them when it goes on.
            let own = std::mem::replace(&mut *held(&self.references), before);
            Ok::<_, anyhow::Error>((value?, own))
        };
        let ((value, own), earlier_secs): ((T, References), _) =
            self.kept.part(&self.parts_of(section), part, measure)?;
        *held(&self.earlier_secs) += earlier_secs.unwrap_or(0.0);
        own.into_iter().for_each(|(key, secs)| self.note(key, secs));
        Ok(value)
    }

    /// Numbers that a key names in full, made once for all sections and runs.
    ///
    /// # Errors
    /// As [`Kept::numbers`].
    pub fn numbers(&self, key: &str, make: impl FnOnce() -> Result<Vec<f32>>) -> Result<Vec<f32>> {
        Ok(self.noted(key, self.kept.numbers(key, make)?))
    }

    /// The same, made piece by piece.
    ///
    /// # Errors
    /// As [`Kept::in_pieces`].
    pub fn in_pieces(
        &self,
        key: &str,
        n_pieces: usize,
        make: impl Fn(usize) -> Result<Vec<f32>>,
        join: impl FnOnce(&[Vec<f32>]) -> Vec<f32>,
    ) -> Result<Vec<f32>> {
        Ok(self.noted(key, self.kept.in_pieces(key, n_pieces, make, join)?))
    }

    fn noted(&self, key: &str, Numbers { values, earlier_secs, .. }: Numbers) -> Vec<f32> {
        self.note(key.into(), earlier_secs);
        values
    }

    /// What a section made itself and reads again later stays its own.
    fn note(&self, key: String, earlier_secs: Option<f64>) {
        held(&self.references).entry(key).or_insert(earlier_secs);
    }

    /// A section was written: the next run measures it again.
    ///
    /// # Errors
    /// As [`Kept::finish`].
    pub fn finish(&self, section: &str) -> Result<()> {
        self.kept.finish(&self.parts_of(section))
    }

    fn parts_of(&self, section: &str) -> String {
        format!("{section}-{}-{}", self.choose("quick", "full"), self.inputs)
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
        let folder = self.pages.join("plots");
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

/// What sections read and call beside this program, as far as it is there.
fn inputs(root: &Path, shared: Option<&Path>) -> Vec<PathBuf> {
    let of_shared = ["scenes", "references", "env", "matrices"];
    let shared = shared.into_iter().flat_map(|folder| of_shared.map(|name| folder.join(name)));
    let own = ["assets", "scripts/peers.py"].map(|path| root.join(path));
    own.into_iter().chain(shared).chain(program()).filter(|path| path.exists()).collect()
}

/// A hash of the names, lengths and times of files, and of all that lie in folders.
///
/// # Errors
/// If a folder cannot be listed.
fn hash_of_files(mut left: Vec<PathBuf>) -> Result<String> {
    let mut files = Vec::new();
    while let Some(path) = left.pop() {
        if path.is_dir() {
            let within = std::fs::read_dir(&path).with_context(|| format!("cannot list {}", path.display()))?;
            left.extend(within.map(|entry| Ok(entry?.path())).collect::<std::io::Result<Vec<PathBuf>>>()?);
        } else if let Ok(found) = std::fs::metadata(&path) {
            // A link that leads nowhere is read by nobody.
            files.push((path, found.len(), found.modified()?));
        }
    }
    files.sort();
    let mut hasher = DefaultHasher::new();
    files.hash(&mut hasher);
    Ok(format!("{:016x}", hasher.finish()))
}

/// The program that users call, which is built beside this one.
///
/// # Errors
/// If it is not there.
pub fn program() -> Result<PathBuf> {
    let program = std::env::current_exe()?.with_file_name(format!("clerestory{}", std::env::consts::EXE_SUFFIX));
    ensure!(program.exists(), "{} is missing: build it with `cargo build --release`", program.display());
    Ok(program)
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

/// What a machine and this program on it had computed at one moment.
#[derive(Clone, Copy)]
struct Computed {
    at: Instant,
    /// CPU seconds of all processors, since the machine began.
    machine: f64,
    /// CPU seconds of this program and of those that it started and waited for.
    own: f64,
    n_processors: usize,
}

impl Computed {
    /// Nothing where the system does not tell.
    fn now() -> Option<Self> {
        let told = std::fs::read_to_string("/proc/stat").ok()?;
        let own = std::fs::read_to_string("/proc/self/stat").ok()?;
        Self::of(&told, &own)
    }

    /// From what Linux tells of the machine and of one process, in hundredths of a second.
    fn of(machine: &str, own: &str) -> Option<Self> {
        let words = machine.lines().next()?.strip_prefix("cpu ")?.split_whitespace();
        let all: Vec<f64> = words.map_while(|word| word.parse().ok()).collect();
        // User, nice, system; then idle and waiting; then both kinds of interrupts, and what the host took away.
        let busy = all.get(..3)?.iter().chain(all.get(5..8)?).sum::<f64>();
        let own = process_secs(own)?.iter().sum::<f64>();
        let n_processors = machine.lines().skip(1).take_while(|line| line.starts_with("cpu")).count();
        Some(Self { at: Instant::now(), machine: 0.01 * busy, own, n_processors })
    }

    /// Processors that others took since then, and how many there are.
    fn others_since(&self, before: &Self) -> Option<(f64, f64)> {
        let secs = (self.at - before.at).as_secs_f64();
        let taken = (self.machine - before.machine) - (self.own - before.own);
        (secs > 0.0).then(|| (taken / secs, self.n_processors as f64))
    }
}

/// CPU seconds of a process and of its children that ended, from what Linux tells of it.
pub fn process_secs(told: &str) -> Option<[f64; 2]> {
    // Behind the name, which may hold anything: the state, ten numbers, and user and system time of both, in hundredths of a second.
    let mut words = told.rsplit_once(')')?.1.split_whitespace().skip(11);
    let mut secs = || Some(0.01 * (words.next()?.parse::<f64>().ok()? + words.next()?.parse::<f64>().ok()?));
    Some([secs()?, secs()?])
}

/// What a lock holds: the report ends with whatever fails in it.
fn held<T>(lock: &Mutex<T>) -> MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Seconds in words, and how many of them were before an interruption.
fn secs_words(secs: f64, earlier: f64) -> String {
    let long = if secs > LONG_SECS { ", which is more than half an hour" } else { "" };
    if earlier > 0.0 {
        format!("{secs:.0} s{long}, {earlier:.0} of them before an interruption")
    } else {
        format!("{secs:.0} s{long}")
    }
}

/// How long it took to make what lay there already; nothing where the section made all itself.
fn references_words(references: &References) -> String {
    let secs: f64 = references.values().flatten().sum();
    match (secs > 0.0, references.values().any(Option::is_none)) {
        (false, false) => String::new(),
        (true, false) => format!("; references: {secs:.0} s, made earlier"),
        (false, true) => "; references: made earlier, seconds not noted".into(),
        (true, true) => format!("; references: {secs:.0} s and some whose seconds are not noted, made earlier"),
    }
}

/// The memory of the machine in words; nothing where the system does not tell.
fn memory_words(bytes: Option<u64>) -> String {
    let words = |bytes: u64| format!(" with {:.1} GiB of memory", bytes as f64 / f64::from(1 << 30));
    bytes.map_or_else(String::new, words)
}

/// What the system calls its processor.
pub fn cpu_name() -> String {
    let told = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = told.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or(std::env::consts::ARCH.into(), |(_, name)| name.trim().into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_told_where_the_system_tells_it_and_the_compiler_always() {
        assert_eq!(memory_words(Some(3 << 29)), " with 1.5 GiB of memory");
        assert_eq!(memory_words(None), "");
        assert!(env!("CLERESTORY_RUSTC").starts_with("rustc "), "{}", env!("CLERESTORY_RUSTC"));
    }

    #[test]
    fn seconds_are_those_of_all_stretches() {
        assert_eq!(secs_words(452.4, 0.0), "452 s");
        assert_eq!(secs_words(900.0, 448.0), "900 s, 448 of them before an interruption");
        assert_eq!(secs_words(1800.0, 0.0), "1800 s");
        assert_eq!(secs_words(2400.4, 0.0), "2400 s, which is more than half an hour");
    }

    #[test]
    fn references_that_lay_there_tell_their_seconds_or_that_nobody_noted_them() {
        let words = |secs: &[Option<f64>]| {
            let keyed = secs.iter().enumerate().map(|(nth, secs)| (nth.to_string(), *secs));
            references_words(&keyed.collect())
        };
        assert_eq!(words(&[Some(0.0)]), "", "all of it was made now");
        assert_eq!(words(&[Some(300.2), Some(40.0)]), "; references: 340 s, made earlier");
        assert_eq!(words(&[None]), "; references: made earlier, seconds not noted");
        assert!(words(&[Some(340.0), None]).contains("340 s and some whose seconds are not noted"));
    }

    #[test]
    fn a_section_tells_what_it_did_not_make_itself_also_where_it_goes_on() {
        let folder = std::env::temp_dir().join(format!("clerestory-desk-{}", std::process::id()));
        let desk = || {
            let mut desk = Desk::new(true, Some(&folder)).unwrap();
            desk.kept = Kept::within(folder.join("kept"));
            desk
        };
        let slow = || {
            std::thread::sleep(std::time::Duration::from_millis(20));
            Ok(vec![1.0])
        };
        let first = desk();
        let part = || first.part("time", "hall", || Ok(first.numbers("hall", slow)?.len()));
        assert_eq!(part().unwrap(), 1);
        first.numbers("hall", || panic!("it is there")).unwrap();
        assert_eq!(held(&first.references).clone(), References::from([("hall".into(), Some(0.0))]), "it is its own");
        let again = desk();
        again.part::<usize>("time", "hall", || panic!("it is measured")).unwrap();
        assert!(again.provenance("time").unwrap().contains(" of them before an interruption"), "it says so");
        assert_eq!(held(&again.references).clone(), References::from([("hall".into(), Some(0.0))]), "it went on");
        again.begin().unwrap();
        again.numbers("hall", || panic!("it is there")).unwrap();
        assert!(held(&again.references)["hall"].is_some_and(|secs| secs >= 0.02), "another section");
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn parts_that_were_measured_of_other_files_are_none_of_a_section() {
        let folder = tempfile::tempdir().unwrap();
        let scenes = folder.path().join("scenes");
        std::fs::create_dir_all(&scenes).unwrap();
        let hash_with = |words: &str| {
            std::fs::write(scenes.join("hall.glb"), words).unwrap();
            hash_of_files(vec![folder.path().to_path_buf()]).unwrap()
        };
        let (hall, other) = (hash_with("a hall"), hash_with("another hall"));
        assert_ne!(hall, other);
        assert_eq!(other, hash_of_files(vec![folder.path().to_path_buf()]).unwrap());
        let mut desk = Desk::new(true, Some(folder.path())).unwrap();
        let parts = [hall, other].map(|inputs| {
            desk.inputs = inputs;
            desk.parts_of("time")
        });
        assert_ne!(parts[0], parts[1]);
    }

    #[test]
    fn work_of_others_is_that_of_the_machine_without_ours() {
        let machine = |busy: u32| format!("cpu  {busy} 10 20 9000 300 1 2 7 0 0\ncpu0 1 2 3\ncpu1 1 2 3\nintr 5\n");
        let own = |user: u32| format!("71 (a (strange) name) R 1 2 3 4 5 6 7 8 9 10 {user} 5 40 0 20 0 2\n");
        let before = Computed::of(&machine(1000), &own(100)).unwrap();
        assert!(
            (before.machine - 10.4).abs() < 1e-9 && (before.own - 1.45).abs() < 1e-9,
            "{} {}",
            before.machine,
            before.own
        );
        let mut after = Computed::of(&machine(1500), &own(400)).unwrap();
        after.at = before.at + std::time::Duration::from_secs(4);
        let (taken, all) = after.others_since(&before).unwrap();
        assert!((taken - 0.5).abs() < 1e-9 && all == 2.0, "{taken} of {all}");
        assert!(Computed::of("no such system", &own(1)).is_none());
    }
}
