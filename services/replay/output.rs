//! What a replay leaves behind beside the arrays: grid.json, events.jsonl, pictures.

use super::{ReplayError, write_error};
use crate::pipeline::Pipeline;
use figures::{ClassShare, EventMark, LaserMark, Options, OverviewMap, ShareMap};
use protocol::event::{EventChange, EventState};
use protocol::grid::ClassName;
use protocol::site::Laser;
use serde_json::json;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Most events that are marked in the overview: more would hide the map.
const EVENT_MARKS_MAX: usize = 40;

/// `events.jsonl`: a line per change of an event.
pub struct EventLog {
    path: PathBuf,
    file: BufWriter<File>,
    lines: u64,
    marks: Vec<EventMark>,
}

impl EventLog {
    /// Creates the file in `directory`.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn create(directory: &Path) -> Result<Self, ReplayError> {
        let path = directory.join("events.jsonl");
        let file = BufWriter::new(File::create(&path).map_err(write_error(&path))?);
        Ok(Self { path, file, lines: 0, marks: Vec::new() })
    }

    /// Writes and clears `changes`.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn write(&mut self, changes: &mut Vec<EventChange>) -> Result<(), ReplayError> {
        for change in changes.drain(..) {
            self.lines += 1;
            if change.state == EventState::Raised && self.marks.len() < EVENT_MARKS_MAX {
                let label = format!("{} {}", change.id, change.kind.words());
                self.marks.push(EventMark { x_m: change.x_m, y_m: change.y_m, label });
            }
            serde_json::to_writer(&mut self.file, &change)
                .map_err(std::io::Error::from)
                .and_then(|()| self.file.write_all(b"\n"))
                .map_err(write_error(&self.path))?;
        }
        Ok(())
    }

    /// Lines so far.
    pub fn lines(&self) -> u64 {
        self.lines
    }

    /// Flushes the file; returns the places of the raised events.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn finish(mut self) -> Result<Vec<EventMark>, ReplayError> {
        self.file.flush().map_err(write_error(&self.path))?;
        Ok(self.marks)
    }
}

/// Writes `grid.json`: what somebody needs to read the arrays, and to compute them again.
///
/// # Errors
/// Those of the file system.
pub fn write_grid(directory: &Path, pipeline: &Pipeline) -> Result<(), ReplayError> {
    let Pipeline { area, lasers, fusion, .. } = pipeline;
    let laser = |(index, laser): (usize, &Laser)| {
        let pose = laser.pose();
        let (geometry, beams) = fusion.geometry(index).unwrap_or_default();
        json!({
            "id": laser.id,
            "x_m": pose.x_m,
            "y_m": pose.y_m,
            "yaw_rad": pose.yaw_rad,
            "angle_min_rad": geometry.angle_min_rad,
            "angle_increment_rad": geometry.angle_increment_rad,
            "beams": beams,
            "range_min_m": geometry.range_min_m,
            "range_max_m": geometry.range_max_m,
            "half_beam_rad": laser.half_beam_deg.map(f64::to_radians),
            "no_return": laser.no_return,
            "source": laser.source,
        })
    };
    let prototypes: Vec<Vec<f64>> =
        area.prototypes().into_iter().map(|class| class.prototype).collect();
    let grid = json!({
        "area": area.id,
        "origin_m": area.origin_m,
        "cell_m": area.cell_m,
        "columns": area.columns,
        "rows": area.rows,
        "frame_period_ns": area.lattice().period_ns(),
        "scan_age_max_ms": area.scan_age_max_ms,
        "range_tolerance_m": area.range_tolerance_m(),
        "timescales_s": area.timescales_s,
        "known_share_min": area.known_share_min,
        "preset": area.preset.name(),
        "classes": area.class_names(),
        "prototypes": prototypes,
        "transit": area.has_transit(),
        "lasers": lasers.iter().enumerate().map(laser).collect::<Vec<_>>(),
    });
    let path = directory.join("grid.json");
    let text = format!("{grid:#}\n");
    std::fs::write(&path, text).map_err(write_error(&path))
}

/// Writes a PNG per class and `overview.png`.
///
/// # Errors
/// If a picture cannot be drawn or written.
pub fn write_pictures(
    directory: &Path,
    pipeline: &Pipeline,
    events: &[EventMark],
    recording: &Path,
) -> Result<(), ReplayError> {
    let Pipeline { area, lasers, mapper, .. } = pipeline;
    let names = area.class_names();
    let cells = area.grid().cells();
    let mut total = vec![0u64; names.len() * cells];
    let mut counts = vec![0u64; names.len() * cells];
    for context in 0..mapper.context_names().len() {
        mapper.grid().collapsed(context, &mut counts);
        total.iter_mut().zip(&counts).for_each(|(total, count)| *total += count);
    }
    let shares = figures::shares(&total, names.len(), cells)?;
    let marks: Vec<LaserMark> = lasers
        .iter()
        .map(|laser| {
            let pose = laser.pose();
            LaserMark { id: laser.id.clone(), x_m: pose.x_m, y_m: pose.y_m, yaw_rad: pose.yaw_rad }
        })
        .collect();
    let observed = (0..cells)
        .map(|cell| (0..names.len()).map(|class| total[class * cells + cell]).sum::<u64>())
        .max()
        .unwrap_or(0);
    let observed_s = observed as f64 * area.frame_period_ms / 1000.0;
    let name = recording.file_name().unwrap_or_default().to_string_lossy();
    let subtitle = format!("{name}: up to {observed_s:.0} s of classified time a cell");
    let options = Options::default();
    let write = |name: &str, png: Vec<u8>| {
        let path = directory.join(format!("{name}.png"));
        std::fs::write(&path, png).map_err(write_error(&path))
    };
    let write_share = |(class, share): (&ClassName, &Vec<f32>)| {
        let map = ShareMap {
            grid: area.grid(),
            share: share.clone(),
            title: format!("{}: share of `{}`", area.id, class.name),
            subtitle: subtitle.clone(),
        };
        write(&class.name, figures::class_share(&map, &marks, &options)?)
    };
    let write_overview = || {
        let class = |(class, share): (&ClassName, &Vec<f32>)| ClassShare {
            id: class.id,
            name: class.name.clone(),
            share: share.clone(),
        };
        let map = OverviewMap {
            grid: area.grid(),
            classes: names.iter().zip(&shares).map(class).collect(),
            title: area.id.clone(),
            subtitle: subtitle.clone(),
        };
        write("overview", figures::overview(&map, &marks, events, &options)?)
    };
    // The pictures of the classes beside the overview: each half takes as long as the other.
    std::thread::scope(|threads| {
        let overview = threads.spawn(write_overview);
        let shares = names.iter().zip(&shares).try_for_each(write_share);
        let overview = overview.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        shares.and(overview)
    })
}
