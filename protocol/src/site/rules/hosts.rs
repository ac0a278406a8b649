//! What must agree between hosts, areas and lasers.

use super::super::diagnostics::Finding;
use super::super::host::HOSTS_MAX;
use super::super::tree::Node;
use super::super::words::{did_you_mean, names, quoted};
use super::unique;

pub(super) fn check(
    root: &Node<'_>,
    areas: &[Node<'_>],
    lasers: &[Node<'_>],
    findings: &mut Vec<Finding>,
) {
    let hosts = root.list("host");
    if hosts.len() > HOSTS_MAX {
        return; // the schema says so
    }
    unique(&hosts, "id", "host", findings);
    unique(&hosts, "endpoint", "host", findings);
    let ids: Vec<&str> = hosts.iter().filter_map(|host| Some(host.text("id")?.0)).collect();
    if ids.len() < hosts.len() {
        return; // one lacks its id: the schema says so, and who it is nobody knows
    }
    for place in areas.iter().chain(lasers) {
        known(place, "host", &ids, findings);
    }
    if let Some(recorder) = root.get("recorder") {
        known(&recorder, "host", &ids, findings);
    }
    for area in areas {
        known(area, "standby", &ids, findings);
        another_standby(area, findings);
    }
    if hosts.is_empty() {
        return;
    }
    for host in &hosts {
        follows(host, areas, findings);
        through(host, &hosts, &ids, findings);
    }
    for place in areas.iter().chain(lasers) {
        not_at_a_client(place, &hosts, findings);
    }
    for area in areas.iter().filter(|area| area.get("host").is_none()) {
        let found = "an area without `host`";
        findings.push(
            Finding::error(area, found, format!("one of {}", names(ids.iter().copied())))
                .message(format!("nobody runs `{}`: it lacks `host`", area.path))
                .help("a site with `[[host]]` says of every area where it runs: add `host = `"),
        );
    }
    one_transport(&hosts, findings);
    if hosts.len() > 1 {
        not_with_several(&hosts, lasers, findings);
    }
}

/// A host that speaks TLS and one that does not cannot talk with each other.
fn one_transport(hosts: &[Node<'_>], findings: &mut Vec<Finding>) {
    // Of one that there is not the schema says so.
    let is_known = |text: &str| ["tls", "plain-tcp"].contains(&text);
    let all = hosts.iter().filter_map(|host| host.text("transport"));
    let mut transports = all.filter(|(transport, _)| is_known(transport));
    let Some((first, _)) = transports.next() else { return };
    if let Some((other, node)) = transports.find(|(transport, _)| *transport != first) {
        findings.push(
            Finding::error(&node, quoted(other), format!("{}, as the first host", quoted(first)))
                .message("all hosts of a site talk in one way")
                .help("write the same `transport` at every host"),
        );
    }
}

/// A host that is named is there.
fn known(place: &Node<'_>, key: &str, ids: &[&str], findings: &mut Vec<Finding>) {
    let Some((id, node)) = place.text(key).filter(|(id, _)| !ids.contains(id)) else { return };
    if ids.is_empty() {
        let help = "this file has no `[[host]]`: add one, or remove this line and everything runs on one \
                    host";
        findings
            .push(Finding::error(&node, quoted(id), "the id of a host of this file").help(help));
    } else {
        findings.push(unknown(&node, id, ("a host", "hosts"), ids));
    }
}

/// A name that nothing has; `what` is that of which it should be the name, one and several.
fn unknown(node: &Node<'_>, id: &str, what: (&str, &str), ids: &[&str]) -> Finding {
    let help = match did_you_mean(id, ids.iter().copied()) {
        Some(known) => format!("did you mean {known:?}?"),
        None => format!("{} of this file: {}", what.1, names(ids.iter().copied())),
    };
    Finding::error(node, quoted(id), format!("the id of {} of this file", what.0)).help(help)
}

/// What a host follows is an area of another host.
fn follows(host: &Node<'_>, areas: &[Node<'_>], findings: &mut Vec<Finding>) {
    let id = host.text("id").map_or("", |(id, _)| id);
    let area_ids: Vec<&str> = areas.iter().filter_map(|area| Some(area.text("id")?.0)).collect();
    for followed in host.list("follows") {
        let Some(name) = followed.value.as_str() else { continue }; // the schema says so
        let Some(area) =
            areas.iter().find(|area| area.text("id").is_some_and(|(id, _)| id == name))
        else {
            findings.push(unknown(&followed, name, ("an area", "areas"), &area_ids));
            continue;
        };
        if ["host", "standby"].iter().any(|key| area.text(key).is_some_and(|(host, _)| host == id))
        {
            findings.push(
                Finding::error(&followed, quoted(name), "an area of another host")
                    .message(format!("area {name} may run on {id} itself: its maps are there"))
                    .help("remove it from `follows`"),
            );
        }
    }
}

fn is_desk(host: &Node<'_>) -> bool {
    host.get("desk").and_then(|desk| desk.value.as_bool()).unwrap_or(false)
}

/// True if there is a host of this id, and it goes through others.
fn is_client(id: &str, hosts: &[Node<'_>]) -> bool {
    let named = hosts.iter().find(|host| host.text("id").is_some_and(|(own, _)| own == id));
    named.is_some_and(|host| !host.list("through").is_empty())
}

/// What a host is a client of is another host that is no client itself.
fn through(host: &Node<'_>, hosts: &[Node<'_>], ids: &[&str], findings: &mut Vec<Finding>) {
    let routers = host.list("through");
    let Some(first) = routers.first() else { return };
    let own = host.text("id").map_or("", |(id, _)| id);
    if !is_desk(host) {
        findings.push(
            Finding::error(first, "`through` at a host that is no desk", "`desk = true`")
                .message(format!("host {own} is reached through others, and looks at nothing"))
                .help("write `desk = true` at this host, or remove `through`"),
        );
    }
    for router in &routers {
        let Some(name) = router.value.as_str() else { continue }; // the schema says so
        if !ids.contains(&name) {
            findings.push(unknown(router, name, ("a host", "hosts"), ids));
            continue;
        }
        if name == own || is_client(name, hosts) {
            findings.push(
                Finding::error(router, quoted(name), "another host, without `through`")
                    .message(format!("host {own} cannot be reached through {name}"))
                    .help("name hosts that have a link to every other one"),
            );
        }
    }
    if let [only] = routers.as_slice() {
        findings.push(
            Finding::warning(only, "one host", "two hosts")
                .message(format!("if that is lost, desk {own} hears nothing any more"))
                .help("name a second one in `through`"),
        );
    }
}

/// Nothing runs at a host that others reach only through others.
fn not_at_a_client(place: &Node<'_>, hosts: &[Node<'_>], findings: &mut Vec<Finding>) {
    for key in ["host", "standby"] {
        let Some((id, node)) = place.text(key) else { continue };
        if is_client(id, hosts) {
            findings.push(
                Finding::error(&node, quoted(id), "a host without `through`")
                    .message(format!("host {id} only looks: areas and lasers run elsewhere"))
                    .help("name another host, or remove `through` at that one"),
            );
        }
    }
}

/// A host is no standby of its own.
fn another_standby(area: &Node<'_>, findings: &mut Vec<Finding>) {
    let (Some((host, _)), Some((standby, node))) = (area.text("host"), area.text("standby")) else {
        return;
    };
    if host == standby {
        findings.push(
            Finding::error(&node, quoted(standby), "another host than `host`")
                .message("an area is its own standby")
                .help("name another host, or remove `standby`"),
        );
    }
}

/// What works on one host only, so far.
fn not_with_several(hosts: &[Node<'_>], lasers: &[Node<'_>], findings: &mut Vec<Finding>) {
    let lossless = lasers.iter().find_map(|laser| {
        laser.get("source")?.text("pace").filter(|(pace, _)| *pace == "lossless")
    });
    if let Some((pace, node)) = lossless {
        let expected = "\"real_time\", or a number, where a site has several hosts";
        findings.push(
            Finding::error(&node, quoted(pace), expected)
                .help("lossless is as fast as the slowest reader, on one host: remove `[[host]]`"),
        );
    }
    if !hosts.iter().any(is_desk) {
        let found = "several hosts and no desk";
        findings.push(
            Finding::warning(&hosts[0], found, "`desk = true` at one host or more")
                .message("no host is a desk: every host keeps its events to itself")
                .help("write `desk = true` at the host where people look at the alerts"),
        );
    }
}
