//! `tog map`: what it draws, exports, compares and adds, by the real binary.

use super::made::{BEAMS, CORNER_AREA, corner, room, site, write};
use super::oracle::{has_python, oracle};
use super::support::{Ended, Npy, files, scratch, tog, watched};
use protocol::scan::LaserScan;
use serde_json::Value;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A directory with maps of the corner: `before`, and `after` with a cupboard 2.5 m ahead.
struct Maps {
    scratch: TempDir,
}

impl Maps {
    fn new() -> Self {
        let maps = Self { scratch: scratch() };
        maps.replay("before", CORNER_AREA, |_| {});
        maps.replay("after", CORNER_AREA, |scan| {
            for beam in BEAMS / 2 - 8..=BEAMS / 2 + 8 {
                scan.ranges_m[beam] = 2.5;
            }
        });
        maps
    }

    fn at(&self, name: &str) -> PathBuf {
        self.scratch.path().join(name)
    }

    /// Replays a minute of the corner as `change` makes it.
    fn replay(&self, name: &str, area: &str, change: impl Fn(&mut LaserScan)) {
        let recording = self.at(&format!("{name}.mcap"));
        let scans = (0..600).map(|number| {
            let mut scan = corner(number);
            change(&mut scan);
            (0, scan)
        });
        write(&recording, &["/scan"], scans);
        let site_file = self.at(&format!("{name}.toml"));
        std::fs::write(&site_file, site(&recording, area, &[("scan", "/scan", [0.0; 3])])).unwrap();
        let arguments = [Path::new("replay"), &recording, Path::new("--site"), &site_file];
        let out = [PathBuf::from("--out"), self.at(name)];
        let ended =
            tog(&self.scratch, arguments.into_iter().chain(out.iter().map(PathBuf::as_path)));
        ended.expect(0, &["too short for events", "needs 6 h", "s of learning; a site file"]);
    }

    /// `tog map` in the directory of the maps.
    fn map(&self, arguments: &str) -> Ended {
        tog(&self.scratch, ["map"].into_iter().chain(arguments.split(' ')))
    }

    fn json(&self, arguments: &str) -> Value {
        serde_json::from_str(&self.map(arguments).expect(0, &[]).out).unwrap()
    }
}

#[test]
fn a_cupboard_that_appeared_is_told_with_its_place_and_drawn() {
    let maps = Maps::new();
    let told = maps.map("diff before after --out changes");
    told.expect(0, &["  1. something solid appeared at (2.5, 0.", "instead of `empty`"]);
    let names = ["empty", "passing", "lingering", "vacated", "background", "transit"];
    for name in names {
        let picture = std::fs::read(maps.at(&format!("changes/change_{name}.png"))).unwrap();
        assert!(picture.starts_with(b"\x89PNG\r\n"), "{name}");
    }

    let json = maps.json("diff before after --format json");
    let written = std::fs::read_to_string(maps.at("changes/diff.json")).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&written).unwrap(), json);
    let place = &json["places"][0];
    assert_eq!((&place["from"], &place["to"]), (&"empty".into(), &"background".into()));
    let (x_m, y_m) = (place["x_m"].as_f64().unwrap(), place["y_m"].as_f64().unwrap());
    assert!((x_m - 2.5).abs() < 0.15 && y_m.abs() < 0.15, "{place}");
    let (min, max) = (&place["min_m"][1], &place["max_m"][1]);
    let width_m = max.as_f64().unwrap() - min.as_f64().unwrap();
    // 17 beams of a degree at 2.5 m are 0.74 m wide.
    assert!((0.6..=1.0).contains(&width_m), "{place}");
    // The wall behind it is in its shadow: it is not gone, nobody sees it.
    assert!(json["cells_before_only"].as_u64().unwrap() > 50, "{json}");
    let words = json["places"].as_array().unwrap().iter().map(|place| place["text"].to_string());
    assert!(!words.clone().any(|text| text.contains("is gone")), "{:?}", words.collect::<Vec<_>>());

    let same = maps.json("diff before before --format json");
    assert_eq!((&same["cells_changed"], &same["places_found"]), (&0.into(), &0.into()));
}

#[test]
fn pictures_are_png_or_svg_as_the_name_of_the_file_or_the_flag_says() {
    let maps = Maps::new();
    maps.map("render before --out all").expect(0, &["wrote 7 pictures"]);
    for name in ["overview", "background"] {
        let picture = std::fs::read(maps.at(&format!("all/{name}.png"))).unwrap();
        assert!(picture.starts_with(b"\x89PNG\r\n") && picture.len() > 5000, "{name}");
    }
    maps.map("render before --class background --out walls.svg").expect(0, &["walls.svg"]);
    let svg = std::fs::read_to_string(maps.at("walls.svg")).unwrap();
    assert!(svg.starts_with("<?xml") && svg.ends_with("</svg>\n"));
    assert!(svg.contains(">hall: share of `background`</text>"));
    maps.map("render before --picture svg --out shapes").expect(0, &[]);
    assert_eq!(files(&maps.at("shapes")).len(), 7);
    assert!(files(&maps.at("shapes")).iter().all(|file| file.extension().unwrap() == "svg"));
}

#[test]
fn maps_are_added_and_the_sum_is_a_map_for_every_verb() {
    let maps = Maps::new();
    maps.map("merge before after --out both").expect(0, &["the sum of 2 maps"]);
    let counts = |name: &str| Npy::read(&maps.at(name).join("collapsed_counts.npy")).u64s();
    let (before, after, both) = (counts("before"), counts("after"), counts("both"));
    assert!(both.iter().zip(before.iter().zip(&after)).all(|(sum, (a, b))| *sum == a + b));
    assert!(both.iter().any(|count| *count > 0));
    maps.map("merge both before --out three").expect(0, &[]);
    let observed = |name: &str| maps.json(&format!("info {name} --format json"))[0].clone();
    let longest = |name: &str| observed(name)["observed_s_max"].as_f64().unwrap();
    assert!((longest("three") - 2.0 * longest("before") - longest("after")).abs() < 0.5);
    maps.map("render three --out three.png").expect(0, &[]);
    maps.map("diff three before").expect(0, &[]);
    maps.map("merge before after --out both").expect(1, &["a map is there already", "--force"]);
    maps.map("merge before after --out both --force").expect(0, &[]);
    maps.map("merge before before --out twice").expect(2, &["before is given twice"]);
    maps.map("render before --out x.gif").expect(2, &["format .gif, expected .png, .svg"]);
    maps.map("render before --out deep/er/x.png").expect(0, &["wrote deep/er/x.png"]);
}

#[test]
fn maps_of_other_grids_are_refused_and_the_key_is_named() {
    let maps = Maps::new();
    maps.replay("slower", &format!("{CORNER_AREA}frame_period_ms = 200\n"), |_| {});
    maps.replay("paper", &format!("{CORNER_AREA}preset = \"paper\"\n"), |_| {});
    let words = ["slower is of another grid", "frame_period_ns is 200000000, expected 100000000"];
    maps.map("merge before slower --out sum").expect(1, &words);
    maps.map("diff before slower").expect(1, &words);
    let words = ["paper is of another grid than before: classes is", "expected [\"empty\","];
    maps.map("merge before paper --out sum").expect(1, &words);
    assert!(!maps.at("sum").exists(), "nothing is written");
}

#[test]
fn the_checkpoint_of_a_site_is_a_map_too() {
    let maps = Maps::new();
    let site_file = maps.at("before.toml");
    maps.map("info --site before.toml").expect(1, &["there is no map at", "tog run"]);
    tog(&maps.scratch, [Path::new("run"), &site_file]).expect(0, &[]);
    maps.map("info --site before.toml").expect(0, &["area hall: 60 x 100 cells of 0.1 m"]);
    let same = maps.json("diff before --site before.toml --format json");
    assert_eq!(same["cells_changed"], 0);
    assert!(same["cells_in_both"].as_u64().unwrap() > 500 && same["cells_before_only"] == 0);
    maps.map("export before.toml --format npy --out checkpoint").expect(0, &[]);
    let counts = |name: &str| Npy::read(&maps.at(name).join("collapsed_counts.npy")).u64s();
    assert_eq!(counts("checkpoint"), counts("before"));
    maps.map("info --site before.toml --area lift").expect(1, &["no area `lift`", "`hall`"]);
}

#[test]
fn contexts_are_kept_apart_and_add_up() {
    let maps = Maps::new();
    // The recording begins at midnight of 2026-01-01: its first half minute is `always`.
    let context = "\n[[area.context]]\nname = \"later\"\nfrom = \"00:01\"\nto = \"23:59\"\n";
    let area = format!("{CORNER_AREA}{context}");
    maps.replay("day", &area, |scan| scan.stamp_ns += 30_000_000_000);
    let frames = |arguments: &str| {
        let report = maps.json(arguments)[0].clone();
        let classes = report["classes"].as_array().unwrap().clone();
        classes.iter().map(|class| class["frames"].as_u64().unwrap()).sum::<u64>()
    };
    let all = frames("info day --format json");
    let parts = ["always", "later"]
        .map(|context| frames(&format!("info day --context {context} --format json")));
    assert!(parts.iter().all(|part| *part > 0) && all == parts[0] + parts[1], "{all} {parts:?}");
    maps.map("merge day before --out sum").expect(0, &[]);
    // What knows no contexts was counted in `always`.
    let before = frames("info before --format json");
    assert_eq!(frames("info sum --context always --format json"), parts[0] + before);
    assert_eq!(frames("info sum --context later --format json"), parts[1]);
    maps.map("info day --context noon").expect(1, &["no context `noon`", "`always`, `later`"]);
}

#[test]
fn what_is_no_map_is_refused_in_words() {
    let maps = Maps::new();
    maps.map("info .").expect(1, &["there is no map at .", "--area: `after`, `before`"]);
    maps.map("info nowhere").expect(1, &["neither a directory with a map nor a site file"]);
    maps.map("render before after --out x.png").expect(2, &["takes one map", "found 2"]);
    maps.map("diff before").expect(2, &["takes two maps", "found 1"]);
    maps.map("merge before --out x").expect(2, &["needs two maps or more"]);
    maps.map("diff before after --change-min 2").expect(2, &["--change-min 2 is no share"]);
    maps.map("render before --class wall --out x.png").expect(1, &["no class `wall`", "`transit`"]);
    maps.map("render before --gamma 7 --out x.png").expect(1, &["gamma 7"]);
    let counts = maps.at("before").join("collapsed_counts.npy");
    let whole = std::fs::read(&counts).unwrap();
    for (bytes, words) in [
        (&whole[..whole.len() - 1], "bytes, expected"),
        (&whole[..100], "its header alone has"),
        (&b"PK\x03\x04"[..], "expected \"\\x93NUMPY\""),
        (&[][..], "expected \"\\x93NUMPY\""),
    ] {
        std::fs::write(&counts, bytes).unwrap();
        maps.map("info before").expect(1, &["collapsed_counts.npy", words]);
    }
    std::fs::copy(maps.at("after").join("occupancy_last.npy"), &counts).unwrap();
    maps.map("info before").expect(1, &["found `<f8`", "expected `<u8` in C order"]);
    std::fs::write(maps.at("before").join("grid.json"), "{\"area\": 3}").unwrap();
    maps.map("info before").expect(1, &["grid.json", "expected a string"]);
}

#[test]
fn a_program_that_shares_nothing_with_us_reads_what_was_exported() {
    if !has_python() {
        return;
    }
    let maps = Maps::new();
    let (recording, site_file) = (maps.at("room.mcap"), maps.at("room.toml"));
    std::fs::write(&site_file, room(&recording, 30)).unwrap();
    let replay = [Path::new("replay"), &recording, Path::new("--site"), &site_file];
    let out = [Path::new("--out"), Path::new("room")];
    tog(&maps.scratch, replay.into_iter().chain(out)).expect(0, &[]);
    maps.map("merge before after --out both").expect(0, &[]);
    for map in ["room", "both"] {
        maps.map(&format!("export {map} --format nav2 --occupied-min 0.4 --out {map}-nav2"))
            .expect(0, &[]);
        maps.map(&format!("export {map} --format npy --out {map}-npy")).expect(0, &[]);
    }
    for arguments in [
        "nav2 room room-nav2 background 0.4",
        "nav2 both both-nav2 background 0.4",
        "npy room room-npy",
        "npy both both-npy",
        "sum both before after",
    ] {
        let mut command = oracle();
        command.arg("--map").args(arguments.split(' ')).current_dir(maps.scratch.path());
        watched(command).expect(0, &["verdict: every number agrees"]);
    }
}
