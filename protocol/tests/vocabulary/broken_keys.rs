//! Site files with wrong keys or wrong TOML, and what tog says of them.

use super::broken::{check, same};
use protocol::site::Site;

#[test]
fn a_mistyped_key_asks_what_was_meant() {
    check(
        &[("cell_m = 0.1", "cel_m = 0.1")],
        r#"
error: there is no key `cel_m` in `area[0]`
 --> lab.toml:6:1
  |
6 | cel_m = 0.1
  | ^^^^^ expected a known key
  |
  = help: did you mean `cell_m`?

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_key_with_another_unit_asks_what_was_meant() {
    check(
        &[("frame_period_ms = 100", "frame_period_s = 0.1")],
        r#"
error: there is no key `frame_period_s` in `area[0]`
 --> lab.toml:9:1
  |
9 | frame_period_s = 0.1
  | ^^^^^^^^^^^^^^ expected a known key
  |
  = help: did you mean `frame_period_ms`?

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_key_of_another_table_is_sent_there() {
    check(
        &[(
            r#"id = "front""#,
            r#"id = "front"
rate_hz = 10"#,
        )],
        r#"
error: there is no key `rate_hz` in `laser[0]`
  --> lab.toml:15:1
   |
15 | rate_hz = 10
   | ^^^^^^^ expected a known key
   |
   = help: `rate_hz` belongs in `laser.source` of kind "simulator"

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_key_after_the_tables_is_sent_to_the_top() {
    check(
        &[(
            "seed = 1",
            r#"seed = 1
timezone = "UTC""#,
        )],
        r#"
error: there is no key `timezone` in `laser[0].source`
  --> lab.toml:23:1
   |
23 | timezone = "UTC"
   | ^^^^^^^^ expected a known key
   |
   = help: `timezone` belongs at the top of the file, before the first `[[..]]`

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_key_that_nobody_has_lists_those_that_are_known() {
    check(
        &[(
            r#"preset = "default""#,
            r#"preset = "default"
flavour = "vanilla""#,
        )],
        r#"
error: there is no key `flavour` in `area[0]`
  --> lab.toml:12:1
   |
12 | flavour = "vanilla"
   | ^^^^^^^ expected a known key
   |
   = help: remove it. Keys here: `cell_m`, `checkpoint_s`, `class`, `columns`, `context`, `detector`, `frame_period_ms`, `host`, `id`, `known_share_min`, `laser_lost_ms`, `lateness_max_ms`, `origin_m`, `preset`, `range_tolerance_m`, `rows`, `scan_age_max_ms`, `standby`, `timescales_s`, `transit`, `zone`

lab.toml: 1 error
"#,
    );
}

#[test]
fn all_missing_keys_of_a_table_are_one_message() {
    check(
        &[
            (
                r#"x_m = 6.0
"#,
                "",
            ),
            (
                r#"id = "front"
"#,
                "",
            ),
        ],
        r#"
error: `laser[0]` lacks `id`, `x_m`
  --> lab.toml:13:1
   |
13 | [[laser]]
   | ^^^^^^^^^ expected `id`, `x_m`
   |
   = help: add `id`: Name of the laser, unique in the site: letters, digits, `-`, `_`; at most 32.
           add `x_m` (a number from -100000 to 100000): Site x of the laser, metres.

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_mistyped_required_key_is_not_missing_as_well() {
    check(
        &[("x_m = 6.0", "x = 6.0")],
        r#"
error: there is no key `x` in `laser[0]`
  --> lab.toml:16:1
   |
16 | x = 6.0
   | ^ expected a known key
   |
   = help: did you mean `x_m`?

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_source_without_a_kind_is_asked_for_it() {
    check(
        &[(
            r#"kind = "simulator"
"#,
            "",
        )],
        r#"
error: `laser[0].source` lacks `kind`
  --> lab.toml:19:1
   |
19 | [laser.source]
   | ^^^^^^^^^^^^^^ expected "simulator" or "replay"
   |
   = help: write `kind = ` and "simulator" or "replay"

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_key_of_another_kind_of_source_is_sent_there() {
    check(
        &[("seed = 1", "pace = 2")],
        r#"
error: there is no key `pace` in `laser[0].source`
  --> lab.toml:22:1
   |
22 | pace = 2
   | ^^^^ expected a known key
   |
   = help: `pace` belongs in `laser.source` of kind "replay"

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_table_in_single_brackets_is_no_list() {
    check(
        &[("[[laser]]", "[laser]")],
        r#"
error: `laser` is a table, expected a list of 1 to 256 tables
  --> lab.toml:13:1
   |
13 | [laser]
   | ^^^^^^^ expected a list of 1 to 256 tables
   |
   = help: write `[[laser]]` in double brackets, once for each

lab.toml: 1 error
"#,
    );
}

#[test]
fn an_empty_file_lacks_everything() {
    let drawn = Site::parse("", "lab.toml").unwrap_err().to_string();
    same(
        &drawn,
        r#"
error: the site file lacks `name`, `area`, `laser`
 --> lab.toml:1:1
  |
1 |
  | ^ expected `name`, `area`, `laser`
  |
  = help: add `name`: Name of the site: letters, digits, `-`, `_`; at most 32.
          add `[[area]]` and its keys: The areas that are watched.
          add `[[laser]]` and its keys: The lasers.

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_syntax_error_has_the_same_form() {
    check(
        &[("columns = 120", "columns = ")],
        r#"
error: this is not TOML: string values must be quoted, expected literal string
 --> lab.toml:7:11
  |
7 | columns = 
  |           ^ expected literal string
  |
  = help: TOML is described at https://toml.io

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_key_that_is_written_twice_is_refused() {
    check(
        &[(
            "columns = 120",
            r#"columns = 120
columns = 121"#,
        )],
        r#"
error: this is not TOML: duplicate key
 --> lab.toml:8:1
  |
8 | columns = 121
  | ^^^^^^^
  |
  = help: TOML is described at https://toml.io

lab.toml: 1 error
"#,
    );
}

#[test]
fn an_unclosed_text_is_shown_where_it_ends() {
    check(
        &[(r#"name = "lab""#, r#"name = "lab"#)],
        r#"
error: this is not TOML: invalid basic string, expected `"`
 --> lab.toml:1:12
  |
1 | name = "lab
  |            ^ expected `"`
  |
  = help: TOML is described at https://toml.io

lab.toml: 1 error
"#,
    );
}
