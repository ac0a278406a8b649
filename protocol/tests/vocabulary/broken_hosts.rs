//! Site files with several hosts that cannot be, and what tog says of them.

use super::broken::{GOOD, check};
use protocol::site::Site;
use std::path::Path;

const HOSTS: &str = r#"[[host]]
id = "edge"
endpoint = "10.0.0.7:7447"
transport = "plain-tcp"

[[host]]
id = "desk"
endpoint = "[fd00::2]:7447"
transport = "plain-tcp"
desk = true

"#;

/// The good site on two hosts: the laser on `edge`, the area on `desk`.
fn placed() -> [(&'static str, String); 3] {
    [
        ("[[area]]\n", format!("{HOSTS}[[area]]\nhost = \"desk\"\n")),
        ("[[laser]]\n", "[[laser]]\nhost = \"edge\"\n".to_owned()),
        ("seed = 1\n", "seed = 1\n".to_owned()),
    ]
}

#[track_caller]
fn drawn(from: &str, to: &str, expected: &str) {
    let mut changes = placed();
    let change = changes.iter_mut().find(|(_, text)| text.contains(from)).expect(from);
    change.1 = change.1.replacen(from, to, 1);
    let changes: Vec<(&str, &str)> =
        changes.iter().map(|(from, to)| (*from, to.as_str())).collect();
    check(&changes, expected);
}

#[test]
fn a_site_says_what_runs_where() {
    let text = placed().iter().fold(GOOD.to_owned(), |text, (from, to)| text.replace(from, to));
    let site = Site::parse(&text, "lab.toml").unwrap_or_else(|errors| panic!("{errors}"));
    assert!(site.has_bridges() && site.hosts[1].desk && !site.hosts[0].desk);
    let lasers = |host| site.lasers_on(Some(host)).count();
    let areas = |host| site.areas_on(Some(host)).count();
    assert_eq!([lasers("edge"), areas("edge"), lasers("desk"), areas("desk")], [1, 0, 0, 1]);
    let crossing: Vec<_> = site.lasers_that_cross().map(|(index, ..)| index).collect();
    assert_eq!(crossing, [0]);
    let state = |base_dir: &str, host| site.state_dir_of(Path::new(base_dir), host);
    assert_eq!(state("/home/me", Some("edge")).to_str(), Some("/home/me/state/edge"));
    assert_eq!(state("/home/me", None).to_str(), Some("/home/me/state"));
    assert_eq!(state("/etc/tog", Some("edge")).to_str(), Some("/var/lib/tog/lab/edge"));
    let said = Site { state_dir: "../state".to_owned(), ..site.clone() };
    assert_eq!(said.state_dir_of(Path::new("/etc/tog"), None).to_str(), Some("/etc/tog/../state"));
}

#[test]
fn a_laser_runs_where_its_area_does_unless_it_says_otherwise() {
    let text = placed().iter().fold(GOOD.to_owned(), |text, (from, to)| text.replace(from, to));
    let text = text.replace("host = \"edge\"\n", "");
    let site = Site::parse(&text, "lab.toml").unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(site.lasers_on(Some("desk")).count(), 1);
    assert_eq!(site.lasers_that_cross().count(), 0);
}

#[test]
fn a_site_without_hosts_is_on_one_host() {
    let site = Site::parse(GOOD, "lab.toml").unwrap_or_else(|errors| panic!("{errors}"));
    assert!(!site.has_bridges());
    assert_eq!((site.areas_on(None).count(), site.lasers_on(None).count()), (1, 1));
    assert!(!toml::to_string(&site).is_ok_and(|text| text.contains("host")));
}

#[test]
fn plain_tcp_must_be_said_aloud() {
    drawn(
        "transport = \"plain-tcp\"\ndesk",
        "desk",
        r#"
error: `host[1]` lacks `transport`
 --> lab.toml:8:1
  |
8 | [[host]]
  | ^^^^^^^^ expected `transport`
  |
  = help: add `transport` ("tls" or "plain-tcp"): How the bridges talk. There is no default: that nothing is encrypted must be said aloud.

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_transport_that_there_is_not_is_told() {
    drawn(
        "\"plain-tcp\"",
        "\"quic\"",
        r#"
error: `host[0].transport` is "quic", expected "tls" or "plain-tcp"
 --> lab.toml:6:13
  |
6 | transport = "quic"
  |             ^^^^^^ expected "tls" or "plain-tcp"
  |
  = help: How the bridges talk. There is no default: that nothing is encrypted must be said aloud.

lab.toml: 1 error
"#,
    );
}

#[test]
fn one_host_with_tls_and_one_without_cannot_talk() {
    drawn(
        "\"plain-tcp\"",
        "\"tls\"",
        r#"
error: all hosts of a site talk in one way
  --> lab.toml:11:13
   |
11 | transport = "plain-tcp"
   |             ^^^^^^^^^^^ expected "tls", as the first host
   |
   = help: write the same `transport` at every host

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_standby_is_another_host() {
    drawn(
        "host = \"desk\"",
        "host = \"desk\"\nstandby = \"desk\"",
        r#"
error: an area is its own standby
  --> lab.toml:16:11
   |
16 | standby = "desk"
   |           ^^^^^^ expected another host than `host`
   |
   = help: name another host, or remove `standby`

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_standby_may_run_an_area_and_counts_its_own_events() {
    let text = placed().iter().fold(GOOD.to_owned(), |text, (from, to)| text.replace(from, to));
    let text = text.replace("host = \"desk\"\n", "host = \"desk\"\nstandby = \"edge\"\n");
    let site = Site::parse(&text, "lab.toml").unwrap_or_else(|errors| panic!("{errors}"));
    let area = &site.areas[0];
    assert_eq!([site.areas_on(Some("edge")).count(), site.areas_on(Some("desk")).count()], [1, 1]);
    assert_eq!(area.origin_on(Some("desk")), area.id);
    assert_eq!(area.origin_on(Some("edge")), format!("{}@edge", area.id));
    assert!(!area.may_run_on(None) && !area.may_run_on(Some("yard")));
}

#[test]
fn an_endpoint_needs_a_port() {
    drawn(
        "10.0.0.7:7447",
        "10.0.0.7",
        r#"
error: `host[0].endpoint` is "10.0.0.7", expected the address by which other hosts reach it and a port, as "10.0.0.7:7447"
 --> lab.toml:5:12
  |
5 | endpoint = "10.0.0.7"
  |            ^^^^^^^^^^ expected the address by which other hosts reach it and a port, as "10.0.0.7:7447"
  |
  = help: Address and port where its bridge listens and where the others find it.

lab.toml: 1 error
"#,
    );
}

#[test]
fn an_endpoint_is_what_others_dial() {
    drawn(
        "10.0.0.7:7447",
        "0.0.0.0:7447",
        r#"
error: `host[0].endpoint` is "0.0.0.0:7447", expected the address by which other hosts reach it and a port, as "10.0.0.7:7447"
 --> lab.toml:5:12
  |
5 | endpoint = "0.0.0.0:7447"
  |            ^^^^^^^^^^^^^^ expected the address by which other hosts reach it and a port, as "10.0.0.7:7447"
  |
  = help: Address and port where its bridge listens and where the others find it.

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_mistyped_host_is_told() {
    drawn(
        "host = \"edge\"",
        "host = \"edgy\"",
        r#"
error: `laser[0].host` is "edgy", expected the id of a host of this file
  --> lab.toml:26:8
   |
26 | host = "edgy"
   |        ^^^^^^ expected the id of a host of this file
   |
   = help: did you mean "edge"?

lab.toml: 1 error
"#,
    );
}

#[test]
fn an_area_that_nobody_runs_is_told() {
    drawn(
        "host = \"desk\"\n",
        "",
        r#"
error: nobody runs `area[0]`: it lacks `host`
  --> lab.toml:14:1
   |
14 | [[area]]
   | ^^^^^^^^ expected one of `edge`, `desk`
   |
   = help: a site with `[[host]]` says of every area where it runs: add `host = `

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_host_without_hosts_is_told() {
    check(
        &[("[[laser]]\n", "[[laser]]\nhost = \"edge\"\n")],
        r#"
error: `laser[0].host` is "edge", expected the id of a host of this file
  --> lab.toml:14:8
   |
14 | host = "edge"
   |        ^^^^^^ expected the id of a host of this file
   |
   = help: this file has no `[[host]]`: add one, or remove this line and everything runs on one host

lab.toml: 1 error
"#,
    );
}

#[test]
fn two_hosts_at_one_endpoint_are_told() {
    drawn(
        "[fd00::2]:7447",
        "10.0.0.7:7447",
        r#"
error: two hosts have the endpoint "10.0.0.7:7447"
  --> lab.toml:10:12
   |
 5 | endpoint = "10.0.0.7:7447"
   |            --------------- first used here
...
10 | endpoint = "10.0.0.7:7447"
   |            ^^^^^^^^^^^^^^^ expected one that no other host has
   |
   = help: give one of them another endpoint

lab.toml: 1 error
"#,
    );
}

#[test]
fn a_site_without_a_desk_is_warned() {
    drawn(
        "desk = true\n",
        "",
        r#"
warning: no host is a desk: every host keeps its events to itself
 --> lab.toml:3:1
  |
3 | [[host]]
  | ^^^^^^^^ expected `desk = true` at one host or more
  |
  = help: write `desk = true` at the host where people look at the alerts

lab.toml: 1 warning
"#,
    );
}

#[test]
fn the_host_that_records_and_what_a_host_follows_are_of_this_file() {
    drawn(
        "[[area]]\n",
        "[recorder]\nhost = \"dest\"\n\n[[area]]\n",
        r#"
error: `recorder.host` is "dest", expected the id of a host of this file
  --> lab.toml:15:8
   |
15 | host = "dest"
   |        ^^^^^^ expected the id of a host of this file
   |
   = help: did you mean "desk"?

lab.toml: 1 error
"#,
    );
    drawn(
        "desk = true\n",
        "desk = true\nfollows = [\"hal\"]\n",
        r#"
error: `host[1].follows[0]` is "hal", expected the id of an area of this file
  --> lab.toml:13:12
   |
13 | follows = ["hal"]
   |            ^^^^^ expected the id of an area of this file
   |
   = help: areas of this file: `foyer`

lab.toml: 1 error
"#,
    );
    drawn(
        "desk = true\n",
        "desk = true\nfollows = [\"foyer\"]\n",
        r#"
error: area foyer may run on desk itself: its maps are there
  --> lab.toml:13:12
   |
13 | follows = ["foyer"]
   |            ^^^^^^^ expected an area of another host
   |
   = help: remove it from `follows`

lab.toml: 1 error
"#,
    );
}

#[test]
fn nothing_runs_at_a_desk_that_goes_through_others() {
    drawn(
        "desk = true",
        "desk = true\nthrough = [\"edge\"]",
        r#"
warning: if that is lost, desk desk hears nothing any more
  --> lab.toml:13:12
   |
13 | through = ["edge"]
   |            ^^^^^^ expected two hosts
   |
   = help: name a second one in `through`

error: host desk only looks: areas and lasers run elsewhere
  --> lab.toml:16:8
   |
16 | host = "desk"
   |        ^^^^^^ expected a host without `through`
   |
   = help: name another host, or remove `through` at that one

lab.toml: 1 error, 1 warning
"#,
    );
}

#[test]
fn a_desk_goes_through_other_hosts_and_says_that_it_is_one() {
    drawn(
        "transport = \"plain-tcp\"\n\n",
        "transport = \"plain-tcp\"\nthrough = [\"edge\", \"yard\"]\n\n",
        r#"
error: host edge is reached through others, and looks at nothing
 --> lab.toml:7:12
  |
7 | through = ["edge", "yard"]
  |            ^^^^^^ expected `desk = true`
  |
  = help: write `desk = true` at this host, or remove `through`

error: host edge cannot be reached through edge
 --> lab.toml:7:12
  |
7 | through = ["edge", "yard"]
  |            ^^^^^^ expected another host, without `through`
  |
  = help: name hosts that have a link to every other one

error: `host[0].through[1]` is "yard", expected the id of a host of this file
 --> lab.toml:7:20
  |
7 | through = ["edge", "yard"]
  |                    ^^^^^^ expected the id of a host of this file
  |
  = help: hosts of this file: `edge`, `desk`

error: host edge only looks: areas and lasers run elsewhere
  --> lab.toml:27:8
   |
27 | host = "edge"
   |        ^^^^^^ expected a host without `through`
   |
   = help: name another host, or remove `through` at that one

lab.toml: 4 errors
"#,
    );
}
