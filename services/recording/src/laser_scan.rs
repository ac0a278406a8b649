//! `sensor_msgs/LaserScan` and `MultiEchoLaserScan`, as ROS 1 and ROS 2 put them on the wire, to a
//! scan.
//!
//! Fields in order: header (ROS 1: `seq`; stamp as seconds and nanoseconds; `frame_id`), angle_min,
//! angle_max, angle_increment, time_increment, scan_time, range_min, range_max, ranges,
//! intensities. The floats have 32 bits and become f64 without a rounding. Ranges stay as they are,
//! NaN included.
//!
//! A beam with several echoes has a sequence of ranges, and one of intensities, instead of a float.
//! **Here:** one echo of every beam is taken ([`Echo`]); a beam without an echo becomes NaN, because
//! drivers leave faults out in the same way: it says nothing.

use crate::cursor::Cursor;
use crate::options::Echo;
use protocol::scan::{BEAMS_MAX, LaserScan, ScanGeometry};
use protocol::time::SECOND_NS;
use std::borrow::Cow;

/// How a message is laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Wire {
    /// ROS 1 serialisation of `sensor_msgs/LaserScan`.
    Ros1,
    /// CDR of `sensor_msgs/msg/LaserScan`.
    Cdr,
    /// ROS 1 serialisation of `sensor_msgs/MultiEchoLaserScan`.
    Ros1MultiEcho,
    /// CDR of `sensor_msgs/msg/MultiEchoLaserScan`.
    CdrMultiEcho,
    /// A line of a text log; its reader knows the rest.
    Text,
}

impl Wire {
    /// By the names of ROS 2: type of the message and serialisation (`cdr`, `ros1`).
    pub fn of(message_type: &str, encoding: &str) -> Option<Self> {
        match (message_type, encoding) {
            ("sensor_msgs/msg/LaserScan", "cdr") => Some(Self::Cdr),
            ("sensor_msgs/msg/MultiEchoLaserScan", "cdr") => Some(Self::CdrMultiEcho),
            (ROS1_TYPE | "sensor_msgs/msg/LaserScan", "ros1") => Some(Self::Ros1),
            (ROS1_ECHO_TYPE | "sensor_msgs/msg/MultiEchoLaserScan", "ros1") => {
                Some(Self::Ros1MultiEcho)
            }
            _ => None,
        }
    }

    /// Largest message that can hold a scan of [`BEAMS_MAX`] beams with intensities; the rest is
    /// for a long `frame_id`. Longer ones are refused before they are read.
    pub fn bytes_max(self) -> usize {
        match self {
            Self::Ros1 | Self::Cdr => BEAMS_MAX * 8 + 32 * 1024,
            Self::Ros1MultiEcho | Self::CdrMultiEcho => {
                BEAMS_MAX * 2 * (4 + 4 * ECHOES_MAX) + 32 * 1024
            }
            Self::Text => LINE_BYTES_MAX,
        }
    }

    fn is_cdr(self) -> bool {
        matches!(self, Self::Cdr | Self::CdrMultiEcho)
    }
}

/// Name of the message in ROS 1.
pub(crate) const ROS1_TYPE: &str = "sensor_msgs/LaserScan";
/// MD5 of the definition of `sensor_msgs/LaserScan` in ROS 1: names the layout.
pub(crate) const ROS1_MD5: &str = "90c7ef2dc6895d81024acba2ac42f369";

/// Name of the message with several echoes in ROS 1.
pub(crate) const ROS1_ECHO_TYPE: &str = "sensor_msgs/MultiEchoLaserScan";
/// MD5 of the definition of `sensor_msgs/MultiEchoLaserScan` in ROS 1.
pub(crate) const ROS1_ECHO_MD5: &str = "6fefb0c6da89d7c8abe4b339f5c2f8fb";
/// Most echoes of a beam: planar lasers have 3 (Hokuyo) to 5 (SICK LMS5xx).
const ECHOES_MAX: usize = 8;
/// Longest line of a text log: [`BEAMS_MAX`] ranges and intensities of 30 characters each.
pub(crate) const LINE_BYTES_MAX: usize = 256 * 1024;

/// A scan and what the message says beside it.
pub(crate) struct Decoded<'a> {
    pub scan: LaserScan,
    /// Name of the laser's coordinates.
    pub frame_id: Cow<'a, str>,
    /// Time of one turn, seconds; 0 if unknown.
    pub scan_time_s: f32,
    /// When it was recorded, if the message itself says so.
    pub log_time_ns: Option<u64>,
}

/// Reads one message. A stamp of 0 means "not set" in ROS; then the scan is stamped with
/// `log_time_ns`.
///
/// # Errors
/// What was found and what was expected.
pub(crate) fn decode(
    bytes: &[u8],
    wire: Wire,
    log_time_ns: u64,
    echo: Echo,
) -> Result<Decoded<'_>, String> {
    let mut cursor = if wire.is_cdr() { Cursor::cdr(bytes)? } else { Cursor::packed(bytes) };
    if !wire.is_cdr() {
        cursor.u32("header.seq")?;
    }
    let seconds = cursor.u32("header.stamp")?;
    let nanoseconds = cursor.u32("header.stamp")?;
    if wire.is_cdr() && seconds > i32::MAX as u32 {
        return Err(format!("header.stamp is {} s, expected 0 or more", seconds as i32));
    }
    let stamp_ns = u64::from(seconds) * SECOND_NS + u64::from(nanoseconds);
    let frame_id = cursor.string("header.frame_id")?;
    let angle_min_rad = f64::from(cursor.f32("angle_min")?);
    cursor.f32("angle_max")?;
    let angle_increment_rad = f64::from(cursor.f32("angle_increment")?);
    cursor.f32("time_increment")?;
    let scan_time_s = cursor.f32("scan_time")?;
    let range_min_m = f64::from(cursor.f32("range_min")?);
    let range_max_m = f64::from(cursor.f32("range_max")?);
    let ranges_m = if matches!(wire, Wire::Ros1 | Wire::Cdr) {
        let ranges_m = cursor.f32s(BEAMS_MAX, "ranges")?;
        cursor.f32_bytes(BEAMS_MAX, "intensities")?;
        ranges_m
    } else {
        one_echo_each(&mut cursor, echo)?
    };
    // CDR writers may pad the end to a multiple of 4 (DDS-XTypes 1.3, 7.6.3.1.2).
    let surplus_max = if wire.is_cdr() { 3 } else { 0 };
    if cursor.left() > surplus_max {
        return Err(format!("{} bytes follow the intensities, expected none", cursor.left()));
    }
    let geometry = ScanGeometry { angle_min_rad, angle_increment_rad, range_min_m, range_max_m };
    geometry.check()?;
    if ranges_m.is_empty() {
        return Err("a scan of 0 ranges, expected at least 1".to_owned());
    }
    let stamp_ns = if stamp_ns == 0 { log_time_ns } else { stamp_ns };
    let scan = LaserScan { stamp_ns, device_stamp_ns: 0, geometry, ranges_m };
    // CDR counts the NUL at the end of a string.
    let frame_id = match frame_id {
        Cow::Borrowed(text) => Cow::Borrowed(text.trim_end_matches('\0')),
        Cow::Owned(text) => Cow::Owned(text.trim_end_matches('\0').to_owned()),
    };
    Ok(Decoded { scan, frame_id, scan_time_s, log_time_ns: None })
}

/// The ranges and intensities of beams with several echoes each: one range a beam.
fn one_echo_each(cursor: &mut Cursor<'_>, echo: Echo) -> Result<Vec<f32>, String> {
    let beams = beam_count(cursor, "ranges")?;
    let mut echoes: Vec<Vec<f32>> = Vec::new();
    for _ in 0..beams {
        echoes.push(cursor.f32s(ECHOES_MAX, "echoes of a beam")?);
    }
    let with_intensities = beam_count(cursor, "intensities")?;
    let mut chosen = Vec::with_capacity(beams);
    for beam in 0..beams.max(with_intensities) {
        let intensities = if beam < with_intensities {
            cursor.f32s(ECHOES_MAX, "intensities of a beam")?
        } else {
            Vec::new()
        };
        if let Some(echoes) = echoes.get(beam) {
            chosen.push(echo.choose(echoes, &intensities));
        }
    }
    Ok(chosen)
}

fn beam_count(cursor: &mut Cursor<'_>, what: &str) -> Result<usize, String> {
    let count = cursor.u32(what)? as usize;
    if count > BEAMS_MAX {
        return Err(format!("{count} {what}, expected at most {BEAMS_MAX}"));
    }
    Ok(count)
}
