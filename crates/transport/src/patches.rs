//! Patches of surface whose light is known: the columns by which lamps that are moved after the bake light a scene.
//!
//! The light of such a lamp that a picture shows is the direct part, which is found anew, and what surfaces make of it.
//! The second depends on the irradiance that the lamp throws on surfaces alone, and linearly \[Hasan2006\]. Patches are
//! clusters of the surfaces that walks of the camera meet, each with a few points at which irradiance is asked for. What
//! the picture takes of all patches is a matrix with far fewer ranks than patches: lamps light surfaces smoothly, and walls
//! blur what is not smooth. A few hundred lamps that are tried before the bake tell which combinations matter; the columns
//! are pictures of these combinations, and [`Patches::coefficients`] says how much of each a lamp brings.

mod cluster;
mod codec;
mod exchange;
mod layout;
mod learn;
mod matrix;
mod modes;
mod nearest;
mod response;
mod strips;
mod trials;
#[doc(hidden)] // Only the benchmark calls it from elsewhere.
pub mod vector;

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub(crate) use codec::{decode, encode};
pub(crate) use layout::{Beam, Layout};
pub(crate) use learn::{Request, Table, learn};
pub(crate) use matrix::PatchMatrix;

/// Most patches of a bake.
pub const MOST_PATCHES: u32 = 16_384;
/// Patches of a bake that names no number.
pub const DEFAULT_PATCHES: u32 = 4096;

/// Widest lobe α (the square of its roughness) in which light straight from lamps is found anew for each pixel, not by patches.
pub const NARROW_ALPHA: f32 = 0.125;

/// A point at which the irradiance of a patch is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatchSample {
    /// World-space point in meters, a rounding step above its surface: rays may start there.
    pub position: Vec3,
    /// Unit normal of the side that counts.
    pub normal: Vec3,
    /// Share of its patch; those of a patch add up to 1.
    pub weight: f32,
    /// Radius of a disk as large as what it stands for, m.
    pub radius_m: f32,
    /// How much more of grazing light its surface scatters than of other light, see [`PatchSample::response`].
    pub grazing: f32,
}

/// Clusters of surface, and how their irradiance becomes coefficients. The header of a file holds the numbers; all else
/// stands behind it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Patches {
    /// Patches.
    n_patches: u32,
    /// Points of all patches.
    n_samples: u32,
    /// Columns of the matrix that stand for the patches.
    n_columns: u32,
    /// See [`Patches::held_out_error`].
    held_out_error: f32,
    /// See [`Patches::narrow_alpha`]; files from before there was such a number show all light.
    #[serde(default)]
    narrow_alpha: f32,
    /// Whether samples know [`PatchSample::grazing`].
    #[serde(default)]
    knows_grazing: bool,
    /// Distance that a right angle between normals counts as, over the square root of two, m; 0 in files from before patches
    /// knew their areas.
    #[serde(default)]
    reach_m: f32,
    #[serde(skip)]
    body: Arc<Body>,
}

/// What stands behind the header.
#[derive(Debug, Default)]
struct Body {
    /// Patch by patch.
    samples: Vec<PatchSample>,
    /// First sample of each patch, and their number.
    first: Vec<u32>,
    /// Patches × columns: what a patch brings to each coefficient per unit of irradiance.
    shares: Vec<f32>,
    /// Where patches lie; files from before they knew their areas have none.
    layout: Option<Layout>,
    /// What a bake under way needs; no file holds it.
    table: Option<Table>,
}

impl PartialEq for Body {
    fn eq(&self, other: &Self) -> bool {
        (&self.samples, &self.first, &self.shares, &self.layout)
            == (&other.samples, &other.first, &other.shares, &other.layout)
    }
}

impl Patches {
    /// Number of patches.
    pub fn n_patches(&self) -> usize {
        self.n_patches as usize
    }

    /// Number of columns of the matrix that stand for the patches.
    pub fn n_columns(&self) -> usize {
        self.n_columns as usize
    }

    /// All points at which irradiance is asked for, patch by patch.
    pub fn samples(&self) -> &[PatchSample] {
        &self.body.samples
    }

    /// Those of a patch.
    pub(crate) fn samples_of(&self, patch: u32) -> &[PatchSample] {
        let Body { samples, first, .. } = &*self.body;
        let [from, to] = [patch, patch + 1].map(|patch| first[patch as usize] as usize);
        &samples[from..to]
    }

    /// Root mean square over lamps that were not learned from of the relative error (L2) in a few pixels by which columns
    /// differ from patches; it says nothing of the patches' own coarseness or of noise.
    pub fn held_out_error(&self) -> f32 {
        self.held_out_error
    }

    /// Widest lobe α, of the first surface that a pixel sees, in which the columns leave out the light that the next surface has
    /// straight from lamps: whoever lights them has to find it anew ([`crate::visible::VisibleConfig::narrow_alpha`]). 0 for none.
    pub fn narrow_alpha(&self) -> f32 {
        self.narrow_alpha
    }

    /// Whether its samples tell light by its angle; those of earlier files do not.
    pub(crate) fn knows_grazing(&self) -> bool {
        self.knows_grazing
    }

    /// The patches as receivers of light; `None` in files from before they knew their areas.
    pub(crate) fn layout(&self) -> Option<&Layout> {
        self.body.layout.as_ref()
    }

    /// Whether patches know where they lie and how large they are; those of earlier files do not.
    pub(crate) fn knows_areas(&self) -> bool {
        self.reach_m > 0.0
    }

    /// What a bake needs to trace the columns; none in patches that were read from a file.
    pub(crate) fn table(&self) -> Option<&Table> {
        self.body.table.as_ref()
    }

    /// One RGB coefficient per column of patches, given the direct irradiance (lux per channel) of the lamps at a point, light of
    /// each direction times [`PatchSample::response`]. Asks at each of [`Patches::samples`] once, on all threads, and around those again that alone
    /// have most of their patch's light: there a lamp is near, or the edge of a shadow.
    pub fn coefficients(&self, irradiance: &(dyn Fn(&PatchSample) -> Vec3 + Sync)) -> Vec<[f32; 3]> {
        self.coefficients_of(&self.irradiance(irradiance))
    }

    /// Mean irradiance of each patch, lux per channel, asked for as [`Patches::coefficients`] does.
    pub(crate) fn irradiance(&self, irradiance: &(dyn Fn(&PatchSample) -> Vec3 + Sync)) -> Vec<Vec3> {
        let Body { samples, first, .. } = &*self.body;
        let of_patch = |w: &[u32]| patch_irradiance(&samples[w[0] as usize..w[1] as usize], irradiance);
        first.par_windows(2).with_min_len(16).map(of_patch).collect()
    }

    /// One RGB coefficient per column, given the irradiance of each patch.
    pub(crate) fn coefficients_of(&self, of_patches: &[Vec3]) -> Vec<[f32; 3]> {
        let n_columns = self.n_columns().max(1);
        let patches = self.body.shares.chunks_exact(n_columns).zip(of_patches);
        let lit: Vec<_> = patches.filter(|(_, light)| **light != Vec3::ZERO).collect();
        let mut coefficients = vec![[0.0f32; 3]; self.n_columns()];
        // Each column is summed by one thread, patch by patch: the same on any number of them.
        coefficients.par_chunks_mut(COLUMNS_AT_ONCE).enumerate().for_each(|(nth, chunk)| {
            let from = nth * COLUMNS_AT_ONCE;
            for &(shares, &light) in &lit {
                for (c, share) in chunk.iter_mut().zip(&shares[from..]) {
                    *c = (Vec3::from(*c) + light * *share).to_array();
                }
            }
        });
        coefficients
    }
}

impl PatchSample {
    /// Radius of a disk as large as its patch, m.
    pub(crate) fn patch_radius_m(&self) -> f32 {
        self.radius_m / self.weight.sqrt()
    }

    /// Share of the light of a lamp, so many meters apart, that patches find by their samples. The rest of what is nearer is
    /// found by rays from the lamp, see [`Layout::receive`].
    pub(crate) fn far_share(&self, apart_m: f32) -> f32 {
        layout::far_share(apart_m, self.patch_radius_m())
    }
}

/// Columns whose coefficients a thread sums.
const COLUMNS_AT_ONCE: usize = 64;

/// Share of a patch's light that one of its samples may have before it is looked at more closely, and at which nothing but
/// the closer look counts. A patch of one sample is always looked at closely.
const ALONE: [f32; 2] = [0.3, 0.5];
/// Points of a closer look.
const POINTS: u32 = 16;

/// Mean irradiance of a patch.
fn patch_irradiance(samples: &[PatchSample], irradiance: &(dyn Fn(&PatchSample) -> Vec3 + Sync)) -> Vec3 {
    let ask = |sample: &PatchSample| {
        let light = irradiance(sample);
        // A lamp without a finite light at some point leaves that point dark, not the picture undefined.
        if light.is_finite() { light } else { Vec3::ZERO }
    };
    let lights: Vec<Vec3> = samples.iter().map(|sample| ask(sample) * sample.weight).collect();
    let total: Vec3 = lights.iter().sum();
    let mut mean = total;
    for (sample, light) in samples.iter().zip(lights) {
        let alone = layout::smoothly(ALONE, light.element_sum() / total.element_sum());
        // Without any light there is no share of it.
        if !(alone > 0.0 && sample.radius_m > 0.0) {
            continue;
        }
        let (tangent, bitangent) = sample.normal.any_orthonormal_pair();
        let point = |nth: u32| {
            let radius = sample.radius_m * ((nth as f32 + 0.5) / POINTS as f32).sqrt();
            let (sin, cos) = (GOLDEN_ANGLE * nth as f32).sin_cos();
            let position = sample.position + (tangent * cos + bitangent * sin) * radius;
            ask(&PatchSample { position, ..*sample })
        };
        let closer = (0..POINTS).map(point).sum::<Vec3>() * (sample.weight / POINTS as f32);
        mean += (closer - light) * alone;
    }
    mean
}

/// Turns from point to point of a sunflower, which fill a disk evenly \[Vogel1979\]; radians.
pub(crate) const GOLDEN_ANGLE: f32 = 2.399_963_2;
