//! A look through a whole recording: which topics, how many scans, from when to when, how the beams
//! lie, what is odd. Everything that `tog replay` must know before the first frame.

use crate::error::RecordingError;
use crate::extent::{Directions, Extent, silent};
use crate::recording::{RecordedScan, Recording};
use protocol::geometry::Pose;
use protocol::scan::ScanGeometry;
use protocol::time::SECOND_NS;
use std::path::PathBuf;

/// A longer silence between two scans is counted as a gap: ten periods of the slowest usual laser.
pub const GAP_NS: u64 = SECOND_NS;

/// The scans of one topic.
#[derive(Debug, Clone, PartialEq)]
pub struct TopicSummary {
    /// Its name.
    pub topic: String,
    /// Scans that can be used.
    pub scans: u64,
    /// Messages that were refused (see [`RecordingIndex::first_refusal`]).
    pub refused: u64,
    /// Stamp of the first scan, UNIX nanoseconds.
    pub first_stamp_ns: u64,
    /// Highest stamp, UNIX nanoseconds.
    pub last_stamp_ns: u64,
    /// How the beams of the first scan lie.
    pub geometry: ScanGeometry,
    /// Beams of the first scan.
    pub beams: usize,
    /// Readings of all scans.
    pub readings: u64,
    /// How many of them are "no return".
    pub no_return: u64,
    /// How many of them are invalid.
    pub invalid: u64,
    /// Scans whose beams lie otherwise than those of the scan before.
    pub geometry_changes: u64,
    /// Scans whose stamp is not above the highest before.
    pub out_of_order: u64,
    /// Silences of more than [`GAP_NS`].
    pub gaps: u64,
    /// The longest time between two scans in order, nanoseconds.
    pub longest_gap_ns: u64,
    /// Where the echoes of this topic lie.
    pub extent: Extent,
}

impl TopicSummary {
    /// Scans a second between the first and the last stamp; 0 for a single scan.
    #[must_use]
    pub fn rate_hz(&self) -> f64 {
        let span_ns = self.last_stamp_ns.saturating_sub(self.first_stamp_ns);
        let intervals = self.scans.saturating_sub(1 + self.out_of_order);
        if span_ns == 0 { 0.0 } else { intervals as f64 * SECOND_NS as f64 / span_ns as f64 }
    }
}

/// What a recording holds.
#[derive(Debug)]
pub struct RecordingIndex {
    /// Its path.
    pub path: PathBuf,
    /// Topics with at least one scan, in the order in which the file introduces them.
    pub topics: Vec<TopicSummary>,
    /// The first message that was refused.
    pub first_refusal: Option<RecordingError>,
    /// Why the recording ended early, if it did: [`RecordingError::Cut`] or `Damaged`.
    pub early_end: Option<RecordingError>,
}

impl RecordingIndex {
    /// Reads the whole recording once. `site_from_laser` gives the pose of a topic's laser, without
    /// knowledge the site's origin ([`Pose::default`]); `None` if nobody asks how far its echoes reach:
    /// then its extent stays empty, and a third of the work is saved.
    ///
    /// # Errors
    /// The file cannot be read, or holds no scan that can be used. A recording that is cut or
    /// damaged behind its first scan is not an error here: see [`RecordingIndex::early_end`].
    pub fn scan(
        recording: &Recording,
        site_from_laser: impl Fn(&str) -> Option<Pose>,
    ) -> Result<Self, RecordingError> {
        let mut scans = recording.scans();
        let mut topics: Vec<Option<Collected>> = Vec::new();
        let mut refused: Vec<u64> = Vec::new();
        let (mut first_refusal, mut early_end) = (None, None);
        while let Some(item) = scans.next() {
            let count = scans.topics().len();
            topics.resize_with(count, || None);
            refused.resize(count, 0);
            match item {
                Ok(found) => {
                    let topic = topics[found.topic_index].get_or_insert_with(|| {
                        let pose = site_from_laser(&found.topic);
                        Collected::new(&found, pose)
                    });
                    topic.add(&found);
                }
                Err(error @ RecordingError::Message { .. }) => {
                    if let RecordingError::Message { topic, .. } = &error {
                        let topic = scans.topics().iter().position(|name| **name == **topic);
                        topic.into_iter().for_each(|index| refused[index] += 1);
                    }
                    first_refusal.get_or_insert(error);
                }
                Err(error @ RecordingError::Io { .. }) => return Err(error),
                Err(error) => early_end = Some(error),
            }
        }
        let topics: Vec<TopicSummary> = (topics.into_iter().zip(refused))
            .filter_map(|(topic, refused)| Some(TopicSummary { refused, ..topic?.summary }))
            .collect();
        if topics.is_empty() {
            return Err(early_end.or(first_refusal).unwrap_or_else(|| scans.no_scans()));
        }
        let path = recording.path().to_owned();
        Ok(Self { path, topics, first_refusal, early_end })
    }

    /// The topic of this name; the only topic if no name is given.
    ///
    /// # Errors
    /// No such topic, or several and no name; the error lists what is there.
    pub fn topic(&self, name: Option<&str>) -> Result<&TopicSummary, RecordingError> {
        let path = self.path.clone();
        let names: Vec<&str> = self.topics.iter().map(|topic| topic.topic.as_str()).collect();
        match name {
            Some(name) => self.topics.iter().find(|topic| topic.topic == name).ok_or_else(|| {
                let (topic, topics) = (name.to_owned(), names.join(", "));
                RecordingError::NoSuchTopic { path, topic, topics }
            }),
            None if self.topics.len() == 1 => Ok(&self.topics[0]),
            None => Err(RecordingError::SeveralTopics { path, topics: names.join(", ") }),
        }
    }
}

/// A topic while it is read.
struct Collected {
    summary: TopicSummary,
    latest: (ScanGeometry, usize),
    pose: Option<Pose>,
    directions: Directions,
}

impl Collected {
    fn new(first: &RecordedScan, pose: Option<Pose>) -> Self {
        let scan = &first.scan;
        let mut summary = TopicSummary {
            topic: first.topic.to_string(),
            scans: 0,
            refused: 0,
            first_stamp_ns: scan.stamp_ns,
            last_stamp_ns: scan.stamp_ns,
            geometry: scan.geometry,
            beams: scan.ranges_m.len(),
            readings: 0,
            no_return: 0,
            invalid: 0,
            geometry_changes: 0,
            out_of_order: 0,
            gaps: 0,
            longest_gap_ns: 0,
            extent: Extent::default(),
        };
        let latest = (scan.geometry, scan.ranges_m.len());
        pose.into_iter().for_each(|pose| summary.extent.add_laser(pose));
        Self { summary, latest, pose, directions: Directions::default() }
    }

    fn add(&mut self, found: &RecordedScan) {
        let (scan, summary) = (&found.scan, &mut self.summary);
        let geometry = (scan.geometry, scan.ranges_m.len());
        if geometry != self.latest {
            summary.geometry_changes += 1;
            self.latest = geometry;
        }
        if summary.scans > 0 && scan.stamp_ns <= summary.last_stamp_ns {
            summary.out_of_order += 1;
        } else {
            let gap_ns = scan.stamp_ns - summary.last_stamp_ns;
            summary.gaps += u64::from(gap_ns > GAP_NS);
            summary.longest_gap_ns = summary.longest_gap_ns.max(gap_ns);
            summary.last_stamp_ns = scan.stamp_ns;
        }
        let [no_return, invalid] = match self.pose {
            Some(pose) => summary.extent.add_scan(scan, pose, &mut self.directions),
            None => silent(scan),
        };
        summary.scans += 1;
        summary.readings += scan.ranges_m.len() as u64;
        summary.no_return += no_return;
        summary.invalid += invalid;
    }
}
