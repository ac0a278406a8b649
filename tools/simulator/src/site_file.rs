//! A site file that fits a scene or a workload: where the lasers really are, and the area.

use crate::export::topic;
use crate::workload::Workload;
use protocol::geometry::{GridGeometry, Pose};
use scene::Scene;
use std::fmt::Write;

/// Where the scans of the site come from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scans<'a> {
    /// The lasers imagine the scene: name or path of the scene file, and the seed.
    Simulated(&'a str, u64),
    /// The lasers replay this recording.
    Recorded(&'a str),
}

/// The site file of a scene at `rate_hz` scans a second.
#[must_use]
pub fn of_scene(scene: &Scene, rate_hz: f64, scans: Scans<'_>) -> String {
    let lasers = scene.lasers.iter().map(|laser| (laser.id.as_str(), laser.pose()));
    let area = (scene.area.id.as_str(), scene.area.grid());
    text(&scene.name, area, 1000.0 / rate_hz, None, lasers, rate_hz, scans)
}

/// The site file of a recorded workload, with the sensor model of the measured ones (dr = 5 cm).
#[must_use]
pub fn of_workload(workload: &Workload, recording: &str) -> String {
    let ids = workload.specs().iter().map(|spec| spec.id.as_str());
    let lasers = ids.zip(workload.lasers.iter().map(|laser| laser.pose));
    let period_ms = workload.frame_period_ns as f64 / 1e6;
    let area = (workload.name, workload.grid);
    let scans = Scans::Recorded(recording);
    text(workload.name, area, period_ms, Some(0.05), lasers, 1000.0 / period_ms, scans)
}

fn text<'a>(
    name: &str,
    (area, grid): (&str, GridGeometry),
    period_ms: f64,
    tolerance_m: Option<f64>,
    lasers: impl Iterator<Item = (&'a str, Pose)>,
    rate_hz: f64,
    scans: Scans<'_>,
) -> String {
    let GridGeometry { origin_m: [x, y], cell_m, columns, rows } = grid;
    let mut text = format!(
        "name = {}\n\n[[area]]\nid = {}\norigin_m = [{x:?}, {y:?}]\ncell_m = {cell_m:?}\n\
         columns = {columns}\nrows = {rows}\nframe_period_ms = {period_ms:?}\n",
        quoted(name),
        quoted(area),
    );
    if let Some(tolerance_m) = tolerance_m {
        let _ = writeln!(text, "range_tolerance_m = {tolerance_m:?}");
    }
    for (id, pose) in lasers {
        let source = match scans {
            Scans::Simulated(scene, seed) => format!(
                "kind = \"simulator\", scene = {}, seed = {seed}, rate_hz = {rate_hz:?}",
                quoted(scene)
            ),
            Scans::Recorded(path) => {
                format!(
                    "kind = \"replay\", recording = {}, topic = {}",
                    quoted(path),
                    quoted(&topic(id))
                )
            }
        };
        let _ = write!(
            text,
            "\n[[laser]]\nid = {}\narea = {}\nx_m = {:?}\ny_m = {:?}\nyaw_deg = {:?}\n\
             source = {{ {source} }}\n",
            quoted(id),
            quoted(area),
            pose.x_m,
            pose.y_m,
            pose.yaw_rad.to_degrees(),
        );
    }
    text
}

/// A TOML string: what JSON says is a basic string of TOML too.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::workload::{w1r, w2r, w3r};
    use protocol::site::Site;

    #[test]
    fn a_site_file_of_a_scene_or_a_workload_is_accepted() {
        for (name, _) in scene::BUILTIN {
            let scene = Scene::builtin(name).unwrap();
            let text = of_scene(&scene, 10.0, Scans::Simulated(name, 3));
            let site = Site::parse(&text, "scene.toml").unwrap_or_else(|e| panic!("{e}\n{text}"));
            assert_eq!(site.lasers.len(), scene.lasers.len());
            for (written, meant) in site.lasers.iter().zip(&scene.lasers) {
                assert_eq!(written.id, meant.id);
                assert!((written.pose().yaw_rad - meant.pose().yaw_rad).abs() < 1e-12);
            }
        }
        for workload in [w1r(1, 1).unwrap(), w2r(1, 1).unwrap(), w3r(1, 1).unwrap()] {
            let text = of_workload(&workload, "odd \"name\" \\ here.mcap");
            let site = Site::parse(&text, "w.toml").unwrap_or_else(|e| panic!("{e}\n{text}"));
            assert_eq!(site.areas[0].grid(), workload.grid);
            assert_eq!(site.areas[0].lattice().period_ns(), workload.frame_period_ns);
            assert_eq!(site.areas[0].range_tolerance_m(), 0.05);
        }
    }
}
