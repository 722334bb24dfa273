//! What is marked in the picture, measured there, and wished for: threads beside the window, and what is done with their answers.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clerestory_relight::Radiance;
use clerestory_transport::bake::BakeHeader;
use clerestory_transport::basis::LightBasis;
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::lamps::{FreeLamp, LampError, PreparedLamps};
use clerestory_transport::light::LightRig;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::sensors::node_floor_area_m2;
use eframe::egui::Ui;
use glam::Vec3;

use super::App;
use super::floor::SceneFloor;
use super::follow::Follower;
use super::identity::Identity;
use crate::illuminance::{LuxFigures, of_grid, of_marks, write_points};
use crate::look::wishes::{Wanted, Where, Wishes};
use crate::look::{Look, Units};
use crate::marks::{Framing, Kin, Marks, Seen};
use crate::output::PendingFile;
use crate::panels::lights::heard;
use crate::panels::measure::{KnownFloor, LuxBake, MeasureState, MeasureView, ScheduleState, measure_ui};
use crate::panels::solve::{SolveState, SolveView, solve_ui};
use crate::schedule::Schedule;
use crate::session::aside::Aside;
use crate::session::lamps::{LampLight, LampPart};
use crate::session::{BakeState, Session, Shown, Wake};
use crate::solve::kept::{Here, Pictures};
use crate::solve::{AtPixel, LampColumn, Scene, Solution, TargetPicture, at_point, may_change, solve};
use crate::viewport::marking::Join;
use crate::words::in_words;

/// A surface that was clicked on, and what was marked by that.
pub(super) struct Picked {
    marks: Arc<Marks>,
    surface: Option<String>,
    /// Its node.
    node: Option<u32>,
    /// Area of the floor that the node has, in m², where that node is all that is marked.
    pub floor_m2: Option<f64>,
}

/// Marks, measurements and wishes.
pub(super) struct Solving {
    pub wake: Wake,
    pub state: SolveState,
    schedule: ScheduleState,
    /// What the pixels see, of which scene, camera and film.
    seen: Option<(View, Arc<Seen>)>,
    looking: Aside<(View, Seen)>,
    /// Figures of what is marked and of the grids, and what they are of.
    measured: Option<(Measured, Figures)>,
    measuring: Aside<(Measured, Result<Figures, String>)>,
    /// How often blocks had been counted when the error of the illuminance was, and that, dB.
    lux_error: (u64, Option<f32>),
    problem: Option<String>,
    picked: Option<Picked>,
    /// Whether somebody asked for a solution, and the light of a free lamp is still on its way.
    is_due: bool,
    pub floor: SceneFloor,
    solving: Aside<Result<Solution, String>>,
    /// A picture to match, and whether it is a wish from then on.
    reading: Aside<(PathBuf, Reading, Result<TargetPicture, String>)>,
    /// Pictures of wishes, by their files.
    pictures: Pictures,
    /// The lights as they were when solving began, and the wishes.
    solved_from: LightRig,
    solved_for: Wishes,
}

/// What a picture is read for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Reading {
    /// A new wish.
    NewWish,
    /// A wish that the look has.
    OfLook,
}

/// What the picture is of.
#[derive(Clone)]
struct View {
    scene: Arc<PreparedScene>,
    camera: Camera,
    film: Film,
}

/// What figures are of.
#[derive(Clone, PartialEq)]
struct Measured {
    /// The header of the bake.
    bake: Identity<BakeHeader>,
    n_sets: usize,
    /// How often finer blocks came.
    n_lux: u64,
    rig: LightRig,
    /// The light of free lamps, if there is any.
    lamps: Option<Identity<Radiance>>,
    marks: Option<Arc<Marks>>,
    by_area: bool,
}

/// Places and their lux.
type Points = Vec<(Vec3, f32)>;

#[derive(Clone, Default)]
struct Figures {
    marked: Option<LuxFigures>,
    grids: Vec<(String, LuxFigures)>,
    /// Of the same grids the points, meters and lux.
    points: Arc<Vec<(String, Points)>>,
    /// Which lamps do not count, and why.
    left_out: Option<String>,
}

impl View {
    fn is_same(&self, other: &View) -> bool {
        Arc::ptr_eq(&self.scene, &other.scene) && (&self.camera, self.film) == (&other.camera, other.film)
    }

    fn of(session: &Session) -> Option<View> {
        let shown = session.shown.as_ref()?;
        Some(View { scene: session.lamp_scene()?.clone(), camera: shown.camera.clone()?, film: shown.film() })
    }
}

impl Solving {
    pub fn new(wake: Wake) -> Solving {
        Solving {
            wake,
            state: SolveState::default(),
            schedule: ScheduleState::default(),
            seen: None,
            looking: Aside::default(),
            measured: None,
            measuring: Aside::default(),
            lux_error: (0, None),
            problem: None,
            picked: None,
            is_due: false,
            floor: SceneFloor::default(),
            solving: Aside::default(),
            reading: Aside::default(),
            pictures: Pictures::new(),
            solved_from: LightRig::default(),
            solved_for: Wishes::default(),
        }
    }

    /// With what was set for the schedule before.
    pub fn with_schedule(self, schedule: ScheduleState) -> Solving {
        Solving { schedule, ..self }
    }

    /// What is set for the schedule.
    pub fn schedule(&self) -> &ScheduleState {
        &self.schedule
    }

    /// Another scene: nothing of the old one counts.
    pub fn forget(&mut self) {
        let wake = self.wake.clone();
        let schedule = self.schedule;
        *self = Solving { schedule, ..Solving::new(wake) };
    }

    /// The scene is made anew: lights that were found, or are looked for, are of the one before. Answers whether there are any.
    pub fn give_up(&mut self) -> bool {
        let is_under_way = self.is_due || self.solving.is_busy();
        (self.is_due, self.solving) = (false, Aside::default());
        self.state.solution.take().is_some() || is_under_way
    }

    /// The area of floor that was typed is that of one scene.
    pub fn forget_floor(&mut self) {
        self.schedule.floor_m2 = 0.0;
    }

    /// The look as the picture shows it: under a solution that waits, where that is previewed.
    pub fn previewed<'a>(&self, look: &'a Look) -> Cow<'a, Look> {
        match &self.state.solution {
            Some(solution) if self.state.is_previewed => {
                Cow::Owned(Look { lights: solution.rig.clone(), ..look.clone() })
            }
            _ => Cow::Borrowed(look),
        }
    }

    /// What the pixels of this view see, as far as it is known.
    fn seen(&self, view: Option<&View>) -> Option<Arc<Seen>> {
        let view = view?;
        self.seen.as_ref().filter(|(of, _)| of.is_same(view)).map(|(_, seen)| seen.clone())
    }
}

impl App {
    /// Whether something is measured or solved beside the window.
    pub fn is_solving(&self) -> bool {
        let solving = &self.solving;
        solving.is_due
            || solving.solving.is_busy()
            || solving.measuring.is_busy()
            || solving.looking.is_busy()
            || solving.reading.is_busy()
            || solving.floor.is_busy()
            || self.isolux.is_busy()
    }

    /// What waits to be taken over.
    pub fn solution(&self) -> Option<&Solution> {
        self.solving.state.solution.as_ref()
    }

    /// Illuminance of what is marked, once it was measured.
    pub fn marked_lux(&self) -> Option<LuxFigures> {
        self.solving.measured.as_ref().and_then(|(_, figures)| figures.marked)
    }

    /// Takes answers in and asks for what is new; every frame.
    pub(super) fn follow_solving(&mut self) {
        self.follow_marks();
        let view = View::of(&self.session);
        self.take_seen(view.as_ref());
        self.follow_marks();
        self.take_solution();
        self.begin_solving();
        self.take_target();
        self.read_targets();
        self.measure(view.as_ref());
        self.follow_floor();
        if self.solving.state.solution.is_some() && self.look.lights != self.solving.solved_from {
            self.solving.state.solution = None;
            self.say("The lights have changed since; solve again");
        }
        // What was wrong with other wishes may not be so with these.
        if self.solving.state.problem.is_some() && self.look.wishes != self.solving.solved_for {
            self.solving.state.problem = None;
        }
    }

    fn take_seen(&mut self, view: Option<&View>) {
        match self.solving.looking.take() {
            Some(Ok((view, seen))) => self.solving.seen = Some((view, Arc::new(seen))),
            Some(Err(words)) => self.complain(format!("The surfaces could not be told apart: {words}")),
            None => {}
        }
        let Some(view) = view else { return };
        let is_wanted = self.view.marking.picked.is_some() || self.view.marking.marks().is_some();
        let Some(seen) = self.solving.seen(Some(view)) else {
            if is_wanted {
                let view = view.clone();
                let started = self.solving.looking.start("surfaces", &self.solving.wake, move || {
                    let seen = Seen::new(&view.scene, &view.camera, view.film);
                    (view, seen)
                });
                if let Err(words) = started {
                    self.complain(words);
                }
            }
            return;
        };
        if let Some(picked) = self.view.marking.picked.take() {
            let kin = self.view.marking.kin;
            self.view.marking.join(seen.like(picked.pixel, kin), picked.join);
            let name = |kin| seen.name(&view.scene, picked.pixel, kin).filter(|name| !name.is_empty());
            let (surface, node) = (name(kin), seen.node(picked.pixel).filter(|_| name(Kin::Node).is_some()));
            let is_alone = (kin, picked.join) == (Kin::Node, Join::Replace);
            let floor_m2 = node.filter(|_| is_alone);
            let floor_m2 = floor_m2.and_then(|node| node_floor_area_m2(&view.scene.scene, node)).map(f64::from);
            let marks = self.view.marking.marks().cloned();
            self.solving.picked = marks.map(|marks| Picked { marks, surface, node, floor_m2 });
        }
    }

    /// The surface that is marked; none where something else was marked since.
    pub(super) fn picked(&self) -> Option<&Picked> {
        let is_marked = |picked: &&Picked| {
            let marks = self.view.marking.marks();
            marks.is_some_and(|marks| Arc::ptr_eq(marks, &picked.marks) || *marks == picked.marks)
        };
        self.solving.picked.as_ref().filter(is_marked)
    }

    /// Measures what is marked under the lights as they are seen.
    fn measure(&mut self, view: Option<&View>) {
        match self.solving.measuring.take() {
            Some(Ok((of, Ok(figures)))) => {
                self.solving.problem.clone_from(&figures.left_out);
                self.solving.measured = Some((of, figures));
            }
            Some(Ok((of, Err(words)))) => {
                (self.solving.measured, self.solving.problem) = (Some((of, Figures::default())), Some(words));
            }
            Some(Err(words)) => self.solving.problem = Some(words),
            None => {}
        }
        let Some(shown) = &self.session.shown else { return };
        let has_pixels = shown.pixel_irradiance().is_some();
        let marks = self.view.marking.marks().filter(|_| has_pixels).cloned();
        if marks.is_none() && shown.irradiance.len() <= usize::from(has_pixels) {
            self.solving.measured = None;
            return;
        }
        if self.solving.measuring.is_busy() {
            return;
        }
        let seen = self.solving.seen(view);
        let light = self.follower.shown_lamp_light(shown);
        let of = Measured {
            bake: Identity::of(&shown.header),
            n_sets: shown.irradiance.len(),
            n_lux: self.session.n_lux(),
            rig: heard(&shown.header.basis, &self.seen().lights, &self.lights.solo),
            lamps: light.map(|light| Identity::of(&light.direct)),
            marks,
            by_area: seen.is_some(),
        };
        if self.solving.measured.as_ref().is_some_and(|(known, _)| *known == of) {
            return;
        }
        let (bake, mut added) = (shown.bake(), light.map(LampLight::added_lux).unwrap_or_default());
        let missing = light.and_then(LampLight::missing_words);
        let scene = self.session.lamp_scene().cloned();
        let started = self.solving.measuring.start("measure", &self.solving.wake, move || {
            let figures = || -> anyhow::Result<Figures> {
                let (lamps, errors) = PreparedLamps::able(&of.rig.shining_lamps(), None);
                let errors: Vec<String> = errors.iter().map(LampError::to_string).chain(missing).collect();
                let left_out = (!errors.is_empty()).then(|| format!("{}: these figures lack it", errors.join(", ")));
                added.lamps = scene.filter(|_| !lamps.is_empty()).map(|scene| {
                    let lamps = lamps.in_scene(&scene);
                    (scene, lamps)
                });
                let light = (&of.rig, &added);
                let marked =
                    of.marks.as_ref().map(|marks| of_marks(&bake, light, marks, seen.as_deref())).transpose()?;
                let points = bake.grids().map(|(set, grid)| -> anyhow::Result<(String, Points)> {
                    Ok((grid.name.clone(), of_grid(&bake, (set, grid), light)?))
                });
                let points = points.collect::<anyhow::Result<Vec<_>>>()?;
                let figures = |points: &Points| LuxFigures::of(points.iter().map(|(_, lux)| (f64::from(*lux), 1.0)));
                let grids = points.iter().map(|(name, points)| (name.clone(), figures(points))).collect();
                Ok(Figures { marked, grids, points: Arc::new(points), left_out })
            };
            let figures = figures().map_err(|error| in_words(&error));
            (of, figures)
        });
        if let Err(words) = started {
            self.complain(words);
        }
    }

    /// Has the lights looked for that come closest to the wishes.
    pub(super) fn solve(&mut self) {
        // A moment of the timeline has lamps of its own, and would hide what is found.
        self.looks.player.stop();
        (self.solving.state.solution, self.solving.state.problem) = (None, None);
        self.solving.is_due = true;
    }

    /// Looks for them beside the window, once it is known what the free lamps bring as they are set.
    fn begin_solving(&mut self) {
        if self.solving.is_due && (!self.lights.solo.is_empty() || self.looks.player.playhead.is_some()) {
            // What is shown now has other lamps, for as long as somebody likes.
            (self.solving.is_due, self.solving.solved_for) = (false, self.look.wishes.clone());
            self.solving.state.problem = Some("other lights were shown meanwhile; solve again".into());
        }
        if !self.solving.is_due || !self.follower.knows_lamps(&self.look.lights) {
            return;
        }
        self.solving.is_due = false;
        let Some(shown) = &self.session.shown else { return };
        let lights = free_lights(&self.session, &self.follower, &self.look.lights);
        let request = here(&self.session, &self.solving.pictures).request(&self.look.wishes, &lights);
        let rig = self.look.lights.clone();
        let parts = self.follower.lamp_light().map(|light| light.parts.clone()).unwrap_or_default();
        let lit = rig.lit_lamps();
        let stage = self.session.lamp_scene();
        let bounces = shown.header.config.bounces;
        let columns = |stage| parts.into_iter().filter_map(|part| column(part, &lit, (stage, bounces))).collect();
        let lamps = stage.map(columns);
        let lamps = lamps.unwrap_or_default();
        let seen = self.solving.seen(View::of(&self.session).as_ref());
        let scene = Scene { bake: shown.bake(), rig: rig.clone(), lamps, seen };
        (self.solving.solved_from, self.solving.solved_for) = (rig, self.look.wishes.clone());
        let started = self
            .solving
            .solving
            .start("solve", &self.solving.wake, move || solve(&scene, &request).map_err(|error| in_words(&error)));
        if let Err(words) = started {
            self.complain(words);
        }
    }

    fn take_solution(&mut self) {
        match self.solving.solving.take() {
            Some(Ok(Ok(solution))) => {
                self.say(format!("Solved, residual {:.2} %", 100.0 * solution.misfit));
                (self.solving.state.solution, self.solving.state.is_news) = (Some(solution), true);
            }
            Some(Ok(Err(words)) | Err(words)) => self.solving.state.problem = Some(words),
            None => {}
        }
    }

    /// Takes a solution over: one step of undo.
    pub(super) fn accept_solution(&mut self) {
        let Some(solution) = self.solving.state.solution.take() else { return };
        self.solving.solved_from = solution.rig.clone();
        self.as_one_step(|app| app.look.lights = solution.rig);
        self.say("The lights are as solved");
    }

    pub(super) fn discard_solution(&mut self) {
        self.solving.state.solution = None;
    }

    /// A wish for a picture to be matched, read beside the window.
    pub(super) fn match_picture(&mut self, path: PathBuf) {
        if self.solving.reading.is_busy() {
            return self.complain("another picture is still being read; try again in a moment");
        }
        self.say(format!("Reading {}", path.display()));
        self.read_target(path, Reading::NewWish);
    }

    fn read_target(&mut self, path: PathBuf, reading: Reading) {
        let started = self.solving.reading.start("target", &self.solving.wake, move || {
            let read = TargetPicture::read(&path).map_err(|error| in_words(&error));
            (path, reading, read)
        });
        if let Err(words) = started {
            self.complain(words);
        }
    }

    fn take_target(&mut self) {
        match self.solving.reading.take() {
            Some(Ok((path, Reading::NewWish, Ok(picture)))) => {
                let (name, file) = (picture.name.clone(), path.display().to_string());
                if !self.look.wishes.has_room() {
                    return self.complain("there are as many wishes as a look holds; remove one first");
                }
                self.say(format!("{name} is among the wishes of Solve for light"));
                self.solving.pictures.insert(file.clone(), Ok(Arc::new(picture)));
                self.look.wishes.push(&name, Where::Whole, Wanted::Match { file, tone: None, exposure_ev: None });
            }
            Some(Ok((path, Reading::OfLook, read))) => {
                self.solving.pictures.insert(path.display().to_string(), read.map(Arc::new));
            }
            Some(Ok((_, Reading::NewWish, Err(words))) | Err(words)) => self.complain(words),
            None => {}
        }
    }

    /// A picture to match was written by another program: it is read anew, and what was found for it does not wait to be taken over.
    pub(super) fn read_target_again(&mut self, file: &str) {
        self.solving.pictures.remove(file);
        if self.solving.state.solution.take().is_some() {
            self.say("A picture to match has changed since; solve again");
        }
    }

    /// Pictures that wishes of the look name are read one after the other.
    fn read_targets(&mut self) {
        if self.solving.reading.is_busy() {
            return;
        }
        let next = self.look.wishes.files().find(|file| !self.solving.pictures.contains_key(*file)).map(PathBuf::from);
        if let Some(path) = next {
            self.read_target(path, Reading::OfLook);
        }
    }

    /// Bakes again with the light that arrives at each pixel.
    pub(super) fn bake_illuminance(&mut self) {
        self.settings.illuminance = true;
        self.start_bake();
    }

    /// Writes the table of lamps.
    pub(super) fn save_schedule(&mut self, path: &Path) {
        let ScheduleState { by, efficacy_lm_w, floor_m2 } = self.solving.schedule;
        let efficacy_lm_w = Some(efficacy_lm_w).filter(|efficacy| *efficacy > 0.0);
        let floor = if floor_m2 > 0.0 { Some(floor_m2) } else { self.floor_now().map(KnownFloor::area_m2) };
        let Some(basis) = self.session.basis() else { return };
        if basis.is_measured() {
            return self.complain("lights of pictures that were taken are no lamps, so there is no schedule of them");
        }
        let scene = self.session.lamp_scene().map(|scene| &**scene);
        let schedule = Schedule::new(basis, scene, &self.look, efficacy_lm_w, floor);
        match PendingFile::create(path).and_then(|place| place.commit(|writer| schedule.write(writer, by))) {
            Ok(()) => {
                let untold = match &schedule.untold()[..] {
                    [] => String::new(),
                    [one] => format!("; {one}"),
                    many => format!("; {} lamps tell no lumen and count in no total", many.len()),
                };
                self.say(format!("Saved {}{untold}", path.display()));
            }
            Err(error) => self.complain(in_words(&error)),
        }
    }

    /// Writes what the points of the sensor grids read, as it was measured last, and says what that lacks.
    pub(super) fn save_values(&mut self, path: &Path) {
        let figures = self.solving.measured.as_ref().map(|(_, figures)| figures);
        let figures = figures.map(|figures| (figures.points.clone(), figures.left_out.clone()));
        let Some((points, left_out)) = figures.filter(|(points, _)| !points.is_empty()) else {
            return self.complain("no sensors were read yet; wait for the bake, or lay a work plane and bake it");
        };
        let grids = points.iter().map(|(name, points)| (name.as_str(), &points[..]));
        let written = PendingFile::create(path).and_then(|place| place.commit(|writer| write_points(writer, grids)));
        match (written, left_out) {
            (Ok(()), None) => self.say(format!("Saved {}", path.display())),
            (Ok(()), Some(words)) => self.complain(format!("Saved {}; {words}", path.display())),
            (Err(error), _) => self.complain(in_words(&error)),
        }
    }

    /// How illuminance can be had, where it is not there.
    pub(super) fn lux_bake(&self) -> LuxBake {
        match () {
            () if self.session.bakes_illuminance() => LuxBake::Underway,
            () if self.session.has_scene() => LuxBake::Ready,
            () if self.session.basis().is_some_and(LightBasis::is_measured) => LuxBake::Taken,
            () => LuxBake::Never,
        }
    }

    /// Error of the illuminance that is shown, dB; none while a bake is not done, as nothing tells what shared light adds to it.
    fn lux_error_db(&mut self) -> Option<f32> {
        if self.session.bake != BakeState::Done {
            return None;
        }
        let n_counts = self.session.n_counts();
        if self.solving.lux_error.0 != n_counts {
            let error_db = self.session.shown.as_ref().and_then(Shown::lux_error_db);
            self.solving.lux_error = (n_counts, error_db);
        }
        self.solving.lux_error.1
    }

    /// The sections of the right panel.
    pub(super) fn solving_ui(&mut self, ui: &mut Ui) {
        let lux_error_db = self.lux_error_db();
        let shown = self.session.shown.as_ref();
        let has_illuminance = shown.is_some_and(|shown| shown.pixel_irradiance().is_some());
        let lux_bake = self.lux_bake();
        let has_scene = self.session.lamp_scene().is_some();
        let figures = self.solving.measured.as_ref().map(|(_, figures)| figures.clone()).unwrap_or_default();
        let (surface, node) = self.picked().map_or((None, None), |picked| (picked.surface.clone(), picked.node));
        let floor = node.and_then(|node| self.node_name(node));
        let has_floor = self.look.scene.work_plane.is_none() || self.settings.work_plane.is_some();
        let problem = self.solving.problem.as_ref().map(|words| self.look.renamed(words));
        let shines = self.look.lights.lamps.iter().any(|lamp| !lamp.setting.muted);
        let view = MeasureView {
            marked: figures.marked.filter(|_| self.view.marking.marks().is_some()),
            grids: &figures.grids,
            has_illuminance,
            lux_error_db,
            lux_bake,
            counts_direct_only: shines && !shown.is_some_and(Shown::holds_lamp_lux),
            surface: surface.as_deref(),
            is_compared: self.looks.compare.is_some(),
            problem: problem.as_deref(),
            has_scene,
            floor: floor.as_deref(),
            has_floor,
            known_floor: self.known_floor(),
            elsewhere: self.elsewhere(),
            extent_m: self.session.extent_m(),
        };
        let mut asks_for_floor = false;
        let state = MeasureState {
            asks_for_floor: &mut asks_for_floor,
            marking: &mut self.view.marking,
            schedule: &mut self.solving.schedule,
            work_plane: &mut self.look.scene.work_plane,
        };
        measure_ui(ui, state, &view, &mut self.actions);
        let mut wishes = self.look.wishes.clone();
        let lights = || free_lights(&self.session, &self.follower, &self.look.lights);
        let view = SolveView {
            look: &self.look,
            lights: &lights,
            busy: match () {
                () if self.solving.is_due => Some("Waiting for the light of the lamps"),
                () if self.solving.solving.is_busy() => Some("Looking for the lights"),
                () => None,
            },
            is_outdated: self.look.wishes != self.solving.solved_for,
            is_soloed: !self.lights.solo.is_empty(),
            here: here(&self.session, &self.solving.pictures),
            lux_bake,
            has_scene,
            marked: surface.as_deref(),
        };
        let state = (&mut self.solving.state, &mut wishes);
        solve_ui(ui, state, &mut self.view.marking, &view, &mut self.actions);
        self.look.wishes = wishes;
        if asks_for_floor {
            self.ask_for_floor();
        }
    }
}

/// Keys of all lights that shine.
fn free_lights(session: &Session, follower: &Follower, rig: &LightRig) -> Vec<String> {
    let Some(basis) = session.basis() else { return Vec::new() };
    let parts = follower.lamp_light().map(|light| &light.parts[..]).unwrap_or_default();
    let known: BTreeSet<&str> = parts.iter().map(|part| part.key.as_str()).collect();
    may_change(basis, rig, |key| known.contains(key))
}

/// What wishes are about where they are solved.
fn here<'a>(session: &Session, pictures: &'a Pictures) -> Here<'a> {
    let shown = session.shown.as_ref();
    let grids = shown.into_iter().flat_map(|shown| shown.header.grids(shown.irradiance.len()));
    Here {
        framing: shown.map(|shown| Framing { film: shown.film(), camera: shown.camera.clone() }),
        grids: grids.map(|(set, grid)| (set, grid.name.clone())).collect(),
        units: shown.map_or_else(Units::default, |shown| Units::of(&shown.header.basis)),
        has_illuminance: shown.is_some_and(|shown| shown.pixel_irradiance().is_some()),
        pictures: Cow::Borrowed(pictures),
    }
}

/// What a free lamp brings with so many bounces; none of one that cannot shine.
fn column(
    part: LampPart,
    lit: &[FreeLamp],
    (scene, bounces): (&Arc<PreparedScene>, Option<u32>),
) -> Option<LampColumn> {
    let lamp = lit.iter().find(|lamp| lamp.key == part.key)?;
    let (prepared, _) = PreparedLamps::new(std::slice::from_ref(lamp), None).ok()?;
    let measured = part.is_measured().then(|| part.clone());
    Some(LampColumn {
        key: part.key.clone(),
        of_patches: part.of_patches().collect(),
        arriving: measured.map(|part| Arc::new(move |pixel| part.arriving(pixel)) as AtPixel),
        at_point: at_point(scene.clone(), prepared.in_scene(scene), bounces),
        direct: Arc::new(move |pixel| part.direct(pixel)),
    })
}
