//! How the tests of broken site files are written.

use protocol::site::Site;

/// A whole site. Every test below changes a line or two of it.
pub const GOOD: &str = r#"name = "lab"

[[area]]
id = "foyer"
origin_m = [0.0, 0.0]
cell_m = 0.1
columns = 120
rows = 80
frame_period_ms = 100
timescales_s = [1, 15, 60]
preset = "default"

[[laser]]
id = "front"
area = "foyer"
x_m = 6.0
y_m = 0.3

[laser.source]
kind = "simulator"
scene = "foyer"
seed = 1
"#;

/// Replaces each `from` by its `to` in [`GOOD`] and compares what is drawn.
#[track_caller]
pub fn check(changes: &[(&str, &str)], expected: &str) {
    let mut text = GOOD.to_owned();
    for (from, to) in changes {
        assert_eq!(text.matches(from).count(), 1, "{from:?} is not there once");
        text = text.replace(from, to);
    }
    let drawn = match Site::parse_with_warnings(&text, "lab.toml") {
        Ok((_, warnings)) => warnings,
        Err(errors) => {
            assert!(errors.has_errors());
            errors
        }
    };
    same(&drawn.to_string(), expected);
}

/// `expected` begins with a newline, so that the test shows it as a terminal does.
#[track_caller]
pub fn same(drawn: &str, expected: &str) {
    let expected = expected.trim_start_matches('\n');
    assert!(drawn == expected, "drawn:\n{drawn}\nexpected:\n{expected}");
}

#[test]
fn the_good_site_is_good() {
    check(&[], "");
}
