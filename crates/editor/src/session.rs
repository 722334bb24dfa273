//! What is open, what is being baked, and the threads that do it. The window asks and drains; it never waits.

pub mod aside;
mod baking;
mod begun;
mod chosen;
mod earlier;
pub mod estimate;
mod found;
pub mod glimpse;
pub mod lamps;
mod mailbox;
mod opened;
pub mod preview;
pub mod prints;
mod room;
mod seen;
pub mod shares;
mod sheet;
mod shown;
pub mod sky;
mod task;
pub mod views;
pub mod worker;
mod writing;

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use clerestory_nystrom::BlockLowRank;
use clerestory_transport::bake::focus::Focus;
use clerestory_transport::bake::{Bake, BakeConfig, BakeHeader};
use clerestory_transport::basis::LightBasis;
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::figures::{ErrorDb, Figures};
use clerestory_transport::sensors::WorkPlane;
use eframe::egui::ColorImage;

use self::baking::PassBlocks;
use self::begun::Begun;
use self::estimate::Forecasting;
use self::lamps::LampView;
use self::room::RoomSeen;
use crate::bake_cache::BakeCache;
use crate::crash;
use crate::picture::Changed;
use crate::stills::Subject;
pub use chosen::{Chosen, ChosenSky};
pub(crate) use found::{as_baked, what_differs};
pub use opened::{Opened, SceneOfBake};
pub use shown::Shown;
use task::{Fact, Post, Task};
pub use task::{Loaded, Source};
use views::Views;

/// Asks for a repaint after the given time; called from any thread.
pub type Wake = Arc<dyn Fn(Duration) + Send + Sync>;

/// Facts that may wait for the window.
const CHANNEL_LEN: usize = 4096;

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
    /// A level grid of sensors that is baked with them.
    pub work_plane: Option<WorkPlane>,
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
    /// The scene cannot be had with what was chosen, in words; it stays as it is.
    NotPrepared(String),
    /// What was to be opened is not; why is told apart from this.
    NotOpened,
    /// The scene of the bake that was opened is there.
    SceneFound,
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
    /// What writes a bake to a file, and which one; and the bake that was written last.
    saving: Option<(u64, Arc<BakeHeader>)>,
    saved: Option<Arc<BakeHeader>>,
    /// Path of what is being opened.
    opening: Option<PathBuf>,
    opening_source: Option<Source>,
    /// What was read and takes the place of what is open as soon as that may go.
    arrived: Option<(String, Loaded)>,
    /// Whether what is open may not go yet.
    pub holds_opened: bool,
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
    /// Matrices of irradiance that the bake has not made yet, behind those that are shown.
    arriving: VecDeque<Vec<BlockLowRank>>,
    /// Other views than the one that is shown.
    views: Views,
    /// What is new in `shown` since it was last asked for.
    changed: Changed,
    /// How far the pass of the bake that runs is.
    pass_blocks: PassBlocks,
    /// Error measured at the end of the last pass.
    pub error_db: Option<ErrorDb>,
    /// Ranks and bytes of what is shown.
    pub figures: Option<Figures>,
    figures_at: Instant,
    /// Grows with every picture that is whole: a preview, a finished pass, a bake from a file.
    pub n_whole: u64,
    n_counts: u64,
    /// Whether finer blocks of irradiance took their place since the last count.
    has_finer_lux: bool,
    n_lux: u64,
    /// Seconds since the bake began, and its error at that time in dB.
    pub history: Vec<[f32; 2]>,
    bake_began: Instant,
    begun: Option<Begun>,
    /// Bakes of the scene as it was before it was read or prepared again.
    earlier: Vec<Bake>,
    forecasting: Forecasting,
    room_seen: RoomSeen,
    /// Where somebody looks while a bake runs.
    focus: Arc<Focus>,
    /// Where finished bakes of scenes are found and kept.
    pub cache: Option<BakeCache>,
    /// The most memory that the whole program may take, bytes; what the system has left where nobody says.
    pub memory_limit: Option<u64>,
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
            saving: None,
            saved: None,
            opening: None,
            opening_source: None,
            arrived: None,
            holds_opened: false,
            stage: Stage::Empty,
            opened: None,
            bake: BakeState::Idle,
            shown: None,
            incoming: None,
            arriving: VecDeque::new(),
            views: Views::default(),
            changed: Changed::default(),
            pass_blocks: PassBlocks::default(),
            error_db: None,
            figures: None,
            figures_at: Instant::now(),
            n_whole: 0,
            n_counts: 0,
            has_finer_lux: false,
            n_lux: 0,
            history: Vec::new(),
            bake_began: Instant::now(),
            begun: None,
            earlier: Vec::new(),
            forecasting: Forecasting::default(),
            room_seen: RoomSeen::default(),
            focus: Arc::default(),
            cache: None,
            memory_limit: None,
        }
    }

    /// The columns of what is open, as soon as they are known.
    pub fn basis(&self) -> Option<&LightBasis> {
        let of_scene = || self.opened.as_ref()?.scene.as_ref().map(|scene| &scene.lighting.basis);
        self.shown.as_ref().map(|shown| &shown.header.basis).or_else(of_scene)
    }

    /// Whether a scene is open that can be baked; a bake has one once its own was found.
    pub fn has_scene(&self) -> bool {
        self.opened.as_ref().is_some_and(|opened| opened.scene.is_some())
    }

    /// Cameras of the scene that is open, or of the one that was baked.
    pub fn cameras(&self) -> &[Camera] {
        self.lamp_scene().map_or(&[], |scene| &scene.scene.cameras)
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
            bounces: shown.header.config.bounces,
            device: None,
        });
        Some(Subject { bake: shown.bake(), view })
    }

    /// Whether every part of what is shown is there: not so while a first picture comes in.
    pub fn is_whole(&self) -> bool {
        let is_coming = matches!(self.bake, BakeState::Preparing | BakeState::Running { pass: 0, .. });
        self.shown.as_ref().is_some_and(|shown| !is_coming || shown.is_whole())
    }

    /// Whether what is shown is a first look, traced at few pixels.
    pub fn is_glimpse(&self) -> bool {
        self.shown.as_ref().is_some_and(|shown| shown.is_glimpse)
    }

    /// What is new in the matrix since the last call.
    pub fn take_changed(&mut self) -> Changed {
        std::mem::take(&mut self.changed)
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
        self.arrived = None;
        self.others.extend(self.loading.take().map(Task::stopped));
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
        self.take_arrived(&mut notices);
        notices
    }

    fn take(&mut self, id: u64, fact: Fact, notices: &mut Vec<Notice>) {
        let is_of = |task: &Option<Task>| task.as_ref().is_some_and(|task| task.id() == id);
        match fact {
            Fact::Loaded(name, result) if is_of(&self.loading) => self.loaded(name, result, notices),
            Fact::Prepared(result) if is_of(&self.loading) => self.prepared_again(result, notices),
            Fact::Bake(event) if is_of(&self.baking) => self.bake_event(event),
            Fact::Glimpsed(glimpse) if is_of(&self.baking) => self.glimpsed(glimpse),
            Fact::Remarks(remarks) if is_of(&self.baking) => self.remarked(remarks),
            Fact::Found(bake) if is_of(&self.baking) => self.bake_found(*bake, notices),
            Fact::BakeEnded(result) if is_of(&self.baking) => self.bake_ended(result, notices),
            Fact::SceneFound(found) if self.finding == Some(id) => self.scene_found(found, notices),
            Fact::Frame(n_written) => {
                if let Some((_, (done, _))) = self.frames.as_mut().filter(|(task, _)| task.id() == id) {
                    *done = n_written;
                }
            }
            Fact::Written(Ok(words)) => {
                self.written(id);
                notices.push(Notice::Said(words));
            }
            Fact::Written(Err(words)) | Fact::Developed(Err(words)) | Fact::Warned(words) => {
                notices.push(Notice::Failed(words));
            }
            Fact::Foreseen(answer) => self.foreseen(id, answer),
            Fact::Developed(Ok(picture)) => notices.push(Notice::Developed(picture)),
            // Facts of a task that was stopped no longer count.
            Fact::Loaded(..) | Fact::Prepared(_) | Fact::Bake(_) | Fact::Glimpsed(_) | Fact::Remarks(_) => {}
            Fact::Found(_) | Fact::BakeEnded(_) | Fact::SceneFound(_) => {}
        }
    }

    /// Joins threads that have ended; one that ended without a last word has panicked.
    fn reap(&mut self, ended: [Option<u64>; 2], ended_finding: Option<u64>, notices: &mut Vec<Notice>) {
        let has_crashed =
            |task: &Option<Task>, ended: Option<u64>| ended.is_some() && task.as_ref().map(Task::id) == ended;
        if has_crashed(&self.loading, ended[0]) {
            self.others.extend(self.loading.take());
            self.loading_crashed(notices);
        }
        if has_crashed(&self.baking, ended[1]) {
            let words = crash::words();
            notices.push(Notice::Failed(format!("the bake failed and can be started again: {words}")));
            self.bake_ended(Err(words), notices);
        }
        if ended_finding.is_some() && ended_finding == self.finding {
            self.scene_found(Err(crash::words()), notices);
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
        self.stop_finding();
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
    use clerestory_transport::bake::Passes;

    use super::*;
    use crate::headless::GALLERY;
    use crate::support::room_source;

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
        let mut notices = Vec::new();
        while session.bake.is_running() {
            notices.extend(session.drain());
            std::thread::sleep(Duration::from_millis(2));
        }
        assert!(matches!(&session.bake, BakeState::Failed(words) if words.contains("ended unexpectedly")));
        let [Notice::Failed(words)] = notices.as_slice() else { panic!("{notices:?}") };
        assert!(words.starts_with("the bake failed and can be started again: it ended unexpectedly"), "{words}");
        session.open(room_source());
        wait(&mut session, |session| session.stage == Stage::Ready);
    }

    #[test]
    fn a_bake_whose_keeping_panics_is_told_not_to_be_kept() {
        let mut session = Session::new(Arc::new(|_| {}));
        let keeping = session.spawn("bake", |post| task::keep(&post, || panic!("injected by a test of the session")));
        session.others.extend(keeping);
        let mut notices = Vec::new();
        while notices.is_empty() {
            notices.extend(session.drain());
            std::thread::sleep(Duration::from_millis(2));
        }
        let [Notice::Failed(words)] = notices.as_slice() else { panic!("{notices:?}") };
        assert!(words.starts_with("the bake is not kept") && words.contains("ended unexpectedly"), "{words}");
    }

    #[test]
    fn what_is_being_opened_can_be_given_up() {
        let mut session = Session::new(Arc::new(|_| {}));
        session.open(Source::BuiltIn);
        session.cancel_opening();
        wait(&mut session, |session| session.others.is_empty());
        assert!(session.stage == Stage::Empty && session.opened.is_none(), "{:?}", session.stage);
        session.open(Source::BuiltIn);
        wait(&mut session, |session| session.stage == Stage::Ready);
        let name = |session: &Session| session.opened.as_ref().map(|opened| opened.name.clone());
        session.open(Source::Bytes { name: "another".into(), bytes: GALLERY.to_vec() });
        session.cancel_opening();
        wait(&mut session, |session| session.others.is_empty());
        assert_eq!((session.stage.clone(), name(&session)), (Stage::Ready, Some("Gallery".into())));
    }

    #[test]
    fn a_file_that_cannot_be_written_ends_no_opening() {
        let mut session = Session::new(Arc::new(|_| {}));
        let until_open = |session: &mut Session| {
            let mut notices = Vec::new();
            while session.is_opening() || !session.others.is_empty() {
                notices.extend(session.drain());
                std::thread::sleep(Duration::from_millis(2));
            }
            notices
        };
        session.open(Source::BuiltIn);
        let writing = session.spawn("write", |post| {
            let _ = post.send(Fact::Written(Err("no room".into())), Duration::ZERO);
        });
        session.others.extend(writing);
        let notices = until_open(&mut session);
        assert!(
            notices.contains(&Notice::Failed("no room".into())) && notices.contains(&Notice::Opened),
            "{notices:?}"
        );
        assert!(!notices.contains(&Notice::NotOpened));
        session.open(Source::File("nothing.glb".into()));
        let notices = until_open(&mut session);
        assert!(matches!(notices.as_slice(), [Notice::NotOpened, Notice::Failed(_)]), "{notices:?}");
    }

    #[test]
    fn what_was_read_waits_until_what_is_open_may_go() {
        let mut session = Session::new(Arc::new(|_| {}));
        session.open(Source::BuiltIn);
        session.holds_opened = true;
        wait(&mut session, Session::has_arrived);
        assert!(session.drain().is_empty() && session.is_opening() && session.opened.is_none());
        session.holds_opened = false;
        assert_eq!(session.drain(), [Notice::Opened]);
        assert_eq!(session.stage, Stage::Ready);
    }

    #[test]
    fn the_scene_of_a_bake_that_went_is_none_of_what_is_open() {
        let mut session = Session::new(Arc::new(|_| {}));
        let (find, found) = std::sync::mpsc::channel::<()>();
        let finding = session.spawn("scene", move |post| {
            let _ = found.recv();
            let _ = post.send(Fact::SceneFound(Err("it is not there".into())), Duration::ZERO);
        });
        session.finding = finding.as_ref().map(Task::id);
        session.others.extend(finding);
        session.open(room_source());
        wait(&mut session, |session| session.stage == Stage::Ready);
        find.send(()).unwrap();
        wait(&mut session, |session| session.others.is_empty());
        let opened = session.opened.as_ref().unwrap();
        assert!(opened.scene.is_some() && !opened.is_bake());
    }

    #[test]
    fn what_was_made_of_blocks_is_old_once_another_view_is_shown() {
        let mut session = Session::new(Arc::new(|_| {}));
        session.open(room_source());
        wait(&mut session, |session| session.stage == Stage::Ready);
        let config = BakeConfig { spp: 2, tolerance_db: 10.0, ..BakeConfig::default() };
        let film = Film { width: 16, height: 12 };
        let settings = BakeSettings { camera_idx: 0, film, config, illuminance: false, work_plane: None };
        let mut camera = session.cameras()[0].clone();
        for _ in 0..2 {
            camera.yfov_rad *= 0.9;
            session.start_bake(&settings, Some(camera.clone()), Passes::Progressive);
            wait(&mut session, |session| session.bake == BakeState::Done);
        }
        let views = session.views();
        let other = views.iter().find(|view| !view.is_shown).expect("the first view is kept").id;
        let before = session.n_counts();
        session.show_view(other);
        assert!(session.n_counts() > before, "the map of errors is that of the other view");
    }

    #[test]
    fn a_first_picture_is_whole_once_every_block_is_there() {
        let mut session = Session::new(Arc::new(|_| {}));
        assert!(!session.is_whole(), "nothing is shown");
        session.open(room_source());
        wait(&mut session, |session| session.stage == Stage::Ready);
        let config = BakeConfig { spp: 2, tolerance_db: 10.0, ..BakeConfig::default() };
        let film = Film { width: 32, height: 24 };
        let settings = BakeSettings { camera_idx: 0, film, config, illuminance: false, work_plane: None };
        session.start_bake(&settings, None, Passes::Progressive);
        wait(&mut session, |session| session.bake == BakeState::Done);
        assert!(session.is_whole());
        session.bake = BakeState::Preparing;
        assert!(session.is_whole(), "a view that is there stays while another is baked");
        let shown = session.shown.as_mut().expect("a picture is shown");
        Arc::make_mut(&mut shown.frame).groups[0].blocks[0] = None;
        assert!(!session.is_whole());
    }
}
