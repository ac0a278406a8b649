//! Container of MCAP files (mcap.dev/spec), read from front to back by the crate `mcap`.
//!
//! **Here:** the crate frames and unpacks the records; schemas, channels and messages are parsed by
//! us. Its own parser allocates a string of any length that a record announces (4 GB in a file of
//! 2 kB, found by the fuzzer) before it looks whether the bytes are there.
//!
//! A scan is a message in CDR of the schema `sensor_msgs/msg/LaserScan`, as ROS 2 and tog write it,
//! or a ROS 1 message of the schema `sensor_msgs/LaserScan` in a converted bag.

use crate::cursor::Cursor;
use crate::laser_scan::{ROS1_TYPE, Wire};
use crate::section::Section;
use crate::stream::{Channels, Raw, StreamEnd, check_name};
use mcap::McapError;
use mcap::records::op;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Longest record outside of a chunk, and the share of a packed chunk that is held: chunks are a
/// few MiB (4 MiB is the largest preset of rosbag2), attachments may be some tens.
pub(crate) const RECORD_BYTES_MAX: usize = 64 << 20;

/// An MCAP file, front to back.
pub(crate) struct McapReader {
    source: Counted,
    records: LinearReader,
    position: Arc<AtomicU64>,
    length: u64,
    known: Known,
}

/// Schemas and channels so far; the first definition of a number counts.
#[derive(Default)]
struct Known {
    /// Names by number.
    schemas: BTreeMap<u16, String>,
    /// What a channel carries: index of the scan topic and how it is encoded.
    channels: BTreeMap<u16, Option<(usize, Wire)>>,
}

/// Counts what was read: the place for errors and the progress bar.
struct Counted {
    reader: BufReader<Section>,
    position: Arc<AtomicU64>,
}

impl Read for Counted {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let got = self.reader.read(buffer)?;
        self.position.fetch_add(got as u64, Ordering::Relaxed);
        Ok(got)
    }
}

impl McapReader {
    /// Begins at the begin.
    pub fn new(file: Arc<File>, length: u64) -> Self {
        let position = Arc::new(AtomicU64::new(0));
        let reader = BufReader::with_capacity(64 * 1024, Section::new(file, 0, length));
        let options = LinearReaderOptions::default()
            .with_validate_chunk_crcs(true)
            .with_record_length_limit(RECORD_BYTES_MAX);
        Self {
            source: Counted { reader, position: position.clone() },
            records: LinearReader::new_with_options(options),
            position,
            length,
            known: Known::default(),
        }
    }

    /// Bytes of the file that were passed.
    pub fn position(&self) -> u64 {
        self.position.load(Ordering::Relaxed)
    }

    /// The next message of a scan topic; its body in `raw`. `None` at the end of a complete file.
    pub fn next(
        &mut self,
        channels: &mut Channels,
        raw: &mut Raw,
    ) -> Result<Option<(usize, Wire)>, StreamEnd> {
        loop {
            let want = match self.records.next_event() {
                None => return Ok(None),
                Some(Ok(LinearReadEvent::ReadRequest(want))) => want,
                Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                    let offset = self.position.load(Ordering::Relaxed);
                    let scans = (self.known.take(opcode, data, channels, raw))
                        .map_err(|reason| StreamEnd::Damaged { offset, reason })?;
                    if scans.is_some() {
                        return Ok(scans);
                    }
                    continue;
                }
                Some(Err(error)) => return Err(self.end(error)),
            };
            let got = loop {
                match self.source.read(self.records.insert(want)) {
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    got => break got.map_err(StreamEnd::Io)?,
                }
            };
            self.records.notify_read(got);
        }
    }

    fn end(&self, error: McapError) -> StreamEnd {
        let offset = self.position.load(Ordering::Relaxed);
        let at_end = offset >= self.length;
        match error {
            McapError::Io(source) if source.raw_os_error().is_some() => StreamEnd::Io(source),
            McapError::UnexpectedEof | McapError::UnexpectedEoc if at_end => StreamEnd::Cut {
                offset,
                reason: "the file ends before its footer (a copy broke off, or the recorder was \
                         killed)"
                    .to_owned(),
            },
            error => StreamEnd::Damaged { offset, reason: words(&error) },
        }
    }
}

/// An error of the library with its cause.
pub(crate) fn words(error: &McapError) -> String {
    match std::error::Error::source(error) {
        Some(cause) => format!("{error}: {cause}"),
        None => error.to_string(),
    }
}

impl Known {
    /// Takes a record: the scan topic and the encoding if it is a scan, left in `raw`.
    fn take(
        &mut self,
        opcode: u8,
        data: &[u8],
        channels: &mut Channels,
        raw: &mut Raw,
    ) -> Result<Option<(usize, Wire)>, String> {
        let mut cursor = Cursor::packed(data);
        match opcode {
            op::SCHEMA => {
                let id = cursor.u16("the number of a schema")?;
                let name = cursor.string("the name of a schema")?;
                check_name(&name)?;
                self.schemas.entry(id).or_insert_with(|| name.into_owned());
            }
            op::CHANNEL => {
                let id = cursor.u16("the number of a channel")?;
                if !self.channels.contains_key(&id) {
                    let scans = self.classify(cursor, channels)?;
                    self.channels.insert(id, scans);
                }
            }
            op::MESSAGE => {
                let id = cursor.u16("the channel of a message")?;
                let Some(scans) = self.channels.get(&id) else {
                    return Err(format!("a message of the unknown channel {id}"));
                };
                if scans.is_none() {
                    return Ok(None);
                }
                cursor.u32("the number of a message")?;
                raw.log_time_ns = cursor.u64("the log time of a message")?;
                cursor.u64("the publish time of a message")?;
                raw.copy(cursor.rest());
                return Ok(*scans);
            }
            _ => {}
        }
        Ok(None)
    }

    /// What a channel carries, from its record behind its number.
    fn classify(
        &self,
        mut record: Cursor<'_>,
        channels: &mut Channels,
    ) -> Result<Option<(usize, Wire)>, String> {
        let schema = record.u16("the schema of a channel")?;
        let topic = record.string("the topic of a channel")?;
        let encoding = record.string("the encoding of a channel")?;
        let schema = match schema {
            0 => "no schema",
            id => self.schemas.get(&id).ok_or(format!("a channel of the unknown schema {id}"))?,
        };
        let wire = match (schema, &*encoding) {
            ("sensor_msgs/msg/LaserScan", "cdr") => Wire::Cdr,
            (ROS1_TYPE | "sensor_msgs/msg/LaserScan", "ros1") => Wire::Ros1,
            (schema, encoding) => {
                channels.other(&topic, format!("{schema} in {encoding}"))?;
                return Ok(None);
            }
        };
        Ok(Some((channels.scan_topic(&topic)?, wire)))
    }
}
