//! What a run leaves behind.
//!
//! | file | content |
//! |---|---|
//! | `scans.mcap` | the scans of all lasers, `sensor_msgs/msg/LaserScan`, a topic `/<laser>` each |
//! | `truth.jsonl` | line 1 `{"scene": ..}`: walls, furniture, doors, lasers, ways; then a line every eighth turn of the mirrors: `{"stamp_ns", "t_s", "people": [{.., "legs_m"}], "doors": [{.., "open_share", "leaves_m"}], "objects"}` |
//! | `surface.npy` | u8 [1, row, col]: 1 where a laser can see a piece of true surface |
//! | `site.toml` | `tog replay scans.mcap --site site.toml` computes the same map again |
//! | `counts.<preset>.npy` | u64 [class, row, col], as `collapsed_counts.npy` of `tog replay` |
//! | `figure-N*.png` | the paper's figure of this experiment |
//! | `verdicts.json`, `verdicts.txt` | the claims and their numbers |

use super::run::{ExperimentError, Mapped, Outcome, Sink, Which, site_text};
use indicatif::ProgressBar;
use mapper::npy::NpyWriter;
use protocol::scan::ScanView;
use protocol::time::SECOND_NS;
use recording::{ScanTopic, ScanWriter};
use scene::{Scene, Truth};
use serde::Serialize;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Name of the recording.
pub const RECORDING: &str = "scans.mcap";

/// Wraps an error of the file system with the path.
pub fn write_error(path: &Path) -> impl FnOnce(io::Error) -> ExperimentError + '_ {
    move |source| ExperimentError::Write { path: path.to_owned(), source }
}

/// Writes scans and truth while the run goes on.
pub struct Recorder<'a> {
    scans: ScanWriter,
    truth: BufWriter<File>,
    truth_path: PathBuf,
    bar: &'a ProgressBar,
}

#[derive(Serialize)]
struct SceneLine<'a> {
    experiment: u8,
    seed: u64,
    period_ns: u64,
    scene: &'a Scene,
}

#[derive(Serialize)]
struct TruthLine<'a> {
    stamp_ns: u64,
    #[serde(flatten)]
    truth: &'a Truth,
}

impl<'a> Recorder<'a> {
    /// Creates both files in `directory`.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn create(
        directory: &Path,
        which: Which,
        scene: &Scene,
        bar: &'a ProgressBar,
    ) -> Result<Self, ExperimentError> {
        let mut scans = ScanWriter::create(directory.join(RECORDING))?;
        for laser in &scene.lasers {
            scans.add_topic(ScanTopic {
                topic: format!("/{}", laser.id),
                frame_id: format!("laser_{}", laser.id),
                scan_time_s: (experiment::TURN_NS as f64 / SECOND_NS as f64) as f32,
            })?;
        }
        let truth_path = directory.join("truth.jsonl");
        let file = File::create(&truth_path).map_err(write_error(&truth_path))?;
        let mut recorder = Self { scans, truth: BufWriter::new(file), truth_path, bar };
        let experiment = which.experiment.number();
        let (seed, period_ns) = (which.seed, which.rate.period_ns());
        recorder.line(&SceneLine { experiment, seed, period_ns, scene })?;
        Ok(recorder)
    }

    fn line(&mut self, line: &impl Serialize) -> Result<(), ExperimentError> {
        serde_json::to_writer(&mut self.truth, line)
            .map_err(io::Error::from)
            .and_then(|()| self.truth.write_all(b"\n"))
            .map_err(write_error(&self.truth_path))
    }

    /// Puts both files on the disk.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn finish(mut self) -> Result<(), ExperimentError> {
        self.scans.finish()?;
        self.truth
            .flush()
            .and_then(|()| self.truth.get_ref().sync_all())
            .map_err(write_error(&self.truth_path))
    }
}

impl Sink for Recorder<'_> {
    fn scan(&mut self, laser: usize, scan: &ScanView<'_>) -> Result<(), ExperimentError> {
        Ok(self.scans.write(laser, scan.stamp_ns, scan)?)
    }

    fn truth(&mut self, stamp_ns: u64, truth: &Truth) -> Result<(), ExperimentError> {
        self.line(&TruthLine { stamp_ns, truth })
    }

    fn progress(&mut self, seconds: u64) {
        self.bar.set_position(seconds);
    }
}

/// Writes the maps, the surfaces and the site file.
///
/// # Errors
/// Those of the file system.
pub fn write_maps(directory: &Path, outcome: &Outcome) -> Result<(), ExperimentError> {
    for map in &outcome.maps {
        let path = directory.join(format!("counts.{}.npy", map.area.preset.name()));
        write_counts(&path, map).map_err(write_error(&path))?;
    }
    let path = directory.join("surface.npy");
    let grid = outcome.ground.grid();
    let surface: Vec<u8> = outcome.ground.surface().iter().map(|&is| u8::from(is)).collect();
    let shape = [grid.rows as usize, grid.columns as usize];
    NpyWriter::create(&path, "|u1", &shape)
        .and_then(|mut writer| writer.row(&surface).and_then(|()| writer.finish()))
        .map_err(write_error(&path))?;
    let path = directory.join("site.toml");
    let text = site_text(outcome.which, &outcome.scene, Some(RECORDING));
    std::fs::write(&path, text).map_err(write_error(&path))
}

fn write_counts(path: &Path, map: &Mapped) -> io::Result<()> {
    let shape = [map.area.rows as usize, map.area.columns as usize];
    let mut writer = NpyWriter::create(path, "<u8", &shape)?;
    for class in map.counts.chunks(map.area.grid().cells()) {
        writer.row(&class.iter().flat_map(|count| count.to_le_bytes()).collect::<Vec<u8>>())?;
    }
    writer.finish()
}
