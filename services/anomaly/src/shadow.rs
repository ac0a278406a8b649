//! Is a cell in the shadow of something that stands there now?
//!
//! A wall that somebody stands in front of is not observed any more; its averages sink to one
//! half and it reads as vacated after some seconds. That is no evidence of a missing wall. So a cell
//! that reads "nothing here" counts only if some laser that delivers can look at it.

use protocol::geometry::GridGeometry;
use protocol::site::Laser;

/// What a ray meets in a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Obstacle {
    /// Free, or not known.
    None,
    /// Something that always stands there: a laser never looked through it.
    Permanent,
    /// Something that usually is not there.
    Fresh,
}

/// Cells before the target that are not obstacles: the target's own surface, seen at a slant.
const SURFACE_CELLS: f64 = 2.0;

/// Where the lasers of an area are, in cells.
#[derive(Debug, Clone)]
pub(crate) struct Eyes {
    columns: f64,
    rows: f64,
    at: Vec<[f64; 2]>,
}

impl Eyes {
    pub(crate) fn new(grid: &GridGeometry, lasers: &[Laser]) -> Self {
        let at = lasers
            .iter()
            .map(|laser| {
                [
                    (laser.x_m - grid.origin_m[0]) / grid.cell_m,
                    (laser.y_m - grid.origin_m[1]) / grid.cell_m,
                ]
            })
            .collect();
        Self { columns: f64::from(grid.columns), rows: f64::from(grid.rows), at }
    }

    /// True if no present laser looks at `cell`, and at least one of them would but for something
    /// fresh. An area whose lasers are not known to it has no shadows.
    pub(crate) fn in_shadow(
        &self,
        cell: usize,
        lasers_present: u64,
        obstacle: impl Fn(usize) -> Obstacle,
    ) -> bool {
        let columns = self.columns as usize;
        let target = [(cell % columns) as f64 + 0.5, (cell / columns) as f64 + 0.5];
        let mut fresh = false;
        for (index, eye) in self.at.iter().enumerate() {
            if lasers_present >> index & 1 == 0 {
                continue;
            }
            match self.first_obstacle(*eye, target, &obstacle) {
                Obstacle::None => return false,
                Obstacle::Permanent => {}
                Obstacle::Fresh => fresh = true,
            }
        }
        fresh
    }

    /// Walks from the laser to the target in steps of half a cell.
    fn first_obstacle(
        &self,
        eye: [f64; 2],
        target: [f64; 2],
        obstacle: &impl Fn(usize) -> Obstacle,
    ) -> Obstacle {
        let (dx, dy) = (target[0] - eye[0], target[1] - eye[1]);
        let distance = dx.hypot(dy);
        // An area has at most 4096 cells a side; a laser far outside it walks only so far.
        let steps = ((distance - SURFACE_CELLS) * 2.0).clamp(0.0, 32_768.0) as usize;
        let mut last = usize::MAX;
        for step in 1..=steps {
            let share = step as f64 * 0.5 / distance;
            let (x, y) = (eye[0] + share * dx, eye[1] + share * dy);
            if !(x >= 0.0 && y >= 0.0 && x < self.columns && y < self.rows) {
                continue;
            }
            let cell = y as usize * self.columns as usize + x as usize;
            if cell == last {
                continue;
            }
            last = cell;
            match obstacle(cell) {
                Obstacle::None => {}
                found => return found,
            }
        }
        Obstacle::None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shadowed(picture: &str, present: u64) -> bool {
        let cells: Vec<char> = picture.chars().filter(|mark| *mark != ' ').collect();
        let at = |mark| cells.iter().enumerate().filter(move |(_, c)| **c == mark).map(|(i, _)| i);
        let eyes = Eyes {
            columns: cells.len() as f64,
            rows: 1.0,
            at: at('L').map(|i| [i as f64 + 0.5, 0.5]).collect(),
        };
        let target = at('T').next().expect("a target");
        eyes.in_shadow(target, present, |cell| match cells[cell] {
            'P' => Obstacle::Fresh,
            '#' => Obstacle::Permanent,
            _ => Obstacle::None,
        })
    }

    #[test]
    fn somebody_between_the_only_laser_and_the_wall_casts_a_shadow() {
        assert!(shadowed("L . . . P . . . T", 1));
        assert!(!shadowed("L . . . . . . . T", 1));
        assert!(!shadowed("L . . # . . . . T", 1), "never seen is not shadowed");
        assert!(!shadowed("L . . . . . . P T", 1), "the target's own surface");
    }

    #[test]
    fn a_second_laser_that_looks_from_the_other_side_lifts_the_shadow() {
        assert!(!shadowed("L . . P . T . . . . L", 0b11));
        assert!(shadowed("L . . P . T . . . . L", 0b01), "if it delivers");
        assert!(!shadowed("L . . P . T . . . . L", 0b10));
        assert!(shadowed("L . . P . T . . P . L", 0b11));
    }
}
