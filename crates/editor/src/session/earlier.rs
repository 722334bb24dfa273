//! Bakes of a scene as it was, from which a bake of the scene as it is takes over what is still right.

use clerestory_transport::bake::{Bake, BakeHeader};
use clerestory_transport::figures::Figures;

use super::{Session, Source};
use crate::black::black_words;

impl Session {
    /// Where what is open came from.
    pub fn source(&self) -> Option<&Source> {
        self.opened.as_ref()?.source.as_ref()
    }

    /// Before what is open goes: its bakes stay, if the same file is opened again.
    pub(super) fn keep_earlier(&mut self, next: Option<&Source>) {
        let is_same = self.source().is_some_and(|old| Some(old) == next);
        if !is_same {
            self.earlier.clear();
        } else if self.shown.is_some() {
            self.earlier = self.whole_bakes();
        }
    }

    /// What a bake that is to start may take columns from.
    pub(super) fn earlier_bakes(&self) -> Vec<Bake> {
        let mut bakes = self.whole_bakes();
        bakes.extend(self.earlier.iter().cloned());
        bakes
    }

    /// A view was baked again: what there was of it before is of no use any more.
    pub(super) fn forget_earlier(&mut self, header: &BakeHeader) {
        let view = |header: &BakeHeader| header.grounds.as_ref().map(|grounds| grounds.view.clone());
        self.earlier.retain(|bake| view(&bake.header) != view(header));
    }
}

/// What a finished bake tells.
pub(super) fn baked_words(bake: &Bake, figures: &Figures) -> String {
    let baked = format!("Baked at {:.1} dB", figures.error_db.total);
    if bake.is_dark() {
        return format!("{baked}; {}", black_words("the picture is"));
    }
    match figures.skipped.reused_columns {
        0 => baked,
        n => format!("{baked}; {n} of {} columns taken over", figures.columns),
    }
}
