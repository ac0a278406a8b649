//! The window of a grid that a picture shows, and the way from metres to pixels.

use crate::canvas::{Canvas, Rect, Rgb};
use protocol::geometry::GridGeometry;

/// A cell is at most this wide: larger squares show nothing more.
const CELL_MAX_PX: i32 = 48;
/// Cells of margin round what was observed, at least.
const MARGIN_CELLS: i64 = 2;

/// What a block of cells looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Paint {
    /// No cell of it was ever observed.
    Never,
    /// Its colour.
    Colour(Rgb),
}

/// A window of cells, which may reach beyond the grid, as squares of whole pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct View {
    grid: GridGeometry,
    /// First column and row; may be negative.
    first: [i64; 2],
    /// Columns and rows.
    cells: [i64; 2],
    /// Edge of a cell, pixels; 1 if reduced.
    cell_px: i32,
    /// Cells along the edge of a pixel; 1 if enlarged.
    reduction: i64,
    /// Left and top pixel on the canvas.
    at: [i32; 2],
}

/// The part of a grid that is to be shown: found once, fitted into pictures of any size.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Window {
    grid: GridGeometry,
    /// First and last column, first and last row.
    span: [[i64; 2]; 2],
}

impl Window {
    /// The cells for which `observed` holds and the points `keep_m` near the grid, or the whole
    /// grid, if nothing was observed or `observed` is `None`.
    pub fn new(
        grid: &GridGeometry,
        observed: Option<&dyn Fn(usize) -> bool>,
        keep_m: &[[f64; 2]],
    ) -> Self {
        let whole = [[0, i64::from(grid.columns) - 1], [0, i64::from(grid.rows) - 1]];
        let mut span = observed.and_then(|o| observed_span(grid, o)).unwrap_or(whole);
        for (axis, side) in span.iter_mut().enumerate() {
            let margin = MARGIN_CELLS.max((side[1] - side[0]) / 40);
            *side = [side[0] - margin, side[1] + margin];
            *side = [side[0].max(whole[axis][0]), side[1].min(whole[axis][1])];
        }
        keep_points(grid, keep_m, &mut span);
        Self { grid: *grid, span }
    }

    /// It in at most `max_px` and, by showing more cells, or space outside the grid, at least
    /// `min_px`.
    pub fn view(&self, min_px: [i32; 2], max_px: [i32; 2]) -> View {
        let Self { grid, span } = *self;
        let cells = span.map(|s| s[1] - s[0] + 1);
        let fits = |axis: usize| i64::from(max_px[axis]) / cells[axis];
        let cell_px = fits(0).min(fits(1)).clamp(1, i64::from(CELL_MAX_PX)) as i32;
        let needs = |axis: usize| (cells[axis] as u64).div_ceil(max_px[axis].max(1) as u64) as i64;
        let reduction = needs(0).max(needs(1)).max(1);
        let first = span.map(|s| s[0]);
        let mut view = View { grid, first, cells, cell_px, reduction, at: [0; 2] };
        for (axis, min_px) in min_px.into_iter().enumerate() {
            view.widen(axis, min_px);
        }
        view
    }
}

impl View {
    /// [`Window::new`] and [`Window::view`] in one.
    pub fn new(
        grid: &GridGeometry,
        observed: Option<&dyn Fn(usize) -> bool>,
        keep_m: &[[f64; 2]],
        min_px: [i32; 2],
        max_px: [i32; 2],
    ) -> Self {
        Window::new(grid, observed, keep_m).view(min_px, max_px)
    }

    /// Adds cells on both sides until the window is `min_px` long; where one side of the grid ends,
    /// on the other, so that no space outside it is shown while there is more of it.
    fn widen(&mut self, axis: usize, min_px: i32) {
        let wanted = (i64::from(min_px) * self.reduction).div_euclid(i64::from(self.cell_px)) + 1;
        let missing = (wanted - self.cells[axis]).max(0);
        if self.size_px()[axis] < min_px {
            let side = i64::from([self.grid.columns, self.grid.rows][axis]);
            let last = self.first[axis] + self.cells[axis] - 1;
            let (before, after) = (self.first[axis].max(0), (side - 1 - last).max(0));
            let outside = missing - before - after;
            let left = match outside > 0 {
                true => before + outside / 2,
                false => (missing / 2).clamp((missing - after).max(0), before.min(missing)),
            };
            self.first[axis] -= left;
            self.cells[axis] += missing;
        }
    }

    /// The same view with its upper left pixel at (x, y).
    pub fn placed(self, x: i32, y: i32) -> Self {
        Self { at: [x, y], ..self }
    }

    /// Width and height, pixels.
    pub fn size_px(&self) -> [i32; 2] {
        self.cells.map(|c| ((c + self.reduction - 1) / self.reduction) as i32 * self.cell_px)
    }

    /// Where it is on the canvas.
    pub fn area(&self) -> Rect {
        let [width, height] = self.size_px();
        Rect::new(self.at[0], self.at[1], width, height)
    }

    /// Cells along the edge of a pixel; 1 unless the grid was too large.
    pub fn reduction(&self) -> i64 {
        self.reduction
    }

    /// Pixels per metre.
    pub fn px_per_m(&self) -> f64 {
        f64::from(self.cell_px) / (self.reduction as f64 * self.grid.cell_m)
    }

    /// Lowest and highest site coordinate shown along x (axis 0) or y (axis 1), metres.
    pub fn span_m(&self, axis: usize) -> [f64; 2] {
        let low = self.grid.origin_m[axis] + self.first[axis] as f64 * self.grid.cell_m;
        [low, low + f64::from(self.size_px()[axis]) / self.px_per_m()]
    }

    /// Pixel coordinates of a site point: x to the right, y down; `None` outside the view.
    pub fn px(&self, x_m: f64, y_m: f64) -> Option<[f32; 2]> {
        let (x, y) = (self.x_px(x_m), self.y_px(y_m));
        let area = self.area();
        let inside = x >= f64::from(area.x)
            && x <= f64::from(area.right())
            && y >= f64::from(area.y)
            && y <= f64::from(area.bottom());
        inside.then_some([x as f32, y as f32])
    }

    /// Pixel column of a site x.
    pub fn x_px(&self, x_m: f64) -> f64 {
        f64::from(self.at[0]) + (x_m - self.span_m(0)[0]) * self.px_per_m()
    }

    /// Pixel row of a site y: y is up.
    pub fn y_px(&self, y_m: f64) -> f64 {
        f64::from(self.area().bottom()) - (y_m - self.span_m(1)[0]) * self.px_per_m()
    }

    /// Paints the cells; `paint` gets the indices of all cells of a square, row by row.
    pub fn paint_cells(&self, canvas: &mut Canvas, paint: impl Fn(&[usize]) -> Paint) {
        canvas.pixels(self.area(), |canvas, area| self.paint_into(canvas, area, paint));
    }

    fn paint_into(&self, canvas: &mut Canvas, area: Rect, paint: impl Fn(&[usize]) -> Paint) {
        let mut indices = Vec::new();
        for down in 0..area.height / self.cell_px {
            let up = i64::from(area.height / self.cell_px - 1 - down);
            for right in 0..area.width / self.cell_px {
                self.block(i64::from(right), up, &mut indices);
                let square = Rect::new(
                    area.x + right * self.cell_px,
                    area.y + down * self.cell_px,
                    self.cell_px,
                    self.cell_px,
                );
                // What lies outside the grid was never observed either.
                if indices.is_empty() {
                    canvas.fill_hatched(square);
                    continue;
                }
                match paint(&indices) {
                    Paint::Colour(colour) => canvas.fill(square, colour),
                    Paint::Never => canvas.fill_hatched(square),
                }
            }
        }
    }

    /// Indices of the cells of the grid in block (right, up) of the window.
    fn block(&self, right: i64, up: i64, indices: &mut Vec<usize>) {
        indices.clear();
        let range = |axis: usize, block: i64, side: u32| {
            let low = self.first[axis] + block * self.reduction;
            low.max(0)..(low + self.reduction).min(i64::from(side))
        };
        for row in range(1, up, self.grid.rows) {
            for column in range(0, right, self.grid.columns) {
                indices.push(self.grid.index(column as u32, row as u32));
            }
        }
    }
}

/// First and last column and row with an observed cell.
fn observed_span(grid: &GridGeometry, observed: &dyn Fn(usize) -> bool) -> Option<[[i64; 2]; 2]> {
    let mut span: Option<[[i64; 2]; 2]> = None;
    for index in (0..grid.cells()).filter(|i| observed(*i)) {
        let columns = grid.columns as usize;
        let at = [(index % columns) as i64, (index / columns) as i64];
        let old = span.unwrap_or([[at[0]; 2], [at[1]; 2]]);
        span = Some([0, 1].map(|a| [old[a][0].min(at[a]), old[a][1].max(at[a])]));
    }
    span
}

/// Widens the span to points that lie in the grid or beyond it by at most a tenth of its side.
fn keep_points(grid: &GridGeometry, points_m: &[[f64; 2]], span: &mut [[i64; 2]; 2]) {
    let sides = [grid.columns, grid.rows].map(i64::from);
    for point in points_m.iter().filter(|p| p.iter().all(|v| v.is_finite())) {
        let cell: [f64; 2] = [0, 1].map(|a| ((point[a] - grid.origin_m[a]) / grid.cell_m).floor());
        let near = |a: usize| {
            let beyond = (sides[a] / 10).max(MARGIN_CELLS) as f64;
            cell[a] >= -beyond && cell[a] < sides[a] as f64 + beyond
        };
        if near(0) && near(1) {
            for (a, side) in span.iter_mut().enumerate() {
                let at = cell[a] as i64;
                *side = [side[0].min(at - MARGIN_CELLS), side[1].max(at + MARGIN_CELLS)];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    const GRID: GridGeometry =
        GridGeometry { origin_m: [10.0, -5.0], cell_m: 0.5, columns: 20, rows: 10 };

    #[test]
    fn y_is_up_and_a_cell_lies_where_its_centre_is() {
        let view = View::new(&GRID, None, &[], [1, 1], [200, 200]).placed(30, 40);
        assert_eq!(view.area(), Rect::new(30, 40, 200, 100));
        assert_eq!(view.px(10.0, -5.0), Some([30.0, 140.0]));
        assert_eq!(view.px(20.0, 0.0), Some([230.0, 40.0]));
        assert_eq!(view.px(20.1, 0.0), None);
        let mut canvas = Canvas::new(300, 300);
        let red = [255, 0, 0];
        let corner = GRID.index(19, 9);
        view.paint_cells(&mut canvas, |cells| {
            Paint::Colour(if cells == [corner] { red } else { [0; 3] })
        });
        let [x, y] = GRID.centre_m(19, 9);
        let [px, py] = view.px(x, y).unwrap();
        assert_eq!(canvas.pixel(px as i32, py as i32), Some(red));
        assert_eq!(canvas.pixel(229, 40), Some(red));
        assert_eq!(canvas.pixel(229, 139), Some([0; 3]));
        assert_eq!(canvas.pixel(30, 40), Some([0; 3]));
    }

    #[test]
    fn a_large_grid_is_reduced_and_no_cell_is_lost() {
        let grid = GridGeometry { columns: 401, rows: 33, ..GRID };
        let view = View::new(&grid, None, &[], [1, 1], [200, 200]);
        assert_eq!(view.reduction(), 3);
        let seen = std::cell::RefCell::new(vec![0; grid.cells()]);
        view.paint_cells(&mut Canvas::new(200, 200), |cells| {
            cells.iter().for_each(|c| seen.borrow_mut()[*c] += 1);
            Paint::Never
        });
        assert!(seen.borrow().iter().all(|n| *n == 1));
    }

    #[test]
    fn the_window_is_what_was_observed_with_its_lasers() {
        let observed = |i: usize| i == GRID.index(10, 4);
        let view = View::new(&GRID, Some(&observed), &[], [1, 1], [500, 500]);
        assert_eq!(view.span_m(0), [14.0, 16.5]);
        assert_eq!(view.span_m(1), [-4.0, -1.5]);
        let view = View::new(&GRID, Some(&observed), &[[11.2, -3.0]], [1, 1], [500, 500]);
        assert_eq!(view.span_m(0), [10.0, 16.5]);
        let far = View::new(&GRID, Some(&observed), &[[1e300, f64::NAN]], [1, 1], [500, 500]);
        assert_eq!(far.span_m(0), [14.0, 16.5]);
    }

    #[test]
    fn a_window_at_the_edge_of_the_grid_is_widened_into_it_not_out_of_it() {
        for (column, first_m, last_m) in [(0, 10.0, 15.0), (19, 15.0, 20.0), (10, 12.5, 17.5)] {
            let observed = |i: usize| i == GRID.index(column, 4);
            let view = View::new(&GRID, Some(&observed), &[], [480, 1], [480, 480]);
            let [low, high] = view.span_m(0);
            assert!((high - low) >= last_m - first_m - 0.01, "{low} {high}");
            assert!(low >= 10.0 && high <= 20.0, "column {column}: {low} to {high}");
        }
    }

    #[test]
    fn a_narrow_grid_is_shown_with_space_outside() {
        let grid = GridGeometry { columns: 4096, rows: 1, ..GRID };
        let view = View::new(&grid, None, &[], [240, 200], [1000, 800]);
        let [width, height] = view.size_px();
        assert!((240..=1000).contains(&width) && (200..=210).contains(&height), "{width} {height}");
    }
}
