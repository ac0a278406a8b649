//! What the core watches with a clock: lasers, coverage, doors.

use crate::door;
use crate::ledger::Entry;
use crate::place::{grid_bounds, point_m};
use crate::role::Role;
use crate::supervise::{
    BACK_DEBOUNCE_NS, COVERAGE_DEBOUNCE_NS, LOST_SHARE, RESTORED_SHARE, SILENT_DEBOUNCE_NS,
    START_GRACE_NS, Turn,
};
use crate::watch::{ClassFrame, Watch};
use crate::words;
use protocol::event::{EventChange, EventKind, EventState};
use protocol::time::{MILLISECOND_NS, SECOND_NS};

/// A fault before it has words.
struct Fault<'a> {
    number: u64,
    kind: EventKind,
    state: EventState,
    first_ns: u64,
    at_m: [f64; 2],
    bounds: [f64; 4],
    score: f64,
    threshold: f64,
    text: &'a str,
}

impl Watch {
    /// Lasers whose silence is an open event, in words; none while all deliver.
    #[must_use]
    pub fn silent_lasers(&self) -> Option<String> {
        if self.silent.iter().all(|state| state.event.is_none()) {
            return None;
        }
        let open = self.lasers.iter().zip(&self.silent).filter(|(_, state)| state.event.is_some());
        let names: Vec<String> = open.map(|(laser, _)| format!("`{}`", laser.id)).collect();
        Some(format!(
            "no scans from {} of area `{}`: what only they see is not watched; check power, cable \
             and the service `laser`",
            names.join(", "),
            self.area.id
        ))
    }

    /// What the open event of lost coverage says; none while the area is observed.
    #[must_use]
    pub fn lost_coverage(&self) -> Option<String> {
        self.coverage.event.map(|_| self.coverage_text.clone())
    }

    /// No class map came for `silence_s` seconds until `stamp_ns`: says so once. For the shell, which
    /// has a clock; a lossless replay has none.
    pub fn feed_silent(&mut self, stamp_ns: u64, silence_s: f64, changes: &mut Vec<EventChange>) {
        if self.coverage.event.is_some() {
            return;
        }
        let silence_ns = (silence_s.max(0.0) * SECOND_NS as f64) as u64;
        let first_ns = stamp_ns.saturating_sub(silence_ns);
        let text = format!(
            "Coverage lost: no class map of area `{}` for {}. Nothing is watched here. Fusion or the \
             mapper is down, or every laser is silent.",
            self.area.id,
            words::duration(silence_s)
        );
        let number = self.ledger.number();
        self.coverage.event = Some(number);
        self.tell_coverage(number, EventState::Raised, stamp_ns, first_ns, 1.0, &text, changes);
    }

    /// Lasers in and out of the frames.
    pub(crate) fn supervise_lasers(
        &mut self,
        frame: &ClassFrame<'_>,
        stamp_ns: u64,
        changes: &mut Vec<EventChange>,
    ) {
        let half_short = u64::from(self.lattice.frames_in(0.5 * self.area.timescales_s[0]));
        let started_ns = stamp_ns.saturating_sub(self.first_ns.unwrap_or(stamp_ns));
        let lost_ns = (self.area.laser_lost_ms * MILLISECOND_NS as f64) as u64;
        for index in 0..self.lasers.len() {
            let present = frame.lasers_present >> index & 1 == 1;
            if present {
                self.absent_frames[index] = 0;
            } else {
                self.absent_frames[index] += 1;
                if self.absent_frames[index] >= half_short {
                    // Half of the shortest average is guesswork now.
                    self.go_blind(frame.number);
                }
            }
            let begin_ns = if started_ns < 2 * START_GRACE_NS {
                START_GRACE_NS
            } else {
                lost_ns + SILENT_DEBOUNCE_NS
            };
            let turn =
                self.silent[index].observe(Some(!present), stamp_ns, begin_ns, BACK_DEBOUNCE_NS);
            let silent_s = self.absent_frames[index] as f64 * self.period_s;
            let (number, state, first_ns) = match turn {
                Turn::Stays => continue,
                Turn::Begins(first_ns) => {
                    let number = self.ledger.number();
                    self.silent[index].event = Some(number);
                    (number, EventState::Raised, first_ns)
                }
                Turn::Ends(number) => (number, EventState::Cleared, stamp_ns),
            };
            let laser = &self.lasers[index];
            let at_m = [laser.x_m, laser.y_m];
            let text = if state == EventState::Raised {
                let host =
                    laser.host.as_ref().map_or_else(String::new, |id| format!(" on host {id}"));
                format!(
                    "Laser `{0}` is silent for {1}; what only it sees is not watched. Check its power, \
                     its cable and the process `laser {0}`{host}.",
                    laser.id,
                    words::duration(silent_s),
                )
            } else {
                format!("Laser `{}` delivers again.", laser.id)
            };
            let threshold = begin_ns as f64 * 1e-9;
            self.tell_fault(
                Fault {
                    number,
                    kind: EventKind::LaserSilent,
                    state,
                    first_ns,
                    at_m,
                    bounds: self.site_bounds(),
                    score: silent_s,
                    threshold,
                    text: &text,
                },
                stamp_ns,
                changes,
            );
        }
    }

    /// Cells that are usually known and are unknown now.
    pub(crate) fn supervise_coverage(&mut self, stamp_ns: u64, changes: &mut Vec<EventChange>) {
        let longest_s = self.area.timescales_s.last().copied().unwrap_or(0.0);
        let started_ns = stamp_ns.saturating_sub(self.first_ns.unwrap_or(stamp_ns));
        // A mapper that starts anew classifies nothing before its window has filled.
        let in_grace = (started_ns as f64) < longest_s * SECOND_NS as f64;
        let (covered, lost) = self.sense.lost_cells();
        if self.coverage.event.is_none() && (covered == 0 || in_grace) {
            return;
        }
        let share = lost as f64 / covered.max(1) as f64;
        let wrong = match share {
            s if s >= LOST_SHARE => Some(true),
            s if s <= RESTORED_SHARE => Some(false),
            _ => None,
        };
        let debounce_ns = COVERAGE_DEBOUNCE_NS;
        let (number, state, first_ns, text) =
            match self.coverage.observe(wrong, stamp_ns, debounce_ns, debounce_ns) {
                Turn::Stays => return,
                Turn::Begins(first_ns) => {
                    let number = self.ledger.number();
                    self.coverage.event = Some(number);
                    let text = format!(
                        "Coverage lost: {:.0} % of the area that is usually seen ({:.1} m²) is not \
                         observed. {}",
                        100.0 * share,
                        lost as f64 * self.area.cell_m * self.area.cell_m,
                        self.silent_words()
                    );
                    (number, EventState::Raised, first_ns, text)
                }
                Turn::Ends(number) => {
                    let text = "The area is observed again.".to_owned();
                    (number, EventState::Cleared, stamp_ns, text)
                }
            };
        self.tell_coverage(number, state, stamp_ns, first_ns, share, &text, changes);
    }

    fn silent_words(&self) -> String {
        let silent: Vec<String> = self
            .lasers
            .iter()
            .zip(&self.absent_frames)
            .filter(|(_, absent)| **absent as f64 * self.period_s >= 1.0)
            .map(|(laser, _)| format!("`{}`", laser.id))
            .collect();
        match silent.len() {
            0 => "All lasers deliver: something large stands in their way.".to_owned(),
            1 => format!("Laser {} is silent.", silent[0]),
            _ => format!("Lasers {} are silent.", silent.join(", ")),
        }
    }

    #[allow(clippy::too_many_arguments)]
    fn tell_coverage(
        &mut self,
        number: u64,
        state: EventState,
        stamp_ns: u64,
        first_ns: u64,
        share: f64,
        text: &str,
        changes: &mut Vec<EventChange>,
    ) {
        text.clone_into(&mut self.coverage_text);
        let grid = self.sense.grid;
        let at_m = point_m(&grid, [f64::from(grid.columns) / 2.0, f64::from(grid.rows) / 2.0]);
        self.tell_fault(
            Fault {
                number,
                kind: EventKind::CoverageLost,
                state,
                first_ns,
                at_m,
                bounds: grid_bounds(&grid),
                score: share,
                threshold: LOST_SHARE,
                text,
            },
            stamp_ns,
            changes,
        );
    }

    fn tell_fault(&mut self, fault: Fault<'_>, stamp_ns: u64, changes: &mut Vec<EventChange>) {
        let Fault { number, state, .. } = fault;
        let mut first_ns = fault.first_ns;
        match state {
            EventState::Cleared => {
                if let Some(index) = self.fault_first_ns.iter().position(|(n, _)| *n == number) {
                    first_ns = self.fault_first_ns.swap_remove(index).1;
                }
            }
            _ => self.fault_first_ns.push((number, first_ns)),
        }
        changes.push(self.ledger.change(Entry {
            number,
            kind: fault.kind,
            state,
            stamp_ns,
            first_ns,
            at_m: fault.at_m,
            bounds: fault.bounds,
            score: fault.score,
            threshold: fault.threshold,
            extrapolated: false,
            text: fault.text.to_owned(),
        }));
    }

    /// Looks for doors anew, unless one of them is the place of an event.
    pub(crate) fn find_doors(&mut self, stamp_ns: u64, changes: &mut Vec<EventChange>) {
        if self.doors.iter().any(|door| door.event.is_some()) {
            return;
        }
        let old = std::mem::replace(&mut self.doors, self.sense.find_doors());
        for door in &mut self.doors {
            door.open_since_ns = old
                .iter()
                .find(|known| crate::place::gap_m(known.bounds, door.bounds) == 0.0)
                .and_then(|known| known.open_since_ns);
        }
        for (number, change) in std::mem::take(&mut self.doors_pending) {
            let near = |door: &&mut door::Door| {
                door.event.is_none() && crate::place::gap_m(door.bounds, change.bounds_m) <= 0.5
            };
            if let Some(door) = self.doors.iter_mut().find(near) {
                door.event = Some(number);
                door.open_since_ns = Some(change.first_evidence_ns);
            } else {
                let text = "No door is known at this place any more.".to_owned();
                changes.push(self.ledger.change(Entry {
                    number,
                    kind: EventKind::DoorHeldOpen,
                    state: EventState::Cleared,
                    stamp_ns,
                    first_ns: change.first_evidence_ns,
                    at_m: [change.x_m, change.y_m],
                    bounds: change.bounds_m,
                    score: 0.0,
                    threshold: change.threshold,
                    extrapolated: false,
                    text,
                }));
            }
        }
    }

    /// Doors that are open for too long.
    pub(crate) fn watch_doors(
        &mut self,
        lasers_present: u64,
        stamp_ns: u64,
        changes: &mut Vec<EventChange>,
    ) {
        let limit_s = self.area.detector.door_held_open_s;
        for index in 0..self.doors.len() {
            let (mut present, mut absent) = (0, 0);
            for cell in self.doors[index].cells.iter().map(|cell| *cell as usize) {
                let role = self.sense.role_now(cell);
                if role.is_present() {
                    present += 1;
                } else if role != Role::Unknown && !self.sense.in_shadow(cell, lasers_present) {
                    absent += 1;
                }
            }
            let door = &mut self.doors[index];
            let since_ns = door.open_since_ns;
            let Some(open) = door.observe(present, absent, stamp_ns) else { continue };
            let first_ns = since_ns.or(door.open_since_ns).unwrap_or(stamp_ns);
            let open_s = stamp_ns.saturating_sub(first_ns) as f64 * 1e-9;
            let (state, number) = match (open, door.event) {
                (true, None) if open_s >= limit_s => (EventState::Raised, self.ledger.number()),
                (false, Some(number)) => (EventState::Cleared, number),
                _ => continue,
            };
            let raised = state == EventState::Raised;
            door.event = raised.then_some(number);
            let (at_m, bounds) = (door.centre_m(), door.bounds);
            let place = self.ledger.place(at_m);
            let text = if raised {
                format!(
                    "A door is held open: {place}, for {}. Allowed are {}. That it is a \
                     door was found from {} of normal life.",
                    words::duration(open_s),
                    words::duration(limit_s),
                    words::duration(self.learnt_s())
                )
            } else {
                words::cleared("The door is shut", &place, open_s)
            };
            changes.push(self.ledger.change(Entry {
                number,
                kind: EventKind::DoorHeldOpen,
                state,
                stamp_ns,
                first_ns,
                at_m,
                bounds,
                score: open_s,
                threshold: limit_s,
                extrapolated: false,
                text,
            }));
        }
    }
}
