//! Lamps that are tried before the bake, so that the columns of patches know what lamps do.
//!
//! They stand where walks passed, so in the open space around what is seen: points that shine all around, cones, flat lamps
//! that shine to one side, and parallel light.

use std::f32::consts::TAU;

use glam::Vec3;
use rayon::prelude::*;

use super::{PatchSample, cluster::Met};
use crate::light::luminance;
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

/// Irradiance that each lamp throws on each patch: row-major, patches × lamps.
pub(super) fn irradiance(
    scene: &PreparedScene,
    trials: &[Trial],
    (samples, first): (&[PatchSample], &[u32]),
    near_m: f32,
) -> Vec<f32> {
    let far_m = 4.0 * scene.diameter();
    let mut out = vec![0.0; (first.len() - 1) * trials.len()];
    out.par_chunks_mut(trials.len()).zip(first.par_windows(2)).for_each(|(out, range)| {
        for sample in &samples[range[0] as usize..range[1] as usize] {
            let arriving = trials.iter().enumerate();
            let arriving: Vec<(usize, f32, Vec3)> = arriving
                .filter_map(|(nth, trial)| {
                    let (light, target) = trial.arriving(sample, near_m, far_m)?;
                    Some((nth, light, target))
                })
                .collect();
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
