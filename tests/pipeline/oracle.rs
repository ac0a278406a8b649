//! The program in `tests/independent/` agrees on every number: it was written from the definitions
//! alone, in another language, and shares nothing with us.
//!
//! It needs python3 and two packages from PyPI. Where python3 is absent the tests are skipped with a
//! line, except in CI, where they must run.

use super::same_numbers::{three_lasers, two_lasers};
use super::support::{scratch, shared, tog, watched};
use std::path::Path;
use std::process::Command;

/// Every ROS 1 bag with scans.
const BAGS: [&str; 10] = [
    "datmo/82c2bc_two_robots.bag",
    "leigh_leg_tracker/demo_stationary_simple_environment.bag",
    "leigh_leg_tracker/negative_2_first_30s.bag",
    "leigh_leg_tracker/positive_1.bag",
    "leigh_leg_tracker/positive_2.bag",
    "leigh_leg_tracker/positive_3.bag",
    "leigh_leg_tracker/positive_5.bag",
    "scan_tools/laser_scan_matcher_demo.bag",
    "scan_tools/laser_scan_splitter_demo.bag",
    "tysik_two_laser/scans_demo.bag",
];

fn oracle() -> Command {
    Command::new(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/independent/run.sh"))
}

/// Whether the oracle can run; false is told.
pub fn has_python() -> bool {
    let found = Command::new("python3").arg("--version").output().is_ok();
    let in_ci = std::env::var_os("CI").is_some_and(|value| value == "true");
    assert!(found || !in_ci, "python3 is not there, but in CI the oracle must run");
    if !found {
        println!("skipped: python3 is not there");
    }
    found
}

/// Replays a recording and lets the oracle compute it again.
#[track_caller]
fn agrees(recording: &Path, site: Option<&str>) {
    let scratch = scratch();
    let (path, out) = (scratch.path().join("site.toml"), scratch.path().join("out"));
    let mut arguments = vec!["replay".into(), recording.to_owned(), "--every-frame".into()];
    arguments.extend(["--out".into(), out.clone()]);
    if let Some(site) = site {
        std::fs::write(&path, site).unwrap();
        arguments.extend(["--site".into(), path]);
    }
    tog(&scratch, &arguments).expect(0, &[]);
    let mut command = oracle();
    command.arg(recording).arg(&out);
    let verdict = watched(command);
    println!("{}: {}", recording.display(), verdict.out.lines().last().unwrap_or_default());
    verdict.expect(0, &["verdict: every number agrees"]);
    assert!(!verdict.out.contains("DIFFERENT"), "{}", verdict.out);
}

#[test]
fn the_oracle_agrees_with_loops_that_follow_the_text() {
    if has_python() {
        let mut command = oracle();
        command.arg("--self-test");
        watched(command).expect(0, &["self-test: passed"]);
    }
}

#[test]
fn the_oracle_agrees_on_every_number_of_every_bag() {
    if has_python() {
        BAGS.iter().filter_map(|bag| shared(bag)).for_each(|bag| agrees(&bag, None));
    }
}

#[test]
fn the_oracle_agrees_where_several_lasers_see_one_area() {
    if !has_python() {
        return;
    }
    if let Some(bag) = shared("tysik_two_laser/scans_demo.bag") {
        agrees(&bag, Some(&two_lasers(&bag)));
    }
    if let Some(bag) = shared("leigh_leg_tracker/negative_2_first_30s.bag") {
        agrees(&bag, Some(&three_lasers(&bag)));
    }
}
