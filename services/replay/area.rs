//! One area of a replay: sources -> pipeline -> files.

use super::lane::Lane;
use super::{ReplayError, output, write_error};
use crate::pipeline::Pipeline;
use anomaly::Phase;
use fusion::core::Origin;
use indicatif::ProgressBar;
use laser::replay::ReplaySource;
use laser::source::SourceError;
use mapper::results::{Results, Rows};
use protocol::event::EventChange;
use protocol::site::Site;
use protocol::time::SECOND_NS;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The run of one area.
pub struct AreaRun {
    pipeline: Pipeline,
    lanes: Vec<Lane>,
    /// Stamp of the last scan that was taken of each; `None` at its end.
    newest_ns: Vec<Option<u64>>,
    results: Results,
    events: output::EventLog,
    changes: Vec<EventChange>,
    frames: u64,
    directory: PathBuf,
    first_ns: Option<u64>,
    cut: Option<SourceError>,
    started: Instant,
}

impl AreaRun {
    /// A run of area `area_index` of the site that writes into `directory`.
    ///
    /// # Errors
    /// If the results cannot be created.
    pub fn new(
        site: &Site,
        area_index: usize,
        sources: Vec<ReplaySource>,
        directory: &Path,
        rows: Rows,
    ) -> Result<Self, ReplayError> {
        let pipeline = Pipeline::new(site, area_index)?;
        let lanes: Vec<Lane> = sources
            .into_iter()
            .map(Lane::open)
            .collect::<Result<_, _>>()
            .map_err(ReplayError::Thread)?;
        Ok(Self {
            newest_ns: vec![Some(0); lanes.len()],
            lanes,
            results: Results::create(directory, &pipeline.area, rows)
                .map_err(write_error(directory))?,
            events: output::EventLog::create(directory)?,
            changes: Vec::new(),
            frames: 0,
            directory: directory.to_owned(),
            first_ns: None,
            cut: None,
            started: Instant::now(),
            pipeline,
        })
    }

    /// Replays everything. The laser that is furthest behind speaks next, so that no queue grows.
    ///
    /// # Errors
    /// If a source breaks for a reason other than a cut recording, or the results cannot be written.
    pub fn replay_all(&mut self, bar: &ProgressBar) -> Result<(), ReplayError> {
        loop {
            let speaking = self.newest_ns.iter().enumerate();
            let speaking = speaking.filter_map(|(lane, stamp_ns)| Some((lane, (*stamp_ns)?)));
            let Some((lane, _)) = speaking.min_by_key(|(_, stamp_ns)| *stamp_ns) else { break };
            self.one_scan(lane)?;
            self.frames()?;
            if let Some(stamp_ns) = self.newest_ns[lane] {
                let first_ns = *self.first_ns.get_or_insert(stamp_ns);
                bar.set_position(stamp_ns.saturating_sub(first_ns) / SECOND_NS);
            }
        }
        Ok(())
    }

    fn one_scan(&mut self, index: usize) -> Result<(), ReplayError> {
        let (lane, laser) = (&mut self.lanes[index], &self.pipeline.lasers[index].id);
        let scan = match lane.next() {
            Ok(scan) => scan,
            Err(error) if error.is_early_end() => {
                self.cut = Some(error);
                None
            }
            Err(error) => return Err(error.into()),
        };
        self.newest_ns[index] = scan.map(|scan| scan.stamp_ns);
        if let Some(scan) = scan {
            let origin = Origin { laser: index, session: 0, seq: 0, published_mono_ns: 0 };
            if let Err(refused) = self.pipeline.fusion.scan(origin, scan.view(), None) {
                eprintln!("tog: laser {laser}: {refused}");
            }
        } else {
            self.pipeline.fusion.end(index);
        }
        for oddity in lane.take_oddities() {
            eprintln!("tog: laser {laser}: {}", oddity.text);
        }
        Ok(())
    }

    fn frames(&mut self) -> Result<(), ReplayError> {
        let Self { pipeline, results, changes, frames, .. } = self;
        let mut written = Ok(());
        pipeline.run_frames(changes, |number, classes| {
            *frames += 1;
            if written.is_ok() {
                written = results.step(number, classes);
            }
        });
        written.map_err(write_error(&self.directory))?;
        self.events.write(&mut self.changes)
    }

    /// Why the recording ended early, if it did.
    pub fn take_cut(&mut self) -> Option<SourceError> {
        self.cut.take()
    }

    /// The lasers whose recording was mostly dropped, each with a sentence: a map made of the rest says
    /// little.
    pub fn mostly_dropped(&self) -> Vec<String> {
        let lanes = self.pipeline.lasers.iter().zip(&self.lanes);
        let mostly = lanes.filter_map(|(laser, lane)| {
            let counts = lane.counts();
            let dropped = counts.dropped_out_of_order + counts.dropped_geometry + counts.refused;
            let (id, passed) = (&laser.id, counts.scans);
            (dropped > passed).then(|| {
                format!(
                    "laser {id}: only {passed} of {} scans were used: {} came out of order or before \
                     the first, {} have other beams than the first, {} were refused. If the first \
                     scan is the odd one, cut it off the recording",
                    passed + dropped,
                    counts.dropped_out_of_order,
                    counts.dropped_geometry,
                    counts.refused,
                )
            })
        });
        mostly.collect()
    }

    /// A line about what was done.
    pub fn summary(&self) -> String {
        let area = &self.pipeline.area;
        let counts = self.pipeline.fusion.counts();
        let dropped: u64 = self
            .lanes
            .iter()
            .map(Lane::counts)
            .map(|counts| counts.dropped_out_of_order + counts.dropped_geometry + counts.refused)
            .sum::<u64>()
            + counts.scans_refused;
        let seconds = self.started.elapsed().as_secs_f64();
        let replayed_s = self.frames as f64 * area.frame_period_ms / 1000.0;
        format!(
            "area {}: {} scans ({dropped} dropped), {} frames, {} changes of events, {replayed_s:.0} s \
             in {seconds:.1} s ({:.0} x real time); the detector is {}",
            area.id,
            counts.scans_in,
            self.frames,
            self.events.lines(),
            replayed_s / seconds.max(1e-9),
            self.pipeline.watch.phase().words(),
        )
    }

    /// Why there are no events, if it is because the recording is too short to learn from.
    pub fn too_short(&self) -> Option<String> {
        let watch = &self.pipeline.watch;
        let detector = &self.pipeline.area.detector;
        let had = match watch.phase() {
            Phase::Learning => format!("{:.0} s of learning", watch.learnt_s()),
            Phase::Calibrating => {
                format!("all of learning and {:.0} s of calibrating", watch.calibrated_s())
            }
            Phase::Watching => return None,
        };
        Some(format!(
            "area {}: the recording is too short for events: the detector needs {:.0} s of normal life \
             to learn and then {:.0} s to calibrate, and had {had}; a site file may ask for less with \
             learning_s and calibration_s under [area.detector]",
            self.pipeline.area.id, detector.learning_s, detector.calibration_s
        ))
    }

    /// Writes what is known at the end.
    ///
    /// # Errors
    /// If the results cannot be written.
    pub fn finish(self, recording: &Path) -> Result<(), ReplayError> {
        let Self { pipeline, results, events, directory, .. } = self;
        let mapper = &pipeline.mapper;
        results.finish(mapper.grid(), &mapper.context_names()).map_err(write_error(&directory))?;
        let marks = events.finish()?;
        output::write_map(&directory, &pipeline, &marks, recording)
    }
}
