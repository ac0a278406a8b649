//! Who is in the building: everybody of a window of time, as a function of (scene, seed, window).
//!
//! Time is cut into slots. The arrivals of a route in slot s are a Poisson draw keyed by (seed,
//! route, s); a wanderer stands at a place keyed by (seed, person, s) whenever slot s begins.
//! Nothing depends on what was drawn before: any process at any time computes the same people.

use crate::file::{Incident, Loop, Route, RoutePoint, Scene, Wander};
use crate::obstacle::Obstacles;
use crate::path::Path;
use crate::seed::{Purpose, mix, name_key, stream};
use crate::shape::{Point, Segment, norm, sub};
use crate::walk::{ALWAYS_S, Gait, Motion, Walk};
use crate::ways::Ways;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Poisson};
use std::f64::consts::TAU;

/// Length of a slot of arrivals, seconds.
pub(crate) const SLOT_S: f64 = 60.0;
/// Most people that are computed at once: ten foyers full; `check` bounds the expected number far
/// below.
pub(crate) const WALKS_MAX: usize = 2048;
/// The second, third, .. of a party follow after so long, seconds.
const PARTY_GAP_S: f64 = 0.9;

/// Longest stay of a walker of these points, seconds.
pub(crate) fn stay_max_s(points: &[RoutePoint], speed_m_s: [f64; 2], party: u32) -> f64 {
    let way: f64 = (points.windows(2))
        .map(|pair| norm(sub(pair[1].at_m, pair[0].at_m)) + pair[0].spread_m + pair[1].spread_m)
        .sum();
    let waits: f64 = points.iter().map(|point| point.wait_s[1]).sum();
    way / speed_m_s[0] + waits + PARTY_GAP_S * f64::from(party)
}

/// Everybody who can be in a scene.
#[derive(Debug, Clone)]
pub(crate) struct Population {
    seed: u64,
    routes: Vec<Route>,
    loops: Vec<Loop>,
    wanders: Vec<(Wander, Ways)>,
    incidents: Vec<Incident>,
    /// A walker is computed until so long after the begin of the window, seconds.
    stay_max_s: f64,
}

impl Population {
    pub fn new(scene: &Scene, seed: u64, obstacles: &Obstacles) -> Self {
        let wanders = scene.wanders.iter().map(|wander| {
            let ways = Ways::new(&wander.points_m, wander.speed_m_s[0], obstacles);
            (wander.clone(), ways)
        });
        let stays = scene.routes.iter().map(|r| stay_max_s(&r.points, r.speed_m_s, r.party));
        let holds = scene.doors.iter().map(|door| door.hold_s[1] + door.move_s);
        let slides = scene.sliding_doors.iter().map(|door| door.hold_s[1] + door.move_s);
        let most = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
        Self {
            seed,
            routes: scene.routes.clone(),
            loops: scene.loops.clone(),
            wanders: wanders.collect(),
            incidents: scene.incidents.clone(),
            // A door is open for a walker who is gone: keep him for the longest hold, and 20 s.
            stay_max_s: most(&mut { stays }) + most(&mut holds.chain(slides)) + 20.0,
        }
    }

    /// Everybody who is there, or moves a door, in the slot `[slot, slot + 1) * SLOT_S`.
    pub fn walks(&self, slot: i64) -> Vec<(Walk, f64)> {
        let mut walks = Vec::new();
        let back = (self.stay_max_s / SLOT_S).ceil() as i64;
        for (index, route) in self.routes.iter().enumerate() {
            // One slot ahead: a door opens before the walker who comes through it is there.
            for from in slot.saturating_sub(back)..=slot.saturating_add(1) {
                self.arrivals(index as u64, route, from, &mut walks);
            }
        }
        for people in &self.loops {
            self.round_and_round(people, &mut walks);
        }
        let (begin_s, end_s) = (slot as f64 * SLOT_S, (slot as f64 + 1.0) * SLOT_S);
        for (wander, ways) in &self.wanders {
            for person in 0..wander.people {
                let first = (begin_s / ways.slot_s).floor() as i64;
                let last = (end_s / ways.slot_s).floor() as i64;
                for at in first..=last {
                    walks.push(self.wanderer(wander, ways, person, at));
                }
            }
        }
        for incident in &self.incidents {
            if let Incident::Walk { id, at_s: Some(at_s), points, speed_m_s } = incident {
                let key = mix(Purpose::Incident, &[self.seed, name_key(id), at_s.to_bits()]);
                walks.push(walk_of(id, key, points, *speed_m_s, *at_s, (0, 1)));
            }
        }
        walks.truncate(WALKS_MAX);
        walks
    }

    fn arrivals(&self, index: u64, route: &Route, slot: i64, walks: &mut Vec<(Walk, f64)>) {
        let key = [self.seed, index, name_key(&route.id), slot as u64];
        let mut rng = stream(Purpose::Arrival, &key);
        let mean = route.arrivals_per_hour * SLOT_S / 3600.0;
        let Ok(poisson) = Poisson::new(mean) else { return }; // a mean of 0: nobody
        let draw: f64 = poisson.sample(&mut rng);
        // Beyond six sigma it is a number, not a crowd.
        let limit = mean + 6.0 * mean.sqrt() + 6.0;
        for _ in 0..draw.min(limit) as u64 {
            let at_s = (slot as f64 + rng.random::<f64>()) * SLOT_S;
            let key: u64 = rng.random();
            for member in 0..route.party {
                let of = (member, route.party);
                walks.push(walk_of(&route.id, key, &route.points, route.speed_m_s, at_s, of));
            }
        }
    }

    fn round_and_round(&self, people: &Loop, walks: &mut Vec<(Walk, f64)>) {
        let mut common = stream(Purpose::Loop, &[self.seed, name_key(&people.id)]);
        let speed_m_s = between(&mut common, people.speed_m_s);
        for person in 0..people.people {
            let id = mix(Purpose::Loop, &[self.seed, name_key(&people.id), 1 + u64::from(person)]);
            let mut rng = stream(Purpose::Gait, &[id]);
            let corners: Vec<Point> = (people.points_m.iter())
                .map(|&point| scatter(&mut rng, point, people.spread_m, (0, 1)))
                .collect();
            let path = Path::closed(&corners);
            let part = (f64::from(person) + 0.3 * rng.random::<f64>()) / f64::from(people.people);
            let motion = Motion::Steady { from_m: part * path.length_m(), speed_m_s };
            let gait = Gait::draw(&mut rng);
            let (origin, present_s) = (people.id.clone(), present(people.present_s));
            walks.push((Walk { id, origin, path, motion, gait, present_s }, speed_m_s));
        }
    }

    fn wanderer(&self, wander: &Wander, ways: &Ways, person: u32, slot: i64) -> (Walk, f64) {
        let who = mix(Purpose::WanderPlace, &[self.seed, name_key(&wander.id), person.into()]);
        let place = |slot: i64| {
            (mix(Purpose::WanderPlace, &[who, slot as u64]) % wander.points_m.len() as u64) as usize
        };
        let mut rng = stream(Purpose::WanderWay, &[who, slot as u64]);
        let speed_m_s = between(&mut rng, wander.speed_m_s);
        let stops = ways.stroll(&mut rng, place(slot), place(slot + 1), speed_m_s, wander.pause_s);
        let points: Vec<Point> = stops.iter().map(|&(at, _)| wander.points_m[at]).collect();
        let path = Path::open(&points);
        let begin_s = slot as f64 * ways.slot_s;
        let mut knots = vec![(begin_s, 0.0)];
        walk_knots(&path, speed_m_s, stops.iter().map(|&(_, pause_s)| pause_s), &mut knots);
        knots.push((begin_s + ways.slot_s, path.length_m()));
        let gait = Gait::draw(&mut stream(Purpose::Gait, &[who]));
        let motion = Motion::Knots(knots);
        let (origin, present_s) = (wander.id.clone(), present(wander.present_s));
        (Walk { id: who, origin, path, motion, gait, present_s }, speed_m_s)
    }
}

fn present(window_s: Option<[f64; 2]>) -> (f64, f64) {
    window_s.map_or(ALWAYS_S, |[from, until]| (from, until))
}

/// Somebody on a way with waits. `of` is (which, how many) of a party that shares key, waits and
/// speed.
fn walk_of(
    origin: &str,
    key: u64,
    points: &[RoutePoint],
    speed_m_s: [f64; 2],
    at_s: f64,
    of: (u32, u32),
) -> (Walk, f64) {
    let mut rng = stream(Purpose::Gait, &[key]);
    let speed_m_s = between(&mut rng, speed_m_s);
    let waits: Vec<f64> = points.iter().map(|point| between(&mut rng, point.wait_s)).collect();
    let corners: Vec<Point> =
        points.iter().map(|point| scatter(&mut rng, point.at_m, point.spread_m, of)).collect();
    let id = mix(Purpose::Gait, &[key, of.0.into()]);
    let gait = Gait::draw(&mut stream(Purpose::Gait, &[id]));
    let path = Path::open(&corners);
    let mut knots = vec![(at_s + PARTY_GAP_S * f64::from(of.0), 0.0)];
    walk_knots(&path, speed_m_s, waits.into_iter(), &mut knots);
    let (origin, motion) = (origin.to_owned(), Motion::Knots(knots));
    (Walk { id, origin, path, motion, gait, present_s: ALWAYS_S }, speed_m_s)
}

/// From corner to corner at one speed, with a wait at each.
fn walk_knots(
    path: &Path,
    speed_m_s: f64,
    waits_s: impl Iterator<Item = f64>,
    knots: &mut Vec<(f64, f64)>,
) {
    let (mut t_s, mut arc_m) = knots[knots.len() - 1];
    for (corner, wait_s) in waits_s.enumerate() {
        let next_m = path.corner_m(corner);
        if next_m > arc_m {
            t_s += (next_m - arc_m) / speed_m_s;
            arc_m = next_m;
            knots.push((t_s, arc_m));
        }
        if wait_s > 0.0 {
            t_s += wait_s;
            knots.push((t_s, arc_m));
        }
    }
}

/// A point near `point`: anywhere within the spread for one, evenly round its rim for a party.
fn scatter(rng: &mut ChaCha8Rng, point: Point, spread_m: f64, (which, of): (u32, u32)) -> Point {
    let (turn, far): (f64, f64) = (rng.random(), rng.random());
    let (turn, far) =
        if of > 1 { (turn + f64::from(which) / f64::from(of), 1.0) } else { (turn, far.sqrt()) };
    let (sin, cos) = (turn * TAU).sin_cos();
    [point[0] + spread_m * far * cos, point[1] + spread_m * far * sin]
}

fn between(rng: &mut ChaCha8Rng, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

/// The straight pieces that a way is checked along, each with the spread of its walkers.
pub(crate) fn pieces(points: &[RoutePoint]) -> Vec<(Segment, f64)> {
    let corners: Vec<Point> = points.iter().map(|point| point.at_m).collect();
    let path = Path::open(&corners);
    let spread_at = |arc_m: f64| {
        let next = (0..points.len()).find(|&i| path.corner_m(i) > arc_m);
        let next = next.unwrap_or(points.len() - 1);
        points[next].spread_m.max(points[next.saturating_sub(1)].spread_m)
    };
    path.pieces().map(|(at_m, a, b)| (Segment { a, b }, spread_at(at_m))).collect()
}
