//! Recordings that were cut, damaged, or are none at all.
#![allow(clippy::unwrap_used)]

use protocol::scan::{LaserScan, ScanGeometry};
use recording::ros2::MessageType;
use recording::{
    McapWriter, Recording, RecordingError, TopicSpec, encode_scan, file_facts, recover,
};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const START_NS: u64 = 1_767_225_600_000_000_000;
const SECOND_NS: u64 = 1_000_000_000;
const SECONDS: u64 = 20;
const RATE_HZ: u64 = 10;
const BEAMS: usize = 60;

fn scan(number: u64) -> LaserScan {
    let noise = |beam: usize| {
        let mixed = (number * 31 + beam as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
        1.0 + (mixed % 1000) as f32 * 0.001
    };
    LaserScan {
        stamp_ns: START_NS + number * SECOND_NS / RATE_HZ,
        geometry: ScanGeometry {
            angle_min_rad: -1.5,
            angle_increment_rad: 0.05,
            range_min_m: 0.0,
            range_max_m: 8.0,
        },
        ranges_m: (0..BEAMS).map(noise).collect(),
        ..LaserScan::default()
    }
}

/// Twenty seconds of two lasers with a chunk a second, an attachment and metadata. Behind how many
/// bytes how many messages are safe.
fn recorded(path: &Path) -> Vec<(u64, u64)> {
    let mut writer = McapWriter::create(path).unwrap();
    writer.attach("site.toml", "application/toml", START_NS, b"name = \"x\"").unwrap();
    let session = BTreeMap::from([("site".to_owned(), "x".to_owned())]);
    writer.metadata("tog.session", &session).unwrap();
    let topics = ["/laser_a/scan", "/laser_b/scan"]
        .map(|name| writer.add_topic(&TopicSpec::new(name, MessageType::LaserScan)).unwrap());
    let (mut bytes, mut safe) = (Vec::new(), vec![(0, 0)]);
    for number in 0..SECONDS * RATE_HZ {
        let scan = scan(number);
        encode_scan("laser", 0.1, &scan.view(), &mut bytes).unwrap();
        for topic in topics {
            writer.write(topic, scan.stamp_ns, scan.stamp_ns, &bytes).unwrap();
        }
        if (number + 1) % RATE_HZ == 0 {
            writer.flush().unwrap();
            safe.push((writer.bytes(), writer.facts().messages));
        }
    }
    writer.finish().unwrap().store().unwrap();
    safe
}

fn scans(path: &Path) -> Vec<(String, LaserScan)> {
    let found = Recording::open(path).unwrap().scans().map(Result::unwrap);
    found.map(|found| (found.topic.to_string(), found.scan)).collect()
}

struct Room {
    dir: tempfile::TempDir,
    whole: PathBuf,
    safe: Vec<(u64, u64)>,
}

impl Room {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let whole = dir.path().join("whole.mcap");
        let safe = recorded(&whole);
        Self { dir, whole, safe }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }
}

#[test]
fn a_recording_cut_at_any_of_two_hundred_places_keeps_its_last_whole_second() {
    let room = Room::new();
    let whole = fs::read(&room.whole).unwrap();
    let all = scans(&room.whole);
    let (cut, saved) = (room.path("cut.mcap.active"), room.path("saved.mcap"));
    // From behind the magic to the last byte but one, never twice at the same place.
    for place in 0..200 {
        let bytes = 8 + place * (whole.len() - 9) / 199;
        fs::write(&cut, &whole[..bytes]).unwrap();
        let recovered = recover(&cut, &saved, |_, _| {}).unwrap();
        let expected =
            room.safe.iter().filter(|(end, _)| *end <= bytes as u64).map(|(_, m)| *m).max();
        let found = recovered.facts.messages;
        assert!(found >= expected.unwrap(), "cut at {bytes}: {found}, expected {expected:?}");
        assert!(!recovered.was_complete && recovered.damaged == 0, "{recovered:?}");
        assert_eq!(scans(&saved), all[..found as usize], "cut at {bytes}");
        assert_eq!(file_facts(&saved).unwrap(), recovered.facts);
        let last_ns = all[..found as usize].last().map_or(0, |(_, scan)| scan.stamp_ns);
        assert_eq!(recovered.facts.last_ns, last_ns);
        assert_eq!(fs::read(&cut).unwrap(), whole[..bytes], "the original is as it was");
    }
}

#[test]
fn a_complete_recording_is_left_alone() {
    let room = Room::new();
    let recovered = recover(&room.whole, &room.path("saved.mcap"), |_, _| {}).unwrap();
    assert!(recovered.was_complete && recovered.bytes_lost == 0);
    assert_eq!(recovered.facts.messages, 2 * SECONDS * RATE_HZ);
    assert!(!room.path("saved.mcap").exists());
}

#[test]
fn attachments_metadata_and_profile_survive() {
    let room = Room::new();
    let whole = fs::read(&room.whole).unwrap();
    let (cut, saved) = (room.path("cut.mcap"), room.path("saved.mcap"));
    fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
    recover(&cut, &saved, |_, _| {}).unwrap();
    let attached = recording::attachment(&saved, "site.toml").unwrap().unwrap();
    assert_eq!(attached.bytes, b"name = \"x\"");
    let summary = mcap::Summary::read(&fs::read(&saved).unwrap()).unwrap().unwrap();
    assert_eq!(summary.metadata_indexes[0].name, "tog.session");
    let bytes = fs::read(&saved).unwrap();
    assert!(bytes[..64].windows(4).any(|window| window == b"ros2"), "the profile");
}

#[test]
fn a_damaged_chunk_costs_its_second_and_no_other() {
    let room = Room::new();
    let mut whole = fs::read(&room.whole).unwrap();
    // In the middle of the fourth chunk, far from its header.
    let place = (room.safe[3].0 + (room.safe[4].0 - room.safe[3].0) / 2) as usize;
    whole[place] ^= 0xff;
    let (bad, saved) = (room.path("bad.mcap"), room.path("saved.mcap"));
    fs::write(&bad, &whole).unwrap();
    let recovered = recover(&bad, &saved, |_, _| {}).unwrap();
    assert!(!recovered.was_complete);
    assert_eq!(recovered.damaged, 1, "{recovered:?}");
    assert_eq!(recovered.facts.messages, 2 * (SECONDS - 1) * RATE_HZ);
}

/// Sixty-four bytes of zeros: in the chunk, over its head, over everything up to the next one.
#[test]
fn a_damaged_first_chunk_costs_its_second_and_the_definitions_are_known_anyway() {
    let room = Room::new();
    let whole = fs::read(&room.whole).unwrap();
    let magic = |byte: usize| {
        whole[byte] == 6
            && whole[byte..]
                .get(41..50)
                .is_some_and(|head| head.windows(4).any(|word| word == b"zstd"))
    };
    let chunk = (8..whole.len()).find(|at| magic(*at)).unwrap();
    let (bad, saved) = (room.path("bad.mcap"), room.path("saved.mcap"));
    let all = scans(&room.whole);
    let second = 2 * RATE_HZ as usize;
    for hole in [chunk, chunk + 5, chunk + 100, chunk + 1000] {
        // Complete but for the hole, and cut besides: then no index helps.
        for cut in [whole.len(), room.safe[15].0 as usize] {
            let mut with_hole = whole[..cut].to_vec();
            with_hole[hole..hole + 64].fill(0);
            fs::write(&bad, with_hole).unwrap();
            let recovered = recover(&bad, &saved, |_, _| {}).unwrap();
            let seconds = if cut == whole.len() { SECONDS as usize } else { 15 };
            assert_eq!(recovered.damaged, 1, "{hole}: {recovered:?}");
            assert!(recovered.bytes_damaged > 1000 && recovered.chunks > 10, "{recovered:?}");
            assert_eq!(scans(&saved), all[second..seconds * second], "hole at {hole}");
            // What was recovered is as hard to hurt as the original.
            let mut again = fs::read(&saved).unwrap();
            let chunk = (8..again.len())
                .find(|at| again[*at] == 6 && again[*at..][..60].windows(4).any(|w| w == b"zstd"))
                .unwrap();
            again[chunk + 300..chunk + 364].fill(0);
            fs::write(&bad, again).unwrap();
            let twice = room.path("twice.mcap");
            recover(&bad, &twice, |_, _| {}).unwrap();
            assert_eq!(scans(&twice), all[2 * second..seconds * second]);
        }
    }
}

#[test]
fn garbage_is_refused_or_gives_an_empty_recording() {
    let room = Room::new();
    let (file, saved) = (room.path("x.mcap"), room.path("saved.mcap"));
    for text in [&b""[..], b"\x89MCAP", b"hello", b"#ROSBAG V2.0\n"] {
        fs::write(&file, text).unwrap();
        let error = recover(&file, &saved, |_, _| {}).unwrap_err();
        assert!(matches!(error, RecordingError::NotMcap { .. }), "{error}");
        assert!(!saved.exists());
    }
    let whole = fs::read(&room.whole).unwrap();
    for hole in [8, 200, 3000] {
        let mut with_hole = whole[..hole].to_vec();
        with_hole.resize(whole.len(), 0);
        fs::write(&file, with_hole).unwrap();
        let recovered = recover(&file, &saved, |_, _| {}).unwrap();
        assert!(recovered.bytes_lost > 0);
    }
}

#[test]
fn what_is_being_written_is_not_recovered() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.mcap");
    let writer = McapWriter::create(&path).unwrap();
    let active = recording::active_path(&path);
    let error = recover(&active, &dir.path().join("y.mcap"), |_, _| {}).unwrap_err().to_string();
    assert!(error.contains("being written"), "{error}");
    let error = McapWriter::create(&path).err().unwrap().to_string();
    assert!(error.contains("another process writes it"), "{error}");
    drop(writer);
    recover(&active, &dir.path().join("y.mcap"), |_, _| {}).unwrap();
}

mod any_bytes {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        /// Bytes changed, cut out and put in anywhere: an error in words or a file that can be
        /// read back.
        #[test]
        fn are_taken(edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..20),
            cut in any::<prop::sample::Index>()) {
            let room = Room::new();
            let mut bytes = fs::read(&room.whole).unwrap();
            for (index, value) in edits {
                let at = index.index(bytes.len());
                bytes[at] = value;
            }
            bytes.truncate(cut.index(bytes.len()) + 1);
            let (bad, saved) = (room.path("bad.mcap"), room.path("saved.mcap"));
            fs::write(&bad, &bytes).unwrap();
            if let Ok(recovered) = recover(&bad, &saved, |_, _| {})
                && !recovered.was_complete {
                prop_assert_eq!(file_facts(&saved).unwrap().messages, recovered.facts.messages);
            }
        }
    }
}

#[test]
fn only_files_are_replaced() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    std::os::unix::fs::symlink(path("elsewhere"), path("link.mcap")).unwrap();
    fs::create_dir(path("dir.mcap")).unwrap();
    // As `mkfifo`: opening it would wait for a reader.
    for name in ["pipe.mcap", "x.mcap.active"] {
        let made = std::process::Command::new("mkfifo").arg(path(name)).status().unwrap();
        assert!(made.success());
    }
    for name in ["link.mcap", "dir.mcap", "pipe.mcap", "x.mcap"] {
        let error = McapWriter::create(path(name)).err().unwrap().to_string();
        assert!(error.contains("expected a file or nothing"), "{name}: {error}");
        let error = recording::CsvWriter::create(path(name), 3).err().unwrap().to_string();
        assert!(error.contains("expected a file or nothing"), "{name}: {error}");
    }
}
