//! How a running site is: in a table, as a building, for programs, as it changes; and what it is made of.

pub mod cli;
mod graph;
mod hosts;
mod prometheus;
mod top;

use crate::operate::{journal_here, write_out};
use crate::{fail, site_file};
use cli::{Graph, Status, StatusFormat, Top};
use process::{Instance, exit};
use protocol::site::Site;
use std::io::Write as _;
use std::path::Path;
use std::process::ExitCode;
use supervisor::StatusReport;

/// The site file, and how the site is.
fn look(site_file: &Path) -> Result<(Site, StatusReport), ExitCode> {
    let site = site_file::load(site_file).map_err(|error| fail(exit::BAD_CONFIG, error))?;
    let report = supervisor::status(&site.name).map_err(|error| fail(exit::FAILED, error))?;
    Ok((site, report))
}

/// `tog status`. Exit code 1 if the site does not run, or something is wrong.
pub fn status(arguments: &Status) -> ExitCode {
    let (site, report) = match look(&arguments.site) {
        Ok(found) => found,
        // A scraper wants a number even then.
        Err(code) if arguments.format == StatusFormat::Prometheus => {
            write_out(prometheus::DOWN, exit::OK);
            return code;
        }
        Err(code) => return code,
    };
    let code = if report.is_healthy() { exit::OK } else { exit::FAILED };
    if instance_of(&report).is_some_and(|instance| instance.runs_another(&site)) {
        // Nobody may be there to read it any more.
        let _ = writeln!(
            std::io::stderr(),
            "tog: {} is not what runs: it was changed since the start of the site. Restart it to use it",
            arguments.site.display()
        );
    }
    let hosts = || hosts_of(&site, &report);
    let text = match arguments.format {
        StatusFormat::Prometheus => prometheus::text(&report),
        StatusFormat::Text if arguments.building => hosts::text(&hosts()),
        StatusFormat::Json if arguments.building => {
            format!("{:#}\n", hosts::json(&site, &hosts()))
        }
        StatusFormat::Text if arguments.verbose => report.table(),
        StatusFormat::Text => report.summary(),
        StatusFormat::Json => match report.json() {
            Ok(json) => format!("{json:#}\n"),
            Err(error) => return fail(exit::FAILED, error),
        },
    };
    write_out(&text, code)
}

/// What runs, which knows as which host it does.
pub fn instance_of(report: &StatusReport) -> Option<Instance> {
    Instance::load(Path::new(&report.run_dir)).ok()
}

/// All hosts, as the one that reports knows them; none for a site of one host.
fn hosts_of(site: &Site, report: &StatusReport) -> Vec<hosts::HostStatus> {
    let here = instance_of(report).and_then(|instance| instance.host);
    hosts::hosts(site, report, here.as_deref())
}

/// `tog graph`.
pub fn graph(arguments: &Graph) -> ExitCode {
    match site_file::load(&arguments.site) {
        Ok(site) => write_out(&graph::text(&site, arguments.format), exit::OK),
        Err(error) => fail(exit::BAD_CONFIG, error),
    }
}

/// `tog top`.
pub fn top(arguments: &Top) -> ExitCode {
    let site = match site_file::load(&arguments.site) {
        Ok(site) => site,
        Err(error) => return fail(exit::BAD_CONFIG, error),
    };
    match top::run(&site, &journal_here(&site, &arguments.site)) {
        Ok(()) => ExitCode::from(exit::OK),
        Err(error) => fail(exit::FAILED, format!("tog top needs a terminal: {error}")),
    }
}
