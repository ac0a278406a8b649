//! CARMEN logs: one message a line, `NAME values.. ipc_timestamp host logger_timestamp`.
//!
//! | line | values |
//! |---|---|
//! | `FLASER`, `RLASER` | count, ranges, pose of the laser (3), of the robot (3) |
//! | `RAWLASER1` to `5` | type, start angle, field of view, resolution, maximum, accuracy, remission mode, count, ranges, count, remissions |
//! | `ROBOTLASER1`, `2` | as `RAWLASER1`, then poses (6), velocities (2), safety distances (2), turn axis |
//!
//! **Here:** the stamp is `ipc_timestamp`, of the host that read the laser; the logger's own clock
//! begins at 0 with every log and is used only where the other is 0. A message with neither has no
//! place in time and is refused.
//!
//! **Here:** `FLASER` and `RLASER` do not say how their beams lie: 180 and 181 ranges are 1 degree
//! apart, 360 and 361 half a degree, 400 and 401 a quarter, from -90 (-50) degrees on, as the SICK
//! LMS-2xx measures and as CARMEN itself reads them; any other number covers 180 degrees. Nor do
//! they say how far the laser sees: the highest number of the begin of the log tells it where it is
//! a code of the device (see `sick_codes`) or the 50 to 51.2 m of a PLS; otherwise it is 81.83 m, the
//! most of any laser of that time. Below 2 cm nothing is measured: those are errors.

use crate::laser_scan::Decoded;
use crate::number::{count, real, real32, seconds_ns};
use crate::sick_codes::SickCodes;
use protocol::scan::{BEAMS_MAX, LaserScan, ScanGeometry};
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Lines with scans, as they begin.
const SCANS: [&str; 9] = [
    "FLASER",
    "RLASER",
    "RAWLASER1",
    "RAWLASER2",
    "RAWLASER3",
    "RAWLASER4",
    "RAWLASER5",
    "ROBOTLASER1",
    "ROBOTLASER2",
];
/// Lines that only a CARMEN log has, for telling the format.
const OTHERS: [&str; 6] =
    ["# message_name", "# message formats defined", "PARAM", "ODOM", "TRUEPOS", "NEFF"];
/// Below this a range is an error, metres.
pub(crate) const RANGE_MIN_M: f64 = 0.02;
/// The most of any laser of that time, metres.
const RANGE_MAX_M: f64 = 81.83;
/// Where a PLS sees no more, and its highest number, metres.
const PLS_M: [f64; 2] = [50.0, 51.2];
/// Values behind the ranges of a line.
const POSES: usize = 6;
const ROBOT_VALUES: usize = 11;

/// What the begin of a log says about each kind of line: its highest range, metres.
#[derive(Debug, Default)]
pub(crate) struct Carmen {
    highest_m: BTreeMap<&'static str, f64>,
}

/// The kind of line, if it holds a scan.
pub(crate) fn scan_kind(line: &str) -> Option<&'static str> {
    let name = line.split_ascii_whitespace().next()?;
    SCANS.into_iter().find(|kind| *kind == name)
}

/// True if only a CARMEN log has such a line.
pub(crate) fn is_line(line: &str) -> bool {
    let has_words =
        |start: &str| line.strip_prefix(start).is_some_and(|rest| rest.starts_with([' ', ':']));
    scan_kind(line).is_some() || OTHERS.into_iter().any(has_words)
}

/// What a line says, before the ranges are judged.
struct Line<'a> {
    /// Bearing of the first beam, angle between two, both radians, and the maximum in metres.
    declared: Option<[f64; 3]>,
    ranges_m: Vec<f32>,
    stamp: &'a str,
    logger_stamp: &'a str,
}

impl Carmen {
    /// Takes a line of the begin of the log.
    pub fn survey(&mut self, line: &str) {
        let Some(kind) = scan_kind(line) else { return };
        if let Ok(line) = parse(line, kind) {
            let highest_m = self.highest_m.entry(kind).or_default();
            let finite = line.ranges_m.iter().filter(|range_m| range_m.is_finite());
            *highest_m = finite.fold(*highest_m, |most, range_m| most.max(f64::from(*range_m)));
        }
    }

    /// The scan of a line of this kind.
    ///
    /// # Errors
    /// What was found and what was expected.
    pub fn decode(&self, line: &str, kind: &'static str) -> Result<Decoded<'static>, String> {
        let line = parse(line, kind)?;
        let stamp_ns = match seconds_ns(line.stamp)? {
            0 => seconds_ns(line.logger_stamp)?,
            stamp_ns => stamp_ns,
        };
        if stamp_ns == 0 {
            return Err("both its time stamps are 0: it has no place in time".to_owned());
        }
        let highest_m = self.highest_m.get(kind).copied().unwrap_or_default();
        let codes = SickCodes::of_highest(highest_m);
        let beams = line.ranges_m.len();
        let seen_max_m = match codes {
            Some(codes) => codes.range_max_m,
            None if (PLS_M[0]..=PLS_M[1]).contains(&highest_m) => PLS_M[0],
            None => RANGE_MAX_M,
        };
        let [angle_min_rad, angle_increment_rad, range_max_m] = match line.declared {
            Some([start, step, most]) => {
                [start, step, if codes.is_some() { most.min(seen_max_m) } else { most }]
            }
            None => {
                let [start, step] = implied_rad(beams);
                [start, step, seen_max_m]
            }
        };
        let geometry = crate::writer::as_recorded(&ScanGeometry {
            angle_min_rad,
            angle_increment_rad,
            range_min_m: RANGE_MIN_M,
            range_max_m,
        });
        geometry.check()?;
        let mut ranges_m = line.ranges_m;
        if let Some(codes) = codes {
            ranges_m.iter_mut().for_each(|range_m| *range_m = codes.decoded(*range_m));
        }
        let scan = LaserScan { stamp_ns, device_stamp_ns: 0, geometry, ranges_m };
        let (frame_id, log_time_ns) = (Cow::Borrowed(""), Some(stamp_ns));
        Ok(Decoded { scan, frame_id, scan_time_s: 0.0, log_time_ns })
    }
}

/// Bearing of the first of so many beams, and the angle between two, radians.
fn implied_rad(beams: usize) -> [f64; 2] {
    let [field_deg, step_deg] = match beams {
        180 | 181 => [180.0, 1.0],
        360 | 361 => [180.0, 0.5],
        400 | 401 => [100.0, 0.25],
        beams => [180.0, 180.0 / (beams.max(2) - 1) as f64],
    };
    [(-field_deg / 2.0_f64).to_radians(), f64::to_radians(step_deg)]
}

fn parse<'a>(line: &'a str, kind: &str) -> Result<Line<'a>, String> {
    let mut words = line.split_ascii_whitespace().skip(1);
    let mut next = |what: &str| words.next().ok_or_else(|| format!("the line ends before {what}"));
    let has_config = kind.starts_with('R') && kind != "RLASER";
    let mut declared = None;
    if has_config {
        next("the laser's type")?;
        let start = real(next("the start angle")?, "the start angle")?;
        next("the field of view")?;
        let step = real(next("the resolution")?, "the resolution")?;
        let most = real(next("the maximum")?, "the maximum")?;
        next("the accuracy")?;
        next("the remission mode")?;
        declared = Some([start, step, most]);
    }
    let beams = count(next("the number of ranges")?, BEAMS_MAX, "ranges")?;
    if beams == 0 {
        return Err("a scan of 0 ranges, expected at least 1".to_owned());
    }
    let mut ranges_m = Vec::with_capacity(beams);
    for _ in 0..beams {
        ranges_m.push(real32(next("its last range")?, "a range")?);
    }
    let mut passed = POSES;
    if has_config {
        passed = count(next("the number of remissions")?, BEAMS_MAX, "remissions")?;
        passed += if kind.starts_with("ROBOT") { ROBOT_VALUES } else { 0 };
    }
    for _ in 0..passed {
        real(next("its time stamp")?, "a value behind the ranges")?;
    }
    let stamp = next("its time stamp")?;
    next("its host")?;
    let logger_stamp = next("the logger's time stamp")?;
    match words.next() {
        None => Ok(Line { declared, ranges_m, stamp, logger_stamp }),
        Some(more) => Err(format!("\"{more}\" follows the logger's time stamp, expected nothing")),
    }
}
