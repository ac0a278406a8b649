//! The layout of the journal, for a person with `sqlite3` as much as for us.
//!
//! `PRAGMA user_version` counts the migrations that were applied; each is one transaction, none is
//! ever edited. `PRAGMA application_id` says that the file is ours before anything is written to
//! it.

use rusqlite::Connection;

/// "togJ": marks the file as a journal of tog.
pub(super) const APPLICATION_ID: i64 = 0x746f_674a;

/// Migration n brings the layout from version n to n + 1.
const MIGRATIONS: [&str; 1] = ["
CREATE TABLE event_change (
  journal_id INTEGER PRIMARY KEY AUTOINCREMENT, -- the cursor of the feed: grows, never reused
  received_ns INTEGER NOT NULL,                 -- UNIX nanoseconds, clock of this host
  origin TEXT NOT NULL,
  sequence INTEGER NOT NULL,                    -- grows by one a change of this origin
  event_id TEXT NOT NULL,                       -- the same in all changes of one happening
  kind TEXT NOT NULL,
  state TEXT NOT NULL,                          -- raised, updated, cleared
  stamp_ns INTEGER NOT NULL,
  first_evidence_ns INTEGER NOT NULL,
  area TEXT NOT NULL,                           -- empty for faults of the host
  zone TEXT,
  x_m REAL NOT NULL, y_m REAL NOT NULL,
  x_min_m REAL NOT NULL, y_min_m REAL NOT NULL, x_max_m REAL NOT NULL, y_max_m REAL NOT NULL,
  score REAL NOT NULL, threshold REAL NOT NULL,
  extrapolated INTEGER NOT NULL,
  text TEXT NOT NULL,
  change_json TEXT NOT NULL,                    -- the whole change, exactly as it was received
  UNIQUE (origin, sequence)
) STRICT;
CREATE INDEX event_change_by_event ON event_change (event_id, sequence);
CREATE INDEX event_change_by_stamp ON event_change (stamp_ns);
CREATE TABLE origin (
  origin TEXT PRIMARY KEY,
  contiguous INTEGER NOT NULL                   -- all up to here is in event_change or in gap
) STRICT, WITHOUT ROWID;
CREATE TABLE gap (                              -- changes that nobody could deliver any more
  origin TEXT NOT NULL,
  first INTEGER NOT NULL,
  last INTEGER NOT NULL,
  noted_ns INTEGER NOT NULL
) STRICT;
CREATE VIEW event AS                            -- one row a happening: its newest change
  SELECT event_id, kind, state, area, zone,
         strftime('%Y-%m-%d %H:%M:%S', first_evidence_ns / 1000000000, 'unixepoch') AS began_utc,
         strftime('%Y-%m-%d %H:%M:%S', stamp_ns / 1000000000, 'unixepoch') AS changed_utc,
         x_m, y_m, text, max(sequence) AS sequence
  FROM event_change GROUP BY event_id;
"];

/// The version that this program writes.
pub(super) const VERSION: i64 = MIGRATIONS.len() as i64;

/// Applies the migrations that are missing; rows of a new journal get ids above `first_id`.
pub(super) fn migrate(
    connection: &mut Connection,
    from_version: i64,
    first_id: i64,
) -> rusqlite::Result<()> {
    for (n, sql) in MIGRATIONS.iter().enumerate().skip(from_version.max(0) as usize) {
        let transaction = connection.transaction()?;
        transaction.execute_batch(sql)?;
        if n == 0 {
            transaction.execute(
                "INSERT INTO sqlite_sequence (name, seq) VALUES ('event_change', ?1)",
                [first_id],
            )?;
        }
        transaction.pragma_update(None, "application_id", APPLICATION_ID)?;
        transaction.pragma_update(None, "user_version", n as i64 + 1)?;
        transaction.commit()?;
    }
    Ok(())
}
