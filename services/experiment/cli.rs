//! `tog experiment`: its arguments and its help.

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
  tog experiment verdict --seeds 10"
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
    /// Scans a second: the rate of an LMS 200 that is nearest.
    #[arg(long, value_name = "HZ", default_value_t = 9.4)]
    pub rate: f64,
    /// Directory for the results; created.
    #[arg(long, value_name = "DIR", required = true)]
    pub out: Option<PathBuf>,
}

/// Verbs of `tog experiment`.
#[derive(Debug, Subcommand)]
pub enum ExperimentVerb {
    /// Run all three over many seeds, at both rates, with all presets: the table of the README.
    Verdict(Verdict),
}

#[derive(Debug, Args)]
/// Arguments of `tog experiment verdict`.
pub struct Verdict {
    /// Seeds 1 to N.
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub seeds: u64,
}
