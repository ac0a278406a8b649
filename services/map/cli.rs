//! Arguments of `tog map`.

use crate::cli::Format;
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Arguments of `tog map`.
#[derive(Debug, Args)]
#[command(arg_required_else_help = true)]
pub struct Map {
    /// What to do.
    #[command(subcommand)]
    pub verb: MapVerb,
}

/// Verbs of `tog map`.
#[derive(Debug, Subcommand)]
pub enum MapVerb {
    /// Say what maps hold: grid, observed time, classes, contexts.
    #[command(after_help = "\
Examples:
  tog map info maps
  tog map info --site deploy/foyer.toml --format json")]
    Info(Info),
    /// Draw a map as PNG or SVG.
    #[command(after_help = "\
Examples:
  tog map render maps --out overview.svg
  tog map render maps --class background --out walls.png
  tog map render maps --class lingering --scale max --out benches.png
  tog map render --site deploy/foyer.toml --context night --out pictures")]
    Render(Render),
    /// Say and draw what changed from one map to a later one of the same grid.
    #[command(after_help = "\
Examples:
  tog map diff monday tuesday
  tog map diff normal --site deploy/foyer.toml --format json
  tog map diff monday tuesday --class background --out walls.png

A cell changed if at least --change-min of its frames are of another class than before; cells side \
by side that changed to the same class are told as one place. Only cells that both maps have \
observed are compared; the others are counted.")]
    Diff(Diff),
    /// Write a map for other programs: nav2 (map.yaml, map.pgm) or NumPy.
    #[command(after_help = "\
Examples:
  tog map export maps --format nav2 --out floor
  tog map export --site deploy/foyer.toml --format npy --out foyer-map

nav2: map.pgm, the highest row first: 0 (occupied) where --class holds at least --occupied-min of \
the frames, 254 (free) elsewhere, 205 (unknown) where nothing was observed; map.yaml beside it.

npy: a map as `tog replay` writes it (collapsed_counts.npy, grid.json), and shares.npy (f64 \
[class,row,col], NaN where nothing was observed).")]
    Export(Export),
    /// Add the counts of maps of the same grid: two days, two hosts.
    #[command(after_help = "\
Examples:
  tog map merge monday tuesday --out week
  tog map merge week --site deploy/foyer.toml --out all

Refused if the grids differ: the key is named. Writes a map as `tog replay` does: every verb of \
`tog map` reads it.")]
    Merge(Merge),
}

/// Which maps.
#[derive(Debug, Args)]
pub struct Maps {
    /// Directory with grid.json and collapsed_counts.npy (of `tog replay` or `tog map`), or the file
    /// of a site: the checkpoint of its area.
    #[arg(value_name = "MAP")]
    pub maps: Vec<PathBuf>,
    /// One more map, the last: the checkpoint of an area of this site.
    #[arg(long, value_name = "SITE")]
    pub site: Option<PathBuf>,
    /// The area, where a site or a replay has several.
    #[arg(long, value_name = "AREA")]
    pub area: Option<String>,
}

/// Which part of a map.
#[derive(Debug, Args)]
pub struct Part {
    /// Only the frames of this context of the site file; all of them without it.
    #[arg(long, value_name = "CONTEXT")]
    pub context: Option<String>,
}

/// How pictures look.
#[derive(Debug, Args)]
pub struct Look {
    /// Only this class.
    #[arg(long, value_name = "CLASS")]
    pub class: Option<String>,
    /// Format of the pictures in a directory.
    #[arg(long, value_enum, default_value_t)]
    pub picture: Picture,
    /// Show the whole grid, not only what was observed.
    #[arg(long)]
    pub whole: bool,
}

/// Formats of pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum Picture {
    /// Pixels.
    #[default]
    Png,
    /// Shapes and text, for documents.
    Svg,
}

#[derive(Debug, Args)]
/// Arguments of `tog map info`.
pub struct Info {
    #[command(flatten)]
    pub maps: Maps,
    #[command(flatten)]
    pub part: Part,
    /// Output.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

#[derive(Debug, Args)]
/// Arguments of `tog map render`.
pub struct Render {
    #[command(flatten)]
    pub maps: Maps,
    #[command(flatten)]
    pub part: Part,
    #[command(flatten)]
    pub look: Look,
    /// A file NAME.png or NAME.svg: the overview, or the picture of --class. Else a directory: both.
    #[arg(long, value_name = "PATH")]
    pub out: PathBuf,
    /// Colour follows share ^ gamma, 0.1 to 1: small values show rare things.
    #[arg(long, default_value_t = 0.4)]
    pub gamma: f64,
    /// Where the colours of the picture of a class end.
    #[arg(long, value_enum, default_value_t)]
    pub scale: ScaleName,
}

/// Ends of the scale of colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum ScaleName {
    /// At 100 %: pictures of classes and maps can be compared.
    #[default]
    Full,
    /// At the largest share of the picture, which is named: shows what is rare everywhere.
    Max,
}

#[derive(Debug, Args)]
/// Arguments of `tog map diff`.
pub struct Diff {
    #[command(flatten)]
    pub maps: Maps,
    #[command(flatten)]
    pub part: Part,
    #[command(flatten)]
    pub look: Look,
    /// A cell changed if this share of its frames is of another class, above 0 to 1.
    #[arg(long, value_name = "SHARE", default_value_t = 0.2)]
    pub change_min: f64,
    /// A file NAME.png or NAME.svg: --class, or the class that changed most. Else a directory: a
    /// picture per class, and diff.json.
    #[arg(long, value_name = "PATH")]
    pub out: Option<PathBuf>,
    /// Colour follows |change| ^ gamma, 0.1 to 1: small values show small changes.
    #[arg(long, default_value_t = 0.7)]
    pub gamma: f64,
    /// Output.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

/// Formats of other programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// map.yaml and map.pgm, as nav2's map_server reads them.
    Nav2,
    /// NumPy arrays and grid.json.
    Npy,
}

#[derive(Debug, Args)]
/// Arguments of `tog map export`.
pub struct Export {
    #[command(flatten)]
    pub maps: Maps,
    #[command(flatten)]
    pub part: Part,
    /// Format.
    #[arg(long, value_enum)]
    pub format: ExportFormat,
    /// Directory for the files; created.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// npy: replace a map that is there.
    #[arg(long)]
    pub force: bool,
    /// nav2: the class that is an obstacle; the one that is occupied on all timescales unless set.
    #[arg(long, value_name = "CLASS")]
    pub class: Option<String>,
    /// nav2: a cell is occupied if the class holds at least this share of its frames, 0 to 1.
    #[arg(long, value_name = "SHARE", default_value_t = 0.5)]
    pub occupied_min: f64,
}

#[derive(Debug, Args)]
/// Arguments of `tog map merge`.
pub struct Merge {
    #[command(flatten)]
    pub maps: Maps,
    /// Directory for the sum; created.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Replace a map that is there.
    #[arg(long)]
    pub force: bool,
}
