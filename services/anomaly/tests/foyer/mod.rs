//! The whole way from an imagined building to events, in one thread: scene -> scans -> frames ->
//! classes -> `Watch`. Shared by the tests and the example `evaluate`.

#![allow(dead_code)]
#![allow(clippy::unwrap_used)]

use anomaly::{ClassFrame, Watch};
use occupancy::{Fuser, GridConfig, LaserModel, TemporalGrid};
use protocol::event::EventChange;
use protocol::frame::FrameView;
use protocol::site::{Area, Detector, Laser, NoReturn, Preset, Source};
use scene::{Incident, RoutePoint, Scene, World};

/// Frames a second.
pub const RATE_HZ: u64 = 10;
/// Frame of scene time 0: 2023-11-14 22:13:20 UTC.
pub const FRAME_0: u64 = 17_000_000_000;

/// The area of a scene, as the site file would have it.
pub fn area_of(scene: &Scene, detector: Detector) -> Area {
    let grid = scene.area.grid();
    Area {
        id: scene.area.id.clone(),
        host: None,
        standby: None,
        origin_m: grid.origin_m,
        cell_m: grid.cell_m,
        columns: grid.columns,
        rows: grid.rows,
        range_tolerance_m: None,
        frame_period_ms: 100.0,
        scan_age_max_ms: 250.0,
        lateness_max_ms: 150.0,
        laser_lost_ms: 1000.0,
        timescales_s: vec![1.0, 15.0, 60.0],
        preset: Preset::Default,
        classes: Vec::new(),
        transit: None,
        known_share_min: 0.5,
        contexts: Vec::new(),
        checkpoint_s: 10.0,
        detector,
        zones: Vec::new(),
    }
}

/// The lasers of a scene, as the site file would have them.
pub fn lasers_of(scene: &Scene) -> Vec<Laser> {
    let laser = |spec: &scene::LaserSpec| Laser {
        id: spec.id.clone(),
        area: scene.area.id.clone(),
        host: None,
        x_m: spec.x_m,
        y_m: spec.y_m,
        yaw_deg: spec.yaw_deg,
        half_beam_deg: None,
        no_return: NoReturn::Free,
        source: Source::Simulator { scene: scene.name.clone(), seed: 0, rate_hz: 10.0 },
    };
    scene.lasers.iter().map(laser).collect()
}

/// A building with its grid, at a time.
pub struct Building {
    world: World,
    fuser: Fuser,
    grid: TemporalGrid,
    ranges_m: Vec<f32>,
    tenths: u64,
    /// Bit i: laser i delivers.
    pub lasers: u64,
}

impl Building {
    /// A building that begins `start_s` into the scene with an empty grid.
    pub fn new(scene: Scene, seed: u64, start_s: u64) -> Self {
        let area = area_of(&scene, Detector::default());
        let mut fuser = Fuser::new(area.grid(), scene.lasers.len());
        for (index, (spec, laser)) in scene.lasers.iter().zip(lasers_of(&scene)).enumerate() {
            let model = LaserModel::of_site(&laser, &area, spec.geometry(), spec.beams as usize);
            fuser.install(index, &model);
        }
        let lasers = (1 << scene.lasers.len()) - 1;
        Self {
            grid: TemporalGrid::new(GridConfig::of_area(&area)),
            fuser,
            world: World::new(scene, seed).unwrap(),
            ranges_m: Vec::new(),
            tenths: start_s * RATE_HZ,
            lasers,
        }
    }

    /// Seconds of the scene.
    pub fn time_s(&self) -> f64 {
        self.tenths as f64 / RATE_HZ as f64
    }

    /// One frame.
    pub fn step(&mut self) -> ClassFrame<'_> {
        self.tenths += 1;
        let t_s = self.time_s();
        let specs = self.world.scene().lasers.clone();
        for (index, spec) in specs.iter().enumerate() {
            if self.lasers >> index & 1 == 1 {
                self.world.scan(spec, t_s, &mut self.ranges_m);
                self.fuser.apply(index, &self.ranges_m);
            } else {
                self.fuser.retract(index);
            }
        }
        let number = FRAME_0 + self.tenths;
        let frame = FrameView { number, hit: self.fuser.hit(), known: self.fuser.known() };
        self.grid.push(frame, 0);
        ClassFrame { number, lasers_present: self.lasers, context: 0, classes: self.grid.classes() }
    }

    /// The classes after the last frame.
    pub fn classes(&self) -> &[u8] {
        self.grid.classes()
    }

    /// Counts of the collapsed map, [class, row, column].
    pub fn collapsed(&self) -> Vec<u64> {
        let mut counts = vec![0; self.grid.classes().len() * self.grid.config().classes()];
        self.grid.collapsed(0, &mut counts);
        counts
    }

    /// Where those are whose incident begins with `x`.
    pub fn staged_people(&mut self, at_s: f64) -> Vec<[f64; 2]> {
        let people = self.world.truth(at_s).people;
        let staged = people.iter().filter(|person| person.origin.starts_with('x'));
        staged.map(|person| [person.x_m, person.y_m]).collect()
    }

    /// Runs for `seconds` without anybody watching.
    pub fn skip(&mut self, seconds: u64) {
        for _ in 0..seconds * RATE_HZ {
            self.step();
        }
    }

    /// Runs for `seconds` under a watch; what was told, and when (scene seconds).
    pub fn run(&mut self, watch: &mut Watch, seconds: u64) -> Vec<(f64, EventChange)> {
        let mut told = Vec::new();
        let mut changes = Vec::new();
        for _ in 0..seconds * RATE_HZ {
            let frame = self.step();
            watch.handle(&frame, &mut changes);
            let at_s = self.time_s();
            told.extend(changes.drain(..).map(|change| (at_s, change)));
        }
        told
    }
}

/// A point of a walk, with a wait.
pub fn point(at_m: [f64; 2], wait_s: f64) -> RoutePoint {
    RoutePoint { at_m, wait_s: [wait_s, wait_s], spread_m: 0.02 }
}

/// Somebody walks through these points.
pub fn walk(id: &str, at_s: f64, points: &[RoutePoint]) -> Incident {
    Incident::Walk {
        id: id.to_owned(),
        at_s: Some(at_s),
        points: points.to_vec(),
        speed_m_s: [1.0, 1.4],
    }
}

/// Something stands somewhere for a time.
pub fn object(id: &str, at_s: f64, stays_s: f64, centre_m: [f64; 2]) -> Incident {
    Incident::Object {
        id: id.to_owned(),
        at_s: Some(at_s),
        stays_s,
        centre_m,
        size_m: [0.5, 0.35],
        yaw_deg: 20.0,
    }
}
