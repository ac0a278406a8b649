//! Truth on the grid: where surfaces are, and where people set their feet.

use crate::blobs::neighbours;
use protocol::geometry::GridGeometry;
use scene::{LaserSpec, Truth, World};
use std::collections::BTreeMap;

/// Bearing from ray to ray when surfaces are looked for, degrees: 7 mm at 8 m.
const FINE_DEG: f64 = 0.05;

/// What really is in the cells of a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Ground {
    grid: GridGeometry,
    /// Cells with a piece of surface that some laser can see.
    surface: Vec<bool>,
}

impl Ground {
    /// Looks at the world as it is at `t_s` from every laser along very fine, exact rays.
    #[must_use]
    pub fn seen(world: &mut World, t_s: f64) -> Self {
        let grid = world.scene().area.grid();
        let mut surface = vec![false; grid.cells()];
        let mut ranges_m = Vec::new();
        for laser in world.scene().lasers.clone() {
            let turn_deg = f64::from(laser.beams - 1) * laser.angle_increment_deg;
            let fine = LaserSpec {
                angle_increment_deg: FINE_DEG.copysign(turn_deg),
                beams: (turn_deg.abs() / FINE_DEG) as u32 + 1,
                ..laser
            };
            let (pose, geometry) = (fine.pose(), fine.geometry());
            world.true_ranges(&fine, t_s, &mut ranges_m);
            for (beam, &range_m) in ranges_m.iter().enumerate() {
                let (sin, cos) = (pose.yaw_rad + geometry.bearing_rad(beam)).sin_cos();
                if range_m < fine.range_max_m
                    && let Some((column, row)) =
                        grid.cell_at(pose.x_m + range_m * cos, pose.y_m + range_m * sin)
                {
                    surface[grid.index(column, row)] = true;
                }
            }
        }
        Self { grid, surface }
    }

    /// Of cells by index.
    #[must_use]
    pub fn of_cells(grid: GridGeometry, surface: Vec<bool>) -> Self {
        Self { grid, surface }
    }

    /// Cells with a piece of visible surface.
    #[must_use]
    pub fn surface(&self) -> &[bool] {
        &self.surface
    }

    /// The grid.
    #[must_use]
    pub fn grid(&self) -> &GridGeometry {
        &self.grid
    }
}

/// Of the cells of `of`, the share with one of `near` among the cell itself and its eight neighbours:
/// within one cell. 1 if there are none.
pub(crate) fn share_near(grid: &GridGeometry, of: &[bool], near: &[bool]) -> f64 {
    let cells = || (0..grid.cells()).filter(|&cell| of[cell]);
    let count = cells().count();
    let hits = cells().filter(|&cell| neighbours(grid, cell).any(|other| near[other])).count();
    if count == 0 { 1.0 } else { hits as f64 / count as f64 }
}

/// How often the legs of each group of people covered each cell.
#[derive(Debug, Clone, PartialEq)]
pub struct Footprints {
    grid: GridGeometry,
    samples: u64,
    /// By route, loop or wander group: instants at which a leg of it reached into the cell.
    covered: BTreeMap<String, Vec<u64>>,
}

impl Footprints {
    /// Nobody yet.
    #[must_use]
    pub fn new(grid: GridGeometry) -> Self {
        Self { grid, samples: 0, covered: BTreeMap::new() }
    }

    /// Adds an instant.
    pub fn add(&mut self, truth: &Truth) {
        self.samples += 1;
        for person in &truth.people {
            if !self.covered.contains_key(&person.origin) {
                self.covered.insert(person.origin.clone(), vec![0; self.grid.cells()]);
            }
            let Some(covered) = self.covered.get_mut(&person.origin) else { continue };
            for leg in person.legs_m {
                cover(&self.grid, leg, covered);
            }
        }
    }

    /// Cells that a leg of the group covered in at least `share_min` of the instants.
    #[must_use]
    pub fn path(&self, group: &str, share_min: f64) -> Vec<bool> {
        let least = (share_min * self.samples as f64).max(1.0);
        match self.covered.get(group) {
            Some(covered) => covered.iter().map(|&count| count as f64 >= least).collect(),
            None => vec![false; self.grid.cells()],
        }
    }

    /// Cells that a leg of anybody ever covered.
    #[must_use]
    pub fn anybody(&self) -> Vec<bool> {
        let mut all = vec![false; self.grid.cells()];
        for covered in self.covered.values() {
            all.iter_mut().zip(covered).for_each(|(any, &count)| *any |= count > 0);
        }
        all
    }
}

/// Counts the cells that a disc [x, y, radius] reaches into.
fn cover(grid: &GridGeometry, [x, y, radius_m]: [f64; 3], covered: &mut [u64]) {
    let index = |at_m: f64, axis: usize| ((at_m - grid.origin_m[axis]) / grid.cell_m).floor();
    let range = |at_m: f64, axis: usize, side: u32| {
        let low = index(at_m - radius_m, axis).max(0.0) as u32;
        let high = index(at_m + radius_m, axis).min(f64::from(side) - 1.0);
        if high < 0.0 { low..low } else { low..high as u32 + 1 }
    };
    for row in range(y, 1, grid.rows) {
        for column in range(x, 0, grid.columns) {
            let [cx, cy] = grid.centre_m(column, row);
            let beyond = |at: f64, centre: f64| ((at - centre).abs() - grid.cell_m / 2.0).max(0.0);
            if beyond(x, cx).hypot(beyond(y, cy)) < radius_m {
                covered[grid.index(column, row)] += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use scene::PersonTruth;

    const GRID: GridGeometry =
        GridGeometry { origin_m: [0.0; 2], cell_m: 0.1, columns: 4, rows: 3 };

    #[test]
    fn a_leg_covers_the_cells_that_it_reaches_into() {
        let mut covered = vec![0; 12];
        cover(&GRID, [0.15, 0.15, 0.06], &mut covered);
        assert_eq!(covered, [0, 1, 0, 0, 1, 1, 1, 0, 0, 1, 0, 0], "a cross: corners are 7 cm away");
        cover(&GRID, [-5.0, 0.1, 0.06], &mut covered);
        cover(&GRID, [0.1, 99.0, 0.06], &mut covered);
        assert_eq!(covered.iter().sum::<u64>(), 5);
    }

    #[test]
    fn a_path_is_what_was_covered_often_enough_by_that_group() {
        let person = PersonTruth {
            id: 1,
            origin: "loop".into(),
            x_m: 0.0,
            y_m: 0.0,
            heading_rad: 0.0,
            speed_m_s: 0.0,
            legs_m: [[0.05, 0.05, 0.01], [0.35, 0.25, 0.01]],
        };
        let mut prints = Footprints::new(GRID);
        let truth = |people| Truth { t_s: 0.0, people, doors: Vec::new(), objects: Vec::new() };
        prints.add(&truth(vec![person]));
        (0..9).for_each(|_| prints.add(&truth(Vec::new())));
        let path = prints.path("loop", 0.1);
        assert_eq!((path.iter().filter(|&&on| on).count(), path[0], path[11]), (2, true, true));
        assert!(!prints.path("loop", 0.11).contains(&true));
        assert!(!prints.path("others", 0.0).contains(&true));
        assert_eq!(prints.anybody(), path);
    }

    #[test]
    fn near_is_the_cell_itself_or_one_of_its_eight_neighbours() {
        let at = |cells: &[usize]| (0..12).map(|i| cells.contains(&i)).collect::<Vec<_>>();
        assert_eq!(share_near(&GRID, &at(&[0, 3, 11]), &at(&[5])), 1.0 / 3.0);
        assert_eq!(share_near(&GRID, &at(&[]), &at(&[5])), 1.0);
        assert_eq!(share_near(&GRID, &at(&[4]), &at(&[])), 0.0);
    }
}
