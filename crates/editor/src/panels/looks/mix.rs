//! Two looks against each other: compared in the picture, or one becoming the other.

use std::borrow::Cow;

use clerestory_transport::basis::LightBasis;
use eframe::egui::{ComboBox, RichText, Slider, Ui};

use super::in_row;
use crate::look::Look;
use crate::look::fade::fade;
use crate::look::snapshot::Mark;
use crate::panels::number::{Spelling, number_of, slider_ui};
use crate::viewport::compare::Way;

/// What the lights as they are now are called.
const NOW: &str = "Now";

/// What is seen on a side of a comparison.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Side {
    /// The lights as they are now.
    Present,
    /// The snapshot of that name.
    Snapshot(String),
}

impl Side {
    /// For people. A look that is called as the present is stands between quotes.
    pub fn words(&self) -> Cow<'_, str> {
        match self {
            Side::Present => NOW.into(),
            Side::Snapshot(name) if name == NOW => format!("“{name}”").into(),
            Side::Snapshot(name) => name.into(),
        }
    }

    /// The name of its snapshot.
    pub(super) fn name_mut(&mut self) -> Option<&mut String> {
        match self {
            Side::Present => None,
            Side::Snapshot(name) => Some(name),
        }
    }
}

/// A comparison.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Compare {
    /// Left and right.
    pub sides: [Side; 2],
    /// How.
    pub way: Way,
}

impl Compare {
    /// The present look against the snapshot that it came from where it was changed since, else against another one.
    pub(super) fn start(look: &Look) -> Option<Compare> {
        let find = |wanted: &dyn Fn(Mark) -> bool| look.snapshots.iter().find(|snapshot| wanted(look.mark(snapshot)));
        let other = find(&|mark| mark == Mark::Changed).or_else(|| find(&|mark| mark != Mark::On));
        let other = other.or(look.snapshots.first())?.name.clone();
        Some(Compare { sides: [Side::Snapshot(other), Side::Present], way: Way::Wipe })
    }

    /// A snapshot against the present look, in the way of the comparison before.
    pub(super) fn with_now(name: &str, before: Option<&Compare>) -> Compare {
        let way = before.map_or(Way::default(), |before| before.way);
        Compare { sides: [Side::Snapshot(name.to_owned()), Side::Present], way }
    }

    /// Sides whose snapshot is gone show the present look.
    pub(super) fn heal(&mut self, look: &Look) {
        for side in &mut self.sides {
            if matches!(side, Side::Snapshot(name) if look.snapshot(name).is_none()) {
                *side = Side::Present;
            }
        }
    }
}

/// A cross-fade under way.
#[derive(Clone, Debug, PartialEq)]
pub struct Fade {
    /// Names of the snapshots from and to.
    pub ends: [String; 2],
    /// 0 is the first, 1 the second.
    pub share: f32,
}

impl Fade {
    /// From the look that is on, else the first one, to the one behind it.
    pub(super) fn start(look: &Look) -> Option<Fade> {
        let on = look.snapshots.iter().position(|snapshot| look.on.as_ref() == Some(&snapshot.name)).unwrap_or(0);
        let next = (on + 1) % look.snapshots.len().max(1);
        let name = |idx: usize| look.snapshots.get(idx).map(|snapshot| snapshot.name.clone());
        Some(Fade { ends: [name(on)?, name(next)?], share: 0.0 })
    }

    /// Whether both of its snapshots are there.
    pub(super) fn is_whole(&self, look: &Look) -> bool {
        self.ends.iter().all(|name| look.snapshot(name).is_some())
    }
}

/// The row of a comparison.
pub(super) fn compare_ui(ui: &mut Ui, compare: &mut Compare, look: &Look) {
    ui.horizontal_wrapped(|ui| {
        ui.label("Left");
        side_ui(ui, "Left look", &mut compare.sides[0], look);
        ui.label("Right");
        side_ui(ui, "Right look", &mut compare.sides[1], look);
        ui.add_space(8.0);
        ui.selectable_value(&mut compare.way, Way::Wipe, "Wipe").on_hover_text("Drag the divider over the picture");
        ui.selectable_value(&mut compare.way, Way::SideBySide, "Side by side")
            .on_hover_text("Two pictures, which zoom and move together");
    });
}

fn side_ui(ui: &mut Ui, label: &str, side: &mut Side, look: &Look) {
    let shown = in_row(&side.words());
    let response = ComboBox::from_id_salt(label).selected_text(shown).show_ui(ui, |ui| {
        ui.selectable_value(side, Side::Present, NOW);
        for other in look.snapshots.iter().map(|snapshot| Side::Snapshot(snapshot.name.clone())) {
            let words = in_row(&other.words());
            ui.selectable_value(side, other, words);
        }
    });
    response.response.accessible_name(label);
}

/// The row of a cross-fade. The slider lights the scene.
pub(super) fn fade_ui(ui: &mut Ui, state: &mut Fade, look: &mut Look, basis: Option<&LightBasis>) {
    // An end that is on is where the slider stands, however that came about.
    for (end, share) in [(0, 0.0), (1, 1.0)] {
        if look.snapshot(&state.ends[end]).is_some_and(|snapshot| look.mark(snapshot) == Mark::On) {
            state.share = share;
        }
    }
    let before = state.clone();
    ui.horizontal(|ui| {
        ui.label("From");
        end_ui(ui, "Fade from", &mut state.ends[0], look);
        ui.spacing_mut().slider_width = (ui.available_width() - 420.0).clamp(120.0, 420.0);
        let percent = |share: f64, _| format!("{:.0} %", 100.0 * share);
        let read = |text: &str| number_of(text, "%").map(|percent| percent / 100.0);
        slider_ui(ui, Slider::new(&mut state.share, 0.0..=1.0), Spelling::new(percent, read))
            .accessible_name("Share of the second look")
            .on_hover_text("Share of the second look, %; light is mixed linearly");
        ui.label("to");
        end_ui(ui, "Fade to", &mut state.ends[1], look);
        ui.label(RichText::new("Keep look keeps what you see").weak().small());
    });
    let ends = [0, 1].map(|end| look.snapshot(&state.ends[end]).map(crate::look::snapshot::Snapshot::look));
    if let ([Some(from), Some(to)], true) = (ends, *state != before) {
        let mixed = fade(&from, &to, state.share, basis);
        (look.lights, look.display) = (mixed.lights, mixed.display);
        look.on = match state.share {
            s if s <= 0.0 => Some(state.ends[0].clone()),
            s if s >= 1.0 => Some(state.ends[1].clone()),
            _ => None,
        };
    }
}

fn end_ui(ui: &mut Ui, label: &str, end: &mut String, look: &Look) {
    let response = ComboBox::from_id_salt(label).selected_text(in_row(end)).show_ui(ui, |ui| {
        for snapshot in &look.snapshots {
            ui.selectable_value(end, snapshot.name.clone(), in_row(&snapshot.name));
        }
    });
    response.response.accessible_name(label);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_look_that_is_called_now_is_told_from_the_present() {
        let words = |name: &str| Side::Snapshot(name.into()).words().into_owned();
        assert_eq!([Side::Present.words().into_owned(), words("Now"), words("Day")], ["Now", "“Now”", "Day"]);
    }

    #[test]
    fn a_look_is_compared_with_what_differs_from_it() {
        let left = |look: &Look| Compare::start(look).map(|compare| compare.sides[0].words().into_owned());
        let mut look = Look::default();
        assert_eq!(left(&look), None);
        look.keep("First");
        assert_eq!(left(&look).as_deref(), Some("First"), "there is no other");
        look.keep("Second");
        assert_eq!(left(&look).as_deref(), Some("First"), "not with itself");
        look.display.exposure_ev = Some(1.0);
        assert_eq!(left(&look).as_deref(), Some("Second"), "with what it was before the change");
    }
}
