//! The journal of events and its feed: what a security desk was told, when, and in which words.
//!
//! Purpose: a change of an event reaches this process from an origin (an area, the host), is
//! written to disk, and only then is anybody told. Whoever comes later asks "all after n".
//!
//! Invariants
//! - **fsync before anybody is told.** The one exception is a disk that cannot be written: the desk
//!   is told at once, and every such line is marked `"journaled": false` until the disk is back.
//! - **Nothing twice, nothing lost, nothing silent.** `(origin, sequence)` is unique in the
//!   journal. An origin keeps a change until it is acknowledged, and a change is acknowledged only
//!   once it is on disk. A change that nobody can deliver any more is a row in the table `gap` and
//!   a warning.
//! - **The contract of an origin**: keep what is not acknowledged (the highest number counts). Send
//!   it again when an acknowledgement comes from a new session (the service was restarted), or
//!   repeats a number (something before is missing). An acknowledgement beyond the own last number
//!   means that the origin lost its count: go on behind it.
//! - **In order.** Changes of one origin are journaled in the order of their sequence numbers.
//! - **The journal is the queue.** A client of the feed is a cursor into the journal: history and
//!   live are the same query, so there is no seam between them for a hole or a double.
//! - **Only one process writes**; any number may read, also with `sqlite3`, also while it runs.
//!
//! | question | where |
//! |---|---|
//! | what does the service do, in which order | [`run()`] |
//! | what is accepted, and in which order | [`intake`] |
//! | what if the disk is full | [`keeper`] |
//! | when is a lost host an event | [`absence`], pure |
//! | how is a change appended, acknowledged, given up | [`journal`] |
//! | what is in a row, how do layouts change | `journal/schema.rs` |
//! | how are rows found | `journal/query.rs` |
//! | what if the file is damaged | `journal/damage.rs` |
//! | what does a client of the feed send and get | [`feed`] |
//! | how does it sound to a guard | [`words`] |
//! | `tog alerts list`, `tog alerts watch` | [`list`](mod@list), [`watch`](mod@watch) |
//!
//! A person needs none of this to look into the journal:
//! ```sh
//! sqlite3 -readonly state/journal.sqlite3 "SELECT * FROM event WHERE state <> 'cleared'"
//! sqlite3 -readonly state/journal.sqlite3 "SELECT * FROM gap"   # what was lost, if anything was
//! (echo '{"after":0}'; cat) | nc -U /run/tog/foyer/alerts.sock   # the feed
//! ```
//!
//! Left out, on purpose: sinks that leave the host (webhook, syslog, MQTT), the desk page,
//! `acknowledged` by an operator, and retention: a row takes 0.7 kB, a hundred events a day are
//! 100 MB in four years, and nothing is ever deleted.

pub mod absence;
pub mod feed;
pub mod intake;
pub mod journal;
pub mod keeper;
pub mod list;
mod run;
#[cfg(test)]
mod testing;
pub mod watch;
pub mod words;

pub use feed::SOCKET_FILE;
pub use journal::{Entry, Filter, JOURNAL_FILE, Journal, JournalError};
pub use keeper::{Keeper, Now, Report};
pub use list::{Format, ListError, ListOptions, list};
pub use run::run;
pub use watch::{WatchError, WatchOptions, watch};
