//! The core of the mapper: frames in, classes out, counts kept. No clock and no IO.
//!
//! The lattice has no holes: the numbers between two frames that came are frames that say nothing,
//! and they are classified and counted like every other (semantics.md, "Frames").

use crate::context::{ContextError, Contexts};
use occupancy::{GridConfig, TemporalGrid};
use protocol::frame::FrameView;
use protocol::geometry::GridGeometry;
use protocol::site::Area;
use protocol::time::Lattice;

/// What was counted since the start.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames that came.
    pub frames_in: u64,
    /// Frames of the lattice that never came.
    pub frames_missing: u64,
    /// Frames whose number was not after the last one: a restarted fusion may repeat some.
    pub frames_repeated: u64,
    /// Frames of the wrong size.
    pub frames_refused: u64,
}

/// What became of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Taken {
    /// It is in the grid.
    Yes,
    /// Its number is not after the last one; it is dropped.
    Repeated,
    /// Its planes have the wrong length; it is dropped.
    WrongSize,
}

/// The grid of one area.
pub struct MapperCore {
    geometry: GridGeometry,
    lattice: Lattice,
    contexts: Contexts,
    grid: TemporalGrid,
    longest_window: u64,
    counts: Counts,
}

impl MapperCore {
    /// The grid of `area`, empty.
    ///
    /// # Errors
    /// If the site's time zone or a context is not valid.
    pub fn new(area: &Area, timezone: &str) -> Result<Self, ContextError> {
        let contexts = Contexts::new(timezone, &area.contexts)?;
        let config = GridConfig::of_area(area);
        let longest_window = config.windows.iter().copied().max().unwrap_or(1).into();
        Ok(Self {
            geometry: area.grid(),
            lattice: area.lattice(),
            contexts,
            grid: TemporalGrid::new(config),
            longest_window,
            counts: Counts::default(),
        })
    }

    /// Takes a frame. `step` is called for every frame of the lattice that this adds, the missing
    /// ones first, with its number and the classes after it.
    pub fn frame(
        &mut self,
        number: u64,
        planes: &[u64],
        mut step: impl FnMut(u64, &TemporalGrid),
    ) -> Taken {
        let Some(frame) = FrameView::from_wire(number, planes, self.geometry.plane_words()) else {
            self.counts.frames_refused += 1;
            return Taken::WrongSize;
        };
        if self.grid.last_number().is_some_and(|last| number <= last) {
            self.counts.frames_repeated += 1;
            return Taken::Repeated;
        }
        self.fill_until(number, &mut step);
        let context = self.contexts.at(self.lattice.stamp_ns(number));
        self.grid.push(frame, context);
        self.counts.frames_in += 1;
        step(number, &self.grid);
        Taken::Yes
    }

    /// Adds the frames before `number` that never came.
    fn fill_until(&mut self, number: u64, step: &mut impl FnMut(u64, &TemporalGrid)) {
        let Some(last) = self.grid.last_number() else { return };
        for missing in last + 1..number {
            let context = self.contexts.at(self.lattice.stamp_ns(missing));
            self.grid.push_unknown(missing, context);
            self.counts.frames_missing += 1;
            step(missing, &self.grid);
        }
    }

    /// The grid as it is.
    #[must_use]
    pub fn grid(&self) -> &TemporalGrid {
        &self.grid
    }

    /// The grid, to restore a checkpoint into it.
    pub fn grid_mut(&mut self) -> &mut TemporalGrid {
        &mut self.grid
    }

    /// Names of the contexts by index.
    #[must_use]
    pub fn context_names(&self) -> Vec<&str> {
        self.contexts.names()
    }

    /// The context of a frame.
    pub fn context_of(&mut self, number: u64) -> usize {
        self.contexts.at(self.lattice.stamp_ns(number))
    }

    /// What was counted.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Frames of the longest window.
    #[must_use]
    pub fn longest_window(&self) -> u64 {
        self.longest_window
    }
}
