//! The programs of `deploy/python`, which share no code with us: they read what we read.

use super::bridge::{start, two_hosts};
use super::feed::Desk;
use super::views::Eyes;
use crate::pipeline::oracle::has_python;
use harness::{Running, WATCHDOG};
use process::{Bus, EventLoop, Instance};
use protocol::site::Site as SiteFile;
use protocol::topic;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

fn python(arguments: &[&str]) -> Running {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/independent/clients.sh");
    let mut command = Command::new(script);
    command.args(arguments).stdin(Stdio::null());
    Running::start(command)
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}"); // writing to a String cannot fail
        text
    })
}

/// What it printed under a key, so far.
fn printed(client: &Running, key: &str) -> Vec<Value> {
    let lines = client.out.all();
    let values = lines.iter().map(|line| serde_json::from_str::<Value>(line).expect(line));
    values.filter(|value| !value[key].is_null()).collect()
}

/// Looks until a client has printed at least `least` of what `seen` knows, and compares.
fn agrees(
    client: &Running,
    least: usize,
    mut seen: impl FnMut() -> BTreeMap<u64, String>,
    key: &str,
) {
    let begin = Instant::now();
    loop {
        let known = seen();
        let of_line = |line: &Value| {
            let number = line[key]["number"].as_u64().or(line[key]["stamp_ns"].as_u64()).unwrap();
            let content = line["payload"].as_str().or(line[key]["classes"].as_str()).unwrap();
            (number, content.to_owned())
        };
        let (mut compared, lines) = (0, printed(client, key));
        for (number, content) in lines.iter().map(of_line) {
            if let Some(expected) = known.get(&number) {
                assert!(*expected == content, "{key} {number} differs");
                compared += 1;
            }
        }
        if compared >= least {
            return;
        }
        let (count, text) = (lines.len(), client.log.text());
        assert!(
            begin.elapsed() < WATCHDOG,
            "{compared} of {count} compared, {} known: {text}",
            known.len()
        );
    }
}

#[test]
fn programs_in_python_read_events_and_class_maps_of_other_hosts_and_scans_and_frames_of_this_one() {
    if !has_python() {
        return;
    }
    let toml = two_hosts();
    let file = SiteFile::parse(&toml, "t").unwrap_or_else(|errors| panic!("{errors}"));
    let mut edge = start(&toml, "edge", &[]);
    edge.wait_until_frames_flow(5);
    let host = format!("edge@tcp/{}=hall", file.hosts[0].endpoint);
    let afar = python(&["listen.py", "t", &host]);
    let here = python(&["watch_memory.py", edge.run_dir.to_str().unwrap(), "hall"]);

    let mut eyes = Eyes::open(&edge, &toml);
    let instance = Instance::load(&edge.run_dir).unwrap();
    let events = EventLoop::new().unwrap();
    let bus = Bus::open(&instance, &events).unwrap();
    let mut scans = bus.subscriber(&topic::scan("hall")).unwrap();
    let mut seen_scans = BTreeMap::new();
    agrees(
        &here,
        10,
        || {
            events.wait(Some(process::monotonic_ns() + 50_000_000)).unwrap();
            while let Some(scan) = scans.receive().unwrap() {
                let bytes: Vec<u8> =
                    scan.payload().iter().flat_map(|range| range.to_le_bytes()).collect();
                seen_scans.insert(scan.header().stamp_ns, hex(&bytes));
            }
            seen_scans.clone()
        },
        "scan",
    );
    agrees(
        &here,
        10,
        || {
            eyes.wait_and_look();
            let words = |(_, words): &(u64, Vec<u64>)| {
                hex(&words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<_>>())
            };
            eyes.seen_frames.iter().map(|(number, seen)| (*number, words(seen))).collect()
        },
        "frame",
    );
    agrees(
        &afar,
        10,
        || {
            eyes.wait_and_look();
            eyes.seen_classes.iter().map(|(number, (_, ids))| (*number, hex(ids))).collect()
        },
        "class_map",
    );

    let told = Desk::open_while_degraded(&edge);
    let raised = told.hold_laser_until_told(&mut edge, 0);
    told.release_laser(&mut edge, &raised.change.id);
    let ours: BTreeMap<u64, Value> = told
        .told()
        .iter()
        .filter_map(|told| Some((told.journal_id?, serde_json::to_value(&told.change).unwrap())))
        .collect();
    let begin = Instant::now();
    let theirs = loop {
        let theirs = printed(&afar, "event");
        let last = theirs.iter().filter_map(|line| line["event"]["journal_id"].as_u64()).max();
        if last >= ours.keys().max().copied() {
            break theirs;
        }
        assert!(begin.elapsed() < WATCHDOG, "{theirs:#?}\n{}", afar.log.text());
        afar.out.wait_a_moment(Duration::from_millis(10));
    };
    let mut compared = 0;
    for line in &theirs {
        let event = line["event"].as_object().unwrap();
        let Some(expected) = ours.get(&event["journal_id"].as_u64().unwrap()) else { continue };
        for (key, value) in
            event.iter().filter(|(key, _)| !["host", "journal_id"].contains(&key.as_str()))
        {
            assert_eq!(&expected[key], value, "{key} of {event:?}");
        }
        compared += 1;
    }
    assert!(compared >= 2, "raised and cleared: {theirs:#?}");
    drop((scans, bus, eyes));
    edge.stop();
}
