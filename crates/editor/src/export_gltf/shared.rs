//! What several nodes of a file use is copied before it is changed for one of them.

use std::collections::BTreeMap;

use anyhow::Result;

use super::raw::{Document, LAMPS, RawObject};

/// How often lamps, meshes and materials of a file are used: what is used once can be changed in place.
#[derive(Default)]
pub(super) struct Shared {
    lamps: BTreeMap<usize, u32>,
    meshes: BTreeMap<usize, u32>,
    materials: BTreeMap<usize, u32>,
}

impl Shared {
    /// Of a file as it is.
    pub fn count(document: &mut Document) -> Shared {
        let mut shared = Shared::default();
        for node in 0..document.len("nodes") {
            let node = document.item("nodes", node).unwrap_or_default();
            lamp_of(&node).into_iter().for_each(|lamp| *shared.lamps.entry(lamp).or_default() += 1);
            node.place("mesh").into_iter().for_each(|mesh| *shared.meshes.entry(mesh).or_default() += 1);
        }
        for mesh in 0..document.len("meshes") {
            let mesh = document.item("meshes", mesh).unwrap_or_default();
            let materials = primitives(&mesh).into_iter().filter_map(|primitive| primitive.place("material"));
            materials.for_each(|material| *shared.materials.entry(material).or_default() += 1);
        }
        shared
    }

    /// Puts a lamp in its place, or as a copy where other nodes have it too.
    pub fn put_lamp(&mut self, document: &mut Document, node: &mut RawObject, idx: usize, lamp: &RawObject) {
        if self.lamps.get(&idx).is_some_and(|n_uses| *n_uses > 1) {
            *self.lamps.entry(idx).or_default() -= 1;
            let copy = document.push(LAMPS, lamp);
            node.change("extensions", |all| all.change(LAMPS, |own| own.set("light", &copy)));
        } else {
            document.put(LAMPS, idx, lamp);
        }
    }

    /// Changes materials of the mesh of a node, as copies where others use them. `change` is asked once for each, with the first
    /// primitive that has it, and answers what becomes of it.
    ///
    /// # Errors
    /// If the file refers to what it does not have.
    pub fn change_materials(
        &mut self,
        document: &mut Document,
        node_idx: usize,
        mut change: impl FnMut(usize, RawObject) -> Option<RawObject>,
    ) -> Result<()> {
        let mut node = document.item("nodes", node_idx)?;
        let Some(mesh_idx) = node.place("mesh") else { return Ok(()) };
        let mut mesh = document.item("meshes", mesh_idx)?;
        let mut parts = primitives(&mesh);
        let is_shared_mesh = self.meshes.get(&mesh_idx).is_some_and(|n_uses| *n_uses > 1);
        let mut places: BTreeMap<usize, Option<usize>> = BTreeMap::new();
        for (nth, part) in parts.iter_mut().enumerate() {
            let Some(idx) = part.place("material") else { continue };
            let place = match places.get(&idx) {
                Some(place) => *place,
                None => change(nth, document.item("materials", idx)?).map(|material| {
                    let is_alone = !is_shared_mesh && self.is_within(&mesh, idx);
                    if is_alone {
                        document.put("materials", idx, &material);
                        idx
                    } else {
                        document.push("materials", &material)
                    }
                }),
            };
            places.insert(idx, place);
            place.iter().for_each(|place| part.set("material", place));
        }
        if places.values().flatten().next().is_none() {
            return Ok(());
        }
        mesh.set("primitives", &parts);
        if is_shared_mesh {
            *self.meshes.entry(mesh_idx).or_default() -= 1;
            let copy = document.push("meshes", &mesh);
            node.set("mesh", &copy);
            document.put("nodes", node_idx, &node);
        } else {
            document.put("meshes", mesh_idx, &mesh);
        }
        Ok(())
    }

    /// Whether no other mesh has a material.
    fn is_within(&self, mesh: &RawObject, material: usize) -> bool {
        let parts = primitives(mesh);
        let n_here = parts.iter().filter(|part| part.place("material") == Some(material)).count();
        self.materials.get(&material).is_none_or(|n_uses| *n_uses as usize <= n_here)
    }
}

/// The lamp of a node, by its number.
pub(super) fn lamp_of(node: &RawObject) -> Option<usize> {
    node.read::<RawObject>("extensions")?.read::<RawObject>(LAMPS)?.place("light")
}

/// The primitives of a mesh.
pub(super) fn primitives(mesh: &RawObject) -> Vec<RawObject> {
    mesh.read("primitives").unwrap_or_default()
}
