//! How much of the light below a glossy coat may come out again.
//!
//! glTF couples the diffuse lobe to its coat by `1 − F(V·H)`. Near grazing view the coat alone reflects almost
//! everything, yet that factor lets most of the diffuse light through as well: together they would return up to 1.5 times
//! the light that came. So the diffuse lobe is also multiplied by an allowance, small enough that coat and base together
//! return at most what came. It is taken at the more grazing one of the two directions, where it is smaller, so that
//! reciprocity holds. Wherever there is no excess the allowance is 1 and the model is glTF's own.

use std::sync::LazyLock;

use glam::Vec3;

use super::fresnel::grazing;
use super::ggx::Ggx;
use super::lanes::CouplingTable;

/// Directional albedo of the coat per unit of `f0` and of `f90`.
type Split = [f32; 2];

pub(super) const N_COS: usize = 32;
pub(super) const N_ROUGHNESS: usize = 24;
/// Samples along each axis of the integrals.
const N_SIDE: usize = 20;

struct Albedos {
    /// Rows of roughness √α = 0…1, columns of √cosθ = 0…1.
    coat: [[Split; N_COS]; N_ROUGHNESS],
    /// Mean of `(1 − V·H)⁵` over a diffuse lobe, by √cosθ.
    grazing: [f32; N_COS],
}

static ALBEDOS: LazyLock<Albedos> = LazyLock::new(Albedos::integrate);

/// A coat of one roughness over a diffuse base.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coat {
    row: u32,
    between: f32,
    /// Largest channel of the reflectance at normal incidence.
    f0: f32,
    f90: f32,
}

impl Coat {
    /// `alpha` is 0 for a mirror.
    pub(super) fn new(alpha: f32, f0: f32, f90: f32) -> Coat {
        let at = alpha.sqrt() * (N_ROUGHNESS - 1) as f32;
        let row = (at as u32).min(N_ROUGHNESS as u32 - 2);
        Coat { row, between: at - row as f32, f0, f90 }
    }

    /// Directional albedo of a coat of this roughness per unit of `f0` and of `f90`.
    pub(super) fn albedo(self, cos: f32) -> Split {
        let (column, weight) = place(cos);
        self.split(column, weight)
    }

    /// Share of the diffuse lobe that energy allows in a direction, 0…1.
    #[inline]
    pub(super) fn allowance(self, cos: f32) -> f32 {
        let (passed, left) = self.passed_and_left(cos);
        (left / passed).min(1.0)
    }

    /// Mean share of the diffuse lobe that is seen from a direction, 0…1.
    pub(super) fn base_share(self, cos: f32) -> f32 {
        let (passed, left) = self.passed_and_left(cos);
        passed.min(left)
    }

    /// Mean of `1 − F(V·H)` over the diffuse lobe, and what the coat's own reflection leaves.
    #[inline]
    fn passed_and_left(self, cos: f32) -> (f32, f32) {
        let (column, weight) = place(cos);
        let [per_f0, per_f90] = self.split(column, weight);
        let grazing = &ALBEDOS.grazing;
        let mean_grazing = grazing[column] + (grazing[column + 1] - grazing[column]) * weight;
        let passed = 1.0 - self.f0 - (self.f90 - self.f0) * mean_grazing;
        (passed.max(1e-6), (1.0 - self.f0 * per_f0 - self.f90 * per_f90).max(0.0))
    }

    /// [`Coat::passed_and_left`] before either is held to what can be, by √cosθ.
    pub(super) fn table(self) -> CouplingTable {
        let Coat { f0, f90, between, row } = self;
        let rows = &ALBEDOS.coat[row as usize..row as usize + 2];
        let mixed = |column: usize, part: usize| {
            rows[0][column][part] + (rows[1][column][part] - rows[0][column][part]) * between
        };
        CouplingTable {
            passed: std::array::from_fn(|column| 1.0 - f0 - (f90 - f0) * ALBEDOS.grazing[column]),
            left: std::array::from_fn(|column| 1.0 - f0 * mixed(column, 0) - f90 * mixed(column, 1)),
            f0,
            f90,
        }
    }

    fn split(self, column: usize, weight: f32) -> Split {
        let rows = &ALBEDOS.coat[self.row as usize..self.row as usize + 2];
        let along = |row: &[Split; N_COS], part: usize| {
            row[column][part] + (row[column + 1][part] - row[column][part]) * weight
        };
        [0, 1].map(|part| {
            let (low, high) = (along(&rows[0], part), along(&rows[1], part));
            low + (high - low) * self.between
        })
    }
}

/// Column of a cosine and the weight of the next one.
#[inline]
pub(super) fn place(cos: f32) -> (usize, f32) {
    let at = cos.clamp(0.0, 1.0).sqrt() * (N_COS - 1) as f32;
    let column = (at as usize).min(N_COS - 2);
    (column, at - column as f32)
}

/// What [`Coat::allowance`] looks up, in plain numbers: albedos per f0 and f90 by roughness (24) and by cosine (32), then the mean of
/// `(1 − V·H)⁵` by cosine.
pub(super) fn table() -> Vec<f32> {
    let Albedos { coat, grazing } = &*ALBEDOS;
    coat.as_flattened().as_flattened().iter().chain(grazing).copied().collect()
}

impl Albedos {
    fn integrate() -> Albedos {
        let wo = |column: usize| {
            let cos = (column as f32 / (N_COS - 1) as f32).powi(2).max(1e-4);
            Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos)
        };
        let coat = std::array::from_fn(|row| {
            let alpha = (row as f32 / (N_ROUGHNESS - 1) as f32).powi(2);
            std::array::from_fn(|column| coat_albedo(alpha, wo(column)))
        });
        Albedos { coat, grazing: std::array::from_fn(|column| mean_grazing(wo(column))) }
    }
}

fn coat_albedo(alpha: f32, wo: Vec3) -> Split {
    if alpha == 0.0 {
        let x = grazing(wo.z);
        return [1.0 - x, x];
    }
    let ggx = Ggx::round(alpha);
    let lambda_o = ggx.lambda(wo);
    let [mut per_f0, mut per_f90] = [0.0, 0.0];
    for u in grid() {
        let wm = ggx.sample(wo, u);
        let cos_half = wo.dot(wm);
        let wi = wm * (2.0 * cos_half) - wo;
        if wi.z > 0.0 {
            let weight = (1.0 + lambda_o) / (1.0 + lambda_o + ggx.lambda(wi));
            per_f0 += weight * (1.0 - grazing(cos_half));
            per_f90 += weight * grazing(cos_half);
        }
    }
    [per_f0, per_f90].map(|sum| sum / (N_SIDE * N_SIDE) as f32)
}

fn mean_grazing(wo: Vec3) -> f32 {
    let sum: f32 = grid()
        .map(|u| {
            let (sin, cos) = (std::f32::consts::TAU * u[0]).sin_cos();
            let wi = Vec3::new(u[1].sqrt() * cos, u[1].sqrt() * sin, (1.0 - u[1]).sqrt());
            // |V·H| from the half-angle formula.
            grazing((0.5 * (1.0 + wo.dot(wi)).max(0.0)).sqrt())
        })
        .sum();
    sum / (N_SIDE * N_SIDE) as f32
}

fn grid() -> impl Iterator<Item = [f32; 2]> {
    (0..N_SIDE * N_SIDE).map(|i| [i % N_SIDE, i / N_SIDE].map(|axis| (axis as f32 + 0.5) / N_SIDE as f32))
}
