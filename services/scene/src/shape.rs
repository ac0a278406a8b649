//! Points, segments and circles in the plane, and where a ray meets them. Metres, site coordinates.

/// A point or a vector, metres.
pub(crate) type Point = [f64; 2];

pub(crate) fn sub(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1]]
}

pub(crate) fn add(a: Point, b: Point) -> Point {
    [a[0] + b[0], a[1] + b[1]]
}

pub(crate) fn scale(a: Point, factor: f64) -> Point {
    [a[0] * factor, a[1] * factor]
}

pub(crate) fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

pub(crate) fn cross(a: Point, b: Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

pub(crate) fn norm(a: Point) -> f64 {
    dot(a, a).sqrt()
}

pub(crate) fn lerp(a: Point, b: Point, share: f64) -> Point {
    [a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share]
}

/// A straight thin wall, or the leaf of a door.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Segment {
    pub a: Point,
    pub b: Point,
}

/// A pillar, or a leg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Circle {
    pub centre: Point,
    pub radius_m: f64,
}

/// A segment is this much longer for rays, so that none slips through the corner of two walls.
const CORNER_SHARE: f64 = 1e-9;

impl Segment {
    /// Range at which the ray from `origin` along the unit vector `direction` meets the segment.
    /// A segment seen exactly edge-on is not met: it has no thickness.
    pub fn range_m(&self, origin: Point, direction: Point) -> Option<f64> {
        let edge = sub(self.b, self.a);
        let to_a = sub(self.a, origin);
        let turn = cross(direction, edge);
        if turn.abs() < 1e-12 {
            return None;
        }
        let range = cross(to_a, edge) / turn;
        let along = cross(to_a, direction) / turn;
        let met = range >= 0.0 && (-CORNER_SHARE..=1.0 + CORNER_SHARE).contains(&along);
        met.then_some(range)
    }

    /// Shares along `self` and `other` at which the two cross, if they do.
    pub fn crossing(&self, other: &Segment) -> Option<(f64, f64)> {
        let (mine, theirs) = (sub(self.b, self.a), sub(other.b, other.a));
        let turn = cross(mine, theirs);
        if turn.abs() < 1e-12 {
            return None;
        }
        let offset = sub(other.a, self.a);
        let along_mine = cross(offset, theirs) / turn;
        let along_theirs = cross(offset, mine) / turn;
        let unit = 0.0..=1.0;
        (unit.contains(&along_mine) && unit.contains(&along_theirs))
            .then_some((along_mine, along_theirs))
    }

    /// Distance from a point to the segment.
    pub fn distance_m(&self, point: Point) -> f64 {
        let edge = sub(self.b, self.a);
        let length2 = dot(edge, edge);
        let share = if length2 > 0.0 { dot(sub(point, self.a), edge) / length2 } else { 0.0 };
        norm(sub(point, lerp(self.a, self.b, share.clamp(0.0, 1.0))))
    }

    /// Smallest distance between two segments; 0 if they cross.
    pub fn clearance_m(&self, other: &Segment) -> f64 {
        if self.crossing(other).is_some() {
            return 0.0;
        }
        let ends = [
            self.distance_m(other.a),
            self.distance_m(other.b),
            other.distance_m(self.a),
            other.distance_m(self.b),
        ];
        ends.into_iter().fold(f64::INFINITY, f64::min)
    }
}

impl Circle {
    /// Range at which a ray meets the circle; 0 from inside.
    pub fn range_m(&self, origin: Point, direction: Point) -> Option<f64> {
        let to_centre = sub(self.centre, origin);
        let beside2 = dot(to_centre, to_centre) - self.radius_m * self.radius_m;
        if beside2 <= 0.0 {
            return Some(0.0);
        }
        let ahead = dot(to_centre, direction);
        let under_root = ahead * ahead - beside2;
        (ahead > 0.0 && under_root >= 0.0).then(|| ahead - under_root.sqrt())
    }
}

/// The four sides of a rotated rectangle.
pub(crate) fn rectangle(centre: Point, size_m: [f64; 2], yaw_rad: f64) -> [Segment; 4] {
    let (sin, cos) = yaw_rad.sin_cos();
    let corner = |x: f64, y: f64| {
        let (x, y) = (x * size_m[0] / 2.0, y * size_m[1] / 2.0);
        add(centre, [x * cos - y * sin, x * sin + y * cos])
    };
    let [a, b, c, d] = [corner(-1., -1.), corner(1., -1.), corner(1., 1.), corner(-1., 1.)];
    [Segment { a, b }, Segment { a: b, b: c }, Segment { a: c, b: d }, Segment { a: d, b: a }]
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn rays_meet_what_a_ruler_on_paper_says() {
        let wall = Segment { a: [2.0, -1.0], b: [2.0, 1.0] };
        assert_eq!(wall.range_m([0.0, 0.0], [1.0, 0.0]), Some(2.0));
        assert_eq!(wall.range_m([0.0, 0.0], [-1.0, 0.0]), None);
        assert_eq!(wall.range_m([0.0, 1.5], [1.0, 0.0]), None);
        assert_eq!(wall.range_m([2.0, -3.0], [0.0, 1.0]), None, "edge-on");
        let slanted = [0.8, 0.6]; // a 3-4-5 triangle: meets x = 2 at y = 1.5
        assert_eq!(wall.range_m([0.0, 0.0], slanted), None);
        let range = wall.range_m([0.0, -1.0], slanted).unwrap();
        assert!((range - 2.5).abs() < 1e-12, "{range}");

        let pillar = Circle { centre: [3.0, 0.0], radius_m: 0.5 };
        assert_eq!(pillar.range_m([0.0, 0.0], [1.0, 0.0]), Some(2.5));
        assert_eq!(pillar.range_m([0.0, 0.0], [-1.0, 0.0]), None);
        assert_eq!(pillar.range_m([0.0, 0.6], [1.0, 0.0]), None);
        assert_eq!(pillar.range_m([3.1, 0.1], [1.0, 0.0]), Some(0.0), "from inside");
        let beside = pillar.range_m([0.0, 0.3], [1.0, 0.0]).unwrap();
        assert!((beside - 2.6).abs() < 1e-12, "{beside}");
    }

    #[test]
    fn a_rectangle_turned_by_a_quarter_swaps_its_sides() {
        let sides = rectangle([1.0, 1.0], [4.0, 2.0], std::f64::consts::FRAC_PI_2);
        let along_x = |x: f64| sides[..].iter().filter_map(move |s| s.range_m([x, 1.0], [1., 0.]));
        assert!((along_x(-5.0).fold(f64::MAX, f64::min) - 5.0).abs() < 1e-12);
    }

    #[test]
    fn clearance_is_zero_where_two_segments_cross() {
        let a = Segment { a: [0.0, 0.0], b: [2.0, 0.0] };
        assert_eq!(a.clearance_m(&Segment { a: [1.0, -1.0], b: [1.0, 1.0] }), 0.0);
        assert_eq!(a.clearance_m(&Segment { a: [1.0, 0.5], b: [1.0, 1.0] }), 0.5);
    }
}
