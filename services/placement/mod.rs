//! Which host this is, and what a site of several hosts has where.

mod cost;

use crate::cli::Format;
pub use cost::Costs;
use cost::{Stream, pairs};
use jiff::Timestamp;
use process::Role;
use process::plan::Plan;
use protocol::site::{Area, Host, Remark, RemarkOf, Severity, Site, Source};
use serde_json::json;
use std::fmt::Write as _;
use std::io::Write as _;

fn ids(site: &Site) -> String {
    site.hosts.iter().map(|host| host.id.as_str()).collect::<Vec<_>>().join(", ")
}

fn known(site: &Site, host: &str) -> Result<String, String> {
    let none = || format!("--host {host}: the site {} has no `[[host]]`: leave it out", site.name);
    if site.hosts.is_empty() {
        return Err(none());
    }
    let unknown = || format!("--host {host}: the hosts of {} are {}", site.name, ids(site));
    site.host(host).map(|host| host.id.clone()).ok_or_else(unknown)
}

/// Which host of a site this machine is, unless `--host` says it: systemd's unit sets it.
const HOST_VARIABLE: &str = "TOG_HOST";

/// The host that `tog run` shall be; none for a site without hosts.
///
/// # Errors
/// A sentence if it is unknown, or if several could be meant.
pub fn host_to_run(site: &Site, asked: Option<&str>) -> Result<Option<String>, String> {
    host_of(site, asked, variable().as_deref())
}

/// Which host this machine is, as it says itself.
fn variable() -> Option<String> {
    std::env::var(HOST_VARIABLE).ok().filter(|host| !host.is_empty())
}

fn host_of(
    site: &Site,
    asked: Option<&str>,
    variable: Option<&str>,
) -> Result<Option<String>, String> {
    match (asked, site.hosts.as_slice()) {
        (Some(host), _) => known(site, host).map(Some),
        (None, []) => Ok(None),
        (None, _) if variable.is_some() => {
            let host = variable.unwrap_or_default();
            let unknown = || {
                format!(
                    "{HOST_VARIABLE}={host}: the hosts of {} are {}: set it in /etc/default/tog, or \
                     say --host",
                    site.name,
                    ids(site)
                )
            };
            site.host(host).map(|host| Some(host.id.clone())).ok_or_else(unknown)
        }
        (None, [only]) => Ok(Some(only.id.clone())),
        (None, _) => Err(format!(
            "the site {} has several hosts: say which of them this is with --host ({}), or \
             with the variable {HOST_VARIABLE}",
            site.name,
            ids(site)
        )),
    }
}

/// The host whose journal is wanted: the one that is asked for, else this one, else the first desk.
///
/// # Errors
/// A sentence if it is unknown.
pub fn host_to_ask<'s>(site: &'s Site, asked: Option<&str>) -> Result<Option<&'s str>, String> {
    host_to_ask_of(site, asked, variable().as_deref())
}

fn host_to_ask_of<'s>(
    site: &'s Site,
    asked: Option<&str>,
    variable: Option<&str>,
) -> Result<Option<&'s str>, String> {
    let first = || site.hosts.iter().find(|host| host.desk).or(site.hosts.first());
    let this = || variable.and_then(|id| site.host(id));
    match asked {
        None => Ok(this().or_else(first).map(|host| host.id.as_str())),
        Some(host) => {
            let id = known(site, host)?;
            Ok(site.host(&id).map(|host| host.id.as_str()))
        }
    }
}

/// When the recordings of a site begin, UNIX nanoseconds; none if nobody said so.
///
/// # Errors
/// A sentence if it is no time, or if several hosts would begin at different times.
pub fn replay_at_ns(site: &Site, asked: Option<&str>) -> Result<Option<u64>, String> {
    let replays = site.lasers.iter().any(|laser| matches!(laser.source, Source::Replay { .. }));
    let Some(text) = asked else {
        if site.has_bridges() && replays {
            return Err(
                "several hosts replay recordings in step only if all begin at one time: say \
                        it to each with --replay-at 2026-11-26T10:00:00Z"
                    .to_owned(),
            );
        }
        return Ok(None);
    };
    if !replays || process::domain::is_lossless(site) {
        return Err("--replay-at: no laser of the site replays in step with time".to_owned());
    }
    let time: Timestamp = text.parse().map_err(|error| {
        format!("--replay-at {text}: {error}; expected a time as 2026-11-26T10:00:00Z")
    })?;
    u64::try_from(time.as_nanosecond())
        .map(Some)
        .map_err(|_| format!("--replay-at {text}: a time before 1970 or after 2554"))
}

/// Says aloud, on stderr, that nothing between the hosts is encrypted.
pub fn warn_of_plain_tcp(site: &Site) {
    if site.has_bridges() && !site.uses_tls() {
        // Nobody may be there to read it any more.
        let _ = writeln!(
            std::io::stderr(),
            "tog: transport = \"plain-tcp\": what the hosts of {} say to each other is neither \
             encrypted nor authenticated. Use a network of their own, or transport = \"tls\": \
             `tog certs --help`",
            site.name
        );
    }
}

/// What does not fit, and what fits with nothing to spare.
pub fn remarks(site: &Site, costs: &Costs<'_>) -> Vec<Remark> {
    let (streams, mut remarks) = (costs.streams(), Vec::new());
    for (index, host) in site.hosts.iter().enumerate() {
        let mut remark = |key, severity, message: String, expected: String, help: &str| {
            let found = message.clone();
            let (of, help) = (RemarkOf::Host(index), help.to_owned());
            remarks.push(Remark { of, key, severity, message, found, expected, help });
        };
        let has = f64::from(host.cores);
        let busy = costs.cores(&streams, Some(&host.id), true);
        if busy > has / 2.0 {
            let severity = if busy > has { Severity::Error } else { Severity::Warning };
            let message = format!(
                "host {} would be busy with {busy:.1} of its {} cores, its standbys included",
                host.id, host.cores
            );
            let expected = "at most half, so that a bad moment costs nothing".to_owned();
            let help =
                "place some of its areas or lasers on another host; or say how many cores it has";
            remark("cores", severity, message, expected, help);
        }
        let each_way = [true, false].map(|sends| {
            let others = site.hosts.iter().filter(|other| other.id != host.id);
            let link = |other: &Host| match sends {
                true => costs.link_bytes_per_s(&streams, &host.id, &other.id),
                false => costs.link_bytes_per_s(&streams, &other.id, &host.id),
            };
            others.map(link).sum::<f64>()
        });
        let busiest_mbit_s = each_way[0].max(each_way[1]) * 8e-6;
        let has = f64::from(host.network_mbit_s);
        if busiest_mbit_s > has / 2.0 {
            let severity = if busiest_mbit_s > has { Severity::Error } else { Severity::Warning };
            let message = format!(
                "host {} would move {busiest_mbit_s:.1} Mbit/s over a network of {}",
                host.id, host.network_mbit_s
            );
            let expected = "at most half of it".to_owned();
            let help = "run areas where their lasers are, or say how fast the network is";
            remark("network_mbit_s", severity, message, expected, help);
        }
        let own = site.areas.iter().filter(|area| area.host.as_deref() == Some(&host.id));
        for area in own.filter(|area| area.standby.is_some()) {
            let mut lasers = site.lasers.iter().filter(|laser| laser.area == area.id);
            if lasers.all(|laser| site.host_of_laser(laser) == Some(&host.id)) {
                let message = format!(
                    "all lasers of area {} hang on {}: its standby would see nothing if that is lost",
                    area.id, host.id
                );
                let expected = "a laser of the area on another host".to_owned();
                remark("id", Severity::Warning, message, expected, "see `host` of a [[laser]]");
            }
        }
    }
    remarks
}

/// What `tog check` shows of a site with hosts.
pub fn plan(site: &Site, costs: &Costs<'_>, format: Format) -> String {
    let streams = costs.streams();
    match format {
        Format::Text => text(site, costs, &streams),
        Format::Json => json(site, costs, &streams),
    }
}

fn json(site: &Site, costs: &Costs<'_>, streams: &[Stream<'_>]) -> String {
    let host = |host: &Host| {
        let (plan, roles) = plan_of(site, host);
        json!({
            "id": host.id,
            "endpoint": host.endpoint,
            "transport": host.transport,
            "desk": host.desk,
            "follows": host.follows,
            "through": host.through,
            "cores": host.cores,
            "cores_busy": costs.cores(streams, Some(&host.id), false),
            "cores_busy_with_standbys": costs.cores(streams, Some(&host.id), true),
            "processes": roles.iter().map(Role::to_string).collect::<Vec<_>>(),
            "topics": plan.topics.iter().map(|topic| &topic.name).collect::<Vec<_>>(),
            "shared_memory_bytes_max": plan.bytes_max(),
        })
    };
    let stream = |stream: &Stream<'_>| {
        json!({
            "from": stream.from, "to": stream.to, "what": stream.what,
            "bytes_per_s": stream.bytes_per_s.round(),
        })
    };
    let link = |(from, to): (&Host, &Host)| {
        let bytes_per_s = costs.link_bytes_per_s(streams, &from.id, &to.id).round();
        json!({ "from": from.id, "to": to.id, "bytes_per_s": bytes_per_s })
    };
    let area = |area: &Area| json!({ "id": area.id, "host": area.host, "standby": area.standby });
    let report = json!({
        "site": site.name,
        "hosts": site.hosts.iter().map(host).collect::<Vec<_>>(),
        "areas": site.areas.iter().map(area).collect::<Vec<_>>(),
        "links": pairs(site).map(link).collect::<Vec<_>>(),
        "streams": streams.iter().map(stream).collect::<Vec<_>>(),
    });
    format!("{report:#}\n")
}

fn plan_of(site: &Site, host: &Host) -> (Plan, Vec<Role>) {
    (Plan::new(site, Some(&host.id)), Role::all(site, Some(&host.id)))
}

fn text(site: &Site, costs: &Costs<'_>, streams: &[Stream<'_>]) -> String {
    let mut text = format!("{}: right, on {} hosts\n", site.name, site.hosts.len());
    // Writing to a String cannot fail.
    for host in &site.hosts {
        let (plan, roles) = plan_of(site, host);
        let desk = match host.through.as_slice() {
            [] if host.desk => ", a desk".to_owned(),
            [] => String::new(),
            routers => format!(", a desk through {}", routers.join(" or ")),
        };
        let _ = writeln!(
            text,
            "host {}, {}{desk}: `tog run --host {}` would start {} processes, {:.1} MB of shared \
             memory in the worst case, about {:.0} % of a core:",
            host.id,
            host.endpoint,
            host.id,
            roles.len(),
            plan.bytes_max() as f64 / 1e6,
            100.0 * costs.cores(streams, Some(&host.id), false)
        );
        for role in roles {
            let _ = writeln!(text, "  {role}");
        }
    }
    for area in &site.areas {
        if let (Some(host), Some(standby)) = (&area.host, &area.standby) {
            let _ = writeln!(text, "area {}: on {host}; if that is lost, on {standby}", area.id);
        }
    }
    if site.has_bridges() {
        text.push_str("between the hosts, as long as nothing happens, kB/s on the wire:\n");
    }
    for (from, to) in pairs(site).map(|(from, to)| (from.id.as_str(), to.id.as_str())) {
        let kb_per_s = costs.link_bytes_per_s(streams, from, to) / 1e3;
        let _ = writeln!(text, "  {from} -> {to}: {kb_per_s:.1}");
        for stream in streams.iter().filter(|stream| (stream.from, stream.to) == (from, to)) {
            let _ = writeln!(text, "  {:>9.1}  {}", stream.bytes_per_s / 1e3, stream.what);
        }
    }
    text
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn site(hosts: &[&str]) -> Site {
        let hosts: Vec<_> = hosts
            .iter()
            .enumerate()
            .map(|(n, id)| json!({ "id": id, "endpoint": format!("10.0.0.{n}:1"), "transport": "tls" }))
            .collect();
        let value = json!({ "name": "s", "host": hosts, "area": [], "laser": [] });
        serde_json::from_value(value).unwrap()
    }

    #[test]
    fn the_journal_is_that_of_this_host_or_of_the_first_desk() {
        let mut site = site(&["edge", "desk"]);
        site.hosts[1].desk = true;
        let of = |asked, variable| host_to_ask_of(&site, asked, variable);
        assert_eq!(of(None, None), Ok(Some("desk")));
        assert_eq!(of(None, Some("edge")), Ok(Some("edge")));
        assert_eq!(of(Some("desk"), Some("edge")), Ok(Some("desk")));
        assert_eq!(of(None, Some("pc17")), Ok(Some("desk")), "no host of this site");
        of(Some("pc17"), None).unwrap_err();
    }

    #[test]
    fn what_a_desk_behind_others_hears_goes_through_the_first_of_them() {
        let mut site = site(&["left", "right", "far", "guard", "lobby"]);
        for desk in 3..5 {
            site.hosts[desk].desk = true;
            site.hosts[desk].through = vec!["left".to_owned(), "right".to_owned()];
        }
        let costs = Costs::of(&site, "/".as_ref());
        let links: Vec<_> = pairs(&site).map(|(a, b)| (a.id.as_str(), b.id.as_str())).collect();
        assert!(links.contains(&("left", "guard")) && links.contains(&("lobby", "left")));
        let not = |link: &(&str, &str)| !links.contains(link);
        assert!([("right", "guard"), ("far", "guard"), ("guard", "lobby")].iter().all(not));
        assert_eq!(links.len(), 3 * 2 + 2 * 2);
        let streams = costs.streams();
        let health = |from: &str, to: &str| {
            let of = |s: &&Stream<'_>| (s.from, s.to) == (from, to) && s.what.starts_with("health");
            streams.iter().filter(of).count()
        };
        assert_eq!(health("far", "left"), 1, "once, for it and for two desks");
        assert_eq!(health("left", "guard"), 4, "of all others, the desk lobby included");
        assert_eq!(health("guard", "left"), 1, "once, to all others");
        assert!(streams.iter().all(|stream| links.contains(&(stream.from, stream.to))));
    }

    #[test]
    fn the_host_is_what_is_asked_for_or_what_the_machine_says() {
        let (several, none) = (site(&["edge", "desk"]), site(&[]));
        let of = |site: &Site, asked, variable| host_of(site, asked, variable);
        assert_eq!(of(&several, Some("edge"), Some("desk")), Ok(Some("edge".to_owned())));
        assert_eq!(of(&several, None, Some("desk")), Ok(Some("desk".to_owned())));
        assert_eq!(of(&none, None, Some("desk")), Ok(None), "one host needs no name");
        let words = of(&several, None, Some("pc17")).unwrap_err();
        assert!(words.contains("TOG_HOST=pc17: the hosts of s are edge, desk"), "{words}");
        assert!(of(&several, None, None).unwrap_err().contains("--host (edge, desk)"));
    }
}
