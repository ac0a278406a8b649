//! The recorder: killed, out of room, beside others. What it wrote is compared by stamp with what
//! another recorder, `tog bag record`, wrote of the same site.

use super::ROOM;
use super::disk::Disk;
use harness::{Running, Setup, Site, count, find};
use recording::{BagDirectory, Recording, active_path, file_facts};
use rustix::process::Signal;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use supervisor::StatusReport;

fn recorded(settings: &str) -> String {
    format!("{ROOM}\n[recorder]\ndir = \"rec\"\n{settings}")
}

fn counter(report: &StatusReport, name: &str) -> u64 {
    count(find(report, "recorder"), name)
}

fn wait_for(site: &mut Site, counter_name: &str, at_least: u64) {
    site.wait_until(counter_name, |report| {
        (counter(report, counter_name) >= at_least).then_some(())
    });
}

/// Sessions of the recorder, oldest first.
fn sessions(dir: &Path) -> Vec<BagDirectory> {
    let entries = fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().path());
    let mut paths: Vec<PathBuf> = entries.filter(|path| path.is_dir()).collect();
    paths.sort();
    paths.iter().map(|path| BagDirectory::open(path).unwrap()).collect()
}

/// Every scan by topic and stamp, as bits.
type Scans = BTreeMap<(String, u64), Vec<u32>>;

fn scans_of(bag: &BagDirectory) -> Scans {
    assert_eq!(bag.active().unwrap(), [""; 0].map(PathBuf::from), "all files are complete");
    let mut scans = Scans::new();
    for file in bag.files() {
        let recording = Recording::open(bag.path().join(&file.name)).unwrap();
        for found in recording.scans().map(Result::unwrap) {
            let bits = found.scan.ranges_m.iter().map(|range| range.to_bits()).collect();
            let before = scans.insert((found.topic.to_string(), found.scan.stamp_ns), bits);
            assert_eq!(before, None, "a scan was written twice");
        }
    }
    scans
}

/// Scans that both saw are the same.
fn assert_agree(a: &Scans, b: &Scans) -> usize {
    let both = a.iter().filter_map(|(key, bits)| Some((key, bits, b.get(key)?)));
    both.inspect(|(key, a, b)| assert_eq!(a, b, "{key:?}")).count()
}

/// `tog bag record` beside the site, once it records.
fn beside(site: &Site, out: &Path) -> Running {
    let out = out.to_str().unwrap();
    let recorder = site.follow(&["bag", "record"], &["--out", out, "--topics", "scans"]);
    let begun = || fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some());
    let start = std::time::Instant::now();
    while !begun() {
        assert!(start.elapsed() < harness::WATCHDOG, "{}", recorder.log.text());
        recorder.log.wait_a_moment(std::time::Duration::from_millis(5));
    }
    recorder
}

#[test]
fn a_recorder_that_is_killed_loses_no_closed_second_and_the_next_one_recovers_it() {
    let mut site = Site::start(&recorded(""));
    site.wait_until_frames_flow(5);
    let rec = site.dir.join("rec");
    let other = site.dir.join("other");
    let mut witness = beside(&site, &other);
    wait_for(&mut site, "messages_written", 60);

    // What the recorder had written at this moment...
    let written = site.wait_until("a report", |report| Some(counter(report, "messages_written")));
    // ... is in a chunk of the file when two more were closed.
    let active = active_path(&rec_file(&rec));
    let length = || fs::metadata(&active).unwrap().len();
    for _ in 0..2 {
        let before = length();
        site.wait_until("a closed second", |_| (length() > before).then_some(()));
    }
    let killed = site.kill("recorder", Signal::KILL);
    site.wait_until("its return", |report| {
        find(report, "recorder").pid.is_some_and(|pid| pid != killed).then_some(())
    });
    wait_for(&mut site, "files_recovered", 1);
    let recovered = site.wait_until("it", |report| Some(counter(report, "messages_recovered")));
    assert!(recovered >= written, "{recovered} recovered, {written} were written");
    assert!(!active.exists(), "what was recovered and read back is deleted");
    let before = site.wait_until("it", |report| Some(counter(report, "messages_written")));
    wait_for(&mut site, "messages_written", before + 60);
    witness.signal(Signal::INT);
    assert_eq!(witness.wait().code(), Some(0), "{}", witness.log.text());
    let log = site.stop();
    assert!(log.contains("recovered"), "{log}");

    let bags = sessions(&rec);
    assert_eq!(bags.len(), 2, "one a recorder");
    let [first, second] = [0, 1].map(|session| scans_of(&bags[session]));
    let witnessed = scans_of(&BagDirectory::open(&other).unwrap());
    assert!(assert_agree(&first, &witnessed) > 0 && assert_agree(&second, &witnessed) > 0);
    for topic in ["/laser_south/scan", "/laser_north/scan"] {
        let stamps = |scans: &Scans| -> Vec<u64> {
            scans.keys().filter(|(name, _)| name == topic).map(|(_, stamp)| *stamp).collect()
        };
        let (first, second, all) = (stamps(&first), stamps(&second), stamps(&witnessed));
        let (end, begin) = (first[first.len() - 1], second[0]);
        assert!(end < begin);
        // Nothing is missing but what came between the last closed second and the new recorder.
        let missing = all.iter().filter(|stamp| !first.contains(stamp) && !second.contains(stamp));
        let missing: Vec<u64> = missing
            .copied()
            .filter(|stamp| *stamp > first[0] && *stamp < second[second.len() - 1])
            .collect();
        assert!(missing.iter().all(|stamp| (end..begin).contains(stamp)), "{missing:?}");
        println!("{topic}: {} scans lost by the kill", missing.len());
    }
}

/// The only file of the only session, when it is complete.
fn rec_file(rec: &Path) -> PathBuf {
    let bags = sessions(rec);
    let active = bags[0].active().unwrap();
    assert_eq!(active.len(), 1);
    active[0].with_extension("")
}

#[test]
fn a_full_disk_stops_the_recorder_only_and_it_goes_on_when_there_is_room() {
    let setup = Setup::new(&recorded(""));
    let Some(disk) = Disk::mount_of(&setup.dir().join("rec"), "64m") else {
        println!("skipped: no right to mount a small disk");
        return;
    };
    let mut site = setup.start();
    let disk = disk; // gone before the directory of the site
    site.wait_until_frames_flow(5);
    wait_for(&mut site, "messages_written", 60);
    disk.fill();
    let text = site.wait_until("the fault", |report| {
        let mut faults = find(report, "recorder").faults.iter();
        let fault = faults.find(|fault| fault.code == "recording_unwritable");
        fault.map(|fault| fault.text.clone())
    });
    assert!(text.contains("nothing is recorded") && text.contains("free space"), "{text}");
    // Everybody else goes on, and what is not recorded is counted.
    let frames = |report: &StatusReport| count(find(report, "anomaly room"), "class_maps_in");
    let before = site.wait_until("frames", |report| Some(frames(report)));
    site.wait_until("more", |report| (frames(report) >= before + 10).then_some(()));
    wait_for(&mut site, "messages_dropped", 1);
    let begun = site.wait_until("it", |report| Some(counter(report, "files")));
    disk.free();
    site.wait_until("a new file", |report| {
        let recorder = find(report, "recorder");
        let is_well = recorder.faults.iter().all(|fault| fault.code != "recording_unwritable");
        (is_well && counter(report, "files") > begun).then_some(())
    });
    wait_for(&mut site, "files_recovered", 1);
    let before = site.wait_until("it", |report| Some(counter(report, "messages_written")));
    wait_for(&mut site, "messages_written", before + 60);
    site.stop();
    let bags = sessions(&site.dir.join("rec"));
    assert_eq!(bags.len(), 1);
    assert!(bags[0].files().len() >= 2, "{bags:?}");
    assert!(scans_of(&bags[0]).len() > 60);
}

#[test]
fn files_follow_one_another_without_a_hole_and_each_stands_alone() {
    let mut site = Site::start(&recorded("split_s = 1\n"));
    site.wait_until_frames_flow(5);
    wait_for(&mut site, "splits", 3);
    let report = site.wait_until_healthy();
    assert_eq!(counter(&report, "messages_lost"), 0);
    site.stop();
    let bags = sessions(&site.dir.join("rec"));
    let scans = scans_of(&bags[0]);
    for topic in ["/laser_south/scan", "/laser_north/scan"] {
        let mut stamps = scans.keys().filter(|(name, _)| name == topic).map(|(_, stamp)| *stamp);
        let first = stamps.next().unwrap();
        let steps = stamps.scan(first, |last, stamp| Some(stamp - std::mem::replace(last, stamp)));
        let steps: Vec<u64> = steps.collect();
        assert!(steps.iter().all(|step| *step == 100_000_000), "{topic}: {steps:?}");
    }
    let yaml = fs::read_to_string(bags[0].path().join("metadata.yaml")).unwrap();
    for file in bags[0].files() {
        assert!(yaml.contains(&file.name), "{yaml}");
        let path = bags[0].path().join(&file.name);
        let facts = file_facts(&path).unwrap();
        let of = |name: &str| facts.topics.iter().find(|t| t.name == name).unwrap().messages;
        assert!(of("/tf_static") == 1 && of("/zones") == 1, "{facts:?}");
        let attached = recording::attachment(&path, "site.toml").unwrap().unwrap();
        let text = String::from_utf8(attached.bytes).unwrap();
        let attached = protocol::site::Site::parse(&text, "attached").unwrap();
        assert_eq!(attached.name, "t");
        assert!(recording::attachment(&path, "calibration.json").unwrap().is_some());
    }
}

#[test]
fn a_recording_is_played_as_the_site_that_is_attached_to_it() {
    let mut site = Site::start(ROOM);
    site.wait_until_frames_flow(5);
    let out = site.dir.join("walk");
    let mut recorder = site.follow(
        &["bag", "record"],
        &["--out", out.to_str().unwrap(), "--seconds", "4", "--format", "json"],
    );
    assert_eq!(recorder.wait().code(), Some(0), "{}", recorder.log.text());
    let out_text = recorder.out.text();
    let report: serde_json::Value = serde_json::from_str(&out_text).unwrap();
    assert!(report["messages"].as_u64().unwrap() >= 60 && report["messages_lost"] == 0, "{report}");
    // A bag that is there is not written over.
    let again = site.tog(&["bag", "record"], &["--out", out.to_str().unwrap()]);
    assert_eq!(again.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&again.stderr).contains("not empty"));
    site.stop();

    let scratch = harness::Scratch::new();
    let arguments = ["bag", "play", out.to_str().unwrap(), "--rate", "2"];
    let mut command = harness::tog(&scratch.0.join("r"), arguments);
    command.env("TMPDIR", &scratch.0);
    let mut played = Running::start(command);
    assert_eq!(played.wait().code(), Some(0), "{}", played.log.text());
    let log = played.log.text();
    for words in ["attached to the recording", "laser south", "laser north", "recording is over"] {
        assert!(log.contains(words), "{words}:\n{log}");
    }
    let left = fs::read_dir(&scratch.0).unwrap().filter(|entry| {
        entry.as_ref().unwrap().file_name().to_string_lossy().starts_with("tog-play")
    });
    assert_eq!(left.count(), 0, "what it needed is gone");
}
