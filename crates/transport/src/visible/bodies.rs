//! Bodies of lamps where pixels see them: straight on, in mirrors and through glass.

use glam::{Vec2, Vec3};

use super::{Band, TILE, VisiblePoints, sampler_of};
use crate::camera::{Camera, Film};
use crate::lamps::{Body, PreparedLamps};

/// Pixels that may show a body: from the first to before the last, across and down.
pub(super) struct BodyView {
    from: [u32; 2],
    to: [u32; 2],
}

/// Where each lamp may be seen; nowhere where it has no body.
pub(super) fn views(lamps: &PreparedLamps, camera: &Camera, film: Film) -> Vec<BodyView> {
    let nowhere = || BodyView { from: [0; 2], to: [0; 2] };
    lamps.lamps().iter().map(|lamp| lamp.lamp.body().map_or_else(nowhere, |body| view(body, camera, film))).collect()
}

fn view(body: &Body, camera: &Camera, film: Film) -> BodyView {
    let (center, radius) = body.ball();
    let everywhere = BodyView { from: [0; 2], to: [film.width, film.height] };
    let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
    for corner in 0..8u32 {
        let side = |bit: u32| if corner >> bit & 1 == 1 { radius } else { -radius };
        let Some(at) = camera.project(film, center + Vec3::new(side(0), side(1), side(2))) else { return everywhere };
        (low, high) = (low.min(at), high.max(at));
    }
    let within = |at: f32, most: u32| at.clamp(0.0, most as f32) as u32;
    let from = [within(low.x - 1.0, film.width), within(low.y - 1.0, film.height)];
    BodyView { from, to: [within(high.x + 2.0, film.width), within(high.y + 2.0, film.height)] }
}

impl VisiblePoints {
    /// Adds the bodies that a band sees.
    pub(super) fn show_bodies(
        &self,
        lamps: &PreparedLamps,
        views: &[BodyView],
        (nth, sample): (u32, u32),
        band: &Band,
        pixels: &mut [Vec3],
    ) {
        let (top, width) = (nth * TILE, self.film.width);
        let bottom = top + pixels.len() as u32 / width;
        let origin = self.camera.position();
        for (lamp, view) in lamps.lamps().iter().zip(views) {
            let Some(body) = lamp.lamp.body() else { continue };
            for y in view.from[1].max(top)..view.to[1].min(bottom) {
                for x in view.from[0]..view.to[0] {
                    let jitter = Vec2::from(sampler_of(self.config.seed, y * width + x, sample).next_2d());
                    let direction = self.camera.direction(self.film, Vec2::new(x as f32, y as f32) + jitter);
                    let at = ((y - top) * width + x) as usize;
                    if body.meet(origin, direction, band.reach[at]).is_some() {
                        pixels[at] += lamp.emission;
                    }
                }
            }
            for segment in &band.found.segments {
                let trail = &segment.trail;
                if let Some((t, _)) = body.meet(trail.origin, trail.direction, segment.reach) {
                    let passed = trail.throughput * (-trail.extinction * t).exp();
                    pixels[(segment.pixel - top * width) as usize] += lamp.emission * passed;
                }
            }
        }
    }
}
