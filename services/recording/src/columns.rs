//! What the columns of a CSV are: the text that a person writes, and that our own CSV begins with.

use crate::number::{real, real32, scaled_ns};
use protocol::scan::BEAMS_MAX;
use std::fmt;
use std::str::FromStr;

/// What the columns of a CSV of scans are, one scan a row.
///
/// Written as a list with commas, one entry a column, in order: `t:ms,laser,-,r*181:mm`.
///
/// | entry | column | units, the first is meant without one |
/// |---|---|---|
/// | `t` | time of the first beam, UNIX time; needed | `s` `ms` `us` `ns` |
/// | `log_t` | when it was recorded; else `t` | as `t` |
/// | `laser` | name of the laser; else all scans are of `/scan` | |
/// | `frame_id` | name of its coordinates | |
/// | `angle_min`, `angle_max` | bearing of the first and the last range | `rad` `deg` |
/// | `angle_increment` | angle between two ranges | `rad` `deg` |
/// | `range_min`, `range_max` | what the laser can measure; no return from `range_max` on | `m` `cm` `mm` |
/// | `scan_time` | time of one turn | `s` `ms` `us` `ns` |
/// | `r`, `r7`, `r*181`, `r...` | one range, one, 181, all that follow; needed | `m` `cm` `mm` |
/// | `-` | is passed over | |
/// | `range_max=8:m` | no column: the value for all rows | |
///
/// Needed besides, as columns or values: `angle_min`, `range_max`, and one of `angle_increment` and
/// `angle_max`. `range_min` is 0 if nobody says otherwise.
#[derive(Debug, Clone, PartialEq)]
pub struct ColumnMap {
    /// What each column holds; behind the last, all are [`Self::rest`].
    columns: Vec<Column>,
    rest: Option<f64>,
    /// Values for all rows.
    values: Vec<(Name, String, f64)>,
}

/// A column: what it is, in units of what.
type Column = Option<(Name, f64)>;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Name {
    Time,
    LogTime,
    Laser,
    FrameId,
    AngleMin,
    AngleMax,
    AngleIncrement,
    RangeMin,
    RangeMax,
    ScanTime,
    Range,
}

const NAMES: [(&str, Name); 10] = [
    ("t", Name::Time),
    ("log_t", Name::LogTime),
    ("laser", Name::Laser),
    ("frame_id", Name::FrameId),
    ("angle_min", Name::AngleMin),
    ("angle_max", Name::AngleMax),
    ("angle_increment", Name::AngleIncrement),
    ("range_min", Name::RangeMin),
    ("range_max", Name::RangeMax),
    ("scan_time", Name::ScanTime),
];
/// Most columns beside the ranges of the largest scan.
const COLUMNS_MAX: usize = BEAMS_MAX + 256;

impl Name {
    /// Units: name and size; in ns for times, radians for angles, units per metre for ranges.
    fn units(self) -> &'static [(&'static str, f64)] {
        match self {
            Self::Time | Self::LogTime | Self::ScanTime => {
                &[("s", 1e9), ("ms", 1e6), ("us", 1e3), ("ns", 1.0)]
            }
            Self::Laser | Self::FrameId => &[],
            Self::AngleMin | Self::AngleMax | Self::AngleIncrement => {
                &[("rad", 1.0), ("deg", std::f64::consts::PI / 180.0)]
            }
            Self::RangeMin | Self::RangeMax | Self::Range => {
                &[("m", 1.0), ("cm", 100.0), ("mm", 1000.0)]
            }
        }
    }

    fn unit(self, text: Option<&str>) -> Result<f64, String> {
        let units = self.units();
        let known = || units.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
        match text {
            None => Ok(units.first().map_or(1.0, |(_, size)| *size)),
            Some(text) => units
                .iter()
                .find(|(name, _)| *name == text)
                .map(|(_, size)| *size)
                .ok_or_else(|| format!("the unit \"{text}\", expected one of: {}", known())),
        }
    }
}

impl FromStr for ColumnMap {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::of_entries(text.split(','))
    }
}

impl ColumnMap {
    /// From the entries of a list.
    pub(crate) fn of_entries<'a>(entries: impl Iterator<Item = &'a str>) -> Result<Self, String> {
        let mut map = Self { columns: Vec::new(), rest: None, values: Vec::new() };
        for entry in entries {
            let entry = entry.trim();
            map.add(entry).map_err(|reason| {
                let shown: String = entry.chars().take(40).collect();
                format!("column \"{}\": {reason}", shown.escape_debug())
            })?;
            if map.columns.len() > COLUMNS_MAX {
                return Err(format!("more than {COLUMNS_MAX} columns"));
            }
        }
        let has = |name| map.column_of(name).is_some() || map.value_of(name).is_some();
        let ranges = map.rest.is_some() || map.column_of(Name::Range).is_some();
        let missing = [
            (map.column_of(Name::Time).is_some(), "t"),
            (ranges, "r..."),
            (has(Name::AngleMin), "angle_min"),
            (has(Name::AngleIncrement) || has(Name::AngleMax), "angle_increment (or angle_max)"),
            (has(Name::RangeMax), "range_max"),
        ];
        match missing.iter().find(|(is_there, _)| !is_there) {
            None => Ok(map),
            Some((_, name)) => {
                Err(format!("the columns lack {name}, as a column or as NAME=VALUE"))
            }
        }
    }

    fn add(&mut self, entry: &str) -> Result<(), String> {
        if let Some((name, value)) = entry.split_once('=') {
            let name = named(name.trim())?;
            let (value, unit) = value.rsplit_once(':').map_or((value, None), |(v, u)| (v, Some(u)));
            let unit = name.unit(unit.map(str::trim))?;
            let value = value.trim().to_owned();
            if !matches!(name, Name::Laser | Name::FrameId) {
                real(&value, "the value")?;
            }
            self.values.push((name, value, unit));
            return Ok(());
        }
        if self.rest.is_some() {
            return Err("nothing can follow r...".to_owned());
        }
        if matches!(entry, "-" | "") {
            self.columns.push(None);
            return Ok(());
        }
        let (name, unit) = entry.split_once(':').map_or((entry, None), |(n, u)| (n, Some(u)));
        let Some(ranges) = name.strip_prefix('r').filter(|rest| !rest.starts_with("ange")) else {
            let name = named(name)?;
            if self.column_of(name).is_some() {
                return Err("is there twice".to_owned());
            }
            self.columns.push(Some((name, name.unit(unit)?)));
            return Ok(());
        };
        let unit = Name::Range.unit(unit)?;
        match ranges.strip_prefix('*') {
            _ if ranges == "..." => self.rest = Some(unit),
            Some(count) => {
                let count = crate::number::count(count, BEAMS_MAX, "ranges")?;
                self.columns.extend(vec![Some((Name::Range, unit)); count]);
            }
            None if ranges.bytes().all(|byte| byte.is_ascii_digit()) => {
                self.columns.push(Some((Name::Range, unit)));
            }
            None => return Err(unknown(name)),
        }
        Ok(())
    }

    fn column_of(&self, name: Name) -> Option<usize> {
        self.columns.iter().position(|column| column.is_some_and(|(found, _)| found == name))
    }

    fn value_of(&self, name: Name) -> Option<(&str, f64)> {
        let value = self.values.iter().find(|(found, _, _)| *found == name)?;
        Some((&value.1, value.2))
    }

    /// How many columns a row has; at least so many if ranges follow the last.
    pub(crate) fn columns(&self) -> (usize, bool) {
        (self.columns.len(), self.rest.is_some())
    }

    /// A field of a row, or the value for all rows: its text and its unit.
    fn text<'a>(&'a self, row: &[&'a str], name: Name) -> Option<(&'a str, f64)> {
        let column = self.column_of(name).and_then(|column| {
            let unit = self.columns[column].map_or(1.0, |(_, unit)| unit);
            row.get(column).map(|text| (text.trim(), unit))
        });
        column.or_else(|| self.value_of(name))
    }

    /// A time of a row, ns.
    pub(crate) fn time_ns(&self, row: &[&str], name: Name) -> Option<Result<u64, String>> {
        self.text(row, name).map(|(text, unit)| scaled_ns(text, unit as u64))
    }

    /// An angle or a range of a row, radians or metres.
    pub(crate) fn real(&self, row: &[&str], name: Name, what: &str) -> Option<Result<f64, String>> {
        let (text, unit) = self.text(row, name)?;
        let is_range = matches!(name, Name::RangeMin | Name::RangeMax);
        Some(real(text, what).map(|value| if is_range { value / unit } else { value * unit }))
    }

    /// A name of a row.
    pub(crate) fn word<'a>(&'a self, row: &[&'a str], name: Name) -> Option<&'a str> {
        self.text(row, name).map(|(text, _)| text)
    }

    /// True if a field of a range is a number.
    pub(crate) fn has_range(&self, row: &[&str]) -> bool {
        let is_range = |index: usize| match self.columns.get(index) {
            Some(column) => column.is_some_and(|(name, _)| name == Name::Range),
            None => self.rest.is_some(),
        };
        let is_number = |text: &&str| real32(text.trim(), "a range").is_ok();
        row.iter().enumerate().any(|(index, text)| is_range(index) && is_number(text))
    }

    /// The ranges of a row, metres: an empty field is NaN, empty fields at the end are no ranges.
    pub(crate) fn ranges_m(&self, row: &[&str]) -> Result<Vec<f32>, String> {
        let mut ranges_m = Vec::new();
        let mut filled = 0;
        for (index, text) in row.iter().enumerate() {
            let unit = match self.columns.get(index) {
                Some(Some((Name::Range, unit))) => *unit,
                Some(_) => continue,
                None => match self.rest {
                    Some(unit) => unit,
                    None => break,
                },
            };
            if ranges_m.len() == BEAMS_MAX {
                return Err(format!("more than {BEAMS_MAX} ranges"));
            }
            let text = text.trim();
            ranges_m.push(match text {
                "" => f32::NAN,
                // Rounded once, so that what was written with 32 bits is read with the same.
                _ if unit == 1.0 => real32(text, "a range")?,
                _ => (real(text, "a range")? / unit) as f32,
            });
            filled = if text.is_empty() { filled } else { ranges_m.len() };
        }
        ranges_m.truncate(filled);
        Ok(ranges_m)
    }
}

fn named(name: &str) -> Result<Name, String> {
    let known = NAMES.iter().find(|(text, _)| *text == name);
    known.map(|(_, name)| *name).ok_or_else(|| unknown(name))
}

fn unknown(name: &str) -> String {
    let names: Vec<&str> = NAMES.iter().map(|(name, _)| *name).collect();
    let shown: String = name.chars().take(40).collect();
    format!(
        "\"{}\" is not known, expected one of: {}, r..., -",
        shown.escape_debug(),
        names.join(", ")
    )
}

impl fmt::Display for ColumnMap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let more = if self.rest.is_some() { " and ranges" } else { "" };
        write!(f, "{} columns{more}", self.columns.len())
    }
}
