//! Fusion: who is in this frame, who is late. One process per area.
//!
//! | question | file |
//! |---|---|
//! | which scan belongs to which frame, when is a frame complete? | [`slot`] (pure) |
//! | scans in, frames out: slots + the incremental fuser of `occupancy` | [`core`] (pure) |
//! | the process: shared memory, clock, health | [`shell`] |
//!
//! Invariants: the contents of a frame are a function of the stamps alone, unless a deadline struck;
//! a laser that is silent delays a frame by `lateness_max_ms` at most and is not waited for after
//! `laser_lost_ms`; queues are bounded ([`slot::SLOTS_MAX`]).

pub mod core;
pub mod shell;
pub mod slot;
