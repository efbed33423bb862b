//! Progress reports of long work, and requests to stop it.
//!
//! Library code knows no terminals and no signals: it calls a [`Progress`] and polls a [`Cancel`].

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use crate::limits::memory_error;
use crate::{Error, Result};

/// Signal reported for a request whose number does not fit into an `i32`.
const SIGINT: i32 = 2;

/// A request to stop, shared by clones. Long loops poll it at least ten times a second.
#[derive(Debug, Clone, Default)]
pub struct Cancel {
    signal: Arc<AtomicUsize>,
    /// Bytes of memory in use and their limit, once they exceed it.
    memory: Arc<OnceLock<[u64; 2]>>,
}

impl Cancel {
    /// The shared flag, for signal handlers: 0 to go on, else the number of the signal that asked to stop.
    pub fn flag(&self) -> Arc<AtomicUsize> {
        Arc::clone(&self.signal)
    }

    /// Asks to stop, like the signal of this number; 0 withdraws the request.
    pub fn request(&self, signal: usize) {
        self.signal.store(signal, Ordering::Relaxed);
    }

    /// Asks to stop, since the process takes `bytes` of memory, more than its `limit`; no other call withdraws it.
    pub fn request_for_memory(&self, bytes: u64, limit: u64) {
        // The first excess is the one that is reported.
        self.memory.get_or_init(|| [bytes, limit]);
    }

    /// True after a request to stop, until it is withdrawn.
    pub fn is_requested(&self) -> bool {
        self.signal.load(Ordering::Relaxed) != 0 || self.memory.get().is_some()
    }

    /// `Ok` to go on; loops call it with `?` to end at a request.
    /// # Errors
    /// `Cancelled` with the signal's number, or `Limit` of memory, once a stop was asked for.
    pub fn check(&self) -> Result<()> {
        match self.signal.load(Ordering::Relaxed) {
            0 => self.memory.get().map_or(Ok(()), |[bytes, limit]| Err(memory_error(*bytes, *limit))),
            // Signals have numbers below 128. A caller of `request` that passes a larger one has its run reported as interrupted.
            signal => Err(Error::Cancelled { signal: i32::try_from(signal).unwrap_or(SIGINT) }),
        }
    }
}

/// Receives progress reports of long work. Calls are cheap and come from any thread.
pub trait Progress: Sync {
    /// A new stage begins; `total` steps are expected, 0 if unknown.
    fn stage(&self, name: &str, total: u64);

    /// `steps` more steps of the stage are done.
    fn advance(&self, steps: u64);

    /// A message for the user, one line.
    fn message(&self, text: &str);
}

/// A [`Progress`] that discards all reports, for callers without a terminal.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn stage(&self, _name: &str, _total: u64) {}
    fn advance(&self, _steps: u64) {}
    fn message(&self, _text: &str) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_reaches_every_clone_with_its_signal() {
        let cancel = Cancel::default();
        let other = cancel.clone();
        assert!(other.check().is_ok() && !other.is_requested());
        cancel.request(15);
        assert_eq!(other.check().map_err(|e| e.exit_code()), Err(143));
    }

    #[test]
    fn an_excess_of_memory_is_told_with_the_first_number() {
        let cancel = Cancel::default();
        let other = cancel.clone();
        cancel.request_for_memory(2000, 1000);
        cancel.request_for_memory(3000, 1000);
        assert!(other.is_requested());
        let Err(e) = other.check() else { panic!("goes on") };
        assert_eq!(e.exit_code(), 1);
        assert!(e.to_string().contains("2,000") && e.to_string().contains("--max-memory"), "{e}");
    }
}
