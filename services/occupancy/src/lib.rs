//! The paper, pure: from scan to collapsed map. No clock, no file, no thread; the same input gives
//! the same bits.
//!
//! Everything is here twice: [`dense`] is the literal version, every cell of every frame; the rest
//! follows the changes, and is bit-identical to it in frame, sums, classes and counts
//! (`tests/agreement.rs`). What every number means is written in the project's semantics page.
//!
//! | paper | meaning | incremental | dense |
//! |---|---|---|---|
//! | Eq. 6 | what a beam says of a cell | [`sensor_model`], `fuse::Fuser::apply` | `dense::fuse::Laser::paint` |
//! | 3.3 | hit > miss > unknown over all beams | `votes::Votes::cast` | [`dense::Fuser::fuse`] |
//! | Eq. 7 | `S_k`, `K` over the last N_k frames | `cell::Cell::sum`, `known` | `dense::grid::slide_windows` |
//! | 3.3 | occupancy `o_k = (S_k / N_k + 1) / 2` | [`TemporalGrid::occupancy`] | `dense::grid::classify` |
//! | Eq. 8 | class, and until when it stays | `prototype::Classifier::judge` | `dense::grid::classify` |
//! | 3.2 | collapsing: frames by class | `collapsed_map`, by run length | `dense::grid::collapse` |
//!
//! | where | what |
//! |---|---|
//! | `wedge` | cells of a beam by range, and the readings at which they change, computed once |
//! | `flip`, `flip_log` | changes of the frames: the only memory of the past |
//! | `calendar` | which cells are due for a look at their class |
//! | `engine` | one step a frame, for a number of timescales known when compiled |
//! | [`History`] | contents of the windows as plain data, for a restart |
//! | [`GridConfig`] | windows and prototypes of an area |

mod calendar;
mod cell;
mod collapsed_map;
mod config;
pub mod dense;
mod engine;
mod flip;
mod flip_log;
mod fuse;
mod history;
mod prototype;
mod readout;
pub mod sensor_model;
mod temporal_grid;
mod votes;
mod wedge;

pub use config::{ConfigError, GridConfig, WINDOW_FRAMES_MAX};
pub use fuse::Fuser;
pub use history::{History, RestoreError};
pub use sensor_model::LaserModel;
pub use temporal_grid::TemporalGrid;
