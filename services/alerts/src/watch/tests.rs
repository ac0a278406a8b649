#![allow(clippy::unwrap_used)]
use super::*;
use crate::journal::Entry;
use crate::keeper::Pending;
use crate::testing::change;

fn watcher(format: Format, after: Option<u64>) -> Watcher {
    let (socket, timezone) = (PathBuf::new(), "UTC".to_owned());
    let (site, journal) = ("lab".to_owned(), PathBuf::new());
    Watcher::new(&WatchOptions { site, journal, socket, timezone, format, after }).unwrap()
}

fn row(journal_id: u64, sequence: u64) -> String {
    let json = serde_json::to_string(&change("foyer", sequence)).unwrap();
    Entry { journal_id, received_ns: 5, json }.line() + "\n"
}

fn early(sequence: u64) -> String {
    Pending { number: 1, received_ns: 5, change: change("foyer", sequence) }.line() + "\n"
}

fn said(watcher: &mut Watcher, bytes: &str) -> Vec<String> {
    watcher.take(bytes.as_bytes());
    let said = watcher.said.drain(..);
    said.map(|said| match said {
        Said::Line(line) => line,
        Said::Note(note) => format!("note: {note}"),
    })
    .collect()
}

#[test]
fn the_cursor_of_the_last_line_is_asked_for_after_an_interruption() {
    let mut watcher = watcher(Format::Text, None);
    assert_eq!(watcher.request(), "{\"after\":null}\n");
    assert_eq!(said(&mut watcher, "{\"feed\":1,\"after\":6,\"reset\":false}\n"), [""; 0]);
    assert_eq!(watcher.request(), "{\"after\":6}\n", "nothing is lost before the first line");
    let line = row(7, 1);
    let (half, rest) = line.split_at(50);
    assert_eq!(said(&mut watcher, half), [""; 0]);
    assert_eq!(said(&mut watcher, rest).len(), 1);
    said(&mut watcher, half);
    watcher.begin();
    assert_eq!(watcher.request(), "{\"after\":7}\n");
    let lines = said(&mut watcher, &row(8, 2));
    assert!(lines[0].starts_with("2026-11-18 04:26:41 UTC  ALERT unusual activity"), "{lines:?}");
}

#[test]
fn people_are_told_once_what_was_not_on_disk_at_first() {
    let mut text = watcher(Format::Text, Some(0));
    let first = said(&mut text, &early(1));
    assert!(first[0].ends_with("[foyer-1] (not on disk yet)"), "{first:?}");
    text.begin();
    assert_eq!(said(&mut text, &early(1)), [""; 0], "after an interruption");
    assert_eq!(said(&mut text, &row(1, 1)), [""; 0], "when it is on disk");
    assert_eq!(text.cursor, Some(1));
    assert!(text.early.is_empty());
    let mut json = watcher(Format::Json, Some(0));
    let both = said(&mut json, &(early(1) + &row(1, 1)));
    assert_eq!(both, [early(1).trim_end(), row(1, 1).trim_end()]);
}

#[test]
fn a_replaced_journal_is_noted_and_an_unknown_line_does_not_stop_the_watch() {
    let mut watcher = watcher(Format::Text, Some(99));
    let notes = said(&mut watcher, "{\"feed\":1,\"after\":0,\"reset\":true}\n");
    assert!(notes[0].contains("journal was replaced"), "{notes:?}");
    let unknown = row(3, 1).replace("unusual_activity", "alien_landing");
    let notes = said(&mut watcher, &unknown);
    assert!(notes[0].contains("alien_landing"), "{notes:?}");
    assert_eq!(watcher.cursor, Some(3));
    assert!(said(&mut watcher, "\u{0}\n")[0].starts_with("note: "));
}

#[test]
fn the_words_of_a_closing_service_are_kept() {
    let mut watcher = watcher(Format::Text, None);
    assert_eq!(watcher.end(), Ended::Lost("the service is gone".to_owned()));
    said(&mut watcher, "{\"closing\":\"all 32 places of the feed are taken\"}\n");
    let words = "all 32 places of the feed are taken".to_owned();
    assert_eq!(watcher.end(), Ended::Refused(words));
}
