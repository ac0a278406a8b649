//! Hosts that know each other by certificates, and somebody who should not be there.

use super::bridge::{journal_of, of, wait_for_rows};
use super::feed::{Desk, assert_whole};
use certificates::{Files, Identity};
use harness::{Scratch, Setup, Site, count, fault, find, is_nightly};
use protocol::codec::encode;
use protocol::event::{EventChange, EventState};
use protocol::health::Health;
use protocol::link::{CarriedScan, EventPage, EventRow, HostHealth};
use protocol::topic;
use rustix::process::Signal;
use serde_json::json;
use std::collections::VecDeque;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use zenoh::Wait;
use zenoh::qos::CongestionControl;

const HOSTS: [&str; 3] = ["edge", "desk", "yard"];

struct Building {
    scratch: Scratch,
    ports: [u16; 3],
    toml: String,
}

/// `hall` runs on `edge` with its laser; `room` on the desk, and its laser `north` on `edge`. Nobody
/// starts `yard`: its certificate is in the wrong hands.
fn building() -> Building {
    let scratch = Scratch::new();
    let listeners = [0, 1, 2].map(|_| TcpListener::bind("127.0.0.1:0").unwrap());
    let ports = listeners.map(|listener| listener.local_addr().unwrap().port());
    let host = |(id, port): (&str, u16)| {
        format!(
            "[[host]]\nid = \"{id}\"\nendpoint = \"127.0.0.1:{port}\"\ntransport = \"tls\"\n\
             desk = {}\n\n",
            id == "desk"
        )
    };
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
    let tls = scratch.0.join("tls");
    let head = format!(
        "name = \"t\"\ntimezone = \"UTC\"\nstate_dir = \"state\"\ntls_dir = {:?}\n\n",
        tls.to_str().unwrap()
    );
    let hosts: String = HOSTS.into_iter().zip(ports).map(host).collect();
    let toml = [
        head,
        hosts,
        area("hall", "edge"),
        area("room", "desk"),
        laser("south", "hall", "x_m = 4.6\ny_m = 0.2\nyaw_deg = 90"),
        laser("north", "room", "x_m = 5.2\ny_m = 8.8\nyaw_deg = -90"),
    ]
    .concat();
    let ca = scratch.0.join("ca");
    certificates::init(&ca, "t", now_s(), 10).unwrap();
    for (id, port) in HOSTS.into_iter().zip(ports) {
        let identity = Identity::new("t", id, &format!("127.0.0.1:{port}"));
        certificates::issue(&ca, &tls, &identity, now_s(), 10).unwrap();
    }
    Building { scratch, ports, toml }
}

fn now_s() -> i64 {
    (process::wall_ns() / 1_000_000_000) as i64
}

fn start(building: &Building, host: &str) -> Site {
    Setup::new(&building.toml).arguments(["--host", host]).start()
}

/// A session that dials the desk as a client; none if it is not let in. `own` are the files of who it
/// says it is.
fn dial(endpoint: &str, ca: &Path, own: Option<&Files>) -> Option<zenoh::Session> {
    let mut tls = json!({ "root_ca_certificate": ca, "verify_name_on_connect": true });
    if let Some(own) = own {
        tls["enable_mtls"] = true.into();
        tls["connect_certificate"] = json!(own.certificate);
        tls["connect_private_key"] = json!(own.key);
    }
    let config = json!({
        "mode": "client",
        "connect": { "endpoints": [endpoint], "timeout_ms": 1500, "exit_on_failure": true },
        "scouting": { "multicast": { "enabled": false } },
        "transport": { "link": { "tls": tls } },
    });
    let config = zenoh::Config::from_json5(&config.to_string()).unwrap();
    zenoh::open(config).wait().ok()
}

fn put(session: &zenoh::Session, key: &str, bytes: &[u8]) {
    let put = session.put(key.to_owned(), bytes.to_vec());
    let _ = put.congestion_control(CongestionControl::Block).wait(); // it may have been thrown out
}

/// What the bridge of the desk counts.
fn counts(desk: &mut Site, name: &str) -> u64 {
    desk.wait_until("the bridge", |report| Some(count(find(report, "bridge"), name)))
}

/// What the bridge says of whoever has no right to.
fn alarm(report: &supervisor::StatusReport) -> Option<String> {
    fault(report, "bridge", "unauthorised")
}

/// Scans of `edge` come to the desk, and more than `least` class maps were made of them.
fn flows(report: &supervisor::StatusReport, least: u64) -> Option<()> {
    (count(find(report, "anomaly room"), "class_maps_in") > least).then_some(())
}

#[track_caller]
fn wait_for_count(desk: &mut Site, name: &str, least: u64) {
    desk.wait_until(name, |report| (count(find(report, "bridge"), name) >= least).then_some(()));
}

/// A change that nobody raised.
fn forged(sequence: u64) -> EventChange {
    let text = r#"{"origin":"hall","sequence":1,"id":"hall-1","kind":"intrusion","state":"raised",
        "stamp_ns":1795000000000000001,"first_evidence_ns":2,"area":"hall","zone":null,"x_m":0.1,
        "y_m":2.0,"bounds_m":[0.0,0.0,1.0,1.0],"score":9.3,"threshold":9.0,"extrapolated":false,
        "text":"FORGED"}"#;
    let text = text.replace("\"intrusion\"", "\"loitering\"");
    EventChange { sequence, ..serde_json::from_str(&text).unwrap() }
}

#[test]
fn whoever_has_no_right_to_changes_nothing_and_is_counted_and_told() {
    let building = building();
    let (mut edge, mut desk) = (start(&building, "edge"), start(&building, "desk"));
    desk.wait_until("scans through TLS", |report| flows(report, 5));
    assert_eq!(alarm(&desk.status().unwrap()), None, "between friends");
    // Whoever looks whether somebody is there is counted, and calls nobody.
    for _ in 0..3 {
        drop(TcpStream::connect(("127.0.0.1", building.ports[1])).unwrap());
    }
    wait_for_count(&mut desk, "connections_without_a_word", 3);
    assert_eq!(alarm(&desk.status().unwrap()), None, "nobody said a word");
    let told = Desk::open_while_degraded(&edge); // `yard` is not there, and everybody says so
    let raised = told.hold_laser_until_told(&mut edge, 0);

    let tls = building.scratch.0.join("tls");
    let ca = tls.join("site-ca.pem");
    let endpoint = format!("tls/127.0.0.1:{}", building.ports[1]);
    let connections = knock(&building, &endpoint, &ca);
    wait_for_count(&mut desk, "connections_refused_unauthorised", connections);

    // Somebody who has the certificate of `yard` speaks as others, and nonsense as itself.
    let total = 100_000;
    let yard = Files::of(&tls, "yard");
    let session = dial(&endpoint, &ca, Some(&yard)).expect("a host of the site");
    let foreign = speak_as_others(&session, total / 2);
    wait_for_count(&mut desk, "messages_refused_unauthorised", foreign);
    let own = speak_nonsense(&session, total / 2);
    wait_for_count(&mut desk, "messages_refused_too_long", 1);
    let heard = |report: &supervisor::StatusReport| {
        let bridge = find(report, "bridge");
        let names = ["health_refused", "pages_refused", "health_dropped", "pages_put_off"];
        names.iter().map(|name| count(bridge, name)).sum::<u64>() >= own
    };
    desk.wait_until("the nonsense", |report| heard(report).then_some(()));
    drop(session);

    // Somebody who stole the certificate of `edge` tells its old events again.
    let edge_files = Files::of(&tls, "edge");
    let session = dial(&endpoint, &ca, Some(&edge_files)).expect("it says that it is edge");
    replay_old_events(&session, &edge, &mut desk);
    drop(session);

    println!("{}", desk.wait_until("the alarm", alarm));
    // Everything goes on.
    told.release_laser(&mut edge, &raised.change.id);
    let again = told.hold_laser_until_told(&mut edge, told.count());
    told.release_laser(&mut edge, &again.change.id);
    let sent = of(journal_of(&edge, "edge", "hall"));
    let rows = wait_for_rows(&desk, "desk", "hall", sent.len());
    assert_eq!(rows, sent, "what happened, and nothing else");
    assert!(rows.iter().all(|change| change.text != "FORGED"));
    assert_whole(&(1..).zip(rows).collect::<Vec<_>>());
    let restarts = desk.status().unwrap().services.iter().map(|s| s.restarts).sum::<u64>();
    assert_eq!(restarts, 0, "nobody fell over");
    desk.stop();
    edge.stop();
}

/// Strangers knock without end, most of them without a word: the hosts of the site find each other again.
#[test]
fn whoever_knocks_without_end_keeps_nobody_out() {
    let building = building();
    let (mut edge, mut desk) = (start(&building, "edge"), start(&building, "desk"));
    desk.wait_until("scans through TLS", |report| flows(report, 5));
    let knocks = AtomicU64::new(0);
    let is_over = AtomicBool::new(false);
    let address = ("127.0.0.1", building.ports[0]); // the desk dials the edge
    let took_ms = std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut silent = VecDeque::new();
            while !is_over.load(Ordering::Relaxed) {
                let Ok(mut stranger) = TcpStream::connect(address) else { continue };
                if knocks.fetch_add(1, Ordering::Relaxed).is_multiple_of(2) {
                    let _ = stranger.write_all(b"GET / HTTP/1.0\r\n\r\n");
                } else {
                    silent.push_back(stranger);
                }
                if silent.len() > 500 {
                    silent.pop_front();
                }
                std::thread::sleep(Duration::from_millis(3));
            }
        });
        wait_for_count(&mut edge, "connections_refused_unauthorised", 50);
        let killed = desk.kill("bridge", Signal::KILL);
        let begin = Instant::now();
        desk.wait_until("the bridge again", |report| {
            find(report, "bridge").pid.filter(|pid| *pid != killed)
        });
        let before = count(find(&desk.status().unwrap(), "anomaly room"), "class_maps_in");
        desk.wait_until("scans again", |report| flows(report, before + 5));
        is_over.store(true, Ordering::Relaxed);
        begin.elapsed().as_millis()
    });
    println!("{} strangers; scans again after {took_ms} ms", knocks.into_inner());
    println!("{}", edge.wait_until("the strangers are told", alarm));
    desk.stop();
    edge.stop();
}

/// The key of `edge` was stolen, and every host has a site file with the number of its next certificate.
#[test]
fn a_stolen_certificate_says_nothing_once_the_next_one_has_a_number() {
    let mut building = building();
    let (scratch, tls) = (&building.scratch.0, building.scratch.0.join("tls"));
    let stolen = Files::of(&scratch.join("stolen"), "edge");
    std::fs::create_dir(scratch.join("stolen")).unwrap();
    let own = Files::of(&tls, "edge");
    std::fs::rename(&own.certificate, &stolen.certificate).unwrap();
    std::fs::rename(&own.key, &stolen.key).unwrap();
    let second =
        Identity::new("t", "edge", &format!("127.0.0.1:{}", building.ports[0])).numbered(2);
    certificates::issue(&scratch.join("ca"), &tls, &second, now_s(), 10).unwrap();
    let id = "id = \"edge\"\n";
    building.toml = building.toml.replacen(id, &format!("{id}certificate_number = 2\n"), 1);

    let (mut edge, mut desk) = (start(&building, "edge"), start(&building, "desk"));
    desk.wait_until("scans by the second certificate", |report| flows(report, 5));
    let endpoint = format!("tls/127.0.0.1:{}", building.ports[1]);
    // It is of the site's authority, so that it may connect.
    let thief = dial(&endpoint, &tls.join("site-ca.pem"), Some(&stolen)).expect("a connection");
    wait_for_count(&mut desk, "connections_refused_unauthorised", 1);
    let text = desk.wait_until("the thief is told", alarm);
    assert!(
        text.contains("a certificate of no host of this site") && text.contains("edge.t"),
        "{text}"
    );
    speak_as_others(&thief, 1000);
    let before = count(find(&desk.status().unwrap(), "anomaly room"), "class_maps_in");
    desk.wait_until("scans of the second certificate", |report| flows(report, before + 5));
    assert_eq!(journal_of(&desk, "desk", "hall").len(), 0, "nothing was forged");
    desk.stop();
    edge.stop();
}

/// Somebody who stole the certificate of the desk asks the journal of the edge as fast as it can, so that
/// the link is busy both ways: zenoh alone does not survive that over TLS.
#[test]
fn a_host_that_asks_like_mad_is_told_and_nobody_falls_over() {
    let building = building();
    let (mut edge, mut desk) = (start(&building, "edge"), start(&building, "desk"));
    desk.wait_until("scans through TLS", |report| flows(report, 5));
    // It speaks the same TLS, so it takes the same care, and has a process of its own to take it in.
    let asked = super::process_of("intruder::the_one_who_asks_like_mad")
        .env("TOG_TEST_ASKS", format!("tls/127.0.0.1:{}", building.ports[0]))
        .env("TOG_TEST_TLS", building.scratch.0.join("tls"))
        .env("ZENOH_RUNTIME", "(rx: (handover: tx))")
        .output()
        .unwrap();
    assert!(asked.status.success(), "{}", String::from_utf8_lossy(&asked.stdout));
    wait_for_count(&mut edge, "questions_put_off", 1000);
    wait_for_count(&mut edge, "questions_refused", 100);
    let text = edge.wait_until("the flood is told", |report| fault(report, "bridge", "flooded"));
    assert!(text.starts_with("other hosts send faster than this one reads"), "{text}");
    let before = count(find(&desk.status().unwrap(), "anomaly room"), "class_maps_in");
    desk.wait_until("everything goes on", |report| flows(report, before + 5));
    for site in [&mut edge, &mut desk] {
        let restarts = site.status().unwrap().services.iter().map(|s| s.restarts).sum::<u64>();
        assert_eq!(restarts, 0, "nobody fell over");
    }
    desk.stop();
    edge.stop();
}

#[test]
#[ignore = "the process that another test starts"]
fn the_one_who_asks_like_mad() {
    let endpoint = std::env::var("TOG_TEST_ASKS").expect("started by another test");
    let tls = std::path::PathBuf::from(std::env::var_os("TOG_TEST_TLS").unwrap());
    let files = Files::of(&tls, "desk");
    let session = dial(&endpoint, &tls.join("site-ca.pem"), Some(&files)).expect("a desk");
    let log = topic::log_key("t", "edge");
    for n in 0..if is_nightly() { 2_000_000 } else { 60_000 } {
        let asked = session.get(if n % 64 == 0 { log.clone() } else { format!("{log}?after=0") });
        let asked = asked.congestion_control(CongestionControl::Block).callback(|_| ()).wait();
        asked.expect("nobody throws it out");
    }
}

/// Who has no certificate, or not the right one. How many connections there were at least.
fn knock(building: &Building, endpoint: &str, ca: &Path) -> u64 {
    let port = building.ports[1];
    // Not even TLS.
    let mut raw = TcpStream::connect(("127.0.0.1", port)).unwrap();
    raw.write_all(b"GET / HTTP/1.0\r\n\r\n").unwrap();
    let mut rest = Vec::new();
    let _ = raw.read_to_end(&mut rest); // an alert of TLS, or nothing
    assert!(dial(&format!("tcp/127.0.0.1:{port}"), ca, None).is_none(), "plain TCP");
    assert!(dial(endpoint, ca, None).is_none(), "no certificate");
    let other = building.scratch.0.join("other");
    certificates::init(&other, "t", now_s(), 10).unwrap();
    let identity = Identity::new("t", "edge", "127.0.0.1:1");
    let twin = building.scratch.0.join("twin");
    let twin = certificates::issue(&other, &twin, &identity, now_s(), 10).unwrap();
    assert!(dial(endpoint, ca, Some(&twin)).is_none(), "the right name of another authority");
    // The right authority, but no host of this site: it may connect, and say nothing.
    let (authority, ghost) = (building.scratch.0.join("ca"), building.scratch.0.join("ghost"));
    let identity = Identity::new("t", "ghost", "127.0.0.1:1");
    let ghost = certificates::issue(&authority, &ghost, &identity, now_s(), 10).unwrap();
    if let Some(session) = dial(endpoint, ca, Some(&ghost)) {
        for _ in 0..1000 {
            put(&session, &topic::health_key("t", "edge"), b"boo");
            put(&session, &topic::scan_key("t", "edge", "north"), b"boo");
        }
    }
    5
}

/// Good messages, each of somebody else. How many.
fn speak_as_others(session: &zenoh::Session, messages: u64) -> u64 {
    let page = |after| EventPage {
        host: "edge".to_owned(),
        epoch: 1,
        after,
        head: after + 1,
        rows: vec![EventRow { journal_id: after + 1, change: forged(after + 1) }],
    };
    let scan = encode(&CarriedScan::default()).unwrap();
    let health = Health { service: "bridge".to_owned(), ..Health::default() };
    let health = encode(&HostHealth { host: "edge".to_owned(), health }).unwrap();
    for n in 0..messages / 4 {
        put(session, &topic::scan_key("t", "edge", "north"), &scan);
        put(session, &topic::live_key("t", "edge"), &encode(&page(n)).unwrap());
        put(session, &topic::health_key("t", "edge"), &health);
        put(session, &topic::health_key("t", "desk"), &health);
    }
    messages / 4 * 4
}

/// Under its own keys, which it may use. How many.
fn speak_nonsense(session: &zenoh::Session, messages: u64) -> u64 {
    put(session, &topic::live_key("t", "yard"), &vec![0xa5; 400_000]);
    let mut garbage = Vec::new();
    for n in 0..messages / 2 {
        garbage.push((n * 31 % 251) as u8);
        let from = garbage.len().saturating_sub(1 + n as usize % 900);
        put(session, &topic::health_key("t", "yard"), &garbage[from..]);
        put(session, &topic::live_key("t", "yard"), &garbage[from..]);
    }
    messages / 2 * 2
}

/// The journal of the edge, told once more by somebody else.
fn replay_old_events(session: &zenoh::Session, edge: &Site, desk: &mut Site) {
    let rows = journal_of(edge, "edge", "hall");
    assert!(!rows.is_empty());
    let epoch = edge.dir.join("state/edge/bridge/epoch.json");
    let epoch: u64 = std::fs::read_to_string(epoch).unwrap().trim().parse().unwrap();
    let before = counts(desk, "events_repeated");
    for (row, change) in &rows {
        let page = EventPage {
            host: "edge".to_owned(),
            epoch,
            after: row - 1,
            head: rows.last().unwrap().0,
            rows: vec![EventRow { journal_id: *row, change: change.clone() }],
        };
        put(session, &topic::live_key("t", "edge"), &encode(&page).unwrap());
    }
    wait_for_count(desk, "events_repeated", before + rows.len() as u64);
    let cleared = |change: &EventChange| change.state == EventState::Cleared;
    assert!(!cleared(&rows.last().unwrap().1), "the laser is still held");
}

#[test]
fn a_host_without_its_certificate_does_not_begin() {
    let building = building();
    let tls = building.scratch.0.join("tls");
    std::fs::remove_file(tls.join("edge.key")).unwrap();
    let mut edge = start(&building, "edge");
    let code = edge.wait_end_of_run();
    let log = edge.log().text();
    assert_eq!(code, Some(78), "{log}");
    assert!(log.contains("this host cannot prove who it is") && log.contains("edge.key"), "{log}");
    assert!(log.contains("tog certs issue"), "{log}");
}
