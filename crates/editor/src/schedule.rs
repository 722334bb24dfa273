//! A schedule of luminaires: every lamp with its flux, power, place and color, or every type of lamp with how many there are of it,
//! and what they sum up to.

// What is read here was written by strangers, so no integer may wrap in silence.
#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]
#![cfg_attr(not(test), deny(clippy::cast_possible_truncation, clippy::cast_sign_loss))]

mod csv;
mod types;

use std::path::Path;

use clerestory_transport::basis::{LightBasis, LightSource, SourceKind};
use clerestory_transport::emitters::Emitter;
use clerestory_transport::import::read_profile;
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit};
use clerestory_transport::light::{LightSetting, PanelSpot, luminance};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::PunctualKind;
use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::look::Look;
use crate::panels::lamps::kind_words;
use crate::panels::lights::source_words;

pub use types::LuminaireType;

/// What has a row of its own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ScheduleBy {
    /// Every lamp.
    #[default]
    Lamp,
    /// Lamps of one kind, distribution, flux, power and color together.
    Type,
}

/// Where a power comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum WattSource {
    /// The file of the measured distribution.
    Profile,
    /// The flux, by the efficacy that was set.
    Efficacy,
}

/// A lamp of the schedule.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Luminaire {
    /// Key in looks.
    pub key: String,
    /// What it is called.
    pub name: String,
    /// What it is, for people.
    pub kind: String,
    /// Whether it shines.
    pub is_on: bool,
    /// Luminous flux in lumen, as it is set; `None` where that does not follow from what it is.
    pub lumen: Option<f64>,
    /// Name of the file of its measured distribution.
    pub profile: Option<String>,
    /// Power in watt: what the profile states, however far the lamp is dimmed, or else the flux by the efficacy; `None` where
    /// neither is known.
    pub watt: Option<f64>,
    /// Where the power comes from.
    pub watt_source: Option<WattSource>,
    /// World-space position in meters, if it is anywhere.
    pub position: Option<Vec3>,
    /// World-space unit direction that it shines in, if in one.
    pub direction: Option<Vec3>,
    /// Correlated color temperature that it is set to.
    pub kelvin: Option<f32>,
    /// Linear Rec. 709 color.
    pub color: Vec3,
    /// Why its measured distribution cannot be had, in words.
    #[serde(skip)]
    pub unreadable: Option<String>,
}

/// All lamps, and what they sum up to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Schedule {
    /// Lamps, those of the scene first.
    pub luminaires: Vec<Luminaire>,
    /// Lumen per watt that the power of lamps follows from whose profile states none; without it that stays unknown.
    pub efficacy_lm_w: Option<f64>,
    /// Floor area in m², if it is known.
    pub floor_m2: Option<f64>,
}

impl Schedule {
    /// Of the lights of a basis and the free lamps of a look; the scene tells where lamps aim.
    pub fn new(
        basis: &LightBasis,
        scene: Option<&PreparedScene>,
        look: &Look,
        efficacy_lm_w: Option<f64>,
        floor_m2: Option<f64>,
    ) -> Schedule {
        let is_lamp = |source: &&LightSource| {
            !matches!(
                source.kind,
                SourceKind::Constant
                    | SourceKind::Image
                    | SourceKind::Sky
                    | SourceKind::Dome { .. }
                    | SourceKind::Sun { .. }
            )
        };
        let of_source = |source: &LightSource| {
            let setting = look.lights.light_setting(&source.key);
            let emitter = scene.and_then(|scene| {
                let nth = scene.lighting.basis.sources.iter().position(|own| own.key == source.key)?;
                scene.lighting.emitters.get(nth)
            });
            Luminaire {
                key: source.key.clone(),
                name: look.name_of(&source.key).to_owned(),
                kind: source_words(source.kind),
                is_on: is_on(&setting),
                lumen: source_lumen(source, &setting, basis.spots_of(&look.lights, &source.key)),
                profile: source.origin.profile.clone(),
                watt: source.origin.watts.map(f64::from),
                watt_source: None,
                position: source.origin.position,
                direction: emitter.and_then(direction),
                kelvin: setting.kelvin,
                color: setting.tint(source.color),
                unreadable: None,
            }
        };
        let lamps = look.lights.lit_lamps();
        let mut luminaires: Vec<Luminaire> = basis.sources.iter().filter(is_lamp).map(of_source).collect();
        luminaires.extend(lamps.iter().map(|lamp| of_lamp(lamp, look)));
        for luminaire in &mut luminaires {
            luminaire.settle_watt(efficacy_lm_w);
        }
        Schedule { luminaires, efficacy_lm_w, floor_m2 }
    }

    /// Lumen of all that shine and tell it.
    pub fn lumen(&self) -> f64 {
        self.shining().filter_map(|luminaire| luminaire.lumen).sum::<f64>() + 0.0
    }

    /// Watt of all that shine and tell it.
    pub fn watt(&self) -> f64 {
        // Plus zero: a sum of nothing is a negative one.
        self.shining().filter_map(|luminaire| luminaire.watt).sum::<f64>() + 0.0
    }

    /// Lamps that shine and whose power is not known.
    pub fn n_unknown_watt(&self) -> usize {
        self.shining().filter(|luminaire| luminaire.watt.is_none()).count()
    }

    /// A sentence for each lamp that shines and tells no flux, with why its file cannot be read.
    pub fn untold(&self) -> Vec<String> {
        let words = |luminaire: &Luminaire| {
            let untold = format!("`{}` tells no lumen and counts in no total", luminaire.key);
            luminaire.unreadable.iter().fold(untold, |untold, why| format!("{untold}: {why}"))
        };
        self.shining().filter(|luminaire| luminaire.lumen.is_none()).map(words).collect()
    }

    /// Lumen per watt of all that shine and tell both.
    pub fn lumen_per_watt(&self) -> Option<f64> {
        let both = self.shining().filter_map(|luminaire| Some((luminaire.lumen?, luminaire.watt?)));
        let (lumen, watt) = both.fold((0.0, 0.0), |(lumens, watts), (lumen, watt)| (lumens + lumen, watts + watt));
        (watt > 0.0).then(|| lumen / watt)
    }

    /// Power of a square meter of floor; nothing where no power is known.
    pub fn watt_per_m2(&self) -> Option<f64> {
        let is_known = self.shining().any(|luminaire| luminaire.watt.is_some());
        self.floor_m2.filter(|area| *area > 0.0 && is_known).map(|area| self.watt() / area)
    }

    fn shining(&self) -> impl Iterator<Item = &Luminaire> {
        self.luminaires.iter().filter(|luminaire| luminaire.is_on)
    }
}

impl Luminaire {
    /// Says where its power comes from: the profile where that states one, or else the flux.
    fn settle_watt(&mut self, efficacy_lm_w: Option<f64>) {
        let by_flux = || Some((self.lumen? / efficacy_lm_w?, WattSource::Efficacy));
        let known = self.watt.map(|watt| (watt, WattSource::Profile)).or_else(by_flux);
        (self.watt, self.watt_source) = known.unzip();
    }
}

/// Whether a lamp shines: one that is turned down to nothing is as dark as one that is muted.
fn is_on(setting: &LightSetting) -> bool {
    !setting.muted && setting.intensity > 0.0
}

/// Flux of a light of the scene; of a panel with spots, of the look or of its file, what these leave of it.
fn source_lumen(source: &LightSource, setting: &LightSetting, spots: Option<&Vec<PanelSpot>>) -> Option<f64> {
    let is_panel = matches!(source.kind, SourceKind::Panel { .. });
    let lumen = match spots.filter(|_| is_panel) {
        Some(spots) => source.lumens_of_spots(setting, spots),
        None => source.amount(setting, LampUnit::Lumen),
    };
    lumen.map(f64::from)
}

fn of_lamp(lamp: &FreeLamp, look: &Look) -> Luminaire {
    let color = lamp.setting.tint(Vec3::ONE);
    let lumen = lamp.strength_in(LampUnit::Lumen);
    let is_near = !lamp.shape.is_parallel();
    let file = match &lamp.shape {
        LampShape::Profile { file } => Some(Path::new(file)),
        _ => None,
    };
    let profile = file.map(|file| read_profile(file).map_err(|why| format!("{}: {why}", file.display())));
    let (watts, unreadable) = match profile {
        Some(Ok(profile)) => (profile.watts(), None),
        Some(Err(why)) => (None, Some(why)),
        None => (None, None),
    };
    Luminaire {
        key: lamp.key.clone(),
        name: look.name_of(&lamp.key).to_owned(),
        kind: kind_words(&lamp.shape).into(),
        is_on: is_on(&lamp.setting),
        lumen: lumen.map(|lumen| f64::from(lumen * luminance(color) * lamp.setting.intensity)),
        profile: file.and_then(Path::file_name).map(|name| name.to_string_lossy().into_owned()),
        watt: watts.map(f64::from),
        watt_source: None,
        position: is_near.then_some(lamp.position),
        direction: lamp.shape.is_aimed().then(|| (lamp.aim - lamp.position).normalize_or(Vec3::NEG_Y)),
        kelvin: lamp.setting.kelvin,
        color,
        unreadable,
    }
}

/// Where a light of the scene shines to, if to one side.
fn direction(emitter: &Emitter) -> Option<Vec3> {
    match emitter {
        Emitter::Punctual(light) => {
            let is_aimed = light.kind != PunctualKind::Point || light.profile.is_some();
            is_aimed.then_some(light.direction)
        }
        // A directional lamp that was given a size; its own direction leads to it.
        Emitter::Sun(sun) => Some(-sun.direction),
        Emitter::Panel(panel) => (!panel.double_sided).then_some(panel.normal),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use clerestory_transport::import;
    use clerestory_transport::photometry::{PhotometricProfile, assign};
    use clerestory_transport::scene::Scene;

    use super::*;
    use crate::support::{ROOM, prepared_room, room};

    fn look() -> Look {
        let mut look = Look::default();
        let lamp = FreeLamp {
            key: "=SUM(A1)".into(),
            shape: LampShape::Point,
            position: Vec3::new(-1.0, 2.0, 0.5),
            aim: Vec3::ZERO,
            strength: 800.0,
            unit: LampUnit::Lumen,
            setting: LightSetting { intensity: 0.5, ..LightSetting::default() },
            turn_rad: 0.0,
            replaces: None,
        };
        let off = LightSetting { muted: true, ..LightSetting::default() };
        look.lights.lamps = vec![lamp.clone(), FreeLamp { key: "dark".into(), setting: off, ..lamp }];
        look
    }

    #[test]
    fn flux_and_power_are_those_of_what_shines() {
        let scene = prepared_room();
        let schedule = Schedule::new(&scene.lighting.basis, Some(&scene), &look(), Some(80.0), Some(4.0));
        // The lamp of the file has 3 cd all around.
        let lumen = 4.0 * std::f64::consts::PI * 3.0;
        let [file, free, dark] = &schedule.luminaires[..] else { panic!("{schedule:?}") };
        assert!((file.lumen.unwrap() - lumen).abs() < 1e-3 && (free.lumen.unwrap() - 400.0).abs() < 1e-3);
        assert!(!dark.is_on && dark.lumen.is_some());
        assert!((schedule.lumen() - 400.0 - lumen).abs() < 1e-2);
        assert!((schedule.watt() - schedule.lumen() / 80.0).abs() < 1e-9);
        assert!((schedule.watt_per_m2().unwrap() - schedule.watt() / 4.0).abs() < 1e-9);
    }

    /// The way that the first lamp of a scene shines.
    fn direction(scene: &Scene) -> Option<Vec3> {
        let (scene, _) = PreparedScene::new(scene.clone(), &[]).unwrap();
        let schedule = Schedule::new(&scene.lighting.basis, Some(&scene), &Look::default(), None, None);
        schedule.luminaires[0].direction
    }

    #[test]
    fn a_directional_lamp_shines_the_same_way_with_a_size() {
        let room = ROOM.replace("\"point\"", "\"directional\"");
        let mut scene = import::load_bytes("room", room.as_bytes()).unwrap().scene;
        assert_eq!(direction(&scene), Some(Vec3::NEG_Z));
        assert_eq!(scene.set_sun_radius(0.01), 1);
        assert_eq!(direction(&scene), Some(Vec3::NEG_Z));
    }

    #[test]
    fn a_measured_lamp_of_the_file_has_an_aim_and_a_bare_point_lamp_has_none() {
        let ies = b"IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 10\n0 45 90\n0\n100 50 0\n";
        let mut scene = room();
        assert_eq!(direction(&scene), None);
        assign(&mut scene, "lamp", PhotometricProfile::parse(ies, "x.ies").unwrap(), 1.0).unwrap();
        assert_eq!(direction(&scene), Some(Vec3::NEG_Z));
    }

    #[test]
    fn lumen_beyond_all_numbers_are_refused() {
        let mut look = look();
        look.lights.lamps[0].setting.intensity = f32::MAX;
        let schedule = Schedule::new(&LightBasis::default(), None, &look, Some(80.0), None);
        for by in [ScheduleBy::Lamp, ScheduleBy::Type] {
            let mut table = Vec::new();
            let said = schedule.write(&mut table, by).unwrap_err().to_string();
            assert!(said.contains("`=SUM(A1)`") && said.contains("no finite number"), "{said}");
            assert!(table.is_empty());
        }
    }

    #[test]
    fn a_lamp_that_is_turned_down_to_nothing_is_off() {
        let mut look = look();
        look.lights.lamps[0].setting.intensity = 0.0;
        let schedule = Schedule::new(&LightBasis::default(), None, &look, Some(80.0), None);
        assert!(schedule.luminaires.len() == 2 && schedule.luminaires.iter().all(|lamp| !lamp.is_on), "{schedule:?}");
        assert_eq!((schedule.n_unknown_watt(), schedule.untold().len()), (0, 0));
    }

    #[test]
    fn a_lamp_whose_file_cannot_be_read_is_told_with_why() {
        let folder = tempfile::tempdir().unwrap();
        let [gone, wrong] = ["gone.ies", "wrong.ies"].map(|name| folder.path().join(name).display().to_string());
        std::fs::write(&wrong, "no profile").unwrap();
        let mut look = look();
        for (lamp, file) in look.lights.lamps.iter_mut().zip([&gone, &wrong]) {
            lamp.setting.muted = false;
            lamp.shape = LampShape::Profile { file: file.clone() };
        }
        let untold = Schedule::new(&LightBasis::default(), None, &look, None, None).untold();
        assert!(untold.len() == 2 && untold.iter().all(|words| words.contains("tells no lumen")), "{untold:?}");
        assert!(untold[0].contains(&gone) && untold[0].contains("cannot be read"), "{untold:?}");
        assert!(untold[1].contains(&wrong), "{untold:?}");
    }

    /// Lamps of the two luminaires of a maker, whose files state 1221 lm and 14 W, and 321 lm and 9 W.
    fn of_maker(look: &mut Look) -> bool {
        let Some(folder) = std::env::var_os("CLERESTORY_SHARED").filter(|folder| !folder.is_empty()) else {
            let is_required = std::env::var_os("CLERESTORY_REQUIRE_SHARED").is_some();
            assert!(!is_required, "CLERESTORY_REQUIRE_SHARED is set, but CLERESTORY_SHARED names no folder");
            println!("skipped: no shared data");
            return false;
        };
        let lamp = look.lights.lamps[0].clone();
        let of = |key: &str, file: &str, lumen: f32, intensity: f32| {
            let file = Path::new(&folder).join("env").join(file);
            assert!(file.exists(), "the shared data has no {}", file.display());
            FreeLamp {
                key: key.into(),
                shape: LampShape::Profile { file: file.display().to_string() },
                strength: lumen,
                setting: LightSetting { intensity, ..LightSetting::default() },
                ..lamp.clone()
            }
        };
        let (wide, narrow) = ("bega-50899.2K3.ies", "bega-50975.6K3.ies");
        look.lights.lamps = vec![
            of("a", wide, 1221.0, 1.0),
            of("b", wide, 1221.0, 1.0),
            of("c", narrow, 321.0, 1.0),
            of("dimmed", narrow, 321.0, 0.5),
            FreeLamp { key: "bare".into(), ..lamp },
        ];
        true
    }

    #[test]
    fn profiles_tell_their_power_and_what_tells_none_is_counted() {
        let mut look = look();
        if !of_maker(&mut look) {
            return;
        }
        let schedule = Schedule::new(&LightBasis::default(), None, &look, None, Some(10.0));
        let watts: Vec<Option<f64>> = schedule.luminaires.iter().map(|lamp| lamp.watt).collect();
        assert_eq!(watts, [Some(14.0), Some(14.0), Some(9.0), Some(9.0), None], "dimmed lamps keep their rated power");
        assert_eq!((schedule.watt(), schedule.n_unknown_watt()), (46.0, 1));
        assert_eq!(schedule.watt_per_m2(), Some(4.6));
        // The bare lamp's 400 lm count in the flux, and not in what a watt gives.
        let lumen = 2.0 * 1221.0 + 1.5 * 321.0;
        assert!((schedule.lumen() - lumen - 400.0).abs() < 0.1, "{}", schedule.lumen());
        assert!((schedule.lumen_per_watt().unwrap() - lumen / 46.0).abs() < 0.01, "{:?}", schedule.lumen_per_watt());
        let estimated = Schedule::new(&LightBasis::default(), None, &look, Some(80.0), None);
        assert_eq!((estimated.watt(), estimated.n_unknown_watt()), (51.0, 0), "400 lm at 80 lm/W are 5 W more");
        assert_eq!(estimated.luminaires[0].watt_source, Some(WattSource::Profile));
        assert_eq!(estimated.luminaires[4].watt_source, Some(WattSource::Efficacy));
    }

    #[test]
    fn lamps_of_one_type_share_a_row() {
        let mut look = look();
        if !of_maker(&mut look) {
            return;
        }
        let schedule = Schedule::new(&LightBasis::default(), None, &look, None, None);
        let types = schedule.types();
        let told: Vec<_> = types.iter().map(|of| (of.letters.as_str(), of.lamps.len(), of.watt)).collect();
        assert_eq!(told, [("A", 2, Some(14.0)), ("B", 1, Some(9.0)), ("C", 1, Some(9.0)), ("D", 1, None)]);
        let table = written(&schedule, ScheduleBy::Type);
        let lines: Vec<&str> = table.lines().collect();
        assert!(
            lines[1].starts_with("A,") && lines[1].contains(",bega-50899.2K3.ies,2,yes,1221.0,14.0,2442.0,28.0,87.2,"),
            "{table}"
        );
        assert!(lines[4].starts_with("D,") && lines[4].contains(",1,yes,400.0,,400.0,,,"), "{table}");
        assert!(lines[5].starts_with("total of lamps that are on,,,5,,,,3323.5,46.0,"), "{table}");
        assert!(lines[6].starts_with("lamps of unknown wattage,,,1,"), "{table}");
        assert!(lines[7].starts_with("luminous efficacy of known wattage (lm/W),,,4,,,,,63.6,"), "{table}");
    }

    fn written(schedule: &Schedule, by: ScheduleBy) -> String {
        let mut table = Vec::new();
        schedule.write(&mut table, by).unwrap();
        let table = String::from_utf8(table).unwrap();
        let n_cells = table.lines().next().unwrap().split(',').count();
        assert!(table.lines().all(|line| line.split(',').count() == n_cells), "{table}");
        table
    }

    #[test]
    fn no_name_becomes_a_formula_and_numbers_stay_numbers() {
        let schedule = Schedule::new(&LightBasis::default(), None, &look(), Some(100.0), None);
        let table = written(&schedule, ScheduleBy::Lamp);
        let lines: Vec<&str> = table.lines().collect();
        assert!(
            lines[1].starts_with("'=SUM(A1),'=SUM(A1),") && lines[1].contains(",1,yes,400.0,4.0,-1.000,2.000,0.500,"),
            "{table}"
        );
        assert!(lines[1].ends_with(",,efficacy") && !table.contains("W/m²"), "no floor is known: {table}");
        let types = written(&schedule, ScheduleBy::Type);
        let unknown = written(&Schedule::new(&LightBasis::default(), None, &look(), None, None), ScheduleBy::Lamp);
        assert!(unknown.contains("total of lamps that are on,,,1,,400.0,0.0,"), "{unknown}");
        assert!(types.contains(",'=SUM(A1)\n") && types.contains(",no,800.0,"), "{types}");
    }
}
