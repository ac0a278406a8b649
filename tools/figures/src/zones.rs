//! Named places on a map: outlines and names.

use crate::canvas::{Canvas, Rect};
use crate::input::ZoneMark;
use crate::palette::ZONE;
use crate::text::{Anchor, Face, Style};
use crate::view::View;

/// Most zones that are drawn, and most corners of one: as in a site file.
const ZONES_MAX: usize = 256;
const CORNERS_MAX: usize = 64;
/// Width of an outline, em of a name, widest name, pixels.
const LINE_PX: f64 = 2.0;
const NAME_PX: f32 = 13.0;
const NAME_MAX_PX: i32 = 160;

/// Draws the outline of each zone, as far as it is in the view, and its name inside the upper left
/// corner of what is.
pub(crate) fn draw_zones(canvas: &mut Canvas, face: &Face, view: &View, zones: &[ZoneMark]) {
    for zone in zones.iter().take(ZONES_MAX) {
        let corners = &zone.polygon_m[..zone.polygon_m.len().min(CORNERS_MAX)];
        let corners: Vec<[f64; 2]> =
            corners.iter().map(|[x_m, y_m]| [view.x_px(*x_m), view.y_px(*y_m)]).collect();
        let area = view.area();
        let next = corners.iter().cycle().skip(1);
        let edges: Vec<[[f64; 2]; 2]> =
            corners.iter().zip(next).filter_map(|(a, b)| clipped(*a, *b, &area)).collect();
        for [a, b] in &edges {
            line(canvas, *a, *b);
        }
        let ends = || edges.iter().flatten();
        let (left, top) = (
            ends().map(|end| end[0]).fold(f64::INFINITY, f64::min),
            ends().map(|end| end[1]).fold(f64::INFINITY, f64::min),
        );
        if edges.is_empty() {
            continue;
        }
        let name = face.cut(&zone.name, NAME_PX, NAME_MAX_PX.min(area.width - 8));
        let x = (left as i32 + 6).min(area.right() - 4 - face.width(&name, NAME_PX));
        let y = (top as i32 + 12).min(area.bottom() - 10);
        let style = Style::new(NAME_PX, ZONE, Anchor::Left).with_halo();
        face.draw(canvas, &name, x.max(area.x + 4), y, style);
    }
}

/// The part of the segment from `a` to `b` that is in `area`, if any. (Liang and Barsky, 1984)
fn clipped(a: [f64; 2], b: [f64; 2], area: &Rect) -> Option<[[f64; 2]; 2]> {
    let low = [f64::from(area.x), f64::from(area.y)];
    let high = [f64::from(area.right()), f64::from(area.bottom())];
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for axis in 0..2 {
        let step = b[axis] - a[axis];
        if !step.is_finite() {
            return None;
        }
        if step == 0.0 {
            if !(low[axis]..=high[axis]).contains(&a[axis]) {
                return None;
            }
            continue;
        }
        let ends = [(low[axis] - a[axis]) / step, (high[axis] - a[axis]) / step];
        from = from.max(ends[0].min(ends[1]));
        to = to.min(ends[0].max(ends[1]));
    }
    let at = |t: f64| [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])];
    (from <= to).then(|| [at(from), at(to)])
}

fn line(canvas: &mut Canvas, a: [f64; 2], b: [f64; 2]) {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let length = dx.hypot(dy);
    if length < 0.5 {
        return;
    }
    // Half the width to both sides, and as much beyond the ends, so that corners are closed.
    let half = LINE_PX / 2.0;
    let (along, across) =
        ([dx / length * half, dy / length * half], [-dy / length * half, dx / length * half]);
    let corner = |end: [f64; 2], ahead: f64, side: f64| {
        [0, 1].map(|i| (end[i] + ahead * along[i] + side * across[i]) as f32)
    };
    let corners =
        [corner(a, -1.0, -1.0), corner(b, 1.0, -1.0), corner(b, 1.0, 1.0), corner(a, -1.0, 1.0)];
    canvas.polygon(&corners, 0.0, ZONE);
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use protocol::geometry::GridGeometry;

    #[test]
    fn an_outline_is_drawn_up_to_the_edge_of_the_map() {
        let grid = GridGeometry { origin_m: [0.0; 2], cell_m: 0.1, columns: 30, rows: 30 };
        let view = View::new(&grid, None, &[], [1, 1], [300, 300]).placed(40, 40);
        let (mut canvas, face) = (Canvas::new(400, 400), Face::load().unwrap());
        // From (1, 1) m to far beyond the right edge, 2 m high.
        let polygon_m = vec![[1.0, 1.0], [1e6, 1.0], [1e6, 3.0], [1.0, 3.0]];
        let nowhere = vec![[f64::NAN, 0.0], [f64::INFINITY, 1.0], [9.0, 9.0]];
        let zone = |polygon_m| ZoneMark { name: "door".into(), polygon_m };
        draw_zones(&mut canvas, &face, &view, &[zone(polygon_m), zone(nowhere), zone(vec![])]);
        let ink = |x: i32, y: i32| canvas.pixel(x, y).unwrap() == ZONE;
        let area = view.area();
        let y = view.y_px(1.0) as i32;
        assert!(ink(view.x_px(1.0) as i32, view.y_px(2.0) as i32), "left edge");
        assert!(ink(area.right() - 20, y), "lower edge");
        assert!(!ink(area.x + 20, y), "left of it");
        assert!((area.right() + 3..400).all(|x| (0..400).all(|y| !ink(x, y))), "outside");
    }
}
