//! Lasers and events on a map, with labels that keep clear of each other.

use crate::canvas::{Canvas, INK, Rect, WHITE};
use crate::input::{EventMark, LaserMark};
use crate::palette::{EVENT, LASER};
use crate::text::{Anchor, Face, Style};
use crate::view::View;

/// em of labels on the map, pixels.
const LABEL_PX: f32 = 13.0;
/// Widest label on the map, pixels.
const LABEL_MAX_PX: i32 = 160;
/// Most marks of a kind that are drawn: more would cover the map.
const MARKS_MAX: usize = 64;

/// Names of the lasers that are not in the view.
pub(crate) fn lasers_outside(view: &View, lasers: &[LaserMark]) -> Vec<String> {
    lasers.iter().filter(|l| place(view, l).is_none()).map(|l| l.id.clone()).collect()
}

/// Numbers, from 1, of the events that are not in the view.
pub(crate) fn events_outside(view: &View, events: &[EventMark]) -> Vec<String> {
    let outside = events.iter().enumerate().filter(|(_, e)| view.px(e.x_m, e.y_m).is_none());
    outside.map(|(i, _)| (i + 1).to_string()).collect()
}

fn place(view: &View, laser: &LaserMark) -> Option<[f32; 2]> {
    view.px(laser.x_m, laser.y_m).filter(|_| laser.yaw_rad.is_finite())
}

/// Draws lasers as small arrows in their heading.
pub(crate) fn draw_small_lasers(canvas: &mut Canvas, view: &View, lasers: &[LaserMark]) {
    for laser in lasers.iter().take(MARKS_MAX) {
        if let Some(at) = place(view, laser) {
            arrow(canvas, at, laser.yaw_rad, 0.6);
        }
    }
}

/// Draws lasers as arrows in their heading with their names, and events as discs with their
/// numbers, 1 for the first, which lies on top.
pub(crate) fn draw_marks(
    canvas: &mut Canvas,
    face: &Face,
    view: &View,
    lasers: &[LaserMark],
    events: &[EventMark],
) {
    let lasers = lasers.iter().take(MARKS_MAX);
    let lasers: Vec<(&LaserMark, [f32; 2])> =
        lasers.filter_map(|l| place(view, l).map(|at| (l, at))).collect();
    let mut taken: Vec<Rect> = lasers.iter().map(|(_, at)| around(*at, 13)).collect();
    for (laser, at) in &lasers {
        arrow(canvas, *at, laser.yaw_rad, 1.0);
    }
    for (i, event) in events.iter().enumerate().take(MARKS_MAX).rev() {
        if let Some(at) = view.px(event.x_m, event.y_m) {
            disc(canvas, face, i + 1, at[0] as i32, at[1] as i32);
            taken.push(around(at, 12));
        }
    }
    for (laser, at) in &lasers {
        label(canvas, face, view, &laser.id, *at, &mut taken);
    }
}

fn around(at: [f32; 2], radius: i32) -> Rect {
    Rect::new(at[0] as i32 - radius, at[1] as i32 - radius, 2 * radius, 2 * radius)
}

/// An arrow head that points to `yaw_rad` (y up), its turning point at `at`.
fn arrow(canvas: &mut Canvas, at: [f32; 2], yaw_rad: f64, size: f32) {
    let (sin, cos) = (yaw_rad.sin() as f32, yaw_rad.cos() as f32);
    let corner = |ahead: f32, left: f32| {
        let (ahead, left) = (ahead * size, left * size);
        [at[0] + ahead * cos - left * sin, at[1] - ahead * sin - left * cos]
    };
    let corners = [corner(15.0, 0.0), corner(-7.0, 8.0), corner(-7.0, -8.0)];
    canvas.polygon(&corners, 1.8, WHITE);
    canvas.polygon(&corners, 0.0, LASER);
}

/// Writes a label beside a mark where it covers least, and remembers its place.
fn label(
    canvas: &mut Canvas,
    face: &Face,
    view: &View,
    text: &str,
    at: [f32; 2],
    taken: &mut Vec<Rect>,
) {
    let text = face.cut(text, LABEL_PX, LABEL_MAX_PX);
    let (width, height) = (face.width(&text, LABEL_PX), LABEL_PX as i32 + 4);
    let (x, y) = (at[0] as i32, at[1] as i32);
    let plot = view.area();
    let right_of = |dy: i32| Rect::new(x + 18, y + dy - height / 2, width, height);
    let left_of = |dy: i32| Rect::new(x - 18 - width, y + dy - height / 2, width, height);
    let over = |dy: i32| Rect::new(x - width / 2, y + dy - height / 2, width, height);
    let places = [
        right_of(0),
        left_of(0),
        over(-22),
        over(22),
        right_of(-18),
        right_of(18),
        left_of(-18),
        left_of(18),
        over(-40),
        over(40),
    ];
    let cost = |place: &Rect| {
        let covered: i64 = taken.iter().map(|t| t.shared_px(place)).sum();
        let cut = i64::from(place.width) * i64::from(place.height) - plot.shared_px(place);
        covered + 4 * cut
    };
    // min_by_key takes the first of equals: the order of the places is the order of preference.
    if let Some(place) = places.into_iter().min_by_key(cost) {
        let style = Style::new(LABEL_PX, INK, Anchor::Left).with_halo();
        face.draw(canvas, &text, place.x, place.y + height / 2, style);
        taken.push(place.grown(1));
    }
}

/// The numbered disc of an event.
pub(crate) fn disc(canvas: &mut Canvas, face: &Face, number: usize, x: i32, y: i32) {
    canvas.disc(x as f32, y as f32, 11.0, WHITE);
    canvas.disc(x as f32, y as f32, 9.5, EVENT);
    let size = if number < 10 { 13.0 } else { 11.0 };
    face.draw(canvas, &number.to_string(), x, y, Style::new(size, WHITE, Anchor::Centre));
}

/// The arrow of the legend.
pub(crate) fn legend_arrow(canvas: &mut Canvas, x: i32, y: i32) {
    arrow(canvas, [x as f32, y as f32], 0.0, 0.7);
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use protocol::geometry::GridGeometry;

    #[test]
    fn an_arrow_points_to_its_heading_with_y_up() {
        let ink = |yaw_rad: f64, x: i32, y: i32| {
            let mut canvas = Canvas::new(60, 60);
            arrow(&mut canvas, [30.0, 30.0], yaw_rad, 1.0);
            canvas.pixel(x, y).unwrap() == LASER
        };
        assert!(ink(0.0, 42, 30) && !ink(0.0, 18, 30));
        let up = std::f64::consts::FRAC_PI_2;
        assert!(ink(up, 30, 18) && !ink(up, 30, 42));
    }

    #[test]
    fn marks_outside_the_view_are_named() {
        let grid = GridGeometry { origin_m: [0.0; 2], cell_m: 0.1, columns: 30, rows: 30 };
        let view = View::new(&grid, None, &[], [1, 1], [300, 300]);
        let laser = |id: &str, x_m, yaw_rad| LaserMark { id: id.into(), x_m, y_m: 1.0, yaw_rad };
        let lasers = [
            laser("near", 1.0, 0.0),
            laser("far", 99.0, 0.0),
            laser("lost", f64::NAN, 0.0),
            laser("turned", 1.0, f64::INFINITY),
        ];
        assert_eq!(lasers_outside(&view, &lasers), ["far", "lost", "turned"]);
        let event = |x_m| EventMark { x_m, y_m: 1.0, label: String::new() };
        assert_eq!(events_outside(&view, &[event(1.0), event(-5.0)]), ["2"]);
    }

    #[test]
    fn a_label_goes_where_nothing_is() {
        let grid = GridGeometry { origin_m: [0.0; 2], cell_m: 0.1, columns: 30, rows: 30 };
        let view = View::new(&grid, None, &[], [1, 1], [300, 300]);
        let (mut canvas, face) = (Canvas::new(300, 300), Face::load().unwrap());
        let mut taken = vec![Rect::new(150, 120, 150, 60), Rect::new(139, 139, 22, 22)];
        label(&mut canvas, &face, &view, "north", [150.0, 150.0], &mut taken);
        assert!(taken[2].right() < 139 && taken[2].shared_px(&taken[0]) == 0, "{:?}", taken[2]);
    }
}
