//! Small maps that hold a claim, and the same maps with one thing wrong.
#![allow(clippy::unwrap_used)]

use super::*;
use protocol::geometry::GridGeometry;

const SIDE: u32 = 20;
const GRID: GridGeometry =
    GridGeometry { origin_m: [0.0; 2], cell_m: 0.1, columns: SIDE, rows: SIDE };
const NAMES: [&str; 6] = ["empty", "passing", "lingering", "vacated", "background", "transit"];

fn cell(column: u32, row: u32) -> usize {
    GRID.index(column, row)
}

/// A map in per mille: cells that are not named are empty.
#[derive(Clone)]
struct Made(Vec<u64>);

impl Made {
    fn empty() -> Self {
        let mut counts = vec![0; NAMES.len() * GRID.cells()];
        counts[..GRID.cells()].fill(1000);
        Self(counts)
    }

    fn with(mut self, class: Class, per_mille: u64, cells: impl Iterator<Item = usize>) -> Self {
        let id = NAMES.iter().position(|name| *name == class.name()).unwrap();
        for cell in cells {
            self.0[cell] -= per_mille;
            self.0[id * GRID.cells() + cell] += per_mille;
        }
        self
    }

    fn shares(&self) -> Shares {
        Shares::of_counts(GRID, &NAMES, &self.0)
    }
}

fn row(row: u32) -> impl Iterator<Item = usize> {
    (0..SIDE).map(move |column| cell(column, row))
}

fn mask(cells: impl Iterator<Item = usize>) -> Vec<bool> {
    let mut mask = vec![false; GRID.cells()];
    cells.for_each(|cell| mask[cell] = true);
    mask
}

fn wall() -> Made {
    Made::empty().with(Class::Background, 900, row(3))
}

#[test]
fn walls_hold_one_cell_off_and_not_two_cells_off() {
    let ground = |at| Ground::of_cells(GRID, mask(row(at)));
    assert!(walls(&wall().shares(), &ground(3)).holds);
    assert!(walls(&wall().shares(), &ground(4)).holds);
    assert!(!walls(&wall().shares(), &ground(5)).holds);
    assert!(!walls(&Made::empty().shares(), &ground(3)).holds, "nothing found is not precise");
    let half = Made::empty().with(Class::Background, 900, row(3).take(10));
    let verdict = walls(&half.shares(), &ground(3));
    assert!(!verdict.holds && verdict.measures[0].holds() && !verdict.measures[1].holds());
    let phantom = wall().with(Class::Background, 600, std::iter::once(cell(9, 12)));
    let verdict = walls(&phantom.shares(), &ground(3));
    assert!(!verdict.measures[0].holds() && verdict.measures[1].holds());
}

#[test]
fn a_path_holds_if_it_is_passing_and_hardly_anything_else() {
    let path = mask(row(8));
    let walked = Made::empty().with(Class::Passing, 30, row(8));
    assert!(walked_path(&walked.shares(), &path).holds);
    for class in [Class::Lingering, Class::Vacated, Class::Background] {
        let other = walked.clone().with(class, 10, row(8));
        assert!(!walked_path(&other.shares(), &path).holds, "{class:?}");
        let elsewhere = walked.clone().with(class, 500, row(12));
        assert!(walked_path(&elsewhere.shares(), &path).holds, "{class:?}");
    }
    assert!(!walked_path(&Made::empty().shares(), &path).holds, "an unseen path");
}

#[test]
fn maps_are_empty_up_to_one_cell_in_a_hundred() {
    let four = || (0..4).map(|column| cell(column, 7));
    for class in [Class::Lingering, Class::Vacated] {
        let few = Made::empty().with(class, 300, four());
        assert!(others_empty(&few.shares()).holds);
        assert!(!others_empty(&few.with(class, 10, row(9).take(1)).shares()).holds);
    }
}

#[test]
fn backgrounds_agree_if_they_are_the_same_walls() {
    let other = wall().with(Class::Passing, 50, row(9));
    assert!(background_agrees(&wall().shares(), &other.shares()).holds);
    let moved = Made::empty().with(Class::Background, 900, row(5));
    assert!(!background_agrees(&wall().shares(), &moved.shares()).holds);
    assert!(!background_agrees(&wall().shares(), &Made::empty().shares()).holds);
}

#[test]
fn the_path_is_seen_with_transit_and_not_without() {
    let path = mask(row(8));
    let few = Made::empty().with(Class::Passing, 40, row(8).take(8));
    assert!(!legs_seen(&few.shares(), &path).holds);
    assert!(legs_seen(&few.with(Class::Transit, 200, row(8)).shares(), &path).holds);
}

/// A door leaf of ten cells at x = 0.05 m.
fn leaf() -> impl Iterator<Item = usize> {
    (5..15).map(|row| cell(0, row))
}
const DOOR: [[f64; 2]; 2] = [[0.05, 0.5], [0.05, 1.5]];

fn door() -> Made {
    Made::empty().with(Class::Background, 700, leaf()).with(Class::Vacated, 250, leaf())
}

#[test]
fn a_door_holds_if_it_is_the_only_one_and_at_its_place() {
    let holds = |map: &Made| door_verdicts(&map.shares(), DOOR).map(|verdict| verdict.holds);
    assert_eq!(holds(&door()), [true, true]);
    let second = || (5..9).map(|row| cell(19, row));
    let two = door().with(Class::Background, 700, second()).with(Class::Vacated, 250, second());
    assert_eq!(holds(&two), [false, true]);
    let noise = || std::iter::once(cell(12, 12));
    let tossed = door().with(Class::Background, 500, noise()).with(Class::Vacated, 300, noise());
    assert_eq!(holds(&tossed), [true, true], "one cell at an edge is no door");
    assert_eq!(holds(&wall()), [false, false], "no door at all");
    let elsewhere = door_verdicts(&door().shares(), [[1.9, 0.5], [1.9, 1.5]]);
    assert!(!elsewhere[0].holds);
    let walked = Made::empty().with(Class::Background, 500, leaf());
    let walked = walked.with(Class::Vacated, 250, leaf()).with(Class::Lingering, 150, leaf());
    assert_eq!(holds(&walked), [true, false]);
}

#[test]
fn spots_hold_if_people_linger_at_both_and_hardly_elsewhere() {
    let places = [[0.35, 0.35], [1.75, 1.75]];
    let spot = |column: u32, row: u32| (0..3).map(move |i| cell(column + i, row));
    let both = Made::empty().with(Class::Lingering, 30, spot(3, 3));
    let both = both.with(Class::Lingering, 20, spot(16, 17));
    assert!(lingering_spots(&both.shares(), &places).holds);
    assert!(!lingering_spots(&both.shares(), &[places[0], [0.2, 1.9]]).holds);
    let third = both.clone().with(Class::Lingering, 200, spot(16, 2));
    assert!(!lingering_spots(&third.shares(), &places).holds);
    let one = Made::empty().with(Class::Lingering, 30, spot(3, 3));
    assert!(!lingering_spots(&one.shares(), &places).holds);
    let trodden = mask(spot(3, 3).chain(spot(16, 17)));
    assert!(standing_is_no_wall(&both.shares(), &places, &trodden).holds);
    let walls = both.with(Class::Background, 30, spot(3, 3));
    assert!(!standing_is_no_wall(&walls.shares(), &places, &trodden).holds);
}

#[test]
fn ways_hold_if_passing_is_where_people_trod() {
    let trodden = mask(row(8));
    let surface = mask(row(3));
    let map = Made::empty().with(Class::Passing, 30, row(8)).with(Class::Passing, 90, row(3));
    assert!(ways(&map.shares(), &trodden, &surface).holds, "walls flicker, and are left out");
    let everywhere = map.with(Class::Passing, 20, (10..20).flat_map(row));
    assert!(!ways(&everywhere.shares(), &trodden, &surface).holds);
}

#[test]
fn the_places_of_the_claims_are_in_the_scene() {
    let scene = Scene::builtin("paper-foyer").unwrap();
    assert_eq!(exterior_door(&scene).unwrap()[0], [0.0, 2.5]);
    assert!((exterior_door(&scene).unwrap()[1][1] - 3.5).abs() < 1e-9);
    assert_eq!(waits_at(&scene, "conversation"), Some([4.9, 2.2]));
    assert_eq!(waits_at(&scene, "street-to-elevator"), Some([8.4, 6.5]));
    assert_eq!(waits_at(&scene, "nobody"), None);
}

#[test]
fn every_claim_has_a_name_of_its_own_and_the_page_defines_it() {
    let mut ids: Vec<&str> = Claim::ALL.iter().map(|claim| claim.id()).collect();
    let page = include_str!("../claims.rs");
    assert!(ids.iter().all(|id| page.contains(&format!("//! | `{id}` |"))));
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), Claim::ALL.len());
}
