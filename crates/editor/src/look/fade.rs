//! Cross-fades: what lies between two looks, light by light.
//!
//! Light is linear, so what a light sends is mixed linearly, and half way between two looks the picture is the mean of
//! both wherever nothing moves. What has a place moves there on a straight line.

use std::collections::{BTreeMap, BTreeSet};

use clerestory_relight::display::WhitePoint;
use clerestory_transport::basis::LightBasis;
use clerestory_transport::lamps::{FreeLamp, LampShape};
use clerestory_transport::light::{LightRig, LightSetting, PanelSpot, TINT_KELVIN};
use clerestory_transport::sky::{SkySetting, SunPlace, SunSetting};
use glam::{Vec2, Vec3};

use super::display::DISPLAY_KELVIN;
use super::groups::join;
use super::{Display, Look};

/// A spot that covers its panel: what a panel without spots shines like.
const UNIFORM: PanelSpot = PanelSpot { position: [0.5, 0.5], radius: 100.0, color: None, intensity: 1.0 };

/// The light that is shown as neutral where a look chooses none: D65, which lies beside the Planckian locus.
const DISPLAY_WHITE: WhitePoint = WhitePoint { kelvin: DISPLAY_KELVIN, duv: 0.0032 };

/// A whole turn: an angle that goes on behind it comes round again, as a file holds no more.
const TURN_DEG: f64 = 360.0;

/// Behind the key of a lamp that comes up while another one has that key.
pub const NEW: &str = " (new)";

/// What lies between two looks: `share` 0 is `a`, 1 is `b`. `basis` tells the colors that lights have in the file.
pub fn fade(a: &Look, b: &Look, share: f32, basis: Option<&LightBasis>) -> Look {
    match share {
        t if t <= 0.0 => a.present(),
        t if t >= 1.0 => b.present(),
        t => {
            let (lights, display) = (rig(&a.lights, &b.lights, t, basis), display(&a.display, &b.display, t));
            Look { lights, display, ..Look::default() }
        }
    }
}

fn rig(a: &LightRig, b: &LightRig, t: f32, basis: Option<&LightBasis>) -> LightRig {
    if a.groups != b.groups {
        return rig(&ungrouped(a), &ungrouped(b), t, basis);
    }
    let own_color = |key: &str| basis.and_then(|basis| basis.source(key)).map_or(Vec3::ONE, |source| source.color);
    let of = |rig: &LightRig, key: &str| rig.lights.get(key).copied().unwrap_or_default();
    let keys: BTreeSet<&String> = a.lights.keys().chain(b.lights.keys()).collect();
    let lights = keys.into_iter().map(|key| (key.clone(), setting(of(a, key), of(b, key), t, own_color(key))));
    let lights = lights.filter(|(_, setting)| *setting != LightSetting::default()).collect();
    let panels: BTreeSet<&String> = a.panels.keys().chain(b.panels.keys()).collect();
    let panel = |key: &String| {
        let ends = [(a, 1.0 - t), (b, t)].map(|(rig, weight)| PanelEnd {
            setting: of(rig, key),
            // What a file marks on a panel shines where a look says nothing of it.
            spots: basis.map_or_else(|| rig.panels.get(key), |basis| basis.spots_of(rig, key)).map(Vec::as_slice),
            weight,
        });
        (key.clone(), spots(&ends, own_color(key)))
    };
    let panels = panels.into_iter().map(panel).collect();
    let as_baked = basis.map_or_else(SkySetting::default, LightBasis::sky_as_baked);
    let sky = sky([a.sky.as_ref(), b.sky.as_ref()], t, &as_baked);
    let (lamps, renamed) = lamps(&a.lamps, &b.lamps, t);
    let mut mixed = LightRig { lights, panels, sky, lamps, groups: a.groups.clone() };
    renamed.iter().for_each(|[own, called]| join(&mut mixed, own, called));
    mixed
}

/// The same light without groups: what they multiply is part of each light.
fn ungrouped(rig: &LightRig) -> LightRig {
    let lamps = rig.lit_lamps();
    let is_lamp = |key: &&String| lamps.iter().any(|lamp| lamp.key == **key);
    let keys = rig.lights.keys().chain(rig.groups.values().flat_map(|group| &group.lights).filter(|key| !is_lamp(key)));
    let lights = keys.map(|key| (key.clone(), rig.light_setting(key))).collect();
    LightRig { lights, lamps, groups: BTreeMap::new(), ..rig.clone() }
}

fn lerp(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// What a setting multiplies, 0 where it is muted.
fn level(setting: LightSetting) -> f32 {
    if setting.muted { 0.0 } else { setting.intensity }
}

fn color(setting: LightSetting, own: Vec3) -> Vec3 {
    LightSetting { intensity: 1.0, muted: false, ..setting }.emission(own, 1.0)
}

/// Between two settings of a light whose color in the file is `own`: the light is mixed, and so is the color by how much
/// there is of each. Two color temperatures are mixed by their reciprocals, so that the mixture is one, too.
fn setting(a: LightSetting, b: LightSetting, t: f32, own: Vec3) -> LightSetting {
    let weights = [(1.0 - t) * level(a), t * level(b)];
    let intensity = weights[0] + weights[1];
    let nearer = if t < 0.5 { a } else { b };
    if intensity <= 0.0 {
        // Dark at both ends: of a light that is muted at one of them alone the other is turned down to nothing.
        return LightSetting { muted: a.muted || b.muted, intensity: lerp(a.intensity, b.intensity, t), ..nearer };
    }
    let tint = |setting: LightSetting| LightSetting { intensity, muted: false, ..setting };
    match (a.kelvin, b.kelvin) {
        _ if weights[1] == 0.0 || (a.color, a.kelvin) == (b.color, b.kelvin) => tint(a),
        _ if weights[0] == 0.0 => tint(b),
        (Some(from), Some(to)) => {
            let [from, to] = [from, to].map(|kelvin| kelvin.clamp(TINT_KELVIN[0], TINT_KELVIN[1]));
            let mired = (weights[0] / from + weights[1] / to) / intensity;
            LightSetting { kelvin: Some(1.0 / mired), ..tint(nearer) }
        }
        _ => {
            let mixed = (color(a, own) * weights[0] + color(b, own) * weights[1]) / intensity;
            LightSetting { color: Some(mixed.to_array()), kelvin: None, intensity, muted: false }
        }
    }
}

/// One end of the fade of a panel.
struct PanelEnd<'a> {
    setting: LightSetting,
    /// None shines uniformly.
    spots: Option<&'a [PanelSpot]>,
    weight: f32,
}

/// Spots with the same number move; others go out, and come up. A uniform panel is one wide spot.
fn spots(ends: &[PanelEnd; 2], own: Vec3) -> Vec<PanelSpot> {
    let [a, b] = ends;
    let whole = level(setting(a.setting, b.setting, b.weight, own));
    // What a spot sends, so that a panel that is dimmed as a whole at the same time is mixed as linearly as others.
    let sent = |end: &PanelEnd, spot: &PanelSpot| {
        let color = spot.color.map_or_else(|| color(end.setting, own), Vec3::from);
        color * (end.weight * level(end.setting) * spot.intensity)
    };
    let shining = |spot: PanelSpot, light: Vec3| {
        let most = light.max_element().max(f32::MIN_POSITIVE);
        let intensity = if whole > 0.0 { most / whole } else { 0.0 };
        PanelSpot { color: Some((light / most).to_array()), intensity, ..spot }
    };
    let uniform = [UNIFORM];
    let [from, to] = [a, b].map(|end| end.spots.unwrap_or(&uniform));
    let n_pairs = if a.spots.is_some() && b.spots.is_some() { from.len().min(to.len()) } else { 0 };
    let pairs = from.iter().zip(to).take(n_pairs).map(|(x, y)| {
        let position = Vec2::from(x.position).lerp(y.position.into(), b.weight).to_array();
        let moved = PanelSpot { position, radius: lerp(x.radius, y.radius, b.weight), ..*x };
        shining(moved, sent(a, x) + sent(b, y))
    });
    let alone = from.iter().skip(n_pairs).map(|spot| shining(*spot, sent(a, spot)));
    let new = to.iter().skip(n_pairs).map(|spot| shining(*spot, sent(b, spot)));
    pairs.chain(alone).chain(new).map(PanelSpot::within_limits).collect()
}

/// Between two skies of one map, or two suns: turned and dimmed along the way. One map does not become another: the first
/// goes out by the middle, and the second comes up from there. What names none is `as_baked`.
#[expect(clippy::cast_possible_truncation, reason = "an angle, as exact as the look keeps it")]
fn sky(ends: [Option<&SkySetting>; 2], t: f32, as_baked: &SkySetting) -> Option<SkySetting> {
    let [from, to] = ends.map(|sky| sky.unwrap_or(as_baked));
    let mixed = match (from.sun, to.sun) {
        _ if from.file != to.file => None,
        (None, None) => Some((None, from.map.clone())),
        (Some(x), Some(y)) => sun(x, y, t).map(|sun| (Some(sun), from.map.clone().filter(|_| from.file.is_some()))),
        _ => None,
    };
    let Some((sun, map)) = mixed else {
        let dimmed = |sky: &SkySetting, by: f32| SkySetting { intensity: sky.intensity * by, ..sky.clone() };
        return Some(if t < 0.5 { dimmed(from, 1.0 - 2.0 * t) } else { dimmed(to, 2.0 * t - 1.0) });
    };
    let turn_deg = shortest_deg(f64::from(to.rotation_deg - from.rotation_deg));
    let rotation_deg = ((f64::from(from.rotation_deg) + f64::from(t) * turn_deg) % TURN_DEG) as f32;
    let intensity = lerp(from.intensity, to.intensity, t);
    let mut sky = SkySetting { file: from.file.clone(), rotation_deg, intensity, sun, map };
    if sky.map.is_none() && sky.sun.is_some() {
        // An analytic sky goes with its sun; angles between two that exist exist, and no file is read.
        super::sky::load(&mut sky, std::path::Path::new("")).ok()?;
    }
    (sky != *as_baked).then_some(sky)
}

/// Between two suns; none if one of them does not exist.
fn sun(a: SunSetting, b: SunSetting, t: f32) -> Option<SunSetting> {
    if a == b {
        return Some(a);
    }
    let (from, to) = (a.position().ok()?, b.position().ok()?);
    let along = f64::from(t);
    let azimuth_deg = from.azimuth_deg + along * shortest_deg(to.azimuth_deg - from.azimuth_deg);
    let place = SunPlace::Angles {
        // Within what a file holds, past north as well.
        azimuth_deg: azimuth_deg.rem_euclid(TURN_DEG),
        elevation_deg: from.elevation_deg + along * (to.elevation_deg - from.elevation_deg),
    };
    let [turbidity, intensity] = [(a.turbidity, b.turbidity), (a.intensity, b.intensity)].map(|(x, y)| lerp(x, y, t));
    Some(SunSetting { place, turbidity, intensity })
}

/// The same turn the shorter way round.
fn shortest_deg(turn: f64) -> f64 {
    (turn + 0.5 * TURN_DEG).rem_euclid(TURN_DEG) - 0.5 * TURN_DEG
}

/// Lamps of one name and kind move; others go out, and come up. Answers as well how those are called that come up beside another one of
/// their name.
fn lamps(a: &[FreeLamp], b: &[FreeLamp], t: f32) -> (Vec<FreeLamp>, Vec<[String; 2]>) {
    let partner = |lamp: &FreeLamp| b.iter().find(|other| other.key == lamp.key && is_alike(lamp, other));
    let dimmed = |lamp: &FreeLamp, by: f32| {
        let setting = LightSetting { intensity: lamp.setting.intensity * by, ..lamp.setting };
        FreeLamp { setting, ..lamp.clone() }
    };
    let (mut lamps, mut renamed): (Vec<FreeLamp>, Vec<[String; 2]>) = (Vec::new(), Vec::new());
    lamps.extend(a.iter().map(|lamp| partner(lamp).map_or_else(|| dimmed(lamp, 1.0 - t), |to| moved(lamp, to, t))));
    for lamp in b.iter().filter(|lamp| !a.iter().any(|from| from.key == lamp.key && is_alike(from, lamp))) {
        let mut new = dimmed(lamp, t);
        while lamps.iter().any(|other| other.key == new.key) || a.iter().any(|other| other.key == new.key) {
            new.key.push_str(NEW);
        }
        if new.key != lamp.key {
            renamed.push([lamp.key.clone(), new.key.clone()]);
        }
        lamps.push(new);
    }
    (lamps, renamed)
}

/// Whether a lamp can become another one.
fn is_alike(a: &FreeLamp, b: &FreeLamp) -> bool {
    let is_same_kind = match (&a.shape, &b.shape) {
        (LampShape::Profile { file }, LampShape::Profile { file: other }) => file == other,
        (a, b) => std::mem::discriminant(a) == std::mem::discriminant(b),
    };
    is_same_kind && a.unit == b.unit
}

fn moved(a: &FreeLamp, b: &FreeLamp, t: f32) -> FreeLamp {
    let strong = |lamp: &FreeLamp| LightSetting { intensity: lamp.setting.intensity * lamp.strength, ..lamp.setting };
    let mut setting = setting(strong(a), strong(b), t, Vec3::ONE);
    // The product of strength and intensity is what is mixed.
    let strength = lerp(a.strength, b.strength, t);
    setting.intensity = if strength > 0.0 { setting.intensity / strength } else { 0.0 };
    let (position, aim) = (a.position.lerp(b.position, t), a.aim.lerp(b.aim, t));
    let mut between = FreeLamp { shape: shape(&a.shape, &b.shape, t), position, aim, strength, setting, ..a.clone() };
    between.turn_rad = between.turn_between([a, b], t);
    between
}

fn shape(a: &LampShape, b: &LampShape, t: f32) -> LampShape {
    match (a, b) {
        (LampShape::Spot { inner_rad, outer_rad }, LampShape::Spot { inner_rad: inner, outer_rad: outer }) => {
            LampShape::Spot { inner_rad: lerp(*inner_rad, *inner, t), outer_rad: lerp(*outer_rad, *outer, t) }
        }
        (LampShape::Rectangle { size_m: [w, h] }, LampShape::Rectangle { size_m: [width, height] }) => {
            LampShape::Rectangle { size_m: [lerp(*w, *width, t), lerp(*h, *height, t)] }
        }
        (LampShape::Disk { radius_m: r }, LampShape::Disk { radius_m: to }) => {
            LampShape::Disk { radius_m: lerp(*r, *to, t) }
        }
        (LampShape::Sphere { radius_m: r }, LampShape::Sphere { radius_m: to }) => {
            LampShape::Sphere { radius_m: lerp(*r, *to, t) }
        }
        (LampShape::Directional { radius_rad: r }, LampShape::Directional { radius_rad: to }) => {
            LampShape::Directional { radius_rad: lerp(*r, *to, t) }
        }
        (same, _) => same.clone(),
    }
}

/// Exposure in stops where both are fixed, else automatic, with what is added to it in stops; white by its reciprocal color
/// temperature. What has no middle changes half way.
fn display(a: &Display, b: &Display, t: f32) -> Display {
    let nearer = if t < 0.5 { a } else { b };
    let white = |display: &Display| display.white.unwrap_or(DISPLAY_WHITE);
    let (x, y) = (white(a), white(b));
    let between = WhitePoint { kelvin: 1.0 / lerp(1.0 / x.kelvin, 1.0 / y.kelvin, t), duv: lerp(x.duv, y.duv, t) };
    let exposure_ev = a.exposure_ev.zip(b.exposure_ev).map(|(x, y)| lerp(x, y, t));
    let white = if a.white == b.white { a.white } else { Some(between) };
    let compensation_ev = lerp(a.compensation_ev, b.compensation_ev, t);
    Display { exposure_ev, compensation_ev, white, ..*nearer }
}

#[cfg(test)]
mod tests {
    use clerestory_relight::{Radiance, Tone, encode};
    use clerestory_transport::basis::{LightSource, SourceKind};
    use clerestory_transport::lamps::LampUnit;
    use clerestory_transport::light::{LightGroup, planckian_tint};
    use clerestory_transport::sky::{Environment, SkyLight};

    use super::*;

    fn basis() -> LightBasis {
        let source = |key: &str, kind, n| LightSource {
            key: key.into(),
            kind,
            columns: 0..n,
            color: Vec3::new(1.0, 0.5, 0.25),
            strength: 8.0,
            origin: Default::default(),
        };
        let panel = SourceKind::Panel { resolution: 4, size_m: [2.0, 1.0] };
        LightBasis::new(vec![source("lamp", SourceKind::Point, 1), source("panel", panel, 16)])
    }

    fn rigs() -> [Look; 2] {
        let [mut a, mut b] = [Look::default(), Look::default()];
        let set = |look: &mut Look, key: &str, setting| look.lights.lights.insert(key.into(), setting);
        set(&mut a, "lamp", LightSetting { intensity: 0.25, color: Some([0.0, 1.0, 3.0]), ..LightSetting::default() });
        set(&mut b, "lamp", LightSetting { intensity: 2.0, kelvin: Some(2700.0), ..LightSetting::default() });
        set(&mut b, "panel", LightSetting { intensity: 0.5, kelvin: Some(4000.0), ..LightSetting::default() });
        let spot = PanelSpot { position: [0.2, 0.3], radius: 0.4, color: None, intensity: 3.0 };
        b.lights.panels.insert("panel".into(), vec![spot, PanelSpot { color: Some([1.0, 0.0, 0.5]), ..spot }]);
        [a, b]
    }

    #[test]
    fn what_does_not_move_is_mixed_linearly() {
        let (basis, [mut a, mut b]) = (basis(), rigs());
        for _ in 0..3 {
            let [from, to] = [&a, &b].map(|look| basis.project(&look.lights));
            for t in [0.1, 0.5, 0.8] {
                let between = basis.project(&fade(&a, &b, t, Some(&basis)).lights);
                for (idx, found) in between.iter().enumerate() {
                    let expected = Vec3::from(from[idx]).lerp(to[idx].into(), t);
                    let off = (Vec3::from(*found) - expected).abs().max_element();
                    assert!(off < 1e-4 * expected.max_element().max(1.0), "{t}, column {idx}: {found:?}, {expected}");
                }
            }
            // Again with lights that go out or come up.
            a.lights.lights.insert("panel".into(), LightSetting { muted: true, ..LightSetting::default() });
            std::mem::swap(&mut a, &mut b);
        }
    }

    #[test]
    fn what_is_dark_at_both_ends_is_dark_between_them() {
        let (muted, down) = (
            LightSetting { muted: true, ..LightSetting::default() },
            LightSetting { intensity: 0.0, ..LightSetting::default() },
        );
        for [a, b] in [[muted, down], [down, muted], [muted, muted], [down, down]] {
            for t in [0.01, 0.5, 0.99] {
                assert_eq!(level(setting(a, b, t, Vec3::ONE)), 0.0, "{a:?}, {b:?} at {t}");
            }
        }
    }

    #[test]
    fn spots_of_an_older_bake_fade_into_a_look_that_can_be_opened() {
        let (mut basis, [a, b]) = (basis(), rigs());
        let spot = PanelSpot { position: [0.5, 500.0], radius: 5000.0, color: None, intensity: 1.0 };
        basis.spots.insert("panel".into(), vec![spot; 3]);
        let between = fade(&a, &b, 0.25, Some(&basis));
        assert_eq!(between.lights.panels["panel"].len(), 3);
        Look::from_json(&between.to_json()).unwrap();
    }

    #[test]
    fn color_temperatures_stay_temperatures_and_mix_by_the_light_of_each() {
        let of = |intensity, kelvin| LightSetting { intensity, kelvin: Some(kelvin), ..LightSetting::default() };
        let half = setting(of(1.0, 2000.0), of(1.0, 6000.0), 0.5, Vec3::ONE);
        assert!((half.kelvin.unwrap() - 3000.0).abs() < 0.1 && half.intensity == 1.0, "{half:?}");
        let mostly_warm = setting(of(9.0, 2000.0), of(1.0, 6000.0), 0.5, Vec3::ONE);
        assert!(mostly_warm.kelvin.unwrap() < 2200.0, "{mostly_warm:?}");
        // What that is against mixing the light itself, per channel of a lamp at luminance 1.
        let exact = (planckian_tint(2000.0) + planckian_tint(6000.0)) / 2.0;
        let off = (planckian_tint(half.kelvin.unwrap()) - exact).abs().max_element();
        assert!(off < 0.22, "{off}");
        // Beyond what light can show the color at the end is that of the nearest, and so is what is on the way to it.
        for (set, shown) in [(500.0, 1667.0), (100_000.0, 25_000.0)] {
            let [set, shown] = [set, shown].map(|kelvin| setting(of(1.0, kelvin), of(1.0, 6000.0), 0.25, Vec3::ONE));
            assert_eq!(set, shown);
        }
    }

    #[test]
    fn lamps_move_and_others_come_and_go() {
        let lamp = |key: &str, shape, strength| FreeLamp {
            key: key.into(),
            shape,
            position: Vec3::ZERO,
            aim: Vec3::X,
            strength,
            unit: LampUnit::Lumen,
            setting: LightSetting::default(),
            turn_rad: 0.0,
            replaces: None,
        };
        let [mut a, mut b] = [Look::default(), Look::default()];
        let there = FreeLamp { position: Vec3::Y * 4.0, ..lamp("s", LampShape::Disk { radius_m: 3.0 }, 300.0) };
        a.lights.lamps = vec![lamp("s", LampShape::Disk { radius_m: 1.0 }, 100.0), lamp("x", LampShape::Point, 10.0)];
        b.lights.lamps =
            vec![there, lamp("x", LampShape::Directional { radius_rad: 0.0 }, 10.0), lamp("y", LampShape::Point, 10.0)];
        let quarter = fade(&a, &b, 0.25, None).lights.lamps;
        let told: Vec<_> = quarter.iter().map(|l| (l.key.as_str(), l.strength * l.setting.intensity)).collect();
        assert_eq!(told, [("s", 150.0), ("x", 7.5), ("x (new)", 2.5), ("y", 2.5)]);
        assert_eq!((quarter[0].position, &quarter[0].shape), (Vec3::Y, &LampShape::Disk { radius_m: 1.5 }));
        assert_eq!(fade(&a, &b, 0.0, None), a);
        assert_eq!(fade(&a, &b, 1.0, None), b);
        // A group of both looks is one of the lamp that goes out and of the one that comes up.
        for look in [&mut a, &mut b] {
            let lights = ["x".to_owned()].into();
            look.lights.groups.insert("work".into(), LightGroup { lights, intensity: 0.5, muted: false });
        }
        let lit = fade(&a, &b, 0.75, None).lights.lit_lamps();
        let told: Vec<_> = lit[1..3].iter().map(|l| (l.key.as_str(), l.setting.intensity)).collect();
        assert_eq!(told, [("x", 0.125), ("x (new)", 0.375)]);
    }

    #[test]
    fn suns_move_the_shorter_way_and_maps_change_in_the_dark() {
        let at = |azimuth, elevation| SkySetting {
            sun: Some(SunSetting::by_angles(azimuth, elevation)),
            ..SkySetting::default()
        };
        let plain = SkySetting::default();
        let between = sky([Some(&at(350.0, 40.0)), Some(&at(20.0, 20.0))], 0.5, &plain).unwrap();
        let place = between.sun.unwrap().place;
        assert_eq!(place, SunPlace::Angles { azimuth_deg: 5.0, elevation_deg: 30.0 });
        assert!(between.map.is_some(), "its sky comes with it");
        let past_north = LightRig { sky: Some(between), ..LightRig::default() };
        Look::from_json(&Look { lights: past_north, ..Look::default() }.to_json()).expect("a look that can be opened");
        let file = SkySetting { file: Some("a.hdr".into()), intensity: 2.0, ..SkySetting::default() };
        let steps = [0.25, 0.75].map(|t| sky([Some(&file), None], t, &plain).unwrap());
        assert_eq!((steps[0].file.as_deref(), steps[0].intensity), (Some("a.hdr"), 1.0));
        assert_eq!((steps[1].file.as_deref(), steps[1].intensity), (None, 0.5));
        let turned = SkySetting { rotation_deg: 350.0, ..SkySetting::default() };
        assert_eq!(sky([None, Some(&turned)], 0.5, &plain).unwrap().rotation_deg, -5.0);
        // At the ends of what a file holds, between two looks and in the file of what lies there.
        let far = [3600.0, 20.0].map(|rotation_deg| SkySetting { rotation_deg, ..at(350.0, 40.0) });
        let [from, mut to] =
            far.map(|sky| Look { lights: LightRig { sky: Some(sky), ..LightRig::default() }, ..Look::default() });
        to.lights.sky.iter_mut().for_each(|sky| sky.sun = at(20.0, 40.0).sun);
        let (again, _) = Look::from_json(&fade(&from, &to, 0.5, None).to_json()).unwrap();
        let again = again.lights.sky.unwrap();
        assert_eq!(again.rotation_deg, 10.0);
        assert_eq!(again.sun.unwrap().place, SunPlace::Angles { azimuth_deg: 5.0, elevation_deg: 40.0 });
        assert_eq!(sky([None; 2], 0.5, &plain), None);
    }

    #[test]
    fn a_look_without_a_sky_fades_from_how_the_sky_was_baked() {
        let map = Environment::uniform(Vec3::ONE);
        let baked = SkyLight { rotation_deg: 75.0, intensity: 2.5, ..SkyLight::new("day.hdr", map) };
        let basis = LightBasis { sky: Some(baked), ..basis() };
        let with = |sky: SkySetting| {
            let lights = LightRig { sky: Some(sky), ..LightRig::default() };
            Look { lights, ..Look::default() }
        };
        let dim = SkySetting { rotation_deg: 75.0, intensity: 0.5, ..SkySetting::default() };
        let half = |to: &Look, share| fade(&Look::default(), to, share, Some(&basis)).lights.sky;
        // Half way from 2.5 to 0.5, and not turned on the way.
        assert_eq!(half(&with(dim.clone()), 0.5), Some(SkySetting { intensity: 1.5, ..dim }));
        // Another map: the baked sky goes out first, turned as it is.
        let other = SkySetting { file: Some("b.hdr".into()), ..SkySetting::default() };
        let going = half(&with(other), 0.25).unwrap();
        assert_eq!((going.file, going.rotation_deg, going.intensity), (None, 75.0, 1.25));
        assert_eq!(half(&Look::default(), 0.5), None);
    }

    #[test]
    fn white_balance_comes_up_from_colors_as_they_are() {
        let gray = Radiance { width: 1, height: 1, pixels: vec![[0.5; 3]] };
        let shown = |display: Display| encode(&gray, &display.metered(&gray));
        let plain = Display { exposure_ev: Some(0.0), tone: Tone::Linear, ..Display::default() };
        let warm = Display { white: Some(WhitePoint { kelvin: 3000.0, duv: 0.0 }), ..plain };
        for between in [display(&plain, &warm, 1e-3), display(&warm, &plain, 1.0 - 1e-3)] {
            let (just, before) = (shown(between), shown(plain));
            assert!(just.iter().zip(&before).all(|(a, b)| a.abs_diff(*b) <= 1), "{just:?} is not {before:?}");
        }
    }

    #[test]
    fn exposure_and_white_go_in_stops_and_mireds() {
        let of = |ev, kelvin| Display {
            exposure_ev: Some(ev),
            white: Some(WhitePoint { kelvin, duv: 0.0 }),
            ..Display::default()
        };
        let half = display(&of(1.0, 3000.0), &of(-2.0, 6000.0), 0.5);
        assert!((half.exposure_ev.unwrap() + 0.5).abs() < 1e-6 && (half.white.unwrap().kelvin - 4000.0).abs() < 0.1);
        let automatic = display(&of(1.0, 3000.0), &Display::default(), 0.5);
        assert_eq!(automatic.exposure_ev, None);
        let night = Display { compensation_ev: -2.0, ..Display::default() };
        assert_eq!(display(&Display::default(), &night, 0.25).compensation_ev, -0.5);
    }
}
