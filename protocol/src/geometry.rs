//! Where things are: the site's coordinates, poses, and the grid of an area.
//!
//! One site coordinate system: metres, x right, y up, angles counter-clockwise, radians.
//! This file is the one owner of metres <-> cells.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A pose in the plane: `site_from_laser` is a laser's pose in site coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose {
    /// Site x of the origin, metres.
    pub x_m: f64,
    /// Site y of the origin, metres.
    pub y_m: f64,
    /// Heading, radians, counter-clockwise from site x.
    pub yaw_rad: f64,
}

/// The grid of an area: `rows` x `columns` square cells, row 0 lowest, stored row by row.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GridGeometry {
    /// Lower left corner of the grid in site coordinates, metres.
    pub origin_m: [f64; 2],
    /// Edge of a cell, metres, > 0.
    pub cell_m: f64,
    /// Cells along x, 1..=[`GridGeometry::SIDE_MAX`].
    pub columns: u32,
    /// Cells along y, 1..=[`GridGeometry::SIDE_MAX`].
    pub rows: u32,
}

impl GridGeometry {
    /// Longest side in cells: 4096 cells of 10 cm are 410 m, a large hall; more is a mistake in the file.
    pub const SIDE_MAX: u32 = 4096;
    /// Most cells of an area: 4 Mi cells, so that a class map stays below 4 MiB of shared memory.
    pub const CELLS_MAX: usize = 1 << 22;

    /// Number of cells.
    #[must_use]
    pub fn cells(&self) -> usize {
        self.columns as usize * self.rows as usize
    }

    /// Index of a cell in a [row, column] array.
    #[must_use]
    pub fn index(&self, column: u32, row: u32) -> usize {
        row as usize * self.columns as usize + column as usize
    }

    /// Centre of a cell in site coordinates: origin + ((c+0.5)*cell, (r+0.5)*cell).
    #[must_use]
    pub fn centre_m(&self, column: u32, row: u32) -> [f64; 2] {
        [
            self.origin_m[0] + (f64::from(column) + 0.5) * self.cell_m,
            self.origin_m[1] + (f64::from(row) + 0.5) * self.cell_m,
        ]
    }

    /// Centre of the cell with this array index.
    #[must_use]
    pub fn centre_of_index_m(&self, index: usize) -> [f64; 2] {
        let columns = self.columns as usize;
        self.centre_m((index % columns) as u32, (index / columns) as u32)
    }

    /// The cell that contains a site point, if it lies in the grid.
    #[must_use]
    pub fn cell_at(&self, x_m: f64, y_m: f64) -> Option<(u32, u32)> {
        let column = ((x_m - self.origin_m[0]) / self.cell_m).floor();
        let row = ((y_m - self.origin_m[1]) / self.cell_m).floor();
        let inside = column >= 0.0
            && row >= 0.0
            && column < f64::from(self.columns)
            && row < f64::from(self.rows);
        inside.then_some((column as u32, row as u32))
    }

    /// Number of 64-bit words of a bit plane over the cells: bit i%64 of word i/64 is cell i.
    #[must_use]
    pub fn plane_words(&self) -> usize {
        self.cells().div_ceil(64)
    }
}

/// Wraps an angle to (-pi, pi].
#[must_use]
pub fn wrap_rad(angle_rad: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    if angle_rad > -PI && angle_rad <= PI {
        return angle_rad; // exact: an angle already in range is not touched by a rounding
    }
    let wrapped = angle_rad.rem_euclid(TAU);
    if wrapped > PI { wrapped - TAU } else { wrapped }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_lies_in_the_cell_whose_centre_is_nearest() {
        let grid = GridGeometry { origin_m: [-1.0, 2.0], cell_m: 0.5, columns: 4, rows: 3 };
        assert_eq!(grid.cell_at(-1.0, 2.0), Some((0, 0)));
        assert_eq!(grid.cell_at(0.99, 3.49), Some((3, 2)));
        assert_eq!(grid.cell_at(1.0, 2.0), None);
        assert_eq!(grid.cell_at(-1.01, 2.0), None);
        assert_eq!(grid.centre_m(3, 2), [0.75, 3.25]);
        assert_eq!(grid.centre_of_index_m(grid.index(3, 2)), [0.75, 3.25]);
    }

    #[test]
    fn angles_wrap_to_the_half_open_turn() {
        use std::f64::consts::PI;
        assert_eq!(wrap_rad(PI), PI);
        assert_eq!(wrap_rad(-PI), PI);
        assert!((wrap_rad(3.0 * PI / 2.0) + PI / 2.0).abs() < 1e-12);
        assert_eq!(wrap_rad(0.3), 0.3);
    }
}
