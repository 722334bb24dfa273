//! Slabs in plain words for a device.

use glam::Vec3;

use super::tree::Node;
use super::{Slab, Slabs};
use crate::prepared::PreparedScene;

type Row = [u32; 4];

/// Rows of all slabs, of a node of their tree, of each slab, and of a triangle.
const HEAD: usize = 1;
const NODE_ROWS: usize = 2;
const SLAB_ROWS: usize = 8;
const TRIANGLE_ROWS: usize = 3;
/// Most triangles of a face that a device knows.
const MOST_TRIANGLES: usize = 0xffff;
/// Bit from which on a node tells how many slabs it has.
const N_BIT: u32 = 29;

impl Slabs {
    /// A row for all slabs: the diagonal of the scene, and last the row of the first slab. Before that two for each node of their tree: the
    /// lower corner and the row of the first node that is not below, or of the first slab where there is none; the upper corner, with the
    /// row of its own first slab and, from bit 29 on, how many it has, none of a fork. Eight for each slab, leaf by leaf: normal and index
    /// of refraction; middle and thickness; its box, with the row of its first triangle, and with the numbers of those of the back and,
    /// from bit 16 on, of the front; what it lets pass but for what it reflects, and 1 where that cannot be told; extinction, 1/m, and 1
    /// where nothing lies in its glass; the axes of the rectangle around it, each with half of its length. Three for each triangle, those
    /// of a back first: a corner and the clearance, and the edges from there. Without slabs the first row is all 0.
    pub(crate) fn words(&self, scene: &PreparedScene) -> Vec<Row> {
        if self.is_empty() {
            return vec![[0; 4]; HEAD];
        }
        let first_slab = HEAD + NODE_ROWS * self.tree.nodes.len();
        let mut rows = vec![[scene.extent().to_bits(), 0, 0, first_slab as u32]];
        rows.extend(self.tree.nodes.iter().flat_map(|node| node.words(first_slab)));
        let slabs: Vec<&Slab> = self.tree.slabs.iter().map(|&idx| &self.slabs[idx as usize]).collect();
        let mut first = first_slab + SLAB_ROWS * slabs.len();
        for slab in &slabs {
            rows.extend(slab.words(scene, first as u32));
            first += TRIANGLE_ROWS * slab.facets.iter().map(Vec::len).sum::<usize>();
        }
        let facets = slabs.iter().flat_map(|slab| slab.facets.iter().flatten());
        rows.extend(facets.flat_map(|facet| facet.words().map(|(numbers, word)| row(numbers, word))));
        rows
    }
}

impl Node {
    fn words(&self, first_slab: usize) -> [Row; NODE_ROWS] {
        let (next, first) = (HEAD + NODE_ROWS * self.next, first_slab + SLAB_ROWS * self.first);
        let own = first as u32 | (self.n as u32) << N_BIT;
        [row(self.bounds.lo, next as u32), row(self.bounds.hi, own)]
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

    /// What both faces let pass but for what they reflect, and extinction, 1/m; `None` where that is not the same everywhere, where they
    /// reflect otherwise than their index has it, and far from the origin, where rounding has a say.
    fn known(&self, scene: &PreparedScene) -> Option<(Vec3, Vec3)> {
        let (looks, front) = (self.looks?, self.facets[1].first()?);
        let is_plain = looks.specular == 1.0 && looks.specular_color == Vec3::ONE;
        let is_far = self.bounds.lo.abs().max(self.bounds.hi.abs()).max_element() > scene.extent();
        let of_a_face = looks.base_color * ((1.0 - looks.metallic) * looks.transmission);
        (is_plain && !is_far)
            .then(|| (of_a_face * of_a_face, scene.extinction_behind(front.triangle, false, Vec3::ZERO)))
    }
}

fn row(numbers: Vec3, word: u32) -> Row {
    let [x, y, z] = numbers.to_array().map(f32::to_bits);
    [x, y, z, word]
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;
    use crate::camera::Camera;
    use crate::laws::slabs::{block, glass};
    use crate::laws::stage::{Stage, lambert, quad};
    use crate::scene::Material;
    use crate::slabs::Bounds;

    /// Upright panes in a grid of so many by three, and a floor.
    fn panes(n_across: u32) -> PreparedScene {
        let camera = Camera::look_at("eye", Vec3::new(0.0, 0.4, 0.6), Vec3::ZERO, 1.0, 1.0);
        let floor = quad(Vec3::new(-1.0, -1.0, -1.0), Vec3::Z * 8.0, Vec3::X * 8.0);
        let stage = Stage::new(camera).surface("floor", &floor, lambert(0.5, 0.0));
        let places = (0..n_across).flat_map(|x| (0..3u32).map(move |z| Vec3::new(x as f32, 0.0, 2.0 * z as f32)));
        let half = Vec3::new(0.4, 0.5, 0.01);
        let add = |stage: Stage, at: Vec3| stage.surface("pane", &block(at, half, Quat::IDENTITY), glass());
        places.fold(stage, add).prepared()
    }

    fn numbers(row: Row) -> Vec3 {
        Vec3::new(f32::from_bits(row[0]), f32::from_bits(row[1]), f32::from_bits(row[2]))
    }

    /// Rows of the slabs that a device visits on a segment, in order.
    fn visited(rows: &[Row], [from, to]: [Vec3; 2]) -> Vec<usize> {
        let (span, inverse) = (Bounds::default().with(from).with(to), 1.0 / (to - from));
        let (mut visited, mut at) = (Vec::new(), HEAD);
        while at < rows[0][3] as usize {
            let bounds = Bounds { lo: numbers(rows[at]), hi: numbers(rows[at + 1]) };
            if bounds.overlaps(&span) && bounds.is_met(from, inverse) {
                let own = rows[at + 1][3];
                let (first, n) = ((own & ((1 << N_BIT) - 1)) as usize, (own >> N_BIT) as usize);
                visited.extend((0..n).map(|nth| first + SLAB_ROWS * nth));
                at += NODE_ROWS;
            } else {
                at = rows[at][3] as usize;
            }
        }
        visited
    }

    #[test]
    fn rows_lead_to_the_slabs_that_the_tree_leads_to() {
        for n_across in [1, 3, 7] {
            let scene = panes(n_across);
            let (slabs, rows) = (&scene.slabs, scene.slabs.words(&scene));
            assert_eq!(slabs.len(), 3 * n_across as usize);
            assert_eq!(f32::from_bits(rows[0][0]), scene.extent());
            let (mut n_visited, mut n_ways) = (0, 0);
            for from in (0..8).map(|x| Vec3::new(x as f32 - 0.5, 0.1, -1.0)) {
                for to in (0..8).map(|x| Vec3::new(x as f32, -0.1, 0.9 + 0.6 * x as f32)) {
                    let found = visited(&rows, [from, to]);
                    let mut expected = Vec::new();
                    slabs.tree.each_on([from, to], |idx| expected.push(&slabs.slabs[idx as usize]));
                    let middles: Vec<Vec3> = found.iter().map(|&slab| numbers(rows[slab + 1])).collect();
                    assert_eq!(middles, expected.iter().map(|slab| slab.center).collect::<Vec<_>>(), "{from} to {to}");
                    for (&at, slab) in found.iter().zip(&expected) {
                        let corners = slab.facets[0][0].words().map(|(numbers, _)| numbers);
                        let first = rows[at + 2][3] as usize;
                        assert_eq!([0, 1, 2].map(|nth| numbers(rows[first + nth])), corners);
                    }
                    (n_visited, n_ways) = (n_visited + found.len(), n_ways + 1);
                }
            }
            // Some ways meet panes, and few meet those of all leaves.
            assert!(n_visited > n_ways / 4, "{n_visited} on {n_ways} ways");
            assert!(n_across < 7 || n_visited < n_ways * slabs.len() / 2, "{n_visited} on {n_ways} ways");
        }
    }

    #[test]
    fn glass_that_reflects_otherwise_than_its_index_has_it_is_left_to_the_cpu() {
        for (specular, is_known) in [(1.0, true), (0.5, false)] {
            let camera = Camera::look_at("eye", Vec3::new(0.0, 0.4, 0.6), Vec3::ZERO, 1.0, 1.0);
            let floor = quad(Vec3::new(-1.0, -1.0, -1.0), Vec3::Z * 8.0, Vec3::X * 8.0);
            let pane = block(Vec3::ZERO, Vec3::new(0.4, 0.5, 0.01), Quat::IDENTITY);
            let stage = Stage::new(camera).surface("floor", &floor, lambert(0.5, 0.0));
            let scene = stage.surface("pane", &pane, Material { specular, ..glass() }).prepared();
            assert_eq!(scene.slabs.slabs[0].known(&scene).is_some(), is_known, "{specular}");
        }
    }

    #[test]
    fn without_slabs_the_only_row_says_so() {
        let scene = panes(0);
        assert_eq!(scene.slabs.words(&scene), [[0u32; 4]]);
    }
}
