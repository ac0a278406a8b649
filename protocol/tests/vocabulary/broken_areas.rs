//! Site files whose areas do not agree with themselves, and what tog says of them.

use super::broken::check;

#[test]
fn no_area_has_the_name_of_the_host() {
    check(
        &[(r#"id = "foyer""#, r#"id = "host""#), (r#"area = "foyer""#, r#"area = "host""#)],
        r#"
error: `area[0].id` is "host", expected another name than `host`
 --> lab.toml:4:6
  |
4 | id = "host"
  |      ^^^^^^ expected another name than `host`
  |
  = help: `host` is where events of the machine itself come from

lab.toml: 1 error
"#,
    );
}

#[test]
fn an_area_of_too_many_cells_is_refused() {
    check(
        &[("columns = 120", "columns = 4000"), ("rows = 80", "rows = 4000")],
        r#"
error: `area[0]` has too many cells
 --> lab.toml:7:11
  |
7 | columns = 4000
  |           ^^^^ expected at most 4194304 cells in an area
  |
  = help: make `cell_m` larger, or split the area in two

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_mistyped_time_zone_asks_what_was_meant() {
    check(
        &[(
            r#"name = "lab""#,
            r#"name = "lab"
timezone = "Europe/Züric""#,
        )],
        r#"
error: `timezone` is "Europe/Züric", expected a time zone of the IANA database, as "Europe/Zurich" or "UTC"
 --> lab.toml:2:12
  |
2 | timezone = "Europe/Züric"
  |            ^^^^^^^^^^^^^^ expected a time zone of the IANA database, as "Europe/Zurich" or "UTC"
  |
  = help: did you mean "Europe/Zurich"?

lab.toml: 1 error
"#,
    );
}

#[test]
fn timescales_ascend() {
    check(
        &[("timescales_s = [1, 15, 60]", "timescales_s = [1, 60, 15]")],
        r#"
error: `area[0].timescales_s[2]` is 15, expected more than 60, the one before it
  --> lab.toml:10:24
   |
10 | timescales_s = [1, 60, 15]
   |                        ^^ expected more than 60, the one before it
   |
   = help: timescales ascend: prototypes name them from short to long

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_preset_needs_three_timescales() {
    check(
        &[("timescales_s = [1, 15, 60]", "timescales_s = [1, 60]")],
        r#"
error: `area[0].timescales_s` is a list of 2, expected 3 timescales, as the presets have
  --> lab.toml:10:16
   |
10 | timescales_s = [1, 60]
   |                ^^^^^^^ expected 3 timescales, as the presets have
   |
   = help: write three timescales, or own classes with `[[area.class]]`

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_timescale_of_too_many_frames_is_refused() {
    check(
        &[
            ("timescales_s = [1, 15, 60]", "timescales_s = [1, 15, 86400]"),
            ("frame_period_ms = 100", "frame_period_ms = 13"),
        ],
        r#"
error: `area[0]` asks for 86400 s of a frame every 13 ms: 6646154 frames
  --> lab.toml:10:16
   |
10 | timescales_s = [1, 15, 86400]
   |                ^^^^^^^^^^^^^^ expected at most 1048576 frames in the longest timescale
   |
   = help: the changes of all of them are kept in memory: shorten the timescale

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_prototype_has_one_number_for_each_timescale() {
    check(
        &[(
            r#"preset = "default""#,
            r#"preset = "default"
[[area.class]]
name = "empty"
prototype = [0, 0]"#,
        )],
        r#"
error: `area[0].class[0].prototype` is a list of 2, expected 3 numbers, one for each of `timescales_s`
  --> lab.toml:14:13
   |
14 | prototype = [0, 0]
   |             ^^^^^^ expected 3 numbers, one for each of `timescales_s`
   |
   = help: a prototype is the occupancy on each timescale, from short to long

lab.toml: 1 error
"#,
    );
}

#[test]
fn no_class_has_the_name_of_one_that_tog_adds_itself() {
    check(
        &[(
            r#"preset = "default""#,
            r#"preset = "default"
[[area.class]]
name = "transit"
prototype = [0, 0, 0]"#,
        )],
        r#"
error: `area[0].class[0].name` is "transit", expected another name than `transit`, `unknown`
  --> lab.toml:13:8
   |
13 | name = "transit"
   |        ^^^^^^^^^ expected another name than `transit`, `unknown`
   |
   = help: `transit` is a class that tog adds itself

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_prototype_that_never_wins_is_a_warning() {
    check(
        &[(
            r#"preset = "default""#,
            r#"preset = "default"
[[area.class]]
name = "a"
prototype = [0, 0, 1]
[[area.class]]
name = "b"
prototype = [0, 0, 1.0]"#,
        )],
        r#"
warning: `area[0].class[1].prototype` is the prototype of another class, expected one of its own
  --> lab.toml:17:13
   |
14 | prototype = [0, 0, 1]
   |             --------- first used here
...
17 | prototype = [0, 0, 1.0]
   |             ^^^^^^^^^^^ expected one of its own
   |
   = help: a tie goes to the first of the two: this class never wins

lab.toml: 1 warning
"#,
    );
}

#[test]
fn no_context_is_named_always_or_ends_at_a_time_that_is_none() {
    check(
        &[(
            r#"preset = "default""#,
            r#"preset = "default"
[[area.context]]
name = "always"
from = "8:00"
to = "24:00""#,
        )],
        r#"
error: `area[0].context[0].name` is "always", expected another name than `always`
  --> lab.toml:13:8
   |
13 | name = "always"
   |        ^^^^^^^^ expected another name than `always`
   |
   = help: `always` is the context of all times that no other names

error: `area[0].context[0].from` is "8:00", expected a time from "00:00" to "23:59"
  --> lab.toml:14:8
   |
14 | from = "8:00"
   |        ^^^^^^ expected a time from "00:00" to "23:59"
   |
   = help: Begin, `HH:MM` in the site's time zone.

error: `area[0].context[0].to` is "24:00", expected a time from "00:00" to "23:59"
  --> lab.toml:15:6
   |
15 | to = "24:00"
   |      ^^^^^^^ expected a time from "00:00" to "23:59"
   |
   = help: End, `HH:MM`; a time at or before `from` means the next day.

lab.toml: 3 errors
"#,
    );
}

#[test]
fn contexts_that_overlap_are_a_warning() {
    check(
        &[(
            r#"preset = "default""#,
            r#"preset = "default"
[[area.context]]
name = "night"
from = "22:00"
to = "06:00"
[[area.context]]
name = "monday"
days = ["mon"]
from = "05:00"
to = "12:00""#,
        )],
        r#"
warning: "monday" overlaps with "night"
  --> lab.toml:19:8
   |
14 | from = "22:00"
   |        ------- "night" counts
...
19 | from = "05:00"
   |        ^^^^^^^ expected contexts that do not overlap
   |
   = help: from mon 05:00 on the first of the two in the file counts

lab.toml: 1 warning
"#,
    );
}

#[test]
fn a_context_has_each_day_once() {
    check(
        &[(
            r#"preset = "default""#,
            r#"preset = "default"
[[area.context]]
name = "work"
days = ["mon", "mon"]
from = "08:00"
to = "18:00""#,
        )],
        r#"
error: `area[0].context[0].days[1]` is "mon", expected each day once
  --> lab.toml:14:16
   |
14 | days = ["mon", "mon"]
   |                ^^^^^ expected each day once
   |
   = help: remove one of the two

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_zone_has_an_inside() {
    check(
        &[(
            r#"preset = "default""#,
            r#"preset = "default"
[[area.zone]]
name = "line"
polygon_m = [[1, 1], [2, 2], [3, 3]]"#,
        )],
        r#"
error: `area[0].zone[0].polygon_m` is a polygon of 0.0000 square metres, expected at least 0.01
  --> lab.toml:14:13
   |
14 | polygon_m = [[1, 1], [2, 2], [3, 3]]
   |             ^^^^^^^^^^^^^^^^^^^^^^^^ expected at least 0.01
   |
   = help: write the corners in the order in which one walks round the zone

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_zone_elsewhere_is_refused_and_one_that_reaches_out_is_a_warning() {
    check(
        &[(
            r#"preset = "default""#,
            r#"preset = "default"
[[area.zone]]
name = "moon"
polygon_m = [[90, 1], [92, 1], [92, 3]]
[[area.zone]]
name = "door"
polygon_m = [[-1, 1], [2, 1], [2, 3]]"#,
        )],
        r#"
error: the zone "moon" lies outside the area
  --> lab.toml:14:13
   |
14 | polygon_m = [[90, 1], [92, 1], [92, 3]]
   |             ^^^^^^^^^^^^^^^^^^^^^^^^^^^ expected within x 0.0 to 12.0, y 0.0 to 8.0, as its area is
   |
   = help: corners are in site coordinates, metres, not relative to the area

warning: the zone "door" reaches out of the area
  --> lab.toml:17:13
   |
17 | polygon_m = [[-1, 1], [2, 1], [2, 3]]
   |             ^^^^^^^^^^^^^^^^^^^^^^^^^ expected within x 0.0 to 12.0, y 0.0 to 8.0, as its area is
   |
   = help: what lies outside is not watched

lab.toml: 1 error, 1 warning
"#,
    );
}

#[test]
fn a_laser_is_not_lost_before_its_scan_is_too_old() {
    check(
        &[(
            "frame_period_ms = 100",
            r#"frame_period_ms = 100
laser_lost_ms = 200"#,
        )],
        r#"
error: `area[0]` has laser_lost_ms = 200 and scan_age_max_ms = 250
  --> lab.toml:10:17
   |
10 | laser_lost_ms = 200
   |                 ^^^ expected laser_lost_ms >= scan_age_max_ms
   |
   = help: a laser would be lost while its last scan is still in the frames

lab.toml: 1 error
"#,
    );
}

#[test]
fn scans_that_are_in_no_frame_are_a_warning() {
    check(
        &[("frame_period_ms = 100", "frame_period_ms = 400")],
        r#"
warning: `area[0]` has scan_age_max_ms = 250 and frame_period_ms = 400
 --> lab.toml:9:19
  |
9 | frame_period_ms = 400
  |                   ^^^ expected scan_age_max_ms >= frame_period_ms
  |
  = help: a scan that comes early in the period of a frame is in no frame

lab.toml: 1 warning
"#,
    );
}
