//! What is normal: counts per context, cell and class, and the probability of a class.
//!
//! Cell i, class k: frames are not independent, so counts are thinned by tau = 60 s, n = frames*T/tau.
//!
//! ```text
//! p_all(k) = (n_k + kappa*pi_k) / (n + kappa)            over all contexts
//! p(k)     = (n_ck + kappa*p_all(k)) / (n_c + kappa)     in context c, where there are several
//! pi_k     = 0.8 * share in the 3x3 neighbours + 0.195 * share in the whole map + 0.005 / K
//! l        = ln(1/K) - ln p(k), at most L_MAX
//! ```
//!
//! `unknown` is counted only to know how well a cell is covered; it is never scored.
//! Counts are run lengths: a cell's run is added when its class changes, and read as if it had
//! been. The clock of the runs stands still while nothing is to be learnt anywhere (a fault), and a
//! *held* cell (in an open event, in quarantine) learns nothing. So an evidence l is always that of
//! frames the model has not seen: every score is held out.

use crate::plane::{Plane, for_each_neighbour};
use protocol::geometry::GridGeometry;
use protocol::grid::CLASSES_MAX;

/// Frames closer than this say the same thing, seconds.
pub(crate) const TAU_S: f64 = 60.0;
/// Weight of the prior, in thinned frames.
const KAPPA: f64 = 3.0;
const PRIOR_NEIGHBOURS: f64 = 0.8;
const PRIOR_MAP: f64 = 0.195;
const PRIOR_UNIFORM: f64 = 0.005;
/// Largest evidence of one cell, nats: months of learning make a cell that never changed ever more
/// certain; without a ceiling the thresholds of the first day would not fit the second month.
pub(crate) const L_MAX: f64 = 8.0;
/// What was learnt fades by half in this time of learning, seconds: three weeks.
const HALF_LIFE_S: f64 = 21.0 * 86_400.0;
/// Fading is done in steps of this time of learning, seconds.
const FADE_S: f64 = 86_400.0;
/// Somebody who walks or stands a little beside where others did is as normal as they were: p of a
/// class of presence is at least this times its share within [`NEAR_M`].
const NEAR_WEIGHT: f64 = 0.5;
pub(crate) const NEAR_M: f64 = 0.4;
/// A cell that is known in less than this share of the learnt time is not missed when unknown.
const COVERED_SHARE: f64 = 0.9;

/// The counts of an area, and the class that each cell shows now.
#[derive(Debug, Clone)]
pub(crate) struct Normal {
    grid: GridGeometry,
    period_s: f64,
    classes: usize,
    /// [context][cell * (classes + 1) + slot], frames.
    counts: Vec<Vec<u32>>,
    context: usize,
    live: Vec<u8>,
    since: Vec<u32>,
    clock: u32,
    held: Plane,
    map_share: Vec<f64>,
    /// [class][cell]: share of a class of presence within [`NEAR_M`]; empty for the others.
    near: Vec<Vec<f32>>,
    /// Frames learnt in each context.
    learnt: Vec<u64>,
    unfaded: u64,
}

/// What a cell showed, frames.
pub(crate) struct Stock {
    /// By class.
    pub(crate) seen: [u64; CLASSES_MAX],
    /// Sum of `seen`.
    pub(crate) known: u64,
    pub(crate) unknown: u64,
}

impl Stock {
    /// The class that was shown most, with its share; `None` if none was.
    pub(crate) fn usual(&self) -> Option<(u8, f64)> {
        let (mut slot, mut most) = (0, 0);
        for (other, count) in self.seen.iter().enumerate() {
            if *count > most {
                (slot, most) = (other as u8, *count);
            }
        }
        (self.known > 0).then(|| (slot, most as f64 / self.known as f64))
    }
}

impl Normal {
    pub(crate) fn new(grid: GridGeometry, period_s: f64, classes: usize, contexts: usize) -> Self {
        let cells = grid.cells();
        let contexts = contexts.max(1);
        Self {
            grid,
            period_s,
            classes,
            counts: vec![vec![0; cells * (classes + 1)]; contexts],
            context: 0,
            live: vec![classes as u8; cells],
            since: vec![0; cells],
            clock: 0,
            held: Plane::new(cells),
            map_share: vec![1.0 / classes as f64; classes],
            near: vec![Vec::new(); classes],
            learnt: vec![0; contexts],
            unfaded: 0,
        }
    }

    pub(crate) fn live(&self) -> &[u8] {
        &self.live
    }

    pub(crate) fn period_s(&self) -> f64 {
        self.period_s
    }

    /// Frames learnt, all contexts.
    pub(crate) fn learnt_frames(&self) -> u64 {
        self.learnt.iter().sum()
    }

    /// Seconds of normal life behind the model.
    pub(crate) fn learnt_s(&self) -> f64 {
        self.learnt_frames() as f64 * self.period_s
    }

    /// A frame of normal life passes: runs grow by one.
    pub(crate) fn tick(&mut self) {
        self.clock = self.clock.wrapping_add(1);
        self.learnt[self.context] += 1;
        self.unfaded += 1;
        if self.unfaded as f64 * self.period_s >= FADE_S {
            self.unfaded = 0;
            self.fade();
        }
    }

    /// The part of the week changes.
    pub(crate) fn set_context(&mut self, context: usize) {
        let context = context.min(self.counts.len() - 1);
        if context != self.context {
            self.settle_all();
            self.context = context;
        }
    }

    /// A cell shows another class (a slot; `classes` is unknown).
    pub(crate) fn change(&mut self, cell: usize, slot: u8) {
        self.settle(cell);
        self.live[cell] = slot;
    }

    /// From now on nothing is learnt from the cells of `held`, and again from the others. What a
    /// newly held cell of `evidence` shows began the event: that run is not learnt either.
    pub(crate) fn hold(&mut self, held: &Plane, evidence: &Plane) {
        let before = self.held.clone();
        before.for_each_difference(held, |cell, value| {
            if value && evidence.get(cell) {
                self.since[cell] = self.clock;
            }
            self.settle(cell);
            self.held.set(cell, value);
        });
    }

    fn settle(&mut self, cell: usize) {
        let run = self.clock.wrapping_sub(self.since[cell]);
        self.since[cell] = self.clock;
        if run > 0 && !self.held.get(cell) {
            let slot = cell * (self.classes + 1) + usize::from(self.live[cell]);
            let count = &mut self.counts[self.context][slot];
            *count = count.saturating_add(run);
        }
    }

    /// Adds all runs to the counts.
    pub(crate) fn settle_all(&mut self) {
        for cell in 0..self.live.len() {
            self.settle(cell);
        }
    }

    fn fade(&mut self) {
        self.settle_all();
        let keep = (-std::f64::consts::LN_2 * FADE_S / HALF_LIFE_S).exp();
        for count in self.counts.iter_mut().flatten() {
            *count = (f64::from(*count) * keep).round() as u32;
        }
        for frames in &mut self.learnt {
            *frames = (*frames as f64 * keep).round() as u64;
        }
    }

    fn open_run(&self, cell: usize) -> u32 {
        if self.held.get(cell) { 0 } else { self.clock.wrapping_sub(self.since[cell]) }
    }

    /// (frames in class, frames known) of one context.
    fn frames_in(&self, context: usize, cell: usize, slot: u8) -> (f64, f64) {
        let stride = self.classes + 1;
        let counts = &self.counts[context][cell * stride..cell * stride + self.classes];
        let mut known: u64 = counts.iter().map(|count| u64::from(*count)).sum();
        let mut seen = u64::from(counts[usize::from(slot)]);
        if context == self.context && usize::from(self.live[cell]) < self.classes {
            let run = u64::from(self.open_run(cell));
            known += run;
            seen += if self.live[cell] == slot { run } else { 0 };
        }
        (seen as f64, known as f64)
    }

    /// (frames in class, frames known) of all contexts.
    pub(crate) fn frames(&self, cell: usize, slot: u8) -> (f64, f64) {
        (0..self.counts.len()).fold((0.0, 0.0), |sum, context| {
            let (seen, known) = self.frames_in(context, cell, slot);
            (sum.0 + seen, sum.1 + known)
        })
    }

    /// p of a class (not `unknown`) in a cell, in the present context.
    pub(crate) fn probability(&self, cell: usize, slot: u8) -> f64 {
        let (mut near_seen, mut near_known) = (0.0, 0.0);
        for_each_neighbour(&self.grid, cell, |neighbour| {
            let (seen, known) = self.frames(neighbour, slot);
            near_seen += seen;
            near_known += known;
        });
        let map = self.map_share[usize::from(slot)];
        let near = if near_known > 0.0 { near_seen / near_known } else { map };
        let prior = PRIOR_NEIGHBOURS * near + PRIOR_MAP * map + PRIOR_UNIFORM / self.classes as f64;
        let thin = self.period_s / TAU_S;
        let posterior = |(seen, known): (f64, f64), prior: f64| {
            (seen * thin + KAPPA * prior) / (known * thin + KAPPA)
        };
        let all = posterior(self.frames(cell, slot), prior);
        if self.counts.len() == 1 {
            return all;
        }
        posterior(self.frames_in(self.context, cell, slot), all)
    }

    /// l of a class (not `unknown`) in a cell, nats, at most [`L_MAX`].
    pub(crate) fn surprise(&self, cell: usize, slot: u8) -> f64 {
        let uniform = -(self.classes as f64).ln();
        let near = self.near[usize::from(slot)].get(cell).map_or(0.0, |share| f64::from(*share));
        let p = self.probability(cell, slot).max(NEAR_WEIGHT * near);
        (uniform - p.ln()).min(L_MAX)
    }

    /// The class that a cell shows most, with its share; `None` if it was never known.
    pub(crate) fn usual(&self, cell: usize) -> Option<(u8, f64)> {
        self.stock(cell).usual()
    }

    /// Frames of a cell, all contexts.
    pub(crate) fn stock(&self, cell: usize) -> Stock {
        let mut stock = Stock { seen: [0; CLASSES_MAX], known: 0, unknown: 0 };
        let first = cell * (self.classes + 1);
        for counts in &self.counts {
            let Some((unknown, seen)) = counts[first..=first + self.classes].split_last() else {
                continue;
            };
            for (sum, count) in stock.seen.iter_mut().zip(seen) {
                *sum += u64::from(*count);
            }
            stock.unknown += u64::from(*unknown);
        }
        let run = u64::from(self.open_run(cell));
        match usize::from(self.live[cell]) {
            live if live < self.classes => stock.seen[live] += run,
            _ => stock.unknown += run,
        }
        stock.known = stock.seen.iter().sum();
        stock
    }

    /// Whether a cell is usually known, and for long enough to say so.
    pub(crate) fn is_covered(&self, stock: &Stock) -> bool {
        let total = (stock.known + stock.unknown) as f64;
        total * self.period_s >= TAU_S && stock.known as f64 >= COVERED_SHARE * total
    }

    /// True if the cell shows this class more often than not: no need to score it.
    pub(crate) fn is_usual(&self, cell: usize, slot: u8) -> bool {
        let (seen, known) = self.frames_in(self.context, cell, slot);
        known > 0.0 && seen > 0.5 * known
    }

    /// Shares of the classes in the whole map, from the frames of all cells by class.
    pub(crate) fn set_map_share(&mut self, seen: &[u64; CLASSES_MAX]) {
        let total: u64 = seen.iter().sum();
        for (share, sum) in self.map_share.iter_mut().zip(seen) {
            *share = if total > 0 { *sum as f64 / total as f64 } else { 1.0 / self.classes as f64 };
        }
    }

    /// Share of a class of presence within [`NEAR_M`] of a cell.
    pub(crate) fn set_near(&mut self, slot: u8, cell: usize, share: f32) {
        let near = &mut self.near[usize::from(slot)];
        near.resize(self.live.len(), 0.0); // once
        near[cell] = share;
    }

    /// Replaces the counts of a context by a collapsed map [class, row, column] of the same shape
    /// (checked by the caller).
    pub(crate) fn seed(&mut self, context: usize, collapsed: &[u64]) {
        self.settle_all();
        let cells = self.live.len();
        let stride = self.classes + 1;
        let counts = &mut self.counts[context];
        counts.fill(0);
        for (index, count) in collapsed.iter().enumerate() {
            let (class, cell) = (index / cells, index % cells);
            counts[cell * stride + class] = u32::try_from(*count).unwrap_or(u32::MAX);
        }
        self.learnt[context] = collapsed_frames(collapsed, cells);
    }

    pub(crate) fn contexts(&self) -> usize {
        self.counts.len()
    }

    pub(crate) fn learnt_in(&self, context: usize) -> u64 {
        self.learnt[context]
    }

    /// What is to be kept: counts and learnt frames per context. Settles all runs.
    pub(crate) fn parts(&mut self) -> (&[Vec<u32>], &[u64], u64) {
        self.settle_all();
        (&self.counts, &self.learnt, self.unfaded)
    }

    /// Puts back what [`Normal::parts`] gave; false if the shape is another.
    pub(crate) fn put_back(
        &mut self,
        counts: Vec<Vec<u32>>,
        learnt: Vec<u64>,
        unfaded: u64,
    ) -> bool {
        let length = self.live.len() * (self.classes + 1);
        let fits = counts.len() == self.counts.len()
            && learnt.len() == self.learnt.len()
            && counts.iter().all(|context| context.len() == length);
        if fits {
            (self.counts, self.learnt, self.unfaded) = (counts, learnt, unfaded);
            self.since.fill(self.clock);
        }
        fits
    }
}

/// Frames of which a collapsed map [class, row, column] tells: those of its best known cell.
pub(crate) fn collapsed_frames(collapsed: &[u64], cells: usize) -> u64 {
    (0..cells)
        .map(|cell| collapsed.iter().skip(cell).step_by(cells).fold(0, u64_add))
        .max()
        .unwrap_or(0)
}

fn u64_add(sum: u64, count: &u64) -> u64 {
    sum.saturating_add(*count)
}

#[cfg(test)]
#[path = "normal_tests.rs"]
mod tests;
