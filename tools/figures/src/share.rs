//! One class of a collapsed map.

use crate::FigureError;
use crate::canvas::Rect;
use crate::input::{LaserMark, Options, Scale, ShareMap, check_grid, check_share};
use crate::marks;
use crate::palette::viridis;
use crate::scale::{self, percent_of_top};
use crate::sheet::{self, Key, PLOT_MIN_PX, Sheet, Texts};
use crate::view::{Paint, View};

/// Free to the right of the map: colour bar, its numbers and its title, pixels.
const RIGHT_PX: i32 = 116;
/// Below the axis: the legend, pixels.
const BELOW_PX: i32 = 30;

/// Draws how often each cell was of one class, as a file of `options.format`.
///
/// Colour is viridis at share ^ gamma, the same for every class, or with [`Scale::Max`] at
/// (share / largest share) ^ gamma; cells that were never observed
/// are hatched grey. Where the grid is too large for the picture, a pixel shows the largest share
/// of its cells, so that thin walls stay.
///
/// # Errors
/// [`FigureError`] if the grid, a share or gamma is out of range, or the array is too short or long.
pub fn class_share(
    map: &ShareMap,
    lasers: &[LaserMark],
    options: &Options,
) -> Result<Vec<u8>, FigureError> {
    draw(map, lasers, options)?.canvas.file()
}

fn draw(map: &ShareMap, lasers: &[LaserMark], options: &Options) -> Result<Sheet, FigureError> {
    options.check()?;
    check_grid(&map.grid)?;
    check_share(&map.title, &map.share, &map.grid)?;
    let view = view_of(map, lasers, options);
    let top = top_of(&map.share, options.scale);
    let outside = marks::lasers_outside(&view, lasers);
    let texts = Texts {
        title: &map.title,
        subtitle: &map.subtitle,
        caption: format!(
            "{}{}{}",
            scale_text(options.gamma, top),
            sheet::reduction_text(&view, "the largest share of them"),
            sheet::outside_text("laser", &outside)
        ),
        format: options.format,
    };
    let mut sheet = Sheet::new(view, &texts, RIGHT_PX, BELOW_PX, 0)?;
    let view = sheet.view;
    view.paint_cells(&mut sheet.canvas, |cells| paint(&map.share, cells, options.gamma, top));
    sheet.axes();
    let area = view.area();
    sheet.colour_bar(Rect::new(area.right() + 22, area.y, 20, area.height), options.gamma, top);
    marks::draw_marks(&mut sheet.canvas, &sheet.face, &view, lasers, &[]);
    let y = area.bottom() + 66;
    sheet.legend(area.x, y, 150, &[(Key::Never, "never observed".into())]);
    if !lasers.is_empty() {
        sheet.legend(area.x + 160, y, 140, &[(Key::Laser, "laser".into())]);
    }
    Ok(sheet)
}

fn view_of(map: &ShareMap, lasers: &[LaserMark], options: &Options) -> View {
    let observed = |index: usize| !map.share[index].is_nan();
    let keep: Vec<[f64; 2]> = lasers.iter().map(|l| [l.x_m, l.y_m]).collect();
    let crop: Option<&dyn Fn(usize) -> bool> = if options.crop { Some(&observed) } else { None };
    View::new(&map.grid, crop, &keep, PLOT_MIN_PX, options.plot_max_px())
}

/// The share at which the scale of colour ends.
fn top_of(share: &[f32], scale: Scale) -> f64 {
    let largest = share.iter().copied().fold(0.0, f32::max);
    if scale == Scale::Full || largest == 0.0 { 1.0 } else { f64::from(largest) }
}

fn scale_text(gamma: f64, top: f64) -> String {
    if top == 1.0 {
        return gamma_text(gamma, "class");
    }
    let own =
        format!("The scale ends at the largest share of this picture, {}. ", percent_of_top(top));
    match gamma {
        1.0 => format!("Colours are in proportion to the share. {own}"),
        _ => format!("{} (colour = share ^ {gamma}). {own}", RARE_TEXT),
    }
}

const RARE_TEXT: &str = "Rare things are drawn brighter than in proportion";

/// The sentence that states the scale, which is the same for every `one`.
pub(crate) fn gamma_text(gamma: f64, one: &str) -> String {
    match gamma {
        1.0 => format!("Colours are in proportion to the share, the same for every {one}. "),
        _ => format!("{RARE_TEXT} (colour = share ^ {gamma}), the same for every {one}. "),
    }
}

/// Colour of a block of cells: that of its largest share, on a scale that ends at `top`.
pub(crate) fn paint(share: &[f32], cells: &[usize], gamma: f64, top: f64) -> Paint {
    // f32::max passes over NaN.
    let largest = cells.iter().map(|c| share[*c]).fold(f32::NAN, f32::max);
    if largest.is_nan() {
        return Paint::Never;
    }
    Paint::Colour(viridis(scale::place(f64::from(largest), top, gamma)))
}
