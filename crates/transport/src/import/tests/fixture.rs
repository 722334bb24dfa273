//! glTF files in memory, as JSON with one data URI.

use serde_json::{Value, json};

use crate::import::{Imported, load_bytes};

/// A file under construction: named accessors over one buffer, and the JSON around them.
#[derive(Clone)]
pub(super) struct Fixture {
    /// Root object, free to change before loading.
    pub root: Value,
    bytes: Vec<u8>,
}

impl Fixture {
    /// A file with one node without anything.
    pub fn new() -> Fixture {
        let root = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{}],
            "accessors": [], "bufferViews": [], "buffers": [{}], "materials": [], "meshes": [],
        });
        Fixture { root, bytes: Vec::new() }
    }

    /// A file with one triangle: (0,0,0), (1,0,0), (0,1,0), seen from +Z.
    pub fn triangle() -> Fixture {
        Fixture::mesh(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    }

    /// A file with one mesh of unindexed positions at node 0.
    pub fn mesh(positions: &[[f32; 3]]) -> Fixture {
        let mut fixture = Fixture::new();
        let position = fixture.floats("VEC3", positions.as_flattened());
        fixture.root["meshes"] = json!([{"primitives": [{"attributes": {"POSITION": position}}]}]);
        fixture.root["nodes"][0] = json!({"mesh": 0});
        fixture
    }

    /// The only primitive of the only mesh.
    pub fn primitive(&mut self) -> &mut Value {
        &mut self.root["meshes"][0]["primitives"][0]
    }

    /// Adds an accessor of floats; its index.
    pub fn floats(&mut self, shape: &str, values: &[f32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.accessor(shape, 5126, values.len() / components(shape), &bytes)
    }

    /// Adds an accessor over bytes in a buffer view of its own; its index.
    pub fn accessor(&mut self, shape: &str, component_type: u32, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let accessor = json!({"bufferView": view, "componentType": component_type, "count": count, "type": shape});
        push(&mut self.root["accessors"], accessor)
    }

    /// Adds a buffer view; its index.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let view = json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        self.bytes.extend(bytes);
        push(&mut self.root["bufferViews"], view)
    }

    /// Gives the only primitive a material.
    pub fn material(mut self, material: Value) -> Fixture {
        self.root["materials"] = json!([material]);
        self.primitive()["material"] = json!(0);
        self
    }

    /// Gives the corners of the only triangle texture coordinates.
    pub fn placed(mut self) -> Fixture {
        let uvs = self.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
        self.primitive()["attributes"]["TEXCOORD_0"] = json!(uvs);
        self
    }

    /// Sets members of node 0.
    pub fn node(mut self, members: Value) -> Fixture {
        for (key, value) in members.as_object().expect("an object") {
            self.root["nodes"][0][key] = value.clone();
        }
        self
    }

    /// The file as JSON.
    pub fn json(mut self) -> Vec<u8> {
        let hex: String = self.bytes.iter().map(|byte| format!("%{byte:02X}")).collect();
        self.root["buffers"][0] =
            json!({"byteLength": self.bytes.len(), "uri": format!("data:application/octet-stream,{hex}")});
        serde_json::to_vec(&self.root).expect("JSON of plain values")
    }

    /// The file as GLB.
    pub fn glb(mut self) -> Vec<u8> {
        self.root["buffers"][0] = json!({"byteLength": self.bytes.len()});
        let json = serde_json::to_vec(&self.root).expect("JSON of plain values");
        let mut out = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
        for (kind, payload, fill) in [(b"JSON", json, b' '), (b"BIN\0", self.bytes, 0)] {
            let mut payload = payload;
            payload.resize(payload.len().next_multiple_of(4), fill);
            out.extend((payload.len() as u32).to_le_bytes());
            out.extend(kind);
            out.extend(payload);
        }
        let length = out.len() as u32;
        out[8..12].copy_from_slice(&length.to_le_bytes());
        out
    }

    /// Loads it.
    pub fn load(self) -> Imported {
        load_bytes("test.gltf", &self.json()).expect("a loadable file")
    }
}

fn push(array: &mut Value, value: Value) -> usize {
    let array = array.as_array_mut().expect("an array");
    array.push(value);
    array.len() - 1
}

fn components(shape: &str) -> usize {
    match shape {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "MAT4" => 16,
        _ => 4,
    }
}
