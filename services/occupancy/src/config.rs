//! What a temporal grid must know of its area.

use protocol::grid::{CLASSES_MAX, TIMESCALES_MAX};
use protocol::site::Area;

/// Longest timescale, frames: three days at 1 kHz. Window arithmetic is modulo 2^32 and compares
/// frames at a distance of up to four windows.
pub const WINDOW_FRAMES_MAX: u32 = 1 << 28;
/// Most cells: a flip packs cell and evidence in 32 bits.
const CELLS_MAX: usize = protocol::geometry::GridGeometry::CELLS_MAX;
/// Most contexts: the site file allows 15 and `always`.
const CONTEXTS_MAX: usize = 16;

/// Windows, classes and contexts of one area's grid.
#[derive(Debug, Clone, PartialEq)]
pub struct GridConfig {
    /// Number of cells, 1..=4 Mi.
    pub cells: usize,
    /// N_k, frames of each timescale, 1..=[`WINDOW_FRAMES_MAX`]; 1..=8 of them, in any order.
    pub windows: Vec<u32>,
    /// Prototypes in id order, 1..=16 (15 with `transit`); one occupancy in [0, 1] a timescale.
    pub prototypes: Vec<Vec<f64>>,
    /// Whether class 0 with a hit in the shortest window has a class of its own, the last id.
    pub transit: bool,
    /// A cell with K < known_share_min * N_longest is unknown, [0, 1].
    pub known_share_min: f64,
    /// Number of contexts with a collapsed map of their own, 1..=16.
    pub contexts: usize,
}

/// Why a grid cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// A number of things is out of its limits.
    #[error("grid has {found} {what}, expected {min}..={max}")]
    Count {
        /// What is counted.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// Least.
        min: usize,
        /// Most.
        max: usize,
    },
    /// A prototype does not have one value a timescale.
    #[error("prototype {id} has {found} values, expected one a timescale: {expected}")]
    PrototypeLength {
        /// Id of the class.
        id: usize,
        /// Its number of values.
        found: usize,
        /// Number of timescales.
        expected: usize,
    },
    /// A value is not an occupancy or a share.
    #[error("{what} is {found}, expected 0..=1")]
    NotAShare {
        /// What it is.
        what: String,
        /// Its value.
        found: f64,
    },
}

impl GridConfig {
    /// The grid of an area of the site file. Context 0 is `always`: what no context names; context
    /// i + 1 is the i-th of the site file.
    #[must_use]
    pub fn of_area(area: &Area) -> Self {
        let lattice = area.lattice();
        Self {
            cells: area.grid().cells(),
            windows: area.timescales_s.iter().map(|&scale| lattice.frames_in(scale)).collect(),
            prototypes: area.prototypes().into_iter().map(|class| class.prototype).collect(),
            transit: area.has_transit(),
            known_share_min: area.known_share_min,
            contexts: area.contexts.len() + 1,
        }
    }

    /// Says what is wrong, if anything is.
    ///
    /// # Errors
    /// The first thing that is out of the limits stated at the fields.
    pub fn check(&self) -> Result<(), ConfigError> {
        let count = |what, found, max| match found {
            found if (1..=max).contains(&found) => Ok(()),
            found => Err(ConfigError::Count { what, found, min: 1, max }),
        };
        count("cells", self.cells, CELLS_MAX)?;
        count("timescales", self.windows.len(), TIMESCALES_MAX)?;
        count("prototypes", self.prototypes.len(), CLASSES_MAX - usize::from(self.transit))?;
        count("contexts", self.contexts, CONTEXTS_MAX)?;
        for &frames in &self.windows {
            count("frames in a timescale", frames as usize, WINDOW_FRAMES_MAX as usize)?;
        }
        let share = |what: &dyn Fn() -> String, found: f64| match found {
            found if (0.0..=1.0).contains(&found) => Ok(()),
            found => Err(ConfigError::NotAShare { what: what(), found }),
        };
        share(&|| "known_share_min".to_owned(), self.known_share_min)?;
        for (id, prototype) in self.prototypes.iter().enumerate() {
            let (found, expected) = (prototype.len(), self.windows.len());
            if found != expected {
                return Err(ConfigError::PrototypeLength { id, found, expected });
            }
            for &value in prototype {
                share(&|| format!("a value of prototype {id}"), value)?;
            }
        }
        Ok(())
    }

    /// Number of classes: prototypes and `transit`, without `unknown`.
    #[must_use]
    pub fn classes(&self) -> usize {
        self.prototypes.len() + usize::from(self.transit)
    }

    /// N of the longest timescale, frames.
    #[must_use]
    pub fn longest_frames(&self) -> u32 {
        self.windows.iter().copied().max().unwrap_or(1)
    }

    /// N of the shortest timescale, frames.
    #[must_use]
    pub fn shortest_frames(&self) -> u32 {
        self.windows.iter().copied().min().unwrap_or(1)
    }
}
