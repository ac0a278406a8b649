//! Whatever the bytes of a log, a CSV or a database are: words, never a panic, never a loop, and no
//! more work than their size explains. What the index of a file says is what its scans say.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Fields, carmen, db3, file, gzip, mcap, multi_echo, player, read, scan_bag, shared};
use proptest::prelude::*;
use protocol::geometry::Pose;
use recording::{
    ColumnMap, CsvWriter, Format, RecordedScan, Recording, RecordingError, RecordingIndex,
    RecordingInfo, ScanTopic, ScanWriter,
};

/// A recording of each kind, small.
fn samples() -> Vec<Vec<u8>> {
    static MADE: std::sync::OnceLock<Vec<Vec<u8>>> = std::sync::OnceLock::new();
    MADE.get_or_init(make_samples).clone()
}

fn make_samples() -> Vec<Vec<u8>> {
    let directory = tempfile::tempdir().unwrap();
    let bag = directory.path().join("x.db3");
    let body = || Fields::default().cdr_big_endian();
    db3(&bag, &vec![("/scan", "sensor_msgs/msg/LaserScan", body()); 12]);
    let csv = directory.path().join("x.csv");
    let mut writer = CsvWriter::create(&csv, 8).unwrap();
    for found in read(&scan_bag(&vec![Fields::default().ros1(); 8], "none")).0 {
        writer.write(&found).unwrap();
    }
    writer.finish().unwrap();
    let echo = multi_echo(&[(&[1.0, 2.0], &[1.0]), (&[], &[])]);
    vec![
        carmen(6, 20).into_bytes(),
        gzip(carmen(6, 20).as_bytes()),
        player(6).into_bytes(),
        std::fs::read(&csv).unwrap(),
        std::fs::read(&bag).unwrap(),
        mcap("sensor_msgs/MultiEchoLaserScan", "ros1", &vec![echo; 6]),
    ]
}

/// Reads everything there is to read; the stream must end.
fn read_all(bytes: &[u8]) {
    let (_directory, path) = file(bytes);
    let Ok(recording) = Recording::open(&path) else { return };
    let (mut count, mut is_over) = (0, false);
    for item in recording.scans() {
        assert!(!is_over, "the stream goes on behind its end");
        is_over = item.is_err_and(|error| error.ends_the_stream());
        count += 1;
        assert!(count < 10_000);
    }
    let _ = RecordingInfo::look(&recording, false, |bytes| assert!(bytes <= recording.bytes()));
    let _ = RecordingIndex::scan(&recording, |_| Some(Pose::default()));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn any_recording_with_wrong_bytes_is_read_or_refused(
        wrong in prop::collection::vec((0.0..1.0_f64, any::<u8>()), 1..8),
        cut in 0.0..1.2_f64,
    ) {
        for mut bytes in samples() {
            for (place, byte) in &wrong {
                let at = (place * bytes.len() as f64) as usize;
                bytes[at] = *byte;
            }
            bytes.truncate((cut * bytes.len() as f64) as usize);
            read_all(&bytes);
        }
    }

    #[test]
    fn any_text_is_read_or_refused(
        tail in "[0-9 .,;\\n\"eE+-]{0,200}|\\PC{0,80}|[a-z0-9,:*=.]{0,40}",
    ) {
        for head in [
            "FLASER ", "ROBOTLASER1 4 -1 2 ", "RAWLASER1 0 0 0 1 8 0 0 ", "t,laser,r...,angle_min=0\n",
            "t,angle_min,angle_increment,range_max,r...\n1,0,0.1,8,", "## Player version\n## File version 0.3\n",
            "## Player version\n## File version 0.3\n1 1 6665 laser 0 1 1 0 ", "",
        ] {
            read_all(format!("{head}{tail}\n").as_bytes());
            read_all(&gzip(format!("{head}{tail}").as_bytes()));
        }
        let _ = tail.parse::<ColumnMap>();
    }
}

#[test]
fn logs_that_are_cut_say_so() {
    for bytes in
        [carmen(5, 20).into_bytes(), player(5).into_bytes(), gzip(carmen(9, 181).as_bytes())]
    {
        let whole = read(&bytes).0;
        for cut in (0..20).map(|part| bytes.len() - 1 - part * (bytes.len() / 30)) {
            let (scans, errors) = read(&bytes[..cut]);
            let text = |scans: &[RecordedScan]| format!("{scans:?}"); // NaN is not NaN
            assert_eq!(text(&scans), text(&whole[..scans.len()]), "cut at {cut}");
            // A text that is cut between two lines is a shorter text.
            if bytes[cut - 1] != b'\n' {
                assert!(errors.iter().any(RecordingError::is_cut), "cut at {cut}: {errors:?}");
            }
        }
    }
    let bytes = samples().remove(4);
    let (scans, errors) = read(&bytes[..bytes.len() - 4096]);
    assert!(errors.iter().all(RecordingError::is_cut) && errors.len() == 1, "{errors:?}");
    assert!(scans.len() <= 12);
}

#[test]
fn what_unpacks_to_more_than_any_recording_is_refused_before_it_is_unpacked() {
    // A chunk of MCAP that announces 8 GB behind 100 bytes of zstd.
    let mut chunk =
        [0_u64.to_le_bytes(), 0_u64.to_le_bytes(), (8_u64 << 30).to_le_bytes()].concat();
    chunk.extend(0_u32.to_le_bytes());
    chunk.extend([4, 0, 0, 0, b'z', b's', b't', b'd']);
    chunk.extend(100_u64.to_le_bytes());
    chunk.extend([0x28; 100]);
    let mut bytes = b"\x89MCAP0\r\n".to_vec();
    bytes.push(6);
    bytes.extend((chunk.len() as u64).to_le_bytes());
    bytes.extend(chunk);
    let error = read(&bytes).1[0].to_string();
    assert!(error.contains("unpack to 8589934592 bytes, expected at most"), "{error}");
    // Chunks of a bag that announce 4 GB each.
    let record = common::chunk(&[], "lz4");
    let at = record.windows(5).position(|part| part == b"size=").unwrap() + 5;
    let mut big = record.clone();
    big[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
    let error = read(&common::bag(&[big], &[])).1[0].to_string();
    assert!(error.contains("unpack to 4294967295 bytes"), "{error}");
}

#[test]
fn still_scans_that_pack_well_are_not_taken_for_a_bomb() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("still.mcap");
    let mut writer = ScanWriter::create(&path).unwrap();
    let topic = ScanTopic { topic: "/scan".into(), frame_id: "laser".into(), scan_time_s: 0.02 };
    let number = writer.add_topic(topic).unwrap();
    let mut scan = read(&scan_bag(&[Fields::default().ros1()], "none")).0.remove(0).scan;
    scan.ranges_m = vec![f32::INFINITY; 4096];
    for turn in 0..8_000 {
        scan.stamp_ns = 1_700_000_000_000_000_000 + turn * 20_000_000;
        writer.write(number, scan.stamp_ns, &scan.view()).unwrap();
    }
    writer.finish().unwrap();
    let recording = Recording::open(&path).unwrap();
    assert!(recording.bytes() < 2_000_000, "131 MB of scans in {} bytes", recording.bytes());
    assert_eq!(recording.scans().filter(Result::is_ok).count(), 8_000);
}

#[test]
fn a_large_mcap_is_answered_from_its_index_as_from_all_its_scans() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("large.mcap");
    let mut writer = ScanWriter::create(&path).unwrap();
    let mut scan = read(&scan_bag(&[Fields::default().ros1()], "none")).0.remove(0).scan;
    for topic in ["/a", "/b"] {
        let frame_id = format!("laser{topic}");
        writer.add_topic(ScanTopic { topic: topic.into(), frame_id, scan_time_s: 0.1 }).unwrap();
    }
    for turn in (0..12_000_u64).filter(|turn| !(500..520).contains(turn)) {
        scan.stamp_ns = 1_700_000_000_000_000_000 + turn * 100_000_000;
        for topic in [0, 1] {
            writer.write(topic, scan.stamp_ns, &scan.view()).unwrap();
        }
    }
    writer.finish().unwrap();
    let recording = Recording::open(&path).unwrap();
    let [by_index, whole] =
        [false, true].map(|is_whole| RecordingInfo::look(&recording, is_whole, |_| ()).unwrap());
    let sample = by_index.sample.unwrap();
    assert!(sample.chunks == 24 && sample.of_chunks > 1000 && sample.scans > 100, "{sample:?}");
    assert_eq!((whole.sample, &by_index.topics), (None, &whole.topics));
    assert_eq!(by_index.topics[1].frame_id, "laser/b");
    assert_eq!((by_index.topics[0].gaps, by_index.topics[0].scans), (1, 11_980));
    assert!((by_index.topics[0].rate_hz - 10.0).abs() < 1e-9);
}

/// Format, lasers and scans; or words of the refusal.
type Expected = Result<(Format, usize, u64), &'static str>;

#[test]
fn every_file_of_the_folder_is_read_or_refused_with_a_reason() {
    let Some(root) = shared("README.md").map(|path| path.parent().unwrap().to_owned()) else {
        return;
    };
    let expected: [(&str, Expected); 21] = [
        ("README.md", Err("begins with \"# Real recor")),
        ("carmen/intel-corrected.log.gz", Ok((Format::Carmen, 1, 910))),
        ("carmen/orebro-corrected.log.gz", Err("both its time stamps are 0")),
        ("datmo/82c2bc_two_robots.bag", Ok((Format::Ros1Bag, 1, 388))),
        (
            "leigh_leg_tracker/demo_stationary_simple_environment.bag",
            Ok((Format::Ros1Bag, 1, 1265)),
        ),
        ("leigh_leg_tracker/negative_2_first_30s.bag", Ok((Format::Ros1Bag, 3, 677))),
        ("leigh_leg_tracker/positive_1.bag", Ok((Format::Ros1Bag, 1, 400))),
        ("leigh_leg_tracker/positive_2.bag", Ok((Format::Ros1Bag, 1, 243))),
        ("leigh_leg_tracker/positive_3.bag", Ok((Format::Ros1Bag, 1, 345))),
        ("leigh_leg_tracker/positive_5.bag", Ok((Format::Ros1Bag, 1, 296))),
        ("mrpt/localization_demo.rawlog", Err("an MRPT rawlog")),
        ("mrpt/malaga_2006_sick.rawlog", Err("an MRPT rawlog")),
        ("scan_tools/laser_scan_matcher_demo.bag", Ok((Format::Ros1Bag, 1, 360))),
        ("scan_tools/laser_scan_splitter_demo.bag", Ok((Format::Ros1BagV1, 1, 123))),
        ("sick_cola/20210113_tim871s_elephant.pcapng.json", Err("a network capture as JSON")),
        ("sick_cola/20210302_lms111.pcapng.json", Err("a network capture as JSON")),
        ("sick_cola/20210302_lms511.pcapng.json", Err("a network capture as JSON")),
        (
            "sick_cola/20221018_rms_1xxx_ascii_rms2_objects.pcapng.json",
            Err("a network capture as JSON"),
        ),
        ("sick_cola/empty_ros1.bag", Err("holds no laser scans: it is empty")),
        ("sick_cola/test.pcapng", Err("a network capture (pcapng)")),
        ("tysik_two_laser/scans_demo.bag", Ok((Format::Ros1Bag, 2, 661))),
    ];
    let mut there = Vec::new();
    let mut open = vec![root.clone()];
    while let Some(directory) = open.pop() {
        for entry in std::fs::read_dir(directory).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { open.push(path) } else { there.push(path) }
        }
    }
    there.sort();
    let names = there.iter().map(|path| path.strip_prefix(&root).unwrap().to_str().unwrap());
    assert_eq!(
        names.collect::<Vec<_>>(),
        expected.map(|(name, _)| name),
        "every file is named here"
    );
    for (path, (name, expected)) in there.iter().zip(expected) {
        let found = Recording::open(path).and_then(|recording| {
            let index = RecordingIndex::scan(&recording, |_| None)?;
            assert!(index.early_end.is_none(), "{name}");
            let scans = index.topics.iter().map(|topic| topic.scans).sum();
            Ok((recording.format(), index.topics.len(), scans))
        });
        match (found, expected) {
            (Ok(found), Ok(expected)) => assert_eq!(found, expected, "{name}"),
            (Err(error), Err(words)) => {
                assert!(error.to_string().contains(words), "{name}: {error}")
            }
            (found, expected) => panic!("{name}: found {found:?}, expected {expected:?}"),
        }
    }
}
