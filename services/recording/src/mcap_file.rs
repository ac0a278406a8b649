//! Container of MCAP files (mcap.dev/spec), read from front to back by the crate `mcap`.
//!
//! A scan is a message in CDR of the schema `sensor_msgs/msg/LaserScan`, as ROS 2 and tog write it,
//! or a ROS 1 message of the schema `sensor_msgs/LaserScan` in a converted bag.

use crate::laser_scan::{ROS1_TYPE, Wire};
use crate::section::Section;
use crate::stream::{Channels, Raw, StreamEnd};
use mcap::McapError;
use mcap::io::MessageReader;
use mcap::sans_io::LinearReaderOptions;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Longest record outside of a chunk, and the share of a packed chunk that is held: chunks are a
/// few MiB (4 MiB is the largest preset of rosbag2), attachments may be some tens.
const RECORD_BYTES_MAX: usize = 64 << 20;

/// An MCAP file, front to back.
pub(crate) struct McapReader {
    messages: MessageReader<Counted>,
    position: Arc<AtomicU64>,
    length: u64,
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
        let counted = Counted { reader, position: position.clone() };
        let messages = MessageReader::new_with_options(counted, options);
        Self { messages, position, length, channels: BTreeMap::new() }
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
            let message = match self.messages.next() {
                None => return Ok(None),
                Some(Ok(message)) => message,
                Some(Err(error)) => return Err(self.end(error)),
            };
            let id = message.channel.id;
            let scans = match self.channels.get(&id) {
                Some(known) => *known,
                None => {
                    let offset = self.position();
                    let scans = classify(&message.channel, channels)
                        .map_err(|reason| StreamEnd::Damaged { offset, reason })?;
                    *self.channels.entry(id).or_insert(scans)
                }
            };
            let Some(scans) = scans else { continue };
            raw.log_time_ns = message.log_time;
            let length = message.data.len() as u64;
            if let Err(source) = raw.read(&mut &message.data[..], length) {
                return Err(StreamEnd::Io(source));
            }
            return Ok(Some(scans));
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

fn classify(
    channel: &mcap::Channel<'_>,
    channels: &mut Channels,
) -> Result<Option<(usize, Wire)>, String> {
    let schema = channel.schema.as_ref().map_or("no schema", |schema| schema.name.as_str());
    let wire = match (schema, channel.message_encoding.as_str()) {
        ("sensor_msgs/msg/LaserScan", "cdr") => Wire::Cdr,
        (ROS1_TYPE | "sensor_msgs/msg/LaserScan", "ros1") => Wire::Ros1,
        (schema, encoding) => {
            channels.other(&channel.topic, format!("{schema} in {encoding}"))?;
            return Ok(None);
        }
    };
    Ok(Some((channels.scan_topic(&channel.topic)?, wire)))
}
