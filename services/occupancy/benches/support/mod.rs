//! The workloads of the simulator as both versions take them, and a clock of CPU time.
#![allow(dead_code, clippy::unwrap_used)] // each bench uses its part

use occupancy::{Fuser, GridConfig, LaserModel, TemporalGrid, dense};
use protocol::frame::FrameView;
use protocol::geometry::GridGeometry;
use protocol::site::Preset;
use protocol::time::Lattice;
use simulator::workload::{self, Workload};

/// All frames of a workload in memory: `ranges_m[frame][laser][beam]`.
pub struct Load {
    pub name: &'static str,
    pub grid: GridGeometry,
    pub models: Vec<LaserModel>,
    pub config: GridConfig,
    pub frame_period_ns: u64,
    pub ranges_m: Vec<Vec<Vec<f32>>>,
}

impl Load {
    pub fn w1r(frames: u64) -> Self {
        Self::read(workload::w1r(1, frames).unwrap())
    }

    pub fn w2r(frames: u64) -> Self {
        Self::read(workload::w2r(1, frames).unwrap())
    }

    pub fn w3r(frames: u64) -> Self {
        Self::read(workload::w3r(1, frames).unwrap())
    }

    /// dr = 50 mm, dphi = half a step, 1, 15 and 60 s, the default classes with `transit`.
    fn read(mut workload: Workload) -> Self {
        let models = workload.lasers.iter().map(|laser| LaserModel {
            pose: laser.pose,
            geometry: laser.geometry,
            beams: laser.beams as usize,
            half_beam_rad: None,
            range_tolerance_m: 0.05,
            no_return_is_free: true,
        });
        let lattice = Lattice::new(workload.frame_period_ns);
        let prototypes = Preset::Default.prototypes();
        let mut load = Self {
            name: workload.name,
            grid: workload.grid,
            models: models.collect(),
            config: GridConfig {
                cells: workload.grid.cells(),
                windows: [1.0, 15.0, 60.0].map(|scale| lattice.frames_in(scale)).to_vec(),
                prototypes: prototypes.into_iter().map(|class| class.prototype).collect(),
                transit: true,
                known_share_min: 0.5,
                contexts: 1,
            },
            frame_period_ns: workload.frame_period_ns,
            ranges_m: Vec::new(),
        };
        let mut buffers = workload.buffers();
        while workload.frame(&mut buffers) {
            load.ranges_m.push(buffers.clone());
        }
        load
    }

    /// Frames of the longest timescale.
    pub fn window(&self) -> usize {
        self.config.longest_frames() as usize
    }

    pub fn cells(&self) -> usize {
        self.config.cells
    }
}

/// Fusion and grid, by changes.
#[derive(Clone)]
pub struct Incremental {
    pub fuser: Fuser,
    pub grid: TemporalGrid,
    /// Flips fused so far, and frames.
    pub changes: usize,
}

impl Incremental {
    pub fn new(load: &Load) -> Self {
        let mut fuser = Fuser::new(load.grid, load.models.len());
        for (laser, model) in load.models.iter().enumerate() {
            fuser.install(laser, model);
        }
        Self { fuser, grid: TemporalGrid::new(load.config.clone()), changes: 0 }
    }

    pub fn fuse(&mut self, scans: &[Vec<f32>]) {
        for (laser, ranges_m) in scans.iter().enumerate() {
            self.fuser.apply(laser, ranges_m);
        }
    }

    /// The grid in the process of the fusion: takes its list of changes.
    pub fn step(&mut self, number: u64) {
        let frame = FrameView { number, hit: self.fuser.hit(), known: self.fuser.known() };
        self.changes += self.fuser.changed_cells().len();
        self.grid.push_changed(frame, self.fuser.changed_cells(), 0);
        self.fuser.clear_changed();
    }

    /// The grid in a process of its own: compares the planes.
    pub fn step_by_planes(&mut self, number: u64) {
        let frame = FrameView { number, hit: self.fuser.hit(), known: self.fuser.known() };
        self.grid.push(frame, 0);
        self.fuser.clear_changed();
    }

    pub fn frame(&mut self, number: u64, scans: &[Vec<f32>]) {
        self.fuse(scans);
        self.step(number);
    }
}

/// Fusion and grid, every cell.
pub struct Dense {
    pub fuser: dense::Fuser,
    pub grid: dense::TemporalGrid,
}

impl Dense {
    pub fn new(load: &Load) -> Self {
        Self {
            fuser: dense::Fuser::new(&load.grid, &load.models),
            grid: dense::TemporalGrid::new(load.config.clone()),
        }
    }

    pub fn frame(&mut self, number: u64, scans: &[Vec<f32>]) {
        let scans: Vec<Option<&[f32]>> = scans.iter().map(|scan| Some(scan.as_slice())).collect();
        let frame = self.fuser.fuse(&scans);
        self.grid.push(number, frame, 0);
    }

    /// The fusion alone, to tell the parts apart.
    pub fn fuse(&mut self, scans: &[Vec<f32>]) {
        let scans: Vec<Option<&[f32]>> = scans.iter().map(|scan| Some(scan.as_slice())).collect();
        std::hint::black_box(self.fuser.fuse(&scans));
    }
}

/// CPU time of this thread, microseconds: other processes do not count.
pub fn cpu_us() -> f64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    now.tv_sec as f64 * 1e6 + now.tv_nsec as f64 * 1e-3
}

pub fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Memory of this process that is in use, MB.
pub fn resident_mb() -> f64 {
    let pages = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages: f64 =
        pages.split(' ').nth(1).and_then(|pages| pages.parse().ok()).unwrap_or(f64::NAN);
    pages * 4096.0 * 1e-6
}
