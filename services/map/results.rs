//! What `tog run --out` adds, when its processes have ended, to the arrays that the mappers wrote.

use super::MapError;
use super::grid_file::{GridFile, LaserEntry};
use super::pictures::Pictures;
use figures::Options;
use laser::replay::ReplaySource;
use mapper::npy;
use mapper::results::counts_file;
use protocol::scan::{LaserScan, ScanGeometry};
use protocol::site::{Laser, Site, Source};
use std::path::Path;

/// Writes grid.json and the pictures of every area whose counts are in `out`: a run that was
/// interrupted has none.
///
/// # Errors
/// If a recording or the counts cannot be read, or the files not be written.
pub fn describe_results(site: &Site, base_dir: &Path, out: &Path) -> Result<(), MapError> {
    for area in &site.areas {
        let several = site.areas.len() > 1;
        let directory = if several { out.join(&area.id) } else { out.to_owned() };
        let counts = directory.join(counts_file(None));
        if !counts.is_file() {
            continue;
        }
        let mut lasers = Vec::new();
        let mut recording = "";
        for (_, laser) in site.lasers_of(&area.id) {
            if let Source::Replay { recording: path, .. } = &laser.source {
                recording = path;
            }
            lasers.push(LaserEntry::of(laser, first_scan(laser, base_dir)?));
        }
        let grid = GridFile::of(area, lasers);
        let counts = npy::read_u64(&counts, &grid.shape())?;
        grid.write(&directory)
            .map_err(|source| MapError::Write { path: directory.clone(), source })?;
        let name = Path::new(recording).file_name().unwrap_or_default().to_string_lossy();
        let pictures = Pictures::new(&grid, &counts, &name, &[], Options::default())?;
        pictures.write_all(&directory)?;
    }
    Ok(())
}

/// Geometry and beams of the first scan of a replayed laser: fusion holds the others to it.
fn first_scan(laser: &Laser, base_dir: &Path) -> Result<Option<(ScanGeometry, usize)>, MapError> {
    let Source::Replay { recording, topic, .. } = &laser.source else { return Ok(None) };
    let mut replay = ReplaySource::open(&base_dir.join(recording), topic.as_deref())?;
    let mut scan = LaserScan::default();
    let found = replay.next(&mut scan)?;
    Ok(found.then_some((scan.geometry, scan.ranges_m.len())))
}
