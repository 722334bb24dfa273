//! The error of a bake against time, as it falls.

use eframe::egui::{self, Align2, Color32, FontId, Rect, Sense, Shape, Stroke, Ui, pos2, vec2};

use super::status::duration;
use crate::theme;

const HEIGHT: f32 = 84.0;
/// Room for the words beside and below.
const LEFT: f32 = 40.0;
const BELOW: f32 = 16.0;

/// Draws it: seconds since the bake began and decibels below peak, and the decibels that it aims at.
pub fn error_plot_ui(ui: &mut Ui, points: &[[f32; 2]], goal_db: f32) {
    let Some([last_secs, last_db]) = points.last().copied() else { return };
    let size = vec2(ui.available_width(), HEIGHT);
    let (place, response) = ui.allocate_exact_size(size, Sense::hover());
    let words = format!("Error over time, {last_db:.1} dB after {}, {goal_db:.0} dB is asked for", duration(last_secs));
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, &words));
    let response = response
        .on_hover_text("Error in dB below the peaks of the lights, against time; the line is what was asked for");
    let area = Rect::from_min_max(place.min + vec2(LEFT, 4.0), place.max - vec2(4.0, BELOW));
    let [low, high] = range(points, goal_db);
    let end = last_secs.max(1.0);
    let at = |[secs, db]: [f32; 2]| {
        let down = (high - db) / (high - low);
        pos2(area.left() + secs / end * area.width(), area.top() + down * area.height())
    };
    let painter = ui.painter_at(place);
    let (ink, faint) = (ui.visuals().text_color(), ui.visuals().weak_text_color());
    painter.rect_filled(area, 2.0, ui.visuals().extreme_bg_color);
    let goal = [at([0.0, goal_db]), at([end, goal_db])];
    painter.extend(Shape::dashed_line(&goal, Stroke::new(1.0, faint), 4.0, 3.0));
    let line: Vec<_> = points.iter().map(|point| at(*point)).collect();
    if let [only] = line[..] {
        painter.circle_filled(only, 2.0, theme::ACCENT);
    }
    painter.add(Shape::line(line, Stroke::new(1.5, theme::ACCENT)));
    let font = FontId::proportional(11.0);
    let mark = |y: f32, words: String, ink: Color32| {
        painter.text(pos2(area.left() - 5.0, y), Align2::RIGHT_CENTER, words, font.clone(), ink);
    };
    mark(goal[0].y, format!("{goal_db:.0} dB"), faint);
    let last = at([last_secs, last_db]);
    if (last.y - goal[0].y).abs() > 11.0 {
        mark(last.y, format!("{last_db:.1}"), ink);
    }
    painter.text(pos2(area.left(), area.bottom() + 3.0), Align2::LEFT_TOP, "0 s", font.clone(), faint);
    painter.text(pos2(area.right(), area.bottom() + 3.0), Align2::RIGHT_TOP, duration(last_secs), font, faint);
    response.on_hover_cursor(egui::CursorIcon::Default);
}

/// Decibels from the worst to the best, the goal among them, with room on both sides.
fn range(points: &[[f32; 2]], goal_db: f32) -> [f32; 2] {
    let all = || points.iter().map(|point| point[1]).chain([goal_db]);
    [all().fold(f32::INFINITY, f32::min) - 2.0, all().fold(f32::NEG_INFINITY, f32::max) + 2.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_holds_every_point_and_the_goal() {
        assert_eq!(range(&[[1.0, 20.0], [2.0, 31.0]], 40.0), [18.0, 42.0]);
        assert_eq!(range(&[[1.0, 45.0]], 40.0), [38.0, 47.0]);
    }
}
