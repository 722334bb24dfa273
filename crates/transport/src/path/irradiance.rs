//! The light that arrives at a point, from all directions on one side, weighed by the cosine.
//!
//! Irradiance is π times the radiance of a white diffuse surface in the same place, so it is measured with one: the same
//! connections, the same weights, the same walks as any diffuse surface of the picture.

use std::f32::consts::PI;

use glam::Vec3;

use super::{Deposit, Gathering, Integrator, LightPlan, Rivals, Scratch, Vertex, Walk};
use crate::bsdf::{Bsdf, ScatterKind};
use crate::bvh::Ray;
use crate::clearance::{offset_origin, rounding};
use crate::prepared::{PreparedScene, SurfaceHit, next_after};
use crate::sampler::Sampler;

/// A point that light arrives at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Receiver {
    /// World-space point in meters.
    pub position: Vec3,
    /// Unit normal of the side that counts.
    pub outward: Vec3,
    /// Unit normal that cosines are taken against, on the same side.
    pub normal: Vec3,
    /// See [`SurfaceHit::clearance`]; of a point in space that of a surface that may lie there.
    pub clearance: f32,
    /// Extinction of the solid that light comes through to it, 1/m.
    pub extinction: Vec3,
}

impl Receiver {
    /// A point of a plane with a unit normal. A surface of some clearance may lie in that, m.
    pub(crate) fn on_plane(position: Vec3, normal: Vec3, clearance: f32) -> Receiver {
        Receiver { position, outward: normal, normal, clearance, extinction: Vec3::ZERO }
    }

    /// Where rays to its side begin.
    pub(crate) fn origin(&self, scene: &PreparedScene) -> Vec3 {
        let clearance = self.clearance_in(scene);
        offset_origin(self.position + self.outward * clearance, self.outward, scene.extent())
    }

    /// Its clearance, and at least that of its coordinates.
    fn clearance_in(&self, scene: &PreparedScene) -> f32 {
        self.clearance.max(rounding(self.position, self.outward, scene.extent()))
    }
}

/// Mirrors and panes that a pixel looks through.
const MOST_MIRRORS: usize = 16;

impl<P: LightPlan> Integrator<'_, P> {
    /// One sample of the irradiance of the surface that a camera ray finds; nothing where it finds none.
    pub(crate) fn sample_seen_irradiance(
        &self,
        ray: (Vec3, Vec3),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) {
        if let Some(receiver) = self.seen_receiver(ray, sampler) {
            self.sample_irradiance(&receiver, sampler, scratch, deposit);
        }
    }

    /// One sample of the irradiance of a point, lux of each column's unit.
    pub(crate) fn sample_irradiance(
        &self,
        at: &Receiver,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) {
        let (mut walk, hit, white) = self.receive(at);
        if self.go_on_from(&mut walk, (&hit, &white), sampler, scratch, deposit) {
            self.follow(walk, sampler, scratch, deposit);
        }
    }

    /// One sample of the irradiance of the surface that a camera ray finds without the light that other surfaces send, which is
    /// left to be gathered; nothing where the ray finds none.
    pub(crate) fn sample_direct_irradiance(
        &self,
        ray: (Vec3, Vec3),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) -> Option<Gathering> {
        let receiver = self.seen_receiver(ray, sampler)?;
        // What is gathered knows nothing of a solid around the surface that attenuates.
        if receiver.extinction != Vec3::ZERO {
            self.sample_irradiance(&receiver, sampler, scratch, deposit);
            return None;
        }
        let (walk, hit, white) = self.receive(&receiver);
        self.connect(&walk, (Vertex::First, Rivals::Parts), (&hit, &white), sampler, scratch, deposit);
        let walk = Walk { sampled_at: Some(Vertex::First), ..walk };
        if let Some(sample) = white.sample_base(sampler.next_1d(), sampler.next_2d()) {
            self.meet_emitter(walk, (&hit, &sample), sampler, deposit);
        }
        self.gather_caustics(&walk, (&hit, &white), sampler, scratch, deposit);
        Some(Gathering { hit, normal: receiver.normal, albedo: walk.throughput })
    }

    /// A walk that has come to a point where a white surface measures what arrives, and that surface.
    fn receive(&self, at: &Receiver) -> (Walk, SurfaceHit, Bsdf) {
        // The surface that measures is not one of the scene: of the triangle nothing is ever asked.
        let (triangle, barycentric) = (u32::MAX, Vec3::ZERO);
        let (position, normal, extent) = (at.position, at.outward, self.scene.extent());
        let clearance = at.clearance_in(self.scene);
        let hit = SurfaceHit { triangle, t: 0.0, position, barycentric, normal, clearance, extent };
        let mut walk = Walk::from_camera(at.position, -at.outward);
        (walk.throughput, walk.share, walk.n_hits) = (Vec3::splat(PI), PI, 1);
        walk.extinction = at.extinction;
        (walk, hit, Bsdf::white(at.outward, at.normal))
    }

    /// The first surface with a diffuse base, black or not: straight on through clear panes, and by way of mirrors and of
    /// glass that bends.
    pub(crate) fn seen_receiver(&self, (origin, direction): (Vec3, Vec3), sampler: &mut Sampler) -> Option<Receiver> {
        let mut ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
        let mut extinction = Vec3::ZERO;
        for _ in 0..MOST_MIRRORS {
            let hit = self.closest_seen(&ray, sampler)?;
            let material = self.scene.material(hit.triangle);
            if material.unlit {
                return None;
            }
            let outward = hit.outward(-ray.direction);
            if self.scene.has_diffuse_base(&hit) {
                let normal = self.scene.smooth_normal(&hit, ray.direction);
                let (position, clearance) = (hit.position, hit.clearance);
                return Some(Receiver { position, outward, normal, clearance, extinction });
            }
            let bsdf = self.scene.bsdf(&hit, -ray.direction);
            if self.scene.is_clear_pane(hit.triangle) && bsdf.straight_through() != Vec3::ZERO {
                ray.t_min = next_after(hit.t);
                continue;
            }
            let sample = bsdf.sample(sampler.next_1d(), sampler.next_2d())?;
            if bsdf.has_smooth_lobes() || sample.kind == ScatterKind::Smooth {
                return None;
            }
            if sample.transmitted {
                let from_back = sample.wi.dot(hit.normal) >= 0.0;
                extinction = self.scene.extinction_behind(hit.triangle, from_back, extinction);
            }
            let side = if sample.transmitted { -outward } else { outward };
            let origin = hit.origin(side);
            ray = Ray { origin, direction: sample.wi, t_min: 0.0, t_max: f32::INFINITY };
        }
        None
    }
}
