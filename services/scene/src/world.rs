//! The building at an instant: a pure function of (scene, seed, time), with caches.

use crate::door::Door;
use crate::error::SceneError;
use crate::file::{Incident, LaserSpec, Scene, SensorModel};
use crate::lms200::{self, RAYS_DEG};
use crate::obstacle::{Obstacles, wall_segments};
use crate::population::{Population, SLOT_S};
use crate::seed::{Purpose, name_key, stream};
use crate::sensor;
use crate::shape::{Circle, Segment, rectangle};
use crate::view::View;
use crate::walk::Walk;
use rand::RngExt;
use serde::Serialize;

/// Most views that a world keeps prepared, three for each of 64 lasers; one more drops the oldest.
const VIEWS_MAX: usize = 192;
/// Times beyond are taken for this, seconds: 31 years each way of the anchor, still exact to 0.2
/// us.
const TIME_MAX_S: f64 = 1e9;

/// Something solid, and when it is there.
#[derive(Debug, Clone)]
struct Solid {
    id: String,
    sides: Vec<Segment>,
    round: Option<Circle>,
    from_s: f64,
    until_s: f64,
}

impl Solid {
    fn is_there(&self, t_s: f64) -> bool {
        (self.from_s..self.until_s).contains(&t_s)
    }
}

/// An imagined building that can be looked at at any time, in any order.
#[derive(Debug, Clone)]
pub struct World {
    scene: Scene,
    seed: u64,
    solids: Vec<Solid>,
    /// All times at which something appears or vanishes, rising.
    changes_s: Vec<f64>,
    population: Population,
    doors: Vec<Door>,
    slot: Option<i64>,
    walks: Vec<Walk>,
    views: Vec<View>,
    /// Exact ranges of a scan; those of the model `plain` are in the middle.
    rays_m: [Vec<f64>; 3],
}

/// What is really there at an instant.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Truth {
    /// Seconds since the anchor of the scene.
    pub t_s: f64,
    /// Everybody in the scene, by id.
    pub people: Vec<PersonTruth>,
    /// All doors.
    pub doors: Vec<DoorTruth>,
    /// Ids of the things that come and go, and are there.
    pub objects: Vec<String>,
}

/// One person.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PersonTruth {
    /// Names the person for ever; below 2^53, so that any JSON reader keeps it.
    pub id: u64,
    /// The route, loop, wander group or incident that he belongs to.
    pub origin: String,
    /// Where the body is, metres.
    pub x_m: f64,
    /// See `x_m`.
    pub y_m: f64,
    /// Where he looks, radians.
    pub heading_rad: f64,
    /// How fast he walks; 0 if he stands.
    pub speed_m_s: f64,
    /// The two legs at knee height: [x, y, radius], metres.
    pub legs_m: [[f64; 3]; 2],
}

/// One door.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DoorTruth {
    /// Its id.
    pub id: String,
    /// 0 shut, 1 open.
    pub open_share: f64,
    /// The leaves: [x, y, x, y] of the two ends, metres.
    pub leaves_m: Vec<[f64; 4]>,
}

impl World {
    /// Builds the scene.
    ///
    /// # Errors
    /// If the scene breaks a bound, see [`Scene::check`].
    pub fn new(scene: Scene, seed: u64) -> Result<Self, SceneError> {
        scene.check()?;
        let solids = solids(&scene);
        let mut changes_s: Vec<f64> = (solids.iter())
            .flat_map(|solid| [solid.from_s, solid.until_s])
            .filter(|time| time.is_finite())
            .collect();
        changes_s.sort_by(f64::total_cmp);
        let population = Population::new(&scene, seed, &Obstacles::new(&scene));
        Ok(Self {
            doors: Door::all(&scene),
            scene,
            seed,
            solids,
            changes_s,
            population,
            slot: None,
            walks: Vec::new(),
            views: Vec::new(),
            rays_m: Default::default(),
        })
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Prepares the people round a time. [`World::scan`] and [`World::truth`] do it by themselves.
    pub fn advance_to(&mut self, t_s: f64) {
        let slot = (clamp(t_s) / SLOT_S).floor() as i64;
        if self.slot == Some(slot) {
            return;
        }
        self.slot = Some(slot);
        self.walks.clear();
        self.doors.iter_mut().for_each(Door::clear);
        for (walk, speed_m_s) in self.population.walks(slot) {
            for door in &mut self.doors {
                door.open_for(&walk, speed_m_s);
            }
            self.walks.push(walk);
        }
    }

    /// One scan: the range of every beam in metres, +inf for no return, NaN for a fault code.
    /// Everything is as at `t_s`; the turn of the mirror during the scan is not imagined. Allocates
    /// nothing once the laser is known and `out_m` is large enough, but for new people once a
    /// minute of the scene.
    pub fn scan(&mut self, laser: &LaserSpec, t_s: f64, out_m: &mut Vec<f32>) {
        let mut rays_m = std::mem::take(&mut self.rays_m);
        let (t_s, key) = (clamp(t_s), name_key(&laser.id));
        let mut noise = stream(Purpose::Noise, &[self.seed, key, nanoseconds(t_s)]);
        let sensor = self.scene.sensor;
        let bias_m =
            sensor.bias_m * stream(Purpose::Bias, &[self.seed, key]).random_range(-1.0..=1.0);
        match laser.model {
            SensorModel::Plain => {
                self.true_ranges(laser, t_s, &mut rays_m[1]);
                sensor::measure(&sensor, laser, bias_m, &mut noise, &rays_m[1], out_m);
            }
            SensorModel::Lms200 => {
                for (aside_deg, ray_m) in RAYS_DEG.into_iter().zip(&mut rays_m) {
                    self.true_ranges_aside(laser, aside_deg, t_s, ray_m);
                }
                let blind = lms200::dazzled(laser, self.seed, key, t_s);
                lms200::measure(&sensor, laser, bias_m, &mut noise, &blind, &rays_m, out_m);
            }
        }
        self.rays_m = rays_m;
    }

    /// The exact distance along every beam, metres; +inf where nothing is.
    pub fn true_ranges(&mut self, laser: &LaserSpec, t_s: f64, out_m: &mut Vec<f64>) {
        self.true_ranges_aside(laser, 0.0, t_s, out_m);
    }

    /// As [`World::true_ranges`], along rays that are turned by `aside_deg` from the beams.
    fn true_ranges_aside(
        &mut self,
        laser: &LaserSpec,
        aside_deg: f64,
        t_s: f64,
        out_m: &mut Vec<f64>,
    ) {
        let t_s = clamp(t_s);
        self.advance_to(t_s);
        let index = self.view(laser, aside_deg);
        let epoch = self.changes_s.partition_point(|&change| change <= t_s);
        if !self.views[index].is_of(epoch) {
            let there = || self.solids.iter().filter(|solid| solid.is_there(t_s));
            let sides: Vec<Segment> = there().flat_map(|solid| solid.sides.clone()).collect();
            let rounds: Vec<Circle> = there().filter_map(|solid| solid.round).collect();
            self.views[index].see_background(epoch, &sides, &rounds);
        }
        let view = &self.views[index];
        view.begin(out_m);
        for door in &self.doors {
            for leaf in door.leaves(t_s) {
                view.strike_segment(&leaf, out_m);
            }
        }
        for walk in self.walks.iter().filter(|walk| walk.is_there(t_s)) {
            for leg in &walk.legs(t_s) {
                view.strike_circle(leg, out_m);
            }
        }
    }

    /// What is really there.
    pub fn truth(&mut self, t_s: f64) -> Truth {
        let t_s = clamp(t_s);
        self.advance_to(t_s);
        let mut people: Vec<PersonTruth> = (self.walks.iter())
            .filter(|walk| walk.is_there(t_s))
            .map(|walk| {
                let stand = walk.stand(t_s);
                PersonTruth {
                    id: walk.id >> 11,
                    origin: walk.origin.clone(),
                    x_m: stand.body[0],
                    y_m: stand.body[1],
                    heading_rad: stand.heading_rad,
                    speed_m_s: stand.speed_m_s,
                    legs_m: stand.legs.map(|leg| [leg.centre[0], leg.centre[1], leg.radius_m]),
                }
            })
            .collect();
        people.sort_by_key(|person| person.id);
        let doors = self.doors.iter().map(|door| DoorTruth {
            id: door.id.clone(),
            open_share: door.share(t_s),
            leaves_m: door.leaves(t_s).map(|l| [l.a[0], l.a[1], l.b[0], l.b[1]]).collect(),
        });
        let comes_and_goes = |s: &&Solid| s.from_s.is_finite() || s.until_s.is_finite();
        let objects = (self.solids.iter())
            .filter(comes_and_goes)
            .filter(|solid| solid.is_there(t_s))
            .map(|solid| solid.id.clone());
        Truth { t_s, people, doors: doors.collect(), objects: objects.collect() }
    }

    fn view(&mut self, laser: &LaserSpec, aside_deg: f64) -> usize {
        let is_it = |view: &View| view.aside_deg == aside_deg && view.spec == *laser;
        if let Some(index) = self.views.iter().position(is_it) {
            return index;
        }
        if self.views.len() == VIEWS_MAX {
            self.views.remove(0);
        }
        self.views.push(View::new(laser, aside_deg));
        self.views.len() - 1
    }
}

fn clamp(t_s: f64) -> f64 {
    if t_s.is_nan() { 0.0 } else { t_s.clamp(-TIME_MAX_S, TIME_MAX_S) }
}

/// The key of the noise of a scan: its time, so that every process draws the same.
fn nanoseconds(t_s: f64) -> u64 {
    (t_s * 1e9).round() as i64 as u64
}

fn solids(scene: &Scene) -> Vec<Solid> {
    let always = (f64::NEG_INFINITY, f64::INFINITY);
    let solid = |id: &str, sides, round, (from_s, until_s)| Solid {
        id: id.to_owned(),
        sides,
        round,
        from_s,
        until_s,
    };
    let stay = |from: Option<f64>, until: Option<f64>| {
        (from.unwrap_or(always.0), until.unwrap_or(always.1))
    };
    let walls = (scene.walls.iter())
        .map(|wall| solid("wall", wall_segments(&wall.points_m, wall.closed), None, always));
    let boxes = scene.boxes.iter().map(|item| {
        let sides = rectangle(item.centre_m, item.size_m, item.yaw_deg.to_radians());
        solid(&item.id, sides.to_vec(), None, stay(item.appears_s, item.vanishes_s))
    });
    let pillars = scene.pillars.iter().map(|item| {
        let round = Circle { centre: item.centre_m, radius_m: item.radius_m };
        solid(&item.id, Vec::new(), Some(round), stay(item.appears_s, item.vanishes_s))
    });
    let left = scene.incidents.iter().filter_map(|incident| match incident {
        Incident::Object { id, at_s: Some(at_s), stays_s, centre_m, size_m, yaw_deg } => {
            let sides = rectangle(*centre_m, *size_m, yaw_deg.to_radians());
            Some(solid(id, sides.to_vec(), None, (*at_s, at_s + stays_s)))
        }
        _ => None,
    });
    walls.chain(boxes).chain(pillars).chain(left).collect()
}
