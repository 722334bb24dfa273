//! What the next bake will take, found out in the background while nothing is baked.

use std::sync::Arc;
use std::time::{Duration, Instant};

use clerestory_transport::bake::estimate::BakeEstimate;
use clerestory_transport::bake::focus::Focus;
use clerestory_transport::bake::{Bake, BakeJob};
use clerestory_transport::camera::Camera;

use super::begun::Asked;
use super::task::{Fact, Post, Task, beside_the_window, most_reused};
use super::{BakeSettings, Session};
use crate::bake_cache::{BakeCache, Found};
use crate::crash;

/// How long settings must stay before blocks are tried, and how long they are tried.
const SETTLED: Duration = Duration::from_millis(600);
const BUDGET: Duration = Duration::from_secs(6);

/// What is known of a bake before it is made.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Forecast {
    /// Nobody asks: it was baked with these settings, or there is nothing to bake.
    #[default]
    None,
    /// Blocks are being tried, or soon will be.
    Trying,
    /// About what it will take, beside what is taken over.
    Told(BakeEstimate),
    /// It was baked before, and is there at once.
    There,
    /// It cannot be baked like this, in words.
    Failed(String),
}

/// What the forecast is of, and who makes it.
#[derive(Default)]
pub(super) struct Forecasting {
    asked: Option<Asked>,
    asked_at: Option<Instant>,
    task: Option<Task>,
    /// Threads on which blocks are tried.
    pub(super) n_threads: usize,
    focus: Arc<Focus>,
    answer: Forecast,
}

impl Session {
    /// What the next bake will take, as far as it is known.
    pub fn forecast(&self) -> &Forecast {
        &self.forecasting.answer
    }

    /// The same where it is of this view with these settings.
    pub(super) fn forecast_of(&self, settings: &BakeSettings, camera: Option<&Camera>) -> Option<&Forecast> {
        let scene = self.opened.as_ref()?.scene.as_ref()?;
        let asked = self.forecasting.asked.as_ref()?;
        asked.is(scene, settings, camera).then_some(&self.forecasting.answer)
    }

    /// Asks for a forecast where no bake of this view with these settings is there, once they have stayed for a while. `camera` is
    /// where it is seen from, if not from that of the settings.
    pub fn foresee(&mut self, settings: &BakeSettings, camera: Option<&Camera>) {
        let scene = self.opened.as_ref().and_then(|opened| opened.scene.clone());
        let Some(scene) = scene.filter(|_| !self.bake.is_running() && !self.is_baked_with(settings, camera)) else {
            self.forget_forecast();
            return;
        };
        if self.forecast_of(settings, camera).is_none() {
            self.forget_forecast();
            self.forecasting.asked = Some(Asked { scene, settings: settings.clone(), camera: camera.cloned() });
            (self.forecasting.asked_at, self.forecasting.answer) = (Some(Instant::now()), Forecast::Trying);
            (self.wake)(SETTLED);
        }
        if matches!(self.forecasting.answer, Forecast::Told(_)) {
            self.look_for_room();
        }
        let is_due = self.forecasting.asked_at.is_some_and(|at| at.elapsed() >= SETTLED);
        if !is_due || self.forecasting.task.is_some() || self.forecasting.answer != Forecast::Trying {
            return;
        }
        match self.fitting_job(settings, camera.cloned()) {
            Ok((job, n_threads)) => {
                self.forecasting.n_threads = n_threads;
                let (focus, earlier, cache) =
                    (self.forecasting.focus.clone(), self.earlier_bakes(), self.cache.clone());
                self.forecasting.task = self.spawn("estimate", move |post| {
                    guarded(&post, || estimate(&job, n_threads, (earlier, cache), &focus, &post));
                });
            }
            Err(why) => self.forecasting.answer = Forecast::Failed(why),
        }
    }

    /// Lets the whole program take so much memory, bytes, or what the system has left. What did not fit may fit now.
    pub fn limit_memory(&mut self, limit: Option<u64>) {
        self.memory_limit = limit;
        if matches!(self.forecasting.answer, Forecast::Failed(_)) {
            self.forget_forecast();
        }
    }

    pub(super) fn forget_forecast(&mut self) {
        let old = std::mem::take(&mut self.forecasting);
        old.focus.leave();
        self.others.extend(old.task.map(Task::stopped));
    }

    pub(super) fn foreseen(&mut self, id: u64, answer: Forecast) {
        if self.forecasting.task.as_ref().is_some_and(|task| task.id() == id) {
            self.others.extend(self.forecasting.task.take());
            self.forecasting.answer = answer;
        }
    }
}

/// Does what answers with a forecast; where it panics, nobody waits for one any longer.
fn guarded(post: &Post, job: impl FnOnce()) {
    let Err(words) = crash::guarded(job) else { return };
    let words = format!("what the bake will take was not found out, and it can be started all the same: {words}");
    for fact in [Fact::Foreseen(Forecast::Failed(words.clone())), Fact::Warned(words)] {
        let _ = post.send(fact, Duration::ZERO);
    }
}

/// Tries what the bake would trace: it finds and takes over what [`super::task::bake`] would.
fn estimate(
    job: &BakeJob,
    n_threads: usize,
    (mut earlier, cache): (Vec<Bake>, Option<BakeCache>),
    focus: &Focus,
    post: &Post,
) {
    let answer = |forecast| {
        let _ = post.send(Fact::Foreseen(forecast), Duration::ZERO);
    };
    let place = cache.as_ref().map(|cache| (cache, cache.place(job)));
    if place.as_ref().is_some_and(|(cache, place)| cache.holds(place)) {
        return answer(Forecast::There);
    }
    let mut reuse = most_reused(job, &earlier);
    if reuse.is_none() {
        let relatives = place.iter().flat_map(|(cache, place)| cache.relatives(place));
        earlier.extend(relatives.filter_map(|found| if let Found::Hit(bake) = found { Some(*bake) } else { None }));
        reuse = most_reused(job, &earlier);
    }
    if reuse.as_ref().is_some_and(|reuse| (reuse.n_traced_columns(), reuse.n_added_rows()) == (0, 0)) {
        return answer(Forecast::There);
    }
    let tried = beside_the_window(n_threads, || match &reuse {
        Some(reuse) => job.estimate_reusing(reuse, BUDGET, focus),
        None => job.estimate(BUDGET, focus),
    });
    match tried {
        Ok(None) => {}
        Ok(Some(estimate)) => answer(Forecast::Told(estimate)),
        Err(why) => answer(Forecast::Failed(why)),
    }
}

#[cfg(test)]
mod tests {
    use super::super::Notice;
    use super::*;

    #[test]
    fn what_did_not_fit_is_foreseen_again_under_another_limit() {
        let mut session = Session::new(Arc::new(|_| {}));
        session.forecasting.answer = Forecast::Failed("the bake would take more than may be taken".into());
        session.limit_memory(Some(1 << 30));
        assert_eq!((session.memory_limit, session.forecast()), (Some(1 << 30), &Forecast::None));
    }

    #[test]
    fn an_estimate_that_panics_is_told_and_nobody_waits_for_it() {
        let mut session = Session::new(Arc::new(|_| {}));
        session.forecasting.answer = Forecast::Trying;
        session.forecasting.task = session.spawn("estimate", |post| {
            guarded(&post, || panic!("injected by a test of the estimate"));
        });
        let mut notices = Vec::new();
        while *session.forecast() == Forecast::Trying || notices.is_empty() {
            notices.extend(session.drain());
            std::thread::sleep(Duration::from_millis(2));
        }
        let [Notice::Failed(words)] = notices.as_slice() else { panic!("{notices:?}") };
        assert!(words.contains("can be started all the same: it ended unexpectedly"), "{words}");
        assert_eq!(*session.forecast(), Forecast::Failed(words.clone()));
    }
}
