//! `tog check`: the site file, and the scenes and recordings that it names.

use crate::operate::base_dir;
use laser::replay::ReplaySource;
use protocol::scan::{LaserScan, Reading, reading};
use protocol::site::{Area, Laser, Remark, RemarkOf, Severity, Site, Source};
use std::path::Path;

/// Scans of a recording that are looked at: a second or two of any laser.
const SCANS_LOOKED_AT: usize = 20;
/// If fewer of the echoes lie in the area, the pose or the area is likely wrong: a laser at the edge of
/// its area still has a tenth of its echoes in it.
const INSIDE_SHARE_MIN: f64 = 0.1;

/// What is wrong with the files that the lasers of a site are fed from.
pub fn sources(site: &Site, site_file: &Path) -> Vec<Remark> {
    let base_dir = base_dir(site_file);
    let lasers = site.lasers.iter().enumerate();
    lasers.filter_map(|(index, laser)| source(site, index, laser, &base_dir)).collect()
}

fn source(site: &Site, index: usize, laser: &Laser, base_dir: &Path) -> Option<Remark> {
    let remark = |key, severity, message: String, expected: &str, help: &str| Remark {
        of: RemarkOf::Source(index),
        key,
        severity,
        found: message.clone(),
        message,
        expected: expected.to_owned(),
        help: help.to_owned(),
    };
    match &laser.source {
        Source::Simulator { scene, .. } => {
            let error = laser::site::load_scene(scene, base_dir).err()?;
            let help = "relative paths begin at the directory of the site file";
            let expected = "a scene file, or the name of a built-in scene";
            Some(remark("scene", Severity::Error, error.to_string(), expected, help))
        }
        Source::Replay { recording, topic, .. } => {
            let mut replay = match ReplaySource::open(&base_dir.join(recording), topic.as_deref()) {
                Ok(replay) => replay,
                Err(error) => {
                    let help = "relative paths begin at the directory of the site file; without \
                                `topic` the recording has scans on one topic only";
                    let key =
                        if base_dir.join(recording).is_file() { "topic" } else { "recording" };
                    let expected = "a recording with scans of this laser";
                    return Some(remark(key, Severity::Error, error.to_string(), expected, help));
                }
            };
            let area = site.areas.iter().find(|area| area.id == laser.area)?;
            let share = match inside_share(&mut replay, laser, area) {
                Ok(share) => share?,
                Err(error) => {
                    let expected = "a recording whose first scans can be read";
                    return Some(remark("recording", Severity::Error, error, expected, ""));
                }
            };
            let message = format!(
                "{:.0} % of the echoes of laser `{}` lie in area `{}`",
                share * 100.0,
                laser.id,
                area.id
            );
            let expected = "most of them to lie in its area";
            let help = "look at x_m, y_m and yaw_deg of the laser, and at origin_m, cell_m, columns and \
                        rows of the area";
            let remark = remark("recording", Severity::Warning, message, expected, help);
            (share < INSIDE_SHARE_MIN).then_some(remark)
        }
    }
}

/// Share of the first echoes of a recording that lie in the area; `None` if there is no echo.
fn inside_share(
    replay: &mut ReplaySource,
    laser: &Laser,
    area: &Area,
) -> Result<Option<f64>, String> {
    let (pose, grid) = (laser.pose(), area.grid());
    let (mut inside, mut echoes) = (0u32, 0u32);
    let mut scan = LaserScan::default();
    for _ in 0..SCANS_LOOKED_AT {
        if !replay.next(&mut scan).map_err(|error| error.to_string())? {
            break;
        }
        for (beam, range_m) in scan.ranges_m.iter().enumerate() {
            let Reading::Echo(range_m) = reading(*range_m, &scan.geometry) else { continue };
            let (sin, cos) = (scan.geometry.bearing_rad(beam) + pose.yaw_rad).sin_cos();
            let cell = grid.cell_at(pose.x_m + range_m * cos, pose.y_m + range_m * sin);
            echoes += 1;
            inside += u32::from(cell.is_some());
        }
    }
    Ok((echoes > 0).then(|| f64::from(inside) / f64::from(echoes)))
}
