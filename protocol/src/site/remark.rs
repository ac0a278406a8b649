//! What somebody who opened the files that a site names has to say: the files are not read here, but
//! their faults are told with line and caret like those of the site file itself.

use super::diagnostics::{Diagnostics, Finding, Severity};
use super::tree::Node;

/// A remark on the source of a laser.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Remark {
    /// Index of the laser in the site.
    pub laser: usize,
    /// Key of its source: `scene`, `recording`, `topic`.
    pub key: &'static str,
    /// How bad it is.
    pub severity: Severity,
    /// One sentence with all of it.
    pub message: String,
    /// What is there, for programs.
    pub found: String,
    /// What should be there; stands under the caret.
    pub expected: String,
    /// What to do.
    pub help: String,
}

impl Diagnostics {
    /// Places remarks in the text of a site file that was read.
    #[must_use]
    pub fn of_remarks(text: &str, file_name: &str, remarks: &[Remark]) -> Self {
        let (table, _) = toml::de::DeTable::parse_recoverable(text);
        let value = toml::de::DeValue::Table(table.into_inner());
        let root = Node::root(&value);
        let lasers = root.list("laser");
        let place = |remark: &Remark| {
            let laser = lasers.get(remark.laser).cloned().unwrap_or_else(|| root.clone());
            laser.get_or_self("source").get_or_self(remark.key)
        };
        let finding = |remark: &Remark| {
            let (node, found) = (place(remark), remark.found.as_str());
            let finding = match remark.severity {
                Severity::Error => Finding::error(&node, found, remark.expected.as_str()),
                Severity::Warning => Finding::warning(&node, found, remark.expected.as_str()),
            };
            finding.message(remark.message.as_str()).help(remark.help.as_str())
        };
        Self::new(text, file_name, remarks.iter().map(finding).collect())
    }
}
