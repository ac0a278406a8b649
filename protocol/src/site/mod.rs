//! The site file: what a building has, as a type that cannot be wrong.
//!
//! [`Site::parse`] is the only way in. It refuses unknown keys and reports all errors at once, each
//! with the line and a caret. Units are the last word of a key. Every default is stated at its
//! field and appears in `tog schema`.
//!
//! One owner per fact: the types and their `#[schemars(..)]` attributes say which keys there are,
//! of which type, within which range. `schemars` makes a JSON schema of them, which `tog schema`
//! prints for editors and which `check` holds the text against. `rules` has what a schema
//! cannot say: what must agree between two places of the file.
//!
//! | where | what |
//! |---|---|
//! | `laser` `area` `class` `place` `recorder` `host` | the types |
//! | `tree` | the parsed text with the place of every value |
//! | `check` | tree against schema |
//! | `rules` | tree against itself: ids, references, lengths, times |
//! | `words` | how values and expectations are said, "did you mean" |
//! | `diagnostics` | what was found, where, and how it is drawn |

mod area;
mod check;
mod class;
mod diagnostics;
mod host;
mod laser;
mod place;
mod recorder;
mod remark;
mod rules;
mod tree;
mod words;

pub use area::{Area, Detector};
pub use class::{ClassPrototype, Preset};
pub use diagnostics::{DIAGNOSTICS_MAX, Diagnostic, Diagnostics, Severity};
pub use host::{HOSTS_MAX, Host, Transport};
pub use laser::{Laser, NoReturn, Pace, Source};
pub use place::{Context, Weekday, Zone, minute_of_day};
pub use recorder::{RecordedTopics, Recorder};
pub use remark::{Remark, RemarkOf};
pub use words::is_id;

use diagnostics::Finding;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::LazyLock;
use tree::Node;

/// What [`Site::parse`] refuses a file with: at least one error, and the warnings beside it.
pub type SiteErrors = Diagnostics;

/// Most bytes of a site file: 64 areas and 256 lasers with comments are below 300 kB.
pub const TEXT_BYTES_MAX: usize = 1 << 20;
/// Most lasers of a site: each is a process on one host, and 256 of them are more than a host has
/// cores, ports and file descriptors for; a larger building is several sites.
pub const LASERS_MAX: usize = 256;
/// Most areas of a site: each is three processes (fusion, mapper, anomaly) on one host.
pub const AREAS_MAX: usize = 64;
/// What an id looks like: it is part of topic names, file names and arguments.
pub const ID_PATTERN: &str = "^[A-Za-z0-9_-]{1,32}$";
/// What a time of the day looks like.
pub const TIME_PATTERN: &str = "^([01][0-9]|2[0-3]):[0-5][0-9]$";

/// A whole site: lasers, areas, and what to do with the alerts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Site {
    /// Name of the site: letters, digits, `-`, `_`; at most 32.
    #[schemars(regex(pattern = ID_PATTERN))]
    pub name: String,
    /// IANA time zone for contexts and for the words of alerts.
    #[serde(default = "default_timezone")]
    pub timezone: String,
    /// Directory for checkpoints, learnt maps and the journal; relative to the site file. Unless set
    /// /var/lib/tog/<site> for a site file below /etc.
    #[serde(default = "default_state_dir")]
    #[schemars(length(min = 1, max = 1024))]
    pub state_dir: String,
    /// Directory with the certificates of each host, where `transport = "tls"`: `site-ca.pem`,
    /// `<host>.pem`, `<host>.key`; relative to the site file.
    #[serde(default = "default_tls_dir")]
    #[schemars(length(min = 1, max = 1024))]
    pub tls_dir: String,
    /// Records what the site sees and says; off unless this section is there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recorder: Option<Recorder>,
    /// The hosts of a site that has several; without them everything runs on one host.
    #[serde(default, rename = "host", skip_serializing_if = "Vec::is_empty")]
    #[schemars(length(max = HOSTS_MAX))]
    pub hosts: Vec<Host>,
    /// The areas that are watched.
    #[serde(rename = "area")]
    #[schemars(length(min = 1, max = AREAS_MAX))]
    pub areas: Vec<Area>,
    /// The lasers.
    #[serde(rename = "laser")]
    #[schemars(length(min = 1, max = LASERS_MAX))]
    pub lasers: Vec<Laser>,
}

static SCHEMA: LazyLock<serde_json::Value> =
    LazyLock::new(|| schemars::schema_for!(Site).to_value());

impl Site {
    /// Reads a site file. `file_name` is only for the messages.
    ///
    /// # Errors
    /// All that is wrong with the text, at once. Never panics, whatever the text.
    pub fn parse(text: &str, file_name: &str) -> Result<Self, SiteErrors> {
        Self::parse_with_warnings(text, file_name).map(|(site, _)| site)
    }

    /// As [`Site::parse`], with what is allowed but looks like a mistake; often empty.
    ///
    /// # Errors
    /// As [`Site::parse`].
    pub fn parse_with_warnings(
        text: &str,
        file_name: &str,
    ) -> Result<(Self, Diagnostics), SiteErrors> {
        let refuse = |findings| Err(Diagnostics::new(text, file_name, findings));
        if text.len() > TEXT_BYTES_MAX {
            return refuse(vec![Finding::too_long(text.len())]);
        }
        let (table, syntax_errors) = toml::de::DeTable::parse_recoverable(text);
        if !syntax_errors.is_empty() {
            return refuse(syntax_errors.iter().map(Finding::syntax).collect());
        }
        let root = toml::de::DeValue::Table(table.into_inner());
        let root_node = Node::root(&root);
        let mut findings = check::check(&SCHEMA, &root_node);
        findings.extend(rules::check(&root_node));
        let report = Diagnostics::new(text, file_name, findings);
        if report.has_errors() {
            return Err(report);
        }
        match toml::from_str(text) {
            Ok(site) => Ok((site, report)),
            // The schema and serde read the same types, so this is a last resort, not a way.
            Err(error) => refuse(vec![Finding::syntax(&error)]),
        }
    }

    /// JSON schema (draft 2020-12) of the site file.
    #[must_use]
    pub fn json_schema() -> serde_json::Value {
        SCHEMA.clone()
    }

    /// Index of an area by its id.
    #[must_use]
    pub fn area_index(&self, id: &str) -> Option<usize> {
        self.areas.iter().position(|area| area.id == id)
    }

    /// Index of a laser by its id.
    #[must_use]
    pub fn laser_index(&self, id: &str) -> Option<usize> {
        self.lasers.iter().position(|laser| laser.id == id)
    }

    /// The lasers of an area with their index in the site, in the order of the file: the i-th of
    /// them is bit i of `FrameHeader::lasers_present`.
    pub fn lasers_of(&self, area_id: &str) -> impl Iterator<Item = (usize, &Laser)> {
        self.lasers.iter().enumerate().filter(move |(_, laser)| laser.area == area_id)
    }
}

fn default_timezone() -> String {
    "UTC".to_owned()
}

fn default_tls_dir() -> String {
    "/etc/tog/tls".to_owned()
}
fn default_state_dir() -> String {
    "state".to_owned()
}

#[cfg(test)]
mod tests;
