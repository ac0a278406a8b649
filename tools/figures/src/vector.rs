//! A picture as SVG: what the canvas would paint as pixels, kept as shapes and text.
//!
//! Cells of a map are no shapes but one embedded image: a million squares would be a file of
//! 50 MB that no viewer opens, and the edges of an image of whole pixels are as sharp.

use crate::canvas::{Rect, Rgb};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Write as _;

/// Elements of an SVG file, in the order in which they lie on each other.
#[derive(Default)]
pub(crate) struct Vector {
    elements: String,
}

/// A text as [`Vector::text`] takes it.
pub(crate) struct Words<'a> {
    pub text: &'a str,
    /// Anchor and base line, pixels.
    pub at: [f32; 2],
    /// em and width, pixels.
    pub size: f32,
    pub width: f32,
    pub colour: Rgb,
    /// `start`, `middle` or `end`.
    pub anchor: &'static str,
    /// Width of the white rim, pixels; 0 is none.
    pub halo: i32,
    /// Point round which the text is turned a quarter to the left.
    pub turned_at: Option<[i32; 2]>,
}

fn hex([r, g, b]: Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Text as XML takes it.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c => out.push(c),
        }
    }
    out
}

// Writing to a String cannot fail: the results of `write!` are dropped.
impl Vector {
    pub fn rect(&mut self, area: Rect, colour: Rgb) {
        let Rect { x, y, width, height } = area;
        let _ = writeln!(
            self.elements,
            "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" fill=\"{}\"/>",
            hex(colour)
        );
    }

    /// A rectangle with the pattern of cells that were never observed.
    pub fn hatched(&mut self, area: Rect) {
        let Rect { x, y, width, height } = area;
        let _ = writeln!(
            self.elements,
            "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" fill=\"#eaeaea\"/>\
             <rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" fill=\"url(#never)\"/>"
        );
    }

    pub fn disc(&mut self, x: f32, y: f32, radius: f32, colour: Rgb) {
        let colour = hex(colour);
        let _ = writeln!(
            self.elements,
            "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius:.2}\" fill=\"{colour}\"/>"
        );
    }

    /// A circle line, `width` pixels wide.
    pub fn ring(&mut self, x: f32, y: f32, radius: f32, width: f32, colour: Rgb) {
        let colour = hex(colour);
        let _ = writeln!(
            self.elements,
            "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius:.2}\" fill=\"none\" stroke=\"{colour}\" \
             stroke-width=\"{width:.2}\"/>"
        );
    }

    /// A polygon grown by `by` pixels.
    pub fn polygon(&mut self, corners: &[[f32; 2]], by: f32, colour: Rgb) {
        let points: Vec<String> = corners.iter().map(|[x, y]| format!("{x:.2},{y:.2}")).collect();
        let (colour, points) = (hex(colour), points.join(" "));
        let _ = writeln!(
            self.elements,
            "<polygon points=\"{points}\" fill=\"{colour}\" stroke=\"{colour}\" \
             stroke-width=\"{:.2}\"/>",
            2.0 * by
        );
    }

    /// A PNG file in a rectangle.
    pub fn image(&mut self, area: Rect, png: &[u8]) {
        let Rect { x, y, width, height } = area;
        let _ = writeln!(
            self.elements,
            "<image x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" \
             style=\"image-rendering:pixelated\" href=\"data:image/png;base64,{}\"/>",
            STANDARD.encode(png)
        );
    }

    pub fn text(&mut self, words: &Words<'_>) {
        if words.text.trim().is_empty() {
            return;
        }
        let [x, y] = words.at;
        let turn = words.turned_at.map(|[x, y]| format!(" transform=\"rotate(-90 {x} {y})\""));
        let halo = match words.halo {
            0 => String::new(),
            px => format!(
                " stroke=\"#ffffff\" stroke-width=\"{}\" stroke-linejoin=\"round\" \
                 paint-order=\"stroke\"",
                2 * px
            ),
        };
        // The width keeps the layout where the typeface is another one.
        let _ = writeln!(
            self.elements,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{}\" text-anchor=\"{}\" fill=\"{}\" \
             textLength=\"{:.1}\" lengthAdjust=\"spacingAndGlyphs\"{halo}{}>{}</text>",
            words.size,
            words.anchor,
            hex(words.colour),
            words.width,
            turn.unwrap_or_default(),
            escaped(words.text)
        );
    }

    /// The whole file.
    pub fn file(&self, width: i32, height: i32) -> Vec<u8> {
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
             <svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" font-family=\"'DejaVu Sans', Verdana, sans-serif\">\n\
             <defs><pattern id=\"never\" width=\"8\" height=\"8\" patternUnits=\"userSpaceOnUse\">\
             <path d=\"M-2,2 l4,-4 M0,8 l8,-8 M6,10 l4,-4\" stroke=\"#cecece\"/></pattern></defs>\n\
             <rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n{}</svg>\n",
            self.elements
        )
        .into_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_cannot_break_out_of_its_text() {
        let mut vector = Vector::default();
        let text = "</text><script>\"&";
        let at = [1.0, 2.0];
        let (size, width, colour, anchor) = (12.0, 10.0, [0; 3], "start");
        vector.text(&Words { text, at, size, width, colour, anchor, halo: 0, turned_at: None });
        let file = String::from_utf8_lossy(&vector.file(10, 10)).into_owned();
        assert!(file.contains("&lt;/text&gt;&lt;script&gt;&quot;&amp;</text>"), "{file}");
    }
}
