//! The turned workloads W1r, W2r and W3r of the performance targets.
//!
//! | | lasers x beams | range | grid | rate | scene |
//! |---|---|---|---|---|---|
//! | W1r | 4 x 181 (1 deg) | 8 m | 400x400 @ 5 cm | 75 Hz | room, 4 walkers, turned by 17 deg |
//! | W2r | 1 x 181 (1 deg) | 8 m | 200x200 @ 5 cm | 75 Hz | foyer, a party every 10 s, 5 deg |
//! | W3r | 16 x 1081 (0.25 deg) | 30 m | 1200x1200 @ 5 cm | 25 Hz | hall, 30 walkers, 2 deg |
//!
//! Noise 1 cm, readings are multiples of 1 mm, no fault codes. The rooms are turned and shifted off
//! the lattice because walls on cell edges flatter a benchmark: a range is the same in both, so the
//! scene stays as it is drawn and the lasers' poses are turned.

use protocol::geometry::{GridGeometry, Pose};
use protocol::scan::ScanGeometry;
use scene::{Area, BoxObject, LaserSpec, Pillar, Scene, SceneError, Sensor, Wall, Wander, World};

/// One laser of a workload.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorkloadLaser {
    /// `site_from_laser` in the coordinates of the grid.
    pub pose: Pose,
    /// How its beams lie.
    pub geometry: ScanGeometry,
    /// Number of beams.
    pub beams: u32,
}

/// A stream of frames: for each, the raw ranges of every laser.
#[derive(Debug, Clone)]
pub struct Workload {
    /// `W1r`, `W2r` or `W3r`.
    pub name: &'static str,
    /// The grid that the lasers are fused on.
    pub grid: GridGeometry,
    /// The lasers.
    pub lasers: Vec<WorkloadLaser>,
    /// T, nanoseconds; frame m is stamped m * T.
    pub frame_period_ns: u64,
    /// How many frames [`Workload::frame`] gives.
    pub frames: u64,
    next: u64,
    specs: Vec<LaserSpec>,
    world: World,
}

impl Workload {
    /// Fills `out[laser]` with the ranges of the next frame, metres, and says true; false after the
    /// last. `out` must have as many vectors as there are lasers, of any length: they are resized
    /// once.
    ///
    /// # Panics
    /// If `out` has another number of vectors.
    pub fn frame(&mut self, out: &mut [Vec<f32>]) -> bool {
        assert_eq!(out.len(), self.specs.len(), "one vector a laser");
        if self.next >= self.frames {
            return false;
        }
        let t_s = self.next as f64 * self.frame_period_ns as f64 * 1e-9;
        for (spec, ranges_m) in self.specs.iter().zip(out) {
            self.world.scan(spec, t_s, ranges_m);
        }
        self.next += 1;
        true
    }

    /// Begins again with frame 0.
    pub fn rewind(&mut self) {
        self.next = 0;
    }

    /// Number of the frame that comes next.
    #[must_use]
    pub fn next_frame(&self) -> u64 {
        self.next
    }

    /// Empty vectors for [`Workload::frame`].
    #[must_use]
    pub fn buffers(&self) -> Vec<Vec<f32>> {
        self.lasers.iter().map(|laser| Vec::with_capacity(laser.beams as usize)).collect()
    }

    /// The lasers as they stand in the imagined building.
    #[must_use]
    pub fn specs(&self) -> &[LaserSpec] {
        &self.specs
    }

    /// The imagined building, in its own coordinates: for the truth.
    pub fn world_mut(&mut self) -> &mut World {
        &mut self.world
    }
}

/// W1r: four lasers in a furnished room with four walkers, 75 Hz.
///
/// # Errors
/// Never with the built-in scene; the type says so to callers who change it.
pub fn w1r(seed: u64, frames: u64) -> Result<Workload, SceneError> {
    let scene = Scene::builtin("room")?;
    let turned = Turned { middle_m: [5.0, 4.5], turn_deg: 17.0, shift_m: [0.0137, -0.0211] };
    build("W1r", scene, seed, frames, 400, 13_333_333, turned)
}

/// W2r: one laser in the foyer, a party every 10 s, 75 Hz; 90 000 frames are 20 minutes.
///
/// # Errors
/// As [`w1r`].
pub fn w2r(seed: u64, frames: u64) -> Result<Workload, SceneError> {
    let foyer = Scene::builtin("foyer")?;
    let per_hour: f64 = foyer.routes.iter().map(|route| route.arrivals_per_hour).sum();
    let mut scene = foyer.with_arrivals_times(360.0 / per_hour)?;
    // 20 cm back: 32 % of the beams see nothing, as in the measured workload.
    scene.lasers[0].y_m = 0.1;
    let turned = Turned { middle_m: [6.0, 4.6], turn_deg: 5.0, shift_m: [0.0137, -0.0211] };
    build("W2r", scene, seed, frames, 200, 13_333_333, turned)
}

/// W3r: sixteen lasers in a hall with pillars, shelves and 30 walkers, 25 Hz.
///
/// # Errors
/// As [`w1r`].
pub fn w3r(seed: u64, frames: u64) -> Result<Workload, SceneError> {
    let turned = Turned { middle_m: [29.0, 29.0], turn_deg: 2.0, shift_m: [0.0137, -0.0211] };
    build("W3r", hall(), seed, frames, 1200, 40_000_000, turned)
}

/// How a scene lies on the lattice: `middle_m` of the scene is the grid's middle, shifted.
struct Turned {
    middle_m: [f64; 2],
    turn_deg: f64,
    shift_m: [f64; 2],
}

impl Turned {
    fn pose(&self, spec: &LaserSpec) -> Pose {
        let (sin, cos) = self.turn_deg.to_radians().sin_cos();
        let (x, y) = (spec.x_m - self.middle_m[0], spec.y_m - self.middle_m[1]);
        Pose {
            x_m: x * cos - y * sin + self.shift_m[0],
            y_m: x * sin + y * cos + self.shift_m[1],
            yaw_rad: (spec.yaw_deg + self.turn_deg).to_radians(),
        }
    }
}

fn build(
    name: &'static str,
    mut scene: Scene,
    seed: u64,
    frames: u64,
    side: u32,
    frame_period_ns: u64,
    turned: Turned,
) -> Result<Workload, SceneError> {
    scene.sensor = Sensor { fault_share: 0.0, quantum_m: 0.001, ..Sensor::default() };
    let specs = scene.lasers.clone();
    let lasers = (specs.iter())
        .map(|spec| WorkloadLaser {
            pose: turned.pose(spec),
            geometry: spec.geometry(),
            beams: spec.beams,
        })
        .collect();
    let cell_m = 0.05;
    let half_m = f64::from(side) * cell_m / 2.0;
    let grid = GridGeometry { origin_m: [-half_m, -half_m], cell_m, columns: side, rows: side };
    let world = World::new(scene, seed)?;
    Ok(Workload { name, grid, lasers, frame_period_ns, frames, next: 0, specs, world })
}

/// A hall of 58 x 58 m: 16 pillars with a laser beside each, 9 shelves, 30 walkers.
fn hall() -> Scene {
    let mut scene = Scene {
        name: "hall".to_owned(),
        about: "58 x 58 m, sixteen lasers, 25 pillars and shelves, thirty walkers".to_owned(),
        anchor_unix_s: 0,
        area: Area {
            id: "hall".to_owned(),
            origin_m: [-1.0, -1.0],
            cell_m: 0.05,
            columns: 1200,
            rows: 1200,
        },
        sensor: Sensor::default(),
        lasers: Vec::new(),
        walls: vec![Wall {
            points_m: vec![[0.0, 0.0], [58.0, 0.0], [58.0, 58.0], [0.0, 58.0]],
            closed: true,
        }],
        boxes: Vec::new(),
        pillars: Vec::new(),
        doors: Vec::new(),
        sliding_doors: Vec::new(),
        routes: Vec::new(),
        loops: Vec::new(),
        wanders: vec![Wander {
            id: "people".to_owned(),
            points_m: (0..36)
                .map(|i| [5.25 + 9.5 * f64::from(i % 6), 5.25 + 9.5 * f64::from(i / 6)])
                .collect(),
            people: 30,
            speed_m_s: [1.1, 1.4],
            pause_s: [0.0, 4.0],
            present_s: None,
        }],
        incidents: Vec::new(),
    };
    for i in 0..25 {
        let (column, row) = (i % 5, i / 5);
        let centre_m = [10.0 + 9.5 * f64::from(column), 10.0 + 9.5 * f64::from(row)];
        let id = format!("{column}-{row}");
        if column == 2 || row == 2 {
            let (size_m, yaw_deg) = ([3.0, 0.8], f64::from(35 * i % 180));
            let (appears_s, vanishes_s) = (None, None);
            scene.boxes.push(BoxObject { id, centre_m, size_m, yaw_deg, appears_s, vanishes_s });
        } else {
            scene.lasers.push(LaserSpec {
                angle_min_deg: -135.0,
                angle_increment_deg: 0.25,
                beams: 1081,
                range_max_m: 30.0,
                ..LaserSpec::lms200(
                    &id,
                    centre_m[0] + 0.45,
                    centre_m[1] + 0.35,
                    f64::from(45 + 90 * (i % 4)),
                )
            });
            let (radius_m, appears_s, vanishes_s) = (0.4, None, None);
            scene.pillars.push(Pillar { id, centre_m, radius_m, appears_s, vanishes_s });
        }
    }
    scene
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::measure::Liveliness;

    #[test]
    fn a_workload_is_the_same_twice_and_after_a_rewind() {
        let mut first = w1r(3, 5).unwrap();
        let mut out = first.buffers();
        let mut frames = Vec::new();
        while first.frame(&mut out) {
            frames.push(out.clone());
        }
        assert_eq!(frames.len(), 5);
        assert_ne!(frames[0], frames[1]);
        let mut second = w1r(3, 5).unwrap();
        for _ in 0..2 {
            for frame in &frames {
                assert!(second.frame(&mut out));
                assert_eq!(*frame, out);
            }
            assert!(!second.frame(&mut out));
            second.rewind();
        }
        let mut other = w1r(4, 5).unwrap();
        assert!(other.frame(&mut out));
        assert_ne!(frames[0], out);
    }

    #[test]
    fn the_workloads_are_as_alive_as_the_measured_ones() {
        let mut w1 = w1r(1, 150).unwrap();
        let life = Liveliness::of(&mut w1, 0.05);
        assert_eq!((w1.grid.cells(), life.beams), (160_000, 724));
        assert!((0.20..0.36).contains(&life.no_return_share), "{life:?}");
        assert!((180.0..320.0).contains(&life.beams_changed), "{life:?}");
        let mut w2 = w2r(1, 150).unwrap();
        let life = Liveliness::of(&mut w2, 0.05);
        assert_eq!((w2.grid.cells(), life.beams), (40_000, 181));
        assert!((0.26..0.38).contains(&life.no_return_share), "{life:?}");
        let mut w3 = w3r(1, 3).unwrap();
        let life = Liveliness::of(&mut w3, 0.05);
        assert_eq!((w3.grid.cells(), life.beams), (1_440_000, 16 * 1081));
        assert!((0.10..0.25).contains(&life.no_return_share), "{life:?}");
    }

    #[test]
    fn every_laser_stands_inside_its_grid() {
        for workload in [w1r(0, 1).unwrap(), w2r(0, 1).unwrap(), w3r(0, 1).unwrap()] {
            for laser in &workload.lasers {
                let at = workload.grid.cell_at(laser.pose.x_m, laser.pose.y_m);
                assert!(at.is_some(), "{} {laser:?}", workload.name);
            }
        }
    }
}
