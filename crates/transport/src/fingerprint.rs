//! A hash of everything in a scene that light can meet, so that a half-done bake is only taken up by the same scene.

use crate::bake::BakeHeader;
use crate::camera::Camera;
use crate::scene::Scene;

const OFFSET: u64 = 0xcbf2_9ce4_8422_2325;

/// 64-bit FNV-1a over 8-byte words.
struct Fnv(u64);

impl Fnv {
    fn bytes(&mut self, bytes: &[u8]) {
        for chunk in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            self.0 = (self.0 ^ u64::from_le_bytes(word)).wrapping_mul(0x0000_0100_0000_01B3);
            self.0 ^= self.0 >> 29;
        }
    }
}

/// A hash of some bytes.
pub(crate) fn digest(bytes: &[u8]) -> u64 {
    let mut hash = Fnv(OFFSET);
    hash.bytes(bytes);
    hash.0
}

/// Sixteen hexadecimal digits.
pub fn fingerprint(scene: &Scene, camera: &Camera) -> String {
    let mut hash = Fnv(OFFSET);
    let mesh = &scene.mesh;
    hash.bytes(bytemuck::cast_slice(&mesh.positions));
    hash.bytes(bytemuck::cast_slice(&mesh.normals));
    hash.bytes(bytemuck::cast_slice(&mesh.tangents));
    hash.bytes(bytemuck::cast_slice(&mesh.uvs[0]));
    hash.bytes(bytemuck::cast_slice(&mesh.uvs[1]));
    hash.bytes(bytemuck::cast_slice(&mesh.colors));
    hash.bytes(bytemuck::cast_slice(&mesh.triangles));
    hash.bytes(bytemuck::cast_slice(&mesh.triangle_material));
    hash.bytes(format!("{:?} {:?} {camera:?}", scene.materials, scene.punctual).as_bytes());
    for profile in &scene.profiles {
        hash.bytes(&profile.light_bytes());
    }
    for texture in &scene.textures {
        hash.bytes(bytemuck::cast_slice(&texture.image.texels));
        hash.bytes(format!("{:?} {:?}", texture.wrap, texture.filter).as_bytes());
    }
    format!("{:016x}", hash.0)
}

impl BakeHeader {
    /// Whether the bake is of this scene, seen by this camera.
    pub fn is_of(&self, scene: &Scene, camera: &Camera) -> bool {
        self.fingerprint == fingerprint(scene, camera)
    }
}
