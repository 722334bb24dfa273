//! What nodes, meshes and lamps are called, for those who sort lights by where they come from.

use std::collections::HashSet;

use gltf::json::Root;
use gltf::json::extensions::scene::khr_lights_punctual::Light;

use super::hierarchy::PlacedNode;
use crate::scene::Ancestor;

/// Names of a file, each thing with one of its own within its kind.
pub(super) struct Names {
    meshes: Vec<String>,
    lamps: Vec<String>,
}

impl Names {
    pub fn new(document: &Root) -> Names {
        let lamps: &[Light] = document.as_ref();
        Names {
            meshes: own_names("mesh", document.meshes.iter().map(|mesh| mesh.name.as_deref())),
            lamps: own_names("lamp", lamps.iter().map(|lamp| lamp.name.as_deref())),
        }
    }

    pub fn mesh(&self, index: usize) -> Option<String> {
        self.meshes.get(index).cloned()
    }

    pub fn lamp(&self, index: usize) -> Option<String> {
        self.lamps.get(index).cloned()
    }
}

/// What `Scene::ancestors` becomes, and where each node of the file stands in it.
#[expect(clippy::cast_possible_truncation, reason = "fewer nodes than bytes of the file, at most 2³²")]
pub(super) fn ancestors(document: &Root, placed: &[PlacedNode]) -> (Vec<Ancestor>, Vec<Option<u32>>) {
    let mut is_above = vec![false; document.nodes.len()];
    placed.iter().filter_map(|node| node.parent).for_each(|parent| is_above[parent] = true);
    let above: Vec<&PlacedNode> = placed.iter().filter(|node| is_above[node.index]).collect();
    let mut places = vec![None; document.nodes.len()];
    for (place, node) in (0..).zip(&above) {
        places[node.index] = Some(place);
    }
    let ancestor = |node: &&PlacedNode| Ancestor {
        index: node.index as u32,
        name: document.nodes[node.index].name.clone().filter(|name| !name.is_empty()),
        parent: node.parent.and_then(|parent| places[parent]),
    };
    (above.iter().map(ancestor).collect(), places)
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
