//! What bridges say to each other, and nobody else does.

use crate::event::EventChange;
use crate::scan::LaserScan;
use serde::{Deserialize, Serialize};

/// Most rows of a page: a storm of events crosses in pages of 64, each below [`PAGE_BYTES_MAX`].
pub const PAGE_ROWS_MAX: usize = 64;
/// Longest encoded page, bytes: 64 changes of at most 4 kB.
pub const PAGE_BYTES_MAX: usize = 64 * 4096;

/// A scan on its way to another host, or the end of the recording.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct CarriedScan {
    /// Names the run of the laser's process, as its envelope does in shared memory.
    pub session: u64,
    /// Grows by one a scan within the session: the other side counts what is missing.
    pub seq: u64,
    /// The scan; none at the end of a recording.
    pub scan: Option<LaserScan>,
}

/// A row of a journal on its way to a desk.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EventRow {
    /// Its row in the journal of its host.
    pub journal_id: u64,
    /// What it says.
    pub change: EventChange,
}

/// Rows of the journal of one host, without a hole: all that it has after row `after` and up to the
/// last row of the page. Without rows it says where the journal ends.
///
/// One message for all three ways: a row as it comes, the head once a second, the answer of the log.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct EventPage {
    /// Names the state directory that the journal is in: its rows are counted from its first.
    pub epoch: u64,
    /// The rows follow this one; `head` or more if there are none.
    pub after: u64,
    /// The last row of the journal; 0 if it is empty.
    pub head: u64,
    /// In order, at most [`PAGE_ROWS_MAX`].
    pub rows: Vec<EventRow>,
}

impl EventPage {
    /// Rows count up, follow `after`, end at `head` or before it, and are not too many.
    ///
    /// # Errors
    /// A sentence with what was found and what was expected.
    pub fn check_order(&self) -> Result<(), String> {
        if self.rows.len() > PAGE_ROWS_MAX {
            let found = self.rows.len();
            return Err(format!("{found} rows in a page, expected at most {PAGE_ROWS_MAX}"));
        }
        let mut last = self.after;
        for row in &self.rows {
            if row.journal_id <= last || row.journal_id > self.head {
                return Err(format!(
                    "row {} behind row {last} of a journal that ends at {}",
                    row.journal_id, self.head
                ));
            }
            last = row.journal_id;
        }
        Ok(())
    }
}
