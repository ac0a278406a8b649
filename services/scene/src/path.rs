//! A way through the building: a polyline whose corners are rounded, addressed by arc length.

use crate::shape::{Point, add, lerp, norm, scale, sub};

/// A corner is cut this far from its point at most, metres: about what a walker does.
const CORNER_M: f64 = 0.4;
/// A rounded corner is this many straight pieces: at 0.4 m each turns by less than 20 degrees.
const CORNER_PIECES: usize = 6;

/// A polyline with rounded corners.
#[derive(Debug, Clone)]
pub(crate) struct Path {
    points: Vec<Point>,
    /// Arc length at every point.
    lengths_m: Vec<f64>,
    /// Arc length of every corner given, in the order given (closed: begins with corner 1, ends
    /// with 0).
    corners_m: Vec<f64>,
    closed: bool,
}

impl Path {
    /// Through open corners from the first to the last. At least one corner.
    pub fn open(corners: &[Point]) -> Self {
        let mut path = Self::start(corners[0], false);
        path.corners_m.push(0.0);
        for i in 1..corners.len() {
            if i + 1 < corners.len() {
                path.round(corners[i - 1], corners[i], corners[i + 1]);
            } else {
                path.push(corners[i]);
                path.corners_m.push(path.length_m());
            }
        }
        path
    }

    /// Round and round through the corners, from the middle of the first side. At least two
    /// corners.
    pub fn closed(corners: &[Point]) -> Self {
        let count = corners.len();
        let middle = lerp(corners[0], corners[1 % count], 0.5);
        let mut path = Self::start(middle, true);
        for i in 1..=count {
            path.round(corners[i - 1], corners[i % count], corners[(i + 1) % count]);
        }
        path.push(middle);
        path
    }

    fn start(point: Point, closed: bool) -> Self {
        Self { points: vec![point], lengths_m: vec![0.0], corners_m: Vec::new(), closed }
    }

    fn push(&mut self, point: Point) {
        let last = self.points[self.points.len() - 1];
        let step = norm(sub(point, last));
        if step > 1e-9 {
            self.lengths_m.push(self.length_m() + step);
            self.points.push(point);
        }
    }

    /// A quadratic Bezier arc about a corner, which meets both sides as a tangent.
    fn round(&mut self, before: Point, corner: Point, after: Point) {
        let (back, ahead) = (sub(before, corner), sub(after, corner));
        let (back_m, ahead_m) = (norm(back), norm(ahead));
        let cut = CORNER_M.min(back_m / 2.0).min(ahead_m / 2.0);
        if cut <= 1e-9 {
            self.push(corner);
            self.corners_m.push(self.length_m());
            return;
        }
        let from = add(corner, scale(back, cut / back_m));
        let to = add(corner, scale(ahead, cut / ahead_m));
        for piece in 0..=CORNER_PIECES {
            let share = piece as f64 / CORNER_PIECES as f64;
            self.push(lerp(lerp(from, corner, share), lerp(corner, to, share), share));
            if piece == CORNER_PIECES / 2 {
                self.corners_m.push(self.length_m());
            }
        }
    }

    /// Length of the whole path.
    pub fn length_m(&self) -> f64 {
        self.lengths_m[self.lengths_m.len() - 1]
    }

    /// Arc length at the i-th corner of an open path.
    pub fn corner_m(&self, index: usize) -> f64 {
        self.corners_m[index]
    }

    /// The straight pieces, each with the arc length of its begin.
    pub fn pieces(&self) -> impl Iterator<Item = (f64, Point, Point)> + '_ {
        self.points.windows(2).zip(&self.lengths_m).map(|(pair, &at_m)| (at_m, pair[0], pair[1]))
    }

    /// Point and unit direction at an arc length; clamped to the ends, or wrapped if closed.
    pub fn at(&self, arc_m: f64) -> (Point, Point) {
        if self.points.len() < 2 {
            return (self.points[0], [1.0, 0.0]);
        }
        let length = self.length_m();
        let arc = if self.closed { arc_m.rem_euclid(length) } else { arc_m.clamp(0.0, length) };
        let end = self.lengths_m.partition_point(|&l| l <= arc).clamp(1, self.points.len() - 1);
        let (a, b) = (self.points[end - 1], self.points[end]);
        let piece = self.lengths_m[end] - self.lengths_m[end - 1];
        let share = (arc - self.lengths_m[end - 1]) / piece;
        (lerp(a, b, share), scale(sub(b, a), 1.0 / piece))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_right_angle_is_cut_by_a_hand_and_its_ends_stay() {
        let path = Path::open(&[[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]]);
        assert_eq!(path.at(-1.0).0, [0.0, 0.0]);
        assert_eq!(path.at(99.0).0, [4.0, 3.0]);
        assert!(path.length_m() < 7.0 && path.length_m() > 6.5);
        let corner = path.at(path.corner_m(1)).0;
        let cut = norm(sub(corner, [4.0, 0.0]));
        assert!((0.1..0.2).contains(&cut), "{cut}");
    }

    #[test]
    fn a_closed_path_returns() {
        let path = Path::closed(&[[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]);
        let (a, b) = (path.at(1.0).0, path.at(1.0 + path.length_m()).0);
        assert!(norm(sub(a, b)) < 1e-9);
        assert!((14.0..16.0).contains(&path.length_m()));
    }

    #[test]
    fn a_path_of_one_point_stands_still() {
        let path = Path::open(&[[1.0, 2.0]]);
        assert_eq!(path.at(5.0), ([1.0, 2.0], [1.0, 0.0]));
        assert_eq!(Path::open(&[[1.0, 2.0], [1.0, 2.0]]).at(1.0).0, [1.0, 2.0]);
    }
}
