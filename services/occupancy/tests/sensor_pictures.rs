//! The sensor model in pictures: `#` hit, `-` miss, `.` unknown; row 0 is the lowest line.
#![allow(clippy::unwrap_used)]

mod support;

use occupancy::{Fuser, LaserModel, dense};
use protocol::geometry::{GridGeometry, Pose};
use protocol::scan::ScanGeometry;

const CELL_M: f64 = 0.1;

/// A laser in the middle of cell (column, row), looking along `yaw_deg`: one beam of 10 degrees
/// either side, up to 2 m, dr = 6 cm.
fn laser(column: f64, row: f64, yaw_deg: f64) -> LaserModel {
    LaserModel {
        pose: Pose {
            x_m: (column + 0.5) * CELL_M,
            y_m: (row + 0.5) * CELL_M,
            yaw_rad: yaw_deg.to_radians(),
        },
        geometry: ScanGeometry {
            angle_min_rad: 0.0,
            angle_increment_rad: 20_f64.to_radians(),
            range_min_m: 0.05,
            range_max_m: 2.0,
        },
        beams: 1,
        half_beam_rad: None,
        range_tolerance_m: 0.06,
        no_return_is_free: true,
    }
}

/// Fuses one scan of each laser both ways and draws the frame, the highest row first.
fn picture(columns: u32, rows: u32, lasers: &[(LaserModel, &[f32])]) -> Vec<String> {
    let grid = GridGeometry { origin_m: [0.0, 0.0], cell_m: CELL_M, columns, rows };
    let mut fuser = Fuser::new(grid, lasers.len());
    for (index, (model, ranges_m)) in lasers.iter().enumerate() {
        fuser.install(index, model);
        fuser.apply(index, ranges_m);
    }
    let models: Vec<LaserModel> = lasers.iter().map(|laser| laser.0).collect();
    let scans: Vec<Option<&[f32]>> = lasers.iter().map(|laser| Some(laser.1)).collect();
    let frame = support::evidence(fuser.hit(), fuser.known(), grid.cells());
    assert_eq!(dense::Fuser::new(&grid, &models).fuse(&scans), frame);
    let line = |row: &[u8]| row.iter().map(|&e| [".", "-", "#"][usize::from(e)]).collect();
    frame.chunks(columns as usize).rev().map(line).collect()
}

#[track_caller]
fn check_beam(range_m: f32, expected: &str) {
    assert_eq!(picture(8, 1, &[(laser(0.0, 0.0, 0.0), &[range_m])]), [expected], "{range_m} m");
}

#[test]
fn a_beam_is_free_up_to_its_echo_and_silent_behind_it() {
    check_beam(0.42, "----#...");
    check_beam(0.10, "-#......");
    check_beam(0.70, "-------#");
}

#[test]
fn an_echo_hits_every_cell_nearer_to_it_than_the_tolerance() {
    check_beam(0.45, "----##..");
    check_beam(0.46, "-----#.."); // 0.4 is 6 cm away as f32 has it: 0.46 < 0.46f32, a miss
    check_beam(0.05, "##......");
}

#[test]
fn no_return_is_free_to_the_maximum_range_and_hits_nothing() {
    check_beam(f32::INFINITY, "--------");
    check_beam(2.0, "--------");
    let mut near = laser(0.0, 0.0, 0.0);
    near.geometry.range_max_m = 0.5;
    assert_eq!(picture(8, 1, &[(near, &[f32::INFINITY])]), ["-----..."]); // < 0.5 - dr
    near.no_return_is_free = false;
    assert_eq!(picture(8, 1, &[(near, &[f32::INFINITY])]), ["........"]);
}

#[test]
fn a_fault_says_nothing() {
    for fault in [f32::NAN, f32::NEG_INFINITY, 0.049, -1.0] {
        check_beam(fault, "........");
    }
}

#[test]
fn a_wedge_widens_with_the_range() {
    let picture = picture(10, 5, &[(laser(0.0, 2.0, 0.0), &[0.8])]);
    assert_eq!(picture, ["..........", "......--#.", "--------#.", "......--#.", "..........",]);
}

#[test]
fn a_hit_of_one_laser_beats_the_miss_of_another_and_a_miss_beats_unknown() {
    let right: (LaserModel, &[f32]) = (laser(0.0, 0.0, 0.0), &[0.3]);
    let left: (LaserModel, &[f32]) = (laser(7.0, 0.0, 180.0), &[0.6]);
    assert_eq!(picture(8, 1, &[right]), ["---#...."]);
    // The cell that the left one stands in has no bearing: atan2(0, 0) = 0 is behind its back.
    assert_eq!(picture(8, 1, &[left]), [".#-----."]);
    assert_eq!(picture(8, 1, &[right, left]), ["-#-#---."]);
    assert_eq!(picture(8, 1, &[left, right]), ["-#-#---."]);
}

#[test]
fn a_cell_between_two_beams_belongs_to_both_and_hit_wins() {
    let mut model = laser(0.0, 0.0, 0.0);
    model.beams = 2;
    model.geometry.angle_min_rad = -10_f64.to_radians();
    // Bearing 0 is exactly dphi from both beams.
    assert_eq!(picture(6, 1, &[(model, &[0.3, 0.5])]), ["---#-#"]);
    assert_eq!(picture(6, 1, &[(model, &[0.3, f32::NAN])]), ["---#.."]);
}

#[test]
fn beams_are_found_across_the_cut_of_the_circle() {
    let mut model = laser(4.0, 1.0, 90.0);
    model.geometry.angle_min_rad = 0.0;
    model.geometry.angle_increment_rad = std::f64::consts::FRAC_PI_2;
    model.beams = 4;
    // It looks up: bearing 90 is to the left, 270 to the right, and both are a quarter turn wide.
    let scan: &[f32] = &[f32::NAN, 0.2, f32::NAN, 0.3];
    assert_eq!(picture(9, 3, &[(model, scan)]), ["..##.--#.", "..#----#.", "..##.--#."]);
}

#[test]
fn an_absent_laser_leaves_nothing_behind() {
    let grid = GridGeometry { origin_m: [0.0, 0.0], cell_m: CELL_M, columns: 8, rows: 3 };
    let mut fuser = Fuser::new(grid, 2);
    fuser.install(0, &laser(0.0, 1.0, 0.0));
    fuser.apply(0, &[0.4]);
    assert!(fuser.known().iter().any(|&word| word != 0));
    fuser.retract(0);
    fuser.apply(1, &[0.4]); // never installed
    assert!(fuser.known().iter().chain(fuser.hit()).all(|&word| word == 0));
    assert!(fuser.is_installed(0) && !fuser.is_installed(1) && !fuser.is_installed(2));
}
