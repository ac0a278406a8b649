#![no_main]
//! A file of a stranger as a recording, of whatever format its first bytes say: every message is a
//! scan or is refused in words, and the stream ends. What the index counts is what the stream had.

use protocol::geometry::Pose;
use protocol::scan::BEAMS_MAX;
use recording::{Recording, RecordingIndex, RecordingInfo};
use std::fs::File;
use std::io::Write;
use std::path::PathBuf;

/// A file of this process: in memory where the system has such a place.
fn path() -> PathBuf {
    let memory = PathBuf::from("/dev/shm");
    let directory = if memory.is_dir() { memory } else { std::env::temp_dir() };
    directory.join(format!("tog_fuzz_recording_{}", std::process::id()))
}

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let path = path();
    File::create(&path).expect("a file").write_all(bytes).expect("room for a file");
    // What stands there is written over by the next: a database is opened by its name.
    let recording = match Recording::open(&path) {
        Ok(recording) => recording,
        Err(error) => return assert!(!error.to_string().is_empty()),
    };
    let (mut delivered, mut is_over) = (0, false);
    let mut scans = recording.scans();
    while let Some(item) = scans.next() {
        assert!(!is_over, "the stream goes on behind its end");
        assert!(scans.position_bytes() <= recording.bytes());
        match item {
            Ok(found) => {
                delivered += 1;
                assert_eq!(scans.topics()[found.topic_index], found.topic);
                assert!(!found.scan.ranges_m.is_empty() && found.scan.ranges_m.len() <= BEAMS_MAX);
                assert!(found.scan.geometry.check().is_ok());
            }
            Err(error) => {
                assert!(!error.to_string().is_empty());
                is_over = error.ends_the_stream();
            }
        }
    }
    let _ = recording.select_topic(None);
    let _ = RecordingInfo::look(&recording, false, |_| ());
    if let Ok(index) = RecordingIndex::scan(&recording, |_| Some(Pose::default())) {
        assert_eq!(index.topics.iter().map(|topic| topic.scans).sum::<u64>(), delivered);
        for topic in &index.topics {
            assert!(topic.last_stamp_ns >= topic.first_stamp_ns && topic.rate_hz() >= 0.0);
            let _ = topic.extent.area(0.1);
        }
    } else {
        assert_eq!(delivered, 0);
    }
});
