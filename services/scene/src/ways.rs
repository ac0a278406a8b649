//! Ways between the places of a wanderer: which places see each other, and the shortest way by
//! them.

use crate::obstacle::{BODY_M, Obstacles};
use crate::shape::{Point, Segment, norm, sub};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Most hops of one stroll: at the shortest step of 0.3 m and a slot of minutes this is never
/// reached.
const HOPS_MAX: usize = 256;
/// Shortest slot of a wanderer, seconds.
const SLOT_MIN_S: f64 = 30.0;

/// The graph of places.
#[derive(Debug, Clone)]
pub(crate) struct Ways {
    neighbours: Vec<Vec<usize>>,
    /// Length of the shortest way, and its first hop.
    shortest: Vec<Vec<(f64, usize)>>,
    steps_m: Vec<Vec<f64>>,
    /// A wanderer is at a drawn place whenever a slot of this length begins, seconds.
    pub slot_s: f64,
}

impl Ways {
    /// Floyd and Warshall over the places that see each other.
    pub fn new(points: &[Point], speed_min_m_s: f64, obstacles: &Obstacles) -> Self {
        let count = points.len();
        let steps_m: Vec<Vec<f64>> =
            points.iter().map(|a| points.iter().map(|b| norm(sub(*b, *a))).collect()).collect();
        let sees = |i: usize, j: usize| {
            let way = Segment { a: points[i], b: points[j] };
            i != j && obstacles.clearance_m(&way) >= BODY_M
        };
        let neighbours: Vec<Vec<usize>> =
            (0..count).map(|i| (0..count).filter(|&j| sees(i, j)).collect()).collect();
        let mut shortest = vec![vec![(f64::INFINITY, 0); count]; count];
        for i in 0..count {
            shortest[i][i] = (0.0, i);
            for &j in &neighbours[i] {
                shortest[i][j] = (steps_m[i][j], j);
            }
        }
        for by in 0..count {
            for i in 0..count {
                for j in 0..count {
                    let length = shortest[i][by].0 + shortest[by][j].0;
                    if length < shortest[i][j].0 {
                        shortest[i][j] = (length, shortest[i][by].1);
                    }
                }
            }
        }
        let longest = shortest.iter().flatten().map(|way| way.0).fold(0.0, f64::max);
        let slot_s = (2.0 * longest / speed_min_m_s).max(SLOT_MIN_S).ceil();
        Self { neighbours, shortest, steps_m, slot_s }
    }

    /// A place that cannot be reached from the first, if there is one.
    pub fn unreachable(&self) -> Option<usize> {
        self.shortest[0].iter().position(|way| way.0.is_infinite())
    }

    /// Places and pauses of one slot: at random from neighbour to neighbour while time allows, then
    /// to `to`. Never longer than the slot.
    pub fn stroll(
        &self,
        rng: &mut ChaCha8Rng,
        from: usize,
        to: usize,
        speed_m_s: f64,
        pause_s: [f64; 2],
    ) -> Vec<(usize, f64)> {
        let mut stops = vec![(from, 0.0)];
        let (mut at, mut used_s) = (from, 0.0);
        while stops.len() < HOPS_MAX && !self.neighbours[at].is_empty() {
            let next = self.neighbours[at][rng.random_range(0..self.neighbours[at].len())];
            let pause = pause_s[0] + (pause_s[1] - pause_s[0]) * rng.random::<f64>();
            let then_s = used_s + self.steps_m[at][next] / speed_m_s + pause;
            if then_s + self.shortest[next][to].0 / speed_m_s > self.slot_s {
                break;
            }
            stops.push((next, pause));
            (at, used_s) = (next, then_s);
        }
        while at != to && stops.len() < 2 * HOPS_MAX {
            at = self.shortest[at][to].1;
            stops.push((at, 0.0));
        }
        stops
    }
}
