//! The files of a recording: one, or those of a ROS 2 bag's directory in order.
//!
//! `ros2 bag record` makes a directory with `metadata.yaml` and files that follow each other. Without
//! `metadata.yaml` (the recorder was killed) files of one name with a number each are taken in the
//! order of the numbers.

use crate::error::RecordingError;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Longest `metadata.yaml` that is read.
const METADATA_BYTES_MAX: u64 = 16 << 20;
/// Most files of a bag: a year of one a quarter of an hour.
const FILES_MAX: usize = 40_000;
const METADATA: &str = "metadata.yaml";

/// The files of the bag in a directory, in order.
///
/// # Errors
/// [`RecordingError::Io`], or `Directory` if it is none of a bag.
pub(crate) fn files_of(directory: &Path) -> Result<Vec<PathBuf>, RecordingError> {
    let no_bag = |reason: String| RecordingError::Directory { path: directory.to_owned(), reason };
    let metadata = directory.join(METADATA);
    if metadata.is_file() {
        let io = |source| RecordingError::Io { path: metadata.clone(), action: "read", source };
        let mut text = String::new();
        let file = File::open(&metadata).map_err(io)?;
        file.take(METADATA_BYTES_MAX).read_to_string(&mut text).map_err(io)?;
        let names = listed(&text);
        return match names.len() {
            0 => Err(no_bag(format!("its {METADATA} lists no files"))),
            count if count > FILES_MAX => {
                Err(no_bag(format!("{count} files, at most {FILES_MAX}")))
            }
            // A name with a directory in it is of the machine that recorded: the files lie here.
            _ => Ok(names.into_iter().map(|name| directory.join(name)).collect()),
        };
    }
    numbered(directory).map_err(no_bag)
}

/// The names below `relative_file_paths:` of rosbag2's metadata, a list in block style.
fn listed(metadata: &str) -> Vec<String> {
    let mut lines = metadata.lines().map(str::trim);
    lines.by_ref().find(|line| *line == "relative_file_paths:");
    let entries = lines.map_while(|line| line.strip_prefix("- "));
    let names = entries.filter_map(|entry| {
        let entry = entry.trim().trim_matches(['"', '\'']);
        Path::new(entry).file_name().map(|name| name.to_string_lossy().into_owned())
    });
    names.collect()
}

/// Files `NAME_NUMBER.mcap` or `.db3` of one name, by number.
fn numbered(directory: &Path) -> Result<Vec<PathBuf>, String> {
    let mut files: Vec<(String, u64, PathBuf)> = Vec::new();
    for entry in std::fs::read_dir(directory).map_err(|error| error.to_string())? {
        let path = entry.map_err(|error| error.to_string())?.path();
        let is_bag = path.extension().is_some_and(|kind| kind == "mcap" || kind == "db3");
        let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
        let parts = stem.as_deref().and_then(|stem| stem.rsplit_once('_'));
        if let (true, Some((name, number))) = (is_bag, parts)
            && let Ok(number) = number.parse()
        {
            files.push((name.to_owned(), number, path));
        }
        if files.len() > FILES_MAX {
            return Err(format!("more than {FILES_MAX} files"));
        }
    }
    files.sort();
    match files.first() {
        None => Err(format!("without {METADATA} and without recordings that are numbered")),
        Some((name, _, _)) if files.iter().all(|(other, _, _)| other == name) => {
            Ok(files.into_iter().map(|(_, _, path)| path).collect())
        }
        Some(_) => Err(format!("without {METADATA}, with recordings of several names")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_files_of_a_bag_are_those_of_its_metadata_in_order() {
        let text = "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n  \
                    relative_file_paths:\n    - bag_1.mcap\n    - \"old/dir/bag_0.mcap\"\n  duration:\n    \
                    nanoseconds: 1\n  files:\n    - path: bag_7.mcap\n";
        assert_eq!(listed(text), ["bag_1.mcap", "bag_0.mcap"]);
        assert!(listed("version: 9\n").is_empty());
    }
}
