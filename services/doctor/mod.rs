//! `tog doctor`: is this machine fit for the site, and do the links of a running one carry data?

pub mod cli;
mod live;
mod machine;

use crate::cli::Format;
use crate::operate::{base_dir, write_out};
use crate::{fail, placement, site_file, status};
use cli::Doctor;
use process::exit;
use process::instance::{default_run_root, run_dir_of};
use protocol::site::{Host, Site};
use serde::Serialize;
use serde_json::json;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

/// How a check came out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum State {
    /// As it must be.
    Ok,
    /// It works today.
    Warn,
    /// It does not.
    Fail,
    /// It cannot be seen from here.
    Unknown,
}

/// One check.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
struct Check {
    name: String,
    state: State,
    /// What was found.
    found: String,
    /// What to do; empty if nothing.
    help: String,
}

impl Check {
    fn ok(name: &str, found: impl Into<String>) -> Self {
        Self::new(name, State::Ok, found, "")
    }

    fn new(name: &str, state: State, found: impl Into<String>, help: impl Into<String>) -> Self {
        Self { name: name.to_owned(), state, found: found.into(), help: help.into() }
    }
}

/// What is looked at.
struct Patient<'s> {
    site: &'s Site,
    site_file: PathBuf,
    host: Option<&'s Host>,
    run_root: PathBuf,
    run_dir: PathBuf,
    state_dir: PathBuf,
}

/// `tog doctor`.
pub fn main(arguments: &Doctor) -> ExitCode {
    let site = match site_file::load(&arguments.site) {
        Ok(site) => site,
        Err(error) => return fail(exit::BAD_CONFIG, error),
    };
    let run_root = default_run_root();
    let run_dir = run_dir_of(&site.name, &run_root);
    let runs = supervisor::status_in(&site.name, &run_root).ok();
    let instance = runs.as_ref().and_then(status::instance_of);
    let runs_as = instance.and_then(|instance| instance.host).filter(|id| site.host(id).is_some());
    let asked = arguments.host.clone().or_else(|| runs_as.clone());
    let host = match placement::host_to_run(&site, asked.as_deref()) {
        Ok(host) => host,
        Err(reason) => return fail(exit::USAGE, reason),
    };
    if let (Some(runs), Some(asked)) = (&runs_as, &host)
        && runs != asked
    {
        let text = format!(
            "host {runs} of {} runs here ({}): ask of that, or on the machine of host {asked}, or with \
             another TOG_RUN_DIR",
            site.name,
            run_dir.display()
        );
        return fail(exit::USAGE, text);
    }
    let patient = Patient {
        host: host.as_deref().and_then(|id| site.host(id)),
        site_file: arguments.site.clone(),
        run_dir,
        state_dir: site.state_dir_of(&base_dir(&arguments.site), host.as_deref()),
        run_root,
        site: &site,
    };
    let mut checks = machine::checks(&patient);
    checks.extend(live::checks(&patient));
    let failed = checks.iter().any(|check| check.state == State::Fail);
    let code = if failed { exit::FAILED } else { exit::OK };
    let text = match arguments.format {
        Format::Text => text(&checks),
        Format::Json => format!("{:#}\n", json!({ "ok": !failed, "checks": checks })),
    };
    write_out(&text, code)
}

fn text(checks: &[Check]) -> String {
    let mut text = String::new();
    let width = checks.iter().map(|check| check.name.len()).max().unwrap_or(0);
    for Check { name, state, found, help } in checks {
        let mark = match state {
            State::Ok => "ok  ",
            State::Warn => "warn",
            State::Fail => "FAIL",
            State::Unknown => "?   ",
        };
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{mark}  {name:width$}  {found}");
        if !help.is_empty() {
            let _ = writeln!(text, "      {:width$}  -> {help}", "");
        }
    }
    let count = |wanted| checks.iter().filter(|check| check.state == wanted).count();
    let (failed, warnings) = (count(State::Fail), count(State::Warn));
    let _ = writeln!(text, "{} checks, {failed} failed, {warnings} warnings", checks.len());
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_is_marked_and_what_to_do_is_below_it() {
        let checks = [
            Check::ok("disk", "12 GB free"),
            Check::new("clock", State::Fail, "3 s off", "start chrony"),
        ];
        let expected = "\
ok    disk   12 GB free
FAIL  clock  3 s off
             -> start chrony
2 checks, 1 failed, 0 warnings
";
        assert_eq!(text(&checks), expected);
    }
}
