//! Materials of the file into those of the scene.

use glam::{Affine2, Mat2, Vec2, Vec3, Vec4};
use gltf::json;
use gltf::json::extensions::material::Volume;
use gltf::json::extensions::texture::TextureTransform;
use gltf::json::texture::Info;
use gltf::json::validation::Checked;
use serde::Deserialize;

use super::document::{SpecularGlossiness, called, plain_use};
use super::report::Notes;
use crate::scene::{AlphaMode, Encoding, Material, TextureRef};

/// Reflectance at normal incidence is ((ior − 1) / (ior + 1))² · specular color; this makes the first factor 0.996.
const FULLY_REFLECTING_IOR: f32 = 1000.0;

/// A texture that a material uses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct UsedTexture {
    /// Index in the file.
    pub index: usize,
    /// What its alpha is multiplied by where that is glossiness: its G channel is to be the roughness.
    pub glossiness: Option<f32>,
}

/// Converts materials; textures get an index when a material first uses them.
pub(super) struct Converter<'a> {
    pub document: &'a json::Root,
    pub notes: &'a mut Notes,
    /// Each texture of the scene.
    pub textures: Vec<UsedTexture>,
}

impl Converter<'_> {
    /// A material of the file, or the default one if there is none of that index.
    pub fn convert(&mut self, index: usize) -> Material {
        let Some(source) = self.document.materials.get(index) else {
            self.notes.warn(format!("material {index} does not exist: the default material is shown"));
            return Material::default();
        };
        let name = called("material", index, source.name.as_ref());
        let mut material = Material { name: source.name.clone().unwrap_or_default(), ..Material::default() };
        self.core(&mut material, source, &name);
        self.extensions(&mut material, source, &name);
        if !material.emitted_radiance().is_finite() {
            let (color, strength) = (material.emissive, material.emissive_strength);
            let words =
                format!("{name}: its emission {color} times strength {strength} is out of range: it is left out");
            self.notes.warn(words);
            material.emissive = Vec3::ZERO;
        }
        material
    }

    fn core(&mut self, material: &mut Material, source: &json::Material, name: &str) {
        let pbr = &source.pbr_metallic_roughness;
        let base_color = pbr.base_color_factor.0;
        material.base_color = Vec4::from(self.unit_factors(base_color, 1.0, name, "base color"));
        material.base_color_texture = self.texture(pbr.base_color_texture.as_ref(), Encoding::Srgb, name);
        material.metallic = self.unit_factor(pbr.metallic_factor.0, 1.0, name, "metallic factor");
        material.roughness = self.unit_factor(pbr.roughness_factor.0, 1.0, name, "roughness factor");
        material.metallic_roughness_texture =
            self.texture(pbr.metallic_roughness_texture.as_ref(), Encoding::Linear, name);
        material.normal_texture =
            self.texture(source.normal_texture.as_ref().map(plain_use).as_ref(), Encoding::Linear, name);
        material.normal_scale = source.normal_texture.as_ref().map_or(1.0, |info| info.scale);
        let emissive = source.emissive_factor.0;
        material.emissive = Vec3::from(self.positive_factors(emissive, 0.0, name, "emissive factor"));
        material.emissive_texture = self.texture(source.emissive_texture.as_ref(), Encoding::Srgb, name);
        material.double_sided = source.double_sided;
        material.alpha = match source.alpha_mode {
            Checked::Valid(json::material::AlphaMode::Opaque) => AlphaMode::Opaque,
            Checked::Valid(json::material::AlphaMode::Mask) => {
                AlphaMode::Mask { cutoff: source.alpha_cutoff.unwrap_or_default().0 }
            }
            Checked::Valid(json::material::AlphaMode::Blend) => AlphaMode::Blend,
            Checked::Invalid => {
                self.notes.warn(format!("{name}: its alpha mode is not known: it is shown opaque"));
                AlphaMode::Opaque
            }
        };
    }

    fn extensions(&mut self, material: &mut Material, source: &json::Material, name: &str) {
        let Some(extensions) = &source.extensions else { return };
        material.unlit = extensions.unlit.is_some();
        if let Some(json::extensions::material::EmissiveStrength { emissive_strength }) = &extensions.emissive_strength
        {
            [material.emissive_strength] = self.positive_factors([emissive_strength.0], 1.0, name, "emissive strength");
        }
        if let Some(ior) = &extensions.ior {
            material.ior = self.ior(ior.ior.0, name);
        }
        if let Some(transmission) = &extensions.transmission {
            let factor = transmission.transmission_factor.0;
            material.transmission = self.unit_factor(factor, 0.0, name, "transmission factor");
            material.transmission_texture =
                self.texture(transmission.transmission_texture.as_ref(), Encoding::Linear, name);
        }
        if let Some(specular) = &extensions.specular {
            material.specular = self.unit_factor(specular.specular_factor.0, 1.0, name, "specular factor");
            material.specular_texture = self.texture(specular.specular_texture.as_ref(), Encoding::Linear, name);
            let color = specular.specular_color_factor.0;
            material.specular_color = Vec3::from(self.positive_factors(color, 1.0, name, "specular color"));
            material.specular_color_texture =
                self.texture(specular.specular_color_texture.as_ref(), Encoding::Srgb, name);
        }
        if let Some(volume) = &extensions.volume {
            self.volume(material, volume, name);
        }
        match extensions.others.get("KHR_materials_pbrSpecularGlossiness").map(SpecularGlossiness::deserialize) {
            Some(Ok(old)) => self.specular_glossiness(material, &old, name),
            Some(Err(error)) => {
                self.notes.warn(format!("{name}: its specular-glossiness cannot be read ({error}): it is ignored"));
            }
            None => {}
        }
        material.finish = self.finish(&extensions.others, name);
    }

    /// At least 1, but for glTF's 0, which stands for a reflectance of 1 at every angle.
    fn ior(&mut self, ior: f32, name: &str) -> f32 {
        if ior == 0.0 { FULLY_REFLECTING_IOR } else { self.index_of_refraction(ior, name) }
    }

    /// At least 1; what is not is reported.
    pub(super) fn index_of_refraction(&mut self, ior: f32, name: &str) -> f32 {
        let sane = if ior.is_finite() { ior.max(1.0) } else { 1.5 };
        if sane != ior {
            self.notes.warn(format!("{name}: its index of refraction {ior} is out of range: {sane} is used"));
        }
        sane
    }

    fn volume(&mut self, material: &mut Material, volume: &Volume, name: &str) {
        [material.thickness] = self.positive_factors([volume.thickness_factor.0], 0.0, name, "thickness factor");
        let color = volume.attenuation_color.0;
        material.attenuation_color = Vec3::from(self.unit_factors(color, 1.0, name, "attenuation color"));
        material.attenuation_distance = match volume.attenuation_distance.0 {
            distance if distance > 0.0 => distance,
            distance => {
                let words = format!("its attenuation distance {distance} is out of range: nothing is attenuated");
                self.notes.warn(format!("{name}: {words}"));
                f32::INFINITY
            }
        };
        if volume.thickness_texture.is_some() && material.thickness > 0.0 {
            self.notes.unsupported(format!("{name}: its thickness texture is ignored, as the shape itself is traced"));
        }
    }

    /// Specular color at normal incidence stands in for the metal: a dielectric with that reflection.
    fn specular_glossiness(&mut self, material: &mut Material, old: &SpecularGlossiness, name: &str) {
        let diffuse = old.diffuse_factor.unwrap_or([1.0; 4]);
        material.base_color = Vec4::from(self.unit_factors(diffuse, 1.0, name, "diffuse factor"));
        material.base_color_texture = self.texture(old.diffuse_texture.as_ref(), Encoding::Srgb, name);
        let glossiness = self.unit_factor(old.glossiness_factor.unwrap_or(1.0), 1.0, name, "glossiness factor");
        let map = old.specular_glossiness_texture.as_ref();
        material.metallic_roughness_texture = self.used_texture(map, Encoding::Linear, Some(glossiness), name);
        material.roughness = if material.metallic_roughness_texture.is_some() { 1.0 } else { 1.0 - glossiness };
        material.metallic = 0.0;
        let specular =
            Vec3::from(self.unit_factors(old.specular_factor.unwrap_or([1.0; 3]), 1.0, name, "specular factor"));
        material.ior = FULLY_REFLECTING_IOR;
        material.specular_color = specular;
        material.specular_color_texture = self.texture(map, Encoding::Srgb, name);
        self.notes
            .unsupported(format!("{name}: specular-glossiness is approximated by roughness and a specular color"));
    }

    /// A use of a texture; its index in the scene is made up on first use.
    pub(super) fn texture(&mut self, info: Option<&Info>, encoding: Encoding, name: &str) -> Option<TextureRef> {
        self.used_texture(info, encoding, None, name)
    }

    /// The same of one whose alpha may be glossiness.
    #[expect(clippy::cast_possible_truncation, reason = "no more textures than bytes of the file, at most 2³²")]
    fn used_texture(
        &mut self,
        info: Option<&Info>,
        encoding: Encoding,
        glossiness: Option<f32>,
        name: &str,
    ) -> Option<TextureRef> {
        let info = info?;
        let index = info.index.value();
        if index >= self.document.textures.len() {
            self.notes.warn(format!("{name}: texture {index} does not exist: it is left out"));
            return None;
        }
        let transform = info.extensions.as_ref().and_then(|extensions| extensions.texture_transform.as_ref());
        let uv_set = transform.and_then(|transform| transform.tex_coord).unwrap_or(info.tex_coord);
        if uv_set > 1 {
            self.notes.unsupported(format!("{name}: a texture uses coordinate set {uv_set}, set 0 is shown instead"));
        }
        let used = UsedTexture { index, glossiness };
        let known = self.textures.iter().position(|&texture| texture == used);
        let n_known = self.textures.len();
        let texture = known.unwrap_or_else(|| {
            self.textures.push(used);
            n_known
        });
        Some(TextureRef {
            texture: texture as u32,
            uv_set: if uv_set == 1 { 1 } else { 0 },
            transform: transform.map_or(Affine2::IDENTITY, uv_transform),
            encoding,
        })
    }

    pub(super) fn unit_factor(&mut self, value: f32, fallback: f32, name: &str, what: &str) -> f32 {
        let [value] = self.unit_factors([value], fallback, name, what);
        value
    }

    pub(super) fn unit_factors<const N: usize>(
        &mut self,
        values: [f32; N],
        fallback: f32,
        name: &str,
        what: &str,
    ) -> [f32; N] {
        self.factors(values, 1.0, fallback, name, what)
    }

    pub(super) fn positive_factors<const N: usize>(
        &mut self,
        values: [f32; N],
        fallback: f32,
        name: &str,
        what: &str,
    ) -> [f32; N] {
        self.factors(values, f32::MAX, fallback, name, what)
    }

    /// Values within 0 … `most`; what is not a number becomes `fallback`. Both are reported.
    fn factors<const N: usize>(
        &mut self,
        values: [f32; N],
        most: f32,
        fallback: f32,
        name: &str,
        what: &str,
    ) -> [f32; N] {
        let sane = values.map(|value| if value.is_finite() { value.clamp(0.0, most) } else { fallback });
        if sane != values {
            self.notes.warn(format!("{name}: its {what} {values:?} is out of range: {sane:?} is used"));
        }
        sane
    }
}

/// `translation · rotation · scale` of KHR_texture_transform; its rotation is clockwise on a v that points down.
fn uv_transform(transform: &TextureTransform) -> Affine2 {
    let rotation = transform.rotation.0;
    let (sin, cos) = rotation.sin_cos();
    let rotation = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
    let scale = Mat2::from_diagonal(Vec2::from(transform.scale.0));
    let affine = Affine2::from_mat2_translation(rotation * scale, Vec2::from(transform.offset.0));
    if affine.is_finite() { affine } else { Affine2::IDENTITY }
}
