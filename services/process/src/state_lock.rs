//! Who writes a state directory: one site at a time, whatever its run directory. Two mappers on one
//! checkpoint, or two detectors on one outbox, would each undo what the other wrote.

use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;
use std::fs::{self, File};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};

/// Somebody else writes the state directory.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "process {pid} writes the state directory {}: stop that site first, or give this one a \
     `state_dir` of its own",
    state_dir.display()
)]
pub struct StateTaken {
    /// Its process id, as it wrote it.
    pub pid: String,
    /// The directory.
    pub state_dir: PathBuf,
}

/// Held as long as the state directory is written; gone with the process, however it ends.
#[derive(Debug)]
pub struct StateLock {
    _lock: Option<File>,
}

impl StateLock {
    /// Takes the state directory, which is created if need be. A directory that cannot be written is
    /// no reason to refuse: the services say so, and a disk may get well again.
    ///
    /// # Errors
    /// [`StateTaken`] if somebody else holds it.
    pub fn take(state_dir: &Path) -> Result<Self, StateTaken> {
        let open = || {
            fs::create_dir_all(state_dir)?;
            let path = state_dir.join("lock");
            File::options().read(true).write(true).create(true).truncate(false).open(path)
        };
        let Ok(mut lock) = open() else { return Ok(Self { _lock: None }) };
        if flock(&lock, FlockOperation::NonBlockingLockExclusive) == Err(Errno::WOULDBLOCK) {
            let mut pid = String::new();
            let _ = (&lock).take(20).read_to_string(&mut pid); // without it the directory is named
            let (pid, state_dir) = (pid.trim().to_owned(), state_dir.to_owned());
            return Err(StateTaken { pid, state_dir });
        }
        // For the words of whoever comes next; a full disk keeps nobody from the lock.
        let _ = lock.set_len(0);
        let _ = lock.rewind();
        let _ = write!(lock, "{}", std::process::id());
        Ok(Self { _lock: Some(lock) })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_state_directory_has_one_writer_at_a_time() {
        let directory = tempfile::tempdir().unwrap();
        let state_dir = directory.path().join("state");
        let first = StateLock::take(&state_dir).unwrap();
        let refused = StateLock::take(&state_dir).unwrap_err();
        assert_eq!(refused.pid, std::process::id().to_string());
        assert!(refused.to_string().contains("a `state_dir` of its own"));
        drop(first);
        StateLock::take(&state_dir).unwrap();
    }

    #[test]
    fn a_directory_that_cannot_be_written_is_left_to_the_services() {
        assert!(StateLock::take(Path::new("/dev/null/state")).is_ok());
    }
}
