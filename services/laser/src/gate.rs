//! Which scans of a source go out: stamps that rise, beams that lie as those of the first scan.
//!
//! The grid stands on both: a frame is a function of the stamps, and the cells of a beam are computed
//! once. What does not fit is dropped and counted, never bent into shape.

use protocol::scan::{LaserScan, ScanGeometry};
use protocol::time::SECOND_NS;

/// Largest step from one stamp to the next, nanoseconds: 24 h. A night without a scan is possible, a
/// step of more is a wrong clock; frames are counted through it, so it would take hours to replay.
pub const STEP_MAX_NS: u64 = 24 * 3600 * SECOND_NS;

/// What becomes of a scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Admission {
    /// It goes out.
    Passes,
    /// Its stamp is not after the last one that passed: dropped.
    OutOfOrder,
    /// Its beams lie otherwise than those of the first scan: dropped.
    GeometryChanged,
}

/// The stamp stepped too far ahead.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "scan {number} is stamped {found_ns} ns, {} h after the scan before; expected at most {} h, up to \
     {expected_max_ns} ns: the clock of the recorder stepped, cut the recording there",
    (found_ns - expected_max_ns + STEP_MAX_NS) / (3600 * SECOND_NS),
    STEP_MAX_NS / (3600 * SECOND_NS)
)]
pub struct StampStep {
    /// Number of the scan among those that were offered, from 1.
    pub number: u64,
    /// Its stamp, UNIX nanoseconds.
    pub found_ns: u64,
    /// The highest stamp that would have passed, UNIX nanoseconds.
    pub expected_max_ns: u64,
}

/// Totals since the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GateCounts {
    /// Scans offered.
    pub offered: u64,
    /// Scans that passed.
    pub passed: u64,
    /// Scans dropped for their stamp.
    pub dropped_out_of_order: u64,
    /// Scans dropped for their geometry.
    pub dropped_geometry: u64,
    /// How often the stamps began to be out of order: once a run, however long it is.
    pub disorders: u64,
    /// How often the geometry changed away from the first scan's: once a run.
    pub geometry_changes: u64,
}

/// The gate of one laser.
#[derive(Debug, Clone, Default)]
pub struct ScanGate {
    first: Option<(ScanGeometry, usize)>,
    newest_ns: u64,
    last: Option<Admission>,
    counts: GateCounts,
}

impl ScanGate {
    /// Decides on the next scan of the laser.
    ///
    /// # Errors
    /// [`StampStep`] if its stamp is more than [`STEP_MAX_NS`] ahead of the last one that passed.
    pub fn admit(&mut self, scan: &LaserScan) -> Result<Admission, StampStep> {
        self.counts.offered += 1;
        let shape = (scan.geometry, scan.ranges_m.len());
        let admission = match self.first {
            None => Admission::Passes,
            Some(_) if scan.stamp_ns <= self.newest_ns => Admission::OutOfOrder,
            Some(first) if first != shape => Admission::GeometryChanged,
            Some(_) => {
                let expected_max_ns = self.newest_ns.saturating_add(STEP_MAX_NS);
                if scan.stamp_ns > expected_max_ns {
                    let (number, found_ns) = (self.counts.offered, scan.stamp_ns);
                    return Err(StampStep { number, found_ns, expected_max_ns });
                }
                Admission::Passes
            }
        };
        let begins = self.last.replace(admission) != Some(admission);
        match admission {
            Admission::Passes => {
                self.first.get_or_insert(shape);
                self.newest_ns = scan.stamp_ns;
                self.counts.passed += 1;
            }
            Admission::OutOfOrder => {
                self.counts.dropped_out_of_order += 1;
                self.counts.disorders += u64::from(begins);
            }
            Admission::GeometryChanged => {
                self.counts.dropped_geometry += 1;
                self.counts.geometry_changes += u64::from(begins);
            }
        }
        Ok(admission)
    }

    /// Totals.
    #[must_use]
    pub fn counts(&self) -> &GateCounts {
        &self.counts
    }

    /// How the beams of the first scan lie, and how many they are.
    #[must_use]
    pub fn first_geometry(&self) -> Option<(ScanGeometry, usize)> {
        self.first
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    fn scan(stamp_ns: u64, beams: usize) -> LaserScan {
        let geometry = ScanGeometry {
            angle_min_rad: -1.0,
            angle_increment_rad: 0.1,
            range_min_m: 0.0,
            range_max_m: 8.0,
        };
        LaserScan { stamp_ns, device_stamp_ns: 0, geometry, ranges_m: vec![1.0; beams] }
    }

    fn gate(scans: &[(u64, usize)]) -> (String, GateCounts) {
        let mut gate = ScanGate::default();
        let letter = |(stamp_ns, beams): &(u64, usize)| match gate
            .admit(&scan(*stamp_ns, *beams))
            .unwrap()
        {
            Admission::Passes => 'p',
            Admission::OutOfOrder => 'o',
            Admission::GeometryChanged => 'g',
        };
        let letters = scans.iter().map(letter).collect();
        (letters, *gate.counts())
    }

    #[test]
    fn duplicates_and_steps_back_are_dropped_until_time_goes_on() {
        let year_ns = 365 * 24 * 3600 * SECOND_NS;
        let t = 50 * year_ns;
        let stamps = [t, t, t + 1, t + 1 - year_ns, t + 2 - year_ns, t + 2, t + 1];
        let (letters, counts) = gate(&stamps.map(|stamp_ns| (stamp_ns, 5)));
        assert_eq!(letters, "popoopo");
        assert_eq!((counts.passed, counts.dropped_out_of_order, counts.disorders), (3, 4, 3));
    }

    #[test]
    fn beams_that_change_are_dropped_and_a_change_is_counted_once() {
        let (letters, counts) = gate(&[(1, 5), (2, 6), (3, 6), (4, 5), (5, 4), (6, 5)]);
        assert_eq!(letters, "pggpgp");
        assert_eq!((counts.dropped_geometry, counts.geometry_changes), (3, 2));
    }

    #[test]
    fn a_step_of_more_than_a_day_is_refused_in_words() {
        let mut gate = ScanGate::default();
        gate.admit(&scan(1_000, 5)).unwrap();
        gate.admit(&scan(1_000 + STEP_MAX_NS, 5)).unwrap();
        let text = gate.admit(&scan(1_001 + 2 * STEP_MAX_NS, 5)).unwrap_err().to_string();
        assert!(text.starts_with("scan 3 is stamped 172800000001001 ns, 24 h after"), "{text}");
        assert!(text.contains("at most 24 h"), "{text}");
    }

    proptest! {
        #[test]
        fn what_passes_rises_and_every_scan_is_counted(
            scans in prop::collection::vec((0_u64..50, 1_usize..3), 0..60),
        ) {
            let (letters, counts) = gate(&scans);
            let passed: Vec<_> =
                scans.iter().zip(letters.chars()).filter(|(_, l)| *l == 'p').collect();
            prop_assert!(passed.is_sorted_by(|a, b| a.0.0 < b.0.0 && a.0.1 == b.0.1));
            let dropped = counts.dropped_out_of_order + counts.dropped_geometry;
            prop_assert_eq!(counts.passed + dropped, scans.len() as u64);
        }
    }
}
