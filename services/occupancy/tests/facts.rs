//! What the default classes must say of people and doors, at 10 Hz: 1 s is 10 frames, 15 s 150,
//! 60 s 600. One cell, told as a story of (seconds, `Evidence as u8`).
#![allow(clippy::unwrap_used)]

mod support;

use protocol::grid::CLASS_UNKNOWN;
use support::{Pair, default_config};

const HZ: usize = 10;
const EMPTY: u8 = 0;
const PASSING: u8 = 1;
const LINGERING: u8 = 2;
const VACATED: u8 = 3;
const BACKGROUND: u8 = 4;
const TRANSIT: u8 = 5;

/// Class after every frame of the last part of the story, both grids compared at each.
fn tell(parts: &[(f64, u8)], transit: bool) -> Vec<u8> {
    let mut config = default_config(1, [HZ as u32, 15 * HZ as u32, 60 * HZ as u32]);
    config.transit = transit;
    let mut pair = Pair::new(config);
    let mut number = 1_000_000;
    let mut classes = Vec::new();
    for (part, &(seconds, evidence)) in parts.iter().enumerate() {
        for _ in 0..(seconds * HZ as f64).round() as usize {
            number += 1;
            pair.push(number, &[evidence], 0);
            pair.assert_equal();
            if part == parts.len() - 1 {
                classes.push(pair.grid.classes()[0]);
            }
        }
    }
    classes
}

/// (class, frames) runs.
fn runs(classes: &[u8]) -> Vec<(u8, usize)> {
    classes.chunk_by(|a, b| a == b).map(|run| (run[0], run.len())).collect()
}

const EMPTY_MINUTE: (f64, u8) = (60.0, 1);
const FULL_MINUTE: (f64, u8) = (60.0, 2);

#[test]
fn a_person_who_stays_is_passing_from_half_a_second_lingering_from_7_5_background_after_30() {
    // On an exact tie the lower id: 5 frames of 10 are still `transit`, 75 of 150 still `passing`.
    assert_eq!(
        runs(&tell(&[EMPTY_MINUTE, (40.0, 2)], true)),
        [(TRANSIT, 5), (PASSING, 70), (LINGERING, 225), (BACKGROUND, 100)]
    );
    assert_eq!(
        runs(&tell(&[EMPTY_MINUTE, (40.0, 2)], false)),
        [(EMPTY, 5), (PASSING, 70), (LINGERING, 225), (BACKGROUND, 100)]
    );
}

#[test]
fn a_stay_of_over_30_s_leaves_vacated_behind_for_up_to_30_s() {
    for stay in [32.0, 45.0, 60.0, 300.0] {
        let after = tell(&[EMPTY_MINUTE, (stay, 2), (90.0, 1)], true);
        let first = after.iter().position(|&class| class == VACATED).unwrap() as f64;
        let last = after.iter().rposition(|&class| class == VACATED).unwrap() as f64;
        assert!(first / HZ as f64 <= 7.5, "{stay} s: vacated from frame {first}");
        assert!((last / HZ as f64 - 30.0).abs() < 0.3, "{stay} s: vacated to frame {last}");
        assert_eq!(*after.last().unwrap(), EMPTY);
    }
    let after = tell(&[EMPTY_MINUTE, (29.0, 2), (90.0, 1)], true);
    assert!(after.iter().all(|&class| class != VACATED), "{:?}", runs(&after));
}

#[test]
fn a_door_that_opens_for_less_than_30_s_is_vacated_while_open_and_background_as_it_shuts() {
    for open_s in [10.0, 20.0, 29.0] {
        let open = tell(&[FULL_MINUTE, (open_s, 1)], true);
        assert_eq!(*open.last().unwrap(), VACATED, "open for {open_s} s");
        let shut = tell(&[FULL_MINUTE, (open_s, 1), (10.0, 2)], true);
        let back = shut.iter().position(|&class| class == BACKGROUND).unwrap();
        assert!(back <= 8 * HZ, "background {} frames after {open_s} s", back);
        assert_eq!(*shut.last().unwrap(), BACKGROUND);
    }
    // Open for 3 s: shut again, it is background within the second.
    let shut = tell(&[FULL_MINUTE, (3.0, 1), (2.0, 2)], true);
    assert!(shut.iter().position(|&class| class == BACKGROUND).unwrap() <= HZ / 2);
}

#[test]
fn a_leg_too_quick_for_passing_is_transit_for_a_second() {
    assert_eq!(runs(&tell(&[EMPTY_MINUTE, (0.2, 2)], true)), [(TRANSIT, 2)]);
    // The last hit leaves the second after 9 more frames.
    assert_eq!(runs(&tell(&[EMPTY_MINUTE, (0.2, 2), (3.0, 1)], true)), [(TRANSIT, 9), (EMPTY, 21)]);
    assert_eq!(runs(&tell(&[EMPTY_MINUTE, (0.2, 2), (3.0, 1)], false)), [(EMPTY, 30)]);
}

#[test]
fn a_cell_is_unknown_until_it_was_known_for_half_of_the_minute_and_after_it_was_lost() {
    let seen = tell(&[(50.0, 2)], true);
    assert_eq!(runs(&seen), [(CLASS_UNKNOWN, 299), (BACKGROUND, 201)]);
    let lost = tell(&[FULL_MINUTE, (60.0, 0)], true);
    assert_eq!(lost.iter().position(|&class| class == CLASS_UNKNOWN), Some(300));
}

#[test]
fn a_dead_fusion_is_unknown_not_empty() {
    let mut pair = Pair::new(default_config(2, [10, 150, 600]));
    for number in 0..700 {
        pair.push(number, &[2, 1], 0);
    }
    assert_eq!(pair.grid.classes(), [BACKGROUND, EMPTY]);
    pair.push(700 + 599, &[2, 1], 0);
    pair.assert_equal();
    assert_eq!(pair.grid.classes(), [CLASS_UNKNOWN; 2]);
    assert_eq!(pair.grid.sum(2, 0), 1);
}
