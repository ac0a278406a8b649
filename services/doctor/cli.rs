//! Arguments of `tog doctor`.

use crate::cli::Format;
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tog doctor building.toml --host edge           before the first start
  tog doctor /etc/tog/building.toml              of what runs here: peers, links, events
  tog doctor building.toml --format json

Looks at the run directory, shared memory, the user, disk, clock, the port, certificates, the other hosts,
and, if the site runs, whether data flows on every link. Changes nothing.

Exit code 0: nothing fails (there may be warnings). 1: something does. 2: usage. 78: the site file is wrong.")]
/// Arguments of `tog doctor`.
pub struct Doctor {
    /// The site file.
    pub site: PathBuf,
    /// Which host of the site this is; as for `tog run`.
    #[arg(long, value_name = "HOST")]
    pub host: Option<String>,
    /// Output.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}
