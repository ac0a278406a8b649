//! The wedge of every beam: the cells that it covers, sorted by range. Computed once a laser.

use crate::sensor_model::LaserModel;
use protocol::geometry::GridGeometry;

/// Cells by beam, ascending by rho within a beam. 12 B for every pair of cell and beam in view.
#[derive(Debug, Clone, Default)]
pub(crate) struct WedgeTable {
    start: Vec<usize>,
    cell: Vec<u32>,
    rho_m: Vec<f64>,
}

/// The cells of one beam.
#[derive(Clone, Copy)]
pub(crate) struct Wedge<'a> {
    pub(crate) cell: &'a [u32],
    pub(crate) rho_m: &'a [f64],
}

impl WedgeTable {
    pub(crate) fn build(grid: &GridGeometry, model: &LaserModel) -> Self {
        let mut pairs: Vec<(u32, u32, f64)> = Vec::new();
        model.for_each_cell_in_view(grid, |cell, beam, rho_m| {
            pairs.push((beam as u32, cell as u32, rho_m));
        });
        pairs.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.2.total_cmp(&b.2)).then(a.1.cmp(&b.1)));
        let mut start = vec![0; model.beams + 1];
        for (beam, _, _) in &pairs {
            start[*beam as usize + 1] += 1;
        }
        for beam in 0..model.beams {
            start[beam + 1] += start[beam];
        }
        Self {
            start,
            cell: pairs.iter().map(|pair| pair.1).collect(),
            rho_m: pairs.iter().map(|pair| pair.2).collect(),
        }
    }

    pub(crate) fn wedge(&self, beam: usize) -> Wedge<'_> {
        let range = self.start[beam]..self.start[beam + 1];
        Wedge { cell: &self.cell[range.clone()], rho_m: &self.rho_m[range] }
    }

    pub(crate) fn bytes(&self) -> usize {
        self.cell.len() * (size_of::<u32>() + size_of::<f64>())
    }
}
