//! Isolux lines over the picture.

use eframe::egui::{self, Align2, Color32, FontId, Rect, Stroke, Ui, pos2, vec2};

use crate::isolux::{Isoline, place_labels};

/// Widths of a line and of the dark rim around it, and size of its letters, points.
const CORE: f32 = 1.2;
const RIM: f32 = 3.2;
const LETTER: f32 = 12.0;
/// Room around the words of a label, points.
const AIR: f32 = 2.0;

/// Draws the lines of a picture of some size in pixels that lies in `image`; their labels stay within `area`.
pub fn isolux_ui(ui: &Ui, lines: &[Isoline], (area, image): (Rect, Rect), [width, height]: [u32; 2]) {
    let painter = ui.painter_at(area);
    let scale = vec2(image.width() / width.max(1) as f32, image.height() / height.max(1) as f32);
    let place = |[x, y]: [f32; 2]| [image.left() + x * scale.x, image.top() + y * scale.y];
    for (width, color) in [(RIM, Color32::from_black_alpha(150)), (CORE, Color32::from_gray(245))] {
        for line in lines {
            let points = line.points.iter().map(|point| pos2(place(*point)[0], place(*point)[1])).collect();
            painter.line(points, Stroke::new(width, color));
        }
    }
    let (font, ink) = (FontId::proportional(LETTER), Color32::from_gray(245));
    let size_of = |words: &str| {
        let size = painter.layout_no_wrap(words.into(), font.clone(), ink).size();
        [size.x + 2.0 * AIR, size.y + 2.0 * AIR]
    };
    let seen = area.intersect(image);
    let bounds = [seen.left(), seen.top(), seen.right(), seen.bottom()];
    let labels = place_labels(lines, place, bounds, size_of);
    for label in &labels {
        let middle = pos2(label.middle[0], label.middle[1]);
        let plate = Rect::from_center_size(middle, vec2(label.size[0], label.size[1]));
        painter.rect_filled(plate, 2.0, Color32::from_black_alpha(210));
        painter.text(middle, Align2::CENTER_CENTER, label.words, font.clone(), ink);
    }
    // One node for screen readers: what the lines say, darkest first.
    let mut told: Vec<&str> = lines.iter().map(|line| line.words.as_str()).collect();
    told.dedup();
    let words = if told.is_empty() { "No isolux line".into() } else { format!("Isolux lines at {}", told.join(", ")) };
    let corner = Rect::from_min_size(seen.min, vec2(1.0, 1.0));
    let response = ui.interact(corner, ui.scope_id().with("isolux"), egui::Sense::hover());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, &words));
}
