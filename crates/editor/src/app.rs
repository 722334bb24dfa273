//! The window: `logic()` drains facts and applies requests, `ui()` draws and lets the look be edited.

mod camera;
mod daylight;
mod export;
mod focus;
mod follow;
mod heat;
mod lamplight;
mod lamps;
mod look_files;
mod looks;
mod probe;
mod recovery;
mod rest;
mod sky;
mod solving;
mod strips;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Result, anyhow};
use clerestory_transport::bake::{BakeConfig, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::light::LightRig;
use eframe::egui::{self, Context, Panel, ThemePreference, Ui, ViewportCommand, util::undoer::Undoer};
use eframe::egui_wgpu::{WgpuSetup, WgpuSetupCreateNew};
use eframe::{CreationContext, Storage, wgpu};

use crate::action::{Action, FileTask, dropped};
use crate::bake_cache::BakeCache;
use crate::crash;
use crate::export::ExportOptions;
use crate::look::{Display, Look};
use crate::panels::bake::{BakeView, QUALITIES, bake_ui};
use crate::panels::dialogs::{FileDialogs, FileQuestion, UnsavedAnswer, unsaved_ui};
use crate::panels::display::{DisplayView, display_ui};
use crate::panels::heat::HeatMap;
use crate::panels::lights::{LightsState, lights_ui, solo_banner_ui};
use crate::panels::looks::LooksState;
use crate::panels::shortcuts::{shortcuts_ui, take_keys};
use crate::panels::status::{MessageTone, Status, status_ui};
use crate::panels::toolbar::{ToolbarState, toolbar_ui};
use crate::session::{BakeSettings, Notice, Session, Source};
use crate::theme;
use crate::viewport::{ViewState, Viewed, viewport_ui};
use camera::CameraDesk;
use daylight::Daylight;
use follow::Follower;
use look_files::LookFiles;
use looks::Prints;
use probe::Prober;
use recovery::Recovery;
use solving::Solving;

/// Width of a picture that is baked without being asked for.
const DEFAULT_WIDTH_PX: u32 = 640;
/// Points that picture and right panel keep when the lights take room.
const PICTURE_LEAST: f32 = 660.0;
/// Cores from which the standard quality is what a bake starts with.
const MANY_CORES: usize = 8;
/// Recent files that are remembered.
const MAX_RECENT: usize = 8;
const RECENT_KEY: &str = "recent";
const LIGHTS_KEY: &str = "lights";
const EXPORT_KEY: &str = "export";
/// Set once the welcome was read.
const WELCOMED_KEY: &str = "welcomed";

/// How the window starts.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// What is opened.
    pub source: Source,
    /// How scenes are baked; by default one that suits the machine.
    pub settings: Option<BakeSettings>,
    /// Folder in which unsaved looks are kept for a crash; without one they are not.
    pub unsaved: Option<PathBuf>,
    /// Where finished bakes are found and kept; without it every bake is made anew.
    pub cache: Option<BakeCache>,
    /// Where files are asked for.
    pub dialogs: FileDialogs,
    /// Whether somebody who was never here before is welcomed.
    pub welcome: bool,
}

impl Start {
    /// With nothing of the user's: no folders and no dialogs of the desktop.
    pub fn alone(source: Source, settings: Option<BakeSettings>) -> Start {
        Start { source, settings, unsaved: None, cache: None, dialogs: FileDialogs::FieldOnly, welcome: false }
    }
}

/// The window.
pub struct App {
    session: Session,
    look: Look,
    saved_look: Look,
    look_path: Option<PathBuf>,
    look_files: LookFiles,
    undoer: Undoer<Look>,
    settings: BakeSettings,
    fixed_settings: Option<BakeSettings>,
    /// How pictures are baked: no machine is too slow for a fine tolerance.
    stack_settings: BakeSettings,
    lights: LightsState,
    view: ViewState,
    follower: Follower,
    looks: LooksState,
    prints: Prints,
    prober: Prober,
    camera: CameraDesk,
    daylight: Daylight,
    solving: Solving,
    actions: Vec<Action>,
    question: Option<FileQuestion>,
    dialogs: FileDialogs,
    unsaved: Option<Action>,
    /// What waits until the look is saved.
    after_saving: Option<Action>,
    /// Where the lamp goes whose profile is being asked for.
    profile_at_px: Option<[f32; 2]>,
    shortcuts: bool,
    /// How pictures are written.
    export: ExportOptions,
    heat_map: HeatMap,
    heat: Option<heat::Heat>,
    recovery: Recovery,
    message: (String, MessageTone),
    watched: strips::Watched,
    /// The scene that is being opened is the same one, changed.
    keeps_look: bool,
    is_new_here: bool,
    /// Memory in use, and when it was asked for, seconds.
    memory: (Option<u64>, f64),
    recent: Vec<PathBuf>,
    title: String,
}

/// Opens the window and stays until it is closed.
///
/// # Errors
/// If there is no display or no graphics driver.
pub fn run(open: Option<PathBuf>) -> Result<()> {
    let source = open.map_or(Source::BuiltIn, Source::File);
    let mut options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("Clerestory")
            .with_app_id("clerestory")
            .with_inner_size([1440.0, 900.0])
            .with_min_inner_size([900.0, 600.0])
            .with_drag_and_drop(true),
        renderer: eframe::Renderer::Wgpu,
        ..Default::default()
    };
    options.wgpu_options.wgpu_setup = WgpuSetup::CreateNew(WgpuSetupCreateNew {
        device_descriptor: Arc::new(device_descriptor),
        ..WgpuSetupCreateNew::without_display_handle()
    });
    if let Some(folder) = eframe::storage_dir("clerestory") {
        crash::keep_reports(folder.join("crashes"));
    }
    let start = Start {
        source,
        settings: None,
        unsaved: recovery::folder(),
        cache: BakeCache::of_user()?,
        dialogs: FileDialogs::Desktop,
        welcome: true,
    };
    let result = eframe::run_native("clerestory", options, Box::new(|cc| Ok(Box::new(App::new(cc, start)?))));
    result.map_err(|error| anyhow!("{error}"))
}

/// Everything that the adapter can do: factors of a large bake exceed the default limits.
fn device_descriptor(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
    wgpu::DeviceDescriptor { label: Some("clerestory"), required_limits: adapter.limits(), ..Default::default() }
}

impl App {
    /// Makes the window's content and starts to open `start.source`.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn new(cc: &CreationContext<'_>, start: Start) -> Result<App> {
        theme::apply(&cc.egui_ctx);
        if cc.storage.is_none_or(|storage| storage.get_string(RECENT_KEY).is_none()) {
            cc.egui_ctx.set_theme(ThemePreference::Dark);
        }
        let recent = cc.storage.and_then(|storage| eframe::get_value(storage, RECENT_KEY)).unwrap_or_default();
        let was_welcomed = cc.storage.is_some_and(|storage| storage.get_string(WELCOMED_KEY).is_some());
        let layout = cc.storage.and_then(|storage| eframe::get_value(storage, LIGHTS_KEY)).unwrap_or_default();
        let lights = LightsState::new(layout);
        let ctx = cc.egui_ctx.clone();
        let wake: crate::session::Wake = Arc::new(move |soon| ctx.request_repaint_after(soon));
        let mut session = Session::new(wake.clone());
        session.cache = start.cache;
        session.open(start.source);
        let (recovery, problem) = Recovery::start(start.unsaved.as_deref());
        Ok(App {
            session,
            look: Look::default(),
            saved_look: Look::default(),
            look_path: None,
            look_files: LookFiles::new(wake.clone()),
            undoer: Undoer::default(),
            settings: start.settings.clone().unwrap_or_else(default_settings),
            fixed_settings: start.settings,
            stack_settings: BakeSettings { config: BakeConfig::default(), ..default_settings() },
            lights,
            view: ViewState::default(),
            follower: Follower::new(cc.wgpu_render_state.as_ref(), wake.clone())?,
            looks: LooksState::default(),
            prints: Prints::new(wake.clone())?,
            solving: Solving::new(wake.clone()),
            prober: Prober::default(),
            daylight: Daylight::new(wake.clone()),
            camera: CameraDesk::start(cc, wake)?,
            actions: Vec::new(),
            question: None,
            dialogs: start.dialogs,
            unsaved: None,
            after_saving: None,
            profile_at_px: None,
            shortcuts: false,
            export: cc.storage.and_then(|storage| eframe::get_value(storage, EXPORT_KEY)).unwrap_or_default(),
            heat_map: HeatMap::default(),
            heat: None,
            recovery,
            message: problem.map_or((String::new(), MessageTone::Calm), |words| (words, MessageTone::Problem)),
            watched: strips::Watched::default(),
            keeps_look: false,
            is_new_here: start.welcome && !was_welcomed,
            memory: (None, f64::MIN),
            recent,
            title: String::new(),
        })
    }

    /// The look as it is now.
    pub fn look(&self) -> &Look {
        &self.look
    }

    /// What is open and what runs.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// How the bake panel is set.
    pub fn settings(&self) -> &BakeSettings {
        &self.settings
    }

    /// Key of the light that was chosen in the picture.
    pub fn chosen_light(&self) -> Option<&str> {
        self.lights.chosen.as_deref()
    }

    /// Number of pictures that were made since the window opened.
    pub fn n_pictures(&self) -> u64 {
        self.follower.n_pictures()
    }

    /// Whether no bake runs and the picture shows the look as it is.
    pub fn is_settled(&self) -> bool {
        !self.session.bake.is_running() && self.follower.is_idle() && self.prints.is_idle()
    }

    /// Exposure of the picture that is shown, EV.
    pub fn shown_ev(&self) -> f32 {
        self.follower.shown_ev()
    }

    fn is_unsaved(&self) -> bool {
        self.look != self.saved_look
    }

    fn say(&mut self, words: impl Into<String>) {
        self.message = (words.into(), MessageTone::Calm);
    }

    fn complain(&mut self, words: impl Into<String>) {
        self.message = (words.into(), MessageTone::Problem);
    }

    fn notice(&mut self, ctx: &Context, notice: Notice) {
        match notice {
            Notice::Opened => self.scene_opened(),
            Notice::PreparedAgain => self.start_bake(),
            Notice::SceneFound => self.scene_of_bake_found(),
            Notice::Said(words) => self.say(words),
            Notice::Developed(picture) => self.copied(ctx, picture),
            Notice::Failed(words) => {
                self.leave_behind();
                self.keeps_look = false;
                self.complain(words);
            }
        }
    }

    fn scene_opened(&mut self) {
        let keeps_look = std::mem::take(&mut self.keeps_look);
        if !keeps_look {
            (self.look, self.saved_look, self.look_path) = (Look::default(), Look::default(), None);
            self.undoer = Undoer::default();
        }
        (self.export.width_px, self.export.region) = (None, None);
        self.watch_opened();
        self.lights = LightsState::new(self.lights.layout);
        self.view = ViewState::default();
        self.camera.put_down();
        self.camera.camera = self.session.cameras().get(self.settings.camera_idx).cloned();
        self.follower.forget();
        self.prints.forget();
        self.looks = LooksState::default();
        self.solving.forget();
        self.daylight.forget();
        self.say(self.session.opened.as_ref().map_or(String::new(), |opened| format!("Opened {}", opened.name)));
        if let (None, Some(camera)) = (&self.fixed_settings, self.session.cameras().first()) {
            self.settings.camera_idx = 0;
            self.settings.film = Film::of_width(DEFAULT_WIDTH_PX, camera);
        }
        self.take_up();
        if let (true, Some(basis)) = (keeps_look, self.session.basis()) {
            let lost = self.look.unheeded(basis);
            if !lost.is_empty() {
                self.complain(format!("Opened again: {}", lost.join(", ")));
            }
        }
        self.start_bake();
    }

    /// The bake that was opened is one of its scene from now on, baked as it was.
    fn scene_of_bake_found(&mut self) {
        self.adopt_view();
        if let (None, Some(settings)) = (&self.fixed_settings, self.session.settings_of_shown()) {
            self.settings = settings;
        }
    }

    /// Starts what somebody asked for.
    fn bake_as_asked(&mut self) {
        match self.session.opened.as_ref() {
            Some(opened) if opened.scene.is_some() || opened.stack.is_some() => self.start_bake(),
            _ => self.complain("a bake alone cannot be baked again; open its scene"),
        }
    }

    fn start_bake(&mut self) {
        let is_stack = self.session.opened.as_ref().is_some_and(|opened| opened.stack.is_some());
        let settings = if is_stack { &self.stack_settings } else { &self.settings };
        let camera = self.camera.camera.clone().filter(|_| !is_stack);
        self.session.start_bake(settings, camera, Passes::Progressive);
        self.camera.put_down();
    }

    fn apply(&mut self, ctx: &Context, action: Action) {
        match action {
            Action::Ask(task) => self.ask(task),
            Action::Open(path) => self.unless_unsaved(Action::Open(path.clone()), |app| app.open(path)),
            Action::OpenBuiltIn => self.unless_unsaved(Action::OpenBuiltIn, |app| app.session.open(Source::BuiltIn)),
            Action::OpenLook(path) => self.open_look(path),
            Action::SaveLook(path) => self.save_look(path),
            Action::SaveLookAgain => self.save_look_again(),
            Action::ExportImage(path) => self.export(path),
            Action::CopyImage => self.copy_image(),
            Action::SaveBake(path) => self.session.save_bake(path),
            Action::StartBake => self.bake_as_asked(),
            Action::Reload => self.reload(),
            Action::ResumeBake => self.session.resume_bake(&self.settings),
            Action::CancelBake => {
                self.session.cancel_bake();
                self.adopt_view();
            }
            Action::ChoosePanel { node, resolution } => self.session.choose_panel(node, resolution),
            Action::ChooseUnits(units) => self.session.choose_units(units),
            Action::BakeWithSky { divisions } => self.bake_with_sky(divisions),
            Action::UseSky(path) => self.use_sky(&path),
            Action::AddLamp { shape, at_px } => self.add_lamp(shape, at_px),
            Action::AskProfile { at_px } => self.ask_profile(at_px),
            Action::AddProfile(path) => self.add_profile(path),
            Action::MakeMovable(key) => self.make_movable(&key),
            Action::DuplicateLamp => self.duplicate_lamp(),
            Action::DeleteLamp => self.delete_lamp(),
            Action::AimLamp => self.aim_lamp(),
            Action::TakeLook(idx) => self.take_look(idx),
            Action::PlayTimeline => self.play_timeline(),
            Action::ExportFrames(path) => self.export_frames(&path),
            Action::SaveSheet(path) => self.save_sheet(path),
            Action::ExportGltf(path) => self.export_gltf(path),
            Action::CancelFrames => self.session.cancel_frames(),
            Action::Solve => self.solve(),
            Action::AcceptSolution => self.accept_solution(),
            Action::DiscardSolution => self.discard_solution(),
            Action::MatchPicture(path) => self.match_picture(path),
            Action::BakeIlluminance => self.bake_illuminance(),
            Action::SaveSchedule(path) => self.save_schedule(&path),
            Action::UseScene(path) => self.session.find_scene(path),
            Action::Undo => self.undo(),
            Action::Redo => self.redo(),
            Action::ResetLook => (self.look.lights, self.look.display) = (LightRig::default(), Display::default()),
            Action::UseDevice(wish) => self.follower.use_device(wish),
            Action::FitPicture => self.view.zoom.fit(),
            Action::LeaveCamera => self.leave_camera(),
            Action::ToggleCamera if self.camera.is_moving => self.leave_camera(),
            Action::ToggleCamera => self.move_camera(),
            Action::LookFrom(camera) => self.look_from(*camera),
            Action::NameView(name) => self.name_view(name),
            Action::ShowView(id) => self.show_view(id),
            Action::ForgetView(id) => self.session.forget_view(id),
            Action::OneToOne => self.view.zoom.one_to_one(ctx.pixels_per_point()),
            Action::ToggleShortcuts => self.shortcuts = !self.shortcuts,
            Action::Quit => self.quit(ctx),
        }
    }

    /// Does something that loses the look, or asks first.
    fn unless_unsaved(&mut self, again: Action, job: impl FnOnce(&mut App)) {
        if self.is_unsaved() {
            self.unsaved = Some(again);
        } else {
            job(self);
        }
    }

    fn quit(&mut self, ctx: &Context) {
        self.saved_look = self.look.clone();
        ctx.send_viewport_cmd(ViewportCommand::Close);
    }

    fn ask(&mut self, task: FileTask) {
        let name = self.session.opened.as_ref().map_or("scene", |opened| opened.name.as_str());
        let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
        let look_path = self.look_path.as_ref().map(|path| path.display().to_string());
        let suggestion = match task {
            FileTask::OpenScene | FileTask::OpenPictures | FileTask::OpenLook => String::new(),
            FileTask::OpenProfile | FileTask::FindScene | FileTask::OpenTarget | FileTask::OpenSky => String::new(),
            FileTask::SaveSchedule => format!("{stem}.csv"),
            FileTask::SaveLook => look_path.unwrap_or_else(|| format!("{stem}.look")),
            FileTask::Export => format!("{stem}.png"),
            FileTask::SaveSheet => format!("{stem}-looks.png"),
            FileTask::ExportFrames => format!("{stem}_####.png"),
            FileTask::ExportGltf => format!("{stem}-lit.glb"),
            FileTask::SaveBake => format!("{stem}.transport"),
        };
        self.question = Some(FileQuestion::new(task, &suggestion, self.dialogs));
    }

    fn open(&mut self, path: PathBuf) {
        let absolute = std::path::absolute(&path).unwrap_or_else(|_| path.clone());
        self.recent.retain(|other| *other != absolute);
        self.recent.insert(0, absolute);
        self.recent.truncate(MAX_RECENT);
        self.session.open(Source::File(path));
    }

    fn undo(&mut self) {
        self.daylight.stop();
        if let Some(look) = self.undoer.undo(&self.look).cloned() {
            self.look = look;
        }
    }

    fn redo(&mut self) {
        if let Some(look) = self.undoer.redo(&self.look).cloned() {
            self.look = look;
        }
    }

    /// One drag is one step: while a button is down nothing is fed, when it comes up the state is kept at once.
    fn feed_undoer(&mut self, ctx: &Context) {
        let (now, is_down, came_up) =
            ctx.input(|input| (input.time, input.pointer.any_down(), input.pointer.any_released()));
        if self.daylight.is_playing() {
            return;
        }
        if is_down {
            // What was done before is another step than what is done now.
            if ctx.input(|input| input.pointer.any_pressed()) {
                self.undoer.add_undo(&self.look);
            }
            return;
        }
        self.undoer.feed_state(now, &self.look);
        if came_up {
            self.undoer.add_undo(&self.look);
        }
    }

    fn close_or_ask(&mut self, ctx: &Context) {
        if ctx.input(|input| input.viewport().close_requested()) && self.is_unsaved() {
            ctx.send_viewport_cmd(ViewportCommand::CancelClose);
            self.unsaved = Some(Action::Quit);
        }
    }

    fn dialogs_ui(&mut self, ctx: &Context) {
        self.question_ui(ctx);
        if self.unsaved.is_some()
            && let Some(answer) = unsaved_ui(ctx)
        {
            let waiting = self.unsaved.take();
            match answer {
                UnsavedAnswer::Stay => {}
                UnsavedAnswer::Save => {
                    self.after_saving = waiting;
                    self.actions.push(Action::SaveLookAgain);
                }
                UnsavedAnswer::Discard => {
                    self.saved_look = self.look.clone();
                    self.actions.extend(waiting);
                }
            }
        }
        self.recovery_ui(ctx);
        shortcuts_ui(ctx, &mut self.shortcuts);
        hovered_files_ui(ctx);
    }

    fn answered(&mut self, answer: Option<Option<PathBuf>>) {
        let Some(path) = answer else { return };
        if let (Some(question), Some(path)) = (self.question.take(), path) {
            // What is said afterwards tells the folder, too.
            self.actions.push(question.action(std::path::absolute(&path).unwrap_or(path)));
        } else {
            self.after_saving = None;
        }
    }

    fn set_title(&mut self, ctx: &Context) {
        let name = self.session.opened.as_ref().map_or("", |opened| opened.name.as_str());
        let mark = if self.is_unsaved() { "• " } else { "" };
        let title = if name.is_empty() { "Clerestory".into() } else { format!("{mark}{name} – Clerestory") };
        if title != self.title {
            ctx.send_viewport_cmd(ViewportCommand::Title(title.clone()));
            self.title = title;
        }
    }

    fn side_panels_ui(&mut self, ui: &mut Ui) {
        let frame = egui::Frame::side_top_panel(ui.style()).inner_margin(egui::Margin::symmetric(12, 6));
        // Where there is little room, what the panels need least is left to the picture.
        let most = (ui.available_width() - PICTURE_LEAST).clamp(320.0, 900.0);
        let (left, right) = (320.0..=most, 240.0..=(0.25 * ui.available_width()).clamp(240.0, 460.0));
        Panel::left("lights").frame(frame).default_size(most.min(404.0)).size_range(left).show(ui, |ui| {
            if let Some(basis) = self.session.basis().cloned() {
                self.sky_ui(ui, &basis);
                let choice = self.lamp_choice();
                lights_ui(ui, &basis, &mut self.look, &mut self.lights, &choice, &mut self.actions);
            } else {
                theme::section(ui, "Lights");
            }
            ui.take_available_space();
        });
        Panel::right("bake").frame(frame).default_size(280.0).size_range(right).show(ui, |ui| {
            egui::ScrollArea::vertical().id_salt("right").auto_shrink([false, false]).show(ui, |ui| {
                let view = DisplayView {
                    shown_ev: self.follower.shown_ev(),
                    metered_ev: self.follower.metered_ev(),
                    legend: self.follower.legend(),
                    has_illuminance: self.session.shown.as_ref().is_some_and(|s| s.pixel_irradiance().is_some()),
                };
                display_ui(ui, &mut self.look.display, &view);
                self.camera_panel_ui(ui);
                self.solving_ui(ui);
                self.bake_panel_ui(ui);
            });
        });
    }

    fn bake_panel_ui(&mut self, ui: &mut Ui) {
        let opened = self.session.opened.as_ref();
        let view = BakeView {
            state: &self.session.bake,
            figures: self.session.figures.as_ref(),
            error_db: self.session.error_db,
            can_bake: opened.is_some_and(|opened| opened.scene.is_some() || opened.stack.is_some()),
            pictures: self.session.pictures(),
            units: opened.filter(|opened| opened.has_plain_lamps()).map(|opened| opened.chosen.units),
            report: opened.map_or(&[], |opened| &opened.report),
            n_resumable: self.session.n_resumable(&self.settings),
            forecast: self.session.forecast(),
            history: &self.session.history,
        };
        // A bake that was opened shows how it was baked; what the next scene is baked with stays.
        let mut of_file = if view.can_bake { None } else { self.session.settings_of_shown() };
        let own = if view.pictures.is_some() { &mut self.stack_settings } else { &mut self.settings };
        bake_ui(ui, of_file.as_mut().unwrap_or(own), &mut self.heat_map, &view, &mut self.actions);
    }

    fn bars_ui(&mut self, ui: &mut Ui) {
        self.ask_memory(ui.ctx());
        let frame = egui::Frame::side_top_panel(ui.style()).inner_margin(egui::Margin::symmetric(12, 7));
        Panel::top("toolbar").frame(frame).show(ui, |ui| {
            let state = ToolbarState {
                can_undo: self.undoer.has_undo(&self.look),
                can_redo: self.undoer.has_redo(&self.look),
                has_picture: self.follower.picture().is_some(),
                is_unsaved: self.is_unsaved(),
                recent: &self.recent,
            };
            toolbar_ui(ui, &state, &mut self.actions);
        });
        let frame = frame.inner_margin(egui::Margin::symmetric(12, 3));
        Panel::bottom("status").frame(frame).show(ui, |ui| {
            let device = self.follower.device();
            let status = Status {
                message: &self.message.0,
                tone: self.message.1,
                bake: &self.session.bake,
                device: &device,
                wish: self.follower.wish(),
                size: self.follower.picture().map(|(_, size)| size),
                millis: self.follower.millis(),
                lamps: self.lamp_note(),
                error_db: self.session.error_db.map(|error| error.total),
                memory_bytes: self.memory.0,
            };
            status_ui(ui, &status, &mut self.actions);
        });
    }

    fn picture_ui(&mut self, ui: &mut Ui) {
        self.strips_ui(ui);
        if self.camera.is_moving && self.session.lamp_scene().is_some() {
            return self.flight_ui(ui);
        }
        let overlay = self.heat_overlay(ui.ctx());
        self.look_there(ui.ctx());
        let shown_camera = self.session.shown.as_ref().and_then(|shown| shown.camera.as_ref());
        let scene = self.session.lamp_scene().map(|scene| &**scene);
        self.prober.heed_view(self.session.shown.as_ref(), &mut self.view.probes);
        let (left, compared) = self.compared().unzip();
        let picture = self.follower.picture().map(|(texture, size)| (left.unwrap_or(texture), size));
        let viewed = Viewed {
            picture,
            stage: &self.session.stage,
            bake: &self.session.bake,
            scene: scene.zip(shown_camera).filter(|_| self.has_handles()),
            legend: self.follower.legend(),
            compared,
            overlay,
            readings: self.prober.read(&self.session, &self.follower, &self.view.probes),
        };
        egui::CentralPanel::no_frame().show(ui, |ui| {
            let area = ui.available_rect_before_wrap();
            viewport_ui(ui, &viewed, &mut self.view, &mut self.look, &mut self.lights, &mut self.actions);
            solo_banner_ui(ui, area, &self.look, &mut self.lights.solo);
        });
    }
}

impl eframe::App for App {
    fn logic(&mut self, ctx: &Context, _frame: &mut eframe::Frame) {
        for notice in self.session.drain() {
            self.notice(ctx, notice);
        }
        if let Some(answer) = self.question.as_mut().and_then(|question| question.poll(ctx)) {
            self.answered(Some(answer));
        }
        let files = ctx.input(|input| input.raw.dropped_files.clone());
        self.actions.extend(files.iter().map(|file| dropped(file.path().to_path_buf())));
        take_keys(ctx, &mut self.actions);
        for action in std::mem::take(&mut self.actions) {
            self.apply(ctx, action);
        }
        self.session.foresee(&self.settings);
        self.watch_file(ctx);
        self.follow_look_files();
        self.feed_undoer(ctx);
        self.keep_unsaved(ctx);
        self.close_or_ask(ctx);
        self.set_title(ctx);
        self.follow_solving();
        self.advance_timeline(ctx);
        self.advance_daylight(ctx);
        self.follow(ctx);
        if let Err(words) = self.prints.follow(ctx, &self.session, &self.look, self.looks.compare.as_ref()) {
            self.complain(words);
        }
    }

    fn ui(&mut self, ui: &mut Ui, _frame: &mut eframe::Frame) {
        let before = self.look.clone();
        let solo_before: BTreeSet<String> = self.lights.solo.clone();
        self.bars_ui(ui);
        self.side_panels_ui(ui);
        self.looks_ui(ui);
        self.picture_ui(ui);
        let ctx = ui.ctx().clone();
        self.dialogs_ui(&ctx);
        // The worker starts on the new picture while this frame is still being painted.
        let is_edited = (&self.look.lights, &self.look.display) != (&before.lights, &before.display);
        if is_edited {
            self.looks.player.stop();
        }
        if is_edited || self.lights.solo != solo_before {
            self.follow(&ctx);
        }
        if !self.actions.is_empty() || self.look != before {
            ctx.request_repaint();
        }
    }

    fn save(&mut self, storage: &mut dyn Storage) {
        eframe::set_value(storage, RECENT_KEY, &self.recent);
        eframe::set_value(storage, LIGHTS_KEY, &self.lights.layout);
        eframe::set_value(storage, EXPORT_KEY, &self.export);
        if !self.is_new_here {
            eframe::set_value(storage, WELCOMED_KEY, &true);
        }
        self.camera.save(storage);
    }

    fn clear_color(&self, visuals: &egui::Visuals) -> [f32; 4] {
        visuals.panel_fill.to_normalized_gamma_f32()
    }
}

fn hovered_files_ui(ctx: &Context) {
    if ctx.input(|input| input.raw.hovered_files.is_empty()) {
        return;
    }
    let layer = egui::LayerId::new(egui::Order::Foreground, egui::Id::unique("dropping"));
    let (painter, area) = (ctx.layer_painter(layer), ctx.content_rect());
    painter.rect_filled(area, 0.0, egui::Color32::from_black_alpha(150));
    let font = egui::FontId::proportional(22.0);
    painter.text(area.center(), egui::Align2::CENTER_CENTER, "Drop to open", font, theme::ACCENT);
}

/// Quality that suits the machine, until a scene says which size.
fn default_settings() -> BakeSettings {
    let n_cores = std::thread::available_parallelism().map_or(1, usize::from);
    let quality = QUALITIES[if n_cores >= MANY_CORES { 2 } else { 1 }];
    let config = BakeConfig { spp: quality.spp, tolerance_db: quality.tolerance_db, ..BakeConfig::default() };
    let film = Film { width: DEFAULT_WIDTH_PX, height: DEFAULT_WIDTH_PX * 9 / 16 };
    BakeSettings { camera_idx: 0, film, config, illuminance: false }
}
