//! A site of real processes under a real supervisor. Each test has its own run root, so they run side
//! by side. Nothing is timed: conditions are waited for, under a watchdog.
#![allow(clippy::unwrap_used)]

use rustix::process::{Pid, Signal, kill_process};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};
use supervisor::{ProcessState, StatusReport, status_in};

const WATCHDOG: Duration = Duration::from_secs(90);
/// How often a condition is looked at.
const LOOK: Duration = Duration::from_millis(10);

struct Run {
    child: Child,
    lines: Receiver<String>,
    seen: Vec<String>,
    name: String,
    root: tempfile::TempDir,
}

impl Run {
    fn start(name: &str, seconds: &str) -> Self {
        let root = tempfile::Builder::new().prefix("t").tempdir_in("/tmp").unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_site-probe"))
            .arg("run")
            .arg(root.path())
            .args([name, seconds])
            .stdin(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let stderr = BufReader::new(child.stderr.take().unwrap());
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in stderr.lines().map_while(Result::ok) {
                let _ = sender.send(line);
            }
        });
        Self { child, lines, seen: Vec::new(), name: name.to_owned(), root }
    }

    /// Looks at a condition until it holds.
    fn wait_for<T>(&mut self, what: &str, mut condition: impl FnMut(&mut Self) -> Option<T>) -> T {
        let start = Instant::now();
        loop {
            if let Some(value) = condition(self) {
                return value;
            }
            assert!(start.elapsed() < WATCHDOG, "{what} never came:\n{}", self.seen.join("\n"));
            match self.lines.recv_timeout(LOOK) {
                Ok(line) => self.seen.push(line),
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {}
            }
        }
    }

    fn status(&self) -> Option<StatusReport> {
        status_in(&self.name, self.root.path()).ok()
    }

    fn wait_until_healthy(&mut self) -> StatusReport {
        self.wait_for("health", |run| run.status().filter(StatusReport::is_healthy))
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Waits for the end; returns the exit code and checks that nothing is left.
    fn end(mut self) -> (Option<i32>, String) {
        let code = self.wait_for("the end", |run| run.child.try_wait().unwrap()).code();
        while let Ok(line) = self.lines.recv_timeout(WATCHDOG) {
            self.seen.push(line);
        }
        let text = self.seen.join("\n");
        let left = left_in(self.root.path());
        assert!(left.is_empty(), "{left:?}\n{text}");
        assert_eq!(processes_of(self.root.path()), Vec::<u32>::new(), "{text}");
        (code, text)
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        for pid in processes_of(self.root.path()) {
            kill(pid, Signal::KILL);
        }
        remove_shared_memory(&self.root.path().join(&self.name));
    }
}

/// What a site leaves but should not: anything but its state.
fn left_in(root: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(root).unwrap().map(|entry| entry.unwrap().path());
    entries.filter(|path| path.file_name() != Some("state".as_ref())).collect()
}

/// Processes whose command line names the run root.
fn processes_of(root: &Path) -> Vec<u32> {
    let pids = std::fs::read_dir("/proc")
        .unwrap()
        .filter_map(|entry| entry.ok()?.file_name().to_str()?.parse::<u32>().ok());
    pids.filter(|pid| {
        let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        let line = String::from_utf8_lossy(&line).into_owned();
        line.contains("--instance") && line.contains(root.to_str().unwrap())
    })
    .collect()
}

/// Where a test killed the supervisor, nobody else cleans up.
fn remove_shared_memory(run_dir: &Path) {
    let Ok(instance) = process::Instance::load(run_dir) else { return };
    for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
        if entry.file_name().to_string_lossy().starts_with(&instance.prefix) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

fn pids(report: &StatusReport) -> BTreeMap<String, u32> {
    report.services.iter().filter_map(|s| Some((s.name.clone(), s.pid?))).collect()
}

fn kill(pid: u32, signal: Signal) {
    // It may be gone already: that is the supervisor's business.
    let _ = kill_process(Pid::from_raw(pid as i32).unwrap(), signal);
}

#[test]
fn a_site_ends_by_itself_after_its_seconds() {
    let (code, text) = Run::start("live", "1").end();
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("its time is over"), "{text}");
    assert!(!text.contains("killed"), "{text}");
}

#[test]
fn a_lossless_recording_passes_all_processes_and_ends_the_site() {
    let (code, text) = Run::start("recording", "").end();
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("anomaly a  passed 3000 lost 0"), "{text}");
    assert!(text.contains("the recording is over"), "{text}");
}

#[test]
fn a_killed_service_comes_back_and_the_others_never_stop() {
    let mut run = Run::start("live", "");
    let before = pids(&run.wait_until_healthy());
    assert_eq!(before.len(), 13);
    kill(before["mapper b"], Signal::KILL);
    let after = run.wait_for("its return", |run| {
        let report = run.status().filter(StatusReport::is_healthy)?;
        (report.services.iter().map(|s| s.restarts).sum::<u64>() == 1).then_some(report)
    });
    let back = after.services.iter().find(|s| s.name == "mapper b").unwrap();
    assert_eq!((back.restarts, back.last_end.as_deref()), (1, Some("signal 9")));
    let changed: Vec<_> = pids(&after).into_iter().filter(|(n, p)| before[n] != *p).collect();
    assert_eq!(changed, [("mapper b".to_owned(), back.pid.unwrap())]);
    run.wait_for("data through it", |run| {
        let report = run.status()?;
        let anomaly = report.services.iter().find(|s| s.name == "mapper b")?;
        (*anomaly.counters.get("received")? > 0).then_some(())
    });
    run.signal(Signal::INT);
    assert_eq!(run.end().0, Some(0));
}

#[test]
fn a_wrong_configuration_stops_the_site_and_is_named() {
    let (code, text) = Run::start("wrong", "").end();
    assert_eq!(code, Some(78), "{text}");
    assert!(text.contains("fusion a cannot run: its configuration is wrong"), "{text}");
    let last_words = text.split("Its last lines:").nth(1).unwrap();
    assert!(last_words.contains("the laser la sees nothing of the area a"), "{text}");
}

#[test]
fn a_service_that_never_gets_ready_stops_the_site_and_is_named() {
    let (code, text) = Run::start("broken", "").end();
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("mapper a cannot run: 5 failures in 10 s"), "{text}");
    let last_words = text.split("Its last lines:").nth(1).unwrap();
    assert!(last_words.contains("the checkpoint cannot be read"), "{text}");
}

#[test]
fn a_service_that_fails_after_it_was_ready_is_tried_for_ever() {
    let mut run = Run::start("flaky", "");
    run.wait_for("six attempts", |run| {
        let report = run.status()?;
        report.services.iter().any(|s| s.name == "mapper a" && s.restarts >= 5).then_some(())
    });
    run.signal(Signal::TERM);
    let (code, text) = run.end();
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("the frame is torn"), "{text}");
}

#[test]
fn visitors_who_talk_nonsense_or_nothing_do_not_disturb() {
    let mut run = Run::start("live", "");
    let socket = run.root.path().join("live/control.sock");
    run.wait_until_healthy();
    let mut silent = Vec::new();
    for n in 0..30 {
        // More than are served: those behind are turned away, which may break their pipe.
        let mut visitor = UnixStream::connect(&socket).unwrap();
        if n % 2 == 0 {
            let _ = visitor.write_all(&[b'x'; 5000]);
        }
        silent.push(visitor);
    }
    run.wait_for("an answer among them", |run| run.status());
    drop(silent);
    assert_eq!(run.wait_until_healthy().services.iter().map(|s| s.restarts).sum::<u64>(), 0);
    run.signal(Signal::TERM);
    assert_eq!(run.end().0, Some(0));
}

#[test]
fn a_state_directory_that_is_removed_is_told_and_a_second_writer_ends_the_site() {
    let mut run = Run::start("stateless", "1000");
    run.wait_until_healthy();
    let state_dir = run.root.path().join("state");
    std::fs::remove_dir_all(&state_dir).unwrap();
    run.wait_for("the loss", |run| {
        run.seen.iter().any(|line| line.contains("was removed while the site runs")).then_some(())
    });
    run.wait_for("the lock", |_| state_dir.join("lock").is_file().then_some(()));
    // The site may take a new directory before we do: then once more.
    let _second = run.wait_for("a directory of our own", |run| {
        std::fs::remove_dir_all(run.root.path().join("state")).ok()?;
        process::StateLock::take(&run.root.path().join("state")).ok()
    });
    let (code, text) = run.end();
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("Two writers would undo each other's work"), "{text}");
}

#[test]
fn who_asks_a_stopped_supervisor_is_told_how_it_goes_on() {
    let mut run = Run::start("halted", "1000");
    run.wait_until_healthy();
    run.signal(Signal::STOP);
    let error = status_in(&run.name, run.root.path()).unwrap_err().to_string();
    let remedy = format!("`kill -CONT {}`", run.child.id());
    assert!(error.contains(&remedy), "{error}");
    // Visitors whom it does not accept: the next one is not kept waiting for a place.
    let socket = run.root.path().join(&run.name).join("control.sock");
    let crowd: Vec<_> = std::iter::from_fn(|| visit(&socket)).collect();
    let error = status_in(&run.name, run.root.path()).unwrap_err().to_string();
    assert!(error.contains(&remedy), "{error}");
    drop(crowd);
    run.signal(Signal::CONT);
    run.wait_until_healthy();
    run.signal(Signal::TERM);
    assert_eq!(run.end().0, Some(0));
}

/// A connection, as long as there is a place in the queue of the socket.
fn visit(socket: &Path) -> Option<std::os::fd::OwnedFd> {
    use rustix::net::{
        AddressFamily, SocketAddrUnix, SocketFlags, SocketType, connect, socket_with,
    };
    let stream =
        socket_with(AddressFamily::UNIX, SocketType::STREAM, SocketFlags::NONBLOCK, None).unwrap();
    connect(&stream, &SocketAddrUnix::new(socket).unwrap()).ok()?;
    Some(stream)
}

#[test]
fn who_does_not_listen_is_killed_and_nothing_is_left() {
    let mut run = Run::start("deaf", "");
    let report = run.wait_until_healthy();
    kill(pids(&report)["laser la"], Signal::STOP);
    run.signal(Signal::TERM);
    let (code, text) = run.end();
    assert_eq!(code, Some(0), "{text}");
    for name in ["mapper a", "laser la"] {
        let killed = |line: &&str| line.contains(name) && line.contains("did not stop: killed");
        assert!(text.lines().any(|line| killed(&line)), "{name}\n{text}");
    }
}

#[test]
fn a_service_that_hangs_is_killed_and_comes_back() {
    let mut run = Run::start("live", "");
    let before = pids(&run.wait_until_healthy());
    kill(before["fusion a"], Signal::STOP);
    run.wait_for("its return", |run| {
        let report = run.status()?;
        let fusion = report.services.iter().find(|s| s.name == "fusion a")?;
        (fusion.state == ProcessState::Running && fusion.pid != Some(before["fusion a"]))
            .then_some(())
    });
    assert!(run.seen.iter().any(|line| line.contains("no sign of life")));
    run.signal(Signal::TERM);
    assert_eq!(run.end().0, Some(0));
}

#[test]
fn a_killed_supervisor_leaves_no_process_and_the_next_one_starts() {
    let mut run = Run::start("live", "");
    let report = run.wait_until_healthy();
    // Stopped, it cannot notice; if it is stopped by now, the kernel wakes it (an orphaned group).
    kill(pids(&report)["mapper a"], Signal::STOP);
    run.signal(Signal::KILL);
    run.wait_for("the end of the workers", |run| {
        (processes_of(run.root.path()).len() <= 1).then_some(())
    });
    let _ = run.child.wait();
    let root = run.root.path().to_str().unwrap().to_owned();
    let output = Command::new(env!("CARGO_BIN_EXE_site-probe"))
        .args(["run", &root, "live", "1"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(processes_of(run.root.path()), Vec::<u32>::new());
    assert_eq!(left_in(run.root.path()), Vec::<PathBuf>::new());
}

#[test]
fn fifty_kills_at_any_moment_heal_without_a_hand() {
    let mut run = Run::start("live", "");
    let mut random: u64 = 0x5eed;
    let mut killed = BTreeMap::<String, u32>::new();
    for _ in 0..50 {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        let pick = (random >> 33) as usize;
        // Whoever has a new process id: some are killed as they start, some later.
        let (name, pid) = run.wait_for("somebody to kill", |run| {
            let report = run.status()?;
            let alive = pids(&report).into_iter().filter(|(n, p)| killed.get(n) != Some(p));
            let alive: Vec<_> = alive.collect();
            (!alive.is_empty()).then(|| alive[pick % alive.len()].clone())
        });
        kill(pid, Signal::KILL);
        killed.insert(name, pid);
    }
    run.wait_until_healthy();
    let received = |report: &StatusReport| -> Vec<u64> {
        let anomalies = report.services.iter().filter(|s| s.name.starts_with("anomaly"));
        anomalies.map(|s| s.counters.get("received").copied().unwrap_or(0)).collect()
    };
    let before = received(&run.status().unwrap());
    run.wait_for("data in every area", |run| {
        let now = received(&run.status()?);
        now.iter().zip(&before).all(|(now, before)| *now > before + 20).then_some(())
    });
    run.signal(Signal::TERM);
    let (code, text) = run.end();
    assert_eq!(code, Some(0), "{text}");
}
