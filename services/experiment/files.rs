//! What a run leaves behind.
//!
//! | file | content |
//! |---|---|
//! | `scans.mcap` | the scans of all lasers, `sensor_msgs/msg/LaserScan`, a topic `/<laser>` each |
//! | `truth.jsonl` | line 1 `{"scene": ..}`: walls, furniture, doors, lasers, ways; then a line every eighth turn of the mirrors: `{"stamp_ns", "t_s", "people": [{.., "legs_m"}], "doors": [{.., "open_share", "leaves_m"}], "objects"}` |
//! | `surface.npy` | u8 [1, row, col]: 1 where a laser can see a piece of true surface |
//! | `site.toml` | `tog replay scans.mcap --site site.toml` computes the same map again |
//! | `<preset>/` | a map as of `tog replay`, for `tog map`: `grid.json`, `collapsed_counts.npy` (u64 [class, row, col]) |
//! | `figure-N*.png` | the paper's figure of this experiment |
//! | `verdicts.json`, `verdicts.txt` | the claims and their numbers |

use super::run::{ExperimentError, Outcome, Sink, Which, site_text};
use crate::map::export::write_map;
use crate::map::grid_file::{GridFile, LaserEntry};
use crate::map::overwrite;
use indicatif::ProgressBar;
use mapper::npy::NpyWriter;
use protocol::scan::ScanView;
use protocol::site::{Laser, Site};
use protocol::time::SECOND_NS;
use recording::{ScanTopic, ScanWriter, as_recorded};
use scene::{LaserSpec, Scene, Truth};
use serde::Serialize;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Name of the recording.
pub const RECORDING: &str = "scans.mcap";

/// Makes `directory` ready: a run that is there is refused, or removed with `force`. The maps are
/// what tells a run; what every run writes is replaced, the figure has the experiment's number.
///
/// # Errors
/// If a run is there, or cannot be removed.
pub fn make_way(directory: &Path, force: bool) -> Result<(), ExperimentError> {
    overwrite::for_run(directory, force)?;
    std::fs::create_dir_all(directory).map_err(write_error(directory))?;
    if force {
        for number in 1..=4 {
            let path = directory.join(format!("figure-{number}.png"));
            match std::fs::remove_file(&path) {
                Err(source) if source.kind() != io::ErrorKind::NotFound => {
                    return Err(write_error(&path)(source));
                }
                _ => {}
            }
        }
    }
    Ok(())
}

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
    let text = site_text(outcome.which, &outcome.scene, Some(RECORDING));
    let lasers = lasers(&text, &outcome.scene)?;
    for map in &outcome.maps {
        let path = directory.join(map.area.preset.name());
        let grid = GridFile::of(&map.area, lasers.clone());
        write_map(&path, &grid, &map.counts, &[]).map_err(write_error(&path))?;
    }
    let path = directory.join("surface.npy");
    let grid = outcome.ground.grid();
    let surface: Vec<u8> = outcome.ground.surface().iter().map(|&is| u8::from(is)).collect();
    let shape = [grid.rows as usize, grid.columns as usize];
    NpyWriter::create(&path, "|u1", &shape)
        .and_then(|mut writer| writer.row(&surface).and_then(|()| writer.finish()))
        .map_err(write_error(&path))?;
    let path = directory.join("site.toml");
    std::fs::write(&path, text).map_err(write_error(&path))
}

/// The lasers of the site file `text` with the beams of the scene, as the recording has them.
fn lasers(text: &str, scene: &Scene) -> Result<Vec<LaserEntry>, ExperimentError> {
    let site = Site::parse(text, "site.toml")
        .map_err(|errors| ExperimentError::Site(format!("{errors}")))?;
    let entry = |(laser, spec): (&Laser, &LaserSpec)| {
        LaserEntry::of(laser, Some((as_recorded(&spec.geometry()), spec.beams as usize)))
    };
    Ok(site.lasers.iter().zip(&scene.lasers).map(entry).collect())
}
