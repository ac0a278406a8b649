//! How far the echoes of a recording reach, so that an area can be laid round them.
//!
//! Per axis the coordinates of all echoes are counted in bins of [`BIN_M`]. The extent leaves out
//! [`TAIL_SHARE`] of the echoes at each end (stray echoes through a window would blow the area up),
//! contains every laser, and keeps a margin. Counts only: the order of the scans does not matter.

use protocol::geometry::{GridGeometry, Pose};
use protocol::scan::{LaserScan, Reading, ScanGeometry, reading};

/// Width of a bin, metres: half the default cell, so that rounding to cells hides it.
const BIN_M: f64 = 0.05;
/// Coordinates beyond this fall into the last bin: readings end at 1000 m, lasers stand within 100
/// m.
const REACH_M: f64 = 1100.0;
const BINS: usize = (2.0 * REACH_M / BIN_M) as usize;
/// Share of the echoes that may lie outside, at each end of each axis: 99.5 % lie inside.
pub const TAIL_SHARE: f64 = 0.0025;
/// Room between the outermost echo and the edge of the area, metres: a person who leans on the
/// wall.
pub const MARGIN_M: f64 = 0.5;

/// Counts of echo coordinates along x and y, in site coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct Extent {
    axes: [Vec<u64>; 2],
    echoes: u64,
    lasers_m: Vec<[f64; 2]>,
}

impl Default for Extent {
    fn default() -> Self {
        Self { axes: [vec![0; BINS], vec![0; BINS]], echoes: 0, lasers_m: Vec::new() }
    }
}

/// Why no area can be laid round the scans.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ExtentError {
    /// Nothing but no-returns and invalid readings.
    #[error("no reading of the recording is an echo: there is nothing to lay an area round")]
    NoEcho,
    /// The scans reach too far for the cell.
    #[error(
        "the scans span {width_m:.1} m x {height_m:.1} m, which are more cells of {cell_m} m than \
         an area may have ({} a side, {} in all): use a site file with larger cells or a smaller area",
        GridGeometry::SIDE_MAX,
        GridGeometry::CELLS_MAX
    )]
    TooLarge {
        /// Along x, metres.
        width_m: f64,
        /// Along y, metres.
        height_m: f64,
        /// Edge of a cell, metres.
        cell_m: f64,
    },
}

/// Directions of the beams of one geometry in site coordinates, computed once.
#[derive(Debug, Clone, Default)]
pub(crate) struct Directions {
    geometry: Option<(ScanGeometry, Pose)>,
    unit: Vec<[f64; 2]>,
}

impl Directions {
    fn of(&mut self, geometry: &ScanGeometry, beams: usize, pose: Pose) -> &[[f64; 2]] {
        if self.geometry != Some((*geometry, pose)) || self.unit.len() < beams {
            self.geometry = Some((*geometry, pose));
            let direction = |beam| {
                let (sin, cos) = (geometry.bearing_rad(beam) + pose.yaw_rad).sin_cos();
                [cos, sin]
            };
            self.unit = (0..beams).map(direction).collect();
        }
        &self.unit
    }
}

impl Extent {
    /// Adds the place of a laser.
    pub(crate) fn add_laser(&mut self, pose: Pose) {
        self.lasers_m.push([pose.x_m, pose.y_m]);
    }

    /// Adds the echoes of a scan; returns how many readings are (no return, invalid).
    pub(crate) fn add_scan(
        &mut self,
        scan: &LaserScan,
        pose: Pose,
        directions: &mut Directions,
    ) -> [u64; 2] {
        let mut silent = [0; 2];
        let directions = directions.of(&scan.geometry, scan.ranges_m.len(), pose);
        for (range_m, direction) in scan.ranges_m.iter().zip(directions) {
            match reading(*range_m, &scan.geometry) {
                Reading::NoReturn => silent[0] += 1,
                Reading::Invalid => silent[1] += 1,
                Reading::Echo(range_m) => {
                    self.axes[0][bin(pose.x_m + range_m * direction[0])] += 1;
                    self.axes[1][bin(pose.y_m + range_m * direction[1])] += 1;
                    self.echoes += 1;
                }
            }
        }
        silent
    }

    /// Lowest and highest coordinate of an axis, the tails left out, the lasers included, metres.
    fn interval_m(&self, axis: usize) -> [f64; 2] {
        let tail = (self.echoes as f64 * TAIL_SHARE) as u64;
        let bins = self.axes[axis].iter().enumerate();
        let low = first_beyond(bins.clone(), tail) as f64 * BIN_M - REACH_M;
        let high = (first_beyond(bins.rev(), tail) + 1) as f64 * BIN_M - REACH_M;
        let lasers = self.lasers_m.iter().map(|laser| laser[axis]);
        [lasers.clone().fold(low, f64::min), lasers.fold(high, f64::max)]
    }

    /// A grid of cells of `cell_m` (> 0) round the echoes and the lasers, with [`MARGIN_M`],
    /// rounded outward to whole cells of a lattice through the site's origin.
    ///
    /// # Errors
    /// [`ExtentError`]: no echo at all, or more cells than an area may have.
    pub fn area(&self, cell_m: f64) -> Result<GridGeometry, ExtentError> {
        if self.echoes == 0 {
            return Err(ExtentError::NoEcho);
        }
        let cells = [0, 1].map(|axis| {
            let [low_m, high_m] = self.interval_m(axis);
            [((low_m - MARGIN_M) / cell_m).floor(), ((high_m + MARGIN_M) / cell_m).ceil()]
        });
        let [columns, rows] = cells.map(|[low, high]| high - low);
        let side_max = f64::from(GridGeometry::SIDE_MAX);
        if columns > side_max || rows > side_max || columns * rows > GridGeometry::CELLS_MAX as f64
        {
            let (width_m, height_m) = (columns * cell_m, rows * cell_m);
            return Err(ExtentError::TooLarge { width_m, height_m, cell_m });
        }
        Ok(GridGeometry {
            origin_m: cells.map(|[low, _]| lattice_m(low, cell_m)),
            cell_m,
            columns: columns as u32,
            rows: rows as u32,
        })
    }
}

/// How many readings of a scan are (no return, invalid).
pub(crate) fn silent(scan: &LaserScan) -> [u64; 2] {
    let mut silent = [0; 2];
    for range_m in &scan.ranges_m {
        match reading(*range_m, &scan.geometry) {
            Reading::NoReturn => silent[0] += 1,
            Reading::Invalid => silent[1] += 1,
            Reading::Echo(_) => {}
        }
    }
    silent
}

/// `cells * cell_m` as a person would write it: -32 * 0.1 is -3.2 and not -3.2000000000000002, if
/// the cell is a whole fraction of a metre.
fn lattice_m(cells: f64, cell_m: f64) -> f64 {
    let per_metre = (1.0 / cell_m).round();
    if per_metre >= 1.0 && 1.0 / per_metre == cell_m { cells / per_metre } else { cells * cell_m }
}

fn bin(coordinate_m: f64) -> usize {
    (((coordinate_m + REACH_M) / BIN_M) as usize).min(BINS - 1) // a negative number casts to 0
}

/// The first bin at which the counts so far are more than `tail`.
fn first_beyond<'a>(bins: impl Iterator<Item = (usize, &'a u64)>, tail: u64) -> usize {
    let mut count = 0;
    let mut last = 0;
    for (index, in_bin) in bins {
        count += in_bin;
        last = index;
        if count > tail {
            break;
        }
    }
    last
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    const GEOMETRY: ScanGeometry = ScanGeometry {
        angle_min_rad: -std::f64::consts::FRAC_PI_2,
        angle_increment_rad: std::f64::consts::FRAC_PI_2,
        range_min_m: 0.1,
        range_max_m: 30.0,
    };

    fn extent(ranges_m: [f32; 3], stray: usize, pose: Pose) -> Extent {
        let mut extent = Extent::default();
        extent.add_laser(pose);
        let mut directions = Directions::default();
        for scan in 0..1000 {
            let mut ranges_m = ranges_m.to_vec();
            if scan < stray {
                ranges_m[1] = 29.0;
            }
            let scan = LaserScan { geometry: GEOMETRY, ranges_m, ..LaserScan::default() };
            extent.add_scan(&scan, pose, &mut directions);
        }
        extent
    }

    #[test]
    fn an_area_holds_the_echoes_the_laser_and_a_margin() {
        // Beams to -y, +x, +y from the origin.
        let grid = extent([2.01, 3.01, 1.01], 0, Pose::default()).area(0.1).unwrap();
        assert_eq!(grid.origin_m, [-0.5, -2.6]);
        assert_eq!((grid.columns, grid.rows), (41, 42));
        assert!(grid.cell_at(3.01 + 0.45, 0.0).is_some());
        assert!(grid.cell_at(-0.45, 0.0).is_some());
    }

    #[test]
    fn a_turned_laser_sees_along_its_own_heading() {
        let pose = Pose { x_m: 10.0, y_m: 20.0, yaw_rad: std::f64::consts::PI };
        let grid = extent([2.01, 3.01, 1.01], 0, pose).area(0.1).unwrap();
        // Its +x beam reaches to x = 7; its -y beam to y = 22.
        assert!(grid.cell_at(6.6, 20.0).is_some());
        assert!(grid.cell_at(10.0, 22.4).is_some());
        assert!(grid.cell_at(11.0, 20.0).is_none());
    }

    #[test]
    fn a_few_stray_echoes_do_not_blow_the_area_up_but_many_do() {
        let few = extent([2.0, 3.0, 1.0], 7, Pose::default()).area(0.1).unwrap();
        assert!(few.columns < 60, "{few:?}");
        let many = extent([2.0, 3.0, 1.0], 8, Pose::default()).area(0.1).unwrap();
        assert!(many.columns > 290, "{many:?}");
    }

    #[test]
    fn no_echo_and_too_many_cells_are_told() {
        let none = extent([f32::INFINITY, f32::NAN, 0.0], 0, Pose::default());
        assert_eq!(none.area(0.1), Err(ExtentError::NoEcho));
        let far = extent([2.0, 29.5, 1.0], 0, Pose::default());
        let error = far.area(0.002).unwrap_err().to_string();
        assert!(error.contains("larger cells"), "{error}");
    }
}
