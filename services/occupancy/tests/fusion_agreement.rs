//! The frame: the sensor model cell by cell, the dense fusion, and the incremental one, on random
//! rooms, poses, geometries and readings; and both grids behind them.
#![allow(clippy::unwrap_used)]

mod support;

use occupancy::{Fuser, LaserModel, TemporalGrid, dense, sensor_model};
use proptest::prelude::*;
use protocol::frame::FrameView;
use protocol::geometry::{GridGeometry, Pose};
use protocol::scan::ScanGeometry;
use support::{Pair, Seeded, default_config, evidence};

fn any_grid(random: &mut Seeded, side_max: u64) -> GridGeometry {
    GridGeometry {
        origin_m: [random.between(-9.0, 9.0), random.between(-9.0, 9.0)],
        cell_m: random.between(0.03, 0.3),
        columns: 1 + random.below(side_max) as u32,
        rows: 1 + random.below(side_max) as u32,
    }
}

/// Lasers in and around the grid; full turns, more than a turn, clockwise, wide beams.
fn any_model(random: &mut Seeded, grid: &GridGeometry) -> LaserModel {
    let beams = 1 + random.below(80) as usize;
    let span_rad = random.between(0.1, 7.0);
    let clockwise = if random.chance(0.3) { -1.0 } else { 1.0 };
    let size = [f64::from(grid.columns) * grid.cell_m, f64::from(grid.rows) * grid.cell_m];
    let step = clockwise * span_rad / beams as f64;
    let half = match random.below(4) {
        0 => Some(random.between(0.2, 3.0) * step.abs()),
        1 if random.chance(0.1) => Some(random.between(0.0, 3.5)),
        _ => None,
    };
    LaserModel {
        pose: Pose {
            x_m: grid.origin_m[0] + size[0] * random.between(-0.3, 1.3),
            y_m: grid.origin_m[1] + size[1] * random.between(-0.3, 1.3),
            yaw_rad: random.between(-7.0, 7.0),
        },
        geometry: ScanGeometry {
            angle_min_rad: random.between(-7.0, 7.0),
            angle_increment_rad: step,
            range_min_m: random.between(0.0, 0.3),
            range_max_m: random.between(0.5, 6.0),
        },
        beams,
        half_beam_rad: half,
        range_tolerance_m: random.between(0.01, 0.4),
        no_return_is_free: random.chance(0.7),
    }
}

/// Numbers that are exact in binary: an echo can then lie exactly dr from the centre of a cell, where
/// it is neither a hit nor a miss.
fn make_round(grid: &mut GridGeometry, models: &mut [LaserModel]) {
    let round = |value: f64| (value * 16.0).round() / 16.0;
    grid.cell_m = 0.125;
    grid.origin_m = grid.origin_m.map(round);
    for model in models {
        (model.pose.x_m, model.pose.y_m) = (round(model.pose.x_m), round(model.pose.y_m));
        model.range_tolerance_m = round(model.range_tolerance_m).max(0.0625);
        model.geometry.range_max_m = round(model.geometry.range_max_m);
    }
}

/// Readings that drift, jump, vanish and break; also exactly at the borders of cells.
fn next_scan(random: &mut Seeded, model: &LaserModel, grid: &GridGeometry, ranges_m: &mut [f32]) {
    let restless = random.unit();
    for range_m in ranges_m {
        if random.chance(restless) {
            continue;
        }
        *range_m = match random.below(12) {
            0 => f32::INFINITY,
            1 => [f32::NAN, f32::NEG_INFINITY, 0.0, -3.0][random.below(4) as usize],
            2 | 3 => random.between(0.0, model.geometry.range_max_m * 1.05) as f32,
            4 => {
                let cell = random.below(grid.cells() as u64) as usize;
                let (rho, _) = model.polar(grid.centre_of_index_m(cell));
                let dr = model.range_tolerance_m * [-1.0, 0.0, 1.0][random.below(3) as usize];
                (rho + dr) as f32
            }
            _ => *range_m + random.between(-0.05, 0.05) as f32,
        };
    }
}

struct Scene {
    grid: GridGeometry,
    models: Vec<LaserModel>,
    ranges_m: Vec<Vec<f32>>,
    present: Vec<bool>,
}

impl Scene {
    fn new(random: &mut Seeded, side_max: u64) -> Self {
        let mut grid = any_grid(random, side_max);
        let mut models: Vec<_> =
            (0..1 + random.below(4)).map(|_| any_model(random, &grid)).collect();
        if random.chance(0.25) {
            make_round(&mut grid, &mut models);
        }
        let ranges_m = models.iter().map(|model| vec![1.0; model.beams]).collect();
        let present = vec![false; models.len()];
        Self { grid, models, ranges_m, present }
    }

    fn install(&self) -> Fuser {
        let mut fuser = Fuser::new(self.grid, self.models.len());
        for (laser, model) in self.models.iter().enumerate() {
            fuser.install(laser, model);
        }
        fuser
    }

    /// Lasers come, go and scan, in any order.
    fn step(&mut self, random: &mut Seeded, fuser: &mut Fuser) {
        let first = random.below(self.models.len() as u64) as usize;
        for turn in 0..self.models.len() {
            let laser = (first + turn) % self.models.len();
            match random.below(12) {
                0 => {
                    self.present[laser] = false;
                    fuser.retract(laser);
                }
                1..=3 => {}
                _ => {
                    let ranges_m = &mut self.ranges_m[laser];
                    next_scan(random, &self.models[laser], &self.grid, ranges_m);
                    self.present[laser] = true;
                    fuser.apply(laser, ranges_m);
                }
            }
        }
    }

    fn scans(&self) -> Vec<Option<&[f32]>> {
        let scans = self.ranges_m.iter().zip(&self.present);
        scans.map(|(ranges_m, &here)| here.then_some(ranges_m.as_slice())).collect()
    }
}

fn frames_agree(seed: u64, steps: usize) {
    let mut random = Seeded(seed);
    let mut scene = Scene::new(&mut random, 12);
    let mut fuser = scene.install();
    let mut dense = dense::Fuser::new(&scene.grid, &scene.models);
    let mut before = vec![0; scene.grid.cells()];
    for step in 0..steps {
        scene.step(&mut random, &mut fuser);
        if random.chance(0.03) {
            // Moved by a hand: a new model for an old number.
            let laser = random.below(scene.models.len() as u64) as usize;
            scene.models[laser] = any_model(&mut random, &scene.grid);
            scene.ranges_m[laser] = vec![1.0; scene.models[laser].beams];
            scene.present[laser] = false;
            fuser.install(laser, &scene.models[laser]);
            dense = dense::Fuser::new(&scene.grid, &scene.models);
        }
        let literal: Vec<u8> =
            sensor_model::literal_frame(&scene.grid, &scene.models, &scene.scans())
                .into_iter()
                .map(|evidence| evidence as u8)
                .collect();
        let now = evidence(fuser.hit(), fuser.known(), scene.grid.cells());
        assert_eq!(dense.fuse(&scene.scans()), literal, "dense, step {step}");
        assert_eq!(now, literal, "incremental, step {step}");
        let hidden = fuser.hit().iter().zip(fuser.known()).any(|(hit, known)| hit & !known != 0);
        assert!(!hidden, "hit implies known");
        for (cell, (before, now)) in before.iter().zip(&now).enumerate() {
            assert!(before == now || fuser.changed_cells().contains(&(cell as u32)), "{cell}");
        }
        if random.chance(0.7) {
            fuser.clear_changed();
            before = now;
        }
    }
}

/// Scans to classes, both ways, with missing frames; the incremental side by its change lists.
fn pipelines_agree(seed: u64, frames: usize) {
    let mut random = Seeded(seed);
    let mut scene = Scene::new(&mut random, 20);
    let mut fuser = scene.install();
    let mut dense = dense::Fuser::new(&scene.grid, &scene.models);
    let config = default_config(scene.grid.cells(), [3, 9, 30]);
    let mut pair = Pair::new(config.clone());
    let mut by_list = TemporalGrid::new(config);
    let mut number = random.below(1000);
    for _ in 0..frames {
        scene.step(&mut random, &mut fuser);
        let most = if random.chance(0.05) { 20 } else { 1 };
        number += 1 + random.below(most);
        let frame = FrameView { number, hit: fuser.hit(), known: fuser.known() };
        pair.dense.push(number, dense.fuse(&scene.scans()), 0);
        pair.grid.push(frame, 0);
        by_list.push_changed(frame, fuser.changed_cells(), 0);
        fuser.clear_changed();
        pair.assert_equal();
        assert_eq!(by_list.classes(), pair.grid.classes());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]
    #[test]
    fn both_fusions_are_the_sensor_model_cell_by_cell(seed: u64) {
        frames_agree(seed, 30);
    }

    #[test]
    fn scans_give_the_same_classes_both_ways(seed: u64) {
        pipelines_agree(seed, 60);
    }
}

#[test]
fn both_fusions_agree_for_a_night() {
    if std::env::var_os("TOG_NIGHTLY").is_none() {
        println!("skipped: set TOG_NIGHTLY=1 for 3000 rooms");
        return;
    }
    for seed in 0..3000 {
        frames_agree(seed, 60);
        pipelines_agree(seed ^ 0xabcd, 100);
    }
}
