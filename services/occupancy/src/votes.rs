//! Votes of all beams on every cell, and the frame that follows from them (paper, 3.3):
//! hit > miss > unknown, whoever says it.

use crate::wedge::WedgeCell;
use protocol::frame::Evidence;

/// One vote for a hit.
pub(crate) const HIT: u64 = 1;
/// One vote for a miss.
pub(crate) const MISS: u64 = 1 << 24;
/// 24 bits each: 64 lasers of 4096 beams are 2^18 votes.
const HITS: u64 = MISS - 1;
const MISSES: u64 = HITS << 24;
const LIVE_SHIFT: u32 = 48;
const LISTED: u64 = 1 << 56;

/// Votes, the planes of the fused frame, and the cells that changed since they were last taken.
#[derive(Debug, Clone)]
pub(crate) struct Votes {
    /// Per cell: hit votes (24 bits), miss votes (24), evidence in the planes (2), listed (1).
    cells: Vec<u64>,
    pub(crate) hit: Vec<u64>,
    pub(crate) known: Vec<u64>,
    pub(crate) changed: Vec<u32>,
    /// Differences that are not cast yet.
    pending: Vec<Difference>,
}

#[derive(Debug, Clone, Copy)]
struct Difference {
    cell: u32,
    votes: u64,
}

/// Differences whose cells are fetched together before any of them is cast: as many cache misses
/// as a core can have under way, and they stay in its L1 cache.
const FETCHED: usize = 32;

impl Votes {
    pub(crate) fn new(cells: usize) -> Self {
        let words = cells.div_ceil(64);
        Self {
            cells: vec![0; cells],
            hit: vec![0; words],
            known: vec![0; words],
            changed: Vec::new(),
            pending: Vec::new(),
        }
    }

    /// Notes a difference of votes for some cells of a wedge (wrapping: `MISS - HIT` turns a hit
    /// vote into a miss vote).
    #[inline]
    pub(crate) fn note(&mut self, wedge: &[WedgeCell], votes: u64) {
        for cell in wedge {
            self.pending.push(Difference { cell: cell.cell, votes });
        }
    }

    /// Casts what was noted.
    pub(crate) fn cast(&mut self) {
        let pending = std::mem::take(&mut self.pending);
        for differences in pending.chunks(FETCHED) {
            let cells = differences.iter().map(|difference| difference.cell as usize);
            let touched = cells.fold(0, |sum, cell| sum ^ self.cells.get(cell).unwrap_or(&0));
            std::hint::black_box(touched);
            for difference in differences {
                self.add(difference.cell, difference.votes);
            }
        }
        self.pending = pending;
        self.pending.clear();
    }

    #[inline]
    fn add(&mut self, cell: u32, difference: u64) {
        let Some(slot) = self.cells.get_mut(cell as usize) else { return };
        let votes = slot.wrapping_add(difference);
        *slot = votes;
        let evidence =
            if votes & HITS != 0 { Evidence::Hit as u64 } else { u64::from(votes & MISSES != 0) };
        if evidence != votes >> LIVE_SHIFT & 3 {
            self.show(cell, evidence);
        }
    }

    fn show(&mut self, cell: u32, evidence: u64) {
        let (word, bit) = (cell as usize / 64, cell % 64);
        let hit = u64::from(evidence == Evidence::Hit as u64);
        let known = u64::from(evidence != Evidence::Unknown as u64);
        self.hit[word] = self.hit[word] & !(1 << bit) | hit << bit;
        self.known[word] = self.known[word] & !(1 << bit) | known << bit;
        let slot = &mut self.cells[cell as usize];
        if *slot & LISTED == 0 {
            self.changed.push(cell);
        }
        *slot = *slot & !(3 << LIVE_SHIFT) | evidence << LIVE_SHIFT | LISTED;
    }

    pub(crate) fn clear_changed(&mut self) {
        for &cell in &self.changed {
            self.cells[cell as usize] &= !LISTED;
        }
        self.changed.clear();
    }
}
