//! What the paper says of its figures, as claims that a run fulfils or not.
//!
//! | claim | exp. | holds if |
//! |---|---|---|
//! | `walls` | 1 | of the cells with background >= 50 %, >= 99 % have a visible surface within one cell; of the cells with visible surface, >= 95 % have such a cell within one cell |
//! | `path` | 2 | over the cells of the walked path, the mean share of passing is >= 5 times that of lingering, of vacated and of background, and >= 0.5 % |
//! | `empty` | 2 | of the observed cells, at most 1 % are lingering, and at most 1 % vacated, in >= 1 % of their frames |
//! | `agrees` | 2, 1 | the shares of background of both correlate >= 0.95 over the cells observed in both; of the cells with background >= 50 % of each, >= 99 % have one of the other within one cell |
//! | `door` | 3 | exactly one group of >= 3 touching cells is both background and vacated in >= 10 % of their frames, and its centre is within 0.5 m of the shut exterior door |
//! | `door-only` | 3 | over the cells of that group, passing and lingering are each at most half as frequent as vacated |
//! | `spots` | 3 | within 1 m of the place where people wait for the elevator, and of the one where they talk, there are groups of >= 3 touching cells that linger in >= 1 % of their frames, and >= 60 % of the mass of all such groups is there |
//! | `ways` | 3 | of the cells without a surface within one cell, the mean share of passing of those that somebody trod is >= 5 times that of the others |
//! | `legs` | 2 | **Here:** of the cells of the path, >= 95 % are passing, lingering or transit in >= 2 % of their frames |
//! | `no-wall` | 3 | **Here:** over the cells that people trod within 1 m of these two places, background is at most half as frequent as lingering |
//!
//! "Within one cell" is the cell itself or one of its eight neighbours. The walked path are the cells
//! that a leg of one of the four covered in >= 1 % of the instants. A visible surface is what exact
//! rays, 0.05 degrees apart, meet from the lasers' places within their range. Groups of one or two
//! cells are left out: at the edge of furniture, noise tosses single cells between all classes.
//! A share below 0.01 % counts as 0.01 % where it divides.

use crate::blobs::{Blob, blobs, neighbours};
use crate::ground::{Footprints, Ground, share_near};
use crate::shares::{Class, Shares};
use scene::Scene;
use verdict::verdict;

pub use verdict::{Claim, Limit, Measure, Verdict};

mod verdict;

const STRONG: f64 = 0.5;
const GROUP_CELLS: usize = 3;
const BOTH_MIN: f64 = 0.1;
const LINGERS_MIN: f64 = 0.01;
const PLACE_M: f64 = 1.0;
const PATH_COVERED_MIN: f64 = 0.01;
const SHARE_FLOOR: f64 = 1e-4;

fn at_least(shares: &[f64], least: f64) -> Vec<bool> {
    shares.iter().map(|&share| share >= least).collect()
}

fn set(cells: &[bool]) -> impl Iterator<Item = usize> + '_ {
    cells.iter().enumerate().filter(|(_, on)| **on).map(|(cell, _)| cell)
}

fn ratio(of: f64, to: f64) -> f64 {
    of / to.max(SHARE_FLOOR)
}

/// Experiment 1.
#[must_use]
pub fn judge_static(empty_room: &Shares, ground: &Ground) -> Vec<Verdict> {
    vec![walls(empty_room, ground)]
}

/// Experiment 2, with the map of experiment 1 beside it.
#[must_use]
pub fn judge_walkers(walkers: &Shares, empty_room: &Shares, prints: &Footprints) -> Vec<Verdict> {
    let path = prints.path("quadrilateral", PATH_COVERED_MIN);
    vec![
        walked_path(walkers, &path),
        others_empty(walkers),
        background_agrees(walkers, empty_room),
        legs_seen(walkers, &path),
    ]
}

/// Experiment 3.
#[must_use]
pub fn judge_foyer(
    foyer: &Shares,
    scene: &Scene,
    ground: &Ground,
    prints: &Footprints,
) -> Vec<Verdict> {
    let places: Vec<[f64; 2]> =
        ["street-to-elevator", "conversation"].iter().filter_map(|r| waits_at(scene, r)).collect();
    let door = exterior_door(scene).unwrap_or([[f64::NAN; 2]; 2]);
    let trodden = prints.anybody();
    let [unique, only] = door_verdicts(foyer, door);
    vec![
        unique,
        only,
        lingering_spots(foyer, &places),
        ways(foyer, &trodden, ground.surface()),
        standing_is_no_wall(foyer, &places, &trodden),
    ]
}

/// The two ends of the shut exterior door of a scene, metres.
#[must_use]
pub fn exterior_door(scene: &Scene) -> Option<[[f64; 2]; 2]> {
    let door = scene.doors.iter().find(|door| door.id == "exterior")?;
    let (sin, cos) = door.closed_deg.to_radians().sin_cos();
    let [x, y] = door.hinge_m;
    Some([door.hinge_m, [x + door.leaf_m * cos, y + door.leaf_m * sin]])
}

/// Where people of a route wait longest, metres.
#[must_use]
pub fn waits_at(scene: &Scene, route: &str) -> Option<[f64; 2]> {
    let route = scene.routes.iter().find(|candidate| candidate.id == route)?;
    let longest = route.points.iter().max_by(|a, b| a.wait_s[1].total_cmp(&b.wait_s[1]))?;
    Some(longest.at_m)
}

/// [`Claim::Walls`].
#[must_use]
pub fn walls(shares: &Shares, ground: &Ground) -> Verdict {
    let (grid, strong) = (shares.grid(), at_least(shares.of(Class::Background), STRONG));
    let found = set(&strong).count();
    let precise = if found == 0 { 0.0 } else { share_near(grid, &strong, ground.surface()) };
    let complete = share_near(grid, ground.surface(), &strong);
    verdict(
        Claim::Walls,
        &[
            ("background within one cell of a surface", precise, Limit::AtLeast(0.99)),
            ("surface within one cell of background", complete, Limit::AtLeast(0.95)),
        ],
    )
}

/// [`Claim::Path`].
#[must_use]
pub fn walked_path(shares: &Shares, path: &[bool]) -> Verdict {
    let mean = |class| shares.mean(class, set(path));
    let passing = mean(Class::Passing);
    let others = [Class::Lingering, Class::Vacated, Class::Background].map(mean);
    let times = ratio(passing, others.into_iter().fold(0.0, f64::max));
    verdict(
        Claim::Path,
        &[
            ("passing / the most frequent other", times, Limit::AtLeast(5.0)),
            ("mean passing on the path", passing, Limit::AtLeast(0.005)),
        ],
    )
}

/// [`Claim::Empty`].
#[must_use]
pub fn others_empty(shares: &Shares) -> Verdict {
    let observed = set(shares.observed()).count().max(1) as f64;
    let seen = |class| set(&at_least(shares.of(class), 0.01)).count() as f64 / observed;
    verdict(
        Claim::Empty,
        &[
            ("cells in the 15 s map", seen(Class::Lingering), Limit::AtMost(0.01)),
            ("cells in the 60 s map", seen(Class::Vacated), Limit::AtMost(0.01)),
        ],
    )
}

/// [`Claim::Agrees`].
#[must_use]
pub fn background_agrees(a: &Shares, b: &Shares) -> Verdict {
    let strong = [a, b].map(|shares| at_least(shares.of(Class::Background), STRONG));
    let near = |of: usize| match set(&strong[of]).count() {
        0 => 0.0,
        _ => share_near(a.grid(), &strong[of], &strong[1 - of]),
    };
    let both = || {
        let observed = a.observed().iter().zip(b.observed()).map(|(&a, &b)| a && b);
        let pairs = a.of(Class::Background).iter().zip(b.of(Class::Background));
        pairs.zip(observed).filter(|(_, both)| *both).map(|((&a, &b), _)| (a, b))
    };
    verdict(
        Claim::Agrees,
        &[
            ("correlation", correlation(both), Limit::AtLeast(0.95)),
            ("of 2 within one cell of 1", near(0), Limit::AtLeast(0.99)),
            ("of 1 within one cell of 2", near(1), Limit::AtLeast(0.99)),
        ],
    )
}

/// Pearson's; 0 if one of the two never varies.
fn correlation<I: Iterator<Item = (f64, f64)>>(pairs: impl Fn() -> I) -> f64 {
    let count = pairs().count().max(1) as f64;
    let (sum_a, sum_b) = pairs().fold((0.0, 0.0), |(sa, sb), (a, b)| (sa + a, sb + b));
    let (mean_a, mean_b) = (sum_a / count, sum_b / count);
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (a, b) in pairs() {
        let (a, b) = (a - mean_a, b - mean_b);
        (aa, bb, ab) = (aa + a * a, bb + b * b, ab + a * b);
    }
    if aa * bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}

/// [`Claim::Legs`].
#[must_use]
pub fn legs_seen(shares: &Shares, path: &[bool]) -> Verdict {
    let moving = |cell: usize| {
        let classes = [Class::Passing, Class::Lingering, Class::Transit];
        classes.iter().map(|&class| shares.of(class)[cell]).sum::<f64>()
    };
    let on_path = || set(path).filter(|&cell| shares.observed()[cell]);
    let seen = on_path().filter(|&cell| moving(cell) >= 0.02).count() as f64;
    let share = seen / on_path().count().max(1) as f64;
    verdict(Claim::Legs, &[("of the path is seen", share, Limit::AtLeast(0.95))])
}

/// Groups of cells that are strong in both background and 60 s, heaviest first.
#[must_use]
pub fn strong_in_both(shares: &Shares) -> Vec<Blob> {
    let pairs = shares.of(Class::Background).iter().zip(shares.of(Class::Vacated));
    let both: Vec<f64> = pairs.map(|(&background, &vacated)| background.min(vacated)).collect();
    blobs(shares.grid(), &both, BOTH_MIN, GROUP_CELLS)
}

/// [`Claim::Door`] and [`Claim::DoorOnly`].
#[must_use]
pub fn door_verdicts(shares: &Shares, door: [[f64; 2]; 2]) -> [Verdict; 2] {
    let groups = strong_in_both(shares);
    let far = |blob: &Blob| distance_to_segment(blob.centre_m, door);
    let nearest = groups.iter().min_by(|a, b| far(a).total_cmp(&far(b)));
    let away_m = nearest.map_or(99.0, far);
    let cells = nearest.map(|blob| blob.cells.clone()).unwrap_or_default();
    let mean = |class| shares.mean(class, cells.iter().copied());
    let vacated = mean(Class::Vacated);
    let of_vacated = |class| if cells.is_empty() { 99.0 } else { ratio(mean(class), vacated) };
    let others = groups.len().saturating_sub(1) as f64;
    let unique = verdict(
        Claim::Door,
        &[
            ("other groups", others, Limit::AtMost(0.0)),
            ("metres from the door", away_m, Limit::AtMost(0.5)),
        ],
    );
    let only = verdict(
        Claim::DoorOnly,
        &[
            ("passing / vacated", of_vacated(Class::Passing), Limit::AtMost(0.5)),
            ("lingering / vacated", of_vacated(Class::Lingering), Limit::AtMost(0.5)),
        ],
    );
    [unique, only]
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

fn distance_to_segment(point: [f64; 2], [a, b]: [[f64; 2]; 2]) -> f64 {
    let (ax, ay) = (b[0] - a[0], b[1] - a[1]);
    let along = ((point[0] - a[0]) * ax + (point[1] - a[1]) * ay) / (ax * ax + ay * ay);
    let along = along.clamp(0.0, 1.0);
    distance(point, [a[0] + along * ax, a[1] + along * ay])
}

/// [`Claim::Spots`].
#[must_use]
pub fn lingering_spots(shares: &Shares, places_m: &[[f64; 2]]) -> Verdict {
    let groups = blobs(shares.grid(), shares.of(Class::Lingering), LINGERS_MIN, GROUP_CELLS);
    let at = |place: &[f64; 2], blob: &Blob| distance(*place, blob.centre_m) <= PLACE_M;
    let found = places_m.iter().filter(|place| groups.iter().any(|blob| at(place, blob))).count();
    let mass: f64 = groups.iter().map(|blob| blob.mass).sum();
    let here = groups.iter().filter(|blob| places_m.iter().any(|place| at(place, blob)));
    let here = here.map(|blob| blob.mass).sum::<f64>();
    let share = if mass > 0.0 { here / mass } else { 0.0 };
    verdict(
        Claim::Spots,
        &[
            ("of the lingering is there", share, Limit::AtLeast(0.6)),
            ("places found", found as f64, Limit::AtLeast(2.0)),
        ],
    )
}

/// [`Claim::Ways`].
#[must_use]
pub fn ways(shares: &Shares, trodden: &[bool], surface: &[bool]) -> Verdict {
    let mean = |on: bool| {
        let open = |cell: usize| !neighbours(shares.grid(), cell).any(|near| surface[near]);
        let cells = (0..trodden.len()).filter(|&cell| trodden[cell] == on && open(cell));
        shares.mean(Class::Passing, cells)
    };
    let times = ratio(mean(true), mean(false));
    verdict(Claim::Ways, &[("times passing elsewhere", times, Limit::AtLeast(5.0))])
}

/// [`Claim::NoWall`].
#[must_use]
pub fn standing_is_no_wall(shares: &Shares, places_m: &[[f64; 2]], trodden: &[bool]) -> Verdict {
    let near = |cell: usize| {
        let centre_m = shares.grid().centre_of_index_m(cell);
        places_m.iter().any(|&place| distance(place, centre_m) <= PLACE_M)
    };
    let mean = |class| shares.mean(class, set(trodden).filter(|&cell| near(cell)));
    let share = ratio(mean(Class::Background), mean(Class::Lingering));
    verdict(Claim::NoWall, &[("background / lingering", share, Limit::AtMost(0.5))])
}

#[cfg(test)]
mod tests;
