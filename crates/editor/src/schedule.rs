//! A schedule of luminaires: every lamp with its flux, power, place and color, and what they sum up to.

// What is read here was written by strangers, so no integer may wrap in silence.
#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]
#![cfg_attr(not(test), deny(clippy::cast_possible_truncation, clippy::cast_sign_loss))]

use std::io::Write;

use anyhow::Result;
use clerestory_transport::basis::{LightBasis, LightSource, SourceKind};
use clerestory_transport::emitters::Emitter;
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit};
use clerestory_transport::light::{LightSetting, luminance};
use clerestory_transport::prepared::PreparedScene;
use glam::Vec3;
use serde::Serialize;

use crate::look::Look;
use crate::panels::lamps::kind_words;
use crate::panels::lights::source_words;
use crate::table::text_cell;

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
    /// Power in watt by the efficacy; `None` without flux.
    pub watt: Option<f64>,
    /// World-space position in meters, if it is anywhere.
    pub position: Option<Vec3>,
    /// World-space unit direction that it shines in, if in one.
    pub direction: Option<Vec3>,
    /// Correlated color temperature that it is set to.
    pub kelvin: Option<f32>,
    /// Linear Rec. 709 color.
    pub color: Vec3,
}

/// All lamps, and what they sum up to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Schedule {
    /// Lamps, those of the scene first.
    pub luminaires: Vec<Luminaire>,
    /// Lumen per watt that power follows from.
    pub efficacy_lm_w: f64,
    /// Floor area in m², if it is known.
    pub floor_m2: Option<f64>,
}

impl Schedule {
    /// Of the lights of a basis and the free lamps of a look; the scene tells where lamps aim.
    pub fn new(
        basis: &LightBasis,
        scene: Option<&PreparedScene>,
        look: &Look,
        efficacy_lm_w: f64,
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
        let coefficients = basis.project(&look.lights);
        let of_source = |source: &LightSource| {
            let setting = look.lights.setting(&source.key);
            let emitter = scene.and_then(|scene| {
                let nth = scene.lighting.basis.sources.iter().position(|own| own.key == source.key)?;
                scene.lighting.emitters.get(nth)
            });
            Luminaire {
                key: source.key.clone(),
                name: look.name_of(&source.key).to_owned(),
                kind: source_words(source.kind),
                is_on: !setting.muted,
                lumen: source_lumen(source, &setting, look, &coefficients),
                watt: None,
                position: source.origin.position,
                direction: emitter.and_then(direction),
                kelvin: setting.kelvin,
                color: setting.tint(source.color),
            }
        };
        let lamps = look.lights.lit_lamps();
        let mut luminaires: Vec<Luminaire> = basis.sources.iter().filter(is_lamp).map(of_source).collect();
        luminaires.extend(lamps.iter().map(|lamp| of_lamp(lamp, look)));
        for luminaire in &mut luminaires {
            luminaire.watt = luminaire.lumen.map(|lumen| lumen / efficacy_lm_w);
        }
        Schedule { luminaires, efficacy_lm_w, floor_m2 }
    }

    /// Lumen of all that shine and tell it.
    pub fn lumen(&self) -> f64 {
        self.shining().filter_map(|luminaire| luminaire.lumen).sum()
    }

    /// Watt of all that shine and tell it.
    pub fn watt(&self) -> f64 {
        self.shining().filter_map(|luminaire| luminaire.watt).sum()
    }

    /// Power of a square meter of floor.
    pub fn watt_per_m2(&self) -> Option<f64> {
        self.floor_m2.filter(|area| *area > 0.0).map(|area| self.watt() / area)
    }

    fn shining(&self) -> impl Iterator<Item = &Luminaire> {
        self.luminaires.iter().filter(|luminaire| luminaire.is_on)
    }

    /// Writes it as comma-separated values, as RFC 4180 has them; no cell of text begins as a formula does.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, writer: &mut impl Write) -> Result<()> {
        writeln!(writer, "key,name,kind,count,on,lumen,watt,x_m,y_m,z_m,aim_x,aim_y,aim_z,kelvin,red,green,blue")?;
        let number = |x: Option<f64>| x.map_or(String::new(), |x| format!("{x:.1}"));
        let three = |v: Option<Vec3>, digits: usize| match v {
            // Plus zero, so that there is but one zero.
            Some(v) => v.to_array().map(|x| format!("{:.digits$}", x + 0.0)).join(","),
            None => ",,".into(),
        };
        for lamp in &self.luminaires {
            writeln!(
                writer,
                "{},{},{},1,{},{},{},{},{},{},{}",
                text_cell(&lamp.key),
                text_cell(&lamp.name),
                text_cell(&lamp.kind),
                if lamp.is_on { "yes" } else { "no" },
                number(lamp.lumen),
                number(lamp.watt),
                three(lamp.position, 3),
                three(lamp.direction, 4),
                lamp.kelvin.map_or(String::new(), |kelvin| format!("{kelvin:.0}")),
                three(Some(lamp.color), 4),
            )?;
        }
        let n_on = self.shining().count();
        writeln!(writer, "total of lamps that are on,,,{n_on},,{:.1},{:.1},,,,,,,,,,", self.lumen(), self.watt())?;
        writeln!(writer, "efficacy (lm/W),,,,,,{:.1},,,,,,,,,,", self.efficacy_lm_w)?;
        if let (Some(area), Some(density)) = (self.floor_m2, self.watt_per_m2()) {
            writeln!(writer, "floor area (m²),,,,,,{area:.2},,,,,,,,,,")?;
            writeln!(writer, "power density (W/m²),,,,,,{density:.2},,,,,,,,,,")?;
        }
        Ok(())
    }
}

/// Flux of a light of the scene; of a panel with spots what these leave of it.
fn source_lumen(source: &LightSource, setting: &LightSetting, look: &Look, coefficients: &[[f32; 3]]) -> Option<f64> {
    if matches!(source.kind, SourceKind::Panel { .. }) && look.lights.panels.contains_key(&source.key) {
        let texels = &coefficients[source.columns.start as usize..source.columns.end as usize];
        let sum: f64 = texels.iter().map(|rgb| f64::from(luminance(Vec3::from(*rgb)))).sum();
        return Some(sum / texels.len().max(1) as f64 * f64::from(source.origin.lumens?));
    }
    source.amount(setting, LampUnit::Lumen).map(f64::from)
}

fn of_lamp(lamp: &FreeLamp, look: &Look) -> Luminaire {
    let color = lamp.setting.tint(Vec3::ONE);
    let lumen = lamp.strength_in(LampUnit::Lumen);
    let is_near = lamp.shape != LampShape::Directional;
    Luminaire {
        key: lamp.key.clone(),
        name: look.name_of(&lamp.key).to_owned(),
        kind: kind_words(&lamp.shape).into(),
        is_on: !lamp.setting.muted,
        lumen: lumen.map(|lumen| f64::from(lumen * luminance(color) * lamp.setting.intensity)),
        watt: None,
        position: is_near.then_some(lamp.position),
        direction: lamp.shape.is_aimed().then(|| (lamp.aim - lamp.position).normalize_or(Vec3::NEG_Y)),
        kelvin: lamp.setting.kelvin,
        color,
    }
}

/// Where a light of the scene shines to, if to one side.
fn direction(emitter: &Emitter) -> Option<Vec3> {
    match emitter {
        Emitter::Punctual(light) => {
            (light.kind != clerestory_transport::scene::PunctualKind::Point).then_some(light.direction)
        }
        Emitter::Panel(panel) => (!panel.double_sided).then_some(panel.normal),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use clerestory_transport::import;

    use super::*;

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
        };
        let off = LightSetting { muted: true, ..LightSetting::default() };
        look.lights.lamps = vec![lamp.clone(), FreeLamp { key: "dark".into(), setting: off, ..lamp }];
        look
    }

    #[test]
    fn flux_and_power_are_those_of_what_shines() {
        let room = include_str!("../tests/room.gltf");
        let scene = import::load_bytes("room", room.as_bytes()).unwrap().scene;
        let (scene, _) = PreparedScene::new(scene, &[]).unwrap();
        let schedule = Schedule::new(&scene.lighting.basis, Some(&scene), &look(), 80.0, Some(4.0));
        // The lamp of the file has 3 cd all around.
        let lumen = 4.0 * std::f64::consts::PI * 3.0;
        let [file, free, dark] = &schedule.luminaires[..] else { panic!("{schedule:?}") };
        assert!((file.lumen.unwrap() - lumen).abs() < 1e-3 && (free.lumen.unwrap() - 400.0).abs() < 1e-3);
        assert!(!dark.is_on && dark.lumen.is_some());
        assert!((schedule.lumen() - 400.0 - lumen).abs() < 1e-2);
        assert!((schedule.watt() - schedule.lumen() / 80.0).abs() < 1e-9);
        assert!((schedule.watt_per_m2().unwrap() - schedule.watt() / 4.0).abs() < 1e-9);
    }

    #[test]
    fn no_name_becomes_a_formula_and_numbers_stay_numbers() {
        let schedule = Schedule::new(&LightBasis::default(), None, &look(), 100.0, None);
        let mut table = Vec::new();
        schedule.write(&mut table).unwrap();
        let table = String::from_utf8(table).unwrap();
        let lines: Vec<&str> = table.lines().collect();
        assert!(
            lines[1].starts_with("'=SUM(A1),'=SUM(A1),") && lines[1].contains(",1,yes,400.0,4.0,-1.000,2.000,0.500,"),
            "{table}"
        );
        let n_cells = lines[0].split(',').count();
        assert!(lines.iter().all(|line| line.split(',').count() == n_cells), "{table}");
        assert!(!table.contains("W/m²"), "no floor is known");
    }
}
