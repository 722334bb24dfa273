//! What is open, what is being baked, and the threads that do it. The window asks and drains; it never waits.

pub mod aside;
mod begun;
mod earlier;
pub mod estimate;
pub mod lamps;
mod mailbox;
pub mod preview;
pub mod prints;
mod seen;
pub mod shares;
mod sheet;
pub mod sky;
mod task;
pub mod views;
pub mod worker;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use clerestory_nystrom::BlockLowRank;
use clerestory_relight::Frame;
use clerestory_transport::archive;
use clerestory_transport::bake::focus::Focus;
use clerestory_transport::bake::stack::{MEMORY_BYTES, StackJob};
use clerestory_transport::bake::{Bake, BakeConfig, BakeEvent, BakeHeader, BakeJob, HalfDone, PackedMatrices, Passes};
use clerestory_transport::basis::LightBasis;
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::emitters::{PanelRequest, SkyRequest};
use clerestory_transport::figures::{ErrorDb, Figures};
use clerestory_transport::import::stack::ImageStack;
use clerestory_transport::lamp_units::LampUnits;
use clerestory_transport::light::LightRig;
use clerestory_transport::patches::Patches;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::PunctualLight;
use clerestory_transport::sensors::{IrradianceRequest, OfFile};
use eframe::egui::ColorImage;

use self::begun::Begun;
use self::estimate::Forecasting;
use self::lamps::{LampLight, LampView};
use crate::bake_cache::BakeCache;
use crate::crash;
use crate::export::ExportOptions;
use crate::look::Look;
use crate::look::snapshot::Snapshot;
use crate::picture::Changed;
use crate::sequence::Sequence;
use crate::stills::Subject;
use seen::Seen;
use task::{Fact, Post, Prepared, Task, words};
pub use task::{Loaded, Source};
use views::Views;

/// Asks for a repaint after the given time; called from any thread.
pub type Wake = Arc<dyn Fn(Duration) + Send + Sync>;

/// Facts that may wait for the window.
const CHANNEL_LEN: usize = 4096;
/// Time between two counts of ranks and bytes while a bake runs.
const FIGURES_EVERY: Duration = Duration::from_secs(1);

/// How the bake panel is set.
#[derive(Clone, Debug, PartialEq)]
pub struct BakeSettings {
    /// Index of the camera in the scene.
    pub camera_idx: usize,
    /// Size of the picture.
    pub film: Film,
    /// How exactly.
    pub config: BakeConfig,
    /// Whether the light that arrives at the pixels and at the sensors of the file is baked as well.
    pub illuminance: bool,
}

/// A scene, a stack or a bake that is open.
pub struct Opened {
    /// For people.
    pub name: String,
    /// What it was read from, where it is a scene.
    pub source: Option<Source>,
    /// Where it lies; what is part of the program, or came as bytes, lies nowhere.
    pub path: Option<PathBuf>,
    /// The scene; a bake that was opened from a file has none.
    pub scene: Option<Arc<PreparedScene>>,
    /// The folder of pictures, where one was opened instead.
    pub stack: Option<Arc<ImageStack>>,
    /// What was left behind or had to be guessed, in words.
    pub report: Vec<String>,
    /// Lamps as the file has them.
    pub lamps: Vec<PunctualLight>,
    /// What was chosen in the window.
    pub chosen: Chosen,
    /// The scene of a bake that was opened, for what is not baked.
    pub of_bake: Option<SceneOfBake>,
}

/// The scene of a bake that was opened.
pub enum SceneOfBake {
    /// It is being looked for.
    Waiting,
    /// Here it is.
    Found(Arc<PreparedScene>),
    /// It was not found, or is another one: why.
    Missing(String),
}

impl Opened {
    /// Whether it has lamps that may be counted in other units.
    pub fn has_plain_lamps(&self) -> bool {
        self.lamps.iter().any(|lamp| lamp.profile.is_none())
    }
}

/// What was chosen in the window about a scene, and makes another scene of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chosen {
    /// Lights that became panels.
    pub panels: Vec<PanelRequest>,
    /// How its lamps are counted.
    pub units: LampUnits,
    /// The sky that lights it.
    pub sky: Option<SkyRequest>,
}

/// The matrix that is shown.
pub struct Shown {
    /// What it is of.
    pub header: Arc<BakeHeader>,
    /// The camera, where the scene is known.
    pub camera: Option<Camera>,
    /// Its blocks as far as they are there.
    pub frame: Frame,
    /// Irradiance of an opened file, so that it is there when the bake is saved again.
    pub irradiance: Vec<Vec<BlockLowRank>>,
    /// The bytes of all that, once they are what is shown.
    pub packed: Option<Arc<PackedMatrices>>,
}

impl Shown {
    /// Size of the picture.
    pub fn film(&self) -> Film {
        Film { width: self.header.width, height: self.header.height }
    }

    /// The surfaces on which free lamps bring indirect light, where the bake has them.
    pub fn patches(&self) -> Option<&Patches> {
        self.header.patches.as_ref()
    }

    /// One RGB coefficient per column and group under a rig and the light of its free lamps.
    pub fn coefficients(&self, rig: &LightRig, light: Option<&LampLight>) -> Vec<Vec<[f32; 3]>> {
        let mut coefficients = self.header.coefficients(rig);
        if let Some(light) = light {
            self.header.add_of_patches(&mut coefficients, &light.of_patches);
        }
        coefficients
    }

    /// The same for a matrix of irradiance.
    pub fn irradiance_coefficients(
        &self,
        set: usize,
        rig: &LightRig,
        light: Option<&LampLight>,
    ) -> Vec<Vec<[f32; 3]>> {
        let mut coefficients = self.header.irradiance_coefficients(set, rig);
        if let Some(light) = light {
            self.header.add_of_patches(&mut coefficients, &light.of_patches);
        }
        coefficients
    }

    /// Whether what surfaces make of the light of free lamps is part of every matrix of irradiance.
    pub fn holds_lamp_lux(&self) -> bool {
        self.irradiance.iter().all(|groups| self.header.holds_patches(groups))
    }

    /// Which matrix of irradiance is that of the pixels, if there is one.
    pub fn pixel_irradiance(&self) -> Option<usize> {
        self.header.pixel_irradiance(self.irradiance.len())
    }

    /// The bake, as far as it is there.
    pub fn bake(&self) -> Bake {
        Bake {
            header: self.header.clone(),
            groups: self.frame.groups.clone(),
            irradiance: self.irradiance.clone(),
            packed: self.packed.clone(),
        }
    }
}

/// Where opening stands.
#[derive(Clone, Debug, PartialEq)]
pub enum Stage {
    /// Nothing was opened.
    Empty,
    /// A file is being read and prepared.
    Loading(String),
    /// It could not be opened: what, and why.
    Failed(String, String),
    /// Something is open.
    Ready,
}

/// Where the bake stands.
#[derive(Clone, Debug, PartialEq)]
pub enum BakeState {
    /// None was started.
    Idle,
    /// The columns are being measured.
    Preparing,
    /// Blocks come in.
    Running {
        /// Pass that runs, 0 is the preview.
        pass: u32,
        /// Number of passes.
        n_passes: u32,
        /// 0…1 over all passes.
        done: f32,
        /// 0…1 within the pass that runs.
        pass_done: f32,
        /// Seconds left, once that can be judged.
        secs_left: Option<f32>,
    },
    /// All of it is there.
    Done,
    /// Stopped by a person; what was done is shown.
    Stopped,
    /// It failed, in words.
    Failed(String),
}

impl BakeState {
    /// Whether it runs.
    pub fn is_running(&self) -> bool {
        matches!(self, BakeState::Preparing | BakeState::Running { .. })
    }
}

/// What the window has to react to.
#[derive(Clone, Debug, PartialEq)]
pub enum Notice {
    /// A scene or bake is open; settings and look start over.
    Opened,
    /// The same scene with other panels or units is open.
    PreparedAgain,
    /// Something worth saying.
    Said(String),
    /// Something went wrong, in words.
    Failed(String),
    /// A picture for the clipboard.
    Developed(ColorImage),
}

/// What is open and what runs.
pub struct Session {
    wake: Wake,
    sender: SyncSender<(u64, Fact)>,
    receiver: Option<Receiver<(u64, Fact)>>,
    n_tasks: u64,
    loading: Option<Task>,
    baking: Option<Task>,
    /// Tasks whose facts no longer count, and writers of files.
    others: Vec<Task>,
    /// Which of them looks for the scene of a bake.
    finding: Option<u64>,
    /// What writes frames, and how far it is.
    frames: Option<(Task, (u32, u32))>,
    /// Path of what is being opened.
    opening: Option<PathBuf>,
    opening_source: Option<Source>,
    /// Where opening stands.
    pub stage: Stage,
    /// What is open.
    pub opened: Option<Opened>,
    /// Where the bake stands.
    pub bake: BakeState,
    /// The matrix that is shown.
    pub shown: Option<Shown>,
    /// A bake that replaces it once its preview is whole.
    incoming: Option<Shown>,
    /// Other views than the one that is shown.
    views: Views,
    /// What is new in `shown` since it was last asked for.
    changed: Changed,
    /// Blocks of each pass of the bake, and how many of the pass that runs are there.
    pass_blocks: (usize, usize),
    /// Error measured at the end of the last pass.
    pub error_db: Option<ErrorDb>,
    /// Ranks and bytes of what is shown.
    pub figures: Option<Figures>,
    figures_at: Instant,
    /// Grows with every picture that is whole: a preview, a finished pass, a bake from a file.
    pub n_whole: u64,
    n_counts: u64,
    /// Seconds since the bake began, and its error at that time in dB.
    pub history: Vec<[f32; 2]>,
    bake_began: Instant,
    begun: Option<Begun>,
    /// Bakes of the scene as it was before it was read or prepared again.
    earlier: Vec<Bake>,
    forecasting: Forecasting,
    /// Where somebody looks while a bake runs.
    pub focus: Arc<Focus>,
    /// Where finished bakes of scenes are found and kept.
    pub cache: Option<BakeCache>,
}

impl Session {
    /// Nothing open, nothing running.
    pub fn new(wake: Wake) -> Session {
        let (sender, receiver) = sync_channel(CHANNEL_LEN);
        Session {
            wake,
            sender,
            receiver: Some(receiver),
            n_tasks: 0,
            loading: None,
            baking: None,
            others: Vec::new(),
            finding: None,
            frames: None,
            opening: None,
            opening_source: None,
            stage: Stage::Empty,
            opened: None,
            bake: BakeState::Idle,
            shown: None,
            incoming: None,
            views: Views::default(),
            changed: Changed::default(),
            pass_blocks: (0, 0),
            error_db: None,
            figures: None,
            figures_at: Instant::now(),
            n_whole: 0,
            n_counts: 0,
            history: Vec::new(),
            bake_began: Instant::now(),
            begun: None,
            earlier: Vec::new(),
            forecasting: Forecasting::default(),
            focus: Arc::default(),
            cache: None,
        }
    }

    /// The columns of what is open, as soon as they are known.
    pub fn basis(&self) -> Option<&LightBasis> {
        let of_scene = || self.opened.as_ref()?.scene.as_ref().map(|scene| &scene.lighting.basis);
        self.shown.as_ref().map(|shown| &shown.header.basis).or_else(of_scene)
    }

    /// Cameras of the scene that is open.
    pub fn cameras(&self) -> &[Camera] {
        let scene = self.opened.as_ref().and_then(|opened| opened.scene.as_ref());
        scene.map_or(&[], |scene| &scene.scene.cameras)
    }

    /// The scene of the picture, for what is not baked: the open one, or that of the bake that was opened.
    pub fn lamp_scene(&self) -> Option<&Arc<PreparedScene>> {
        let opened = self.opened.as_ref()?;
        let of_bake = || match &opened.of_bake {
            Some(SceneOfBake::Found(scene)) => Some(scene),
            _ => None,
        };
        opened.scene.as_ref().or_else(of_bake)
    }

    /// What other looks than the present one are pictured from, as far as it is there.
    pub fn subject(&self) -> Option<Subject> {
        let shown = self.shown.as_ref()?;
        let view = self.lamp_scene().zip(shown.camera.as_ref()).map(|(scene, camera)| LampView {
            scene: scene.clone(),
            camera: camera.clone(),
            film: shown.film(),
            patches: shown.patches().cloned(),
            measures: shown.pixel_irradiance().is_some(),
        });
        Some(Subject { bake: shown.bake(), view })
    }

    /// Whether every part of what is shown is there: not so while a first picture comes in.
    pub fn is_whole(&self) -> bool {
        let is_coming = matches!(self.bake, BakeState::Preparing | BakeState::Running { pass: 0, .. });
        let is_there = |shown: &Shown| shown.frame.groups.iter().all(|group| group.blocks.iter().all(Option::is_some));
        self.shown.as_ref().is_some_and(|shown| !is_coming || is_there(shown))
    }

    /// What is new in the matrix since the last call.
    pub fn take_changed(&mut self) -> Changed {
        std::mem::take(&mut self.changed)
    }

    /// Opens something in the background; what is open stays until it is there.
    pub fn open(&mut self, source: Source) {
        self.stop_loading();
        self.stage = Stage::Loading(source.name());
        self.opening = source.path();
        self.opening_source = Some(source.clone());
        self.loading = self.spawn("open", move |post| {
            let name = source.name();
            let loaded = task::load(source).map_err(|error| format!("{error:#}"));
            let _ = post.send(Fact::Loaded(name, loaded), Duration::ZERO);
        });
    }

    /// Makes a light of the open scene a panel of texels; the scene is prepared again in the background.
    pub fn choose_panel(&mut self, node: String, resolution: u32) {
        self.choose(|chosen| {
            chosen.panels.retain(|panel| panel.node != node);
            chosen.panels.push(PanelRequest { node, resolution });
        });
    }

    /// Counts the lamps of the open scene otherwise; the scene is prepared again in the background.
    pub fn choose_units(&mut self, units: LampUnits) {
        self.choose(|chosen| chosen.units = units);
    }

    /// Puts a sky over the open scene; it is prepared again in the background.
    pub fn choose_sky(&mut self, sky: SkyRequest) {
        self.choose(|chosen| chosen.sky = Some(sky));
    }

    fn choose(&mut self, change: impl FnOnce(&mut Chosen)) {
        let of_scene = |opened: &Opened| Some((opened.scene.clone()?, opened.lamps.clone(), opened.chosen.clone()));
        let Some((scene, lamps, mut chosen)) = self.opened.as_ref().and_then(of_scene) else { return };
        change(&mut chosen);
        self.stop_loading();
        self.loading = self.spawn("prepare", move |post| {
            let prepared = task::prepare_again(&scene.scene, lamps, chosen).map_err(words);
            let _ = post.send(Fact::Prepared(prepared), Duration::ZERO);
        });
    }

    /// Number and size of the pictures that were opened, or that the opened bake is of.
    pub fn pictures(&self) -> Option<(usize, Film)> {
        let of_stack = || self.opened.as_ref()?.stack.as_ref().map(|stack| (stack.images.len(), stack.film));
        let of_bake = || {
            let header = &self.shown.as_ref()?.header;
            let film = Film { width: header.width, height: header.height };
            header.basis.is_measured().then(|| (header.basis.n_cols(), film))
        };
        of_stack().or_else(of_bake)
    }

    /// Starts a bake of the open scene or stack, ending one that runs; from a camera of its own, else from that of the settings.
    pub fn start_bake(&mut self, settings: &BakeSettings, camera: Option<Camera>, passes: Passes) {
        if let Some(stack) = self.opened.as_ref().and_then(|opened| opened.stack.clone()) {
            self.stop_baking();
            let BakeConfig { tolerance_db, seed, .. } = settings.config;
            self.history.clear();
            self.bake_began = Instant::now();
            let job = StackJob { stack, tolerance_db, seed, memory_bytes: MEMORY_BYTES };
            self.bake = BakeState::Preparing;
            self.baking = self.spawn("bake", move |post| task::bake_stack(job, post));
            return;
        }
        let Some(scene) = self.opened.as_ref().and_then(|opened| opened.scene.clone()) else {
            return;
        };
        let job = match self.job(settings, camera.clone()) {
            Ok(job) => job,
            Err(why) => {
                self.bake = BakeState::Failed(why);
                return;
            }
        };
        self.begun = Some(Begun::new(scene, settings.clone(), camera));
        self.begin(BakeJob { passes, ..job }, None);
    }

    /// Goes on with a bake that was stopped, where that can be.
    pub fn resume_bake(&mut self, settings: &BakeSettings) {
        if self.n_resumable(settings) > 0
            && let Ok(job) = self.job(settings, self.begun.as_ref().and_then(Begun::camera))
        {
            let half_done = self.half_done();
            self.begin(job, half_done);
        }
    }

    /// What would be baked with some settings, or why nothing can be.
    fn job(&self, settings: &BakeSettings, camera: Option<Camera>) -> Result<BakeJob, String> {
        const NO_CAMERA: &str = "the scene has no camera and no surfaces to look at; open a scene with meshes";
        let scene = self.opened.as_ref().and_then(|opened| opened.scene.clone()).ok_or("no scene is open; open one")?;
        let of_scene = || scene.scene.cameras.get(settings.camera_idx).cloned();
        let camera = camera.or_else(of_scene).ok_or(NO_CAMERA)?;
        let of_file = if settings.illuminance { OfFile::All } else { OfFile::Nothing };
        let irradiance = IrradianceRequest { of_file, ..IrradianceRequest::default() }.rows(&scene).map_err(words)?;
        let (film, config, passes) = (settings.film, settings.config.clone(), Passes::Progressive);
        Ok(BakeJob { scene, camera, film, config, passes, irradiance })
    }

    fn begin(&mut self, job: BakeJob, half_done: Option<HalfDone>) {
        self.stop_baking();
        self.views.baking = Some(job.camera.clone());
        self.bake = BakeState::Preparing;
        self.history.clear();
        self.bake_began = Instant::now();
        let (cache, focus) = (self.cache.clone(), self.focus.clone());
        let there = (half_done, self.earlier_bakes());
        self.baking = self.spawn("bake", move |post| task::bake(job, there, cache, &focus, post));
    }

    /// Stops the bake; what was done stays.
    pub fn cancel_bake(&mut self) {
        if self.bake.is_running() {
            let was_aside = self.is_aside();
            self.stop_baking();
            self.bake = if was_aside { self.state_of_shown() } else { BakeState::Stopped };
        }
    }

    /// Takes a file as the scene of the bake that was opened, in the background.
    pub fn find_scene(&mut self, path: PathBuf) {
        let Some(header) = self.shown.as_ref().map(|shown| shown.header.clone()) else { return };
        let task = self.spawn("scene", move |post| {
            let found = task::scene_of(&header, &path).map_err(|error| format!("{error:#}"));
            let _ = post.send(Fact::SceneFound(found), Duration::ZERO);
        });
        self.finding = task.as_ref().map(Task::id);
        self.others.extend(task);
        if let Some(opened) = &mut self.opened {
            opened.of_bake = Some(SceneOfBake::Waiting);
        }
    }

    fn scene_found(&mut self, found: Result<Box<PreparedScene>, String>) {
        self.finding = None;
        let Some(opened) = &mut self.opened else { return };
        opened.of_bake = Some(match found {
            Ok(scene) => {
                if let Some(shown) = &mut self.shown {
                    let named = || Camera::named(&scene.scene.cameras, &shown.header.camera);
                    shown.camera = shown.header.view.as_ref().or_else(named).cloned();
                }
                SceneOfBake::Found(Arc::from(scene))
            }
            Err(why) => SceneOfBake::Missing(why),
        });
    }

    /// Writes the picture under `look` in the background, with the light of its free lamps.
    pub fn export(&mut self, look: Look, light: Option<LampLight>, path: PathBuf, options: ExportOptions) {
        let Some(shown) = &self.shown else { return };
        let seen = Seen::of(shown, look, light);
        self.write(path.clone(), move || seen.save(&path, &options));
    }

    /// Makes the picture under `look` for the clipboard in the background; it comes as a notice.
    pub fn copy(&mut self, look: Look, light: Option<LampLight>) {
        let Some(shown) = &self.shown else { return };
        let seen = Seen::of(shown, look, light);
        let task = self.spawn("copy", move |post| {
            let developed = seen.develop().map_err(|error| format!("{error:#}"));
            let _ = post.send(Fact::Developed(developed), Duration::ZERO);
        });
        self.others.extend(task);
    }

    /// Writes the open scene with its lights under `look` in the background.
    pub fn export_gltf(&mut self, look: Look, path: PathBuf) {
        let opened = self.opened.as_ref().and_then(|opened| Some((opened.scene.clone()?, opened.source.clone()?)));
        let Some((scene, source)) = opened else { return };
        let task = self.spawn("write", move |post| task::write_gltf(&scene, source, &look, &path, &post));
        self.others.extend(task);
    }

    /// Writes the frames of a timeline in the background.
    pub fn export_frames(&mut self, sequence: Sequence) {
        let Some(subject) = self.subject() else { return };
        self.cancel_frames();
        let n_frames = sequence.n_frames();
        let task = self.spawn("frames", move |post| task::write_frames(&sequence, subject, &post));
        self.frames = task.map(|task| (task, (0, n_frames)));
    }

    /// Writes the pictures of looks on one sheet in the background.
    pub fn save_sheet(&mut self, snapshots: Vec<Snapshot>, path: PathBuf) {
        let Some(subject) = self.subject() else { return };
        let task = self.spawn("sheet", move |post| sheet::write(&snapshots, subject, &path, &post));
        self.others.extend(task);
    }

    /// Frames that are written, and how many there will be, while a sequence is under way.
    pub fn frames(&self) -> Option<(u32, u32)> {
        self.frames.as_ref().map(|(_, progress)| *progress)
    }

    /// Stops writing frames; those that are there stay.
    pub fn cancel_frames(&mut self) {
        self.others.extend(self.frames.take().map(|(task, _)| task.stopped()));
    }

    /// Writes the bake that is shown in the background.
    pub fn save_bake(&mut self, path: PathBuf) {
        let Some(shown) = &self.shown else { return };
        let bake = shown.bake();
        self.write(path.clone(), move || Ok(archive::write(&bake, &path)?));
    }

    fn write(&mut self, path: PathBuf, job: impl FnOnce() -> anyhow::Result<()> + Send + 'static) {
        let task = self.spawn("write", move |post| {
            let result = job().map(|()| format!("Saved {}", path.display())).map_err(|error| format!("{error:#}"));
            let _ = post.send(Fact::Written(result), Duration::ZERO);
        });
        self.others.extend(task);
    }

    fn spawn(&mut self, name: &str, body: impl FnOnce(Post) + Send + 'static) -> Option<Task> {
        self.n_tasks += 1;
        let post = Post::new(self.n_tasks, self.sender.clone(), self.wake.clone());
        match Task::start(name, post, body) {
            Ok(task) => Some(task),
            Err(error) => {
                // Sending to ourselves cannot block: the channel is drained on this very thread.
                let _ = self
                    .sender
                    .try_send((self.n_tasks, Fact::Written(Err(format!("no thread could be started: {error}")))));
                None
            }
        }
    }

    fn stop_loading(&mut self) {
        self.others.extend(self.loading.take().map(Task::stopped));
    }

    fn stop_baking(&mut self) {
        self.others.extend(self.baking.take().map(Task::stopped));
        std::mem::take(&mut self.focus).leave();
        self.incoming = None;
        self.drop_aside();
    }

    /// Takes in every fact that has arrived.
    pub fn drain(&mut self) -> Vec<Notice> {
        // Looked at before the channel: what a thread said before it ended is then in the channel.
        let ended = [&self.loading, &self.baking].map(|task| task.as_ref().filter(|t| t.is_finished()).map(Task::id));
        let mut ended_others = self.others.iter().filter(|task| task.is_finished()).map(Task::id);
        let ended_finding = ended_others.find(|id| self.finding == Some(*id));
        let facts: Vec<(u64, Fact)> = self.receiver.iter().flat_map(Receiver::try_iter).collect();
        let mut notices = Vec::new();
        for (id, fact) in facts {
            self.take(id, fact, &mut notices);
        }
        self.reap(ended, ended_finding, &mut notices);
        notices
    }

    fn take(&mut self, id: u64, fact: Fact, notices: &mut Vec<Notice>) {
        let is_of = |task: &Option<Task>| task.as_ref().is_some_and(|task| task.id() == id);
        match fact {
            Fact::Loaded(name, result) if is_of(&self.loading) => self.loaded(name, result, notices),
            Fact::Prepared(result) if is_of(&self.loading) => self.prepared_again(result, notices),
            Fact::Bake(event) if is_of(&self.baking) => self.bake_event(event),
            Fact::Remarks(remarks) if is_of(&self.baking) => self.remarked(remarks),
            Fact::Found(bake) if is_of(&self.baking) => self.bake_found(*bake, notices),
            Fact::BakeEnded(result) if is_of(&self.baking) => self.bake_ended(result, notices),
            Fact::SceneFound(found) if self.finding == Some(id) => self.scene_found(found),
            Fact::Frame(n_written) => {
                if let Some((_, (done, _))) = self.frames.as_mut().filter(|(task, _)| task.id() == id) {
                    *done = n_written;
                }
            }
            Fact::Written(Ok(words)) => notices.push(Notice::Said(words)),
            Fact::Written(Err(words)) | Fact::Developed(Err(words)) => notices.push(Notice::Failed(words)),
            Fact::Foreseen(answer) => self.foreseen(id, answer),
            Fact::Developed(Ok(picture)) => notices.push(Notice::Developed(picture)),
            // Facts of a task that was stopped no longer count.
            Fact::Loaded(..) | Fact::Prepared(_) | Fact::Bake(_) | Fact::Remarks(_) => {}
            Fact::Found(_) | Fact::BakeEnded(_) | Fact::SceneFound(_) => {}
        }
    }

    fn loaded(&mut self, name: String, result: Result<Loaded, String>, notices: &mut Vec<Notice>) {
        self.others.extend(self.loading.take());
        let loaded = match result {
            Ok(loaded) => loaded,
            Err(why) if self.opened.is_some() => {
                self.stage = Stage::Ready;
                notices.push(Notice::Failed(format!("{name} could not be opened: {why}")));
                return;
            }
            Err(why) => {
                self.stage = Stage::Failed(name, why);
                return;
            }
        };
        let path = self.opening.take();
        let source = self.opening_source.take();
        self.keep_earlier(source.as_ref());
        self.stop_baking();
        (self.bake, self.shown, self.error_db, self.figures) = (BakeState::Idle, None, None, None);
        self.forget_views();
        self.stage = Stage::Ready;
        self.history.clear();
        self.begun = None;
        match loaded {
            Loaded::Scene { scene, report } => {
                let lamps = scene.scene.punctual.clone();
                let (scene, chosen) = (Some(Arc::from(scene)), Chosen::default());
                self.opened =
                    Some(Opened { name, source, path, scene, stack: None, report, lamps, chosen, of_bake: None });
            }
            Loaded::Stack(stack) => {
                let (report, lamps, chosen) = (stack.remarks(), Vec::new(), Chosen::default());
                let stack = Some(Arc::new(stack));
                let (scene, source) = (None, None);
                self.opened = Some(Opened { name, source, path, scene, stack, report, lamps, chosen, of_bake: None });
            }
            Loaded::Bake(bake) => {
                let (report, lamps, chosen) = (Vec::new(), Vec::new(), Chosen::default());
                let folder = path.as_deref().and_then(Path::parent).map(Path::to_path_buf);
                let (scene, source) = (None, None);
                self.opened =
                    Some(Opened { name, source, path, scene, stack: None, report, lamps, chosen, of_bake: None });
                let folder = folder.filter(|_| !bake.header.basis.is_measured());
                let scene = folder.map(|folder| folder.join(&bake.header.scene));
                self.show_finished(bake);
                if let Some(path) = scene {
                    self.find_scene(path);
                }
            }
        }
        notices.push(Notice::Opened);
    }

    fn prepared_again(&mut self, result: Result<Prepared, String>, notices: &mut Vec<Notice>) {
        self.others.extend(self.loading.take());
        match (result, &mut self.opened) {
            (Ok(Prepared { scene, chosen, warnings }), Some(opened)) => {
                opened.scene = Some(Arc::from(scene));
                opened.chosen = chosen;
                for warning in warnings {
                    if !opened.report.contains(&warning) {
                        opened.report.push(warning);
                    }
                }
                let source = opened.source.clone();
                self.keep_earlier(source.as_ref());
                self.stop_baking();
                (self.bake, self.shown, self.error_db, self.figures) = (BakeState::Idle, None, None, None);
                self.forget_views();
                notices.push(Notice::PreparedAgain);
            }
            (Ok(_), None) => {}
            (Err(why), _) => notices.push(Notice::Failed(why)),
        }
    }

    fn remarked(&mut self, remarks: Vec<String>) {
        if let Some(opened) = &mut self.opened {
            opened
                .report
                .extend(remarks.into_iter().filter(|remark| !opened.report.contains(remark)).collect::<Vec<_>>());
        }
    }

    fn bake_event(&mut self, event: BakeEvent) {
        match event {
            BakeEvent::Started { header, n_blocks, n_passes } => {
                self.begun.iter_mut().for_each(|begun| begun.started(header.clone(), n_passes));
                self.pass_blocks = (n_blocks, 0);
                self.bake_started(header, n_passes);
            }
            BakeEvent::BlockDone { pass, block_idx, factors } => {
                self.begun.iter_mut().for_each(|begun| begun.block_done(pass, block_idx, &factors));
                self.pass_blocks.1 += 1;
                self.block_done(block_idx, &factors);
            }
            // It is shown once all of it is there.
            BakeEvent::IrradianceDone { .. } => {}
            BakeEvent::Progress { pass, done, secs_left } => {
                if let BakeState::Running { n_passes, .. } = self.bake {
                    let (n_blocks, n_done) = self.pass_blocks;
                    let pass_done = n_done as f32 / n_blocks.max(1) as f32;
                    self.bake = BakeState::Running { pass, n_passes, done, pass_done, secs_left };
                }
                if self.figures_at.elapsed() > FIGURES_EVERY {
                    self.count();
                }
            }
            BakeEvent::PassDone { error_db, .. } => {
                self.pass_blocks.1 = 0;
                if self.is_aside() {
                    return;
                }
                match self.incoming.take() {
                    Some(incoming) => self.show(incoming),
                    None => self.n_whole += 1,
                }
                self.error_db = Some(error_db);
                self.count();
            }
        }
    }

    fn bake_started(&mut self, header: Arc<BakeHeader>, n_passes: u32) {
        self.bake = BakeState::Running { pass: 0, n_passes, done: 0.0, pass_done: 0.0, secs_left: None };
        let camera = self.camera_of(&header);
        let frame = Frame { width: header.width, height: header.height, groups: header.empty_groups() };
        self.begin_view(Shown { header, camera, frame, irradiance: Vec::new(), packed: None });
    }

    /// The camera of the bake that runs, or of a bake of the scene that is open.
    fn camera_of(&self, header: &BakeHeader) -> Option<Camera> {
        let own = self.views.baking.as_ref().filter(|camera| camera.name == header.camera);
        own.or(header.view.as_ref()).or_else(|| Camera::named(self.cameras(), &header.camera)).cloned()
    }

    fn block_done(&mut self, block_idx: usize, factors: &[Arc<clerestory_nystrom::BlockFactors>]) {
        let is_shown = self.incoming.is_none();
        let Some(shown) = self.incoming.as_mut().or(self.shown.as_mut()) else { return };
        shown.packed = None;
        for (group, factors) in shown.frame.groups.iter_mut().zip(factors) {
            group.blocks[block_idx] = Some(factors.clone());
        }
        if is_shown {
            self.changed.absorb(Changed::Blocks((0..factors.len()).map(|group| (group, block_idx)).collect()));
        }
    }

    fn bake_ended(&mut self, result: Result<Option<Bake>, String>, notices: &mut Vec<Notice>) {
        self.others.extend(self.baking.take());
        let mut aside = self.incoming.take().filter(|_| self.is_aside());
        self.bake = match result {
            Ok(Some(bake)) => {
                let figures = bake.figures();
                self.history.push([self.bake_began.elapsed().as_secs_f32(), figures.error_db.total]);
                notices.push(Notice::Said(earlier::baked_words(&figures)));
                self.forget_earlier(&bake.header);
                // The file will hold these, a little less exact than the blocks that came one by one.
                if let Some(shown) = aside.as_mut().or(self.shown.as_mut()) {
                    (shown.header, shown.frame.groups) = (bake.header, bake.groups);
                    (shown.irradiance, shown.packed) = (bake.irradiance, bake.packed);
                }
                match aside.take() {
                    Some(shown) => self.keep_aside(shown, Some(figures.error_db)),
                    None => {
                        self.error_db = Some(figures.error_db);
                        self.is_another();
                    }
                }
                BakeState::Done
            }
            Ok(None) => BakeState::Stopped,
            Err(why) => BakeState::Failed(why),
        };
        self.drop_aside();
        self.count();
    }

    /// The bake was made before.
    fn bake_found(&mut self, bake: Bake, notices: &mut Vec<Notice>) {
        self.others.extend(self.baking.take());
        self.incoming = None;
        self.drop_aside();
        self.show_finished(bake);
        let db = self.error_db.map_or(f32::NAN, |error| error.total);
        notices.push(Notice::Said(format!("Baked before: {db:.1} dB")));
    }

    /// Shows a bake that was made before.
    fn show_finished(&mut self, bake: Bake) {
        let Bake { header, groups, irradiance, packed } = bake;
        let camera = self.camera_of(&header);
        let frame = Frame { width: header.width, height: header.height, groups };
        let found = Shown { header, camera, frame, irradiance, packed };
        self.begin_view(found);
        // The same view as before: what was found takes its place.
        if let Some(found) = self.incoming.take() {
            self.show(found);
        }
        self.bake = BakeState::Done;
        self.count();
        self.error_db = self.figures.as_ref().map(|figures| figures.error_db);
    }

    fn show(&mut self, shown: Shown) {
        self.shown = Some(shown);
        self.is_another();
    }

    /// Another matrix is shown: what was made of the one before no longer counts.
    fn is_another(&mut self) {
        self.n_whole += 1;
        self.changed = Changed::All;
    }

    /// Counts ranks and bytes of what is there.
    fn count(&mut self) {
        self.figures = self.shown.as_ref().map(|shown| shown.bake().figures());
        (self.figures_at, self.n_counts) = (Instant::now(), self.n_counts + 1);
        // Before the first block there is no error to speak of.
        let counted = self.figures.as_ref().filter(|figures| figures.max_rank > 0 && self.bake.is_running());
        if let Some(figures) = counted {
            self.history.push([self.bake_began.elapsed().as_secs_f32(), figures.error_db.total]);
        }
    }

    /// How often the blocks that are there were counted; what is made of them is as new as that.
    pub fn n_counts(&self) -> u64 {
        self.n_counts
    }

    /// Joins threads that have ended; one that ended without a last word has panicked.
    fn reap(&mut self, ended: [Option<u64>; 2], ended_finding: Option<u64>, notices: &mut Vec<Notice>) {
        let has_crashed =
            |task: &Option<Task>, ended: Option<u64>| ended.is_some() && task.as_ref().map(Task::id) == ended;
        if has_crashed(&self.loading, ended[0]) {
            self.others.extend(self.loading.take());
            self.stage =
                if self.opened.is_some() { Stage::Ready } else { Stage::Failed("the file".into(), crash::words()) };
            notices.push(Notice::Failed(format!("opening failed: {}", crash::words())));
        }
        if has_crashed(&self.baking, ended[1]) {
            self.others.extend(self.baking.take());
            self.bake = BakeState::Failed(crash::words());
        }
        if ended_finding.is_some() && ended_finding == self.finding {
            self.scene_found(Err(crash::words()));
        }
        if self.frames.as_ref().is_some_and(|(task, _)| task.is_finished()) {
            self.others.extend(self.frames.take().map(|(task, _)| task));
        }
        let (done, running) = std::mem::take(&mut self.others).into_iter().partition(Task::is_finished);
        self.others = running;
        let done: Vec<Task> = done;
        done.into_iter().for_each(Task::join);
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.stop_loading();
        self.stop_baking();
        self.cancel_frames();
        self.forget_forecast();
        // Without a receiver nobody waits for room in the channel.
        self.receiver = None;
        self.others.drain(..).for_each(Task::join);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wait(session: &mut Session, until: impl Fn(&Session) -> bool) {
        for _ in 0..10_000 {
            session.drain();
            if until(session) {
                return;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        panic!("it never came about: {:?}, {:?}", session.stage, session.bake);
    }

    #[test]
    fn what_panics_is_told_and_the_session_lives_on() {
        let mut session = Session::new(Arc::new(|_| {}));
        session.bake = BakeState::Preparing;
        session.baking = session.spawn("bake", |_| panic!("injected by a test of the session"));
        wait(&mut session, |session| !session.bake.is_running());
        assert!(matches!(&session.bake, BakeState::Failed(words) if words.contains("ended unexpectedly")));
        let bytes = include_bytes!("../tests/room.gltf").to_vec();
        session.open(Source::Bytes { name: "room.gltf".into(), bytes });
        wait(&mut session, |session| session.stage == Stage::Ready);
    }

    #[test]
    fn a_first_picture_is_whole_once_every_block_is_there() {
        let mut session = Session::new(Arc::new(|_| {}));
        assert!(!session.is_whole(), "nothing is shown");
        let bytes = include_bytes!("../tests/room.gltf").to_vec();
        session.open(Source::Bytes { name: "room.gltf".into(), bytes });
        wait(&mut session, |session| session.stage == Stage::Ready);
        let config = BakeConfig { spp: 2, tolerance_db: 10.0, ..BakeConfig::default() };
        let film = Film { width: 32, height: 24 };
        let settings = BakeSettings { camera_idx: 0, film, config, illuminance: false };
        session.start_bake(&settings, None, Passes::Progressive);
        wait(&mut session, |session| session.bake == BakeState::Done);
        assert!(session.is_whole());
        session.bake = BakeState::Preparing;
        assert!(session.is_whole(), "a view that is there stays while another is baked");
        session.shown.as_mut().expect("a picture is shown").frame.groups[0].blocks[0] = None;
        assert!(!session.is_whole());
    }
}
