//! Frames, class maps and collapsed maps on their way to another host.
//!
//! Frames and class maps are streams of small values, one a cell, in which little changes: a key frame
//! says all of it, a delta what changed since the message before it. Both are lists of codes that
//! postcard writes as varints; with `n` symbols a code is `count * n + symbol`:
//!
//! | kind | `count` of a code |
//! |---|---|
//! | key frame | further cells with the same symbol: a run of `count + 1` |
//! | delta | unchanged cells between the cell before (or the beginning) and this one: sorted |
//!
//! A symbol of a frame is its [`Evidence`]; of a class map the class id + 1, and 0 for unknown.
//! A reader that missed a message waits for the next key frame; there is one a second. Pure.

use crate::frame::Evidence;
use crate::geometry::GridGeometry;
use crate::grid::{CLASS_UNKNOWN, CLASSES_MAX};
use serde::{Deserialize, Serialize};

/// Most counts in one [`CarriedCounts`]: a page of at most 400 kB.
pub const COUNTS_PAGE_MAX: usize = 32 * 1024;

/// What a map of an area says of its cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MapContent {
    /// A frame: [`Planes`].
    Frame,
    /// A class map: [`ClassIds`].
    Classes,
}

/// A frame or a class map on its way to another host.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CarriedMap {
    /// The host that says it.
    pub host: String,
    /// The area's id.
    pub area: String,
    /// Which of its maps.
    pub content: MapContent,
    /// Names the run of the bridge that sends.
    pub session: u64,
    /// Grows by one a message within the session: a delta follows the message `seq - 1`.
    pub seq: u64,
    /// m of the frame.
    pub number: u64,
    /// T, nanoseconds.
    pub period_ns: u64,
    /// Lasers in the frame, as in `FrameHeader`.
    pub lasers_present: u64,
    /// Of a class map: the context that the frame's stamp falls into.
    pub context: u32,
    /// Of a class map: number of classes.
    pub classes: u32,
    /// Cells along x; 0 at the end of a recording.
    pub columns: u32,
    /// Cells along y; 0 at the end of a recording.
    pub rows: u32,
    /// True for a key frame.
    pub is_key: bool,
    /// See the page of this module.
    pub codes: Vec<u32>,
}

impl CarriedMap {
    /// Not too large.
    ///
    /// # Errors
    /// A sentence with what was found and what was expected.
    pub fn check_lengths(&self) -> Result<(), String> {
        let cells = cells(self.columns, self.rows)?;
        if self.codes.len() > cells {
            return Err(format!("{} codes of {cells} cells", self.codes.len()));
        }
        if self.classes as usize > CLASSES_MAX {
            return Err(format!("{} classes, expected at most {CLASSES_MAX}", self.classes));
        }
        Ok(())
    }

    /// True for the end of a recording: there is no map in it.
    #[must_use]
    pub fn is_end_of_stream(&self) -> bool {
        self.columns == 0 && self.rows == 0
    }
}

fn cells(columns: u32, rows: u32) -> Result<usize, String> {
    let cells = u64::from(columns) * u64::from(rows);
    if cells > GridGeometry::CELLS_MAX as u64 {
        let expected = GridGeometry::CELLS_MAX;
        return Err(format!("{columns} x {rows} cells, expected at most {expected}"));
    }
    Ok(cells as usize)
}

/// A part of a collapsed map of one context.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CarriedCounts {
    /// The host that says it.
    pub host: String,
    /// The area's id.
    pub area: String,
    /// The last frame that is counted.
    pub number: u64,
    /// T, nanoseconds.
    pub period_ns: u64,
    /// Index of the context; 0 is `always`.
    pub context: u32,
    /// Number of classes.
    pub classes: u32,
    /// Cells along x.
    pub columns: u32,
    /// Cells along y.
    pub rows: u32,
    /// Index of the first count of this part in [class, row, column].
    pub offset: u32,
    /// How often a count follows itself, and the count: runs, at most [`COUNTS_PAGE_MAX`] counts in all.
    pub runs: Vec<(u32, u64)>,
}

impl CarriedCounts {
    /// A part of `counts` ([class, row, column]) from `offset` on, with everything else of `self`.
    #[must_use]
    pub fn part(&self, counts: &[u64], offset: usize) -> Self {
        let mut runs: Vec<(u32, u64)> = Vec::new();
        for &count in counts.iter().skip(offset).take(COUNTS_PAGE_MAX) {
            match runs.last_mut() {
                Some((length, last)) if *last == count => *length += 1,
                _ => runs.push((1, count)),
            }
        }
        Self { offset: offset as u32, runs, ..self.clone() }
    }

    /// How many counts the whole map has.
    #[must_use]
    pub fn counts(&self) -> usize {
        self.classes as usize * self.columns as usize * self.rows as usize
    }

    /// How many counts this part has.
    #[must_use]
    pub fn len(&self) -> usize {
        self.runs.iter().map(|(length, _)| *length as usize).sum()
    }

    /// True if there is nothing in it.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// Writes this part into a map of [`Self::counts`] counts.
    pub fn write(&self, counts: &mut [u64]) {
        let mut place = counts.iter_mut().skip(self.offset as usize);
        for (length, count) in &self.runs {
            place.by_ref().take(*length as usize).for_each(|place| *place = *count);
        }
    }

    /// Not too large, and inside its map.
    ///
    /// # Errors
    /// A sentence with what was found and what was expected.
    pub fn check_extent(&self) -> Result<(), String> {
        cells(self.columns, self.rows)?;
        if self.classes as usize > CLASSES_MAX {
            return Err(format!("{} classes, expected at most {CLASSES_MAX}", self.classes));
        }
        let length = self.runs.iter().map(|(length, _)| u64::from(*length)).sum::<u64>();
        if length > COUNTS_PAGE_MAX as u64 || self.runs.iter().any(|(length, _)| *length == 0) {
            return Err(format!(
                "{length} counts, expected at most {COUNTS_PAGE_MAX}, no empty run"
            ));
        }
        let end = u64::from(self.offset) + length;
        if end > self.counts() as u64 {
            return Err(format!("counts up to {end} of a map of {}", self.counts()));
        }
        Ok(())
    }
}

/// Small values, one a cell.
pub trait Cells: Clone {
    /// Symbols are below this.
    const SYMBOLS: u32;
    /// How many cells.
    fn cells(&self) -> usize;
    /// The symbol of a cell.
    fn symbol(&self, cell: usize) -> u32;
    /// Sets a cell; `symbol` is below [`Self::SYMBOLS`].
    fn set(&mut self, cell: usize, symbol: u32);
    /// Calls `changed` for every cell that differs from `other`, in order. Both are of one size.
    fn differences(&self, other: &Self, changed: impl FnMut(usize));
}

/// The bit planes of a frame, as in shared memory: first those of hits, then those of known cells.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Planes {
    /// As the payload of a frame.
    pub words: Vec<u64>,
    /// How many cells the planes are of.
    pub cells: usize,
}

impl Planes {
    /// Of `cells` cells, all unknown.
    #[must_use]
    pub fn new(cells: usize) -> Self {
        Self { words: vec![0; 2 * cells.div_ceil(64)], cells }
    }
}

impl Cells for Planes {
    const SYMBOLS: u32 = 3;

    fn cells(&self) -> usize {
        self.cells
    }

    fn symbol(&self, cell: usize) -> u32 {
        let bit = |plane: usize| self.words[plane + cell / 64] >> (cell % 64) & 1 == 1;
        match (bit(self.words.len() / 2), bit(0)) {
            (false, _) => Evidence::Unknown as u32,
            (true, false) => Evidence::Miss as u32,
            (true, true) => Evidence::Hit as u32,
        }
    }

    fn set(&mut self, cell: usize, symbol: u32) {
        let (half, mask) = (self.words.len() / 2, 1 << (cell % 64));
        for (plane, is_set) in
            [(0, symbol == Evidence::Hit as u32), (half, symbol != Evidence::Unknown as u32)]
        {
            let word = &mut self.words[plane + cell / 64];
            *word = if is_set { *word | mask } else { *word & !mask };
        }
    }

    fn differences(&self, other: &Self, mut changed: impl FnMut(usize)) {
        let half = self.words.len() / 2;
        for index in 0..half {
            let mut differs = (self.words[index] ^ other.words[index])
                | (self.words[half + index] ^ other.words[half + index]);
            while differs != 0 {
                changed(64 * index + differs.trailing_zeros() as usize);
                differs &= differs - 1;
            }
        }
    }
}

/// The class ids of a class map, as in shared memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ClassIds(pub Vec<u8>);

impl Cells for ClassIds {
    const SYMBOLS: u32 = CLASSES_MAX as u32 + 1;

    fn cells(&self) -> usize {
        self.0.len()
    }

    fn symbol(&self, cell: usize) -> u32 {
        let symbol = u32::from(self.0[cell].wrapping_add(1));
        // An id that no class map has is unknown to others.
        if symbol < Self::SYMBOLS { symbol } else { 0 }
    }

    fn set(&mut self, cell: usize, symbol: u32) {
        self.0[cell] = if symbol == 0 { CLASS_UNKNOWN } else { (symbol - 1) as u8 };
    }

    fn differences(&self, other: &Self, mut changed: impl FnMut(usize)) {
        // Most blocks are equal, and equal blocks are compared as memory.
        const BLOCK: usize = 64;
        for (block, (ours, theirs)) in self.0.chunks(BLOCK).zip(other.0.chunks(BLOCK)).enumerate() {
            if ours != theirs {
                let cells = ours.iter().zip(theirs).enumerate();
                cells
                    .filter(|(_, (ours, theirs))| ours != theirs)
                    .for_each(|(cell, _)| changed(BLOCK * block + cell));
            }
        }
    }
}

/// All cells, as runs.
#[must_use]
pub fn key<C: Cells>(map: &C) -> Vec<u32> {
    let mut codes = Vec::new();
    let mut cell = 0;
    while cell < map.cells() {
        let symbol = map.symbol(cell);
        let end = (cell + 1..map.cells()).find(|&next| map.symbol(next) != symbol);
        let end = end.unwrap_or(map.cells());
        codes.push((end - cell - 1) as u32 * C::SYMBOLS + symbol);
        cell = end;
    }
    codes
}

/// The cells of `map` that differ from those of `before`, which is of the same size.
#[must_use]
pub fn delta<C: Cells>(before: &C, map: &C) -> Vec<u32> {
    let (mut codes, mut next) = (Vec::new(), 0);
    map.differences(before, |cell| {
        codes.push((cell - next) as u32 * C::SYMBOLS + map.symbol(cell));
        next = cell + 1;
    });
    codes
}

/// Makes of `map` what a message says.
///
/// # Errors
/// If the codes lie outside the map, or a key frame does not fill it: then `map` is of no use until the
/// next key frame.
pub fn apply<C: Cells>(map: &mut C, is_key: bool, codes: &[u32]) -> Result<(), String> {
    let (cells, mut next) = (map.cells(), 0usize);
    for code in codes {
        let (count, symbol) = ((code / C::SYMBOLS) as usize, code % C::SYMBOLS);
        let end = next + count + 1;
        if end > cells {
            return Err(format!("codes up to cell {end} of {cells}"));
        }
        let begin = if is_key { next } else { end - 1 };
        (begin..end).for_each(|cell| map.set(cell, symbol));
        next = end;
    }
    if is_key && next != cells {
        return Err(format!("a key frame of {next} cells of {cells}"));
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn planes(symbols: &[u32]) -> Planes {
        let mut planes = Planes::new(symbols.len());
        symbols.iter().enumerate().for_each(|(cell, symbol)| planes.set(cell, *symbol));
        planes
    }

    fn ids(symbols: &[u32]) -> ClassIds {
        let mut ids = ClassIds(vec![0; symbols.len()]);
        symbols.iter().enumerate().for_each(|(cell, symbol)| ids.set(cell, *symbol));
        ids
    }

    fn comes_through<C: Cells + PartialEq + std::fmt::Debug>(before: &C, map: &C, blank: &C) {
        let mut read = blank.clone();
        apply(&mut read, true, &key(before)).unwrap();
        assert_eq!(&read, before);
        apply(&mut read, false, &delta(before, map)).unwrap();
        assert_eq!(&read, map);
    }

    #[test]
    fn codes_are_what_the_page_says() {
        let before = planes(&[0, 0, 0, 1, 1, 2]);
        assert_eq!(key(&before), [2 * 3, 3 + 1, 2], "three, two, one");
        let after = planes(&[0, 2, 0, 1, 0, 2]);
        assert_eq!(delta(&before, &after), [3 + 2, 2 * 3], "one before, two between");
        assert_eq!(delta(&before, &before), [0; 0]);
        assert_eq!(key(&ids(&[0, 17 - 1])), [0, 16]);
        assert_eq!(ids(&[0, 16]).0, [CLASS_UNKNOWN, 15]);
    }

    #[test]
    fn codes_that_do_not_fit_are_refused() {
        let mut map = planes(&[0; 5]);
        assert!(apply(&mut map, true, &[3 * 3]).unwrap_err().contains("4 cells of 5"));
        assert!(apply(&mut map, true, &[5 * 3]).unwrap_err().contains("cell 6 of 5"));
        assert!(apply(&mut map, false, &[4 * 3, 0]).unwrap_err().contains("cell 6 of 5"));
        assert!(apply(&mut map, false, &[u32::MAX]).is_err());
        apply(&mut map, false, &[4 * 3 + 2]).unwrap();
        assert_eq!(map, planes(&[0, 0, 0, 0, 2]));
    }

    proptest! {
        #[test]
        fn what_is_sent_is_what_is_read(
            cells in proptest::collection::vec((0u32..3, 0u32..3, 0u32..17, 0u32..17), 1..300),
        ) {
            let column = |of: fn(&(u32, u32, u32, u32)) -> u32| -> Vec<u32> {
                cells.iter().map(of).collect()
            };
            let blank = planes(&vec![0; cells.len()]);
            comes_through(&planes(&column(|c| c.0)), &planes(&column(|c| c.1)), &blank);
            let blank = ids(&vec![0; cells.len()]);
            comes_through(&ids(&column(|c| c.2)), &ids(&column(|c| c.3)), &blank);
        }

        #[test]
        fn parts_of_counts_make_the_whole(
            runs in proptest::collection::vec((1usize..9000, 0u64..4), 1..20),
        ) {
            let mut counts: Vec<u64> =
                runs.iter().flat_map(|(length, count)| vec![*count; *length]).collect();
            counts.truncate(counts.len() / 2 * 2);
            prop_assume!(!counts.is_empty());
            let head = CarriedCounts {
                host: "h".to_owned(), area: "a".to_owned(), number: 1, period_ns: 1, context: 0,
                classes: 2, columns: counts.len() as u32 / 2, rows: 1, offset: 0, runs: Vec::new(),
            };
            let mut read = vec![9; counts.len()];
            for offset in (0..counts.len()).step_by(COUNTS_PAGE_MAX) {
                let part = head.part(&counts, offset);
                part.check_extent().unwrap();
                prop_assert_eq!(part.len(), COUNTS_PAGE_MAX.min(counts.len() - offset));
                part.write(&mut read);
            }
            prop_assert_eq!(read, counts);
        }
    }
}
