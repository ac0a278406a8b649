//! The claims by name, and what a verdict on one is.

use serde::{Serialize, Serializer};
use std::fmt;

/// A claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Claim {
    /// Static features are found.
    Walls,
    /// The walked path is of the 1 s class.
    Path,
    /// The maps of the other two are empty.
    Empty,
    /// The background is that of experiment 1.
    Agrees,
    /// The exterior door is unique.
    Door,
    /// And is not in the other two maps.
    DoorOnly,
    /// People linger at the elevator and where they talk.
    Spots,
    /// The ways are of the 1 s class.
    Ways,
    /// **Here:** every leg is seen.
    Legs,
    /// **Here:** who stands is no wall.
    NoWall,
}

impl Claim {
    /// All, in the order of the tables.
    pub const ALL: [Self; 10] = [
        Self::Walls,
        Self::Path,
        Self::Empty,
        Self::Agrees,
        Self::Door,
        Self::DoorOnly,
        Self::Spots,
        Self::Ways,
        Self::Legs,
        Self::NoWall,
    ];

    /// Its name in tables and files.
    #[must_use]
    pub fn id(self) -> &'static str {
        match self {
            Self::Walls => "walls",
            Self::Path => "path",
            Self::Empty => "empty",
            Self::Agrees => "agrees",
            Self::Door => "door",
            Self::DoorOnly => "door-only",
            Self::Spots => "spots",
            Self::Ways => "ways",
            Self::Legs => "legs",
            Self::NoWall => "no-wall",
        }
    }

    /// What the paper says; for the last two, what we say.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Walls => "static features, accurate to within the size of the grid cells",
            Self::Path => "on the walked path 1 s is much more probable than any other timescale",
            Self::Empty => "the maps of 15 s and 60 s are essentially empty",
            Self::Agrees => "background of experiment 2 correlates closely with experiment 1",
            Self::Door => "the exterior door alone is strong in both background and 60 s",
            Self::DoorOnly => "the door does not appear in the other timescales",
            Self::Spots => "15 s at the elevator and where people stop to converse",
            Self::Ways => "the ways between the doors are of the 1 s timescale",
            Self::Legs => "here: the whole walked path is seen",
            Self::NoWall => "here: who stands a while is not taken for a wall",
        }
    }

    /// What the first number of its verdict is.
    #[must_use]
    pub fn number(self) -> &'static str {
        match self {
            Self::Walls => "background within one cell of a surface",
            Self::Path => "passing / the most frequent other",
            Self::Empty => "cells in the 15 s map",
            Self::Agrees => "correlation",
            Self::Door => "other groups as strong in both",
            Self::DoorOnly => "passing / vacated at the door",
            Self::Spots => "share of all lingering that is there",
            Self::Ways => "passing there / elsewhere",
            Self::Legs => "share of the path that is seen",
            Self::NoWall => "background / lingering",
        }
    }

    /// The experiment that shows it.
    #[must_use]
    pub fn experiment(self) -> u8 {
        match self {
            Self::Walls => 1,
            Self::Path | Self::Empty | Self::Agrees | Self::Legs => 2,
            Self::Door | Self::DoorOnly | Self::Spots | Self::Ways | Self::NoWall => 3,
        }
    }
}

impl Serialize for Claim {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.id())
    }
}

/// What a number must be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Limit {
    /// This or more.
    AtLeast(f64),
    /// This or less.
    AtMost(f64),
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AtLeast(limit) => write!(f, ">= {limit}"),
            Self::AtMost(limit) => write!(f, "<= {limit}"),
        }
    }
}

impl Serialize for Limit {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// A number of a verdict.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measure {
    /// What it is.
    pub name: &'static str,
    /// What was found.
    pub value: f64,
    /// What it must be.
    pub limit: Limit,
}

impl Measure {
    /// Whether it is what it must be.
    #[must_use]
    pub fn holds(&self) -> bool {
        match self.limit {
            Limit::AtLeast(limit) => self.value >= limit,
            Limit::AtMost(limit) => self.value <= limit,
        }
    }
}

/// Whether a claim holds, and by which numbers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Verdict {
    /// The claim.
    pub claim: Claim,
    /// Whether every number is what it must be.
    pub holds: bool,
    /// The numbers; the first says most.
    pub measures: Vec<Measure>,
}

/// Holds if every number does.
pub(super) fn verdict(claim: Claim, measures: &[(&'static str, f64, Limit)]) -> Verdict {
    let measure = |&(name, value, limit)| Measure { name, value, limit };
    let measures: Vec<Measure> = measures.iter().map(measure).collect();
    Verdict { claim, holds: measures.iter().all(Measure::holds), measures }
}
