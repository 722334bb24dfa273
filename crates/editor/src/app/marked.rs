//! Marks and probes of the look in the picture that is shown, and back: the look keeps them for every view, the picture has those
//! of its own.

use std::sync::Arc;

use super::App;
use crate::marks::{Framing, Marked, Marks, Probed};
use crate::session::Shown;

/// What the picture was given of the look last, and of which look and picture.
#[derive(Default)]
pub(super) struct InView {
    framing: Option<Framing>,
    kept: (Option<Marked>, Vec<Probed>),
    given: (Option<Arc<Marks>>, Vec<[u32; 2]>),
}

impl App {
    /// Brings what the look has into the picture where the look or the picture is another one, else what was marked in the picture
    /// into the look.
    pub(super) fn follow_marks(&mut self) {
        let Some(shown) = &self.session.shown else { return };
        let framing = framing_of(shown);
        let is_new = self.in_view.framing.as_ref() != Some(&framing);
        if is_new || (&self.in_view.kept.0, &self.in_view.kept.1) != (&self.look.marks, &self.look.probes) {
            self.show_marks(framing);
            return;
        }
        if self.view.marking.marks != self.in_view.given.0 {
            let marks = self.view.marking.marks().cloned();
            self.look.marks = marks.map(|marks| Marked { framing: framing.clone(), marks });
            (self.in_view.kept.0, self.in_view.given.0) = (self.look.marks.clone(), self.view.marking.marks.clone());
        }
        if self.view.probes.pins != self.in_view.given.1 {
            let pixels = self.view.probes.pins.clone();
            self.look.probes.retain(|probed| !probed.framing.fits(&framing));
            self.look.probes.extend((!pixels.is_empty()).then(|| Probed { framing, pixels: pixels.clone() }));
            (self.in_view.kept.1, self.in_view.given.1) = (self.look.probes.clone(), pixels);
        }
    }

    fn show_marks(&mut self, framing: Framing) {
        self.view.marking.marks = self.look.marks.as_ref().and_then(|marked| marked.on(&framing));
        let pins = self.look.probes.iter().filter_map(|probed| probed.on(&framing)).flatten();
        self.view.probes.pins = Vec::new();
        pins.for_each(|px| self.view.probes.pin(px));
        let given = (self.view.marking.marks.clone(), self.view.probes.pins.clone());
        let kept = (self.look.marks.clone(), self.look.probes.clone());
        self.in_view = InView { framing: Some(framing), kept, given };
    }

    /// What of the look belongs to other views than the one that is shown, for people.
    pub(super) fn elsewhere(&self) -> Option<String> {
        let framing = framing_of(self.session.shown.as_ref()?);
        let marked = self.look.marks.as_ref().filter(|marked| !marked.framing.fits(&framing));
        let probed = self.look.probes.iter().filter(|probed| !probed.framing.fits(&framing));
        let probes = match probed.map(|probed| probed.pixels.len()).sum::<usize>() {
            0 => None,
            1 => Some("A probe is in another view".to_owned()),
            n => Some(format!("{n} probes are in another view")),
        };
        let words = [marked.map(|_| "What was marked is in another view".to_owned()), probes];
        let words: Vec<String> = words.into_iter().flatten().collect();
        (!words.is_empty()).then(|| words.join("\n"))
    }
}

fn framing_of(shown: &Shown) -> Framing {
    Framing { film: shown.film(), camera: shown.camera.clone() }
}
