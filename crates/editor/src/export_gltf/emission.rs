//! Materials that shine.

use clerestory_transport::emitters::share_of;
use glam::Vec3;

use super::lights::{color_and_strength, factor};
use super::raw::RawObject;

/// Extension that holds how strongly a material shines.
pub(super) const STRENGTH: &str = "KHR_materials_emissive_strength";

/// How a material shines.
pub(super) struct Emission {
    /// Linear Rec. 709.
    pub factor: Vec3,
    /// In nit where the factor is 1.
    pub strength: f32,
}

impl Emission {
    /// None where it does not, or where no light is set by it: unlit surfaces show themselves.
    pub fn of(material: &RawObject) -> Option<Emission> {
        let extensions: RawObject = material.read("extensions").unwrap_or_default();
        let factor = material.color("emissiveFactor")?;
        let strength = strength_of(material);
        let shines = (factor * strength).max_element() > 0.0 && extensions.get("KHR_materials_unlit").is_none();
        shines.then_some(Emission { factor, strength })
    }

    /// The material when its light sends `now` instead of `file`, and its strength.
    pub fn lit(&self, mut material: RawObject, now: Vec3, file: Vec3) -> (RawObject, f32) {
        let strength = match factor(now, file) {
            Some(by) => self.strength * by,
            None => {
                let (color, strength) = color_and_strength(now * share_of(self.factor * self.strength, file));
                material.set("emissiveFactor", &color);
                strength
            }
        };
        set_strength(&mut material, strength);
        (material, strength)
    }

    /// Makes a material shine so.
    pub fn put(&self, material: &mut RawObject) {
        material.set("emissiveFactor", &self.factor.to_array());
        if strength_of(material) != self.strength {
            set_strength(material, self.strength);
        }
    }
}

fn strength_of(material: &RawObject) -> f32 {
    let own = material.read::<RawObject>("extensions").and_then(|all| all.read::<RawObject>(STRENGTH));
    own.and_then(|own| own.read("emissiveStrength")).unwrap_or(1.0)
}

fn set_strength(material: &mut RawObject, strength: f32) {
    material.change("extensions", |all| all.change(STRENGTH, |own| own.set("emissiveStrength", &strength)));
}
