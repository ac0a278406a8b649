//! `tog doctor`, before and while a site runs.

use super::bridge::{start, two_hosts};
use harness::{Setup, tog};
use rustix::process::Signal;
use std::process::Output;

#[track_caller]
fn says(output: &Output, code: i32, lines: &[[&str; 2]]) {
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    for [begin, part] in lines {
        let found = text.lines().any(|line| line.starts_with(begin) && line.contains(part));
        assert!(found, "{begin} .. {part}:\n{text}");
    }
    assert_eq!(output.status.code(), Some(code), "{text}");
}

#[test]
fn the_doctor_says_what_would_not_work_and_whether_data_flows() {
    let toml = two_hosts();
    let setup = Setup::new(&toml);
    let file = setup.dir().join("site.toml");
    let doctor = |host: &str| {
        let words = ["doctor", file.to_str().unwrap(), "--host", host];
        tog(&setup.dir().join("r"), words).output().unwrap()
    };
    says(
        &doctor("edge"),
        0,
        &[
            ["ok    shared memory", "MB are free"],
            ["ok    port", "is free"],
            ["warn  certificates", "plain-tcp"],
            ["warn  host desk", "does not answer"],
            ["?     site", "does not run here"],
        ],
    );
    let (mut edge, mut desk) = (start(&toml, "edge", &[]), start(&toml, "desk", &[]));
    edge.wait_until_frames_flow(3);
    desk.wait_until_frames_flow(3);
    let links = |report: &supervisor::StatusReport| {
        let bridge = harness::find(report, "bridge");
        bridge.gauges.contains_key("clock_ahead_s edge").then_some(())
    };
    desk.wait_until("both clocks", links);
    let well = desk.tog(&["doctor"], &["--host", "desk"]);
    says(
        &well,
        0,
        &[
            ["ok    port", "is taken, by the site that runs here"],
            ["ok    site", "every process is well"],
            ["ok    anomaly room", "class maps in a second"],
            ["ok    link to edge", "0 events behind"],
        ],
    );
    edge.kill("laser south", Signal::STOP);
    let ill = edge.tog(&["doctor"], &["--host", "edge", "--format", "json"]);
    let text = String::from_utf8_lossy(&ill.stdout).into_owned();
    assert_eq!(ill.status.code(), Some(1), "{text}");
    assert!(text.contains("no scans out within 2.5 s"), "{text}");
    edge.kill("laser south", Signal::CONT);
    desk.stop();
    edge.stop();
}
