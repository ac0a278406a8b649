//! Results of a replayed area as files for NumPy: the same from `tog replay` and `tog run --out`.
//!
//! | file | content |
//! |---|---|
//! | `classes.npy` | u8 [frame, row, col]: class ids, 255 unknown |
//! | `frames.npy` | u64 [frame]: lattice indices of these rows |
//! | `collapsed_counts.npy` | u64 [class, row, col], over all contexts |
//! | `collapsed_counts.<context>.npy` | the same of one context, if the site names contexts |
//! | `occupancy_last.npy` | f64 [timescale, row, col] after the last frame |

use crate::npy::{NpyWriter, write_u64};
use occupancy::TemporalGrid;
use protocol::geometry::GridGeometry;
use protocol::site::Area;
use protocol::time::{Lattice, SECOND_NS};
use std::io;
use std::path::{Path, PathBuf};

/// Which frames are written to `classes.npy`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rows {
    /// All.
    EveryFrame,
    /// The first of each second.
    OneASecond,
}

/// Name of the file with the collapsed counts of a context, or of all of them together.
#[must_use]
pub fn counts_file(context: Option<&str>) -> String {
    match context {
        None => "collapsed_counts.npy".to_owned(),
        Some(context) => format!("collapsed_counts.{context}.npy"),
    }
}

/// The files of one area.
#[derive(Debug)]
pub struct Results {
    directory: PathBuf,
    geometry: GridGeometry,
    timescales: usize,
    classes: usize,
    lattice: Lattice,
    rows: Rows,
    class_rows: NpyWriter,
    frame_rows: NpyWriter,
}

impl Results {
    /// Creates `directory` and the files that grow with the frames.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn create(directory: &Path, area: &Area, rows: Rows) -> io::Result<Self> {
        std::fs::create_dir_all(directory)?;
        let shape = [area.rows as usize, area.columns as usize];
        Ok(Self {
            directory: directory.to_owned(),
            geometry: area.grid(),
            timescales: area.timescales_s.len(),
            classes: area.class_names().len(),
            lattice: area.lattice(),
            rows,
            class_rows: NpyWriter::create(&directory.join("classes.npy"), "|u1", &shape)?,
            frame_rows: NpyWriter::create(&directory.join("frames.npy"), "<u8", &[])?,
        })
    }

    /// Takes the classes after frame `number`.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn step(&mut self, number: u64, classes: &[u8]) -> io::Result<()> {
        let into_second_ns = self.lattice.stamp_ns(number) % SECOND_NS;
        if self.rows == Rows::OneASecond && into_second_ns >= self.lattice.period_ns() {
            return Ok(());
        }
        self.class_rows.row(classes)?;
        self.frame_rows.row(&number.to_le_bytes())
    }

    /// Writes what is known at the end, and syncs everything.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn finish(self, grid: &TemporalGrid, contexts: &[&str]) -> io::Result<()> {
        self.class_rows.finish()?;
        self.frame_rows.finish()?;
        let cells = self.geometry.cells();
        let shape = [self.geometry.rows as usize, self.geometry.columns as usize];

        let mut total = vec![0u64; self.classes * cells];
        let mut counts = vec![0u64; self.classes * cells];
        for (index, name) in contexts.iter().enumerate() {
            grid.collapsed(index, &mut counts);
            total.iter_mut().zip(&counts).for_each(|(total, count)| *total += count);
            if contexts.len() > 1 {
                write_u64(&self.directory.join(counts_file(Some(name))), &shape, &counts)?;
            }
        }
        write_u64(&self.directory.join(counts_file(None)), &shape, &total)?;

        let path = self.directory.join("occupancy_last.npy");
        let mut writer = NpyWriter::create(&path, "<f8", &shape)?;
        let mut row = Vec::with_capacity(cells * 8);
        for timescale in 0..self.timescales {
            row.clear();
            for cell in 0..cells {
                row.extend(grid.occupancy(timescale, cell).to_le_bytes());
            }
            writer.row(&row)?;
        }
        writer.finish()
    }
}
