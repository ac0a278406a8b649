//! What `tog map` prints.

use super::diff::{CellChange, Difference};
use super::grid_file::GridFile;
use super::pictures::totals;
use super::stored::StoredMap;
use serde::Serialize;
use serde_json::json;
use std::fmt::Write as _;

/// Most places in the text; the JSON has more.
const PLACES_SHOWN_MAX: usize = 20;

/// A map by the name of its place and, if only a part of it is meant, its context.
pub fn called(map: &StoredMap, context: Option<&str>) -> String {
    match context {
        None => map.name.clone(),
        Some(context) => format!("{} ({context})", map.name),
    }
}

/// What a map holds.
#[derive(Debug, Serialize)]
pub struct Report {
    map: String,
    context: Option<String>,
    area: String,
    origin_m: [f64; 2],
    cell_m: f64,
    columns: u32,
    rows: u32,
    frame_period_ns: u64,
    timescales_s: Vec<f64>,
    preset: String,
    contexts: Vec<String>,
    lasers: Vec<String>,
    cells_observed: usize,
    observed_s_max: f64,
    classes: Vec<ClassReport>,
}

#[derive(Debug, Serialize)]
struct ClassReport {
    id: u8,
    name: String,
    frames: u64,
    /// Mean over the observed cells of the share of their frames, as in `tog map diff`.
    share: f64,
    cells_leading: usize,
}

impl Report {
    /// Of these counts of a map.
    pub fn of(map: &StoredMap, counts: &[u64], context: Option<&str>) -> Self {
        let grid = &map.grid;
        let cells = grid.geometry().cells();
        let totals = totals(counts, cells);
        let observed = totals.iter().filter(|total| **total > 0).count();
        let leads = |cell: usize| {
            let classes = 0..grid.classes.len();
            classes.rev().max_by_key(|class| counts[class * cells + cell])
        };
        let mut leading = vec![0usize; grid.classes.len()];
        for cell in (0..cells).filter(|cell| totals[*cell] > 0) {
            leading[leads(cell).unwrap_or(0)] += 1;
        }
        let class = |(index, class): (usize, &protocol::grid::ClassName)| {
            let counts = &counts[index * cells..(index + 1) * cells];
            let frames = counts.iter().fold(0u64, |sum, count| sum.saturating_add(*count));
            let seen = counts.iter().zip(&totals).filter(|(_, total)| **total > 0);
            let share = |(count, total): (&u64, &u64)| *count as f64 / *total as f64;
            let shares = seen.map(share).fold(0.0, |sum, share| sum + share); // `sum` of none is -0
            ClassReport {
                id: class.id,
                name: class.name.clone(),
                frames,
                share: shares / observed.max(1) as f64,
                cells_leading: leading[index],
            }
        };
        let longest = totals.iter().copied().max().unwrap_or(0);
        Self {
            map: map.name.clone(),
            context: context.map(str::to_owned),
            area: grid.area.clone(),
            origin_m: grid.origin_m,
            cell_m: grid.cell_m,
            columns: grid.columns,
            rows: grid.rows,
            frame_period_ns: grid.frame_period_ns,
            timescales_s: grid.timescales_s.clone(),
            preset: grid.preset.clone(),
            contexts: grid.contexts.clone(),
            lasers: grid.lasers.iter().map(|laser| laser.id.clone()).collect(),
            cells_observed: observed,
            observed_s_max: longest as f64 * grid.frame_period_ns as f64 / 1e9,
            classes: grid.classes.iter().enumerate().map(class).collect(),
        }
    }

    /// For people.
    pub fn text(&self) -> String {
        let context = self.context.as_ref().map(|name| format!(", context {name}"));
        let mut text = format!(
            "{}{}\n  area {}: {} x {} cells of {} m from ({}, {}) m, frames of {} ms, timescales {:?} s\n",
            self.map,
            context.unwrap_or_default(),
            self.area,
            self.columns,
            self.rows,
            self.cell_m,
            self.origin_m[0],
            self.origin_m[1],
            self.frame_period_ns as f64 / 1e6,
            self.timescales_s,
        );
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "  lasers {}; contexts {}\n  observed {} of {} cells, up to {:.0} s of classified time a cell",
            self.lasers.join(", "),
            self.contexts.join(", "),
            self.cells_observed,
            u64::from(self.columns) * u64::from(self.rows),
            self.observed_s_max,
        );
        let _ = writeln!(text, "  {:<32} {:>10} {:>14}", "class", "mean share", "leads in");
        for class in &self.classes {
            let (share, leading) = (class.share * 100.0, class.cells_leading);
            let _ = writeln!(text, "  {:<32} {share:>8.2} % {leading:>8} cells", class.name);
        }
        text.push_str(SHARE_TEXT);
        text
    }
}

/// What a mean share is, under the tables.
const SHARE_TEXT: &str =
    "  mean share: share of a cell's frames, averaged over the observed cells\n";

/// A difference as JSON.
pub fn document(grid: &GridFile, names: &[String; 2], difference: &Difference) -> String {
    let mut document = json!({ "area": grid.area, "before": names[0], "after": names[1] });
    if let (Some(document), serde_json::Value::Object(rest)) =
        (document.as_object_mut(), json!(difference))
    {
        document.extend(rest);
    }
    format!("{document:#}\n")
}

/// A difference for people.
pub fn difference(grid: &GridFile, names: &[String; 2], difference: &Difference) -> String {
    let Difference { cells_in_both, cells_before_only, cells_after_only, .. } = difference;
    let mut text = format!(
        "area {}: from {} to {}\n{cells_in_both} cells in both maps, {cells_before_only} only in the \
         earlier, {cells_after_only} only in the later; {} changed by {:.0} % of their frames or more\n",
        grid.area,
        names[0],
        names[1],
        difference.cells_changed,
        difference.change_min * 100.0
    );
    let at = |cell: &Option<CellChange>| match cell {
        None => "-".to_owned(),
        Some(cell) => format!(
            "{:.1} -> {:.1} % ({:.2}, {:.2}) m",
            cell.before * 100.0,
            cell.after * 100.0,
            cell.x_m,
            cell.y_m
        ),
    };
    // Writing to a String cannot fail.
    let _ = writeln!(
        text,
        "  {:<12} {:>8} {:>9} {:>6} {:>6}  {:<32} largest fall",
        "mean share", "before", "after", "more", "less", "largest rise"
    );
    for class in &difference.classes {
        let _ = writeln!(
            text,
            "  {:<12} {:>6.2} % {:>7.2} % {:>6} {:>6}  {:<32} {}",
            class.name,
            class.share_before * 100.0,
            class.share_after * 100.0,
            class.cells_more,
            class.cells_less,
            at(&class.largest_rise),
            at(&class.largest_fall)
        );
    }
    for (number, place) in difference.places.iter().enumerate().take(PLACES_SHOWN_MAX) {
        let _ = writeln!(text, "{:>3}. {}", number + 1, place.text);
    }
    if difference.places_found > PLACES_SHOWN_MAX {
        let more = difference.places_found - PLACES_SHOWN_MAX;
        let _ = writeln!(text, "     and {more} smaller places: --format json");
    }
    text
}
