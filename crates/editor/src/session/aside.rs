//! A job beside the window: one at a time, its answer taken when it comes. Nobody waits for a job whose answer is not wanted any
//! more: it only reads, and ends by itself.

use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use super::Wake;
use crate::crash;

/// At most one running job with an answer.
pub struct Aside<T> {
    running: Option<(Receiver<T>, JoinHandle<()>)>,
}

impl<T> Default for Aside<T> {
    fn default() -> Self {
        Aside { running: None }
    }
}

impl<T: Send + 'static> Aside<T> {
    /// Whether a job runs, or its answer was not taken yet.
    pub fn is_busy(&self) -> bool {
        self.running.is_some()
    }

    /// Starts a job if none runs.
    ///
    /// # Errors
    /// If the system gives no thread, in words.
    pub fn start(&mut self, name: &str, wake: &Wake, job: impl FnOnce() -> T + Send + 'static) -> Result<(), String> {
        if self.is_busy() {
            return Ok(());
        }
        let (sender, receiver) = sync_channel(1);
        let wake = wake.clone();
        let body = move || {
            // Nobody may listen any more, which is no fault.
            let _ = sender.send(job());
            wake(Duration::ZERO);
        };
        let thread = std::thread::Builder::new().name(name.into()).spawn(body);
        let thread = thread.map_err(|error| format!("no thread could be started: {error}"))?;
        self.running = Some((receiver, thread));
        Ok(())
    }

    /// The answer, once; an error in words where the job ended without one.
    pub fn take(&mut self) -> Option<Result<T, String>> {
        let (receiver, _) = self.running.as_ref()?;
        let answer = match receiver.try_recv() {
            Ok(answer) => Ok(answer),
            Err(TryRecvError::Empty) => return None,
            Err(TryRecvError::Disconnected) => Err(crash::words()),
        };
        if let Some((_, thread)) = self.running.take() {
            // A panic was printed by the thread itself, and its answer is missed.
            let _ = thread.join();
        }
        Some(answer)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    fn answer<T: Send + 'static>(aside: &mut Aside<T>) -> Result<T, String> {
        loop {
            if let Some(answer) = aside.take() {
                return answer;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    #[test]
    fn one_answer_comes_and_a_crash_is_told() {
        let wake: Wake = Arc::new(|_| {});
        let mut aside = Aside::default();
        aside.start("sum", &wake, || 1 + 1).unwrap();
        aside.start("not now", &wake, || 7).unwrap();
        assert_eq!(answer(&mut aside), Ok(2));
        assert!(!aside.is_busy() && aside.take().is_none());
        aside.start("crash", &wake, || panic!("as asked")).unwrap();
        assert!(answer(&mut aside).is_err());
    }

    #[test]
    fn whoever_leaves_does_not_wait_for_the_job() {
        let wake: Wake = Arc::new(|_| {});
        let ((go_on, held), (sender, ended)) = (sync_channel::<()>(1), sync_channel(1));
        let mut aside = Aside::default();
        let job = move || {
            let is_let_go = held.recv_timeout(Duration::from_secs(5)).is_ok();
            sender.send(is_let_go).unwrap();
        };
        aside.start("long", &wake, job).unwrap();
        drop(aside);
        // Whoever waited for it would come too late.
        go_on.send(()).unwrap();
        assert_eq!(ended.recv(), Ok(true));
    }
}
