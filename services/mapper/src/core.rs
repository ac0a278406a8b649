//! The core of the mapper: frames in, classes out, counts kept. No clock and no IO.
//!
//! The lattice has no holes: the numbers between two frames that came are frames that say nothing,
//! and they are classified and counted like every other (semantics.md, "Frames").

use crate::checkpoint::{self, Checkpoint};
use crate::context::{ContextError, Contexts};
use occupancy::{GridConfig, RestoreError, TemporalGrid};
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

/// Why a checkpoint does not fit.
#[derive(Debug, thiserror::Error)]
pub enum RestoreFailed {
    /// The contents of the windows.
    #[error(transparent)]
    Windows(#[from] RestoreError),
    /// The counts.
    #[error("context `{context}` has {found} counts, expected {expected}")]
    Counts {
        /// Its name.
        context: String,
        /// Numbers found.
        found: usize,
        /// Cells times classes.
        expected: usize,
    },
}

/// The grid of one area.
pub struct MapperCore {
    geometry: GridGeometry,
    lattice: Lattice,
    contexts: Contexts,
    grid: TemporalGrid,
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
        Ok(Self {
            geometry: area.grid(),
            lattice: area.lattice(),
            contexts,
            grid: TemporalGrid::new(config),
            counts: Counts::default(),
        })
    }

    /// Takes a frame. `step` is called for every frame of the lattice that this adds, the missing
    /// ones first, with its number and the classes after it.
    ///
    /// `changed_cells` names the cells that may differ from the frame before, if the caller knows: it
    /// saves the comparison of the planes.
    pub fn frame(
        &mut self,
        frame: FrameView<'_>,
        changed_cells: Option<&[u32]>,
        mut step: impl FnMut(u64, &TemporalGrid),
    ) -> Taken {
        let (number, words) = (frame.number, self.geometry.plane_words());
        if frame.hit.len() != words || frame.known.len() != words {
            self.counts.frames_refused += 1;
            return Taken::WrongSize;
        }
        if self.grid.last_number().is_some_and(|last| number <= last) {
            self.counts.frames_repeated += 1;
            return Taken::Repeated;
        }
        self.fill_until(number, &mut step);
        let context = self.contexts.at(self.lattice.stamp_ns(number));
        match changed_cells {
            Some(cells) => self.grid.push_changed(frame, cells, context),
            None => self.grid.push(frame, context),
        }
        self.counts.frames_in += 1;
        step(number, &self.grid);
        Taken::Yes
    }

    /// Adds the frames before `number` that never came.
    fn fill_until(&mut self, number: u64, step: &mut impl FnMut(u64, &TemporalGrid)) {
        let Some(last) = self.grid.last_number() else { return };
        // After the longest window everything is unknown and nothing changes any more: the rest of
        // a long gap is left to the grid.
        let change_ends = last.saturating_add(u64::from(self.grid.config().longest_frames()) + 1);
        self.counts.frames_missing += number - last - 1;
        for missing in last + 1..number.min(change_ends) {
            let context = self.contexts.at(self.lattice.stamp_ns(missing));
            self.grid.push_unknown(missing, context);
            step(missing, &self.grid);
        }
    }

    /// The grid as it is.
    #[must_use]
    pub fn grid(&self) -> &TemporalGrid {
        &self.grid
    }

    /// Says which grid this is, for its checkpoints.
    #[must_use]
    pub fn describe(&self) -> String {
        checkpoint::describe(&self.geometry, self.lattice.period_ns(), self.grid.config())
    }

    /// All that a restart needs to go on: a copy, to be written by somebody with time.
    #[must_use]
    pub fn checkpoint(&self) -> Checkpoint {
        let counts = |(index, name): (usize, &str)| {
            let mut counts = vec![0; self.count_values()];
            self.grid.collapsed(index, &mut counts);
            (name.to_owned(), counts)
        };
        Checkpoint {
            grid: self.describe(),
            history: self.grid.history(),
            contexts: self.contexts.names().into_iter().enumerate().map(counts).collect(),
        }
    }

    /// Goes on where the writer of `checkpoint` stood. Counts of contexts that the site file does
    /// not name any more are counted in `always`.
    ///
    /// # Errors
    /// If the checkpoint does not fit the grid; nothing is changed then.
    pub fn restore(&mut self, checkpoint: &Checkpoint) -> Result<(), RestoreFailed> {
        let expected = self.count_values();
        for (context, counts) in &checkpoint.contexts {
            if counts.len() != expected {
                let (context, found) = (context.clone(), counts.len());
                return Err(RestoreFailed::Counts { context, found, expected });
            }
        }
        if let Some(history) = &checkpoint.history {
            self.grid = TemporalGrid::restore(self.grid.config().clone(), history)?;
        }
        for (context, counts) in &checkpoint.contexts {
            let names = self.contexts.names();
            let index = names.iter().position(|name| name == context).unwrap_or(0);
            self.grid.add_collapsed(index, counts);
        }
        Ok(())
    }

    fn count_values(&self) -> usize {
        self.geometry.cells() * self.grid.config().classes()
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
}
