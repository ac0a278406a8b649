//! How a worker tells that it is well: once a second, and soon after any change of a fault.

use crate::bus::Bus;
use crate::clock::{monotonic_ns, process_cpu_ns, wall_ns};
use crate::ports::BusError;
use crate::publisher::Publisher;
use crate::role::Role;
use protocol::codec::encode;
use protocol::health::{Fault, Health, ServiceState};
use protocol::topic;
use protocol::wire::BytesHeader;
use std::collections::BTreeMap;

/// A living process says so this often, nanoseconds.
pub const PERIOD_NS: u64 = 1_000_000_000;
/// A fault that flaps is told at most this often, nanoseconds: the readers' buffers are short.
const CHANGE_PERIOD_NS: u64 = 100_000_000;
/// Most faults at once: more are one catastrophe, and the message must stay below 64 kB.
const FAULTS_MAX: usize = 64;
/// Longest text of a fault, bytes.
const FAULT_TEXT_MAX: usize = 400;
/// Most counters and most gauges: see [`FAULTS_MAX`].
const VALUES_MAX: usize = 256;

/// The health of this process, and the port that tells it.
#[derive(Debug)]
pub struct HealthReporter {
    publisher: Publisher<BytesHeader, u8>,
    health: Health,
    faults: BTreeMap<String, Fault>,
    state: ServiceState,
    told_mono_ns: Option<u64>,
    changed: bool,
}

impl HealthReporter {
    /// The reporter of one process of `roles`, which are those of its instance.
    ///
    /// # Errors
    /// If the health topic cannot be opened.
    pub fn new(bus: &Bus, roles: &[Role], role: &Role) -> Result<Self, BusError> {
        let index = roles.iter().position(|other| other == role);
        let source = index.map_or(u32::MAX, |index| index as u32);
        let publisher = bus.publisher(&topic::health(), source)?;
        let health = Health {
            service: role.to_string(),
            pid: std::process::id(),
            started_ns: wall_ns(),
            ..Health::default()
        };
        Ok(Self {
            publisher,
            health,
            faults: BTreeMap::new(),
            state: ServiceState::Starting,
            told_mono_ns: None,
            changed: false,
        })
    }

    /// Adds to a counter.
    pub fn count(&mut self, name: &str, increment: u64) {
        match self.health.counters.get_mut(name) {
            Some(counter) => *counter += increment,
            None => self.set_count(name, increment),
        }
    }

    /// Sets a counter to a total that somebody else keeps.
    pub fn set_count(&mut self, name: &str, total: u64) {
        let room = self.health.counters.len() < VALUES_MAX;
        match self.health.counters.get_mut(name) {
            Some(counter) => *counter = total,
            None if room => {
                self.health.counters.insert(name.to_owned(), total);
            }
            None => {}
        }
    }

    /// Sets a gauge; the unit is the last word of its name.
    pub fn gauge(&mut self, name: &str, value: f64) {
        let room = self.health.gauges.len() < VALUES_MAX;
        match self.health.gauges.get_mut(name) {
            Some(gauge) => *gauge = value,
            None if room => {
                self.health.gauges.insert(name.to_owned(), value);
            }
            None => {}
        }
    }

    /// A value that there is not any more.
    pub fn drop_gauge(&mut self, name: &str) {
        self.health.gauges.remove(name);
    }

    /// Says what the process is doing. `Degraded` need not be set: it is what `Running` is called
    /// while there are faults.
    pub fn set_state(&mut self, state: ServiceState) {
        self.changed |= self.state != state;
        self.state = state;
    }

    /// What it is doing, faults considered.
    #[must_use]
    pub fn state(&self) -> ServiceState {
        match self.state {
            ServiceState::Running if !self.faults.is_empty() => ServiceState::Degraded,
            state => state,
        }
    }

    /// Something is wrong. Logged once; while it lasts only the text may change. `code` is short and
    /// stable, `text` says what was found, what was expected, what to do.
    pub fn fault(&mut self, code: &str, text: impl Into<String>) {
        let mut text = text.into();
        let mut end = FAULT_TEXT_MAX.min(text.len());
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        text.truncate(end);
        if let Some(fault) = self.faults.get_mut(code) {
            fault.text = text;
        } else if self.faults.len() < FAULTS_MAX {
            tracing::warn!(fault = code, "{text}");
            let fault = Fault { code: code.to_owned(), text, since_ns: wall_ns() };
            self.faults.insert(code.to_owned(), fault);
            self.changed = true;
        }
    }

    /// It is not wrong any more. Logged once.
    pub fn clear(&mut self, code: &str) {
        if let Some(fault) = self.faults.remove(code) {
            tracing::info!(fault = code, "over: {}", fault.text);
            self.changed = true;
        }
    }

    /// Sets or clears a fault.
    pub fn set_fault(&mut self, code: &str, text: Option<String>) {
        match text {
            Some(text) => self.fault(code, text),
            None => self.clear(code),
        }
    }

    /// True while a fault lasts.
    #[must_use]
    pub fn has_fault(&self, code: &str) -> bool {
        self.faults.contains_key(code)
    }

    /// When [`Self::beat`] wants to be called next, CLOCK_MONOTONIC nanoseconds.
    #[must_use]
    pub fn due_mono_ns(&self) -> u64 {
        let period_ns = if self.changed { CHANGE_PERIOD_NS } else { PERIOD_NS };
        self.told_mono_ns.map_or(0, |told| told + period_ns)
    }

    /// Tells the health if it is time.
    pub fn beat(&mut self) {
        if monotonic_ns() >= self.due_mono_ns() {
            self.tell();
        }
    }

    /// Tells the health now.
    pub fn tell(&mut self) {
        self.told_mono_ns = Some(monotonic_ns());
        self.changed = false;
        self.health.stamp_ns = wall_ns();
        self.health.state = self.state();
        self.health.faults = self.faults.values().cloned().collect();
        self.gauge("cpu_s", process_cpu_ns() as f64 / 1e9);
        match encode(&self.health) {
            Ok(bytes) => {
                if let Err(error) = self.publisher.send(BytesHeader::default(), &bytes) {
                    tracing::warn!("health is not told: {error}");
                }
            }
            Err(error) => tracing::warn!("health is not told: {error}"),
        }
    }
}
