//! Solid panes of smooth glass with two flat, parallel faces: windows as they are modeled with their thickness.
//!
//! A straight shadow ray cannot pass them, because they shift what passes, and walks that hit a lamp behind one by chance are
//! rare. But light leaves such a slab in the direction in which it came, so that the one path through it between two points
//! is found by a root of one unknown ([`Slabs::route`]): next-event estimation through a specular chain
//! \[Hanika2015\], in its simplest case.

mod facet;
mod find;
pub(crate) mod hidden;
mod inside;
mod outline;
mod route;
mod tree;
mod words;

use glam::Vec3;

pub(crate) use facet::Facet;
use outline::Outline;
pub(crate) use route::Route;
use tree::Tree;

use crate::bsdf::SurfaceParams;

/// One minus the cosine between normals that count as parallel: single precision knows no better.
const PARALLEL: f32 = 1e-6;

/// How far aside of a straight way light is looked for in a slab, over its thickness: refraction brings it there at up to 75°, and
/// over that a face reflects most of it.
const MOST_ASIDE: f32 = 4.0;

/// Most slabs in a row that a connection passes.
pub(crate) const IN_A_ROW: usize = 8;

/// Most slabs that a connection passes where so many bounces are left for them: both faces of each count.
pub(crate) fn most_in_a_row(bounces: u32) -> usize {
    IN_A_ROW.min((bounces / 2) as usize)
}

/// All slabs of a scene.
#[derive(Debug, Default)]
pub(crate) struct Slabs {
    slabs: Vec<Slab>,
    /// Slab and face of each triangle of one, by triangle.
    faces: Vec<(u32, Face)>,
    tree: Tree,
}

/// A solid pane.
#[derive(Debug)]
struct Slab {
    /// Unit normal of the front, out of the glass.
    normal: Vec3,
    /// In the middle of the glass and of its outline.
    center: Vec3,
    /// In m.
    thickness: f32,
    /// Index of refraction.
    ior: f32,
    outline: Outline,
    /// Around it, and how far light may be shifted into it.
    bounds: Bounds,
    /// Of the back and of the front.
    facets: [Vec<Facet>; 2],
    /// What it is made of, where that is the same everywhere.
    looks: Option<SurfaceParams>,
    /// Whether nothing lies in the glass, so that nothing is in the way from face to face.
    is_free: bool,
}

/// A face of a slab; its index among a slab's pairs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Face {
    Back = 0,
    Front = 1,
}

impl Face {
    fn other(self) -> Face {
        match self {
            Face::Back => Face::Front,
            Face::Front => Face::Back,
        }
    }
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    lo: Vec3,
    hi: Vec3,
}

impl Default for Bounds {
    fn default() -> Bounds {
        Bounds { lo: Vec3::INFINITY, hi: Vec3::NEG_INFINITY }
    }
}

impl Bounds {
    fn with(self, point: Vec3) -> Bounds {
        Bounds { lo: self.lo.min(point), hi: self.hi.max(point) }
    }

    fn grown(self, by: Vec3) -> Bounds {
        Bounds { lo: self.lo - by, hi: self.hi + by }
    }

    /// Whether it shares a point with another box.
    fn overlaps(&self, other: &Bounds) -> bool {
        self.lo.cmple(other.hi).all() && other.lo.cmple(self.hi).all()
    }

    /// Whether a segment meets it, given one over each component of that.
    fn is_met(&self, from: Vec3, inverse: Vec3) -> bool {
        let (a, b) = ((self.lo - from) * inverse, (self.hi - from) * inverse);
        // A segment along a face's plane has no number there: `min` and `max` leave the other one.
        let (near, far) = (a.min(b).max_element().max(0.0), a.max(b).min_element().min(1.0));
        near <= far
    }
}

/// The slabs that a walk has passed since it last scattered broadly, as long as it did nothing else.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Passage {
    slabs: [u32; IN_A_ROW],
    n: u8,
    /// In the glass, having come in by this face.
    inside: Option<(u32, Face)>,
}

impl Passage {
    /// Slabs passed, in order; `None` in the middle of one.
    pub(crate) fn slabs(&self) -> Option<&[u32]> {
        self.inside.is_none().then_some(&self.slabs[..usize::from(self.n)])
    }

    /// Goes on through a face; false where it is not the next one of a slab.
    fn pass(&mut self, slab: u32, face: Face) -> bool {
        match self.inside.take() {
            None if usize::from(self.n) < IN_A_ROW => {
                self.inside = Some((slab, face));
                true
            }
            Some((within, by)) if within == slab && by != face => {
                self.slabs[usize::from(self.n)] = slab;
                self.n += 1;
                true
            }
            _ => false,
        }
    }
}

impl Slabs {
    /// Whether there are none.
    #[inline]
    pub(crate) fn is_empty(&self) -> bool {
        self.slabs.is_empty()
    }

    /// How many there are.
    #[cfg(test)]
    pub(crate) fn len(&self) -> usize {
        self.slabs.len()
    }

    /// Whether a triangle is of a slab's face.
    pub(crate) fn has(&self, triangle: u32) -> bool {
        self.face_of(triangle).is_some()
    }

    /// Slab and face of a triangle, if it is of one.
    fn face_of(&self, triangle: u32) -> Option<(u32, Face)> {
        self.faces.get(triangle as usize).copied().filter(|&(slab, _)| slab != NONE)
    }

    /// Takes a walk through a triangle that let it pass; false where that is not the way through a slab.
    pub(crate) fn pass(&self, passage: &mut Passage, triangle: u32) -> bool {
        self.face_of(triangle).is_some_and(|(slab, face)| passage.pass(slab, face))
    }
}

/// No slab.
const NONE: u32 = u32::MAX;
