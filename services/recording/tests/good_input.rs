//! What is read is what was written, by others and by us.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Fields, MD5, bag_v1, file, mcap, scan_bag, scan_bag_v1, shared};
use proptest::prelude::*;
use protocol::geometry::Pose;
use protocol::scan::{LaserScan, ScanGeometry};
use recording::{
    Format, Recording, RecordingError, RecordingIndex, ScanTopic, ScanWriter, as_recorded,
};

fn index(path: &std::path::Path) -> RecordingIndex {
    RecordingIndex::scan(&Recording::open(path).unwrap(), |_| Some(Pose::default())).unwrap()
}

#[test]
fn a_scan_keeps_its_stamp_its_geometry_and_every_bit_of_its_ranges() {
    let ranges = vec![1.25, f32::INFINITY, f32::NEG_INFINITY, f32::from_bits(0x7fc0_1234), -0.0];
    let fields = Fields { stamp: (1_700_000_001, 999_999_999), ranges, ..Fields::default() };
    let cdr = mcap("sensor_msgs/msg/LaserScan", "cdr", &[fields.cdr_big_endian()]);
    let ros1_in_mcap = mcap("sensor_msgs/LaserScan", "ros1", &[fields.ros1()]);
    let bags = ["none", "bz2", "lz4"].map(|compression| scan_bag(&[fields.ros1()], compression));
    for bytes in [cdr, ros1_in_mcap].iter().chain(&bags) {
        let (_directory, path) = file(bytes);
        let recording = Recording::open(&path).unwrap();
        let mut scans = recording.scans();
        let found = scans.next().unwrap().unwrap();
        assert!(scans.next().is_none());
        assert_eq!(found.log_time_ns, 1_700_000_000_000_000_000);
        assert_eq!(&*found.topic, "/scan");
        assert_eq!(found.scan.stamp_ns, 1_700_000_001_999_999_999);
        let geometry = ScanGeometry {
            angle_min_rad: -1.5,
            angle_increment_rad: 0.25,
            range_min_m: f64::from(0.02_f32),
            range_max_m: 8.0,
        };
        assert_eq!(found.scan.geometry, geometry);
        let bits = |ranges: &[f32]| ranges.iter().map(|r| r.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&found.scan.ranges_m), bits(&fields.ranges));
    }
}

#[test]
fn a_bag_of_version_1_2_is_read_bit_by_bit_among_other_topics() {
    let ranges = vec![1.25, f32::INFINITY, f32::from_bits(0x7fc0_1234), -0.0];
    let fields = Fields { stamp: (1_700_000_001, 999_999_999), ranges, ..Fields::default() };
    let (_directory, path) = file(&scan_bag_v1(&[fields.ros1(), fields.ros1()]));
    let recording = Recording::open(&path).unwrap();
    assert_eq!(recording.format(), Format::Ros1BagV1);
    let mut scans = recording.scans();
    let found: Vec<_> = scans.by_ref().map(Result::unwrap).collect();
    let times: Vec<u64> = found.iter().map(|found| found.log_time_ns).collect();
    assert_eq!(times, [1_700_000_000_000_000_007, 1_700_000_002_000_000_007]);
    let other = (&"odom".to_owned(), &"nav_msgs/Odometry".to_owned());
    assert_eq!(scans.other_topics().iter().next(), Some(other));
    assert_eq!(scans.position_bytes(), recording.bytes());
    for found in found {
        assert_eq!((&*found.topic, found.scan.stamp_ns), ("/scan", 1_700_000_001_999_999_999));
        assert_eq!(found.scan.geometry.range_max_m, 8.0);
        let bits = |ranges: &[f32]| ranges.iter().map(|r| r.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&found.scan.ranges_m), bits(&fields.ranges));
    }
}

#[test]
fn a_bag_of_version_1_2_without_an_index_is_complete_where_a_record_ends() {
    let scan = |topic| (topic, "sensor_msgs/LaserScan", MD5, Fields::default().ros1());
    let (_directory, path) = file(&bag_v1(&[scan("a"), scan("b"), scan("a")], false));
    let topics: Vec<(usize, u64)> = (Recording::open(&path).unwrap().scans().map(Result::unwrap))
        .map(|found| (found.topic_index, found.number))
        .collect();
    assert_eq!(topics, [(0, 1), (1, 1), (0, 2)]);
}

#[test]
fn the_real_bag_of_version_1_2_has_the_numbers_that_its_bytes_have() {
    let Some(path) = shared("scan_tools/laser_scan_splitter_demo.bag") else { return };
    let found: Vec<_> = Recording::open(&path).unwrap().scans().map(Result::unwrap).collect();
    // As a few lines of Python with `struct` read the bytes: first and last message, sum of all
    // bits.
    let times = |at: usize| (found[at].log_time_ns, found[at].scan.stamp_ns);
    assert_eq!(times(0), (1_275_168_820_015_344_000, 1_275_168_819_941_886_500));
    assert_eq!(times(122), (1_275_168_832_182_361_000, 1_275_168_832_110_014_500));
    let geometry = ScanGeometry {
        angle_min_rad: -1.5707963705062866,
        angle_increment_rad: 0.006135923322290182,
        range_min_m: 0.019999999552965164,
        range_max_m: 5.599999904632568,
    };
    assert!(found.iter().all(|found| found.scan.geometry == geometry));
    assert!(found.iter().all(|found| found.scan.ranges_m.len() == 512));
    let readings = found.iter().flat_map(|found| &found.scan.ranges_m);
    assert_eq!(
        readings.map(|range_m| u64::from(range_m.to_bits())).sum::<u64>(),
        65_889_628_925_290
    );
}

#[test]
fn a_stamp_that_is_not_set_is_the_time_of_the_recorder() {
    let bytes = scan_bag(&[Fields { stamp: (0, 0), ..Fields::default() }.ros1()], "none");
    let (_directory, path) = file(&bytes);
    let found = Recording::open(&path).unwrap().scans().next().unwrap().unwrap();
    assert_eq!(found.scan.stamp_ns, found.log_time_ns);
}

#[test]
fn the_index_counts_gaps_disorder_and_changes_of_geometry() {
    let stamps = [10, 11, 15, 14, 15, 16];
    let mut bodies: Vec<Vec<u8>> = stamps
        .iter()
        .map(|second| Fields { stamp: (*second, 0), ..Fields::default() }.ros1())
        .collect();
    bodies.push(Fields { stamp: (17, 0), ranges: vec![1.0; 4], ..Fields::default() }.ros1());
    bodies.push(Fields { stamp: (18, 0), angle_min: f32::NAN, ..Fields::default() }.ros1());
    let (_directory, path) = file(&scan_bag(&bodies, "none"));
    let index = index(&path);
    let topic = index.topic(None).unwrap();
    assert_eq!((topic.scans, topic.refused), (7, 1));
    assert_eq!((topic.out_of_order, topic.geometry_changes), (2, 1));
    assert_eq!((topic.gaps, topic.longest_gap_ns), (1, 4_000_000_000));
    assert_eq!((topic.first_stamp_ns, topic.last_stamp_ns), (10_000_000_000, 17_000_000_000));
    assert_eq!((topic.readings, topic.no_return, topic.invalid), (22, 6, 6));
    assert!(matches!(index.first_refusal, Some(RecordingError::Message { number: 8, .. })));
    assert!(index.early_end.is_none());
}

#[test]
fn every_real_bag_is_read_to_its_end() {
    // Counts as the independent reader `rosbags` has them (tests/independent); the matcher's bag
    // has an index that `rosbags` refuses, the splitter's is of version 1.2: their records were
    // counted.
    let expected: [(&str, &[(&str, u64)]); 11] = [
        ("datmo/82c2bc_two_robots.bag", &[("/scan", 388)]),
        ("leigh_leg_tracker/demo_stationary_simple_environment.bag", &[("/scan", 1265)]),
        (
            "leigh_leg_tracker/negative_2_first_30s.bag",
            &[("/left_scan", 226), ("/rear_scan", 226), ("/right_scan", 225)],
        ),
        ("leigh_leg_tracker/positive_1.bag", &[("right_scan", 400)]),
        ("leigh_leg_tracker/positive_2.bag", &[("right_scan", 243)]),
        ("leigh_leg_tracker/positive_3.bag", &[("right_scan", 345)]),
        ("leigh_leg_tracker/positive_5.bag", &[("right_scan", 296)]),
        ("tysik_two_laser/scans_demo.bag", &[("/front_scan", 331), ("/rear_scan", 330)]),
        ("scan_tools/laser_scan_matcher_demo.bag", &[("/scan", 360)]),
        ("scan_tools/laser_scan_splitter_demo.bag", &[("scan", 123)]),
        ("sick_cola/empty_ros1.bag", &[]),
    ];
    for (name, topics) in expected {
        let Some(path) = shared(name) else { return };
        if topics.is_empty() {
            let recording = Recording::open(&path).unwrap();
            let error = RecordingIndex::scan(&recording, |_| Some(Pose::default())).unwrap_err();
            assert!(error.to_string().contains("holds no laser scans: it is empty"), "{error}");
            continue;
        }
        let index = index(&path);
        let mut found: Vec<(&str, u64)> =
            index.topics.iter().map(|topic| (topic.topic.as_str(), topic.scans)).collect();
        found.sort_unstable();
        assert_eq!(found, topics, "{name}");
        assert!(index.early_end.is_none() && index.first_refusal.is_none(), "{name}");
    }
}

#[test]
fn the_area_round_a_real_recording_holds_the_room() {
    let name = "leigh_leg_tracker/demo_stationary_simple_environment.bag";
    let Some(path) = shared(name) else { return };
    let index = index(&path);
    let topic = index.topic(None).unwrap();
    assert_eq!(topic.beams, 512);
    let grid = index.topics[0].extent.area(0.1).unwrap();
    // The walkers' loops: x 0.7..3.7 m, y -3.2..3.0 m; the laser is at the origin.
    for (x_m, y_m) in [(0.0, 0.0), (0.7, -3.2), (3.7, 3.0), (3.7, -3.2), (0.7, 3.0)] {
        assert!(grid.cell_at(x_m, y_m).is_some(), "{x_m} {y_m} {grid:?}");
    }
    assert!(grid.cells() < 160 * 160, "{grid:?}");
}

#[test]
fn several_topics_must_be_named() {
    let Some(path) = shared("tysik_two_laser/scans_demo.bag") else { return };
    let index = index(&path);
    assert_eq!(index.topic(Some("/rear_scan")).unwrap().scans, 330);
    let error = index.topic(None).unwrap_err().to_string();
    assert!(error.contains("/front_scan") && error.contains("/rear_scan"), "{error}");
    let error = index.topic(Some("/scan")).unwrap_err().to_string();
    assert!(error.contains("no scans on topic /scan"), "{error}");
}

#[test]
fn a_laser_finds_its_own_topic() {
    let Some(path) = shared("tysik_two_laser/scans_demo.bag") else { return };
    let recording = Recording::open(path).unwrap();
    assert_eq!(&*recording.select_topic(Some("/rear_scan")).unwrap(), "/rear_scan");
    let error = recording.select_topic(None).unwrap_err();
    assert!(matches!(error, RecordingError::SeveralTopics { .. }), "{error}");
    let error = recording.select_topic(Some("/other")).unwrap_err();
    assert!(matches!(error, RecordingError::NoSuchTopic { .. }), "{error}");
    let rear: Vec<_> = recording.scans_of("/rear_scan").map(Result::unwrap).collect();
    assert_eq!(rear.len(), 330);
    let all = recording.scans().map(Result::unwrap);
    let of_rear = all.filter(|found| &*found.topic == "/rear_scan");
    assert!(
        of_rear.zip(&rear).all(|(a, b)| (a.number, a.scan.stamp_ns) == (b.number, b.scan.stamp_ns))
    );
}

const GEOMETRY: ScanGeometry = ScanGeometry {
    angle_min_rad: -0.1,
    angle_increment_rad: 0.1,
    range_min_m: 0.0,
    range_max_m: 30.0,
};

fn topic(name: &str) -> ScanTopic {
    ScanTopic { topic: name.to_owned(), frame_id: format!("laser_{name}"), scan_time_s: 0.1 }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]

    #[test]
    fn what_is_written_is_read(
        scans in prop::collection::vec(
            (
                0_u64..2_000_000_000_000_000_000,
                prop::collection::vec(any::<f32>(), 1..50),
                0_usize..2,
            ),
            1..30,
        ),
    ) {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("out.mcap");
        let mut writer = ScanWriter::create(&path).unwrap();
        prop_assert_eq!(writer.add_topic(topic("a")).unwrap(), 0);
        prop_assert_eq!(writer.add_topic(topic("b")).unwrap(), 1);
        for (stamp_ns, ranges_m, topic) in &scans {
            let (stamp_ns, ranges_m) = (*stamp_ns + 1, ranges_m.clone());
            let scan =
                LaserScan { stamp_ns, device_stamp_ns: 0, geometry: GEOMETRY, ranges_m };
            writer.write(*topic, stamp_ns + 7, &scan.view()).unwrap();
        }
        prop_assert!(!path.exists(), "it has its name when it is complete");
        writer.finish().unwrap();
        let recording = Recording::open(&path).unwrap();
        prop_assert_eq!(recording.format(), Format::Mcap);
        let mut found = recording.scans();
        for (stamp_ns, ranges_m, topic) in &scans {
            let read = found.next().unwrap().unwrap();
            prop_assert_eq!(&*read.topic, if *topic == 0 { "a" } else { "b" });
            prop_assert_eq!(read.log_time_ns, stamp_ns + 8);
            prop_assert_eq!(read.scan.stamp_ns, stamp_ns + 1);
            prop_assert_eq!(read.scan.geometry, as_recorded(&GEOMETRY));
            let bits = |ranges: &[f32]| ranges.iter().map(|r| r.to_bits()).collect::<Vec<_>>();
            prop_assert_eq!(bits(&read.scan.ranges_m), bits(ranges_m));
        }
        prop_assert!(found.next().is_none());
    }
}

#[test]
fn the_same_scans_make_the_same_bytes() {
    let write = |path: &std::path::Path| {
        let mut writer = ScanWriter::create(path).unwrap();
        let number = writer.add_topic(topic("/scan")).unwrap();
        for stamp_ns in (1..5_000_000_000).step_by(100_000_000) {
            let ranges_m = vec![1.0; 181];
            let scan = LaserScan { stamp_ns, device_stamp_ns: 0, geometry: GEOMETRY, ranges_m };
            writer.write(number, stamp_ns, &scan.view()).unwrap();
        }
        writer.finish().unwrap();
        std::fs::read(path).unwrap()
    };
    let directory = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| write(&directory.path().join(name)));
    assert_eq!(a, b);
}

#[test]
fn a_writer_that_dies_leaves_its_scans_but_for_the_last_second() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("out.mcap");
    let mut writer = ScanWriter::create(&path).unwrap();
    let number = writer.add_topic(topic("/scan")).unwrap();
    for stamp_ns in (0..3_500_000_000).step_by(100_000_000).skip(1) {
        let ranges_m = vec![1.0; 181];
        let scan = LaserScan { stamp_ns, device_stamp_ns: 0, geometry: GEOMETRY, ranges_m };
        writer.write(number, stamp_ns, &scan.view()).unwrap();
    }
    std::mem::forget(writer);
    let items: Vec<_> =
        Recording::open(path.with_extension("mcap.active")).unwrap().scans().collect();
    let (last, scans) = items.split_last().unwrap();
    assert!(last.as_ref().is_err_and(RecordingError::is_cut), "{last:?}");
    assert!(scans.iter().all(Result::is_ok));
    assert_eq!(scans.len(), 31, "flushed at 1.1, 2.1 and 3.1 s");
}

#[test]
fn a_scan_that_a_recording_cannot_hold_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let mut writer = ScanWriter::create(directory.path().join("out.mcap")).unwrap();
    let number = writer.add_topic(topic("/scan")).unwrap();
    let mut scan = LaserScan {
        stamp_ns: 4_000_000_000_000_000_000,
        device_stamp_ns: 0,
        geometry: GEOMETRY,
        ranges_m: vec![1.0],
    };
    let error = writer.write(number, 1, &scan.view()).unwrap_err().to_string();
    assert!(error.contains("4000000000 s"), "{error}");
    scan.stamp_ns = 1;
    scan.ranges_m.clear();
    let error = writer.write(number, 1, &scan.view()).unwrap_err().to_string();
    assert!(error.contains("a scan of 0 beams"), "{error}");
    let error = writer.write(5, 1, &scan.view()).unwrap_err().to_string();
    assert!(error.contains("topic number 5, there are 1"), "{error}");
}
