//! What must agree between lasers, their sources and their areas.

use super::super::area::{default_lateness_max_ms, default_scan_age_max_ms};
use super::super::diagnostics::Finding;
use super::super::laser::default_rate_hz;
use super::super::tree::{Node, number};
use super::super::words::{found, quoted};
use super::areas;
use std::collections::BTreeMap;

/// A laser farther from the grid than this sees nothing of it, or hardly: planar lasers indoors
/// see 8 to 30 m.
const DISTANCE_MAX_M: f64 = 30.0;

pub(super) fn check(areas: &[Node<'_>], lasers: &[Node<'_>], findings: &mut Vec<Finding>) {
    for laser in lasers {
        let Some((id, _)) = laser.text("area") else { continue };
        let area = areas.iter().find(|area| area.text("id").is_some_and(|(other, _)| other == id));
        if let Some(area) = area {
            near(area, laser, findings);
            fast_enough(area, laser, findings);
        }
    }
    let sources: Vec<Node<'_>> = lasers.iter().filter_map(|laser| laser.get("source")).collect();
    one_clock(&sources, findings);
    one_pace(&sources, findings);
    one_seed(&sources, findings);
    own_stream(&sources, findings);
}

fn near(area: &Node<'_>, laser: &Node<'_>, findings: &mut Vec<Finding>) {
    let Some(grid) = areas::grid(area) else { return };
    let (Some(x_m), Some(y_m)) = (laser.number("x_m"), laser.number("y_m")) else { return };
    let Some(node) = laser.get("x_m") else { return };
    let beyond = |value: f64, axis: usize, cells: u32| {
        let end = grid.origin_m[axis] + f64::from(cells) * grid.cell_m;
        (grid.origin_m[axis] - value).max(value - end).max(0.0)
    };
    let distance_m = beyond(x_m, 0, grid.columns).hypot(beyond(y_m, 1, grid.rows));
    if distance_m > DISTANCE_MAX_M {
        let found = format!("{distance_m:.1} m away from its area");
        findings.push(
            Finding::warning(&node, &found, format!("at most {DISTANCE_MAX_M} m"))
                .message(format!("`{}` stands {found}", laser.path))
                .help("`x_m` and `y_m` are site coordinates, metres, as `origin_m` of the area"),
        );
    }
}

/// Scans of a simulated laser come often enough for the frames of its area.
fn fast_enough(area: &Node<'_>, laser: &Node<'_>, findings: &mut Vec<Finding>) {
    let Some(source) = laser.get("source").filter(|source| is_kind(source, "simulator")) else {
        return;
    };
    let rate_hz = source.number_or("rate_hz", default_rate_hz());
    let period_ms = 1000.0 / rate_hz;
    let age_ms = area.number_or("scan_age_max_ms", default_scan_age_max_ms());
    let lateness_ms = area.number_or("lateness_max_ms", default_lateness_max_ms());
    let node = source.get_or_self("rate_hz");
    if rate_hz > 0.0 && period_ms > age_ms.min(lateness_ms) {
        let found = format!("a scan every {period_ms:.0} ms");
        let expected = format!(
            "at most scan_age_max_ms = {age_ms} and lateness_max_ms = {lateness_ms} of its area"
        );
        findings.push(
            Finding::warning(&node, &found, &expected)
                .message(format!("`{}` has {found}: frames will lack this laser", laser.path))
                .help("raise these two of the area above the time between two scans"),
        );
    }
}

fn is_kind(source: &Node<'_>, kind: &str) -> bool {
    source.text("kind").is_some_and(|(found, _)| found == kind)
}

/// A site has one clock: that of its recording, or that of the simulation.
fn one_clock(sources: &[Node<'_>], findings: &mut Vec<Finding>) {
    let kinds: Vec<_> = sources.iter().filter_map(|source| source.text("kind")).collect();
    let Some((first, first_node)) = kinds.first() else { return };
    let known = |kind: &str| kind == "simulator" || kind == "replay";
    if let Some((kind, node)) = kinds.iter().find(|(kind, _)| kind != first)
        && known(kind)
        && known(first)
    {
        findings.push(
            Finding::error(node, quoted(kind), format!("{}, as the first laser", quoted(first)))
                .message("a site mixes replay and simulator")
                .related(first_node.span.clone(), "the first laser")
                .help("a site has one clock: make two sites of it"),
        );
    }
}

fn one_pace(sources: &[Node<'_>], findings: &mut Vec<Finding>) {
    let replays = || sources.iter().filter(|source| is_kind(source, "replay"));
    // As text, so that 2 and 2.0 are one pace.
    let pace = |source: &Node<'_>| match source.get("pace") {
        None => "\"real_time\"".to_owned(),
        Some(node) => match number(node.value) {
            Some(times) => times.to_string(),
            None => found(node.value),
        },
    };
    let Some(first) = replays().next() else { return };
    for source in replays().filter(|source| pace(source) != pace(first)) {
        let (node, first_node) = (source.get_or_self("pace"), first.get_or_self("pace"));
        findings.push(
            Finding::error(&node, pace(source), format!("{}, as the first laser", pace(first)))
                .message("two lasers are replayed at different paces")
                .related(first_node.span, "the first laser")
                .help("a site has one clock: write the same `pace` for all lasers"),
        );
    }
}

fn one_seed(sources: &[Node<'_>], findings: &mut Vec<Finding>) {
    let mut first: BTreeMap<&str, &Node<'_>> = BTreeMap::new();
    for source in sources.iter().filter(|source| is_kind(source, "simulator")) {
        let Some((scene, _)) = source.text("scene") else { continue };
        let earlier = *first.entry(scene).or_insert(source);
        let seed = |source: &Node<'_>| source.number_or("seed", 0.0);
        if seed(source) != seed(earlier) {
            let expected = format!("{}, as the first laser of this scene", seed(earlier));
            findings.push(
                Finding::error(&source.get_or_self("seed"), seed(source).to_string(), expected)
                    .message(format!("the scene {} has two seeds", quoted(scene)))
                    .related(earlier.get_or_self("seed").span, "the first laser of the scene")
                    .help("all lasers of a scene see the same people: write the same `seed`"),
            );
        }
    }
}

/// Two lasers that replay the same topic are one laser.
fn own_stream(sources: &[Node<'_>], findings: &mut Vec<Finding>) {
    let mut first: BTreeMap<(&str, Option<&str>), Node<'_>> = BTreeMap::new();
    for source in sources.iter().filter(|source| is_kind(source, "replay")) {
        let Some((recording, node)) = source.text("recording") else { continue };
        let topic = source.text("topic").map(|(topic, _)| topic);
        if let Some(earlier) = first.get(&(recording, topic)) {
            findings.push(
                Finding::warning(&node, quoted(recording), "another recording or `topic`")
                    .message("two lasers replay the same scans")
                    .related(earlier.span.clone(), "the first of them")
                    .help("write the `topic` of each laser in the recording"),
            );
        } else {
            first.insert((recording, topic), node);
        }
    }
}
