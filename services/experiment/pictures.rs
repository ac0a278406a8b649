//! The paper's figures of a run, from the map of the default preset.

use super::files::write_error;
use super::run::{ExperimentError, Outcome};
use experiment::claims::exterior_door;
use experiment::{Class, Experiment, Shares};
use figures::{CircleMark, LaserMark, Options, Panel, PanelSheet, ShareMap};
use std::path::Path;

/// The panels (a) to (d) of figures 3 and 4.
const PANELS: [(Class, &str); 4] = [
    (Class::Passing, "(a) 1 second: passing"),
    (Class::Lingering, "(b) 15 second: lingering"),
    (Class::Vacated, "(c) 60 second: vacated"),
    (Class::Background, "(d) all timescales: background"),
];
/// Largest panel of a page of four, pixels.
const PANEL_MAX_PX: [u32; 2] = [620, 440];
/// Exponent of the scale of colour: ways that are used 0.2 % of the time must show beside walls.
const GAMMA: f64 = 0.3;
/// The circle round the exterior door, metres: the leaf is 1 m.
const CIRCLE_M: f64 = 0.85;

/// Writes the figure of the experiment.
///
/// # Errors
/// If it cannot be drawn or written.
pub fn write(directory: &Path, outcome: &Outcome) -> Result<(), ExperimentError> {
    let (name, png) = match outcome.which.experiment {
        Experiment::Static => ("figure-1.png", figure_1(outcome)?),
        Experiment::Walkers => ("figure-3.png", four(outcome, "Figure 3: experiment 2", None)?),
        Experiment::Foyer => {
            let door = exterior_door(&outcome.scene).map(|[a, b]| CircleMark {
                x_m: (a[0] + b[0]) / 2.0,
                y_m: (a[1] + b[1]) / 2.0,
                radius_m: CIRCLE_M,
            });
            ("figure-4.png", four(outcome, "Figure 4: the foyer experiment", door)?)
        }
    };
    let path = directory.join(name);
    std::fs::write(&path, png).map_err(write_error(&path))
}

fn lasers(outcome: &Outcome) -> Vec<LaserMark> {
    let mark = |laser: &scene::LaserSpec| {
        let pose = laser.pose();
        LaserMark { id: laser.id.clone(), x_m: pose.x_m, y_m: pose.y_m, yaw_rad: pose.yaw_rad }
    };
    outcome.scene.lasers.iter().map(mark).collect()
}

/// Shares as pictures want them: NaN where the cell was never observed.
fn drawn(shares: &Shares, class: Class) -> Vec<f32> {
    let cells = shares.of(class).iter().zip(shares.observed());
    cells.map(|(&share, &observed)| if observed { share as f32 } else { f32::NAN }).collect()
}

fn subtitle(outcome: &Outcome) -> String {
    let which = outcome.which;
    format!(
        "{}; {:.0} s, {} laser{} at {:.1} Hz, seed {}",
        which.experiment.about(),
        outcome.frames as f64 * which.rate.period_ns() as f64 * 1e-9,
        outcome.scene.lasers.len(),
        if outcome.scene.lasers.len() == 1 { "" } else { "s" },
        which.rate.hz(),
        which.seed
    )
}

fn figure_1(outcome: &Outcome) -> Result<Vec<u8>, ExperimentError> {
    let shares = &outcome.maps[0].shares;
    let map = ShareMap {
        grid: *shares.grid(),
        share: drawn(shares, Class::Background),
        title: "Figure 1: share of background in experiment 1".to_owned(),
        subtitle: subtitle(outcome),
    };
    Ok(figures::class_share(&map, &lasers(outcome), &Options::default())?)
}

fn four(
    outcome: &Outcome,
    title: &str,
    circle: Option<CircleMark>,
) -> Result<Vec<u8>, ExperimentError> {
    let shares = &outcome.maps[0].shares;
    let panel = |(class, caption): (Class, &str)| Panel {
        share: drawn(shares, class),
        caption: caption.to_owned(),
        circles: circle.into_iter().collect(),
    };
    let page = PanelSheet {
        grid: *shares.grid(),
        panels: PANELS.into_iter().map(panel).collect(),
        title: format!("{title}, share of each class"),
        subtitle: subtitle(outcome),
        caption: if circle.is_some() {
            "The circle is where the exterior door is. ".to_owned()
        } else {
            String::new()
        },
    };
    let options = Options { plot_max_px: PANEL_MAX_PX, gamma: GAMMA, ..Options::default() };
    Ok(figures::panels(&page, &lasers(outcome), &options)?)
}
