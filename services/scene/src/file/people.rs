//! People of a scene file, and scripted events.

use serde::{Deserialize, Serialize};

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
    /// They are there from, until, seconds; for ever if absent.
    #[serde(default)]
    pub present_s: Option<[f64; 2]>,
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
    /// They are there from, until, seconds; for ever if absent.
    #[serde(default)]
    pub present_s: Option<[f64; 2]>,
}

/// A single scripted event. Without a time it is only prepared:
/// [`Scene::staged`](crate::Scene::staged) gives it one.
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

fn one_person() -> u32 {
    1
}
fn spread_m() -> f64 {
    0.1
}
fn speed_m_s() -> [f64; 2] {
    [1.1, 1.4]
}
