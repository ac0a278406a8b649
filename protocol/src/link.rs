//! What bridges say to each other, and nobody else does.

use crate::event::EventChange;
use crate::health::Health;
use crate::scan::LaserScan;
use serde::{Deserialize, Serialize};

/// Most rows of a page: a storm of events crosses in pages of 64, each below [`PAGE_BYTES_MAX`].
pub const PAGE_ROWS_MAX: usize = 64;
/// Longest encoded page, bytes: 64 changes of at most 4 kB.
pub const PAGE_BYTES_MAX: usize = 64 * 4096;

/// A scan on its way to another host, or the end of the recording.
///
/// What crosses between hosts names who says it, although its key does as well: zenoh 1.10 may deliver
/// under the key of somebody else when both sides dial.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct CarriedScan {
    /// The laser's id.
    pub laser: String,
    /// Names the run of the laser's process, as its envelope does in shared memory.
    pub session: u64,
    /// Grows by one a scan within the session: the other side counts what is missing.
    pub seq: u64,
    /// The scan; none at the end of a recording.
    pub scan: Option<LaserScan>,
}

/// How a process of a host is, on its way to the other hosts.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct HostHealth {
    /// The host's id.
    pub host: String,
    /// How the process is.
    pub health: Health,
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
    /// The host whose journal it is.
    pub host: String,
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

/// Highest epoch that a host may claim: two takeovers a second for longer than anybody watches. Above it
/// there is room for the next ones.
pub const EPOCH_MAX: u64 = 1 << 60;
/// Most areas whose claims are told at once.
const CLAIMS_MAX: usize = crate::site::AREAS_MAX;
/// Most bytes of a file in one [`FilePage`].
pub const FILE_PAGE_BYTES_MAX: usize = 128 * 1024;
/// Largest file that is copied to a standby: a hall of 400 x 400 cells with all that it learnt is some
/// MB, compressed.
pub const FILE_BYTES_MAX: u64 = 256 << 20;

/// A file of an area that its standby copies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AreaFile {
    /// The checkpoint of the mapper: counts and windows.
    Map,
    /// What the detector learnt.
    Normal,
}

impl AreaFile {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Map, Self::Normal];

    /// Its name in the state directory.
    #[must_use]
    pub fn name(self, area: &str) -> String {
        match self {
            Self::Map => format!("{area}.map"),
            Self::Normal => format!("{area}.normal"),
        }
    }
}

/// Which content a file has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileVersion {
    /// Which file.
    pub file: AreaFile,
    /// When it was written, UNIX nanoseconds of the host that has it.
    pub modified_ns: u64,
    /// Its length.
    pub bytes: u64,
}

/// What a host says of an area that it may run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Claim {
    /// The area's id.
    pub area: String,
    /// The highest epoch that this host knows of; of the owner its own.
    pub epoch: u64,
    /// True if it runs the area in this epoch.
    pub owns: bool,
    /// True if it stops, and wants the other one to take over.
    pub releases: bool,
    /// Its files, if it owns the area.
    pub files: Vec<FileVersion>,
}

/// All claims of a host.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Claims {
    /// The host that says so.
    pub host: String,
    /// One an area that it may run and another host may run as well.
    pub claims: Vec<Claim>,
}

impl Claims {
    /// Not too many, of epochs that may be.
    ///
    /// # Errors
    /// A sentence with what was found and what was expected.
    pub fn check_bounds(&self) -> Result<(), String> {
        let files = self.claims.iter().map(|claim| claim.files.len()).max().unwrap_or(0);
        if self.claims.len() > CLAIMS_MAX || files > AreaFile::ALL.len() {
            let (found, files_max) = (self.claims.len(), AreaFile::ALL.len());
            return Err(format!(
                "{found} claims of up to {files} files, expected at most {CLAIMS_MAX} of {files_max}"
            ));
        }
        if let Some(claim) = self.claims.iter().find(|claim| claim.epoch > EPOCH_MAX) {
            let Claim { area, epoch, .. } = claim;
            return Err(format!("epoch {epoch} of area {area:?}, expected at most {EPOCH_MAX}"));
        }
        Ok(())
    }
}

/// A part of a file on its way to a standby.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FilePage {
    /// The area's id.
    pub area: String,
    /// Which content of which file.
    pub version: FileVersion,
    /// Where in the file the bytes are.
    pub offset: u64,
    /// At most [`FILE_PAGE_BYTES_MAX`].
    pub bytes: Vec<u8>,
}

impl FilePage {
    /// The bytes lie in a file that is not too long.
    ///
    /// # Errors
    /// A sentence with what was found and what was expected.
    pub fn check_extent(&self) -> Result<(), String> {
        let (found, length) = (self.bytes.len(), self.version.bytes);
        if found > FILE_PAGE_BYTES_MAX || length > FILE_BYTES_MAX {
            return Err(format!(
                "{found} bytes of a file of {length}, expected at most {FILE_PAGE_BYTES_MAX} of \
                 {FILE_BYTES_MAX}"
            ));
        }
        if self.offset.saturating_add(found as u64) > length {
            return Err(format!("bytes {} + {found} of a file of {length}", self.offset));
        }
        Ok(())
    }
}
