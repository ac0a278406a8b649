//! Laser acquisition: one process per laser, scans in, nothing else.
//!
//! | question | file |
//! |---|---|
//! | which scans go out: rising stamps, one geometry | [`gate`] (pure) |
//! | the scans of one topic of a recording | [`replay`] |
//! | the scans of an imagined laser | [`simulator`] |
//! | one face for all sources, what can go wrong | [`source`] |
//! | the source of a laser of the site file; the clock of a site | [`site`] |
//! | when a scan goes out | [`pace`] (pure) |
//! | the process: shared memory, clock, health | [`shell`] |
//!
//! Invariants: a scan is due when it is `stamp_ns` at the site, so deadlines are absolute and do not
//! drift; what a source hands out has rising stamps and the geometry of its first scan; what does not
//! fit is dropped and counted; the same source gives the same scans at every run.

pub mod gate;
pub mod pace;
pub mod replay;
pub mod shell;
pub mod simulator;
pub mod site;
pub mod source;
