//! The files of one session, as rosbag2 lays them out: `<name>/<name>_<n>.mcap` and a
//! `metadata.yaml` that is written anew whenever a file is complete; and which files are kept.

use crate::bag_metadata::metadata_yaml;
use crate::error::RecordingError;
use crate::facts::file_facts;
use crate::mcap_writer::{ACTIVE_SUFFIX, FileFacts};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Name of the file about all files.
const METADATA_FILE: &str = "metadata.yaml";

/// A directory of recordings of one session.
#[derive(Debug)]
pub struct BagDirectory {
    path: PathBuf,
    name: String,
    files: Vec<FileFacts>,
}

impl BagDirectory {
    /// Makes the directory, or opens it and looks at the complete files in it. A file that has its
    /// final name but cannot be read is passed over: it is not ours.
    ///
    /// # Errors
    /// [`RecordingError::Io`].
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let io = |source| RecordingError::Io { path: path.to_owned(), action: "use", source };
        fs::create_dir_all(path).map_err(io)?;
        let path = path.canonicalize().map_err(io)?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut directory = Self { path, name, files: Vec::new() };
        let names = directory.numbered(".mcap").map_err(io)?;
        directory.files = names
            .into_iter()
            .filter_map(|(_, name)| file_facts(&directory.path.join(name)).ok())
            .collect();
        Ok(directory)
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The complete files, in their order.
    #[must_use]
    pub fn files(&self) -> &[FileFacts] {
        &self.files
    }

    /// Where the next file goes: behind all that are there, complete or not.
    ///
    /// # Errors
    /// [`RecordingError::Io`].
    pub fn next_path(&self) -> Result<PathBuf, RecordingError> {
        let io =
            |source| RecordingError::Io { path: self.path.clone(), action: "look into", source };
        let complete = self.numbered(".mcap").map_err(io)?;
        let active = self.numbered(&format!(".mcap{ACTIVE_SUFFIX}")).map_err(io)?;
        let highest = complete.iter().chain(&active).map(|(number, _)| *number).max();
        let number = highest.map_or(0, |number| number + 1);
        Ok(self.path.join(format!("{}_{number}.mcap", self.name)))
    }

    /// Files that are not complete: being written, or left by a recorder that was killed.
    ///
    /// # Errors
    /// [`RecordingError::Io`].
    pub fn active(&self) -> Result<Vec<PathBuf>, RecordingError> {
        let names = self.numbered(&format!(".mcap{ACTIVE_SUFFIX}")).map_err(|source| {
            RecordingError::Io { path: self.path.clone(), action: "look into", source }
        })?;
        let paths = names.into_iter().map(|(_, name)| self.path.join(name));
        // A pipe of such a name would be waited for.
        let is_file = |path: &PathBuf| fs::symlink_metadata(path).is_ok_and(|m| m.is_file());
        Ok(paths.filter(is_file).collect())
    }

    /// Takes note of a complete file, and writes the metadata.
    ///
    /// # Errors
    /// [`RecordingError::Io`].
    pub fn add(&mut self, facts: FileFacts) -> Result<(), RecordingError> {
        // Somebody may have deleted files, or the whole directory, since they were noted.
        let path = &self.path;
        self.files.retain(|file| file.name != facts.name && path.join(&file.name).is_file());
        self.files.push(facts);
        let name = &self.name;
        self.files.sort_by_key(|file| number_of(&file.name, name, ".mcap"));
        self.write_metadata()
    }

    /// Deletes a complete file, and writes the metadata; the directory goes with its last file.
    ///
    /// # Errors
    /// [`RecordingError::Io`].
    pub fn remove(&mut self, name: &str) -> Result<(), RecordingError> {
        let path = self.path.join(name);
        fs::remove_file(&path).map_err(|source| RecordingError::Io {
            path,
            action: "delete",
            source,
        })?;
        self.files.retain(|file| file.name != name);
        if !self.files.is_empty() || !self.active()?.is_empty() {
            return self.write_metadata();
        }
        let _ = fs::remove_file(self.path.join(METADATA_FILE));
        let _ = fs::remove_dir(&self.path); // somebody's notes in it may stay
        Ok(())
    }

    fn write_metadata(&self) -> Result<(), RecordingError> {
        let path = self.path.join(METADATA_FILE);
        let unfinished = self.path.join(".metadata.unfinished");
        File::create(&unfinished)
            .and_then(|mut file| {
                file.write_all(metadata_yaml(&self.files).as_bytes())?;
                file.sync_all()
            })
            .and_then(|()| fs::rename(&unfinished, &path))
            .map_err(|source| RecordingError::Io { path, action: "write", source })
    }

    /// Files of ours with this ending, in the order of their numbers.
    fn numbered(&self, ending: &str) -> io::Result<Vec<(u64, String)>> {
        let mut found = Vec::new();
        for entry in fs::read_dir(&self.path)? {
            let name = entry?.file_name().to_string_lossy().into_owned();
            if let Some(number) = number_of(&name, &self.name, ending) {
                found.push((number, name));
            }
        }
        found.sort();
        Ok(found)
    }
}

/// The number of `<bag>_<number><ending>`.
fn number_of(name: &str, bag: &str, ending: &str) -> Option<u64> {
    let digits = name.strip_prefix(bag)?.strip_prefix('_')?.strip_suffix(ending)?;
    digits.parse().ok().filter(|_| digits.bytes().all(|byte| byte.is_ascii_digit()))
}

/// What is kept of the recordings of a site.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Kept {
    /// At most so many bytes; `None`: all.
    pub bytes_max: Option<u64>,
    /// At most so long, nanoseconds; `None`: for ever.
    pub age_max_ns: Option<u64>,
}

/// A complete file of a site.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordedFile {
    /// Where it is.
    pub path: PathBuf,
    /// Its length, bytes.
    pub bytes: u64,
    /// When it was complete, UNIX nanoseconds.
    pub last_ns: u64,
}

/// Which of the files have to go, the oldest first, so that `kept` holds at `now_ns`. `open_bytes`
/// are those of the file that is being written: they count, but it stays.
#[must_use]
pub fn to_remove(
    mut files: Vec<RecordedFile>,
    open_bytes: u64,
    now_ns: u64,
    kept: Kept,
) -> Vec<RecordedFile> {
    files.sort_by(|a, b| (a.last_ns, &a.path).cmp(&(b.last_ns, &b.path)));
    let mut bytes = files.iter().map(|file| file.bytes).fold(open_bytes, u64::saturating_add);
    let mut removed = Vec::new();
    for file in files {
        let is_old = kept.age_max_ns.is_some_and(|age| now_ns.saturating_sub(file.last_ns) > age);
        let is_much = kept.bytes_max.is_some_and(|max| bytes > max);
        if is_old || is_much {
            bytes -= file.bytes;
            removed.push(file);
        }
    }
    removed
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(name: &str, bytes: u64, last_ns: u64) -> RecordedFile {
        RecordedFile { path: name.into(), bytes, last_ns }
    }

    fn names(files: &[RecordedFile]) -> Vec<String> {
        files.iter().map(|file| file.path.display().to_string()).collect()
    }

    #[test]
    fn the_oldest_go_until_the_rest_fits() {
        let files = || vec![file("c", 30, 3), file("a", 10, 1), file("b", 20, 2)];
        let kept = |bytes| Kept { bytes_max: Some(bytes), age_max_ns: None };
        assert_eq!(names(&to_remove(files(), 0, 9, kept(60))), [""; 0]);
        assert_eq!(names(&to_remove(files(), 0, 9, kept(59))), ["a"]);
        assert_eq!(names(&to_remove(files(), 40, 9, kept(60))), ["a", "b", "c"]);
    }

    #[test]
    fn what_is_too_old_goes_whatever_its_size() {
        let files = vec![file("a", 1, 100), file("b", 1, 201)];
        let kept = Kept { bytes_max: None, age_max_ns: Some(99) };
        assert_eq!(names(&to_remove(files.clone(), 0, 200, kept)), ["a"]);
        assert_eq!(names(&to_remove(files, 0, 50, kept)), [""; 0], "a clock that was set back");
    }

    #[test]
    fn only_our_names_have_numbers() {
        assert_eq!(number_of("bag_12.mcap", "bag", ".mcap"), Some(12));
        for foreign in ["bag_+1.mcap", "bag_.mcap", "other_1.mcap", "bag_1.mcap.active", "bag_1"] {
            assert_eq!(number_of(foreign, "bag", ".mcap"), None, "{foreign}");
        }
    }
}
