//! Sums over boxes of cells in constant time: a summed-area table (F. Crow, 1984).

use protocol::geometry::GridGeometry;

/// Sums of a value over any box of cells, which are told one after the other.
#[derive(Debug, Clone)]
pub(crate) struct BoxSums {
    columns: usize,
    rows: usize,
    /// [row + 1][column + 1]: sum over all cells before that row and column. Empty before the first.
    sums: Vec<f64>,
    /// The next cell, and the sum of the cells before it in its row.
    row: usize,
    column: usize,
    line: f64,
}

impl BoxSums {
    pub(crate) fn new(grid: &GridGeometry) -> Self {
        let (columns, rows) = (grid.columns as usize, grid.rows as usize);
        Self { columns, rows, sums: Vec::new(), row: 0, column: 0, line: 0.0 }
    }

    /// Begins anew with the first cell.
    pub(crate) fn begin(&mut self) {
        self.sums.resize((self.columns + 1) * (self.rows + 1), 0.0); // once
        (self.row, self.column, self.line) = (0, 0, 0.0);
    }

    /// The value of the next cell, in the order of their indices.
    pub(crate) fn push(&mut self, value: f64) {
        let width = self.columns + 1;
        self.line += value;
        let above = self.row * width + self.column + 1;
        self.sums[above + width] = self.sums[above] + self.line;
        self.column += 1;
        if self.column == self.columns {
            (self.row, self.column, self.line) = (self.row + 1, 0, 0.0);
        }
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
        let value: fn(usize) -> f64 = |cell| ((cell * 37) % 11) as f64;
        let mut sums = BoxSums::new(&grid);
        for other in [(|_| 7.0) as fn(usize) -> f64, value] {
            sums.begin();
            (0..35).for_each(|cell| sums.push(other(cell)));
        }
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
