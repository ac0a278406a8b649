//! `tog bag record`: beside a running site, into a new bag.

use crate::cli::Format;
use crate::{fail, site_file};
use clap::{Args, ValueEnum};
use indicatif::{DecimalBytes, ProgressBar, ProgressDrawTarget, ProgressStyle};
use process::exit;
use process::instance::{default_run_root, run_dir_of};
use protocol::site::{RecordedTopics, Recorder};
use recorder::{AttachedOptions, Progress, record_attached};
use std::path::PathBuf;
use std::process::ExitCode;

/// A bag of a person is split by size only: a week is longer than anybody records by hand.
const SPLIT_S: f64 = 604_800.0;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tog bag record deploy/foyer.toml --out walk --seconds 60
  tog bag record deploy/foyer.toml --out scans --topics scans

Ends by Ctrl-C, after --seconds, or with the site. DIR is a ROS 2 bag (MCAP and metadata.yaml):
`ros2 bag play`, Foxglove and rosbags open it, and `tog replay DIR/DIR_0.mcap` computes its maps
again. The site goes on as it is: it has room for one more reader, and nobody waits for it. To
record always, write a section [recorder] into the site file.

Exit code 0: recorded. 1: the site does not run, or the disk is full: what came
before is kept, see tog bag recover.")]
/// Arguments of `tog bag record`.
pub struct Record {
    /// The site file of the running site.
    pub site: PathBuf,
    /// The bag: a directory that does not exist, or is empty.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// End by itself after so many seconds.
    #[arg(long, value_name = "N")]
    pub seconds: Option<u64>,
    /// What to record.
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = Topics::ALL)]
    pub topics: Vec<Topics>,
    /// Begin another file at this size, megabytes.
    #[arg(long, value_name = "MB", default_value_t = 512)]
    #[arg(value_parser = clap::value_parser!(u32).range(1..))]
    pub split_mb: u32,
    /// Output.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

/// Groups of topics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Topics {
    /// Every scan of every laser.
    Scans,
    /// Class maps and collapsed maps.
    Maps,
    /// Events, and where they are.
    Events,
}

impl Topics {
    const ALL: [Self; 3] = [Self::Scans, Self::Maps, Self::Events];

    fn recorded(self) -> RecordedTopics {
        match self {
            Self::Scans => RecordedTopics::Scans,
            Self::Maps => RecordedTopics::Maps,
            Self::Events => RecordedTopics::Events,
        }
    }
}

/// Runs `tog bag record`.
pub fn run(arguments: &Record) -> ExitCode {
    let site = match site_file::load(&arguments.site) {
        Ok(site) => site,
        Err(error) => return fail(exit::BAD_CONFIG, error),
    };
    let configured = site.recorder.clone().unwrap_or_default();
    let options = AttachedOptions {
        run_dir: run_dir_of(&site.name, &default_run_root()),
        out: arguments.out.clone(),
        settings: Recorder {
            topics: arguments.topics.iter().map(|topics| topics.recorded()).collect(),
            split_mb: f64::from(arguments.split_mb),
            split_s: SPLIT_S,
            maps_period_s: configured.maps_period_s,
            classes_period_s: configured.classes_period_s,
            ..Recorder::default()
        },
        seconds: arguments.seconds.map(|seconds| seconds as f64),
    };
    let bar = progress_bar(arguments.seconds);
    let recorded = record_attached(&options, |progress| {
        bar.set_position(progress.seconds as u64);
        bar.set_message(words(progress));
    });
    bar.finish_and_clear();
    match recorded {
        Ok(progress) => report(arguments, &progress),
        Err(error) => fail(exit::FAILED, error),
    }
}

fn words(progress: &Progress) -> String {
    let (messages, bytes) = (progress.tape.messages_written, progress.tape.bytes_written);
    let lost = match progress.counts.lost {
        0 => String::new(),
        lost => format!(", {lost} lost on the way: this host is too busy"),
    };
    format!("{messages} messages, {}{lost}", DecimalBytes(bytes))
}

fn report(arguments: &Record, progress: &Progress) -> ExitCode {
    let out = arguments.out.display();
    match arguments.format {
        Format::Text => {
            eprintln!("tog: recorded {} in {:.1} s into {out}", words(progress), progress.seconds);
            ExitCode::from(exit::OK)
        }
        Format::Json => {
            let report = serde_json::json!({
                "out": out.to_string(),
                "seconds": progress.seconds,
                "messages": progress.tape.messages_written,
                "messages_lost": progress.counts.lost,
                "bytes": progress.tape.bytes_written,
                "files": progress.tape.files,
            });
            crate::operate::write_out(&format!("{report:#}\n"), exit::OK)
        }
    }
}

/// A bar over the seconds that are asked for; a clock if it goes on until Ctrl-C. On a terminal
/// only.
fn progress_bar(seconds: Option<u64>) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(seconds, ProgressDrawTarget::stderr());
    let template = if seconds.is_some() {
        "recording [{wide_bar}] {pos}/{len} s, {msg}"
    } else {
        "recording for {pos} s: {msg} (Ctrl-C ends)"
    };
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}
