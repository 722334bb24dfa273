//! Finished bakes in the user's cache folder, found again by what they are of.
//!
//! A bake lies there as `GROUNDS-KEY-PROGRAM.transport`: surfaces, view and settings alone, then those with the lights, then the
//! program that baked. Bakes of the same grounds have columns in common. What was used longest ago goes first when the folder
//! grows over its limit.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::{Context, Result};
use clerestory_transport::archive::{self, ArchiveError, UnderWay, beside};
use clerestory_transport::bake::{Bake, BakeJob, HalfDone};

/// Bytes that the folder may hold if nobody says otherwise.
pub const DEFAULT_LIMIT_BYTES: u64 = 4 << 30;
/// Environment variable with another folder.
pub const FOLDER_VARIABLE: &str = "CLERESTORY_CACHE";
/// Environment variable with another limit in megabytes; 0 keeps nothing.
pub const LIMIT_VARIABLE: &str = "CLERESTORY_CACHE_MB";

const ENDING: &str = "transport";
/// Ending of a bake that is under way, or was when its editor ended.
const PART: &str = "part";
/// Bakes that are read to find one whose columns can be taken over.
const MOST_RELATIVES: usize = 2;
/// Ending of an entry that could not be read.
const DAMAGED: &str = "damaged";
/// Hexadecimal digits of the grounds of a bake in its name.
const GROUNDS_DIGITS: usize = 16;
/// Hexadecimal digits of its key there.
const KEY_DIGITS: usize = 32;

/// A folder of finished bakes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BakeCache {
    folder: PathBuf,
    limit_bytes: u64,
}

/// What a key leads to.
#[derive(Debug)]
pub enum Found {
    /// The bake.
    Hit(Box<Bake>),
    /// None.
    Nothing,
    /// One that was damaged and is now out of the way, or that cannot be read now; why, in words.
    SetAside(String),
}

/// What lies in a cache.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Usage {
    /// Number of bakes.
    pub bakes: usize,
    /// Bytes of all of it, damaged entries included.
    pub bytes: u64,
}

impl BakeCache {
    /// A cache in `folder`, which is made when the first bake comes.
    pub fn new(folder: PathBuf, limit_bytes: u64) -> BakeCache {
        BakeCache { folder, limit_bytes }
    }

    /// The cache of the user who runs the program; `None` where the system has no place for one.
    ///
    /// # Errors
    /// If a limit was set that is no number.
    pub fn of_user() -> Result<Option<BakeCache>> {
        let of_variable = |name| std::env::var_os(name).filter(|value| !value.is_empty());
        let folder = of_variable(FOLDER_VARIABLE)
            .map(PathBuf::from)
            .or_else(|| Some(dirs::cache_dir()?.join("clerestory").join("bakes")));
        let limit_bytes = match of_variable(LIMIT_VARIABLE) {
            None => DEFAULT_LIMIT_BYTES,
            Some(text) => megabytes(&text.to_string_lossy())?,
        };
        Ok(folder.map(|folder| BakeCache { folder, limit_bytes }))
    }

    /// Where it is.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Bytes that it may hold.
    pub fn limit_bytes(&self) -> u64 {
        self.limit_bytes
    }

    /// Where the bake of a job by this very program is kept: this reads the whole scene.
    pub fn place(&self, job: &BakeJob) -> Place {
        Place(self.folder.join(format!("{}-{}-{}.{ENDING}", job.grounds().common(), job.key(), program())))
    }

    /// The bakes that have columns in common with that of a place, those used last first, as many as are worth reading.
    pub fn relatives(&self, Place(path): &Place) -> Vec<Found> {
        let name = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        // The key between grounds and program has no such sign.
        let ends = |name: &str| name.split_once('-').map(|(grounds, rest)| (grounds.to_owned(), after_key(rest)));
        let wanted = ends(&name(path));
        let mut entries = self.entries().unwrap_or_default();
        entries.retain(|entry| entry.path != *path && ends(&name(&entry.path)) == wanted);
        entries.sort_by_key(|entry| std::cmp::Reverse(entry.used_at));
        entries.truncate(MOST_RELATIVES);
        entries.into_iter().map(|entry| self.find(&Place(entry.path))).collect()
    }

    /// Whether the bake of a place was kept; it may be damaged.
    pub fn holds(&self, Place(path): &Place) -> bool {
        path.exists()
    }

    /// The bake of a place, if it was kept; then it counts as used now.
    pub fn find(&self, Place(path): &Place) -> Found {
        if !path.exists() {
            return Found::Nothing;
        }
        match archive::read(path) {
            Ok(bake) => {
                // A folder that cannot be written still serves.
                let _ = File::options().write(true).open(path).and_then(|file| file.set_modified(SystemTime::now()));
                Found::Hit(Box::new(bake))
            }
            // Another editor let go of it meanwhile.
            Err(_) if !path.exists() => Found::Nothing,
            // It may be whole: the system cannot read it now.
            Err(error @ ArchiveError::Read { .. }) => {
                Found::SetAside(format!("a kept bake could not be read, and stays for another time: {error}"))
            }
            Err(error) => {
                let _ = fs::rename(path, path.with_extension(DAMAGED));
                Found::SetAside(format!("a kept bake could not be used and was set aside: {error}"))
            }
        }
    }

    /// A file for the blocks of a bake as they come, and those that an editor left there that ended before its bake did. None
    /// where nothing is kept.
    ///
    /// # Errors
    /// If the folder cannot be made or written, or another editor makes the same bake.
    pub fn under_way(&self, Place(path): &Place) -> Result<Option<(UnderWay, Option<HalfDone>)>> {
        if self.limit_bytes == 0 {
            return Ok(None);
        }
        let problem = || format!("the bake is not kept while it runs: cannot write to {}", self.folder.display());
        fs::create_dir_all(&self.folder).with_context(problem)?;
        UnderWay::beside(path).map(Some).with_context(problem)
    }

    /// Keeps a finished bake, and lets go of the oldest ones where that is over the limit. Returns whether it was kept: one
    /// that is larger than the limit is not.
    ///
    /// # Errors
    /// If the folder cannot be made or written.
    pub fn keep(&self, Place(path): &Place, bake: &Bake) -> Result<bool> {
        if self.limit_bytes == 0 {
            return Ok(false);
        }
        let problem = || format!("the bake is not kept for the next time: cannot write to {}", self.folder.display());
        fs::create_dir_all(&self.folder).with_context(problem)?;
        archive::write(bake, path).with_context(problem)?;
        // Older ones make way for it, but not for one that cannot stay.
        if fs::metadata(path).is_ok_and(|of| of.len() > self.limit_bytes) {
            remove(path).with_context(problem)?;
        }
        self.shrink().with_context(problem)?;
        Ok(path.exists())
    }

    /// What is in it.
    ///
    /// # Errors
    /// If the folder cannot be read; one that is not there is empty.
    pub fn usage(&self) -> Result<Usage> {
        let entries = self.entries()?;
        let bakes = entries.iter().filter(|entry| entry.path.extension().is_some_and(|e| e == ENDING)).count();
        Ok(Usage { bakes, bytes: entries.iter().map(|entry| entry.bytes).sum() })
    }

    /// Lets go of everything; returns what that was.
    ///
    /// # Errors
    /// If something cannot be removed.
    pub fn clear(&self) -> Result<Usage> {
        let usage = self.usage()?;
        for entry in self.entries()? {
            remove(&entry.path)?;
        }
        Ok(usage)
    }

    /// Removes what was used longest ago until the rest is within the limit.
    fn shrink(&self) -> Result<()> {
        let mut entries = self.entries()?;
        entries.sort_by_key(|entry| entry.used_at);
        let mut bytes: u64 = entries.iter().map(|entry| entry.bytes).sum();
        for entry in entries {
            if bytes <= self.limit_bytes {
                break;
            }
            remove(&entry.path)?;
            bytes -= entry.bytes;
        }
        Ok(())
    }

    fn entries(&self) -> Result<Vec<Entry>> {
        let listed = match fs::read_dir(&self.folder) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
            listed => listed.with_context(|| format!("cannot read the folder {}", self.folder.display()))?,
        };
        let mut entries = Vec::new();
        for file in listed.flatten() {
            let path = file.path();
            // A file that another editor removes in between is no entry.
            if let (true, Ok(of)) = (is_ours(&path), file.metadata()) {
                let used_at = of.modified().unwrap_or(SystemTime::UNIX_EPOCH);
                entries.push(Entry { path, bytes: of.len(), used_at });
            }
        }
        Ok(entries)
    }
}

/// Where a bake is kept, by what it is of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place(PathBuf);

struct Entry {
    path: PathBuf,
    bytes: u64,
    used_at: SystemTime,
}

/// Whether a file is a bake that a cache keeps, one that is under way or was set aside, or what is left of writing one. Whatever else
/// lies in the folder is its user's.
fn is_ours(path: &Path) -> bool {
    let Some(name) = path.file_name().and_then(OsStr::to_str) else { return false };
    if let Some(name) = name.strip_prefix('.') {
        return is_of_bake(name) && beside::is_left_over(path);
    }
    is_of_bake(name) && path.extension().is_some_and(|ending| ending == ENDING || ending == DAMAGED || ending == PART)
}

/// Whether a name begins with grounds and key and goes on with a program, as [`BakeCache::place`] puts them.
fn is_of_bake(name: &str) -> bool {
    let is_hash = |part: &str, digits: usize| part.len() == digits && part.bytes().all(|b| b.is_ascii_hexdigit());
    match *name.splitn(3, '-').collect::<Vec<_>>() {
        [grounds, key, _program] => is_hash(grounds, GROUNDS_DIGITS) && is_hash(key, KEY_DIGITS),
        _ => false,
    }
}

/// What stands behind the key in the name of a bake: the program and the ending.
fn after_key(rest: &str) -> String {
    rest.split_once('-').map_or_else(String::new, |(_, program)| program.to_owned())
}

fn remove(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("cannot remove {}", path.display()))
        }
        _ => Ok(()),
    }
}

fn megabytes(text: &str) -> Result<u64> {
    let megabytes: Option<u64> = text.trim().parse().ok();
    let bytes = megabytes.and_then(|megabytes| megabytes.checked_mul(1 << 20));
    bytes.with_context(|| format!("{LIMIT_VARIABLE} is `{text}`; write a number of megabytes"))
}

/// Tells this build of the program from others: another one may bake otherwise.
fn program() -> String {
    let build = std::env::current_exe().and_then(fs::metadata).ok().and_then(|of| {
        let changed = of.modified().ok()?.duration_since(SystemTime::UNIX_EPOCH).ok()?;
        Some(format!("{:x}-{:x}", of.len(), changed.as_nanos()))
    });
    format!("{}-{}", env!("CARGO_PKG_VERSION"), build.unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;
    use std::sync::Arc;
    use std::time::Duration;

    use clerestory_transport::bake::BakeConfig;
    use clerestory_transport::camera::Film;
    use clerestory_transport::prepared::PreparedScene;

    use super::*;
    use crate::support::room_job;

    fn job(seed: u64) -> BakeJob {
        let config = BakeConfig { spp: 2, tolerance_db: 20.0, seed, ..BakeConfig::default() };
        room_job(Film { width: 32, height: 24 }, config)
    }

    fn baked(job: &BakeJob) -> Bake {
        job.clone().run(|_| ControlFlow::Continue(())).unwrap().unwrap()
    }

    fn is_hit(found: &Found) -> bool {
        matches!(found, Found::Hit(_))
    }

    #[test]
    fn a_bake_is_found_again_by_what_it_is_of() {
        let folder = tempfile::tempdir().unwrap();
        let cache = BakeCache::new(folder.path().join("deep/bakes"), 1 << 20);
        assert!(matches!(cache.find(&cache.place(&job(1))), Found::Nothing));
        assert_eq!(cache.usage().unwrap(), Usage { bakes: 0, bytes: 0 });
        let bake = baked(&job(1));
        assert!(cache.keep(&cache.place(&job(1)), &bake).unwrap());
        match cache.find(&cache.place(&job(1))) {
            Found::Hit(found) => assert_eq!(found.header, bake.header),
            other => panic!("{other:?}"),
        }
        assert!(matches!(cache.find(&cache.place(&job(2))), Found::Nothing));
        assert_eq!(cache.clear().unwrap().bakes, 1);
        assert!(matches!(cache.find(&cache.place(&job(1))), Found::Nothing));
    }

    #[test]
    fn relatives_differ_by_their_lights_alone() {
        let folder = tempfile::tempdir().unwrap();
        let cache = BakeCache::new(folder.path().into(), 1 << 20);
        let mut dimmed = job(1);
        let mut scene = dimmed.scene.scene.clone();
        scene.punctual[0].position.y -= 0.1;
        dimmed.scene = Arc::new(PreparedScene::new(scene, &[]).unwrap().0);
        for job in [job(1), job(2)] {
            cache.keep(&cache.place(&job), &baked(&job)).unwrap();
        }
        let found = cache.relatives(&cache.place(&dimmed));
        assert!(found.len() == 1 && is_hit(&found[0]), "{found:?}");
        assert!(cache.relatives(&cache.place(&job(1))).is_empty(), "it is not its own");
    }

    #[test]
    fn what_is_damaged_is_set_aside_and_told() {
        let folder = tempfile::tempdir().unwrap();
        let cache = BakeCache::new(folder.path().into(), 1 << 20);
        cache.keep(&cache.place(&job(1)), &baked(&job(1))).unwrap();
        let path = cache.place(&job(1)).0;
        let mut bytes = fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x10;
        fs::write(&path, bytes).unwrap();
        match cache.find(&cache.place(&job(1))) {
            Found::SetAside(words) => assert!(words.contains("set aside"), "{words}"),
            other => panic!("{other:?}"),
        }
        assert!(matches!(cache.find(&cache.place(&job(1))), Found::Nothing));
        assert_eq!(cache.usage().unwrap().bakes, 0);
        assert!(cache.usage().unwrap().bytes > 0, "it is kept for who wants to see what happened");
    }

    #[test]
    fn what_the_system_cannot_read_now_is_told_and_stays() {
        let folder = tempfile::tempdir().unwrap();
        let cache = BakeCache::new(folder.path().into(), 1 << 20);
        // A folder can be read as a file by nobody, whatever rights there are.
        let path = cache.place(&job(1)).0;
        fs::create_dir(&path).unwrap();
        match cache.find(&cache.place(&job(1))) {
            Found::SetAside(words) => assert!(words.contains("could not be read"), "{words}"),
            other => panic!("{other:?}"),
        }
        assert!(path.exists());
    }

    #[test]
    fn over_the_limit_what_was_used_longest_ago_goes_first() {
        let folder = tempfile::tempdir().unwrap();
        let jobs = [job(1), job(2), job(3)];
        let bakes = jobs.each_ref().map(baked);
        let roomy = BakeCache::new(folder.path().into(), 1 << 30);
        for (age, (job, bake)) in [30, 20].into_iter().zip(jobs.iter().zip(&bakes)) {
            roomy.keep(&roomy.place(job), bake).unwrap();
            let file = File::options().write(true).open(roomy.place(job).0).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(age)).unwrap();
        }
        // The first is older, but used again.
        assert!(is_hit(&roomy.find(&roomy.place(&jobs[0]))));
        let tight = BakeCache::new(folder.path().into(), roomy.usage().unwrap().bytes * 5 / 4);
        assert!(tight.keep(&tight.place(&jobs[2]), &bakes[2]).unwrap());
        let left = jobs.each_ref().map(|job| is_hit(&tight.find(&tight.place(job))));
        assert_eq!(left, [true, false, true]);
        let tiny = BakeCache::new(folder.path().into(), 10);
        assert!(!tiny.keep(&tiny.place(&jobs[1]), &bakes[1]).unwrap(), "it is larger than all that may be kept");
        let none = BakeCache::new(folder.path().into(), 0);
        assert!(!none.keep(&none.place(&jobs[0]), &bakes[0]).unwrap());
    }

    #[test]
    fn a_bake_that_is_too_large_to_be_kept_takes_no_other_along() {
        let folder = tempfile::tempdir().unwrap();
        let (small, large) = (job(1), BakeJob { film: Film { width: 128, height: 96 }, ..job(1) });
        let roomy = BakeCache::new(folder.path().into(), 1 << 30);
        roomy.keep(&roomy.place(&small), &baked(&small)).unwrap();
        let tight = BakeCache::new(folder.path().into(), roomy.usage().unwrap().bytes);
        assert!(!tight.keep(&tight.place(&large), &baked(&large)).unwrap());
        assert!(is_hit(&tight.find(&tight.place(&small))), "it is as small as before");
        assert_eq!(tight.usage().unwrap().bakes, 1);
    }

    #[test]
    fn editors_that_keep_read_and_clear_one_entry_at_once_see_a_whole_bake_or_none() {
        let folder = tempfile::tempdir().unwrap();
        let cache = &BakeCache::new(folder.path().into(), 1 << 24);
        let (place, bake) = (&cache.place(&job(1)), &baked(&job(1)));
        std::thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(move || {
                    // What is cleared away while it is written is told, and nothing is broken by it.
                    (0..60).for_each(|_| drop(cache.keep(place, bake)));
                });
            }
            scope.spawn(move || (0..60).for_each(|_| assert!(cache.clear().is_ok())));
            for _ in 0..60 {
                match cache.find(place) {
                    Found::Hit(found) => assert_eq!(found.header, bake.header),
                    Found::Nothing => {}
                    Found::SetAside(words) => panic!("{words}"),
                }
            }
        });
        cache.keep(place, bake).unwrap();
        assert!(is_hit(&cache.find(place)));
        assert_eq!(cache.usage().unwrap().bakes, 1);
    }

    #[test]
    fn what_a_killed_editor_left_half_written_is_cleared_away() {
        let folder = tempfile::tempdir().unwrap();
        let cache = BakeCache::new(folder.path().into(), 1 << 20);
        let (left, file) = beside::temporary(&cache.place(&job(1)).0).unwrap();
        fs::write(&left, [0; 100]).unwrap();
        assert_eq!(cache.usage().unwrap().bytes, 0, "it is still being written");
        drop(file);
        assert_eq!(cache.usage().unwrap(), Usage { bakes: 0, bytes: 100 });
        cache.clear().unwrap();
        assert!(!left.exists());
    }

    #[test]
    fn files_of_the_user_in_its_folder_are_neither_counted_nor_removed() {
        let folder = tempfile::tempdir().unwrap();
        let [roomy, tiny] = [1 << 20, 10].map(|limit| BakeCache::new(folder.path().into(), limit));
        let hash = "0123456789abcdef";
        let names = [
            "mine.transport".to_owned(),
            "a-b-c.transport".into(),
            format!("{hash}-{hash}-c.transport"),
            format!("{hash}-{hash}{hash}.transport"),
            "mine.transport.part".into(),
            "mine.damaged".into(),
            ".mine.png.1-0.tmp".into(),
        ];
        names.iter().for_each(|name| fs::write(folder.path().join(name), [0; 100]).unwrap());
        assert_eq!(roomy.usage().unwrap(), Usage { bakes: 0, bytes: 0 });
        // Its own go, in all their forms.
        let kept = roomy.place(&job(1)).0;
        let own = [kept.clone(), kept.with_extension("transport.part"), kept.with_extension(DAMAGED)];
        own.iter().for_each(|path| fs::write(path, [0; 100]).unwrap());
        assert_eq!(roomy.usage().unwrap(), Usage { bakes: 1, bytes: 300 });
        assert_eq!(roomy.clear().unwrap(), Usage { bakes: 1, bytes: 300 });
        assert!(own.iter().all(|path| !path.exists()));
        assert!(!tiny.keep(&tiny.place(&job(1)), &baked(&job(1))).unwrap());
        assert!(names.iter().all(|name| folder.path().join(name).exists()));
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_an_error_in_words() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let cache = BakeCache::new(file, 1 << 20);
        let error = cache.keep(&cache.place(&job(1)), &baked(&job(1))).unwrap_err().to_string();
        assert!(error.contains("not kept"), "{error}");
    }

    #[test]
    fn limits_are_megabytes() {
        assert_eq!(megabytes(" 3 ").unwrap(), 3 << 20);
        for bad in ["-1", "much", "99999999999999999999", "18446744073709551615"] {
            assert!(megabytes(bad).unwrap_err().to_string().contains(LIMIT_VARIABLE), "{bad}");
        }
    }
}
