//! `tog experiment`: the paper's experiments on imagined buildings, and what the map shows of them.
//!
//! What is claimed, and when a claim holds, is defined in the crate `experiment`
//! (`tools/experiment`); here it is run, written, drawn and told.
//!
//! | file | what |
//! |---|---|
//! | `run.rs` | imagined lasers -> the cores of the services -> maps of all presets |
//! | `files.rs` | recording, truth, arrays: the table of files |
//! | `pictures.rs` | figures 1, 3 and 4 |
//! | `table.rs` | verdicts as text |
//! | `many.rs` | all experiments over many seeds, on all cores |

pub mod cli;
mod files;
mod many;
mod pictures;
mod run;
mod table;

use crate::cli::Format;
use crate::fail;
use cli::ExperimentVerb;
use experiment::claims::{Verdict, judge_foyer, judge_static, judge_walkers};
use experiment::{Experiment, Rate};
use files::write_error;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use process::exit;
use run::{ExperimentError, NoSink, Outcome, PRESETS, Which};
use serde_json::json;
use std::io::Write as _;
use std::path::Path;
use std::process::ExitCode;

/// Runs `tog experiment`.
pub fn main(arguments: &cli::Experiment) -> ExitCode {
    if let Some(ExperimentVerb::Verdict(arguments)) = &arguments.verb {
        return verdict(arguments);
    }
    let rate = match Rate::nearest(arguments.rate) {
        Ok(rate) => rate,
        Err(error) => return fail(exit::USAGE, error),
    };
    let number = arguments.number.and_then(Experiment::of_number);
    let (Some(experiment), Some(out)) = (number, &arguments.out) else {
        return fail(exit::USAGE, "which experiment, and where to? See tog experiment --help");
    };
    let which = Which { experiment, seed: arguments.seed, rate };
    let done =
        files::make_way(out, arguments.force).and_then(|()| one(which, out, arguments.format));
    match done {
        Ok(()) => ExitCode::from(exit::OK),
        Err(error) => fail(exit::FAILED, error),
    }
}

fn verdict(arguments: &cli::Verdict) -> ExitCode {
    let many = match many::run_all(arguments.seeds) {
        Ok(many) => many,
        Err(error) => return fail(exit::FAILED, error),
    };
    say(&match arguments.format {
        Format::Text => many.table(),
        Format::Json => format!("{:#}\n", many.json()),
    });
    let failing = many.failing();
    if failing.is_empty() {
        return ExitCode::from(exit::OK);
    }
    let why = "expected every claim to hold for nine seeds of ten with the default preset";
    fail(exit::FAILED, format_args!("{}; {why}", failing.join("; ")))
}

/// Runs one experiment and leaves everything in `out`.
fn one(which: Which, out: &Path, format: Format) -> Result<(), ExperimentError> {
    let seconds = which.experiment.seconds();
    let bar = progress_bar("experiment", seconds as u64, "s");
    let mut recorder = files::Recorder::create(out, which, &which.experiment.scene()?, &bar)?;
    let outcome = run::run(which, seconds, &mut recorder)?;
    recorder.finish()?;
    let empty_room = match which.experiment {
        Experiment::Walkers => {
            let experiment = Experiment::Static;
            Some(run::run(Which { experiment, ..which }, experiment.seconds(), &mut NoSink)?)
        }
        Experiment::Static | Experiment::Foyer => None,
    };
    bar.finish_and_clear();
    files::write_maps(out, &outcome)?;
    pictures::write(out, &outcome)?;

    let verdicts = judge(&outcome, empty_room.as_ref());
    let of_preset = |(preset, verdicts): (&protocol::site::Preset, &Vec<Verdict>)| json!({ "preset": preset.name(), "verdicts": verdicts });
    let document = json!({
        "experiment": which.experiment.number(),
        "seed": which.seed,
        "rate_hz": which.rate.hz(),
        "period_ns": which.rate.period_ns(),
        "presets": PRESETS.iter().zip(&verdicts).map(of_preset).collect::<Vec<_>>(),
    });
    let table = table::of_run(&outcome, &verdicts);
    let document = format!("{document:#}\n");
    for (name, text) in [("verdicts.json", &document), ("verdicts.txt", &table)] {
        let path = out.join(name);
        std::fs::write(&path, text).map_err(write_error(&path))?;
    }
    say(if format == Format::Json { &document } else { &table });
    eprintln!("tog: recording, truth, maps, figure and verdicts are in {}", out.display());
    Ok(())
}

/// The verdicts on each preset, [preset][verdict]; `empty_room` is the run that experiment 2 is
/// compared with.
fn judge(outcome: &Outcome, empty_room: Option<&Outcome>) -> Vec<Vec<Verdict>> {
    let Outcome { scene, ground, footprints, .. } = outcome;
    let judge_one = |(index, map): (usize, &run::Mapped)| match outcome.which.experiment {
        Experiment::Static => judge_static(&map.shares, ground),
        Experiment::Walkers => {
            let empty = empty_room.map_or(&map.shares, |empty| &empty.maps[index].shares);
            judge_walkers(&map.shares, empty, footprints)
        }
        Experiment::Foyer => judge_foyer(&map.shares, scene, ground, footprints),
    };
    outcome.maps.iter().enumerate().map(judge_one).collect()
}

/// Writes to standard output; that a reader goes away is no fault of ours.
fn say(text: &str) {
    let _ = std::io::stdout().write_all(text.as_bytes());
}

/// A bar on a terminal only.
fn progress_bar(what: &str, length: u64, unit: &str) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::stderr());
    let template = format!("{{prefix}} [{{wide_bar}}] {{pos}}/{{len}} {unit}, {{eta}} left");
    if let Ok(style) = ProgressStyle::with_template(&template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_prefix(what.to_owned());
    bar
}
