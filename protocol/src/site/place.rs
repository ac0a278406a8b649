//! Parts of an area's week and of its floor: contexts and zones.

use super::{ID_PATTERN, TIME_PATTERN};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A part of the week with a normal of its own. Where two overlap, the first of the file counts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Context {
    /// Name, unique in the area; not `always`: letters, digits, `-`, `_`; at most 32.
    #[schemars(regex(pattern = ID_PATTERN))]
    pub name: String,
    /// Days on which it begins; every day if empty.
    #[serde(default)]
    #[schemars(length(max = 7))]
    pub days: Vec<Weekday>,
    /// Begin, `HH:MM` in the site's time zone.
    #[schemars(regex(pattern = TIME_PATTERN))]
    pub from: String,
    /// End, `HH:MM`; a time at or before `from` means the next day.
    #[schemars(regex(pattern = TIME_PATTERN))]
    pub to: String,
}

impl Context {
    /// Begin in minutes of the day, 0..1440.
    #[must_use]
    pub fn from_minute(&self) -> u16 {
        minute_of_day(&self.from).unwrap_or(0)
    }

    /// End in minutes of the day, 0..1440; at or before `from_minute` means the next day.
    #[must_use]
    pub fn to_minute(&self) -> u16 {
        minute_of_day(&self.to).unwrap_or(0)
    }
}

/// Minutes since midnight of `HH:MM`; `None` for anything else.
#[must_use]
pub fn minute_of_day(text: &str) -> Option<u16> {
    let [h1, h0, b':', m1, m0] = *text.as_bytes() else { return None };
    if ![h1, h0, m1, m0].iter().all(u8::is_ascii_digit) {
        return None;
    }
    let two = |tens: u8, ones: u8| u16::from(tens - b'0') * 10 + u16::from(ones - b'0');
    let (hour, minute) = (two(h1, h0), two(m1, m0));
    (hour < 24 && minute < 60).then_some(hour * 60 + minute)
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
    /// Name that alerts use, unique in the area; at most 64 characters.
    #[schemars(length(min = 1, max = 64))]
    pub name: String,
    /// Corners in site coordinates, metres.
    #[schemars(length(min = 3, max = 64), inner(inner(range(min = -100_000.0, max = 100_000.0))))]
    pub polygon_m: Vec<[f64; 2]>,
    /// Nothing in an excluded zone is an event.
    #[serde(default)]
    pub exclude: bool,
}
