//! A desk that is a client of two hosts: it has what every other desk has, whichever of them is lost.
//!
//! Nightly, because it takes a minute of the machine.

use super::bridge::assert_the_desk_has_all;
use super::feed::Desk;
use super::lan::{certificates_of, head, plan, planned_bytes_per_s};
use super::views::{Eyes, assert_equal, look_at_both};
use harness::{Lan, Random, Scratch, Setup, Site, count, find, is_nightly};
use rustix::process::Signal;
use std::fmt::Write as _;
use std::time::{Duration, Instant};

const HOSTS: [&str; 4] = ["left", "right", "far", "desk"];

/// `far` runs `hall` and is a peer, `left` and `right` run an area each and are routers of `desk`.
fn site_file(lan: &Lan, certificates: &Scratch, reader: &str) -> String {
    let more = |host: &str| match host {
        "desk" => "desk = true\nthrough = [\"left\", \"right\"]\nfollows = [\"hall\"]\n",
        _ => "",
    };
    let mut toml = head(&HOSTS, lan, reader, ("tls", certificates), more);
    for (area, laser, host) in
        [("hall", "south", "far"), ("lobby", "north", "left"), ("yard", "west", "right")]
    {
        let _ = write!(
            toml,
            "[[area]]\nid = \"{area}\"\nhost = \"{host}\"\norigin_m = [-0.5, -0.5]\ncolumns = 110\n\
             rows = 100\ncheckpoint_s = 5\ntimescales_s = [1, 2, 4]\n\n\
             [[laser]]\nid = \"{laser}\"\narea = \"{area}\"\nx_m = 4.6\ny_m = 0.2\nyaw_deg = 90\n\
             source = {{ kind = \"simulator\", scene = \"room\", seed = 1 }}\n\n"
        );
    }
    toml
}

fn wait_until_all_are_heard(desk: &mut Site) {
    desk.wait_until("all other hosts", |report| {
        let bridge = find(report, "bridge");
        let heard = |host: &&str| {
            let age_s = bridge.gauges.get(&format!("host_age_s {host}"));
            age_s.is_some_and(|age_s| *age_s < 2.5)
        };
        let all = HOSTS[..3].iter().all(heard);
        let lost = bridge.faults.iter().any(|fault| fault.code.starts_with("host_lost"));
        (all && !lost).then_some(())
    });
}

#[test]
fn a_desk_behind_two_routers_has_everything_whichever_is_lost() {
    if !is_nightly() {
        println!("skipped: TOG_NIGHTLY=1 runs it");
        return;
    }
    let lan = Lan::new(&HOSTS);
    let certificates = certificates_of(&HOSTS, &lan);
    let start = |host: &str| {
        let toml = site_file(&lan, &certificates, host);
        Setup::new(&toml).arguments(["--host", host]).on(&lan, host).start()
    };
    // Nobody answers the desk at first.
    let mut desk = start("desk");
    desk.wait_until("that no router answers", |report| {
        let bridge = find(report, "bridge");
        bridge.faults.iter().any(|fault| fault.code == "no_router").then_some(())
    });
    let (mut left, mut right, mut far) = (start("left"), start("right"), start("far"));
    far.wait_until_frames_flow(5);
    wait_until_all_are_heard(&mut desk);

    let toml = site_file(&lan, &certificates, "desk");
    let (mut at_home, mut afar) = (Eyes::open(&far, &toml), Eyes::open(&desk, &toml));
    look_at_both(&mut at_home, &mut afar, 10);

    // What it costs: the desk's link, whichever router it has chosen.
    let plan = plan(&desk);
    let planned = |key: &str| planned_bytes_per_s(&plan, key, "desk");
    if let (Some(before), begin) = (lan.bytes("desk"), Instant::now()) {
        for _ in 0..5 {
            look_at_both(&mut at_home, &mut afar, 10); // a second each
        }
        let (after, took_s) = (lan.bytes("desk").unwrap(), begin.elapsed().as_secs_f64());
        let per_s = |after: u64, before: u64| (after - before) as f64 / took_s;
        println!(
            "a desk behind routers: sends {:.0} B/s of {:.0} planned, receives {:.0} of {:.0}",
            per_s(after.0, before.0),
            planned("from"),
            per_s(after.1, before.1),
            planned("to")
        );
    }

    let told = Desk::open(&mut far);
    let mut random = Random::from_environment();
    for round in 0..5 {
        let mark = told.count();
        far.log().wait_a_moment(Duration::from_millis(random.below(300)));
        match round {
            0 => _ = left.kill("bridge", Signal::KILL),
            1 => lan.cut("left"),
            2 => lan.cut("right"),
            3 => _ = right.kill("bridge", Signal::KILL),
            _ => _ = desk.kill("bridge", Signal::KILL),
        }
        // Something happens while the desk finds its other way.
        let raised = told.hold_laser_until_told(&mut far, mark);
        told.release_laser(&mut far, &raised.change.id);
        assert_the_desk_has_all((&far, "far", "hall"), &desk);
        if round == 1 {
            lan.heal("left");
        }
        if round == 2 {
            lan.heal("right");
        }
        wait_until_all_are_heard(&mut desk);
    }
    look_at_both(&mut at_home, &mut afar, 10);
    assert_equal("frame", &at_home.seen_frames, &afar.seen_frames);
    assert_equal("class map", &at_home.seen_classes, &afar.seen_classes);
    let changes = assert_the_desk_has_all((&far, "far", "hall"), &desk);
    assert!(changes >= 10, "{changes}");
    for site in [&mut left, &mut right, &mut far, &mut desk] {
        let report = site.status().unwrap();
        let bridge = find(&report, "bridge");
        for never in [
            "messages_refused_unauthorised",
            "connections_refused_unauthorised",
            "messages_refused_misrouted",
        ] {
            assert_eq!(count(bridge, never), 0, "{never} between friends: {}", report.table());
        }
    }
    println!("{changes} changes through two routers, all at the desk once and in order");
    for mut site in [desk, far, right, left] {
        site.stop();
    }
}
