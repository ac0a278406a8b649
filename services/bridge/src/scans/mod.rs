//! The way of the scans, the only data that is in a hurry: not through the loop of `run`, but on the
//! threads of zenoh that send and receive anyway. A thread that is woken costs more than all that is
//! done with a scan; this way the bridge adds one wake on each host, that of shared memory.

mod incoming;
mod outgoing;

pub use incoming::{Incoming, IncomingCounts};
pub use outgoing::Outgoing;

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Whoever panicked with it left nothing half done: each scan is counted after it was sent.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
