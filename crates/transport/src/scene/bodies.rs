//! Parts of a mesh that hang together.

use std::collections::HashMap;
use std::hash::Hash;

use super::Mesh;

impl Mesh {
    /// Some triangles, by what hangs together by its corners and has the same of `own`.
    pub(crate) fn bodies<K: Hash + Eq>(&self, triangles: &[u32], own: impl Fn(u32) -> K) -> Vec<Vec<u32>> {
        let mut parents: Vec<usize> = (0..triangles.len()).collect();
        let mut first_at = HashMap::new();
        for (i, &t) in triangles.iter().enumerate() {
            for corner in self.corners(t) {
                let first = *first_at.entry((own(t), Mesh::place(corner))).or_insert(i);
                let (a, b) = (root(&mut parents, first), root(&mut parents, i));
                parents[a.max(b)] = a.min(b);
            }
        }
        let mut bodies: Vec<Vec<u32>> = vec![Vec::new(); triangles.len()];
        for (i, &t) in triangles.iter().enumerate() {
            bodies[root(&mut parents, i)].push(t);
        }
        bodies.retain(|body| !body.is_empty());
        bodies
    }
}

fn root(parents: &mut [usize], mut i: usize) -> usize {
    while parents[i] != i {
        parents[i] = parents[parents[i]];
        i = parents[i];
    }
    i
}
