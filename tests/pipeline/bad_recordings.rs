//! Recordings that are no good: words and an exit code, or a drop that is counted and told; what is good
//! in them gives the same numbers as without the bad.

use super::made::{BEAMS, CORNER_AREA, NEW_YEAR_NS, corner, empty_bag, site, write};
use super::support::{Ended, Npy, scratch, shared, tog};
use protocol::scan::LaserScan;
use protocol::time::SECOND_NS;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const YEAR_NS: u64 = 365 * 24 * 3600 * SECOND_NS;
/// Scans of a recording here: 20 s.
const SCANS: u64 = 200;

/// A place to replay things.
struct Bench {
    scratch: TempDir,
}

impl Bench {
    fn new() -> Self {
        Self { scratch: scratch() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.scratch.path().join(name)
    }

    /// A file of these bytes.
    fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        std::fs::write(self.path(name), bytes).unwrap();
        self.path(name)
    }

    /// A recording of `/scan` with these scans.
    fn recording(&self, name: &str, scans: impl IntoIterator<Item = LaserScan>) -> PathBuf {
        let path = self.path(name);
        write(&path, &["/scan"], scans.into_iter().map(|scan| (0, scan)));
        path
    }

    /// Replays without a site file into `out`, also if results are there.
    fn replay(&self, recording: &Path) -> Ended {
        let out = self.path("out");
        let arguments = [Path::new("replay"), recording, Path::new("--out"), &out];
        tog(&self.scratch, arguments.into_iter().chain([Path::new("--force")]))
    }

    /// Replays with the site file of one laser; every frame; into a directory of this name,
    /// also if results are there.
    fn replay_corner(&self, recording: &Path, out: &str) -> (Ended, PathBuf) {
        let text = site(recording, CORNER_AREA, &[("scan", "/scan", [0.0; 3])]);
        let (site, out) = (self.file("site.toml", text.as_bytes()), self.path(out));
        let arguments = [Path::new("replay"), recording, Path::new("--site"), &site];
        let rest = [Path::new("--every-frame"), Path::new("--force"), Path::new("--out"), &out];
        (tog(&self.scratch, arguments.into_iter().chain(rest)), out)
    }

    /// Asserts that a recording gives the numbers of `good` scans, exactly.
    #[track_caller]
    fn expect_numbers_of(&self, out: &Path, good: impl IntoIterator<Item = LaserScan>) {
        let good = self.recording("good.mcap", good);
        let (ended, expected) = self.replay_corner(&good, "good");
        ended.expect(0, &["(0 dropped)"]);
        for name in ["frames.npy", "classes.npy", "collapsed_counts.npy", "occupancy_last.npy"] {
            let [found, expected] = [out, &expected].map(|out| Npy::read(&out.join(name)));
            assert_eq!(found.shape, expected.shape, "{name}");
            assert!(found.bytes == expected.bytes, "{name} differs from that of the good scans");
        }
        let classes = Npy::read(&expected.join("classes.npy")).bytes;
        assert!([0, 1, 4].iter().all(|class| classes.contains(class)), "nothing to compare");
    }
}

fn corner_scans() -> impl Iterator<Item = LaserScan> {
    (0..SCANS).map(corner)
}

#[test]
fn what_is_no_recording_is_refused_in_words() {
    let bench = Bench::new();
    let wanted = "expected MCAP, a ROS 1 bag";
    let noise: Vec<u8> =
        (0..5000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    bench.replay(bench.scratch.path()).expect(1, &["is a directory", "name the recording in it"]);
    bench.replay(&bench.path("absent.bag")).expect(1, &["absent.bag: cannot open", "No such file"]);
    bench.replay(Path::new("/dev/null")).expect(1, &["found a device or a pipe, expected a file"]);
    bench.replay(&bench.file("noise.bag", &noise)).expect(1, &["begins with", wanted]);
    bench.replay(&bench.file("zero.bag", b"")).expect(1, &["is an empty file", wanted]);
    bench.replay(&bench.file("text.mcap", b"# notes\n")).expect(1, &["begins with", wanted]);
    assert!(!bench.path("out").exists(), "nothing is written for what cannot be read");
}

#[test]
fn a_recording_without_scans_is_refused_in_words() {
    let bench = Bench::new();
    let empty = bench.file("empty.bag", &empty_bag());
    bench.replay(&empty).expect(1, &["holds no laser scans: it is empty"]);
    let silent = bench.recording("silent.mcap", []);
    bench.replay(&silent).expect(1, &["silent.mcap: holds no laser scans"]);
    if let Some(empty) = shared("sick_cola/empty_ros1.bag") {
        bench.replay(&empty).expect(1, &["holds no laser scans: it is empty"]);
    }
    assert!(!bench.path("out").exists(), "nothing is written for what holds nothing");
}

/// What is before the cut gives the numbers of exactly those scans.
#[test]
fn a_cut_recording_gives_what_came_before_and_exit_code_1() {
    let bench = Bench::new();
    let whole = std::fs::read(bench.recording("whole.mcap", corner_scans())).unwrap();
    for percent in [30, 60, 95] {
        let cut = bench.file("cut.mcap", &whole[..whole.len() * percent / 100]);
        let (ended, out) = bench.replay_corner(&cut, "cut");
        ended
            .expect(1, &["cut.mcap: the recording is", "what came before is replayed and written"]);
        let counted = ended.err.split(" scans: ").next().unwrap().rsplit(' ').next().unwrap();
        let scans: u64 = counted.parse().unwrap();
        assert!(scans >= SCANS * percent as u64 / 200, "{scans} scans of {percent} %");
        if scans >= 140 {
            bench.expect_numbers_of(&out, (0..scans).map(corner));
        }
    }
    let head = bench.file("head.mcap", &whole[..40]);
    bench.replay(&head).expect(1, &["head.mcap: the recording is cut at byte", "after 0 scans"]);
}

#[test]
fn a_cut_bag_gives_what_came_before_and_exit_code_1() {
    let file = "leigh_leg_tracker/demo_stationary_simple_environment.bag";
    let Some(bag) = shared(file) else { return };
    let bench = Bench::new();
    let whole = std::fs::read(bag).unwrap();
    for (bytes, scans) in [(100_000, 43), (796_100, 365), (1_000_000, 459)] {
        let cut = bench.file("cut.bag", &whole[..bytes]);
        let words = format!("cut.bag: the recording is cut at byte {bytes}, after {scans} scans");
        bench.replay(&cut).expect(1, &[&words, "what came before is replayed and written"]);
        assert!(bench.path("out/collapsed_counts.npy").exists());
        assert!(bench.path("out/overview.png").exists());
        std::fs::remove_dir_all(bench.path("out")).unwrap();
    }
    let cuts = [
        (5, "expected MCAP, a ROS 1 bag"),
        (14, "is cut at byte 13, after 0 scans"),
        (100, "is cut at byte 13, after 0 scans"),
        (5000, "is cut at byte 5000, after 0 scans"),
    ];
    for (bytes, words) in cuts {
        let cut = bench.file("cut.bag", &whole[..bytes]);
        bench.replay(&cut).expect(1, &["cut.bag: ", words]);
        assert!(!bench.path("out").exists(), "nothing is written for what holds nothing");
    }
}

/// Damage is told, or it lies where nothing is read (an index) and changes no number.
#[test]
fn bytes_that_are_changed_are_told_or_change_nothing() {
    let bench = Bench::new();
    let whole = std::fs::read(bench.recording("whole.mcap", corner_scans())).unwrap();
    let mut told = 0;
    for part in 1..10 {
        let mut bytes = whole.clone();
        let at = bytes.len() * part / 10;
        bytes[at..at + 16].fill(0xff);
        let damaged = bench.file("damaged.mcap", &bytes);
        let (ended, out) = bench.replay_corner(&damaged, "damaged");
        if ended.code == 0 {
            bench.expect_numbers_of(&out, corner_scans());
        } else {
            ended.expect(1, &["damaged.mcap: the recording is", "everything before", " was read"]);
            told += 1;
        }
    }
    assert!(told >= 5, "most of a recording is scans, but only {told} of 9 damages were told");
}

#[test]
fn nan_everywhere_is_an_unknown_map_and_no_area_can_be_laid_round_it() {
    let bench = Bench::new();
    let blind = |number| LaserScan { ranges_m: vec![f32::NAN; BEAMS], ..corner(number) };
    let recording = bench.recording("nan.mcap", (0..SCANS).map(blind));
    bench.replay(&recording).expect(1, &["topic /scan: no reading of the recording is an echo"]);
    let (ended, out) = bench.replay_corner(&recording, "nan");
    ended.expect(0, &["100.0 % invalid", "200 scans (0 dropped)"]);
    assert!(Npy::read(&out.join("classes.npy")).bytes.iter().all(|class| *class == 255));
    assert!(Npy::read(&out.join("collapsed_counts.npy")).u64s().iter().all(|count| *count == 0));
}

#[test]
fn other_beams_in_mid_stream_are_dropped_and_told() {
    let bench = Bench::new();
    let scans = (0..SCANS).map(|number| {
        let mut scan = corner(number);
        if (50..60).contains(&number) {
            scan.ranges_m.truncate(91);
        }
        scan
    });
    let recording = bench.recording("beams.mcap", scans);
    let (ended, out) = bench.replay_corner(&recording, "beams");
    let told = "scan 51 of /scan has 91 beams";
    ended.expect(0, &[told, "dropped until the geometry is back", "190 scans (10 dropped)"]);
    bench.expect_numbers_of(
        &out,
        corner_scans()
            .enumerate()
            .filter_map(|(number, scan)| (!(50..60).contains(&number)).then_some(scan)),
    );
}

#[test]
fn a_recording_whose_first_scan_is_the_odd_one_does_not_pass_for_replayed() {
    let bench = Bench::new();
    let odd_beams = corner_scans().enumerate().map(|(number, mut scan)| {
        scan.ranges_m.truncate(if number == 0 { 91 } else { BEAMS });
        scan
    });
    let recording = bench.recording("odd_beams.mcap", odd_beams);
    let (ended, _) = bench.replay_corner(&recording, "odd_beams");
    ended.expect(1, &["only 1 of 200 scans were used", "199 have other beams than the first"]);
    let odd_stamp = corner_scans().enumerate().map(|(number, mut scan)| {
        scan.stamp_ns += if number == 0 { 3600 * SECOND_NS } else { 0 };
        scan
    });
    let recording = bench.recording("odd_stamp.mcap", odd_stamp);
    let (ended, _) = bench.replay_corner(&recording, "odd_stamp");
    ended.expect(1, &["only 1 of 200 scans were used", "199 came out of order"]);
}

#[test]
fn stamps_that_jump_back_a_year_are_dropped_and_told() {
    let bench = Bench::new();
    let scans = (0..SCANS).map(|number| {
        let mut scan = corner(number);
        if (50..60).contains(&number) {
            scan.stamp_ns -= YEAR_NS;
        }
        scan
    });
    let recording = bench.recording("back.mcap", scans);
    let (ended, out) = bench.replay_corner(&recording, "back");
    let told = "scan 51 of /scan is stamped";
    ended.expect(0, &[told, "dropped until time goes on", "190 scans (10 dropped)"]);
    bench.expect_numbers_of(
        &out,
        corner_scans()
            .enumerate()
            .filter_map(|(number, scan)| (!(50..60).contains(&number)).then_some(scan)),
    );
    bench.replay(&recording).expect(0, &["190 scans (10 dropped)"]);
}

#[test]
fn a_stamp_that_jumps_ahead_a_year_is_refused_in_words() {
    let bench = Bench::new();
    let scans = (0..SCANS).map(|number| {
        let mut scan = corner(number);
        if number >= 50 {
            scan.stamp_ns += YEAR_NS;
        }
        scan
    });
    let recording = bench.recording("ahead.mcap", scans);
    let words =
        ["ahead.mcap: scan 51 is stamped", "expected at most 24 h", "cut the recording there"];
    bench.replay_corner(&recording, "ahead").0.expect(1, &words);
    bench.replay(&recording).expect(1, &words);
}

/// Else the frames of a year would be counted through.
#[test]
fn lasers_of_one_area_that_are_a_year_apart_are_refused_in_words() {
    let bench = Bench::new();
    let recording = bench.path("apart.mcap");
    let later = |scan: LaserScan| LaserScan { stamp_ns: scan.stamp_ns + YEAR_NS, ..scan };
    let scans = corner_scans().flat_map(|scan| [(0, scan.clone()), (1, later(scan))]);
    write(&recording, &["/a", "/b"], scans);
    let lasers = [("a", "/a", [0.0; 3]), ("b", "/b", [1.0, 0.0, 0.0])];
    let text = site(&recording, CORNER_AREA, &lasers);
    let (site, out) = (bench.file("site.toml", text.as_bytes()), bench.path("out"));
    let words = ["area hall: laser b begins 8760 h after laser a, expected at most 24 h"];
    let replay = [Path::new("replay"), &recording, Path::new("--site"), &site];
    let replay = replay.into_iter().chain([Path::new("--out"), &out]);
    tog(&bench.scratch, replay).expect(1, &words);
    let run = [Path::new("run"), &site, Path::new("--out"), &out];
    tog(&bench.scratch, run).expect(78, &words);
}

#[test]
fn separate_processes_drop_and_tell_as_one_process_does() {
    let bench = Bench::new();
    let scans = (0..SCANS).map(|number| {
        let mut scan = corner(number);
        match number {
            50..60 => scan.stamp_ns -= YEAR_NS,
            80..85 => scan.ranges_m.truncate(91),
            _ => {}
        }
        scan
    });
    let recording = bench.recording("odd.mcap", scans);
    let (ended, one) = bench.replay_corner(&recording, "one");
    ended.expect(0, &["185 scans (15 dropped)"]);
    let (site, many) = (bench.path("site.toml"), bench.path("many"));
    let run = [Path::new("run"), &site, Path::new("--out"), &many];
    let told = ["dropped until time goes on", "dropped until the geometry is back", "scan has"];
    tog(&bench.scratch, run).expect(0, &told[..2]);
    for name in ["frames.npy", "classes.npy", "collapsed_counts.npy", "occupancy_last.npy"] {
        let [one, many] = [&one, &many].map(|out| std::fs::read(out.join(name)).unwrap());
        assert!(one == many, "{name} differs");
    }
}

#[test]
fn results_that_cannot_be_written_are_told_with_the_path() {
    let bench = Bench::new();
    let recording = bench.recording("corner.mcap", corner_scans());
    let in_the_way = bench.file("file", b"");
    for out in [in_the_way.join("x"), in_the_way.clone(), PathBuf::from("/proc/nothing")] {
        let path = out.display().to_string();
        let replay = [Path::new("replay"), &recording, Path::new("--out"), &out];
        tog(&bench.scratch, replay).expect(1, &["cannot write the results to", &path]);
        let text = site(&recording, CORNER_AREA, &[("scan", "/scan", [0.0; 3])]);
        let site = bench.file("site.toml", text.as_bytes());
        let run = [Path::new("run"), &site, Path::new("--out"), &out];
        tog(&bench.scratch, run).expect(1, &["cannot write the results to", &path]);
    }
}

#[test]
fn the_end_of_time_is_no_place_to_fall_off() {
    let bench = Bench::new();
    let scans = [0, 1, 2].map(|number| {
        let after_ns = number * SECOND_NS / 10;
        LaserScan { stamp_ns: (u64::from(u32::MAX) >> 1) * SECOND_NS + after_ns, ..corner(0) }
    });
    assert!(scans[0].stamp_ns > NEW_YEAR_NS);
    let recording = bench.recording("late.mcap", scans);
    bench.replay_corner(&recording, "late").0.expect(0, &["3 scans (0 dropped)"]);
    let first = [0, 1, 2].map(|n| LaserScan { stamp_ns: n * SECOND_NS / 10, ..corner(0) });
    let recording = bench.recording("early.mcap", first);
    // A stamp of 0 is none: it is taken from the recorder, and the two others lie decades before it.
    bench.replay_corner(&recording, "early").0.expect(1, &["only 1 of 3 scans were used"]);
}
