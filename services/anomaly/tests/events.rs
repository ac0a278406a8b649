//! From an imagined foyer to events in words: what is normal is quiet, what is not is told within a
//! minute, at the right place. The long version with tables is the example `evaluate`.

#![allow(clippy::unwrap_used)]

mod foyer;

use anomaly::{Phase, Watch};
use foyer::{Building, area_of, lasers_of, object, point, walk};
use protocol::event::{EventChange, EventKind, EventState};
use protocol::site::Detector;
use scene::{Incident, Scene};
use std::sync::LazyLock;

/// Half an hour each of learning and calibration, and an incident begins so long after.
const LEARNING_S: f64 = 1800.0;
const BEGIN_S: u64 = 100;

fn scene() -> Scene {
    Scene::builtin("foyer").unwrap()
}

fn new_watch() -> Watch {
    let detector = Detector {
        alarms_per_week_max: 7.0,
        learning_s: LEARNING_S,
        calibration_s: LEARNING_S,
        ..Detector::default()
    };
    Watch::new(&area_of(&scene(), detector), &lasers_of(&scene()))
}

/// What a watch has learnt, and what it told meanwhile.
struct Learnt {
    snapshot: Vec<u8>,
    told: Vec<(f64, EventChange)>,
    notices: Vec<String>,
}

static LEARNT: LazyLock<Learnt> = LazyLock::new(|| {
    let mut watch = new_watch();
    let mut building = Building::new(scene(), 1, 0);
    let told = building.run(&mut watch, 2 * LEARNING_S as u64 + 120);
    let notices = watch.take_notices();
    Learnt { snapshot: watch.snapshot(), told, notices }
});

/// A watch that has learnt, in a building with other people, after its grid has filled.
fn ready(incidents: Vec<Incident>, seed: u64) -> (Building, Watch) {
    let staged = incidents.into_iter().try_fold(scene(), Scene::with_incident).unwrap();
    let mut watch = new_watch();
    watch.restore(&LEARNT.snapshot).unwrap();
    let mut building = Building::new(staged, seed, 50_000);
    building.skip(80);
    (building, watch)
}

fn begin_s() -> f64 {
    (50_000 + BEGIN_S) as f64
}

fn raised(told: &[(f64, EventChange)]) -> Vec<&(f64, EventChange)> {
    told.iter().filter(|(_, change)| change.state == EventState::Raised).collect()
}

fn near(change: &EventChange, at_m: [f64; 2], within_m: f64) -> bool {
    (change.x_m - at_m[0]).hypot(change.y_m - at_m[1]) <= within_m
}

fn way_to(far: [f64; 2], wait_s: f64) -> Vec<scene::RoutePoint> {
    let [street, inside, middle] = [[-3.0, 3.0], [0.6, 3.0], [4.6, 3.3]];
    [street, inside, middle]
        .map(|at| point(at, 0.0))
        .into_iter()
        .chain([point(far, wait_s)])
        .chain([middle, inside, street].map(|at| point(at, 0.0)))
        .collect()
}

#[test]
fn learning_and_calibration_are_silent_and_said() {
    let Learnt { told, notices, .. } = &*LEARNT;
    assert_eq!(told.len(), 0, "{told:?}");
    assert_eq!(notices.len(), 2, "{notices:?}");
    assert!(notices[0].contains("learnt 30 min") && notices[0].contains("calibrating"));
    assert!(notices[1].starts_with("watching") && notices[1].contains("extrapolated"));
}

#[test]
fn half_an_hour_of_normal_life_is_quiet() {
    let (mut building, mut watch) = ready(Vec::new(), 5);
    assert_eq!(watch.phase(), Phase::Watching);
    let told = building.run(&mut watch, 1800);
    let raised = raised(&told);
    // Somebody may well hold the street door for a minute: that is so, and is told.
    let other: Vec<_> =
        raised.iter().filter(|(_, change)| change.kind != EventKind::DoorHeldOpen).collect();
    assert!(other.is_empty(), "{other:#?}");
}

#[test]
fn a_walker_off_the_paths_is_told_within_seconds_at_the_right_place() {
    let far = [9.4, 1.5];
    let (mut building, mut watch) = ready(vec![walk("x", begin_s(), &way_to(far, 0.0))], 6);
    let told = building.run(&mut watch, BEGIN_S + 60);
    let (at_s, change) = raised(&told)[0];
    assert_eq!(change.kind, EventKind::UnusualActivity);
    assert!(*at_s >= begin_s() && *at_s <= begin_s() + 20.0, "{at_s}");
    let people = building.staged_people(*at_s);
    assert!(near(change, people[0], 1.0), "{change:?} but the walker is at {people:?}");
    assert!(
        change.text.starts_with("Somebody is where people do not go: foyer, at ("),
        "{}",
        change.text
    );
    assert!(change.text.contains("something passes by; normally (in "), "{}", change.text);
    assert!(change.text.contains("class transit, usually empty"), "{}", change.text);
    assert!(change.extrapolated && change.text.contains("extrapolated"), "{}", change.text);
    assert!(change.score >= change.threshold);
}

#[test]
fn somebody_who_stays_is_loitering_and_it_is_over_when_he_left() {
    let far = [8.0, 1.6];
    let (mut building, mut watch) = ready(vec![walk("x", begin_s(), &way_to(far, 25.0))], 7);
    let told = building.run(&mut watch, BEGIN_S + 90);
    let id = &raised(&told)[0].1.id;
    let story: Vec<&EventChange> =
        told.iter().map(|(_, change)| change).filter(|change| change.id == *id).collect();
    assert!(story.iter().any(|change| change.kind == EventKind::Loitering), "{story:#?}");
    assert!(story.iter().any(|change| near(change, far, 1.0)), "{story:#?}");
    let last = story[story.len() - 1];
    assert_eq!(last.state, EventState::Cleared);
    assert!(last.text.starts_with("Nothing unusual is seen any more: "), "{}", last.text);
    let sequences: Vec<u64> = told.iter().map(|(_, change)| change.sequence).collect();
    assert!(sequences.iter().copied().eq(1..=told.len() as u64), "{sequences:?}");
}

#[test]
fn an_object_that_is_left_is_told_as_such_and_stays_one_event() {
    let at = [8.1, 2.0];
    let (mut building, mut watch) = ready(vec![object("x", begin_s(), 400.0, at)], 8);
    let told = building.run(&mut watch, BEGIN_S + 180);
    let (at_s, change) = raised(&told)[0];
    assert!(*at_s <= begin_s() + 30.0 && near(change, at, 0.6), "{change:?}");
    let there: Vec<&EventChange> =
        told.iter().map(|(_, change)| change).filter(|change| near(change, at, 1.0)).collect();
    assert!(there.iter().any(|change| change.kind == EventKind::ObjectLeft), "{there:#?}");
    assert!(there.iter().all(|change| change.id == there[0].id), "{there:#?}");
    assert!(there.iter().all(|change| change.state != EventState::Cleared), "it is still there");
}

#[test]
fn a_door_that_is_held_is_told_after_its_time_with_no_set_up() {
    let held = Incident::DoorHeld {
        id: "x".to_owned(),
        at_s: Some(begin_s()),
        stays_s: 130.0,
        door: "exterior".to_owned(),
    };
    let (mut building, mut watch) = ready(vec![held], 9);
    let told = building.run(&mut watch, BEGIN_S + 180);
    let doors: Vec<&(f64, EventChange)> =
        told.iter().filter(|(_, change)| change.kind == EventKind::DoorHeldOpen).collect();
    let states: Vec<EventState> = doors.iter().map(|(_, change)| change.state).collect();
    assert_eq!(states, [EventState::Raised, EventState::Cleared], "{told:#?}");
    assert!(near(&doors[0].1, [0.0, 3.0], 0.4), "{doors:?}");
    let others = raised(&told).len() - 1;
    assert_eq!(others, 0, "the leaf itself is no object: {told:#?}");
}

#[test]
fn the_same_frames_tell_the_same_bytes() {
    let story = || {
        let (mut building, mut watch) = ready(vec![object("x", begin_s(), 60.0, [7.5, 1.8])], 10);
        let told = building.run(&mut watch, BEGIN_S + 120);
        let mut bytes = watch.snapshot();
        for (_, change) in &told {
            bytes.extend(protocol::codec::encode(change).unwrap());
        }
        bytes
    };
    assert!(story() == story());
}

#[test]
fn a_silent_laser_is_a_fault_not_a_missing_wall_and_nothing_is_learnt_meanwhile() {
    let (mut building, mut watch) = ready(Vec::new(), 11);
    building.run(&mut watch, 30);
    building.lasers = 0;
    let learnt_s = watch.learnt_s();
    let silent = building.run(&mut watch, 120);
    assert!(watch.learnt_s() - learnt_s < 1.0, "{}", watch.learnt_s() - learnt_s);
    building.lasers = 1;
    let back = building.run(&mut watch, 120);
    let kinds = |told: &[(f64, EventChange)]| -> Vec<(EventKind, EventState)> {
        told.iter().map(|(_, change)| (change.kind, change.state)).collect()
    };
    use EventState::{Cleared, Raised};
    assert_eq!(
        kinds(&silent),
        [(EventKind::LaserSilent, Raised), (EventKind::CoverageLost, Raised)],
        "{silent:#?}"
    );
    assert!(silent[0].1.text.contains("`front`"), "{}", silent[0].1.text);
    assert_eq!(
        kinds(&back),
        [(EventKind::LaserSilent, Cleared), (EventKind::CoverageLost, Cleared)],
        "{back:#?}"
    );
    assert_eq!(back[0].1.first_evidence_ns, silent[0].1.first_evidence_ns);
}

#[test]
fn an_open_event_survives_a_restart_under_its_id() {
    let at = [8.1, 2.0];
    let (mut building, mut watch) = ready(vec![object("x", begin_s(), 600.0, at)], 8);
    let told = building.run(&mut watch, BEGIN_S + 60);
    let last = &told[told.len() - 1].1;
    let number: u64 = last.id.rsplit('-').next().unwrap().parse().unwrap();
    let mut again = new_watch();
    again.restore(&watch.snapshot()).unwrap();
    again.resume(last.sequence, number, std::slice::from_ref(last));
    let after = building.run(&mut again, 120);
    let near_object: Vec<&EventChange> =
        after.iter().map(|(_, change)| change).filter(|change| near(change, at, 1.0)).collect();
    assert!(near_object.iter().all(|change| change.id == last.id), "{near_object:#?}");
    assert!(near_object.iter().all(|change| change.state == EventState::Updated));
    assert!(after.iter().all(|(_, change)| change.sequence > last.sequence));
}

#[test]
fn a_lost_model_begins_with_the_counts_of_the_mapper() {
    let mut building = Building::new(scene(), 1, 0);
    building.skip(1900);
    let mut watch = new_watch();
    assert!(!watch.seed(1, &building.collapsed()), "there is no such context");
    assert!(!watch.seed(0, &[1, 2, 3]), "another shape");
    assert!(watch.seed(0, &building.collapsed()));
    assert!(!watch.seed(0, &building.collapsed()), "it knows that already");
    building.run(&mut watch, 1);
    assert_eq!(watch.phase(), Phase::Calibrating);
}
