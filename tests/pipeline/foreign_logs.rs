//! Every format gives the scans that an independent reader finds (`tests/independent/logs.py`, of the
//! standard library of Python alone), and the numbers that the recording it was made from gives.

use super::made;
use super::oracle::has_python;
use super::same_numbers::{both_ways, replay, two_lasers};
use super::support::{files, scratch, shared, tog, watched};
use recording::{Echo, ReadOptions, Recording, RecordingError};
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

/// How `logs.py make` lays out its CSV.
const COLUMNS: &str =
    "t:ms,laser,angle_min:deg,-,r...:mm,angle_increment=0.5:deg,range_min=2:cm,range_max=8";

fn logs_py(arguments: &[&Path]) -> String {
    let mut command = Command::new("python3");
    command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/independent/logs.py"));
    command.args(arguments).env("PYTHONDONTWRITEBYTECODE", "1");
    let ended = watched(command);
    ended.expect(0, &[]);
    ended.out
}

/// The scans of a recording as `logs.py` prints them.
fn lines(path: &Path, options: ReadOptions) -> Vec<String> {
    let line = |item: Result<recording::RecordedScan, RecordingError>| {
        let found = match item {
            Ok(found) => found,
            Err(error) => {
                assert!(!error.ends_the_stream(), "{error}");
                return "refused".to_owned();
            }
        };
        let (scan, g) = (&found.scan, &found.scan.geometry);
        let mut line = format!("{} {} {}", found.topic, found.log_time_ns, scan.stamp_ns);
        for value in [g.angle_min_rad, g.angle_increment_rad, g.range_min_m, g.range_max_m] {
            let _ = write!(line, " {:016x}", value.to_bits());
        }
        line.push(' ');
        for range_m in &scan.ranges_m {
            let bits = if range_m.is_nan() { 0x7fc0_0000 } else { range_m.to_bits() };
            let _ = write!(line, "{bits:08x}");
        }
        line
    };
    Recording::open_with(path, options).unwrap().scans().map(line).collect()
}

/// Compares a log with what the independent reader prints; how many scans.
#[track_caller]
fn same_scans(path: &Path, options: ReadOptions, echo: &str) -> usize {
    let expected = logs_py(&[Path::new("read"), path, Path::new(echo)]);
    let found = lines(path, options);
    let name = path.display();
    for (number, (found, expected)) in found.iter().zip(expected.lines()).enumerate() {
        assert_eq!(found, expected, "{name}: scan {}", number + 1);
    }
    assert_eq!(found.len(), expected.lines().count(), "{name}");
    found.len()
}

#[test]
fn an_independent_reader_finds_the_same_scans_in_every_kind_of_log() {
    if !has_python() {
        return;
    }
    let scratch = scratch();
    logs_py(&[Path::new("make"), scratch.path()]);
    let columns = ReadOptions { columns: Some(COLUMNS.parse().unwrap()), ..ReadOptions::default() };
    for (name, options, scans) in [
        ("carmen.log", ReadOptions::default(), 60),
        ("carmen.log.gz", ReadOptions::default(), 60),
        ("player.log", ReadOptions::default(), 60),
        ("scans.csv", columns, 60),
        ("bag", ReadOptions::default(), 53),
        ("bag/b_1.db3", ReadOptions::default(), 26),
    ] {
        assert_eq!(same_scans(&scratch.path().join(name), options, "first"), scans, "{name}");
    }
    let echoes = [(Echo::First, "first"), (Echo::Last, "last"), (Echo::Strongest, "strongest")];
    for (echo, name) in echoes {
        let options = ReadOptions { echo, ..ReadOptions::default() };
        same_scans(&scratch.path().join("echo.db3"), options, name);
    }
}

#[test]
fn an_independent_reader_finds_the_same_scans_in_real_carmen_logs() {
    for name in ["carmen/intel-corrected.log.gz", "carmen/orebro-corrected.log.gz"] {
        if let (true, Some(log)) = (has_python(), shared(name)) {
            let scans = same_scans(&log, ReadOptions::default(), "first");
            println!("{name}: {scans} scans, the same");
        }
    }
}

/// Imports a recording, makes a CSV of the import and MCAP of the CSV, and replays all of them.
#[track_caller]
fn round_trip(recording: &Path, site_text: Option<&str>) {
    let scratch = scratch();
    let site = scratch.path().join("site.toml");
    let site = site_text.map(|text| {
        std::fs::write(&site, text).unwrap();
        site.as_path()
    });
    let [imported, csv, back] = ["a.mcap", "b.csv", "c.mcap"].map(|name| scratch.path().join(name));
    let import = ["bag".as_ref(), "import".as_ref(), recording, "--out".as_ref(), &imported];
    tog(&scratch, import).expect(0, &["tog: wrote"]);
    for (from, to) in [(&imported, &csv), (&csv, &back)] {
        let convert = ["bag".as_ref(), "convert".as_ref(), from.as_path(), to];
        tog(&scratch, convert).expect(0, &["tog: wrote"]);
    }
    let original = replay(&scratch, recording, site, "original");
    for (path, out) in [(&imported, "a"), (&csv, "b"), (&back, "c")] {
        let out = replay(&scratch, path, site, out);
        let names = files(&original).into_iter();
        let names: Vec<_> =
            names.filter(|name| name.extension().is_some_and(|e| e == "npy")).collect();
        assert!(names.len() >= 4, "{names:?}");
        for name in names {
            let [found, expected] =
                [&out, &original].map(|directory| std::fs::read(directory.join(&name)).unwrap());
            assert!(found == expected, "{} of {} differs", name.display(), path.display());
        }
    }
}

#[test]
fn an_import_replays_to_the_numbers_of_the_original() {
    if let Some(bag) = shared("tysik_two_laser/scans_demo.bag") {
        round_trip(&bag, Some(&two_lasers(&bag)));
    }
    if let Some(bag) = shared("scan_tools/laser_scan_splitter_demo.bag") {
        round_trip(&bag, None);
    }
    if has_python() {
        let scratch = scratch();
        logs_py(&[Path::new("make"), scratch.path()]);
        round_trip(&scratch.path().join("bag"), None);
    }
}

#[test]
fn a_site_in_separate_processes_replays_a_csv() {
    let scratch = scratch();
    let [recording, csv] = ["room.mcap", "room.csv"].map(|name| scratch.path().join(name));
    let site = made::room(&recording, 20);
    tog(&scratch, ["bag".as_ref(), "convert".as_ref(), recording.as_path(), &csv]).expect(0, &[]);
    let paths = [&recording, &csv].map(|path| path.display().to_string());
    both_ways(&csv, &site.replace(&paths[0], &paths[1]), 6);
}
