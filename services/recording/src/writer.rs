//! Writes scans as a ROS 2 recording: MCAP, profile `ros2`, CDR, `sensor_msgs/msg/LaserScan`.
//!
//! One encoding a file, so that every ROS tool opens it. Chunks of 768 KiB, zstd, all indexes and
//! checksums, on the thread of the caller. A chunk is closed every second of log time, so that a
//! crash loses a second at most. The file is called `<name>.active` until [`ScanWriter::finish`]
//! has put it on the disk: what has its final name is complete.
//!
//! A recording has f32 geometry and no device clock: see [`as_recorded`].

use crate::error::RecordingError;
use crate::mcap_file::words;
use byteorder::LittleEndian;
use mcap::records::MessageHeader;
use mcap::{Compression, McapError, WriteOptions, Writer};
use protocol::scan::{BEAMS_MAX, ScanGeometry, ScanView};
use protocol::time::SECOND_NS;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

/// Chunk size that rosbag2 documents: large enough for zstd, small enough to hold.
const CHUNK_BYTES: u64 = 768 * 1024;
const SCHEMA_NAME: &str = "sensor_msgs/msg/LaserScan";
/// Definition of the message and of the two that it contains, as rosbag2 merges them.
const SCHEMA_TEXT: &str = "\
std_msgs/Header header
float32 angle_min
float32 angle_max
float32 angle_increment
float32 time_increment
float32 scan_time
float32 range_min
float32 range_max
float32[] ranges
float32[] intensities
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";
/// CDR, little endian (DDS-XTypes 1.3, table 60).
const CDR_LITTLE_ENDIAN: [u8; 4] = [0, 1, 0, 0];

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

/// A recording that is being written.
pub struct ScanWriter {
    path: PathBuf,
    active_path: PathBuf,
    writer: Writer<BufWriter<File>>,
    schema_id: u16,
    topics: Vec<Topic>,
    flush_at_ns: Option<u64>,
    buffer: Vec<u8>,
}

struct Topic {
    topic: ScanTopic,
    channel_id: u16,
    sequence: u32,
}

#[derive(Serialize)]
struct Message<'a> {
    sec: i32,
    nanosec: u32,
    frame_id: &'a str,
    angle_min: f32,
    angle_max: f32,
    angle_increment: f32,
    time_increment: f32,
    scan_time: f32,
    range_min: f32,
    range_max: f32,
    ranges: &'a [f32],
    intensities: &'a [f32],
}

impl ScanWriter {
    /// Creates `<path>.active`, replacing a left-over of that name.
    ///
    /// # Errors
    /// [`RecordingError::Io`] or `Write`.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, RecordingError> {
        let path = path.as_ref().to_owned();
        let mut active_path = path.clone().into_os_string();
        active_path.push(".active");
        let active_path = PathBuf::from(active_path);
        let file = File::create(&active_path).map_err(|source| RecordingError::Io {
            path: active_path.clone(),
            action: "create",
            source,
        })?;
        let options = WriteOptions::new()
            .profile("ros2")
            .library(concat!("tog ", env!("CARGO_PKG_VERSION"), " mcap-rust/0.26"))
            .compression(Some(Compression::Zstd))
            .compression_threads(0)
            .chunk_size(Some(CHUNK_BYTES));
        let fault = |error| write_error(&active_path, &error);
        let mut writer = options.create(BufWriter::new(file)).map_err(fault)?;
        let schema_id = writer
            .add_schema(SCHEMA_NAME, "ros2msg", SCHEMA_TEXT.as_bytes())
            .map_err(|error| write_error(&active_path, &error))?;
        Ok(Self {
            path,
            active_path,
            writer,
            schema_id,
            topics: Vec::new(),
            flush_at_ns: None,
            buffer: Vec::new(),
        })
    }

    /// Adds a topic; the number that is returned names it in [`ScanWriter::write`].
    ///
    /// # Errors
    /// [`RecordingError::Write`].
    pub fn add_topic(&mut self, topic: ScanTopic) -> Result<usize, RecordingError> {
        let channel_id = self
            .writer
            .add_channel(self.schema_id, &topic.topic, "cdr", &BTreeMap::new())
            .map_err(|error| write_error(&self.active_path, &error))?;
        self.topics.push(Topic { topic, channel_id, sequence: 0 });
        Ok(self.topics.len() - 1)
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
        let path = &self.active_path;
        let refuse = |reason| RecordingError::Write { path: path.clone(), reason };
        let count = self.topics.len();
        let Some(topic) = self.topics.get_mut(topic) else {
            return Err(refuse(format!("topic number {topic}, there are {count}")));
        };
        encode(&topic.topic, scan, &mut self.buffer).map_err(refuse)?;
        let header = MessageHeader {
            channel_id: topic.channel_id,
            sequence: topic.sequence,
            log_time: log_time_ns,
            publish_time: log_time_ns,
        };
        topic.sequence = topic.sequence.wrapping_add(1);
        self.writer
            .write_to_known_channel(&header, &self.buffer)
            .map_err(|error| write_error(path, &error))?;
        let flush_at_ns = *self.flush_at_ns.get_or_insert(log_time_ns.saturating_add(SECOND_NS));
        if log_time_ns >= flush_at_ns {
            self.flush_at_ns = Some(log_time_ns.saturating_add(SECOND_NS));
            self.writer.flush().map_err(|error| write_error(path, &error))?;
        }
        Ok(())
    }

    /// Writes the index, puts the file on the disk and gives it its name.
    ///
    /// # Errors
    /// [`RecordingError::Io`] or `Write`: then the scans written so far are in `<path>.active`.
    pub fn finish(mut self) -> Result<(), RecordingError> {
        self.writer.finish().map_err(|error| write_error(&self.active_path, &error))?;
        let file = self.writer.into_inner().into_inner().map_err(io::IntoInnerError::into_error);
        let parent = match self.path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        file.and_then(|file| file.sync_all())
            .and_then(|()| fs::rename(&self.active_path, &self.path))
            .and_then(|()| File::open(parent)?.sync_all())
            .map_err(|source| RecordingError::Io { path: self.path, action: "finish", source })
    }
}

fn write_error(path: &Path, error: &McapError) -> RecordingError {
    RecordingError::Write { path: path.to_owned(), reason: words(error) }
}

fn encode(topic: &ScanTopic, scan: &ScanView<'_>, buffer: &mut Vec<u8>) -> Result<(), String> {
    let beams = scan.ranges_m.len();
    if beams == 0 || beams > BEAMS_MAX {
        return Err(format!("a scan of {beams} beams, expected 1 to {BEAMS_MAX}"));
    }
    scan.geometry.check()?;
    let seconds = scan.stamp_ns / SECOND_NS;
    let sec = i32::try_from(seconds)
        .map_err(|_| format!("a stamp of {seconds} s, ROS 2 holds at most {} s", i32::MAX))?;
    let turns = scan.geometry.angle_increment_rad.abs() / std::f64::consts::TAU;
    let message = Message {
        sec,
        nanosec: (scan.stamp_ns % SECOND_NS) as u32,
        frame_id: &topic.frame_id,
        angle_min: scan.geometry.angle_min_rad as f32,
        angle_max: scan.geometry.bearing_rad(beams - 1) as f32,
        angle_increment: scan.geometry.angle_increment_rad as f32,
        time_increment: (f64::from(topic.scan_time_s) * turns) as f32,
        scan_time: topic.scan_time_s,
        range_min: scan.geometry.range_min_m as f32,
        range_max: scan.geometry.range_max_m as f32,
        ranges: scan.ranges_m,
        intensities: &[],
    };
    buffer.clear();
    buffer.extend_from_slice(&CDR_LITTLE_ENDIAN);
    let size = 64 + topic.frame_id.len() + 4 * beams;
    let body = cdr_encoding::to_vec_with_size_hint::<_, LittleEndian>(&message, size)
        .map_err(|error| error.to_string())?;
    buffer.extend_from_slice(&body);
    Ok(())
}
