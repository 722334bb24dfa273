//! The path of light through slabs between two points.

use glam::Vec3;

use super::{Bounds, Face, Facet, IN_A_ROW, PARALLEL, Slab, Slabs};
use crate::bsdf::SurfaceParams;

/// Steps of Newton's method: quadratic from the near side, so that these reach single precision from any start.
const STEPS: u32 = 12;

/// Cosine below which surfaces turn their normals to be seen at all, so that refraction is not what it was.
const LEAST_COS: f32 = 0.01;

/// A path that slabs shift.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Route {
    slabs: [u32; IN_A_ROW],
    /// Where the glass of each slab is entered and left.
    points: [[Vec3; 2]; IN_A_ROW],
    n: usize,
    /// Unit direction outside of the glass.
    pub(crate) direction: Vec3,
    /// What stands for one over the squared distance of the ends.
    pub(crate) closeness: f32,
}

/// A point where a route goes through a face.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Crossing<'a> {
    /// Where.
    pub(crate) point: Vec3,
    /// Those of the face.
    pub(crate) facets: &'a [Facet],
    /// What the glass is made of, where that is the same everywhere.
    pub(crate) looks: Option<&'a SurfaceParams>,
}

/// What a straight segment tells of the path through slabs between its ends.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Way {
    from: Vec3,
    slabs: [u32; IN_A_ROW],
    n: usize,
    /// Unit normal of the slabs, on the side of the end.
    normal: Vec3,
    /// Along the normal: in the glass and outside of it, m.
    glass: f32,
    air: f32,
    /// At right angles to the normal, m.
    aside: Vec3,
}

impl Way {
    /// The first slab on it.
    pub(crate) fn first(&self) -> u32 {
        self.slabs[0]
    }

    /// Two vectors that the direction of the path lies between: straight on, and as if it got aside outside of the glass alone.
    pub(crate) fn bounds(&self) -> [Vec3; 2] {
        let steep = self.normal * self.air + self.aside;
        [steep + self.normal * self.glass, steep]
    }
}

impl Route {
    /// Slabs on the way, in order.
    pub(crate) fn slabs(&self) -> &[u32] {
        &self.slabs[..self.n]
    }
}

impl Slabs {
    /// The path between two points through all slabs between them; `None` where there are none, too many, or some that are
    /// not parallel.
    pub(crate) fn route(&self, from: Vec3, to: Vec3) -> Option<Route> {
        self.bent(&self.way(from, to)?)
    }

    /// What lies on the straight way between two points; `None` where [`Slabs::route`] finds nothing because of it.
    pub(crate) fn way(&self, from: Vec3, to: Vec3) -> Option<Way> {
        let (slabs, n) = self.between(from, to)?;
        let normal = self.slabs[slabs[0] as usize].normal;
        let parallel = |&slab: &u32| self.slabs[slab as usize].normal.dot(normal).abs() > 1.0 - PARALLEL;
        if !slabs[..n].iter().all(parallel) {
            return None;
        }
        let normal = if normal.dot(to - from) < 0.0 { -normal } else { normal };
        let depth = normal.dot(to - from);
        let glass: f32 = slabs[..n].iter().map(|&slab| self.slabs[slab as usize].thickness()).sum();
        let (air, aside) = (depth - glass, (to - from) - normal * depth);
        (air > 0.0).then_some(Way { from, slabs, n, normal, glass, air, aside })
    }

    /// The path that a way is bent to; `None` where it grazes the glass, or slabs overlap.
    pub(crate) fn bent(&self, way: &Way) -> Option<Route> {
        let away = way.aside.length();
        let bend = self.bend(way, away);
        let cos = 1.0 / (1.0 + bend.tan * bend.tan).sqrt();
        if cos < LEAST_COS {
            return None;
        }
        let sideways = if away > 0.0 { way.aside / away } else { Vec3::ZERO };
        let direction = (way.normal + sideways * bend.tan) * cos;
        let closeness = 1.0 / (bend.away_over_sin * bend.slope * cos);
        let mut route = Route { slabs: way.slabs, points: Default::default(), n: way.n, direction, closeness };
        self.trace(&mut route, way.from)?;
        Some(route)
    }

    /// The path from a point in a direction through all slabs on a way of a length; `None` where there are none, or too many.
    pub(crate) fn route_beyond(&self, from: Vec3, direction: Vec3, length: f32) -> Option<Route> {
        let (slabs, n) = self.between(from, from + direction * length)?;
        let mut route = Route { slabs, points: Default::default(), n, direction, closeness: 1.0 };
        self.trace(&mut route, from)?;
        Some(route)
    }

    /// Whether the straight segment between two points meets a slab: nothing goes straight through its glass.
    pub(crate) fn is_in_between(&self, slab: u32, [from, to]: [Vec3; 2]) -> bool {
        let slab = &self.slabs[slab as usize];
        let (way, face) = (to - from, slab.first_face(to - from) as usize);
        let t = (slab.offsets[face] - slab.normal.dot(from)) / slab.normal.dot(way);
        t > 0.0 && t < 1.0 && Facet::with(&slab.facets[face], from + way * t).is_some()
    }

    /// The faces that a route goes through, in order.
    pub(crate) fn crossings<'a>(&'a self, route: &'a Route) -> impl Iterator<Item = Crossing<'a>> {
        route.slabs().iter().zip(&route.points).flat_map(|(&slab, points)| {
            let slab = &self.slabs[slab as usize];
            let first = slab.first_face(route.direction) as usize;
            let looks = slab.looks.as_ref();
            let at = |point, face: usize| Crossing { point, facets: &slab.facets[face], looks };
            [at(points[0], first), at(points[1], 1 - first)]
        })
    }

    /// Whether the boxes of all slabs lie beside the segments from a place to the points of a ball, middle and radius.
    pub(crate) fn are_beside(&self, from: Vec3, (center, radius): (Vec3, f32)) -> bool {
        let span = Bounds::default().with(from).with(center - radius).with(center + radius);
        !self.bounds.overlaps(&span) || !self.slabs.iter().any(|slab| slab.bounds.overlaps(&span))
    }

    /// Slabs whose box a segment meets, and that its ends are on either side of, in the order of the way.
    fn between(&self, from: Vec3, to: Vec3) -> Option<([u32; IN_A_ROW], usize)> {
        let span = Bounds { lo: from.min(to), hi: from.max(to) };
        if !self.bounds.overlaps(&span) {
            return None;
        }
        let (mut found, mut n) = ([(0.0, 0); IN_A_ROW], 0);
        for (idx, slab) in (0u32..).zip(&self.slabs) {
            if !slab.bounds.overlaps(&span) || !slab.parts(from, to) {
                continue;
            }
            let Some(entry) = slab.bounds.entry(from, to) else { continue };
            *found.get_mut(n)? = (entry, idx);
            n += 1;
        }
        found[..n].sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        (n > 0).then(|| (found.map(|(_, slab)| slab), n))
    }

    /// Solves for the tangent of the angle to the normal: `air · tan + Σ thickness · tan' = away`.
    fn bend(&self, way: &Way, away: f32) -> Bend {
        let at = |tan: f32| {
            let cos = 1.0 / (1.0 + tan * tan).sqrt();
            let sin = tan * cos;
            let mut bend = Bend { tan, away_over_sin: way.air / cos, slope: way.air / (cos * cos) };
            for &slab in &way.slabs[..way.n] {
                let slab = &self.slabs[slab as usize];
                let (ior, thickness) = (slab.ior, slab.thickness());
                let squared = ior * ior - sin * sin;
                bend.away_over_sin += thickness / squared.sqrt();
                bend.slope += thickness * ior * ior * cos / (squared * squared.sqrt());
            }
            (bend, bend.away_over_sin * sin - away, bend.slope * cos * cos)
        };
        // The sum is concave in the tangent: from below, each step stays below. So is what small angles would be bent to.
        let shallow = |&slab: &u32| self.slabs[slab as usize].thickness() / self.slabs[slab as usize].ior;
        let shallow: f32 = way.slabs[..way.n].iter().map(shallow).sum();
        let (mut bend, mut excess, mut slope) = at(away / (way.air + shallow));
        for _ in 0..STEPS {
            let tan = bend.tan - excess / slope;
            if tan <= bend.tan || tan.is_nan() {
                break;
            }
            (bend, excess, slope) = at(tan);
        }
        bend
    }

    /// Fills in where a route goes through the glass; `None` where slabs overlap.
    fn trace(&self, route: &mut Route, from: Vec3) -> Option<()> {
        let (mut at, direction) = (from, route.direction);
        for (points, &slab) in route.points.iter_mut().zip(&route.slabs[..route.n]) {
            let slab = &self.slabs[slab as usize];
            let cos = direction.dot(slab.normal);
            if cos.abs() < LEAST_COS {
                return None;
            }
            let first = slab.first_face(direction);
            let t = (slab.offsets[first as usize] - slab.normal.dot(at)) / cos;
            if t <= 0.0 || t.is_nan() {
                return None;
            }
            let into = at + direction * t;
            let normal = slab.normal * cos.signum();
            let sideways = (direction - normal * cos.abs()) / slab.ior;
            let within = sideways + normal * (1.0 - sideways.length_squared()).sqrt();
            at = into + within * (slab.thickness() / within.dot(normal));
            *points = [into, at];
        }
        Some(())
    }
}

/// How far light gets aside at an angle.
#[derive(Clone, Copy)]
struct Bend {
    /// Tangent of the angle outside of the glass.
    tan: f32,
    /// Distance aside over the sine of the angle.
    away_over_sin: f32,
    /// Distance aside per radian.
    slope: f32,
}

impl Slab {
    fn thickness(&self) -> f32 {
        self.offsets[1] - self.offsets[0]
    }

    /// The face that light of a direction enters by.
    fn first_face(&self, direction: Vec3) -> Face {
        if direction.dot(self.normal) < 0.0 { Face::Front } else { Face::Back }
    }

    /// Whether two points are outside of the glass on either side.
    fn parts(&self, from: Vec3, to: Vec3) -> bool {
        let [a, b] = [from, to].map(|point| self.normal.dot(point));
        a.min(b) < self.offsets[0] && a.max(b) > self.offsets[1]
    }
}
