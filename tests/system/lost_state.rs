//! A host whose state is lost, or restored from a backup: what it tells from then on reaches the desk, and
//! nothing that the desk has is there twice.

use super::bridge::{journal_of, of, start, two_hosts};
use super::feed::{Desk, assert_whole};
use harness::{Site, WATCHDOG, find};
use protocol::event::EventChange;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

/// Something happens at the edge; then all that the desk has of it, which is `before` and then what the
/// journal of the edge has behind its first `known` rows.
fn happens(
    told: &Desk,
    edge: &mut Site,
    desk: &Site,
    before: &[EventChange],
    known: usize,
) -> Vec<EventChange> {
    let raised = told.hold_laser_until_told(edge, told.count());
    told.release_laser(edge, &raised.change.id);
    let sent = of(journal_of(edge, "edge", "hall"));
    let expected = [before, &sent[known..]].concat();
    let begin = Instant::now();
    let rows = loop {
        let rows = of(journal_of(desk, "desk", "hall"));
        if rows.len() >= expected.len() {
            break rows;
        }
        assert!(begin.elapsed() < WATCHDOG, "{} of {}", rows.len(), expected.len());
        desk.log().wait_a_moment(Duration::from_millis(5));
    };
    assert_eq!(rows, expected, "content and order");
    rows
}

fn wait_until_it_is_told(desk: &mut Site) -> String {
    desk.wait_until("the new journal is told", |report| {
        assert!(find(report, "alerts").faults.is_empty(), "{}", report.table());
        let mut faults = find(report, "bridge").faults.iter();
        faults.find(|fault| fault.code == "journal_replaced edge").map(|fault| fault.text.clone())
    })
}

fn copy(from: &Path, to: &Path) {
    let copied = Command::new("cp").arg("-a").args([from, to]).status().unwrap();
    assert!(copied.success());
}

#[test]
fn what_a_host_without_its_state_tells_reaches_the_desk_once() {
    let toml = two_hosts();
    let (mut edge, mut desk) = (start(&toml, "edge", &[]), start(&toml, "desk", &[]));
    let told = Desk::open(&mut desk);
    edge.wait_until_frames_flow(5);
    let state = edge.dir.join("state/edge");
    let backup = edge.dir.join("backup");

    let rows = happens(&told, &mut edge, &desk, &[], 0);
    edge.stop();
    copy(&state, &backup);
    let known = of(journal_of(&edge, "edge", "hall")).len();
    edge.start_again();
    let rows = happens(&told, &mut edge, &desk, &rows, rows.len());

    // The disk is lost.
    edge.stop();
    fs::remove_dir_all(&state).unwrap();
    edge.start_again();
    let rows = happens(&told, &mut edge, &desk, &rows, 0);
    println!("{}", wait_until_it_is_told(&mut desk));

    // Restored, as the runbook says.
    edge.stop();
    fs::remove_dir_all(&state).unwrap();
    copy(&backup, &state);
    fs::remove_file(state.join("bridge/epoch.json")).unwrap();
    fs::remove_file(state.join("hall.outbox")).unwrap();
    edge.start_again();
    let rows = happens(&told, &mut edge, &desk, &rows, known);
    assert_whole(&(1..).zip(rows).collect::<Vec<_>>());
    println!("{}", wait_until_it_is_told(&mut desk));
    desk.stop();
    edge.stop();
}
