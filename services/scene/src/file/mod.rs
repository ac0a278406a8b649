//! The scene file: what stands, swings and walks. Plain data; bounds are in `check`.
//!
//! Metres in site coordinates, seconds, degrees counter-clockwise. Times of a scene (`t_s`) count
//! from its anchor, so that they stay small and exact.

use crate::error::SceneError;
use protocol::geometry::GridGeometry;
use protocol::time::SECOND_NS;
use serde::{Deserialize, Serialize};

pub use door::{Opening, SlidingDoor, SlidingLeaf, SwingDoor};
pub use laser::{LaserSpec, Sensor, SensorModel};
pub use people::{Incident, Loop, Route, RoutePoint, Wander};

mod door;
mod laser;
mod people;

/// 2026-01-01T00:00:00Z.
const ANCHOR_UNIX_S: u64 = 1_767_225_600;

/// A whole imagined building.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Name of the scene.
    pub name: String,
    /// What happens here, for people.
    #[serde(default)]
    pub about: String,
    /// The instant `t_s = 0`, seconds of the UNIX epoch.
    #[serde(default = "anchor_unix_s")]
    pub anchor_unix_s: u64,
    /// The area that a site file would watch.
    pub area: Area,
    /// What the lasers add to the truth.
    #[serde(default)]
    pub sensor: Sensor,
    /// The lasers, where they really are.
    #[serde(default, rename = "laser")]
    pub lasers: Vec<LaserSpec>,
    /// Thin walls.
    #[serde(default, rename = "wall")]
    pub walls: Vec<Wall>,
    /// Furniture and other objects: rotated rectangles.
    #[serde(default, rename = "box")]
    pub boxes: Vec<BoxObject>,
    /// Round pillars, pots, bins.
    #[serde(default, rename = "pillar")]
    pub pillars: Vec<Pillar>,
    /// Doors on a hinge.
    #[serde(default, rename = "door")]
    pub doors: Vec<SwingDoor>,
    /// Doors that slide: elevators.
    #[serde(default, rename = "sliding_door")]
    pub sliding_doors: Vec<SlidingDoor>,
    /// Ways on which people arrive, wait and leave.
    #[serde(default, rename = "route")]
    pub routes: Vec<Route>,
    /// Closed ways on which people walk round for ever.
    #[serde(default, rename = "loop")]
    pub loops: Vec<Loop>,
    /// People who stay and wander between places.
    #[serde(default, rename = "wander")]
    pub wanders: Vec<Wander>,
    /// Single scripted events.
    #[serde(default, rename = "incident")]
    pub incidents: Vec<Incident>,
}

/// The grid that a site file would lay over the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Area {
    /// Id of the area.
    pub id: String,
    /// Lower left corner, metres.
    pub origin_m: [f64; 2],
    /// Edge of a cell, metres.
    pub cell_m: f64,
    /// Cells along x.
    pub columns: u32,
    /// Cells along y.
    pub rows: u32,
}

impl Area {
    /// The grid.
    #[must_use]
    pub fn grid(&self) -> GridGeometry {
        let Self { origin_m, cell_m, columns, rows, .. } = *self;
        GridGeometry { origin_m, cell_m, columns, rows }
    }
}

/// A thin wall.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wall {
    /// Corners, metres; at least two.
    pub points_m: Vec<[f64; 2]>,
    /// True: the last corner is joined to the first.
    #[serde(default)]
    pub closed: bool,
}

/// A rotated rectangle that stands there, for ever or for a time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoxObject {
    /// What it is, for the truth.
    #[serde(default)]
    pub id: String,
    /// Centre, metres.
    pub centre_m: [f64; 2],
    /// Length and width before turning, metres.
    pub size_m: [f64; 2],
    /// Turn, degrees.
    #[serde(default)]
    pub yaw_deg: f64,
    /// Not there before this time, seconds.
    #[serde(default)]
    pub appears_s: Option<f64>,
    /// Not there from this time on, seconds.
    #[serde(default)]
    pub vanishes_s: Option<f64>,
}

/// A round object that stands there, for ever or for a time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pillar {
    /// What it is, for the truth.
    #[serde(default)]
    pub id: String,
    /// Centre, metres.
    pub centre_m: [f64; 2],
    /// Radius, metres.
    pub radius_m: f64,
    /// Not there before this time, seconds.
    #[serde(default)]
    pub appears_s: Option<f64>,
    /// Not there from this time on, seconds.
    #[serde(default)]
    pub vanishes_s: Option<f64>,
}

impl Scene {
    /// Reads a scene file. `name` is said in errors.
    ///
    /// # Errors
    /// The line and a caret if it is not TOML of a scene; else every bound that is broken, in
    /// words.
    pub fn parse(text: &str, name: &str) -> Result<Self, SceneError> {
        if text.len() > SCENE_BYTES_MAX {
            return Err(SceneError::TooLarge { name: name.to_owned(), found: text.len() });
        }
        let scene: Self = toml::from_str(text).map_err(|error| SceneError::Syntax {
            name: name.to_owned(),
            message: error.to_string(),
        })?;
        scene.check()?;
        Ok(scene)
    }

    /// The scene with one more incident.
    ///
    /// # Errors
    /// If the incident breaks a bound: walks through a wall, names no door.
    pub fn with_incident(mut self, incident: Incident) -> Result<Self, SceneError> {
        self.incidents.push(incident);
        self.check()?;
        Ok(self)
    }

    /// The scene with its incident `id` at `t_s`, seconds of the scene.
    ///
    /// # Errors
    /// If there is no such incident; the message lists those that are.
    pub fn staged(self, id: &str, t_s: f64) -> Result<Self, SceneError> {
        let Some(incident) = self.incidents.iter().find(|incident| incident.id() == id) else {
            let known = self.incidents.iter().map(|i| i.id().to_owned()).collect();
            let (scene, id) = (self.name, id.to_owned());
            return Err(SceneError::NoIncident { scene, id, known });
        };
        let incident = incident.clone().at(t_s);
        self.with_incident(incident)
    }

    /// All arrivals `factor` times as often.
    ///
    /// # Errors
    /// If that breaks a bound.
    pub fn with_arrivals_times(mut self, factor: f64) -> Result<Self, SceneError> {
        for route in &mut self.routes {
            route.arrivals_per_hour *= factor;
        }
        self.check()?;
        Ok(self)
    }

    /// The laser of this id.
    #[must_use]
    pub fn laser(&self, id: &str) -> Option<&LaserSpec> {
        self.lasers.iter().find(|laser| laser.id == id)
    }

    /// Scene time of a stamp, seconds since the anchor.
    #[must_use]
    pub fn time_s(&self, stamp_ns: u64) -> f64 {
        let anchor_ns = i128::from(self.anchor_unix_s) * i128::from(SECOND_NS);
        (i128::from(stamp_ns) - anchor_ns) as f64 / SECOND_NS as f64
    }

    /// Stamp of a scene time, UNIX nanoseconds; saturates at both ends of u64.
    #[must_use]
    pub fn stamp_ns(&self, t_s: f64) -> u64 {
        let anchor_ns = i128::from(self.anchor_unix_s) * i128::from(SECOND_NS);
        let since_ns = (t_s * SECOND_NS as f64).round() as i128; // saturates; NaN is the anchor
        anchor_ns.saturating_add(since_ns).clamp(0, i128::from(u64::MAX)) as u64
    }
}

/// Largest scene file, bytes: a thousand walls are 60 kB; 1 MiB is no scene.
pub const SCENE_BYTES_MAX: usize = 1 << 20;

fn anchor_unix_s() -> u64 {
    ANCHOR_UNIX_S
}
