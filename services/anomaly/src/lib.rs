//! Live classes against the collapsed map: events.
//!
//! The pure core is [`Watch`]: class maps in, changes of events out; it reads no clock, no file.

mod box_sums;
mod charge;
mod door;
mod faults;
mod ledger;
mod life;
mod normal;
pub mod outbox;
mod place;
mod plane;
mod role;
mod sense;
mod shadow;
mod snapshot;
mod stages;
mod supervise;
#[cfg(test)]
mod testing;
mod threshold;
mod watch;
mod words;

pub use snapshot::SnapshotError;
pub use watch::{ClassFrame, Counters, Phase, Watch};
