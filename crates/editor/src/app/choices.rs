//! Panels, units of lamps and a sky that were chosen: part of the look, made by the session, and remembered for each scene.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clerestory_transport::emitters::PanelRequest;
use clerestory_transport::lamp_units::LampUnits;
use clerestory_transport::sky::SkySetting;
use serde::{Deserialize, Serialize};

use super::App;
use crate::look::scene::SceneChoice;
use crate::session::{Chosen, ChosenSky, Source};

/// Scenes whose choices are remembered.
const MOST_SCENES: usize = 100;

/// What is chosen, and what came of it.
pub(super) struct Choices {
    /// Of all scenes.
    pub kept: KeptChoices,
    /// The sky that the scene is baked under, or will be; a step of undo remembers it.
    pub sky: Option<ChosenSky>,
    /// What the look said before somebody chose something that is being made.
    before: Option<SceneChoice>,
    /// What the open scene could not be made: it is not tried again.
    failed: Option<(SceneChoice, Option<ChosenSky>)>,
}

impl Choices {
    pub fn new(kept: KeptChoices) -> Choices {
        Choices { kept, sky: None, before: None, failed: None }
    }
}

/// What was chosen about scenes, the newest first. It outlasts the program.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(super) struct KeptChoices(Vec<Kept>);

#[derive(Clone, PartialEq, Serialize, Deserialize)]
struct Kept {
    /// From the root; the scene that is part of the program lies nowhere.
    scene: Option<PathBuf>,
    panels: BTreeMap<String, u32>,
    unitless: bool,
    /// What is over it, and the divisions of its patches.
    #[serde(default)]
    sky: Option<(SkySetting, u32)>,
}

impl KeptChoices {
    /// What is chosen about something that is opened.
    pub fn of(&self, source: &Source) -> Chosen {
        let kept = place(source).and_then(|place| self.0.iter().find(|kept| kept.scene == place));
        kept.map_or_else(Chosen::default, |kept| Chosen {
            panels: requests(&kept.panels),
            units: if kept.unitless { LampUnits::Unitless } else { LampUnits::Photometric },
            sky: kept.sky.clone().map(|(setting, divisions)| ChosenSky { setting, light: None, divisions }),
        })
    }

    fn keep(&mut self, source: &Source, chosen: &Chosen) {
        let Some(scene) = place(source) else { return };
        self.0.retain(|kept| kept.scene != scene);
        let SceneChoice { panels, units, .. } = choice_of(chosen);
        let unitless = units == Some(LampUnits::Unitless);
        // One of a bake that was opened is not known well enough to be made again.
        let sky = chosen.sky.as_ref().filter(|sky| sky.setting.names_a_sky());
        let sky = sky.map(|sky| (SkySetting { map: None, ..sky.setting.clone() }, sky.divisions));
        if unitless || !panels.is_empty() || sky.is_some() {
            self.0.insert(0, Kept { scene, panels, unitless, sky });
        }
        self.0.truncate(MOST_SCENES);
    }
}

/// Under what the choices of a scene are found; what came as bytes has no place.
fn place(source: &Source) -> Option<Option<PathBuf>> {
    match source {
        Source::BuiltIn => Some(None),
        Source::File(path) => Some(Some(std::path::absolute(path).unwrap_or_else(|_| path.clone()))),
        Source::Bytes { .. } => None,
    }
}

fn requests(panels: &BTreeMap<String, u32>) -> Vec<PanelRequest> {
    panels.iter().map(|(node, resolution)| PanelRequest { node: node.clone(), resolution: *resolution }).collect()
}

/// What was chosen, as a look keeps it.
fn choice_of(chosen: &Chosen) -> SceneChoice {
    SceneChoice {
        panels: chosen.panels.iter().map(|panel| (panel.node.clone(), panel.resolution)).collect(),
        units: (chosen.units != LampUnits::default()).then_some(chosen.units),
        sky: chosen.sky.as_ref().map(|sky| sky.divisions),
    }
}

impl App {
    /// Makes a light a panel of so many texels along each side, or none of it any more.
    pub(super) fn choose_panel(&mut self, node: String, resolution: Option<u32>) {
        self.choose(|app| {
            match resolution {
                Some(resolution) => app.look.scene.panels.insert(node, resolution),
                None => app.look.scene.panels.remove(&node),
            };
        });
    }

    pub(super) fn choose_units(&mut self, units: LampUnits) {
        self.choose(|app| app.look.scene.units = Some(units));
    }

    /// Puts the sky of the look over the scene, which is baked anew even where one is there.
    pub(super) fn choose_sky(&mut self, sky: Option<SkySetting>, divisions: u32) {
        let prepares = self.choose(|app| {
            (app.look.lights.sky, app.look.scene.sky) = (sky, Some(divisions));
            app.choices.sky = app.sky_of_look(divisions);
        });
        if self.session.is_opening() {
            return;
        }
        self.say("Baking the scene under its sky");
        if !prepares {
            self.start_bake();
        }
    }

    /// Takes the sky away, from the look too: it would shine no more.
    pub(super) fn choose_no_sky(&mut self) {
        self.choose(|app| (app.look.lights.sky, app.look.scene.sky) = (None, None));
    }

    /// Answers whether another scene is made.
    fn choose(&mut self, edit: impl FnOnce(&mut App)) -> bool {
        if self.session.is_opening() {
            self.complain("a file is being opened; choose this once it is there");
            return false;
        }
        let before = self.look.scene.clone();
        self.choices.failed = None;
        self.as_one_step(edit);
        self.choices.before = Some(before).filter(|_| self.prepare_chosen());
        self.choices.before.is_some()
    }

    /// What was chosen about the scene that is open.
    fn open_choice(&self) -> SceneChoice {
        self.session.opened.as_ref().map_or_else(SceneChoice::default, |opened| choice_of(&opened.chosen))
    }

    /// What the look makes of the open scene, as far as that can be.
    fn wanted_choice(&self) -> SceneChoice {
        let basis = self.session.basis();
        let is_known = |node: &str| basis.is_some_and(|basis| basis.source(node).is_some());
        let panels = self.look.scene.panels.iter().filter(|(node, _)| is_known(node));
        // Undo may bring one back that nothing but the choice tells.
        let has_sky =
            self.choices.sky.is_some() || basis.is_some_and(|basis| basis.sky_light(&self.look.lights).is_some());
        SceneChoice {
            panels: panels.map(|(node, resolution)| (node.clone(), *resolution)).collect(),
            units: self.look.scene.units.filter(|units| *units != LampUnits::default()),
            sky: self.look.scene.sky.filter(|_| has_sky),
        }
    }

    /// Has the open scene prepared and baked anew where the look makes another one of it. Answers whether it does.
    pub(super) fn prepare_chosen(&mut self) -> bool {
        self.follow_sky();
        let (wanted, open) = (self.wanted_choice(), self.open_choice());
        let has_failed = self
            .choices
            .failed
            .as_ref()
            .is_some_and(|(scene, sky)| *scene == self.look.scene && *sky == self.choices.sky);
        let can_be = self.session.has_scene() && !self.session.is_opening();
        let is_other = wanted != open || self.choices.sky.as_ref() != self.open_sky();
        let prepares = is_other && !has_failed && can_be;
        if prepares {
            let (panels, units) = (requests(&wanted.panels), wanted.units.unwrap_or_default());
            self.session.choose(Chosen { panels, units, sky: self.choices.sky.clone() });
        }
        prepares
    }

    /// The sky of the look is baked as it is now, where the look wants it in other patches than before.
    pub(super) fn follow_sky(&mut self) {
        let wanted = self.wanted_choice().sky;
        if self.session.has_scene() && self.choices.sky.as_ref().map(|sky| sky.divisions) != wanted {
            self.choices.sky = wanted.and_then(|divisions| self.sky_of_look(divisions));
        }
    }

    /// The sky that the open scene was prepared with.
    fn open_sky(&self) -> Option<&ChosenSky> {
        self.session.opened.as_ref()?.chosen.sky.as_ref()
    }

    /// The sky of the look in patches; one that only turns and dims what is there is made of that.
    fn sky_of_look(&self, divisions: u32) -> Option<ChosenSky> {
        let light = self.session.basis()?.sky_light(&self.look.lights);
        let before = self.open_sky().map_or_else(SkySetting::default, |sky| sky.setting.clone());
        let setting = match self.look.lights.sky.clone() {
            None => before,
            Some(own) if own.names_a_sky() => own,
            Some(own) => SkySetting { rotation_deg: own.rotation_deg, intensity: own.intensity, ..before },
        };
        Some(ChosenSky { setting, light, divisions })
    }

    /// Says that the look has a sky which the open scene has no columns for.
    pub(super) fn missing_sky(&self) -> Option<String> {
        let basis = self.session.basis().filter(|basis| basis.sky.is_none())?;
        let words = if basis.is_measured() {
            "the look has a sky, which does not shine on pictures that were taken"
        } else if self.session.has_scene() {
            "the look has a sky, which was not baked; “Bake with sky” below the lights lets it shine"
        } else {
            "the look has a sky, which was not baked; open the scene of this bake, and “Bake with sky”"
        };
        self.look.rigs().any(|rig| rig.sky.is_some()).then(|| words.into())
    }

    /// The scene is open, or was found, with what is chosen about it: the look says so, too, and is as saved as it was.
    pub(super) fn adopt_choice(&mut self) {
        let open = self.open_choice();
        (self.choices.sky, self.choices.failed) = (self.open_sky().cloned(), None);
        for look in [&mut self.look, &mut self.saved_look] {
            look.scene = std::mem::take(&mut look.scene).or(&open);
        }
    }

    /// The scene was prepared again for what was chosen.
    pub(super) fn chosen_is_made(&mut self) {
        if let Some(opened) = &self.session.opened
            && let Some(source) = &opened.source
        {
            self.choices.kept.keep(source, &opened.chosen);
        }
        (self.choices.before, self.choices.failed) = (None, None);
        // It may have been undone meanwhile.
        if !self.prepare_chosen() {
            self.start_bake();
        }
    }

    /// What somebody chose cannot be made, and is left out of the look again; what a look from a file asks for stays in it.
    pub(super) fn chosen_cannot_be_made(&mut self, words: String) {
        let open = self.open_sky().cloned();
        let sky = std::mem::replace(&mut self.choices.sky, open);
        self.choices.failed = Some((self.look.scene.clone(), sky));
        if let Some(before) = self.choices.before.take() {
            self.as_one_step(|app| app.look.scene = before);
        }
        self.complain(words);
    }

    /// What a look that was opened makes of the scene: it is made where a scene is open, and told where a bake is. A sky that
    /// comes without its columns is told, too.
    pub(super) fn heed_choice(&mut self) -> Vec<String> {
        let is_bake = self.session.opened.as_ref().is_some_and(|opened| opened.is_bake() || opened.scene.is_none());
        if !is_bake {
            let gets_sky = self.prepare_chosen() && self.wanted_choice().sky.is_some();
            return self.missing_sky().filter(|_| !gets_sky).into_iter().collect();
        }
        let unbaked = self.session.basis().map_or_else(Vec::new, |basis| self.look.unbaked(basis));
        unbaked.into_iter().chain(self.missing_sky()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_are_found_again_by_their_scene_and_forgotten_once_there_are_none() {
        let mut kept = KeptChoices::default();
        let source = |name: &str| Source::File(format!("/scenes/{name}").into());
        let panels = vec![PanelRequest { node: "a".into(), resolution: 8 }];
        let setting = SkySetting { file: Some("day.hdr".into()), ..SkySetting::default() };
        let sky = Some(ChosenSky { setting, light: None, divisions: 2 });
        let chosen = Chosen { panels, units: LampUnits::Unitless, sky };
        for place in [source("a.glb"), Source::BuiltIn] {
            kept.keep(&place, &chosen);
            let text = serde_json::to_string(&kept).unwrap();
            let again: KeptChoices = serde_json::from_str(&text).unwrap();
            assert_eq!(again.of(&place), chosen);
        }
        assert_eq!(kept.of(&source("b.glb")), Chosen::default());
        kept.keep(&source("a.glb"), &Chosen::default());
        assert!(kept.0.len() == 1 && kept.of(&source("a.glb")) == Chosen::default());
        (0..2 * MOST_SCENES).for_each(|n| kept.keep(&source(&n.to_string()), &chosen));
        assert_eq!(kept.0.len(), MOST_SCENES);
    }
}
