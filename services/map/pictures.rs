//! Pictures of a collapsed map: an overview, and one per class. The same from `tog replay`,
//! `tog run --out` and `tog map`.

use super::grid_file::{GridFile, LaserEntry};
use figures::{
    ClassShare, EventMark, FigureError, FileFormat, LaserMark, Options, OverviewMap, ShareMap,
    ZoneMark,
};
use protocol::site::Zone;
use std::io;
use std::path::{Path, PathBuf};

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// It cannot be written.
    #[error("cannot write the picture {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// It cannot be drawn.
    #[error(transparent)]
    Figure(#[from] FigureError),
}

/// What is drawn.
pub struct Pictures<'m> {
    grid: &'m GridFile,
    shares: Vec<Vec<f32>>,
    subtitle: String,
    lasers: Vec<LaserMark>,
    events: &'m [EventMark],
    options: Options,
}

impl<'m> Pictures<'m> {
    /// Pictures of `counts` \[class, row, column\]; `name` says in the subtitle whose they are.
    ///
    /// # Errors
    /// If there are not as many counts as the grid has classes and cells.
    pub fn new(
        grid: &'m GridFile,
        counts: &[u64],
        name: &str,
        events: &'m [EventMark],
        options: Options,
    ) -> Result<Self, FigureError> {
        let cells = grid.geometry().cells();
        let shares = figures::shares(counts, grid.classes.len(), cells)?;
        let longest_s = observed_max(counts, cells) as f64 * grid.frame_period_ns as f64 / 1e9;
        let subtitle = format!("{name}: up to {longest_s:.0} s of classified time a cell");
        Ok(Self { grid, shares, subtitle, lasers: laser_marks(&grid.lasers), events, options })
    }

    /// The overview.
    ///
    /// # Errors
    /// If it cannot be drawn.
    pub fn overview(&self) -> Result<Vec<u8>, FigureError> {
        let classes = self.grid.classes.iter().zip(&self.shares);
        let map = OverviewMap {
            grid: self.grid.geometry(),
            classes: classes
                .map(|(class, share)| ClassShare {
                    id: class.id,
                    name: class.name.clone(),
                    share: share.clone(),
                })
                .collect(),
            title: self.grid.area.clone(),
            subtitle: self.subtitle.clone(),
            zones: self.grid.zones.iter().map(zone_mark).collect(),
        };
        figures::overview(&map, &self.lasers, self.events, &self.options)
    }

    /// The picture of one class.
    ///
    /// # Errors
    /// If it cannot be drawn.
    pub fn class(&self, index: usize) -> Result<Vec<u8>, FigureError> {
        let map = ShareMap {
            grid: self.grid.geometry(),
            share: self.shares[index].clone(),
            title: format!("{}: share of `{}`", self.grid.area, self.grid.classes[index].name),
            subtitle: self.subtitle.clone(),
        };
        figures::class_share(&map, &self.lasers, &self.options)
    }

    /// Writes the overview and a picture per class into a directory.
    ///
    /// # Errors
    /// If a picture cannot be drawn or written.
    pub fn write_all(&self, directory: &Path) -> Result<(), PictureError> {
        let format = self.options.format;
        let classes = || {
            (0..self.shares.len()).try_for_each(|index| {
                let path = picture_path(directory, &self.grid.classes[index].name, format);
                write(&path, &self.class(index)?)
            })
        };
        // The pictures of the classes beside the overview: each half takes as long as the other.
        std::thread::scope(|threads| {
            let overview = threads
                .spawn(|| write(&picture_path(directory, "overview", format), &self.overview()?));
            let classes = classes();
            let overview = overview.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            classes.and(overview)
        })
    }
}

/// Name of the file of a picture.
pub fn picture_path(directory: &Path, name: &str, format: FileFormat) -> PathBuf {
    let extension = match format {
        FileFormat::Png => "png",
        FileFormat::Svg => "svg",
    };
    directory.join(format!("{name}.{extension}"))
}

/// Writes a picture, and creates its directory.
///
/// # Errors
/// Those of the file system.
pub fn write(path: &Path, picture: &[u8]) -> Result<(), PictureError> {
    let directory = path.parent().filter(|parent| !parent.as_os_str().is_empty());
    directory
        .map_or(Ok(()), std::fs::create_dir_all)
        .and_then(|()| std::fs::write(path, picture))
        .map_err(|source| PictureError::Write { path: path.to_owned(), source })
}

/// The lasers of a map as marks.
pub fn laser_marks(lasers: &[LaserEntry]) -> Vec<LaserMark> {
    let mark = |laser: &LaserEntry| LaserMark {
        id: laser.id.clone(),
        x_m: laser.x_m,
        y_m: laser.y_m,
        yaw_rad: laser.yaw_rad,
    };
    lasers.iter().map(mark).collect()
}

/// A zone as a mark.
fn zone_mark(zone: &Zone) -> ZoneMark {
    let excluded = if zone.exclude { " (excluded)" } else { "" };
    ZoneMark { name: format!("{}{excluded}", zone.name), polygon_m: zone.polygon_m.clone() }
}

/// Most frames that a cell was classified in.
pub fn observed_max(counts: &[u64], cells: usize) -> u64 {
    totals(counts, cells).into_iter().max().unwrap_or(0)
}

/// Frames in which each cell was classified.
pub fn totals(counts: &[u64], cells: usize) -> Vec<u64> {
    let mut totals = vec![0u64; cells];
    for class in counts.chunks_exact(cells.max(1)) {
        for (total, count) in totals.iter_mut().zip(class) {
            *total = total.saturating_add(*count);
        }
    }
    totals
}
