//! Shared memory between real processes: every test has its own run root and domain, so they run side
//! by side. Nothing is timed: a condition is waited for, under a watchdog that kills what hangs.
#![allow(clippy::unwrap_used)]

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

/// Nothing here takes longer than seconds; a machine that is busy with other work may be slow.
const WATCHDOG: Duration = Duration::from_secs(60);

/// How long a process that a failed test leaves may take to end.
const PATIENCE: Duration = Duration::from_secs(5);

struct Probe {
    child: Child,
    stdin: Option<ChildStdin>,
    lines: Receiver<String>,
    role: String,
}

impl Probe {
    fn start(arguments: &[&str], dir: &Path) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_bus-probe"))
            .arg(arguments[0])
            .arg(dir)
            .args(&arguments[1..])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let stdin = child.stdin.take();
        let stdout = BufReader::new(child.stdout.take().unwrap());
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in stdout.lines().map_while(Result::ok) {
                let _ = sender.send(line);
            }
        });
        Self { child, stdin, lines, role: arguments.join(" ") }
    }

    fn line(&self) -> String {
        self.lines.recv_timeout(WATCHDOG).unwrap_or_else(|e| panic!("{}: {e}", self.role))
    }

    fn signal(&self, signal: rustix::process::Signal) {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, signal).unwrap();
    }

    fn exit_code(mut self) -> Option<i32> {
        drop(self.stdin.take());
        // End of stdout is the end of the process; the channel closes with it.
        while self.lines.recv_timeout(WATCHDOG).is_ok() {}
        self.child.wait().unwrap().code()
    }
}

impl Drop for Probe {
    /// Lets it end by itself, so that an owner removes what is its own; kills it if it does not.
    fn drop(&mut self) {
        drop(self.stdin.take());
        if matches!(self.child.try_wait(), Ok(None)) {
            let pid = rustix::process::Pid::from_child(&self.child);
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
            while self.lines.recv_timeout(PATIENCE).is_ok() {}
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

struct Domain {
    owner: Probe,
    run_dir: PathBuf,
    root: tempfile::TempDir,
}

fn short_temporary_dir() -> tempfile::TempDir {
    tempfile::Builder::new().prefix("t").tempdir_in("/tmp").unwrap()
}

fn domain(pace: &str) -> Domain {
    let root = short_temporary_dir();
    let owner = Probe::start(&["own", pace], root.path());
    let up = owner.line();
    let run_dir = PathBuf::from(up.strip_prefix("up ").unwrap_or_else(|| panic!("{up}")));
    Domain { owner, run_dir, root }
}

fn start_up(arguments: &[&str], domain: &Domain) -> Probe {
    let probe = Probe::start(arguments, &domain.run_dir);
    assert_eq!(probe.line(), "up");
    probe
}

fn prefix(run_dir: &Path) -> String {
    process::Instance::load(run_dir).unwrap().prefix
}

fn in_shared_memory(prefix: &str) -> Vec<String> {
    std::fs::read_dir("/dev/shm")
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .filter(|name| name.starts_with(prefix))
        .collect()
}

/// The number behind `key` in a line of the probe.
fn number(line: &str, key: &str) -> u64 {
    let mut words = line.split_whitespace().skip_while(|word| *word != key);
    words.nth(1).and_then(|word| word.parse().ok()).unwrap_or_else(|| panic!("{key} in {line}"))
}

#[test]
fn scans_of_another_process_arrive_whole_and_in_order() {
    let domain = domain("real_time");
    let receiver = start_up(&["receive"], &domain);
    let _sender = start_up(&["send", "200", "1000"], &domain);
    let line = receiver.line();
    assert_eq!(number(&line, "received"), 200, "{line}");
    assert_eq!(number(&line, "lost") + number(&line, "disordered"), 0, "{line}");
    assert_eq!(receiver.exit_code(), Some(0));
}

#[test]
fn what_overflows_is_counted_to_the_message() {
    let domain = domain("real_time");
    let holder = start_up(&["hold"], &domain);
    let sender = start_up(&["send", "200", "0"], &domain);
    assert_eq!(sender.line(), "sent 200");
    let mut holder = holder;
    drop(holder.stdin.take());
    // It never connected before: the buffer holds the newest 64, of a session that it did not see.
    let line = holder.line();
    assert_eq!(number(&line, "received"), 64, "{line}");
    assert!(line.ends_with("first Some(136)"), "{line}");
}

#[test]
fn a_restarted_publisher_is_not_a_loss() {
    let domain = domain("real_time");
    let receiver = start_up(&["receive"], &domain);
    for _ in 0..3 {
        let sender = start_up(&["send", "1000000", "1000"], &domain);
        sender.signal(rustix::process::Signal::KILL);
        assert_eq!(sender.exit_code(), None);
    }
    let _sender = start_up(&["send", "50", "1000"], &domain);
    let line = receiver.line();
    assert_eq!(number(&line, "lost") + number(&line, "disordered"), 0, "{line}");
    assert!(number(&line, "received") >= 50, "{line}");
}

#[test]
fn credit_never_loses_a_scan_at_full_speed() {
    let domain = domain("lossless");
    // The publisher is first: it waits for its reader.
    let sender = start_up(&["send", "20000", "0"], &domain);
    let receiver = start_up(&["receive"], &domain);
    let line = receiver.line();
    assert_eq!(number(&line, "received"), 20000, "{line}");
    assert_eq!(number(&line, "lost") + number(&line, "disordered"), 0, "{line}");
    assert_eq!(sender.line(), "sent 20000");
}

#[test]
fn a_lossless_reader_that_is_killed_does_not_stall_the_publisher() {
    let domain = domain("lossless");
    let sender = start_up(&["send", "20000", "100"], &domain);
    for _ in 0..3 {
        let receiver = start_up(&["receive"], &domain);
        receiver.signal(rustix::process::Signal::KILL);
        assert_eq!(receiver.exit_code(), None);
    }
    let receiver = start_up(&["receive"], &domain);
    let line = receiver.line();
    assert_eq!(number(&line, "lost") + number(&line, "disordered"), 0, "{line}");
    assert_eq!(sender.line(), "sent 20000");
}

#[test]
fn both_signals_end_a_waiting_worker() {
    let domain = domain("real_time");
    for signal in [rustix::process::Signal::TERM, rustix::process::Signal::INT] {
        let receiver = start_up(&["receive"], &domain);
        receiver.signal(signal);
        assert_eq!(receiver.line(), "stopped");
        assert_eq!(receiver.exit_code(), Some(0));
    }
}

#[test]
fn a_flood_does_not_keep_a_reader_from_its_signals() {
    let domain = domain("real_time");
    let receiver = start_up(&["receive"], &domain);
    let sender = start_up(&["send", "1000000000", "0"], &domain);
    receiver.signal(rustix::process::Signal::TERM);
    assert_eq!(receiver.line(), "stopped");
    sender.signal(rustix::process::Signal::KILL); // it never waits: nothing holds it up
}

/// What iceoryx2 0.10.0 does to itself now and then: `services/process/src/doorbell.rs`.
#[test]
fn a_ring_that_went_unheard_is_made_up_for() {
    let domain = domain("real_time");
    let deaf = start_up(&["swallow"], &domain);
    let _sender = start_up(&["send", "2", "0"], &domain);
    assert_eq!(deaf.line(), "swallowed");
    assert!(number(&deaf.line(), "received") >= 1);
    assert_eq!(deaf.exit_code(), Some(0));
}

#[test]
fn a_bell_that_many_rang_at_once_is_silent_afterwards() {
    let domain = domain("real_time");
    let mut probe = start_up(&["stuffed"], &domain);
    let ringer = std::os::unix::net::UnixDatagram::unbound().unwrap();
    let bells = std::fs::read_dir(domain.run_dir.join("x")).unwrap();
    let bells = bells.map(|entry| entry.unwrap().path());
    for bell in bells.filter(|path| path.extension().is_some_and(|name| name == "event")) {
        for _ in 0..5 {
            ringer.send_to(&[0], &bell).unwrap();
        }
    }
    drop(probe.stdin.take());
    assert_eq!(probe.line(), "rang true then false");
}

#[test]
fn a_waiting_process_sleeps() {
    let domain = domain("real_time");
    let idle = start_up(&["idle", "3"], &domain);
    let line = idle.line();
    let wakes: u64 = line.split(' ').nth(3).unwrap().parse().unwrap();
    assert!(wakes <= 4, "it wakes for its health and for nothing else: {line}");
}

#[test]
fn a_clean_end_leaves_nothing() {
    let Domain { owner, run_dir, root } = domain("real_time");
    let prefix = prefix(&run_dir);
    assert!(!in_shared_memory(&prefix).is_empty(), "else this test shows nothing");
    assert_eq!(owner.exit_code(), Some(0));
    assert_eq!(in_shared_memory(&prefix), Vec::<String>::new());
    let left = std::fs::read_dir(root.path()).unwrap().map(|entry| entry.unwrap().file_name());
    assert_eq!(left.collect::<Vec<_>>(), ["state"], "what was learnt stays");
}

#[test]
fn the_longest_run_directory_works_and_a_longer_one_is_refused() {
    let dir = short_temporary_dir();
    let fill =
        process::instance::RUN_DIR_BYTES_MAX - dir.path().as_os_str().len() - "//probe".len();
    let root = dir.path().join("r".repeat(fill));
    let owner = Probe::start(&["own"], &root);
    let up = owner.line();
    let run_dir = PathBuf::from(up.strip_prefix("up ").unwrap_or_else(|| panic!("{up}")));
    assert_eq!(run_dir.as_os_str().len(), process::instance::RUN_DIR_BYTES_MAX);
    let receiver = Probe::start(&["receive"], &run_dir);
    assert_eq!(receiver.line(), "up");
    drop(receiver);
    assert_eq!(owner.exit_code(), Some(0));
    let refused = Probe::start(&["own"], &dir.path().join("r".repeat(fill + 1)));
    let line = refused.line();
    assert!(line.contains("bytes long"), "{line}");
}

#[test]
fn a_second_owner_is_refused_in_words() {
    let domain = domain("real_time");
    let second = Probe::start(&["own"], domain.root.path());
    let line = second.line();
    let pid = domain.owner.child.id().to_string();
    assert!(line.contains("already runs") && line.contains(&pid), "{line}");
    assert_eq!(second.exit_code(), Some(1));
    // And the first is not harmed.
    let receiver = start_up(&["receive"], &domain);
    let _sender = start_up(&["send", "10", "0"], &domain);
    assert_eq!(number(&receiver.line(), "received"), 10);
}

#[test]
fn workers_stop_when_their_owner_is_killed_and_the_next_owner_wipes_the_rest() {
    let Domain { owner, run_dir, root } = domain("real_time");
    let prefix = prefix(&run_dir);
    let receiver = Probe::start(&["receive"], &run_dir);
    assert_eq!(receiver.line(), "up");
    let stray = format!("/dev/shm/{prefix}stray");
    std::fs::write(&stray, "of a process that was killed").unwrap();
    owner.signal(rustix::process::Signal::KILL);
    assert_eq!(owner.exit_code(), None);
    assert_eq!(receiver.line(), "stopped");
    assert_eq!(receiver.exit_code(), Some(0));
    assert!(!in_shared_memory(&prefix).is_empty());

    let owner = Probe::start(&["own"], root.path());
    assert!(owner.line().starts_with("up "));
    assert!(!Path::new(&stray).exists());
    let receiver = Probe::start(&["receive"], &run_dir);
    assert_eq!(receiver.line(), "up");
    let sender = Probe::start(&["send", "10", "0"], &run_dir);
    assert_eq!(sender.line(), "up");
    assert_eq!(number(&receiver.line(), "received"), 10);
    drop(sender);
    assert_eq!(owner.exit_code(), Some(0));
    assert_eq!(in_shared_memory(&prefix), Vec::<String>::new());
}

#[test]
fn a_worker_without_an_owner_says_so() {
    let Domain { mut owner, run_dir, root: _root } = domain("real_time");
    owner.child.kill().unwrap();
    owner.child.wait().unwrap();
    let mut worker = Command::new(env!("CARGO_BIN_EXE_bus-probe"))
        .args(["receive", run_dir.to_str().unwrap()])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut text = String::new();
    worker.stderr.take().unwrap().read_to_string(&mut text).unwrap();
    assert!(text.contains("no supervisor runs the site probe"), "{text}");
    assert_eq!(worker.wait().unwrap().code(), Some(1));
    let prefix = prefix(&run_dir);
    for name in in_shared_memory(&prefix) {
        std::fs::remove_file(Path::new("/dev/shm").join(name)).unwrap();
    }
}
