//! Lights that are flat parallelograms without texture, sixteen at a time: points on them, and what a plain diffuse surface
//! makes of their light.
//!
//! The same arithmetic for all of them, without a branch, so that the compiler can use vectors.
#![cfg_attr(
    target_arch = "x86_64",
    expect(
        unsafe_code,
        reason = "AVX2 behind run-time detection; `points_plain` is the safe twin with the same results"
    )
)]

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use super::{Pick, STEP};
use crate::emitters::{Emitter, Plate};

/// Lights that are weighed at once.
pub(super) const BATCH: usize = 16;

type Lanes = [f32; BATCH];

/// Coordinate by coordinate.
type Vectors = [Lanes; 3];

/// Up to sixteen lights side by side; slots that are not filled have no area.
pub(super) struct Batch {
    corner: Vectors,
    u_edge: Vectors,
    v_edge: Vectors,
    normal: Vectors,
    area: Lanes,
    /// 1 for lights that shine from both sides, else 0.
    both_sides: Lanes,
    inverse_rate: Lanes,
    /// Radiance of the white columns.
    white: [Vec3; BATCH],
}

/// A plain diffuse surface that looks at lights.
pub(super) struct Onlooker {
    pub position: Vec3,
    /// Unit normals on its outer side.
    pub geometric_normal: Vec3,
    pub shading_normal: Vec3,
    /// Walks that may meet the same lights.
    pub rivals: f32,
    /// Random offset of the lattice of points.
    pub jitter: [u32; 2],
}

/// A point on each light of a batch.
pub(super) struct Points<'a> {
    position: Vectors,
    /// Radiance of the white columns.
    pub white: &'a [Vec3; BATCH],
    /// Cosine at the surface, times the share of a connection, times radiance over density; 0 where nothing arrives.
    pub weight: Lanes,
}

impl Points<'_> {
    /// World-space point, m.
    #[inline]
    pub fn position(&self, slot: usize) -> Vec3 {
        Vec3::new(self.position[0][slot], self.position[1][slot], self.position[2][slot])
    }
}

impl Batch {
    /// The lights of up to sixteen picks; `None` if one of them is of another kind.
    #[inline]
    pub fn of(picks: &[Pick], plates: &[Option<Plate>]) -> Option<Batch> {
        const ZERO: Lanes = [0.0; BATCH];
        const ZEROS: Vectors = [ZERO; 3];
        let mut batch = Batch {
            corner: ZEROS,
            u_edge: ZEROS,
            v_edge: ZEROS,
            normal: ZEROS,
            area: ZERO,
            both_sides: ZERO,
            inverse_rate: ZERO,
            white: [Vec3::ZERO; BATCH],
        };
        for (slot, pick) in picks.iter().enumerate() {
            let plate = plates[pick.column as usize].as_ref()?;
            for axis in 0..3 {
                batch.corner[axis][slot] = plate.corner[axis];
                batch.u_edge[axis][slot] = plate.edges[0][axis];
                batch.v_edge[axis][slot] = plate.edges[1][axis];
                batch.normal[axis][slot] = plate.normal[axis];
            }
            batch.area[slot] = plate.area;
            batch.both_sides[slot] = f32::from(u8::from(plate.double_sided));
            batch.inverse_rate[slot] = pick.inverse_rate;
            batch.white[slot] = plate.white;
        }
        Some(batch)
    }

    /// A point on each light and its weight; `first` is the number of the first light at this surface.
    #[inline]
    pub fn points(&self, seen_from: &Onlooker, first: u32) -> Points<'_> {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: AVX2 was found.
            return unsafe { points_avx2(self, seen_from, first) };
        }
        self.points_plain(seen_from, first)
    }

    #[inline(always)]
    fn points_plain(&self, seen_from: &Onlooker, first: u32) -> Points<'_> {
        let Onlooker { position: eye, geometric_normal: ng, shading_normal: ns, rivals, jitter } = seen_from;
        let mut points = Points { position: [[0.0; BATCH]; 3], white: &self.white, weight: [0.0; BATCH] };
        for i in 0..BATCH {
            let unit = |axis: usize| {
                let lattice = jitter[axis].wrapping_add((first + i as u32).wrapping_mul(STEP[axis]));
                (lattice >> 8) as i32 as f32 * (1.0 / 16_777_216.0)
            };
            let (u, v) = (unit(0), unit(1));
            let at = |axis: usize| self.corner[axis][i] + self.u_edge[axis][i] * u + self.v_edge[axis][i] * v;
            let at = [at(0), at(1), at(2)];
            let [x, y, z] = [at[0] - eye.x, at[1] - eye.y, at[2] - eye.z];
            let closeness = 1.0 / (x * x + y * y + z * z);
            let per_length = closeness.sqrt();
            let [x, y, z] = [x * per_length, y * per_length, z * per_length];
            let cos_light = -(x * self.normal[0][i] + y * self.normal[1][i] + z * self.normal[2][i]);
            let cos_light = cos_light.max(cos_light.abs() * self.both_sides[i]);
            let spread = cos_light * self.area[i] * closeness * self.inverse_rate[i];
            let cos = x * ns.x + y * ns.y + z * ns.z;
            let above = x * ng.x + y * ng.y + z * ng.z;
            let ratio = cos * (FRAC_1_PI * rivals) * spread;
            let weight = cos * spread / (1.0 + ratio * ratio);
            let arrives = (cos_light > 0.0) & (cos > 0.0) & (above > 0.0) & (closeness < f32::MAX);
            points.weight[i] = if arrives { weight } else { 0.0 };
            points.position.iter_mut().zip(at).for_each(|(lanes, at)| lanes[i] = at);
        }
        points
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn points_avx2<'a>(batch: &'a Batch, seen_from: &Onlooker, first: u32) -> Points<'a> {
    batch.points_plain(seen_from, first)
}

/// The lights of all columns that are of this kind, by column.
pub(super) fn of_columns(emitters: &[Emitter], columns: impl Iterator<Item = (u32, [u16; 2])>) -> Vec<Option<Plate>> {
    let plate = |(source, texel): (u32, [u16; 2])| match &emitters[source as usize] {
        Emitter::Surface(surface) => surface.plate(),
        Emitter::Panel(panel) => panel.plate(texel),
        _ => None,
    };
    columns.map(plate).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{Rivals, area_point, jittered};
    use super::*;
    use crate::bsdf::Bsdf;
    use crate::sampler::{Sampler, uniform_sphere};

    #[test]
    fn many_lights_at_once_get_the_points_and_weights_of_single_ones() {
        let mut n_lit = 0;
        for case in 0..200 {
            let mut sampler = Sampler::new(7, case, 0);
            let mut place = || Vec3::new(sampler.next_1d(), sampler.next_1d(), sampler.next_1d()) * 2.0 - 1.0;
            let (eye, corner, u_edge, v_edge) = (place() * 2.0, place(), place() * 0.5, place() * 0.5);
            let (ng, normal) = (uniform_sphere(sampler.next_2d()), u_edge.cross(v_edge).normalize());
            let ns = (ng + uniform_sphere(sampler.next_2d()) * 0.3).normalize();
            let (area, double_sided) = (u_edge.cross(v_edge).length(), case % 3 == 0);
            let plate = Plate { corner, edges: [u_edge, v_edge], normal, area, double_sided, white: Vec3::ONE };
            let n_picks = 1 + (case as usize % BATCH);
            let picks = vec![Pick { column: 0, inverse_rate: 1.0 + case as f32 / 100.0 }; n_picks];
            let (rivals, jitter, first) =
                ((case % 5) as u32, [case as u32 * 77_777_777, 123_456_789], 16 * case as u32);
            let onlooker =
                Onlooker { position: eye, geometric_normal: ng, shading_normal: ns, rivals: rivals as f32, jitter };
            let batch = Batch::of(&picks, &[Some(plate)]).expect("all are plates");
            let (points, plain) = (batch.points(&onlooker, first), batch.points_plain(&onlooker, first));
            assert_eq!((points.position, points.weight), (plain.position, plain.weight), "case {case}");
            let white = Bsdf::white(ng, ns);
            for slot in 0..BATCH {
                let u = jittered(jitter, first + slot as u32);
                let target = corner + u_edge * u.x + v_edge * u.y;
                let light = area_point(eye, target, normal, double_sided, area, Vec3::ONE).filter(|_| slot < n_picks);
                let expected = light.map_or(0.0, |light| {
                    let rate = picks[0].inverse_rate;
                    let f_cos = Rivals::All { splits: rivals }.weigh(&white, light.wi, light.spread_sr * rate);
                    (f_cos * light.factor * rate).x / FRAC_1_PI
                });
                let off = (points.weight[slot] - expected).abs();
                assert!(off <= 1e-4 * expected.max(1e-6), "case {case}: {} is not {expected}", points.weight[slot]);
                assert!(slot >= n_picks || points.position(slot).distance(target) < 1e-5, "case {case}");
                n_lit += usize::from(expected > 0.0);
            }
        }
        assert!(n_lit > 200, "only {n_lit} points shine");
    }

    #[test]
    fn a_light_of_another_kind_makes_no_batch() {
        assert!(Batch::of(&[Pick { column: 0, inverse_rate: 1.0 }], &[None]).is_none());
    }
}
