//! Arguments of `tog certs`.

use crate::cli::Format;
use clap::{Args, Subcommand};
use std::path::PathBuf;

/// A host for five years, as long as its hardware; the authority for twenty.
const HOST_DAYS: u32 = 5 * 365;
const CA_DAYS: u32 = 20 * 365;

/// Arguments of `tog certs`.
#[derive(Debug, Args)]
pub struct Certs {
    /// What to do.
    #[command(subcommand)]
    pub verb: Verb,
}

/// Verbs of `tog certs`.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Make the authority of a site: once, on a machine that nobody else uses.
    #[command(after_help = "\
Examples:
  tog certs init building.toml --ca ca

Writes DIR/site-ca.pem, which every host gets, and DIR/site-ca.key, which no host gets: whoever has it
can make hosts. Nothing is overwritten.

Exit code 0: made. 1: not made. 2: usage. 78: the site file is wrong.")]
    Init(Init),
    /// Make key and certificate of a host, or of all hosts of a site.
    #[command(after_help = "\
Examples:
  tog certs issue building.toml edge --ca ca --out tls-edge
  tog certs issue building.toml --ca ca --out tls          tls/edge/.., tls/desk/.., of every host

Copy what is made to `tls_dir` of the site file on that host (/etc/tog/tls unless set), with the key
readable by the user that runs tog only. To try several hosts on one machine, issue each by its name with
the same --out: one `tls_dir` holds them all. Nothing is overwritten; to renew, write into an empty
directory.
A key was lost or stolen: write `certificate_number = 2` (3, ..) at that [[host]] in the site file of every
host, issue it anew, restart; certificates of lower numbers are refused from then on.

Exit code 0: made. 1: not made. 2: usage. 78: the site file is wrong.")]
    Issue(Issue),
    /// Show what certificates say: whose, for which address, until when.
    #[command(after_help = "\
Examples:
  tog certs show /etc/tog/tls/edge.pem
  tog certs show tls/*/*.pem --format json

Exit code 0: all are good today. 1: one is not, or cannot be read. 2: usage.")]
    Show(Show),
}

/// Arguments of `tog certs init`.
#[derive(Debug, Args)]
pub struct Init {
    /// The site file.
    pub site: PathBuf,
    /// Where the authority is put.
    #[arg(long, value_name = "DIR")]
    pub ca: PathBuf,
    /// How long it is good.
    #[arg(long, value_name = "N", default_value_t = CA_DAYS, value_parser = clap::value_parser!(u32).range(1..=36_500))]
    pub days: u32,
}

/// Arguments of `tog certs issue`.
#[derive(Debug, Args)]
pub struct Issue {
    /// The site file.
    pub site: PathBuf,
    /// The host; all hosts of the site unless given.
    pub host: Option<String>,
    /// Where the authority is.
    #[arg(long, value_name = "DIR")]
    pub ca: PathBuf,
    /// Where the files are put; of all hosts each in a directory of its own there.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// How long it is good.
    #[arg(long, value_name = "N", default_value_t = HOST_DAYS, value_parser = clap::value_parser!(u32).range(1..=36_500))]
    pub days: u32,
}

/// Arguments of `tog certs show`.
#[derive(Debug, Args)]
pub struct Show {
    /// Certificates (PEM).
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// Output.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}
