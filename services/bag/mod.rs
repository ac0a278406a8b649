//! `tog bag`: recordings, whoever made them.
//!
//! | file | what |
//! |---|---|
//! | `cli.rs` | arguments and help |
//! | `info.rs` | what a recording holds |
//! | `import.rs` | scans of any recording into MCAP: which lasers, under which names |
//! | `export.rs` | scans of any recording into a CSV or MCAP |
//! | `record.rs` | beside a running site, into a new bag |
//! | `site.rs` | the site that is attached to a recording, its lasers fed by the recording |
//! | `target.rs` | what may be written over |
//! | `play.rs` | a site made round a recording, every service a process of its own |
//! | `recover.rs` | a complete recording out of one that was cut |

pub mod cli;
mod export;
mod import;
mod info;
mod play;
mod record;
mod recover;
pub mod site;
mod target;

use crate::fail;
use cli::{Bag, BagVerb};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use process::exit;
use recording::RecordingError;
use std::path::PathBuf;
use std::process::ExitCode;

/// Why a verb could not do what it was asked to.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// The recording, or what is written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// Something is there already.
    #[error("{} is there already: name another file, or say --force to replace it", .0.display())]
    Exists(PathBuf),
    /// Something that is no file.
    #[error("{} is {found}, expected a file or nothing: name another file", path.display())]
    NoFile {
        /// What was named.
        path: PathBuf,
        /// What it is.
        found: &'static str,
    },
    /// What is to be written cannot be looked at.
    #[error("cannot write {}: {source}", path.display())]
    Target {
        /// What was named.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// Import into another format.
    #[error(
        "tog bag import writes MCAP, the ending of {} says otherwise: name a file that ends in \
         .mcap, or use tog bag export",
        .0.display()
    )]
    NotMcap(PathBuf),
    /// Read and written are the same file.
    #[error("{} would be written over the recording that is read: name another file", .0.display())]
    Same(PathBuf),
    /// The ending says nothing.
    #[error(
        "cannot tell from the ending of {} what to write, expected .mcap or .csv: rename it, or say \
         --format",
        .0.display()
    )]
    Ending(PathBuf),
    /// A laser that nobody recorded.
    #[error("laser {laser}: no scans on topic {topic}; topics with scans: {topics}")]
    NoTopic {
        /// The laser.
        laser: String,
        /// Its topic.
        topic: String,
        /// What is there.
        topics: String,
    },
    /// Two lasers of one name, or of one topic.
    #[error("--laser: {0} is there twice, expected one topic for each laser")]
    Twice(String),
    /// The selection leaves nothing.
    #[error("no scan lies between --from-s and --to-s: the recording spans {span_s:.3} s")]
    Nothing {
        /// Between its first and its last stamp.
        span_s: f64,
    },
}

/// Runs a verb of `tog bag`.
pub fn run(arguments: &Bag) -> ExitCode {
    let result = match &arguments.verb {
        BagVerb::Record(arguments) => return record::run(arguments),
        BagVerb::Play(arguments) => return play::run(arguments),
        BagVerb::Recover(arguments) => return recover::run(arguments),
        BagVerb::Info(arguments) => info::run(arguments),
        BagVerb::Import(arguments) => import::run(arguments),
        BagVerb::Export(arguments) => export::export(arguments),
        BagVerb::Convert(arguments) => export::convert(arguments),
    };
    match result {
        Ok(None) => ExitCode::from(exit::OK),
        Ok(Some(cut)) => fail(exit::FAILED, cut),
        Err(error) => fail(exit::FAILED, error),
    }
}

/// A bar over the bytes of a recording, on a terminal only.
fn progress_bar(what: &'static str, bytes: u64) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(bytes), ProgressDrawTarget::stderr());
    let template = "{prefix} [{wide_bar}] {decimal_bytes}/{decimal_total_bytes}, {eta} left";
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_prefix(what);
    bar
}
