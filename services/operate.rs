//! Verbs of a site: run, alerts, check, schema.

use crate::cli::{AlertsList, AlertsWatch, Check, Format, Run};
use crate::site_file::SiteFileError;
use crate::{certs, fail, placement, site_file};
use process::instance::{default_run_root, run_dir_of};
use process::plan::Plan;
use process::{EventLoop, Instance, Role, exit};
use protocol::site::{Diagnostics, Site};
use serde_json::json;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Loads a site file, or says what is wrong with it and with which code to end.
fn load(path: &Path) -> Result<Site, ExitCode> {
    site_file::load(path).map_err(|error| fail(exit::BAD_CONFIG, error))
}

/// Where relative paths of the site file begin.
pub fn base_dir(site_file: &Path) -> PathBuf {
    let absolute = std::path::absolute(site_file).unwrap_or_else(|_| site_file.to_owned());
    absolute.parent().map(Path::to_owned).unwrap_or_default()
}

/// Where a site keeps the journal of a host.
fn journal(site: &Site, host: Option<&str>, site_file: &Path) -> PathBuf {
    site.state_dir_of(&base_dir(site_file), host).join(alerts::JOURNAL_FILE)
}

/// Where the journal of the site that runs here is.
pub fn journal_here(site: &Site, site_file: &Path) -> PathBuf {
    // Who runs knows for which host it does.
    Instance::load(&run_dir_of(&site.name, &default_run_root())).map_or_else(
        |_| journal(site, None, site_file),
        |instance| instance.state_dir.join(alerts::JOURNAL_FILE),
    )
}

/// `tog run`.
pub fn run(arguments: &Run) -> ExitCode {
    let site = match load(&arguments.site) {
        Ok(site) => site,
        Err(code) => return code,
    };
    if arguments.out.is_some() && !process::domain::is_lossless(&site) {
        let text = "--out needs a site whose lasers replay a recording with pace = \"lossless\": a \
                    live site has no end at which results could be complete";
        return fail(exit::USAGE, text);
    }
    let host = match placement::host_to_run(&site, arguments.host.as_deref()) {
        Ok(host) => host,
        Err(reason) => return fail(exit::USAGE, reason),
    };
    let replay_at_ns = match placement::replay_at_ns(&site, arguments.replay_at.as_deref()) {
        Ok(replay_at_ns) => replay_at_ns,
        Err(reason) => return fail(exit::USAGE, reason),
    };
    placement::warn_of_plain_tcp(&site);
    if let Err(problems) = certs::check(&site, host.as_deref(), &arguments.site) {
        let words: Vec<String> = problems.iter().map(|problem| format!("\n  {problem}")).collect();
        let text = format!("this host cannot prove who it is:{}", words.concat());
        return fail(exit::BAD_CONFIG, text);
    }
    let base_dir = base_dir(&arguments.site);
    let replay_start_ns = match laser::site::replay_begin_ns(&site, &base_dir) {
        Ok(begin_ns) => begin_ns,
        Err(error) => return fail(exit::BAD_CONFIG, error),
    };
    let out_dir = match arguments.out.as_ref().map(std::path::absolute).transpose() {
        Ok(out_dir) => out_dir,
        Err(error) => return fail(exit::USAGE, format!("--out: {error}")),
    };
    // Told here and at once: a mapper that cannot create it would be started again and again.
    if let Some(directory) = &out_dir
        && let Err(error) = std::fs::create_dir_all(directory)
    {
        let text = format!("cannot write the results to {}: {error}", directory.display());
        return fail(exit::FAILED, text);
    }
    let options = supervisor::Options {
        base_dir: base_dir.clone(),
        host,
        replay_at_ns,
        out_dir: out_dir.clone(),
        seconds: arguments.seconds.map(|seconds| seconds as f64),
        replay_start_ns,
        ..supervisor::Options::default()
    };
    let ended = supervisor::run(&site, &options);
    match out_dir {
        Some(out_dir) if ended == ExitCode::SUCCESS => {
            match crate::map::describe_results(&site, &base_dir, &out_dir) {
                Ok(()) => {
                    let _ = writeln!(std::io::stderr(), "results: {}", out_dir.display());
                    ended
                }
                Err(error) => fail(exit::FAILED, error),
            }
        }
        _ => ended,
    }
}

/// `tog alerts list`.
pub fn alerts_list(arguments: &AlertsList) -> ExitCode {
    let site = match load(&arguments.site) {
        Ok(site) => site,
        Err(code) => return code,
    };
    let host = match placement::host_to_ask(&site, arguments.host.as_deref()) {
        Ok(host) => host,
        Err(reason) => return fail(exit::USAGE, reason),
    };
    let options = alerts::ListOptions {
        journal: journal(&site, host, &arguments.site),
        timezone: site.timezone.clone(),
        filter: alerts::Filter {
            area: arguments.area.clone(),
            open_only: arguments.open,
            limit: arguments.last,
            ..alerts::Filter::default()
        },
        format: alerts_format(arguments.format),
    };
    match alerts::list(&options, &mut std::io::stdout().lock()) {
        Ok(()) => ExitCode::from(exit::OK),
        Err(error) => fail(exit::FAILED, error),
    }
}

/// `tog alerts watch`.
pub fn alerts_watch(arguments: &AlertsWatch) -> ExitCode {
    let site = match load(&arguments.site) {
        Ok(site) => site,
        Err(code) => return code,
    };
    let run_dir = run_dir_of(&site.name, &default_run_root());
    let journal = journal_here(&site, &arguments.site);
    let options = alerts::WatchOptions {
        site: site.name.clone(),
        journal,
        socket: run_dir.join(alerts::SOCKET_FILE),
        timezone: site.timezone.clone(),
        format: alerts_format(arguments.format),
        after: arguments.from_start.then_some(0),
    };
    let watched = EventLoop::new().map_err(alerts::WatchError::Io).and_then(|events| {
        let (mut out, mut notes) = (std::io::stdout().lock(), std::io::stderr().lock());
        alerts::watch(&options, &events, &mut out, &mut notes)
    });
    match watched {
        Ok(()) => ExitCode::from(exit::OK),
        Err(error) => fail(exit::FAILED, error),
    }
}

fn alerts_format(format: Format) -> alerts::Format {
    match format {
        Format::Text => alerts::Format::Text,
        Format::Json => alerts::Format::Json,
    }
}

/// `tog check`.
pub fn check(arguments: &Check) -> ExitCode {
    let (site, text) = match site_file::load_with_text(&arguments.site) {
        Ok(loaded) => loaded,
        Err(error) => return refuse(arguments, error),
    };
    let mut remarks = crate::check::sources(&site, &arguments.site);
    let costs = placement::Costs::of(&site, &base_dir(&arguments.site));
    remarks.extend(placement::remarks(&site, &costs));
    let name = arguments.site.display().to_string();
    let remarks = Diagnostics::of_remarks(&text, &name, &remarks);
    if remarks.has_errors() {
        return refuse(arguments, SiteFileError::Wrong(remarks));
    }
    // What looks like a mistake goes to stderr, as the warnings of the site file do.
    let _ = write!(std::io::stderr(), "{remarks}");
    if !site.hosts.is_empty() {
        placement::warn_of_plain_tcp(&site);
        return write_out(&placement::plan(&site, &costs, arguments.format), exit::OK);
    }
    let (plan, roles) = (Plan::new(&site, None), Role::all(&site, None));
    let text = match arguments.format {
        Format::Text => plan_text(&site, &plan, &roles),
        Format::Json => {
            let topic = |topic: &process::plan::TopicPlan| {
                json!({
                    "name": topic.name,
                    "publishers": topic.publishers,
                    "buffer": topic.buffer,
                    "bytes_max": topic.bytes_max(),
                })
            };
            let report = json!({
                "site": site.name,
                "processes": roles.iter().map(Role::to_string).collect::<Vec<_>>(),
                "topics": plan.topics.iter().map(topic).collect::<Vec<_>>(),
                "shared_memory_bytes_max": plan.bytes_max(),
            });
            format!("{report:#}\n")
        }
    };
    write_out(&text, exit::OK)
}

/// Tells what is wrong: drawn on stderr, or for programs on stdout, every item with its `line`,
/// `column` and `message`.
fn refuse(arguments: &Check, error: SiteFileError) -> ExitCode {
    let json = match (arguments.format, &error) {
        (Format::Text, _) => return fail(exit::BAD_CONFIG, error),
        (Format::Json, SiteFileError::Wrong(diagnostics)) => json!(diagnostics),
        (Format::Json, SiteFileError::Read { path, .. }) => json!({
            "file_name": path.display().to_string(),
            "items": [{ "severity": "error", "line": 0, "column": 0, "message": error.to_string() }],
            "omitted": 0,
        }),
    };
    write_out(&format!("{json:#}\n"), exit::BAD_CONFIG)
}

fn plan_text(site: &Site, plan: &Plan, roles: &[Role]) -> String {
    let mut lines =
        vec![format!("{}: right. `tog run` would start {} processes:", site.name, roles.len())];
    lines.extend(roles.iter().map(|role| format!("  {role}")));
    lines.push(format!("{} topics in shared memory, in the worst case:", plan.topics.len()));
    lines.extend(plan.topics.iter().map(|topic| {
        let megabytes = topic.bytes_max() as f64 / 1e6;
        let plural = if topic.publishers == 1 { "" } else { "s" };
        format!("  {:<24} {megabytes:>9.1} MB, {} publisher{plural}", topic.name, topic.publishers)
    }));
    lines.push(format!("  {:<24} {:>9.1} MB\n", "all", plan.bytes_max() as f64 / 1e6));
    lines.join("\n")
}

/// `tog schema`.
pub fn schema() -> ExitCode {
    write_out(&format!("{:#}\n", Site::json_schema()), exit::OK)
}

/// Writes to stdout and ends with `code`. A reader that goes away (`| head`) is no error.
pub fn write_out(text: &str, code: u8) -> ExitCode {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            fail(exit::FAILED, format_args!("cannot write the output: {error}"))
        }
        _ => ExitCode::from(code),
    }
}
