//! The core of an area: class maps in, changes of events out.

use crate::door::{self, Door};
use crate::ledger::{Entry, Ledger, number_of};
use crate::life::{Levels, Life, OFF};
use crate::normal::Normal;
use crate::place::{bounds_of, contains, for_each_cell, grid_bounds};
use crate::plane::Plane;
use crate::role::Roles;
use crate::sense::{Region, Sense};
use crate::shadow::Eyes;
use crate::supervise::Debounced;
use crate::threshold::{Level, Peaks, level};
use crate::words::{self, Certainty};
use protocol::event::{EventChange, EventKind, EventState};
use protocol::site::{Area, Laser};
use protocol::time::{Lattice, SECOND_NS};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Least levels: below, an area that was all quiet during calibration would cry at two odd cells.
const FLOOR_SPACE: f64 = 9.0;
const FLOOR_TIME: f64 = 40.0;
/// A score must last this long to count: a walker, a crowd, an object do; a reflection does not.
const PERSIST_S: f64 = 0.5;
/// Slow work (charges, shadows, doors, coverage) is done twice a second.
const TICK_S: f64 = 0.5;
/// The whole map is taken stock of, and scored anew, once a minute of frames.
const STOCK_S: f64 = 60.0;
/// After a fault or a gap, the averages of the middle timescale still hold what was not seen.
const MARGIN_M: f64 = 0.5;
/// Least time without learning where an event was, beyond the longest timescale.
const QUARANTINE_NS: u64 = 60 * SECOND_NS;
/// Most places in quarantine; the oldest gives way. As many as there can be happenings.
const QUARANTINE_MAX: usize = 64;
/// Most notices that wait to be read: a reader that never reads must not cost memory.
const NOTICES_MAX: usize = 100;

/// One class map, as published by the mapper.
#[derive(Debug, Clone, Copy)]
pub struct ClassFrame<'a> {
    /// m: the frame's stamp is m * T.
    pub number: u64,
    /// Bit i: the i-th laser of the area (order of the site file) has a scan in this frame.
    pub lasers_present: u64,
    /// Index of the context that the stamp falls into; 0 where the site file names none.
    pub context: usize,
    /// Class of every cell, [row, column]; 255 is unknown.
    pub classes: &'a [u8],
}

/// How far an area has learnt.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Phase {
    /// Collecting what is normal; no events but faults.
    Learning,
    /// Measuring how high normal life scores; no events but faults.
    Calibrating,
    /// Raising events.
    Watching,
}

impl Phase {
    /// `learning`, `calibrating`, `watching`.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Learning => "learning",
            Self::Calibrating => "calibrating",
            Self::Watching => "watching",
        }
    }
}

/// What the core counts; see [`Watch::counters`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Class maps taken.
    pub frames_in: u64,
    /// Lattice places between class maps that never came.
    pub frames_missed: u64,
    /// Class maps at or before the last one.
    pub frames_stale: u64,
    /// Class maps of another size.
    pub frames_refused: u64,
    /// Candidates that found no room.
    pub happenings_dropped: u64,
}

/// How normal life scored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Calibration {
    pub(crate) frames: u64,
    pub(crate) space: Peaks,
    pub(crate) time: Peaks,
}

impl Calibration {
    fn new(calibration_s: f64) -> Self {
        Self { frames: 0, space: Peaks::new(calibration_s), time: Peaks::new(calibration_s) }
    }
}

/// Watches one area. Pure: time is the number of the frame.
#[derive(Debug, Clone)]
pub struct Watch {
    pub(crate) area: Area,
    pub(crate) lasers: Vec<Laser>,
    pub(crate) lattice: Lattice,
    pub(crate) period_s: f64,
    pub(crate) sense: Sense,
    pub(crate) phase: Phase,
    pub(crate) calibration: Calibration,
    pub(crate) space: Level,
    pub(crate) time: Level,
    pub(crate) life: Life,
    pub(crate) ledger: Ledger,
    pub(crate) doors: Vec<Door>,
    /// Door events from before a restart that wait for their door.
    pub(crate) doors_pending: Vec<(u64, EventChange)>,
    pub(crate) silent: Vec<Debounced>,
    pub(crate) absent_frames: Vec<u64>,
    pub(crate) coverage: Debounced,
    /// First evidence of open faults by number, for their last words.
    pub(crate) fault_first_ns: Vec<(u64, u64)>,
    pub(crate) first_ns: Option<u64>,
    last: Option<u64>,
    /// Absence is no evidence and nothing is learnt before this frame.
    blind_until: u64,
    frames_to_tick: u64,
    frames_to_stock: u64,
    stocks: u64,
    space_regions: Vec<Region>,
    time_regions: Vec<Region>,
    space_score: f64,
    recent: VecDeque<f64>,
    quarantine: VecDeque<([f64; 4], u64)>,
    held: Plane,
    pub(crate) counters: Counters,
    pub(crate) notices: Vec<String>,
}

impl Watch {
    /// The core of `area`. `lasers` are those of the area, in the order of the site file (others are
    /// left out here).
    #[must_use]
    pub fn new(area: &Area, lasers: &[Laser]) -> Self {
        let grid = area.grid();
        let lattice = area.lattice();
        let period_s = lattice.period_ns() as f64 * 1e-9;
        let lasers: Vec<Laser> =
            lasers.iter().filter(|laser| laser.area == area.id).cloned().collect();
        let roles = Roles::of(area);
        // `always`, and those that the site file names.
        let contexts = area.contexts.len() + 1;
        let normal = Normal::new(grid, period_s, roles.classes(), contexts);
        let mut excluded = Plane::new(grid.cells());
        for zone in area.zones.iter().filter(|zone| zone.exclude) {
            for cell in 0..grid.cells() {
                if contains(&zone.polygon_m, grid.centre_of_index_m(cell)) {
                    excluded.set(cell, true);
                }
            }
        }
        let eyes = Eyes::new(&grid, &lasers);
        let persist = lattice.frames_in(PERSIST_S);
        let calibration = Calibration::new(area.detector.calibration_s);
        Self {
            sense: Sense::new(grid, roles, normal, eyes, excluded, period_s),
            phase: Phase::Learning,
            calibration,
            space: Level { on: FLOOR_SPACE, extrapolated: true },
            time: Level { on: FLOOR_TIME, extrapolated: true },
            life: Life::new(grid, persist),
            ledger: Ledger::new(&area.id, &area.zones),
            doors: Vec::new(),
            doors_pending: Vec::new(),
            silent: vec![Debounced::default(); lasers.len()],
            absent_frames: vec![0; lasers.len()],
            coverage: Debounced::default(),
            fault_first_ns: Vec::new(),
            first_ns: None,
            last: None,
            blind_until: 0,
            frames_to_tick: 0,
            frames_to_stock: 0,
            stocks: 0,
            space_regions: Vec::new(),
            time_regions: Vec::new(),
            space_score: 0.0,
            recent: VecDeque::with_capacity(persist as usize + 1),
            quarantine: VecDeque::new(),
            held: Plane::new(grid.cells()),
            counters: Counters::default(),
            notices: Vec::new(),
            area: area.clone(),
            lasers,
            lattice,
            period_s,
        }
    }

    /// Goes on after a restart: the highest sequence and event number that were ever told, and
    /// the last change of every event that is open (see `outbox`).
    pub fn resume(&mut self, last_sequence: u64, last_number: u64, open: &[EventChange]) {
        self.ledger.resume(last_sequence, last_number);
        for change in open {
            let Some(number) = number_of(&self.area.id, &change.id) else {
                continue;
            };
            match change.kind {
                EventKind::LaserSilent => {
                    let at = |laser: &&mut Debounced, index: usize| {
                        laser.event.is_none()
                            && self.lasers[index].x_m == change.x_m
                            && self.lasers[index].y_m == change.y_m
                    };
                    let mut states = self.silent.iter_mut().enumerate();
                    if let Some((_, state)) = states.find(|(index, state)| at(state, *index)) {
                        *state = Debounced::restored(number);
                    }
                    self.fault_first_ns.push((number, change.first_evidence_ns));
                }
                EventKind::CoverageLost => {
                    self.coverage = Debounced::restored(number);
                    self.fault_first_ns.push((number, change.first_evidence_ns));
                }
                EventKind::DoorHeldOpen => self.doors_pending.push((number, change.clone())),
                _ => self.life.resume(number, change, change.stamp_ns),
            }
        }
    }

    /// The mapper's publisher is another one: numbers may begin anew.
    pub fn feed_restarted(&mut self) {
        self.last = None;
    }

    /// Replaces the model of a context by a collapsed map [class, row, column], if this core is
    /// still learning and the map knows more than a minute more. True if it was taken.
    pub fn seed(&mut self, context: usize, counts: &[u64]) -> bool {
        let grid = self.sense.grid;
        let fits = counts.len() == grid.cells() * self.sense.roles.classes()
            && context < self.sense.normal.contexts();
        if !fits || self.phase != Phase::Learning {
            return false;
        }
        let frames = crate::normal::collapsed_frames(counts, grid.cells());
        let own = self.sense.normal.learnt_in(context);
        if frames.saturating_sub(own) as f64 * self.period_s < STOCK_S {
            return false;
        }
        self.sense.normal.seed(context, counts);
        self.notice(format!(
            "the model of context {context} starts from the mapper's collapsed map: {} of frames",
            words::duration(frames as f64 * self.period_s)
        ));
        true
    }

    /// Takes a class map; appends what is to be told, in order.
    pub fn handle(&mut self, frame: &ClassFrame<'_>, changes: &mut Vec<EventChange>) {
        if frame.classes.len() != self.sense.grid.cells() {
            self.counters.frames_refused += 1;
            return;
        }
        let number = frame.number;
        let stamp_ns = self.lattice.stamp_ns(number);
        if self.last.is_some_and(|last| number <= last) {
            self.counters.frames_stale += 1;
            return;
        }
        self.counters.frames_in += 1;
        let missed = self.last.map_or(0, |last| number - last - 1);
        self.counters.frames_missed += missed;
        if missed as f64 * self.period_s >= 1.0 {
            self.go_blind(number);
        }
        self.last = Some(number);
        self.first_ns.get_or_insert(stamp_ns);
        let now = number as u32;

        self.supervise_lasers(frame, stamp_ns, changes);
        let blind = number < self.blind_until;
        self.sense.normal.set_context(frame.context);
        self.sense.take(frame.classes, now);
        let nobody = frame.lasers_present == 0 && !self.lasers.is_empty();
        if !blind && !nobody {
            self.sense.normal.tick();
        }
        let tick = self.due(frame, blind, stamp_ns, changes);
        self.advance_phase(now, blind);
        match self.phase {
            Phase::Learning => {}
            Phase::Calibrating if blind => self.recent.clear(),
            Phase::Calibrating => self.calibrate(now, tick),
            Phase::Watching => self.watch(now, tick, stamp_ns, changes),
        }
    }

    /// Absence is no evidence, and nothing is learnt, until the middle timescale has passed.
    pub(crate) fn go_blind(&mut self, number: u64) {
        let scales = &self.area.timescales_s;
        let settle_s = scales[scales.len() / 2];
        self.blind_until = number + u64::from(self.lattice.frames_in(settle_s));
    }

    /// The slow work; true if it was done in this frame.
    fn due(
        &mut self,
        frame: &ClassFrame<'_>,
        blind: bool,
        stamp_ns: u64,
        changes: &mut Vec<EventChange>,
    ) -> bool {
        let now = frame.number as u32;
        if self.frames_to_stock == 0 {
            self.frames_to_stock = u64::from(self.lattice.frames_in(STOCK_S));
            self.sense.take_stock();
            self.sense.rescore(now);
            self.stocks += 1;
            if self.phase != Phase::Learning && self.stocks.is_multiple_of(60) {
                self.find_doors(stamp_ns, changes);
            }
        }
        self.frames_to_stock -= 1;
        if self.frames_to_tick > 0 {
            self.frames_to_tick -= 1;
            return false;
        }
        self.frames_to_tick = u64::from(self.lattice.frames_in(TICK_S)) - 1;
        self.sense.weigh_absences(frame.lasers_present, blind, now);
        self.supervise_coverage(stamp_ns, changes);
        if self.phase == Phase::Watching {
            if !self.doors_pending.is_empty() && self.doors.is_empty() {
                self.find_doors(stamp_ns, changes);
            }
            self.watch_doors(frame.lasers_present, stamp_ns, changes);
        }
        self.hold(stamp_ns);
        true
    }

    fn advance_phase(&mut self, now: u32, blind: bool) {
        let detector = &self.area.detector;
        match self.phase {
            Phase::Learning if self.sense.normal.learnt_s() >= detector.learning_s => {
                self.phase = Phase::Calibrating;
                self.sense.take_stock();
                self.doors = self.sense.find_doors();
                self.sense.set_scoring(true, now);
                self.notice(format!(
                    "learnt {} of normal life, found {} doors; calibrating for {}",
                    words::duration(self.sense.normal.learnt_s()),
                    self.doors.len(),
                    words::duration(self.area.detector.calibration_s),
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

    fn calibrate(&mut self, now: u32, tick: bool) {
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

    fn watch(&mut self, now: u32, tick: bool, stamp_ns: u64, changes: &mut Vec<EventChange>) {
        let levels = Levels { space: self.space.on, time: self.time.on };
        let cells_min = self.cells_min();
        self.sense.space_regions(cells_min, OFF * levels.space, &mut self.space_regions);
        if tick {
            self.sense.time_regions(now, OFF * levels.time, &mut self.time_regions);
        }
        let regions = self.space_regions.iter().chain(&self.time_regions).copied();
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
        self.life.step(stamp_ns, regions, levels, |happening, state| {
            if happening.number == 0 {
                happening.number = ledger.number();
            }
            let zone = ledger.zone(happening.centre_m);
            let text = if state == EventState::Cleared {
                if quarantine.len() == QUARANTINE_MAX {
                    quarantine.pop_front();
                }
                quarantine.push_back((happening.trail, stamp_ns.saturating_add(quiet_ns)));
                let seconds = happening.seen_ns.saturating_sub(happening.first_ns) as f64 * 1e-9;
                let why = "Nothing unusual is seen here any more.";
                words::cleared(happening.kind, zone, happening.centre_m, seconds, why)
            } else {
                words::happening(happening, sense, zone, stamp_ns, certainty)
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
        let grid = self.sense.grid;
        let held = &mut self.held;
        held.clear();
        let trails = self.life.happenings.iter().map(|happening| happening.trail);
        for bounds in trails.chain(self.quarantine.iter().map(|(bounds, _)| *bounds)) {
            for_each_cell(&grid, bounds, MARGIN_M, |cell| held.set(cell, true));
        }
        for door in self.doors.iter().filter(|door| door.event.is_some()) {
            for_each_cell(&grid, door.bounds, MARGIN_M, |cell| held.set(cell, true));
        }
        self.sense.normal.hold(&self.held);
    }

    pub(crate) fn notice(&mut self, text: String) {
        if self.notices.len() < NOTICES_MAX {
            self.notices.push(text);
        }
    }

    /// What is to be logged since the last call: changes of phase, mostly.
    pub fn take_notices(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notices)
    }

    /// How far it has learnt.
    #[must_use]
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Seconds of normal life behind the model.
    #[must_use]
    pub fn learnt_s(&self) -> f64 {
        self.sense.normal.learnt_s()
    }

    /// Seconds of normal life behind the thresholds.
    #[must_use]
    pub fn calibrated_s(&self) -> f64 {
        self.calibration.frames as f64 * self.period_s
    }

    /// The levels of the two tests: region score in space, charge in time.
    #[must_use]
    pub fn levels(&self) -> [f64; 2] {
        [self.space.on, self.time.on]
    }

    /// True if a level is beyond what the calibration proves.
    #[must_use]
    pub fn extrapolated(&self) -> bool {
        self.space.extrapolated || self.time.extrapolated
    }

    /// The doors that were found: bounds [x_min, y_min, x_max, y_max], metres.
    pub fn doors(&self) -> impl Iterator<Item = [f64; 4]> + '_ {
        self.doors.iter().map(|door| door.bounds)
    }

    /// Totals since the start.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Stamp of the last class map, UNIX nanoseconds; 0 before the first.
    #[must_use]
    pub fn stamp_ns(&self) -> u64 {
        self.last.map_or(0, |last| self.lattice.stamp_ns(last))
    }

    pub(crate) fn site_bounds(&self) -> [f64; 4] {
        grid_bounds(&self.sense.grid)
    }
}

fn quarantine_ns(area: &Area) -> u64 {
    let longest_s = area.timescales_s.last().copied().unwrap_or(0.0);
    QUARANTINE_NS + (longest_s * SECOND_NS as f64) as u64
}
