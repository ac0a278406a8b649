//! The sensor model, Eq. 6: what one beam says of one cell.
//!
//! Paper: hit (+1), miss (-1) or unknown (0) by the range rho and bearing beta of the cell.
//! Here: the test is at the cell's centre, and the half width of a beam is closed
//! (`|beta - phi| <= dphi`), so that a cell on the border of two beams belongs to both.
//!
//! All of it is f64 and written once, here: the dense and the incremental fusion, and any program
//! written from the same page, evaluate the same comparisons on the same numbers. Every comparison
//! is monotone in rho, also after rounding: along a beam the misses are a prefix of the cells
//! sorted by rho, and the hits are a run of them.

use protocol::frame::Evidence;
use protocol::geometry::{GridGeometry, Pose, wrap_rad};
use protocol::scan::{Reading, ScanGeometry, reading};
use protocol::site;

/// One laser of an area: where it stands and what its beams say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaserModel {
    /// `site_from_laser`.
    pub pose: Pose,
    /// Bearings of the beams, limits of the range.
    pub geometry: ScanGeometry,
    /// Number of beams of a scan, 0..=`BEAMS_MAX`.
    pub beams: usize,
    /// dphi, radians; half the angular increment if `None`.
    pub half_beam_rad: Option<f64>,
    /// dr, metres, > 0.
    pub range_tolerance_m: f64,
    /// Whether "no return" means free up to `range_max_m`; else it says nothing.
    pub no_return_is_free: bool,
}

/// What one reading says along its beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BeamReading {
    /// r of an echo, metres; NaN (near to nothing) if there is no echo.
    pub echo_m: f64,
    /// A cell nearer than this is a miss, metres; -inf if the beam says nothing.
    pub miss_below_m: f64,
}

impl LaserModel {
    /// The laser of a site file, with the geometry that its scans have.
    #[must_use]
    pub fn of_site(
        laser: &site::Laser,
        area: &site::Area,
        geometry: ScanGeometry,
        beams: usize,
    ) -> Self {
        Self {
            pose: laser.pose(),
            geometry,
            beams,
            half_beam_rad: laser.half_beam_deg.map(f64::to_radians),
            range_tolerance_m: area.range_tolerance_m(),
            no_return_is_free: laser.no_return == site::NoReturn::Free,
        }
    }

    /// dphi in force, radians.
    #[must_use]
    pub fn half_width_rad(&self) -> f64 {
        self.half_beam_rad.unwrap_or(self.geometry.angle_increment_rad.abs() / 2.0)
    }

    /// What a raw range (metres, REP 117) says along its beam.
    #[must_use]
    pub fn interpret(&self, range_m: f32) -> BeamReading {
        let dr = self.range_tolerance_m;
        let nothing = BeamReading { echo_m: f64::NAN, miss_below_m: f64::NEG_INFINITY };
        match reading(range_m, &self.geometry) {
            Reading::Echo(r) => BeamReading { echo_m: r, miss_below_m: r - dr },
            Reading::NoReturn if self.no_return_is_free => {
                BeamReading { miss_below_m: self.geometry.range_max_m - dr, ..nothing }
            }
            Reading::NoReturn | Reading::Invalid => nothing,
        }
    }

    /// Range rho (metres) and bearing beta (radians, laser coordinates, wrapped) of a site point.
    #[must_use]
    pub fn polar(&self, point_m: [f64; 2]) -> (f64, f64) {
        let (dx, dy) = self.offset(point_m);
        (distance(dx, dy), self.bearing(dx, dy))
    }

    fn offset(&self, point_m: [f64; 2]) -> (f64, f64) {
        (point_m[0] - self.pose.x_m, point_m[1] - self.pose.y_m)
    }

    fn bearing(&self, dx: f64, dy: f64) -> f64 {
        wrap_rad(dy.atan2(dx) - self.pose.yaw_rad)
    }

    /// Whether a cell at bearing beta belongs to a beam: |beta - phi| <= dphi on the circle.
    #[must_use]
    pub fn beam_covers(&self, beam: usize, beta_rad: f64) -> bool {
        wrap_rad(beta_rad - self.geometry.bearing_rad(beam)).abs() <= self.half_width_rad()
    }

    /// Calls `visit` with every beam that covers bearing beta, ascending, each once.
    ///
    /// Equals the test of all beams with [`LaserModel::beam_covers`]; only looks near the answer.
    pub fn for_each_beam_at(&self, beta_rad: f64, mut visit: impl FnMut(usize)) {
        use std::f64::consts::TAU;
        if self.beams == 0 {
            return;
        }
        // Wider than any rounding of bearings below 5000 rad; the exact test decides.
        const MARGIN_RAD: f64 = 1e-6;
        let first = self.geometry.angle_min_rad;
        let increment = self.geometry.angle_increment_rad;
        let last = self.geometry.bearing_rad(self.beams - 1);
        let reach = self.half_width_rad() + MARGIN_RAD;
        let turn_min = ((first.min(last) - beta_rad - reach) / TAU).ceil() as i64;
        let turn_max = ((first.max(last) - beta_rad + reach) / TAU).floor() as i64;
        let mut next = 0;
        for step in 0..=(turn_max - turn_min).max(-1) {
            let turn = if increment > 0.0 { turn_min + step } else { turn_max - step };
            let middle = beta_rad + turn as f64 * TAU - first;
            let edges = [(middle - reach) / increment, (middle + reach) / increment];
            let end = (self.beams - 1) as f64;
            let low = (edges[0].min(edges[1]).floor() - 1.0).clamp(0.0, end) as usize;
            let high = (edges[0].max(edges[1]).ceil() + 1.0).clamp(0.0, end) as usize;
            for beam in low.max(next)..=high {
                if self.beam_covers(beam, beta_rad) {
                    visit(beam);
                }
                next = beam + 1;
            }
        }
    }

    /// Calls `visit(cell, beam, rho_m)` for every cell of the grid that some reading of some beam
    /// can say something of; cells ascending, then beams.
    pub fn for_each_cell_in_view(
        &self,
        grid: &GridGeometry,
        mut visit: impl FnMut(usize, usize, f64),
    ) {
        // An echo is below range_max, so nothing is hit at or behind range_max + dr.
        let rho_max = self.geometry.range_max_m + self.range_tolerance_m + 1e-6;
        for row in 0..grid.rows {
            for column in 0..grid.columns {
                let (dx, dy) = self.offset(grid.centre_m(column, row));
                let rho = distance(dx, dy);
                if rho <= rho_max {
                    let cell = grid.index(column, row);
                    self.for_each_beam_at(self.bearing(dx, dy), |beam| visit(cell, beam, rho));
                }
            }
        }
    }
}

fn distance(dx: f64, dy: f64) -> f64 {
    (dx * dx + dy * dy).sqrt()
}

impl BeamReading {
    /// |rho - r| < dr.
    #[must_use]
    pub fn hits(&self, rho_m: f64, range_tolerance_m: f64) -> bool {
        (rho_m - self.echo_m).abs() < range_tolerance_m
    }

    /// rho < r - dr.
    #[must_use]
    pub fn misses(&self, rho_m: f64) -> bool {
        rho_m < self.miss_below_m
    }

    /// Eq. 6 for a cell at rho that the beam covers.
    #[must_use]
    pub fn evidence(&self, rho_m: f64, range_tolerance_m: f64) -> Evidence {
        if self.hits(rho_m, range_tolerance_m) {
            Evidence::Hit
        } else if self.misses(rho_m) {
            Evidence::Miss
        } else {
            Evidence::Unknown
        }
    }
}

/// The frame of an area, straight from the page: every cell against every beam of every laser, and
/// the greatest evidence wins (3.3). For small grids: O(cells * beams * lasers).
///
/// `scans[i]` are the ranges (metres) of laser i, `None` if it is absent. Returns [row, column].
#[must_use]
pub fn literal_frame(
    grid: &GridGeometry,
    models: &[LaserModel],
    scans: &[Option<&[f32]>],
) -> Vec<Evidence> {
    let evidence_of = |cell: usize| {
        let mut evidence = Evidence::Unknown;
        for (model, scan) in models.iter().zip(scans) {
            let (rho, beta) = model.polar(grid.centre_of_index_m(cell));
            for (beam, &range_m) in scan.unwrap_or(&[]).iter().enumerate().take(model.beams) {
                if model.beam_covers(beam, beta) {
                    let says = model.interpret(range_m).evidence(rho, model.range_tolerance_m);
                    evidence = evidence.max(says);
                }
            }
        }
        evidence
    };
    (0..grid.cells()).map(evidence_of).collect()
}
