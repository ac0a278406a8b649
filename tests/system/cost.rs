//! What crosses a network, against what `tog check` says of it: areas of one, two and four lasers, which
//! another host follows, or is the standby of.

use super::lan::{certificates_of, head, plan, planned_bytes_per_s};
use harness::{Lan, Setup, Site, count, find, is_nightly};
use std::fmt::Write as _;
use std::time::{Duration, Instant};

/// Each of the first three runs an area with so many lasers.
const HOSTS: [&str; 4] = ["one", "two", "four", "desk"];
const LASERS: [usize; 3] = [1, 2, 4];

/// What the desk has of the areas of the others.
#[derive(Clone, Copy, PartialEq)]
enum Desk {
    /// Events and health, as every desk.
    Listens,
    Follows,
    StandsBy,
}

/// Windows of a minute as they are by default, unless the run is a short one.
fn areas(desk: Desk) -> String {
    let mut toml = String::new();
    let places = [[4.6, 0.2, 90.0], [5.2, 8.8, -90.0], [0.2, 4.4, 0.0], [9.8, 4.6, 180.0]];
    for (host, lasers) in HOSTS.into_iter().zip(LASERS) {
        let standby = if desk == Desk::StandsBy { "standby = \"desk\"\n" } else { "" };
        let short = if is_nightly() { "" } else { "timescales_s = [1, 2, 4]\ncheckpoint_s = 1\n" };
        let _ = write!(
            toml,
            "[[area]]\nid = \"{host}\"\nhost = \"{host}\"\n{standby}origin_m = [-0.5, -0.5]\n\
             columns = 110\nrows = 100\n{short}\n"
        );
        for (n, [x_m, y_m, yaw_deg]) in places.into_iter().take(lasers).enumerate() {
            let _ = write!(
                toml,
                "[[laser]]\nid = \"{host}-{n}\"\nhost = \"{host}\"\narea = \"{host}\"\nx_m = {x_m}\n\
                 y_m = {y_m}\nyaw_deg = {yaw_deg}\n\
                 source = {{ kind = \"simulator\", scene = \"room\", seed = 1 }}\n\n"
            );
        }
    }
    toml
}

/// The bytes that each of the three sends, measured and planned, a second.
fn what_crosses(desk: Desk) -> Option<[[f64; 2]; 3]> {
    let lan = Lan::new(&HOSTS);
    lan.bytes("desk")?;
    let certificates = certificates_of(&HOSTS, &lan);
    let more: fn(&str) -> &str = match desk {
        Desk::Follows => |host| match host {
            "desk" => "desk = true\nfollows = [\"one\", \"two\", \"four\"]\n",
            _ => "",
        },
        Desk::Listens | Desk::StandsBy => |host| if host == "desk" { "desk = true\n" } else { "" },
    };
    let mut sites = HOSTS.map(|host| {
        let toml = head(&HOSTS, &lan, host, ("tls", &certificates), more) + &areas(desk);
        Setup::new(&toml).arguments(["--host", host]).on(&lan, host).start()
    });
    let plan = plan(&sites[3]);
    // Maps grow until their windows are full.
    let (fill_s, look_s) = if is_nightly() { (90, 120) } else { (5, 10) };
    let frames = |site: &mut Site, seconds: u64| {
        let wanted = 10 * seconds;
        site.wait_until_within(
            "frames",
            Duration::from_secs(3 * seconds) + harness::WATCHDOG,
            |report| (count(find(report, "fusion one"), "frames_out") >= wanted).then_some(()),
        );
    };
    frames(&mut sites[0], fill_s);
    let sent = || [0, 1, 2].map(|n: usize| lan.bytes(HOSTS[n]).map_or(0, |bytes| bytes.0));
    let (begin, before) = (Instant::now(), sent());
    frames(&mut sites[0], fill_s + look_s);
    let (after, took_s) = (sent(), begin.elapsed().as_secs_f64());
    for site in &mut sites {
        site.stop();
    }
    Some([0, 1, 2].map(|n: usize| {
        let sent = (after[n] - before[n]) as f64 / took_s;
        [sent, planned_bytes_per_s(&plan, "from", HOSTS[n])]
    }))
}

fn is_as_planned(what: &str, desk: Desk) {
    let Some(measured) = what_crosses(desk) else {
        return println!("skipped: on loopback nobody counts bytes");
    };
    for (lasers, [sent, planned]) in LASERS.into_iter().zip(measured) {
        println!("{what} of {lasers} lasers: sends {sent:.0} B/s of {planned:.0} planned");
    }
    let ratios = measured.map(|[sent, planned]| sent / planned);
    // Within seconds it counts who happens to walk where, and windows of seconds are hardly counted.
    let (least, most) = if is_nightly() { (0.8, 1.2) } else { (0.5, 1.5) };
    assert!(ratios.iter().all(|ratio| (least..most).contains(ratio)), "{what}: {ratios:.2?}");
}

#[test]
fn events_and_health_cost_what_is_planned() {
    is_as_planned("an area", Desk::Listens);
}

#[test]
fn frames_and_class_maps_cost_what_is_planned() {
    is_as_planned("an area that is followed", Desk::Follows);
}

#[test]
fn copies_to_a_standby_cost_what_is_planned() {
    is_as_planned("an area with a standby", Desk::StandsBy);
}
