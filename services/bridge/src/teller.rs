//! Tells the journal of this host to whoever wants it, as a client of the feed of the alerts service:
//! one connection for what comes, and one for each question while it is answered.

use crate::feed_line::{FeedLine, LineBuffer, parse};
use crate::inbox::Ask;
use process::event_loop::{EventLoop, Interest, Token};
use protocol::link::{EventPage, EventRow, PAGE_BYTES_MAX, PAGE_ROWS_MAX};
use protocol::time::SECOND_NS;
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;

/// The socket of the feed in the run directory; the alerts service names it in its page.
const SOCKET_FILE: &str = "alerts.sock";
/// Questions that are answered at once: one a desk, far fewer than the feed has places.
const ANSWERS_MAX: usize = 8;
/// A question that is not answered by then is forgotten: who asked does so again.
const ANSWER_NS: u64 = 2 * SECOND_NS;
/// The end of the journal is told this often.
const HEAD_NS: u64 = SECOND_NS;
/// A feed that is not there is looked for this often: the alerts service may be starting.
const RETRY_NS: u64 = SECOND_NS / 4;
/// How long the alerts service may take to start before its absence is a fault.
const START_NS: u64 = 3 * SECOND_NS;
/// Encoded rows are shorter than their JSON; a page is closed when its lines are this long.
const PAGE_LINES_MAX: usize = PAGE_BYTES_MAX / 2;
const READ_BYTES: usize = 16 * 1024;
/// Reads before the loop looks at anything else.
const READS_MAX: usize = 8;

/// What is to be told.
#[derive(Debug)]
pub enum Tell<Q> {
    /// To all desks.
    Live(EventPage),
    /// To who asked.
    Answer(Q, EventPage),
}

/// A connection to the feed.
#[derive(Debug)]
struct Client {
    stream: UnixStream,
    token: Token,
    lines: LineBuffer,
}

impl Client {
    fn connect(path: &PathBuf, request: &str, events: &EventLoop) -> io::Result<Self> {
        let mut stream = UnixStream::connect(path)?;
        stream.write_all(request.as_bytes())?; // one short line into a new socket
        stream.set_nonblocking(true)?;
        let token = events.watch(&stream, Interest::Read)?;
        Ok(Self { stream, token, lines: LineBuffer::default() })
    }

    /// The lines that came, with their lengths; an error is the end of the connection.
    fn read(&mut self) -> Result<Vec<(usize, FeedLine)>, String> {
        let mut found = Vec::new();
        let mut bytes = vec![0; READ_BYTES];
        for _ in 0..READS_MAX {
            match self.stream.read(&mut bytes) {
                Ok(0) if found.is_empty() => return Err("the feed is closed".to_owned()),
                Ok(0) => break, // the next read says so again
                Ok(length) => {
                    for line in self.lines.take(&bytes[..length])? {
                        found.push((line.len(), parse(&line)?));
                    }
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) => return Err(error.to_string()),
            }
        }
        Ok(found)
    }
}

/// A question that is being answered.
#[derive(Debug)]
struct Answer<Q> {
    client: Client,
    ask: Ask<Q>,
    /// The journal ended here when it was asked.
    head: u64,
    rows: Vec<EventRow>,
    bytes: usize,
    until_ns: u64,
}

impl<Q> Answer<Q> {
    /// Takes rows; true if the page is complete.
    fn take(&mut self, lines: Vec<(usize, FeedLine)>) -> Result<bool, String> {
        for (length, line) in lines {
            match line {
                FeedLine::Begins(after) if after != self.ask.after => {
                    return Err(format!("the journal does not reach row {}", self.ask.after));
                }
                FeedLine::Closes(reason) => return Err(reason),
                FeedLine::Begins(_) | FeedLine::NotYet => {}
                FeedLine::Row(row) if self.is_complete() => drop(row),
                FeedLine::Row(row) => {
                    self.bytes += length;
                    self.rows.push(*row);
                }
            }
        }
        Ok(self.is_complete())
    }

    fn is_complete(&self) -> bool {
        let last = self.rows.last().map_or(self.ask.after, |row| row.journal_id);
        last >= self.head || self.rows.len() >= PAGE_ROWS_MAX || self.bytes >= PAGE_LINES_MAX
    }
}

/// The journal of this host, as others are told of it.
#[derive(Debug)]
pub struct Teller<Q> {
    /// The id of this host.
    host: String,
    socket: PathBuf,
    events: EventLoop,
    epoch: u64,
    live: Option<Client>,
    /// The last row that is known; none until the feed has said where it begins.
    head: Option<u64>,
    retry_ns: u64,
    head_due_ns: u64,
    answers: Vec<Answer<Q>>,
    unanswered: u64,
    /// Since when and why there is no feed.
    fault: Option<(u64, String)>,
}

impl<Q> Teller<Q> {
    /// Tells the journal of the alerts service of this run directory, of host `host`.
    pub fn new(host: &str, run_dir: &std::path::Path, events: &EventLoop, epoch: u64) -> Self {
        Self {
            host: host.to_owned(),
            socket: run_dir.join(SOCKET_FILE),
            events: events.clone(),
            epoch,
            live: None,
            head: None,
            retry_ns: 0,
            head_due_ns: 0,
            answers: Vec::new(),
            unanswered: 0,
            fault: None,
        }
    }

    /// Does what is due: connects, tells the head, forgets questions that nobody answered.
    pub fn tick(&mut self, mono_ns: u64, out: &mut Vec<Tell<Q>>) {
        if self.live.is_none() && mono_ns >= self.retry_ns {
            self.retry_ns = mono_ns + RETRY_NS;
            match Client::connect(&self.socket, "{\"after\":null}\n", &self.events) {
                Ok(client) => self.live = Some(client),
                Err(error) => self.fail(format!("{}: {error}", self.socket.display()), mono_ns),
            }
        }
        if let Some(head) = self.head.filter(|_| mono_ns >= self.head_due_ns) {
            self.head_due_ns = mono_ns + HEAD_NS;
            out.push(Tell::Live(self.page(head, head, Vec::new())));
        }
        let (late, rest) =
            std::mem::take(&mut self.answers).into_iter().partition(|a| mono_ns >= a.until_ns);
        self.answers = rest;
        late.into_iter().for_each(|answer: Answer<Q>| self.forget(answer));
    }

    /// A question. Without a journal that answers it stays unanswered: who asked does so again.
    pub fn ask(&mut self, ask: Ask<Q>, mono_ns: u64, out: &mut Vec<Tell<Q>>) {
        let Some(head) = self.head.filter(|_| self.answers.len() < ANSWERS_MAX) else {
            self.unanswered += 1;
            return;
        };
        if ask.after >= head {
            let page = self.page(ask.after, head, Vec::new());
            return out.push(Tell::Answer(ask.query, page));
        }
        let request = format!("{{\"after\":{}}}\n", ask.after);
        match Client::connect(&self.socket, &request, &self.events) {
            Ok(client) => {
                let until_ns = mono_ns + ANSWER_NS;
                let rows = Vec::new();
                self.answers.push(Answer { client, ask, head, rows, bytes: 0, until_ns });
            }
            Err(_) => self.unanswered += 1, // the live connection will say why
        }
    }

    /// A descriptor of the loop is ready. False if it is none of ours.
    pub fn ready(&mut self, token: Token, mono_ns: u64, out: &mut Vec<Tell<Q>>) -> bool {
        if self.live.as_ref().is_some_and(|client| client.token == token) {
            if let Err(reason) = self.take_live(mono_ns, out) {
                self.fail(reason, mono_ns);
                self.head = None; // a new journal may be there next time
                self.retry_ns = mono_ns + RETRY_NS;
                let client = self.live.take();
                client.into_iter().for_each(|client| self.drop_client(client));
            }
            return true;
        }
        let Some(at) = self.answers.iter().position(|answer| answer.client.token == token) else {
            return false;
        };
        let answer = &mut self.answers[at];
        match answer.client.read().and_then(|lines| answer.take(lines)) {
            Ok(false) => {}
            Ok(true) => {
                let Answer { client, ask, head, rows, .. } = self.answers.swap_remove(at);
                self.drop_client(client);
                // Rows may have come since it was asked.
                let last = rows.last().map_or(0, |row| row.journal_id);
                let page = self.page(ask.after, head.max(last), rows);
                out.push(Tell::Answer(ask.query, page));
            }
            Err(_) => {
                let answer = self.answers.swap_remove(at);
                self.forget(answer);
            }
        }
        true
    }

    fn take_live(&mut self, mono_ns: u64, out: &mut Vec<Tell<Q>>) -> Result<(), String> {
        let Some(client) = &mut self.live else { return Ok(()) };
        for (_, line) in client.read()? {
            match (line, self.head) {
                (FeedLine::Begins(after), _) => {
                    self.head = Some(after);
                    self.head_due_ns = mono_ns; // at once: a desk may have missed something
                    self.fault = None;
                }
                (FeedLine::Row(row), Some(before)) => {
                    let head = row.journal_id;
                    self.head = Some(head);
                    out.push(Tell::Live(self.page(before, head, vec![*row])));
                }
                (FeedLine::Row(_), None) => return Err("a row before the greeting".to_owned()),
                (FeedLine::NotYet, _) => {}
                (FeedLine::Closes(reason), _) => return Err(reason),
            }
        }
        Ok(())
    }

    fn page(&self, after: u64, head: u64, rows: Vec<EventRow>) -> EventPage {
        EventPage { host: self.host.clone(), epoch: self.epoch, after, head, rows }
    }

    fn forget(&mut self, answer: Answer<Q>) {
        self.unanswered += 1;
        self.drop_client(answer.client);
    }

    fn drop_client(&self, client: Client) {
        let _ = self.events.unwatch(client.token, &client.stream); // it goes now, watched or not
    }

    /// When [`Teller::tick`] has something to do.
    #[must_use]
    pub fn deadline_ns(&self) -> Option<u64> {
        let retry = self.live.is_none().then_some(self.retry_ns);
        let head = self.head.map(|_| self.head_due_ns);
        let answers = self.answers.iter().map(|answer| answer.until_ns);
        retry.into_iter().chain(head).chain(answers).min()
    }

    /// Questions that stayed without an answer.
    #[must_use]
    pub fn unanswered(&self) -> u64 {
        self.unanswered
    }

    fn fail(&mut self, reason: String, mono_ns: u64) {
        self.fault.get_or_insert((mono_ns, String::new())).1 = reason;
    }

    /// Why the journal cannot be told, if that lasts: an alerts service that starts is no fault.
    #[must_use]
    pub fn fault(&self, mono_ns: u64) -> Option<&str> {
        let lasts = |(since_ns, _): &&(u64, String)| mono_ns >= since_ns.saturating_add(START_NS);
        self.fault.as_ref().filter(lasts).map(|(_, reason)| reason.as_str())
    }
}

#[cfg(test)]
#[path = "teller_tests.rs"]
mod tests;
