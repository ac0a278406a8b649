//! Who may say what: the access control of a site whose hosts know each other by certificates.
//!
//! One table: [`said_by`], the keys under which a host publishes, answers and shows that it is alive.
//! Everything follows from it. A host may say what is its own, and ask for and listen to what is
//! another's; whatever is not in the table is refused, on its way out and on its way in. Pure.

use certificates::Identity;
use protocol::site::{Area, Host, Site};
use protocol::topic;
use serde_json::{Value, json};

/// Who `host` is by its certificate.
#[must_use]
pub fn identity(site: &Site, host: &Host) -> Identity {
    Identity::new(&site.name, &host.id, &host.endpoint).numbered(host.certificate_number)
}

/// The keys that are `host`'s own: what it alone may say.
#[must_use]
pub fn said_by(site: &Site, host: &str) -> Vec<String> {
    let crossing = site.lasers_that_cross();
    let of_host = crossing.filter(|(_, laser, _)| site.host_of_laser(laser) == Some(host));
    let scans = of_host.map(|(_, laser, _)| topic::scan_key(&site.name, host, &laser.id));
    let events = [topic::live_key(&site.name, host), topic::log_key(&site.name, host)];
    let always = [topic::health_key(&site.name, host)].into_iter().chain(events);
    let maps = site.areas_on(Some(host)).flat_map(|area| {
        [topic::frame_key, topic::classes_key, topic::collapsed_key]
            .map(|key| key(&site.name, host, &area.id))
    });
    scans.chain(always).chain(maps).chain(said_of_areas(site, host)).collect()
}

/// What comes over the link to `host`: what it says, and what its clients say. A router is believed what
/// it says of the desks behind it, as they believe it what it says of everybody.
fn said_through(site: &Site, host: &Host, me: &Host) -> Vec<String> {
    if me.through.contains(&host.id) {
        let others = site.hosts.iter().filter(|other| other.id != me.id);
        return others.flat_map(|other| said_by(site, &other.id)).collect();
    }
    let clients = site.clients_of(&host.id).filter(|client| client.id != me.id);
    let ids = [host].into_iter().chain(clients).map(|host| said_by(site, &host.id));
    ids.flatten().collect()
}

/// What two hosts that may run an area say to each other.
fn said_of_areas(site: &Site, host: &str) -> Vec<String> {
    let shared = |area: &&Area| area.standby.is_some() && area.may_run_on(Some(host));
    let areas = site.areas.iter().filter(shared);
    let replicas = areas.map(|area| topic::replica_key(&site.name, host, &area.id));
    let mut keys: Vec<String> = replicas.collect();
    if !keys.is_empty() {
        keys.extend([topic::alive_key(&site.name, host), topic::claim_key(&site.name, host)]);
    }
    keys
}

/// What who says something needs; `delete` is not among them, nobody deletes.
const SAYS: [&str; 4] = ["put", "reply", "declare_queryable", "liveliness_token"];
/// What who asks or listens needs.
const ASKS: [&str; 4] =
    ["query", "declare_subscriber", "liveliness_query", "declare_liveliness_subscriber"];

/// The configuration of zenoh's access control for the session of host `me`: default deny; for every
/// other host, known by the common name of its certificate, what it may say to us and what we say to it.
#[must_use]
pub fn control(site: &Site, me: &Host) -> Value {
    let (mut rules, mut subjects, mut policies) = (Vec::new(), Vec::new(), Vec::new());
    for other in site.hosts.iter().filter(|host| me.has_link_to(host)) {
        let (own, theirs) = (said_through(site, me, other), said_through(site, other, me));
        let parts = [
            ("says", &SAYS, "ingress", &theirs),
            ("asks", &ASKS, "ingress", &own),
            ("is-told", &SAYS, "egress", &own),
            ("is-asked", &ASKS, "egress", &theirs),
        ];
        let id = |part: &str| format!("{}-{part}", other.id);
        for (part, messages, flow, keys) in parts {
            rules.push(json!({
                "id": id(part), "permission": "allow", "flows": [flow],
                "messages": messages, "key_exprs": keys,
            }));
        }
        subjects.push(json!({
            "id": other.id, "cert_common_names": [identity(site, other).common_name()],
        }));
        let named: Vec<_> = parts.iter().map(|(part, ..)| id(part)).collect();
        policies.push(json!({ "rules": named, "subjects": [other.id] }));
    }
    json!({
        "enabled": true, "default_permission": "deny",
        "rules": rules, "subjects": subjects, "policies": policies,
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn site() -> Site {
        let text = r#"
            name = "lab"
            [[host]]
            id = "edge"
            endpoint = "10.0.0.1:7447"
            transport = "tls"
            [[host]]
            id = "desk"
            endpoint = "10.0.0.2:7447"
            transport = "tls"
            desk = true
            [[area]]
            id = "hall"
            host = "desk"
            origin_m = [0.0, 0.0]
            columns = 10
            rows = 10
            [[laser]]
            id = "north"
            host = "edge"
            area = "hall"
            x_m = 0.5
            y_m = 0.5
            source = { kind = "simulator", scene = "none" }
            [[laser]]
            id = "south"
            area = "hall"
            x_m = 0.5
            y_m = 0.5
            source = { kind = "simulator", scene = "none" }
        "#;
        Site::parse(text, "lab.toml").unwrap_or_else(|errors| panic!("{errors}"))
    }

    #[test]
    fn a_host_says_what_is_its_own_and_nothing_else() {
        let site = site();
        let edge = [
            "tog/lab/edge/scan/north",
            "tog/lab/edge/health",
            "tog/lab/edge/event/live",
            "tog/lab/edge/event/log",
        ];
        assert_eq!(said_by(&site, "edge"), edge);
        let desk = said_by(&site, "desk");
        assert!(!desk.iter().any(|key| key.contains("scan")), "the scans of `south` stay there");
        assert!(edge.iter().all(|key| !desk.contains(&(*key).to_owned())));
    }

    #[test]
    fn a_router_speaks_for_the_desks_behind_it_and_these_only_for_themselves() {
        let mut site = site();
        let desk = |id: &str, through: &[&str]| Host {
            id: id.to_owned(),
            through: through.iter().map(|id| (*id).to_owned()).collect(),
            ..site.hosts[1].clone()
        };
        let (guard, lobby) = (desk("guard", &["edge"]), desk("lobby", &["edge"]));
        site.hosts.extend([guard, lobby]);
        let rules = |me: usize| control(&site, &site.hosts[me])["rules"].clone();
        let keys = |rules: &Value, id: &str| {
            let rule = rules.as_array().unwrap().iter().find(|rule| rule["id"] == id);
            rule.map(|rule| rule["key_exprs"].clone())
        };
        let said = |hosts: &[&str]| -> Value {
            hosts.iter().flat_map(|host| said_by(&site, host)).collect::<Vec<_>>().into()
        };
        let (of_router, of_peer, of_client) = (rules(0), rules(1), rules(2));
        // What a client says is its own, whoever it is said to; it may ask for what all others say.
        assert_eq!(keys(&of_router, "guard-says"), Some(said(&["guard"])));
        assert_eq!(keys(&of_router, "guard-asks"), Some(said(&["edge", "desk", "lobby"])));
        // A peer hears of the clients from their router, and has no link to them.
        assert_eq!(keys(&of_peer, "edge-says"), Some(said(&["edge", "guard", "lobby"])));
        assert_eq!(keys(&of_peer, "guard-says"), None);
        assert_eq!(keys(&of_router, "desk-says"), Some(said(&["desk"])), "no router: for itself");
        assert_eq!(keys(&of_client, "edge-says"), Some(said(&["edge", "desk", "lobby"])));
        assert_eq!(keys(&of_client, "desk-says"), None);
    }

    #[test]
    fn every_rule_names_its_keys_and_a_subject_its_certificate() {
        let site = site();
        let control = control(&site, &site.hosts[1]);
        assert_eq!(
            (control["default_permission"].as_str(), control["enabled"].as_bool()),
            (Some("deny"), Some(true))
        );
        assert_eq!(control["subjects"][0]["cert_common_names"], json!(["edge.lab"]));
        let mut stolen = site.clone();
        stolen.hosts[0].certificate_number = 2;
        let after = self::control(&stolen, &stolen.hosts[1]);
        assert_eq!(after["subjects"][0]["cert_common_names"], json!(["edge.2.lab"]));
        let rules = control["rules"].as_array().unwrap();
        let rule = |id: &str| rules.iter().find(|rule| rule["id"] == id).unwrap();
        assert_eq!(rule("edge-says")["key_exprs"], json!(said_by(&site, "edge")));
        assert_eq!(rule("edge-says")["flows"], json!(["ingress"]));
        assert_eq!(rule("edge-asks")["key_exprs"], json!(said_by(&site, "desk")));
        for rule in rules {
            for key in rule["key_exprs"].as_array().unwrap() {
                assert!(!key.as_str().unwrap().contains('*'), "{rule}");
            }
        }
    }
}
