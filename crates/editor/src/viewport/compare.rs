//! Two looks of one picture: side by side, or with a divider that is dragged over it.

use eframe::egui::accesskit::Role;
use eframe::egui::{
    self, Align2, Color32, CornerRadius, CursorIcon, FontId, Id, Pos2, Rect, Sense, Shape, Stroke, TextureId, Ui, pos2,
    vec2,
};

use super::lamps::tell;
use crate::panels::arrows::{FINE, arrows};
use crate::panels::heat::Overlay;
use crate::theme;

/// How two pictures are shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Way {
    /// One left of a divider, the other right of it.
    #[default]
    Wipe,
    /// One beside the other, both whole.
    SideBySide,
}

/// What a picture is compared with.
pub struct Compared {
    /// The picture on the right, of the same size.
    pub right: TextureId,
    /// What is seen on the left and on the right.
    pub names: [String; 2],
    /// How.
    pub way: Way,
}

/// Width in points in which the divider is taken.
const REACH: f32 = 16.0;
/// Room between two pictures, points.
const GAP: f32 = 4.0;
/// What the name of a side takes from below, points.
pub const NAME_HEIGHT: f32 = 36.0;
/// By how much a key moves the divider, of the picture.
const KEY_STEP: f32 = 0.02;
const WHOLE: Rect = Rect { min: Pos2::ZERO, max: pos2(1.0, 1.0) };

/// Where the picture has its place in an area, and that beside it where there is one.
pub fn areas(area: Rect, compared: Option<&Compared>) -> Vec<Rect> {
    if compared.is_none_or(|compared| compared.way == Way::Wipe) {
        return vec![area];
    }
    let edge = 0.5 * GAP;
    let (left, right) = (area.with_max_x(area.center().x - edge), area.with_min_x(area.center().x + edge));
    vec![left, right]
}

/// Draws the picture on the right beside the left one, under the map of colors that the left one has.
pub fn beside(ui: &Ui, (compared, overlay): (&Compared, Option<Overlay>), area: Rect, image: Rect) {
    let painter = ui.painter_at(area);
    painter.image(compared.right, image, WHOLE, Color32::WHITE);
    if let Some(overlay) = overlay {
        overlay.paint(&painter, image);
    }
}

/// Draws what is right of the divider over the left picture, under the map of colors that this has. `offset` is the way of the divider
/// from the middle, in widths of the picture. Answers where it stands, points across; at no place where nothing is seen.
pub fn behind(ui: &Ui, (compared, overlay): (&Compared, Option<Overlay>), area: Rect, image: Rect, offset: f32) -> f32 {
    let seen = image.intersect(area);
    if !seen.is_positive() {
        return f32::INFINITY;
    }
    let x = divider_x(seen, image, offset);
    let share = (x - image.left()) / image.width();
    let right = Rect::from_min_max(pos2(x, image.top()), image.max);
    let painter = ui.painter_at(area);
    painter.image(compared.right, right, Rect::from_min_max(pos2(share, 0.0), pos2(1.0, 1.0)), Color32::WHITE);
    if let Some(overlay) = overlay {
        overlay.paint(&ui.painter_at(right.intersect(area)), image);
    }
    x
}

fn divider_x(seen: Rect, image: Rect, offset: f32) -> f32 {
    (image.center().x + offset * image.width()).clamp(seen.left(), seen.right())
}

/// Draws a name on each side, and the divider where there is one, which can be dragged.
pub fn sides_ui(ui: &Ui, compared: &Compared, (areas, images): (&[Rect], &[Rect]), offset: &mut f32) {
    let [left, right] = compared.names.each_ref().map(String::as_str);
    if let ([area], [image]) = (areas, images) {
        let seen = image.intersect(*area);
        if seen.is_positive() {
            divider_ui(ui, (*area, seen), *image, offset);
            name(ui, seen, ("left", left), Align2::LEFT_BOTTOM);
            name(ui, seen, ("right", right), Align2::RIGHT_BOTTOM);
        }
        return;
    }
    for ((area, image), of) in areas.iter().zip(images).zip([("left", left), ("right", right)]) {
        name(ui, area.intersect(*image), of, Align2::LEFT_BOTTOM);
    }
}

fn divider_ui(ui: &Ui, (area, seen): (Rect, Rect), image: Rect, offset: &mut f32) {
    let before = *offset;
    let x = divider_x(seen, image, before);
    let handle = Rect::from_center_size(pos2(x, seen.center().y), vec2(REACH, seen.height()));
    let response =
        ui.interact(handle, ui.scope_id().with("divider"), Sense::drag() | Sense::focusable_noninteractive());
    let percent = f64::from(100.0 * (0.5 + before)).round();
    response.widget_info(|| egui::WidgetInfo::slider(true, percent, "Compare divider"));
    if let Some(pointer) = response.interact_pointer_pos() {
        *offset = ((pointer.x - image.center().x) / image.width()).clamp(-0.5, 0.5);
    }
    *offset = (*offset + arrows(ui, &response, FINE).x * KEY_STEP).clamp(-0.5, 0.5);
    if *offset != before {
        // What lies on both of its sides was drawn already.
        ui.ctx().request_repaint();
    }
    if response.hovered() || response.dragged() {
        ui.ctx().set_cursor_icon(CursorIcon::ResizeHorizontal);
    }
    let is_held = response.hovered() || response.dragged() || response.has_focus();
    let color = if is_held { theme::ACCENT } else { Color32::WHITE };
    let painter = ui.painter_at(area);
    painter.vline(x, seen.y_range(), Stroke::new(3.5, Color32::from_black_alpha(110)));
    painter.vline(x, seen.y_range(), Stroke::new(1.5, color));
    painter.circle(pos2(x, seen.center().y), 9.0, Color32::from_black_alpha(150), Stroke::new(1.5, color));
    for side in [-1.0, 1.0] {
        let tip = pos2(x + 6.0 * side, seen.center().y);
        let back = vec2(-4.0 * side, 0.0);
        let corners = vec![tip, tip + back + vec2(0.0, 3.5), tip + back - vec2(0.0, 3.5)];
        painter.add(Shape::convex_polygon(corners, color, Stroke::NONE));
    }
}

/// The name of the picture on a side, in its lower corner.
fn name(ui: &Ui, of: Rect, (side, words): (&str, &str), corner: Align2) {
    let painter = ui.painter_at(of);
    let inner = of.shrink(8.0);
    let galley = painter.layout_no_wrap(words.to_owned(), FontId::proportional(12.5), Color32::from_gray(235));
    let place = corner.anchor_size(corner.pos_in_rect(&inner), galley.size() + vec2(12.0, 6.0));
    painter.rect_filled(place, CornerRadius::same(3), Color32::from_black_alpha(150));
    painter.galley(place.min + vec2(6.0, 3.0), galley, Color32::from_gray(235));
    let id = Id::unique(("side of a comparison", side));
    tell(ui.ctx(), id, (Role::Mark, &format!("On the {side}: {words}")), place);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_pictures_share_the_area_evenly() {
        let area = Rect::from_min_max(pos2(10.0, 5.0), pos2(410.0, 300.0));
        let compared = |way| Compared { right: TextureId::default(), names: [String::new(), String::new()], way };
        let [left, right] = areas(area, Some(&compared(Way::SideBySide)))[..] else { panic!("two") };
        assert!((left.width() - right.width()).abs() < 1e-3 && right.right() == area.right(), "{left} {right}");
        assert!((right.left() - left.right() - GAP).abs() < 1e-3, "{left} {right}");
        assert_eq!(areas(area, Some(&compared(Way::Wipe))), [area]);
        assert_eq!(areas(area, None), [area]);
    }
}
