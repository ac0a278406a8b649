//! Doors: found from the counts, watched with a clock.
//!
//! A leaf that is shut reads as fixed; while it is open for less than half of the longest timescale
//! its place reads as vacated (semantics.md). So a door is a component of at least [`CELLS_MIN`] cells
//! in which both are strong. That a door is open is normal; that it stays open is not.

use crate::normal::Stock;
use crate::place::{Bounds, bounds_of};
use crate::plane::{Flood, Plane, for_each_neighbour};
use crate::role::{Role, Roles};
use protocol::geometry::GridGeometry;

const CELLS_MIN: usize = 3;
const JOIN_CELLS: usize = 1;
/// Shares of the known time from which a class is strong in a door. A busy street door is shut for a
/// fifth of the time only; a wall in the shadow of people who stand and talk reads vacated for 2 to 4 %.
const FIXED_SHARE_MIN: f64 = 0.15;
const VACATED_SHARE_MIN: f64 = 0.06;
/// Share of a door's cells that show nothing, from which it is open, and below which it is shut.
const OPEN_SHARE: f64 = 0.6;
const SHUT_SHARE: f64 = 0.3;
/// Longest door that is believed, metres: beyond, it is a wall in the shadow of a queue.
const LENGTH_MAX_M: f64 = 6.0;

/// A door and whether it is open.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Door {
    pub(crate) cells: Vec<u32>,
    pub(crate) bounds: Bounds,
    /// Since which stamp it is open.
    pub(crate) open_since_ns: Option<u64>,
    /// Number of the event that it is held open.
    pub(crate) event: Option<u64>,
}

impl Door {
    /// Takes what its cells show: how many show something, how many nothing, of those that can be
    /// seen. `Some(open)`, or `None` if too little is seen to tell: then it stays what it was.
    pub(crate) fn observe(&mut self, present: usize, absent: usize, stamp_ns: u64) -> Option<bool> {
        let seen = present + absent;
        if 2 * seen < self.cells.len() {
            return None;
        }
        let share = absent as f64 / seen as f64;
        if share >= OPEN_SHARE {
            self.open_since_ns.get_or_insert(stamp_ns);
        } else if share <= SHUT_SHARE {
            self.open_since_ns = None;
        }
        Some(self.open_since_ns.is_some())
    }

    pub(crate) fn centre_m(&self) -> [f64; 2] {
        let [x0, y0, x1, y1] = self.bounds;
        [(x0 + x1) / 2.0, (y0 + y1) / 2.0]
    }
}

/// Whether a cell with this past may be of a door.
pub(crate) fn is_like(stock: &Stock, roles: &Roles) -> bool {
    let (mut fixed, mut vacated) = (0, 0);
    for (slot, seen) in stock.seen.iter().enumerate().take(roles.classes()) {
        match roles.role(slot as u8) {
            Role::Fixed => fixed += seen,
            Role::Vacated => vacated += seen,
            _ => {}
        }
    }
    let known = stock.known as f64;
    known > 0.0
        && fixed as f64 >= FIXED_SHARE_MIN * known
        && vacated as f64 >= VACATED_SHARE_MIN * known
}

/// Doors among the cells that may be of one, in the order of their lowest cells; marks their cells in
/// `plane`.
pub(crate) fn find(grid: &GridGeometry, like: &Plane, plane: &mut Plane) -> Vec<Door> {
    plane.copy_from(like);
    // The leaf of a door is seen in pieces: those within two cells of each other are one.
    let mut joined = plane.clone();
    for _ in 0..JOIN_CELLS {
        let narrow = joined.clone();
        narrow.for_each(|cell| for_each_neighbour(grid, cell, |near| joined.set(near, true)));
    }
    let mut doors = Vec::new();
    let columns = grid.columns;
    Flood::new(grid.cells()).components(grid, &joined, |members| {
        let members: Vec<u32> =
            members.iter().copied().filter(|cell| plane.get(*cell as usize)).collect();
        let mut span = [u32::MAX, u32::MAX, 0, 0];
        for (column, row) in members.iter().map(|cell| (cell % columns, cell / columns)) {
            span = [span[0].min(column), span[1].min(row), span[2].max(column), span[3].max(row)];
        }
        let bounds = bounds_of(grid, span);
        let length_m = (bounds[2] - bounds[0]).hypot(bounds[3] - bounds[1]);
        if members.len() >= CELLS_MIN && length_m <= LENGTH_MAX_M {
            let mut cells = members;
            cells.sort_unstable();
            doors.push(Door { cells, bounds, open_since_ns: None, event: None });
        } else {
            members.iter().for_each(|cell| plane.set(*cell as usize, false));
        }
    });
    doors
}

/// True if a region lies within the swing of a door that is open: its leaf, or who holds it. That the
/// door stays open is told by the door's own clock.
pub(crate) fn explains(doors: &[Door], region: Bounds, cell_m: f64) -> bool {
    doors.iter().filter(|door| door.open_since_ns.is_some()).any(|door| {
        let [x0, y0, x1, y1] = door.bounds;
        let swing_m = (x1 - x0).hypot(y1 - y0) + cell_m;
        region[0] >= x0 - swing_m
            && region[1] >= y0 - swing_m
            && region[2] <= x1 + swing_m
            && region[3] <= y1 + swing_m
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::normal::Normal;

    #[test]
    fn a_leaf_that_opens_now_and_then_is_a_door_and_a_wall_is_not() {
        let grid = GridGeometry { origin_m: [0.0, 0.0], cell_m: 0.1, columns: 8, rows: 3 };
        let area: protocol::site::Area = crate::testing::area(8, 3);
        let roles = Roles::of(&area);
        let mut normal = Normal::new(grid, 0.1, roles.classes(), 1);
        for minute in 0..20 {
            for column in 0..8 {
                let open = (2..6).contains(&column) && minute % 4 == 0;
                normal.change(8 + column, if open { 3 } else { 4 });
            }
            (0..600).for_each(|_| normal.tick());
        }
        let mut plane = Plane::new(grid.cells());
        let mut like = Plane::new(grid.cells());
        (0..grid.cells()).for_each(|cell| like.set(cell, is_like(&normal.stock(cell), &roles)));
        let doors = find(&grid, &like, &mut plane);
        assert_eq!(doors.len(), 1);
        assert_eq!(doors[0].cells, [10, 11, 12, 13]);
        assert!(plane.get(10) && !plane.get(9));
    }

    #[test]
    fn a_door_half_open_stays_what_it_was() {
        let mut door =
            Door { cells: vec![1, 2, 3, 4], bounds: [0.0; 4], open_since_ns: None, event: None };
        assert_eq!(door.observe(2, 2, 1), Some(false));
        assert_eq!(door.observe(1, 3, 2), Some(true));
        assert_eq!(door.observe(2, 2, 3), Some(true));
        assert_eq!(door.observe(1, 0, 4), None, "too little is seen to tell");
        assert_eq!(door.open_since_ns, Some(2));
        assert_eq!(door.observe(4, 0, 5), Some(false));
    }
}
