//! What must agree within an area: cells, times, timescales, classes, contexts, zones.

use super::super::area::{
    default_cell_m, default_frame_period_ms, default_laser_lost_ms, default_scan_age_max_ms,
    default_timescales_s,
};
use super::super::diagnostics::Finding;
use super::super::tree::{Node, number};
use super::super::words::{names, quoted, shortened};
use super::{contexts, unique};
use crate::geometry::GridGeometry;

/// Most frames of the longest timescale: 29 h at 10 frames a second, 4 h at 75. The mapper keeps
/// the changes of all of them in memory.
const TIMESCALE_FRAMES_MAX: f64 = (1 << 20) as f64;
/// Smallest zone, square metres: ten by ten centimetres, one usual cell.
const ZONE_AREA_MIN_M2: f64 = 0.01;

pub(super) fn check(areas: &[Node<'_>], findings: &mut Vec<Finding>) {
    for area in areas {
        reserved(area, "id", &["host"], "where events of the machine itself come from", findings);
        cells(area, findings);
        times(area, findings);
        timescales(area, findings);
        classes(area, findings);
        contexts::check(&area.list("context"), findings);
        let zones = area.list("zone");
        unique(&zones, "name", "zone", findings);
        for zone in &zones {
            polygon(area, zone, findings);
        }
    }
}

pub(super) fn reserved(
    node: &Node<'_>,
    key: &str,
    taken: &[&str],
    why: &str,
    findings: &mut Vec<Finding>,
) {
    let Some((name, node)) = node.text(key).filter(|(name, _)| taken.contains(name)) else {
        return;
    };
    let expected = format!("another name than {}", names(taken.iter().copied()));
    let help = format!("`{name}` is {why}");
    findings.push(Finding::error(&node, quoted(name), expected).help(help));
}

/// The grid of an area, as far as it can be read.
pub(super) fn grid(area: &Node<'_>) -> Option<GridGeometry> {
    let side = |key: &str| {
        let cells = area.number(key)?;
        let fits = (1.0..=f64::from(GridGeometry::SIDE_MAX)).contains(&cells);
        fits.then_some(cells as u32)
    };
    let cell_m = area.number_or("cell_m", default_cell_m());
    Some(GridGeometry {
        origin_m: area.get("origin_m")?.pair()?,
        cell_m: (cell_m > 0.0).then_some(cell_m)?,
        columns: side("columns")?,
        rows: side("rows")?,
    })
}

fn cells(area: &Node<'_>, findings: &mut Vec<Finding>) {
    let (Some(grid), Some(node)) = (grid(area), area.get("columns")) else { return };
    if grid.cells() > GridGeometry::CELLS_MAX {
        let found = format!("{} x {} = {} cells", grid.columns, grid.rows, grid.cells());
        let expected = format!("at most {} cells in an area", GridGeometry::CELLS_MAX);
        findings.push(
            Finding::error(&node, found, expected)
                .message(format!("`{}` has too many cells", area.path))
                .help("make `cell_m` larger, or split the area in two"),
        );
    }
}

fn times(area: &Node<'_>, findings: &mut Vec<Finding>) {
    let age_ms = area.number_or("scan_age_max_ms", default_scan_age_max_ms());
    let lost_ms = area.number_or("laser_lost_ms", default_laser_lost_ms());
    let period_ms = area.number_or("frame_period_ms", default_frame_period_ms());
    let written = |keys: [&str; 2]| keys.into_iter().find_map(|key| area.get(key));
    if lost_ms < age_ms
        && let Some(node) = written(["laser_lost_ms", "scan_age_max_ms"])
    {
        let found = format!("laser_lost_ms = {lost_ms} and scan_age_max_ms = {age_ms}");
        findings.push(
            Finding::error(&node, &found, "laser_lost_ms >= scan_age_max_ms")
                .message(format!("`{}` has {found}", area.path))
                .help("a laser would be lost while its last scan is still in the frames"),
        );
    }
    if age_ms < period_ms
        && let Some(node) = written(["scan_age_max_ms", "frame_period_ms"])
    {
        let found = format!("scan_age_max_ms = {age_ms} and frame_period_ms = {period_ms}");
        findings.push(
            Finding::warning(&node, &found, "scan_age_max_ms >= frame_period_ms")
                .message(format!("`{}` has {found}", area.path))
                .help("a scan that comes early in the period of a frame is in no frame"),
        );
    }
}

/// The timescales as they are written, or the default; `None` if one cannot be read.
fn timescales_s(area: &Node<'_>) -> Option<Vec<f64>> {
    match area.get("timescales_s") {
        None => Some(default_timescales_s()),
        Some(node) => node.value.as_array()?.iter().map(|item| number(item.get_ref())).collect(),
    }
}

fn timescales(area: &Node<'_>, findings: &mut Vec<Finding>) {
    let Some(values_s) = timescales_s(area) else { return };
    let items = area.list("timescales_s");
    for (pair, item) in values_s.windows(2).zip(items.iter().skip(1)) {
        if pair[1] <= pair[0] {
            let expected = format!("more than {}, the one before it", pair[0]);
            findings.push(
                Finding::error(item, pair[1].to_string(), expected)
                    .help("timescales ascend: prototypes name them from short to long"),
            );
        }
    }
    let period_ms = area.number_or("frame_period_ms", default_frame_period_ms());
    let longest_s = values_s.iter().copied().fold(0.0, f64::max);
    let frames = longest_s * 1000.0 / period_ms;
    let node = area.get("timescales_s").or_else(|| area.get("frame_period_ms"));
    if let Some(node) = node.filter(|_| period_ms >= 1.0 && frames > TIMESCALE_FRAMES_MAX) {
        let found = format!("{longest_s} s of a frame every {period_ms} ms");
        let expected = format!("at most {TIMESCALE_FRAMES_MAX} frames in the longest timescale");
        findings.push(
            Finding::error(&node, &found, expected)
                .message(format!("`{}` asks for {found}: {frames:.0} frames", area.path))
                .help("the changes of all of them are kept in memory: shorten the timescale"),
        );
    }
}

fn classes(area: &Node<'_>, findings: &mut Vec<Finding>) {
    let classes = area.list("class");
    let Some(scales) = timescales_s(area).map(|values| values.len()) else { return };
    if classes.is_empty() {
        if let Some(node) = area.get("timescales_s").filter(|_| scales != 3) {
            let expected = "3 timescales, as the presets have";
            findings.push(
                Finding::error(&node, format!("a list of {scales}"), expected)
                    .help("write three timescales, or own classes with `[[area.class]]`"),
            );
        }
        return;
    }
    unique(&classes, "name", "class", findings);
    let mut earlier: Vec<(Vec<f64>, Node<'_>)> = Vec::new();
    for class in &classes {
        let why = "a class that tog adds itself";
        reserved(class, "name", &["transit", "unknown"], why, findings);
        let Some(node) = class.get("prototype").filter(|node| node.value.is_array()) else {
            continue;
        };
        let values: Vec<f64> = node.items().iter().filter_map(|item| number(item.value)).collect();
        if node.items().len() != scales {
            let expected = format!("{scales} numbers, one for each of `timescales_s`");
            findings.push(
                Finding::error(&node, format!("a list of {}", node.items().len()), expected)
                    .help("a prototype is the occupancy on each timescale, from short to long"),
            );
        } else if let Some((_, first)) = earlier.iter().find(|(other, _)| *other == values) {
            findings.push(
                Finding::warning(&node, "the prototype of another class", "one of its own")
                    .related(first.span.clone(), "first used here")
                    .help("a tie goes to the first of the two: this class never wins"),
            );
        }
        earlier.push((values, node));
    }
}

/// A zone has an inside, and that lies in the area. The test for the place is by the smallest
/// rectangle round the zone: a zone that passes it may still miss the area by a corner.
fn polygon(area: &Node<'_>, zone: &Node<'_>, findings: &mut Vec<Finding>) {
    let Some(node) = zone.get("polygon_m") else { return };
    let items = node.items();
    let corners: Vec<[f64; 2]> = items.iter().filter_map(Node::pair).collect();
    if corners.len() != items.len() || corners.len() < 3 {
        return; // the schema says so
    }
    let next = corners.iter().cycle().skip(1);
    let twice_m2: f64 = corners.iter().zip(next).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum();
    if twice_m2.abs() / 2.0 < ZONE_AREA_MIN_M2 {
        let found = format!("a polygon of {:.4} square metres", twice_m2.abs() / 2.0);
        findings.push(
            Finding::error(&node, found, format!("at least {ZONE_AREA_MIN_M2}"))
                .help("write the corners in the order in which one walks round the zone"),
        );
    }
    let Some(grid) = grid(area) else { return };
    let limits = |axis: usize, cells: u32| {
        let values = corners.iter().map(|corner| corner[axis]);
        let zone = values
            .fold([f64::MAX, f64::MIN], |[low, high], value| [low.min(value), high.max(value)]);
        let end = grid.origin_m[axis] + f64::from(cells) * grid.cell_m;
        (zone, [grid.origin_m[axis], end])
    };
    let sides = [limits(0, grid.columns), limits(1, grid.rows)];
    let area_m = format!(
        "within x {:.1} to {:.1}, y {:.1} to {:.1}, as its area is",
        sides[0].1[0], sides[0].1[1], sides[1].1[0], sides[1].1[1]
    );
    let name = zone.text("name").map_or("", |(name, _)| name);
    let found = |how: &str| format!("the zone {:?} {how} the area", shortened(name));
    if sides.iter().any(|(zone, grid)| zone[1] <= grid[0] || zone[0] >= grid[1]) {
        findings.push(
            Finding::error(&node, found("outside"), area_m)
                .message(found("lies outside"))
                .help("corners are in site coordinates, metres, not relative to the area"),
        );
    } else if sides.iter().any(|(zone, grid)| {
        zone[0] < grid[0] - grid_slack(grid) || zone[1] > grid[1] + grid_slack(grid)
    }) {
        findings.push(
            Finding::warning(&node, found("larger than"), area_m)
                .message(found("reaches out of"))
                .help("what lies outside is not watched"),
        );
    }
}

/// A zone drawn up to the wall may pass the edge of the grid by a rounding: a hundredth of a side.
fn grid_slack(side: &[f64; 2]) -> f64 {
    (side[1] - side[0]) / 100.0
}
