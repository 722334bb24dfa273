//! The light of free lamps, off the window's thread: complete at once, finer while the lamps stand still, nothing when done.
//!
//! Light is linear, and so every lamp is traced white and kept for itself: a lamp that moves leaves the others alone, and
//! color and intensity only weigh what is there. A pass of a lamp that has moved on is given up at once.

use std::sync::Arc;
use std::time::{Duration, Instant};

use clerestory_relight::Radiance;
use clerestory_transport::bake::BakeHeader;
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::lamps::{FreeLamp, PreparedLamps};
use clerestory_transport::light::LightSetting;
use clerestory_transport::patches::{PatchSample, Patches};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::visible::{VisibleConfig, VisiblePoints};
use glam::Vec3;
use rayon::prelude::*;

use super::Wake;
use super::mailbox::{Clerk, Idle, Mailbox};
use crate::crash;

/// Passes after which a soft shadow is as smooth as it gets.
const SOFT_PASSES: u32 = 64;
/// Samples of a pixel for smooth edges: as many as fit into so much memory.
const SAMPLES: std::ops::RangeInclusive<usize> = 2..=8;
const POINT_BYTES: usize = 64;
const MOST_BYTES: usize = 256 << 20;
/// Time between two pictures while nothing moves.
const POST_EVERY: Duration = Duration::from_millis(250);

/// What is looked at, and from where. Two views are the same if they are one and the same `Arc`.
#[derive(Clone)]
pub struct LampView {
    /// The scene of the picture.
    pub scene: Arc<PreparedScene>,
    /// Where it is seen from.
    pub camera: Camera,
    /// Size of the picture.
    pub film: Film,
    /// What their light throws on these surfaces lights the room, where it was baked.
    pub patches: Option<Patches>,
}

/// Lamps in a view.
#[derive(Clone)]
pub struct LampOrder {
    /// The view.
    pub view: Arc<LampView>,
    /// Lamps that shine.
    pub lamps: Vec<FreeLamp>,
    /// Number of the order.
    pub serial: u64,
}

/// The light of lamps in a picture.
#[derive(Clone)]
pub struct LampLight {
    /// Their direct light, nit; the size is that of the view's film.
    pub direct: Arc<Radiance>,
    /// Coefficients of the columns of patches: what their light becomes on its further way; empty without patches.
    pub of_patches: Arc<Vec<[f32; 3]>>,
    /// The same of each lamp for itself.
    pub parts: Vec<LampPart>,
    /// Number of the order that it answers.
    pub serial: u64,
    /// Whether it does not get any smoother.
    pub is_done: bool,
    /// A sentence for each lamp that cannot shine.
    pub problems: Vec<String>,
}

/// The light of one lamp in a picture.
#[derive(Clone)]
pub struct LampPart {
    /// Name of the lamp.
    pub key: String,
    /// What of `light` and `of_patches` it brings.
    weights: [Vec3; 2],
    /// Its light when it is white, summed over passes.
    light: Arc<Vec<[f32; 3]>>,
    of_patches: Arc<Vec<[f32; 3]>>,
}

impl LampPart {
    /// Its direct light at a pixel, nit; pixels are numbered row by row.
    pub fn direct(&self, pixel: u32) -> Vec3 {
        self.light.get(pixel as usize).map_or(Vec3::ZERO, |light| self.weights[0] * Vec3::from(*light))
    }

    /// Its coefficients of the columns of patches; empty without patches.
    pub fn of_patches(&self) -> impl Iterator<Item = Vec3> {
        self.of_patches.iter().map(|light| self.weights[1] * Vec3::from(*light))
    }
}

impl LampLight {
    /// No light, and why.
    fn failed(film: Film, serial: u64, problem: String) -> LampLight {
        let direct = Arc::new(Radiance::new(film.width, film.height));
        LampLight {
            direct,
            of_patches: Arc::default(),
            parts: Vec::new(),
            serial,
            is_done: true,
            problems: vec![problem],
        }
    }

    /// Puts what the lamps throw on the patches of a bake into its coefficients; where it has none, nothing.
    pub fn light_patches(&self, header: &BakeHeader, coefficients: &mut [Vec<[f32; 3]>]) {
        if let (Some(_), Some(of_patches)) = (&header.patches, coefficients.last_mut())
            && self.of_patches.len() == of_patches.len()
        {
            of_patches.clone_from(&self.of_patches);
        }
    }
}

/// What a piece of work is for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Work {
    /// The first picture.
    Shows,
    /// A smoother one.
    Refines,
}

/// The worker; it ends when this is dropped.
pub struct LampWorker(Clerk<LampOrder, LampLight>);

type LampMailbox = Mailbox<LampOrder, LampLight>;

impl LampWorker {
    /// Starts the thread.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn start(wake: Wake) -> std::io::Result<LampWorker> {
        Clerk::start("lamps", wake, work).map(LampWorker)
    }

    /// Leaves an order; what is being done for an older one is given up.
    pub fn order(&self, order: LampOrder) {
        self.0.order(|_| order);
    }

    /// The newest light, once.
    pub fn take(&self) -> Option<LampLight> {
        self.0.take()
    }
}

/// Whether the work at hand is stale. What makes the first picture of an order is only so in another view: a lamp that
/// keeps moving must be seen.
fn is_interrupted(mailbox: &LampMailbox, view: &Arc<LampView>, work: Work) -> bool {
    let mail = mailbox.lock();
    let is_stale = |order: &LampOrder| work == Work::Refines || !Arc::ptr_eq(&order.view, view);
    mail.closed || mail.order.as_ref().is_some_and(is_stale)
}

fn work(mailbox: &LampMailbox) {
    let mut bench: Option<Bench> = None;
    loop {
        let idle = if bench.as_ref().is_some_and(|bench| !bench.is_done()) { Idle::GoOn } else { Idle::Sleep };
        let Some(order) = mailbox.next(idle) else { return };
        let asked = order.as_ref().map(|order| (order.view.film, order.serial));
        let asked = asked.or(bench.as_ref().map(|bench| (bench.view.film, bench.serial)));
        let worked = crash::guarded(|| work_on(&mut bench, order, mailbox));
        let news = worked.unwrap_or_else(|words| {
            bench = None;
            asked.map(|(film, serial)| LampLight::failed(film, serial, format!("the light of lamps failed: {words}")))
        });
        if let Some(light) = news {
            mailbox.answer(light);
        }
    }
}

/// Takes an order up and does a piece of the work; answers what is new.
fn work_on(bench: &mut Option<Bench>, order: Option<LampOrder>, mailbox: &LampMailbox) -> Option<LampLight> {
    if let Some(order) = order {
        let kept = bench.take().filter(|bench| Arc::ptr_eq(&bench.view, &order.view));
        let new = bench.insert(kept.unwrap_or_else(|| Bench::new(order.view.clone())));
        new.take(order);
    }
    let bench = bench.as_mut()?;
    bench.step(&|view, work| is_interrupted(mailbox, view, work));
    bench.news()
}

/// A view, and how far its lamps are.
struct Bench {
    view: Arc<LampView>,
    /// What the pixels see in each of their samples, as far as it was needed.
    points: Vec<VisiblePoints>,
    n_samples: usize,
    lamps: Vec<Lit>,
    problems: Vec<String>,
    serial: u64,
    /// The light that was posted last: of which order, how far, when.
    posted: Option<(u64, u32, Instant)>,
}

/// A lamp, and what it lights.
struct Lit {
    /// As it shines.
    lamp: FreeLamp,
    /// White and at its full strength.
    prepared: PreparedLamps,
    /// Sum over the passes, nit; empty before the first one.
    sum: Arc<Vec<[f32; 3]>>,
    n_passes: u32,
    /// Passes that it takes.
    most_passes: u32,
    /// What it brings to the columns of patches.
    of_patches: Option<Arc<Vec<[f32; 3]>>>,
}

impl Lit {
    /// Whether another lamp is this one but for color, intensity and name.
    fn is_like(&self, lamp: &FreeLamp) -> bool {
        white(&self.lamp) == FreeLamp { key: self.lamp.key.clone(), ..white(lamp) }
    }

    fn is_done(&self) -> bool {
        self.n_passes >= self.most_passes
    }

    /// Its light as it shines.
    fn part(&self) -> LampPart {
        let weight = weight(&self.lamp);
        LampPart {
            key: self.lamp.key.clone(),
            weights: [weight / self.n_passes as f32, weight],
            light: self.sum.clone(),
            of_patches: self.of_patches.clone().unwrap_or_default(),
        }
    }
}

/// The lamp without what only weighs its light.
fn white(lamp: &FreeLamp) -> FreeLamp {
    FreeLamp { setting: LightSetting::default(), ..lamp.clone() }
}

impl Bench {
    fn new(view: Arc<LampView>) -> Bench {
        let fitting = MOST_BYTES / (POINT_BYTES * view.film.n_pixels()).max(1);
        Bench {
            view,
            points: Vec::new(),
            n_samples: fitting.clamp(*SAMPLES.start(), *SAMPLES.end()),
            lamps: Vec::new(),
            problems: Vec::new(),
            serial: 0,
            posted: None,
        }
    }

    /// Takes over other lamps; what is known of those that stay is kept.
    fn take(&mut self, order: LampOrder) {
        self.serial = order.serial;
        self.problems.clear();
        let mut before = std::mem::take(&mut self.lamps);
        for lamp in order.lamps {
            if let Some(idx) = before.iter().position(|lit| lit.is_like(&lamp)) {
                self.lamps.push(Lit { lamp, ..before.swap_remove(idx) });
                continue;
            }
            match PreparedLamps::new(&[white(&lamp)], None) {
                Ok((prepared, warnings)) => {
                    self.problems.extend(warnings);
                    let most_passes = if lamp.shape.has_surface() { SOFT_PASSES } else { self.n_samples as u32 };
                    let (sum, n_passes, of_patches) = (Arc::default(), 0, None);
                    self.lamps.push(Lit { lamp, prepared, sum, n_passes, most_passes, of_patches });
                }
                Err(error) => self.problems.push(error.to_string()),
            }
        }
    }

    /// Passes of the lamp that has the fewest, and lacks some; none where all have enough.
    fn next(&self) -> Option<usize> {
        let open = self.lamps.iter().enumerate().filter(|(_, lit)| !lit.is_done());
        open.min_by_key(|(_, lit)| lit.n_passes).map(|(idx, _)| idx)
    }

    /// Whether all of it was posted.
    fn is_done(&self) -> bool {
        self.next().is_none() && self.posted.is_some_and(|(serial, _, _)| serial == self.serial)
    }

    /// One more pass of the lamp that has the fewest.
    fn step(&mut self, interrupts: &(dyn Fn(&Arc<LampView>, Work) -> bool + Sync)) {
        let Some(idx) = self.next() else { return };
        let work = if self.lamps[idx].n_passes == 0 { Work::Shows } else { Work::Refines };
        let (view, lit) = (self.view.clone(), &mut self.lamps[idx]);
        let stop = || interrupts(&view, work);
        let (sample, round) = (lit.n_passes as usize % self.n_samples, lit.n_passes / self.n_samples as u32);
        if sample >= self.points.len() {
            let narrow_alpha = view.patches.as_ref().map_or(0.0, Patches::narrow_alpha);
            let config = VisibleConfig { samples: 1, first: sample as u32, narrow_alpha, ..VisibleConfig::default() };
            let seen = VisiblePoints::new(&view.scene, &view.camera, view.film, config, &stop);
            let Some(seen) = seen else { return };
            self.points.push(seen);
        }
        let Some(pass) = self.points[sample].direct(&view.scene, &lit.prepared, round, &stop) else { return };
        if lit.sum.is_empty() {
            lit.sum = Arc::new(pass);
        } else {
            // What was posted stays as it is: it is copied where somebody still looks at it.
            let sums = Arc::make_mut(&mut lit.sum).as_flattened_mut().par_iter_mut().zip(pass.as_flattened());
            sums.for_each(|(sum, more)| *sum += more);
        }
        if let (None, Some(patches)) = (&lit.of_patches, &view.patches) {
            let irradiance = |at: &PatchSample| lit.prepared.light_on(&view.scene, at);
            lit.of_patches = Some(Arc::new(patches.coefficients(&irradiance)));
        }
        lit.n_passes += 1;
    }

    /// The light as far as it is, where it is time to show it.
    fn news(&mut self) -> Option<LampLight> {
        let n_passes = self.lamps.iter().map(|lit| lit.n_passes).sum();
        let is_whole = self.lamps.iter().all(|lit| lit.n_passes > 0);
        let is_done = self.next().is_none();
        let is_due = match self.posted {
            Some((serial, before, at)) if serial == self.serial => {
                n_passes > before && (is_done || at.elapsed() > POST_EVERY)
            }
            _ => true,
        };
        if !is_whole || !is_due {
            return None;
        }
        self.posted = Some((self.serial, n_passes, Instant::now()));
        Some(LampLight {
            direct: Arc::new(self.direct()),
            of_patches: Arc::new(self.of_patches()),
            parts: self.lamps.iter().map(Lit::part).collect(),
            serial: self.serial,
            is_done,
            problems: self.problems.clone(),
        })
    }

    /// The mean of the passes of each lamp in its color, summed.
    fn direct(&self) -> Radiance {
        let Film { width, height } = self.view.film;
        let mut sum = Radiance::new(width, height);
        for lit in &self.lamps {
            let weight = (weight(&lit.lamp) / lit.n_passes as f32).to_array();
            let pixels = sum.pixels.par_iter_mut().zip(lit.sum.par_iter());
            pixels.for_each(|(sum, light)| (0..3).for_each(|c| sum[c] += weight[c] * light[c]));
        }
        sum
    }

    fn of_patches(&self) -> Vec<[f32; 3]> {
        let n_columns = self.view.patches.as_ref().map_or(0, Patches::n_columns);
        let mut sum = vec![[0.0; 3]; n_columns];
        for lit in &self.lamps {
            let weight = weight(&lit.lamp).to_array();
            for (sum, light) in sum.iter_mut().zip(lit.of_patches.iter().flat_map(|of_patches| of_patches.iter())) {
                (0..3).for_each(|c| sum[c] += weight[c] * light[c]);
            }
        }
        sum
    }
}

/// The light of lamps as smooth as it gets, for pictures that wait for it. Lamps that stay from one look to the next are traced once.
pub struct StillLamps {
    bench: Bench,
}

impl StillLamps {
    /// In a view.
    pub fn new(view: Arc<LampView>) -> StillLamps {
        StillLamps { bench: Bench::new(view) }
    }

    /// The light of some lamps, those that are muted left out; `None` if it was stopped.
    pub fn light(&mut self, lamps: &[FreeLamp], stop: &(dyn Fn() -> bool + Sync)) -> Option<LampLight> {
        let shining = lamps.iter().filter(|lamp| !lamp.setting.muted).cloned().collect();
        let (view, serial) = (self.bench.view.clone(), self.bench.serial + 1);
        self.bench.take(LampOrder { view, lamps: shining, serial });
        while self.bench.next().is_some() {
            if stop() {
                return None;
            }
            self.bench.step(&|_, _| stop());
        }
        self.bench.news()
    }
}

/// What a lamp's setting makes of its white light.
fn weight(lamp: &FreeLamp) -> Vec3 {
    lamp.setting.emission(Vec3::ONE, 1.0)
}

#[cfg(test)]
mod tests;
