//! Connections through solid panes, and how walks weigh that go through them by chance.

use glam::{Vec2, Vec3};

use super::{Integrator, LightPlan, LightPoint, Walk};
use crate::bsdf::Bsdf;
use crate::emitters::Emitter;
use crate::prepared::{PreparedScene, SurfaceHit};
use crate::slabs::{Facet, Route};

impl<P: LightPlan> Integrator<'_, P> {
    /// A point on the light of a column as seen through the slabs on the way, `straight` the same point without them; `None`
    /// where there are none, or the walk may not scatter as often.
    pub(super) fn light_behind_slabs(
        &self,
        walk: &Walk,
        (column, position, u): (u32, Vec3, Vec2),
        straight: Option<&LightPoint>,
    ) -> Option<(LightPoint, Route)> {
        let slabs = &self.scene.slabs;
        let may_pass = |route: &Route| {
            let faces = 2 * route.slabs().len() as u32;
            (walk.n_before + walk.n_hits).saturating_add(faces) <= self.bounces.saturating_add(1)
        };
        if let Some(light) = straight.filter(|light| light.beyond) {
            let route = slabs.route_beyond(position, light.wi, self.far).filter(may_pass)?;
            return Some((*light, route));
        }
        let target = straight.map(|light| light.target).or_else(|| self.point_on(column, u))?;
        let route = slabs.route(position, target).filter(may_pass)?;
        Some((self.light_point(column, route.eye(target), u)?, route))
    }

    /// The point of a light of finite distance that [`Integrator::light_point`] takes, wherever it is seen from.
    fn point_on(&self, column: u32, u: Vec2) -> Option<Vec3> {
        let place = self.columns[column as usize];
        match &self.scene.lighting.emitters[place.source as usize] {
            Emitter::Panel(panel) => Some(panel.point(place.texel(u) * panel.texel_side)),
            Emitter::Surface(surface) => Some(surface.sample(u).position),
            Emitter::Punctual(light) => Some(light.position),
            Emitter::Lamp(lamp) => lamp.point(u).map(|point| point.position),
            _ => None,
        }
    }

    /// Share of light that comes along a route; nothing where something is in the way, or the route misses a face.
    pub(super) fn passed_along(&self, walk: &Walk, hit: &SurfaceHit, light: &LightPoint, route: &Route) -> Vec3 {
        // Of a route that grazes the surface, rounding may put the direction on the other side of that.
        let extinction = self.extinction_towards(walk, hit, light.wi);
        let start = (hit.position, hit.origin(hit.outward(light.wi)));
        let end = if light.beyond { None } else { Some(light.target) };
        passed_along(self.scene, start, extinction, (route, end, self.far))
    }

    /// What stands for one over the squared distance between a point on a light that a walk came to by chance, `t` from where
    /// it set out last, and where its direction was chosen; `None` where no connection would have found this path.
    pub(super) fn closeness(&self, walk: &Walk, t: f32, position: Vec3) -> Option<f32> {
        match walk.passage.slabs()? {
            [] => Some((walk.passed + t).powi(-2)),
            passed => {
                let route = self.scene.slabs.route(walk.departed, position)?;
                (route.slabs() == passed).then_some(route.closeness)
            }
        }
    }

    /// Whether a connection would have found the path of a walk that left the scene.
    pub(super) fn is_connected_beyond(&self, walk: &Walk) -> bool {
        walk.passage.slabs().is_some_and(|passed| {
            let route = || self.scene.slabs.route_beyond(walk.departed, walk.direction, self.far);
            passed.is_empty() || route().is_some_and(|route| route.slabs() == passed)
        })
    }
}

/// Where a route has left its last face.
pub(crate) struct Emerged {
    /// Share of light that comes through all of the glass.
    pub passed: Vec3,
    /// World space, m.
    pub at: Vec3,
    /// Where rays begin there.
    pub from: Vec3,
    /// How far that is off the face, m.
    pub lifted_m: f32,
}

/// Share of light that comes along a route to a place and where its rays begin, through `extinction` before the first face,
/// from `end`, else from `far` away; nothing where something is in the way, or the route misses a face.
pub(crate) fn passed_along(
    scene: &PreparedScene,
    start: (Vec3, Vec3),
    extinction: Vec3,
    (route, end, far): (&Route, Option<Vec3>, f32),
) -> Vec3 {
    through_glass(scene, start, extinction, route).map_or(Vec3::ZERO, |Emerged { passed, at, from, .. }| {
        passed * scene.transmittance(from, end.unwrap_or(at + route.direction * far))
    })
}

/// What comes through the glass of a route, from a place and where its rays begin; `None` where something is in the way, or the route
/// misses a face.
pub(crate) fn through_glass(
    scene: &PreparedScene,
    (mut at, mut from): (Vec3, Vec3),
    mut extinction: Vec3,
    route: &Route,
) -> Option<Emerged> {
    let (mut passed, mut lifted_m) = (Vec3::ONE, from.distance(at));
    for crossing in scene.slabs.crossings(route) {
        let (facet, uv) = Facet::with(crossing.facets, crossing.point)?;
        let place = facet.point(uv);
        // Whether the way is free costs less than what the glass takes, and nothing in glass where nothing lies.
        if !crossing.is_free {
            passed *= scene.transmittance(from, place);
        }
        if passed == Vec3::ZERO {
            return None;
        }
        let leg = crossing.point - at;
        let length = leg.length();
        let direction = leg / length;
        let refracted = match crossing.looks {
            Some(looks) => Bsdf::refracted(looks, facet.normal, facet.normal, -direction),
            None => scene.refracted(&scene.point_of(facet.triangle, uv), -direction),
        };
        passed *= refracted * kept(extinction, length);
        extinction = scene.extinction_behind(facet.triangle, direction.dot(facet.normal) > 0.0, extinction);
        (at, from) = (crossing.point, facet.origin(place, direction, scene.extent()));
        lifted_m = from.distance(place);
    }
    Some(Emerged { passed, at, from, lifted_m })
}

/// Share of light that a medium leaves over a length, m.
fn kept(extinction: Vec3, length: f32) -> Vec3 {
    if extinction == Vec3::ZERO { Vec3::ONE } else { (-extinction * length).exp() }
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::super::{Deposit, Receiver, Scratch};
    use super::*;
    use crate::camera::Camera;
    use crate::laws::slabs::{block, glass};
    use crate::laws::stage::Stage;
    use crate::plan::{Density, MatrixPlan};
    use crate::sampler::Sampler;

    /// All light that comes.
    struct Sum(Vec3);

    impl Deposit for Sum {
        fn scattered(&mut self, _: u32, value: Vec3) {
            self.0 += value;
        }

        fn seen(&mut self, column: u32, value: Vec3) {
            self.scattered(column, value);
        }
    }

    #[test]
    fn light_through_a_tilted_pane_that_grazes_a_plane_is_measured_on_one_of_its_sides() {
        let turn = Quat::from_rotation_z(0.4) * Quat::from_rotation_x(0.3);
        let camera = Camera::look_at("eye", Vec3::new(0.0, 0.4, 0.6), Vec3::ZERO, 1.0, 1.0);
        let pane = block(Vec3::Y, Vec3::new(2.0, 0.05, 2.0), turn);
        // Far from the origin places are rounded more than directions.
        let (lamp, away) = (Vec3::new(0.1, 2.0, -0.1), Vec3::X * 100.0);
        let scene = Stage::new(camera).surface("pane", &pane, glass()).lamp("lamp", lamp, 7.0).moved(away).prepared();
        let plan = MatrixPlan::new(&scene.lighting, Density::Full);
        let (integrator, mut scratch, mut n_lit) = (Integrator::new(&scene, &plan, Some(2)), Scratch::default(), 0);
        for case in 0..512 {
            let mut sampler = Sampler::new(5, 0, case);
            let [x, z] = sampler.next_2d();
            let position = away + Vec3::new(x - 0.5, 0.0, z - 0.5);
            let route = scene.slabs.route(position, lamp + away).expect("the pane is in between");
            // At right angles to the light, as far as rounding knows.
            let (u, v) = route.direction.any_orthonormal_pair();
            let (sin, cos) = (case as f32).sin_cos();
            let receiver = Receiver::on_plane(position, (u * cos + v * sin).normalize(), 0.0);
            let mut lux = Sum(Vec3::ZERO);
            integrator.sample_irradiance(&receiver, &mut sampler, &mut scratch, &mut lux);
            assert!((0.0..1e-3).contains(&lux.0.y), "case {case}: {} lx", lux.0.y);
            n_lit += u32::from(lux.0.y > 0.0);
        }
        assert!(n_lit > 64, "only {n_lit} planes get light");
    }
}
