//! Whatever the file holds: clear words, never a panic, never a loop, and every scan before the
//! fault.
#![allow(clippy::unwrap_used)]

mod common;

use common::{
    Fields, MD5, bag, bag_v1, chunk, connection, file, mcap, message, scan_bag, scan_bag_v1,
};
use proptest::prelude::*;
use protocol::geometry::Pose;
use recording::{RecordedScan, Recording, RecordingError, RecordingIndex};
use std::path::Path;

fn open_error(bytes: &[u8]) -> String {
    let (_directory, path) = file(bytes);
    Recording::open(&path).unwrap_err().to_string()
}

fn read(bytes: &[u8]) -> (Vec<RecordedScan>, Vec<RecordingError>) {
    let (_directory, path) = file(bytes);
    let (mut scans, mut errors) = (Vec::new(), Vec::new());
    for item in Recording::open(&path).unwrap().scans() {
        match item {
            Ok(scan) => scans.push(scan),
            Err(error) => errors.push(error),
        }
    }
    (scans, errors)
}

fn index_error(bytes: &[u8]) -> String {
    let (_directory, path) = file(bytes);
    let recording = Recording::open(&path).unwrap();
    RecordingIndex::scan(&recording, |_| Some(Pose::default())).unwrap_err().to_string()
}

/// The one error of a recording of three messages whose middle one is bad.
fn refusal(bad: &Fields) -> String {
    let good = Fields::default();
    let as_bag = scan_bag(&[good.ros1(), bad.ros1(), good.ros1()], "none");
    let cdr = [good.cdr_big_endian(), bad.cdr_big_endian(), good.cdr_big_endian()];
    let as_mcap = mcap("sensor_msgs/msg/LaserScan", "cdr", &cdr);
    let as_old_bag = scan_bag_v1(&[good.ros1(), bad.ros1(), good.ros1()]);
    let texts = [as_bag, as_mcap, as_old_bag].map(|bytes| {
        let (scans, errors) = read(&bytes);
        let numbers: Vec<u64> = scans.iter().map(|found| found.number).collect();
        assert_eq!(numbers, [1, 3], "reading goes on behind a bad message");
        assert_eq!(errors.len(), 1);
        assert!(!errors[0].ends_the_stream());
        let text = errors[0].to_string();
        text[text.find("message 2").unwrap()..].to_owned()
    });
    assert!(texts.iter().all(|text| *text == texts[0]), "all containers say the same: {texts:?}");
    texts[0].clone()
}

#[test]
fn foreign_files_are_named_with_what_to_do() {
    let gzip = common::gzip;
    let packed_bag = gzip(b"#ROSBAG V2.0\n");
    let packed_rawlog = gzip(b"\x8dCSensoryFrame\x02");
    let packed_text = gzip(b"hello");
    let cases: [(&[u8], &str, &str); 18] = [
        (b"#ROSBAG V2.1\n", "version other than 2.0", "rosbag fix"),
        (b"#ROSRECORD V1.1\n", "older than version 1.2", "rosbag fix"),
        (b"#ROSLOG V1.1\n", "older than version 1.2", "rosbag fix"),
        (b"#ROSRECORD V1.", "cut after 14 bytes", "copied completely"),
        (b"SQLite format 3\0....", "an SQLite file that is no ROS 2 bag", "the .db3 file"),
        (b"\x0a\x0d\x0d\x0a\x1c\0\0\0", "pcapng", "ros2 bag record"),
        (b"[\n {\n  \"_source\": {", "a network capture as JSON", "not scans"),
        (b"{\"a\": 1}", "a JSON text", "the recording it was made from"),
        (b"\x1f\x8b\x08", "a gzip file that holds an empty file", "copied completely"),
        (&packed_bag, "a gzip file with a recording in it", "unpack it"),
        (
            &packed_text,
            "a gzip file that holds a file that begins with \"hello\"",
            "that you meant",
        ),
        (&packed_rawlog, "an MRPT rawlog", "rawlog2rosbag"),
        (b"\x87CAction", "an MRPT rawlog", "a CSV"),
        (b"\x28\xb5\x2f\xfd", "a zstd file", "unpack it"),
        (b"## Player version 1.6\n## File version 0.1.0\n", "a Player log", "other than 0.3"),
        (b"", "an empty file", "copied completely"),
        (b"1.0,2.0\n3.0,4.0\n", "begins with \"1.0,2.0", "--columns"),
        (b"hello\xff", "begins with \"hello\\xff\"", "the file that you meant"),
    ];
    for (bytes, found, advice) in cases {
        let error = open_error(bytes);
        assert!(error.contains(found) && error.contains(advice), "{error}");
    }
}

#[test]
fn a_missing_file_a_directory_a_device_and_a_pipe_are_told() {
    let directory = tempfile::tempdir().unwrap();
    let missing = Recording::open(directory.path().join("none.bag")).unwrap_err().to_string();
    assert!(missing.contains("none.bag") && missing.contains("No such file"), "{missing}");
    let error = Recording::open(directory.path()).unwrap_err().to_string();
    assert!(error.contains("is a directory"), "{error}");
    let device = Recording::open(Path::new("/dev/zero")).unwrap_err().to_string();
    assert!(device.contains("expected a file"), "{device}");
    let pipe = directory.path().join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let pipe = Recording::open(&pipe).unwrap_err().to_string();
    assert!(pipe.contains("expected a file"), "{pipe}");
}

#[test]
fn a_recording_without_scans_says_what_it_holds() {
    let empty = index_error(&bag(&[], &[]));
    assert!(empty.contains("holds no laser scans: it is empty"), "{empty}");
    let odometry = connection(3, "/odom", "nav_msgs/Odometry", MD5);
    let records = [odometry.clone(), message(3, 1, b"body")];
    let other = index_error(&bag(&[chunk(&records, "none")], &[odometry]));
    assert!(other.contains("/odom (nav_msgs/Odometry)"), "{other}");
    let strange = connection(0, "/scan", "sensor_msgs/LaserScan", &"0".repeat(32));
    let changed = index_error(&bag(&[chunk(std::slice::from_ref(&strange), "none")], &[strange]));
    assert!(changed.contains("sensor_msgs/LaserScan of another definition"), "{changed}");
    let foxglove = index_error(&mcap("foxglove.LaserScan", "protobuf", &[vec![1, 2, 3]]));
    assert!(foxglove.contains("/scan (foxglove.LaserScan in protobuf)"), "{foxglove}");
}

#[test]
fn a_message_that_lies_about_its_length_is_refused_and_the_next_is_read() {
    let lie = |announced| refusal(&Fields { announced: Some(announced), ..Fields::default() });
    assert!(lie(1000).contains("1000 ranges announced, bytes for 4 are left"));
    assert!(lie(u32::MAX).contains("4294967295 ranges, expected at most 4096"));
    assert!(lie(2).contains("intensities"), "{}", lie(2));
}

#[test]
fn more_beams_than_any_laser_has_are_refused() {
    let beams = |count| Fields { ranges: vec![1.0; count], ..Fields::default() };
    assert!(refusal(&beams(4097)).contains("4097 ranges, expected at most 4096"));
    assert!(refusal(&beams(0)).contains("a scan of 0 ranges"));
    let most = scan_bag(&[beams(4096).ros1()], "lz4");
    assert_eq!(read(&most).0[0].scan.ranges_m.len(), 4096);
    let body = beams(20_000).ros1();
    let (scans, errors) = read(&scan_bag(&[body, Fields::default().ros1()], "bz2"));
    assert!(errors[0].to_string().contains("longer than any scan"), "{}", errors[0]);
    assert_eq!(scans[0].number, 2);
}

#[test]
fn a_geometry_that_makes_no_sense_is_refused() {
    let good = Fields::default();
    let nan = refusal(&Fields { angle_min: f32::NAN, ..good.clone() });
    assert!(nan.contains("not finite"), "{nan}");
    let still = refusal(&Fields { angle_increment: 0.0, ..good.clone() });
    assert!(still.contains("angle increment is 0"), "{still}");
    let short = refusal(&Fields { range_max: 0.01, ..good });
    assert!(short.contains("range_min < range_max"), "{short}");
}

#[test]
fn cdr_of_another_kind_is_refused() {
    let mut body = Fields::default().cdr_big_endian();
    body[1] = 7;
    let (scans, errors) = read(&mcap("sensor_msgs/msg/LaserScan", "cdr", &[body]));
    assert!(scans.is_empty());
    assert!(errors[0].to_string().contains("CDR encapsulation 00 07"), "{}", errors[0]);
}

#[test]
fn a_bag_that_was_never_closed_gives_its_scans_and_then_the_cut() {
    let mut bytes = scan_bag(&[Fields::default().ros1()], "none");
    let at = bytes.windows(10).position(|window| window == b"index_pos=").unwrap() + 10;
    bytes[at..at + 8].fill(0);
    let (scans, errors) = read(&bytes);
    assert_eq!(scans.len(), 1);
    assert!(errors[0].is_cut());
    assert!(errors[0].to_string().contains("never closed"), "{}", errors[0]);
}

#[test]
fn an_unknown_compression_and_an_unknown_connection_are_damage() {
    let (_, errors) = read(&bag(&[chunk(&[], "zip")], &[]));
    assert!(errors[0].to_string().contains("\"zip\", expected none, bz2 or lz4"), "{}", errors[0]);
    let (_, errors) = read(&bag(&[chunk(&[message(9, 1, b"x")], "none")], &[]));
    assert!(errors[0].to_string().contains("unknown connection 9"), "{}", errors[0]);
}

#[test]
fn a_bag_of_version_1_2_says_what_is_wrong_with_it() {
    let whole = scan_bag_v1(&[Fields::default().ros1()]);
    let place = |text: &[u8]| whole.windows(text.len()).position(|at| at == text).unwrap();
    let with = |at: usize, new: &[u8]| {
        let mut bytes = whole.clone();
        bytes[at..at + new.len()].copy_from_slice(new);
        let (scans, errors) = read(&bytes);
        assert_eq!(errors.len(), 1, "{errors:?}");
        (scans.len(), errors[0].is_cut(), errors[0].to_string())
    };
    let (scans, is_cut, text) = with(place(b"index_pos=") + 10, &[0; 8]);
    assert!(scans == 1 && is_cut && text.contains("never closed"), "{text}");
    let (scans, is_cut, text) = with(place(b"count=") + 6, &[0; 4]);
    assert!(scans == 1 && is_cut && text.contains("counts 1 messages, expected 2"), "{text}");
    let (_, is_cut, text) = with(place(b"op=\x01") + 3, &[5]);
    assert!(!is_cut && text.contains("record kind 5"), "{text}");
    let (_, is_cut, text) = with(place(b"sec="), b"cos=");
    assert!(!is_cut && text.contains("without the field"), "{text}");
    let (_, is_cut, text) = with(16, &[0xff; 4]);
    assert!(!is_cut && text.contains("header of 4294967295 bytes"), "{text}");
}

#[test]
fn more_topics_than_a_site_has_lasers_and_names_without_end_are_damage() {
    fn scan(topic: &str) -> (&str, &str, &str, Vec<u8>) {
        (topic, "sensor_msgs/LaserScan", MD5, Fields::default().ros1())
    }
    let names: Vec<String> = (0..257).map(|number| format!("scan_{number}")).collect();
    let messages: Vec<_> = names.iter().map(|name| scan(name)).collect();
    let (scans, errors) = read(&bag_v1(&messages, true));
    assert_eq!((scans.len(), errors.len()), (256, 1));
    assert!(errors[0].to_string().contains("scans on more than 256 topics"), "{}", errors[0]);
    let long = "n".repeat(5000);
    let in_chunk = [connection(0, &long, "std_msgs/String", MD5)];
    for bytes in [bag_v1(&[scan(&long)], true), bag(&[chunk(&in_chunk, "none")], &[])] {
        let (_, errors) = read(&bytes);
        assert!(errors[0].to_string().contains("a name of 5000 bytes"), "{}", errors[0]);
    }
}

/// Reading it within little memory is what the fuzz target checks; here: what is said.
#[test]
fn strings_of_mcap_that_are_longer_than_their_record_are_damage() {
    let record = |opcode: u8, body: &[u8]| {
        [&[opcode], &(body.len() as u64).to_le_bytes()[..], body].concat()
    };
    let long = (u32::MAX - 7).to_le_bytes();
    let schema = record(3, &[&[1, 0][..], &long, b"sensor_msgs"].concat());
    let channel = record(4, &[&[1, 0, 0, 0][..], &long, b"/scan"].concat());
    for (bad, what) in [(schema, "the name of a schema"), (channel, "the topic of a channel")] {
        let (scans, errors) = read(&[b"\x89MCAP0\r\n", &bad[..]].concat());
        assert_eq!((scans.len(), errors.len()), (0, 1));
        let text = errors[0].to_string();
        assert!(text.contains(what) && text.contains("needs 4294967288 bytes"), "{text}");
    }
}

#[test]
fn unknown_channels_and_schemas_of_mcap_are_damage() {
    let record = |opcode: u8, body: &[u8]| {
        [&[opcode], &(body.len() as u64).to_le_bytes()[..], body].concat()
    };
    let message = record(5, &[&[9, 0][..], &[0; 20]].concat());
    let channel = record(4, &[1, 0, 7, 0, 1, 0, 0, 0, b't', 0, 0, 0, 0, 0, 0, 0, 0]);
    for (bad, what) in [(message, "unknown channel 9"), (channel, "unknown schema 7")] {
        let (_, errors) = read(&[b"\x89MCAP0\r\n", &bad[..]].concat());
        assert!(errors[0].to_string().contains(what), "{}", errors[0]);
    }
}

/// What makes a scan, NaN ranges included.
fn bits(scans: &[RecordedScan]) -> Vec<(u64, u64, Vec<u32>)> {
    let ranges = |found: &RecordedScan| found.scan.ranges_m.iter().map(|r| r.to_bits()).collect();
    scans.iter().map(|found| (found.log_time_ns, found.scan.stamp_ns, ranges(found))).collect()
}

/// Cuts `bytes` everywhere in steps: what is read is a prefix, and the cut is told.
fn check_cuts(bytes: &[u8], step: usize, magic: usize) {
    let (whole, errors) = read(bytes);
    assert!(errors.is_empty(), "{errors:?}");
    let mut most = 0;
    for length in (magic..bytes.len()).step_by(step).chain([bytes.len() - 1]) {
        let (scans, errors) = read(&bytes[..length]);
        assert_eq!(bits(&scans), bits(&whole[..scans.len()]), "cut at {length}");
        assert_eq!(errors.len(), 1, "cut at {length}: {errors:?}");
        assert!(errors[0].is_cut(), "cut at {length}: {}", errors[0]);
        assert!(scans.len() >= most, "a longer file gave fewer scans at {length}");
        most = scans.len();
    }
    assert_eq!(most, whole.len(), "a cut behind the last scan loses none");
}

#[test]
fn a_recording_cut_anywhere_gives_what_was_before() {
    let scans: Vec<Vec<u8>> =
        (0..20).map(|i| Fields { stamp: (i, 1), ..Fields::default() }.ros1()).collect();
    for compression in ["none", "bz2", "lz4"] {
        check_cuts(&scan_bag(&scans, compression), 5, 13);
    }
    check_cuts(&scan_bag_v1(&scans[..3]), 1, 16);
    let cdr = vec![Fields::default().cdr_big_endian(); 20];
    check_cuts(&mcap("sensor_msgs/msg/LaserScan", "cdr", &cdr), 5, 8);
}

#[test]
fn a_real_bag_cut_anywhere_gives_what_was_before() {
    let names = [
        "leigh_leg_tracker/positive_2.bag",
        "datmo/82c2bc_two_robots.bag",
        "scan_tools/laser_scan_splitter_demo.bag",
    ];
    for name in names {
        let Some(path) = common::shared(name) else { return };
        let bytes = std::fs::read(path).unwrap();
        check_cuts(&bytes, bytes.len() / 23, 16);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn a_recording_with_wrong_bytes_is_read_or_refused(
        wrong in prop::collection::vec((0.0..1.0_f64, any::<u8>()), 1..6),
        compression in prop::sample::select(vec!["none", "bz2", "lz4", "1.2", "mcap"]),
    ) {
        let bodies = |body: Vec<u8>| vec![body; 8];
        let mut bytes = match compression {
            "mcap" => {
                let cdr = bodies(Fields::default().cdr_big_endian());
                mcap("sensor_msgs/msg/LaserScan", "cdr", &cdr)
            }
            "1.2" => scan_bag_v1(&bodies(Fields::default().ros1())),
            _ => scan_bag(&bodies(Fields::default().ros1()), compression),
        };
        for (place, byte) in wrong {
            let at = 13 + (place * (bytes.len() - 13) as f64) as usize;
            bytes[at] = byte;
        }
        let (_directory, path) = file(&bytes);
        if Recording::open(&path).is_err() {
            return Ok(()); // refused at its head
        }
        let (scans, errors) = read(&bytes);
        prop_assert!(scans.len() + errors.len() <= 64);
        prop_assert!(errors.iter().rev().skip(1).all(|error| !error.ends_the_stream()));
    }

    #[test]
    fn any_bytes_behind_a_magic_are_refused(tail in prop::collection::vec(any::<u8>(), 0..300)) {
        for magic in [&b"#ROSBAG V2.0\n"[..], b"#ROSRECORD V1.2\n", b"\x89MCAP0\r\n"] {
            let (scans, errors) = read(&[magic, &tail].concat());
            prop_assert!(scans.is_empty());
            prop_assert_eq!(errors.len(), 1);
        }
    }
}
