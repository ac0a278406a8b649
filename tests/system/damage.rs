//! Files of the state directory that are damaged, or cannot be: named, kept aside, never replaced in
//! silence.

use super::ROOM;
use super::feed::{Desk, assert_whole, journal, wait_until_all_is_journaled};
use harness::{Site, count, find};
use std::fs;
use std::path::{Path, PathBuf};

/// Files beside `name` that begin with it and hold just `bytes`.
fn kept(state: &Path, name: &str, bytes: &[u8]) -> Vec<PathBuf> {
    let entries = fs::read_dir(state).unwrap().flatten().map(|entry| entry.path());
    let beside = entries.filter(|path| {
        let found = path.file_name().unwrap().to_string_lossy().into_owned();
        found.starts_with(name) && found != name
    });
    beside.filter(|path| fs::read(path).is_ok_and(|found| found == bytes)).collect()
}

#[test]
fn damaged_files_are_named_and_kept_aside_and_the_site_runs() {
    let mut site = Site::start(ROOM);
    site.wait_until_frames_flow(5);
    // Something in every file.
    let desk = Desk::open(&mut site);
    let raised = desk.hold_laser_until_told(&mut site, 0);
    desk.release_laser(&mut site, &raised.change.id);
    wait_until_all_is_journaled(&mut site);
    site.stop();
    drop(desk);

    let state = site.dir.join("state");
    let names = ["room.map", "room.normal", "room.outbox", "journal.sqlite3"];
    let damaged = names.map(|name| {
        let mut bytes = fs::read(state.join(name)).unwrap();
        let middle = bytes.len() / 2;
        bytes.truncate(bytes.len() - 3);
        bytes[middle.saturating_sub(50)..middle].fill(0xa5);
        bytes[..4].fill(0xa5);
        fs::write(state.join(name), &bytes).unwrap();
        bytes
    });
    site.start_again();
    let log = site.log();
    for (name, bytes) in names.iter().zip(&damaged) {
        log.wait_for(name);
        site.wait_until("a copy that is kept aside", |_| {
            (kept(&state, name, bytes).len() == 1).then_some(())
        });
    }
    let codes = ["checkpoint_unusable", "model_damaged", "outbox_damaged"];
    site.wait_until("every fault, and data all the same", |report| {
        let faults: Vec<_> = report.services.iter().flat_map(|service| &service.faults).collect();
        let is_told = |code: &&str| faults.iter().any(|fault| fault.code == **code);
        let flows = count(find(report, "anomaly room"), "class_maps_in") >= 10;
        (flows && codes.iter().all(is_told)).then_some(())
    });
    // What happens from now on is told and journaled as ever.
    let desk = Desk::open_while_degraded(&site);
    let raised = desk.hold_laser_until_told(&mut site, 0);
    assert!(raised.journaled, "{raised:?}");
    desk.release_laser(&mut site, &raised.change.id);
    site.stop();
    assert_whole(&journal(&site));
}

#[test]
fn a_state_directory_that_cannot_be_stops_the_site_and_is_named() {
    let mut site =
        Site::start(&ROOM.replace("state_dir = \"state\"", "state_dir = \"site.toml/x\""));
    let (code, log) = site.wait_end();
    assert_eq!(code, Some(1), "{log}");
    let words = "site.toml/x is below something that is no directory, expected a directory";
    assert!(log.contains(words), "{log}");
}
