//! A worker process from its first line to its exit code.

use crate::bus::Bus;
use crate::clock::monotonic_ns;
use crate::descriptors;
use crate::event_loop::{EventLoop, Wake};
use crate::health::HealthReporter;
use crate::instance::{Instance, InstanceError};
use crate::logging;
use crate::ports::BusError;
use crate::role::Role;
use protocol::site::{Area, Laser, Site};
use std::path::Path;
use std::process::ExitCode;

/// Exit codes of every `tog` process.
pub mod exit {
    /// It did what it should, or was asked to stop.
    pub const OK: u8 = 0;
    /// It failed; trying again may help.
    pub const FAILED: u8 = 1;
    /// The command line is wrong.
    pub const USAGE: u8 = 2;
    /// The configuration is wrong (EX_CONFIG of sysexits): trying again does not help.
    pub const BAD_CONFIG: u8 = 78;
}

/// Why a worker ends before it is asked to.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// What the site asks for cannot be done: exit 78, and the supervisor stops the site.
    #[error("{0}")]
    Config(String),
    /// Something broke: exit 1, and the supervisor starts the worker again.
    #[error("{0}")]
    Failed(String),
    /// Shared memory.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The run directory.
    #[error(transparent)]
    Instance(#[from] InstanceError),
    /// The system.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

impl Failure {
    fn exit_code(&self) -> u8 {
        match self {
            Self::Config(_) => exit::BAD_CONFIG,
            Self::Failed(_) | Self::Bus(_) | Self::Instance(_) | Self::Io(_) => exit::FAILED,
        }
    }
}

/// What a worker works with.
#[derive(Debug)]
pub struct Worker {
    /// Where it runs.
    pub instance: Instance,
    /// For what.
    pub site: Site,
    /// As what.
    pub role: Role,
    /// Shared memory.
    pub bus: Bus,
    /// Where it sleeps.
    pub events: EventLoop,
    /// How it is.
    pub health: HealthReporter,
}

impl Worker {
    fn start(role: Role, run_dir: &Path) -> Result<Self, Failure> {
        descriptors::raise_limit();
        let events = EventLoop::new()?;
        let instance = Instance::load(run_dir)?;
        refuse_orphans(&instance)?;
        let site = instance.site()?;
        let roles = Role::all(&site, instance.host.as_deref());
        if !roles.contains(&role) {
            let name = &site.name;
            return Err(Failure::Config(format!("the site {name} has no process `{role}`")));
        }
        let bus = Bus::open(&instance, &events)?;
        let mut health = HealthReporter::new(&bus, &roles, &role)?;
        health.tell();
        Ok(Self { instance, site, role, bus, events, health })
    }

    /// Sleeps until data, a signal, a descriptor or the deadline (CLOCK_MONOTONIC nanoseconds); tells the
    /// health in between. At least once a second it returns without any reason, which is the time to
    /// refresh gauges.
    ///
    /// # Errors
    /// If the loop itself is broken.
    pub fn wait(&mut self, deadline_mono_ns: Option<u64>) -> Result<Wake, Failure> {
        self.health.beat();
        let beat = self.health.due_mono_ns();
        let mut wake = self.events.wait(Some(deadline_mono_ns.map_or(beat, |d| d.min(beat))))?;
        if wake.stop && !self.instance.iceoryx_config().exists() {
            logging::hush(); // the supervisor says that it is gone
        }
        wake.deadline = deadline_mono_ns.is_some_and(|deadline| deadline <= monotonic_ns());
        self.health.set_count("wakes", self.events.wakes());
        Ok(wake)
    }

    /// The area of this process, and its index in the site file: of an area service its own, of a
    /// laser the one that it watches.
    #[must_use]
    pub fn area(&self) -> Option<(u32, &Area)> {
        let id = match &self.role {
            Role::Anomaly { area } | Role::Mapper { area } | Role::Fusion { area } => area,
            Role::Laser { .. } => &self.laser()?.1.area,
            Role::Alerts | Role::Bridge | Role::Recorder => return None,
        };
        let index = self.site.areas.iter().position(|area| &area.id == id)?;
        Some((index as u32, &self.site.areas[index]))
    }

    /// The laser of this process, and its index in the site file.
    #[must_use]
    pub fn laser(&self) -> Option<(u32, &Laser)> {
        let Role::Laser { laser } = &self.role else { return None };
        let index = self.site.lasers.iter().position(|other| &other.id == laser)?;
        Some((index as u32, &self.site.lasers[index]))
    }
}

/// Runs a worker: logging, instance, shared memory, health; then `body`; then its exit code. An error
/// is one line on stderr, which the supervisor keeps as the last words of the process.
pub fn run(
    role: Role,
    run_dir: &Path,
    body: impl FnOnce(&mut Worker) -> Result<(), Failure>,
) -> ExitCode {
    logging::start();
    name_process(&role);
    let outcome = Worker::start(role, run_dir).and_then(|mut worker| {
        body(&mut worker)?;
        worker.health.tell();
        Ok(())
    });
    match outcome {
        Ok(()) => ExitCode::from(exit::OK),
        Err(failure) => {
            tracing::error!("{failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}

/// Who was started by a supervisor that was killed at once may find the instance of the next one. It
/// must not join: that one has started a process of its own for the same role.
fn refuse_orphans(instance: &Instance) -> Result<(), Failure> {
    let parent = rustix::process::getppid().map_or(0, |pid| pid.as_raw_nonzero().get() as u32);
    if std::env::var_os(logging::SUPERVISED).is_none() || parent == instance.owner_pid {
        return Ok(());
    }
    Err(Failure::Failed(format!(
        "the supervisor that started this process is gone, and process {} owns {} now",
        instance.owner_pid,
        instance.run_dir.display()
    )))
}

/// The name that `ps -e` and `top` show: `tog-fusion`. The arguments say the rest.
fn name_process(role: &Role) {
    if let Ok(name) = std::ffi::CString::new(format!("tog-{}", role.service())) {
        let _ = rustix::thread::set_name(&name); // cosmetic
    }
}
