//! Lamps that are tried before the bake, so that the columns of patches know what lamps do.
//!
//! They stand where walks passed, so in the open space around what is seen: points that shine all around, cones, flat lamps
//! that shine to one side, and parallel light.

use std::f32::consts::TAU;

use glam::Vec3;
use rayon::prelude::*;

use super::{PatchSample, cluster::Met};
use crate::light::luminance;
use crate::plan::along_morton;
use crate::prepared::PreparedScene;
use crate::sampler::{Sampler, uniform_sphere};

/// A lamp without size.
#[derive(Clone, Copy, Debug)]
pub(super) struct Trial {
    shape: Shape,
    position: Vec3,
    /// Unit vector along which it shines.
    axis: Vec3,
}

#[derive(Clone, Copy, Debug)]
enum Shape {
    Point,
    /// Cosines of the half angles of the full intensity and of its end.
    Cone([f32; 2]),
    /// Its intensity falls with the cosine.
    Flat,
    Parallel,
}

/// Lamps whose visibility from a point is asked together.
const FAN: usize = 16;

impl Trial {
    /// The lamp that random numbers say, somewhere on one of some stretches of walks.
    pub fn draw(stretches: &[[Vec3; 2]], met: &[Met], sampler: &mut Sampler) -> Trial {
        let (kind, [u, v], [aim, tilt]) = (sampler.next_1d(), sampler.next_2d(), sampler.next_2d());
        let [from, to] = stretches[((u * stretches.len() as f32) as usize).min(stretches.len() - 1)];
        let position = from.lerp(to, 0.02 + 0.96 * v);
        let target = met[((aim * met.len() as f32) as usize).min(met.len() - 1)].position;
        let axis = (target - position).normalize_or(Vec3::NEG_Y);
        let shape = match kind {
            ..0.5 => Shape::Point,
            ..0.7 => {
                let outer = TAU / 24.0 * (1.0 + 2.0 * tilt);
                Shape::Cone([(0.8 * outer).cos(), outer.cos()])
            }
            ..0.9 => Shape::Flat,
            _ => Shape::Parallel,
        };
        // Parallel light comes from anywhere.
        let axis = if matches!(shape, Shape::Parallel) { uniform_sphere([aim, tilt]) } else { axis };
        Trial { shape, position, axis }
    }

    /// Irradiance at a point that sees the lamp, and where to look for it; nearer than `near_m` it grows no more.
    fn arriving(&self, sample: &PatchSample, near_m: f32, far_m: f32) -> Option<(f32, Vec3)> {
        let (to_lamp, fall) = match self.shape {
            Shape::Parallel => (-self.axis * far_m, 1.0),
            _ => {
                let to_lamp = self.position - sample.position;
                (to_lamp, 1.0 / (to_lamp.length_squared() + near_m * near_m))
            }
        };
        let wi = to_lamp.normalize_or_zero();
        let cos_axis = -wi.dot(self.axis);
        let intensity = match self.shape {
            Shape::Point | Shape::Parallel => 1.0,
            Shape::Cone([inner, outer]) => ((cos_axis - outer) / (inner - outer)).clamp(0.0, 1.0).powi(2),
            Shape::Flat => cos_axis.max(0.0),
        };
        let cos = wi.dot(sample.normal);
        let light = intensity * fall * cos * sample.response(cos.max(0.0));
        (light > 0.0).then_some((light, sample.position + to_lamp))
    }
}

/// Lamps in an order in which neighbors shine from about the same place, parallel light last and by where it comes from.
fn along_a_curve(trials: &[Trial]) -> Vec<usize> {
    let places = || trials.iter().map(|trial| trial.position);
    let low = places().fold(Vec3::INFINITY, Vec3::min);
    let side = (places().fold(Vec3::NEG_INFINITY, Vec3::max) - low).max_element().max(f32::MIN_POSITIVE);
    let along = |at: Vec3| along_morton((at * 1023.0).to_array().map(|x| x.clamp(0.0, 1023.0) as u32));
    let key = |trial: &Trial| match trial.shape {
        Shape::Parallel => (true, along((trial.axis + Vec3::ONE) / 2.0)),
        _ => (false, along((trial.position - low) / side)),
    };
    let mut order: Vec<usize> = (0..trials.len()).collect();
    order.sort_by_cached_key(|&nth| key(&trials[nth]));
    order
}

/// Irradiance that each lamp throws on each patch: row-major, patches × lamps.
pub(super) fn irradiance(
    scene: &PreparedScene,
    trials: &[Trial],
    (samples, first): (&[PatchSample], &[u32]),
    near_m: f32,
) -> Vec<f32> {
    let far_m = 4.0 * scene.diameter();
    // Rays to neighbors pass the same places, so that a fan of them costs little more than one.
    let order = along_a_curve(trials);
    let mut out = vec![0.0; (first.len() - 1) * trials.len()];
    out.par_chunks_mut(trials.len()).zip(first.par_windows(2)).for_each(|(out, range)| {
        for sample in &samples[range[0] as usize..range[1] as usize] {
            let arriving = |&nth: &usize| {
                let (light, target) = trials[nth].arriving(sample, near_m, far_m)?;
                Some((nth, light, target))
            };
            let arriving: Vec<(usize, f32, Vec3)> = order.iter().filter_map(arriving).collect();
            for fan in arriving.chunks(FAN) {
                let (mut targets, mut passed) = ([Vec3::ZERO; FAN], [Vec3::ZERO; FAN]);
                fan.iter().zip(&mut targets).for_each(|((.., from), target)| *target = *from);
                scene.transmittance16(sample.position, &targets, fan.len(), &mut passed);
                for ((nth, light, _), passed) in fan.iter().zip(passed) {
                    out[*nth] += light * luminance(passed) * sample.weight;
                }
            }
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbors_along_the_curve_shine_from_near_each_other() {
        let met = [Met { position: Vec3::ZERO, normal: Vec3::Y, weight: 1.0, grazing: 0.0 }];
        let stretches = [[Vec3::splat(-1.0), Vec3::ONE], [Vec3::X, Vec3::new(-1.0, 1.0, 1.0)]];
        let trials: Vec<Trial> =
            (0..256).map(|nth| Trial::draw(&stretches, &met, &mut Sampler::new(1, 2, nth))).collect();
        let order = along_a_curve(&trials);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..256).collect::<Vec<_>>());
        let apart = |a: usize, b: usize| match [trials[a].shape, trials[b].shape] {
            [Shape::Parallel, Shape::Parallel] => trials[a].axis.distance(trials[b].axis),
            [Shape::Parallel, _] | [_, Shape::Parallel] => 0.0,
            _ => trials[a].position.distance(trials[b].position),
        };
        let along: f32 = order.windows(2).map(|w| apart(w[0], w[1])).sum();
        let drawn: f32 = (1..256).map(|nth| apart(nth - 1, nth)).sum();
        assert!(along < 0.3 * drawn, "{along} m along the curve, {drawn} m as drawn");
        let n_parallel = order.iter().rev().take_while(|nth| matches!(trials[**nth].shape, Shape::Parallel)).count();
        let n_all = trials.iter().filter(|trial| matches!(trial.shape, Shape::Parallel)).count();
        assert_eq!(n_parallel, n_all, "parallel light is last");
    }
}
