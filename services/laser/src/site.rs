//! From the site file to sources.

use crate::gate::STEP_MAX_NS;
use crate::replay::ReplaySource;
use crate::simulator::SimulatorSource;
use crate::source::{Source, SourceError};
use process::Clock;
use protocol::scan::LaserScan;
use protocol::site::{self, Laser, Pace, Site};
use protocol::time::SECOND_NS;
use scene::{LaserSpec, SCENE_BYTES_MAX, Scene};
use std::io::Read;
use std::path::Path;

/// Index of a laser in the site file, and the laser.
///
/// # Errors
/// [`SourceError::NoSuchLaser`] with the lasers that there are.
pub fn find_laser<'a>(site: &'a Site, id: &str) -> Result<(usize, &'a Laser), SourceError> {
    let found = site.lasers.iter().enumerate().find(|(_, laser)| laser.id == id);
    found.ok_or_else(|| {
        let ids: Vec<&str> = site.lasers.iter().map(|laser| laser.id.as_str()).collect();
        SourceError::NoSuchLaser { laser: id.to_owned(), known: ids.join(", ") }
    })
}

/// Opens the source of a laser. Relative paths begin at `base_dir`, the directory of the site file.
///
/// `begin_ns` is the site's time now: scans that are stamped before it are not made, or passed over.
/// A replay without a clock is read from its begin: 0.
///
/// # Errors
/// See [`SourceError`].
pub fn open_source(laser: &Laser, base_dir: &Path, begin_ns: u64) -> Result<Source, SourceError> {
    match &laser.source {
        site::Source::Replay { recording, topic, .. } => {
            let replay = ReplaySource::open(&base_dir.join(recording), topic.as_deref())?;
            Ok(Source::Replay(Box::new(replay.beginning_at(begin_ns))))
        }
        site::Source::Simulator { scene, seed, rate_hz } => {
            let scene = load_scene(scene, base_dir)?;
            let spec = simulated_laser(&scene, laser);
            let source = SimulatorSource::new(scene, spec, *seed, *rate_hz, begin_ns)?;
            Ok(Source::Simulator(Box::new(source)))
        }
    }
}

/// A scene by the name of a built-in one, or by a path of a file relative to `base_dir`.
///
/// # Errors
/// It cannot be read, is no scene, or breaks a bound.
pub fn load_scene(name_or_path: &str, base_dir: &Path) -> Result<Scene, SourceError> {
    if scene::BUILTIN.iter().any(|(name, _)| *name == name_or_path) {
        return Ok(Scene::builtin(name_or_path)?);
    }
    let path = base_dir.join(name_or_path);
    let mut text = String::new();
    let read = process::file::open_regular(&path)
        .and_then(|(file, _)| file.take(SCENE_BYTES_MAX as u64 + 1).read_to_string(&mut text));
    match read {
        Ok(_) => Ok(Scene::parse(&text, &path.display().to_string())?),
        // A word without a dot was meant to be a name: the message lists the names.
        Err(_) if !name_or_path.contains(['.', '/']) => Ok(Scene::builtin(name_or_path)?),
        Err(source) => Err(SourceError::SceneFile { path, source }),
    }
}

/// The laser as the scene has it, by id: it is where it really is. A scene that does not know the laser
/// gets an LMS 200 where the site file says.
#[must_use]
pub fn simulated_laser(scene: &Scene, laser: &Laser) -> LaserSpec {
    let there = scene.laser(&laser.id).cloned();
    there.unwrap_or_else(|| LaserSpec::lms200(&laser.id, laser.x_m, laser.y_m, laser.yaw_deg))
}

/// When the recordings of a site begin: the lowest first stamp of its replayed lasers, UNIX nanoseconds;
/// `None` if no laser is replayed. It is the start of the site's clock, so that all lasers keep step.
///
/// # Errors
/// A recording that cannot be opened, has no scans, or not those of its laser;
/// [`SourceError::Apart`].
pub fn replay_begin_ns(site: &Site, base_dir: &Path) -> Result<Option<u64>, SourceError> {
    let mut begins_ns = Vec::new();
    for laser in &site.lasers {
        if let site::Source::Replay { recording, topic, .. } = &laser.source {
            let mut replay = ReplaySource::open(&base_dir.join(recording), topic.as_deref())?;
            let mut scan = LaserScan::default();
            if replay.next(&mut scan)? {
                begins_ns.push((laser, scan.stamp_ns));
            }
        }
    }
    check_begins(&begins_ns)?;
    Ok(begins_ns.iter().map(|(_, begin_ns)| *begin_ns).min())
}

/// Refuses recordings that could not have been made together: lasers of one area whose first stamps,
/// UNIX nanoseconds, are further apart than a stamp may step within a recording.
///
/// # Errors
/// [`SourceError::Apart`].
pub fn check_begins(begins_ns: &[(&Laser, u64)]) -> Result<(), SourceError> {
    for (laser, later_ns) in begins_ns {
        let of_area = begins_ns.iter().filter(|(other, _)| other.area == laser.area);
        let Some((earliest, earlier_ns)) = of_area.min_by_key(|(_, begin_ns)| *begin_ns) else {
            continue;
        };
        let apart_ns = later_ns - earlier_ns;
        if apart_ns > STEP_MAX_NS {
            return Err(SourceError::Apart {
                area: laser.area.clone(),
                earlier: earliest.id.clone(),
                later: laser.id.clone(),
                found_h: apart_ns / (3600 * SECOND_NS),
            });
        }
    }
    Ok(())
}

/// The clock of a site: the host's for live and simulated lasers; one that begins with the recordings at
/// `start_mono_ns` of CLOCK_MONOTONIC and runs at their pace; none for a lossless replay.
///
/// `start_mono_ns` should leave the services a moment to start: scans before it are not lost, later
/// ones that nobody reads yet are.
///
/// # Errors
/// As [`replay_begin_ns`].
pub fn site_clock(site: &Site, base_dir: &Path, start_mono_ns: u64) -> Result<Clock, SourceError> {
    let pace = site.lasers.iter().find_map(|laser| match laser.source {
        site::Source::Replay { pace, .. } => Some(pace),
        site::Source::Simulator { .. } => None,
    });
    let rate = match pace {
        None => return Ok(Clock::Wall),
        Some(Pace::Lossless) => {
            replay_begin_ns(site, base_dir)?; // a bad recording is told before anything starts
            return Ok(Clock::EventTime);
        }
        Some(Pace::RealTime) => 1.0,
        Some(Pace::Times(times)) => times,
    };
    let start_site_ns = replay_begin_ns(site, base_dir)?.unwrap_or(0);
    Ok(Clock::Scaled { start_site_ns, start_mono_ns, rate })
}
