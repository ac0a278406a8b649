//! The core of an area: class maps in, changes of events out.

use crate::door::Door;
use crate::ledger::{Ledger, number_of};
use crate::life::Life;
use crate::normal::Normal;
use crate::place::{contains, grid_bounds};
use crate::plane::Plane;
use crate::role::Roles;
use crate::sense::{Region, Sense};
use crate::shadow::Eyes;
use crate::stages::{FLOOR_SPACE, FLOOR_TIME, STOCK_S};
use crate::supervise::Debounced;
use crate::threshold::{Level, Peaks};
use crate::words;
use protocol::event::{EventChange, EventKind};
use protocol::site::{Area, Laser};
use protocol::time::Lattice;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// A score must last this long to count: a walker, a crowd, an object do; a reflection does not.
pub(crate) const PERSIST_S: f64 = 0.5;
/// A feed that began anew may go back by more than this; by less it only repeats itself, seconds.
const BACK_S: f64 = 600.0;
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
    /// What the event of lost coverage says.
    pub(crate) coverage_text: String,
    /// First evidence of open faults by number, for their last words.
    pub(crate) fault_first_ns: Vec<(u64, u64)>,
    pub(crate) first_ns: Option<u64>,
    last: Option<u64>,
    /// Whether the map handed over last was taken.
    took_last: bool,
    may_go_back: bool,
    /// Absence is no evidence and nothing is learnt before this frame.
    blind_until: u64,
    pub(crate) frames_to_tick: u64,
    pub(crate) stocks: u64,
    pub(crate) space_regions: Vec<Region>,
    pub(crate) time_regions: Vec<Region>,
    pub(crate) space_score: f64,
    pub(crate) recent: VecDeque<f64>,
    pub(crate) quarantine: VecDeque<([f64; 4], u64)>,
    pub(crate) held: Plane,
    pub(crate) held_boxes: Vec<[f64; 4]>,
    pub(crate) counters: Counters,
    pub(crate) notices: Vec<String>,
}

impl Watch {
    /// Tells its events under this origin instead of the area's id.
    pub fn tell_as(&mut self, origin: &str) {
        origin.clone_into(&mut self.ledger.origin);
    }

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
            coverage_text: String::new(),
            fault_first_ns: Vec::new(),
            first_ns: None,
            last: None,
            took_last: false,
            may_go_back: false,
            blind_until: 0,
            frames_to_tick: 0,
            stocks: 0,
            space_regions: Vec::new(),
            time_regions: Vec::new(),
            space_score: 0.0,
            recent: VecDeque::with_capacity(persist as usize + 1),
            quarantine: VecDeque::new(),
            held: Plane::new(grid.cells()),
            held_boxes: Vec::new(),
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
            let Some(number) = number_of(&self.ledger.origin, &change.id) else {
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
                    self.coverage_text.clone_from(&change.text);
                    self.fault_first_ns.push((number, change.first_evidence_ns));
                }
                EventKind::DoorHeldOpen => self.doors_pending.push((number, change.clone())),
                _ => self.life.resume(number, change),
            }
        }
    }

    /// The mapper's publisher is another one: numbers may begin anew. A mapper that goes on from its
    /// checkpoint only repeats some, which are stale.
    pub fn feed_restarted(&mut self) {
        self.may_go_back = true;
    }

    /// True if a frame is after the last one, or begins a new feed.
    fn accept(&mut self, number: u64) -> bool {
        let Some(last) = self.last else { return true };
        if number > last {
            return true;
        }
        let goes_back = self.may_go_back && (last - number) as f64 * self.period_s >= BACK_S;
        if goes_back {
            self.life.rebase(self.lattice.stamp_ns(number));
            self.quarantine.clear();
            self.sense.charge.reset();
            self.first_ns = None;
            self.blind_until = 0;
            self.last = None;
        }
        goes_back
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
        self.take(frame, None, changes);
    }

    /// As [`Watch::handle`], for a class map that differs from the one handed over before it in no
    /// cell but (some of) `cells`, in any order: saves the comparison of the two.
    pub fn handle_changed(
        &mut self,
        frame: &ClassFrame<'_>,
        cells: &[u32],
        changes: &mut Vec<EventChange>,
    ) {
        self.take(frame, Some(cells), changes);
    }

    fn take(
        &mut self,
        frame: &ClassFrame<'_>,
        changed_cells: Option<&[u32]>,
        changes: &mut Vec<EventChange>,
    ) {
        // A map that was not taken leaves a list that is of no use.
        let changed_cells = changed_cells.filter(|_| std::mem::take(&mut self.took_last));
        if frame.classes.len() != self.sense.grid.cells() {
            self.counters.frames_refused += 1;
            return;
        }
        let number = frame.number;
        let stamp_ns = self.lattice.stamp_ns(number);
        if !self.accept(number) {
            self.counters.frames_stale += 1;
            return;
        }
        self.may_go_back = false;
        self.counters.frames_in += 1;
        let missed = self.last.map_or(0, |last| number - last - 1);
        self.counters.frames_missed += missed;
        // What came before the first frame is not known to have been seen.
        if missed as f64 * self.period_s >= 1.0 || self.first_ns.is_none() {
            self.go_blind(number);
        }
        self.last = Some(number);
        self.first_ns.get_or_insert(stamp_ns);
        let now = number as u32;

        self.supervise_lasers(frame, stamp_ns, changes);
        let blind = number < self.blind_until;
        self.sense.normal.set_context(frame.context);
        match changed_cells {
            Some(cells) => self.sense.take_changed(frame.classes, cells, now),
            None => self.sense.take(frame.classes, now),
        }
        self.took_last = true;
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

    /// How high normal life scored during calibration, declustered, highest first: in space, in time.
    #[must_use]
    pub fn peaks(&self) -> [Vec<f64>; 2] {
        [self.calibration.space.declustered(), self.calibration.time.declustered()]
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
