//! What a recording is, for people: lasers, rates, gaps, shares.
//!
//! A large MCAP file is answered from its index: counts, rates, gaps and jitter from the log times of
//! all messages, geometry and shares from a sample of chunks. Every other recording is read.

use crate::error::RecordingError;
use crate::extent::silent;
use crate::format::Format;
use crate::intervals::Intervals;
use crate::laser_scan::decode;
use crate::mcap_file::McapReader;
use crate::mcap_index::McapIndex;
use crate::part::Part;
use crate::recording::{RecordedScan, Recording};
use crate::stream::{Channels, Raw};
use protocol::scan::{LaserScan, ScanGeometry};
use protocol::time::SECOND_NS;
use serde::Serialize;

/// Recordings with at most so many messages are read whole: that takes less than half a second.
const READ_WHOLE_MAX: u64 = 20_000;
/// Chunks of the sample, over all files.
const SAMPLE_CHUNKS: usize = 24;

/// What a recording holds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RecordingInfo {
    /// Its path.
    pub path: String,
    /// What it is: "MCAP", "ROS 1 bag 2.0", ...
    pub format: &'static str,
    /// Files.
    pub files: usize,
    /// Length of all files, bytes.
    pub bytes: u64,
    /// First and highest stamp of a scan, UNIX nanoseconds. From the index: log time.
    pub span_ns: Option<(u64, u64)>,
    /// If not every scan was looked at: how many were.
    pub sample: Option<Sample>,
    /// Topics with scans, in the order in which the recording introduces them.
    pub topics: Vec<TopicInfo>,
    /// Other topics by name.
    pub others: Vec<OtherTopic>,
    /// The first message that was refused, in words.
    pub first_refusal: Option<String>,
    /// Why the recording ended early, in words.
    pub early_end: Option<String>,
}

/// What was looked at of a large recording. Rates, gaps and jitter are those of the log times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Sample {
    /// Chunks that were unpacked.
    pub chunks: usize,
    /// Of so many.
    pub of_chunks: usize,
    /// Scans in them.
    pub scans: u64,
}

/// A topic without scans.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct OtherTopic {
    /// Its name.
    pub topic: String,
    /// Type of its messages.
    pub message_type: String,
}

/// A topic with scans: one laser.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TopicInfo {
    /// Its name.
    pub topic: String,
    /// Name of the laser's coordinates, of the first scan.
    pub frame_id: String,
    /// Messages.
    pub scans: u64,
    /// Messages that were refused, of those that were looked at.
    pub refused: u64,
    /// First and highest stamp, UNIX nanoseconds. From the index: log time.
    pub span_ns: Option<(u64, u64)>,
    /// Scans a second, by the median of the intervals; 0 for a single scan.
    pub rate_hz: f64,
    /// What 95 of 100 intervals keep within, of the median, milliseconds.
    pub jitter_ms: f64,
    /// Intervals of more than 2.5 medians.
    pub gaps: u64,
    /// The longest interval, seconds.
    pub longest_gap_s: f64,
    /// Stamps that are not above the highest before.
    pub out_of_order: u64,
    /// Beams of the first scan.
    pub beams: usize,
    /// How the beams of the first scan lie; `None` if none was looked at.
    pub geometry: Option<ScanGeometry>,
    /// Scans whose beams lie otherwise than those of the scan before.
    pub geometry_changes: u64,
    /// Time of one turn as the first scan says, seconds; 0 if it does not.
    pub scan_time_s: f32,
    /// Share of readings that are "no return", 0 to 1.
    pub no_return_share: f64,
    /// Share of readings that are invalid, 0 to 1.
    pub invalid_share: f64,
}

/// A topic while it is looked at.
#[derive(Debug, Default)]
struct Collected {
    frame_id: Option<String>,
    refused: u64,
    intervals: Intervals,
    latest: Option<(ScanGeometry, usize)>,
    first: Option<(ScanGeometry, usize)>,
    geometry_changes: u64,
    scan_time_s: f32,
    readings: u64,
    silent: [u64; 2],
}

impl Collected {
    fn add(&mut self, scan: &LaserScan, frame_id: &str, scan_time_s: f32) {
        if self.frame_id.is_none() {
            self.frame_id = Some(frame_id.to_owned());
            self.scan_time_s = scan_time_s;
        }
        let geometry = Some((scan.geometry, scan.ranges_m.len()));
        self.geometry_changes += u64::from(self.latest.is_some() && self.latest != geometry);
        self.latest = geometry;
        self.first = self.first.or(geometry);
        let [no_return, invalid] = silent(scan);
        self.readings += scan.ranges_m.len() as u64;
        self.silent = [self.silent[0] + no_return, self.silent[1] + invalid];
    }

    fn info(self, topic: &str) -> TopicInfo {
        let intervals = &self.intervals;
        let share = |part: u64| part as f64 / self.readings.max(1) as f64;
        TopicInfo {
            topic: topic.to_owned(),
            frame_id: self.frame_id.unwrap_or_default(),
            scans: intervals.stamps,
            refused: self.refused,
            span_ns: intervals.span_ns,
            rate_hz: intervals.median_ns().map_or(0.0, |median| SECOND_NS as f64 / median),
            jitter_ms: intervals.jitter_ns() / 1e6,
            gaps: intervals.gaps(),
            longest_gap_s: intervals.longest_ns as f64 / SECOND_NS as f64,
            out_of_order: intervals.out_of_order,
            beams: self.first.map_or(0, |(_, beams)| beams),
            geometry: self.first.map(|(geometry, _)| geometry),
            geometry_changes: self.geometry_changes,
            scan_time_s: self.scan_time_s,
            no_return_share: share(self.silent[0]),
            invalid_share: share(self.silent[1]),
        }
    }
}

/// The recording while it is looked at.
#[derive(Default)]
struct Look {
    channels: Channels,
    topics: Vec<Collected>,
    sample: Option<Sample>,
    first_refusal: Option<String>,
    early_end: Option<String>,
}

impl Look {
    fn topic(&mut self, index: usize) -> &mut Collected {
        if self.topics.len() <= index {
            self.topics.resize_with(index + 1, Collected::default);
        }
        &mut self.topics[index]
    }

    /// Reads everything; `tell` hears how many bytes were passed.
    fn whole(recording: &Recording, mut tell: impl FnMut(u64)) -> Result<Self, RecordingError> {
        let mut look = Self::default();
        let mut scans = recording.scans();
        while let Some(item) = scans.next() {
            tell(scans.position_bytes());
            match item {
                Ok(RecordedScan { topic_index, frame_id, scan_time_s, scan, .. }) => {
                    let topic = look.topic(topic_index);
                    topic.intervals.add(scan.stamp_ns);
                    topic.add(&scan, &frame_id, scan_time_s);
                }
                Err(error @ RecordingError::Message { .. }) => {
                    if let RecordingError::Message { topic, .. } = &error {
                        let index = scans.topics().iter().position(|name| **name == **topic);
                        index.into_iter().for_each(|index| look.topic(index).refused += 1);
                    }
                    look.first_refusal.get_or_insert(error.to_string());
                }
                Err(error @ RecordingError::Io { .. }) => return Err(error),
                Err(error) => look.early_end = Some(error.to_string()),
            }
        }
        look.channels = scans.into_channels();
        Ok(look)
    }

    /// Looks at the index and a sample; `None` if the index is not to be trusted, or if the recording
    /// is so small that it may as well be read.
    fn by_index(recording: &Recording) -> std::io::Result<Option<Self>> {
        let mut look = Self::default();
        let mut indexes = Vec::new();
        for part in recording.parts() {
            let index = match part.kind.format {
                Format::Mcap => McapIndex::read(part, &mut look.channels)?,
                _ => None,
            };
            let Some(index) = index else { return Ok(None) };
            indexes.push((part, index));
        }
        if indexes.iter().map(|(_, index)| index.messages).sum::<u64>() <= READ_WHOLE_MAX {
            return Ok(None);
        }
        let of_chunks = indexes.iter().map(|(_, index)| index.chunks.len()).sum();
        let mut sample = Sample { chunks: 0, of_chunks, scans: 0 };
        let each = (SAMPLE_CHUNKS / indexes.len()).max(1);
        for (part, index) in &indexes {
            let times = index.times(part, |topic, time| look.topic(topic).intervals.add(time))?;
            if times != Some(index.messages) {
                return Ok(None);
            }
            for chunk in evenly(index.chunks.len(), each) {
                let bytes = index.chunks[chunk].bytes.clone();
                let known = index.known.clone();
                let chunk = McapReader::of_chunk(part.file.clone(), bytes, each as u64, known);
                sample.chunks += 1;
                match look.chunk(recording, part, chunk) {
                    Some(scans) => sample.scans += scans,
                    None => return Ok(None),
                }
            }
        }
        look.sample = Some(sample);
        Ok(Some(look))
    }

    /// Looks at the scans of a chunk; how many, or `None` if it is damaged.
    fn chunk(&mut self, recording: &Recording, part: &Part, mut chunk: McapReader) -> Option<u64> {
        let mut raw = Raw::default();
        let mut scans = 0;
        let mut channels = std::mem::take(&mut self.channels);
        let whole = loop {
            match chunk.next(&mut channels, &mut raw) {
                Ok(None) => break true,
                Err(_) => break false,
                Ok(Some((topic, wire))) => {
                    let echo = recording.options().echo;
                    match decode(&raw.bytes, wire, raw.log_time_ns, echo) {
                        Ok(found) => {
                            scans += 1;
                            let topic = self.topic(topic);
                            topic.add(&found.scan, &found.frame_id, found.scan_time_s);
                        }
                        Err(reason) => {
                            self.topic(topic).refused += 1;
                            let (path, name) = (part.path.display(), &channels.scan_topics[topic]);
                            let text = format!("{path}: a message of topic {name}: {reason}");
                            self.first_refusal.get_or_insert(text);
                        }
                    }
                }
            }
        };
        self.channels = channels;
        whole.then_some(scans)
    }
}

/// Up to `wanted` of `count` places, the first and the last among them.
fn evenly(count: usize, wanted: usize) -> impl Iterator<Item = usize> {
    let steps = wanted.min(count);
    (0..steps).map(move |step| if steps < 2 { 0 } else { step * (count - 1) / (steps - 1) })
}

impl RecordingInfo {
    /// Looks at a recording. `is_whole`: reads all of it even where the index would do. `tell` hears
    /// how many bytes were passed.
    ///
    /// # Errors
    /// The file cannot be read. What is wrong with its contents is told in the result.
    pub fn look(
        recording: &Recording,
        is_whole: bool,
        tell: impl FnMut(u64),
    ) -> Result<Self, RecordingError> {
        let io = |source| {
            let path = recording.path().to_owned();
            RecordingError::Io { path, action: "read", source }
        };
        let by_index = if is_whole { None } else { Look::by_index(recording).map_err(io)? };
        let mut look = match by_index {
            Some(look) => look,
            None => Look::whole(recording, tell)?,
        };
        let count = look.channels.scan_topics.len();
        look.topics.resize_with(count.max(look.topics.len()), Collected::default);
        let named = look.topics.into_iter().zip(&look.channels.scan_topics);
        let mut topics: Vec<TopicInfo> = named.map(|(topic, name)| topic.info(name)).collect();
        topics.sort_by(|a, b| a.topic.cmp(&b.topic));
        let spans = topics.iter().filter_map(|topic| topic.span_ns);
        let span_ns = spans.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
        let others = look.channels.others.into_iter();
        Ok(Self {
            path: recording.path().display().to_string(),
            format: recording.format().name(),
            files: recording.files(),
            bytes: recording.bytes(),
            span_ns,
            sample: look.sample,
            topics,
            others: others
                .map(|(topic, message_type)| OtherTopic { topic, message_type })
                .collect(),
            first_refusal: look.first_refusal,
            early_end: look.early_end,
        })
    }
}
