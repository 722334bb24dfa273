//! What rows, strips and cells of the panel read and write.

use clerestory_transport::basis::{LightBasis, SourceKind};
use clerestory_transport::lamps::FreeLamp;
use clerestory_transport::light::{LightRig, LightSetting, luminance};
use eframe::egui::{Modifiers, Ui};
use glam::Vec3;

use super::LightsState;
use super::groups::Item;
use super::listed::{LightOf, Listed};
use super::scale::Measure;
use crate::action::Action;
use crate::look::Look;
use crate::panels::color::Tint;

/// Relative difference that numbers have by rounding alone.
const SAME: f32 = 1e-6;
/// Luminance of colors below which there is nothing of them to keep.
const DARKEST: f32 = 1e-3;

/// The lights of a frame, and the look that they are set in.
pub(super) struct Mix<'a> {
    /// All of them.
    pub lights: &'a [Listed<'a>],
    /// Those that are shown, sorted.
    pub items: &'a [Item],
    /// Keys as they are shown, from the first to the last; a table, which is sorted, sets its own.
    pub order: Vec<String>,
    pub look: &'a mut Look,
    /// What is open.
    pub basis: &'a LightBasis,
    /// What the file itself is lit by.
    pub file: &'a LightRig,
    pub state: &'a mut LightsState,
    pub actions: &'a mut Vec<Action>,
}

impl Mix<'_> {
    /// What a light is set to by itself.
    pub fn setting(&self, light: &Listed) -> LightSetting {
        self.look.lights.own_setting(&light.key)
    }

    /// Whether a light is dark: muted, in a muted group, or not soloed while others are.
    pub fn is_dark(&self, key: &str) -> bool {
        let solo = &self.state.solo;
        if solo.is_empty() { self.look.lights.setting(key).muted } else { !solo.contains(key) }
    }

    /// Whether something of a light is not as in the file; of the sky, where and what it is as well. Free lamps are in no file.
    pub fn differs(&self, light: &Listed) -> bool {
        let lights = &self.look.lights;
        let is_dome = matches!(&light.light, LightOf::Scene(source) if shines_from_dome(source.kind));
        (is_dome && lights.sky != self.file.sky)
            || lights.lights.get(&light.key) != self.file.lights.get(&light.key)
            || lights.panels.contains_key(&light.key)
    }

    /// How a light's intensity is told.
    pub fn measure(&self, light: &Listed, setting: &LightSetting) -> Measure {
        let layout = &self.state.layout;
        layout.scale.measure(light, setting, layout.efficacy)
    }

    /// Gives a light another tint.
    pub fn set_tint(&mut self, light: &Listed, tint: Tint) {
        let tinted = tinted(self.setting(light), tint, light.own_color());
        // There and back is no change.
        let of_file = self.file.own_setting(&light.key).intensity;
        let is_of_file = (tinted.intensity - of_file).abs() <= SAME * of_file;
        let intensity = if is_of_file { of_file } else { tinted.intensity };
        self.look.lights.set(&light.key, LightSetting { intensity, ..tinted });
    }

    /// Everything about a light as in the file, or as it was added. A lamp that shines in its place goes.
    pub fn reset(&mut self, key: &str) {
        if self.look.lights.is_replaced(key) {
            let stands_in = |lamp: &&FreeLamp| lamp.replaces.as_deref() == Some(key);
            let lamps = self.look.lights.lamps.iter().filter(stands_in);
            for lamp in lamps.map(|lamp| lamp.key.clone()).collect::<Vec<_>>() {
                self.look.remove_lamp(&lamp);
                self.state.lamps.chosen.take_if(|chosen| *chosen == lamp);
            }
        }
        self.look.lights.set(key, self.setting_at_first(key));
        self.look.lights.panels.remove(key);
        if self.basis.source(key).is_some_and(|source| shines_from_dome(source.kind)) {
            self.look.lights.sky.clone_from(&self.file.sky);
        }
    }

    /// What a light is set to in the file, or when it was added: a lamp in the place of one of the file has the color of that.
    fn setting_at_first(&self, key: &str) -> LightSetting {
        let lamp = self.look.lights.lamps.iter().find(|lamp| lamp.key == key);
        let replaced = lamp.and_then(|lamp| self.basis.source(lamp.replaces.as_deref()?));
        replaced.map_or_else(
            || self.file.own_setting(key),
            |source| {
                let color = (source.color != Vec3::ONE).then(|| source.color.to_array());
                LightSetting { color, ..LightSetting::default() }
            },
        )
    }

    /// Everything about all lights as in the file. Added lamps go with their names, which later ones may have.
    pub fn reset_all(&mut self) {
        let lamps: Vec<String> = self.look.lights.lamps.iter().map(|lamp| lamp.key.clone()).collect();
        lamps.iter().for_each(|lamp| _ = self.look.remove_lamp(lamp));
        self.look.lights = self.file.clone();
    }

    /// Keys of some lights.
    pub fn keys(&self, lights: &[usize]) -> Vec<String> {
        lights.iter().map(|idx| self.lights[*idx].key.clone()).collect()
    }

    /// A click on the name of a light. What is selected alone is also the chosen lamp of the picture, if it is one.
    pub fn click(&mut self, ui: &Ui, key: &str) {
        let modifiers = ui.input(|input| input.modifiers);
        self.state.selection.click(key, modifiers, &self.order);
        self.selected(key);
    }

    /// Arrow keys: the selection goes so many rows down, from the name that has the keyboard or what was touched last. Answers whether
    /// it did.
    pub fn step(&mut self, from: Option<&str>, by: isize, modifiers: Modifiers) -> bool {
        let Some(key) = self.state.selection.step(from, by, modifiers, &self.order) else { return false };
        self.selected(&key);
        self.state.scroll_to = Some(key);
        true
    }

    /// What was touched in the selection is also the chosen lamp of the picture, if it is one.
    fn selected(&mut self, key: &str) {
        let is_lamp = self.look.lights.lamps.iter().any(|lamp| lamp.key == key);
        let is_chosen = is_lamp && self.state.selection.has(key);
        self.state.choose_lamp(is_chosen.then(|| key.to_owned()));
    }
}

/// A light under another tint. A color temperature leaves it the lumen of the color that it hides, be it that of the file; that color
/// stays beneath it, and comes back with its lumen. A color counts channel by channel.
fn tinted(before: LightSetting, tint: Tint, own_color: Vec3) -> LightSetting {
    let color = if tint.kelvin.is_some() { before.color } else { tint.color };
    let after = LightSetting { color, kelvin: tint.kelvin, ..before };
    let intensity = before.intensity * (hidden_luminance(&after, own_color) / hidden_luminance(&before, own_color));
    LightSetting { intensity, ..after }
}

/// Luminance of the color that a color temperature hides; 1 where it hides none, or one of which there is nothing to keep.
fn hidden_luminance(setting: &LightSetting, own_color: Vec3) -> f32 {
    let hidden = LightSetting { kelvin: None, ..*setting }.tint(own_color);
    let is_hidden = setting.kelvin.is_some() && luminance(hidden) >= DARKEST;
    if is_hidden { luminance(hidden) } else { 1.0 }
}

/// Whether a light is the sky that can be turned and exchanged.
fn shines_from_dome(kind: SourceKind) -> bool {
    matches!(kind, SourceKind::Dome { .. })
}

#[cfg(test)]
mod tests {
    use clerestory_transport::basis::LightSource;

    use super::*;
    use crate::support::lamp;

    const FROM_FILE: Tint = Tint { color: None, kelvin: None };
    const KELVIN: Tint = Tint { color: None, kelvin: Some(3000.0) };

    fn of(color: [f32; 3]) -> Tint {
        Tint { color: Some(color), kelvin: None }
    }

    /// Intensity and luminance of a light of the file after one tint after another.
    fn after(own_color: Vec3, tints: &[Tint]) -> [f32; 2] {
        let setting = tints.iter().fold(LightSetting::default(), |before, tint| tinted(before, *tint, own_color));
        [setting.intensity, luminance(setting.emission(own_color, 1.0))]
    }

    fn is_near(a: f32, b: f32) -> bool {
        (a - b).abs() < 1e-5
    }

    #[test]
    fn a_lamp_in_the_place_of_one_of_the_file_is_reset_to_the_color_of_that() {
        let warm: [f32; 3] = [1.0, 0.7, 0.4];
        let source = LightSource { color: warm.into(), ..LightSource::plain("desk", SourceKind::Point, 0..1) };
        let basis = LightBasis::new(vec![source]);
        let setting = LightSetting { intensity: 3.0, color: Some([0.0, 1.0, 0.0]), kelvin: None, muted: true };
        let mut look = Look::default();
        look.lights.lamps = ["moved", "new"].map(|key| FreeLamp { setting, ..lamp(key) }).into();
        look.lights.lamps[0].replaces = Some("desk".into());
        let (file, mut state, mut actions) = (basis.file_rig(), LightsState::default(), Vec::new());
        let mut mix = Mix {
            lights: &[],
            items: &[],
            order: Vec::new(),
            look: &mut look,
            basis: &basis,
            file: &file,
            state: &mut state,
            actions: &mut actions,
        };
        ["moved", "new"].iter().for_each(|key| mix.reset(key));
        let of_file = LightSetting { color: Some(warm), ..LightSetting::default() };
        let settings: Vec<LightSetting> = look.lights.lamps.iter().map(|lamp| lamp.setting).collect();
        assert_eq!(settings, [of_file, LightSetting::default()]);
    }

    #[test]
    fn a_color_temperature_leaves_every_color_its_lumen() {
        let (blue, warm, white) = (Vec3::Z, [1.0, 0.7, 0.4], [1.0; 3]);
        for (own_color, before) in [
            (blue, vec![]),
            (blue, vec![of(white)]),
            (blue, vec![of(white), KELVIN, of(warm)]),
            // What a lamp of the file has that was made movable.
            (Vec3::ONE, vec![of(warm)]),
            (Vec3::ONE, vec![]),
        ] {
            let lumen = after(own_color, &before)[1];
            let under = [&before[..], &[KELVIN]].concat();
            assert!(is_near(after(own_color, &under)[1], lumen), "{before:?}: {lumen}");
            let other = [&under[..], &[Tint { kelvin: Some(6500.0), ..KELVIN }]].concat();
            assert!(is_near(after(own_color, &other)[1], lumen), "{before:?}: {lumen}");
        }
    }

    #[test]
    fn the_way_back_from_a_color_temperature_is_the_way_there() {
        let (blue, warm, green) = (Vec3::Z, [1.0, 0.7, 0.4], [0.0, 1.0, 0.0]);
        for tints in [
            vec![KELVIN, FROM_FILE],
            vec![KELVIN, of(green), FROM_FILE],
            vec![of(warm), KELVIN, of(warm)],
            vec![of(warm), KELVIN, FROM_FILE],
        ] {
            assert!(is_near(after(blue, &tints)[0], 1.0), "{tints:?}");
        }
        // Of what is nearly dark nothing is kept.
        assert_eq!(after(Vec3::ONE, &[of([0.0; 3]), KELVIN])[0], 1.0);
    }
}
