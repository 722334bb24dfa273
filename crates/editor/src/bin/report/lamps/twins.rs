//! Lamps of the file that are exchanged for free ones, as *Make movable* does.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use clerestory_transport::bake::{Bake, BakeConfig};
use clerestory_transport::camera::Film;
use clerestory_transport::lamps::{FreeLamp, PreparedLamps};
use clerestory_transport::light::{LightRig, LightSetting};
use clerestory_transport::patches::NARROW_ALPHA;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::{PunctualKind, PunctualLight, Scene, SceneNode};
use glam::Vec3;

use super::live::View;
use super::spent::bake;
use super::{Case, QUICK, TRACED_SPP, USUAL, WIDTHS, of_patches, sun};
use crate::desk::Desk;
use crate::errors::{Sum, decibels, quantile};
use crate::rendered::relit;

/// Lamps that are put into the gallery, of kinds that no scene has.
const POINT: &str = "point put in";
const SUN: &str = "sun put in";
/// Strength and place of the point lamp, cd and m.
const POINT_CD: f32 = 100.0;
const POINT_AT: Vec3 = Vec3::new(-0.5, 1.9, 0.8);
/// Where the middle of the sun's light falls on the floor.
const SUNNY: Vec3 = Vec3::new(0.75, 0.0, -0.7);

/// A lamp of the file, and the free one that takes its place.
pub struct Twin {
    key: String,
    /// Name of its kind.
    pub kind: &'static str,
    pub free: PreparedLamps,
}

/// Those that a scene has.
///
/// # Errors
/// A lamp that cannot shine.
pub fn find(scene: &PreparedScene) -> Result<Vec<Twin>> {
    let mut twins = Vec::new();
    for source in &scene.lighting.basis.sources {
        let Some(light) = scene.scene.lamp_called(&source.key) else { continue };
        let Some(free) = FreeLamp::from_source("movable", source, light, LightSetting::default()) else { continue };
        let kind = free.shape.name();
        let free = PreparedLamps::new(&[free], None)?.0;
        if !free.is_empty() {
            twins.push(Twin { key: source.key.clone(), kind, free });
        }
    }
    Ok(twins)
}

/// What the page says of lamps that are put in.
pub fn words() -> String {
    format!(
        " The file of the gallery has spots alone: for the other two kinds of glTF a point lamp of {POINT_CD} cd and parallel light of {} lx (*directional*) were put into the scene, the latter through clear glass in its clerestory.",
        sun::LUX
    )
}

/// Lamps put into the gallery and exchanged for free ones, kind and dB of each.
///
/// # Errors
/// A scene that cannot be read, a bake that fails, or a lamp that lights nothing.
pub fn added(desk: &Desk, gallery: &Path) -> Result<Vec<(String, f64)>> {
    let case = Case { name: "gallery", path: gallery.to_owned(), sky: None, change: Some(put_in) };
    let (scene, camera) = case.prepared()?;
    let (scene, film) = (Arc::new(scene), Film::of_width(WIDTHS[0], &camera));
    let mut twins = find(&scene)?;
    twins.retain(|twin| [POINT, SUN].contains(&twin.key.as_str()));
    let lamps: Vec<&PreparedLamps> = twins.iter().map(|twin| &twin.free).collect();
    let n_samples = desk.choose(TRACED_SPP[0], TRACED_SPP[1]);
    let view = View { scene: &scene, camera: &camera, film, n_samples };
    let (first, second) = (view.live(&lamps, 1, NARROW_ALPHA)?, view.live(&lamps, 2, NARROW_ALPHA)?);
    let [patches, spp] = desk.choose(QUICK, USUAL);
    let (bake, _) = bake(&scene, &camera, film, BakeConfig { spp, patches, ..BakeConfig::default() })?;
    let mut exchanged = Vec::new();
    for (twin, (a, b)) in twins.iter().zip(first.iter().zip(&second)) {
        ensure!(a.iter().any(|value| *value > 0.0), "`{}` lights nothing", twin.key);
        exchanged.push((twin.kind.to_owned(), twin.db(&scene, &bake, [a, b])?));
    }
    Ok(exchanged)
}

/// Gives the gallery a point lamp, and a sun that comes in through glass.
fn put_in(scene: &mut Scene) -> Result<()> {
    sun::glaze(scene)?;
    let lamps = [
        (POINT, PunctualKind::Point, POINT_AT, Vec3::NEG_Y, POINT_CD),
        (SUN, PunctualKind::Directional, sun::WINDOW, (SUNNY - sun::WINDOW).normalize(), sun::LUX),
    ];
    for (name, kind, position, direction, intensity) in lamps {
        let node = scene.nodes.len() as u32;
        let index = scene.nodes.iter().map(|node| node.index + 1).max().unwrap_or(0);
        scene.nodes.push(SceneNode { index, name: Some(name.to_owned()), ..SceneNode::default() });
        let (right, up) = direction.any_orthonormal_pair();
        scene.punctual.push(PunctualLight {
            node,
            kind,
            position,
            direction,
            across: [right, up],
            profile: None,
            color: Vec3::ONE,
            intensity,
            radius_rad: 0.0,
        });
    }
    Ok(())
}

impl Twin {
    /// The picture of the file with it against that of its baked column, given two of its live light, dB below the 99.5 percentile
    /// of the picture.
    ///
    /// # Errors
    /// A bake without patches.
    pub fn db(&self, scene: &PreparedScene, bake: &Bake, live: [&[f32]; 2]) -> Result<f64> {
        let mut without = LightRig::default();
        without.lights.entry(self.key.clone()).or_default().muted = true;
        let [whole, without] = [LightRig::default(), without].map(|rig| relit(bake, &bake.header.coefficients(&rig)));
        let patches = bake.header.patches.as_ref().context("no patches")?;
        let lit = self.free.light_on_patches(scene, patches, bake.header.config.bounces);
        let free = relit(bake, &of_patches(bake, lit));
        Ok(difference_db(&whole, &without, &free, live))
    }
}

/// Of a picture and the same without a lamp, with what is indirect and live of another one: noise of the live light is no difference.
fn difference_db(whole: &[f32], without: &[f32], free: &[f32], live: [&[f32]; 2]) -> f64 {
    let square = |at: usize| {
        let [a, b] = live.map(|live| f64::from(without[at] + free[at]) + f64::from(live[at]) - f64::from(whole[at]));
        a * b
    };
    let sum = Sum::of_pixels(whole.len(), square);
    decibels(quantile(whole.iter().map(|value| f64::from(*value)).collect()), sum.mean_at_least_known())
}

#[cfg(test)]
mod tests {
    use clerestory::headless::GALLERY;
    use clerestory_transport::import;

    use super::*;

    #[test]
    fn all_kinds_of_lamps_of_files_are_exchanged() {
        let mut scene = import::load_bytes("gallery.glb", GALLERY).unwrap().scene;
        put_in(&mut scene).unwrap();
        let scene = PreparedScene::new(scene, &[]).unwrap().0;
        let twins = find(&scene).unwrap();
        let kinds: Vec<&str> = twins.iter().map(|twin| twin.kind).collect();
        assert_eq!(kinds, ["spot", "spot", "spot", "spot", "point", "directional"]);
        let names: Vec<&str> = twins[4..].iter().map(|twin| twin.key.as_str()).collect();
        assert_eq!(names, [POINT, SUN]);
        // Both light what is seen: the sun falls onto the rug and the floor beside it.
        let lux = |twin: &Twin, at: Vec3| twin.free.irradiance(&scene, at, Vec3::Y, None).max_element();
        assert!(lux(&twins[4], POINT_AT - Vec3::Y) > 0.5 * POINT_CD);
        assert!(lux(&twins[5], Vec3::new(0.0, 0.6, -0.9)) > 0.2 * sun::LUX);
    }

    #[test]
    fn a_twin_that_is_a_tenth_too_bright_is_twenty_decibels_off() {
        let (whole, without, free) = ([10.0; 6], [6.0; 6], [3.0; 6]);
        let db = |live: [[f32; 6]; 2]| difference_db(&whole, &without, &free, [&live[0], &live[1]]);
        assert!((db([[2.0; 6]; 2]) - 20.0).abs() < 1e-6);
        // One in one pixel, less than nothing by as much in the other: known to their standard error, √½.
        let known = decibels(10.0, 0.5f64.sqrt());
        assert!((db([[2.0, 2.0, 2.0, 0.0, 0.0, 0.0], [2.0; 6]]) - known).abs() < 1e-6);
        // Noise around what is right.
        assert!(db([[1.5, 0.5, 1.0, 1.0, 1.5, 0.5], [1.0; 6]]) > 100.0);
    }
}
