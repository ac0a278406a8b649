//! The wedge of every beam: the cells that it covers, sorted by range. Computed once a laser.

use crate::sensor_model::LaserModel;
use protocol::geometry::GridGeometry;

/// A cell of a wedge. 12 B: a walk along the wedge should meet as few cache lines as can be.
#[derive(Debug, Clone, Copy)]
#[repr(C, packed(4))]
pub(crate) struct WedgeCell {
    pub(crate) rho_m: f64,
    pub(crate) cell: u32,
}

/// Cells by beam, ascending by rho within a beam.
#[derive(Debug, Clone, Default)]
pub(crate) struct WedgeTable {
    cells: Vec<WedgeCell>,
    /// Where the wedge of each beam ends.
    ends: Vec<usize>,
}

impl WedgeTable {
    pub(crate) fn build(grid: &GridGeometry, model: &LaserModel) -> Self {
        let mut pairs: Vec<(u32, WedgeCell)> = Vec::new();
        let mut ends = vec![0; model.beams];
        model.for_each_cell_in_view(grid, |cell, beam, rho_m| {
            ends[beam] += 1;
            pairs.push((beam as u32, WedgeCell { rho_m, cell: cell as u32 }));
        });
        pairs.sort_unstable_by(|(beam_a, a), (beam_b, b)| {
            let (rho_a, rho_b) = (a.rho_m, b.rho_m);
            let cells = (a.cell, b.cell);
            beam_a.cmp(beam_b).then(rho_a.total_cmp(&rho_b)).then(cells.0.cmp(&cells.1))
        });
        let mut end = 0;
        for count in &mut ends {
            end += *count;
            *count = end;
        }
        Self { cells: pairs.iter().map(|pair| pair.1).collect(), ends }
    }

    /// Where the wedge of each beam starts and ends in the table.
    pub(crate) fn bounds(&self) -> impl Iterator<Item = (usize, usize)> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(self.ends.iter().copied())
    }

    #[inline]
    pub(crate) fn wedge(&self, start: usize, end: usize) -> &[WedgeCell] {
        self.cells.get(start..end).unwrap_or(&[])
    }

    /// The cell at a place of the table, 0 behind its end.
    #[inline]
    pub(crate) fn cell_number(&self, place: usize) -> u32 {
        self.cells.get(place).map_or(0, |cell| cell.cell)
    }

    pub(crate) fn bytes(&self) -> usize {
        self.cells.len() * size_of::<WedgeCell>()
    }
}
