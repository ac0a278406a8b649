//! Two hosts of one site: two run roots on this machine, and TCP between them.

use super::feed::{Desk, assert_whole};
use crate::pipeline::{made, support};
use alerts::{JOURNAL_FILE, Journal};
use harness::{Random, Setup, Site, WATCHDOG, count, fault, find, is_nightly, tog};
use process::{Bus, EventLoop, Instance};
use protocol::codec::encode;
use protocol::event::{EventChange, EventKind, EventState};
use protocol::link::{CarriedScan, EventPage, HostHealth};
use protocol::topic;
use rustix::process::Signal;
use std::collections::BTreeMap;
use std::fs;
use std::net::TcpListener;
use std::time::{Duration, Instant};
use zenoh::Wait;

/// These hosts, `desk` a desk, each with an endpoint that nobody listens on.
pub(super) fn hosts<const N: usize>(ids: [&str; N], desk: &str) -> String {
    // All ports are held until all are known, else two hosts might get the same.
    let held = ids.map(|id| (id, TcpListener::bind("127.0.0.1:0").unwrap()));
    let host = |(id, listener): &(&str, TcpListener)| {
        let (endpoint, desk) = (listener.local_addr().unwrap(), *id == desk);
        format!(
            "[[host]]\nid = \"{id}\"\nendpoint = \"{endpoint}\"\ntransport = \"plain-tcp\"\ndesk = {desk}\n\n"
        )
    };
    held.iter().map(host).collect()
}

/// `hall` runs on `edge` with its laser; `room` on the desk, and its laser on `edge`.
pub(super) fn two_hosts() -> String {
    let area = |id: &str, host: &str| {
        format!(
            "[[area]]\nid = \"{id}\"\nhost = \"{host}\"\norigin_m = [-0.5, -0.5]\ncolumns = 110\n\
             rows = 100\ncheckpoint_s = 1\ntimescales_s = [1, 2, 4]\n\n"
        )
    };
    let laser = |id: &str, area: &str, place: &str| {
        format!(
            "[[laser]]\nid = \"{id}\"\nhost = \"edge\"\narea = \"{area}\"\n{place}\n\
             source = {{ kind = \"simulator\", scene = \"room\", seed = 1 }}\n\n"
        )
    };
    [
        "name = \"t\"\ntimezone = \"UTC\"\nstate_dir = \"state\"\n\n".to_owned(),
        hosts(["edge", "desk"], "desk"),
        area("hall", "edge"),
        area("room", "desk"),
        laser("south", "hall", "x_m = 4.6\ny_m = 0.2\nyaw_deg = 90"),
        laser("north", "room", "x_m = 5.2\ny_m = 8.8\nyaw_deg = -90"),
    ]
    .concat()
}

pub(super) fn start(toml: &str, host: &str, more: &[&str]) -> Site {
    let arguments = ["--host", host].into_iter().chain(more.iter().copied());
    Setup::new(toml).arguments(arguments).start()
}

/// All rows of the journal of a host that are of `origin`.
pub(super) fn journal_of(site: &Site, host: &str, origin: &str) -> Vec<(u64, EventChange)> {
    let path = site.dir.join("state").join(host).join(JOURNAL_FILE);
    let rows = Journal::open_read_only(&path).unwrap().after(0, 100_000).unwrap();
    let rows = rows.iter().map(|row| (row.journal_id, row.change().unwrap()));
    rows.filter(|(_, change)| change.origin == origin).collect()
}

pub(super) fn of(rows: Vec<(u64, EventChange)>) -> Vec<EventChange> {
    rows.into_iter().map(|(_, change)| change).collect()
}

/// What the journal of a host has of `origin`, once that is as long.
pub(super) fn wait_for_rows(
    site: &Site,
    host: &str,
    origin: &str,
    least: usize,
) -> Vec<EventChange> {
    let begin = Instant::now();
    loop {
        let rows = of(journal_of(site, host, origin));
        if rows.len() >= least {
            return rows;
        }
        assert!(begin.elapsed() < WATCHDOG, "{} of {least} of {origin}", rows.len());
        site.log().wait_a_moment(Duration::from_millis(5));
    }
}

/// Somebody with zenoh and nothing of tog, at an endpoint without TLS.
fn stranger(endpoint: &str) -> zenoh::Session {
    let config = serde_json::json!({
        "mode": "client",
        "connect": { "endpoints": [format!("tcp/{endpoint}")] },
        "scouting": { "multicast": { "enabled": false } },
    });
    zenoh::open(zenoh::Config::from_json5(&config.to_string()).unwrap()).wait().unwrap()
}

/// Compares what an area (`origin`) of a host has in its journal there with what the host `desk` has of
/// it, once that is as long. How many changes.
pub(super) fn assert_the_desk_has_all(
    (site, host, origin): (&Site, &str, &str),
    desk: &Site,
) -> usize {
    let sent = of(journal_of(site, host, origin));
    let rows = wait_for_rows(desk, "desk", origin, sent.len());
    assert_eq!(rows, sent, "content and order");
    assert_whole(&(1..).zip(rows).collect::<Vec<_>>());
    sent.len()
}

#[test]
fn a_desk_has_every_event_of_another_host_once_and_in_order_although_the_bridges_are_killed() {
    let mut random = Random::from_environment();
    let toml = two_hosts();
    let mut edge = start(&toml, "edge", &[]);
    let mut desk = start(&toml, "desk", &[]);
    let told = Desk::open(&mut edge);
    desk.wait_until_frames_flow(5);
    let rounds = if is_nightly() { 12 } else { 3 };
    let mut kills = 0;
    let mut kill_one = |random: &mut Random, edge: &mut Site, desk: &mut Site| {
        edge.log().wait_a_moment(Duration::from_millis(random.below(300)));
        let site = if random.below(2) == 0 { edge } else { desk };
        site.kill("bridge", Signal::KILL);
        kills += 1;
    };
    for round in 0..rounds {
        let mark = told.count();
        edge.kill("laser south", Signal::STOP);
        kill_one(&mut random, &mut edge, &mut desk);
        let raised = told.hold_laser_until_told(&mut edge, mark);
        kill_one(&mut random, &mut edge, &mut desk);
        told.release_laser(&mut edge, &raised.change.id);
        kill_one(&mut random, &mut edge, &mut desk);
        if round == 1 {
            // The journals of both sides die as well.
            desk.kill("alerts", Signal::KILL);
            edge.kill("alerts", Signal::KILL);
        }
    }
    let source = || of(journal_of(&edge, "edge", "hall"));
    let silences = source().iter().filter(|c| c.kind == EventKind::LaserSilent).count();
    assert!(silences >= 2 * rounds, "{:#?}", source());
    let begin = Instant::now();
    loop {
        let rows = of(journal_of(&desk, "desk", "hall"));
        if rows.len() >= source().len() {
            break;
        }
        assert!(begin.elapsed() < WATCHDOG, "{} of {}", rows.len(), source().len());
        desk.log().wait_a_moment(Duration::from_millis(5));
    }
    let (sent, rows) = (source(), journal_of(&desk, "desk", "hall"));
    assert_eq!(of(rows.clone()), sent, "content and order");
    let renumbered = (1..).zip(of(rows)).collect::<Vec<_>>();
    assert_whole(&renumbered);
    println!("{} changes, {kills} kills of a bridge", sent.len());
    desk.stop();
    edge.stop();
}

#[test]
fn a_desk_that_was_away_is_given_what_happened_meanwhile() {
    let toml = two_hosts();
    let mut edge = start(&toml, "edge", &[]);
    // Nobody is at the desk: the bridge says so, everything else goes on.
    edge.wait_until("the lost desk", |report| {
        let lost = |fault: &protocol::health::Fault| fault.code == "host_lost desk";
        find(report, "bridge").faults.iter().any(lost).then_some(())
    });
    let told = Desk::open_while_degraded(&edge);
    let raised = told.hold_laser_until_told(&mut edge, 0);
    told.release_laser(&mut edge, &raised.change.id);
    let mut desk = start(&toml, "desk", &[]);
    let watch = Desk::open(&mut desk);
    watch.wait_for(0, "the end of what happened", |told| {
        told.change.id == raised.change.id && told.change.state == EventState::Cleared
    });
    let report = desk.wait_until_frames_flow(5);
    assert!(count(find(&report, "bridge"), "scans_in") > 0, "{}", report.table());
    // It says what is wrong on the other host, and that it is over.
    edge.kill("laser south", Signal::STOP);
    let words = desk.wait_until("a host that is not well", |report| {
        let unwell = |f: &&protocol::health::Fault| f.code == "host_unwell edge";
        find(report, "bridge").faults.iter().find(unwell).map(|fault| fault.text.clone())
    });
    assert!(words.starts_with("on host edge: fusion hall: laser_silent south"), "{words}");
    edge.kill("laser south", Signal::CONT);
    desk.wait_until_healthy();
    let listed = desk.tog(&["alerts", "list"], &["--format", "json"]);
    let listed = String::from_utf8(listed.stdout).unwrap();
    assert!(listed.contains(&raised.change.id), "{listed}");
    desk.stop();
    edge.stop();
}

/// What was recorded, as three hosts replay it: two of the four lasers on `edge`, two on `wing`, and the
/// area at the desk.
fn replayed(made: &str) -> String {
    let mut text = made
        .replace("pace = \"lossless\"", "pace = \"real_time\"")
        .replace("timescales_s = [1, 4, 12]", "timescales_s = [1, 2, 4]\nlateness_max_ms = 5000")
        .replace(
            "[[area]]\n",
            &(hosts(["edge", "wing", "desk"], "desk") + "[[area]]\nhost = \"desk\"\n"),
        );
    for (laser, host) in [("south", "edge"), ("west", "edge"), ("north", "wing"), ("east", "wing")]
    {
        let line = format!("id = \"{laser}\"\n");
        assert_eq!(text.matches(&line).count(), 1, "{text}");
        text = text.replace(&line, &format!("{line}host = \"{host}\"\n"));
    }
    text
}

/// Three hosts replay in step with time, so a host that stalls for more than `lateness_max_ms` (here 5 s)
/// leaves out frames or scans of frames. So: frames that did not come are allowed, up to half of them;
/// every frame that came must be the same in every cell, once the longest timescale (4 s) has passed
/// since the first that came.
#[test]
fn three_hosts_say_the_same_classes_as_one_on_the_same_scans() {
    let scratch = support::scratch();
    let recording = scratch.path().join("room.mcap");
    let toml = replayed(&made::room(&recording, 14));
    let file = scratch.path().join("site.toml");
    fs::write(&file, &toml).unwrap();
    let out = scratch.path().join("one");
    let words: [&std::path::Path; 7] = [
        "replay".as_ref(),
        &recording,
        "--site".as_ref(),
        &file,
        "--every-frame".as_ref(),
        "--out".as_ref(),
        &out,
    ];
    support::tog(&scratch, words).expect(0, &["tog: results of area"]);
    let (classes, numbers) =
        (support::Npy::read(&out.join("classes.npy")), support::Npy::read(&out.join("frames.npy")));
    let cells = classes.shape[1] * classes.shape[2];
    let one: BTreeMap<u64, &[u8]> =
        numbers.u64s().into_iter().zip(classes.bytes.chunks_exact(cells)).collect();

    let at_s = process::wall_ns() / 1_000_000_000 + 12;
    let at = jiff::Timestamp::from_second(at_s as i64).unwrap().to_string();
    let mut desk = start(&toml, "desk", &["--replay-at", &at]);
    desk.wait_until("the desk", |report| find(report, "anomaly hall").pid);
    let instance = Instance::load(&desk.run_dir).unwrap();
    let events = EventLoop::new().unwrap();
    let bus = Bus::open(&instance, &events).unwrap();
    let mut maps = bus.subscriber(&topic::classes("hall", cells)).unwrap();
    let [edge, wing] = ["edge", "wing"].map(|host| start(&toml, host, &["--replay-at", &at]));
    let mut several = BTreeMap::<u64, Vec<u8>>::new();
    let mut ended = false;
    let begin = Instant::now();
    while !ended {
        while let Some(map) = maps.receive().unwrap() {
            ended |= map.is_end_of_stream();
            if !map.is_end_of_stream() {
                several.insert(map.header().number, map.payload().to_vec());
            }
        }
        assert!(
            begin.elapsed() < WATCHDOG,
            "{} frames, no end:\n{}",
            several.len(),
            desk.log().text()
        );
        events.wait(Some(process::monotonic_ns() + 1_000_000_000)).unwrap();
    }
    drop((maps, bus));
    let first = *several.keys().next().unwrap();
    let is_whole = first == *one.keys().next().unwrap();
    let settled = if is_whole { first } else { first + 40 };
    let mut compared = 0;
    for (number, found) in several.range(settled..) {
        let expected = one.get(number).unwrap_or_else(|| panic!("frame {number} is not in one"));
        let differ = found.iter().zip(*expected).filter(|(a, b)| a != b).count();
        assert_eq!(differ, 0, "cells of frame {number} of {:?}", one.keys().next_back());
        compared += 1;
    }
    assert!(2 * compared >= one.len(), "only {compared} of {} frames came", one.len());
    println!("{compared} of {} frames compared, {} cells each, all the same", one.len(), cells);
    let (code, log) = desk.wait_end();
    assert_eq!(code, Some(0), "{log}");
    assert!(log.contains("the recording is over"), "{log}");
    [edge, wing].into_iter().for_each(|mut site| drop(site.stop()));
}

/// Whoever may speak as a host may not bring down a bridge by it either.
#[test]
fn what_comes_under_the_key_of_somebody_else_is_left_out_and_told() {
    let toml = two_hosts();
    let file = protocol::site::Site::parse(&toml, "t").unwrap_or_else(|e| panic!("{e}"));
    let mut edge = start(&toml, "edge", &[]);
    let mut desk = start(&toml, "desk", &[]);
    desk.wait_until_frames_flow(5);
    let session = stranger(&file.hosts[1].endpoint);
    let put = |key: String, bytes: Vec<u8>| session.put(key, bytes).wait().unwrap();
    let scan = CarriedScan { laser: "south".to_owned(), ..CarriedScan::default() };
    let page = EventPage { host: "desk".to_owned(), ..EventPage::default() };
    let health = HostHealth { host: "desk".to_owned(), ..HostHealth::default() };
    put(topic::scan_key("t", "edge", "north"), encode(&scan).unwrap());
    put(topic::live_key("t", "edge"), encode(&page).unwrap());
    put(topic::health_key("t", "edge"), encode(&health).unwrap());
    let words = desk.wait_until("what was left out", |report| {
        let bridge = find(report, "bridge");
        assert_eq!(bridge.restarts, 0);
        let fault = bridge.faults.iter().find(|fault| fault.code == "misrouted")?;
        (count(bridge, "messages_refused_misrouted") == 3).then(|| fault.text.clone())
    });
    assert!(words.starts_with("3 messages came under the key of somebody else"), "{words}");
    let scans_in = |report: &supervisor::StatusReport| count(find(report, "bridge"), "scans_in");
    let before = scans_in(&desk.status().unwrap());
    desk.wait_until("more scans", |report| (scans_in(report) > before + 10).then_some(()));
    desk.stop();
    edge.stop();
}

/// A port that somebody else has is no reason to be blind as well.
#[test]
fn a_host_whose_port_is_taken_watches_and_joins_when_it_is_free() {
    let toml = two_hosts();
    let file = protocol::site::Site::parse(&toml, "t").unwrap_or_else(|e| panic!("{e}"));
    let taken = TcpListener::bind(&file.hosts[0].endpoint).unwrap();
    let (mut edge, mut desk) = (start(&toml, "edge", &[]), start(&toml, "desk", &[]));
    let text = edge.wait_until("the taken port", |report| fault(report, "bridge", "cannot_listen"));
    assert!(text.contains("Address already in use") && !text.contains(".rs:"), "{text}");
    let maps =
        |report: &supervisor::StatusReport| count(find(report, "anomaly hall"), "class_maps_in");
    edge.wait_until("frames all the same", |report| (maps(report) > 5).then_some(()));
    drop(taken);
    desk.wait_until_frames_flow(5);
    assert_eq!(find(&edge.wait_until_healthy(), "bridge").restarts, 0);
    desk.stop();
    edge.stop();
}

#[test]
fn a_host_must_be_said_and_be_known() {
    let setup = Setup::new(&two_hosts());
    let file = setup.dir().join("site.toml");
    let run = |more: &[&str]| {
        let words = ["run", file.to_str().unwrap()].into_iter().chain(more.iter().copied());
        let ended = tog(&setup.dir().join("r"), words).output().unwrap();
        (ended.status.code(), String::from_utf8(ended.stderr).unwrap())
    };
    let (code, words) = run(&[]);
    assert_eq!(code, Some(2));
    assert!(words.contains("say which of them this is with --host (edge, desk)"), "{words}");
    let (code, words) = run(&["--host", "cellar"]);
    assert_eq!(code, Some(2));
    assert!(words.contains("--host cellar: the hosts of t are edge, desk"), "{words}");
    let checked = tog(&setup.dir().join("r"), ["check", file.to_str().unwrap()]).output().unwrap();
    let plan = String::from_utf8(checked.stdout).unwrap();
    for part in [
        "host edge, 127.0.0.1:",
        ", a desk: `tog run --host desk` would start 5 processes",
        "  edge -> desk: ",
        "  scans of laser north, for area room\n",
        "  events, none lost\n",
        "  desk -> edge: ",
        "  health\n",
    ] {
        assert!(plan.contains(part), "{part}\n{plan}");
    }
    assert!(String::from_utf8(checked.stderr).unwrap().contains("neither encrypted nor"));
}
