//! The window: `logic()` drains facts and applies requests, `ui()` draws and lets the look be edited.

mod camera;
mod choices;
mod daylight;
mod drags;
mod export;
mod files;
mod floor;
mod focus;
mod follow;
mod habits;
mod heat;
mod host;
mod icon;
mod identity;
mod isolux;
mod lamplight;
mod lamps;
mod layout;
mod look_files;
mod looks;
mod losing;
mod marked;
mod memory;
mod opening;
mod outlasting;
mod probe;
mod recovery;
mod rest;
mod scenes;
mod sides;
mod sky;
mod solving;
mod start;
mod strips;
mod typing;
mod undo;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Result;
use clerestory_relight::Gpu;
use clerestory_transport::bake::BakeConfig;
use clerestory_transport::patches::DEFAULT_PATCHES;
use eframe::egui::{Context, Rect, SurrenderFocusOn, Ui, ViewportCommand};
use eframe::{CreationContext, Storage};
use serde::de::DeserializeOwned;

use crate::action::Action;
use crate::export::ExportOptions;
use crate::look::Look;
use crate::panels::dialogs::{FileDialogs, FileQuestion};
use crate::panels::heat::HeatMap;
use crate::panels::lights::LightsState;
use crate::panels::looks::LooksState;
use crate::panels::menu::note_open;
use crate::panels::messages::{Holds, MessageTone, Messages};
use crate::panels::number::take_refusal;
use crate::pulse::Pulse;
use crate::session::{BakeSettings, Notice, Session, Source};
use crate::theme;
use crate::viewport::ViewState;
use camera::CameraDesk;
use choices::Choices;
use daylight::Daylight;
use follow::Follower;
use habits::BakeHabits;
pub use host::WindowLost;
use isolux::IsoluxDesk;
use layout::toggle_full_screen;
use look_files::LookFiles;
use looks::Prints;
use losing::Losing;
use marked::InView;
use memory::MemoryWatch;
use opening::Opening;
use outlasting::{Appearance, Told};
use probe::Prober;
use recovery::Recovery;
use sides::Sides;
use solving::Solving;
use start::with_its_scene;
pub(crate) use start::without_window;
pub use start::{Start, run};
use typing::Typing;
use undo::Steps;

const RECENT_KEY: &str = "recent";
const LIGHTS_KEY: &str = "lights";
const EXPORT_KEY: &str = "export";
const PANELS_KEY: &str = "panels";
const DEVICE_KEY: &str = "device";
const MEMORY_KEY: &str = "memory";
const BAKE_KEY: &str = "bake";
const CHOICES_KEY: &str = "chosen";
const SCHEDULE_KEY: &str = "schedule";
/// Set once the welcome was read.
const WELCOMED_KEY: &str = "welcomed";

/// The window.
pub struct App {
    wake: crate::session::Wake,
    session: Session,
    look: Look,
    /// As it was when the frame began to be drawn.
    look_before: Look,
    saved_look: Look,
    look_path: Option<PathBuf>,
    look_files: LookFiles,
    steps: Steps,
    /// Whether the frame before ended a step: a button came up, or its press took what was typed.
    ends_step: bool,
    typing: Typing,
    settings: BakeSettings,
    fixed_settings: Option<BakeSettings>,
    /// How scenes are baked that are opened.
    habits: BakeHabits,
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
    choices: Choices,
    solving: Solving,
    isolux: IsoluxDesk,
    in_view: InView,
    actions: Vec<Action>,
    question: Option<FileQuestion>,
    dialogs: FileDialogs,
    unsaved: Option<Action>,
    losing: Losing,
    /// Whether somebody said that the next action may lose the look.
    may_lose_look: bool,
    /// What waits until the look is saved.
    after_saving: Option<Action>,
    /// Where the lamp goes whose profile is being asked for.
    profile_at_px: Option<[f32; 2]>,
    /// The lamp that is there for which one is being asked.
    profile_for: Option<String>,
    shortcuts: bool,
    /// Only the picture is shown between the bars.
    is_bare: bool,
    sides: Sides,
    /// How pictures are written.
    export: ExportOptions,
    /// The first and the last frame of those that are asked for; all of them where nobody says.
    asked_frames: Option<[u32; 2]>,
    heat_map: HeatMap,
    heat: heat::HeatDesk,
    recovery: Recovery,
    messages: Messages,
    /// Where the picture lies in the window.
    picture_area: Rect,
    watched: strips::Watched,
    /// Where the scene that is being opened is the open one, changed: what stays.
    reloading: Option<scenes::Reloading>,
    opening: Opening,
    is_new_here: bool,
    memory: MemoryWatch,
    recent: Vec<PathBuf>,
    appearance: Appearance,
    /// Where all windows leave what outlasts them.
    state_file: Option<PathBuf>,
    /// What of that this window began with, or left last.
    told_before: Told,
    title: String,
    /// Times frames where that is asked for.
    pulse: Option<Pulse>,
}

impl App {
    /// Makes the window's content and starts to open `start.source`.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn new(cc: &CreationContext<'_>, start: Start) -> Result<App> {
        let mut app = App::begun(cc, start)?;
        app.told_before = app.told();
        Ok(app)
    }

    fn begun(cc: &CreationContext<'_>, start: Start) -> Result<App> {
        theme::apply(&cc.egui_ctx);
        // A press may begin a drag of what the text is not about.
        cc.egui_ctx.options_mut(|options| options.input_options.surrender_focus_on = SurrenderFocusOn::Presses);
        let recent: Vec<PathBuf> = left(cc, RECENT_KEY);
        let (source, look) = with_its_scene(start.source, &recent);
        let was_welcomed = cc.storage.is_some_and(|storage| storage.get_string(WELCOMED_KEY).is_some());
        let lights = LightsState::new(left(cc, LIGHTS_KEY));
        let habits = left::<BakeHabits>(cc, BAKE_KEY).within_reason();
        let ctx = cc.egui_ctx.clone();
        let wake: crate::session::Wake = Arc::new(move |soon| ctx.request_repaint_after(soon));
        let mut session = Session::new(wake.clone());
        session.cache = start.cache;
        session.memory_limit = left(cc, MEMORY_KEY);
        let choices = Choices::new(left(cc, CHOICES_KEY));
        let chosen = choices.kept.of(&source);
        session.open_with(source, chosen);
        let (recovery, problem) = Recovery::start(start.unsaved.as_deref());
        let mut messages = Messages::default();
        problem.into_iter().for_each(|words| messages.push(words, MessageTone::Problem));
        let mut follower = Follower::new(cc.wgpu_render_state.as_ref(), wake.clone())?;
        if let Some(wish) = cc.storage.and_then(|storage| eframe::get_value(storage, DEVICE_KEY)) {
            follower.use_device(wish);
        }
        Ok(App {
            wake: wake.clone(),
            session,
            look: Look::default(),
            look_before: Look::default(),
            saved_look: Look::default(),
            look_path: None,
            look_files: LookFiles::new(wake.clone()),
            steps: Steps::default(),
            ends_step: false,
            typing: Typing::default(),
            settings: start.settings.clone().unwrap_or_else(|| habits.settings(None)),
            fixed_settings: start.settings,
            habits,
            stack_settings: BakeSettings { config: BakeConfig::default(), ..habits.settings(None) },
            lights,
            view: ViewState::default(),
            follower,
            looks: LooksState::default(),
            prints: Prints::new(wake.clone())?,
            solving: Solving::new(wake.clone()).with_schedule(left(cc, SCHEDULE_KEY)),
            isolux: IsoluxDesk::new(wake.clone()),
            in_view: InView::default(),
            prober: Prober::default(),
            daylight: Daylight::new(wake.clone()),
            camera: CameraDesk::start(cc, wake)?,
            choices,
            actions: look.map(Action::OpenLook).into_iter().collect(),
            question: None,
            dialogs: start.dialogs,
            unsaved: None,
            losing: Losing::default(),
            may_lose_look: false,
            after_saving: None,
            profile_at_px: None,
            profile_for: None,
            shortcuts: false,
            is_bare: false,
            sides: left(cc, PANELS_KEY),
            export: left(cc, EXPORT_KEY),
            asked_frames: None,
            heat_map: HeatMap::default(),
            heat: heat::HeatDesk::default(),
            recovery,
            messages,
            picture_area: Rect::NOTHING,
            watched: strips::Watched::default(),
            reloading: None,
            opening: Opening::default(),
            is_new_here: start.welcome && !was_welcomed,
            memory: MemoryWatch::new(),
            recent,
            appearance: Appearance::restored(cc),
            state_file: start.state,
            told_before: Told::default(),
            title: String::new(),
            pulse: Pulse::of_environment()?,
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
        !self.session.bake.is_running() && self.follower.is_idle() && self.prints.is_idle() && self.daylight.is_idle()
    }

    /// Whether the picture shows the lights as they are, though a hand may still be on them and hold the exposure.
    pub fn is_answered(&self) -> bool {
        self.follower.is_answered()
    }

    /// The window's graphics device, whether it relights or not.
    pub fn graphics(&self) -> Option<&Gpu> {
        self.follower.graphics()
    }

    /// Exposure of the picture that is shown, EV.
    pub fn shown_ev(&self) -> f32 {
        self.follower.shown_ev()
    }

    fn is_unsaved(&self) -> bool {
        self.look != self.saved_look
    }

    fn say(&mut self, words: impl Into<String>) {
        self.messages.push(self.look.renamed(&words.into()), MessageTone::Calm);
    }

    /// Says that something has begun whose end will be told.
    fn say_begun(&mut self, words: impl Into<String>) {
        self.messages.push(self.look.renamed(&words.into()), MessageTone::Begun);
    }

    fn complain(&mut self, words: impl Into<String>) {
        self.messages.push(self.look.renamed(&in_brief(words.into())), MessageTone::Problem);
    }

    /// Says what went wrong with the scene that is open, or with what is for it.
    fn complain_of_scene(&mut self, holds: Holds, words: impl Into<String>) {
        self.messages.push_of_scene(self.look.renamed(&in_brief(words.into())), holds);
    }

    fn notice(&mut self, ctx: &Context, notice: Notice) {
        if matches!(notice, Notice::Said(_) | Notice::Failed(_)) {
            self.messages.end_begun();
        }
        match notice {
            Notice::Opened => self.scene_opened(),
            Notice::PreparedAgain => self.chosen_is_made(),
            Notice::NotPrepared(words) => self.chosen_cannot_be_made(words),
            Notice::SceneFound => self.scene_of_bake_found(),
            Notice::Said(words) => self.say(words),
            Notice::Developed(picture) => self.copied(ctx, picture),
            Notice::NotOpened => self.not_opened(),
            Notice::Failed(words) => self.complain(words),
        }
    }

    fn apply(&mut self, ctx: &Context, action: Action) {
        let Some(action) = self.hold(action) else { return };
        match action {
            Action::Ask(task) => self.ask(task),
            Action::Open(path) => self.unless_lost(Action::Open(path.clone()), |app| app.open(path)),
            Action::OpenBuiltIn => self.unless_lost(Action::OpenBuiltIn, |app| app.open_source(Source::BuiltIn)),
            Action::OpenLook(path) => self.unless_unsaved(Action::OpenLook(path.clone()), |app| app.open_look(path)),
            Action::AddLooks(path) => self.add_looks(path),
            Action::SaveLook(path) => self.save_look(path),
            Action::SaveLookAgain => self.save_look_again(),
            Action::ExportImage(path) => self.export(path),
            Action::CopyImage => self.copy_image(),
            Action::SaveBake(path) => self.session.save_bake(path),
            Action::StartBake => self.bake_as_asked(),
            Action::BakeByKey => self.bake_by_key(),
            Action::BakePatches => {
                self.settings.config.patches = self.settings.config.patches.max(DEFAULT_PATCHES);
                self.bake_as_asked();
            }
            Action::Reload => self.reload(),
            Action::ResumeBake => self.session.resume_bake(&self.settings, self.camera.camera.as_ref()),
            Action::CancelOpening => self.cancel_opening(),
            Action::TakeOpened => self.take_opened(ctx),
            Action::LimitMemory(limit) => self.session.limit_memory(limit),
            Action::CancelBake => {
                self.session.cancel_bake();
                self.adopt_view();
            }
            Action::ChoosePanel { node, resolution } => self.choose_panel(node, resolution),
            Action::ChooseUnits(units) => self.choose_units(units),
            Action::BakeWithSky { divisions } => self.bake_with_sky(divisions),
            Action::BakeWithoutSky => self.choose_no_sky(),
            Action::UseSky(path) => self.use_sky(&path),
            Action::AddLamp { shape, at_px } => self.add_lamp(shape, at_px),
            Action::AskProfile { at_px } => self.ask_profile(at_px),
            Action::AskProfileFor(key) => self.ask_profile_for(key),
            Action::AddProfile(path) => self.add_profile(path),
            Action::MakeMovable(key) => self.make_movable(&key),
            Action::PullLamp { key, at } => self.pull_lamp(&key, at),
            Action::PutBack(pulled) => self.put_back(*pulled),
            Action::DuplicateLamp => self.duplicate_lamps(),
            Action::CopyLamp(key) => self.add_copies(&[], &[key]),
            Action::DeleteLamp => self.delete_lamps(),
            Action::DeleteChosen => self.delete_chosen(),
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
            Action::SaveValues(path) => self.save_values(&path),
            Action::UseScene(path) => self.use_scene(path),
            Action::Undo => self.undo(),
            Action::Redo => self.redo(),
            Action::UseDevice(wish) => self.follower.use_device(wish),
            Action::FitPicture => self.view.zoom.fit(),
            Action::LeaveCamera => self.leave_camera(),
            Action::ToggleCamera if self.camera.is_moving => self.leave_camera(),
            Action::ToggleCamera => self.move_camera(),
            Action::LookFrom(camera) => self.look_from(*camera),
            Action::NameView(name) => self.name_view(name),
            Action::ShowView(id) => self.show_view(id),
            Action::StepView(by) => self.step_view(by),
            Action::ForgetView(id) => self.session.forget_view(id),
            Action::OneToOne => self.view.zoom.one_to_one(ctx.pixels_per_point()),
            Action::ZoomToRegion => self.view.zoom.await_region(),
            Action::TogglePanels => self.is_bare = !self.is_bare,
            Action::TogglePanel(side) => self.toggle_panel(ctx, side),
            Action::ToggleShortcuts => self.toggle_shortcuts(ctx),
            Action::ToggleFullScreen => toggle_full_screen(ctx),
            Action::CloseWindow | Action::Quit => ctx.send_viewport_cmd(ViewportCommand::Close),
        }
    }
}

/// What the last window left under a key.
fn left<T: Default + DeserializeOwned>(cc: &CreationContext<'_>, key: &str) -> T {
    cc.storage.and_then(|storage| eframe::get_value(storage, key)).unwrap_or_default()
}

/// Characters of a message that anybody reads: a file from strangers can give rise to millions.
const MAX_MESSAGE: usize = 2000;

fn in_brief(mut words: String) -> String {
    if let Some((end, _)) = words.char_indices().nth(MAX_MESSAGE) {
        words.truncate(end);
        words.push_str("… and more");
    }
    words
}

impl eframe::App for App {
    fn logic(&mut self, ctx: &Context, _frame: &mut eframe::Frame) {
        self.pulse.iter_mut().for_each(Pulse::begin);
        self.appearance = Appearance::of(ctx);
        self.session.holds_opened = self.would_lose_changes() || self.is_writing();
        for notice in self.session.drain() {
            self.notice(ctx, notice);
        }
        if let Some(answer) = self.question.as_mut().and_then(|question| question.poll(ctx)) {
            self.answered(Some(answer));
        }
        let asked = self.asked(ctx);
        self.actions.extend(asked);
        self.follow_work_plane();
        for action in self.due(ctx) {
            self.apply(ctx, action);
        }
        self.follow_opening();
        self.follow_work_plane();
        self.session.foresee(&self.settings, self.camera.camera.as_ref());
        self.watch_file(ctx);
        self.follow_look_files();
        self.follow_solo();
        self.feed_undoer(ctx);
        self.keep_unsaved(ctx);
        self.close_or_ask(ctx);
        self.set_title(ctx);
        self.follow_solving();
        self.follow_isolux();
        self.advance_timeline(ctx);
        self.advance_daylight(ctx);
        self.follow(ctx);
        let (compare, solo) = (self.looks.compare.as_ref(), &self.lights.solo);
        if let Err(words) = self.prints.follow(ctx, &self.session, &self.look, compare, solo) {
            self.complain(words);
        }
    }

    fn ui(&mut self, ui: &mut Ui, _frame: &mut eframe::Frame) {
        note_open(ui.ctx(), self.shortcuts);
        // Looks are large: one that stays is not copied.
        if self.look_before != self.look {
            self.look_before = self.look.clone();
        }
        let solo_before: BTreeSet<String> = self.lights.solo.clone();
        let (lamp_before, key_before) = (self.lights.lamps.chosen.clone(), self.looks.player.chosen());
        self.messages.follow(ui.ctx());
        self.lights.follow_picture();
        self.bars_ui(ui);
        if !self.is_bare {
            self.side_panels_ui(ui);
            self.looks_ui(ui);
        }
        self.picture_ui(ui);
        let ctx = ui.ctx().clone();
        self.messages.stack_ui(&ctx, self.picture_area);
        self.dialogs_ui(&ctx);
        if let Some(words) = take_refusal(&ctx) {
            self.say(words);
            ctx.request_repaint();
        }
        self.follow_marks();
        self.choose_one(lamp_before, key_before);
        self.follow_solo();
        // The worker starts on the new picture while this frame is still being painted.
        let is_lit_otherwise = self.look.lights != self.look_before.lights;
        let is_shown_otherwise = self.look.display != self.look_before.display;
        let is_heard_otherwise = self.lights.solo != solo_before;
        if is_shown_otherwise {
            self.follower.release_exposure();
        } else if is_lit_otherwise || is_heard_otherwise {
            self.follower.hold_exposure(&ctx);
        }
        if is_lit_otherwise || is_shown_otherwise {
            self.looks.player.stop();
        }
        if is_lit_otherwise || is_shown_otherwise || is_heard_otherwise {
            self.follow(&ctx);
        }
        if !self.actions.is_empty() || self.look != self.look_before {
            ctx.request_repaint();
        }
        self.pulse.iter_mut().for_each(Pulse::end);
    }

    fn save(&mut self, storage: &mut dyn Storage) {
        self.leave(storage);
    }

    /// Where a system ends the program without a question, as the menu of a Mac does, what was not saved is offered at the next start, and
    /// a bake that is in no file gets one.
    fn on_exit(&mut self) {
        self.keep_unsaved_now();
        self.keep_stack_now();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_nobody_reads_to_its_end_is_cut() {
        assert_eq!(in_brief("a fault".into()), "a fault");
        let cut = in_brief("ü".repeat(16 << 20));
        assert!(cut.chars().count() < MAX_MESSAGE + 20 && cut.ends_with("ü… and more"));
    }
}
