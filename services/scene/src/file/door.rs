//! Doors of a scene file.

use serde::{Deserialize, Serialize};

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

fn swing_s() -> f64 {
    1.5
}
fn hold_s() -> [f64; 2] {
    [2.0, 8.0]
}
