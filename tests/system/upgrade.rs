//! Hosts of two versions, and how the older one is replaced: `TOG_BIN_OLD` names its program, else nothing
//! is tried. `tests/several_hosts.sh nightly` builds one from an older commit.

use super::bridge::{assert_the_desk_has_all, two_hosts};
use super::feed::Desk;
use harness::{Setup, Site, binary, count, find};
use std::path::PathBuf;

fn start(toml: &str, host: &str, program: &std::path::Path) -> Site {
    Setup::new(toml).program(program).arguments(["--host", host]).start()
}

/// Scans cross, and something that happens at the edge reaches the desk. `known` changes happened there
/// before; how many it are now.
fn assert_they_talk(edge: &mut Site, desk: &mut Site, known: usize) -> usize {
    edge.wait_until_frames_flow(5);
    desk.wait_until_frames_flow(5);
    let told = Desk::open(edge);
    if let Some(last) = known.checked_sub(1) {
        told.wait_for(last, "what happened before", |_| true);
    }
    let raised = told.hold_laser_until_told(edge, known);
    told.release_laser(edge, &raised.change.id);
    let changes = assert_the_desk_has_all((edge, "edge", "hall"), desk);
    for site in [edge, desk] {
        let report = site.status().unwrap();
        let bridge = find(&report, "bridge");
        for refused in ["scans_refused", "health_refused", "pages_refused", "events_refused"] {
            assert_eq!(count(bridge, refused), 0, "{}", report.table());
        }
    }
    changes
}

#[test]
fn hosts_of_two_versions_talk_and_are_upgraded_one_by_one() {
    let Some(old) = std::env::var_os("TOG_BIN_OLD").map(PathBuf::from) else {
        println!("skipped: TOG_BIN_OLD names no older program");
        return;
    };
    let new = binary();
    for older in ["edge", "desk"] {
        let toml = two_hosts();
        let program = |host| if host == older { &old } else { &new };
        let mut edge = start(&toml, "edge", program("edge"));
        let mut desk = start(&toml, "desk", program("desk"));
        let before = assert_they_talk(&mut edge, &mut desk, 0);
        let site = if older == "edge" { &mut edge } else { &mut desk };
        site.stop();
        site.upgrade(&new);
        site.start_again();
        let after = assert_they_talk(&mut edge, &mut desk, before);
        assert!(after > before, "{before} changes before, {after} after");
        println!("upgraded {older}: {before} changes before, {after} in all, once and in order");
        desk.stop();
        edge.stop();
    }
}
