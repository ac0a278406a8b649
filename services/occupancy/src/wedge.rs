//! The wedge of every beam: the cells that it covers, sorted by range, with the readings at which
//! they change. Computed once a laser.
//!
//! Every comparison of the sensor model is monotone in the reading, also after rounding: so there is
//! a least f32 from which it holds, and comparing with that is the same, bit for bit.

use crate::sensor_model::{BeamReading, LaserModel};
use protocol::geometry::GridGeometry;

/// Cells that may be read behind the end of a wedge, so that a few can be taken without counting.
pub(crate) const FEW: usize = 4;

/// Cells by beam, ascending by rho within a beam.
#[derive(Debug, Clone, Default)]
pub(crate) struct WedgeTable {
    /// Cell numbers, and [`FEW`] more.
    cells: Vec<u32>,
    /// Per cell: the least echo from which it is a hit.
    hit_from_m: Vec<f32>,
    /// The least echo from which it is a miss.
    miss_from_m: Vec<f32>,
    /// The least echo from which it is no hit any more; empty where that is `miss_from_m`: nearly
    /// always, an echo exactly dr behind a cell's centre must be an f32 for the two to differ.
    hit_until_m: Vec<f32>,
    /// Where the wedge of each beam ends.
    ends: Vec<usize>,
    /// Per beam: the cells that "no return" says to be free.
    free_cells: Vec<u32>,
}

/// One wedge.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wedge<'a> {
    pub(crate) hit_from_m: &'a [f32],
    pub(crate) miss_from_m: &'a [f32],
    /// As `miss_from_m` where the two are the same.
    pub(crate) hit_until_m: Option<&'a [f32]>,
}

impl WedgeTable {
    pub(crate) fn build(grid: &GridGeometry, model: &LaserModel) -> Self {
        let mut pairs: Vec<(u32, u32, f64)> = Vec::new();
        let mut ends = vec![0; model.beams];
        model.for_each_cell_in_view(grid, |cell, beam, rho_m| {
            ends[beam] += 1;
            pairs.push((beam as u32, cell as u32, rho_m));
        });
        pairs.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.2.total_cmp(&b.2)).then(a.1.cmp(&b.1)));
        let mut end = 0;
        for count in &mut ends {
            end += *count;
            *count = end;
        }
        let mut table = Self { ends, free_cells: vec![0; model.beams], ..Self::default() };
        let dr = model.range_tolerance_m;
        let no_return = model.interpret(f32::INFINITY);
        for &(beam, cell, rho_m) in &pairs {
            table.free_cells[beam as usize] += u32::from(no_return.misses(rho_m));
            table.cells.push(cell);
            // The sensor model's own comparisons, |rho - r| < dr split at its two ends.
            table.hit_from_m.push(least(rho_m - dr, |r| rho_m - r < dr));
            table.hit_until_m.push(least(rho_m + dr, |r| rho_m - r <= -dr));
            let misses = |r| BeamReading { echo_m: r, miss_below_m: r - dr }.misses(rho_m);
            table.miss_from_m.push(least(rho_m + dr, misses));
        }
        table.cells.extend([0; FEW]);
        if table.hit_until_m == table.miss_from_m {
            table.hit_until_m = Vec::new();
        }
        table
    }

    /// Where the wedge of each beam starts and ends in the table, and how many of its cells "no
    /// return" says to be free.
    pub(crate) fn bounds(&self) -> impl Iterator<Item = (usize, usize, u32)> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        let bounds = starts.zip(self.ends.iter().copied()).zip(&self.free_cells);
        bounds.map(|((start, end), free)| (start, end, *free))
    }

    #[inline]
    pub(crate) fn wedge(&self, start: usize, end: usize) -> Wedge<'_> {
        Wedge {
            hit_from_m: self.hit_from_m.get(start..end).unwrap_or(&[]),
            miss_from_m: self.miss_from_m.get(start..end).unwrap_or(&[]),
            hit_until_m: self.hit_until_m.get(start..end).filter(|wedge| !wedge.is_empty()),
        }
    }

    /// Cells at some places of the table.
    #[inline]
    pub(crate) fn cells(&self, start: usize, end: usize) -> &[u32] {
        self.cells.get(start..end).unwrap_or(&[])
    }

    /// The first of some cells of the table, and what lies behind them.
    #[inline]
    pub(crate) fn few_cells(&self, start: usize) -> [u32; FEW] {
        self.cells.get(start..).and_then(<[u32]>::first_chunk).copied().unwrap_or_default()
    }

    /// Reads what a beam with these marks needs of the table.
    #[inline]
    pub(crate) fn touch(&self, start: usize, miss_end: u32, hit_end: u32) -> u32 {
        let (miss, hit) = (start + miss_end as usize, start + hit_end as usize);
        let bits = |limits_m: &[f32], place: usize| limits_m.get(place).map_or(0, |m| m.to_bits());
        bits(&self.miss_from_m, miss)
            ^ bits(&self.hit_from_m, hit)
            ^ self.cells.get(miss).unwrap_or(&0)
            ^ self.cells.get(hit).unwrap_or(&0)
    }

    /// Adds to `beams`, per cell of the grid, how many beams cover it.
    pub(crate) fn count_beams(&self, beams: &mut [u32]) {
        for &cell in self.cells.get(..self.hit_from_m.len()).unwrap_or(&[]) {
            if let Some(count) = beams.get_mut(cell as usize) {
                *count += 1;
            }
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        let ranges = self.hit_from_m.len() + self.miss_from_m.len() + self.hit_until_m.len();
        self.cells.len() * size_of::<u32>() + ranges * size_of::<f32>()
    }
}

/// The least f32 not below 0 for which `holds` is true, which is monotone; about `estimate`.
/// +inf if there is none.
fn least(estimate: f64, holds: impl Fn(f64) -> bool) -> f32 {
    let near = estimate.max(0.0) as f32;
    for reading_m in [near.next_down(), near, near.next_up()] {
        let before = reading_m.next_down();
        if before >= 0.0 && holds(f64::from(reading_m)) && !holds(f64::from(before)) {
            return reading_m;
        }
    }
    // Near 0 the floats are denser than the rounding of the comparison. As bits they are in order.
    let (mut low, mut high) = (0, f32::INFINITY.to_bits());
    while low < high {
        let middle = low + (high - low) / 2;
        if holds(f64::from(f32::from_bits(middle))) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    f32::from_bits(low)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_reading_is_found_wherever_it_lies() {
        for limit in [0.0, 1e-40, 1e-18, 0.049_999_999, 0.05, 1.0, 7.123, 1e9] {
            for estimate in [limit, limit + 1e-7, limit * 1.5, 0.0] {
                let found = least(estimate, |r| r >= limit);
                assert!(f64::from(found) >= limit, "{limit} from {estimate}: {found}");
                assert!(found == 0.0 || f64::from(found.next_down()) < limit, "{limit}: {found}");
                let above = least(estimate, |r| r > limit);
                assert!(f64::from(above) > limit && f64::from(above.next_down()) <= limit);
            }
        }
        assert_eq!(least(1.0, |_| false), f32::INFINITY);
    }
}
