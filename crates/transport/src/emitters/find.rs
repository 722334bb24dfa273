//! Which lights a scene has, what they are called, and which of them become panels.

use std::collections::{BTreeMap, BTreeSet};

use super::{Emitter, LightingError, PANEL_RESOLUTION, PanelRequest, panel_emitter, panel_source, surface_source};
use crate::basis::{KeyMaker, LightSource};
use crate::origin::LightOrigin;
use crate::scene::{PunctualKind, PunctualLight, Scene, SceneNode};
use crate::sky::SunEmitter;

pub(super) type Found = Vec<(LightSource, Emitter)>;

/// A light of the file with its key.
struct Candidate<'a> {
    key: String,
    kind: CandidateKind<'a>,
}

enum CandidateKind<'a> {
    Lamp(&'a PunctualLight),
    Surface { node: &'a SceneNode, triangles: Vec<u32> },
}

/// Lights in node order, a node's lamp before its surfaces.
fn candidates(scene: &Scene) -> Vec<Candidate<'_>> {
    let mut triangles_of_node: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    let mut dark_nodes = BTreeSet::new();
    for triangle in 0..scene.mesh.triangles.len() as u32 {
        let (slot, node) =
            (scene.mesh.triangle_material[triangle as usize], scene.mesh.triangle_node[triangle as usize]);
        let is_emitter = scene.materials[slot as usize].is_emitter();
        let is_dark = scene.dark_materials.contains(&slot);
        if !(is_emitter || is_dark) || scene.mesh.area_normal(triangle).length_squared() <= 0.0 {
            continue;
        }
        if is_emitter {
            triangles_of_node.entry(node).or_default().push(triangle);
        } else {
            dark_nodes.insert(node);
        }
    }
    let mut lamps_of_node: BTreeMap<u32, Vec<&PunctualLight>> = BTreeMap::new();
    for light in &scene.punctual {
        lamps_of_node.entry(light.node).or_default().push(light);
    }
    let (mut keys, mut found) = (KeyMaker::default(), Vec::new());
    for (node_idx, node) in (0..).zip(&scene.nodes) {
        let mut add = |kind| found.push(Candidate { key: keys.key(node.name.as_deref(), node.index), kind });
        let lamps = lamps_of_node.remove(&node_idx).unwrap_or_default();
        lamps.into_iter().for_each(|light| add(CandidateKind::Lamp(light)));
        if let Some(triangles) = triangles_of_node.remove(&node_idx) {
            add(CandidateKind::Surface { node, triangles });
        } else if dark_nodes.contains(&node_idx) {
            // Looks know those behind it by the number that they have with it.
            keys.key(node.name.as_deref(), node.index);
        }
    }
    found
}

/// Keys of the lamps, in the order of `Scene::punctual`, which is that of the nodes.
pub(crate) fn lamp_keys(scene: &Scene) -> Vec<String> {
    let lamps = candidates(scene).into_iter().filter(|light| matches!(light.kind, CandidateKind::Lamp(_)));
    lamps.map(|light| light.key).collect()
}

impl Scene {
    /// Its lamp of that key, which is that of its light in looks; `None` of what shines by a surface, and of a sky and its sun.
    pub fn lamp_called(&self, key: &str) -> Option<&PunctualLight> {
        candidates(self).into_iter().find_map(|light| match light.kind {
            CandidateKind::Lamp(lamp) if light.key == key => Some(lamp),
            _ => None,
        })
    }
}

/// Keys of the lights that are off in the file.
pub(super) fn muted_keys(scene: &Scene) -> BTreeSet<String> {
    if scene.muted_lamps.is_empty() && scene.muted_surfaces.is_empty() {
        return BTreeSet::new();
    }
    let is_muted = |light: &Candidate| match &light.kind {
        CandidateKind::Lamp(lamp) => scene.muted_lamps.contains(&lamp.node),
        CandidateKind::Surface { triangles, .. } => {
            let node = triangles.first().map(|triangle| scene.mesh.triangle_node[*triangle as usize]);
            node.is_some_and(|node| scene.muted_surfaces.contains(&node))
        }
    };
    candidates(scene).into_iter().filter(is_muted).map(|light| light.key).collect()
}

/// The lights of a scene, with the panels that the scene or `requests` ask for.
pub(super) fn find_lights(
    scene: &Scene,
    requests: &[PanelRequest],
    warnings: &mut Vec<String>,
) -> Result<Found, LightingError> {
    let candidates = candidates(scene);
    let asked = resolve(requests, &candidates)?;
    warn_of_dark_panels(scene, &candidates, warnings);
    let mut found = Found::new();
    for (Candidate { key, kind }, asked) in candidates.into_iter().zip(asked) {
        found.push(match kind {
            CandidateKind::Lamp(light) => {
                let (color, strength) = (light.color, light.intensity);
                let origin = LightOrigin::of_lamp(scene, light);
                let source = LightSource { key, kind: light.kind.into(), columns: 0..1, color, strength, origin };
                (source, emitter_of(light))
            }
            CandidateKind::Surface { node, triangles } => {
                match asked.or(node.panel).map(|m| panel_emitter(scene, &triangles, m)) {
                    Some(Ok(panel)) => panel_source(scene, key, node, &triangles, panel),
                    Some(Err(reason)) if asked.is_some() => return Err(LightingError::NotAQuad { node: key, reason }),
                    Some(Err(reason)) => {
                        warnings.push(format!("node `{key}` asks to be a panel but {reason}; it is one luminaire"));
                        surface_source(scene, key, node, &triangles)
                    }
                    None => surface_source(scene, key, node, &triangles),
                }
            }
        });
    }
    Ok(found)
}

/// A directional lamp with a size is a disk behind everything.
fn emitter_of(light: &PunctualLight) -> Emitter {
    if light.kind == PunctualKind::Directional && light.radius_rad > 0.0 {
        return Emitter::Sun(SunEmitter { direction: -light.direction, radius_rad: f64::from(light.radius_rad) });
    }
    Emitter::Punctual(light.clone())
}

/// Texels per side that are asked of each light. A key means its own light; the name of a node whose light has another
/// key means the first such one.
fn resolve(requests: &[PanelRequest], candidates: &[Candidate]) -> Result<Vec<Option<u32>>, LightingError> {
    let surfaces = || {
        candidates.iter().enumerate().filter_map(|(idx, light)| match &light.kind {
            CandidateKind::Surface { node, .. } => Some((idx, light.key.as_str(), *node)),
            CandidateKind::Lamp(_) => None,
        })
    };
    let mut asked = vec![None; candidates.len()];
    for PanelRequest { node, resolution } in requests {
        if !PANEL_RESOLUTION.contains(resolution) {
            return Err(LightingError::Resolution { node: node.clone(), resolution: *resolution });
        }
        let by_key = surfaces().find(|(_, key, _)| key == node);
        let Some((idx, key, _)) = by_key.or_else(|| surfaces().find(|(_, _, own)| own.is_named(node))) else {
            let known: Vec<&str> = surfaces().map(|(_, key, _)| key).take(20).collect();
            let known = if known.is_empty() { "none".to_string() } else { known.join(", ") };
            return Err(LightingError::UnknownPanelNode { node: node.clone(), known });
        };
        if asked[idx].replace(*resolution).is_some() {
            return Err(LightingError::Twice { node: key.to_string() });
        }
    }
    Ok(asked)
}

/// Nodes that ask to be a panel in the file and shine by no surface of their own.
fn warn_of_dark_panels(scene: &Scene, candidates: &[Candidate], warnings: &mut Vec<String>) {
    let shines = |index: u32| {
        candidates.iter().any(|light| matches!(&light.kind, CandidateKind::Surface { node, .. } if node.index == index))
    };
    for node in scene.nodes.iter().filter(|node| node.panel.is_some() && !shines(node.index)) {
        let name = node.key();
        warnings.push(format!("node `{name}` asks to be a panel but its own surfaces do not emit light; it is none"));
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};

    use super::*;
    use crate::basis::SourceKind;
    use crate::emitters::Lighting;
    use crate::laws::stage::textured;
    use crate::scene::{Encoding, Material, Mesh};

    /// A quad per node, named `P` but for the last, which has no name; the second does not shine.
    fn quads() -> Scene {
        let shining = Material { emissive: Vec3::ONE, ..Material::default() };
        let mut scene = Scene { materials: vec![Material::default(), shining], ..Scene::default() };
        let Mesh { positions, normals, triangles, triangle_material, triangle_node, .. } = &mut scene.mesh;
        for (node, material) in [1, 0, 1, 1].into_iter().enumerate() {
            let (first, node) = (positions.len() as u32, node as u32);
            let corners = [Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y];
            positions.extend(corners.map(|corner| corner + Vec3::Z * node as f32));
            normals.extend([Vec3::Z; 4]);
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
            triangle_material.extend([material; 2]);
            triangle_node.extend([node; 2]);
            let name = (node < 3).then(|| "P".to_owned());
            scene.nodes.push(SceneNode { index: node, name, ..SceneNode::default() });
        }
        scene
    }

    fn panels(asked: &[&str]) -> Result<Vec<String>, LightingError> {
        let requests: Vec<_> = asked.iter().map(|node| PanelRequest { node: (*node).into(), resolution: 8 }).collect();
        let (lighting, _) = Lighting::new(&quads(), &requests)?;
        let is_panel = |source: &&LightSource| matches!(source.kind, SourceKind::Panel { .. });
        Ok(lighting.basis.sources.iter().filter(is_panel).map(|source| source.key.clone()).collect())
    }

    #[test]
    fn a_panel_is_asked_for_by_the_key_of_its_light() {
        assert_eq!(panels(&["P"]).expect("the first P"), ["P"]);
        assert_eq!(panels(&["P#2"]).expect("the second P that shines"), ["P#2"]);
        assert_eq!(panels(&["P", "P#2", "node:3"]).expect("all three"), ["P", "P#2", "node:3"]);
        assert_eq!(panels(&["node:2"]).expect("by its index"), ["P#2"]);
        let unknown = panels(&["P#3"]).expect_err("only two shine").to_string();
        assert!(unknown.ends_with("P, P#2, node:3"), "{unknown}");
        assert!(matches!(panels(&["P", "P"]), Err(LightingError::Twice { .. })));
        assert!(matches!(panels(&["P#2", "node:2"]), Err(LightingError::Twice { .. })));
    }

    #[test]
    fn a_surface_that_was_put_out_leaves_the_others_their_keys() {
        let mut scene = quads();
        scene.materials.push(Material::default());
        scene.dark_materials.insert(2);
        scene.mesh.triangle_material[..2].fill(2);
        let keys = |scene: &Scene| -> Vec<String> {
            let (lighting, _) = Lighting::new(scene, &[]).expect("no request can fail");
            lighting.basis.sources.into_iter().map(|source| source.key).collect()
        };
        assert_eq!(keys(&scene), ["P#2", "node:3"]);
        scene.dark_materials.clear();
        assert_eq!(keys(&scene), ["P", "node:3"]);
    }

    #[test]
    fn a_quad_whose_halves_shine_to_opposite_sides_is_no_panel_unless_both_shine_to_both() {
        let mut scene = quads();
        scene.mesh.triangles[1].swap(1, 2);
        let asked = |scene: &Scene| {
            let request = PanelRequest { node: "P".into(), resolution: 8 };
            Lighting::new(scene, &[request]).map(|(lighting, _)| lighting.basis.n_cols())
        };
        let error = asked(&scene).expect_err("one half is turned").to_string();
        assert!(error.contains("opposite sides"), "{error}");
        scene.nodes[0].panel = Some(8);
        let (lighting, warnings) = Lighting::new(&scene, &[]).expect("no request can fail");
        assert_eq!(lighting.basis.n_cols(), 3, "it is one luminaire");
        assert!(warnings.iter().any(|warning| warning.contains("opposite sides")), "{warnings:?}");
        scene.materials[1].double_sided = true;
        assert_eq!(asked(&scene).expect("either half shines to both sides"), 8 * 8 + 2);
    }

    #[test]
    fn a_quad_whose_texture_does_not_go_on_across_its_middle_is_no_panel() {
        let mut scene = quads();
        let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        scene.mesh.uvs[0] = (0..4).flat_map(|_| corners).collect();
        scene.materials[1].emissive_texture = textured(Encoding::Srgb);
        let asked = |scene: &Scene| {
            let request = PanelRequest { node: "P".into(), resolution: 8 };
            Lighting::new(scene, &[request]).map(|(lighting, _)| lighting.basis.n_cols())
        };
        assert_eq!(asked(&scene).expect("it goes on"), 8 * 8 + 2);
        // One color of a palette, with corners that were rounded each by itself.
        let rounded = [Vec2::ZERO, Vec2::X, Vec2::ZERO, Vec2::Y].map(|by| Vec2::new(0.3, 0.7) + 1e-6 * by);
        let pieces = std::mem::replace(&mut scene.mesh.uvs[0], (0..4).flat_map(|_| rounded).collect());
        assert_eq!(asked(&scene).expect("it is one color"), 8 * 8 + 2);
        scene.mesh.uvs[0] = pieces;
        // The second triangle gets corners of its own, with the piece of the texture that the first one has.
        let first = scene.mesh.positions.len() as u32;
        for (corner, uv) in [0, 2, 3].into_iter().zip([Vec2::ZERO, Vec2::X, Vec2::ONE]) {
            scene.mesh.positions.push(scene.mesh.positions[corner]);
            scene.mesh.normals.push(Vec3::Z);
            scene.mesh.uvs[0].push(uv);
        }
        scene.mesh.triangles[1] = [first, first + 1, first + 2];
        let error = asked(&scene).expect_err("it does not").to_string();
        assert!(error.contains("texture"), "{error}");
        scene.materials[1].emissive_texture = None;
        assert_eq!(asked(&scene).expect("nothing is textured"), 8 * 8 + 2);
    }

    #[test]
    fn a_panel_that_does_not_shine_is_named() {
        let mut scene = quads();
        scene.nodes[1].panel = Some(8);
        scene.nodes[1].name = Some("dark".into());
        let (_, warnings) = Lighting::new(&scene, &[]).expect("no request can fail");
        assert!(matches!(warnings.as_slice(), [one] if one.contains("`dark`")), "{warnings:?}");
    }
}
