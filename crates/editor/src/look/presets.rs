//! Looks that are made of what a scene has: day, dusk, night and exhibition.
//!
//! Every light is dimmed by its part in the scene. Light from outside (sky, sun, directional lamps) makes the hour; of the
//! lamps, those that point at something are accents and the others general light. Rooms without a window are told from
//! others, for there the lamps have to make the hour.

use clerestory_transport::basis::{LightBasis, LightSource, SourceKind};
use clerestory_transport::lamps::{FreeLamp, LampShape};
use clerestory_transport::light::{LightRig, LightSetting, PanelSpot};
use glam::Vec3;

use super::Look;
use super::display::Display;
use super::snapshot::Snapshot;

/// A look that any scene can have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// Light from outside at its full; without any, neutral light from all lamps.
    Day,
    /// A dim blue sky, a low warm sun, lamps on.
    Dusk,
    /// Warm lamps, hardly anything from outside.
    Night,
    /// Accents on what is shown, the rest held back.
    Exhibition,
}

/// What a light is in its scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Sky,
    Sun,
    Accent,
    General,
    /// Unlit surfaces: they light nothing, and shine as what there is of other light would make them.
    Unlit,
}

/// Factor to the file, and color temperature; none keeps the file's color.
type Level = (f32, Option<f32>);

/// A color with a channel below this share of its largest is meant to be a color: it is dimmed and not tinted.
const SATURATED: f32 = 0.35;
/// A shining surface with this much more blue than red (that of a black body of about 7000 K) stands for the sky in a window.
const SKYLIGHT: f32 = 1.1;
/// The spot that stands for a whole panel in an exhibition.
const POOL: PanelSpot = PanelSpot { position: [0.5, 0.5], radius: 0.35, color: None, intensity: 1.0 };

impl Preset {
    /// All of them, with their names in files and for people.
    pub const ALL: [(Preset, &'static str, &'static str); 4] = [
        (Preset::Day, "day", "Day"),
        (Preset::Dusk, "dusk", "Dusk"),
        (Preset::Night, "night", "Night"),
        (Preset::Exhibition, "exhibition", "Exhibition"),
    ];

    /// Name for people.
    pub fn words(self) -> &'static str {
        Preset::ALL.iter().find(|(preset, ..)| *preset == self).map_or("", |(.., words)| words)
    }

    /// What it makes of a scene, for people.
    pub fn hint(self) -> &'static str {
        match self {
            Preset::Day => "Light from outside at its full; without any, neutral light of all lamps",
            Preset::Dusk => "A dim blue sky, a low warm sun, lamps on",
            Preset::Night => "Warm lamps, hardly anything from outside",
            Preset::Exhibition => "Accents on what is shown, the rest held back",
        }
    }

    /// The preset for a scene with these lights. The sky of `look` stays, and so do its free lamps, where they are; all are
    /// dimmed like the others. Lights in whose place a free lamp shines stay dark.
    pub fn of(self, basis: &LightBasis, look: &Look) -> Snapshot {
        let stood_in_for = look.lights.replaced();
        let (replaced, own): (Vec<&LightSource>, Vec<&LightSource>) =
            basis.sources.iter().partition(|source| stood_in_for.contains(source.key.as_str()));
        let parts: Vec<(&LightSource, Part)> = own.into_iter().map(|source| (source, part(source))).collect();
        let lamps = look.lights.lamps.iter().map(|lamp| (lamp, lamp_part(lamp)));
        let lamps: Vec<(&FreeLamp, Part)> = lamps.collect();
        let all = || parts.iter().map(|(_, part)| *part).chain(lamps.iter().map(|(_, part)| *part));
        let place = match () {
            () if !all().any(|part| matches!(part, Part::Sky | Part::Sun)) => Place::Room,
            () if all().any(|part| matches!(part, Part::Accent | Part::General)) => Place::Both,
            () => Place::Outside,
        };
        let has_accents = all().any(|part| part == Part::Accent);
        let mut rig = LightRig { sky: look.lights.sky.clone(), ..LightRig::default() };
        for source in replaced {
            rig.set(&source.key, LightSetting { muted: true, ..LightSetting::default() });
        }
        for (source, part) in &parts {
            let mut setting = setting(self.level(*part, place, has_accents), source.color);
            if *part == Part::Unlit {
                // Whether and in which color they are seen is no matter of the hour.
                let own = look.lights.lights.get(&source.key).copied().unwrap_or_default();
                setting = LightSetting { intensity: setting.intensity, ..own };
            }
            if setting != LightSetting::default() {
                rig.lights.insert(source.key.clone(), setting);
            }
            let is_panel = matches!(source.kind, SourceKind::Panel { .. });
            if self == Preset::Exhibition && is_panel && !has_accents {
                rig.panels.insert(source.key.clone(), vec![POOL]);
            }
        }
        let dimmed = |(lamp, part): &(&FreeLamp, Part)| {
            let own = lamp.setting.color.map_or(Vec3::ONE, Vec3::from);
            let setting = setting(self.level(*part, place, has_accents), own);
            let color = if setting.kelvin.is_none() { lamp.setting.color } else { None };
            FreeLamp { setting: LightSetting { color, ..setting }, ..(*lamp).clone() }
        };
        rig.lamps = lamps.iter().map(dimmed).collect();
        let display = Display { compensation_ev: self.compensation_ev(), ..look.display };
        Snapshot { name: self.words().into(), lights: rig, display }
    }

    /// Stops that are added to the exposure that suits the picture: eyes get used to the dark, but not wholly.
    fn compensation_ev(self) -> f32 {
        match self {
            Preset::Day => 0.0,
            Preset::Dusk => -0.75,
            Preset::Night => -1.5,
            Preset::Exhibition => -0.5,
        }
    }

    fn level(self, part: Part, place: Place, has_accents: bool) -> Level {
        match (self, part) {
            (_, Part::Unlit) => {
                let of = |part: Part| self.level(part, place, has_accents).0;
                let [sky, lamps] = [of(Part::Sky), of(Part::General)];
                let factor = match place {
                    Place::Room => lamps,
                    Place::Both => sky.max(lamps),
                    Place::Outside => sky,
                };
                (factor, None)
            }
            (Preset::Day, Part::Sky | Part::Sun) => (1.0, None),
            (Preset::Day, _) if place == Place::Both => (0.0, None),
            (Preset::Day, _) => (1.0, Some(5000.0)),
            // Where nothing but the sky lights the scene, it has to stay bright enough to be metered.
            (Preset::Dusk, Part::Sky) => (0.05, Some(12_000.0)),
            (Preset::Dusk, Part::Sun) => (0.02, Some(2200.0)),
            (Preset::Dusk, Part::Accent) => (1.0, Some(2900.0)),
            (Preset::Dusk, Part::General) if place == Place::Room && has_accents => (0.3, Some(3000.0)),
            (Preset::Dusk, Part::General) => (0.6, Some(3000.0)),
            (Preset::Night, Part::Sky) => (0.002, Some(15_000.0)),
            // The moon.
            (Preset::Night, Part::Sun) if place == Place::Outside => (0.000_02, Some(4100.0)),
            (Preset::Night, Part::Sun) => (0.0, None),
            (Preset::Night, Part::Accent) => (0.7, Some(2500.0)),
            (Preset::Night, Part::General) if has_accents => (0.08, Some(2400.0)),
            (Preset::Night, Part::General) => (0.25, Some(2400.0)),
            (Preset::Exhibition, Part::Sky) => (0.05, None),
            (Preset::Exhibition, Part::Sun) if place == Place::Outside => (1.0, None),
            (Preset::Exhibition, Part::Sun) => (0.0, None),
            (Preset::Exhibition, Part::Accent) => (2.0, Some(3500.0)),
            (Preset::Exhibition, Part::General) if has_accents => (0.15, Some(4000.0)),
            (Preset::Exhibition, Part::General) => (1.0, Some(3500.0)),
        }
    }
}

/// Where a scene is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    /// No light comes from outside.
    Room,
    /// There are lamps, and light from outside.
    Both,
    /// There are no lamps.
    Outside,
}

fn setting((factor, kelvin): Level, own: Vec3) -> LightSetting {
    if factor == 0.0 {
        return LightSetting { muted: true, ..LightSetting::default() };
    }
    LightSetting { intensity: factor, kelvin: kelvin.filter(|_| !is_colored(own)), ..LightSetting::default() }
}

fn is_colored(color: Vec3) -> bool {
    color.min_element() < SATURATED * color.max_element()
}

/// What a light is in its scene.
fn part(source: &LightSource) -> Part {
    match source.kind {
        SourceKind::Sky | SourceKind::Dome { .. } => Part::Sky,
        SourceKind::Sun { .. } | SourceKind::Directional => Part::Sun,
        SourceKind::Spot => Part::Accent,
        SourceKind::Emitter if source.color.z > SKYLIGHT * source.color.x && !is_colored(source.color) => Part::Sky,
        SourceKind::Constant => Part::Unlit,
        _ => Part::General,
    }
}

fn lamp_part(lamp: &FreeLamp) -> Part {
    match lamp.shape {
        LampShape::Directional { .. } => Part::Sun,
        LampShape::Spot { .. } | LampShape::Profile { .. } => Part::Accent,
        _ => Part::General,
    }
}

#[cfg(test)]
mod tests {
    use clerestory_transport::lamps::LampUnit;
    use clerestory_transport::light::luminance;
    use clerestory_transport::sky::SkySetting;

    use super::*;

    fn source(key: &str, kind: SourceKind) -> LightSource {
        let columns = 0..if let SourceKind::Panel { resolution, .. } = kind { resolution * resolution } else { 1 };
        LightSource {
            key: key.into(),
            kind,
            columns,
            color: Vec3::new(1.0, 0.9, 0.8),
            strength: 10.0,
            origin: Default::default(),
        }
    }

    fn light(basis: &LightBasis, preset: Preset, key: &str) -> f32 {
        let rig = preset.of(basis, &Look::default()).lights;
        luminance(basis.project(&rig)[basis.source(key).unwrap().columns.start as usize].into())
    }

    #[test]
    fn the_hour_comes_from_outside_where_there_is_a_window() {
        let kinds = [("sky", SourceKind::Sky), ("spot", SourceKind::Spot), ("lamp", SourceKind::Emitter)];
        let basis = LightBasis::new(kinds.map(|(key, kind)| source(key, kind)).to_vec());
        let sky = Preset::ALL.map(|(preset, ..)| light(&basis, preset, "sky"));
        assert!(sky[0] > sky[1] && sky[1] > sky[2] && sky[3] < sky[0], "{sky:?}");
        let lamp = Preset::ALL.map(|(preset, ..)| light(&basis, preset, "lamp"));
        assert!(lamp[0] == 0.0 && lamp[1] > lamp[2] && lamp[2] > 0.0, "{lamp:?}");
        let ev = Preset::ALL.map(|(preset, ..)| preset.of(&basis, &Look::default()).display.compensation_ev);
        assert!(ev[0] == 0.0 && ev[0] > ev[1] && ev[1] > ev[2], "night is seen as darker than dusk: {ev:?}");
        assert!(light(&basis, Preset::Exhibition, "spot") > 4.0 * light(&basis, Preset::Exhibition, "lamp"));
    }

    #[test]
    fn a_shining_pane_as_blue_as_the_sky_is_a_window() {
        let pane = |color| LightSource { color, ..source("pane", SourceKind::Emitter) };
        let at_night = |color: Vec3| {
            let basis = LightBasis::new(vec![pane(color), source("lamp", SourceKind::Emitter)]);
            (light(&basis, Preset::Night, "pane") / light(&basis, Preset::Day, "pane"), basis)
        };
        let (window, basis) = at_night(Vec3::new(0.9, 1.0, 1.2));
        assert!(window < 0.01, "{window}");
        assert_eq!(light(&basis, Preset::Day, "lamp"), 0.0, "daylight does without lamps");
        for color in [Vec3::ONE, Vec3::new(0.1, 0.2, 1.0)] {
            assert!(at_night(color).0 > 0.1, "a lamp stays a lamp, also a blue one");
        }
    }

    #[test]
    fn no_preset_is_dark_whatever_a_scene_has() {
        let panel = SourceKind::Panel { resolution: 4, size_m: [1.0, 1.0] };
        let kinds = [SourceKind::Sky, SourceKind::Directional, SourceKind::Spot, SourceKind::Point, panel];
        for kind in kinds {
            let basis = LightBasis::new(vec![source("only", kind), source("unlit", SourceKind::Constant)]);
            for (preset, name, _) in Preset::ALL {
                let rig = preset.of(&basis, &Look::default()).lights;
                let lit = basis.project(&rig);
                let of_light = &basis.source("only").unwrap().columns;
                let columns = &lit[of_light.start as usize..of_light.end as usize];
                assert!(columns.iter().any(|rgb| luminance((*rgb).into()) > 0.0), "{name} of {kind:?} is dark");
            }
        }
    }

    #[test]
    fn unlit_surfaces_go_with_the_hour_and_stay_as_the_look_has_them_otherwise() {
        let with = |kinds: &[SourceKind]| {
            let lights = kinds.iter().enumerate().map(|(nth, kind)| source(&nth.to_string(), *kind));
            LightBasis::new(lights.chain([source("unlit", SourceKind::Constant)]).collect())
        };
        let (sky, lamp) = (SourceKind::Sky, SourceKind::Point);
        for (kinds, expected) in [
            (&[sky][..], [1.0, 0.05, 0.002, 0.05]),
            (&[lamp], [1.0, 0.6, 0.25, 1.0]),
            (&[sky, lamp], [1.0, 0.6, 0.25, 1.0]),
        ] {
            let basis = with(kinds);
            let factors = Preset::ALL.map(|(preset, ..)| {
                let setting = preset.of(&basis, &Look::default()).lights.setting("unlit");
                assert_eq!(setting, LightSetting { intensity: setting.intensity, ..LightSetting::default() });
                setting.intensity
            });
            assert_eq!(factors, expected, "{kinds:?}");
        }
        let mut look = Look::default();
        let own = LightSetting { intensity: 9.0, color: Some([1.0, 0.0, 0.0]), muted: true, ..LightSetting::default() };
        look.lights.set("unlit", own);
        let dusk = Preset::Dusk.of(&with(&[sky]), &look).lights.setting("unlit");
        assert_eq!(dusk, LightSetting { intensity: 0.05, ..own });
    }

    #[test]
    fn colored_lights_keep_their_color_and_free_lamps_their_place() {
        let mut neon = source("neon", SourceKind::Emitter);
        neon.color = Vec3::new(1.0, 0.05, 0.4);
        let basis = LightBasis::new(vec![neon]);
        let mut look = Look::default();
        let lamp = FreeLamp {
            key: "l".into(),
            shape: LampShape::Point,
            position: Vec3::ONE,
            aim: Vec3::ZERO,
            strength: 5.0,
            unit: LampUnit::Lumen,
            setting: LightSetting { muted: true, ..LightSetting::default() },
            turn_rad: 0.0,
            replaces: None,
        };
        look.lights.lamps.push(lamp);
        let night = Preset::Night.of(&basis, &look);
        assert_eq!(night.lights.lights["neon"].kelvin, None);
        let lamp = &night.lights.lamps[0];
        assert!(lamp.position == Vec3::ONE && !lamp.setting.muted && lamp.setting.kelvin.is_some(), "{lamp:?}");
    }

    #[test]
    fn the_sky_stays_and_a_light_that_was_exchanged_stays_dark() {
        let basis = LightBasis::new(vec![source("spot", SourceKind::Spot), source("lamp", SourceKind::Emitter)]);
        let mut look = Look::default();
        look.lights.sky = Some(SkySetting { rotation_deg: 40.0, ..SkySetting::default() });
        look.lights.set("spot", LightSetting { muted: true, ..LightSetting::default() });
        let lamp = FreeLamp {
            key: "free".into(),
            shape: LampShape::Point,
            position: Vec3::ONE,
            aim: Vec3::ZERO,
            strength: 5.0,
            unit: LampUnit::Lumen,
            setting: LightSetting::default(),
            turn_rad: 0.0,
            replaces: Some("spot".into()),
        };
        look.lights.lamps.push(lamp);
        for (preset, name, _) in Preset::ALL {
            let lights = preset.of(&basis, &look).lights;
            assert_eq!(lights.sky, look.lights.sky, "{name}");
            assert!(lights.is_replaced("spot") && !lights.setting("lamp").muted, "{name}");
        }
        look.lights.lamps.clear();
        assert!(!Preset::Night.of(&basis, &look).lights.setting("spot").muted, "nothing shines in its place");
    }
}
