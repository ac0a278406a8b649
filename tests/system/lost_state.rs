//! A host that is lost, and one whose state is lost or restored from a backup: the desk is told, what the
//! host tells from then on reaches it, and nothing that it has is there twice.

use super::bridge::{journal_of, of, start, two_hosts, wait_for_rows};
use super::feed::{Desk, assert_whole};
use harness::{Site, fault, find};
use protocol::event::{EventChange, EventKind, EventState};
use std::fs;
use std::path::Path;
use std::process::Command;

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
    let rows = wait_for_rows(desk, "desk", "hall", expected.len());
    assert_eq!(rows, expected, "content and order");
    rows
}

fn wait_until_it_is_told(desk: &mut Site) -> String {
    desk.wait_until("the new journal is told", |report| {
        assert!(find(report, "alerts").faults.is_empty(), "{}", report.table());
        fault(report, "bridge", "journal_replaced edge")
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

#[test]
fn a_lost_host_is_an_event_at_the_desk_and_another_site_file_is_told() {
    let toml = two_hosts();
    let (mut edge, mut desk) = (start(&toml, "edge", &[]), start(&toml, "desk", &[]));
    let told = Desk::open(&mut desk);
    edge.wait_until_frames_flow(5);
    edge.stop();
    let lost =
        told.wait_for(0, "the lost host", |told| told.change.text.starts_with("host edge: "));
    let change = &lost.change;
    assert_eq!((change.kind, change.state), (EventKind::CoverageLost, EventState::Raised));
    let words = "By the site file: area hall is watched by nobody meanwhile; areas elsewhere lack its \
                 lasers north";
    assert!(change.text.contains(words), "{}", change.text);
    // The desk forgets neither that it told it, nor to tell the end.
    let killed = desk.kill("alerts", rustix::process::Signal::KILL);
    desk.wait_until("the journal again", |report| {
        let alerts = find(report, "alerts");
        let is_new = alerts.pid.is_some_and(|pid| pid != killed);
        (is_new && alerts.counters.contains_key("changes_in")).then_some(())
    });
    let file = edge.file();
    let text = fs::read_to_string(&file).unwrap();
    fs::write(&file, text.replace("x_m = 4.6", "x_m = 4.7")).unwrap();
    edge.start_again();
    let again = Desk::open_while_degraded(&desk);
    let over = |told: &super::feed::Told| {
        told.change.id == lost.change.id && told.change.state == EventState::Cleared
    };
    again.wait_for(0, "the host again", over);
    for (site, other) in [(&mut edge, "desk"), (&mut desk, "edge")] {
        let code = format!("site_differs {other}");
        let text = site.wait_until(&code, |report| fault(report, "bridge", &code));
        assert!(text.contains("another site file"), "{text}");
    }
    desk.stop();
    edge.stop();
}
