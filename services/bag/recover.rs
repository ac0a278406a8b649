//! `tog bag recover`: a complete recording out of one that was cut.

use crate::cli::Format;
use crate::fail;
use clap::Args;
use indicatif::{DecimalBytes, ProgressBar, ProgressDrawTarget, ProgressStyle};
use process::exit;
use recording::{ACTIVE_SUFFIX, RecordingError, Recovered};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tog bag recover walk_0.mcap.active
  tog bag recover robot.mcap --out whole.mcap

Takes any MCAP file, whoever wrote it. Everything up to the last whole chunk is saved (of ours: up
to the last whole second); a chunk whose checksum is wrong is left out. The new file is read back
before it gets its name: x.mcap for x.mcap.active, x.recovered.mcap for x.mcap, unless --out says.
The original stays.
A running recorder needs no hand: what it finds of a killed one, it recovers when it starts.

Exit code 0: saved, with a warning if damaged parts were left out, or nothing was missing. 1: a file
could not be saved, or not one message of it.")]
/// Arguments of `tog bag recover`.
pub struct Recover {
    /// The recordings that were cut.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// The new file, if one recording is named; it must not exist.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Output.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

/// Why a recording is not recovered.
#[derive(Debug, thiserror::Error)]
enum RecoverError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error("{} exists: name another file with --out", .0.display())]
    Exists(PathBuf),
}

/// Runs `tog bag recover`.
pub fn run(arguments: &Recover) -> ExitCode {
    if arguments.out.is_some() && arguments.files.len() > 1 {
        return fail(exit::USAGE, "--out names one file: recover one recording at a time with it");
    }
    let (mut code, mut reports) = (exit::OK, Vec::new());
    for file in &arguments.files {
        let to = arguments.out.clone().unwrap_or_else(|| default_out(file));
        match recover(file, &to) {
            Ok(recovered) => {
                if recovered.facts.messages == 0 && recovered.chunks > 0 {
                    code = exit::FAILED;
                }
                match arguments.format {
                    Format::Text => eprintln!("tog: {}", words(file, &to, &recovered)),
                    Format::Json => reports.push(report(file, &to, &recovered)),
                }
            }
            Err(error) => {
                code = exit::FAILED;
                eprintln!("tog: {error}");
                reports.push(json!({ "file": file, "error": error.to_string() }));
            }
        }
    }
    match arguments.format {
        Format::Text => ExitCode::from(code),
        Format::Json => crate::operate::write_out(&format!("{:#}\n", json!(reports)), code),
    }
}

fn recover(file: &Path, to: &Path) -> Result<Recovered, RecoverError> {
    if to.exists() {
        return Err(RecoverError::Exists(to.to_owned()));
    }
    let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr());
    let template =
        "recovering {prefix} [{wide_bar}] {decimal_bytes}/{decimal_total_bytes}, {eta} left";
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_prefix(file.display().to_string());
    let recovered = recording::recover(file, to, |read, length| {
        bar.set_length(length);
        bar.set_position(read);
    });
    bar.finish_and_clear();
    Ok(recovered?)
}

/// `x.mcap` for `x.mcap.active`, `x.recovered.mcap` for all others.
fn default_out(file: &Path) -> PathBuf {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let complete = match name.strip_suffix(ACTIVE_SUFFIX) {
        Some(complete) => complete.to_owned(),
        None => format!("{}.recovered.mcap", name.strip_suffix(".mcap").unwrap_or(&name)),
    };
    file.with_file_name(complete)
}

fn words(file: &Path, to: &Path, recovered: &Recovered) -> String {
    let facts = &recovered.facts;
    let holds = match facts.messages {
        0 => "no message".to_owned(),
        messages => {
            let topics = facts.topics.iter().filter(|topic| topic.messages > 0).count();
            format!("{messages} messages of {topics} topics until {}", stamp(facts.last_ns))
        }
    };
    let file = file.display();
    if recovered.was_complete {
        return format!("{file}: is complete ({holds}), nothing to recover");
    }
    let lost = match recovered.bytes_lost {
        0 => String::new(),
        lost => format!("; the last {} are no whole chunk and are lost", DecimalBytes(lost)),
    };
    let damaged = match &recovered.first_damage {
        None => String::new(),
        Some(first) => format!(
            "\ntog: WARN {file}: {} damaged parts of {} were left out, the first {first}",
            recovered.damaged,
            DecimalBytes(recovered.bytes_damaged)
        ),
    };
    let (to, bytes) = (to.display(), DecimalBytes(facts.bytes));
    format!("{file}: saved {holds} into {to} ({bytes}){lost}{damaged}")
}

/// A log time as people read it.
fn stamp(ns: u64) -> String {
    jiff::Timestamp::from_nanosecond(i128::from(ns))
        .map_or_else(|_| format!("{ns} ns"), |stamp| stamp.to_string())
}

fn report(file: &Path, to: &Path, recovered: &Recovered) -> serde_json::Value {
    let facts = &recovered.facts;
    let topics: serde_json::Map<String, serde_json::Value> =
        facts.topics.iter().map(|topic| (topic.name.clone(), json!(topic.messages))).collect();
    json!({
        "file": file,
        "was_complete": recovered.was_complete,
        "out": (!recovered.was_complete).then_some(to),
        "messages": facts.messages,
        "first_ns": facts.first_ns,
        "last_ns": facts.last_ns,
        "topics": topics,
        "bytes_lost": recovered.bytes_lost,
        "damaged": recovered.damaged,
        "bytes_damaged": recovered.bytes_damaged,
        "first_damage": recovered.first_damage,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_new_file_lies_beside_the_old_one() {
        assert_eq!(default_out(Path::new("a/x_0.mcap.active")), Path::new("a/x_0.mcap"));
        assert_eq!(default_out(Path::new("a/x.mcap")), Path::new("a/x.recovered.mcap"));
        assert_eq!(default_out(Path::new("x")), Path::new("x.recovered.mcap"));
    }
}
