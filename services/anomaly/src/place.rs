//! Boxes in site coordinates, and zones.

use protocol::geometry::GridGeometry;
use protocol::site::Zone;

/// Smallest and largest x and y, metres: [x_min, y_min, x_max, y_max].
pub(crate) type Bounds = [f64; 4];

/// The box of the cells of a span [column, row, column, row], edges included.
pub(crate) fn bounds_of(grid: &GridGeometry, span: [u32; 4]) -> Bounds {
    let low = grid.centre_m(span[0], span[1]);
    let high = grid.centre_m(span[2], span[3]);
    let half = grid.cell_m / 2.0;
    [low[0] - half, low[1] - half, high[0] + half, high[1] + half].map(millimetres)
}

/// The box of the whole grid.
pub(crate) fn grid_bounds(grid: &GridGeometry) -> Bounds {
    bounds_of(grid, [0, 0, grid.columns - 1, grid.rows - 1])
}

/// A point given in cells, in site coordinates.
pub(crate) fn point_m(grid: &GridGeometry, cells: [f64; 2]) -> [f64; 2] {
    [0, 1].map(|axis| millimetres(grid.origin_m[axis] + cells[axis] * grid.cell_m))
}

/// Metres rounded to millimetres: nothing here is known better.
pub(crate) fn millimetres(value_m: f64) -> f64 {
    (value_m * 1000.0).round() / 1000.0
}

pub(crate) fn union(a: Bounds, b: Bounds) -> Bounds {
    [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
}

/// Free distance between two boxes, metres; 0 if they touch.
pub(crate) fn gap_m(a: Bounds, b: Bounds) -> f64 {
    let dx = (a[0] - b[2]).max(b[0] - a[2]).max(0.0);
    let dy = (a[1] - b[3]).max(b[1] - a[3]).max(0.0);
    dx.hypot(dy)
}

/// Calls `visit` with the cells whose centre lies in a box grown by `margin_m`.
pub(crate) fn for_each_cell(
    grid: &GridGeometry,
    bounds: Bounds,
    margin_m: f64,
    mut visit: impl FnMut(usize),
) {
    let index = |value: f64, origin: f64, count: u32| {
        (((value - origin) / grid.cell_m).floor().max(0.0) as u32).min(count - 1)
    };
    let low_c = index(bounds[0] - margin_m, grid.origin_m[0], grid.columns);
    let high_c = index(bounds[2] + margin_m, grid.origin_m[0], grid.columns);
    let low_r = index(bounds[1] - margin_m, grid.origin_m[1], grid.rows);
    let high_r = index(bounds[3] + margin_m, grid.origin_m[1], grid.rows);
    for row in low_r..=high_r {
        for column in low_c..=high_c {
            visit(grid.index(column, row));
        }
    }
}

/// The first zone that holds a point and is not excluded.
pub(crate) fn zone_at(zones: &[Zone], point_m: [f64; 2]) -> Option<&str> {
    zones
        .iter()
        .find(|zone| !zone.exclude && contains(&zone.polygon_m, point_m))
        .map(|zone| zone.name.as_str())
}

/// Even-odd rule.
pub(crate) fn contains(polygon_m: &[[f64; 2]], point_m: [f64; 2]) -> bool {
    let [x, y] = point_m;
    let mut inside = false;
    for (index, a) in polygon_m.iter().enumerate() {
        let b = polygon_m[(index + 1) % polygon_m.len()];
        if (a[1] > y) != (b[1] > y) && x < (b[0] - a[0]) * (y - a[1]) / (b[1] - a[1]) + a[0] {
            inside = !inside;
        }
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_is_in_a_polygon_that_is_not_convex() {
        let hook = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [3.0, 4.0], [3.0, 1.0], [0.0, 1.0]];
        assert!(contains(&hook, [3.5, 3.0]));
        assert!(contains(&hook, [0.5, 0.5]));
        assert!(!contains(&hook, [1.0, 3.0]));
    }

    #[test]
    fn boxes_that_touch_have_no_gap() {
        assert_eq!(gap_m([0.0, 0.0, 1.0, 1.0], [1.0, 0.5, 2.0, 2.0]), 0.0);
        assert_eq!(gap_m([0.0, 0.0, 1.0, 1.0], [4.0, 5.0, 6.0, 6.0]), 5.0);
    }
}
