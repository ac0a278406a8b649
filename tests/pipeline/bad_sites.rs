//! Site files that are no good, or do not fit: words, with line and caret where a line is wrong.

use super::made::{CORNER_AREA, corner, site, write};
use super::support::{Ended, scratch, tog};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const LASERS: [(&str, &str, [f64; 3]); 2] = [("a", "/a", [0.0; 3]), ("b", "/b", [1.0, 0.0, 180.0])];

/// A right site file and its recording, to be made wrong.
struct Bench {
    scratch: TempDir,
    recording: PathBuf,
    text: String,
}

impl Bench {
    fn new() -> Self {
        let scratch = scratch();
        let recording = scratch.path().join("two.mcap");
        let scans = (0..40).flat_map(|number| [(0, corner(number)), (1, corner(number))]);
        write(&recording, &["/a", "/b"], scans);
        let text = site(&recording, CORNER_AREA, &LASERS);
        Self { scratch, recording, text }
    }

    /// Gives the site file with a part replaced to `tog` (verb, arguments behind the site).
    #[track_caller]
    fn with(&self, from: &str, to: &str, verb: &str) -> Ended {
        assert!(self.text.contains(from), "{from:?} is not in the site file");
        let path = self.scratch.path().join("site.toml");
        std::fs::write(&path, self.text.replacen(from, to, 1)).unwrap();
        let out = self.scratch.path().join("out");
        let (site, recording) = (path.as_path(), self.recording.as_path());
        let arguments = match verb {
            "replay" => vec![
                Path::new("replay"),
                recording,
                Path::new("--site"),
                site,
                Path::new("--out"),
                &out,
            ],
            "run" => vec![Path::new("run"), site, Path::new("--out"), &out],
            _ => vec![Path::new(verb), site],
        };
        tog(&self.scratch, arguments)
    }

    /// Every verb that reads the site refuses it with these words and exit code 78.
    #[track_caller]
    fn refused(&self, from: &str, to: &str, words: &[&str]) {
        for verb in ["check", "replay", "run", "status"] {
            self.with(from, to, verb).expect(78, words);
        }
        assert!(!self.scratch.path().join("out").exists(), "nothing is written for a wrong site");
        assert!(!self.scratch.path().join("r").exists(), "nothing is started for a wrong site");
    }
}

#[test]
fn the_right_site_is_right() {
    let bench = Bench::new();
    bench.with("made", "made", "check").expect(0, &["made: right.", "laser a", "mapper hall"]);
    bench.with("made", "made", "replay").expect(0, &["80 scans (0 dropped)"]);
    bench.with("made", "made", "run").expect(0, &["the recording is over"]);
}

#[test]
fn wrong_toml_is_told_with_line_and_caret() {
    let bench = Bench::new();
    let words = ["this is not TOML", "--> ", "site.toml:1:", "name = \"made", "^"];
    bench.refused("name = \"made\"", "name = \"made", &words);
    let bench = Bench::new();
    bench.refused("columns = 60", "columns = sixty", &["this is not TOML", "columns = sixty", "^"]);
}

#[test]
fn several_errors_are_told_at_once() {
    let bench = Bench::new();
    let wrong = "columns = -3\nsize_cm = 4\nscan_age_max_ms = \"old\"";
    let words = ["columns = -3", "size_cm = 4", "scan_age_max_ms = \"old\"", "^", "3 errors"];
    bench.refused("columns = 60", wrong, &words);
}

#[test]
fn programs_read_the_errors_as_json_with_line_and_column() {
    let bench = Bench::new();
    let path = bench.scratch.path().join("site.toml");
    std::fs::write(&path, bench.text.replacen("columns", "colums", 1)).unwrap();
    let arguments = [Path::new("check"), path.as_path(), Path::new("--format"), Path::new("json")];
    let ended = tog(&bench.scratch, arguments);
    ended.expect(78, &[]);
    let json: serde_json::Value = serde_json::from_str(&ended.out).unwrap();
    let first = &json["items"][0];
    assert!(first["line"].as_u64() > Some(1) && first["column"].as_u64() >= Some(1), "{json:#}");
    assert!(first["message"].as_str().is_some_and(|text| text.contains("colum")), "{json:#}");
}

#[test]
fn two_lasers_of_one_id_are_told_with_the_line() {
    Bench::new().refused("id = \"b\"", "id = \"a\"", &["id = \"a\"", "^", "site.toml:"]);
}

#[test]
fn a_prototype_of_wrong_length_is_told_with_the_line() {
    let area = "columns = 60\nclasses = [{ name = \"empty\", prototype = [0, 0] }]\n";
    let words = ["prototype", "^", "expected", "site.toml:"];
    Bench::new().refused("columns = 60\n", area, &words);
}

#[test]
fn simulated_lasers_cannot_be_fed_from_a_recording() {
    let recorded = Bench::new();
    let lines = recorded.text.lines().map(|line| match line.starts_with("source = ") {
        true => "source = { kind = \"simulator\", scene = \"room\", seed = 1 }\n".to_owned(),
        false => format!("{line}\n"),
    });
    let bench = Bench { text: lines.collect(), ..recorded };
    let ended = bench.with("made", "made", "replay");
    ended.expect(1, &["laser `a` of the site file is simulated, expected", "kind = \"replay\""]);
    assert!(!bench.scratch.path().join("out").exists(), "nothing is written");
    let mixed = bench.text.find("{ kind").unwrap();
    let from = bench.text[mixed..].lines().next().unwrap().to_owned();
    let source = format!("{{ kind = \"replay\", recording = \"{}\" }}", bench.recording.display());
    bench.refused(&from, &source, &["a site mixes replay and simulator", "^"]);
}

#[test]
fn a_topic_that_is_not_in_the_recording_is_told_with_those_that_are() {
    let bench = Bench::new();
    let words = ["has no scans on topic /nope; topics with scans: /a, /b"];
    bench.with("topic = \"/b\"", "topic = \"/nope\"", "replay").expect(1, &words);
    assert!(!bench.scratch.path().join("out").exists(), "nothing is written");
    bench.with("topic = \"/b\"", "topic = \"/nope\"", "run").expect(78, &words);
    bench.with(", topic = \"/b\"", "", "run").expect(78, &["say which one with `topic`: /a, /b"]);
}

#[test]
fn a_recording_that_is_not_there_is_told_before_anything_starts() {
    let bench = Bench::new();
    let ended = bench.with("two.mcap", "none.mcap", "run");
    ended.expect(78, &["none.mcap: cannot open the recording: No such file"]);
    assert!(!ended.said().contains("starts"), "{}", ended.said());
}

#[test]
fn results_of_a_live_site_are_refused() {
    let bench = Bench::new();
    let words = ["--out needs a site whose lasers replay", "lossless"];
    let ended = bench.with("pace = \"lossless\"", "pace = 10", "run");
    // One lossless laser and one that is not do not go together either.
    assert!(ended.code == 2 || ended.code == 78, "{}", ended.said());
    let live = bench.text.replace("pace = \"lossless\"", "pace = 10");
    let bench = Bench { text: live, ..Bench::new() };
    bench.with("made", "made", "run").expect(2, &words);
}
