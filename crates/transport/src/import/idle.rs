//! Textures that nothing samples: their factor is 0, so that what the image holds is multiplied away. Nobody decodes them.

use glam::Vec3;
use gltf::json::Root;

use super::container::Buffers;
use super::images::{dimensions, sources_of};
use super::material::UsedTexture;
use crate::scene::{AlphaMode, Finish, Material, Scene, TextureRef};

/// Takes idle textures from the materials, and from `textures` those that none uses any more.
pub(super) fn drop_idle(materials: &mut [Material], textures: &mut Vec<UsedTexture>) {
    materials.iter_mut().for_each(forget_idle);
    let mut is_used = vec![false; textures.len()];
    for slot in materials.iter_mut().flat_map(Material::texture_slots) {
        if let Some(used) = slot.as_ref().and_then(|texture| is_used.get_mut(texture.texture as usize)) {
            *used = true;
        }
    }
    #[expect(clippy::arithmetic_side_effects, reason = "a count of textures in memory")]
    let places: Vec<u32> = is_used
        .iter()
        .scan(0, |kept, &used| {
            *kept += u32::from(used);
            Some(kept.saturating_sub(1))
        })
        .collect();
    for texture in materials.iter_mut().flat_map(Material::texture_slots).flatten() {
        texture.texture = places.get(texture.texture as usize).copied().unwrap_or(texture.texture);
    }
    let mut used = is_used.into_iter();
    textures.retain(|_| used.next().unwrap_or(true));
}

/// Counts the images of the file that none of the textures needs.
pub(super) fn count_idle(scene: &mut Scene, document: &Root, textures: &[UsedTexture], buffers: &Buffers) {
    let mut is_needed = vec![false; document.images.len()];
    for source in textures.iter().flat_map(|texture| sources_of(document, texture.index)) {
        if let Some(needed) = is_needed.get_mut(source) {
            *needed = true;
        }
    }
    for (index, _) in is_needed.into_iter().enumerate().filter(|(_, needed)| !needed) {
        let [width, height] = dimensions(document, index, buffers).unwrap_or([0; 2]);
        scene.idle_images = scene.idle_images.saturating_add(1);
        // A size that nobody believes, for nobody decodes it: at the most, it is the most.
        let n_bytes = u64::from(width).saturating_mul(u64::from(height)).saturating_mul(4);
        scene.idle_bytes = scene.idle_bytes.saturating_add(n_bytes);
    }
}

fn forget_idle(material: &mut Material) {
    let matched = crate::bsdf::is_matched(material.ior);
    let no_coat = material.specular <= 0.0 || matched;
    let is_black = material.base_color.truncate() == Vec3::ZERO && material.alpha == AlphaMode::Opaque;
    let idle = |texture: &mut Option<TextureRef>, is_idle: bool| *texture = texture.filter(|_| !is_idle);
    idle(&mut material.base_color_texture, is_black);
    idle(&mut material.metallic_roughness_texture, material.metallic <= 0.0 && material.roughness <= 0.0);
    idle(&mut material.transmission_texture, material.transmission <= 0.0);
    idle(&mut material.specular_texture, no_coat);
    idle(&mut material.specular_color_texture, no_coat || material.specular_color == Vec3::ZERO);
    let shines = material.is_emitter();
    idle(&mut material.emissive_texture, !shines);
    if let Some(finish) = &mut material.finish {
        forget_idle_finish(finish);
    }
}

fn forget_idle_finish(finish: &mut Finish) {
    let idle = |texture: &mut Option<TextureRef>, is_idle: bool| *texture = texture.filter(|_| !is_idle);
    let (no_coat, no_sheen) = (finish.clearcoat <= 0.0, finish.sheen_color == Vec3::ZERO);
    idle(&mut finish.clearcoat_texture, no_coat);
    idle(&mut finish.clearcoat_roughness_texture, no_coat || finish.clearcoat_roughness <= 0.0);
    idle(&mut finish.clearcoat_normal_texture, no_coat);
    idle(&mut finish.sheen_color_texture, no_sheen);
    idle(&mut finish.sheen_roughness_texture, no_sheen || finish.sheen_roughness <= 0.0);
    idle(&mut finish.anisotropy_texture, finish.anisotropy <= 0.0);
    idle(&mut finish.iridescence_texture, finish.iridescence <= 0.0);
    idle(&mut finish.film_thickness_texture, finish.iridescence <= 0.0);
    idle(&mut finish.diffuse_transmission_texture, finish.diffuse_transmission <= 0.0);
    let no_color = finish.diffuse_transmission <= 0.0 || finish.diffuse_transmission_color == Vec3::ZERO;
    idle(&mut finish.diffuse_transmission_color_texture, no_color);
}
