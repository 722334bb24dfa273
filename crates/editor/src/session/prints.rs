//! Pictures of looks that are not the present one, made off the window's thread: thumbnails, and what is compared with.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::Result;
use clerestory_transport::light::LightRig;
use eframe::egui::ColorImage;

use super::Wake;
use super::lamps::LampLight;
use crate::crash;
use crate::legend::Legend;
use crate::look::{Look, Units};
use crate::picture::color_image;
use crate::stills::{Size, Stills, Subject};
use crate::words::in_words;

/// What a print is for. What is looked at comes before what stands below it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Slot {
    /// A side of a comparison, 0 or 1.
    Side(usize),
    /// The thumbnail of the snapshot of that name.
    Thumbnail(String),
}

/// A picture that is wanted.
pub struct PrintOrder {
    /// Of what.
    pub subject: Arc<Subject>,
    /// Under which light.
    pub look: Look,
    /// How large.
    pub size: Size,
}

/// A picture that is there.
pub struct Print {
    /// What it is for.
    pub slot: Slot,
    /// Display-encoded, and of a side of a comparison what it shows; or why there is none.
    pub printed: Result<(ColorImage, Option<Lit>), String>,
}

/// What a picture shows.
pub struct Lit {
    /// All lights.
    pub rig: LightRig,
    /// The light of the free lamps among them, if any shine.
    pub lamps: Option<LampLight>,
    /// What its colors mean, where they are false.
    pub legend: Option<Legend>,
}

#[derive(Default)]
struct Mail {
    /// The newest order of each slot.
    orders: BTreeMap<Slot, PrintOrder>,
    /// Whether one is being worked on.
    busy: bool,
    prints: Vec<Print>,
}

#[derive(Default)]
struct Mailbox {
    mail: Mutex<Mail>,
    posted: Condvar,
    closed: AtomicBool,
}

impl Mailbox {
    fn lock(&self) -> std::sync::MutexGuard<'_, Mail> {
        // Mail is replaced as a whole, so it is sound even after a panic elsewhere.
        self.mail.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The next order if there is one.
    fn next(&self) -> Option<(Slot, PrintOrder)> {
        let mut mail = self.lock();
        let order = mail.orders.pop_first();
        mail.busy = order.is_some();
        order
    }

    /// Waits for an order; false if nobody wants any more.
    fn wait(&self) -> bool {
        let mut mail = self.lock();
        while mail.orders.is_empty() && !self.closed.load(Ordering::Relaxed) {
            mail = self.posted.wait(mail).unwrap_or_else(PoisonError::into_inner);
        }
        !self.closed.load(Ordering::Relaxed)
    }
}

/// The printer; it ends when this is dropped.
pub struct Printer {
    mailbox: Arc<Mailbox>,
    thread: Option<JoinHandle<()>>,
}

impl Printer {
    /// Starts the thread.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn start(wake: Wake) -> std::io::Result<Printer> {
        let mailbox = Arc::<Mailbox>::default();
        let own = mailbox.clone();
        let thread = std::thread::Builder::new().name("prints".into()).spawn(move || work(&own, &wake))?;
        Ok(Printer { mailbox, thread: Some(thread) })
    }

    /// Leaves an order; an older one for the same slot is forgotten.
    pub fn order(&self, slot: Slot, order: PrintOrder) {
        self.mailbox.lock().orders.insert(slot, order);
        self.mailbox.posted.notify_one();
    }

    /// What was made since the last call.
    pub fn take(&self) -> Vec<Print> {
        std::mem::take(&mut self.mailbox.lock().prints)
    }

    /// Whether nothing is being made and everything was taken.
    pub fn is_idle(&self) -> bool {
        let mail = self.mailbox.lock();
        mail.orders.is_empty() && !mail.busy && mail.prints.is_empty()
    }
}

impl Drop for Printer {
    fn drop(&mut self) {
        self.mailbox.closed.store(true, Ordering::Relaxed);
        // Behind the lock, so that nobody is between looking and waiting.
        drop(self.mailbox.lock());
        self.mailbox.posted.notify_one();
        if let Some(thread) = self.thread.take() {
            // A worker that panicked has said so on its own; there is nothing left to do here.
            let _ = thread.join();
        }
    }
}

fn work(mailbox: &Mailbox, wake: &Wake) {
    while mailbox.wait() {
        // Factors in the order in which they are read take memory, so they are dropped when there is nothing to do.
        let mut stills: Option<(Arc<Subject>, Stills)> = None;
        while let Some((slot, order)) = mailbox.next() {
            let kept = stills.take().filter(|(subject, _)| Arc::ptr_eq(subject, &order.subject));
            let (_, own) = stills
                .insert(kept.unwrap_or_else(|| (order.subject.clone(), Stills::new(order.subject.clone(), None))));
            let stop = || mailbox.closed.load(Ordering::Relaxed);
            let printed = crash::guarded(|| print(own, (&slot, &order), &stop).map_err(|error| in_words(&error)));
            let printed = match printed.flatten() {
                Ok(None) => return,
                Ok(Some(printed)) => Ok(printed),
                Err(words) => {
                    // What failed half way is not used again.
                    stills = None;
                    Err(words)
                }
            };
            mailbox.lock().prints.push(Print { slot, printed });
            wake(Duration::ZERO);
        }
    }
}

/// A picture and what it shows; none if it was stopped.
fn print(
    stills: &mut Stills,
    (slot, order): (&Slot, &PrintOrder),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Option<(ColorImage, Option<Lit>)>> {
    let look = &order.look;
    let (arriving, display) = stills.arriving(look, order.size, stop)?;
    let picture = match arriving {
        Some(arriving) => arriving,
        None => match stills.picture(look, order.size, stop)? {
            Some(picture) => picture,
            None => return Ok(None),
        },
    };
    let shown = display.metered(&picture);
    let image = color_image(&picture, &shown);
    if matches!(slot, Slot::Thumbnail(_)) {
        return Ok(Some((image, None)));
    }
    let lamps = stills.lamp_light(look, order.size, stop);
    let legend = Legend::of(&display, &shown, Units::of(&order.subject.bake.header.basis));
    Ok(lamps.map(|lamps| (image, Some(Lit { rig: look.lights.clone(), lamps, legend }))))
}
