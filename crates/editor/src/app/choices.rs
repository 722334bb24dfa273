//! Panels, units of lamps, a sky and a work plane that were chosen: part of the look, made by the session, and remembered for each scene.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Weak};

use clerestory_transport::emitters::PanelRequest;
use clerestory_transport::lamp_units::LampUnits;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::sensors::WorkPlane;
use clerestory_transport::sky::SkySetting;
use serde::{Deserialize, Serialize};

use super::App;
use crate::look::scene::{PlaneChoice, SceneChoice};
use crate::panels::messages::Holds;
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
    plane: Option<FoundPlane>,
    /// The work plane of the look when it was last remembered, or taken from what is remembered, and of which scene.
    remembered: Option<(Option<PathBuf>, Option<PlaneChoice>)>,
}

/// The work plane of a look in a scene.
struct FoundPlane {
    choice: PlaneChoice,
    scene: Weak<PreparedScene>,
    /// None where the scene has not its floor.
    plane: Option<WorkPlane>,
}

impl Choices {
    pub fn new(kept: KeptChoices) -> Choices {
        Choices { kept, sky: None, before: None, failed: None, plane: None, remembered: None }
    }
}

/// What was chosen about scenes, the newest first. It outlasts the program.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(super) struct KeptChoices(Vec<Kept>);

#[derive(Clone, Default, PartialEq, Serialize, Deserialize)]
struct Kept {
    /// From the root; the scene that is part of the program lies nowhere.
    scene: Option<PathBuf>,
    panels: BTreeMap<String, u32>,
    unitless: bool,
    /// What is over it, and the divisions of its patches.
    #[serde(default)]
    sky: Option<(SkySetting, u32)>,
    #[serde(default)]
    work_plane: Option<PlaneChoice>,
}

impl Kept {
    /// Whether anything but the scene is told.
    fn says_something(&self) -> bool {
        self.unitless || !self.panels.is_empty() || self.sky.is_some() || self.work_plane.is_some()
    }
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
        let work_plane = self.plane_of(source);
        let SceneChoice { panels, units, .. } = choice_of(chosen);
        let unitless = units == Some(LampUnits::Unitless);
        // One of a bake that was opened is not known well enough to be made again.
        let sky = chosen.sky.as_ref().filter(|sky| sky.setting.names_a_sky());
        let sky = sky.map(|sky| (SkySetting { map: None, ..sky.setting.clone() }, sky.divisions));
        self.put(Kept { scene, panels, unitless, sky, work_plane });
    }

    /// The work plane that a scene was baked with last.
    fn plane_of(&self, source: &Source) -> Option<PlaneChoice> {
        let place = place(source)?;
        self.0.iter().find(|kept| kept.scene == place)?.work_plane.clone()
    }

    fn keep_plane(&mut self, source: &Source, work_plane: Option<PlaneChoice>) {
        let Some(scene) = place(source).filter(|_| self.plane_of(source) != work_plane) else { return };
        let before = self.0.iter().find(|kept| kept.scene == scene).cloned().unwrap_or_default();
        self.put(Kept { scene, work_plane, ..before });
    }

    /// Those of a window that began with `before`: what was chosen in it since about a scene, and about all others what is `there`, where
    /// another window may have left some.
    pub fn merged(&self, before: &KeptChoices, there: &KeptChoices) -> KeptChoices {
        let is_own = |kept: &&Kept| self.about(&kept.scene) != before.about(&kept.scene);
        let own = self.0.iter().filter(is_own);
        let others = there.0.iter().filter(|kept| !is_own(kept));
        KeptChoices(own.chain(others).take(MOST_SCENES).cloned().collect())
    }

    fn about(&self, scene: &Option<PathBuf>) -> Option<&Kept> {
        self.0.iter().find(|kept| kept.scene == *scene)
    }

    fn put(&mut self, new: Kept) {
        self.0.retain(|kept| kept.scene != new.scene);
        if new.says_something() {
            self.0.insert(0, new);
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
        work_plane: None,
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
            work_plane: None,
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
            .is_some_and(|(scene, sky)| *scene == self.look.scene.made() && *sky == self.choices.sky);
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

    /// Says that the scene has not the floor of the look's work plane.
    pub(super) fn missing_floor(&self) -> Option<String> {
        self.look.missing_floor(&self.session.lamp_scene()?.scene)
    }

    /// The scene is open, or was found, with what is chosen about it: the look says so, too, and is as saved as it was.
    pub(super) fn adopt_choice(&mut self) {
        let work_plane = self.session.source().and_then(|source| self.choices.kept.plane_of(source));
        let open = SceneChoice { work_plane, ..self.open_choice() };
        (self.choices.sky, self.choices.failed) = (self.open_sky().cloned(), None);
        // What was being made of the scene before it is made no more.
        self.choices.before = None;
        for look in [&mut self.look, &mut self.saved_look] {
            look.scene = std::mem::take(&mut look.scene).or(&open);
        }
        self.remember_work_plane();
    }

    fn remember_work_plane(&mut self) {
        self.choices.remembered = self.open_place().map(|scene| (scene, self.look.scene.work_plane.clone()));
    }

    /// Where the open scene lies.
    fn open_place(&self) -> Option<Option<PathBuf>> {
        place(self.session.source()?)
    }

    /// The scene was prepared again for what was chosen.
    pub(super) fn chosen_is_made(&mut self) {
        if let Some(opened) = &self.session.opened
            && let Some(source) = &opened.source
        {
            self.choices.kept.keep(source, &opened.chosen);
        }
        (self.choices.before, self.choices.failed) = (None, None);
        if self.solving.give_up() {
            self.say("The scene has changed since; solve again");
        }
        // It may have been undone meanwhile.
        if !self.prepare_chosen() {
            self.start_bake();
        }
    }

    /// What somebody chose cannot be made, and is left out of the look again; what a look from a file asks for stays in it.
    pub(super) fn chosen_cannot_be_made(&mut self, words: String) {
        let open = self.open_sky().cloned();
        let sky = std::mem::replace(&mut self.choices.sky, open);
        self.choices.failed = Some((self.look.scene.made(), sky));
        if let Some(before) = self.choices.before.take() {
            self.as_one_step(|app| {
                let work_plane = app.look.scene.work_plane.take();
                app.look.scene = SceneChoice { work_plane, ..before };
            });
        }
        self.complain_of_scene(Holds::InScene, words);
    }

    /// What a look that was opened makes of the scene: it is made where a scene is open, and told where a bake is. A sky that
    /// comes without its columns is told, too.
    pub(super) fn heed_choice(&mut self) -> Vec<String> {
        // It took the place of what somebody chose.
        self.choices.before = None;
        let is_bake = self.session.opened.as_ref().is_some_and(|opened| opened.is_bake() || opened.scene.is_none());
        let floor = self.missing_floor();
        if !is_bake {
            let gets_sky = self.prepare_chosen() && self.wanted_choice().sky.is_some();
            return self.missing_sky().filter(|_| !gets_sky).into_iter().chain(floor).collect();
        }
        let unbaked = self.session.basis().map_or_else(Vec::new, |basis| self.look.unbaked(basis));
        unbaked.into_iter().chain(self.missing_sky()).chain(floor).collect()
    }

    /// What is baked next has the work plane of the look, where the scene has its floor.
    pub(super) fn follow_work_plane(&mut self) {
        let known = self.choices.plane.take();
        let asked = self.session.lamp_scene().zip(self.look.scene.work_plane.as_ref());
        self.choices.plane = asked.map(|(scene, choice)| {
            let last = known.as_ref().and_then(|known| known.plane?.floor);
            let is_it = |known: &FoundPlane| known.choice == *choice && known.scene.as_ptr() == Arc::as_ptr(scene);
            known.filter(is_it).unwrap_or_else(|| FoundPlane {
                choice: choice.clone(),
                scene: Arc::downgrade(scene),
                plane: choice.on(&scene.scene, last),
            })
        });
        self.settings.work_plane = self.choices.plane.as_ref().and_then(|found| found.plane);
        self.forget_work_plane();
    }

    /// The work plane of a bake that starts is remembered for its scene.
    pub(super) fn keep_work_plane(&mut self) {
        if let Some(source) = self.session.source() {
            self.choices.kept.keep_plane(source, self.look.scene.work_plane.clone());
        }
        self.remember_work_plane();
    }

    /// One that is taken away is not remembered either, so that it does not come back with the scene.
    fn forget_work_plane(&mut self) {
        let is_gone = |(scene, plane): &(Option<PathBuf>, Option<PlaneChoice>)| {
            plane.is_some() && self.look.scene.work_plane.is_none() && self.open_place().as_ref() == Some(scene)
        };
        if self.choices.remembered.as_ref().is_some_and(is_gone) {
            self.keep_work_plane();
        }
    }

    /// The name under which a look finds a node of the open scene again: its own, unless another node has it, too.
    pub(super) fn node_name(&self, node: u32) -> Option<String> {
        let nodes = &self.session.lamp_scene()?.scene.nodes;
        let own = nodes.get(node as usize)?;
        let is_shared = nodes.iter().filter(|other| own.name.is_some() && other.name == own.name).count() > 1;
        Some(if is_shared { own.index_key() } else { own.key() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::Solution;
    use crate::support::room_window;

    #[test]
    fn what_cannot_be_made_stays_in_another_look_than_it_was_chosen_in() {
        let mut window = room_window(None);
        let app = window.state_mut();
        let asked = SceneChoice { units: Some(LampUnits::Unitless), ..SceneChoice::default() };
        // Another scene is opened, or another look.
        let others: [fn(&mut App); 2] = [App::adopt_choice, |app| drop(app.heed_choice())];
        for take_over in others {
            app.choices.before = Some(SceneChoice::default());
            take_over(app);
            app.look.scene = asked.clone();
            app.chosen_cannot_be_made("it has no such lamps".into());
            assert_eq!(app.look.scene, asked);
        }
    }

    #[test]
    fn lights_that_were_found_for_a_scene_are_not_taken_over_in_another() {
        let mut window = room_window(None);
        let app = window.state_mut();
        let (rig, misfit) = (app.look.lights.clone(), 0.0);
        let found = Solution { rig, changes: Vec::new(), outcomes: Vec::new(), misfit, notes: Vec::new() };
        app.solving.state.solution = Some(found);
        // Its lamps shine 683 times as bright now.
        app.chosen_is_made();
        assert!(app.solution().is_none());
    }

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
        let plane = Some(PlaneChoice { height_m: 0.8, spacing_m: None, floor: Some("Floor".into()) });
        kept.keep_plane(&source("a.glb"), plane.clone());
        kept.keep(&source("a.glb"), &Chosen::default());
        assert_eq!((kept.plane_of(&source("a.glb")), kept.of(&source("a.glb"))), (plane, Chosen::default()));
        kept.keep_plane(&source("a.glb"), None);
        kept.keep_plane(&source("b.glb"), None);
        assert!(kept.0.len() == 1 && kept.of(&source("a.glb")) == Chosen::default());
        (0..2 * MOST_SCENES).for_each(|n| kept.keep(&source(&n.to_string()), &chosen));
        assert_eq!(kept.0.len(), MOST_SCENES);
    }

    #[test]
    fn of_two_windows_each_keeps_what_was_chosen_in_it() {
        let source = |name: &str| Source::File(format!("/scenes/{name}").into());
        let chosen =
            |resolution| Chosen { panels: vec![PanelRequest { node: "a".into(), resolution }], ..Chosen::default() };
        let mut before = KeptChoices::default();
        ["a.glb", "b.glb", "c.glb"].iter().for_each(|name| before.keep(&source(name), &chosen(2)));
        let (mut own, mut there) = (before.clone(), before.clone());
        own.keep(&source("a.glb"), &chosen(4));
        own.keep(&source("b.glb"), &Chosen::default());
        there.keep(&source("c.glb"), &chosen(8));
        there.keep(&source("d.glb"), &chosen(16));
        let merged = own.merged(&before, &there);
        let wanted = [("a.glb", chosen(4)), ("b.glb", Chosen::default()), ("c.glb", chosen(8)), ("d.glb", chosen(16))];
        wanted.into_iter().for_each(|(name, chosen)| assert_eq!(merged.of(&source(name)), chosen, "{name}"));
        assert_eq!(merged.0.len(), 3);
    }
}
