//! The status socket of the run directory: `status\n` in, one JSON document out, closed.

use crate::report::StatusReport;
use process::instance::{InstanceError, default_run_root, run_dir_of};
use process::{EventLoop, Instance, Interest, Token, monotonic_ns};
use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType, socket_with};
use std::io::{self, Read, Write};
use std::net::Shutdown;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::time::Duration;

/// Visitors at once: people and a monitoring agent. More are turned away.
const CONNECTIONS_MAX: usize = 16;
/// Longest request: there is one, and it is short.
const REQUEST_BYTES_MAX: usize = 64;
/// A visitor has so long to ask and to read, nanoseconds.
const PATIENCE_NS: u64 = 2_000_000_000;
/// Largest answer that a client takes: hundreds of services of some kB.
const REPORT_BYTES_MAX: u64 = 16 << 20;
/// How long a client waits for a supervisor that hangs.
const CLIENT_PATIENCE: Duration = Duration::from_secs(5);
const REQUEST: &[u8] = b"status\n";

/// The supervisor's side.
#[derive(Debug)]
pub struct Control {
    listener: UnixListener,
    token: Token,
    connections: Vec<Connection>,
}

#[derive(Debug)]
struct Connection {
    stream: UnixStream,
    token: Token,
    request: Vec<u8>,
    answer: Vec<u8>,
    written: usize,
    until_ns: u64,
}

impl Control {
    /// Listens on `path`, in a directory that only we can enter.
    ///
    /// # Errors
    /// If the socket cannot be made.
    pub fn listen(path: &Path, events: &EventLoop) -> io::Result<Self> {
        let listener = UnixListener::bind(path)?;
        listener.set_nonblocking(true)?;
        let token = events.watch(&listener, Interest::Read)?;
        Ok(Self { listener, token, connections: Vec::new() })
    }

    /// Serves whoever is ready on `token`; does nothing if it is not ours.
    pub fn serve(&mut self, token: Token, events: &EventLoop, report: impl Fn() -> StatusReport) {
        if token == self.token {
            self.accept(events);
            return;
        }
        let Some(index) = self.connections.iter().position(|c| c.token == token) else { return };
        if self.connections[index].progress(events, report).is_none() {
            let connection = self.connections.swap_remove(index);
            connection.close(events);
        }
    }

    /// Ends the visits that take too long.
    pub fn tick(&mut self, now_ns: u64, events: &EventLoop) {
        while let Some(index) = self.connections.iter().position(|c| c.until_ns <= now_ns) {
            self.connections.swap_remove(index).close(events);
        }
    }

    /// When [`Self::tick`] has something to do.
    #[must_use]
    pub fn due_ns(&self) -> Option<u64> {
        self.connections.iter().map(|connection| connection.until_ns).min()
    }

    fn accept(&mut self, events: &EventLoop) {
        while let Ok((stream, _)) = self.listener.accept() {
            if self.connections.len() >= CONNECTIONS_MAX || stream.set_nonblocking(true).is_err() {
                continue; // dropped: closed
            }
            if let Ok(token) = events.watch(&stream, Interest::Read) {
                self.connections.push(Connection {
                    stream,
                    token,
                    request: Vec::new(),
                    answer: Vec::new(),
                    written: 0,
                    until_ns: monotonic_ns() + PATIENCE_NS,
                });
            }
        }
    }
}

impl Connection {
    /// Goes on with this visit; `None` when it is over.
    fn progress(&mut self, events: &EventLoop, report: impl Fn() -> StatusReport) -> Option<()> {
        if self.answer.is_empty() {
            let mut buffer = [0u8; REQUEST_BYTES_MAX];
            match self.stream.read(&mut buffer) {
                Ok(0) => return None,
                Ok(bytes) => self.request.extend_from_slice(&buffer[..bytes]),
                Err(error) => return may_continue(&error),
            }
            if !self.request.contains(&b'\n') {
                return (self.request.len() < REQUEST_BYTES_MAX).then_some(());
            }
            self.answer = if self.request == REQUEST {
                serde_json::to_vec(&report()).ok()?
            } else {
                b"{\"error\":\"expected: status\"}".to_vec()
            };
            events.rewatch(self.token, &self.stream, Interest::Write).ok()?;
        }
        while self.written < self.answer.len() {
            match self.stream.write(&self.answer[self.written..]) {
                Ok(0) => return None,
                Ok(bytes) => self.written += bytes,
                Err(error) => return may_continue(&error),
            }
        }
        None
    }

    fn close(self, events: &EventLoop) {
        let _ = events.unwatch(self.token, &self.stream);
        let _ = self.stream.shutdown(Shutdown::Both);
    }
}

fn may_continue(error: &io::Error) -> Option<()> {
    let retry = matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted);
    retry.then_some(())
}

/// Why there is no status.
#[derive(Debug, thiserror::Error)]
pub enum StatusError {
    /// No such instance.
    #[error(transparent)]
    Instance(#[from] InstanceError),
    /// It does not answer.
    #[error(
        "the supervisor of {site} (process {pid}) does not answer on {path}: {source}: {}",
        what_to_do(source, *pid)
    )]
    Silent {
        /// The site's name.
        site: String,
        /// Its process id.
        pid: u32,
        /// The socket.
        path: String,
        /// What the system says.
        source: io::Error,
    },
    /// It answers nonsense.
    #[error("the supervisor of {site} answers what this tog does not read: {reason}")]
    Answer {
        /// The site's name.
        site: String,
        /// What was found.
        reason: String,
    },
}

/// What to do about a supervisor that does not answer.
fn what_to_do(error: &io::Error, pid: u32) -> String {
    match error.kind() {
        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut => format!(
            "it is stopped or overloaded. `kill -CONT {pid}` lets a stopped one go on; one that hangs \
             must be killed (`kill -9 {pid}`), then `tog run` starts the site again"
        ),
        io::ErrorKind::BrokenPipe
        | io::ErrorKind::ConnectionReset
        | io::ErrorKind::UnexpectedEof => format!(
            "all {CONNECTIONS_MAX} places of the socket are taken, for some seconds at most: try again \
             soon. `ss -xp` shows who connects to it"
        ),
        _ => "was it killed? `tog run` starts the site again".to_owned(),
    }
}

/// Connects without waiting for a place among those whom a stopped supervisor has not accepted yet.
fn connect(path: &Path) -> io::Result<UnixStream> {
    let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
    let socket = socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None)?;
    rustix::net::connect(&socket, &SocketAddrUnix::new(path)?)?;
    let stream = UnixStream::from(socket);
    stream.set_nonblocking(false)?;
    Ok(stream)
}

/// Asks the supervisor of a running site how it is. `site_or_dir` is the site's name, or its run
/// directory.
///
/// # Errors
/// If no such site runs, or its supervisor does not answer within seconds.
pub fn status(site_or_dir: &str) -> Result<StatusReport, StatusError> {
    status_in(site_or_dir, &default_run_root())
}

/// As [`status`], with the directory that holds the run directories.
///
/// # Errors
/// As [`status`].
pub fn status_in(site_or_dir: &str, run_root: &Path) -> Result<StatusReport, StatusError> {
    let instance = Instance::load(&run_dir_of(site_or_dir, run_root))?;
    let path = instance.control_socket();
    let ask = || -> io::Result<Vec<u8>> {
        let mut stream = connect(&path)?;
        stream.set_read_timeout(Some(CLIENT_PATIENCE))?;
        stream.set_write_timeout(Some(CLIENT_PATIENCE))?;
        stream.write_all(REQUEST)?;
        let mut answer = Vec::new();
        stream.take(REPORT_BYTES_MAX).read_to_end(&mut answer)?;
        match answer.is_empty() {
            true => Err(io::ErrorKind::UnexpectedEof.into()), // closed without a word
            false => Ok(answer),
        }
    };
    let pid = instance.owner_pid;
    let site = instance.site_name.clone();
    match ask() {
        Ok(answer) => serde_json::from_slice(&answer)
            .map_err(|error| StatusError::Answer { site, reason: error.to_string() }),
        Err(source) => {
            Err(StatusError::Silent { site, pid, path: path.display().to_string(), source })
        }
    }
}
