//! Walks that share their indirect light: what a pixel sees itself, and what a node gathers for all pixels around it.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use super::caustics::Guides;
use super::{Deposit, Integrator, KnownAt, LightPlan, Rivals, Scratch, Vertex, Walk};
use crate::bsdf::{Bsdf, BsdfSample};
use crate::bvh::Ray;
use crate::prepared::{SurfaceHit, next_after};
use crate::sampler::{Sampler, cosine_around};

/// A point whose diffuse base scatters the light of other surfaces, which is left to be gathered.
pub(crate) struct Gathering {
    /// Where.
    pub hit: SurfaceHit,
    /// Unit normal on the viewer's side, without normal map.
    pub normal: Vec3,
    /// What multiplies the gathered light.
    pub albedo: Vec3,
}

/// Whose light a walk gathers that leaves a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Onto {
    /// That of somebody who looks for caustics by walks of another kind.
    Pixel,
    /// That of a point for which it is the only one.
    Point,
    /// The same of a point of a cell, which walks see from a surface of their own.
    Cell,
}

/// Density of a walk that gathers: emitters that whoever asks has sampled count next to nothing beside it.
const GATHERED: f32 = f32::MIN_POSITIVE;

/// Light of casters, beside a white sky, that hardly shows.
const LITTLE: f32 = 1.0 / 64.0;

/// Clear panes that a node looks through.
const PANES: usize = 8;

impl<P: LightPlan> Integrator<'_, P> {
    /// One sample of a pixel without the light that other surfaces send to the diffuse base of the first surface that has
    /// one, after mirrors and panes. Coats and surfaces without such a base are followed as ever.
    pub(crate) fn sample_direct(
        &self,
        (origin, direction): (Vec3, Vec3),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) -> Option<Gathering> {
        let mut walk = Walk::from_camera(origin, direction);
        loop {
            let hit = self.arrive(&mut walk, sampler, deposit)?;
            let bsdf = self.scene.bsdf(&hit, -walk.direction);
            let albedo = bsdf.base_albedo() * walk.throughput;
            // Gathered light has left the first surface: where bounces are counted, it would have too many behind a mirror.
            let is_gathered = walk.n_hits == 1 || self.bounces == u32::MAX;
            // Nor does it know of a solid around the surface that attenuates.
            let is_gathered = is_gathered && walk.extinction == Vec3::ZERO;
            if albedo != Vec3::ZERO && is_gathered && !self.is_spent(&walk) {
                self.connect(&walk, (Vertex::First, Rivals::Parts), (&hit, &bsdf), sampler, scratch, deposit);
                walk.sampled_at = Some(Vertex::First);
                let normal = self.scene.smooth_normal(&hit, walk.direction);
                self.gather_caustics(&walk, (&hit, &bsdf), sampler, scratch, deposit);
                let (u_lobe, u) = (sampler.next_1d(), sampler.next_2d());
                if let Some(sample) = bsdf.sample_base(u_lobe, u) {
                    self.meet_emitter(walk, (&hit, &sample), sampler, deposit);
                } else if let Some(sample) = bsdf.sample_coat(u_lobe, u)
                    && self.leave(&mut walk, &hit, &sample, 1)
                {
                    self.follow(walk, sampler, scratch, deposit);
                }
                return Some(Gathering { hit, normal, albedo });
            }
            if !self.go_on(&mut walk, &hit, sampler, scratch, deposit) {
                return None;
            }
            if !walk.specular {
                self.follow(walk, sampler, scratch, deposit);
                return None;
            }
        }
    }

    /// Deposits the emitters that a ray meets which leaves a diffuse base, as far as connections compete with it: close to an
    /// emitter these are noisy. The rest of what it meets is gathered.
    pub(super) fn meet_emitter(
        &self,
        mut walk: Walk,
        (hit, sample): (&SurfaceHit, &BsdfSample),
        sampler: &mut Sampler,
        deposit: &mut impl Deposit,
    ) {
        let mut goes_on = self.leave(&mut walk, hit, sample, 1);
        while goes_on && walk.density > 0.0 && walk.departed == hit.position {
            // What no connection finds is gathered in full, and cancels out here: so does the little of the rest that is gathered.
            let mut gathered = Walk { density: GATHERED, throughput: -walk.throughput, ..walk };
            let next = self.closest(&walk.ray(), sampler);
            self.arrive_at_next(&mut gathered, next, sampler, deposit);
            let Some(next) = self.arrive_at_next(&mut walk, next, sampler, deposit) else { return };
            let bsdf = self.scene.bsdf(&next, -walk.direction);
            goes_on = self.scatter(&mut walk, &next, &bsdf, 1, sampler);
        }
    }

    /// The surface with a diffuse base that a camera ray meets behind clear panes, and its unit normal.
    pub(crate) fn gathering_surface(
        &self,
        (origin, direction): (Vec3, Vec3),
        sampler: &mut Sampler,
    ) -> Option<(SurfaceHit, Vec3)> {
        let mut ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
        for _ in 0..PANES {
            let hit = self.closest_seen(&ray, sampler)?;
            if self.scene.material(hit.triangle).unlit {
                return None;
            }
            let bsdf = self.scene.bsdf(&hit, -direction);
            if bsdf.base_albedo() != Vec3::ZERO {
                return Some((hit, self.scene.smooth_normal(&hit, direction)));
            }
            if !self.scene.is_clear_pane(hit.triangle) || bsdf.straight_through() == Vec3::ZERO {
                return None;
            }
            ray.t_min = next_after(hit.t);
        }
        None
    }

    /// Deposits one sample of the mean radiance (weighted by the cosine) that reaches a point from other surfaces.
    pub(crate) fn gather_indirect(
        &self,
        (hit, normal, onto): (&SurfaceHit, Vec3, Onto),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) {
        let direction = cosine_around(normal, sampler.next_2d());
        let outward = hit.outward(normal);
        // Below the surface itself there is nothing to gather, as for samples of the base; a walk would meet its own light there.
        if direction.dot(outward) <= 0.0 {
            return;
        }
        let mut walk = Walk::from_camera(hit.origin(outward), direction);
        walk.guides = self.guides_onto(onto);
        walk.density = GATHERED;
        walk.sharpness = FRAC_1_PI;
        walk.sampled_at = Some(Vertex::First);
        walk.rival = Some(Vertex::First);
        walk.specular = false;
        walk.straight = false;
        (walk.n_hits, walk.n_before) = (1, u32::from(onto == Onto::Cell));
        self.follow(walk, sampler, scratch, deposit);
    }

    /// Deposits what casters throw on the diffuse base of a pixel's first surface: what walks all around meet by chance, and what
    /// guided ones find.
    pub(super) fn gather_caustics(
        &self,
        walk: &Walk,
        (hit, bsdf): (&SurfaceHit, &Bsdf),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) {
        let Some(casters) = self.casters else { return };
        let normal = hit.outward(-walk.direction);
        let guide = casters.guide(hit.position);
        let n = self.n_guides(walk, &guide, bsdf.base_albedo().max_element());
        let value = |wi: Vec3| (bsdf.eval_parts(wi).base, wi.dot(normal).max(0.0) * FRAC_1_PI);
        self.guide(walk, (&guide, n), (hit, &value), sampler, scratch, deposit);
        let mut own = sampler.fork(0, 1);
        let direction = cosine_around(normal, own.next_2d());
        let (f_cos, density) = value(direction);
        let all = density + n * guide.pdf(direction);
        if f_cos.max_element() > 0.0 && all > 0.0 {
            let (origin, throughput) = (hit.origin(normal), walk.throughput * f_cos / all);
            let sent = Walk { origin, direction, throughput, departed: hit.position, ..*walk };
            self.follow_caustic(sent, &mut own, scratch, deposit);
        }
        sampler.next_1d();
    }

    /// Whether casters were found to throw more than little light on a place.
    pub(crate) fn has_caustics_at(&self, position: Vec3) -> bool {
        self.casters.is_some_and(|casters| casters.guide(position).light() > LITTLE)
    }

    fn guides_onto(&self, onto: Onto) -> Guides {
        if onto == Onto::Pixel && self.casters.is_some() { Guides::All } else { Guides::None }
    }

    /// Deposits one sample of the mean radiance (weighted by the cosine) that reaches a point of a cell straight from all lights
    /// that can be connected to.
    pub(crate) fn gather_direct(
        &self,
        (hit, normal): (&SurfaceHit, Vec3),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) {
        let outward = hit.outward(normal);
        let mut walk = Walk::from_camera(hit.position, -normal);
        (walk.n_hits, walk.n_before) = (1, 1);
        let white = Bsdf::white(outward, normal);
        self.connect(&walk, (Vertex::First, Rivals::Parts), (hit, &white), sampler, scratch, deposit);
        walk.sampled_at = Some(Vertex::First);
        if let Some(sample) = white.sample_base(sampler.next_1d(), sampler.next_2d()) {
            self.meet_emitter(walk, (hit, &sample), sampler, deposit);
        }
    }

    /// Ends a walk where the light is known that the surface receives: `None` where it is not, else whether a narrow lobe
    /// carries the walk on.
    pub(super) fn hand_over(
        &self,
        walk: &mut Walk,
        (hit, bsdf): (&SurfaceHit, &Bsdf),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) -> Option<bool> {
        let broad = bsdf.broad_albedo();
        let albedo = broad.unwrap_or_else(|| bsdf.base_albedo());
        // What is known has left the second surface: where bounces are counted, it would have too many behind a mirror.
        let is_known = walk.n_hits == 2 || self.bounces == u32::MAX;
        // Nor does a cell know of a solid around it that attenuates.
        let is_known = is_known && walk.extinction == Vec3::ZERO;
        if walk.sharpness == f32::INFINITY || albedo == Vec3::ZERO || !is_known || self.is_spent(walk) {
            return None;
        }
        let normal = self.scene.smooth_normal(hit, walk.direction);
        let at = KnownAt { hit, normal, weight: walk.carried() * albedo, density: walk.sharpness };
        if !deposit.known(&at) {
            return None;
        }
        if broad.is_some() {
            return Some(false);
        }
        self.connect(walk, (Vertex::Later, Rivals::CoatAlone), (hit, bsdf), sampler, scratch, deposit);
        walk.sampled_at = Some(Vertex::Later);
        let sample = bsdf.sample_coat(sampler.next_1d(), sampler.next_2d());
        Some(sample.is_some_and(|sample| self.leave(walk, hit, &sample, 1)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::laws::stage::{Stage, lambert, quad, room};
    use crate::path::NoLights;
    use crate::scene::Material;

    /// How often light is asked for that is known everywhere.
    struct Asked(u32);

    impl Deposit for Asked {
        const KNOWS: bool = true;

        fn scattered(&mut self, _: u32, _: Vec3) {}

        fn seen(&mut self, _: u32, _: Vec3) {}

        fn known(&mut self, _: &KnownAt<'_>) -> bool {
            self.0 += 1;
            true
        }
    }

    /// How much light is found.
    struct Found(f32);

    impl Deposit for Found {
        fn scattered(&mut self, _: u32, value: Vec3) {
            self.0 += value.max_element();
        }

        fn seen(&mut self, column: u32, value: Vec3) {
            self.scattered(column, value);
        }
    }

    #[test]
    fn where_normals_are_smooth_a_surface_gathers_none_of_its_own_light() {
        let floor = quad(Vec3::new(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0);
        let camera = Camera::look_at("eye", Vec3::Y, Vec3::ZERO, 1.0, 1.0);
        let scene = Stage::new(camera).surface("floor", &floor, lambert(0.5, 1.0)).prepared();
        let integrator = Integrator::new(&scene, &NoLights, None);
        let at = integrator.gathering_surface((Vec3::new(0.1, 1.0, 0.2), Vec3::NEG_Y), &mut Sampler::new(1, 0, 0));
        let (hit, normal) = at.expect("it sees the floor");
        let (smooth, mut found, mut scratch) = ((normal + Vec3::X).normalize(), Found(0.0), Scratch::default());
        for walk in 0..64 {
            let mut sampler = Sampler::new(2, 0, walk);
            integrator.gather_indirect((&hit, smooth, Onto::Pixel), &mut sampler, &mut scratch, &mut found);
        }
        assert_eq!(found.0, 0.0);
    }

    #[test]
    fn where_bounces_are_counted_no_walk_ends_in_a_cell_behind_a_mirror() {
        let floor = quad(Vec3::new(-0.9, -0.9, 0.9), Vec3::X * 1.8, Vec3::NEG_Z * 1.8);
        let asked = |walls: Material, bounces: Option<u32>| {
            let camera = Camera::look_at("eye", Vec3::new(0.2, 0.1, 0.3), Vec3::NEG_Y, 1.0, 1.0);
            let stage = Stage::new(camera).surface("walls", &room(Vec3::ONE), walls);
            let scene = stage.surface("floor", &floor, lambert(0.6, 0.0)).prepared();
            let integrator = Integrator::new(&scene, &NoLights, bounces);
            let (mut sampler, eye) = (Sampler::new(1, 0, 0), scene.scene.cameras[0].position());
            let at = integrator.gathering_surface((eye, Vec3::NEG_Y), &mut sampler).expect("it sees the floor");
            let (mut counted, mut scratch) = (Asked(0), Scratch::default());
            for walk in 0..64 {
                let mut sampler = Sampler::new(2, 0, walk);
                integrator.gather_indirect((&at.0, at.1, Onto::Pixel), &mut sampler, &mut scratch, &mut counted);
            }
            counted.0
        };
        let silver = || Material { metallic: 1.0, roughness: 0.0, ..Material::default() };
        assert!(asked(lambert(0.6, 0.0), Some(8)) > 0, "walls are met first");
        assert!(asked(silver(), None) > 0, "all bounces are known");
        assert_eq!(asked(silver(), Some(8)), 0);
    }
}
