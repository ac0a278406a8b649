//! Writes scans as a CSV that its own first line explains (see [`crate::ColumnMap`]) and that
//! [`crate::Recording::open`] reads back to the same numbers.
//!
//! One scan a row; times in nanoseconds, angles in radians, ranges in metres, each number with as
//! many digits as tell it from its neighbours. `inf` is no return, `nan` invalid. Scans with fewer
//! beams than others end with empty fields.

use crate::error::RecordingError;
use crate::mcap_writer::check_replaceable;
use crate::recording::RecordedScan;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// A CSV that is being written.
pub struct CsvWriter {
    path: PathBuf,
    active_path: PathBuf,
    file: BufWriter<File>,
    beams_max: usize,
}

impl CsvWriter {
    /// Creates `<path>.active` for scans of at most `beams_max` beams, and writes the first line.
    ///
    /// # Errors
    /// [`RecordingError::Io`].
    pub fn create(path: impl AsRef<Path>, beams_max: usize) -> Result<Self, RecordingError> {
        let path = path.as_ref().to_owned();
        let mut active_path = path.clone().into_os_string();
        active_path.push(".active");
        let active_path = PathBuf::from(active_path);
        check_replaceable(&path)?;
        check_replaceable(&active_path)?;
        let create = || -> io::Result<BufWriter<File>> {
            let mut file = BufWriter::with_capacity(256 * 1024, File::create(&active_path)?);
            file.write_all(
                b"t:ns,log_t:ns,laser,frame_id,scan_time:s,angle_min:rad,angle_increment:rad,\
                  range_min:m,range_max:m",
            )?;
            (0..beams_max).try_for_each(|beam| write!(file, ",r{beam}:m"))?;
            file.write_all(b"\n").map(|()| file)
        };
        match create() {
            Ok(file) => Ok(Self { path, active_path, file, beams_max }),
            Err(source) => Err(RecordingError::Io { path: active_path, action: "create", source }),
        }
    }

    /// Appends a scan.
    ///
    /// # Errors
    /// [`RecordingError::Write`]: more beams than were announced, or a full disk.
    pub fn write(&mut self, found: &RecordedScan) -> Result<(), RecordingError> {
        let beams = found.scan.ranges_m.len();
        let refuse = |reason| RecordingError::Write { path: self.active_path.clone(), reason };
        if beams > self.beams_max {
            let most = self.beams_max;
            return Err(refuse(format!("a scan of {beams} beams, announced were {most}")));
        }
        let row = row(&mut self.file, found, self.beams_max);
        row.map_err(|error| RecordingError::Write {
            path: self.active_path.clone(),
            reason: error.to_string(),
        })
    }

    /// Puts the file on the disk and gives it its name.
    ///
    /// # Errors
    /// [`RecordingError::Io`].
    pub fn finish(mut self) -> Result<(), RecordingError> {
        let finish = self.file.flush().and_then(|()| self.file.get_ref().sync_all());
        finish
            .and_then(|()| fs::rename(&self.active_path, &self.path))
            .map_err(|source| RecordingError::Io { path: self.path, action: "finish", source })
    }
}

fn row(file: &mut impl Write, found: &RecordedScan, beams_max: usize) -> io::Result<()> {
    let (scan, geometry) = (&found.scan, &found.scan.geometry);
    write!(
        file,
        "{},{},{},{},{},{},{},{},{}",
        scan.stamp_ns,
        found.log_time_ns,
        quoted(&found.topic),
        quoted(&found.frame_id),
        found.scan_time_s,
        geometry.angle_min_rad,
        geometry.angle_increment_rad,
        geometry.range_min_m,
        geometry.range_max_m
    )?;
    for range_m in &scan.ranges_m {
        match range_m {
            nan if nan.is_nan() => file.write_all(b",nan")?,
            range_m => write!(file, ",{range_m}")?,
        }
    }
    (scan.ranges_m.len()..beams_max).try_for_each(|_| file.write_all(b","))?;
    file.write_all(b"\n")
}

/// A name as a field: in quotes where it needs them; line breaks, which no name needs, as blanks.
fn quoted(name: &str) -> String {
    let name = name.replace(['\n', '\r'], " ");
    if name.contains(['"', ',', ';', '\t']) || name.starts_with('#') {
        format!("\"{}\"", name.replace('"', "\"\""))
    } else {
        name
    }
}
