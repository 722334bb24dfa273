//! Lamps in a view, pass by pass: each traced white and kept for itself.

mod still;

use std::collections::HashSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use clerestory_relight::{Radiance, RelightError};
use clerestory_transport::arriving::{self, ArrivingPoints};
use clerestory_transport::camera::Film;
use clerestory_transport::lamps::{FreeLamp, KeptProfiles, Lacking, LampWarning, PreparedLamps};
use clerestory_transport::light::LightSetting;
use clerestory_transport::patches::Patches;
use clerestory_transport::visible::{VisibleConfig, VisiblePoints};
use glam::Vec3;
use rayon::prelude::*;

pub use self::still::StillLamps;

use super::device::LampDevice;
use super::sums::{Sums, Term};
use super::{LampLight, LampOrder, LampPart, LampView, Work};
use crate::sizes::bytes_words;

/// Passes after which a soft shadow is as smooth as it gets.
const SOFT_PASSES: u32 = 64;
/// Samples of a pixel that are kept, for lamps that move: as many as fit into so much memory.
const SAMPLES: std::ops::RangeInclusive<usize> = 2..=8;
/// Samples of a pixel where lamps stand still, for smooth edges; those that are not kept are looked for again by each pass.
const STILL_SAMPLES: u32 = 32;
const MOST_BYTES: usize = 256 << 20;
/// Time between two pictures while nothing moves.
const POST_EVERY: Duration = Duration::from_millis(250);
/// Time after which lamps whose light is there are shown without those that are still to come.
const PATIENCE: Duration = Duration::from_secs(1);
/// Longest time that newer orders wait for a picture in which no lamp goes out.
const MOST_WAIT: Duration = Duration::from_secs(5);

/// A view, and how far its lamps are.
pub(super) struct Bench {
    pub view: Arc<LampView>,
    /// What the pixels see in each of their samples, as far as it was needed.
    points: Vec<VisiblePoints>,
    /// The sample that was looked for last and is not kept, and its number.
    spare: Option<(usize, VisiblePoints)>,
    /// Samples of a pixel that are looked for at most, those that are not kept included.
    most_samples: u32,
    /// Where light arrives in each of their samples, as far as it was needed.
    arriving: Vec<ArrivingPoints>,
    shows_arriving: bool,
    n_samples: usize,
    lamps: Vec<Lit>,
    /// Why lamps that were ordered are not among them.
    failed: Vec<String>,
    /// Profiles as they were when a lamp first asked for them: whoever wants them read again asks for another view.
    profiles: KeptProfiles,
    /// Lamps that were traced so far, to number them.
    n_traced: u64,
    /// What is seen of the light of lamps, and what arrives of it, summed.
    seen_sums: Sums,
    arriving_sums: Sums,
    /// The graphics device, while it lights the view.
    device: Option<LampDevice>,
    /// Why it does not, although there is one.
    device_problem: Option<String>,
    pub serial: u64,
    /// When those lamps were ordered.
    begun: Instant,
    /// The light that was posted last.
    posted: Option<Posted>,
    /// Keys of the lamps that are lit in the window.
    lit: HashSet<String>,
    /// When the first order came that nothing was posted of yet.
    waits_since: Instant,
    /// How long it waits for all of its lamps.
    patience: Duration,
}

/// Light that was posted.
struct Posted {
    /// Of which order.
    serial: u64,
    /// How many passes of all lamps were made, and whether none was left out.
    n_passes: u32,
    is_whole: bool,
    /// Whether it leaves out a lamp that is lit: the window does not show it.
    puts_out: bool,
    at: Instant,
}

/// A lamp, and what it lights.
struct Lit {
    /// No other one of the view has it.
    id: u64,
    /// As it shines.
    lamp: FreeLamp,
    /// White and at its full strength.
    prepared: PreparedLamps,
    /// What there is to say of it, which names it.
    warnings: Vec<LampWarning>,
    /// Sum over the passes, nit; empty before the first one.
    sum: Arc<Vec<[f32; 3]>>,
    n_passes: u32,
    /// Passes that it takes.
    most_passes: u32,
    /// Sum over the passes of what arrives, lux; empty before the first one.
    arriving: Arc<Vec<[f32; 3]>>,
    n_arriving: u32,
    /// Passes that takes; none where it is not measured.
    most_arriving: u32,
    /// What it brings to the columns of patches.
    of_patches: Option<Arc<Vec<[f32; 3]>>>,
    /// What of its light is missing, where that is more than a little; found with what it brings to patches.
    lacking: Option<Lacking>,
}

impl Lit {
    /// A lamp that nothing is known of yet.
    fn new(id: u64, lamp: FreeLamp, prepared: (PreparedLamps, Vec<LampWarning>), most: (u32, u32)) -> Lit {
        let (prepared, warnings) = prepared;
        Lit {
            id,
            lamp,
            prepared,
            warnings,
            sum: Arc::default(),
            n_passes: 0,
            most_passes: most.0,
            arriving: Arc::default(),
            n_arriving: 0,
            most_arriving: most.1,
            of_patches: None,
            lacking: None,
        }
    }

    /// Whether another lamp is this one but for color, intensity and, where nothing is said of it, name.
    fn is_like(&self, lamp: &FreeLamp) -> bool {
        let is_free = self.warnings.is_empty() || self.lamp.key == lamp.key;
        is_free && white(&self.lamp) == FreeLamp { key: self.lamp.key.clone(), ..white(lamp) }
    }

    /// What lacks most, and how often it was done; nothing where all is done.
    fn next(&self) -> Option<(u32, Pass)> {
        let seen = (self.n_passes < self.most_passes).then_some((self.n_passes, Pass::Seen));
        let arriving = (self.n_arriving < self.most_arriving).then_some((self.n_arriving, Pass::Arriving));
        seen.into_iter().chain(arriving).min()
    }

    /// Whether all that a picture needs is there.
    fn is_whole(&self, shows_arriving: bool) -> bool {
        self.n_passes > 0 && (!shows_arriving || self.n_arriving > 0 || self.most_arriving == 0)
    }

    /// Its light as it shines.
    fn part(&self) -> LampPart {
        let weight = weight(&self.lamp);
        LampPart {
            key: self.lamp.key.clone(),
            weights: [weight / self.n_passes as f32, weight / self.n_arriving.max(1) as f32, weight],
            light: self.sum.clone(),
            arriving: self.arriving.clone(),
            of_patches: self.of_patches.clone().unwrap_or_default(),
        }
    }
}

/// What one pass finds of a lamp: it first, where both lack as much.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Pass {
    /// What is seen of its light.
    Seen,
    /// What arrives of it.
    Arriving,
}

/// Adds a pass to a sum. What was posted of it stays as it is: it is copied where somebody still looks at it.
fn add_pass(sum: &mut Arc<Vec<[f32; 3]>>, pass: Vec<[f32; 3]>) {
    if sum.is_empty() {
        *sum = Arc::new(pass);
        return;
    }
    let sums = Arc::make_mut(sum).as_flattened_mut().par_iter_mut().zip(pass.as_flattened());
    sums.for_each(|(sum, more)| *sum += more);
}

/// That lamps are lit by the CPU, and why.
fn on_cpu(error: &RelightError) -> String {
    format!("the CPU lights the lamps, since {error}")
}

/// The lamp without what only weighs its light, and what it stands for.
fn white(lamp: &FreeLamp) -> FreeLamp {
    FreeLamp { setting: LightSetting::default(), replaces: None, ..lamp.clone() }
}

/// Samples of so many bytes each that are kept.
fn samples_within(most_bytes: usize, sample_bytes: usize) -> usize {
    (most_bytes / sample_bytes.max(1)).clamp(*SAMPLES.start(), *SAMPLES.end())
}

impl Bench {
    /// Of a view, before the first lamp.
    pub fn new(view: Arc<LampView>) -> Bench {
        let opened = view.device.as_ref().map(|gpu| LampDevice::new(gpu, &view)).transpose();
        let (device, device_problem) =
            opened.map_or_else(|error| (None, Some(on_cpu(&error))), |device| (device, None));
        Bench {
            view,
            device,
            device_problem,
            points: Vec::new(),
            spare: None,
            most_samples: STILL_SAMPLES,
            arriving: Vec::new(),
            shows_arriving: false,
            n_samples: *SAMPLES.end(),
            lamps: Vec::new(),
            failed: Vec::new(),
            profiles: KeptProfiles::default(),
            n_traced: 0,
            seen_sums: Sums::default(),
            arriving_sums: Sums::default(),
            serial: 0,
            begun: Instant::now(),
            posted: None,
            lit: HashSet::new(),
            waits_since: Instant::now(),
            patience: PATIENCE,
        }
    }

    /// Takes over other lamps; what is known of those that stay is kept.
    pub fn take(&mut self, order: LampOrder) {
        // Lamps that move on before anything is shown do not wait anew with each step.
        if self.has_posted() {
            self.waits_since = Instant::now();
        }
        (self.serial, self.shows_arriving, self.begun) = (order.serial, order.shows_arriving, Instant::now());
        self.failed.clear();
        let mut before = std::mem::take(&mut self.lamps);
        for lamp in order.lamps {
            // Most lamps stay as they are, and comparing names is quick.
            let same = before.iter().position(|lit| lit.lamp.key == lamp.key && lit.is_like(&lamp));
            if let Some(idx) = same.or_else(|| before.iter().position(|lit| lit.is_like(&lamp))) {
                self.lamps.push(Lit { lamp, ..before.swap_remove(idx) });
                continue;
            }
            // One that failed is tried again each time: its file may be there now.
            match PreparedLamps::of(&white(&lamp), &mut self.profiles) {
                Ok((prepared, warnings)) => {
                    let prepared = (prepared.in_scene(&self.view.scene), warnings);
                    let most = self.most_passes(&lamp);
                    self.n_traced += 1;
                    self.lamps.push(Lit::new(self.n_traced, lamp, prepared, most));
                }
                Err(error) => self.failed.push(error.to_string()),
            }
        }
    }

    /// Leaves out the last of the lamps that would take more memory than is free, and says so. What is known of lamps stays.
    pub fn stay_within(&mut self, free_bytes: u64) {
        let (n_ordered, n_most) = (self.lamps.len(), free_bytes / self.lamp_bytes());
        let mut n_new = 0;
        self.lamps.retain(|lit| {
            n_new += u64::from(lit.sum.is_empty());
            !lit.sum.is_empty() || n_new <= n_most
        });
        let n_left_out = n_ordered - self.lamps.len();
        if n_left_out > 0 {
            let Film { width, height } = self.view.film;
            self.failed.push(format!(
                "there is no memory for the light of {n_left_out} of {n_ordered} lamps: in a picture of {width} × {height} it would take \
                 about {}, and {} may be taken; use fewer lamps or a smaller picture",
                bytes_words(n_left_out as u64 * self.lamp_bytes()),
                bytes_words(free_bytes)
            ));
        }
    }

    /// Memory that the light of a lamp takes, bytes. It is there twice where a pass is added to what was posted.
    fn lamp_bytes(&self) -> u64 {
        let n_sums = if self.view.measures { 2 } else { 1 };
        2 * n_sums * (size_of::<[f32; 3]>() * self.view.film.n_pixels()).max(1) as u64
    }

    /// Why lamps are dark.
    fn problems(&self) -> Vec<String> {
        let dark = self.lamps.iter().flat_map(|lit| &lit.warnings).filter_map(|warning| match warning {
            LampWarning::Dark(words) => Some(words),
            LampWarning::Remark(_) => None,
        });
        self.failed.iter().chain(dark).cloned().collect()
    }

    /// What else there is to know of the lamps.
    fn remarks(&self) -> Vec<String> {
        let remarks = self.lamps.iter().flat_map(|lit| &lit.warnings).filter_map(|warning| match warning {
            LampWarning::Remark(words) => Some(words),
            LampWarning::Dark(_) => None,
        });
        self.device_problem.iter().chain(remarks).cloned().collect()
    }

    /// Passes that a lamp takes, of what is seen and of what arrives.
    fn most_passes(&self, lamp: &FreeLamp) -> (u32, u32) {
        let kept = self.n_samples as u32;
        let seen = if lamp.shape.has_soft_shadows() { SOFT_PASSES } else { kept.max(self.most_samples) };
        (seen, if self.view.measures { kept } else { 0 })
    }

    /// The lamp that lacks most, and what of it; none where all have enough.
    fn next(&self) -> Option<(usize, Pass)> {
        let open = self.lamps.iter().enumerate().filter_map(|(idx, lit)| Some((lit.next()?, idx)));
        open.min().map(|((_, pass), idx)| (idx, pass))
    }

    /// Whether all of it was posted.
    pub fn is_done(&self) -> bool {
        self.next().is_none() && self.has_posted()
    }

    /// Whether nothing is shown yet of the lamps that were ordered last, and there is something to do for that; where they took too long, what
    /// was posted is all that there will be.
    pub fn owes_picture(&self) -> bool {
        let puts_out = self.posted.as_ref().is_some_and(|posted| posted.puts_out);
        let is_shown = self.has_posted() && (!puts_out || self.begun.elapsed() >= MOST_WAIT);
        !is_shown && self.next().is_some()
    }

    /// Whether something was posted of the lamps that were ordered last.
    fn has_posted(&self) -> bool {
        self.posted.as_ref().is_some_and(|posted| posted.serial == self.serial)
    }

    /// One more pass of what lacks most.
    pub fn step(&mut self, interrupts: &(dyn Fn(&Arc<LampView>, Work) -> bool + Sync)) {
        let Some((idx, pass)) = self.next() else { return };
        let work = if self.lamps[idx].is_whole(self.shows_arriving) { Work::Refines } else { Work::Shows };
        let view = self.view.clone();
        let stop = || interrupts(&view, work);
        match pass {
            Pass::Seen => self.see(idx, &view, &stop),
            Pass::Arriving => self.measure(idx, &view, &stop),
        };
    }

    /// One more pass of what is seen of a lamp's light; `None` when `stop` asked to.
    fn see(&mut self, idx: usize, view: &LampView, stop: &(dyn Fn() -> bool + Sync)) -> Option<()> {
        let (sample, round) = self.sample_of(self.lamps[idx].n_passes);
        self.look(sample, view, stop)?;
        let lamp = self.lamps[idx].prepared.clone();
        let unlit = view.patches.as_ref().filter(|_| self.lamps[idx].of_patches.is_none());
        // The processor need not wait for a device.
        let on_patches = |patches| lamp.light_on_patches(&view.scene, patches, view.bounces);
        let (pass, further) = rayon::join(
            || self.direct(&lamp, (sample, round), view, stop),
            || unlit.map(|patches| (on_patches(patches), lamp.lacking(&view.scene))),
        );
        let lit = &mut self.lamps[idx];
        if let Some((of_patches, lacking)) = further {
            lit.of_patches = Some(Arc::new(of_patches));
            lit.lacking = lacking.first().map(|(_, lacking)| *lacking);
        }
        add_pass(&mut lit.sum, pass?);
        lit.n_passes += 1;
        Some(())
    }

    /// Direct light of a lamp in a sample: by the device where it keeps that sample, else by the CPU; `None` when `stop` asked to.
    fn direct(
        &mut self,
        lamp: &PreparedLamps,
        (sample, round): (usize, u32),
        view: &LampView,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<Vec<[f32; 3]>> {
        if let (Some(device), Some(points)) = (&mut self.device, self.points.get(sample)) {
            match device.direct((sample, points), lamp, round, stop) {
                Ok(Some(light)) => return Some(light),
                Ok(None) if stop() => return None,
                Ok(None) => {}
                Err(error) => (self.device, self.device_problem) = (None, Some(on_cpu(&error))),
            }
        }
        let spare = self.spare.as_ref().filter(|(nth, _)| *nth == sample).map(|(_, points)| points);
        self.points.get(sample).or(spare)?.direct(&view.scene, lamp, round, stop)
    }

    /// Which sample of the pixels a pass takes, and in which round: first each that there is, then those that are kept. Where these are
    /// less than a quarter, all take turns: edges would mostly be those of the few.
    fn sample_of(&self, pass: u32) -> (usize, u32) {
        let (kept, all) = (self.n_samples as u32, self.most_samples.max(self.n_samples as u32));
        let taken = if pass < all || 4 * kept < all { all } else { kept };
        ((pass % taken) as usize, pass / taken)
    }

    /// Looks at what the pixels see in a sample, if that is not known; `None` when `stop` asked to.
    fn look(&mut self, sample: usize, view: &LampView, stop: &(dyn Fn() -> bool + Sync)) -> Option<()> {
        let is_spare = self.spare.as_ref().is_some_and(|(nth, _)| *nth == sample);
        if sample < self.points.len() || is_spare {
            return Some(());
        }
        let narrow_alpha = view.patches.as_ref().map_or(0.0, Patches::narrow_alpha);
        let (first, bounces) = (sample as u32, view.bounces);
        let config = VisibleConfig { samples: 1, first, narrow_alpha, bounces, ..VisibleConfig::default() };
        self.spare = None;
        let points = VisiblePoints::new(&view.scene, &view.camera, view.film, config, stop)?;
        if sample == self.points.len() && sample < self.n_samples {
            self.points.push(points);
        } else {
            self.spare = Some((sample, points));
        }
        if sample == 0 {
            self.keep_within(MOST_BYTES);
        }
        Some(())
    }

    /// Takes as many samples as fit, now that the first tells what they take: mirrors and narrow lobes show more than one point.
    fn keep_within(&mut self, most_bytes: usize) {
        let Some(points) = self.points.first() else { return };
        self.n_samples =
            samples_within(most_bytes, points.n_bytes() + arriving::POINT_BYTES * self.view.film.n_pixels());
        let most: Vec<_> = self.lamps.iter().map(|lit| self.most_passes(&lit.lamp)).collect();
        for (lit, most) in self.lamps.iter_mut().zip(most) {
            (lit.most_passes, lit.most_arriving) = most;
        }
    }

    /// One more pass of what arrives of a lamp's light; `None` when `stop` asked to.
    fn measure(&mut self, idx: usize, view: &LampView, stop: &(dyn Fn() -> bool + Sync)) -> Option<()> {
        let lit = &mut self.lamps[idx];
        let sample = lit.n_arriving;
        if sample as usize >= self.arriving.len() {
            self.arriving.push(ArrivingPoints::new(&view.scene, &view.camera, view.film, sample, stop)?);
        }
        let points = &self.arriving[sample as usize];
        add_pass(&mut lit.arriving, points.irradiance(&view.scene, &lit.prepared, view.bounces, stop)?);
        lit.n_arriving += 1;
        Some(())
    }

    /// The light as far as it is, where it is time to show it.
    pub fn news(&mut self) -> Option<LampLight> {
        let (there, missing): (Vec<&Lit>, Vec<&Lit>) =
            self.lamps.iter().partition(|lit| lit.is_whole(self.shows_arriving));
        let n_passes = self.lamps.iter().map(|lit| lit.n_passes + lit.n_arriving).sum();
        let puts_out = missing.iter().any(|lit| self.lit.contains(&lit.lamp.key));
        let now = Posted { serial: self.serial, n_passes, is_whole: missing.is_empty(), puts_out, at: Instant::now() };
        let is_late = !there.is_empty() && now.at.saturating_duration_since(self.waits_since) >= self.patience;
        if !(now.is_whole || is_late) || !self.is_news(&now) {
            return None;
        }
        self.posted = Some(now);
        if !puts_out {
            self.lit = there.iter().map(|lit| lit.lamp.key.clone()).collect();
        }
        let is_measured = self.view.measures && there.iter().all(|lit| lit.n_arriving > 0);
        let seen = || terms(&there, |lit| (lit.sum.as_slice(), lit.n_passes));
        let arriving = || terms(&there, |lit| (lit.arriving.as_slice(), lit.n_arriving));
        let film = self.view.film;
        Some(LampLight {
            direct: summed(&mut self.seen_sums, film, &seen()),
            arriving: is_measured.then(|| summed(&mut self.arriving_sums, film, &arriving())),
            of_patches: Arc::new(of_patches(&self.view, &there)),
            parts: there.iter().map(|lit| lit.part()).collect(),
            left_out: missing.iter().map(|lit| lit.lamp.clone()).collect(),
            serial: self.serial,
            is_done: self.next().is_none(),
            problems: self.problems(),
            remarks: self.remarks(),
            lacking: there.iter().filter_map(|lit| Some((lit.lamp.key.clone(), lit.lacking?))).collect(),
        })
    }

    /// Whether light is to be posted after what was: all of it that was asked for, or what is better, now and then.
    fn is_news(&self, now: &Posted) -> bool {
        let Some(before) = self.posted.as_ref().filter(|before| before.serial == now.serial) else { return true };
        let is_complete = self.next().is_none() || (now.is_whole && !before.is_whole);
        now.n_passes > before.n_passes && (is_complete || before.at.elapsed() > POST_EVERY)
    }
}

/// The light of lamps as a sum takes it: the mean of some passes of each in its color.
fn terms<'a>(lamps: &[&'a Lit], of: impl Fn(&'a Lit) -> (&'a [[f32; 3]], u32)) -> Vec<Term<'a>> {
    let term = |&lit: &&'a Lit| {
        let (light, n_passes) = of(lit);
        Term { of: (lit.id, n_passes), weight: (weight(&lit.lamp) / n_passes as f32).to_array(), light }
    };
    lamps.iter().map(term).collect()
}

/// Their sum as a picture.
fn summed(sums: &mut Sums, film: Film, terms: &[Term<'_>]) -> Arc<Radiance> {
    let Film { width, height } = film;
    Arc::new(Radiance { width, height, pixels: sums.of(terms, film.n_pixels()) })
}

/// What lamps bring to the columns of patches.
fn of_patches(view: &LampView, lamps: &[&Lit]) -> Vec<[f32; 3]> {
    let n_columns = view.patches.as_ref().map_or(0, Patches::n_columns);
    let mut sum = vec![[0.0; 3]; n_columns];
    for lit in lamps {
        let weight = weight(&lit.lamp).to_array();
        for (sum, light) in sum.iter_mut().zip(lit.of_patches.iter().flat_map(|of_patches| of_patches.iter())) {
            (0..3).for_each(|c| sum[c] += weight[c] * light[c]);
        }
    }
    sum
}

/// What a lamp's setting makes of its white light.
fn weight(lamp: &FreeLamp) -> Vec3 {
    lamp.setting.emission(Vec3::ONE, 1.0)
}

#[cfg(test)]
mod tests;
