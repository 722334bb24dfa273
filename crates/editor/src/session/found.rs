//! The scene of a bake that was opened: looked for beside it, and open from then on where its lights are those of the bake.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result};
use clerestory_transport::bake::BakeHeader;
use clerestory_transport::basis::{LightBasis, SourceKind};
use clerestory_transport::camera::Camera;
use clerestory_transport::emitters::PanelRequest;
use clerestory_transport::import;
use clerestory_transport::lamp_units::{LampUnits, assume_unitless};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::{FacetScattering, PunctualLight, Scene};
use clerestory_transport::sky::SkySetting;
use clerestory_transport::stop::Stop;

use super::begun::Begun;
use super::task::{Fact, Task};
use super::views::sees_alike;
use super::{BakeSettings, Chosen, ChosenSky, Notice, SceneOfBake, Session, Shown, Source};
use crate::words::in_words;

/// The scene of a bake, prepared as it was for that.
pub(super) struct FoundScene {
    scene: Box<PreparedScene>,
    /// Where the bake is seen from.
    camera: Camera,
    path: PathBuf,
    /// Lamps as the file has them.
    lamps: Vec<PunctualLight>,
    chosen: Chosen,
    alike: Alike,
}

/// How far a scene is that of a bake.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Alike {
    /// All of it, with its lamps counted so.
    Whole(LampUnits),
    /// Surfaces and view, which is all that free lamps need: its own lights were changed when it was baked, or since.
    Surfaces,
}

impl Session {
    /// The scene of the picture, for what is not baked: the open one, or that of the bake that was opened.
    pub fn lamp_scene(&self) -> Option<&Arc<PreparedScene>> {
        let opened = self.opened.as_ref()?;
        let of_bake = || match &opened.of_bake {
            Some(SceneOfBake::Found(scene)) => Some(scene),
            _ => None,
        };
        opened.scene.as_ref().or_else(of_bake)
    }

    /// Diagonal of that scene, m, where it is there.
    pub fn extent_m(&self) -> Option<f32> {
        self.lamp_scene().map(|scene| scene.extent())
    }

    /// Takes a file as the scene of the bake that was opened, in the background.
    pub fn find_scene(&mut self, path: PathBuf) {
        let Some(header) = self.shown.as_ref().map(|shown| shown.header.clone()) else { return };
        self.stop_finding();
        let task = self.spawn("scene", move |post| {
            let found = scene_of(&header, path, &post.stop).map_err(|error| in_words(&error));
            let _ = post.send(Fact::SceneFound(found), Duration::ZERO);
        });
        self.finding = task.as_ref().map(Task::id);
        self.others.extend(task);
        if let Some(opened) = &mut self.opened {
            opened.of_bake = Some(SceneOfBake::Waiting);
        }
    }

    pub(super) fn stop_finding(&mut self) {
        let finding = self.finding.take();
        self.others.iter().filter(|task| finding == Some(task.id())).for_each(Task::stop);
    }

    pub(super) fn scene_found(&mut self, found: Result<FoundScene, String>, notices: &mut Vec<Notice>) {
        self.finding = None;
        let Some(opened) = &mut self.opened else { return };
        let FoundScene { scene, camera, path, lamps, chosen, alike } = match found {
            Ok(found) => found,
            Err(why) => {
                opened.of_bake = Some(SceneOfBake::Missing(why));
                return;
            }
        };
        let scene: Arc<PreparedScene> = Arc::from(scene);
        opened.of_bake = Some(SceneOfBake::Found(scene.clone()));
        let Some(shown) = &mut self.shown else { return };
        shown.camera = Some(camera);
        if alike != Alike::Surfaces && has_lights_of(&scene.lighting.basis, &shown.header.basis) {
            (opened.lamps, opened.chosen, opened.source) = (lamps, chosen, Some(Source::File(path)));
            opened.scene = Some(scene.clone());
            // What is there need not be foreseen.
            self.begun = Some(Begun::new(scene.clone(), shown.settings(&scene.scene.cameras), shown.camera.clone()));
        }
        notices.push(Notice::SceneFound);
    }

    /// How the bake that is shown was asked for.
    pub fn settings_of_shown(&self) -> Option<BakeSettings> {
        self.shown.as_ref().map(|shown| shown.settings(self.cameras()))
    }
}

impl Shown {
    /// How it was asked for, among the cameras of its scene.
    fn settings(&self, cameras: &[Camera]) -> BakeSettings {
        let is_it = |camera: &Camera| self.camera.as_ref().is_some_and(|own| sees_alike(own, camera));
        BakeSettings {
            camera_idx: cameras.iter().position(is_it).unwrap_or(0),
            film: self.film(),
            config: self.header.config.clone(),
            illuminance: self.pixel_irradiance().is_some(),
            // Its grid is in the bake; how that was asked for is not.
            work_plane: None,
        }
    }
}

/// Whether a scene has the lights of a bake, in whatever order: one that took columns over has its new lights behind the others.
fn has_lights_of(scene: &LightBasis, baked: &LightBasis) -> bool {
    lights(scene) == lights(baked)
}

/// Lights by their key: what they are, and how many columns they have.
fn lights(basis: &LightBasis) -> BTreeMap<&str, (SourceKind, usize)> {
    basis.sources.iter().map(|source| (source.key.as_str(), (source.kind, source.columns.len()))).collect()
}

/// The scene of a bake from a file: what is not baked needs its surfaces. Its panels and its sky are those of the bake.
fn scene_of(header: &BakeHeader, path: PathBuf, stop: &Stop) -> Result<FoundScene> {
    anyhow::ensure!(path.is_file(), "{} is not there", path.display());
    let mut scene = import::load_until(&path, header.skips, stop)?.scene;
    let lamps = scene.punctual.clone();
    let (camera, alike) = as_baked(header, &mut scene).with_context(|| {
        let what = what_differs(header);
        format!(
            "{} is not the scene that was baked: {what}; a variant of its materials is another scene as well; name the same file, or \
             bake it again",
            path.display()
        )
    })?;
    let chosen = match alike {
        Alike::Whole(units) => Chosen { units, ..chosen_for(&header.basis) },
        // Its lights are not those of the bake, so neither are panels and sky made of them.
        Alike::Surfaces => Chosen::default(),
    };
    let sky = chosen.sky.as_ref().and_then(ChosenSky::request);
    let prepared = PreparedScene::until(scene, &chosen.panels, sky.as_ref(), header.skips, stop);
    let (scene, _) = prepared.context("its lights cannot be used")?;
    Ok(FoundScene { scene: Box::new(scene), camera, path: absolute(&path), lamps, chosen, alike })
}

/// Makes a scene what it was when it was baked: with energy compensation or without, its lamps counted in candela or unitless.
/// The camera of the bake, and how far the scene is that of the bake; `None` of another scene. One that has its surfaces alone gets its
/// directional lamps as large as the bake has them.
pub(crate) fn as_baked(header: &BakeHeader, scene: &mut Scene) -> Option<(Camera, Alike)> {
    let lamps = scene.punctual.clone();
    if let Some(camera) = seen_from(scene, |scene| header.camera_in(scene).cloned()) {
        return Some((camera, Alike::Whole(LampUnits::Photometric)));
    }
    assume_unitless(scene);
    if let Some(camera) = seen_from(scene, |scene| header.camera_in(scene).cloned()) {
        return Some((camera, Alike::Whole(LampUnits::Unitless)));
    }
    scene.punctual = lamps;
    if let Some(radius_rad) = header.basis.sources.iter().find_map(|source| source.origin.radius_rad) {
        scene.set_sun_radius(radius_rad);
    }
    let camera = seen_from(scene, |scene| header.camera_on_surfaces_of(scene).cloned())?;
    Some((camera, Alike::Surfaces))
}

/// The camera that is found in a scene with energy compensation, else in the same without.
fn seen_from(scene: &mut Scene, find: impl Fn(&Scene) -> Option<Camera>) -> Option<Camera> {
    [FacetScattering::Multiple, FacetScattering::Single].into_iter().find_map(|scattering| {
        scene.set_facet_scattering(scattering);
        find(scene)
    })
}

/// What of a scene is not as it was baked, in words.
pub(crate) fn what_differs(header: &BakeHeader) -> &'static str {
    match header.grounds {
        Some(_) => "its geometry, materials or camera differ",
        None => {
            "its geometry, materials, lights or camera differ (lamps that --ies or --sun-size changed count as well where time ended a \
             bake, or where it is of an earlier version)"
        }
    }
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf())
}

/// What has to be chosen about a scene so that it has the columns of a bake.
fn chosen_for(basis: &LightBasis) -> Chosen {
    let mut chosen = Chosen::default();
    for source in &basis.sources {
        match source.kind {
            SourceKind::Panel { resolution, .. } => {
                chosen.panels.push(PanelRequest { node: source.key.clone(), resolution });
            }
            SourceKind::Dome { divisions } => {
                let setting = SkySetting::default();
                chosen.sky = basis.sky.clone().map(|light| ChosenSky { setting, light: Some(light), divisions });
            }
            _ => {}
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use clerestory_transport::bake::{BakeConfig, BakeJob};
    use clerestory_transport::basis::LightSource;
    use clerestory_transport::camera::Film;
    use clerestory_transport::skips::Skips;
    use serde_json::{Value, json};

    use super::*;
    use crate::support::{ROOM, room_job};

    /// A single texel.
    const IMAGE: &str = "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNkYPhfDwAChwGA60e6kgAAAABJRU5ErkJggg==";

    #[test]
    fn the_scene_of_a_bake_is_read_with_what_that_left_out_and_no_more() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("room.gltf");
        let mut gltf: Value = serde_json::from_str(ROOM).unwrap();
        // Its factor is 0, so that nobody needs it.
        gltf["materials"][0]["emissiveTexture"] = json!({ "index": 0 });
        (gltf["images"], gltf["textures"]) = (json!([{ "uri": IMAGE }]), json!([{ "source": 0 }]));
        std::fs::write(&path, gltf.to_string()).unwrap();
        let config = BakeConfig { spp: 2, tolerance_db: 10.0, ..BakeConfig::default() };
        let room = room_job(Film { width: 20, height: 16 }, config);
        for skips in [Skips::none(), Skips::default()] {
            let scene = import::load_with(&path, skips).unwrap().scene;
            assert_eq!(scene.textures.is_empty(), skips.is_all());
            let scene = Arc::new(PreparedScene::with_skips(scene, &[], None, skips).unwrap().0);
            let header = BakeJob { scene, ..room.clone() }.header().unwrap();
            let found = scene_of(&header, path.clone(), &Stop::default()).unwrap();
            assert_eq!((found.alike, found.scene.skips), (Alike::Whole(LampUnits::Photometric), skips));
        }
    }

    #[test]
    fn a_scene_has_the_lights_of_a_bake_that_has_them_in_another_order() {
        let of = |keys: [&str; 2], kind: SourceKind| {
            let sources = keys.map(|key| LightSource::plain(key, kind, 0..1));
            LightBasis::new(sources.to_vec())
        };
        let scene = of(["lamp", "moved"], SourceKind::Point);
        assert!(has_lights_of(&scene, &of(["moved", "lamp"], SourceKind::Point)));
        assert!(!has_lights_of(&scene, &of(["moved", "lamp"], SourceKind::Spot)));
        assert!(!has_lights_of(&scene, &of(["lamp", "another"], SourceKind::Point)));
    }
}
