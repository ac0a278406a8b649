//! Processes and shared memory as the operating system sees them.

use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use std::fs;
use std::path::{Path, PathBuf};

/// Sends a signal to a process of ours; false if it is gone. The descriptor names one process for
/// good: an id that was given to a stranger meanwhile is seen by its program.
pub fn kill(pid: u32, signal: Signal) -> bool {
    let raw = Pid::from_raw(pid as i32).expect("a process id");
    let Ok(process) = pidfd_open(raw, PidfdFlags::empty()) else { return false };
    let is_tog = fs::read_link(format!("/proc/{pid}/exe"))
        .is_ok_and(|exe| exe.as_os_str().to_string_lossy().starts_with(env!("CARGO_BIN_EXE_tog")));
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

/// Files of shared memory whose names begin with `prefix`.
pub fn shared_memory(prefix: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir("/dev/shm").unwrap().flatten();
    let ours = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix));
    ours.map(|entry| entry.path()).collect()
}
