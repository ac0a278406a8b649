//! An area in the site file: its grid, its frames, its timescales, its detector.

use super::{ClassPrototype, Context, ID_PATTERN, Preset, Zone};
use crate::geometry::GridGeometry;
use crate::grid::ClassName;
use crate::time::{Lattice, MILLISECOND_NS};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// An area: one grid, its lasers, its own normal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Area {
    /// Name of the area, unique in the site: letters, digits, `-`, `_`; at most 32.
    #[schemars(regex(pattern = ID_PATTERN))]
    pub id: String,
    /// Id of the host that runs this area; needed if the site has hosts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(regex(pattern = ID_PATTERN))]
    pub host: Option<String>,
    /// Id of the host that runs this area while `host` is lost, with the map as it was last copied
    /// there; nobody does unless set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(regex(pattern = ID_PATTERN))]
    pub standby: Option<String>,
    /// Lower left corner in site coordinates, metres.
    #[schemars(inner(range(min = -100_000.0, max = 100_000.0)))]
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

    /// Names of all contexts by index: 0 is `always`, i + 1 the i-th `[[area.context]]`.
    #[must_use]
    pub fn context_names(&self) -> Vec<&str> {
        let named = self.contexts.iter().map(|context| context.name.as_str());
        std::iter::once("always").chain(named).collect()
    }

    /// Names of all classes by id, `transit` included, `unknown` not.
    #[must_use]
    pub fn class_names(&self) -> Vec<ClassName> {
        let mut names: Vec<String> =
            self.prototypes().into_iter().map(|class| class.name).collect();
        if self.has_transit() {
            names.push("transit".to_owned());
        }
        names.into_iter().enumerate().map(|(id, name)| ClassName { id: id as u8, name }).collect()
    }
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

pub(super) fn default_cell_m() -> f64 {
    0.1
}
pub(super) fn default_frame_period_ms() -> f64 {
    100.0
}
pub(super) fn default_scan_age_max_ms() -> f64 {
    250.0
}
pub(super) fn default_lateness_max_ms() -> f64 {
    150.0
}
pub(super) fn default_laser_lost_ms() -> f64 {
    1000.0
}
pub(super) fn default_timescales_s() -> Vec<f64> {
    vec![1.0, 15.0, 60.0]
}
fn default_known_share_min() -> f64 {
    0.5
}
fn default_checkpoint_s() -> f64 {
    10.0
}
