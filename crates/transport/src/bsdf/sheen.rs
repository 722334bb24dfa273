//! Fibers that stand on the surface: KHR_materials_sheen.
//!
//! The distribution of normals is "Charlie's", with its fitted shadowing. \[Estevez2017\] What lies below is multiplied by
//! what the sheen leaves of the light, `1 − max(color) · E`, in the direction where that is less, so that reciprocity
//! holds. Below a roughness of about 0.25 the published lobe would reflect up to three times the light that came at
//! grazing angles: there it is divided by its albedo E, again in the direction where that is greater.

use std::f32::consts::{PI, TAU};
use std::sync::LazyLock;

use glam::Vec3;

/// Smaller roughness is taken for this one.
const MIN_ROUGHNESS: f32 = 0.07;
/// Density of the directions that [`Sheen::sample`] chooses.
const UNIFORM_PDF: f32 = 1.0 / TAU;

const N_COS: usize = 48;
const N_ROUGHNESS: usize = 32;
/// Samples along each axis of the integrals.
const N_SIDE: usize = 40;

type Albedos = [[f32; N_COS]; N_ROUGHNESS];

/// Directional albedo of a white sheen: rows of roughness, denser where it is small, columns of √cosθ = 0…1.
static ALBEDOS: LazyLock<Box<Albedos>> = LazyLock::new(integrate);

/// A sheen as one viewer sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sheen {
    color: Vec3,
    fibers: Fibers,
    row: u32,
    between: f32,
    cos_o: f32,
    lambda_o: f32,
    albedo_o: f32,
}

impl Sheen {
    /// `cos_o` > 0 is the viewer's cosine.
    pub(super) fn new(color: Vec3, roughness: f32, cos_o: f32) -> Sheen {
        let roughness = roughness.clamp(MIN_ROUGHNESS, 1.0);
        let at = row_of(roughness);
        let row = (at as u32).min(N_ROUGHNESS as u32 - 2);
        let fibers = Fibers::new(roughness);
        let lambda_o = fibers.lambda(cos_o);
        let mut sheen = Sheen { color, fibers, row, between: at - row as f32, cos_o, lambda_o, albedo_o: 0.0 };
        sheen.albedo_o = sheen.white_albedo(cos_o);
        sheen
    }

    /// `f·|cosθ|` of local directions on the viewer's side.
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> Vec3 {
        let wm = (wo + wi).normalize();
        let shadowed = 1.0 / ((1.0 + self.lambda_o + self.fibers.lambda(wi.z)) * 4.0 * self.cos_o);
        let excess = self.albedo_o.max(self.white_albedo(wi.z)).max(1.0);
        self.color * (self.fibers.d(wm) * shadowed / excess)
    }

    /// A local direction on the viewer's side.
    pub(super) fn sample(u: [f32; 2]) -> Vec3 {
        let (sin, cos) = (TAU * u[0]).sin_cos();
        let radius = (1.0 - u[1] * u[1]).sqrt();
        Vec3::new(radius * cos, radius * sin, u[1])
    }

    /// Density of [`Sheen::sample`] on the viewer's side.
    pub(super) fn pdf() -> f32 {
        UNIFORM_PDF
    }

    /// Share of uniform light that the sheen sends to the viewer: at most this.
    pub(super) fn albedo(&self) -> Vec3 {
        self.color * self.albedo_o.min(1.0)
    }

    /// Share of the light that gets to what lies below and from there to the viewer; `cos` of either side.
    pub(super) fn passed(&self, cos: f32) -> f32 {
        let most = self.albedo_o.max(self.white_albedo(cos.abs())).min(1.0);
        1.0 - self.color.max_element() * most
    }

    fn white_albedo(&self, cos: f32) -> f32 {
        let at = cos.clamp(0.0, 1.0).sqrt() * (N_COS - 1) as f32;
        let column = (at as usize).min(N_COS - 2);
        let rows = &ALBEDOS[self.row as usize..self.row as usize + 2];
        let [low, high] = [0, 1].map(|row: usize| {
            let row = &rows[row];
            row[column] + (row[column + 1] - row[column]) * (at - column as f32)
        });
        low + (high - low) * self.between
    }
}

/// The distribution of normals and the shadowing of one roughness.
#[derive(Clone, Copy, Debug)]
struct Fibers {
    inverse_alpha: f32,
    /// Coefficients of the fit of ln Λ.
    fit: [f32; 5],
}

impl Fibers {
    fn new(roughness: f32) -> Fibers {
        const BROAD: [f32; 5] = [21.5473, 3.82987, 0.19823, -1.97760, -4.32054];
        const NARROW: [f32; 5] = [25.3245, 3.32435, 0.16801, -1.27393, -4.85967];
        let alpha = roughness * roughness;
        let narrow = (1.0 - alpha) * (1.0 - alpha);
        let fit = std::array::from_fn(|i| BROAD[i] + (NARROW[i] - BROAD[i]) * narrow);
        Fibers { inverse_alpha: 1.0 / alpha, fit }
    }

    fn d(&self, wm: Vec3) -> f32 {
        let sin2 = (wm.x * wm.x + wm.y * wm.y).min(1.0);
        (2.0 + self.inverse_alpha) * sin2.powf(0.5 * self.inverse_alpha) / TAU
    }

    /// The fit of the shadowing. \[Estevez2017\]
    fn lambda(&self, cos: f32) -> f32 {
        if cos < 0.5 {
            self.ln_lambda(cos).exp()
        } else {
            (2.0 * self.ln_lambda(0.5) - self.ln_lambda(1.0 - cos)).exp()
        }
    }

    fn ln_lambda(&self, x: f32) -> f32 {
        let [a, b, c, d, e] = self.fit;
        a / (1.0 + b * x.max(0.0).powf(c)) + d * x + e
    }
}

/// Place of a roughness among the rows.
fn row_of(roughness: f32) -> f32 {
    ((roughness - MIN_ROUGHNESS) / (1.0 - MIN_ROUGHNESS)).max(0.0).sqrt() * (N_ROUGHNESS - 1) as f32
}

fn integrate() -> Box<Albedos> {
    let mut albedos = Box::new([[0.0; N_COS]; N_ROUGHNESS]);
    for (row, albedos) in albedos.iter_mut().enumerate() {
        let share = row as f32 / (N_ROUGHNESS - 1) as f32;
        let fibers = Fibers::new(MIN_ROUGHNESS + (1.0 - MIN_ROUGHNESS) * share * share);
        for (column, albedo) in albedos.iter_mut().enumerate() {
            *albedo = directional_albedo(&fibers, (column as f32 / (N_COS - 1) as f32).powi(2).max(1e-4));
        }
    }
    albedos
}

fn directional_albedo(fibers: &Fibers, cos_o: f32) -> f32 {
    let wo = Vec3::new((1.0 - cos_o * cos_o).max(0.0).sqrt(), 0.0, cos_o);
    let lambda_o = fibers.lambda(cos_o);
    let mut sum = 0.0;
    for row in 0..N_SIDE {
        // Cosines are drawn as squares, as the lobe is at the horizon.
        let root = (row as f32 + 0.5) / N_SIDE as f32;
        let (cos, sin) = (root * root, (1.0 - root.powi(4)).sqrt());
        let shadowed = 2.0 * root / ((1.0 + lambda_o + fibers.lambda(cos)) * 4.0 * cos_o);
        for column in 0..N_SIDE {
            let (sin_phi, cos_phi) = ((column as f32 + 0.5) / N_SIDE as f32 * PI).sin_cos();
            let wm = (wo + Vec3::new(sin * cos_phi, sin * sin_phi, cos)).normalize();
            sum += fibers.d(wm) * shadowed;
        }
    }
    sum * TAU / (N_SIDE * N_SIDE) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_albedo_is_that_of_a_fine_integral() {
        // Computed apart, in double precision, with 400 × 800 directions.
        for (roughness, cos, expected) in
            [(1.0, 1.0, 0.164), (1.0, 0.1, 0.721), (0.5, 0.5, 0.188), (0.5, 0.05, 0.680), (0.3, 0.2, 0.341)]
        {
            let albedo = Sheen::new(Vec3::ONE, roughness, cos).albedo().x;
            assert!((albedo - expected).abs() < 6e-3, "{roughness} {cos}: {albedo} against {expected}");
        }
    }

    #[test]
    fn fibers_fill_the_projected_area() {
        // ∫ D cosθ dω = 1, as of every distribution of normals.
        for roughness in [0.1, 0.3, 0.7, 1.0] {
            let (fibers, n) = (Fibers::new(roughness), 20_000);
            let integral: f64 = (0..n)
                .map(|i| {
                    let (sin, cos) = ((i as f32 + 0.5) / n as f32 * std::f32::consts::FRAC_PI_2).sin_cos();
                    f64::from(fibers.d(Vec3::new(sin, 0.0, cos)) * cos * sin * TAU) * f64::from(PI) / 2.0 / f64::from(n)
                })
                .sum();
            assert!((integral - 1.0).abs() < 2e-3, "{roughness}: {integral}");
        }
    }
}
