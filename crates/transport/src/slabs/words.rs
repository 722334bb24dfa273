//! Slabs in plain words for a device.

use glam::Vec3;

use super::{Slab, Slabs};
use crate::prepared::PreparedScene;

type Row = [u32; 4];

/// Rows of all slabs, of each, and of a triangle.
const HEAD: usize = 2;
const SLAB_ROWS: usize = 8;
const TRIANGLE_ROWS: usize = 3;
/// Most triangles of a face that a device knows.
const MOST_TRIANGLES: usize = 0xffff;

impl Slabs {
    /// Two rows for all slabs: the lower corner of their box and their number, the upper corner and the diagonal of the scene. Eight for
    /// each: normal and index of refraction; middle and thickness; its box, with the row of its first triangle, and with the numbers of
    /// those of the back and, from bit 16 on, of the front; what it lets pass but for what it reflects, and 1 where that cannot be told;
    /// extinction, 1/m, and 1 where nothing lies in its glass; the axes of the rectangle around it, each with half of its length. Three
    /// for each triangle, those of a back first: a corner and the clearance, and the edges from there.
    pub(crate) fn words(&self, scene: &PreparedScene) -> Vec<Row> {
        if self.is_empty() {
            return vec![[0; 4]; HEAD];
        }
        let n_slabs = self.slabs.len();
        let bounds = self.tree.bounds();
        let mut rows = vec![row(bounds.lo, n_slabs as u32), row(bounds.hi, scene.extent().to_bits())];
        let mut first = HEAD + SLAB_ROWS * n_slabs;
        for slab in &self.slabs {
            rows.extend(slab.words(scene, first as u32));
            first += TRIANGLE_ROWS * slab.facets.iter().map(Vec::len).sum::<usize>();
        }
        let facets = self.slabs.iter().flat_map(|slab| slab.facets.iter().flatten());
        rows.extend(facets.flat_map(|facet| facet.words().map(|(numbers, word)| row(numbers, word))));
        rows
    }
}

impl Slab {
    fn words(&self, scene: &PreparedScene, first_triangle: u32) -> [Row; SLAB_ROWS] {
        let [n_back, n_front] = self.facets.each_ref().map(Vec::len);
        let known = self.known(scene).filter(|_| n_back.max(n_front) <= MOST_TRIANGLES);
        let ([x, y], half) = (self.outline.axes, self.outline.half);
        let (passed, extinction) = known.unwrap_or_default();
        [
            row(self.normal, self.ior.to_bits()),
            row(self.center, self.thickness.to_bits()),
            row(self.bounds.lo, first_triangle),
            row(self.bounds.hi, n_back as u32 | (n_front as u32) << 16),
            row(passed, u32::from(known.is_none())),
            row(extinction, u32::from(self.is_free)),
            row(x, half.x.to_bits()),
            row(y, half.y.to_bits()),
        ]
    }

    /// What both faces let pass but for what they reflect, and extinction, 1/m; `None` where that is not the same everywhere, and far
    /// from the origin, where rounding has a say.
    fn known(&self, scene: &PreparedScene) -> Option<(Vec3, Vec3)> {
        let (looks, front) = (self.looks?, self.facets[1].first()?);
        let is_far = self.bounds.lo.abs().max(self.bounds.hi.abs()).max_element() > scene.extent();
        let of_a_face = looks.base_color * ((1.0 - looks.metallic) * looks.transmission);
        (!is_far).then(|| (of_a_face * of_a_face, scene.extinction_behind(front.triangle, false)))
    }
}

fn row(numbers: Vec3, word: u32) -> Row {
    let [x, y, z] = numbers.to_array().map(f32::to_bits);
    [x, y, z, word]
}
