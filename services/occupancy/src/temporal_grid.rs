//! The temporal occupancy grid of an area (Eq. 7 and 8, "Collapsing the grid"), incremental.
//!
//! Holds, after frame m, for each cell: `S_k` over the N_k frames up to m, `K` over the longest
//! timescale, the class, and in how many frames it had which class. Frames before the first, and
//! numbers that were left out, are all-unknown frames. Integers and the literal f64 formula only:
//! bit-identical to [`crate::dense::TemporalGrid`], whatever the frames.
//!
//! Cost follows the flips of the frames, not the cells. A push allocates nothing after warm-up:
//! the log, the calendar and the lists grow to the most that was needed, and the counts of a context
//! are made when it is first used. Memory: 32 B a cell (64 B above three timescales) and 5 B more,
//! 8 B a cell and class and used context, 4 B a flip of the longest timescale: at worst one flip a
//! cell a frame, in practice [`TemporalGrid::history_bytes`].

use crate::config::GridConfig;
use crate::engine::Engine;
use crate::history::{History, RestoreError};
use protocol::frame::FrameView;

/// Incremental temporal grid of one area.
#[derive(Debug, Clone)]
pub struct TemporalGrid {
    config: GridConfig,
    engine: AnyEngine,
}

/// An engine by its number of timescales: known when it is compiled, its loops unroll.
#[derive(Debug, Clone)]
enum AnyEngine {
    K1(Box<Engine<1>>),
    K2(Box<Engine<2>>),
    K3(Box<Engine<3>>),
    K4(Box<Engine<4>>),
    K5(Box<Engine<5>>),
    K6(Box<Engine<6>>),
    K7(Box<Engine<7>>),
    K8(Box<Engine<8>>),
}

macro_rules! with_engine {
    ($grid:expr, $engine:ident => $body:expr) => {
        match $grid {
            AnyEngine::K1($engine) => $body,
            AnyEngine::K2($engine) => $body,
            AnyEngine::K3($engine) => $body,
            AnyEngine::K4($engine) => $body,
            AnyEngine::K5($engine) => $body,
            AnyEngine::K6($engine) => $body,
            AnyEngine::K7($engine) => $body,
            AnyEngine::K8($engine) => $body,
        }
    };
}

impl AnyEngine {
    fn make(config: &GridConfig, history: Option<&History>) -> Result<Self, RestoreError> {
        fn boxed<const K: usize>(
            config: &GridConfig,
            history: Option<&History>,
        ) -> Result<Box<Engine<K>>, RestoreError> {
            Ok(Box::new(match history {
                Some(history) => Engine::restore(config, history)?,
                None => Engine::new(config),
            }))
        }
        Ok(match config.windows.len() {
            1 => Self::K1(boxed(config, history)?),
            2 => Self::K2(boxed(config, history)?),
            3 => Self::K3(boxed(config, history)?),
            4 => Self::K4(boxed(config, history)?),
            5 => Self::K5(boxed(config, history)?),
            6 => Self::K6(boxed(config, history)?),
            7 => Self::K7(boxed(config, history)?),
            _ => Self::K8(boxed(config, history)?),
        })
    }
}

impl TemporalGrid {
    /// A grid that has seen nothing; all classes are unknown.
    ///
    /// # Panics
    /// If the configuration fails [`GridConfig::check`]: a site file that was read cannot.
    #[must_use]
    pub fn new(config: GridConfig) -> Self {
        assert_config(&config);
        match AnyEngine::make(&config, None) {
            Ok(engine) => Self { config, engine },
            Err(error) => unreachable!("nothing to restore: {error}"),
        }
    }

    /// A grid that goes on where the writer of this history stood: same sums, same classes; the
    /// collapsed counts are empty ([`TemporalGrid::add_collapsed`]) and count from the next frame.
    ///
    /// # Errors
    /// If the history is damaged, of another grid, or shorter than the longest timescale.
    ///
    /// # Panics
    /// As [`TemporalGrid::new`].
    pub fn restore(config: GridConfig, history: &History) -> Result<Self, RestoreError> {
        assert_config(&config);
        let engine = AnyEngine::make(&config, Some(history))?;
        Ok(Self { config, engine })
    }

    /// What the grid was made with.
    #[must_use]
    pub fn config(&self) -> &GridConfig {
        &self.config
    }

    /// Takes a frame; its number must be greater than the last (else it is ignored). Numbers left
    /// out are all-unknown frames of the same context. `context` is an index below
    /// `config.contexts`; changing it costs a pass over the cells.
    pub fn push(&mut self, frame: FrameView<'_>, context: usize) {
        with_engine!(&mut self.engine, engine => engine.push(frame, context));
    }

    /// As [`TemporalGrid::push`], for a frame that differs from the one pushed before it in no cell
    /// but (some of) `cells`, as [`crate::Fuser::changed_cells`] lists them: saves the comparison
    /// of the planes. The list is not needed, and not used, if numbers were left out.
    pub fn push_changed(&mut self, frame: FrameView<'_>, cells: &[u32], context: usize) {
        with_engine!(&mut self.engine, engine => engine.push_changed(frame, cells, context));
    }

    /// Takes a frame that never came: all unknown.
    pub fn push_unknown(&mut self, number: u64, context: usize) {
        with_engine!(&mut self.engine, engine => engine.push_unknown(number, context));
    }

    /// Class of every cell after the last frame, [row, column]; `CLASS_UNKNOWN` before the first.
    #[must_use]
    pub fn classes(&self) -> &[u8] {
        with_engine!(&self.engine, engine => engine.classes())
    }

    /// Number of the last frame.
    #[must_use]
    pub fn last_number(&self) -> Option<u64> {
        with_engine!(&self.engine, engine => engine.last_number())
    }

    /// Cells whose class changed in the last push, in no particular order. If that push filled a
    /// gap, a cell may be listed more than once, or be back where it was.
    #[must_use]
    pub fn changed_cells(&self) -> &[u32] {
        with_engine!(&self.engine, engine => engine.changed_cells())
    }

    /// S_k of a cell, -N_k..=N_k.
    ///
    /// # Panics
    /// If `timescale` or `cell` is out of range, as an index is.
    #[must_use]
    pub fn sum(&self, timescale: usize, cell: usize) -> i32 {
        with_engine!(&self.engine, engine => engine.sum(timescale, cell))
    }

    /// K of a cell: known frames of the longest timescale.
    ///
    /// # Panics
    /// If `cell` is out of range, as an index is.
    #[must_use]
    pub fn known(&self, cell: usize) -> u32 {
        with_engine!(&self.engine, engine => engine.known(cell))
    }

    /// o_k = (S_k / N_k + 1) / 2 of a cell: 0 empty, 1/2 unknown, 1 occupied.
    ///
    /// # Panics
    /// If `timescale` or `cell` is out of range, as an index is.
    #[must_use]
    pub fn occupancy(&self, timescale: usize, cell: usize) -> f64 {
        with_engine!(&self.engine, engine => engine.occupancy(timescale, cell))
    }

    /// Writes the counts of a context up to the last frame, [class, cell]; `out` holds
    /// `config.classes() * config.cells` numbers. Zeros for a context that was never used.
    pub fn collapsed(&self, context: usize, out: &mut [u64]) {
        debug_assert_eq!(out.len(), self.config.classes() * self.config.cells, "[class, cell]");
        with_engine!(&self.engine, engine => engine.collapsed(context, out));
    }

    /// Adds counts of a context, [class, cell]: those of a checkpoint, of another day or host.
    pub fn add_collapsed(&mut self, context: usize, counts: &[u64]) {
        debug_assert_eq!(counts.len(), self.config.classes() * self.config.cells, "[class, cell]");
        with_engine!(&mut self.engine, engine => engine.add_collapsed(context, counts));
    }

    /// The contents of the windows, for a checkpoint; `None` before the first frame.
    #[must_use]
    pub fn history(&self) -> Option<History> {
        with_engine!(&self.engine, engine => engine.history())
    }

    /// Memory of the log of flips, bytes: all that is kept of the frames of the longest timescale.
    #[must_use]
    pub fn history_bytes(&self) -> usize {
        with_engine!(&self.engine, engine => engine.history_bytes())
    }
}

fn assert_config(config: &GridConfig) {
    if let Err(error) = config.check() {
        panic!("{error}");
    }
}
