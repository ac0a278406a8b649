//! What somebody who opened the files that a site names has to say: the files are not read here, but
//! their faults are told with line and caret like those of the site file itself.

use super::diagnostics::{Diagnostics, Finding, Severity};
use super::tree::Node;

/// What a remark is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RemarkOf {
    /// The source of a laser, by its index in the site.
    Source(usize),
    /// A host, by its index in the site.
    Host(usize),
}

/// A remark on the source of a laser, or on a host.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Remark {
    /// What it is about.
    pub of: RemarkOf,
    /// Key there: `scene`, `recording`, `topic` of a source, `cores`, `network_mbit_s` of a host.
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
        let (lasers, hosts) = (root.list("laser"), root.list("host"));
        let place = |remark: &Remark| {
            let of = match remark.of {
                RemarkOf::Source(laser) => lasers.get(laser).map(|l| l.get_or_self("source")),
                RemarkOf::Host(host) => hosts.get(host).cloned(),
            };
            of.unwrap_or_else(|| root.clone()).get_or_self(remark.key)
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
