//! Tests of the whole building.
#![allow(clippy::unwrap_used)]

mod refused;

use crate::obstacle::Obstacles;
use crate::shape::{Circle, Segment, norm, sub};
use crate::{LaserSpec, Scene, World};
use proptest::prelude::*;

fn minimal(body: &str) -> Result<Scene, crate::SceneError> {
    let area = "name = \"t\"\n[area]\nid = \"a\"\norigin_m = [-5.0, -5.0]\ncell_m = 0.05\n\
                columns = 200\nrows = 200\n[sensor]\nsigma_m = 0.0\nfault_share = 0.0\n";
    Scene::parse(&format!("{area}{body}"), "t")
}

fn scan(world: &mut World, laser: &LaserSpec, t_s: f64) -> Vec<f32> {
    let mut out = Vec::new();
    world.scan(laser, t_s, &mut out);
    out
}

/// As bits, so that NaN equals NaN.
fn bits(ranges_m: &[f32]) -> Vec<u32> {
    ranges_m.iter().map(|r| r.to_bits()).collect()
}

#[test]
fn the_same_seed_is_the_same_building_and_another_is_not() {
    let scene = Scene::builtin("foyer").unwrap();
    let laser = scene.lasers[0].clone();
    let mut a = World::new(scene.clone(), 1).unwrap();
    let mut b = World::new(scene.clone(), 1).unwrap();
    let mut c = World::new(scene, 2).unwrap();
    let mut others = 0;
    for tick in 0..600 {
        let t = f64::from(tick) * 0.7;
        let first = scan(&mut a, &laser, t);
        assert_eq!(bits(&first), bits(&scan(&mut b, &laser, t)));
        others += usize::from(bits(&first) != bits(&scan(&mut c, &laser, t)));
        assert_eq!(a.truth(t), b.truth(t));
    }
    assert_eq!(others, 600);
}

#[test]
fn a_process_that_starts_late_sees_what_the_early_one_sees() {
    for name in ["foyer", "room"] {
        let scene = Scene::builtin(name).unwrap();
        let scene = if name == "foyer" {
            scene.staged("off-the-path", 20_000_050.0).unwrap()
        } else {
            scene
        };
        let laser = scene.lasers[0].clone();
        let mut early = World::new(scene.clone(), 9).unwrap();
        for tick in 0..3000 {
            let t = 20_000_000.0 + f64::from(tick) * 0.1;
            let seen = scan(&mut early, &laser, t);
            if tick % 271 == 0 {
                let mut late = World::new(scene.clone(), 9).unwrap();
                assert_eq!(late.truth(t), early.truth(t));
                assert_eq!(bits(&seen), bits(&scan(&mut late, &laser, t)));
            }
        }
    }
}

#[test]
fn going_back_in_time_shows_the_same_past() {
    let scene = Scene::builtin("foyer").unwrap();
    let laser = scene.lasers[0].clone();
    let mut world = World::new(scene, 3).unwrap();
    let before = scan(&mut world, &laser, -1234.5);
    scan(&mut world, &laser, 86_400.0);
    assert_eq!(bits(&before), bits(&scan(&mut world, &laser, -1234.5)));
}

#[test]
fn a_square_room_reads_as_a_ruler_says() {
    let scene = minimal(
        "[[wall]]\nclosed = true\npoints_m = [[-2.0, -1.0], [2.0, -1.0], [2.0, 3.0], [-2.0, 3.0]]\n\
         [[pillar]]\ncentre_m = [0.0, 2.0]\nradius_m = 0.25\n\
         [[laser]]\nid = \"l\"\nx_m = 0.0\ny_m = 0.0\nyaw_deg = 90.0\n",
    );
    let scene = scene.unwrap();
    let laser = scene.lasers[0].clone();
    let mut world = World::new(scene, 0).unwrap();
    let ranges = scan(&mut world, &laser, 0.0);
    assert_eq!(ranges.len(), 181);
    assert!((ranges[0] - 2.0).abs() < 1e-6, "beam 0 points to +x: {}", ranges[0]);
    assert!((ranges[90] - 1.75).abs() < 1e-6, "the pillar: {}", ranges[90]);
    assert!((ranges[180] - 2.0).abs() < 1e-6, "beam 180 points to -x: {}", ranges[180]);
    assert!((ranges[45] - 8f32.sqrt()).abs() < 1e-6, "45 degrees: {}", ranges[45]);
    let into_corner = (3.0f32 * 3.0 + 2.0 * 2.0).sqrt(); // at 56.3 degrees
    assert!((ranges[56] - into_corner).abs() < 0.05, "{}", ranges[56]);
}

#[test]
fn an_object_is_there_from_its_time_to_its_end() {
    let scene = minimal(
        "[[box]]\nid = \"bag\"\ncentre_m = [2.0, 0.0]\nsize_m = [1.0, 1.0]\nappears_s = 10.0\n\
         vanishes_s = 20.0\n[[laser]]\nid = \"l\"\nx_m = 0.0\ny_m = 0.0\nyaw_deg = 0.0\n",
    );
    let scene = scene.unwrap();
    let laser = scene.lasers[0].clone();
    let mut world = World::new(scene, 0).unwrap();
    for (t, range) in [(9.9, f32::INFINITY), (10.0, 1.5), (19.9, 1.5), (20.0, f32::INFINITY)] {
        assert_eq!(scan(&mut world, &laser, t)[90], range, "at {t}");
    }
    assert_eq!(world.truth(15.0).objects, ["bag"]);
    assert!(world.truth(25.0).objects.is_empty());
}

#[test]
fn a_scheduled_door_swings_there_and_back() {
    let scene = minimal(
        "[[door]]\nid = \"d\"\nhinge_m = [2.0, -0.5]\nleaf_m = 1.0\nclosed_deg = 90.0\n\
         open_deg = 0.0\nmove_s = 2.0\nhold_s = [1.0, 1.0]\n\
         opening = [{ at_s = 10.0, hold_s = 5.0, every_s = 60.0 }]\n\
         [[laser]]\nid = \"l\"\nx_m = 0.0\ny_m = 0.0\nyaw_deg = 0.0\n",
    );
    let scene = scene.unwrap();
    let laser = scene.lasers[0].clone();
    let mut world = World::new(scene, 0).unwrap();
    for turn in [-120.0, 0.0, 60.0, 3_600.0] {
        for (t, open) in
            [(7.9, 0.0), (9.0, 0.5), (10.0, 1.0), (15.0, 1.0), (16.0, 0.5), (17.1, 0.0)]
        {
            let door = &world.truth(t + turn).doors[0];
            assert!((door.open_share - open).abs() < 1e-9, "{t} {turn} {door:?}");
        }
        assert!((scan(&mut world, &laser, turn)[90] - 2.0).abs() < 1e-6);
        assert_eq!(scan(&mut world, &laser, turn + 12.0)[90], f32::INFINITY);
        let half = world.truth(turn + 9.0).doors[0].leaves_m[0];
        assert!((half[2] - half[0] - half[3] + half[1]).abs() < 1e-9, "45 degrees: {half:?}");
    }
}

#[test]
fn nobody_walks_through_a_wall_or_a_shut_door() {
    for (name, seed) in [("foyer", 1), ("foyer", 2), ("room", 1)] {
        let scene = Scene::builtin(name).unwrap();
        let obstacles = Obstacles::new(&scene);
        let mut world = World::new(scene, seed).unwrap();
        let mut seen = 0;
        for tick in 0..12_000 {
            let truth = world.truth(f64::from(tick) * 0.1);
            for person in &truth.people {
                for [x, y, radius_m] in person.legs_m {
                    let leg = Circle { centre: [x, y], radius_m };
                    let depth = obstacles.depth_m(&leg);
                    assert!(depth < 0.0, "{name} {person:?} is {depth} m in a wall");
                    for door in &truth.doors {
                        for &[ax, ay, bx, by] in &door.leaves_m {
                            let leaf = Segment { a: [ax, ay], b: [bx, by] };
                            let gap = leaf.distance_m(leg.centre) - radius_m;
                            assert!(gap > 0.0, "{name} at {} {person:?} is in {door:?}", truth.t_s);
                        }
                    }
                    seen += 1;
                }
            }
        }
        assert!(seen > 10_000, "{name}: {seen} legs");
    }
}

#[test]
fn people_stay_on_their_paths_and_arrive_as_often_as_the_file_says() {
    let scene = Scene::builtin("foyer").unwrap();
    let route = scene.routes.iter().find(|r| r.id == "street-to-elevator").unwrap().clone();
    let mut world = World::new(scene, 11).unwrap();
    let mut people = std::collections::BTreeSet::new();
    let hours = 8.0;
    for tick in 0..(hours * 3600.0) as u32 {
        let truth = world.truth(f64::from(tick));
        for person in truth.people.iter().filter(|person| person.origin == route.id) {
            people.insert(person.id);
            let off = (route.points.windows(2))
                .map(|pair| {
                    let side = Segment { a: pair[0].at_m, b: pair[1].at_m };
                    side.distance_m([person.x_m, person.y_m])
                })
                .fold(f64::MAX, f64::min);
            assert!(off < 0.45, "{off} m off the path: {person:?}");
            assert!(person.speed_m_s < 1.41);
        }
    }
    let expected = route.arrivals_per_hour * hours;
    let spread = 4.0 * expected.sqrt(); // a Poisson count, four sigma
    assert!((people.len() as f64 - expected).abs() < spread, "{} of {expected}", people.len());
}

#[test]
fn the_exterior_door_opens_as_often_as_in_the_paper() {
    let mut world = World::new(Scene::builtin("foyer").unwrap(), 5).unwrap();
    let (mut openings, mut open, mut was_open) = (0, 0, false);
    for tick in 0..12_000 {
        let truth = world.truth(f64::from(tick) * 0.1);
        let is_open = truth.doors.iter().any(|d| d.id == "exterior" && d.open_share > 0.5);
        openings += u32::from(is_open && !was_open);
        open += u32::from(is_open);
        was_open = is_open;
    }
    assert!((25..=60).contains(&openings), "{openings} openings in 20 minutes");
    assert!((1_500..7_000).contains(&open), "open {} s of 1200", open / 10);
}

#[test]
fn a_staged_walker_lingers_where_nobody_goes() {
    let scene = Scene::builtin("foyer").unwrap();
    let alone = |world: &mut World| {
        (0..900)
            .filter(|&tick| {
                let truth = world.truth(1000.0 + f64::from(tick) * 0.1);
                truth.people.iter().any(|p| norm(sub([p.x_m, p.y_m], [9.3, 1.4])) < 1.2)
            })
            .count()
    };
    let mut normal = World::new(scene.clone(), 4).unwrap();
    assert_eq!(alone(&mut normal), 0);
    let mut staged = World::new(scene.staged("off-the-path", 1000.0).unwrap(), 4).unwrap();
    assert!(alone(&mut staged) > 350);
}

#[test]
fn a_left_suitcase_and_a_wedged_door_are_seen() {
    let scene = Scene::builtin("foyer").unwrap();
    let laser = scene.lasers[0].clone();
    let scene = scene.staged("suitcase", 100.0).unwrap().staged("door-wedged", 500.0).unwrap();
    let mut world = World::new(scene, 4).unwrap();
    let bearing = (2.2f64 - 0.3).atan2(7.6 - 6.0).to_degrees().round() as usize; // beam 0 is +x
    let (mut before, mut after) = (Vec::new(), Vec::new());
    world.true_ranges(&laser, 99.0, &mut before);
    world.true_ranges(&laser, 101.0, &mut after);
    assert!(
        before[bearing] > 4.0 && after[bearing] < 2.7,
        "{} {}",
        before[bearing],
        after[bearing]
    );
    assert_eq!(world.truth(101.0).objects, ["suitcase"]);
    assert!((0..300).all(|s| world.truth(500.0 + f64::from(s)).doors[0].open_share == 1.0));
}

#[test]
fn nobody_appears_or_vanishes_but_at_the_ends_of_the_ways() {
    let scene = Scene::builtin("foyer").unwrap();
    let ends: Vec<_> = (scene.routes.iter())
        .flat_map(|route| [route.points[0], route.points[route.points.len() - 1]])
        .collect();
    let mut world = World::new(scene, 8).unwrap();
    let mut last = world.truth(0.0).people;
    let mut changes = 0;
    for tick in 1..18_000 {
        let people = world.truth(f64::from(tick) * 0.1).people;
        let others = |of: &[crate::PersonTruth], not: &[crate::PersonTruth]| {
            let gone = |p: &&crate::PersonTruth| not.iter().all(|other| other.id != p.id);
            of.iter().filter(gone).cloned().collect::<Vec<_>>()
        };
        for person in others(&last, &people).iter().chain(&others(&people, &last)) {
            let at = [person.x_m, person.y_m];
            let near = |end: &&crate::RoutePoint| norm(sub(at, end.at_m)) < end.spread_m + 0.3;
            assert!(ends.iter().any(|end| near(&end)), "in mid-way at tick {tick}: {person:?}");
            changes += 1;
        }
        last = people;
    }
    assert!(changes > 100, "{changes}");
}

#[test]
fn the_noise_of_two_scans_and_of_two_lasers_has_nothing_in_common() {
    let text = "name = \"t\"\n[area]\nid = \"a\"\norigin_m = [0.0, 0.0]\ncell_m = 0.1\n\
                columns = 9\n\
                rows = 9\n[sensor]\nfault_share = 0.0\n";
    let ring = "[[wall]]\nclosed = true\n\
                points_m = [[18.0, -2.0], [22.0, -2.0], [22.0, 2.0], [18.0, 2.0]]\n";
    let mut world = World::new(Scene::parse(&format!("{text}{ring}"), "t").unwrap(), 1).unwrap();
    let (one, two) =
        (LaserSpec::lms200("one", 20.0, 0.0, 0.0), LaserSpec::lms200("two", 20.0, 0.0, 0.0));
    let mut noise = |laser: &LaserSpec, t_s: f64| -> Vec<f64> {
        let mut exact = Vec::new();
        world.true_ranges(laser, t_s, &mut exact);
        let read = scan(&mut world, laser, t_s);
        read.iter().zip(&exact).map(|(&r, e)| (f64::from(r) - e) / 0.01).collect()
    };
    let scans = [noise(&one, 1.0), noise(&one, 1.1), noise(&two, 1.0)];
    for (i, a) in scans.iter().enumerate() {
        for b in &scans[i + 1..] {
            let product: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>() / a.len() as f64;
            assert!(product.abs() < 0.3, "correlation {product}"); // 4 sigma of 181 pairs
        }
        let power: f64 = a.iter().map(|x| x * x).sum::<f64>() / a.len() as f64;
        assert!((0.6..1.5).contains(&power), "{power}");
    }
}

#[test]
fn wanderers_stay_among_their_places_for_ever() {
    let scene = minimal(
        "[[wall]]\npoints_m = [[0.0, -5.0], [0.0, 1.0]]\n[[wander]]\nid = \"w\"\npeople = 3\n\
         pause_s = [0.0, 5.0]\npoints_m = [[-3.0, 0.0], [3.0, 0.0], [0.0, 2.0], [3.0, 3.0]]\n",
    );
    let scene = scene.unwrap();
    let obstacles = Obstacles::new(&scene);
    let mut world = World::new(scene, 0).unwrap();
    let mut last: Option<crate::Truth> = None;
    for tick in 0..6000 {
        let truth = world.truth(5000.0 + f64::from(tick) * 0.1);
        assert_eq!(truth.people.len(), 3);
        for (i, person) in truth.people.iter().enumerate() {
            let body = Circle { centre: [person.x_m, person.y_m], radius_m: 0.1 };
            assert!(obstacles.depth_m(&body) < 0.0);
            if let Some(last) = &last {
                let step = norm(sub(body.centre, [last.people[i].x_m, last.people[i].y_m]));
                assert!(step < 0.15, "a body jumps by {step} m at {}", truth.t_s);
            }
        }
        last = Some(truth);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_reading_is_a_range_or_nothing_at_any_time(
        time_bits in any::<u64>(), near_s in -1e6f64..1e6, seed in any::<u64>(),
        x_m in -3.0f64..15.0, y_m in -3.0f64..11.0, yaw_deg in -360.0f64..360.0,
        increment_deg in prop_oneof![-1.9f64..-0.1, 0.1f64..1.9],
    ) {
        let scene = Scene::builtin("foyer").unwrap();
        let mut world = World::new(scene, seed).unwrap();
        let laser = LaserSpec {
            angle_increment_deg: increment_deg,
            ..LaserSpec::lms200("any", x_m, y_m, yaw_deg)
        };
        for t in [near_s, f64::from_bits(time_bits)] {
            for reading in scan(&mut world, &laser, t) {
                let fine = reading.is_nan() || reading == f32::INFINITY
                    || (0.0..=8.0).contains(&reading);
                prop_assert!(fine, "{reading} at {t}");
            }
            world.truth(t);
        }
    }

    #[test]
    fn any_text_is_a_scene_or_an_error(text in "\\PC{0,200}") {
        let _ = Scene::parse(&text, "any");
    }
}

#[test]
fn people_with_a_window_are_there_in_it_and_not_outside() {
    let scene = minimal(
        "[[loop]]\nid = \"four\"\npeople = 4\npresent_s = [45.0, 225.0]\n\
         points_m = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0]]\n\
         [[wander]]\nid = \"one\"\npeople = 1\npresent_s = [0.0, 45.0]\n\
         points_m = [[-1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]\n",
    );
    let mut world = World::new(scene.unwrap(), 4).unwrap();
    for (t, expected) in [(-0.1, 0), (0.0, 1), (44.9, 1), (45.0, 4), (224.9, 4), (225.0, 0)] {
        assert_eq!(world.truth(t).people.len(), expected, "at {t}");
    }
    let refused = minimal(
        "[[loop]]\nid = \"four\"\npeople = 4\npresent_s = [9.0, 1.0]\n\
         points_m = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0]]\n",
    );
    assert!(refused.unwrap_err().to_string().contains("present_s is [9, 1], expected [low, high]"));
}

#[test]
fn a_device_sees_phantoms_at_edges_that_the_plain_model_does_not() {
    let body = |model: &str| {
        format!(
            "[[box]]\ncentre_m = [2.0, 0.0]\nsize_m = [0.4, 0.3]\n\
             [[wall]]\npoints_m = [[2.3, -3.0], [2.3, 3.0]]\n\
             [[laser]]\nid = \"l\"\nx_m = 0.0\ny_m = 0.0\nyaw_deg = 0.3\n{model}\n"
        )
    };
    let between = |model: &str| {
        let scene = minimal(&body(model)).unwrap();
        let laser = scene.lasers[0].clone();
        let mut world = World::new(scene, 1).unwrap();
        let ranges = scan(&mut world, &laser, 1.0);
        (0..181)
            .filter(|&beam| {
                let bearing = (f64::from(beam) - 90.0 + 0.3).to_radians();
                let x = f64::from(ranges[beam as usize]) * bearing.cos();
                bearing.abs() < 0.2 && (1.83..2.27).contains(&x)
            })
            .count()
    };
    assert_eq!(between(""), 0);
    assert!((1..=2).contains(&between("model = \"lms200\"")), "one at each edge at most");
}
