//! `tog experiment`: its arguments and its help.

use crate::cli::Format;
use clap::{Args, Subcommand};
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    after_help = "\
Examples:
  tog experiment 1 --out static
  tog experiment 3 --seed 7 --rate 75 --out foyer
  tog experiment verdict --seeds 10
  tog map diff one/default two/default    (of experiments 1 and 2: the same room)

1: nobody in a furnished room, four lasers, 120 s.
2: the same room, one person at random for 45 s, then four round a quadrilateral for 180 s.
3: a foyer, one laser, 20 minutes.

Writes scans.mcap, truth.jsonl (scene; people, legs and doors in time), surface.npy (true walls), \
site.toml to replay it, a directory per preset (default, paper, onehot) with its map for `tog map`, \
the paper's figure as PNG, verdicts.json and verdicts.txt. The frame period is the lasers' own, \
13.32 ms a turn of the mirror: the paper's cycle."
)]
/// Arguments of `tog experiment`.
pub struct Experiment {
    /// Judge many runs instead.
    #[command(subcommand)]
    pub verb: Option<ExperimentVerb>,
    /// Number of the experiment in the paper.
    #[arg(required = true, value_parser = clap::value_parser!(u8).range(1..=3))]
    pub number: Option<u8>,
    /// Seed of the people and of the noise.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Scans a second, 1 to 75.1; the nearest that an LMS 200 has.
    #[arg(long, value_name = "HZ", default_value_t = 9.4)]
    pub rate: f64,
    /// Directory for the results; created.
    #[arg(long, value_name = "DIR", required = true)]
    pub out: Option<PathBuf>,
    /// Replace the results of an earlier run that are there.
    #[arg(long)]
    pub force: bool,
    /// Output: the verdicts.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

/// Verbs of `tog experiment`.
#[derive(Debug, Subcommand)]
pub enum ExperimentVerb {
    /// Run all three over many seeds, at both rates, with all presets: the table of the README.
    #[command(after_help = "\
Examples:
  tog experiment verdict --seeds 10
  tog experiment verdict --seeds 40 --format json > verdicts.json

Exit code 0: every claim holds for nine seeds of ten with the default preset at both rates.
1: not; what does not is named.")]
    Verdict(Verdict),
}

#[derive(Debug, Args)]
/// Arguments of `tog experiment verdict`.
pub struct Verdict {
    /// Seeds 1 to N.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub seeds: u64,
    /// Output: a table in Markdown, or every number.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}
