//! The camera in hand: the present view, its preview, bookmarks in the look, and what is remembered of how it is moved.

use std::collections::BTreeSet;

use anyhow::Result;
use clerestory_transport::camera::{Camera, Film, Pose};
use clerestory_transport::lamps::half_turn;
use eframe::egui::{self, Context, TextureHandle, TextureOptions, Ui};
use eframe::{CreationContext, Storage};

use super::App;
use crate::look::{Look, numbered_name};
use crate::panels::camera::{CameraEdit, CameraView, camera_ui};
use crate::session::preview::{self, PreviewOrder, Previewer};
use crate::session::views::sees_alike;
use crate::session::{Session, Wake};
use crate::viewport::flight::{FlightView, Habits, flight_ui, pivot_m};
use crate::viewport::orbit::{Flight, nearest_m};

const HABITS_KEY: &str = "navigation";
/// Said where a view is left that nobody has baked.
const LEFT_UNBAKED: &str = "Undo brings back the view that was not baked";
/// Distance to what is looked at where nothing is, meters; no more than the scene measures.
const FAR_M: f32 = 3.0;

/// The camera, baked or not.
pub(super) struct CameraDesk {
    /// The present view; none before a scene is open.
    pub camera: Option<Camera>,
    /// Whether it is in hand.
    pub is_moving: bool,
    /// Which of its numbers were edited last; none where it was moved otherwise.
    pub edited: BTreeSet<&'static str>,
    pivot_m: f32,
    /// How it is moved.
    pub habits: Habits,
    previewer: Previewer,
    texture: Option<TextureHandle>,
    ordered: Option<(Camera, Film)>,
}

impl CameraDesk {
    /// With what is remembered.
    pub fn start(cc: &CreationContext<'_>, wake: Wake) -> Result<CameraDesk> {
        Ok(CameraDesk {
            camera: None,
            is_moving: false,
            edited: BTreeSet::new(),
            pivot_m: FAR_M,
            habits: cc.storage.and_then(|s| eframe::get_value(s, HABITS_KEY)).unwrap_or_default(),
            previewer: preview::start(wake)?,
            texture: None,
            ordered: None,
        })
    }

    pub fn save(&self, storage: &mut dyn Storage) {
        eframe::set_value(storage, HABITS_KEY, &self.habits);
    }

    /// Takes in the newest preview, and orders one where the view is new.
    fn follow(&mut self, ctx: &Context, session: &Session, film: Film) {
        let Some(camera) = &self.camera else { return };
        if let Some(preview) = self.previewer.take().filter(|_| self.ordered.is_some()) {
            match &mut self.texture {
                Some(texture) => texture.set(preview.image, TextureOptions::LINEAR),
                slot => *slot = Some(ctx.load_texture("preview", preview.image, TextureOptions::LINEAR)),
            }
        }
        let is_ordered = self.ordered.as_ref().is_some_and(|(of, size)| (of, *size) == (camera, film));
        if let Some(scene) = session.lamp_scene().filter(|_| !is_ordered) {
            self.previewer.order(PreviewOrder { scene: scene.clone(), camera: camera.clone(), film });
            self.ordered = Some((camera.clone(), film));
        }
    }

    /// Has the preview made again.
    pub fn forget_picture(&mut self) {
        (self.ordered, self.texture) = (None, None);
    }

    /// Puts the camera down where a view is baked.
    pub fn put_down(&mut self) {
        (self.is_moving, self.ordered, self.texture) = (false, None, None);
        self.edited.clear();
    }
}

impl App {
    /// The camera that the picture is seen from, or will be.
    pub fn camera(&self) -> Option<&Camera> {
        self.camera.camera.as_ref()
    }

    /// Whether the present view is the one that is shown.
    fn is_baked_view(&self) -> bool {
        let shown = self.session.shown.as_ref().and_then(|shown| shown.camera.as_ref());
        shown.zip(self.camera()).is_some_and(|(shown, camera)| sees_alike(shown, camera))
    }

    /// A view whose bake is shown is the present one.
    pub(super) fn adopt_view(&mut self) {
        let shown = self.session.shown.as_ref().and_then(|shown| shown.camera.clone());
        if let Some(camera) = shown.filter(|_| self.camera.camera.is_none() || !self.camera.is_moving) {
            self.see_from(camera);
        }
    }

    pub(super) fn move_camera(&mut self) {
        if self.camera.camera.is_none() || self.session.lamp_scene().is_none() {
            return self.complain("the camera can be moved once a scene is open");
        }
        self.camera.is_moving = true;
        self.look_ahead();
        // Keys and handles of lamps rest meanwhile.
        (self.lights.lamps.chosen, self.lights.lamps.aiming) = (None, false);
        self.view.probes.picked = None;
    }

    /// Finds how far away that is which lies in the middle of the view.
    fn look_ahead(&mut self) {
        let Some((scene, camera)) = self.session.lamp_scene().zip(self.camera()) else { return };
        self.camera.pivot_m = pivot_m(scene, camera, self.settings.film).unwrap_or(FAR_M.min(scene.extent()));
    }

    /// Back to the view that is shown, in one step of undo.
    pub(super) fn leave_camera(&mut self) {
        let is_lost = self.camera.is_moving && !self.is_baked_view();
        self.as_one_step(App::put_camera_down);
        if is_lost {
            self.say(LEFT_UNBAKED);
        }
    }

    pub(super) fn put_camera_down(&mut self) {
        self.camera.put_down();
        self.adopt_view();
    }

    /// The present view is that of a camera. The film has its shape after that of the one before, unless somebody typed a height, which
    /// stays; rounding makes none.
    fn see_from(&mut self, camera: Camera) {
        let (film, before) = (self.settings.film, self.camera.camera.as_ref());
        let is_typed = |height: u32| (film.height as f32 / height as f32 - 1.0).abs() > 0.01;
        let is_own = before.is_some_and(|before| is_typed(Film::of_width(film.width, before).height));
        let is_another = before.is_none_or(|before| before.aspect != camera.aspect);
        if self.fixed_settings.is_none() && is_another && !is_own {
            self.settings.film = Film::of_width(film.width, &camera);
        }
        self.camera.camera = Some(camera);
        self.camera.edited.clear();
    }

    /// Takes a camera in hand that looks from elsewhere than the one before.
    pub(super) fn take_in_hand(&mut self, camera: Camera) {
        self.see_from(camera);
        self.move_camera();
    }

    /// Looks from somewhere: at once where that is baked, else with the camera in hand.
    pub(super) fn look_from(&mut self, camera: Camera) {
        if let (Some(id), false) = (self.session.view_of(&camera), self.camera.is_moving) {
            self.session.show_view(id);
            return self.see_from(camera);
        }
        self.take_in_hand(camera);
    }

    pub(super) fn show_view(&mut self, id: u64) {
        let in_hand = self.camera().filter(|_| self.camera.is_moving);
        let is_lost = in_hand.is_some_and(|camera| self.session.view_of(camera).is_none());
        // The view of a camera in hand that has not rested yet is a step as well.
        self.keep_step();
        self.session.show_view(id);
        self.camera.put_down();
        self.adopt_view();
        if is_lost {
            self.say(LEFT_UNBAKED);
        }
    }

    /// Shows the view so many places after the one that is shown.
    pub(super) fn step_view(&mut self, by: isize) {
        let views = self.session.views();
        let Some(shown) = views.iter().position(|view| view.is_shown).filter(|_| views.len() > 1) else {
            return self.say("No other view is baked");
        };
        let to = (shown as isize + by).rem_euclid(views.len() as isize) as usize;
        self.show_view(views[to].id);
    }

    /// The camera takes the name of its bookmark.
    pub(super) fn name_view(&mut self, name: String) {
        if let Some(camera) = &mut self.camera.camera {
            camera.name = name;
        }
    }

    /// Undo led here from another look: the view of a bookmark that is called otherwise now is called so, too.
    pub(super) fn follow_bookmarks(&mut self, before: &Look) {
        let pairs = before.bookmarks.iter().zip(&self.look.bookmarks);
        let mut renamed = pairs.filter(|(old, new)| self.camera() == Some(*old) && sees_alike(old, new));
        if let Some(name) = renamed.next().map(|(_, new)| new.name.clone()) {
            self.name_view(name);
        }
    }

    pub(super) fn camera_panel_ui(&mut self, ui: &mut Ui) {
        let views = self.session.views();
        let view = CameraView {
            cameras: self.session.cameras(),
            views: &views,
            film: self.settings.film,
            is_moving: self.camera.is_moving,
            extent_m: self.session.extent_m(),
        };
        let desk = &mut self.camera;
        let before = desk.camera.clone();
        let bookmarks = &mut self.look.bookmarks;
        let edit = CameraEdit { camera: desk.camera.as_mut(), bookmarks, habits: &mut desk.habits };
        camera_ui(ui, &view, edit, &mut self.actions);
        if desk.camera != before {
            let numbers = before.as_ref().zip(desk.camera.as_ref()).map(|(before, camera)| edited(before, camera));
            desk.edited = numbers.unwrap_or_default();
            self.rename_view(before);
            self.move_camera();
        }
    }

    /// A camera that was moved is no longer the one of its name.
    fn rename_view(&mut self, before: Option<Camera>) {
        let known = |camera: &Camera| self.session.cameras().contains(camera) || self.session.view_of(camera).is_some();
        let is_kept = |camera: &Camera| self.look.bookmarks.contains(camera);
        if !before.as_ref().is_some_and(|camera| known(camera) || is_kept(camera)) {
            return;
        }
        let is_taken = |name: &str| {
            self.session.cameras().iter().chain(&self.look.bookmarks).any(|camera| camera.name == name)
                || self.session.views().iter().any(|view| view.name == name)
        };
        self.name_view(numbered_name("View", is_taken));
    }

    /// The picture while the camera is in hand.
    pub(super) fn flight_ui(&mut self, ui: &mut Ui) {
        let is_baked = self.is_baked_view();
        let of_shown = self.session.shown.as_ref().filter(|_| is_baked).map(|shown| shown.film());
        let film = of_shown.unwrap_or(self.settings.film);
        self.camera.follow(ui.ctx(), &self.session, film);
        let baked = self.follower.picture().filter(|_| is_baked).map(|(texture, _)| texture);
        let (Some(camera), Some(scene)) = (self.camera.camera.clone(), self.session.lamp_scene()) else { return };
        let preview = self.camera.texture.as_ref().map(TextureHandle::id);
        let view = FlightView {
            scene,
            picture: baked.or(preview),
            is_baked,
            film,
            habits: self.camera.habits,
            is_baking: self.session.bake.is_running(),
        };
        let before = camera.clone();
        let mut flight = Flight { camera, pivot_m: self.camera.pivot_m, nearest_m: nearest_m(scene.extent()), film };
        egui::CentralPanel::no_frame().show(ui, |ui| {
            flight_ui(ui, &view, &self.view.zoom, &mut flight, &mut self.actions);
        });
        self.camera.pivot_m = flight.pivot_m;
        if flight.camera != before {
            self.camera.camera = Some(flight.camera);
            self.camera.edited.clear();
            self.rename_view(Some(before));
            ui.ctx().request_repaint();
        }
    }
}

/// Which numbers of a view are not those of another one. Who edits a place leaves the turn as it is, up to rounding; of the angles the one
/// that turns most is meant.
fn edited(before: &Camera, camera: &Camera) -> BTreeSet<&'static str> {
    let [old, new] = [before, camera].map(Pose::of);
    let way = new.position - old.position;
    let places = [("X", way.x), ("Y", way.y), ("Z", way.z)].into_iter().filter(|(_, meters)| *meters != 0.0);
    let mut edited: BTreeSet<&'static str> = places.map(|(axis, _)| axis).collect();
    if edited.is_empty() && before.world_from_camera != camera.world_from_camera {
        // By rounding the same direction may be told half a turn to the right, then half a turn to the left.
        let turns = [
            ("yaw", half_turn(new.yaw_rad - old.yaw_rad)),
            ("pitch", new.pitch_rad - old.pitch_rad),
            ("roll", half_turn(new.roll_rad - old.roll_rad)),
        ];
        let most = turns.into_iter().max_by(|(_, a), (_, b)| a.abs().total_cmp(&b.abs()));
        edited.extend(most.map(|(angle, _)| angle));
    }
    let others = [
        ("field of view", before.yfov_rad != camera.yfov_rad),
        ("shift X", before.shift[0] != camera.shift[0]),
        ("shift Y", before.shift[1] != camera.shift[1]),
    ];
    edited.extend(others.into_iter().filter(|(_, is_other)| *is_other).map(|(number, _)| number));
    edited
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn of_a_camera_that_looks_back_the_angle_that_was_edited_is_told() {
        let back = Camera::look_at("back", Vec3::ZERO, Vec3::Z, 0.9, 1.5);
        let pose = Pose::of(&back);
        let pitched = back.posed(&Pose { pitch_rad: 0.1, ..pose });
        assert_eq!(edited(&back, &pitched), BTreeSet::from(["pitch"]), "{:?}", Pose::of(&pitched));
        let turned = back.posed(&Pose { yaw_rad: pose.yaw_rad - 0.2, ..pose });
        assert_eq!(edited(&back, &turned), BTreeSet::from(["yaw"]));
        let upside_down = back.posed(&Pose { roll_rad: std::f32::consts::PI, ..pose });
        let pitched = upside_down.posed(&Pose { pitch_rad: -0.1, ..Pose::of(&upside_down) });
        assert_eq!(edited(&upside_down, &pitched), BTreeSet::from(["pitch"]));
    }
}
