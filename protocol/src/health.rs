//! How a service is: counters, gauges and faults, published once a second and on every change of a
//! fault. A service is unhealthy when data does not arrive, whatever the transport says.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What a service is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ServiceState {
    /// Started, no data yet.
    #[default]
    Starting,
    /// Data flows.
    Running,
    /// Something is wrong; see the faults.
    Degraded,
    /// The recording is over and everything was handed on.
    Ended,
}

/// Something that is wrong now.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fault {
    /// Short and stable: `laser_silent`, `checkpoint_damaged`.
    pub code: String,
    /// What was found, what was expected, what to do.
    pub text: String,
    /// Since when, UNIX nanoseconds.
    pub since_ns: u64,
}

/// How a service is.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Health {
    /// Name as in the logs and in `ps`: `fusion foyer`, `laser front`, `alerts`.
    pub service: String,
    /// Process id.
    pub pid: u32,
    /// When the process started, UNIX nanoseconds.
    pub started_ns: u64,
    /// When this was written, UNIX nanoseconds.
    pub stamp_ns: u64,
    /// What it is doing.
    pub state: ServiceState,
    /// Totals since the start: `scans_in`, `scans_lost`, `scans_late`, `frames_out`, ...
    pub counters: BTreeMap<String, u64>,
    /// Values now, unit last in the name: `scan_rate_hz`, `scan_age_s`, `cpu_s`.
    pub gauges: BTreeMap<String, f64>,
    /// What is wrong now.
    pub faults: Vec<Fault>,
}
