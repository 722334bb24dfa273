//! Pixels that see nothing: no triangle covers any part of them, so that their rays need not look for one.

use glam::{DVec2, DVec3, Vec3};

use crate::camera::{Camera, Film};
use crate::scene::Mesh;

/// The pixels that no triangle's rectangle on the film covers, or comes close to.
pub(crate) struct EmptyPixels {
    /// Row-major.
    is_covered: Vec<bool>,
    n_empty: u32,
}

/// Pixels that a rectangle is widened by: far more than rounding moves a ray.
const MARGIN: f64 = 0.25;
/// Distance before the camera, over that of a corner, at which triangles are cut off: nearer ones fill the film.
const NEAR: f64 = 1e-7;

impl EmptyPixels {
    /// `None` where every pixel may see something.
    pub(crate) fn find(mesh: &Mesh, camera: &Camera, film: Film) -> Option<EmptyPixels> {
        let mut empty =
            EmptyPixels { is_covered: vec![false; film.n_pixels()], n_empty: u32::try_from(film.n_pixels()).ok()? };
        let view = View::new(camera, film);
        for triangle in 0..mesh.triangles.len() as u32 {
            if let Some([low, high]) = view.rectangle(mesh.corners(triangle)) {
                empty.cover(low - MARGIN, high + MARGIN, film);
                if empty.n_empty == 0 {
                    return None;
                }
            }
        }
        Some(empty)
    }

    /// Whether a pixel sees nothing.
    #[inline]
    pub(crate) fn contains(&self, pixel: usize) -> bool {
        !self.is_covered[pixel]
    }

    /// How many there are.
    pub(crate) fn count(&self) -> u32 {
        self.n_empty
    }

    fn cover(&mut self, low: DVec2, high: DVec2, film: Film) {
        // A float beyond the film becomes its edge.
        let columns = low.x.max(0.0) as usize..(high.x.max(0.0).ceil() as usize).min(film.width as usize);
        let rows = low.y.max(0.0) as usize..(high.y.max(0.0).ceil() as usize).min(film.height as usize);
        if columns.is_empty() {
            return;
        }
        for row in rows {
            let first = row * film.width as usize;
            for pixel in &mut self.is_covered[first + columns.start..first + columns.end] {
                self.n_empty -= u32::from(!*pixel);
                *pixel = true;
            }
        }
    }
}

/// A camera in double precision.
struct View {
    eye: DVec3,
    axes: [DVec3; 3],
    /// Where the axis meets the film, and pixels to a unit at distance 1.
    center: DVec2,
    scale: DVec2,
    /// Size in pixels.
    film: DVec2,
}

impl View {
    fn new(camera: &Camera, film: Film) -> View {
        let half_height = f64::from((0.5 * camera.yfov_rad).tan());
        let half = DVec2::new(f64::from(film.width), f64::from(film.height)) * 0.5;
        let matrix = camera.world_from_camera.as_dmat4();
        let axes = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|axis| axis.truncate());
        let scale = DVec2::new(half.y / half_height, -half.y / half_height);
        let shift = DVec2::new(f64::from(-camera.shift[0]), f64::from(camera.shift[1]));
        let center = half + shift * half * 2.0;
        View { eye: matrix.w_axis.truncate(), axes, center, scale, film: half * 2.0 }
    }

    /// Corners of the smallest rectangle of the film around a triangle; `None` behind the camera.
    fn rectangle(&self, corners: [Vec3; 3]) -> Option<[DVec2; 2]> {
        let seen = corners.map(|corner| {
            let from_eye = corner.as_dvec3() - self.eye;
            DVec3::from(self.axes.map(|axis| axis.dot(from_eye)))
        });
        let near = NEAR * seen.iter().map(|p| p.length()).fold(f64::MIN_POSITIVE, f64::max);
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let mut reach = |p: DVec3| {
            let at = self.center + DVec2::new(p.x, p.y) / -p.z * self.scale;
            (low, high) = (low.min(at), high.max(at));
        };
        for (nth, &from) in seen.iter().enumerate() {
            let to = seen[(nth + 1) % 3];
            if from.z <= -near {
                reach(from);
            }
            if (from.z <= -near) != (to.z <= -near) {
                let cut = from.lerp(to, (-near - from.z) / (to.z - from.z));
                reach(DVec3::new(cut.x, cut.y, -near));
            }
        }
        // A film whose far side is not finite holds everything.
        let whole = [DVec2::ZERO, self.film];
        (low.x <= high.x).then_some(if low.is_finite() && high.is_finite() { [low, high] } else { whole })
    }
}
