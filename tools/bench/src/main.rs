//! Latency and soak of the running system: `cargo run --release -p bench -- --help`.
//!
//! Lays out a foyer in which something is left or taken every few seconds, lets `tog learn` teach the
//! site what is normal there, runs it with separate processes while other threads keep both cores busy,
//! and reads what the services measured of themselves: `tog status --format json`.
//!
//! The latency of an event is from the publication of the scan that completed its frame to its arrival
//! at the alerts process: four hops (laser -> fusion -> mapper -> anomaly -> alerts). The latency of a
//! frame ends at the anomaly process.

mod load;
mod site;

use clap::Parser;
use serde_json::Value;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::mpsc;
use std::time::Duration;

/// Measures latency, losses and CPU of a running site and prints a table.
#[derive(Debug, Parser)]
#[command(
    name = "bench",
    after_help = "\
Examples:
  cargo build --release && cargo run --release -p bench
  cargo run --release -p bench -- --seconds 600 --rate-hz 75 --busy 2
  cargo run --release -p bench -- --seconds 60 --busy 0      idle machine"
)]
struct Arguments {
    /// How long to run live, seconds.
    #[arg(long, default_value_t = 120)]
    seconds: u64,
    /// Scans a second.
    #[arg(long, default_value_t = 75.0)]
    rate_hz: f64,
    /// Threads that burn CPU beside the site; 2 keep both cores of a small machine busy.
    #[arg(long, default_value_t = 2)]
    busy: usize,
    /// The tog binary; the one beside this program unless given.
    #[arg(long)]
    tog: Option<PathBuf>,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("bench: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    let tog = match &arguments.tog {
        Some(path) => path.clone(),
        None => std::env::current_exe()?.with_file_name("tog"),
    };
    if !tog.is_file() {
        return Err(format!("{} is not there: cargo build --release", tog.display()).into());
    }
    let directory = tempfile::Builder::new().prefix("tog-bench-").tempdir()?;
    let file = site::lay_out(directory.path(), arguments.rate_hz, arguments.seconds)?;
    eprintln!("bench: the site learns from its past");
    let learnt = command(&tog, directory.path(), &["learn"], &file).status()?;
    if !learnt.success() {
        return Err("tog learn failed".into());
    }
    site::stage(directory.path(), arguments.seconds)?;
    eprintln!("bench: {} s live, {} busy threads", arguments.seconds, arguments.busy);
    let seconds = (arguments.seconds + 20).to_string();
    let mut site =
        command(&tog, directory.path(), &["run", "--seconds", &seconds], &file).spawn()?;
    let status = {
        let _load = load::Load::start(arguments.busy);
        wait(&mut site, Duration::from_secs(arguments.seconds))?;
        command(&tog, directory.path(), &["status", "--format", "json"], &file)
            .stdout(Stdio::piped())
            .output()?
    };
    let report: Value = serde_json::from_slice(&status.stdout)?;
    print_report(arguments, &report);
    let stopped = Command::new("kill").arg(site.id().to_string()).status()?;
    if !stopped.success() || !site.wait()?.success() {
        return Err("the site did not end well".into());
    }
    Ok(())
}

fn command(tog: &Path, directory: &Path, verb: &[&str], site: &Path) -> Command {
    let mut command = Command::new(tog);
    command.args(verb).arg(site).env("TOG_RUN_DIR", directory.join("r")).env("TOG_LOG", "warn");
    command
}

/// Waits for so long, or until the site dies, which is an error.
fn wait(site: &mut Child, time: Duration) -> Result<(), Box<dyn Error>> {
    let (_keep, never) = mpsc::channel::<()>();
    let _ = never.recv_timeout(time);
    match site.try_wait()? {
        Some(code) => Err(format!("the site ended early: {code}").into()),
        None => Ok(()),
    }
}

fn print_report(arguments: &Arguments, report: &Value) {
    let empty = Vec::new();
    let services = report["services"].as_array().unwrap_or(&empty);
    let service = |kind: &str| {
        let of_kind =
            |service: &&Value| service["name"].as_str().is_some_and(|n| n.starts_with(kind));
        services.iter().find(of_kind).unwrap_or(&Value::Null)
    };
    let counter = |kind: &str, name: &str| service(kind)["counters"][name].as_u64().unwrap_or(0);
    let gauge = |kind: &str, name: &str| service(kind)["gauges"][name].as_f64();
    let ms = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.2}"));
    println!(
        "| {} s at {} Hz, {} busy threads | p50 ms | p99 ms | of |\n|---|---|---|---|",
        arguments.seconds, arguments.rate_hz, arguments.busy
    );
    println!(
        "| scan -> class map at anomaly | {} | {} | newest 1000 frames |",
        ms(gauge("anomaly", "frame_latency_p50_ms")),
        ms(gauge("anomaly", "frame_latency_p99_ms"))
    );
    println!(
        "| scan -> event at alerts | {} | {} | {} changes of events |",
        ms(gauge("alerts", "event_latency_p50_ms")),
        ms(gauge("alerts", "event_latency_p99_ms")),
        counter("alerts", "changes_in")
    );
    println!("\n| losses | count |\n|---|---|");
    for (kind, name) in [
        ("laser", "scans_out"),
        ("fusion", "scans_in"),
        ("fusion", "scans_lost"),
        ("fusion", "scans_late"),
        ("fusion", "frames_out"),
        ("fusion", "frames_by_deadline"),
        ("mapper", "frames_in"),
        ("mapper", "frames_lost"),
        ("anomaly", "class_maps_in"),
        ("anomaly", "class_maps_lost"),
        ("alerts", "changes_lost"),
    ] {
        println!("| {kind} {name} | {} |", counter(kind, name));
    }
    println!("\n| service | CPU s | share of a core |\n|---|---|---|");
    for service in services {
        let cpu_s = service["gauges"]["cpu_s"].as_f64();
        let share = cpu_s.zip(service["up_s"].as_f64()).map(|(cpu, up)| 100.0 * cpu / up);
        println!(
            "| {} | {} | {} % |",
            service["name"].as_str().unwrap_or("?"),
            ms(cpu_s),
            ms(share)
        );
    }
}
