//! What a watch does in each phase: learning, calibrating, watching; and the slow work between.

use crate::door;
use crate::ledger::Entry;
use crate::life::{Levels, OFF};
use crate::place::{bounds_of, for_each_cell};
use crate::sense::Region;
use crate::threshold::{Peaks, level};
use crate::watch::{ClassFrame, PERSIST_S, Phase, Watch};
use crate::words::{self, Certainty};
use protocol::event::{EventChange, EventState};
use protocol::site::Area;
use protocol::time::SECOND_NS;

/// Least levels, whatever the calibration says: one that was short or all quiet must not make an
/// area cry at two odd cells, or at somebody who pauses for ten seconds. In space, three cells
/// without precedent (4 nats each above the least evidence); in time, 17 s of one.
pub(crate) const FLOOR_SPACE: f64 = 6.5;
pub(crate) const FLOOR_TIME: f64 = 60.0;
/// Slow work (charges, shadows, doors, coverage) is done twice a second.
const TICK_S: f64 = 0.5;
/// The whole map is taken stock of, and scored anew, once in a minute of frames, a part in each.
pub(crate) const STOCK_S: f64 = 60.0;
/// Doors are looked for once an hour.
const STOCKS_TO_FIND_DOORS: u64 = 60;
/// Nothing is learnt this near to an event, metres.
const MARGIN_M: f64 = 0.5;
/// Least time without learning where an event was, beyond the longest timescale.
const QUARANTINE_NS: u64 = 60 * SECOND_NS;
/// Most places in quarantine; the oldest gives way. As many as there can be happenings.
const QUARANTINE_MAX: usize = 64;

impl Watch {
    /// The slow work; true if it was done in this frame.
    pub(crate) fn due(
        &mut self,
        frame: &ClassFrame<'_>,
        blind: bool,
        stamp_ns: u64,
        changes: &mut Vec<EventChange>,
    ) -> bool {
        let now = frame.number as u32;
        if self.sense.survey(u64::from(self.lattice.frames_in(STOCK_S)), now) {
            self.stocks += 1;
            if self.phase != Phase::Learning && self.stocks.is_multiple_of(STOCKS_TO_FIND_DOORS) {
                self.find_doors(stamp_ns, changes);
            }
        }
        if self.frames_to_tick > 0 {
            self.frames_to_tick -= 1;
            return false;
        }
        self.frames_to_tick = u64::from(self.lattice.frames_in(TICK_S)) - 1;
        self.sense.weigh_absences(frame.lasers_present, blind, now);
        self.supervise_coverage(stamp_ns, changes);
        if self.phase == Phase::Watching {
            if !self.doors_pending.is_empty() {
                self.find_doors(stamp_ns, changes);
            }
            if !blind {
                self.watch_doors(frame.lasers_present, stamp_ns, changes);
            }
        }
        self.hold(stamp_ns);
        true
    }

    pub(crate) fn advance_phase(&mut self, now: u32, blind: bool) {
        let detector = &self.area.detector;
        match self.phase {
            Phase::Learning if self.sense.normal.learnt_s() >= detector.learning_s => {
                self.phase = Phase::Calibrating;
                self.sense.take_stock();
                self.doors = self.sense.find_doors();
                self.sense.set_scoring(true, now);
                self.notice(format!(
                    "learnt {} of normal life, found {} doors; {}",
                    words::duration(self.sense.normal.learnt_s()),
                    self.doors.len(),
                    self.phase_words(),
                ));
            }
            Phase::Calibrating if !blind => {
                self.calibration.frames += 1;
                if self.calibrated_s() >= detector.calibration_s {
                    self.phase = Phase::Watching;
                    self.set_levels();
                    self.sense.take_stock();
                    self.doors = self.sense.find_doors();
                    self.sense.set_scoring(true, now);
                    self.notice(self.watching_words());
                }
            }
            _ => {}
        }
    }

    /// Both levels from the peaks, half of the budget each.
    pub(crate) fn set_levels(&mut self) {
        let budget = self.area.detector.alarms_per_week_max / 2.0;
        let duration_s = self.calibrated_s();
        let of = |peaks: &Peaks, floor| level(&peaks.declustered(), duration_s, budget, floor);
        self.space = of(&self.calibration.space, FLOOR_SPACE);
        self.time = of(&self.calibration.time, FLOOR_TIME);
    }

    /// The phase, how far it is, and from when on unusual events are told:
    /// `learning, 3 min of 10 min; until unusual events are told it needs 17 min of normal life more`.
    #[must_use]
    pub fn phase_words(&self) -> String {
        let detector = &self.area.detector;
        let (learnt_s, calibrated_s) = (self.learnt_s(), self.calibrated_s());
        let calibration_s = (detector.calibration_s - calibrated_s).max(0.0);
        let (done_s, goal_s, left_s) = match self.phase {
            Phase::Learning => {
                let learning_s = (detector.learning_s - learnt_s).max(0.0);
                (learnt_s, detector.learning_s, learning_s + calibration_s)
            }
            Phase::Calibrating => (calibrated_s, detector.calibration_s, calibration_s),
            Phase::Watching => return self.watching_words(),
        };
        format!(
            "{}, {} of {}; until unusual events are told it needs {} of normal life more, until then \
             only faults are told",
            self.phase.words(),
            words::duration(done_s),
            words::duration(goal_s),
            words::duration(left_s),
        )
    }

    pub(crate) fn watching_words(&self) -> String {
        format!(
            "watching with {} doors; levels {:.1} in space and {:.1} in time for at most {} alarms a \
             week, {} {} of calibration",
            self.doors.len(),
            self.space.on,
            self.time.on,
            self.area.detector.alarms_per_week_max,
            if self.extrapolated() { "extrapolated from" } else { "proven by" },
            words::duration(self.calibrated_s()),
        )
    }

    fn cells_min(&self) -> usize {
        let cell_m2 = self.area.cell_m * self.area.cell_m;
        ((self.area.detector.area_min_m2 / cell_m2 - 1e-9).ceil()).max(1.0) as usize
    }

    pub(crate) fn calibrate(&mut self, now: u32, tick: bool) {
        let time_s = self.calibrated_s();
        let mut regions = std::mem::take(&mut self.space_regions);
        if self.sense.space_regions(self.cells_min(), 0.0, &mut regions) {
            self.space_score = regions.iter().map(|region| region.score).fold(0.0, f64::max);
        }
        self.space_regions = regions;
        let persist = self.lattice.frames_in(PERSIST_S) as usize;
        self.recent.push_back(self.space_score);
        if self.recent.len() > persist {
            self.recent.pop_front();
        }
        if self.recent.len() == persist {
            let lasting = self.recent.iter().copied().fold(f64::INFINITY, f64::min);
            self.calibration.space.observe(time_s, lasting);
        }
        if tick {
            let highest = self.sense.time_regions(now, f64::INFINITY, &mut self.time_regions);
            self.calibration.time.observe(time_s, highest);
        }
    }

    pub(crate) fn watch(
        &mut self,
        now: u32,
        tick: bool,
        stamp_ns: u64,
        changes: &mut Vec<EventChange>,
    ) {
        let levels = Levels { space: self.space.on, time: self.time.on };
        let cells_min = self.cells_min();
        self.sense.space_regions(1, 0.0, &mut self.space_regions);
        if tick {
            self.sense.time_regions(now, OFF * levels.time, &mut self.time_regions);
        }
        let strong = |region: &&Region| {
            region.cells as usize >= cells_min && region.score >= OFF * levels.space
        };
        let space = self.space_regions.iter().filter(strong);
        let regions = space.chain(&self.time_regions).copied();
        let open_doors = &self.doors;
        let cell_m = self.area.cell_m;
        let grid = self.sense.grid;
        let regions = regions
            .filter(|region| !door::explains(open_doors, bounds_of(&grid, region.span), cell_m));
        let certainty = Certainty {
            budget_per_week: self.area.detector.alarms_per_week_max,
            extrapolated: self.space.extrapolated || self.time.extrapolated,
            calibrated_s: self.calibration.frames as f64 * self.period_s,
        };
        let (ledger, sense, quarantine) = (&mut self.ledger, &self.sense, &mut self.quarantine);
        let quiet_ns = quarantine_ns(&self.area);
        self.life.step(stamp_ns, regions, &self.space_regions, levels, |happening, state| {
            if happening.number == 0 {
                happening.number = ledger.number();
            }
            let place = ledger.place(happening.centre_m);
            let text = if state == EventState::Cleared {
                if quarantine.len() == QUARANTINE_MAX {
                    quarantine.pop_front();
                }
                quarantine.push_back((happening.trail, stamp_ns.saturating_add(quiet_ns)));
                let seconds = happening.seen_ns.saturating_sub(happening.first_ns) as f64 * 1e-9;
                words::cleared("Nothing unusual is seen any more", &place, seconds)
            } else {
                words::happening(happening, state, sense, &place, stamp_ns, certainty)
            };
            changes.push(ledger.change(Entry {
                number: happening.number,
                kind: happening.kind,
                state,
                stamp_ns,
                first_ns: happening.first_ns,
                at_m: happening.centre_m,
                bounds: happening.bounds,
                score: happening.score,
                threshold: happening.level,
                extrapolated: certainty.extrapolated,
                text,
            }));
        });
        self.counters.happenings_dropped = self.life.dropped;
    }

    /// Nothing is learnt where an event is or was a short time ago.
    fn hold(&mut self, stamp_ns: u64) {
        self.quarantine.retain(|(_, until_ns)| *until_ns > stamp_ns);
        if self.held.is_empty() && self.quarantine.is_empty() && self.life.happenings.is_empty() {
            return;
        }
        let trails = self.life.happenings.iter().map(|happening| happening.trail);
        let quiet = self.quarantine.iter().map(|(bounds, _)| *bounds);
        let doors = self.doors.iter().filter(|door| door.event.is_some()).map(|door| door.bounds);
        let boxes = || trails.clone().chain(quiet.clone()).chain(doors.clone());
        if boxes().eq(self.held_boxes.iter().copied()) {
            return;
        }
        self.held_boxes = boxes().collect();
        self.held.clear();
        for bounds in &self.held_boxes {
            let held = &mut self.held;
            for_each_cell(&self.sense.grid, *bounds, MARGIN_M, |cell| held.set(cell, true));
        }
        self.sense.hold(&self.held);
    }
}

fn quarantine_ns(area: &Area) -> u64 {
    let longest_s = area.timescales_s.last().copied().unwrap_or(0.0);
    QUARANTINE_NS + (longest_s * SECOND_NS as f64) as u64
}
