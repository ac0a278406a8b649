//! Sums over boxes of cells in constant time: a summed-area table (F. Crow, 1984).

use protocol::geometry::GridGeometry;

/// Sums of a value over any box of cells.
pub(crate) struct BoxSums {
    columns: usize,
    rows: usize,
    /// [row + 1][column + 1]: sum over all cells before that row and column.
    sums: Vec<f64>,
}

impl BoxSums {
    pub(crate) fn new(grid: &GridGeometry, value: impl Fn(usize) -> f64) -> Self {
        let (columns, rows) = (grid.columns as usize, grid.rows as usize);
        let width = columns + 1;
        let mut sums = vec![0.0; width * (rows + 1)];
        for row in 0..rows {
            let mut line = 0.0;
            for column in 0..columns {
                line += value(row * columns + column);
                sums[(row + 1) * width + column + 1] = sums[row * width + column + 1] + line;
            }
        }
        Self { columns, rows, sums }
    }

    /// Sum over the cells at most `reach` columns and rows away from `cell`, itself included.
    pub(crate) fn around(&self, cell: usize, reach: usize) -> f64 {
        let (column, row) = (cell % self.columns, cell / self.columns);
        let (left, right) = (column.saturating_sub(reach), (column + reach + 1).min(self.columns));
        let (low, high) = (row.saturating_sub(reach), (row + reach + 1).min(self.rows));
        let at = |row: usize, column: usize| self.sums[row * (self.columns + 1) + column];
        at(high, right) - at(low, right) - at(high, left) + at(low, left)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_is_the_sum_of_its_cells() {
        let grid = GridGeometry { origin_m: [0.0, 0.0], cell_m: 0.1, columns: 7, rows: 5 };
        let value = |cell: usize| ((cell * 37) % 11) as f64;
        let sums = BoxSums::new(&grid, value);
        for cell in 0..35usize {
            let (column, row) = ((cell % 7) as i32, (cell / 7) as i32);
            let near = |other: &usize| {
                (((other % 7) as i32) - column).abs() <= 2
                    && (((other / 7) as i32) - row).abs() <= 2
            };
            let expected: f64 = (0..35).filter(near).map(value).sum();
            assert_eq!(sums.around(cell, 2), expected, "cell {cell}");
        }
    }
}
