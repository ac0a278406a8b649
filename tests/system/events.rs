//! No event twice, none lost, while those who tell are killed.

use super::ROOM;
use super::feed::{Desk, assert_whole, journal, wait_until_all_is_journaled};
use harness::{Random, Site, is_nightly};
use protocol::event::{EventKind, EventState};
use rustix::process::Signal;
use std::time::Duration;

#[test]
fn no_event_is_lost_and_none_is_told_twice_while_those_who_tell_are_killed() {
    let mut random = Random::from_environment();
    let mut site = Site::start(ROOM);
    site.wait_until_frames_flow(5);
    let desk = Desk::open(&mut site);
    let rounds = if is_nightly() { 12 } else { 2 };
    for round in 0..rounds {
        let mark = desk.count();
        // While it begins; the moment is random, it stands for no condition.
        site.kill("laser south", Signal::STOP);
        site.log().wait_a_moment(Duration::from_millis(random.below(2000)));
        site.kill("alerts", Signal::KILL);
        if round % 2 == 1 {
            site.kill("anomaly room", Signal::KILL);
        }
        let raised = desk.hold_laser_until_told(&mut site, mark);
        // Told, and perhaps not acknowledged yet.
        site.kill("anomaly room", Signal::KILL);
        site.kill("alerts", Signal::KILL);
        if round % 3 == 2 {
            site.kill("mapper room", Signal::KILL);
        }
        desk.release_laser(&mut site, &raised.change.id);
        site.log().wait_a_moment(Duration::from_millis(random.below(50)));
        site.kill("alerts", Signal::KILL);
        site.kill("anomaly room", Signal::KILL);
        site.wait_until_frames_flow(5);
    }
    wait_until_all_is_journaled(&mut site);
    let rows = journal(&site);
    assert_whole(&rows);
    let of_laser = rows.iter().filter(|(_, change)| change.kind == EventKind::LaserSilent);
    let states: Vec<_> = of_laser.map(|(_, change)| change.state).collect();
    assert_eq!(states, [EventState::Raised, EventState::Cleared].repeat(rounds), "{rows:#?}");
    // The desk, which was there all the time, was told just that.
    let last = rows.last().map(|(journal_id, _)| *journal_id);
    desk.wait_for(0, "the last row", |told| told.journal_id == last);
    let told: Vec<_> = desk.told().into_iter().map(|t| (t.journal_id.unwrap(), t.change)).collect();
    assert_eq!(told, rows);
    println!("{} changes in {rounds} rounds, {} kills", rows.len(), rounds * 5);
    let listed = site.tog(&["alerts", "list"], &["--format", "json"]);
    assert_eq!(listed.status.code(), Some(0));
    let events = rows.iter().filter(|(_, change)| change.state == EventState::Raised).count();
    assert_eq!(String::from_utf8(listed.stdout).unwrap().lines().count(), events);
    site.stop();
    assert_eq!(journal(&site), rows, "the end of a site tells nothing");
}

#[test]
fn an_intruder_is_told_once_although_those_who_tell_are_killed() {
    let mut site = Site::demo();
    let desk = Desk::open(&mut site);
    // Somebody stands where nobody stands; who has seen it dies with the news on its lips.
    let raised = desk.wait_for(0, "the intruder", |told| {
        !told.change.kind.is_fault() && told.change.state == EventState::Raised
    });
    site.kill("anomaly foyer", Signal::KILL);
    site.kill("alerts", Signal::KILL);
    site.kill("mapper foyer", Signal::KILL);
    site.wait_until_frames_flow(20);
    site.kill("anomaly foyer", Signal::KILL);
    // It goes on: more of the same story, under the same name.
    let mark = desk.count();
    desk.wait_for(mark, "more of the intruder", |told| {
        told.change.id == raised.change.id && told.change.state == EventState::Updated
    });
    wait_until_all_is_journaled(&mut site);
    let rows = journal(&site);
    assert_whole(&rows);
    let begun = rows.iter().filter(|(_, change)| change.state == EventState::Raised);
    let begun: Vec<_> = begun.map(|(_, change)| change.id.as_str()).collect();
    assert_eq!(begun, [raised.change.id.as_str()], "{rows:#?}");
    site.stop();
}
