//! The floor of the scene, whose area powers are divided by: measured beside the window once somebody asks for it.

use std::sync::Arc;

use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::sensors::floor_area_m2;

use super::App;
use crate::panels::measure::KnownFloor;
use crate::session::Wake;
use crate::session::aside::Aside;

/// A scene and the area of its floor in m², where it has one.
type Measured = (Arc<PreparedScene>, Option<f64>);

/// Area of the floor of one scene.
#[derive(Default)]
pub(super) struct SceneFloor {
    known: Option<Measured>,
    measuring: Aside<Measured>,
}

fn measured(scene: Arc<PreparedScene>) -> Measured {
    let area_m2 = floor_area_m2(&scene.scene).map(f64::from);
    (scene, area_m2)
}

impl SceneFloor {
    /// Whether it is being measured.
    pub fn is_busy(&self) -> bool {
        self.measuring.is_busy()
    }

    fn of(&self, scene: &Arc<PreparedScene>) -> Option<&Measured> {
        self.known.as_ref().filter(|(of, _)| Arc::ptr_eq(of, scene))
    }

    /// Starts to measure, unless that was done.
    ///
    /// # Errors
    /// If the system gives no thread, in words.
    fn ask(&mut self, scene: &Arc<PreparedScene>, wake: &Wake) -> Result<(), String> {
        if self.of(scene).is_some() {
            return Ok(());
        }
        let scene = scene.clone();
        self.measuring.start("floor", wake, move || measured(scene))
    }
}

impl App {
    /// Takes the area in once it is there.
    pub(super) fn follow_floor(&mut self) {
        let scene = self.session.lamp_scene().cloned();
        match self.solving.floor.measuring.take() {
            Some(Ok(known)) => self.solving.floor.known = Some(known),
            Some(Err(words)) => {
                // It would fail again.
                self.solving.floor.known = scene.clone().map(|scene| (scene, None));
                self.complain(format!("The floor could not be measured: {words}"));
            }
            None => {}
        }
        // That of a scene which is gone keeps it in memory.
        let is_here = |(of, _): &Measured| scene.as_ref().is_some_and(|scene| Arc::ptr_eq(of, scene));
        self.solving.floor.known = self.solving.floor.known.take().filter(is_here);
    }

    /// Somebody looks where the area is told.
    pub(super) fn ask_for_floor(&mut self) {
        let Some(scene) = self.session.lamp_scene() else { return };
        if let Err(words) = self.solving.floor.ask(scene, &self.solving.wake) {
            self.complain(words);
        }
    }

    /// Area of the floor of the scene in m², as far as somebody has asked for it.
    pub fn floor_area_m2(&self) -> Option<f64> {
        self.solving.floor.of(self.session.lamp_scene()?)?.1
    }

    /// The floor that powers are divided by where nobody types its area, as far as it is known.
    pub(super) fn known_floor(&self) -> Option<KnownFloor> {
        let marked = self.picked().and_then(|picked| picked.floor_m2).map(KnownFloor::Marked);
        marked.or_else(|| self.floor_area_m2().map(KnownFloor::OfScene))
    }

    /// The same for somebody who cannot wait.
    pub(super) fn floor_now(&mut self) -> Option<KnownFloor> {
        let asked = self.session.lamp_scene().filter(|scene| self.solving.floor.of(scene).is_none()).cloned();
        if let (None, Some(scene)) = (self.known_floor(), asked) {
            self.solving.floor.known = Some(measured(scene));
        }
        self.known_floor()
    }
}
