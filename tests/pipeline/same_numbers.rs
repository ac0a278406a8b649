//! A recording gives the same numbers in one process, in separate processes, and at every run.

use super::support::{files, scratch, shared, tog};
use super::{made, support::Npy};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// What `tog run --out` and `tog replay --out --every-frame` both write.
const ARRAYS: [&str; 4] =
    ["classes.npy", "frames.npy", "collapsed_counts.npy", "occupancy_last.npy"];

/// Replays a recording in one process.
pub fn replay(scratch: &TempDir, recording: &Path, site: Option<&Path>, out: &str) -> PathBuf {
    let out = scratch.path().join(out);
    let mut arguments = vec!["replay".into(), recording.to_owned()];
    arguments.extend(["--every-frame".into(), "--out".into(), out.clone()]);
    if let Some(site) = site {
        arguments.extend(["--site".into(), site.to_owned()]);
    }
    tog(scratch, &arguments).expect(0, &["tog: results of area"]);
    out
}

/// Runs the site of a recording both ways and compares every byte.
#[track_caller]
pub fn both_ways(recording: &Path, site_text: &str, classes_min: usize) {
    let scratch = scratch();
    let site = scratch.path().join("site.toml");
    std::fs::write(&site, site_text).unwrap();
    let one = replay(&scratch, recording, Some(&site), "one");
    let many = scratch.path().join("many");
    let run = ["run".as_ref(), site.as_path(), "--out".as_ref(), many.as_path()];
    let said = tog(&scratch, run);
    said.expect(0, &["the recording is over"]);
    for name in ARRAYS {
        let (found, expected) = (many.join(name), one.join(name));
        let shapes = [&found, &expected].map(|path| Npy::read(path).shape);
        assert_eq!(shapes[0], shapes[1], "{name}; tog run said:\n{}", said.said());
        let same = std::fs::read(&found).unwrap() == std::fs::read(&expected).unwrap();
        assert!(same, "{name} differs; tog run said:\n{}", said.said());
    }
    // The events of a replay are marked in its overview; those of a run are in its journal.
    for name in ["grid.json", "background.png", "transit.png"] {
        let [found, expected] = [&many, &one].map(|out| std::fs::read(out.join(name)).unwrap());
        assert!(found == expected, "{name} differs");
    }
    assert!(many.join("overview.png").is_file());
    let seen: BTreeSet<u8> = Npy::read(&one.join("classes.npy")).bytes.into_iter().collect();
    assert!(seen.len() >= classes_min, "nothing was compared: only classes {seen:?}");
}

#[test]
fn a_made_recording_gives_the_same_numbers_in_separate_processes() {
    let scratch = scratch();
    let recording = scratch.path().join("room.mcap");
    let site = made::room(&recording, 25);
    both_ways(&recording, &site, 6);
}

#[test]
fn two_persons_in_a_room_give_the_same_numbers_in_separate_processes() {
    let file = "leigh_leg_tracker/demo_stationary_simple_environment.bag";
    let Some(recording) = shared(file) else { return };
    let area = "origin_m = [-0.5, -4.6]\ncolumns = 65\nrows = 93\n";
    let site = made::site(&recording, area, &[("scan", "/scan", [0.0; 3])]);
    both_ways(&recording, &site, 7);
}

#[test]
fn two_lasers_give_the_same_numbers_in_separate_processes() {
    let Some(recording) = shared("tysik_two_laser/scans_demo.bag") else { return };
    both_ways(&recording, &two_lasers(&recording), 7);
}

#[test]
fn three_lasers_out_of_step_give_the_same_numbers_in_separate_processes() {
    let Some(recording) = shared("leigh_leg_tracker/negative_2_first_30s.bag") else { return };
    both_ways(&recording, &three_lasers(&recording), 5);
}

/// Both lasers of the two-laser recording in one area, at their nominal poses.
pub fn two_lasers(recording: &Path) -> String {
    let lasers = [
        ("front_scan", "/front_scan", [0.23565, -0.0005, 0.0]),
        ("rear_scan", "/rear_scan", [-0.23832, 0.00542, 180.0]),
    ];
    let area = "origin_m = [-5.0, -5.0]\ncolumns = 100\nrows = 100\ntimescales_s = [1, 5, 20]\n";
    made::site(recording, area, &lasers)
}

/// The three lasers of one platform in one area, at their nominal poses.
pub fn three_lasers(recording: &Path) -> String {
    let lasers = [
        ("left_scan", "/left_scan", [0.850, 0.235, 42.1]),
        ("right_scan", "/right_scan", [0.868, -0.215, -38.7]),
        ("rear_scan", "/rear_scan", [-0.188, 0.0, 180.0]),
    ];
    let area = "origin_m = [-9.0, -9.0]\ncolumns = 180\nrows = 180\ntimescales_s = [1, 4, 15]\n";
    made::site(recording, area, &lasers)
}

#[test]
fn two_replays_write_the_same_files_to_the_last_byte() {
    let scratch = scratch();
    let recording = scratch.path().join("room.mcap");
    let site = scratch.path().join("site.toml");
    std::fs::write(&site, made::room(&recording, 25)).unwrap();
    for (name, site) in [("with", Some(site.as_path())), ("without", None)] {
        let first = replay(&scratch, &recording, site, &format!("{name}-1"));
        let second = replay(&scratch, &recording, site, &format!("{name}-2"));
        let names = files(&first);
        assert_eq!(names, files(&second));
        for name in ["background.png", "overview.png", "events.jsonl", "grid.json"] {
            assert!(names.iter().any(|found| found.ends_with(name)), "{name} in {names:?}");
        }
        for name in names {
            let [first, second] = [&first, &second].map(|out| std::fs::read(out.join(&name)));
            assert!(first.unwrap() == second.unwrap(), "{} differs", name.display());
        }
    }
}

#[test]
fn a_replay_of_one_row_a_second_is_a_selection_of_every_frame() {
    let scratch = scratch();
    let recording = scratch.path().join("corner.mcap");
    made::write(&recording, &["/scan"], (0..200).map(|number| (0, made::corner(number))));
    let site = scratch.path().join("site.toml");
    let lasers = [("scan", "/scan", [0.0; 3])];
    std::fs::write(&site, made::site(&recording, made::CORNER_AREA, &lasers)).unwrap();
    let every = replay(&scratch, &recording, Some(&site), "every");
    let few = scratch.path().join("few");
    let arguments = [Path::new("replay"), &recording, Path::new("--site"), &site];
    let arguments = arguments.into_iter().chain([Path::new("--out"), &few]);
    tog(&scratch, arguments).expect(0, &[]);

    let numbers = |out: &Path| Npy::read(&out.join("frames.npy")).u64s();
    let (all, some) = (numbers(&every), numbers(&few));
    assert_eq!(all.len(), 199, "stamps from 0.007 s to 19.907 s hold frames 0.1 s to 19.9 s");
    let expected: Vec<u64> = all.iter().copied().filter(|number| number % 10 == 0).collect();
    assert_eq!(some, expected);
    let (all_rows, some_rows) =
        (Npy::read(&every.join("classes.npy")), Npy::read(&few.join("classes.npy")));
    let cells = all_rows.shape[1] * all_rows.shape[2];
    for (row, number) in some_rows.bytes.chunks(cells).zip(&some) {
        let at = all.iter().position(|other| other == number).unwrap();
        assert!(all_rows.bytes[at * cells..][..cells] == *row, "frame {number}");
    }
    let totals = [&every, &few].map(|out| Npy::read(&out.join("collapsed_counts.npy")).bytes);
    assert!(totals[0] == totals[1], "the counts hold every frame in both");
}
