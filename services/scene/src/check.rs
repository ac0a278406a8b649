//! The bounds of a scene, said in words, all at once.

use crate::error::SceneError;
use crate::file::{Incident, LaserSpec, Opening, RoutePoint, Scene};
use crate::obstacle::{BODY_M, Obstacles};
use crate::path::Path;
use crate::population::{pieces, stay_max_s};
use crate::shape::{Segment, norm, sub};
use crate::ways::Ways;
use protocol::geometry::GridGeometry;
use protocol::scan::BEAMS_MAX;
use std::collections::BTreeSet;

/// Most corners of all walls together: each is cast once a laser; a floor plan has hundreds.
pub const CORNERS_MAX: usize = 4096;
/// Most boxes and most pillars: a hall of shelves.
pub const OBJECTS_MAX: usize = 1024;
/// Most doors of each kind: each leaf is cast in every scan.
pub const DOORS_MAX: usize = 64;
/// Most lasers of a scene: as many as an area may have.
pub const LASERS_MAX: usize = 64;
/// Most routes, loops, wander groups, incidents: each is walked through by the check.
pub const WAYS_MAX: usize = 64;
/// Most points of a way.
pub const POINTS_MAX: usize = 64;
/// Most people that are expected at once: two legs each are cast in every scan.
pub const PEOPLE_MAX: f64 = 256.0;
/// Nothing is farther from the origin than this, metres: a kilometre is a site.
pub const COORDINATE_MAX_M: f64 = 1000.0;
/// Longest wait, hold or movement, seconds: an hour.
pub const WAIT_MAX_S: f64 = 3600.0;

/// Collects what is wrong.
struct Problems(Vec<String>);

impl Problems {
    fn unless(&mut self, good: bool, problem: impl FnOnce() -> String) {
        if !good {
            self.0.push(problem());
        }
    }

    fn number(&mut self, what: &str, value: f64, low: f64, high: f64, unit: &str) {
        self.unless((low..=high).contains(&value), || {
            format!("{what} is {value}, expected {low}..{high} {unit}")
        });
    }

    fn place(&mut self, what: &str, point: [f64; 2]) {
        for value in point {
            self.number(what, value, -COORDINATE_MAX_M, COORDINATE_MAX_M, "m");
        }
    }

    fn between(&mut self, what: &str, [low, high]: [f64; 2], least: f64, most: f64, unit: &str) {
        self.unless(low >= least && low <= high && high <= most, || {
            format!(
                "{what} is [{low}, {high}], expected [low, high] with \
                 {least} <= low <= high <= {most} {unit}"
            )
        });
    }

    fn count(&mut self, what: &str, found: usize, least: usize, most: usize) {
        self.unless((least..=most).contains(&found), || {
            format!("{found} {what}, expected {least}..{most}")
        });
    }

    fn ids<'a>(&mut self, what: &str, ids: impl Iterator<Item = &'a str>) {
        let mut seen = BTreeSet::new();
        for id in ids {
            let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
            self.unless((1..=32).contains(&id.len()) && id.chars().all(plain), || {
                format!("{what} id `{id}`: expected 1..32 letters, digits, `-`, `_`")
            });
            self.unless(seen.insert(id), || format!("two {what}s have the id `{id}`"));
        }
    }
}

impl Scene {
    /// Checks every bound.
    ///
    /// # Errors
    /// [`SceneError::Invalid`] with all that is wrong.
    pub fn check(&self) -> Result<(), SceneError> {
        let mut problems = Problems(Vec::new());
        self.check_counts(&mut problems);
        self.check_area(&mut problems);
        self.check_solids(&mut problems);
        self.check_doors(&mut problems);
        self.check_people(&mut problems);
        self.check_incidents(&mut problems);
        if problems.0.is_empty() {
            self.check_ways(&mut problems); // walks along the numbers: only if they are numbers
        }
        if problems.0.is_empty() {
            return Ok(());
        }
        Err(SceneError::Invalid { name: self.name.clone(), problems: problems.0 })
    }

    fn check_counts(&self, problems: &mut Problems) {
        let corners = self.walls.iter().map(|wall| wall.points_m.len()).sum();
        problems.count("corners of walls", corners, 0, CORNERS_MAX);
        problems.count("boxes", self.boxes.len(), 0, OBJECTS_MAX);
        problems.count("pillars", self.pillars.len(), 0, OBJECTS_MAX);
        problems.count("doors", self.doors.len(), 0, DOORS_MAX);
        problems.count("sliding doors", self.sliding_doors.len(), 0, DOORS_MAX);
        problems.count("lasers", self.lasers.len(), 0, LASERS_MAX);
        problems.count("routes", self.routes.len(), 0, WAYS_MAX);
        problems.count("loops", self.loops.len(), 0, WAYS_MAX);
        problems.count("wander groups", self.wanders.len(), 0, WAYS_MAX);
        problems.count("incidents", self.incidents.len(), 0, WAYS_MAX);
        problems.ids("laser", self.lasers.iter().map(|laser| laser.id.as_str()));
        let hinged = self.doors.iter().map(|door| door.id.as_str());
        let doors = hinged.chain(self.sliding_doors.iter().map(|door| door.id.as_str()));
        problems.ids("door", doors);
        let routes = self.routes.iter().map(|route| route.id.as_str());
        let loops = self.loops.iter().map(|people| people.id.as_str());
        let wanders = self.wanders.iter().map(|wander| wander.id.as_str());
        problems.ids("way", routes.chain(loops).chain(wanders));
    }

    fn check_area(&self, problems: &mut Problems) {
        let grid = self.area.grid();
        let side = GridGeometry::SIDE_MAX as usize;
        problems.ids("area", std::iter::once(self.area.id.as_str()));
        problems.place("area origin_m", grid.origin_m);
        problems.number("area cell_m", grid.cell_m, 0.01, 1.0, "m");
        problems.count("columns of the area", grid.columns as usize, 1, side);
        problems.count("rows of the area", grid.rows as usize, 1, side);
        problems.count("cells of the area", grid.cells(), 1, GridGeometry::CELLS_MAX);
        problems.number("sensor sigma_m", self.sensor.sigma_m, 0.0, 1.0, "m");
        problems.number("sensor bias_m", self.sensor.bias_m, 0.0, 1.0, "m");
        problems.number("sensor quantum_m", self.sensor.quantum_m, 0.0, 1.0, "m");
        problems.number("sensor fault_share", self.sensor.fault_share, 0.0, 1.0, "");
        problems.number("sensor dropout_share", self.sensor.dropout_share, 0.0, 1.0, "");
        for laser in &self.lasers {
            check_laser(laser, problems);
        }
    }

    fn check_solids(&self, problems: &mut Problems) {
        for (i, wall) in self.walls.iter().enumerate() {
            let what = format!("wall {}", i + 1);
            problems.unless(wall.points_m.len() >= 2, || {
                format!("{what} has {} points, expected at least 2", wall.points_m.len())
            });
            wall.points_m.iter().for_each(|&point| problems.place(&what, point));
        }
        for (i, item) in self.boxes.iter().enumerate() {
            let what = format!("box {} `{}`", i + 1, item.id);
            check_box(&what, item.centre_m, item.size_m, item.yaw_deg, problems);
            check_stay(&what, item.appears_s, item.vanishes_s, problems);
        }
        for (i, item) in self.pillars.iter().enumerate() {
            let what = format!("pillar {} `{}`", i + 1, item.id);
            problems.place(&what, item.centre_m);
            problems.number(&format!("{what} radius_m"), item.radius_m, 0.005, 100.0, "m");
            check_stay(&what, item.appears_s, item.vanishes_s, problems);
        }
    }

    fn check_doors(&self, problems: &mut Problems) {
        for door in &self.doors {
            let what = format!("door `{}`", door.id);
            problems.place(&what, door.hinge_m);
            problems.number(&format!("{what} leaf_m"), door.leaf_m, 0.1, 10.0, "m");
            problems.number(&format!("{what} closed_deg"), door.closed_deg, -360.0, 360.0, "deg");
            problems.number(&format!("{what} open_deg"), door.open_deg, -360.0, 360.0, "deg");
            check_opening(&what, door.move_s, door.hold_s, &door.openings, problems);
        }
        for door in &self.sliding_doors {
            let what = format!("sliding door `{}`", door.id);
            problems.count(&format!("leaves of {what}"), door.leaves.len(), 1, 4);
            for leaf in &door.leaves {
                problems.place(&what, leaf.from_m);
                problems.place(&what, leaf.to_m);
                problems.place(&format!("{what} shift_m"), leaf.shift_m);
            }
            check_opening(&what, door.move_s, door.hold_s, &door.openings, problems);
        }
    }

    fn check_people(&self, problems: &mut Problems) {
        let mut expected = 0.0;
        for route in &self.routes {
            let what = format!("route `{}`", route.id);
            check_points(&what, &route.points, route.speed_m_s, problems);
            problems.number(
                &format!("{what} arrivals_per_hour"),
                route.arrivals_per_hour,
                0.0,
                36_000.0,
                "an hour",
            );
            problems.number(&format!("{what} party"), f64::from(route.party), 1.0, 8.0, "people");
            let stay_s = stay_max_s(&route.points, route.speed_m_s, route.party);
            expected += route.arrivals_per_hour / 3600.0 * stay_s * f64::from(route.party);
        }
        for people in &self.loops {
            let what = format!("loop `{}`", people.id);
            problems.count(&format!("points of {what}"), people.points_m.len(), 3, POINTS_MAX);
            people.points_m.iter().for_each(|&point| problems.place(&what, point));
            check_speed(&what, people.speed_m_s, problems);
            problems.number(&format!("{what} spread_m"), people.spread_m, 0.0, 10.0, "m");
            check_present(&what, people.present_s, problems);
            expected += f64::from(people.people);
        }
        for wander in &self.wanders {
            let what = format!("wander `{}`", wander.id);
            problems.count(&format!("points of {what}"), wander.points_m.len(), 2, POINTS_MAX);
            wander.points_m.iter().for_each(|&point| problems.place(&what, point));
            check_speed(&what, wander.speed_m_s, problems);
            problems.between(&format!("{what} pause_s"), wander.pause_s, 0.0, WAIT_MAX_S, "s");
            check_present(&what, wander.present_s, problems);
            expected += f64::from(wander.people);
        }
        problems.unless(expected <= PEOPLE_MAX, || {
            format!(
                "up to {expected:.0} people at once, expected at most {PEOPLE_MAX}: \
                 fewer arrivals or shorter waits"
            )
        });
    }

    fn check_incidents(&self, problems: &mut Problems) {
        for incident in &self.incidents {
            let what = format!("incident `{}`", incident.id());
            problems.number(
                &format!("{what} at_s"),
                incident.at_s().unwrap_or(0.0),
                -1e9,
                1e9,
                "s",
            );
            match incident {
                Incident::Walk { points, speed_m_s, .. } => {
                    check_points(&what, points, *speed_m_s, problems);
                }
                Incident::Object { stays_s, centre_m, size_m, yaw_deg, .. } => {
                    check_box(&what, *centre_m, *size_m, *yaw_deg, problems);
                    problems.number(&format!("{what} stays_s"), *stays_s, 0.0, 1e9, "s");
                }
                Incident::DoorHeld { stays_s, door, .. } => {
                    problems.number(&format!("{what} stays_s"), *stays_s, 0.0, 1e9, "s");
                    let known = self.doors.iter().any(|d| d.id == *door)
                        || self.sliding_doors.iter().any(|d| d.id == *door);
                    problems
                        .unless(known, || format!("{what} holds the door `{door}`: no such door"));
                }
            }
        }
    }

    /// Nobody walks through a wall.
    fn check_ways(&self, problems: &mut Problems) {
        let obstacles = Obstacles::new(self);
        for route in &self.routes {
            let what = format!("route `{}`", route.id);
            check_clear(&what, &pieces(&route.points), &obstacles, problems);
        }
        for incident in &self.incidents {
            if let Incident::Walk { id, points, .. } = incident {
                check_clear(&format!("incident `{id}`"), &pieces(points), &obstacles, problems);
            }
        }
        for people in &self.loops {
            let path = Path::closed(&people.points_m);
            let sides: Vec<_> =
                path.pieces().map(|(_, a, b)| (Segment { a, b }, people.spread_m)).collect();
            check_clear(&format!("loop `{}`", people.id), &sides, &obstacles, problems);
        }
        for wander in &self.wanders {
            let ways = Ways::new(&wander.points_m, wander.speed_m_s[0], &obstacles);
            if let Some(place) = ways.unreachable() {
                let [x, y] = wander.points_m[place];
                problems.0.push(format!(
                    "wander `{}`: nobody gets from its first point to ({x}, {y}) without walking \
                     into something: add points between",
                    wander.id
                ));
            }
        }
    }
}

fn check_laser(laser: &LaserSpec, problems: &mut Problems) {
    let what = format!("laser `{}`", laser.id);
    problems.place(&what, [laser.x_m, laser.y_m]);
    problems.number(&format!("{what} yaw_deg"), laser.yaw_deg, -360.0, 360.0, "deg");
    problems.count(&format!("beams of {what}"), laser.beams as usize, 1, BEAMS_MAX);
    if let Err(problem) = laser.geometry().check() {
        problems.0.push(format!("{what}: {problem}"));
    }
    let turn_deg = laser.angle_increment_deg.abs() * f64::from(laser.beams);
    problems.unless(turn_deg <= 361.0, || {
        format!("{what} turns {turn_deg:.1} degrees, expected at most a turn")
    });
}

fn check_box(
    what: &str,
    centre_m: [f64; 2],
    size_m: [f64; 2],
    yaw_deg: f64,
    problems: &mut Problems,
) {
    problems.place(what, centre_m);
    size_m.iter().for_each(|&s| problems.number(&format!("{what} size_m"), s, 0.005, 1000.0, "m"));
    problems.number(&format!("{what} yaw_deg"), yaw_deg, -360.0, 360.0, "deg");
}

fn check_stay(what: &str, from: Option<f64>, until: Option<f64>, problems: &mut Problems) {
    problems.number(&format!("{what} appears_s"), from.unwrap_or(0.0), -1e9, 1e9, "s");
    problems.number(&format!("{what} vanishes_s"), until.unwrap_or(0.0), -1e9, 1e9, "s");
    if let (Some(from), Some(until)) = (from, until) {
        problems.unless(from < until, || {
            format!("{what} vanishes at {until} s, expected after it appears at {from} s")
        });
    }
}

fn check_opening(
    what: &str,
    move_s: f64,
    hold_s: [f64; 2],
    openings: &[Opening],
    problems: &mut Problems,
) {
    problems.number(&format!("{what} move_s"), move_s, 0.1, 20.0, "s");
    problems.between(&format!("{what} hold_s"), hold_s, 0.0, WAIT_MAX_S, "s");
    problems.count(&format!("openings of {what}"), openings.len(), 0, 256);
    for opening in openings {
        problems.number(&format!("{what} opening at_s"), opening.at_s, -1e9, 1e9, "s");
        problems.number(&format!("{what} opening hold_s"), opening.hold_s, 0.0, 1e9, "s");
        let busy_s = opening.hold_s + 2.0 * move_s;
        let every_s = opening.every_s.unwrap_or(busy_s);
        problems.unless(every_s >= busy_s, || {
            format!(
                "{what} opens every {every_s} s, expected at least hold_s + 2 move_s = {busy_s} s"
            )
        });
    }
}

fn check_present(what: &str, window_s: Option<[f64; 2]>, problems: &mut Problems) {
    if let Some(window_s) = window_s {
        problems.between(&format!("{what} present_s"), window_s, -1e9, 1e9, "s");
    }
}

fn check_speed(what: &str, speed_m_s: [f64; 2], problems: &mut Problems) {
    problems.between(&format!("{what} speed_m_s"), speed_m_s, 0.3, 4.0, "m/s");
}

fn check_points(what: &str, points: &[RoutePoint], speed: [f64; 2], problems: &mut Problems) {
    problems.count(&format!("points of {what}"), points.len(), 2, POINTS_MAX);
    check_speed(what, speed, problems);
    for (i, point) in points.iter().enumerate() {
        let what = format!("point {} of {what}", i + 1);
        problems.place(&what, point.at_m);
        problems.between(&format!("{what} wait_s"), point.wait_s, 0.0, WAIT_MAX_S, "s");
        problems.number(&format!("{what} spread_m"), point.spread_m, 0.0, 10.0, "m");
    }
    for (i, pair) in points.windows(2).enumerate() {
        let (length, spread) =
            (norm(sub(pair[1].at_m, pair[0].at_m)), pair[0].spread_m + pair[1].spread_m);
        problems.unless(length > spread + 0.05, || {
            format!(
                "points {} and {} of {what} are {length:.2} m apart, expected more than \
                 their spreads ({spread:.2} m)",
                i + 1,
                i + 2
            )
        });
    }
}

fn check_clear(
    what: &str,
    pieces: &[(Segment, f64)],
    obstacles: &Obstacles,
    problems: &mut Problems,
) {
    for (piece, spread_m) in pieces {
        let needed = spread_m + BODY_M;
        if let Some((found, name)) = obstacles.nearest(piece)
            && found < needed
        {
            problems.0.push(format!(
                "{what} passes {name} at {found:.2} m near ({:.2}, {:.2}), expected at \
                 least {needed:.2} m (spread and half a walker)",
                piece.a[0], piece.a[1]
            ));
            return; // one complaint a way is enough
        }
    }
}
