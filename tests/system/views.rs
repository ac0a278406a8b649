//! Frames and maps of an area at a host that follows it: the same as where it runs.

use super::bridge::{start, two_hosts};
use harness::{Site, WATCHDOG, count, find};
use process::{Bus, EventLoop, Instance, Subscriber};
use protocol::frame::FrameHeader;
use protocol::grid::{ClassMapHeader, CollapsedMapHeader};
use protocol::site::Site as SiteFile;
use protocol::topic;
use rustix::process::Signal;
use std::collections::BTreeMap;
use std::time::Instant;

/// What somebody on a host reads of the area `hall`, by the number of the frame.
pub(super) struct Eyes {
    events: EventLoop,
    frames: Subscriber<FrameHeader, u64>,
    classes: Subscriber<ClassMapHeader, u8>,
    collapsed: Subscriber<CollapsedMapHeader, u64>,
    pub(super) seen_frames: BTreeMap<u64, (u64, Vec<u64>)>,
    pub(super) seen_classes: BTreeMap<u64, (u32, Vec<u8>)>,
    pub(super) seen_collapsed: BTreeMap<u64, Vec<u64>>,
    _bus: Bus,
}

impl Eyes {
    pub(super) fn open(site: &Site, toml: &str) -> Self {
        let file = SiteFile::parse(toml, "t").unwrap_or_else(|errors| panic!("{errors}"));
        let area = file.areas.iter().find(|area| area.id == "hall").unwrap();
        let (grid, classes) = (area.grid(), area.class_names().len());
        let instance = Instance::load(&site.run_dir).unwrap();
        let events = EventLoop::new().unwrap();
        let bus = Bus::open(&instance, &events).unwrap();
        Self {
            frames: bus.subscriber(&topic::frame("hall", grid.plane_words())).unwrap(),
            classes: bus.subscriber(&topic::classes("hall", grid.cells())).unwrap(),
            collapsed: bus.subscriber(&topic::collapsed("hall", grid.cells(), classes)).unwrap(),
            seen_frames: BTreeMap::new(),
            seen_classes: BTreeMap::new(),
            seen_collapsed: BTreeMap::new(),
            events,
            _bus: bus,
        }
    }

    /// Waits for a moment, or until there is something, and looks.
    pub(super) fn wait_and_look(&mut self) {
        self.events.wait(Some(process::monotonic_ns() + 50_000_000)).unwrap();
        self.look();
    }

    fn look(&mut self) {
        while let Some(sample) = self.frames.receive().unwrap() {
            let header = sample.header();
            let seen = (header.lasers_present, sample.payload().to_vec());
            self.seen_frames.insert(header.number, seen);
        }
        while let Some(sample) = self.classes.receive().unwrap() {
            let header = sample.header();
            self.seen_classes.insert(header.number, (header.classes, sample.payload().to_vec()));
        }
        while let Some(sample) = self.collapsed.receive().unwrap() {
            self.seen_collapsed.insert(sample.header().number, sample.payload().to_vec());
        }
    }
}

/// Looks at both until they have `more` further frames and class maps in common, and a collapsed map.
pub(super) fn look_at_both(at_home: &mut Eyes, afar: &mut Eyes, more: usize) {
    fn common<T>(a: &BTreeMap<u64, T>, b: &BTreeMap<u64, T>, from: u64) -> usize {
        a.range(from..).filter(|(number, _)| b.contains_key(number)).count()
    }
    at_home.look();
    let from = at_home.seen_frames.last_key_value().map_or(0, |(number, _)| number + 1);
    let begin = Instant::now();
    loop {
        at_home.look();
        afar.look();
        if common(&at_home.seen_frames, &afar.seen_frames, from) >= more
            && common(&at_home.seen_classes, &afar.seen_classes, from) >= more
            && common(&at_home.seen_collapsed, &afar.seen_collapsed, 0) >= 1
        {
            return;
        }
        let count = |eyes: &Eyes| {
            let frames = eyes.seen_frames.range(from..).count();
            (frames, eyes.seen_classes.range(from..).count(), eyes.seen_collapsed.len())
        };
        let counts = (count(at_home), count(afar));
        assert!(
            begin.elapsed() < WATCHDOG,
            "frames, class maps, collapsed maps of both: {counts:?}"
        );
        // Each has a loop of its own: a moment for either.
        for eyes in [&*at_home, &*afar] {
            eyes.events.wait(Some(process::monotonic_ns() + 10_000_000)).unwrap();
        }
    }
}

pub(super) fn assert_equal<T: PartialEq>(
    what: &str,
    at_home: &BTreeMap<u64, T>,
    afar: &BTreeMap<u64, T>,
) {
    for (number, seen) in afar {
        if let Some(known) = at_home.get(number) {
            assert!(known == seen, "{what} {number} differs");
        }
    }
}

#[test]
fn a_host_that_follows_an_area_has_its_frames_and_maps_although_bridges_are_killed() {
    let toml = two_hosts();
    let following = toml.replace("desk = true\n", "desk = true\nfollows = [\"hall\"]\n");
    assert_ne!(toml, following);
    let mut edge = start(&following, "edge", &[]);
    edge.wait_until_frames_flow(5);
    let report = edge.status().unwrap();
    assert_eq!(count(find(&report, "bridge"), "maps_out"), 0, "nobody listens: nothing is sent");
    let mut desk = start(&following, "desk", &[]);
    desk.wait_until_frames_flow(5);
    let (mut at_home, mut afar) = (Eyes::open(&edge, &following), Eyes::open(&desk, &following));
    look_at_both(&mut at_home, &mut afar, 20);
    edge.kill("bridge", Signal::KILL);
    look_at_both(&mut at_home, &mut afar, 20);
    desk.kill("bridge", Signal::KILL);
    look_at_both(&mut at_home, &mut afar, 20);
    assert_equal("frame", &at_home.seen_frames, &afar.seen_frames);
    assert_equal("class map", &at_home.seen_classes, &afar.seen_classes);
    assert_equal("collapsed map", &at_home.seen_collapsed, &afar.seen_collapsed);
    let hits = |(_, words): &(u64, Vec<u64>)| words.iter().any(|word| *word != 0);
    assert!(afar.seen_frames.values().all(hits), "a frame of nothing shows nothing");
    let report = desk.wait_until("the bridge", |report| {
        let bridge = find(report, "bridge");
        (count(bridge, "maps_in") > 0).then(|| report.clone())
    });
    assert_eq!(count(find(&report, "bridge"), "maps_refused"), 0, "{}", report.table());
    // Nobody is at the desk: nothing is sent any more.
    desk.stop();
    edge.wait_until("nobody who listens", |report| {
        (find(report, "bridge").gauges["maps_wanted"] == 0.0).then_some(())
    });
    edge.stop();
}

#[test]
fn a_desk_records_what_is_there_and_that_is_replayed() {
    let toml = two_hosts().replace("desk = true\n", "desk = true\nfollows = [\"hall\"]\n")
        + "[recorder]\ndir = \"rec\"\nclasses_period_s = 0.1\n";
    let mut edge = start(&toml, "edge", &[]);
    let mut desk = start(&toml, "desk", &[]);
    desk.wait_until("something recorded", |report| {
        let recorder = find(report, "recorder");
        let maps_in = count(find(report, "bridge"), "maps_in");
        (count(recorder, "messages_written") > 200 && maps_in > 50).then_some(())
    });
    let report = edge.status().unwrap();
    assert!(report.services.iter().all(|service| service.name != "recorder"), "one records");
    desk.stop();
    edge.stop();
    let sessions: Vec<_> = std::fs::read_dir(desk.dir.join("rec")).unwrap().collect();
    assert_eq!(sessions.len(), 1, "{sessions:?}");
    let bag = sessions[0].as_ref().unwrap().path();
    let run = |arguments: &[&std::path::Path]| {
        let output = harness::tog(&desk.run_root(), arguments).output().unwrap();
        let words = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
        assert_eq!(output.status.code(), Some(0), "{words}");
        words
    };
    let words = run(&["bag".as_ref(), "info".as_ref(), &bag]);
    assert!(words.contains("/laser_north/scan"), "it comes here: {words}");
    assert!(
        words.contains("/area_hall/classes") && words.contains("/area_room/classes"),
        "{words}"
    );
    assert!(!words.contains("/laser_south"), "its scans stay on edge: {words}");
    let out = desk.dir.join("out");
    run(&["replay".as_ref(), &bag, "--out".as_ref(), &out]);
    assert!(out.join("room").join("classes.npy").is_file() || out.join("classes.npy").is_file());
}
