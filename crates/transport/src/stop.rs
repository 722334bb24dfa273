//! Whether somebody still wants what takes long to read or to build.
//!
//! Work looks at it between its parts, ends early, and then hands on nothing: what a stop cut short is never mistaken for a
//! result.

use std::io::{self, BufRead, Read, Seek, SeekFrom};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that one thread sets and others look at. By default nobody asks.
#[derive(Clone, Debug, Default)]
pub struct Stop {
    asked: Arc<AtomicBool>,
    /// How often it is looked at until it is set, so that tests reach every such place.
    #[cfg(test)]
    looks_left: Option<Arc<std::sync::atomic::AtomicU64>>,
}

/// What was being made is not wanted any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped, as nobody wants it any more")]
pub struct Stopped;

impl Stop {
    /// Asks for an end, for good.
    pub fn ask(&self) {
        self.asked.store(true, Ordering::Relaxed);
    }

    /// Whether the work shall end.
    #[inline]
    pub fn is_asked(&self) -> bool {
        #[cfg(test)]
        if let Some(left) = &self.looks_left
            && left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)).is_err()
        {
            self.ask();
        }
        self.asked.load(Ordering::Relaxed)
    }

    /// The same, to be handed on with `?`.
    ///
    /// # Errors
    /// When it shall end.
    pub fn check(&self) -> Result<(), Stopped> {
        if self.is_asked() { Err(Stopped) } else { Ok(()) }
    }

    /// One that is set after it was looked at so often.
    #[cfg(test)]
    pub(crate) fn after(looks: u64) -> Stop {
        Stop { looks_left: Some(Arc::new(looks.into())), ..Stop::default() }
    }

    /// A reader that fails from the stop on.
    pub(crate) fn reader<R>(&self, reader: R) -> StoppedReader<'_, R> {
        StoppedReader { reader, stop: self }
    }
}

/// A question that many threads ask: once somebody answered that they shall stop, nobody goes on.
pub(crate) struct Halt<'a> {
    stop: &'a (dyn Fn() -> bool + Sync),
    called: AtomicBool,
}

impl<'a> Halt<'a> {
    pub fn new(stop: &'a (dyn Fn() -> bool + Sync)) -> Self {
        Halt { stop, called: AtomicBool::new(false) }
    }

    /// Asks once more.
    pub fn is_called(&self) -> bool {
        if !self.was_called() && (self.stop)() {
            self.called.store(true, Ordering::Relaxed);
        }
        self.was_called()
    }

    /// Whether anybody was told to stop.
    pub fn was_called(&self) -> bool {
        self.called.load(Ordering::Relaxed)
    }
}

/// See [`Stop::reader`].
pub(crate) struct StoppedReader<'a, R> {
    reader: R,
    stop: &'a Stop,
}

impl<R: Read> Read for StoppedReader<'_, R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        self.stop.check().map_err(io::Error::other)?;
        self.reader.read(out)
    }
}

impl<R: BufRead> BufRead for StoppedReader<'_, R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.stop.check().map_err(io::Error::other)?;
        self.reader.fill_buf()
    }

    fn consume(&mut self, n: usize) {
        self.reader.consume(n);
    }
}

impl<R: Seek> Seek for StoppedReader<'_, R> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.reader.seek(to)
    }
}
