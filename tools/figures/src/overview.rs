//! One picture of a collapsed map: leading classes, lasers, events, and a panel per class.

use crate::FigureError;
use crate::class_panels::{ClassPanels, Room};
use crate::input::{
    EventMark, LaserMark, Options, OverviewMap, check_grid, check_length, check_share,
};
use crate::marks;
use crate::palette::{EMPTY, class_colour, mix};
use crate::share::gamma_text;
use crate::sheet::{self, Key, PLOT_MIN_PX, Sheet, Texts};
use crate::text::Face;
use crate::view::{Paint, View, Window};
use crate::zones;
use protocol::grid::CLASSES_MAX;

/// A class leads in a cell only if it held at least this share of its observed frames: less is
/// noise at the edges of walls.
const LEAD_SHARE_MIN: f32 = 0.005;
/// Strength of the colour of the rarest class that is shown, so that it is seen on the paper.
const TINT_MIN: f64 = 0.35;
/// Column of the legend and the list of events, pixels.
const LEGEND_PX: i32 = 270;
/// Between the map and the legend, pixels.
const LEGEND_GAP_PX: i32 = 22;
/// Most lines of events in the list: more would be longer than the map.
const EVENTS_MAX: usize = 16;
/// Draws a collapsed map in one picture, as a file of `options.format`: a map of the leading class of each cell with
/// lasers and numbered events, a list of these, and a panel with the shares of each class.
///
/// A cell has the colour of its most frequent class other than class 0 (`empty`), the paler the
/// rarer, if that held at least 0.5 % of the observed frames: everywhere but in walls `empty`
/// leads by far, and a map of it would show nothing.
///
/// # Errors
/// [`FigureError`] if the grid, a share or gamma is out of range, an array is too short or long,
/// or there are no classes or more than `CLASSES_MAX`.
pub fn overview(
    map: &OverviewMap,
    lasers: &[LaserMark],
    events: &[EventMark],
    options: &Options,
) -> Result<Vec<u8>, FigureError> {
    options.check()?;
    check_grid(&map.grid)?;
    for class in &map.classes {
        check_share(&class.name, &class.share, &map.grid)?;
    }
    if map.classes.is_empty() || map.classes.len() > CLASSES_MAX {
        let what = format!("{} classes, 1 to {CLASSES_MAX} expected", map.classes.len());
        check_length(&what, 0, &map.grid)?;
    }
    let shown = points(map, lasers, events);
    let view = window_of(map, &shown, options).view(PLOT_MIN_PX, options.plot_max_px());
    let keys = legend(map, lasers, events);
    let face = Face::load()?;
    let legend_px = sheet::legend_width_px(&face, LEGEND_PX, &keys);
    let map_right = Sheet::left_px(&face, &view) + view.size_px()[0];
    let room = Room {
        map_right,
        map_height: view.size_px()[1] + sheet::AXIS_X_PX,
        legend_right: map_right + LEGEND_GAP_PX + legend_px,
        legend_height: sheet::legend_height_px(&face, legend_px, &keys),
    };
    // No marks are kept in view: the panels show what was observed, as large as it goes.
    let panels = ClassPanels::arranged(map, &face, &room, &window_of(map, &[], options));
    let texts = Texts {
        title: &map.title,
        subtitle: &map.subtitle,
        caption: caption(map, lasers, events, options, [&view, panels.view()]),
        format: options.format,
    };
    let right = panels.right_px(&room) - map_right;
    let mut sheet = Sheet::new(view, &texts, right, 0, panels.height_px(&room))?;
    let (view, area) = (sheet.view, sheet.view.area());
    view.paint_cells(&mut sheet.canvas, |cells| paint(map, cells, options.gamma));
    sheet.axes();
    zones::draw_zones(&mut sheet.canvas, &sheet.face, &view, &map.zones);
    marks::draw_marks(&mut sheet.canvas, &sheet.face, &view, lasers, events);
    sheet.legend(area.right() + LEGEND_GAP_PX, area.y + 8, legend_px, &keys);
    let room = Room { legend_right: room.legend_right + area.right() - map_right, ..room };
    panels.draw(&mut sheet, map, lasers, options.gamma, &room, area.y);
    sheet.canvas.file()
}

/// Points that the map shows though nothing may have been observed there.
fn points(map: &OverviewMap, lasers: &[LaserMark], events: &[EventMark]) -> Vec<[f64; 2]> {
    let lasers = lasers.iter().map(|l| [l.x_m, l.y_m]);
    let events = events.iter().map(|e| [e.x_m, e.y_m]);
    let corners = map.zones.iter().flat_map(|zone| zone.polygon_m.iter().copied());
    lasers.chain(events).chain(corners).collect()
}

fn window_of(map: &OverviewMap, keep_m: &[[f64; 2]], options: &Options) -> Window {
    let observed = |index: usize| map.classes.iter().any(|c| !c.share[index].is_nan());
    let crop: Option<&dyn Fn(usize) -> bool> = if options.crop { Some(&observed) } else { None };
    Window::new(&map.grid, crop, keep_m)
}

fn legend(map: &OverviewMap, lasers: &[LaserMark], events: &[EventMark]) -> Vec<(Key, String)> {
    let mut keys = Vec::new();
    for class in map.classes.iter().filter(|c| c.id != 0) {
        keys.push((Key::Colour(class_colour(class.id)), class.name.clone()));
    }
    keys.push((Key::Colour(EMPTY), format!("nearly always {}", name_of_empty(map))));
    keys.push((Key::Never, "never observed".into()));
    if !lasers.is_empty() {
        keys.push((Key::Laser, "laser".into()));
    }
    if !map.zones.is_empty() {
        keys.push((Key::Zone, "zone".into()));
    }
    for (i, event) in events.iter().enumerate().take(EVENTS_MAX) {
        keys.push((Key::Event(i + 1), event.label.clone()));
    }
    keys
}

fn name_of_empty(map: &OverviewMap) -> &str {
    map.classes.iter().find(|c| c.id == 0).map_or("empty", |c| c.name.as_str())
}

fn caption(
    map: &OverviewMap,
    lasers: &[LaserMark],
    events: &[EventMark],
    options: &Options,
    [view, panel]: [&View; 2],
) -> String {
    let unlisted = events.len().saturating_sub(EVENTS_MAX);
    let more = if unlisted > 0 { format!("{unlisted} more events. ") } else { String::new() };
    format!(
        "Map: the most frequent class other than {}, from {:.1} % of the observed frames on, \
         paler where it is rarer. Panels: {}{}{}{}{more}",
        name_of_empty(map),
        LEAD_SHARE_MIN * 100.0,
        lower(&gamma_text(options.gamma, "class")),
        reduction_text(view, panel),
        sheet::outside_text("laser", &marks::lasers_outside(view, lasers)),
        sheet::outside_text("event", &marks::events_outside(view, events)),
    )
}

/// A sentence within another.
fn lower(sentence: &str) -> String {
    let mut chars = sentence.chars();
    chars.next().into_iter().flat_map(char::to_lowercase).chain(chars).collect()
}

fn reduction_text(view: &View, panel: &View) -> String {
    match [view.reduction(), panel.reduction()] {
        [1, 1] => String::new(),
        [n, p] => format!(
            "A pixel of the map is {n} × {n} cells, of a panel {p} × {p}, and shows the largest \
             share of them. "
        ),
    }
}

/// Colour of a block of cells: its leading class.
fn paint(map: &OverviewMap, cells: &[usize], gamma: f64) -> Paint {
    let (mut seen, mut lead, mut largest) = (false, 0, 0.0f32);
    for class in &map.classes {
        for share in cells.iter().map(|c| class.share[*c]).filter(|s| !s.is_nan()) {
            seen = true;
            if class.id != 0 && share > largest {
                (lead, largest) = (class.id, share);
            }
        }
    }
    match seen {
        false => Paint::Never,
        true if largest < LEAD_SHARE_MIN => Paint::Colour(EMPTY),
        true => {
            let strength = TINT_MIN + (1.0 - TINT_MIN) * f64::from(largest).powf(gamma);
            Paint::Colour(mix(EMPTY, class_colour(lead), strength))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::ClassShare;
    use protocol::geometry::GridGeometry;

    #[test]
    fn the_leading_class_is_the_most_frequent_one_that_is_not_empty() {
        let grid = GridGeometry { origin_m: [0.0; 2], cell_m: 0.1, columns: 3, rows: 1 };
        let class = |id: u8, share: [f32; 3]| {
            let name = format!("class {id}");
            ClassShare { id, name, share: share.to_vec() }
        };
        let n = f32::NAN;
        let classes =
            vec![class(0, [0.7, 0.999, n]), class(1, [0.1, 0.001, n]), class(4, [0.2, 0.0, n])];
        let map = OverviewMap {
            grid,
            classes,
            title: String::new(),
            subtitle: String::new(),
            zones: vec![],
        };
        let lead = mix(EMPTY, class_colour(4), TINT_MIN + (1.0 - TINT_MIN) * f64::from(0.2f32));
        assert_eq!(paint(&map, &[0], 1.0), Paint::Colour(lead));
        assert_eq!(paint(&map, &[1], 1.0), Paint::Colour(EMPTY));
        assert_eq!(paint(&map, &[2], 1.0), Paint::Never);
        assert_eq!(paint(&map, &[1, 2, 0], 1.0), Paint::Colour(lead));
    }
}
