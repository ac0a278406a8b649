//! Whole pictures, read back from their PNG bytes.
#![allow(clippy::unwrap_used)]

use figures::{
    ChangeMap, ClassGrid, ClassShare, EventMark, FileFormat, LaserMark, Options, OverviewMap,
    Scale, ShareMap, ZoneMark, class_map, class_share, overview, share_change,
};
use proptest::prelude::*;
use protocol::geometry::GridGeometry;
use protocol::grid::{CLASS_UNKNOWN, ClassName};

const YELLOW: [u8; 3] = [253, 231, 37];
const PURPLE: [u8; 3] = [68, 1, 84];

struct Picture {
    width: usize,
    rgb: Vec<u8>,
}

impl Picture {
    fn of(bytes: &[u8]) -> Self {
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut rgb).unwrap();
        Self { width: info.width as usize, rgb }
    }

    fn height(&self) -> usize {
        self.rgb.len() / 3 / self.width
    }

    /// Pixels of a colour as (x, y).
    fn find(&self, colour: [u8; 3]) -> Vec<(usize, usize)> {
        let pixels = self.rgb.chunks_exact(3).enumerate();
        pixels
            .filter(|(_, p)| *p == colour)
            .map(|(i, _)| (i % self.width, i / self.width))
            .collect()
    }

    /// Nothing touches the edge of the page, so nothing is cut off.
    fn edge_is_blank(&self) -> bool {
        let near = |at: usize, side: usize| at < 6 || at + 6 >= side;
        let pixels = self.rgb.chunks_exact(3).enumerate();
        let ink = pixels.filter(|(_, p)| *p != [255, 255, 255]);
        ink.map(|(i, _)| (i % self.width, i / self.width))
            .all(|(x, y)| !near(x, self.width) && !near(y, self.height()))
    }
}

fn grid(columns: u32, rows: u32) -> GridGeometry {
    GridGeometry { origin_m: [-3.0, 12.5], cell_m: 0.1, columns, rows }
}

fn share_map(grid: GridGeometry, share: impl Fn(usize) -> f32) -> ShareMap {
    let share = (0..grid.cells()).map(share).collect();
    ShareMap { grid, share, title: "foyer: passing".into(), subtitle: "2 min observed".into() }
}

fn laser(id: &str, x_m: f64, y_m: f64) -> LaserMark {
    LaserMark { id: id.into(), x_m, y_m, yaw_rad: 0.7 }
}

#[test]
fn the_cell_with_high_y_and_low_x_is_up_and_left() {
    let grid = grid(10, 10);
    let upper_left = grid.index(1, 8);
    let map = share_map(grid, |i| if i == upper_left { 1.0 } else { 0.0 });
    let picture = Picture::of(&class_share(&map, &[], &Options::default()).unwrap());
    // The colour bar, right of the map, ends in the same yellow.
    let plot = picture.find(PURPLE);
    let (left, right) = (plot.iter().map(|p| p.0).min().unwrap(), picture.width - 140);
    let (top, bottom) =
        (plot.iter().map(|p| p.1).min().unwrap(), plot.iter().map(|p| p.1).max().unwrap());
    let yellow: Vec<_> = picture.find(YELLOW).into_iter().filter(|p| p.0 < right).collect();
    assert_eq!(yellow.len(), 48 * 48, "a cell of whole pixels");
    assert!(yellow.iter().all(|p| p.0 >= left + 48 && p.0 < left + 96), "column 1");
    assert!(yellow.iter().all(|p| p.1 >= top + 48 && p.1 < top + 96), "row 8 of 10, from above");
    assert_eq!(bottom - top + 1, 480);
}

#[test]
fn a_cell_that_was_never_observed_does_not_look_like_zero() {
    let half = |never: f32| {
        let map = share_map(grid(10, 10), |i| if i < 50 { 0.0 } else { never });
        let options = Options { crop: false, ..Options::default() };
        Picture::of(&class_share(&map, &[], &options).unwrap()).find(PURPLE).len()
    };
    assert!(half(0.0) > half(f32::NAN) + 48 * 48 * 49);
}

#[test]
fn the_same_map_gives_the_same_bytes_and_another_one_does_not() {
    let map = |s: f32| share_map(grid(40, 30), move |i| if i == 617 { s } else { 0.01 });
    let draw = |s| class_share(&map(s), &[laser("north", 0.0, 13.0)], &Options::default()).unwrap();
    assert_eq!(draw(0.02), draw(0.02));
    assert_ne!(draw(0.02), draw(0.05));
}

#[test]
fn a_hall_of_four_million_cells_fits_and_keeps_its_thin_walls() {
    let grid = grid(4096, 1024);
    let wall = |i: usize| if i % 4096 == 2051 { 1.0 } else { 0.0 };
    let bytes = class_share(&share_map(grid, wall), &[], &Options::default()).unwrap();
    let picture = Picture::of(&bytes);
    assert!(picture.width < 1300 && picture.height() < 700);
    let yellow = picture.find(YELLOW);
    let column = yellow.iter().filter(|p| p.0 == yellow[yellow.len() / 2].0).count();
    assert!(column >= 200, "the wall is {column} pixels long");
    assert!(picture.edge_is_blank());
}

#[test]
fn long_titles_and_names_are_cut_not_clipped() {
    let long =
        "a very long name of an area with \u{65e5}\u{672c} and\ncontrol characters ".repeat(40);
    let mut map = share_map(grid(10, 10), |_| 0.5);
    (map.title, map.subtitle) = (long.clone(), long.clone());
    let lasers = [laser(&long, -2.5, 13.0), laser(&long, 900.0, 13.0)];
    let picture = Picture::of(&class_share(&map, &lasers, &Options::default()).unwrap());
    assert!(picture.edge_is_blank() && picture.height() < 1000);
    let event = EventMark { x_m: -2.6, y_m: 13.1, label: long.clone() };
    let zones = vec![ZoneMark {
        name: long.clone(),
        polygon_m: vec![[-3.0, 12.0], [9.0, 12.6], [-2.0, 13.0]],
    }];
    let classes = vec![ClassShare { id: 1, name: long, share: map.share.clone() }; 7];
    let map =
        OverviewMap { grid: map.grid, classes, title: map.title, subtitle: map.subtitle, zones };
    let bytes = overview(&map, &lasers, &vec![event; 99], &Options::default()).unwrap();
    assert!(Picture::of(&bytes).edge_is_blank());
}

#[test]
fn an_overview_is_no_wider_than_a_screen_whatever_the_form_of_the_map() {
    for (columns, rows) in [(64, 56), (20, 110), (110, 20), (300, 300), (1000, 400), (5, 5)] {
        let share = vec![0.5; grid(columns, rows).cells()];
        let class = |id| ClassShare { id, name: format!("class {id}"), share: share.clone() };
        let map = OverviewMap {
            grid: grid(columns, rows),
            classes: (0..6).map(class).collect(),
            title: "hall".into(),
            subtitle: String::new(),
            zones: vec![],
        };
        let bytes = overview(&map, &[], &[], &Options::default()).unwrap();
        let picture = Picture::of(&bytes);
        assert!(picture.width <= 1600, "{columns} x {rows}: {} px", picture.width);
        assert!(picture.edge_is_blank());
    }
}

#[test]
fn a_scale_up_to_the_largest_share_shows_it_as_strongly_as_another_shows_all() {
    let map = share_map(grid(10, 10), |i| if i == 55 { 0.02 } else { 0.0 });
    let yellow = |scale| {
        let options = Options { scale, ..Options::default() };
        Picture::of(&class_share(&map, &[], &options).unwrap()).find(YELLOW).len()
    };
    assert!(yellow(Scale::Max) >= yellow(Scale::Full) + 48 * 48);
}

#[test]
fn an_overview_without_classes_is_refused_in_words() {
    let map = OverviewMap {
        grid: grid(4, 4),
        classes: vec![],
        title: String::new(),
        subtitle: String::new(),
        zones: vec![],
    };
    let text = overview(&map, &[], &[], &Options::default()).unwrap_err().to_string();
    assert!(text.contains("0 classes"), "{text}");
}

fn any_grid() -> impl Strategy<Value = GridGeometry> {
    let side = || prop_oneof![1u32..5, 1u32..80, 300u32..900];
    let origin = || prop_oneof![Just(0.0), -50.0..50.0f64, -1e9..1e9f64];
    let cell = prop_oneof![0.02..0.5f64, 0.001..1000.0f64];
    (side(), side(), cell, origin(), origin()).prop_map(|(columns, rows, cell_m, x, y)| {
        GridGeometry { origin_m: [x, y], cell_m, columns, rows }
    })
}

fn any_lasers() -> impl Strategy<Value = Vec<LaserMark>> {
    let number = || prop_oneof![-5.0..5.0f64, any::<f64>()];
    let mark = ("[a-z_/]{0,30}", number(), number(), number());
    let laser = mark.prop_map(|(id, x_m, y_m, yaw_rad)| LaserMark { id, x_m, y_m, yaw_rad });
    prop::collection::vec(laser, 0..5)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    #[test]
    fn no_size_and_no_number_makes_it_panic_or_draw_over_the_edge(
        grid in any_grid(),
        lasers in any_lasers(),
        title in ".{0,60}",
        observed in 1usize..9,
        side in prop::array::uniform2(100u32..900),
        crop: bool,
    ) {
        let options = Options { plot_max_px: side, crop, ..Options::default() };
        let value = |i: usize| if i.is_multiple_of(observed) { (i % 7) as f32 / 6.0 } else { f32::NAN };
        let mut map = share_map(grid, value);
        map.title = title.clone();
        let picture = Picture::of(&class_share(&map, &lasers, &options).unwrap());
        prop_assert!(picture.edge_is_blank());

        let classes = (0..grid.cells()).map(|i| if i.is_multiple_of(observed) { 4 } else { CLASS_UNKNOWN });
        let names = vec![ClassName { id: 4, name: title.clone() }];
        let instant = ClassGrid {
            grid, classes: classes.collect(), names, title: title.clone(), subtitle: title.clone(),
        };
        prop_assert!(Picture::of(&class_map(&instant, &lasers, &options).unwrap()).edge_is_blank());

        let class = |id| ClassShare { id, name: title.clone(), share: map.share.clone() };
        let whole = OverviewMap {
            grid, classes: (0..observed as u8).map(class).collect(), title, subtitle: String::new(), zones: vec![],
        };
        let events: Vec<EventMark> = lasers
            .iter()
            .map(|l| EventMark { x_m: l.x_m, y_m: l.y_m, label: l.id.clone() })
            .collect();
        let bytes = overview(&whole, &lasers, &events, &options).unwrap();
        prop_assert!(Picture::of(&bytes).edge_is_blank());
    }
}

#[test]
fn an_svg_has_the_size_of_the_png_its_texts_as_text_and_its_cells_as_a_picture() {
    let grid = grid(30, 20);
    let map = share_map(grid, |i| if i % 7 == 0 { 1.0 } else { 0.0 });
    let lasers = [laser("north & <east>", -2.0, 13.0)];
    let svg = Options { format: FileFormat::Svg, ..Options::default() };
    let file = String::from_utf8(class_share(&map, &lasers, &svg).unwrap()).unwrap();
    let png = Picture::of(&class_share(&map, &lasers, &Options::default()).unwrap());
    let size = format!("width=\"{}\" height=\"{}\"", png.width, png.height());
    assert!(file.contains(&size), "{size}");
    for text in ["foyer: passing</text>", "2 min observed</text>", "x (m)</text>", "100 %</text>"] {
        assert!(file.contains(text), "{text}");
    }
    assert!(file.contains("north &amp; &lt;east&gt;</text>"));
    assert_eq!(file.matches("href=\"data:image/png;base64,").count(), 1);
    assert!(file.len() < 60_000, "{} bytes", file.len());
}

#[test]
fn a_change_is_red_where_the_share_rose_and_its_place_is_listed() {
    let grid = grid(20, 20);
    let before = vec![0.0; grid.cells()];
    let mut after = before.clone();
    after[grid.index(3, 4)] = 1.0;
    let (title, subtitle) = ("hall: change of background".into(), String::new());
    let map = ChangeMap { grid, before, after, title, subtitle };
    let places = [EventMark { x_m: -2.0, y_m: 13.0, label: "something solid appeared".into() }];
    let options = Options { gamma: 1.0, ..Options::default() };
    let picture = Picture::of(&share_change(&map, &[], &places, &options).unwrap());
    let red = picture.find([103, 0, 31]).into_iter().filter(|p| p.0 + 150 < picture.width);
    assert!(red.count() > 300, "one cell of whole pixels");
    assert!(picture.edge_is_blank());
    let short = ChangeMap { after: vec![0.0], ..map };
    assert!(share_change(&short, &[], &[], &options).is_err());
}

fn page(grid: GridGeometry, count: usize) -> figures::PanelSheet {
    let panel = |i: usize| figures::Panel {
        share: (0..grid.cells()).map(|cell| if cell == 7 * i { 1.0 } else { 0.0 }).collect(),
        caption: format!("({}) {i} second activity", char::from(b'a' + i as u8)),
        circles: vec![figures::CircleMark { x_m: -1.0, y_m: 14.0, radius_m: 0.4 }],
    };
    figures::PanelSheet {
        grid,
        panels: (0..count).map(panel).collect(),
        title: "Figure 4".into(),
        subtitle: "20 min, one laser".into(),
        caption: "The door is circled. ".into(),
    }
}

#[test]
fn panels_have_one_scale_and_nothing_is_cut_off() {
    let grid = grid(30, 20);
    let options = Options { plot_max_px: [330, 300], ..Options::default() };
    for count in [1, 2, 3, 4, 6] {
        let bytes = figures::panels(&page(grid, count), &[laser("a", -1.5, 13.0)], &options);
        let picture = Picture::of(&bytes.unwrap());
        assert!(picture.edge_is_blank(), "{count} panels");
        // A full cell is 11 x 11 pixels in each panel; some rows of the colour bar are as yellow.
        let cells = picture.find(YELLOW).len();
        assert!((count * 121..count * 121 + 200).contains(&cells), "{count}: {cells}");
        assert!(!picture.find([213, 94, 0]).is_empty(), "the circle");
    }
    let again = figures::panels(&page(grid, 4), &[], &options).unwrap();
    assert_eq!(again, figures::panels(&page(grid, 4), &[], &options).unwrap());
}

#[test]
fn pages_that_cannot_be_drawn_are_refused_in_words() {
    let grid = grid(30, 20);
    for count in [0, 7] {
        let error = figures::panels(&page(grid, count), &[], &Options::default()).unwrap_err();
        assert!(error.to_string().contains("1 to 6 expected"), "{error}");
    }
    let mut short = page(grid, 2);
    short.panels[1].share.pop();
    assert!(figures::panels(&short, &[], &Options::default()).is_err());
}
