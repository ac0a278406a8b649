//! A recording and the stream of its scans.

use crate::error::RecordingError;
use crate::format::Format;
use crate::laser_scan::{Wire, decode};
use crate::options::ReadOptions;
use crate::part::{Part, Reader};
use crate::parts;
use crate::stream::{Channels, Raw, StreamEnd};
use protocol::scan::LaserScan;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A recording that can be read, any number of times.
#[derive(Debug, Clone)]
pub struct Recording {
    path: PathBuf,
    /// Never empty.
    parts: Vec<Part>,
    options: ReadOptions,
}

impl Recording {
    /// Opens a recording, a file or the directory of a ROS 2 bag; the format is told by the content.
    ///
    /// # Errors
    /// [`RecordingError::Io`] (missing, no permission), `Directory`, or `Foreign` with what the
    /// file is.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RecordingError> {
        Self::open_with(path, ReadOptions::default())
    }

    /// As [`Recording::open`], for recordings that do not say everything themselves.
    ///
    /// # Errors
    /// As [`Recording::open`].
    pub fn open_with(path: impl AsRef<Path>, options: ReadOptions) -> Result<Self, RecordingError> {
        let path = path.as_ref();
        let files = if path.is_dir() { parts::files_of(path)? } else { vec![path.to_owned()] };
        let parts = files.iter().map(|file| Part::open(file, &options));
        let parts = parts.collect::<Result<Vec<_>, _>>()?;
        Ok(Self { path: path.to_owned(), parts, options })
    }
}

impl Recording {
    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The first of its files.
    #[must_use]
    pub fn first_file(&self) -> &Path {
        self.parts.first().map_or(&self.path, |part| &part.path)
    }

    /// What it is.
    #[must_use]
    pub fn format(&self) -> Format {
        self.parts.first().map_or(Format::Mcap, |part| part.kind.format)
    }

    /// Length of all its files, bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.parts.iter().map(|part| part.length).sum()
    }

    /// How it is read.
    pub(crate) fn options(&self) -> &ReadOptions {
        &self.options
    }

    /// Its files in order.
    pub(crate) fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// How many files it has.
    #[must_use]
    pub fn files(&self) -> usize {
        self.parts.len()
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
        Scans {
            parts: self.parts.clone(),
            options: self.options.clone(),
            part: 0,
            reader: None,
            frame_ids: Vec::new(),
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
    /// Name of the laser's coordinates; empty if the recording does not say.
    pub frame_id: Arc<str>,
    /// Time of one turn of the mirror, seconds; 0 if unknown.
    pub scan_time_s: f32,
    /// The scan; `stamp_ns` is the stamp of its header, or the log time if that is 0.
    pub scan: LaserScan,
}

/// The scans of a recording: an iterator that ends at the end of the file, or behind the first
/// error for which [`RecordingError::ends_the_stream`] holds.
pub struct Scans {
    /// Never empty.
    parts: Vec<Part>,
    options: ReadOptions,
    /// The part that is being read, and its reader once it was opened.
    part: usize,
    reader: Option<Reader>,
    /// Name of the coordinates, per scan topic, as last met.
    frame_ids: Vec<Arc<str>>,
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

    /// The topics that were met.
    pub(crate) fn into_channels(self) -> Channels {
        self.channels
    }

    /// Bytes of the recording that were passed, for a progress bar.
    #[must_use]
    pub fn position_bytes(&self) -> u64 {
        let before: u64 = self.parts.iter().take(self.part).map(|part| part.length).sum();
        before + self.reader.as_ref().map_or(0, Reader::position)
    }

    /// The file that is being read.
    fn path(&self) -> PathBuf {
        self.parts
            .get(self.part)
            .or(self.parts.last())
            .map(|part| part.path.clone())
            .unwrap_or_default()
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
        RecordingError::NoScans { path: self.path(), found }
    }

    /// The next message of a scan topic, left in `raw`: index of its topic and its encoding.
    fn read_raw(&mut self) -> Result<Option<(usize, Wire)>, RecordingError> {
        while let Some(part) = self.parts.get(self.part) {
            let reader = self.reader.get_or_insert_with(|| part.reader(&self.options));
            match reader.next(&mut self.channels, &mut self.raw) {
                Ok(None) => {
                    self.part += 1;
                    self.reader = None;
                }
                Ok(found) => return Ok(found),
                Err(end) => {
                    self.is_over = true;
                    return Err(self.end(end));
                }
            }
        }
        self.is_over = true;
        Ok(None)
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
        let decoded = match &self.reader {
            _ if self.raw.is_too_long => {
                Err(format!("{} bytes, longer than any scan", self.raw.length))
            }
            Some(Reader::Text(reader)) => reader.decode(&self.raw),
            _ => decode(&self.raw.bytes, wire, log_time_ns, self.options.echo),
        };
        match decoded {
            Ok(decoded) => {
                self.delivered += 1;
                self.frame_ids.resize(self.channels.scan_topics.len(), "".into());
                let frame_id = &mut self.frame_ids[topic_index];
                if **frame_id != *decoded.frame_id {
                    *frame_id = decoded.frame_id.as_ref().into();
                }
                Ok(Some(RecordedScan {
                    topic_index,
                    topic,
                    number,
                    log_time_ns: decoded.log_time_ns.unwrap_or(log_time_ns),
                    frame_id: frame_id.clone(),
                    scan_time_s: decoded.scan_time_s,
                    scan: decoded.scan,
                }))
            }
            Err(reason) => Err(RecordingError::Message {
                path: self.path(),
                topic: topic.to_string(),
                number,
                reason,
            }),
        }
    }

    fn end(&self, end: StreamEnd) -> RecordingError {
        let (path, scans) = (self.path(), self.delivered);
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
