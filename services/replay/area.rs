//! One area of a replay: sources -> fusion -> mapper -> anomaly, step by step in one thread.

use super::{ReplayError, output, write_error};
use anomaly::{ClassFrame, Watch};
use fusion::core::{FusionCore, Origin};
use indicatif::ProgressBar;
use laser::{ReplaySource, SourceError};
use mapper::core::MapperCore;
use mapper::results::{Results, Rows};
use protocol::event::EventChange;
use protocol::scan::LaserScan;
use protocol::site::{Area, Laser, Site};
use protocol::time::SECOND_NS;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A laser of the area.
struct Lane {
    source: ReplaySource,
    /// Stamp of the last scan that was taken.
    newest_ns: u64,
    ended: bool,
}

/// The run of one area.
pub struct AreaRun {
    area: Area,
    lasers: Vec<Laser>,
    lanes: Vec<Lane>,
    fusion: FusionCore,
    downstream: Downstream,
    first_ns: Option<u64>,
    cut: Option<SourceError>,
    started: Instant,
}

/// What follows fusion.
struct Downstream {
    mapper: MapperCore,
    watch: Watch,
    results: Results,
    events: output::EventLog,
    changes: Vec<EventChange>,
    frames: u64,
    directory: PathBuf,
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
        let area = site.areas[area_index].clone();
        let lasers: Vec<Laser> =
            site.lasers_of(&area.id).map(|(_, laser)| laser.clone()).collect();
        let fusion = FusionCore::new(&area, &lasers.iter().collect::<Vec<_>>(), None);
        let downstream = Downstream {
            mapper: MapperCore::new(&area, &site.timezone)?,
            watch: Watch::new(&area, &lasers),
            results: Results::create(directory, &area, rows).map_err(write_error(directory))?,
            events: output::EventLog::create(directory)?,
            changes: Vec::new(),
            frames: 0,
            directory: directory.to_owned(),
        };
        let lane = |source| Lane { source, newest_ns: 0, ended: false };
        let lanes = sources.into_iter().map(lane).collect();
        let started = Instant::now();
        Ok(Self { area, lasers, lanes, fusion, downstream, first_ns: None, cut: None, started })
    }

    /// Replays everything. The laser that is furthest behind speaks next, so that no queue grows.
    ///
    /// # Errors
    /// If a source breaks for a reason other than a cut recording, or the results cannot be written.
    pub fn to_the_end(&mut self, bar: &ProgressBar) -> Result<(), ReplayError> {
        let mut scan = LaserScan::default();
        loop {
            let speaking = self.lanes.iter().enumerate().filter(|(_, lane)| !lane.ended);
            let Some((index, _)) = speaking.min_by_key(|(_, lane)| lane.newest_ns) else { break };
            self.one_scan(index, &mut scan)?;
            while let Some(frame) = self.fusion.next_frame(None) {
                self.downstream.frame(&frame)?;
            }
            self.fusion.drain_finished().for_each(drop);
            let first_ns = *self.first_ns.get_or_insert(scan.stamp_ns);
            bar.set_position(scan.stamp_ns.saturating_sub(first_ns) / SECOND_NS);
        }
        Ok(())
    }

    fn one_scan(&mut self, index: usize, scan: &mut LaserScan) -> Result<(), ReplayError> {
        let lane = &mut self.lanes[index];
        let more = match lane.source.next(scan) {
            Ok(more) => more,
            Err(error) if error.is_early_end() => {
                self.cut = Some(error);
                false
            }
            Err(error) => return Err(error.into()),
        };
        for oddity in lane.source.take_oddities() {
            eprintln!("tog: laser {}: {}", self.lasers[index].id, oddity.text);
        }
        if !more {
            lane.ended = true;
            self.fusion.end(index);
            return Ok(());
        }
        lane.newest_ns = scan.stamp_ns;
        let origin = Origin { laser: index, session: 0, seq: 0, published_mono_ns: 0 };
        if let Err(refused) = self.fusion.scan(origin, scan.view(), None) {
            eprintln!("tog: laser {}: {refused}", self.lasers[index].id);
        }
        Ok(())
    }

    /// Why the recording ended early, if it did.
    pub fn take_cut(&mut self) -> Option<SourceError> {
        self.cut.take()
    }

    /// A line about what was done.
    pub fn summary(&self) -> String {
        let counts = self.fusion.counts();
        let dropped: u64 = self
            .lanes
            .iter()
            .map(|lane| lane.source.counts())
            .map(|counts| counts.dropped_out_of_order + counts.dropped_geometry + counts.refused)
            .sum();
        let seconds = self.started.elapsed().as_secs_f64();
        let replayed_s =
            self.downstream.frames as f64 * self.area.frame_period_ms / 1000.0;
        format!(
            "area {}: {} scans ({dropped} dropped), {} frames, {} lines of events, {replayed_s:.0} s \
             in {seconds:.1} s ({:.0} x real time)",
            self.area.id,
            counts.scans_in,
            self.downstream.frames,
            self.downstream.events.lines(),
            replayed_s / seconds.max(1e-9)
        )
    }

    /// Writes what is known at the end.
    ///
    /// # Errors
    /// If the results cannot be written.
    pub fn finish(self, directory: &Path, recording: &Path) -> Result<(), ReplayError> {
        let Self { area, lasers, fusion, downstream, .. } = self;
        let Downstream { mapper, results, events, .. } = downstream;
        results
            .finish(mapper.grid(), &mapper.context_names())
            .map_err(write_error(directory))?;
        output::write_grid(directory, &area, &lasers, &fusion)?;
        let marks = events.finish()?;
        output::write_pictures(directory, &area, &lasers, &mapper, &marks, recording)
    }
}

impl Downstream {
    fn frame(&mut self, frame: &fusion::core::FrameOut<'_>) -> Result<(), ReplayError> {
        let Self { mapper, watch, results, events, changes, frames, directory } = self;
        let context = mapper.context_of(frame.number);
        let mut written = Ok(());
        mapper.frame(frame.view(), |number, grid| {
            *frames += 1;
            if written.is_ok() {
                written = results.step(number, grid.classes());
            }
        });
        written.map_err(write_error(directory))?;
        let classes = mapper.grid().classes();
        let lasers_present = frame.lasers_present;
        watch.handle(
            &ClassFrame { number: frame.number, lasers_present, context, classes },
            changes,
        );
        events.write(changes)
    }
}
