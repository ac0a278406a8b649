//! The temporal grid for K timescales: one step a frame, work only where something changes.
//!
//! A step is: flips that fall out of a window leave its moments; the flips of the new frame enter;
//! the cells that are due are judged. Invariant after the step of frame m: every cell's class is
//! the literal class of its windows up to m, and a cell that is not armed, or is due later than
//! m + 1, has the same class at m + 1 unless it flips.

use crate::calendar::{Calendar, SLOTS};
use crate::cell::Cell;
use crate::collapsed_map::CollapsedMap;
use crate::config::GridConfig;
use crate::flip::{Flip, HIT, UNKNOWN, knownness};
use crate::flip_log::{Cursor, FlipLog};
use crate::prototype::{Classifier, Contents, NEVER};
use protocol::frame::FrameView;
use protocol::grid::CLASS_UNKNOWN;

/// Frames after which runs and ages are renewed, so that differences of 32-bit frame numbers stay
/// unambiguous: 166 days at 75 Hz.
const RENEWAL_FRAMES: u32 = 1 << 30;

/// Cells that are fetched together before they are worked on: about as many cache misses as a core
/// can have under way.
const FETCHED: usize = 32;

/// Grid of K timescales.
#[derive(Debug, Clone)]
pub(crate) struct Engine<const K: usize> {
    pub(crate) classifier: Classifier<K>,
    pub(crate) windows: [u32; K],
    pub(crate) longest: usize,
    pub(crate) cells: Vec<Cell<K>>,
    /// The newest frame.
    pub(crate) hit: Vec<u64>,
    pub(crate) known: Vec<u64>,
    pub(crate) known_cells: usize,
    pub(crate) log: FlipLog,
    pub(crate) cursors: [Cursor; K],
    calendar: Calendar,
    pub(crate) due_now: Vec<u32>,
    pub(crate) map: CollapsedMap,
    pub(crate) classes: Vec<u8>,
    pub(crate) changed: Vec<u32>,
    pub(crate) last_number: Option<u64>,
    renewed: u32,
}

impl<const K: usize> Engine<K> {
    /// `config` is checked and has K timescales.
    pub(crate) fn new(config: &GridConfig) -> Self {
        let mut windows = [1; K];
        windows.copy_from_slice(&config.windows);
        let longest = (0..K).rev().max_by_key(|&k| windows[k]).unwrap_or(0);
        let words = config.cells.div_ceil(64);
        Self {
            classifier: Classifier::new(config),
            windows,
            longest,
            cells: vec![Cell::new(UNKNOWN, CLASS_UNKNOWN, 0); config.cells],
            hit: vec![0; words],
            known: vec![0; words],
            known_cells: 0,
            log: FlipLog::default(),
            cursors: [Cursor::default(); K],
            calendar: Calendar::new(),
            due_now: Vec::new(),
            map: CollapsedMap::new(config.cells, config.classes(), config.contexts),
            classes: vec![CLASS_UNKNOWN; config.cells],
            changed: Vec::new(),
            last_number: None,
            renewed: 0,
        }
    }

    /// The first frame: nothing before it counts, all before it is unknown.
    pub(crate) fn start(&mut self, number: u64) {
        let tick = number as u32;
        self.map.start(tick);
        self.renewed = tick;
        for cell in &mut self.cells {
            cell.last_hit = tick.wrapping_sub(RENEWAL_FRAMES);
            cell.due_any = tick;
        }
        // Every cell gets a class, also those that no laser will ever see.
        for index in 0..self.cells.len() {
            self.cells[index].arm(tick);
            self.due_now.push(index as u32);
        }
    }

    fn begin_frame(&mut self, number: u64, context: usize) {
        let tick = number as u32;
        self.due_now.clear();
        if self.last_number.is_none() {
            self.start(number);
        }
        self.last_number = Some(number);
        self.map.enter_context(context, &self.classes, tick);
        if tick.wrapping_sub(self.renewed) >= RENEWAL_FRAMES {
            self.renew(tick);
        }
        self.expire(tick);
    }

    fn end_frame(&mut self, number: u64) {
        let tick = number as u32;
        self.log.end_frame(tick);
        self.calendar.drain(tick, &mut self.due_now);
        let due = std::mem::take(&mut self.due_now);
        for cells in due.chunks(FETCHED) {
            self.fetch(cells);
            for &cell in cells {
                let state = &self.cells[cell as usize];
                if state.armed() && state.due == tick {
                    self.judge(cell, tick);
                }
            }
        }
        self.due_now = due;
    }

    /// Brings cells into the cache, all at once instead of one by one.
    #[inline]
    fn fetch(&self, cells: &[u32]) {
        let codes = cells.iter().filter_map(|&cell| self.cells.get(cell as usize));
        std::hint::black_box(codes.fold(0, |sum, cell| sum ^ cell.evidence()));
    }

    /// Flips older than a window leave it.
    pub(crate) fn expire(&mut self, tick: u32) {
        for k in 0..K {
            let first = tick.wrapping_sub(self.windows[k]).wrapping_add(1);
            while let Some(frame) = self.log.frame_at(self.cursors[k]) {
                if (first.wrapping_sub(frame.tick) as i32) < 0 {
                    break;
                }
                for flips in self.log.flips(self.cursors[k], frame) {
                    for &flip in flips {
                        let longest = k == self.longest;
                        self.cells[flip.cell()].leave(flip, frame.tick, k, longest);
                    }
                }
                self.cursors[k].pass(frame);
            }
        }
        self.log.release(&self.cursors);
    }

    /// The evidence of a cell becomes `new` at frame `tick`; does nothing if it is that already.
    #[inline]
    fn enter(&mut self, index: usize, new: u32, tick: u32) {
        let cell = &mut self.cells[index];
        let old = cell.evidence();
        if old == new {
            return;
        }
        let flip = Flip::new(index as u32, old, new);
        cell.enter(flip, tick);
        self.log.push(flip);
        self.known_cells += knownness(new) as usize;
        self.known_cells -= knownness(old) as usize;
        if old == HIT {
            cell.last_hit = tick.wrapping_sub(1);
        }
        let starts_transit = new == HIT && cell.class() == 0 && self.classifier.has_transit();
        let due = if starts_transit || (cell.due_any.wrapping_sub(tick) as i32) < 0 {
            tick
        } else {
            cell.due_any
        };
        if !cell.armed() || (due.wrapping_sub(cell.due) as i32) < 0 {
            cell.arm(due);
            if due == tick {
                self.due_now.push(index as u32);
            } else {
                self.calendar.enter(due, index as u32);
            }
        }
    }

    fn contents(&self, index: usize, tick: u32) -> Contents<K> {
        let cell = &self.cells[index];
        let mut sums = [0; K];
        for (k, sum) in sums.iter_mut().enumerate() {
            *sum = cell.sum(k, self.windows[k], tick);
        }
        let evidence = cell.evidence();
        Contents {
            sums,
            known: cell.known(self.longest, self.windows[self.longest], tick),
            evidence,
            hit_age: if evidence == HIT { 0 } else { tick.wrapping_sub(cell.last_hit) },
        }
    }

    /// Gives a cell its class and the frame of its next look.
    pub(crate) fn judge(&mut self, index: u32, tick: u32) {
        let verdict = self.classifier.judge(&self.contents(index as usize, tick));
        let cell = &mut self.cells[index as usize];
        cell.due_any = tick.wrapping_add(verdict.frames_in_any_case);
        if verdict.frames_if_steady == NEVER {
            cell.disarm();
        } else {
            let due = tick.wrapping_add(verdict.frames_if_steady);
            cell.arm(due);
            self.calendar.enter(due, index);
        }
        let old = cell.class();
        if verdict.class != old {
            cell.set_class(verdict.class);
            self.map.end_run(index as usize, old, tick);
            self.classes[index as usize] = verdict.class;
            self.changed.push(index);
        }
    }

    /// Takes the frame's words into the planes and enters the flips between the two.
    fn take_word(&mut self, word: usize, hit: u64, known: u64, tick: u32) {
        let cells = self.cells.len() - word * 64;
        let inside = if cells < 64 { (1 << cells) - 1 } else { u64::MAX };
        let (known, hit) = (known & inside, hit & known & inside);
        let mut differing = (self.hit[word] ^ hit) | (self.known[word] ^ known);
        self.hit[word] = hit;
        self.known[word] = known;
        while differing != 0 {
            let bit = differing.trailing_zeros();
            differing &= differing - 1;
            // unknown 0, miss 1, hit 2: known counts one, hit (which implies it) another.
            let code = (known >> bit & 1) + (hit >> bit & 1);
            self.enter(word * 64 + bit as usize, code as u32, tick);
        }
    }

    /// Renews what would be ambiguous in 32 bits: ages are cut to what is longer than any window.
    fn renew(&mut self, tick: u32) {
        self.map.settle(&self.classes, tick, 0);
        self.renew_ages(tick);
    }

    fn renew_ages(&mut self, tick: u32) {
        self.renewed = tick;
        let oldest = tick.wrapping_sub(RENEWAL_FRAMES);
        for cell in &mut self.cells {
            if tick.wrapping_sub(cell.last_hit) > RENEWAL_FRAMES {
                cell.last_hit = oldest;
            }
            if (cell.due_any.wrapping_sub(tick) as i32) < 0 {
                cell.due_any = tick;
            }
        }
    }

    /// Whether all windows are full of unknown frames and no class will change.
    fn is_dormant(&self) -> bool {
        self.known_cells == 0 && self.log.is_empty() && self.calendar.is_empty()
    }

    /// Counts `frames` all-unknown frames behind the last one, while dormant, without steps.
    fn sleep(&mut self, first: u64, frames: u64, context: usize) {
        let tick = first as u32;
        self.map.enter_context(context, &self.classes, tick);
        self.map.settle(&self.classes, tick, frames);
        let last = first + (frames - 1);
        self.last_number = Some(last);
        for cell in &mut self.cells {
            cell.last_hit = (last as u32).wrapping_sub(RENEWAL_FRAMES);
            cell.due_any = last as u32;
        }
        self.renewed = last as u32;
    }

    fn step_unknown(&mut self, number: u64, context: usize) {
        self.begin_frame(number, context);
        if self.known_cells > 0 {
            for word in 0..self.known.len() {
                if self.known[word] != 0 {
                    self.take_word(word, 0, 0, number as u32);
                }
            }
        }
        self.end_frame(number);
    }

    /// All-unknown frames from the one after the last to the one before `number`.
    fn fill(&mut self, number: u64, context: usize) {
        let Some(last) = self.last_number else { return };
        let mut next = last + 1;
        while next < number {
            // Sleeping visits every cell once: not worth it for a short gap.
            if number - next > u64::from(SLOTS) && self.is_dormant() {
                self.sleep(next, number - next, context);
                return;
            }
            self.step_unknown(next, context);
            next += 1;
        }
    }

    /// Whether `number` comes after the last frame; else the caller is wrong, and it is ignored.
    fn is_next(&self, number: u64) -> bool {
        let next = self.last_number.is_none_or(|last| number > last);
        debug_assert!(next, "frame {number} after frame {:?}", self.last_number);
        next
    }

    /// See `TemporalGrid::push`.
    pub(crate) fn push(&mut self, frame: FrameView<'_>, context: usize) {
        const CHUNK: usize = 8; // a cache line of each plane
        self.changed.clear();
        if !self.is_next(frame.number) {
            return;
        }
        self.fill(frame.number, context);
        self.begin_frame(frame.number, context);
        let words = self.hit.len().min(frame.hit.len()).min(frame.known.len());
        for first in (0..words).step_by(CHUNK) {
            let chunk = first..(first + CHUNK).min(words);
            let now = self.hit[chunk.clone()].iter().zip(&self.known[chunk.clone()]);
            let new = frame.hit[chunk.clone()].iter().zip(&frame.known[chunk.clone()]);
            let differ = now.zip(new).fold(0, |sum, ((hit, known), (new_hit, new_known))| {
                sum | (hit ^ new_hit) | (known ^ new_known)
            });
            if differ != 0 {
                for word in chunk {
                    self.take_word(word, frame.hit[word], frame.known[word], frame.number as u32);
                }
            }
        }
        self.end_frame(frame.number);
    }

    /// See `TemporalGrid::push_changed`.
    pub(crate) fn push_changed(&mut self, frame: FrameView<'_>, cells: &[u32], context: usize) {
        let follows = self.last_number.is_some_and(|last| last + 1 == frame.number);
        if !follows {
            return self.push(frame, context);
        }
        self.changed.clear();
        self.begin_frame(frame.number, context);
        for cells in cells.chunks(FETCHED) {
            self.fetch(cells);
            for &cell in cells {
                let word = cell as usize / 64;
                if let (true, Some(&hit), Some(&known)) =
                    (word < self.hit.len(), frame.hit.get(word), frame.known.get(word))
                {
                    self.take_word(word, hit, known, frame.number as u32);
                }
            }
        }
        debug_assert!(self.known.iter().zip(frame.known).all(|(a, b)| a == b), "unlisted change");
        debug_assert!(self.hit.iter().zip(frame.hit).all(|(a, b)| a == b), "unlisted change");
        self.end_frame(frame.number);
    }

    /// See `TemporalGrid::push_unknown`.
    pub(crate) fn push_unknown(&mut self, number: u64, context: usize) {
        self.changed.clear();
        if self.is_next(number) {
            self.fill(number, context);
            self.step_unknown(number, context);
        }
    }
}
