//! Lamps of a look, checked and ready to shine.

use std::collections::HashMap;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{Vec2, Vec3};
use thiserror::Error;

use super::body::{Body, least_size_m};
use super::light::{Form, Lamp};
use super::units::{lumen_per_candela, native_strength};
use super::{FreeLamp, LampShape, LampUnit};
use crate::clearance::{offset_origin, rounding};
use crate::import::read_profile;
use crate::patches::PatchSample;
use crate::path::passed_along;
use crate::photometry::PhotometricProfile;
use crate::prepared::PreparedScene;
use crate::scene::PunctualLight;
use crate::slabs::{IN_A_ROW, most_in_a_row};

/// Why a lamp cannot shine.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LampError {
    /// A unit that this kind of lamp does not have.
    #[error("lamp `{key}` counts in {unit}, which a {kind} lamp cannot have; give its strength in {known}")]
    Unit {
        /// Name of the lamp.
        key: String,
        /// Unit asked for.
        unit: &'static str,
        /// Kind of lamp.
        kind: &'static str,
        /// Units that it can have.
        known: String,
    },
    /// A number that is none or lies out of range.
    #[error("the {what} of lamp `{key}` is {value}; give {range}")]
    Value {
        /// Name of the lamp.
        key: String,
        /// What is wrong.
        what: &'static str,
        /// As it is.
        value: f32,
        /// What is possible.
        range: &'static str,
    },
    /// A measured distribution that cannot be had.
    #[error("lamp `{key}` cannot shine as {file} measures: {reason}")]
    Profile {
        /// Name of the lamp.
        key: String,
        /// Path as the look has it.
        file: String,
        /// Why.
        reason: String,
    },
    /// Two lamps of one name.
    #[error("two lamps of the look are called `{key}`; give one of them another key")]
    Twice {
        /// The name.
        key: String,
    },
    /// A lamp with the name of a light of the scene.
    #[error("a light of the scene is called `{key}`, as a lamp of the look is; give the lamp another key")]
    Taken {
        /// The name.
        key: String,
    },
}

/// Something to know about a lamp that makes sense.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LampWarning {
    /// It sends no light, although it has a strength; and why.
    Dark(String),
    /// It shines, otherwise than somebody may expect.
    Remark(String),
}

impl LampWarning {
    /// What it says.
    pub fn into_words(self) -> String {
        let (LampWarning::Dark(words) | LampWarning::Remark(words)) = self;
        words
    }
}

/// Measured distributions that were read, by the paths of their files: a lamp that is prepared again and again, as it moves, needs its
/// file once. What could not be read is tried again.
#[derive(Clone, Debug, Default)]
pub struct KeptProfiles {
    read: HashMap<PathBuf, Arc<PhotometricProfile>>,
}

impl KeptProfiles {
    fn get(&mut self, path: &Path) -> Result<Arc<PhotometricProfile>, String> {
        if let Some(kept) = self.read.get(path) {
            return Ok(kept.clone());
        }
        let profile = Arc::new(read_profile(path)?);
        self.read.insert(path.to_owned(), profile.clone());
        Ok(profile)
    }
}

/// Lamps that can be asked what they send where.
#[derive(Clone, Debug, Default)]
pub struct PreparedLamps {
    lamps: Vec<PreparedLamp>,
}

/// A lamp with its strength.
#[derive(Clone, Debug)]
pub(crate) struct PreparedLamp {
    pub(crate) key: String,
    pub(crate) lamp: Lamp,
    /// Candela, lux or nit per channel.
    pub(crate) emission: Vec3,
    /// As the look has it, where it has a body.
    asked: Option<FreeLamp>,
}

/// Farthest place from the origin, and largest size, m.
const FARTHEST_M: f32 = 1e6;
/// Greatest strength in the lamp's own unit.
const STRONGEST: f32 = 1e12;
/// Turns about the aim either way, degrees, with room for rounding.
const MOST_TURN_DEG: f32 = 360.001;
/// Angle under which parallel light is seen, from rim to rim, degrees, with room for rounding.
const MOST_ANGLE_DEG: f32 = 90.001;
/// Points of a lamp with a size of which irradiance is the mean: as many as a fan has.
const POINTS: usize = 16;
/// The same for places that are few and read one by one, by strata along both sides of the lamp.
const STRATA: usize = 256;
/// The same of a lamp that is seen under a small angle: of many patches few see part of it.
const FEW_POINTS: usize = 4;

/// How the points are spread of which the light of a lamp with a size is the mean.
#[derive(Clone, Copy, Debug)]
enum Spread {
    /// So many of a fixed pattern, [`POINTS`] at most.
    Lattice(usize),
    /// The middle of each of [`STRATA`] parts, by the lengths of the sides.
    Strata,
}

impl Spread {
    fn n_points(self) -> usize {
        match self {
            Spread::Lattice(n_points) => n_points,
            Spread::Strata => STRATA,
        }
    }
}

impl PreparedLamps {
    /// Checks lamps and converts their units; those that are dark are left out, and of muted ones no file is read. Paths of
    /// distributions count from `folder`. Returns warnings in words beside it.
    ///
    /// # Errors
    /// A lamp whose numbers make no sense, by its name.
    pub fn new(lamps: &[FreeLamp], folder: Option<&Path>) -> Result<(PreparedLamps, Vec<String>), LampError> {
        let (mut prepared, mut warnings, mut kept) = (PreparedLamps::default(), Vec::new(), KeptProfiles::default());
        for (nth, lamp) in lamps.iter().enumerate() {
            if lamps[..nth].iter().any(|other| other.key == lamp.key) {
                return Err(LampError::Twice { key: lamp.key.clone() });
            }
            prepared.lamps.extend(prepare(lamp, folder, &mut kept, &mut warnings)?);
        }
        Ok((prepared, warnings.into_iter().map(LampWarning::into_words).collect()))
    }

    /// A single lamp, as [`PreparedLamps::new`] prepares it, by a profile that is kept if there is one; warnings tell whether it is dark.
    ///
    /// # Errors
    /// If its numbers make no sense, or its profile cannot be read.
    pub fn of(lamp: &FreeLamp, kept: &mut KeptProfiles) -> Result<(PreparedLamps, Vec<LampWarning>), LampError> {
        let mut warnings = Vec::new();
        let lamps = prepare(lamp, None, kept, &mut warnings)?.into_iter().collect();
        Ok((PreparedLamps { lamps }, warnings))
    }

    /// Those of some lamps that can shine, and why each of the others cannot: a file may be gone.
    pub fn able(lamps: &[FreeLamp], folder: Option<&Path>) -> (PreparedLamps, Vec<LampError>) {
        let (mut able, mut errors, mut kept) = (PreparedLamps::default(), Vec::new(), KeptProfiles::default());
        for lamp in lamps {
            match prepare(lamp, folder, &mut kept, &mut Vec::new()) {
                Ok(lamp) => able.lamps.extend(lamp),
                Err(error) => errors.push(error),
            }
        }
        (able, errors)
    }

    /// The same lamps in a scene: where that is small, bodies may be smaller than in a room, with the same flux. See [`least_size_m`].
    #[must_use]
    pub fn in_scene(mut self, scene: &PreparedScene) -> PreparedLamps {
        let least_m = least_size_m(scene);
        self.lamps.iter_mut().for_each(|lamp| lamp.fit(least_m));
        self
    }

    /// Whether no lamp shines.
    pub fn is_empty(&self) -> bool {
        self.lamps.is_empty()
    }

    /// What the lamp of that name shines with, per channel: candela along its axis (of a profile its largest), lux of parallel
    /// light, nit of a body. `None` where it is dark.
    pub fn emission(&self, key: &str) -> Option<Vec3> {
        self.lamps.iter().find(|lamp| lamp.key == key).map(|lamp| lamp.emission)
    }

    /// Those that shine.
    pub(crate) fn lamps(&self) -> &[PreparedLamp] {
        &self.lamps
    }

    /// What the lamps send straight to a place on a surface, past everything in the way: illuminance per channel in lux.
    /// The same for the same question. Faces of solid panes count as `bounces`, of which there is no limit by `None`.
    pub fn irradiance(&self, scene: &PreparedScene, position: Vec3, normal: Vec3, bounces: Option<u32>) -> Vec3 {
        self.irradiance_by(scene, (position, normal), bounces, Spread::Strata)
    }

    /// The same by few points of each lamp, for very many places.
    pub(crate) fn rough_irradiance(&self, scene: &PreparedScene, place: (Vec3, Vec3), bounces: Option<u32>) -> Vec3 {
        self.irradiance_by(scene, place, bounces, Spread::Lattice(POINTS))
    }

    fn irradiance_by(
        &self,
        scene: &PreparedScene,
        (position, normal): (Vec3, Vec3),
        bounces: Option<u32>,
        spread: Spread,
    ) -> Vec3 {
        let most_slabs = most_in_a_row(bounces.unwrap_or(u32::MAX));
        let place = Place { most_slabs, ..Place::new(scene, position, normal) };
        self.lamps.iter().map(|lamp| lamp.emission * lamp.arriving(scene, &place, spread, |_| 1.0)).sum()
    }

    /// The same on a point of a patch past so many solid panes at most, light of each direction by what its surface makes of it.
    pub(crate) fn light_on(&self, scene: &PreparedScene, sample: &PatchSample, most_slabs: usize) -> Vec3 {
        self.lamps.iter().map(|lamp| lamp.light_on(scene, sample, most_slabs)).sum()
    }
}

/// How far rays begin from a place on a surface that is not known, relative to its coordinates within the scene and in meters.
const LEAVING: f32 = 1e-5;

/// How far along a direction rays that leave a place begin, so that they do not meet a surface on which it may lie, m.
pub(super) fn leaving(position: Vec3, along: Vec3, extent: f32) -> f32 {
    LEAVING * (1.0 + position.abs().max_element().min(extent)) + rounding(position, along, extent)
}

/// A place that asks for light.
struct Place {
    position: Vec3,
    normal: Vec3,
    /// Where its rays begin.
    origin: Vec3,
    /// A distance beyond all surfaces, m.
    far: f32,
    /// Most slabs that light may pass on its way.
    most_slabs: usize,
}

impl Place {
    fn new(scene: &PreparedScene, position: Vec3, normal: Vec3) -> Place {
        let extent = scene.extent();
        let clear = position + normal * leaving(position, normal, extent);
        let origin = offset_origin(clear, normal, extent);
        Place { position, normal, origin, far: scene.far(), most_slabs: IN_A_ROW }
    }
}

impl PreparedLamp {
    /// Gives its body the size that the look asks for, but no side or diameter of less than so much, m.
    fn fit(&mut self, least_m: f32) {
        let Some((body, _)) = self.asked.as_ref().and_then(|lamp| Body::no_less(lamp, least_m)) else { return };
        if let Form::Body(before) = &mut self.lamp.form {
            self.emission *= before.area() / body.area();
            *before = body;
        }
    }

    /// See [`PreparedLamps::light_on`].
    pub(super) fn light_on(&self, scene: &PreparedScene, sample: &PatchSample, most_slabs: usize) -> Vec3 {
        let place = Place { most_slabs, ..Place::new(scene, sample.position, sample.normal) };
        let n_points = if self.lamp.is_small_at(sample.position) { FEW_POINTS } else { POINTS };
        self.emission * self.arriving(scene, &place, Spread::Lattice(n_points), |cos| sample.response(cos))
    }

    /// Illuminance at emission 1, light of each direction times a response to its cosine; of a lamp with a size by some of its points.
    fn arriving(&self, scene: &PreparedScene, place: &Place, spread: Spread, response: impl Fn(f32) -> f32) -> Vec3 {
        let straight = self.arriving_straight(scene, place, spread, &response);
        if scene.slabs.is_empty() || place.most_slabs == 0 {
            return straight;
        }
        straight + self.arriving_through_slabs(scene, place, spread, &response)
    }

    /// What of it comes through solid panes, which shift it.
    fn arriving_through_slabs(
        &self,
        scene: &PreparedScene,
        &Place { position, normal, origin, far, most_slabs }: &Place,
        spread: Spread,
        response: impl Fn(f32) -> f32,
    ) -> Vec3 {
        let n_points = if self.lamp.has_size() { spread.n_points() } else { 1 };
        let of_point = |nth: usize| {
            let u = self.point_of(nth, spread);
            let way = self.lamp.through(&scene.slabs, (position, far), u, |wi| wi.dot(normal) > 0.0).way?;
            if way.route.slabs().len() > most_slabs {
                return None;
            }
            let lit = self.lamp.lit_along(&way, position, u, far)?;
            let cos = lit.wi.dot(normal);
            let value = lit.factor * cos * response(cos);
            let passed = || passed_along(scene, (position, origin), Vec3::ZERO, (&way.route, way.end, far));
            (cos > 0.0).then(|| passed() * value)
        };
        (0..n_points).filter_map(of_point).sum::<Vec3>() / n_points as f32
    }

    /// One of the points of the unit square which stand for points of the lamp. A disk far away looks alike from everywhere: there
    /// they have even steps from its middle to its rim, which bring a surface that faces it all of its lux.
    fn point_of(&self, nth: usize, spread: Spread) -> Vec2 {
        match spread {
            Spread::Strata => stratum(nth, self.lamp.aspect()),
            Spread::Lattice(n_points) => {
                let u = lattice(nth as u32);
                if self.lamp.is_beyond() { Vec2::new((nth as f32 + 0.5) / n_points as f32, u.y) } else { u }
            }
        }
    }

    /// What of it comes straight.
    fn arriving_straight(
        &self,
        scene: &PreparedScene,
        place: &Place,
        spread: Spread,
        response: impl Fn(f32) -> f32,
    ) -> Vec3 {
        let &Place { position, normal, origin, far, .. } = place;
        if !self.lamp.has_size() {
            let Some(lit) = self.lamp.lit(position, Vec2::ZERO, far) else { return Vec3::ZERO };
            let cos = lit.wi.dot(normal);
            let value = lit.factor * cos * response(cos);
            return if cos > 0.0 { scene.transmittance(origin, lit.target) * value } else { Vec3::ZERO };
        }
        let (n_points, mut sum) = (spread.n_points(), Vec3::ZERO);
        for first in (0..n_points).step_by(POINTS) {
            let (mut targets, mut values, mut n) = ([Vec3::ZERO; POINTS], [0.0; POINTS], 0);
            for nth in first..n_points.min(first + POINTS) {
                let u = self.point_of(nth, spread);
                let lit = match spread {
                    Spread::Lattice(_) => self.lamp.lit_well(position, u, far),
                    Spread::Strata => self.lamp.lit_by_strata(position, u, far),
                };
                let Some(lit) = lit else { continue };
                let cos = lit.wi.dot(normal);
                if cos > 0.0 {
                    (targets[n], values[n]) = (lit.target, lit.factor * cos * response(cos));
                    n += 1;
                }
            }
            let mut passed = [Vec3::ZERO; POINTS];
            if n > 0 {
                scene.transmittance16(origin, &targets, n, &mut passed);
            }
            sum += (0..n).map(|i| passed[i] * values[i]).sum::<Vec3>();
        }
        sum / n_points as f32
    }
}

/// Points of the unit square that are far apart. \[Roberts2018\]
pub(crate) fn lattice(nth: u32) -> Vec2 {
    const STEP: [u32; 2] = [0xC13F_A9A9, 0x91E1_0DA5];
    let unit = |step: u32| (nth.wrapping_mul(step).wrapping_add(1 << 31) >> 8) as f32 / 16_777_216.0;
    Vec2::new(unit(STEP[0]), unit(STEP[1]))
}

/// One of [`STRATA`] points of the unit square, which stands for an area `aspect` times as wide as it is high: the middles of cells that are
/// about square there. Points anywhere within their cells bring ten times the error where nothing is in the way.
fn stratum(nth: usize, aspect: f32) -> Vec2 {
    let most = STRATA.ilog2() as f32;
    let n_across = 1_usize << (0.5 * (most + aspect.log2())).round().clamp(0.0, most) as u32;
    let n_down = STRATA / n_across;
    let (column, row) = (nth % n_across, nth / n_across);
    let middle = |cell: usize, n_cells: usize| (cell as f32 + 0.5) / n_cells as f32;
    Vec2::new(middle(column, n_across), middle(row, n_down))
}

fn prepare(
    lamp: &FreeLamp,
    folder: Option<&Path>,
    kept: &mut KeptProfiles,
    warnings: &mut Vec<LampWarning>,
) -> Result<Option<PreparedLamp>, LampError> {
    check(lamp)?;
    if lamp.setting.muted {
        return Ok(None);
    }
    let profile = match &lamp.shape {
        LampShape::Profile { file } => Some(profile(lamp, file, folder, kept)?),
        _ => None,
    };
    for remark in profile.iter().flat_map(|profile| profile.remarks()) {
        warnings.push(LampWarning::Remark(format!("lamp `{}`: {remark}", lamp.key)));
    }
    let body = Body::of(lamp);
    let strength = native_strength(lamp, body.as_ref().map(|(body, area)| (body, *area)), profile.as_deref())?;
    let emission = lamp.setting.emission(Vec3::ONE, strength as f32);
    if !emission.is_finite() || emission.min_element() < 0.0 || emission.max_element() > f32::MAX.sqrt() {
        let value = emission.max_element();
        return Err(value_error(lamp, "strength with its color and intensity", value, "what can be shown"));
    }
    if lamp.unit == LampUnit::Nit && lamp.strength > 0.0 && body.is_some_and(|(_, area_m2)| area_m2 <= 0.0) {
        warnings.push(LampWarning::Dark(format!(
            "lamp `{}` has no area, so that it sends no light by its nit; give it a size, or its strength in lm or cd",
            lamp.key
        )));
    }
    if lamp.aim == lamp.position && lamp.shape.is_aimed() {
        warnings.push(LampWarning::Remark(format!("lamp `{}` aims at itself; it shines down", lamp.key)));
    }
    let [right, up, ahead] = lamp.frame();
    let form = match (&lamp.shape, body) {
        (_, Some((body, _))) => Form::Body(body),
        (LampShape::Directional { radius_rad }, _) => {
            Form::Distant { direction: ahead, one_minus_cos: 2.0 * (0.5 * *radius_rad).sin().powi(2) }
        }
        (shape, None) => {
            let kind = shape.without_size();
            let light = PunctualLight {
                node: 0,
                kind,
                position: lamp.position,
                direction: ahead,
                across: [right, up],
                profile: profile.as_ref().map(|_| 0),
                color: Vec3::ONE,
                intensity: 1.0,
                radius_rad: 0.0,
            };
            let spread = (lumen_per_candela(kind, profile.as_deref()) / PI).sqrt().min(1.0) as f32;
            Form::Point { light, profile, spread }
        }
    };
    let shines = emission != Vec3::ZERO;
    let asked = body.is_some().then(|| lamp.clone());
    Ok(shines.then(|| PreparedLamp { key: lamp.key.clone(), lamp: Lamp { form }, emission, asked }))
}

fn value_error(lamp: &FreeLamp, what: &'static str, value: f32, range: &'static str) -> LampError {
    LampError::Value { key: lamp.key.clone(), what, value, range }
}

fn check(lamp: &FreeLamp) -> Result<(), LampError> {
    let within = |what, value: f32, [low, high]: [f32; 2], range| {
        if (low..=high).contains(&value) { Ok(()) } else { Err(value_error(lamp, what, value, range)) }
    };
    let place = [-FARTHEST_M, FARTHEST_M];
    for value in lamp.position.to_array() {
        within("position", value, place, "meters up to 1000000 from the origin")?;
    }
    for value in lamp.aim.to_array() {
        within("aim", value, place, "meters up to 1000000 from the origin")?;
    }
    within("turn", lamp.turn_rad.to_degrees(), [-MOST_TURN_DEG, MOST_TURN_DEG], "degrees from -360 to 360")?;
    within("strength", lamp.strength, [0.0, STRONGEST], "a number from 0 to 1e12")?;
    let size = |what, value| within(what, value, [0.0, FARTHEST_M], "meters from 0 to 1000000");
    match lamp.shape {
        LampShape::Spot { inner_rad, outer_rad } => {
            within("outer angle", outer_rad, [0.0, std::f32::consts::PI], "0 to 180 degrees")?;
            within("inner angle", inner_rad, [0.0, outer_rad], "0 degrees to the outer angle")
        }
        LampShape::Rectangle { size_m: [width, height] } => size("width", width).and_then(|()| size("height", height)),
        LampShape::Disk { radius_m } | LampShape::Sphere { radius_m } => size("radius", radius_m),
        LampShape::Directional { radius_rad } => {
            within("angle", 2.0 * radius_rad.to_degrees(), [0.0, MOST_ANGLE_DEG], "degrees from 0 to 90")
        }
        LampShape::Point | LampShape::Profile { .. } => Ok(()),
    }
}

fn profile(
    lamp: &FreeLamp,
    file: &str,
    folder: Option<&Path>,
    kept: &mut KeptProfiles,
) -> Result<Arc<PhotometricProfile>, LampError> {
    let path = folder.map_or_else(|| Path::new(file).to_owned(), |folder| folder.join(file));
    let failed = |reason| LampError::Profile { key: lamp.key.clone(), file: file.to_owned(), reason };
    kept.get(&path).map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lamps::tests::lamp;

    #[test]
    fn a_lamp_that_cannot_shine_leaves_the_others_as_they_are() {
        let gone = FreeLamp { key: "gone".into(), ..lamp(LampShape::Profile { file: "none.ies".into() }) };
        let (able, errors) = PreparedLamps::able(&[gone, lamp(LampShape::Point)], None);
        assert!(able.emission("lamp").is_some() && able.emission("gone").is_none());
        assert!(matches!(&errors[..], [LampError::Profile { key, .. }] if key == "gone"), "{errors:?}");
    }

    #[test]
    fn lamps_of_one_key_are_told_to_get_another_and_no_other_name() {
        let error = PreparedLamps::new(&[lamp(LampShape::Point), lamp(LampShape::Point)], None).expect_err("one key");
        assert!(matches!(&error, LampError::Twice { key } if key == "lamp"), "{error:?}");
        assert!(error.to_string().ends_with("give one of them another key"), "{error}");
    }

    #[test]
    fn a_body_without_area_that_counts_in_nit_is_told_to_be_dark() {
        let told = |shape: LampShape, unit: LampUnit| {
            let (lamps, warnings) = PreparedLamps::new(&[FreeLamp { unit, ..lamp(shape) }], None).expect("a lamp");
            assert!(warnings.iter().all(|words| words.contains("`lamp` has no area")), "{warnings:?}");
            (lamps.is_empty(), warnings.len())
        };
        let (line, none) = (LampShape::Rectangle { size_m: [1.2, 0.0] }, LampShape::Sphere { radius_m: 0.0 });
        for shape in [&line, &none] {
            assert_eq!(told(shape.clone(), LampUnit::Nit), (true, 1));
            assert_eq!(told(shape.clone(), LampUnit::Candela), (false, 0));
        }
        assert_eq!(told(LampShape::Disk { radius_m: 0.1 }, LampUnit::Nit), (false, 0));
    }

    #[test]
    fn in_a_model_of_centimeters_a_body_is_as_small_as_the_look_has_it() {
        let scene = |scale: f32| {
            let room = include_str!("../../../editor/tests/room.gltf");
            let mut scene = crate::import::load_bytes("room", room.as_bytes()).expect("a scene").scene;
            scene.mesh.positions.iter_mut().for_each(|position| *position *= scale);
            PreparedScene::new(scene, &[]).expect("it has no panels").0
        };
        let (room, model) = (scene(1.0), scene(0.01));
        for (shape, in_room_m, in_model_m) in [
            (LampShape::Sphere { radius_m: 1e-3 }, 2.5e-3, 1e-3),
            (LampShape::Disk { radius_m: 1e-3 }, 2.5e-3, 1e-3),
            (LampShape::Disk { radius_m: 0.0 }, 2.5e-3, 0.5 * least_size_m(&model)),
            (LampShape::Sphere { radius_m: 0.1 }, 0.1, 0.1),
        ] {
            let lamp = FreeLamp { unit: LampUnit::Lumen, strength: 100.0, ..lamp(shape) };
            for (scene, expected_m) in [(&room, in_room_m), (&model, in_model_m)] {
                let lamps = PreparedLamps::new(std::slice::from_ref(&lamp), None).expect("a lamp").0.in_scene(scene);
                let shining = &lamps.lamps()[0];
                let body = shining.lamp.body().expect("it has one");
                let (radius_m, lumen) = (body.ball().1, std::f32::consts::PI * body.area() * shining.emission.x);
                assert!((radius_m / expected_m - 1.0).abs() < 1e-5, "{lamp:?}: {radius_m} m, not {expected_m}");
                assert!((lumen - 100.0).abs() < 1e-2, "{lamp:?} sends {lumen} lm");
            }
        }
        assert!(least_size_m(&model) < 1e-4);
    }

    #[test]
    fn only_a_lamp_without_light_is_called_dark() {
        let flat = FreeLamp { unit: LampUnit::Nit, ..lamp(LampShape::Disk { radius_m: 0.0 }) };
        let of = |lamp: FreeLamp| PreparedLamps::of(&lamp, &mut KeptProfiles::default()).expect("a lamp");
        let (lamps, warnings) = of(FreeLamp { aim: flat.position, ..flat });
        let is_told = matches!(&warnings[..], [LampWarning::Dark(_), LampWarning::Remark(_)]);
        assert!(lamps.is_empty() && is_told, "{warnings:?}");
        let down = lamp(LampShape::Disk { radius_m: 0.1 });
        let (lamps, warnings) = of(FreeLamp { aim: down.position, ..down });
        assert!(!lamps.is_empty() && matches!(&warnings[..], [LampWarning::Remark(_)]), "{warnings:?}");
    }
}
