//! Scenes under construction, in code.

use std::sync::Arc;

use glam::{Affine2, Vec2, Vec3, Vec4};

use crate::camera::Camera;
use crate::emitters::SkyRequest;
use crate::prepared::PreparedScene;
use crate::scene::{
    AlphaMode, Encoding, Filter, Image, Material, PunctualKind, PunctualLight, Scene, SceneNode, Texture, TextureRef,
    Wrap,
};

/// A scene under construction: every surface and lamp is a node of its own.
pub(crate) struct Stage {
    scene: Scene,
}

impl Stage {
    /// A scene with nothing but a camera.
    pub fn new(camera: Camera) -> Stage {
        Stage { scene: Scene { name: "stage".into(), cameras: vec![camera], ..Scene::default() } }
    }

    /// Triangles, three corners each.
    pub fn surface(mut self, name: &str, corners: &[Vec3], material: Material) -> Stage {
        let node = self.node(name, None);
        let mesh = &mut self.scene.mesh;
        for triangle in corners.chunks_exact(3) {
            let first = mesh.positions.len() as u32;
            let normal = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]).normalize();
            mesh.positions.extend(triangle);
            mesh.normals.extend([normal; 3]);
            mesh.triangles.push([first, first + 1, first + 2]);
            mesh.triangle_material.push(self.scene.materials.len() as u32);
            mesh.triangle_node.push(node);
        }
        self.scene.materials.push(material);
        self
    }

    /// An emissive quad of `resolution` × `resolution` texels.
    pub fn panel(self, name: &str, corners: &[Vec3], radiance: f32, resolution: u32) -> Stage {
        self.surface(name, corners, lambert(0.0, radiance)).with_panel(Some(resolution))
    }

    /// The last surface asks to be a panel of `resolution` × `resolution` texels.
    pub fn with_panel(mut self, resolution: Option<u32>) -> Stage {
        self.scene.nodes.last_mut().expect("the surface has a node").panel = resolution;
        self
    }

    /// Every vertex so far is white, as where another mesh of the file has colors.
    pub fn with_white_vertices(mut self) -> Stage {
        self.scene.mesh.colors = vec![Vec4::ONE; self.scene.mesh.positions.len()];
        self
    }

    /// The only texture, two texels above two, and coordinates of all vertices so far by their places.
    pub fn with_texture(mut self, texels: [[u8; 4]; 4], uv: impl Fn(Vec3) -> Vec2) -> Stage {
        let image = Arc::new(Image { width: 2, height: 2, texels: texels.to_vec() });
        self.scene.textures = vec![Texture { image, wrap: [Wrap::Clamp; 2], filter: Filter::Nearest }];
        self.scene.mesh.uvs[0] = self.scene.mesh.positions.iter().map(|&position| uv(position)).collect();
        self
    }

    /// A white point lamp.
    pub fn lamp(self, name: &str, position: Vec3, candela: f32) -> Stage {
        self.punctual(name, PunctualKind::Point, [position, Vec3::NEG_Z], candela)
    }

    /// A white light from infinitely far away.
    pub fn distant(self, name: &str, direction: Vec3, lux: f32) -> Stage {
        self.punctual(name, PunctualKind::Directional, [Vec3::ZERO, direction.normalize()], lux)
    }

    fn punctual(mut self, name: &str, kind: PunctualKind, [position, direction]: [Vec3; 2], intensity: f32) -> Stage {
        let node = self.node(name, None);
        self.scene.punctual.push(PunctualLight {
            node,
            kind,
            position,
            direction,
            across: [Vec3::X, Vec3::Y],
            profile: None,
            color: Vec3::ONE,
            intensity,
            radius_rad: 0.0,
        });
        self
    }

    /// All of it so far from where it was built.
    pub fn moved(mut self, by: Vec3) -> Stage {
        self.scene.mesh.positions.iter_mut().for_each(|position| *position += by);
        self.scene.punctual.iter_mut().for_each(|light| light.position += by);
        self.scene.cameras.iter_mut().for_each(|camera| camera.world_from_camera.w_axis += by.extend(0.0));
        self
    }

    /// The scene as it is.
    pub fn into_scene(self) -> Scene {
        self.scene
    }

    /// The scene, ready for rays.
    pub fn prepared(self) -> PreparedScene {
        PreparedScene::new(self.scene, &[]).expect("a stage has valid lights").0
    }

    /// The same under a sky.
    pub fn prepared_under(self, sky: &SkyRequest) -> PreparedScene {
        PreparedScene::with_sky(self.scene, &[], Some(sky)).expect("a stage has valid lights").0
    }

    fn node(&mut self, name: &str, panel: Option<u32>) -> u32 {
        let index = self.scene.nodes.len() as u32;
        self.scene.nodes.push(SceneNode { index, name: Some(name.into()), panel, ..SceneNode::default() });
        index
    }
}

/// A parallelogram from a corner along two edges; its front is where u × v points.
pub(crate) fn quad(corner: Vec3, u: Vec3, v: Vec3) -> Vec<Vec3> {
    let [a, b, c, d] = [corner, corner + u, corner + u + v, corner + v];
    vec![a, b, c, a, c, d]
}

/// A closed box around the origin whose fronts look inwards.
pub(crate) fn room(half: Vec3) -> Vec<Vec3> {
    let mut corners = Vec::new();
    for axis in 0..3 {
        let along = |axis: usize| Vec3::AXES[axis % 3] * half[axis % 3];
        let (n, u, v) = (along(axis), along(axis + 1), along(axis + 2));
        corners.extend(quad(-n - u - v, u * 2.0, v * 2.0));
        corners.extend(quad(n - u - v, v * 2.0, u * 2.0));
    }
    corners
}

/// A plain diffuse surface that may emit from its front.
pub(crate) fn lambert(albedo: f32, radiance: f32) -> Material {
    Material {
        base_color: Vec3::splat(albedo).extend(1.0),
        metallic: 0.0,
        specular: 0.0,
        emissive: Vec3::splat(f32::from(radiance > 0.0)),
        emissive_strength: radiance,
        ..Material::default()
    }
}

/// A use of the texture of [`Stage::with_texture`].
pub(crate) fn textured(encoding: Encoding) -> Option<TextureRef> {
    Some(TextureRef { texture: 0, uv_set: 0, transform: Affine2::IDENTITY, encoding })
}

/// A black surface that shines from its front and is half there.
pub(crate) fn veil(radiance: f32) -> Material {
    Material { base_color: Vec4::new(0.0, 0.0, 0.0, 0.5), alpha: AlphaMode::Blend, ..lambert(0.0, radiance) }
}

/// Smooth glass without thickness.
pub(crate) fn pane() -> Material {
    Material { metallic: 0.0, roughness: 0.0, transmission: 1.0, ..Material::default() }
}

/// A film that takes a share of the light and has no interface.
pub(crate) fn tint(share: f32) -> Material {
    Material { base_color: Vec4::new(share, share, share, 1.0), ior: 1.0, ..pane() }
}
