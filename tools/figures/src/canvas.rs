//! A picture in memory: rectangles, smooth shapes; as pixels (PNG) or as what was drawn (SVG).

use crate::FigureError;
use crate::input::FileFormat;
use crate::palette;
use crate::vector::Vector;

/// Red, green, blue, 0..=255, sRGB.
pub(crate) type Rgb = [u8; 3];

/// Background of every picture.
pub(crate) const WHITE: Rgb = [255, 255, 255];
/// Text, axes.
pub(crate) const INK: Rgb = [32, 32, 36];
/// Text of less weight.
pub(crate) const FAINT: Rgb = [92, 92, 100];

/// A rectangle of pixels; y grows downwards, as in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Rect {
    pub x: i32,
    pub y: i32,
    pub width: i32,
    pub height: i32,
}

impl Rect {
    pub fn new(x: i32, y: i32, width: i32, height: i32) -> Self {
        Self { x, y, width, height }
    }

    pub fn right(&self) -> i32 {
        self.x + self.width
    }

    pub fn bottom(&self) -> i32 {
        self.y + self.height
    }

    /// The same rectangle with `by` more pixels on each side.
    pub fn grown(&self, by: i32) -> Self {
        Self::new(self.x - by, self.y - by, self.width + 2 * by, self.height + 2 * by)
    }

    /// Number of pixels in both rectangles.
    pub fn shared_px(&self, other: &Self) -> i64 {
        let width = self.right().min(other.right()) - self.x.max(other.x);
        let height = self.bottom().min(other.bottom()) - self.y.max(other.y);
        i64::from(width.max(0)) * i64::from(height.max(0))
    }
}

/// 8-bit RGB pixels, row 0 on top, or shapes. Whatever is drawn outside is cut off.
pub(crate) struct Canvas {
    width: i32,
    height: i32,
    /// Empty if the picture is one of shapes.
    rgb: Vec<u8>,
    vector: Option<Vector>,
}

impl Canvas {
    /// A white canvas; sizes below 1 count as 1.
    pub fn new(width: i32, height: i32) -> Self {
        let (width, height) = (width.max(1), height.max(1));
        let rgb = vec![255; width as usize * height as usize * 3];
        Self { width, height, rgb, vector: None }
    }

    /// A white canvas for a file of this format.
    pub fn of(format: FileFormat, width: i32, height: i32) -> Self {
        match format {
            FileFormat::Png => Self::new(width, height),
            FileFormat::Svg => {
                let (width, height) = (width.max(1), height.max(1));
                Self { width, height, rgb: Vec::new(), vector: Some(Vector::default()) }
            }
        }
    }

    /// Where shapes go, if the picture is one of shapes.
    pub fn vector(&mut self) -> Option<&mut Vector> {
        self.vector.as_mut()
    }

    fn offset(&self, x: i32, y: i32) -> Option<usize> {
        let pixels = self.vector.is_none();
        let inside = pixels && x >= 0 && y >= 0 && x < self.width && y < self.height;
        inside.then(|| (y as usize * self.width as usize + x as usize) * 3)
    }

    #[cfg(test)]
    pub fn pixel(&self, x: i32, y: i32) -> Option<Rgb> {
        self.offset(x, y).map(|at| [self.rgb[at], self.rgb[at + 1], self.rgb[at + 2]])
    }

    /// Lays a colour over a pixel; `alpha` 0..=1, 1 covers it.
    pub fn blend(&mut self, x: i32, y: i32, colour: Rgb, alpha: f32) {
        if let Some(at) = self.offset(x, y) {
            let alpha = alpha.clamp(0.0, 1.0);
            for (old, new) in self.rgb[at..at + 3].iter_mut().zip(colour) {
                let mixed = f32::from(*old) + (f32::from(new) - f32::from(*old)) * alpha;
                *old = mixed.round() as u8;
            }
        }
    }

    /// Fills a rectangle.
    pub fn fill(&mut self, area: Rect, colour: Rgb) {
        if let Some(vector) = &mut self.vector {
            vector.rect(area, colour);
            return;
        }
        let (left, right) = (area.x.max(0), area.right().min(self.width));
        for y in area.y.max(0)..area.bottom().min(self.height) {
            if let Some(at) = self.offset(left, y).filter(|_| left < right) {
                for pixel in self.rgb[at..at + (right - left) as usize * 3].chunks_exact_mut(3) {
                    pixel.copy_from_slice(&colour);
                }
            }
        }
    }

    /// Fills a rectangle with the hatched grey of cells that were never observed.
    pub fn fill_hatched(&mut self, area: Rect) {
        if let Some(vector) = &mut self.vector {
            vector.hatched(area);
            return;
        }
        for y in area.y..area.bottom() {
            for x in area.x..area.right() {
                self.blend(x, y, palette::hatch(x, y), 1.0);
            }
        }
    }

    /// Draws pixels in a rectangle: `paint` gets a canvas of its size whose origin is its corner.
    pub fn pixels(&mut self, area: Rect, paint: impl FnOnce(&mut Self, Rect)) {
        let Some(vector) = &mut self.vector else { return paint(self, area) };
        let mut image = Self::new(area.width, area.height);
        paint(&mut image, Rect::new(0, 0, area.width, area.height));
        // Pixels in memory always encode; were they not to, the map would be missing, not wrong.
        if let Ok(png) = image.file() {
            vector.image(area, &png);
        }
    }

    /// A frame of one pixel just inside the rectangle.
    pub fn outline(&mut self, area: Rect, colour: Rgb) {
        self.fill(Rect::new(area.x, area.y, area.width, 1), colour);
        self.fill(Rect::new(area.x, area.bottom() - 1, area.width, 1), colour);
        self.fill(Rect::new(area.x, area.y, 1, area.height), colour);
        self.fill(Rect::new(area.right() - 1, area.y, 1, area.height), colour);
    }

    /// A disc round (x, y), edges smoothed.
    pub fn disc(&mut self, x: f32, y: f32, radius: f32, colour: Rgb) {
        if let Some(vector) = &mut self.vector {
            vector.disc(x, y, radius, colour);
            return;
        }
        let reach = radius.ceil() as i32 + 1;
        for py in y.round() as i32 - reach..=y.round() as i32 + reach {
            for px in x.round() as i32 - reach..=x.round() as i32 + reach {
                let distance = (px as f32 - x).hypot(py as f32 - y);
                self.blend(px, py, colour, radius + 0.5 - distance);
            }
        }
    }

    /// A circle line round (x, y), `width` pixels wide, edges smoothed.
    pub fn ring(&mut self, x: f32, y: f32, radius: f32, width: f32, colour: Rgb) {
        if let Some(vector) = &mut self.vector {
            vector.ring(x, y, radius, width, colour);
            return;
        }
        let reach = (radius + width).ceil().clamp(1.0, 8192.0) as i32 + 1;
        for py in y.round() as i32 - reach..=y.round() as i32 + reach {
            for px in x.round() as i32 - reach..=x.round() as i32 + reach {
                let off = ((px as f32 - x).hypot(py as f32 - y) - radius).abs();
                self.blend(px, py, colour, width / 2.0 + 0.5 - off);
            }
        }
    }

    /// A convex polygon, corners in either sense, grown by `by` pixels, edges smoothed.
    pub fn polygon(&mut self, corners: &[[f32; 2]], by: f32, colour: Rgb) {
        if let Some(vector) = &mut self.vector {
            vector.polygon(corners, by, colour);
            return;
        }
        let bound = |axis: usize, pick: fn(f32, f32) -> f32| {
            corners.iter().map(|c| c[axis]).reduce(pick).unwrap_or(0.0)
        };
        let pad = by.ceil() as i32 + 1;
        let (x0, x1) = (bound(0, f32::min).floor() as i32, bound(0, f32::max).ceil() as i32);
        let (y0, y1) = (bound(1, f32::min).floor() as i32, bound(1, f32::max).ceil() as i32);
        let edges: Vec<([f32; 2], [f32; 2])> =
            (0..corners.len()).map(|i| (corners[i], corners[(i + 1) % corners.len()])).collect();
        let area: f32 = edges.iter().map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum();
        for py in y0 - pad..=y1 + pad {
            for px in x0 - pad..=x1 + pad {
                let inside = edges.iter().map(|(a, b)| {
                    let (ex, ey) = (b[0] - a[0], b[1] - a[1]);
                    let cross = ex * (py as f32 - a[1]) - ey * (px as f32 - a[0]);
                    cross * area.signum() / ex.hypot(ey).max(1e-6)
                });
                let depth = inside.fold(f32::INFINITY, f32::min);
                self.blend(px, py, colour, depth + by + 0.5);
            }
        }
    }

    /// The picture as a file: PNG of 8-bit RGB, or SVG. The same drawing gives the same bytes.
    pub fn file(&self) -> Result<Vec<u8>, FigureError> {
        if let Some(vector) = &self.vector {
            return Ok(vector.file(self.width, self.height));
        }
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.rgb)?;
        writer.finish()?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn shapes_beyond_the_edge_are_cut_off_and_do_not_panic() {
        let mut canvas = Canvas::new(4, 3);
        canvas.fill(Rect::new(-5, -5, 7, 6), INK);
        canvas.fill(Rect::new(9, 9, 7, 6), INK);
        canvas.disc(-100.0, 50.0, 8.0, INK);
        canvas.polygon(&[[-3.0, -3.0], [40.0, -3.0], [2.0, 50.0]], 2.0, FAINT);
        assert_eq!(canvas.pixel(4, 0), None);
        let mut canvas = Canvas::new(4, 3);
        canvas.fill(Rect::new(-5, -5, 7, 6), INK);
        let row = |y| (0..4).map(|x| canvas.pixel(x, y).unwrap() == INK).collect::<Vec<_>>();
        assert_eq!([row(0), row(1)], [vec![true, true, false, false], vec![false; 4]]);
    }

    #[test]
    fn a_polygon_fills_its_inside_in_either_sense_of_its_corners() {
        for corners in
            [[[2.0, 2.0], [18.0, 2.0], [2.0, 18.0]], [[2.0, 2.0], [2.0, 18.0], [18.0, 2.0]]]
        {
            let mut canvas = Canvas::new(20, 20);
            canvas.polygon(&corners, 0.0, INK);
            assert_eq!(canvas.pixel(5, 5), Some(INK));
            assert_eq!(canvas.pixel(15, 15), Some(WHITE));
        }
    }
}
