//! Processes that do not answer.

use super::ROOM;
use harness::{Site, find};
use rustix::process::Signal;
use supervisor::ProcessState;

#[test]
fn who_does_not_stop_is_killed_after_its_grace_and_nothing_is_left() {
    let mut site = Site::start(ROOM);
    site.wait_until_frames_flow(5);
    site.kill("mapper room", Signal::STOP);
    site.kill("laser north", Signal::STOP);
    let log = site.stop();
    for service in ["mapper room", "laser north"] {
        let killed = |line: &str| line.contains(service) && line.contains("did not stop: killed");
        assert!(log.lines().any(killed), "{log}");
    }
}

#[test]
fn a_second_signal_does_not_wait_for_the_grace() {
    let mut site = Site::start(ROOM);
    site.wait_until_frames_flow(5);
    site.kill("laser south", Signal::STOP);
    site.running().signal(Signal::INT);
    site.log().wait_for("asked to stop");
    site.running().signal(Signal::INT);
    let (code, log) = site.wait_end();
    assert_eq!(code, Some(0), "{log}");
    assert!(log.contains("did not stop: killed"), "{log}");
}

#[test]
fn a_service_that_hangs_is_killed_and_comes_back() {
    let mut site = Site::start(ROOM);
    site.wait_until_frames_flow(5);
    let hung = site.kill("fusion room", Signal::STOP);
    site.wait_until("its return", |report| {
        let fusion = find(report, "fusion room");
        (fusion.state == ProcessState::Running && fusion.pid != Some(hung)).then_some(())
    });
    let log = site.log().text();
    assert!(log.contains("no sign of life for 10 s: killed"), "{log}");
    site.wait_until_frames_flow(10);
    site.stop();
}
