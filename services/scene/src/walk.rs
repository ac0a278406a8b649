//! One person: where the body is at a time, and where its two legs are at knee height.
//!
//! Gait: each foot repeats a cycle of `1/cadence`. During the stance (0.4 s) the shin stands still
//! where the body is at mid-stance; during the rest it swings to the next foothold. Footholds
//! follow from the body's motion at two instants, so that stopping, waiting and turning need no
//! special case. With 1.25 m/s and 0.9 Hz a leg reaches about 0.28 m before and behind the body.

use crate::path::Path;
use crate::shape::{Circle, Point, add, scale};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// A shin stands still for so long in each cycle, seconds.
const STANCE_S: f64 = 0.4;
/// Half the distance between the legs, metres (18 cm apart).
const HALF_GAP_M: f64 = 0.09;
/// How far a standing person sways at knee height, metres.
const SWAY_M: f64 = 0.005;

/// How one person walks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gait {
    cadence_hz: f64,
    phase: f64,
    leg_radius_m: f64,
    sway_phase: f64,
}

impl Gait {
    /// Draws a person.
    pub fn draw(rng: &mut ChaCha8Rng) -> Self {
        Self {
            cadence_hz: rng.random_range(0.85..0.95),
            phase: rng.random_range(0.0..1.0),
            leg_radius_m: rng.random_range(0.05..0.07),
            sway_phase: rng.random_range(0.0..TAU),
        }
    }
}

/// How a body moves along its path.
#[derive(Debug, Clone)]
pub(crate) enum Motion {
    /// (time, arc length), both not falling; straight between; at least one.
    Knots(Vec<(f64, f64)>),
    /// For ever: arc length `from_m` at time 0.
    Steady { from_m: f64, speed_m_s: f64 },
}

impl Motion {
    fn arc_m(&self, t_s: f64) -> f64 {
        match self {
            Self::Steady { from_m, speed_m_s } => from_m + speed_m_s * t_s,
            Self::Knots(knots) => {
                let next = knots.partition_point(|&(at, _)| at <= t_s);
                if next == 0 {
                    return knots[0].1;
                }
                let (t0, s0) = knots[next - 1];
                let Some(&(t1, s1)) = knots.get(next) else { return s0 };
                s0 + (s1 - s0) * (t_s - t0) / (t1 - t0)
            }
        }
    }
}

/// One person's stay in the scene.
#[derive(Debug, Clone)]
pub(crate) struct Walk {
    /// Names the person for ever: the same in every process.
    pub id: u64,
    /// Id of the route, loop, wander group or incident.
    pub origin: String,
    pub path: Path,
    pub motion: Motion,
    pub gait: Gait,
    /// Only there from, until, seconds; infinite unless the scene says.
    pub present_s: (f64, f64),
}

/// Of somebody who is there as long as he moves.
pub(crate) const ALWAYS_S: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

/// Where a person is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stand {
    pub body: Point,
    pub heading_rad: f64,
    pub speed_m_s: f64,
    pub legs: [Circle; 2],
}

impl Walk {
    /// First and last second of the stay.
    pub fn stay_s(&self) -> (f64, f64) {
        match &self.motion {
            Motion::Steady { .. } => (f64::NEG_INFINITY, f64::INFINITY),
            Motion::Knots(knots) => (knots[0].0, knots[knots.len() - 1].0),
        }
    }

    /// True if the person is in the scene: `[first, last)`.
    pub fn is_there(&self, t_s: f64) -> bool {
        let (first, last) = self.stay_s();
        let (from, until) = self.present_s;
        (first..last).contains(&t_s) && (from..until).contains(&t_s)
    }

    /// The time at which the body first reaches an arc length; none for a loop.
    pub fn reaches_s(&self, arc_m: f64) -> Option<f64> {
        let Motion::Knots(knots) = &self.motion else { return None };
        let next = knots.partition_point(|&(_, s)| s < arc_m);
        let &(t1, s1) = knots.get(next)?;
        if next == 0 {
            return Some(t1);
        }
        let (t0, s0) = knots[next - 1];
        Some(t0 + (t1 - t0) * (arc_m - s0) / (s1 - s0))
    }

    /// The two legs at knee height.
    pub fn legs(&self, t_s: f64) -> [Circle; 2] {
        [self.leg(t_s, 0.0), self.leg(t_s, 1.0)]
    }

    fn leg(&self, t_s: f64, side: f64) -> Circle {
        let Gait { cadence_hz, phase, leg_radius_m, sway_phase } = self.gait;
        let turns = cadence_hz * t_s + phase + side / 2.0;
        let cycle = turns.floor();
        let stance = STANCE_S * cadence_hz;
        let foothold_m = |cycle: f64| {
            self.motion.arc_m((cycle + stance / 2.0 - phase - side / 2.0) / cadence_hz)
        };
        let (from, to) = (foothold_m(cycle), foothold_m(cycle + 1.0));
        let swing = ((turns - cycle - stance) / (1.0 - stance)).clamp(0.0, 1.0);
        let (point, ahead) = self.path.at(from + (to - from) * smooth(swing));
        let aside = scale([-ahead[1], ahead[0]], HALF_GAP_M * (2.0 * side - 1.0));
        let standing = (1.0 - (to - from).abs() / 0.1).max(0.0);
        let sway = [(TAU * 0.23 * t_s + sway_phase).sin(), (TAU * 0.17 * t_s + sway_phase).sin()];
        let centre = add(add(point, aside), scale(sway, SWAY_M * standing));
        Circle { centre, radius_m: leg_radius_m }
    }

    /// Body and legs.
    pub fn stand(&self, t_s: f64) -> Stand {
        let arc_m = self.motion.arc_m(t_s);
        let (body, ahead) = self.path.at(arc_m);
        let speed_m_s = ((self.motion.arc_m(t_s + 0.01) - arc_m) / 0.01).max(0.0);
        Stand { body, heading_rad: ahead[1].atan2(ahead[0]), speed_m_s, legs: self.legs(t_s) }
    }
}

/// 0 to 1 with no speed at both ends.
pub(crate) fn smooth(share: f64) -> f64 {
    share * share * (3.0 - 2.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::{Purpose, stream};
    use crate::shape::{norm, sub};

    fn walker(seed: u64) -> Walk {
        let path = Path::open(&[[0.0, 0.0], [30.0, 0.0]]);
        let motion = Motion::Knots(vec![(0.0, 0.0), (10.0, 0.0), (34.0, 30.0), (44.0, 30.0)]);
        let gait = Gait::draw(&mut stream(Purpose::Gait, &[seed]));
        let (origin, present_s) = ("test".to_owned(), ALWAYS_S);
        Walk { id: 0, origin, path, motion, gait, present_s }
    }

    #[test]
    fn a_stance_stands_still_for_four_tenths_and_a_leg_leads_by_a_foot() {
        for seed in 0..5 {
            let walk = walker(seed);
            let ticks: Vec<_> = (1500..3000).map(|i| f64::from(i) * 0.01).collect();
            let still =
                |t: f64| norm(sub(walk.leg(t, 0.0).centre, walk.leg(t + 0.005, 0.0).centre)) < 1e-9;
            let mut stances = Vec::new();
            let mut run = 0;
            for &t in &ticks {
                if still(t) {
                    run += 1;
                } else if run > 0 {
                    stances.push(run);
                    run = 0;
                }
            }
            let full = &stances[1..];
            assert!(full.len() > 10);
            assert!(full.iter().all(|n| (38..=41).contains(n)), "{full:?}");
            let lead = ticks
                .iter()
                .map(|&t| walk.leg(t, 1.0).centre[0] - walk.stand(t).body[0])
                .fold(0.0, f64::max);
            assert!((0.22..0.36).contains(&lead), "{lead}");
        }
    }

    #[test]
    fn a_leg_of_a_walker_holds_a_cell_for_three_to_six_tenths() {
        let walk = walker(1);
        // The longest stay of a leg over each point of the way, every centimetre, at 200 Hz.
        for cell in 0..200 {
            let place = [12.0 + f64::from(cell) * 0.01, HALF_GAP_M];
            let held = (2000..6800)
                .map(|i| f64::from(i) * 0.005)
                .filter(|&t| {
                    let leg = walk.leg(t, 1.0);
                    norm(sub(leg.centre, place)) < leg.radius_m
                })
                .count() as f64
                * 0.005;
            assert!(held < 0.6, "{held}");
            if cell == 0 {
                assert!(held > 0.0);
            }
        }
        let longest = (0..200)
            .map(|cell| {
                let place = [12.0 + f64::from(cell) * 0.01, HALF_GAP_M];
                (2000..6800)
                    .filter(|&i| {
                        let leg = walk.leg(f64::from(i) * 0.005, 1.0);
                        norm(sub(leg.centre, place)) < leg.radius_m
                    })
                    .count() as f64
                    * 0.005
            })
            .fold(0.0, f64::max);
        assert!((0.4..0.6).contains(&longest), "{longest}");
    }

    #[test]
    fn who_stands_sways_by_less_than_a_centimetre_with_the_legs_apart() {
        let walk = walker(2);
        let home = walk.legs(2.0);
        for tick in 0..600 {
            let legs = walk.legs(2.0 + f64::from(tick) * 0.01);
            assert!(norm(sub(legs[0].centre, home[0].centre)) < 0.015);
            let gap = norm(sub(legs[0].centre, legs[1].centre));
            assert!((gap - 0.18).abs() < 1e-9, "{gap}");
        }
    }

    #[test]
    fn reaches_inverts_the_motion() {
        let walk = walker(3);
        assert_eq!(walk.reaches_s(15.0), Some(22.0));
        assert_eq!(walk.reaches_s(31.0), None);
        assert!((walk.stand(22.0).body[0] - 15.0).abs() < 1e-9);
        assert!((walk.stand(22.0).speed_m_s - 1.25).abs() < 1e-6);
    }
}
