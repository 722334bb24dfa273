//! Lamps in pictures that wait for them.

use std::sync::Arc;

use clerestory_transport::lamps::FreeLamp;

use super::{Bench, SAMPLES};
use crate::session::lamps::sums::Sums;
use crate::session::lamps::{LampLight, LampOrder, LampView};

/// The light of lamps as smooth as it gets, for pictures that wait for it. Lamps that stay from one look to the next are traced once.
pub struct StillLamps {
    bench: Bench,
    /// The light that was put together last, and of which lamps.
    last: Option<(Vec<FreeLamp>, LampLight)>,
}

impl StillLamps {
    /// In a view, as smooth as frames want it.
    pub fn new(view: Arc<LampView>) -> StillLamps {
        StillLamps { bench: Bench { most_samples: *SAMPLES.end() as u32, ..Bench::new(view) }, last: None }
    }

    /// The same, as fine as the window shows lamps that stand still.
    pub fn fine(view: Arc<LampView>) -> StillLamps {
        StillLamps { bench: Bench::new(view), last: None }
    }

    /// The light of some lamps, those that are muted left out; `None` if it was stopped.
    pub fn light(&mut self, lamps: &[FreeLamp], stop: &(dyn Fn() -> bool + Sync)) -> Option<LampLight> {
        let shining: Vec<FreeLamp> = lamps.iter().filter(|lamp| !lamp.setting.muted).cloned().collect();
        if self.last.as_ref().is_none_or(|(of, _)| *of != shining) {
            self.last = None;
            let light = self.traced(shining.clone(), stop)?;
            self.last = Some((shining, light));
        }
        self.last.as_ref().map(|(_, light)| light.clone())
    }

    fn traced(&mut self, shining: Vec<FreeLamp>, stop: &(dyn Fn() -> bool + Sync)) -> Option<LampLight> {
        let (view, serial) = (self.bench.view.clone(), self.bench.serial + 1);
        self.bench.take(LampOrder { view, lamps: shining, shows_arriving: true, serial });
        while self.bench.next().is_some() {
            if stop() {
                return None;
            }
            self.bench.step(&|_, _| stop());
        }
        // How sums round must not depend on the pictures before.
        (self.bench.seen_sums, self.bench.arriving_sums) = (Sums::default(), Sums::default());
        self.bench.news()
    }
}
