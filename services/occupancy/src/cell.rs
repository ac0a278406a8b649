//! What a cell remembers: enough to tell its sums at any frame in O(1), from its flips alone.
//!
//! Eq. 7 without visiting the cell: if the evidence is v now, and flips i (value `d_i` higher before
//! frame `f_i` than from it on) lie in the window that starts at frame a, then
//! `S = sum d_i (f_i - a) + N v = A - a B + N v`, with `A = sum d_i f_i` and
//! `B = sum d_i = v(before the first flip) - v`. A flip is added to A when it happens and subtracted
//! when it leaves; between the two the sum moves by itself, as `a` does.
//! All of it modulo 2^32, which is exact because |S| <= N < 2^31.

use crate::flip::{Flip, knownness, value};

/// Cells are aligned to half a cache line: with up to three timescales one is exactly that.
#[derive(Debug, Clone)]
#[repr(C, align(32))]
pub(crate) struct Cell<const K: usize> {
    /// A of each timescale.
    moments: [i32; K],
    /// A of |R| for the longest timescale.
    known_moment: i32,
    /// bits 0-1 evidence now; 2+2k.. evidence at the tail of window k; 20 armed; 24-31 class.
    codes: u32,
    /// Frame of the next look at the class, if armed.
    pub(crate) due: u32,
    /// Until this frame the class stays whatever the lasers say.
    pub(crate) due_any: u32,
    /// The last frame with a hit, if the evidence now is not a hit.
    pub(crate) last_hit: u32,
}

const ARMED: u32 = 1 << 20;
const CLASS_SHIFT: u32 = 24;

impl<const K: usize> Cell<K> {
    /// A cell that had this evidence for ever.
    pub(crate) fn new(evidence: u32, class: u8, last_hit: u32) -> Self {
        let mut codes = evidence | u32::from(class) << CLASS_SHIFT;
        for k in 0..K {
            codes |= evidence << (2 + 2 * k);
        }
        Self { moments: [0; K], known_moment: 0, codes, due: 0, due_any: 0, last_hit }
    }

    #[inline]
    pub(crate) fn evidence(&self) -> u32 {
        self.codes & 3
    }

    /// Evidence at the start of window k.
    #[inline]
    pub(crate) fn tail(&self, k: usize) -> u32 {
        self.codes >> (2 + 2 * k) & 3
    }

    #[inline]
    pub(crate) fn class(&self) -> u8 {
        (self.codes >> CLASS_SHIFT) as u8
    }

    #[inline]
    pub(crate) fn set_class(&mut self, class: u8) {
        self.codes = self.codes & !(255 << CLASS_SHIFT) | u32::from(class) << CLASS_SHIFT;
    }

    #[inline]
    pub(crate) fn armed(&self) -> bool {
        self.codes & ARMED != 0
    }

    #[inline]
    pub(crate) fn arm(&mut self, due: u32) {
        self.codes |= ARMED;
        self.due = due;
    }

    #[inline]
    pub(crate) fn disarm(&mut self) {
        self.codes &= !ARMED;
    }

    /// A flip happens at frame `tick`.
    #[inline]
    pub(crate) fn enter(&mut self, flip: Flip, tick: u32) {
        let moment = flip.drop_of_value().wrapping_mul(tick as i32);
        for sum in &mut self.moments {
            *sum = sum.wrapping_add(moment);
        }
        let known = flip.drop_of_known().wrapping_mul(tick as i32);
        self.known_moment = self.known_moment.wrapping_add(known);
        self.codes = self.codes & !3 | flip.new_code();
    }

    /// The flip of frame `tick` leaves window k.
    #[inline]
    pub(crate) fn leave(&mut self, flip: Flip, tick: u32, k: usize, longest: bool) {
        let moment = flip.drop_of_value().wrapping_mul(tick as i32);
        self.moments[k] = self.moments[k].wrapping_sub(moment);
        if longest {
            let known = flip.drop_of_known().wrapping_mul(tick as i32);
            self.known_moment = self.known_moment.wrapping_sub(known);
        }
        let shift = 2 + 2 * k;
        self.codes = self.codes & !(3 << shift) | flip.new_code() << shift;
    }

    /// S_k over the `frames` frames up to `tick`.
    #[inline]
    pub(crate) fn sum(&self, k: usize, frames: u32, tick: u32) -> i32 {
        let (now, tail) = (value(self.codes), value(self.codes >> (2 + 2 * k)));
        window_sum(self.moments[k], tail, now, frames, tick)
    }

    /// K: known frames of the longest timescale, `k` its index.
    #[inline]
    pub(crate) fn known(&self, k: usize, frames: u32, tick: u32) -> u32 {
        let (now, tail) = (knownness(self.codes), knownness(self.codes >> (2 + 2 * k)));
        window_sum(self.known_moment, tail, now, frames, tick) as u32
    }
}

/// A - a B + N v, with a = tick - N + 1, the first frame of the window.
#[inline]
fn window_sum(moment: i32, tail: i32, now: i32, frames: u32, tick: u32) -> i32 {
    let first = tick.wrapping_sub(frames).wrapping_add(1) as i32;
    moment
        .wrapping_sub(first.wrapping_mul(tail - now))
        .wrapping_add((frames as i32).wrapping_mul(now))
}

const _: () = assert!(size_of::<Cell<3>>() == 32 && size_of::<Cell<8>>() == 64);
