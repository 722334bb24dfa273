//! Panels and units of lamps that were chosen: part of the look, made by the session, and remembered for each scene.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clerestory_transport::emitters::PanelRequest;
use clerestory_transport::lamp_units::LampUnits;
use serde::{Deserialize, Serialize};

use super::App;
use crate::look::scene::SceneChoice;
use crate::session::{Chosen, Source};

/// Scenes whose choices are remembered.
const MOST_SCENES: usize = 100;

/// What is chosen, and what came of it.
pub(super) struct Choices {
    /// Of all scenes.
    pub kept: KeptChoices,
    /// What the look said before somebody chose something that is being made.
    before: Option<SceneChoice>,
    /// What the open scene could not be made: it is not tried again.
    failed: Option<SceneChoice>,
}

impl Choices {
    pub fn new(kept: KeptChoices) -> Choices {
        Choices { kept, before: None, failed: None }
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
}

impl KeptChoices {
    /// What is chosen about something that is opened.
    pub fn of(&self, source: &Source) -> Chosen {
        let kept = place(source).and_then(|place| self.0.iter().find(|kept| kept.scene == place));
        kept.map_or_else(Chosen::default, |kept| Chosen {
            panels: requests(&kept.panels),
            units: if kept.unitless { LampUnits::Unitless } else { LampUnits::Photometric },
            sky: None,
        })
    }

    fn keep(&mut self, source: &Source, chosen: &Chosen) {
        let Some(scene) = place(source) else { return };
        self.0.retain(|kept| kept.scene != scene);
        let SceneChoice { panels, units } = choice_of(chosen);
        let unitless = units == Some(LampUnits::Unitless);
        if unitless || !panels.is_empty() {
            self.0.insert(0, Kept { scene, panels, unitless });
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
    }
}

impl App {
    pub(super) fn choose_panel(&mut self, node: String, resolution: u32) {
        self.choose(|choice| {
            choice.panels.insert(node, resolution);
        });
    }

    pub(super) fn choose_units(&mut self, units: LampUnits) {
        self.choose(|choice| choice.units = Some(units));
    }

    fn choose(&mut self, edit: impl FnOnce(&mut SceneChoice)) {
        let before = self.look.scene.clone();
        self.choices.failed = None;
        self.as_one_step(|app| edit(&mut app.look.scene));
        self.choices.before = Some(before).filter(|_| self.prepare_chosen());
    }

    /// What was chosen about the scene that is open.
    fn open_choice(&self) -> SceneChoice {
        self.session.opened.as_ref().map_or_else(SceneChoice::default, |opened| choice_of(&opened.chosen))
    }

    /// Has the open scene prepared and baked anew where the look makes another one of it. Answers whether it does.
    pub(super) fn prepare_chosen(&mut self) -> bool {
        let is_known = |node: &str| self.session.basis().is_some_and(|basis| basis.source(node).is_some());
        let panels = self.look.scene.panels.iter().filter(|(node, _)| is_known(node));
        let panels: BTreeMap<String, u32> = panels.map(|(node, resolution)| (node.clone(), *resolution)).collect();
        let units = self.look.scene.units.unwrap_or_default();
        let open = self.open_choice();
        let is_other = (&panels, units) != (&open.panels, open.units.unwrap_or_default());
        let has_failed = self.choices.failed.as_ref() == Some(&self.look.scene);
        let prepares = is_other && !has_failed && self.session.has_scene();
        if prepares {
            self.session.choose_scene(requests(&panels), units);
        }
        prepares
    }

    /// The scene is open, or was found, with what is chosen about it: the look says so, too, and is as saved as it was.
    pub(super) fn adopt_choice(&mut self) {
        let open = self.open_choice();
        self.choices.failed = None;
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
        self.choices.failed = Some(self.look.scene.clone());
        if let Some(before) = self.choices.before.take() {
            self.as_one_step(|app| app.look.scene = before);
        }
        self.complain(words);
    }

    /// What a look that was opened makes of the scene: it is made where a scene is open, and told where a bake is.
    pub(super) fn heed_choice(&mut self) -> Vec<String> {
        let is_bake = self.session.opened.as_ref().is_some_and(|opened| opened.is_bake() || opened.scene.is_none());
        if !is_bake {
            self.prepare_chosen();
            return Vec::new();
        }
        self.session.basis().map_or_else(Vec::new, |basis| self.look.unbaked(basis))
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
        let chosen = Chosen { panels, units: LampUnits::Unitless, sky: None };
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
