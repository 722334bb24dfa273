//! Quality and size of the bake, or the pictures that it is of; what it does, and what came of it.

use std::ops::RangeInclusive;

use clerestory_transport::bake::{BakeConfig, Indirect};
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::figures::{ErrorDb, Figures};
use clerestory_transport::lamp_units::LampUnits;
use clerestory_transport::patches::{DEFAULT_PATCHES, MOST_PATCHES};
use eframe::egui::{self, Button, ProgressBar, RichText, Ui, Widget};

use super::heat::{HeatMap, heat_ui};
use super::number::{Number, before_drag};
use super::plot::error_plot_ui;
use super::status::duration;
use crate::action::{Action, FileTask};
use crate::session::estimate::Forecast;
use crate::session::{BakeSettings, BakeState};
use crate::sizes::bytes_words;
use crate::theme::{self, Fold};
use crate::words::columns_words;

/// A name for samples per pixel and tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// For people.
    pub name: &'static str,
    /// Samples per pixel, at most.
    pub spp: u32,
    /// Error at which a block is done, dB.
    pub tolerance_db: f32,
}

/// What there is to choose from.
pub const QUALITIES: [Quality; 4] = [
    Quality { name: "Preview", spp: 16, tolerance_db: 26.0 },
    Quality { name: "Draft", spp: 64, tolerance_db: 32.0 },
    Quality { name: "Final", spp: 256, tolerance_db: 40.0 },
    Quality { name: "High", spp: 1024, tolerance_db: 46.0 },
];

impl Quality {
    /// What it is in numbers, for people.
    fn hint(&self) -> String {
        let Quality { spp, tolerance_db, .. } = self;
        // Of an amplitude, as 20 dB are a tenth.
        let percent = 100.0 * 10f32.powf(-tolerance_db / 20.0);
        format!("{tolerance_db:.0} dB, {percent:.1} % of the peak of the lights, with at most {spp} samples per pixel")
    }
}

/// What somebody who wants a limit begins with, bytes.
const DEFAULT_LIMIT_BYTES: u64 = 8_000_000_000;
/// Pixels along a side of a bake in the window.
pub const SIDES_PX: RangeInclusive<u32> = 16..=8192;
/// Most samples per pixel of a bake in the window.
pub const MOST_SPP: u32 = 65_536;
/// Fewest patches of surface that are worth being told apart.
pub const FEWEST_PATCHES: u32 = 64;

/// What the panel shows.
pub struct BakeView<'a> {
    /// Where the bake stands.
    pub state: &'a BakeState,
    /// Ranks and bytes of what is shown.
    pub figures: Option<&'a Figures>,
    /// Names of the lights that it knows least well, the worst first, and their error in dB.
    pub worst_lights: &'a [(String, f32)],
    /// Memory of the graphics device that the picture takes, bytes, while that relights.
    pub device_bytes: Option<u64>,
    /// Error of the last pass.
    pub error_db: Option<ErrorDb>,
    /// Whether there is a scene or a stack, so that it can be baked.
    pub can_bake: bool,
    /// The camera that it is of.
    pub camera: Option<&'a Camera>,
    /// Number and size of the pictures, where the columns are pictures that were taken.
    pub pictures: Option<(usize, Film)>,
    /// How its lamps are counted, where it has lamps that leave room for a doubt.
    pub units: Option<LampUnits>,
    /// What was left behind on import, in words.
    pub report: &'a [String],
    /// Blocks that are there of a bake that was stopped and can go on.
    pub n_resumable: usize,
    /// What the bake will take.
    pub forecast: &'a Forecast,
    /// On how many threads it would run, of how many, within the memory that may be taken; or why it does not fit.
    pub threads: Option<Result<(usize, usize), String>>,
    /// The most memory that the program may take, bytes.
    pub memory_limit: Option<u64>,
    /// Seconds since the bake began, and its error at that time in dB.
    pub history: &'a [[f32; 2]],
}

/// What the bake will take or how far it is, and the button that starts or stops it: below all sections, where it is at hand
/// whatever is unfolded.
pub fn start_ui(ui: &mut Ui, view: &BakeView, actions: &mut Vec<Action>) {
    forecast_ui(ui, view);
    progress_ui(ui, view, actions);
}

/// Draws it.
pub fn bake_ui(
    ui: &mut Ui,
    settings: &mut BakeSettings,
    heat_map: &mut HeatMap,
    view: &BakeView,
    actions: &mut Vec<Action>,
) {
    theme::folding(ui, "Bake", Fold::Open, |ui| content_ui(ui, settings, heat_map, view, actions));
}

fn content_ui(
    ui: &mut Ui,
    settings: &mut BakeSettings,
    heat_map: &mut HeatMap,
    view: &BakeView,
    actions: &mut Vec<Action>,
) {
    ui.add_enabled_ui(view.can_bake, |ui| match view.pictures {
        Some(pictures) => pictures_ui(ui, &mut settings.config, pictures),
        None => settings_ui(ui, settings, view, actions),
    });
    if !view.history.is_empty() {
        ui.add_space(2.0);
        error_plot_ui(ui, view.history, settings.config.tolerance_db);
    }
    if let Some(figures) = view.figures {
        ui.add_space(2.0);
        heat_ui(ui, heat_map, view);
        figures_ui(ui, (figures, view.device_bytes), view.error_db);
        worst_ui(ui, figures, view.worst_lights);
        if *view.state == BakeState::Done
            && ui.button("Save bake…").on_hover_text("Open it later without baking again").clicked()
        {
            actions.push(Action::Ask(FileTask::SaveBake));
        }
    }
    if !view.report.is_empty() {
        report_ui(ui, view.report);
    }
}

fn settings_ui(ui: &mut Ui, settings: &mut BakeSettings, view: &BakeView, actions: &mut Vec<Action>) {
    egui::Grid::new("bake settings").num_columns(2).spacing([10.0, 7.0]).show(ui, |ui| {
        ui.label("Size");
        size_ui(ui, &mut settings.film, view.camera);
        ui.end_row();
        let label = ui.label("Quality");
        quality_ui(ui, &mut settings.config, label.id);
        ui.end_row();
        ui.label("");
        ui.horizontal(|ui| {
            let spp = Number::new(&mut settings.config.spp).range(2..=MOST_SPP).suffix(" spp");
            ui.add(spp).on_hover_text("Samples per pixel, at most").accessible_name("Samples per pixel");
            tolerance_ui(ui, &mut settings.config);
        });
        ui.end_row();
        ui.label("");
        let mut shared = settings.config.indirect == Indirect::Shared;
        let words = "Shares the light between surfaces among neighboring pixels: smoother, but smeared over a few pixels; \
                     the bias among the figures says by how much";
        if ui.checkbox(&mut shared, "Share indirect light").on_hover_text(words).changed() {
            settings.config.indirect = if shared { Indirect::Shared } else { Indirect::Traced };
        }
        ui.end_row();
        ui.label("");
        let words = "Takes noise out where pixels show the same surface, as far as two halves of the samples agree that it helps; \
                     edges of shadows stay sharp";
        ui.checkbox(&mut settings.config.denoise, "Denoise").on_hover_text(words);
        ui.end_row();
        ui.label("");
        patches_ui(ui, &mut settings.config.patches);
        ui.end_row();
        ui.label("");
        let hint = "Also bakes the light that arrives at each pixel, and at sensors of the file, in lux: for Measure, wishes for \
                    lux, and false color";
        ui.checkbox(&mut settings.illuminance, "Illuminance").on_hover_text(hint);
        ui.end_row();
        ui.label("Memory");
        memory_ui(ui, view.memory_limit, actions);
        ui.end_row();
        if let Some(units) = view.units {
            ui.label("");
            units_ui(ui, units, actions);
            ui.end_row();
        }
    });
}

/// What there is to set where nothing is traced.
fn pictures_ui(ui: &mut Ui, config: &mut BakeConfig, (n_pictures, film): (usize, Film)) {
    egui::Grid::new("picture settings").num_columns(2).spacing([10.0, 7.0]).show(ui, |ui| {
        ui.label("Pictures");
        ui.label(format!("{n_pictures} of {} × {}", film.width, film.height));
        ui.end_row();
        ui.label("Tolerance");
        tolerance_ui(ui, config);
        ui.end_row();
    });
}

fn tolerance_ui(ui: &mut Ui, config: &mut BakeConfig) {
    let tolerance = Number::new(&mut config.tolerance_db).range(0.0..=100.0).speed(0.1).suffix(" dB");
    ui.add(tolerance).on_hover_text("A block is done at this error").accessible_name("Tolerance");
}

/// Whether lamps that are moved later may light the room by way of its surfaces, and in a row of its own how finely these are told
/// apart.
fn patches_ui(ui: &mut Ui, patches: &mut u32) {
    let mut movable = *patches > 0;
    let hint = "Bakes how lamps that are added or moved afterwards light the room by way of its surfaces; without it they \
                show direct light only";
    if ui.checkbox(&mut movable, "Movable lamps").on_hover_text(hint).changed() {
        *patches = if movable { DEFAULT_PATCHES } else { 0 };
    }
    if movable {
        ui.end_row();
        ui.label("Patches");
        let number = Number::new(patches).range(FEWEST_PATCHES..=MOST_PATCHES).speed(16.0);
        number.ui(ui).on_hover_text("Patches of surface that are told apart").accessible_name("Number of patches");
    }
}

/// How much memory all of the program may take while it bakes.
fn memory_ui(ui: &mut Ui, limit: Option<u64>, actions: &mut Vec<Action>) {
    const GIGABYTE: f64 = 1e9;
    ui.horizontal(|ui| {
        let mut is_limited = limit.is_some();
        let hint = "Bakes on fewer threads where it would take more, and says so where that is not enough\nWithout a limit it may take \
                    what the system has left";
        if ui.checkbox(&mut is_limited, "At most").on_hover_text(hint).changed() {
            actions.push(Action::LimitMemory(is_limited.then_some(DEFAULT_LIMIT_BYTES)));
        }
        if let Some(limit) = limit {
            let mut gigabytes = limit as f64 / GIGABYTE;
            let value = Number::new(&mut gigabytes).range(0.01..=4096.0).speed(0.05).max_decimals(2).suffix(" GB");
            if ui.add(value).on_hover_text(hint).accessible_name("Memory limit").changed() {
                actions.push(Action::LimitMemory(Some((gigabytes * GIGABYTE) as u64)));
            }
        } else {
            ui.weak("what is free");
        }
    });
}

fn units_ui(ui: &mut Ui, units: LampUnits, actions: &mut Vec<Action>) {
    let mut is_unitless = units == LampUnits::Unitless;
    let hint = "For files whose lamps are not in candela and lux: their numbers count as watts per steradian, \
                683 times as bright\nThe scene is baked again";
    if ui.checkbox(&mut is_unitless, "Unitless lamps").on_hover_text(hint).changed() {
        let units = if is_unitless { LampUnits::Unitless } else { LampUnits::Photometric };
        actions.push(Action::ChooseUnits(units));
    }
}

fn size_ui(ui: &mut Ui, film: &mut Film, camera: Option<&Camera>) {
    ui.horizontal(|ui| {
        let before = *film;
        let width = ui.add(Number::new(&mut film.width).range(SIDES_PX));
        let width = width.on_hover_text("Pixels across; the height keeps the proportions").accessible_name("Width");
        let before = before_drag(ui, &width, before);
        if width.changed() {
            film.height = height_px(film.width, before, camera);
        }
        ui.label("×");
        let height = ui.add(Number::new(&mut film.height).range(SIDES_PX));
        height.on_hover_text("Pixels down").accessible_name("Height");
    });
}

/// The height that goes with a width: the camera's until somebody chose another, then in the proportions of before.
fn height_px(width: u32, before: Film, camera: Option<&Camera>) -> u32 {
    let side = |px: u32| px.clamp(*SIDES_PX.start(), *SIDES_PX.end());
    let of_camera = |width: u32| camera.map(|camera| side(Film::of_width(width, camera).height));
    let is_own = of_camera(before.width).is_none_or(|height| height.abs_diff(before.height) > 1);
    let scaled = || side((width as f32 * before.height as f32 / before.width as f32).round() as u32);
    of_camera(width).filter(|_| !is_own).unwrap_or_else(scaled)
}

fn quality_ui(ui: &mut Ui, config: &mut BakeConfig, label: egui::Id) {
    let current = QUALITIES.iter().find(|q| (q.spp, q.tolerance_db) == (config.spp, config.tolerance_db));
    let combo = egui::ComboBox::from_id_salt("quality").width(ui.available_width());
    let combo = combo.selected_text(current.map_or("Custom", |q| q.name)).show_ui(ui, |ui| {
        for quality in &QUALITIES {
            let choice = ui.selectable_label(current == Some(quality), quality.name);
            if choice.on_hover_text(quality.hint()).clicked() {
                (config.spp, config.tolerance_db) = (quality.spp, quality.tolerance_db);
            }
        }
    });
    combo.response.labelled_by(label);
}

/// What the bake will take, while there is none with these settings.
fn forecast_ui(ui: &mut Ui, view: &BakeView) {
    if view.state.is_running() {
        return;
    }
    if let Some(Err(why)) = &view.threads {
        ui.add(egui::Label::new(RichText::new(why).color(ui.visuals().error_fg_color)).wrap());
        return;
    }
    let threads = match view.threads {
        Some(Ok((n_threads, most))) if n_threads < most => {
            format!(", on {n_threads} of {most} threads to stay within the memory")
        }
        _ => String::new(),
    };
    let words = match view.forecast {
        Forecast::None => return,
        Forecast::Trying => "Estimating time and memory".into(),
        Forecast::Failed(why) => why.clone(),
        Forecast::There => "Baked before, there at once".into(),
        Forecast::Told(estimate) => format!(
            "About {}, {} of memory, a file of {}{threads}",
            duration(estimate.secs),
            bytes_words(estimate.memory_bytes),
            bytes_words(estimate.file_bytes)
        ),
    };
    let hint = "A few blocks all over the picture were baked as the bake would, and counted for all";
    ui.add(egui::Label::new(RichText::new(words).weak()).wrap()).on_hover_text(hint);
}

fn progress_ui(ui: &mut Ui, view: &BakeView, actions: &mut Vec<Action>) {
    let width = egui::vec2(ui.available_width(), 28.0);
    if view.state.is_running() {
        let (done, text) = match view.state {
            BakeState::Running { done, pass_done, secs_left, pass, n_passes } => {
                pass_progress((*pass, *n_passes), [*done, *pass_done], *secs_left)
            }
            _ => (0.0, "Measuring the lights".into()),
        };
        ui.add(ProgressBar::new(done).corner_radius(3).text(RichText::new(text).small()));
        if ui.add_sized(width, Button::new("Cancel bake")).on_hover_text("What is done stays").clicked() {
            actions.push(Action::CancelBake);
        }
        return;
    }
    if view.n_resumable > 0 {
        let resume = Button::new(RichText::new("Resume bake").color(theme::ON_ACCENT)).fill(theme::ACCENT);
        let hint = format!("{} blocks of the last pass are there already", view.n_resumable);
        if ui.add_sized(width, resume).on_hover_text(hint).clicked() {
            actions.push(Action::ResumeBake);
        }
        let over = ui.add_sized(width, Button::new("Start over"));
        if over.on_hover_text("Bakes from the beginning; the blocks that are there do not count").clicked() {
            actions.push(Action::StartBake);
        }
        return;
    }
    let start = Button::new(RichText::new("Start bake").color(theme::ON_ACCENT)).fill(theme::ACCENT);
    let start = ui.add_enabled_ui(view.can_bake, |ui| ui.add_sized(width, start)).inner;
    if start.on_disabled_hover_text("Open a scene first").clicked() {
        actions.push(Action::StartBake);
    }
    match view.state {
        BakeState::Failed(why) => {
            ui.colored_label(ui.visuals().error_fg_color, why);
        }
        BakeState::Stopped => {
            let words = if view.figures.is_some() { "Stopped, what was done is shown" } else { "Stopped" };
            ui.label(RichText::new(words).weak());
        }
        _ => {}
    }
}

/// How far a bar is filled, and what it says: of the whole bake once its time can be judged, before that of the pass.
fn pass_progress((pass, n_passes): (u32, u32), [done, pass_done]: [f32; 2], secs_left: Option<f32>) -> (f32, String) {
    let what = match (pass, n_passes) {
        (_, 1) => "Compressing".into(),
        (0, _) => "Preview".into(),
        _ => format!("Pass {pass} of {}", n_passes.saturating_sub(1)),
    };
    match secs_left {
        Some(secs) => (done, format!("{what}, {} left", duration(secs))),
        None => (pass_done, format!("{what}, {:.0} %", 100.0 * pass_done)),
    }
}

fn figures_ui(ui: &mut Ui, (figures, device_bytes): (&Figures, Option<u64>), error: Option<ErrorDb>) {
    let rows = [
        ("Lights", columns_words(figures.columns as u64), "Columns of the matrix"),
        ("Blocks", format!("{}", figures.blocks), "Blocks of pixels"),
        ("Rank", format!("{:.1} mean, {} most", figures.mean_rank, figures.max_rank), "Terms that each block needs"),
        ("Memory", bytes_words(figures.bytes as u64), "What relighting reads"),
        ("File", figures.file_bytes.map_or("after the bake".into(), |n| bytes_words(n as u64)), "The packed factors"),
        (
            "Full matrix",
            format!("{:.0}× as large", figures.ratio),
            "In 32-bit floats, against the file once there is one",
        ),
        ("Lost detail", decibels(error.map(|e| e.truncation)), "What the ranks leave out"),
        ("Noise left", decibels(error.map(|e| e.sampling)), "Grain of the samples that stays"),
        (
            "Total error",
            decibels(error.map(|e| e.total)),
            "Of entries of the matrix, below what the lights reach at their brightest",
        ),
        (
            "Median error",
            decibels(Some(figures.block_error_db.total.median)),
            "Half of the blocks of pixels are at this or better; a few pixels beside a light may hold most of the total",
        ),
    ];
    let bias = error.and_then(|e| e.bias);
    let shared =
        bias.map(|db| ("Bias", decibels(Some(db)), "Off by shared light, measured on pixels that were traced"));
    let n_reused = figures.skipped.reused_columns;
    let hint = "Columns of an earlier bake with the same surfaces, view and settings; the others were traced";
    let reused = (n_reused > 0)
        .then(|| ("Taken over", format!("{n_reused} of {}", columns_words(figures.columns as u64)), hint));
    let in_full = figures.reconstruction.as_ref().map(|of| {
        (
            "Method",
            format!("{}, its reconstruction in full", of.method),
            "The file does not hold its own form: ranks and sizes say nothing of it",
        )
    });
    let on_device = device_bytes.map(|n| ("Graphics device", bytes_words(n), "Its memory that the picture takes"));
    egui::Grid::new("figures").num_columns(2).spacing([10.0, 3.0]).show(ui, |ui| {
        for (name, value, hint) in rows.into_iter().chain(in_full).chain(on_device).chain(shared).chain(reused) {
            ui.label(RichText::new(name).weak()).on_hover_text(hint);
            ui.label(value);
            ui.end_row();
        }
    });
}

/// The lights that are known least well, a line each; nothing where a bake does not tell.
fn worst_ui(ui: &mut Ui, figures: &Figures, worst: &[(String, f32)]) {
    let Some(told) = figures.column_error_db.as_ref().filter(|_| !worst.is_empty()) else { return };
    let hint = format!(
        "Error of a light by itself, below its own brightest in the picture: seen once it shines alone, or much brighter than in the file; \
         more samples help\nOf the columns of all lights half are worse than {:.1} dB, a tenth are worse than {:.1} dB",
        told.median, told.tenth
    );
    egui::CollapsingHeader::new("Least known lights").default_open(true).show(ui, |ui| {
        for (name, db) in worst {
            let words = format!("{name}, {}", decibels(Some(*db)));
            ui.add(egui::Label::new(words).wrap()).on_hover_text(&hint);
        }
    });
}

fn report_ui(ui: &mut Ui, report: &[String]) {
    let title = format!("Report ({})", report.len());
    egui::CollapsingHeader::new(title).id_salt("report").show(ui, |ui| {
        for line in report {
            ui.label(RichText::new(line).small());
        }
    });
}

/// Beyond this nothing is told apart in factors of 16 bits.
const BEST_DB: f32 = 100.0;

fn decibels(db: Option<f32>) -> String {
    match db {
        None => "not measured yet".into(),
        Some(db) if db >= BEST_DB => "none".into(),
        Some(db) => format!("{db:.1} dB below peak"),
    }
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    use super::*;

    #[test]
    fn the_final_quality_is_the_default_of_the_command_line() {
        let config = BakeConfig::default();
        assert_eq!((QUALITIES[2].spp, QUALITIES[2].tolerance_db), (config.spp, config.tolerance_db));
    }

    #[test]
    fn a_quality_says_what_it_is_in_numbers() {
        let hints = QUALITIES.map(|quality| quality.hint());
        assert_eq!(hints[1], "32 dB, 2.5 % of the peak of the lights, with at most 64 samples per pixel");
        assert!(hints[0].starts_with("26 dB, 5.0 %") && hints[2].starts_with("40 dB, 1.0 %"), "{hints:?}");
    }

    #[test]
    fn a_bake_that_was_stopped_before_its_first_block_shows_nothing() {
        let view = BakeView {
            state: &BakeState::Stopped,
            figures: None,
            worst_lights: &[],
            device_bytes: None,
            error_db: None,
            can_bake: true,
            camera: None,
            pictures: None,
            units: None,
            report: &[],
            n_resumable: 0,
            forecast: &Forecast::None,
            threads: None,
            memory_limit: None,
            history: &[],
        };
        let mut window = Harness::new_ui(|ui| start_ui(ui, &view, &mut Vec::new()));
        window.run_steps(2);
        window.get_by_label("Stopped");
    }

    #[test]
    fn a_pass_tells_its_share_until_time_can_be_judged() {
        let shares = [0.03, 0.42];
        assert_eq!(pass_progress((0, 3), shares, None), (0.42, "Preview, 42 %".into()));
        assert_eq!(pass_progress((0, 1), shares, None), (0.42, "Compressing, 42 %".into()));
        let judged = pass_progress((1, 3), shares, Some(61.0));
        assert_eq!(judged, (0.03, "Pass 1 of 2, 1 min 1 s left".into()), "the bar counts what is said");
    }
}
