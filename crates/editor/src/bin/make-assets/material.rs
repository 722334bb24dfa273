//! Materials of the generated scenes.

use glam::{DVec3, Vec3};

use crate::glb::TextureId;

/// Which sides of a surface are shown and emit.
#[derive(Clone, Copy, PartialEq)]
pub enum Sides {
    /// The front, where the vertices run counter-clockwise.
    Front,
    /// Front and back.
    Both,
}

/// Clear glass.
#[derive(Clone, Copy)]
pub enum Glass {
    /// A thin wall, which does not bend light.
    Pane,
    /// The surface of a solid of refractive index 1.5.
    Solid,
}

/// A metallic-roughness material; the default is a white matte plastic.
#[derive(Clone)]
pub struct Material {
    /// Name in the file.
    pub name: &'static str,
    /// Linear Rec. 709 reflectance.
    pub base_color: Vec3,
    /// Image that multiplies the base color.
    pub texture: Option<TextureId>,
    /// Normal map and its scale.
    pub normal: Option<(TextureId, f32)>,
    /// 0 dielectric, 1 metal.
    pub metallic: f32,
    /// Perceptual roughness.
    pub roughness: f32,
    /// Strength of the dielectric reflection; 0 makes a rough surface Lambertian.
    pub specular: f32,
    /// Emitted radiance in nit, linear Rec. 709.
    pub emission: Vec3,
    /// Light passes through.
    pub glass: Option<Glass>,
    /// Shown and emitting sides.
    pub sides: Sides,
}

impl Default for Material {
    fn default() -> Self {
        Material {
            name: "",
            base_color: Vec3::splat(0.8),
            texture: None,
            normal: None,
            metallic: 0.0,
            roughness: 0.6,
            specular: 1.0,
            emission: Vec3::ZERO,
            glass: None,
            sides: Sides::Front,
        }
    }
}

impl Material {
    /// A dielectric of a linear color and a perceptual roughness.
    pub fn plain(name: &'static str, base_color: Vec3, roughness: f32) -> Self {
        Material { name, base_color, roughness, ..Material::default() }
    }

    /// A purely Lambertian reflector.
    pub fn lambert(name: &'static str, base_color: Vec3) -> Self {
        Material { name, base_color, roughness: 1.0, specular: 0.0, ..Material::default() }
    }

    /// A metal of a linear color at normal incidence.
    pub fn metal(name: &'static str, base_color: Vec3, roughness: f32) -> Self {
        Material { name, base_color, roughness, metallic: 1.0, ..Material::default() }
    }

    /// Clear glass with a perfectly smooth surface.
    pub fn glass(name: &'static str, glass: Glass, base_color: Vec3) -> Self {
        let sides = if matches!(glass, Glass::Pane) { Sides::Both } else { Sides::Front };
        Material { name, base_color, roughness: 0.0, glass: Some(glass), sides, ..Material::default() }
    }

    /// A one-sided emitter of a radiance in nit, tinted like a black body.
    pub fn emitter(name: &'static str, nit: f32, kelvin: f64) -> Self {
        let emission = nit * tint(kelvin);
        Material { name, emission, base_color: Vec3::splat(0.7), roughness: 0.5, ..Material::default() }
    }
}

/// Linear Rec. 709 color of a black body, luminance 1, by the cubic fit of the Planckian locus for 1667…25000 K.
pub fn tint(kelvin: f64) -> Vec3 {
    let t = 1000.0 / kelvin;
    let x = if kelvin <= 4000.0 {
        ((-0.266_123_9 * t - 0.234_358_9) * t + 0.877_695_6) * t + 0.179_910
    } else {
        ((-3.025_846_9 * t + 2.107_037_9) * t + 0.222_634_7) * t + 0.240_390
    };
    let y = if kelvin <= 2222.0 {
        ((-1.106_381_4 * x - 1.348_110_2) * x + 2.185_558_32) * x - 0.202_196_83
    } else if kelvin <= 4000.0 {
        ((-0.954_947_6 * x - 1.374_185_93) * x + 2.091_370_15) * x - 0.167_488_67
    } else {
        ((3.081_758 * x - 5.873_386_7) * x + 3.751_129_97) * x - 0.370_014_83
    };
    let (big_x, big_z) = (x / y, (1.0 - x - y) / y);
    let rgb = DVec3::new(
        3.240_454_2 * big_x - 1.537_138_5 - 0.498_531_4 * big_z,
        -0.969_266 * big_x + 1.876_010_8 + 0.041_556 * big_z,
        0.055_643_4 * big_x - 0.204_025_9 + 1.057_225_2 * big_z,
    );
    rgb.max(DVec3::ZERO).as_vec3()
}
