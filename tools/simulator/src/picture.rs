//! A scene at an instant, in characters: `#` an echo, `o` a leg that is really there, `+` an echo
//! on a leg, `D` a leaf of a door, `L` a laser, `.` seen to be free, blank not seen. y grows
//! upwards.

use protocol::geometry::GridGeometry;
use scene::World;

/// Draws the area of the scene with characters of `cell_m` width and twice the height, at most 300
/// wide.
#[must_use]
pub fn look(world: &mut World, t_s: f64, cell_m: f64) -> String {
    let grid = world.scene().area.grid();
    let width_m = f64::from(grid.columns) * grid.cell_m;
    let height_m = f64::from(grid.rows) * grid.cell_m;
    let cell_m = if cell_m.is_finite() { cell_m.max(width_m / 300.0) } else { 0.1 };
    let (columns, rows) = ((width_m / cell_m).ceil(), (height_m / cell_m / 2.0).ceil());
    let mut page = Page {
        grid,
        cell_m,
        columns: columns.max(1.0) as usize,
        marks: vec![' '; (columns.max(1.0) * rows.max(1.0)) as usize],
    };
    let lasers = world.scene().lasers.clone();
    let truth = world.truth(t_s);
    let mut ranges_m = Vec::new();
    let mut echoes = Vec::new();
    for laser in &lasers {
        world.scan(laser, t_s, &mut ranges_m);
        let (pose, geometry) = (laser.pose(), laser.geometry());
        for (beam, &range_m) in ranges_m.iter().enumerate().filter(|(_, r)| !r.is_nan()) {
            let (sin, cos) = (pose.yaw_rad + geometry.bearing_rad(beam)).sin_cos();
            let reach_m = f64::from(range_m).min(geometry.range_max_m);
            let steps = (reach_m / cell_m * 2.0) as usize;
            for step in 0..steps {
                let r = step as f64 * cell_m / 2.0;
                page.mark(pose.x_m + r * cos, pose.y_m + r * sin, |_| '.');
            }
            if range_m.is_finite() {
                echoes.push([pose.x_m + reach_m * cos, pose.y_m + reach_m * sin]);
            }
        }
    }
    for &[ax, ay, bx, by] in truth.doors.iter().flat_map(|door| &door.leaves_m) {
        for step in 0..=20 {
            let share = f64::from(step) / 20.0;
            page.mark(ax + (bx - ax) * share, ay + (by - ay) * share, |_| 'D');
        }
    }
    for [x, y, _] in truth.people.iter().flat_map(|person| person.legs_m) {
        page.mark(x, y, |_| 'o');
    }
    for [x, y] in echoes {
        page.mark(x, y, |was| if was == 'o' || was == '+' { '+' } else { '#' });
    }
    for laser in &lasers {
        page.mark(laser.x_m, laser.y_m, |_| 'L');
    }
    page.text()
}

struct Page {
    grid: GridGeometry,
    cell_m: f64,
    columns: usize,
    marks: Vec<char>,
}

impl Page {
    fn mark(&mut self, x_m: f64, y_m: f64, change: impl Fn(char) -> char) {
        let column = ((x_m - self.grid.origin_m[0]) / self.cell_m).floor();
        let row = ((y_m - self.grid.origin_m[1]) / self.cell_m / 2.0).floor();
        let rows = self.marks.len() / self.columns;
        if column >= 0.0 && row >= 0.0 && column < self.columns as f64 && row < rows as f64 {
            let mark = &mut self.marks[row as usize * self.columns + column as usize];
            *mark = change(*mark);
        }
    }

    fn text(&self) -> String {
        let lines = self.marks.chunks(self.columns).rev();
        lines.map(|line| line.iter().collect::<String>().trim_end().to_owned() + "\n").collect()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use scene::Scene;

    #[test]
    fn a_room_is_drawn_with_its_walls_and_its_laser() {
        let text = "name = \"t\"\n[area]\nid = \"a\"\norigin_m = [-0.5, -1.0]\ncell_m = 0.5\n\
                    columns = 9\n\
                    rows = 10\n[sensor]\nsigma_m = 0.0\nfault_share = 0.0\n\
                    [[wall]]\nclosed = true\n\
                    points_m = [[0.25, 0.1], [3.75, 0.1], [3.75, 3.5], [0.25, 3.5]]\n\
                    [[laser]]\nid = \"l\"\nx_m = 2.1\ny_m = 0.6\nyaw_deg = 90\n\
                    angle_increment_deg = 0.5\n\
                    beams = 361\n";
        let mut world = World::new(Scene::parse(text, "t").unwrap(), 0).unwrap();
        let drawn = look(&mut world, 0.0, 0.5);
        assert_eq!(drawn.lines().count(), 5, "{drawn}");
        assert!(drawn.contains("########"), "{drawn}");
        assert_eq!(drawn.matches('L').count(), 1, "{drawn}");
        assert!(drawn.lines().all(|line| line.chars().count() <= 9), "{drawn}");
    }
}
