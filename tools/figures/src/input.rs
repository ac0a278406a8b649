//! What is drawn, and the checks that every picture starts with.

use crate::FigureError;
use protocol::geometry::GridGeometry;
use protocol::grid::ClassName;

/// How often each cell was of one class.
#[derive(Debug, Clone)]
pub struct ShareMap {
    /// Where the cells are.
    pub grid: GridGeometry,
    /// Share of the cell's observed frames, \[row, column\], 0..=1; NaN = never observed.
    pub share: Vec<f32>,
    /// Large line on top: area and class.
    pub title: String,
    /// Small lines below: observed time, recording.
    pub subtitle: String,
}

/// The class of every cell at one instant.
#[derive(Debug, Clone)]
pub struct ClassGrid {
    /// Where the cells are.
    pub grid: GridGeometry,
    /// Class id of each cell, \[row, column\]; `CLASS_UNKNOWN` (255) = unknown.
    pub classes: Vec<u8>,
    /// Names of the ids, in the order of the legend.
    pub names: Vec<ClassName>,
    /// Large line on top.
    pub title: String,
    /// Small lines below.
    pub subtitle: String,
}

/// Shares of one class, for [`OverviewMap`].
#[derive(Debug, Clone)]
pub struct ClassShare {
    /// Class id: decides the colour.
    pub id: u8,
    /// Name in the legend and above the panel.
    pub name: String,
    /// As [`ShareMap::share`].
    pub share: Vec<f32>,
}

/// A collapsed map with all its classes.
#[derive(Debug, Clone)]
pub struct OverviewMap {
    /// Where the cells are.
    pub grid: GridGeometry,
    /// The classes in the order of the panels; unknown is none of them.
    pub classes: Vec<ClassShare>,
    /// Large line on top.
    pub title: String,
    /// Small lines below.
    pub subtitle: String,
    /// Named places.
    pub zones: Vec<ZoneMark>,
}

/// A named place in a picture.
#[derive(Debug, Clone)]
pub struct ZoneMark {
    /// Its name.
    pub name: String,
    /// Corners, metres of the site.
    pub polygon_m: Vec<[f64; 2]>,
}

/// How the share of one class changed from one map to a later one of the same grid.
#[derive(Debug, Clone)]
pub struct ChangeMap {
    /// Where the cells are.
    pub grid: GridGeometry,
    /// As [`ShareMap::share`], in the earlier map.
    pub before: Vec<f32>,
    /// As [`ShareMap::share`], in the later map.
    pub after: Vec<f32>,
    /// Large line on top.
    pub title: String,
    /// Small lines below.
    pub subtitle: String,
}

/// A laser in a picture.
#[derive(Debug, Clone)]
pub struct LaserMark {
    /// Name beside the mark.
    pub id: String,
    /// Site x, metres.
    pub x_m: f64,
    /// Site y, metres.
    pub y_m: f64,
    /// Heading, radians, counter-clockwise from site x.
    pub yaw_rad: f64,
}

/// An event in a picture.
#[derive(Debug, Clone)]
pub struct EventMark {
    /// Site x, metres.
    pub x_m: f64,
    /// Site y, metres.
    pub y_m: f64,
    /// Its line in the list beside the picture.
    pub label: String,
}

/// Format of the file of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FileFormat {
    /// Pixels, 8-bit RGB.
    #[default]
    Png,
    /// Shapes and text, the cells as an embedded PNG.
    Svg,
}

/// Where the scale of colour of [`crate::class_share`] ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Scale {
    /// At 100 %: pictures can be compared.
    #[default]
    Full,
    /// At the largest share of the picture: what is rare everywhere is seen.
    Max,
}

/// How pictures look.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Exponent of the scale of shares: colour = share ^ gamma, 0.1..=1. The default, 0.4, shows a
    /// path that is used 1 % of the time as clearly as a wall; it is printed under the picture.
    pub gamma: f64,
    /// Largest width and height of the map itself, pixels, each 200..=4096; other values count as
    /// the nearest. Small grids are enlarged by whole factors up to it, large ones reduced.
    pub plot_max_px: [u32; 2],
    /// Show only the part that was ever observed (with its lasers), not the whole grid.
    pub crop: bool,
    /// Format of the file.
    pub format: FileFormat,
    /// Where the scale of a single class ends.
    pub scale: Scale,
}

impl Default for Options {
    fn default() -> Self {
        let (format, scale) = (FileFormat::Png, Scale::Full);
        Self { gamma: 0.4, plot_max_px: [1000, 800], crop: true, format, scale }
    }
}

impl Options {
    pub(crate) fn check(&self) -> Result<(), FigureError> {
        let valid = (0.1..=1.0).contains(&self.gamma);
        if valid { Ok(()) } else { Err(FigureError::Gamma(self.gamma)) }
    }

    /// `plot_max_px` within its limits: below 200 no axis fits, above 4096 nobody sees it at once.
    pub(crate) fn plot_max_px(&self) -> [i32; 2] {
        self.plot_max_px.map(|side| side.clamp(200, 4096) as i32)
    }
}

/// Shares of every class from exact counts: `counts` is \[class, row, column\], of `classes` classes
/// and `cells` cells. share = count / total of the cell, NaN where the total is 0.
///
/// # Errors
/// [`FigureError::Length`] if `counts` does not have `classes * cells` values.
pub fn shares(counts: &[u64], classes: usize, cells: usize) -> Result<Vec<Vec<f32>>, FigureError> {
    let expected = classes.saturating_mul(cells);
    if counts.len() != expected || cells == 0 {
        let what = format!("counts of {classes} classes");
        return Err(FigureError::Length { what, found: counts.len(), expected });
    }
    let mut totals = vec![0u64; cells];
    for class in counts.chunks_exact(cells) {
        for (total, count) in totals.iter_mut().zip(class) {
            *total = total.saturating_add(*count);
        }
    }
    let share = |(&count, &total): (&u64, &u64)| match total {
        0 => f32::NAN,
        total => (count as f64 / total as f64) as f32,
    };
    Ok(counts.chunks_exact(cells).map(|c| c.iter().zip(&totals).map(share).collect()).collect())
}

pub(crate) fn check_grid(grid: &GridGeometry) -> Result<(), FigureError> {
    let side = 1..=GridGeometry::SIDE_MAX;
    let valid = side.contains(&grid.columns)
        && side.contains(&grid.rows)
        && grid.cells() <= GridGeometry::CELLS_MAX
        && (1e-3..=1e6).contains(&grid.cell_m)
        && grid.origin_m.iter().all(|o| o.abs() <= 1e9);
    if valid {
        return Ok(());
    }
    let GridGeometry { origin_m, cell_m, columns, rows } = *grid;
    Err(FigureError::Grid { origin_m, cell_m, columns, rows })
}

pub(crate) fn check_length(
    what: &str,
    found: usize,
    grid: &GridGeometry,
) -> Result<(), FigureError> {
    let expected = grid.cells();
    if found == expected {
        return Ok(());
    }
    Err(FigureError::Length { what: what.to_owned(), found, expected })
}

pub(crate) fn check_share(
    what: &str,
    share: &[f32],
    grid: &GridGeometry,
) -> Result<(), FigureError> {
    check_length(what, share.len(), grid)?;
    let bad = share.iter().position(|s| !s.is_nan() && !(0.0..=1.0).contains(s));
    match bad {
        Some(index) => {
            Err(FigureError::Share { what: what.to_owned(), index, value: share[index] })
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn shares_of_a_cell_add_up_to_one_and_an_unobserved_cell_has_none() {
        let shares = shares(&[3, 0, 1, 0], 2, 2).unwrap();
        assert_eq!((shares[0][0], shares[1][0]), (0.75, 0.25));
        assert!(shares[0][1].is_nan() && shares[1][1].is_nan());
        assert!(super::shares(&[1, 2, 3], 2, 2).is_err());
    }

    #[test]
    fn values_that_are_no_share_are_named_with_their_cell() {
        let grid = GridGeometry { origin_m: [0.0; 2], cell_m: 0.1, columns: 2, rows: 1 };
        let text = check_share("passing", &[0.5, 1.5], &grid).unwrap_err().to_string();
        assert!(text.contains("passing") && text.contains("1.5") && text.contains("cell 1"));
        assert!(check_share("passing", &[f32::NAN, 1.0], &grid).is_ok());
        assert!(check_share("passing", &[f32::INFINITY, 1.0], &grid).is_err());
        assert!(check_share("passing", &[0.0], &grid).is_err());
    }

    #[test]
    fn grids_that_cannot_be_drawn_are_refused() {
        let good = GridGeometry { origin_m: [0.0; 2], cell_m: 0.1, columns: 2, rows: 1 };
        assert!(check_grid(&good).is_ok());
        for bad in [
            GridGeometry { columns: 0, ..good },
            GridGeometry { columns: 4096, rows: 4096, ..good },
            GridGeometry { cell_m: f64::NAN, ..good },
            GridGeometry { origin_m: [f64::INFINITY, 0.0], ..good },
        ] {
            assert!(check_grid(&bad).is_err(), "{bad:?}");
        }
    }
}
