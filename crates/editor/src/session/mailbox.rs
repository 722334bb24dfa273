//! Orders to a thread of its own, and its answers: the newest counts, nobody waits for the window.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::Wake;

/// What lies in a mailbox.
pub(super) struct Mail<O, A> {
    pub order: Option<O>,
    pub answer: Option<A>,
    pub closed: bool,
}

/// Where orders and answers are left.
pub(super) struct Mailbox<O, A> {
    mail: Mutex<Mail<O, A>>,
    posted: Condvar,
    wake: Wake,
}

/// What to do without a new order.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Idle {
    /// Wait for one.
    Sleep,
    /// Wait for one as long as that, then go on with what is at hand.
    Rest(Duration),
    /// Go on with what is at hand.
    GoOn,
}

impl<O, A> Mailbox<O, A> {
    pub fn lock(&self) -> MutexGuard<'_, Mail<O, A>> {
        // Mail is replaced as a whole, so it is sound even after a panic elsewhere.
        self.mail.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The next order; waits for one where there is nothing to go on with. `None` where nobody wants any more.
    pub fn next(&self, idle: Idle) -> Option<Option<O>> {
        let begun = Instant::now();
        let mut mail = self.lock();
        loop {
            if mail.closed {
                return None;
            }
            let patience = match idle {
                Idle::Sleep => Duration::MAX,
                Idle::Rest(patience) => patience.saturating_sub(begun.elapsed()),
                Idle::GoOn => Duration::ZERO,
            };
            if mail.order.is_some() || patience.is_zero() {
                return Some(mail.order.take());
            }
            mail = self.posted.wait_timeout(mail, patience).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Leaves an answer and has the window look at it.
    pub fn answer(&self, answer: A) {
        self.lock().answer = Some(answer);
        (self.wake)(Duration::ZERO);
    }

    /// Whether the order at hand is stale: a newer one waits, or nobody wants any more.
    pub fn is_stale(&self) -> bool {
        let mail = self.lock();
        mail.closed || mail.order.is_some()
    }
}

/// A thread with a mailbox; it ends when this is dropped.
pub struct Clerk<O, A> {
    mailbox: Arc<Mailbox<O, A>>,
    thread: Option<JoinHandle<()>>,
}

impl<O: Send + 'static, A: Send + 'static> Clerk<O, A> {
    /// Starts the thread.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub(super) fn start(
        name: &str,
        wake: Wake,
        work: impl FnOnce(&Mailbox<O, A>) + Send + 'static,
    ) -> std::io::Result<Self> {
        let mail = Mutex::new(Mail { order: None, answer: None, closed: false });
        let mailbox = Arc::new(Mailbox { mail, posted: Condvar::new(), wake });
        let own = mailbox.clone();
        let thread = std::thread::Builder::new().name(name.into()).spawn(move || work(&own))?;
        Ok(Clerk { mailbox, thread: Some(thread) })
    }
}

impl<O, A> Clerk<O, A> {
    /// Leaves an order; answers the one that it replaces, which was not begun yet.
    pub fn order(&self, order: O) -> Option<O> {
        let older = self.mailbox.lock().order.replace(order);
        self.mailbox.posted.notify_one();
        older
    }

    /// Leaves an order, made of the one that was not begun yet, if any.
    pub(super) fn order_after(&self, make: impl FnOnce(Option<O>) -> O) {
        let mut mail = self.mailbox.lock();
        let older = mail.order.take();
        mail.order = Some(make(older));
        self.mailbox.posted.notify_one();
    }

    /// The newest answer, once.
    pub fn take(&self) -> Option<A> {
        self.mailbox.lock().answer.take()
    }
}

impl<O, A> Drop for Clerk<O, A> {
    fn drop(&mut self) {
        self.mailbox.lock().closed = true;
        self.mailbox.posted.notify_one();
        if let Some(thread) = self.thread.take() {
            // A worker that panicked has said so on its own; there is nothing left to do here.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_rests_takes_an_order_at_once_and_goes_on_without_one() {
        let (sender, took) = std::sync::mpsc::channel();
        let work = move |mailbox: &Mailbox<u32, u32>| {
            // Longer than anybody lives, and no time at all.
            for rest in [Duration::MAX, Duration::from_millis(1), Duration::MAX] {
                sender.send(mailbox.next(Idle::Rest(rest))).unwrap();
            }
        };
        let clerk = Clerk::start("a clerk that rests", Arc::new(|_| ()), work).unwrap();
        clerk.order(7);
        assert_eq!(took.recv().unwrap(), Some(Some(7)));
        assert_eq!(took.recv().unwrap(), Some(None));
        drop(clerk);
        assert_eq!(took.recv().unwrap(), None, "nobody wants any more");
    }
}
