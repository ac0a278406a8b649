//! Start, stop, a second instance, and what a crashed run leaves.

use super::{ROOM, SERVICES};
use harness::{
    Random, Setup, Site, WATCHDOG, count, find, is_nightly, kill, pids, processes_of,
    shared_memory, tog,
};
use rustix::process::Signal;
use std::time::{Duration, Instant};
use supervisor::StatusReport;

#[test]
fn a_site_that_is_asked_to_stop_leaves_nothing() {
    for signal in [Signal::TERM, Signal::INT] {
        let mut site = Site::start(ROOM);
        let report = site.wait_until_frames_flow(10);
        let mut names: Vec<_> = pids(&report).into_keys().collect();
        names.sort();
        let mut expected = SERVICES.map(str::to_owned).to_vec();
        expected.sort();
        assert_eq!(names, expected);
        site.running().signal(signal);
        let (code, log) = site.wait_end();
        assert_eq!(code, Some(0), "{log}");
        assert!(!log.contains("killed"), "{log}");
    }
}

#[test]
fn a_site_ends_by_itself_after_its_seconds() {
    let mut site = Setup::new(ROOM).arguments(["--seconds", "2"]).start();
    let (code, log) = site.wait_end();
    assert_eq!(code, Some(0), "{log}");
    assert!(log.contains("its time is over"), "{log}");
}

#[test]
fn the_status_is_told_to_people_and_to_programs() {
    let mut site = Site::start(ROOM);
    site.wait_until_frames_flow(10);
    let json = site.tog(&["status"], &["--format", "json"]);
    let report: StatusReport = serde_json::from_slice(&json.stdout).unwrap();
    assert!(count(find(&report, "fusion room"), "frames_out") > 0, "{report:?}");
    let text = String::from_utf8(site.tog(&["status"], &[]).stdout).unwrap();
    for service in SERVICES {
        assert!(text.contains(service), "{text}");
    }
    site.stop();
    let silent = site.tog(&["status"], &[]);
    assert_eq!(silent.status.code(), Some(1));
    let words = String::from_utf8(silent.stderr).unwrap();
    assert!(words.contains("no site runs") && words.contains("tog run"), "{words}");
}

#[test]
fn a_second_instance_is_refused_by_name_and_the_first_goes_on() {
    let mut site = Site::start(ROOM);
    let before = pids(&site.wait_until_frames_flow(1));
    let second = tog(&site.run_root(), ["run"]).arg(site.file()).output().unwrap();
    let words = String::from_utf8(second.stderr).unwrap();
    assert_eq!(second.status.code(), Some(1), "{words}");
    let pid = site.running().pid();
    assert!(words.contains(&format!("process {pid}")) && words.contains("already runs"), "{words}");
    let after = site.wait_until_frames_flow(10);
    assert_eq!(pids(&after), before);
    site.stop();
}

#[test]
fn the_shared_memory_of_a_crashed_run_is_cleared_by_the_next() {
    let mut site = Site::start(ROOM);
    let report = site.wait_until_frames_flow(10);
    let prefix = process::Instance::load(&site.run_dir).unwrap().prefix;
    // All at once, the supervisor first: nobody is left who could tidy up.
    site.running().signal(Signal::KILL);
    for pid in pids(&report).into_values() {
        kill(pid, Signal::KILL);
    }
    assert_eq!(site.wait_end_of_run(), None, "{}", site.log().text());
    let stale = shared_memory(&prefix);
    assert!(!stale.is_empty(), "a crash leaves shared memory, else this test shows nothing");
    site.start_again();
    let again = site.wait_until_frames_flow(10);
    assert!(pids(&again).values().all(|pid| !pids(&report).values().any(|old| old == pid)));
    let kept: Vec<_> = stale.iter().filter(|path| is_of_before(path, &again)).collect();
    assert!(kept.is_empty(), "{kept:?}");
    site.stop();
}

/// True if a file is older than the run.
fn is_of_before(path: &std::path::Path, report: &StatusReport) -> bool {
    let Ok(modified) = path.metadata().and_then(|data| data.modified()) else { return false };
    let age = modified.duration_since(std::time::UNIX_EPOCH).unwrap();
    (age.as_nanos() as u64) < report.started_ns
}

#[test]
fn a_site_that_is_stopped_at_any_moment_leaves_nothing_even_if_its_processes_are_killed() {
    let mut random = Random::from_environment();
    let rounds = if is_nightly() { 60 } else { 8 };
    let mut site = Site::start(ROOM);
    site.wait_until("its first start", |_| Some(()));
    for _ in 0..rounds {
        wait_for_any_moment(&site, &mut random);
        site.running().signal(Signal::TERM);
        let victims = processes_of(&site.run_dir);
        if !victims.is_empty() {
            wait_for_any_moment(&site, &mut random);
            kill(victims[random.below(victims.len() as u64) as usize], Signal::KILL);
        }
        // Before it listens to signals this one just ends it: then there is nothing yet.
        let (code, log) = site.wait_end();
        assert!(code == Some(0) || code.is_none() && log.is_empty(), "{code:?}: {log}");
        site.start_again();
    }
    site.wait_until_frames_flow(10);
    site.stop();
}

/// The moment is random, it stands for no condition: half of them while shared memory is created, half
/// while the processes start.
fn wait_for_any_moment(site: &Site, random: &mut Random) {
    let limit_ms = if random.below(2) == 0 { 30 } else { 600 };
    let (start, moment) = (Instant::now(), Duration::from_millis(random.below(limit_ms)));
    while start.elapsed() < moment {
        site.log().wait_a_moment(moment - start.elapsed().min(moment));
    }
}

#[test]
fn a_supervisor_that_is_killed_at_any_moment_leaves_nothing_that_stops_the_next() {
    let mut random = Random::from_environment();
    let rounds = if is_nightly() { 60 } else { 8 };
    let mut site = Site::start(ROOM);
    let log = |site: &Site| site.log().text();
    for _ in 0..rounds {
        wait_for_any_moment(&site, &mut random);
        site.running().signal(Signal::KILL);
        assert_eq!(site.wait_end_of_run(), None, "{}", log(&site));
        site.start_again();
    }
    site.wait_until_frames_flow(10);
    site.stop();
}

#[test]
fn a_child_of_an_earlier_supervisor_does_not_join_the_run_of_the_next() {
    let mut site = Site::start(ROOM);
    let before = site.wait_until_frames_flow(5);
    // As a supervisor would have started it that was killed in the same moment.
    let mut orphan = tog(&site.run_root(), ["laser", "--instance"]);
    orphan.arg(&site.run_dir).args(["--laser", "south"]).env(process::logging::SUPERVISED, "1");
    let output = orphan.output().unwrap();
    let words = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{words}");
    assert!(words.contains(&format!("process {} owns", site.running().pid())), "{words}");
    let after = site.wait_until_frames_flow(5);
    assert_eq!(pids(&after), pids(&before));
    site.stop();
}

#[test]
fn the_children_of_a_killed_supervisor_stop_by_themselves() {
    let mut site = Site::start(ROOM);
    site.wait_until_frames_flow(1);
    assert_eq!(processes_of(&site.run_dir).len(), SERVICES.len());
    site.running().signal(Signal::KILL);
    let start = Instant::now();
    while !processes_of(&site.run_dir).is_empty() {
        assert!(start.elapsed() < WATCHDOG, "they live on");
        site.log().wait_a_moment(Duration::from_millis(20));
    }
}
