//! Which part of the picture is shown, and how large: fit, zoom at the pointer, a region, one to one.

use eframe::egui::{CursorIcon, Key, PointerButton, Pos2, Rect, Response, Stroke, StrokeKind, Ui, Vec2};

use super::handles::Grab;
use super::orbit::Navigation;
use crate::panels::shortcuts::escapes;
use crate::theme;

/// Part and size of the picture.
#[derive(Clone, Debug, Default)]
pub struct Zoom {
    /// Points per pixel; none shows the whole picture.
    scale: Option<f32>,
    /// Center of the picture from the center of the area, points.
    offset: Vec2,
    /// Size in pixels of the picture that the scale is for.
    size: Vec2,
    /// Whether the next drag is the rectangle that is zoomed to.
    awaits_region: bool,
}

/// Room around a picture that fits, points.
const MARGIN: f32 = 14.0;
/// Range of the scale.
const SCALE: std::ops::RangeInclusive<f32> = 0.05..=48.0;
/// Zoom per point of scrolling.
const ZOOM_PER_POINT: f32 = 0.005;
/// Smallest side of a region that is zoomed to, points: less is a click.
const LEAST_REGION: f32 = 6.0;

impl Zoom {
    /// Shows the whole picture.
    pub fn fit(&mut self) {
        (self.scale, self.offset) = (None, Vec2::ZERO);
    }

    /// Shows a pixel of the picture on each pixel of a screen with so many of them per point; what is in the middle stays.
    pub fn one_to_one(&mut self, pixels_per_point: f32) {
        let scale = 1.0 / pixels_per_point;
        self.offset *= scale / self.scale.unwrap_or(scale);
        self.scale = Some(scale);
    }

    /// Takes the next drag in the picture for the rectangle that is zoomed to.
    pub fn await_region(&mut self) {
        self.awaits_region = true;
    }

    /// Whether the next drag is that rectangle, as it is with Z, too.
    pub(super) fn awaits_drag(&self, ui: &Ui) -> bool {
        self.awaits_region || is_held(ui, Key::Z)
    }

    /// Another picture of the view has another number of pixels: it lies where the one before lay, unless that was one to one.
    pub(super) fn heed_size(&mut self, size: Vec2, pixels_per_point: f32) {
        let before = std::mem::replace(&mut self.size, size);
        let is_another = before.x > 0.0 && before.x != size.x;
        if let Some(scale) = self.scale.as_mut().filter(|scale| is_another && **scale != 1.0 / pixels_per_point) {
            *scale *= before.x / size.x;
        }
    }

    /// Where a picture of some size in pixels is drawn.
    pub fn image_rect(&self, area: Rect, size: Vec2) -> Rect {
        let scale = self.scale.unwrap_or_else(|| fitting(area, size));
        Rect::from_center_size(area.center() + self.offset, size * scale)
    }

    /// Zooms so that what is under the pointer stays there.
    fn zoom_at(&mut self, area: Rect, size: Vec2, pointer: Pos2, factor: f32) {
        let old = self.scale.unwrap_or_else(|| fitting(area, size));
        let new = (old * factor).clamp(*SCALE.start(), *SCALE.end());
        let from_center = pointer - area.center();
        self.offset = from_center + (self.offset - from_center) * (new / old);
        self.scale = Some(new);
    }

    /// Fills the area with what lies in a rectangle of it.
    fn show_region(&mut self, area: Rect, size: Vec2, region: Rect) {
        if region.width().min(region.height()) < LEAST_REGION {
            return;
        }
        let factor = (area.width() / region.width()).min(area.height() / region.height());
        let old = self.scale.unwrap_or_else(|| fitting(area, size));
        let new = (old * factor).clamp(*SCALE.start(), *SCALE.end());
        self.offset = (self.offset - (region.center() - area.center())) * (new / old);
        self.scale = Some(new);
    }

    fn pan(&mut self, area: Rect, size: Vec2, by: Vec2) {
        self.scale = Some(self.scale.unwrap_or_else(|| fitting(area, size)));
        self.offset += by;
    }
}

/// Whether a key is down that is no letter of a text.
fn is_held(ui: &Ui, key: Key) -> bool {
    !ui.text_edit_focused() && ui.input(|input| input.key_down(key) && input.modifiers.is_none())
}

fn fitting(area: Rect, size: Vec2) -> f32 {
    let room = (area.size() - Vec2::splat(2.0 * MARGIN)).max(Vec2::splat(1.0));
    (room.x / size.x).min(room.y / size.y)
}

/// The part of a picture that is in sight in an area, as shares of its width and height; none where that is all or nothing of it.
pub(super) fn part_seen(area: Rect, image: Rect) -> Option<[[f32; 2]; 2]> {
    let seen = area.intersect(image);
    let share = |at: Pos2| ((at - image.min) / image.size()).into();
    (seen.is_positive() && seen != image).then(|| [share(seen.min), share(seen.max)])
}

/// Zoom with the wheel, or to a rectangle that is dragged with Z or after it was asked for; pan with the middle button or space, and by two fingers where
/// these are the habit.
pub(super) fn navigate(
    ui: &Ui,
    response: &Response,
    (zoom, grab): (&mut Zoom, &mut Option<Grab>),
    size: Vec2,
    navigation: Navigation,
) {
    let area = response.rect;
    // Handles of lamps lie over the picture and take the pointer, but not its wheel.
    let pointer = ui.ctx().pointer_hover_pos().filter(|_| ui.rect_contains_pointer(area));
    if let Some(pointer) = pointer {
        let (scroll, pinch) = ui.input(|input| (input.smooth_scroll_delta(), input.zoom_delta()));
        let are_fingers = navigation == Navigation::Trackpad;
        // All of the picture has nowhere to go.
        if are_fingers && zoom.scale.is_some() && scroll != Vec2::ZERO {
            zoom.pan(area, size, scroll);
        }
        let factor = if are_fingers { pinch } else { (scroll.y * ZOOM_PER_POINT).exp() * pinch };
        if factor != 1.0 {
            zoom.zoom_at(area, size, pointer, factor);
        }
    }
    zoom.awaits_region &= !escapes(ui);
    // The toolkit ends the drag by the same key.
    if ui.input(|input| input.key_pressed(Key::Escape)) {
        grab.take_if(|grab| matches!(grab, Grab::Region(_)));
    }
    let is_region = zoom.awaits_drag(ui);
    if response.drag_started_by(PointerButton::Middle) || (response.drag_started() && is_held(ui, Key::Space)) {
        *grab = Some(Grab::Picture);
    } else if response.drag_started_by(PointerButton::Primary) && is_region {
        let press = ui.input(|input| input.pointer.press_origin());
        *grab = press.map(Grab::Region);
    }
    if is_region && response.hovered() {
        ui.ctx().set_cursor_icon(CursorIcon::ZoomIn);
    }
    if *grab == Some(Grab::Picture) && response.dragged() {
        zoom.pan(area, size, response.drag_delta());
        ui.ctx().set_cursor_icon(CursorIcon::Grabbing);
    }
    if response.drag_stopped() {
        if let (Some(Grab::Region(from)), Some(to)) = (&*grab, response.interact_pointer_pos()) {
            zoom.show_region(area, size, Rect::from_two_pos(*from, to).intersect(area));
            zoom.awaits_region = false;
        }
        *grab = None;
    }
}

/// Draws the rectangle that is being dragged.
pub(super) fn paint_region(ui: &Ui, response: &Response, grab: Option<&Grab>) {
    if let (Some(Grab::Region(from)), Some(to)) = (grab, response.interact_pointer_pos()) {
        let region = Rect::from_two_pos(*from, to).intersect(response.rect);
        let stroke = Stroke::new(1.5, theme::ACCENT);
        ui.painter().rect(region, 0.0, theme::ACCENT.gamma_multiply(0.08), stroke, StrokeKind::Inside);
    }
}

#[cfg(test)]
mod tests {
    use eframe::egui::{Sense, pos2, vec2};
    use egui_kittest::Harness;

    use super::*;
    use crate::support::pull;

    const AREA: Rect = Rect { min: pos2(10.0, 20.0), max: pos2(810.0, 620.0) };

    /// The place of a point of the screen in the picture, 0…1.
    fn within(zoom: &Zoom, size: Vec2, at: Pos2) -> Vec2 {
        let image = zoom.image_rect(AREA, size);
        (at - image.min) / image.size()
    }

    #[test]
    fn zooming_keeps_what_is_under_the_pointer() {
        let size = vec2(400.0, 200.0);
        let mut zoom = Zoom::default();
        let pointer = pos2(150.0, 300.0);
        let before = within(&zoom, size, pointer);
        zoom.zoom_at(AREA, size, pointer, 2.5);
        let after = within(&zoom, size, pointer);
        assert!((before - after).length() < 1e-4, "{before:?} {after:?}");
        zoom.fit();
        assert!(AREA.contains_rect(zoom.image_rect(AREA, size)));
    }

    #[test]
    fn a_region_fills_the_area_and_its_middle_comes_to_the_middle() {
        let size = vec2(400.0, 200.0);
        let mut zoom = Zoom::default();
        zoom.pan(AREA, size, vec2(13.0, -7.0));
        let region = Rect::from_min_size(pos2(200.0, 250.0), vec2(160.0, 60.0));
        let (corner, middle) = (within(&zoom, size, region.left_top()), within(&zoom, size, region.center()));
        zoom.show_region(AREA, size, region);
        assert!((within(&zoom, size, AREA.center()) - middle).length() < 1e-4);
        // Wider than high, as the area is not: it fills the width.
        assert!((within(&zoom, size, pos2(AREA.left(), AREA.center().y)).x - corner.x).abs() < 1e-4);
        let before = zoom.image_rect(AREA, size);
        zoom.show_region(AREA, size, Rect::from_min_size(pos2(200.0, 250.0), vec2(3.0, 60.0)));
        assert_eq!(zoom.image_rect(AREA, size), before, "a click with the key held is no region");
    }

    #[test]
    fn a_region_that_is_given_up_while_it_is_dragged_is_not_zoomed_to() {
        let size = vec2(400.0, 200.0);
        let picture = |ui: &mut Ui, (zoom, grab): &mut (Zoom, Option<Grab>)| {
            let response = ui.allocate_rect(ui.available_rect_before_wrap(), Sense::click_and_drag());
            navigate(ui, &response, (zoom, grab), size, Navigation::default());
        };
        let (from, to) = (pos2(100.0, 100.0), pos2(300.0, 220.0));
        for (is_given_up, is_zoomed) in [(true, false), (false, true)] {
            let mut zoom = Zoom::default();
            zoom.await_region();
            let before = zoom.image_rect(AREA, size);
            let mut window = Harness::builder().with_size(vec2(600.0, 400.0)).build_ui_state(picture, (zoom, None));
            pull(&mut window, from, to);
            assert_eq!(window.state().1, Some(Grab::Region(from)));
            if is_given_up {
                window.key_press(Key::Escape);
                window.run_steps(2);
                assert_eq!(window.state().1, None);
            }
            window.drop_at(to);
            window.run_steps(3);
            assert_eq!(window.state().0.image_rect(AREA, size) != before, is_zoomed);
        }
    }

    #[test]
    fn the_part_in_sight_is_told_where_the_rest_is_not() {
        let size = vec2(400.0, 200.0);
        let mut zoom = Zoom::default();
        assert_eq!(part_seen(AREA, zoom.image_rect(AREA, size)), None, "all of it");
        let image = zoom.image_rect(AREA, size);
        zoom.show_region(AREA, size, Rect::from_min_max(image.center(), image.max));
        let [low, high] = part_seen(AREA, zoom.image_rect(AREA, size)).expect("a quarter");
        let told = [low[0], high[0], high[1]].map(|share| (1e3 * share).round());
        assert!(told == [500.0, 1000.0, 1000.0] && (0.3..0.5).contains(&low[1]), "{low:?} {high:?}");
        assert_eq!(part_seen(AREA, image.translate(vec2(4000.0, 0.0))), None, "nothing of it");
    }

    #[test]
    fn a_picture_with_more_pixels_lies_where_the_coarse_one_lay() {
        let (coarse, fine) = (vec2(100.0, 50.0), vec2(400.0, 200.0));
        let mut zoom = Zoom::default();
        zoom.heed_size(coarse, 1.0);
        zoom.zoom_at(AREA, coarse, pos2(150.0, 300.0), 3.0);
        let before = zoom.image_rect(AREA, coarse);
        zoom.heed_size(fine, 1.0);
        let after = zoom.image_rect(AREA, fine);
        assert!((before.min - after.min).length() < 1e-2 && (before.max - after.max).length() < 1e-2);
        zoom.one_to_one(2.0);
        zoom.heed_size(coarse, 2.0);
        assert_eq!(zoom.image_rect(AREA, coarse).size(), coarse / 2.0, "one to one stays so");
    }

    #[test]
    fn one_to_one_is_a_pixel_on_each_pixel_of_the_screen() {
        let size = vec2(400.0, 200.0);
        let mut zoom = Zoom::default();
        zoom.zoom_at(AREA, size, pos2(150.0, 300.0), 3.0);
        let middle = within(&zoom, size, AREA.center());
        zoom.one_to_one(2.0);
        assert!((zoom.image_rect(AREA, size).size() - size / 2.0).length() < 1e-3);
        assert!((within(&zoom, size, AREA.center()) - middle).length() < 1e-4);
    }
}
