//! Marking a part of the picture: a rectangle, a brush, or the surface under the pointer.

use std::sync::Arc;

use clerestory_transport::camera::Film;
use eframe::egui::{self, Color32, CursorIcon, Mesh, PointerButton, Pos2, Rect, Response, Shape, Stroke, Ui, vec2};

use super::lamps::hint;
use crate::marks::{Kin, Marks};
use crate::panels::shortcuts::escapes;
use crate::theme;

/// What a press on the picture marks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tool {
    /// A rectangle from corner to corner; a click is one pixel.
    Rectangle,
    /// What the pointer passes over.
    Brush,
    /// The surface that is seen there.
    Surface,
}

/// What becomes of what is marked already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Join {
    /// It goes.
    Replace,
    /// It stays.
    Add,
    /// What is marked now is taken out of it.
    Remove,
}

/// A surface that was clicked on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Picked {
    /// Pixel that was clicked on.
    pub pixel: u32,
    /// What becomes of what is marked already.
    pub join: Join,
}

/// What is marked, and how.
#[derive(Clone, Debug, Default)]
pub struct Marking {
    /// What a press does; none leaves the picture to lamps and spots.
    pub tool: Option<Tool>,
    /// What counts as one surface.
    pub kin: Kin,
    /// Radius of the brush, pixels; 0 is one that suits the picture.
    pub radius_px: f32,
    /// What is marked.
    pub marks: Option<Arc<Marks>>,
    /// A click on a surface that waits until it is known what each pixel sees.
    pub picked: Option<Picked>,
    /// Where the press began, and where the brush was last, in pixels.
    press: Option<([f32; 2], [f32; 2], Join)>,
}

impl Marking {
    /// Marks of this film, if any pixel is marked.
    pub fn marks(&self) -> Option<&Arc<Marks>> {
        self.marks.as_ref().filter(|marks| !marks.is_empty())
    }

    /// The radius of the brush on a film.
    pub fn radius(&self, film: Film) -> f32 {
        if self.radius_px > 0.0 { self.radius_px } else { (film.width as f32 / 40.0).max(1.0) }
    }

    /// Lets go of what the pointer is about to mark.
    pub fn let_go(&mut self) {
        self.press = None;
    }

    /// Takes new marks in.
    pub fn join(&mut self, new: Marks, join: Join) {
        let old = self.marks.take().filter(|marks| marks.film == new.film);
        self.marks = match (join, old) {
            (Join::Replace, _) | (Join::Add, None) => Some(Arc::new(new)),
            (Join::Add, Some(mut old)) => {
                Arc::make_mut(&mut old).add(&new);
                Some(old)
            }
            (Join::Remove, Some(mut old)) => {
                Arc::make_mut(&mut old).remove(&new);
                Some(old)
            }
            (Join::Remove, None) => None,
        };
    }
}

/// Marks what the pointer asks for and shows what is marked. Answers whether the pointer is taken.
pub fn marking_ui(ui: &Ui, response: &Response, image: Rect, film: Film, state: &mut Marking) -> bool {
    if let Some(marks) = state.marks().filter(|marks| marks.film == film) {
        paint(ui, response.rect, image, marks);
    }
    let Some(tool) = state.tool else { return false };
    if escapes(ui) {
        (state.tool, state.press) = (None, None);
        return false;
    }
    let scale = vec2(film.width as f32, film.height as f32) / image.size();
    let to_px = |at: Pos2| {
        let px = (at - image.min) * scale;
        [px.x, px.y]
    };
    let join = ui.input(|input| match input.modifiers {
        modifiers if modifiers.alt => Join::Remove,
        modifiers if modifiers.shift || tool == Tool::Brush => Join::Add,
        _ => Join::Replace,
    });
    let (down, origin, at) =
        ui.input(|input| (input.pointer.primary_down(), input.pointer.press_origin(), input.pointer.interact_pos()));
    let began = response.drag_started_by(PointerButton::Primary) || response.clicked_by(PointerButton::Primary);
    if let (true, Some(from)) = (began, origin.or(at)) {
        state.press = Some((to_px(from), to_px(from), join));
        if tool == Tool::Brush {
            state.join(Marks::stroke(film, [to_px(from); 2], state.radius(film)), join);
        }
    }
    if let (Some((from, last, join)), Some(at)) = (state.press, at) {
        let now = to_px(at);
        match tool {
            Tool::Brush if now != last => {
                state.join(Marks::stroke(film, [last, now], state.radius(film)), join);
                state.press = Some((from, now, join));
            }
            Tool::Rectangle if down => outline(ui, response.rect, image, scale, [from, now]),
            _ => {}
        }
        if !down {
            state.press = None;
            match tool {
                Tool::Rectangle => state.join(Marks::rect(film, whole(from, now)), join),
                Tool::Surface => state.picked = pixel(film, now).map(|pixel| Picked { pixel, join }),
                Tool::Brush => {}
            }
        }
    }
    if let Some(at) = response.hover_pos() {
        ui.ctx().set_cursor_icon(CursorIcon::Crosshair);
        if tool == Tool::Brush {
            let radius = state.radius(film) / scale.x;
            ui.painter_at(response.rect).circle_stroke(at, radius, Stroke::new(1.2, theme::ACCENT));
        }
        let words = match tool {
            Tool::Rectangle => "Drag a rectangle, Shift adds, Alt takes away",
            Tool::Brush => "Paint, Alt takes away",
            Tool::Surface => "Click a surface, Shift adds, Alt takes away",
        };
        hint(ui, response.rect, words);
    }
    true
}

/// A press that did not travel means the pixel under it; one that went along a row or a column means that one, whether or not it came over
/// the middles of its pixels.
fn whole(from: [f32; 2], to: [f32; 2]) -> [[f32; 2]; 2] {
    let mut corners = [from, to];
    for axis in (0..2).filter(|axis| (from[*axis] - to[*axis]).abs() < 1.0) {
        let pixel = from[axis].floor();
        (corners[0][axis], corners[1][axis]) = (pixel, pixel + 1.0);
    }
    corners
}

fn pixel(film: Film, [x, y]: [f32; 2]) -> Option<u32> {
    let is_inside = (0.0..film.width as f32).contains(&x) && (0.0..film.height as f32).contains(&y);
    is_inside.then(|| y as u32 * film.width + x as u32)
}

fn outline(ui: &Ui, area: Rect, image: Rect, scale: egui::Vec2, corners: [[f32; 2]; 2]) {
    let at = |[x, y]: [f32; 2]| image.min + vec2(x, y) / scale;
    let rect = Rect::from_two_pos(at(corners[0]), at(corners[1]));
    let painter = ui.painter_at(area);
    painter.rect_stroke(rect, 0.0, Stroke::new(3.0, Color32::from_black_alpha(110)), egui::StrokeKind::Middle);
    painter.rect_stroke(rect, 0.0, Stroke::new(1.2, theme::ACCENT), egui::StrokeKind::Middle);
}

/// A veil over the marked pixels, run by run.
fn paint(ui: &Ui, area: Rect, image: Rect, marks: &Marks) {
    let film = marks.film;
    let size = image.size() / vec2(film.width as f32, film.height as f32);
    let color = theme::ACCENT.gamma_multiply(0.35);
    let mut mesh = Mesh::default();
    let pixels = marks.pixels();
    let mut start = 0;
    while start < pixels.len() {
        let mut end = start + 1;
        while end < pixels.len() && pixels[end] == pixels[end - 1] + 1 && !pixels[end].is_multiple_of(film.width) {
            end += 1;
        }
        let (x, y) = ((pixels[start] % film.width) as f32, (pixels[start] / film.width) as f32);
        let corner = image.min + vec2(x, y) * size;
        mesh.add_colored_rect(Rect::from_min_size(corner, vec2((end - start) as f32, 1.0) * size), color);
        start = end;
    }
    ui.painter_at(area.intersect(image)).add(Shape::mesh(mesh));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drag_along_a_row_marks_it_and_a_press_its_pixel() {
        let film = Film { width: 10, height: 8 };
        let marked = |from: [f32; 2], to: [f32; 2]| Marks::rect(film, whole(from, to)).pixels().to_vec();
        assert_eq!(marked([2.2, 3.1], [5.8, 3.4]), [32, 33, 34, 35], "above the middles of the row");
        assert_eq!(marked([2.7, 3.1], [2.9, 6.0]), [32, 42, 52]);
        assert_eq!(marked([2.2, 3.1], [2.6, 3.4]), [32]);
        assert_eq!(marked([2.2, 3.1], [3.6, 4.6]), [32, 33, 42, 43]);
    }
}
