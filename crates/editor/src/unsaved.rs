//! Looks that were not saved, kept in a folder of the user's so that a crash costs seconds and not a day.
//!
//! Every running editor owns a slot there: `N.lock`, locked as long as its process lives, and `N.json`, replaced as a whole.
//! A slot with a look that nobody locks was left by an editor that ended without asking; it is offered at the next start.

use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use crate::crash;
use crate::look::{Look, OnDisk};
use crate::output::write_whole;
use crate::words::in_words;

/// How long a change may go unkept.
const KEPT_WITHIN: Duration = Duration::from_secs(2);
/// Slots that are looked at; more editors than that run without one.
const MAX_SLOTS: usize = 64;

/// What an editor was working on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Work {
    /// The scene, bake or folder that was open; the built-in scene has none.
    pub scene: Option<PathBuf>,
    /// Where the look was saved before, if it ever was.
    pub look_path: Option<PathBuf>,
    /// How that file stood then.
    #[serde(default)]
    pub on_disk: Option<OnDisk>,
    /// Folder that the look's own paths are relative to.
    pub folder: PathBuf,
    /// The look, as its file would hold it.
    pub look: String,
}

impl Work {
    /// The look, as far as it can be read, and a sentence for each fault.
    ///
    /// # Errors
    /// If nothing of it can be read.
    pub fn look(&self) -> Result<(Look, Vec<String>)> {
        Look::recover_in(&self.look, &self.folder)
    }

    /// For people.
    pub fn scene_name(&self) -> String {
        let of = |path: &PathBuf| path.file_name().map(|name| name.to_string_lossy().into_owned());
        self.scene.as_ref().map_or("Gallery".into(), |path| of(path).unwrap_or_else(|| path.display().to_string()))
    }
}

/// Work that an editor left behind. While this exists no other editor offers it.
#[derive(Debug)]
pub struct LeftBehind {
    /// The work.
    pub work: Work,
    /// When it was kept last.
    pub kept_at: Option<SystemTime>,
    slot: Slot,
}

impl LeftBehind {
    /// Nobody wants it any more.
    pub fn forget(self) {
        let _ = fs::remove_file(self.slot.path());
    }
}

/// A place in the folder; locked as long as the file is open.
#[derive(Debug)]
struct Slot {
    folder: PathBuf,
    number: usize,
    _lock: File,
}

impl Slot {
    /// `None` if another editor has it.
    fn take(folder: &Path, number: usize) -> Result<Option<Slot>> {
        let path = folder.join(format!("{number}.lock"));
        let problem = || format!("cannot keep unsaved looks: {} cannot be written", path.display());
        let lock = File::options().create(true).truncate(false).write(true).open(&path).with_context(problem)?;
        match lock.try_lock() {
            Ok(()) => Ok(Some(Slot { folder: folder.into(), number, _lock: lock })),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(error)) => Err(error).with_context(problem),
        }
    }

    fn path(&self) -> PathBuf {
        self.folder.join(format!("{}.json", self.number))
    }

    /// What stands there, `None` if nothing does. What cannot be read is set aside under another name.
    fn work(&self) -> Option<(Work, Option<SystemTime>)> {
        let path = self.path();
        let text = fs::read(&path).ok()?;
        let kept_at = fs::metadata(&path).and_then(|of| of.modified()).ok();
        match serde_json::from_slice(&text) {
            Ok(work) => Some((work, kept_at)),
            Err(_) => {
                let _ = fs::rename(&path, path.with_extension("damaged"));
                None
            }
        }
    }
}

enum Order {
    Keep(PathBuf, Work),
    Forget(PathBuf),
}

/// Keeps the look of this editor while it is not saved.
pub struct Keeper {
    slot: Slot,
    sender: Option<Sender<Order>>,
    problems: Receiver<String>,
    thread: Option<JoinHandle<()>>,
    kept: Option<Look>,
    changed_at: Option<Instant>,
}

impl Keeper {
    /// Takes a slot in `folder`, and finds what others left behind there, newest first.
    ///
    /// # Errors
    /// If the folder cannot be made or written, or the system gives no thread.
    pub fn start(folder: &Path) -> Result<(Keeper, Vec<LeftBehind>)> {
        fs::create_dir_all(folder)
            .with_context(|| format!("cannot keep unsaved looks: the folder {} cannot be made", folder.display()))?;
        let (mut own, mut left) = (None, Vec::new());
        for number in 0..MAX_SLOTS {
            let Some(slot) = Slot::take(folder, number)? else { continue };
            match slot.work() {
                Some((work, kept_at)) => left.push(LeftBehind { work, kept_at, slot }),
                None if own.is_none() => own = Some(slot),
                None => {}
            }
            // Slots are filled from the front; nobody ever took those behind one that was just made.
            if own.is_some() && !folder.join(format!("{}.lock", number + 1)).exists() {
                break;
            }
        }
        left.sort_by_key(|left| std::cmp::Reverse(left.kept_at));
        let slot = own.with_context(|| format!("cannot keep unsaved looks: {} is full", folder.display()))?;
        let (sender, orders) = channel();
        let (tell, problems) = channel();
        let work = move || orders.iter().for_each(|order| told(&tell, || carry_out(order)));
        let thread = std::thread::Builder::new().name("keep".into()).spawn(work)?;
        let keeper =
            Keeper { slot, sender: Some(sender), problems, thread: Some(thread), kept: None, changed_at: None };
        Ok((keeper, left))
    }

    /// Keeps `look` if it is unsaved and has been for a while; what is saved needs no keeping. Returns how soon to come back.
    pub fn follow(&mut self, look: &Look, saved: &Look, work: impl FnOnce() -> Work) -> Option<Duration> {
        if look == saved {
            if self.kept.take().is_some() {
                self.order(Order::Forget(self.slot.path()));
            }
            self.changed_at = None;
            return None;
        }
        if self.kept.as_ref() == Some(look) {
            self.changed_at = None;
            return None;
        }
        let since = self.changed_at.get_or_insert_with(Instant::now).elapsed();
        if since < KEPT_WITHIN {
            return Some(KEPT_WITHIN - since);
        }
        self.keep_now(look, work());
        None
    }

    /// Keeps a look at once.
    pub fn keep_now(&mut self, look: &Look, work: Work) {
        self.order(Order::Keep(self.slot.path(), work));
        (self.kept, self.changed_at) = (Some(look.clone()), None);
    }

    /// What went wrong since the last call.
    pub fn problem(&mut self) -> Option<String> {
        self.problems.try_iter().last()
    }

    fn order(&self, order: Order) {
        if let Some(sender) = &self.sender {
            // The thread ends only after the sender does.
            let _ = sender.send(order);
        }
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        self.sender = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn carry_out(order: Order) -> Result<()> {
    match order {
        Order::Keep(path, work) => serde_json::to_vec_pretty(&work)
            .context("paths that are no text cannot be kept")
            .and_then(|json| write_whole(&path, &json)),
        Order::Forget(path) => match fs::remove_file(&path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error.into()),
            _ => Ok(()),
        },
    }
}

/// Does a job of the thread, and tells where it fails or panics; what is ordered next is carried out all the same.
fn told(tell: &Sender<String>, job: impl FnOnce() -> Result<()>) {
    let why = match crash::guarded(job) {
        Ok(done) => done.err().map(|error| in_words(&error)),
        Err(words) => Some(words),
    };
    if let Some(why) = why {
        let _ = tell.send(format!("unsaved changes are not kept for a crash: {why}"));
    }
}

#[cfg(test)]
mod tests {
    use clerestory_transport::light::LightSetting;

    use super::*;

    fn changed(intensity: f32) -> Look {
        let mut look = Look::default();
        look.lights.lights.insert("lamp".into(), LightSetting { intensity, ..LightSetting::default() });
        look
    }

    fn work_of(look: &Look) -> Work {
        let scene = Some("/scenes/room.glb".into());
        Work { scene, look_path: None, on_disk: None, folder: "/scenes".into(), look: look.to_json() }
    }

    #[test]
    fn what_an_editor_leaves_behind_is_offered_once_and_only_when_it_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        let (mut first, left) = Keeper::start(folder.path()).unwrap();
        assert!(left.is_empty());
        first.keep_now(&changed(2.0), work_of(&changed(2.0)));
        let (second, left) = Keeper::start(folder.path()).unwrap();
        assert!(left.is_empty(), "its owner lives");
        drop((first, second));

        let (third, left) = Keeper::start(folder.path()).unwrap();
        assert_eq!(left.len(), 1);
        assert_eq!(left[0].work, work_of(&changed(2.0)));
        assert_eq!(left[0].work.scene_name(), "room.glb");
        assert_eq!(left[0].work.look().unwrap(), (changed(2.0), vec![]));
        assert!(Keeper::start(folder.path()).unwrap().1.is_empty(), "it is being offered already");
        drop((third, left));
        let (_, mut left) = Keeper::start(folder.path()).unwrap();
        left.pop().unwrap().forget();
        assert!(Keeper::start(folder.path()).unwrap().1.is_empty());
    }

    #[test]
    fn what_is_saved_is_not_kept() {
        let folder = tempfile::tempdir().unwrap();
        let (mut keeper, _) = Keeper::start(folder.path()).unwrap();
        let look = changed(3.0);
        let soon = keeper.follow(&look, &Look::default(), || work_of(&look)).unwrap();
        assert!(soon <= KEPT_WITHIN && soon > Duration::ZERO);
        keeper.keep_now(&look, work_of(&look));
        assert_eq!(keeper.follow(&look, &Look::default(), || unreachable!("it is kept already")), None);
        assert_eq!(keeper.follow(&look, &look, || unreachable!("it is saved")), None);
        drop(keeper);
        assert!(Keeper::start(folder.path()).unwrap().1.is_empty());
    }

    #[test]
    fn damaged_work_is_set_aside_and_does_not_stop_the_editor() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("0.json"), "{\"scene\": ").unwrap();
        let (_keeper, left) = Keeper::start(folder.path()).unwrap();
        assert!(left.is_empty());
        assert!(folder.path().join("0.damaged").exists());
    }

    #[test]
    fn a_crash_while_work_is_kept_is_told() {
        let (tell, problems) = channel();
        told(&tell, || panic!("as asked"));
        told(&tell, || Ok(()));
        let said: Vec<String> = problems.try_iter().collect();
        assert!(said.len() == 1 && said[0].contains("not kept for a crash: it ended unexpectedly"), "{said:?}");
    }

    #[test]
    fn a_folder_that_cannot_be_had_and_a_full_one_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let error = Keeper::start(&file.join("below")).err().unwrap().to_string();
        assert!(error.contains("cannot be made"), "{error}");
        let place = folder.path().join("place");
        let (mut keeper, _) = Keeper::start(&place).unwrap();
        fs::remove_dir_all(&place).unwrap();
        keeper.keep_now(&changed(1.5), work_of(&changed(1.5)));
        // The thread is joined, so that its last word is there.
        keeper.sender = None;
        keeper.thread.take().unwrap().join().unwrap();
        assert!(keeper.problem().unwrap().contains("not kept"));
    }
}
