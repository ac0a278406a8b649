//! What a replay leaves behind beside the arrays: grid.json, events.jsonl, pictures.

use super::{ReplayError, write_error};
use crate::map::grid_file::{GridFile, LaserEntry};
use crate::map::pictures::Pictures;
use crate::pipeline::Pipeline;
use figures::{EventMark, Options};
use protocol::event::{EventChange, EventState};
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

/// The collapsed counts \[class, row, column\] of all contexts together.
pub fn total_counts(pipeline: &Pipeline) -> Vec<u64> {
    let Pipeline { area, mapper, .. } = pipeline;
    let values = area.class_names().len() * area.grid().cells();
    let (mut total, mut counts) = (vec![0u64; values], vec![0u64; values]);
    for context in 0..mapper.context_names().len() {
        mapper.grid().collapsed(context, &mut counts);
        total.iter_mut().zip(&counts).for_each(|(total, count)| *total += count);
    }
    total
}

/// Writes `grid.json`, and the `total` counts as a PNG per class and `overview.png`.
///
/// # Errors
/// If a picture cannot be drawn, or a file written.
pub fn write_map(
    directory: &Path,
    pipeline: &Pipeline,
    total: &[u64],
    events: &[EventMark],
    recording: &Path,
) -> Result<(), ReplayError> {
    let Pipeline { area, lasers, fusion, .. } = pipeline;
    let lasers = lasers.iter().enumerate();
    let lasers = lasers.map(|(index, laser)| LaserEntry::of(laser, fusion.geometry(index)));
    let grid = GridFile::of(area, lasers.collect());
    grid.write(directory).map_err(write_error(directory))?;

    let name = recording.file_name().unwrap_or_default().to_string_lossy();
    let pictures = Pictures::new(&grid, total, &name, events, Options::default())?;
    Ok(pictures.write_all(directory)?)
}
