//! Site files with wrong values, and what tog says of them.

use super::broken::check;

#[test]
fn a_number_in_quotes_is_no_number() {
    check(
        &[("columns = 120", r#"columns = "120""#)],
        r#"
error: `area[0].columns` is "120", expected a whole number from 1 to 4096
 --> lab.toml:7:11
  |
7 | columns = "120"
  |           ^^^^^ expected a whole number from 1 to 4096
  |
  = help: write the number without quotes. Cells along x.

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_fraction_of_a_cell_is_refused() {
    check(
        &[("columns = 120", "columns = 120.5")],
        r#"
error: `area[0].columns` is 120.5, expected a whole number from 1 to 4096
 --> lab.toml:7:11
  |
7 | columns = 120.5
  |           ^^^^^ expected a whole number from 1 to 4096
  |
  = help: Cells along x.

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_number_too_large_and_one_too_small_name_their_range() {
    check(
        &[("columns = 120", "columns = 99999999999999999999"), ("cell_m = 0.1", "cell_m = 0")],
        r#"
error: `area[0].cell_m` is 0, expected a number from 0.01 to 1
 --> lab.toml:6:10
  |
6 | cell_m = 0
  |          ^ expected a number from 0.01 to 1
  |
  = help: Edge of a cell, metres.

error: `area[0].columns` is 99999999999999999999, expected a whole number from 1 to 4096
 --> lab.toml:7:11
  |
7 | columns = 99999999999999999999
  |           ^^^^^^^^^^^^^^^^^^^^ expected a whole number from 1 to 4096
  |
  = help: Cells along x.

lab.toml: 2 errors
"#,
    );
}

#[test]
fn a_number_that_is_not_finite_is_refused() {
    check(
        &[("x_m = 6.0", "x_m = nan"), ("y_m = 0.3", "y_m = -inf")],
        r#"
error: `laser[0].x_m` is nan, expected a number from -100000 to 100000
  --> lab.toml:16:7
   |
16 | x_m = nan
   |       ^^^ expected a number from -100000 to 100000
   |
   = help: Site x of the laser, metres.

error: `laser[0].y_m` is -inf, expected a number from -100000 to 100000
  --> lab.toml:17:7
   |
17 | y_m = -inf
   |       ^^^^ expected a number from -100000 to 100000
   |
   = help: Site y of the laser, metres.

lab.toml: 2 errors
"#,
    );
}

#[test]
fn a_list_of_the_wrong_length_is_refused() {
    check(
        &[("origin_m = [0.0, 0.0]", "origin_m = [0.0]")],
        r#"
error: `area[0].origin_m` is a list of 1 value, expected a list of 2 numbers
 --> lab.toml:5:12
  |
5 | origin_m = [0.0]
  |            ^^^^^ expected a list of 2 numbers
  |
  = help: Lower left corner in site coordinates, metres.

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_word_that_is_none_of_the_choices_shows_the_choices() {
    check(
        &[(r#"preset = "default""#, r#"preset = "papers""#)],
        r#"
error: `area[0].preset` is "papers", expected "default", "paper" or "onehot"
  --> lab.toml:11:10
   |
11 | preset = "papers"
   |          ^^^^^^^^ expected "default", "paper" or "onehot"
   |
   = help: did you mean "paper"?

lab.toml: 1 error
"#,
    );
}

#[test]
fn an_unknown_kind_of_source_shows_the_kinds() {
    check(
        &[(r#"kind = "simulator""#, r#"kind = "simulation""#)],
        r#"
error: `laser[0].source.kind` is "simulation", expected "simulator" or "replay"
  --> lab.toml:20:8
   |
20 | kind = "simulation"
   |        ^^^^^^^^^^^^ expected "simulator" or "replay"
   |
   = help: did you mean "simulator"?

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_pace_of_zero_is_refused() {
    check(
        &[(
            r#"kind = "simulator"
scene = "foyer"
seed = 1"#,
            r#"kind = "replay"
recording = "a.bag"
pace = 0"#,
        )],
        r#"
error: `laser[0].source.pace` is 0, expected "real_time", "lossless" or a number from 0.01 to 10000
  --> lab.toml:22:8
   |
22 | pace = 0
   |        ^ expected "real_time", "lossless" or a number from 0.01 to 10000
   |
   = help: How fast; the same for all lasers of a site.

lab.toml: 1 error
"#,
    );
}

#[test]
fn an_id_with_a_space_is_refused() {
    check(
        &[(r#"id = "front""#, r#"id = "the front""#)],
        r#"
error: `laser[0].id` is "the front", expected 1 to 32 letters, digits, `-` or `_`
  --> lab.toml:14:6
   |
14 | id = "the front"
   |      ^^^^^^^^^^^ expected 1 to 32 letters, digits, `-` or `_`
   |
   = help: Name of the laser, unique in the site: letters, digits, `-`, `_`; at most 32.

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_control_character_in_a_text_is_refused() {
    check(
        &[(r#"scene = "foyer""#, r#"scene = "foy\u001ber""#)],
        r#"
error: `laser[0].source.scene` is "foy\u{1b}er", expected text without control characters
  --> lab.toml:21:9
   |
21 | scene = "foy\u001ber"
   |         ^^^^^^^^^^^^^ expected text without control characters
   |
   = help: it is shown on terminals and in alerts: remove them

lab.toml: 1 error
"#,
    );
}

#[test]
fn several_errors_are_told_at_once_in_the_order_of_the_file() {
    check(
        &[
            (r#"name = "lab""#, "name = 3"),
            ("rows = 80", "rows = 0"),
            (
                r#"kind = "simulator""#,
                r#"kind = "simulator"
rates = 5"#,
            ),
        ],
        r#"
error: `name` is 3, expected 1 to 32 letters, digits, `-` or `_`
 --> lab.toml:1:8
  |
1 | name = 3
  |        ^ expected 1 to 32 letters, digits, `-` or `_`
  |
  = help: Name of the site: letters, digits, `-`, `_`; at most 32.

error: `area[0].rows` is 0, expected a whole number from 1 to 4096
 --> lab.toml:8:8
  |
8 | rows = 0
  |        ^ expected a whole number from 1 to 4096
  |
  = help: Cells along y.

error: there is no key `rates` in `laser[0].source`
  --> lab.toml:21:1
   |
21 | rates = 5
   | ^^^^^ expected a known key
   |
   = help: remove it. Keys here: `kind`, `rate_hz`, `scene`, `seed`

lab.toml: 3 errors
"#,
    );
}
