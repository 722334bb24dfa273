//! The place in the picture that keys ask about while the picture has the keyboard.

use eframe::egui::{Color32, Event, EventFilter, Response, Stroke, StrokeKind, Ui, Vec2};

use super::probe::{Plate, Probes};
use crate::panels::arrows::arrows;
use crate::panels::shortcuts::hears_keys;
use crate::theme;

/// Pixels that an arrow key goes with Shift.
const FAR: f32 = 10.0;
/// Radius of the ring around the place, points.
const RING: f32 = 9.0;

/// The pixel that is asked about. In a picture that has the keyboard it is where arrow keys went since the pointer last moved there;
/// before that the one under the pointer, or else that was asked or pinned last, at first the middle of what is seen.
pub(super) fn place(ui: &Ui, plates: &[Plate], probes: &mut Probes) -> Option<[u32; 2]> {
    let hovered = plates.iter().find_map(Plate::hovered);
    let moves = ui.input(|input| input.events.iter().any(|event| matches!(event, Event::PointerMoved(_))));
    if hovered.is_some() && moves {
        probes.by_keys = None;
    }
    let Some(plate) = plates.iter().find(|plate| plate.is_keyed) else { return hovered };
    let before = probes.by_keys.or(hovered).or(probes.picked).or(probes.pins.last().copied());
    let from = before.unwrap_or_else(|| plate.middle());
    let to = plate.grid.beside(from, steps(ui, plate.picture));
    if to != from {
        probes.by_keys = Some(to);
        // What lights the place goes along, where that is being told.
        probes.picked = probes.picked.map(|px| if px == from { to } else { px });
    }
    Some(to)
}

/// Pixels that arrow keys go to the right and down; in a menu that is open they go from item to item instead.
fn steps(ui: &Ui, picture: &Response) -> Vec2 {
    if hears_keys(ui) {
        return arrows(ui, picture, FAR);
    }
    ui.memory_mut(|memory| memory.set_focus_lock_filter(picture.id, EventFilter::default()));
    Vec2::ZERO
}

/// Frames the picture that has the keyboard and rings the place that keys ask about, unless the pointer shows it.
pub(super) fn paint(ui: &Ui, plates: &[Plate], place: Option<[u32; 2]>) {
    let Some(plate) = plates.iter().find(|plate| plate.is_keyed) else { return };
    let painter = ui.painter_at(plate.picture.rect);
    painter.rect_stroke(plate.picture.rect, 0.0, Stroke::new(1.5, theme::ACCENT), StrokeKind::Inside);
    if let Some(px) = place.filter(|_| plates.iter().find_map(Plate::hovered) != place) {
        for (width, color) in [(3.5, Color32::from_black_alpha(150)), (1.5, Color32::WHITE)] {
            painter.circle_stroke(plate.grid.middle(px), RING, Stroke::new(width, color));
        }
    }
}
