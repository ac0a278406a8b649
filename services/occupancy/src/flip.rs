//! A flip: one cell whose evidence changed from one frame to the next, in 32 bits.

use protocol::frame::Evidence;

/// Evidence codes, as in `Evidence as u8`.
pub(crate) const UNKNOWN: u32 = Evidence::Unknown as u32;
pub(crate) const HIT: u32 = Evidence::Hit as u32;

/// R of Eq. 7 by evidence code: unknown 0, miss -1, hit +1 (code 3 does not occur).
const R: [i32; 4] = [0, -1, 1, 0];

/// R of an evidence code.
#[inline]
pub(crate) fn value(code: u32) -> i32 {
    R[(code & 3) as usize]
}

/// 1 for a known cell.
#[inline]
pub(crate) fn knownness(code: u32) -> i32 {
    i32::from(code & 3 != UNKNOWN)
}

/// cell << 4 | old << 2 | new; 22 bits of cell are `GridGeometry::CELLS_MAX`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Flip(u32);

impl Flip {
    #[inline]
    pub(crate) fn new(cell: u32, old: u32, new: u32) -> Self {
        Self(cell << 4 | old << 2 | new)
    }

    #[inline]
    pub(crate) fn cell(self) -> usize {
        (self.0 >> 4) as usize
    }

    #[inline]
    pub(crate) fn new_code(self) -> u32 {
        self.0 & 3
    }

    /// R(old) - R(new): what the frames before the flip have more than the frames after it.
    #[inline]
    pub(crate) fn drop_of_value(self) -> i32 {
        value(self.0 >> 2) - value(self.0)
    }

    /// The same for |R|.
    #[inline]
    pub(crate) fn drop_of_known(self) -> i32 {
        knownness(self.0 >> 2) - knownness(self.0)
    }
}
