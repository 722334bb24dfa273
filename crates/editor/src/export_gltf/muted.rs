//! Lights that are off: dark in the file for whoever reads it, with what they are when they are on in the extras of their node.

use anyhow::Result;
use clerestory_transport::import::SUBSTITUTE_CD;
use clerestory_transport::light::{LightRig, LightSetting, MutedLight, MutedLights};
use clerestory_transport::photometry::PhotometricProfile;
use clerestory_transport::scene::{PunctualLight, Scene};
use glam::Vec3;

use super::emission::Emission;
use super::lights::file_node;
use super::raw::{Document, LAMPS, OWN, PROFILES, RawObject};
use super::shared::{Shared, lamp_of, primitives};

/// What of a node is off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Part {
    /// Its lamp, and what a measured distribution of it sends at most, candela.
    Lamp(Option<f32>),
    /// Its surfaces.
    Surfaces,
}

/// A rig with all lights on: what is muted, or turned down to nothing, shines as it does otherwise.
pub(super) fn switched_on(rig: &LightRig) -> LightRig {
    let mut rig = rig.clone();
    rig.lights.values_mut().for_each(|setting| *setting = turned_on(*setting));
    rig.lamps.iter_mut().for_each(|lamp| lamp.setting = turned_on(lamp.setting));
    for group in rig.groups.values_mut() {
        group.muted = false;
        group.intensity = on_or_one(group.intensity);
    }
    rig
}

/// The same of the setting of one light.
fn turned_on(setting: LightSetting) -> LightSetting {
    let color = setting.color.filter(|color| *color != [0.0; 3]);
    LightSetting { intensity: on_or_one(setting.intensity), color, muted: false, ..setting }
}

fn on_or_one(intensity: f32) -> f32 {
    if intensity > 0.0 { intensity } else { 1.0 }
}

/// What the distribution of a lamp sends at most, candela, or what stands in for one that cannot be had and has no plain lamp beside it;
/// none where it is not a measured one.
pub(super) fn most_cd(document: &mut Document, scene: &Scene, lamp: &PunctualLight) -> Result<Option<f32>> {
    let node = document.item("nodes", file_node(scene, lamp.node))?;
    let substitute = lamp_of(&node).is_none().then_some(SUBSTITUTE_CD);
    let profile = lamp.profile.and_then(|profile| scene.profiles.get(profile as usize));
    Ok(profile.map(PhotometricProfile::max_candela).or(substitute))
}

/// Turns on what the file itself has off, so that all lights can be written alike.
pub(super) fn switch_on(document: &mut Document, shared: &mut Shared, scene: &Scene) -> Result<()> {
    for &node in &scene.muted_lamps {
        let Ok(lamp_idx) = scene.punctual.binary_search_by_key(&node, |lamp| lamp.node) else { continue };
        let (node_idx, most_cd) = (file_node(scene, node), most_cd(document, scene, &scene.punctual[lamp_idx])?);
        let kept = take_kept(document, node_idx, Part::Lamp(most_cd))?;
        if let Some(light) = kept.lamp {
            let plain_cd = kept.plain_cd.filter(|cd| cd.is_finite() && *cd >= 0.0);
            set_lamp(document, shared, node_idx, most_cd, light, plain_cd)?;
        }
    }
    for &node in &scene.muted_surfaces {
        let node_idx = file_node(scene, node);
        let kept = take_kept(document, node_idx, Part::Surfaces)?.surfaces;
        shared.change_materials(document, node_idx, |nth, mut material| {
            let kept = kept.get(nth).copied().flatten()?;
            Emission { factor: kept.color, strength: kept.strength }.put(&mut material);
            Some(material)
        })?;
    }
    Ok(())
}

/// Turns off a part of a node that is written as it is when it is on.
pub(super) fn darken(document: &mut Document, shared: &mut Shared, node_idx: usize, part: Part) -> Result<()> {
    match part {
        Part::Lamp(most_cd) => darken_lamp(document, shared, node_idx, most_cd),
        Part::Surfaces => darken_surfaces(document, shared, node_idx),
    }
}

fn darken_lamp(document: &mut Document, shared: &mut Shared, node_idx: usize, most_cd: Option<f32>) -> Result<()> {
    let node = document.item("nodes", node_idx)?;
    let plain = lamp_of(&node).map(|idx| document.item(LAMPS, idx)).transpose()?.unwrap_or_default();
    let color = color_of(&plain);
    let kept = match most_cd {
        Some(most_cd) => {
            let instance = instance_of(&node);
            MutedLight { color: color * tint_of(&instance), strength: most_cd * multiplier_of(&instance) }
        }
        None => MutedLight { color, strength: plain.read("intensity").unwrap_or(1.0) },
    };
    let plain_cd = most_cd.and_then(|_| lamp_of(&node)).map(|_| plain.read("intensity").unwrap_or(1.0));
    keep(document, node_idx, |muted| (muted.lamp, muted.plain_cd) = (Some(kept), plain_cd))?;
    set_lamp(document, shared, node_idx, most_cd, MutedLight { strength: 0.0, ..kept }, None)
}

fn darken_surfaces(document: &mut Document, shared: &mut Shared, node_idx: usize) -> Result<()> {
    let node = document.item("nodes", node_idx)?;
    let Some(mesh_idx) = node.place("mesh") else { return Ok(()) };
    let mut kept = Vec::new();
    for part in primitives(&document.item("meshes", mesh_idx)?) {
        let material = part.place("material").map(|idx| document.item("materials", idx)).transpose()?;
        let emission = material.and_then(|material| Emission::of(&material));
        kept.push(emission.map(|own| MutedLight { color: own.factor, strength: own.strength }));
    }
    keep(document, node_idx, |muted| muted.surfaces = kept)?;
    shared.change_materials(document, node_idx, |_, mut material| {
        Emission::of(&material)?;
        material.set("emissiveFactor", &[0.0f32; 3]);
        Some(material)
    })
}

/// Sets color and strength of the lamp of a node. Beside a measured distribution the plain lamp is for those who cannot read that:
/// it gets a strength of its own, where one is known, and its color stays.
fn set_lamp(
    document: &mut Document,
    shared: &mut Shared,
    node_idx: usize,
    most_cd: Option<f32>,
    light: MutedLight,
    plain_cd: Option<f32>,
) -> Result<()> {
    let mut node = document.item("nodes", node_idx)?;
    let lamp_idx = lamp_of(&node);
    let mut lamp = lamp_idx.map(|idx| document.item(LAMPS, idx)).transpose()?;
    if let Some(most_cd) = most_cd {
        let mut instance = instance_of(&node);
        instance.set("multiplier", &(light.strength / most_cd.max(f32::MIN_POSITIVE)));
        let plain_color = lamp.as_ref().map_or(Vec3::ONE, color_of);
        if plain_color * tint_of(&instance) != light.color {
            set_color(&mut instance, light.color);
            lamp.iter_mut().for_each(|lamp| set_color(lamp, Vec3::ONE));
        }
        node.change("extensions", |all| all.set(PROFILES, &instance));
    }
    if let (Some(idx), Some(mut lamp)) = (lamp_idx, lamp) {
        if most_cd.is_none() {
            set_color(&mut lamp, light.color);
        }
        lamp.set("intensity", &plain_cd.unwrap_or(light.strength));
        shared.put_lamp(document, &mut node, idx, &lamp);
    }
    document.put("nodes", node_idx, &node);
    Ok(())
}

/// How a node has its measured distribution.
pub(super) fn instance_of(node: &RawObject) -> RawObject {
    node.read::<RawObject>("extensions").and_then(|all| all.read(PROFILES)).unwrap_or_default()
}

/// What multiplies a measured distribution: 1 where that is out of range, as it is read.
pub(super) fn multiplier_of(instance: &RawObject) -> f32 {
    instance.read::<f32>("multiplier").filter(|by| by.is_finite() && *by >= 0.0).unwrap_or(1.0)
}

/// The color of a measured distribution, within the range in which it is read.
pub(super) fn tint_of(instance: &RawObject) -> Vec3 {
    color_of(instance).clamp(Vec3::ZERO, Vec3::ONE)
}

fn color_of(lamp: &RawObject) -> Vec3 {
    lamp.color("color").unwrap_or(Vec3::ONE)
}

/// A color that is there already stays as it was written.
fn set_color(lamp: &mut RawObject, color: Vec3) {
    if color_of(lamp) != color {
        lamp.set("color", &color.to_array());
    }
}

/// Changes what a node keeps.
fn keep(document: &mut Document, node_idx: usize, change: impl FnOnce(&mut MutedLights)) -> Result<()> {
    let mut node = document.item("nodes", node_idx)?;
    let mut muted: MutedLights = node.own_extras().read("muted").unwrap_or_default();
    change(&mut muted);
    node.change("extras", |extras| extras.change(OWN, |own| own.set("muted", &muted)));
    document.put("nodes", node_idx, &node);
    Ok(())
}

/// Takes what a node keeps of one of its parts; nothing is left of extras that are empty then.
fn take_kept(document: &mut Document, node_idx: usize, part: Part) -> Result<MutedLights> {
    let mut node = document.item("nodes", node_idx)?;
    let kept: MutedLights = node.own_extras().read("muted").unwrap_or_default();
    let rest = match part {
        Part::Lamp(_) => MutedLights { lamp: None, plain_cd: None, ..kept.clone() },
        Part::Surfaces => MutedLights { surfaces: Vec::new(), ..kept.clone() },
    };
    let (mut extras, mut own) = (node.read::<RawObject>("extras").unwrap_or_default(), node.own_extras());
    own.set_or_remove("muted", (rest != MutedLights::default()).then_some(&rest));
    extras.set_or_remove(OWN, (!own.is_empty()).then_some(&own));
    node.set_or_remove("extras", (!extras.is_empty()).then_some(&extras));
    document.put("nodes", node_idx, &node);
    Ok(kept)
}
