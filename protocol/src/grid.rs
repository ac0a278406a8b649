//! What the grid says: classes now, and how often each class was seen.

use crate::wire::{ENVELOPE_BYTES, Envelope, header};
use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

/// Class of a cell that was not observed enough to be classified.
pub const CLASS_UNKNOWN: u8 = 255;
/// Most classes (prototypes plus `transit`): ids must stay below [`CLASS_UNKNOWN`]; 16 keeps a
/// cell's counts in two cache lines.
pub const CLASSES_MAX: usize = 16;
/// Most timescales.
pub const TIMESCALES_MAX: usize = 8;

/// Name and id of a class.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClassName {
    /// The id in class maps.
    pub id: u8,
    /// Its name in the site file, in pictures and in alerts.
    pub name: String,
}

/// Header of a class map; the payload is `[u8]`, the class id of every cell, [row, column].
/// With `FLAG_END_OF_STREAM` the payload is empty.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
pub struct ClassMapHeader {
    /// Common part; `source` is the area's index in the site file.
    pub envelope: Envelope,
    /// m of the frame that these classes follow.
    pub number: u64,
    /// T, nanoseconds.
    pub period_ns: u64,
    /// Lasers in that frame, as in `FrameHeader`.
    pub lasers_present: u64,
    /// As in `FrameHeader`: for latency only.
    pub completed_by_mono_ns: u64,
    /// Index of the context that the frame's stamp falls into; 0 is `always`.
    pub context: u32,
    /// Number of classes.
    pub classes: u32,
    /// Cells along x.
    pub columns: u32,
    /// Cells along y.
    pub rows: u32,
}
header!(ClassMapHeader, "tog.ClassMapHeader.v1", ENVELOPE_BYTES + 4 * 8 + 4 * 4);

/// Header of a collapsed map of one context; the payload is `[u64]`, exact counts of frames,
/// [class, row, column].
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
pub struct CollapsedMapHeader {
    /// Common part; `source` is the area's index in the site file.
    pub envelope: Envelope,
    /// The last frame that is counted.
    pub number: u64,
    /// T, nanoseconds.
    pub period_ns: u64,
    /// Index of the context, as in `Area::context_names`; 0 is `always`.
    pub context: u32,
    /// Number of classes.
    pub classes: u32,
    /// Cells along x.
    pub columns: u32,
    /// Cells along y.
    pub rows: u32,
}
header!(CollapsedMapHeader, "tog.CollapsedMapHeader.v1", ENVELOPE_BYTES + 2 * 8 + 4 * 4);
