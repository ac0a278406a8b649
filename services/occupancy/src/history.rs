//! The contents of the windows as plain data: what a restart needs to go on as if it had not been.
//!
//! The evidence of every cell in the first frame of the longest timescale, then the flips frame by
//! frame. Sums and classes are functions of it, so a grid that is restored from it is bit-identical
//! to the one that wrote it. The collapsed counts are kept apart: they outlive the windows.

use crate::cell::Cell;
use crate::config::{GridConfig, WINDOW_FRAMES_MAX};
use crate::engine::Engine;
use crate::flip::{Flip, HIT, knownness};
use protocol::grid::CLASS_UNKNOWN;
use serde::{Deserialize, Serialize};

/// Contents of the longest window.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct History {
    /// The last frame.
    pub last_number: u64,
    /// Frames of the longest timescale; the window starts at frame `last_number - window_frames + 1`.
    pub window_frames: u32,
    /// Plane of hits of the window's first frame, as in `protocol::frame`.
    pub first_hit: Vec<u64>,
    /// Plane of known cells of the window's first frame.
    pub first_known: Vec<u64>,
    /// Numbers of the later frames that differ from the one before, ascending.
    pub frame_numbers: Vec<u64>,
    /// How many of `flips` belong to each of them, > 0.
    pub frame_flips: Vec<u32>,
    /// cell << 2 | new `Evidence as u32`; never the evidence that the cell has already.
    pub flips: Vec<u32>,
}

/// Why a history cannot be restored: it is damaged, or of another grid.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RestoreError {
    /// The planes are not those of this grid.
    #[error(
        "history has planes of {hit} and {known} words, expected {expected} each for this grid"
    )]
    Planes {
        /// Words of the hit plane.
        hit: usize,
        /// Words of the known plane.
        known: usize,
        /// Words of a plane of the grid.
        expected: usize,
    },
    /// A plane says what a frame cannot say.
    #[error(
        "history's first frame has a hit that is not known, or a cell behind the last one, in word {word}"
    )]
    PlaneBits {
        /// Index of the word.
        word: usize,
    },
    /// The window is shorter than the grid's.
    #[error("history holds {found} frames, expected {min}..={max}: start with empty windows")]
    Window {
        /// Frames of the history.
        found: u32,
        /// Frames of the longest timescale of the grid.
        min: u32,
        /// Most frames of any grid.
        max: u32,
    },
    /// The lists do not agree in length.
    #[error(
        "history has {numbers} frame numbers, {counts} counts with the sum {sum}, and {flips} flips"
    )]
    Lengths {
        /// Frame numbers.
        numbers: usize,
        /// Counts.
        counts: usize,
        /// Their sum.
        sum: u64,
        /// Flips.
        flips: usize,
    },
    /// A frame is out of order or out of the window.
    #[error("history has frame {found}, expected {least}..={last}")]
    FrameOrder {
        /// Number of the frame.
        found: u64,
        /// The frame after the one before it, or the first of the window.
        least: u64,
        /// The last frame.
        last: u64,
    },
    /// A flip is of no cell, or to no new evidence.
    #[error(
        "history has the flip {found:#x} in frame {number}, expected cell << 2 | new evidence with cell < {cells}"
    )]
    Flip {
        /// The packed flip.
        found: u32,
        /// Number of its frame.
        number: u64,
        /// Cells of the grid.
        cells: usize,
    },
}

impl History {
    /// Checks all that does not need the state of the cells.
    fn check(&self, config: &GridConfig) -> Result<(), RestoreError> {
        let words = config.cells.div_ceil(64);
        let (hit, known) = (self.first_hit.len(), self.first_known.len());
        if hit != words || known != words {
            return Err(RestoreError::Planes { hit, known, expected: words });
        }
        for (word, (hit, known)) in self.first_hit.iter().zip(&self.first_known).enumerate() {
            let cells = config.cells - word * 64;
            let inside = if cells < 64 { (1 << cells) - 1 } else { u64::MAX };
            if hit & !known != 0 || known & !inside != 0 {
                return Err(RestoreError::PlaneBits { word });
            }
        }
        let (found, min) = (self.window_frames, config.longest_frames());
        if found < min || found > WINDOW_FRAMES_MAX {
            return Err(RestoreError::Window { found, min, max: WINDOW_FRAMES_MAX });
        }
        let sum = self.frame_flips.iter().map(|&count| u64::from(count)).sum();
        let (numbers, counts) = (self.frame_numbers.len(), self.frame_flips.len());
        if numbers != counts || sum != self.flips.len() as u64 {
            return Err(RestoreError::Lengths { numbers, counts, sum, flips: self.flips.len() });
        }
        let last = self.last_number;
        let mut least = last.saturating_sub(u64::from(found) - 1);
        for &number in &self.frame_numbers {
            if number < least || number > last {
                return Err(RestoreError::FrameOrder { found: number, least, last });
            }
            least = number.saturating_add(1);
        }
        Ok(())
    }
}

impl<const K: usize> Engine<K> {
    /// See `TemporalGrid::history`.
    pub(crate) fn history(&self) -> Option<History> {
        let last_number = self.last_number?;
        let words = self.hit.len();
        let mut history = History {
            last_number,
            window_frames: self.windows[self.longest],
            first_hit: vec![0; words],
            first_known: vec![0; words],
            ..History::default()
        };
        for (index, cell) in self.cells.iter().enumerate() {
            let (word, bit) = (index / 64, index % 64);
            let tail = cell.tail(self.longest);
            history.first_hit[word] |= u64::from(tail == HIT) << bit;
            history.first_known[word] |= u64::from(knownness(tail) != 0) << bit;
        }
        let mut cursor = self.cursors[self.longest];
        while let Some(frame) = self.log.frame_at(cursor) {
            let before = history.flips.len();
            let flips = self.log.flips(cursor, frame).flatten();
            history.flips.extend(flips.map(|flip| (flip.cell() as u32) << 2 | flip.new_code()));
            history.frame_flips.push((history.flips.len() - before) as u32);
            let age = (last_number as u32).wrapping_sub(frame.tick);
            history.frame_numbers.push(last_number.saturating_sub(u64::from(age)));
            cursor.pass(frame);
        }
        Some(history)
    }

    /// See `TemporalGrid::restore`; `config` is checked and has K timescales.
    pub(crate) fn restore(config: &GridConfig, history: &History) -> Result<Self, RestoreError> {
        history.check(config)?;
        let mut engine = Self::new(config);
        let last = history.last_number as u32;
        engine.start(history.last_number);
        for (index, cell) in engine.cells.iter_mut().enumerate() {
            let (word, bit) = (index / 64, index % 64);
            let planes = [history.first_known[word], history.first_hit[word]];
            let evidence: u64 = planes.iter().map(|plane| plane >> bit & 1).sum();
            *cell = Cell::new(evidence as u32, CLASS_UNKNOWN, cell.last_hit);
        }
        let mut flips = history.flips.iter();
        for (&number, &count) in history.frame_numbers.iter().zip(&history.frame_flips) {
            for &packed in flips.by_ref().take(count as usize) {
                engine.replay(packed, number)?;
            }
            engine.log.end_frame(number as u32);
        }
        engine.due_now.clear();
        engine.expire(last);
        for index in 0..engine.cells.len() {
            let evidence = engine.cells[index].evidence();
            engine.hit[index / 64] |= u64::from(evidence == HIT) << (index % 64);
            engine.known[index / 64] |= u64::from(knownness(evidence) != 0) << (index % 64);
            engine.known_cells += knownness(evidence) as usize;
            engine.judge(index as u32, last);
        }
        engine.changed.clear();
        // The last frame is in the collapsed counts of who wrote the history.
        engine.map.start(last.wrapping_add(1));
        engine.last_number = Some(history.last_number);
        Ok(engine)
    }

    fn replay(&mut self, packed: u32, number: u64) -> Result<(), RestoreError> {
        let (index, new) = (packed >> 2, packed & 3);
        let error = RestoreError::Flip { found: packed, number, cells: self.cells.len() };
        let Some(cell) = self.cells.get_mut(index as usize) else { return Err(error) };
        let old = cell.evidence();
        if new == old || new > HIT {
            return Err(error);
        }
        let flip = Flip::new(index, old, new);
        cell.enter(flip, number as u32);
        if old == HIT {
            cell.last_hit = (number as u32).wrapping_sub(1);
        }
        self.log.push(flip);
        Ok(())
    }
}
