//! Grids and differences, made by hand.
#![allow(clippy::unwrap_used)]

use super::diff::compare;
use super::grid_file::GridFile;
use protocol::grid::ClassName;

/// A grid of two classes, `empty` and `wall`, of cells of 10 cm from (1, 2) m.
pub fn grid(columns: u32, rows: u32) -> GridFile {
    let class = |(id, name): (usize, &str)| ClassName { id: id as u8, name: name.to_owned() };
    GridFile {
        area: "hall".to_owned(),
        origin_m: [1.0, 2.0],
        cell_m: 0.1,
        columns,
        rows,
        frame_period_ns: 100_000_000,
        scan_age_max_ms: 250.0,
        range_tolerance_m: 0.06,
        timescales_s: vec![1.0, 60.0],
        known_share_min: 0.5,
        preset: "default".to_owned(),
        classes: ["empty", "wall"].into_iter().enumerate().map(class).collect(),
        prototypes: vec![vec![0.0; 2], vec![1.0; 2]],
        transit: false,
        contexts: vec!["always".to_owned()],
        lasers: Vec::new(),
        zones: Vec::new(),
    }
}

/// Counts of [`grid`] with walls where the picture has `#`, nothing seen where it has a space; the
/// highest row first.
fn counts(picture: &[&str], frames: u64) -> Vec<u64> {
    let cells: Vec<u8> = picture.iter().rev().flat_map(|row| row.bytes()).collect();
    let of = |sign: u8| cells.iter().map(move |cell| if *cell == sign { frames } else { 0 });
    of(b'.').chain(of(b'#')).collect()
}

#[test]
fn a_wall_that_appeared_is_one_place_and_its_shadow_is_counted() {
    let grid = grid(6, 4);
    let before = counts(&["......", "......", "......", "#....."], 10);
    let after = counts(&["      ", ".####.", "......", "......"], 30);
    let difference = compare(&grid, &before, &after, 0.2);
    assert_eq!((difference.cells_in_both, difference.cells_before_only), (18, 6));
    assert_eq!((difference.cells_after_only, difference.cells_changed), (0, 5));
    assert_eq!((difference.places_found, difference.places.len()), (2, 2));
    let wall = &difference.places[0];
    assert_eq!((wall.cells, &*wall.from, &*wall.to), (4, "empty", "wall"));
    assert_eq!(
        wall.text,
        "something solid appeared at (1.3, 2.2) m, 0.4 x 0.1 m: `wall` 0 % -> 100 %, instead of `empty`"
    );
    let text = &difference.places[1].text;
    assert!(text.starts_with("something solid is gone at (1.1, 2.0) m"), "{text}");
    let class = &difference.classes[1];
    assert_eq!((class.cells_more, class.cells_less), (4, 1));
    assert_eq!((class.share_before, class.share_after), (1.0 / 18.0, 4.0 / 18.0));
    let fall = class.largest_fall.unwrap();
    assert_eq!((fall.before, fall.after), (1.0, 0.0));
    assert!((fall.x_m - 1.05).abs() < 1e-9 && (fall.y_m - 2.05).abs() < 1e-9);
}

#[test]
fn a_map_does_not_differ_from_the_same_map_seen_for_longer() {
    let picture = ["..#. ", "#...#"];
    let difference = compare(&grid(5, 2), &counts(&picture, 7), &counts(&picture, 700), 0.001);
    assert_eq!((difference.cells_changed, difference.places_found), (0, 0));
    assert_eq!(difference.classes[1].largest_rise, None);
}

#[test]
fn what_was_written_is_read_and_a_grid_that_differs_is_named_by_its_key() {
    let directory = tempfile::tempdir().unwrap();
    let grid = grid(6, 4);
    grid.write(directory.path()).unwrap();
    assert_eq!(GridFile::read(directory.path()).unwrap(), grid);
    assert_eq!(grid.difference(&grid), None);
    let finer = GridFile { cell_m: 0.05, ..grid.clone() };
    let expected = ("cell_m", "0.05".to_owned(), "0.1".to_owned());
    assert_eq!(grid.difference(&finer), Some(expected));
    let longer = GridFile { timescales_s: vec![1.0, 90.0], ..grid.clone() };
    assert_eq!(grid.difference(&longer).unwrap().0, "timescales_s");
}

#[test]
fn numbers_that_no_grid_has_are_refused_in_words() {
    type Change = fn(&mut GridFile);
    let wrong: [(&str, Change); 11] = [
        ("0 x 4 cells", |grid| grid.columns = 0),
        ("4096 x 4096 cells", |grid| (grid.columns, grid.rows) = (4096, 4096)),
        ("cells of 0 m", |grid| grid.cell_m = 0.0),
        ("frame_period_ns 0", |grid| grid.frame_period_ns = 0),
        ("timescales_s []", |grid| grid.timescales_s.clear()),
        ("do not fit", |grid| grid.transit = true),
        ("a prototype of 4294967296", |grid| grid.prototypes[1][0] = 4_294_967_296.0),
        ("a prototype of -1", |grid| grid.prototypes[0][1] = -1.0),
        ("known_share_min 2", |grid| grid.known_share_min = 2.0),
        ("../../etc", |grid| grid.classes[1].name = "../../etc/passwd".to_owned()),
        ("2 contexts", |grid| grid.contexts = vec!["always".to_owned(); 2]),
    ];
    for (words, change) in wrong {
        let mut grid = grid(6, 4);
        change(&mut grid);
        let error = GridFile::parse(&serde_json::to_vec(&grid).unwrap()).unwrap_err();
        assert!(error.contains(words), "{words}: {error}");
    }
}

#[test]
fn a_grid_file_with_any_byte_changed_or_cut_never_panics() {
    let text = serde_json::to_vec(&grid(6, 4)).unwrap();
    for at in 0..text.len() {
        assert!(GridFile::parse(&text[..at]).is_err(), "cut at {at}");
        for byte in [0, b'"', b'9', b'-', b'}', 0xff] {
            let mut changed = text.clone();
            changed[at] = byte;
            let _ = GridFile::parse(&changed);
        }
    }
}
