//! The site file: what a building has, as a type that cannot be wrong.
//!
//! [`Site::parse`] is the only way in. It refuses unknown keys and reports all errors at once, each
//! with the line and a caret. Units are the last word of a key. Every default is stated here and
//! appears in `tog schema`.

use crate::geometry::{GridGeometry, Pose};
use crate::time::{Lattice, MILLISECOND_NS};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A whole site: lasers, areas, and what to do with the alerts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Site {
    /// Name of the site: letters, digits, `-`, `_`; at most 32.
    pub name: String,
    /// IANA time zone for contexts and for the words of alerts.
    #[serde(default = "default_timezone")]
    pub timezone: String,
    /// Directory for checkpoints, learnt maps and the journal; relative to the site file.
    #[serde(default = "default_state_dir")]
    pub state_dir: String,
    /// The areas that are watched.
    #[serde(rename = "area")]
    pub areas: Vec<Area>,
    /// The lasers.
    #[serde(rename = "laser")]
    pub lasers: Vec<Laser>,
}

/// A laser: where it is, where its scans come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Laser {
    /// Name of the laser, unique in the site: letters, digits, `-`, `_`; at most 32.
    pub id: String,
    /// Id of the area that it watches.
    pub area: String,
    /// Site x of the laser, metres.
    pub x_m: f64,
    /// Site y of the laser, metres.
    pub y_m: f64,
    /// Direction of bearing 0, degrees counter-clockwise from site x.
    #[serde(default)]
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
        scene: String,
        /// Seed of noise and walkers; the same for all lasers of one scene.
        #[serde(default)]
        seed: u64,
        /// Scans a second.
        #[serde(default = "default_rate_hz")]
        #[schemars(range(min = 0.1, max = 200.0))]
        rate_hz: f64,
    },
    /// A recording: MCAP of ours or of ROS 2, or a ROS 1 bag.
    Replay {
        /// The recording, relative to the site file.
        recording: String,
        /// Topic of this laser in it; needed if it holds scans on several topics.
        #[serde(default)]
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
    Times(f64),
}

/// An area: one grid, its lasers, its own normal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Area {
    /// Name of the area, unique in the site: letters, digits, `-`, `_`; at most 32.
    pub id: String,
    /// Lower left corner in site coordinates, metres.
    pub origin_m: [f64; 2],
    /// Edge of a cell, metres.
    #[serde(default = "default_cell_m")]
    #[schemars(range(min = 0.01, max = 1.0))]
    pub cell_m: f64,
    /// Cells along x.
    #[schemars(range(min = 1, max = 4096))]
    pub columns: u32,
    /// Cells along y.
    #[schemars(range(min = 1, max = 4096))]
    pub rows: u32,
    /// Half depth of a hit, metres; max(0.01, 0.6 * cell) unless set.
    #[serde(default)]
    #[schemars(range(min = 0.001, max = 1.0))]
    pub range_tolerance_m: Option<f64>,
    /// T: period of the lattice of frames, milliseconds.
    #[serde(default = "default_frame_period_ms")]
    #[schemars(range(min = 1.0, max = 10000.0))]
    pub frame_period_ms: f64,
    /// A scan older than this is not in a frame, milliseconds.
    #[serde(default = "default_scan_age_max_ms")]
    #[schemars(range(min = 1.0, max = 60000.0))]
    pub scan_age_max_ms: f64,
    /// A frame is emitted at the latest this long after its stamp, milliseconds.
    #[serde(default = "default_lateness_max_ms")]
    #[schemars(range(min = 1.0, max = 60000.0))]
    pub lateness_max_ms: f64,
    /// A laser that is silent for this long is not waited for, milliseconds.
    #[serde(default = "default_laser_lost_ms")]
    #[schemars(range(min = 1.0, max = 600000.0))]
    pub laser_lost_ms: f64,
    /// Timescales of the grid, seconds, ascending.
    #[serde(default = "default_timescales_s")]
    #[schemars(length(min = 1, max = 8), inner(range(min = 0.001, max = 86400.0)))]
    pub timescales_s: Vec<f64>,
    /// The classes, unless `class` names them.
    #[serde(default)]
    pub preset: Preset,
    /// Own prototypes instead of a preset; ids in the order of the file.
    #[serde(default, rename = "class")]
    #[schemars(length(max = 15))]
    pub classes: Vec<ClassPrototype>,
    /// Add the class `transit`; as the preset says unless set.
    #[serde(default)]
    pub transit: Option<bool>,
    /// A cell is classified if it is known in at least this share of the longest timescale.
    #[serde(default = "default_known_share_min")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub known_share_min: f64,
    /// Times of the week with their own collapsed map; what no context names is `always`.
    #[serde(default, rename = "context")]
    #[schemars(length(max = 15))]
    pub contexts: Vec<Context>,
    /// Period of checkpoints on disk, seconds.
    #[serde(default = "default_checkpoint_s")]
    #[schemars(range(min = 1.0, max = 3600.0))]
    pub checkpoint_s: f64,
    /// The detector.
    #[serde(default)]
    pub detector: Detector,
    /// Named places.
    #[serde(default, rename = "zone")]
    #[schemars(length(max = 256))]
    pub zones: Vec<Zone>,
}

impl Area {
    /// The grid.
    #[must_use]
    pub fn grid(&self) -> GridGeometry {
        GridGeometry {
            origin_m: self.origin_m,
            cell_m: self.cell_m,
            columns: self.columns,
            rows: self.rows,
        }
    }

    /// The lattice of frames.
    #[must_use]
    pub fn lattice(&self) -> Lattice {
        Lattice::new(milliseconds(self.frame_period_ms))
    }

    /// Half depth of a hit, metres: dr = max(0.01, 0.6 * cell) unless set.
    #[must_use]
    pub fn range_tolerance_m(&self) -> f64 {
        self.range_tolerance_m.unwrap_or_else(|| (0.6 * self.cell_m).max(0.01))
    }

    /// `scan_age_max` in nanoseconds.
    #[must_use]
    pub fn scan_age_max_ns(&self) -> u64 {
        milliseconds(self.scan_age_max_ms)
    }

    /// `lateness_max` in nanoseconds.
    #[must_use]
    pub fn lateness_max_ns(&self) -> u64 {
        milliseconds(self.lateness_max_ms)
    }

    /// `laser_lost` in nanoseconds.
    #[must_use]
    pub fn laser_lost_ns(&self) -> u64 {
        milliseconds(self.laser_lost_ms)
    }

    /// The prototypes in force, in id order: own ones, or the preset's. Does not hold `transit`.
    #[must_use]
    pub fn prototypes(&self) -> Vec<ClassPrototype> {
        if self.classes.is_empty() { self.preset.prototypes() } else { self.classes.clone() }
    }

    /// Whether the class `transit` is on: it takes the id after the last prototype.
    #[must_use]
    pub fn has_transit(&self) -> bool {
        self.transit.unwrap_or(self.preset != Preset::Paper)
    }

    /// Names of all classes by id, `transit` included, `unknown` not.
    #[must_use]
    pub fn class_names(&self) -> Vec<crate::grid::ClassName> {
        let mut names: Vec<String> =
            self.prototypes().into_iter().map(|class| class.name).collect();
        if self.has_transit() {
            names.push("transit".to_owned());
        }
        names
            .into_iter()
            .enumerate()
            .map(|(id, name)| crate::grid::ClassName { id: id as u8, name })
            .collect()
    }
}

/// A set of classes (semantics.md, "Classes").
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// empty, passing, lingering, vacated, background, transit.
    #[default]
    Default,
    /// As `default` without transit.
    Paper,
    /// As `default` with lingering = 0 1 0.
    Onehot,
}

impl Preset {
    /// The prototypes for three timescales.
    #[must_use]
    pub fn prototypes(self) -> Vec<ClassPrototype> {
        let lingering = if self == Self::Onehot { [0.0, 1.0, 0.0] } else { [1.0, 1.0, 0.0] };
        [
            ("empty", [0.0, 0.0, 0.0]),
            ("passing", [1.0, 0.0, 0.0]),
            ("lingering", lingering),
            ("vacated", [0.0, 0.0, 1.0]),
            ("background", [1.0, 1.0, 1.0]),
        ]
        .into_iter()
        .map(|(name, prototype)| ClassPrototype {
            name: name.to_owned(),
            prototype: prototype.to_vec(),
        })
        .collect()
    }

    /// Its name in the site file.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Default => "default",
            Self::Paper => "paper",
            Self::Onehot => "onehot",
        }
    }
}

/// A class and its prototype: one occupancy a timescale.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ClassPrototype {
    /// Name, unique in the area.
    pub name: String,
    /// Occupancy per timescale, 0 empty .. 1 occupied.
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    pub prototype: Vec<f64>,
}

/// A part of the week with a normal of its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Context {
    /// Name, unique in the area; not `always`.
    pub name: String,
    /// Days on which it begins; every day if empty.
    #[serde(default)]
    pub days: Vec<Weekday>,
    /// Begin, `HH:MM` in the site's time zone.
    pub from: String,
    /// End, `HH:MM`; a time at or before `from` means the next day.
    pub to: String,
}

/// A day of the week.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum Weekday {
    Mon,
    Tue,
    Wed,
    Thu,
    Fri,
    Sat,
    Sun,
}

/// A named place in an area.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Zone {
    /// Name that alerts use.
    pub name: String,
    /// Corners in site coordinates, metres.
    #[schemars(length(min = 3, max = 64))]
    pub polygon_m: Vec<[f64; 2]>,
    /// Nothing in an excluded zone is an event.
    #[serde(default)]
    pub exclude: bool,
}

/// How an area's normal is learnt and when something is an alarm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Detector {
    /// Ceiling of false alarms a week; the threshold is learnt so that it holds.
    #[schemars(range(min = 0.001, max = 10000.0))]
    pub alarms_per_week_max: f64,
    /// Time of normal life to learn the map from before the threshold is learnt, seconds.
    #[schemars(range(min = 10.0, max = 31536000.0))]
    pub learning_s: f64,
    /// Time of normal life after that from which the threshold is learnt, seconds.
    #[schemars(range(min = 10.0, max = 31536000.0))]
    pub calibration_s: f64,
    /// Smallest area that is evidence, square metres.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub area_min_m2: f64,
    /// A door that is open for longer is an event, seconds.
    #[schemars(range(min = 1.0, max = 86400.0))]
    pub door_held_open_s: f64,
}

impl Default for Detector {
    fn default() -> Self {
        Self {
            alarms_per_week_max: 3.0,
            learning_s: 6.0 * 3600.0,
            calibration_s: 6.0 * 3600.0,
            area_min_m2: 0.02,
            door_held_open_s: 60.0,
        }
    }
}

fn milliseconds(value_ms: f64) -> u64 {
    (value_ms * MILLISECOND_NS as f64).round() as u64
}

fn default_timezone() -> String {
    "UTC".to_owned()
}
fn default_state_dir() -> String {
    "state".to_owned()
}
fn default_rate_hz() -> f64 {
    10.0
}
fn default_cell_m() -> f64 {
    0.1
}
fn default_frame_period_ms() -> f64 {
    100.0
}
fn default_scan_age_max_ms() -> f64 {
    250.0
}
fn default_lateness_max_ms() -> f64 {
    150.0
}
fn default_laser_lost_ms() -> f64 {
    1000.0
}
fn default_timescales_s() -> Vec<f64> {
    vec![1.0, 15.0, 60.0]
}
fn default_known_share_min() -> f64 {
    0.5
}
fn default_checkpoint_s() -> f64 {
    10.0
}
