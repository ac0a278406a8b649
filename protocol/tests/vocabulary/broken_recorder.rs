//! Site files with a wrong `[recorder]`, and what tog says of them.

use super::broken::{GOOD, check};
use protocol::site::{RecordedTopics, Recorder, Site};

/// The recorder's section, in front of the first area.
fn with(section: &str) -> [(&'static str, String); 1] {
    [("[[area]]\n", format!("[recorder]\n{section}\n[[area]]\n"))]
}

#[track_caller]
fn drawn(section: &str, expected: &str) {
    let changes = with(section);
    check(&[(changes[0].0, &changes[0].1)], expected);
}

#[test]
fn nothing_is_recorded_unless_the_file_asks_for_it() {
    let parse = |text: &str| Site::parse(text, "lab.toml").unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(parse(GOOD).recorder, None);
    let text = GOOD.replace("[[area]]\n", "[recorder]\n\n[[area]]\n");
    assert_eq!(parse(&text).recorder, Some(Recorder::default()));
    let text = GOOD.replace(
        "[[area]]\n",
        "[recorder]\ntopics = [\"scans\"]\nsplit_mb = 10\nkeep_mb = 20\n\n[[area]]\n",
    );
    let recorder = parse(&text).recorder.unwrap_or_default();
    assert!(recorder.records(RecordedTopics::Scans) && !recorder.records(RecordedTopics::Maps));
    assert_eq!((recorder.split_bytes(), recorder.keep_bytes()), (10_000_000, Some(20_000_000)));
}

#[test]
fn a_mistyped_key_of_the_recorder_is_told() {
    drawn(
        "split_gb = 1\n",
        r#"
error: there is no key `split_gb` in `recorder`
 --> lab.toml:4:1
  |
4 | split_gb = 1
  | ^^^^^^^^ expected a known key
  |
  = help: did you mean `split_mb`?

lab.toml: 1 error
"#,
    );
}

#[test]
fn topics_that_there_are_not_are_told() {
    drawn(
        "topics = [\"scans\", \"frames\"]\n",
        r#"
error: `recorder.topics[1]` is "frames", expected "scans", "maps" or "events"
 --> lab.toml:4:20
  |
4 | topics = ["scans", "frames"]
  |                    ^^^^^^^^ expected "scans", "maps" or "events"

lab.toml: 1 error
"#,
    );
}

#[test]
fn less_than_two_files_cannot_be_kept() {
    drawn(
        "split_mb = 100\nkeep_mb = 150\n",
        r#"
error: a file would be deleted as soon as it is complete
 --> lab.toml:5:11
  |
5 | keep_mb = 150
  |           ^^^ expected at least 200, twice `split_mb`
  |
  = help: the file that is being written counts as well: lower `split_mb`

lab.toml: 1 error
"#,
    );
}
