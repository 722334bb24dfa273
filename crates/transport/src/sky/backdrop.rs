//! The sky where the camera sees it: as sharp as its map, whatever the patches are.
//!
//! A bake keeps, in the last column of its sky, how much of each pixel looks straight at the sky. Before a picture is
//! multiplied, these weights are multiplied by the map as it is turned, so that every relighter shows it like any lamp
//! that is seen.

use std::sync::Arc;

use clerestory_nystrom::{BlockFactors, BlockLowRank};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::{SkyLight, SunEmitter, Turn};
use crate::bake::{Bake, BakeHeader};
use crate::basis::{DomeLight, MovedSun, SourceKind};
use crate::camera::{Camera, Film};
use crate::light::LightRig;

/// Samples per side of a pixel that average the map over it.
const PIXEL_SAMPLES: u32 = 3;

/// What stands behind a picture under some rig.
#[derive(Clone, Debug)]
pub struct Backdrop {
    /// Group of the sky's columns.
    pub group: usize,
    /// Column within that group that holds the weights.
    pub column: u32,
    camera: Camera,
    film: Film,
    light: SkyLight,
    turn: Turn,
    /// What multiplies its map.
    map: Vec3,
    /// A sun that has no column of its own, and its radiance in nit, in units of the column's coefficient as the map is.
    sun: Option<(SunEmitter, Vec3)>,
}

impl Backdrop {
    /// `None` for a bake without a sky of patches.
    pub fn new(header: &BakeHeader, rig: &LightRig) -> Option<Backdrop> {
        let basis = &header.basis;
        let source = basis.sources.iter().find(|s| matches!(s.kind, SourceKind::Dome { .. }))?;
        let group = basis.groups.iter().position(|g| g.columns.contains(&source.columns.start))?;
        let DomeLight { light, map, sun, .. } = basis.dome_light(rig)?;
        let sun = sun.map(|MovedSun { direction, seen_lux, .. }| {
            let disk = SunEmitter::new(direction);
            (disk, seen_lux * disk.radiance())
        });
        Some(Backdrop {
            group,
            column: source.columns.len() as u32 - 1,
            camera: header.view.clone()?,
            film: Film { width: header.width, height: header.height },
            turn: light.turn(),
            light,
            map,
            sun,
        })
    }

    /// Whether another backdrop shows the same, so that lit blocks can be kept.
    pub fn shows_the_same(&self, other: &Backdrop) -> bool {
        let radiance = |backdrop: &Backdrop| backdrop.sun.map(|(_, radiance)| radiance);
        (self.turn, &self.light.map, self.light.sun) == (other.turn, &other.light.map, other.light.sun)
            && (self.map, radiance(self)) == (other.map, radiance(other))
            && (self.group, self.column, &self.camera, self.film)
                == (other.group, other.column, &other.camera, other.film)
    }

    /// What of each pixel of a block looks straight at the sky, 0…1 per channel; `pixels` are those of the block in order.
    pub fn weights(&self, block: &BlockFactors, pixels: &[u32]) -> Vec<(u32, Vec3)> {
        let mut weights: Vec<(u32, Vec3)> = Vec::new();
        for entry in block.sparse.iter().filter(|entry| entry.col == self.column) {
            let Some(&pixel) = pixels.get(entry.row as usize / 3) else { continue };
            match weights.last_mut().filter(|(last, _)| *last == pixel) {
                Some((_, weight)) => weight[entry.row as usize % 3] = entry.value,
                None => weights.push((pixel, Vec3::AXES[entry.row as usize % 3] * entry.value)),
            }
        }
        weights
    }

    /// The sky as pixels with these weights show it, nit where the column's coefficient is 1.
    pub fn light(&self, weights: &[(u32, Vec3)]) -> Vec<(u32, Vec3)> {
        weights.par_iter().with_min_len(256).map(|(pixel, weight)| (*pixel, self.pixel(*pixel) * weight)).collect()
    }

    /// A block of the sky's group with weights turned into light; `pixels` are those of the block in order.
    pub fn lit(&self, block: &BlockFactors, pixels: &[u32]) -> BlockFactors {
        let mut lit = block.clone();
        let mut last = (u32::MAX, Vec3::ZERO);
        for entry in lit.sparse.iter_mut().filter(|entry| entry.col == self.column) {
            let pixel = pixels.get(entry.row as usize / 3).copied().unwrap_or(0);
            if last.0 != pixel {
                last = (pixel, self.pixel(pixel));
            }
            entry.value *= last.1[entry.row as usize % 3];
        }
        lit
    }

    /// All blocks of the sky's group, lit.
    pub fn lit_group(&self, group: &BlockLowRank) -> BlockLowRank {
        let mut lit = group.clone();
        lit.blocks.par_iter_mut().enumerate().for_each(|(idx, block)| {
            if let Some(block) = block.as_mut().filter(|block| block.sparse.iter().any(|e| e.col == self.column)) {
                let mut pixels = Vec::new();
                group.partition.bundles(idx, &mut pixels);
                *block = Arc::new(self.lit(block, &pixels));
            }
        });
        lit
    }

    /// Mean radiance of the sky over a pixel, nit where the column's coefficient is 1.
    fn pixel(&self, pixel: u32) -> Vec3 {
        let corner = Vec2::new((pixel % self.film.width) as f32, (pixel / self.film.width) as f32);
        let n = PIXEL_SAMPLES * PIXEL_SAMPLES;
        let sum = (0..n).fold(Vec3::ZERO, |sum, nth| {
            let within = Vec2::new((nth % PIXEL_SAMPLES) as f32, (nth / PIXEL_SAMPLES) as f32) + 0.5;
            let direction = self.camera.direction(self.film, corner + within / PIXEL_SAMPLES as f32);
            let sun = self.sun.filter(|(sun, _)| sun.contains(direction)).map_or(Vec3::ZERO, |(_, radiance)| radiance);
            sum + sun + self.map * self.light.map.radiance(self.turn.sky_from_world(direction))
        });
        sum / n as f32
    }
}

impl Bake {
    /// The factors as a relighter takes them under a rig: those of the bake, its sky shown sharply.
    pub fn groups_under(&self, rig: &LightRig) -> Vec<BlockLowRank> {
        let mut groups = self.groups.clone();
        if let Some(backdrop) = Backdrop::new(&self.header, rig) {
            groups[backdrop.group] = backdrop.lit_group(&groups[backdrop.group]);
        }
        groups
    }
}
