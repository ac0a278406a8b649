//! Container of ROS bags, version 1.2 (wiki.ros.org/Bags/Format/1.2; ROS 0.5 to 1.0, 2009 and
//! 2010), read from front to back.
//!
//! Records are framed as in version 2.0, but there are no chunks and no connections: the header of
//! every message says its topic, type and MD5. An index of every topic follows the last message.
//!
//! **Here:** definitions of messages (record 1) are passed, as every message repeats what they say.
//! A bag that does not begin with a header was written without an index: it is complete where a
//! record ends. One with an index is complete if it counts as many messages as were there.

use crate::format::ROS1_V1_MAGIC;
use crate::laser_scan::Wire;
use crate::record::{
    CONNECTION_BYTES_MAX, CONNECTIONS_MAX, Fault, field, field_op, field_u32, read_begin, sized,
    time_ns,
};
use crate::section::Section;
use crate::stream::{Channels, Raw, StreamEnd};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::sync::Arc;

/// Longest header of a record: that of a definition holds the text of the message and of all its
/// parts.
const HEAD_BYTES_MAX: usize = CONNECTION_BYTES_MAX;

const OP_DEFINITION: u8 = 1;
const OP_MESSAGE: u8 = 2;
const OP_BAG_HEADER: u8 = 3;
const OP_INDEX_DATA: u8 = 4;

/// A bag, front to back.
pub(crate) struct BagV1Reader {
    records: BufReader<Section>,
    length: u64,
    /// Where the next record begins.
    at: u64,
    /// `index_pos` of the bag's header, if it has one; 0 if the bag was never closed.
    index_pos: Option<u64>,
    messages: u64,
    messages_in_index: u64,
    /// Index into the scan topics and layout by topic, type and MD5; `None` for other messages.
    topics: BTreeMap<Vec<u8>, Option<(usize, Wire)>>,
    /// Topic, type and MD5 of the current message.
    key: Vec<u8>,
    head: Vec<u8>,
}

impl BagV1Reader {
    /// Begins at the first record.
    pub fn new(file: Arc<File>, length: u64) -> Self {
        let at = ROS1_V1_MAGIC.len() as u64;
        let records = BufReader::with_capacity(32 * 1024, Section::new(file, at, length));
        Self {
            records,
            length,
            at,
            index_pos: None,
            messages: 0,
            messages_in_index: 0,
            topics: BTreeMap::new(),
            key: Vec::new(),
            head: Vec::new(),
        }
    }

    /// Bytes of the file that were passed.
    pub fn position(&self) -> u64 {
        self.at
    }

    /// The next message of a scan topic; its body in `raw`. `None` at the end of a complete bag.
    pub fn next(
        &mut self,
        channels: &mut Channels,
        raw: &mut Raw,
    ) -> Result<Option<(usize, Wire)>, StreamEnd> {
        while self.at < self.length {
            let offset = self.at;
            let scan_topic =
                self.read_record(channels, raw).map_err(|fault| fault.in_record_at(offset))?;
            if scan_topic.is_some() {
                return Ok(scan_topic);
            }
        }
        self.check_complete().map(|()| None)
    }

    /// One record: the scan topic if it is a scan, left in `raw`. Afterwards `at` is behind it.
    fn read_record(
        &mut self,
        channels: &mut Channels,
        raw: &mut Raw,
    ) -> Result<Option<(usize, Wire)>, Fault> {
        let (mut left, read) = read_begin(&mut self.records, &mut self.head, HEAD_BYTES_MAX)?;
        let end = self.at + read + left;
        if end > self.length {
            return Err(Fault::Short);
        }
        let mut scan_topic = None;
        match field_op(&self.head)? {
            OP_BAG_HEADER if self.at == ROS1_V1_MAGIC.len() as u64 => {
                let index_pos = sized(field(&self.head, b"index_pos")?, b"index_pos")?;
                self.index_pos = Some(u64::from_le_bytes(index_pos));
            }
            OP_MESSAGE => {
                self.messages += 1;
                scan_topic = self.topic(channels)?;
                if let Some((_, wire)) = scan_topic {
                    let seconds = field_u32(&self.head, b"sec")?;
                    raw.log_time_ns = time_ns(seconds, field_u32(&self.head, b"nsec")?);
                    left -= raw.read(&mut self.records, left, wire)?;
                }
            }
            OP_INDEX_DATA => {
                self.messages_in_index += u64::from(field_u32(&self.head, b"count")?);
            }
            OP_DEFINITION => {}
            op => {
                return Err(Fault::Bad(format!(
                    "record kind {op} at byte {}, expected 1, 2 or 4, and 3 at the begin",
                    self.at
                )));
            }
        }
        if io::copy(&mut self.records.by_ref().take(left), &mut io::sink())? < left {
            return Err(Fault::Short);
        }
        self.at = end;
        Ok(scan_topic)
    }

    /// The scan topic of the message whose header is in `head`.
    fn topic(&mut self, channels: &mut Channels) -> Result<Option<(usize, Wire)>, Fault> {
        let topic = field(&self.head, b"topic")?;
        let message_type = field(&self.head, b"type")?;
        let md5 = field(&self.head, b"md5")?;
        self.key.clear();
        for part in [topic, message_type, md5] {
            self.key.extend((part.len() as u32).to_le_bytes());
            self.key.extend_from_slice(part);
        }
        if let Some(known) = self.topics.get(&self.key) {
            return Ok(*known);
        }
        if self.topics.len() >= CONNECTIONS_MAX {
            return Err(Fault::Bad(format!("more than {CONNECTIONS_MAX} topics")));
        }
        let scan_topic = channels.ros1_topic(topic, message_type, md5).map_err(Fault::Bad)?;
        self.topics.insert(self.key.clone(), scan_topic);
        Ok(scan_topic)
    }

    /// At the end of the file: is everything there that the bag's header and its index announce?
    fn check_complete(&self) -> Result<(), StreamEnd> {
        let is_empty = self.at == ROS1_V1_MAGIC.len() as u64;
        let (counted, messages) = (self.messages_in_index, self.messages);
        let reason = match self.index_pos {
            None if is_empty => "the file ends before its first record".to_owned(),
            Some(0) => {
                "the bag was never closed (the recorder was killed): it has no index".to_owned()
            }
            Some(index_pos) if index_pos > self.length => {
                format!("found no index, expected one at byte {index_pos}")
            }
            Some(_) if counted < messages => {
                format!("its index is cut: it counts {counted} messages, expected {messages}")
            }
            _ => return Ok(()),
        };
        Err(StreamEnd::Cut { offset: self.length, reason })
    }
}
