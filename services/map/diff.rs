//! What changed from one collapsed map to a later one of the same grid. Pure.
//!
//! The change of a cell is half the sum of |change of share| over its classes: the share of its
//! frames that are of another class than before, 0..=1 (total variation). Only cells that both maps
//! have observed are compared. Cells side by side (eight neighbours) that changed by `change_min` or
//! more, and most towards the same class, are one place.

use super::grid_file::GridFile;
use super::pictures::totals;
use protocol::geometry::GridGeometry;
use serde::Serialize;

/// Most places that are told: more would be read by nobody.
pub const PLACES_MAX: usize = 1000;

/// What changed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// A cell changed if this share of its frames is of another class.
    pub change_min: f64,
    /// Cells that both maps have observed.
    pub cells_in_both: usize,
    /// Cells that only the earlier map has observed.
    pub cells_before_only: usize,
    /// Cells that only the later map has observed.
    pub cells_after_only: usize,
    /// Cells in both that changed.
    pub cells_changed: usize,
    /// Each class, in the order of the ids.
    pub classes: Vec<ClassChange>,
    /// Where, largest change first; at most [`PLACES_MAX`].
    pub places: Vec<Place>,
    /// All places, also those that are not told.
    pub places_found: usize,
}

/// What changed of one class.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClassChange {
    /// Its name.
    pub name: String,
    /// Mean share over the cells in both maps, 0..=1.
    pub share_before: f64,
    /// The same in the later map.
    pub share_after: f64,
    /// Cells whose share rose by `change_min` or more.
    pub cells_more: usize,
    /// Cells whose share fell by `change_min` or more.
    pub cells_less: usize,
    /// The cell whose share rose most.
    pub largest_rise: Option<CellChange>,
    /// The cell whose share fell most.
    pub largest_fall: Option<CellChange>,
}

/// A share in one cell.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CellChange {
    /// Centre of the cell.
    pub x_m: f64,
    /// Centre of the cell.
    pub y_m: f64,
    /// Share in the earlier map, 0..=1.
    pub before: f64,
    /// Share in the later map, 0..=1.
    pub after: f64,
}

/// Cells side by side that changed towards the same class.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Place {
    /// In words.
    pub text: String,
    /// The class that lost most.
    pub from: String,
    /// The class that gained most.
    pub to: String,
    /// Number of cells.
    pub cells: usize,
    /// Their area.
    pub area_m2: f64,
    /// Mean of the cells' centres.
    pub x_m: f64,
    /// Mean of the cells' centres.
    pub y_m: f64,
    /// Lower left corner of the box round them, metres.
    pub min_m: [f64; 2],
    /// Upper right corner of the box round them, metres.
    pub max_m: [f64; 2],
    /// Mean share of `to` before, 0..=1.
    pub share_before: f64,
    /// Mean share of `to` after, 0..=1.
    pub share_after: f64,
    /// Mean change of the cells, 0..=1.
    pub change: f64,
}

/// The two maps, cell by cell.
struct Pair<'m> {
    grid: &'m GridFile,
    cells: usize,
    counts: [&'m [u64]; 2],
    totals: [Vec<u64>; 2],
}

/// A cell that changed.
#[derive(Clone, Copy)]
struct Changed {
    from: usize,
    to: usize,
    change: f64,
}

/// Compares two maps of one grid: counts \[class, row, column\] of both.
pub fn compare(grid: &GridFile, before: &[u64], after: &[u64], change_min: f64) -> Difference {
    let cells = grid.geometry().cells();
    let totals = [totals(before, cells), totals(after, cells)];
    let pair = Pair { grid, cells, counts: [before, after], totals };
    let seen = |map: usize, cell: usize| pair.totals[map][cell] > 0;
    let count_only =
        |map: usize| (0..cells).filter(|cell| seen(map, *cell) && !seen(1 - map, *cell)).count();
    let both: Vec<usize> = (0..cells).filter(|cell| seen(0, *cell) && seen(1, *cell)).collect();
    let mut changed = vec![None; cells];
    for cell in &both {
        changed[*cell] = pair.changed(*cell).filter(|changed| changed.change >= change_min);
    }
    let mut places = places(&pair, &changed);
    let places_found = places.len();
    places.truncate(PLACES_MAX);
    Difference {
        change_min,
        cells_in_both: both.len(),
        cells_before_only: count_only(0),
        cells_after_only: count_only(1),
        cells_changed: changed.iter().flatten().count(),
        classes: (0..grid.classes.len()).map(|c| pair.class(c, &both, change_min)).collect(),
        places,
        places_found,
    }
}

impl Pair<'_> {
    fn share(&self, map: usize, class: usize, cell: usize) -> f64 {
        self.counts[map][class * self.cells + cell] as f64 / self.totals[map][cell].max(1) as f64
    }

    fn rise(&self, class: usize, cell: usize) -> f64 {
        self.share(1, class, cell) - self.share(0, class, cell)
    }

    /// How a cell changed; `None` if it has no class.
    fn changed(&self, cell: usize) -> Option<Changed> {
        let rises = (0..self.grid.classes.len()).map(|class| (class, self.rise(class, cell)));
        let (to, _) = rises.clone().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let (from, _) = rises.clone().min_by(|a, b| a.1.total_cmp(&b.1))?;
        let change = rises.map(|(_, rise)| rise.abs()).sum::<f64>() / 2.0;
        Some(Changed { from, to, change })
    }

    fn class(&self, class: usize, both: &[usize], change_min: f64) -> ClassChange {
        let mean = |map: usize| {
            let shares = both.iter().map(|cell| self.share(map, class, *cell));
            let sum = shares.fold(0.0, |sum, share| sum + share); // `sum` of none is -0
            sum / both.len().max(1) as f64
        };
        let rise = |cell: &usize| self.rise(class, *cell);
        let at = |cell: usize| {
            let [x_m, y_m] = self.grid.geometry().centre_of_index_m(cell);
            let (before, after) = (self.share(0, class, cell), self.share(1, class, cell));
            CellChange { x_m, y_m, before, after }
        };
        let most = both.iter().copied().max_by(|a, b| rise(a).total_cmp(&rise(b)));
        let least = both.iter().copied().min_by(|a, b| rise(a).total_cmp(&rise(b)));
        ClassChange {
            name: self.grid.classes[class].name.clone(),
            share_before: mean(0),
            share_after: mean(1),
            cells_more: both.iter().filter(|cell| rise(cell) >= change_min).count(),
            cells_less: both.iter().filter(|cell| -rise(cell) >= change_min).count(),
            largest_rise: most.filter(|cell| rise(cell) > 0.0).map(at),
            largest_fall: least.filter(|cell| rise(cell) < 0.0).map(at),
        }
    }

    /// What a place is, from its cells.
    fn place(&self, cells: &[usize], changed: &[Option<Changed>], to: usize) -> Place {
        let geometry = self.grid.geometry();
        let (mut sum, mut min, mut max) = ([0.0; 2], [f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut lost = vec![0.0; self.grid.classes.len()];
        for cell in cells {
            let centre = geometry.centre_of_index_m(*cell);
            for axis in 0..2 {
                sum[axis] += centre[axis];
                min[axis] = min[axis].min(centre[axis] - geometry.cell_m / 2.0);
                max[axis] = max[axis].max(centre[axis] + geometry.cell_m / 2.0);
            }
            if let Some(changed) = changed[*cell] {
                lost[changed.from] += changed.change;
            }
        }
        let count = cells.len() as f64;
        let mean = |value: &dyn Fn(usize) -> f64| {
            cells.iter().map(|cell| value(*cell)).sum::<f64>() / count
        };
        let most = lost.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
        let from = most.map_or(0, |(class, _)| class);
        let name = |class: usize| self.grid.classes[class].name.clone();
        let mut place = Place {
            text: String::new(),
            from: name(from),
            to: name(to),
            cells: cells.len(),
            area_m2: count * geometry.cell_m * geometry.cell_m,
            x_m: sum[0] / count,
            y_m: sum[1] / count,
            min_m: min,
            max_m: max,
            share_before: mean(&|cell| self.share(0, to, cell)),
            share_after: mean(&|cell| self.share(1, to, cell)),
            change: mean(&|cell| changed[cell].map_or(0.0, |changed| changed.change)),
        };
        place.text = self.words(from, to, &place);
        place
    }

    fn words(&self, from: usize, to: usize, place: &Place) -> String {
        let solid = self.grid.class_of_always(1.0);
        let what = if solid == Some(to) {
            "something solid appeared".to_owned()
        } else if solid == Some(from) {
            "something solid is gone".to_owned()
        } else {
            format!("more often `{}`", place.to)
        };
        format!(
            "{what} at ({:.1}, {:.1}) m, {:.1} x {:.1} m: `{}` {:.0} % -> {:.0} %, instead of `{}`",
            place.x_m,
            place.y_m,
            place.max_m[0] - place.min_m[0],
            place.max_m[1] - place.min_m[1],
            place.to,
            place.share_before * 100.0,
            place.share_after * 100.0,
            place.from,
        )
    }
}

/// Places of the changed cells, the one with the largest sum of changes first.
fn places(pair: &Pair<'_>, changed: &[Option<Changed>]) -> Vec<Place> {
    let geometry = pair.grid.geometry();
    let mut taken = vec![false; changed.len()];
    let mut places = Vec::new();
    for (start, seed) in changed.iter().enumerate() {
        let Some(seed) = seed.filter(|_| !taken[start]) else { continue };
        taken[start] = true;
        let (mut cells, mut next) = (vec![start], 0);
        while let Some(&cell) = cells.get(next) {
            next += 1;
            for neighbour in neighbours(&geometry, cell) {
                let same = changed[neighbour].is_some_and(|changed| changed.to == seed.to);
                if same && !std::mem::replace(&mut taken[neighbour], true) {
                    cells.push(neighbour);
                }
            }
        }
        places.push(pair.place(&cells, changed, seed.to));
    }
    let weight = |place: &Place| place.change * place.cells as f64;
    places.sort_by(|a, b| weight(b).total_cmp(&weight(a)));
    places
}

/// The up to eight cells round a cell.
fn neighbours(grid: &GridGeometry, cell: usize) -> impl Iterator<Item = usize> + use<> {
    let (columns, rows) = (grid.columns as usize, grid.rows as usize);
    let (column, row) = (cell % columns, cell / columns);
    let rows = row.saturating_sub(1)..(row + 2).min(rows);
    let near = column.saturating_sub(1)..(column + 2).min(columns);
    rows.flat_map(move |row| near.clone().map(move |column| row * columns + column))
        .filter(move |other| *other != cell)
}
