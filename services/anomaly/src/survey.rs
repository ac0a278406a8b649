//! Taking stock of the whole map, a few cells a frame.
//!
//! A round visits every cell twice. First: what it showed goes into the shares of the whole map, it
//! is known or not known usually, it may be of a door or not; and while scores are wanted, what was
//! seen of one class of presence, in turn, goes into sums over boxes. Second: the share of that
//! class around the cell is taken from these sums, and the cell is scored with the counts of now.
//!
//! Spread over a minute a round costs a frame some microseconds; at once it would take longer than
//! a frame period. All of it is done at once only when the phase changes, and after a restart.

use crate::box_sums::BoxSums;
use crate::door::{self, Door};
use crate::normal::NEAR_M;
use crate::plane::Plane;
use crate::role::Role;
use crate::sense::Sense;
use protocol::geometry::GridGeometry;
use protocol::grid::CLASSES_MAX;

/// A round, as far as it is done.
#[derive(Debug, Clone)]
pub(crate) struct Survey {
    /// Frames of the round that passed.
    frames: u64,
    /// Visits done: the first of every cell, then the second of every cell.
    visits: usize,
    rounds: usize,
    /// Frames of all cells by class.
    seen: [u64; CLASSES_MAX],
    /// The class of presence of this round.
    slot: Option<u8>,
    near_known: BoxSums,
    near_seen: BoxSums,
    /// Cells that may be of a door.
    door_like: Plane,
}

impl Survey {
    pub(crate) fn new(grid: GridGeometry) -> Self {
        Self {
            frames: 0,
            visits: 0,
            rounds: 0,
            seen: [0; CLASSES_MAX],
            slot: None,
            near_known: BoxSums::new(&grid),
            near_seen: BoxSums::new(&grid),
            door_like: Plane::new(grid.cells()),
        }
    }

    fn begin(&mut self, slot: Option<u8>) {
        (self.frames, self.visits, self.slot) = (0, 0, slot);
        self.seen = [0; CLASSES_MAX];
        if slot.is_some() {
            self.near_known.begin();
            self.near_seen.begin();
        }
    }
}

impl Sense {
    /// The part of this frame in a round of `frames` frames; true at the end of the round.
    pub(crate) fn survey(&mut self, frames: u64, now: u32) -> bool {
        let cells = self.grid.cells();
        if self.survey.frames == 0 {
            let slots = if self.scoring { self.slots_of_presence() } else { Vec::new() };
            let turn = self.survey.rounds % slots.len().max(1);
            self.survey.begin(slots.get(turn).copied());
        }
        self.survey.frames += 1;
        let goal = 2 * cells as u64 * self.survey.frames / frames;
        while (self.survey.visits as u64) < goal {
            let visit = self.survey.visits;
            self.survey.visits += 1;
            if visit < cells {
                self.first_visit(visit);
            } else if self.scoring {
                self.take_share(visit - cells);
                self.score(visit - cells, now);
            }
            if visit + 1 == cells {
                self.normal.set_map_share(&self.survey.seen);
            }
        }
        let ends = self.survey.frames == frames;
        if ends {
            self.survey.frames = 0;
            self.survey.rounds = self.survey.rounds.wrapping_add(1);
        }
        ends
    }

    /// Shares of the whole map, which cells are usually known and which may be of a door, all at
    /// once. A round begins anew.
    pub(crate) fn take_stock(&mut self) {
        self.survey.begin(None);
        (0..self.grid.cells()).for_each(|cell| self.first_visit(cell));
        self.normal.set_map_share(&self.survey.seen);
    }

    /// Starts or stops scoring, and scores everything anew, all at once. A round begins anew.
    pub(crate) fn set_scoring(&mut self, scoring: bool, now: u32) {
        self.scoring = scoring;
        self.charge.reset();
        self.evidence.clear();
        self.counted.clear();
        self.dirty = true;
        if scoring {
            for slot in self.slots_of_presence() {
                self.survey.begin(Some(slot));
                (0..self.grid.cells()).for_each(|cell| self.first_visit(cell));
                (0..self.grid.cells()).for_each(|cell| self.take_share(cell));
            }
            (0..self.grid.cells()).for_each(|cell| self.score(cell, now));
        }
        self.survey.begin(None);
    }

    /// Doors by the last look at each cell; marks their cells.
    pub(crate) fn find_doors(&mut self) -> Vec<Door> {
        door::find(&self.grid, &self.survey.door_like, &mut self.doors)
    }

    fn slots_of_presence(&self) -> Vec<u8> {
        let slots = 0..self.roles.classes() as u8;
        slots.filter(|slot| self.roles.role(*slot).is_present()).collect()
    }

    fn first_visit(&mut self, cell: usize) {
        let stock = self.normal.stock(cell);
        for (sum, count) in self.survey.seen.iter_mut().zip(&stock.seen) {
            *sum += count;
        }
        self.covered.set(cell, self.normal.is_covered(&stock));
        self.survey.door_like.set(cell, door::is_like(&stock, &self.roles));
        if let Some(slot) = self.survey.slot {
            // What stands beside a wall is not as normal as the wall.
            let counts =
                stock.usual().is_some_and(|(usual, _)| self.roles.role(usual) != Role::Fixed);
            let of = |frames: u64| if counts { frames as f64 } else { 0.0 };
            self.survey.near_known.push(of(stock.known));
            self.survey.near_seen.push(of(stock.seen[usize::from(slot)]));
        }
    }

    /// The share of the class of this round within [`NEAR_M`] of a cell.
    fn take_share(&mut self, cell: usize) {
        let Some(slot) = self.survey.slot else { return };
        let reach = (NEAR_M / self.grid.cell_m).round() as usize;
        let known = self.survey.near_known.around(cell, reach);
        let seen = self.survey.near_seen.around(cell, reach);
        let share = if known > 0.0 { (seen / known) as f32 } else { 0.0 };
        self.normal.set_near(slot, cell, share);
    }
}
