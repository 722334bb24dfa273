//! Slabs in plain words for a device.

use glam::{Vec2, Vec3, Vec4};

use super::{Face, Slab, Slabs};
use crate::bsdf::surface_params;
use crate::clearance::clearance;
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
    /// extinction, 1/m; the axes of the rectangle around it, each with half of its length. Three for each triangle, those of a back
    /// first: a corner and the clearance, and the edges from there.
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
            first += TRIANGLE_ROWS * slab.triangles.iter().map(Vec::len).sum::<usize>();
        }
        let triangles = self.slabs.iter().flat_map(|slab| slab.triangles.iter().flatten());
        rows.extend(triangles.flat_map(|&triangle| triangle_words(scene, triangle)));
        rows
    }
}

impl Slab {
    fn words(&self, scene: &PreparedScene, first_triangle: u32) -> [Row; SLAB_ROWS] {
        let [n_back, n_front] = self.triangles.each_ref().map(Vec::len);
        let looks = self.looks(scene).filter(|_| n_back.max(n_front) <= MOST_TRIANGLES);
        let ([x, y], half) = (self.outline.axes, self.outline.half);
        let (passed, extinction) = looks.unwrap_or_default();
        [
            row(self.normal, self.ior.to_bits()),
            row(self.center, self.thickness.to_bits()),
            row(self.bounds.lo, first_triangle),
            row(self.bounds.hi, n_back as u32 | (n_front as u32) << 16),
            row(passed, u32::from(looks.is_none())),
            row(extinction, 0),
            row(x, half.x.to_bits()),
            row(y, half.y.to_bits()),
        ]
    }

    /// What both faces let pass but for what they reflect, and extinction, 1/m; `None` where that is not the same everywhere, and far
    /// from the origin, where rounding has a say.
    fn looks(&self, scene: &PreparedScene) -> Option<(Vec3, Vec3)> {
        let (mesh, triangle) = (&scene.scene.mesh, *self.triangles[Face::Front as usize].first()?);
        let material = scene.material(triangle);
        let textures =
            [material.base_color_texture, material.metallic_roughness_texture, material.transmission_texture];
        let mut vertices = self.triangles.iter().flatten().flat_map(|&triangle| mesh.triangles[triangle as usize]);
        let is_colored = !mesh.colors.is_empty() && vertices.any(|vertex| mesh.colors[vertex as usize] != Vec4::ONE);
        let is_far = self.bounds.lo.abs().max(self.bounds.hi.abs()).max_element() > scene.extent();
        if textures.iter().any(Option::is_some) || is_colored || is_far {
            return None;
        }
        let params = surface_params(material, &scene.scene.textures, [Vec2::ZERO; 2], None);
        let of_a_face = params.base_color * ((1.0 - params.metallic) * params.transmission);
        Some((of_a_face * of_a_face, scene.extinction_behind(triangle, false)))
    }
}

fn triangle_words(scene: &PreparedScene, triangle: u32) -> [Row; TRIANGLE_ROWS] {
    let [a, b, c] = scene.scene.mesh.corners(triangle);
    let (ab, ac) = (b - a, c - a);
    [row(a, clearance(ab, ac, ab.cross(ac)).to_bits()), row(ab, 0), row(ac, 0)]
}

fn row(numbers: Vec3, word: u32) -> Row {
    let [x, y, z] = numbers.to_array().map(f32::to_bits);
    [x, y, z, word]
}
