//! Which kind of file is this? By content, never by the name.

use crate::error::RecordingError;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// A kind of recording that is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// ROS 1 bag, version 2.0 (since 2010).
    Ros1Bag,
    /// ROS 1 bag, version 1.2 (2009 and 2010).
    Ros1BagV1,
    /// MCAP, as ROS 2 and tog write it.
    Mcap,
}

/// First line of a ROS 1 bag of version 2.0.
pub(crate) const ROS1_MAGIC: &[u8] = b"#ROSBAG V2.0\n";
/// First line of a ROS 1 bag of version 1.2.
pub(crate) const ROS1_V1_MAGIC: &[u8] = b"#ROSRECORD V1.2\n";
/// First bytes of an MCAP file.
pub(crate) const MCAP_MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// Enough to find a line of a text log behind its comments.
const HEAD_BYTES: u64 = 4096;

const ROS2_ADVICE: &str = "convert it with `ros2 bag convert` to storage_id mcap";
const UNPACK_ADVICE: &str = "unpack it first and name the file that comes out";

/// Foreign formats: first bytes, name, advice. The longer of two that agree comes first.
const FOREIGN: &[(&[u8], &str, &str)] = &[
    (b"#ROSRECORD V", "a ROS bag older than version 1.2", OLD_ADVICE),
    (b"#ROSLOG V", "a ROS bag older than version 1.2", OLD_ADVICE),
    (b"#ROSBAG V", "a ROS bag of a version other than 2.0", OLD_ADVICE),
    (b"SQLite format 3\0", "an SQLite file, perhaps a ROS 2 bag (.db3)", ROS2_ADVICE),
    (b"\x1f\x8b", "a gzip file", UNPACK_ADVICE),
    (b"\x28\xb5\x2f\xfd", "a zstd file", UNPACK_ADVICE),
    (b"BZh", "a bzip2 file", UNPACK_ADVICE),
    (b"PK\x03\x04", "a zip file", UNPACK_ADVICE),
    (b"\x0a\x0d\x0d\x0a", "a network capture (pcapng)", CAPTURE_ADVICE),
    (b"\xd4\xc3\xb2\xa1", "a network capture (pcap)", CAPTURE_ADVICE),
    (b"\xa1\xb2\xc3\xd4", "a network capture (pcap)", CAPTURE_ADVICE),
];
const OLD_ADVICE: &str = "convert it on a machine with ROS 1: `rosbag fix old.bag new.bag`";
const CAPTURE_ADVICE: &str = "telegrams are not replayed; record the scans of the driver instead";
const CARMEN_ADVICE: &str = "CARMEN logs are not replayed; convert it to a ROS 1 bag or to MCAP";
const JSON_ADVICE: &str = "exported text is not replayed; name the recording it was made from";

/// Tells the format of an open file by its first bytes.
pub(crate) fn detect(path: &Path, mut file: &File) -> Result<Format, RecordingError> {
    let mut head = Vec::new();
    file.by_ref().take(HEAD_BYTES).read_to_end(&mut head).map_err(|source| RecordingError::Io {
        path: path.to_owned(),
        action: "read",
        source,
    })?;
    if head.starts_with(ROS1_MAGIC) {
        return Ok(Format::Ros1Bag);
    }
    if head.starts_with(ROS1_V1_MAGIC) {
        return Ok(Format::Ros1BagV1);
    }
    if head.starts_with(MCAP_MAGIC) {
        return Ok(Format::Mcap);
    }
    let (found, advice) = foreign(&head);
    Err(RecordingError::Foreign { path: path.to_owned(), found, advice })
}

fn foreign(head: &[u8]) -> (String, &'static str) {
    const COPY_ADVICE: &str = "was it copied completely?";
    if head.is_empty() {
        return ("an empty file".to_owned(), COPY_ADVICE);
    }
    if [ROS1_MAGIC, ROS1_V1_MAGIC, MCAP_MAGIC].iter().any(|magic| magic.starts_with(head)) {
        return (format!("cut after {} bytes", head.len()), COPY_ADVICE);
    }
    for (magic, name, advice) in FOREIGN {
        if head.starts_with(magic) {
            return ((*name).to_owned(), advice);
        }
    }
    let carmen = ["# message_name", "PARAM ", "FLASER ", "ROBOTLASER1 ", "RAWLASER1 ", "ODOM "];
    let is_carmen = |line: &[u8]| carmen.iter().any(|keyword| line.starts_with(keyword.as_bytes()));
    if head.split(|byte| *byte == b'\n').any(is_carmen) {
        return ("a CARMEN log".to_owned(), CARMEN_ADVICE);
    }
    if matches!(head.trim_ascii_start().first(), Some(b'{' | b'[')) {
        return ("a JSON text".to_owned(), JSON_ADVICE);
    }
    let shown = head[..head.len().min(12)].escape_ascii();
    (format!("a file that begins with \"{shown}\""), "is it the file that you meant?")
}
