//! Threads with a number, a stop flag and one channel to the window.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context, Result};
use clerestory_transport::archive::{self, UnderWay};
use clerestory_transport::bake::focus::Focus;
use clerestory_transport::bake::reuse::Reuse;
use clerestory_transport::bake::stack::StackJob;
use clerestory_transport::bake::{Bake, BakeError, BakeEvent, BakeJob, HalfDone, Passes};
use clerestory_transport::emitters::LightingError;
use clerestory_transport::import::{self, stack::ImageStack};
use clerestory_transport::lamp_units::{LampUnits, assume_unitless};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::{PunctualLight, Scene};
use clerestory_transport::skips::Skips;
use clerestory_transport::stop::Stop;
use eframe::egui::ColorImage;

use super::estimate::Forecast;
use super::found::FoundScene;
use super::glimpse::{self, Glimpse};
use super::room::all_threads;
use super::{Chosen, ChosenSky, Wake};
use crate::action::is_transport;
use crate::bake_cache::{BakeCache, Found};
use crate::crash;
use crate::export_gltf::Lit;
use crate::headless::GALLERY;
use crate::look::Look;
use crate::platform::{memory_bytes, step_back};
use crate::sequence::{Sequence, Written};
use crate::stills::{Stills, Subject};
use crate::words::in_words;

/// Something to open.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// The scene that is part of the program.
    BuiltIn,
    /// A scene, a finished bake, or a folder of pictures.
    File(PathBuf),
    /// A glTF file in memory.
    Bytes {
        /// For people.
        name: String,
        /// GLB or JSON.
        bytes: Vec<u8>,
    },
}

impl Source {
    /// For people.
    pub fn name(&self) -> String {
        match self {
            Source::BuiltIn => "Gallery".into(),
            Source::File(path) => {
                let name_in = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
                // What a folder like `.` is called, the disk knows.
                let named = name_in(path).or_else(|| name_in(&path.canonicalize().ok()?));
                named.unwrap_or_else(|| path.display().to_string())
            }
            Source::Bytes { name, .. } => name.clone(),
        }
    }

    /// Where it lies, from the root.
    pub(super) fn path(&self) -> Option<PathBuf> {
        match self {
            Source::File(path) => Some(std::path::absolute(path).unwrap_or_else(|_| path.clone())),
            Source::BuiltIn | Source::Bytes { .. } => None,
        }
    }
}

/// What was opened.
pub enum Loaded {
    /// A scene, ready to be baked.
    Scene {
        /// With its lights.
        scene: Box<PreparedScene>,
        /// What was left behind, in words.
        report: Vec<String>,
        /// Lamps as the file has them.
        lamps: Vec<PunctualLight>,
        /// What was chosen about it.
        chosen: Box<Chosen>,
        /// Files beside it that it is made of, there or not.
        files: Vec<PathBuf>,
    },
    /// Pictures, ready to be baked.
    Stack(ImageStack),
    /// A bake from a file.
    Bake(Bake),
}

/// A scene that was prepared again for what was chosen.
pub(super) struct Prepared {
    pub scene: Box<PreparedScene>,
    pub chosen: Chosen,
    pub warnings: Vec<String>,
}

/// What a thread has to say.
pub(super) enum Fact {
    /// Something was opened, or why not.
    Loaded(String, Result<Loaded, String>),
    /// Something was chosen about the scene, or why that cannot be.
    Prepared(Result<Prepared, String>),
    /// The bake goes on.
    Bake(BakeEvent),
    /// A first look at what is about to be baked.
    Glimpsed(Glimpse),
    /// What was done with what is baked, in words.
    Remarks(Vec<String>),
    /// The bake ended; with nothing if it was stopped.
    BakeEnded(Result<Option<Bake>, String>),
    /// The scene of a bake that was opened, or why it cannot be had.
    SceneFound(Result<FoundScene, String>),
    /// The bake that was asked for is there already.
    Found(Box<Bake>),
    /// So many frames of a sequence were written.
    Frame(u32),
    /// A file was written, or why not.
    Written(Result<String, String>),
    /// What was written is hardly what was meant, in words.
    Warned(String),
    /// What a bake will take.
    Foreseen(Forecast),
    /// A picture for the clipboard, or why there is none.
    Developed(Result<ColorImage, String>),
}

/// A thread's end of the channel.
pub(super) struct Post {
    id: u64,
    sender: SyncSender<(u64, Fact)>,
    wake: Wake,
    /// Whether nobody wants any more what it makes.
    pub stop: Stop,
}

impl Post {
    pub fn new(id: u64, sender: SyncSender<(u64, Fact)>, wake: Wake) -> Post {
        Post { id, sender, wake, stop: Stop::default() }
    }

    /// Whether anybody still wants what it makes.
    pub fn is_wanted(&self) -> bool {
        !self.stop.is_asked()
    }

    /// Tells the window, which looks within `soon`; breaks if nobody wants to hear more.
    pub fn send(&self, fact: Fact, soon: Duration) -> ControlFlow<()> {
        if self.sender.send((self.id, fact)).is_err() || !self.is_wanted() {
            return ControlFlow::Break(());
        }
        (self.wake)(soon);
        ControlFlow::Continue(())
    }

    /// Tells of a file that was written, with a warning about it if there is one, or why it was not.
    pub fn written(&self, result: Result<(String, Option<String>)>) {
        let (result, warning) = match result {
            Ok((words, warning)) => (Ok(words), warning),
            Err(error) => (Err(in_words(&error)), None),
        };
        for fact in [Fact::Written(result)].into_iter().chain(warning.map(Fact::Warned)) {
            let _ = self.send(fact, Duration::ZERO);
        }
    }
}

/// A running thread.
pub(super) struct Task {
    id: u64,
    stop: Stop,
    thread: JoinHandle<()>,
}

impl Task {
    pub fn start(name: &str, post: Post, body: impl FnOnce(Post) + Send + 'static) -> std::io::Result<Task> {
        let (id, stop, wake) = (post.id, post.stop.clone(), post.wake.clone());
        let thread = std::thread::Builder::new().name(name.into()).spawn(move || {
            // Whatever happens to the body, the window looks once more.
            let _woken_at_the_end = WakeOnDrop(wake);
            body(post);
        })?;
        Ok(Task { id, stop, thread })
    }

    pub fn id(&self) -> u64 {
        self.id
    }

    pub fn is_finished(&self) -> bool {
        self.thread.is_finished()
    }

    /// Asks it to end soon.
    pub fn stop(&self) {
        self.stop.ask();
    }

    /// The same, on its way to where it is waited for.
    pub fn stopped(self) -> Task {
        self.stop();
        self
    }

    pub fn join(self) {
        // A panic was printed by the thread itself and is reported where its last word is missed.
        let _ = self.thread.join();
    }
}

struct WakeOnDrop(Wake);

impl Drop for WakeOnDrop {
    fn drop(&mut self) {
        // A little later: the thread must be seen to have ended.
        (self.0)(Duration::from_millis(50));
    }
}

/// An error with all its causes.
pub(super) fn words(error: impl std::error::Error + Send + Sync + 'static) -> String {
    in_words(&anyhow::Error::from(error))
}

/// Reads and prepares something, a scene with what is chosen about it, if nobody asks for a stop meanwhile.
pub(super) fn load(source: Source, mut chosen: Chosen, stop: &Stop) -> Result<Loaded> {
    let imported = match source {
        Source::BuiltIn => import::load_bytes_until("Gallery", GALLERY, Skips::default(), stop)?,
        Source::Bytes { name, bytes } => import::load_bytes_until(&name, &bytes, Skips::default(), stop)?,
        Source::File(path) if is_transport(&path) => {
            return Ok(Loaded::Bake(archive::read_within(memory_bytes(), &path)?));
        }
        Source::File(path) if path.is_dir() => return Ok(Loaded::Stack(ImageStack::open(&path)?)),
        Source::File(path) => import::load_until(&path, Skips::default(), stop)?,
    };
    anyhow::ensure!(
        !imported.scene.mesh.triangles.is_empty(),
        "it has no surfaces, so there is nothing to see; open a scene with meshes"
    );
    let unsupported = imported.report.unsupported.iter().map(|what| format!("Left out: {what}"));
    let mut report: Vec<String> = unsupported.chain(imported.report.warnings.iter().cloned()).collect();
    if imported.report.made_camera {
        report.push("It has no perspective camera; one was made".into());
    }
    let (lamps, files) = (imported.scene.punctual.clone(), imported.report.files);
    report.extend(chosen.read_sky());
    let backs = |scene: &PreparedScene| scene.scene.cameras.first().and_then(|camera| scene.warn_of_backs(camera));
    if chosen != Chosen::default() {
        match prepare_again(&imported.scene, lamps.clone(), chosen, stop) {
            Ok(Prepared { scene, chosen, warnings }) => {
                report.extend(warnings);
                report.extend(backs(&scene));
                return Ok(Loaded::Scene { scene, report, lamps, chosen: Box::new(chosen), files });
            }
            Err(error @ LightingError::Stopped(_)) => return Err(error.into()),
            // The file has changed: what was chosen about it may not be there any more.
            Err(error) => report.push(format!("What was chosen about it is left out: {}", words(error))),
        }
    }
    let prepared = PreparedScene::until(imported.scene, &[], None, Skips::default(), stop);
    let (scene, warnings) = prepared.context("its lights cannot be used")?;
    report.extend(warnings);
    report.extend(backs(&scene));
    Ok(Loaded::Scene { scene: Box::new(scene), report, lamps, chosen: Box::default(), files })
}

/// The same scene with its lamps as the file has them, changed by what was chosen.
pub(super) fn prepare_again(
    scene: &Scene,
    lamps: Vec<PunctualLight>,
    chosen: Chosen,
    stop: &Stop,
) -> Result<Prepared, LightingError> {
    let mut scene = Scene { punctual: lamps, ..scene.clone() };
    if chosen.units == LampUnits::Unitless {
        assume_unitless(&mut scene);
    }
    let sky = chosen.sky.as_ref().and_then(ChosenSky::request);
    let prepared = PreparedScene::until(scene, &chosen.panels, sky.as_ref(), Skips::default(), stop);
    let (scene, warnings) = prepared?;
    Ok(Prepared { scene: Box::new(scene), chosen, warnings })
}

/// How long facts about blocks may wait: a handful of repaints per second is enough to watch a bake.
const BLOCKS_WITHIN: Duration = Duration::from_millis(100);

/// Bakes on some threads; one core stays with the window.
///
/// One that is in the cache is not made again; one that is new is kept there, block by block as it comes, so that an editor that
/// ends before its bake loses no more than the blocks under way. What an earlier one has in common with it is taken over.
pub(super) fn bake(
    (mut job, n_threads): (BakeJob, usize),
    glimpse: Option<BakeJob>,
    (mut begun, mut earlier): (Option<HalfDone>, Vec<Bake>),
    cache: Option<BakeCache>,
    focus: &Focus,
    post: Post,
) {
    let mut remarks = Vec::new();
    let cached = cache.map(|cache| (cache.place(&job), cache));
    match cached.as_ref().map(|(place, cache)| cache.find(place)) {
        Some(Found::Hit(bake)) => {
            let _ = post.send(Fact::Found(bake), Duration::ZERO);
            return;
        }
        Some(Found::SetAside(words)) => remarks.push(words),
        Some(Found::Nothing) | None => {}
    }
    for relative in cached.iter().flat_map(|(place, cache)| cache.relatives(place)) {
        match relative {
            Found::Hit(bake) => earlier.push(*bake),
            Found::SetAside(words) => remarks.push(words),
            Found::Nothing => {}
        }
    }
    let mut kept = None;
    match cached.as_ref().map(|(place, cache)| cache.under_way(place)) {
        Some(Ok(Some((under_way, left)))) => {
            kept = Some(under_way);
            if let (None, Some(left)) = (&begun, left) {
                remarks.push(format!("{} blocks were baked before; the rest follows", left.blocks.len()));
                (begun, job.passes) = (Some(left), Passes::Again);
            }
        }
        Some(Err(error)) => remarks.push(in_words(&error)),
        Some(Ok(None)) | None => {}
    }
    let _ = post.send(Fact::Remarks(remarks), BLOCKS_WITHIN);
    if let Some(glimpse) = glimpse.filter(|_| begun.is_none()) {
        // Until there is something to see, the window needs no core of its own.
        // Else it was stopped, or the bake fails as well, in the same words.
        let go_on = |_| ControlFlow::Continue(());
        if let Ok(Some(glimpse)) = beside_the_window(n_threads + 1, || glimpse::run(glimpse, job.film, focus, go_on)) {
            let _ = post.send(Fact::Glimpsed(glimpse), Duration::ZERO);
        }
    }
    let reuse = most_reused(&job, &earlier);
    let on_event = |event| {
        if let Some(Err(error)) = kept.as_mut().map(|kept| kept.heed(&event)) {
            kept = None;
            let words = format!("the bake goes on, but is not kept while it runs: {error}");
            let _ = post.send(Fact::Remarks(vec![words]), BLOCKS_WITHIN);
        }
        tell(&post, event)
    };
    let result = beside_the_window(n_threads, || match &reuse {
        Some(reuse) => job.run_reusing(reuse, focus, begun, on_event),
        None => job.run_toward(focus, begun, on_event),
    });
    let baked = result.as_ref().ok().cloned().flatten();
    let _ = post.send(Fact::BakeEnded(result), Duration::ZERO);
    if let (Some((place, cache)), Some(bake)) = (cached, baked) {
        keep(&post, || {
            cache.keep(&place, &bake)?;
            kept.into_iter().for_each(UnderWay::remove);
            Ok(())
        });
    }
}

/// Keeps what is baked already; where that fails, or panics, it is told.
pub(super) fn keep(post: &Post, job: impl FnOnce() -> Result<()>) {
    let lost = match crash::guarded(job) {
        Ok(kept) => kept.err().map(|error| in_words(&error)),
        Err(words) => Some(format!("the bake is not kept for the next time; save it if it is to stay: {words}")),
    };
    if let Some(words) = lost {
        let _ = post.send(Fact::Written(Err(words)), Duration::ZERO);
    }
}

/// What a job takes over of the bake that leaves it the least to trace.
pub(super) fn most_reused(job: &BakeJob, earlier: &[Bake]) -> Option<Reuse> {
    let reuses = earlier.iter().filter_map(|bake| job.reuse(bake).ok());
    reuses.min_by_key(|reuse| (reuse.n_traced_columns(), reuse.n_added_rows()))
}

/// The same as [`bake`] for a stack of pictures.
pub(super) fn bake_stack(job: StackJob, post: Post) {
    let result = beside_the_window(all_threads(), || {
        let Some(surveyed) = job.survey(&mut |event| tell(&post, event))? else { return Ok(None) };
        let _ = post.send(Fact::Remarks(surveyed.remarks()), BLOCKS_WITHIN);
        surveyed.run(|event| tell(&post, event))
    });
    let _ = post.send(Fact::BakeEnded(result), Duration::ZERO);
}

fn tell(post: &Post, event: BakeEvent) -> ControlFlow<()> {
    let soon = if matches!(event, BakeEvent::PassDone { .. }) { Duration::ZERO } else { BLOCKS_WITHIN };
    post.send(Fact::Bake(event), soon)
}

/// On threads of their own, which make way for those that relight, light lamps and draw.
pub(super) fn beside_the_window<T: Send>(
    n_threads: usize,
    bake: impl FnOnce() -> Result<Option<T>, BakeError> + Send,
) -> Result<Option<T>, String> {
    match rayon::ThreadPoolBuilder::new().num_threads(n_threads).start_handler(|_| step_back()).build() {
        Ok(pool) => pool.install(bake).map_err(words),
        Err(error) => Err(words(error)),
    }
}

/// Writes a scene with its lights as they are.
pub(super) fn write_gltf(scene: &PreparedScene, source: Source, look: &Look, path: &Path, post: &Post) {
    let folder = source.path().as_deref().and_then(Path::parent).map(Path::to_path_buf);
    let write = || -> Result<(String, Option<String>)> {
        let bytes = match source {
            Source::BuiltIn => GALLERY.to_vec(),
            Source::Bytes { bytes, .. } => bytes,
            Source::File(file) => {
                std::fs::read(&file).with_context(|| format!("the scene {} cannot be read again", file.display()))?
            }
        };
        let warnings = Lit { bytes: &bytes, folder: folder.as_deref(), scene, look }.save(path)?;
        let missing = (!warnings.is_empty()).then(|| format!("{}: {}", path.display(), warnings.join(", ")));
        Ok((format!("Saved {}", path.display()), missing))
    };
    post.written(write());
}

/// Writes the frames of a timeline one after the other.
pub(super) fn write_frames(sequence: &Sequence, subject: Subject, post: &Post) {
    let header = subject.bake.header.clone();
    let mut stills = Stills::new(Arc::new(subject), None);
    let n_frames = sequence.n_frames();
    let mut on_frame = |n: u32| {
        // A stop is seen before the next frame.
        let _ = post.send(Fact::Frame(n), BLOCKS_WITHIN);
    };
    let written = sequence.write(&mut stills, &header.basis, &|| !post.is_wanted(), &mut on_frame);
    let last = sequence.pattern.file(*sequence.frames.end());
    let words = |written: Written| match written.n_frames {
        n if n == n_frames => format!("Saved {n} frames up to {}", last.display()),
        n => format!("{n} of {n_frames} frames were saved"),
    };
    post.written(written.map(|written| (words(written), written.warning(&header.basis))));
}
