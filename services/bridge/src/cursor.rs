//! What a bridge keeps on disk: the name of its journal, how far it has those of others, and who ran the
//! areas that it shares (`tenure-<area>.json`).
//!
//! In `<state_dir>/<host>/bridge/`: `epoch.json` names this state directory for ever; `<host>.json` is
//! the cursor into the journal of another host. A cursor that is lost or too old costs only rows that
//! the own journal knows already, so it is replaced whole and not synced.

use crate::follower::Cursor;
use crate::ownership::Stored;
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

    /// The name of the journal in this state directory: `fresh`, if it has none yet.
    ///
    /// # Errors
    /// If it cannot be read or written; a damaged file is one: whoever follows must not be told
    /// another name.
    pub fn epoch(&self, fresh: u64) -> io::Result<u64> {
        let path = self.directory.join("epoch.json");
        if let Some(epoch) = read(&path)? {
            return Ok(epoch);
        }
        write(&path, &fresh, true)?;
        Ok(fresh)
    }

    /// The cursor into the journal of a host; none if there is none yet.
    ///
    /// # Errors
    /// If there is one that cannot be read: to begin anew is safe, but is said.
    pub fn cursor(&self, host: &str) -> io::Result<Option<Cursor>> {
        read(&self.path(host))
    }

    /// Who ran an area, as far as this host knew; none if it never did.
    ///
    /// # Errors
    /// If it cannot be read; a damaged file is one: an epoch must not be used twice.
    pub fn tenure(&self, area: &str) -> io::Result<Option<Stored>> {
        read(&self.directory.join(format!("tenure-{area}.json")))
    }

    /// Keeps that, on the disk itself.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn store_tenure(&self, area: &str, stored: Stored) -> io::Result<()> {
        write(&self.directory.join(format!("tenure-{area}.json")), &stored, true)
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

fn read<T: DeserializeOwned>(path: &Path) -> io::Result<Option<T>> {
    let file = match File::open(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        file => file?,
    };
    let mut text = String::new();
    file.take(FILE_BYTES_MAX).read_to_string(&mut text)?;
    serde_json::from_str(&text).map(Some).map_err(|error| {
        io::Error::new(ErrorKind::InvalidData, format!("{} is damaged: {error}", path.display()))
    })
}

/// The file is there as it was, or as it shall be.
fn write<T: Serialize>(path: &Path, value: &T, sync: bool) -> io::Result<()> {
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
        assert_eq!((shelf.epoch(5).unwrap(), shelf.epoch(6).unwrap()), (5, 5));
        assert_eq!(shelf.cursor("epoch").unwrap(), None);
        let cursor = Cursor { epoch: Some(u64::MAX), row: 9 };
        shelf.store("epoch", cursor).unwrap();
        let again = Shelf::open(directory.path()).unwrap();
        assert_eq!((again.cursor("epoch").unwrap(), again.epoch(7).unwrap()), (Some(cursor), 5));
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
}
