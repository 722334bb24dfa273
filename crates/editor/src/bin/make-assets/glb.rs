//! Writer of binary glTF 2.0: meshes, materials, images, punctual lamps, cameras, nodes.

use std::collections::BTreeSet;

use clerestory::export_gltf::{BIN, write_glb};
use glam::{Quat, Vec3};
use serde_json::{Map, Value, json};

use crate::material::{Glass, Material, Sides};
use crate::mesh::Mesh;

/// Index of a material of the document.
#[derive(Clone, Copy)]
pub struct MaterialId(usize);

/// Index of a mesh of the document.
#[derive(Clone, Copy)]
pub struct MeshId(usize);

/// Index of a texture of the document.
#[derive(Clone, Copy)]
pub struct TextureId(usize);

/// An encoded image.
pub struct EncodedImage {
    /// Name in the file.
    pub name: &'static str,
    /// `image/png` or `image/jpeg`.
    pub mime_type: &'static str,
    /// Bytes of the image file.
    pub bytes: Vec<u8>,
}

/// A node with what it carries.
#[derive(Clone, Default)]
pub struct Node {
    /// Name in the file; the key of a light.
    pub name: String,
    /// Position in meters.
    pub translation: Vec3,
    /// Orientation.
    pub rotation: Quat,
    /// Mesh, if any.
    pub mesh: Option<MeshId>,
    /// Spot lamp along −z, if any.
    pub spot: Option<Spot>,
    /// Vertical angle of view in radians and aspect of a camera along −z, if any.
    pub camera: Option<(f32, f32)>,
    /// Texels per side of the panel that the mesh is, if it is one.
    pub panel: Option<u32>,
}

/// A punctual spot lamp.
#[derive(Clone, Copy)]
pub struct Spot {
    /// Linear Rec. 709 color, at most 1.
    pub color: Vec3,
    /// Intensity along the axis in candela.
    pub candela: f32,
    /// Half angle of the full beam in radians.
    pub inner_rad: f32,
    /// Half angle of the edge of the cone in radians.
    pub outer_rad: f32,
}

/// A glTF document that grows.
#[derive(Default)]
pub struct Document {
    accessors: Vec<Value>,
    buffer_views: Vec<Value>,
    cameras: Vec<Value>,
    images: Vec<Value>,
    lights: Vec<Value>,
    materials: Vec<Value>,
    meshes: Vec<Value>,
    nodes: Vec<Value>,
    textures: Vec<Value>,
    extensions: BTreeSet<&'static str>,
    binary: Vec<u8>,
    textured: Vec<bool>,
    relieved: Vec<bool>,
    emitting: Vec<bool>,
    mesh_triangles: Vec<usize>,
    mesh_emits: Vec<bool>,
    n_triangles: usize,
    n_lights: usize,
}

impl Document {
    /// Triangles of all nodes, instances counted each.
    pub fn n_triangles(&self) -> usize {
        self.n_triangles
    }

    /// Nodes that shine.
    pub fn n_lights(&self) -> usize {
        self.n_lights
    }

    /// Adds an image and a repeating texture of it.
    pub fn texture(&mut self, image: EncodedImage) -> TextureId {
        let view = self.buffer_view(&image.bytes, None);
        self.images.push(json!({ "name": image.name, "mimeType": image.mime_type, "bufferView": view }));
        self.textures.push(json!({ "sampler": 0, "source": self.images.len() - 1 }));
        TextureId(self.textures.len() - 1)
    }

    /// Adds a material.
    pub fn material(&mut self, material: Material) -> MaterialId {
        let mut surface = Map::new();
        surface.insert("baseColorFactor".into(), numbers(&material.base_color.extend(1.0).to_array()));
        if let Some(TextureId(index)) = material.texture {
            surface.insert("baseColorTexture".into(), json!({ "index": index }));
        }
        surface.insert("metallicFactor".into(), number(material.metallic));
        surface.insert("roughnessFactor".into(), number(material.roughness));
        let mut out = Map::new();
        out.insert("name".into(), json!(material.name));
        out.insert("pbrMetallicRoughness".into(), Value::Object(surface));
        if let Some((TextureId(index), scale)) = material.normal {
            out.insert("normalTexture".into(), json!({ "index": index, "scale": number(scale) }));
        }
        let strength = material.emission.max_element();
        if strength > 0.0 {
            out.insert("emissiveFactor".into(), numbers(&(material.emission / strength).to_array()));
        }
        if material.sides == Sides::Both {
            out.insert("doubleSided".into(), json!(true));
        }
        let extensions = self.material_extensions(&material);
        if !extensions.is_empty() {
            out.insert("extensions".into(), Value::Object(extensions));
        }
        self.materials.push(Value::Object(out));
        self.textured.push(material.texture.is_some() || material.normal.is_some());
        self.relieved.push(material.normal.is_some());
        self.emitting.push(strength > 0.0);
        MaterialId(self.materials.len() - 1)
    }

    fn material_extensions(&mut self, material: &Material) -> Map<String, Value> {
        let mut out = Map::new();
        let mut add = |name: &'static str, value: Value| {
            self.extensions.insert(name);
            out.insert(name.to_owned(), value);
        };
        if material.emission.max_element() > 0.0 {
            let strength = number(material.emission.max_element());
            add("KHR_materials_emissive_strength", json!({ "emissiveStrength": strength }));
        }
        if material.specular < 1.0 {
            add("KHR_materials_specular", json!({ "specularFactor": number(material.specular) }));
        }
        if let Some(glass) = material.glass {
            add("KHR_materials_transmission", json!({ "transmissionFactor": 1.0 }));
            add("KHR_materials_ior", json!({ "ior": 1.5 }));
            if matches!(glass, Glass::Solid) {
                add("KHR_materials_volume", json!({ "thicknessFactor": 0.1 }));
            }
        }
        out
    }

    /// Adds a mesh of one primitive per part. UVs are written where a texture reads them.
    pub fn mesh(&mut self, name: &str, parts: &[(Mesh, MaterialId)]) -> MeshId {
        let primitives = parts.iter().map(|(mesh, material)| {
            let uvs = if self.textured[material.0] { Uvs::Written } else { Uvs::LeftOut };
            self.primitive(mesh, *material, uvs)
        });
        let primitives: Vec<Value> = primitives.collect();
        self.meshes.push(json!({ "name": name, "primitives": primitives }));
        self.remember(parts)
    }

    /// Adds the mesh of a panel, whose UVs say where its texels are.
    pub fn panel_mesh(&mut self, name: &str, parts: &[(Mesh, MaterialId)]) -> MeshId {
        let primitives: Vec<Value> =
            parts.iter().map(|(mesh, material)| self.primitive(mesh, *material, Uvs::Written)).collect();
        self.meshes.push(json!({ "name": name, "primitives": primitives }));
        self.remember(parts)
    }

    fn remember(&mut self, parts: &[(Mesh, MaterialId)]) -> MeshId {
        self.mesh_triangles.push(parts.iter().map(|(mesh, _)| mesh.triangles.len()).sum());
        self.mesh_emits.push(parts.iter().any(|(_, material)| self.emitting[material.0]));
        MeshId(self.meshes.len() - 1)
    }

    fn primitive(&mut self, mesh: &Mesh, material: MaterialId, uvs: Uvs) -> Value {
        let positions: Vec<f32> = mesh.vertices.iter().flat_map(|v| v.position.to_array()).collect();
        let normals: Vec<f32> = mesh.vertices.iter().flat_map(|v| v.normal.to_array()).collect();
        let n_vertices = mesh.vertices.len();
        let mut attributes = Map::new();
        let position = self.floats(&positions, n_vertices, "VEC3");
        self.accessors[position]["min"] = json!(fold(mesh, Vec3::min).to_array());
        self.accessors[position]["max"] = json!(fold(mesh, Vec3::max).to_array());
        attributes.insert("POSITION".into(), json!(position));
        attributes.insert("NORMAL".into(), json!(self.floats(&normals, n_vertices, "VEC3")));
        if self.relieved[material.0] {
            let tangents = mesh.tangents();
            attributes.insert("TANGENT".into(), json!(self.floats(tangents.as_flattened(), n_vertices, "VEC4")));
        }
        if matches!(uvs, Uvs::Written) {
            let uvs: Vec<f32> = mesh.vertices.iter().flat_map(|v| v.uv.to_array()).collect();
            attributes.insert("TEXCOORD_0".into(), json!(self.floats(&uvs, n_vertices, "VEC2")));
        }
        json!({ "attributes": attributes, "indices": self.indices(mesh), "material": material.0 })
    }

    fn floats(&mut self, values: &[f32], count: usize, kind: &str) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.buffer_view(&bytes, Some(34962));
        self.accessors.push(json!({ "bufferView": view, "componentType": 5126, "count": count, "type": kind }));
        self.accessors.len() - 1
    }

    /// Indices of 16 bits where they suffice (the largest 16-bit index is reserved), else of 32.
    fn indices(&mut self, mesh: &Mesh) -> usize {
        let indices = mesh.triangles.iter().flatten();
        let short = mesh.vertices.len() < 65535;
        let bytes: Vec<u8> = if short {
            indices.flat_map(|&i| u16::try_from(i).expect("fewer than 65535 vertices").to_le_bytes()).collect()
        } else {
            indices.flat_map(|i| i.to_le_bytes()).collect()
        };
        let component = if short { 5123 } else { 5125 };
        let view = self.buffer_view(&bytes, Some(34963));
        let count = mesh.triangles.len() * 3;
        self.accessors
            .push(json!({ "bufferView": view, "componentType": component, "count": count, "type": "SCALAR" }));
        self.accessors.len() - 1
    }

    fn buffer_view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.binary.extend_from_slice(bytes);
        self.buffer_views.push(view);
        self.buffer_views.len() - 1
    }

    /// Adds a node to the scene.
    pub fn node(&mut self, node: Node) {
        let mut out = Map::new();
        out.insert("name".into(), json!(node.name));
        if node.translation != Vec3::ZERO {
            out.insert("translation".into(), numbers(&node.translation.to_array()));
        }
        if node.rotation != Quat::IDENTITY {
            out.insert("rotation".into(), json!(node.rotation.to_array()));
        }
        if let Some(MeshId(index)) = node.mesh {
            out.insert("mesh".into(), json!(index));
            self.n_triangles += self.mesh_triangles[index];
            self.n_lights += usize::from(self.mesh_emits[index]);
        }
        if let Some(spot) = node.spot {
            let index = self.spot(&node.name, spot);
            out.insert("extensions".into(), json!({ "KHR_lights_punctual": { "light": index } }));
        }
        if let Some((yfov, aspect)) = node.camera {
            let perspective = json!({ "yfov": number(yfov), "aspectRatio": number(aspect), "znear": 0.05 });
            self.cameras.push(json!({ "name": node.name, "type": "perspective", "perspective": perspective }));
            out.insert("camera".into(), json!(self.cameras.len() - 1));
        }
        if let Some(n_texels) = node.panel {
            out.insert("extras".into(), json!({ "clerestory": { "panel": n_texels } }));
        }
        self.nodes.push(Value::Object(out));
    }

    fn spot(&mut self, name: &str, spot: Spot) -> usize {
        self.extensions.insert("KHR_lights_punctual");
        self.n_lights += 1;
        self.lights.push(json!({
            "name": name,
            "type": "spot",
            "color": numbers(&spot.color.to_array()),
            "intensity": number(spot.candela),
            "spot": { "innerConeAngle": number(spot.inner_rad), "outerConeAngle": number(spot.outer_rad) },
        }));
        self.lights.len() - 1
    }

    /// The bytes of the GLB file.
    pub fn into_glb(mut self, name: &str) -> Vec<u8> {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let json = self.root(name).to_string().into_bytes();
        let mut out = Vec::new();
        write_glb(&mut out, json, &[(BIN, &self.binary[..])]).expect("the file is far below 4 GiB");
        out
    }

    fn root(&mut self, name: &str) -> Value {
        let generator = "Clerestory make-assets";
        let mut root = json!({
            "asset": { "version": "2.0", "generator": generator, "copyright": "CC0-1.0" },
            "scene": 0,
            "scenes": [{ "name": name, "nodes": (0..self.nodes.len()).collect::<Vec<_>>() }],
        });
        if !self.extensions.is_empty() {
            root["extensionsUsed"] = json!(self.extensions);
        }
        if !self.lights.is_empty() {
            root["extensions"] = json!({ "KHR_lights_punctual": { "lights": self.lights } });
        }
        if !self.textures.is_empty() {
            root["samplers"] = json!([{ "magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497 }]);
        }
        let lists = [
            ("nodes", &mut self.nodes),
            ("meshes", &mut self.meshes),
            ("materials", &mut self.materials),
            ("textures", &mut self.textures),
            ("images", &mut self.images),
            ("cameras", &mut self.cameras),
            ("accessors", &mut self.accessors),
            ("bufferViews", &mut self.buffer_views),
        ];
        for (key, list) in lists {
            if !list.is_empty() {
                root[key] = Value::Array(std::mem::take(list));
            }
        }
        root["buffers"] = json!([{ "byteLength": self.binary.len() }]);
        root
    }
}

#[derive(Clone, Copy)]
enum Uvs {
    Written,
    LeftOut,
}

fn fold(mesh: &Mesh, pick: fn(Vec3, Vec3) -> Vec3) -> Vec3 {
    mesh.vertices.iter().map(|v| v.position).reduce(pick).expect("a mesh has vertices")
}

/// A number with six decimals, so that 0.8 is written as 0.8.
fn number(x: f32) -> Value {
    json!((f64::from(x) * 1e6).round() / 1e6)
}

fn numbers(values: &[f32]) -> Value {
    Value::Array(values.iter().map(|&x| number(x)).collect())
}
