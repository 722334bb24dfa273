//! Which patches of the sky a vertex connects to: those that light reaches the picture from.
//!
//! Through windows only few patches shine. Pilot pixels connect to all of them; what none of these ever saw is not
//! connected to afterwards, and later vertices connect to a patch the more often the more of its light came in. No light is
//! lost: walks that escape to a patch by themselves count the more the less it is connected to.

use crate::emitters::Lighting;
use crate::path::Pick;
use crate::sampler::Sampler;

/// Patches that a later vertex connects to.
const LATER_PATCHES: u32 = 16;

/// Share of later picks that go to all patches alike, whatever the pilots saw.
const ALIKE: f32 = 0.2;

/// What becomes of patches that no pilot saw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unseen {
    /// They are connected to as seldom as the dimmest.
    Kept,
    /// They are left to walks that escape to them.
    Dropped,
}

/// The patches of a sky that are connected to.
#[derive(Clone, Debug, Default)]
pub struct SkyPicks {
    columns: Vec<u32>,
    /// Summed probabilities of a later pick.
    summed: Vec<f32>,
    /// Mean luminance of the baked map over each patch of the sky, nit.
    shining: Vec<f32>,
}

impl SkyPicks {
    /// All patches; none where there is no dome.
    pub fn new(lighting: &Lighting) -> SkyPicks {
        let Some((columns, dome)) = lighting.dome() else { return SkyPicks::default() };
        SkyPicks { shining: dome.luminances().to_vec(), ..SkyPicks::of(columns.map(|column| (column, 1.0)).collect()) }
    }

    /// Some columns in order, each with its brightness, under an even map.
    fn of(patches: Vec<(u32, f32)>) -> SkyPicks {
        let total: f64 = patches.iter().map(|&(_, light)| f64::from(light)).sum();
        let alike = f64::from(ALIKE) / patches.len().max(1) as f64;
        let mut sum = 0.0;
        let summed = patches.iter().map(|&(_, light)| {
            sum += alike + f64::from(1.0 - ALIKE) * f64::from(light) / total;
            sum as f32
        });
        let summed = summed.collect();
        let shining = vec![1.0; patches.len()];
        SkyPicks { columns: patches.into_iter().map(|(column, _)| column).collect(), summed, shining }
    }

    /// What pilots saw of each patch. Nothing changes where there is nothing to tell. Half of the picks go by what a patch of
    /// 1 nit brings, half by what it brings under the map.
    pub fn learn(&mut self, reach: &[f32], unseen: Unseen) {
        if reach.len() == self.columns.len() && reach.iter().any(|&light| light > 0.0) {
            let even: Vec<f32> = reach.iter().map(|light| light.max(0.0)).collect();
            let mapped: Vec<f32> = even.iter().zip(&self.shining).map(|(light, shining)| light * shining).collect();
            let [of_even, of_mapped] = [&even, &mapped].map(|all| 1.0 / all.iter().sum::<f32>().max(f32::MIN_POSITIVE));
            let both = even.iter().zip(&mapped).map(|(even, mapped)| even * of_even + mapped * of_mapped);
            let patches = self.columns.iter().copied().zip(both);
            *self = SkyPicks::of(patches.filter(|&(_, light)| unseen == Unseen::Kept || light > 0.0).collect());
        }
    }

    /// The columns in order.
    pub fn columns(&self) -> &[u32] {
        &self.columns
    }

    /// Adds the picks of a later vertex: one patch from each of stretches of equal probability.
    pub fn pick_later(&self, sampler: &mut Sampler, picks: &mut Vec<Pick>) {
        let n = self.columns.len();
        if n <= LATER_PATCHES as usize {
            picks.extend(self.columns.iter().map(|&column| Pick { column, inverse_rate: 1.0 }));
            return;
        }
        for nth in 0..LATER_PATCHES {
            let at = (nth as f32 + sampler.next_1d()) / LATER_PATCHES as f32;
            let patch = self.summed.partition_point(|&sum| sum <= at).min(n - 1);
            picks.push(Pick { column: self.columns[patch], inverse_rate: 1.0 / self.rate(patch) });
        }
    }

    /// Expected number of picks of a column at a later vertex; `None` for a column that is none of these.
    pub fn later_rate(&self, column: u32) -> Option<f32> {
        self.columns.binary_search(&column).ok().map(|patch| self.rate(patch))
    }

    fn rate(&self, patch: usize) -> f32 {
        if self.columns.len() <= LATER_PATCHES as usize {
            return 1.0;
        }
        let before = if patch == 0 { 0.0 } else { self.summed[patch - 1] };
        LATER_PATCHES as f32 * (self.summed[patch] - before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn later_picks_come_as_often_as_their_rate_says() {
        let mut sky = SkyPicks::of((10..300).map(|column| (column, 1.0)).collect());
        let reach: Vec<f32> =
            (0..290).map(|i| if i < 3 { 0.0 } else { 1.0 + (i % 7) as f32 * (i / 200) as f32 }).collect();
        sky.learn(&reach, Unseen::Dropped);
        let (mut counts, mut picks, n) = (vec![0.0; 300], Vec::new(), 20_000);
        for index in 0..n {
            picks.clear();
            sky.pick_later(&mut Sampler::new(1, 1, index), &mut picks);
            for pick in &picks {
                counts[pick.column as usize] += 1.0 / f64::from(n);
                assert!((pick.inverse_rate * sky.later_rate(pick.column).unwrap() - 1.0).abs() < 1e-6);
            }
        }
        for (column, count) in counts.into_iter().enumerate() {
            let rate = f64::from(sky.later_rate(column as u32).unwrap_or(0.0));
            assert!((count - rate).abs() < 6.0 * (rate / f64::from(n)).sqrt() + 1e-12, "{column}: {count} for {rate}");
        }
        assert_eq!((sky.later_rate(12), sky.later_rate(5)), (None, None));
        assert!(sky.later_rate(299) > sky.later_rate(20), "bright patches more often");
    }

    #[test]
    fn pilots_that_saw_nothing_change_nothing() {
        let mut sky = SkyPicks::of((0..40).map(|column| (column, 1.0)).collect());
        sky.learn(&[0.0; 40], Unseen::Dropped);
        sky.learn(&[1.0; 3], Unseen::Dropped);
        assert_eq!(sky.columns().len(), 40);
        assert!((sky.later_rate(7).unwrap() - 0.4).abs() < 1e-5);
    }
}
