//! One laser of a recording.

use crate::gate::{Admission, ScanGate};
use crate::source::{Oddity, SourceCounts, SourceError};
use protocol::scan::LaserScan;
use recording::{Recording, RecordingError, Scans};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Oddities that are kept for [`ReplaySource::take_oddities`]; more in one go say nothing new.
const ODDITIES_MAX: usize = 16;

/// The scans of one topic of a recording, with rising stamps and one geometry.
pub struct ReplaySource {
    path: PathBuf,
    topic: Arc<str>,
    scans: Scans,
    gate: ScanGate,
    refused: u64,
    passed_over: u64,
    begin_ns: u64,
    is_over: bool,
    oddities: Vec<Oddity>,
}

impl ReplaySource {
    /// Opens a recording and picks the topic of this laser: the one that is named, or the only one that
    /// has scans.
    ///
    /// # Errors
    /// What [`Recording::open`] and [`Recording::select_topic`] say.
    pub fn open(path: &Path, topic: Option<&str>) -> Result<Self, SourceError> {
        let recording = Recording::open(path)?;
        let topic = recording.select_topic(topic)?;
        Ok(Self {
            path: path.to_owned(),
            scans: recording.scans_of(&topic),
            topic,
            gate: ScanGate::default(),
            refused: 0,
            passed_over: 0,
            begin_ns: 0,
            is_over: false,
            oddities: Vec::new(),
        })
    }

    /// Passes over scans that are stamped before `begin_ns`: a laser that was restarted in the middle
    /// of a replay goes on where the site's clock is.
    #[must_use]
    pub fn beginning_at(mut self, begin_ns: u64) -> Self {
        self.begin_ns = begin_ns;
        self
    }

    /// The topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// What it is, for the log.
    #[must_use]
    pub fn describe(&self) -> String {
        format!("the replay of {} topic {}", self.path.display(), self.topic)
    }

    /// Bytes of the recording that were read.
    #[must_use]
    pub fn position_bytes(&self) -> u64 {
        self.scans.position_bytes()
    }

    /// Puts the next scan into `scan`; false at the end.
    ///
    /// # Errors
    /// The recording is cut or damaged ([`SourceError::is_early_end`]), cannot be read, or its clock
    /// stepped by more than a day. Nothing follows an error.
    pub fn next(&mut self, scan: &mut LaserScan) -> Result<bool, SourceError> {
        while !self.is_over {
            let found = match self.scans.next() {
                None => break,
                Some(Ok(found)) => found.scan,
                Some(Err(error @ RecordingError::Message { .. })) => {
                    self.refused += 1;
                    if is_told(self.refused) {
                        self.note("message_refused", error.to_string());
                    }
                    continue;
                }
                Some(Err(error)) => {
                    self.is_over = true;
                    return Err(error.into());
                }
            };
            if self.admit(&found)? {
                *scan = found;
                return Ok(true);
            }
        }
        self.is_over = true;
        Ok(false)
    }

    fn admit(&mut self, scan: &LaserScan) -> Result<bool, SourceError> {
        let before = *self.gate.counts();
        let admission = self.gate.admit(scan).map_err(|step| {
            self.is_over = true;
            SourceError::StampStep { path: self.path.clone(), step }
        })?;
        let after = *self.gate.counts();
        let (number, topic) = (after.offered, self.topic.clone());
        if after.disorders > before.disorders && is_told(after.disorders) {
            let stamp_ns = scan.stamp_ns;
            self.note(
                "scans_out_of_order",
                format!(
                    "scan {number} of {topic} is stamped {stamp_ns} ns, not after the one before: \
                     dropped until time goes on"
                ),
            );
        }
        if after.geometry_changes > before.geometry_changes && is_told(after.geometry_changes) {
            let (found, beams) = (scan.geometry, scan.ranges_m.len());
            let (first, first_beams) = self.gate.first_geometry().unwrap_or_default();
            self.note(
                "geometry_changed",
                format!(
                    "scan {number} of {topic} has {beams} beams {found}; expected {first_beams} beams \
                     {first} as in the first scan: dropped until the geometry is back"
                ),
            );
        }
        if admission != Admission::Passes {
            return Ok(false);
        }
        let is_over = scan.stamp_ns < self.begin_ns;
        self.passed_over += u64::from(is_over);
        Ok(!is_over)
    }

    fn note(&mut self, code: &'static str, text: String) {
        if self.oddities.len() < ODDITIES_MAX {
            self.oddities.push(Oddity { code, text });
        }
    }

    /// Totals.
    #[must_use]
    pub fn counts(&self) -> SourceCounts {
        let gate = self.gate.counts();
        SourceCounts {
            scans: gate.passed - self.passed_over,
            dropped_out_of_order: gate.dropped_out_of_order,
            dropped_geometry: gate.dropped_geometry,
            refused: self.refused,
            passed_over: self.passed_over,
        }
    }

    /// What was odd since the last call.
    pub fn take_oddities(&mut self) -> Vec<Oddity> {
        std::mem::take(&mut self.oddities)
    }
}

/// True for the changes that are told: the 1st, 2nd, 4th, 8th, so that a recording in which every second
/// scan is odd does not fill the log; all are counted.
fn is_told(count: u64) -> bool {
    count.is_power_of_two()
}
