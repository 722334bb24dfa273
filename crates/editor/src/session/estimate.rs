//! What the next bake will take, found out in the background while nothing is baked.

use std::sync::Arc;
use std::time::{Duration, Instant};

use clerestory_transport::bake::BakeJob;
use clerestory_transport::bake::estimate::BakeEstimate;
use clerestory_transport::bake::focus::Focus;
use clerestory_transport::prepared::PreparedScene;

use super::task::{Fact, Post, Task, beside_the_window};
use super::{BakeSettings, Session};

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
    /// About what it will take.
    Told(BakeEstimate),
    /// It cannot be baked like this, in words.
    Failed(String),
}

/// What the forecast is of, and who makes it.
#[derive(Default)]
pub(super) struct Forecasting {
    asked: Option<(Arc<PreparedScene>, BakeSettings)>,
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

    /// The same where it is of these settings.
    pub(super) fn forecast_of(&self, settings: &BakeSettings) -> Option<&Forecast> {
        let scene = self.opened.as_ref()?.scene.as_ref()?;
        let (of, asked) = self.forecasting.asked.as_ref()?;
        (Arc::ptr_eq(of, scene) && asked == settings).then_some(&self.forecasting.answer)
    }

    /// Asks for a forecast where settings are not those of the bake that is there, once they have stayed for a while.
    pub fn foresee(&mut self, settings: &BakeSettings) {
        let scene = self.opened.as_ref().and_then(|opened| opened.scene.clone());
        let Some(scene) = scene.filter(|_| !self.bake.is_running() && !self.is_baked_with(settings)) else {
            self.forget_forecast();
            return;
        };
        if self.forecast_of(settings).is_none() {
            self.forget_forecast();
            self.forecasting.asked = Some((scene, settings.clone()));
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
        match self.fitting_job(settings, None) {
            Ok((job, n_threads)) => {
                self.forecasting.n_threads = n_threads;
                let focus = self.forecasting.focus.clone();
                self.forecasting.task = self.spawn("estimate", move |post| estimate(&job, n_threads, &focus, &post));
            }
            Err(why) => self.forecasting.answer = Forecast::Failed(why),
        }
    }

    pub(super) fn forget_forecast(&mut self) {
        let old = std::mem::take(&mut self.forecasting);
        old.focus.leave();
        self.others.extend(old.task.map(Task::stopped));
    }

    pub(super) fn foreseen(&mut self, id: u64, answer: Result<BakeEstimate, String>) {
        if self.forecasting.task.as_ref().is_some_and(|task| task.id() == id) {
            self.others.extend(self.forecasting.task.take());
            self.forecasting.answer = match answer {
                Ok(estimate) => Forecast::Told(estimate),
                Err(why) => Forecast::Failed(why),
            };
        }
    }
}

fn estimate(job: &BakeJob, n_threads: usize, focus: &Focus, post: &Post) {
    match beside_the_window(n_threads, || job.estimate(BUDGET, focus)) {
        Ok(None) => {}
        Ok(Some(estimate)) => {
            let _ = post.send(Fact::Foreseen(Ok(estimate)), Duration::ZERO);
        }
        Err(why) => {
            let _ = post.send(Fact::Foreseen(Err(why)), Duration::ZERO);
        }
    }
}
