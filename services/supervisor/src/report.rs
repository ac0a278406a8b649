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
    /// It runs on another host, and here when that one is lost.
    Standby,
}

impl ProcessState {
    /// As it is shown.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Starting => "starting",
            Self::Running => "running",
            Self::Degraded => "degraded",
            Self::Ended => "ended",
            Self::Waiting => "waiting",
            Self::Standby => "standby",
        }
    }
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
/// Health comes once a second: a service that runs and is silent for longer is stuck, seconds.
const HEALTH_AGE_MAX_S: f64 = 3.0;

impl ServiceStatus {
    /// True if it runs, tells its health in time and says that nothing is wrong.
    #[must_use]
    pub fn is_well(&self) -> bool {
        use ProcessState::{Ended, Running, Standby};
        matches!(self.state, Running | Ended | Standby) && !self.is_overdue()
    }

    /// True if it runs and has not told its health for too long.
    fn is_overdue(&self) -> bool {
        let runs = matches!(self.state, ProcessState::Running | ProcessState::Degraded);
        runs && self.health_age_s.is_some_and(|age_s| age_s > HEALTH_AGE_MAX_S)
    }

    /// How far an area has learnt: `learning, 3 of 10 min`; none for other services. The gauges
    /// are those of the service `anomaly`.
    fn phase(&self) -> Option<String> {
        let gauge = |name: &str| self.gauges.get(name).copied();
        let progress = |phase: &str, done: &str, goal: &str| {
            let of = gauge(done).zip(gauge(goal)).map(|(done_s, goal_s)| of_goal(done_s, goal_s));
            of.map_or_else(|| phase.to_owned(), |of| format!("{phase}, {of}"))
        };
        match gauge("phase")? {
            0.0 => Some(progress("learning", "learnt_s", "learning_s")),
            1.0 => Some(progress("calibrating", "calibrated_s", "calibration_s")),
            _ => Some("watching".to_owned()),
        }
    }

    /// The phase of an area in which nothing unusual is told yet.
    fn unready(&self) -> Option<String> {
        self.phase().filter(|_| self.gauges.get("phase").is_some_and(|phase| *phase < 2.0))
    }

    /// What it delivers, a second; unknown while its health is overdue.
    #[must_use]
    pub fn rate_hz(&self) -> Option<f64> {
        if self.is_overdue() {
            return None;
        }
        let mut rates = self.gauges.iter().filter(|(name, _)| name.ends_with("_rate_hz"));
        rates.next().map(|(_, rate_hz)| *rate_hz)
    }

    /// Age now of its newest scan if it is a laser, else of the last word of it, seconds.
    #[must_use]
    pub fn age_s(&self) -> Option<f64> {
        let scan_age_s = self.gauges.get("scan_age_s").copied().unwrap_or(0.0);
        self.health_age_s.map(|health_age_s| scan_age_s + health_age_s)
    }

    /// Its phase, and the counters and gauges that are not zero and have no column.
    fn values(&self) -> Vec<String> {
        let counters = self.counters.iter().filter(|(name, count)| *name != "wakes" && **count > 0);
        let no_column = |name: &str| !matches!(name, "cpu_s" | "phase");
        let gauges = self.gauges.iter().filter(|(name, value)| no_column(name) && **value != 0.0);
        let counters = counters.map(|(name, count)| format!("{name} {count}"));
        let gauges = gauges.map(|(name, value)| match value.abs() {
            0.0..100.0 => format!("{name} {value:.3}"),
            _ => format!("{name} {value:.0}"),
        });
        self.phase().into_iter().chain(counters).chain(gauges).collect()
    }

    /// What is wrong, a line each.
    fn complaints(&self) -> Vec<String> {
        let faults = self.faults.iter().map(|fault| format!("{}: {}", fault.code, fault.text));
        let mut lines: Vec<String> = faults.collect();
        if let (true, Some(age_s)) = (self.is_overdue(), self.health_age_s) {
            let age = duration(age_s);
            lines.push(format!("overdue: says nothing for {age}, which it should every second"));
        }
        if let (ProcessState::Waiting, Some(end)) = (self.state, &self.last_end) {
            lines.push(format!("ended with {end}, and is started again"));
        }
        let ago = self.up_s.map_or_else(String::new, |up_s| format!("{} ago", duration(up_s)));
        match (self.restarts, self.up_s) {
            (0, _) => {}
            (1, None) => lines.push("was started again once".to_owned()),
            (1, _) => lines.push(format!("was started again once, {ago}")),
            (n, None) => lines.push(format!("was started again {n} times")),
            (n, _) => lines.push(format!("was started again {n} times, the last time {ago}")),
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

    /// Everything for programs: the fields, and what people are told besides: `well` of the site
    /// and of every service, `phase` of those that learn.
    ///
    /// # Errors
    /// If a value has no JSON.
    pub fn json(&self) -> serde_json::Result<serde_json::Value> {
        let mut json = serde_json::to_value(self)?;
        json["well"] = self.is_healthy().into();
        for (index, service) in self.services.iter().enumerate() {
            json["services"][index]["well"] = service.is_well().into();
            json["services"][index]["phase"] = service.phase().into();
        }
        Ok(json)
    }

    /// How it is, in half a sentence.
    #[must_use]
    pub fn headline(&self) -> String {
        let unwell = self.services.iter().filter(|service| !service.is_well()).count();
        let mut health = match (self.stopping, unwell) {
            (true, _) => return "is stopping".to_owned(),
            (false, 0) => "all is well".to_owned(),
            (false, 1) => format!("1 of {} services is not well", self.services.len()),
            (false, n) => format!("{n} of {} services are not well", self.services.len()),
        };
        for service in &self.services {
            if let Some(phase) = service.unready() {
                let area = service.name.split_once(' ').map_or("", |(_, area)| area);
                let _ = write!(health, "; area {area} is still {phase}: only faults are told");
            }
        }
        health
    }

    /// A line per service for people, and what is wrong spelled out below it.
    #[must_use]
    pub fn summary(&self) -> String {
        let health = self.headline();
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
                service.state.name(),
                or_dash(service.up_s.map(duration)),
                or_dash(service.rate_hz().map(|rate_hz| format!("{rate_hz:.1} Hz"))),
                or_dash(service.age_s().map(|age_s| format!("{age_s:.1} s"))),
            );
            if let Some(phase) = service.phase() {
                let _ = writeln!(text, "{:width$}    {phase}", "");
            }
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
                service.state.name(),
                or_dash(service.pid.map(|pid| pid.to_string())),
                or_dash(service.up_s.map(duration)),
                service.restarts,
                or_dash(service.health_age_s.map(|age_s| format!("{age_s:.1} s"))),
                or_dash(service.gauges.get("cpu_s").map(|cpu_s| format!("{cpu_s:.2} s"))),
            );
            let values = service.values();
            if !values.is_empty() {
                let _ = writeln!(text, "{:width$}    {}", "", values.join(", "));
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

/// `3 of 10 min`: progress in the unit of the goal, or `3 min of 6 h` while that is below one.
fn of_goal(done_s: f64, goal_s: f64) -> String {
    let of = |unit_s: f64| (done_s / unit_s).floor();
    match goal_s {
        s if s < 120.0 => format!("{} of {s:.0} s", of(1.0)),
        s if s < 7200.0 => format!("{} of {:.0} min", of(60.0), s / 60.0),
        s if done_s < 3600.0 => format!("{} min of {:.0} h", of(60.0), s / 3600.0),
        s => format!("{} of {:.0} h", of(3600.0), s / 3600.0),
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
                    laser front  running     1m01s    10.0 Hz    0.3 s\n";
        assert_eq!(report.summary(), well);
        let mut fusion = service("fusion lab", ProcessState::Degraded);
        fusion.restarts = 2;
        fusion.counters.insert("scans_lost".to_owned(), 3);
        let text = "laser `front` is silent".into();
        fusion.faults.push(Fault { code: "laser_silent".into(), text, since_ns: 1 });
        report.services.push(fusion);
        let summary = report.summary();
        for part in [
            "site lab: 1 of 2 services is not well",
            "! laser_silent: laser `front` is silent\n",
            "! was started again 2 times, the last time 1m01s ago\n",
            "! since its start: scans lost 3\n",
        ] {
            assert!(summary.contains(part), "{part}\n{summary}");
        }
    }

    fn one(name: &str, health_age_s: f64, gauges: &[(&str, f64)]) -> StatusReport {
        let service = ServiceStatus {
            name: name.to_owned(),
            state: ProcessState::Running,
            pid: Some(42),
            restarts: 0,
            up_s: Some(61.0),
            health_age_s: Some(health_age_s),
            last_end: None,
            counters: [("scans_lost".to_owned(), 0), ("scans_out".to_owned(), 7)].into(),
            gauges: gauges.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect(),
            faults: Vec::new(),
        };
        StatusReport {
            site: "lab".into(),
            run_dir: "/run/tog/lab".into(),
            pid: 41,
            started_ns: 0,
            stamp_ns: 61_000_000_000,
            stopping: false,
            services: vec![service],
        }
    }

    #[test]
    fn an_area_that_still_learns_is_named_with_its_progress_and_all_is_well() {
        for (phase, goal_s, words) in [
            (0.0, 600.0, "learning, 3 of 10 min"),
            (0.0, 21_600.0, "learning, 3 min of 6 h"),
            (1.0, 90.0, "calibrating, 12 of 90 s"),
        ] {
            let report = one(
                "anomaly room",
                0.2,
                &[
                    ("phase", phase),
                    ("learnt_s", 185.0),
                    ("learning_s", goal_s),
                    ("calibrated_s", 12.5),
                    ("calibration_s", goal_s),
                ],
            );
            let summary = report.summary();
            let headline = format!("all is well; area room is still {words}: only faults are told");
            assert!(summary.contains(&headline), "{summary}");
            assert!(summary.contains(&format!("    {words}\n")), "{summary}");
            assert!(report.table().contains(words), "{}", report.table());
            let json = report.json().map(|json| json["services"][0]["phase"].clone());
            assert_eq!(json.ok(), Some(words.into()));
            assert!(report.is_healthy());
        }
        let summary = one("anomaly room", 0.2, &[("phase", 2.0)]).summary();
        assert!(
            summary.contains("all is well, up") && summary.contains(" watching\n"),
            "{summary}"
        );
    }

    #[test]
    fn a_service_that_says_nothing_for_seconds_is_not_well_and_its_age_grows() {
        let gauges = [("scan_rate_hz", 10.0), ("scan_age_s", 0.1)];
        assert!(one("laser front", 2.9, &gauges).is_healthy());
        let report = one("laser front", 12.0, &gauges);
        assert!(!report.is_healthy());
        let summary = report.summary();
        for part in ["1 of 1 services is not well", "1m01s          -   12.1 s", "nothing for 12 s"]
        {
            assert!(summary.contains(part), "{part}\n{summary}");
        }
        assert_eq!(report.json().map(|json| json["well"].clone()).ok(), Some(false.into()));
        assert!(!report.table().contains("scans_lost"), "zeros say nothing: {}", report.table());
    }
}
