//! A hash of everything in a scene that light can meet, so that a half-done bake is only taken up by the same scene.

use std::collections::BTreeMap;

use glam::Vec3;
use rayon::prelude::*;

use crate::bake::BakeHeader;
use crate::camera::Camera;
use crate::scene::{Material, Mesh, Scene, Texture};

const OFFSET: u64 = 0xcbf2_9ce4_8422_2325;

/// 64-bit FNV-1a over 8-byte words.
struct Fnv(u64);

/// What of a scene counts.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Counting {
    All,
    /// Not which parts of glass are of one node, as in files of before.
    WithoutPanes,
    /// Nor the sides of images that are no squares, as in files of before those.
    WithoutSides,
}

impl Fnv {
    fn bytes(&mut self, bytes: &[u8]) {
        for chunk in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            self.0 = (self.0 ^ u64::from_le_bytes(word)).wrapping_mul(0x0000_0100_0000_01B3);
            self.0 ^= self.0 >> 29;
        }
    }

    fn mesh(&mut self, mesh: &Mesh) {
        self.bytes(bytemuck::cast_slice(&mesh.positions));
        self.bytes(bytemuck::cast_slice(&mesh.normals));
        self.bytes(bytemuck::cast_slice(&mesh.tangents));
        self.bytes(bytemuck::cast_slice(&mesh.uvs[0]));
        self.bytes(bytemuck::cast_slice(&mesh.uvs[1]));
        self.bytes(bytemuck::cast_slice(&mesh.colors));
        self.bytes(bytemuck::cast_slice(&mesh.triangles));
        self.bytes(bytemuck::cast_slice(&mesh.triangle_material));
    }

    /// The same of some triangles alone, each under its number.
    fn mesh_without(&mut self, mesh: &Mesh, left_out: &[bool]) {
        let Mesh { positions, normals, tangents, uvs: [first, second], colors, .. } = mesh;
        let lengths = [tangents.len(), first.len(), second.len(), colors.len()];
        self.bytes(format!("{lengths:?}").as_bytes());
        for (number, _) in left_out.iter().enumerate().filter(|(_, is_out)| !**is_out) {
            self.bytes(format!("{number} {}", mesh.triangle_material[number]).as_bytes());
            for vertex in mesh.triangles[number].map(|vertex| vertex as usize) {
                self.bytes(bytemuck::bytes_of(&positions[vertex]));
                self.bytes(bytemuck::bytes_of(&normals[vertex]));
                for uv in [first, second].into_iter().filter_map(|uvs| uvs.get(vertex)) {
                    self.bytes(bytemuck::bytes_of(uv));
                }
                for of_vertex in [tangents, colors].into_iter().filter_map(|all| all.get(vertex)) {
                    self.bytes(bytemuck::bytes_of(of_vertex));
                }
            }
        }
    }

    /// Which triangles of glass are of one node, whatever its number: panes that touch are told apart by it.
    fn panes(&mut self, scene: &Scene, counting: Counting, left_out: &[bool]) {
        if counting != Counting::All {
            return;
        }
        let mut numbers = BTreeMap::new();
        for triangle in glass(scene).filter(|triangle| left_out.get(*triangle) != Some(&true)) {
            let next = numbers.len() as u32;
            let number = *numbers.entry(scene.mesh.triangle_node[triangle]).or_insert(next);
            self.bytes(&number.to_le_bytes());
        }
    }

    fn texture(&mut self, texture: &Texture, counting: Counting) {
        let image = &texture.image;
        self.bytes(bytemuck::cast_slice(&image.texels));
        self.bytes(format!("{:?} {:?}", texture.wrap, texture.filter).as_bytes());
        // In rows of another length the same texels are another image. Squares are told from all others without a word.
        if counting != Counting::WithoutSides && image.width != image.height {
            self.bytes(format!("{} {}", image.width, image.height).as_bytes());
        }
    }

    fn digits(&self) -> String {
        format!("{:016x}", self.0)
    }

    /// Of scenes whose unlit surfaces stopped light in bakes of before.
    fn unlit(&mut self, scene: &Scene) {
        if scene.materials.iter().any(|material| material.unlit) {
            self.bytes(b"light passes");
        }
    }
}

/// Triangles whose material lets light through.
fn glass(scene: &Scene) -> impl Iterator<Item = usize> {
    let is_glass = move |material: u32| scene.materials.get(material as usize).is_some_and(|m| m.transmission > 0.0);
    let materials = scene.mesh.triangle_material.iter().enumerate();
    materials.filter(move |(_, material)| is_glass(**material)).map(|(triangle, _)| triangle)
}

/// A hash of some bytes.
pub(crate) fn digest(bytes: &[u8]) -> u64 {
    let mut hash = Fnv(OFFSET);
    hash.bytes(bytes);
    hash.0
}

/// Sixteen hexadecimal digits. The camera's name counts as well: a bake is compared under the name that it knows,
/// [`BakeHeader::is_of`].
pub fn fingerprint(scene: &Scene, camera: &Camera) -> String {
    of_scene(scene, camera, Counting::All)
}

fn of_scene(scene: &Scene, camera: &Camera, counting: Counting) -> String {
    let mut hash = Fnv(OFFSET);
    hash.mesh(&scene.mesh);
    hash.panes(scene, counting, &[]);
    hash.bytes(format!("{:?} {:?} {camera:?}", scene.materials, scene.punctual).as_bytes());
    for profile in &scene.profiles {
        hash.bytes(&profile.light_bytes());
    }
    scene.textures.iter().for_each(|texture| hash.texture(texture, counting));
    hash.unlit(scene);
    hash.digits()
}

/// Whether a hash in a file is that of a scene, in one of before as well.
fn is_hash_of(scene: &Scene, found: &str, hash: impl Fn(Counting) -> String) -> bool {
    let is_square = |texture: &Texture| texture.image.width == texture.image.height;
    found == hash(Counting::All)
        || (glass(scene).next().is_some() && found == hash(Counting::WithoutPanes))
        || (!scene.textures.iter().all(is_square) && found == hash(Counting::WithoutSides))
}

/// A hash of a texture, whatever its place in a scene.
pub(crate) fn of_texture(texture: &Texture) -> u64 {
    let mut hash = Fnv(OFFSET);
    hash.texture(texture, Counting::All);
    hash.0
}

/// The same of the surfaces alone and how they scatter: nothing of it tells whether, how strongly, by which map or in which color they
/// shine.
pub(crate) fn of_surfaces(scene: &Scene) -> String {
    of_scattering(scene, Counting::All, &[])
}

/// Whether [`of_surfaces`] in a file is that of a scene.
pub(crate) fn is_of_surfaces(scene: &Scene, found: &str) -> bool {
    is_hash_of(scene, found, |counting| of_scattering(scene, counting, &[]))
}

/// The same without some triangles: it does not count where they lie, nor which of the materials they have.
pub(crate) fn of_surfaces_without(scene: &Scene, left_out: &[bool]) -> String {
    of_scattering(scene, Counting::All, left_out)
}

/// Of all that scatters but some triangles, if any are given.
fn of_scattering(scene: &Scene, counting: Counting, left_out: &[bool]) -> String {
    let mut hash = Fnv(OFFSET);
    let (mesh, (materials, textures)) = (&scene.mesh, without_light(scene));
    hash.bytes(format!("{} {} {}", mesh.positions.len(), mesh.triangles.len(), textures.len()).as_bytes());
    if left_out.is_empty() {
        hash.mesh(mesh);
    } else {
        hash.mesh_without(mesh, left_out);
    }
    hash.panes(scene, counting, left_out);
    for material in materials {
        hash.bytes(format!("{material:?}").as_bytes());
    }
    textures
        .into_iter()
        .filter_map(|place| scene.textures.get(place as usize))
        .for_each(|texture| hash.texture(texture, counting));
    hash.unlit(scene);
    hash.digits()
}

/// Materials as they are dark, with textures numbered in the order of their use, and the places of these in the scene.
fn without_light(scene: &Scene) -> (Vec<Material>, Vec<u32>) {
    let (mut numbers, mut places) = (BTreeMap::new(), Vec::new());
    let dark = |material: &Material| {
        let mut dark = Material {
            name: String::new(),
            emissive: Vec3::ZERO,
            emissive_strength: 1.0,
            emissive_texture: None,
            ..material.clone()
        };
        for texture in dark.texture_slots().into_iter().flatten() {
            let place = texture.texture;
            texture.texture = *numbers.entry(place).or_insert_with(|| {
                places.push(place);
                places.len() as u32 - 1
            });
        }
        dark
    };
    let materials = scene.materials.iter().map(dark).collect();
    (materials, places)
}

impl BakeHeader {
    /// Whether the bake is of this scene, seen by this camera, whatever that is called by now.
    pub fn is_of(&self, scene: &Scene, camera: &Camera) -> bool {
        let camera = camera.called(&self.camera);
        is_hash_of(scene, &self.fingerprint, |counting| of_scene(scene, &camera, counting))
    }

    /// Where the bake is seen from, where it is of this scene: its own view, else a camera of the scene, rather one of its name. Each
    /// reads the whole scene, so the others are tried side by side.
    pub fn camera_in<'a>(&'a self, scene: &'a Scene) -> Option<&'a Camera> {
        let is_it = |camera: &&Camera| self.is_of(scene, camera);
        let known = self.view.iter().chain(Camera::named(&scene.cameras, &self.camera)).find(is_it);
        known.or_else(|| scene.cameras.par_iter().find_first(is_it))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Affine2;

    use super::*;
    use crate::scene::{Encoding, Filter, Image, TextureRef, Wrap};

    /// A material with four texels, in rows of some length.
    fn scene([width, height]: [u32; 2]) -> Scene {
        let texels = vec![[255, 0, 0, 255], [0, 0, 255, 255], [255, 0, 0, 255], [255, 0, 0, 255]];
        let image = Arc::new(Image { width, height, texels });
        let texture = Texture { image, wrap: [Wrap::Repeat; 2], filter: Filter::Linear };
        let shown = TextureRef { texture: 0, uv_set: 0, transform: Affine2::IDENTITY, encoding: Encoding::Srgb };
        let material = Material { base_color_texture: Some(shown), ..Material::default() };
        Scene { textures: vec![texture], materials: vec![material], ..Scene::default() }
    }

    #[test]
    fn the_same_texels_in_rows_of_another_length_are_another_image() {
        let camera = Camera::look_at("front", Vec3::Z, Vec3::ZERO, 1.0, 1.0);
        let scenes = [[4, 1], [1, 4], [2, 2]].map(scene);
        for (own, other) in [(0, 1), (0, 2), (1, 2)].map(|(own, other)| (&scenes[own], &scenes[other])) {
            assert_ne!(fingerprint(own, &camera), fingerprint(other, &camera));
            assert_ne!(of_surfaces(own), of_surfaces(other));
            assert_ne!(of_texture(&own.textures[0]), of_texture(&other.textures[0]));
        }
        assert!(!is_of_surfaces(&scenes[0], &of_surfaces(&scenes[1])));
        for own in &scenes {
            assert!(is_of_surfaces(own, &of_surfaces(own)));
            // Files of before are known by what they hold.
            let before = of_scene(own, &camera, Counting::WithoutSides);
            assert!(is_hash_of(own, &before, |counting| of_scene(own, &camera, counting)));
        }
    }

    /// Three triangles side by side, of a material and of nodes.
    fn panes(transmission: f32, nodes: [u32; 3]) -> Scene {
        let positions = (0..9u8).map(|nth| Vec3::new(f32::from(nth), f32::from(nth % 3), 0.0)).collect();
        let triangles = vec![[0, 1, 2], [3, 4, 5], [6, 7, 8]];
        let (triangle_material, triangle_node, normals) = (vec![0; 3], nodes.to_vec(), vec![Vec3::Z; 9]);
        let mesh = Mesh { positions, normals, triangles, triangle_material, triangle_node, ..Mesh::default() };
        Scene { mesh, materials: vec![Material { transmission, ..Material::default() }], ..Scene::default() }
    }

    #[test]
    fn glass_in_other_nodes_is_other_glass() {
        let camera = Camera::look_at("front", Vec3::Z, Vec3::ZERO, 1.0, 1.0);
        let hashes = |scene: &Scene| {
            let seen = of_surfaces_without(scene, &[false, true, false]);
            [fingerprint(scene, &camera), of_surfaces(scene), seen]
        };
        let own = panes(1.0, [0, 0, 1]);
        // The numbers of nodes change with others in the file, and those of walls tell nothing.
        assert_eq!(hashes(&own), hashes(&panes(1.0, [7, 7, 5])));
        assert_eq!(hashes(&panes(0.0, [0, 0, 1])), hashes(&panes(0.0, [0, 1, 2])));
        for nodes in [[0, 0, 0], [0, 1, 2]] {
            let other = panes(1.0, nodes);
            let [of_scene, of_surfaces, _] = hashes(&other);
            assert!(of_scene != hashes(&own)[0] && of_surfaces != hashes(&own)[1], "{nodes:?}");
            assert!(!is_of_surfaces(&own, &of_surfaces));
        }
        assert_ne!(hashes(&own)[2], hashes(&panes(1.0, [0, 1, 0]))[2]);
        assert_eq!(hashes(&own)[2], hashes(&panes(1.0, [0, 1, 2]))[2], "what is left out does not count");
        // Files of before are known by what they hold.
        let before = of_scene(&own, &camera, Counting::WithoutPanes);
        assert!(is_hash_of(&own, &before, |counting| of_scene(&own, &camera, counting)));
    }
}
