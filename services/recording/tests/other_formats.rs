//! CARMEN and Player logs, CSV, ROS 2 bags in SQLite, scans with several echoes: what is read is what
//! the text says.
#![allow(clippy::unwrap_used)]

mod common;

use common::{
    Fields, carmen, db3, file, gzip, mcap, multi_echo, player, read, read_with, scan_bag,
};
use proptest::prelude::*;
use recording::{ColumnMap, CsvWriter, Echo, ReadOptions, RecordedScan, Recording};

fn columns(text: &str) -> ReadOptions {
    ReadOptions { columns: Some(text.parse().unwrap()), ..ReadOptions::default() }
}

#[test]
fn a_carmen_log_is_read_plain_and_packed() {
    let text = carmen(3, 181);
    for bytes in [text.clone().into_bytes(), gzip(text.as_bytes())] {
        let (scans, errors) = read(&bytes);
        assert!(errors.is_empty(), "{errors:?}");
        assert_eq!(scans.len(), 3);
        assert_eq!((&*scans[1].topic, scans[1].number), ("FLASER", 2));
        assert_eq!(scans[1].scan.stamp_ns, 101_500_000_000);
        assert_eq!(scans[1].scan.ranges_m[..3], [1.01, 2.01, 3.01]);
        let geometry = scans[1].scan.geometry;
        assert!((geometry.angle_min_rad + std::f64::consts::FRAC_PI_2).abs() < 1e-6);
        assert!((geometry.angle_increment_rad.to_degrees() - 1.0).abs() < 1e-6);
    }
}

#[test]
fn the_maxima_of_a_carmen_log_are_no_returns_and_its_faults_say_nothing() {
    let line = |ranges: &str| format!("FLASER 5 {ranges} 1 0 0 0 0 0 0 5.5 host 1\n");
    let found = |text: String| {
        let (scans, errors) = read(text.as_bytes());
        assert!(errors.is_empty(), "{errors:?}");
        let scan = scans[0].scan.clone();
        (scan.ranges_m, scan.geometry.range_max_m as f32)
    };
    let (ranges_m, range_max_m) = found(line("1.5 81.83 81.91 81.87"));
    assert_eq!(
        (ranges_m[..3].to_vec(), range_max_m),
        (vec![1.5, f32::INFINITY, f32::INFINITY], 81.83)
    );
    assert!(ranges_m[3].is_nan());
    // In millimetres of a 32 m mode, with 16.379 as a range; a later scan tells it.
    let (ranges_m, range_max_m) = found(line("1.5 2 16.379 3") + &line("1 2 3 32.767"));
    assert_eq!((ranges_m[2], range_max_m), (16.379, 32.759));
    assert_eq!(found(line("1.5 51.1 3 4")).1, 50.0, "a PLS");
    assert_eq!(found(line("1.5 20.0 3 4")).1, 81.83, "not known");
}

#[test]
fn lasers_of_carmen_that_say_how_their_beams_lie_are_believed() {
    let text = "# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp\n\
        ROBOTLASER1 4 -2.0 4.0 0.5 30.0 0.01 0 3 1.5 30.0 0.01 2 7 8 1 2 3 4 5 6 0.1 0.2 0.3 0.4 0 \
        1048880434.230001 host 0.5\n\
        RAWLASER2 4 -1.0 2.0 1.0 8.0 0.01 0 2 1.5 8.5 0 1048880435 host 1.5\n\
        RLASER 5 1 2 3 4 5 0 0 0 0 0 0 0 host 9.25\n";
    let (scans, errors) = read(text.as_bytes());
    assert!(errors.is_empty(), "{errors:?}");
    let topics: Vec<&str> = scans.iter().map(|found| &*found.topic).collect();
    assert_eq!(topics, ["ROBOTLASER1", "RAWLASER2", "RLASER"]);
    let geometry = scans[0].scan.geometry;
    assert_eq!((geometry.angle_min_rad, geometry.angle_increment_rad), (-2.0, 0.5));
    assert_eq!((scans[0].scan.stamp_ns, geometry.range_max_m), (1_048_880_434_230_001_000, 30.0));
    assert_eq!(scans[2].scan.stamp_ns, 9_250_000_000, "the logger's, where the other is not set");
}

#[test]
fn a_line_of_carmen_that_is_wrong_is_refused_by_its_number() {
    let good = "FLASER 5 1 2 3 4 5 0 0 0 0 0 0 5 host 1\n";
    for (bad, words) in [
        (
            "FLASER 6 1 2 3 4 5 0 0 0 0 0 0 5 host 1\n",
            "the line ends before the logger's time stamp",
        ),
        ("FLASER 5 1 2 3 4 pippo 0 0 0 0 0 0 5 host 1\n", "a range is \"pippo\""),
        ("FLASER 99999 1 2\n", "99999 ranges, expected at most 4096"),
        ("FLASER 0 0 0 0 0 0 0 5 host 1\n", "a scan of 0 ranges"),
        ("FLASER 5 1 2 3 4 5 0 0 0 0 0 0 0 host 0\n", "no place in time"),
        ("FLASER 5 1 2 3 4 5 0 0 0 0 0 0 5 host 1 2\n", "\"2\" follows"),
        ("FLASER 5 1 2 0 0\n", "the line ends before"),
    ] {
        let (scans, errors) = read(format!("{good}{bad}{good}").as_bytes());
        assert_eq!((scans.len(), errors.len()), (2, 1), "{bad} {errors:?}");
        let error = errors[0].to_string();
        assert!(error.contains("line 2: ") && error.contains(words), "{error}");
        assert!(!errors[0].ends_the_stream());
    }
    let long = format!("{good}FLASER 4096 {}\n{good}", "1.0 ".repeat(100_000));
    let (scans, errors) = read(long.as_bytes());
    assert_eq!(scans.len(), 2);
    assert!(errors[0].to_string().contains("longer than any scan"), "{}", errors[0]);
}

#[test]
fn a_player_log_is_read_by_laser() {
    let (scans, errors) = read(player(3).as_bytes());
    assert!(errors.is_empty(), "{errors:?}");
    let topics: Vec<&str> = scans.iter().map(|found| &*found.topic).collect();
    assert_eq!(topics, ["6665:laser:0", "6665:laser:1", "6665:laser:0"]);
    let scan = &scans[2].scan;
    assert_eq!(scan.stamp_ns, 1_002_002_000_000);
    assert_eq!(scan.ranges_m[..2], [1.5, f32::INFINITY], "8.191 of 8.192 m is no return");
    assert!(scan.ranges_m[2].is_nan(), "8.187 is a fault");
    assert_eq!(scan.geometry.range_max_m as f32, 8.183);
    let pose = player(0) + "1.5 1 6665 laser 00 001 002 0001 1 2 3 -1 1 0.5 30 2 1.5 0 9.5 0\n";
    let (scans, _) = read(pose.as_bytes());
    assert_eq!(
        (scans[0].scan.ranges_m.clone(), scans[0].scan.geometry.range_max_m),
        (vec![1.5, 9.5], 30.0)
    );
    let angles = player(0) + "1.5 1 6665 laser 00 001 003 0001 1 2 3\n";
    let error = read(angles.as_bytes()).1[0].to_string();
    assert!(error.contains("a bearing of its own"), "{error}");
}

#[test]
fn a_csv_is_read_as_its_columns_are_declared() {
    let text = "time;name;x;a;b;c;d\n1700000000123.5;front;9;1000;inf;8;\n1700000000223.5;\"re;ar\";9;1;2;nan;4\n";
    let map = "t:ms,laser,-,r*4:mm,angle_min=-45:deg,angle_max=45:deg,range_max=8000:mm";
    let (_directory, path) = file(text.as_bytes());
    let (scans, errors) = read_with(&path, columns(map));
    assert!(errors.is_empty(), "{errors:?}");
    assert_eq!((&*scans[0].topic, &*scans[1].topic), ("front", "re;ar"));
    assert_eq!(scans[0].scan.stamp_ns, 1_700_000_000_123_500_000);
    assert_eq!(scans[0].scan.ranges_m, [1.0, f32::INFINITY, 0.008]);
    assert_eq!(scans[1].scan.ranges_m[..2], [0.001, 0.002]);
    assert!(scans[1].scan.ranges_m[2].is_nan());
    let geometry = scans[1].scan.geometry;
    assert!((geometry.angle_increment_rad.to_degrees() - 30.0).abs() < 1e-5, "{geometry}");
    assert_eq!((geometry.range_min_m, geometry.range_max_m), (0.0, 8.0));
}

#[test]
fn columns_that_make_no_sense_are_told() {
    for (map, words) in [
        ("laser,r...", "lack t"),
        ("t,angle_min,angle_increment,range_max", "lack r..."),
        ("t,r...,angle_min=0,range_max=8", "lack angle_increment (or angle_max)"),
        ("t:h,r...", "the unit \"h\", expected one of: s, ms, us, ns"),
        ("t,range", "\"range\" is not known"),
        ("t,rx", "\"rx\" is not known"),
        ("t,t,r...", "is there twice"),
        ("t,r...,laser", "nothing can follow r..."),
        ("t,r*99999", "99999 ranges, expected at most 4096"),
        ("t,r...,range_max=far", "the value is \"far\""),
    ] {
        let error = map.parse::<ColumnMap>().unwrap_err();
        assert!(error.contains(words), "{map}: {error}");
    }
    let map = "t,r*2,angle_min=0,angle_increment=1:deg,range_max=8";
    let (_directory, path) = file(b"1,2,3\n4,5\n6,7,8,9\nnoon,1,2\n7,x,3\n8,1,2");
    let (scans, errors) = read_with(&path, columns(map));
    assert_eq!(scans.iter().map(|found| found.number).collect::<Vec<_>>(), [1, 6]);
    let texts: Vec<String> = errors.iter().map(ToString::to_string).collect();
    assert!(texts[0].contains("line 2: a row of 2 fields, expected 3"), "{texts:?}");
    assert!(texts[1].contains("line 3: a row of 4 fields, expected 3"), "{texts:?}");
    assert!(
        texts[2].contains("a time of \"noon\"") && texts[3].contains("a range is \"x\""),
        "{texts:?}"
    );
}

#[test]
fn a_ros2_bag_in_sqlite_is_read_in_the_order_of_its_rows_and_left_as_it_is() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a b%c.db3");
    let scan = |second| {
        let fields = Fields { stamp: (second, 5), ..Fields::default() };
        ("/scan", "sensor_msgs/msg/LaserScan", fields.cdr_big_endian())
    };
    let other = ("/odom", "nav_msgs/msg/Odometry", vec![1; 90_000]);
    let messages: Vec<_> = (0..50).flat_map(|n| [scan(n), other.clone()]).collect();
    db3(&path, &messages);
    let before = std::fs::read(&path).unwrap();
    let (scans, errors) = read_with(&path, ReadOptions::default());
    assert!(errors.is_empty(), "{errors:?}");
    let stamps: Vec<u64> = scans.iter().map(|found| found.scan.stamp_ns).collect();
    assert_eq!(stamps, (0..50).map(|n| n * 1_000_000_000 + 5).collect::<Vec<u64>>());
    assert_eq!(scans[1].log_time_ns, 1_700_000_000_000_000_002);
    assert!(before == std::fs::read(&path).unwrap());
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 1, "nothing beside it");
    std::fs::write(directory.path().join("a b%c.db3-wal"), b"x").unwrap();
    let (scans, errors) = read_with(&path, ReadOptions::default());
    assert_eq!((scans.len(), errors.len()), (50, 1));
    assert!(
        errors[0].is_cut() && errors[0].to_string().contains("-wal beside it"),
        "{}",
        errors[0]
    );
}

#[test]
fn databases_that_are_programs_are_refused() {
    for (statement, words) in [
        ("CREATE VIEW messages AS SELECT 1 AS x", "found no table `messages`"),
        (
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, data AS (zeroblob(id)))",
            "1 computed columns",
        ),
    ] {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("x.db3");
        let bag = rusqlite::Connection::open(&path).unwrap();
        bag.execute_batch(statement).unwrap();
        bag.execute_batch("CREATE TABLE topics(id, name, type, serialization_format)").unwrap();
        drop(bag);
        let error = Recording::open(&path).unwrap_err().to_string();
        assert!(error.contains("no ROS 2 bag") && error.contains(words), "{error}");
    }
}

#[test]
fn a_bag_directory_is_read_in_the_order_of_its_metadata_or_its_numbers() {
    let directory = tempfile::tempdir().unwrap();
    for (name, second) in [("bag_10.db3", 3), ("bag_2.db3", 2), ("bag_1.db3", 1)] {
        let body = Fields { stamp: (second, 0), ..Fields::default() }.cdr_big_endian();
        db3(&directory.path().join(name), &[("/scan", "sensor_msgs/msg/LaserScan", body)]);
    }
    let seconds = || {
        let (scans, errors) = read_with(directory.path(), ReadOptions::default());
        assert!(errors.is_empty(), "{errors:?}");
        let numbers: Vec<u64> = scans.iter().map(|found| found.number).collect();
        assert_eq!(numbers, (1..=numbers.len() as u64).collect::<Vec<_>>());
        scans.iter().map(|found| found.scan.stamp_ns / 1_000_000_000).collect::<Vec<u64>>()
    };
    assert_eq!(seconds(), [1, 2, 3]);
    let metadata =
        "rosbag2_bagfile_information:\n  relative_file_paths:\n    - bag_2.db3\n    - bag_10.db3\n";
    std::fs::write(directory.path().join("metadata.yaml"), metadata).unwrap();
    assert_eq!(seconds(), [2, 3]);
    std::fs::write(directory.path().join("metadata.yaml"), "relative_file_paths:\n- gone.db3\n")
        .unwrap();
    let error = Recording::open(directory.path()).unwrap_err().to_string();
    assert!(error.contains("gone.db3: cannot open"), "{error}");
}

#[test]
fn one_echo_of_each_beam_is_taken() {
    let beams: [(&[f32], &[f32]); 3] =
        [(&[1.0, 2.0, 3.0], &[5.0, 9.0, 9.0]), (&[], &[]), (&[4.0], &[0.0])];
    let bytes = mcap("sensor_msgs/MultiEchoLaserScan", "ros1", &[multi_echo(&beams)]);
    let (_directory, path) = file(&bytes);
    for (echo, range_m) in [(Echo::First, 1.0), (Echo::Strongest, 2.0), (Echo::Last, 3.0)] {
        let (scans, errors) = read_with(&path, ReadOptions { echo, ..ReadOptions::default() });
        assert!(errors.is_empty(), "{errors:?}");
        let ranges_m = &scans[0].scan.ranges_m;
        assert_eq!((ranges_m[0], ranges_m[2], ranges_m.len()), (range_m, 4.0, 3));
        assert!(ranges_m[1].is_nan(), "no echo says nothing");
    }
    let many = [1.0; 9];
    let bytes = mcap("sensor_msgs/MultiEchoLaserScan", "ros1", &[multi_echo(&[(&many, &[])])]);
    let error = read(&bytes).1[0].to_string();
    assert!(error.contains("9 echoes of a beam, expected at most 8"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]

    #[test]
    fn a_csv_that_is_written_is_read_to_the_same_bits(
        scans in prop::collection::vec(
            (any::<u32>(), prop::collection::vec(any::<f32>(), 1..20), "[a-z/,\"; #]{1,9}"), 1..20,
        ),
    ) {
        let fields = Fields::default();
        let template = read(&scan_bag(&[fields.ros1()], "none")).0.remove(0);
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("out.csv");
        let mut writer = CsvWriter::create(&path, 20).unwrap();
        let mut expected = Vec::new();
        for (stamp, ranges_m, name) in scans {
            let mut found = template.clone();
            found.scan.stamp_ns = u64::from(stamp) * 1_000_000_007;
            found.scan.ranges_m = ranges_m;
            // Blanks at the ends of a name are not kept: no laser has them.
            found.topic = format!("x{name}x").into();
            writer.write(&found).unwrap();
            expected.push(found);
        }
        writer.finish().unwrap();
        let (found, errors) = read_with(&path, ReadOptions::default());
        prop_assert!(errors.is_empty(), "{:?}", errors);
        prop_assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(&expected) {
            let head = |scan: &RecordedScan| {
                (scan.topic.clone(), scan.scan.stamp_ns, scan.log_time_ns, scan.scan.geometry)
            };
            prop_assert_eq!(head(found), head(expected));
            let bits = |scan: &RecordedScan| -> Vec<u32> {
                let quiet = |range: &f32| if range.is_nan() { f32::NAN } else { *range };
                scan.scan.ranges_m.iter().map(|range| quiet(range).to_bits()).collect()
            };
            prop_assert_eq!(bits(found), bits(expected));
        }
    }
}

#[test]
fn no_row_of_a_csv_vanishes_as_a_title() {
    let map = "t,r*2,angle_min=0,angle_increment=1:deg,range_max=8";
    for (rows, refused) in [
        ("#0,1,2\n-1,1,2\n-2,1,2\n1,1,2\n", 3),
        ("# a comment\nt,a,b\n# another\n1,1,2\n", 0),
        ("-3,1,2\n-4,1,2\n", 2),
        ("t,a,b\nmore,words,here\n1,1,2\n", 1),
    ] {
        let (_directory, path) = file(rows.as_bytes());
        let (scans, errors) = read_with(&path, columns(map));
        assert_eq!(errors.len(), refused, "{rows}: {errors:?}");
        assert_eq!(scans.len(), usize::from(rows.contains("\n1,")), "{rows}");
    }
    // A CSV that declares its columns itself.
    let declared = "t,r0,r1,angle_min=0,angle_increment=1:deg,range_max=8\n-1,1,2\n-2,1,2\n1,1,2\n";
    let (_directory, path) = file(declared.as_bytes());
    let (scans, errors) = read_with(&path, ReadOptions::default());
    assert_eq!((scans.len(), errors.len()), (1, 2), "{errors:?}");
}
