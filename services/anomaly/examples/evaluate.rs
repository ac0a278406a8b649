//! Event-wise evaluation on the imagined foyer: detection per scenario with an exact binomial bound,
//! delay and position error; false alarms per hour with their Garwood bound; cost a frame.
//!
//! `cargo run --release -p anomaly --example evaluate -- [LEARN_H [CALIBRATE_H [TEST_H [RUNS [BUDGET]]]]]`
//!
//! One watch learns and calibrates; every run restores its snapshot beside other people (another
//! seed) and stages one incident at a place that is drawn from the run's number.

#[path = "../tests/foyer/mod.rs"]
mod foyer;

use anomaly::Watch;
use foyer::{Building, area_of, lasers_of, object, point, walk};
use protocol::event::{EventChange, EventState};
use protocol::site::Detector;
use scene::{Incident, Scene};
use std::time::Instant;

const ENTRANCE: [[f64; 2]; 2] = [[-3.0, 3.0], [0.6, 3.0]];
/// The incident begins so long after the watch goes on.
const BEGIN_S: u64 = 120;
const WITHIN_S: f64 = 75.0;

type Stage = fn(f64, f64, f64) -> (Vec<Incident>, [f64; 2], f64);

/// Name, and incidents for a time and two random numbers in 0..1; the place; seconds from the start
/// of the incident until there is something to see.
const SCENARIOS: [(&str, Stage); 8] = [
    ("walker off the paths", |t, a, b| {
        let far = [9.0 + a, 1.2 + 0.6 * b];
        (vec![walk("x", t, &round_trip(far, 0.0))], far, 8.0)
    }),
    ("loiterer in the open", |t, a, b| {
        let at = [6.6 + 2.0 * a, 1.6 + 0.8 * b];
        (vec![walk("x", t, &round_trip(at, 50.0))], at, 8.0)
    }),
    ("loiterer at the wall", |t, a, _| {
        let at = [7.5 + 2.0 * a, 0.5];
        (vec![walk("x", t, &round_trip(at, 50.0))], at, 8.0)
    }),
    ("stands on the path", |t, a, b| {
        let at = [3.2 + a, 3.3 + 0.3 * b];
        (vec![walk("x", t, &round_trip(at, 60.0))], at, 4.0)
    }),
    ("object in the open", |t, a, b| {
        let at = [7.0 + 2.0 * a, 1.5 + b];
        (vec![object("x", t, 300.0, at)], at, 0.0)
    }),
    ("object on the path", |t, a, b| {
        let at = [2.5 + 2.0 * a, 3.2 + 0.3 * b];
        (vec![object("x", t, 300.0, at)], at, 0.0)
    }),
    ("door held", |t, _, _| {
        let door = "exterior".to_owned();
        let held = Incident::DoorHeld { id: "x".into(), at_s: Some(t), stays_s: 150.0, door };
        (vec![held], [0.0, 3.0], 60.0)
    }),
    ("crowd of seven", |t, a, b| {
        let at = [5.5 + a, 3.0 + 0.5 * b];
        let somebody = |index: u32| {
            let angle = f64::from(index) * 0.9;
            let place = [at[0] + 0.9 * angle.cos(), at[1] + 0.9 * angle.sin()];
            walk(&format!("x{index}"), t + f64::from(index), &round_trip(place, 60.0))
        };
        ((0..7).map(somebody).collect(), at, 8.0)
    }),
];

fn round_trip(far: [f64; 2], wait_s: f64) -> Vec<scene::RoutePoint> {
    let [street, inside] = ENTRANCE;
    let middle = [4.6, 3.3];
    let mut points = vec![point(street, 0.0), point(inside, 0.0), point(middle, 0.0)];
    points.push(point(far, wait_s));
    points.extend([point(middle, 0.0), point(inside, 0.0), point(street, 0.0)]);
    points
}

fn main() {
    let mut arguments = std::env::args().skip(1).map(|text| text.parse::<f64>().ok());
    let mut next = |default: f64| arguments.next().flatten().unwrap_or(default);
    let (learn_h, calibrate_h, test_h) = (next(1.0), next(1.0), next(2.0));
    let (runs, budget) = (next(10.0) as u64, next(3.0));
    let detector = Detector {
        alarms_per_week_max: budget,
        learning_s: learn_h * 3600.0,
        calibration_s: calibrate_h * 3600.0,
        ..Detector::default()
    };
    let scene = Scene::builtin("foyer").expect("the built-in scene");
    let mut watch = Watch::new(&area_of(&scene, detector.clone()), &lasers_of(&scene));
    let mut building = Building::new(scene.clone(), 1, 0);
    let train_s = ((learn_h + calibrate_h) * 3600.0) as u64 + 120;
    let mut told = building.run(&mut watch, train_s);
    for line in watch.take_notices() {
        println!("{line}");
    }
    println!("doors: {:?}", watch.doors().collect::<Vec<_>>());
    told.retain(|(_, change)| change.state == EventState::Raised);
    let [space, time] = watch.peaks();
    println!(
        "highest normal peaks: space {:.1?}, time {:.1?}",
        &space[..space.len().min(8)],
        &time[..time.len().min(8)]
    );
    println!("raised while training: {}", told.len());
    let snapshot = watch.snapshot();
    println!("snapshot: {} bytes", snapshot.len());

    normal_life(&detector, &snapshot, &scene, test_h);
    println!("\n| scenario | found | 95 % bound | right place | median delay s | kinds |");
    println!("|---|---|---|---|---|---|");
    for (name, stage) in SCENARIOS {
        scenario(name, stage, &detector, &snapshot, &scene, runs);
    }
}

fn fresh(scene: &Scene, detector: &Detector, snapshot: &[u8]) -> Watch {
    let mut watch = Watch::new(&area_of(scene, detector.clone()), &lasers_of(scene));
    watch.restore(snapshot).expect("the snapshot of this watch");
    watch.take_notices();
    watch
}

fn normal_life(detector: &Detector, snapshot: &[u8], scene: &Scene, hours: f64) {
    let mut watch = fresh(scene, detector, snapshot);
    let mut building = Building::new(scene.clone(), 77, 0);
    building.skip(90);
    let seconds = (hours * 3600.0) as u64;
    let mut changes = Vec::new();
    let mut alarms = Vec::new();
    let (mut busy_s, mut worst_s) = (0.0, 0.0f64);
    for _ in 0..seconds * foyer::RATE_HZ {
        let frame = building.step();
        let before = Instant::now();
        watch.handle(&frame, &mut changes);
        let took_s = before.elapsed().as_secs_f64();
        busy_s += took_s;
        worst_s = worst_s.max(took_s);
        alarms.extend(changes.drain(..).filter(|change| change.state == EventState::Raised));
    }
    println!(
        "\nnormal life: {} alarms in {hours} h; {:.1} us a frame of {} cells, worst {:.0} us",
        alarms.len(),
        busy_s * 1e6 / (seconds * foyer::RATE_HZ) as f64,
        building.classes().len(),
        worst_s * 1e6
    );
    for alarm in alarms.iter().take(8) {
        println!(
            "  {} ({:.0} s)",
            alarm.text,
            (alarm.stamp_ns / 1_000_000 - 1_700_000_000_000) as f64 / 1000.0
        );
    }
}

fn scenario(
    name: &str,
    stage: Stage,
    detector: &Detector,
    snapshot: &[u8],
    scene: &Scene,
    runs: u64,
) {
    let (mut found, mut right) = (0, 0);
    let mut delays = Vec::new();
    let mut kinds: Vec<String> = Vec::new();
    for run in 0..runs {
        let draw = |salt: u64| {
            let mixed = (run + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(salt as u32 * 17);
            (mixed % 1000) as f64 / 1000.0
        };
        let start_s = 100_000 + run * 5_000;
        let begin_s = (start_s + 90 + BEGIN_S) as f64;
        let (incidents, place, visible_s) = stage(begin_s, draw(1), draw(2));
        let staged = incidents.into_iter().try_fold(scene.clone(), Scene::with_incident);
        let staged = match staged {
            Ok(staged) => staged,
            Err(error) => {
                println!("| {name} | refused: {error} |");
                return;
            }
        };
        let mut building = Building::new(staged, 1000 + run, start_s);
        building.skip(90);
        let mut watch = fresh(scene, detector, snapshot);
        let told = building.run(&mut watch, BEGIN_S + visible_s as u64 + WITHIN_S as u64);
        let after: Vec<&(f64, EventChange)> = told
            .iter()
            .filter(|(at_s, change)| {
                *at_s >= begin_s && change.state != EventState::Cleared && !change.kind.is_fault()
            })
            .collect();
        if let Some((at_s, _)) = after.iter().find(|(_, change)| change.state == EventState::Raised)
        {
            found += 1;
            delays.push((at_s - begin_s - visible_s).max(0.0));
        }
        let mut near = |at_s: f64, change: &EventChange| {
            let distance_m = |at: [f64; 2]| (change.x_m - at[0]).hypot(change.y_m - at[1]);
            distance_m(place) <= 1.0
                || building.staged_people(at_s).iter().any(|at| distance_m(*at) <= 1.0)
        };
        right += u32::from(after.first().is_some_and(|(at_s, change)| near(*at_s, change)));
        if let Some((_, change)) = after.last() {
            kinds.push(change.kind.words().to_owned());
        }
        if run == 0
            && let Some((at_s, change)) = after.last()
        {
            eprintln!("[{name}] +{:.1} s {}", at_s - begin_s, change.text);
        }
    }
    delays.sort_by(f64::total_cmp);
    kinds.sort();
    let mut tally: Vec<(String, u32)> = Vec::new();
    for kind in kinds {
        match tally.last_mut() {
            Some((last, count)) if *last == kind => *count += 1,
            _ => tally.push((kind, 1)),
        }
    }
    let tally: Vec<String> =
        tally.into_iter().map(|(kind, count)| format!("{kind} {count}")).collect();
    println!(
        "| {name} | {found}/{runs} | >= {:.0} % | {right}/{runs} | {} | {} |",
        100.0 * lower_bound(found, runs),
        delays.get(delays.len() / 2).map_or("-".to_owned(), |delay| format!("{delay:.1}")),
        tally.join(", ")
    );
}

/// Exact (Clopper and Pearson) lower bound of a share, one-sided, 95 %.
fn lower_bound(found: u32, runs: u64) -> f64 {
    let (mut low, mut high) = (0.0, f64::from(found) / runs as f64);
    for _ in 0..60 {
        let share = 0.5 * (low + high);
        let at_least: f64 = (u64::from(found)..=runs)
            .map(|k| {
                binomial(runs, k) * share.powi(k as i32) * (1.0 - share).powi((runs - k) as i32)
            })
            .sum();
        if at_least < 0.05 { low = share } else { high = share }
    }
    low
}

fn binomial(n: u64, k: u64) -> f64 {
    (0..k).map(|i| (n - i) as f64 / (i + 1) as f64).product()
}
