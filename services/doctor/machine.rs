//! What can be seen without a running site.

use super::{Check, Patient, State};
use crate::certs;
use process::instance::RUN_DIR_BYTES_MAX;
use process::plan::Plan;
use protocol::site::Host;
use std::fs;
use std::io::ErrorKind;
use std::net::{TcpListener, TcpStream, ToSocketAddrs};
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

/// Less free space than this fills up within days.
const DISK_FREE_MIN: u64 = 1 << 30;
/// A host that does not answer by then is not there.
const PEER_TIMEOUT: Duration = Duration::from_secs(2);
/// System users; logind removes the shared memory of others when they log out.
const SYSTEM_UID_MAX: u32 = 999;

pub(super) fn checks(patient: &Patient<'_>) -> Vec<Check> {
    let mut checks =
        vec![run_directory(patient), shared_memory(patient), state(patient), logout(), clock()];
    if let Some(host) = patient.host.filter(|_| patient.site.has_bridges()) {
        checks.push(certificates(patient, host));
        if host.through.is_empty() {
            checks.push(port(patient, host));
        }
        // Nobody listens at a client.
        let others = patient.site.hosts.iter().filter(|other| other.through.is_empty());
        checks.extend(others.filter(|other| host.has_link_to(other)).map(peer));
    }
    checks
}

fn run_directory(patient: &Patient<'_>) -> Check {
    let (name, path) = ("run directory", &patient.run_dir);
    let shown = path.display();
    let length = path.as_os_str().len();
    if length > RUN_DIR_BYTES_MAX {
        let found = format!("{shown} has {length} bytes, at most {RUN_DIR_BYTES_MAX} are possible");
        return Check::new(name, State::Fail, found, "set TOG_RUN_DIR to a shorter one");
    }
    let own = rustix::process::geteuid().as_raw();
    let nearest = path.ancestors().find_map(|at| Some((at, fs::symlink_metadata(at).ok()?)));
    let Some((at, found)) = nearest else {
        return Check::new(name, State::Unknown, format!("{shown} cannot be looked at"), "");
    };
    let is_ours = at.starts_with(&patient.run_root);
    if is_ours && found.uid() != own {
        let owner = found.uid();
        let found = format!("{} belongs to user id {owner}, this is user id {own}", at.display());
        if own == 0 {
            let help = format!(
                "what is said of the run directory, memory, state and logout is said of root: \
                 `sudo -u '#{owner}' tog doctor ..` says it of the user that runs the site"
            );
            return Check::new(name, State::Warn, found, help);
        }
        let help = format!(
            "processes share memory only within one user: ask and run as that one, `sudo -u '#{owner}' tog ..`"
        );
        return Check::new(name, State::Fail, found, help);
    }
    let aged = ["/tmp", "/var/tmp"].iter().any(|aged| path.starts_with(aged));
    if aged {
        let found = format!("{shown}: files there are removed after some days");
        let help = "make /run/tog for this user, or set TOG_RUN_DIR (systemd's unit does)";
        return Check::new(name, State::Warn, found, help);
    }
    Check::ok(name, shown.to_string())
}

fn free_bytes(path: &Path) -> Option<u64> {
    let at = path.ancestors().find(|at| at.exists())?;
    let disk = rustix::fs::statvfs(at).ok()?;
    Some(disk.f_bavail.saturating_mul(disk.f_frsize))
}

fn shared_memory(patient: &Patient<'_>) -> Check {
    let name = "shared memory";
    let needed = Plan::new(patient.site, patient.host.map(|host| host.id.as_str())).bytes_max();
    let Some(free) = free_bytes(Path::new("/dev/shm")) else {
        let help = "mount a tmpfs there: processes of a host talk through it";
        return Check::new(name, State::Fail, "there is no /dev/shm", help);
    };
    let (needed_mb, free_mb) = (needed as f64 / 1e6, free as f64 / 1e6);
    let found = format!("{free_mb:.0} MB are free, the site takes {needed_mb:.0} MB at most");
    if needed > free && !patient.run_dir.join("instance.json").exists() {
        let help = "make /dev/shm larger (docker: --ipc=host or --shm-size)";
        return Check::new(name, State::Fail, found, help);
    }
    Check::ok(name, found)
}

fn state(patient: &Patient<'_>) -> Check {
    let (name, path) = ("state directory", &patient.state_dir);
    let Some(at) = path.ancestors().find(|at| at.exists()) else {
        return Check::new(name, State::Fail, format!("{} cannot be", path.display()), "");
    };
    if rustix::fs::access(at, rustix::fs::Access::WRITE_OK).is_err() {
        let found = format!("this user may not write to {}", at.display());
        return Check::new(name, State::Fail, found, "give it the right to, or set `state_dir`");
    }
    let free = free_bytes(path).unwrap_or(0);
    let found = format!("{}, {:.1} GB free", path.display(), free as f64 / 1e9);
    if free < DISK_FREE_MIN {
        return Check::new(name, State::Warn, found, "free space: journals and maps grow");
    }
    Check::ok(name, found)
}

/// logind removes the shared memory of a person who logs out, unless it is told not to.
fn logout() -> Check {
    let (name, uid) = ("logout", rustix::process::geteuid().as_raw());
    if uid <= SYSTEM_UID_MAX {
        return Check::ok(name, format!("user id {uid} is a system user: nothing is removed"));
    }
    let configured = fs::read_to_string("/etc/systemd/logind.conf").unwrap_or_default();
    let keeps = configured.lines().any(|line| line.trim() == "RemoveIPC=no");
    if keeps || !Path::new("/run/systemd/system").exists() {
        return Check::ok(name, "shared memory stays when this user logs out");
    }
    let found = "when this user logs out, logind removes the shared memory of a running site";
    let help = "run as a system user (systemd's unit does), or set RemoveIPC=no in logind.conf";
    Check::new(name, State::Warn, found, help)
}

fn clock() -> Check {
    let name = "clock";
    let run = |program: &str, arguments: &[&str]| {
        let output = Command::new(program).args(arguments).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
    };
    if let Some(line) = run("chronyc", &["-c", "tracking"]) {
        return chrony(&line);
    }
    match run("timedatectl", &["show", "-p", "NTPSynchronized", "--value"]).as_deref() {
        Some("yes\n") => Check::ok(name, "synchronised (timedatectl)"),
        Some("no\n") => Check::new(
            name,
            State::Fail,
            "not synchronised (timedatectl)",
            "install chrony: hosts stamp scans by their clocks, which must agree",
        ),
        _ => Check::new(
            name,
            State::Unknown,
            "neither chronyc nor timedatectl answers",
            "see to it that something keeps the clock; bridges say `clock_differs` if it is off",
        ),
    }
}

/// A line of `chronyc -c tracking`: the 2nd field names the source, the 5th is the offset in seconds.
fn chrony(line: &str) -> Check {
    let name = "clock";
    let fields: Vec<&str> = line.trim().split(',').collect();
    let offset_s = fields.get(4).and_then(|field| field.parse::<f64>().ok());
    match (fields.get(1), offset_s) {
        (Some(source), Some(offset_s)) if !source.is_empty() && offset_s.abs() < 0.05 => {
            Check::ok(name, format!("{:.1} ms off {source} (chrony)", offset_s * 1e3))
        }
        (Some(source), Some(offset_s)) => Check::new(
            name,
            State::Fail,
            format!("{offset_s:.3} s off {source:?} (chrony)"),
            "`chronyc sources`: it needs a server that it can reach",
        ),
        _ => Check::new(name, State::Unknown, "chronyc says nothing that is understood", ""),
    }
}

fn certificates(patient: &Patient<'_>, host: &Host) -> Check {
    let name = "certificates";
    if !patient.site.uses_tls() {
        let found = "plain-tcp: whoever reaches the network can read and speak as any host";
        return Check::new(name, State::Warn, found, "transport = \"tls\" and `tog certs --help`");
    }
    match certs::check(patient.site, Some(&host.id), &patient.site_file) {
        Ok(None) => Check::ok(name, "not needed"),
        Ok(Some(found)) => {
            let now_s = certs::now_s();
            let days = found.days_left(now_s);
            let text = format!("{}, {days} days left", found.common_name);
            match found.expires_soon(now_s) {
                Some(help) => Check::new(name, State::Warn, text, help),
                None => Check::ok(name, text),
            }
        }
        Err(problems) => {
            let words: Vec<String> = problems.iter().map(ToString::to_string).collect();
            Check::new(name, State::Fail, words.join("; "), "") // each says what to do
        }
    }
}

fn port(patient: &Patient<'_>, host: &Host) -> Check {
    let (name, endpoint) = ("port", &host.endpoint);
    match TcpListener::bind(endpoint.as_str()) {
        Ok(_) => Check::ok(name, format!("{endpoint} is free")),
        Err(error) if error.kind() == ErrorKind::AddrInUse => {
            let found = format!("{endpoint} is taken");
            if supervisor::status(&patient.site.name).is_ok() {
                return Check::ok(name, format!("{found}, by the site that runs here"));
            }
            let help = format!("another program listens there: `ss -ltnp | grep {endpoint}`");
            Check::new(name, State::Fail, found, help)
        }
        Err(error) => {
            let found = format!("cannot listen on {endpoint}: {error}");
            let help = format!("is this host {}? `ip address` shows its addresses", host.id);
            Check::new(name, State::Fail, found, help)
        }
    }
}

fn peer(host: &Host) -> Check {
    let (name, endpoint) = (format!("host {}", host.id), &host.endpoint);
    let addresses = match endpoint.to_socket_addrs() {
        Ok(addresses) => addresses,
        Err(error) => {
            let found = format!("{endpoint}: {error}");
            return Check::new(&name, State::Fail, found, "its name is not known here");
        }
    };
    let mut error = None;
    for address in addresses {
        match TcpStream::connect_timeout(&address, PEER_TIMEOUT) {
            Ok(_) => return Check::ok(&name, format!("{endpoint} answers")),
            Err(found) => error = Some(found),
        }
    }
    let why = error.map_or("no address".to_owned(), |error| error.to_string());
    let found = format!("{endpoint} does not answer ({why})");
    let help = format!("is `tog run --host {}` running there, and no firewall between?", host.id);
    Check::new(&name, State::Warn, found, help)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_chrony_says_is_understood() {
        let line = "C0A80101,192.168.1.1,3,1795000000.123,-0.000012,0.00002,0.00003,1.2,0.0,0.1,0.002,0.001,64.2,Normal\n";
        assert_eq!(chrony(line).state, State::Ok);
        assert_eq!(chrony(&line.replace("-0.000012", "3.5")).state, State::Fail);
        assert_eq!(chrony("7F7F0101,,0,0,0.0").state, State::Fail, "no source");
        assert_eq!(chrony("506 Cannot talk to daemon").state, State::Unknown);
    }
}
