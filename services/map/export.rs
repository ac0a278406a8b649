//! Maps for other programs: nav2's map_server, NumPy.

use super::grid_file::GridFile;
use super::pictures::totals;
use mapper::npy;
use mapper::results::counts_file;
use std::io;
use std::path::Path;

/// Pixels of map_server's `trinary` mode, as its map_saver writes them.
const OCCUPIED: u8 = 0;
const FREE: u8 = 254;
const UNKNOWN: u8 = 205;

/// Writes a map as `tog replay` does, without its pictures: `counts` of each context, or of none.
///
/// # Errors
/// Those of the file system.
pub fn write_map(
    directory: &Path,
    grid: &GridFile,
    total: &[u64],
    contexts: &[(String, Vec<u64>)],
) -> io::Result<()> {
    std::fs::create_dir_all(directory)?;
    let [_, rows, columns] = grid.shape();
    for (name, counts) in contexts.iter().filter(|_| contexts.len() > 1) {
        npy::write_u64(&directory.join(counts_file(Some(name))), &[rows, columns], counts)?;
    }
    npy::write_u64(&directory.join(counts_file(None)), &[rows, columns], total)?;
    grid.write(directory)
}

/// Writes `shares.npy`, f64 \[class, row, column\]: count / total of the cell, NaN where that is 0.
///
/// # Errors
/// Those of the file system.
pub fn write_shares(directory: &Path, grid: &GridFile, counts: &[u64]) -> io::Result<()> {
    let [_, rows, columns] = grid.shape();
    let totals = totals(counts, rows * columns);
    let share = |(index, count): (usize, &u64)| *count as f64 / totals[index % totals.len()] as f64;
    let shares: Vec<f64> = counts.iter().enumerate().map(share).collect();
    npy::write_f64(&directory.join("shares.npy"), &[rows, columns], &shares)
}

/// Writes `map.pgm` and `map.yaml`: a cell is occupied if `class` holds at least `occupied_min` of its
/// frames, free if it was observed otherwise.
///
/// # Errors
/// Those of the file system.
pub fn write_nav2(
    directory: &Path,
    grid: &GridFile,
    counts: &[u64],
    class: usize,
    occupied_min: f64,
) -> io::Result<()> {
    std::fs::create_dir_all(directory)?;
    std::fs::write(directory.join("map.pgm"), pgm(grid, counts, class, occupied_min))?;
    std::fs::write(directory.join("map.yaml"), yaml(grid))
}

/// A binary PGM, the highest row first.
fn pgm(grid: &GridFile, counts: &[u64], class: usize, occupied_min: f64) -> Vec<u8> {
    let [_, rows, columns] = grid.shape();
    let cells = rows * columns;
    let totals = totals(counts, cells);
    let pixel = |cell: usize| match totals[cell] {
        0 => UNKNOWN,
        total if counts[class * cells + cell] as f64 >= occupied_min * total as f64 => OCCUPIED,
        _ => FREE,
    };
    let mut file =
        format!("P5\n# {}, written by tog\n{columns} {rows}\n255\n", grid.area).into_bytes();
    for row in (0..rows).rev() {
        file.extend((row * columns..(row + 1) * columns).map(pixel));
    }
    file
}

/// `free_thresh` is 0.196 because that is just below the 50/255 of an unknown pixel: with nav2's
/// default of 0.25, what nobody has seen would be loaded as free.
fn yaml(grid: &GridFile) -> String {
    // YAML 1.1 takes a number without a point, or with an exponent alone, for something else.
    let number = |value: f64| match value.to_string() {
        text if text.contains('.') => text,
        text => text + ".0",
    };
    format!(
        "image: map.pgm\nmode: trinary\nresolution: {}\norigin: [{}, {}, 0.0]\nnegate: 0\n\
         occupied_thresh: 0.65\nfree_thresh: 0.196\n",
        number(grid.cell_m),
        number(grid.origin_m[0]),
        number(grid.origin_m[1])
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::tests::grid;

    #[test]
    fn the_highest_row_comes_first_and_what_was_never_seen_is_neither_free_nor_occupied() {
        let grid = grid(3, 2);
        // Two classes of six cells: `empty`, `wall`.
        let counts = [9, 0, 0, 0, 4, 6, /* wall */ 0, 0, 9, 0, 6, 4];
        let file = pgm(&grid, &counts, 1, 0.5);
        let head = b"P5\n# hall, written by tog\n3 2\n255\n";
        assert_eq!(&file[..head.len()], head);
        let upper = [UNKNOWN, OCCUPIED, FREE];
        assert_eq!(file[head.len()..], [upper, [FREE, UNKNOWN, OCCUPIED]].concat());
    }

    #[test]
    fn numbers_are_numbers_for_every_reader_of_yaml() {
        let mut grid = grid(3, 2);
        grid.origin_m = [-12.0, 0.000_01];
        let text = yaml(&grid);
        assert!(text.contains("resolution: 0.1\norigin: [-12.0, 0.00001, 0.0]\n"), "{text}");
    }
}
