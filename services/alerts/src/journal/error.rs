//! What can go wrong with the journal, in words, sorted by what is to be done about it.

use rusqlite::ErrorCode;
use std::path::{Path, PathBuf};

/// Why the journal could not be read or written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum JournalError {
    /// No room. The change is not on disk; try again when there is space.
    #[error(
        "the disk under the journal {path} is full ({detail}): free space on it; \
         events are kept in memory until then"
    )]
    Full {
        /// The journal.
        path: PathBuf,
        /// What SQLite says.
        detail: String,
    },
    /// The content is not what was written. The file must be set aside.
    #[error("the journal {path} is damaged: {detail}")]
    Damaged {
        /// The journal.
        path: PathBuf,
        /// What was found.
        detail: String,
    },
    /// Any other failure of reading or writing: permissions, a disk that fails.
    #[error(
        "the journal {path} cannot be used: {detail}: \
         check the disk and the rights of this user on it"
    )]
    Unusable {
        /// The journal.
        path: PathBuf,
        /// What SQLite or the system says.
        detail: String,
    },
    /// A file of something else is in the place.
    #[error(
        "{path} is an SQLite file but not a journal of tog (application id {found:#x}): \
         move it away, or set another state_dir in the site file"
    )]
    Foreign {
        /// The file.
        path: PathBuf,
        /// Its application id.
        found: i64,
    },
    /// Written by a later program.
    #[error(
        "the journal {path} has layout version {found}, this tog writes {expected}: \
         update tog, or set another state_dir in the site file"
    )]
    Newer {
        /// The journal.
        path: PathBuf,
        /// Its version.
        found: i64,
        /// Ours.
        expected: i64,
    },
    /// There is none.
    #[error("there is no journal at {path}: `tog run SITE` begins one")]
    Missing {
        /// Where it should be.
        path: PathBuf,
    },
}

impl JournalError {
    /// Sorts an error of SQLite by what is to be done about it.
    pub(super) fn from_sqlite(path: &Path, error: &rusqlite::Error) -> Self {
        let path = path.to_owned();
        // The extended code says which operation failed: read, write, sync, map.
        let detail = match error.sqlite_error() {
            Some(failure) => format!("{error}, SQLite code {}", failure.extended_code),
            None => error.to_string(),
        };
        match error.sqlite_error_code() {
            Some(ErrorCode::DiskFull) => Self::Full { path, detail },
            // SQLite says "disk I/O error" when there is no room for its index of the log.
            Some(ErrorCode::SystemIoFailure) if has_no_room(&path) => Self::Full { path, detail },
            Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase) => {
                Self::Damaged { path, detail }
            }
            _ => Self::Unusable { path, detail },
        }
    }

    pub(super) fn from_io(path: &Path, error: &std::io::Error) -> Self {
        let path = path.to_owned();
        let detail = error.to_string();
        match error.kind() {
            std::io::ErrorKind::StorageFull => Self::Full { path, detail },
            _ => Self::Unusable { path, detail },
        }
    }
}

/// True if the disk under `path` has less room than the smallest write needs.
fn has_no_room(path: &Path) -> bool {
    const NEEDED_BYTES: u64 = 64 * 1024; // a log and its index, 32 kB each
    let directory = path.parent().filter(|parent| !parent.as_os_str().is_empty());
    rustix::fs::statvfs(directory.unwrap_or(Path::new(".")))
        .is_ok_and(|disk| disk.f_bavail.saturating_mul(disk.f_frsize) < NEEDED_BYTES)
}
