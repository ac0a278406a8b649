//! What the tests of this crate share: seeded numbers, planes, and the two grids side by side.
#![allow(dead_code, clippy::unwrap_used)] // each test file uses its part

use occupancy::{GridConfig, TemporalGrid, dense};
use protocol::frame::FrameView;

/// SplitMix64: enough for tests, and the same everywhere.
#[derive(Clone)]
pub struct Seeded(pub u64);

impl Seeded {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    pub fn below(&mut self, limit: u64) -> u64 {
        self.bits() % limit
    }

    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }
}

/// The planes of a frame of `Evidence as u8`.
pub fn planes(evidence: &[u8]) -> (Vec<u64>, Vec<u64>) {
    let words = evidence.len().div_ceil(64);
    let (mut hit, mut known) = (vec![0; words], vec![0; words]);
    for (cell, &evidence) in evidence.iter().enumerate() {
        hit[cell / 64] |= u64::from(evidence == 2) << (cell % 64);
        known[cell / 64] |= u64::from(evidence != 0) << (cell % 64);
    }
    (hit, known)
}

/// `Evidence as u8` per cell of two planes.
pub fn evidence(hit: &[u64], known: &[u64], cells: usize) -> Vec<u8> {
    let view = FrameView { number: 0, hit, known };
    (0..cells).map(|cell| view.evidence(cell) as u8).collect()
}

/// The default classes for these windows.
pub fn default_config(cells: usize, windows: [u32; 3]) -> GridConfig {
    let prototypes = protocol::site::Preset::Default.prototypes();
    GridConfig {
        cells,
        windows: windows.to_vec(),
        prototypes: prototypes.into_iter().map(|class| class.prototype).collect(),
        transit: true,
        known_share_min: 0.5,
        contexts: 1,
    }
}

/// Both grids, given the same frames, compared whole.
pub struct Pair {
    pub dense: dense::TemporalGrid,
    pub grid: TemporalGrid,
    pub config: GridConfig,
}

impl Pair {
    pub fn new(config: GridConfig) -> Self {
        Self {
            dense: dense::TemporalGrid::new(config.clone()),
            grid: TemporalGrid::new(config.clone()),
            config,
        }
    }

    pub fn push(&mut self, number: u64, evidence: &[u8], context: usize) {
        let (hit, known) = planes(evidence);
        self.dense.push(number, evidence, context);
        self.grid.push(FrameView { number, hit: &hit, known: &known }, context);
    }

    /// Classes must agree after every frame.
    pub fn assert_classes(&self) {
        assert_eq!(self.dense.classes(), self.grid.classes(), "{:?}", self.grid.last_number());
    }

    /// All that can be asked must agree.
    pub fn assert_equal(&self) {
        self.assert_classes();
        for cell in 0..self.config.cells {
            for k in 0..self.config.windows.len() {
                assert_eq!(self.dense.sum(k, cell), self.grid.sum(k, cell), "S_{k} of {cell}");
            }
            assert_eq!(self.dense.known(cell), self.grid.known(cell), "K of {cell}");
        }
        for context in 0..self.config.contexts {
            let mut counts = vec![7; self.config.classes() * self.config.cells];
            self.grid.collapsed(context, &mut counts);
            assert_eq!(self.dense.collapsed(context), counts, "counts of context {context}");
        }
    }
}
