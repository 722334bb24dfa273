//! The light of free lamps in the window: orders it when lamps or view change, and says which lighting to show with it.

use std::collections::{HashSet, VecDeque};
use std::sync::Arc;

use anyhow::Result;
use clerestory_relight::Gpu;
use clerestory_transport::bake::BakeHeader;
use clerestory_transport::lamps::FreeLamp;
use clerestory_transport::light::LightRig;

use crate::look::Quantity;
use crate::session::lamps::{self, LampLight, LampOrder, LampView, LampWorker};
use crate::session::{Session, Wake};

/// Keeps the light of the lamps in step.
pub(super) struct Lamplight {
    worker: LampWorker,
    view: Option<Arc<LampView>>,
    /// The bake that the view was made for: its patches are many, and not compared at every frame.
    header: Option<Arc<BakeHeader>>,
    /// What was ordered last.
    ordered: Option<Ordered>,
    /// The lightings of orders whose light is still to come, by their numbers, the oldest first.
    to_come: VecDeque<(u64, LightRig)>,
    /// The lighting that is shown.
    answered: LightRig,
    light: Option<LampLight>,
    n_orders: u64,
    /// The first order whose light counts.
    oldest: u64,
}

/// An order, and the lighting at that time.
struct Ordered {
    rig: LightRig,
    shining: Vec<FreeLamp>,
}

impl Lamplight {
    pub fn new(wake: Wake) -> Result<Lamplight> {
        let worker = lamps::start(wake)?;
        let (view, header, ordered, light) = (None, None, None, None);
        let (to_come, answered) = (VecDeque::new(), LightRig::default());
        Ok(Lamplight { worker, view, header, ordered, to_come, answered, light, n_orders: 0, oldest: 0 })
    }

    /// The light that came last for this view, if lamps shine.
    pub fn light(&self) -> Option<&LampLight> {
        self.light.as_ref()
    }

    /// Nothing that is known of the lamps in this view counts any more.
    pub fn forget_view(&mut self) {
        (self.view, self.header) = (None, None);
    }

    /// Whether the light of the lamps is as smooth as it gets.
    pub fn is_idle(&self) -> bool {
        self.ordered.is_none()
            || self.light.as_ref().is_some_and(|light| light.serial == self.n_orders && light.is_done)
    }

    /// Whether it is known what the free lamps of a lighting bring, and what arrives of them where that is measured. Without a
    /// view nothing of them comes.
    pub fn is_known(&self, rig: &LightRig) -> bool {
        let (Some(view), shining) = (&self.view, rig.shining_lamps()) else { return true };
        let is_ordered = self.ordered.as_ref().is_some_and(|ordered| ordered.shining == shining);
        let answer = self.light.as_ref().filter(|light| light.serial == self.n_orders);
        let is_there = |light: &LampLight| {
            light.is_done || (light.left_out.is_empty() && (light.arriving.is_some() || !view.measures))
        };
        shining.is_empty() || (is_ordered && answer.is_some_and(is_there))
    }

    /// Takes in what came and orders what is new. Answers the lighting to show: while the light of lamps that were added,
    /// moved, or taken away is on its way, the picture keeps the lighting that goes with the light it has. So a lamp of
    /// the file that becomes movable does not go out in between.
    ///
    /// `device` lights what is seen, if there is one to do it.
    pub fn follow(
        &mut self,
        session: &Session,
        rig: &LightRig,
        shown: Option<Quantity>,
        device: Option<&Gpu>,
    ) -> LightRig {
        let view = self.current_view(session, device);
        if view.as_ref().map(Arc::as_ptr) != self.view.as_ref().map(Arc::as_ptr) {
            self.look_elsewhere(view);
        }
        self.follow_in_view(rig, shown)
    }

    /// The same in the view that there is.
    fn follow_in_view(&mut self, rig: &LightRig, shown: Option<Quantity>) -> LightRig {
        self.take();
        let Some(view) = &self.view else { return rig.clone() };
        let shining = rig.shining_lamps();
        if self.is_new(&shining) {
            self.n_orders += 1;
            let shows_arriving = shown == Some(Quantity::Illuminance);
            let (view, lamps, serial) = (view.clone(), shining.clone(), self.n_orders);
            let replaced = self.worker.order(LampOrder { view, lamps, shows_arriving, serial });
            // No light comes of one that was not begun.
            self.to_come.retain(|(serial, _)| replaced.as_ref().is_none_or(|order| order.serial != *serial));
            self.to_come.push_back((serial, rig.clone()));
            self.ordered = Some(Ordered { rig: rig.clone(), shining });
        }
        let is_pending = self.light.as_ref().is_none_or(|light| light.serial != self.n_orders);
        // Whoever changes other lights meanwhile wants to see that.
        let waits = |ordered: &Ordered| is_pending && is_same_but_for_lamps(&ordered.rig, rig);
        if !self.ordered.as_ref().is_some_and(waits) {
            self.answered = rig.clone();
            // Nor does it go back to how they were when light was ordered that is still to come.
            for (_, to_come) in &mut self.to_come {
                *to_come = LightRig { lamps: std::mem::take(&mut to_come.lamps), ..rig.clone() };
            }
        }
        self.answered.clone()
    }

    /// Whether lamps are to be ordered: others than those that were, or none where the light of some is still there.
    fn is_new(&self, shining: &[FreeLamp]) -> bool {
        match &self.ordered {
            Some(ordered) => ordered.shining != shining,
            None => !shining.is_empty() || self.light.is_some(),
        }
    }

    /// Another view: what is known of the old one no longer counts, unless only patches came or went. Then the direct light stays; what
    /// came to patches that are others now would light the wrong surfaces.
    fn look_elsewhere(&mut self, view: Option<Arc<LampView>>) {
        match view.as_ref().zip(self.view.as_ref()).filter(|(new, old)| is_seen_alike(new, old)) {
            Some((new, old)) if new.patches == old.patches => {}
            Some(_) => {
                self.oldest = self.n_orders + 1;
                self.light.iter_mut().for_each(LampLight::forget_patches);
            }
            None => (self.light, self.oldest) = (None, self.n_orders + 1),
        }
        self.to_come.clear();
        if let (Some(view), Some(_)) = (&view, self.ordered.take()) {
            // An order without lamps frees what the worker knows of the old view. Its answer, which holds no light, would put out what is
            // shown until the lamps are lit anew.
            self.n_orders += 1;
            self.oldest = self.n_orders + 1;
            let (view, lamps, serial) = (view.clone(), Vec::new(), self.n_orders);
            self.worker.order(LampOrder { view, lamps, shows_arriving: false, serial });
        }
        self.view = view;
    }

    /// Takes in the newest light, if it is of an order that still counts, and puts nothing out that is shown.
    fn take(&mut self) {
        let Some(light) = self.worker.take().filter(|light| light.serial >= self.oldest) else { return };
        // Of orders before that one no light comes any more.
        let n_past = self.to_come.partition_point(|(serial, _)| *serial < light.serial);
        self.to_come.drain(..n_past);
        if puts_out(&light, self.light.as_ref(), &self.answered) {
            return;
        }
        let Some(ordered) = &self.ordered else { return };
        // Where lamps and other lights change together from frame to frame, newer orders are on their way: what is shown is as it was when
        // this light was ordered, not as it was before all of them.
        if self.to_come.front().is_some_and(|(serial, _)| *serial == light.serial)
            && let Some((_, rig)) = self.to_come.pop_front()
        {
            self.answered = rig;
        }
        self.light = Some(light);
        if ordered.shining.is_empty() && self.light.as_ref().is_some_and(|light| light.serial == self.n_orders) {
            (self.light, self.ordered) = (None, None);
        }
    }

    /// The view of the picture, the same as long as nothing of it changes; none without a scene.
    fn current_view(&mut self, session: &Session, device: Option<&Gpu>) -> Option<Arc<LampView>> {
        let (scene, shown) = (session.lamp_scene()?, session.shown.as_ref()?);
        let (camera, film) = (shown.camera.as_ref()?, shown.film());
        let is_of_header = self.header.as_ref().is_some_and(|header| Arc::ptr_eq(header, &shown.header));
        self.header = Some(shown.header.clone());
        let is_it = |view: &&Arc<LampView>| {
            Arc::ptr_eq(&view.scene, scene)
                && (&view.camera, view.film, view.measures) == (camera, film, shown.pixel_irradiance().is_some())
                && view.bounces == shown.header.config.bounces
                && (is_of_header || view.patches.as_ref() == shown.patches())
                && is_lit_by(view, device)
        };
        let kept = self.view.as_ref().filter(is_it).cloned();
        Some(kept.unwrap_or_else(|| {
            let (camera, patches) = (camera.clone(), shown.patches().cloned());
            let (measures, bounces) = (shown.pixel_irradiance().is_some(), shown.header.config.bounces);
            Arc::new(LampView {
                scene: scene.clone(),
                camera,
                film,
                patches,
                measures,
                bounces,
                device: device.cloned(),
            })
        }))
    }
}

/// Whether a view is lit by a device, or by none, as it should be; one that was lost makes way for one that was not.
fn is_lit_by(view: &LampView, device: Option<&Gpu>) -> bool {
    let is_lost = |gpu: Option<&Gpu>| gpu.is_some_and(Gpu::is_lost);
    view.device.is_some() == device.is_some() && (!is_lost(view.device.as_ref()) || is_lost(device))
}

/// Whether a light leaves out lamps that are lit in the picture: as they were, or as the lights of the file whose place they take. Such
/// a light is not shown; the whole one follows.
fn puts_out(light: &LampLight, shown: Option<&LampLight>, rig: &LightRig) -> bool {
    if light.left_out.is_empty() {
        return false;
    }
    let parts = shown.iter().flat_map(|shown| &shown.parts);
    let lit: HashSet<&str> = parts.map(|part| part.key.as_str()).collect();
    let is_on = |key: &String| rig.lights.get(key).is_none_or(|setting| !setting.muted);
    let stands_in = |lamp: &FreeLamp| lamp.replaces.as_ref().is_some_and(is_on);
    light.left_out.iter().any(|lamp| lit.contains(lamp.key.as_str()) || stands_in(lamp))
}

/// Whether two views are the same but for their patches.
fn is_seen_alike(a: &LampView, b: &LampView) -> bool {
    Arc::ptr_eq(&a.scene, &b.scene) && (&a.camera, a.film, a.bounces) == (&b.camera, b.film, b.bounces)
}

/// Whether two lightings are the same in what is baked.
fn is_same_but_for_lamps(a: &LightRig, b: &LightRig) -> bool {
    (&a.lights, &a.panels, &a.sky, &a.groups) == (&b.lights, &b.panels, &b.sky, &b.groups)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::time::Duration;

    use clerestory_transport::camera::Film;
    use clerestory_transport::light::LightSetting;
    use clerestory_transport::patches::Patches;
    use serde_json::json;

    use super::*;
    use crate::session::lamps::{StillLamps, tests};

    /// A small view of the room.
    fn view() -> LampView {
        LampView { film: Film { width: 8, height: 6 }, measures: false, ..(*tests::view()).clone() }
    }

    fn lamp(key: &str, replaces: Option<&str>) -> FreeLamp {
        FreeLamp { replaces: replaces.map(str::to_owned), ..tests::lamp(key, 0.0) }
    }

    /// One without a view yet, and how often its worker has answered.
    fn counted() -> (Lamplight, Arc<AtomicU32>) {
        let n_answers = Arc::new(AtomicU32::new(0));
        let own = n_answers.clone();
        let wake = move |_| {
            own.fetch_add(1, Ordering::Relaxed);
        };
        (Lamplight::new(Arc::new(wake)).unwrap(), n_answers)
    }

    fn wait_for_answer(n_answers: &AtomicU32) {
        for _ in 0..20_000 {
            if n_answers.load(Ordering::Relaxed) > 0 {
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        panic!("it never answered");
    }

    #[test]
    fn the_light_of_a_lamp_that_went_goes_though_the_view_changed_meanwhile() {
        let mut lamplight = Lamplight::new(Arc::new(|_| ())).unwrap();
        let view = view();
        lamplight.view = Some(Arc::new(view.clone()));
        lamplight.light = StillLamps::new(Arc::new(view.clone())).light(&[lamp("a", None)], &|| false);
        // It was deleted, and before the worker answers another device or other patches make another view of it.
        lamplight.ordered = Some(Ordered { rig: LightRig::default(), shining: Vec::new() });
        lamplight.look_elsewhere(Some(Arc::new(view)));
        assert!(lamplight.light.is_some(), "what is seen stays until the answer comes");
        assert!(lamplight.is_new(&[]), "which is asked for");
        lamplight.light = None;
        assert!(!lamplight.is_new(&[]), "and once is enough");
    }

    #[test]
    fn what_frees_an_old_view_puts_no_lamp_out() {
        let (mut lamplight, n_answers) = counted();
        let view = view();
        let ordered = || Some(Ordered { rig: LightRig::default(), shining: vec![lamp("a", None)] });
        lamplight.view = Some(Arc::new(view.clone()));
        lamplight.light = StillLamps::new(Arc::new(view.clone())).light(&[lamp("a", None)], &|| false);
        lamplight.ordered = ordered();
        lamplight.look_elsewhere(Some(Arc::new(view)));
        // The worker has answered that order before the lamps are ordered anew.
        wait_for_answer(&n_answers);
        lamplight.ordered = ordered();
        lamplight.take();
        assert_eq!(lamplight.light.as_ref().map(|light| light.parts.len()), Some(1));
    }

    #[test]
    fn lights_that_change_with_a_lamp_from_frame_to_frame_are_shown_with_it() {
        let (mut lamplight, n_answers) = counted();
        lamplight.view = Some(Arc::new(view()));
        // As a timeline runs: in every frame the lamp is elsewhere, and the sky another one.
        let at = |x: f32| {
            let mut rig = LightRig { lamps: vec![tests::lamp("a", x)], ..LightRig::default() };
            rig.set("sky", LightSetting { intensity: 1.0 - x, ..LightSetting::default() });
            rig
        };
        assert_eq!(lamplight.follow_in_view(&at(0.1), None), LightRig::default(), "it is on its way");
        wait_for_answer(&n_answers);
        assert_eq!(lamplight.follow_in_view(&at(0.2), None), at(0.1), "the next one is on its way");
        assert!(lamplight.to_come.len() == 1 && lamplight.light.is_some());
    }

    #[test]
    fn lights_that_were_changed_since_do_not_go_back_when_the_light_of_a_lamp_comes() {
        let (mut lamplight, n_answers) = counted();
        lamplight.view = Some(Arc::new(view()));
        let at = |x: f32, sky: f32| {
            let mut rig = LightRig { lamps: vec![tests::lamp("a", x)], ..LightRig::default() };
            rig.set("sky", LightSetting { intensity: sky, ..LightSetting::default() });
            rig
        };
        lamplight.follow_in_view(&at(0.1, 0.75), None);
        assert_eq!(lamplight.follow_in_view(&at(0.1, 0.5), None), at(0.1, 0.5), "whoever changes it wants to see it");
        wait_for_answer(&n_answers);
        assert_eq!(lamplight.follow_in_view(&at(0.2, 0.5), None), at(0.1, 0.5));
        assert!(lamplight.light.is_some());
    }

    #[test]
    fn of_orders_that_nobody_began_nothing_is_kept() {
        let (mut lamplight, _) = counted();
        lamplight.view = Some(Arc::new(view()));
        for nth in 0_u8..100 {
            let lamps = vec![tests::lamp("a", 0.001 * f32::from(nth))];
            lamplight.follow_in_view(&LightRig { lamps, ..LightRig::default() }, None);
            assert!(lamplight.to_come.len() <= 3, "{} after {nth} orders", lamplight.to_come.len());
        }
    }

    #[test]
    fn light_on_patches_does_not_light_others() {
        let patches = |n_columns: u32| -> Patches {
            let header = json!({ "n_patches": 1, "n_samples": 0, "n_columns": n_columns, "held_out_error": 0.0 });
            serde_json::from_value(header).unwrap()
        };
        let mut lamplight = Lamplight::new(Arc::new(|_| ())).unwrap();
        let first = Arc::new(LampView { patches: Some(patches(1)), ..view() });
        let shown = StillLamps::new(Arc::new(view())).light(&[lamp("a", None)], &|| false).unwrap();
        lamplight.light = Some(LampLight { of_patches: Arc::new(vec![[1.0; 3]]), ..shown });
        lamplight.view = Some(first.clone());
        let n_lit = |lamplight: &Lamplight| lamplight.light.as_ref().map(|light| light.of_patches.len());
        lamplight.look_elsewhere(Some(Arc::new((*first).clone())));
        assert_eq!(n_lit(&lamplight), Some(1), "they are the same");
        let other = LampView { patches: Some(patches(2)), ..(*first).clone() };
        lamplight.look_elsewhere(Some(Arc::new(other)));
        assert_eq!(n_lit(&lamplight), Some(0), "what is seen straight stays");
    }

    #[test]
    fn light_that_lacks_lamps_is_shown_where_it_puts_none_of_them_out() {
        let shown = StillLamps::new(Arc::new(view())).light(&[lamp("a", None)], &|| false).unwrap();
        let without = |left_out: Vec<FreeLamp>| LampLight { left_out, ..shown.clone() };
        let (on, mut off) = (LightRig::default(), LightRig::default());
        off.lights.insert("lamp".into(), LightSetting { muted: true, ..LightSetting::default() });
        assert!(!puts_out(&without(vec![]), Some(&shown), &on), "a whole one is always shown");
        assert!(puts_out(&without(vec![lamp("a", None)]), Some(&shown), &on), "it is lit");
        assert!(!puts_out(&without(vec![lamp("a", None)]), None, &on), "nothing is lit yet");
        assert!(!puts_out(&without(vec![lamp("b", None)]), Some(&shown), &on), "it is new");
        let movable = || vec![lamp("b", Some("lamp"))];
        assert!(puts_out(&without(movable()), Some(&shown), &on), "the light of the file shines in its place");
        assert!(!puts_out(&without(movable()), Some(&shown), &off), "which is off");
    }
}
