//! Several maps on one page, two in a row, with one scale of colour: the figures of a paper.

use crate::FigureError;
use crate::canvas::{INK, Rect, WHITE};
use crate::input::{LaserMark, Options, check_grid, check_length, check_share};
use crate::marks;
use crate::palette::EVENT;
use crate::share::{self, gamma_text};
use crate::sheet::{self, AXIS_X_PX, Key, Sheet, TEXT_PX, Texts};
use crate::text::{Anchor, Face, Style};
use crate::view::View;
use protocol::geometry::GridGeometry;

/// Most panels of a page.
const PANELS_MAX: usize = 6;
/// Smallest panel: room for an axis.
const PANEL_MIN_PX: [i32; 2] = [240, 160];
/// Between two columns, and below the caption of a panel, pixels.
const GAP_PX: i32 = 18;
/// The caption of a panel.
const CAPTION_PX: i32 = 26;
/// Column of the colour bar.
const BAR_PX: i32 = 116;
/// The legend below all panels.
const LEGEND_PX: i32 = 26;

/// One map of a page.
#[derive(Debug, Clone)]
pub struct Panel {
    /// Share of the cell's observed frames, \[row, column\], 0..=1; NaN = never observed.
    pub share: Vec<f32>,
    /// Below the map: `(a) 1 second`.
    pub caption: String,
    /// Circles on this map.
    pub circles: Vec<CircleMark>,
}

/// A circle round something that the text speaks of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CircleMark {
    /// Site x of its centre, metres.
    pub x_m: f64,
    /// Site y of its centre, metres.
    pub y_m: f64,
    /// Radius, metres.
    pub radius_m: f64,
}

/// A page of maps of one grid.
#[derive(Debug, Clone)]
pub struct PanelSheet {
    /// Where the cells are.
    pub grid: GridGeometry,
    /// The maps, 1 to 6, row by row.
    pub panels: Vec<Panel>,
    /// Large line on top.
    pub title: String,
    /// Small lines below.
    pub subtitle: String,
    /// Under the maps, before the sentence on the scale of colour.
    pub caption: String,
}

/// Draws maps two by two with identical colours, as a file of `options.format`. All show the same window: what was
/// observed in any of them. [`Options::plot_max_px`] is the size of one panel.
///
/// # Errors
/// [`FigureError`] if the grid, a share or gamma is out of range, an array is too short or long, or
/// there are no panels or more than six.
pub fn panels(
    page: &PanelSheet,
    lasers: &[LaserMark],
    options: &Options,
) -> Result<Vec<u8>, FigureError> {
    options.check()?;
    check_grid(&page.grid)?;
    for panel in &page.panels {
        check_share(&panel.caption, &panel.share, &page.grid)?;
    }
    if !(1..=PANELS_MAX).contains(&page.panels.len()) {
        let what = format!("{} panels, 1 to {PANELS_MAX} expected", page.panels.len());
        check_length(&what, usize::MAX, &page.grid)?;
    }
    draw(page, lasers, options)?.canvas.file()
}

fn draw(page: &PanelSheet, lasers: &[LaserMark], options: &Options) -> Result<Sheet, FigureError> {
    let view = view_of(page, lasers, options);
    let columns = page.panels.len().min(2) as i32;
    let rows = (page.panels.len() as i32 + 1) / 2;
    let face = Face::load()?;
    let [width, height] = view.size_px();
    let pitch =
        [width + Sheet::left_px(&face, &view) + GAP_PX, height + AXIS_X_PX + CAPTION_PX + GAP_PX];
    let texts = Texts {
        title: &page.title,
        subtitle: &page.subtitle,
        caption: format!(
            "{}{}{}{}",
            page.caption,
            gamma_text(options.gamma, "panel"),
            sheet::reduction_text(&view, "the largest share of them"),
            sheet::outside_text("laser", &marks::lasers_outside(&view, lasers))
        ),
        format: options.format,
    };
    let right = (columns - 1) * pitch[0] + BAR_PX;
    let mut sheet = Sheet::new(view, &texts, right, 0, rows * pitch[1] + LEGEND_PX)?;
    let first = sheet.view;
    let corner = first.area();
    for (i, panel) in page.panels.iter().enumerate() {
        let (column, row) = (i as i32 % 2, i as i32 / 2);
        sheet.view = first.placed(corner.x + column * pitch[0], corner.y + row * pitch[1]);
        one(&mut sheet, panel, lasers, options.gamma);
    }
    sheet.view = first;
    let bar = Rect::new(
        corner.x + (columns - 1) * pitch[0] + width + 22,
        corner.y,
        20,
        (rows - 1) * pitch[1] + height,
    );
    sheet.colour_bar(bar, options.gamma, 1.0);
    let y = corner.y + rows * pitch[1] + 4;
    let mut x = corner.x;
    let mut keys = vec![(Key::Never, "never observed")];
    if !lasers.is_empty() {
        keys.push((Key::Laser, "laser"));
    }
    for (key, text) in keys {
        sheet.legend(x, y, 170, &[(key, text.to_owned())]);
        x += 170;
    }
    Ok(sheet)
}

/// Draws one panel where the view of the sheet is.
fn one(sheet: &mut Sheet, panel: &Panel, lasers: &[LaserMark], gamma: f64) {
    let view = sheet.view;
    view.paint_cells(&mut sheet.canvas, |cells| share::paint(&panel.share, cells, gamma, 1.0));
    marks::draw_small_lasers(&mut sheet.canvas, &view, lasers);
    for circle in &panel.circles {
        if let Some([x, y]) = view.px(circle.x_m, circle.y_m) {
            let radius = (circle.radius_m * view.px_per_m()) as f32;
            sheet.canvas.ring(x, y, radius, 5.5, WHITE);
            sheet.canvas.ring(x, y, radius, 2.5, EVENT);
        }
    }
    sheet.axes();
    let area = view.area();
    let style = Style::new(TEXT_PX, INK, Anchor::Centre);
    let caption = sheet.face.cut(&panel.caption, TEXT_PX, area.width);
    let (x, y) = (area.x + area.width / 2, area.bottom() + AXIS_X_PX + 6);
    sheet.face.draw(&mut sheet.canvas, &caption, x, y, style);
}

fn view_of(page: &PanelSheet, lasers: &[LaserMark], options: &Options) -> View {
    let observed = |index: usize| page.panels.iter().any(|panel| !panel.share[index].is_nan());
    let crop: Option<&dyn Fn(usize) -> bool> = if options.crop { Some(&observed) } else { None };
    let keep: Vec<[f64; 2]> = lasers.iter().map(|l| [l.x_m, l.y_m]).collect();
    View::new(&page.grid, crop, &keep, PANEL_MIN_PX, options.plot_max_px())
}
