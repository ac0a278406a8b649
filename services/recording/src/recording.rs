//! A recording and the stream of its scans.

use crate::bag::BagReader;
use crate::bag_v1::BagV1Reader;
use crate::error::RecordingError;
use crate::format::{Format, detect};
use crate::laser_scan::{Wire, decode};
use crate::mcap_file::McapReader;
use crate::stream::{Channels, Raw, StreamEnd};
use protocol::scan::LaserScan;
use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A recording that can be read, any number of times.
#[derive(Debug, Clone)]
pub struct Recording {
    path: PathBuf,
    file: Arc<File>,
    length: u64,
    format: Format,
}

impl Recording {
    /// Opens a recording; the format is told by the content.
    ///
    /// # Errors
    /// [`RecordingError::Io`] (missing, no permission), `Directory`, or `Foreign` with what the
    /// file is.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RecordingError> {
        let path = path.as_ref();
        let io = |source| RecordingError::Io { path: path.to_owned(), action: "open", source };
        // Looked at before it is opened: opening a pipe that nobody writes to would wait for ever.
        let metadata = std::fs::metadata(path).map_err(io)?;
        if metadata.is_dir() {
            return Err(RecordingError::Directory { path: path.to_owned() });
        }
        if !metadata.is_file() {
            return Err(io(io::Error::new(
                io::ErrorKind::InvalidInput,
                "found a device or a pipe, expected a file",
            )));
        }
        let file = File::open(path).map_err(io)?;
        let format = detect(path, &file)?;
        Ok(Self { path: path.to_owned(), file: Arc::new(file), length: metadata.len(), format })
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What it is.
    #[must_use]
    pub fn format(&self) -> Format {
        self.format
    }

    /// Length of the file, bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.length
    }

    /// Picks the topic of one laser: the one that is named, or the only one with scans. A named
    /// topic is looked for up to its first message; without a name the whole file is looked
    /// through.
    ///
    /// # Errors
    /// No scans at all, no such topic, or several and none was named; the error lists what is
    /// there. A cut or damaged recording is an error only if nothing was found before.
    pub fn select_topic(&self, name: Option<&str>) -> Result<Arc<str>, RecordingError> {
        let mut scans = self.scans();
        let mut found: Vec<Arc<str>> = Vec::new();
        let mut early_end = None;
        while let Some(item) = scans.read_raw().transpose() {
            match item {
                Ok((topic_index, _)) => {
                    let topic = &scans.channels.scan_topics[topic_index];
                    if name == Some(&**topic) {
                        return Ok(topic.clone());
                    }
                    if !found.contains(topic) {
                        found.push(topic.clone());
                    }
                }
                Err(error) => {
                    early_end = Some(error);
                    break;
                }
            }
        }
        let path = self.path.clone();
        match (name, &found[..]) {
            (_, []) => Err(early_end.unwrap_or_else(|| scans.no_scans())),
            (None, [only]) => Ok(only.clone()),
            (None, several) => {
                Err(RecordingError::SeveralTopics { path, topics: several.join(", ") })
            }
            (Some(name), others) => {
                let (topic, topics) = (name.to_owned(), others.join(", "));
                Err(RecordingError::NoSuchTopic { path, topic, topics })
            }
        }
    }

    /// The scans in the order of the file, from the first; memory is one message and one buffer.
    #[must_use]
    pub fn scans(&self) -> Scans {
        let reader = match self.format {
            Format::Ros1Bag => Reader::Bag(BagReader::new(self.file.clone(), self.length)),
            Format::Ros1BagV1 => Reader::BagV1(BagV1Reader::new(self.file.clone(), self.length)),
            Format::Mcap => Reader::Mcap(Box::new(McapReader::new(self.file.clone(), self.length))),
        };
        Scans {
            path: self.path.clone(),
            reader,
            channels: Channels::default(),
            raw: Raw::default(),
            only: None,
            messages: Vec::new(),
            delivered: 0,
            is_over: false,
        }
    }

    /// The scans of one topic; those of the others are passed without a look.
    #[must_use]
    pub fn scans_of(&self, topic: &str) -> Scans {
        Scans { only: Some(topic.into()), ..self.scans() }
    }
}

/// A scan and where it stood.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedScan {
    /// Index into [`Scans::topics`].
    pub topic_index: usize,
    /// Its topic.
    pub topic: Arc<str>,
    /// Number of the message on its topic, from 1.
    pub number: u64,
    /// When it was recorded, UNIX nanoseconds.
    pub log_time_ns: u64,
    /// The scan; `stamp_ns` is the stamp of its header, or the log time if that is 0.
    pub scan: LaserScan,
}

enum Reader {
    Bag(BagReader),
    BagV1(BagV1Reader),
    Mcap(Box<McapReader>),
}

/// The scans of a recording: an iterator that ends at the end of the file, or behind the first
/// error for which [`RecordingError::ends_the_stream`] holds.
pub struct Scans {
    path: PathBuf,
    reader: Reader,
    channels: Channels,
    raw: Raw,
    /// Deliver this topic only.
    only: Option<Arc<str>>,
    /// Messages so far, per scan topic.
    messages: Vec<u64>,
    delivered: u64,
    is_over: bool,
}

impl Scans {
    /// Topics with scans that were met so far, in the order in which the file introduces them.
    #[must_use]
    pub fn topics(&self) -> &[Arc<str>] {
        &self.channels.scan_topics
    }

    /// Other topics that were met so far, and the type of their messages.
    #[must_use]
    pub fn other_topics(&self) -> &BTreeMap<String, String> {
        &self.channels.others
    }

    /// Bytes of the file that were passed, for a progress bar.
    #[must_use]
    pub fn position_bytes(&self) -> u64 {
        match &self.reader {
            Reader::Bag(reader) => reader.position(),
            Reader::BagV1(reader) => reader.position(),
            Reader::Mcap(reader) => reader.position(),
        }
    }

    /// What to say if the recording has been read and no topic had scans.
    #[must_use]
    pub fn no_scans(&self) -> RecordingError {
        let found = if self.channels.others.is_empty() {
            "it is empty".to_owned()
        } else {
            // A recording of a robot has hundreds of topics; a dozen tell what it is.
            let mut topics: Vec<String> = (self.channels.others.iter().take(12))
                .map(|(topic, message_type)| format!("{topic} ({message_type})"))
                .collect();
            let more = self.channels.others.len() - topics.len();
            if more > 0 {
                topics.push(format!("and {more} more"));
            }
            format!("found the topics {}", topics.join(", "))
        };
        RecordingError::NoScans { path: self.path.clone(), found }
    }

    /// The next message of a scan topic, left in `raw`: index of its topic and its encoding.
    fn read_raw(&mut self) -> Result<Option<(usize, Wire)>, RecordingError> {
        let (channels, raw) = (&mut self.channels, &mut self.raw);
        let ros1 = |topic: Option<usize>| topic.map(|topic| (topic, Wire::Ros1));
        let next = match &mut self.reader {
            Reader::Bag(reader) => reader.next(channels, raw).map(ros1),
            Reader::BagV1(reader) => reader.next(channels, raw).map(ros1),
            Reader::Mcap(reader) => reader.next(channels, raw),
        };
        self.is_over = !matches!(next, Ok(Some(_)));
        next.map_err(|end| self.end(end))
    }

    fn read(&mut self) -> Result<Option<RecordedScan>, RecordingError> {
        let (topic_index, wire) = loop {
            let Some((topic_index, wire)) = self.read_raw()? else { return Ok(None) };
            self.messages.resize(self.channels.scan_topics.len(), 0);
            self.messages[topic_index] += 1;
            let topic = &self.channels.scan_topics[topic_index];
            if self.only.as_ref().is_none_or(|only| only == topic) {
                break (topic_index, wire);
            }
        };
        let number = self.messages[topic_index];
        let topic = self.channels.scan_topics[topic_index].clone();
        let log_time_ns = self.raw.log_time_ns;
        let decoded = if self.raw.is_too_long() {
            Err(format!("{} bytes, longer than any scan", self.raw.length))
        } else {
            decode(&self.raw.bytes, wire, log_time_ns)
        };
        match decoded {
            Ok(scan) => {
                self.delivered += 1;
                Ok(Some(RecordedScan { topic_index, topic, number, log_time_ns, scan }))
            }
            Err(reason) => Err(RecordingError::Message {
                path: self.path.clone(),
                topic: topic.to_string(),
                number,
                reason,
            }),
        }
    }

    fn end(&self, end: StreamEnd) -> RecordingError {
        let (path, scans) = (self.path.clone(), self.delivered);
        match end {
            StreamEnd::Cut { offset, reason } => {
                RecordingError::Cut { path, offset, scans, reason }
            }
            StreamEnd::Damaged { offset, reason } => {
                RecordingError::Damaged { path, offset, scans, reason }
            }
            StreamEnd::Io(source) => RecordingError::Io { path, action: "read", source },
        }
    }
}

impl Iterator for Scans {
    type Item = Result<RecordedScan, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.is_over {
            return None;
        }
        self.read().transpose()
    }
}
