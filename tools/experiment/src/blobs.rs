//! Connected groups of cells.

use protocol::geometry::GridGeometry;

/// Cells that touch each other, by an edge or a corner.
#[derive(Debug, Clone, PartialEq)]
pub struct Blob {
    /// Their indices, rising.
    pub cells: Vec<usize>,
    /// Sum of their weights.
    pub mass: f64,
    /// Their centre of mass, site coordinates, metres.
    pub centre_m: [f64; 2],
}

/// The groups of at least `cells_min` cells whose weight is at least `weight_min`, heaviest first.
#[must_use]
pub fn blobs(grid: &GridGeometry, weight: &[f64], weight_min: f64, cells_min: usize) -> Vec<Blob> {
    let mut taken: Vec<bool> = weight.iter().map(|&w| w.is_nan() || w < weight_min).collect();
    let mut found = Vec::new();
    for start in 0..grid.cells().min(weight.len()) {
        if taken[start] {
            continue;
        }
        taken[start] = true;
        let (mut cells, mut next) = (vec![start], 0);
        while let Some(&cell) = cells.get(next) {
            next += 1;
            for near in neighbours(grid, cell) {
                if !std::mem::replace(&mut taken[near], true) {
                    cells.push(near);
                }
            }
        }
        if cells.len() >= cells_min {
            cells.sort_unstable();
            found.push(blob(grid, weight, cells));
        }
    }
    found.sort_by(|a, b| b.mass.total_cmp(&a.mass));
    found
}

fn blob(grid: &GridGeometry, weight: &[f64], cells: Vec<usize>) -> Blob {
    let mass: f64 = cells.iter().map(|&cell| weight[cell]).sum();
    let along = |axis: usize| {
        let moment = cells.iter().map(|&cell| weight[cell] * grid.centre_of_index_m(cell)[axis]);
        moment.sum::<f64>() / mass
    };
    Blob { mass, centre_m: [along(0), along(1)], cells }
}

/// The cell itself and the up to eight round it.
pub(crate) fn neighbours(grid: &GridGeometry, cell: usize) -> impl Iterator<Item = usize> + use<> {
    let (columns, rows) = (grid.columns as usize, grid.rows as usize);
    let (column, row) = (cell % columns, cell / columns);
    let around = |at: usize, side: usize| at.saturating_sub(1)..(at + 2).min(side);
    around(row, rows)
        .flat_map(move |row| around(column, columns).map(move |column| row * columns + column))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_that_touch_at_a_corner_are_one_group_and_the_heaviest_comes_first() {
        let grid = GridGeometry { origin_m: [0.0; 2], cell_m: 1.0, columns: 5, rows: 3 };
        #[rustfmt::skip]
        let weight = [
            0.5, 0.0, 0.0, 0.0, 0.3,
            0.0, 0.5, 0.0, 0.0, 0.9,
            0.0, 0.0, 0.0, 0.0, 0.2,
        ];
        let found = blobs(&grid, &weight, 0.3, 2);
        let cells: Vec<_> = found.iter().map(|blob| blob.cells.clone()).collect();
        assert_eq!(cells, [vec![4, 9], vec![0, 6]]);
        assert!((found[0].centre_m[1] - 1.25).abs() < 1e-12 && (found[1].mass - 1.0).abs() < 1e-12);
        assert_eq!(blobs(&grid, &weight, 0.3, 3), []);
        assert_eq!(blobs(&grid, &weight, 0.2, 1)[0].cells, [4, 9, 14]);
    }
}
