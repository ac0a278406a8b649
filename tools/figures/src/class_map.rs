//! The classes at one instant.

use crate::FigureError;
use crate::input::{ClassGrid, LaserMark, Options, check_grid, check_length};
use crate::marks;
use crate::palette::class_colour;
use crate::sheet::{self, Key, PLOT_MIN_PX, Sheet, TEXT_PX, Texts};
use crate::text::Face;
use crate::view::{Paint, View};
use protocol::grid::CLASS_UNKNOWN;

/// Draws the class of every cell at one instant, as a file of `options.format`, with a legend of `names`.
///
/// Unknown cells are hatched grey. Where the grid is too large for the picture, a pixel shows the
/// most frequent class of its cells that is not `empty`, so that thin walls stay.
///
/// # Errors
/// [`FigureError`] if the grid is out of range or `classes` does not have a value per cell.
pub fn class_map(
    map: &ClassGrid,
    lasers: &[LaserMark],
    options: &Options,
) -> Result<Vec<u8>, FigureError> {
    check_grid(&map.grid)?;
    check_length(&map.title, map.classes.len(), &map.grid)?;
    let observed = |index: usize| map.classes[index] != CLASS_UNKNOWN;
    let keep: Vec<[f64; 2]> = lasers.iter().map(|l| [l.x_m, l.y_m]).collect();
    let crop: Option<&dyn Fn(usize) -> bool> = if options.crop { Some(&observed) } else { None };
    let view = View::new(&map.grid, crop, &keep, PLOT_MIN_PX, options.plot_max_px());
    let outside = marks::lasers_outside(&view, lasers);
    let keys = legend(map, !lasers.is_empty());
    let face = Face::load()?;
    let widest = keys.iter().map(|(_, text)| face.width(text, TEXT_PX)).max().unwrap_or(0);
    let legend_px = (widest + 30).clamp(60, 240);
    let caption = format!(
        "{}{}",
        sheet::reduction_text(&view, "the most frequent class of them that is not empty"),
        sheet::outside_text("laser", &outside)
    );
    let texts =
        Texts { title: &map.title, subtitle: &map.subtitle, caption, format: options.format };
    let height = sheet::legend_height_px(&face, legend_px, &keys);
    let mut sheet = Sheet::new(view, &texts, legend_px + 22, 0, height)?;
    let view = sheet.view;
    view.paint_cells(&mut sheet.canvas, |cells| paint(&map.classes, cells));
    sheet.axes();
    marks::draw_marks(&mut sheet.canvas, &sheet.face, &view, lasers, &[]);
    sheet.legend(view.area().right() + 22, view.area().y + 8, legend_px, &keys);
    sheet.canvas.file()
}

/// The named classes, then unknown, then the laser.
fn legend(map: &ClassGrid, lasers: bool) -> Vec<(Key, String)> {
    let mut keys: Vec<(Key, String)> = map
        .names
        .iter()
        .filter(|class| class.id != CLASS_UNKNOWN)
        .map(|class| (Key::Colour(class_colour(class.id)), class.name.clone()))
        .collect();
    // 16 is the most classes there are; a longer list is no legend.
    keys.truncate(protocol::grid::CLASSES_MAX);
    keys.push((Key::Never, "unknown".into()));
    if lasers {
        keys.push((Key::Laser, "laser".into()));
    }
    keys
}

/// The most frequent known class that is not empty, else empty, else never observed.
fn paint(classes: &[u8], cells: &[usize]) -> Paint {
    let mut counts = [0u32; 256];
    for cell in cells {
        counts[usize::from(classes[*cell])] += 1;
    }
    let known = &counts[1..usize::from(CLASS_UNKNOWN)];
    let most = known.iter().copied().max().unwrap_or(0);
    match known.iter().position(|n| *n == most && most > 0) {
        Some(at) => Paint::Colour(class_colour(at as u8 + 1)),
        None if counts[0] > 0 => Paint::Colour(class_colour(0)),
        None => Paint::Never,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reduced_pixel_keeps_a_thin_wall() {
        let classes = [0, 0, 4, CLASS_UNKNOWN, 1, 1];
        assert_eq!(paint(&classes, &[0, 1, 2, 3]), Paint::Colour(class_colour(4)));
        assert_eq!(paint(&classes, &[2, 4, 5]), Paint::Colour(class_colour(1)));
        assert_eq!(paint(&classes, &[0, 3]), Paint::Colour(class_colour(0)));
        assert_eq!(paint(&classes, &[3]), Paint::Never);
    }
}
