//! Slots: which scan of which laser is in frame m, and when frame m is complete.
//!
//! Frame m (stamp tau = m*T) holds, for each laser, the newest scan with
//! tau - scan_age_max < stamp <= tau. It is complete as soon as every live laser has delivered a scan
//! stamped after tau (an event-time watermark), or `lateness_max` after tau by the clock.
//! (semantics.md, "Frames")
//!
//! Time is an argument: `now_ns` is the site's clock, or `None` where a recording is replayed without
//! losing a scan; then nothing strikes, and a laser is waited for until its recording ends.

use protocol::time::Lattice;
use std::collections::VecDeque;

/// Most scans that wait for their frame, a laser. Only the newest scan of a slot waits, so this is
/// also how many frames one laser may be ahead of the slowest: 6.4 s at 10 Hz, above any lateness.
pub const SLOTS_MAX: usize = 64;

/// A stamp further ahead of the clock than this is a wrong clock, not a scan: 1 s.
pub const AHEAD_MAX_NS: u64 = 1_000_000_000;

/// The clock may run ahead of the frames by this much before the frames between are skipped: 10 s.
/// The lattice has no holes: a frame that never came counts as unknown everywhere.
pub const BEHIND_MAX_NS: u64 = 10_000_000_000;

/// Timing of an area.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SlotConfig {
    /// The lattice of frames.
    pub lattice: Lattice,
    /// A scan older than this at tau is not in the frame, nanoseconds.
    pub scan_age_max_ns: u64,
    /// A frame is emitted at the latest this long after tau, nanoseconds.
    pub lateness_max_ns: u64,
    /// A laser that is silent for this long is not waited for, nanoseconds.
    pub laser_lost_ns: u64,
    /// Lasers of the area, at most 64.
    pub lasers: usize,
}

/// What became of an arriving scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrival {
    /// It waits for its frame.
    Queued,
    /// It waits, but its own frame was already emitted without it: counted as late.
    Late,
    /// Its stamp is not after the laser's last one: dropped.
    OutOfOrder,
    /// Its stamp is more than [`AHEAD_MAX_NS`] ahead of the clock: dropped.
    FromTheFuture,
    /// [`SLOTS_MAX`] scans of this laser wait already: dropped.
    QueueFull,
}

/// A waiting scan; `T` is what the caller needs to find it again.
#[derive(Debug)]
struct Waiting<T> {
    stamp_ns: u64,
    scan: T,
}

#[derive(Debug)]
struct Lane<T> {
    /// Ascending stamps, at most one a slot.
    waiting: VecDeque<Waiting<T>>,
    /// Stamp of the newest scan that was accepted.
    newest_ns: Option<u64>,
    /// Stamp of the scan that is in the current frame, if one is.
    present_ns: Option<u64>,
    /// Clock at the last arrival; the start of the process before the first.
    arrival_ns: Option<u64>,
    /// The recording of this laser is over.
    ended: bool,
}

/// How a laser changes from the last frame to this one.
#[derive(Debug, PartialEq, Eq)]
pub enum LaneChange<T> {
    /// This scan waited in vain: a newer one is in the frame, or it is too old. Not the last word.
    Superseded(T),
    /// A newer scan is in the frame.
    New(T),
    /// Its last scan is too old: absent.
    Absent,
    /// The same scan as in the last frame.
    Same,
}

/// Why a frame was complete.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Completion {
    /// Every live laser has delivered a later scan.
    Watermark,
    /// `lateness_max` passed.
    Deadline,
}

/// The state machine of an area's slots.
#[derive(Debug)]
pub struct Slots<T> {
    config: SlotConfig,
    lanes: Vec<Lane<T>>,
    /// The next frame, once it is known.
    next: Option<u64>,
    /// True once a frame was emitted: then the lattice does not go back.
    begun: bool,
    started_ns: Option<u64>,
    skipped: u64,
}

impl<T> Slots<T> {
    /// Slots of an area that start at `now_ns` of the site's clock.
    #[must_use]
    pub fn new(config: SlotConfig, now_ns: Option<u64>) -> Self {
        let lane = || Lane {
            waiting: VecDeque::with_capacity(SLOTS_MAX),
            newest_ns: None,
            present_ns: None,
            arrival_ns: now_ns,
            ended: false,
        };
        let lanes = (0..config.lasers).map(|_| lane()).collect();
        Self { config, lanes, next: None, begun: false, started_ns: now_ns, skipped: 0 }
    }

    /// Takes a scan of laser `laser` (index in the area). Scans that are superseded in their slot
    /// are handed to `superseded`.
    pub fn arrive(
        &mut self,
        laser: usize,
        stamp_ns: u64,
        now_ns: Option<u64>,
        scan: T,
        mut superseded: impl FnMut(T),
    ) -> Arrival {
        let lattice = self.config.lattice;
        let lane = &mut self.lanes[laser];
        if now_ns.is_some_and(|now_ns| stamp_ns > now_ns.saturating_add(AHEAD_MAX_NS)) {
            superseded(scan);
            return Arrival::FromTheFuture;
        }
        if lane.newest_ns.is_some_and(|newest_ns| stamp_ns <= newest_ns) {
            superseded(scan);
            return Arrival::OutOfOrder;
        }
        let slot = lattice.first_at_or_after(stamp_ns);
        let full = lane.waiting.len() == SLOTS_MAX;
        match lane.waiting.back_mut() {
            Some(last) if lattice.first_at_or_after(last.stamp_ns) == slot => {
                superseded(std::mem::replace(&mut last.scan, scan));
                last.stamp_ns = stamp_ns;
            }
            _ if full => {
                superseded(scan);
                return Arrival::QueueFull;
            }
            _ => lane.waiting.push_back(Waiting { stamp_ns, scan }),
        }
        lane.newest_ns = Some(stamp_ns);
        lane.arrival_ns = now_ns;
        lane.ended = false;
        match self.next {
            None => self.next = Some(slot),
            Some(next) if slot < next && !self.begun => self.next = Some(slot),
            Some(next) if slot < next => return Arrival::Late,
            Some(_) => {}
        }
        Arrival::Queued
    }

    /// The recording of this laser is over: it is not waited for any more.
    pub fn end(&mut self, laser: usize) {
        self.lanes[laser].ended = true;
    }

    /// True when every laser's recording is over and every frame up to the last stamp was emitted.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.lanes.iter().all(|lane| lane.ended)
            && self.last_number().is_none_or(|last| self.next.is_some_and(|next| next > last))
    }

    /// The last frame that the scans so far can fill: floor(newest stamp / T).
    fn last_number(&self) -> Option<u64> {
        let newest_ns = self.lanes.iter().filter_map(|lane| lane.newest_ns).max()?;
        Some(self.config.lattice.last_at_or_before(newest_ns))
    }

    /// When [`Slots::complete`] must be asked again though nothing arrived: the deadline of the next
    /// frame, by the site's clock.
    #[must_use]
    pub fn deadline_ns(&self) -> Option<u64> {
        let started_ns = self.started_ns?;
        Some(match self.next {
            Some(next) => self.config.lattice.stamp_ns(next) + self.config.lateness_max_ns,
            None => started_ns + self.config.laser_lost_ns,
        })
    }

    /// The next frame, if it is complete at `now_ns`.
    pub fn complete(&mut self, now_ns: Option<u64>) -> Option<(u64, Completion)> {
        if self.next.is_none() {
            // No laser ever spoke: the frames begin all the same, so that silence is seen.
            let (started_ns, now_ns) = (self.started_ns?, now_ns?);
            if now_ns < started_ns + self.config.laser_lost_ns {
                return None;
            }
            self.next = Some(self.config.lattice.first_at_or_after(now_ns));
        }
        self.skip_to_the_clock(now_ns);
        let number = self.next?;
        let tau_ns = self.config.lattice.stamp_ns(number);
        if self.lanes.iter().all(|lane| lane.ended) {
            return (number <= self.last_number()?).then_some((number, Completion::Watermark));
        }
        let lost_ns = self.config.laser_lost_ns;
        let waits_for = |lane: &Lane<T>| {
            let lost = match (now_ns, lane.arrival_ns) {
                (Some(now_ns), Some(arrival_ns)) => now_ns >= arrival_ns.saturating_add(lost_ns),
                _ => false,
            };
            !lane.ended && !lost && lane.newest_ns.is_none_or(|newest_ns| newest_ns <= tau_ns)
        };
        let somebody_is_past = self.lanes.iter().any(|lane| lane.newest_ns > Some(tau_ns));
        if somebody_is_past && !self.lanes.iter().any(waits_for) {
            return Some((number, Completion::Watermark));
        }
        let struck = now_ns.is_some_and(|now| now >= tau_ns + self.config.lateness_max_ns);
        struck.then_some((number, Completion::Deadline))
    }

    fn skip_to_the_clock(&mut self, now_ns: Option<u64>) {
        let (Some(now_ns), Some(next)) = (now_ns, self.next) else { return };
        let earliest_ns = now_ns.saturating_sub(BEHIND_MAX_NS + self.config.lateness_max_ns);
        if self.config.lattice.stamp_ns(next) < earliest_ns {
            let resumed = self.config.lattice.first_at_or_after(earliest_ns);
            self.skipped += resumed - next;
            self.next = Some(resumed);
        }
    }

    /// Frames that were skipped because the clock had run far ahead (a suspended machine).
    #[must_use]
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Emits the frame that [`Slots::complete`] named: for each laser in order, how it changes.
    pub fn emit(&mut self, mut change: impl FnMut(usize, LaneChange<T>)) {
        let Some(number) = self.next else { return };
        let tau_ns = self.config.lattice.stamp_ns(number);
        for (laser, lane) in self.lanes.iter_mut().enumerate() {
            let mut newest: Option<Waiting<T>> = None;
            while lane.waiting.front().is_some_and(|waiting| waiting.stamp_ns <= tau_ns) {
                if let Some(older) = std::mem::replace(&mut newest, lane.waiting.pop_front()) {
                    change(laser, LaneChange::Superseded(older.scan));
                }
            }
            let fresh =
                |stamp_ns: u64| stamp_ns.saturating_add(self.config.scan_age_max_ns) > tau_ns;
            match newest {
                Some(scan) if fresh(scan.stamp_ns) => {
                    lane.present_ns = Some(scan.stamp_ns);
                    change(laser, LaneChange::New(scan.scan));
                }
                Some(stale) => {
                    lane.present_ns = None;
                    change(laser, LaneChange::Superseded(stale.scan));
                    change(laser, LaneChange::Absent);
                }
                None if lane.present_ns.is_some_and(fresh) => change(laser, LaneChange::Same),
                None => {
                    lane.present_ns = None;
                    change(laser, LaneChange::Absent);
                }
            }
        }
        self.next = Some(number + 1);
        self.begun = true;
    }

    /// The scans of a laser that wait for their frame, oldest first.
    pub fn waiting(&self, laser: usize) -> impl Iterator<Item = &T> {
        self.lanes[laser].waiting.iter().map(|waiting| &waiting.scan)
    }

    /// Lasers that have been silent for `laser_lost` at `now_ns`, as bits.
    #[must_use]
    pub fn lost(&self, now_ns: Option<u64>) -> u64 {
        let Some(now_ns) = now_ns else { return 0 };
        let is_lost = |lane: &Lane<T>| {
            lane.arrival_ns.is_some_and(|arrival| now_ns >= arrival + self.config.laser_lost_ns)
        };
        let bit = |(laser, lane)| u64::from(is_lost(lane)) << laser;
        self.lanes.iter().enumerate().map(bit).fold(0, |bits, bit| bits | bit)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use protocol::time::MILLISECOND_NS as MS;

    fn config(lasers: usize) -> SlotConfig {
        SlotConfig {
            lattice: Lattice::new(100 * MS),
            scan_age_max_ns: 250 * MS,
            lateness_max_ns: 150 * MS,
            laser_lost_ns: 1000 * MS,
            lasers,
        }
    }

    /// Emits all complete frames as pictures: `12:ab` = frame 12 holds scans a and b, `-` absent.
    fn frames(slots: &mut Slots<char>, now_ms: Option<u64>, shown: &mut [char]) -> Vec<String> {
        let mut pictures = Vec::new();
        while let Some((number, completion)) = slots.complete(now_ms.map(|ms| ms * MS)) {
            slots.emit(|laser, change| match change {
                LaneChange::New(scan) => shown[laser] = scan,
                LaneChange::Absent => shown[laser] = '-',
                LaneChange::Same | LaneChange::Superseded(_) => {}
            });
            let mark = if completion == Completion::Deadline { "!" } else { "" };
            pictures.push(format!("{number}:{}{mark}", shown.iter().collect::<String>()));
        }
        pictures
    }

    #[test]
    fn a_frame_holds_the_newest_scan_not_after_its_stamp() {
        let mut slots = Slots::new(config(1), None);
        let mut shown = ['?'];
        for (stamp_ms, name) in [(950, 'a'), (990, 'b'), (1010, 'c'), (1105, 'd')] {
            slots.arrive(0, stamp_ms * MS, None, name, |_| {});
        }
        assert_eq!(frames(&mut slots, None, &mut shown), ["10:b", "11:c"]);
        slots.end(0);
        assert_eq!(frames(&mut slots, None, &mut shown), Vec::<String>::new());
        assert!(slots.is_over());
    }

    #[test]
    fn a_scan_is_held_for_its_age_and_then_the_laser_is_absent() {
        let mut slots = Slots::new(config(1), None);
        let mut shown = ['?'];
        slots.arrive(0, 1000 * MS, None, 'a', |_| {});
        slots.arrive(0, 1500 * MS, None, 'b', |_| {});
        slots.end(0);
        // 250 ms: stamp > tau - 250 ms holds for 1000, 1100, 1200; at 1250 it would not.
        assert_eq!(
            frames(&mut slots, None, &mut shown),
            ["10:a", "11:a", "12:a", "13:-", "14:-", "15:b"]
        );
    }

    #[test]
    fn without_a_clock_a_frame_waits_for_the_slowest_laser_until_its_recording_ends() {
        let mut slots = Slots::new(config(2), None);
        let mut shown = ['?', '?'];
        slots.arrive(0, 1000 * MS, None, 'a', |_| {});
        slots.arrive(0, 1101 * MS, None, 'b', |_| {});
        assert_eq!(frames(&mut slots, None, &mut shown), Vec::<String>::new());
        slots.arrive(1, 930 * MS, None, 'x', |_| {});
        assert_eq!(frames(&mut slots, None, &mut shown), Vec::<String>::new());
        slots.end(1);
        assert_eq!(frames(&mut slots, None, &mut shown), ["10:ax", "11:ax"]);
        slots.end(0);
        assert_eq!(frames(&mut slots, None, &mut shown), Vec::<String>::new());
        assert!(slots.is_over());
    }

    #[test]
    fn the_first_frame_follows_the_first_stamp_of_all_lasers() {
        let mut slots = Slots::new(config(2), None);
        let mut shown = ['?', '?'];
        slots.arrive(0, 1250 * MS, None, 'a', |_| {});
        slots.arrive(1, 1010 * MS, None, 'x', |_| {});
        slots.arrive(1, 1310 * MS, None, 'y', |_| {});
        slots.end(0);
        slots.end(1);
        assert_eq!(frames(&mut slots, None, &mut shown), ["11:-x", "12:-x", "13:a-"]);
    }

    #[test]
    fn a_deadline_emits_without_the_late_laser_and_counts_it() {
        let mut slots = Slots::new(config(2), Some(0));
        let mut shown = ['?', '?'];
        slots.arrive(0, 1000 * MS, Some(1000 * MS), 'a', |_| {});
        slots.arrive(0, 1101 * MS, Some(1101 * MS), 'b', |_| {});
        slots.arrive(1, 905 * MS, Some(1101 * MS), 'x', |_| {});
        assert_eq!(frames(&mut slots, Some(1149), &mut shown), Vec::<String>::new());
        assert_eq!(slots.deadline_ns(), Some(1150 * MS));
        assert_eq!(frames(&mut slots, Some(1150), &mut shown), ["10:ax!"]);
        let late = slots.arrive(1, 1000 * MS, Some(1160 * MS), 'y', |_| {});
        assert_eq!(late, Arrival::Late);
        // Here: a late scan is left out of the frames that were emitted, not of those to come.
        assert_eq!(frames(&mut slots, Some(1250), &mut shown), ["11:ay!"]);
    }

    #[test]
    fn a_silent_laser_is_not_waited_for() {
        let mut slots = Slots::new(config(2), Some(5000 * MS));
        let mut shown = ['?', '?'];
        slots.arrive(0, 6000 * MS, Some(6000 * MS), 'a', |_| {});
        slots.arrive(0, 6100 * MS, Some(6100 * MS), 'b', |_| {});
        // Laser 1 never spoke: 1 s after the start it is lost, and the watermark is laser 0 alone.
        assert_eq!(frames(&mut slots, Some(6100), &mut shown), ["60:a-"]);
        assert_eq!(slots.lost(Some(6100 * MS)), 0b10);
    }

    #[test]
    fn frames_begin_even_if_no_laser_ever_speaks() {
        let mut slots = Slots::<char>::new(config(1), Some(50 * MS));
        let mut shown = ['?'];
        assert_eq!(slots.deadline_ns(), Some(1050 * MS));
        assert_eq!(frames(&mut slots, Some(1049), &mut shown), Vec::<String>::new());
        assert_eq!(frames(&mut slots, Some(1050), &mut shown), Vec::<String>::new());
        assert_eq!(frames(&mut slots, Some(1250), &mut shown), ["11:-!"]);
    }

    #[test]
    fn doubles_and_stamps_that_go_back_are_dropped() {
        let mut slots = Slots::new(config(1), None);
        let mut dropped = Vec::new();
        slots.arrive(0, 1000 * MS, None, 'a', |_| {});
        assert_eq!(
            slots.arrive(0, 1000 * MS, None, 'b', |scan| dropped.push(scan)),
            Arrival::OutOfOrder
        );
        assert_eq!(
            slots.arrive(0, 999 * MS, None, 'c', |scan| dropped.push(scan)),
            Arrival::OutOfOrder
        );
        assert_eq!(dropped, ['b', 'c']);
    }

    #[test]
    fn a_stamp_ahead_of_the_clock_does_not_poison_the_laser() {
        let mut slots = Slots::new(config(1), Some(0));
        let year_ns = 365 * 86_400_000 * MS;
        assert_eq!(slots.arrive(0, year_ns, Some(1000 * MS), 'a', |_| {}), Arrival::FromTheFuture);
        assert_eq!(slots.arrive(0, 1000 * MS, Some(1000 * MS), 'b', |_| {}), Arrival::Queued);
    }

    #[test]
    fn a_suspended_machine_skips_frames_instead_of_a_burst() {
        let mut slots = Slots::new(config(1), Some(0));
        let mut shown = ['?'];
        slots.arrive(0, 1000 * MS, Some(1000 * MS), 'a', |_| {});
        let hour_later_ms = 3_601_000;
        let emitted = frames(&mut slots, Some(hour_later_ms), &mut shown);
        assert_eq!(emitted.len(), 100);
        assert_eq!(slots.skipped(), 35_900 - 1);
    }

    #[test]
    fn a_laser_that_runs_ahead_is_bounded() {
        let mut slots = Slots::new(config(2), None);
        let mut outcomes = Vec::new();
        for slot in 0..=SLOTS_MAX as u64 {
            outcomes.push(slots.arrive(0, (1000 + 100 * slot) * MS, None, 'a', |_| {}));
        }
        assert_eq!(outcomes.pop(), Some(Arrival::QueueFull));
        assert!(outcomes.iter().all(|outcome| *outcome == Arrival::Queued));
    }
}
