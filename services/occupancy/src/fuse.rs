//! Fusion that follows the changes: the frame of an area, kept up to date scan by scan.
//!
//! Paper, 3.3: the readings of all lasers become one image; hit overrides miss overrides unknown.
//! Here: every beam votes on the cells of its wedge. A reading that moves from r to r' touches only
//! the cells between the two, and a reading that stays within the interval between two cells
//! touches none: that is most of them, most of the time.
//!
//! The result is bit-identical to [`crate::dense::Fuser`], whatever the order of the scans: the
//! planes are a function of the last scan of each laser.

use crate::sensor_model::{BeamReading, LaserModel};
use crate::votes::{HIT, MISS, Votes};
use crate::wedge::{WedgeCell, WedgeTable};
use protocol::geometry::GridGeometry;

/// Beams whose places in the wedges are fetched together: two cache lines each.
const FETCHED_BEAMS: usize = 32;

/// Incremental fusion of one area.
#[derive(Debug, Clone)]
pub struct Fuser {
    grid: GridGeometry,
    lasers: Vec<Option<Laser>>,
    votes: Votes,
    moved: Vec<u32>,
}

#[derive(Debug, Clone)]
struct Laser {
    model: LaserModel,
    wedges: WedgeTable,
    /// Per beam: readings in [low, high] say what the last one said. NaN is in no interval.
    low_m: Vec<f32>,
    high_m: Vec<f32>,
    beams: Vec<Beam>,
}

/// A beam's wedge in the table, and how far along it the last reading went.
#[derive(Debug, Clone, Copy)]
struct Beam {
    start: usize,
    end: usize,
    marks: Marks,
}

/// Where a beam's evidence changes, as indices into its wedge: misses are [0, miss_end), hits are
/// [hit_start, hit_end). Hits may overlap misses by a rounding; hit wins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Marks {
    miss_end: u32,
    hit_start: u32,
    hit_end: u32,
}

impl Fuser {
    /// A frame of unknown cells, for up to `lasers` lasers (at most 64).
    #[must_use]
    pub fn new(grid: GridGeometry, lasers: usize) -> Self {
        Self {
            grid,
            lasers: vec![None; lasers],
            votes: Votes::new(grid.cells()),
            moved: Vec::new(),
        }
    }

    /// The grid that is fused onto.
    #[must_use]
    pub fn grid(&self) -> &GridGeometry {
        &self.grid
    }

    /// Sets or replaces a laser; it is absent until its first scan. Builds its wedges: 12 B for
    /// each pair of a cell and a beam that covers it, about 0.1 us each. Does nothing if `laser` is
    /// not below the number given to [`Fuser::new`].
    pub fn install(&mut self, laser: usize, model: &LaserModel) {
        self.retract(laser);
        if let Some(slot) = self.lasers.get_mut(laser) {
            *slot = Some(Laser::new(&self.grid, *model));
        }
    }

    /// Whether the laser has a model.
    #[must_use]
    pub fn is_installed(&self, laser: usize) -> bool {
        self.model(laser).is_some()
    }

    /// The laser's model, if installed.
    #[must_use]
    pub fn model(&self, laser: usize) -> Option<&LaserModel> {
        self.lasers.get(laser)?.as_ref().map(|laser| &laser.model)
    }

    /// Takes the newest scan of a laser: raw ranges, metres (REP 117), as many as the model's beams
    /// (the caller checks; beams that are missing keep what they said). Ignored if not installed.
    pub fn apply(&mut self, laser: usize, ranges_m: &[f32]) {
        let Some(Some(laser)) = self.lasers.get_mut(laser) else { return };
        debug_assert_eq!(ranges_m.len(), laser.model.beams, "beams of the scan and of the model");
        laser.find_moved(ranges_m, &mut self.moved);
        for beams in self.moved.chunks(FETCHED_BEAMS) {
            laser.fetch(beams);
            for &beam in beams {
                let beam = beam as usize;
                laser.move_beam(beam, laser.model.interpret(ranges_m[beam]), &mut self.votes);
            }
        }
        self.votes.cast();
    }

    /// The laser is absent: what only it saw is unknown, until its next scan.
    pub fn retract(&mut self, laser: usize) {
        let Some(Some(laser)) = self.lasers.get_mut(laser) else { return };
        for beam in 0..laser.model.beams {
            laser.move_beam(beam, laser.model.interpret(f32::NAN), &mut self.votes);
        }
        self.votes.cast();
    }

    /// Plane of hits, as in `protocol::frame`.
    #[must_use]
    pub fn hit(&self) -> &[u64] {
        &self.votes.hit
    }

    /// Plane of known cells, as in `protocol::frame`.
    #[must_use]
    pub fn known(&self) -> &[u64] {
        &self.votes.known
    }

    /// Cells whose evidence may differ from what it was at the last [`Fuser::clear_changed`]: a
    /// superset (a cell may have changed back), each once, in no particular order.
    #[must_use]
    pub fn changed_cells(&self) -> &[u32] {
        &self.votes.changed
    }

    /// Starts a new list of changed cells. Who never calls it pays 4 B a cell.
    pub fn clear_changed(&mut self) {
        self.votes.clear_changed();
    }

    /// Size of the wedge tables, bytes.
    #[must_use]
    pub fn wedge_bytes(&self) -> usize {
        self.lasers.iter().flatten().map(|laser| laser.wedges.bytes()).sum()
    }
}

impl Laser {
    fn new(grid: &GridGeometry, model: LaserModel) -> Self {
        let wedges = WedgeTable::build(grid, &model);
        let marks = Marks::default();
        let beams = wedges.bounds().map(|(start, end)| Beam { start, end, marks }).collect();
        let mut laser = Self {
            wedges,
            low_m: vec![0.0; model.beams],
            high_m: vec![0.0; model.beams],
            beams,
            model,
        };
        let nothing = laser.model.interpret(f32::NAN);
        for beam in 0..laser.model.beams {
            (laser.low_m[beam], laser.high_m[beam]) =
                laser.interval(&[], Marks::default(), nothing);
        }
        laser
    }

    /// Lists the beams whose reading left its interval.
    fn find_moved(&self, ranges_m: &[f32], moved: &mut Vec<u32>) {
        const LANES: usize = 16; // a cache line of ranges
        moved.clear();
        moved.resize(self.model.beams + 1, 0);
        let beams = self.model.beams.min(ranges_m.len());
        let inside = |r: f32, low: f32, high: f32| (r >= low) & (r <= high);
        let mut count = 0;
        for first in (0..beams).step_by(LANES) {
            let chunk = first..(first + LANES).min(beams);
            let (range, low, high) =
                (&ranges_m[chunk.clone()], &self.low_m[chunk.clone()], &self.high_m[chunk.clone()]);
            let mut all = true;
            for ((&r, &l), &h) in range.iter().zip(low).zip(high) {
                all &= inside(r, l, h);
            }
            if all {
                continue;
            }
            for (lane, ((&r, &l), &h)) in range.iter().zip(low).zip(high).enumerate() {
                // Always written, kept only if it counts: which beams move is random, and a
                // mispredicted branch costs more than the store.
                moved[count] = (first + lane) as u32;
                count += usize::from(!inside(r, l, h));
            }
        }
        moved.truncate(count);
    }

    /// Brings what `move_beam` will look at into the cache, all at once instead of one by one.
    fn fetch(&self, beams: &[u32]) {
        let mut touched = 0;
        for &beam in beams {
            if let Some(&Beam { start, marks, .. }) = self.beams.get(beam as usize) {
                for mark in [marks.hit_start, marks.hit_end] {
                    touched ^= self.wedges.cell_number(start + mark as usize);
                }
            }
        }
        std::hint::black_box(touched);
    }

    fn move_beam(&mut self, index: usize, says: BeamReading, votes: &mut Votes) {
        let Some(&Beam { start, end, marks: old }) = self.beams.get(index) else { return };
        let wedge = self.wedges.wedge(start, end);
        let new = old.walked(wedge, says, self.model.range_tolerance_m);
        (self.low_m[index], self.high_m[index]) = self.interval(wedge, new, says);
        if new != old {
            note_votes(wedge, old, new, votes);
            self.beams[index].marks = new;
        }
    }

    /// The readings between which the marks of a beam stay as they are. Only an early-out: it is
    /// some micrometres short at each end, so no rounding can put a reading on the wrong side.
    fn interval(&self, wedge: &[WedgeCell], marks: Marks, says: BeamReading) -> (f32, f32) {
        let geometry = &self.model.geometry;
        if says.echo_m.is_nan() {
            return if says.miss_below_m == f64::NEG_INFINITY {
                (f32::NEG_INFINITY, f32_below(geometry.range_min_m))
            } else {
                (f32_not_below(geometry.range_max_m), f32::INFINITY)
            };
        }
        // Rounding to f32 moves a number by 6e-8 of itself at most.
        const SHORT: f64 = 2e-7;
        let (low, high) = marks.interval(wedge, self.model.range_tolerance_m);
        let low = low.max(geometry.range_min_m) * (1.0 + SHORT) + 1e-9;
        let high = high.min(geometry.range_max_m) * (1.0 - SHORT) - 1e-9;
        (low as f32, high as f32)
    }
}

impl Marks {
    /// The marks of a reading, found by walking from these.
    fn walked(self, wedge: &[WedgeCell], says: BeamReading, dr: f64) -> Self {
        let miss_end = walk_window(wedge, self.miss_end, |rho| says.misses(rho));
        if says.echo_m.is_nan() {
            return Self { miss_end, hit_start: miss_end, hit_end: miss_end };
        }
        // |rho - r| < dr, split at its two ends; the subtraction is the sensor model's own.
        let hit_start = walk(wedge, miss_end, |rho| rho - says.echo_m <= -dr);
        let hit_end = walk_window(wedge, self.hit_end.max(hit_start), |rho| rho - says.echo_m < dr);
        Self { miss_end, hit_start, hit_end: hit_end.max(hit_start) }
    }

    /// Open interval of the echoes that have these marks, metres.
    fn interval(self, wedge: &[WedgeCell], dr: f64) -> (f64, f64) {
        let after = |mark: u32| wedge.get(mark as usize).map_or(f64::INFINITY, |cell| cell.rho_m);
        let before = |mark: u32| {
            let cell = wedge.get((mark as usize).wrapping_sub(1));
            cell.map_or(f64::NEG_INFINITY, |cell| cell.rho_m)
        };
        let low =
            (before(self.miss_end).max(before(self.hit_start)) + dr).max(before(self.hit_end) - dr);
        let high =
            (after(self.miss_end).min(after(self.hit_start)) + dr).min(after(self.hit_end) - dr);
        (low, high)
    }
}

/// As [`walk`], for a mark that moves a few cells, either way, at random: counts within a window
/// without a branch, since a mispredicted one costs more than the window.
#[inline]
fn walk_window(wedge: &[WedgeCell], guess: u32, inside: impl Fn(f64) -> bool) -> u32 {
    const WINDOW: usize = 4;
    let Some(last) = wedge.len().checked_sub(WINDOW) else { return walk(wedge, guess, inside) };
    let first = (guess as usize).saturating_sub(WINDOW / 2).min(last);
    let Some([a, b, c, d]) = wedge.get(first..first + WINDOW) else { return guess };
    let count = |cell: &WedgeCell| u32::from(inside(cell.rho_m));
    let mark = first as u32 + ((count(a) + count(b)) + (count(c) + count(d)));
    walk(wedge, mark, inside)
}

/// The number of leading cells for which `inside` holds, searched from a guess near it.
#[inline]
fn walk(wedge: &[WedgeCell], guess: u32, inside: impl Fn(f64) -> bool) -> u32 {
    let mut mark = guess as usize;
    while let Some(cell) = wedge.get(mark)
        && inside(cell.rho_m)
    {
        mark += 1;
    }
    while let Some(cell) = wedge.get(mark.wrapping_sub(1))
        && !inside(cell.rho_m)
    {
        mark -= 1;
    }
    mark as u32
}

/// Notes the votes of one beam that change from the old marks to the new ones.
fn note_votes(wedge: &[WedgeCell], old: Marks, new: Marks, votes: &mut Votes) {
    let span = |from: u32, to: u32| wedge.get(from as usize..to as usize).unwrap_or(&[]);
    let touching = |marks: Marks| marks.miss_end == marks.hit_start;
    let overlapping = new.hit_start < old.hit_end && old.hit_start < new.hit_end;
    if touching(old) && touching(new) && overlapping {
        // The usual case: the echo moved a little. Nearer cells turn from hit to miss or back.
        let near = (old.hit_start.min(new.hit_start), old.hit_start.max(new.hit_start));
        let far = (old.hit_end.min(new.hit_end), old.hit_end.max(new.hit_end));
        let sign = |grows: bool| if grows { 1_u64 } else { u64::MAX };
        let turned = MISS.wrapping_sub(HIT).wrapping_mul(sign(new.hit_start > old.hit_start));
        votes.note(span(near.0, near.1), turned);
        votes.note(span(far.0, far.1), HIT.wrapping_mul(sign(new.hit_end > old.hit_end)));
    } else {
        votes.note(span(new.hit_start, new.hit_end), HIT);
        votes.note(span(old.miss_end, new.miss_end), MISS);
        votes.note(span(old.hit_start, old.hit_end), HIT.wrapping_neg());
        votes.note(span(new.miss_end, old.miss_end), MISS.wrapping_neg());
    }
}

/// The least f32 that is not below `x`.
fn f32_not_below(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) < x { near.next_up() } else { near }
}

/// The greatest f32 that is below `x`.
fn f32_below(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) >= x { near.next_down() } else { near }
}
