//! Pictures of maps: how often each cell was of a class, where the lasers and the events are.
//!
//! Pure: data in, bytes of a PNG or SVG file out; no file, no clock. Invariants:
//! - y is up and x is right, in metres of the site, as everywhere in tog; cells are square.
//! - One scale of colour for all classes of a map (0 to 100 % of the cell's observed frames), so
//!   that pictures can be compared, unless [`Scale::Max`] is asked for; it is printed beside the
//!   picture.
//! - A cell that was never observed looks different (grey, hatched) from one whose share is 0.
//! - The same input gives the same bytes. No size, name or number makes it panic: what cannot be
//!   drawn is a [`FigureError`], what lies outside the picture is named under it.
//!
//! | file | what |
//! |---|---|
//! | `input.rs` | what is drawn: [`ShareMap`], [`ClassGrid`], [`OverviewMap`], marks, checks |
//! | `share.rs` | [`class_share`]: one class of a collapsed map |
//! | `change.rs` | [`share_change`]: one class of two collapsed maps |
//! | `class_map.rs` | [`class_map`]: the classes at one instant |
//! | `overview.rs` | [`overview`]: leading classes, lasers, events, and a panel per class |
//! | `class_panels.rs` | where the panels of an overview go |
//! | `zones.rs` | named places on a map |
//! | `panels.rs` | [`panels`]: up to six maps on one page, two by two, one scale of colour |
//! | `sheet.rs` | the page round a map: title, axes, scale bar, colour bar, legend, caption |
//! | `view.rs` | the window of the grid that is shown, and metres to pixels |
//! | `marks.rs` | lasers and events, with labels that keep clear of each other |
//! | `scale.rs`, `palette.rs` | round ticks, the scale of shares, the colours |
//! | `canvas.rs`, `text.rs` | pixels and text; the typeface is DejaVu Sans, see `font/LICENSE` |
//! | `vector.rs` | the same as SVG |

mod canvas;
mod change;
mod class_map;
mod class_panels;
mod input;
mod marks;
mod overview;
mod palette;
mod panels;
mod scale;
mod share;
mod sheet;
mod text;
mod vector;
mod view;
mod zones;

pub use change::share_change;
pub use class_map::class_map;
pub use input::{
    ChangeMap, ClassGrid, ClassShare, EventMark, FileFormat, LaserMark, Options, OverviewMap,
    Scale, ShareMap, ZoneMark, shares,
};
pub use overview::overview;
pub use panels::{CircleMark, Panel, PanelSheet, panels};
pub use share::class_share;

/// Why a picture could not be made.
#[derive(Debug, thiserror::Error)]
pub enum FigureError {
    /// The grid has no cells, too many, or no finite size.
    #[error(
        "grid of {columns} x {rows} cells of {cell_m} m at {origin_m:?} cannot be drawn: columns and \
         rows must be 1 to 4096, at most 4 Mi cells, the cell at least 1 mm, the origin within 1e9 m"
    )]
    Grid {
        /// Lower left corner, metres.
        origin_m: [f64; 2],
        /// Edge of a cell, metres.
        cell_m: f64,
        /// Cells along x.
        columns: u32,
        /// Cells along y.
        rows: u32,
    },
    /// An array does not have one value per cell.
    #[error("{what}: {found} values, but the grid has {expected} cells")]
    Length {
        /// Which array.
        what: String,
        /// Its length.
        found: usize,
        /// Cells of the grid.
        expected: usize,
    },
    /// A share is not in 0..=1 (NaN means never observed).
    #[error("{what}: share {value} at cell {index} is not in 0..=1 (NaN means never observed)")]
    Share {
        /// Which map.
        what: String,
        /// Index of the cell, row * columns + column.
        index: usize,
        /// The value found.
        value: f32,
    },
    /// The exponent of the colour scale is out of range.
    #[error("gamma {0} of the colour scale is not in 0.1..=1")]
    Gamma(f64),
    /// The typeface in the program could not be read.
    #[error("the built-in typeface is damaged: build the program again")]
    Font,
    /// The picture could not be encoded.
    #[error("the picture could not be encoded as PNG: {0}")]
    Png(#[from] png::EncodingError),
}
