//! What becomes of the results of an earlier run in a directory that is written to: one rule for
//! `tog replay`, `tog experiment`, `tog map export` and `tog map merge`.
//!
//! A directory with a map (grid.json) is refused: the counts of months may be in it. So is one with
//! a subdirectory that has a map and is named as its area or preset, where the verb writes such. With `--force` what the earlier run wrote there is removed first,
//! so that no file of another preset or area stays beside the new ones; other files are left
//! alone. Pictures alone (`tog map render`, `tog map diff`) are replaced: they can be drawn again.

use super::grid_file::{GRID_FILE, GridFile};
use mapper::results::counts_file;
use std::io;
use std::path::{Path, PathBuf};

/// Why a directory is not written to.
#[derive(Debug, thiserror::Error)]
pub enum OverwriteError {
    /// A map is there.
    #[error(
        "a map is there already: {}; name another directory with --out, or say --force to replace \
         it", .0.display()
    )]
    Exists(PathBuf),
    /// An old file cannot be removed.
    #[error("cannot remove {}, of an earlier run: {source}", path.display())]
    Remove {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
}

/// Makes `directory` ready for a new map: see the rule above.
///
/// # Errors
/// See [`OverwriteError`].
pub fn for_map(directory: &Path, force: bool) -> Result<(), OverwriteError> {
    make_way(directory, vec![directory.to_owned()], force)
}

/// Makes `directory` ready for a run that writes a map there, or one per area or preset.
///
/// # Errors
/// See [`OverwriteError`].
pub fn for_run(directory: &Path, force: bool) -> Result<(), OverwriteError> {
    let inside = std::fs::read_dir(directory).into_iter().flatten().flatten();
    let mut maps: Vec<PathBuf> =
        inside.map(|entry| entry.path()).filter(|path| is_of_run(path)).collect();
    maps.sort_unstable();
    maps.insert(0, directory.to_owned());
    make_way(directory, maps, force)
}

/// Whether a subdirectory is what a run writes, and not a map that somebody put there.
fn is_of_run(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    GridFile::read(path).is_ok_and(|grid| [grid.area, grid.preset].contains(&name.into_owned()))
}

fn make_way(directory: &Path, mut maps: Vec<PathBuf>, force: bool) -> Result<(), OverwriteError> {
    maps.retain(|map| map.join(GRID_FILE).is_file());
    if let Some(map) = maps.first().filter(|_| !force) {
        return Err(OverwriteError::Exists(map.clone()));
    }
    for map in maps {
        for name in files_of(&map) {
            let path = map.join(name);
            match std::fs::remove_file(&path) {
                Err(source) if source.kind() != io::ErrorKind::NotFound => {
                    return Err(OverwriteError::Remove { path, source });
                }
                _ => {}
            }
        }
        if map != directory {
            let _ = std::fs::remove_dir(&map); // what is not empty stays
        }
    }
    Ok(())
}

/// What was written beside a grid.json, as it tells; that itself comes last.
fn files_of(map: &Path) -> Vec<String> {
    let mut names: Vec<String> = ["classes", "frames", "occupancy_last", "shares"]
        .map(|array| format!("{array}.npy"))
        .into_iter()
        .chain(["events.jsonl".to_owned(), "overview.png".to_owned(), counts_file(None)])
        .collect();
    // Of a grid.json that is damaged the fixed names are all that is known.
    if let Ok(grid) = GridFile::read(map) {
        names.extend(grid.contexts.iter().map(|context| counts_file(Some(context))));
        names.extend(grid.classes.iter().map(|class| format!("{}.png", class.name)));
    }
    names.push(GRID_FILE.to_owned());
    names
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::map::tests::grid;

    #[test]
    fn a_map_is_refused_and_with_force_its_files_go_and_those_of_others_stay() {
        let scratch = tempfile::tempdir().unwrap();
        let (out, area) = (scratch.path(), scratch.path().join("hall"));
        for_run(&out.join("not there"), false).unwrap();
        for_run(out, false).unwrap();
        let monday = out.join("monday");
        for directory in [&area, &monday, &out.to_owned()] {
            for_map(directory, false).unwrap();
            std::fs::create_dir_all(directory).unwrap();
            grid(6, 4).write(directory).unwrap();
            for name in ["wall.png", "collapsed_counts.npy", "overview.png"] {
                std::fs::write(directory.join(name), "x").unwrap();
            }
        }
        for name in ["site.toml", "mine.png"] {
            std::fs::write(out.join(name), "x").unwrap();
        }
        let error = for_run(out, false).unwrap_err().to_string();
        assert!(error.contains("--force") && area.join("wall.png").exists(), "{error}");
        for_run(out, true).unwrap();
        let mut left: Vec<_> =
            std::fs::read_dir(out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        left.sort();
        assert_eq!(left, ["mine.png", "monday", "site.toml"]);
        for_run(out, false).unwrap();
        assert!(for_map(&monday, false).is_err() && monday.join("wall.png").exists());
    }
}
