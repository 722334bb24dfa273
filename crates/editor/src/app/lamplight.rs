//! The light of free lamps in the window: orders it when lamps or view change, and says which lighting to show with it.

use std::sync::Arc;

use anyhow::Result;
use clerestory_transport::lamps::FreeLamp;
use clerestory_transport::light::LightRig;

use crate::session::lamps::{LampLight, LampOrder, LampView, LampWorker};
use crate::session::{Session, Wake};

/// Keeps the light of the lamps in step.
pub(super) struct Lamplight {
    worker: LampWorker,
    view: Option<Arc<LampView>>,
    /// What was ordered last.
    ordered: Option<Ordered>,
    /// The lighting of the newest light that came.
    answered: LightRig,
    light: Option<LampLight>,
    n_orders: u64,
}

/// An order, and the lighting at that time.
struct Ordered {
    rig: LightRig,
    shining: Vec<FreeLamp>,
}

impl Lamplight {
    pub fn new(wake: Wake) -> Result<Lamplight> {
        let (view, ordered, answered, light) = (None, None, LightRig::default(), None);
        Ok(Lamplight { worker: LampWorker::start(wake)?, view, ordered, answered, light, n_orders: 0 })
    }

    /// The light that came last for this view, if lamps shine.
    pub fn light(&self) -> Option<&LampLight> {
        self.light.as_ref()
    }

    /// Whether the light of the lamps is as smooth as it gets.
    pub fn is_idle(&self) -> bool {
        self.ordered.is_none()
            || self.light.as_ref().is_some_and(|light| light.serial == self.n_orders && light.is_done)
    }

    /// Takes in what came and orders what is new. Answers the lighting to show: while the light of lamps that were added,
    /// moved, or taken away is on its way, the picture keeps the lighting that goes with the light it has. So a lamp of
    /// the file that becomes movable does not go out in between.
    pub fn follow(&mut self, session: &Session, rig: &LightRig) -> LightRig {
        let view = self.current_view(session);
        if view.as_ref().map(Arc::as_ptr) != self.view.as_ref().map(Arc::as_ptr) {
            (self.view, self.ordered, self.light) = (view, None, None);
        }
        if let Some(light) = self.worker.take()
            && let Some(ordered) = &self.ordered
        {
            if light.serial == self.n_orders {
                self.answered = ordered.rig.clone();
            }
            self.light = Some(light);
        }
        let Some(view) = &self.view else { return rig.clone() };
        let shining: Vec<FreeLamp> = rig.lamps.iter().filter(|lamp| !lamp.setting.muted).cloned().collect();
        if self.ordered.is_none() && shining.is_empty() {
            self.answered = rig.clone();
            return rig.clone();
        }
        if self.ordered.as_ref().is_none_or(|ordered| ordered.shining != shining) {
            self.n_orders += 1;
            self.worker.order(LampOrder { view: view.clone(), lamps: shining.clone(), serial: self.n_orders });
            self.ordered = Some(Ordered { rig: rig.clone(), shining });
        }
        let is_pending = self.light.as_ref().is_none_or(|light| light.serial != self.n_orders);
        // Whoever changes other lights meanwhile wants to see that.
        let is_same = self.ordered.as_ref().is_some_and(|ordered| is_same_but_for_lamps(&ordered.rig, rig));
        if is_pending && is_same { self.answered.clone() } else { rig.clone() }
    }

    /// The view of the picture, the same as long as nothing of it changes; none without a scene.
    fn current_view(&self, session: &Session) -> Option<Arc<LampView>> {
        let (scene, shown) = (session.lamp_scene()?, session.shown.as_ref()?);
        let (camera, film, patches) = (shown.camera.as_ref()?, shown.film(), shown.patches());
        let is_it = |view: &&Arc<LampView>| {
            Arc::ptr_eq(&view.scene, scene)
                && (&view.camera, view.film, view.patches.as_ref()) == (camera, film, patches)
        };
        let kept = self.view.as_ref().filter(is_it).cloned();
        Some(kept.unwrap_or_else(|| {
            Arc::new(LampView { scene: scene.clone(), camera: camera.clone(), film, patches: patches.cloned() })
        }))
    }
}

/// Whether two lightings are the same in what is baked.
fn is_same_but_for_lamps(a: &LightRig, b: &LightRig) -> bool {
    (&a.lights, &a.panels, &a.sky) == (&b.lights, &b.panels, &b.sky)
}
