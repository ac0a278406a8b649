//! What `tog bag` writes over, and what it does not: looked at before anything is read.

use super::BagError;
use std::fs::{self, FileType};
use std::io;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

/// Where to write what is named `out`: itself, or the file that it is a link to.
///
/// # Errors
/// There is a file and `force` is not said; or something that is no file: a directory, a device, a
/// pipe, a link to nothing.
pub fn target(out: &Path, force: bool) -> Result<PathBuf, BagError> {
    let refuse = |found| BagError::NoFile { path: out.to_owned(), found };
    let io = |source| BagError::Target { path: out.to_owned(), source };
    let place = match fs::symlink_metadata(out) {
        Ok(found) if found.is_symlink() => {
            out.canonicalize().map_err(|_| refuse("a link to nothing"))?
        }
        Ok(_) => out.to_owned(),
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(out.to_owned()),
        Err(error) => return Err(io(error)),
    };
    let kind = fs::metadata(&place).map_err(io)?.file_type();
    if !kind.is_file() {
        return Err(refuse(words(kind)));
    }
    if force { Ok(place) } else { Err(BagError::Exists(out.to_owned())) }
}

fn words(kind: FileType) -> &'static str {
    if kind.is_dir() {
        "a directory"
    } else if kind.is_fifo() {
        "a pipe"
    } else if kind.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn only_files_are_written_over_and_links_stay_links() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().canonicalize().unwrap().join(name);
        fs::write(path("file"), "x").unwrap();
        fs::create_dir(path("dir")).unwrap();
        assert!(std::process::Command::new("mkfifo").arg(path("pipe")).status().unwrap().success());
        for name in ["file", "dir", "pipe", "absent"] {
            symlink(path(name), path(&format!("{name}_link"))).unwrap();
        }
        assert_eq!(target(&path("new"), false).unwrap(), path("new"));
        assert_eq!(target(&path("file"), true).unwrap(), path("file"));
        assert_eq!(target(&path("file_link"), true).unwrap(), path("file"));
        for (name, words) in [
            ("dir", "is a directory"),
            ("dir_link", "is a directory"),
            ("pipe", "is a pipe"),
            ("pipe_link", "is a pipe"),
            ("absent_link", "is a link to nothing"),
        ] {
            for force in [false, true] {
                let error = target(&path(name), force).unwrap_err().to_string();
                assert!(error.contains(words), "{error}");
            }
        }
        assert!(target(&path("file"), false).unwrap_err().to_string().contains("--force"));
    }
}
