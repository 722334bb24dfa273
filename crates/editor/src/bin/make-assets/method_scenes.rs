//! The four scene types on which the method is measured: a room of 4 m × 3 m × 4 m under one panel of 16 × 16 texels.

use std::f32::consts::FRAC_PI_2;

use glam::{Quat, Vec3, vec3};

use crate::glb::{Document, Node};
use crate::material::{Glass, Material};
use crate::mesh::Mesh;
use crate::shapes::{block, cylinder, lathe, picture, quad, rounded_block, sphere, torus};

/// Emitted radiance of the panels in nit.
const PANEL_NIT: f32 = 10.0;
const N_TEXELS: u32 = 16;

/// Matte boxes, thin posts and spheres between colored walls: soft and hard shadows.
pub fn diffuse() -> Document {
    let mut room = Room::new(Floor::Matte);
    room.panel(vec3(0.0, 2.98, -0.3), Quat::from_rotation_x(FRAC_PI_2), 1.5);
    room.matte_blocks();
    room.posts();
    let clay = Material::lambert("clay", vec3(0.62, 0.32, 0.18));
    room.put("clay sphere", sphere(0.42, 64).at(0.9, 0.42, -0.05), clay);
    room.put("chalk sphere", sphere(0.22, 48).at(-0.1, 0.22, 0.2), Material::lambert("chalk", Vec3::splat(0.8)));
    room.seen_from(vec3(0.0, 1.75, 1.95), vec3(0.0, 0.85, -1.0), 60.0)
}

/// Glossy checkers below a mirror ball, a mirror box and a glossy ball.
pub fn reflections() -> Document {
    let mut room = Room::new(Floor::GlossyCheckers);
    room.panel(vec3(0.0, 2.98, -0.3), Quat::from_rotation_x(FRAC_PI_2), 1.5);
    room.mirror_ball(vec3(-0.75, 0.55, -0.5));
    room.mirror_box(vec3(0.95, 0.0, -0.75));
    let glossy = Material::plain("glossy red", vec3(0.55, 0.04, 0.03), 0.15);
    room.put("glossy sphere", sphere(0.36, 64).at(0.25, 0.36, 0.05), glossy);
    let brushed = Material::metal("brushed copper", vec3(0.93, 0.6, 0.46), 0.3);
    room.put("copper cylinder", cylinder(0.17, 0.5, 64).at(1.15, 0.0, 0.0), brushed);
    room.seen_from(vec3(0.0, 1.75, 1.95), vec3(0.0, 0.8, -1.0), 60.0)
}

/// Glass and metal that gather the light of a small panel on a matte floor.
pub fn caustics() -> Document {
    let mut room = Room::new(Floor::Matte);
    room.panel(vec3(-1.2, 2.7, -0.9), Quat::from_rotation_z(0.35) * Quat::from_rotation_x(FRAC_PI_2), 0.7);
    room.glass_ball(vec3(-0.6, 0.5, -0.45));
    let ring = torus(0.36, 0.11).turned(Quat::from_rotation_x(0.25)).at(0.8, 0.21, -0.95);
    room.put("glass torus", ring, clear_glass());
    room.metal_ring(vec3(0.35, 0.0, 0.1));
    room.seen_from(vec3(0.1, 1.85, 1.95), vec3(0.1, 0.45, -0.6), 58.0)
}

/// All of it, and the panel in view on the back wall.
pub fn mixed() -> Document {
    let mut room = Room::new(Floor::GlossyCheckers);
    room.panel(vec3(0.0, 1.95, -1.97), Quat::IDENTITY, 1.3);
    room.mirror_ball(vec3(-0.95, 0.42, -0.75));
    room.glass_ball(vec3(0.15, 0.34, -0.1));
    room.metal_ring(vec3(-0.7, 0.0, 0.1));
    room.posts();
    let tall = rounded_block(vec3(0.55, 1.1, 0.55), 0.01).turned(Quat::from_rotation_y(0.5)).at(1.05, 0.55, -0.6);
    room.put("tall box", tall, Material::lambert("chalk", Vec3::splat(0.75)));
    let glossy = Material::plain("glossy red", vec3(0.55, 0.04, 0.03), 0.15);
    room.put("glossy sphere", sphere(0.27, 64).at(0.9, 0.27, 0.1), glossy);
    room.seen_from(vec3(0.0, 1.7, 1.95), vec3(0.0, 0.88, -1.0), 62.0)
}

/// What the floor is made of.
enum Floor {
    Matte,
    GlossyCheckers,
}

struct Room {
    document: Document,
}

impl Room {
    fn new(floor: Floor) -> Room {
        let mut room = Room { document: Document::default() };
        let (across, up, along) = (vec3(4.0, 0.0, 0.0), vec3(0.0, 3.0, 0.0), vec3(0.0, 0.0, 4.0));
        let (low, high) = (vec3(-2.0, 0.0, -2.0), vec3(2.0, 3.0, 2.0));
        let white = Mesh::join([
            quad(vec3(low.x, high.y, low.z), across, along),
            quad(low, across, up),
            quad(vec3(high.x, low.y, high.z), -across, up),
        ]);
        room.put("walls", white, Material::lambert("white wall", Vec3::splat(0.73)));
        let left = quad(vec3(low.x, low.y, high.z), -along, up);
        room.put("left wall", left, Material::lambert("red wall", vec3(0.57, 0.08, 0.06)));
        let right = quad(vec3(high.x, low.y, low.z), along, up);
        room.put("right wall", right, Material::lambert("green wall", vec3(0.10, 0.36, 0.12)));
        match floor {
            Floor::Matte => {
                let floor = quad(vec3(low.x, low.y, high.z), across, -along);
                room.put("floor", floor, Material::lambert("gray floor", Vec3::splat(0.6)));
            }
            Floor::GlossyCheckers => room.checkers(),
        }
        room
    }

    fn put(&mut self, name: &str, mesh: Mesh, material: Material) {
        let material = self.document.material(material);
        let mesh = self.document.mesh(name, &[(mesh, material)]);
        self.document.node(Node { name: name.to_owned(), mesh: Some(mesh), ..Node::default() });
    }

    /// An upright quad around a point that shines to +z before it is turned.
    fn panel(&mut self, center: Vec3, rotation: Quat, side_m: f32) {
        let half = side_m / 2.0;
        let face = picture(vec3(-half, -half, 0.0), vec3(side_m, 0.0, 0.0), vec3(0.0, side_m, 0.0));
        let light = Material { emission: Vec3::splat(PANEL_NIT), ..Material::lambert("panel light", Vec3::splat(0.5)) };
        let light = self.document.material(light);
        let mesh = self.document.panel_mesh("panel", &[(face, light)]);
        let (name, panel) = ("panel".to_owned(), Some(N_TEXELS));
        self.document.node(Node { name, translation: center, rotation, mesh: Some(mesh), panel, ..Node::default() });
    }

    fn checkers(&mut self) {
        let tiles = |parity: usize| {
            let cells = (0..64).filter(move |i| (i % 8 + i / 8) % 2 == parity);
            Mesh::join(cells.map(|i| {
                let corner = vec3((i % 8) as f32 * 0.5 - 2.0, 0.0, (i / 8) as f32 * 0.5 - 1.5);
                quad(corner, vec3(0.5, 0.0, 0.0), vec3(0.0, 0.0, -0.5))
            }))
        };
        self.put("light tiles", tiles(0), Material::plain("light tile", Vec3::splat(0.7), 0.2));
        self.put("dark tiles", tiles(1), Material::plain("dark tile", Vec3::splat(0.06), 0.2));
    }

    fn matte_blocks(&mut self) {
        let chalk = Material::lambert("chalk box", Vec3::splat(0.75));
        let tall = block(vec3(-0.35, 0.0, -0.35), vec3(0.35, 1.4, 0.35)).turned(Quat::from_rotation_y(0.35));
        self.put("tall box", tall.at(-0.85, 0.0, -0.8), chalk);
        let ochre = Material::lambert("ochre box", vec3(0.66, 0.46, 0.12));
        let low = block(vec3(-0.4, 0.0, -0.3), vec3(0.4, 0.45, 0.3)).turned(Quat::from_rotation_y(-0.4));
        self.put("low box", low.at(0.5, 0.0, -0.75), ochre);
    }

    /// A row of thin posts, whose shadows need every texel.
    fn posts(&mut self) {
        let post = |i: u8| cylinder(0.025, 1.2, 24).at(0.55 + 0.2 * f32::from(i), 0.0, -1.55);
        let posts = Mesh::join((0..6).map(post));
        self.put("posts", posts, Material::lambert("blue post", vec3(0.12, 0.22, 0.55)));
    }

    fn mirror_ball(&mut self, center: Vec3) {
        let mirror = Material::metal("mirror ball", Vec3::splat(0.9), 0.0);
        self.put("mirror ball", sphere(center.y, 96).at(center.x, center.y, center.z), mirror);
    }

    fn mirror_box(&mut self, foot: Vec3) {
        let mirror = Material::metal("mirror box", vec3(0.9, 0.88, 0.85), 0.0);
        let body = block(vec3(-0.35, 0.0, -0.35), vec3(0.35, 1.1, 0.35)).turned(Quat::from_rotation_y(-0.55));
        self.put("mirror box", body.at(foot.x, foot.y, foot.z), mirror);
    }

    fn glass_ball(&mut self, center: Vec3) {
        let ball = sphere(center.y - 0.002, 96).at(center.x, center.y, center.z);
        self.put("glass ball", ball, clear_glass());
    }

    /// A band of gold that casts a cardioid of light inside itself.
    fn metal_ring(&mut self, foot: Vec3) {
        let profile = [(0.38, 0.001), (0.40, 0.001), (0.40, 0.26), (0.38, 0.26), (0.38, 0.001)];
        let band = lathe(&profile, 128).at(foot.x, foot.y, foot.z);
        self.put("metal ring", band, Material::metal("gold", vec3(1.0, 0.77, 0.34), 0.05));
    }

    fn seen_from(mut self, eye: Vec3, target: Vec3, yfov_degrees: f32) -> Document {
        let rotation = crate::gallery::facing(target - eye);
        let camera = Some((yfov_degrees.to_radians(), 4.0 / 3.0));
        self.document.node(Node { name: "view".to_owned(), translation: eye, rotation, camera, ..Node::default() });
        self.document
    }
}

fn clear_glass() -> Material {
    Material::glass("clear glass", Glass::Solid, Vec3::ONE)
}
