//! Lamps and shining surfaces of the file, as they are set.

use anyhow::{Result, ensure};
use clerestory_transport::basis::{LightBasis, LightSource, SourceKind};
use clerestory_transport::emitters::{Emitter, Lighting};
use clerestory_transport::light::{LightRig, PanelSpot};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::Scene;
use glam::Vec3;

use super::emission::{Emission, STRENGTH};
use super::lamps;
use super::muted::{self, Part};
use super::raw::{Document, LAMPS, OWN, PROFILES, RawObject};
use super::shared::{Shared, lamp_of};

/// Relative difference up to which light is the same.
const SAME: f32 = 1e-6;
/// A spot that covers its panel.
const WHOLE: PanelSpot = PanelSpot { position: [0.5, 0.5], radius: 100.0, color: None, intensity: 1.0 };

/// Writes every light of the file as a rig has it. Answers a sentence for each thing that glTF cannot hold.
pub(super) fn write(document: &mut Document, scene: &PreparedScene, rig: &LightRig) -> Result<Vec<String>> {
    let (Lighting { basis, emitters, .. }, scene) = (&scene.lighting, &scene.scene);
    let mut shared = Shared::count(document);
    muted::switch_on(document, &mut shared, scene)?;
    let rigs = [rig.clone(), muted::switched_on(rig)];
    let plain = whole(basis, &LightRig::default(), None);
    let lit = rigs.each_ref().map(|rig| whole(basis, rig, None));
    let gains = rigs.each_ref().map(|rig| whole(basis, rig, Some([1.0; 3])));
    let mut warnings = Vec::new();
    for (source, emitter) in basis.sources.iter().zip(emitters) {
        let first = source.columns.start as usize;
        let [as_set, on] = lit.each_ref().map(|light| Vec3::from(light[first]));
        ensure!(
            as_set.is_finite() && on.is_finite(),
            "the light of `{}` is no finite number, so no scene was written; check the intensities of the look",
            source.key
        );
        // What is off is written as it is when it is on, and turned off then.
        let is_off = as_set == Vec3::ZERO && on != Vec3::ZERO;
        let (now, file) = (if is_off { on } else { as_set }, Vec3::from(plain[first]));
        let (node, part) = match emitter {
            Emitter::Punctual(lamp) => {
                let (node, most_cd) = (file_node(scene, lamp.node), muted::most_cd(document, scene, lamp)?);
                write_lamp(document, &mut shared, node, most_cd.map(|_| source.strength), now)?;
                (node, Part::Lamp(most_cd))
            }
            // A directional lamp that was given a size. What lights the sky is no lamp of the file.
            Emitter::Sun(_) if source.kind == SourceKind::Directional => {
                let Some(lamp) = scene.lamp_called(&source.key) else { continue };
                let node = file_node(scene, lamp.node);
                write_lamp(document, &mut shared, node, None, now)?;
                warnings.push(lamps::without_angle(&source.key));
                (node, Part::Lamp(None))
            }
            Emitter::Surface(surface) => {
                let Some(triangle) = surface.triangles.first() else { continue };
                let node = file_node(scene, scene.mesh.triangle_node[triangle.triangle as usize]);
                write_surface(document, &mut shared, node, (now, file))?;
                (node, Part::Surfaces)
            }
            Emitter::Panel(panel) => {
                let node = file_node(scene, scene.mesh.triangle_node[panel.triangle as usize]);
                let strength = write_surface(document, &mut shared, node, (now, file))?;
                // A spot with a color of its own shines by strength alone.
                let gain = gains[usize::from(is_off)][first][0];
                let colored = if strength > 0.0 { gain / strength } else { 1.0 };
                let spots = basis.spots_of(rig, &source.key);
                let n_beyond = write_spots(document, node, panel.resolution, spots, colored)?;
                warnings.extend((n_beyond > 0).then(|| beyond(n_beyond, source)));
                (node, Part::Surfaces)
            }
            _ => {
                warnings.extend((!is_same(as_set, file)).then(|| left_out(source)));
                continue;
            }
        };
        if is_off {
            muted::darken(document, &mut shared, node, part)?;
        }
    }
    if rig.sky.is_some() {
        warnings.push("glTF holds no sky; open the file with the look, or bake it with --sky".into());
    }
    Ok(warnings)
}

/// Index in the file of a node of the scene.
pub(super) fn file_node(scene: &Scene, node: u32) -> usize {
    scene.nodes[node as usize].index as usize
}

fn left_out(source: &LightSource) -> String {
    format!("`{}` is no light of the file, so how it is set is not written", source.key)
}

fn beyond(n_spots: usize, source: &LightSource) -> String {
    let spots = if n_spots == 1 { "a spot".to_owned() } else { format!("{n_spots} spots") };
    format!("{spots} of `{}` would be brighter than a file can hold, and as bright as it can is written", source.key)
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
pub(super) fn factor(now: Vec3, file: Vec3) -> Option<f32> {
    let factor = now.max_element() / file.max_element();
    (factor.is_finite() && is_same(file * factor, now)).then_some(factor)
}

/// Color with a largest channel of 1, and strength; white where it is dark.
pub(super) fn color_and_strength(light: Vec3) -> ([f32; 3], f32) {
    let strength = light.max_element();
    (if strength > 0.0 { (light / strength).to_array() } else { [1.0; 3] }, strength)
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
    let own_color = lamp.as_ref().and_then(|lamp| lamp.color("color")).unwrap_or(Vec3::ONE);
    if let Some(measured_cd) = measured_cd {
        let mut instance = muted::instance_of(&node);
        let of_file = own_color * muted::tint_of(&instance) * measured_cd;
        if is_same(now, of_file) {
            return Ok(());
        }
        let multiplier = muted::multiplier_of(&instance);
        let same_color = factor(now, of_file);
        instance.set("multiplier", &(multiplier * same_color.unwrap_or_else(|| now.max_element() / measured_cd)));
        let color = same_color.is_none().then(|| color_and_strength(now).0);
        if let Some(lamp) = &mut lamp {
            set_plain(lamp, now.max_element() / of_file.max_element(), color);
        }
        if let Some(color) = color {
            // The color of the instance is multiplied by that of its plain lamp.
            instance.set("color", &if lamp.is_some() { [1.0; 3] } else { color });
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
        shared.put_lamp(document, &mut node, idx, &lamp);
    }
    document.put("nodes", node_idx, &node);
    Ok(())
}

/// Changes the plain lamp beside a measured distribution alike: programs that cannot read the distribution go by it.
fn set_plain(lamp: &mut RawObject, by: f32, color: Option<[f32; 3]>) {
    let own = lamp.color("color").map_or(1.0, Vec3::max_element);
    let was = lamp.read::<f32>("intensity").unwrap_or(1.0) * if color.is_some() { own } else { 1.0 };
    if (was * by).is_finite() {
        lamp.set("intensity", &(was * by));
    }
    if let Some(color) = color {
        lamp.set("color", &color);
    }
}

/// The shining materials of a node: `now` and `file` are what its light sends at most, nit. Answers the largest emissive strength
/// that they have then.
fn write_surface(
    document: &mut Document,
    shared: &mut Shared,
    node_idx: usize,
    (now, file): (Vec3, Vec3),
) -> Result<f32> {
    let is_changed = !is_same(now, file);
    let mut strongest = 0.0f32;
    shared.change_materials(document, node_idx, |_, material| {
        let emission = Emission::of(&material)?;
        if !is_changed {
            strongest = strongest.max(emission.strength);
            return None;
        }
        let (material, strength) = emission.lit(material, now, file);
        strongest = strongest.max(strength);
        Some(material)
    })?;
    if is_changed {
        document.uses(STRENGTH);
    }
    Ok(strongest)
}

/// Marks a panel and its spots on its node. `colored` is how much brighter spots with a color of their own have to be. Answers how many
/// would be more than is read again, and are held to that.
fn write_spots(
    document: &mut Document,
    node_idx: usize,
    resolution: u32,
    spots: Option<&Vec<PanelSpot>>,
    colored: f32,
) -> Result<usize> {
    let mut node = document.item("nodes", node_idx)?;
    let own = node.own_extras();
    if spots.is_none() && own.read::<f64>("panel") == Some(f64::from(resolution)) {
        return Ok(0);
    }
    // What is dark stays dark, however much brighter it would be.
    let colored = colored.min(f32::MAX);
    let brighter = |spot: &PanelSpot| {
        let by = if spot.color.is_some() { colored } else { 1.0 };
        PanelSpot { intensity: spot.intensity * by, ..*spot }
    };
    let spots: Option<Vec<PanelSpot>> = spots.map(|spots| spots.iter().map(brighter).collect());
    let n_beyond = spots.iter().flatten().filter(|spot| spot.within_limits() != **spot).count();
    node.change("extras", |extras| {
        extras.change(OWN, |own| {
            own.set("panel", &resolution);
            if let Some(spots) = spots {
                own.set("spots", &spots.into_iter().map(PanelSpot::within_limits).collect::<Vec<_>>());
            }
        });
    });
    document.put("nodes", node_idx, &node);
    Ok(n_beyond)
}
