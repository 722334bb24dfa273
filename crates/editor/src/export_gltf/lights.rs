//! Lamps and shining surfaces of the file, as they are set.

use std::collections::BTreeMap;

use anyhow::Result;
use clerestory_transport::basis::{LightBasis, LightSource, SourceKind};
use clerestory_transport::emitters::{Emitter, share_of};
use clerestory_transport::light::{LightRig, PanelSpot};
use clerestory_transport::prepared::PreparedScene;
use glam::Vec3;

use super::raw::{Document, LAMPS, PROFILES, RawObject};

const STRENGTH: &str = "KHR_materials_emissive_strength";
/// Relative difference up to which light is the same.
const SAME: f32 = 1e-6;
/// Lights that a warning names.
const MOST_NAMES: usize = 4;
/// A spot that covers its panel.
const WHOLE: PanelSpot = PanelSpot { position: [0.5, 0.5], radius: 100.0, color: None, intensity: 1.0 };

/// Writes every light of the file as a rig has it. Answers a sentence for each thing that glTF cannot hold.
pub(super) fn write(document: &mut Document, scene: &PreparedScene, rig: &LightRig) -> Result<Vec<String>> {
    let basis = &scene.lighting.basis;
    let (lit, plain) = (whole(basis, rig, None), whole(basis, &LightRig::default(), None));
    let gains = whole(basis, rig, Some([1.0; 3]));
    let mut shared = Shared::count(document);
    let mut warnings = Vec::new();
    let mut dark = Vec::new();
    for (source, emitter) in basis.sources.iter().zip(&scene.lighting.emitters) {
        let first = source.columns.start as usize;
        let (now, file) = (Vec3::from(lit[first]), Vec3::from(plain[first]));
        if now == Vec3::ZERO && file != Vec3::ZERO && source.kind != SourceKind::Constant {
            dark.push(format!("`{}`", source.key));
        }
        let node_of = |node: u32| scene.scene.nodes[node as usize].index as usize;
        match emitter {
            Emitter::Punctual(lamp) => {
                write_lamp(document, &mut shared, node_of(lamp.node), lamp.profile.map(|_| source.strength), now)?;
            }
            Emitter::Surface(surface) => {
                let Some(triangle) = surface.triangles.first().map(|t| t.triangle) else { continue };
                let node = node_of(scene.scene.mesh.triangle_node[triangle as usize]);
                write_surface(document, &mut shared, node, (now, file))?;
            }
            Emitter::Panel(panel) => {
                let node = node_of(scene.scene.mesh.triangle_node[panel.triangle as usize]);
                let strength = write_surface(document, &mut shared, node, (now, file))?;
                // A spot with a color of its own shines by strength alone.
                let colored = if strength > 0.0 { gains[first][0] / strength } else { 1.0 };
                write_spots(document, node, panel.resolution, basis.spots_of(rig, &source.key), colored)?;
            }
            _ if source.kind != SourceKind::Constant && !is_same(now, file) => warnings.push(left_out(source)),
            _ => {}
        }
    }
    if !dark.is_empty() {
        let more = dark.len().saturating_sub(MOST_NAMES);
        dark.truncate(MOST_NAMES);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        warnings.push(format!(
            "off, and so dark in the file, which holds no switches: {}{more}; their strength stays in the scene they come from",
            dark.join(", ")
        ));
    }
    if rig.sky.is_some() {
        warnings.push("glTF holds no sky; open the file with the look, or bake it with --sky".into());
    }
    Ok(warnings)
}

fn left_out(source: &LightSource) -> String {
    format!("`{}` is no light of the file, so how it is set is not written", source.key)
}

/// Light of each column under a rig with its panels whole, in their own color or another one.
fn whole(basis: &LightBasis, rig: &LightRig, color: Option<[f32; 3]>) -> Vec<[f32; 3]> {
    let panels = basis.sources.iter().filter(|source| matches!(source.kind, SourceKind::Panel { .. }));
    let panels = panels.map(|panel| (panel.key.clone(), vec![PanelSpot { color, ..WHOLE }])).collect();
    basis.project(&LightRig { panels, ..rig.clone() })
}

fn is_same(a: Vec3, b: Vec3) -> bool {
    (a - b).abs().max_element() <= SAME * b.abs().max_element()
}

/// How many times more light it is, if it is of the same color.
fn factor(now: Vec3, file: Vec3) -> Option<f32> {
    let factor = now.max_element() / file.max_element();
    (factor.is_finite() && is_same(file * factor, now)).then_some(factor)
}

/// Color with a largest channel of 1, and strength; white where it is dark.
pub(super) fn color_and_strength(light: Vec3) -> ([f32; 3], f32) {
    let strength = light.max_element();
    (if strength > 0.0 { (light / strength).to_array() } else { [1.0; 3] }, strength)
}

/// How often lamps, meshes and materials of a file are used: what is used once can be changed in place.
struct Shared {
    lamps: BTreeMap<usize, u32>,
    meshes: BTreeMap<usize, u32>,
    materials: BTreeMap<usize, u32>,
}

impl Shared {
    fn count(document: &mut Document) -> Shared {
        let mut shared = Shared { lamps: BTreeMap::new(), meshes: BTreeMap::new(), materials: BTreeMap::new() };
        for node in 0..document.len("nodes") {
            let node = document.item("nodes", node).unwrap_or_default();
            lamp_of(&node).into_iter().for_each(|lamp| *shared.lamps.entry(lamp).or_default() += 1);
            node.read("mesh").into_iter().for_each(|mesh| *shared.meshes.entry(mesh).or_default() += 1);
        }
        for mesh in 0..document.len("meshes") {
            let mesh = document.item("meshes", mesh).unwrap_or_default();
            let materials = primitives(&mesh).into_iter().filter_map(|primitive| primitive.read::<usize>("material"));
            materials.for_each(|material| *shared.materials.entry(material).or_default() += 1);
        }
        shared
    }
}

fn lamp_of(node: &RawObject) -> Option<usize> {
    node.read::<RawObject>("extensions")?.read::<RawObject>(LAMPS)?.read("light")
}

fn primitives(mesh: &RawObject) -> Vec<RawObject> {
    mesh.read("primitives").unwrap_or_default()
}

/// A lamp of KHR_lights_punctual, with the measured distribution of EXT_lights_ies or without. `measured_cd` is the most that
/// its distribution and multiplier send in the file, candela.
fn write_lamp(
    document: &mut Document,
    shared: &mut Shared,
    node_idx: usize,
    measured_cd: Option<f32>,
    now: Vec3,
) -> Result<()> {
    let mut node = document.item("nodes", node_idx)?;
    let lamp_idx = lamp_of(&node);
    let mut lamp = lamp_idx.map(|idx| document.item(LAMPS, idx)).transpose()?;
    let own_color: Vec3 = lamp.as_ref().and_then(|lamp| lamp.read::<[f32; 3]>("color")).map_or(Vec3::ONE, Vec3::from);
    if let Some(measured_cd) = measured_cd {
        let mut instance =
            node.read::<RawObject>("extensions").and_then(|all| all.read::<RawObject>(PROFILES)).unwrap_or_default();
        let tint = instance.read::<[f32; 3]>("color").map_or(Vec3::ONE, Vec3::from);
        let of_file = own_color * tint * measured_cd;
        if is_same(now, of_file) {
            return Ok(());
        }
        let multiplier: f32 = instance.read("multiplier").unwrap_or(1.0);
        let by = factor(now, of_file).unwrap_or_else(|| now.max_element() / measured_cd);
        instance.set("multiplier", &(multiplier * by));
        if factor(now, of_file).is_none() {
            // The color of the instance is multiplied by that of its plain lamp, which becomes white.
            instance.set("color", &color_and_strength(now).0);
            lamp.iter_mut().for_each(|lamp| lamp.set("color", &[1.0f32; 3]));
        } else {
            lamp = None;
        }
        node.change("extensions", |all| all.set(PROFILES, &instance));
    } else if let Some(lamp) = &mut lamp {
        let of_file = own_color * lamp.read::<f32>("intensity").unwrap_or(1.0);
        if is_same(now, of_file) {
            return Ok(());
        }
        match factor(now, own_color) {
            Some(intensity) => lamp.set("intensity", &intensity),
            None => {
                let (color, intensity) = color_and_strength(now);
                lamp.set("color", &color);
                lamp.set("intensity", &intensity);
            }
        }
    }
    if let (Some(idx), Some(lamp)) = (lamp_idx, lamp) {
        if shared.lamps.get(&idx).is_some_and(|n_uses| *n_uses > 1) {
            *shared.lamps.entry(idx).or_default() -= 1;
            let copy = document.push(LAMPS, &lamp);
            node.change("extensions", |all| all.change(LAMPS, |own| own.set("light", &copy)));
        } else {
            document.put(LAMPS, idx, &lamp);
        }
    }
    document.put("nodes", node_idx, &node);
    Ok(())
}

/// The shining materials of a node: `now` and `file` are what its light sends at most, nit. Answers the largest emissive strength
/// that they have then.
fn write_surface(
    document: &mut Document,
    shared: &mut Shared,
    node_idx: usize,
    (now, file): (Vec3, Vec3),
) -> Result<f32> {
    let mut node = document.item("nodes", node_idx)?;
    let Some(mesh_idx) = node.read::<usize>("mesh") else { return Ok(0.0) };
    let mut mesh = document.item("meshes", mesh_idx)?;
    let mut parts = primitives(&mesh);
    let is_changed = !is_same(now, file);
    let is_shared_mesh = is_changed && shared.meshes.get(&mesh_idx).is_some_and(|n_uses| *n_uses > 1);
    let (mut written, mut strongest) = (BTreeMap::new(), 0.0f32);
    for part in &mut parts {
        let Some(idx) = part.read::<usize>("material") else { continue };
        let material = document.item("materials", idx)?;
        let Some(emission) = Emission::of(&material) else { continue };
        if !is_changed {
            strongest = strongest.max(emission.strength);
            continue;
        }
        let (new_idx, strength) = *match written.get(&idx) {
            Some(known) => known,
            None => {
                let (material, strength) = emission.lit(material, now, file);
                let uses_here = parts_with(&mesh, idx);
                let is_alone = !is_shared_mesh && shared.materials.get(&idx).is_none_or(|n_uses| *n_uses <= uses_here);
                let new_idx = if is_alone {
                    document.put("materials", idx, &material);
                    idx
                } else {
                    document.push("materials", &material)
                };
                written.entry(idx).or_insert((new_idx, strength))
            }
        };
        strongest = strongest.max(strength);
        part.set("material", &new_idx);
    }
    if is_changed {
        document.uses(STRENGTH);
        mesh.set("primitives", &parts);
        if is_shared_mesh {
            *shared.meshes.entry(mesh_idx).or_default() -= 1;
            let copy = document.push("meshes", &mesh);
            node.set("mesh", &copy);
            document.put("nodes", node_idx, &node);
        } else {
            document.put("meshes", mesh_idx, &mesh);
        }
    }
    Ok(strongest)
}

fn parts_with(mesh: &RawObject, material: usize) -> u32 {
    primitives(mesh).iter().filter(|part| part.read::<usize>("material") == Some(material)).count() as u32
}

/// How a material shines.
struct Emission {
    factor: Vec3,
    strength: f32,
}

impl Emission {
    /// None where it does not, or where no light is set by it: unlit surfaces show themselves.
    fn of(material: &RawObject) -> Option<Emission> {
        let extensions: RawObject = material.read("extensions").unwrap_or_default();
        let factor = material.read::<[f32; 3]>("emissiveFactor").map(Vec3::from)?;
        let strength =
            extensions.read::<RawObject>(STRENGTH).and_then(|own| own.read("emissiveStrength")).unwrap_or(1.0);
        let shines = (factor * strength).max_element() > 0.0 && extensions.get("KHR_materials_unlit").is_none();
        shines.then_some(Emission { factor, strength })
    }

    /// The material when its light sends `now` instead of `file`, and its strength.
    fn lit(&self, mut material: RawObject, now: Vec3, file: Vec3) -> (RawObject, f32) {
        let strength = match factor(now, file) {
            Some(by) => self.strength * by,
            None => {
                let (color, strength) = color_and_strength(now * share_of(self.factor * self.strength, file));
                material.set("emissiveFactor", &color);
                strength
            }
        };
        let own = |own: &mut RawObject| own.set("emissiveStrength", &strength);
        material.change("extensions", |all| all.change(STRENGTH, own));
        (material, strength)
    }
}

/// Marks a panel and its spots on its node. `colored` is how much brighter spots with a color of their own have to be.
fn write_spots(
    document: &mut Document,
    node_idx: usize,
    resolution: u32,
    spots: Option<&Vec<PanelSpot>>,
    colored: f32,
) -> Result<()> {
    let mut node = document.item("nodes", node_idx)?;
    let own =
        node.read::<RawObject>("extras").and_then(|extras| extras.read::<RawObject>("clerestory")).unwrap_or_default();
    if spots.is_none() && own.read::<f64>("panel") == Some(f64::from(resolution)) {
        return Ok(());
    }
    node.change("extras", |extras| {
        extras.change("clerestory", |own| {
            own.set("panel", &resolution);
            if let Some(spots) = spots {
                let brighter = |spot: &PanelSpot| {
                    let by = if spot.color.is_some() { colored } else { 1.0 };
                    PanelSpot { intensity: spot.intensity * by, ..*spot }
                };
                own.set("spots", &spots.iter().map(brighter).collect::<Vec<_>>());
            }
        });
    });
    document.put("nodes", node_idx, &node);
    Ok(())
}
