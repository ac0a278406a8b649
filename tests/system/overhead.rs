//! How long a scan takes to another host: through our bridges, and the same bytes through zenoh alone.
//! Nothing is timed by an assertion; the figures are printed (`--nocapture`).

use super::bridge::{start, two_hosts};
use harness::{WATCHDOG, is_nightly};
use process::{Bus, EventLoop, Instance, monotonic_ns};
use protocol::codec::encode;
use protocol::link::CarriedScan;
use protocol::scan::{LaserScan, ScanGeometry};
use protocol::topic;
use serde_json::json;
use std::collections::BTreeMap;
use std::net::TcpListener;
use std::path::Path;
use std::process::Stdio;
use std::sync::mpsc;
use std::time::{Duration, Instant};
use zenoh::Wait;
use zenoh::qos::{CongestionControl, Priority};

const RATE_HZ: u64 = 75;

fn scans() -> usize {
    if is_nightly() { 4500 } else { 150 }
}

/// Of every scan of `room` that is published on a host, by its stamp: when, CLOCK_MONOTONIC. Looks
/// seldom, so that nobody is woken beside the bridge.
fn published(run_dir: &Path, count: usize) -> BTreeMap<u64, u64> {
    let instance = Instance::load(run_dir).unwrap();
    let bus = Bus::open(&instance, &EventLoop::new().unwrap()).unwrap();
    let mut scans = bus.subscriber_of_task(&topic::scan("room")).unwrap();
    let (mut published, begin) = (BTreeMap::new(), Instant::now());
    while published.len() < count {
        scans.begin_turn();
        while let Some(scan) = scans.receive().unwrap() {
            published.insert(scan.header().stamp_ns, scan.header().envelope.published_mono_ns);
        }
        assert!(begin.elapsed() < WATCHDOG, "{} of {count} scans", published.len());
        std::thread::sleep(Duration::from_millis(100)); // 8 scans: the queue has room for more
    }
    published
}

/// Of every scan of `room` that comes on a host, by its stamp: when it was published and when it was
/// taken, CLOCK_MONOTONIC.
fn taken(run_dir: &Path, count: usize) -> BTreeMap<u64, (u64, u64)> {
    let instance = Instance::load(run_dir).unwrap();
    let events = EventLoop::new().unwrap();
    let bus = Bus::open(&instance, &events).unwrap();
    let mut scans = bus.subscriber(&topic::scan("room")).unwrap();
    let (mut taken, begin) = (BTreeMap::new(), Instant::now());
    while taken.len() < count {
        while let Some(scan) = scans.receive().unwrap() {
            let header = scan.header();
            taken.insert(header.stamp_ns, (header.envelope.published_mono_ns, monotonic_ns()));
        }
        assert!(begin.elapsed() < WATCHDOG, "{} of {count} scans", taken.len());
        events.wait(Some(monotonic_ns() + 1_000_000_000)).unwrap();
    }
    taken
}

/// Microseconds through zenoh alone; and from the publication by the laser at `edge` to that by the bridge
/// at the desk, and to the reader there.
fn both_ways() -> (Vec<f64>, Vec<f64>, Vec<f64>) {
    let rate = format!("seed = 1, rate_hz = {RATE_HZ} }}");
    // The laser that crosses is the last; the other one would only take its turn on a small machine.
    let toml = two_hosts();
    let (others, last) = toml.rsplit_once("seed = 1 }").unwrap();
    let toml = format!("{others}{rate}{last}");
    let mut edge = start(&toml, "edge", &[]);
    let mut desk = start(&toml, "desk", &[]);
    desk.wait_until_frames_flow(5);
    let (at_edge, at_desk) = (edge.run_dir.clone(), desk.run_dir.clone());
    let sent = std::thread::spawn(move || published(&at_edge, scans()));
    let came = std::thread::spawn(move || taken(&at_desk, scans()));
    // At the same time: what else the machine does slows both.
    let plain = through_zenoh();
    let (sent, came) = (sent.join().unwrap(), came.join().unwrap());
    desk.stop();
    edge.stop();
    let us = |(stamp_ns, (handed_on_ns, taken_ns)): (&u64, &(u64, u64))| {
        let published_ns = sent.get(stamp_ns)?;
        let since = |then_ns: u64| (then_ns - published_ns) as f64 / 1e3;
        Some((since(*handed_on_ns), since(*taken_ns)))
    };
    let (handed_on, taken) = came.iter().filter_map(us).unzip();
    (plain, handed_on, taken)
}

fn session(key: &str, port: u16) -> zenoh::Session {
    let config = json!({
        "mode": "peer",
        key: { "endpoints": [format!("tcp/127.0.0.1:{port}")] },
        "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
    });
    zenoh::open(zenoh::Config::from_json5(&config.to_string()).unwrap()).wait().unwrap()
}

const KEY: &str = "tog/t/edge/scan/north";

/// Microseconds from put to callback in another process, of messages as long as those of the bridges.
fn through_zenoh() -> Vec<f64> {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    drop(listener);
    let there = super::process_of("overhead::the_one_who_listens")
        .env("TOG_TEST_LISTENS", port.to_string())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let here = session("connect", port);
    let publisher = here
        .declare_publisher(KEY)
        .congestion_control(CongestionControl::Drop)
        .priority(Priority::Data)
        .express(true)
        .wait()
        .unwrap();
    let begin = Instant::now();
    while !publisher.matching_status().wait().unwrap().matching() {
        assert!(begin.elapsed() < WATCHDOG, "the two never meet");
        std::thread::sleep(Duration::from_millis(10));
    }
    let ranges_m = vec![1.0; 181];
    let geometry = ScanGeometry {
        angle_min_rad: -1.57,
        angle_increment_rad: 0.017,
        range_min_m: 0.0,
        range_max_m: 8.0,
    };
    let scan = LaserScan { stamp_ns: 1 << 60, device_stamp_ns: 0, geometry, ranges_m };
    let (laser, session, seq) = ("north".to_owned(), 1 << 60, 1 << 20);
    let message = encode(&CarriedScan { laser, session, seq, scan: Some(scan) }).unwrap();
    for _ in 0..scans() {
        std::thread::sleep(Duration::from_nanos(1_000_000_000 / RATE_HZ));
        let mut bytes = message.clone();
        let end = bytes.len() - 8;
        bytes[end..].copy_from_slice(&monotonic_ns().to_le_bytes());
        publisher.put(bytes).wait().unwrap();
    }
    let there = there.wait_with_output().unwrap();
    let text = String::from_utf8(there.stdout).unwrap();
    assert!(there.status.success(), "{text}");
    text.lines().filter_map(|line| line.strip_prefix("us ")?.parse().ok()).collect()
}

#[test]
#[ignore = "the process that another test starts"]
fn the_one_who_listens() {
    let port = std::env::var("TOG_TEST_LISTENS").expect("started by another test");
    let here = session("listen", port.parse().unwrap());
    let (tell, told) = mpsc::channel();
    let subscriber = here.declare_subscriber(KEY).callback(move |sample| {
        let now_ns = monotonic_ns();
        let bytes = sample.payload().to_bytes();
        let sent_ns = u64::from_le_bytes(bytes[bytes.len() - 8..].try_into().unwrap());
        let _ = tell.send((now_ns - sent_ns) as f64 / 1e3);
    });
    let _subscriber = subscriber.wait().unwrap();
    for _ in 0..scans() {
        println!("us {}", told.recv_timeout(WATCHDOG).unwrap());
    }
}

fn percentiles(mut us: Vec<f64>) -> (f64, f64) {
    us.sort_unstable_by(f64::total_cmp);
    (us[us.len() / 2], us[us.len() * 99 / 100])
}

#[test]
fn what_the_bridges_add_to_zenoh_is_measured() {
    let (plain, handed_on, taken) = both_ways();
    assert!(2 * taken.len() > scans(), "{} scans seen on both hosts", taken.len());
    let count = taken.len();
    let [plain, handed_on, taken] = [plain, handed_on, taken].map(percentiles);
    println!(
        "a scan of 181 beams to another host, {count} scans, p50 and p99 in us: zenoh alone {:.0}, {:.0}; from \
         the laser's publication to the bridge's on the other host {:.0}, {:.0}: {:.2} times; to the reader \
         there {:.0}, {:.0}: {:.2} times",
        plain.0,
        plain.1,
        handed_on.0,
        handed_on.1,
        handed_on.0 / plain.0,
        taken.0,
        taken.1,
        taken.0 / plain.0
    );
}
