//! The built-in scene: a small gallery of 6 m × 4 m × 9 m with daylight from a clerestory.
//!
//! Meters, +y up; x from the window wall (−3) to the picture wall (3), z from the back wall (−4.5) to the entrance of the
//! viewer (4.5). Every light is a node of its own whose name a designer would use.

mod furniture;
mod lamps;
mod pictures;
mod room;
mod sculpture;

use glam::{Quat, Vec3, vec3};

use crate::glb::{Document, MaterialId, MeshId, Node};
use crate::material::{Glass, Material};
use crate::textures;

/// Low and high corner of the room.
const LOW: Vec3 = vec3(-3.0, 0.0, -4.5);
const HIGH: Vec3 = vec3(3.0, 4.0, 4.5);

/// The gallery.
pub fn gallery() -> Document {
    let mut document = Document::default();
    let materials = Materials::new(&mut document);
    let mut stage = Stage { document, materials };
    room::build(&mut stage);
    furniture::build(&mut stage);
    sculpture::build(&mut stage);
    pictures::build(&mut stage);
    lamps::build(&mut stage);
    camera(&mut stage, "hall view", vec3(0.55, 1.5, 4.25), vec3(0.0, 1.5, -4.5), 50.0);
    camera(&mut stage, "art wall", vec3(-2.1, 1.55, 2.4), vec3(3.0, 1.55, -1.9), 46.0);
    stage.document
}

/// The document and the materials that several parts share.
struct Stage {
    document: Document,
    materials: Materials,
}

impl Stage {
    fn place(&mut self, name: &str, mesh: MeshId, translation: Vec3, rotation: Quat) {
        self.document.node(Node { name: name.to_owned(), translation, rotation, mesh: Some(mesh), ..Node::default() });
    }
}

struct Materials {
    plaster: MaterialId,
    white: MaterialId,
    oak: MaterialId,
    black: MaterialId,
    brass: MaterialId,
    floor: MaterialId,
    accent: MaterialId,
    leather: MaterialId,
    bronze: MaterialId,
    solid_glass: MaterialId,
    pane: MaterialId,
    stone: MaterialId,
    glaze: MaterialId,
}

impl Materials {
    fn new(document: &mut Document) -> Materials {
        let plaster_relief = document.texture(textures::plaster_relief());
        let leather_relief = document.texture(textures::leather_relief());
        let oak = document.texture(textures::oak());
        let planks = document.texture(textures::planks());
        let plaster = Material {
            normal: Some((plaster_relief, 0.6)),
            ..Material::plain("plaster", vec3(0.79, 0.775, 0.745), 0.75)
        };
        let accent = Material {
            normal: Some((plaster_relief, 0.6)),
            ..Material::plain("petrol plaster", vec3(0.052, 0.105, 0.112), 0.7)
        };
        let leather = Material {
            normal: Some((leather_relief, 0.5)),
            ..Material::plain("cognac leather", vec3(0.36, 0.125, 0.042), 0.42)
        };
        let oak = Material { texture: Some(oak), ..Material::plain("oiled oak", Vec3::ONE, 0.42) };
        let floor = Material { texture: Some(planks), ..Material::plain("oak planks", Vec3::ONE, 0.33) };
        Materials {
            plaster: document.material(plaster),
            white: document.material(Material::plain("white lacquer", Vec3::splat(0.78), 0.4)),
            oak: document.material(oak),
            black: document.material(Material::plain("black steel", vec3(0.022, 0.022, 0.024), 0.35)),
            brass: document.material(Material::metal("brass", vec3(0.86, 0.62, 0.30), 0.25)),
            floor: document.material(floor),
            accent: document.material(accent),
            leather: document.material(leather),
            bronze: document.material(Material::metal("satin bronze", vec3(0.78, 0.47, 0.25), 0.3)),
            solid_glass: document.material(Material::glass("glass", Glass::Solid, vec3(0.97, 0.99, 0.98))),
            pane: document.material(Material::glass("glass pane", Glass::Pane, vec3(0.95, 0.98, 0.97))),
            stone: document.material(Material::plain("dark clay", vec3(0.13, 0.115, 0.105), 0.7)),
            glaze: document.material(Material::plain("bone glaze", vec3(0.70, 0.66, 0.58), 0.35)),
        }
    }
}

/// A camera that looks from one point to another, its vertical angle of view in degrees.
fn camera(stage: &mut Stage, name: &str, eye: Vec3, target: Vec3, yfov_degrees: f32) {
    let camera = Some((yfov_degrees.to_radians(), 16.0 / 9.0));
    let rotation = facing(target - eye);
    stage.document.node(Node { name: name.to_owned(), translation: eye, rotation, camera, ..Node::default() });
}

/// The rotation that turns −z to a direction and keeps +y as far up as possible.
pub fn facing(direction: Vec3) -> Quat {
    let direction = direction.normalize();
    let yaw = (-direction.x).atan2(-direction.z);
    Quat::from_rotation_y(yaw) * Quat::from_rotation_x(direction.y.asin())
}
