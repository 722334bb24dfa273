//! What the columns of a bake rest on, so that a later bake can tell which of them are still right.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{BakeHeader, BakeJob};
use crate::basis::LightBasis;
use crate::camera::Camera;
use crate::emitters::{Emitter, Lighting, ShiningTriangle};
use crate::fingerprint::{digest, is_of_surfaces, of_surfaces, of_surfaces_without, of_texture};
use crate::irradiance::IrradianceRows;
use crate::prepared::PreparedScene;
use crate::reach::shut_out;
use crate::scene::{PunctualLight, Scene, TextureRef};
use crate::skips::Skip;

/// Hashes of all that decides the columns of a bake. A column rests on all surfaces, the view, the settings and its own light; on
/// no other light, not on how strong, how colored or how called its own one is, and not on which rows of irradiance are beside it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Grounds {
    /// Of the surfaces and how they scatter.
    pub surfaces: String,
    /// Of those that are left where closed walls around the camera keep others from all that it sees; `None` where they keep out none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen: Option<String>,
    /// Of the camera, whatever it is called, and the size of the picture.
    pub view: String,
    /// Of the settings, the skips and the version of the program.
    pub settings: String,
    /// Of each source of the basis: where it shines from, and how its light is spread.
    pub lights: Vec<String>,
}

/// Raised whenever the same scene and settings give other bytes than before.
const REVISION: u32 = 7;

/// Before the hash of a lamp without strength in its file: its columns may never have been traced.
const OFF: &str = "off-";

impl Grounds {
    /// Of pictures that are half-done: the version of the program alone. What the pictures are, their fingerprint tells.
    pub(crate) fn of_program() -> Grounds {
        let settings = serde_json::to_vec(&program()).expect("a version always has a JSON form");
        let (surfaces, view) = (String::new(), String::new());
        Grounds { surfaces, seen: None, view, settings: hash_of(&settings), lights: Vec::new() }
    }

    /// A hash of all but the lights: bakes that share it may have columns in common.
    pub fn common(&self) -> String {
        let surfaces = self.seen.as_ref().unwrap_or(&self.surfaces);
        hash_of([&surfaces[..], &self.view, &self.settings].concat().as_bytes())
    }
}

impl BakeJob {
    /// What its columns will rest on.
    pub fn grounds(&self) -> Grounds {
        let skips: Vec<Skip> = self.scene.skips.off().into_iter().filter(|skip| *skip != Skip::Reuse).collect();
        let (version, revision) = program();
        let settings = (version, revision, &self.config, skips);
        let settings = serde_json::to_vec(&settings).expect("settings always have a JSON form");
        let (n_lights, maps) = (self.scene.lighting.emitters.len(), maps_of_lights(&self.scene.scene));
        let out = shut_out(&self.scene, self.camera.position());
        Grounds {
            surfaces: of_surfaces(&self.scene.scene),
            seen: out.map(|out| of_surfaces_without(&self.scene.scene, &out)),
            view: self.view(""),
            settings: hash_of(&settings),
            lights: (0..n_lights).map(|source| of_light(&self.scene, &maps, source)).collect(),
        }
    }

    /// A hash of its camera, called so, and of the size of its picture and blocks.
    fn view(&self, name: &str) -> String {
        hash_of_view(&self.camera.called(name), [self.film.width, self.film.height, self.config.block])
    }

    /// Whether an earlier bake rests on the surfaces that its columns rest on. Points of grids may lie beyond walls.
    pub(super) fn has_surfaces_of(&self, there: &Grounds, wanted: &Grounds) -> bool {
        let sees_alone = self.irradiance.iter().all(|rows| *rows == IrradianceRows::Pixels);
        there.surfaces == wanted.surfaces || (sees_alone && wanted.seen.is_some() && there.seen == wanted.seen)
    }

    /// Whether an earlier bake, which rests on `there`, is of the same view. Files of before count the name of its camera.
    pub(super) fn has_view_of(&self, earlier: &BakeHeader, there: &Grounds) -> bool {
        [self.view(""), self.view(&earlier.camera)].contains(&there.view)
    }
}

impl BakeHeader {
    /// Where the bake is seen from, where it is of the surfaces of this scene, whatever lights them by now: more is not asked for where
    /// lamps of a look light them. `None` as well where it is not known what the bake rests on.
    pub fn camera_on_surfaces_of<'a>(&'a self, scene: &'a Scene) -> Option<&'a Camera> {
        let grounds = self.grounds.as_ref()?;
        let size = [self.width, self.height, self.config.block];
        // Files of before count the name of the camera.
        let names = ["", self.camera.as_str()];
        let is_it =
            |camera: &&Camera| names.iter().any(|name| hash_of_view(&camera.called(name), size) == grounds.view);
        let mut cameras = self.view.iter().chain(Camera::named(&scene.cameras, &self.camera)).chain(&scene.cameras);
        cameras.find(is_it).filter(|_| is_of_surfaces(scene, &grounds.surfaces))
    }

    /// Whether the light of that name shines in a scene as it does in the bake: from there, spread like that, as strong and of that color.
    /// Of a bake that does not tell what it rests on only the last two are known.
    pub fn has_light_of(&self, prepared: &PreparedScene, key: &str) -> bool {
        let place = |basis: &LightBasis| basis.sources.iter().position(|source| source.key == key);
        let basis = &prepared.lighting.basis;
        let (Some(own), Some(baked)) = (place(basis), place(&self.basis)) else { return false };
        let [source, of_bake] = [&basis.sources[own], &self.basis.sources[baked]];
        if (source.kind, source.color, source.strength) != (of_bake.kind, of_bake.color, of_bake.strength) {
            return false;
        }
        let Some(grounds) = &self.grounds else { return true };
        let maps = maps_of_lights(&prepared.scene);
        grounds.lights.get(baked).is_some_and(|baked| *baked == of_light(prepared, &maps, own))
    }
}

/// What of the program decides bytes.
fn program() -> (&'static str, u32) {
    (env!("CARGO_PKG_VERSION"), REVISION)
}

/// Of a camera, and of the sides of its picture and of a block.
fn hash_of_view(camera: &Camera, [width, height, block]: [u32; 3]) -> String {
    hash_of(format!("{camera:?} {width} {height} {block}").as_bytes())
}

/// Whether columns of a light are right for another one, both as [`Grounds::lights`] has them.
pub(super) fn serves(earlier: &str, wanted: &str) -> bool {
    earlier == wanted || wanted.strip_prefix(OFF) == Some(earlier)
}

fn hash_of(bytes: &[u8]) -> String {
    format!("{:016x}", digest(bytes))
}

/// Hashes of the textures by which surfaces shine, by their places in the scene.
fn maps_of_lights(scene: &Scene) -> BTreeMap<u32, u64> {
    let places = scene.materials.iter().filter_map(|material| Some(material.emissive_texture?.texture));
    let mut maps = BTreeMap::new();
    for place in places {
        maps.entry(place).or_insert_with(|| scene.textures.get(place as usize).map_or(0, of_texture));
    }
    maps
}

fn of_light(prepared: &PreparedScene, maps: &BTreeMap<u32, u64>, source: usize) -> String {
    let Lighting { basis, emitters, .. } = &prepared.lighting;
    let scene = &prepared.scene;
    let texture = |triangle: u32| {
        let material = &scene.materials[scene.mesh.triangle_material[triangle as usize] as usize];
        let map = |map: TextureRef| (TextureRef { texture: 0, ..map }, maps.get(&map.texture));
        format!("{:?}", material.emissive_texture.map(map))
    };
    let words = match &emitters[source] {
        Emitter::Punctual(light) => {
            let profile = light.profile.and_then(|profile| scene.profiles.get(profile as usize));
            let profile = profile.map(|profile| hash_of(&profile.light_bytes()));
            let white =
                PunctualLight { node: 0, profile: None, color: glam::Vec3::ONE, intensity: 1.0, ..light.clone() };
            format!("{white:?} {profile:?}")
        }
        // Where the triangles lie, the surfaces tell. Those that walls shut out light nothing, wherever they lie. Another strength moves
        // the last digits of the shares.
        Emitter::Surface(surface) => {
            let triangle = |t: &ShiningTriangle| format!("{} {:.5} {}", t.triangle, t.white(), texture(t.triangle));
            surface.triangles.iter().map(triangle).collect::<Vec<_>>().join(" ")
        }
        Emitter::Panel(panel) => format!("{panel:?} {}", texture(panel.triangle)),
        Emitter::Dome(_) | Emitter::Environment(_) => {
            let sky = basis.sky.as_ref().map(|sky| (sky.rotation_deg, sky.map.fingerprint()));
            format!("{:?} {sky:?}", basis.sources[source].kind)
        }
        Emitter::Sun(sun) => format!("{sun:?}"),
        Emitter::Lamp(lamp) => format!("{lamp:?}"),
        Emitter::Sky => "uniform sky".into(),
        Emitter::Constant => "unlit".into(),
    };
    let is_off = matches!(&emitters[source], Emitter::Punctual(light) if light.intensity == 0.0);
    format!("{}{}", if is_off { OFF } else { "" }, hash_of(words.as_bytes()))
}
