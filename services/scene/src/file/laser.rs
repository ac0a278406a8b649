//! Lasers of a scene file, and what they add to the truth.

use protocol::geometry::Pose;
use protocol::scan::ScanGeometry;
use serde::{Deserialize, Serialize};

/// What a laser adds to the true range (measured shares: SICK LMS 200, 0.73 + 0.31 + 0.013 %
/// codes).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sensor {
    /// Standard deviation of a range, metres, 0..=1.
    pub sigma_m: f64,
    /// Every laser has a constant offset, drawn from -bias..bias metres, 0..=1.
    pub bias_m: f64,
    /// Ranges are multiples of this, metres; 0 for none.
    pub quantum_m: f64,
    /// Share of readings that are a fault code (NaN), 0..=1.
    pub fault_share: f64,
    /// Share of readings that are lost to "no return" though something is there, 0..=1.
    pub dropout_share: f64,
    /// True: a spot of 12 mm + 4.4 mrad that straddles an edge may give a range between the two.
    /// The model `lms200` has mixed pixels of its own.
    pub mixed_pixels: bool,
}

/// How a laser turns what is there into readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SensorModel {
    /// One ray a beam, and what [`Sensor`] says.
    #[default]
    Plain,
    /// A SICK LMS 200: its wide spot, dazzle and dust besides. See the page of the `lms200` module.
    Lms200,
}

impl Default for Sensor {
    fn default() -> Self {
        Self {
            sigma_m: 0.01,
            bias_m: 0.0,
            quantum_m: 0.0,
            fault_share: 0.0105,
            dropout_share: 0.0,
            mixed_pixels: false,
        }
    }
}

/// A laser: where it stands and how its beams lie.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaserSpec {
    /// Id; also the key of its noise.
    pub id: String,
    /// Site x, metres.
    pub x_m: f64,
    /// Site y, metres.
    pub y_m: f64,
    /// Direction of bearing 0, degrees counter-clockwise from site x.
    pub yaw_deg: f64,
    /// Bearing of beam 0, degrees.
    #[serde(default = "minus_ninety")]
    pub angle_min_deg: f64,
    /// Bearing from beam to beam, degrees; negative turns clockwise.
    #[serde(default = "one")]
    pub angle_increment_deg: f64,
    /// Number of beams.
    #[serde(default = "beams")]
    pub beams: u32,
    /// Shortest valid reading, metres.
    #[serde(default = "range_min_m")]
    pub range_min_m: f64,
    /// Readings at or above this are "no return", metres.
    #[serde(default = "range_max_m")]
    pub range_max_m: f64,
    /// What it makes of what is there.
    #[serde(default)]
    pub model: SensorModel,
}

impl LaserSpec {
    /// The beams of an LMS 200 at a pose: 181 of 1 degree, 8 m; the plain sensor model.
    #[must_use]
    pub fn lms200(id: &str, x_m: f64, y_m: f64, yaw_deg: f64) -> Self {
        Self {
            id: id.to_owned(),
            x_m,
            y_m,
            yaw_deg,
            angle_min_deg: minus_ninety(),
            angle_increment_deg: one(),
            beams: beams(),
            range_min_m: range_min_m(),
            range_max_m: range_max_m(),
            model: SensorModel::Plain,
        }
    }

    /// `site_from_laser`.
    #[must_use]
    pub fn pose(&self) -> Pose {
        Pose { x_m: self.x_m, y_m: self.y_m, yaw_rad: self.yaw_deg.to_radians() }
    }

    /// How the beams lie, as a scan says it. The numbers are rounded to f32, which is what
    /// recordings hold: a recording of a simulated laser replays to the same bits.
    #[must_use]
    pub fn geometry(&self) -> ScanGeometry {
        let round = |value: f64| f64::from(value as f32);
        ScanGeometry {
            angle_min_rad: round(self.angle_min_deg.to_radians()),
            angle_increment_rad: round(self.angle_increment_deg.to_radians()),
            range_min_m: round(self.range_min_m),
            range_max_m: round(self.range_max_m),
        }
    }
}

fn minus_ninety() -> f64 {
    -90.0
}
fn one() -> f64 {
    1.0
}
fn beams() -> u32 {
    181
}
fn range_min_m() -> f64 {
    0.02
}
fn range_max_m() -> f64 {
    8.0
}
