//! Walks that leave the scene, and connections to what lies beyond it.

use glam::{Vec2, Vec3};

use super::{Deposit, Integrator, LightPlan, LightPoint, Walk, power_heuristic};
use crate::emitters::{Emitter, Lighting};

/// Indices of the sources that a walk may meet behind all surfaces.
pub(super) fn sources_beyond(lighting: &Lighting) -> Vec<u32> {
    let is_beyond = |emitter: &Emitter| {
        matches!(emitter, Emitter::Sky | Emitter::Environment(_) | Emitter::Dome(_) | Emitter::Sun(_))
    };
    (0u32..).zip(&lighting.emitters).filter(|(_, e)| is_beyond(e)).map(|(idx, _)| idx).collect()
}

impl<P: LightPlan> Integrator<'_, P> {
    /// Collects what shines where a walk meets no surface.
    pub(super) fn collect_beyond(&self, walk: &Walk, deposit: &mut impl Deposit) {
        for &source in &self.beyond {
            let columns = &self.scene.lighting.basis.sources[source as usize].columns;
            match &self.scene.lighting.emitters[source as usize] {
                Emitter::Environment(map) => {
                    let weight = self.arrival_weight(walk, columns.start, || map.pdf(walk.direction));
                    deposit.scattered(columns.start, walk.carried() * map.radiance(walk.direction) * weight);
                }
                Emitter::Dome(_) if walk.specular && walk.straight => deposit.seen(columns.end - 1, walk.carried()),
                Emitter::Dome(emitter) => {
                    let (patch, pdf) = emitter.place(walk.direction);
                    self.arrive_at(walk, columns.start + patch, || pdf, walk.carried(), deposit);
                }
                Emitter::Sun(sun) if sun.contains(walk.direction) => {
                    let pdf = || sun.pdf();
                    self.arrive_at(walk, columns.start, pdf, walk.carried() * sun.radiance(), deposit);
                }
                Emitter::Sky => deposit.scattered(columns.start, walk.carried()),
                _ => {}
            }
        }
    }

    fn arrive_at(&self, walk: &Walk, column: u32, pdf: impl FnOnce() -> f32, value: Vec3, deposit: &mut impl Deposit) {
        if walk.specular {
            deposit.seen(column, value);
            if let Some((whole, radiance)) = self.sky_as_baked(column, walk.direction) {
                deposit.seen(whole, value * radiance);
            }
        } else {
            self.give(column, walk.direction, value * self.arrival_weight(walk, column, pdf), deposit);
        }
    }

    /// Hands out the light of a column that arrives from a direction: of a patch of the sky that of the map as well.
    #[inline]
    pub(super) fn give(&self, column: u32, toward: Vec3, value: Vec3, deposit: &mut impl Deposit) {
        deposit.scattered(column, value);
        if let Some((whole, radiance)) = self.sky_as_baked(column, toward) {
            deposit.scattered(whole, value * radiance);
        }
    }

    /// For a patch of the sky: the column of the map as it is baked, and its radiance where a direction points.
    #[inline]
    pub(super) fn sky_as_baked(&self, column: u32, toward: Vec3) -> Option<(u32, Vec3)> {
        let (patches, emitter) = self.dome.as_ref()?;
        patches.contains(&column).then(|| (patches.end, emitter.radiance(toward.normalize())))
    }

    /// Share of a walk that met the sky by itself, against the connections to it; `pdf` is their solid-angle density.
    fn arrival_weight(&self, walk: &Walk, column: u32, pdf: impl FnOnce() -> f32) -> f32 {
        match walk.rival {
            Some(vertex) if walk.density > 0.0 && self.is_connected_beyond(walk) => {
                power_heuristic(walk.density, self.plan.rate(vertex, column) * pdf())
            }
            _ => 1.0,
        }
    }

    /// A direction towards a column of the sky; `None` for what only the camera sees.
    pub(super) fn sky_point(&self, emitter: &Emitter, nth: u32, position: Vec3, u: Vec2) -> Option<LightPoint> {
        let mut shining = 0.0;
        let (wi, pdf, radiance) = match emitter {
            Emitter::Environment(map) => {
                let (wi, pdf) = map.sample(u);
                (wi, pdf, map.radiance(wi))
            }
            Emitter::Dome(emitter) if nth < emitter.dome.n_patches() => {
                let (wi, pdf) = emitter.sample(nth, u);
                shining = emitter.shining(nth, pdf);
                (wi, pdf, Vec3::ONE)
            }
            Emitter::Sun(sun) => (sun.sample(u), sun.pdf(), Vec3::splat(sun.radiance())),
            _ => return None,
        };
        Some(LightPoint {
            target: position + wi * self.far,
            wi,
            factor: radiance / pdf,
            spread_sr: 1.0 / pdf,
            beyond: true,
            shining,
        })
    }
}
