//! What a path tracer needs of a scene: triangles in world space, materials, textures, lamps, cameras.
//!
//! Node transforms are already applied: one flat mesh, meters, +Y up, counter-clockwise front faces (a mirrored node has
//! had its triangles turned round).

mod bodies;
mod finish;
mod slots;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::{Affine2, Vec2, Vec3, Vec4};

use crate::camera::Camera;
use crate::light::PanelSpot;
use crate::photometry::PhotometricProfile;
use crate::sensors::SensorGrid;

pub use self::finish::Finish;

/// A scene in world space.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Name of the file, for people.
    pub name: String,
    /// Every triangle of every node.
    pub mesh: Mesh,
    /// Materials; index 0 is glTF's default material when a primitive names none.
    pub materials: Vec<Material>,
    /// Decoded images with their samplers.
    pub textures: Vec<Texture>,
    /// Nodes of the displayed scene in file order, as far as they carry something.
    pub nodes: Vec<SceneNode>,
    /// Nodes of the displayed scene in file order that others stand below.
    pub ancestors: Vec<Ancestor>,
    /// Cameras in node order; a sensible one is made where the file has none.
    pub cameras: Vec<Camera>,
    /// Punctual lamps in node order.
    pub punctual: Vec<PunctualLight>,
    /// Measured distributions that lamps refer to.
    pub profiles: Vec<PhotometricProfile>,
    /// Grids that nodes of the file ask for, `{"clerestory": {"sensors": [16, 8]}}`. Such a node exists as sensor only: it is
    /// not in the mesh, so that it neither blocks nor scatters light, nor shines.
    pub sensors: Vec<SensorGrid>,
    /// Spots of light that nodes of the file mark on their panels, by index into `nodes`.
    pub spots: BTreeMap<u32, Vec<PanelSpot>>,
    /// Nodes, by index into `nodes`, whose lamp is off in the file. It stands here as it is when it is on.
    pub muted_lamps: BTreeSet<u32>,
    /// Nodes, by index into `nodes`, whose measured distribution cannot be had and that have no plain lamp: what shines there instead has
    /// candela of ours, whatever the file counts in.
    pub substitute_lamps: BTreeSet<u32>,
    /// Nodes, by index into `nodes`, whose surfaces are off in the file.
    pub muted_surfaces: BTreeSet<u32>,
    /// Materials, by index, whose map of what they emit is black all over. They are no light, and yet their nodes count where
    /// repeats of a name are numbered.
    pub dark_materials: BTreeSet<u32>,
    /// Images of the file that were not decoded, as nothing samples them.
    pub idle_images: u32,
    /// Bytes of their texels, of those whose size was at hand.
    pub idle_bytes: u64,
}

impl Scene {
    /// Names of the nodes above one, the outermost first; of more than 64 the nearest. `node:INDEX` of those without a name.
    pub fn names_above(&self, node: &SceneNode) -> Vec<String> {
        let ancestor = |idx: u32| self.ancestors.get(idx as usize);
        let above = std::iter::successors(node.parent.and_then(ancestor), |above| above.parent.and_then(ancestor));
        let mut names: Vec<String> = above.take(MOST_ABOVE).map(Ancestor::key).collect();
        names.reverse();
        names
    }

    /// Makes all materials scatter light so.
    pub fn set_facet_scattering(&mut self, scattering: FacetScattering) {
        self.materials.iter_mut().for_each(|material| material.facet_scattering = scattering);
    }

    /// Gives all directional lamps the look of a disk, `radius_rad` from its middle to its rim; they send as much light as before
    /// to what faces them. Returns how many there are.
    pub fn set_sun_radius(&mut self, radius_rad: f32) -> usize {
        let suns = self.punctual.iter_mut().filter(|light| light.kind == PunctualKind::Directional);
        suns.map(|light| light.radius_rad = radius_rad).count()
    }

    /// How its materials scatter light: the default without materials.
    pub fn facet_scattering(&self) -> FacetScattering {
        self.materials.first().map(|material| material.facet_scattering).unwrap_or_default()
    }
}

/// Nodes above another one that are told: a file can chain as many as it has.
const MOST_ABOVE: usize = 64;

/// A node of the file that others stand below.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ancestor {
    /// Index of the node in the file.
    pub index: u32,
    /// Name in the file, if it has one.
    pub name: Option<String>,
    /// Index into `Scene::ancestors` of the node above it.
    pub parent: Option<u32>,
}

impl Ancestor {
    fn key(&self) -> String {
        self.name.clone().unwrap_or_else(|| index_key(self.index))
    }
}

/// A node of the file that carries a mesh, a lamp or a camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneNode {
    /// Index of the node in the file.
    pub index: u32,
    /// Name in the file, if it has one.
    pub name: Option<String>,
    /// Side in texels of the panel that the node's extras ask for: `{"clerestory": {"panel": 32}}`.
    pub panel: Option<u32>,
    /// Index into `Scene::ancestors` of the node above it.
    pub parent: Option<u32>,
    /// Name of its mesh, the same for all nodes that show it: unnamed ones are `mesh:INDEX`.
    pub mesh: Option<String>,
    /// Name of the lamp of the file that it is an instance of: unnamed ones are `lamp:INDEX`.
    pub lamp: Option<String>,
}

impl SceneNode {
    /// The name by which a node is asked for: its own, or `node:INDEX`.
    pub fn key(&self) -> String {
        self.name.clone().unwrap_or_else(|| index_key(self.index))
    }

    /// Whether a node is meant, by its name or by its index.
    pub fn is_named(&self, name: &str) -> bool {
        self.name.as_deref() == Some(name) || name == self.index_key()
    }

    /// The name that no other node of the file has: `node:INDEX`.
    pub fn index_key(&self) -> String {
        index_key(self.index)
    }
}

/// What a node without a name is called.
fn index_key(index: u32) -> String {
    format!("node:{index}")
}

/// Triangles with their vertex attributes; all attribute arrays are as long as `positions`.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// World-space positions in meters.
    pub positions: Vec<Vec3>,
    /// Unit shading normals.
    pub normals: Vec<Vec3>,
    /// Unit tangents, `w` the sign of the bitangent; empty when no material of the scene needs them.
    pub tangents: Vec<Vec4>,
    /// Two UV sets, each empty when no vertex has it.
    pub uvs: [Vec<Vec2>; 2],
    /// Linear vertex colors; empty when no vertex has one.
    pub colors: Vec<Vec4>,
    /// Vertex indices of each triangle, counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
    /// Material of each triangle.
    pub triangle_material: Vec<u32>,
    /// Index into `Scene::nodes` of each triangle.
    pub triangle_node: Vec<u32>,
}

impl Mesh {
    /// The three corners of a triangle in world space.
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }

    /// What the same for corners that lie in the same place to the last bit, however often their vertex is there.
    pub(crate) fn place(position: Vec3) -> [u32; 3] {
        // Plus zero, so that there is but one zero.
        (position + Vec3::ZERO).to_array().map(f32::to_bits)
    }

    /// Twice the area times the unit geometric normal of a triangle, m².
    pub fn area_normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(c - a)
    }

    /// Area of a triangle, m².
    pub fn area_m2(&self, triangle: u32) -> f32 {
        0.5 * self.area_normal(triangle).length()
    }

    /// Smallest box around all vertices that a triangle uses, `None` without triangles.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let mut corners = self.triangles.iter().flatten().map(|&v| self.positions[v as usize]);
        let first = corners.next()?;
        Some(corners.fold((first, first), |(lo, hi), p| (lo.min(p), hi.max(p))))
    }
}

/// Coverage of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored.
    #[default]
    Opaque,
    /// There where alpha reaches the cutoff, else not there.
    Mask {
        /// Smallest alpha that is there.
        cutoff: f32,
    },
    /// There with probability alpha.
    Blend,
}

/// How often the light that a rough surface scatters may meet its facets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FacetScattering {
    /// Once: what other facets then stop is lost, as in the formulas of glTF's appendix B.
    Single,
    /// As often as it does: rough metal and glass that absorb nothing lose nothing. \[Turquin2019\]
    #[default]
    Multiple,
}

/// glTF 2.0 material with the extensions that are supported. Factors are linear.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name in the file.
    pub name: String,
    /// Base color factor, linear RGB and alpha.
    pub base_color: Vec4,
    /// sRGB texture times `base_color`.
    pub base_color_texture: Option<TextureRef>,
    /// 0 dielectric … 1 metal.
    pub metallic: f32,
    /// Perceptual roughness; α = roughness².
    pub roughness: f32,
    /// G roughness, B metallic.
    pub metallic_roughness_texture: Option<TextureRef>,
    /// Tangent-space normal map.
    pub normal_texture: Option<TextureRef>,
    /// Scales x and y of the normal map.
    pub normal_scale: f32,
    /// Emissive factor, linear RGB (at most 1 in plain glTF).
    pub emissive: Vec3,
    /// KHR_materials_emissive_strength; radiance in nit is `emissive · emissive_strength · texture`.
    pub emissive_strength: f32,
    /// sRGB texture times the emissive factor.
    pub emissive_texture: Option<TextureRef>,
    /// Coverage.
    pub alpha: AlphaMode,
    /// Seen, and emitting, from both sides.
    pub double_sided: bool,
    /// KHR_materials_unlit: shows its base color whatever the lights do.
    pub unlit: bool,
    /// KHR_materials_transmission factor.
    pub transmission: f32,
    /// R channel times `transmission`.
    pub transmission_texture: Option<TextureRef>,
    /// Index of refraction.
    pub ior: f32,
    /// KHR_materials_specular strength.
    pub specular: f32,
    /// A channel times `specular`.
    pub specular_texture: Option<TextureRef>,
    /// Color of the dielectric reflection at normal incidence.
    pub specular_color: Vec3,
    /// sRGB texture times `specular_color`.
    pub specular_color_texture: Option<TextureRef>,
    /// KHR_materials_volume thickness in meters; 0 is a thin wall that does not bend light, more is a solid that does.
    pub thickness: f32,
    /// Color that white light takes after `attenuation_distance`.
    pub attenuation_color: Vec3,
    /// Meters; infinite without attenuation.
    pub attenuation_distance: f32,
    /// Clear coat, sheen, anisotropy, iridescence and diffuse transmission, where there is any.
    pub finish: Option<Box<Finish>>,
    /// How rough metal and rough glass scatter.
    pub facet_scattering: FacetScattering,
}

impl Default for Material {
    /// glTF's default material.
    fn default() -> Self {
        Material {
            name: String::new(),
            base_color: Vec4::ONE,
            base_color_texture: None,
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            emissive: Vec3::ZERO,
            emissive_strength: 1.0,
            emissive_texture: None,
            alpha: AlphaMode::Opaque,
            double_sided: false,
            unlit: false,
            transmission: 0.0,
            transmission_texture: None,
            ior: 1.5,
            specular: 1.0,
            specular_texture: None,
            specular_color: Vec3::ONE,
            specular_color_texture: None,
            thickness: 0.0,
            attenuation_color: Vec3::ONE,
            attenuation_distance: f32::INFINITY,
            finish: None,
            facet_scattering: FacetScattering::default(),
        }
    }
}

impl Material {
    /// Emitted radiance without texture, nit per channel.
    pub fn emitted_radiance(&self) -> Vec3 {
        self.emissive * self.emissive_strength
    }

    /// Whether the surface emits light that a designer can change. Unlit surfaces do not: they show themselves.
    pub fn is_emitter(&self) -> bool {
        !self.unlit && self.emitted_radiance().max_element() > 0.0
    }

    /// Whether light that the surface lets pass goes straight on whatever its textures say: smooth glass without
    /// thickness, or without an interface. Shadow rays pass it as walks do.
    pub fn is_clear_pane(&self) -> bool {
        self.is_clear_by(|| self.roughness)
    }

    /// The same where its textures leave it that rough.
    pub(crate) fn is_clear_by(&self, roughness: impl FnOnce() -> f32) -> bool {
        if self.unlit || self.transmission <= 0.0 {
            return false;
        }
        if crate::bsdf::is_matched(self.ior) {
            return self.thickness == 0.0 || self.attenuation_distance.is_infinite();
        }
        self.thickness == 0.0 && !self.is_stretched() && crate::bsdf::is_mirror(roughness())
    }

    /// Whether light goes on behind the surface, clear or scattered.
    pub(crate) fn transmits(&self) -> bool {
        self.transmission > 0.0 || self.finish.as_ref().is_some_and(|finish| finish.diffuse_transmission > 0.0)
    }

    /// Whether its reflection is longer one way than the other: then it is never perfectly smooth.
    pub(crate) fn is_stretched(&self) -> bool {
        self.finish.as_ref().is_some_and(|finish| finish.anisotropy > 0.0)
    }

    /// Whether the surface may gather or throw on the light of a lamp as a mirror or a clear body does. Light that goes straight through
    /// clear panes is none of that.
    pub fn casts_caustics(&self) -> bool {
        self.turns_light() && crate::bsdf::is_mirror(self.roughness)
    }

    /// Whether the surface mirrors a part of the light of a lamp onto others as a pane of glass or a smooth coat does, by its factors. What
    /// casts caustics is none of that.
    pub fn mirrors_a_part(&self) -> bool {
        let is_smooth = !self.is_stretched() && crate::bsdf::is_mirror(self.roughness);
        let has_smooth_lacquer =
            |finish: &Finish| finish.clearcoat > 0.0 && crate::bsdf::is_mirror(finish.clearcoat_roughness);
        let is_lacquered = self.finish.as_deref().is_some_and(has_smooth_lacquer);
        !self.unlit && !self.casts_caustics() && (is_smooth && self.has_coat() || is_lacquered)
    }

    /// Whether there is an interface on its base that reflects.
    fn has_coat(&self) -> bool {
        self.specular > 0.0 && !crate::bsdf::is_matched(self.ior)
    }

    /// Whether metal or glass of the surface sends light another way than it came.
    pub(crate) fn turns_light(&self) -> bool {
        !self.unlit && (self.metallic > 0.5 || (self.transmission > 0.0 && !self.is_clear_pane()))
    }

    /// Whether the surface is diffuse and nothing else, whatever its textures say.
    pub fn is_plainly_diffuse(&self) -> bool {
        !self.unlit && self.metallic <= 0.0 && self.transmission <= 0.0 && !self.has_coat() && self.finish.is_none()
    }

    /// Whether light that other surfaces send here leaves again by a diffuse base alone, or not at all.
    pub(crate) fn is_matte(&self) -> bool {
        self.unlit || self.is_plainly_diffuse()
    }

    /// The texture whose coordinates tangents follow, `None` where the material needs none.
    pub fn tangent_map(&self) -> Option<TextureRef> {
        self.normal_texture.or_else(|| self.finish.as_ref().and_then(|finish| finish.tangent_map()))
    }
}

/// How the bytes of a texture are to be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// sRGB-encoded color.
    Srgb,
    /// Linear data.
    Linear,
}

/// A use of a texture by a material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureRef {
    /// Index into `Scene::textures`.
    pub texture: u32,
    /// UV set 0 or 1.
    pub uv_set: u8,
    /// KHR_texture_transform, applied to the UV.
    pub transform: Affine2,
    /// How to read its bytes.
    pub encoding: Encoding,
}

/// What happens outside 0…1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// Tiles.
    #[default]
    Repeat,
    /// Tiles, every other one mirrored.
    Mirror,
    /// Border texels go on.
    Clamp,
}

/// How texels are joined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filter {
    /// Bilinear.
    #[default]
    Linear,
    /// The nearest texel.
    Nearest,
}

/// An image with its sampler.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// The pixels, shared between textures that use the same image.
    pub image: Arc<Image>,
    /// Wrap modes along u and v.
    pub wrap: [Wrap; 2],
    /// Magnification filter.
    pub filter: Filter,
}

/// Decoded pixels, 8 bits per channel, RGBA, row 0 at the top (v = 0).
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width in texels, at least 1.
    pub width: u32,
    /// Height in texels, at least 1.
    pub height: u32,
    /// Row-major, width × height.
    pub texels: Vec<[u8; 4]>,
}

/// Which way a punctual lamp shines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PunctualKind {
    /// All around; intensity in candela.
    Point,
    /// A cone; intensity in candela inside the inner angle, glTF's `saturate(cosθ · scale + offset)²` towards the outer.
    Spot {
        /// Half angle of the full intensity, radians.
        inner_rad: f32,
        /// Half angle where the light ends, radians.
        outer_rad: f32,
    },
    /// From infinitely far away; intensity in lux.
    Directional,
}

/// A lamp of KHR_lights_punctual or EXT_lights_ies at its node.
#[derive(Clone, Debug, PartialEq)]
pub struct PunctualLight {
    /// Index into `Scene::nodes`.
    pub node: u32,
    /// Kind, with its angles.
    pub kind: PunctualKind,
    /// World-space position.
    pub position: Vec3,
    /// World-space unit direction in which it shines (the node's −Z).
    pub direction: Vec3,
    /// World-space unit directions of the node's +X and +Y, across `direction`.
    pub across: [Vec3; 2],
    /// Index into `Scene::profiles` of the distribution that stands in for the kind's own.
    pub profile: Option<u32>,
    /// Linear RGB.
    pub color: Vec3,
    /// Candela (with a profile: its largest), or lux for a directional lamp.
    pub intensity: f32,
    /// Half of the angle under which a directional lamp is seen, radians; 0 for shadows without penumbra.
    pub radius_rad: f32,
}
