//! What a bridge keeps on disk: the name of its journal, how far it has those of others, and who ran the
//! areas that it shares (`tenure-<area>.json`).
//!
//! In `<state_dir>/<host>/bridge/`: `epoch.json` names this state directory for ever; `<host>.json` is
//! the cursor into the journal of another host. A cursor that is lost or too old costs only rows that
//! the own journal knows already, so it is replaced whole and not synced.

use crate::follower::Cursor;
use crate::ownership::Stored;
use process::file::set_aside;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

/// A file of two numbers is far below this.
const FILE_BYTES_MAX: u64 = 4096;

/// The directory.
#[derive(Debug)]
pub struct Shelf {
    directory: PathBuf,
}

impl Shelf {
    /// Makes the directory in the state directory of this host.
    ///
    /// # Errors
    /// If it cannot be made.
    pub fn open(state_dir: &Path) -> io::Result<Self> {
        let directory = state_dir.join("bridge");
        fs::create_dir_all(&directory)?;
        Ok(Self { directory })
    }

    /// The name of the journal in this state directory: `fresh`, if it has none yet, or none that can be
    /// read any more. Then desks read it from its first row; what they have they know.
    ///
    /// # Errors
    /// If it cannot be read or written; the error names it.
    pub fn epoch(&self, fresh: u64) -> io::Result<Kept<u64>> {
        let path = self.directory.join("epoch.json");
        let Kept { value, damage } = read_or_set_aside(&path, fresh)?;
        if value.is_none() {
            write(&path, &fresh, true)?;
        }
        Ok(Kept { value: value.unwrap_or(fresh), damage })
    }

    /// The cursor into the journal of a host; none if there is none yet.
    ///
    /// # Errors
    /// If there is one that cannot be read: to begin anew is safe, but is said.
    pub fn cursor(&self, host: &str) -> io::Result<Option<Cursor>> {
        read(&self.path(host))
    }

    /// Who ran an area, as far as this host knew; none if it never did, or if the file is damaged: then the
    /// other host tells the epoch, and if it is not there, nobody else uses it.
    ///
    /// # Errors
    /// If it cannot be read; the error names it.
    pub fn tenure(&self, area: &str, stamp_ns: u64) -> io::Result<Kept<Option<Stored>>> {
        read_or_set_aside(&self.tenure_path(area), stamp_ns)
    }

    /// Keeps that, on the disk itself.
    ///
    /// # Errors
    /// If it cannot be written; the error names it.
    pub fn store_tenure(&self, area: &str, stored: Stored) -> io::Result<()> {
        write(&self.tenure_path(area), &stored, true)
    }

    fn tenure_path(&self, area: &str) -> PathBuf {
        self.directory.join(format!("tenure-{area}.json"))
    }

    /// Where the cursor into the journal of a host is.
    pub fn path(&self, host: &str) -> PathBuf {
        // A host may be called `epoch`.
        self.directory.join(format!("cursor-{host}.json"))
    }

    /// Keeps a cursor.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn store(&self, host: &str, cursor: Cursor) -> io::Result<()> {
        write(&self.path(host), &cursor, false)
    }
}

/// What a file said.
#[derive(Debug)]
pub struct Kept<T> {
    /// As it was, or what is instead of it.
    pub value: T,
    /// If the file was damaged: in words, and where it is now.
    pub damage: Option<String>,
}

/// An error that says what could not be done with which file.
fn named(action: &'static str, path: &Path) -> impl Fn(io::Error) -> io::Error {
    move |error| {
        io::Error::new(error.kind(), format!("cannot {action} {}: {error}", path.display()))
    }
}

fn read_or_set_aside<T: DeserializeOwned>(
    path: &Path,
    stamp_ns: u64,
) -> io::Result<Kept<Option<T>>> {
    let error = match read(path) {
        Ok(value) => return Ok(Kept { value, damage: None }),
        Err(error) if error.kind() == ErrorKind::InvalidData => error,
        Err(error) => return Err(error),
    };
    let aside = set_aside(path, stamp_ns).map_err(named("rename", path))?;
    let damage = format!("{error}. It is kept as {}", aside.display());
    Ok(Kept { value: None, damage: Some(damage) })
}

fn read<T: DeserializeOwned>(path: &Path) -> io::Result<Option<T>> {
    let file = match File::open(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        file => file.map_err(named("read", path))?,
    };
    let mut text = String::new();
    file.take(FILE_BYTES_MAX).read_to_string(&mut text).map_err(named("read", path))?;
    serde_json::from_str(&text).map(Some).map_err(|error| {
        io::Error::new(ErrorKind::InvalidData, format!("{} is damaged: {error}", path.display()))
    })
}

/// The file is there as it was, or as it shall be.
fn write<T: Serialize>(path: &Path, value: &T, sync: bool) -> io::Result<()> {
    replace(path, value, sync).map_err(named("write", path))
}

fn replace<T: Serialize>(path: &Path, value: &T, sync: bool) -> io::Result<()> {
    let unfinished = path.with_extension("unfinished");
    let mut file = File::create(&unfinished)?;
    file.write_all(serde_json::to_string(value)?.as_bytes())?;
    if sync {
        file.sync_all()?;
    }
    drop(file);
    fs::rename(&unfinished, path)?;
    if let Some(directory) = path.parent().filter(|_| sync) {
        File::open(directory)?.sync_all()?;
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_journal_keeps_its_name_and_a_cursor_is_where_it_was() {
        let directory = tempfile::tempdir().unwrap();
        let shelf = Shelf::open(directory.path()).unwrap();
        let epoch = |shelf: &Shelf, fresh| shelf.epoch(fresh).unwrap().value;
        assert_eq!((epoch(&shelf, 5), epoch(&shelf, 6)), (5, 5));
        assert_eq!(shelf.cursor("epoch").unwrap(), None);
        let cursor = Cursor { epoch: Some(u64::MAX), row: 9 };
        shelf.store("epoch", cursor).unwrap();
        let again = Shelf::open(directory.path()).unwrap();
        assert_eq!((again.cursor("epoch").unwrap(), epoch(&again, 7)), (Some(cursor), 5));
    }

    #[test]
    fn damage_is_told_with_the_name_of_the_file() {
        let directory = tempfile::tempdir().unwrap();
        let shelf = Shelf::open(directory.path()).unwrap();
        for damage in ["", "{", "{\"epoch\":-1,\"row\":0}", "[[[["] {
            fs::write(shelf.path("edge"), damage).unwrap();
            let told = shelf.cursor("edge").unwrap_err().to_string();
            assert!(told.contains("cursor-edge.json is damaged"), "{told}");
        }
    }

    #[test]
    fn a_damaged_name_or_tenure_is_kept_aside_and_begun_anew() {
        let directory = tempfile::tempdir().unwrap();
        let shelf = Shelf::open(directory.path()).unwrap();
        let stored = Stored { epoch: 7, owns: true, run: 3 };
        shelf.store_tenure("hall", stored).unwrap();
        assert_eq!(shelf.tenure("hall", 1).unwrap().value, Some(stored));
        let bridge = directory.path().join("bridge");
        fs::write(bridge.join("tenure-hall.json"), [0xff, 0xfe]).unwrap();
        fs::write(bridge.join("epoch.json"), "no").unwrap();
        let tenure = shelf.tenure("hall", 9).unwrap();
        assert_eq!(tenure.value, None);
        let damage = tenure.damage.unwrap();
        assert!(damage.contains("tenure-hall.json.damaged-9"), "{damage}");
        let epoch = shelf.epoch(12).unwrap();
        assert_eq!((epoch.value, epoch.damage.is_some()), (12, true));
        assert!(bridge.join("epoch.json.damaged-12").exists());
        assert!(shelf.epoch(13).unwrap().damage.is_none(), "told once");
        assert_eq!(shelf.epoch(13).unwrap().value, 12);
        assert!(shelf.tenure("hall", 10).unwrap().damage.is_none());
    }

    #[test]
    fn what_cannot_be_written_is_named() {
        let directory = tempfile::tempdir().unwrap();
        let shelf = Shelf::open(directory.path()).unwrap();
        fs::remove_dir_all(directory.path()).unwrap();
        let told = shelf.store_tenure("hall", Stored::default()).unwrap_err().to_string();
        assert!(told.contains("cannot write") && told.contains("tenure-hall.json"), "{told}");
    }
}
