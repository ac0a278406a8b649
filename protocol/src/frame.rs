//! A frame: the fused image of an area at one instant of the lattice. Only the fused image is
//! called a frame.

use crate::wire::{ENVELOPE_BYTES, Envelope, header};
use bytemuck::{Pod, Zeroable};

/// What a frame says of a cell. Ordered, so that fusing is `max`: hit > miss > unknown (paper, 3.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
#[repr(u8)]
pub enum Evidence {
    /// No laser can tell.
    #[default]
    Unknown = 0,
    /// Some laser saw through it, none saw it hit.
    Miss = 1,
    /// Some laser saw something there.
    Hit = 2,
}

/// Most lasers of an area: one bit each in [`FrameHeader::lasers_present`].
pub const LASERS_PER_AREA_MAX: usize = 64;

/// Header of a frame in shared memory.
///
/// The payload is `[u64]`: the hit plane, then the known plane, each `GridGeometry::plane_words`
/// long; bit i%64 of word i/64 is cell i = row*columns + column. Hit implies known. Bits behind the
/// last cell are 0. With `FLAG_END_OF_STREAM` the payload is empty and `number` the last frame.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
pub struct FrameHeader {
    /// Common part; `source` is the area's index in the site file.
    pub envelope: Envelope,
    /// m: the frame's stamp is m * period.
    pub number: u64,
    /// T, nanoseconds.
    pub period_ns: u64,
    /// Bit i: the i-th laser of the area (order of the site file) has a scan in this frame.
    pub lasers_present: u64,
    /// CLOCK_MONOTONIC at the publication of the scan that completed this frame, nanoseconds; 0 if
    /// a deadline completed it.
    pub completed_by_mono_ns: u64,
    /// Cells along x.
    pub columns: u32,
    /// Cells along y.
    pub rows: u32,
}
header!(FrameHeader, "tog.FrameHeader.v1", ENVELOPE_BYTES + 5 * 8);

/// A borrowed frame: what the cores take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameView<'a> {
    /// m.
    pub number: u64,
    /// Bit plane of hits.
    pub hit: &'a [u64],
    /// Bit plane of known cells (hit or miss).
    pub known: &'a [u64],
}

impl<'a> FrameView<'a> {
    /// Splits the payload of a frame message, if it has the length of two planes of `words`.
    #[must_use]
    pub fn from_wire(number: u64, payload: &'a [u64], words: usize) -> Option<Self> {
        if payload.len() != 2 * words {
            return None;
        }
        let (hit, known) = payload.split_at(words);
        Some(Self { number, hit, known })
    }

    /// Evidence of cell `index`.
    #[must_use]
    pub fn evidence(&self, index: usize) -> Evidence {
        let bit = |plane: &[u64]| plane[index / 64] >> (index % 64) & 1 == 1;
        match (bit(self.known), bit(self.hit)) {
            (false, _) => Evidence::Unknown,
            (true, false) => Evidence::Miss,
            (true, true) => Evidence::Hit,
        }
    }
}
