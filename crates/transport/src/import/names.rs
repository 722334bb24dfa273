//! What nodes, meshes and lamps are called, for those who sort lights by where they come from.

use std::collections::HashSet;

use gltf::json::Root;
use gltf::json::extensions::scene::khr_lights_punctual::Light;

use super::hierarchy::PlacedNode;

/// Names of a file, each thing with one of its own within its kind.
pub(super) struct Names<'a> {
    document: &'a Root,
    parents: Vec<Option<usize>>,
    meshes: Vec<String>,
    lamps: Vec<String>,
}

impl<'a> Names<'a> {
    pub fn new(document: &'a Root, placed: &[PlacedNode]) -> Names<'a> {
        let mut parents = vec![None; document.nodes.len()];
        for node in placed {
            parents[node.index] = node.parent;
        }
        let lamps: &[Light] = document.as_ref();
        Names {
            document,
            parents,
            meshes: own_names("mesh", document.meshes.iter().map(|mesh| mesh.name.as_deref())),
            lamps: own_names("lamp", lamps.iter().map(|lamp| lamp.name.as_deref())),
        }
    }

    /// Names of the nodes above one, the outermost first.
    pub fn above(&self, index: usize) -> Vec<String> {
        let parent = |index: usize| self.parents.get(index).copied().flatten();
        let name = |index: usize| {
            let name = self.document.nodes[index].name.clone().filter(|name| !name.is_empty());
            name.unwrap_or_else(|| format!("node:{index}"))
        };
        let mut names: Vec<String> = std::iter::successors(parent(index), |above| parent(*above)).map(name).collect();
        names.reverse();
        names
    }

    pub fn mesh(&self, index: usize) -> Option<String> {
        self.meshes.get(index).cloned()
    }

    pub fn lamp(&self, index: usize) -> Option<String> {
        self.lamps.get(index).cloned()
    }
}

/// `KIND:INDEX` without a name, and behind a name that was there before.
fn own_names<'n>(kind: &str, names: impl Iterator<Item = Option<&'n str>>) -> Vec<String> {
    let mut taken = HashSet::new();
    let own = |(index, name): (usize, Option<&'n str>)| match name.filter(|name| !name.is_empty()) {
        Some(name) if taken.insert(name) => name.to_owned(),
        Some(name) => format!("{name} ({kind}:{index})"),
        None => format!("{kind}:{index}"),
    };
    names.enumerate().map(own).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn things_of_one_name_are_told_apart() {
        let names = [Some("Bulb"), None, Some("Bulb"), Some("")];
        assert_eq!(own_names("lamp", names.into_iter()), ["Bulb", "lamp:1", "Bulb (lamp:2)", "lamp:3"]);
    }
}
