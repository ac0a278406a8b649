//! What one laser sees: exact ray casting of segments and circles.
//!
//! What stands still is cast once and kept; a scan casts only doors and legs, and of those only the
//! beams between their bearings. So a scan costs what moves, not what is built.

use crate::file::LaserSpec;
use crate::shape::{Circle, Point, Segment, norm, sub};
use std::f64::consts::{PI, TAU};

/// One laser's beams and the ranges of what stands still.
#[derive(Debug, Clone)]
pub(crate) struct View {
    pub spec: LaserSpec,
    /// The rays are turned by so much from the beams, degrees.
    pub aside_deg: f64,
    origin: Point,
    yaw_rad: f64,
    angle_min_rad: f64,
    angle_increment_rad: f64,
    directions: Vec<Point>,
    /// The state of the objects that `background_m` was cast for.
    epoch: Option<usize>,
    background_m: Vec<f64>,
}

impl View {
    pub fn new(spec: &LaserSpec, aside_deg: f64) -> Self {
        let (pose, mut geometry) = (spec.pose(), spec.geometry());
        geometry.angle_min_rad += aside_deg.to_radians(); // + 0.0 changes no bit of it
        let beams = spec.beams as usize;
        let direction = |beam| {
            let (sin, cos) = (pose.yaw_rad + geometry.bearing_rad(beam)).sin_cos();
            [cos, sin]
        };
        Self {
            spec: spec.clone(),
            aside_deg,
            origin: [pose.x_m, pose.y_m],
            yaw_rad: pose.yaw_rad,
            angle_min_rad: geometry.angle_min_rad,
            angle_increment_rad: geometry.angle_increment_rad,
            directions: (0..beams).map(direction).collect(),
            epoch: None,
            background_m: vec![f64::INFINITY; beams],
        }
    }

    /// True if what stands still was cast for this state of the objects.
    pub fn is_of(&self, epoch: usize) -> bool {
        self.epoch == Some(epoch)
    }

    /// Casts what stands still.
    pub fn see_background(&mut self, epoch: usize, segments: &[Segment], circles: &[Circle]) {
        let mut ranges_m = std::mem::take(&mut self.background_m);
        ranges_m.fill(f64::INFINITY);
        for segment in segments {
            self.strike_segment(segment, &mut ranges_m);
        }
        for circle in circles {
            self.strike_circle(circle, &mut ranges_m);
        }
        self.background_m = ranges_m;
        self.epoch = Some(epoch);
    }

    /// Begins a scan with what stands still.
    pub fn begin(&self, ranges_m: &mut Vec<f64>) {
        ranges_m.clear();
        ranges_m.extend_from_slice(&self.background_m);
    }

    /// Shortens the ranges of the beams that meet a segment.
    pub fn strike_segment(&self, segment: &Segment, ranges_m: &mut [f64]) {
        let (a, b) = (self.bearing_rad(segment.a), self.bearing_rad(segment.b));
        let span = protocol::geometry::wrap_rad(b - a); // the laser sees it under less than pi
        let from = if span < 0.0 { a + span } else { a };
        self.for_beams(from, from + span.abs(), |beam| {
            if let Some(range_m) = segment.range_m(self.origin, self.directions[beam]) {
                ranges_m[beam] = ranges_m[beam].min(range_m);
            }
        });
    }

    /// Shortens the ranges of the beams that meet a circle.
    pub fn strike_circle(&self, circle: &Circle, ranges_m: &mut [f64]) {
        let distance = norm(sub(circle.centre, self.origin));
        let half = if distance > circle.radius_m {
            (circle.radius_m / distance).asin()
        } else {
            PI // from inside, in all directions
        };
        let middle = self.bearing_rad(circle.centre);
        self.for_beams(middle - half, middle + half, |beam| {
            if let Some(range_m) = circle.range_m(self.origin, self.directions[beam]) {
                ranges_m[beam] = ranges_m[beam].min(range_m);
            }
        });
    }

    fn bearing_rad(&self, point: Point) -> f64 {
        let [x, y] = sub(point, self.origin);
        y.atan2(x) - self.yaw_rad
    }

    /// Calls `strike` for the beams with a bearing in [from, to], modulo a turn, and one beam more
    /// on each side: the exact test is the caller's.
    fn for_beams(&self, from_rad: f64, to_rad: f64, mut strike: impl FnMut(usize)) {
        let beam_at = |rad: f64| (rad - self.angle_min_rad) / self.angle_increment_rad;
        let last = self.directions.len() as f64 - 1.0;
        let turn = TAU / self.angle_increment_rad.abs();
        let (a, b) = (beam_at(from_rad), beam_at(to_rad));
        let (low, high) = (a.min(b), a.max(b));
        // The first turn that ends at or after beam -1, so that every turn that touches is met.
        let mut shift = ((-1.0 - high) / turn).ceil() * turn;
        while low + shift <= last + 1.0 {
            let first = (low + shift).floor().max(0.0) as usize;
            let end = (high + shift).ceil().min(last);
            if end >= 0.0 {
                for beam in first..=end as usize {
                    strike(beam);
                }
            }
            shift += turn;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn full_turn(angle_min_deg: f64, increment_deg: f64) -> View {
        let mut spec = LaserSpec::lms200("l", 0.3, -0.2, 37.0);
        spec.angle_min_deg = angle_min_deg;
        spec.angle_increment_deg = increment_deg;
        spec.beams = (360.0 / increment_deg.abs()) as u32;
        View::new(&spec, 0.0)
    }

    #[test]
    fn the_beams_between_two_bearings_are_all_that_can_meet() {
        for view in [full_turn(-180.0, 1.0), full_turn(180.0, -0.5), full_turn(10.0, 0.25)] {
            for tick in 0..90 {
                let (sin, cos) = (f64::from(tick) * 0.07).sin_cos();
                let centre = [3.0 * cos, 2.0 * sin];
                let circle = Circle { centre, radius_m: 0.06 + 0.02 * f64::from(tick % 9) };
                let segment = Segment { a: centre, b: [centre[0] + 1.0, centre[1] - 0.5] };
                let mut fast = vec![f64::INFINITY; view.directions.len()];
                view.strike_circle(&circle, &mut fast);
                view.strike_segment(&segment, &mut fast);
                for (beam, &direction) in view.directions.iter().enumerate() {
                    let meets = [
                        circle.range_m(view.origin, direction),
                        segment.range_m(view.origin, direction),
                    ];
                    let nearest = meets.into_iter().flatten().fold(f64::INFINITY, f64::min);
                    assert_eq!(fast[beam], nearest, "beam {beam} tick {tick}");
                }
            }
        }
    }
}
