//! The journal: every change of every event, durable, unique by `(origin, sequence)`, in one SQLite
//! file (WAL, `synchronous=FULL`: a commit that returned survives a power cut).
//!
//! `journal_id` grows with every row and is never used again: it is the cursor of the feed.
//! `contiguous` of an origin is what may be acknowledged: everything up to it is a row here, or was
//! given up and is noted in the table `gap`.

mod damage;
mod error;
mod query;
mod schema;

pub use damage::Damage;
pub use error::JournalError;
pub use query::{Entry, Filter, LIST_LIMIT_MAX, kind_name, state_name};

use protocol::event::{EventChange, NUMBERING_MASK, begins_numbering};
use rusqlite::{Connection, OpenFlags, OptionalExtension, Transaction, params};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Name of the journal in the state directory of a site.
pub const JOURNAL_FILE: &str = "journal.sqlite3";
/// How long a write waits for a reader that holds a lock: long for a query, short for an alarm.
const BUSY_TIMEOUT: Duration = Duration::from_millis(1000);
/// A file up to this size is checked whole at the start (about 0.2 s); of a larger one only the
/// structure that an append needs, so that a restart stays below 2 s. Damage found later is treated
/// the same way.
const WHOLE_CHECK_BYTES_MAX: u64 = 64 << 20;

/// The journal of one site: the only writer, or a reader.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    /// Which file `path` was when it was opened.
    inode: Option<u64>,
    connection: Connection,
}

/// What an append did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Appended {
    /// Rows that are new.
    pub appended: usize,
    /// Changes that were there already: same `(origin, sequence)`.
    pub duplicates: usize,
    /// Of those, the ones whose content was another: their origin lost count (see `intake`).
    pub conflicts: usize,
    /// The highest `journal_id`; 0 if the journal is empty.
    pub head: u64,
}

impl Journal {
    /// Opens the journal for writing, begins it if there is none, brings an old layout up to date.
    /// A damaged file is set aside and a new one begun; the damage is returned and must be said.
    ///
    /// `now_ns` (UNIX) names the file set aside. Journal ids of a new file begin at the
    /// milliseconds of `now_ns`: a cursor into a journal that was here before, damaged or deleted,
    /// stays behind them, so its owner misses nothing of the new one.
    ///
    /// # Errors
    /// All but [`JournalError::Damaged`] and [`JournalError::Missing`].
    pub fn open(path: &Path, now_ns: u64) -> Result<(Self, Option<Damage>), JournalError> {
        match Self::open_sound(path, now_ns) {
            Err(JournalError::Damaged { detail, .. }) => {
                let (journal, damage) = Self::begin_anew(path, now_ns, detail)?;
                Ok((journal, Some(damage)))
            }
            Err(error) => Err(error),
            Ok(journal) => Ok((journal, None)),
        }
    }

    /// Sets the file at `path` aside and begins a new one: for damage that shows while running.
    /// The old `Journal` must have been dropped.
    ///
    /// # Errors
    /// As [`Journal::open`].
    pub fn begin_anew(
        path: &Path,
        now_ns: u64,
        reason: String,
    ) -> Result<(Self, Damage), JournalError> {
        let kept_as = damage::set_aside(path, now_ns)?;
        let journal = Self::open_sound(path, now_ns)?;
        Ok((journal, Damage { kept_as, reason }))
    }

    fn open_sound(path: &Path, now_ns: u64) -> Result<Self, JournalError> {
        let io = |error: std::io::Error| JournalError::from_io(path, &error);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent).map_err(io)?;
        }
        let is_new = !path.exists();
        let flags = OpenFlags::SQLITE_OPEN_READ_WRITE
            | OpenFlags::SQLITE_OPEN_CREATE
            | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let sqlite = |error: rusqlite::Error| JournalError::from_sqlite(path, &error);
        let mut connection = Connection::open_with_flags(path, flags).map_err(sqlite)?;
        connection.busy_timeout(BUSY_TIMEOUT).map_err(sqlite)?;
        let version = identify(path, &connection)?;
        (|| {
            connection.pragma_update(None, "journal_mode", "WAL")?;
            connection.pragma_update(None, "synchronous", "FULL")?;
            let first_id = integer(now_ns / protocol::time::MILLISECOND_NS);
            schema::migrate(&mut connection, version, first_id)
        })()
        .map_err(sqlite)?;
        if is_new {
            damage::sync_directory_of(path).map_err(io)?;
        }
        let journal = Self { path: path.to_owned(), inode: inode_of(path), connection };
        journal.check()?;
        Ok(journal)
    }

    /// Opens the journal for reading, beside a writer or without one.
    ///
    /// # Errors
    /// All of [`JournalError`]; nothing is set aside or changed.
    pub fn open_read_only(path: &Path) -> Result<Self, JournalError> {
        if !path.exists() {
            return Err(JournalError::Missing { path: path.to_owned() });
        }
        let sqlite = |error: rusqlite::Error| JournalError::from_sqlite(path, &error);
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(path, flags).map_err(sqlite)?;
        connection.busy_timeout(BUSY_TIMEOUT).map_err(sqlite)?;
        match identify(path, &connection)? {
            // Begun by a writer that has not made its tables yet: nothing has happened so far.
            0 => Err(JournalError::Missing { path: path.to_owned() }),
            _ => Ok(Self { path: path.to_owned(), inode: inode_of(path), connection }),
        }
    }

    /// Puts the journal back if somebody removed its file while it was open: what is read through
    /// the open file is written to a new one. True if that was so.
    ///
    /// # Errors
    /// If another file is in its place, or the new one cannot be written.
    pub fn restore_if_removed(&mut self) -> Result<bool, JournalError> {
        let found = inode_of(&self.path);
        if found == self.inode {
            return Ok(false);
        }
        if found.is_some() {
            let detail = "another file was put in its place while the site runs: stop the site, put \
                          the right one there, start it again";
            return Err(JournalError::Unusable {
                path: self.path.clone(),
                detail: detail.to_owned(),
            });
        }
        if let Some(parent) = self.path.parent() {
            let io = |error: std::io::Error| JournalError::from_io(&self.path, &error);
            std::fs::create_dir_all(parent).map_err(io)?;
        }
        // A copy under another name first: the journal is there whole or not at all.
        let beside = damage::with_suffix(&self.path, ".restored");
        let io = |error: std::io::Error| JournalError::from_io(&self.path, &error);
        let _ = std::fs::remove_file(&beside); // of an attempt that failed
        let target = beside.to_string_lossy();
        let copied = self
            .run(|connection| connection.execute("VACUUM INTO ?1", [target.as_ref()]))
            .and_then(|_| std::fs::rename(&beside, &self.path).map_err(io));
        if let Err(error) = copied {
            // Half a copy is of no use, and may hold the last space of the disk.
            let _ = std::fs::remove_file(&beside);
            return Err(error);
        }
        // The old file is closed first, so that it does not clear away the log of the new one.
        let nothing = Connection::open_in_memory();
        self.connection = nothing.map_err(|error| JournalError::from_sqlite(&self.path, &error))?;
        *self = Self::open_sound(&self.path, 0)?; // it has its tables: nothing begins
        Ok(true)
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn check(&self) -> Result<(), JournalError> {
        let size = std::fs::metadata(&self.path).map_or(0, |file| file.len());
        let verdict = self.run(|connection| {
            if size <= WHOLE_CHECK_BYTES_MAX {
                return connection.query_row("PRAGMA quick_check(1)", [], |row| row.get(0));
            }
            connection.query_row("SELECT count(*) FROM origin", [], |_| Ok(()))?;
            connection
                .query_row(
                    "SELECT * FROM event_change ORDER BY journal_id DESC LIMIT 1",
                    [],
                    |_| Ok(()),
                )
                .optional()?;
            Ok("ok".to_owned())
        })?;
        if verdict == "ok" {
            return Ok(());
        }
        Err(JournalError::Damaged { path: self.path.clone(), detail: verdict })
    }

    /// Writes the changes in one transaction and returns when they are on disk. All or none.
    ///
    /// A change whose `(origin, sequence)` is there already is left out and counted.
    ///
    /// # Errors
    /// [`JournalError::Full`] and others; then none of the changes is in the journal.
    pub fn append(
        &mut self,
        changes: &[EventChange],
        received_ns: u64,
    ) -> Result<Appended, JournalError> {
        let rows: Vec<_> = changes.iter().map(|change| (received_ns, change)).collect();
        self.append_received(&rows)
    }

    /// As [`Journal::append`], with a `received_ns` for each change.
    ///
    /// # Errors
    /// As [`Journal::append`].
    pub fn append_received(
        &mut self,
        rows: &[(u64, &EventChange)],
    ) -> Result<Appended, JournalError> {
        let path = &self.path;
        let sqlite = |error: rusqlite::Error| JournalError::from_sqlite(path, &error);
        let transaction = self.connection.transaction().map_err(sqlite)?;
        let mut outcome = Appended::default();
        for (received_ns, change) in rows {
            insert(&transaction, change, *received_ns, &mut outcome).map_err(sqlite)?;
        }
        outcome.head = head(&transaction).map_err(sqlite)?;
        transaction.commit().map_err(sqlite)?;
        Ok(outcome)
    }

    /// Gives up the changes `first..=last` of an origin: nobody can deliver them. Notes the gap and
    /// lets `contiguous` go past it.
    ///
    /// # Errors
    /// As [`Journal::append`].
    pub fn give_up(
        &mut self,
        origin: &str,
        first: u64,
        last: u64,
        noted_ns: u64,
    ) -> Result<(), JournalError> {
        let path = &self.path;
        let mut write = || {
            let transaction = self.connection.transaction()?;
            transaction.execute(
                "INSERT INTO gap (origin, first, last, noted_ns) VALUES (?1, ?2, ?3, ?4)",
                params![origin, integer(first), integer(last), integer(noted_ns)],
            )?;
            advance(&transaction, origin, integer(last))?;
            transaction.commit()
        };
        write().map_err(|error| JournalError::from_sqlite(path, &error))
    }

    /// The sequence up to which everything of `origin` is here or was given up; 0 if it is unknown.
    ///
    /// # Errors
    /// If the journal cannot be read.
    pub fn highest_contiguous(&self, origin: &str) -> Result<u64, JournalError> {
        self.run(|connection| {
            let sql = "SELECT contiguous FROM origin WHERE origin = ?1";
            let value: Option<i64> =
                connection.prepare_cached(sql)?.query_row([origin], |row| row.get(0)).optional()?;
            Ok(value.unwrap_or(0).unsigned_abs())
        })
    }

    /// All origins and their `highest_contiguous`, by name.
    ///
    /// # Errors
    /// If the journal cannot be read.
    pub fn origins(&self) -> Result<Vec<(String, u64)>, JournalError> {
        self.run(|connection| {
            let mut statement = connection.prepare("SELECT * FROM origin ORDER BY origin")?;
            let rows = statement.query_map([], |row| Ok((row.get(0)?, row.get::<_, i64>(1)?)))?;
            rows.map(|row| row.map(|(origin, n): (String, i64)| (origin, n.unsigned_abs())))
                .collect()
        })
    }

    /// The highest `journal_id`; 0 if the journal is empty.
    ///
    /// # Errors
    /// If the journal cannot be read.
    pub fn head(&self) -> Result<u64, JournalError> {
        self.run(head)
    }

    /// Limits the file to `pages` pages of 4 kB: a quota, and how tests fill the disk.
    ///
    /// # Errors
    /// If SQLite refuses.
    pub fn set_pages_max(&self, pages: u32) -> Result<(), JournalError> {
        self.run(|connection| {
            connection.pragma_update_and_check(None, "max_page_count", pages, |_| Ok(()))
        })
    }

    fn run<T>(
        &self,
        query: impl FnOnce(&Connection) -> rusqlite::Result<T>,
    ) -> Result<T, JournalError> {
        query(&self.connection).map_err(|error| JournalError::from_sqlite(&self.path, &error))
    }
}

/// Names a file for as long as somebody has it open; none if there is none.
fn inode_of(path: &Path) -> Option<u64> {
    std::fs::metadata(path).ok().map(|found| found.ino())
}

/// Whose file it is: the version of its layout, 0 for an empty file.
fn identify(path: &Path, connection: &Connection) -> Result<i64, JournalError> {
    let (application_id, version, tables) = (|| {
        let pragma = |name: &str| connection.pragma_query_value(None, name, |row| row.get(0));
        let tables: i64 =
            connection.query_row("SELECT count(*) FROM sqlite_schema", [], |row| row.get(0))?;
        Ok::<(i64, i64, i64), rusqlite::Error>((
            pragma("application_id")?,
            pragma("user_version")?,
            tables,
        ))
    })()
    .map_err(|error| JournalError::from_sqlite(path, &error))?;
    if application_id != schema::APPLICATION_ID && (tables > 0 || application_id != 0) {
        return Err(JournalError::Foreign { path: path.to_owned(), found: application_id });
    }
    if version > schema::VERSION {
        let expected = schema::VERSION;
        return Err(JournalError::Newer { path: path.to_owned(), found: version, expected });
    }
    Ok(version)
}

fn insert(
    transaction: &Transaction<'_>,
    change: &EventChange,
    received_ns: u64,
    outcome: &mut Appended,
) -> rusqlite::Result<()> {
    let json = query::to_json(change)?;
    let there: Option<String> = transaction
        .prepare_cached("SELECT change_json FROM event_change WHERE origin = ?1 AND sequence = ?2")?
        .query_row(params![change.origin, integer(change.sequence)], |row| row.get(0))
        .optional()?;
    if let Some(there) = there {
        outcome.duplicates += 1;
        outcome.conflicts += usize::from(there != json);
        return Ok(());
    }
    let mut statement = transaction.prepare_cached(
        "INSERT INTO event_change (received_ns, origin, sequence, event_id, kind, state, stamp_ns,
           first_evidence_ns, area, zone, x_m, y_m, x_min_m, y_min_m, x_max_m, y_max_m, score,
           threshold, extrapolated, text, change_json)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15, ?16, ?17, ?18,
           ?19, ?20, ?21)",
    )?;
    let [x_min_m, y_min_m, x_max_m, y_max_m] = change.bounds_m;
    statement.execute(params![
        integer(received_ns),
        change.origin,
        integer(change.sequence),
        change.id,
        kind_name(change.kind),
        state_name(change.state),
        integer(change.stamp_ns),
        integer(change.first_evidence_ns),
        change.area,
        change.zone,
        change.x_m,
        change.y_m,
        x_min_m,
        y_min_m,
        x_max_m,
        y_max_m,
        change.score,
        change.threshold,
        change.extrapolated,
        change.text,
        json,
    ])?;
    outcome.appended += 1;
    advance(transaction, &change.origin, 0)
}

/// Moves `contiguous` of an origin to at least `floor` and on over all rows that follow.
fn advance(transaction: &Transaction<'_>, origin: &str, floor: i64) -> rusqlite::Result<()> {
    let before: Option<i64> = transaction
        .prepare_cached("SELECT contiguous FROM origin WHERE origin = ?1")?
        .query_row([origin], |row| row.get(0))
        .optional()?;
    let mut contiguous = before.unwrap_or(0).max(floor);
    let mut next = transaction
        .prepare_cached("SELECT 1 FROM event_change WHERE origin = ?1 AND sequence = ?2")?;
    let mut anew = transaction.prepare_cached(
        "SELECT min(sequence) FROM event_change WHERE origin = ?1 AND sequence > ?2 AND sequence & ?3 = 1",
    )?;
    loop {
        while contiguous < i64::MAX && next.exists(params![origin, contiguous + 1])? {
            contiguous += 1;
        }
        // Its origin forgot its numbers there: before it nothing is missing.
        let found: Option<i64> =
            anew.query_row(params![origin, contiguous, integer(NUMBERING_MASK)], |row| row.get(0))?;
        let Some(begin) = found.filter(|begin| begins_numbering(begin.unsigned_abs())) else {
            break;
        };
        contiguous = begin;
    }
    if before != Some(contiguous) {
        transaction
            .prepare_cached(
                "INSERT INTO origin (origin, contiguous) VALUES (?1, ?2)
                 ON CONFLICT (origin) DO UPDATE SET contiguous = ?2",
            )?
            .execute(params![origin, contiguous])?;
    }
    Ok(())
}

fn head(connection: &Connection) -> rusqlite::Result<u64> {
    let sql = "SELECT coalesce(max(journal_id), 0) FROM event_change";
    let head: i64 = connection.prepare_cached(sql)?.query_row([], |row| row.get(0))?;
    Ok(head.unsigned_abs())
}

/// SQLite's integers are signed; stamps reach their end in 2262, sequences never do.
fn integer(value: u64) -> i64 {
    i64::try_from(value).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests;
