//! What nobody walks through.

use crate::door::Door;
use crate::file::Scene;
use crate::shape::{Circle, Segment, rectangle, sub};

/// Half the width of a walker at knee height, metres: half the gap of the legs and a leg.
pub(crate) const BODY_M: f64 = 0.16;

/// Walls, furniture and pillars, and the open leaves of doors.
#[derive(Debug, Clone, Default)]
pub(crate) struct Obstacles {
    segments: Vec<(Segment, String)>,
    circles: Vec<(Circle, String)>,
}

impl Obstacles {
    /// Everything that stands in the scene for ever. Things that come and go stand where people may
    /// have walked before, and so are not looked at.
    pub fn new(scene: &Scene) -> Self {
        let mut all = Self::default();
        for (i, wall) in scene.walls.iter().enumerate() {
            for side in wall_segments(&wall.points_m, wall.closed) {
                all.segments.push((side, format!("wall {}", i + 1)));
            }
        }
        for (i, item) in scene.boxes.iter().enumerate() {
            if item.appears_s.is_none() && item.vanishes_s.is_none() {
                for side in rectangle(item.centre_m, item.size_m, item.yaw_deg.to_radians()) {
                    all.segments.push((side, format!("box {} `{}`", i + 1, item.id)));
                }
            }
        }
        for (i, item) in scene.pillars.iter().enumerate() {
            if item.appears_s.is_none() && item.vanishes_s.is_none() {
                let circle = Circle { centre: item.centre_m, radius_m: item.radius_m };
                all.circles.push((circle, format!("pillar {} `{}`", i + 1, item.id)));
            }
        }
        for door in Door::all(scene) {
            for leaf in door.open() {
                all.segments.push((leaf, format!("the open leaf of door `{}`", door.id)));
            }
        }
        all
    }

    /// The nearest obstacle of a straight way and its distance.
    pub fn nearest(&self, way: &Segment) -> Option<(f64, &str)> {
        let walls = self.segments.iter().map(|(s, name)| (s.clearance_m(way), name.as_str()));
        let rounds = self.circles.iter().map(|(circle, name)| {
            ((way.distance_m(circle.centre) - circle.radius_m).max(0.0), name.as_str())
        });
        walls.chain(rounds).min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Distance of a straight way to the nearest obstacle.
    pub fn clearance_m(&self, way: &Segment) -> f64 {
        self.nearest(way).map_or(f64::INFINITY, |(distance, _)| distance)
    }

    /// The deepest that a disc at a point is inside an obstacle's line, metres; negative if it is
    /// clear.
    #[cfg(test)]
    pub fn depth_m(&self, disc: &Circle) -> f64 {
        let point = Segment { a: disc.centre, b: disc.centre };
        disc.radius_m - self.clearance_m(&point)
    }
}

/// The sides of a polyline.
pub(crate) fn wall_segments(points: &[[f64; 2]], closed: bool) -> Vec<Segment> {
    let mut sides: Vec<Segment> =
        points.windows(2).map(|pair| Segment { a: pair[0], b: pair[1] }).collect();
    if closed && points.len() > 2 {
        sides.push(Segment { a: points[points.len() - 1], b: points[0] });
    }
    sides.retain(|side| sub(side.b, side.a) != [0.0, 0.0]);
    sides
}
