//! The core of fusion: scans in, frames out, no clock and no IO.
//!
//! [`FusionCore::scan`] takes what arrives, [`FusionCore::next_frame`] gives every frame that is
//! complete. The caller decides when to ask, so that a reader that cannot keep up in a lossless
//! replay holds everything back to the lasers. Nothing is allocated after the first scans.

use crate::slot::{Arrival, Completion, LaneChange, SlotConfig, Slots};
use occupancy::{Fuser, LaserModel};
use protocol::frame::FrameView;
use protocol::geometry::Pose;
use protocol::scan::{BEAMS_MAX, ScanGeometry, ScanView};
use protocol::site::{Area, Laser, NoReturn};

/// Where a scan came from: what a lossless publisher is told when the scan is finished with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Origin {
    /// Index of the laser in the area.
    pub laser: usize,
    /// Session of its publisher.
    pub session: u64,
    /// Sequence in the session.
    pub seq: u64,
    /// CLOCK_MONOTONIC at its publication, nanoseconds.
    pub published_mono_ns: u64,
}

/// Why a scan did not come as far as the slots.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ScanRefused {
    /// Not a laser of this area.
    #[error("a scan of laser number {found}, this area has {lasers}")]
    Laser {
        /// Index in the scan.
        found: usize,
        /// Lasers of the area.
        lasers: usize,
    },
    /// Nonsense numbers.
    #[error("{0}; the scan is dropped")]
    Geometry(String),
    /// Other beams than before.
    #[error(
        "the laser changed its beams: found {found_beams} beams {found}, expected \
         {expected_beams} {expected} as at the start; its scans are dropped until this area \
         is restarted"
    )]
    GeometryChanged {
        /// Beams of the scan.
        found_beams: usize,
        /// Geometry of the scan.
        found: ScanGeometry,
        /// Beams of the first scan.
        expected_beams: usize,
        /// Geometry of the first scan.
        expected: ScanGeometry,
    },
}

/// What was counted since the start.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Scans that arrived.
    pub scans_in: u64,
    /// Scans of a frame that was already emitted.
    pub scans_late: u64,
    /// Scans whose stamp was not after the laser's last.
    pub scans_out_of_order: u64,
    /// Scans stamped ahead of the clock.
    pub scans_from_the_future: u64,
    /// Scans dropped because the laser ran too far ahead of the others.
    pub scans_queue_full: u64,
    /// Scans with nonsense or changed geometry, or of no laser of the area.
    pub scans_refused: u64,
    /// Scans that a newer scan of the same slot made needless: normal for fast lasers.
    pub scans_superseded: u64,
    /// Frames emitted.
    pub frames_out: u64,
    /// Of these, by the deadline.
    pub frames_by_deadline: u64,
    /// Frames skipped because the clock was far ahead.
    pub frames_skipped: u64,
}

/// A complete frame; the planes are valid until the next call.
#[derive(Debug, Clone, Copy)]
pub struct FrameOut<'a> {
    /// m.
    pub number: u64,
    /// Bit plane of hits.
    pub hit: &'a [u64],
    /// Bit plane of known cells.
    pub known: &'a [u64],
    /// Cells that may differ from the frame before, each once.
    pub changed_cells: &'a [u32],
    /// Bit i: laser i of the area is in this frame.
    pub lasers_present: u64,
    /// Publication of the scan that completed it, CLOCK_MONOTONIC; 0 if a deadline did.
    pub completed_by_mono_ns: u64,
}

impl<'a> FrameOut<'a> {
    /// The planes for the grid.
    #[must_use]
    pub fn view(&self) -> FrameView<'a> {
        FrameView { number: self.number, hit: self.hit, known: self.known }
    }
}

#[derive(Debug)]
struct Stored {
    origin: Origin,
    ranges_m: Vec<f32>,
}

/// What the site file says of a laser, for the sensor model.
#[derive(Debug, Clone, Copy)]
struct Mounting {
    pose: Pose,
    half_beam_rad: Option<f64>,
    no_return_is_free: bool,
}

/// Fusion of one area.
pub struct FusionCore {
    slots: Slots<Stored>,
    fuser: Fuser,
    mountings: Vec<Mounting>,
    range_tolerance_m: f64,
    /// Geometry and beams of each laser's first scan.
    installed: Vec<Option<(ScanGeometry, usize)>>,
    pool: Vec<Stored>,
    /// The newest scan of each laser that is finished with and not told yet.
    finished: Vec<Option<Origin>>,
    lasers_present: u64,
    completed_by_mono_ns: u64,
    counts: Counts,
}

impl FusionCore {
    /// Fusion of `area` with its `lasers` (order of the site file), from `now_ns` of the site's
    /// clock; `None` where a recording is replayed without a clock.
    #[must_use]
    pub fn new(area: &Area, lasers: &[&Laser], now_ns: Option<u64>) -> Self {
        let config = SlotConfig {
            lattice: area.lattice(),
            scan_age_max_ns: area.scan_age_max_ns(),
            lateness_max_ns: area.lateness_max_ns(),
            laser_lost_ns: area.laser_lost_ns(),
            lasers: lasers.len(),
        };
        let mounting = |laser: &&Laser| Mounting {
            pose: laser.pose(),
            half_beam_rad: laser.half_beam_deg.map(f64::to_radians),
            no_return_is_free: laser.no_return == NoReturn::Free,
        };
        Self {
            slots: Slots::new(config, now_ns),
            fuser: Fuser::new(area.grid(), lasers.len()),
            mountings: lasers.iter().map(mounting).collect(),
            range_tolerance_m: area.range_tolerance_m(),
            installed: vec![None; lasers.len()],
            pool: Vec::new(),
            finished: vec![None; lasers.len()],
            lasers_present: 0,
            completed_by_mono_ns: 0,
            counts: Counts::default(),
        }
    }

    /// Takes a scan that arrived at `now_ns`.
    ///
    /// # Errors
    /// [`ScanRefused`] if it cannot be fused; it is counted, and finished with.
    pub fn scan(
        &mut self,
        origin: Origin,
        scan: ScanView<'_>,
        now_ns: Option<u64>,
    ) -> Result<Arrival, ScanRefused> {
        self.counts.scans_in += 1;
        if let Err(refused) = self.admit(origin.laser, &scan) {
            self.counts.scans_refused += 1;
            finish(&mut self.finished, origin);
            return Err(refused);
        }
        let mut stored = self.pool.pop().unwrap_or_else(|| Stored { origin, ranges_m: Vec::new() });
        stored.origin = origin;
        stored.ranges_m.clear();
        stored.ranges_m.extend_from_slice(scan.ranges_m);

        let (pool, finished) = (&mut self.pool, &mut self.finished);
        let mut superseded = 0;
        let arrival = self.slots.arrive(origin.laser, scan.stamp_ns, now_ns, stored, |old| {
            superseded += 1;
            finish(finished, old.origin);
            pool.push(old);
        });
        match arrival {
            Arrival::Queued => self.counts.scans_superseded += superseded,
            Arrival::Late => self.counts.scans_late += 1,
            Arrival::OutOfOrder => self.counts.scans_out_of_order += 1,
            Arrival::FromTheFuture => self.counts.scans_from_the_future += 1,
            Arrival::QueueFull => self.counts.scans_queue_full += 1,
        }
        if matches!(arrival, Arrival::Queued | Arrival::Late) {
            self.completed_by_mono_ns = origin.published_mono_ns;
        }
        Ok(arrival)
    }

    /// Checks the scan against its laser's first one, which builds the sensor model.
    fn admit(&mut self, laser: usize, scan: &ScanView<'_>) -> Result<(), ScanRefused> {
        let Some(mounting) = self.mountings.get(laser) else {
            return Err(ScanRefused::Laser { found: laser, lasers: self.mountings.len() });
        };
        let beams = scan.ranges_m.len();
        if let Some((expected, expected_beams)) = self.installed[laser] {
            if expected == scan.geometry && expected_beams == beams {
                return Ok(());
            }
            return Err(ScanRefused::GeometryChanged {
                found_beams: beams,
                found: scan.geometry,
                expected_beams,
                expected,
            });
        }
        scan.geometry.check().map_err(ScanRefused::Geometry)?;
        if beams == 0 || beams > BEAMS_MAX {
            let found = format!("a scan of {beams} beams, expected 1..={BEAMS_MAX}");
            return Err(ScanRefused::Geometry(found));
        }
        let model = LaserModel {
            pose: mounting.pose,
            geometry: scan.geometry,
            beams,
            half_beam_rad: mounting.half_beam_rad,
            range_tolerance_m: self.range_tolerance_m,
            no_return_is_free: mounting.no_return_is_free,
        };
        self.fuser.install(laser, &model);
        self.installed[laser] = Some((scan.geometry, beams));
        Ok(())
    }

    /// Geometry and beams of a laser's first scan, which fix its sensor model.
    #[must_use]
    pub fn geometry(&self, laser: usize) -> Option<(ScanGeometry, usize)> {
        self.installed.get(laser).copied().flatten()
    }

    /// The recording of this laser is over.
    pub fn end(&mut self, laser: usize) {
        if laser < self.mountings.len() {
            self.slots.end(laser);
        }
    }

    /// The next frame, if it is complete at `now_ns`.
    pub fn next_frame(&mut self, now_ns: Option<u64>) -> Option<FrameOut<'_>> {
        let (number, completion) = self.slots.complete(now_ns)?;
        let (fuser, counts) = (&mut self.fuser, &mut self.counts);
        fuser.clear_changed();
        let (pool, finished) = (&mut self.pool, &mut self.finished);
        let present = &mut self.lasers_present;
        self.slots.emit(|laser, change| match change {
            LaneChange::New(scan) => {
                fuser.apply(laser, &scan.ranges_m);
                *present |= 1 << laser;
                finish(finished, scan.origin);
                pool.push(scan);
            }
            LaneChange::Superseded(scan) => {
                counts.scans_superseded += 1;
                finish(finished, scan.origin);
                pool.push(scan);
            }
            LaneChange::Absent => {
                if *present >> laser & 1 == 1 {
                    fuser.retract(laser);
                }
                *present &= !(1 << laser);
            }
            LaneChange::Same => {}
        });
        self.counts.frames_out += 1;
        self.counts.frames_skipped = self.slots.skipped();
        let by_deadline = completion == Completion::Deadline;
        self.counts.frames_by_deadline += u64::from(by_deadline);
        Some(FrameOut {
            number,
            hit: self.fuser.hit(),
            known: self.fuser.known(),
            changed_cells: self.fuser.changed_cells(),
            lasers_present: self.lasers_present,
            completed_by_mono_ns: if by_deadline { 0 } else { self.completed_by_mono_ns },
        })
    }

    /// Up to where the scans of each laser are finished with (superseded, applied or dropped), if
    /// that moved: the origin that is named, and all before it of its session.
    ///
    /// A scan may be superseded while older ones still wait for their frames; then it is not told
    /// before them, or its laser would take them for done and run further ahead than there is room.
    pub fn drain_finished(&mut self) -> impl Iterator<Item = Origin> + '_ {
        let slots = &self.slots;
        self.finished.iter_mut().enumerate().filter_map(|(laser, finished)| {
            let done = (*finished)?;
            let mut waiting = slots.waiting(laser).map(|scan| scan.origin);
            match waiting.find(|origin| origin.session == done.session) {
                Some(oldest) if oldest.seq <= done.seq => {
                    Some(Origin { seq: oldest.seq.checked_sub(1)?, ..done })
                }
                _ => finished.take(),
            }
        })
    }

    /// When [`FusionCore::next_frame`] must be asked though nothing arrived.
    #[must_use]
    pub fn deadline_ns(&self) -> Option<u64> {
        self.slots.deadline_ns()
    }

    /// True when all recordings are over and all frames are out.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.slots.is_over()
    }

    /// Lasers that are silent, as bits.
    #[must_use]
    pub fn lost(&self, now_ns: Option<u64>) -> u64 {
        self.slots.lost(now_ns)
    }

    /// What was counted.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }
}

/// Notes that a scan is finished with.
fn finish(finished: &mut [Option<Origin>], origin: Origin) {
    if let Some(newest) = finished.get_mut(origin.laser) {
        let is_newer =
            |newest: &Origin| (origin.session, origin.seq) > (newest.session, newest.seq);
        if newest.as_ref().is_none_or(is_newer) {
            *newest = Some(origin);
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use protocol::time::MILLISECOND_NS as MS;

    const GEOMETRY: ScanGeometry = ScanGeometry {
        angle_min_rad: 0.0,
        angle_increment_rad: 0.1,
        range_min_m: 0.1,
        range_max_m: 8.0,
    };

    fn fusion(lasers: usize) -> FusionCore {
        let laser = |n| {
            serde_json::json!({ "id": format!("l{n}"), "area": "a", "x_m": 0.0, "y_m": 0.0,
                "source": { "kind": "simulator", "scene": "none" } })
        };
        let site: protocol::site::Site = serde_json::from_value(serde_json::json!({
            "name": "s",
            "area": [{ "id": "a", "origin_m": [0.0, 0.0], "columns": 8, "rows": 8 }],
            "laser": (0..lasers).map(laser).collect::<Vec<_>>(),
        }))
        .unwrap();
        FusionCore::new(&site.areas[0], &site.lasers.iter().collect::<Vec<_>>(), None)
    }

    /// Offers the scan with this number; stamps are 60 ms apart, so that some frames have two.
    fn offer(fusion: &mut FusionCore, laser: usize, seq: u64, beams: usize) {
        let origin = Origin { laser, session: 7, seq, published_mono_ns: 0 };
        let ranges_m = vec![1.0; beams];
        let stamp_ns = (1000 + 60 * seq) * MS;
        let scan = ScanView { stamp_ns, geometry: GEOMETRY, ranges_m: &ranges_m };
        let _ = fusion.scan(origin, scan, None);
    }

    fn told(fusion: &mut FusionCore) -> Vec<(usize, u64)> {
        fusion.drain_finished().map(|origin| (origin.laser, origin.seq)).collect()
    }

    #[test]
    fn a_scan_is_not_finished_with_before_an_older_one_that_waits() {
        let mut fusion = fusion(2);
        // Frames at 1000, 1100, 1200 ms: scans 0 | 1 | 2, 3 (3 at 1180 takes the place of 2).
        (0..4).for_each(|seq| offer(&mut fusion, 0, seq, 5));
        assert_eq!(fusion.counts().scans_superseded, 1);
        assert!(told(&mut fusion).is_empty(), "0 still waits");
        offer(&mut fusion, 0, 4, 3);
        assert_eq!(fusion.counts().scans_refused, 1);
        assert!(told(&mut fusion).is_empty(), "4 is refused, but 0 still waits");
        offer(&mut fusion, 1, 2, 5); // at 1120 ms
        assert!(fusion.next_frame(None).is_some());
        assert_eq!(told(&mut fusion), [(0, 0)]);
        assert!(fusion.next_frame(None).is_some());
        assert_eq!(told(&mut fusion), [(0, 2)], "3 still waits, 2 was superseded by it");
        fusion.end(1);
        offer(&mut fusion, 0, 5, 5);
        assert!(fusion.next_frame(None).is_some());
        assert_eq!(told(&mut fusion), [(0, 4), (1, 2)], "5 waits");
    }
}
