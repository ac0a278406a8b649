//! `simulator`: writes workloads and scenes with their truth, and shows them.

use clap::{Args, Parser, Subcommand, ValueEnum};
use protocol::time::{Lattice, MILLISECOND_NS};
use scene::{BUILTIN, Scene, SceneError, World};
use simulator::export::{self, ExportError, Plan};
use simulator::measure::Liveliness;
use simulator::picture;
use simulator::site_file::{self, Scans};
use simulator::workload::{self, Workload};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// 2026-01-01T00:00:00Z: the stamp of a workload's frame 0, so that recordings have a date.
const WORKLOAD_FROM_NS: u64 = 1_767_225_600_000 * MILLISECOND_NS;
/// Half depth of a hit on the measured workloads, metres.
const WORKLOAD_TOLERANCE_M: f64 = 0.05;

/// Writes simulated scans with their truth.
#[derive(Parser)]
#[command(
    version,
    after_help = "Examples:\n  \
    simulator scene foyer --seconds 120 --rate-hz 10 --out foyer.mcap\n      \
    records two minutes of the foyer; the truth goes to foyer.truth.jsonl\n  \
    simulator scene foyer --seconds 120 --incident suitcase@60 --out left.mcap\n      \
    the same two minutes, but a suitcase is left after one\n  \
    simulator workload w2r --frames 90000 --out w2r.mcap --site w2r.toml\n      \
    20 minutes of the benchmark, with the site file to replay it\n  \
    simulator workload w1r --frames 1500\n      \
    says how alive the workload is, writes nothing\n  \
    simulator look foyer --at-s 95\n      \
    draws what the lasers see\n  \
    simulator site room\n      \
    prints a site file that watches the scene"
)]
struct Command {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Lists the built-in scenes and their prepared incidents.
    Scenes,
    /// Imagines a scene: a summary as JSON, and a recording with its truth if asked.
    Scene(SceneArgs),
    /// Imagines a benchmark workload: a summary as JSON, and a recording if asked.
    Workload(WorkloadArgs),
    /// Draws a scene at an instant in characters.
    Look(LookArgs),
    /// Prints a site file that watches a scene.
    Site(SiteArgs),
}

#[derive(Args)]
struct SceneArgs {
    /// Name of a built-in scene, or path of a scene file.
    scene: String,
    /// Seed of people and noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Begin, seconds after the anchor of the scene.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    from_s: f64,
    /// Length, seconds.
    #[arg(long, default_value_t = 60.0)]
    seconds: f64,
    /// Turns of the lasers a second.
    #[arg(long, default_value_t = 10.0)]
    rate_hz: f64,
    /// Stages a prepared incident, so many seconds after the begin: ID@SECONDS.
    #[arg(long, value_name = "ID@SECONDS")]
    incident: Vec<String>,
    /// Recording to write (MCAP); the truth goes beside it.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Where the truth goes: <out>.truth.jsonl unless said.
    #[arg(long)]
    truth: Option<PathBuf>,
}

#[derive(Args)]
struct WorkloadArgs {
    /// Which.
    workload: WorkloadName,
    /// Seed of people and noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Frames.
    #[arg(long, default_value_t = 1500)]
    frames: u64,
    /// Recording to write (MCAP).
    #[arg(long)]
    out: Option<PathBuf>,
    /// Site file to write, which replays the recording.
    #[arg(long, requires = "out")]
    site: Option<PathBuf>,
}

#[derive(Clone, Copy, ValueEnum)]
enum WorkloadName {
    /// Four lasers in a furnished room, four walkers, 75 Hz.
    W1r,
    /// One laser in the foyer, 75 Hz.
    W2r,
    /// Sixteen lasers in a hall, thirty walkers, 25 Hz.
    W3r,
}

#[derive(Args)]
struct LookArgs {
    /// Name of a built-in scene, or path of a scene file.
    scene: String,
    /// Seed of people and noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// When, seconds after the anchor of the scene.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    at_s: f64,
    /// Width of a character, metres.
    #[arg(long, default_value_t = 0.12)]
    cell_m: f64,
}

#[derive(Args)]
struct SiteArgs {
    /// Name of a built-in scene, or path of a scene file.
    scene: String,
    /// Seed of people and noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Scans a second.
    #[arg(long, default_value_t = 10.0)]
    rate_hz: f64,
}

/// Why the program gives up.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error(transparent)]
    Export(#[from] ExportError),
    #[error("cannot {action} {}: {source}", path.display())]
    File { action: &'static str, path: PathBuf, source: std::io::Error },
    #[error("found `--incident {0}`, expected ID@SECONDS, for example suitcase@60")]
    Incident(String),
    #[error("cannot write to the terminal: {0}")]
    Output(#[from] std::io::Error),
    #[error("the summary cannot be written as JSON: {0}")]
    Json(#[from] serde_json::Error),
}

fn main() -> ExitCode {
    match run(Command::parse().verb) {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure::Output(error)) if error.kind() == std::io::ErrorKind::BrokenPipe => {
            ExitCode::SUCCESS // the reader has seen enough: `simulator look .. | head`
        }
        Err(failure) => {
            eprintln!("simulator: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn run(verb: Verb) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match verb {
        Verb::Scenes => {
            for (name, _) in BUILTIN {
                let scene = Scene::builtin(name)?;
                let incidents: Vec<&str> =
                    scene.incidents.iter().map(scene::Incident::id).collect();
                writeln!(out, "{name}: {}; incidents: {}", scene.about, incidents.join(", "))?;
            }
        }
        Verb::Scene(args) => {
            let summary = export_scene(&args)?;
            writeln!(out, "{}", serde_json::to_string_pretty(&summary)?)?;
        }
        Verb::Workload(args) => export_workload(&args, &mut out)?,
        Verb::Look(args) => {
            let mut world = World::new(open(&args.scene)?, args.seed)?;
            write!(out, "{}", picture::look(&mut world, args.at_s, args.cell_m))?;
        }
        Verb::Site(args) => {
            let scans = Scans::Simulated(&args.scene, args.seed);
            write!(out, "{}", site_file::of_scene(&open(&args.scene)?, args.rate_hz, scans))?;
        }
    }
    Ok(())
}

/// A built-in scene by its name, or else a file.
fn open(name: &str) -> Result<Scene, Failure> {
    match Scene::builtin(name) {
        Err(SceneError::Unknown { .. }) if Path::new(name).exists() => {
            let text = std::fs::read_to_string(name).map_err(|source| Failure::File {
                action: "read",
                path: name.into(),
                source,
            })?;
            Ok(Scene::parse(&text, name)?)
        }
        scene => Ok(scene?),
    }
}

fn export_scene(args: &SceneArgs) -> Result<export::Summary, Failure> {
    let mut scene = open(&args.scene)?;
    for staged in &args.incident {
        let wrong = || Failure::Incident(staged.clone());
        let (id, after_s) = staged.split_once('@').ok_or_else(wrong)?;
        let after_s: f64 = after_s.parse().map_err(|_| wrong())?;
        scene = scene.staged(id, args.from_s + after_s)?;
    }
    let plan = Plan::new(scene.stamp_ns(args.from_s), args.seconds, args.rate_hz)?;
    let beside = args.out.as_ref().map(|path| path.with_extension("truth.jsonl"));
    let plan = Plan { recording: args.out.clone(), truth: args.truth.clone().or(beside), ..plan };
    Ok(export::scene(&mut World::new(scene, args.seed)?, &plan)?)
}

fn export_workload(args: &WorkloadArgs, out: &mut impl Write) -> Result<(), Failure> {
    let build: fn(u64, u64) -> Result<Workload, SceneError> = match args.workload {
        WorkloadName::W1r => workload::w1r,
        WorkloadName::W2r => workload::w2r,
        WorkloadName::W3r => workload::w3r,
    };
    let mut workload = build(args.seed, args.frames)?;
    let Some(path) = &args.out else {
        let life = Liveliness::of(&mut workload, WORKLOAD_TOLERANCE_M);
        writeln!(out, "{}", serde_json::to_string_pretty(&life)?)?;
        return Ok(());
    };
    let lattice = Lattice::new(workload.frame_period_ns);
    let plan = Plan {
        first_stamp_ns: lattice.stamp_ns(lattice.first_at_or_after(WORKLOAD_FROM_NS)),
        period_ns: workload.frame_period_ns,
        turns: workload.frames,
        recording: Some(path.clone()),
        truth: None,
    };
    let summary = export::workload(&mut workload, &plan)?;
    writeln!(out, "{}", serde_json::to_string_pretty(&summary)?)?;
    if let Some(site) = &args.site {
        let fault = |source| Failure::File { action: "write", path: site.clone(), source };
        let recording = seen_from(site, path).map_err(fault)?;
        let text = site_file::of_workload(&workload, &recording.to_string_lossy());
        std::fs::write(site, text).map_err(fault)?;
    }
    Ok(())
}

/// The path of a recording as a site file names it: relative if both lie in one folder.
fn seen_from(site: &Path, recording: &Path) -> std::io::Result<PathBuf> {
    let (site, recording) = (std::path::absolute(site)?, std::path::absolute(recording)?);
    Ok(match recording.file_name() {
        Some(name) if site.parent() == recording.parent() => name.into(),
        _ => recording,
    })
}
