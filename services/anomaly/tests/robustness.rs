//! Whatever comes in: no panic, and the numbers of the story hold.

#![allow(clippy::unwrap_used)]

mod foyer;

use anomaly::{ClassFrame, Watch};
use proptest::prelude::*;
use protocol::event::{EventChange, EventState};
use protocol::site::{Area, Detector, Zone};
use scene::Scene;
use std::collections::BTreeMap;

const COLUMNS: u32 = 24;
const ROWS: u32 = 16;
const CELLS: usize = 24 * 16;

/// A small area that learns and calibrates in seconds.
fn area() -> Area {
    let detector = Detector {
        alarms_per_week_max: 10_000.0,
        learning_s: 20.0,
        calibration_s: 20.0,
        area_min_m2: 0.01,
        door_held_open_s: 3.0,
    };
    let mut area = foyer::area_of(&Scene::builtin("foyer").unwrap(), detector);
    (area.columns, area.rows) = (COLUMNS, ROWS);
    area
}

fn watch(area: &Area) -> Watch {
    Watch::new(area, &foyer::lasers_of(&Scene::builtin("foyer").unwrap()))
}

/// Empty floor, a wall below, and a patch of some class.
fn map(patch: Option<([usize; 2], u8)>) -> Vec<u8> {
    let mut classes = vec![0; CELLS];
    classes[..COLUMNS as usize].fill(4);
    if let Some(([column, row], class)) = patch {
        for cell in [0, 1, COLUMNS as usize, COLUMNS as usize + 1] {
            classes[row * COLUMNS as usize + column + cell] = class;
        }
    }
    classes
}

fn feed(watch: &mut Watch, number: &mut u64, frames: u64, classes: &[u8]) -> Vec<EventChange> {
    let mut changes = Vec::new();
    for _ in 0..frames {
        *number += 1;
        let frame = ClassFrame { number: *number, lasers_present: 1, context: 0, classes };
        watch.handle(&frame, &mut changes);
    }
    changes
}

#[test]
fn an_excluded_zone_never_raises_and_a_named_one_is_named() {
    let mut area = area();
    let [x, y] = area.origin_m;
    let square = |c: f64, r: f64| {
        let at = |dc: f64, dr: f64| [x + (c + dc) * 0.1, y + (r + dr) * 0.1];
        vec![at(0.0, 0.0), at(4.0, 0.0), at(4.0, 4.0), at(0.0, 4.0)]
    };
    area.zones = vec![
        Zone { name: "curtain".into(), polygon_m: square(4.0, 6.0), exclude: true },
        Zone { name: "till".into(), polygon_m: square(14.0, 6.0), exclude: false },
    ];
    let (mut watch, mut number) = (watch(&area), 1_000_000);
    feed(&mut watch, &mut number, 30_000, &map(None));
    let told = feed(&mut watch, &mut number, 300, &map(Some(([5, 7], 2))));
    assert!(told.is_empty(), "{told:#?}");
    let told = feed(&mut watch, &mut number, 300, &map(Some(([15, 7], 2))));
    assert_eq!(told[0].zone.as_deref(), Some("till"));
    assert!(told[0].text.contains(": till of foyer, at ("), "{}", told[0].text);
}

#[test]
fn what_comes_back_within_a_minute_is_the_same_happening() {
    let (mut watch, mut number) = (watch(&area()), 1_000_000);
    feed(&mut watch, &mut number, 30_000, &map(None));
    let patch = map(Some(([15, 7], 2)));
    let mut told = feed(&mut watch, &mut number, 50, &patch);
    told.extend(feed(&mut watch, &mut number, 400, &map(None)));
    told.extend(feed(&mut watch, &mut number, 50, &patch));
    told.extend(feed(&mut watch, &mut number, 1000, &map(None)));
    told.extend(feed(&mut watch, &mut number, 50, &patch));
    let story: Vec<(&str, EventState)> =
        told.iter().map(|change| (change.id.as_str(), change.state)).collect();
    use EventState::{Cleared, Raised, Updated};
    let open: Vec<_> = story.iter().filter(|(_, state)| *state != Updated).collect();
    assert_eq!(
        open,
        [&("foyer-1", Raised), &("foyer-1", Cleared), &("foyer-1", Cleared), &("foyer-2", Raised)],
        "{story:?}"
    );
}

#[test]
fn maps_of_another_size_or_of_the_past_are_counted_and_left_out() {
    let (mut watch, mut number) = (watch(&area()), 1_000_000);
    feed(&mut watch, &mut number, 10, &map(None));
    let classes = map(None);
    let mut changes = Vec::new();
    let frame = |number, classes| ClassFrame { number, lasers_present: 1, context: 0, classes };
    watch.handle(&frame(number, &classes), &mut changes);
    watch.handle(&frame(number + 1, &classes[1..]), &mut changes);
    watch.handle(&frame(number + 5, &classes), &mut changes);
    let counters = watch.counters();
    assert_eq!((counters.frames_in, counters.frames_missed), (11, 4));
    assert_eq!((counters.frames_stale, counters.frames_refused), (1, 1));
}

#[test]
fn silence_is_told_once_and_ends_when_maps_come_again() {
    let (mut watch, mut number) = (watch(&area()), 1_000_000);
    feed(&mut watch, &mut number, 1000, &map(None));
    let mut told = Vec::new();
    let stamp_ns = (number + 100) * 100_000_000;
    watch.feed_silent(stamp_ns, 10.0, &mut told);
    watch.feed_silent(stamp_ns, 20.0, &mut told);
    assert_eq!(told.len(), 1);
    assert_eq!(watch.lost_coverage().as_ref(), Some(&told[0].text), "a fault of the health, too");
    assert!(told[0].text.contains("no class map of area `foyer` for 10 s"), "{}", told[0].text);
    assert_eq!(told[0].first_evidence_ns, number * 100_000_000);
    number += 200;
    let after = feed(&mut watch, &mut number, 200, &map(None));
    let ends: Vec<(&str, EventState)> =
        after.iter().map(|change| (change.id.as_str(), change.state)).collect();
    assert_eq!(ends, [(told[0].id.as_str(), EventState::Cleared)]);
    assert_eq!(watch.lost_coverage(), None);
}

/// A step of the fuzzed feed: gap, lasers, context, cells to set, to which class.
type Step = (u64, u64, usize, Vec<(usize, u8)>, bool);

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn any_maps_at_any_time_tell_a_story_that_holds(
        steps in prop::collection::vec(
            (
                0u64..400,
                0u64..4,
                0usize..3,
                prop::collection::vec((0..CELLS, any::<u8>()), 0..40),
                any::<bool>(),
            ),
            1..120,
        ),
        bytes in prop::collection::vec(any::<u8>(), 0..64),
    ) {
        let steps: Vec<Step> = steps;
        let area = area();
        let (mut watch, mut number) = (watch(&area), 1_000_000);
        prop_assert!(watch.restore(&bytes).is_err());
        feed(&mut watch, &mut number, 700, &map(None));
        let mut classes = map(None);
        let mut told = Vec::new();
        for (gap, lasers_present, context, cells, restart) in steps {
            number += gap;
            for (cell, class) in cells {
                classes[cell] = class;
            }
            let frame = ClassFrame { number, lasers_present, context, classes: &classes };
            watch.handle(&frame, &mut told);
            if restart {
                let bytes = watch.snapshot();
                watch.restore(&bytes).unwrap();
                watch.feed_restarted();
            }
        }
        let mut open: BTreeMap<String, EventState> = BTreeMap::new();
        for (index, change) in told.iter().enumerate() {
            prop_assert_eq!(change.sequence, index as u64 + 1);
            prop_assert!(protocol::codec::encode(change).is_ok());
            prop_assert!(change.first_evidence_ns <= change.stamp_ns);
            let before = open.insert(change.id.clone(), change.state);
            match change.state {
                EventState::Raised => prop_assert_eq!(before, None),
                EventState::Updated => prop_assert!(before.is_some()),
                EventState::Cleared => {
                    prop_assert!(matches!(before, Some(EventState::Raised | EventState::Updated)));
                }
            }
        }
    }
}
