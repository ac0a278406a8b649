#![allow(clippy::unwrap_used)]
use super::*;
use crate::intake::GAP_WAIT_NS;
use crate::journal::{Filter, JOURNAL_FILE};
use crate::testing::change;
use protocol::event::EventKind;
use protocol::time::SECOND_NS;

fn now(mono_s: u64) -> Now {
    Now { unix_ns: (1_795_000_000 + mono_s) * SECOND_NS, mono_ns: mono_s * SECOND_NS }
}

fn open(directory: &tempfile::TempDir) -> (Keeper, Report) {
    Keeper::open(&directory.path().join(JOURNAL_FILE), now(0)).unwrap()
}

fn acknowledged(report: &Report) -> Vec<(&str, u64)> {
    let all = report.acknowledgements.iter();
    all.map(|ack| (ack.origin.as_str(), ack.sequence)).collect()
}

fn told(report: &Report) -> Vec<(&str, u64, bool)> {
    let all = report.told.iter();
    all.map(|(change, journaled)| (change.origin.as_str(), change.sequence, *journaled)).collect()
}

fn journaled(keeper: &Keeper) -> Vec<(String, u64)> {
    let rows = keeper.after(0, 9999).unwrap().into_iter();
    let changes = rows.map(|row| row.change().unwrap());
    changes.map(|change| (change.origin, change.sequence)).collect()
}

#[test]
fn a_change_is_told_and_acknowledged_when_it_is_on_disk() {
    let directory = tempfile::tempdir().unwrap();
    let (mut keeper, report) = open(&directory);
    assert_eq!(acknowledged(&report), []);
    let report = keeper.offer(vec![change("foyer", 1)], now(1));
    assert_eq!(told(&report), [("foyer", 1, true)]);
    assert_eq!(acknowledged(&report), [("foyer", 1)]);
    let report = keeper.offer(vec![change("foyer", 1)], now(2));
    assert_eq!(told(&report), []);
    assert_eq!(acknowledged(&report), [("foyer", 1)], "its origin missed the acknowledgement");
    drop(keeper);
    let (keeper, report) = open(&directory);
    assert_eq!(acknowledged(&report), [("foyer", 1)], "at the start, for every known origin");
    assert_eq!(keeper.counters(), Counters::default());
}

#[test]
fn a_hole_asks_the_origin_again_and_is_given_up_loudly() {
    let directory = tempfile::tempdir().unwrap();
    let (mut keeper, _) = open(&directory);
    let report = keeper.offer(vec![change("foyer", 3)], now(1));
    assert_eq!((told(&report), acknowledged(&report)), (vec![], vec![("foyer", 0)]));
    assert_eq!(keeper.deadline_ns(), Some(SECOND_NS + GAP_WAIT_NS));
    let report = keeper.tick(now(13));
    assert!(report.warnings[0].contains("changes 1 to 2 of foyer"), "{:?}", report.warnings);
    assert_eq!(
        (told(&report), acknowledged(&report)),
        (vec![("foyer", 3, true)], vec![("foyer", 3)])
    );
    let report = keeper.offer(vec![change("foyer", 2)], now(14));
    assert_eq!(told(&report), [("foyer", 2, true)], "it came after all");
}

#[test]
fn while_the_disk_is_full_people_are_told_and_origins_are_not_acknowledged() {
    let directory = tempfile::tempdir().unwrap();
    let (mut keeper, _) = open(&directory);
    keeper.offer(vec![change("foyer", 1)], now(1));
    keeper.journal.as_ref().unwrap().set_pages_max(1).unwrap();
    let mut sequence = 1;
    let report = loop {
        sequence += 1;
        let report = keeper.offer(vec![change("foyer", sequence)], now(2));
        if report.faults_changed {
            break report;
        }
    };
    assert_eq!(told(&report), [("foyer", sequence, false), (ORIGIN, 1, false)]);
    assert_eq!(report.told[1].0.kind, EventKind::StorageFault);
    assert_eq!(acknowledged(&report), []);
    let fault = &keeper.faults()[0];
    assert_eq!(fault.code, "journal_unwritable");
    assert!(fault.text.contains("full"), "{}", fault.text);

    let report = keeper.offer(vec![change("foyer", sequence + 1)], now(2));
    assert_eq!(told(&report), [("foyer", sequence + 1, false)]);
    assert!(report.warnings.is_empty() && !report.faults_changed, "said once");
    assert_eq!(keeper.deadline_ns(), Some(3 * SECOND_NS));
    assert_eq!(told(&keeper.tick(now(3))), [], "still full");
    assert_eq!(keeper.deadline_ns(), Some(5 * SECOND_NS), "tried again, later each time");
    let pending: Vec<u64> = keeper.pending_after(1).map(|pending| pending.number).collect();
    assert_eq!(pending, [2, 3]);

    keeper.journal.as_ref().unwrap().set_pages_max(100_000).unwrap();
    let report = keeper.tick(now(5));
    assert_eq!(told(&report), [(ORIGIN, 2, true)], "the storage fault is over");
    assert_eq!(acknowledged(&report), [("foyer", sequence + 1)]);
    assert!(keeper.faults().is_empty() && keeper.backlog_len() == 0);
    let mut expected: Vec<(String, u64)> =
        (1..=sequence).map(|sequence| ("foyer".to_owned(), sequence)).collect();
    expected.extend([
        (ORIGIN.to_owned(), 1),
        ("foyer".to_owned(), sequence + 1),
        (ORIGIN.to_owned(), 2),
    ]);
    assert_eq!(journaled(&keeper), expected, "in the order in which people were told");
    let open_events = Filter { open_only: true, limit: 9999, ..Filter::default() };
    let left = keeper.journal.as_ref().unwrap().list(&open_events).unwrap();
    assert!(left.iter().all(|row| row.change().unwrap().kind != EventKind::StorageFault));
}

#[test]
fn a_full_backlog_refuses_and_the_origin_keeps_what_was_refused() {
    let directory = tempfile::tempdir().unwrap();
    let (mut keeper, _) = open(&directory);
    keeper.journal.as_ref().unwrap().set_pages_max(1).unwrap();
    let mut sequence = 0;
    let report = loop {
        sequence += 1;
        let report = keeper.offer(vec![change("foyer", sequence)], now(1));
        if keeper.counters().changes_refused > 0 {
            break report;
        }
    };
    assert_eq!(told(&report), []);
    assert!(report.warnings[0].contains("left with its origin"), "{:?}", report.warnings);
    keeper.journal.as_ref().unwrap().set_pages_max(100_000).unwrap();
    let report = keeper.tick(now(2));
    assert_eq!(acknowledged(&report), [("foyer", sequence - 1)], "so it sends the rest");
    assert_eq!(
        told(&keeper.offer(vec![change("foyer", sequence)], now(3))),
        [("foyer", sequence, true)]
    );
}

#[test]
fn a_directory_that_cannot_be_written_at_the_start_does_not_stop_the_feed() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("state").join(JOURNAL_FILE);
    std::fs::write(directory.path().join("state"), "in the way").unwrap();
    let (mut keeper, report) = Keeper::open(&path, now(0)).unwrap();
    assert!(report.faults_changed);
    assert!(keeper.faults()[0].text.contains("cannot be used"), "{:?}", keeper.faults());
    let report = keeper.offer(vec![change("foyer", 501)], now(0));
    assert_eq!((told(&report), acknowledged(&report)), (vec![("foyer", 501, false)], vec![]));

    std::fs::remove_file(directory.path().join("state")).unwrap();
    let report = keeper.tick(now(1));
    assert_eq!(told(&report), [(ORIGIN, 1, true), (ORIGIN, 2, true)], "raised and cleared");
    assert_eq!(acknowledged(&report), [("foyer", 0)], "1 to 500 may come yet");
    assert_eq!(journaled(&keeper)[0], ("foyer".to_owned(), 501));
}

#[test]
fn damage_at_the_start_is_said_and_the_next_change_is_taken_at_once() {
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join(JOURNAL_FILE), [0x5a; 9000]).unwrap();
    let (mut keeper, report) = open(&directory);
    assert!(report.warnings[0].contains("damaged-2026"), "{:?}", report.warnings);
    assert_eq!(told(&report), [(ORIGIN, 1, true), (ORIGIN, 2, true)]);
    let report = keeper.offer(vec![change("foyer", 501)], now(1));
    assert_eq!(
        (told(&report), acknowledged(&report)),
        (vec![("foyer", 501, true)], vec![("foyer", 501)])
    );
}

#[test]
fn damage_while_running_loses_no_change_that_comes_then() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(JOURNAL_FILE);
    let (mut keeper, _) = open(&directory);
    for sequence in 1..300 {
        keeper.offer(vec![change("foyer", sequence)], now(1));
    }
    drop(keeper);
    let (mut keeper, _) = open(&directory);
    // A write by somebody else empties the keeper's page cache, so that it meets the damage.
    let other = rusqlite::Connection::open(&path).unwrap();
    other.execute("UPDATE origin SET contiguous = contiguous", []).unwrap();
    other.query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |_| Ok(())).unwrap();
    let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    let length = file.metadata().unwrap().len();
    std::os::unix::fs::FileExt::write_all_at(&file, &vec![0x77; length as usize - 4096], 4096)
        .unwrap();
    let report = keeper.offer(vec![change("foyer", 300)], now(2));
    let told = told(&report);
    assert_eq!(told, [("foyer", 300, true), (ORIGIN, 1, true), (ORIGIN, 2, true)]);
    assert_eq!(acknowledged(&report), [("foyer", 300)]);
    assert!(report.warnings[0].contains("damaged"), "{:?}", report.warnings);
    assert_eq!(journaled(&keeper).len(), 3);
}

#[test]
fn a_journal_that_somebody_removes_while_running_is_written_again() {
    let directory = tempfile::tempdir().unwrap();
    let state = directory.path().join("state");
    let path = state.join(JOURNAL_FILE);
    let (mut keeper, _) = Keeper::open(&path, now(0)).unwrap();
    keeper.offer(vec![change("foyer", 1), change("foyer", 2)], now(1));
    std::fs::remove_dir_all(&state).unwrap();
    let report = keeper.offer(vec![change("foyer", 3)], now(2));
    assert_eq!(acknowledged(&report), [("foyer", 3)]);
    assert!(report.warnings[0].contains("was removed while the site runs"), "{report:?}");
    assert_eq!(keeper.faults(), [], "it is mended");
    drop(keeper);
    // What counts is what the next process finds.
    let (keeper, _) = Keeper::open(&path, now(3)).unwrap();
    let of_foyer: Vec<_> = journaled(&keeper).into_iter().filter(|row| row.0 == "foyer").collect();
    assert_eq!(of_foyer.iter().map(|row| row.1).collect::<Vec<_>>(), [1, 2, 3]);
    let own = journaled(&keeper).into_iter().filter(|row| row.0 == ORIGIN).count();
    assert_eq!(own, 2, "raised and cleared");
}

#[test]
fn a_journal_that_is_removed_is_back_before_the_next_event() {
    let directory = tempfile::tempdir().unwrap();
    let state = directory.path().join("state");
    let path = state.join(JOURNAL_FILE);
    let (mut keeper, _) = Keeper::open(&path, now(0)).unwrap();
    keeper.offer(vec![change("foyer", 1)], now(1));
    assert!(told(&keeper.look(now(2))).is_empty(), "all is well");
    std::fs::remove_dir_all(&state).unwrap();
    let report = keeper.look(now(3));
    assert!(report.warnings[0].contains("was removed while the site runs"), "{report:?}");
    assert_eq!(told(&report), [(ORIGIN, 1, true), (ORIGIN, 2, true)]);
    let reader = Journal::open_read_only(&path).unwrap();
    assert_eq!(reader.after(0, 10).unwrap().len(), 3);
}

#[test]
fn another_file_in_the_place_of_the_journal_is_not_written() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(JOURNAL_FILE);
    let (mut keeper, _) = open(&directory);
    std::fs::remove_file(&path).unwrap();
    std::fs::write(&path, "a backup").unwrap();
    let report = keeper.offer(vec![change("foyer", 1)], now(1));
    assert_eq!(told(&report)[0], ("foyer", 1, false));
    assert_eq!(acknowledged(&report), [], "its origin keeps it");
    assert!(keeper.faults()[0].text.contains("another file"), "{:?}", keeper.faults());
    assert_eq!(std::fs::read(&path).unwrap(), b"a backup");
}

#[test]
fn a_number_with_another_content_is_a_fault_and_is_said_in_full() {
    let directory = tempfile::tempdir().unwrap();
    let (mut keeper, _) = open(&directory);
    keeper.offer(vec![change("foyer", 1)], now(1));
    let mut other = change("foyer", 1);
    other.text = "a crowd of 7".to_owned();
    let report = keeper.offer(vec![other], now(1));
    assert!(report.warnings[0].contains("a crowd of 7"), "{:?}", report.warnings);
    assert_eq!(keeper.faults()[0].code, "sequence_reused");
}

#[test]
fn what_breaks_a_bound_is_refused_and_counted() {
    let directory = tempfile::tempdir().unwrap();
    let (mut keeper, _) = open(&directory);
    let report = keeper.offer(vec![change("foyer", 0)], now(1));
    assert!(report.warnings[0].contains("sequence 0"), "{:?}", report.warnings);
    assert_eq!(told(&keeper.offer(vec![change(ORIGIN, 1)], now(1))), []);
    assert_eq!(keeper.counters().changes_refused, 2);
}

#[test]
fn a_burst_is_journaled_in_order_whatever_is_in_it() {
    let directory = tempfile::tempdir().unwrap();
    let (mut keeper, _) = open(&directory);
    let burst = [1, 3, 2, 2, 5, 4, 1].map(|sequence| change("foyer", sequence)).to_vec();
    let report = keeper.offer(burst, now(1));
    assert_eq!(told(&report).iter().map(|told| told.1).collect::<Vec<_>>(), [1, 2, 3, 4, 5]);
    assert_eq!(keeper.counters().changes_duplicate, 2);
    assert_eq!(acknowledged(&report).last(), Some(&("foyer", 5)));
}

#[test]
fn a_host_that_is_missed_is_an_event_that_survives_a_restart() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(JOURNAL_FILE);
    let origin = "host.desk.alerts";
    let open = |mono_s| Keeper::open_as(origin, &path, now(mono_s)).unwrap().0;
    let mut keeper = open(0);
    let report = keeper.absence("edge", Some("nothing is heard".to_owned()), now(1));
    let (raised, journaled) = &report.told[0];
    assert!(*journaled && protocol::event::begins_numbering(raised.sequence));
    assert_eq!(
        (raised.kind, raised.text.as_str()),
        (EventKind::CoverageLost, "host edge: nothing is heard")
    );
    keeper.absence("yard", Some("nothing is heard".to_owned()), now(1));
    drop(keeper);
    let mut keeper = open(2);
    assert_eq!(keeper.missed_hosts(), ["edge", "yard"].map(str::to_owned).into());
    let report = keeper.absence("edge", None, now(3));
    let cleared = &report.told[0].0;
    assert_eq!((&cleared.id, cleared.state), (&raised.id, EventState::Cleared));
    assert_eq!(cleared.sequence, raised.sequence + 2);
    assert_eq!(open(4).missed_hosts(), ["yard".to_owned()].into());
}

#[test]
fn what_is_open_of_a_host_is_known() {
    let directory = tempfile::tempdir().unwrap();
    let (mut keeper, _) = Keeper::open(&directory.path().join(JOURNAL_FILE), now(0)).unwrap();
    let cleared =
        EventChange { id: "hall-1".to_owned(), state: EventState::Cleared, ..change("hall", 2) };
    keeper.offer(vec![change("hall", 1), cleared, change("hall", 3), change("yard", 1)], now(1));
    let open_of = |origin: &str| keeper.open_of(&[origin.to_owned()]);
    assert_eq!(open_of("hall").iter().map(|open| open.id.as_str()).collect::<Vec<_>>(), ["hall-3"]);
    assert_eq!((open_of("yard").len(), open_of("shop").len()), (1, 0));
}
