//! A collapsed map by class name: how often each cell was what.

use protocol::geometry::GridGeometry;

/// The classes that the claims speak of; ids differ between presets, names do not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Class {
    /// The paper's "1 second".
    Passing,
    /// The paper's "15 second".
    Lingering,
    /// The paper's "60 second".
    Vacated,
    /// All timescales.
    Background,
    /// **Here:** a leg too quick for `passing`.
    Transit,
}

/// All of them.
pub const CLASSES: [Class; 5] =
    [Class::Passing, Class::Lingering, Class::Vacated, Class::Background, Class::Transit];

impl Class {
    /// Its name in the site file.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Passing => "passing",
            Self::Lingering => "lingering",
            Self::Vacated => "vacated",
            Self::Background => "background",
            Self::Transit => "transit",
        }
    }
}

/// Shares of the classes of a collapsed map.
#[derive(Debug, Clone, PartialEq)]
pub struct Shares {
    grid: GridGeometry,
    /// [class][cell], 0 where the cell was never observed or the class is not there.
    shares: [Vec<f64>; 5],
    observed: Vec<bool>,
}

impl Shares {
    /// From exact counts, [class, cell], `names` in id order.
    ///
    /// # Panics
    /// If there are not `names * cells` counts.
    #[must_use]
    pub fn of_counts(grid: GridGeometry, names: &[&str], counts: &[u64]) -> Self {
        let cells = grid.cells();
        assert_eq!(counts.len(), names.len() * cells, "[class, cell]");
        let total = |cell: usize| counts.iter().skip(cell).step_by(cells).sum::<u64>();
        let totals: Vec<u64> = (0..cells).map(total).collect();
        let shares = CLASSES.map(|class| {
            let Some(id) = names.iter().position(|name| *name == class.name()) else {
                return vec![0.0; cells];
            };
            let of_class = &counts[id * cells..(id + 1) * cells];
            of_class.iter().zip(&totals).map(|(&n, &of)| n as f64 / of.max(1) as f64).collect()
        });
        Self { grid, shares, observed: totals.iter().map(|&total| total > 0).collect() }
    }

    /// The grid.
    #[must_use]
    pub fn grid(&self) -> &GridGeometry {
        &self.grid
    }

    /// Shares of a class by cell.
    #[must_use]
    pub fn of(&self, class: Class) -> &[f64] {
        &self.shares[class as usize]
    }

    /// Cells that were classified at least once.
    #[must_use]
    pub fn observed(&self) -> &[bool] {
        &self.observed
    }

    /// Mean of the shares of a class over the observed cells among these; 0 if there are none.
    #[must_use]
    pub fn mean(&self, class: Class, cells: impl Iterator<Item = usize>) -> f64 {
        let (sum, count) = cells
            .filter(|&cell| self.observed[cell])
            .fold((0.0, 0u64), |(sum, count), cell| (sum + self.of(class)[cell], count + 1));
        sum / count.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_found_by_name_whatever_the_order_and_what_is_absent_is_zero() {
        let grid = GridGeometry { origin_m: [0.0; 2], cell_m: 0.1, columns: 2, rows: 1 };
        let shares =
            Shares::of_counts(grid, &["background", "empty", "passing"], &[1, 0, 1, 0, 2, 0]);
        assert_eq!(shares.of(Class::Background), [0.25, 0.0]);
        assert_eq!(shares.of(Class::Passing), [0.5, 0.0]);
        assert_eq!(shares.of(Class::Transit), [0.0, 0.0]);
        assert_eq!(shares.observed(), [true, false]);
        assert_eq!(shares.mean(Class::Passing, 0..2), 0.5, "of the observed cell only");
        assert_eq!(shares.mean(Class::Passing, 1..2), 0.0);
    }
}
