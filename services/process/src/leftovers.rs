//! What a killed run left: its files, its shared memory, its processes. Only the owner, who holds the
//! lock, may clear it away.

use crate::instance::Instance;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use std::ffi::OsString;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

/// Where shared-memory objects of Linux are files.
pub(crate) const SHARED_MEMORY_DIR: &str = "/dev/shm";
/// How long a process that was sent SIGKILL may take to vanish.
const KILL_PATIENCE: Timespec = Timespec { tv_sec: 2, tv_nsec: 0 };
/// More lines than a host has processes; what is behind them is ignored.
const CHILDREN_MAX: usize = 4096;

/// Removes everything of this instance but the lock.
pub(crate) fn wipe(instance: &Instance) {
    let _ = fs::remove_dir_all(instance.iceoryx_root());
    for entry in fs::read_dir(&instance.run_dir).into_iter().flatten().flatten() {
        if entry.file_name() != "lock" {
            let _ = fs::remove_file(entry.path());
        }
    }
    for path in shared_memory_of(&instance.prefix) {
        let _ = fs::remove_file(path);
    }
}

/// The files in shared memory whose names begin with the prefix of an instance.
pub(crate) fn shared_memory_of(prefix: &str) -> impl Iterator<Item = PathBuf> {
    let entries = fs::read_dir(SHARED_MEMORY_DIR).into_iter().flatten().flatten();
    let ours = |name: OsString| name.as_encoded_bytes().starts_with(prefix.as_bytes());
    entries.filter(move |entry| ours(entry.file_name())).map(|entry| entry.path())
}

/// Writes down which processes belong to the run: id and start time, because ids are used again.
pub(crate) fn record_children(path: &Path, pids: impl Iterator<Item = u32>) -> std::io::Result<()> {
    let mut text = String::new();
    for pid in pids {
        if let Some(started) = start_time(pid) {
            let _ = writeln!(text, "{pid} {started}");
        }
    }
    let unfinished = path.with_extension("unfinished");
    fs::write(&unfinished, text)?;
    fs::rename(unfinished, path)
}

/// Kills the processes that a killed owner wrote down and that still live: stopped or stuck ones,
/// because the others stop by themselves when their owner dies. Returns how many it were.
pub(crate) fn kill_recorded(path: &Path) -> usize {
    let text = fs::read_to_string(path).unwrap_or_default();
    let mut killed = 0;
    for line in text.lines().take(CHILDREN_MAX) {
        let mut words = line.split(' ').map(str::parse::<u64>);
        let (Some(Ok(pid)), Some(Ok(started))) = (words.next(), words.next()) else { continue };
        let Ok(raw) = i32::try_from(pid) else { continue };
        let Some(pid) = Pid::from_raw(raw) else { continue };
        let Ok(process) = pidfd_open(pid, PidfdFlags::empty()) else { continue };
        // The descriptor names one process for good: if it has the start time now, it is the one.
        if start_time(raw as u32) == Some(started)
            && pidfd_send_signal(&process, Signal::KILL).is_ok()
        {
            let _ = poll(&mut [PollFd::new(&process, PollFlags::IN)], Some(&KILL_PATIENCE));
            killed += 1;
        }
    }
    killed
}

/// When a process started, in clock ticks since boot: field 22 of /proc/PID/stat, counted behind the
/// name in brackets, which may hold anything.
fn start_time(pid: u32) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    stat.rsplit_once(')')?.1.split_whitespace().nth(19)?.parse().ok()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use std::process::Command;

    #[test]
    fn a_stopped_child_of_a_dead_owner_is_killed_and_a_stranger_is_not() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("children");
        let sleep = || Command::new("sleep").arg("1000").spawn().unwrap();
        let (mut ours, mut stranger) = (sleep(), sleep());
        rustix::process::kill_process(Pid::from_child(&ours), Signal::STOP).unwrap();
        record_children(&path, [ours.id(), stranger.id()].into_iter()).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        let reused = text.lines().nth(1).unwrap();
        let (pid, _) = reused.split_once(' ').unwrap();
        fs::write(&path, text.replace(reused, &format!("{pid} 1"))).unwrap();
        assert_eq!(kill_recorded(&path), 1);
        assert!(!ours.wait().unwrap().success());
        assert!(stranger.try_wait().unwrap().is_none(), "its id was used again by somebody else");
        stranger.kill().unwrap();
        stranger.wait().unwrap();
    }
}
