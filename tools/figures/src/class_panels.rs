//! Where the panels of an overview go: beside the map and its legend, or below; as many in a row as
//! leave the least of the page empty.

use crate::canvas::{FAINT, INK, Rect};
use crate::input::{ClassShare, LaserMark, OverviewMap};
use crate::marks;
use crate::scale;
use crate::share;
use crate::sheet::{PAD, Sheet, TEXT_PX};
use crate::text::{Anchor, Face, Style};
use crate::view::{View, Window};

/// Widest page, unless the map alone is wider: what a screen shows at once, pixels.
const PAGE_MAX_PX: i32 = 1600;
/// Smallest, largest, and wanted side of a panel, pixels.
const SIDE_PX: [i32; 2] = [120, 420];
const SIDE_WANTED_PX: i32 = 260;
/// Room between panels, the name above each, and a line more for its largest share, pixels.
const GAP_PX: i32 = 16;
const NAME_PX: i32 = 28;
const NOTE_PX: i32 = 18;
/// Column of the colour bar beside the panels, pixels.
const BAR_PX: i32 = 110;
/// Between the legend and panels beside it, and between the map and panels below it, pixels.
const BESIDE_PX: i32 = 26;
const BELOW_PX: i32 = 10;
/// Names of panels beside the map begin this much higher than it: level with its first line.
const RAISED_PX: i32 = 6;

/// What the map and its legend take, pixels from the left edge of the page and the top of the map.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Room {
    /// Right end of the map.
    pub map_right: i32,
    /// Map and axis.
    pub map_height: i32,
    /// Right end of the legend.
    pub legend_right: i32,
    /// Its height.
    pub legend_height: i32,
}

impl Room {
    /// Right end of what is above panels that begin below the map: the legend may be longer.
    fn free_right(&self) -> i32 {
        if self.legend_height > self.map_height { self.map_right } else { PAGE_MAX_PX - PAD }
    }
}

/// The panels of the classes, all of one size.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ClassPanels {
    view: View,
    columns: i32,
    rows: i32,
    /// Above each panel.
    head_px: i32,
    /// Right of the legend; else below the map.
    beside: bool,
}

impl ClassPanels {
    /// The arrangement that leaves least empty; each panel shows `window`.
    pub fn arranged(map: &OverviewMap, face: &Face, room: &Room, window: &Window) -> Self {
        let count = map.classes.len().max(1) as i32;
        let heads_px = widest_head_px(map, face);
        let arranged = |beside: bool, columns: i32, height: i32| {
            let (left, right) = match beside {
                true => (room.legend_right + BESIDE_PX, PAGE_MAX_PX - PAD),
                false => (PAD, room.free_right()),
            };
            let width = (right - left - BAR_PX) / columns - GAP_PX;
            let max_px = [width, height].map(|side| side.clamp(SIDE_PX[0], SIDE_PX[1]));
            let view = window.view([SIDE_PX[0], 60], max_px);
            let note_px = if view.size_px()[0] < heads_px { NOTE_PX } else { 0 };
            let rows = (count + columns - 1) / columns;
            Self { view, columns, rows, head_px: NAME_PX + note_px, beside }
        };
        let mut best = arranged(false, 1, SIDE_PX[1]);
        for columns in 1..=count {
            let rows = (count + columns - 1) / columns;
            let fit = room.map_height.max(room.legend_height) / rows - NAME_PX - GAP_PX;
            for (beside, height) in [(true, fit), (true, SIDE_PX[1]), (false, SIDE_PX[1])] {
                let other = arranged(beside, columns, height);
                if other.score(room, count) > best.score(room, count) {
                    best = other;
                }
            }
        }
        best
    }

    /// Share of the page that is filled, less if the panels are small; a page that is too wide
    /// counts by how much it is.
    fn score(&self, room: &Room, count: i32) -> f64 {
        let area = |width: i32, height: i32| f64::from(width.max(0)) * f64::from(height.max(0));
        let [width, height] = self.view.size_px();
        let used = area(room.map_right, room.map_height)
            + area(room.legend_right - room.map_right, room.legend_height)
            + f64::from(count) * area(width + GAP_PX, height + GAP_PX + self.head_px);
        let (page, page_height) = (self.right_px(room) + PAD, self.height_px(room));
        let small = f64::from(width.max(height)) / f64::from(SIDE_WANTED_PX);
        let wide = f64::from(PAGE_MAX_PX.max(room.legend_right + PAD)) / f64::from(page.max(1));
        used / area(page, page_height).max(1.0) * small.min(1.0) * wide.min(1.0).powi(8)
    }

    fn pitch_px(&self) -> [i32; 2] {
        let [width, height] = self.view.size_px();
        [width + GAP_PX, height + self.head_px + GAP_PX]
    }

    /// Height of all rows, at least that of a readable colour bar.
    fn rows_px(&self) -> i32 {
        (self.rows * self.pitch_px()[1]).max(150 + self.head_px)
    }

    /// Right end of everything on the page.
    pub fn right_px(&self, room: &Room) -> i32 {
        let width = self.columns * self.pitch_px()[0] + BAR_PX;
        let left = if self.beside { room.legend_right + BESIDE_PX } else { PAD };
        room.legend_right.max(left + width)
    }

    /// Height from the top of the map to the lower end of everything.
    pub fn height_px(&self, room: &Room) -> i32 {
        let panels = match self.beside {
            true => self.rows_px() - RAISED_PX,
            false => room.map_height + BELOW_PX + self.rows_px(),
        };
        panels.max(room.map_height).max(room.legend_height)
    }

    /// The window of each panel.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// Draws the panels, their names and the colour bar round the map whose top is at `top`.
    pub fn draw(
        &self,
        sheet: &mut Sheet,
        map: &OverviewMap,
        lasers: &[LaserMark],
        gamma: f64,
        room: &Room,
        top: i32,
    ) {
        let at = match self.beside {
            true => [room.legend_right + BESIDE_PX, top - RAISED_PX],
            false => [PAD, top + room.map_height + BELOW_PX],
        };
        let pitch = self.pitch_px();
        for (i, class) in map.classes.iter().enumerate() {
            let (column, row) = (i as i32 % self.columns, i as i32 / self.columns);
            let (x, y) = (at[0] + column * pitch[0], at[1] + row * pitch[1] + self.head_px);
            let view = self.view.placed(x, y);
            view.paint_cells(&mut sheet.canvas, |cells| {
                share::paint(&class.share, cells, gamma, 1.0)
            });
            sheet.canvas.outline(view.area().grown(1), INK);
            marks::draw_small_lasers(&mut sheet.canvas, &view, lasers);
            self.name(sheet, class, view.area());
        }
        let x = at[0] + self.columns * pitch[0] + 6;
        let bar = (self.rows_px() - self.head_px - GAP_PX).clamp(120, 300);
        sheet.colour_bar(Rect::new(x, at[1] + self.head_px, 20, bar), gamma, 1.0);
    }

    /// Writes the name of a class above its panel, and its largest share beside or below it.
    fn name(&self, sheet: &mut Sheet, class: &ClassShare, area: Rect) {
        let style = |colour, anchor| Style::new(TEXT_PX, colour, anchor);
        let (canvas, face) = (&mut sheet.canvas, &sheet.face);
        let name = face.cut(&class.name, TEXT_PX, area.width);
        let note = face.cut(&note(class), TEXT_PX, area.width);
        let y = area.y - 14;
        if self.head_px > NAME_PX {
            face.draw(canvas, &name, area.x, y - NOTE_PX, style(INK, Anchor::Left));
            face.draw(canvas, &note, area.x, y, style(FAINT, Anchor::Left));
        } else {
            face.draw(canvas, &name, area.x, y, style(INK, Anchor::Left));
            face.draw(canvas, &note, area.right(), y, style(FAINT, Anchor::Right));
        }
    }
}

/// Width of the widest name with its note beside it.
fn widest_head_px(map: &OverviewMap, face: &Face) -> i32 {
    let text_px = |text: &str| face.width(text, TEXT_PX);
    let head_px = |class: &ClassShare| text_px(&class.name) + 12 + text_px(&note(class));
    map.classes.iter().map(head_px).max().unwrap_or(0)
}

/// The largest share of a class, in words.
fn note(class: &ClassShare) -> String {
    match class.share.iter().copied().fold(f32::NAN, f32::max) {
        s if s.is_nan() => "not observed".to_owned(),
        0.0 => "never".to_owned(),
        s if s < 0.001 => "below 0.1 %".to_owned(),
        s => format!("up to {}", scale::percent(f64::from(s))),
    }
}
