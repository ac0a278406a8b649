//! The scene file: what stands, swings and walks. Plain data; bounds are in `check`.
//!
//! Metres in site coordinates, seconds, degrees counter-clockwise. Times of a scene (`t_s`) count
//! from its anchor, so that they stay small and exact.

use crate::error::SceneError;
use protocol::geometry::{GridGeometry, Pose};
use protocol::scan::ScanGeometry;
use protocol::time::SECOND_NS;
use serde::{Deserialize, Serialize};

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

/// What a laser adds to the true range (measured shares: SICK LMS 200, 0.73 + 0.31 + 0.013 % codes).
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
    pub mixed_pixels: bool,
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
}

impl LaserSpec {
    /// An LMS 200 at a pose: 181 beams of 1 degree, 8 m.
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
        }
    }

    /// `site_from_laser`.
    #[must_use]
    pub fn pose(&self) -> Pose {
        Pose { x_m: self.x_m, y_m: self.y_m, yaw_rad: self.yaw_deg.to_radians() }
    }

    /// How the beams lie, as a scan says it.
    #[must_use]
    pub fn geometry(&self) -> ScanGeometry {
        ScanGeometry {
            angle_min_rad: self.angle_min_deg.to_radians(),
            angle_increment_rad: self.angle_increment_deg.to_radians(),
            range_min_m: self.range_min_m,
            range_max_m: self.range_max_m,
        }
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

/// A scheduled opening of a door. Doors also open by themselves for everybody who walks through.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Opening {
    /// Fully open from this time, seconds.
    pub at_s: f64,
    /// Fully open for so long, seconds.
    pub hold_s: f64,
    /// Again after so long, for ever, before and after; once if absent.
    #[serde(default)]
    pub every_s: Option<f64>,
}

/// A leaf on a hinge.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SwingDoor {
    /// Id.
    pub id: String,
    /// Where the hinge is, metres.
    pub hinge_m: [f64; 2],
    /// Length of the leaf, metres.
    pub leaf_m: f64,
    /// Direction from the hinge along the shut leaf, degrees.
    pub closed_deg: f64,
    /// Direction from the hinge along the open leaf, degrees.
    pub open_deg: f64,
    /// Time to swing, seconds.
    #[serde(default = "swing_s")]
    pub move_s: f64,
    /// Open behind a walker for so long: shortest and longest, seconds.
    #[serde(default = "hold_s")]
    pub hold_s: [f64; 2],
    /// Openings that no walker causes.
    #[serde(default, rename = "opening")]
    pub openings: Vec<Opening>,
}

/// Leaves that slide.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SlidingDoor {
    /// Id.
    pub id: String,
    /// The leaves.
    #[serde(rename = "leaf")]
    pub leaves: Vec<SlidingLeaf>,
    /// Time to slide, seconds.
    #[serde(default = "swing_s")]
    pub move_s: f64,
    /// Open behind a walker for so long: shortest and longest, seconds.
    #[serde(default = "hold_s")]
    pub hold_s: [f64; 2],
    /// Openings that no walker causes.
    #[serde(default, rename = "opening")]
    pub openings: Vec<Opening>,
}

/// One leaf of a sliding door.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SlidingLeaf {
    /// One end when shut, metres.
    pub from_m: [f64; 2],
    /// The other end when shut, metres.
    pub to_m: [f64; 2],
    /// Where it goes to open, metres.
    pub shift_m: [f64; 2],
}

/// A point of a way, where a walker may wait.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RoutePoint {
    /// Where, metres.
    pub at_m: [f64; 2],
    /// Stands here for so long: shortest and longest, seconds.
    #[serde(default)]
    pub wait_s: [f64; 2],
    /// Every walker aims at a point within this radius, metres.
    #[serde(default = "spread_m")]
    pub spread_m: f64,
}

/// A way on which people arrive (a Poisson process), wait and leave.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Route {
    /// Id.
    pub id: String,
    /// From where to where.
    #[serde(rename = "point")]
    pub points: Vec<RoutePoint>,
    /// Arrivals of parties an hour.
    pub arrivals_per_hour: f64,
    /// People who come together.
    #[serde(default = "one_person")]
    pub party: u32,
    /// Slowest and fastest walker, metres a second.
    #[serde(default = "speed_m_s")]
    pub speed_m_s: [f64; 2],
}

/// A closed way on which people walk round for ever, evenly spread, at one speed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Loop {
    /// Id.
    pub id: String,
    /// Corners, metres; at least three.
    pub points_m: Vec<[f64; 2]>,
    /// How many people.
    pub people: u32,
    /// The speed is drawn from here, metres a second.
    #[serde(default = "speed_m_s")]
    pub speed_m_s: [f64; 2],
    /// Every walker aims at points within this radius of the corners, metres.
    #[serde(default = "spread_m")]
    pub spread_m: f64,
}

/// People who stay, and wander between places that see each other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wander {
    /// Id.
    pub id: String,
    /// Places, metres; at least two.
    pub points_m: Vec<[f64; 2]>,
    /// How many people.
    pub people: u32,
    /// Slowest and fastest, metres a second.
    #[serde(default = "speed_m_s")]
    pub speed_m_s: [f64; 2],
    /// Stands at a place for so long: shortest and longest, seconds.
    #[serde(default)]
    pub pause_s: [f64; 2],
}

/// A single scripted event. Without a time it is only prepared: [`Scene::staged`] gives it one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Incident {
    /// Somebody walks a way of his own.
    Walk {
        /// Id.
        id: String,
        /// When, seconds.
        #[serde(default)]
        at_s: Option<f64>,
        /// From where to where.
        #[serde(rename = "point")]
        points: Vec<RoutePoint>,
        /// Slowest and fastest, metres a second.
        #[serde(default = "speed_m_s")]
        speed_m_s: [f64; 2],
    },
    /// Something is left.
    Object {
        /// Id.
        id: String,
        /// When, seconds.
        #[serde(default)]
        at_s: Option<f64>,
        /// For how long, seconds.
        stays_s: f64,
        /// Centre, metres.
        centre_m: [f64; 2],
        /// Length and width before turning, metres.
        size_m: [f64; 2],
        /// Turn, degrees.
        #[serde(default)]
        yaw_deg: f64,
    },
    /// A door is held open.
    DoorHeld {
        /// Id.
        id: String,
        /// When, seconds.
        #[serde(default)]
        at_s: Option<f64>,
        /// For how long, seconds.
        stays_s: f64,
        /// Id of the door.
        door: String,
    },
}

impl Incident {
    /// Its id.
    #[must_use]
    pub fn id(&self) -> &str {
        let (Self::Walk { id, .. } | Self::Object { id, .. } | Self::DoorHeld { id, .. }) = self;
        id
    }

    /// When it begins; none if it is only prepared.
    #[must_use]
    pub fn at_s(&self) -> Option<f64> {
        let (Self::Walk { at_s, .. } | Self::Object { at_s, .. } | Self::DoorHeld { at_s, .. }) =
            self;
        *at_s
    }

    /// The same event at another time.
    #[must_use]
    pub fn at(mut self, t_s: f64) -> Self {
        let (Self::Walk { at_s, .. } | Self::Object { at_s, .. } | Self::DoorHeld { at_s, .. }) =
            &mut self;
        *at_s = Some(t_s);
        self
    }
}

impl Scene {
    /// Reads a scene file. `name` is said in errors.
    ///
    /// # Errors
    /// The line and a caret if it is not TOML of a scene; else every bound that is broken, in words.
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
}

/// Largest scene file, bytes: a thousand walls are 60 kB; 1 MiB is no scene.
pub const SCENE_BYTES_MAX: usize = 1 << 20;

fn anchor_unix_s() -> u64 {
    ANCHOR_UNIX_S
}
fn minus_ninety() -> f64 {
    -90.0
}
fn one() -> f64 {
    1.0
}
fn one_person() -> u32 {
    1
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
fn swing_s() -> f64 {
    1.5
}
fn hold_s() -> [f64; 2] {
    [2.0, 8.0]
}
fn spread_m() -> f64 {
    0.1
}
fn speed_m_s() -> [f64; 2] {
    [1.1, 1.4]
}
