//! Fusion that follows the changes: the frame of an area, kept up to date scan by scan.
//!
//! Paper, 3.3: the readings of all lasers become one image; hit overrides miss overrides unknown.
//! Here: every beam votes on the cells of its wedge. A reading that moves from r to r' touches only
//! the cells between the two, and a reading that stays within the interval between two cells
//! touches none: that is most of them, most of the time.
//!
//! The result is bit-identical to [`crate::dense::Fuser`], whatever the order of the scans: the
//! planes are a function of the last scan of each laser.

use crate::sensor_model::LaserModel;
use crate::votes::{Change, Votes};
use crate::wedge::{FEW, Wedge, WedgeTable};
use protocol::geometry::GridGeometry;

/// Beams whose places in the wedges are fetched together: three cache lines each.
const FETCHED_BEAMS: usize = 16;

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
    /// Per beam: readings in [low, high) say what the last one said; NaN as `high` is no limit, and
    /// NaN as reading is in no interval.
    low_m: Vec<f32>,
    high_m: Vec<f32>,
    beams: Vec<Beam>,
    /// Readings in [`range_min_m`, `range_max_m`) are echoes.
    range_min_m: f32,
    range_max_m: f32,
}

/// A beam's wedge in the table, and how far along it the last reading went.
#[derive(Debug, Clone, Copy)]
struct Beam {
    start: usize,
    end: usize,
    /// Cells that "no return" says to be free: the first ones, up to this.
    free_end: u32,
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
    /// each pair of a cell and a beam that covers it, about 0.2 us each. Does nothing if `laser` is
    /// not below the number given to [`Fuser::new`].
    pub fn install(&mut self, laser: usize, model: &LaserModel) {
        self.retract(laser);
        if let Some(slot) = self.lasers.get_mut(laser) {
            *slot = Some(Laser::new(&self.grid, *model));
            let mut beams = vec![0; self.grid.cells()];
            for laser in self.lasers.iter().flatten() {
                laser.wedges.count_beams(&mut beams);
            }
            self.votes.expect(beams.into_iter().max().unwrap_or(0));
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
                laser.move_beam(beam, ranges_m[beam], &mut self.votes);
            }
        }
        self.votes.cast();
    }

    /// The laser is absent: what only it saw is unknown, until its next scan.
    pub fn retract(&mut self, laser: usize) {
        let Some(Some(laser)) = self.lasers.get_mut(laser) else { return };
        for beam in 0..laser.model.beams {
            laser.move_beam(beam, f32::NAN, &mut self.votes);
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
        let beam = |(start, end, free_end)| Beam { start, end, free_end, marks };
        let beams = wedges.bounds().map(beam).collect();
        let mut laser = Self {
            wedges,
            low_m: vec![0.0; model.beams],
            high_m: vec![0.0; model.beams],
            beams,
            range_min_m: f32_not_below(model.geometry.range_min_m),
            range_max_m: f32_not_below(model.geometry.range_max_m),
            model,
        };
        for beam in 0..laser.model.beams {
            (laser.low_m[beam], laser.high_m[beam]) = laser.silent_interval(f32::NAN);
        }
        laser
    }

    /// Lists the beams whose reading left its interval.
    fn find_moved(&self, ranges_m: &[f32], moved: &mut Vec<u32>) {
        const LANES: usize = 16; // a cache line of ranges
        moved.clear();
        moved.resize(self.model.beams + 1, 0);
        let beams = self.model.beams.min(ranges_m.len());
        #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN as `high` is no limit")]
        let inside = |r: f32, low: f32, high: f32| (r >= low) & !(r >= high);
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
    #[inline]
    fn fetch(&self, beams: &[u32]) {
        let mut touched = 0;
        for &beam in beams {
            if let Some(&Beam { start, marks, .. }) = self.beams.get(beam as usize) {
                touched ^= self.wedges.touch(start, marks.miss_end, marks.hit_end);
            }
        }
        std::hint::black_box(touched);
    }

    fn move_beam(&mut self, index: usize, range_m: f32, votes: &mut Votes) {
        let Some(&Beam { start, end, free_end, marks: old }) = self.beams.get(index) else {
            return;
        };
        let wedge = self.wedges.wedge(start, end);
        let new;
        if range_m >= self.range_min_m && range_m < self.range_max_m {
            new = old.moved_to(&wedge, range_m);
            let (low, high) = new.interval(&wedge);
            self.low_m[index] = low.max(self.range_min_m);
            self.high_m[index] = high.min(self.range_max_m);
        } else {
            let miss_end = if range_m >= self.range_max_m { free_end } else { 0 };
            new = Marks { miss_end, hit_start: miss_end, hit_end: miss_end };
            (self.low_m[index], self.high_m[index]) = self.silent_interval(range_m);
        }
        if new != old {
            self.note_votes(start, old, new, votes);
            self.beams[index].marks = new;
        }
    }

    /// The readings that say the same as one that is no echo.
    fn silent_interval(&self, range_m: f32) -> (f32, f32) {
        if range_m >= self.range_max_m && self.model.no_return_is_free {
            (self.range_max_m, f32::NAN)
        } else {
            (f32::NEG_INFINITY, self.range_min_m)
        }
    }

    /// Notes the votes of one beam that change from the old marks to the new ones.
    fn note_votes(&self, start: usize, old: Marks, new: Marks, votes: &mut Votes) {
        if old.touches() && new.touches() {
            // The usual case: the echo moved a little. Nearer cells turn from hit to miss or back.
            let near = old.hit_start.abs_diff(new.hit_start) as usize;
            let far = old.hit_end.abs_diff(new.hit_end) as usize;
            if near <= FEW && far <= FEW {
                let further = new.hit_start > old.hit_start;
                let turned = if further { Change::HitToMiss } else { Change::MissToHit };
                let further = new.hit_end > old.hit_end;
                let seen = if further { Change::Hit } else { Change::NoHit };
                let first = |a: u32, b: u32| self.wedges.few_cells(start + a.min(b) as usize);
                votes.note_few(first(old.hit_start, new.hit_start), near, turned);
                votes.note_few(first(old.hit_end, new.hit_end), far, seen);
                return;
            }
        }
        let span =
            |from: u32, to: u32| self.wedges.cells(start + from as usize, start + to as usize);
        votes.note(span(new.hit_start, new.hit_end), Change::Hit);
        votes.note(span(old.miss_end, new.miss_end), Change::Miss);
        votes.note(span(old.hit_start, old.hit_end), Change::NoHit);
        votes.note(span(new.miss_end, old.miss_end), Change::NoMiss);
    }
}

impl Marks {
    /// The marks of an echo, looked for near these.
    #[inline]
    fn moved_to(self, wedge: &Wedge<'_>, echo_m: f32) -> Self {
        let miss_end = count_up_to(wedge.miss_from_m, self.miss_end, echo_m);
        // After a jump the hits end a few cells behind the misses, wherever they ended before.
        let jumped = miss_end.abs_diff(self.miss_end) > FEW as u32;
        let guess = if jumped { miss_end + FEW as u32 } else { self.hit_end };
        let hit_end = count_up_to(wedge.hit_from_m, guess, echo_m);
        let hit_start = match wedge.hit_until_m {
            Some(hit_until_m) => count_up_to(hit_until_m, self.hit_start, echo_m),
            None => miss_end,
        };
        Self { miss_end, hit_start, hit_end: hit_end.max(hit_start) }
    }

    /// Interval of the echoes that have these marks, metres: from the first, to before the second.
    #[inline]
    fn interval(self, wedge: &Wedge<'_>) -> (f32, f32) {
        let limits = |limits_m: &[f32], mark: u32| {
            let low = limits_m.get((mark as usize).wrapping_sub(1)).copied();
            let high = limits_m.get(mark as usize).copied();
            (low.unwrap_or(f32::NEG_INFINITY), high.unwrap_or(f32::INFINITY))
        };
        let (miss, hit) =
            (limits(wedge.miss_from_m, self.miss_end), limits(wedge.hit_from_m, self.hit_end));
        let (low, high) = (miss.0.max(hit.0), miss.1.min(hit.1));
        match wedge.hit_until_m {
            Some(hit_until_m) => {
                let until = limits(hit_until_m, self.hit_start);
                (low.max(until.0), high.min(until.1))
            }
            None => (low, high),
        }
    }

    /// Whether the hits, if any, begin where the misses end: but for a rounding they do.
    #[inline]
    fn touches(self) -> bool {
        self.miss_end == self.hit_start
    }
}

/// How many leading limits are not above `reading_m`, looked for near `guess`.
#[inline]
fn count_up_to(limits_m: &[f32], guess: u32, reading_m: f32) -> u32 {
    // A mark moves a few cells, either way, at random: counting in a window without a branch is
    // cheaper than a walk whose end is mispredicted.
    const WINDOW: usize = 8;
    let is_up_to = |limit_m: &f32| *limit_m <= reading_m;
    if let Some(last) = limits_m.len().checked_sub(WINDOW) {
        let first = (guess as usize).saturating_sub(WINDOW / 2).min(last);
        if let Some(window) = limits_m.get(first..).and_then(<[f32]>::first_chunk::<WINDOW>) {
            let count: u32 = window.iter().map(|limit_m| u32::from(is_up_to(limit_m))).sum();
            let begins = count > 0 || first == 0;
            let ends = count < WINDOW as u32 || first == last;
            if begins && ends {
                return first as u32 + count;
            }
        }
    }
    limits_m.partition_point(is_up_to) as u32
}

/// The least f32 that is not below `x`.
fn f32_not_below(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) < x { near.next_up() } else { near }
}
