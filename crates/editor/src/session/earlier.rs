//! Bakes of a scene as it was, from which a bake of the scene as it is takes over what is still right.

use clerestory_transport::bake::{Bake, BakeHeader, Indirect};
use clerestory_transport::figures::Figures;

use super::{BakeState, Session, Source};
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

    /// What was asked for and would help, where the finished bake that is shown is far from that.
    pub fn missed_words(&self) -> Option<String> {
        let is_done = self.bake == BakeState::Done;
        let (shown, figures) = self.shown.as_ref().filter(|_| is_done).zip(self.figures.as_ref())?;
        missed_words(&shown.header, figures)
    }
}

/// Decibels by which a bake may be worse than was asked for without a word: what it knows of its error is an estimate.
const MISSED_DB: f32 = 3.0;

/// What was asked for and would help, where a bake is far from that; nothing of pictures, and of what a time ended.
fn missed_words(header: &BakeHeader, figures: &Figures) -> Option<String> {
    let asked = header.config.tolerance_db;
    let is_missed = asked - figures.error_db.total > MISSED_DB;
    header.grounds.as_ref().filter(|_| is_missed)?;
    let worst = figures.column_error_db.as_ref().and_then(|told| told.worst.first());
    let worst = worst.map_or(String::new(), |worst| format!("`{}` is known least; ", worst.light));
    let help = match header.config.indirect {
        Indirect::Traced => "more samples, or sharing indirect light, would help",
        Indirect::Shared => "more samples would help",
    };
    Some(format!("{asked:.0} were asked for: {worst}{help}"))
}

/// What a finished bake tells.
pub(super) fn baked_words(bake: &Bake, figures: &Figures) -> String {
    let baked = format!("Baked at {:.1} dB", figures.error_db.total);
    if bake.is_dark() {
        return format!("{baked}; {}", black_words("the picture is", &bake.header.basis));
    }
    let baked = match figures.skipped.reused_columns {
        0 => baked,
        n => format!("{baked}; {n} of {} columns taken over", figures.columns),
    };
    match missed_words(&bake.header, figures) {
        None => baked,
        Some(missed) => format!("{baked}, {missed}"),
    }
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use clerestory_transport::bake::BakeConfig;
    use clerestory_transport::camera::Film;

    use super::*;
    use crate::support::room_job;

    #[test]
    fn a_bake_that_is_far_from_what_was_asked_says_so_and_what_would_help() {
        let config = BakeConfig { spp: 2, tolerance_db: 60.0, ..BakeConfig::default() };
        let job = room_job(Film { width: 20, height: 16 }, config);
        let bake = job.run(|_| ControlFlow::Continue(())).unwrap().unwrap();
        let figures = bake.figures();
        let words = baked_words(&bake, &figures);
        let told = figures.column_error_db.as_ref().unwrap();
        let missed = format!(
            " dB, 60 were asked for: `{}` is known least; more samples, or sharing indirect light, would help",
            told.worst[0].light
        );
        assert!(words.starts_with("Baked at ") && words.ends_with(&missed), "{words}");
        let mut header = BakeHeader::clone(&bake.header);
        header.config.indirect = Indirect::Shared;
        assert!(missed_words(&header, &figures).unwrap().ends_with("least; more samples would help"));
        header.config.tolerance_db = figures.error_db.total + MISSED_DB - 0.5;
        assert_eq!(missed_words(&header, &figures), None, "as good as asked");
        let of_time = BakeHeader { grounds: None, ..BakeHeader::clone(&bake.header) };
        assert_eq!(missed_words(&of_time, &figures), None);
    }
}
