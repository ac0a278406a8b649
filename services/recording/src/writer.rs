//! Writes scans as a ROS 2 recording: MCAP, profile `ros2`, CDR, `sensor_msgs/msg/LaserScan`.
//!
//! One encoding a file, so that every ROS tool opens it. A chunk is closed every second of log
//! time, so that a crash loses a second at most. The container is that of [`crate::McapWriter`].
//!
//! A recording has f32 geometry and no device clock: see [`as_recorded`].

use crate::error::RecordingError;
use crate::mcap_writer::{McapWriter, TopicSpec};
use crate::ros2::{self, Header, LaserScan, MessageType, Time};
use protocol::scan::{BEAMS_MAX, ScanGeometry, ScanView};
use protocol::time::SECOND_NS;
use std::path::Path;

/// The geometry as a recording can hold it: every number rounded to f32.
///
/// A simulated laser should be given this geometry, so that its recording replays to the same bits.
#[must_use]
pub fn as_recorded(geometry: &ScanGeometry) -> ScanGeometry {
    let round = |value: f64| f64::from(value as f32);
    ScanGeometry {
        angle_min_rad: round(geometry.angle_min_rad),
        angle_increment_rad: round(geometry.angle_increment_rad),
        range_min_m: round(geometry.range_min_m),
        range_max_m: round(geometry.range_max_m),
    }
}

/// What a topic of a recording is called and what ROS tools want to know of it.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanTopic {
    /// Its name: `/scan`.
    pub topic: String,
    /// Name of the laser's coordinates: `laser_front`.
    pub frame_id: String,
    /// Time of one turn of the mirror, seconds; 0 if unknown.
    pub scan_time_s: f32,
}

/// A recording of scans that is being written.
pub struct ScanWriter {
    writer: McapWriter,
    topics: Vec<ScanTopic>,
    flush_at_ns: Option<u64>,
    buffer: Vec<u8>,
}

impl ScanWriter {
    /// Creates `<path>.active`, replacing a left-over of that name.
    ///
    /// # Errors
    /// [`RecordingError::Io`] or `Write`.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, RecordingError> {
        let writer = McapWriter::create(path)?;
        Ok(Self { writer, topics: Vec::new(), flush_at_ns: None, buffer: Vec::new() })
    }

    /// Adds a topic; the number that is returned names it in [`ScanWriter::write`].
    ///
    /// # Errors
    /// [`RecordingError::Write`].
    pub fn add_topic(&mut self, topic: ScanTopic) -> Result<usize, RecordingError> {
        let number =
            self.writer.add_topic(&TopicSpec::new(&topic.topic, MessageType::LaserScan))?;
        self.topics.push(topic);
        Ok(number)
    }

    /// Appends a scan. `log_time_ns` is when it was received, UNIX nanoseconds.
    ///
    /// # Errors
    /// [`RecordingError::Write`]: an unknown topic, a scan that a recording cannot hold (too many
    /// beams, a stamp after 2038), or a full disk. After that the writer is of no further use.
    pub fn write(
        &mut self,
        topic: usize,
        log_time_ns: u64,
        scan: &ScanView<'_>,
    ) -> Result<(), RecordingError> {
        let refuse = |reason| RecordingError::Write { path: self.writer.path().to_owned(), reason };
        let count = self.topics.len();
        let Some(named) = self.topics.get(topic) else {
            return Err(refuse(format!("topic number {topic}, there are {count}")));
        };
        encode_scan(&named.frame_id, named.scan_time_s, scan, &mut self.buffer).map_err(refuse)?;
        self.writer.write(topic, log_time_ns, log_time_ns, &self.buffer)?;
        let flush_at_ns = *self.flush_at_ns.get_or_insert(log_time_ns.saturating_add(SECOND_NS));
        if log_time_ns >= flush_at_ns {
            self.flush_at_ns = Some(log_time_ns.saturating_add(SECOND_NS));
            self.writer.flush()?;
        }
        Ok(())
    }

    /// Writes the index, puts the file on the disk and gives it its name.
    ///
    /// # Errors
    /// [`RecordingError::Io`] or `Write`: then the scans written so far are in `<path>.active`.
    pub fn finish(self) -> Result<(), RecordingError> {
        self.writer.finish()?.store().map(|_| ())
    }
}

/// A scan as a message, in `buffer`.
///
/// # Errors
/// What a recording cannot hold: no beams or too many, a geometry that is none, a stamp after 2038.
pub fn encode_scan(
    frame_id: &str,
    scan_time_s: f32,
    scan: &ScanView<'_>,
    buffer: &mut Vec<u8>,
) -> Result<(), String> {
    let beams = scan.ranges_m.len();
    if beams == 0 || beams > BEAMS_MAX {
        return Err(format!("a scan of {beams} beams, expected 1 to {BEAMS_MAX}"));
    }
    scan.geometry.check()?;
    let stamp = Time::of(scan.stamp_ns).ok_or_else(|| {
        let seconds = scan.stamp_ns / SECOND_NS;
        format!("a stamp of {seconds} s, ROS 2 holds at most {} s", i32::MAX)
    })?;
    let turns = scan.geometry.angle_increment_rad.abs() / std::f64::consts::TAU;
    let message = LaserScan {
        header: Header { stamp, frame_id },
        angle_min: scan.geometry.angle_min_rad as f32,
        angle_max: scan.geometry.bearing_rad(beams - 1) as f32,
        angle_increment: scan.geometry.angle_increment_rad as f32,
        time_increment: (f64::from(scan_time_s) * turns) as f32,
        scan_time: scan_time_s,
        range_min: scan.geometry.range_min_m as f32,
        range_max: scan.geometry.range_max_m as f32,
        ranges: scan.ranges_m,
        intensities: &[],
    };
    let size = 64 + frame_id.len() + 4 * beams;
    ros2::encode(&message, size, buffer).map_err(|error| error.reason)
}
