//! A real site for a test: the real binary, a directory and a run directory of its own.
//!
//! Nothing is timed. A test waits for a line of the log, or for a condition of the status, under a
//! watchdog that only a bug reaches; the harness asks for the status again and again, as a person
//! would. Whatever happens, panics included, nothing of a site outlives its [`Site`].

#![allow(clippy::unwrap_used)] // a test that cannot go on shall say where

mod lan;
mod loopback;
mod process;
mod random;
mod running;

pub use lan::Lan;
pub use process::{cpu_s, kill, processes_of, resident_kb, shared_memory};
pub use random::Random;
pub use running::{Lines, Running};

use rustix::process::Signal;
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};
use supervisor::{ServiceStatus, StatusReport};

/// Only a bug waits for so long, on the busiest machine.
pub const WATCHDOG: Duration = Duration::from_secs(120);
/// How often a condition of the status is looked at while no line comes.
const LOOK: Duration = Duration::from_millis(5);
/// So few bytes that the sockets in the run directory fit into their 107.
const SCRATCH: &str = "/tmp/tog-t";

static SCRATCHES: AtomicU32 = AtomicU32::new(0);

/// True if the long variants shall run as well.
pub fn is_nightly() -> bool {
    std::env::var_os("TOG_NIGHTLY").is_some_and(|value| value == "1")
}

/// A directory of a test, removed at its end.
pub struct Scratch(pub PathBuf);

impl Default for Scratch {
    fn default() -> Self {
        Self::new()
    }
}

impl Scratch {
    /// Makes it.
    pub fn new() -> Self {
        let number = SCRATCHES.fetch_add(1, Ordering::Relaxed);
        let path = PathBuf::from(format!("{SCRATCH}-{}-{number}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    /// Writes a file into it.
    pub fn write(&self, name: &str, text: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, text).unwrap();
        path
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// The program that is tested: `$TOG_BIN`, else the `tog` that was built with the test.
///
/// # Panics
/// If there is none.
pub fn binary() -> PathBuf {
    if let Some(path) = std::env::var_os("TOG_BIN") {
        return path.into();
    }
    // target/<profile>/deps/<test>
    let test = std::env::current_exe().unwrap();
    let built = test.ancestors().skip(1).take(2).map(|directory| directory.join("tog"));
    let mut built = built.filter(|path| path.is_file());
    built.next().expect("no tog is built beside this test: set TOG_BIN to the program to test")
}

/// `tog` with these arguments, and a run directory of the test.
pub fn tog<I: AsRef<OsStr>>(run_root: &Path, arguments: impl IntoIterator<Item = I>) -> Command {
    command_of(&binary(), run_root, arguments)
}

fn command_of<I: AsRef<OsStr>>(
    program: &Path,
    run_root: &Path,
    arguments: impl IntoIterator<Item = I>,
) -> Command {
    let mut command = Command::new(program);
    command.args(arguments).env("TOG_RUN_DIR", run_root).stdin(Stdio::null());
    command
}

/// How a site of a test is started.
pub struct Setup {
    scratch: Scratch,
    program: PathBuf,
    arguments: Vec<String>,
    namespace: Option<String>,
    environment: Vec<(String, String)>,
}

impl Setup {
    /// A site file; it has a line `name = ".."`.
    pub fn new(toml: &str) -> Self {
        let scratch = Scratch::new();
        scratch.write("site.toml", toml);
        let (arguments, environment) = (Vec::new(), Vec::new());
        Self { scratch, program: binary(), arguments, namespace: None, environment }
    }

    /// A file beside the site file.
    pub fn file(self, name: &str, content: impl AsRef<[u8]>) -> Self {
        self.scratch.write(name, content);
        self
    }

    /// More arguments of `tog run`.
    pub fn arguments<T: Into<String>>(mut self, more: impl IntoIterator<Item = T>) -> Self {
        self.arguments.extend(more.into_iter().map(Into::into));
        self
    }

    /// With this variable in its environment.
    pub fn env(mut self, name: &str, value: impl AsRef<Path>) -> Self {
        self.environment.push((name.to_owned(), value.as_ref().display().to_string()));
        self
    }

    /// With another program than [`binary`]: an older tog.
    pub fn program(mut self, path: &Path) -> Self {
        path.clone_into(&mut self.program);
        self
    }

    /// On a host of a network.
    pub fn on(mut self, lan: &Lan, host: &str) -> Self {
        self.namespace = lan.namespace(host);
        self
    }

    /// The directory of the site file.
    pub fn dir(&self) -> &Path {
        &self.scratch.0
    }

    /// Starts it.
    pub fn start(self) -> Site {
        let dir = self.scratch.0.clone();
        let text = fs::read_to_string(dir.join("site.toml")).unwrap();
        let named = text.lines().find_map(|line| line.strip_prefix("name = \"")?.split('"').next());
        let run_dir = dir.join("r").join(named.expect("a site has a name"));
        let mut site = Site {
            running: None,
            program: self.program,
            arguments: self.arguments,
            namespace: self.namespace,
            environment: self.environment,
            file: dir.join("site.toml"),
            run_root: dir.join("r"),
            run_dir,
            prefix: None,
            dir,
            _scratch: self.scratch,
        };
        site.start_again();
        site
    }
}

/// A site of real processes.
pub struct Site {
    running: Option<Running>,
    program: PathBuf,
    arguments: Vec<String>,
    namespace: Option<String>,
    environment: Vec<(String, String)>,
    /// Directory of the site file.
    pub dir: PathBuf,
    /// Its run directory.
    pub run_dir: PathBuf,
    /// The site file.
    file: PathBuf,
    /// The value of TOG_RUN_DIR.
    run_root: PathBuf,
    prefix: Option<String>,
    _scratch: Scratch,
}

impl Site {
    /// Starts a site from a site file with a line `name = ".."`.
    pub fn start(toml: &str) -> Self {
        Setup::new(toml).start()
    }

    /// Starts `tog demo`.
    pub fn demo() -> Self {
        let scratch = Scratch::new();
        let run_root = scratch.0.join("r");
        let mut command = tog(&run_root, ["demo"]);
        command.env("TMPDIR", &scratch.0);
        let running = Running::start(command);
        let pid = running.pid();
        let dir = scratch.0.join(format!("tog-demo-{pid}"));
        Self {
            running: Some(running),
            program: binary(),
            arguments: Vec::new(),
            namespace: None,
            environment: Vec::new(),
            file: dir.join("demo.toml"),
            run_dir: run_root.join(format!("demo-{pid}")),
            run_root,
            prefix: None,
            dir,
            _scratch: scratch,
        }
    }

    /// Starts it once more, after its end: a supervisor that still runs is killed, and waited for, since
    /// it holds the lock of the site until it is gone.
    pub fn start_again(&mut self) {
        self.running = None;
        let file = self.file().to_str().unwrap().to_owned();
        let arguments = ["run".to_owned(), file].into_iter().chain(self.arguments.iter().cloned());
        let mut command = command_of(&self.program, &self.run_root(), arguments);
        command.envs(self.environment.iter().map(|(name, value)| (name, value)));
        let command = match &self.namespace {
            Some(name) => lan::within(name, &command),
            None => command,
        };
        self.running = Some(Running::start(command));
    }

    /// The next start is one of another program: an upgrade.
    pub fn upgrade(&mut self, program: &Path) {
        program.clone_into(&mut self.program);
    }

    /// The site file.
    pub fn file(&self) -> PathBuf {
        self.file.clone()
    }

    /// The value of TOG_RUN_DIR.
    pub fn run_root(&self) -> PathBuf {
        self.run_root.clone()
    }

    /// Its supervisor.
    pub fn running(&self) -> &Running {
        self.running.as_ref().unwrap()
    }

    /// Its log.
    pub fn log(&self) -> Arc<Lines> {
        Arc::clone(&self.running().log)
    }

    /// Runs another verb on its site file to the end: `site.tog(&["status"], &["--format", "json"])`.
    pub fn tog(&self, verb: &[&str], options: &[&str]) -> Output {
        self.command(verb, options).output().unwrap()
    }

    /// Starts another verb on its site file.
    pub fn follow(&self, verb: &[&str], options: &[&str]) -> Running {
        Running::start(self.command(verb, options))
    }

    fn command(&self, verb: &[&str], options: &[&str]) -> Command {
        let mut command = command_of(&self.program, &self.run_root(), verb);
        command.arg(self.file()).args(options);
        command
    }

    /// What the supervisor says now, if it answers.
    pub fn status(&mut self) -> Option<StatusReport> {
        let report = supervisor::status(self.run_dir.to_str().unwrap()).ok()?;
        if self.prefix.is_none() {
            self.prefix = ::process::Instance::load(&self.run_dir).ok().map(|i| i.prefix);
        }
        Some(report)
    }

    /// Looks at the status until `pass` returns something.
    pub fn wait_until<T>(&mut self, what: &str, pass: impl FnMut(&StatusReport) -> Option<T>) -> T {
        self.wait_until_within(what, WATCHDOG, pass)
    }

    /// As [`Site::wait_until`], for what takes long even if nothing is wrong.
    pub fn wait_until_within<T>(
        &mut self,
        what: &str,
        watchdog: Duration,
        mut pass: impl FnMut(&StatusReport) -> Option<T>,
    ) -> T {
        let (start, log) = (Instant::now(), self.log());
        let mut last = None;
        loop {
            if let Some(report) = self.status() {
                if let Some(value) = pass(&report) {
                    return value;
                }
                last = Some(report);
            }
            let ended = self.running.as_mut().unwrap().try_wait();
            if ended.is_some() || start.elapsed() >= watchdog {
                let table = last.map(|report| report.table()).unwrap_or_default();
                panic!("{what} never came ({ended:?}):\n{}\n{table}", log.text());
            }
            log.wait_a_moment(LOOK);
        }
    }

    /// Waits until every process runs and nothing is wrong.
    pub fn wait_until_healthy(&mut self) -> StatusReport {
        self.wait_until("health", |report| report.is_healthy().then(|| report.clone()))
    }

    /// Waits until every process is well *and* data flows through all of them: after this moment, each
    /// area's anomaly service has taken `frames` more class maps.
    pub fn wait_until_frames_flow(&mut self, frames: u64) -> StatusReport {
        let before = self.wait_until_healthy();
        self.wait_until("frames through the whole site", |report| {
            let flows = |service: &ServiceStatus| {
                let last = find(&before, &service.name);
                let since = if last.pid == service.pid { count(last, "class_maps_in") } else { 0 };
                count(service, "class_maps_in") >= since + frames
            };
            let mut watches = report.services.iter().filter(|s| s.name.starts_with("anomaly"));
            (report.is_healthy() && watches.all(flows)).then(|| report.clone())
        })
    }

    /// The process id of a service, once it runs.
    pub fn pid_of(&mut self, service: &str) -> u32 {
        self.wait_until(service, |report| find(report, service).pid)
    }

    /// Sends a signal to a service, once it runs; returns its process id.
    pub fn kill(&mut self, service: &str, signal: Signal) -> u32 {
        let pid = self.pid_of(service);
        kill(pid, signal);
        pid
    }

    /// SIGTERM, then [`Site::wait_end`]; the code must be 0.
    pub fn stop(&mut self) -> String {
        self.status();
        self.running().signal(Signal::TERM);
        let (code, log) = self.wait_end();
        assert_eq!(code, Some(0), "{log}");
        log
    }

    /// Waits for the end of the supervisor, whatever it leaves; its exit code, none if a signal ended
    /// it.
    pub fn wait_end_of_run(&mut self) -> Option<i32> {
        self.running.as_mut().unwrap().wait().code()
    }

    /// Waits for the end by itself: no process, no shared memory, no run directory is left. The exit
    /// code, and the log.
    pub fn wait_end(&mut self) -> (Option<i32>, String) {
        let code = self.wait_end_of_run();
        let log = self.log().text();
        self.assert_nothing_is_left(&log);
        (code, log)
    }

    /// No process, no shared memory, no run directory.
    pub fn assert_nothing_is_left(&self, log: &str) {
        let mut left = String::new();
        for pid in processes_of(&self.run_dir) {
            let _ = writeln!(left, "process {pid}");
        }
        for path in self.prefix.iter().flat_map(|prefix| shared_memory(prefix)) {
            let _ = writeln!(left, "{}", path.display());
        }
        for entry in fs::read_dir(self.run_root()).into_iter().flatten().flatten() {
            let _ = writeln!(left, "{}", entry.path().display());
        }
        assert!(left.is_empty(), "left behind:\n{left}\n{log}");
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        self.status();
        self.running = None;
        for pid in processes_of(&self.run_dir) {
            kill(pid, Signal::KILL);
        }
        for path in self.prefix.iter().flat_map(|prefix| shared_memory(prefix)) {
            let _ = fs::remove_file(path);
        }
    }
}

/// A service of a report.
pub fn find<'a>(report: &'a StatusReport, service: &str) -> &'a ServiceStatus {
    let found = report.services.iter().find(|other| other.name == service);
    found.unwrap_or_else(|| panic!("there is no {service}"))
}

/// The text of a fault of a service, if it has that fault.
pub fn fault(report: &StatusReport, service: &str, code: &str) -> Option<String> {
    let mut faults = find(report, service).faults.iter();
    faults.find(|fault| fault.code == code).map(|fault| fault.text.clone())
}

/// A counter of a service.
pub fn count(service: &ServiceStatus, counter: &str) -> u64 {
    service.counters.get(counter).copied().unwrap_or(0)
}

/// The process id of each service that runs.
pub fn pids(report: &StatusReport) -> BTreeMap<String, u32> {
    report.services.iter().filter_map(|s| Some((s.name.clone(), s.pid?))).collect()
}
