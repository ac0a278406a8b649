//! `cargo bench -p occupancy --bench frame [-- W1r]`: one frame of W1r (4 lasers of 181 beams, 400 x
//! 400 cells, 75 Hz), W2r (1 laser of 181 beams, 200 x 200 cells, 75 Hz) and W3r (16 lasers of 1081
//! beams, 1200 x 1200 cells, 25 Hz), both versions, windows full. Dense is the literal f64 formula of
//! every cell; it holds 60 s of whole frames, 2.2 GB for W3r, which takes minutes to fill.
#![allow(clippy::unwrap_used)]

mod support;

use criterion::{
    BenchmarkGroup, Criterion, criterion_group, criterion_main, measurement::WallTime,
};
use support::{Dense, Incremental, Load};

/// Goes round the measured frames there and back, so that no jump of the scene is measured.
struct Turns {
    first: usize,
    last: usize,
    at: usize,
    forward: bool,
    number: u64,
}

impl Turns {
    fn new(load: &Load) -> Self {
        let (first, last) = (load.window(), load.ranges_m.len() - 1);
        Self { first, last, at: first, forward: true, number: first as u64 }
    }

    fn next<'a>(&mut self, load: &'a Load) -> (u64, &'a [Vec<f32>]) {
        if self.at == self.last {
            self.forward = false;
        } else if self.at == self.first {
            self.forward = true;
        }
        self.at = if self.forward { self.at + 1 } else { self.at - 1 };
        self.number += 1;
        (self.number, &load.ranges_m[self.at])
    }
}

fn both(group: &mut BenchmarkGroup<'_, WallTime>, load: &Load) {
    let mut incremental = Incremental::new(load);
    let mut dense = Dense::new(load);
    for (number, scans) in load.ranges_m[..=load.window()].iter().enumerate() {
        incremental.frame(number as u64, scans);
        dense.frame(number as u64, scans);
    }
    let mut turns = Turns::new(load);
    group.bench_function("incremental", |bencher| {
        bencher.iter(|| {
            let (number, scans) = turns.next(load);
            incremental.frame(number, scans);
        });
    });
    let mut turns = Turns::new(load);
    group.bench_function("dense", |bencher| {
        bencher.iter(|| {
            let (number, scans) = turns.next(load);
            dense.frame(number, scans);
        });
    });
}

fn frames(criterion: &mut Criterion) {
    let loads: [fn() -> Load; 3] = [|| Load::w1r(6000), || Load::w2r(6000), || Load::w3r(1600)];
    for load in loads {
        let load = load();
        let mut group = criterion.benchmark_group(load.name);
        group.sample_size(10);
        both(&mut group, &load);
        group.finish();
    }
}

fn static_scene(criterion: &mut Criterion) {
    let load = Load::w1r(1);
    let mut incremental = Incremental::new(&load);
    let mut number = 0;
    for _ in 0..10_000 {
        incremental.frame(number, &load.ranges_m[0]);
        number += 1;
    }
    criterion.bench_function("W1r without change", |bencher| {
        bencher.iter(|| {
            incremental.frame(number, &load.ranges_m[0]);
            number += 1;
        });
    });
}

criterion_group!(benches, frames, static_scene);
criterion_main!(benches);
