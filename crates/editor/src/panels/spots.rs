//! The spots of a panel: a small picture of it on which they are dragged, and what the chosen one is like.

use std::collections::BTreeMap;

use clerestory_transport::basis::LightSource;
use clerestory_transport::light::PanelSpot;
use eframe::egui::{self, Color32, Rect, Response, RichText, Sense, Slider, Stroke, StrokeKind, Ui, Vec2, vec2};
use glam::Vec3;

use super::arrows::{FINE, arrows};
use super::color::{KelvinChoice, Tint, tint_ui};
use super::number::{Spelling, slider_ui};
use crate::theme;

/// A spot as it is added.
pub const NEW_SPOT: PanelSpot = PanelSpot { position: [0.5, 0.5], radius: 0.2, color: None, intensity: 1.0 };
/// Longer side of the pad in points.
const PAD_SIDE: f32 = 120.0;
/// How far an arrow key moves a spot, in texels.
const KEY_STEP_TEXELS: f32 = 0.25;
/// Distance in points at which a handle is still touched.
pub const HANDLE_REACH: f32 = 14.0;

/// Draws the section of one panel, which is called `name` and has a shape: texels along a side, and sides in meters. `marked` are the spots
/// that it has in its file, none where all of it shines there. `chosen` is the panel and spot that were touched last.
pub fn spots_ui(
    ui: &mut Ui,
    (source, name): (&LightSource, &str),
    shape: (u32, [f32; 2]),
    (panels, marked): (&mut BTreeMap<String, Vec<PanelSpot>>, Option<&[PanelSpot]>),
    chosen: &mut Option<(String, usize)>,
) {
    let key = &source.key;
    ui.horizontal(|ui| {
        ui.add_space(50.0);
        let is_untouched = !panels.contains_key(key);
        let (words, hint) = match marked {
            None => ("Uniform", "The whole panel shines"),
            Some(_) => ("As in the file", "The spots that the file marks shine"),
        };
        if ui.selectable_label(is_untouched, words).on_hover_text(hint).clicked() {
            panels.remove(key);
        }
        if ui.selectable_label(!is_untouched, "Spots").on_hover_text("Only spots of it shine").clicked() && is_untouched
        {
            panels.insert(key.clone(), marked.map_or_else(|| vec![NEW_SPOT], taken_over));
            *chosen = Some((key.clone(), 0));
        }
    });
    let Some(spots) = panels.get_mut(key) else { return };
    let mut idx = chosen.as_ref().filter(|(panel, _)| panel == key).map_or(0, |(_, idx)| *idx);
    idx = idx.min(spots.len().saturating_sub(1));
    let before = idx;
    // The press that chooses another spot takes what was typed for this one.
    let (mut is_touched, mut next) = (false, idx);
    ui.horizontal_top(|ui| {
        ui.add_space(50.0);
        is_touched = pad_ui(ui, name, shape, source.color, spots, &mut next).has_focus();
        ui.vertical(|ui| spot_ui(ui, name, source.color, spots, &mut idx));
    });
    if next != before {
        idx = next;
    }
    if is_touched || idx != before {
        *chosen = Some((key.clone(), idx));
    }
}

/// Spots of a file as a look holds them.
pub fn taken_over(marked: &[PanelSpot]) -> Vec<PanelSpot> {
    marked.iter().map(|spot| spot.within_limits()).collect()
}

/// How far an arrow key moves a spot, in sides of a panel of so many texels.
pub fn key_step(resolution: u32) -> f32 {
    KEY_STEP_TEXELS / resolution as f32
}

/// The panel from above, u to the right and v down.
fn pad_ui(
    ui: &mut Ui,
    name: &str,
    (resolution, size_m): (u32, [f32; 2]),
    color: Vec3,
    spots: &mut [PanelSpot],
    idx: &mut usize,
) -> Response {
    let longer = size_m[0].max(size_m[1]).max(1e-6);
    let size = (vec2(size_m[0], size_m[1]) / longer * PAD_SIDE).max(vec2(24.0, 24.0));
    let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Slider, ui.is_enabled(), format!("Spots on {name}")));
    let pointer = response.interact_pointer_pos().map(|p| (p - rect.min) / rect.size());
    if let Some(at) = pointer {
        if response.drag_started() || response.clicked() {
            response.request_focus();
            let to_points = |spot: &PanelSpot| rect.min + vec2(spot.position[0], spot.position[1]) * rect.size();
            let press = ui.input(|input| input.pointer.press_origin()).unwrap_or(rect.min + at * rect.size());
            *idx = nearest(spots.iter().map(|spot| to_points(spot).distance(press))).unwrap_or(0);
        }
        if let Some(spot) = spots.get_mut(*idx).filter(|_| response.dragged() || response.clicked()) {
            spot.position = [at.x.clamp(0.0, 1.0), at.y.clamp(0.0, 1.0)];
        }
    }
    let step = arrows(ui, &response, FINE) * key_step(resolution);
    if let Some(spot) = spots.get_mut(*idx).filter(|_| step != Vec2::ZERO) {
        let [u, v] = spot.position;
        spot.position = [(u + step.x).clamp(0.0, 1.0), (v + step.y).clamp(0.0, 1.0)];
    }
    paint_pad(ui, rect, color, spots, *idx);
    if response.has_focus() {
        ui.painter().rect_stroke(rect, 3.0, ui.visuals().selection.stroke, StrokeKind::Outside);
    }
    response
}

fn paint_pad(ui: &Ui, rect: Rect, color: Vec3, spots: &[PanelSpot], chosen: usize) {
    let painter = ui.painter().with_clip_rect(rect.intersect(ui.clip_rect()));
    painter.rect_filled(rect, 3.0, Color32::from_gray(14));
    let short_side = rect.width().min(rect.height());
    for (idx, spot) in spots.iter().enumerate() {
        let center = rect.min + vec2(spot.position[0], spot.position[1]) * rect.size();
        let glow = spot.color.map_or(color, Vec3::from);
        let [r, g, b] = (glow / glow.max_element().max(1e-6)).to_array();
        let strength = (0.25 + 0.75 * (spot.intensity / 2.0).min(1.0)).clamp(0.0, 1.0);
        let fill: Color32 = egui::Rgba::from_rgba_unmultiplied(r, g, b, strength).into();
        painter.circle_filled(center, (spot.radius * short_side).max(2.0), fill);
        let stroke =
            if idx == chosen { Stroke::new(2.0, theme::ACCENT) } else { Stroke::new(1.0, Color32::from_gray(150)) };
        painter.circle_stroke(center, (spot.radius * short_side).max(4.0), stroke);
    }
    ui.painter().rect_stroke(rect, 3.0, ui.visuals().widgets.hovered.bg_stroke, StrokeKind::Outside);
}

fn spot_ui(ui: &mut Ui, name: &str, file_color: Vec3, spots: &mut Vec<PanelSpot>, idx: &mut usize) {
    ui.spacing_mut().item_spacing.y = 3.0;
    let n_spots = spots.len();
    ui.horizontal(|ui| {
        let title = if n_spots == 0 { "Dark".into() } else { format!("Spot {} of {n_spots}", *idx + 1) };
        ui.label(RichText::new(title).small().weak());
    });
    let mut is_deleted = false;
    if let Some(spot) = spots.get_mut(*idx) {
        let width = (ui.available_width() - 62.0).max(40.0);
        ui.spacing_mut().slider_width = width;
        ui.push_id(*idx, |ui| amounts_ui(ui, name, spot));
        ui.horizontal(|ui| {
            let mut tint = Tint { color: spot.color, kelvin: None };
            if tint_ui(ui, &format!("{name} spot"), &mut tint, file_color, KelvinChoice::Hidden) {
                spot.color = tint.color;
            }
            is_deleted = ui.small_button("Delete").accessible_name(format!("Delete spot of {name}")).clicked();
        });
    }
    if is_deleted {
        spots.remove(*idx);
        *idx = idx.saturating_sub(1);
    }
    if ui.small_button("Add spot").accessible_name(format!("Add spot to {name}")).clicked() {
        spots.push(beside(spots));
        *idx = spots.len() - 1;
    }
}

/// How large and how bright a spot is.
fn amounts_ui(ui: &mut Ui, name: &str, spot: &mut PanelSpot) {
    ui.label(RichText::new("Radius").small().weak());
    let mut across = spot.radius;
    let radius = Slider::new(&mut across, 0.02..=1.0).clamping(egui::SliderClamping::Never).fixed_decimals(2);
    let radius = slider_ui(ui, radius, Spelling::default()).on_hover_text("Radius, in shorter sides of the panel");
    if radius.accessible_name(format!("{name} spot radius")).changed() {
        spot.radius = across.clamp(0.0, PanelSpot::MOST_RADIUS);
    }
    ui.label(RichText::new("Intensity").small().weak());
    let mut level = spot.intensity;
    let intensity = Slider::new(&mut level, 0.0..=20.0).logarithmic(true).smallest_positive(0.02).fixed_decimals(2);
    let intensity = intensity.clamping(egui::SliderClamping::Never);
    let intensity =
        slider_ui(ui, intensity, Spelling::default()).on_hover_text("Times the luminance of the panel in its file");
    if intensity.accessible_name(format!("{name} spot intensity")).changed() {
        spot.intensity = level.clamp(0.0, PanelSpot::MOST_INTENSITY);
    }
}

/// A spot where it does not hide the last one.
fn beside(spots: &[PanelSpot]) -> PanelSpot {
    let Some(last) = spots.last() else { return NEW_SPOT };
    let step = |v: f32| if v > 0.6 { v - 0.3 } else { v + 0.3 };
    PanelSpot { position: [step(last.position[0]), last.position[1]], ..*last }
}

/// Index of the smallest distance.
pub fn nearest(distances: impl Iterator<Item = f32>) -> Option<usize> {
    distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).map(|(idx, _)| idx)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::Look;

    #[test]
    fn spots_of_an_older_bake_make_a_look_that_can_be_opened() {
        let odd = PanelSpot { position: [0.5, -101.0], radius: 2000.0, color: Some([1.0, 2e6, 0.0]), intensity: 2e9 };
        let taken = taken_over(&[NEW_SPOT, odd]);
        assert_eq!(taken[0], NEW_SPOT);
        let mut look = Look::default();
        look.lights.panels.insert("panel".into(), taken);
        Look::from_json(&look.to_json()).unwrap();
    }
}
