//! Reading the journal: after a cursor for the feed, by filter for people.

use super::{Journal, JournalError, integer};
use protocol::event::{EventChange, EventKind, EventState};
use rusqlite::{Row, params};

/// Most rows that one `list` returns: 100,000 rows are 100 MB of text, more is a job for `sqlite3`.
pub const LIST_LIMIT_MAX: usize = 100_000;

/// A row of the journal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// Cursor of the feed.
    pub journal_id: u64,
    /// When this host received it, UNIX nanoseconds.
    pub received_ns: u64,
    /// The change as JSON, byte for byte as it was journaled: an object with the fields of
    /// [`EventChange`].
    pub json: String,
}

impl Entry {
    /// The change.
    ///
    /// # Errors
    /// If the row was written by hand, or by a later tog that knows other kinds.
    pub fn change(&self) -> Result<EventChange, serde_json::Error> {
        serde_json::from_str(&self.json)
    }

    /// A line of JSON without its newline: the change and `journal_id`, `journaled`, `received_ns`.
    #[must_use]
    pub fn line(&self) -> String {
        let fields = self.json.strip_prefix('{').unwrap_or(&self.json);
        format!(
            "{{\"journal_id\":{},\"journaled\":true,\"received_ns\":{},{fields}",
            self.journal_id, self.received_ns
        )
    }

    fn read(row: &Row<'_>) -> rusqlite::Result<Self> {
        Ok(Self {
            journal_id: row.get::<_, i64>(0)?.unsigned_abs(),
            received_ns: row.get::<_, i64>(1)?.unsigned_abs(),
            json: row.get(2)?,
        })
    }
}

/// What of the journal is wanted. The default is the newest 100 events.
#[derive(Debug, Clone, PartialEq)]
pub struct Filter {
    /// Every change instead of the newest change of each event.
    pub changes: bool,
    /// Only events that are not over.
    pub open_only: bool,
    /// Only in this state.
    pub state: Option<EventState>,
    /// Only of this kind.
    pub kind: Option<EventKind>,
    /// Only in this area.
    pub area: Option<String>,
    /// Only with a stamp at or after this, UNIX nanoseconds.
    pub since_ns: Option<u64>,
    /// At most so many, the newest; at most [`LIST_LIMIT_MAX`].
    pub limit: usize,
}

impl Default for Filter {
    fn default() -> Self {
        Self {
            changes: false,
            open_only: false,
            state: None,
            kind: None,
            area: None,
            since_ns: None,
            limit: 100,
        }
    }
}

impl Filter {
    /// The newest change of every event that is not over.
    #[must_use]
    pub fn open() -> Self {
        Self { open_only: true, limit: LIST_LIMIT_MAX, ..Self::default() }
    }
}

impl Journal {
    /// Up to `limit` rows after the cursor, in order.
    ///
    /// # Errors
    /// If the journal cannot be read.
    pub fn after(&self, journal_id: u64, limit: usize) -> Result<Vec<Entry>, JournalError> {
        self.run(|connection| {
            connection
                .prepare_cached(
                    "SELECT journal_id, received_ns, change_json FROM event_change
                     WHERE journal_id > ?1 ORDER BY journal_id LIMIT ?2",
                )?
                .query_map(params![integer(journal_id), integer(limit as u64)], Entry::read)?
                .collect()
        })
    }

    /// The newest rows that pass the filter, oldest first.
    ///
    /// # Errors
    /// If the journal cannot be read.
    pub fn list(&self, filter: &Filter) -> Result<Vec<Entry>, JournalError> {
        let mut rows: Vec<Entry> = self.run(|connection| {
            connection
                .prepare(
                    "SELECT journal_id, received_ns, change_json FROM event_change AS c
                     WHERE (?1 OR sequence = (SELECT max(sequence) FROM event_change AS d
                                              WHERE d.event_id = c.event_id))
                       AND (NOT ?2 OR 'cleared' <> (SELECT e.state FROM event_change AS e
                                WHERE e.event_id = c.event_id ORDER BY sequence DESC LIMIT 1))
                       AND (?3 IS NULL OR state = ?3)
                       AND (?4 IS NULL OR kind = ?4)
                       AND (?5 IS NULL OR area = ?5)
                       AND (?6 IS NULL OR stamp_ns >= ?6)
                     ORDER BY journal_id DESC LIMIT ?7",
                )?
                .query_map(
                    params![
                        filter.changes,
                        filter.open_only,
                        filter.state.map(state_name),
                        filter.kind.map(kind_name),
                        filter.area,
                        filter.since_ns.map(integer),
                        integer(filter.limit.min(LIST_LIMIT_MAX) as u64),
                    ],
                    Entry::read,
                )?
                .collect()
        })?;
        rows.reverse();
        Ok(rows)
    }
}

/// The name of a kind in JSON and in the journal: `unusual_activity`.
#[must_use]
pub fn kind_name(kind: EventKind) -> String {
    kind.words().replace(' ', "_")
}

/// The name of a state in JSON and in the journal: `raised`.
#[must_use]
pub fn state_name(state: EventState) -> &'static str {
    match state {
        EventState::Raised => "raised",
        EventState::Updated => "updated",
        EventState::Cleared => "cleared",
    }
}

pub(super) fn to_json(change: &EventChange) -> rusqlite::Result<String> {
    serde_json::to_string(change)
        .map_err(|error| rusqlite::Error::ToSqlConversionFailure(Box::new(error)))
}
