//! Site files whose lasers do not agree with each other, and what tog says of them.

use super::broken::check;

#[test]
fn a_laser_far_away_is_a_warning() {
    check(
        &[("x_m = 6.0", "x_m = 6000")],
        r#"
warning: `laser[0]` stands 5988.0 m away from its area
  --> lab.toml:16:7
   |
16 | x_m = 6000
   |       ^^^^ expected at most 30 m
   |
   = help: `x_m` and `y_m` are site coordinates, metres, as `origin_m` of the area

lab.toml: 1 warning
"#,
    );
}

#[test]
fn a_laser_too_slow_for_its_area_is_a_warning() {
    check(
        &[(
            "seed = 1",
            r#"seed = 1
rate_hz = 2"#,
        )],
        r#"
warning: `laser[0]` has a scan every 500 ms: frames will lack this laser
  --> lab.toml:23:11
   |
23 | rate_hz = 2
   |           ^ expected at most scan_age_max_ms = 250 and lateness_max_ms = 150 of its area
   |
   = help: raise these two of the area above the time between two scans

lab.toml: 1 warning
"#,
    );
}

#[test]
fn replay_and_simulator_do_not_mix_in_one_site() {
    check(
        &[(
            "seed = 1",
            r#"seed = 1

[[laser]]
id = "back"
area = "foyer"
x_m = 1
y_m = 1
source = { kind = "replay", recording = "a.bag" }"#,
        )],
        r#"
error: a site mixes replay and simulator
  --> lab.toml:29:19
   |
20 | kind = "simulator"
   |        ----------- the first laser
...
29 | source = { kind = "replay", recording = "a.bag" }
   |                   ^^^^^^^^ expected "simulator", as the first laser
   |
   = help: a site has one clock: make two sites of it

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_site_has_one_pace() {
    check(
        &[(
            r#"kind = "simulator"
scene = "foyer"
seed = 1"#,
            r#"kind = "replay"
recording = "a.bag"
topic = "/a"
pace = 2.0

[[laser]]
id = "back"
area = "foyer"
x_m = 1
y_m = 1
source = { kind = "replay", recording = "a.bag", topic = "/b" }"#,
        )],
        r#"
error: two lasers are replayed at different paces
  --> lab.toml:30:10
   |
23 | pace = 2.0
   |        --- the first laser
...
30 | source = { kind = "replay", recording = "a.bag", topic = "/b" }
   |          ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^ expected 2, as the first laser
   |
   = help: a site has one clock: write the same `pace` for all lasers

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_scene_has_one_seed() {
    check(
        &[(
            "seed = 1",
            r#"seed = 1

[[laser]]
id = "back"
area = "foyer"
x_m = 1
y_m = 1
source = { kind = "simulator", scene = "foyer" }"#,
        )],
        r#"
error: the scene "foyer" has two seeds
  --> lab.toml:29:10
   |
22 | seed = 1
   |        - the first laser of the scene
...
29 | source = { kind = "simulator", scene = "foyer" }
   |          ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^ expected 1, as the first laser of this scene
   |
   = help: all lasers of a scene see the same people: write the same `seed`

lab.toml: 1 error
"#,
    );
}

#[test]
fn one_topic_replayed_by_two_lasers_is_a_warning() {
    check(
        &[(
            r#"kind = "simulator"
scene = "foyer"
seed = 1"#,
            r#"kind = "replay"
recording = "a.bag"

[[laser]]
id = "back"
area = "foyer"
x_m = 1
y_m = 1
source = { kind = "replay", recording = "a.bag" }"#,
        )],
        r#"
warning: two lasers replay the same scans
  --> lab.toml:28:41
   |
21 | recording = "a.bag"
   |             ------- the first of them
...
28 | source = { kind = "replay", recording = "a.bag" }
   |                                         ^^^^^^^ expected another recording or `topic`
   |
   = help: write the `topic` of each laser in the recording

lab.toml: 1 warning
"#,
    );
}

#[test]
fn two_lasers_of_one_id_are_refused() {
    check(
        &[(
            "seed = 1",
            r#"seed = 1

[[laser]]
id = "front"
area = "foyer"
x_m = 1
y_m = 1
source = { kind = "simulator", scene = "foyer", seed = 1 }"#,
        )],
        r#"
error: two lasers have the id "front"
  --> lab.toml:25:6
   |
14 | id = "front"
   |      ------- first used here
...
25 | id = "front"
   |      ^^^^^^^ expected one that no other laser has
   |
   = help: give one of them another id

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_laser_of_an_area_that_is_not_there_asks_what_was_meant() {
    check(
        &[(r#"area = "foyer""#, r#"area = "foyre""#)],
        r#"
error: `laser[0].area` is "foyre", expected the id of an area of this file
  --> lab.toml:15:8
   |
15 | area = "foyre"
   |        ^^^^^^^ expected the id of an area of this file
   |
   = help: did you mean "foyer"?

lab.toml: 1 error
"#,
    );
}

#[test]
fn an_area_that_no_laser_watches_is_refused() {
    check(
        &[(
            "[[laser]]",
            r#"[[area]]
id = "attic"
origin_m = [0, 0]
columns = 10
rows = 10

[[laser]]"#,
        )],
        r#"
error: no laser watches the area "attic"
  --> lab.toml:14:6
   |
14 | id = "attic"
   |      ^^^^^^^ expected at least one laser
   |
   = help: add a `[[laser]]` with `area = "attic"`, or remove it

lab.toml: 1 error
"#,
    );
}
