//! The page round a map: title, axes, scale bar, colour bar, legend, caption.

use crate::FigureError;
use crate::canvas::{Canvas, FAINT, INK, Rect, Rgb, WHITE};
use crate::input::FileFormat;
use crate::marks;
use crate::palette::{ZONE, viridis};
use crate::scale;
use crate::text::{Anchor, Face, Style};
use crate::view::View;

/// Edge of the page, pixels.
pub(crate) const PAD: i32 = 20;
/// em of the title, of the text, of tick labels and captions, pixels.
const TITLE_PX: f32 = 21.0;
pub(crate) const TEXT_PX: f32 = 14.0;
const SMALL_PX: f32 = 12.5;
/// Height of a line of small text, pixels.
pub(crate) const LINE_PX: i32 = 19;
/// Narrowest page: room for a title and a caption, pixels.
const PAGE_MIN_PX: i32 = 560;
/// Below the map: tick labels, axis title and scale bar.
pub(crate) const AXIS_X_PX: i32 = 56;
/// Smallest map: room for an axis and a colour bar.
pub(crate) const PLOT_MIN_PX: [i32; 2] = [300, 240];

/// The texts of a page.
pub(crate) struct Texts<'a> {
    pub title: &'a str,
    pub subtitle: &'a str,
    /// Sentences under the map.
    pub caption: String,
    /// Format of the file.
    pub format: FileFormat,
}

/// A page with a map in it.
pub(crate) struct Sheet {
    pub canvas: Canvas,
    pub face: Face,
    pub view: View,
}

impl Sheet {
    /// A page for `view`, with `right_px` free to the right of the map and `below_px` between the
    /// axis and the caption, at least `height_px` from the top of the map down to the caption.
    pub fn new(
        view: View,
        texts: &Texts<'_>,
        right_px: i32,
        below_px: i32,
        height_px: i32,
    ) -> Result<Self, FigureError> {
        let face = Face::load()?;
        let [width, height] = view.size_px();
        let left = Self::left_px(&face, &view);
        let page = Self::width_px(&face, &view, right_px);
        let text_width = page - 2 * PAD;
        let subtitle = face.wrap(texts.subtitle, TEXT_PX, text_width, 2);
        let caption = face.wrap(&texts.caption, SMALL_PX, text_width, 4);
        let top = PAD + 30 + LINE_PX * subtitle.len() as i32 + 12;
        let bottom = top + (height + AXIS_X_PX + below_px).max(height_px);
        let end = bottom + LINE_PX * caption.len() as i32 + PAD - 4;
        let mut canvas = Canvas::of(texts.format, page, end);
        let title = face.cut(texts.title, TITLE_PX, text_width);
        let style = |size, colour| Style::new(size, colour, Anchor::Left);
        face.draw(&mut canvas, &title, PAD, PAD + 10, style(TITLE_PX, INK));
        for (i, line) in subtitle.iter().enumerate() {
            let y = PAD + 38 + LINE_PX * i as i32;
            face.draw(&mut canvas, line, PAD, y, style(TEXT_PX, FAINT));
        }
        for (i, line) in caption.iter().enumerate() {
            let y = bottom + 8 + LINE_PX * i as i32;
            face.draw(&mut canvas, line, PAD, y, style(SMALL_PX, FAINT));
        }
        // A page wider than its map has the map in the middle of what is left over.
        let left = left + (page - left - width - right_px - PAD) / 2;
        Ok(Self { canvas, face, view: view.placed(left, top) })
    }

    /// Left of the map: edge, axis title, the widest number.
    pub fn left_px(face: &Face, view: &View) -> i32 {
        let widest = y_ticks(view).iter().map(|t| face.width(&t.1, SMALL_PX)).max().unwrap_or(0);
        PAD + 24 + widest + 8
    }

    /// Width of the page.
    pub fn width_px(face: &Face, view: &View, right_px: i32) -> i32 {
        (Self::left_px(face, view) + view.size_px()[0] + right_px + PAD).max(PAGE_MIN_PX)
    }

    /// Frame, ticks and numbers in metres, and the scale bar.
    pub fn axes(&mut self) {
        let (area, view) = (self.view.area(), self.view);
        let style = |anchor| Style::new(SMALL_PX, INK, anchor);
        self.canvas.outline(area.grown(1), INK);
        for (x_m, text) in x_ticks(&view, &self.face) {
            let x = (view.x_px(x_m).round() as i32).min(area.right() - 1);
            self.canvas.fill(Rect::new(x, area.bottom(), 1, 6), INK);
            self.face.draw(&mut self.canvas, &text, x, area.bottom() + 15, style(Anchor::Centre));
        }
        for (y_m, text) in y_ticks(&view) {
            let y = (view.y_px(y_m).round() as i32).min(area.bottom() - 1);
            self.canvas.fill(Rect::new(area.x - 6, y, 6, 1), INK);
            self.face.draw(&mut self.canvas, &text, area.x - 9, y, style(Anchor::Right));
        }
        let y = area.bottom() + 38;
        self.face.draw(&mut self.canvas, "x (m)", area.x, y, style(Anchor::Left));
        let widest = y_ticks(&view).iter().map(|t| self.face.width(&t.1, SMALL_PX)).max();
        let x = area.x - 9 - widest.unwrap_or(0) - 14;
        let middle = area.y + area.height / 2;
        self.face.draw_upwards(&mut self.canvas, "y (m)", x, middle, style(Anchor::Centre));
        self.scale_bar(y);
    }

    /// A bar of a round length, right-aligned with the map on the line y.
    fn scale_bar(&mut self, y: i32) {
        let (area, scale) = (self.view.area(), self.view.px_per_m());
        let length_m = scale::round_below(f64::from(area.width) * 0.25 / scale);
        let length = ((length_m * scale).round() as i32).max(1);
        let text = format!("{} m", scale::number(length_m, length_m));
        let x = area.right() - self.face.width(&text, SMALL_PX) - 8 - length;
        self.canvas.fill(Rect::new(x, y - 1, length, 3), INK);
        self.canvas.fill(Rect::new(x, y - 5, 1, 11), INK);
        self.canvas.fill(Rect::new(x + length - 1, y - 5, 1, 11), INK);
        let style = Style::new(SMALL_PX, INK, Anchor::Left);
        self.face.draw(&mut self.canvas, &text, x + length + 8, y, style);
    }

    /// The scale of shares from 0 to `top` as a bar in `bar`, with numbers to its right and a title
    /// beside them.
    pub fn colour_bar(&mut self, bar: Rect, gamma: f64, top: f64) {
        let spacing = 18.0 / f64::from((bar.height - 1).max(1));
        let marks = scale::share_marks(gamma, top, spacing);
        let titles = ["share of the observed frames", "share of frames", "share"];
        self.bar(bar, viridis, &marks, &titles);
    }

    /// A bar from the colour of 0 (below) to that of 1 (above), with marks at places 0..=1 and the
    /// first of the titles that fits.
    pub fn bar(
        &mut self,
        bar: Rect,
        colour: impl Fn(f64) -> Rgb,
        marks: &[(f64, String)],
        titles: &[&str],
    ) {
        for y in bar.y..bar.bottom() {
            // Middle of the first row is 1, middle of the last is 0.
            let up = f64::from(bar.bottom() - 1 - y) / f64::from((bar.height - 1).max(1));
            self.canvas.fill(Rect::new(bar.x, y, bar.width, 1), colour(up));
        }
        self.canvas.outline(bar.grown(1), INK);
        let span = f64::from(bar.height - 1);
        let style = |anchor| Style::new(SMALL_PX, INK, anchor);
        for (at, text) in marks {
            let y = bar.bottom() - 1 - (at * span).round() as i32;
            self.canvas.fill(Rect::new(bar.right() + 1, y, 5, 1), INK);
            self.face.draw(&mut self.canvas, text, bar.right() + 10, y, style(Anchor::Left));
        }
        let (x, middle) = (bar.right() + 66, bar.y + bar.height / 2);
        let fits = |t: &&&str| self.face.width(t, SMALL_PX) <= bar.height;
        let title = titles.iter().find(fits).copied().unwrap_or_default();
        self.face.draw_upwards(&mut self.canvas, title, x, middle, style(Anchor::Centre));
    }

    /// Draws keys (sign, text) below each other from (x, y), each at most `width` pixels wide.
    pub fn legend(&mut self, x: i32, y: i32, width: i32, keys: &[(Key, String)]) {
        let mut y = y;
        for (key, text) in keys {
            let swatch = Rect::new(x, y - 7, 22, 14);
            match key {
                Key::Colour(colour) => self.canvas.fill(swatch, *colour),
                Key::Never => self.canvas.fill_hatched(swatch),
                Key::Laser => marks::legend_arrow(&mut self.canvas, x + 9, y),
                Key::Zone => {
                    self.canvas.fill(swatch, ZONE);
                    self.canvas.fill(swatch.grown(-2), WHITE);
                }
                Key::Event(n) => marks::disc(&mut self.canvas, &self.face, *n, x + 11, y),
            }
            if matches!(key, Key::Colour(_) | Key::Never) {
                self.canvas.outline(swatch, FAINT);
            }
            let lines = key_lines(&self.face, text, width);
            for (i, line) in lines.iter().enumerate() {
                let style = Style::new(TEXT_PX, INK, Anchor::Left);
                let y = y + i as i32 * WRAPPED_LINE_PX;
                self.face.draw(&mut self.canvas, line, x + 30, y, style);
            }
            y += key_height_px(lines.len());
        }
    }
}

/// Width that [`Sheet::legend`] with these keys needs, at most `width`, pixels.
pub(crate) fn legend_width_px(face: &Face, width: i32, keys: &[(Key, String)]) -> i32 {
    keys.iter().map(|(_, text)| 30 + face.width(text, TEXT_PX)).max().unwrap_or(0).min(width)
}

/// Height of [`Sheet::legend`] with these keys, pixels.
pub(crate) fn legend_height_px(face: &Face, width: i32, keys: &[(Key, String)]) -> i32 {
    keys.iter().map(|(_, text)| key_height_px(key_lines(face, text, width).len())).sum::<i32>() + 12
}

fn key_height_px(lines: usize) -> i32 {
    LEGEND_LINE_PX + (lines.max(1) as i32 - 1) * WRAPPED_LINE_PX
}

/// The lines of one key: a long text takes two.
fn key_lines(face: &Face, text: &str, width: i32) -> Vec<String> {
    face.wrap(text, TEXT_PX, width - 30, 2)
}

/// Distance of two keys of a legend, and of two lines of one key, pixels.
const LEGEND_LINE_PX: i32 = 24;
const WRAPPED_LINE_PX: i32 = 18;

/// The sign of a line of a legend.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Key {
    Colour(Rgb),
    Never,
    Laser,
    Zone,
    Event(usize),
}

fn x_ticks(view: &View, face: &Face) -> Vec<(f64, String)> {
    let [low, high] = view.span_m(0);
    scale::ticks(low, high, view.px_per_m(), |text| face.width(text, SMALL_PX) + 26)
}

fn y_ticks(view: &View) -> Vec<(f64, String)> {
    let [low, high] = view.span_m(1);
    scale::ticks(low, high, view.px_per_m(), |_| 38)
}

/// The sentence for a reduced grid, with what a pixel then shows.
pub(crate) fn reduction_text(view: &View, what: &str) -> String {
    match view.reduction() {
        1 => String::new(),
        n => format!("A pixel is {n} × {n} cells and shows {what}. "),
    }
}

/// The sentence for marks that are not in the picture.
pub(crate) fn outside_text(kind: &str, outside: &[String]) -> String {
    if outside.is_empty() {
        return String::new();
    }
    format!("Outside the picture: {kind} {}. ", outside.join(", "))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use protocol::geometry::GridGeometry;

    fn sheet() -> Sheet {
        let grid = GridGeometry { origin_m: [0.0; 2], cell_m: 0.1, columns: 30, rows: 30 };
        let view = View::new(&grid, None, &[], PLOT_MIN_PX, [400, 400]);
        let texts =
            Texts { title: "title", subtitle: "", caption: String::new(), format: FileFormat::Png };
        Sheet::new(view, &texts, 120, 0, 0).unwrap()
    }

    #[test]
    fn the_colour_bar_ends_in_the_colours_of_zero_and_one() {
        let mut sheet = sheet();
        let bar = Rect::new(450, 60, 20, 300);
        sheet.colour_bar(bar, 0.4, 1.0);
        assert_eq!(sheet.canvas.pixel(460, 60), Some(viridis(1.0)));
        assert_eq!(sheet.canvas.pixel(460, 359), Some(viridis(0.0)));
        // The mark of 10 % stands at the colour that a cell with a share of 10 % has.
        let y = 359 - (0.1f64.powf(0.4) * 299.0).round() as i32;
        assert_eq!(sheet.canvas.pixel(bar.right() + 3, y), Some(INK));
        let (found, wanted) = (sheet.canvas.pixel(460, y).unwrap(), viridis(0.1f64.powf(0.4)));
        assert!(found.iter().zip(wanted).all(|(a, b)| a.abs_diff(b) <= 2), "{found:?} {wanted:?}");
    }

    #[test]
    fn the_scale_bar_has_the_length_that_it_names() {
        let mut sheet = sheet();
        sheet.axes();
        // 30 cells of 0.1 m on 390 pixels: a quarter is 0.75 m, the round length below 0.5 m.
        let (area, y) = (sheet.view.area(), sheet.view.area().bottom() + 38);
        let ink = |x: &i32| sheet.canvas.pixel(*x, y - 5) == Some(INK);
        let ends: Vec<i32> = (area.x + 100..area.right() - 30).filter(ink).collect();
        assert_eq!(ends.len(), 2, "{ends:?}");
        assert_eq!(f64::from(ends[1] - ends[0] + 1), 0.5 * sheet.view.px_per_m());
    }
}
