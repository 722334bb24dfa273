//! What is measured in the picture: under the pointer, at pinned probes, and light by light where somebody clicked.

use clerestory_transport::light::luminance;
use eframe::egui::{
    self, Align2, Area, Color32, FontId, Frame, Id, Key, Order, Pos2, Rect, Response, RichText, ScrollArea, Sense,
    Stroke, Ui, Vec2, pos2, vec2,
};
use glam::Vec3;

use super::keyed;
use crate::illuminance::FOOT_CANDLE_LX;
use crate::legend::number_words;
use crate::look::Look;
use crate::panels::color::swatch_color;
use crate::panels::lamps::Pick;
use crate::panels::lights::LightsState;
use crate::panels::shortcuts::{escapes, hears_keys};
use crate::panels::sight::keep_in_sight;
use crate::session::shares::{Share, sum};
use crate::theme;

/// Where is measured: pixels of the picture, counted from its top left corner.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Probes {
    /// Under the pointer, or where keys ask.
    pub hover: Option<[u32; 2]>,
    /// Where the light is told apart.
    pub picked: Option<[u32; 2]>,
    /// Number of the picture that was clicked on for that, where one is seen beside another.
    picked_in: usize,
    /// Whether the light that shines there most is still to be chosen.
    awaits_light: Option<Pick>,
    /// Where arrow keys went in the picture.
    pub(super) by_keys: Option<[u32; 2]>,
    /// Where it stays.
    pub pins: Vec<[u32; 2]>,
}

impl Probes {
    /// Points nowhere; what is pinned stays.
    pub fn let_go(&mut self) {
        *self = Probes { pins: std::mem::take(&mut self.pins), ..Probes::default() };
    }

    /// Keeps a probe at a pixel.
    pub fn pin(&mut self, px: [u32; 2]) {
        if !self.pins.contains(&px) {
            self.pins.push(px);
        }
    }
}

/// What is measured at a pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Where.
    pub px: [u32; 2],
    /// Mean radiance, nit per channel.
    pub radiance: Vec3,
    /// Illuminance of what is seen there, lux; where it is baked, free lamps included.
    pub lux: Option<f32>,
    /// Unit of its luminance; that of pictures that were taken has no name.
    pub unit: &'static str,
}

/// Everything that is measured.
#[derive(Clone, Debug, Default)]
pub struct Readings {
    /// Under the pointer, or where keys ask.
    pub hover: Option<Reading>,
    /// Light by light, the brightest first.
    pub picked: Option<(Reading, Vec<Share>)>,
    /// At the pins.
    pub pins: Vec<Reading>,
}

/// Lights that are told by name in a breakdown; the others are told as a sum.
const MOST_ROWS: usize = 300;
/// How many of them are seen at once; the rest is scrolled to.
const SEEN_ROWS: f32 = 8.0;
/// Height of the row of a light, points.
const ROW: f32 = 22.0;
/// Part of the light up to which shares that noise made less than nothing are not spoken of.
const MOST_NOISE: f32 = 0.05;
/// Width of the breakdown, points, and what lux take beside luminance.
const WIDTH: f32 = 268.0;
const LUX_WIDTH: f32 = 64.0;
/// Room between a pixel and its breakdown, points.
const BESIDE: f32 = 18.0;

impl Reading {
    /// Luminance and illuminance, with their units; illuminance in foot-candles as well. What noise takes below nothing is none.
    pub fn words(&self) -> String {
        let luminance = in_unit(luminance(self.radiance).max(0.0), self.unit);
        match self.lux.map(|lux| lux.max(0.0)) {
            Some(lux) => {
                let [lx, fc] = lux_words(lux);
                format!("{luminance}, {lx} ({fc})")
            }
            None => luminance,
        }
    }
}

/// Illuminance in lux and in foot-candles.
fn lux_words(lux: f32) -> [String; 2] {
    let foot_candles = (f64::from(lux) / FOOT_CANDLE_LX) as f32;
    [format!("{} lx", number_words(lux)), format!("{} fc", number_words(foot_candles))]
}

/// A number in a unit, if that has a name.
fn in_unit(number: f32, unit: &str) -> String {
    format!("{} {unit}", number_words(number)).trim_end().to_owned()
}

/// Which pixel is where: the picture on the screen, and its size in pixels.
#[derive(Clone, Copy)]
pub struct Grid {
    /// Where it is drawn, points.
    pub image: Rect,
    /// Pixels across and down.
    pub size: [u32; 2],
}

impl Grid {
    /// The pixel at a place on the screen.
    pub fn pixel(&self, at: Pos2) -> Option<[u32; 2]> {
        let place = (at - self.image.min) / self.image.size() * vec2(self.size[0] as f32, self.size[1] as f32);
        let is_inside = place.min_elem() >= 0.0 && place.x < self.size[0] as f32 && place.y < self.size[1] as f32;
        is_inside.then_some([place.x as u32, place.y as u32])
    }

    /// The pixel that lies some pixels to the right and down from another one, or the last one before the edge.
    pub(super) fn beside(&self, from: [u32; 2], way: Vec2) -> [u32; 2] {
        let along = |axis: usize| (from[axis] as f32 + way[axis]).clamp(0.0, self.size[axis].saturating_sub(1) as f32);
        [along(0) as u32, along(1) as u32]
    }

    /// The middle of a pixel on the screen.
    pub(super) fn middle(&self, [x, y]: [u32; 2]) -> Pos2 {
        let place = vec2((x as f32 + 0.5) / self.size[0] as f32, (y as f32 + 0.5) / self.size[1] as f32);
        self.image.min + place * self.image.size()
    }
}

/// A picture on the screen that is measured in.
#[derive(Clone, Copy)]
pub struct Plate<'a> {
    /// Where it is.
    pub picture: &'a Response,
    /// Its pixels.
    pub grid: Grid,
    /// What is seen on the left and on the right of a comparison.
    pub names: Option<&'a [String; 2]>,
    /// From where on the side on the right of a comparison is seen, points across the screen.
    pub right_from: f32,
    /// Its number, 1 beside another.
    pub nth: usize,
    /// Whether keys ask in it: it has the keyboard, and no spot that they move.
    pub is_keyed: bool,
}

impl Plate<'_> {
    /// The pixel under the pointer.
    pub(super) fn hovered(&self) -> Option<[u32; 2]> {
        self.picture.hover_pos().and_then(|at| self.grid.pixel(at))
    }

    /// The pixel in the middle of what is seen, that of the whole where nothing is.
    pub(super) fn middle(&self) -> [u32; 2] {
        self.grid.pixel(self.picture.rect.center()).unwrap_or(self.grid.size.map(|side| side / 2))
    }

    /// Whether something is asked of it: by a click, or by Enter. Space moves the picture.
    fn is_asked(&self, ui: &Ui) -> bool {
        let by_pointer = self.picture.interact_pointer_pos().is_some();
        self.picture.clicked() && (by_pointer || !ui.input(|input| input.key_pressed(Key::Space)))
    }

    /// Which side of a comparison is seen at a pixel, 0 without one.
    fn side(&self, px: [u32; 2]) -> usize {
        usize::from(self.grid.middle(px).x >= self.right_from)
    }

    /// What is seen at a pixel, for people, where that is one of two.
    fn name(&self, px: [u32; 2]) -> Option<&str> {
        self.names.map(|names| names[self.side(px)].as_str())
    }
}

/// Follows the pointer, or arrow keys in a picture that has the keyboard: what is there, a click or Enter that asks what lights it, P that
/// pins a probe.
///
/// `is_free` tells whether a click means the picture and nothing on it.
pub fn follow(ui: &Ui, plates: &[Plate], probes: &mut Probes, is_free: bool) {
    let hover = keyed::place(ui, plates, probes);
    keyed::paint(ui, plates, hover);
    if hover != probes.hover {
        // What is there is read before the next frame.
        probes.hover = hover;
        ui.ctx().request_repaint();
    }
    let keys = |key: Key| hears_keys(ui) && ui.input(|input| input.modifiers.is_none() && input.key_pressed(key));
    if let Some(px) = hover.filter(|_| keys(Key::P)) {
        probes.pin(px);
        ui.ctx().request_repaint();
    }
    if let Some(plate) = plates.iter().find(|plate| plate.is_asked(ui)).filter(|_| is_free) {
        probes.picked = plate.picture.interact_pointer_pos().map_or(hover, |at| plate.grid.pixel(at));
        probes.picked_in = plate.nth;
        probes.awaits_light = Some(Pick::of(ui.input(|input| input.modifiers)));
        ui.ctx().request_repaint();
    }
    if plates.iter().any(|plate| plate.picture.double_clicked()) || escapes(ui) {
        probes.picked = None;
    }
}

/// Draws what was measured, on each side of a comparison under the light that is seen there.
pub fn readings_ui(
    ui: &mut Ui,
    plates: &[Plate],
    sides: &[Readings; 2],
    probes: &mut Probes,
    (look, lights): (&Look, &mut LightsState),
) {
    for plate in plates {
        for idx in 0..sides[0].pins.len() {
            let side = plate.side(sides[0].pins[idx].px);
            if let Some(reading) = sides[side].pins.get(idx) {
                pin_ui(ui, *plate, (idx, reading), probes);
            }
        }
    }
    let measured = plates.iter().find(|plate| plate.hovered().is_some()).or(plates.iter().find(|plate| plate.is_keyed));
    if let Some((plate, px)) = measured.zip(probes.hover)
        && let Some(reading) = &sides[plate.side(px)].hover
    {
        let ([x, y], of) = (reading.px, plate.name(px).map_or_else(String::new, |name| format!("{name}   ")));
        let words = format!("{of}{x}, {y}   {}", reading.words());
        let at = plate.picture.rect.center_bottom() + vec2(0.0, -10.0);
        chip(ui, (at, Align2::CENTER_BOTTOM), Id::unique("under the pointer"), &words);
    }
    let Some((plate, px)) = plates.get(probes.picked_in).or(plates.first()).zip(probes.picked) else { return };
    let picked = &sides[plate.side(px)].picked;
    if let Some((reading, shares)) = picked.as_ref().filter(|(at, _)| at.px == px) {
        // A click on what a light shines on picks it. Free lamps are picked by themselves: their handles would be in the way.
        let strongest = shares.first().filter(|share| share.luminance() > 0.0);
        let of_file = strongest.filter(|share| share.is_of_scene);
        if let Some((share, pick)) = of_file.zip(probes.awaits_light.take()) {
            choose(lights, &share.key, pick);
        }
        probes.awaits_light = None;
        breakdown_ui(ui, *plate, (reading, shares), probes, (look, lights));
    }
}

/// Says above what is measured under the pointer what a map of colors tells there.
pub fn block_ui(ui: &Ui, picture: &Response, words: &str) {
    let at = picture.rect.center_bottom() + vec2(0.0, -38.0);
    chip(ui, (at, Align2::CENTER_BOTTOM), Id::unique("block under the pointer"), words);
}

/// Words on a dark ground, which screen readers find.
fn chip(ui: &Ui, (at, anchor): (Pos2, Align2), id: Id, words: &str) -> Response {
    let galley = ui.painter().layout_no_wrap(words.to_owned(), FontId::proportional(12.5), Color32::from_gray(232));
    let place = anchor.anchor_size(at, galley.size() + vec2(14.0, 8.0));
    let response = ui.interact(place, id, Sense::hover());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Label, true, words));
    ui.painter().rect_filled(place, 4.0, Color32::from_black_alpha(185));
    ui.painter().galley(place.min + vec2(7.0, 4.0), galley, Color32::WHITE);
    response
}

/// A probe that stays, with what it reads; a click takes it away.
fn pin_ui(ui: &Ui, plate: Plate, (idx, reading): (usize, &Reading), probes: &mut Probes) {
    let at = plate.grid.middle(reading.px);
    if !plate.picture.rect.contains(at) {
        return;
    }
    let id = ("probe", plate.nth, idx);
    let handle = ui.interact(Rect::from_center_size(at, Vec2::splat(16.0)), Id::unique(id), Sense::click());
    let of = plate.name(reading.px).map_or_else(String::new, |name| format!("{name}, "));
    let words = format!("Probe {}, {of}{}", idx + 1, reading.words());
    handle.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &words));
    let color = if handle.hovered() { theme::ACCENT } else { Color32::WHITE };
    for (width, color) in [(3.5, Color32::from_black_alpha(150)), (1.3, color)] {
        for arm in [vec2(1.0, 0.0), vec2(0.0, 1.0)] {
            for side in [-1.0, 1.0] {
                ui.painter().line_segment([at + arm * side * 3.0, at + arm * side * 8.0], Stroke::new(width, color));
            }
        }
    }
    theme::keyboard_frame(ui, &handle);
    let id = Id::unique(("probe words", plate.nth, idx));
    chip(ui, (at + vec2(11.0, -4.0), Align2::LEFT_BOTTOM), id, &reading.words());
    if handle.on_hover_text("Click to take the probe away").clicked() {
        probes.pins.retain(|px| *px != reading.px);
    }
}

/// Who lights a pixel, and by how much.
fn breakdown_ui(
    ui: &mut Ui,
    plate: Plate,
    (reading, shares): (&Reading, &[Share]),
    probes: &mut Probes,
    (look, lights): (&Look, &mut LightsState),
) {
    let (picture, at) = (plate.picture, plate.grid.middle(reading.px));
    let painter = ui.painter_at(picture.rect);
    for (width, color) in [(3.5, Color32::from_black_alpha(150)), (1.5, theme::ACCENT)] {
        painter.circle_stroke(at, 6.0, Stroke::new(width, color));
    }
    let width = if shares.iter().any(|share| share.lux.is_some()) { WIDTH + LUX_WIDTH } else { WIDTH };
    // To the left where there is no room to the right.
    let is_left = at.x + BESIDE + width + 30.0 > picture.rect.right();
    let (pivot, x) = if is_left { (Align2::RIGHT_TOP, -BESIDE) } else { (Align2::LEFT_TOP, BESIDE) };
    let area = Area::new(Id::unique("light here")).order(Order::Middle).constrain_to(picture.rect).pivot(pivot);
    let area = area.fixed_pos(pos2(at.x + x, at.y - 24.0));
    area.show(ui.ctx(), |ui| {
        Frame::window(ui.style()).inner_margin(10.0).show(ui, |ui| {
            ui.set_width(width);
            heading_ui(ui, (reading, plate.name(reading.px)), probes);
            let total = sum(shares);
            let lux: f32 = shares.iter().filter_map(|share| share.lux).sum();
            // Light that arrives where nothing sends it on is light, too.
            let is_lit = |share: &&Share| {
                share.luminance() > 1e-4 * luminance(total).max(1e-9)
                    || share.lux.is_some_and(|of_share| of_share > 1e-4 * lux.max(1e-9))
            };
            let lit: Vec<&Share> = shares.iter().filter(is_lit).collect();
            let seen = SEEN_ROWS * (ROW + ui.spacing().item_spacing.y);
            let rows = ScrollArea::vertical().id_salt("lights here").max_height(seen).min_scrolled_height(seen);
            rows.auto_shrink([false, true]).show(ui, |ui| {
                for share in lit.iter().take(MOST_ROWS) {
                    let is_here = share.is_of_scene || look.lights.lamps.iter().any(|lamp| lamp.key == share.key);
                    let of = (look.name_of(&share.key), is_here, reading.unit);
                    share_ui(ui, share, luminance(total), of, lights);
                }
                keep_in_sight(ui, "lights here");
            });
            if lit.is_empty() {
                ui.label(RichText::new("No light reaches this").weak());
            }
            if lit.len() > MOST_ROWS {
                let rest: f32 = lit[MOST_ROWS..].iter().map(|share| share.luminance()).sum();
                let words = format!("{} more, {}", lit.len() - MOST_ROWS, percent(rest, luminance(total)));
                ui.label(RichText::new(words).weak());
            }
            if let Some(words) = noise_words(shares) {
                ui.label(RichText::new(words).weak());
            }
        });
    });
}

/// What lights take away that a noisy bake made less than nothing, where it is enough to mislead: their sum is right, their
/// shares are not.
fn noise_words(shares: &[Share]) -> Option<String> {
    let (total, below) = (luminance(sum(shares)), shares.iter().map(|share| share.luminance().min(0.0)).sum::<f32>());
    (below < -MOST_NOISE * total.max(1e-9)).then(|| {
        format!(
            "{} by noise: this bake is too coarse to tell lights apart here. More samples help.",
            percent(below, total)
        )
    })
}

fn heading_ui(ui: &mut Ui, (reading, of): (&Reading, Option<&str>), probes: &mut Probes) {
    if let Some(name) = of {
        ui.label(RichText::new(name).strong()).on_hover_text("The side of the comparison that is seen here");
    }
    ui.horizontal(|ui| {
        ui.label(RichText::new("Light here").strong());
        ui.label(RichText::new(reading.words()).weak());
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let close = ui.small_button("×").on_hover_text("Esc");
            if close.accessible_name("Close Light here").clicked() {
                probes.picked = None;
            }
            if ui.small_button("Pin").on_hover_text("Keep a probe here, P at the pointer").clicked() {
                probes.pin(reading.px);
            }
        });
    });
    ui.separator();
}

/// A row: color, name, share, luminance and lux over a bar as long as the share. A click chooses the light, unless only the other look of a
/// comparison has it.
fn share_ui(
    ui: &mut Ui,
    share: &Share,
    total: f32,
    (name, is_here, unit): (&str, bool, &str),
    lights: &mut LightsState,
) {
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), ROW), Sense::click());
    let luminance = share.luminance();
    let lux = share.lux.map(|lux| lux_words(lux.max(0.0)));
    let value = [Some(in_unit(luminance, unit)), lux.as_ref().map(|[lx, _]| lx.clone())];
    let value = Vec::from_iter(value.into_iter().flatten()).join(", ");
    let words = format!("{name} {} {value}", percent(luminance, total));
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &words));
    let visuals = ui.style().interact(&response);
    let ink = visuals.fg_stroke.color;
    let painter = ui.painter_at(rect);
    let is_chosen = lights.chosen.as_deref() == Some(&share.key);
    if response.hovered() || is_chosen {
        painter.rect_filled(rect, 3.0, visuals.weak_bg_fill);
    }
    theme::keyboard_frame(ui, &response);
    let bar = Rect::from_min_size(rect.min, vec2(rect.width() * (luminance / total).clamp(0.0, 1.0), rect.height()));
    painter.rect_filled(bar, 3.0, theme::ACCENT.gamma_multiply(0.22));
    let swatch = Rect::from_center_size(rect.left_center() + vec2(10.0, 0.0), Vec2::splat(11.0));
    painter.rect_filled(swatch, 2.0, swatch_color(share.radiance));
    let font = FontId::proportional(12.5);
    let place = painter.text(rect.right_center() + vec2(-6.0, 0.0), Align2::RIGHT_CENTER, value, font.clone(), ink);
    let left = place.left().min(rect.right() - 92.0);
    let share_words = percent(luminance, total);
    painter.text(pos2(left - 8.0, rect.center().y), Align2::RIGHT_CENTER, share_words, font.clone(), ink);
    let room = rect.with_max_x(left - 52.0);
    ui.painter_at(room).text(rect.left_center() + vec2(22.0, 0.0), Align2::LEFT_CENTER, name, font, ink);
    let tip = if is_here { "Click to choose it in the list" } else { "A lamp of that look, not among the lights now" };
    let lux = lux.map_or_else(String::new, |[lx, fc]| format!("\n{lx} ({fc})"));
    if response.on_hover_text(format!("{name}{lux}\n{tip}")).clicked() && is_here {
        choose(lights, &share.key, Pick::of(ui.input(|input| input.modifiers)));
    }
}

/// Makes a light the chosen one, a free lamp with its handles.
pub fn choose(lights: &mut LightsState, key: &str, pick: Pick) {
    lights.lamps.picked = Some((key.to_owned(), pick));
    lights.chosen = Some(key.to_owned());
    lights.lamps.chosen = Some(key.to_owned());
}

/// A part of a whole for people: no more digits than tell something.
fn percent(part: f32, total: f32) -> String {
    match 100.0 * part / total.max(1e-9) {
        _ if total < 0.0 => "– %".into(),
        share if share.abs() < 0.95 => format!("{share:.1} %"),
        share => format!("{share:.0} %"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_is_found_again_where_it_is_drawn() {
        let grid = Grid { image: Rect::from_min_size(pos2(20.0, -40.0), vec2(300.0, 150.0)), size: [64, 32] };
        for px in [[0, 0], [63, 31], [17, 4]] {
            assert_eq!(grid.pixel(grid.middle(px)), Some(px));
        }
        assert_eq!(grid.beside([17, 4], vec2(1.0, -10.0)), [18, 0], "the edge holds it");
        assert_eq!(grid.pixel(pos2(19.9, 0.0)), None);
        assert_eq!(grid.pixel(pos2(320.1, 0.0)), None);
    }

    #[test]
    fn shares_have_no_more_digits_than_tell_something() {
        let words = [(1.0, 1.0), (0.25, 1.0), (0.004, 1.0), (0.0, 0.0)].map(|(part, total)| percent(part, total));
        assert_eq!(words, ["100 %", "25 %", "0.4 %", "0.0 %"]);
        assert_eq!(percent(0.1, -0.001), "– %", "noise has left less than nothing");
        let dark = Reading { px: [0, 0], radiance: Vec3::splat(-0.1), lux: Some(-0.1), unit: "cd/m²" };
        assert_eq!(dark.words(), "0 cd/m², 0 lx (0 fc)");
        let taken = Reading { radiance: Vec3::splat(0.5), lux: None, unit: "", ..dark };
        assert_eq!(taken.words(), "0.5");
    }

    #[test]
    fn shares_that_noise_spoiled_are_told() {
        let share = |light| Share { key: "lamp".into(), radiance: Vec3::splat(light), lux: None, is_of_scene: true };
        let shares = |lights: [f32; 3]| lights.map(share);
        assert_eq!(noise_words(&shares([2.0, 1.0, -0.1])), None);
        assert_eq!(noise_words(&shares([0.0, 0.0, 0.0])), None);
        let words = noise_words(&shares([9.0, 1.5, -7.5])).expect("more than the half is noise");
        assert!(words.starts_with("-250 % by noise"), "{words}");
    }
}
