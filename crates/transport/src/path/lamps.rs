//! Bodies of free lamps: walks collect what they shine with, and go on as if nothing were there.

use glam::Vec3;

use super::{Deposit, Integrator, LightPlan, Walk, power_heuristic};
use crate::emitters::{Emitter, Lighting};
use crate::lamps::Body;

/// The bodies of lamps, each with its column.
pub(super) fn bodies(lighting: &Lighting) -> Vec<(u32, Body)> {
    let sources = lighting.basis.sources.iter().zip(&lighting.emitters);
    let body = |(source, emitter): (&crate::basis::LightSource, &Emitter)| match emitter {
        Emitter::Lamp(lamp) => lamp.body().map(|body| (source.columns.start, *body)),
        _ => None,
    };
    sources.filter_map(body).collect()
}

impl<P: LightPlan> Integrator<'_, P> {
    /// Collects what bodies shine before the walk meets a surface at `t_max`.
    pub(super) fn collect_bodies(&self, walk: &Walk, t_max: f32, deposit: &mut impl Deposit) {
        for (column, body) in &self.bodies {
            let Some((t, point)) = body.meet(walk.origin, walk.direction, t_max) else { continue };
            let mut value = walk.carried();
            if walk.extinction != Vec3::ZERO {
                value *= (-walk.extinction * t).exp();
            }
            if walk.specular {
                deposit.seen(*column, value);
                continue;
            }
            let weight = match walk.rival {
                Some(vertex) if walk.density > 0.0 => {
                    self.closeness(walk, t, point.position).map_or(1.0, |closeness| {
                        let pdf = 1.0 / (-point.normal.dot(walk.direction) * body.area() * closeness);
                        power_heuristic(walk.density, self.plan.rate(vertex, *column) * pdf)
                    })
                }
                _ => 1.0,
            };
            deposit.scattered(*column, value * weight);
        }
    }
}
