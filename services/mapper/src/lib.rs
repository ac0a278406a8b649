//! The mapper: the temporal occupancy grid of an area, its collapsed map, its checkpoint. One
//! process per area.
//!
//! | question | file |
//! |---|---|
//! | frames in, classes out, counts kept | [`core`] (pure) |
//! | in which collapsed map is a frame counted? | [`context`] (pure) |
//! | what is on disk, and what if it is damaged? | [`checkpoint`] |
//! | results of a replay as NumPy files | [`results`], [`npy`] |
//! | the process: shared memory, health, the writer thread | [`shell`] |
//!
//! Invariants: no count before the last checkpoint is ever lost; a restart goes on counting, with the
//! windows as they were; a checkpoint that cannot be used is named, kept aside, never overwritten.

pub mod checkpoint;
pub mod context;
pub mod core;
pub mod npy;
pub mod results;
pub mod shell;
