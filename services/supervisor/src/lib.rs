//! Starts, watches and stops the processes of a site on this host.
//!
//! One loop, one thread: it sleeps until a child ends, writes, or tells its health, until a deadline,
//! a signal or a visitor of the status socket. It is the owner of the site's shared memory.
//!
//! Invariants:
//! - A process that ends, for whatever reason and at whatever moment, is started again; only a wrong
//!   configuration or five failures at start-up, never once ready, stop the site, and then its last words say why.
//! - A process that tells no health for 10 s (a minute while it starts) hangs: it is killed and started again.
//! - The end is orderly: lasers first, alerts last, each with 3 s to finish; afterwards no process,
//!   no shared memory and no run directory is left.
//! - When every area's anomaly service says that the recording is over, the site ends by itself.
//!
//! | where | what |
//! |---|---|
//! | [`policy`] | pure: when a process is started again, when the site gives up |
//! | `service` | one process: start, log, health, end |
//! | `supervisor` | the loop, the watchdog, the shutdown |
//! | [`control`], [`report`] | `tog status`: socket, client, table |
//! | [`notify`] | what systemd is told |
//! | `output` | the common log |
//!
//! Left to the alerts of a later slice: restarts are counted and logged here, but not told as
//! `ProcessRestarted` events.

pub mod control;
pub mod notify;
mod output;
pub mod policy;
pub mod report;
mod service;
mod supervisor;

pub use control::{StatusError, status, status_in};
pub use report::{ProcessState, ServiceStatus, StatusReport};
pub use supervisor::{Options, run};
