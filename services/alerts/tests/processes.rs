//! The service and the journal in real processes, killed at any moment. Every test has its own
//! directory and domain. The processes are this test binary itself in a role, see [`role`].
//! Nothing is timed: conditions are waited for, under a watchdog.
#![allow(clippy::unwrap_used)]

use alerts::{Format, Journal, WatchOptions};
use process::domain::{Owner, OwnerOptions};
use process::{Clock, EventLoop, Failure, Interest, Role, Worker};
use protocol::codec::{decode, encode};
use protocol::event::{EventAcknowledgement, EventChange, EventHeader, EventKind, EventState};
use protocol::site::Site;
use protocol::topic;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

/// Nothing here takes longer than seconds; a machine that is busy with other work may be slow.
const WATCHDOG: Duration = Duration::from_secs(120);
const ROLE: &str = "TOG_ALERTS_TEST_ROLE";
const DIRECTORY: &str = "TOG_ALERTS_TEST_DIRECTORY";
const COUNT: &str = "TOG_ALERTS_TEST_COUNT";

/// Not a test by itself: what a child process of the other tests does. Without a role, nothing.
#[test]
fn role() {
    let Ok(role) = std::env::var(ROLE) else { return };
    let directory = PathBuf::from(std::env::var_os(DIRECTORY).unwrap());
    let count = std::env::var(COUNT).map_or(0, |count| count.parse().unwrap());
    match role.as_str() {
        "append" => append_for_ever(&directory),
        "own" => own(&directory),
        "alerts" => end(process::run(Role::Alerts, &directory, alerts::run)),
        "origin" => end(process::run(Role::Anomaly { area: "a".into() }, &directory, |worker| {
            originate(worker, count)
        })),
        "watch" => watch(&directory),
        other => panic!("unknown role {other}"),
    }
}

fn end(code: ExitCode) {
    let code = if code == ExitCode::SUCCESS { 0 } else { 1 };
    std::process::exit(code);
}

fn say(line: &str) {
    let mut out = std::io::stdout();
    let _ = writeln!(out, "> {line}").and_then(|()| out.flush()); // a parent that went away
}

struct Process {
    child: Child,
    lines: Receiver<String>,
    name: String,
}

impl Process {
    fn start(role: &str, directory: &Path, count: u64) -> Self {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "role", "--nocapture", "--test-threads=1"])
            .env(ROLE, role)
            .env(DIRECTORY, directory)
            .env(COUNT, count.to_string())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let stdout = BufReader::new(child.stdout.take().unwrap());
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            // The harness of the child says a few lines of its own.
            for line in stdout.lines().map_while(Result::ok) {
                if let Some((_, line)) = line.split_once("> ") {
                    let _ = sender.send(line.to_owned());
                }
            }
        });
        Self { child, lines, name: role.to_owned() }
    }

    fn line(&self) -> String {
        self.lines.recv_timeout(WATCHDOG).unwrap_or_else(|e| panic!("{}: {e}", self.name))
    }

    fn line_after(&self, prefix: &str) -> String {
        loop {
            if let Some(rest) = self.line().strip_prefix(prefix) {
                return rest.to_owned();
            }
        }
    }

    fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    fn terminate(mut self) -> Option<i32> {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, rustix::process::Signal::TERM).unwrap();
        while self.lines.recv_timeout(WATCHDOG).is_ok() {}
        self.child.wait().unwrap().code()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if self.name == "own" {
            // An owner that ends by itself leaves nothing in shared memory.
            drop(self.child.stdin.take());
            while self.lines.recv_timeout(WATCHDOG).is_ok() {}
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn change(sequence: u64) -> EventChange {
    EventChange {
        origin: "a".to_owned(),
        sequence,
        id: format!("a-{sequence}"),
        kind: EventKind::Loitering,
        state: EventState::Raised,
        stamp_ns: 1_794_976_001_000_000_000,
        first_evidence_ns: 1_794_976_000_000_000_000,
        area: "a".to_owned(),
        zone: None,
        x_m: 0.1 * sequence as f64,
        y_m: 2.0,
        bounds_m: [0.0, 1.0, 2.0, 3.0],
        score: 2.0,
        threshold: 1.0,
        extrapolated: false,
        text: "somebody stays here".to_owned(),
    }
}

fn append_for_ever(directory: &Path) {
    let (mut journal, damage) = Journal::open(&directory.join("journal.sqlite3"), 1).unwrap();
    assert_eq!(damage, None);
    loop {
        let next = journal.highest_contiguous("a").unwrap() + 1;
        journal.append(&[change(next), change(next + 1)], 1).unwrap();
        say(&format!("{}", next + 1));
    }
}

#[test]
fn a_kill_in_the_middle_of_appends_loses_no_row_that_was_confirmed() {
    let directory = tempfile::tempdir().unwrap();
    let mut confirmed = 0;
    for round in 0..12 {
        let mut process = Process::start("append", directory.path(), 0);
        for _ in 0..(round * 5) % 17 {
            confirmed = process.line().parse().unwrap();
        }
        process.kill();
        while let Ok(line) = process.lines.recv_timeout(WATCHDOG) {
            confirmed = line.parse().unwrap();
        }
        let (journal, damage) =
            Journal::open(&directory.path().join("journal.sqlite3"), 1).unwrap();
        assert_eq!(damage, None);
        let contiguous = journal.highest_contiguous("a").unwrap();
        assert!(contiguous >= confirmed, "{contiguous} of {confirmed}");
        assert_eq!(contiguous % 2, 0, "a transaction is all or nothing");
        let rows = journal.after(0, 1_000_000).unwrap();
        let sequences: Vec<u64> = rows.iter().map(|row| row.change().unwrap().sequence).collect();
        assert_eq!(sequences, (1..=contiguous).collect::<Vec<_>>());
    }
    assert!(confirmed > 20);
}

fn site() -> Site {
    serde_json::from_value(serde_json::json!({
        "name": "s",
        "timezone": "Europe/Berlin",
        "area": [{ "id": "a", "origin_m": [0.0, 0.0], "columns": 4, "rows": 3 }],
        "laser": [{ "id": "l", "area": "a", "x_m": 0.0, "y_m": 0.0,
            "source": { "kind": "replay", "recording": "none.mcap" } }],
    }))
    .unwrap()
}

fn own(run_root: &Path) {
    process::logging::start();
    let events = EventLoop::new().unwrap();
    let stdin = std::io::stdin();
    events.watch(&stdin, Interest::Read).unwrap();
    let options = OwnerOptions {
        host: None,
        run_root: run_root.to_path_buf(),
        base_dir: run_root.to_path_buf(),
        out_dir: None,
        clock: Clock::Wall,
    };
    let owner = Owner::start(&site(), &options).unwrap();
    say(&format!("up {}", owner.instance().run_dir.display()));
    loop {
        let wake = events.wait(None).unwrap();
        while events.next_ready().is_some() {
            // A byte is the wish to sweep, the end is the end.
            if std::io::stdin().read(&mut [0]).unwrap() == 0 {
                return;
            }
            owner.sweep();
            say("swept");
        }
        if wake.stop {
            return;
        }
    }
}

/// Sends `count` changes and keeps what is not acknowledged; sends it again when an acknowledgement
/// comes from a new service (another session), or does not get on: the contract of an origin.
fn originate(worker: &mut Worker, count: u64) -> Result<(), Failure> {
    let mut changes = worker.bus.publisher(&topic::event(), 0)?;
    let mut acknowledgements = worker.bus.subscriber(&topic::event_acknowledgement())?;
    let (mut sent, mut acknowledged, mut session) = (0, 0, 0);
    // A message that is none, among those that are.
    changes.send(EventHeader::default(), b"garbage")?;
    let mut publish = |sequence| {
        let bytes = encode(&change(sequence)).map_err(|e| Failure::Failed(e.to_string()))?;
        Ok::<(), Failure>(changes.send(EventHeader::default(), &bytes)?)
    };
    loop {
        while let Some(message) = acknowledgements.receive()? {
            let Ok(ack) = decode::<EventAcknowledgement>(message.payload()) else { continue };
            if ack.origin != "a" {
                continue;
            }
            // A new service may have got nothing of what its predecessor was sent; an old one that
            // does not get on misses something.
            let is_new =
                std::mem::replace(&mut session, message.header().envelope.session) != session;
            let is_stuck = ack.sequence == acknowledged;
            acknowledged = acknowledged.max(ack.sequence);
            if is_new || is_stuck {
                for sequence in acknowledged + 1..=sent {
                    publish(sequence)?;
                }
            }
        }
        if sent < count && sent < acknowledged + 8 {
            sent += 1;
            publish(sent)?;
            say(&format!("sent {sent}"));
            continue;
        }
        if acknowledged == count {
            say("all acknowledged");
        }
        if worker.wait(None)?.stop {
            return Ok(());
        }
    }
}

struct Instance {
    owner: Process,
    run_dir: PathBuf,
    journal: PathBuf,
    _root: tempfile::TempDir,
}

impl Instance {
    fn start() -> Self {
        let root = tempfile::Builder::new().prefix("t").tempdir_in("/tmp").unwrap();
        let owner = Process::start("own", root.path(), 0);
        let run_dir = PathBuf::from(owner.line_after("up "));
        let journal = root.path().join("state/journal.sqlite3");
        Self { owner, run_dir, journal, _root: root }
    }

    fn sweep(&mut self) {
        self.owner.child.stdin.as_mut().unwrap().write_all(b"s").unwrap();
        self.owner.line_after("swept");
    }
}

fn watch(run_dir: &Path) {
    let events = EventLoop::new().unwrap();
    let options = WatchOptions {
        site: "lab".to_owned(),
        journal: run_dir.join(alerts::JOURNAL_FILE), // counted at the start only, and not needed
        socket: run_dir.join(alerts::SOCKET_FILE),
        timezone: "Europe/Berlin".to_owned(),
        format: Format::Text,
        after: Some(0),
    };
    struct Lines;
    impl Write for Lines {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            let mut out = std::io::stdout();
            out.write_all(b"> ")?;
            out.write_all(bytes)?;
            Ok(bytes.len())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            std::io::stdout().flush()
        }
    }
    let mut out = std::io::LineWriter::new(Lines);
    alerts::watch(&options, &events, &mut out, &mut std::io::stderr()).unwrap();
    std::process::exit(0);
}

/// Connects as soon as the service listens.
fn connect(run_dir: &Path) -> UnixStream {
    let began = std::time::Instant::now();
    loop {
        match UnixStream::connect(run_dir.join(alerts::SOCKET_FILE)) {
            Ok(stream) => return stream,
            Err(error) => assert!(began.elapsed() < WATCHDOG, "no feed: {error}"),
        }
        std::thread::yield_now();
    }
}

#[test]
fn a_service_that_is_killed_again_and_again_tells_every_change_once() {
    const CHANGES: u64 = 120;
    let mut instance = Instance::start();
    let mut service = Process::start("alerts", &instance.run_dir, 0);
    drop(connect(&instance.run_dir));
    let watcher = Process::start("watch", &instance.run_dir, 0);
    let origin = Process::start("origin", &instance.run_dir, CHANGES);
    for kill_at in [1, 9, 10, 40, 77, CHANGES] {
        origin.line_after(&format!("sent {kill_at}"));
        service.kill();
        instance.sweep();
        service = Process::start("alerts", &instance.run_dir, 0);
    }
    origin.line_after("all acknowledged");
    for sequence in 1..=CHANGES {
        let line = watcher.line();
        assert!(line.contains("  ALERT loitering: "), "{line}");
        assert!(line.ends_with(&format!("[a-{sequence}]")), "{line} instead of {sequence}");
        assert!(line.contains("05:26:41 CET"), "{line}");
    }
    assert_eq!(watcher.terminate(), Some(0));
    assert_eq!(service.terminate(), Some(0));
    assert_eq!(origin.terminate(), Some(0));
    let journal = Journal::open_read_only(&instance.journal).unwrap();
    let rows = journal.after(0, 9999).unwrap();
    let sequences: Vec<u64> = rows.iter().map(|row| row.change().unwrap().sequence).collect();
    assert_eq!(sequences, (1..=CHANGES).collect::<Vec<_>>());
    assert!(!instance.run_dir.join(alerts::SOCKET_FILE).exists(), "the socket is removed");
}

#[test]
fn the_socket_is_private_refuses_garbage_and_has_a_last_place() {
    use std::os::unix::fs::PermissionsExt;
    let instance = Instance::start();
    let service = Process::start("alerts", &instance.run_dir, 0);
    let mut bad = connect(&instance.run_dir);
    let socket = instance.run_dir.join(alerts::SOCKET_FILE);
    let mode = std::fs::metadata(&socket).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o600);
    bad.set_read_timeout(Some(WATCHDOG)).unwrap();
    bad.write_all(b"\xff\xfe no json\n").unwrap();
    let mut said = String::new();
    bad.read_to_string(&mut said).unwrap();
    assert!(said.contains("cannot understand"), "{said}");

    let clients: Vec<UnixStream> = (0..alerts::feed::CLIENTS_MAX)
        .map(|_| {
            let mut client = connect(&instance.run_dir);
            client.set_read_timeout(Some(WATCHDOG)).unwrap();
            client.write_all(b"{\"after\":null}\n").unwrap();
            let mut line = String::new();
            BufReader::new(&client).read_line(&mut line).unwrap();
            assert!(line.contains("\"feed\":1"), "{line}");
            client
        })
        .collect();
    let mut surplus = connect(&instance.run_dir);
    surplus.set_read_timeout(Some(WATCHDOG)).unwrap();
    let mut said = String::new();
    surplus.read_to_string(&mut said).unwrap();
    assert!(said.contains("all 32 places"), "{said}");
    drop(clients);
    assert_eq!(service.terminate(), Some(0));
}

#[test]
fn a_watch_without_a_service_says_what_to_do() {
    let options = WatchOptions {
        site: "lab".to_owned(),
        journal: PathBuf::from("/nonexistent/journal.sqlite3"),
        socket: PathBuf::from("/nonexistent/alerts.sock"),
        timezone: "UTC".to_owned(),
        format: Format::Text,
        after: None,
    };
    let events = EventLoop::new().unwrap();
    let error = alerts::watch(&options, &events, &mut Vec::new(), &mut Vec::new()).unwrap_err();
    assert!(error.to_string().contains("`tog run SITE`"), "{error}");
}

#[test]
fn a_watch_whose_site_is_gone_with_its_state_ends_and_says_so() {
    let root = tempfile::tempdir().unwrap();
    let socket = root.path().join(alerts::SOCKET_FILE);
    let listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    let service = std::thread::spawn(move || drop(listener.accept().unwrap()));
    let options = WatchOptions {
        site: "lab".to_owned(),
        journal: root.path().join("state/journal.sqlite3"),
        socket,
        timezone: "UTC".to_owned(),
        format: Format::Text,
        after: None,
    };
    let (events, mut notes) = (EventLoop::new().unwrap(), Vec::new());
    let error = alerts::watch(&options, &events, &mut Vec::new(), &mut notes).unwrap_err();
    service.join().unwrap();
    assert!(error.to_string().ends_with("state is gone"), "{error}");
    let notes = String::from_utf8(notes).unwrap();
    assert!(notes.starts_with("following lab\n"), "{notes}");
}
