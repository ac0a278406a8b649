//! A damaged journal is evidence: it is named and kept aside, never repaired in place or
//! overwritten.

use super::JournalError;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// A journal that was set aside.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damage {
    /// Where it is now; `sqlite3 FILE .recover` reads what can be read.
    pub kept_as: PathBuf,
    /// What was found.
    pub reason: String,
}

/// Renames the journal and its `-wal` and `-shm` files to `<name>.damaged-<stamp>` and so on.
pub(super) fn set_aside(path: &Path, now_ns: u64) -> Result<PathBuf, JournalError> {
    let failed = |error: std::io::Error| JournalError::from_io(path, &error);
    let stamp = jiff::Timestamp::from_nanosecond(i128::from(now_ns)).map_or_else(
        |_| now_ns.to_string(),
        |time| time.strftime("%Y%m%dT%H%M%S%.9fZ").to_string(),
    );
    let kept = with_suffix(path, &format!(".damaged-{stamp}"));
    // The main file goes last: a crash in between leaves a main file that is still damaged, and the
    // next start comes here again.
    for suffix in ["-shm", "-wal", ""] {
        match std::fs::rename(with_suffix(path, suffix), with_suffix(&kept, suffix)) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                return Err(failed(error));
            }
            _ => {}
        }
    }
    sync_directory_of(path).map_err(failed)?;
    Ok(kept)
}

/// Makes the directory entry of a new or renamed file durable.
pub(super) fn sync_directory_of(path: &Path) -> std::io::Result<()> {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => std::fs::File::open(parent)?.sync_all(),
        _ => std::fs::File::open(".")?.sync_all(),
    }
}

pub(super) fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(suffix);
    PathBuf::from(name)
}
