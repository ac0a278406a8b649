//! The temporal grid of every cell, every frame (Eq. 7, Eq. 8, "Collapsing the grid").
//!
//! Memory: one byte for each cell of each frame of the longest timescale.

use crate::config::GridConfig;
use protocol::frame::Evidence;
use protocol::grid::{CLASS_UNKNOWN, TIMESCALES_MAX};

/// Cells that are classified together: their distances fit the registers, whatever they are.
const LANES: usize = 8;

/// Dense temporal grid of one area.
#[derive(Debug, Clone)]
pub struct TemporalGrid {
    config: GridConfig,
    /// The last N_longest frames, a ring of `Evidence as u8` [slot, cell].
    ring: Vec<u8>,
    newest: usize,
    last_number: Option<u64>,
    /// S_k, [timescale, cell].
    sums: Vec<i32>,
    /// K, per cell.
    known: Vec<u32>,
    /// Hits in the shortest timescale, per cell.
    hits: Vec<u32>,
    classes: Vec<u8>,
    /// [context, class, cell].
    counts: Vec<u64>,
}

impl TemporalGrid {
    /// A grid that has seen nothing.
    ///
    /// # Panics
    /// If the configuration fails [`GridConfig::check`].
    #[must_use]
    pub fn new(config: GridConfig) -> Self {
        if let Err(error) = config.check() {
            panic!("{error}");
        }
        let cells = config.cells;
        Self {
            ring: vec![Evidence::Unknown as u8; config.longest_frames() as usize * cells],
            newest: 0,
            last_number: None,
            sums: vec![0; config.windows.len() * cells],
            known: vec![0; cells],
            hits: vec![0; cells],
            classes: vec![CLASS_UNKNOWN; cells],
            counts: vec![0; config.contexts * config.classes() * cells],
            config,
        }
    }

    /// Takes frame `number` (`Evidence as u8` per cell); frames that are missing before it are
    /// all-unknown frames.
    pub fn push(&mut self, number: u64, evidence: &[u8], context: usize) {
        if let Some(last) = self.last_number {
            assert!(number > last, "frame {number} after frame {last}");
            let nothing = vec![Evidence::Unknown as u8; self.config.cells];
            for _ in last + 1..number {
                self.step(&nothing, context);
            }
        }
        self.step(evidence, context);
        self.last_number = Some(number);
    }

    /// Takes a frame that never came.
    pub fn push_unknown(&mut self, number: u64, context: usize) {
        self.push(number, &vec![Evidence::Unknown as u8; self.config.cells], context);
    }

    fn step(&mut self, evidence: &[u8], context: usize) {
        self.slide_windows(evidence);
        self.classify();
        self.collapse(context);
    }

    /// Eq. 7: the newest frame enters every window, the frame N_k before it leaves.
    fn slide_windows(&mut self, evidence: &[u8]) {
        let cells = self.config.cells;
        let longest = self.config.longest_frames() as usize;
        let shortest = self.config.shortest_frames() as usize;
        let slot = (self.newest + 1) % longest;
        let leaving = |frames: usize| (slot + longest - frames) % longest * cells;
        for (k, sums) in self.sums.chunks_exact_mut(cells).enumerate() {
            let from = leaving(self.config.windows[k] as usize);
            let out = &self.ring[from..from + cells];
            for ((sum, &new), &old) in sums.iter_mut().zip(evidence).zip(out) {
                *sum += value(new) - value(old);
            }
        }
        let out = &self.ring[leaving(longest)..leaving(longest) + cells];
        for ((known, &new), &old) in self.known.iter_mut().zip(evidence).zip(out) {
            *known = *known + u32::from(new != 0) - u32::from(old != 0);
        }
        let out = &self.ring[leaving(shortest)..leaving(shortest) + cells];
        for ((hits, &new), &old) in self.hits.iter_mut().zip(evidence).zip(out) {
            *hits = *hits + u32::from(new == 2) - u32::from(old == 2);
        }
        self.ring[slot * cells..(slot + 1) * cells].copy_from_slice(evidence);
        self.newest = slot;
    }

    /// Eq. 8 for every cell.
    fn classify(&mut self) {
        let cells = self.config.cells;
        let known_min = self.config.known_share_min * f64::from(self.config.longest_frames());
        let transit = self.config.transit.then_some(self.config.prototypes.len() as u8);
        let mut occupancy = [[0.0; LANES]; TIMESCALES_MAX];
        for first in (0..cells).step_by(LANES) {
            let count = LANES.min(cells - first);
            for (k, (row, &frames)) in occupancy.iter_mut().zip(&self.config.windows).enumerate() {
                let sums = &self.sums[k * cells + first..][..count];
                for (o, &sum) in row.iter_mut().zip(sums) {
                    *o = (f64::from(sum) / f64::from(frames) + 1.0) / 2.0;
                }
            }
            let nearest = nearest(&occupancy, &self.config.prototypes);
            for cell in first..first + count {
                let mut class = nearest[cell - first] as u8;
                if let (0, Some(transit), 1..) = (class, transit, self.hits[cell]) {
                    class = transit;
                }
                let unknown = f64::from(self.known[cell]) < known_min;
                self.classes[cell] = if unknown { CLASS_UNKNOWN } else { class };
            }
        }
    }

    fn collapse(&mut self, context: usize) {
        let cells = self.config.cells;
        let classes = self.config.classes();
        let counts = &mut self.counts[context * classes * cells..][..classes * cells];
        for (cell, &class) in self.classes.iter().enumerate() {
            if class != CLASS_UNKNOWN {
                counts[usize::from(class) * cells + cell] += 1;
            }
        }
    }

    /// Class of every cell after the last frame.
    #[must_use]
    pub fn classes(&self) -> &[u8] {
        &self.classes
    }

    /// S_k of a cell.
    #[must_use]
    pub fn sum(&self, timescale: usize, cell: usize) -> i32 {
        self.sums[timescale * self.config.cells + cell]
    }

    /// K of a cell.
    #[must_use]
    pub fn known(&self, cell: usize) -> u32 {
        self.known[cell]
    }

    /// Counts of a context, [class, cell].
    #[must_use]
    pub fn collapsed(&self, context: usize) -> &[u64] {
        let size = self.config.classes() * self.config.cells;
        &self.counts[context * size..][..size]
    }

    /// Size of the ring of frames, bytes.
    #[must_use]
    pub fn history_bytes(&self) -> usize {
        self.ring.len()
    }
}

/// R of Eq. 7: unknown 0, miss -1, hit +1, by arithmetic so that the loop vectorises.
#[inline]
fn value(evidence: u8) -> i32 {
    i32::from(evidence == Evidence::Hit as u8) - i32::from(evidence == Evidence::Miss as u8)
}

/// Ids of the nearest prototypes; ties to the lower id.
#[inline]
fn nearest(occupancy: &[[f64; LANES]], prototypes: &[Vec<f64>]) -> [u64; LANES] {
    let mut least = [f64::INFINITY; LANES];
    let mut id = [0_u64; LANES];
    for (candidate, prototype) in prototypes.iter().enumerate() {
        let mut distance = [0.0; LANES];
        for (row, &p) in occupancy.iter().zip(prototype) {
            for lane in 0..LANES {
                distance[lane] += (row[lane] - p) * (row[lane] - p);
            }
        }
        for lane in 0..LANES {
            let nearer = distance[lane] < least[lane];
            least[lane] = if nearer { distance[lane] } else { least[lane] };
            id[lane] = if nearer { candidate as u64 } else { id[lane] };
        }
    }
    id
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_value_of_evidence_is_that_of_equation_7() {
        assert_eq!(value(Evidence::Unknown as u8), 0);
        assert_eq!(value(Evidence::Miss as u8), -1);
        assert_eq!(value(Evidence::Hit as u8), 1);
    }
}
