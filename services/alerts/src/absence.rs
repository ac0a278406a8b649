//! Hosts that are not heard of any more: when that is something to call a guard for, and in which words.
//!
//! The bridge of this host says `host_lost` after 5 s. A person is told later: whoever installs a new
//! version restarts a host, and nobody wants to be called for that. Pure: time is an argument
//! (CLOCK_MONOTONIC, nanoseconds).

use protocol::event::EventChange;
use protocol::health::Health;
use protocol::site::Site;
use protocol::time::SECOND_NS;
use std::collections::{BTreeMap, BTreeSet};

/// After the fault a host may be back within this time: then nobody is called.
const PATIENCE_NS: u64 = 10 * SECOND_NS;
/// A host that was never heard of may be switched on later than this one.
const START_PATIENCE_NS: u64 = 55 * SECOND_NS;
/// A host of which something came so lately is there, seconds.
const HEARD_S: f64 = 5.0;
const FAULT: &str = "host_lost ";
/// So many events are named; a text has its limit.
const NAMED_MAX: usize = 8;

/// What people are to be told of a host.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tiding {
    /// The host's id.
    pub host: String,
    /// Why it is missed; none if it is heard of again.
    pub missed: Option<String>,
}

/// Who is missed.
#[derive(Debug, Default)]
pub struct Absences {
    told: BTreeSet<String>,
    since_ns: BTreeMap<String, u64>,
}

impl Absences {
    /// Goes on from those that people were told of and that were not heard of since.
    #[must_use]
    pub fn new(told: BTreeSet<String>) -> Self {
        Self { told, since_ns: BTreeMap::new() }
    }

    /// Looks at what the bridge of this host says of itself; what there is to tell.
    pub fn observe(&mut self, bridge: &Health, mono_ns: u64) -> Vec<Tiding> {
        let lost = |fault: &protocol::health::Fault| {
            fault.code.strip_prefix(FAULT).map(|host| (host.to_owned(), fault.text.clone()))
        };
        let lost: BTreeMap<String, String> = bridge.faults.iter().filter_map(lost).collect();
        let age_s = |host: &str| bridge.gauges.get(&format!("host_age_s {host}"));
        self.since_ns.retain(|host, _| lost.contains_key(host));
        let mut tidings = Vec::new();
        for (host, text) in lost {
            let since_ns = *self.since_ns.entry(host.clone()).or_insert(mono_ns);
            let was_heard = age_s(&host).is_some();
            let patience_ns = if was_heard { PATIENCE_NS } else { START_PATIENCE_NS };
            let is_due = mono_ns.saturating_sub(since_ns) >= patience_ns;
            if is_due && self.told.insert(host.clone()) {
                tidings.push(Tiding { host, missed: Some(text) });
            }
        }
        let is_back = |host: &String| {
            let is_heard = age_s(host).is_some_and(|age_s| *age_s < HEARD_S);
            is_heard && !self.since_ns.contains_key(host)
        };
        let back: Vec<String> = self.told.iter().filter(|host| is_back(host)).cloned().collect();
        for host in back {
            self.told.remove(&host);
            tidings.push(Tiding { host, missed: None });
        }
        tidings
    }
}

/// What a person is told of a host that is missed: why, what that means, what it left open.
#[must_use]
pub fn words(missed: String, site: &Site, host: &str, open: &[EventChange]) -> String {
    let consequences = consequences(site, host);
    let means = match consequences.as_str() {
        "" => String::new(),
        consequences => format!("By the site file: {consequences}"),
    };
    let mut text = missed;
    for sentence in [means, left_open(open)].into_iter().filter(|sentence| !sentence.is_empty()) {
        text += if text.ends_with('?') { " " } else { ". " };
        text += &sentence;
    }
    text
}

/// What it means that a host is gone, by the site file.
fn consequences(site: &Site, host: &str) -> String {
    let mut words = Vec::new();
    for area in site.areas.iter().filter(|area| area.host.as_deref() == Some(host)) {
        let id = &area.id;
        words.push(match &area.standby {
            Some(standby) => format!("area {id} goes on at host {standby}, if that one is there"),
            None => format!("area {id} is watched by nobody meanwhile"),
        });
    }
    let lasers = site.lasers.iter().filter(|laser| laser.host.as_deref() == Some(host));
    let elsewhere = lasers.filter(|laser| {
        let area = site.areas.iter().find(|area| area.id == laser.area);
        area.is_some_and(|area| area.host.as_deref() != Some(host))
    });
    let elsewhere: Vec<&str> = elsewhere.map(|laser| laser.id.as_str()).collect();
    if !elsewhere.is_empty() {
        words.push(format!("areas elsewhere lack its lasers {}", elsewhere.join(", ")));
    }
    words.join("; ")
}

/// Whose events a host tells: those of its areas, and of those for which it stands by.
#[must_use]
pub fn origins(site: &Site, host: &str) -> Vec<String> {
    let areas = site.areas.iter().filter(|area| area.may_run_on(Some(host)));
    areas.map(|area| area.origin_on(Some(host))).collect()
}

/// What a host left open when it went: nobody follows it, so that it may be over long since.
fn left_open(open: &[EventChange]) -> String {
    if open.is_empty() {
        return String::new();
    }
    let name = |change: &EventChange| format!("{} ({})", change.id, change.kind.words());
    let mut names: Vec<String> = open.iter().take(NAMED_MAX).map(name).collect();
    if let Some(more) = open.len().checked_sub(NAMED_MAX).filter(|more| *more > 0) {
        names.push(format!("{more} more"));
    }
    format!("What it told as open is followed by nobody until it is back: {}", names.join(", "))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::testing::change;
    use protocol::health::Fault;

    fn bridge(lost: bool, age_s: Option<f64>) -> Health {
        let fault = Fault {
            code: "host_lost edge".to_owned(),
            text: "nothing is heard of host edge".to_owned(),
            since_ns: 1,
        };
        let gauges = age_s.map(|age_s| ("host_age_s edge".to_owned(), age_s));
        Health {
            service: "bridge".to_owned(),
            faults: lost.then_some(fault).into_iter().collect(),
            gauges: gauges.into_iter().collect(),
            ..Health::default()
        }
    }

    #[test]
    fn a_host_that_is_gone_for_long_is_told_once_and_its_return_too() {
        let mut absences = Absences::default();
        let mut observe = |lost, age_s, mono_ns| absences.observe(&bridge(lost, age_s), mono_ns);
        assert_eq!(observe(false, Some(0.1), 1), []);
        assert_eq!(observe(true, Some(5.1), 2), []);
        assert_eq!(observe(false, Some(0.1), PATIENCE_NS), [], "it was restarted");
        assert_eq!(observe(true, Some(5.1), PATIENCE_NS), []);
        let told = observe(true, Some(15.1), 2 * PATIENCE_NS);
        assert_eq!(
            (told.len(), told[0].host.as_str(), told[0].missed.is_some()),
            (1, "edge", true)
        );
        assert_eq!(observe(true, Some(16.1), 3 * PATIENCE_NS), []);
        assert_eq!(observe(false, None, 3 * PATIENCE_NS), [], "the bridge itself begins anew");
        let back = Tiding { host: "edge".to_owned(), missed: None };
        assert_eq!(observe(false, Some(0.4), 3 * PATIENCE_NS), [back]);
        assert_eq!(observe(false, Some(0.4), 4 * PATIENCE_NS), []);
    }

    #[test]
    fn what_a_lost_host_left_open_is_named() {
        let area = |id: &str, host: &str, standby: Option<&str>| {
            serde_json::json!({
                "id": id, "host": host, "standby": standby, "origin_m": [0.0, 0.0], "columns": 1, "rows": 1,
            })
        };
        let site: Site = serde_json::from_value(serde_json::json!({
            "name": "s",
            "area": [
                area("hall", "edge", Some("desk")),
                area("yard", "desk", Some("edge")),
                area("shop", "desk", None),
            ],
            "laser": [],
        }))
        .unwrap();
        assert_eq!(origins(&site, "edge"), ["hall", "yard@edge"]);
        assert_eq!(left_open(&[]), "");
        let open: Vec<_> = (1..=NAMED_MAX as u64 + 2).map(|n| change("hall", n)).collect();
        let words = left_open(&open);
        assert!(words.contains(&format!(" {} (", open[0].id)), "{words}");
        assert!(words.ends_with(", 2 more"), "{words}");
    }

    #[test]
    fn whoever_was_never_heard_of_is_given_time_and_what_was_told_is_not_told_again() {
        let mut absences = Absences::default();
        assert_eq!(absences.observe(&bridge(true, None), 1), []);
        assert_eq!(absences.observe(&bridge(true, None), 2 * PATIENCE_NS), []);
        assert_eq!(absences.observe(&bridge(true, None), 1 + START_PATIENCE_NS).len(), 1);
        let mut absences = Absences::new(BTreeSet::from(["edge".to_owned()]));
        assert_eq!(absences.observe(&bridge(true, None), 1), []);
        assert_eq!(absences.observe(&bridge(true, None), 9 * START_PATIENCE_NS), []);
        assert_eq!(absences.observe(&bridge(false, Some(0.1)), 1).len(), 1, "it is back");
    }
}
