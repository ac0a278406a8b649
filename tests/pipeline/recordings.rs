//! What is recorded is what was there: the scans of a lossless replay bit by bit, so that a replay
//! of the recording gives the same numbers; and everything in it is read by other people's
//! programs, which know nothing of us (`tests/independent/recordings.py`).

use super::oracle::has_python;
use super::support::{Npy, scratch, shared, tog, watched};
use super::{made, same_numbers};
use protocol::scan::LaserScan;
use recording::{BagDirectory, Recording, RecordingError, file_facts};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

fn script() -> Command {
    let script = "tests/independent/recordings.sh";
    Command::new(Path::new(env!("CARGO_MANIFEST_DIR")).join(script))
}

const RECORDER: &str = "\n[recorder]\ndir = \"rec\"\nclasses_period_s = 0.01\nmaps_period_s = 1\n";

/// Runs a site of a lossless replay with a recorder to its end, and returns what was recorded.
fn record(scratch: &TempDir, site: &str) -> BagDirectory {
    let path = scratch.path().join("recorded.toml");
    std::fs::write(&path, format!("{site}{RECORDER}")).unwrap();
    let arguments = [Path::new("run"), &path];
    tog(scratch, arguments).expect(0, &["the recording is over", "records into"]);
    let sessions = std::fs::read_dir(scratch.path().join("rec")).unwrap();
    let paths: Vec<PathBuf> = sessions.map(|entry| entry.unwrap().path()).collect();
    assert_eq!(paths.len(), 1, "one session: {paths:?}");
    BagDirectory::open(&paths[0]).unwrap()
}

fn the_file(bag: &BagDirectory) -> PathBuf {
    assert_eq!((bag.files().len(), bag.active().unwrap().len()), (1, 0));
    bag.path().join(&bag.files()[0].name)
}

/// Replays with a site file into `out`, every frame.
fn replay(scratch: &TempDir, recording: &Path, site: &Path, out: &str) -> PathBuf {
    let out = scratch.path().join(out);
    let arguments = [
        "replay".as_ref(),
        recording,
        "--every-frame".as_ref(),
        "--site".as_ref(),
        site,
        "--out".as_ref(),
        out.as_path(),
    ];
    tog(scratch, arguments).expect(0, &["tog: results of area"]);
    out
}

fn same_arrays(one: &Path, two: &Path) {
    for name in ["classes.npy", "frames.npy", "collapsed_counts.npy", "occupancy_last.npy"] {
        let [one, two] = [one, two].map(|out| std::fs::read(out.join(name)).unwrap());
        assert!(one == two, "{name} differs");
    }
}

/// A recording, its site file, and the site file of what is recorded of it: the same classes.
fn round_trip(recording: &Path, site: &str, topics: &[(&str, &str)]) {
    let scratch = scratch();
    let site_path = scratch.path().join("site.toml");
    std::fs::write(&site_path, site).unwrap();
    let original = replay(&scratch, recording, &site_path, "original");
    let recorded = the_file(&record(&scratch, site));
    let mut again = site.to_owned();
    for (topic, recorded) in topics {
        again = again.replace(&format!("topic = \"{topic}\""), &format!("topic = \"{recorded}\""));
    }
    let again_path = scratch.path().join("again.toml");
    std::fs::write(&again_path, again).unwrap();
    same_arrays(&original, &replay(&scratch, &recorded, &again_path, "again"));
    // Alone: the site that is attached to it, of the file and of its directory.
    for (name, path) in [("file", recorded.as_path()), ("bag", recorded.parent().unwrap())] {
        let out = scratch.path().join(name);
        let end = ["--every-frame".as_ref(), "--out".as_ref(), out.as_path()];
        let arguments = ["replay".as_ref(), path].into_iter().chain(end);
        tog(&scratch, arguments).expect(0, &["the site is the one that is attached"]);
        same_arrays(&original, &out);
    }
    let classes: BTreeSet<u8> =
        Npy::read(&original.join("classes.npy")).bytes.into_iter().collect();
    assert!(classes.len() > 3, "nothing was compared: only classes {classes:?}");
}

#[test]
fn a_made_recording_recorded_again_gives_the_same_classes() {
    let scratch = scratch();
    let recording = scratch.path().join("room.mcap");
    let site = made::room(&recording, 20);
    let facts = file_facts(&recording).unwrap();
    let topics: Vec<(String, String)> = (facts.topics.iter())
        .map(|topic| (topic.name.clone(), format!("/laser_{}/scan", &topic.name[1..])))
        .collect();
    let topics: Vec<_> = topics.iter().map(|(a, b)| (a.as_str(), b.as_str())).collect();
    round_trip(&recording, &site, &topics);
}

#[test]
fn a_real_recording_recorded_again_gives_the_same_classes() {
    let Some(recording) = shared("tysik_two_laser/scans_demo.bag") else { return };
    let topics =
        [("/front_scan", "/laser_front_scan/scan"), ("/rear_scan", "/laser_rear_scan/scan")];
    round_trip(&recording, &same_numbers::two_lasers(&recording), &topics);
}

/// Two lasers in one corner; the right one is silent from second 22 to second 27, which is an
/// event: a site is 20 seconds old before a silence is one.
fn with_a_silence(path: &Path) -> String {
    let scans = (0..320).flat_map(|number| {
        let silent = (220..270).contains(&number);
        let left = Some((0, made::corner(number)));
        let right = LaserScan {
            stamp_ns: made::corner(number).stamp_ns + 1000,
            ..made::corner(number + 7)
        };
        left.into_iter().chain((!silent).then_some((1, right)))
    });
    made::write(path, &["/left", "/right"], scans);
    let area = format!(
        "{}\n[[area.zone]]\nname = \"corner\"\npolygon_m = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]\n",
        made::CORNER_AREA
    );
    let lasers = [("left", "/left", [0.25, 0.5, 0.0]), ("right", "/right", [0.0, 0.0, 10.0])];
    made::site(path, &area, &lasers)
}

#[test]
fn every_channel_is_decoded_by_others_and_holds_the_right_numbers() {
    if !has_python() {
        return;
    }
    let scratch = scratch();
    let recording = scratch.path().join("made.mcap");
    let site = with_a_silence(&recording);
    let site_path = scratch.path().join("site.toml");
    std::fs::write(&site_path, &site).unwrap();
    let out = replay(&scratch, &recording, &site_path, "original");
    let bag = record(&scratch, &site);
    let scan = |id: &str| {
        let (topic, frame) = (format!("/{id}"), format!("laser_{id}"));
        serde_json::json!({ "recording": recording, "topic": topic, "frame": frame })
    };
    let expected = serde_json::json!({
        "scans": { "/laser_left/scan": scan("left"), "/laser_right/scan": scan("right") },
        "replay": out,
        "area": {
            "prefix": "/area_hall", "origin_m": [-0.5, -5.0], "cell_m": 0.1,
            "columns": 60, "rows": 100, "period_ns": 100_000_000,
            "classes": ["empty", "passing", "lingering", "vacated", "background", "transit"],
        },
        "lasers": { "laser_left": [0.25, 0.5, 0.0], "laser_right": [0.0, 0.0, 10.0] },
        "zones": ["corner"],
    });
    let expected_path = scratch.path().join("expected.json");
    std::fs::write(&expected_path, expected.to_string()).unwrap();
    let mut command = script();
    command.arg("decode").arg(bag.path()).arg(&expected_path);
    let verdict = watched(command);
    println!("{}", verdict.out);
    verdict.expect(0, &["verdict: every channel is what it should be"]);
}

#[test]
fn a_recording_of_others_is_replayed() {
    if !has_python() {
        return;
    }
    let scratch = scratch();
    let bag = scratch.path().join("theirs");
    let mut command = script();
    command.arg("make").arg(&bag);
    watched(command).expect(0, &["made"]);
    let path = bag.join("theirs.mcap");
    let scans: Result<Vec<_>, RecordingError> = Recording::open(&path).unwrap().scans().collect();
    let scans = scans.unwrap();
    assert_eq!(scans.len(), 100);
    for (number, found) in scans.iter().enumerate() {
        let expected: Vec<f32> = (0..91)
            .map(|beam| match beam {
                7 => f32::INFINITY,
                _ => (1.0 + f64::from(beam) / 128.0 + number as f64 / 1024.0) as f32,
            })
            .collect();
        assert_eq!(found.scan.ranges_m, expected);
        assert_eq!(found.scan.stamp_ns, made::NEW_YEAR_NS + number as u64 * 100_000_000);
        assert_eq!(found.scan.geometry.angle_increment_rad, 0.017578125);
    }
    let out = scratch.path().join("out");
    tog(&scratch, [Path::new("replay"), &path, Path::new("--out"), &out])
        .expect(0, &["/scan: 100 scans of 91 beams", "100 scans (0 dropped)"]);
}

#[test]
fn scans_every_three_seconds_make_a_map_and_a_map_of_nothing_says_why() {
    let scratch = scratch();
    let (path, out) = (scratch.path().join("slow.mcap"), scratch.path().join("out"));
    // Slow, and with a pause of an hour in the middle.
    let slow = |number: u64| {
        let mut scan = made::corner(0);
        let pause_ns = if number < 60 { 0 } else { 3600 * 1_000_000_000 };
        scan.stamp_ns = made::NEW_YEAR_NS + number * 3_000_000_000 + pause_ns;
        (0, scan)
    };
    made::write(&path, &["/scan"], (0..120).map(slow));
    let replay = |rest: &[&str]| {
        let arguments = [Path::new("replay"), &path];
        tog(&scratch, arguments.into_iter().chain(rest.iter().map(Path::new)))
    };
    let words = ["a frame every 3000 ms", "not older than 7500 ms (scan_age_max_ms)"];
    let said = replay(&["--out", "out"]).expect(0, &words).err.clone();
    assert!(!said.contains("no cell was ever classified"), "{said}");
    replay(&["--out", "out"]).expect(1, &["a map is there already", "--force"]);
    replay(&["--out", "out", "--force", "--preset", "paper"]).expect(0, &[]);
    assert!(!out.join("transit.png").exists(), "of the run before");

    let laid = std::fs::read_to_string(out.join("site.toml")).unwrap();
    let fast: String =
        laid.lines().filter(|line| !line.contains("_ms = ")).flat_map(|l| [l, "\n"]).collect();
    std::fs::write(scratch.path().join("fast.toml"), fast).unwrap();
    let words = ["no cell was ever classified: a scan comes every", "Set scan_age_max_ms = "];
    replay(&["--site", "fast.toml", "--out", "nothing"]).expect(0, &words);
}

#[test]
fn what_is_recovered_is_said_in_words_and_in_json() {
    let scratch = scratch();
    let (whole, cut) = (scratch.path().join("whole.mcap"), scratch.path().join("x.mcap.active"));
    made::write(&whole, &["/scan"], (0..200).map(|number| (0, made::corner(number))));
    let bytes = std::fs::read(&whole).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let recover = |arguments: &[&str]| tog(&scratch, [&["bag", "recover"], arguments].concat());
    recover(&["whole.mcap"]).expect(0, &["is complete (200 messages", "nothing to recover"]);
    recover(&["x.mcap.active"])
        .expect(0, &["saved", "messages of 1 topics until 2026-01-01T00:00"]);
    let saved = Recording::open(scratch.path().join("x.mcap")).unwrap().scans();
    let saved: Vec<_> = saved.map(|found| found.unwrap().scan).collect();
    assert!(!saved.is_empty() && saved.len() < 200);
    assert!(saved.iter().zip(0..).all(|(scan, number)| *scan == made::corner(number)));
    recover(&["x.mcap.active"]).expect(1, &["x.mcap exists", "--out"]);
    let said = recover(&["x.mcap.active", "--out", "y.mcap", "--format", "json"]);
    let report: serde_json::Value = serde_json::from_str(&said.expect(0, &[]).out).unwrap();
    assert_eq!(report[0]["messages"], saved.len());
    assert_eq!(report[0]["topics"]["/scan"], saved.len());
    recover(&["a", "b", "--out", "c"]).expect(2, &["one file"]);
    std::fs::write(scratch.path().join("text"), "hello").unwrap();
    recover(&["text"]).expect(1, &["expected an MCAP file"]);
}
