//! `sensor_msgs/LaserScan`, as ROS 1 and ROS 2 put it on the wire, to a scan.
//!
//! Fields in order: header (ROS 1: `seq`; stamp as seconds and nanoseconds; `frame_id`), angle_min,
//! angle_max, angle_increment, time_increment, scan_time, range_min, range_max, ranges,
//! intensities. The floats have 32 bits and become f64 without a rounding. Ranges stay as they are,
//! NaN included.

use crate::cursor::Cursor;
use protocol::scan::{BEAMS_MAX, LaserScan, ScanGeometry};
use protocol::time::SECOND_NS;

/// How a message is laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Wire {
    /// ROS 1 serialisation of `sensor_msgs/LaserScan`.
    Ros1,
    /// CDR of `sensor_msgs/msg/LaserScan`.
    Cdr,
}

/// Name of the message in ROS 1.
pub(crate) const ROS1_TYPE: &str = "sensor_msgs/LaserScan";
/// MD5 of the definition of `sensor_msgs/LaserScan` in ROS 1: names the layout.
pub(crate) const ROS1_MD5: &str = "90c7ef2dc6895d81024acba2ac42f369";

/// Largest message that can hold a scan of [`BEAMS_MAX`] beams with intensities: 32 KiB of floats;
/// the rest is for a long `frame_id`. Longer messages are refused before they are read.
pub(crate) const MESSAGE_BYTES_MAX: usize = BEAMS_MAX * 8 + 32 * 1024;

/// Reads one message. A stamp of 0 means "not set" in ROS; then the scan is stamped with
/// `log_time_ns`.
///
/// # Errors
/// What was found and what was expected.
pub(crate) fn decode(bytes: &[u8], wire: Wire, log_time_ns: u64) -> Result<LaserScan, String> {
    let mut cursor = match wire {
        Wire::Ros1 => Cursor::packed(bytes),
        Wire::Cdr => Cursor::cdr(bytes)?,
    };
    if wire == Wire::Ros1 {
        cursor.u32("header.seq")?;
    }
    let seconds = cursor.u32("header.stamp")?;
    let nanoseconds = cursor.u32("header.stamp")?;
    if wire == Wire::Cdr && seconds > i32::MAX as u32 {
        return Err(format!("header.stamp is {} s, expected 0 or more", seconds as i32));
    }
    let stamp_ns = u64::from(seconds) * SECOND_NS + u64::from(nanoseconds);
    cursor.skip_string("header.frame_id")?;
    let angle_min_rad = f64::from(cursor.f32("angle_min")?);
    cursor.f32("angle_max")?;
    let angle_increment_rad = f64::from(cursor.f32("angle_increment")?);
    cursor.f32("time_increment")?;
    cursor.f32("scan_time")?;
    let range_min_m = f64::from(cursor.f32("range_min")?);
    let range_max_m = f64::from(cursor.f32("range_max")?);
    let ranges_m = cursor.f32s(BEAMS_MAX, "ranges")?;
    cursor.f32_bytes(BEAMS_MAX, "intensities")?;
    // CDR writers may pad the end to a multiple of 4 (DDS-XTypes 1.3, 7.6.3.1.2).
    let surplus_max = if wire == Wire::Cdr { 3 } else { 0 };
    if cursor.left() > surplus_max {
        return Err(format!("{} bytes follow the intensities, expected none", cursor.left()));
    }
    let geometry = ScanGeometry { angle_min_rad, angle_increment_rad, range_min_m, range_max_m };
    geometry.check()?;
    if ranges_m.is_empty() {
        return Err("a scan of 0 ranges, expected at least 1".to_owned());
    }
    let stamp_ns = if stamp_ns == 0 { log_time_ns } else { stamp_ns };
    Ok(LaserScan { stamp_ns, device_stamp_ns: 0, geometry, ranges_m })
}
