//! `cargo bench -p occupancy --bench table [-- W1r W2r W3r W1r-alone .. static gap wire long]`: the table
//! of the README.
//!
//! One thread, CPU time. Windows are full before anything is measured. The two versions take turns
//! on blocks of the same frames; medians of the blocks, and of their ratios. At the end their
//! classes, sums and counts are compared: a fast wrong answer is an error.
#![allow(clippy::unwrap_used)]

mod support;

use protocol::carried::{CarriedMap, ClassIds, MapContent, Planes, delta, key};
use protocol::codec::encode;
use support::{Dense, Incremental, Load, cpu_us, median, resident_mb};

/// Blocks measured. Each begins with the caches full of the other version's data, so they are long
/// enough for that not to count.
const BLOCKS: usize = 15;

fn main() {
    let wanted: Vec<String> =
        std::env::args().skip(1).filter(|arg| !arg.starts_with('-')).collect();
    let wants = |name: &str| wanted.is_empty() || wanted.iter().any(|wanted| wanted == name);
    println!(
        "Dense is the literal definition: the f64 formula of every cell of every frame. The ratio says \
         what following\nthe changes saves, not how fast a tuned dense version could be.\n"
    );
    println!(
        "| workload | cells | frames measured | dense us | (fusion) | incremental us | (fusion) | by planes us \
              | ratio | x real time | changed cells a frame | 60 s history MB |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    let frames = |window: usize, block: usize| (window + BLOCKS * block) as u64;
    if wants("W1r") {
        compare(&Load::w1r(frames(4500, 200)), 200);
    }
    if wants("W2r") {
        compare(&Load::w2r(frames(4500, 400)), 400);
    }
    if wants("W3r") {
        compare(&Load::w3r(frames(1500, 50)), 50);
    }
    if wants("static") {
        static_scene();
    }
    if wants("gap") {
        gaps();
    }
    if wants("wire") {
        wire();
    }
    if wants("W1r-alone") {
        alone(&Load::w1r(13_500));
    }
    if wants("W2r-alone") {
        alone(&Load::w2r(22_500));
    }
    if wants("W3r-alone") {
        alone(&Load::w3r(3_000));
    }
    if wants("long") {
        long_run();
    }
}

/// What a frame and a class map cost on their way to another host.
fn wire() {
    println!(
        "\n| to another host | frame delta bytes, median | most | key bytes | class map delta bytes, median | \
         most | key bytes | encoding both us |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for load in [Load::w1r(6000), Load::w2r(6000), Load::w3r(2000)] {
        let mut incremental = Incremental::new(&load);
        let cells = load.cells();
        let warm = load.ranges_m.len() - 1000;
        let (mut frames, mut maps) = ([const { Vec::new() }; 2], [const { Vec::new() }; 2]);
        let (mut before, mut us) = (None, Vec::new());
        for (number, scans) in load.ranges_m.iter().enumerate() {
            incremental.fuse(scans);
            let words = [incremental.fuser.hit(), incremental.fuser.known()].concat();
            incremental.step(number as u64);
            if number < warm {
                continue;
            }
            let now = (Planes { words, cells }, ClassIds(incremental.grid.classes().to_vec()));
            if let Some((planes, ids)) = &before {
                let begin = cpu_us();
                let deltas =
                    [encoded(delta(planes, &now.0), false), encoded(delta(ids, &now.1), false)];
                us.push(cpu_us() - begin);
                frames[0].push(deltas[0]);
                maps[0].push(deltas[1]);
            }
            frames[1].push(encoded(key(&now.0), true));
            maps[1].push(encoded(key(&now.1), true));
            before = Some(now);
        }
        let of = |[mut deltas, mut keys]: [Vec<f64>; 2]| {
            let most = deltas.iter().copied().fold(0.0, f64::max);
            format!("{:.0} | {most:.0} | {:.0}", median(&mut deltas), median(&mut keys))
        };
        println!("| {} | {} | {} | {:.1} |", load.name, of(frames), of(maps), median(&mut us));
    }
}

/// Bytes of the whole message.
fn encoded(codes: Vec<u32>, is_key: bool) -> f64 {
    let map = CarriedMap {
        host: "desk".to_owned(),
        area: "hall".to_owned(),
        content: MapContent::Frame,
        session: 1_764_000_000_000_000_000,
        seq: 1_000_000,
        number: 130_000_000_000,
        period_ns: 13_333_333,
        lasers_present: 15,
        context: 0,
        classes: 6,
        columns: 1200,
        rows: 1200,
        is_key,
        codes,
    };
    encode(&map).unwrap().len() as f64
}

fn compare(load: &Load, block: usize) {
    let (mut incremental, mut dense) = (Incremental::new(load), Dense::new(load));
    let warm = load.window();
    for (number, scans) in load.ranges_m[..warm].iter().enumerate() {
        incremental.frame(number as u64, scans);
        dense.frame(number as u64, scans);
    }
    incremental.changes = 0;
    let mut medians: [Vec<f64>; 6] = Default::default();
    for (index, blocks) in load.ranges_m[warm..].chunks_exact(block).enumerate() {
        let first = (warm + index * block) as u64;
        let numbered = || (first..).zip(blocks);
        let per_frame = |from: f64| (cpu_us() - from) / block as f64;
        let start = cpu_us();
        let by_planes = index % 3 == 2;
        let mut fusion = 0.0;
        for (number, scans) in numbered() {
            let before = cpu_us();
            incremental.fuse(scans);
            fusion += cpu_us() - before;
            if by_planes {
                incremental.step_by_planes(number);
            } else {
                incremental.step(number);
            }
        }
        // Reading the clock costs as much as a small frame: every second block goes without.
        let split = index % 3 == 1;
        let fast = per_frame(start);
        if split {
            medians[3].push(fusion / block as f64);
        }
        let start = cpu_us();
        for (number, scans) in numbered() {
            dense.frame(number, scans);
        }
        let slow = per_frame(start);
        let start = cpu_us();
        for (_, scans) in numbered() {
            dense.fuse(scans);
        }
        medians[1].push(per_frame(start));
        medians[0].push(slow);
        if by_planes {
            medians[4].push(fast);
        } else {
            medians[2].push(fast);
            medians[5].push(slow / fast);
        }
    }
    check(load, &incremental, &dense);
    let measured = (load.ranges_m.len() - warm) as f64 * 2.0 / 3.0;
    let [dense_us, dense_fusion, fast_us, fast_fusion, planes_us, ratio] =
        medians.map(|mut values| median(&mut values));
    println!(
        "| {} | {} | {} | {dense_us:.0} | {dense_fusion:.0} | {fast_us:.1} | {fast_fusion:.1} \
         | {planes_us:.1} | {ratio:.1} | {:.0} | {:.0} | {:.2} |",
        load.name,
        load.cells(),
        load.ranges_m.len() - warm,
        load.frame_period_ns as f64 * 1e-3 / fast_us,
        incremental.changes as f64 / measured,
        incremental.grid.history_bytes() as f64 * 1e-6,
    );
}

fn check(load: &Load, incremental: &Incremental, dense: &Dense) {
    assert!(incremental.grid.classes() == dense.grid.classes(), "classes differ");
    let mut counts = vec![0; load.config.classes() * load.cells()];
    incremental.grid.collapsed(0, &mut counts);
    assert!(counts == dense.grid.collapsed(0), "counts differ");
    for cell in 0..load.cells() {
        assert_eq!(incremental.grid.known(cell), dense.grid.known(cell), "K of cell {cell}");
        for k in 0..load.config.windows.len() {
            assert_eq!(incremental.grid.sum(k, cell), dense.grid.sum(k, cell), "S of cell {cell}");
        }
    }
}

/// The incremental version with the caches to itself, in four parts of the run.
fn alone(load: &Load) {
    let before = resident_mb();
    let mut incremental = Incremental::new(load);
    for (number, scans) in load.ranges_m[..load.window()].iter().enumerate() {
        incremental.frame(number as u64, scans);
    }
    let memory_mb = resident_mb() - before;
    let rest = &load.ranges_m[load.window()..];
    let block = rest.len() / 12;
    let (mut both, mut fusion) = (Vec::new(), Vec::new());
    for (index, blocks) in rest.chunks_exact(block).enumerate() {
        let first = (load.window() + index * block) as u64;
        let start = cpu_us();
        for (number, scans) in (first..).zip(blocks) {
            incremental.frame(number, scans);
        }
        both.push((cpu_us() - start) / block as f64);
        // The same frames once more to a fusion that stands where this one stood.
        let mut fuser = incremental.fuser.clone();
        let start = cpu_us();
        for scans in blocks.iter().rev() {
            for (laser, ranges_m) in scans.iter().enumerate() {
                fuser.apply(laser, ranges_m);
            }
        }
        fusion.push((cpu_us() - start) / block as f64);
    }
    let least = both.iter().copied().fold(f64::INFINITY, f64::min);
    let median_us = median(&mut both);
    println!(
        "\n{} alone: {median_us:.1} us a frame (least {least:.1}), fusion {:.1}, {:.0} x real time; \
         {memory_mb:.0} MB resident, of these wedges {:.1} and history {:.2}",
        load.name,
        median(&mut fusion),
        load.frame_period_ns as f64 * 1e-3 / median_us,
        incremental.fuser.wedge_bytes() as f64 * 1e-6,
        incremental.grid.history_bytes() as f64 * 1e-6,
    );
}

/// The first frames after a gap: the frames that never came are steps as well, and many cells change.
fn gaps() {
    let load = Load::w1r(4500 + 100);
    let (warm, after) = load.ranges_m.split_at(load.window());
    let mut warmed = Incremental::new(&load);
    for (number, scans) in (0..).zip(warm) {
        warmed.frame(number, scans);
    }
    println!(
        "\n| W1r after a gap of | first frame ms | slowest of the next 99 us |\n|---|---|---|"
    );
    for gap_s in [0.5, 2.0, 10.0, 30.0, 120.0] {
        let mut slowest = [Vec::new(), Vec::new()];
        for _ in 0..5 {
            let mut incremental = warmed.clone();
            let first = warm.len() as u64 + (gap_s * 1e9 / load.frame_period_ns as f64) as u64;
            let mut took_us = Vec::new();
            for (number, scans) in (first..).zip(after) {
                let start = cpu_us();
                incremental.frame(number, scans);
                took_us.push(cpu_us() - start);
            }
            slowest[0].push(took_us[0]);
            slowest[1].push(took_us[1..].iter().copied().fold(0.0, f64::max));
        }
        let [first_us, next_us] = slowest.map(|mut values| median(&mut values));
        println!("| {gap_s} s | {:.2} | {next_us:.0} |", first_us * 1e-3);
    }
}

/// The same scan for ever: what a frame costs when nothing changes.
fn static_scene() {
    let load = Load::w1r(1);
    let mut incremental = Incremental::new(&load);
    for number in 0..10_000 {
        incremental.frame(number, &load.ranges_m[0]);
    }
    let (mut lists, mut planes) = (Vec::new(), Vec::new());
    let mut number = 10_000;
    for block in 0..40 {
        let start = cpu_us();
        for _ in 0..500 {
            incremental.fuse(&load.ranges_m[0]);
            if block % 2 == 0 {
                incremental.step(number);
            } else {
                incremental.step_by_planes(number);
            }
            number += 1;
        }
        let per_frame = (cpu_us() - start) / 500.0;
        if block % 2 == 0 { &mut lists } else { &mut planes }.push(per_frame);
    }
    println!(
        "\nW1r without change: {:.2} us a frame, by planes {:.2} us",
        median(&mut lists),
        median(&mut planes)
    );
}

/// Twenty minutes of W2r, warm-up included.
fn long_run() {
    let load = Load::w2r(90_000);
    let mut incremental = Incremental::new(&load);
    let start = cpu_us();
    for (number, scans) in (0..).zip(&load.ranges_m) {
        incremental.frame(number, scans);
    }
    let us = cpu_us() - start;
    let frames = load.ranges_m.len() as f64;
    println!(
        "\nW2r, 20 minutes from the first frame: {:.2} s, {:.1} us a frame, {:.0} x real time, \
         60 s history {:.2} MB",
        us * 1e-6,
        us / frames,
        frames * load.frame_period_ns as f64 * 1e-3 / us,
        incremental.grid.history_bytes() as f64 * 1e-6,
    );
}
