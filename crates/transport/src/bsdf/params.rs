//! From a material and its textures to the parameters of one point.

use glam::{Vec2, Vec3, Vec4};

use crate::scene::{AlphaMode, FacetScattering, Material, Texture};

/// What a point of a surface is made of, after textures. Colors are linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceParams {
    /// Albedo of the diffuse lobe, reflectance of metal at normal incidence, tint of transmission.
    pub base_color: Vec3,
    /// 0 dielectric … 1 metal.
    pub metallic: f32,
    /// Perceptual roughness 0…1; α = roughness².
    pub roughness: f32,
    /// Share of the diffuse lobe that passes through instead, 0…1.
    pub transmission: f32,
    /// Index of refraction of the inside against the outside.
    pub ior: f32,
    /// Strength of the dielectric reflection, 0…1.
    pub specular: f32,
    /// Color of the dielectric reflection at normal incidence.
    pub specular_color: Vec3,
    /// Meters; 0 is a thin wall that does not bend light, more is a solid that does.
    pub thickness: f32,
    /// How often rough metal and rough glass scatter light.
    pub facet_scattering: FacetScattering,
}

/// Parameters of a point: factors times textures times vertex color.
pub fn surface_params(
    material: &Material,
    textures: &[Texture],
    uvs: [Vec2; 2],
    vertex_color: Option<Vec4>,
) -> SurfaceParams {
    let mut base_color = material.base_color.truncate();
    if let Some(texture) = material.base_color_texture {
        base_color *= texture.fetch(textures, uvs).truncate();
    }
    if let Some(color) = vertex_color {
        base_color *= color.truncate();
    }
    let channel = |texture: Option<crate::scene::TextureRef>, channel: usize| {
        texture.map_or(1.0, |texture| texture.fetch(textures, uvs)[channel])
    };
    let rough_metal = material.metallic_roughness_texture.map_or(Vec4::ONE, |t| t.fetch(textures, uvs));
    let tint = material.specular_color_texture.map_or(Vec3::ONE, |t| t.fetch(textures, uvs).truncate());
    SurfaceParams {
        base_color: base_color.clamp(Vec3::ZERO, Vec3::ONE),
        metallic: (material.metallic * rough_metal.z).clamp(0.0, 1.0),
        roughness: (material.roughness * rough_metal.y).clamp(0.0, 1.0),
        transmission: (material.transmission * channel(material.transmission_texture, 0)).clamp(0.0, 1.0),
        ior: material.ior,
        specular: (material.specular * channel(material.specular_texture, 3)).clamp(0.0, 1.0),
        specular_color: material.specular_color * tint,
        thickness: material.thickness,
        facet_scattering: material.facet_scattering,
    }
}

/// The least roughness that a material may have anywhere.
pub(crate) fn least_roughness(material: &Material, textures: &[Texture]) -> f32 {
    let least = |texture: &Texture| texture.image.texels.iter().map(|texel| texel[1]).min();
    let texture = material.metallic_roughness_texture.and_then(|t| textures.get(t.texture as usize));
    material.roughness * texture.and_then(least).map_or(1.0, |least| f32::from(least) * (1.0 / 255.0))
}

/// Probability 0…1 that a point is there at all.
pub fn alpha(material: &Material, textures: &[Texture], uvs: [Vec2; 2], vertex_color: Option<Vec4>) -> f32 {
    if material.alpha == AlphaMode::Opaque {
        return 1.0;
    }
    let texture = material.base_color_texture.map_or(1.0, |t| t.fetch(textures, uvs).w);
    let alpha = material.base_color.w * texture * vertex_color.map_or(1.0, |color| color.w);
    match material.alpha {
        AlphaMode::Opaque => 1.0,
        AlphaMode::Mask { cutoff } => f32::from(alpha >= cutoff),
        AlphaMode::Blend => alpha.clamp(0.0, 1.0),
    }
}

/// Unit shading normal bent by the normal map; `ns` itself where there is no map or no tangent. `tangent.w` is the sign of
/// the bitangent.
pub fn shading_normal(material: &Material, textures: &[Texture], uvs: [Vec2; 2], ns: Vec3, tangent: Vec4) -> Vec3 {
    let texel = material.normal_texture.map(|texture| texture.fetch(textures, uvs));
    bent_normal(texel, material.normal_scale, ns, tangent)
}

/// The normal that a texel of a normal map asks for.
pub(super) fn bent_normal(texel: Option<Vec4>, scale: f32, ns: Vec3, tangent: Vec4) -> Vec3 {
    let Some(texel) = texel else { return ns };
    let along = tangent.truncate();
    let Some(tangent_unit) = (along - ns * ns.dot(along)).try_normalize() else { return ns };
    let bitangent = ns.cross(tangent_unit) * if tangent.w < 0.0 { -1.0 } else { 1.0 };
    let mapped = texel.truncate() * 2.0 - 1.0;
    (tangent_unit * (mapped.x * scale) + bitangent * (mapped.y * scale) + ns * mapped.z).normalize_or(ns)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Affine2;

    use super::*;
    use crate::scene::{Encoding, Filter, Image, TextureRef, Wrap};

    fn single(texel: [u8; 4], encoding: Encoding) -> (Vec<Texture>, Option<TextureRef>) {
        let image = Arc::new(Image { width: 1, height: 1, texels: vec![texel] });
        let texture = Texture { image, wrap: [Wrap::Repeat; 2], filter: Filter::Linear };
        (vec![texture], Some(TextureRef { texture: 0, uv_set: 0, transform: Affine2::IDENTITY, encoding }))
    }

    #[test]
    fn green_is_roughness_and_blue_is_metallic() {
        let (textures, texture) = single([9, 102, 51, 7], Encoding::Linear);
        let material = Material { metallic_roughness_texture: texture, roughness: 0.5, ..Material::default() };
        let params = surface_params(&material, &textures, [Vec2::ZERO; 2], Some(Vec4::new(0.5, 1.0, 1.0, 1.0)));
        assert!((params.roughness - 0.2).abs() < 1e-6 && (params.metallic - 0.2).abs() < 1e-6);
        assert_eq!(params.base_color, Vec3::new(0.5, 1.0, 1.0));
    }

    #[test]
    fn coverage_follows_the_alpha_mode() {
        let (textures, texture) = single([255, 255, 255, 128], Encoding::Srgb);
        let mut material = Material { base_color_texture: texture, ..Material::default() };
        let mut coverage = |mode| {
            material.alpha = mode;
            alpha(&material, &textures, [Vec2::ZERO; 2], None)
        };
        assert_eq!(coverage(AlphaMode::Opaque), 1.0);
        assert!((coverage(AlphaMode::Blend) - 128.0 / 255.0).abs() < 1e-6);
        assert_eq!(coverage(AlphaMode::Mask { cutoff: 0.5 }), 1.0);
        assert_eq!(coverage(AlphaMode::Mask { cutoff: 0.6 }), 0.0);
    }

    #[test]
    fn a_normal_map_bends_along_tangent_and_bitangent() {
        let (textures, texture) = single([255, 128, 255, 255], Encoding::Linear);
        let material = Material { normal_texture: texture, ..Material::default() };
        let tangent = Vec4::new(1.0, 0.0, 0.0, 1.0);
        let bent = shading_normal(&material, &textures, [Vec2::ZERO; 2], Vec3::Z, tangent);
        assert!((bent - Vec3::new(1.0, 0.0, 1.0).normalize()).length() < 5e-3 && bent.is_normalized());
        let (textures, _) = single([128, 255, 255, 255], Encoding::Linear);
        for sign in [1.0, -1.0] {
            let tangent = Vec4::new(1.0, 0.0, 0.0, sign);
            let bent = shading_normal(&material, &textures, [Vec2::ZERO; 2], Vec3::Z, tangent);
            assert!((bent - Vec3::new(0.0, sign, 1.0).normalize()).length() < 5e-3);
        }
        assert_eq!(shading_normal(&material, &textures, [Vec2::ZERO; 2], Vec3::Z, Vec4::ZERO), Vec3::Z);
    }
}
