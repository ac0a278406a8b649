//! What can be wrong with a recording, in words.

use std::io;
use std::path::PathBuf;

/// Why a recording, or a part of it, cannot be read or written.
///
/// While scans are read, [`RecordingError::ends_the_stream`] tells a single bad message (reading
/// goes on behind it) from the end of what can be read.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file cannot be opened or read.
    #[error("{}: cannot {action} the recording: {source}", path.display())]
    Io {
        /// The recording.
        path: PathBuf,
        /// "open", "read", "write", ...
        action: &'static str,
        /// What the operating system says.
        source: io::Error,
    },
    /// A directory that is no ROS 2 bag.
    #[error(
        "{}: is a directory {reason}, expected a file or the directory of a ROS 2 bag: name the \
         recording in it",
        path.display()
    )]
    Directory {
        /// What was named.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A file of another kind.
    #[error(
        "{}: is {found}, expected MCAP, a ROS 1 bag (V2.0 or V1.2), a ROS 2 bag, a CARMEN or Player \
         log, or a CSV with declared columns: {advice}",
        path.display()
    )]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What it is.
        found: String,
        /// What to do.
        advice: &'static str,
    },
    /// Only MCAP is recovered.
    #[error("{}: is {found}, expected an MCAP file that was cut: {advice}", path.display())]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// What it is.
        found: String,
        /// What to do.
        advice: &'static str,
    },
    /// The file ends before its end: a copy that broke off, or a recorder that was killed.
    /// Everything before was delivered.
    #[error(
        "{}: the recording is cut at byte {offset}, after {scans} scans: {reason}; \
         everything before the cut was read",
        path.display()
    )]
    Cut {
        /// The recording.
        path: PathBuf,
        /// Where the file ends or where the unreadable part begins.
        offset: u64,
        /// Scans that were delivered before.
        scans: u64,
        /// What was found and what was expected.
        reason: String,
    },
    /// Bytes in the middle of the file are not what they should be. Everything before was
    /// delivered.
    #[error(
        "{}: the recording is damaged near byte {offset}, after {scans} scans: {reason}; \
         everything before was read, nothing behind it",
        path.display()
    )]
    Damaged {
        /// The recording.
        path: PathBuf,
        /// About where.
        offset: u64,
        /// Scans that were delivered before.
        scans: u64,
        /// What was found and what was expected.
        reason: String,
    },
    /// One message is no good; the next may be.
    #[error("{}: message {number} of topic {topic} is refused: {reason}", path.display())]
    Message {
        /// The recording.
        path: PathBuf,
        /// Its topic.
        topic: String,
        /// Number of the message on its topic, from 1.
        number: u64,
        /// What was found and what was expected.
        reason: String,
    },
    /// A recording without a single scan.
    #[error("{}: holds no laser scans: {found}", path.display())]
    NoScans {
        /// The recording.
        path: PathBuf,
        /// What it holds.
        found: String,
    },
    /// The topic that was asked for is not there.
    #[error(
        "{}: has no scans on topic {topic}; topics with scans: {topics}",
        path.display()
    )]
    NoSuchTopic {
        /// The recording.
        path: PathBuf,
        /// What was asked for.
        topic: String,
        /// What is there.
        topics: String,
    },
    /// Several topics, and none was asked for.
    #[error(
        "{}: has scans on several topics, say which one with `topic`: {topics}",
        path.display()
    )]
    SeveralTopics {
        /// The recording.
        path: PathBuf,
        /// What is there.
        topics: String,
    },
    /// The library that writes MCAP refused.
    #[error("{}: cannot write the recording: {reason}", path.display())]
    Write {
        /// The recording.
        path: PathBuf,
        /// What it said.
        reason: String,
    },
}

impl RecordingError {
    /// True if nothing follows this error; false if only one message was refused.
    #[must_use]
    pub fn ends_the_stream(&self) -> bool {
        !matches!(self, Self::Message { .. })
    }

    /// True if the recording ended early but everything before was delivered.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        matches!(self, Self::Cut { .. })
    }
}
