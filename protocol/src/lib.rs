//! The vocabulary of tog: whatever crosses a process. Plain data, no IO.
//!
//! | message | publisher | readers | rate | size |
//! |---|---|---|---|---|
//! | [`scan::ScanHeader`] + `[f32]` | laser | fusion, recorder | 5-75 Hz a laser | 4 B a beam |
//! | [`frame::FrameHeader`] + `[u64]` | fusion | mapper | 10-75 Hz an area | 2 bits a cell |
//! | [`grid::ClassMapHeader`] + `[u8]` | mapper | anomaly | as frames | 1 B a cell |
//! | [`grid::CollapsedMapHeader`] + `[u64]` | mapper | anomaly | at start, then each checkpoint | 8 B a cell and class |
//! | [`event::EventChange`] (encoded) | anomaly | alerts | rare | < 4 kB |
//! | [`event::EventAcknowledgement`] (encoded) | alerts | anomaly | with events | < 100 B |
//! | [`health::Health`] (encoded) | all | supervisor, bridge | 1 Hz and on change | < 64 kB |
//! | [`link::HostHealth`] (encoded) | bridge of every host | bridges of all others | as health | < 64 kB |
//! | [`link::CarriedScan`] (encoded) | bridge of the laser's host | bridge of the area's host | as scans | 4 B a beam |
//! | [`link::Claims`] (encoded) | bridge of a host that runs an area with a standby, or is one | the other one | 2 Hz | < 10 kB |
//! | [`link::FilePage`] (encoded) | bridge of the owner of an area | bridge of its standby | with checkpoints | < 129 kB |
//! | [`ownership::Ownership`] (encoded) | bridge | supervisor of its host | rare | < 4 kB |
//! | [`link::EventPage`] (encoded) | bridge of every host | bridges of the desks | 1 Hz and with events | < 256 kB |
//!
//! Versioning: a shared-memory header carries its version in `Header::TYPE_NAME`, an encoded message
//! in its envelope ([`codec`]). Any change that a reader of the old layout would misread takes a new
//! version; all processes of a host are one binary, so only the network and files meet old versions.
//!
//! | where | what |
//! |---|---|
//! | [`site`] | the site file: the only parser, every error at once, the JSON schema |
//! | [`topic`] | the only names of topics |
//! | [`wire`] | what every header in shared memory begins with; no padding byte crosses a process |
//! | [`codec`] | the envelope of everything that is encoded: network, journal, events, health |
//! | [`time`], [`geometry`] | the lattice of frames; the one owner of metres <-> cells |
//! | [`scan`], [`frame`], [`grid`], [`event`], [`health`] | the messages |
//! | [`link`] | what only bridges say to each other |
//! | [`ownership`] | which areas run on this host now |
//!
//! Invariants: nothing here reads a file, a clock or an environment; no decoder and no parser panics,
//! whatever the bytes (property tests beside this crate, fuzz targets in `tests/fuzz`); the bytes of
//! each version are held by tests (`tests/vocabulary/wire_format.rs`, `layout.rs`).

pub mod carried;
pub mod codec;
pub mod event;
pub mod frame;
pub mod geometry;
pub mod grid;
pub mod health;
pub mod link;
pub mod ownership;
pub mod scan;
pub mod site;
pub mod time;
pub mod topic;
pub mod wire;
