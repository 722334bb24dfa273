//! The sky of a look, from JSON and back.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, anyhow};
use clerestory_transport::import::load_sky;
use clerestory_transport::sky::{DEFAULT_TURBIDITY, Environment, SkyError, SkySetting, SunPlace, SunSetting, SunTime};
use serde_json::{Map, Value};

use super::parse::Reader;
use super::write::{member, value};

/// How far a sky may be turned.
pub const ROTATION_DEG: std::ops::RangeInclusive<f64> = -3600.0..=3600.0;
const AZIMUTH_DEG: std::ops::RangeInclusive<f64> = -360.0..=360.0;
const ELEVATION_DEG: std::ops::RangeInclusive<f64> = -90.0..=90.0;
const LONGITUDE_DEG: std::ops::RangeInclusive<f64> = -180.0..=180.0;
const TURBIDITY: std::ops::RangeInclusive<f64> = 2.0..=10.0;
const OFFSET_H: std::ops::RangeInclusive<f64> = -14.0..=14.0;

/// Loads what a sky names; files lie relative to `folder`. Returns what is odd about them.
///
/// # Errors
/// A file that cannot be used.
pub fn load(sky: &mut SkySetting, folder: &Path) -> Result<Vec<String>> {
    Maps::default().load(sky, folder)
}

/// Maps of files, each read once, however many skies of a document show it.
#[derive(Default)]
pub struct Maps(HashMap<PathBuf, Arc<Environment>>);

impl Maps {
    /// The same as [`load`]; what is odd about a file is told when it is read.
    ///
    /// # Errors
    /// As [`load`].
    pub fn load(&mut self, sky: &mut SkySetting, folder: &Path) -> Result<Vec<String>> {
        let mut warnings = Vec::new();
        sky.load::<SkyError>(|file| {
            let path = folder.join(file);
            let place = path.canonicalize().unwrap_or_else(|_| path.clone());
            if let Some(known) = self.0.get(&place) {
                return Ok(known.clone());
            }
            let (map, odd) = load_sky(&path)?;
            warnings.extend(odd);
            Ok(self.0.entry(place).or_insert(map.into()).clone())
        })?;
        Ok(warnings)
    }
}

/// A sky that was edited: what shows it is made anew where that is another one. Its map is never read again.
///
/// # Errors
/// A sun on a day that does not exist.
pub fn remade(before: &SkySetting, mut sky: SkySetting) -> Result<SkySetting, SkyError> {
    if is_made_anew(before, &sky) {
        sky.load(|_| Ok::<_, SkyError>(Arc::default()))?;
    }
    Ok(sky)
}

/// Whether the map of a sky that was changed is computed anew.
pub fn is_made_anew(before: &SkySetting, sky: &SkySetting) -> bool {
    let needs_no_file = sky.file.as_deref().is_none_or(|file| file == "uniform");
    needs_no_file && (&before.file, before.sun) != (&sky.file, sky.sun)
}

/// Names the file of a sky from the root, so that the look can be saved elsewhere.
pub fn resolve(sky: &mut SkySetting, folder: &Path) {
    if let Some(file) = sky.file.as_mut().filter(|file| *file != "uniform") {
        let path = folder.join(&*file);
        *file = std::path::absolute(&path).unwrap_or(path).display().to_string();
    }
}

/// Names the file of a sky relative to `folder` where it lies in it, so that the folder can be moved.
pub fn relative(sky: &mut SkySetting, folder: &Path) {
    let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.into());
    if let Some(file) = &mut sky.file
        && let Ok(within) = Path::new(&*file).strip_prefix(&folder)
    {
        *file = within.display().to_string();
    }
}

/// What `--sky` names: `uniform`, `sun:AZ,EL`, a sun by date and place, else a file.
///
/// # Errors
/// In words, if a sun has neither angles nor date and place.
pub fn typed(text: &str) -> Result<SkySetting, String> {
    let Some(place) = text.strip_prefix("sun:") else {
        return match text {
            "" => Err("write a file, uniform, or sun:AZIMUTH,ELEVATION".into()),
            file => Ok(SkySetting { file: Some(file.into()), ..SkySetting::default() }),
        };
    };
    let sun = if place.split(',').count() > 2 { by_time(place)? } else { by_angles(place)? };
    Ok(SkySetting { sun: Some(sun), ..SkySetting::default() })
}

/// A sun of `DATE,TIME,LATITUDE,LONGITUDE`, then the offset from universal time and the azimuth of north, which may be
/// left out.
fn by_time(text: &str) -> Result<SunSetting, String> {
    let parts: Vec<&str> = text.split(',').map(str::trim).collect();
    let number = |idx: usize| parts.get(idx).map_or(Some(0.0), |part| part.parse::<f64>().ok());
    let read = || {
        let (date, hour) = (date_of(parts[0])?, hour_of(parts[1])?);
        let time = SunTime {
            date,
            hour,
            utc_offset_h: number(4)?,
            latitude_deg: parts.get(3).and_then(|_| number(2))?,
            longitude_deg: number(3)?,
        };
        let north_deg = number(5).filter(|degrees| AZIMUTH_DEG.contains(degrees) && parts.len() <= 6)?;
        Some((time, north_deg))
    };
    let (time, north_deg) = read().ok_or(
        "write sun:DATE,TIME,LATITUDE,LONGITUDE,UTC_OFFSET,NORTH such as sun:2026-06-21,14:30,48.14,11.58,2; \
         UTC_OFFSET in hours and NORTH, its azimuth in the scene, may be left out",
    )?;
    time.check().map_err(|error| error.to_string())?;
    Ok(SunSetting { place: SunPlace::Time { time, north_deg }, ..SunSetting::by_angles(0.0, 0.0) })
}

fn by_angles(angles: &str) -> Result<SunSetting, String> {
    let degrees = |text: &str, range: std::ops::RangeInclusive<f64>| {
        text.trim().parse::<f64>().ok().filter(|degrees| range.contains(degrees))
    };
    let angles = angles
        .split_once(',')
        .and_then(|(azimuth, elevation)| degrees(azimuth, AZIMUTH_DEG).zip(degrees(elevation, ELEVATION_DEG)));
    let (azimuth_deg, elevation_deg) = angles.ok_or(
        "write sun:AZIMUTH,ELEVATION in degrees such as sun:135,40; azimuths −360 to 360 run from north (−Z) over east",
    )?;
    Ok(SunSetting::by_angles(azimuth_deg, elevation_deg))
}

/// Year, month and day of `2026-06-21`; they may not exist.
fn date_of(text: &str) -> Option<(i32, u32, u32)> {
    let parts: Option<Vec<u32>> = text.split('-').map(|part| part.parse().ok()).collect();
    let &[year, month, day] = parts.as_deref()? else { return None };
    Some((i32::try_from(year).unwrap_or(i32::MAX), month, day))
}

/// Hours since midnight of `14:30`.
#[expect(clippy::arithmetic_side_effects, reason = "at most 24 hours where they are multiplied")]
fn hour_of(text: &str) -> Option<f64> {
    let (hours, minutes) = text.split_once(':').and_then(|(h, m)| h.parse::<u32>().ok().zip(m.parse::<u32>().ok()))?;
    (minutes < 60 && hours <= 24 && hours * 60 + minutes <= 24 * 60)
        .then(|| f64::from(hours) + f64::from(minutes) / 60.0)
}

impl Reader<'_> {
    /// The member `sky`.
    pub(super) fn sky(&mut self, value: &Value) -> Result<SkySetting> {
        let object = self.object(value)?;
        self.report_unknown(object, &["file", "rotation_deg", "intensity", "sun"]);
        Ok(SkySetting {
            file: self.optional(object, "file", |r, v| r.text(v))?.filter(|file| !file.is_empty()),
            rotation_deg: self.optional(object, "rotation_deg", |r, v| r.number(v, &ROTATION_DEG))?.unwrap_or(0.0),
            intensity: self.optional(object, "intensity", |r, v| r.number(v, &super::parse::INTENSITY))?.unwrap_or(1.0),
            sun: self.optional(object, "sun", |r, v| r.sun(v))?,
            map: None,
        })
    }

    fn sun(&mut self, value: &Value) -> Result<SunSetting> {
        let object = self.object(value)?;
        let by_time = object.contains_key("date") || object.contains_key("time");
        let place = if by_time {
            let known = ["date", "time", "utc_offset_h", "latitude_deg", "longitude_deg", "north_deg"];
            self.report_unknown(object, &[&known[..], &["turbidity", "intensity"]].concat());
            SunPlace::Time {
                time: self.sun_time(object)?,
                north_deg: self.precise(object, "north_deg", &AZIMUTH_DEG)?.unwrap_or(0.0),
            }
        } else {
            self.report_unknown(object, &["azimuth_deg", "elevation_deg", "turbidity", "intensity"]);
            SunPlace::Angles {
                azimuth_deg: self
                    .precise(object, "azimuth_deg", &AZIMUTH_DEG)?
                    .ok_or_else(|| self.missing("azimuth_deg"))?,
                elevation_deg: self
                    .precise(object, "elevation_deg", &ELEVATION_DEG)?
                    .ok_or_else(|| self.missing("elevation_deg"))?,
            }
        };
        let turbidity = self.optional(object, "turbidity", |r, v| r.number(v, &TURBIDITY))?;
        let intensity = self.optional(object, "intensity", |r, v| r.number(v, &super::parse::INTENSITY))?;
        let turbidity = turbidity.unwrap_or(DEFAULT_TURBIDITY);
        Ok(SunSetting { place, turbidity, intensity: intensity.unwrap_or(1.0) })
    }

    fn missing(&self, key: &str) -> anyhow::Error {
        anyhow!(
            "`{}.{key}` is missing: give `azimuth_deg` and `elevation_deg`, or `date`, `time` and a place",
            self.name()
        )
    }

    fn precise(
        &mut self,
        object: &Map<String, Value>,
        key: &str,
        range: &std::ops::RangeInclusive<f64>,
    ) -> Result<Option<f64>> {
        self.optional(object, key, |r, v| {
            r.number(v, range)?;
            Ok(v.as_f64().unwrap_or_default())
        })
    }

    fn sun_time(&mut self, object: &Map<String, Value>) -> Result<SunTime> {
        let date = self.optional(object, "date", |r, v| r.date(v))?.ok_or_else(|| self.missing("date"))?;
        let hour = self.optional(object, "time", |r, v| r.hour(v))?.ok_or_else(|| self.missing("time"))?;
        let latitude = self.precise(object, "latitude_deg", &ELEVATION_DEG)?;
        let longitude = self.precise(object, "longitude_deg", &LONGITUDE_DEG)?;
        let time = SunTime {
            date,
            hour,
            utc_offset_h: self.precise(object, "utc_offset_h", &OFFSET_H)?.unwrap_or(0.0),
            latitude_deg: latitude.ok_or_else(|| self.missing("latitude_deg"))?,
            longitude_deg: longitude.ok_or_else(|| self.missing("longitude_deg"))?,
        };
        time.check().map_err(|error| anyhow!("`{}`: {error}", self.name()))?;
        Ok(time)
    }

    pub(super) fn text(&self, value: &Value) -> Result<String> {
        let text = value.as_str().ok_or_else(|| anyhow!("`{}` must be a text, not {value}", self.name()))?;
        Ok(text.to_string())
    }

    fn date(&self, value: &Value) -> Result<(i32, u32, u32)> {
        date_of(&self.text(value)?)
            .ok_or_else(|| anyhow!("`{}` must be a date such as 2026-06-21, not {value}", self.name()))
    }

    fn hour(&self, value: &Value) -> Result<f64> {
        hour_of(&self.text(value)?)
            .ok_or_else(|| anyhow!("`{}` must be a time such as 14:30, not {value}", self.name()))
    }
}

/// The members of a sky that differ from the map of the bake, not turned and at its own intensity.
pub(super) fn members(sky: &SkySetting) -> Vec<String> {
    let members = [
        sky.file.as_ref().map(|file| format!("\"file\": {}", value(file))),
        (sky.rotation_deg != 0.0).then(|| member("rotation_deg", &sky.rotation_deg)),
        (sky.intensity != 1.0).then(|| member("intensity", &sky.intensity)),
        sky.sun.as_ref().map(|sun| format!("\"sun\": {{ {} }}", sun_members(sun).join(", "))),
    ];
    members.into_iter().flatten().collect()
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an hour from 0 to 24")]
fn sun_members(sun: &SunSetting) -> Vec<String> {
    let mut members = match &sun.place {
        SunPlace::Angles { azimuth_deg, elevation_deg } => {
            vec![member("azimuth_deg", azimuth_deg), member("elevation_deg", elevation_deg)]
        }
        SunPlace::Time { time, north_deg } => {
            let (year, month, day) = time.date;
            let minutes = (time.hour * 60.0).round() as u32;
            vec![
                format!("\"date\": {}", value(&format!("{year:04}-{month:02}-{day:02}"))),
                format!("\"time\": {}", value(&format!("{:02}:{:02}", minutes / 60, minutes % 60))),
                member("utc_offset_h", &time.utc_offset_h),
                member("latitude_deg", &time.latitude_deg),
                member("longitude_deg", &time.longitude_deg),
                member("north_deg", north_deg),
            ]
        }
    };
    members.extend((sun.turbidity != DEFAULT_TURBIDITY).then(|| member("turbidity", &sun.turbidity)));
    members.extend((sun.intensity != 1.0).then(|| member("intensity", &sun.intensity)));
    members
}

#[cfg(test)]
mod tests {
    use super::super::Look;
    use super::*;

    fn sky_of(json: &str) -> Result<Look> {
        Look::from_json(&format!("{{\"clerestory\": 1, \"sky\": {json}}}")).map(|(look, warnings)| {
            assert!(warnings.is_empty(), "{warnings:?}");
            look
        })
    }

    #[test]
    fn a_sky_is_read_and_written() {
        for json in [
            r#"{"file": "a, \"b\".hdr", "rotation_deg": 30, "intensity": 0.5}"#,
            r#"{"rotation_deg": -12.5}"#,
            "{}",
            r#"{"sun": {"azimuth_deg": 135.25, "elevation_deg": 40, "turbidity": 4, "intensity": 0.9}}"#,
            r#"{"sun": {"date": "2026-06-21", "time": "14:07", "utc_offset_h": 2, "latitude_deg": 48.1374,
                "longitude_deg": 11.5755, "north_deg": 15}}"#,
        ] {
            let look = sky_of(json).unwrap();
            let (back, warnings) = Look::from_json(&look.to_json()).unwrap();
            assert_eq!((&back, warnings.len()), (&look, 0), "{}", look.to_json());
            assert!(look.lights.sky.is_some());
        }
        assert!(!Look::default().to_json().contains("sky"));
    }

    #[test]
    fn a_bad_sky_is_refused_by_name() {
        for (json, wanted) in [
            ("[]", "`sky`"),
            (r#"{"file": 3}"#, "`sky.file`"),
            (r#"{"rotation_deg": "x"}"#, "`sky.rotation_deg`"),
            (r#"{"intensity": -1}"#, "`sky.intensity`"),
            (r#"{"sun": {"azimuth_deg": 3}}"#, "`sky.sun.elevation_deg`"),
            (r#"{"sun": {"azimuth_deg": 3, "elevation_deg": 91}}"#, "`sky.sun.elevation_deg`"),
            (r#"{"sun": {"date": "2026-13-01", "time": "10:00", "latitude_deg": 0, "longitude_deg": 0}}"#, "`sky.sun`"),
            (r#"{"sun": {"date": "today", "time": "10:00"}}"#, "`sky.sun.date`"),
            (r#"{"sun": {"date": "2026-06-21-noon", "time": "10:00"}}"#, "`sky.sun.date`"),
            (r#"{"sun": {"date": "2026-01-01", "time": "25:00"}}"#, "`sky.sun.time`"),
            (r#"{"sun": {"date": "2026-01-01", "time": "9:00"}}"#, "`sky.sun.latitude_deg`"),
        ] {
            let error = format!("{:#}", sky_of(json).unwrap_err());
            assert!(error.contains(wanted), "{json}: {error}");
        }
    }

    #[test]
    fn what_is_typed_is_a_file_a_word_or_a_sun() {
        assert_eq!(typed("day.exr").unwrap().file.as_deref(), Some("day.exr"));
        let sun = typed("sun:135, 40.5").unwrap().sun.unwrap();
        assert_eq!(sun.place, SunPlace::Angles { azimuth_deg: 135.0, elevation_deg: 40.5 });
        let place = |text: &str| typed(text).unwrap().sun.unwrap().place;
        let time =
            SunTime { date: (2026, 6, 21), hour: 14.5, utc_offset_h: 2.0, latitude_deg: 48.0, longitude_deg: -11.5 };
        let of = |time, north_deg| SunPlace::Time { time, north_deg };
        assert_eq!(place("sun:2026-06-21,14:30,48,-11.5,2,15"), of(time, 15.0));
        assert_eq!(place("sun:2026-06-21, 14:30, 48, -11.5"), of(SunTime { utc_offset_h: 0.0, ..time }, 0.0));
        for bad in ["", "sun:", "sun:1", "sun:a,b", "sun:0,91", "sun:nan,4"] {
            assert!(typed(bad).is_err(), "{bad}");
        }
        for bad in ["2026-02-30,12:00,0,0", "2026-06-21,12:00,0", "2026-06-21,25:00,0,0", "2026-06-21,12:00,91,0"] {
            assert!(typed(&format!("sun:{bad}")).is_err(), "{bad}");
        }
        assert!(typed("sun:2026-06-21,12:00,0,0,0,0,0").is_err());
    }

    #[test]
    fn an_edited_sun_brings_its_sky_and_a_turned_one_keeps_it() {
        let sun = SkySetting { sun: Some(SunSetting::by_angles(120.0, 30.0)), ..SkySetting::default() };
        let shown = remade(&SkySetting::default(), sun).unwrap();
        let turned = remade(&shown, SkySetting { rotation_deg: 20.0, ..shown.clone() }).unwrap();
        let is_same = |a: &SkySetting, b: &SkySetting| match (&a.map, &b.map) {
            (Some(a), Some(b)) => std::sync::Arc::ptr_eq(a, b),
            _ => false,
        };
        assert!(is_same(&shown, &turned));
        let later = SkySetting { sun: Some(SunSetting::by_angles(180.0, 50.0)), ..shown.clone() };
        assert!(!is_same(&shown, &remade(&shown, later).unwrap()));
        assert_eq!(remade(&shown, SkySetting { sun: None, ..shown.clone() }).unwrap(), SkySetting::default());
    }

    #[test]
    fn files_are_named_from_the_root_and_within_a_folder() {
        let mut sky = SkySetting { file: Some("skies/day.hdr".into()), ..SkySetting::default() };
        let folder = std::env::temp_dir();
        resolve(&mut sky, &folder);
        assert_eq!(sky.file.as_deref(), Some(&*folder.join("skies/day.hdr").display().to_string()));
        relative(&mut sky, &folder);
        assert_eq!(sky.file.as_deref(), Some("skies/day.hdr"));
        let mut uniform = SkySetting { file: Some("uniform".into()), ..SkySetting::default() };
        resolve(&mut uniform, &folder);
        assert_eq!(uniform.file.as_deref(), Some("uniform"));
    }
}
