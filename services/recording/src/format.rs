//! Which kind of file is this? By content, never by the name.

use crate::csv;
use crate::error::RecordingError;
use crate::options::ReadOptions;
use crate::section::Section;
use crate::{carmen, player};
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

/// A kind of recording that is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// ROS 1 bag, version 2.0 (since 2010).
    Ros1Bag,
    /// ROS 1 bag, version 1.2 (2009 and 2010).
    Ros1BagV1,
    /// MCAP, as ROS 2 and tog write it.
    Mcap,
    /// ROS 2 bag in SQLite (`.db3`), as ROS 2 wrote it until 2023.
    Ros2Db3,
    /// CARMEN log, plain or packed with gzip.
    Carmen,
    /// Log of Player's `writelog`, plain or packed with gzip.
    Player,
    /// CSV with declared columns, plain or packed with gzip.
    Csv,
}

impl Format {
    /// As a person calls it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ros1Bag => "ROS 1 bag 2.0",
            Self::Ros1BagV1 => "ROS 1 bag 1.2",
            Self::Mcap => "MCAP",
            Self::Ros2Db3 => "ROS 2 bag (SQLite)",
            Self::Carmen => "CARMEN log",
            Self::Player => "Player log",
            Self::Csv => "CSV",
        }
    }
}

/// What a file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Kind {
    pub format: Format,
    pub is_gzip: bool,
}

/// First line of a ROS 1 bag of version 2.0.
pub(crate) const ROS1_MAGIC: &[u8] = b"#ROSBAG V2.0\n";
/// First line of a ROS 1 bag of version 1.2.
pub(crate) const ROS1_V1_MAGIC: &[u8] = b"#ROSRECORD V1.2\n";
/// First bytes of an MCAP file.
pub(crate) const MCAP_MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// First bytes of an SQLite file.
const SQLITE_MAGIC: &[u8] = b"SQLite format 3\0";
const GZIP_MAGIC: &[u8] = b"\x1f\x8b";
/// The formats that are told by their first bytes.
const MAGICS: [(&[u8], Format); 4] = [
    (ROS1_MAGIC, Format::Ros1Bag),
    (ROS1_V1_MAGIC, Format::Ros1BagV1),
    (MCAP_MAGIC, Format::Mcap),
    (SQLITE_MAGIC, Format::Ros2Db3),
];
/// Enough for the first line of a CSV with 4096 named ranges, and for the comments of a log.
const HEAD_BYTES: u64 = 128 * 1024;

const UNPACK_ADVICE: &str = "unpack it first and name the file that comes out";
const COPY_ADVICE: &str = "was it copied completely?";

/// Foreign formats: first bytes, name, advice. The longer of two that agree comes first.
const FOREIGN: &[(&[u8], &str, &str)] = &[
    (b"#ROSRECORD V", "a ROS bag older than version 1.2", OLD_ADVICE),
    (b"#ROSLOG V", "a ROS bag older than version 1.2", OLD_ADVICE),
    (b"#ROSBAG V", "a ROS bag of a version other than 2.0", OLD_ADVICE),
    (b"\x28\xb5\x2f\xfd", "a zstd file", UNPACK_ADVICE),
    (b"BZh", "a bzip2 file", UNPACK_ADVICE),
    (b"PK\x03\x04", "a zip file", UNPACK_ADVICE),
    (b"\x0a\x0d\x0d\x0a", "a network capture (pcapng)", CAPTURE_ADVICE),
    (b"\xd4\xc3\xb2\xa1", "a network capture (pcap)", CAPTURE_ADVICE),
    (b"\xa1\xb2\xc3\xd4", "a network capture (pcap)", CAPTURE_ADVICE),
    (b"\x4d\x3c\xb2\xa1", "a network capture (pcap)", CAPTURE_ADVICE),
    (b"RIFF", "a RIFF file (sound or pictures)", "is it the file that you meant?"),
];
const OLD_ADVICE: &str = "convert it on a machine with ROS 1: `rosbag fix old.bag new.bag`";
const CAPTURE_ADVICE: &str = "it holds the telegrams of a device, not scans: record the scans of the \
                              device's driver instead (`ros2 bag record -s mcap /scan`)";
const JSON_ADVICE: &str = "exported text is not replayed; name the recording it was made from";
const CAPTURE_TEXT_ADVICE: &str = "it holds the telegrams of a device as Wireshark prints them, not \
                                   scans: record the scans of the device's driver instead";
const MRPT_ADVICE: &str = "convert it with MRPT (`rawlog2rosbag`, or `rawlog-edit --export-2d-scans-txt` \
                           and a CSV)";
const CSV_ADVICE: &str = "if it is a CSV, say what its columns are with --columns (see `tog bag import \
                          --help`)";
const PLAYER_ADVICE: &str = "replay it with the Player of its time and write it again, or convert it to \
                             a CSV";

/// Tells the format of an open file by its first bytes.
pub(crate) fn detect(
    path: &Path,
    file: &Arc<File>,
    options: &ReadOptions,
) -> Result<Kind, RecordingError> {
    let io = |source| RecordingError::Io { path: path.to_owned(), action: "read", source };
    let mut head = Vec::new();
    let section = Section::new(file.clone(), 0, HEAD_BYTES);
    section.take(HEAD_BYTES).read_to_end(&mut head).map_err(io)?;
    let is_gzip = head.starts_with(GZIP_MAGIC);
    if is_gzip {
        let packed = Section::new(file.clone(), 0, u64::MAX);
        let mut unpacked = Vec::new();
        let mut reader = flate2::read::MultiGzDecoder::new(packed).take(HEAD_BYTES);
        // What comes before a fault is enough to tell the kind; the reader tells the fault.
        let _ = reader.read_to_end(&mut unpacked);
        head = unpacked;
    } else if let Some((_, format)) = MAGICS.iter().find(|(magic, _)| head.starts_with(magic)) {
        return Ok(Kind { format: *format, is_gzip });
    }
    if let Some(format) = text_format(&head, options) {
        return Ok(Kind { format, is_gzip });
    }
    let (mut found, mut advice) = foreign(&head);
    if is_gzip && MAGICS.iter().any(|(magic, _)| head.starts_with(magic)) {
        (found, advice) = ("a gzip file with a recording in it".to_owned(), UNPACK_ADVICE);
    } else if is_gzip && !found.starts_with("an MRPT") {
        (found, advice) = (format!("a gzip file that holds {found}"), advice);
    }
    Err(RecordingError::Foreign { path: path.to_owned(), found, advice })
}

/// The lines of the begin of a text; none if it is no text.
fn lines(head: &[u8]) -> impl Iterator<Item = &str> {
    let is_text = !head.contains(&0);
    let lines = head.split(|byte| *byte == b'\n').filter(move |_| is_text);
    lines.map_while(|line| std::str::from_utf8(line).ok())
}

fn text_format(head: &[u8], options: &ReadOptions) -> Option<Format> {
    if head.starts_with(player::MAGIC.as_bytes()) {
        let version = lines(head).find_map(|line| line.strip_prefix(player::VERSION));
        let is_read = version.is_some_and(|version| version.starts_with(player::VERSION_READ));
        return is_read.then_some(Format::Player);
    }
    if lines(head).take(1000).any(carmen::is_line) {
        return Some(Format::Carmen);
    }
    let mut rows = lines(head).filter(|line| !line.starts_with('#') && !line.trim().is_empty());
    let first = rows.next()?;
    let is_csv = csv::declared(first).is_some()
        || (options.columns.is_some() && !first.starts_with(['{', '[', '<']));
    is_csv.then_some(Format::Csv)
}

fn foreign(head: &[u8]) -> (String, &'static str) {
    if head.is_empty() {
        return ("an empty file".to_owned(), COPY_ADVICE);
    }
    if MAGICS.iter().any(|(magic, _)| magic.starts_with(head)) {
        return (format!("cut after {} bytes", head.len()), COPY_ADVICE);
    }
    for (magic, name, advice) in FOREIGN {
        if head.starts_with(magic) {
            return ((*name).to_owned(), advice);
        }
    }
    // MRPT begins every object with 0x80 + length of its class's name, and the name.
    let classes: [&[u8]; 4] = [b"CAction", b"CSensoryFrame", b"CObservation", b"mrpt::"];
    let name = &head[1..head.len().min(8)];
    if head[0] >= 0x80 && classes.iter().any(|class| name.starts_with(&class[..class.len().min(7)]))
    {
        return ("an MRPT rawlog".to_owned(), MRPT_ADVICE);
    }
    if head.starts_with(player::MAGIC.as_bytes()) {
        return ("a Player log of a file version other than 0.3".to_owned(), PLAYER_ADVICE);
    }
    if matches!(head.trim_ascii_start().first(), Some(b'{' | b'[')) {
        let is_capture = head.windows(8).any(|part| part == b"\"_source");
        return if is_capture {
            ("a network capture as JSON (Wireshark)".to_owned(), CAPTURE_TEXT_ADVICE)
        } else {
            ("a JSON text".to_owned(), JSON_ADVICE)
        };
    }
    let shown = head[..head.len().min(12)].escape_ascii();
    let is_text = lines(head).next().is_some();
    let advice = if is_text && head.contains(&b'\n') {
        CSV_ADVICE
    } else {
        "is it the file that you meant?"
    };
    (format!("a file that begins with \"{shown}\""), advice)
}
