//! What a laser hands out: rising stamps, one geometry, everything else counted and told.
#![allow(clippy::unwrap_used)]

use laser::replay::ReplaySource;
use laser::simulator::SimulatorSource;
use laser::site::{find_laser, load_scene, open_source, replay_begin_ns, simulated_laser};
use laser::source::{Source, SourceError};
use protocol::scan::{LaserScan, ScanGeometry};
use protocol::site::Site;
use protocol::time::SECOND_NS;
use recording::{Recording, ScanTopic, ScanWriter};
use scene::{LaserSpec, Scene};
use std::path::{Path, PathBuf};

const HOUR_NS: u64 = 3600 * SECOND_NS;
/// Some time in 2023.
const T_NS: u64 = 1_700_000_000 * SECOND_NS;

fn scan(stamp_ns: u64, beams: usize) -> LaserScan {
    let geometry = ScanGeometry {
        angle_min_rad: -1.0,
        angle_increment_rad: 0.5,
        range_min_m: 0.0,
        range_max_m: 8.0,
    };
    // Ranges that do not pack, so that a recording is longer than its index.
    let mut bits = stamp_ns;
    let mut range_m = |_| {
        bits = bits.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (bits >> 40) as f32 * 1e-6
    };
    let ranges_m = (0..beams).map(&mut range_m).collect();
    LaserScan { stamp_ns, device_stamp_ns: 0, geometry, ranges_m }
}

/// Writes scans (topic, stamp, beams) to a recording.
fn recorded(directory: &Path, scans: &[(&str, u64, usize)]) -> PathBuf {
    let path = directory.join("recording.mcap");
    let mut writer = ScanWriter::create(&path).unwrap();
    let mut topics: Vec<&str> = Vec::new();
    for (topic, stamp_ns, beams) in scans {
        let index = topics.iter().position(|known| known == topic).unwrap_or_else(|| {
            topics.push(topic);
            let (topic, frame_id) = ((*topic).to_owned(), "laser".to_owned());
            writer.add_topic(ScanTopic { topic, frame_id, scan_time_s: 0.0 }).unwrap()
        });
        writer.write(index, *stamp_ns, &scan(*stamp_ns, *beams).view()).unwrap();
    }
    writer.finish().unwrap();
    path
}

fn stamps(source: &mut ReplaySource) -> Result<Vec<u64>, SourceError> {
    let (mut scan, mut stamps) = (LaserScan::default(), Vec::new());
    while source.next(&mut scan)? {
        stamps.push(scan.stamp_ns);
    }
    Ok(stamps)
}

#[test]
fn a_replay_drops_what_does_not_fit_counts_it_and_tells_it_once() {
    let directory = tempfile::tempdir().unwrap();
    let year_ns = 365 * 24 * HOUR_NS;
    let path = recorded(
        directory.path(),
        &[
            ("/a", T_NS, 3),
            ("/a", T_NS, 3),
            ("/a", T_NS + 1 - year_ns, 3),
            ("/a", T_NS + 2 - year_ns, 3),
            ("/a", T_NS + 5, 3),
            ("/a", T_NS + 6, 4),
            ("/a", T_NS + 7, 4),
            ("/a", T_NS + 8, 3),
        ],
    );
    let mut source = ReplaySource::open(&path, None).unwrap();
    assert_eq!(stamps(&mut source).unwrap(), [T_NS, T_NS + 5, T_NS + 8]);
    let counts = source.counts();
    assert_eq!((counts.scans, counts.dropped_out_of_order, counts.dropped_geometry), (3, 3, 2));
    let oddities = source.take_oddities();
    let codes: Vec<&str> = oddities.iter().map(|oddity| oddity.code).collect();
    assert_eq!(codes, ["scans_out_of_order", "geometry_changed"]);
    assert!(oddities[1].text.contains("scan 6 of /a has 4 beams"), "{}", oddities[1].text);
    assert!(source.take_oddities().is_empty(), "told once");
}

#[test]
fn a_clock_that_stepped_by_days_is_refused_in_words() {
    let directory = tempfile::tempdir().unwrap();
    let path = recorded(directory.path(), &[("/a", T_NS, 3), ("/a", T_NS + 49 * HOUR_NS, 3)]);
    let mut source = ReplaySource::open(&path, None).unwrap();
    let error = stamps(&mut source).unwrap_err();
    assert!(!error.is_early_end());
    let text = error.to_string();
    assert!(text.contains("scan 2 is stamped") && text.contains("49 h after"), "{text}");
    assert!(!source.next(&mut LaserScan::default()).unwrap(), "nothing follows");
}

#[test]
fn a_cut_recording_is_replayed_to_the_cut_which_is_then_told() {
    let directory = tempfile::tempdir().unwrap();
    let scans: Vec<_> = (0..40).map(|i| ("/a", T_NS + i * SECOND_NS / 10, 181)).collect();
    let path = recorded(directory.path(), &scans);
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let mut source = ReplaySource::open(&path, None).unwrap();
    let mut scan = LaserScan::default();
    let error = loop {
        match source.next(&mut scan) {
            Ok(true) => {}
            Ok(false) => panic!("the cut must be told"),
            Err(error) => break error,
        }
    };
    assert!(error.is_early_end(), "{error}");
    let delivered = source.counts().scans;
    assert!(error.to_string().contains(&format!("after {delivered} scans")), "{error}");
    assert!((1..40).contains(&delivered), "{delivered}");
}

#[test]
fn a_laser_that_comes_back_goes_on_where_the_clock_is() {
    let directory = tempfile::tempdir().unwrap();
    let path =
        recorded(directory.path(), &[("/a", T_NS, 3), ("/a", T_NS + 1, 3), ("/a", T_NS + 2, 3)]);
    let mut source = ReplaySource::open(&path, None).unwrap().beginning_at(T_NS + 1);
    assert_eq!(stamps(&mut source).unwrap(), [T_NS + 1, T_NS + 2]);
    assert_eq!((source.counts().scans, source.counts().passed_over), (2, 1));
}

fn site(lasers: &str) -> Site {
    let area = "name = \"s\"\n[[area]]\nid = \"a\"\norigin_m = [0, 0]\ncolumns = 10\nrows = 10\n";
    toml::from_str(&format!("{area}{lasers}")).unwrap()
}

#[test]
fn the_lasers_of_a_recording_begin_together_at_the_lowest_first_stamp() {
    let directory = tempfile::tempdir().unwrap();
    recorded(directory.path(), &[("/b", T_NS + 9, 3), ("/a", T_NS + 4, 3), ("/b", T_NS + 19, 3)]);
    let laser = |id: &str, topic: &str| {
        format!(
            "[[laser]]\nid = \"{id}\"\narea = \"a\"\nx_m = 0\ny_m = 0\n\
             source = {{ kind = \"replay\", recording = \"recording.mcap\"{topic} }}\n"
        )
    };
    let both = site(&(laser("one", ", topic = \"/b\"") + &laser("two", ", topic = \"/a\"")));
    assert_eq!(replay_begin_ns(&both, directory.path()).unwrap(), Some(T_NS + 4));
    let unnamed = site(&laser("one", ""));
    let error = replay_begin_ns(&unnamed, directory.path()).unwrap_err().to_string();
    assert!(error.contains("/b, /a"), "{error}");
    let (index, two) = find_laser(&both, "two").unwrap();
    assert_eq!(index, 1);
    let mut source = open_source(two, directory.path(), 0).unwrap();
    let mut scan = LaserScan::default();
    assert!(source.next(&mut scan).unwrap());
    assert_eq!(scan.stamp_ns, T_NS + 4);
    let error = find_laser(&both, "three").unwrap_err().to_string();
    assert!(error.contains("`three`") && error.contains("one, two"), "{error}");
}

fn simulator(rate_hz: f64, begin_ns: u64) -> SimulatorSource {
    let scene = Scene::builtin("foyer").unwrap();
    let laser = scene.lasers[0].clone();
    SimulatorSource::new(scene, laser, 7, rate_hz, begin_ns).unwrap()
}

/// Stamp and bits of the ranges (a fault is NaN, which equals nothing).
fn next(source: &mut SimulatorSource) -> (u64, Vec<u32>) {
    let mut scan = LaserScan::default();
    source.next(&mut scan);
    (scan.stamp_ns, scan.ranges_m.iter().map(|range_m| range_m.to_bits()).collect())
}

#[test]
fn seventy_five_scans_a_second_do_not_drift() {
    let mut source = simulator(75.0, T_NS);
    let stamps: Vec<u64> = (0..=225).map(|_| next(&mut source).0).collect();
    for (second, stamp_ns) in stamps.iter().step_by(75).enumerate() {
        assert_eq!(*stamp_ns, T_NS + second as u64 * SECOND_NS, "to the nanosecond");
    }
    assert!(stamps.windows(2).all(|pair| (13_333_333..=13_333_334).contains(&(pair[1] - pair[0]))));
}

#[test]
fn a_simulated_laser_that_comes_back_makes_the_scans_that_it_would_have_made() {
    let mut whole = simulator(10.0, T_NS);
    let scans: Vec<_> = (0..50).map(|_| next(&mut whole)).collect();
    let mut restarted = simulator(10.0, T_NS + 2 * SECOND_NS + 1);
    assert_eq!(next(&mut restarted), scans[21]);
    assert_eq!(restarted.skip_to(T_NS + 4 * SECOND_NS), 18);
    assert_eq!(next(&mut restarted), scans[40]);
    assert_eq!(restarted.skip_to(T_NS), 0, "never back");
}

#[test]
fn a_recording_of_a_simulated_laser_replays_to_the_same_bits() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("simulated.mcap");
    let mut source = simulator(10.0, T_NS);
    let mut writer = ScanWriter::create(&path).unwrap();
    let (topic, frame_id) = ("/scan".to_owned(), "laser".to_owned());
    writer.add_topic(ScanTopic { topic, frame_id, scan_time_s: 0.1 }).unwrap();
    let scans: Vec<LaserScan> = (0..30)
        .map(|_| {
            let mut scan = LaserScan::default();
            source.next(&mut scan);
            writer.write(0, scan.stamp_ns, &scan.view()).unwrap();
            scan
        })
        .collect();
    writer.finish().unwrap();
    let mut replay = ReplaySource::open(&path, None).unwrap();
    for expected in scans {
        let mut found = LaserScan::default();
        assert!(replay.next(&mut found).unwrap());
        assert_eq!((found.stamp_ns, found.geometry), (expected.stamp_ns, expected.geometry));
        let bits = |scan: &LaserScan| scan.ranges_m.iter().map(|r| r.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&found), bits(&expected));
    }
}

#[test]
fn a_simulated_laser_stands_where_the_scene_says_or_where_the_site_says() {
    let laser = |id: &str| {
        site(&format!(
            "[[laser]]\nid = \"{id}\"\narea = \"a\"\nx_m = 1.5\ny_m = 2.5\nyaw_deg = 30\n\
             source = {{ kind = \"simulator\", scene = \"foyer\" }}\n"
        ))
    };
    let scene = load_scene("foyer", Path::new("/nowhere")).unwrap();
    let known = scene.lasers[0].id.clone();
    assert_eq!(simulated_laser(&scene, &laser(&known).lasers[0]), scene.lasers[0]);
    let stranger = simulated_laser(&scene, &laser("stranger").lasers[0]);
    assert_eq!(stranger, LaserSpec::lms200("stranger", 1.5, 2.5, 30.0));
    let source = open_source(&laser("stranger").lasers[0], Path::new("/nowhere"), T_NS).unwrap();
    assert!(matches!(source, Source::Simulator(_)));
    let error = load_scene("foier", Path::new("/nowhere")).unwrap_err().to_string();
    assert!(error.contains("foyer"), "{error}");
    let error = load_scene("foier.toml", Path::new("/nowhere")).unwrap_err().to_string();
    assert!(error.contains("/nowhere/foier.toml"), "{error}");
}

#[test]
fn every_real_bag_replays() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/recordings");
    if !root.exists() {
        println!("skipped: {} is not there", root.display());
        return;
    }
    // Stamps of real logs jitter; what is dropped was counted in the files by an independent reader.
    for (name, topic, scans) in [
        ("datmo/82c2bc_two_robots.bag", None, 388),
        ("leigh_leg_tracker/demo_stationary_simple_environment.bag", None, 1265),
        ("leigh_leg_tracker/negative_2_first_30s.bag", Some("/rear_scan"), 226),
        ("leigh_leg_tracker/positive_1.bag", Some("right_scan"), 400),
        ("scan_tools/laser_scan_matcher_demo.bag", None, 360),
        ("tysik_two_laser/scans_demo.bag", Some("/front_scan"), 331),
    ] {
        let path = root.join(name);
        let mut source = ReplaySource::open(&path, topic).unwrap();
        let passed = stamps(&mut source).unwrap();
        let counts = source.counts();
        assert!(passed.is_sorted_by(|a, b| a < b), "{name}");
        let dropped = counts.dropped_out_of_order + counts.dropped_geometry;
        assert_eq!(counts.scans + dropped, scans, "{name}");
        assert_eq!(dropped, 0, "{name}: {:?}", source.take_oddities());
        assert_eq!(Recording::open(&path).unwrap().scans_of(source.topic()).count() as u64, scans);
    }
}
