//! Clear coat, sheen, anisotropy, iridescence and diffuse transmission, which `gltf::json` leaves as plain JSON.

use glam::Vec3;
use gltf::json::material::NormalTexture;
use gltf::json::texture::Info;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use super::document::plain_use;
use super::material::Converter;
use super::missing::called;
use super::report::Notes;
use crate::scene::{Encoding, Finish, Material, TextureRef};

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Clearcoat {
    clearcoat_factor: f32,
    clearcoat_texture: Option<Info>,
    clearcoat_roughness_factor: f32,
    clearcoat_roughness_texture: Option<Info>,
    clearcoat_normal_texture: Option<NormalTexture>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Sheen {
    sheen_color_factor: [f32; 3],
    sheen_color_texture: Option<Info>,
    sheen_roughness_factor: f32,
    sheen_roughness_texture: Option<Info>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Anisotropy {
    anisotropy_strength: f32,
    anisotropy_rotation: f32,
    anisotropy_texture: Option<Info>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Iridescence {
    iridescence_factor: f32,
    iridescence_texture: Option<Info>,
    iridescence_ior: Option<f32>,
    iridescence_thickness_minimum: Option<f32>,
    iridescence_thickness_maximum: Option<f32>,
    iridescence_thickness_texture: Option<Info>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct DiffuseTransmission {
    diffuse_transmission_factor: f32,
    diffuse_transmission_texture: Option<Info>,
    diffuse_transmission_color_factor: Option<[f32; 3]>,
    diffuse_transmission_color_texture: Option<Info>,
}

/// Tells where layers differ from what their extensions say.
pub(super) fn note_layers(materials: &[Material], notes: &mut Notes) {
    for material in materials {
        let Some(finish) = material.finish.as_ref().filter(|finish| finish.clearcoat > 0.0) else { continue };
        if material.is_emitter() {
            notes.unsupported(format!("{}: what shines below its clear coat is not dimmed by it", called(material)));
        }
        if finish.sheen_color != Vec3::ZERO {
            notes.unsupported(format!(
                "{}: its clear coat and sheen differ from their extensions at grazing angles, so that no light is made",
                called(material)
            ));
        }
    }
}

impl Converter<'_> {
    /// What the layered extensions add, `None` where nothing can be seen of them.
    pub(super) fn finish(&mut self, extensions: &Map<String, Value>, name: &str) -> Option<Box<Finish>> {
        let mut finish = Finish::default();
        if let Some(source) = self.read(extensions, "KHR_materials_clearcoat", name) {
            self.clearcoat(&mut finish, &source, name);
        }
        if let Some(source) = self.read(extensions, "KHR_materials_sheen", name) {
            self.sheen(&mut finish, &source, name);
        }
        if let Some(source) = self.read(extensions, "KHR_materials_anisotropy", name) {
            self.anisotropy(&mut finish, &source, name);
        }
        if let Some(source) = self.read(extensions, "KHR_materials_iridescence", name) {
            self.iridescence(&mut finish, &source, name);
        }
        if let Some(source) = self.read(extensions, "KHR_materials_diffuse_transmission", name) {
            self.diffuse_transmission(&mut finish, &source, name);
        }
        finish.is_visible().then(|| Box::new(finish))
    }

    fn read<T: DeserializeOwned>(&mut self, extensions: &Map<String, Value>, key: &str, name: &str) -> Option<T> {
        match T::deserialize(extensions.get(key)?) {
            Ok(source) => Some(source),
            Err(error) => {
                self.notes.warn(format!("{name}: its {key} cannot be read ({error}): it is ignored"));
                None
            }
        }
    }

    fn clearcoat(&mut self, finish: &mut Finish, source: &Clearcoat, name: &str) {
        finish.clearcoat = self.unit_factor(source.clearcoat_factor, 0.0, name, "clear coat factor");
        if finish.clearcoat <= 0.0 {
            return;
        }
        finish.clearcoat_texture = self.linear(source.clearcoat_texture.as_ref(), name);
        finish.clearcoat_roughness =
            self.unit_factor(source.clearcoat_roughness_factor, 0.0, name, "clear coat roughness");
        finish.clearcoat_roughness_texture = self.linear(source.clearcoat_roughness_texture.as_ref(), name);
        let normals = source.clearcoat_normal_texture.as_ref();
        finish.clearcoat_normal_texture = self.linear(normals.map(plain_use).as_ref(), name);
        finish.clearcoat_normal_scale = normals.map_or(1.0, |normals| normals.scale);
    }

    fn sheen(&mut self, finish: &mut Finish, source: &Sheen, name: &str) {
        finish.sheen_color = Vec3::from(self.unit_factors(source.sheen_color_factor, 0.0, name, "sheen color"));
        if finish.sheen_color == Vec3::ZERO {
            return;
        }
        finish.sheen_color_texture = self.texture(source.sheen_color_texture.as_ref(), Encoding::Srgb, name);
        finish.sheen_roughness = self.unit_factor(source.sheen_roughness_factor, 0.0, name, "sheen roughness");
        finish.sheen_roughness_texture = self.linear(source.sheen_roughness_texture.as_ref(), name);
    }

    fn anisotropy(&mut self, finish: &mut Finish, source: &Anisotropy, name: &str) {
        finish.anisotropy = self.unit_factor(source.anisotropy_strength, 0.0, name, "anisotropy strength");
        if finish.anisotropy <= 0.0 {
            return;
        }
        let rotation = source.anisotropy_rotation;
        finish.anisotropy_rotation_rad = if rotation.is_finite() { rotation } else { 0.0 };
        finish.anisotropy_texture = self.linear(source.anisotropy_texture.as_ref(), name);
    }

    fn iridescence(&mut self, finish: &mut Finish, source: &Iridescence, name: &str) {
        finish.iridescence = self.unit_factor(source.iridescence_factor, 0.0, name, "iridescence factor");
        if finish.iridescence <= 0.0 {
            return;
        }
        let plain = Finish::default();
        finish.iridescence_texture = self.linear(source.iridescence_texture.as_ref(), name);
        finish.film_ior = self.index_of_refraction(source.iridescence_ior.unwrap_or(plain.film_ior), name);
        let least = source.iridescence_thickness_minimum.unwrap_or(plain.film_thickness_nm[0]);
        let most = source.iridescence_thickness_maximum.unwrap_or(plain.film_thickness_nm[1]);
        finish.film_thickness_nm = self.positive_factors([least, most], 0.0, name, "iridescence thickness");
        finish.film_thickness_texture = self.linear(source.iridescence_thickness_texture.as_ref(), name);
    }

    fn diffuse_transmission(&mut self, finish: &mut Finish, source: &DiffuseTransmission, name: &str) {
        let factor = source.diffuse_transmission_factor;
        finish.diffuse_transmission = self.unit_factor(factor, 0.0, name, "diffuse transmission factor");
        if finish.diffuse_transmission <= 0.0 {
            return;
        }
        finish.diffuse_transmission_texture = self.linear(source.diffuse_transmission_texture.as_ref(), name);
        let color = source.diffuse_transmission_color_factor.unwrap_or([1.0; 3]);
        finish.diffuse_transmission_color =
            Vec3::from(self.unit_factors(color, 1.0, name, "diffuse transmission color"));
        finish.diffuse_transmission_color_texture =
            self.texture(source.diffuse_transmission_color_texture.as_ref(), Encoding::Srgb, name);
    }

    fn linear(&mut self, info: Option<&Info>, name: &str) -> Option<TextureRef> {
        self.texture(info, Encoding::Linear, name)
    }
}
