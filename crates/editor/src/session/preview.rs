//! What a camera would see, drawn in the background while it is moved: surfaces without their light, coarse at once, then fine.

use std::sync::Arc;

use clerestory_relight::display::srgb_from_linear;
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::draft::draft;
use clerestory_transport::prepared::PreparedScene;
use eframe::egui::{Color32, ColorImage};

use super::Wake;
use super::mailbox::{Clerk, Idle, Mailbox};
use crate::crash;

/// What to draw.
#[derive(Clone)]
pub struct PreviewOrder {
    /// The scene.
    pub scene: Arc<PreparedScene>,
    /// Where it is seen from.
    pub camera: Camera,
    /// Shape of the picture; a preview has fewer pixels.
    pub film: Film,
}

/// What a camera would see.
pub struct Preview {
    /// Display-encoded pixels.
    pub image: ColorImage,
    /// Of which camera.
    pub camera: Camera,
    /// Whether it gets no finer.
    pub is_done: bool,
}

/// Longest side of a preview, coarse and fine, pixels.
const SIDES: [u32; 2] = [160, 640];

/// Draws previews; the thread ends when this is dropped. What is being drawn for an older order is given up once it was
/// shown coarsely.
pub type Previewer = Clerk<PreviewOrder, Preview>;

/// Starts the thread.
///
/// # Errors
/// If the system gives no thread.
pub fn start(wake: Wake) -> std::io::Result<Previewer> {
    Clerk::start("preview", wake, work)
}

fn work(mailbox: &Mailbox<PreviewOrder, Preview>) {
    while let Some(order) = mailbox.next(Idle::Sleep) {
        let Some(order) = order else { continue };
        for (nth, side) in SIDES.into_iter().enumerate() {
            let film = within(order.film, side);
            let is_done = nth + 1 == SIDES.len();
            // The coarse one is always shown: a camera that keeps moving must be seen.
            let stop = || is_done && mailbox.is_stale();
            // One that fails leaves a report; the picture before it stays.
            let drawn = crash::guarded(|| draft(&order.scene, &order.camera, film, &stop));
            let Ok(Some(pixels)) = drawn else { break };
            let size = [film.width as usize, film.height as usize];
            let image = ColorImage::new(size, pixels.into_iter().map(encoded).collect());
            mailbox.answer(Preview { image, camera: order.camera.clone(), is_done });
            if mailbox.is_stale() {
                break;
            }
        }
    }
}

/// A film of the same shape whose sides are no longer than so many pixels.
pub(super) fn within(film: Film, side: u32) -> Film {
    let scale = (side as f32 / film.width.max(film.height) as f32).min(1.0);
    let scaled = |side: u32| ((side as f32 * scale).round() as u32).max(1);
    Film { width: scaled(film.width), height: scaled(film.height) }
}

fn encoded(rgb: [f32; 3]) -> Color32 {
    let [r, g, b] = rgb.map(|linear| (255.0 * srgb_from_linear(linear)).round() as u8);
    Color32::from_rgb(r, g, b)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::support::prepared_room;

    #[test]
    fn a_preview_comes_coarse_and_then_fine_in_the_shape_of_the_film() {
        let scene = Arc::new(prepared_room());
        let camera = scene.scene.cameras[0].clone();
        let worker = start(Arc::new(|_| {})).unwrap();
        let film = Film { width: 1600, height: 800 };
        worker.order(PreviewOrder { scene, camera: camera.clone(), film });
        let mut sizes = Vec::new();
        for _ in 0..20_000 {
            if let Some(preview) = worker.take() {
                assert_eq!(preview.camera, camera);
                sizes.push(preview.image.size);
                if preview.is_done {
                    break;
                }
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(sizes.last(), Some(&[640, 320]), "{sizes:?}");
        assert_eq!(within(Film { width: 64, height: 48 }, 160), Film { width: 64, height: 48 });
    }
}
