//! Evidence in space: from a class map to regions of unlikely cells.
//!
//! Cost follows the changes: a class map is compared word by word with the last one, only changed
//! cells are scored, and regions are laid anew only when a scored cell changed.
//!
//! A cell is *evidence* if its l passes [`L_MIN`]; it is *counted* if nothing else explains it:
//! a neighbour's normal class (an edge that jitters by a cell), a shadow, a silent laser, a door.

use crate::charge::Charge;
use crate::normal::Normal;
use crate::plane::{Flood, Plane, for_each_neighbour};
use crate::role::{Role, Roles};
use crate::shadow::{Eyes, Obstacle};
use crate::survey::Survey;
use protocol::geometry::GridGeometry;
use protocol::grid::CLASSES_MAX;

/// Evidence begins here, nats: p below 0.3 % with six classes. A path on which somebody walks ten times
/// an hour is at 4 already; what counts is how far beyond a cell is, so this much is taken off.
pub(crate) const L_MIN: f64 = 4.0;
/// A place is permanent to a ray if it is occupied for longer than this share of its time.
const PERMANENT_SHARE: f64 = 0.5;

/// Which of the two tests a region comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Test {
    /// S = sum of (l - L_MIN) / sqrt(cells) of a component.
    Space,
    /// The highest charge of a component of charged cells.
    Time,
}

/// A component of counted cells.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Region {
    pub(crate) test: Test,
    pub(crate) score: f64,
    pub(crate) cells: u32,
    /// Smallest and largest column and row: [column, row, column, row].
    pub(crate) span: [u32; 4],
    /// Evidence-weighted centre, in cells.
    pub(crate) centre: [f64; 2],
    /// Cells by class.
    pub(crate) slots: [u32; CLASSES_MAX],
    /// Cells where something stands that should not, where something is gone that should be,
    /// where something lingers.
    pub(crate) fixed: u32,
    pub(crate) gone: u32,
    pub(crate) lingering: u32,
    /// Cells that are evidence now; a charged region may have none left.
    pub(crate) counted: u32,
    /// The cell with the most evidence.
    pub(crate) peak: u32,
}

/// Everything between class maps and regions.
#[derive(Debug, Clone)]
pub(crate) struct Sense {
    pub(crate) grid: GridGeometry,
    pub(crate) roles: Roles,
    pub(crate) normal: Normal,
    pub(crate) charge: Charge,
    eyes: Eyes,
    pub(crate) survey: Survey,
    /// The payload of the last class map.
    bytes: Vec<u8>,
    /// Changed cells in ascending order, while a class map is taken.
    ascending: Vec<u32>,
    l: Vec<f32>,
    pub(crate) evidence: Plane,
    pub(crate) counted: Plane,
    excluded: Plane,
    /// Cells of doors: that they are open is the business of `door`.
    pub(crate) doors: Plane,
    /// True while scores are wanted.
    pub(crate) scoring: bool,
    pub(crate) dirty: bool,
    flood: Flood,
    charged: Plane,
    /// Cells that are unknown now, and cells that usually are known.
    pub(crate) unknown: Plane,
    pub(crate) covered: Plane,
}

impl Sense {
    pub(crate) fn new(
        grid: GridGeometry,
        roles: Roles,
        normal: Normal,
        eyes: Eyes,
        excluded: Plane,
        period_s: f64,
    ) -> Self {
        let cells = grid.cells();
        let mut unknown = Plane::new(cells);
        (0..cells).for_each(|cell| unknown.set(cell, true));
        Self {
            grid,
            roles,
            normal,
            charge: Charge::new(cells, period_s),
            eyes,
            survey: Survey::new(grid),
            bytes: vec![protocol::grid::CLASS_UNKNOWN; cells],
            ascending: Vec::new(),
            l: vec![0.0; cells],
            evidence: Plane::new(cells),
            counted: Plane::new(cells),
            excluded,
            doors: Plane::new(cells),
            scoring: false,
            dirty: false,
            flood: Flood::new(cells),
            charged: Plane::new(cells),
            unknown,
            covered: Plane::new(cells),
        }
    }

    /// Role of what a cell shows now.
    pub(crate) fn role_now(&self, cell: usize) -> Role {
        self.roles.role(self.normal.live()[cell])
    }

    /// Takes a class map of the right length; `now` is the frame number modulo 2^32.
    pub(crate) fn take(&mut self, classes: &[u8], now: u32) {
        // Three steps down, so that an unchanged part costs a comparison of memory: 4 kB, 64 B, 8 B.
        for block in (0..classes.len()).step_by(4096) {
            let end = (block + 4096).min(classes.len());
            if self.bytes[block..end] == classes[block..end] {
                continue;
            }
            for line in (block..end).step_by(64) {
                let stop = (line + 64).min(end);
                if self.bytes[line..stop] == classes[line..stop] {
                    continue;
                }
                for (offset, class) in classes[line..stop].iter().enumerate() {
                    self.take_cell(line + offset, *class, now);
                }
            }
        }
    }

    /// As [`Sense::take`], for a class map that differs from the one taken before it in no cell but
    /// (some of) `cells`, in any order: saves the comparison.
    pub(crate) fn take_changed(&mut self, classes: &[u8], cells: &[u32], now: u32) {
        // Scores depend on what the neighbours show: the same order as without a list.
        let mut ascending = std::mem::take(&mut self.ascending);
        ascending.clear();
        ascending.extend_from_slice(cells);
        ascending.sort_unstable();
        for &cell in &ascending {
            if let Some(&class) = classes.get(cell as usize) {
                self.take_cell(cell as usize, class, now);
            }
        }
        self.ascending = ascending;
        debug_assert!(self.bytes == classes, "a change that is not listed");
    }

    #[inline]
    fn take_cell(&mut self, cell: usize, class: u8, now: u32) {
        if self.bytes[cell] != class {
            self.bytes[cell] = class;
            self.change(cell, self.roles.slot(class), now);
        }
    }

    fn change(&mut self, cell: usize, slot: u8, now: u32) {
        self.normal.change(cell, slot);
        self.unknown.set(cell, self.roles.role(slot) == Role::Unknown);
        if self.scoring {
            self.score(cell, now);
        }
    }

    /// Scores what a cell shows. What reads "nothing here" is counted only by
    /// [`Sense::weigh_absences`], which asks whether it can be seen at all.
    pub(crate) fn score(&mut self, cell: usize, now: u32) {
        let slot = self.normal.live()[cell];
        let role = self.roles.role(slot);
        let mut l = 0.0;
        if role != Role::Unknown && !self.excluded.get(cell) && !self.normal.is_usual(cell, slot) {
            l = self.normal.surprise(cell, slot);
            if l > L_MIN && self.is_explained(cell, slot, role, &mut l) {
                l = 0.0;
            }
        }
        let evidence = l > L_MIN;
        self.l[cell] = l as f32;
        self.evidence.set(cell, evidence);
        let counted = evidence && (!role.is_absent() || self.counted.get(cell));
        self.count(cell, counted, now);
    }

    fn count(&mut self, cell: usize, counted: bool, now: u32) {
        if counted || self.counted.get(cell) {
            self.dirty = true;
            self.counted.set(cell, counted);
            self.charge.set(cell, counted.then_some(self.l[cell]), now);
        }
    }

    /// One cell of jitter at an edge. Presence: l is at most that of the best neighbour. Absence: the
    /// surface only moved, if a neighbour that usually is free is occupied now.
    fn is_explained(&self, cell: usize, slot: u8, role: Role, l: &mut f64) -> bool {
        if role.is_absent() {
            // That somebody left is no news: only what usually stands there can be missed.
            let mut moved = !self.is_usually_fixed(cell);
            for_each_neighbour(&self.grid, cell, |neighbour| {
                moved |= self.role_now(neighbour).is_present()
                    && !self.normal.is_usual(neighbour, self.normal.live()[neighbour]);
            });
            return moved;
        }
        for_each_neighbour(&self.grid, cell, |neighbour| {
            *l = l.min(self.normal.surprise(neighbour, slot));
        });
        *l <= L_MIN
    }

    /// True if something usually stands in a cell.
    fn is_usually_fixed(&self, cell: usize) -> bool {
        self.normal.usual(cell).is_some_and(|(slot, share)| {
            self.roles.role(slot) == Role::Fixed && share > PERMANENT_SHARE
        })
    }

    /// Nothing is learnt from these cells.
    pub(crate) fn hold(&mut self, held: &Plane) {
        self.normal.hold(held, &self.evidence);
    }

    /// Cells that are usually known, and how many of them are unknown now.
    pub(crate) fn lost_cells(&self) -> (u32, u32) {
        (self.covered.count(), self.covered.count_common(&self.unknown))
    }

    pub(crate) fn period_s(&self) -> f64 {
        self.normal.period_s()
    }

    /// Decides of all evidence that something is *not* there whether it counts: not in the cells
    /// of a door, not in a shadow, not at all while `blind` (a laser is silent, or just came back).
    pub(crate) fn weigh_absences(&mut self, lasers_present: u64, blind: bool, now: u32) {
        if self.evidence.is_empty() {
            return;
        }
        let mut changed: Vec<(usize, bool)> = Vec::new();
        self.evidence.for_each(|cell| {
            if self.role_now(cell).is_absent() {
                let counted = !blind
                    && !self.doors.get(cell)
                    && !self.eyes.in_shadow(cell, lasers_present, |on_ray| self.obstacle(on_ray));
                if counted != self.counted.get(cell) {
                    changed.push((cell, counted));
                }
            }
        });
        for (cell, counted) in changed {
            self.count(cell, counted, now);
        }
    }

    fn obstacle(&self, cell: usize) -> Obstacle {
        if !self.role_now(cell).is_present() {
            return Obstacle::None;
        }
        if self.is_usually_fixed(cell) { Obstacle::Permanent } else { Obstacle::Fresh }
    }

    pub(crate) fn in_shadow(&self, cell: usize, lasers_present: u64) -> bool {
        self.eyes.in_shadow(cell, lasers_present, |on_ray| self.obstacle(on_ray))
    }

    /// Regions of the space test of at least `cells_min` cells and score `score_min`, into
    /// `regions`, if anything changed since the last call; true if so. Clears `regions` first.
    pub(crate) fn space_regions(
        &mut self,
        cells_min: usize,
        score_min: f64,
        regions: &mut Vec<Region>,
    ) -> bool {
        if !std::mem::take(&mut self.dirty) {
            return false;
        }
        regions.clear();
        let counted = std::mem::replace(&mut self.counted, Plane::new(0));
        let mut flood = std::mem::replace(&mut self.flood, Flood::new(0));
        flood.components(&self.grid, &counted, |cells| {
            if cells.len() >= cells_min && regions.len() < REGIONS_MAX {
                let region = self.region(Test::Space, cells);
                if region.score >= score_min {
                    regions.push(region);
                }
            }
        });
        (self.counted, self.flood) = (counted, flood);
        true
    }

    /// Brings the charges up to date; regions of cells with at least `level`. Returns the highest
    /// charge.
    pub(crate) fn time_regions(&mut self, now: u32, level: f64, regions: &mut Vec<Region>) -> f64 {
        regions.clear();
        let mut charged = std::mem::replace(&mut self.charged, Plane::new(0));
        let highest = self.charge.sweep(now, level, &mut charged);
        if highest >= level {
            let mut flood = std::mem::replace(&mut self.flood, Flood::new(0));
            flood.components(&self.grid, &charged, |cells| {
                if regions.len() < REGIONS_MAX {
                    regions.push(self.region(Test::Time, cells));
                }
            });
            self.flood = flood;
        }
        self.charged = charged;
        highest
    }

    fn region(&self, test: Test, cells: &[u32]) -> Region {
        let columns = self.grid.columns;
        let mut region = Region {
            test,
            score: 0.0,
            cells: cells.len() as u32,
            span: [u32::MAX, u32::MAX, 0, 0],
            centre: [0.0; 2],
            slots: [0; CLASSES_MAX],
            fixed: 0,
            gone: 0,
            lingering: 0,
            counted: 0,
            peak: cells[0],
        };
        let (mut sum, mut best, mut highest) = (0.0, f64::MIN, 0.0f64);
        for cell in cells.iter().map(|cell| *cell as usize) {
            let weight = match test {
                Test::Space => f64::from(self.l[cell]) - L_MIN,
                Test::Time => self.charge.charge(cell),
            };
            let (column, row) = (cell as u32 % columns, cell as u32 / columns);
            let span = &mut region.span;
            *span = [span[0].min(column), span[1].min(row), span[2].max(column), span[3].max(row)];
            sum += weight;
            region.counted += u32::from(self.evidence.get(cell));
            highest = highest.max(weight);
            region.centre[0] += weight * (f64::from(column) + 0.5);
            region.centre[1] += weight * (f64::from(row) + 0.5);
            if weight > best {
                (best, region.peak) = (weight, cell as u32);
            }
            let slot = self.normal.live()[cell];
            if let Some(count) = region.slots.get_mut(usize::from(slot)) {
                *count += 1;
            }
            match self.roles.role(slot) {
                Role::Fixed => region.fixed += 1,
                Role::Lingering => region.lingering += 1,
                // In a charged region a cell may long be normal again.
                Role::Empty | Role::Vacated if self.evidence.get(cell) => region.gone += 1,
                _ => {}
            }
        }
        region.centre = region.centre.map(|value| value / sum.max(1e-9));
        region.score = match test {
            Test::Space => sum / f64::from(region.cells).sqrt(),
            Test::Time => highest,
        };
        region
    }
}

/// Most regions that are handed on in a frame: more at once are not told apart by a guard; the
/// events they belong to are open already.
const REGIONS_MAX: usize = 256;
