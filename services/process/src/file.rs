//! Files whose content nobody vouches for: whatever lies at the path, reading it ends, and takes a
//! bounded amount of memory. A pipe without a writer would be waited for, `/dev/zero` never ends.

use rustix::fs::OFlags;
use std::fs::{File, FileType, OpenOptions};
use std::io::{self, ErrorKind, Read};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// Opens a regular file for reading and says its length in bytes. Never waits.
///
/// # Errors
/// [`ErrorKind::InvalidData`], see [`is_unfit`], if something else lies there; what the system says.
pub fn open_regular(path: &Path) -> io::Result<(File, u64)> {
    // Looked at before it is opened, because opening alone makes some devices do something.
    demand_regular(std::fs::metadata(path)?.file_type())?;
    let flags = (OFlags::NONBLOCK | OFlags::NOCTTY).bits() as i32;
    let file = OpenOptions::new().read(true).custom_flags(flags).open(path)?;
    let metadata = file.metadata()?;
    demand_regular(metadata.file_type())?;
    Ok((file, metadata.len()))
}

/// All bytes of a regular file of at most `bytes_max`.
///
/// # Errors
/// [`ErrorKind::InvalidData`], see [`is_unfit`], if it is no regular file or longer; what the system
/// says.
pub fn read_bounded(path: &Path, bytes_max: u64) -> io::Result<Vec<u8>> {
    let (file, found) = open_regular(path)?;
    let mut bytes = Vec::new();
    if found <= bytes_max {
        // One more than may be: a file that grows meanwhile is too long as well.
        file.take(bytes_max.saturating_add(1)).read_to_end(&mut bytes)?;
    }
    let found = found.max(bytes.len() as u64);
    if found > bytes_max {
        return Err(unfit(format!("it has {found} bytes, expected at most {bytes_max}")));
    }
    Ok(bytes)
}

/// True if the error says that what lies there cannot be such a file, however often it is read.
#[must_use]
pub fn is_unfit(error: &io::Error) -> bool {
    error.kind() == ErrorKind::InvalidData
}

/// Such an error.
#[must_use]
pub fn unfit(reason: String) -> io::Error {
    io::Error::new(ErrorKind::InvalidData, reason)
}

fn demand_regular(found: FileType) -> io::Result<()> {
    if found.is_file() {
        return Ok(());
    }
    Err(unfit(format!("it is {}, expected a regular file", kind(found))))
}

/// A path with something behind its name.
#[must_use]
pub fn beside(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}

/// Keeps a damaged file as `<file>.damaged-<stamp>`; where it is now.
///
/// # Errors
/// If it cannot be renamed.
pub fn set_aside(path: &Path, stamp_ns: u64) -> io::Result<PathBuf> {
    let aside = beside(path, &format!(".damaged-{stamp_ns}"));
    std::fs::rename(path, &aside)?;
    Ok(aside)
}

/// What lies there, in words: `a directory`.
#[must_use]
pub fn kind(found: FileType) -> &'static str {
    if found.is_file() {
        "a file"
    } else if found.is_dir() {
        "a directory"
    } else if found.is_symlink() {
        "a link"
    } else if found.is_fifo() {
        "a pipe"
    } else if found.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use rustix::fs::{CWD, FileType as Kind, Mode, mknodat};
    use std::os::unix::fs::symlink;
    use std::os::unix::net::UnixListener;

    #[test]
    fn what_is_no_regular_file_is_refused_in_words_and_never_waited_for() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        mknodat(CWD, at("pipe"), Kind::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        symlink("/dev/zero", at("zero")).unwrap();
        let _listener = UnixListener::bind(at("socket")).unwrap();
        for (path, words) in [
            (at("pipe"), "a pipe"),
            (at("zero"), "a device"),
            (at("socket"), "a socket"),
            (directory.path().to_owned(), "a directory"),
        ] {
            let error = read_bounded(&path, 10).unwrap_err();
            assert!(is_unfit(&error) && error.to_string().contains(words), "{error}");
        }
    }

    #[test]
    fn a_file_is_read_up_to_its_bound() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("file");
        assert_eq!(read_bounded(&path, 10).unwrap_err().kind(), ErrorKind::NotFound);
        std::fs::write(&path, b"0123456789").unwrap();
        assert_eq!(read_bounded(&path, 10).unwrap(), b"0123456789");
        File::options().write(true).open(&path).unwrap().set_len(4 << 30).unwrap();
        let error = read_bounded(&path, 10).unwrap_err();
        assert!(is_unfit(&error), "{error}");
        assert_eq!(error.to_string(), "it has 4294967296 bytes, expected at most 10");
    }
}
