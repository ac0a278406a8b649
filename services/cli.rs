//! The verbs of `tog`, their arguments and their help. Parsing only; `main.rs` dispatches.

use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Watches buildings with planar laser rangefinders and says in words what is not normal.
#[derive(Debug, Parser)]
#[command(
    name = "tog",
    version,
    about,
    max_term_width = 100,
    after_help = "\
Examples:
  tog demo                          a simulated foyer, everything running, an alert within a minute
  tog replay walk.bag --out maps    what a recording says: maps, classes, events, pictures
  tog bag info walk.bag             what a recording holds
  tog check site.toml               is this site file right?
  tog run site.toml                 start everything that the site file names
  tog status site.toml              how is it?
  tog alerts watch site.toml        follow the alerts"
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub verb: Verb,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Show the whole system at work on a simulated foyer: no hardware, no files.
    Demo(Demo),
    /// Compute maps, classes and events of a recording, in one process, as fast as it goes.
    Replay(Replay),
    /// Run an experiment of the paper on an imagined building, and judge what the map shows.
    Experiment(crate::experiment::cli::Experiment),
    /// Start and supervise every process that a site file names.
    Run(Run),
    /// Let a simulated site learn from its own past, in fast motion.
    Learn(Learn),
    /// Show how the services of a running site are.
    Status(crate::status::cli::Status),
    /// Show a running site in the terminal, as it changes.
    Top(crate::status::cli::Top),
    /// Draw the processes of a site and what flows between them.
    Graph(crate::status::cli::Graph),
    /// List or follow the alerts of a site.
    Alerts(Alerts),
    /// Draw, compare, add and export collapsed maps.
    Map(crate::map::cli::Map),
    /// Recordings: record, play, recover, what they hold, from and into other formats.
    Bag(crate::bag::cli::Bag),
    /// Certificates by which the hosts of a site know each other.
    Certs(crate::certs::cli::Certs),
    /// Look at this machine and at a running site: what would not work, and what to do.
    Doctor(crate::doctor::cli::Doctor),
    /// Check a site file and show what it would start.
    Check(Check),
    /// Print the JSON Schema of the site file, for editors.
    #[command(after_help = "Examples:\n  tog schema > site.schema.json")]
    Schema,
    /// The way of a running site to its other hosts (started by `tog run`).
    #[command(hide = true)]
    Bridge(Worker),
    /// The recorder of a running site (started by `tog run`).
    #[command(hide = true)]
    Recorder(Worker),
    /// One laser of a running site (started by `tog run`).
    #[command(hide = true)]
    Laser(Worker),
    /// Fusion of one area of a running site (started by `tog run`).
    #[command(hide = true)]
    Fusion(Worker),
    /// Grid and maps of one area of a running site (started by `tog run`).
    #[command(hide = true)]
    Mapper(Worker),
    /// Events of one area of a running site (started by `tog run`).
    #[command(hide = true)]
    Anomaly(Worker),
}

/// Output of a listing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum Format {
    /// For people.
    #[default]
    Text,
    /// For programs: one JSON document, or one line each where it streams.
    Json,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tog demo                 until Ctrl-C
  tog demo --seconds 60    ends by itself, exit code 0")]
/// Arguments of `tog demo`.
pub struct Demo {
    /// End by itself after so many seconds of live running.
    #[arg(long, value_name = "N")]
    pub seconds: Option<u64>,
    /// Seed of the simulated people and of the noise.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tog replay walk.bag --out maps
  tog replay night.mcap --site building.toml --out maps --every-frame

Writes per area (into DIR; into DIR/<area> if the site has several): collapsed_counts.npy \
(u64 [class,row,col]), classes.npy (u8 [frame,row,col]) and frames.npy (u64 lattice indices), \
occupancy_last.npy (f64 [timescale,row,col]), grid.json, events.jsonl, a PNG per class, overview.png. \
If the results of another run are there they are left, and the replay is refused; with --force they \
are removed first.

Without --site a recording of ours is replayed with the site that is attached to it (unless --preset \
is said); of any other every laser gets an area of its own, laid round its scans with 10 cm cells and \
the laser at (0, 0): a recording does not say how its lasers are mounted. Where scans come more \
slowly than 4 Hz, the frames do too.

Exit code 0: replayed to the end.
1: refused; or the recording is cut, or most scans of a laser had to be dropped (what was replayed \
is written).")]
/// Arguments of `tog replay`.
pub struct Replay {
    /// The recording, of any format that `tog bag info` reads.
    pub recording: PathBuf,
    /// Site file whose replay lasers are fed from the recording.
    #[arg(long, value_name = "SITE")]
    pub site: Option<PathBuf>,
    /// Directory for the results; created.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Replace the results of an earlier run that are there.
    #[arg(long)]
    pub force: bool,
    /// Write the classes of every frame, not of one a second.
    #[arg(long)]
    pub every_frame: bool,
    /// Classes to use where no site file names them.
    #[arg(long, value_enum, default_value_t = PresetName::Default, conflicts_with = "site")]
    pub preset: PresetName,
}

/// Names of the presets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PresetName {
    /// empty, passing, lingering, vacated, background, transit.
    Default,
    /// As `default` without transit.
    Paper,
    /// As `default` with lingering = 0 1 0.
    Onehot,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tog run deploy/foyer.toml
  tog run building.toml --seconds 600
  tog run building.toml --host edge     what the site file places on this host, and the way to the others

Exit code 0: ended by Ctrl-C, SIGTERM, --seconds or the end of the recordings. 78: the site file is
wrong. 1: a service could not be kept running; it is named with its own last lines.")]
/// Arguments of `tog run`.
pub struct Run {
    /// The site file.
    pub site: PathBuf,
    /// Which host of the site file this is; needed if it names several.
    #[arg(long, value_name = "HOST")]
    pub host: Option<String>,
    /// When the recordings begin, the same on all hosts: 2026-11-26T10:00:00Z. Needed where several
    /// hosts replay.
    #[arg(long, value_name = "TIME")]
    pub replay_at: Option<String>,
    /// End by itself after so many seconds.
    #[arg(long, value_name = "N")]
    pub seconds: Option<u64>,
    /// Write the results of a replayed site as `tog replay --every-frame` does: the .npy files,
    /// grid.json and the pictures; the events are in the journal.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tog learn deploy/foyer.toml && tog run deploy/foyer.toml

Shows the area as much of its simulated past as its detector learns and calibrates from, up to now,
and leaves map and normal model in the state directory: `tog run` then watches from its start.

Exit code 0: learnt. 1: a laser is not simulated, the site runs, or the disk refuses. 2: usage.
78: the site file is wrong.")]
/// Arguments of `tog learn`.
pub struct Learn {
    /// The site file; all its lasers are simulated.
    pub site: PathBuf,
}

#[derive(Debug, Args)]
#[command(arg_required_else_help = true, args_conflicts_with_subcommands = true)]
/// Arguments of `tog alerts`: a verb, or the service itself.
pub struct Alerts {
    /// What to do.
    #[command(subcommand)]
    pub verb: Option<AlertsVerb>,
    /// Run as the service of this instance (`tog run` does).
    #[arg(long, value_name = "DIR", hide = true)]
    pub instance: Option<PathBuf>,
}

/// Verbs of `tog alerts`.
#[derive(Debug, Subcommand)]
pub enum AlertsVerb {
    /// List alerts from the journal, newest last; works while the site runs and when it does not.
    #[command(after_help = "\
Examples:
  tog alerts list deploy/foyer.toml --last 20
  tog alerts list deploy/foyer.toml --open --format json

Exit code 0: listed, also if nothing matches. 1: there is no journal, or it cannot be read. 2: usage.
78: the site file is wrong.")]
    List(AlertsList),
    /// Follow the alerts of a running site; picks up again when the site restarts.
    #[command(after_help = "\
Examples:
  tog alerts watch deploy/foyer.toml
  tog alerts watch deploy/foyer.toml --from-start --format json

Exit code 0: ended by Ctrl-C or by its reader. 1: the site does not run, or its state directory is
gone. 2: usage. 78: the site file is wrong.")]
    Watch(AlertsWatch),
}

#[derive(Debug, Args)]
/// Arguments of `tog alerts list`.
pub struct AlertsList {
    /// The site file.
    pub site: PathBuf,
    /// The journal of this host, where the site file names several; of `$TOG_HOST`, else of the first desk,
    /// unless set.
    #[arg(long, value_name = "HOST")]
    pub host: Option<String>,
    /// At most so many, the newest.
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub last: usize,
    /// Only events that are not cleared.
    #[arg(long)]
    pub open: bool,
    /// Only of this area.
    #[arg(long, value_name = "AREA")]
    pub area: Option<String>,
    /// Output.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

#[derive(Debug, Args)]
/// Arguments of `tog alerts watch`.
pub struct AlertsWatch {
    /// The site file of the running site.
    pub site: PathBuf,
    /// Begin with the whole journal instead of what comes from now on.
    #[arg(long)]
    pub from_start: bool,
    /// Output.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tog check deploy/foyer.toml
  tog check building.toml --format json

Opens the scenes and recordings that the lasers are fed from, too; warns if the first scans of a
recording lie outside the area.

Exit code 0: right. 78: wrong, with every error of the file, its line and a caret; when the file is
right, every error of the scenes and recordings that it names. With --format json the errors are on
stdout: `items`, each with `line`, `column` and `message`.")]
/// Arguments of `tog check`.
pub struct Check {
    /// The site file.
    pub site: PathBuf,
    /// Output.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

#[derive(Debug, Args)]
/// Arguments of a service that `tog run` starts.
pub struct Worker {
    /// The instance's run directory.
    #[arg(long, value_name = "DIR")]
    pub instance: PathBuf,
    /// The laser that it serves.
    #[arg(long, value_name = "ID")]
    pub laser: Option<String>,
    /// The area that it serves.
    #[arg(long, value_name = "ID")]
    pub area: Option<String>,
}
