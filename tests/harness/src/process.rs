//! Processes and shared memory as the operating system sees them.

use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use std::fs;
use std::path::{Path, PathBuf};

/// Sends a signal to a process of ours; false if it is gone. The descriptor names one process for
/// good: an id that was given to a stranger meanwhile is seen by its program.
pub fn kill(pid: u32, signal: Signal) -> bool {
    let raw = Pid::from_raw(pid as i32).expect("a process id");
    let Ok(process) = pidfd_open(raw, PidfdFlags::empty()) else { return false };
    let is_tog = fs::read_link(format!("/proc/{pid}/exe")).is_ok_and(|exe| {
        // An older tog has its name as well, and a program that was written over says "(deleted)".
        let (found, ours) = (exe.file_name(), crate::binary());
        let ours = ours.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let is_ours = |name: &str| name.starts_with(&ours) || name.starts_with("tog");
        found.is_some_and(|name| is_ours(&name.to_string_lossy()))
    });
    is_tog && pidfd_send_signal(&process, signal).is_ok()
}

/// Living processes that serve the run directory.
pub fn processes_of(run_dir: &Path) -> Vec<u32> {
    let serves = |pid: &u32| {
        let line = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        let mut words = line.split(|&byte| byte == 0);
        words.any(|word| word == b"--instance")
            && words.next() == Some(run_dir.as_os_str().as_encoded_bytes())
    };
    let entries = fs::read_dir("/proc").unwrap().flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    pids.filter(serves).collect()
}

/// Memory of a process that is in use (VmRSS), kB; 0 if it is gone.
pub fn resident_kb(pid: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

/// Time of a processor that a process has used, user and system, seconds; 0 if it is gone.
pub fn cpu_s(pid: u32) -> f64 {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    // Behind the name in parentheses: utime and stime are the 12th and 13th (proc(5)), in 1/100 s.
    let fields = stat.rsplit_once(')').map_or("", |(_, rest)| rest).split_whitespace();
    let ticks: u64 = fields.skip(11).take(2).filter_map(|field| field.parse::<u64>().ok()).sum();
    ticks as f64 / 100.0
}

/// Files of shared memory whose names begin with `prefix`.
pub fn shared_memory(prefix: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir("/dev/shm").unwrap().flatten();
    let ours = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix));
    ours.map(|entry| entry.path()).collect()
}
