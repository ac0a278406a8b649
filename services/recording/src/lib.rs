//! Reads recordings of scans, whoever made them, and writes our own: MCAP, and CSV.
//!
//! A recording is what a laser's own people made with their tools: [`Recording::open`] tells the
//! format by the content, [`Recording::scans`] streams the scans in the order of the file,
//! [`RecordingIndex::scan`] looks through all of it, [`RecordingInfo::look`] says what it is (a large
//! MCAP from its index), [`ScanWriter`] and [`CsvWriter`] write one.
//!
//! | format | what is read | what is chosen where it is silent |
//! |---|---|---|
//! | MCAP | CDR and ROS 1 messages; the index for [`RecordingInfo`] | |
//! | ROS 1 bag 2.0, 1.2 | none, bz2, lz4 | |
//! | ROS 2 bag `.db3`, directories of bags | read-only, without a lock | `db3`, `parts` |
//! | CARMEN log, also `.gz` | `FLASER`, `RLASER`, `RAWLASER1`..5, `ROBOTLASER1`, 2 | angles, maxima, fault codes: `carmen`, `sick_codes` |
//! | Player log, file version 0.3, also `.gz` | `laser` data with and without pose | `player` |
//! | CSV, also `.gz` | columns that are declared: [`ColumnMap`] | `csv` |
//!
//! Messages are `sensor_msgs/LaserScan` and `MultiEchoLaserScan`, of which one echo of each beam is
//! taken: the first, unless [`ReadOptions::echo`] says otherwise.
//!
//! Invariants
//! - Any bytes are taken: an error in words, never a panic, never a loop. Every length is compared
//!   with a limit and with what is there before anything is allocated.
//! - Memory does not grow with the recording: one message (16 of a database), one buffer, the names of
//!   the topics. Work grows with the length of the file and no faster: what chunks announce to unpack
//!   to is compared with the bytes of the file (`unpack`), the steps of SQLite are counted.
//! - A recording that is cut gives every scan before the cut, then [`RecordingError::Cut`].
//! - Numbers are what the file says: ranges bit by bit, f32 geometry widened to f64, the stamp of
//!   the message's header (first beam). Nothing is filtered, sorted or repaired: that is the
//!   laser's work. Decimal text is rounded once, to the f32 that a recording holds, so that a log and
//!   its import give the same numbers; codes that a log holds instead of ranges become what they mean.
//! - The files of others are never written to or locked.
//!
//! | where | what |
//! |---|---|
//! | `format` | which kind of file is it; words for kinds that are not read |
//! | `parts`, `part` | the files of a recording, the reader of each |
//! | `bag`, `bag_v1`, `mcap_file`, `db3` | the containers, front to back; `record`: of a bag of either version |
//! | `text`, `carmen`, `player`, `csv`, `columns` | logs of lines; `number`, `sick_codes`: what stands in them |
//! | `laser_scan`, `cursor` | bytes of a message to a scan, ROS 1 and CDR |
//! | `recording` | [`Recording`], the iterator [`Scans`]; `options`: how it is read |
//! | `index`, `extent` | what is in it; how far the echoes reach |
//! | `info`, `intervals`, `mcap_index` | what a recording is, for people |
//! | `ros2` | the messages that we write: definitions, CDR |
//! | `mcap_writer`, `writer`, `csv_writer` | one file while it is written: [`McapWriter`], [`ScanWriter`], [`CsvWriter`] |
//! | `bag_directory`, `bag_metadata` | the files of a session, `metadata.yaml`; what is kept |
//! | `recover`, `facts` | a file that was cut; what a complete one holds; `definitions`: of topics, outside chunks |
//!
//! Left out, each named when it is met with what to do: MRPT rawlogs, network captures (pcap, pcapng,
//! JSON of Wireshark), ROS bags before 1.2, Player logs of other file versions, files packed with zstd,
//! bzip2 or zip, Player scans with a bearing for every beam, messages that rosbag2 compressed one by
//! one; and intensities.

mod bag;
mod bag_directory;
mod bag_metadata;
mod bag_v1;
mod carmen;
mod columns;
mod csv;
mod csv_writer;
mod cursor;
mod db3;
mod definitions;
mod error;
mod extent;
mod facts;
mod format;
mod index;
mod info;
mod intervals;
mod laser_scan;
mod mcap_file;
mod mcap_index;
mod mcap_records;
mod mcap_writer;
mod number;
mod options;
mod part;
mod parts;
mod player;
mod record;
mod recording;
mod recover;
pub mod ros2;
mod section;
mod sick_codes;
mod stream;
mod text;
mod unpack;
mod writer;

pub use bag_directory::{BagDirectory, Kept, RecordedFile, to_remove};
pub use columns::ColumnMap;
pub use csv_writer::CsvWriter;
pub use error::RecordingError;
pub use extent::{Extent, ExtentError, MARGIN_M, TAIL_SHARE};
pub use facts::{Attached, attachment, file_facts};
pub use format::Format;
pub use index::{GAP_NS, RecordingIndex, TopicSummary};
pub use info::{OtherTopic, RecordingInfo, Sample, TopicInfo};
pub use mcap_writer::{
    ACTIVE_SUFFIX, FileFacts, McapWriter, Place, TopicFacts, TopicSpec, WrittenFile, active_path,
};
pub use options::{Echo, ReadOptions};
pub use recording::{RecordedScan, Recording, Scans};
pub use recover::{Recovered, recover};
pub use writer::{ScanTopic, ScanWriter, as_recorded, encode_scan};
