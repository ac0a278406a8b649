//! The laser as a real process, fed from recordings and scenes, read through shared memory.
//!
//! A test starts this very program once more, as the laser: `the_laser_process` below does nothing
//! unless it finds its run directory in the environment. Nothing is timed but for a watchdog.
#![allow(clippy::unwrap_used)]

use process::domain::{Owner, OwnerOptions};
use process::{Clock, EventLoop, Role, Sample, Subscriber, monotonic_ns};
use protocol::codec::decode;
use protocol::health::{Health, ServiceState};
use protocol::scan::{LaserScan, ScanGeometry, ScanHeader};
use protocol::site::Site;
use protocol::time::SECOND_NS;
use protocol::topic;
use recording::{ScanTopic, ScanWriter};
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, Stdio};

const RUN_DIR: &str = "TOG_TEST_LASER_RUN_DIR";
/// Nothing here takes longer than a second; the machine may be busy with other work.
const WATCHDOG_NS: u64 = 120 * SECOND_NS;
const T_NS: u64 = 1_700_000_000 * SECOND_NS;

#[test]
fn the_laser_process() {
    let Some(run_dir) = std::env::var_os(RUN_DIR) else { return };
    let role = Role::Laser { laser: "l".into() };
    let code = process::run(role, Path::new(&run_dir), laser::shell::run);
    // The harness would turn it into its own exit code.
    std::process::exit(if code == std::process::ExitCode::from(78) {
        78
    } else {
        i32::from(code != std::process::ExitCode::SUCCESS)
    });
}

struct Running {
    // Dropped in this order: the owner cleans up in its directory.
    owner: Owner,
    directory: tempfile::TempDir,
    events: EventLoop,
    end_mono_ns: u64,
}

/// The owner of a site of one laser whose files are in `directory`.
fn site(directory: tempfile::TempDir, source: &str, clock: Clock) -> Running {
    let text = format!(
        "name = \"s\"\n\
         [[area]]\nid = \"a\"\norigin_m = [0, 0]\ncolumns = 10\nrows = 10\n\
         [[laser]]\nid = \"l\"\narea = \"a\"\nx_m = 0\ny_m = 0\nsource = {{ {source} }}\n"
    );
    let site: Site = toml::from_str(&text).unwrap();
    let options = OwnerOptions {
        host: None,
        run_root: directory.path().to_path_buf(),
        base_dir: directory.path().to_path_buf(),
        out_dir: None,
        clock,
    };
    let owner = Owner::start(&site, &options).unwrap();
    let end_mono_ns = monotonic_ns() + WATCHDOG_NS;
    Running { owner, directory, events: EventLoop::new().unwrap(), end_mono_ns }
}

impl Running {
    fn start_laser(&self) -> Laser {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "the_laser_process", "--nocapture"]);
        command.env(RUN_DIR, &self.owner.instance().run_dir);
        Laser(command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap())
    }

    /// Takes from `subscriber` until `take` has enough.
    fn take<H: protocol::wire::Header, E: process::Element>(
        &self,
        subscriber: &mut Subscriber<H, E>,
        mut take: impl FnMut(&Sample<H, E>) -> bool,
    ) {
        loop {
            while let Some(sample) = subscriber.receive().unwrap() {
                let is_enough = take(&sample);
                subscriber.finish(&sample.receipt());
                if is_enough {
                    return;
                }
            }
            self.events.wait(Some(self.end_mono_ns)).unwrap();
            assert!(monotonic_ns() < self.end_mono_ns, "the watchdog bit");
        }
    }

    /// Takes until the laser is dead: what a dead process sent may be gone with its memory.
    fn take_until_end_of(&self, laser: &Laser, subscriber: &mut Subscriber<ScanHeader, f32>) {
        let pid = rustix::process::Pid::from_child(&laser.0);
        let end = rustix::process::pidfd_open(pid, rustix::process::PidfdFlags::empty()).unwrap();
        self.events.watch(&end, process::Interest::Read).unwrap();
        while !self.events.wait(Some(self.end_mono_ns)).unwrap().descriptors {
            assert!(monotonic_ns() < self.end_mono_ns, "the watchdog bit");
            while let Some(sample) = subscriber.receive().unwrap() {
                subscriber.finish(&sample.receipt());
            }
        }
    }

    fn health(&self, mut is_it: impl FnMut(&Health) -> bool) -> Health {
        let bus = self.owner.bus(&self.events).unwrap();
        let mut health = bus.subscriber(&topic::health()).unwrap();
        let mut last = Health::default();
        self.take(&mut health, |sample| {
            last = decode(sample.payload()).unwrap();
            is_it(&last)
        });
        last
    }
}

struct Laser(Child);

impl Laser {
    /// Stops it as the supervisor does; its exit code and its last words.
    fn stop(mut self) -> (Option<i32>, String) {
        let pid = rustix::process::Pid::from_child(&self.0);
        rustix::process::kill_process(pid, rustix::process::Signal::TERM).unwrap();
        self.end()
    }

    fn end(&mut self) -> (Option<i32>, String) {
        let mut words = String::new();
        self.0.stderr.take().unwrap().read_to_string(&mut words).unwrap();
        (self.0.wait().unwrap().code(), words)
    }
}

impl Drop for Laser {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn directory() -> tempfile::TempDir {
    tempfile::Builder::new().prefix("t").tempdir_in("/tmp").unwrap()
}

fn recorded(directory: &Path, count: u64, period_ns: u64) -> Vec<LaserScan> {
    let geometry = ScanGeometry {
        angle_min_rad: -1.0,
        angle_increment_rad: 0.5,
        range_min_m: 0.0,
        range_max_m: 8.0,
    };
    let scans: Vec<LaserScan> = (0..count)
        .map(|number| LaserScan {
            stamp_ns: T_NS + number * period_ns,
            device_stamp_ns: 0,
            geometry,
            ranges_m: vec![number as f32 * 0.001, f32::INFINITY, 2.5],
        })
        .collect();
    let mut writer = ScanWriter::create(directory.join("r.mcap")).unwrap();
    let (topic, frame_id) = ("/scan".to_owned(), "laser".to_owned());
    writer.add_topic(ScanTopic { topic, frame_id, scan_time_s: 0.0 }).unwrap();
    for scan in &scans {
        writer.write(0, scan.stamp_ns, &scan.view()).unwrap();
    }
    writer.finish().unwrap();
    scans
}

fn received(sample: &Sample<ScanHeader, f32>) -> LaserScan {
    let header = sample.header();
    LaserScan {
        stamp_ns: header.stamp_ns,
        device_stamp_ns: header.device_stamp_ns,
        geometry: header.geometry,
        ranges_m: sample.payload().to_vec(),
    }
}

#[test]
fn a_lossless_replay_hands_on_every_scan_and_then_its_end() {
    let directory = directory();
    let scans = recorded(directory.path(), 1000, SECOND_NS / 10);
    let source = "kind = \"replay\", recording = \"r.mcap\", pace = \"lossless\"";
    let site = site(directory, source, Clock::EventTime);
    let laser = site.start_laser();
    let bus = site.owner.bus(&site.events).unwrap();
    let mut subscriber = bus.subscriber_with_credit(&topic::scan("a")).unwrap();
    let mut found = Vec::new();
    site.take(&mut subscriber, |sample| {
        if sample.is_end_of_stream() {
            assert_eq!(sample.payload().len(), 0);
            return true;
        }
        found.push(received(sample));
        false
    });
    assert!(found == scans, "{} scans, bit for bit", found.len());
    assert_eq!(subscriber.losses().lost, 0);
    // A fusion that comes late still hears of the end.
    let mut late = bus.subscriber_with_credit(&topic::scan("a")).unwrap();
    site.take(&mut late, |sample| sample.is_end_of_stream());
    let health = site.health(|health| health.state == ServiceState::Ended);
    assert_eq!(health.service, "laser l");
    assert_eq!(health.counters["scans_out"], 1000);
    let (code, words) = laser.stop();
    assert_eq!(code, Some(0), "{words}");
    drop((subscriber, late, bus));
    drop(site.owner);
    let left = std::fs::read_dir(site.directory.path()).unwrap();
    let mut left: Vec<_> = left.map(|entry| entry.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["r.mcap", "state"]);
}

#[test]
fn a_paced_replay_sends_no_scan_before_its_time() {
    let directory = directory();
    let scans = recorded(directory.path(), 60, SECOND_NS / 10);
    let source = "kind = \"replay\", recording = \"r.mcap\", pace = 20";
    // The laser may take long to start on a busy machine: the clock begins far enough ahead.
    let start_mono_ns = monotonic_ns() + 3 * SECOND_NS;
    let clock = Clock::Scaled { start_site_ns: T_NS, start_mono_ns, rate: 20.0 };
    let site = site(directory, source, clock);
    let bus = site.owner.bus(&site.events).unwrap();
    let mut subscriber = bus.subscriber(&topic::scan("a")).unwrap();
    let laser = site.start_laser();
    let mut found = Vec::new();
    site.take(&mut subscriber, |sample| {
        if !sample.is_end_of_stream() {
            let due_mono_ns = clock.deadline_mono_ns(sample.header().stamp_ns).unwrap();
            assert!(sample.header().envelope.published_mono_ns >= due_mono_ns);
            found.push(received(sample));
        }
        sample.is_end_of_stream()
    });
    // On a machine that stalls for long, scans are skipped; then the laser counts them.
    let health = site.health(|health| health.state == ServiceState::Ended);
    let count = |name: &str| health.counters[name];
    let missing = count("scans_skipped") + count("scans_passed_over");
    assert_eq!(found.len() as u64 + missing + subscriber.losses().lost, 60);
    assert!(found.iter().all(|scan| scans.contains(scan)));
    assert_eq!(laser.stop().0, Some(0));
}

#[test]
fn a_simulated_laser_keeps_to_its_own_lattice() {
    let source = "kind = \"simulator\", scene = \"foyer\", rate_hz = 75";
    let site = site(directory(), source, Clock::Wall);
    let bus = site.owner.bus(&site.events).unwrap();
    let mut subscriber = bus.subscriber(&topic::scan("a")).unwrap();
    let laser = site.start_laser();
    let mut stamps = Vec::new();
    site.take(&mut subscriber, |sample| {
        stamps.push(sample.header().stamp_ns);
        stamps.len() == 75
    });
    // Scan k is stamped k/75 s after the epoch, to the nanosecond.
    let on_lattice = |stamp_ns: &u64| (u128::from(*stamp_ns) * 75) % 1_000_000_000 < 75;
    assert!(stamps.iter().all(on_lattice), "{stamps:?}");
    assert!(stamps.is_sorted_by(|a, b| a < b));
    let health = site.health(|health| health.counters.get("scans_out").is_some_and(|n| *n >= 75));
    assert_eq!(health.state, ServiceState::Running);
    assert_eq!(laser.stop().0, Some(0));
}

#[test]
fn a_source_that_cannot_be_used_ends_the_laser_with_words_and_78() {
    let cases = [
        ("kind = \"replay\", recording = \"none.bag\"", "none.bag: cannot open"),
        ("kind = \"replay\", recording = \"r.mcap\", topic = \"/x\"", "no scans on topic /x"),
        ("kind = \"simulator\", scene = \"nowhere\"", "found scene `nowhere`"),
    ];
    for (source, expected) in cases {
        let directory = directory();
        recorded(directory.path(), 2, 1);
        let site = site(directory, source, Clock::Wall);
        let (code, words) = site.start_laser().end();
        assert_eq!(code, Some(78), "{words}");
        assert!(words.contains(expected), "{words}");
    }
}

#[test]
fn a_stamp_that_steps_by_days_ends_the_laser_and_a_cut_is_a_fault() {
    let steps = directory();
    recorded(steps.path(), 3, 25 * 3600 * SECOND_NS);
    let source = "kind = \"replay\", recording = \"r.mcap\", pace = \"lossless\"";
    let steps = site(steps, source, Clock::EventTime);
    let bus = steps.owner.bus(&steps.events).unwrap();
    let mut subscriber = bus.subscriber_with_credit(&topic::scan("a")).unwrap();
    let mut laser = steps.start_laser();
    steps.take_until_end_of(&laser, &mut subscriber);
    let (code, words) = laser.end();
    assert_eq!(code, Some(78), "{words}");
    assert!(words.contains("25 h after the scan before"), "{words}");

    let cut = directory();
    recorded(cut.path(), 100, SECOND_NS / 10);
    let path = cut.path().join("r.mcap");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 3]).unwrap();
    let cut = site(cut, source, Clock::EventTime);
    let bus = cut.owner.bus(&cut.events).unwrap();
    let mut subscriber = bus.subscriber_with_credit(&topic::scan("a")).unwrap();
    let laser = cut.start_laser();
    cut.take(&mut subscriber, |sample| sample.is_end_of_stream());
    let health = cut.health(|health| health.state == ServiceState::Ended);
    let codes: Vec<&str> = health.faults.iter().map(|fault| fault.code.as_str()).collect();
    assert_eq!(codes, ["recording_ends_early"]);
    assert_eq!(laser.stop().0, Some(0));
}
