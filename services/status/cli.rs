//! `tog status`, `tog graph`, `tog top`: their arguments.

use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Output of `tog status`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum StatusFormat {
    /// For people.
    #[default]
    Text,
    /// For programs.
    Json,
    /// For Prometheus: the text format, as its node exporter reads from a file.
    Prometheus,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tog status deploy/foyer.toml
  tog status building.toml --site          every host of the building, as this one knows it
  tog status deploy/foyer.toml --verbose
  tog status deploy/foyer.toml --format json
  tog status building.toml --format prometheus > /var/lib/node_exporter/tog.prom

A line per service: its state, how long it runs, what it delivers a second, and `age`: of a laser
the time since its newest scan was taken, of the others the time since they last told how they are
(once a second; after 3 s a service is not well). Below it how far an area has learnt, and what is
wrong, open faults of the feed included.

Exit code 0: all is well. 1: something is wrong, or the site does not run. 2: usage. 78: the site
file is wrong.")]
/// Arguments of `tog status`.
pub struct Status {
    /// The site file of the running site.
    pub site: PathBuf,
    /// Process ids and every counter, too.
    #[arg(long, short)]
    pub verbose: bool,
    /// All hosts of the site: who is heard, whose clock differs, which areas run where.
    #[arg(long = "site", conflicts_with = "verbose")]
    pub building: bool,
    /// Output.
    #[arg(long, value_enum, default_value_t)]
    pub format: StatusFormat,
}

/// Output of `tog graph`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum GraphFormat {
    /// Graphviz: `tog graph site.toml | dot -Tsvg > site.svg`.
    #[default]
    Dot,
    /// Mermaid, as wikis and code forges draw it.
    Mermaid,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tog graph deploy/building.toml | dot -Tsvg > building.svg
  tog graph deploy/foyer.toml --format mermaid

Processes of every host, and the topics between them, as the site file has it; nothing need run.

Exit code 0: drawn. 2: usage. 78: the site file is wrong.")]
/// Arguments of `tog graph`.
pub struct Graph {
    /// The site file.
    pub site: PathBuf,
    /// Output.
    #[arg(long, value_enum, default_value_t)]
    pub format: GraphFormat,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tog top deploy/foyer.toml

What `tog status` says, every second, with the CPU of each process and the newest alerts. q or Ctrl-C
ends it.

Exit code 0: ended. 1: there is no terminal. 2: usage. 78: the site file is wrong.")]
/// Arguments of `tog top`.
pub struct Top {
    /// The site file of the running site.
    pub site: PathBuf,
}
