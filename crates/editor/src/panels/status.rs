//! The bar at the bottom: what just happened, what runs, and on which device.

use eframe::egui::{self, ProgressBar, RichText, Ui};

use super::messages::Messages;
use crate::action::Action;
use crate::picture::DeviceWish;
use crate::session::BakeState;
use crate::sizes::bytes_words;

/// What the bar shows.
pub struct Status<'a> {
    /// What was said.
    pub messages: &'a Messages,
    /// Whether a file is being read.
    pub opening: bool,
    /// The bake.
    pub bake: &'a BakeState,
    /// Frames of a timeline that are written, and how many there will be, while they are under way.
    pub frames: Option<(u32, u32)>,
    /// What multiplies.
    pub device: &'a str,
    /// Which device is wanted.
    pub wish: DeviceWish,
    /// Size of the picture in pixels.
    pub size: Option<[u32; 2]>,
    /// From edit to picture.
    pub millis: Option<f32>,
    /// What there is to know about the light of free lamps.
    pub lamps: LampNote,
    /// What else there is to know of lamps that shine, in sentences.
    pub lamp_remarks: Vec<String>,
    /// Error of what is shown, dB below the peaks of the lights.
    pub error_db: Option<f32>,
    /// Error that half of its blocks do not reach: a few bright pixels beside a light can hold most of the whole.
    pub median_db: Option<f32>,
    /// What was asked for and would help, where a finished bake is far from that.
    pub missed: Option<String>,
    /// Lights that the bake knows least well, the worst first, and their error in dB.
    pub worst_lights: &'a [(String, f32)],
    /// Memory of the program, bytes.
    pub memory_bytes: Option<u64>,
    /// Memory of the graphics device that the picture takes, bytes, while that relights.
    pub device_bytes: Option<u64>,
}

impl Status<'_> {
    /// What is good to know and can be done without, with what it is.
    fn figures(&self) -> impl Iterator<Item = (String, &'static str)> {
        let millis = self.millis.map(|millis| (format!("{millis:.1} ms"), "From an edit to the picture"));
        let size = self.size.map(|[width, height]| (format!("{width} × {height}"), "Pixels of the picture"));
        let on_device = self.device_bytes.map(|bytes| {
            (format!("{} on the device", bytes_words(bytes)), "Memory of the graphics device that the picture takes")
        });
        let memory = self.memory_bytes.map(|bytes| (bytes_words(bytes), "Memory of the program"));
        [millis, size, on_device, memory].into_iter().flatten()
    }
}

/// About the light of free lamps.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LampNote {
    /// Nothing.
    None,
    /// It is not there yet.
    Pending,
    /// The bake has no patches.
    DirectOnly,
    /// It lacks some that surfaces throw on.
    Lacking {
        /// Caustics are among it.
        caustics: bool,
        /// What each lamp lacks, in sentences.
        words: Vec<String>,
    },
    /// Lamps do not shine: why, in sentences.
    Problem(Vec<String>),
}

/// Remarks that are listed; a thousand lamps can share a profile of which there is one.
const LISTED_REMARKS: usize = 12;

/// Width in points that all figures have room in.
const WIDE: f32 = 1000.0;

/// Draws it.
pub fn status_ui(ui: &mut Ui, status: &Status, actions: &mut Vec<Action>) {
    let is_wide = ui.available_width() >= WIDE;
    ui.horizontal(|ui| {
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let device =
                ui.menu_button(format!("Relight: {}", status.device), |ui| device_menu(ui, status.wish, actions));
            let figures = status.figures();
            if is_wide {
                for (words, hint) in figures {
                    ui.label(RichText::new(words).weak()).on_hover_text(hint);
                }
            } else {
                let lines = figures.map(|(words, hint)| format!("{hint}: {words}"));
                device.response.on_hover_text(lines.collect::<Vec<_>>().join("\n"));
            }
            if let Some(db) = status.error_db {
                let hint = "Error of the bake, below the peaks of the lights: more is better. A few pixels beside a light may hold most of it; half of the picture is at the median or better";
                let median = status.median_db.filter(|_| is_wide);
                let median = median.map_or(String::new(), |median| format!(", median {median:.1} dB"));
                let words = RichText::new(format!("{db:.1} dB{median}"));
                let (words, missed) = match &status.missed {
                    Some(missed) => (words.color(ui.visuals().warn_fg_color), format!("\n{missed}")),
                    None => (words.weak(), String::new()),
                };
                ui.label(words).on_hover_text(format!("{hint}{}{missed}", worst_words(status.worst_lights)));
            }
            remarks_ui(ui, &status.lamp_remarks);
            lamps_ui(ui, &status.lamps, actions);
            if status.opening {
                let stop = ui.small_button("Stop").on_hover_text("Stop opening the file; what is open stays");
                if stop.accessible_name("Stop opening").clicked() {
                    actions.push(Action::CancelOpening);
                }
                ui.label(RichText::new("Opening").weak());
            }
            if status.bake.is_running() {
                let stop = ui.small_button("Stop").on_hover_text("Stop the bake; what is done stays");
                if stop.accessible_name("Stop the bake").clicked() {
                    actions.push(Action::CancelBake);
                }
            }
            if let BakeState::Running { done, pass, n_passes, pass_done, secs_left } = status.bake {
                // The bar is filled by what it says.
                let (filled, text) = match secs_left {
                    Some(secs) => (*done, format!("{} left", duration(*secs))),
                    None if *pass == 0 && *n_passes > 1 => (*pass_done, format!("Preview, {:.0} %", 100.0 * pass_done)),
                    None => (*done, format!("{:.0} %", 100.0 * done)),
                };
                let bar = ProgressBar::new(filled)
                    .desired_width(150.0)
                    .desired_height(14.0)
                    .corner_radius(3)
                    .text(RichText::new(text).small());
                ui.add(bar);
                ui.label(RichText::new("Baking").weak());
            }
            frames_ui(ui, status.frames, actions);
            ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                status.messages.bar_ui(ui);
            });
        });
    });
}

/// How far the frames of a timeline are, which go on while that is closed or something else is opened.
fn frames_ui(ui: &mut Ui, frames: Option<(u32, u32)>, actions: &mut Vec<Action>) {
    let Some((n_written, n_frames)) = frames else { return };
    let stop = ui.small_button("Stop").on_hover_text("Stop writing frames; those that are there stay");
    if stop.accessible_name("Stop the frames").clicked() {
        actions.push(Action::CancelFrames);
    }
    let words = format!("Writing frames, {n_written} of {n_frames}");
    ui.label(RichText::new(words).weak())
        .on_hover_text("Frames of the timeline; they go on whatever is opened meanwhile");
}

/// Lights that are known less well than others, a line; nothing of none.
fn worst_words(lights: &[(String, f32)]) -> String {
    let words: Vec<String> = lights.iter().map(|(name, db)| format!("{name} {db:.1} dB")).collect();
    if words.is_empty() { String::new() } else { format!("\nLeast is known of {}", words.join(", ")) }
}

fn lamps_ui(ui: &mut Ui, note: &LampNote, actions: &mut Vec<Action>) {
    match note {
        LampNote::None => {}
        LampNote::Pending => {
            ui.label(RichText::new("Lamps: lighting").weak()).on_hover_text("The light of moved lamps is on its way");
        }
        LampNote::DirectOnly => {
            let hint = "This bake does not know how added and moved lamps light the room by way of its surfaces";
            let words = RichText::new("Lamps: direct light only").color(ui.visuals().warn_fg_color);
            let menu = ui.menu_button(words, |ui| {
                ui.label(hint);
                let bake = ui.button("Bake the rest of their light");
                if bake.on_hover_text("The same bake with “Movable lamps”").clicked() {
                    actions.push(Action::BakePatches);
                }
            });
            menu.response.on_hover_text(hint);
        }
        LampNote::Lacking { caustics, words } => {
            let name = if *caustics { "Lamps: without caustics" } else { "Lamps: without mirrored light" };
            let lines = words.join("\n");
            // A click tells it as well, to those who have no pointer that rests.
            let menu = ui.menu_button(RichText::new(name).weak(), |ui| ui.label(lines.as_str()));
            menu.response.on_hover_text(lines.as_str());
        }
        LampNote::Problem(why) => {
            let words = RichText::new("Lamps: not all shine").color(ui.visuals().error_fg_color);
            ui.label(words).on_hover_text(remark_lines(why));
        }
    }
}

/// What there is to know of lamps that shine, which is no reason to worry.
fn remarks_ui(ui: &mut Ui, remarks: &[String]) {
    let name = match remarks.len() {
        0 => return,
        1 => "Lamps: 1 remark".to_owned(),
        n_remarks => format!("Lamps: {n_remarks} remarks"),
    };
    let lines = remark_lines(remarks);
    // A click tells it as well, to those who have no pointer that rests.
    let menu = ui.menu_button(RichText::new(name).weak(), |ui| ui.label(lines.as_str()));
    menu.response.on_hover_text(lines.as_str());
}

/// The first remarks, a line each, and how many follow.
fn remark_lines(remarks: &[String]) -> String {
    let n_listed = remarks.len().min(LISTED_REMARKS);
    let lines = remarks[..n_listed].join("\n");
    match remarks.len() - n_listed {
        0 => lines,
        n_more => format!("{lines}\nand {n_more} more"),
    }
}

fn device_menu(ui: &mut Ui, wish: DeviceWish, actions: &mut Vec<Action>) {
    for (device, name) in DeviceWish::ALL {
        if ui.radio(wish == device, name).clicked() {
            actions.push(Action::UseDevice(device));
            ui.close();
        }
    }
}

/// Seconds in words, coarser the longer.
pub fn duration(secs: f32) -> String {
    let secs = secs.max(0.0).round() as u64;
    match secs {
        0..60 => format!("{secs} s"),
        60..3600 => format!("{} min {} s", secs / 60, secs % 60),
        _ => format!("{} h {} min", secs / 3600, secs / 60 % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_read_like_a_clock() {
        assert_eq!([0.4, 59.4, 61.0, 7300.0].map(duration), ["0 s", "59 s", "1 min 1 s", "2 h 1 min"]);
    }

    #[test]
    fn of_many_remarks_the_first_are_listed_and_the_others_counted() {
        let lines = |n: usize| remark_lines(&vec!["shines".to_owned(); n]);
        assert_eq!((lines(1).as_str(), lines(2).as_str()), ("shines", "shines\nshines"));
        assert_eq!(lines(LISTED_REMARKS).lines().count(), LISTED_REMARKS);
        assert_eq!(lines(1000).lines().last(), Some("and 988 more"));
    }
}
