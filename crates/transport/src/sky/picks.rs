//! Which patches of the sky a vertex connects to: those that light reaches the picture from.
//!
//! Through windows only few patches shine. Pilot pixels connect to all of them, and what none of these ever saw is not
//! connected to afterwards. No light is lost: walks that escape to such a patch by themselves then count in full.

use super::DomeEmitter;
use crate::emitters::{Emitter, Lighting};
use crate::path::Pick;
use crate::sampler::Sampler;

/// Patches that a later vertex connects to.
const LATER_PATCHES: u32 = 16;

/// The patches of a sky that are connected to.
#[derive(Clone, Debug, Default)]
pub struct SkyPicks {
    columns: Vec<u32>,
}

impl SkyPicks {
    /// All patches; none where there is no dome.
    pub fn new(lighting: &Lighting) -> SkyPicks {
        let sources = lighting.basis.sources.iter().zip(&lighting.emitters);
        let columns = sources.filter_map(|(source, emitter)| match emitter {
            Emitter::Dome(DomeEmitter { dome }) => Some(source.columns.start..source.columns.start + dome.n_patches()),
            _ => None,
        });
        SkyPicks { columns: columns.flatten().collect() }
    }

    /// The same without some columns, given in order.
    pub fn skip(&mut self, columns: &[u32]) {
        self.columns.retain(|column| columns.binary_search(column).is_err());
    }

    /// The columns in order.
    pub fn columns(&self) -> &[u32] {
        &self.columns
    }

    /// Adds the picks of a later vertex: one patch from each of equal stretches.
    pub fn pick_later(&self, sampler: &mut Sampler, picks: &mut Vec<Pick>) {
        let n = self.columns.len();
        if n <= LATER_PATCHES as usize {
            picks.extend(self.columns.iter().map(|&column| Pick { column, inverse_rate: 1.0 }));
            return;
        }
        let stretch = n as f32 / LATER_PATCHES as f32;
        for nth in 0..LATER_PATCHES {
            let at = (nth as f32 + sampler.next_1d()) * stretch;
            picks.push(Pick { column: self.columns[(at as usize).min(n - 1)], inverse_rate: stretch });
        }
    }

    /// Expected number of picks of a column at a later vertex; `None` for a column that is none of these.
    pub fn later_rate(&self, column: u32) -> Option<f32> {
        let share = (LATER_PATCHES as f32 / self.columns.len() as f32).min(1.0);
        self.columns.binary_search(&column).is_ok().then_some(share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn later_picks_come_as_often_as_their_rate_says() {
        let mut sky = SkyPicks { columns: (10..300).collect() };
        sky.skip(&[10, 12, 299]);
        let (mut counts, mut picks, n) = (vec![0.0; 300], Vec::new(), 8000);
        for index in 0..n {
            picks.clear();
            sky.pick_later(&mut Sampler::new(1, 1, index), &mut picks);
            picks.iter().for_each(|pick| counts[pick.column as usize] += 1.0 / f64::from(n));
        }
        for (column, count) in counts.into_iter().enumerate() {
            let rate = f64::from(sky.later_rate(column as u32).unwrap_or(0.0));
            assert!((count - rate).abs() < 6.0 * (rate / f64::from(n)).sqrt() + 1e-12, "{column}: {count} for {rate}");
        }
        assert_eq!((sky.later_rate(12), sky.later_rate(5)), (None, None));
    }
}
