//! Who belongs to which happening.

use super::*;
use protocol::grid::CLASSES_MAX;

const LEVELS: Levels = Levels { space: 1.0, time: 1.0 };
const FRAME_NS: u64 = SECOND_NS / 10;

fn life() -> Life {
    Life::new(crate::testing::area(200, 100).grid(), 5)
}

/// Somebody of 3 x 3 cells, twice the level, at a point in metres.
fn somebody(at_m: [f64; 2]) -> Region {
    let [column, row] = at_m.map(|m| (m / 0.1) as u32);
    Region {
        test: Test::Space,
        score: 2.0,
        cells: 9,
        span: [column, row, column + 2, row + 2],
        centre: [f64::from(column) + 1.0, f64::from(row) + 1.0],
        slots: [0; CLASSES_MAX],
        fixed: 0,
        gone: 0,
        lingering: 0,
        counted: 9,
        peak: 0,
    }
}

/// Shows the same for a second; what was told: number, state.
fn show(life: &mut Life, from_ns: u64, regions: &[Region]) -> Vec<(u64, EventState)> {
    let mut told = Vec::new();
    let mut next = 1 + life.happenings.iter().map(|known| known.number).max().unwrap_or(0);
    for frame in 0..10 {
        let stamp_ns = from_ns + frame * FRAME_NS;
        life.step(stamp_ns, regions.iter().copied(), regions, LEVELS, |happening, state| {
            if happening.number == 0 {
                happening.number = next;
                next += 1;
            }
            told.push((happening.number, state));
        });
    }
    told
}

/// Its last change, as the outbox keeps it.
fn change(kind: EventKind, stamp_ns: u64, at_m: [f64; 2]) -> EventChange {
    EventChange {
        origin: "hall".to_owned(),
        sequence: 1,
        id: "hall-1".to_owned(),
        kind,
        state: EventState::Raised,
        stamp_ns,
        first_evidence_ns: stamp_ns,
        area: "hall".to_owned(),
        zone: None,
        x_m: at_m[0],
        y_m: at_m[1],
        bounds_m: [at_m[0], at_m[1], at_m[0] + 0.3, at_m[1] + 0.3],
        score: 2.0,
        threshold: 1.0,
        extrapolated: false,
        text: String::new(),
    }
}

#[test]
fn two_people_far_apart_are_two_happenings_and_two_close_ones_are_one() {
    let mut far = life();
    let told = show(&mut far, SECOND_NS, &[somebody([2.0, 2.0]), somebody([9.0, 2.0])]);
    assert_eq!(told, [(1, EventState::Raised), (2, EventState::Raised)]);
    let mut close = life();
    let told = show(&mut close, SECOND_NS, &[somebody([2.0, 2.0]), somebody([3.5, 2.0])]);
    assert_eq!(told, [(1, EventState::Raised)]);
}

#[test]
fn what_is_near_to_a_told_happening_never_becomes_one_of_its_own() {
    let mut life = life();
    show(&mut life, SECOND_NS, &[somebody([2.0, 2.0])]);
    // For one frame 2.5 m away: a candidate. Then something shows between the two.
    let told = show(&mut life, 2 * SECOND_NS, &[somebody([2.0, 2.0]), somebody([4.8, 2.0])][..]);
    assert_eq!(told, [(2, EventState::Raised)], "5 frames far from the first are another");
    let mut life = self::life();
    show(&mut life, SECOND_NS, &[somebody([2.0, 2.0])]);
    let both = [somebody([2.0, 2.0]), somebody([4.8, 2.0])];
    life.step(2 * SECOND_NS, both.into_iter(), &both, LEVELS, |_, _| {});
    let told = show(&mut life, 2 * SECOND_NS + FRAME_NS, &[somebody([3.6, 2.0]), both[1]]);
    assert_eq!(told, [], "the first has moved within reach of the candidate: it is its own");
}

#[test]
fn somebody_who_walks_on_while_the_process_is_down_keeps_the_name() {
    let mut life = life();
    life.resume(1, &change(EventKind::UnusualActivity, SECOND_NS, [2.0, 2.0]));
    let told = show(&mut life, 4 * SECOND_NS, &[somebody([7.0, 2.0])]);
    assert_eq!(told, [], "5 m in 3 s: the same, and no news yet");
    assert_eq!((life.happenings.len(), life.happenings[0].number), (1, 1));
    // Once seen, the usual distance holds again.
    let told = show(&mut life, 5 * SECOND_NS, &[somebody([7.0, 2.0]), somebody([12.0, 2.0])]);
    assert_eq!(told, [(2, EventState::Raised)]);
}

#[test]
fn an_object_does_not_walk_on_while_the_process_is_down() {
    let mut life = life();
    life.resume(1, &change(EventKind::ObjectLeft, SECOND_NS, [2.0, 2.0]));
    let told = show(&mut life, 4 * SECOND_NS, &[somebody([7.0, 2.0])]);
    assert_eq!(told, [(2, EventState::Raised)]);
}
