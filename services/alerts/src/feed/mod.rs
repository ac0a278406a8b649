//! The feed: whoever connects is told every change after a cursor, then every new one.
//!
//! One line of JSON each way. A client says, within 5 s of connecting, one of
//! ```json
//! {"after": 17}
//! {"after": null}
//! ```
//! "all after `journal_id` 17", or "what comes from now on". The feed answers
//! ```json
//! {"feed": 1, "after": 17, "reset": false}
//! {"journal_id": 18, "journaled": true, "received_ns": 1795.., "id": "foyer-4", ..}
//! {"closing": "why"}
//! ```
//! - The first line says where the stream begins; `reset` is true if the journal does not reach as
//!   far as the cursor, because somebody replaced it: then it begins at the first row.
//! - A change with `"journaled": false` and no `journal_id` is told while the disk cannot be
//!   written. It comes **again**, with its `journal_id`, once it is on disk: `(origin, sequence)`
//!   is its name.
//! - A client that reads slowly loses nothing: its lines wait in the journal, not in memory. One
//!   that takes nothing at all for [`STALL_NS`] is told so and closed; it goes on with its last
//!   cursor.
//! - Closing the socket, also its sending half, ends the stream.
//!
//! This is the pure state machine: bytes, rows and the time (CLOCK_MONOTONIC, ns) are arguments.

mod socket;

pub use socket::{FeedError, FeedSocket, SOCKET_FILE};

use crate::journal::{Entry, JournalError};
use crate::keeper::Keeper;
use protocol::time::SECOND_NS;
use serde::Deserialize;
use std::collections::BTreeMap;

/// Most clients: a desk, some wall screens, a bridge, a few curious ones. Each may cost
/// [`QUEUE_BYTES_MAX`], a page of rows, and a query of the journal for every event.
pub const CLIENTS_MAX: usize = 32;
/// No rows are fetched for a client while so many bytes wait for it: some dozens of changes.
pub const QUEUE_BYTES_MAX: usize = 64 * 1024;
/// Rows fetched at once for a client.
const PAGE_ROWS: usize = 16;
/// Longest line from a client: `{"after":18446744073709551615}` with room for spaces.
const REQUEST_BYTES_MAX: usize = 256;
/// How long a client may take to say what it wants.
pub const GREETING_NS: u64 = 5 * SECOND_NS;
/// How long a client may take nothing while something waits for it: a person who halts a terminal
/// to read has half a minute, a program that hangs does not hold a place for ever.
pub const STALL_NS: u64 = 30 * SECOND_NS;
/// How long a client that is closed has to take the last line.
const FAREWELL_NS: u64 = 5 * SECOND_NS;

/// Names a client for as long as the process lives.
pub type ClientId = u64;

/// Where lines come from.
pub trait Source {
    /// Highest `journal_id`; none while there is no journal.
    ///
    /// # Errors
    /// If the journal cannot be read.
    fn head(&self) -> Result<Option<u64>, JournalError>;
    /// The head at the time the journal was opened.
    fn head_at_open(&self) -> u64;
    /// Up to `limit` rows after a cursor, in order.
    ///
    /// # Errors
    /// If the journal cannot be read.
    fn after(&self, journal_id: u64, limit: usize) -> Result<Vec<Entry>, JournalError>;
    /// Up to `limit` changes that are not on disk: their number and their line.
    fn pending_after(&self, number: u64, limit: usize) -> Vec<(u64, String)>;
}

impl Source for Keeper {
    fn head(&self) -> Result<Option<u64>, JournalError> {
        Self::head(self)
    }

    fn head_at_open(&self) -> u64 {
        Self::head_at_open(self)
    }

    fn after(&self, journal_id: u64, limit: usize) -> Result<Vec<Entry>, JournalError> {
        Self::after(self, journal_id, limit)
    }

    fn pending_after(&self, number: u64, limit: usize) -> Vec<(u64, String)> {
        let pending = Self::pending_after(self, number).take(limit);
        pending.map(|pending| (pending.number, pending.line())).collect()
    }
}

#[derive(Debug)]
enum State {
    /// Has not said yet what it wants.
    Greeting { line: Vec<u8> },
    /// Gets lines. Without a cursor it waits for a journal.
    Streaming { wants: Option<u64>, cursor: Option<u64>, pending: u64 },
    /// Gets its last line.
    Closing,
}

#[derive(Debug)]
struct Client {
    state: State,
    queue: Vec<u8>,
    /// The last byte that the client took was not the end of a line.
    in_line: bool,
    /// When it connected, took something, or began to have something to take.
    since_ns: u64,
}

impl Client {
    fn push_line(&mut self, line: &str, mono_ns: u64) {
        if self.queue.is_empty() {
            self.since_ns = mono_ns;
        }
        self.queue.extend_from_slice(line.as_bytes());
        self.queue.push(b'\n');
    }

    /// Drops what waits, but for the rest of a line that was begun, and says why.
    fn close(&mut self, reason: &str, mono_ns: u64) {
        let end_of_line = self.queue.iter().position(|&byte| byte == b'\n');
        self.queue.truncate(if self.in_line { end_of_line.map_or(0, |end| end + 1) } else { 0 });
        self.state = State::Closing;
        self.push_line(&closing_line(reason), mono_ns);
        self.since_ns = mono_ns;
    }

    fn deadline_ns(&self) -> Option<u64> {
        let wait_ns = match self.state {
            State::Greeting { .. } => GREETING_NS,
            State::Streaming { .. } if self.queue.is_empty() => return None,
            State::Streaming { .. } => STALL_NS,
            State::Closing => FAREWELL_NS,
        };
        Some(self.since_ns.saturating_add(wait_ns))
    }
}

/// All clients of the feed.
#[derive(Debug, Default)]
pub struct Feed {
    clients: BTreeMap<ClientId, Client>,
    last_id: ClientId,
    stalled: u64,
}

impl Feed {
    /// A new client.
    ///
    /// # Errors
    /// The last line to send, if there is no place.
    pub fn connect(&mut self, mono_ns: u64) -> Result<ClientId, String> {
        if self.clients.len() >= CLIENTS_MAX {
            let reason = format!("all {CLIENTS_MAX} places of the feed are taken; try again later");
            return Err(closing_line(&reason) + "\n");
        }
        self.last_id += 1;
        let state = State::Greeting { line: Vec::new() };
        let client = Client { state, queue: Vec::new(), in_line: false, since_ns: mono_ns };
        self.clients.insert(self.last_id, client);
        Ok(self.last_id)
    }

    /// Bytes from a client. What follows its first line is ignored.
    pub fn received(&mut self, id: ClientId, bytes: &[u8], mono_ns: u64) {
        let Some(client) = self.clients.get_mut(&id) else { return };
        let State::Greeting { line } = &mut client.state else { return };
        let end = bytes.iter().position(|&byte| byte == b'\n');
        line.extend_from_slice(&bytes[..end.unwrap_or(bytes.len()).min(REQUEST_BYTES_MAX + 1)]);
        if line.len() > REQUEST_BYTES_MAX {
            let reason = format!(
                "a request of more than {REQUEST_BYTES_MAX} bytes, expected {{\"after\": 17}} or \
                 {{\"after\": null}}"
            );
            client.close(&reason, mono_ns);
        } else if end.is_some() {
            match request(line) {
                Ok(wants) => {
                    client.state = State::Streaming { wants, cursor: None, pending: 0 };
                }
                Err(reason) => client.close(&reason, mono_ns),
            }
        }
    }

    /// Gives every client what is new for it and fits. Call it after every input.
    ///
    /// # Errors
    /// If the journal cannot be read; clients keep their cursors.
    pub fn pump(&mut self, source: &impl Source, mono_ns: u64) -> Result<(), JournalError> {
        self.clients.values_mut().try_for_each(|client| pump(client, source, mono_ns))
    }

    /// What waits for a client.
    #[must_use]
    pub fn output(&self, id: ClientId) -> &[u8] {
        self.clients.get(&id).map_or(&[], |client| &client.queue)
    }

    /// The client took the first `bytes` of its output.
    pub fn sent(&mut self, id: ClientId, bytes: usize, mono_ns: u64) {
        let Some(client) = self.clients.get_mut(&id) else { return };
        let Some(last) = bytes.checked_sub(1).and_then(|last| client.queue.get(last)) else {
            return;
        };
        client.in_line = *last != b'\n';
        client.queue.drain(..bytes);
        if !matches!(client.state, State::Closing) {
            client.since_ns = mono_ns;
        }
    }

    /// True if the client has got its last line.
    #[must_use]
    pub fn is_over(&self, id: ClientId) -> bool {
        self.clients
            .get(&id)
            .is_none_or(|client| matches!(client.state, State::Closing) && client.queue.is_empty())
    }

    /// The client is gone.
    pub fn disconnect(&mut self, id: ClientId) {
        self.clients.remove(&id);
    }

    /// When [`Feed::expire`] has something to do.
    #[must_use]
    pub fn deadline_ns(&self) -> Option<u64> {
        self.clients.values().filter_map(Client::deadline_ns).min()
    }

    /// Closes the clients whose time is over; returns those that did not even take their last line.
    pub fn expire(&mut self, mono_ns: u64) -> Vec<ClientId> {
        let mut gone = Vec::new();
        for (&id, client) in &mut self.clients {
            if client.deadline_ns().is_none_or(|deadline_ns| mono_ns < deadline_ns) {
                continue;
            }
            match client.state {
                State::Greeting { .. } => client.close(
                    "no request for 5 s, expected {\"after\": 17} or {\"after\": null}",
                    mono_ns,
                ),
                State::Streaming { .. } => {
                    self.stalled += 1;
                    client.close(
                        "this client took nothing for 30 s; connect again with the last \
                         journal_id that came, nothing is lost",
                        mono_ns,
                    );
                }
                State::Closing => gone.push(id),
            }
        }
        gone
    }

    /// Says goodbye to all clients: the service ends.
    pub fn close_all(&mut self, reason: &str, mono_ns: u64) {
        for client in self.clients.values_mut() {
            client.close(reason, mono_ns);
        }
    }

    /// Clients now.
    #[must_use]
    pub fn len(&self) -> usize {
        self.clients.len()
    }

    /// True if nobody listens.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.clients.is_empty()
    }

    /// Clients that were closed because they took nothing.
    #[must_use]
    pub fn stalled(&self) -> u64 {
        self.stalled
    }
}

fn pump(client: &mut Client, source: &impl Source, mono_ns: u64) -> Result<(), JournalError> {
    let State::Streaming { wants, cursor, pending } = &client.state else { return Ok(()) };
    let (wants, mut pending) = (*wants, *pending);
    let mut cursor = *cursor;
    if cursor.is_none()
        && let Some(head) = source.head()?
    {
        // A client that came before there was a journal begins where the journal was then: what
        // was written since may not have been told to it.
        let from_now_on = if pending > 0 { source.head_at_open() } else { head };
        let begin = wants.map_or(from_now_on, |wants| if wants > head { 0 } else { wants });
        let reset = wants.is_some_and(|wants| wants > head);
        let line = format!("{{\"feed\":1,\"after\":{begin},\"reset\":{reset}}}");
        client.push_line(&line, mono_ns);
        cursor = Some(begin);
    }
    let mut result = Ok(());
    while client.queue.len() < QUEUE_BYTES_MAX {
        let rows = match cursor.map_or(Ok(Vec::new()), |cursor| source.after(cursor, PAGE_ROWS)) {
            Ok(rows) => rows,
            Err(error) => {
                result = Err(error);
                break;
            }
        };
        for row in &rows {
            client.push_line(&row.line(), mono_ns);
            cursor = Some(row.journal_id);
        }
        if !rows.is_empty() {
            continue;
        }
        let changes = source.pending_after(pending, PAGE_ROWS);
        for (number, line) in &changes {
            client.push_line(line, mono_ns);
            pending = *number;
        }
        if changes.is_empty() {
            break;
        }
    }
    client.state = State::Streaming { wants, cursor, pending };
    result
}

fn request(line: &[u8]) -> Result<Option<u64>, String> {
    #[derive(Deserialize)]
    struct Request {
        #[serde(deserialize_with = "Option::deserialize")] // `after` must be there
        after: Option<u64>,
    }
    serde_json::from_slice::<Request>(line).map(|request| request.after).map_err(|error| {
        format!(
            "cannot understand the request ({error}), expected {{\"after\": 17}} or \
             {{\"after\": null}}"
        )
    })
}

fn closing_line(reason: &str) -> String {
    serde_json::json!({ "closing": reason }).to_string()
}

#[cfg(test)]
mod tests;
