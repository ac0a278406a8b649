//! Somebody removes files of a site that runs, or starts a second one on its state.

use super::ROOM;
use super::feed::{Desk, assert_whole, journal, wait_until_all_is_journaled};
use harness::{Site, pids, shared_memory, tog};
use mapper::shell::checkpoint_path;
use rustix::process::Signal;
use std::fs;

#[test]
fn removed_shared_memory_makes_the_site_begin_anew() {
    let mut site = Site::start(ROOM);
    let before = pids(&site.wait_until_frames_flow(5));
    let prefix = process::Instance::load(&site.run_dir).unwrap().prefix;
    shared_memory(&prefix).into_iter().for_each(|path| fs::remove_file(path).unwrap());
    // Those who run hold what they have mapped; who starts could not.
    site.kill("mapper room", Signal::KILL);
    let log = site.log();
    log.wait_for("the site begins anew");
    let after = site.wait_until("others", |report| {
        let after = pids(report);
        let all_new = after.len() == before.len()
            && after.values().all(|pid| !before.values().any(|old| old == pid));
        all_new.then_some(after)
    });
    assert_eq!(pids(&site.wait_until_frames_flow(10)), after, "and nobody ends again");
    site.stop();
}

#[test]
fn a_removed_run_directory_lets_no_second_instance_in_and_comes_back() {
    let mut site = Site::start(ROOM);
    site.wait_until_frames_flow(5);
    let prefix = process::Instance::load(&site.run_dir).unwrap().prefix;
    let memory = shared_memory(&prefix).len();
    fs::remove_dir_all(&site.run_dir).unwrap();
    let second = tog(&site.run_root(), ["run"]).arg(site.file()).output().unwrap();
    let words = String::from_utf8(second.stderr).unwrap();
    assert_eq!(second.status.code(), Some(1), "{words}");
    assert!(words.contains(&format!("process {} owns", site.running().pid())), "{words}");
    assert!(shared_memory(&prefix).len() >= memory, "nothing of the first was wiped");
    let log = site.log();
    log.wait_for("the site begins anew");
    site.wait_until_frames_flow(10);
    let flood = |line: &&String| line.contains("static storage") || line.contains("origin=");
    assert_eq!(log.all().iter().filter(flood).count(), 0, "{}", log.text());
    site.stop();
}

#[test]
fn a_state_directory_that_is_removed_is_told_and_its_journal_is_back_before_the_next_event() {
    let mut site = Site::start(ROOM);
    site.wait_until_frames_flow(5);
    let state = site.dir.join("state");
    fs::remove_dir_all(&state).unwrap();
    site.log().wait_for("was removed while the site runs");
    let journal = state.join("journal.sqlite3");
    site.wait_until("the journal", |_| journal.is_file().then_some(()));
    // The lock is there again, and was never free.
    fs::remove_file(state.join("lock")).unwrap();
    let second = tog(&site.dir.join("o"), ["run"]).arg(site.file()).output().unwrap();
    assert_eq!(second.status.code(), Some(1));
    site.log().wait_for("state/lock was removed while the site runs");
    site.stop();
}

#[test]
fn a_removed_state_directory_loses_no_event_and_no_count() {
    let mut site = Site::start(ROOM);
    site.wait_until_frames_flow(5);
    let desk = Desk::open(&mut site);
    let raised = desk.hold_laser_until_told(&mut site, 0);
    desk.release_laser(&mut site, &raised.change.id);
    wait_until_all_is_journaled(&mut site);
    fs::remove_dir_all(site.dir.join("state")).unwrap();
    let mark = desk.count();
    let raised = desk.hold_laser_until_told(&mut site, mark);
    desk.release_laser(&mut site, &raised.change.id);
    wait_until_all_is_journaled(&mut site);
    let rows = journal(&site);
    assert_whole(&rows);
    let of_room = rows.iter().filter(|(_, change)| change.origin == "room").count();
    assert!(of_room >= 4, "twice silent, twice back: {rows:#?}");
    let path = checkpoint_path(&site.dir.join("state"), "room");
    site.wait_until("a checkpoint", |_| path.exists().then_some(()));
    site.stop();
}

#[test]
fn a_state_directory_has_one_writer() {
    let mut site = Site::start(ROOM);
    site.wait_until_frames_flow(1);
    let pid = site.running().pid();
    let told = format!("process {pid} writes the state directory");
    // Another run directory, and the fast-forward, want the same state.
    let other = site.dir.join("o");
    for verb in ["run", "learn"] {
        let refused = tog(&other, [verb]).arg(site.file()).output().unwrap();
        let words = String::from_utf8(refused.stderr).unwrap();
        assert_eq!(refused.status.code(), Some(1), "{verb}: {words}");
        assert!(words.contains(&told) && words.contains("`state_dir` of its own"), "{words}");
    }
    site.wait_until_frames_flow(5);
    site.stop();
}
