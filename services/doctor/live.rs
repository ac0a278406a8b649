//! What only a running site can say: whether data flows.

use super::{Check, Patient, State};
use std::collections::BTreeMap;
use std::thread::sleep;
use std::time::Duration;
use supervisor::{ServiceStatus, StatusReport};

/// Health comes once a second: two looks so far apart see two of them.
const APART: Duration = Duration::from_millis(2500);
/// A host that was heard later than this is lost or nearly so, seconds.
const HOST_AGE_MAX_S: f64 = 3.0;

pub(super) fn checks(patient: &Patient<'_>) -> Vec<Check> {
    let look = || supervisor::status_in(&patient.site.name, &patient.run_root).ok();
    let Some(before) = look() else {
        let found = format!("the site does not run here ({})", patient.run_dir.display());
        let help = "links and data were not looked at: `tog run`, then ask again";
        return vec![Check::new("site", State::Unknown, found, help)];
    };
    sleep(APART);
    let Some(after) = look() else {
        return vec![Check::new("site", State::Fail, "it ended while it was looked at", "its log")];
    };
    let mut checks = vec![site(&after)];
    checks.extend(flows(&before, &after));
    let bridge = after.services.iter().find(|service| service.name == "bridge");
    checks.extend(bridge.into_iter().flat_map(|bridge| links(patient, bridge)));
    checks
}

fn site(report: &StatusReport) -> Check {
    if report.is_healthy() {
        return Check::ok("site", "every process is well");
    }
    let faults = report.services.iter().flat_map(|service| {
        let name = &service.name;
        service.faults.iter().map(move |fault| format!("{name}: {}", fault.code))
    });
    let mut faults: Vec<String> = faults.collect();
    let restarting = report.services.iter().filter(|service| service.restarts > 2);
    faults.extend(restarting.map(|s| format!("{} was started again {} times", s.name, s.restarts)));
    let found = if faults.is_empty() { "something starts".to_owned() } else { faults.join("; ") };
    Check::new("site", State::Fail, found, "`tog status SITE` says it in full")
}

/// Of each service that takes or gives something: whether it did between the two looks.
fn flows(before: &StatusReport, after: &StatusReport) -> Vec<Check> {
    let counts = |service: &str| match service.split(' ').next().unwrap_or_default() {
        "laser" => Some("scans_out"),
        "fusion" => Some("frames_out"),
        "mapper" => Some("classes_out"),
        "anomaly" => Some("class_maps_in"),
        _ => None,
    };
    let earlier: BTreeMap<&str, &ServiceStatus> =
        before.services.iter().map(|service| (service.name.as_str(), service)).collect();
    let check = |service: &ServiceStatus| {
        let counter = counts(&service.name)?;
        if service.state == supervisor::ProcessState::Standby {
            return Some(Check::ok(&service.name, "runs on another host"));
        }
        let count = |service: &ServiceStatus| service.counters.get(counter).copied();
        let then = earlier.get(service.name.as_str()).and_then(|earlier| count(earlier));
        let rose = count(service).unwrap_or(0).saturating_sub(then.unwrap_or(0));
        let per_s =
            rose as f64 / apart_s(before, earlier.get(service.name.as_str()), after, service);
        let what = counter.replace('_', " ");
        Some(if rose > 0 {
            Check::ok(&service.name, format!("about {per_s:.0} {what} a second"))
        } else {
            let found = format!("no {what} within {:.1} s", APART.as_secs_f64());
            Check::new(&service.name, State::Fail, found, "`tog status SITE` says why")
        })
    };
    after.services.iter().filter_map(check).collect()
}

/// Time between the two healths that the counts are of, seconds.
fn apart_s(
    before: &StatusReport,
    earlier: Option<&&ServiceStatus>,
    after: &StatusReport,
    service: &ServiceStatus,
) -> f64 {
    let told_s = |report: &StatusReport, service: &ServiceStatus| {
        Some(report.stamp_ns as f64 / 1e9 - service.health_age_s?)
    };
    let then_s = earlier.and_then(|earlier| told_s(before, earlier));
    let apart_s = told_s(after, service).zip(then_s).map(|(now_s, then_s)| now_s - then_s);
    apart_s.filter(|apart_s| *apart_s > 0.1).unwrap_or(APART.as_secs_f64())
}

/// What the bridge knows of each other host.
fn links(patient: &Patient<'_>, bridge: &ServiceStatus) -> Vec<Check> {
    let gauge = |name: &str, host: &str| bridge.gauges.get(&format!("{name} {host}")).copied();
    let check = |host: &str| {
        let name = format!("link to {host}");
        let help = "cable, firewall, clock: the checks of this host above say which. If all are well: does one \
                    refuse the certificate of the other (`unauthorised` in a status), or has it another \
                    site file?";
        let Some(age_s) = gauge("host_age_s", host) else {
            return Check::new(&name, State::Fail, "nothing was ever heard", help);
        };
        let mut found = format!("heard {age_s:.1} s ago");
        let behind = gauge("events_behind", host);
        if let Some(behind) = behind {
            found += &format!(", {behind:.0} events behind");
        }
        let ahead_s = gauge("clock_ahead_s", host);
        if let Some(ahead_s) = ahead_s {
            found += &format!(", its clock is {:.0} ms off", ahead_s.abs() * 1e3);
        }
        let lags = behind.is_some_and(|behind| behind > 0.0);
        if age_s > HOST_AGE_MAX_S || ahead_s.is_some_and(|ahead_s| ahead_s.abs() > 0.1) {
            Check::new(&name, State::Fail, found, help)
        } else if lags {
            Check::new(&name, State::Warn, found, "it should catch up within seconds: ask again")
        } else {
            Check::ok(&name, found)
        }
    };
    let own = patient.host.map(|host| host.id.as_str());
    let others = patient.site.hosts.iter().filter(|host| Some(host.id.as_str()) != own);
    others.map(|host| check(&host.id)).collect()
}
