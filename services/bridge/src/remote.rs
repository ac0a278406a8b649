//! What is known of the other hosts: who was heard when, and what is wrong there.
//!
//! Pure: the time is an argument (CLOCK_MONOTONIC, nanoseconds).

use crate::agreement::GAUGE;
use crate::clock_difference::ClockDifference;
use protocol::health::{Health, ServiceState};
use protocol::time::SECOND_NS;
use std::collections::{BTreeMap, BTreeSet};

/// A host of which nothing was heard for so long is lost: each of its processes speaks once a second,
/// and a cut link is noticed after 2 s.
pub const LOST_NS: u64 = 5 * SECOND_NS;
/// A process of a host that is heard, but of which nothing was heard for so long, is silent.
pub const SILENT_NS: u64 = 15 * SECOND_NS;
/// Most characters of what is wrong with one process.
const WORDS_MAX: usize = 120;

#[derive(Debug)]
struct Service {
    health: Health,
    heard_ns: u64,
}

/// One other host.
#[derive(Debug)]
pub struct RemoteHost {
    id: String,
    /// The processes that the site file places there.
    names: BTreeSet<String>,
    services: BTreeMap<String, Service>,
    start_ns: u64,
    heard_ns: Option<u64>,
    refused: u64,
    /// How far its clock is from ours.
    pub clock: ClockDifference,
}

impl RemoteHost {
    /// A host of which nothing was heard yet.
    #[must_use]
    pub fn new(id: &str, names: BTreeSet<String>, mono_ns: u64) -> Self {
        Self {
            id: id.to_owned(),
            names,
            services: BTreeMap::new(),
            start_ns: mono_ns,
            heard_ns: None,
            refused: 0,
            clock: ClockDifference::default(),
        }
    }

    /// Its name.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.id
    }

    /// Something came from there; true if it was lost, or never heard.
    pub fn heard(&mut self, mono_ns: u64) -> bool {
        let before_ns = self.heard_ns.replace(mono_ns);
        before_ns.is_none_or(|before_ns| mono_ns.saturating_sub(before_ns) >= LOST_NS)
    }

    /// A process of it told how it is. One that the site file does not place there is refused.
    pub fn health(&mut self, health: Health, mono_ns: u64) {
        if self.names.contains(&health.service) {
            let name = health.service.clone();
            self.services.insert(name, Service { health, heard_ns: mono_ns });
        } else {
            self.refused += 1;
        }
    }

    /// An area does not run there: what its services said last is of no interest any more.
    pub fn left(&mut self, area: &str) {
        self.services.retain(|name, _| area_of(name) != Some(area));
    }

    /// Why its site file is another one than ours, of this fingerprint, if it is.
    #[must_use]
    pub fn differs(&self, fingerprint: u32) -> Option<String> {
        let bridge = &self.services.get("bridge")?.health;
        let theirs = *bridge.gauges.get(GAUGE)?;
        (theirs != f64::from(fingerprint)).then(|| {
            format!(
                "host {0} runs with another site file: hosts, certificate numbers, areas or lasers are \
                 not the same there. Copy the right one to all hosts, and restart those that began with \
                 another one",
                self.id
            )
        })
    }

    /// Messages of health that were refused.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Seconds since something came from there; none if nothing ever did.
    #[must_use]
    pub fn age_s(&self, mono_ns: u64) -> Option<f64> {
        self.heard_ns.map(|heard_ns| mono_ns.saturating_sub(heard_ns) as f64 / 1e9)
    }

    /// How many processes it has, those of areas that run elsewhere excepted; and of how many something
    /// was heard lately.
    #[must_use]
    pub fn services(&self, mono_ns: u64) -> (usize, usize) {
        let runs_elsewhere = |name: &str| {
            let fusion = area_of(name).map(|area| format!("fusion {area}"));
            fusion.is_some_and(|fusion| !self.services.contains_key(&fusion))
        };
        let all = self.names.iter().filter(|name| !runs_elsewhere(name));
        (all.count(), self.services.keys().filter(|name| self.hears(name, mono_ns)).count())
    }

    /// True if the process told lately how it is.
    #[must_use]
    pub fn hears(&self, name: &str, mono_ns: u64) -> bool {
        let lately = |service: &Service| mono_ns.saturating_sub(service.heard_ns) < LOST_NS;
        self.services.get(name).is_some_and(lately)
    }

    /// Why the host is lost, if it is.
    #[must_use]
    pub fn lost(&self, mono_ns: u64, endpoint: &str, uses_tls: bool) -> Option<String> {
        let since_ns = mono_ns.saturating_sub(self.heard_ns.unwrap_or(self.start_ns));
        (since_ns >= LOST_NS).then(|| {
            let seconds = since_ns / SECOND_NS;
            let id = &self.id;
            let since = if self.heard_ns.is_some() { "for" } else { "yet, after" };
            let believed = if uses_tls {
                ", and do both believe the certificate of the other (`unauthorised` here or there)"
            } else {
                ""
            };
            format!(
                "nothing is heard of host {id} {since} {seconds} s: is `tog run --host {id}` \
                 running there, can it be reached at {endpoint}{believed}?"
            )
        })
    }

    /// What is wrong with the processes there, if anything is.
    #[must_use]
    pub fn unwell(&self, mono_ns: u64) -> Option<String> {
        let mut words = Vec::new();
        for (name, service) in &self.services {
            let age_ns = mono_ns.saturating_sub(service.heard_ns);
            if age_ns >= SILENT_NS {
                words.push(format!("{name} says nothing for {} s", age_ns / SECOND_NS));
            } else if service.health.state == ServiceState::Degraded {
                let faults = service.health.faults.iter();
                let faults: Vec<String> =
                    faults.map(|f| shortened(&format!("{}: {}", f.code, f.text))).collect();
                words.push(format!("{name}: {}", faults.join("; ")));
            }
        }
        (!words.is_empty()).then(|| format!("on host {}: {}", self.id, words.join(" | ")))
    }
}

/// The area that a process serves; none of a laser, which stays where it is, and of others.
fn area_of(name: &str) -> Option<&str> {
    name.split_once(' ').filter(|(role, _)| *role != "laser").map(|(_, area)| area)
}

fn shortened(text: &str) -> String {
    let clean = |c: char| if c.is_control() { ' ' } else { c };
    let short: String = text.chars().take(WORDS_MAX).map(clean).collect();
    if short.chars().count() < text.chars().count() { short + "..." } else { short }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use protocol::health::Fault;

    fn host() -> RemoteHost {
        let names = ["laser north", "bridge"].map(str::to_owned);
        RemoteHost::new("edge", BTreeSet::from(names), 100)
    }

    fn health(service: &str, state: ServiceState) -> Health {
        Health { service: service.to_owned(), state, ..Health::default() }
    }

    #[test]
    fn a_host_is_lost_when_nothing_is_heard_of_it_and_found_when_something_is() {
        let mut edge = host();
        assert_eq!(edge.lost(100 + LOST_NS - 1, "a:1", false), None, "it may still be starting");
        let text = edge.lost(100 + LOST_NS, "a:1", false).unwrap();
        assert!(text.starts_with("nothing is heard of host edge yet, after 5 s"), "{text}");
        assert!(edge.heard(100 + LOST_NS), "for the first time");
        assert!(!edge.heard(100 + LOST_NS), "again");
        assert_eq!(edge.lost(100 + 2 * LOST_NS - 1, "a:1", false), None);
        let text = edge.lost(100 + 2 * LOST_NS, "a:1", true).unwrap();
        assert!(text.contains("edge for 5 s") && text.contains("the certificate"), "{text}");
        assert_eq!(edge.age_s(100 + LOST_NS + SECOND_NS), Some(1.0));
    }

    #[test]
    fn what_is_wrong_there_is_told_with_who_and_what() {
        let mut edge = host();
        edge.health(health("bridge", ServiceState::Running), 100);
        assert_eq!(edge.unwell(200), None);
        let mut north = health("laser north", ServiceState::Degraded);
        let text = "the clock\u{1b} was set back ".to_owned() + &"x".repeat(500);
        north.faults.push(Fault { code: "clock_stepped_back".to_owned(), text, since_ns: 1 });
        edge.health(north, 100);
        let text = edge.unwell(200).unwrap();
        assert!(text.starts_with("on host edge: laser north: clock_stepped_back: the clock  was"));
        assert!(text.ends_with("...") && text.len() < 200, "{text}");
        let text = edge.unwell(100 + SILENT_NS).unwrap();
        assert!(text.contains("bridge says nothing for 15 s"), "{text}");
    }

    #[test]
    fn processes_of_an_area_are_expected_where_it_runs() {
        let names = ["bridge", "laser north", "fusion hall", "mapper hall"].map(str::to_owned);
        let mut edge = RemoteHost::new("edge", BTreeSet::from(names), 0);
        assert_eq!(edge.services(1), (2, 0), "the area may be elsewhere");
        for name in ["bridge", "fusion hall", "mapper hall"] {
            edge.health(health(name, ServiceState::Running), 1);
        }
        assert_eq!(edge.services(2), (4, 3));
        assert_eq!(edge.services(1 + LOST_NS), (4, 0));
        edge.left("hall");
        assert_eq!(edge.services(2), (2, 1));
    }

    #[test]
    fn a_process_that_does_not_live_there_is_refused() {
        let mut edge = host();
        edge.health(health("fusion hall", ServiceState::Degraded), 100);
        assert_eq!((edge.refused(), edge.unwell(200)), (1, None));
    }
}
