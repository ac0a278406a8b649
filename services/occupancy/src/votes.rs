//! Votes of all beams on every cell, and the frame that follows from them (paper, 3.3):
//! hit > miss > unknown, whoever says it.

use crate::wedge::FEW;
use protocol::frame::Evidence;
use std::ops::BitAnd;

/// What one beam says differently of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(crate) enum Change {
    /// It says hit, and said nothing.
    Hit,
    /// It said hit, and says nothing.
    NoHit,
    /// It says miss, and said nothing.
    Miss,
    /// It said miss, and says nothing.
    NoMiss,
    /// It said hit, and says miss.
    HitToMiss,
    /// It said miss, and says hit.
    MissToHit,
}

/// Bits of a change beside its cell: 22 bits of cell are `GridGeometry::CELLS_MAX`.
const CHANGE_BITS: u32 = 3;

/// Votes, the planes of the fused frame, and the cells that changed since they were last taken.
#[derive(Debug, Clone)]
pub(crate) struct Votes {
    tallies: Tallies,
    pub(crate) hit: Vec<u64>,
    pub(crate) known: Vec<u64>,
    pub(crate) changed: Vec<u32>,
    /// Changes that are not cast yet are the first `noted`, cell << 3 | change; there is always room
    /// for more.
    pending: Vec<u32>,
    noted: usize,
    /// Cells of a cast whose votes may say something else than the planes.
    contested: Vec<u32>,
}

/// Per cell: hit votes, miss votes, evidence in the planes (2 bits), listed (1 bit).
#[derive(Debug, Clone)]
enum Tallies {
    /// Up to 63 votes each: a quarter of the memory, which is what a cast waits for.
    Narrow(Vec<u16>),
    /// Up to 2^24 - 1: 64 lasers of 4096 beams are 2^18.
    Wide(Vec<u64>),
}

/// Most beams on a cell for [`Tallies::Narrow`].
const NARROW_MAX: u32 = 63;

/// A tally of votes: hits in the low bits, then misses, then evidence and listed.
trait Tally: Copy + BitAnd<Output = Self> {
    /// Bits of each number of votes.
    const BITS: u32;
    const LIVE_SHIFT: u32 = 2 * Self::BITS;
    fn from_u64(value: u64) -> Self;
    fn into_u64(self) -> u64;
    fn plus(self, other: Self) -> Self;

    fn listed() -> u64 {
        1 << (Self::LIVE_SHIFT + 2)
    }

    /// What is added by each [`Change`], wrapping.
    fn steps() -> [Self; 1 << CHANGE_BITS] {
        let (hit, miss) = (1_u64, 1_u64 << Self::BITS);
        let turned = miss.wrapping_sub(hit);
        let minus = u64::wrapping_neg;
        [hit, minus(hit), miss, minus(miss), turned, minus(turned), 0, 0].map(Self::from_u64)
    }

    /// `Evidence as u64` of the votes.
    #[inline]
    fn evidence(self) -> u64 {
        let votes = self.into_u64();
        let (hits, misses) = ((1_u64 << Self::BITS) - 1, ((1_u64 << Self::BITS) - 1) << Self::BITS);
        let hit = Evidence::Hit as u64 * u64::from(votes & hits != 0);
        hit.max(u64::from(votes & misses != 0))
    }

    /// Evidence in the planes.
    #[inline]
    fn live(self) -> u64 {
        self.into_u64() >> Self::LIVE_SHIFT & 3
    }
}

impl Tally for u16 {
    const BITS: u32 = 6;
    #[inline]
    fn from_u64(value: u64) -> Self {
        value as Self
    }
    #[inline]
    fn into_u64(self) -> u64 {
        u64::from(self)
    }
    #[inline]
    fn plus(self, other: Self) -> Self {
        self.wrapping_add(other)
    }
}

impl Tally for u64 {
    const BITS: u32 = 24;
    #[inline]
    fn from_u64(value: u64) -> Self {
        value
    }
    #[inline]
    fn into_u64(self) -> u64 {
        self
    }
    #[inline]
    fn plus(self, other: Self) -> Self {
        self.wrapping_add(other)
    }
}

impl Votes {
    pub(crate) fn new(cells: usize) -> Self {
        let words = cells.div_ceil(64);
        Self {
            tallies: Tallies::Narrow(vec![0; cells]),
            hit: vec![0; words],
            known: vec![0; words],
            changed: Vec::new(),
            pending: vec![0; FEW],
            noted: 0,
            contested: Vec::new(),
        }
    }

    /// Makes sure that `beams` votes on a cell can be counted. Nothing may be noted.
    pub(crate) fn expect(&mut self, beams: u32) {
        if let (Tallies::Narrow(narrow), true) = (&self.tallies, beams > NARROW_MAX) {
            let widen = |&tally: &u16| {
                let field = |shift: u32, bits: u32| u64::from(tally) >> shift & ((1 << bits) - 1);
                field(0, 6)
                    | field(6, 6) << <u64 as Tally>::BITS
                    | field(12, 3) << (2 * <u64 as Tally>::BITS)
            };
            self.tallies = Tallies::Wide(narrow.iter().map(widen).collect());
        }
    }

    /// Notes a change of some cells.
    pub(crate) fn note(&mut self, cells: &[u32], change: Change) {
        let end = self.noted + cells.len();
        self.make_room(end);
        for (slot, &cell) in self.pending[self.noted..end].iter_mut().zip(cells) {
            *slot = cell << CHANGE_BITS | change as u32;
        }
        self.noted = end;
    }

    /// Notes a change of the first `count` of a few cells: all are written, that many are kept,
    /// since a loop of unpredictable length costs more than the stores.
    #[inline]
    pub(crate) fn note_few(&mut self, cells: [u32; FEW], count: usize, change: Change) {
        debug_assert!(count <= FEW);
        if let Some(slots) = self.pending.get_mut(self.noted..self.noted + FEW) {
            for (slot, cell) in slots.iter_mut().zip(cells) {
                *slot = cell << CHANGE_BITS | change as u32;
            }
        }
        self.noted += count;
        self.make_room(self.noted);
    }

    /// Room for a few more behind `end`.
    #[inline]
    fn make_room(&mut self, end: usize) {
        if self.pending.len() < end + FEW {
            self.pending.resize(2 * end + FEW, 0);
        }
    }

    /// Casts what was noted.
    pub(crate) fn cast(&mut self) {
        let Self { tallies, pending, noted, contested, .. } = self;
        let noted = pending.get(..std::mem::take(noted)).unwrap_or(&[]);
        if contested.len() < noted.len() {
            contested.resize(pending.len(), 0);
        }
        match tallies {
            Tallies::Narrow(tallies) => {
                let count = add(tallies, noted, contested);
                let contested = contested.get(..count).unwrap_or(&[]);
                show(tallies, contested, &mut self.hit, &mut self.known, &mut self.changed);
            }
            Tallies::Wide(tallies) => {
                let count = add(tallies, noted, contested);
                let contested = contested.get(..count).unwrap_or(&[]);
                show(tallies, contested, &mut self.hit, &mut self.known, &mut self.changed);
            }
        }
    }

    pub(crate) fn clear_changed(&mut self) {
        fn unlist<T: Tally>(tallies: &mut [T], cells: &[u32]) {
            for &cell in cells {
                let tally = &mut tallies[cell as usize];
                *tally = *tally & T::from_u64(!T::listed());
            }
        }
        match &mut self.tallies {
            Tallies::Narrow(tallies) => unlist(tallies, &self.changed),
            Tallies::Wide(tallies) => unlist(tallies, &self.changed),
        }
        self.changed.clear();
    }
}

/// Adds the noted changes; the number of contested cells.
///
/// A loop of its own: which cells are contested is random, and what is done about it should not
/// hang on a branch that cannot be predicted.
fn add<T: Tally>(tallies: &mut [T], noted: &[u32], contested: &mut [u32]) -> usize {
    let steps = T::steps();
    let mut count = 0;
    for note in noted {
        let (cell, change) = (note >> CHANGE_BITS, note % (1 << CHANGE_BITS));
        let Some(slot) = tallies.get_mut(cell as usize) else { continue };
        let tally = slot.plus(steps[change as usize]);
        *slot = tally;
        if let Some(contested) = contested.get_mut(count) {
            *contested = cell;
        }
        count += usize::from(tally.evidence() != tally.live());
    }
    count
}

/// Brings the planes up to date with the votes of some cells, and lists those that changed.
fn show<T: Tally>(
    tallies: &mut [T],
    cells: &[u32],
    hit: &mut [u64],
    known: &mut [u64],
    changed: &mut Vec<u32>,
) {
    for &cell in cells {
        let (word, bit) = (cell as usize / 64, cell % 64);
        let slot = &mut tallies[cell as usize];
        let (tally, evidence) = (slot.into_u64(), slot.evidence());
        if evidence == slot.live() {
            continue; // a later vote turned it back
        }
        let is_hit = u64::from(evidence == Evidence::Hit as u64);
        let is_known = u64::from(evidence != Evidence::Unknown as u64);
        hit[word] = hit[word] & !(1 << bit) | is_hit << bit;
        known[word] = known[word] & !(1 << bit) | is_known << bit;
        if tally & T::listed() == 0 {
            changed.push(cell);
        }
        let votes = tally & !(3 << T::LIVE_SHIFT);
        *slot = T::from_u64(votes | evidence << T::LIVE_SHIFT | T::listed());
    }
}
