//! Relights on the CPU in the background: newest order wins, newest picture is shown, the window never waits.

use std::sync::Arc;
use std::time::Instant;

use clerestory_relight::{CpuRelighter, DisplayParams, Frame, Precision, Radiance, Relight, RelightError};
use eframe::egui::ColorImage;
use rayon::prelude::*;

use super::Wake;
use super::mailbox::{Clerk, Idle, Mailbox};
use crate::crash;
use crate::look::Display;
use crate::picture::{Changed, Pictures};

/// What is wanted of an order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// The picture.
    Picture,
    /// Only the exposure and the scale that suit it, for a picture that is made elsewhere.
    Metering,
}

/// A frame under some light.
#[derive(Clone, Debug)]
pub struct Order {
    /// The factors.
    pub frame: Arc<Frame>,
    /// What is new in it since the last order.
    pub changed: Changed,
    /// One RGB triple per column and group.
    pub coefficients: Vec<Vec<[f32; 3]>>,
    /// Added to the picture: the direct light of free lamps.
    pub layer: Option<Arc<Radiance>>,
    /// How it is shown.
    pub display: Display,
    /// What for.
    pub wanted: Wanted,
    /// Number of the order.
    pub serial: u64,
}

/// A picture, ready to be drawn.
pub struct Relit {
    /// Display-encoded pixels; none where only the metering was wanted.
    pub image: Option<Arc<ColorImage>>,
    /// How it is shown.
    pub display: DisplayParams,
    /// From order to picture, milliseconds.
    pub millis: f32,
    /// Number of the order that it answers.
    pub serial: u64,
}

/// A picture, or in words why there is none.
type Answer = Result<Relit, String>;

/// The worker; it ends when this is dropped.
pub struct Worker(Clerk<Order, Answer>);

impl Worker {
    /// Starts the thread.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn start(wake: Wake) -> std::io::Result<Worker> {
        Clerk::start("relight", wake, work).map(Worker)
    }

    /// Leaves an order; one that was not begun yet is replaced.
    pub fn order(&self, mut order: Order) {
        self.0.order_after(|older| {
            if let Some(older) = older {
                let mut changed = older.changed;
                changed.absorb(order.changed);
                order.changed = changed;
            }
            order
        });
    }

    /// The newest picture, once, or in words why there is none.
    pub fn take(&self) -> Option<Answer> {
        self.0.take()
    }
}

fn work(mailbox: &Mailbox<Order, Answer>) {
    let mut bench = Bench::default();
    while let Some(order) = mailbox.next(Idle::Sleep) {
        let Some(order) = order else { continue };
        let relit = crash::guarded(|| bench.relight(&order).map_err(|error| error.to_string()));
        let result = relit.unwrap_or_else(|words| Err(format!("relighting failed: {words}")));
        if result.is_err() {
            bench = Bench::default();
        }
        mailbox.answer(result);
    }
}

/// What is kept from one order to the next.
#[derive(Default)]
struct Bench {
    relighter: Option<CpuRelighter>,
    radiance: Radiance,
    pictures: Pictures,
    /// How the last picture was shown.
    shown: DisplayParams,
}

impl Bench {
    fn relight(&mut self, order: &Order) -> Result<Relit, RelightError> {
        let started = Instant::now();
        let (relighter, radiance) = (&mut self.relighter, &mut self.radiance);
        let relighter = match (relighter, &order.changed) {
            (Some(own), Changed::Blocks(blocks)) => {
                own.update(&order.frame, blocks)?;
                own
            }
            (slot, _) => slot.insert(CpuRelighter::with_precision(&order.frame, Precision::ByError)?),
        };
        relighter.set_layer(order.layer.as_ref())?;
        let display = if order.display.follows_every_pixel() {
            relighter.relight(&order.coefficients, radiance)?;
            metered(&order.display, &order.frame, radiance)
        } else {
            // What is not seen is left out. Metering follows the picture that is shown, which moves it by less than a
            // thousandth of a stop; where it asks for more light, more is seen.
            let guess = order.display.as_metered(&self.shown);
            relighter.relight_for_display(&order.coefficients, &guess, radiance)?;
            let display = metered(&order.display, &order.frame, radiance);
            if display.unseen() < guess.unseen() {
                relighter.relight_for_display(&order.coefficients, &display, radiance)?;
            }
            display
        };
        self.shown = display;
        let image = (order.wanted == Wanted::Picture).then(|| self.pictures.next(radiance, &display));
        let millis = 1e3 * started.elapsed().as_secs_f32();
        Ok(Relit { image, display, millis, serial: order.serial })
    }
}

/// What suits what is there of a picture: blocks that are not baked yet do not count as black.
fn metered(display: &Display, frame: &Frame, radiance: &Radiance) -> DisplayParams {
    let partition = frame.partition();
    let present: Vec<usize> = (0..partition.n_blocks()).filter(|&b| frame.block(0, b).is_some()).collect();
    if !display.meters() || present.len() == partition.n_blocks() {
        return display.metered(radiance);
    }
    let pixels_of = |block: usize| {
        let mut bundles = Vec::new();
        partition.bundles(block, &mut bundles);
        bundles.into_iter().map(|pixel| radiance.pixels[pixel as usize])
    };
    let pixels: Vec<[f32; 3]> = present.into_par_iter().flat_map_iter(pixels_of).collect();
    display.metered(&Radiance { width: pixels.len() as u32, height: 1, pixels })
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use clerestory_relight::synthetic::{Ranks, Recipe};

    use super::*;

    fn wait_for(worker: &Worker) -> Relit {
        for _ in 0..2000 {
            if let Some(result) = worker.take() {
                return result.unwrap();
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        panic!("no picture came");
    }

    #[test]
    fn twice_the_light_is_one_stop_less_exposure() {
        let frame = Arc::new(Recipe { rank: Ranks::Fixed(6), ..Recipe::default() }.frame());
        let worker = Worker::start(Arc::new(|_| {})).unwrap();
        let coefficients = |value: f32| -> Vec<Vec<[f32; 3]>> {
            frame.groups.iter().map(|g| vec![[value; 3]; g.n_cols as usize]).collect()
        };
        let mut order = Order {
            frame: frame.clone(),
            changed: Changed::All,
            coefficients: coefficients(1.0),
            layer: None,
            display: Display::default(),
            wanted: Wanted::Picture,
            serial: 1,
        };
        worker.order(order.clone());
        let dim = wait_for(&worker);
        assert_eq!(dim.image.unwrap().size, [frame.width as usize, frame.height as usize]);
        (order.coefficients, order.changed, order.wanted) = (coefficients(2.0), Changed::default(), Wanted::Metering);
        worker.order(order);
        let bright = wait_for(&worker);
        assert!(bright.image.is_none());
        assert!(
            (dim.display.exposure_ev - bright.display.exposure_ev - 1.0).abs() < 1e-3,
            "{} {}",
            dim.display.exposure_ev,
            bright.display.exposure_ev
        );
    }
}
