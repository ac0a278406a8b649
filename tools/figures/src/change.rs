//! One class of two collapsed maps of the same grid: where it became more or less frequent.

use crate::FigureError;
use crate::canvas::Rect;
use crate::input::{ChangeMap, EventMark, LaserMark, Options, check_grid, check_share};
use crate::marks;
use crate::palette::{NEWLY_OBSERVED, NO_MORE_OBSERVED, diverging, unchanged};
use crate::sheet::{self, Key, PLOT_MIN_PX, Sheet, Texts};
use crate::view::{Paint, View};

/// Free to the right of the map: colour bar, its numbers and its title, pixels.
const RIGHT_PX: i32 = 116;
/// Narrowest list of places, pixels: a sentence in two lines.
const LIST_PX: i32 = 480;
/// Most places in the list: more would be longer than the map.
const PLACES_MAX: usize = 12;
/// Shares on the colour bar, most important first.
const BAR_SHARES: [f64; 5] = [1.0, 0.5, 0.1, 0.25, 0.05];

/// Below this change a cell is shown by its share, so that walls that stayed tell where one is.
const UNCHANGED_MAX: f64 = 0.02;

/// Draws how the share of a class changed in each cell, as a file of `options.format`: red where it
/// rose, blue where it fell, by |change| ^ gamma, grey where it stayed; cells that only one of the maps has observed have a
/// colour of their own, those that neither has are hatched. `places` are numbered, and listed below.
///
/// Where the grid is too large for the picture, a pixel shows the largest change of its cells.
///
/// # Errors
/// [`FigureError`] if the grid, a share or gamma is out of range, or an array is too short or long.
pub fn share_change(
    map: &ChangeMap,
    lasers: &[LaserMark],
    places: &[EventMark],
    options: &Options,
) -> Result<Vec<u8>, FigureError> {
    options.check()?;
    check_grid(&map.grid)?;
    check_share("earlier map", &map.before, &map.grid)?;
    check_share("later map", &map.after, &map.grid)?;
    let places = &places[..places.len().min(PLACES_MAX)];
    let view = view_of(map, lasers, options);
    let texts = Texts {
        title: &map.title,
        subtitle: &map.subtitle,
        caption: format!(
            "{}{}{}",
            scale_text(options.gamma),
            sheet::reduction_text(&view, "the largest change of them"),
            sheet::outside_text("laser", &marks::lasers_outside(&view, lasers)),
        ),
        format: options.format,
    };
    let keys = legend(places, !lasers.is_empty());
    let width = view.size_px()[0].max(LIST_PX);
    let face = crate::text::Face::load()?;
    let below = sheet::legend_height_px(&face, width, &keys) + 8;
    let mut sheet = Sheet::new(view, &texts, RIGHT_PX, below, 0)?;
    let (view, area) = (sheet.view, sheet.view.area());
    view.paint_cells(&mut sheet.canvas, |cells| paint(map, cells, options.gamma));
    sheet.axes();
    let bar = Rect::new(area.right() + 22, area.y, 20, area.height);
    let titles = ["change of the share of the observed frames", "change of the share", "change"];
    sheet.bar(
        bar,
        |up| diverging(2.0 * up - 1.0),
        &bar_marks(options.gamma, 18.0 / f64::from(bar.height)),
        &titles,
    );
    marks::draw_marks(&mut sheet.canvas, &sheet.face, &view, lasers, places);
    sheet.legend(area.x, area.bottom() + 66, width, &keys);
    sheet.canvas.file()
}

fn view_of(map: &ChangeMap, lasers: &[LaserMark], options: &Options) -> View {
    let observed = |index: usize| !(map.before[index].is_nan() && map.after[index].is_nan());
    let keep: Vec<[f64; 2]> = lasers.iter().map(|l| [l.x_m, l.y_m]).collect();
    let crop: Option<&dyn Fn(usize) -> bool> = if options.crop { Some(&observed) } else { None };
    View::new(&map.grid, crop, &keep, PLOT_MIN_PX, options.plot_max_px())
}

fn legend(places: &[EventMark], lasers: bool) -> Vec<(Key, String)> {
    let place = |(i, place): (usize, &EventMark)| (Key::Event(i + 1), place.label.clone());
    let mut keys: Vec<(Key, String)> = places.iter().enumerate().map(place).collect();
    keys.push((Key::Colour(unchanged(1.0)), "unchanged; white where the class never was".into()));
    keys.push((Key::Colour(NEWLY_OBSERVED), "observed in the later map only".into()));
    keys.push((Key::Colour(NO_MORE_OBSERVED), "observed in the earlier map only".into()));
    keys.push((Key::Never, "never observed".into()));
    if lasers {
        keys.push((Key::Laser, "laser".into()));
    }
    keys
}

fn scale_text(gamma: f64) -> String {
    let scale = match gamma {
        1.0 => "Colours are in proportion to the change.".to_owned(),
        _ => format!(
            "Small changes are drawn stronger than in proportion (colour = change ^ {gamma})."
        ),
    };
    format!("Red: more frequent in the later map; blue: less; grey: unchanged. {scale} ")
}

/// Marks of the colour bar, from -100 % at 0 to +100 % at 1, that keep `spacing` apart.
fn bar_marks(gamma: f64, spacing: f64) -> Vec<(f64, String)> {
    let mut kept = vec![(0.5, "0 %".to_owned())];
    for share in BAR_SHARES {
        let half = share.powf(gamma) / 2.0;
        if kept.iter().all(|(at, _)| (at - 0.5 - half).abs() >= spacing) {
            kept.push((0.5 + half, format!("+{:.0} %", share * 100.0)));
            kept.push((0.5 - half, format!("−{:.0} %", share * 100.0)));
        }
    }
    kept
}

/// Colour of a block of cells: that of its largest change.
fn paint(map: &ChangeMap, cells: &[usize], gamma: f64) -> Paint {
    let change = |cell: &usize| map.after[*cell] - map.before[*cell];
    let known = cells.iter().map(change).filter(|change| !change.is_nan());
    if let Some(change) = known.max_by(|a, b| a.abs().total_cmp(&b.abs())) {
        let change = f64::from(change);
        if change.abs() < UNCHANGED_MAX {
            let share = cells.iter().map(|cell| map.after[*cell]).fold(0.0, f32::max);
            return Paint::Colour(unchanged(f64::from(share)));
        }
        return Paint::Colour(diverging(change.signum() * change.abs().powf(gamma)));
    }
    if cells.iter().any(|cell| !map.after[*cell].is_nan()) {
        return Paint::Colour(NEWLY_OBSERVED);
    }
    match cells.iter().any(|cell| !map.before[*cell].is_nan()) {
        true => Paint::Colour(NO_MORE_OBSERVED),
        false => Paint::Never,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::geometry::GridGeometry;

    #[test]
    fn the_marks_of_the_bar_keep_apart_and_its_ends_are_marked() {
        for (gamma, spacing) in [(1.0, 0.075), (0.4, 0.02), (1.0, 0.3)] {
            let mut marks = bar_marks(gamma, spacing);
            marks.sort_by(|a, b| a.0.total_cmp(&b.0));
            assert_eq!((marks[0].0, marks[marks.len() - 1].0), (0.0, 1.0));
            assert_eq!((&*marks[0].1, &*marks[marks.len() - 1].1), ("−100 %", "+100 %"));
            assert!(marks.windows(2).all(|pair| pair[1].0 - pair[0].0 >= spacing), "{marks:?}");
        }
    }

    #[test]
    fn a_cell_shows_its_change_and_one_that_only_one_map_saw_says_so() {
        let n = f32::NAN;
        let map = ChangeMap {
            grid: GridGeometry { origin_m: [0.0; 2], cell_m: 0.1, columns: 6, rows: 1 },
            before: vec![0.25, 1.0, n, 0.5, n, 1.0],
            after: vec![0.5, 0.0, 0.5, n, n, 1.0],
            title: String::new(),
            subtitle: String::new(),
        };
        assert_eq!(paint(&map, &[0], 0.5), Paint::Colour(diverging(0.5)));
        assert_eq!(paint(&map, &[1, 0], 0.5), Paint::Colour(diverging(-1.0)));
        assert_eq!(paint(&map, &[2, 4], 0.5), Paint::Colour(NEWLY_OBSERVED));
        assert_eq!(paint(&map, &[3, 4], 0.5), Paint::Colour(NO_MORE_OBSERVED));
        assert_eq!(paint(&map, &[4], 0.5), Paint::Never);
        assert_eq!(paint(&map, &[5], 0.5), Paint::Colour(unchanged(1.0)));
    }
}
