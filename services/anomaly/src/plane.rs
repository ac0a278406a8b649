//! A bit a cell, and the 8-connected components of set bits.

use protocol::geometry::GridGeometry;

/// One bit a cell, bit i%64 of word i/64 is cell i. Bits behind the last cell stay 0.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Plane {
    words: Vec<u64>,
}

impl Plane {
    pub(crate) fn new(cells: usize) -> Self {
        Self { words: vec![0; cells.div_ceil(64)] }
    }

    pub(crate) fn get(&self, cell: usize) -> bool {
        self.words[cell / 64] >> (cell % 64) & 1 == 1
    }

    pub(crate) fn set(&mut self, cell: usize, value: bool) {
        let bit = 1 << (cell % 64);
        if value {
            self.words[cell / 64] |= bit;
        } else {
            self.words[cell / 64] &= !bit;
        }
    }

    pub(crate) fn clear(&mut self) {
        self.words.fill(0);
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.words.iter().all(|word| *word == 0)
    }

    /// Number of set cells.
    pub(crate) fn count(&self) -> u32 {
        self.words.iter().map(|word| word.count_ones()).sum()
    }

    /// Number of cells that are set here and in `other`.
    pub(crate) fn count_common(&self, other: &Self) -> u32 {
        self.words.iter().zip(&other.words).map(|(a, b)| (a & b).count_ones()).sum()
    }

    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.words.copy_from_slice(&other.words);
    }

    /// Calls `visit` with every set cell, in the order of their indices.
    pub(crate) fn for_each(&self, mut visit: impl FnMut(usize)) {
        for (index, word) in self.words.iter().enumerate() {
            let mut rest = *word;
            while rest != 0 {
                visit(index * 64 + rest.trailing_zeros() as usize);
                rest &= rest - 1;
            }
        }
    }

    /// Calls `visit` with every cell that differs, and its value in `other`.
    pub(crate) fn for_each_difference(&self, other: &Self, mut visit: impl FnMut(usize, bool)) {
        for (index, (word, others)) in self.words.iter().zip(&other.words).enumerate() {
            let mut rest = word ^ others;
            while rest != 0 {
                let bit = rest.trailing_zeros();
                visit(index * 64 + bit as usize, others >> bit & 1 == 1);
                rest &= rest - 1;
            }
        }
    }

    fn first_from(&self, word: usize) -> Option<usize> {
        (word..self.words.len())
            .find(|index| self.words[*index] != 0)
            .map(|index| index * 64 + self.words[index].trailing_zeros() as usize)
    }
}

/// Calls `visit` with each of the up to eight neighbours of a cell.
pub(crate) fn for_each_neighbour(grid: &GridGeometry, cell: usize, mut visit: impl FnMut(usize)) {
    let columns = grid.columns as usize;
    let (column, row) = (cell % columns, cell / columns);
    for r in row.saturating_sub(1)..=(row + 1).min(grid.rows as usize - 1) {
        for c in column.saturating_sub(1)..=(column + 1).min(columns - 1) {
            if r != row || c != column {
                visit(r * columns + c);
            }
        }
    }
}

/// Finds components; keeps its buffers, so that a frame allocates nothing.
#[derive(Debug, Clone)]
pub(crate) struct Flood {
    left: Plane,
    members: Vec<u32>,
}

impl Flood {
    pub(crate) fn new(cells: usize) -> Self {
        Self { left: Plane::new(cells), members: Vec::new() }
    }

    /// Calls `visit` with the cells of each 8-connected component of `plane`, components in the
    /// order of their lowest cell.
    pub(crate) fn components(
        &mut self,
        grid: &GridGeometry,
        plane: &Plane,
        mut visit: impl FnMut(&[u32]),
    ) {
        self.left.copy_from(plane);
        let mut word = 0;
        while let Some(seed) = self.left.first_from(word) {
            word = seed / 64;
            self.members.clear();
            self.members.push(seed as u32);
            self.left.set(seed, false);
            let mut next = 0;
            while next < self.members.len() {
                let cell = self.members[next] as usize;
                next += 1;
                let (left, members) = (&mut self.left, &mut self.members);
                for_each_neighbour(grid, cell, |neighbour| {
                    if left.get(neighbour) {
                        left.set(neighbour, false);
                        members.push(neighbour as u32);
                    }
                });
            }
            visit(&self.members);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn components(picture: &[&str]) -> Vec<usize> {
        let columns = picture[0].len();
        let grid = GridGeometry {
            origin_m: [0.0, 0.0],
            cell_m: 0.1,
            columns: columns as u32,
            rows: picture.len() as u32,
        };
        let mut plane = Plane::new(grid.cells());
        for (row, line) in picture.iter().enumerate() {
            for (column, mark) in line.bytes().enumerate() {
                plane.set(row * columns + column, mark == b'#');
            }
        }
        let mut sizes = Vec::new();
        Flood::new(grid.cells()).components(&grid, &plane, |cells| sizes.push(cells.len()));
        sizes
    }

    #[test]
    fn cells_that_touch_by_a_corner_belong_together_and_rows_do_not_wrap() {
        assert_eq!(components(&["#..#", ".#..", "...#", "#..."]), [2, 1, 1, 1]);
        assert_eq!(components(&["####", "#..#", "####"]), [10]);
        assert_eq!(components(&["....", "...."]), [] as [usize; 0]);
    }
}
