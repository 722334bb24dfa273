//! What the layered extensions of glTF add to a material.

use glam::{Affine2, Vec3};

use super::{Encoding, TextureRef};

/// Clear coat, sheen, anisotropy, iridescence and diffuse transmission of a material. Factors are linear; textures are
/// multiplied with the factor before them.
#[derive(Clone, Debug, PartialEq)]
pub struct Finish {
    /// KHR_materials_clearcoat strength, 0…1.
    pub clearcoat: f32,
    /// R channel times `clearcoat`.
    pub clearcoat_texture: Option<TextureRef>,
    /// Perceptual roughness of the coat, 0…1.
    pub clearcoat_roughness: f32,
    /// G channel times `clearcoat_roughness`.
    pub clearcoat_roughness_texture: Option<TextureRef>,
    /// Tangent-space normal map of the coat; without one the coat is as smooth as the mesh.
    pub clearcoat_normal_texture: Option<TextureRef>,
    /// Scales x and y of that map.
    pub clearcoat_normal_scale: f32,
    /// KHR_materials_sheen color, linear RGB.
    pub sheen_color: Vec3,
    /// sRGB texture times `sheen_color`.
    pub sheen_color_texture: Option<TextureRef>,
    /// Perceptual roughness of the sheen, 0…1.
    pub sheen_roughness: f32,
    /// A channel times `sheen_roughness`.
    pub sheen_roughness_texture: Option<TextureRef>,
    /// KHR_materials_anisotropy strength, 0…1.
    pub anisotropy: f32,
    /// Direction of more roughness, radians counter-clockwise from the tangent.
    pub anisotropy_rotation_rad: f32,
    /// RG direction from −1 to 1, B times `anisotropy`.
    pub anisotropy_texture: Option<TextureRef>,
    /// KHR_materials_iridescence strength, 0…1.
    pub iridescence: f32,
    /// R channel times `iridescence`.
    pub iridescence_texture: Option<TextureRef>,
    /// Index of refraction of the thin film, at least 1.
    pub film_ior: f32,
    /// Least and greatest thickness of the film in nanometers.
    pub film_thickness_nm: [f32; 2],
    /// G channel between the two; without it the film has its greatest thickness.
    pub film_thickness_texture: Option<TextureRef>,
    /// KHR_materials_diffuse_transmission share, 0…1.
    pub diffuse_transmission: f32,
    /// A channel times `diffuse_transmission`.
    pub diffuse_transmission_texture: Option<TextureRef>,
    /// Color of what goes through, linear RGB.
    pub diffuse_transmission_color: Vec3,
    /// sRGB texture times `diffuse_transmission_color`.
    pub diffuse_transmission_color_texture: Option<TextureRef>,
}

impl Default for Finish {
    /// The extensions' own defaults: nothing is added.
    fn default() -> Self {
        Finish {
            clearcoat: 0.0,
            clearcoat_texture: None,
            clearcoat_roughness: 0.0,
            clearcoat_roughness_texture: None,
            clearcoat_normal_texture: None,
            clearcoat_normal_scale: 1.0,
            sheen_color: Vec3::ZERO,
            sheen_color_texture: None,
            sheen_roughness: 0.0,
            sheen_roughness_texture: None,
            anisotropy: 0.0,
            anisotropy_rotation_rad: 0.0,
            anisotropy_texture: None,
            iridescence: 0.0,
            iridescence_texture: None,
            film_ior: 1.3,
            film_thickness_nm: [100.0, 400.0],
            film_thickness_texture: None,
            diffuse_transmission: 0.0,
            diffuse_transmission_texture: None,
            diffuse_transmission_color: Vec3::ONE,
            diffuse_transmission_color_texture: None,
        }
    }
}

impl Finish {
    /// The texture whose coordinates tangents follow: of the coat's normal map or of the anisotropy, which without one
    /// goes by the first set. `None` where no tangents are needed.
    pub fn tangent_map(&self) -> Option<TextureRef> {
        let first_set = TextureRef { texture: 0, uv_set: 0, transform: Affine2::IDENTITY, encoding: Encoding::Linear };
        let stretched = (self.anisotropy > 0.0).then(|| self.anisotropy_texture.unwrap_or(first_set));
        self.clearcoat_normal_texture.filter(|_| self.clearcoat > 0.0).or(stretched)
    }

    /// Whether anything can be seen of it.
    pub fn is_visible(&self) -> bool {
        self.clearcoat > 0.0
            || self.sheen_color.max_element() > 0.0
            || self.anisotropy > 0.0
            || self.iridescence > 0.0
            || self.diffuse_transmission > 0.0
    }
}
