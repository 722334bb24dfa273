//! Solo: while any light is soloed, all others are dark. It is not in the look, and a banner over the picture says so.

use std::collections::{BTreeMap, BTreeSet};

use clerestory_transport::basis::LightBasis;
use clerestory_transport::light::{LightRig, LightSetting};
use eframe::egui::{self, Align2, Area, Button, Frame, Id, Order, Rect, RichText, Ui, vec2};

use super::LightsState;
use crate::look::Look;
use crate::theme;

/// Names that the banner tells; more are counted.
const MOST_NAMES: usize = 3;
/// Width of the button and of what is around both, and least width of the words, points.
const BESIDE_WORDS: f32 = 150.0;
const LEAST_WORDS: f32 = 80.0;

impl LightsState {
    /// Brings solo in step with the lights: from a light to the lamp that takes its place, and back to it. What is gone is soloed
    /// no longer.
    pub fn follow_solo(&mut self, basis: &LightBasis, rig: &LightRig) {
        let before = std::mem::replace(&mut self.stand_ins, stand_ins(rig));
        let solo = &mut self.solo;
        for (lamp, of) in self.stand_ins.iter().filter(|(lamp, of)| !before.contains_key(*lamp) && rig.is_replaced(of))
        {
            if solo.remove(of) {
                solo.insert(lamp.clone());
            }
        }
        for (lamp, of) in before.iter().filter(|(lamp, _)| !self.stand_ins.contains_key(*lamp)) {
            if solo.remove(lamp) {
                solo.insert(of.clone());
            }
        }
        solo.retain(|key| basis.source(key).is_some() || rig.lamps.iter().any(|lamp| lamp.key == *key));
    }

    /// The scene is read again: solo stays on.
    pub fn keep_solo(&mut self, before: &mut LightsState) {
        self.solo = std::mem::take(&mut before.solo);
        self.stand_ins = std::mem::take(&mut before.stand_ins);
    }
}

/// Keys of lamps that shine in the place of lights of the scene, and of those.
fn stand_ins(rig: &LightRig) -> BTreeMap<String, String> {
    rig.lamps.iter().filter_map(|lamp| Some((lamp.key.clone(), lamp.replaces.clone()?))).collect()
}

/// The lights as they are seen: while any is soloed, all others are dark. Solo wins over mute, of a group as well, but a light
/// does not shine beside a soloed lamp that took its place.
pub fn heard(basis: &LightBasis, rig: &LightRig, solo: &BTreeSet<String>) -> LightRig {
    let mut rig = rig.clone();
    let is_solo = |key: &str| solo.contains(key);
    if basis.sources.iter().any(|source| is_solo(&source.key)) || rig.lamps.iter().any(|lamp| is_solo(&lamp.key)) {
        for source in basis.sources.iter().filter(|source| !is_solo(&source.key)) {
            rig.lights.entry(source.key.clone()).or_default().muted = true;
        }
        let doubled: BTreeSet<String> =
            stand_ins(&rig).into_iter().filter(|(lamp, _)| is_solo(lamp)).map(|(_, of)| of).collect();
        for key in solo.difference(&doubled) {
            if let Some(setting) = rig.lights.get_mut(key) {
                setting.muted = false;
            }
        }
        for lamp in &mut rig.lamps {
            lamp.setting.muted = !is_solo(&lamp.key);
        }
        for group in rig.groups.values_mut() {
            group.muted = false;
        }
    }
    rig
}

/// What one press of a button for many lights does: all of them soloed, or none if all were.
pub(super) fn toggle(solo: &mut BTreeSet<String>, keys: &[String]) {
    let is_all = keys.iter().all(|key| solo.contains(key));
    for key in keys {
        if is_all {
            solo.remove(key)
        } else {
            solo.insert(key.clone())
        };
    }
}

/// Mutes all of some lights, or none if all were. One in whose place a lamp shines stays off among others: both would shine.
pub(super) fn toggle_mute(rig: &mut LightRig, keys: &[String]) {
    let replaced = rig.replaced();
    let free: Vec<&String> = keys.iter().filter(|key| !replaced.contains(key.as_str())).collect();
    let keys = if free.is_empty() { keys.iter().collect() } else { free };
    let is_all = keys.iter().all(|key| rig.own_setting(key).muted);
    for key in keys {
        rig.set(key, LightSetting { muted: !is_all, ..rig.own_setting(key) });
    }
}

/// What the letters of a light's row do, for its menu in the picture.
pub fn letters_menu(ui: &mut Ui, key: &str, rig: &mut LightRig, solo: &mut BTreeSet<String>) {
    if ui.button("Solo this alone").clicked() {
        *solo = [key.to_owned()].into();
        ui.close();
    }
    let words = if rig.own_setting(key).muted { "Unmute" } else { "Mute" };
    if ui.button(words).clicked() {
        toggle_mute(rig, &[key.to_owned()]);
        ui.close();
    }
}

/// The banner at the top of the picture while a solo is on, with a button that clears it.
pub fn solo_banner_ui(ui: &Ui, picture: Rect, look: &Look, solo: &mut BTreeSet<String>) {
    if solo.is_empty() {
        return;
    }
    let area = Area::new(Id::unique("solo banner")).order(Order::Middle).pivot(Align2::CENTER_TOP);
    area.fixed_pos(picture.center_top() + vec2(0.0, 10.0)).constrain_to(picture).show(ui.ctx(), |ui| {
        let frame = Frame::popup(ui.style()).fill(theme::ACCENT).inner_margin(egui::Margin::symmetric(12, 5));
        frame.show(ui, |ui| {
            ui.horizontal(|ui| {
                let text = RichText::new(words(look, solo)).color(theme::ON_ACCENT).strong();
                ui.scope(|ui| {
                    ui.set_max_width((picture.width() - BESIDE_WORDS).max(LEAST_WORDS));
                    ui.add(egui::Label::new(text).truncate());
                });
                let clear =
                    Button::new(RichText::new("Clear solo").color(theme::ACCENT)).fill(theme::ON_ACCENT).small();
                if ui.add(clear).on_hover_text("All lights shine again").clicked() {
                    solo.clear();
                }
            });
        });
    });
}

fn words(look: &Look, solo: &BTreeSet<String>) -> String {
    let names: Vec<&str> = solo.iter().take(MOST_NAMES).map(|key| look.name_of(key)).collect();
    let more = solo.len() - names.len();
    let names = names.join(", ");
    if more > 0 { format!("Solo: {names} and {more} more") } else { format!("Solo: {names}") }
}

#[cfg(test)]
mod tests {
    use clerestory_transport::basis::{LightSource, SourceKind};
    use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit};
    use clerestory_transport::light::LightGroup;
    use glam::Vec3;

    use super::*;

    fn basis() -> LightBasis {
        let source = |key: &str, kind| LightSource::plain(key, kind, 0..1);
        LightBasis::new(vec![
            source("a", SourceKind::Point),
            source("b", SourceKind::Emitter),
            source("unlit", SourceKind::Constant),
        ])
    }

    #[test]
    fn solo_darkens_all_other_lights_and_wins_over_mute() {
        let mut rig = LightRig::default();
        rig.set("a", LightSetting { muted: true, ..LightSetting::default() });
        let group = LightGroup { lights: ["a".to_owned()].into(), intensity: 0.5, muted: true };
        rig.groups.insert("group".into(), group);
        let solo = BTreeSet::from(["a".to_string()]);
        let coefficients = basis().project(&heard(&basis(), &rig, &solo));
        assert_eq!(coefficients, [[0.5; 3], [0.0; 3], [0.0; 3]]);
        assert_eq!(heard(&basis(), &rig, &BTreeSet::new()), rig);
    }

    #[test]
    fn a_solo_that_this_scene_does_not_know_darkens_nothing() {
        let rig = LightRig::default();
        assert_eq!(heard(&basis(), &rig, &BTreeSet::from(["elsewhere".to_string()])), rig);
    }

    /// The lights once the lamp `b` took the place of `a`.
    fn exchanged() -> LightRig {
        let mut rig = LightRig::default();
        rig.set("a", LightSetting { muted: true, ..LightSetting::default() });
        let (position, aim, setting) = (Vec3::ZERO, Vec3::NEG_Y, LightSetting::default());
        let (key, shape, unit) = ("free".to_owned(), LampShape::Point, LampUnit::Candela);
        let replaces = Some("a".to_owned());
        rig.lamps.push(FreeLamp { key, shape, position, aim, strength: 1.0, unit, setting, turn_rad: 0.0, replaces });
        rig
    }

    #[test]
    fn solo_goes_to_the_lamp_that_takes_the_place_of_a_light_and_back() {
        let mut state = LightsState { solo: ["a".to_owned()].into(), ..LightsState::default() };
        let soloed = |state: &LightsState| state.solo.iter().cloned().collect::<Vec<_>>();
        for (rig, wanted) in [(exchanged(), "free"), (exchanged(), "free"), (LightRig::default(), "a")] {
            state.follow_solo(&basis(), &rig);
            assert_eq!(soloed(&state), [wanted]);
        }
        // Who solos the light that was exchanged wants that one.
        state.follow_solo(&basis(), &exchanged());
        state.solo = ["a".to_owned()].into();
        state.follow_solo(&basis(), &exchanged());
        assert_eq!(soloed(&state), ["a"]);
        state.solo = ["free".to_owned(), "elsewhere".to_owned()].into();
        let deleted = LightRig { lamps: Vec::new(), ..exchanged() };
        let mut again = LightsState::default();
        again.keep_solo(&mut state);
        again.follow_solo(&LightBasis::new(Vec::new()), &deleted);
        assert!(again.solo.is_empty(), "none of them is left");
    }

    #[test]
    fn a_light_does_not_shine_beside_a_soloed_lamp_in_its_place() {
        let of = |solo: &[&str]| {
            let solo = solo.iter().map(|key| (*key).to_owned()).collect();
            let heard = heard(&basis(), &exchanged(), &solo);
            [heard.setting("a").muted, heard.setting("free").muted]
        };
        assert_eq!(of(&["a"]), [false, true]);
        assert_eq!(of(&["free"]), [true, false]);
        assert_eq!(of(&["a", "free"]), [true, false]);
    }

    #[test]
    fn many_lights_are_soloed_and_muted_at_once() {
        let keys = ["a", "b"].map(str::to_owned);
        let mut solo = BTreeSet::from(["a".to_owned()]);
        toggle(&mut solo, &keys);
        assert_eq!(solo.len(), 2);
        toggle(&mut solo, &keys);
        assert!(solo.is_empty());
        let mut rig = LightRig::default();
        toggle_mute(&mut rig, &keys);
        assert!(rig.setting("a").muted && rig.setting("b").muted);
        toggle_mute(&mut rig, &keys);
        assert_eq!(rig, LightRig::default());
        // The lamp `free` shines in the place of `a`.
        let mut rig = exchanged();
        let keys = ["a", "b", "free"].map(str::to_owned);
        for muted in [[true, true, true], [true, false, false]] {
            toggle_mute(&mut rig, &keys);
            assert_eq!(["a", "b", "free"].map(|key| rig.own_setting(key).muted), muted);
        }
        toggle_mute(&mut rig, &keys[..1]);
        assert!(!rig.own_setting("a").muted, "by itself it does as it is told");
    }
}
