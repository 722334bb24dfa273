//! A rectangle sampled by the solid angle that it fills. \[Urena2013\]

use glam::{DVec3, Vec2, Vec3};

/// A rectangle as one place sees it.
pub(super) struct SeenRectangle {
    origin: DVec3,
    /// Unit axes; the third points from the rectangle's plane to the place.
    axes: [DVec3; 3],
    /// Corners in these axes, from the place; `z0` is negative.
    x0: f64,
    x1: f64,
    y0: f64,
    y1: f64,
    z0: f64,
    b0: f64,
    b1: f64,
    k: f64,
    /// Solid angle, sr.
    pub solid_angle: f32,
}

impl SeenRectangle {
    /// `half` leads from the middle to the middles of two sides; `None` where it is seen edge on.
    pub fn new(center: Vec3, half: [Vec3; 2], normal: Vec3, place: Vec3) -> Option<SeenRectangle> {
        let origin = place.as_dvec3();
        let (x_half, y_half) = (half[0].as_dvec3(), half[1].as_dvec3());
        let axes = [x_half.try_normalize()?, y_half.try_normalize()?, normal.as_dvec3()];
        let d = center.as_dvec3() - origin;
        let (x, y, z0) = (d.dot(axes[0]), d.dot(axes[1]), d.dot(axes[2]));
        if z0 >= 0.0 {
            return None;
        }
        let (width, height) = (x_half.length(), y_half.length());
        let (x0, x1, y0, y1) = (x - width, x + width, y - height, y + height);
        // Across the rectangle's plane: the normals of the planes through the place and each side. Neighbors meet at right
        // angles but for that.
        let across = |offset: f64| offset / (z0 * z0 + offset * offset).sqrt();
        let nz = [across(-y0), across(x1), across(y1), across(-x0)];
        let angle = |cos: f64| (-cos).clamp(-1.0, 1.0).acos();
        let g = [angle(nz[0] * nz[1]), angle(nz[1] * nz[2]), angle(nz[2] * nz[3]), angle(nz[3] * nz[0])];
        let k = std::f64::consts::TAU - g[2] - g[3];
        let solid_angle = (g[0] + g[1] - k) as f32;
        (solid_angle > 0.0).then_some(SeenRectangle {
            origin,
            axes,
            x0,
            x1,
            y0,
            y1,
            z0,
            b0: nz[0],
            b1: nz[2],
            k,
            solid_angle,
        })
    }

    /// A point of the rectangle with uniform density over the solid angle, for `u` uniform in [0, 1)².
    pub fn sample(&self, u: Vec2) -> Vec3 {
        let (u, v) = (f64::from(u.x), f64::from(u.y));
        let around = u * f64::from(self.solid_angle) + self.k;
        let slope = (around.cos() * self.b0 - self.b1) / around.sin();
        let cu = (1.0 / (slope * slope + self.b0 * self.b0).sqrt()).min(1.0).copysign(slope);
        let x = (-(cu * self.z0) / (1.0 - cu * cu).max(1e-300).sqrt()).clamp(self.x0, self.x1);
        let d = (x * x + self.z0 * self.z0).sqrt();
        let height = |y: f64| y / (d * d + y * y).sqrt();
        let (h0, h1) = (height(self.y0), height(self.y1));
        let h = h0 + v * (h1 - h0);
        let y = if h * h < 1.0 - 1e-12 { (h * d / (1.0 - h * h).sqrt()).clamp(self.y0, self.y1) } else { self.y1 };
        (self.origin + self.axes[0] * x + self.axes[1] * y + self.axes[2] * self.z0).as_vec3()
    }
}
