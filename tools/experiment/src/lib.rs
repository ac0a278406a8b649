//! The three experiments of the paper, and whether a run shows what the paper's figures show.
//!
//! Pure: what is to be run ([`Experiment`], [`Rate`]), what was really there ([`Ground`]), what the
//! grid made of it ([`Shares`]), and the claims ([`claims`]), each with its exact definition. The
//! verb `tog experiment` runs them; no clock and no file is known here.
//!
//! Every number of a verdict is computed from the shares of a collapsed map and from the truth of
//! the scene: the surfaces that a laser can see, the cells that legs covered, the places of doors.
//! A claim either holds or not; its limits are constants, and were chosen with seeds 1 to 3 in view,
//! the foyer was arranged with 1 to 10: more seeds than that put them to the test.
//!
//! | where | what |
//! |---|---|
//! | `plan` | which scene, from when, for how long; the rates of the device |
//! | `shares` | a collapsed map by class name |
//! | `ground` | truth on the grid: surfaces, footprints |
//! | `blobs` | connected groups of cells |
//! | [`claims`] | the claims of the paper, defined |

mod blobs;
pub mod claims;
mod ground;
mod plan;
mod shares;

pub use blobs::{Blob, blobs};
pub use ground::{Footprints, Ground};
pub use plan::{Experiment, Rate, RateError, TURN_NS, phase_ns};
pub use shares::{CLASSES, Class, Shares};
