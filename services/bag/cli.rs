//! Arguments of `tog bag` and their help.

use crate::cli::Format;
use clap::{Args, Subcommand, ValueEnum};
use recording::{ColumnMap, Echo, ReadOptions};
use std::path::PathBuf;

/// What is read, for the help of every verb.
const FORMATS: &str = "\
Read are, told by the content: MCAP (ROS 2 CDR, and converted ROS 1), ROS 2 bags in SQLite (.db3) and
their directories, ROS 1 bags (2.0 and 1.2), CARMEN logs (.log, .log.gz), Player logs (file version
0.3), and CSV whose columns are declared. Scans are sensor_msgs/LaserScan and MultiEchoLaserScan.";

/// Arguments of `tog bag`.
#[derive(Debug, Args)]
#[command(arg_required_else_help = true)]
pub struct Bag {
    /// What to do.
    #[command(subcommand)]
    pub verb: BagVerb,
}

/// Verbs of `tog bag`.
#[derive(Debug, Subcommand)]
pub enum BagVerb {
    /// Say what a recording holds: lasers, rates, beams, gaps, shares of no return and invalid.
    Info(Info),
    /// Make our own recording (MCAP, ROS 2) of the scans of any recording.
    Import(Import),
    /// Write the scans of a recording for other programs: CSV, MCAP.
    Export(Export),
    /// Copy the scans of a recording into another format, named by the ending: .mcap, .csv.
    Convert(Convert),
    /// Record what a running site sees and says, into a new ROS 2 bag.
    Record(super::record::Record),
    /// Play a recording as if it were live: a site round it, every service a process of its own.
    Play(super::play::Play),
    /// Make a complete recording out of one that was cut, by a kill or a broken copy.
    Recover(super::recover::Recover),
}

/// How a recording is read that does not say everything itself.
#[derive(Debug, Args)]
pub struct Reading {
    /// What the columns of a CSV are, in order: `t:ms,laser,-,r*181:mm,angle_min=-90:deg`.
    #[arg(
        long,
        value_name = "LIST",
        long_help = "\
What the columns of a CSV are, one scan a row: a list with commas, in order.
  t                UNIX time of the first beam (needed), :s (as without), :ms, :us or :ns
  log_t            when it was recorded; else the same as t
  laser            name of the laser; else all scans are of /scan
  frame_id         name of the laser's coordinates
  angle_min        bearing of the first range, :rad (as without) or :deg
  angle_max        bearing of the last range
  angle_increment  angle between two ranges
  range_min        shortest valid range, :m (as without), :cm or :mm
  range_max        from here on a range is `no return`
  scan_time        time of one turn, :s, :ms, :us, :ns
  r, r*181, r...   a range, 181 ranges, all that follow (needed), :m, :cm or :mm
  -                a column that is passed over
  NAME=VALUE       no column: this value for all rows, as range_max=8:m or laser=front
Angles are counter-clockwise. Needed besides, as columns or values: angle_min, range_max,
and angle_increment or angle_max.
`inf` is no return; `nan` and an empty field are invalid; empty fields at the end are no
ranges.
Fields are parted by commas, semicolons or tabs; one line of titles may stand before the rows,
lines that begin with # are comments, every other line is a scan or is refused and counted.
A CSV whose first line is such a list (as `tog bag export` writes) needs no --columns."
    )]
    pub columns: Option<ColumnMap>,
    /// Which echo of a beam with several is taken (MultiEchoLaserScan).
    #[arg(long, value_enum, default_value_t)]
    pub echo: EchoName,
}

/// Names of the echoes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum EchoName {
    /// The nearest: whatever is there first, glass included.
    #[default]
    First,
    /// The one with the highest intensity.
    Strongest,
    /// The farthest: what is behind glass, rain and dust.
    Last,
}

impl Reading {
    /// For the reader.
    pub fn options(&self) -> ReadOptions {
        let echo = match self.echo {
            EchoName::First => Echo::First,
            EchoName::Strongest => Echo::Strongest,
            EchoName::Last => Echo::Last,
        };
        ReadOptions { columns: self.columns.clone(), echo }
    }
}

/// Arguments of `tog bag info`.
#[derive(Debug, Args)]
#[command(after_help = format!("\
Examples:
  tog bag info walk.bag
  tog bag info night.mcap --format json
  tog bag info ros2_bag_directory
  tog bag info scans.csv --columns \"t:s,r*361:cm,angle_min=-90:deg,angle_increment=0.5:deg,range_max=80\"

{FORMATS}

A large MCAP file is answered from its index: counts, rates, gaps and jitter are those of all messages
(their log times), geometry and shares those of a sample of chunks; the answer says so.

Exit code 0: read. 1: refused, cut or damaged (what was found before is shown)."))]
pub struct Info {
    /// The recording: a file, or the directory of a ROS 2 bag.
    pub recording: PathBuf,
    /// Read every scan, even where the index of the file would do.
    #[arg(long)]
    pub full: bool,
    #[command(flatten)]
    pub reading: Reading,
    /// Output.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

/// Which scans are copied, and how.
#[derive(Debug, Args)]
pub struct Selection {
    /// Copy this laser, under this name; repeatable; without it all lasers under their own names.
    ///
    /// `front=/front_scan` copies topic /front_scan to topic /front, coordinates `laser_front`.
    #[arg(long = "laser", value_name = "NAME=TOPIC", value_parser = laser_topic)]
    pub lasers: Vec<LaserTopic>,
    /// Leave out what is stamped earlier, seconds behind the first scan.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub from_s: Option<f64>,
    /// Leave out what is stamped later, seconds behind the first scan.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub to_s: Option<f64>,
    #[command(flatten)]
    pub reading: Reading,
    /// Replace the file that is to be written if it is there.
    #[arg(long)]
    pub force: bool,
}

/// A laser and its topic in the recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LaserTopic {
    /// Name of the laser.
    pub laser: String,
    /// Its topic.
    pub topic: String,
}

fn laser_topic(text: &str) -> Result<LaserTopic, String> {
    let is_name = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    match text.split_once('=') {
        Some((laser, topic))
            if !topic.is_empty()
                && (1..=32).contains(&laser.len())
                && laser.chars().all(is_name) =>
        {
            Ok(LaserTopic { laser: laser.to_owned(), topic: topic.to_owned() })
        }
        _ => {
            Err("expected NAME=TOPIC, the name of 1 to 32 letters, digits, `-` and `_`".to_owned())
        }
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.0..1e10).contains(&seconds) => Ok(seconds),
        _ => Err("expected seconds, 0 or more".to_owned()),
    }
}

/// Arguments of `tog bag import`.
#[derive(Debug, Args)]
#[command(after_help = format!("\
Examples:
  tog bag import walk.bag --out walk.mcap
  tog bag import intel.log.gz --out intel.mcap
  tog bag import demo.bag --laser front=/front_scan --laser rear=/rear_scan --out demo.mcap
  tog bag import scans.csv --out scans.mcap \\
    --columns \"t:ms,laser,r*181:mm,angle_min=-90:deg,angle_increment=1:deg,range_max=8\"

{FORMATS}

Written is MCAP with the profile `ros2`: sensor_msgs/LaserScan in CDR, every number as it was read.

Exit code 0: written. 1: refused, or the recording is cut (what came before is written)."))]
pub struct Import {
    /// The recording: a file, or the directory of a ROS 2 bag.
    pub recording: PathBuf,
    /// The file to write.
    #[arg(long, value_name = "X.mcap")]
    pub out: PathBuf,
    #[command(flatten)]
    pub selection: Selection,
}

/// Formats that are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum OutFormat {
    /// One scan a row; the first line declares the columns, `tog` reads it back to the same numbers.
    Csv,
    /// ROS 2 recording.
    Mcap,
}

/// Arguments of `tog bag export`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tog bag export night.mcap --out night.csv
  tog bag export night.mcap --format mcap --from-s 60 --to-s 90 --out minute.mcap

A CSV begins with a line that declares its columns (see --columns): times in ns, angles in radians, ranges
in metres; `inf` is no return, `nan` invalid.

Exit code 0: written. 1: refused, or the recording is cut (what came before is written).")]
pub struct Export {
    /// The recording: a file, or the directory of a ROS 2 bag.
    pub recording: PathBuf,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// What to write; without it the ending of FILE says so.
    #[arg(long, value_enum)]
    pub format: Option<OutFormat>,
    #[command(flatten)]
    pub selection: Selection,
}

/// Arguments of `tog bag convert`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tog bag convert walk.bag walk.mcap
  tog bag convert ros2_bag_directory scans.csv
  tog bag convert scans.csv scans.mcap

As `tog bag export IN --out OUT`.

Exit code 0: written. 1: refused, or the recording is cut (what came before is written).")]
pub struct Convert {
    /// The recording: a file, or the directory of a ROS 2 bag.
    pub recording: PathBuf,
    /// The file to write: .mcap or .csv.
    pub out: PathBuf,
    #[command(flatten)]
    pub selection: Selection,
}
