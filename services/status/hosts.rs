//! The hosts of a site as one of them knows them: `tog status --site`.

use protocol::health::Fault;
use protocol::site::{Area, Host, Site};
use serde::Serialize;
use serde_json::{Value, json};
use std::fmt::Write as _;
use supervisor::{ProcessState, ServiceStatus, StatusReport};

/// One host.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HostStatus {
    id: String,
    endpoint: String,
    /// True for the host that was asked.
    here: bool,
    /// Seconds since something came from it; none if nothing ever did.
    heard_s: Option<f64>,
    /// Seconds that its clock is ahead of the one here.
    clock_ahead_s: Option<f64>,
    /// Events of it that are not here yet, if this is a desk.
    events_behind: Option<f64>,
    /// Its processes that told how they are within the last seconds, and all of them.
    services_heard: Option<f64>,
    services: Option<f64>,
    /// The areas that run there.
    areas: Vec<String>,
    /// What is wrong there.
    faults: Vec<String>,
    /// True once the bridge here says that it is lost.
    #[serde(skip)]
    is_lost: bool,
}

impl HostStatus {
    fn is_heard(&self) -> bool {
        self.here || self.heard_s.is_some() && !self.is_lost
    }
}

/// All hosts, as the host `here` knows them; none for a site of one host.
pub fn hosts(site: &Site, report: &StatusReport, here: Option<&str>) -> Vec<HostStatus> {
    let bridge = report.services.iter().find(|service| service.name == "bridge");
    let gauge = |name: String| bridge.and_then(|bridge| bridge.gauges.get(&name).copied());
    let host = |host: &Host| {
        let (id, here) = (&host.id, here == Some(host.id.as_str()));
        let runs = |area: &&Area| {
            if !here {
                return gauge(format!("host_runs_area {id} {}", area.id)) == Some(1.0);
            }
            let name = format!("fusion {}", area.id);
            let service = report.services.iter().find(|service| service.name == name);
            service.is_some_and(|service| service.state != ProcessState::Standby)
        };
        let areas = site.areas_on(Some(id)).filter(runs).map(|area| area.id.clone()).collect();
        let of_host = || faults_of(bridge).filter(|(of, _)| of == id).map(|(_, fault)| fault);
        let (services_heard, services) = if here {
            let own = || report.services.iter().filter(|s| s.state != ProcessState::Standby);
            let running = own().filter(|service| service.pid.is_some()).count();
            (Some(running as f64), Some(own().count() as f64))
        } else {
            (gauge(format!("host_services_heard {id}")), gauge(format!("host_services {id}")))
        };
        HostStatus {
            id: id.clone(),
            endpoint: host.endpoint.clone(),
            here,
            heard_s: gauge(format!("host_age_s {id}")),
            clock_ahead_s: gauge(format!("clock_ahead_s {id}")),
            events_behind: gauge(format!("events_behind {id}")),
            services_heard,
            services,
            areas,
            is_lost: of_host().any(|fault| fault.code.starts_with("host_lost ")),
            faults: if here {
                own_faults(site, report)
            } else {
                of_host().map(|fault| fault.text.clone()).collect()
            },
        }
    };
    site.hosts.iter().map(host).collect()
}

/// What the bridge says of other hosts: `host_lost east` is of `east`.
fn faults_of(bridge: Option<&ServiceStatus>) -> impl Iterator<Item = (&str, &Fault)> {
    let faults = bridge.into_iter().flat_map(|bridge| &bridge.faults);
    faults.filter_map(|fault| Some((fault.code.split_once(' ')?.1, fault)))
}

/// What is wrong here; what the bridge says of other hosts stands with them.
fn own_faults(site: &Site, report: &StatusReport) -> Vec<String> {
    let of_others = |service: &ServiceStatus, fault: &Fault| {
        let of = fault.code.split_once(' ').map(|(_, of)| of);
        service.name == "bridge" && of.is_some_and(|of| site.host(of).is_some())
    };
    let faults = report.services.iter().flat_map(|service| {
        let own = service.faults.iter().filter(move |fault| !of_others(service, fault));
        own.map(move |fault| format!("{}: {}: {}", service.name, fault.code, fault.text))
    });
    faults.collect()
}

/// For people.
pub fn text(hosts: &[HostStatus]) -> String {
    if hosts.is_empty() {
        return "this site has one host: `tog status` without --site shows it\n".to_owned();
    }
    let lost = hosts.iter().filter(|host| !host.is_heard()).count();
    let mut text = match lost {
        0 => format!("{} hosts, all are heard\n", hosts.len()),
        lost => format!("{} hosts, {lost} not heard\n", hosts.len()),
    };
    let width = hosts.iter().map(|host| host.id.chars().count()).max().unwrap_or(0).max(4);
    // Writing to a String cannot fail.
    let _ = writeln!(
        text,
        "{:width$}  {:6} {:>8} {:>9} {:>9} {:>7}  areas",
        "host", "state", "heard", "clock", "services", "behind"
    );
    for host in hosts {
        let state = match (host.here, host.is_heard()) {
            (true, _) => "here",
            (false, true) => "heard",
            (false, false) => "lost",
        };
        let or_dash = |value: Option<String>| value.unwrap_or_else(|| "-".to_owned());
        let services = host.services_heard.zip(host.services);
        let _ = writeln!(
            text,
            "{:width$}  {state:6} {:>8} {:>9} {:>9} {:>7}  {}",
            host.id,
            or_dash(host.heard_s.map(|age_s| format!("{age_s:.1} s"))),
            or_dash(host.clock_ahead_s.map(|ahead_s| format!("{ahead_s:+.3} s"))),
            or_dash(services.map(|(heard, all)| format!("{heard}/{all}"))),
            or_dash(host.events_behind.map(|behind| format!("{behind}"))),
            if host.areas.is_empty() { "-".to_owned() } else { host.areas.join(", ") },
        );
        for fault in &host.faults {
            let _ = writeln!(text, "{:width$}  ! {fault}", "");
        }
    }
    text
}

/// For programs.
pub fn json(site: &Site, hosts: &[HostStatus]) -> Value {
    json!({ "site": site.name, "hosts": hosts })
}
