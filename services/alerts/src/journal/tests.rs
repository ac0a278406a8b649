#![allow(clippy::unwrap_used)]
use super::*;
use crate::testing::change;
use protocol::event::{EventKind, EventState};

const NOW_NS: u64 = 1_795_000_000_000_000_000;
/// The rows of a new journal get ids above this one.
const BEGIN: u64 = NOW_NS / 1_000_000;

fn open(directory: &tempfile::TempDir) -> Journal {
    let (journal, damage) = Journal::open(&directory.path().join(JOURNAL_FILE), NOW_NS).unwrap();
    assert_eq!(damage, None);
    journal
}

#[test]
fn a_change_is_journaled_once_and_survives_a_restart() {
    let directory = tempfile::tempdir().unwrap();
    let mut journal = open(&directory);
    let first = [change("foyer", 1), change("foyer", 2), change("yard", 1)];
    let outcome = journal.append(&first, NOW_NS).unwrap();
    assert_eq!(outcome, Appended { appended: 3, duplicates: 0, conflicts: 0, head: BEGIN + 3 });
    drop(journal);

    let mut journal = open(&directory);
    let again = [change("foyer", 2), change("foyer", 3)];
    let outcome = journal.append(&again, NOW_NS + 5).unwrap();
    assert_eq!(outcome, Appended { appended: 1, duplicates: 1, conflicts: 0, head: BEGIN + 4 });
    let rows = journal.after(0, 100).unwrap();
    let ids: Vec<_> = rows.iter().map(|row| row.journal_id - BEGIN).collect();
    assert_eq!(ids, [1, 2, 3, 4]);
    assert_eq!(rows[3].received_ns, NOW_NS + 5);
    assert_eq!(rows[3].change().unwrap(), change("foyer", 3));
    assert_eq!(journal.after(BEGIN + 2, 1).unwrap(), rows[2..3]);
    assert_eq!(journal.origins().unwrap(), [("foyer".to_owned(), 3), ("yard".to_owned(), 1)]);
}

#[test]
fn a_sequence_number_that_comes_back_with_another_content_is_a_conflict() {
    let directory = tempfile::tempdir().unwrap();
    let mut journal = open(&directory);
    journal.append(&[change("foyer", 1)], NOW_NS).unwrap();
    let mut other = change("foyer", 1);
    other.text = "something else".to_owned();
    assert_eq!(journal.append(&[other], NOW_NS).unwrap().conflicts, 1);
    assert_eq!(journal.after(0, 9).unwrap()[0].change().unwrap(), change("foyer", 1));
}

#[test]
fn contiguous_stops_at_a_hole_and_goes_on_when_it_is_filled_or_given_up() {
    let directory = tempfile::tempdir().unwrap();
    let mut journal = open(&directory);
    assert_eq!(journal.highest_contiguous("foyer").unwrap(), 0);
    journal.append(&[change("foyer", 1), change("foyer", 3), change("foyer", 6)], NOW_NS).unwrap();
    assert_eq!(journal.highest_contiguous("foyer").unwrap(), 1);
    journal.append(&[change("foyer", 2)], NOW_NS).unwrap();
    assert_eq!(journal.highest_contiguous("foyer").unwrap(), 3);
    journal.give_up("foyer", 4, 5, NOW_NS).unwrap();
    assert_eq!(journal.highest_contiguous("foyer").unwrap(), 6);
}

#[test]
fn a_list_tells_events_and_only_the_open_ones_if_asked() {
    let directory = tempfile::tempdir().unwrap();
    let mut journal = open(&directory);
    let story = |sequence, id: &str, state, kind, area: &str| EventChange {
        id: id.to_owned(),
        state,
        kind,
        area: area.to_owned(),
        ..change("site", sequence)
    };
    use EventKind::{Crowd, Loitering};
    use EventState::{Cleared, Raised, Updated};
    let changes = [
        story(1, "a", Raised, Loitering, "foyer"),
        story(2, "b", Raised, Crowd, "yard"),
        story(3, "a", Updated, Loitering, "foyer"),
        story(4, "b", Cleared, Crowd, "yard"),
    ];
    journal.append(&changes, NOW_NS).unwrap();
    let sequences = |filter: &Filter| -> Vec<u64> {
        let rows = journal.list(filter).unwrap();
        rows.iter().map(|row| row.change().unwrap().sequence).collect()
    };
    let all = Filter { changes: true, ..Filter::default() };
    assert_eq!(sequences(&Filter::default()), [3, 4]);
    assert_eq!(sequences(&all), [1, 2, 3, 4]);
    assert_eq!(sequences(&Filter { open_only: true, ..Filter::default() }), [3]);
    assert_eq!(sequences(&Filter { open_only: true, ..all.clone() }), [1, 3]);
    assert_eq!(sequences(&Filter { limit: 1, ..all.clone() }), [4]);
    assert_eq!(sequences(&Filter { kind: Some(Crowd), ..all.clone() }), [2, 4]);
    assert_eq!(sequences(&Filter { state: Some(Raised), ..all.clone() }), [1, 2]);
    assert_eq!(sequences(&Filter { area: Some("foyer".to_owned()), ..all.clone() }), [1, 3]);
    let since = Some(change("site", 3).stamp_ns);
    assert_eq!(sequences(&Filter { since_ns: since, ..all }), [3, 4]);
}

#[test]
fn an_event_is_open_if_its_newest_change_does_not_end_it() {
    // Numbers of events may begin anew when an origin lost its file.
    let directory = tempfile::tempdir().unwrap();
    let mut journal = open(&directory);
    let story = |sequence, state| EventChange {
        id: "foyer-1".to_owned(),
        state,
        ..change("foyer", sequence)
    };
    let changes = [story(1, EventState::Raised), story(2, EventState::Cleared)];
    journal.append(&changes, NOW_NS).unwrap();
    let open_only = Filter { open_only: true, ..Filter::default() };
    assert_eq!(journal.list(&open_only).unwrap(), []);
    journal.append(&[story(3, EventState::Raised)], NOW_NS).unwrap();
    assert_eq!(journal.list(&open_only).unwrap()[0].change().unwrap().sequence, 3);
}

#[test]
fn a_person_reads_the_view_of_events() {
    let directory = tempfile::tempdir().unwrap();
    let mut journal = open(&directory);
    let mut cleared = change("foyer", 2);
    cleared.id = change("foyer", 1).id;
    cleared.state = EventState::Cleared;
    journal.append(&[change("foyer", 1), cleared], NOW_NS).unwrap();
    let (state, began): (String, String) = journal
        .connection
        .query_row("SELECT state, began_utc FROM event", [], |row| Ok((row.get(0)?, row.get(1)?)))
        .unwrap();
    assert_eq!((state.as_str(), began.as_str()), ("cleared", "2026-11-18 04:26:40"));
}

#[test]
fn a_damaged_journal_is_kept_aside_and_cursors_stay_behind_the_new_one() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(JOURNAL_FILE);
    let mut journal = open(&directory);
    let changes: Vec<EventChange> = (1..200).map(|sequence| change("foyer", sequence)).collect();
    journal.append(&changes, NOW_NS).unwrap();
    drop(journal);
    let mut bytes = std::fs::read(&path).unwrap();
    let length = bytes.len();
    bytes[length / 4..length / 2].fill(0x55);
    std::fs::write(&path, &bytes).unwrap();

    let (mut journal, damage) = Journal::open(&path, NOW_NS).unwrap();
    let damage = damage.unwrap();
    assert_eq!(std::fs::read(&damage.kept_as).unwrap(), bytes, "kept as it was");
    let name = damage.kept_as.file_name().unwrap().to_str().unwrap();
    assert!(name.starts_with("journal.sqlite3.damaged-20261118T"), "{name}");
    let head = journal.append(&changes[..1], NOW_NS).unwrap().head;
    assert_eq!(head, NOW_NS / 1_000_000 + 1);
}

#[test]
fn a_cursor_into_a_journal_that_was_deleted_misses_nothing_of_the_one_that_grew_past_it() {
    let directory = tempfile::tempdir().unwrap();
    let mut journal = open(&directory);
    let cursor = journal.append(&[change("foyer", 1), change("foyer", 2)], NOW_NS).unwrap().head;
    drop(journal);
    let path = directory.path().join(JOURNAL_FILE);
    std::fs::remove_file(&path).unwrap();
    let (mut journal, _) = Journal::open(&path, NOW_NS + 1_000_000_000).unwrap();
    let changes: Vec<EventChange> = (3..9).map(|sequence| change("foyer", sequence)).collect();
    journal.append(&changes, NOW_NS).unwrap();
    assert_eq!(journal.after(cursor, 100).unwrap().len(), changes.len());
}

#[test]
fn a_cut_file_and_a_file_of_garbage_are_damage() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(JOURNAL_FILE);
    let mut journal = open(&directory);
    let changes: Vec<EventChange> = (1..200).map(|sequence| change("foyer", sequence)).collect();
    journal.append(&changes, NOW_NS).unwrap();
    drop(journal);
    let bytes = std::fs::read(&path).unwrap();
    for content in [&bytes[..bytes.len() / 2], &[0xa5; 5000], b"not a database at all"] {
        std::fs::write(&path, content).unwrap();
        let read_only = Journal::open_read_only(&path).and_then(|journal| journal.after(0, 999));
        assert!(matches!(read_only, Err(JournalError::Damaged { .. })), "{read_only:?}");
        let (journal, damage) = Journal::open(&path, NOW_NS).unwrap();
        assert!(damage.is_some());
        assert_eq!(journal.origins().unwrap(), []);
    }
}

#[test]
fn a_file_of_another_program_or_of_a_later_tog_is_left_alone() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("other.sqlite3");
    Connection::open(&path).unwrap().execute_batch("CREATE TABLE cat (name TEXT)").unwrap();
    let before = std::fs::read(&path).unwrap();
    assert!(matches!(Journal::open(&path, NOW_NS), Err(JournalError::Foreign { .. })));
    assert_eq!(std::fs::read(&path).unwrap(), before);

    let journal = open(&directory);
    journal.connection.pragma_update(None, "user_version", 99).unwrap();
    let path = journal.path.clone();
    drop(journal);
    assert!(matches!(Journal::open(&path, NOW_NS), Err(JournalError::Newer { found: 99, .. })));
}

#[test]
fn a_full_disk_refuses_all_of_an_append_and_takes_it_when_there_is_room() {
    let directory = tempfile::tempdir().unwrap();
    let mut journal = open(&directory);
    journal.append(&[change("foyer", 1)], NOW_NS).unwrap();
    journal.set_pages_max(1).unwrap();
    let changes: Vec<EventChange> = (2..100).map(|sequence| change("foyer", sequence)).collect();
    let error = journal.append(&changes, NOW_NS).unwrap_err();
    assert!(matches!(error, JournalError::Full { .. }), "{error}");
    assert!(error.to_string().contains("free space"), "{error}");
    assert_eq!(journal.head().unwrap(), BEGIN + 1);
    journal.set_pages_max(100_000).unwrap();
    assert_eq!(journal.append(&changes, NOW_NS).unwrap().appended, 98);
}

#[test]
fn a_reader_works_beside_the_writer_and_without_it() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(JOURNAL_FILE);
    assert!(matches!(Journal::open_read_only(&path), Err(JournalError::Missing { .. })));
    let mut journal = open(&directory);
    journal.append(&[change("foyer", 1)], NOW_NS).unwrap();
    let reader = Journal::open_read_only(&path).unwrap();
    assert_eq!(reader.head().unwrap(), BEGIN + 1);
    journal.append(&[change("foyer", 2)], NOW_NS).unwrap();
    assert_eq!(reader.head().unwrap(), BEGIN + 2);
    drop((journal, reader));
    assert_eq!(Journal::open_read_only(&path).unwrap().head().unwrap(), BEGIN + 2);
}

#[test]
fn names_in_columns_are_the_names_in_json() {
    use EventKind::*;
    for kind in [
        UnusualActivity,
        Loitering,
        ObjectLeft,
        ObjectMissing,
        DoorHeldOpen,
        Crowd,
        LaserSilent,
        LaserStuck,
        LaserBlocked,
        LaserBlinded,
        LaserMoved,
        CoverageLost,
        ProcessRestarted,
        StorageFault,
    ] {
        assert_eq!(serde_json::to_value(kind).unwrap(), kind_name(kind).as_str());
    }
    for state in [EventState::Raised, EventState::Updated, EventState::Cleared] {
        assert_eq!(serde_json::to_value(state).unwrap(), state_name(state));
    }
}

#[test]
fn contiguous_goes_on_where_an_origin_forgot_its_numbers() {
    let directory = tempfile::tempdir().unwrap();
    let mut journal = open(&directory);
    let (begin, _) = protocol::event::numbering(NOW_NS);
    let rows = [change("foyer", 1), change("foyer", begin + 2), change("yard", begin + 1)];
    journal.append(&rows, NOW_NS).unwrap();
    let contiguous = |journal: &Journal, origin| journal.highest_contiguous(origin).unwrap();
    assert_eq!((contiguous(&journal, "foyer"), contiguous(&journal, "yard")), (1, begin + 1));
    journal.append(&[change("foyer", begin + 1)], NOW_NS).unwrap();
    assert_eq!(contiguous(&journal, "foyer"), begin + 2);
}
