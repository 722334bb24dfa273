//! Lights that are flat parallelograms without texture, sixteen at a time: points on them, and what a surface that only
//! reflects makes of their light.
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

use super::{Pick, Rivals, STEP, share_against};
use crate::bsdf::{BsdfLanes, LANES, Lanes, Scattered, Vectors};
use crate::emitters::{Emitter, Plate};

/// Lights that are weighed at once.
pub(super) const BATCH: usize = LANES;

/// So many of a batch are weighed faster together than one by one.
const LEAST: usize = 3;

/// Up to sixteen lights side by side; slots of other lights, and those that are not filled, have no area.
pub(super) struct Batch {
    /// Bit i is set where slot i is filled.
    filled: u32,
    corner: Vectors,
    u_edge: Vectors,
    v_edge: Vectors,
    normal: Vectors,
    area: Lanes,
    /// 1 for lights that shine from both sides, else 0.
    both_sides: Lanes,
    inverse_rate: Lanes,
    /// Radiance of the white columns, by channel.
    white: Vectors,
}

/// A surface that looks at lights.
pub(super) struct Onlooker {
    pub position: Vec3,
    pub surface: BsdfLanes,
    /// Walks that may meet the same lights.
    pub rivals: Rivals,
    /// What multiplies the light that arrives.
    pub carried: Vec3,
    /// Random offset of the lattice of points.
    pub jitter: [u32; 2],
}

/// A point on each light of a batch.
pub(super) struct Points {
    position: Vectors,
    /// What the surface sends to its viewer, the share of a connection, over density, times what the walk carries.
    arriving: Vectors,
    /// Bit i is set where something arrives from slot i.
    pub lit: u32,
}

impl Points {
    /// World-space point, m.
    #[inline]
    pub fn position(&self, slot: usize) -> Vec3 {
        Vec3::new(self.position[0][slot], self.position[1][slot], self.position[2][slot])
    }

    /// What the walk brings from there if nothing is in the way, by channel; zero where nothing arrives.
    #[inline]
    pub fn arriving(&self, slot: usize) -> Vec3 {
        Vec3::new(self.arriving[0][slot], self.arriving[1][slot], self.arriving[2][slot])
    }
}

impl Batch {
    /// The lights of up to sixteen picks; `None` where so few are of this kind that one by one is faster.
    #[inline]
    pub fn of(picks: &[Pick], plates: &[Option<Plate>]) -> Option<Batch> {
        const ZERO: Lanes = [0.0; BATCH];
        const ZEROS: Vectors = [ZERO; 3];
        let mut batch = Batch {
            filled: 0,
            corner: ZEROS,
            u_edge: ZEROS,
            v_edge: ZEROS,
            normal: ZEROS,
            area: ZERO,
            both_sides: ZERO,
            inverse_rate: ZERO,
            white: ZEROS,
        };
        for (slot, pick) in picks.iter().enumerate() {
            let Some(plate) = &plates[pick.column as usize] else { continue };
            batch.filled |= 1 << slot;
            for axis in 0..3 {
                batch.corner[axis][slot] = plate.corner[axis];
                batch.u_edge[axis][slot] = plate.edges[0][axis];
                batch.v_edge[axis][slot] = plate.edges[1][axis];
                batch.normal[axis][slot] = plate.normal[axis];
            }
            batch.area[slot] = plate.area;
            batch.both_sides[slot] = f32::from(u8::from(plate.double_sided));
            batch.inverse_rate[slot] = pick.inverse_rate;
            for channel in 0..3 {
                batch.white[channel][slot] = plate.white[channel];
            }
        }
        (batch.filled.count_ones() as usize >= LEAST.min(picks.len())).then_some(batch)
    }

    /// Whether all picks that it could have are lights of the batch.
    #[inline]
    pub fn is_full(&self) -> bool {
        self.filled == (1 << BATCH) - 1
    }

    /// Whether a pick is a light of the batch.
    #[inline]
    pub fn holds(&self, slot: usize) -> bool {
        self.filled >> slot & 1 == 1
    }

    /// A point on each light and its weight; `first` is the number of the first light at this surface.
    #[inline]
    pub fn points(&self, seen_from: &Onlooker, first: u32) -> Points {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: AVX2 was found.
            return unsafe { points_avx2(self, seen_from, first) };
        }
        self.points_plain(seen_from, first)
    }

    #[inline(always)]
    fn points_plain(&self, seen_from: &Onlooker, first: u32) -> Points {
        let Onlooker { position: eye, surface, rivals, carried, jitter } = seen_from;
        let (mut position, mut toward, mut spread) = ([[0.0; BATCH]; 3], [[0.0; BATCH]; 3], [0.0; BATCH]);
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
            let seen = cos_light * self.area[i] * closeness * self.inverse_rate[i];
            let arrives = (cos_light > 0.0) & (closeness < f32::MAX);
            spread[i] = if arrives { seen } else { 0.0 };
            position.iter_mut().zip(at).for_each(|(lanes, at)| lanes[i] = at);
            toward.iter_mut().zip([x, y, z]).for_each(|(lanes, at)| lanes[i] = at);
        }
        let mut arriving = match surface {
            BsdfLanes::Matte(matte) => {
                let [value, cosines] = matte.scattered(&toward);
                let rivals = rivals.of_base();
                let mut weight = [0.0; BATCH];
                for i in 0..BATCH {
                    let share = share_against(cosines[i] * (FRAC_1_PI * rivals) * spread[i]);
                    weight[i] = masked(value[i] * spread[i] * share, spread[i]);
                }
                tinted(&weight, matte.lambert)
            }
            BsdfLanes::Layered(layered) => rivals.weigh_lanes(&layered.scattered(&toward), layered.lambert, &spread),
        };
        let mut brightest = [0.0; BATCH];
        for (channel, lanes) in arriving.iter_mut().enumerate() {
            for i in 0..BATCH {
                lanes[i] *= self.white[channel][i] * carried[channel];
                brightest[i] = lanes[i].max(brightest[i]);
            }
        }
        let mut lit = 0;
        for (i, value) in brightest.iter().enumerate() {
            lit |= u32::from(*value > 0.0) << i;
        }
        Points { position, arriving, lit }
    }
}

/// A value, or 0 where no light comes: there a direction may be no number.
#[inline(always)]
fn masked(value: f32, spread: f32) -> f32 {
    if spread > 0.0 { value } else { 0.0 }
}

/// A color times each weight.
#[inline(always)]
fn tinted(weight: &Lanes, color: Vec3) -> Vectors {
    let mut tinted = [*weight; 3];
    for (lanes, factor) in tinted.iter_mut().zip(<[f32; 3]>::from(color)) {
        lanes.iter_mut().for_each(|value| *value *= factor);
    }
    tinted
}

impl Rivals {
    /// Walks by a diffuse base that may meet the lights that it is connected to.
    #[inline(always)]
    fn of_base(self) -> f32 {
        match self {
            Rivals::All { splits } => splits as f32,
            Rivals::Parts => 1.0,
            Rivals::CoatAlone => 0.0,
        }
    }

    /// [`Rivals::weigh`] of each lane, times its `spread`; `lambert` is the albedo of the base over π.
    #[inline(always)]
    fn weigh_lanes(self, seen: &Scattered, lambert: Vec3, spread: &Lanes) -> Vectors {
        let (mut base_weight, mut coat_weight) = ([0.0; BATCH], [0.0; BATCH]);
        // Of one number of walks by all lobes, or of a walk by each part.
        let (splits, apart) = if let Rivals::All { splits } = self { (splits as f32, false) } else { (1.0, true) };
        let base_counts = f32::from(u8::from(!matches!(self, Rivals::CoatAlone)));
        for i in 0..BATCH {
            let both = (seen.base_pdf[i] + seen.coat_pdf[i]) * splits;
            let [of_base, of_coat] = if apart { [seen.base_pdf[i], seen.coat_pdf[i]] } else { [both; 2] };
            coat_weight[i] = share_against(of_coat * spread[i]) * spread[i];
            let share = share_against(of_base * spread[i]) * spread[i];
            base_weight[i] = masked(seen.base[i] * share * base_counts, spread[i]);
        }
        let mut arriving = tinted(&base_weight, lambert);
        for (arriving, coat) in arriving.iter_mut().zip(&seen.coat) {
            for i in 0..BATCH {
                arriving[i] += masked(coat[i] * coat_weight[i], spread[i]);
            }
        }
        arriving
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn points_avx2(batch: &Batch, seen_from: &Onlooker, first: u32) -> Points {
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
    use super::super::{area_point, jittered};
    use super::*;
    use crate::bsdf::tests::WHITE;
    use crate::bsdf::{Bsdf, SurfaceParams};
    use crate::sampler::{Sampler, uniform_sphere};

    fn surfaces(case: u64, ng: Vec3, ns: Vec3, wo: Vec3) -> [Bsdf; 4] {
        let params = SurfaceParams {
            base_color: Vec3::new(0.9, 0.7, 0.5),
            metallic: [0.0, 0.4, 1.0][case as usize % 3],
            roughness: [0.1, 0.4, 1.0][case as usize / 3 % 3],
            ..WHITE
        };
        let whole = Bsdf::new(&params, ng, ns, wo);
        let matte = whole.matte().filter(|matte| matte.seen_share(wo) > 0.0).unwrap_or(Bsdf::white(ng, ns));
        let rest = whole.without(&matte, wo).unwrap_or(Bsdf::white(ng, ns));
        [Bsdf::white(ng, ns), whole, matte, rest]
    }

    #[test]
    fn many_lights_at_once_get_the_points_and_weights_of_single_ones() {
        let mut n_lit = 0;
        for case in 0..200 {
            let mut sampler = Sampler::new(7, case, 0);
            let mut place = || Vec3::new(sampler.next_1d(), sampler.next_1d(), sampler.next_1d()) * 2.0 - 1.0;
            let (eye, corner, u_edge, v_edge) = (place() * 2.0, place(), place() * 0.5, place() * 0.5);
            let (ng, normal) = (uniform_sphere(sampler.next_2d()), u_edge.cross(v_edge).normalize());
            let ns = (ng + uniform_sphere(sampler.next_2d()) * 0.3).normalize();
            let wo = (ng + uniform_sphere(sampler.next_2d()) * 0.9).normalize();
            let (area, double_sided) = (u_edge.cross(v_edge).length(), case % 3 == 0);
            let plate = Plate { corner, edges: [u_edge, v_edge], normal, area, double_sided, white: Vec3::ONE };
            let n_picks = 1 + (case as usize % BATCH);
            let picks = vec![Pick { column: 0, inverse_rate: 1.0 + case as f32 / 100.0 }; n_picks];
            let (jitter, first) = ([case as u32 * 77_777_777, 123_456_789], 16 * case as u32);
            let batch = Batch::of(&picks, &[Some(plate)]).expect("all are plates");
            for (kind, bsdf) in surfaces(case, ng, ns, wo).iter().enumerate() {
                let rivals = [Rivals::All { splits: case as u32 % 5 }, Rivals::Parts, Rivals::CoatAlone];
                // Only whole surfaces are asked for a part of their walks.
                let rivals = if kind == 1 { rivals[case as usize / 9 % 3] } else { rivals[0] };
                let surface = bsdf.lanes().expect("it only reflects");
                let carried = Vec3::new(0.5, 1.0, 2.0);
                let onlooker = Onlooker { position: eye, surface, rivals, carried, jitter };
                let (points, plain) = (batch.points(&onlooker, first), batch.points_plain(&onlooker, first));
                assert_eq!((points.position, points.arriving), (plain.position, plain.arriving), "case {case}");
                assert_eq!(points.lit, plain.lit, "case {case}");
                for slot in 0..BATCH {
                    let u = jittered(jitter, first + slot as u32);
                    let target = corner + u_edge * u.x + v_edge * u.y;
                    let light =
                        area_point(eye, target, normal, double_sided, area, Vec3::ONE).filter(|_| slot < n_picks);
                    let expected = light.map_or(Vec3::ZERO, |light| {
                        let rate = picks[0].inverse_rate;
                        carried * rivals.weigh(bsdf, light.wi, light.spread_sr * rate) * light.factor * rate
                    });
                    let (got, largest) = (points.arriving(slot), expected.max_element());
                    let off = (got - expected).abs().max_element();
                    assert!(off <= 1e-3 * largest.max(1e-5), "case {case}, {kind}: {got} is not {expected}");
                    assert!(slot >= n_picks || points.position(slot).distance(target) < 1e-5, "case {case}");
                    assert_eq!(points.lit >> slot & 1 == 1, got.max_element() > 0.0, "case {case}, {kind}");
                    n_lit += usize::from(largest > 0.0);
                }
            }
        }
        assert!(n_lit > 800, "only {n_lit} points shine");
    }

    #[test]
    fn lights_of_another_kind_are_left_to_others() {
        let edges = [Vec3::X, Vec3::Z];
        let plate =
            Plate { corner: Vec3::Y, edges, normal: -Vec3::Y, area: 1.0, double_sided: false, white: Vec3::ONE };
        let plates = [None, Some(plate)];
        let picks = |columns: &[u32]| -> Vec<Pick> {
            columns.iter().map(|&column| Pick { column, inverse_rate: 1.0 }).collect()
        };
        assert!(Batch::of(&picks(&[0]), &plates).is_none());
        assert!(Batch::of(&picks(&[0, 0, 0, 1, 1]), &plates).is_none());
        let batch = Batch::of(&picks(&[1, 0, 1, 1]), &plates).expect("most are plates");
        assert_eq!([0, 1, 2, 3, 4].map(|slot| batch.holds(slot)), [true, false, true, true, false]);
        let surface = Bsdf::white(Vec3::Y, Vec3::Y).lanes().expect("it is matt");
        let rivals = Rivals::All { splits: 1 };
        let (position, carried) = (Vec3::ZERO, Vec3::ONE);
        let points = batch.points(&Onlooker { position, surface, rivals, carried, jitter: [0; 2] }, 0);
        assert_eq!(points.lit, 0b1101, "only lights of the batch arrive");
    }
}
