//! `tog`: one binary, every verb and every service. Reads like a table of contents.

mod bag;
mod certs;
mod check;
mod cli;
mod demo;
mod doctor;
mod experiment;
mod learn;
mod map;
mod operate;
mod pipeline;
mod placement;
mod replay;
mod site_file;
mod status;

use clap::Parser;
use cli::{Alerts, AlertsVerb, Cli, Verb, Worker};
use process::{Role, exit};
use std::io::Write as _;
use std::process::ExitCode;

fn main() -> ExitCode {
    match Cli::parse().verb {
        Verb::Demo(arguments) => demo::run(&arguments),
        Verb::Replay(arguments) => replay::main(&arguments),
        Verb::Experiment(arguments) => experiment::main(&arguments),
        Verb::Learn(arguments) => learn::run(&arguments),
        Verb::Run(arguments) => operate::run(&arguments),
        Verb::Status(arguments) => status::status(&arguments),
        Verb::Top(arguments) => status::top(&arguments),
        Verb::Graph(arguments) => status::graph(&arguments),
        Verb::Alerts(arguments) => alerts_verb(arguments),
        Verb::Map(arguments) => map::main(&arguments),
        Verb::Bag(arguments) => bag::run(&arguments),
        Verb::Certs(arguments) => certs::main(&arguments),
        Verb::Doctor(arguments) => doctor::main(&arguments),
        Verb::Check(arguments) => operate::check(&arguments),
        Verb::Schema => operate::schema(),
        Verb::Bridge(worker) => {
            bridge::prepare();
            serve("bridge", &worker, bridge::run)
        }
        Verb::Recorder(worker) => serve("recorder", &worker, recorder::run),
        Verb::Laser(worker) => serve("laser", &worker, laser::shell::run),
        Verb::Fusion(worker) => serve("fusion", &worker, fusion::shell::run),
        Verb::Mapper(worker) => serve("mapper", &worker, mapper::shell::run),
        Verb::Anomaly(worker) => serve("anomaly", &worker, anomaly::run),
    }
}

/// `tog alerts`: its verbs, and the service of that name.
fn alerts_verb(arguments: Alerts) -> ExitCode {
    match (arguments.verb, arguments.instance) {
        (Some(AlertsVerb::List(arguments)), _) => operate::alerts_list(&arguments),
        (Some(AlertsVerb::Watch(arguments)), _) => operate::alerts_watch(&arguments),
        (None, Some(instance)) => {
            serve("alerts", &Worker { instance, laser: None, area: None }, alerts::run)
        }
        (None, None) => fail(exit::USAGE, "tog alerts needs a verb: see tog alerts --help"),
    }
}

/// Runs a service of a site that `tog run` started.
fn serve(
    service: &str,
    worker: &Worker,
    body: impl FnOnce(&mut process::Worker) -> Result<(), process::Failure>,
) -> ExitCode {
    match Role::from_arguments(service, worker.laser.as_deref(), worker.area.as_deref()) {
        Ok(role) => process::run(role, &worker.instance, body),
        Err(reason) => fail(exit::USAGE, reason),
    }
}

/// Says why nothing more can be done.
fn fail(code: u8, reason: impl std::fmt::Display) -> ExitCode {
    // Nobody may be there to read it any more.
    let _ = writeln!(std::io::stderr(), "tog: {reason}");
    ExitCode::from(code)
}
