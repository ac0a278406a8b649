//! A site file for a recording that comes without one: every laser gets an area of its own, laid
//! round its scans. A recording does not say how its lasers are mounted, so each stands at (0, 0),
//! yaw 0, of its own coordinates; two rooms laid over each other would be a map of neither.
//!
//! The text is written beside the results: put the poses right, give the lasers one area, and
//! replay again with `--site`.
//!
//! Frames are 10 a second, as everywhere, unless the scans come more slowly than 4 Hz: then most
//! frames would hold no scan, no cell would be known for long enough, and the map would be empty.
//! So the frames take the time between two scans, and the ages that a scan may have grow with it.

use super::ReplayError;
use protocol::site::Preset;
use protocol::time::SECOND_NS;
use recording::{Recording, RecordingIndex, TopicSummary};
use std::fmt::Write as _;

/// Edge of a cell where nobody says otherwise, metres.
pub const CELL_M: f64 = 0.1;

/// Frames where nobody says otherwise, milliseconds.
pub const FRAME_PERIOD_MS: f64 = 100.0;
/// Slower scans need slower frames: with 4 Hz, a scan may miss its frame without leaving a gap, as
/// it is `scan_age_max_ms` = 250 old only when the next has come.
const RATE_MIN_HZ: f64 = 4.0;
/// The slowest frames that a site file takes, milliseconds.
const FRAME_PERIOD_MAX_MS: u64 = 10_000;
/// Most intervals of a topic that its median is taken of: two days of a laser at 4 Hz.
const INTERVALS_MAX: usize = 1 << 20;

/// The times of an area whose scans are slow, milliseconds; in the proportions of the defaults.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Times {
    frame_period: u64,
    scan_age_max: u64,
    lateness_max: u64,
    laser_lost: u64,
}

impl Times {
    /// For scans that come every `period_ns`; `None` where the defaults do.
    fn of(period_ns: u64) -> Option<Self> {
        if period_ns as f64 * RATE_MIN_HZ <= SECOND_NS as f64 {
            return None;
        }
        let scans_ms = period_ns.div_ceil(1_000_000);
        let frame_period = scans_ms.min(FRAME_PERIOD_MAX_MS);
        Some(Self {
            frame_period,
            scan_age_max: (scans_ms.saturating_mul(5) / 2).min(60_000),
            lateness_max: (scans_ms.saturating_mul(3) / 2).min(60_000),
            laser_lost: scans_ms.saturating_mul(10).min(600_000),
        })
    }

    /// The keys of the area.
    fn text(self) -> String {
        let Self { frame_period, scan_age_max, lateness_max, laser_lost } = self;
        format!(
            "# The scans come more slowly than 4 Hz: frames, and the age of a scan in one, fit them.\n\
             frame_period_ms = {frame_period}.0\nscan_age_max_ms = {scan_age_max}.0\n\
             lateness_max_ms = {lateness_max}.0\nlaser_lost_ms = {laser_lost}.0\n"
        )
    }
}

/// The times of a topic, if it is slow. That is told by the median of its intervals, so that a
/// laser that was off for an hour is no slow one; the recording is read again only where the mean
/// rate leaves that open.
fn slow_times(recording: &Recording, topic: &TopicSummary) -> Option<Times> {
    if topic.rate_hz() == 0.0 || topic.rate_hz() >= RATE_MIN_HZ {
        return None;
    }
    // What is odd about the recording was said when it was looked through.
    let stamps_ns = recording.scans_of(&topic.topic).flatten().map(|found| found.scan.stamp_ns);
    let (mut last_ns, mut intervals_ns) = (None, Vec::new());
    for stamp_ns in stamps_ns.take(INTERVALS_MAX) {
        if last_ns.is_none_or(|last_ns| stamp_ns > last_ns) {
            intervals_ns.extend(last_ns.map(|last_ns| stamp_ns - last_ns));
            last_ns = Some(stamp_ns);
        }
    }
    Times::of(median(intervals_ns)?)
}

/// The lower median; `None` of nothing.
fn median(mut values: Vec<u64>) -> Option<u64> {
    let middle = values.len().checked_sub(1)? / 2;
    Some(*values.select_nth_unstable(middle).1)
}

/// Text of a site file for the scans of a recording.
///
/// # Errors
/// If a topic has no echo, or spans more than an area may.
pub fn lay_out(
    recording: &Recording,
    index: &RecordingIndex,
    preset: Preset,
) -> Result<String, ReplayError> {
    let mut text = String::from(
        "# Laid round the scans of a recording by `tog replay`. The poses are not known: every laser\n\
         # stands at (0, 0) of an area of its own. Correct them, then replay with --site.\n\
         #\n\
         # Two lasers of one room: write `area = \"...\"` of the second as that of the first, delete the\n\
         # [[area]] that is left over, measure where the second stands (x_m, y_m, yaw_deg) in the\n\
         # coordinates of the first, and make columns and rows large enough for both.\n\
         name = \"replay\"\n",
    );
    let mut ids = Vec::new();
    let path = toml_string(&recording.path().display().to_string());
    for topic in &index.topics {
        let id = identifier(&topic.topic, &ids);
        let grid = topic
            .extent
            .area(CELL_M)
            .map_err(|source| ReplayError::Layout { topic: topic.topic.clone(), source })?;
        let times = slow_times(recording, topic).map(Times::text).unwrap_or_default();
        let topic = toml_string(&topic.topic);
        let [x_m, y_m] = grid.origin_m;
        // Writing to a String cannot fail.
        let _ = write!(
            text,
            "\n[[area]]\nid = \"{id}\"\norigin_m = [{x_m:?}, {y_m:?}]\ncell_m = {:?}\n\
             columns = {}\nrows = {}\npreset = \"{}\"\n\
             {times}\n[[laser]]\nid = \"{id}\"\narea = \"{id}\"\nx_m = 0.0\ny_m = 0.0\nyaw_deg = 0.0\n\
             source = {{ kind = \"replay\", recording = {path}, topic = {topic}, pace = \"lossless\" }}\n",
            grid.cell_m,
            grid.columns,
            grid.rows,
            preset.name(),
        );
        ids.push(id);
    }
    Ok(text)
}

/// A basic string of TOML, escaped.
fn toml_string(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => {
                let _ = write!(quoted, "\\u{:04X}", u32::from(c));
            }
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}

/// `/front_scan` becomes `front_scan`: letters, digits, `-`, `_`, unique, at most 32.
fn identifier(topic: &str, taken: &[String]) -> String {
    let allowed = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
    let id: String = topic.trim_matches('/').chars().map(allowed).take(28).collect();
    if id.is_empty() || taken.contains(&id) { format!("{id}_{}", taken.len()) } else { id }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn topics_become_ids_that_a_site_file_takes() {
        assert_eq!(identifier("/front_scan", &[]), "front_scan");
        assert_eq!(identifier("/robot/scan", &[]), "robot_scan");
        assert_eq!(identifier("/scan", &["scan".to_owned()]), "scan_1");
        assert_eq!(identifier("/", &[]), "_0");
    }

    #[test]
    fn slow_scans_have_slow_frames_and_others_those_of_always() {
        assert_eq!([100, 250].map(|period_ms| Times::of(period_ms * 1_000_000)), [None, None]);
        let times = Times::of(2_999_400_000).unwrap();
        let found = [times.frame_period, times.scan_age_max, times.lateness_max, times.laser_lost];
        assert_eq!(found, [3000, 7500, 4500, 30_000]);
        let times = Times::of(u64::MAX).unwrap();
        let found = [times.frame_period, times.scan_age_max, times.lateness_max, times.laser_lost];
        assert_eq!(found, [10_000, 60_000, 60_000, 600_000], "what a site file takes");
    }

    #[test]
    fn one_long_pause_is_not_the_time_between_two_scans() {
        assert_eq!(median(vec![3_600_000, 100, 101, 99]), Some(100));
        assert_eq!(median(Vec::new()), None);
    }

    #[test]
    fn any_path_can_be_written_in_toml() {
        assert_eq!(toml_string("a\"b\\c\n"), "\"a\\\"b\\\\c\\u000A\"");
    }
}
