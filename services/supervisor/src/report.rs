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

impl StatusReport {
    /// True if every process runs and says that nothing is wrong.
    #[must_use]
    pub fn is_healthy(&self) -> bool {
        let well = |state| matches!(state, ProcessState::Running | ProcessState::Ended);
        !self.stopping && self.services.iter().all(|service| well(service.state))
    }

    /// A table for people.
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
}
