//! `tog bag`: recordings.
//!
//! | file | what |
//! |---|---|
//! | `record.rs` | beside a running site, into a new bag |
//! | `play.rs` | a site made round a recording, every service a process of its own |
//! | `recover.rs` | a complete recording out of one that was cut |

mod play;
mod record;
mod recover;

use clap::{Args, Subcommand};
use std::process::ExitCode;

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
    /// Record what a running site sees and says, into a new ROS 2 bag.
    Record(record::Record),
    /// Play a recording as if it were live: a site round it, every service a process of its own.
    Play(play::Play),
    /// Make a complete recording out of one that was cut, by a kill or a broken copy.
    Recover(recover::Recover),
}

/// Runs `tog bag`.
pub fn run(arguments: &Bag) -> ExitCode {
    match &arguments.verb {
        BagVerb::Record(arguments) => record::run(arguments),
        BagVerb::Play(arguments) => play::run(arguments),
        BagVerb::Recover(arguments) => recover::run(arguments),
    }
}
