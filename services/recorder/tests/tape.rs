//! Files of a tape, with a clock that the test turns.
#![allow(clippy::unwrap_used)]

use recorder::attach::Attachment;
use recorder::shelf::{Scope, Shelf};
use recorder::tape::{Head, Limits, RETRY_NS, Stamps, Tape};
use recording::ros2::MessageType;
use recording::{BagDirectory, Kept, McapWriter, TopicSpec, active_path, file_facts};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const SECOND_NS: u64 = 1_000_000_000;
const START_NS: u64 = 1_767_225_600 * SECOND_NS;
const SCAN: usize = 0;
const MAP: usize = 1;

fn head() -> Head {
    Head {
        topics: vec![
            TopicSpec::new("/scan", MessageType::LaserScan),
            TopicSpec::new("/map", MessageType::OccupancyGrid).latched(),
        ],
        attachments: vec![Attachment {
            name: "site.toml",
            media_type: "application/toml",
            text: "name = \"t\"\n".to_owned(),
        }],
        session: BTreeMap::from([("site".to_owned(), "t".to_owned())]),
    }
}

fn limits(split_bytes: u64, seconds: u64) -> Limits {
    Limits { split_bytes, split_ns: seconds * SECOND_NS }
}

fn stamps(second: u64) -> Stamps {
    let log_ns = START_NS + second * SECOND_NS;
    Stamps { log_ns, publish_ns: log_ns - 5 }
}

/// Bytes that zstd cannot shorten.
fn noise(seed: u64, bytes: usize) -> Vec<u8> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state as u8
    };
    (0..bytes).map(|_| next()).collect()
}

fn tape(dir: &Path, limits: Limits) -> Tape {
    Tape::new(dir.join("t_2_s"), head(), limits, Shelf::start(None).unwrap())
}

fn counts_of(bag: &BagDirectory) -> Vec<(u64, u64)> {
    let of = |file: &recording::FileFacts, name: &str| {
        file.topics.iter().find(|topic| topic.name == name).unwrap().messages
    };
    bag.files().iter().map(|file| (of(file, "/scan"), of(file, "/map"))).collect()
}

#[test]
fn a_file_of_its_time_is_followed_by_one_that_begins_with_the_latched_messages() {
    let dir = tempfile::tempdir().unwrap();
    let mut tape = tape(dir.path(), limits(1 << 30, 10));
    tape.write(MAP, stamps(0), b"a map", 0);
    for second in 0..25 {
        tape.tick(stamps(second).log_ns, second * SECOND_NS);
        tape.write(SCAN, stamps(second), b"a scan", second * SECOND_NS);
    }
    let counts = tape.finish(25 * SECOND_NS);
    assert_eq!((counts.files, counts.splits, counts.messages_dropped), (3, 2, 0));
    assert_eq!(counts.messages_written, 25 + 3);
    assert_eq!(tape.problem(), None);
    let bag = BagDirectory::open(&dir.path().join("t_2_s")).unwrap();
    assert_eq!(counts_of(&bag), [(10, 1), (10, 1), (5, 1)]);
    assert_eq!(counts.bytes_written, bag.files().iter().map(|file| file.bytes).sum::<u64>());
    let yaml = fs::read_to_string(bag.path().join("metadata.yaml")).unwrap();
    assert!(yaml.contains("message_count: 28\n") && yaml.contains("t_2_s_2.mcap"), "{yaml}");
}

#[test]
fn a_file_of_its_size_is_followed_by_another() {
    let dir = tempfile::tempdir().unwrap();
    let mut tape = tape(dir.path(), limits(1_000_000, 1000));
    for second in 0..30 {
        tape.write(SCAN, stamps(second), &noise(second, 100_000), second * SECOND_NS);
        tape.tick(stamps(second).log_ns, second * SECOND_NS);
    }
    let counts = tape.finish(30 * SECOND_NS);
    let bag = BagDirectory::open(&dir.path().join("t_2_s")).unwrap();
    assert_eq!(counts.files, 3, "{bag:?}");
    assert!(bag.files().iter().all(|file| file.bytes < 1_300_000), "{bag:?}");
    assert_eq!(bag.files().iter().map(|file| file.messages).sum::<u64>(), 30);
}

#[test]
fn what_was_flushed_is_there_when_nobody_finishes() {
    let dir = tempfile::tempdir().unwrap();
    let mut tape = tape(dir.path(), limits(1 << 30, 1000));
    tape.write(SCAN, stamps(0), b"one", 0);
    let due = tape.deadline_mono_ns().unwrap();
    assert_eq!(due, SECOND_NS, "a second after the first message that is not flushed");
    tape.tick(stamps(1).log_ns, due);
    assert_eq!(tape.deadline_mono_ns(), None, "nothing to do until the next message");
    let active = active_path(&dir.path().join("t_2_s/t_2_s_0.mcap"));
    // As a kill leaves it: what is in the system, without an end. The file is locked, so a copy.
    let copy = dir.path().join("copy.mcap");
    fs::copy(&active, &copy).unwrap();
    let saved = dir.path().join("saved.mcap");
    let recovered = recording::recover(&copy, &saved, |_, _| {}).unwrap();
    assert!(!recovered.was_complete && recovered.facts.messages == 1, "{recovered:?}");
}

#[test]
fn a_directory_that_cannot_be_is_told_counted_and_tried_again() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("t_2_s"), "a file in the way").unwrap();
    let mut tape = tape(dir.path(), limits(1 << 30, 1000));
    for message in 0..5 {
        tape.write(SCAN, stamps(0), b"lost", message);
    }
    let text = tape.unwritable().unwrap().to_owned();
    assert!(text.contains("nothing is recorded") && text.contains("t_2_s"), "{text}");
    let counts = tape.counts();
    let found = (counts.messages_dropped, counts.writes_failed);
    assert_eq!(found, (5, 1), "tried once, not five times");
    assert_eq!(tape.deadline_mono_ns(), Some(RETRY_NS));
    fs::remove_file(dir.path().join("t_2_s")).unwrap();
    tape.tick(stamps(5).log_ns, RETRY_NS);
    assert_eq!(tape.unwritable(), None);
    tape.write(SCAN, stamps(6), b"kept", RETRY_NS + 1);
    assert_eq!(tape.finish(RETRY_NS + 2).messages_written, 1);
    let bag = BagDirectory::open(&dir.path().join("t_2_s")).unwrap();
    assert_eq!(counts_of(&bag), [(1, 0)]);
}

/// A session with complete files of about 100 kB each, and one that a kill left.
fn old_session(dir: &Path, name: &str, files: usize, cut: bool) -> PathBuf {
    let session = dir.join(name);
    let mut bag = BagDirectory::open(&session).unwrap();
    for number in 0..files as u64 {
        let mut writer = McapWriter::create(bag.next_path().unwrap()).unwrap();
        let topic = writer.add_topic(&head().topics[SCAN]).unwrap();
        let log_ns = START_NS + number * SECOND_NS;
        writer.write(topic, log_ns, log_ns, &noise(number, 100_000)).unwrap();
        bag.add(writer.finish().unwrap().store().unwrap()).unwrap();
    }
    if cut {
        let whole = bag.path().join(&bag.files()[0].name);
        let bytes = fs::read(whole).unwrap();
        fs::write(active_path(&bag.next_path().unwrap()), &bytes[..bytes.len() - 100]).unwrap();
    }
    bag.path().to_owned()
}

fn scope(dir: &Path, bytes_max: Option<u64>) -> Scope {
    let kept = Kept { bytes_max, age_max_ns: None };
    Scope { dir: dir.to_owned(), prefix: "t_2".to_owned(), kept, open_bytes: 0 }
}

#[test]
fn what_a_killed_recorder_left_is_complete_and_in_the_metadata_after_the_next_start() {
    let dir = tempfile::tempdir().unwrap();
    let session = old_session(dir.path(), "t_2020", 1, true);
    let foreign = old_session(dir.path(), "other_2020", 1, true);
    // Somebody is writing this one.
    let living = old_session(dir.path(), "t_2021", 0, false);
    let writer = McapWriter::create(living.join("t_2021_0.mcap")).unwrap();
    let mut shelf = Shelf::start(Some(scope(dir.path(), None))).unwrap();
    shelf.finish();
    let recovered = session.join("t_2020_1.mcap");
    assert_eq!(file_facts(&recovered).unwrap().messages, 1);
    assert!(!active_path(&recovered).exists(), "read back, then deleted");
    let yaml = fs::read_to_string(session.join("metadata.yaml")).unwrap();
    assert!(yaml.contains("t_2020_1.mcap"), "{yaml}");
    assert!(active_path(&foreign.join("other_2020_1.mcap")).exists(), "it is none of ours");
    assert!(active_path(writer.path()).exists(), "it lives");
}

#[test]
fn the_oldest_files_go_when_there_are_too_many_and_others_never() {
    let dir = tempfile::tempdir().unwrap();
    let old = old_session(dir.path(), "t_2020", 3, false);
    let foreign = old_session(dir.path(), "other", 2, false);
    fs::write(old.join("notes.txt"), "mine").unwrap();
    let mut shelf = Shelf::start(Some(scope(dir.path(), Some(250_000)))).unwrap();
    shelf.finish();
    let names = |bag: &Path| -> Vec<String> {
        BagDirectory::open(bag).unwrap().files().iter().map(|f| f.name.clone()).collect()
    };
    assert_eq!(names(&old), ["t_2020_1.mcap", "t_2020_2.mcap"]);
    assert_eq!(names(&foreign).len(), 2);
    let yaml = fs::read_to_string(old.join("metadata.yaml")).unwrap();
    assert!(!yaml.contains("t_2020_0.mcap") && yaml.contains("message_count: 2\n"), "{yaml}");
    let mut shelf = Shelf::start(Some(scope(dir.path(), Some(1)))).unwrap();
    shelf.finish();
    assert_eq!(names(&old), [""; 0]);
    assert_eq!(fs::read_to_string(old.join("notes.txt")).unwrap(), "mine");
}

#[test]
fn a_damaged_remain_is_kept_beside_what_was_saved_of_it() {
    let dir = tempfile::tempdir().unwrap();
    let session = old_session(dir.path(), "t_2020", 0, false);
    let orphan = active_path(&session.join("t_2020_0.mcap"));
    let mut writer = McapWriter::create(session.join("t_2020_0.mcap")).unwrap();
    let topic = writer.add_topic(&head().topics[SCAN]).unwrap();
    for second in 0..5 {
        writer.write(topic, START_NS, START_NS, &noise(second, 10_000)).unwrap();
        writer.flush().unwrap();
    }
    drop(writer);
    let mut bytes = fs::read(&orphan).unwrap();
    bytes[2000..2064].fill(0); // in the first chunk
    fs::write(&orphan, &bytes).unwrap();
    let mut shelf = Shelf::start(Some(scope(dir.path(), None))).unwrap();
    shelf.finish();
    assert_eq!(file_facts(&session.join("t_2020_0.mcap")).unwrap().messages, 4);
    assert_eq!(fs::read(session.join("t_2020_0.mcap.damaged")).unwrap(), bytes);
    assert!(!orphan.exists());
}

#[test]
fn a_directory_that_is_deleted_while_it_is_recorded_is_missed_within_a_second() {
    let dir = tempfile::tempdir().unwrap();
    let mut tape = tape(dir.path(), limits(1 << 30, 1000));
    tape.write(SCAN, stamps(0), b"lost", 0);
    fs::remove_dir_all(dir.path().join("t_2_s")).unwrap();
    tape.tick(stamps(1).log_ns, SECOND_NS);
    let text = tape.lost().unwrap().to_owned();
    assert!(text.contains("was deleted") && text.contains("1 messages are lost"), "{text}");
    tape.write(SCAN, stamps(2), b"kept", 2 * SECOND_NS);
    let counts = tape.finish(3 * SECOND_NS);
    let found = (counts.messages_written, counts.messages_dropped, counts.files);
    assert_eq!(found, (1, 1, 2));
    let bag = BagDirectory::open(&dir.path().join("t_2_s")).unwrap();
    assert_eq!(counts_of(&bag), [(1, 0)]);
}

#[test]
fn a_directory_that_is_deleted_or_moved_before_the_end_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let mut deleted = tape(dir.path(), limits(1 << 30, 1000));
    deleted.write(SCAN, stamps(0), b"lost", 0);
    fs::remove_dir_all(dir.path().join("t_2_s")).unwrap();
    assert_eq!(deleted.finish(1).messages_written, 0);
    assert!(deleted.problem().unwrap().contains("was deleted"), "{:?}", deleted.problem());

    let mut moved = tape(dir.path(), limits(1 << 30, 1000));
    moved.write(SCAN, stamps(0), b"moved", 0);
    fs::rename(dir.path().join("t_2_s"), dir.path().join("away")).unwrap();
    moved.tick(stamps(1).log_ns, SECOND_NS);
    assert!(moved.problem().unwrap().contains("tog bag recover"), "{:?}", moved.problem());
    moved.finish(2 * SECOND_NS);
    let away = active_path(&dir.path().join("away/t_2_s_0.mcap"));
    let recovered = recording::recover(&away, &dir.path().join("x.mcap"), |_, _| {}).unwrap();
    assert_eq!(recovered.facts.messages, 1);
}

#[test]
fn a_pipe_with_the_name_of_a_remain_is_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    let session = old_session(dir.path(), "t_2020", 1, false);
    let pipe = session.join("t_2020_5.mcap.active");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let mut shelf = Shelf::start(Some(scope(dir.path(), None))).unwrap();
    shelf.finish(); // it would wait for a writer for ever
    assert!(pipe.exists());
}
