//! Where a light comes from in its file, and what a designer counts it by.

use std::f32::consts::PI;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::basis::{LightSource, SourceKind};
use crate::emitters::PanelEmitter;
use crate::lamps::{LampUnit, lumen_per_candela};
use crate::light::{LightSetting, luminance};
use crate::photometry::PhotometricProfile;
use crate::scene::{AlphaMode, Material, PunctualKind, PunctualLight, Scene, SceneNode};

/// What sorts a light among others, and its flux. Bakes of older programs do not tell it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LightOrigin {
    /// Names of the nodes above its own, as [`Scene::names_above`] has them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub parents: Vec<String>,
    /// Name of the mesh or lamp that its node is an instance of.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Name of its brightest material.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub material: Option<String>,
    /// World-space center in meters; what shines from far away has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position: Option<Vec3>,
    /// Luminous flux in lumen of each candela or nit; not known where a texture dims it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lumens: Option<f32>,
    /// Name of the file of its measured distribution.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub profile: Option<String>,
    /// Electrical power in watt that this file states, at full light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub watts: Option<f32>,
    /// Angle from the middle to the rim of a directional lamp that was given a size, radians.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius_rad: Option<f32>,
}

impl LightOrigin {
    /// Of a lamp, which has no size but that of a disk far away.
    pub(crate) fn of_lamp(scene: &Scene, light: &PunctualLight) -> LightOrigin {
        let node = scene.nodes.get(light.node as usize);
        let is_near = light.kind != PunctualKind::Directional;
        let profile = light.profile.and_then(|profile| scene.profiles.get(profile as usize));
        LightOrigin {
            parents: node.map_or_else(Vec::new, |node| scene.names_above(node)),
            model: node.and_then(|node| node.lamp.clone()),
            material: None,
            position: is_near.then_some(light.position),
            lumens: is_near.then(|| lumen_per_candela(light.kind, profile) as f32),
            profile: profile.map(|profile| file_name(profile.name())),
            watts: profile.and_then(PhotometricProfile::watts),
            radius_rad: (!is_near && light.radius_rad > 0.0).then_some(light.radius_rad),
        }
    }

    /// Of the emissive triangles of a node, which lie around `center`.
    pub(crate) fn of_surface(scene: &Scene, node: &SceneNode, triangles: &[u32], center: Vec3) -> LightOrigin {
        let material = |triangle: &u32| -> &Material {
            &scene.materials[scene.mesh.triangle_material[*triangle as usize] as usize]
        };
        let radiance = |triangle: &u32| luminance(material(triangle).emitted_radiance());
        let brightest = triangles.iter().max_by(|a, b| radiance(a).total_cmp(&radiance(b)));
        LightOrigin {
            parents: scene.names_above(node),
            model: node.mesh.clone(),
            material: brightest.map(|triangle| material(triangle).name.clone()).filter(|name| !name.is_empty()),
            position: Some(center),
            lumens: flux(scene, triangles),
            profile: None,
            watts: None,
            radius_rad: None,
        }
    }
}

/// The last part of a path, so that a bake tells nothing about the folders of a machine.
fn file_name(path: &str) -> String {
    path.rsplit(['/', '\\']).next().unwrap_or(path).to_owned()
}

/// Lumen of each nit of the brightest radiance, channel by channel, of some triangles: π times their area, twice where they
/// shine from both sides; `None` under a texture or alpha.
fn flux(scene: &Scene, triangles: &[u32]) -> Option<f32> {
    let (mut flux, mut brightest) = (0.0_f64, Vec3::ZERO);
    for &triangle in triangles {
        let material = &scene.materials[scene.mesh.triangle_material[triangle as usize] as usize];
        if material.emissive_texture.is_some() || material.alpha != AlphaMode::Opaque {
            return None;
        }
        let sides = if material.double_sided { 2.0 } else { 1.0 };
        let area = scene.mesh.area_m2(triangle);
        flux += f64::from(PI * area * sides * luminance(material.emitted_radiance()));
        brightest = brightest.max(material.emitted_radiance());
    }
    let lumens = flux as f32 / luminance(brightest);
    lumens.is_finite().then_some(lumens)
}

impl PanelEmitter {
    /// World-space middle in meters.
    pub(crate) fn center(&self) -> Vec3 {
        self.origin + 0.5 * (self.u_edge + self.v_edge)
    }
}

impl LightSource {
    /// How much of its light there is under a setting, in a unit; `None` where that does not follow from what it is. A
    /// muted light counts as if it were not.
    pub fn amount(&self, setting: &LightSetting, unit: LampUnit) -> Option<f32> {
        let own = match self.kind {
            SourceKind::Point | SourceKind::Spot => LampUnit::Candela,
            SourceKind::Directional | SourceKind::Sun { .. } => LampUnit::Lux,
            SourceKind::Emitter | SourceKind::Panel { .. } => LampUnit::Nit,
            // What a map or a picture holds is its own affair.
            SourceKind::Sky | SourceKind::Dome { .. } | SourceKind::Constant | SourceKind::Image => return None,
        };
        let amount = luminance(setting.tint(self.color)) * self.strength * setting.intensity;
        match unit {
            unit if unit == own => Some(amount),
            LampUnit::Lumen => Some(amount * self.origin.lumens?),
            LampUnit::Candela => self.candela_of_panel(amount * self.origin.lumens?),
            _ => None,
        }
    }

    /// Luminous intensity in candela straight ahead of a panel that sends so many lumen, to either side where both shine; `None` of what
    /// is no panel, and where the flux of the whole is not known.
    pub fn candela_of_panel(&self, lumens: f32) -> Option<f32> {
        let SourceKind::Panel { size_m: [width, height], .. } = self.kind else { return None };
        // Seen straight ahead each nit is a candela for each square meter, however many sides shine.
        Some(lumens / self.origin.lumens? * width * height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::emitters::Lighting;
    use crate::laws::stage::{Stage, lambert, quad};

    #[test]
    fn the_flux_of_a_lamp_and_of_a_surface_are_those_of_photometry() {
        let square = [Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::ZERO, Vec3::X + Vec3::Y, Vec3::Y];
        let both = Material { double_sided: true, ..lambert(0.0, 5.0) };
        let scene = Stage::new(Camera::look_at("eye", Vec3::Z, Vec3::NEG_Z, 1.0, 1.0))
            .lamp("bulb", Vec3::new(1.0, 2.0, 3.0), 10.0)
            .distant("far", Vec3::NEG_Y, 900.0)
            .surface("square", &square, lambert(0.0, 5.0))
            .surface("both", &square, both)
            .prepared();
        let Lighting { basis, .. } = &scene.lighting;
        let amount = |key: &str, unit| {
            let source = basis.source(key).expect("it is there");
            source.amount(&LightSetting { intensity: 2.0, muted: true, ..LightSetting::default() }, unit)
        };
        let near = |found: Option<f32>, expected: f32| {
            let found = found.expect("it follows");
            assert!((found / expected - 1.0).abs() < 1e-4, "{found} is not {expected}");
        };
        near(amount("bulb", LampUnit::Candela), 20.0);
        near(amount("bulb", LampUnit::Lumen), 20.0 * 4.0 * PI);
        near(amount("far", LampUnit::Lux), 1800.0);
        near(amount("square", LampUnit::Nit), 10.0);
        near(amount("square", LampUnit::Lumen), 10.0 * PI);
        near(amount("both", LampUnit::Lumen), 20.0 * PI);
        for (key, unit) in [("bulb", LampUnit::Lux), ("far", LampUnit::Lumen), ("square", LampUnit::Lux)] {
            assert_eq!(amount(key, unit), None, "{key}");
        }
        let position = |key: &str| basis.source(key).and_then(|source| source.origin.position);
        assert_eq!(position("bulb"), Some(Vec3::new(1.0, 2.0, 3.0)));
        assert!(position("square").is_some_and(|at| at.distance(Vec3::new(0.5, 0.5, 0.0)) < 1e-5));
        assert_eq!(position("far"), None);
    }

    #[test]
    fn a_panel_has_the_candela_of_its_area_from_either_side_that_shines() {
        // Two square meters of 5 nit: 10 cd straight ahead, and 10 π lm from each side.
        let corners = quad(Vec3::ZERO, Vec3::X * 2.0, Vec3::Y);
        let scene = Stage::new(Camera::look_at("eye", Vec3::Z, Vec3::NEG_Z, 1.0, 1.0))
            .panel("one", &corners, 5.0, 8)
            .surface("both", &corners, Material { double_sided: true, ..lambert(0.0, 5.0) })
            .with_panel(Some(8))
            .prepared();
        for (key, lumen) in [("one", 10.0 * PI), ("both", 20.0 * PI)] {
            let source = scene.lighting.basis.source(key).expect("it is there");
            let amount = |unit| source.amount(&LightSetting::default(), unit).expect("it follows");
            assert!((amount(LampUnit::Lumen) / lumen - 1.0).abs() < 1e-4, "{key}: {} lm", amount(LampUnit::Lumen));
            assert!((amount(LampUnit::Candela) / 10.0 - 1.0).abs() < 1e-4, "{key}: {} cd", amount(LampUnit::Candela));
        }
    }

    #[test]
    fn a_lamp_tells_the_file_of_its_distribution_and_the_power_that_it_states() {
        let ies = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 2 1 1 2 0 0 0\n1 1 17\n0 90\n0\n9 9\n";
        let profile = PhotometricProfile::parse(ies.as_bytes(), "lamps/down.ies").expect("a valid file");
        let stage = Stage::new(Camera::look_at("eye", Vec3::Z, Vec3::NEG_Z, 1.0, 1.0));
        let mut scene = stage.lamp("down", Vec3::Y, 10.0).lamp("bare", Vec3::X, 10.0).into_scene();
        crate::photometry::assign(&mut scene, "down", profile, 2.0).expect("it is there");
        let (lighting, _) = Lighting::new(&scene, &[]).expect("valid lights");
        let origin = |key: &str| &lighting.basis.source(key).expect("it is there").origin;
        assert_eq!((origin("down").profile.as_deref(), origin("down").watts), (Some("down.ies"), Some(17.0)));
        assert_eq!((origin("bare").profile.as_deref(), origin("bare").watts), (None, None));
    }

    #[test]
    fn color_counts_as_the_eye_sees_it() {
        let blue = LightSetting { color: Some([0.0, 0.0, 1.0]), ..LightSetting::default() };
        let source = LightSource {
            key: "l".into(),
            kind: SourceKind::Point,
            columns: 0..1,
            color: Vec3::ONE,
            strength: 100.0,
            origin: LightOrigin::default(),
        };
        let candela = source.amount(&blue, LampUnit::Candela).expect("candela");
        assert!((candela - 7.22).abs() < 1e-3, "{candela}");
        assert_eq!(source.amount(&blue, LampUnit::Lumen), None, "an older bake does not tell");
    }
}
