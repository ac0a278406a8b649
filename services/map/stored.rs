//! Where maps come from: the directory that `tog replay` or `tog map` wrote, or the checkpoint of a
//! site's area.

use super::MapError;
use super::grid_file::{GRID_FILE, GridFile, LaserEntry};
use crate::operate::base_dir;
use crate::site_file;
use mapper::checkpoint;
use mapper::npy;
use mapper::results::counts_file;
use occupancy::GridConfig;
use protocol::site::{Area, Site};
use std::path::{Path, PathBuf};

/// A collapsed map and where it lies.
#[derive(Debug)]
pub struct StoredMap {
    /// What it was called by.
    pub name: String,
    /// Its grid.
    pub grid: GridFile,
    /// Where it lies, without links: the same for the same map.
    pub place: PathBuf,
    store: Store,
}

#[derive(Debug)]
enum Store {
    /// Arrays in a directory, read when asked for.
    Directory(PathBuf),
    /// Counts per context, in the order of the grid's contexts.
    Memory(Vec<Vec<u64>>),
}

impl StoredMap {
    /// Opens a directory, or the checkpoint of the site in a file.
    ///
    /// # Errors
    /// If it is neither, or damaged, or `area` does not say which one is meant.
    pub fn open(path: &Path, area: Option<&str>) -> Result<Self, MapError> {
        if !path.exists() {
            let help = "it is neither a directory with a map nor a site file".to_owned();
            return Err(MapError::NoMap { path: path.to_owned(), help });
        }
        if path.is_dir() { Self::of_directory(path, area) } else { Self::of_site(path, area) }
    }

    fn of_directory(path: &Path, area: Option<&str>) -> Result<Self, MapError> {
        let has_grid = |directory: &Path| directory.join(GRID_FILE).is_file();
        let directory = match area {
            Some(area) if !has_grid(path) => path.join(area),
            _ => path.to_owned(),
        };
        if !has_grid(&directory) {
            return Err(MapError::NoMap { path: directory, help: help_for(path) });
        }
        let file = directory.join(GRID_FILE);
        let grid = GridFile::read(&directory)
            .map_err(|reason| MapError::Grid { path: file.clone(), reason })?;
        if let Some(area) = area
            && grid.area != area
        {
            let reason = format!("it is of area `{}`, expected `{area}`", grid.area);
            return Err(MapError::Grid { path: file, reason });
        }
        let name = directory.display().to_string();
        let place = directory.canonicalize().unwrap_or_else(|_| directory.clone());
        Ok(Self { name, grid, place, store: Store::Directory(directory) })
    }

    /// Opens the checkpoint of an area of a site.
    ///
    /// # Errors
    /// If the site file is wrong, or there is no checkpoint that fits it.
    pub fn of_site(path: &Path, area: Option<&str>) -> Result<Self, MapError> {
        let site = site_file::load(path)?;
        let area = area_of(&site, path, area)?;
        let state_dir = site.state_dir_of(&base_dir(path), site.host_of_area(area));
        let file = mapper::shell::checkpoint_path(&state_dir, &area.id);
        let config = GridConfig::of_area(area);
        let expected = checkpoint::describe(&area.grid(), area.lattice().period_ns(), &config);
        let bytes_max = checkpoint::body_bytes_max(&config);
        let Some(found) = checkpoint::read(&file, &expected, bytes_max)? else {
            let help = "`tog run` or `tog learn` of the site writes it".to_owned();
            return Err(MapError::NoMap { path: file, help });
        };
        let lasers = site.lasers_of(&area.id).map(|(_, laser)| LaserEntry::of(laser, None));
        let grid = GridFile::of(area, lasers.collect());
        let values = grid.shape().iter().product::<usize>();
        let mut contexts = vec![vec![0u64; values]; grid.contexts.len()];
        for (name, counts) in &found.contexts {
            if counts.len() != values {
                let reason =
                    format!("context `{name}` has {} counts, expected {values}", counts.len());
                return Err(MapError::Grid { path: file, reason });
            }
            // What the site file does not name any more counts in `always`, as in the mapper.
            let index = grid.contexts.iter().position(|known| known == name).unwrap_or(0);
            add(&mut contexts[index], counts, &file.display().to_string())?;
        }
        let name = format!("{} area {}", path.display(), area.id);
        let place = file.canonicalize().unwrap_or(file);
        Ok(Self { name, grid, place, store: Store::Memory(contexts) })
    }

    /// The counts \[class, row, column\] of a context, or of all together.
    ///
    /// # Errors
    /// If there is no such context, or the array does not fit the grid.
    pub fn counts(&self, context: Option<&str>) -> Result<Vec<u64>, MapError> {
        let position = |name: &str| self.grid.contexts.iter().position(|known| known == name);
        let index = match context {
            None => None,
            Some(name) => Some(position(name).ok_or_else(|| MapError::Name {
                what: "context",
                found: name.to_owned(),
                map: self.name.clone(),
                known: self.grid.contexts.join("`, `"),
            })?),
        };
        match &self.store {
            Store::Directory(directory) => {
                let context = context.filter(|_| self.grid.contexts.len() > 1);
                let path = directory.join(counts_file(context));
                Ok(npy::read_u64(&path, &self.grid.shape())?)
            }
            Store::Memory(contexts) => match index {
                Some(index) => Ok(contexts[index].clone()),
                None => {
                    let mut total = vec![0; self.grid.shape().iter().product()];
                    contexts.iter().try_for_each(|counts| add(&mut total, counts, &self.name))?;
                    Ok(total)
                }
            },
        }
    }
}

/// Adds counts.
///
/// # Errors
/// If a count does not fit 64 bits.
pub fn add(total: &mut [u64], counts: &[u64], name: &str) -> Result<(), MapError> {
    for (total, count) in total.iter_mut().zip(counts) {
        *total = total.checked_add(*count).ok_or_else(|| MapError::Overflow(name.to_owned()))?;
    }
    Ok(())
}

/// The area that is meant.
fn area_of<'s>(site: &'s Site, path: &Path, wanted: Option<&str>) -> Result<&'s Area, MapError> {
    let known = || site.areas.iter().map(|area| area.id.as_str()).collect::<Vec<_>>().join("`, `");
    match wanted {
        Some(id) => site.areas.iter().find(|area| area.id == id).ok_or_else(|| MapError::Name {
            what: "area",
            found: id.to_owned(),
            map: path.display().to_string(),
            known: known(),
        }),
        None if site.areas.len() == 1 => Ok(&site.areas[0]),
        None => Err(MapError::Usage(format!(
            "{} has several areas: say which one with --area: `{}`",
            path.display(),
            known()
        ))),
    }
}

/// What to do about a directory without a map: its subdirectories may be of areas.
fn help_for(path: &Path) -> String {
    let entries = std::fs::read_dir(path).into_iter().flatten().flatten();
    let mut areas: Vec<String> = entries
        .filter(|entry| entry.path().join(GRID_FILE).is_file())
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .take(20)
        .collect();
    areas.sort_unstable();
    if areas.is_empty() {
        return "`tog replay`, `tog map merge` and `tog map export --format npy` write one"
            .to_owned();
    }
    format!("say which area is meant with --area: `{}`", areas.join("`, `"))
}
