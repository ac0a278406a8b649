//! The ways to look at a running site besides `tog status`: other formats, the building, a terminal.

use super::ROOM;
use super::bridge::{start, two_hosts};
use harness::{Setup, WATCHDOG};
use std::process::Command;
use std::time::{Duration, Instant};

fn words(output: &std::process::Output) -> String {
    String::from_utf8([output.stdout.as_slice(), output.stderr.as_slice()].concat()).unwrap()
}

#[test]
fn a_host_says_how_the_others_are() {
    let toml = two_hosts();
    let mut edge = start(&toml, "edge", &[]);
    let mut desk = start(&toml, "desk", &[]);
    desk.wait_until_frames_flow(5);
    edge.wait_until_frames_flow(5);
    let of = |site: &harness::Site| words(&site.tog(&["status"], &["--site"]));
    let begin = Instant::now();
    loop {
        let (there, here) = (of(&edge), of(&desk));
        let both = [&there, &here].iter().all(|text| text.contains("2 hosts, all are heard"));
        if both && here.contains("  hall\n") && there.contains("  room\n") {
            break;
        }
        assert!(begin.elapsed() < WATCHDOG, "{there}\n{here}");
        desk.log().wait_a_moment(Duration::from_millis(20));
    }
    edge.stop();
    let begin = Instant::now();
    while !of(&desk).contains("1 not heard") {
        assert!(begin.elapsed() < WATCHDOG, "{}", of(&desk));
        desk.log().wait_a_moment(Duration::from_millis(20));
    }
    let text = of(&desk);
    assert!(text.contains("edge  lost") && text.contains("tog run --host edge"), "{text}");
    let json = words(&desk.tog(&["status"], &["--site", "--format", "json"]));
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["hosts"][1]["here"], true);
    assert_eq!(json["hosts"][1]["areas"][0], "room");
    desk.stop();
}

#[test]
fn a_site_is_told_to_prometheus_drawn_and_shown_in_a_terminal() {
    let mut site = Setup::new(ROOM).start();
    site.wait_until_healthy();
    let metrics = words(&site.tog(&["status"], &["--format", "prometheus"]));
    assert!(metrics.contains("\ntog_up{site=\"t\"} 1\n"), "{metrics}");
    assert!(metrics.contains("\ntog_service_up{site=\"t\",service=\"alerts\"} 1\n"), "{metrics}");
    let graph = words(&site.tog(&["graph"], &[]));
    assert!(graph.contains("digraph \"t\"") && graph.contains("[label=\"frame\"]"), "{graph}");
    let one = words(&site.tog(&["status"], &["--site"]));
    assert!(one.contains("this site has one host"), "{one}");
    in_a_terminal(&site);
    let run_root = site.run_root();
    site.stop();
    let mut after = harness::tog(&run_root, ["status"]);
    let after = after.arg(site.file()).args(["--format", "prometheus"]).output().unwrap();
    assert_eq!(after.status.code(), Some(1));
    assert!(words(&after).contains("\ntog_up 0\n"), "{}", words(&after));
}

/// `tog top` in tmux: what it shows, and that q ends it.
fn in_a_terminal(site: &harness::Site) {
    let socket = site.dir.join("tmux");
    let tmux = |arguments: &[&str]| {
        Command::new("tmux").arg("-S").arg(&socket).args(arguments).output().map(|o| words(&o))
    };
    if tmux(&["-V"]).is_err() {
        println!("skipped: tmux is not there");
        return;
    }
    let (root, file) = (site.run_root(), site.file());
    let command = format!(
        "TOG_RUN_DIR={} {} top {}",
        root.display(),
        harness::binary().display(),
        file.display()
    );
    let begin = Instant::now();
    tmux(&["new-session", "-d", "-x", "120", "-y", "40", &command]).unwrap();
    let mut shown = String::new();
    while !(shown.contains("site t: all is well")
        && shown.contains("10.0 Hz")
        && shown.contains(" %"))
    {
        shown = tmux(&["capture-pane", "-p"]).unwrap();
        assert!(begin.elapsed() < WATCHDOG, "{shown}");
        site.log().wait_a_moment(Duration::from_millis(50));
    }
    tmux(&["send-keys", "q"]).unwrap();
    while tmux(&["list-sessions"]).unwrap().contains("windows") {
        assert!(begin.elapsed() < WATCHDOG, "q does not end it");
        site.log().wait_a_moment(Duration::from_millis(50));
    }
}
