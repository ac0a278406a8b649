//! A laser in the site file: where it is and where its scans come from.

use super::ID_PATTERN;
use crate::geometry::Pose;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A laser: where it is, where its scans come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Laser {
    /// Name of the laser, unique in the site: letters, digits, `-`, `_`; at most 32.
    #[schemars(regex(pattern = ID_PATTERN))]
    pub id: String,
    /// Id of the area that it watches.
    #[schemars(regex(pattern = ID_PATTERN))]
    pub area: String,
    /// Id of the host that runs this laser; that of its area unless set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(regex(pattern = ID_PATTERN))]
    pub host: Option<String>,
    /// Site x of the laser, metres.
    #[schemars(range(min = -100_000.0, max = 100_000.0))]
    pub x_m: f64,
    /// Site y of the laser, metres.
    #[schemars(range(min = -100_000.0, max = 100_000.0))]
    pub y_m: f64,
    /// Direction of bearing 0, degrees counter-clockwise from site x.
    #[serde(default)]
    #[schemars(range(min = -360.0, max = 360.0))]
    pub yaw_deg: f64,
    /// Half width of a beam, degrees; half the angular increment unless set.
    #[serde(default)]
    #[schemars(range(min = 0.001, max = 45.0))]
    pub half_beam_deg: Option<f64>,
    /// What a reading of "no return" says of the cells up to the maximum range.
    #[serde(default)]
    pub no_return: NoReturn,
    /// Where the scans come from.
    pub source: Source,
}

impl Laser {
    /// `site_from_laser`.
    #[must_use]
    pub fn pose(&self) -> Pose {
        Pose { x_m: self.x_m, y_m: self.y_m, yaw_rad: self.yaw_deg.to_radians() }
    }
}

/// What "no return" says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NoReturn {
    /// The beam met nothing: free up to range_max.
    #[default]
    Free,
    /// Glass and black surfaces are common here: it says nothing.
    Unknown,
}

/// Where scans come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Source {
    /// An imagined building.
    Simulator {
        /// Scene file (TOML), relative to the site file; or the name of a built-in scene.
        #[schemars(length(min = 1, max = 1024))]
        scene: String,
        /// Seed of noise and walkers; the same for all lasers of one scene.
        #[serde(default)]
        seed: u64,
        /// Scans a second.
        #[serde(default = "default_rate_hz")]
        #[schemars(range(min = 0.1, max = 200.0))]
        rate_hz: f64,
    },
    /// A recording of any format that `tog bag info` reads: MCAP, a ROS 1 or 2 bag, a log, a CSV.
    Replay {
        /// The recording, relative to the site file.
        #[schemars(length(min = 1, max = 1024))]
        recording: String,
        /// Topic of this laser in it; needed if it holds scans on several topics.
        #[serde(default)]
        #[schemars(length(min = 1, max = 1024))]
        topic: Option<String>,
        /// How fast; the same for all lasers of a site.
        #[serde(default)]
        pace: Pace,
    },
}

/// How fast a recording is replayed.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Pace {
    /// As it was recorded.
    #[default]
    RealTime,
    /// As fast as the slowest reader, without losing a scan.
    Lossless,
    /// So many times real time.
    #[serde(untagged)]
    Times(#[schemars(range(min = 0.01, max = 10_000.0))] f64),
}

pub(super) fn default_rate_hz() -> f64 {
    10.0
}
