//! What a [`Finish`] adds to one point of a surface.

use glam::{Vec2, Vec3, Vec4};

use super::params::bent_normal;
use crate::scene::{Finish, Texture, TextureRef};

/// Finish of a point after textures. Nothing is added where all strengths and colors are 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FinishParams {
    /// Strength of the clear coat, 0…1.
    pub clearcoat: f32,
    /// Perceptual roughness of the clear coat, 0…1.
    pub clearcoat_roughness: f32,
    /// Unit normal of the clear coat in world space, on the front side.
    pub clearcoat_normal: Vec3,
    /// Albedo scale of the sheen, linear RGB.
    pub sheen_color: Vec3,
    /// Perceptual roughness of the sheen, 0…1.
    pub sheen_roughness: f32,
    /// How much more roughness there is along a direction than across it, 0…1.
    pub anisotropy: f32,
    /// That direction in world space; of no meaning without anisotropy.
    pub anisotropy_direction: Vec3,
    /// Share of the surface that a thin film covers, 0…1.
    pub iridescence: f32,
    /// Index of refraction of the film.
    pub film_ior: f32,
    /// Thickness of the film in nanometers.
    pub film_thickness_nm: f32,
    /// Share of the diffuse lobe that goes to the other side, 0…1.
    pub diffuse_transmission: f32,
    /// Albedo of that share, linear RGB.
    pub diffuse_transmission_color: Vec3,
}

impl Default for FinishParams {
    /// Nothing is added.
    fn default() -> Self {
        FinishParams {
            clearcoat: 0.0,
            clearcoat_roughness: 0.0,
            clearcoat_normal: Vec3::Z,
            sheen_color: Vec3::ZERO,
            sheen_roughness: 0.0,
            anisotropy: 0.0,
            anisotropy_direction: Vec3::X,
            iridescence: 0.0,
            film_ior: 1.3,
            film_thickness_nm: 400.0,
            diffuse_transmission: 0.0,
            diffuse_transmission_color: Vec3::ONE,
        }
    }
}

impl FinishParams {
    /// Whether a film of some thickness lies on the surface.
    pub(super) fn has_film(&self) -> bool {
        self.iridescence > 0.0 && self.film_thickness_nm > 0.0
    }

    /// Whether there is more than another shape of highlights.
    pub(super) fn is_stacked(&self) -> bool {
        self.clearcoat > 0.0
            || self.sheen_color.max_element() > 0.0
            || self.diffuse_transmission > 0.0
            || self.has_film()
    }
}

/// Normals and tangent of a point on the front side, in world space.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Unit normal between the vertices' own.
    pub vertex_normal: Vec3,
    /// Unit normal after the normal map.
    pub shading_normal: Vec3,
    /// Tangent between the vertices' own, `w` the sign of the bitangent; zero where the mesh has none.
    pub tangent: Vec4,
}

/// Finish of a point: factors times textures.
pub fn finish_params(finish: &Finish, textures: &[Texture], uvs: [Vec2; 2], frame: Frame) -> FinishParams {
    let fetch = |texture: Option<TextureRef>| texture.map_or(Vec4::ONE, |texture| texture.fetch(textures, uvs));
    let (direction, blue) = match finish.anisotropy_texture.map(|texture| texture.fetch(textures, uvs)) {
        Some(texel) => ((texel.truncate().truncate() * 2.0 - 1.0).normalize_or(Vec2::X), texel.z),
        None => (Vec2::X, 1.0),
    };
    let direction = Vec2::from_angle(finish.anisotropy_rotation_rad).rotate(direction);
    let film = fetch(finish.film_thickness_texture).y;
    let [least, most] = finish.film_thickness_nm;
    FinishParams {
        clearcoat: finish.clearcoat * fetch(finish.clearcoat_texture).x,
        clearcoat_roughness: finish.clearcoat_roughness * fetch(finish.clearcoat_roughness_texture).y,
        clearcoat_normal: bent_normal(
            finish.clearcoat_normal_texture.map(|texture| texture.fetch(textures, uvs)),
            finish.clearcoat_normal_scale,
            frame.vertex_normal,
            frame.tangent,
        ),
        sheen_color: finish.sheen_color * fetch(finish.sheen_color_texture).truncate(),
        sheen_roughness: finish.sheen_roughness * fetch(finish.sheen_roughness_texture).w,
        anisotropy: finish.anisotropy * blue,
        anisotropy_direction: in_plane(direction, frame),
        iridescence: finish.iridescence * fetch(finish.iridescence_texture).x,
        film_ior: finish.film_ior,
        film_thickness_nm: least + (most - least) * film,
        diffuse_transmission: finish.diffuse_transmission * fetch(finish.diffuse_transmission_texture).w,
        diffuse_transmission_color: finish.diffuse_transmission_color
            * fetch(finish.diffuse_transmission_color_texture).truncate(),
    }
}

/// World-space direction of coordinates along tangent and bitangent.
fn in_plane(direction: Vec2, frame: Frame) -> Vec3 {
    let (ns, along) = (frame.shading_normal, frame.tangent.truncate());
    let tangent = (along - ns * ns.dot(along)).normalize_or(ns.any_orthonormal_vector());
    let bitangent = ns.cross(tangent) * if frame.tangent.w < 0.0 { -1.0 } else { 1.0 };
    tangent * direction.x + bitangent * direction.y
}

#[cfg(test)]
mod tests {
    use std::f32::consts::FRAC_PI_2;
    use std::sync::Arc;

    use glam::Affine2;

    use super::*;
    use crate::scene::{Encoding, Filter, Image, Wrap};

    const FRAME: Frame =
        Frame { vertex_normal: Vec3::Z, shading_normal: Vec3::Z, tangent: Vec4::new(1.0, 0.0, 0.0, 1.0) };

    fn with_texel(texel: [u8; 4], encoding: Encoding) -> (Vec<Texture>, Option<TextureRef>) {
        let image = Arc::new(Image { width: 1, height: 1, texels: vec![texel] });
        let texture = Texture { image, wrap: [Wrap::Repeat; 2], filter: Filter::Linear };
        (vec![texture], Some(TextureRef { texture: 0, uv_set: 0, transform: Affine2::IDENTITY, encoding }))
    }

    #[test]
    fn every_texture_is_read_from_its_own_channel() {
        let (textures, linear) = with_texel([51, 102, 153, 204], Encoding::Linear);
        let finish = Finish {
            clearcoat: 1.0,
            clearcoat_texture: linear,
            clearcoat_roughness: 0.5,
            clearcoat_roughness_texture: linear,
            sheen_roughness: 1.0,
            sheen_roughness_texture: linear,
            iridescence: 0.5,
            iridescence_texture: linear,
            film_thickness_nm: [100.0, 600.0],
            film_thickness_texture: linear,
            diffuse_transmission: 1.0,
            diffuse_transmission_texture: linear,
            ..Finish::default()
        };
        let params = finish_params(&finish, &textures, [Vec2::ZERO; 2], FRAME);
        let close = |value: f32, expected: f32| assert!((value - expected).abs() < 1e-3, "{value} for {expected}");
        close(params.clearcoat, 0.2);
        close(params.clearcoat_roughness, 0.2);
        close(params.sheen_roughness, 0.8);
        close(params.iridescence, 0.1);
        close(params.film_thickness_nm, 300.0);
        close(params.diffuse_transmission, 0.8);
    }

    #[test]
    fn anisotropy_is_turned_counterclockwise_from_the_tangent() {
        let turned = Finish { anisotropy: 1.0, anisotropy_rotation_rad: FRAC_PI_2, ..Finish::default() };
        let direction = |finish, frame| finish_params(finish, &[], [Vec2::ZERO; 2], frame).anisotropy_direction;
        assert!(direction(&turned, FRAME).distance(Vec3::Y) < 1e-6);
        let mirrored = Frame { tangent: Vec4::new(1.0, 0.0, 0.0, -1.0), ..FRAME };
        assert!(direction(&turned, mirrored).distance(-Vec3::Y) < 1e-6);
        // Along −X in the texture, with half the strength; the turn comes on top.
        let (textures, texture) = with_texel([0, 128, 128, 255], Encoding::Linear);
        let mapped = Finish { anisotropy_texture: texture, ..turned };
        let params = finish_params(&mapped, &textures, [Vec2::ZERO; 2], FRAME);
        assert!(params.anisotropy_direction.distance(-Vec3::Y) < 0.01 && (params.anisotropy - 0.5).abs() < 0.01);
    }

    #[test]
    fn a_film_without_a_texture_has_its_greatest_thickness() {
        let finish = Finish { iridescence: 1.0, film_thickness_nm: [100.0, 600.0], ..Finish::default() };
        assert_eq!(finish_params(&finish, &[], [Vec2::ZERO; 2], FRAME).film_thickness_nm, 600.0);
    }
}
