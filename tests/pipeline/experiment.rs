//! `tog experiment`: the paper's experiments end to end, through the real binary.

use super::support::{Npy, files, scratch, tog};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

fn run(scratch: &tempfile::TempDir, number: &str, rest: &[&str], out: &Path) -> String {
    let arguments = ["experiment", number].into_iter().chain(rest.iter().copied());
    let arguments = arguments.map(OsStr::new).chain([OsStr::new("--out"), out.as_os_str()]);
    tog(scratch, arguments).expect(0, &[]).out.clone()
}

fn verdicts(directory: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(directory.join("verdicts.json")).unwrap()).unwrap()
}

/// Whether a claim holds with a preset.
fn holds(document: &serde_json::Value, preset: &str, claim: &str) -> bool {
    let presets = document["presets"].as_array().unwrap();
    let of = presets.iter().find(|of| of["preset"] == preset).unwrap()["verdicts"].as_array();
    let verdict = of.unwrap().iter().find(|verdict| verdict["claim"] == claim).unwrap();
    verdict["holds"].as_bool().unwrap()
}

#[test]
fn an_experiment_leaves_its_scans_truth_map_and_verdicts_and_the_same_seed_the_same_bytes() {
    let scratch = scratch();
    let (a, b) = (scratch.path().join("a"), scratch.path().join("b"));
    let said = run(&scratch, "1", &["--seed", "3"], &a);
    run(&scratch, "1", &["--seed", "3"], &b);
    let expected = [
        "default/collapsed_counts.npy",
        "default/grid.json",
        "figure-1.png",
        "onehot/collapsed_counts.npy",
        "onehot/grid.json",
        "paper/collapsed_counts.npy",
        "paper/grid.json",
        "scans.mcap",
        "site.toml",
        "surface.npy",
        "truth.jsonl",
        "verdicts.json",
        "verdicts.txt",
    ];
    assert_eq!(files(&a), expected.map(PathBuf::from));
    for name in expected {
        let [one, two] = [&a, &b].map(|directory| std::fs::read(directory.join(name)).unwrap());
        assert!(one == two, "{name}: the same seed gives the same bytes");
    }
    assert!(
        said.contains("walls") && said == std::fs::read_to_string(a.join("verdicts.txt")).unwrap()
    );
    let found = verdicts(&a);
    assert!(
        (found["experiment"] == 1) && (found["seed"] == 3) && holds(&found, "default", "walls")
    );

    let truth = std::fs::read_to_string(a.join("truth.jsonl")).unwrap();
    let lines: Vec<serde_json::Value> =
        truth.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines[0]["scene"]["wall"][0]["points_m"].as_array().unwrap().len(), 4);
    assert_eq!(lines.len(), 1 + 1126, "120 s of eight turns of 13.32 ms");
    assert!(lines[1..].iter().all(|line| line["people"].as_array().unwrap().is_empty()));
    let surface = Npy::read(&a.join("surface.npy"));
    assert!(surface.bytes.iter().filter(|&&cell| cell == 1).count() > 300);
}

#[test]
fn a_replay_of_the_recording_of_an_experiment_gives_its_map_to_the_bit() {
    let scratch = scratch();
    let (out, again) = (scratch.path().join("out"), scratch.path().join("again"));
    run(&scratch, "2", &[], &out);
    let (recording, site) = (out.join("scans.mcap"), out.join("site.toml"));
    let replay = [Path::new("replay"), &recording, Path::new("--site"), &site];
    tog(&scratch, replay.into_iter().chain([Path::new("--out"), &again])).expect(0, &[]);
    let [one, two] = [out.join("default/collapsed_counts.npy"), again.join("collapsed_counts.npy")]
        .map(|path| Npy::read(&path));
    assert_eq!(one.shape, two.shape);
    assert!(one.bytes == two.bytes, "the recording says what the lasers said");
    let one = scratch.path().join("one");
    run(&scratch, "1", &[], &one);
    let diff = ["map", "diff", "one/default", "out/default"];
    tog(&scratch, diff).expect(0, &["area room: from one/default to out/default"]);
    let twice = ["experiment", "1", "--out", "one"];
    tog(&scratch, twice).expect(1, &["a map is there already", "--force"]);

    let found = verdicts(&out);
    for claim in ["path", "empty", "agrees", "legs"] {
        assert!(holds(&found, "default", claim), "{claim}: {found:#}");
    }
    assert!(!holds(&found, "paper", "legs"), "without transit most legs are not seen");
    let truth = std::fs::read_to_string(out.join("truth.jsonl")).unwrap();
    let people = |line: &str| {
        let line: serde_json::Value = serde_json::from_str(line).unwrap();
        (line["t_s"].as_f64().unwrap(), line["people"].as_array().unwrap().len())
    };
    for (t_s, people) in truth.lines().skip(1).map(people) {
        let expected = if t_s < 45.0 { 1 } else { 4 };
        assert!(people == expected || t_s >= 225.0, "{people} at {t_s}");
    }
}

#[test]
fn the_foyer_shows_its_door_and_another_rate_and_seed_are_another_run() {
    let scratch = scratch();
    let (a, b) = (scratch.path().join("a"), scratch.path().join("b"));
    run(&scratch, "3", &["--seed", "2"], &a);
    let said = run(&scratch, "3", &["--seed", "3", "--rate", "5", "--format", "json"], &b);
    let found = verdicts(&a);
    for claim in ["door", "door-only", "spots", "ways", "no-wall"] {
        assert!(holds(&found, "default", claim), "{claim}: {found:#}");
    }
    let json: serde_json::Value = serde_json::from_str(&said).unwrap();
    assert_eq!(json, verdicts(&b));
    assert!((json["rate_hz"].as_f64().unwrap() - 5.005).abs() < 0.01, "15 turns of the mirror");
    assert_eq!(json["period_ns"], 15 * 13_320_000);
}

#[test]
fn an_experiment_that_is_none_is_refused_in_words() {
    let scratch = scratch();
    tog(&scratch, ["experiment"]).expect(2, &["--out", "--help"]);
    tog(&scratch, ["experiment", "4", "--out", "x"]).expect(2, &["1..=3"]);
    tog(&scratch, ["experiment", "1", "--out", "x", "--rate", "0.1"])
        .expect(2, &["expected 1 to 75.1"]);
    tog(&scratch, ["experiment", "verdict", "--seeds", "0"]).expect(2, &["1..=10000"]);
    tog(&scratch, ["experiment", "1", "--out", "/dev/null/x"]).expect(1, &["/dev/null/x"]);
}

/// The table of the README; with a debug build it takes some minutes.
#[test]
fn the_claims_of_the_paper_hold_for_nine_seeds_of_ten_at_both_rates() {
    if std::env::var_os("TOG_NIGHTLY").is_none() {
        println!("skipped: long; set TOG_NIGHTLY=1");
        return;
    }
    // Without the watchdog of the other tests: on a busy machine it takes longer than that.
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_tog"));
    let output = command.args(["experiment", "verdict", "--seeds", "10"]).output().unwrap();
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && said.contains("| `door`:"), "{said}");
}
