//! The recorder: what a site sees and says, as files that every ROS tool opens.
//!
//! A reader of the shared memory like any other, in a process of its own: it can be killed, its
//! disk can be full, and nobody else notices. What it writes is a ROS 2 bag: MCAP, profile `ros2`,
//! every message in CDR, `metadata.yaml` beside it.
//!
//! | topic | type | what, how often |
//! |---|---|---|
//! | `/laser_<id>/scan` | LaserScan | every scan, f32 ranges bit by bit |
//! | `/laser_<id>/echo_share` | Float32 | share of beams with an echo, once a second, for plots |
//! | `/area_<id>/classes` | OccupancyGrid | the class map, every `classes_period_s` |
//! | `/area_<id>/maps/<context>/counts` | Grid (Foxglove) | the collapsed map, exact, every `maps_period_s` |
//! | `/area_<id>/maps/<context>/<class>` | OccupancyGrid | the same in percent of the frames |
//! | `/events` | Log | every change of every event, in the words of the alert |
//! | `/events/markers` | MarkerArray | where the open events are |
//! | `/zones` | MarkerArray | the named places |
//! | `/tf_static` | TFMessage | `map` -> `laser_<id>` |
//!
//! A value of a class map is a class: the notes of its channel say which. Counts are one f64 a class
//! and cell; the last of them is written at the end.
//!
//! Names of ROS hold no `-`: an id `a-b` is `a_b` there. Log time is the site's time at reception,
//! publish time is the stamp. Attached: `site.toml` (see [`attach`] for what is left out of it) and
//! `calibration.json`; the metadata record `tog.session` says who recorded when.
//!
//! Invariants
//! - Whole seconds: every second the chunk is closed and given to the system. `kill -9` loses one
//!   at most.
//! - A file with its final name is complete and on the disk. What a killed recorder left is
//!   recovered by the next one, in a thread beside the recording, and read back before the remains
//!   are deleted; where parts were damaged the remains are kept as `.damaged`.
//! - A file that is deleted or moved away while it is written is missed within a second, told, and
//!   followed by a new one.
//! - Every file stands alone: it begins with the last message of every latched topic.
//! - A full disk stops nothing but the recording: it is counted, told in health, and a new file
//!   begins when there is room.
//! - No disk is waited for while messages come: files are put on the disk by the thread of
//!   [`shelf`].
//!
//! | where | what |
//! |---|---|
//! | [`catalogue`] | pure: which topics a site has in a recording, and what they are called |
//! | [`attach`] | pure: site file, calibration and session, as they lie in each file |
//! | [`maps`], [`signs`] | pure: maps, events and poses as messages |
//! | [`tape`] | where messages go: files one after the other, seconds, a full disk |
//! | [`shelf`] | the thread for everything that waits for a disk |
//! | [`core`] | from shared memory to the tape |
//! | [`service`] | `tog recorder`, started by `tog run` |
//! | [`attached`] | `tog bag record`, beside a running site |
//!
//! Left out: frames (they follow from the scans), health, and power loss: a flush gives the data
//! to the kernel, the kernel to the disk within half a minute.

pub mod attach;
pub mod attached;
pub mod catalogue;
pub mod core;
pub mod maps;
pub mod service;
pub mod shelf;
pub mod signs;
pub mod tape;

pub use attached::{AttachError, AttachedOptions, Progress, record_attached};
pub use service::run;
