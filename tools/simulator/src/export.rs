//! A workload or a scene as a recording, and what was really there beside it.
//!
//! Scans go to an MCAP (`sensor_msgs/msg/LaserScan`, CDR), one topic a laser: `/<laser>`. The truth
//! is one JSON object a line, one line a turn of the lasers:
//! `{"stamp_ns":..,"t_s":..,"people":[..], "doors":[..],"objects":[..]}`. Stamps are the first
//! beam's; all lasers turn at once.

use crate::workload::Workload;
use protocol::scan::{Reading, ScanView, reading};
use protocol::time::{Lattice, SECOND_NS};
use recording::{RecordingError, ScanTopic, ScanWriter};
use scene::{LaserSpec, SceneError, Truth, World};
use serde::Serialize;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Longest export, turns of the lasers: a day at 75 Hz; more does not fit a disk.
pub const TURNS_MAX: u64 = 75 * 86_400;

/// Why an export was given up.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The scene is not possible.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The recording cannot be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The truth cannot be written.
    #[error("cannot write {}: {source}", path.display())]
    Truth {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Too long, too fast, or nothing.
    #[error("{turns} turns of the lasers, expected 1..{TURNS_MAX}: fewer seconds or a lower rate")]
    Turns {
        /// How many.
        turns: f64,
    },
    /// A scene without lasers.
    #[error("scene `{scene}` has no laser, expected at least one `[[laser]]`")]
    NoLaser {
        /// Its name.
        scene: String,
    },
}

/// What to export.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Stamp of the first turn, UNIX nanoseconds.
    pub first_stamp_ns: u64,
    /// From turn to turn, nanoseconds.
    pub period_ns: u64,
    /// How many turns.
    pub turns: u64,
    /// Where the recording goes, if it is wanted.
    pub recording: Option<PathBuf>,
    /// Where the truth goes, if it is wanted.
    pub truth: Option<PathBuf>,
}

impl Plan {
    /// `seconds` at `rate_hz`, from the first stamp of the lattice of frames at or after `from_ns`.
    ///
    /// # Errors
    /// If that is no turn at all, or more than [`TURNS_MAX`].
    pub fn new(from_ns: u64, seconds: f64, rate_hz: f64) -> Result<Self, ExportError> {
        let turns = (seconds * rate_hz).round();
        let period_ns = (SECOND_NS as f64 / rate_hz).round();
        if !(1.0..=TURNS_MAX as f64).contains(&turns) || !(1.0..1e13).contains(&period_ns) {
            return Err(ExportError::Turns { turns });
        }
        let lattice = Lattice::new(period_ns as u64);
        let first_stamp_ns = lattice.stamp_ns(lattice.first_at_or_after(from_ns));
        Ok(Self {
            first_stamp_ns,
            period_ns: period_ns as u64,
            turns: turns as u64,
            recording: None,
            truth: None,
        })
    }

    fn stamp_ns(&self, turn: u64) -> u64 {
        self.first_stamp_ns.saturating_add(turn.saturating_mul(self.period_ns))
    }
}

/// What an export holds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Name of the scene or the workload.
    pub name: String,
    /// Lasers.
    pub lasers: usize,
    /// Turns of the lasers.
    pub turns: u64,
    /// Stamp of the first turn, UNIX nanoseconds.
    pub first_stamp_ns: u64,
    /// From turn to turn, nanoseconds.
    pub period_ns: u64,
    /// Share of readings without a return.
    pub no_return_share: f64,
    /// Share of fault codes.
    pub invalid_share: f64,
    /// Different people.
    pub people: usize,
    /// Most people at once.
    pub people_max: usize,
    /// How often each door was opened: (id, openings).
    pub openings: Vec<(String, u64)>,
}

#[derive(Serialize)]
struct TruthLine<'a> {
    stamp_ns: u64,
    #[serde(flatten)]
    truth: &'a Truth,
}

/// Imagines a scene and writes what the plan wants.
///
/// # Errors
/// See [`ExportError`].
pub fn scene(world: &mut World, plan: &Plan) -> Result<Summary, ExportError> {
    let lasers = world.scene().lasers.clone();
    let name = world.scene().name.clone();
    let from_s = |world: &World, stamp_ns| world.scene().time_s(stamp_ns);
    run(&name, world, &lasers, plan, from_s)
}

/// Writes a workload from its first frame; frame 0 has the plan's first stamp.
///
/// # Errors
/// See [`ExportError`].
pub fn workload(workload: &mut Workload, plan: &Plan) -> Result<Summary, ExportError> {
    let (name, lasers) = (workload.name, workload.specs().to_vec());
    let first_ns = plan.first_stamp_ns;
    // As in `Workload::frame`, to the bit: frame m is at m * T seconds.
    let (period_ns, period_s) = (plan.period_ns, plan.period_ns as f64);
    let at_s =
        |_: &World, stamp_ns: u64| ((stamp_ns - first_ns) / period_ns) as f64 * period_s * 1e-9;
    run(name, workload.world_mut(), &lasers, plan, at_s)
}

fn run(
    name: &str,
    world: &mut World,
    lasers: &[LaserSpec],
    plan: &Plan,
    at_s: impl Fn(&World, u64) -> f64,
) -> Result<Summary, ExportError> {
    if lasers.is_empty() {
        return Err(ExportError::NoLaser { scene: name.to_owned() });
    }
    if !(1..=TURNS_MAX).contains(&plan.turns) {
        return Err(ExportError::Turns { turns: plan.turns as f64 });
    }
    let mut writer = plan.recording.as_deref().map(|path| open(path, lasers, plan)).transpose()?;
    let mut truth_file = plan.truth.as_deref().map(TruthFile::create).transpose()?;
    let mut counts = Counts::default();
    let mut ranges_m = Vec::new();
    for turn in 0..plan.turns {
        let stamp_ns = plan.stamp_ns(turn);
        let t_s = at_s(world, stamp_ns);
        for (topic, laser) in lasers.iter().enumerate() {
            world.scan(laser, t_s, &mut ranges_m);
            let geometry = laser.geometry();
            let scan = ScanView { stamp_ns, geometry, ranges_m: &ranges_m };
            counts.readings(&scan);
            if let Some(writer) = &mut writer {
                writer.write(topic, stamp_ns, &scan)?;
            }
        }
        let truth = world.truth(t_s);
        counts.truth(&truth);
        if let Some(file) = &mut truth_file {
            file.line(&TruthLine { stamp_ns, truth: &truth })?;
        }
    }
    if let Some(writer) = writer {
        writer.finish()?;
    }
    if let Some(file) = truth_file {
        file.finish()?;
    }
    Ok(counts.summary(name, lasers.len(), plan))
}

fn open(path: &Path, lasers: &[LaserSpec], plan: &Plan) -> Result<ScanWriter, ExportError> {
    let mut writer = ScanWriter::create(path)?;
    for laser in lasers {
        writer.add_topic(ScanTopic {
            topic: topic(&laser.id),
            frame_id: laser.id.clone(),
            scan_time_s: (plan.period_ns as f64 / SECOND_NS as f64) as f32,
        })?;
    }
    Ok(writer)
}

/// Topic of a laser in an exported recording.
#[must_use]
pub fn topic(laser: &str) -> String {
    format!("/{laser}")
}

struct TruthFile<'a> {
    path: &'a Path,
    file: BufWriter<File>,
}

impl<'a> TruthFile<'a> {
    fn create(path: &'a Path) -> Result<Self, ExportError> {
        let file = File::create(path)
            .map_err(|source| ExportError::Truth { path: path.to_owned(), source })?;
        Ok(Self { path, file: BufWriter::new(file) })
    }

    fn line(&mut self, line: &TruthLine<'_>) -> Result<(), ExportError> {
        serde_json::to_writer(&mut self.file, line)
            .map_err(std::io::Error::from)
            .and_then(|()| self.file.write_all(b"\n"))
            .map_err(|source| ExportError::Truth { path: self.path.to_owned(), source })
    }

    fn finish(mut self) -> Result<(), ExportError> {
        self.file
            .flush()
            .and_then(|()| self.file.get_ref().sync_all())
            .map_err(|source| ExportError::Truth { path: self.path.to_owned(), source })
    }
}

#[derive(Default)]
struct Counts {
    readings: u64,
    none: u64,
    invalid: u64,
    people: BTreeSet<u64>,
    people_max: usize,
    doors: Vec<(String, bool, u64)>,
}

impl Counts {
    fn readings(&mut self, scan: &ScanView<'_>) {
        for &range_m in scan.ranges_m {
            self.readings += 1;
            match reading(range_m, &scan.geometry) {
                Reading::Echo(_) => {}
                Reading::NoReturn => self.none += 1,
                Reading::Invalid => self.invalid += 1,
            }
        }
    }

    fn truth(&mut self, truth: &Truth) {
        self.people.extend(truth.people.iter().map(|person| person.id));
        self.people_max = self.people_max.max(truth.people.len());
        if self.doors.is_empty() {
            self.doors = truth.doors.iter().map(|door| (door.id.clone(), false, 0)).collect();
        }
        for (door, (_, was_open, openings)) in truth.doors.iter().zip(&mut self.doors) {
            let is_open = door.open_share > 0.5;
            *openings += u64::from(is_open && !*was_open);
            *was_open = is_open;
        }
    }

    fn summary(self, name: &str, lasers: usize, plan: &Plan) -> Summary {
        let readings = self.readings.max(1) as f64;
        Summary {
            name: name.to_owned(),
            lasers,
            turns: plan.turns,
            first_stamp_ns: plan.first_stamp_ns,
            period_ns: plan.period_ns,
            no_return_share: self.none as f64 / readings,
            invalid_share: self.invalid as f64 / readings,
            people: self.people.len(),
            people_max: self.people_max,
            openings: self.doors.into_iter().map(|(id, _, openings)| (id, openings)).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::workload::w1r;
    use recording::Recording;
    use scene::Scene;

    fn scans(path: &Path) -> Vec<recording::RecordedScan> {
        let mut scans = Recording::open(path).unwrap().scans();
        scans.by_ref().map(Result::unwrap).collect()
    }

    #[test]
    fn a_recorded_scene_reads_back_bit_by_bit_with_its_truth_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let mut world = World::new(Scene::builtin("room").unwrap(), 5).unwrap();
        let from_ns = world.scene().stamp_ns(1000.0);
        let plan = Plan {
            recording: Some(folder.path().join("x.mcap")),
            truth: Some(folder.path().join("x.truth.jsonl")),
            ..Plan::new(from_ns, 3.0, 10.0).unwrap()
        };
        let summary = scene(&mut world, &plan).unwrap();
        assert_eq!((summary.lasers, summary.turns, summary.people), (4, 30, 4));
        let read = scans(plan.recording.as_deref().unwrap());
        assert_eq!(read.len(), 120);
        let mut again = World::new(Scene::builtin("room").unwrap(), 5).unwrap();
        let mut ranges_m = Vec::new();
        for (i, recorded) in read.iter().enumerate() {
            let laser = again.scene().lasers[i % 4].clone();
            assert_eq!(recorded.scan.geometry, laser.geometry());
            assert_eq!(recorded.scan.stamp_ns, from_ns + (i as u64 / 4) * 100_000_000);
            let t_s = again.scene().time_s(recorded.scan.stamp_ns);
            again.scan(&laser, t_s, &mut ranges_m);
            let bits = |ranges: &[f32]| ranges.iter().map(|r| r.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&recorded.scan.ranges_m), bits(&ranges_m));
        }
        let truth = std::fs::read_to_string(plan.truth.unwrap()).unwrap();
        assert_eq!(truth.lines().count(), 30);
        for line in truth.lines() {
            let line: serde_json::Value = serde_json::from_str(line).unwrap();
            assert_eq!(line["people"].as_array().unwrap().len(), 4);
        }
    }

    #[test]
    fn a_recorded_workload_is_the_workload() {
        let folder = tempfile::tempdir().unwrap();
        let mut frames = w1r(2, 4).unwrap();
        let plan = Plan {
            first_stamp_ns: 1_767_225_600_000_000_000,
            period_ns: frames.frame_period_ns,
            turns: frames.frames,
            recording: Some(folder.path().join("w1r.mcap")),
            truth: None,
        };
        workload(&mut frames, &plan).unwrap();
        let read = scans(plan.recording.as_deref().unwrap());
        let mut out = frames.buffers();
        let mut recorded = read.iter();
        while frames.frame(&mut out) {
            for ranges_m in &out {
                assert_eq!(recorded.next().unwrap().scan.ranges_m, *ranges_m);
            }
        }
        assert!(recorded.next().is_none());
    }

    #[test]
    fn an_export_of_nothing_or_of_for_ever_is_refused() {
        for (seconds, rate_hz) in
            [(0.0, 10.0), (1e9, 75.0), (f64::NAN, 1.0), (1.0, -1.0), (1.0, 0.0)]
        {
            let error = Plan::new(0, seconds, rate_hz).unwrap_err().to_string();
            assert!(error.contains("turns of the lasers, expected 1.."), "{error}");
        }
    }
}
