//! A tiny glTF writer: triangles, lamps and a camera, as GLB bytes in memory.

use glam::{Quat, Vec3};
use serde_json::{Value, json};

/// Triangles in world space.
#[derive(Clone, Debug, Default)]
pub struct Shape {
    /// Corners, three per triangle, counter-clockwise seen from the front.
    pub corners: Vec<Vec3>,
}

impl Shape {
    /// A parallelogram from a corner along two edges; its front is where u × v points.
    pub fn quad(corner: Vec3, u: Vec3, v: Vec3) -> Shape {
        let [a, b, c, d] = [corner, corner + u, corner + u + v, corner + v];
        Shape { corners: vec![a, b, c, a, c, d] }
    }

    /// A closed box around the origin whose fronts look inwards.
    pub fn room(half: Vec3) -> Shape {
        let mut corners = Vec::new();
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let along = |axis: usize| Vec3::AXES[axis] * half[axis];
            let (n, u, v) = (along(axis), along(u), along(v));
            corners.extend(Shape::quad(n - u - v, u * 2.0, v * 2.0).corners);
            corners.extend(Shape::quad(-n - u - v, u * 2.0, v * 2.0).corners);
        }
        Shape { corners: face_inwards(corners) }
    }

    /// A closed sphere around the origin; its fronts look inwards.
    pub fn hollow_sphere(radius: f32, n_rings: u32) -> Shape {
        let point = |ring: u32, segment: u32| {
            let (theta, phi) = (
                ring as f32 / n_rings as f32 * std::f32::consts::PI,
                (segment % (2 * n_rings)) as f32 / n_rings as f32 * std::f32::consts::PI,
            );
            Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()) * radius
        };
        let mut corners = Vec::new();
        for ring in 0..n_rings {
            for segment in 0..2 * n_rings {
                let [a, b] = [point(ring, segment), point(ring, segment + 1)];
                let [c, d] = [point(ring + 1, segment), point(ring + 1, segment + 1)];
                if ring > 0 {
                    corners.extend([a, d, b]);
                }
                if ring + 1 < n_rings {
                    corners.extend([a, c, d]);
                }
            }
        }
        Shape { corners: face_inwards(corners) }
    }

    /// The same surface elsewhere.
    pub fn moved(mut self, by: Vec3) -> Shape {
        self.corners.iter_mut().for_each(|corner| *corner += by);
        self
    }

    /// The same surface seen from its other side.
    pub fn turned(mut self) -> Shape {
        self.corners.chunks_exact_mut(3).for_each(|triangle| triangle.swap(1, 2));
        self
    }
}

/// Turns every triangle towards the origin.
fn face_inwards(mut corners: Vec<Vec3>) -> Vec<Vec3> {
    for triangle in corners.chunks_exact_mut(3) {
        let normal = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]);
        if normal.dot(triangle[0] + triangle[1] + triangle[2]) > 0.0 {
            triangle.swap(1, 2);
        }
    }
    corners
}

/// A glTF document under construction.
#[derive(Clone, Debug, Default)]
pub struct SceneFile {
    nodes: Vec<Value>,
    meshes: Vec<Value>,
    materials: Vec<Value>,
    accessors: Vec<Value>,
    views: Vec<Value>,
    lights: Vec<Value>,
    cameras: Vec<Value>,
    bytes: Vec<u8>,
}

impl SceneFile {
    /// A Lambert material: reflectance and emitted radiance, both per channel.
    pub fn lambert(albedo: [f32; 3], radiance: [f32; 3]) -> Value {
        let peak = radiance.into_iter().fold(1.0, f32::max);
        json!({
            "pbrMetallicRoughness": {
                "baseColorFactor": [albedo[0], albedo[1], albedo[2], 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0,
            },
            "emissiveFactor": radiance.map(|v| v / peak),
            "extensions": {
                "KHR_materials_specular": { "specularFactor": 0.0 },
                "KHR_materials_emissive_strength": { "emissiveStrength": peak },
            },
        })
    }

    /// A node with a surface.
    #[must_use]
    pub fn surface(self, name: &str, shape: &Shape, material: Value) -> SceneFile {
        self.surface_with(name, shape, material, json!({}))
    }

    /// A node with an emissive quad that is marked as a panel of m × m texels.
    #[must_use]
    pub fn panel(self, name: &str, shape: &Shape, radiance: [f32; 3], resolution: u32) -> SceneFile {
        let extras = json!({ "clerestory": { "panel": resolution } });
        self.surface_with(name, shape, SceneFile::lambert([0.0; 3], radiance), extras)
    }

    /// A node with a quad that exists as a grid of sensors only.
    #[must_use]
    pub fn sensors(self, name: &str, shape: &Shape, size: [u32; 2]) -> SceneFile {
        let extras = json!({ "clerestory": { "sensors": size } });
        self.surface_with(name, shape, SceneFile::lambert([0.5; 3], [1.0; 3]), extras)
    }

    fn surface_with(mut self, name: &str, shape: &Shape, material: Value, extras: Value) -> SceneFile {
        let offset = self.bytes.len();
        for corner in &shape.corners {
            corner.to_array().iter().for_each(|v| self.bytes.extend(v.to_le_bytes()));
        }
        self.views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": self.bytes.len() - offset }));
        let low = shape.corners.iter().fold(Vec3::INFINITY, |low, p| low.min(*p));
        let high = shape.corners.iter().fold(Vec3::NEG_INFINITY, |high, p| high.max(*p));
        self.accessors.push(json!({
            "bufferView": self.views.len() - 1, "componentType": 5126, "count": shape.corners.len(), "type": "VEC3",
            "min": low.to_array(), "max": high.to_array(),
        }));
        self.materials.push(material);
        let attributes = json!({ "POSITION": self.accessors.len() - 1 });
        self.meshes.push(json!({ "primitives": [{ "attributes": attributes, "material": self.materials.len() - 1 }] }));
        self.nodes.push(json!({ "name": name, "mesh": self.meshes.len() - 1, "extras": extras }));
        self
    }

    /// A node with a point lamp, candela per channel.
    #[must_use]
    pub fn point_lamp(self, name: &str, position: Vec3, color: [f32; 3], candela: f32) -> SceneFile {
        let light = json!({ "type": "point", "color": color, "intensity": candela });
        self.lamp(light, json!({ "name": name, "translation": position.to_array() }))
    }

    /// A node with a lamp as glTF writes it, which shines from a place towards another.
    #[must_use]
    pub fn aimed_lamp(self, name: &str, [position, aim]: [Vec3; 2], light: Value) -> SceneFile {
        let rotation = Quat::from_rotation_arc(Vec3::NEG_Z, (aim - position).normalize());
        let (translation, rotation) = (position.to_array(), rotation.to_array());
        self.lamp(light, json!({ "name": name, "translation": translation, "rotation": rotation }))
    }

    fn lamp(mut self, light: Value, mut node: Value) -> SceneFile {
        self.lights.push(light);
        node["extensions"] = json!({ "KHR_lights_punctual": { "light": self.lights.len() - 1 } });
        self.nodes.push(node);
        self
    }

    /// Gives the last lamp a range in meters.
    #[must_use]
    pub fn with_range(mut self, range_m: f32) -> SceneFile {
        self.lights.last_mut().expect("a lamp was added")["range"] = json!(range_m);
        self
    }

    /// A node with a camera that looks along −Z.
    #[must_use]
    pub fn camera(mut self, name: &str, position: Vec3, yfov_rad: f32) -> SceneFile {
        let perspective = json!({ "yfov": yfov_rad, "znear": 0.01, "aspectRatio": 4.0 / 3.0 });
        self.cameras.push(json!({ "type": "perspective", "perspective": perspective }));
        let camera = self.cameras.len() - 1;
        self.nodes.push(json!({ "name": name, "camera": camera, "translation": position.to_array() }));
        self
    }

    /// The file.
    pub fn glb(&self) -> Vec<u8> {
        let mut document = json!({
            "asset": { "version": "2.0", "generator": "clerestory house tests" },
            "extensionsUsed":
                ["KHR_lights_punctual", "KHR_materials_specular", "KHR_materials_emissive_strength"],
            "scene": 0,
            "scenes": [{ "nodes": (0..self.nodes.len()).collect::<Vec<_>>() }],
            "nodes": self.nodes,
            "extensions": { "KHR_lights_punctual": { "lights": self.lights } },
            "buffers": [{ "byteLength": self.bytes.len() }],
        });
        let lists = [
            ("meshes", &self.meshes),
            ("materials", &self.materials),
            ("accessors", &self.accessors),
            ("bufferViews", &self.views),
            ("cameras", &self.cameras),
        ];
        for (name, list) in lists.into_iter().filter(|(_, list)| !list.is_empty()) {
            document[name] = json!(list);
        }
        let mut text = document.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut glb = Vec::new();
        let total = 12 + 8 + text.len() + 8 + self.bytes.len();
        glb.extend(b"glTF");
        glb.extend(2u32.to_le_bytes());
        glb.extend((total as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &self.bytes)] {
            glb.extend((chunk.len() as u32).to_le_bytes());
            glb.extend(kind);
            glb.extend(chunk);
        }
        glb
    }
}
