//! `tog bag`: what is told of a recording, what is copied, what is refused and how.

use super::made::{corner, write};
use super::support::{files, scratch, tog};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

struct Bench {
    scratch: TempDir,
}

impl Bench {
    /// With `two.mcap`: 30 scans of each of two lasers.
    fn new() -> Self {
        let bench = Self { scratch: scratch() };
        let scans = (0..30).flat_map(|number| [(0, corner(number)), (1, corner(number))]);
        write(&bench.path("two.mcap"), &["/front_scan", "/rear_scan"], scans);
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.scratch.path().join(name)
    }

    fn bag(&self, arguments: &[&str]) -> super::support::Ended {
        tog(&self.scratch, ["bag"].iter().chain(arguments))
    }

    fn json(&self, name: &str) -> serde_json::Value {
        let ended = self.bag(&["info", name, "--format", "json"]);
        serde_json::from_str(&ended.expect(0, &[]).out).unwrap()
    }
}

#[test]
fn a_recording_is_described_for_people_and_for_programs() {
    let bench = Bench::new();
    let words = ["two.mcap: MCAP", "/front_scan", "30 scans, 10.00 Hz", "181 beams", "no gaps"];
    bench.bag(&["info", "two.mcap"]).expect(0, &words);
    let info = bench.json("two.mcap");
    assert_eq!(info["topics"].as_array().unwrap().len(), 2);
    let rear = &info["topics"][1];
    assert_eq!((&rear["topic"], &rear["scans"]), (&"/rear_scan".into(), &30.into()));
    assert!((rear["rate_hz"].as_f64().unwrap() - 10.0).abs() < 1e-6, "{rear}");
    assert!(info["sample"].is_null(), "a small recording is read");
}

#[test]
fn lasers_are_mapped_from_topics() {
    let bench = Bench::new();
    let import = ["import", "two.mcap", "--laser", "front=/front_scan", "--out", "x.mcap"];
    let words = ["/front 30 scans", "/front_scan is /front there"];
    bench.bag(&import).expect(0, &words);
    let info = bench.json("x.mcap");
    assert_eq!(info["topics"].as_array().unwrap().len(), 1, "only what was asked for");
    assert_eq!(info["topics"][0]["topic"], "/front");
    assert_eq!(info["topics"][0]["frame_id"], "laser_front");
    let unknown = ["import", "two.mcap", "--laser", "a=/scan", "--out", "y.mcap"];
    let words = ["laser a: no scans on topic /scan", "/front_scan, /rear_scan"];
    bench.bag(&unknown).expect(1, &words);
    let one = ["--laser", "b=/front_scan", "--laser", "a=/scan", "--out", "y.mcap"];
    bench.bag(&[&["import", "two.mcap"], &one[..]].concat()).expect(1, &words);
    let twice = ["--laser", "a=/front_scan", "--laser", "a=/rear_scan", "--out", "y.mcap"];
    bench.bag(&[&["import", "two.mcap"], &twice[..]].concat()).expect(1, &["a is there twice"]);
    let bad = ["import", "two.mcap", "--laser", "front", "--out", "y.mcap"];
    bench.bag(&bad).expect(2, &["expected NAME=TOPIC", "--help"]);
    let names = ["two.mcap", "x.mcap"].map(PathBuf::from);
    assert_eq!(files(bench.scratch.path()), names, "what was begun is not left");
}

#[test]
fn a_part_is_cut_out_by_time() {
    let bench = Bench::new();
    let part = ["--from-s", "1", "--to-s", "1.45"];
    let export = [&["export", "two.mcap", "--out", "x.csv"], &part[..]].concat();
    bench.bag(&export).expect(0, &["/front_scan 5 scans, /rear_scan 5 scans"]);
    let late = ["export", "two.mcap", "--out", "y.csv", "--from-s", "60"];
    bench.bag(&late).expect(1, &["no scan lies between", "spans 2.900 s"]);
}

#[test]
fn nothing_is_written_over_and_nothing_is_left_of_what_failed() {
    let bench = Bench::new();
    let kept = std::fs::read(bench.path("two.mcap")).unwrap();
    bench.bag(&["convert", "two.mcap", "x.csv"]).expect(0, &[]);
    bench.bag(&["convert", "two.mcap", "x.csv"]).expect(1, &["is there already", "--force"]);
    bench.bag(&["convert", "two.mcap", "x.csv", "--force"]).expect(0, &[]);
    bench.bag(&["convert", "two.mcap", "two.mcap", "--force"]).expect(1, &["written over"]);
    bench.bag(&["convert", "two.mcap", "x.txt"]).expect(1, &["expected .mcap or .csv"]);
    bench.bag(&["convert", "none.bag", "y.csv"]).expect(1, &["none.bag", "No such file"]);
    std::fs::write(bench.path("hello.txt"), "hello\n").unwrap();
    bench.bag(&["import", "hello.txt", "--out", "y.mcap"]).expect(1, &["begins with", "--columns"]);
    assert_eq!(std::fs::read(bench.path("two.mcap")).unwrap(), kept);
    let names = ["hello.txt", "two.mcap", "x.csv"].map(PathBuf::from);
    assert_eq!(files(bench.scratch.path()), names);
}

#[test]
fn a_recording_that_is_cut_is_copied_to_the_cut_and_told() {
    let bench = Bench::new();
    let bytes = std::fs::read(bench.path("two.mcap")).unwrap();
    std::fs::write(bench.path("cut.mcap"), &bytes[..bytes.len() - 100]).unwrap();
    let words = ["is cut at byte", "what came before is written to x.csv"];
    bench.bag(&["convert", "cut.mcap", "x.csv"]).expect(1, &words);
    assert_eq!(bench.json("x.csv")["topics"][0]["scans"], 30);
    bench.bag(&["info", "cut.mcap"]).expect(1, &["30 scans", "is cut at byte"]);
}

#[test]
fn a_csv_of_strangers_is_read_as_it_is_declared() {
    let bench = Bench::new();
    let rows: String = (0..9).map(|n| format!("{n}.5;left;1000;2000;inf\n")).collect();
    std::fs::write(bench.path("x.csv"), format!("time;place;a;b;c\n{rows}")).unwrap();
    bench.bag(&["info", "x.csv"]).expect(1, &["if it is a CSV", "--columns"]);
    let columns = "t,laser,r...:mm,angle_min=-10:deg,angle_increment=10:deg,range_max=8";
    let words = ["left: 9 scans, 1.00 Hz", "3 beams over 20.0 deg", "33.3 % no return"];
    bench.bag(&["info", "x.csv", "--columns", columns]).expect(0, &words);
    bench.bag(&["import", "x.csv", "--columns", columns, "--out", "x.mcap"]).expect(0, &["left 9"]);
    let bad = ["info", "x.csv", "--columns", "t,laser"];
    bench.bag(&bad).expect(2, &["the columns lack r...", "--help"]);
    assert!(Path::new(&bench.path("x.mcap")).exists());
}

#[test]
fn nothing_but_files_is_written_over() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("dir.mcap")).unwrap();
    let mkfifo = std::process::Command::new("mkfifo").arg(bench.path("pipe.mcap")).status();
    assert!(mkfifo.unwrap().success());
    std::os::unix::fs::symlink(bench.path("pipe.mcap"), bench.path("link.mcap")).unwrap();
    for (out, words) in [
        ("dir.mcap", "dir.mcap is a directory"),
        ("pipe.mcap", "pipe.mcap is a pipe"),
        ("link.mcap", "link.mcap is a pipe"),
    ] {
        bench.bag(&["import", "two.mcap", "--out", out, "--force"]).expect(1, &[words]);
        bench.bag(&["convert", "two.mcap", out]).expect(1, &[words]);
        // Before anything is read.
        bench.bag(&["export", "none.mcap", "--out", out, "--force"]).expect(1, &[words]);
    }
    std::fs::write(bench.path("old.mcap"), "old").unwrap();
    std::os::unix::fs::symlink("old.mcap", bench.path("to_old.mcap")).unwrap();
    bench.bag(&["import", "two.mcap", "--out", "to_old.mcap", "--force"]).expect(0, &[]);
    assert!(bench.path("to_old.mcap").is_symlink(), "the link stays");
    assert_eq!(bench.json("old.mcap")["topics"][0]["scans"], 30);
    let other = ["import", "two.mcap", "--out", "x.csv"];
    bench.bag(&other).expect(1, &["import writes MCAP", "tog bag export"]);
    assert!(!bench.path("x.csv").exists());
}

#[test]
fn rows_of_a_csv_that_are_no_scans_are_counted() {
    let bench = Bench::new();
    let columns = "t,r*3,angle_min=0,angle_increment=0.1,range_max=8";
    std::fs::write(bench.path("x.csv"), "-1,1,2,3\n#0,1,2,3\n1700000000,1,2,3\n").unwrap();
    let import = ["import", "x.csv", "--columns", columns, "--out", "x.mcap"];
    bench.bag(&import).expect(0, &["2 messages were refused", "line 1"]);
    std::fs::write(bench.path("y.csv"), "-1,1,2,3\n-2,1,2,3\n").unwrap();
    let ended = bench.bag(&["info", "y.csv", "--columns", columns]);
    ended.expect(1, &["2 messages were refused", "line 1", "no scan that can be used"]);
}

#[test]
fn a_recording_of_which_nothing_is_saved_fails_and_a_damaged_one_is_warned_of() {
    let bench = Bench::new();
    let whole = std::fs::read(bench.path("two.mcap")).unwrap();
    let is_chunk = |at: usize| whole[at] == 6 && whole[at..][..50].windows(4).any(|w| w == b"zstd");
    let chunks: Vec<usize> = (8..whole.len() - 50).filter(|at| is_chunk(*at)).collect();
    assert!(chunks.len() > 2, "{chunks:?}");
    let mut damaged = whole.clone();
    damaged[chunks[0] + 100..][..64].fill(0);
    std::fs::write(bench.path("damaged.mcap"), &damaged).unwrap();
    let words = ["saved", "WARN", "1 damaged parts"];
    bench.bag(&["recover", "damaged.mcap", "--out", "saved.mcap"]).expect(0, &words);
    for chunk in chunks {
        damaged[chunk + 100..][..64].fill(0);
    }
    std::fs::write(bench.path("worse.mcap"), &damaged).unwrap();
    bench.bag(&["recover", "worse.mcap", "--out", "none.mcap"]).expect(1, &["no message", "WARN"]);
}
