//! `tog bag export` and `convert`: where copied scans go.

use super::BagError;
use super::cli::{Convert, Export, OutFormat};
use super::import::copy;
use recording::{CsvWriter, RecordedScan, Recording, ScanTopic, ScanWriter};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Runs `tog bag export`.
pub fn export(arguments: &Export) -> Result<Option<String>, BagError> {
    let format = arguments.format.map_or_else(|| by_ending(&arguments.out), Ok)?;
    copy(&arguments.recording, &arguments.out, format, &arguments.selection)
}

/// Runs `tog bag convert`.
pub fn convert(arguments: &Convert) -> Result<Option<String>, BagError> {
    let format = by_ending(&arguments.out)?;
    copy(&arguments.recording, &arguments.out, format, &arguments.selection)
}

fn by_ending(out: &Path) -> Result<OutFormat, BagError> {
    match out.extension().and_then(|ending| ending.to_str()) {
        Some("mcap") => Ok(OutFormat::Mcap),
        Some("csv") => Ok(OutFormat::Csv),
        _ => Err(BagError::Ending(out.to_owned())),
    }
}

/// A file that scans are written to; created with the first scan.
pub enum Sink {
    /// ROS 2 recording.
    Mcap {
        /// What to call it.
        path: PathBuf,
        /// The writer.
        writer: Option<Box<ScanWriter>>,
        /// Numbers of the topics.
        topics: BTreeMap<Arc<str>, usize>,
    },
    /// One scan a row.
    Csv {
        /// What to call it.
        path: PathBuf,
        /// Beams of the largest scan.
        beams_max: usize,
        /// The writer.
        writer: Option<CsvWriter>,
    },
}

impl Sink {
    /// For the scans of a recording. A CSV names every column in its first line: the recording is
    /// read once before.
    pub fn new(recording: &Recording, out: &Path, format: OutFormat) -> Result<Self, BagError> {
        let path = out.to_owned();
        Ok(match format {
            OutFormat::Mcap => Self::Mcap { path, writer: None, topics: BTreeMap::new() },
            OutFormat::Csv => {
                let beams = recording.scans().flatten().map(|found| found.scan.ranges_m.len());
                Self::Csv { path, beams_max: beams.max().unwrap_or(0), writer: None }
            }
        })
    }

    /// True if topics must have names that ROS knows.
    pub fn wants_ros_names(&self) -> bool {
        matches!(self, Self::Mcap { .. })
    }

    /// Appends a scan.
    pub fn write(&mut self, found: &RecordedScan) -> Result<(), BagError> {
        match self {
            Self::Csv { path, beams_max, writer } => {
                let writer = match writer {
                    Some(writer) => writer,
                    None => writer.insert(CsvWriter::create(&*path, *beams_max)?),
                };
                Ok(writer.write(found)?)
            }
            Self::Mcap { path, writer, topics } => {
                let writer = match writer {
                    Some(writer) => writer,
                    None => writer.insert(Box::new(ScanWriter::create(&*path)?)),
                };
                let number = match topics.get(&found.topic) {
                    Some(number) => *number,
                    None => {
                        let number = writer.add_topic(ScanTopic {
                            topic: found.topic.to_string(),
                            frame_id: found.frame_id.to_string(),
                            scan_time_s: found.scan_time_s,
                        })?;
                        topics.insert(found.topic.clone(), number);
                        number
                    }
                };
                Ok(writer.write(number, found.log_time_ns, &found.scan.view())?)
            }
        }
    }

    /// Leaves nothing of a file that was begun.
    pub fn abandon(self) {
        let (path, is_begun) = match &self {
            Self::Mcap { path, writer, .. } => (path, writer.is_some()),
            Self::Csv { path, writer, .. } => (path, writer.is_some()),
        };
        let mut active = path.clone().into_os_string();
        active.push(".active");
        drop(self);
        if is_begun {
            // If it cannot be removed it is only in the way: what went wrong is told already.
            let _ = std::fs::remove_file(active);
        }
    }

    /// Gives the file its name.
    pub fn finish(self) -> Result<(), BagError> {
        match self {
            Self::Mcap { writer: Some(writer), .. } => writer.finish()?,
            Self::Csv { writer: Some(writer), .. } => writer.finish()?,
            Self::Mcap { .. } | Self::Csv { .. } => {}
        }
        Ok(())
    }
}
