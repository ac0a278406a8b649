//! How a site is, in the text format of Prometheus (exposition format 0.0.4).

use std::fmt::Write as _;
use supervisor::{ServiceStatus, StatusReport};

/// Of a site that does not run.
pub const DOWN: &str =
    "# HELP tog_up 1 if the site runs on this host.\n# TYPE tog_up gauge\ntog_up 0\n";

/// Every process, counter, gauge and fault; each with its site, for a host may run several.
pub fn text(report: &StatusReport) -> String {
    let mut text = DOWN.replace("tog_up 0\n", &format!("tog_up{{site=\"{}\"}} 1\n", report.site));
    let well = f64::from(u8::from(report.is_healthy()));
    let site = ("site", report.site.as_str());
    let age_s = |service: &ServiceStatus| service.health_age_s;
    metric(&mut text, "tog_well", "gauge", "1 if nothing is wrong.", |line| {
        line(&[site], well);
    });
    let each = |text: &mut String, name, kind, help, of: &dyn Fn(&ServiceStatus) -> Option<f64>| {
        metric(text, name, kind, help, |line| {
            for service in &report.services {
                if let Some(value) = of(service) {
                    line(&[site, ("service", &service.name)], value);
                }
            }
        });
    };
    let is_up = |service: &ServiceStatus| Some(f64::from(u8::from(service.is_well())));
    each(&mut text, "tog_service_up", "gauge", "1 if the process runs and is well.", &is_up);
    let help = "How often the process was started again.";
    each(&mut text, "tog_service_restarts_total", "counter", help, &|s| Some(s.restarts as f64));
    let help = "Seconds since the process told its health.";
    each(&mut text, "tog_service_health_age_seconds", "gauge", help, &age_s);
    metric(&mut text, "tog_count_total", "counter", "What a process counts.", |line| {
        for service in &report.services {
            for (name, count) in &service.counters {
                line(&[site, ("service", &service.name), ("name", name)], *count as f64);
            }
        }
    });
    metric(&mut text, "tog_value", "gauge", "What a process measures.", |line| {
        for service in &report.services {
            for (name, value) in &service.gauges {
                line(&[site, ("service", &service.name), ("name", name)], *value);
            }
        }
    });
    metric(&mut text, "tog_fault", "gauge", "1 for each fault that there is.", |line| {
        for service in &report.services {
            for fault in &service.faults {
                line(&[site, ("service", &service.name), ("code", &fault.code)], 1.0);
            }
        }
    });
    text
}

fn metric(
    text: &mut String,
    name: &str,
    kind: &str,
    help: &str,
    lines: impl FnOnce(&mut dyn FnMut(&[(&str, &str)], f64)),
) {
    // Writing to a String cannot fail.
    let _ = writeln!(text, "# HELP {name} {help}\n# TYPE {name} {kind}");
    lines(&mut |labels, value| {
        let labels: Vec<String> =
            labels.iter().map(|(key, value)| format!("{key}=\"{}\"", escaped(value))).collect();
        let _ = writeln!(text, "{name}{{{}}} {value}", labels.join(","));
    });
}

fn escaped(value: &str) -> String {
    value.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use protocol::health::Fault;
    use supervisor::ProcessState;

    #[test]
    fn every_fault_and_counter_has_a_line_and_its_text_cannot_break_it() {
        let report = StatusReport {
            site: "lab".to_owned(),
            run_dir: "/run/tog/lab".to_owned(),
            pid: 1,
            started_ns: 0,
            stamp_ns: 0,
            stopping: false,
            services: vec![ServiceStatus {
                name: "fusion hall".to_owned(),
                state: ProcessState::Degraded,
                pid: Some(2),
                restarts: 3,
                up_s: Some(1.0),
                health_age_s: Some(0.5),
                last_end: None,
                counters: [("scans_in".to_owned(), 7)].into(),
                gauges: [("frame_rate_hz".to_owned(), 9.5)].into(),
                faults: vec![Fault {
                    code: "laser_silent \"x\"".to_owned(),
                    text: String::new(),
                    since_ns: 0,
                }],
            }],
        };
        let text = text(&report);
        for line in [
            "tog_up{site=\"lab\"} 1",
            "tog_well{site=\"lab\"} 0",
            "tog_service_up{site=\"lab\",service=\"fusion hall\"} 0",
            "tog_service_restarts_total{site=\"lab\",service=\"fusion hall\"} 3",
            "tog_count_total{site=\"lab\",service=\"fusion hall\",name=\"scans_in\"} 7",
            "tog_value{site=\"lab\",service=\"fusion hall\",name=\"frame_rate_hz\"} 9.5",
            "tog_fault{site=\"lab\",service=\"fusion hall\",code=\"laser_silent \\\"x\\\"\"} 1",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}\n{text}");
        }
    }
}
