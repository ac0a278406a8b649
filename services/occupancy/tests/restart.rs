//! A restart: history and counts written by one grid, read by another, which then goes on alike.
#![allow(clippy::unwrap_used)]

mod support;

use occupancy::{GridConfig, History, RestoreError, TemporalGrid};
use proptest::prelude::*;
use protocol::frame::FrameView;
use support::{Seeded, default_config, planes};

fn push(grid: &mut TemporalGrid, number: u64, evidence: &[u8], context: usize) {
    let (hit, known) = planes(evidence);
    grid.push(FrameView { number, hit: &hit, known: &known }, context);
}

fn counts(grid: &TemporalGrid, context: usize) -> Vec<u64> {
    let mut counts = vec![0; grid.config().classes() * grid.config().cells];
    grid.collapsed(context, &mut counts);
    counts
}

fn assert_alike(a: &TemporalGrid, b: &TemporalGrid) {
    assert_eq!(a.classes(), b.classes(), "{:?}", a.last_number());
    assert_eq!(a.last_number(), b.last_number());
    for context in 0..a.config().contexts {
        assert_eq!(counts(a, context), counts(b, context), "context {context}");
    }
    for cell in 0..a.config().cells {
        for k in 0..a.config().windows.len() {
            assert_eq!(a.sum(k, cell), b.sum(k, cell));
        }
        assert_eq!(a.known(cell), b.known(cell));
    }
}

fn config(cells: usize) -> GridConfig {
    GridConfig { contexts: 2, ..default_config(cells, [4, 12, 40]) }
}

fn flicker(random: &mut Seeded, frame: &mut [u8]) {
    for (cell, evidence) in frame.iter_mut().enumerate() {
        if random.chance(0.3 / (1 + cell % 7) as f64) {
            *evidence = random.below(3) as u8;
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]
    #[test]
    fn a_restart_goes_on_as_if_it_had_not_been(seed: u64, frames in 1_u64..120, gap in 0_u64..60) {
        let mut random = Seeded(seed);
        let mut grid = TemporalGrid::new(config(130));
        let mut frame = vec![0; 130];
        let start = [0, 1 << 40, u64::from(u32::MAX) - 50][random.below(3) as usize];
        let mut number = start;
        for _ in 0..frames {
            number += 1 + random.below(2);
            flicker(&mut random, &mut frame);
            push(&mut grid, number, &frame, usize::from(number % 50 > 25));
        }
        let history = grid.history().unwrap();
        let mut again = TemporalGrid::restore(config(130), &history).unwrap();
        prop_assert_eq!(&again.history().unwrap(), &history);
        for context in 0..2 {
            again.add_collapsed(context, &counts(&grid, context));
        }
        assert_alike(&grid, &again);
        number += gap;
        for _ in 0..80 {
            number += 1;
            flicker(&mut random, &mut frame);
            push(&mut grid, number, &frame, usize::from(number % 50 > 25));
            push(&mut again, number, &frame, usize::from(number % 50 > 25));
            assert_alike(&grid, &again);
        }
    }

    #[test]
    fn a_damaged_history_is_an_error_or_a_grid_but_never_a_panic(
        seed: u64, word: usize, change in 1_u64..u64::MAX,
    ) {
        let mut random = Seeded(seed);
        let mut history = some_history();
        for _ in 0..=random.below(2) {
            match random.below(7) {
                0 => history.last_number = change,
                1 => history.window_frames ^= change as u32,
                2 => { let at = word % history.first_hit.len(); history.first_hit[at] ^= change; }
                3 => { let at = word % history.first_known.len(); history.first_known[at] ^= change; }
                4 => { let at = word % history.frame_numbers.len(); history.frame_numbers[at] ^= change; }
                5 => { let at = word % history.frame_flips.len(); history.frame_flips[at] ^= change as u32; }
                _ => { let at = word % history.flips.len(); history.flips[at] ^= change as u32; }
            }
        }
        if let Ok(mut grid) = TemporalGrid::restore(config(130), &history)
            && let Some(next) = history.last_number.checked_add(1)
        {
            push(&mut grid, next, &[2; 130], 0);
        }
    }
}

fn some_history() -> History {
    let mut random = Seeded(3);
    let mut grid = TemporalGrid::new(config(130));
    let mut frame = vec![0; 130];
    for number in 100..200 {
        flicker(&mut random, &mut frame);
        push(&mut grid, number, &frame, 0);
    }
    grid.history().unwrap()
}

#[test]
fn a_history_of_another_grid_is_refused_in_words() {
    let history = some_history();
    let error = |config: GridConfig, history: &History| {
        TemporalGrid::restore(config, history).unwrap_err().to_string()
    };
    assert_eq!(
        error(config(200), &history),
        "history has planes of 3 and 3 words, expected 4 each for this grid"
    );
    let longer = GridConfig { windows: vec![4, 12, 41], ..config(130) };
    assert_eq!(
        error(longer, &history),
        "history holds 40 frames, expected 41..=268435456: start with empty windows"
    );
    let mut cut = history.clone();
    cut.flips.pop();
    assert!(matches!(TemporalGrid::restore(config(130), &cut), Err(RestoreError::Lengths { .. })));
    let mut twice = history.clone();
    twice.frame_numbers[1] = twice.frame_numbers[0];
    assert!(matches!(
        TemporalGrid::restore(config(130), &twice),
        Err(RestoreError::FrameOrder { .. })
    ));
    let mut hidden = history;
    hidden.first_known[0] = 0;
    hidden.first_hit[0] = 1;
    assert!(matches!(
        TemporalGrid::restore(config(130), &hidden),
        Err(RestoreError::PlaneBits { word: 0 })
    ));
}

#[test]
fn shorter_timescales_may_read_a_longer_history() {
    let mut random = Seeded(9);
    let shorter = GridConfig { windows: vec![2, 6, 20], ..config(130) };
    let (mut long, mut short) =
        (TemporalGrid::new(config(130)), TemporalGrid::new(shorter.clone()));
    let mut frame = vec![0; 130];
    for number in 1..100 {
        flicker(&mut random, &mut frame);
        push(&mut long, number, &frame, 0);
        push(&mut short, number, &frame, 0);
    }
    let again = TemporalGrid::restore(shorter, &long.history().unwrap()).unwrap();
    assert_eq!(again.classes(), short.classes());
    assert!((0..130).all(|cell| again.sum(2, cell) == short.sum(2, cell)));
}

#[test]
fn counts_of_two_days_add_up() {
    let mut grid = TemporalGrid::new(config(3));
    let size = grid.config().classes() * 3;
    let day: Vec<u64> = (0..size as u64).collect();
    grid.add_collapsed(1, &day);
    grid.add_collapsed(1, &day);
    assert_eq!(counts(&grid, 1), day.iter().map(|count| 2 * count).collect::<Vec<_>>());
    assert_eq!(counts(&grid, 0), vec![0; size]);
    assert!(grid.history().is_none(), "no frame yet");
}
