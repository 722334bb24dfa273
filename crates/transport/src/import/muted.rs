//! Lights that are off in the file and keep what they are when they are on:
//! `extras: {"clerestory": {"muted": {"lamp": {"color": [1, 0.9, 0.8], "strength": 40}, "surfaces": […]}}}`.
//!
//! Other programs find them dark. What shines in the file all the same was turned on by one of them, and is not muted.

use std::collections::BTreeMap;

use gltf::json::{Node, Root};

use super::assemble::{MaterialSlots, Uses};
use super::document::called;
use super::hierarchy::PlacedNode;
use super::report::Notes;
use super::sensors::extra;
use crate::light::{MutedLight, MutedLights};
use crate::scene::{Material, Scene};

/// What primitives of muted surfaces send when they are on, by index into `Scene::nodes`.
pub(super) struct MutedSurfaces(BTreeMap<u32, Vec<Option<MutedLight>>>);

/// Gives muted lamps the strength that they keep, and finds muted surfaces; `indices` are those of placed nodes in `Scene::nodes`.
pub(super) fn find(
    scene: &mut Scene,
    document: &Root,
    placed: &[PlacedNode],
    indices: &[Option<u32>],
    notes: &mut Notes,
) -> MutedSurfaces {
    let mut surfaces = BTreeMap::new();
    for (placed, node_idx) in placed.iter().zip(indices).filter(|(placed, _)| placed.visible) {
        let node = &document.nodes[placed.index];
        let Some(muted) = marked(node, placed.index, document, notes) else { continue };
        let lamp_idx = node_idx.and_then(|node| scene.punctual.binary_search_by_key(&node, |lamp| lamp.node).ok());
        let is_lost = muted.lamp.is_some() && lamp_idx.is_none();
        if is_lost || (!muted.surfaces.is_empty() && node.mesh.is_none()) {
            let name = called("node", placed.index, node.name.as_ref());
            notes.warn(format!("{name}: it keeps the strength of a muted light that it does not have: it is ignored"));
        }
        let Some(node_idx) = *node_idx else { continue };
        if let (Some(kept), Some(lamp)) = (muted.lamp, lamp_idx.map(|idx| &mut scene.punctual[idx]))
            && (lamp.color * lamp.intensity).max_element() <= 0.0
        {
            (lamp.color, lamp.intensity) = (kept.color, kept.strength);
            scene.muted_lamps.insert(node_idx);
        }
        if !muted.surfaces.is_empty() && node.mesh.is_some() {
            surfaces.insert(node_idx, muted.surfaces);
        }
    }
    MutedSurfaces(surfaces)
}

/// What a node keeps, if it makes sense.
fn marked(node: &Node, index: usize, document: &Root, notes: &mut Notes) -> Option<MutedLights> {
    let muted = serde_json::from_value::<MutedLights>(extra(node, "muted")?).ok();
    let n_primitives = node.mesh.and_then(|mesh| document.get(mesh)).map(|mesh| mesh.primitives.len());
    let has_place = |muted: &MutedLights| {
        muted.surfaces.is_empty() || n_primitives.is_none_or(|n_primitives| n_primitives == muted.surfaces.len())
    };
    let muted = muted.filter(|muted| has_place(muted) && muted.lamp.iter().all(is_sane));
    let muted = muted.filter(|muted| muted.surfaces.iter().flatten().all(is_sane));
    if muted.is_none() {
        let name = called("node", index, node.name.as_ref());
        notes.warn(format!("{name}: what it keeps of its muted lights cannot be read: they stay dark"));
    }
    muted
}

fn is_sane(kept: &MutedLight) -> bool {
    let light = kept.color * kept.strength;
    kept.strength >= 0.0 && kept.color.min_element() >= 0.0 && light.is_finite() && light.max_element() > 0.0
}

impl MutedSurfaces {
    /// Gives the surfaces of a node the light that they keep, unless one of them shines already. Primitives of one material shine
    /// alike: the first of them counts.
    pub(super) fn switch_on(
        &self,
        scene: &mut Scene,
        document: &Root,
        placed: &[PlacedNode],
        indices: &[Option<u32>],
        slots: &mut MaterialSlots,
    ) {
        if self.0.is_empty() {
            return;
        }
        let n_uses = slots.n_uses(document, placed);
        for (placed, node_idx) in placed.iter().zip(indices) {
            let Some((node_idx, kept)) = node_idx.and_then(|idx| Some((idx, self.0.get(&idx)?))) else { continue };
            let mesh = document.nodes[placed.index].mesh.and_then(|mesh| document.get(mesh));
            let primitives = mesh.map_or(&[][..], |mesh| &mesh.primitives);
            if primitives.iter().any(|primitive| scene.materials[slots.of(primitive) as usize].is_emitter()) {
                continue;
            }
            let mut lit: BTreeMap<u32, (Option<MutedLight>, usize)> = BTreeMap::new();
            for (primitive, kept) in primitives.iter().zip(kept) {
                let kept = kept.filter(|_| slots.is_own(primitive));
                let (_, n_here) = lit.entry(slots.of(primitive)).or_insert((kept, 0));
                *n_here = n_here.saturating_add(1);
            }
            for (slot, (kept, n_here)) in lit {
                let material = &scene.materials[slot as usize];
                let Some(kept) = kept.filter(|_| !material.unlit) else { continue };
                let uses = if n_uses.get(&slot) == Some(&n_here) { Uses::Here } else { Uses::Elsewhere };
                let lit = Material { emissive: kept.color, emissive_strength: kept.strength, ..material.clone() };
                slots.light_up(scene, (node_idx, slot), lit, uses);
                scene.muted_surfaces.insert(node_idx);
            }
        }
    }
}
