//! The feed's Unix socket in the event loop of the process: accepts, reads, writes, never waits.

use super::{ClientId, Feed, Source};
use crate::journal::JournalError;
use process::event_loop::{EventLoop, Interest, Token};
use std::collections::BTreeMap;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

/// Name of the socket in the run directory.
pub const SOCKET_FILE: &str = "alerts.sock";
/// Bytes read from a client at once; a client says one short line.
const READ_BYTES: usize = 512;
/// Reads from a client before the loop looks at anything else: a chatterbox must not hold it up.
const READS_MAX: usize = 16;
/// Connections accepted before the loop looks at anything else.
const ACCEPTS_MAX: usize = 64;

/// Why there is no feed.
#[derive(Debug, thiserror::Error)]
#[error("cannot offer the feed of events at {path}: {source}: check the run directory")]
pub struct FeedError {
    /// The socket.
    pub path: PathBuf,
    /// What the system says.
    pub source: std::io::Error,
}

#[derive(Debug)]
struct Connection {
    id: ClientId,
    stream: UnixStream,
    interest: Interest,
}

/// The socket, its clients, and their state.
#[derive(Debug)]
pub struct FeedSocket {
    path: PathBuf,
    events: EventLoop,
    listener: UnixListener,
    listener_token: Token,
    feed: Feed,
    connections: BTreeMap<Token, Connection>,
}

impl FeedSocket {
    /// Offers the feed at `<run_dir>/alerts.sock`, mode 0600. The caller is the only one of its
    /// kind: a socket that a killed process left there is removed.
    ///
    /// # Errors
    /// If the socket cannot be made.
    pub fn bind(run_dir: &Path, events: &EventLoop) -> Result<Self, FeedError> {
        let path = run_dir.join(SOCKET_FILE);
        let make = || {
            let unfinished = run_dir.join(".alerts.sock.new");
            for old in [&path, &unfinished] {
                match std::fs::remove_file(old) {
                    Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
                    _ => {}
                }
            }
            // Nobody can connect before the mode is right: the name comes last.
            let listener = UnixListener::bind(&unfinished)?;
            std::fs::set_permissions(&unfinished, std::fs::Permissions::from_mode(0o600))?;
            std::fs::rename(&unfinished, &path)?;
            listener.set_nonblocking(true)?;
            let token = events.watch(&listener, Interest::Read)?;
            Ok((listener, token))
        };
        let (listener, listener_token) =
            make().map_err(|source| FeedError { path: path.clone(), source })?;
        Ok(Self {
            path,
            events: events.clone(),
            listener,
            listener_token,
            feed: Feed::default(),
            connections: BTreeMap::new(),
        })
    }

    /// The clients' state.
    #[must_use]
    pub fn feed(&self) -> &Feed {
        &self.feed
    }

    /// A descriptor of the loop is ready. False if it is none of the feed's.
    pub fn ready(&mut self, token: Token, mono_ns: u64) -> bool {
        if token == self.listener_token {
            self.accept(mono_ns);
            return true;
        }
        let Some(connection) = self.connections.get_mut(&token) else { return false };
        let mut bytes = [0; READ_BYTES];
        let mut reads = 0;
        let is_gone = loop {
            reads += 1;
            match connection.stream.read(&mut bytes) {
                Ok(0) => break true,
                Ok(length) => {
                    self.feed.received(connection.id, &bytes[..length], mono_ns);
                    if reads == READS_MAX {
                        break false;
                    }
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => break error.kind() != ErrorKind::WouldBlock,
            }
        };
        if is_gone {
            self.drop_connection(token);
        }
        true
    }

    fn accept(&mut self, mono_ns: u64) {
        for _ in 0..ACCEPTS_MAX {
            let mut stream = match self.listener.accept() {
                Ok((stream, _)) => stream,
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(error) => {
                    tracing::warn!("cannot accept a client of the feed: {error}");
                    return;
                }
            };
            if let Err(error) = stream.set_nonblocking(true) {
                tracing::warn!("cannot serve a client of the feed: {error}");
                continue;
            }
            match self.feed.connect(mono_ns) {
                // A new socket has room for one line; if not, its client learns nothing but the
                // end.
                Err(last_line) => drop(stream.write_all(last_line.as_bytes())),
                Ok(id) => match self.events.watch(&stream, Interest::Read) {
                    Ok(token) => {
                        let interest = Interest::Read;
                        self.connections.insert(token, Connection { id, stream, interest });
                    }
                    Err(error) => {
                        tracing::warn!("cannot serve a client of the feed: {error}");
                        self.feed.disconnect(id);
                    }
                },
            }
        }
    }

    /// Hands out what is new and what is due. Call it after every wake.
    ///
    /// # Errors
    /// If the journal cannot be read; what was fetched before is sent all the same.
    pub fn pump(&mut self, source: &impl Source, mono_ns: u64) -> Result<(), JournalError> {
        for id in self.feed.expire(mono_ns) {
            let of_client = self.connections.iter().find(|(_, connection)| connection.id == id);
            if let Some(token) = of_client.map(|(&token, _)| token) {
                self.drop_connection(token);
            }
        }
        // A client that takes all its lines at once has room for more.
        loop {
            let result = self.feed.pump(source, mono_ns);
            let has_room_again = self.send(mono_ns);
            if result.is_err() || !has_room_again {
                return result;
            }
        }
    }

    /// Writes what the sockets take. True if a client has taken a full queue.
    fn send(&mut self, mono_ns: u64) -> bool {
        let mut has_room_again = false;
        let mut gone = Vec::new();
        for (&token, connection) in &mut self.connections {
            let waiting = self.feed.output(connection.id).len();
            match send(connection, &mut self.feed, mono_ns) {
                Err(_) => gone.push(token),
                Ok(()) if self.feed.is_over(connection.id) => gone.push(token),
                Ok(()) => {
                    let is_empty = self.feed.output(connection.id).is_empty();
                    has_room_again |= waiting >= super::QUEUE_BYTES_MAX && is_empty;
                    let interest = if is_empty { Interest::Read } else { Interest::ReadWrite };
                    if connection.interest != interest {
                        connection.interest = interest;
                        if self.events.rewatch(token, &connection.stream, interest).is_err() {
                            gone.push(token);
                        }
                    }
                }
            }
        }
        for token in gone {
            self.drop_connection(token);
        }
        has_room_again
    }

    fn drop_connection(&mut self, token: Token) {
        if let Some(connection) = self.connections.remove(&token) {
            self.feed.disconnect(connection.id);
            // It fails only if it is not watched any more, which is what we want.
            let _ = self.events.unwatch(token, &connection.stream);
        }
    }

    /// When [`FeedSocket::pump`] has something to do at the latest.
    #[must_use]
    pub fn deadline_ns(&self) -> Option<u64> {
        self.feed.deadline_ns()
    }
}

impl Drop for FeedSocket {
    /// Says goodbye as far as the sockets take it, and removes the socket file.
    fn drop(&mut self) {
        self.feed.close_all("the alerts service ends; connect again when it is back", 0);
        self.send(0);
        let _ = self.events.unwatch(self.listener_token, &self.listener);
        let _ = std::fs::remove_file(&self.path);
    }
}

fn send(connection: &mut Connection, feed: &mut Feed, mono_ns: u64) -> std::io::Result<()> {
    while !feed.output(connection.id).is_empty() {
        match connection.stream.write(feed.output(connection.id)) {
            Ok(0) => return Err(ErrorKind::WriteZero.into()),
            Ok(length) => feed.sent(connection.id, length, mono_ns),
            Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::feed::{CLIENTS_MAX, QUEUE_BYTES_MAX, STALL_NS};
    use crate::keeper::{Keeper, Now};
    use crate::testing::change;
    use std::io::BufRead;

    struct Service {
        keeper: Keeper,
        events: EventLoop,
        feed: FeedSocket,
        directory: tempfile::TempDir,
    }

    impl Service {
        fn new() -> Self {
            let directory = tempfile::tempdir().unwrap();
            let now = Now { unix_ns: 1, mono_ns: 1 };
            let (keeper, _) = Keeper::open(&directory.path().join("journal"), now).unwrap();
            let events = EventLoop::new().unwrap();
            let feed = FeedSocket::bind(directory.path(), &events).unwrap();
            Self { keeper, events, feed, directory }
        }

        fn append(&mut self, sequences: std::ops::RangeInclusive<u64>) {
            let changes = sequences.map(|sequence| change("foyer", sequence)).collect();
            self.keeper.offer(changes, Now { unix_ns: 1, mono_ns: 1 });
        }

        fn connect(&mut self) -> UnixStream {
            let mut client = UnixStream::connect(self.directory.path().join(SOCKET_FILE)).unwrap();
            client.write_all(b"{\"after\":0}\n").unwrap();
            client.set_nonblocking(true).unwrap();
            client
        }

        /// One turn of the loop, without sleeping.
        fn turn(&mut self, mono_ns: u64) {
            self.events.wait(Some(0)).unwrap();
            while let Some(token) = self.events.next_ready() {
                assert!(self.feed.ready(token, mono_ns));
            }
            self.feed.pump(&self.keeper, mono_ns).unwrap();
        }
    }

    fn read(client: &mut UnixStream, into: &mut Vec<u8>) -> usize {
        let before = into.len();
        let _ = client.read_to_end(into);
        into.len() - before
    }

    fn ids(bytes: &[u8]) -> Vec<u64> {
        let lines = bytes.lines().map(|line| line.unwrap());
        let values = lines.map(|line| serde_json::from_str::<serde_json::Value>(&line).unwrap());
        values.filter_map(|value| value["journal_id"].as_u64()).collect()
    }

    #[test]
    fn a_slow_client_gets_a_long_history_through_a_full_socket_without_a_hole() {
        let mut service = Service::new();
        service.append(1..=2000);
        let mut client = service.connect();
        (0..5).for_each(|_| service.turn(1)); // the socket fills up
        assert!(service.feed.feed().output(1).len() <= 2 * QUEUE_BYTES_MAX);
        service.append(2001..=2010);
        let mut got = Vec::new();
        while read(&mut client, &mut got) > 0 {
            service.turn(2);
        }
        assert_eq!(ids(&got), (1..=2010).collect::<Vec<_>>());
        assert_eq!(service.feed.deadline_ns(), None);
        drop(client);
        service.turn(3);
        assert!(service.feed.feed().is_empty());
    }

    #[test]
    fn connections_that_say_nothing_do_not_keep_the_places_of_the_feed() {
        let mut service = Service::new();
        service.append(1..=1);
        let path = service.directory.path().join(SOCKET_FILE);
        let mut silent: Vec<_> =
            (0..CLIENTS_MAX).map(|_| UnixStream::connect(&path).unwrap()).collect();
        // Half a request is none, and saying ever more of it buys no time.
        silent[0].write_all(b"{").unwrap();
        service.turn(1);
        assert_eq!(service.feed.feed().len(), CLIENTS_MAX);
        let due_ns = service.feed.deadline_ns().unwrap();
        assert!(due_ns <= 5_000_000_001, "within seconds: {due_ns}");
        silent[0].write_all(b" ").unwrap();
        service.turn(due_ns);
        assert!(service.feed.feed().is_empty());
        let mut client = service.connect();
        (0..2).for_each(|_| service.turn(due_ns + 1)); // it is accepted, then heard
        let mut got = Vec::new();
        read(&mut client, &mut got);
        assert_eq!(ids(&got), [1]);
    }

    #[test]
    fn a_client_that_hangs_loses_its_place_and_reads_why_when_it_wakes() {
        let mut service = Service::new();
        service.append(1..=2000);
        let mut client = service.connect();
        (0..5).for_each(|_| service.turn(1));
        assert_eq!(service.feed.deadline_ns(), Some(1 + STALL_NS));
        service.turn(1 + STALL_NS);
        let mut got = Vec::new();
        while read(&mut client, &mut got) > 0 {
            service.turn(2 + STALL_NS);
        }
        let last = got.lines().last().unwrap().unwrap();
        assert!(last.contains("last journal_id that came"), "{last}");
        let ids = ids(&got);
        assert_eq!(ids, (1..=ids.len() as u64).collect::<Vec<_>>());
        assert!(service.feed.feed().is_empty());
    }
}
