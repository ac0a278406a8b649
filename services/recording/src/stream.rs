//! What the containers have in common: the topics met so far, a message, an end.

use crate::laser_scan::{ROS1_ECHO_MD5, ROS1_ECHO_TYPE, ROS1_MD5, ROS1_TYPE, Wire};
use std::collections::BTreeMap;
use std::io::{self, Read};
use std::sync::Arc;

/// Most topics with scans: as many lasers as a site file may have. Every one costs its own counts.
const SCAN_TOPICS_MAX: usize = protocol::site::LASERS_MAX;
/// Longest name of a topic or a type: file systems stop at 255 bytes, namespaces may be nested.
const NAME_BYTES_MAX: usize = 4096;
/// Hexadecimal digits of an MD5; "*" stands for any.
const MD5_CHARS: usize = 32;

/// The topics of a recording, as far as it was read.
#[derive(Debug, Default, Clone)]
pub(crate) struct Channels {
    /// Topics with scans, in the order in which the file introduces them.
    pub scan_topics: Vec<Arc<str>>,
    /// Type of the messages of every other topic.
    pub others: BTreeMap<String, String>,
}

impl Channels {
    /// Index of a scan topic, which is noted if it is new.
    ///
    /// # Errors
    /// A name that is too long, or more scan topics than a recording may have.
    pub fn scan_topic(&mut self, name: &str) -> Result<usize, String> {
        let known = self.scan_topics.iter().position(|topic| &**topic == name);
        if let Some(index) = known {
            return Ok(index);
        }
        check_name(name)?;
        if self.scan_topics.len() >= SCAN_TOPICS_MAX {
            return Err(format!("scans on more than {SCAN_TOPICS_MAX} topics"));
        }
        self.scan_topics.push(name.into());
        Ok(self.scan_topics.len() - 1)
    }

    /// Notes a topic that has no scans.
    ///
    /// # Errors
    /// A name that is too long.
    pub fn other(&mut self, name: &str, message_type: String) -> Result<(), String> {
        check_name(name)?;
        check_name(&message_type)?;
        self.others.insert(name.to_owned(), message_type);
        Ok(())
    }

    /// Notes a topic of a ROS 1 bag by the type of its messages and the MD5 of their definition:
    /// index of the scan topic and how its messages are laid out, or `None` for other messages.
    ///
    /// # Errors
    /// As [`Channels::scan_topic`], or an MD5 that is none.
    pub fn ros1_topic(
        &mut self,
        name: &[u8],
        message_type: &[u8],
        md5: &[u8],
    ) -> Result<Option<(usize, Wire)>, String> {
        if md5.len() > MD5_CHARS {
            return Err(format!("an MD5 of {} characters, expected {MD5_CHARS}", md5.len()));
        }
        let name = String::from_utf8_lossy(name);
        let message_type = String::from_utf8_lossy(message_type).into_owned();
        let (expected, wire) = match &*message_type {
            ROS1_TYPE => (ROS1_MD5, Wire::Ros1),
            ROS1_ECHO_TYPE => (ROS1_ECHO_MD5, Wire::Ros1MultiEcho),
            _ => return self.other(&name, message_type).map(|()| None),
        };
        if md5 == expected.as_bytes() || md5 == b"*" {
            self.scan_topic(&name).map(|topic| Some((topic, wire)))
        } else {
            self.other(&name, format!("{message_type} of another definition")).map(|()| None)
        }
    }
}

/// Refuses a name that is longer than any.
pub(crate) fn check_name(name: &str) -> Result<(), String> {
    let length = name.len();
    if length > NAME_BYTES_MAX {
        return Err(format!("a name of {length} bytes, expected at most {NAME_BYTES_MAX}"));
    }
    Ok(())
}

/// A message of a scan topic, not decoded.
#[derive(Debug, Default)]
pub(crate) struct Raw {
    /// When it was recorded, UNIX nanoseconds.
    pub log_time_ns: u64,
    /// Its bytes; empty if it is longer than any scan.
    pub bytes: Vec<u8>,
    /// Its length.
    pub length: u64,
    /// True if it is longer than any scan.
    pub is_too_long: bool,
}

impl Raw {
    /// Reads a message of `length` bytes, or nothing if it is longer than any scan; how many were
    /// read.
    pub fn read(&mut self, reader: &mut impl Read, length: u64, wire: Wire) -> io::Result<u64> {
        self.begin(length, wire);
        if !self.is_too_long {
            self.bytes.resize(length as usize, 0);
            reader.read_exact(&mut self.bytes)?;
        }
        Ok(self.bytes.len() as u64)
    }

    /// Takes a message, or nothing if it is longer than any scan.
    pub fn copy(&mut self, bytes: &[u8], wire: Wire) {
        self.begin(bytes.len() as u64, wire);
        if !self.is_too_long {
            self.bytes.extend_from_slice(bytes);
        }
    }

    fn begin(&mut self, length: u64, wire: Wire) {
        self.bytes.clear();
        self.length = length;
        self.is_too_long = length > wire.bytes_max() as u64;
    }
}

/// Why a recording cannot be read on.
#[derive(Debug)]
pub(crate) enum StreamEnd {
    /// The file ends too early.
    Cut { offset: u64, reason: String },
    /// The bytes make no sense.
    Damaged { offset: u64, reason: String },
    /// The operating system says no.
    Io(io::Error),
}
