//! Where everything stands in the window: bars above and below, panels left and right, the picture between them, dialogs over it.

use clerestory_transport::camera::Camera;
use eframe::egui::{self, Context, Panel, Ui, ViewportCommand};

use super::App;
use super::habits::BakeHabits;
use crate::action::{Action, Side};
use crate::look::{Look, Units};
use crate::panels::bake::{BakeView, bake_ui, start_ui};
use crate::panels::dialogs::{UnsavedAnswer, unsaved_ui};
use crate::panels::display::{DisplayView, display_ui};
use crate::panels::lights::{lights_ui, solo_banner_ui};
use crate::panels::looks::mix;
use crate::panels::shortcuts::{close_by_key, shortcuts_ui};
use crate::panels::sight::keep_in_sight;
use crate::panels::status::{Status, status_ui};
use crate::panels::toolbar::{ToolbarState, toolbar_ui};
use crate::session::estimate::Forecast;
use crate::session::prints::Slot;
use crate::session::{BakeSettings, Session};
use crate::theme;
use crate::viewport::{Viewed, viewport_ui};

/// Points that picture and right panel keep when the lights take room.
const PICTURE_LEAST: f32 = 660.0;
/// Points that the picture keeps when the right panel takes room, and the most that this takes.
const PICTURE_BESIDE: f32 = 380.0;
const SETTINGS_MOST: f32 = 460.0;
/// Points at the top of the picture that what is said of a camera in hand takes.
const CAMERA_BANNER: f32 = 50.0;
/// Width of the right panel at first, points.
const SETTINGS_WIDTH: f32 = 264.0;
/// Least widths of the panel of lights and of the right panel, points.
const PANELS_LEAST: [f32; 2] = [300.0, 252.0];

/// Fills the screen with the window, or lets it go back.
pub(super) fn toggle_full_screen(ctx: &Context) {
    let is_full = ctx.input(|input| input.viewport().fullscreen) == Some(true);
    ctx.send_viewport_cmd(ViewportCommand::Fullscreen(!is_full));
}

impl App {
    pub(super) fn dialogs_ui(&mut self, ctx: &Context) {
        close_by_key(ctx, &mut self.shortcuts);
        self.question_ui(ctx);
        self.losing_ui(ctx);
        if self.unsaved.is_some()
            && let Some(answer) = unsaved_ui(ctx)
        {
            let waiting = self.unsaved.take();
            match answer {
                UnsavedAnswer::Stay => {
                    if waiting == Some(Action::TakeOpened) {
                        self.cancel_opening();
                    }
                    self.stay();
                }
                UnsavedAnswer::Save => {
                    self.after_saving = waiting;
                    self.actions.push(Action::SaveLookAgain);
                }
                // What is there stays unsaved until something else takes its place, which may fail.
                UnsavedAnswer::Discard => {
                    self.may_lose_look = waiting != Some(Action::TakeOpened);
                    self.actions.extend(waiting);
                }
            }
        }
        self.look_conflict_ui(ctx);
        self.recovery_ui(ctx);
        shortcuts_ui(ctx, &mut self.shortcuts);
        hovered_files_ui(ctx, if self.question.is_some() { "Drop to take its path" } else { "Drop to open" });
    }

    /// Whether a question lies over the window.
    pub(super) fn waits_for_an_answer(&self) -> bool {
        self.question.is_some()
            || self.unsaved.is_some()
            || self.losing.waits_for_an_answer()
            || self.look_files.waits_for_an_answer()
            || self.left_behind().is_some()
    }

    /// Opens the list of keys, or closes it. What has the focus lets go of it, so that no key works behind the list; a text keeps it, and is
    /// given up by the key that closes the list.
    pub(super) fn toggle_shortcuts(&mut self, ctx: &Context) {
        self.shortcuts = !self.shortcuts;
        let focused = ctx.memory(|memory| memory.focused());
        if let Some(focused) = focused.filter(|_| self.shortcuts && !ctx.text_edit_focused()) {
            ctx.memory_mut(|memory| memory.surrender_focus(focused));
        }
    }

    /// Closes a panel at the side, or opens it, with all others that are hidden.
    pub(super) fn toggle_panel(&mut self, ctx: &Context, side: Side) {
        if std::mem::take(&mut self.is_bare) && self.sides.shows(side, ctx.content_rect().width()) {
            return;
        }
        self.sides.toggle(side, ctx.content_rect().width());
    }

    /// Whether the panel of lights and that of settings are to be seen.
    fn panels_seen(&self, ctx: &Context) -> [bool; 2] {
        let width = ctx.content_rect().width();
        [Side::Lights, Side::Settings].map(|side| !self.is_bare && self.sides.shows(side, width))
    }

    pub(super) fn side_panels_ui(&mut self, ui: &mut Ui) {
        let [lights, settings] = self.panels_seen(ui.ctx());
        if lights {
            self.lights_panel_ui(ui, settings);
        }
        if settings {
            self.settings_panel_ui(ui);
        }
    }

    fn lights_panel_ui(&mut self, ui: &mut Ui, has_other: bool) {
        // Where there is little room, what the panels need least is left to the picture.
        let [least, right_least] = PANELS_LEAST;
        let picture = PICTURE_LEAST - if has_other { 0.0 } else { right_least };
        let most = (ui.available_width() - picture).clamp(least, 900.0);
        let (view, wanted) = (self.lights.layout.view, self.lights.layout.view.width());
        // Each view keeps a width of its own, and large letters do not leave a narrow panel behind.
        let id = egui::Id::unique(("lights", view, most < wanted));
        let panel = Panel::left(id).frame(side_frame(ui)).default_size(wanted.min(most)).size_range(least..=most);
        panel.show(ui, |ui| {
            if let Some(basis) = self.session.basis().cloned() {
                self.sky_ui(ui, &basis);
                let choice = self.lamp_choice();
                self.lights.lamps.extent_m = self.session.extent_m();
                lights_ui(ui, &basis, &mut self.look, &mut self.lights, &choice, &mut self.actions);
            } else {
                theme::section(ui, "Lights");
            }
            ui.take_available_space();
        });
    }

    fn settings_panel_ui(&mut self, ui: &mut Ui) {
        let [_, least] = PANELS_LEAST;
        let most = (ui.available_width() - PICTURE_BESIDE).clamp(least, SETTINGS_MOST);
        // Large letters do not leave a narrow panel behind.
        let id = egui::Id::unique(("settings", most < SETTINGS_WIDTH));
        let panel =
            Panel::right(id).frame(side_frame(ui)).default_size(SETTINGS_WIDTH.min(most)).size_range(least..=most);
        panel.show(ui, |ui| {
            // What is too wide for one frame (a grid that is new) must not widen the panel for ever.
            let room = ui.available_rect_before_wrap();
            let inner = &mut ui.new_child(egui::UiBuilder::new().max_rect(room));
            let frame = egui::Frame::NONE.inner_margin(egui::Margin { top: 6, ..egui::Margin::ZERO });
            Panel::bottom("start").frame(frame).show(inner, |ui| {
                start_ui(
                    ui,
                    &bake_view(&self.session, (&self.settings, self.camera.camera.as_ref()), (None, &[])),
                    &mut self.actions,
                );
            });
            egui::ScrollArea::vertical().id_salt("right").auto_shrink([false, false]).show(inner, |ui| {
                let view = DisplayView {
                    shown_ev: self.follower.shown_ev(),
                    metered_ev: self.follower.metered_ev(),
                    legend: self.follower.legend(self.units()),
                    units: self.units(),
                    has_illuminance: self.session.shown.as_ref().is_some_and(|s| s.pixel_irradiance().is_some()),
                    lux_bake: self.lux_bake(),
                };
                display_ui(ui, &mut self.look.display, &view, &mut self.actions);
                self.camera_panel_ui(ui);
                self.solving_ui(ui);
                self.bake_panel_ui(ui);
                keep_in_sight(ui, "settings");
            });
            ui.take_available_space();
        });
    }

    /// What the numbers of the picture count.
    pub(super) fn units(&self) -> Units {
        self.session.shown.as_ref().map_or(Units::Photometric, |shown| Units::of(&shown.header.basis))
    }

    pub(super) fn bake_panel_ui(&mut self, ui: &mut Ui) {
        let asked = (&self.settings, self.camera.camera.as_ref());
        let worst = worst_lights(&self.session, &self.look);
        let view = bake_view(&self.session, asked, (self.follower.device_bytes(), &worst));
        // A bake that was opened shows how it was baked; what the next scene is baked with stays.
        let mut of_file = if view.can_bake { None } else { self.session.settings_of_shown() };
        let is_of_scene = view.can_bake && view.pictures.is_none();
        let own = if view.pictures.is_some() { &mut self.stack_settings } else { &mut self.settings };
        let shown = of_file.as_mut().unwrap_or(own);
        let before = shown.clone();
        bake_ui(ui, shown, &mut self.heat_map, &view, &mut self.actions);
        if *shown != before && is_of_scene {
            self.habits = BakeHabits::of(shown, self.camera.camera.as_ref());
        }
    }

    pub(super) fn bars_ui(&mut self, ui: &mut Ui) {
        self.ask_memory(ui.ctx());
        let frame = egui::Frame::side_top_panel(ui.style()).inner_margin(egui::Margin::symmetric(12, 7));
        Panel::top("toolbar").frame(frame).show(ui, |ui| {
            let state = ToolbarState {
                is_bare: self.is_bare,
                panels_seen: self.panels_seen(ui.ctx()),
                can_undo: self.steps.can_undo(),
                can_redo: self.steps.can_redo(),
                has_picture: self.follower.picture().is_some(),
                is_unsaved: self.is_unsaved(),
                look_file: self.look_path.as_deref(),
                recent: &self.recent,
            };
            toolbar_ui(ui, &state, &mut self.actions);
        });
        let frame = frame.inner_margin(egui::Margin::symmetric(12, 3));
        Panel::bottom("status").frame(frame).show(ui, |ui| {
            let device = self.follower.device();
            let figures = self.session.figures.as_ref();
            let worst = worst_lights(&self.session, &self.look);
            let (lamps, lamp_remarks) = self.lamp_notes();
            let status = Status {
                messages: &self.messages,
                opening: self.session.is_opening(),
                bake: &self.session.bake,
                frames: self.session.frames(),
                device: &device,
                wish: self.follower.wish(),
                size: self.follower.picture().map(|(_, size)| size),
                millis: self.follower.millis(),
                lamps,
                lamp_remarks,
                error_db: self.session.error_db.map(|error| error.total),
                median_db: figures.map(|figures| figures.block_error_db.total.median),
                missed: self.session.missed_words().map(|words| self.look.renamed(&words)),
                worst_lights: &worst,
                memory_bytes: self.memory.bytes(),
                device_bytes: self.follower.device_bytes(),
            };
            status_ui(ui, &status, &mut self.actions);
        });
    }

    pub(super) fn picture_ui(&mut self, ui: &mut Ui) {
        self.strips_ui(ui);
        self.picture_area = ui.available_rect_before_wrap();
        if self.camera.is_moving && self.session.lamp_scene().is_some() {
            // A drag that went on in a picture that is not there would jump to where the pointer is when that comes back.
            self.let_go();
            self.flight_ui(ui);
            let below = self.picture_area.with_min_y(self.picture_area.top() + CAMERA_BANNER);
            return solo_banner_ui(ui, below, &self.look, &mut self.lights.solo);
        }
        let overlay = self.heat_overlay(ui.ctx());
        self.look_there(ui.ctx());
        let shown_camera = self.session.shown.as_ref().and_then(|shown| shown.camera.as_ref());
        let scene = self.session.lamp_scene().map(|scene| &**scene);
        self.prober.heed_view(self.session.shown.as_ref(), &mut self.view.probes);
        let (left, compared) = self.compared().unzip();
        let picture = self.follower.picture().map(|(texture, size)| (left.unwrap_or(texture), size));
        let sides = self.looks.compare.as_ref().filter(|_| compared.is_some()).map(|compare| &compare.sides);
        let (lit, handled) = ((&self.follower, &self.prints), self.handled_side(compared.as_ref()));
        let stage = scene.zip(shown_camera).filter(|_| handled.is_some());
        if stage.is_none() {
            // As with the camera in hand.
            self.lights.lamps.let_go();
        }
        let now = self.follower.legend(self.units());
        // Looks that were kept have scales of their own.
        let legend_of = |idx: usize| match sides.map(|sides| &sides[idx]) {
            None if idx > 0 => None,
            None | Some(mix::Side::Present) => now,
            Some(mix::Side::Snapshot(_)) => self.prints.legend(&Slot::Side(idx)),
        };
        let legends = [0, 1].map(legend_of);
        let viewed = Viewed {
            picture,
            stage: &self.session.stage,
            bake: &self.session.bake,
            is_glimpse: self.session.is_glimpse(),
            scene: stage,
            baked: self.session.shown.as_ref().map(|shown| &shown.header.basis),
            handled: handled.unwrap_or_default(),
            navigation: self.camera.habits.navigation,
            legends,
            isolines: self.isolux.lines(),
            compared,
            overlay,
            readings: self.prober.read(&self.session, lit, &self.view.probes, sides),
        };
        egui::CentralPanel::no_frame().show(ui, |ui| {
            let area = ui.available_rect_before_wrap();
            viewport_ui(ui, &viewed, &mut self.view, &mut self.look, &mut self.lights, &mut self.actions);
            solo_banner_ui(ui, area, &self.look, &mut self.lights.solo);
        });
    }
}

/// What the lights that a bake knows least well are called, the worst first, and their error in dB.
fn worst_lights(session: &Session, look: &Look) -> Vec<(String, f32)> {
    let told = session.figures.as_ref().and_then(|figures| figures.column_error_db.as_ref());
    let worst = told.map_or(&[][..], |told| &told.worst);
    worst.iter().map(|worst| (look.name_of(&worst.light).to_owned(), worst.db)).collect()
}

fn bake_view<'a>(
    session: &'a Session,
    (settings, camera): (&BakeSettings, Option<&'a Camera>),
    (device_bytes, worst_lights): (Option<u64>, &'a [(String, f32)]),
) -> BakeView<'a> {
    let opened = session.opened.as_ref();
    BakeView {
        state: &session.bake,
        figures: session.figures.as_ref(),
        worst_lights,
        device_bytes,
        error_db: session.error_db,
        camera,
        can_bake: session.has_scene() || opened.is_some_and(|opened| opened.stack.is_some()),
        pictures: session.pictures(),
        units: opened.filter(|opened| opened.has_plain_lamps()).map(|opened| opened.chosen.units),
        report: opened.map_or(&[], |opened| &opened.report),
        n_resumable: session.n_resumable(settings, camera),
        forecast: session.forecast(),
        threads: match session.forecast() {
            Forecast::Told(estimate) => Some(session.threads_foreseen(estimate)),
            _ => None,
        },
        memory_limit: session.memory_limit,
        history: &session.history,
    }
}

fn side_frame(ui: &Ui) -> egui::Frame {
    egui::Frame::side_top_panel(ui.style()).inner_margin(egui::Margin::symmetric(12, 6))
}

fn hovered_files_ui(ctx: &Context, words: &str) {
    if ctx.input(|input| input.raw.hovered_files.is_empty()) {
        return;
    }
    let layer = egui::LayerId::new(egui::Order::Foreground, egui::Id::unique("dropping"));
    let (painter, area) = (ctx.layer_painter(layer), ctx.content_rect());
    painter.rect_filled(area, 0.0, egui::Color32::from_black_alpha(150));
    let font = egui::FontId::proportional(22.0);
    painter.text(area.center(), egui::Align2::CENTER_CENTER, words, font, theme::ACCENT);
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use clerestory_transport::bake::BakeConfig;
    use clerestory_transport::camera::Film;
    use clerestory_transport::lamps::LampShape;
    use eframe::egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    use super::*;
    use crate::session::BakeState;
    use crate::support::room_window;

    #[test]
    fn a_lamp_that_is_dragged_as_its_picture_goes_stays_where_it_was_seen_last() {
        let film = Film { width: 64, height: 48 };
        let config = BakeConfig { spp: 4, tolerance_db: 20.0, ..BakeConfig::default() };
        let settings = BakeSettings { camera_idx: 0, film, config, illuminance: false, work_plane: None };
        let mut window = room_window(Some(settings));
        for _ in 0..40_000 {
            window.step();
            let app = window.state();
            if app.session.bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled() {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        let ctx = window.ctx.clone();
        window.state_mut().apply(&ctx, Action::AddLamp { shape: LampShape::Point, at_px: None });
        window.run_steps(4);
        let at = window.get_by_label("Move Point lamp 1 over surfaces").rect().center();
        window.hover_at(at);
        window.run_steps(2);
        window.drag_at(at);
        for down in [0.0, 4.0, 8.0, 12.0] {
            window.hover_at(at + vec2(0.0, down));
            window.run_steps(2);
        }
        assert!(window.state().lights.lamps.drag.is_some());
        let place = |window: &Harness<App>| window.state().look.lights.lamps[0].position;
        let before = place(&window);
        // A scene that is prepared again has no picture for a while.
        let shown = window.state_mut().session.shown.take();
        window.run_steps(2);
        window.drop_at(at);
        window.run_steps(2);
        window.hover_at(at + vec2(-40.0, 30.0));
        window.run_steps(2);
        window.state_mut().session.shown = shown;
        window.run_steps(3);
        assert_eq!(place(&window), before);
    }
}
