//! The light of free lamps, off the window's thread: complete at once, or where there are too many for that as they come, finer while
//! the lamps stand still, nothing when done.
//!
//! Light is linear, and so every lamp is traced white and kept for itself: a lamp that moves leaves the others alone, and
//! color and intensity only weigh what is there. A pass of a lamp that has moved on is given up at once.

mod bench;
mod device;
mod sums;

use std::sync::Arc;
use std::time::Duration;

use clerestory_relight::{Gpu, Radiance};
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::lamps::{FreeLamp, Lacking};
use clerestory_transport::patches::Patches;
use clerestory_transport::prepared::PreparedScene;
use glam::Vec3;

use self::bench::Bench;
pub use self::bench::StillLamps;
pub use self::device::on_device;

use super::Wake;
use super::mailbox::{Clerk, Idle, Mailbox};
use super::room::left_of_system;
use crate::crash;
use crate::illuminance::AddedLux;

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
    /// Whether the light that arrives is measured: the bake holds that of the other lights.
    pub measures: bool,
    /// Most bounces of light of the bake; `None` for no limit.
    pub bounces: Option<u32>,
    /// The device that lights what is seen, if one is to; the CPU otherwise.
    pub device: Option<Gpu>,
}

/// Lamps in a view.
#[derive(Clone)]
pub struct LampOrder {
    /// The view.
    pub view: Arc<LampView>,
    /// Lamps that shine.
    pub lamps: Vec<FreeLamp>,
    /// Whether the picture shows the light that arrives, which must not lag behind then.
    pub shows_arriving: bool,
    /// Number of the order.
    pub serial: u64,
}

/// The light of lamps in a picture.
#[derive(Clone)]
pub struct LampLight {
    /// Their direct light, nit; the size is that of the view's film.
    pub direct: Arc<Radiance>,
    /// What of it arrives at the surfaces seen, lux; where the view measures it, and once it is there for all that are not left out.
    pub arriving: Option<Arc<Radiance>>,
    /// Coefficients of the columns of patches: what their light becomes on its further way; empty without patches.
    pub of_patches: Arc<Vec<[f32; 3]>>,
    /// The same of each lamp for itself.
    pub parts: Vec<LampPart>,
    /// Lamps whose light is not there yet, nor part of any of this; the others took long, and are shown without them.
    pub left_out: Vec<FreeLamp>,
    /// Number of the order that it answers.
    pub serial: u64,
    /// Whether it does not get any smoother.
    pub is_done: bool,
    /// A sentence for each lamp that cannot shine.
    pub problems: Vec<String>,
    /// What else there is to know of lamps that shine, in sentences.
    pub remarks: Vec<String>,
    /// Names of lamps of whose light more than a little is missing, and what; where there are patches.
    pub lacking: Vec<(String, Lacking)>,
}

/// The light of one lamp in a picture.
#[derive(Clone)]
pub struct LampPart {
    /// Name of the lamp.
    pub key: String,
    /// What of `light`, `arriving` and `of_patches` it brings.
    weights: [Vec3; 3],
    /// Its light when it is white, summed over passes.
    light: Arc<Vec<[f32; 3]>>,
    /// The same where it arrives; empty where that is not measured.
    arriving: Arc<Vec<[f32; 3]>>,
    of_patches: Arc<Vec<[f32; 3]>>,
}

impl LampPart {
    /// Its direct light at a pixel, nit; pixels are numbered row by row.
    pub fn direct(&self, pixel: u32) -> Vec3 {
        self.light.get(pixel as usize).map_or(Vec3::ZERO, |light| self.weights[0] * Vec3::from(*light))
    }

    /// Whether it is known what arrives of it.
    pub fn is_measured(&self) -> bool {
        !self.arriving.is_empty()
    }

    /// What arrives of it straight at what a pixel sees, lux; dark where that is not measured.
    pub fn arriving(&self, pixel: u32) -> Vec3 {
        self.arriving.get(pixel as usize).map_or(Vec3::ZERO, |light| self.weights[1] * Vec3::from(*light))
    }

    /// Its coefficients of the columns of patches; empty without patches.
    pub fn of_patches(&self) -> impl Iterator<Item = Vec3> {
        self.of_patches.iter().map(|light| self.weights[2] * Vec3::from(*light))
    }
}

impl LampLight {
    /// What it adds to the light that arrives at the pixels.
    pub fn added_lux(&self) -> AddedLux {
        AddedLux { of_patches: self.of_patches.to_vec(), straight: self.arriving.clone(), lamps: None }
    }

    /// Forgets what its lamps bring to patches: those that are shown from now on are others.
    pub fn forget_patches(&mut self) {
        self.of_patches = Arc::default();
        self.parts.iter_mut().for_each(|part| part.of_patches = Arc::default());
    }

    /// What is said of figures that lack lamps whose light is not there yet.
    pub fn missing_words(&self) -> Option<String> {
        match self.left_out.len() {
            0 => None,
            1 => Some("the light of a lamp is not there yet".into()),
            n => Some(format!("the light of {n} lamps is not there yet")),
        }
    }

    /// No light, and why.
    fn failed(film: Film, serial: u64, problem: String) -> LampLight {
        let direct = Arc::new(Radiance::new(film.width, film.height));
        LampLight {
            direct,
            arriving: None,
            of_patches: Arc::default(),
            parts: Vec::new(),
            left_out: Vec::new(),
            serial,
            is_done: true,
            problems: vec![problem],
            remarks: Vec::new(),
            lacking: Vec::new(),
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

/// The worker; it ends when this is dropped. What is being done for an older order is given up.
pub type LampWorker = Clerk<LampOrder, LampLight>;

/// Time in which a lamp that was shown is expected to move on: all threads are left to the picture of it.
const REST: Duration = Duration::from_millis(100);

type LampMailbox = Mailbox<LampOrder, LampLight>;

/// Starts the thread.
///
/// # Errors
/// If the system gives no thread.
pub fn start(wake: Wake) -> std::io::Result<LampWorker> {
    Clerk::start("lamps", wake, work)
}

/// Whether the work at hand is stale. What makes the first picture of an order is only so in another view: a lamp that
/// keeps moving must be seen.
fn is_interrupted(mailbox: &LampMailbox, view: &Arc<LampView>, work: Work) -> bool {
    let mail = mailbox.lock();
    let is_stale = |order: &LampOrder| work == Work::Refines || !Arc::ptr_eq(&order.view, view);
    mail.closed || mail.order.as_ref().is_some_and(is_stale)
}

/// The next order, if one is to be taken: within a view none is before something of the last one is shown. Where its first picture takes
/// several passes, lamps that keep moving would never be seen. `None` where nobody wants any more.
fn next_order(mailbox: &LampMailbox, bench: Option<&Bench>, idle: Idle) -> Option<Option<LampOrder>> {
    let is_under_way = |bench: &Bench| bench.owes_picture() && !is_interrupted(mailbox, &bench.view, Work::Shows);
    if bench.is_some_and(is_under_way) { Some(None) } else { mailbox.next(idle) }
}

fn work(mailbox: &LampMailbox) {
    let mut bench: Option<Bench> = None;
    let (mut shown, mut rests) = (None, false);
    loop {
        let idle = match &bench {
            Some(bench) if !bench.is_done() && rests => Idle::Rest(REST),
            Some(bench) if !bench.is_done() => Idle::GoOn,
            _ => Idle::Sleep,
        };
        let Some(order) = next_order(mailbox, bench.as_ref(), idle) else { return };
        let asked = order.as_ref().map(|order| (order.view.film, order.serial));
        let asked = asked.or(bench.as_ref().map(|bench| (bench.view.film, bench.serial)));
        let worked = crash::guarded(|| work_on(&mut bench, order, mailbox));
        let news = worked.unwrap_or_else(|words| {
            bench = None;
            asked.map(|(film, serial)| LampLight::failed(film, serial, format!("the light of lamps failed: {words}")))
        });
        rests = news.as_ref().is_some_and(|light| shown.replace(light.serial) != Some(light.serial));
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
        if let Some(free_bytes) = left_of_system() {
            new.stay_within(free_bytes);
        }
    }
    let bench = bench.as_mut()?;
    bench.step(&|view, work| is_interrupted(mailbox, view, work));
    bench.news()
}

#[cfg(test)]
pub(crate) mod tests;
