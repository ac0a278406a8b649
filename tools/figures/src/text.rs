//! Text on a canvas: DejaVu Sans (Latin part, in `font/`), smoothed, level or turned a quarter.

use crate::FigureError;
use crate::canvas::{Canvas, Rect, Rgb, WHITE};
use crate::vector::Words;
use ab_glyph::{Font, FontRef, Glyph, PxScale, ScaleFont, point};

static DEJAVU_SANS: &[u8] = include_bytes!("../font/DejaVuSans-Latin.ttf");
/// Longest text that is laid out; more could not be read in a picture anyway.
const CHARS_MAX: usize = 400;
/// Half the height of capitals, in em, so that texts are placed by their middle.
const HALF_CAPITAL_EM: f32 = 0.365;
/// White rim round text that lies on a map, pixels.
const HALO_PX: i32 = 2;

/// Which part of the text lies on the given x.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Anchor {
    Left,
    Centre,
    Right,
}

/// How a text looks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Style {
    /// em, pixels
    pub size: f32,
    pub colour: Rgb,
    pub anchor: Anchor,
    /// A white rim, for text on a map.
    pub halo: bool,
}

impl Style {
    pub fn new(size: f32, colour: Rgb, anchor: Anchor) -> Self {
        Self { size, colour, anchor, halo: false }
    }

    pub fn with_halo(self) -> Self {
        Self { halo: true, ..self }
    }
}

/// Coverage of a laid-out text, 0..=1, with its place relative to the anchor.
struct Mask {
    area: Rect,
    alpha: Vec<f32>,
}

/// The one typeface of all pictures.
pub(crate) struct Face {
    font: FontRef<'static>,
}

impl Face {
    pub fn load() -> Result<Self, FigureError> {
        let font = FontRef::try_from_slice(DEJAVU_SANS).map_err(|_| FigureError::Font)?;
        Ok(Self { font })
    }

    /// The text with what cannot be shown replaced: control characters by a space, others by `?`.
    fn shown(&self, text: &str) -> Vec<char> {
        let shown = text.chars().take(CHARS_MAX).map(|c| match c {
            c if c.is_control() => ' ',
            c if self.font.glyph_id(c).0 == 0 => '?',
            c => c,
        });
        shown.collect()
    }

    fn scale(&self, size: f32) -> PxScale {
        let per_em = self.font.units_per_em().unwrap_or(2048.0);
        PxScale::from(size * self.font.height_unscaled() / per_em)
    }

    /// Glyphs from x = 0 on the line y = 0, and the width of the line.
    fn lay(&self, text: &str, size: f32) -> (Vec<Glyph>, f32) {
        let scale = self.scale(size);
        let face = self.font.as_scaled(scale);
        let (mut x, mut last, mut glyphs) = (0.0, None, Vec::new());
        for c in self.shown(text) {
            let id = self.font.glyph_id(c);
            if let Some(last) = last {
                x += face.kern(last, id);
            }
            glyphs.push(id.with_scale_and_position(scale, point(x, 0.0)));
            x += face.h_advance(id);
            last = Some(id);
        }
        (glyphs, x)
    }

    /// Width of a text in pixels, rounded up.
    pub fn width(&self, text: &str, size: f32) -> i32 {
        self.lay(text, size).1.ceil() as i32
    }

    /// The text, cut with an ellipsis so that it is at most `width` pixels wide.
    pub fn cut(&self, text: &str, size: f32, width: i32) -> String {
        let mut chars = self.shown(text);
        let mut whole: String = chars.iter().collect();
        while self.width(&whole, size) > width && !chars.is_empty() {
            chars.pop();
            whole = chars.iter().collect::<String>().trim_end().to_owned() + "…";
        }
        whole
    }

    /// The text in lines at most `width` pixels wide, at most `lines_max` of them.
    pub fn wrap(&self, text: &str, size: f32, width: i32, lines_max: usize) -> Vec<String> {
        let mut lines: Vec<String> = Vec::new();
        let shown: String = self.shown(text).into_iter().collect();
        for word in shown.split_whitespace() {
            let joined = lines.last().map(|line| format!("{line} {word}"));
            match (joined, lines.last_mut()) {
                // The last line takes all the rest and is cut.
                (Some(joined), Some(line))
                    if self.width(&joined, size) <= width || lines_max <= 1 =>
                {
                    *line = joined;
                }
                _ => lines.push(word.to_owned()),
            }
        }
        if lines.len() > lines_max && lines_max > 0 {
            let rest = lines.split_off(lines_max - 1).join(" ");
            lines.push(rest);
        }
        lines.iter().map(|line| self.cut(line, size, width)).collect()
    }

    fn mask(&self, text: &str, style: Style) -> Mask {
        let (glyphs, width) = self.lay(text, style.size);
        let shift = match style.anchor {
            Anchor::Left => 0.0,
            Anchor::Centre => -width / 2.0,
            Anchor::Right => -width,
        };
        let size = style.size.ceil() as i32;
        let x = shift.floor() as i32 - HALO_PX;
        let area = Rect::new(x, -size, width.ceil() as i32 + 2 * HALO_PX + 2, 2 * size + 1);
        let mut alpha = vec![0.0f32; (area.width * area.height) as usize];
        let baseline = style.size * HALF_CAPITAL_EM;
        for mut glyph in glyphs {
            glyph.position.x += shift.round();
            glyph.position.y += baseline.round();
            let Some(outline) = self.font.outline_glyph(glyph) else { continue };
            let bounds = outline.px_bounds();
            let (left, top) = (bounds.min.x as i32 - area.x, bounds.min.y as i32 - area.y);
            outline.draw(|gx, gy, coverage| {
                let (mx, my) = (left + gx as i32, top + gy as i32);
                if mx >= 0 && my >= 0 && mx < area.width && my < area.height {
                    let at = &mut alpha[(my * area.width + mx) as usize];
                    *at = at.max(coverage);
                }
            });
        }
        Mask { area, alpha }
    }

    /// Draws a text whose anchor is at x and whose capitals are centred on y.
    pub fn draw(&self, canvas: &mut Canvas, text: &str, x: i32, y: i32, style: Style) {
        if canvas.vector().is_some() {
            return self.write(canvas, text, [x, y], style, false);
        }
        let mask = self.mask(text, style);
        if style.halo {
            mask.spread(HALO_PX).paint(|dx, dy, a| canvas.blend(x + dx, y + dy, WHITE, a));
        }
        mask.paint(|dx, dy, a| canvas.blend(x + dx, y + dy, style.colour, a));
    }

    /// The same turned a quarter to the left: it is read from below upwards.
    pub fn draw_upwards(&self, canvas: &mut Canvas, text: &str, x: i32, y: i32, style: Style) {
        if canvas.vector().is_some() {
            return self.write(canvas, text, [x, y], style, true);
        }
        let mask = self.mask(text, style);
        mask.paint(|dx, dy, a| canvas.blend(x + dy, y - dx, style.colour, a));
    }

    /// Leaves the text as text in a picture of shapes.
    fn write(&self, canvas: &mut Canvas, text: &str, [x, y]: [i32; 2], style: Style, up: bool) {
        let Some(vector) = canvas.vector() else { return };
        vector.text(&Words {
            text: &self.shown(text).into_iter().collect::<String>(),
            at: [x as f32, y as f32 + style.size * HALF_CAPITAL_EM],
            size: style.size,
            width: self.lay(text, style.size).1,
            colour: style.colour,
            anchor: match style.anchor {
                Anchor::Left => "start",
                Anchor::Centre => "middle",
                Anchor::Right => "end",
            },
            halo: if style.halo { HALO_PX } else { 0 },
            turned_at: up.then_some([x, y]),
        });
    }
}

impl Mask {
    fn paint(&self, mut put: impl FnMut(i32, i32, f32)) {
        for (at, &alpha) in self.alpha.iter().enumerate() {
            if alpha > 0.0 {
                let at = at as i32;
                put(self.area.x + at % self.area.width, self.area.y + at / self.area.width, alpha);
            }
        }
    }

    /// Every pixel takes the largest coverage within `by` pixels.
    fn spread(&self, by: i32) -> Self {
        let (width, height) = (self.area.width, self.area.height);
        let mut alpha = self.alpha.clone();
        for (at, &value) in self.alpha.iter().enumerate().filter(|(_, a)| **a > 0.0) {
            let (x, y) = (at as i32 % width, at as i32 / width);
            for dy in -by..=by {
                for dx in -by..=by {
                    let inside = (0..width).contains(&(x + dx)) && (0..height).contains(&(y + dy));
                    if inside && dx * dx + dy * dy <= by * by + 1 {
                        let to = &mut alpha[((y + dy) * width + x + dx) as usize];
                        *to = to.max(value * 0.85);
                    }
                }
            }
        }
        Self { area: self.area, alpha }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn every_character_of_a_caption_is_in_the_font() {
        let face = Face::load().unwrap();
        let text = "Share ^ 0.4 · 10 % − x (m) … × ÄÖÜß é ≥ → “quoted” – dash";
        assert_eq!(face.shown(text).into_iter().collect::<String>(), text);
        assert_eq!(face.shown("日\n"), ['?', ' ']);
    }

    #[test]
    fn text_is_cut_and_wrapped_to_its_width() {
        let face = Face::load().unwrap();
        let text = "the quick brown fox jumps over the lazy dog";
        assert!(face.width(&face.cut(text, 14.0, 100), 14.0) <= 100);
        assert!(face.cut(text, 14.0, 100).ends_with('…'));
        assert_eq!(face.cut("short", 14.0, 100), "short");
        let lines = face.wrap(text, 14.0, 120, 2);
        assert_eq!(lines.len(), 2);
        assert!(lines.iter().all(|line| face.width(line, 14.0) <= 120), "{lines:?}");
        assert_eq!(face.wrap(text, 14.0, 9_000, 3), [text]);
        assert!(face.wrap("", 14.0, 100, 2).is_empty());
    }
}
