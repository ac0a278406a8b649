//! One area of a replay: sources -> pipeline -> files.

use super::lane::Lane;
use super::words::{self, TooShort};
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
        let (seconds, replayed_s) = (self.started.elapsed().as_secs_f64(), self.replayed_s());
        let lines = self.events.lines();
        format!(
            "area {}: {} scans ({dropped} dropped), {} frames, {lines} {} of events, {} in {} \
             ({:.0} x real time); the detector is {}",
            area.id,
            counts.scans_in,
            self.frames,
            if lines == 1 { "change" } else { "changes" },
            words::duration(replayed_s),
            words::duration(seconds),
            replayed_s / seconds.max(1e-9),
            self.pipeline.watch.phase().words(),
        )
    }

    fn replayed_s(&self) -> f64 {
        self.frames as f64 * self.pipeline.area.frame_period_ms / 1000.0
    }

    /// How far the detector of this area came, if the recording was too short to learn from.
    pub fn too_short(&self) -> Option<TooShort> {
        let watch = &self.pipeline.watch;
        let had = match watch.phase() {
            Phase::Learning => {
                format!("{} of learning", words::duration(watch.learnt_s()))
            }
            Phase::Calibrating => format!(
                "all of learning and {} of calibrating",
                words::duration(watch.calibrated_s())
            ),
            Phase::Watching => return None,
        };
        let (area, detector) = (&self.pipeline.area, &self.pipeline.area.detector);
        Some(TooShort {
            area: area.id.clone(),
            had,
            learning_s: detector.learning_s,
            calibration_s: detector.calibration_s,
        })
    }

    /// Why no cell has a class, if `total` counts none.
    fn never_classified(&self, total: &[u64]) -> Option<String> {
        if total.iter().any(|count| *count > 0) {
            return None;
        }
        let area = &self.pipeline.area;
        let scans = self.lanes.iter().map(|lane| lane.counts().scans).min().unwrap_or(0);
        let facts = words::Empty {
            replayed_s: self.replayed_s(),
            scan_period_ms: self.replayed_s() * 1000.0 / scans.max(1) as f64,
            frame_period_ms: area.frame_period_ms,
            scan_age_max_ms: area.scan_age_max_ms,
            longest_s: area.timescales_s.iter().copied().fold(0.0, f64::max),
            known_share_min: area.known_share_min,
        };
        Some(format!("warning: area {}: no cell was ever classified: {}", area.id, facts.why()))
    }

    /// Writes what is known at the end; returns why the map is empty, if it is.
    ///
    /// # Errors
    /// If the results cannot be written.
    pub fn finish(self, recording: &Path) -> Result<Option<String>, ReplayError> {
        let total = output::total_counts(&self.pipeline);
        let why_empty = self.never_classified(&total);
        let Self { pipeline, results, events, directory, .. } = self;
        let mapper = &pipeline.mapper;
        results.finish(mapper.grid(), &mapper.context_names()).map_err(write_error(&directory))?;
        let marks = events.finish()?;
        output::write_map(&directory, &pipeline, &total, &marks, recording)?;
        Ok(why_empty)
    }
}
