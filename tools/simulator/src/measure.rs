//! How alive a workload is: the figures that the performance targets were measured at.

use crate::workload::{Workload, WorkloadLaser};
use protocol::geometry::{GridGeometry, wrap_rad};
use protocol::scan::{Reading, reading};
use serde::Serialize;

/// What a workload does, averaged over its frames.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Liveliness {
    /// Name of the workload.
    pub name: &'static str,
    /// Frames that were looked at.
    pub frames: u64,
    /// Beams of all lasers.
    pub beams: usize,
    /// Share of readings that are "no return".
    pub no_return_share: f64,
    /// Share of readings that are invalid.
    pub invalid_share: f64,
    /// Beams a frame whose reading says something else of some cell than the frame before.
    pub beams_changed: f64,
    /// People in the scene, on average.
    pub people: f64,
}

impl Liveliness {
    /// Runs a workload to its end. `range_tolerance_m` is dr of the sensor model (Eq. 6).
    #[must_use]
    pub fn of(workload: &mut Workload, range_tolerance_m: f64) -> Self {
        let borders: Vec<Vec<Vec<f64>>> = (workload.lasers.iter())
            .map(|laser| borders(laser, &workload.grid, range_tolerance_m))
            .collect();
        let beams = workload.lasers.iter().map(|laser| laser.beams as usize).sum();
        let mut out = workload.buffers();
        let mut last: Vec<usize> = Vec::new();
        let (mut none, mut invalid, mut changed, mut people, mut frames) = (0, 0, 0, 0, 0_u64);
        while workload.frame(&mut out) {
            let mut states = Vec::with_capacity(beams);
            for ((laser, ranges_m), borders) in workload.lasers.iter().zip(&out).zip(&borders) {
                for (&range_m, borders) in ranges_m.iter().zip(borders) {
                    states.push(match reading(range_m, &laser.geometry) {
                        Reading::Echo(r) => borders.partition_point(|&border| border < r),
                        Reading::NoReturn => {
                            none += 1;
                            usize::MAX
                        }
                        Reading::Invalid => {
                            invalid += 1;
                            usize::MAX - 1
                        }
                    });
                }
            }
            changed += states.iter().zip(&last).filter(|(now, then)| now != then).count();
            last = states;
            let t_s = frames as f64 * workload.frame_period_ns as f64 * 1e-9;
            people += workload.world_mut().truth(t_s).people.len();
            frames += 1;
        }
        let readings = (frames.max(1) * beams as u64) as f64;
        Self {
            name: workload.name,
            frames,
            beams,
            no_return_share: f64::from(none) / readings,
            invalid_share: f64::from(invalid) / readings,
            beams_changed: changed as f64 / (frames.max(2) - 1) as f64,
            people: people as f64 / frames.max(1) as f64,
        }
    }
}

/// Per beam, the ranges at which the reading begins to say something else of a cell of the beam's
/// wedge: rho - dr (miss ends, hit begins) and rho + dr (hit ends), rising.
fn borders(laser: &WorkloadLaser, grid: &GridGeometry, dr_m: f64) -> Vec<Vec<f64>> {
    let mut borders = vec![Vec::new(); laser.beams as usize];
    let geometry = &laser.geometry;
    for index in 0..grid.cells() {
        let [x, y] = grid.centre_of_index_m(index);
        let (dx, dy) = (x - laser.pose.x_m, y - laser.pose.y_m);
        let rho = dx.hypot(dy);
        let middle = geometry.angle_min_rad
            + geometry.angle_increment_rad * (f64::from(laser.beams) - 1.0) / 2.0;
        let bearing = middle + wrap_rad(dy.atan2(dx) - laser.pose.yaw_rad - middle);
        let beam = ((bearing - geometry.angle_min_rad) / geometry.angle_increment_rad).round();
        if rho < geometry.range_max_m + dr_m && (0.0..f64::from(laser.beams)).contains(&beam) {
            borders[beam as usize].extend([rho - dr_m, rho + dr_m]);
        }
    }
    for list in &mut borders {
        list.sort_by(f64::total_cmp);
    }
    borders
}
