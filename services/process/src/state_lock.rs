//! Who writes a state directory: one site at a time, whatever its run directory. Two mappers on one
//! checkpoint, or two detectors on one outbox, would each undo what the other wrote.
//!
//! The lock in the directory says it to everybody who sees the file, also from another container; the
//! name in the kernel, of the directory itself, says it on this host also when the file is removed.

use crate::file::kind;
use crate::name_lock::{NameLock, NameTaken};
use rustix::fs::{FlockOperation, OFlags, flock};
use rustix::io::Errno;
use std::fs::{self, File, Metadata};
use std::io::{self, ErrorKind, Read, Seek, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// Why a state directory is not to be written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StateError {
    /// Somebody else writes it.
    #[error(
        "process {pid} writes the state directory {}: stop that site first, or give this one a \
         `state_dir` of its own",
        state_dir.display()
    )]
    Taken {
        /// Its process id, as it wrote it.
        pid: String,
        /// The directory.
        state_dir: PathBuf,
    },
    /// Something else lies in its place, or in that of its lock.
    #[error("{} is {found}, expected {expected}: move it away", path.display())]
    InTheWay {
        /// The path.
        path: PathBuf,
        /// What is there.
        found: &'static str,
        /// What should be there.
        expected: &'static str,
    },
}

/// Less room than that holds no model and no journal page.
const FREE_BYTES_MIN: u64 = 64 << 10;

/// Held as long as the state directory is written; gone with the process, however it ends.
#[derive(Debug)]
pub struct StateLock {
    state_dir: PathBuf,
    /// The directory that was there: device and inode.
    directory: Option<Identity>,
    lock: Option<File>,
    name: Option<NameLock>,
    /// What was said last, so that it is said once.
    said: Option<String>,
}

type Identity = (u64, u64);

impl StateLock {
    /// Takes the state directory, which is created if need be. A directory that cannot be written
    /// (its disk is full or read-only, or the rights are missing) is no reason to refuse: the services
    /// say so, and a disk may get well again.
    ///
    /// # Errors
    /// If somebody else holds it, or something else lies in its place.
    pub fn take(state_dir: &Path) -> Result<Self, StateError> {
        let state_dir = state_dir.to_owned();
        let mut lock = Self { state_dir, directory: None, lock: None, name: None, said: None };
        if let Err(error) = lock.take_again()? {
            tracing::warn!("cannot lock the state directory {}: {error}", lock.state_dir.display());
        }
        Ok(lock)
    }

    /// Looks whether the directory and its lock are still those that were taken, and takes them again
    /// if somebody removed them. Says in words what was found, once. To be called now and then.
    ///
    /// # Errors
    /// [`StateError::Taken`] if somebody else has taken it meanwhile: then there are two writers.
    pub fn look(&mut self) -> Result<Option<String>, StateError> {
        let directory = identity(fs::metadata(&self.state_dir));
        let lock_path = self.state_dir.join("lock");
        let ours = self.lock.as_ref().and_then(|lock| identity(lock.metadata()));
        if ours.is_some()
            && directory == self.directory
            && identity(fs::symlink_metadata(&lock_path)) == ours
        {
            self.said = None;
            return Ok(None);
        }
        let (had_lock, dir) = (ours.is_some(), self.state_dir.display().to_string());
        let lost = match self.directory {
            Some(_) if directory.is_none() => format!("the state directory {dir} was removed"),
            Some(before) if directory != Some(before) => {
                format!("another directory was put in the place of the state directory {dir}")
            }
            _ => format!("{} was removed", lock_path.display()),
        };
        let words = match self.take_again() {
            Ok(Ok(())) if !had_lock => return Ok(None), // a disk that got well
            Ok(Ok(())) => format!(
                "{lost} while the site runs; it is there again, and the services write there what \
                 they have in memory, each in its time"
            ),
            Ok(Err(_)) if !had_lock && self.said.is_none() => return Ok(None), // said at the start
            Ok(Err(error)) => {
                format!("{lost} while the site runs, and cannot be made again: {error}")
            }
            Err(error @ StateError::InTheWay { .. }) => error.to_string(),
            Err(taken) => return Err(taken),
        };
        let is_news = self.said.as_ref() != Some(&words);
        self.said = Some(words.clone());
        Ok(is_news.then_some(words))
    }

    /// The inner error: the disk does not take it.
    fn take_again(&mut self) -> Result<io::Result<()>, StateError> {
        if let Err(error) = create(&self.state_dir) {
            in_the_way(&self.state_dir, "a directory", fs::symlink_metadata(&self.state_dir))?;
            return Ok(Err(error));
        }
        let directory = identity(fs::metadata(&self.state_dir));
        if self.name.is_none() || directory != self.directory {
            self.take_name(directory)?;
        }
        self.directory = directory;
        let path = self.state_dir.join("lock");
        let flags = (OFlags::NOFOLLOW | OFlags::NONBLOCK).bits() as i32; // nothing else is written to
        let mut options = File::options();
        options.read(true).write(true).create(true).truncate(false).custom_flags(flags);
        let opened = options.open(&path);
        in_the_way(&path, "a file", fs::symlink_metadata(&path))?;
        let lock = match opened {
            Ok(lock) => lock,
            Err(error) => return Ok(Err(error)),
        };
        if flock(&lock, FlockOperation::NonBlockingLockExclusive) == Err(Errno::WOULDBLOCK) {
            let mut pid = String::new();
            let _ = (&lock).take(20).read_to_string(&mut pid); // without it the directory is named
            return Err(self.taken(pid.trim()));
        }
        // For the words of whoever comes next; a full disk keeps nobody from the lock.
        let _ = write_pid(&lock);
        self.lock = Some(lock);
        Ok(Ok(()))
    }

    fn take_name(&mut self, directory: Option<Identity>) -> Result<(), StateError> {
        let Some((device, inode)) = directory else { return Ok(()) };
        match NameLock::take(&format!("tog-state-{device:x}-{inode:x}")) {
            Ok(name) => self.name = Some(name),
            Err(NameTaken::Process(pid)) => return Err(self.taken(&pid)),
            Err(NameTaken::Io(_)) => self.name = None, // the lock in the directory is left
        }
        Ok(())
    }

    fn taken(&self, pid: &str) -> StateError {
        StateError::Taken { pid: pid.to_owned(), state_dir: self.state_dir.clone() }
    }
}

/// Makes a state directory, if it is not there.
///
/// # Errors
/// In words that name it, say what is in its place, and what to do.
pub fn create(state_dir: &Path) -> io::Result<()> {
    fs::create_dir_all(state_dir).map_err(|error| {
        let found = fs::symlink_metadata(state_dir);
        let what = match in_the_way(state_dir, "a directory", found) {
            Err(in_the_way) => in_the_way.to_string(),
            Ok(()) => format!(
                "cannot make the state directory {}: {error}: free space, give this user the right \
                 to, or set another `state_dir`",
                state_dir.display()
            ),
        };
        io::Error::new(error.kind(), what)
    })
}

/// Says in words that the disk under a state directory is full, if it is: a service tells it at its
/// start, and not only when it writes for the first time.
#[must_use]
pub fn shortage(state_dir: &Path) -> Option<String> {
    let found = rustix::fs::statvfs(state_dir).ok()?;
    // File systems without blocks do not say how much room there is.
    let free_bytes = found.f_bavail.saturating_mul(found.f_frsize);
    if found.f_blocks == 0 || free_bytes >= FREE_BYTES_MIN {
        return None;
    }
    Some(format!(
        "the disk of the state directory {} is full ({free_bytes} bytes are free): free space on it, \
         or a restart loses what was learnt since the last copy",
        state_dir.display()
    ))
}

/// Refuses what is there and is not what was expected.
fn in_the_way(
    path: &Path,
    expected: &'static str,
    found: io::Result<Metadata>,
) -> Result<(), StateError> {
    let Ok(found) = found else {
        // A parent that is a file: nothing below it can ever be made.
        return match fs::metadata(path).map_err(|error| error.kind()) {
            Err(ErrorKind::NotADirectory) => Err(StateError::InTheWay {
                path: path.to_owned(),
                found: "below something that is no directory",
                expected,
            }),
            _ => Ok(()),
        };
    };
    let found = kind(found.file_type());
    // A link to a directory is a directory to us; where it leads nowhere `metadata` fails.
    let leads_there = expected == "a directory" && fs::metadata(path).is_ok_and(|to| to.is_dir());
    if found == expected || leads_there {
        return Ok(());
    }
    Err(StateError::InTheWay { path: path.to_owned(), found, expected })
}

fn identity(metadata: io::Result<Metadata>) -> Option<Identity> {
    metadata.ok().map(|metadata| (metadata.dev(), metadata.ino()))
}

fn write_pid(mut lock: &File) -> io::Result<()> {
    lock.set_len(0)?;
    lock.rewind()?;
    write!(lock, "{}", std::process::id())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    fn state_dir() -> (tempfile::TempDir, PathBuf) {
        let directory = tempfile::tempdir().unwrap();
        let state_dir = directory.path().join("state");
        (directory, state_dir)
    }

    #[test]
    fn a_state_directory_has_one_writer_at_a_time() {
        let (_directory, state_dir) = state_dir();
        let first = StateLock::take(&state_dir).unwrap();
        let refused = StateLock::take(&state_dir).unwrap_err();
        let pid = std::process::id().to_string();
        assert!(matches!(&refused, StateError::Taken { pid: found, .. } if *found == pid));
        assert!(refused.to_string().contains("a `state_dir` of its own"));
        drop(first);
        StateLock::take(&state_dir).unwrap();
    }

    #[test]
    fn a_lock_that_is_removed_lets_nobody_in_and_is_there_again_after_a_look() {
        let (_directory, state_dir) = state_dir();
        let mut first = StateLock::take(&state_dir).unwrap();
        assert_eq!(first.look(), Ok(None));
        fs::remove_file(state_dir.join("lock")).unwrap();
        assert!(matches!(StateLock::take(&state_dir), Err(StateError::Taken { .. })));
        let words = first.look().unwrap().unwrap();
        assert!(words.contains("state/lock was removed"), "{words}");
        assert!(state_dir.join("lock").is_file());
        assert_eq!(first.look(), Ok(None));
    }

    #[test]
    fn a_state_directory_that_is_removed_is_told_once_and_made_again() {
        let (_directory, state_dir) = state_dir();
        let mut first = StateLock::take(&state_dir).unwrap();
        fs::remove_dir_all(&state_dir).unwrap();
        let words = first.look().unwrap().unwrap();
        assert!(words.contains("the state directory") && words.contains("was removed"), "{words}");
        assert_eq!(first.look(), Ok(None));
        assert!(matches!(StateLock::take(&state_dir), Err(StateError::Taken { .. })));
        fs::remove_dir_all(&state_dir).unwrap();
        fs::write(&state_dir, b"in the way").unwrap();
        let words = first.look().unwrap().unwrap();
        assert!(words.contains("state is a file, expected a directory"), "{words}");
        assert_eq!(first.look(), Ok(None), "said once");
    }

    #[test]
    fn a_second_writer_of_a_directory_that_was_made_anew_is_found() {
        let (_directory, state_dir) = state_dir();
        let mut first = StateLock::take(&state_dir).unwrap();
        fs::rename(&state_dir, state_dir.with_extension("old")).unwrap();
        let _second = StateLock::take(&state_dir).unwrap();
        assert!(matches!(first.look(), Err(StateError::Taken { .. })));
    }

    #[test]
    fn what_is_in_the_way_is_refused_in_words() {
        let (_directory, state_dir) = state_dir();
        let refused = |words: &str| {
            let error = StateLock::take(&state_dir).unwrap_err().to_string();
            assert!(error.contains(words) && error.contains("move it away"), "{error}");
        };
        fs::write(&state_dir, b"").unwrap();
        refused("state is a file, expected a directory");
        assert!(create(&state_dir).unwrap_err().to_string().contains("is a file, expected"));
        fs::remove_file(&state_dir).unwrap();
        symlink("/nowhere/at/all", &state_dir).unwrap();
        refused("state is a link, expected a directory");
        fs::remove_file(&state_dir).unwrap();
        fs::create_dir_all(state_dir.join("lock")).unwrap();
        refused("lock is a directory, expected a file");
        fs::remove_dir(state_dir.join("lock")).unwrap();
        let precious = state_dir.join("precious");
        fs::write(&precious, b"precious").unwrap();
        symlink(&precious, state_dir.join("lock")).unwrap();
        refused("expected a file");
        assert_eq!(fs::read(&precious).unwrap(), b"precious");
        assert!(StateLock::take(Path::new("/dev/null/state")).is_err());
    }

    #[test]
    fn a_directory_that_cannot_be_written_is_left_to_the_services() {
        // Nobody, not even root, makes a directory in /proc.
        let mut lock = StateLock::take(Path::new("/proc/tog-state")).unwrap();
        assert_eq!(lock.look(), Ok(None));
    }
}
