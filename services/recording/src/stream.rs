//! What the two containers have in common: the topics met so far, a message, an end.

use crate::laser_scan::MESSAGE_BYTES_MAX;
use std::collections::BTreeMap;
use std::io::{self, Read};
use std::sync::Arc;

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
    pub fn scan_topic(&mut self, name: &str) -> usize {
        let known = self.scan_topics.iter().position(|topic| &**topic == name);
        known.unwrap_or_else(|| {
            self.scan_topics.push(name.into());
            self.scan_topics.len() - 1
        })
    }

    /// Notes a topic that has no scans.
    pub fn other(&mut self, name: &str, message_type: String) {
        self.others.insert(name.to_owned(), message_type);
    }
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
}

impl Raw {
    /// Reads a message of `length` bytes, or nothing if it is longer than any scan.
    pub fn read(&mut self, reader: &mut impl Read, length: u64) -> io::Result<()> {
        self.bytes.clear();
        self.length = length;
        if length <= MESSAGE_BYTES_MAX as u64 {
            self.bytes.resize(length as usize, 0);
            reader.read_exact(&mut self.bytes)?;
        }
        Ok(())
    }

    /// True if the message was longer than any scan.
    pub fn is_too_long(&self) -> bool {
        self.length > MESSAGE_BYTES_MAX as u64
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
