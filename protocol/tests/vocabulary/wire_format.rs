//! The bytes of each message, as they are. They lie in journals and come from other hosts: if a line
//! here must change, the version of the message (`Encoded::VERSION`) must grow with it.

use super::samples;
use protocol::codec::{Encoded, decode, encode};
use protocol::event::{EventKind, EventState};
use protocol::health::ServiceState;
use std::fmt::Debug;

fn hex(bytes: &[u8]) -> String {
    let bytes: Vec<String> = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    bytes.chunks(32).map(|line| line.join(" ")).collect::<Vec<_>>().join("\n")
}

fn check<M: Encoded + Debug + PartialEq>(message: &M, expected: &str) {
    let bytes = encode(message).unwrap();
    let lines: Vec<&str> = expected.lines().map(str::trim).filter(|l| !l.is_empty()).collect();
    assert_eq!(hex(&bytes), lines.join("\n"), "{}", M::NAME);
    assert_eq!(decode::<M>(&bytes).unwrap(), *message);
}

#[test]
fn a_scan_of_version_1_has_these_bytes() {
    check(&samples::scan(), "54 47 01 01 3b 00 00 00 80 cf fe a7 a4 de b2 c3 18 2a 00 00 00 00 00 00 f8 bf 00 00 00 00 00 00
         d0 3f 00 00 00 00 00 00 c0 3f 00 00 00 00 00 00 20 40 04 00 00 80 3f 00 00 80 7f 00 00 80 ff 00
         00 00 3f");
}

#[test]
fn an_event_of_version_1_has_these_bytes() {
    check(&samples::event(), "54 47 02 01 81 00 00 00 05 66 6f 79 65 72 07 07 66 6f 79 65 72 2d 33 01 01 80 cf fe a7 a4 de b2
         c3 18 80 df f8 cd f7 dd b2 c3 18 05 66 6f 79 65 72 01 04 64 6f 6f 72 00 00 00 00 00 00 f8 3f 00
         00 00 00 00 00 02 c0 00 00 00 00 00 00 f0 3f 00 00 00 00 00 00 04 c0 00 00 00 00 00 00 00 40 00
         00 00 00 00 00 00 c0 00 00 00 00 00 00 29 40 00 00 00 00 00 00 24 40 01 10 53 6f 6d 65 62 6f 64
         79 20 73 74 61 6e 64 73 2e");
}

#[test]
fn an_acknowledgement_of_version_1_has_these_bytes() {
    check(&samples::acknowledgement(), "54 47 03 01 08 00 00 00 05 66 6f 79 65 72 ac 02");
}

#[test]
fn health_of_version_1_has_these_bytes() {
    check(&samples::health(), "54 47 04 01 7e 00 00 00 0c 66 75 73 69 6f 6e 20 66 6f 79 65 72 e1 21 80 cf fe a7 a4 de b2 c3 18
         81 cf fe a7 a4 de b2 c3 18 02 02 0a 66 72 61 6d 65 73 5f 6f 75 74 0a 08 73 63 61 6e 73 5f 69 6e
         c8 01 01 0c 73 63 61 6e 5f 72 61 74 65 5f 68 7a 00 00 00 00 00 00 23 40 01 0c 6c 61 73 65 72 5f
         73 69 6c 65 6e 74 16 66 72 6f 6e 74 3a 20 6e 6f 20 73 63 61 6e 20 66 6f 72 20 33 20 73 fd ce fe
         a7 a4 de b2 c3 18");
}

#[test]
fn a_carried_scan_of_version_2_has_these_bytes() {
    check(&samples::carried_scan(), "54 47 05 02 4d 00 00 00 05 66 72 6f 6e 74 80 cf fe a7 a4 de b2 c3 18 ac 02 01 80 cf fe a7 a4 de
         b2 c3 18 2a 00 00 00 00 00 00 f8 bf 00 00 00 00 00 00 d0 3f 00 00 00 00 00 00 c0 3f 00 00 00 00
         00 00 20 40 04 00 00 80 3f 00 00 80 7f 00 00 80 ff 00 00 00 3f");
}

#[test]
fn a_page_of_events_of_version_2_has_these_bytes() {
    check(&samples::event_page(), "54 47 06 02 93 00 00 00 04 64 65 73 6b 80 cf fe a7 a4 de b2 c3 18 07 09 01 08 05 66 6f 79 65 72
         07 07 66 6f 79 65 72 2d 33 01 01 80 cf fe a7 a4 de b2 c3 18 80 df f8 cd f7 dd b2 c3 18 05 66 6f
         79 65 72 01 04 64 6f 6f 72 00 00 00 00 00 00 f8 3f 00 00 00 00 00 00 02 c0 00 00 00 00 00 00 f0
         3f 00 00 00 00 00 00 04 c0 00 00 00 00 00 00 00 40 00 00 00 00 00 00 00 c0 00 00 00 00 00 00 29
         40 00 00 00 00 00 00 24 40 01 10 53 6f 6d 65 62 6f 64 79 20 73 74 61 6e 64 73 2e");
}

/// Variants are numbers on the wire: a new one is appended, none is removed or moved.
#[test]
fn the_numbers_and_names_of_all_variants_stay() {
    fn number<T: serde::Serialize>(value: T) -> u8 {
        let bytes = postcard::to_extend(&value, Vec::new()).unwrap();
        assert_eq!(bytes.len(), 1);
        bytes[0]
    }
    let name = |value: serde_json::Value| value.as_str().unwrap().to_owned();
    let kinds: Vec<String> = samples::KINDS
        .iter()
        .map(|kind| format!("{} {}", number(kind), name(serde_json::to_value(kind).unwrap())))
        .collect();
    assert_eq!(
        kinds.join(", "),
        "0 unusual_activity, 1 loitering, 2 object_left, 3 object_missing, 4 door_held_open, \
         5 crowd, 6 laser_silent, 7 laser_stuck, 8 laser_blocked, 9 laser_blinded, \
         10 laser_moved, 11 coverage_lost, 12 process_restarted, 13 storage_fault"
    );
    let next = postcard::from_bytes::<EventKind>(&[samples::KINDS.len() as u8]);
    assert!(next.is_err(), "a kind is missing in this test: {next:?}");
    let states = [EventState::Raised, EventState::Updated, EventState::Cleared];
    assert_eq!(states.map(number), [0, 1, 2]);
    let states = [
        ServiceState::Starting,
        ServiceState::Running,
        ServiceState::Degraded,
        ServiceState::Ended,
    ];
    assert_eq!(states.map(number), [0, 1, 2, 3]);
}

#[test]
fn the_kind_in_words_is_the_name_without_underscores() {
    for kind in samples::KINDS {
        let name = serde_json::to_value(kind).unwrap();
        assert_eq!(kind.words(), name.as_str().unwrap().replace('_', " "));
        let fault = format!("{kind:?}");
        let is_fault = ["Laser", "Coverage", "Process", "Storage"]
            .iter()
            .any(|prefix| fault.starts_with(prefix));
        assert_eq!(kind.is_fault(), is_fault, "{fault}");
    }
}

#[test]
fn claims_of_version_1_have_these_bytes() {
    check(
        &samples::claims(),
        "54 47 07 01 1c 00 00 00 04 64 65 73 6b 01 05 66 6f 79 65 72 04 01 00 01 01 80 cf fe a7 a4 de b2
         c3 18 ac 02",
    );
}

#[test]
fn a_page_of_a_file_of_version_1_has_these_bytes() {
    check(
        &samples::file_page(),
        "54 47 08 01 18 00 00 00 05 66 6f 79 65 72 01 80 cf fe a7 a4 de b2 c3 18 ac 02 a9 02 03 01 02 03",
    );
}

#[test]
fn ownership_of_version_1_has_these_bytes() {
    check(&samples::ownership(), "54 47 09 01 08 00 00 00 01 05 66 6f 79 65 72 01");
}

#[test]
fn health_of_a_host_of_version_1_has_these_bytes() {
    check(&samples::host_health(), "54 47 0a 01 83 00 00 00 04 65 64 67 65 0c 66 75 73 69 6f 6e 20 66 6f 79 65 72 e1 21 80 cf fe a7
         a4 de b2 c3 18 81 cf fe a7 a4 de b2 c3 18 02 02 0a 66 72 61 6d 65 73 5f 6f 75 74 0a 08 73 63 61
         6e 73 5f 69 6e c8 01 01 0c 73 63 61 6e 5f 72 61 74 65 5f 68 7a 00 00 00 00 00 00 23 40 01 0c 6c
         61 73 65 72 5f 73 69 6c 65 6e 74 16 66 72 6f 6e 74 3a 20 6e 6f 20 73 63 61 6e 20 66 6f 72 20 33
         20 73 fd ce fe a7 a4 de b2 c3 18");
}

#[test]
fn a_carried_map_of_version_1_has_these_bytes() {
    check(&samples::carried_map(), "54 47 0b 01 26 00 00 00 04 64 65 73 6b 05 66 6f 79 65 72 01 80 cf fe a7 a4 de b2 c3 18 ac 02 07
         80 c2 d7 2f 05 01 06 14 0a 00 02 03 ac 02");
}

#[test]
fn carried_counts_of_version_1_have_these_bytes() {
    check(&samples::carried_counts(), "54 47 0c 01 1d 00 00 00 04 64 65 73 6b 05 66 6f 79 65 72 07 80 c2 d7 2f 01 06 14 0a e8 07 02 96
         01 00 32 ac 02");
}
