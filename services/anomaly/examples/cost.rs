//! What a frame costs the detector on a grid of 400 x 400 cells, by how much changes.
//!
//! `cargo run --release -p anomaly --example cost`

#[path = "../tests/foyer/mod.rs"]
mod foyer;

use anomaly::{ClassFrame, Watch};
use protocol::site::Detector;
use scene::Scene;
use std::time::Instant;

const SIDE: usize = 400;
const FRAMES: u64 = 5000;

fn main() {
    let scene = Scene::builtin("foyer").expect("the built-in scene");
    let detector = Detector { learning_s: 600.0, calibration_s: 600.0, ..Detector::default() };
    let mut area = foyer::area_of(&scene, detector);
    (area.columns, area.rows) = (SIDE as u32, SIDE as u32);
    let mut watch = Watch::new(&area, &foyer::lasers_of(&scene));
    let mut classes = vec![0u8; SIDE * SIDE];
    classes.chunks_mut(SIDE).step_by(20).for_each(|row| row.fill(4));
    let mut changes = Vec::new();
    let mut number = 1_000_000u64;
    let mut feed = |watch: &mut Watch, classes: &[u8]| {
        number += 1;
        let frame = ClassFrame { number, lasers_present: 1, context: 0, classes };
        watch.handle(&frame, &mut changes);
    };
    for _ in 0..12_400 {
        feed(&mut watch, &classes);
    }
    println!("{}", watch.phase().words());
    println!("| cells changed a frame | median us | 99 % us | worst us |");
    println!("|---|---|---|---|");
    for flips in [0usize, 10, 100, 1000] {
        let mut took_us: Vec<f64> = Vec::new();
        let mut passed: Vec<usize> = Vec::new();
        for frame in 0..FRAMES {
            // Somebody passes where nobody went: last frame's cells are empty again.
            for cell in passed.drain(..) {
                classes[cell] = 0;
            }
            for flip in 0..flips / 2 {
                let cell = SIDE * 5 + (frame as usize / 4 + flip * 3) % (SIDE * 10);
                if classes[cell] == 0 {
                    classes[cell] = 5;
                    passed.push(cell);
                }
            }
            let before = Instant::now();
            feed(&mut watch, &classes);
            took_us.push(before.elapsed().as_secs_f64() * 1e6);
        }
        took_us.sort_by(f64::total_cmp);
        let at = |share: f64| took_us[((took_us.len() - 1) as f64 * share) as usize];
        println!("| {flips} | {:.1} | {:.1} | {:.0} |", at(0.5), at(0.99), at(1.0));
    }
}
