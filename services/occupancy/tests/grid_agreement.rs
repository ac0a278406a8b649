//! The incremental grid is the dense grid, bit for bit, on frames of all kinds.
#![allow(clippy::unwrap_used)]

mod support;

use occupancy::{GridConfig, TemporalGrid};
use proptest::prelude::*;
use protocol::frame::FrameView;
use support::{Pair, Seeded, default_config};

/// Windows, prototypes and limits of every kind: ties, corners, equal timescales, equal prototypes.
fn any_config(random: &mut Seeded) -> GridConfig {
    let most = if random.chance(0.2) { 8 } else { 4 };
    let timescales = 1 + random.below(most) as usize;
    let coarse = random.chance(0.6);
    let value = |random: &mut Seeded| {
        if coarse { random.below(5) as f64 / 4.0 } else { random.unit() }
    };
    let windows = (0..timescales).map(|_| 1 + random.below(40) as u32).collect();
    let mut prototypes: Vec<Vec<f64>> = (0..1 + random.below(7))
        .map(|_| (0..timescales).map(|_| value(random)).collect())
        .collect();
    if random.chance(0.2) {
        prototypes.push(prototypes[0].clone());
    }
    let share = [0.0, 0.5, 1.0, random.unit()][random.below(4) as usize];
    GridConfig {
        cells: 1 + random.below(150) as usize,
        windows,
        prototypes,
        transit: random.chance(0.6),
        known_share_min: share,
        contexts: 1 + random.below(3) as usize,
    }
}

/// Cells of different habits: some flicker, some stay, some are seldom known.
struct Habits {
    cells: Vec<(f64, [f64; 3], u8)>,
}

impl Habits {
    fn new(random: &mut Seeded, cells: usize) -> Self {
        let restless = random.unit() * random.unit();
        let cell = |random: &mut Seeded| {
            let rate = if random.chance(0.3) { 0.0 } else { restless * random.unit() };
            let weights = [random.unit() * random.unit(), random.unit(), random.unit()];
            (rate, weights, random.below(3) as u8)
        };
        Self { cells: (0..cells).map(|_| cell(random)).collect() }
    }

    fn next(&mut self, random: &mut Seeded, frame: &mut [u8]) {
        for ((rate, weights, state), out) in self.cells.iter_mut().zip(frame) {
            if random.chance(*rate) {
                let mut pick = random.unit() * weights.iter().sum::<f64>();
                *state = weights
                    .iter()
                    .position(|weight| {
                        pick -= weight;
                        pick <= 0.0
                    })
                    .unwrap_or(2) as u8;
            }
            *out = *state;
        }
    }
}

fn run(seed: u64, frames: u64) {
    let mut random = Seeded(seed);
    let config = any_config(&mut random);
    let (cells, contexts) = (config.cells, config.contexts as u64);
    let mut habits = Habits::new(&mut random, cells);
    let mut pair = Pair::new(config);
    let mut frame = vec![0; cells];
    let mut context = 0;
    // Anywhere on the lattice, also across the end of 32 bits.
    let mut number = [0, u64::from(u32::MAX) - 60, random.bits() >> 8][random.below(3) as usize];
    let missing = if random.chance(0.5) { 0.1 } else { 0.0 };
    for step in 0..frames {
        if random.chance(0.02) {
            context = random.below(contexts) as usize;
        }
        if random.chance(0.01) {
            habits = Habits::new(&mut random, cells);
        }
        number += 1;
        if random.chance(missing) {
            let most = if random.chance(0.1) { 90 } else { 3 };
            number += random.below(most);
        }
        if random.chance(0.02) {
            frame.fill(0);
            pair.dense.push_unknown(number, context);
            pair.grid.push_unknown(number, context);
        } else {
            habits.next(&mut random, &mut frame);
            pair.push(number, &frame, context);
        }
        pair.assert_classes();
        if step % 16 == 0 {
            pair.assert_equal();
        }
    }
    pair.assert_equal();
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]
    #[test]
    fn the_incremental_grid_is_the_dense_grid(seed: u64) {
        run(seed, 200);
    }
}

#[test]
fn the_incremental_grid_is_the_dense_grid_for_a_night() {
    if std::env::var_os("TOG_NIGHTLY").is_none() {
        println!("skipped: set TOG_NIGHTLY=1 for 4000 grids");
        return;
    }
    for seed in 0..4000 {
        run(seed, 600);
    }
}

#[test]
fn changed_cells_are_those_whose_class_changed() {
    let mut random = Seeded(5);
    let config = default_config(300, [5, 20, 60]);
    let mut habits = Habits::new(&mut random, config.cells);
    let mut pair = Pair::new(config);
    let mut frame = vec![0; 300];
    let mut before = pair.grid.classes().to_vec();
    let mut total = 0;
    for number in 1..500 {
        habits.next(&mut random, &mut frame);
        pair.push(number, &frame, 0);
        let mut changed = pair.grid.changed_cells().to_vec();
        changed.sort_unstable();
        let now = pair.grid.classes();
        let expected: Vec<u32> =
            (0..300_u32).filter(|&cell| before[cell as usize] != now[cell as usize]).collect();
        assert_eq!(changed, expected, "frame {number}");
        before = now.to_vec();
        total += expected.len();
    }
    assert!(total > 300, "{total} changes are too few to tell");
}

#[test]
fn a_list_of_changed_cells_gives_what_the_planes_give() {
    let mut random = Seeded(11);
    let config = default_config(500, [5, 20, 60]);
    let mut habits = Habits::new(&mut random, config.cells);
    let mut by_planes = TemporalGrid::new(config.clone());
    let mut by_list = TemporalGrid::new(config);
    let (mut frame, mut last) = (vec![0; 500], vec![0; 500]);
    for number in (1..400).filter(|number| number % 50 != 0) {
        habits.next(&mut random, &mut frame);
        let (hit, known) = support::planes(&frame);
        // Superset: the cells that differ, and some that do not.
        let listed: Vec<u32> = (0..500_u32)
            .filter(|&cell| frame[cell as usize] != last[cell as usize] || cell % 97 == 0)
            .rev()
            .collect();
        let view = FrameView { number, hit: &hit, known: &known };
        by_planes.push(view, 0);
        by_list.push_changed(view, &listed, 0);
        assert_eq!(by_planes.classes(), by_list.classes());
        last.copy_from_slice(&frame);
    }
    assert!((0..500).all(|cell| by_planes.sum(2, cell) == by_list.sum(2, cell)));
}

#[test]
fn a_gap_of_a_century_is_counted_frame_by_frame() {
    // share 0: a cell that was never seen has a class, and every missing frame counts.
    for (share, counted) in [(0.0, true), (0.5, false)] {
        let mut config = default_config(100, [5, 20, 60]);
        config.known_share_min = share;
        let mut grid = TemporalGrid::new(config.clone());
        let (hit, known) = support::planes(&[2; 100]);
        for number in 1..=100 {
            grid.push(FrameView { number, hit: &hit, known: &known }, 0);
        }
        let century = 100 * 365 * 86_400 * 75_u64;
        grid.push(FrameView { number: century, hit: &hit, known: &known }, 0);
        let mut counts = vec![0; config.classes() * 100];
        grid.collapsed(0, &mut counts);
        let total: u64 = counts.iter().skip(17).step_by(100).sum();
        if counted {
            assert_eq!(total, century);
        } else {
            // Known in half of 60 frames: from frame 30 to frame 130.
            assert_eq!(total, 101);
        }
        assert_eq!(grid.sum(2, 17), 1);
        assert_eq!(grid.known(17), 1);
    }
}
