//! The sky behind the picture, off the window's thread: each pixel that sees it, as the map shows it there.

use std::sync::Arc;

use clerestory_transport::sky::Backdrop;
use glam::Vec3;

use super::Wake;
use super::mailbox::{Clerk, Idle, Mailbox};
use crate::crash;

/// Pixels of a block that see the sky, and how much of each does, 0…1 per channel.
pub type Weights = Vec<(u32, Vec3)>;

/// A sky behind a picture.
pub struct SkyOrder {
    /// The sky.
    pub backdrop: Backdrop,
    /// What of the picture sees it, by block.
    pub weights: Vec<Arc<Weights>>,
    /// Number of the order.
    pub serial: u64,
}

/// What the sky brings to the picture, or in words why it is not known.
pub struct SkySeen {
    /// Pixels with their radiance, nit where the coefficient of the sky's own column is 1.
    pub light: Result<Vec<(u32, Vec3)>, String>,
    /// Number of the order that it answers.
    pub serial: u64,
}

/// The worker; it ends when this is dropped.
pub type SkyWorker = Clerk<SkyOrder, SkySeen>;

/// Starts the thread.
///
/// # Errors
/// If the system gives no thread.
pub fn start(wake: Wake) -> std::io::Result<SkyWorker> {
    Clerk::start("sky", wake, work)
}

fn work(mailbox: &Mailbox<SkyOrder, SkySeen>) {
    while let Some(order) = mailbox.next(Idle::Sleep) {
        let Some(SkyOrder { backdrop, weights, serial }) = order else { continue };
        let lit = || weights.iter().flat_map(|weights| backdrop.light(weights)).collect();
        let light = crash::guarded(lit).map_err(|words| format!("the sky behind the picture failed: {words}"));
        mailbox.answer(SkySeen { light, serial });
    }
}
