//! What a designer sets: per lamp, and per spot on a panel.

use std::collections::{BTreeMap, BTreeSet};

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::lamps::FreeLamp;
use crate::sky::SkySetting;

/// The lighting of a scene: what differs from the file. Keys are those of `LightSource::key`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LightRig {
    /// Settings by lamp; a lamp that is left out shines as in the file.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub lights: BTreeMap<String, LightSetting>,
    /// Spots by panel; a panel that is left out shines as in the file (uniformly, unless its node marks spots), one without
    /// spots is dark.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub panels: BTreeMap<String, Vec<PanelSpot>>,
    /// The sky; one that is left out is as baked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sky: Option<SkySetting>,
    /// Lamps that the scene does not have.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lamps: Vec<FreeLamp>,
    /// Masters that turn many lights at once, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub groups: BTreeMap<String, LightGroup>,
}

/// Lights that are turned together, on top of what each of them is set to. Where a light is in several groups all count.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightGroup {
    /// Keys of its lights, of the scene and free ones.
    pub lights: BTreeSet<String>,
    /// Multiplies the intensity of each.
    #[serde(default = "one")]
    pub intensity: f32,
    /// All of them are dark.
    #[serde(default)]
    pub muted: bool,
}

/// One lamp, relative to what the file says.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightSetting {
    /// Multiplies what the file says.
    #[serde(default = "one")]
    pub intensity: f32,
    /// Linear Rec. 709; replaces the file's color.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<[f32; 3]>,
    /// Correlated color temperature; replaces the color by the Planckian tint at luminance 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kelvin: Option<f32>,
    /// Dark, whatever else is set.
    #[serde(default)]
    pub muted: bool,
}

/// A spot of light on a panel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PanelSpot {
    /// (0, 0) at the panel's UV origin, (1, 1) at the opposite corner.
    pub position: [f32; 2],
    /// In units of the panel's shorter side.
    pub radius: f32,
    /// Linear Rec. 709; replaces the panel's own color.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<[f32; 3]>,
    /// 1 emits the panel's own radiance.
    #[serde(default = "one")]
    pub intensity: f32,
}

impl PanelSpot {
    /// Farthest coordinate of its middle that is read, on either side: it may stand beside its panel.
    pub const MOST_AWAY: f32 = 100.0;
    /// Largest radius that is read.
    pub const MOST_RADIUS: f32 = 1000.0;
    /// Greatest intensity that is read.
    pub const MOST_INTENSITY: f32 = 1e9;
    /// Greatest channel of a color that is read.
    pub const MOST_CHANNEL: f32 = 1e6;

    /// The nearest spot that is read: bakes of earlier versions may hold others.
    pub fn within_limits(self) -> PanelSpot {
        PanelSpot {
            position: self.position.map(|at| at.clamp(-Self::MOST_AWAY, Self::MOST_AWAY)),
            radius: self.radius.clamp(0.0, Self::MOST_RADIUS),
            color: self.color.map(|color| color.map(|channel| channel.clamp(0.0, Self::MOST_CHANNEL))),
            intensity: self.intensity.clamp(0.0, Self::MOST_INTENSITY),
        }
    }
}

/// What a node of a file keeps of its lights while they are off: `extras: {"clerestory": {"muted": …}}`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MutedLights {
    /// Its lamp.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lamp: Option<MutedLight>,
    /// Candela of the plain lamp that stands beside a measured distribution for those who cannot read that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plain_cd: Option<f32>,
    /// For each primitive of its mesh in order, none for those that do not shine.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub surfaces: Vec<Option<MutedLight>>,
}

/// What a light that is off is when it is on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MutedLight {
    /// Linear Rec. 709.
    pub color: Vec3,
    /// Candela, lux of directional lamps, nit of surfaces.
    pub strength: f32,
}

fn one() -> f32 {
    1.0
}

impl Default for LightSetting {
    fn default() -> Self {
        LightSetting { intensity: 1.0, color: None, kelvin: None, muted: false }
    }
}

impl LightRig {
    /// What a light is set to by itself: that of a free lamp if one has this key.
    pub fn own_setting(&self, key: &str) -> LightSetting {
        let lamp = self.lamps.iter().find(|lamp| lamp.key == key);
        lamp.map(|lamp| lamp.setting).or_else(|| self.lights.get(key).copied()).unwrap_or_default()
    }

    /// Sets a light by itself. What equals the scene leaves no trace.
    pub fn set(&mut self, key: &str, setting: LightSetting) {
        if let Some(lamp) = self.lamps.iter_mut().find(|lamp| lamp.key == key) {
            lamp.setting = setting;
        } else if setting == LightSetting::default() {
            self.lights.remove(key);
        } else {
            self.lights.insert(key.to_owned(), setting);
        }
    }

    /// What a light is set to by itself and by its groups.
    pub fn setting(&self, key: &str) -> LightSetting {
        self.in_groups(key, self.own_setting(key))
    }

    /// What a light of the scene is set to by itself and by its groups: a free lamp with its key is another light.
    pub fn light_setting(&self, key: &str) -> LightSetting {
        self.in_groups(key, self.lights.get(key).copied().unwrap_or_default())
    }

    /// Whether a light of the scene is dark because a free lamp shines in its place.
    pub fn is_replaced(&self, key: &str) -> bool {
        self.lights.get(key).is_some_and(|setting| setting.muted)
            && self.lamps.iter().any(|lamp| lamp.replaces.as_deref() == Some(key))
    }

    /// The lights of which [`LightRig::is_replaced`] holds: for many lights at once, as each of them would go through all lamps.
    pub fn replaced(&self) -> BTreeSet<&str> {
        let of_file = self.lamps.iter().filter_map(|lamp| lamp.replaces.as_deref());
        of_file.filter(|key| self.lights.get(*key).is_some_and(|setting| setting.muted)).collect()
    }

    /// The free lamps, set by themselves and by their groups.
    pub fn lit_lamps(&self) -> Vec<FreeLamp> {
        let lit = |lamp: &FreeLamp| FreeLamp { setting: self.in_groups(&lamp.key, lamp.setting), ..lamp.clone() };
        self.lamps.iter().map(lit).collect()
    }

    /// Those of them that are not muted.
    pub fn shining_lamps(&self) -> Vec<FreeLamp> {
        self.lit_lamps().into_iter().filter(|lamp| !lamp.setting.muted).collect()
    }

    /// Takes the free lamps out, set by themselves and by their groups, for whoever makes lights of the scene of them: what
    /// is left does not set them once more.
    pub fn take_lamps(&mut self) -> Vec<FreeLamp> {
        let lamps = self.lit_lamps();
        self.lamps.clear();
        for group in self.groups.values_mut() {
            group.lights.retain(|key| lamps.iter().all(|lamp| lamp.key != *key));
        }
        lamps
    }

    fn in_groups(&self, key: &str, mut setting: LightSetting) -> LightSetting {
        for group in self.groups.values().filter(|group| group.lights.contains(key)) {
            setting.intensity *= group.intensity;
            setting.muted |= group.muted;
        }
        setting
    }
}

impl LightSetting {
    /// Light relative to a white lamp of strength 1: what the file says (`color`, `strength`), changed by this setting.
    pub fn emission(&self, color: Vec3, strength: f32) -> Vec3 {
        if self.muted {
            return Vec3::ZERO;
        }
        self.tint(color) * strength * self.intensity
    }

    /// Linear Rec. 709 color of a light that shines in `own` color where neither color nor kelvin is set.
    pub fn tint(&self, own: Vec3) -> Vec3 {
        match (self.kelvin, self.color) {
            (Some(kelvin), _) => planckian_tint(kelvin),
            (None, Some(color)) => Vec3::from(color),
            (None, None) => own,
        }
    }
}

impl PanelSpot {
    /// 1 inside, 0 outside, a smooth edge between 0.7 and 1.3 radii. `offset` from the spot's center in units of the
    /// panel's shorter side.
    pub fn weight(&self, offset: glam::Vec2) -> f32 {
        let t = ((1.3 - offset.length() / self.radius.max(1e-6)) / 0.6).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }
}

/// Least and greatest color temperature that light has a color of its own for, kelvin: beyond, it has that of the nearer one.
pub const TINT_KELVIN: [f32; 2] = [1667.0, 25_000.0];

/// Linear Rec. 709 color of a black body at luminance 1. Clamped to [`TINT_KELVIN`] and to the gamut.
///
/// Chromaticity by the rational fit of \[Kim2002\] for the Planckian locus.
pub fn planckian_tint(kelvin: f32) -> Vec3 {
    let [least, most] = TINT_KELVIN;
    let t = f64::from(if kelvin.is_finite() { kelvin.clamp(least, most) } else { 6500.0 });
    let x = if t <= 4000.0 {
        -0.266_123_9e9 / t.powi(3) - 0.234_358_9e6 / t.powi(2) + 0.877_695_6e3 / t + 0.179_910
    } else {
        -3.025_846_9e9 / t.powi(3) + 2.107_037_9e6 / t.powi(2) + 0.222_634_7e3 / t + 0.240_390
    };
    let y = if t <= 2222.0 {
        -1.106_381_4 * x.powi(3) - 1.348_110_2 * x.powi(2) + 2.185_558_32 * x - 0.202_196_83
    } else if t <= 4000.0 {
        -0.954_947_6 * x.powi(3) - 1.374_185_93 * x.powi(2) + 2.091_370_15 * x - 0.167_488_67
    } else {
        3.081_758 * x.powi(3) - 5.873_386_7 * x.powi(2) + 3.751_129_97 * x - 0.370_014_83
    };
    let xyz = glam::DVec3::new(x / y, 1.0, (1.0 - x - y) / y);
    let rgb = rgb_of_xyz(xyz);
    let rgb = rgb.max(glam::DVec3::ZERO).as_vec3();
    rgb / luminance(rgb)
}

/// Columns are the Rec. 709 values of X, Y and Z.
pub(crate) const REC709_FROM_XYZ: glam::DMat3 = glam::DMat3::from_cols_array(&[
    3.240_454_2,
    -0.969_266,
    0.055_643_4,
    -1.537_138_5,
    1.876_010_8,
    -0.204_025_9,
    -0.498_531_4,
    0.041_556,
    1.057_225_2,
]);

/// Linear Rec. 709 of CIE XYZ; negative outside the gamut.
pub(crate) fn rgb_of_xyz(xyz: glam::DVec3) -> glam::DVec3 {
    REC709_FROM_XYZ * xyz
}

/// Luminance of linear Rec. 709.
pub fn luminance(rgb: Vec3) -> f32 {
    rgb.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lamps::{LampShape, LampUnit};

    #[test]
    fn kelvin_is_warm_below_and_cool_above_daylight_at_luminance_one() {
        for kelvin in [1800.0, 2700.0, 4000.0, 6500.0, 12_000.0] {
            assert!((luminance(planckian_tint(kelvin)) - 1.0).abs() < 1e-5);
        }
        let (warm, cool) = (planckian_tint(2700.0), planckian_tint(10_000.0));
        assert!(warm.x > warm.z && cool.z > cool.x);
        let day = planckian_tint(6500.0);
        assert!((day - Vec3::ONE).abs().max_element() < 0.06, "{day}");
    }

    /// A point lamp, in whose place a light of the file is off or none is.
    fn lamp(key: &str, replaces: Option<&str>) -> FreeLamp {
        FreeLamp {
            key: key.to_owned(),
            shape: LampShape::Point,
            position: Vec3::ZERO,
            aim: Vec3::NEG_Y,
            strength: 1.0,
            unit: LampUnit::Candela,
            setting: LightSetting::default(),
            turn_rad: 0.0,
            replaces: replaces.map(str::to_owned),
        }
    }

    #[test]
    fn groups_turn_their_lights_on_top_of_what_each_is_set_to() {
        let group = |lights: &[&str], intensity, muted| LightGroup {
            lights: lights.iter().map(|key| (*key).to_owned()).collect(),
            intensity,
            muted,
        };
        let mut rig = LightRig::default();
        rig.set("a", LightSetting { intensity: 3.0, ..LightSetting::default() });
        rig.groups.insert("both".into(), group(&["a", "b"], 0.5, false));
        rig.groups.insert("one".into(), group(&["a"], 4.0, false));
        assert_eq!((rig.setting("a").intensity, rig.setting("b").intensity), (6.0, 0.5));
        assert_eq!((rig.setting("c"), rig.own_setting("a").intensity), (LightSetting::default(), 3.0));
        let mut with_lamp = rig.clone();
        with_lamp.lamps.push(lamp("b", None));
        assert_eq!(with_lamp.take_lamps()[0].setting.intensity, 0.5);
        assert_eq!(with_lamp.setting("b").intensity, 1.0, "it was counted");
        rig.groups.insert("dark".into(), group(&["b"], 1.0, true));
        assert!(rig.setting("b").muted && !rig.setting("a").muted);
        rig.set("a", LightSetting::default());
        assert!(rig.lights.is_empty(), "what equals the scene leaves no trace");
    }

    #[test]
    fn a_lamp_with_the_key_of_a_light_of_the_scene_does_not_set_it() {
        let setting = LightSetting { muted: true, ..LightSetting::default() };
        let lamps = vec![FreeLamp { setting, ..lamp("a", None) }];
        let mut rig = LightRig { lamps, ..LightRig::default() };
        assert!(rig.setting("a").muted && !rig.light_setting("a").muted);
        rig.lights.insert("a".into(), LightSetting { intensity: 3.0, ..LightSetting::default() });
        let group = LightGroup { lights: ["a".to_owned()].into(), intensity: 0.5, muted: false };
        rig.groups.insert("one".into(), group);
        assert_eq!(rig.light_setting("a"), LightSetting { intensity: 1.5, ..LightSetting::default() });
    }

    #[test]
    fn lights_in_whose_place_lamps_shine_are_replaced_while_they_are_off() {
        let lamps = vec![lamp("1", Some("off")), lamp("2", Some("on")), lamp("3", Some("off")), lamp("4", None)];
        let mut rig = LightRig { lamps, ..LightRig::default() };
        for key in ["off", "alone"] {
            rig.set(key, LightSetting { muted: true, ..LightSetting::default() });
        }
        assert_eq!(rig.replaced(), BTreeSet::from(["off"]));
        for key in ["off", "on", "alone", "4"] {
            assert_eq!(rig.is_replaced(key), rig.replaced().contains(key), "{key}");
        }
    }

    #[test]
    fn muting_wins_and_color_replaces() {
        let setting = LightSetting { intensity: 2.0, color: Some([0.0, 0.0, 1.0]), kelvin: None, muted: false };
        assert_eq!(setting.emission(Vec3::new(1.0, 0.5, 0.2), 10.0), Vec3::new(0.0, 0.0, 20.0));
        assert_eq!(LightSetting { muted: true, ..setting }.emission(Vec3::ONE, 1.0), Vec3::ZERO);
    }
}
