//! The path of light through slabs between two points.

use glam::{Mat2, Vec2, Vec3};

use super::{Bounds, Face, Facet, IN_A_ROW, MOST_ASIDE, PARALLEL, Slab, Slabs};
use crate::bsdf::SurfaceParams;

/// Steps of Newton's method: quadratic from the near side, so that these reach single precision from any start.
const STEPS: u32 = 12;

/// Cosine below which surfaces turn their normals to be seen at all, so that refraction is not what it was.
const LEAST_COS: f32 = 0.01;

/// Tries to find the slabs that a path goes through.
const TRIES: u32 = 4;

/// Distance from the end, over that of both ends, up to which a path arrives.
const ARRIVED: f32 = 1e-5;

/// Overlap of two slabs along a way, over their thickness, from which on only one of both is gone through.
const OVERLAP: f32 = 0.1;

/// Slabs in the order of a way.
#[derive(Clone, Copy, Debug, Default)]
struct Row {
    slabs: [u32; IN_A_ROW],
    n: usize,
}

impl Row {
    /// `None` where it is full.
    fn push(&mut self, slab: u32) -> Option<()> {
        *self.slabs.get_mut(self.n)? = slab;
        self.n += 1;
        Some(())
    }

    fn slabs(&self) -> &[u32] {
        &self.slabs[..self.n]
    }
}

/// A path that slabs shift.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Route {
    row: Row,
    from: Vec3,
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
    /// Whether it is known that nothing is in the way to it from the face before: both are a slab's in which nothing lies.
    pub(crate) is_free: bool,
}

/// What a straight segment tells of the path through slabs between its ends.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Way {
    ends: [Vec3; 2],
    /// What it may go through, and what of that the segment does.
    rows: [Row; 2],
}

/// Parallel slabs between two points.
#[derive(Clone, Copy, Debug)]
struct Layers {
    /// Unit normal, on the side of the end.
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
        let [all, straight] = &self.rows;
        if straight.n > 0 { straight.slabs[0] } else { all.slabs[0] }
    }
}

impl Route {
    /// Slabs on the way, in order.
    pub(crate) fn slabs(&self) -> &[u32] {
        self.row.slabs()
    }

    /// A place from which, without slabs, a light at the end looks as it does from the beginning through them.
    pub(crate) fn eye(&self, end: Vec3) -> Vec3 {
        end - self.direction / self.closeness.sqrt()
    }

    /// From a point in a direction, through nothing yet.
    fn along(from: Vec3, direction: Vec3) -> Route {
        Route { row: Row::default(), from, direction, closeness: 1.0 }
    }
}

impl Slabs {
    /// The path between two points through the slabs between them; `None` where there are none, or too many.
    pub(crate) fn route(&self, from: Vec3, to: Vec3) -> Option<Route> {
        self.bent(&self.way(from, to)?)
    }

    /// What lies on the straight way between two points; `None` where [`Slabs::route`] finds nothing because of it.
    pub(crate) fn way(&self, from: Vec3, to: Vec3) -> Option<Way> {
        let ends = [from, to];
        Some(Way { ends, rows: self.met(ends)? })
    }

    /// Two vectors that the direction of a way's path lies between: straight on, and as if it got aside outside of the glass alone;
    /// `None` where nothing is known about it.
    pub(crate) fn bounds(&self, way: &Way) -> Option<[Vec3; 2]> {
        let Layers { normal, glass, air, aside } = self.layers(way.rows[0].slabs(), way.ends)?;
        let steep = normal * air + aside;
        Some([steep + normal * glass, steep])
    }

    /// The path that a way is bent to; `None` where it goes through no slab, or grazes one.
    pub(crate) fn bent(&self, way: &Way) -> Option<Route> {
        let [all, straight] = way.rows;
        let again = || if straight.n < all.n { self.settled(straight, way.ends) } else { None };
        self.settled(all, way.ends).or_else(again)
    }

    /// The path from a point in a direction through all slabs on a way of a length; `None` where there are none, or too many.
    pub(crate) fn route_beyond(&self, from: Vec3, direction: Vec3, length: f32) -> Option<Route> {
        let route = self.followed([from, from + direction * length], direction)?;
        (route.row.n > 0).then_some(route)
    }

    /// The path from a point in a direction through the slab alone whose face a triangle is of; `None` where it is of none, and
    /// from within the glass.
    pub(crate) fn route_through(&self, triangle: u32, from: Vec3, direction: Vec3) -> Option<Route> {
        let (idx, face) = self.face_of(triangle)?;
        let slab = &self.slabs[idx as usize];
        if slab.first_face(direction) != face {
            return None;
        }
        slab.entered(from, direction)?;
        let mut route = Route::along(from, direction);
        route.row.push(idx)?;
        Some(route)
    }

    /// Whether the straight segment between two points meets a slab: nothing goes straight through its glass.
    pub(crate) fn is_in_between(&self, slab: u32, [from, to]: [Vec3; 2]) -> bool {
        let slab = &self.slabs[slab as usize];
        let (way, face) = (to - from, slab.first_face(to - from));
        let t = (slab.height(face) - slab.normal.dot(from - slab.center)) / slab.normal.dot(way);
        t > 0.0 && t < 1.0 && Facet::with(&slab.facets[face as usize], from + way * t).is_some()
    }

    /// The faces that a route goes through, in order.
    pub(crate) fn crossings<'a>(&'a self, route: &'a Route) -> impl Iterator<Item = Crossing<'a>> {
        let (direction, mut at) = (route.direction, route.from);
        route.slabs().iter().flat_map(move |&slab| {
            let slab = &self.slabs[slab as usize];
            let into = at + direction * slab.distance(at, direction);
            at = slab.through(into, direction);
            let (first, looks) = (slab.first_face(direction) as usize, slab.looks.as_ref());
            let crossing = |point, face: usize, is_free| Crossing { point, facets: &slab.facets[face], looks, is_free };
            [crossing(into, first, false), crossing(at, 1 - first, slab.is_free)]
        })
    }

    /// Whether the boxes of all slabs lie beside the segments from the places of a box, middle and half of its sides, to the points of a
    /// ball, middle and radius.
    pub(crate) fn are_beside(&self, (from, half): (Vec3, Vec3), (center, radius): (Vec3, f32)) -> bool {
        // Each of them is no farther than that from the segment between both middles, at the same share of the way.
        let (inverse, by) = (1.0 / (center - from), half.max(Vec3::splat(radius)));
        let may_be_met = |bounds: &Bounds| bounds.grown(by).is_met(from, inverse);
        let mut are_beside = true;
        self.tree.each(may_be_met, |slab| are_beside &= !may_be_met(&self.slabs[slab as usize].bounds));
        are_beside
    }

    /// Where light leaves the slab that it enters by a triangle at a place; `None` by its rim, or from within.
    pub(crate) fn behind(&self, triangle: u32, place: Vec3, direction: Vec3) -> Option<Vec3> {
        let (idx, face) = self.face_of(triangle)?;
        let slab = &self.slabs[idx as usize];
        if slab.first_face(direction) != face || slab.normal.dot(direction).abs() < LEAST_COS {
            return None;
        }
        let out = slab.through(place, direction);
        slab.outline.has(face.other(), slab.outline.place(out - slab.center)).then_some(out)
    }

    /// Slabs that the path between two points may go through: those in the straight way, and those that it passes by no farther than
    /// light is shifted; and of these the former. `None` where there are none, or too many.
    fn met(&self, ends: [Vec3; 2]) -> Option<[Row; 2]> {
        let (mut met, mut n, mut is_full) = ([Meeting::default(); IN_A_ROW], 0, false);
        self.tree.each_on(ends, |slab| {
            let Some(new) = self.slabs[slab as usize].meeting(slab, ends) else { return };
            // Of two side by side the path goes through one.
            if met[..n].iter().any(|old| old.is_beside(&new) && old.aside <= new.aside) {
                return;
            }
            let mut kept = 0;
            for i in 0..n {
                if !met[i].is_beside(&new) {
                    met[kept] = met[i];
                    kept += 1;
                }
            }
            n = kept;
            is_full |= n == IN_A_ROW;
            if let Some(last) = met.get_mut(n) {
                *last = new;
                n += 1;
            }
        });
        if n == 0 || is_full {
            return None;
        }
        met[..n].sort_by(|a, b| a.t.total_cmp(&b.t).then(a.slab.cmp(&b.slab)));
        let mut rows = [Row::default(); 2];
        for meeting in &met[..n] {
            rows[0].push(meeting.slab)?;
            if meeting.aside < 0.0 {
                rows[1].push(meeting.slab)?;
            }
        }
        Some(rows)
    }

    /// The path between two points through just the slabs that it meets, sought from some that it may meet; `None` where it meets
    /// none, or is not found.
    fn settled(&self, mut row: Row, ends: [Vec3; 2]) -> Option<Route> {
        for _ in 0..TRIES {
            if row.n == 0 {
                break;
            }
            let (direction, closeness) = self.toward(row.slabs(), ends)?;
            let route = self.followed(ends, direction)?;
            if route.slabs() == row.slabs() {
                return Some(Route { closeness, ..route });
            }
            row = route.row;
        }
        None
    }

    /// Direction outside of the glass, and closeness, of the path between two points through some slabs, as if each were endless;
    /// `None` where it grazes one.
    fn toward(&self, slabs: &[u32], ends: [Vec3; 2]) -> Option<(Vec3, f32)> {
        let Some(layers) = self.layers(slabs, ends) else { return self.turned(slabs, ends[1] - ends[0]) };
        let Layers { normal, aside, .. } = layers;
        let away = aside.length();
        let bend = self.bend(slabs, &layers, away);
        let cos = 1.0 / (1.0 + bend.tan * bend.tan).sqrt();
        let sideways = if away > 0.0 { aside / away } else { Vec3::ZERO };
        let found = ((normal + sideways * bend.tan) * cos, 1.0 / (bend.away_over_sin * bend.slope * cos));
        (cos >= LEAST_COS).then_some(found)
    }

    /// Some slabs between two points, if they are parallel.
    fn layers(&self, slabs: &[u32], [from, to]: [Vec3; 2]) -> Option<Layers> {
        let slab = |slab: &u32| &self.slabs[*slab as usize];
        let normal = slab(slabs.first()?).normal;
        if !slabs.iter().all(|other| slab(other).normal.dot(normal).abs() > 1.0 - PARALLEL) {
            return None;
        }
        let normal = if normal.dot(to - from) < 0.0 { -normal } else { normal };
        let depth = normal.dot(to - from);
        let glass: f32 = slabs.iter().map(|other| slab(other).thickness).sum();
        let (air, aside) = (depth - glass, (to - from) - normal * depth);
        (air > 0.0).then_some(Layers { normal, glass, air, aside })
    }

    /// Solves for the tangent of the angle to the normal: `air · tan + Σ thickness · tan' = away`.
    fn bend(&self, slabs: &[u32], layers: &Layers, away: f32) -> Bend {
        let at = |tan: f32| {
            let cos = 1.0 / (1.0 + tan * tan).sqrt();
            let sin = tan * cos;
            let mut bend = Bend { tan, away_over_sin: layers.air / cos, slope: layers.air / (cos * cos) };
            for &slab in slabs {
                let Slab { ior, thickness, .. } = self.slabs[slab as usize];
                let squared = ior * ior - sin * sin;
                bend.away_over_sin += thickness / squared.sqrt();
                bend.slope += thickness * ior * ior * cos / (squared * squared.sqrt());
            }
            (bend, bend.away_over_sin * sin - away, bend.slope * cos * cos)
        };
        // The sum is concave in the tangent: from below, each step stays below. So is what small angles would be bent to.
        let shallow = |&slab: &u32| self.slabs[slab as usize].thickness / self.slabs[slab as usize].ior;
        let shallow: f32 = slabs.iter().map(shallow).sum();
        let (mut bend, mut excess, mut slope) = at(away / (layers.air + shallow));
        for _ in 0..STEPS {
            let tan = bend.tan - excess / slope;
            if tan <= bend.tan || tan.is_nan() {
                break;
            }
            (bend, excess, slope) = at(tan);
        }
        bend
    }

    /// The same as [`Slabs::toward`] through slabs at an angle to each other: Newton's method for both angles of the direction, which
    /// is the same outside of all glass, from straight on.
    fn turned(&self, slabs: &[u32], toward: Vec3) -> Option<(Vec3, f32)> {
        let distance = toward.length();
        let mut direction = toward / distance;
        for _ in 0..STEPS {
            let axes: [Vec3; 2] = direction.any_orthonormal_pair().into();
            let (mut rest, mut turns) = (toward, [Vec3::ZERO; 2]);
            for &slab in slabs {
                let (shift, by_turn) = self.slabs[slab as usize].shift(direction, axes)?;
                rest -= shift;
                turns = [turns[0] + by_turn[0], turns[1] + by_turn[1]];
            }
            let air = rest.dot(direction);
            if air.is_nan() || air <= 0.0 {
                return None;
            }
            let across = |v: Vec3| Vec2::new(v.dot(axes[0]), v.dot(axes[1]));
            let by_turn = Mat2::from_cols(across(turns[0]), across(turns[1])) + Mat2::from_diagonal(Vec2::splat(air));
            let off = across(rest);
            if off.length() <= ARRIVED * distance {
                return Some((direction, 1.0 / by_turn.determinant().abs()));
            }
            let step = by_turn.inverse() * off;
            direction = (direction + axes[0] * step.x + axes[1] * step.y).normalize();
        }
        None
    }

    /// The path from the first of two points in a direction through the slabs on it between both; `None` where there are too many.
    fn followed(&self, ends: [Vec3; 2], direction: Vec3) -> Option<Route> {
        let mut route = Route::along(ends[0], direction);
        let (mut at, reach) = (ends[0], direction * ends[0].distance(ends[1]));
        loop {
            let mut next: Option<(f32, u32)> = None;
            self.tree.each_on([at, at + reach], |idx| {
                let slab = &self.slabs[idx as usize];
                if let Some(t) = slab.entered(at, direction)
                    && next.is_none_or(|(nearest, _)| t < nearest)
                    && slab.parts(ends)
                {
                    next = Some((t, idx));
                }
            });
            let Some((t, idx)) = next else { return Some(route) };
            route.row.push(idx)?;
            at = self.slabs[idx as usize].through(at + direction * t, direction);
        }
    }
}

/// A slab that a straight way goes through, or by.
#[derive(Clone, Copy, Debug, Default)]
struct Meeting {
    /// Where it comes to the middle of the glass, and half of what it is in there, both of the way.
    t: f32,
    half: f32,
    /// How far off the glass it is, m; below 0 where it goes through.
    aside: f32,
    slab: u32,
}

impl Meeting {
    fn is_beside(&self, other: &Meeting) -> bool {
        (self.t - other.t).abs() < (1.0 - OVERLAP) * (self.half + other.half)
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
    /// Height of a face along the normal over the middle, m.
    fn height(&self, face: Face) -> f32 {
        match face {
            Face::Back => -0.5 * self.thickness,
            Face::Front => 0.5 * self.thickness,
        }
    }

    /// The face that light of a direction enters by.
    fn first_face(&self, direction: Vec3) -> Face {
        if direction.dot(self.normal) < 0.0 { Face::Front } else { Face::Back }
    }

    /// Whether two points are outside of the glass on either side.
    fn parts(&self, ends: [Vec3; 2]) -> bool {
        let [a, b] = ends.map(|point| self.normal.dot(point - self.center));
        a.min(b) < self.height(Face::Back) && a.max(b) > self.height(Face::Front)
    }

    /// How the straight way between two points meets it, if these are on either side and the way is not too far off.
    fn meeting(&self, slab: u32, [from, to]: [Vec3; 2]) -> Option<Meeting> {
        let (start, way) = (from - self.center, to - from);
        let (height, depth) = (start.dot(self.normal), way.dot(self.normal));
        let (least, most) = (height.min(height + depth), height.max(height + depth));
        if least >= self.height(Face::Back) || most <= self.height(Face::Front) {
            return None;
        }
        let t = -height / depth;
        let place = self.outline.place(start + way * t);
        let excess = self.outline.excess(place);
        if excess > 0.0 {
            // At an angle of this tangent light gets no farther aside in this glass, and some more of the same.
            let tan = (way.length_squared() / (depth * depth) - 1.0).max(0.0).sqrt();
            if excess > self.thickness * (2.0 * tan).min(MOST_ASIDE) {
                return None;
            }
        }
        let aside = if self.outline.has(Face::Front, place) { -1.0 } else { excess.max(0.0) };
        Some(Meeting { t, half: 0.5 * self.thickness / depth.abs(), aside, slab })
    }

    /// Distance at which a ray enters the glass, m; `None` where it does not, or grazes it.
    fn entered(&self, from: Vec3, direction: Vec3) -> Option<f32> {
        let (t, face) = (self.distance(from, direction), self.first_face(direction));
        let enters = direction.dot(self.normal).abs() >= LEAST_COS && t > 0.0;
        let place = || self.outline.place(from - self.center + direction * t);
        (enters && self.outline.has(face, place())).then_some(t)
    }

    /// Distance at which a ray comes to the plane of the face that it enters by, m.
    fn distance(&self, from: Vec3, direction: Vec3) -> f32 {
        let height = self.normal.dot(from - self.center);
        (self.height(self.first_face(direction)) - height) / direction.dot(self.normal)
    }

    /// Where light leaves the glass that comes into it at a place.
    fn through(&self, into: Vec3, direction: Vec3) -> Vec3 {
        let cos = direction.dot(self.normal);
        let normal = self.normal * cos.signum();
        let sideways = (direction - normal * cos.abs()) / self.ior;
        let within = sideways + normal * (1.0 - sideways.length_squared()).sqrt();
        into + within * (self.thickness / within.dot(normal))
    }

    /// What the way of light of a direction in the glass adds to its path, m, and what that changes by if the direction turns towards
    /// each of two axes, m/rad; `None` where it grazes the glass.
    fn shift(&self, direction: Vec3, axes: [Vec3; 2]) -> Option<(Vec3, [Vec3; 2])> {
        let cos = direction.dot(self.normal);
        if cos.abs() < LEAST_COS {
            return None;
        }
        let normal = self.normal * cos.signum();
        let sideways = (direction - normal * cos.abs()) / self.ior;
        let squared = 1.0 - sideways.length_squared();
        let per_depth = self.thickness / squared.sqrt();
        let by_turn = axes.map(|axis| {
            let turned = (axis - normal * axis.dot(normal)) / self.ior;
            (turned + sideways * (sideways.dot(turned) / squared)) * per_depth
        });
        Some((normal * self.thickness + sideways * per_depth, by_turn))
    }
}
