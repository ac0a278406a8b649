//! One picture of a collapsed map: leading classes, lasers, events, and a panel per class.

use crate::FigureError;
use crate::canvas::{FAINT, INK, Rect};
use crate::input::{
    ClassShare, EventMark, LaserMark, Options, OverviewMap, check_grid, check_length, check_share,
};
use crate::marks;
use crate::palette::{EMPTY, class_colour, mix};
use crate::scale;
use crate::share::{self, gamma_text};
use crate::sheet::{self, Key, PAD, PLOT_MIN_PX, Sheet, TEXT_PX, Texts};
use crate::text::{Anchor, Face, Style};
use crate::view::{Paint, View};
use protocol::grid::CLASSES_MAX;

/// A class leads in a cell only if it held at least this share of its observed frames: less is
/// noise at the edges of walls.
const LEAD_SHARE_MIN: f32 = 0.005;
/// Strength of the colour of the rarest class that is shown, so that it is seen on the paper.
const TINT_MIN: f64 = 0.35;
/// Column of the legend and the list of events, pixels.
const LEGEND_PX: i32 = 270;
/// Most lines of events in the list: more would be longer than the map.
const EVENTS_MAX: usize = 16;
/// Narrowest and widest panel, room between panels, name above each, pixels.
const PANEL_PX: [i32; 2] = [220, 420];
const PANEL_GAP_PX: i32 = 16;
const PANEL_NAME_PX: i32 = 28;
/// Column of the colour bar beside the panels, pixels.
const BAR_PX: i32 = 110;

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
    let view = view_of(map, lasers, events, options, PLOT_MIN_PX, options.plot_max_px());
    let keys = legend(map, lasers, events);
    let face = Face::load()?;
    let column = sheet::legend_height_px(&face, LEGEND_PX, &keys);
    let map_height = view.size_px()[1] + sheet::AXIS_X_PX;
    let right = LEGEND_PX + 22;
    // Panels use the width below the legend too, unless the legend is longer than the map.
    let width = Sheet::width_px(&face, &view, right) - 2 * PAD - BAR_PX;
    let width = if column > map_height { width - right } else { width };
    let panels = Panels::new(map, options, &view, width, map_height.max(column));
    let texts = Texts {
        title: &map.title,
        subtitle: &map.subtitle,
        caption: caption(map, lasers, events, options, [&view, &panels.view]),
        format: options.format,
    };
    let (right, height) = match panels.beside {
        true => (right + 24 + panels.width_px(), map_height.max(panels.height_px())),
        false => (right, map_height + 10 + panels.height_px()),
    };
    let mut sheet = Sheet::new(view, &texts, right, 0, height.max(column))?;
    let (view, area) = (sheet.view, sheet.view.area());
    view.paint_cells(&mut sheet.canvas, |cells| paint(map, cells, options.gamma));
    sheet.axes();
    marks::draw_marks(&mut sheet.canvas, &sheet.face, &view, lasers, events);
    sheet.legend(area.right() + 22, area.y + 8, LEGEND_PX, &keys);
    let at = match panels.beside {
        true => [area.right() + 22 + LEGEND_PX + 24, area.y - PANEL_NAME_PX + 6],
        false => [PAD, area.y + map_height + 10],
    };
    panels.draw(&mut sheet, map, lasers, options.gamma, at);
    sheet.canvas.file()
}

fn view_of(
    map: &OverviewMap,
    lasers: &[LaserMark],
    events: &[EventMark],
    options: &Options,
    min_px: [i32; 2],
    max_px: [i32; 2],
) -> View {
    let observed = |index: usize| map.classes.iter().any(|c| !c.share[index].is_nan());
    let crop: Option<&dyn Fn(usize) -> bool> = if options.crop { Some(&observed) } else { None };
    let lasers = lasers.iter().map(|l| [l.x_m, l.y_m]);
    let keep: Vec<[f64; 2]> = lasers.chain(events.iter().map(|e| [e.x_m, e.y_m])).collect();
    View::new(&map.grid, crop, &keep, min_px, max_px)
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
        gamma_text(options.gamma).replace("Colours", "colours"),
        reduction_text(view, panel),
        sheet::outside_text("laser", &marks::lasers_outside(view, lasers)),
        sheet::outside_text("event", &marks::events_outside(view, events)),
    )
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

/// The panels of the classes, all of one size.
struct Panels {
    view: View,
    columns: i32,
    rows: i32,
    /// Right of the legend, if the map is not wide; else below the map.
    beside: bool,
}

impl Panels {
    /// Panels as large as fit below the map (`width`) or beside it (`height` pixels).
    fn new(map: &OverviewMap, options: &Options, main: &View, width: i32, height: i32) -> Self {
        let count = map.classes.len().max(1) as i32;
        let [main_width, main_height] = main.size_px();
        let beside = main_width * 4 < main_height * 5 || main_width < 2 * PANEL_PX[0] + BAR_PX;
        let (columns, max_px) = if beside {
            let rows = ((count + 3) / 4).max(2).min(count);
            let side = height / rows - PANEL_NAME_PX - PANEL_GAP_PX;
            ((count + rows - 1) / rows, [PANEL_PX[1], side.max(PANEL_PX[0])])
        } else {
            let fit = ((width + PANEL_GAP_PX) / (PANEL_PX[0] + PANEL_GAP_PX)).clamp(1, 4);
            let rows = (count + fit - 1) / fit;
            let columns = (count + rows - 1) / rows;
            let side = ((width + PANEL_GAP_PX) / columns - PANEL_GAP_PX).min(PANEL_PX[1]);
            (columns, [side, side])
        };
        // No marks are kept in view: the panels show what was observed, as large as it goes.
        let view = view_of(map, &[], &[], options, [120, 60], max_px);
        Self { view, columns, rows: (count + columns - 1) / columns, beside }
    }

    fn pitch_px(&self) -> [i32; 2] {
        let [width, height] = self.view.size_px();
        [width + PANEL_GAP_PX, height + PANEL_NAME_PX + PANEL_GAP_PX]
    }

    /// Width of all columns and the colour bar.
    fn width_px(&self) -> i32 {
        self.columns * self.pitch_px()[0] + BAR_PX
    }

    /// Height of all rows, at least that of a readable colour bar.
    fn height_px(&self) -> i32 {
        (self.rows * self.pitch_px()[1]).max(150 + PANEL_NAME_PX)
    }

    /// Draws the panels, their names and the colour bar, the upper left corner at `at`.
    fn draw(
        &self,
        sheet: &mut Sheet,
        map: &OverviewMap,
        lasers: &[LaserMark],
        gamma: f64,
        at: [i32; 2],
    ) {
        let pitch = self.pitch_px();
        for (i, class) in map.classes.iter().enumerate() {
            let (column, row) = (i as i32 % self.columns, i as i32 / self.columns);
            let (x, y) = (at[0] + column * pitch[0], at[1] + row * pitch[1] + PANEL_NAME_PX);
            let view = self.view.placed(x, y);
            view.paint_cells(&mut sheet.canvas, |cells| share::paint(&class.share, cells, gamma));
            sheet.canvas.outline(view.area().grown(1), INK);
            marks::draw_small_lasers(&mut sheet.canvas, &view, lasers);
            name_panel(sheet, class, view.area());
        }
        let x = at[0] + self.columns * pitch[0] + 6;
        let bar = (self.height_px() - PANEL_NAME_PX - PANEL_GAP_PX).clamp(120, 300);
        sheet.colour_bar(Rect::new(x, at[1] + PANEL_NAME_PX, 20, bar), gamma);
    }
}

/// Writes the name of a class above its panel and, if there is room, its largest share.
fn name_panel(sheet: &mut Sheet, class: &ClassShare, area: Rect) {
    let largest = class.share.iter().copied().fold(f32::NAN, f32::max);
    let note = match largest {
        s if s.is_nan() => "not observed".to_owned(),
        0.0 => "never".to_owned(),
        s if s < 0.001 => "below 0.1 %".to_owned(),
        s => format!("up to {}", scale::percent(f64::from(s))),
    };
    let style = |colour, anchor| Style::new(TEXT_PX, colour, anchor);
    let (canvas, face) = (&mut sheet.canvas, &sheet.face);
    let name = face.cut(&class.name, TEXT_PX, area.width);
    let y = area.y - 14;
    face.draw(canvas, &name, area.x, y, style(INK, Anchor::Left));
    if face.width(&name, TEXT_PX) + 12 + face.width(&note, TEXT_PX) <= area.width {
        face.draw(canvas, &note, area.right(), y, style(FAINT, Anchor::Right));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
        let map = OverviewMap { grid, classes, title: String::new(), subtitle: String::new() };
        let lead = mix(EMPTY, class_colour(4), TINT_MIN + (1.0 - TINT_MIN) * f64::from(0.2f32));
        assert_eq!(paint(&map, &[0], 1.0), Paint::Colour(lead));
        assert_eq!(paint(&map, &[1], 1.0), Paint::Colour(EMPTY));
        assert_eq!(paint(&map, &[2], 1.0), Paint::Never);
        assert_eq!(paint(&map, &[1, 2, 0], 1.0), Paint::Colour(lead));
    }
}
