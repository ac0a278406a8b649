//! Tests of the normal model.

use super::*;
use proptest::prelude::*;

const GRID: GridGeometry = GridGeometry { origin_m: [0.0, 0.0], cell_m: 0.1, columns: 6, rows: 5 };

fn after(frames: u32, classes: &[u8]) -> Normal {
    let mut normal = Normal::new(GRID, 0.1, 6, 1);
    for (cell, class) in classes.iter().enumerate() {
        normal.change(cell, *class);
    }
    for _ in 0..frames {
        normal.tick();
    }
    normal
}

fn take_stock(normal: &mut Normal) {
    let mut seen = [0; CLASSES_MAX];
    for cell in 0..30 {
        let stock = normal.stock(cell);
        seen.iter_mut().zip(stock.seen).for_each(|(sum, count)| *sum += count);
    }
    normal.set_map_share(&seen);
}

#[test]
fn a_class_that_was_never_seen_is_the_more_surprising_the_longer_one_has_looked() {
    let mut last = 0.0;
    for minutes in [1, 10, 60, 600] {
        let mut normal = after(minutes * 600, &[0; 30]);
        take_stock(&mut normal);
        let l = normal.surprise(14, 2);
        assert!(l > last || l == L_MAX, "{minutes} min: {l} after {last}");
        assert!(normal.surprise(14, 0) < 0.0);
        last = l;
    }
}

#[test]
fn what_the_neighbours_do_surprises_less() {
    let mut classes = [0; 30];
    for cell in [7, 8, 9, 13, 15, 19, 20, 21] {
        classes[cell] = 5;
    }
    let mut normal = after(36_000, &classes);
    take_stock(&mut normal);
    assert!(normal.surprise(14, 5) < 2.0, "in a ring of transit: {}", normal.surprise(14, 5));
    assert!(normal.surprise(14, 2) > 5.0);
}

#[test]
fn a_held_cell_learns_nothing_and_goes_on_afterwards() {
    let mut normal = after(600, &[0; 30]);
    let mut held = Plane::new(30);
    held.set(3, true);
    normal.hold(&held, &Plane::new(30));
    normal.change(3, 2);
    for _ in 0..6000 {
        normal.tick();
    }
    assert_eq!(normal.frames(3, 2), (0.0, 600.0));
    assert_eq!(normal.frames(4, 0), (6600.0, 6600.0));
    normal.hold(&Plane::new(30), &Plane::new(30));
    normal.tick();
    assert_eq!(normal.frames(3, 2), (1.0, 601.0));
}

#[test]
fn the_beginning_of_an_event_is_not_learnt() {
    let mut normal = after(600, &[0; 30]);
    normal.change(3, 2);
    (0..5).for_each(|_| normal.tick());
    let mut held = Plane::new(30);
    (2..5).for_each(|cell| held.set(cell, true));
    let mut evidence = Plane::new(30);
    evidence.set(3, true);
    normal.hold(&held, &evidence);
    assert_eq!(normal.frames(3, 2), (0.0, 600.0));
    assert_eq!(normal.frames(4, 0), (605.0, 605.0));
}

#[test]
fn unknown_is_never_learnt_as_a_class() {
    let mut normal = after(1000, &[6; 30]);
    normal.change(0, 0);
    normal.tick();
    assert_eq!(normal.frames(0, 0), (1.0, 1.0));
    assert_eq!(normal.frames(1, 0), (0.0, 0.0));
    assert_eq!(normal.usual(1), None);
}

proptest! {
    #[test]
    fn probabilities_are_a_distribution_and_counts_are_frames(
        changes in prop::collection::vec((0usize..30, 0u8..7, 1u32..50, 0usize..2), 1..80),
    ) {
        let mut normal = Normal::new(GRID, 0.1, 6, 2);
        let mut frames = 0;
        for (cell, slot, ticks, context) in changes {
            normal.set_context(context);
            normal.change(cell, slot);
            (0..ticks).for_each(|_| normal.tick());
            frames += u64::from(ticks);
        }
        take_stock(&mut normal);
        prop_assert_eq!(normal.learnt_frames(), frames);
        for cell in 0..30 {
            let sum: f64 = (0..6).map(|slot| normal.probability(cell, slot)).sum();
            prop_assert!((sum - 1.0).abs() < 1e-9, "cell {}: {}", cell, sum);
        }
        normal.settle_all();
        let counted: u64 = normal.counts.iter().flatten().map(|count| u64::from(*count)).sum();
        prop_assert_eq!(counted, 30 * frames);
    }
}
