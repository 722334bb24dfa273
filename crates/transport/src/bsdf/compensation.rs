//! Light that is scattered more than once among the facets of a rough surface.
//!
//! A facet model follows light to one facet only: what the facets in front then stop is lost, up to 70 % of it at roughness 1.
//!
//! *Metal and thin walls.* As \[Turquin2019\] does, the lobes are scaled up and keep their shape; but by a factor of each of
//! the two directions, s(θₒ)·s(θᵢ), so that reciprocity holds. The factors are those by which a surface that absorbs nothing
//! returns exactly what it got from every direction: the symmetric scaling of its table of transport between angles, found by
//! alternation \[Sinkhorn1967\]. A metal that absorbs gets less: of light that stays among the facets each bounce leaves the
//! share of its mean reflectance, a geometric series \[Kulla2017\].
//!
//! *Solids.* What is lost of either side comes back as two lobes, (1 − E(θₒ))·(1 − E(θᵢ)) each, one on either side of the
//! surface, in a ratio that keeps reciprocity \[Kulla2017\]. Scaling the lobes would not do: refraction is so nearly one to one
//! between the angles of both sides that the factors of one side would grow as those of the other vanish.

use std::f32::consts::FRAC_1_PI;
use std::sync::{LazyLock, OnceLock};

use glam::Vec3;

use super::energy::{N_COS, N_ROUGHNESS, place};
use super::fresnel::{self, Solid};
use super::ggx::Ggx;

/// Rounds of the alternation; the error falls by half or more with each.
const N_ROUNDS: usize = 40;
/// Indices of refraction that are tabulated, evenly in √((η − 1)/(η + 1)) from 0 to 1.
const N_ETA: usize = 33;
/// Index that stands for one without end.
const GREATEST_ETA: f32 = 1e4;

/// Factors of a surface whose facets reflect everything, by roughness √α and by √cosθ.
static REFLECTING: LazyLock<[[f32; N_COS]; N_ROUGHNESS]> =
    LazyLock::new(|| std::array::from_fn(|row| balanced(&reflecting_kernel(alpha_of(row)))));

/// Glass of one index and one roughness.
#[derive(Clone, Debug)]
struct Cell {
    alpha: f32,
    eta: f32,
    /// With the reflectance of its index.
    own: Lost,
    /// With the other ones of [`Solid::BASES`], once they are asked for.
    others: OnceLock<Box<[Lost; 2]>>,
}

/// What facets of glass lose, by side (the rarer first).
#[derive(Clone, Debug)]
struct Lost {
    /// By √cosθ.
    by_cos: [[f32; N_COS]; 2],
    /// Mean over a cosine.
    mean: [f32; 2],
}

static GLASS: [[OnceLock<Cell>; N_ROUGHNESS]; N_ETA] = [const { [const { OnceLock::new() }; N_ROUGHNESS] }; N_ETA];

/// What the facets of one point get for one viewer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Compensation {
    row: u32,
    between: f32,
    /// Factor of the viewer's direction.
    viewer: f32,
    /// Mean reflectance of the metal over all angles.
    mean: Vec3,
}

/// What a solid sends back of light that its facets scatter repeatedly.
#[derive(Clone, Copy, Debug)]
pub(super) struct Repeated {
    /// By index and by roughness.
    cells: [[&'static Cell; 2]; 2],
    weights: [f32; 2],
    /// What [`Solid::parts`] says, if that is not the reflectance of the index alone.
    parts: Option<[f32; 3]>,
    /// Side of the viewer: 0 for the rarer.
    side: usize,
    /// Share that the facets lose of the viewer's direction.
    lost: f32,
    /// Mean over a cosine of what is lost, on either side.
    means: [f32; 2],
    /// Share of it that comes from the other side.
    passed: f32,
}

/// Which side of a surface light comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    /// That of the viewer.
    Near,
    /// The other one.
    Far,
}

impl Compensation {
    /// For facets of width `alpha` seen under `cos`, of a metal that reflects `f0` head on.
    pub(super) fn new(alpha: f32, cos: f32, f0: Vec3) -> Compensation {
        let (row, between) = row_of(alpha);
        // Schlick's reflectance over a cosine.
        let mean = f0 + (Vec3::ONE - f0) * (1.0 / 21.0);
        let mut made = Compensation { row, between, viewer: 1.0, mean };
        made.viewer = made.factor(cos);
        made
    }

    /// What multiplies facets that absorb nothing and mirror what they let pass.
    #[inline]
    pub(super) fn lossless(&self, cos_i: f32) -> f32 {
        self.viewer * self.factor(cos_i)
    }

    /// The mean reflectance of the metal, and [`Compensation::lossless`] by √cosθ.
    pub(super) fn table(&self) -> ([f32; 3], [f32; N_COS]) {
        let rows = &REFLECTING[self.row as usize..self.row as usize + 2];
        let mixed =
            |column: usize| self.viewer * (rows[0][column] + (rows[1][column] - rows[0][column]) * self.between);
        (self.mean.into(), std::array::from_fn(mixed))
    }

    /// What multiplies the metal.
    #[inline]
    pub(super) fn metal(&self, lossless: f32) -> Vec3 {
        Vec3::splat(lossless) / (Vec3::splat(lossless) - self.mean * (lossless - 1.0))
    }

    /// What multiplies a metal whose lossless twin would return a share `albedo`.
    pub(super) fn metal_of_albedo(&self, albedo: f32) -> Vec3 {
        self.metal(1.0 / albedo.max(1e-3))
    }

    #[inline]
    fn factor(&self, cos: f32) -> f32 {
        let rows = &REFLECTING[self.row as usize..self.row as usize + 2];
        let (low, high) = (at(&rows[0], cos), at(&rows[1], cos));
        low + (high - low) * self.between
    }
}

impl Repeated {
    /// For facets of width `alpha` seen under `cos`; `eta` is the index behind over the one in front.
    pub(super) fn new(alpha: f32, cos: f32, eta: f32, solid: Solid) -> Repeated {
        let (side, eta) = if eta >= 1.0 { (0, eta) } else { (1, 1.0 / eta) };
        let (row, between) = row_of(alpha);
        let index = ((eta - 1.0) / (eta + 1.0)).sqrt() * (N_ETA - 1) as f32;
        let low = (index as usize).min(N_ETA - 2);
        let cells = [low, low + 1].map(|nth| [row as usize, row as usize + 1].map(|row| cell(nth, row)));
        let weights = [index - low as f32, between];
        let [own, nothing, all] = solid.parts();
        let parts = (own != 1.0 || nothing != 0.0).then_some([own, nothing, all]);
        let mut made = Repeated { cells, weights, parts, side, lost: 0.0, means: [0.0; 2], passed: 0.0 };
        made.means = [0, 1].map(|side| made.mixed(|lost| lost.mean[side]).max(1e-9));
        made.lost = made.lost_at(cos, side);
        // Mean transmittance from the rarer side [Kulla2017]; from the denser one it is η² times less. Both sides pass on the
        // same light, the lesser of what their own would be.
        let from_rarer = (1.0 - (own * ((eta - 1.0) / (4.085_67 + 1.000_71 * eta)) + all)).clamp(0.0, 1.0);
        let [near, far] = [made.means[side], made.means[1 - side]];
        made.passed = from_rarer * if side == 0 { 1.0 } else { 1.0 / (eta * eta) } * (far / near).min(1.0);
        made
    }

    /// Share of the light from everywhere that comes back to the viewer in this way.
    pub(super) fn albedo(&self) -> f32 {
        self.lost
    }

    /// The part of it that comes from a side.
    #[inline]
    pub(super) fn share(&self, from: Side) -> f32 {
        match from {
            Side::Near => 1.0 - self.passed,
            Side::Far => self.passed,
        }
    }

    /// `f·|cosθ|` of light from a side, as energy: radiance is squeezed besides.
    #[inline]
    pub(super) fn eval(&self, cos_i: f32, from: Side) -> f32 {
        let side = self.side ^ usize::from(from == Side::Far);
        self.lost * self.share(from) * self.lost_at(cos_i, side) / self.means[side] * cos_i * FRAC_1_PI
    }

    #[inline]
    fn lost_at(&self, cos: f32, side: usize) -> f32 {
        self.mixed(|lost| at(&lost.by_cos[side], cos))
    }

    #[inline]
    fn mixed(&self, of: impl Fn(&Lost) -> f32) -> f32 {
        let of_cell = |cell: &Cell| match self.parts {
            None => of(&cell.own),
            // What is lost is linear in what facets reflect.
            Some([own, nothing, all]) => {
                let [by_nothing, by_all] = cell.others();
                (own * of(&cell.own) + nothing * of(by_nothing) + all * of(by_all)).max(0.0)
            }
        };
        let [first, second] = self.cells.map(|[low, high]| {
            let (low, high) = (of_cell(low), of_cell(high));
            low + (high - low) * self.weights[1]
        });
        first + (second - first) * self.weights[0]
    }
}

/// Factors of facets that reflect everything in plain numbers, by roughness (24) and by cosine (32).
pub(super) fn table() -> Vec<f32> {
    REFLECTING.as_flattened().to_vec()
}

/// A table by √cosθ at a cosine.
#[inline]
fn at(row: &[f32; N_COS], cos: f32) -> f32 {
    let (column, weight) = place(cos);
    row[column] + (row[column + 1] - row[column]) * weight
}

/// Row of a width and the weight of the next one.
#[inline]
fn row_of(alpha: f32) -> (u32, f32) {
    let at = alpha.sqrt() * (N_ROUGHNESS - 1) as f32;
    let row = (at as u32).min(N_ROUGHNESS as u32 - 2);
    (row, at - row as f32)
}

fn alpha_of(row: usize) -> f32 {
    (row as f32 / (N_ROUGHNESS - 1) as f32).powi(2)
}

fn cell(nth: usize, row: usize) -> &'static Cell {
    GLASS[nth][row].get_or_init(|| {
        let x = (nth as f32 / (N_ETA - 1) as f32).powi(2);
        let eta = ((1.0 + x) / (1.0 - x).max(1e-6)).min(GREATEST_ETA);
        let alpha = alpha_of(row);
        Cell { alpha, eta, own: Lost::new(alpha, eta, Solid::BASES[0]), others: OnceLock::new() }
    })
}

impl Cell {
    fn others(&self) -> &[Lost; 2] {
        let [_, nothing, all] = Solid::BASES;
        self.others.get_or_init(|| Box::new([nothing, all].map(|solid| Lost::new(self.alpha, self.eta, solid))))
    }
}

impl Lost {
    fn new(alpha: f32, eta: f32, solid: Solid) -> Lost {
        let by_cos = [eta, 1.0 / eta].map(|eta| {
            std::array::from_fn(|column| {
                let kept: f32 = scattered(alpha, viewer(column), Some((eta, solid))).map(|(share, _)| share).sum();
                (1.0 - kept).max(0.0)
            })
        });
        Lost { mean: by_cos.map(|lost| mean_over_cosine(&lost)), by_cos }
    }
}

/// Mean of a table by √cosθ over directions of a density cosθ/π.
fn mean_over_cosine(row: &[f32; N_COS]) -> f32 {
    let n = 512;
    (0..n).map(|nth| at(row, ((nth as f32 + 0.5) / n as f32).sqrt())).sum::<f32>() / n as f32
}

/// Positive factors `s` with `s[o] · Σᵢ kernel[o][i] · s[i] = 1` for all `o`.
fn balanced(kernel: &[[f32; N_COS]; N_COS]) -> [f32; N_COS] {
    let mut factors = [1.0f32; N_COS];
    for _ in 0..N_ROUNDS {
        factors = std::array::from_fn(|o| {
            let sum: f32 = kernel[o].iter().zip(&factors).map(|(share, factor)| share * factor).sum();
            (factors[o] / sum.max(1e-6)).sqrt()
        });
    }
    factors
}

/// Shares of light between angles: a row for each direction of a viewer, a column for each that the light comes from.
fn reflecting_kernel(alpha: f32) -> [[f32; N_COS]; N_COS] {
    std::array::from_fn(|o| {
        let mut row = [0.0; N_COS];
        for (share, cos_i) in scattered(alpha, viewer(o), None) {
            let (column, weight) = place(cos_i);
            row[column] += share * (1.0 - weight);
            row[column + 1] += share * weight;
        }
        row
    })
}

/// A direction of a column.
fn viewer(column: usize) -> Vec3 {
    let cos = (column as f32 / (N_COS - 1) as f32).powi(2).max(1e-4);
    Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos)
}

/// Shares of light that facets send to a viewer in the plane of x and z, each with the cosine that it comes from: all
/// reflect, or with an index behind over the one in front, and an interface, they refract the rest.
fn scattered(alpha: f32, wo: Vec3, solid: Option<(f32, Solid)>) -> impl Iterator<Item = (f32, f32)> {
    let ggx = Ggx::round(alpha.max(1e-4));
    let lambda_o = ggx.lambda(wo);
    let unshadowed = move |wi: Vec3| (1.0 + lambda_o) / (1.0 + lambda_o + ggx.lambda(wi));
    // The other half of the circle is the same.
    points([12, 64], 0.5).flat_map(move |(u, share)| {
        let wm = ggx.sample(wo, u);
        let cos_half = wo.dot(wm).max(0.0);
        let reflected = solid.map_or(1.0, |(eta, solid)| solid.reflectance(cos_half, eta).x);
        let near = wm * (2.0 * cos_half) - wo;
        let near = (near.z > 0.0).then(|| (share * reflected * unshadowed(near), near.z));
        let far = solid.and_then(|(eta, _)| fresnel::refract(wo, wm, eta)).filter(|far| far.z < 0.0);
        let far = far.map(|far| (share * (1.0 - reflected) * unshadowed(far), -far.z));
        [near, far].into_iter().flatten()
    })
}

/// Numbers to sample facets by, with weights that add up to 1: closer where facets lean most. The first numbers fill `turn` of
/// the circle.
pub(super) fn points([n_turn, n_lean]: [usize; 2], turn: f32) -> impl Iterator<Item = ([f32; 2], f32)> {
    (0..n_turn * n_lean).map(move |nth| {
        let left = 1.0 - ((nth / n_turn) as f32 + 0.5) / n_lean as f32;
        let around = ((nth % n_turn) as f32 + 0.5) / n_turn as f32;
        ([around * turn, 1.0 - left * left], 2.0 * left / (n_turn * n_lean) as f32)
    })
}
