//! `tog alerts watch`: the feed on a terminal or in a pipe, until Ctrl-C.
//!
//! It goes on across restarts of the service with the cursor of the last line, so that nothing is
//! lost or told twice. What the service told before it was on disk comes again when it is: text
//! leaves the second one out, JSON passes both on with their `journaled`.

use crate::journal::{Filter, Journal};
use crate::list::Format;
use crate::words::{self, ZoneError};
use jiff::tz::TimeZone;
use process::clock::monotonic_ns;
use process::event_loop::{EventLoop, Interest};
use protocol::event::EventChange;
use protocol::time::MILLISECOND_NS;
use serde::Deserialize;
use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;

/// Longest line of the feed: a change has at most 2 kB of text, JSON may escape it to 12 kB.
const LINE_BYTES_MAX: usize = 64 * 1024;
/// Early notices remembered, to tell them once: as many as the service keeps.
const EARLY_MAX: usize = crate::keeper::BACKLOG_MAX;
/// Open events are counted up to this.
const OPEN_MAX: usize = 10_000;
/// The service is restarted within 2 s; a connection attempt costs microseconds.
const RECONNECT_NS: u64 = 500 * MILLISECOND_NS;

/// What is to be watched.
#[derive(Debug, Clone, PartialEq)]
pub struct WatchOptions {
    /// The site's name, for the notes.
    pub site: String,
    /// Its journal. When its directory is gone nothing can come any more.
    pub journal: PathBuf,
    /// The feed: `<run_dir>/alerts.sock`.
    pub socket: PathBuf,
    /// The site's time zone, an IANA name.
    pub timezone: String,
    /// How lines are written.
    pub format: Format,
    /// All after this `journal_id`, 0 for the whole journal; none for what comes from now on.
    pub after: Option<u64>,
}

/// Why watching ended.
#[derive(Debug, thiserror::Error)]
pub enum WatchError {
    /// Nobody listens at the socket.
    #[error(
        "no alerts service runs here ({socket}: {source}): start the site with `tog run SITE`, \
         or see `tog alerts list` for what happened before"
    )]
    NotRunning {
        /// The feed.
        socket: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The service does not want us.
    #[error("the feed was closed: {reason}")]
    Refused {
        /// Its words.
        reason: String,
    },
    /// The site is gone, not only its service.
    #[error("nothing can come any more: the state directory {} is gone", directory.display())]
    Gone {
        /// What was there.
        directory: PathBuf,
    },
    /// The site's time zone.
    #[error(transparent)]
    Zone(#[from] ZoneError),
    /// The output, or the event loop.
    #[error("cannot go on watching: {0}")]
    Io(#[from] std::io::Error),
}

/// Writes the changes to `out` as they come, and what happens to the connection to `notes`.
/// Returns when `events` is stopped (Ctrl-C, SIGTERM) or the reader of `out` goes away.
///
/// # Errors
/// See [`WatchError`]. After the first connection a service that is away is waited for.
pub fn watch(
    options: &WatchOptions,
    events: &EventLoop,
    out: &mut impl Write,
    notes: &mut impl Write,
) -> Result<(), WatchError> {
    let mut watcher = Watcher::new(options)?;
    let mut stream = UnixStream::connect(&options.socket)
        .map_err(|source| WatchError::NotRunning { socket: options.socket.clone(), source })?;
    writeln!(notes, "{}", following(options))?;
    loop {
        match session(&mut watcher, stream, events, out, notes)? {
            Ended::Stopped => return Ok(()),
            Ended::Refused(reason) if watcher.cursor.is_none() => {
                return Err(WatchError::Refused { reason });
            }
            Ended::Lost(reason) | Ended::Refused(reason) => {
                writeln!(notes, "the feed is interrupted ({reason}); waiting for it")?;
            }
        }
        stream = loop {
            if let Some(directory) = options.journal.parent().filter(|path| !path.exists()) {
                return Err(WatchError::Gone { directory: directory.to_owned() });
            }
            if events.wait(Some(monotonic_ns() + RECONNECT_NS))?.stop {
                return Ok(());
            }
            if let Ok(stream) = UnixStream::connect(&options.socket) {
                break stream;
            }
        };
        writeln!(notes, "the feed is back")?;
    }
}

/// `following foyer, 2 open`: what a guard who begins the shift wants to know first.
fn following(options: &WatchOptions) -> String {
    let filter = Filter { open_only: true, limit: OPEN_MAX, ..Filter::default() };
    let open = Journal::open_read_only(&options.journal).and_then(|journal| journal.list(&filter));
    match open {
        Ok(open) => format!("following {}, {} open", options.site, open.len()),
        Err(_) => format!("following {}", options.site), // the feed says what there is
    }
}

#[derive(Debug, PartialEq, Eq)]
enum Ended {
    Stopped,
    /// The connection broke.
    Lost(String),
    /// The service closed it, in its own words.
    Refused(String),
}

fn session(
    watcher: &mut Watcher,
    mut stream: UnixStream,
    events: &EventLoop,
    out: &mut impl Write,
    notes: &mut impl Write,
) -> Result<Ended, WatchError> {
    watcher.begin();
    if let Err(error) = stream.write_all(watcher.request().as_bytes()) {
        // A service without a place for us has said so and closed: read its words.
        if error.kind() != ErrorKind::BrokenPipe {
            return Ok(Ended::Lost(error.to_string()));
        }
    }
    stream.set_nonblocking(true)?;
    let token = events.watch(&stream, Interest::Read)?;
    let ended = loop {
        let mut bytes = [0; 16 * 1024];
        match stream.read(&mut bytes) {
            Ok(0) => break watcher.end(),
            Ok(length) => {
                watcher.take(&bytes[..length]);
                if !write_all(watcher, out, notes)? {
                    break Ended::Stopped;
                }
                if watcher.partial.len() > LINE_BYTES_MAX {
                    break Ended::Lost(format!("a line of more than {LINE_BYTES_MAX} bytes"));
                }
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                if events.wait(None)?.stop {
                    break Ended::Stopped;
                }
                while events.next_ready().is_some() {}
            }
            // A service that closes without having read us resets the connection: its words count.
            Err(_) => break watcher.end(),
        }
    };
    events.unwatch(token, &stream)?;
    Ok(ended)
}

/// False if the reader of `out` is gone.
fn write_all(
    watcher: &mut Watcher,
    out: &mut impl Write,
    notes: &mut impl Write,
) -> Result<bool, WatchError> {
    for said in watcher.said.drain(..) {
        let written = match said {
            Said::Line(line) => writeln!(out, "{line}"),
            Said::Note(note) => writeln!(notes, "{note}"),
        };
        match written {
            Err(error) if error.kind() == ErrorKind::BrokenPipe => return Ok(false),
            written => written?,
        }
    }
    match out.flush() {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
        flushed => Ok(flushed.map(|()| true)?),
    }
}

#[derive(Debug, PartialEq, Eq)]
enum Said {
    Line(String),
    Note(String),
}

/// The pure part: bytes of the feed in, lines for people or programs out, the cursor kept.
#[derive(Debug)]
struct Watcher {
    zone: TimeZone,
    format: Format,
    wanted: Option<u64>,
    cursor: Option<u64>,
    partial: Vec<u8>,
    early: VecDeque<(String, u64)>,
    closing: Option<String>,
    said: Vec<Said>,
}

#[derive(Deserialize)]
struct Greeting {
    feed: u32,
    after: u64,
    reset: bool,
}

#[derive(Deserialize)]
struct Farewell {
    closing: String,
}

#[derive(Deserialize)]
struct Told {
    journal_id: Option<u64>,
    #[serde(flatten)]
    change: EventChange,
}

impl Watcher {
    fn new(options: &WatchOptions) -> Result<Self, ZoneError> {
        Ok(Self {
            zone: words::time_zone(&options.timezone)?,
            format: options.format,
            wanted: options.after,
            cursor: None,
            partial: Vec::new(),
            early: VecDeque::new(),
            closing: None,
            said: Vec::new(),
        })
    }

    /// A new connection: what was cut off with the old one comes again.
    fn begin(&mut self) {
        self.partial.clear();
        self.closing = None;
    }

    fn request(&self) -> String {
        serde_json::json!({ "after": self.cursor.or(self.wanted) }).to_string() + "\n"
    }

    fn end(&mut self) -> Ended {
        match self.closing.take() {
            Some(reason) => Ended::Refused(reason),
            None => Ended::Lost("the service is gone".to_owned()),
        }
    }

    fn take(&mut self, bytes: &[u8]) {
        for byte in bytes {
            if *byte != b'\n' {
                self.partial.push(*byte);
                continue;
            }
            let line = std::mem::take(&mut self.partial);
            self.take_line(&String::from_utf8_lossy(&line));
        }
    }

    fn take_line(&mut self, line: &str) {
        if let Ok(Greeting { feed: 1, after, reset }) = serde_json::from_str(line) {
            self.cursor = Some(after);
            if reset {
                let note = "the journal was replaced: the feed begins at its first row";
                self.said.push(Said::Note(note.to_owned()));
            }
        } else if let Ok(farewell) = serde_json::from_str::<Farewell>(line) {
            self.closing = Some(words::printable(&farewell.closing));
        } else {
            self.take_change(line);
        }
    }

    fn take_change(&mut self, line: &str) {
        let told = match serde_json::from_str::<Told>(line) {
            Ok(told) => told,
            Err(error) => {
                // A later tog knows more kinds. Its cursor still counts, and JSON readers may know.
                let id = serde_json::from_str::<serde_json::Value>(line)
                    .ok()
                    .and_then(|value| value["journal_id"].as_u64());
                self.cursor = id.or(self.cursor);
                self.said.push(match self.format {
                    Format::Json if id.is_some() => Said::Line(line.to_owned()),
                    _ => Said::Note(format!("a line of the feed cannot be read: {error}")),
                });
                return;
            }
        };
        let key = (told.change.origin.clone(), told.change.sequence);
        let was_told = self.early.contains(&key);
        match told.journal_id {
            Some(id) => {
                self.cursor = Some(id);
                self.early.retain(|early| *early != key);
            }
            None if !was_told => {
                if self.early.len() >= EARLY_MAX {
                    self.early.pop_front();
                }
                self.early.push_back(key);
            }
            None => {}
        }
        match self.format {
            Format::Json => self.said.push(Said::Line(line.to_owned())),
            Format::Text if was_told => {}
            Format::Text => {
                let mark = if told.journal_id.is_none() { " (not on disk yet)" } else { "" };
                let text = words::line(&told.change, &self.zone);
                self.said.push(Said::Line(format!("{text}{mark}")));
            }
        }
    }
}

#[cfg(test)]
mod tests;
