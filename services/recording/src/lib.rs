//! Reads and writes recordings of scans: ROS 1 bags (read) and MCAP (read and written).
//!
//! A recording is what a laser's own people made with their tools: [`Recording::open`] tells the
//! format by the content, [`Recording::scans`] streams the scans in the order of the file,
//! [`RecordingIndex::scan`] looks through all of it, [`ScanWriter`] writes one.
//!
//! Invariants
//! - Any bytes are taken: an error in words, never a panic, never a loop. Every length is compared
//!   with a limit and with what is there before anything is allocated.
//! - Memory does not grow with the recording: one message, one buffer, the names of the topics.
//! - A recording that is cut gives every scan before the cut, then [`RecordingError::Cut`].
//! - Numbers are what the file says: ranges bit by bit, f32 geometry widened to f64, the stamp of
//!   the message's header (first beam). Nothing is filtered, sorted or repaired: that is the
//!   laser's work.
//!
//! | where | what |
//! |---|---|
//! | `format` | which kind of file is it; words for kinds that are not read |
//! | `bag`, `bag_v1`, `mcap_file` | the containers, front to back |
//! | `record` | a record of a bag of either version |
//! | `laser_scan`, `cursor` | bytes of a message to a scan, ROS 1 and CDR |
//! | `recording` | [`Recording`], the iterator [`Scans`] |
//! | `index`, `extent` | what is in it; how far the echoes reach |
//! | `ros2` | the messages that we write: definitions, CDR |
//! | `mcap_writer`, `writer` | one file while it is written: [`McapWriter`], [`ScanWriter`] |
//! | `bag_directory`, `bag_metadata` | the files of a session, `metadata.yaml`; what is kept |
//! | `recover`, `facts` | a file that was cut; what a complete one holds |
//!
//! Left out: `MultiEchoLaserScan`, ROS 2 `.db3`, ROS bags before 1.2, CARMEN and Player logs (each
//! is named when it is met), and intensities.

mod bag;
mod bag_directory;
mod bag_metadata;
mod bag_v1;
mod cursor;
mod error;
mod extent;
mod facts;
mod format;
mod index;
mod laser_scan;
mod mcap_file;
mod mcap_records;
mod mcap_writer;
mod record;
mod recording;
mod recover;
pub mod ros2;
mod section;
mod stream;
mod writer;

pub use bag_directory::{BagDirectory, Kept, RecordedFile, to_remove};
pub use error::RecordingError;
pub use extent::{Extent, ExtentError, MARGIN_M, TAIL_SHARE};
pub use facts::{Attached, attachment, file_facts};
pub use format::Format;
pub use index::{GAP_NS, RecordingIndex, TopicSummary};
pub use mcap_writer::{
    ACTIVE_SUFFIX, FileFacts, McapWriter, TopicFacts, TopicSpec, WrittenFile, active_path,
};
pub use recording::{RecordedScan, Recording, Scans};
pub use recover::{Recovered, recover};
pub use writer::{ScanTopic, ScanWriter, as_recorded, encode_scan};
