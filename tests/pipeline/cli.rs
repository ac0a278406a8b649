//! Every verb explains itself, and answers in words before anything runs.

use super::made::{CORNER_AREA, corner, site, write};
use super::support::{scratch, tog};
use std::path::{Path, PathBuf};

const VERBS: [&[&str]; 30] = [
    &[],
    &["demo"],
    &["replay"],
    &["experiment"],
    &["experiment", "verdict"],
    &["run"],
    &["status"],
    &["alerts", "list"],
    &["alerts", "watch"],
    &["map", "info"],
    &["map", "render"],
    &["map", "diff"],
    &["map", "export"],
    &["map", "merge"],
    &["bag", "info"],
    &["bag", "import"],
    &["bag", "export"],
    &["bag", "convert"],
    &["check"],
    &["learn"],
    &["schema"],
    &["bag", "record"],
    &["bag", "play"],
    &["bag", "recover"],
    &["certs", "init"],
    &["certs", "issue"],
    &["certs", "show"],
    &["doctor"],
    &["top"],
    &["graph"],
];

fn deploy() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy")
}

#[test]
fn every_verb_explains_itself_with_examples() {
    let scratch = scratch();
    for verb in VERBS {
        let ended = tog(&scratch, verb.iter().chain(&["--help"]));
        ended.expect(0, &["Usage: tog", "Examples:\n"]);
        let example = format!("\n  tog {}", verb.first().unwrap_or(&"demo"));
        assert!(ended.out.contains(&example), "{verb:?}:\n{}", ended.out);
        assert!(ended.err.is_empty(), "{}", ended.err);
        let wide = ended.out.lines().find(|line| line.chars().count() > 100);
        assert_eq!(wide, None, "{verb:?}: lines fit 100 columns");
    }
    tog(&scratch, ["--version"]).expect(0, &["tog "]);
}

#[test]
fn every_verb_of_the_help_is_tested_here() {
    let help = tog(&scratch(), ["--help"]).out;
    let commands = help.split("Commands:\n").nth(1).unwrap().split("\n\n").next().unwrap();
    let names = commands.lines().filter_map(|line| line.split_whitespace().next());
    for name in names.filter(|name| *name != "help") {
        assert!(VERBS.iter().any(|verb| verb.first() == Some(&name)), "{name}");
    }
}

#[test]
fn what_is_not_understood_is_answered_with_the_way_to_the_help() {
    let scratch = scratch();
    tog(&scratch, ["watch"]).expect(2, &["unrecognized subcommand 'watch'", "--help"]);
    tog(&scratch, ["replay"]).expect(2, &["required", "--out", "--help"]);
    tog(&scratch, ["run", "x.toml", "--seconds", "-1"]).expect(2, &["--help"]);
    tog(&scratch, ["alerts"]).expect(2, &["Usage: tog alerts", "list", "watch"]);
    tog(&scratch, [""; 0]).expect(2, &["Usage: tog"]);
}

#[test]
fn every_site_file_that_is_delivered_is_right() {
    let scratch = scratch();
    let mut checked = 0;
    for entry in std::fs::read_dir(deploy()).unwrap() {
        let path = entry.unwrap().path();
        if path.ends_with("replay-example.toml") {
            // It names a recording that its reader has to put there: that is all that is wrong.
            let ended = tog(&scratch, [Path::new("check"), &path]);
            ended.expect(
                78,
                &["recording.mcap", "No such file", "replay-example.toml:32:", "1 error"],
            );
            checked += 1;
        } else if path.ends_with("two-hosts.toml") {
            let ended = tog(&scratch, [Path::new("check"), &path]);
            ended.expect(0, &["right, on 2 hosts", "tog run --host edge", "neither encrypted"]);
            checked += 1;
        } else if path.ends_with("building.toml") {
            let ended = tog(&scratch, [Path::new("check"), &path]);
            ended.expect(
                0,
                &["right, on 3 hosts", "area lobby: on ground; if that is lost, on desk", "kB/s"],
            );
            assert!(ended.err.is_empty(), "{}", ended.err);
            checked += 1;
        } else if path.extension().is_some_and(|extension| extension == "toml") {
            let ended = tog(&scratch, [Path::new("check"), &path]);
            ended.expect(0, &[": right. `tog run` would start", "shared memory", "  alerts\n"]);
            assert!(ended.err.is_empty(), "{}", ended.err);
            let arguments = [Path::new("check"), &path, Path::new("--format"), Path::new("json")];
            let json = tog(&scratch, arguments);
            let json: serde_json::Value = serde_json::from_str(&json.expect(0, &[]).out).unwrap();
            assert!(json["processes"].as_array().is_some_and(|all| all.len() >= 5), "{json}");
            assert!(json["shared_memory_bytes_max"].as_u64().is_some_and(|bytes| bytes > 0));
            checked += 1;
        }
    }
    assert!(checked >= 4, "found {checked} site files in deploy/");
}

#[test]
fn what_does_not_fit_a_host_or_its_network_is_refused() {
    let scratch = scratch();
    let text = std::fs::read_to_string(deploy().join("building.toml")).unwrap();
    let path = scratch.path().join("site.toml");
    let check = |text: &str| {
        std::fs::write(&path, text).unwrap();
        tog(&scratch, [Path::new("check"), &path])
    };
    let slow = text.replace("cores = 4\n", "cores = 4\nnetwork_mbit_s = 1\n");
    check(&slow).expect(
        78,
        &["host desk would move 1.", "Mbit/s over a network of 1", "network_mbit_s = 1", "1 error"],
    );
    let narrow = text.replace("cores = 4\n", "cores = 4\nnetwork_mbit_s = 2\n");
    check(&narrow).expect(0, &["host desk would move", "at most half of it"]);
    let more = |n: usize| {
        let laser = |n: usize| {
            format!(
                "[[laser]]\nid = \"more-{n}\"\narea = \"archive\"\nx_m = 4.6\ny_m = 0.2\nyaw_deg = 90\n\
                 source = {{ kind = \"simulator\", scene = \"room\", seed = 1, rate_hz = 200 }}\n"
            )
        };
        text.clone() + &(0..n).map(laser).collect::<String>()
    };
    check(
        &more(60)
            .replace("endpoint = \"10.20.0.20:7447\"", "cores = 1\nendpoint = \"10.20.0.20:7447\""),
    )
    .expect(78, &["host upper would be busy with", "of its 1 cores", "another host"]);
    let alone = text.replace("host = \"desk\"\nx_m", "x_m");
    check(&alone).expect(0, &["all lasers of area lobby hang on ground"]);
}

#[test]
fn what_the_lasers_are_fed_from_is_opened_and_its_faults_have_a_line() {
    let scratch = scratch();
    let (recording, path) = (scratch.path().join("x.mcap"), scratch.path().join("site.toml"));
    write(&recording, &["/scan"], (0..20).map(|number| (0, corner(number))));
    let check = |area: &str, topic: &str| {
        let text = site(&recording, area, &[("scan", topic, [0.0; 3])]);
        std::fs::write(&path, text).unwrap();
        tog(&scratch, [Path::new("check"), &path])
    };
    let right = check(CORNER_AREA, "/scan");
    assert!(right.expect(0, &["made: right."]).err.is_empty(), "{}", right.err);
    check(CORNER_AREA, "/front").expect(78, &["/front", "/scan", "site.toml:", "1 error"]);
    let far = check("origin_m = [100.0, 100.0]\ncolumns = 60\nrows = 100\n", "/scan");
    let words = ["0 % of the echoes of laser `scan` lie in area `hall`", "1 warning", "origin_m"];
    far.expect(0, &words);
    std::fs::write(&recording, b"no recording").unwrap();
    check(CORNER_AREA, "/scan").expect(78, &["x.mcap", "site.toml:", "1 error"]);
    std::fs::remove_file(&recording).unwrap();
    check(CORNER_AREA, "/scan").expect(78, &["x.mcap", "No such file", "site.toml:"]);
    let scene = "name = \"made\"\n[[area]]\nid = \"hall\"\norigin_m = [0.0, 0.0]\ncolumns = 9\n\
                 rows = 9\n[[laser]]\nid = \"a\"\narea = \"hall\"\nx_m = 0.1\ny_m = 0.1\n\
                 source = { kind = \"simulator\", scene = \"nowhere.toml\" }\n";
    std::fs::write(&path, scene).unwrap();
    let words = ["cannot read the scene", "nowhere.toml", "site.toml:12:", "1 error"];
    tog(&scratch, [Path::new("check"), &path]).expect(78, &words);
}

#[test]
fn a_site_file_that_cannot_be_read_is_named() {
    let scratch = scratch();
    let bytes = scratch.path().join("bytes.toml");
    std::fs::write(&bytes, [0xff, 0xfe, 0x00]).unwrap();
    let cannot = "cannot read the site file";
    tog(&scratch, ["check", "absent.toml"]).expect(78, &[cannot, "absent.toml", "No such file"]);
    tog(&scratch, ["check", "/tmp"]).expect(78, &[cannot, "it is a directory"]);
    tog(&scratch, [Path::new("check"), &bytes]).expect(78, &[cannot, "bytes.toml", "UTF-8"]);
    tog(&scratch, ["check", "/dev/null"]).expect(78, &[cannot, "expected a regular file"]);
    tog(&scratch, ["check", "/dev/zero"]).expect(78, &[cannot, "expected a regular file"]);
}

#[test]
fn the_schema_is_json_and_has_the_keys_of_the_delivered_site_files() {
    let text = tog(&scratch(), ["schema"]).expect(0, &[]).out.clone();
    let schema: serde_json::Value = serde_json::from_str(&text).unwrap();
    for key in ["name", "timezone", "state_dir", "area", "laser"] {
        assert!(schema["properties"][key].is_object(), "{key} in {schema:#}");
    }
    let site = std::fs::read_to_string(deploy().join("foyer.toml")).unwrap();
    let keys = site.lines().filter_map(|line| line.split_once(" = ")).map(|(key, _)| key.trim());
    let keys: Vec<&str> = keys.filter(|key| !key.starts_with('#')).collect();
    assert!(keys.len() > 20);
    for key in keys {
        assert!(text.contains(&format!("\"{key}\"")), "{key} is not in the schema");
    }
}

#[test]
fn a_site_that_does_not_run_is_told_with_what_to_do() {
    let scratch = scratch();
    let (recording, path) = (scratch.path().join("x.mcap"), scratch.path().join("site.toml"));
    write(&recording, &["/scan"], (0..20).map(|number| (0, corner(number))));
    let text = site(&recording, CORNER_AREA, &[("scan", "/scan", [0.0; 3])]);
    std::fs::write(&path, text).unwrap();
    let words = ["no site runs in", "made", "start it with `tog run`"];
    tog(&scratch, [Path::new("status"), &path]).expect(1, &words);
    let watch = [Path::new("alerts"), Path::new("watch"), &path];
    tog(&scratch, watch).expect(1, &["no alerts service runs here", "tog alerts list"]);
    let list = [Path::new("alerts"), Path::new("list"), &path];
    tog(&scratch, list).expect(1, &["there is no journal at", "`tog run SITE` begins one"]);
    let left = ["site.toml", "x.mcap"].map(PathBuf::from);
    assert_eq!(super::support::files(scratch.path()), left, "asking leaves nothing");
}
