//! What a made recording looks like, in letters: `tests/golden/corner.txt` is to be read by people.
//!
//! If a change of meaning is wanted, read the picture that the test prints, and put it in the file.

use super::made::{corner, site, write};
use super::support::{Npy, scratch, tog};
use std::fmt::Write as _;
use std::path::Path;

/// Seconds of the recording that are shown: nobody; somebody since 0.6 s; since 3.6 s, and the wall in
/// the shadow was there once, for all that is seen of it; gone for 0.5 s.
const SHOWN_S: [f64; 4] = [11.9, 12.6, 15.6, 16.4];

/// One character a cell, the highest row first.
fn picture(classes: &[u8], columns: usize) -> String {
    let letter = |class: &u8| match class {
        0 => '.',
        1 => 'p',
        2 => 'l',
        3 => 'v',
        4 => '#',
        5 => 't',
        255 => ' ',
        _ => '?',
    };
    let rows = classes.chunks(columns).rev();
    rows.map(|row| format!("{}\n", row.iter().map(letter).collect::<String>().trim_end())).collect()
}

#[test]
fn somebody_who_stands_in_a_corner_looks_as_in_the_picture() {
    let scratch = scratch();
    let recording = scratch.path().join("corner.mcap");
    write(&recording, &["/scan"], (0..200).map(|number| (0, corner(number))));
    let area = "origin_m = [-0.5, -1.5]\ncell_m = 0.25\ncolumns = 20\nrows = 12\n\
                timescales_s = [1, 3, 10]\n";
    let (path, out) = (scratch.path().join("site.toml"), scratch.path().join("out"));
    std::fs::write(&path, site(&recording, area, &[("scan", "/scan", [0.0; 3])])).unwrap();
    let replay = [Path::new("replay"), &recording, Path::new("--site"), &path];
    let rest = [Path::new("--every-frame"), Path::new("--out"), &out];
    tog(&scratch, replay.into_iter().chain(rest)).expect(0, &[]);

    let classes = Npy::read(&out.join("classes.npy"));
    let (columns, cells) = (classes.shape[2], classes.shape[1] * classes.shape[2]);
    let mut found = String::new();
    for shown_s in SHOWN_S {
        let row = (shown_s * 10.0).round() as usize - 1; // the first frame is at 0.1 s
        let _ = writeln!(found, "at {shown_s:.1} s");
        found += &picture(&classes.bytes[row * cells..][..cells], columns);
    }
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/corner.txt");
    let expected = std::fs::read_to_string(golden).unwrap_or_default();
    assert!(found == expected, "found:\n{found}\nexpected:\n{expected}");
}
