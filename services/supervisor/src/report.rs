//! What `tog status` shows.

use protocol::health::Fault;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::Write;

/// What a process of the site is doing, as the supervisor sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProcessState {
    /// Runs, and has not told its health yet or has no data yet.
    Starting,
    /// Data flows.
    Running,
    /// It says that something is wrong.
    Degraded,
    /// The recording is over.
    Ended,
    /// It ended, and waits for its next start.
    Waiting,
}

/// One process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ServiceStatus {
    /// `fusion foyer`, `laser front`, `alerts`.
    pub name: String,
    /// What it is doing.
    pub state: ProcessState,
    /// Process id, while it runs.
    pub pid: Option<u32>,
    /// How often it was started again.
    pub restarts: u64,
    /// Seconds since its last start, while it runs.
    pub up_s: Option<f64>,
    /// Seconds since it told its health, if it ever did since its last start.
    pub health_age_s: Option<f64>,
    /// How it ended last.
    pub last_end: Option<String>,
    /// Totals since its last start.
    pub counters: BTreeMap<String, u64>,
    /// Values at its last health.
    pub gauges: BTreeMap<String, f64>,
    /// What is wrong.
    pub faults: Vec<Fault>,
}

/// The whole site.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StatusReport {
    /// The site's name.
    pub site: String,
    /// Its run directory.
    pub run_dir: String,
    /// The supervisor's process id.
    pub pid: u32,
    /// Start of the site, UNIX nanoseconds.
    pub started_ns: u64,
    /// When this was written, UNIX nanoseconds.
    pub stamp_ns: u64,
    /// True while it shuts down.
    pub stopping: bool,
    /// Its processes, in the order of their start.
    pub services: Vec<ServiceStatus>,
}

/// Parts of the names of counters of what should not happen.
const LOSSES: [&str; 7] = ["lost", "late", "dropped", "refused", "missed", "failed", "given_up"];

impl ServiceStatus {
    /// True if it runs and says that nothing is wrong.
    fn is_well(&self) -> bool {
        matches!(self.state, ProcessState::Running | ProcessState::Ended)
    }

    /// What it delivers, a second.
    fn rate_hz(&self) -> Option<f64> {
        let mut rates = self.gauges.iter().filter(|(name, _)| name.ends_with("_rate_hz"));
        rates.next().map(|(_, rate_hz)| *rate_hz)
    }

    /// Age of its last data, or of the last word of it, seconds.
    fn age_s(&self) -> Option<f64> {
        self.gauges.get("scan_age_s").copied().or(self.health_age_s)
    }

    /// What is wrong, a line each.
    fn complaints(&self) -> Vec<String> {
        let faults = self.faults.iter().map(|fault| format!("{}: {}", fault.code, fault.text));
        let mut lines: Vec<String> = faults.collect();
        if let (ProcessState::Waiting, Some(end)) = (self.state, &self.last_end) {
            lines.push(format!("ended with {end}, and is started again"));
        }
        match self.restarts {
            0 => {}
            1 => lines.push("was started again once".to_owned()),
            n => lines.push(format!("was started again {n} times")),
        }
        let is_loss = |name: &str| LOSSES.iter().any(|loss| name.contains(loss));
        let losses = self.counters.iter().filter(|(name, count)| is_loss(name) && **count > 0);
        let losses: Vec<String> =
            losses.map(|(name, count)| format!("{} {count}", name.replace('_', " "))).collect();
        if !losses.is_empty() {
            lines.push(format!("since its start: {}", losses.join(", ")));
        }
        lines
    }
}

impl StatusReport {
    /// True if every process runs and says that nothing is wrong.
    #[must_use]
    pub fn is_healthy(&self) -> bool {
        !self.stopping && self.services.iter().all(ServiceStatus::is_well)
    }

    /// A line per service for people, and what is wrong spelled out below it.
    #[must_use]
    pub fn summary(&self) -> String {
        let unwell = self.services.iter().filter(|service| !service.is_well()).count();
        let health = match (self.stopping, unwell) {
            (true, _) => "is stopping".to_owned(),
            (false, 0) => "all is well".to_owned(),
            (false, n) => format!("{n} of {} services are not well", self.services.len()),
        };
        let up = duration(self.stamp_ns.saturating_sub(self.started_ns) as f64 / 1e9);
        let mut text = format!("site {}: {health}, up {up}\n", self.site);
        let width = self.services.iter().map(|s| s.name.chars().count()).max().unwrap_or(0).max(7);
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{:width$}  {:9} {:>7} {:>10} {:>8}",
            "service", "state", "up", "rate", "age"
        );
        for service in &self.services {
            let or_dash = |value: Option<String>| value.unwrap_or_else(|| "-".to_owned());
            let _ = writeln!(
                text,
                "{:width$}  {:9} {:>7} {:>10} {:>8}",
                service.name,
                format!("{:?}", service.state).to_lowercase(),
                or_dash(service.up_s.map(duration)),
                or_dash(service.rate_hz().map(|rate_hz| format!("{rate_hz:.1} Hz"))),
                or_dash(service.age_s().map(|age_s| format!("{age_s:.1} s"))),
            );
            for complaint in service.complaints() {
                let _ = writeln!(text, "{:width$}    ! {complaint}", "");
            }
        }
        text
    }

    /// Everything for people: process ids, counters, gauges.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = format!(
            "site {}, process {}, up {}, {}\n",
            self.site,
            self.pid,
            duration(self.stamp_ns.saturating_sub(self.started_ns) as f64 / 1e9),
            self.run_dir
        );
        let width = self.services.iter().map(|s| s.name.chars().count()).max().unwrap_or(0).max(7);
        let head = ["state", "pid", "up", "restarts", "health", "cpu"];
        let _ = writeln!(
            text,
            "{:width$}  {:9} {:>7} {:>8} {:>8} {:>7} {:>8}",
            "service", head[0], head[1], head[2], head[3], head[4], head[5]
        );
        for service in &self.services {
            let or_dash = |value: Option<String>| value.unwrap_or_else(|| "-".to_owned());
            let _ = writeln!(
                text,
                "{:width$}  {:9} {:>7} {:>8} {:>8} {:>7} {:>8}",
                service.name,
                format!("{:?}", service.state).to_lowercase(),
                or_dash(service.pid.map(|pid| pid.to_string())),
                or_dash(service.up_s.map(duration)),
                service.restarts,
                or_dash(service.health_age_s.map(|age_s| format!("{age_s:.1} s"))),
                or_dash(service.gauges.get("cpu_s").map(|cpu_s| format!("{cpu_s:.2} s"))),
            );
            let counters: Vec<_> = service
                .counters
                .iter()
                .filter(|(name, _)| *name != "wakes")
                .map(|(name, value)| format!("{name} {value}"))
                .chain(
                    service
                        .gauges
                        .iter()
                        .filter(|(name, _)| *name != "cpu_s")
                        .map(|(name, value)| format!("{name} {value:.3}")),
                )
                .collect();
            if !counters.is_empty() {
                let _ = writeln!(text, "{:width$}    {}", "", counters.join(", "));
            }
            for fault in &service.faults {
                let _ = writeln!(text, "{:width$}    ! {}: {}", "", fault.code, fault.text);
            }
            if let (ProcessState::Waiting, Some(end)) = (service.state, &service.last_end) {
                let _ = writeln!(text, "{:width$}    ended with {end}", "");
            }
        }
        text
    }
}

fn duration(s: f64) -> String {
    let whole = s.max(0.0) as u64;
    match whole {
        0..60 => format!("{whole} s"),
        60..3600 => format!("{}m{:02}s", whole / 60, whole % 60),
        _ => format!("{}h{:02}m", whole / 3600, whole / 60 % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_names_service_state_and_fault() {
        let service = |name: &str, state| ServiceStatus {
            name: name.to_owned(),
            state,
            pid: Some(42),
            restarts: 3,
            up_s: Some(3725.0),
            health_age_s: Some(0.25),
            last_end: None,
            counters: [("scans_in".to_owned(), 7)].into(),
            gauges: [("cpu_s".to_owned(), 1.5)].into(),
            faults: Vec::new(),
        };
        let mut report = StatusReport {
            site: "lab".into(),
            run_dir: "/run/tog/lab".into(),
            pid: 41,
            started_ns: 0,
            stamp_ns: 61_000_000_000,
            stopping: false,
            services: vec![service("alerts", ProcessState::Running)],
        };
        assert!(report.is_healthy());
        let fault = Fault { code: "late".into(), text: "scans are late".into(), since_ns: 1 };
        let mut fusion = service("fusion foyer", ProcessState::Degraded);
        fusion.faults.push(fault);
        report.services.push(fusion);
        assert!(!report.is_healthy());
        let table = report.table();
        for part in
            ["up 1m01s", "fusion foyer  degraded", "1h02m", "scans_in 7", "! late: scans are"]
        {
            assert!(table.contains(part), "{part}\n{table}");
        }
    }

    #[test]
    fn the_summary_spells_out_only_what_is_wrong() {
        let service = |name: &str, state| ServiceStatus {
            name: name.to_owned(),
            state,
            pid: Some(42),
            restarts: 0,
            up_s: Some(61.0),
            health_age_s: Some(0.25),
            last_end: None,
            counters: [("scans_out".to_owned(), 700), ("scans_lost".to_owned(), 0)].into(),
            gauges: [("scan_rate_hz".to_owned(), 9.98), ("scan_age_s".to_owned(), 0.06)].into(),
            faults: Vec::new(),
        };
        let mut report = StatusReport {
            site: "lab".into(),
            run_dir: "/run/tog/lab".into(),
            pid: 41,
            started_ns: 0,
            stamp_ns: 61_000_000_000,
            stopping: false,
            services: vec![service("laser front", ProcessState::Running)],
        };
        let well = "site lab: all is well, up 1m01s\n\
                    service      state          up       rate      age\n\
                    laser front  running     1m01s    10.0 Hz    0.1 s\n";
        assert_eq!(report.summary(), well);
        let mut fusion = service("fusion lab", ProcessState::Degraded);
        fusion.restarts = 2;
        fusion.counters.insert("scans_lost".to_owned(), 3);
        let text = "laser `front` is silent".into();
        fusion.faults.push(Fault { code: "laser_silent".into(), text, since_ns: 1 });
        report.services.push(fusion);
        let summary = report.summary();
        for part in [
            "site lab: 1 of 2 services are not well",
            "! laser_silent: laser `front` is silent\n",
            "! was started again 2 times\n",
            "! since its start: scans lost 3\n",
        ] {
            assert!(summary.contains(part), "{part}\n{summary}");
        }
    }
}
