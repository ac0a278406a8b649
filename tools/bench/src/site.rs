//! The site of the measurement: the foyer, and objects that come and go where nobody walks.

use scene::Scene;
use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Corners of the foyer that nobody uses, metres; far enough apart to be happenings of their own.
const PLACES_M: [[f64; 2]; 4] = [[9.4, 1.2], [8.2, 3.2], [10.2, 2.6], [7.4, 1.2]];
/// An object comes every so many seconds, and stays half as long.
const PERIOD_S: f64 = 12.0;
/// The services need a moment until everybody listens, seconds.
const START_S: f64 = 5.0;

/// Writes the site file and a scene without incidents; returns the site file.
pub fn lay_out(directory: &Path, rate_hz: f64, seconds: u64) -> Result<PathBuf, Box<dyn Error>> {
    let period_ms = 1000.0 / rate_hz;
    let pid = std::process::id();
    let text = format!(
        "# {seconds} s of bench\nname = \"bench-{pid}\"\n\
         [[area]]\nid = \"foyer\"\norigin_m = [-1.55, -0.55]\ncell_m = 0.1\ncolumns = 151\nrows = 106\n\
         frame_period_ms = {period_ms}\n\
         [area.detector]\nalarms_per_week_max = 100\nlearning_s = 1200\ncalibration_s = 600\n\
         [[laser]]\nid = \"front\"\narea = \"foyer\"\nx_m = 6.0\ny_m = 0.3\nyaw_deg = 90\n\
         source = {{ kind = \"simulator\", scene = \"foyer.toml\", rate_hz = {rate_hz} }}\n"
    );
    let path = directory.join("bench.toml");
    fs::write(&path, text)?;
    fs::write(directory.join("foyer.toml"), builtin()?)?;
    Ok(path)
}

/// Adds the objects to the scene, from now on.
pub fn stage(directory: &Path, seconds: u64) -> Result<(), Box<dyn Error>> {
    let now_ns = SystemTime::now().duration_since(UNIX_EPOCH)?.as_nanos();
    let live_s = Scene::builtin("foyer")?.time_s(u64::try_from(now_ns)?) + START_S;
    let mut text = builtin()?.to_owned();
    let objects = (seconds as f64 / PERIOD_S) as usize;
    for (number, place) in PLACES_M.iter().cycle().take(objects).enumerate() {
        let at_s = live_s + number as f64 * PERIOD_S;
        let [x_m, y_m] = place;
        write!(
            text,
            "\n[[incident]]\nkind = \"object\"\nid = \"object-{number}\"\nat_s = {at_s:.3}\n\
             stays_s = {:.3}\ncentre_m = [{x_m:?}, {y_m:?}]\nsize_m = [0.5, 0.5]\nyaw_deg = 20.0\n",
            PERIOD_S / 2.0
        )?;
    }
    fs::write(directory.join("foyer.toml"), text)?;
    Ok(())
}

fn builtin() -> Result<&'static str, Box<dyn Error>> {
    let found = scene::BUILTIN.iter().find(|(name, _)| *name == "foyer");
    Ok(found.ok_or("the built-in scene foyer is not there")?.1)
}
