//! Classes in the site file: presets and own prototypes.

use super::ID_PATTERN;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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
    /// Name, unique in the area; not `transit` or `unknown`: letters, digits, `-`, `_`; at most 32.
    #[schemars(regex(pattern = ID_PATTERN))]
    pub name: String,
    /// Occupancy per timescale, 0 empty .. 1 occupied.
    #[schemars(length(min = 1, max = 8), inner(range(min = 0.0, max = 1.0)))]
    pub prototype: Vec<f64>,
}
