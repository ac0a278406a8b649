//! One process of the site: started, listened to, killed, counted.

use crate::output::{Lines, Output};
use crate::policy::{End, RestartPolicy};
use crate::report::{ProcessState, ServiceStatus};
use process::{EventLoop, Interest, Role, Token, monotonic_ns};
use protocol::health::{Health, ServiceState};
use rustix::io::read;
use rustix::pipe::{PipeFlags, pipe_with};
use rustix::process::{Pid, PidfdFlags, Signal, kill_process, pidfd_open};
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// Bytes of log that are taken from a process at once, so that a chatty one leaves room to the others.
const LOG_BYTES_AT_ONCE: usize = 64 << 10;

/// A process that starts may be busy (tables of a large hall, a checkpoint, a learnt map) before its
/// first wait: so many times longer may it be silent.
const STARTING_PATIENCE: u64 = 6;

/// A process of the site, whether it runs or not.
#[derive(Debug)]
pub struct Service {
    /// Its role.
    pub role: Role,
    /// Its name.
    pub name: String,
    /// Its position in the plan.
    pub index: usize,
    /// When it is started again.
    pub policy: RestartPolicy,
    /// CLOCK_MONOTONIC of its next start, if one is due.
    pub start_at_ns: Option<u64>,
    /// Starts after the first.
    pub restarts: u64,
    /// Its last end.
    pub last_end: Option<End>,
    /// True while its area runs on another host.
    held: bool,
    running: Option<Running>,
    started_before: bool,
    health: Option<Health>,
    heard_mono_ns: Option<u64>,
    lines: Lines,
}

#[derive(Debug)]
struct Running {
    child: Child,
    pidfd: OwnedFd,
    exit: Token,
    log: OwnedFd,
    log_token: Option<Token>,
    started_mono_ns: u64,
    asked_to_stop_ns: Option<u64>,
    killed: bool,
}

impl Service {
    /// A process that was not started yet.
    #[must_use]
    pub fn new(role: Role, index: usize) -> Self {
        Self {
            name: role.to_string(),
            role,
            index,
            policy: RestartPolicy::default(),
            start_at_ns: Some(0),
            restarts: 0,
            last_end: None,
            held: false,
            running: None,
            started_before: false,
            health: None,
            heard_mono_ns: None,
            lines: Lines::default(),
        }
    }

    /// It is not to run, from now on or again: its area runs on another host.
    pub fn hold(&mut self) {
        (self.held, self.start_at_ns, self.started_before) = (true, None, false);
        (self.health, self.heard_mono_ns) = (None, None);
        self.ask_to_stop();
    }

    /// It is to run here.
    pub fn let_run(&mut self, now_ns: u64) {
        if std::mem::replace(&mut self.held, false) && self.running.is_none() {
            self.start_at_ns = Some(now_ns);
        }
    }

    /// True while it is not to run.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.held
    }

    /// Starts it.
    ///
    /// # Errors
    /// If the system starts no process.
    pub fn start(&mut self, run_dir: &Path, events: &EventLoop) -> io::Result<()> {
        self.start_at_ns = None;
        self.restarts += u64::from(self.started_before);
        self.started_before = true;
        self.policy.started(monotonic_ns());
        (self.health, self.heard_mono_ns) = (None, None);
        let (log, write_end) = pipe_with(PipeFlags::CLOEXEC | PipeFlags::NONBLOCK)?;
        // Only our end does not block: a worker waits for a full pipe as for any stderr.
        rustix::fs::fcntl_setfl(&write_end, rustix::fs::OFlags::empty())?;
        process::descriptors::close_on_exec();
        // The file of this very program, even if a newer one was installed in its place since.
        let mut child = Command::new("/proc/self/exe")
            .arg0("tog")
            .arg(self.role.service())
            .arg("--instance")
            .arg(run_dir)
            .args(self.role.arguments())
            .env(process::logging::SUPERVISED, "1")
            // What systemd is told, we tell.
            .env_remove("NOTIFY_SOCKET")
            .env_remove("WATCHDOG_USEC")
            .env_remove("WATCHDOG_PID")
            .stdin(Stdio::null())
            .stdout(Stdio::from(write_end.try_clone()?))
            .stderr(Stdio::from(write_end))
            .process_group(0) // Ctrl-C of the terminal is for us: we stop them in order
            .spawn()?;
        let watched = watch(&child, &log, events);
        let (pidfd, exit, log_token) = watched.inspect_err(|_| {
            // A child that cannot be watched would be nobody's.
            let _ = child.kill();
            let _ = child.wait();
        })?;
        self.running = Some(Running {
            child,
            pidfd,
            exit,
            log,
            log_token: Some(log_token),
            started_mono_ns: monotonic_ns(),
            asked_to_stop_ns: None,
            killed: false,
        });
        Ok(())
    }

    /// Its process id, while it runs.
    #[must_use]
    pub fn pid(&self) -> Option<u32> {
        self.running.as_ref().map(|running| running.child.id())
    }

    /// True if this descriptor is its log.
    #[must_use]
    pub fn logs_on(&self, token: Token) -> bool {
        self.running.as_ref().is_some_and(|running| running.log_token == Some(token))
    }

    /// True if this descriptor tells its end.
    #[must_use]
    pub fn ends_on(&self, token: Token) -> bool {
        self.running.as_ref().is_some_and(|running| running.exit == token)
    }

    /// Takes what it wrote.
    pub fn take_log(&mut self, events: &EventLoop, output: &mut Output) {
        let Some(running) = &mut self.running else { return };
        let Some(token) = running.log_token else { return };
        let mut buffer = [0u8; 4096];
        let (name, index) = (&self.name, self.index);
        for _ in 0..LOG_BYTES_AT_ONCE / buffer.len() {
            match read(&running.log, &mut buffer) {
                Ok(0) => {
                    // It closed stderr but lives: nothing comes any more.
                    let _ = events.unwatch(token, &running.log);
                    running.log_token = None;
                    return;
                }
                Ok(bytes) => {
                    self.lines.take(&buffer[..bytes], |line| output.line(index, name, line));
                }
                Err(_) => return, // nothing more to read until the next wake
            }
        }
    }

    /// Buries it if it has ended: takes its last words and says how it ended.
    pub fn take_end(&mut self, events: &EventLoop, output: &mut Output) -> Option<End> {
        let status = self.running.as_mut()?.child.try_wait().ok()??;
        self.take_log(events, output);
        let (name, index) = (&self.name, self.index);
        self.lines.end(|line| output.line(index, name, line));
        let running = self.running.take()?;
        let _ = events.unwatch(running.exit, &running.pidfd);
        if let Some(token) = running.log_token {
            let _ = events.unwatch(token, &running.log);
        }
        let end = match (status.code(), status.signal()) {
            (Some(code), _) => End::Exit(code),
            (None, signal) => End::Signal(signal.unwrap_or(0)),
        };
        self.last_end = Some(end);
        if self.held {
            // Its last words are not how anything is now that its area runs on another host.
            (self.health, self.heard_mono_ns) = (None, None);
        }
        Some(end)
    }

    /// Takes its health.
    pub fn heard(&mut self, health: Health) {
        let now_ns = monotonic_ns();
        // The last words of its predecessor are not its own.
        if self.pid() == Some(health.pid) {
            self.heard_mono_ns = Some(now_ns);
            self.policy.alive(now_ns, health.state != ServiceState::Starting);
            self.health = Some(health);
        }
    }

    /// CLOCK_MONOTONIC when it has been silent for too long: `silence_max_ns` after its last health, or
    /// [`STARTING_PATIENCE`] times that while it starts.
    #[must_use]
    pub fn silent_at_ns(&self, silence_max_ns: u64) -> Option<u64> {
        let running = self.running.as_ref()?;
        let last_sign_ns = self.heard_mono_ns.unwrap_or(0).max(running.started_mono_ns);
        let state = self.health.as_ref().map_or(ServiceState::Starting, |health| health.state);
        let patience = if state == ServiceState::Starting { STARTING_PATIENCE } else { 1 };
        Some(last_sign_ns.saturating_add(silence_max_ns.saturating_mul(patience)))
    }

    /// What it says of itself, if it runs and has said something.
    #[must_use]
    pub fn state(&self) -> Option<ServiceState> {
        self.health.as_ref().map(|health| health.state)
    }

    /// True if it says that the recording is over.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        self.health.as_ref().is_some_and(|health| health.state == ServiceState::Ended)
    }

    /// Asks it to stop, once.
    pub fn ask_to_stop(&mut self) {
        if let Some(running) = &mut self.running
            && running.asked_to_stop_ns.is_none()
        {
            running.asked_to_stop_ns = Some(monotonic_ns());
            // The child is not reaped yet, so the id is its own.
            let _ = kill_process(Pid::from_child(&running.child), Signal::TERM);
        }
    }

    /// When it was asked to stop.
    #[must_use]
    pub fn asked_to_stop_ns(&self) -> Option<u64> {
        self.running.as_ref()?.asked_to_stop_ns
    }

    /// Kills it, whatever it does. Returns true the first time.
    pub fn kill(&mut self) -> bool {
        let Some(running) = &mut self.running else { return false };
        let first = !std::mem::replace(&mut running.killed, true);
        if first {
            let _ = kill_process(Pid::from_child(&running.child), Signal::KILL);
        }
        first
    }

    /// True if it was killed and is not buried yet.
    #[must_use]
    pub fn is_dying(&self) -> bool {
        self.running.as_ref().is_some_and(|running| running.killed)
    }

    /// The last lines that it wrote.
    pub fn last_words(&self) -> impl Iterator<Item = &str> {
        self.lines.last_words()
    }

    /// For `tog status`.
    #[must_use]
    pub fn status(&self) -> ServiceStatus {
        let now_ns = monotonic_ns();
        let age_s = |since_ns: u64| now_ns.saturating_sub(since_ns) as f64 / 1e9;
        let health = self.health.clone();
        let state = match (&self.running, health.as_ref().map(|health| health.state)) {
            (_, Some(ServiceState::Ended)) => ProcessState::Ended,
            _ if self.held => ProcessState::Standby,
            (None, _) => ProcessState::Waiting,
            (Some(_), None | Some(ServiceState::Starting)) => ProcessState::Starting,
            (Some(_), Some(ServiceState::Running)) => ProcessState::Running,
            (Some(_), Some(ServiceState::Degraded)) => ProcessState::Degraded,
        };
        let health = health.unwrap_or_default();
        ServiceStatus {
            name: self.name.clone(),
            state,
            pid: self.pid(),
            restarts: self.restarts,
            up_s: self.running.as_ref().map(|running| age_s(running.started_mono_ns)),
            health_age_s: self.heard_mono_ns.map(age_s),
            last_end: self.last_end.map(|end| end.to_string()),
            counters: health.counters,
            gauges: health.gauges,
            faults: health.faults,
        }
    }
}

fn watch(child: &Child, log: &OwnedFd, events: &EventLoop) -> io::Result<(OwnedFd, Token, Token)> {
    let pidfd = pidfd_open(Pid::from_child(child), PidfdFlags::empty())?;
    let exit = events.watch(&pidfd, Interest::Read)?;
    let log = events.watch(log, Interest::Read)?;
    Ok((pidfd, exit, log))
}

impl Drop for Service {
    /// Whatever happens to the supervisor, no process of it stays.
    fn drop(&mut self) {
        if let Some(running) = &mut self.running {
            let _ = running.child.kill();
            let _ = running.child.wait();
        }
    }
}
