//! The paper, literally: every cell of every frame. The oracle of the tests and the baseline of the
//! benchmark; flat arrays and plain loops, no cleverness that could hide a mistake.

mod fuse;
mod grid;

pub use fuse::Fuser;
pub use grid::TemporalGrid;
