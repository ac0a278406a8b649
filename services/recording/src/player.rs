//! Logs of Player's `writelog` driver, file version 0.3: one message a line,
//! `time host robot interface index type subtype` and what the interface says.
//!
//! A scan is a `laser` line of type 001 (data): subtype 001 with `id min max resolution max_range
//! count`, subtype 002 with the pose of the robot (3) behind `id`; then a range and an intensity for
//! every beam. Bearings are radians, ranges metres.
//!
//! **Here:** a laser is called `robot:laser:index`, as Player addresses it. Where `max_range` is that
//! of a SICK LMS-2xx, the fault codes that its driver hands on as ranges are told from ranges (see
//! `sick_codes`). Below 2 cm nothing is measured. Subtype 003 gives every beam a bearing of its own,
//! which a scan here cannot hold: it is refused.

use crate::carmen::RANGE_MIN_M;
use crate::laser_scan::Decoded;
use crate::number::{count, real, real32, seconds_ns};
use crate::sick_codes::SickCodes;
use protocol::scan::{BEAMS_MAX, LaserScan, ScanGeometry};
use std::borrow::Cow;

/// First words of a log.
pub(crate) const MAGIC: &str = "## Player version";
/// The line that says how the messages are laid out, and what is read.
pub(crate) const VERSION: &str = "## File version ";
pub(crate) const VERSION_READ: &str = "0.3";

/// Name of the laser, if the line is one of its scans.
pub(crate) fn laser(line: &str) -> Option<String> {
    let mut words = line.split_ascii_whitespace();
    let (robot, interface) = (words.nth(2)?, words.next()?);
    let (index, kind): (u32, u32) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    (interface == "laser" && kind == 1).then(|| format!("{robot}:laser:{index}"))
}

/// The scan of a line for which [`laser`] gave a name.
///
/// # Errors
/// What was found and what was expected.
pub(crate) fn decode(line: &str) -> Result<Decoded<'static>, String> {
    let mut words = line.split_ascii_whitespace();
    let mut next = |what: &str| words.next().ok_or_else(|| format!("the line ends before {what}"));
    let stamp_ns = seconds_ns(next("its time")?)?;
    for _ in 0..5 {
        next("its subtype")?;
    }
    let before = match next("its subtype")?.parse() {
        Ok(1) => 1,
        Ok(2) => 4,
        Ok(3) => return Err("every beam has a bearing of its own, expected equal steps".to_owned()),
        subtype => return Err(format!("subtype {subtype:?} of a scan, expected 001 or 002")),
    };
    for _ in 0..before {
        real(next("the first bearing")?, "the number or the pose of the scan")?;
    }
    let angle_min_rad = real(next("the first bearing")?, "the first bearing")?;
    next("the last bearing")?;
    let angle_increment_rad = real(next("the resolution")?, "the resolution")?;
    let declared_m = real(next("the maximum")?, "the maximum")?;
    let beams = count(next("the number of ranges")?, BEAMS_MAX, "ranges")?;
    if beams == 0 {
        return Err("a scan of 0 ranges, expected at least 1".to_owned());
    }
    let codes = SickCodes::of_declared_max(declared_m);
    let mut ranges_m = Vec::with_capacity(beams);
    for _ in 0..beams {
        let range_m = real32(next("its last range")?, "a range")?;
        next("its last intensity")?;
        ranges_m.push(codes.map_or(range_m, |codes| codes.decoded(range_m)));
    }
    if let Some(more) = words.next() {
        return Err(format!("\"{more}\" follows the last of {beams} ranges, expected nothing"));
    }
    let geometry = crate::writer::as_recorded(&ScanGeometry {
        angle_min_rad,
        angle_increment_rad,
        range_min_m: RANGE_MIN_M,
        range_max_m: codes.map_or(declared_m, |codes| codes.range_max_m),
    });
    geometry.check()?;
    let scan = LaserScan { stamp_ns, device_stamp_ns: 0, geometry, ranges_m };
    let (frame_id, log_time_ns) = (Cow::Borrowed(""), Some(stamp_ns));
    Ok(Decoded { scan, frame_id, scan_time_s: 0.0, log_time_ns })
}
