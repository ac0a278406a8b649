//! `tog demo`: the whole system on a simulated foyer, with no hardware and no files.
//!
//! First the cores see two hours of the foyer's past in one thread, as fast as they go: the map is
//! learnt, the threshold calibrated, and both are left where the services keep them. Then the same
//! foyer runs live, every service a process of its own, and somebody does what nobody does there.

use crate::cli::Demo;
use crate::{fail, learn, site_file};
use process::{exit, wall_ns};
use protocol::site::Site;
use scene::Scene;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const SITE: &str = include_str!("../deploy/demo.toml");
/// The scene of the demo is the built-in one, with two incidents.
const SCENE: &str = "foyer";
/// How long after the start of the live part somebody leaves the paths, seconds.
const INTRUDER_AFTER_S: f64 = 12.0;
/// How long after the start of the live part a suitcase is left, seconds.
const SUITCASE_AFTER_S: f64 = 75.0;

/// Why the demo cannot go on.
#[derive(Debug, thiserror::Error)]
enum DemoError {
    #[error("cannot write {}: {source}", path.display())]
    Write { path: PathBuf, source: io::Error },
    #[error(transparent)]
    Site(#[from] site_file::SiteFileError),
    #[error(transparent)]
    Scene(#[from] scene::SceneError),
    #[error(transparent)]
    Learn(#[from] learn::LearnError),
}

/// A directory that is gone when the demo is.
struct Scratch(PathBuf);

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0); // a leftover in the temporary directory harms nobody
    }
}

/// Runs the demo.
pub fn run(arguments: &Demo) -> ExitCode {
    match prepare(arguments) {
        Ok((site, scratch)) => {
            explain(&site, &scratch.0);
            let options = supervisor::Options {
                base_dir: scratch.0.clone(),
                seconds: arguments.seconds.map(|seconds| seconds as f64),
                ..supervisor::Options::default()
            };
            supervisor::run(&site, &options)
        }
        Err(error) => fail(exit::FAILED, error),
    }
}

/// Lays out the site, and lets the cores see its past.
fn prepare(arguments: &Demo) -> Result<(Site, Scratch), DemoError> {
    let pid = std::process::id();
    let scratch = Scratch(std::env::temp_dir().join(format!("tog-demo-{pid}")));
    let write = |path: PathBuf, text: &str| {
        fs::write(&path, text).map_err(|source| DemoError::Write { path, source })
    };
    fs::create_dir_all(&scratch.0)
        .map_err(|source| DemoError::Write { path: scratch.0.clone(), source })?;
    // Every demo is a site of its own, so that two can run on one host.
    let text = SITE
        .replace("name = \"demo\"", &format!("name = \"demo-{pid}\""))
        .replace("scene = \"foyer\"", "scene = \"foyer.toml\"")
        .replace("seed = 1", &format!("seed = {}", arguments.seed));
    let path = scratch.0.join("demo.toml");
    write(path.clone(), &text)?;
    let site = site_file::parse(&text, &path)?;

    let scene_path = scratch.0.join("foyer.toml");
    write(scene_path.clone(), builtin_text())?;
    learn::from_the_past(&site, &scratch.0)?;
    write(scene_path, &scene_with_incidents(wall_ns())?)?;
    Ok((site, scratch))
}

/// The built-in foyer: its incidents are prepared, but do not happen.
fn builtin_text() -> &'static str {
    scene::BUILTIN.iter().find(|(name, _)| *name == SCENE).map_or("", |(_, text)| text)
}

/// The built-in foyer, with its incidents set to happen after `live_ns`.
fn scene_with_incidents(live_ns: u64) -> Result<String, DemoError> {
    let scene = Scene::builtin(SCENE)?;
    let live_s = scene.time_s(live_ns);
    let at = |text: String, id: &str, at_s: f64| {
        text.replace(&format!("id = \"{id}\"\n"), &format!("id = \"{id}\"\nat_s = {at_s:.3}\n"))
    };
    let text = at(builtin_text().to_owned(), "off-the-path", live_s + INTRUDER_AFTER_S);
    // Out of the intruder's way, so that it is a happening of its own.
    let text = text.replace("centre_m = [7.6, 2.2]", "centre_m = [3.4, 1.5]");
    Ok(at(text, "suitcase", live_s + SUITCASE_AFTER_S))
}

fn explain(site: &Site, directory: &Path) {
    let file = directory.join("demo.toml");
    let file = file.display();
    eprintln!(
        "tog demo: a foyer with an exterior door, an elevator, a laboratory door, and people.\n\
         \n\
         It has learnt two hours of its life; now it runs live, every service a process of its own.\n\
         Watch for:\n\
         \x20 after about {INTRUDER_AFTER_S:.0} s  somebody leaves the paths and waits in the south-east corner\n\
         \x20 after about {SUITCASE_AFTER_S:.0} s  a suitcase is left in the west of the hall\n\
         Each raises an alert, in words, from the service `alerts`, within a minute.\n\
         \n\
         In another terminal:\n\
         \x20 tog status {file}\n\
         \x20 tog alerts watch {file}\n\
         \x20 kill -9 the process of any service: it is back within two seconds\n\
         Ctrl-C ends {} and leaves nothing behind.\n",
        site.name
    );
}
