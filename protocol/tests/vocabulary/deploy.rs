//! Every site file that is shipped can be read, and says nothing that looks like a mistake.

use protocol::site::{Pace, Site, Source};
use std::path::{Path, PathBuf};

fn shipped() -> Vec<PathBuf> {
    let deploy = Path::new(env!("CARGO_MANIFEST_DIR")).join("../deploy");
    let entries = std::fs::read_dir(deploy).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<PathBuf> =
        entries.filter(|path| path.extension().is_some_and(|end| end == "toml")).collect();
    files.sort();
    files
}

fn read(path: &Path) -> Site {
    let name = path.file_name().unwrap().to_str().unwrap();
    let text = std::fs::read_to_string(path).unwrap();
    let (site, warnings) =
        Site::parse_with_warnings(&text, name).unwrap_or_else(|errors| panic!("\n{errors}"));
    assert!(warnings.is_empty(), "\n{warnings}");
    site
}

fn named(name: &str) -> Site {
    let files = shipped();
    read(files.iter().find(|path| path.ends_with(name)).unwrap())
}

#[test]
fn every_shipped_site_file_is_read_without_a_warning() {
    let files = shipped();
    assert!(files.len() >= 3, "{files:?}");
    for file in files {
        let site = read(&file);
        assert_eq!(Some(site.name.as_str()), file.file_stem().unwrap().to_str());
    }
}

#[test]
fn the_foyer_has_a_night_of_its_own_and_one_laser() {
    let site = named("foyer.toml");
    let area = &site.areas[site.area_index("foyer").unwrap()];
    assert_eq!((area.grid().columns, area.grid().rows), (151, 106));
    assert_eq!(area.context_names(), ["always", "night"]);
    let night = &area.contexts[0];
    assert_eq!((night.from_minute(), night.to_minute()), (22 * 60, 6 * 60));
    let lasers: Vec<_> =
        site.lasers_of("foyer").map(|(index, laser)| (index, &*laser.id)).collect();
    assert_eq!(lasers, [(0, "front")]);
    assert_eq!(site.laser_index("front"), Some(0));
    assert_eq!(site.laser_index("back"), None);
}

/// A site of a shipped scene lies where the scene says: the scene file is the owner of its geometry.
#[test]
fn a_simulated_site_has_the_geometry_of_its_scene() {
    let mut compared = 0;
    for file in shipped() {
        let site = read(&file);
        for laser in &site.lasers {
            let Source::Simulator { scene, .. } = &laser.source else { continue };
            let path = file.with_file_name("scenes").join(format!("{scene}.toml"));
            let scene: toml::Table = std::fs::read_to_string(path).unwrap().parse().unwrap();
            let area = &site.areas[site.area_index(&laser.area).unwrap()];
            let grid: protocol::geometry::GridGeometry = {
                let mut table = scene["area"].as_table().unwrap().clone();
                table.remove("id");
                table.try_into().unwrap()
            };
            assert_eq!(area.grid(), grid, "{}", file.display());
            let same_id = |other: &&toml::Value| other["id"].as_str() == Some(&laser.id);
            // A laser that the scene does not know hangs where the site file says.
            let mut lasers = scene["laser"].as_array().unwrap().iter();
            let Some(placed) = lasers.find(same_id) else { continue };
            let number = |key: &str| placed[key].as_float().unwrap();
            let pose = [laser.x_m, laser.y_m, laser.yaw_deg];
            assert_eq!(pose, ["x_m", "y_m", "yaw_deg"].map(number), "{}", laser.id);
            compared += 1;
        }
    }
    assert_eq!(compared, 10);
}

#[test]
fn the_replay_example_loses_no_scan() {
    let site = named("replay-example.toml");
    let Source::Replay { pace, topic, .. } = &site.lasers[0].source else { panic!() };
    assert_eq!((pace, topic.as_deref()), (&Pace::Lossless, Some("/scan")));
}
