//! Views that were baked in this session: each keeps its matrix in memory, and any is shown again at once.

use std::sync::Arc;

use clerestory_transport::bake::{Bake, BakeJob};
use clerestory_transport::basis::LightSource;
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::figures::{ErrorDb, Figures};
use clerestory_transport::prepared::PreparedScene;

use super::{BakeSettings, BakeState, Session, Shown};

/// Views beside the one that is shown.
#[derive(Default)]
pub(super) struct Views {
    /// Those that are whole.
    kept: Vec<Kept>,
    n_made: u64,
    /// Number of the view that is shown.
    shown: u64,
    /// Number of the view that is being baked while another one is shown.
    aside: Option<u64>,
    /// Where the bake that runs is seen from.
    pub baking: Option<Camera>,
}

struct Kept {
    id: u64,
    shown: Shown,
    error_db: Option<ErrorDb>,
    figures: Option<Figures>,
}

/// A view for the list of them.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewEntry {
    /// Its number.
    pub id: u64,
    /// Name of its camera.
    pub name: String,
    /// Size of its picture.
    pub film: Film,
    /// Memory of its factors; what is not counted yet has none.
    pub bytes: Option<usize>,
    /// Total error, once it is known.
    pub error_db: Option<f32>,
    /// Whether it is the one that is shown.
    pub is_shown: bool,
    /// Whether it is being baked.
    pub is_baking: bool,
    /// Whether all of it was baked.
    pub is_done: bool,
}

impl Session {
    /// All views in the order in which they were begun.
    pub fn views(&self) -> Vec<ViewEntry> {
        let is_running = self.bake.is_running();
        let coming = self.incoming.as_ref().filter(|_| !self.is_aside()).map(Shown::film);
        let entry = |id: u64, shown: &Shown, error_db: Option<ErrorDb>, figures: Option<&Figures>| ViewEntry {
            id,
            name: shown.header.camera.clone(),
            film: if shown.is_glimpse { coming.unwrap_or(shown.film()) } else { shown.film() },
            bytes: figures.map(|figures| figures.bytes),
            error_db: error_db.map(|error| error.total),
            is_shown: id == self.views.shown,
            is_baking: is_running && self.views.aside.unwrap_or(self.views.shown) == id,
            is_done: shown.packed.is_some(),
        };
        let kept = self.views.kept.iter();
        let mut views: Vec<ViewEntry> =
            kept.map(|kept| entry(kept.id, &kept.shown, kept.error_db, kept.figures.as_ref())).collect();
        views.extend(self.shown.as_ref().map(|s| entry(self.views.shown, s, self.error_db, self.figures.as_ref())));
        let aside = self.views.aside.zip(self.incoming.as_ref());
        views.extend(aside.map(|(id, incoming)| entry(id, incoming, None, None)));
        views.sort_by_key(|view| view.id);
        views
    }

    /// Shows another view of the list. A bake that runs goes on.
    pub fn show_view(&mut self, id: u64) {
        if id == self.views.shown {
            return;
        }
        if self.views.aside == Some(id) {
            self.views.aside = None;
            let incoming = self.incoming.take();
            self.put_away();
            self.views.shown = id;
            self.shown = incoming;
            (self.error_db, self.figures) = (None, None);
        } else {
            let Some(idx) = self.views.kept.iter().position(|kept| kept.id == id) else { return };
            let Kept { shown, error_db, figures, .. } = self.views.kept.remove(idx);
            self.put_away();
            self.views.shown = id;
            (self.shown, self.error_db, self.figures) = (Some(shown), error_db, figures);
            if !self.bake.is_running() {
                self.bake = self.state_of_shown();
            }
        }
        self.is_another();
    }

    /// The whole bakes of all views.
    pub(super) fn whole_bakes(&self) -> Vec<Bake> {
        let kept = self.views.kept.iter().map(|kept| &kept.shown);
        self.shown.iter().chain(kept).filter(|shown| shown.packed.is_some()).map(Shown::bake).collect()
    }

    /// Gives up a view that is not shown.
    pub fn forget_view(&mut self, id: u64) {
        self.views.kept.retain(|kept| kept.id != id);
    }

    /// The number of the view of a camera, if it was baked.
    pub fn view_of(&self, camera: &Camera) -> Option<u64> {
        let is_it = |shown: &&Shown| shown.camera.as_ref().is_some_and(|own| sees_alike(own, camera));
        let shown = self.shown.as_ref().filter(is_it).map(|_| self.views.shown);
        let kept = || self.views.kept.iter().find(|kept| is_it(&&kept.shown)).map(|kept| kept.id);
        shown.or_else(kept)
    }

    /// Whether all of a view was baked with these settings. Of work planes that is not known here.
    pub(super) fn has_view(&self, scene: &PreparedScene, settings: &BakeSettings, camera: &Camera) -> bool {
        let is_it = |shown: &Shown| {
            let header = &shown.header;
            shown.packed.is_some()
                && shown.camera.as_ref().is_some_and(|own| sees_alike(own, camera))
                && (shown.film(), &header.config) == (settings.film, &settings.config)
                && shown.pixel_irradiance().is_some() == settings.illuminance
                && LightSource::are_alike_in_any_order(&header.basis.sources, &scene.lighting.basis.sources)
        };
        settings.work_plane.is_none()
            && self.shown.iter().chain(self.views.kept.iter().map(|kept| &kept.shown)).any(is_it)
    }

    /// Takes what is shown from the window: into the list if it is whole, to the side if it is being baked.
    fn put_away(&mut self) {
        // Before its first fact a bake has no view yet.
        let is_target = matches!(self.bake, BakeState::Running { .. }) && self.views.aside.is_none();
        let Some(shown) = self.shown.take() else { return };
        let (id, error_db, figures) = (self.views.shown, self.error_db.take(), self.figures.take());
        if is_target && self.incoming.is_none() {
            (self.incoming, self.views.aside) = (Some(shown), Some(id));
            return;
        }
        if is_target {
            // The same view is being baked again: that one comes under a number of its own.
            self.views.n_made += 1;
            self.views.aside = Some(self.views.n_made);
        }
        if shown.is_whole() && !shown.is_glimpse {
            self.views.kept.push(Kept { id, shown, error_db, figures });
        }
    }

    /// Whether the view of a bake is shown already, as large or at a glimpse.
    pub(super) fn shows_view_of(&self, job: &BakeJob) -> bool {
        self.shown.as_ref().is_some_and(|shown| {
            (shown.film() == job.film || shown.is_glimpse)
                && shown.camera.as_ref().is_some_and(|own| sees_alike(own, &job.camera))
                && LightSource::are_alike_in_any_order(&shown.header.basis.sources, &job.scene.lighting.basis.sources)
        })
    }

    /// A bake begins. Another view than the one that is shown comes beside it; the same one stays until the new one is whole.
    pub(super) fn begin_view(&mut self, started: Shown) {
        let same = |shown: &Shown| is_same_view(shown, &started);
        if let Some(id) = self.views.kept.iter().find(|kept| same(&kept.shown)).map(|kept| kept.id) {
            // Nothing of it runs yet, and so what is shown is put into the list.
            self.set_aside_idle(|session| session.show_view(id));
        }
        if self.shown.as_ref().is_some_and(|shown| Arc::ptr_eq(&shown.header, &started.header)) {
            // A bake that goes on: its blocks are in the picture already.
            return;
        }
        if self.shown.as_ref().is_some_and(same) {
            self.incoming = Some(started);
            return;
        }
        self.show_beside(started);
    }

    /// Shows another view than the one that is shown, which comes into the list.
    pub(super) fn show_beside(&mut self, shown: Shown) {
        self.set_aside_idle(Session::put_away);
        self.views.n_made += 1;
        self.views.shown = self.views.n_made;
        (self.error_db, self.figures) = (None, None);
        self.show(shown);
    }

    /// Does something while no bake counts as running.
    fn set_aside_idle(&mut self, job: impl FnOnce(&mut Session)) {
        let bake = std::mem::replace(&mut self.bake, BakeState::Idle);
        job(self);
        self.bake = bake;
    }

    /// Whether a bake of what is shown is under way.
    pub fn is_refining(&self) -> bool {
        self.bake.is_running() && !self.is_aside()
    }

    /// The view that a bake belongs to while another one is shown.
    pub(super) fn is_aside(&self) -> bool {
        self.views.aside.is_some()
    }

    /// A bake ended beside what is shown: it comes into the list in place of an older one of the same view.
    pub(super) fn keep_aside(&mut self, shown: Shown, error_db: Option<ErrorDb>) {
        let Some(id) = self.views.aside.take() else { return };
        self.views.kept.retain(|kept| !is_same_view(&kept.shown, &shown));
        if shown.is_whole() {
            let figures = Some(shown.bake().figures());
            self.views.kept.push(Kept { id, shown, error_db, figures });
        }
    }

    /// What was being baked aside is given up.
    pub(super) fn drop_aside(&mut self) {
        self.views.aside = None;
    }

    /// Another scene, or other columns: the views are of what is gone.
    pub(super) fn forget_views(&mut self) {
        self.views.kept.clear();
        (self.views.aside, self.views.baking) = (None, None);
    }

    /// How the bake of the view that is shown ended.
    pub(super) fn state_of_shown(&self) -> BakeState {
        let is_done = self.shown.as_ref().is_some_and(|shown| shown.packed.is_some());
        if is_done { BakeState::Done } else { BakeState::Stopped }
    }
}

/// Whether two bakes are of the same picture and the same lights. A glimpse is of the picture that comes after it.
fn is_same_view(a: &Shown, b: &Shown) -> bool {
    let sees_it = match (&a.camera, &b.camera) {
        (Some(a), Some(b)) => sees_alike(a, b),
        (None, None) => a.header.camera == b.header.camera,
        _ => false,
    };
    let have_same_lights = LightSource::are_alike_in_any_order(&a.header.basis.sources, &b.header.basis.sources);
    sees_it && (a.film() == b.film() || a.is_glimpse) && have_same_lights
}

/// Whether two cameras see the same, whatever they are called.
pub fn sees_alike(a: &Camera, b: &Camera) -> bool {
    (a.world_from_camera, a.yfov_rad, a.shift) == (b.world_from_camera, b.yfov_rad, b.shift)
}

#[cfg(test)]
mod tests {
    use clerestory_relight::Frame;
    use clerestory_transport::bake::{BakeConfig, BakeHeader};
    use clerestory_transport::basis::{LightBasis, SourceKind};

    use super::*;
    use crate::support::room_job;

    #[test]
    fn a_bake_that_has_its_lights_in_another_order_is_of_the_same_view() {
        let config = BakeConfig { spp: 2, tolerance_db: 10.0, ..BakeConfig::default() };
        let header = room_job(Film { width: 20, height: 16 }, config).header().unwrap();
        let shown = |keys: [&str; 2]| {
            let sources = keys.map(|key| LightSource::plain(key, SourceKind::Point, 0..1));
            let header = BakeHeader { basis: LightBasis::new(sources.to_vec()), ..header.clone() };
            let frame = Frame { width: header.width, height: header.height, groups: Vec::new() };
            let (header, frame) = (Arc::new(header), Arc::new(frame));
            Shown { header, camera: None, frame, irradiance: Vec::new(), packed: None, is_glimpse: false }
        };
        let own = shown(["lamp", "moved"]);
        assert!(is_same_view(&own, &shown(["moved", "lamp"])));
        assert!(!is_same_view(&own, &shown(["lamp", "another"])));
    }
}
