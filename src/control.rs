//! How long work is stopped and how it says where it is.

use crate::error::Error;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Shared between a kernel, which counts what it has done, and its caller, which may stop it.
#[derive(Debug, Default)]
pub struct Control {
    stop: AtomicBool,
    done: AtomicUsize,
}

impl Control {
    /// Asks the kernel to end at its next [`step`](Self::step).
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Units of work finished so far.
    pub fn done(&self) -> usize {
        self.done.load(Ordering::Relaxed)
    }

    /// Called by the kernel after a unit of work.
    ///
    /// # Errors
    /// [`Error::Interrupted`] once the caller has asked to stop.
    pub fn step(&self, units: usize) -> Result<(), Error> {
        self.done.fetch_add(units, Ordering::Relaxed);
        if self.stop.load(Ordering::Relaxed) { Err(Error::Interrupted) } else { Ok(()) }
    }
}
