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
mod learn;
mod matrix;
mod nearest;
mod trials;

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub(crate) use codec::{decode, encode};
pub(crate) use learn::{Request, Table, learn};
pub(crate) use matrix::PatchMatrix;

/// Most patches of a bake.
pub const MOST_PATCHES: u32 = 16_384;
/// Patches of a bake that names no number.
pub const DEFAULT_PATCHES: u32 = 4096;

/// A point at which the irradiance of a patch is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatchSample {
    /// World-space point in meters, a rounding step above its surface: rays may start there.
    pub position: Vec3,
    /// Unit normal of the side that counts.
    pub normal: Vec3,
    /// Share of its patch; those of a patch add up to 1.
    pub weight: f32,
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
    /// What a bake under way needs; no file holds it.
    table: Option<Table>,
}

impl PartialEq for Body {
    fn eq(&self, other: &Self) -> bool {
        (&self.samples, &self.first, &self.shares) == (&other.samples, &other.first, &other.shares)
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

    /// Root mean square over lamps that were not learned from of the relative error (L2) in a few pixels by which columns
    /// differ from patches; it says nothing of the patches' own coarseness or of noise.
    pub fn held_out_error(&self) -> f32 {
        self.held_out_error
    }

    /// What a bake needs to trace the columns; none in patches that were read from a file.
    pub(crate) fn table(&self) -> Option<&Table> {
        self.body.table.as_ref()
    }

    /// One RGB coefficient per column of patches, given the direct irradiance (lux per channel) of the lamps at a point
    /// with a unit normal. Linear in the irradiance; asks at each of [`Patches::samples`] once, on all threads.
    pub fn coefficients(&self, irradiance: &(dyn Fn(Vec3, Vec3) -> Vec3 + Sync)) -> Vec<[f32; 3]> {
        let ask = |sample: &PatchSample| irradiance(sample.position, sample.normal) * sample.weight;
        let of_samples: Vec<Vec3> = self.body.samples.par_iter().with_min_len(64).map(ask).collect();
        let sum = |w: &[u32]| of_samples[w[0] as usize..w[1] as usize].iter().sum();
        let of_patches: Vec<Vec3> = self.body.first.windows(2).map(sum).collect();
        let mut coefficients = vec![[0.0f32; 3]; self.n_columns()];
        for (light, shares) in of_patches.iter().zip(self.body.shares.chunks_exact(self.n_columns().max(1))) {
            // A lamp without a finite light at some point leaves that patch dark, not the picture undefined.
            if *light == Vec3::ZERO || !light.is_finite() {
                continue;
            }
            for (c, share) in coefficients.iter_mut().zip(shares) {
                *c = (Vec3::from(*c) + *light * *share).to_array();
            }
        }
        coefficients
    }
}
