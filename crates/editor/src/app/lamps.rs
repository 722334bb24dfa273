//! What is asked for about free lamps: they are added, copied, taken away, and take the place of lamps of the file.

use std::path::PathBuf;
use std::sync::Arc;

use clerestory_transport::basis::{LightSource, SourceKind};
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::import::read_profile;
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit};
use clerestory_transport::light::LightSetting;
use clerestory_transport::prepared::PreparedScene;
use glam::{Vec2, Vec3};

use super::App;
use crate::action::FileTask;
use crate::look::lamps::{MAX_LAMPS, fits};
use crate::look::{groups, numbered_name};
use crate::panels::lamps::{LampChoice, Pick, Pulled, kind_words};
use crate::panels::lights::{ADDED, heard};
use crate::panels::status::LampNote;
use crate::session::SceneOfBake;
use crate::session::lamps::LampLight;
use crate::viewport::gizmo::{Surface, aimed_within, surface_behind_glass};
use crate::viewport::placing::{beside, fitting_strength, placed, sized};
use crate::words::lacking_words;

impl App {
    /// What can be done with lamps in what is open.
    pub(super) fn lamp_choice(&self) -> LampChoice {
        if self.session.lamp_scene().is_some() {
            return LampChoice::Ready;
        }
        match self.session.opened.as_ref().and_then(|opened| opened.of_bake.as_ref()) {
            Some(SceneOfBake::Missing(why)) => {
                let name = self.session.shown.as_ref().map_or(String::new(), |shown| shown.header.scene.clone());
                LampChoice::NeedsScene { name, why: why.clone() }
            }
            Some(SceneOfBake::Waiting) => LampChoice::Waiting,
            Some(SceneOfBake::Found(_)) | None => LampChoice::Never,
        }
    }

    /// A file is the scene of the bake that is open, as long as that lacks one.
    pub(super) fn use_scene(&mut self, path: PathBuf) {
        match self.lamp_choice() {
            LampChoice::NeedsScene { .. } | LampChoice::Waiting => self.session.find_scene(path),
            LampChoice::Ready | LampChoice::Never => {
                self.complain(format!("{} was not opened: nothing that is open lacks its scene", path.display()));
            }
        }
    }

    /// Brings solo in step with the lights, whatever changed them.
    pub(super) fn follow_solo(&mut self) {
        if let Some(basis) = self.session.basis() {
            self.lights.follow_solo(basis, &self.look.lights);
        }
    }

    /// What there is to say about the light of free lamps that are seen, and what else to know of those that shine.
    pub(super) fn lamp_notes(&self) -> (LampNote, Vec<String>) {
        let Some(shown) = self.session.shown.as_ref().filter(|_| self.session.lamp_scene().is_some()) else {
            return (LampNote::None, Vec::new());
        };
        // A moment of the timeline has lamps of its own.
        let heard = heard(&shown.header.basis, &self.seen().lights, &self.lights.solo);
        if heard.shining_lamps().is_empty() {
            return (LampNote::None, Vec::new());
        }
        let light = self.follower.lamp_light();
        let note = match light {
            None => LampNote::Pending,
            Some(LampLight { problems, .. }) if !problems.is_empty() => {
                LampNote::Problem(problems.iter().map(|words| self.look.renamed(words)).collect())
            }
            Some(light) if !light.left_out.is_empty() => LampNote::Pending,
            Some(_) if shown.patches().is_none() => LampNote::DirectOnly,
            Some(light) => self.lacking(light),
        };
        let remarks = light.iter().flat_map(|light| &light.remarks).map(|words| self.look.renamed(words));
        (note, remarks.collect())
    }

    /// What of the light of free lamps is missing, if anything is.
    fn lacking(&self, light: &LampLight) -> LampNote {
        let words = light.lacking.iter().flat_map(|(key, lacking)| lacking_words(key, lacking)).flatten();
        let words: Vec<String> = words.map(|words| self.look.renamed(&words)).collect();
        let caustics = light.lacking.iter().any(|(_, lacking)| lacking.caustic > 0.0);
        if words.is_empty() { LampNote::None } else { LampNote::Lacking { caustics, words } }
    }

    /// Scene, camera and film of the picture.
    fn lamp_view(&self) -> Option<(Arc<PreparedScene>, Camera, Film)> {
        let shown = self.session.shown.as_ref()?;
        Some((self.session.lamp_scene()?.clone(), shown.camera.clone()?, shown.film()))
    }

    /// Whether the look has room for so many more lamps; complains where it has not.
    fn has_room(&mut self, n_more: usize) -> bool {
        let has_room = self.look.has_room_for_lamps(n_more);
        if !has_room {
            self.complain(format!("a look holds {MAX_LAMPS} lamps at most; delete some first"));
        }
        has_room
    }

    pub(super) fn add_lamp(&mut self, shape: LampShape, at_px: Option<[f32; 2]>) {
        self.place_lamp(shape, None, at_px);
    }

    pub(super) fn ask_profile(&mut self, at_px: Option<[f32; 2]>) {
        (self.profile_at_px, self.profile_for) = (at_px, None);
        self.ask(FileTask::OpenProfile);
    }

    pub(super) fn ask_profile_for(&mut self, key: String) {
        self.profile_for = Some(key);
        self.ask(FileTask::OpenProfile);
    }

    pub(super) fn add_profile(&mut self, path: PathBuf) {
        let (at_px, of) = (self.profile_at_px.take(), self.profile_for.take());
        let path = std::path::absolute(&path).unwrap_or(path);
        match read_profile(&path) {
            Ok(profile) => {
                let shape = LampShape::Profile { file: path.display().to_string() };
                let own = (profile.max_candela(), LampUnit::Candela);
                match of {
                    Some(key) => self.give_profile(&key, shape, own),
                    None => self.place_lamp(shape, Some(own), at_px),
                }
            }
            Err(why) => self.complain(format!("{}: {why}", path.display())),
        }
    }

    /// A lamp shines by a measured distribution from now on, as strong as that says.
    fn give_profile(&mut self, key: &str, shape: LampShape, (strength, unit): (f32, LampUnit)) {
        let before = self.look.lights.lamps.iter().find(|lamp| lamp.key == key);
        let Some(lamp) = before.map(|before| FreeLamp { shape, strength, unit, ..before.clone() }) else {
            return self.complain(format!("`{key}` is there no longer, so that nothing got the profile"));
        };
        if !fits(&lamp) {
            return self.complain("it would be stronger than a look holds");
        }
        self.as_one_step(|app| {
            let lamps = app.look.lights.lamps.iter_mut();
            lamps.filter(|before| before.key == lamp.key).for_each(|before| before.clone_from(&lamp));
        });
    }

    /// Profiles of lamps were written by another program: the lamps shine by what they are now, as strong as they are set.
    pub(super) fn read_profiles_again(&mut self) {
        self.follower.read_lamps_again();
        self.lights.forget_profiles();
        self.prints.forget();
    }

    /// Puts a lamp where the picture was clicked on; without a strength with one that suits the picture.
    fn place_lamp(&mut self, shape: LampShape, strength: Option<(f32, LampUnit)>, at_px: Option<[f32; 2]>) {
        let Some((scene, camera, film)) = self.lamp_view() else {
            self.complain("a lamp can be added once there is a picture of a scene");
            return;
        };
        if !self.has_room(1) {
            return;
        }
        let (width, height) = (film.width as f32, film.height as f32);
        let px = at_px.map_or(Vec2::new(0.5 * width, 0.5 * height), Vec2::from);
        let (eye, direction) = (camera.position(), camera.direction(film, px));
        let in_the_air = || Surface { position: eye + direction * (0.3 * scene.diameter()), normal: -direction };
        let surface = surface_behind_glass(&scene, eye, direction).unwrap_or_else(in_the_air);
        let distance_m = surface.position.distance(eye);
        let shape = sized(shape, distance_m);
        let key = self.free_name(kind_words(&shape));
        let (setting, origin) = (LightSetting::default(), Vec3::ZERO);
        let (unit, own) = (shape.units()[0], 1.0);
        let lamp = FreeLamp {
            key,
            shape,
            position: origin,
            aim: origin,
            strength: own,
            unit,
            setting,
            turn_rad: 0.0,
            replaces: None,
        };
        let lamp = placed(lamp, surface, eye, &scene);
        let fitting = || fitting_strength(&lamp, self.follower.shown_ev(), &scene, distance_m);
        let (strength, unit) = strength.unwrap_or_else(fitting);
        let lamp = FreeLamp { strength, unit, ..lamp };
        if !fits(&lamp) {
            return self.complain("it would be stronger, or farther than 1000 km from the origin, than a look holds");
        }
        self.as_one_step(|app| {
            // A master that stands over all added lamps stands over this one.
            groups::enter(&mut app.look.lights, ADDED, &lamp.key);
            app.say(format!("Added {}{}", lamp.key, app.solo_words(1)));
            app.join_solo(&lamp.key);
            app.push_lamp(lamp);
        });
    }

    /// A lamp that is added during a solo joins it: whoever adds one wants to see its light.
    fn join_solo(&mut self, key: &str) {
        if !self.lights.solo.is_empty() {
            self.lights.solo.insert(key.to_owned());
        }
    }

    /// What is said of so many lamps that do.
    fn solo_words(&self, n_added: usize) -> &'static str {
        match n_added {
            _ if self.lights.solo.is_empty() => "",
            1 => "; it joins the solo",
            _ => "; they join the solo",
        }
    }

    fn push_lamp(&mut self, lamp: FreeLamp) {
        // Whoever adds a lamp wants to move it next: what marks is put down.
        self.view.marking.tool = None;
        self.looks.player.let_go();
        self.lights.lamps.chosen = Some(lamp.key.clone());
        self.look.lights.lamps.push(lamp);
    }

    /// A name that no light has, nor a key that stands for another name or is held: lamps of looks that were kept may have such, and what
    /// is new may be solved.
    fn free_name(&self, stem: &str) -> String {
        let is_taken = |name: &str| {
            self.look.lights.lamps.iter().any(|lamp| lamp.key == name)
                || self.look.names.iter().any(|(key, called)| key == name || called == name)
                || self.look.wishes.held.contains(name)
                || self.session.basis().is_some_and(|basis| basis.source(name).is_some())
        };
        numbered_name(stem, is_taken)
    }

    /// Whether a light is chosen: selected in the list, or the one of the picture that is not among those.
    fn is_in_hand(&self, key: &str) -> bool {
        let chosen = self.lights.lamps.chosen.as_deref().filter(|chosen| !self.lights.is_selected(chosen));
        chosen.map_or_else(|| self.lights.is_selected(key), |chosen| chosen == key)
    }

    /// Keys of the free lamps that are chosen.
    fn lamps_in_hand(&self) -> Vec<String> {
        let keys = self.look.lights.lamps.iter().map(|lamp| &lamp.key);
        keys.filter(|key| self.is_in_hand(key)).cloned().collect()
    }

    /// The lights of the file that are chosen.
    fn of_file_in_hand(&self) -> impl Iterator<Item = &LightSource> {
        let sources = self.session.basis().into_iter().flat_map(|basis| &basis.sources);
        sources.filter(move |source| self.is_in_hand(&source.key))
    }

    pub(super) fn duplicate_lamps(&mut self) {
        let is_lamp = |kind: SourceKind| matches!(kind, SourceKind::Point | SourceKind::Spot | SourceKind::Directional);
        let of_file = self.of_file_in_hand().filter(|source| is_lamp(source.kind));
        let of_file: Vec<String> = of_file.map(|source| source.key.clone()).collect();
        let free = self.lamps_in_hand();
        if free.is_empty() && of_file.is_empty() {
            let chosen = self.of_file_in_hand().next().map(|source| self.look.name_of(&source.key).to_owned());
            if let Some(name) = chosen {
                self.say(format!("{name} is no lamp; only lamps can be duplicated"));
            }
            return;
        }
        self.add_copies(&free, &of_file);
    }

    /// Adds copies of free lamps and of lamps of the file, and selects them.
    pub(super) fn add_copies(&mut self, free: &[String], of_file: &[String]) {
        let n_copies = free.len() + of_file.len();
        if n_copies == 0 || !self.has_room(n_copies) {
            return;
        }
        self.as_one_step(|app| {
            let mut copies: Vec<String> = free.iter().filter_map(|key| app.copy_lamp(key)).collect();
            copies.extend(of_file.iter().filter_map(|key| app.copy_lamp_of_file(key)));
            // Why there is none was said.
            if let [copy] = &copies[..] {
                app.say(format!("Added {copy}{}", app.solo_words(1)));
            } else if !copies.is_empty() {
                app.say(format!("Added {} lamps{}", copies.len(), app.solo_words(copies.len())));
                app.lights.select(copies);
            }
        });
    }

    /// Adds a copy of a free lamp; answers its key.
    fn copy_lamp(&mut self, of: &str) -> Option<String> {
        let lamp = self.look.lights.lamps.iter().find(|lamp| lamp.key == of)?.clone();
        Some(self.push_copy(of, lamp))
    }

    /// The same of a lamp of the file.
    fn copy_lamp_of_file(&mut self, of: &str) -> Option<String> {
        let lamp = self.free_twin(of, "copied")?;
        Some(self.push_copy(of, lamp))
    }

    /// Adds a lamp beside the one that it is a copy of.
    fn push_copy(&mut self, of: &str, lamp: FreeLamp) -> String {
        let stem = self.look.name_of(of).trim_end_matches(|c: char| c.is_ascii_digit()).trim_end();
        let key = self.free_name(stem);
        let mut copy = FreeLamp { key: key.clone(), replaces: None, ..lamp };
        // In the picture it is seen beside the first one.
        if let Some((scene, camera, _)) = self.lamp_view() {
            copy = beside(&copy, &self.look.lights.lamps, &camera, &scene);
        }
        groups::join(&mut self.look.lights, of, &key);
        self.join_solo(&key);
        self.push_lamp(copy);
        key
    }

    /// A lamp that is chosen lets go the key of the timeline that was, and the other way round: keys of the keyboard are for one of them.
    pub(super) fn choose_one(&mut self, lamp_before: Option<String>, key_before: Option<usize>) {
        let (lamp, key) = (&self.lights.lamps.chosen, self.looks.player.chosen());
        if key.is_some() && key != key_before {
            self.lights.lamps.chosen = None;
        } else if lamp.is_some() && *lamp != lamp_before {
            self.looks.player.let_go();
        }
    }

    /// Deletes what was chosen last.
    pub(super) fn delete_chosen(&mut self) {
        if self.looks.player.chosen().is_none() {
            return self.delete_lamps();
        }
        // What is not seen is not deleted by a key.
        if self.is_bare {
            return self.say("The timeline is hidden with the panels; show them to delete its key");
        }
        self.as_one_step(|app| {
            app.looks.player.delete_key(&mut app.look.timeline);
        });
    }

    pub(super) fn delete_lamps(&mut self) {
        let doomed = self.lamps_in_hand();
        if doomed.is_empty() {
            let of_file = self.of_file_in_hand().next().map(|source| self.look.name_of(&source.key).to_owned());
            if let Some(name) = of_file {
                self.say(format!("{name} is a light of the file, which cannot be deleted; mute it instead"));
            }
            return;
        }
        self.lights.lamps.chosen = None;
        let of_file = |lamp: &FreeLamp| lamp.replaces.clone().filter(|key| self.look.lights.is_replaced(key));
        let lamps = self.look.lights.lamps.iter().filter(|lamp| doomed.contains(&lamp.key));
        let off: Vec<String> = lamps.filter_map(of_file).map(|key| self.look.name_of(&key).to_owned()).collect();
        self.as_one_step(|app| {
            let names: Vec<String> = doomed.iter().map(|key| app.look.remove_lamp(key)).collect();
            doomed.iter().for_each(|key| _ = app.lights.solo.remove(key));
            let what = if let [name] = &names[..] { name.clone() } else { format!("{} lamps", names.len()) };
            match off.len() {
                0 => app.say(format!("Deleted {what}")),
                1 => app.say(format!("Deleted {what}; {}, in whose place it shone, stays off", off[0])),
                _ => app.say(format!("Deleted {what}; {}, in whose place they shone, stay off", off.join(", "))),
            }
        });
    }

    pub(super) fn aim_lamp(&mut self) {
        let was_aiming = std::mem::take(&mut self.lights.lamps.aiming);
        // With the camera in hand the same key walks.
        if was_aiming || self.camera.is_moving {
            return;
        }
        let aimed = self.look.lights.lamps.iter().filter(|lamp| lamp.shape.is_aimed() && self.is_in_hand(&lamp.key));
        // The chosen one, else the first of those that are selected, which stay so.
        let first = aimed.min_by_key(|lamp| !self.lights.lamps.is_chosen(&lamp.key));
        let Some(key) = first.map(|lamp| lamp.key.clone()) else { return };
        if !self.lights.lamps.is_chosen(&key) {
            self.looks.player.let_go();
            self.lights.lamps.picked = Some((key.clone(), Pick::Another));
            self.lights.lamps.chosen = Some(key);
        }
        self.lights.lamps.aiming = true;
    }

    /// Mutes a lamp of the file and puts a free one of the same light in its place, in one step of undo.
    pub(super) fn make_movable(&mut self, key: &str) {
        if let Some(lamp) = self.free_twin(key, "made movable") {
            self.as_one_step(|app| app.exchange(key, lamp));
        }
    }

    /// The same while the pointer is down, which makes one step of all that it does; the lamp is in its hand then.
    pub(super) fn pull_lamp(&mut self, key: &str, at: [f32; 2]) {
        let twin = self.free_twin(key, "made movable");
        self.lights.lamps.pulled_at = twin.is_some().then(|| at.into());
        if let Some(lamp) = twin {
            let (lights, chosen) = (self.look.lights.clone(), self.lights.lamps.chosen.clone());
            self.lights.lamps.pulled = Some(Pulled { lights, chosen });
            self.exchange(key, lamp);
        }
    }

    /// The lamp of the file shines again in the place of the one that was pulled out of it.
    pub(super) fn put_back(&mut self, pulled: Pulled) {
        self.look.lights = pulled.lights;
        self.lights.lamps.chosen = pulled.chosen;
        self.messages.take_back();
        self.say("Put back");
    }

    /// A free lamp of the same light as one of the file; complains where there can be none, and what of it was to be `done`.
    fn free_twin(&mut self, key: &str, done: &str) -> Option<FreeLamp> {
        let name = self.look.name_of(key).to_owned();
        let Some((scene, ..)) = self.lamp_view() else {
            self.complain(format!("{name} can be {done} once the scene is open"));
            return None;
        };
        if !self.has_room(1) {
            return None;
        }
        // A bake that was opened shows the lights that it was made with; its scene needs its surfaces alone.
        let opened = self.session.shown.as_ref().filter(|_| !self.session.has_scene());
        if opened.is_some_and(|shown| !shown.header.has_light_of(&scene, key)) {
            self.complain(format!("{name} cannot be {done}: in its file it shines otherwise than in this bake"));
            return None;
        }
        let found = scene.lighting.basis.source(key).zip(scene.scene.lamp_called(key));
        let own = self.look.lights.lights.get(key).copied().unwrap_or_default();
        // Where another lamp shines in its place, it is off for that alone.
        let setting = LightSetting { muted: own.muted && !self.look.lights.is_replaced(key), ..own };
        let free = self.free_name(&format!("{name} movable"));
        let lamp = found.and_then(|(source, light)| FreeLamp::from_source(&free, source, light, setting));
        let lamp = lamp.map(|lamp| aimed_within(lamp, &scene));
        if lamp.is_none() {
            self.complain(format!("{name} cannot be {done}: its distribution lies in the file of the scene"));
        }
        let fitting = lamp.clone().filter(fits);
        if lamp.is_some() && fitting.is_none() {
            self.complain(format!(
                "{name} cannot be {done}: it is stronger, or farther than 1000 km from the origin, than a look holds"
            ));
        }
        fitting
    }

    fn exchange(&mut self, key: &str, lamp: FreeLamp) {
        groups::join(&mut self.look.lights, key, &lamp.key);
        self.look.lights.lights.entry(key.to_owned()).or_default().muted = true;
        let words = format!("{} stands in for {}, which is off now", lamp.key, self.look.name_of(key));
        self.push_lamp(lamp);
        self.say(words);
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use crate::action::Action;
    use crate::support::room_window;

    #[test]
    fn a_scene_that_came_while_that_of_a_bake_was_asked_for_keeps_its_own() {
        let mut window = room_window(None);
        for _ in 0..40_000 {
            window.step();
            if window.state().session.shown.is_some() {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        let ctx = window.ctx.clone();
        let app = window.state_mut();
        app.apply(&ctx, Action::UseScene("hall.glb".into()));
        assert!(app.session.opened.as_ref().is_some_and(|opened| !opened.is_bake()));
    }
}
