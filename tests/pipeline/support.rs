//! Runs the real binary under a watchdog, and reads what it wrote.

use rustix::process::{Pid, Signal, kill_process};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::mpsc;
use std::time::Duration;
use tempfile::TempDir;

/// Nothing here takes longer, even on a busy machine; what does is taken for a hang.
const WATCHDOG: Duration = Duration::from_secs(240);
/// How long a hanging process has to end after SIGTERM, before SIGKILL.
const GRACE: Duration = Duration::from_secs(20);

/// How a run of the binary ended.
pub struct Ended {
    /// Exit code; a signal is told as 128 + its number, as a shell does.
    pub code: i32,
    /// Standard output.
    pub out: String,
    /// Standard error.
    pub err: String,
}

impl Ended {
    /// Everything that it said.
    pub fn said(&self) -> String {
        format!("{}{}", self.out, self.err)
    }

    /// Panics with all that was said unless the exit code is `code` and every word is there.
    #[track_caller]
    pub fn expect(&self, code: i32, words: &[&str]) -> &Self {
        let said = self.said();
        assert_eq!(self.code, code, "exit code; it said:\n{said}");
        for word in words {
            assert!(said.contains(word), "expected {word:?} in what it said:\n{said}");
        }
        assert!(!said.contains("panicked at"), "a panic:\n{said}");
        self
    }
}

/// A directory that is gone at the end of the test, with a path short enough for unix sockets.
pub fn scratch() -> TempDir {
    tempfile::Builder::new().prefix("tog-").tempdir_in("/tmp").unwrap()
}

/// Runs `tog` with an instance root of its own in `scratch`.
pub fn tog<A: AsRef<OsStr>>(scratch: &TempDir, arguments: impl IntoIterator<Item = A>) -> Ended {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tog"));
    command.args(arguments).env("TOG_RUN_DIR", scratch.path().join("r")).env_remove("RUST_LOG");
    command.current_dir(scratch.path());
    watched(command)
}

/// Runs a command to its end. A hang is a failure that shows what was said.
pub fn watched(mut command: Command) -> Ended {
    let child = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let pid = Pid::from_child(&child);
    let (tell, told) = mpsc::channel();
    std::thread::spawn(move || tell.send(child.wait_with_output()));
    if let Ok(output) = told.recv_timeout(WATCHDOG) {
        return ended(output.unwrap());
    }
    // Ours and not yet waited for, so the id is still its own.
    let _ = kill_process(pid, Signal::TERM);
    let output = told.recv_timeout(GRACE).or_else(|_| {
        let _ = kill_process(pid, Signal::KILL);
        told.recv_timeout(GRACE)
    });
    let said = output.map(|output| ended(output.unwrap()).said());
    panic!(
        "{command:?} hangs: not over after {WATCHDOG:?}; it said:\n{}",
        said.unwrap_or_default()
    );
}

fn ended(output: Output) -> Ended {
    use std::os::unix::process::ExitStatusExt;
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    let signal = || 128 + output.status.signal().unwrap_or_default();
    let code = output.status.code().unwrap_or_else(signal);
    Ended { code, out: text(output.stdout), err: text(output.stderr) }
}

/// A real recording, which is not part of the repository; none where it is absent.
pub fn shared(file: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/recordings").join(file);
    if !path.exists() {
        println!("skipped: {} is not there", path.display());
        return None;
    }
    Some(path.canonicalize().unwrap())
}

/// The names of all files below a directory, relative, in order.
pub fn files(directory: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut open = vec![directory.to_owned()];
    while let Some(next) = open.pop() {
        for entry in std::fs::read_dir(&next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                found.push(path.strip_prefix(directory).unwrap().to_owned());
            }
        }
    }
    found.sort();
    found
}

/// An array as NumPy stores it.
pub struct Npy {
    /// Type: `|u1`, `<u8`, `<f8`.
    pub descr: String,
    /// Shape.
    pub shape: Vec<usize>,
    /// The numbers, little endian.
    pub bytes: Vec<u8>,
}

impl Npy {
    /// Reads a file of format version 1.0.
    #[track_caller]
    pub fn read(path: &Path) -> Self {
        let file = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        assert_eq!(file[..8], *b"\x93NUMPY\x01\x00", "{}", path.display());
        let end = 10 + usize::from(u16::from_le_bytes([file[8], file[9]]));
        let header = std::str::from_utf8(&file[10..end]).unwrap();
        let between = |from: &str, to: &str| {
            let rest = &header[header.find(from).unwrap() + from.len()..];
            rest[..rest.find(to).unwrap()].to_owned()
        };
        let shape = between("'shape': (", ")");
        let sides = shape.split(',').map(str::trim).filter(|side| !side.is_empty());
        let npy = Self {
            descr: between("'descr': '", "'"),
            shape: sides.map(|side| side.parse().unwrap()).collect(),
            bytes: file[end..].to_vec(),
        };
        let size: usize = npy.descr[2..].parse().unwrap();
        assert_eq!(npy.shape.iter().product::<usize>() * size, npy.bytes.len(), "{header}");
        npy
    }

    /// The numbers of an array of u64.
    pub fn u64s(&self) -> Vec<u64> {
        assert_eq!(self.descr, "<u8");
        let words = self.bytes.chunks_exact(8);
        words.map(|word| u64::from_le_bytes(word.try_into().unwrap())).collect()
    }
}
