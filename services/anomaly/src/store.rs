//! The files of an area in the state directory: `<area>.normal` (what was learnt) and
//! `<area>.outbox` (changes on their way to the journal).
//!
//! A file that cannot be used is named and kept aside as `<file>.damaged-<stamp>`; nothing is
//! replaced in silence. Whole files are written beside, synced, and renamed.

use crate::outbox::Outbox;
use crate::watch::Watch;
use process::file::{beside, is_unfit, read_bounded, set_aside};
use protocol::event::EventChange;
use protocol::time::SECOND_NS;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Largest outbox that is read: 16 Ki changes that wait, of at most 4 kB, four times over.
const OUTBOX_BYTES_MAX: u64 = 256 << 20;

/// What was learnt is written this often; a crash loses at most so much learning.
pub const SAVE_PERIOD_NS: u64 = 60 * SECOND_NS;

/// Where an area keeps what it learnt.
#[must_use]
pub fn normal_path(state_dir: &Path, area: &str) -> PathBuf {
    state_dir.join(format!("{area}.normal"))
}

/// Where an area keeps what it has to tell.
#[must_use]
pub fn outbox_path(state_dir: &Path, area: &str) -> PathBuf {
    state_dir.join(format!("{area}.outbox"))
}

/// Writes what a watch has learnt, atomically. For the service, and for a fast-forward that
/// prepares one.
///
/// # Errors
/// If the directory or the file cannot be written; the old file is untouched.
pub fn save_normal(state_dir: &Path, area: &str, watch: &mut Watch) -> io::Result<()> {
    write_atomic(&normal_path(state_dir, area), &watch.snapshot())
}

/// Restores what was learnt. `Ok(None)`: it goes on, or there is no file; `Ok(Some(words))`: the file
/// cannot be used and was kept aside.
///
/// # Errors
/// If the file is there and cannot be read or renamed; the error names it.
pub fn load_normal(
    state_dir: &Path,
    area: &str,
    watch: &mut Watch,
    stamp_ns: u64,
) -> io::Result<Option<String>> {
    let path = normal_path(state_dir, area);
    let error = match read(&path, watch.snapshot_bytes_max())? {
        Found::Nothing => return Ok(None),
        Found::Bytes(bytes) => match watch.restore(&bytes) {
            Ok(()) => return Ok(None),
            Err(error) => error.to_string(),
        },
        Found::Unfit(reason) => reason,
    };
    let aside = set_aside(&path, stamp_ns).map_err(named("rename", &path))?;
    Ok(Some(format!(
        "{}: {error}. It is kept as {}; area `{area}` learns anew.",
        path.display(),
        aside.display()
    )))
}

/// What lies at a path.
enum Found {
    Nothing,
    Bytes(Vec<u8>),
    /// No regular file, or a longer one than it can be: why.
    Unfit(String),
}

fn read(path: &Path, bytes_max: u64) -> io::Result<Found> {
    match read_bounded(path, bytes_max) {
        Ok(bytes) => Ok(Found::Bytes(bytes)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Found::Nothing),
        Err(error) if is_unfit(&error) => Ok(Found::Unfit(error.to_string())),
        Err(error) => Err(named("read", path)(error)),
    }
}

/// An error that says what could not be done with which file.
fn named(action: &'static str, path: &Path) -> impl Fn(io::Error) -> io::Error {
    move |error| {
        let text = format!(
            "cannot {action} {}: {error}: give this user the right to, or move it away",
            path.display()
        );
        io::Error::new(error.kind(), text)
    }
}

/// Writes a file beside the old one, syncs it, and renames it. Makes the directory if it is gone.
fn write_atomic(path: &Path, bytes: &[u8]) -> io::Result<()> {
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent)?;
    }
    let new = beside(path, ".new");
    let _ = fs::remove_file(&new); // of a run that was killed; never written through, nor waited for
    let written = File::create_new(&new).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_data()
    });
    if let Err(error) = written.and_then(|()| fs::rename(&new, path)) {
        let _ = fs::remove_file(&new); // half a file is of no use; the error is told
        return Err(error);
    }
    match path.parent() {
        Some(parent) => File::open(parent)?.sync_all(),
        None => Ok(()),
    }
}

/// True if nobody can find the file any more: what is written to it is gone with us.
fn is_removed(file: &File) -> bool {
    file.metadata().is_ok_and(|found| found.nlink() == 0)
}

/// An outbox and its file.
#[derive(Debug)]
pub struct OutboxFile {
    path: PathBuf,
    outbox: Outbox,
    /// `None` after an error: the file is written anew, whole, with the next change.
    file: Option<File>,
}

impl OutboxFile {
    /// Opens or creates the outbox of an area. What is damaged is cut off and kept aside; the second
    /// value says so in words.
    ///
    /// # Errors
    /// If the file can neither be read nor created.
    pub fn open(state_dir: &Path, area: &str, stamp_ns: u64) -> io::Result<(Self, Option<String>)> {
        let path = outbox_path(state_dir, area);
        let mut words = None;
        let bytes = match read(&path, OUTBOX_BYTES_MAX)? {
            Found::Nothing => Vec::new(),
            Found::Bytes(bytes) => bytes,
            Found::Unfit(reason) => {
                let aside = set_aside(&path, stamp_ns).map_err(named("rename", &path))?;
                let path = path.display();
                words = Some(format!(
                    "{path}: {reason}. It is kept as {}, and a new outbox is begun.",
                    aside.display()
                ));
                Vec::new()
            }
        };
        let loaded = Outbox::load(area, &bytes);
        if let Some(notice) = loaded.notice {
            let aside = beside(&path, &format!(".damaged-{stamp_ns}"));
            fs::copy(&path, &aside).map_err(named("copy", &path))?;
            words = Some(format!(
                "{}: {notice}. The whole file is kept as {}.",
                path.display(),
                aside.display()
            ));
        }
        let mut options = OpenOptions::new();
        options.create(true).truncate(false).write(true).read(true);
        let mut file = options.open(&path).map_err(named("open", &path))?;
        if loaded.good_bytes < bytes.len() {
            file.set_len(loaded.good_bytes as u64)?;
            file.sync_data()?;
        }
        file.seek(SeekFrom::End(0))?;
        Ok((Self { path, outbox: loaded.outbox, file: Some(file) }, words))
    }

    /// As [`Outbox::begin_if_new`].
    pub fn begin_if_new(&mut self, unix_ns: u64) {
        self.outbox.begin_if_new(unix_ns);
    }

    /// Writes changes down: from here on the death of this process loses nothing. What the death of
    /// the machine would lose is synced by [`OutboxFile::sync`]. After an error they are kept in memory,
    /// and written with the next ones or by [`OutboxFile::mend`].
    ///
    /// # Errors
    /// In words, if the disk does not take them; they are to be told all the same.
    pub fn append(&mut self, changes: &[EventChange]) -> Result<(), String> {
        let mut bytes = Vec::new();
        let mut refused = None;
        for change in changes {
            match self.outbox.append(change) {
                Ok(more) => bytes.extend(more),
                Err(reason) => refused = Some(reason),
            }
        }
        // Whoever removed the directory while we ran did not mean what is in it: it is written anew.
        if self.file.as_ref().is_some_and(is_removed) {
            self.file = None;
        }
        let Some(file) = &mut self.file else { return self.mend() };
        if let Err(error) = file.write_all(&bytes) {
            self.file = None;
            return Err(self.words(&error));
        }
        refused.map_or(Ok(()), Err)
    }

    /// Brings what was appended to the disk itself; milliseconds on a real one.
    ///
    /// # Errors
    /// In words, if the disk does not take it; the file is then written anew with the next change.
    pub fn sync(&mut self) -> Result<(), String> {
        let Some(file) = &mut self.file else { return Ok(()) };
        if let Err(error) = file.sync_data() {
            self.file = None;
            return Err(self.words(&error));
        }
        Ok(())
    }

    /// True if the file lacks something that is in memory.
    #[must_use]
    pub fn is_broken(&self) -> bool {
        self.file.is_none()
    }

    /// Writes the whole file anew, if it is broken.
    ///
    /// # Errors
    /// In words, if the disk still does not take it.
    pub fn mend(&mut self) -> Result<(), String> {
        if self.file.is_some() {
            return Ok(());
        }
        let whole = self.outbox.whole();
        self.rewrite(&whole).map_err(|error| self.words(&error))
    }

    fn rewrite(&mut self, whole: &[u8]) -> io::Result<()> {
        write_atomic(&self.path, whole)?;
        let mut file = OpenOptions::new().write(true).open(&self.path)?;
        file.seek(SeekFrom::End(0))?;
        self.file = Some(file);
        self.outbox.compacted(whole.len());
        Ok(())
    }

    fn words(&self, error: &io::Error) -> String {
        format!(
            "{}: {error}. Changes are told, but would be lost if this process ended now; free space \
             or repair the disk.",
            self.path.display()
        )
    }

    /// The journal has everything up to `sequence`; true if that is news. Trims the file when most
    /// of it is of no use.
    ///
    /// # Errors
    /// In words, if the file cannot be written anew.
    pub fn acknowledge(&mut self, sequence: u64) -> Result<bool, String> {
        let news = self.outbox.acknowledge(sequence);
        if let Some(whole) = self.outbox.compact() {
            self.rewrite(&whole).map_err(|error| {
                self.file = None;
                self.words(&error)
            })?;
        }
        Ok(news)
    }

    /// What it holds.
    #[must_use]
    pub fn outbox(&self) -> &Outbox {
        &self.outbox
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::testing::{area, laser};
    use protocol::event::{EventKind, EventState};

    fn change(sequence: u64) -> EventChange {
        EventChange {
            origin: "hall".to_owned(),
            sequence,
            id: format!("hall-{sequence}"),
            kind: EventKind::ObjectLeft,
            state: EventState::Raised,
            stamp_ns: 1,
            first_evidence_ns: 1,
            area: "hall".to_owned(),
            zone: None,
            x_m: 0.0,
            y_m: 0.0,
            bounds_m: [0.0; 4],
            score: 1.0,
            threshold: 1.0,
            extrapolated: false,
            text: "x".repeat(900),
        }
    }

    fn names(dir: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(dir)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_killed_process_finds_its_changes_and_a_torn_end_is_kept_aside() {
        let dir = tempfile::tempdir().unwrap();
        let (mut file, words) = OutboxFile::open(dir.path(), "hall", 7).unwrap();
        assert_eq!(words, None);
        file.append(&[change(1), change(2)]).unwrap();
        drop(file);
        let path = outbox_path(dir.path(), "hall");
        let whole = fs::metadata(&path).unwrap().len();
        OpenOptions::new().write(true).open(&path).unwrap().set_len(whole - 5).unwrap();
        let (mut file, words) = OutboxFile::open(dir.path(), "hall", 8).unwrap();
        assert!(words.unwrap().contains("hall.outbox.damaged-8"));
        assert_eq!(file.outbox().last_sequence(), 1);
        file.append(&[change(2)]).unwrap();
        let (file, words) = OutboxFile::open(dir.path(), "hall", 9).unwrap();
        assert_eq!((words, file.outbox().last_sequence()), (None, 2));
        assert_eq!(names(dir.path()), ["hall.outbox", "hall.outbox.damaged-8"]);
    }

    #[test]
    fn an_outbox_whose_directory_is_removed_is_written_anew() {
        let dir = tempfile::tempdir().unwrap();
        let state = dir.path().join("state");
        fs::create_dir(&state).unwrap();
        let (mut file, _) = OutboxFile::open(&state, "hall", 1).unwrap();
        file.append(&[change(1)]).unwrap();
        fs::remove_dir_all(&state).unwrap();
        file.append(&[change(2)]).unwrap();
        drop(file);
        let (again, words) = OutboxFile::open(&state, "hall", 2).unwrap();
        assert_eq!((again.outbox().unacknowledged().count(), words), (2, None));
    }

    #[test]
    fn what_is_acknowledged_leaves_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let (mut file, _) = OutboxFile::open(dir.path(), "hall", 7).unwrap();
        for sequence in 1..=200 {
            let mut change = change(sequence);
            change.state = EventState::Cleared;
            file.append(&[change]).unwrap();
        }
        let before = fs::metadata(outbox_path(dir.path(), "hall")).unwrap().len();
        assert!(file.acknowledge(200).unwrap());
        let after = fs::metadata(outbox_path(dir.path(), "hall")).unwrap().len();
        assert!(after < 100 && before > 100_000, "{before} {after}");
        file.append(&[change(201)]).unwrap();
        let (file, words) = OutboxFile::open(dir.path(), "hall", 9).unwrap();
        assert_eq!((words, file.outbox().last_sequence()), (None, 201));
        let waiting: Vec<u64> =
            file.outbox().unacknowledged().map(|change| change.sequence).collect();
        assert_eq!(waiting, [201]);
    }

    #[test]
    fn a_disk_that_fails_is_told_and_nothing_is_lost_when_it_works_again() {
        let dir = tempfile::tempdir().unwrap();
        let (mut file, _) = OutboxFile::open(dir.path(), "hall", 7).unwrap();
        file.append(&[change(1)]).unwrap();
        // A handle that cannot be written stands for a full disk.
        file.file = Some(File::open(outbox_path(dir.path(), "hall")).unwrap());
        let words = file.append(&[change(2)]).unwrap_err();
        assert!(words.contains("hall.outbox") && words.contains("told"), "{words}");
        assert!(file.is_broken());
        file.append(&[change(3)]).unwrap();
        let (file, _) = OutboxFile::open(dir.path(), "hall", 9).unwrap();
        let waiting: Vec<u64> =
            file.outbox().unacknowledged().map(|change| change.sequence).collect();
        assert_eq!(waiting, [1, 2, 3]);
    }

    #[test]
    fn what_is_no_file_of_ours_is_kept_aside_and_never_read_without_end() {
        let dir = tempfile::tempdir().unwrap();
        let mut watch = Watch::new(&area(20, 10), &[laser("front", 1.0, 0.0)]);
        let (normal, outbox) = (normal_path(dir.path(), "hall"), outbox_path(dir.path(), "hall"));
        for path in [&normal, &outbox] {
            std::os::unix::fs::symlink("/dev/zero", path).unwrap();
        }
        let words = load_normal(dir.path(), "hall", &mut watch, 1).unwrap().unwrap();
        assert!(words.contains("a device") && words.contains("hall.normal.damaged-1"), "{words}");
        let (_, words) = OutboxFile::open(dir.path(), "hall", 1).unwrap();
        let words = words.unwrap();
        assert!(words.contains("a device") && words.contains("hall.outbox.damaged-1"), "{words}");
        fs::remove_file(&outbox).unwrap();
        for path in [&normal, &outbox] {
            fs::create_dir(path).unwrap();
        }
        let words = load_normal(dir.path(), "hall", &mut watch, 2).unwrap().unwrap();
        assert!(words.contains("a directory, expected a regular file"), "{words}");
        let (mut file, words) = OutboxFile::open(dir.path(), "hall", 2).unwrap();
        assert!(words.unwrap().contains("hall.outbox.damaged-2"));
        file.append(&[change(1)]).unwrap();
        File::create_new(&normal).unwrap().set_len(4 << 30).unwrap();
        let words = load_normal(dir.path(), "hall", &mut watch, 3).unwrap().unwrap();
        assert!(words.contains("it has 4294967296 bytes, expected at most"), "{words}");
    }

    #[test]
    fn the_fullest_model_is_within_its_bound() {
        let dir = tempfile::tempdir().unwrap();
        let mut watch = Watch::new(&area(20, 10), &[laser("front", 1.0, 0.0)]);
        save_normal(dir.path(), "hall", &mut watch).unwrap();
        let found = fs::metadata(normal_path(dir.path(), "hall")).unwrap().len();
        // A count is one byte here and five at most.
        assert!(5 * found <= watch.snapshot_bytes_max(), "{found}");
    }

    #[test]
    fn a_damaged_model_is_kept_aside_and_learnt_anew() {
        let dir = tempfile::tempdir().unwrap();
        let site = area(20, 10);
        let lasers = [laser("front", 1.0, 0.0)];
        let mut watch = Watch::new(&site, &lasers);
        save_normal(dir.path(), "hall", &mut watch).unwrap();
        assert_eq!(load_normal(dir.path(), "hall", &mut watch, 3).unwrap(), None);
        let path = normal_path(dir.path(), "hall");
        let mut bytes = fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(&path, bytes).unwrap();
        let words = load_normal(dir.path(), "hall", &mut watch, 3).unwrap().unwrap();
        assert!(words.contains("checksum") && words.contains("hall.normal.damaged-3"), "{words}");
        assert_eq!(names(dir.path()), ["hall.normal.damaged-3"]);
    }
}
