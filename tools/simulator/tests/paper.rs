//! The built-in scenes show what the paper's figures show, through the real core: experiment 2
//! (`room`, figure 3) and experiment 3 (`foyer`, figure 4).
#![allow(clippy::unwrap_used)]

use occupancy::{Fuser, GridConfig, LaserModel, TemporalGrid};
use protocol::frame::FrameView;
use protocol::geometry::GridGeometry;
use protocol::site::Site;
use scene::{Scene, World};
use simulator::site_file::{Scans, of_scene};

const EMPTY: usize = 0;
const PASSING: usize = 1;
const LINGERING: usize = 2;
const VACATED: usize = 3;
const BACKGROUND: usize = 4;
const TRANSIT: usize = 5;

/// Share of the frames in which a cell was of a class.
struct Shares {
    grid: GridGeometry,
    counts: Vec<u64>,
}

impl Shares {
    /// Lets a built-in scene run at 10 Hz.
    fn of(name: &str, seed: u64, seconds: u64) -> Self {
        let scene = Scene::builtin(name).unwrap();
        let text = of_scene(&scene, 10.0, Scans::Simulated(name, seed));
        let site = Site::parse(&text, "site.toml").unwrap();
        let area = &site.areas[0];
        let lasers = scene.lasers.clone();
        let mut fuser = Fuser::new(area.grid(), lasers.len());
        for (i, (laser, spec)) in site.lasers.iter().zip(&lasers).enumerate() {
            let beams = spec.beams as usize;
            fuser.install(i, &LaserModel::of_site(laser, area, spec.geometry(), beams));
        }
        let mut grid = TemporalGrid::new(GridConfig::of_area(area));
        let mut world = World::new(scene, seed).unwrap();
        let mut ranges_m = Vec::new();
        for number in 0..seconds * 10 {
            for (i, spec) in lasers.iter().enumerate() {
                world.scan(spec, number as f64 * 0.1, &mut ranges_m);
                fuser.apply(i, &ranges_m);
            }
            grid.push(FrameView { number, hit: fuser.hit(), known: fuser.known() }, 0);
        }
        let mut counts = vec![0; grid.config().classes() * grid.config().cells];
        grid.collapsed(0, &mut counts);
        Self { grid: area.grid(), counts }
    }

    fn at(&self, class: usize, cell: usize) -> f64 {
        let cells = self.grid.cells();
        let total: u64 = (EMPTY..=TRANSIT).map(|c| self.counts[c * cells + cell]).sum();
        self.counts[class * cells + cell] as f64 / total.max(1) as f64
    }

    /// The largest value of `score` within `radius_m` of a place.
    fn near(&self, place: [f64; 2], radius_m: f64, score: impl Fn(&Self, usize) -> f64) -> f64 {
        (0..self.grid.cells())
            .filter(|&cell| distance(self.grid.centre_of_index_m(cell), place) < radius_m)
            .map(|cell| score(self, cell))
            .fold(0.0, f64::max)
    }

    /// How much a cell and two of its neighbours are both background and vacated: single cells on
    /// the edge of furniture are tossed between the two by noise, a door is a line of them.
    fn door(&self, cell: usize) -> f64 {
        let columns = self.grid.columns as i64;
        let mut scores: Vec<f64> = (-1..=1)
            .flat_map(|row| (-1..=1).map(move |column| cell as i64 + row * columns + column))
            .filter(|at| (0..self.grid.cells() as i64).contains(at))
            .map(|at| self.at(BACKGROUND, at as usize).min(self.at(VACATED, at as usize)))
            .collect();
        scores.sort_by(f64::total_cmp);
        scores[scores.len() - 3]
    }

    fn moving(&self, cell: usize) -> f64 {
        self.at(PASSING, cell) + self.at(TRANSIT, cell)
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Figure 4: the exterior door is the one feature that is strong both as background and as vacated;
/// people linger at the elevator and where they talk; nobody is in the south east.
#[test]
fn the_foyer_shows_its_exterior_door_as_in_figure_4() {
    for seed in [1, 2] {
        let shares = Shares::of("foyer", seed, 1200);
        let door = Shares::door;
        let cells = 0..shares.grid.cells();
        let best = cells.max_by(|&a, &b| door(&shares, a).total_cmp(&door(&shares, b))).unwrap();
        let [x, y] = shares.grid.centre_of_index_m(best);
        assert!(x.abs() < 0.2 && (2.3..3.7).contains(&y), "seed {seed}: door at ({x}, {y})");
        assert!(door(&shares, best) > 0.1, "seed {seed}: {}", door(&shares, best));
        for place in [[6.0, 4.0], [2.6, 6.25], [11.2, 0.5]] {
            let other = shares.near(place, 0.6, door);
            assert!(other < 0.05, "seed {seed}: as a door at {place:?}: {other}");
        }
        let linger = |s: &Shares, cell| s.at(LINGERING, cell);
        let (elevator, talk) =
            (shares.near([8.5, 6.5], 0.7, linger), shares.near([4.9, 2.3], 0.7, linger));
        let corner = shares.near([9.3, 1.4], 1.2, linger);
        assert!(elevator > 0.01 && talk > 0.02 && corner == 0.0, "{elevator} {talk} {corner}");
        let (way, nowhere) = (
            shares.near([2.5, 3.3], 0.5, Shares::moving),
            shares.near([9.3, 1.4], 1.2, Shares::moving),
        );
        assert!(way > 0.01 && nowhere < 0.001, "seed {seed}: way {way}, nowhere {nowhere}");
    }
}

/// Figure 3: the walkers' path is of the shortest timescale only; the walls stay background.
#[test]
fn the_room_shows_its_path_and_its_walls_as_in_figure_3() {
    let shares = Shares::of("room", 1, 180);
    for place in [[4.9, 2.0], [8.0, 4.4], [5.2, 6.75], [2.05, 4.4]] {
        let way = shares.near(place, 0.3, Shares::moving);
        let longer = shares
            .near(place, 0.3, |s, c| s.at(VACATED, c) + s.at(BACKGROUND, c) + s.at(LINGERING, c));
        assert!(way > 0.05 && longer < 0.01, "{place:?}: moving {way}, longer {longer}");
    }
    for wall in [[0.0, 6.0], [10.0, 3.0], [7.0, 9.0], [6.0, 0.0]] {
        let background = shares.near(wall, 0.1, |s, c| s.at(BACKGROUND, c));
        assert!(background > 0.8, "{wall:?}: {background}");
    }
}
