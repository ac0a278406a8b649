//! `tog certs`: the authority of a site and the certificates of its hosts.

pub mod cli;

use crate::cli::Format;
use crate::operate::{base_dir, write_out};
use crate::{fail, site_file};
use bridge::access::identity;
use certificates::{Certificate, Files, Problem, examine::date};
use cli::{Certs, Init, Issue, Show, Verb};
use process::{exit, wall_ns};
use protocol::site::{Host, Site};
use protocol::time::SECOND_NS;
use serde_json::json;
use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;

/// `tog certs`.
pub fn main(arguments: &Certs) -> ExitCode {
    match &arguments.verb {
        Verb::Init(arguments) => init(arguments),
        Verb::Issue(arguments) => issue(arguments),
        Verb::Show(arguments) => show(arguments),
    }
}

/// UNIX seconds.
pub fn now_s() -> i64 {
    (wall_ns() / SECOND_NS) as i64
}

/// The certificate by which the host proves who it is; none if its site wants no proof.
///
/// # Errors
/// Everything that is wrong with its files, each with what to do.
pub fn check(
    site: &Site,
    host: Option<&str>,
    site_file: &Path,
) -> Result<Option<Certificate>, Vec<Problem>> {
    let Some(host) = host.and_then(|id| site.host(id)) else { return Ok(None) };
    if !(site.has_bridges() && site.uses_tls()) {
        return Ok(None);
    }
    let files = Files::of(&base_dir(site_file).join(&site.tls_dir), &host.id);
    certificates::examine(&files, &identity(site, host), now_s()).map(Some)
}

fn init(arguments: &Init) -> ExitCode {
    let site = match site_file::load(&arguments.site) {
        Ok(site) => site,
        Err(error) => return fail(exit::BAD_CONFIG, error),
    };
    match certificates::init(&arguments.ca, &site.name, now_s(), arguments.days) {
        Err(error) => fail(exit::FAILED, error),
        Ok(made) => {
            let text = format!(
                "{}: for every host\n{}: for nobody; keep it where no host is\n",
                made.certificate.display(),
                made.key.display()
            );
            write_out(&text, exit::OK)
        }
    }
}

fn issue(arguments: &Issue) -> ExitCode {
    let site = match site_file::load(&arguments.site) {
        Ok(site) => site,
        Err(error) => return fail(exit::BAD_CONFIG, error),
    };
    let hosts: Vec<&Host> = match &arguments.host {
        None => site.hosts.iter().collect(),
        Some(id) => site.host(id).into_iter().collect(),
    };
    if hosts.is_empty() {
        let ids: Vec<&str> = site.hosts.iter().map(|host| host.id.as_str()).collect();
        let found = arguments.host.as_deref().unwrap_or("no host");
        let text = format!("{found}: the hosts of the site {} are: {}", site.name, ids.join(", "));
        return fail(exit::USAGE, text);
    }
    let mut text = String::new();
    for host in hosts {
        let out = match arguments.host {
            Some(_) => arguments.out.clone(),
            None => arguments.out.join(&host.id),
        };
        let identity = identity(&site, host);
        match certificates::issue(&arguments.ca, &out, &identity, now_s(), arguments.days) {
            Err(error) => return fail(exit::FAILED, error),
            // Writing to a String cannot fail.
            Ok(made) => {
                let _ = writeln!(
                    text,
                    "host {} ({}): {}, {}, {}",
                    host.id,
                    identity.address,
                    made.certificate.display(),
                    made.key.display(),
                    made.ca.display()
                );
            }
        }
    }
    let _ = writeln!(text, "copy the three files of a host to {} on it", site.tls_dir);
    write_out(&text, exit::OK)
}

fn show(arguments: &Show) -> ExitCode {
    let (mut text, mut list, mut code) = (String::new(), Vec::new(), exit::OK);
    let now_s = now_s();
    for path in &arguments.files {
        let name = path.display().to_string();
        match certificates::read(path) {
            Err(problem) => {
                code = exit::FAILED;
                let _ = writeln!(text, "{problem}");
                list.push(json!({ "file": name, "error": problem.text }));
            }
            Ok(found) => {
                let days = found.days_left(now_s);
                let is_good = (found.not_before_s..=found.not_after_s).contains(&now_s);
                if !is_good {
                    code = exit::FAILED;
                }
                let good = if is_good { "good" } else { "NOT good today" };
                let names = found.names.join(", ");
                let of = if found.is_ca { "an authority" } else { names.as_str() };
                let _ = writeln!(
                    text,
                    "{name}: {}, {of}, signed by {}, {good}: {} to {} ({days} days left)",
                    found.common_name,
                    found.issuer,
                    date(found.not_before_s),
                    date(found.not_after_s)
                );
                list.push(json!({
                    "file": name, "certificate": found, "good": is_good, "days_left": days,
                }));
            }
        }
    }
    match arguments.format {
        Format::Text => write_out(&text, code),
        Format::Json => write_out(&format!("{:#}\n", json!(list)), code),
    }
}
