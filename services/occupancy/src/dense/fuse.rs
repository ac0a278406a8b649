//! Fusion of every cell of every laser, every frame (Eq. 6, and 3.3: hit > miss > unknown).

use crate::sensor_model::{BeamReading, LaserModel};
use protocol::frame::Evidence;
use protocol::geometry::GridGeometry;

/// Dense fusion of one area.
#[derive(Debug, Clone)]
pub struct Fuser {
    frame: Vec<u8>,
    lasers: Vec<Laser>,
}

#[derive(Debug, Clone)]
struct Laser {
    model: LaserModel,
    /// Every cell in view with its beam and range, cells ascending.
    cell: Vec<u32>,
    beam: Vec<u32>,
    rho_m: Vec<f64>,
    readings: Vec<BeamReading>,
}

impl Fuser {
    /// Fusion of these lasers; their order is the order of the scans.
    #[must_use]
    pub fn new(grid: &GridGeometry, models: &[LaserModel]) -> Self {
        let lasers = models.iter().map(|model| Laser::new(grid, *model)).collect();
        Self { frame: vec![0; grid.cells()], lasers }
    }

    /// The frame of these scans: `scans[i]` holds the raw ranges (metres) of laser i, `None` if it
    /// is absent. Returns `Evidence as u8` per cell, [row, column].
    pub fn fuse(&mut self, scans: &[Option<&[f32]>]) -> &[u8] {
        self.frame.fill(Evidence::Unknown as u8);
        for (laser, scan) in self.lasers.iter_mut().zip(scans) {
            if let Some(ranges_m) = scan {
                laser.paint(ranges_m, &mut self.frame);
            }
        }
        &self.frame
    }
}

impl Laser {
    fn new(grid: &GridGeometry, model: LaserModel) -> Self {
        let (mut cells, mut beams, mut ranges) = (Vec::new(), Vec::new(), Vec::new());
        model.for_each_cell_in_view(grid, |cell, beam, rho_m| {
            cells.push(cell as u32);
            beams.push(beam as u32);
            ranges.push(rho_m);
        });
        let readings = vec![model.interpret(f32::NAN); model.beams];
        Self { model, cell: cells, beam: beams, rho_m: ranges, readings }
    }

    fn paint(&mut self, ranges_m: &[f32], frame: &mut [u8]) {
        let dr = self.model.range_tolerance_m;
        for (reading, &range_m) in self.readings.iter_mut().zip(ranges_m) {
            *reading = self.model.interpret(range_m);
        }
        for ((&cell, &beam), &rho_m) in self.cell.iter().zip(&self.beam).zip(&self.rho_m) {
            let reading = &self.readings[beam as usize];
            // Evidence::{Miss, Hit} as numbers, without a branch.
            let hit = 2 * u8::from(reading.hits(rho_m, dr));
            let evidence = hit.max(u8::from(reading.misses(rho_m)));
            let fused = &mut frame[cell as usize];
            *fused = evidence.max(*fused);
        }
    }
}
