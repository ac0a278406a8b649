//! Live classes against what is normal: events in words.
//!
//! The pure core is [`Watch`]: class maps in, changes of events out; it reads no clock, no file, no
//! environment, and tells the same bytes for the same frames. [`run`] is the process round it.
//!
//! ```text
//! class map ─▶ changed cells ─▶ l = ln(1/K) - ln p ─▶ counted cells ─┬▶ regions (space) ─┬▶ happenings ─▶ outbox ─▶
//!                  │                  ▲                              └▶ charges (time) ──┘       │
//!                  └──▶ counts ───────┘◀── held: nothing is learnt in an event, a fault, quarantine
//! ```
//!
//! **Phases** of an area: learning (`detector.learning_s` of observed frames), calibrating
//! (`calibration_s`; the scores of normal life, all held out, give the levels), watching. Until then only faults are
//! told: lasers that are silent, coverage that is lost.
//!
//! **Where the counts come from.** The core keeps counts of its own instead of using the mapper's
//! collapsed map. The collapsed map is the paper's: every frame counts, for ever. What is *normal* must not
//! learn from an intruder who stands still for two hours, from a fault, nor within minutes of either,
//! and it fades (half-life three weeks). So one fact has one owner each: the mapper owns what was seen, this core
//! what is normal. The collapsed map only *seeds* a core that is still learning, after its file was lost.
//!
//! **Beyond the design**, found on the simulated foyer (`examples/evaluate.rs`): evidence is counted from
//! 4 nats on and only the excess adds up (a path with ten walks an hour is at 4 nats; summing all of l
//! rewards length, not surprise); presence is explained by presence within 0.4 m; absence counts only
//! where something usually stands; the tail of a short calibration is not taken as heavier than
//! exponential, because a score of capped cells is bounded.
//!
//! Invariants
//! - A score is of frames that the model has not seen: a run of a class is learnt when it ends.
//! - `unknown` is never scored and never learnt as a class.
//! - "Nothing is here" is evidence only where a laser can look: not in a shadow, not while a laser is
//!   silent, not in a door.
//! - Thresholds move at the end of the calibration and at a start with another budget, and say so.
//! - A frame allocates nothing while nothing is told and nothing is charged.
//! - After `cleared`, an `updated` of the same id opens the event again: the last change tells how it stands.
//!
//! | where | what |
//! |---|---|
//! | `watch`, `stages` | the core: a frame, the phases, the slow work between |
//! | `sense` | changed cells, evidence, regions |
//! | `normal` | counts, probability, forgetting, seeding |
//! | `survey`, `box_sums` | taking stock of the whole map, a few cells a frame |
//! | `role` | what a class says, read off its prototype |
//! | `shadow` | what no laser can see |
//! | `charge` | leaky CUSUM |
//! | `threshold` | alarm budget to level: Garwood, generalised Pareto |
//! | `life`, `ledger`, `words` | happenings, their ids and numbers, their sentences |
//! | `door`, `supervise`, `faults` | doors that are held, lasers, coverage |
//! | `snapshot`, [`outbox`], [`store`] | what is kept, as bytes; what is to be told; the files |
//! | `shell` | the process |
//!
//! Left out: armed and disarmed times, budgets of zones, "accept as normal" by an operator (an object that
//! stays is an event that stays open), clips, thresholds that are refined while watching, and the
//! supervision that needs raw scans (stuck, blocked, blinded, moved lasers). Somebody who loiters in an
//! open door is told as the door that is held.

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
mod shell;
mod snapshot;
mod stages;
pub mod store;
mod supervise;
mod survey;
#[cfg(test)]
mod testing;
mod threshold;
mod watch;
mod words;

pub use shell::run;
pub use snapshot::SnapshotError;
pub use watch::{ClassFrame, Counters, Phase, Watch};
