//! An instance: one running site on one host. Its run directory tells every process all it needs.
//!
//! ```text
//! <root>/<site>/            mode 0700
//!   lock                    flock held by the owner (the supervisor) for as long as it lives
//!   instance.json           this struct
//!   site.json               the site, as the supervisor read and checked it
//!   iceoryx2.toml, x/       shared-memory configuration and registry
//!   control.sock            the supervisor's status socket
//!   children                process ids, so that a later owner finds what a killed one left
//! ```

use crate::clock::Clock;
use protocol::site::Site;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::Write;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

/// Largest instance or site file that is read: a site of hundreds of areas is far below 1 MiB.
const FILE_BYTES_MAX: u64 = 16 << 20;

/// Why a run directory cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum InstanceError {
    /// A file or directory.
    #[error("cannot {action} {path}: {source}")]
    Io {
        /// What was tried.
        action: &'static str,
        /// Where.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A file is not what it should be.
    #[error("{path} is damaged: {reason}; stop the site and start it again with `tog run`")]
    Damaged {
        /// Which file.
        path: PathBuf,
        /// What was found.
        reason: String,
    },
    /// Nothing runs there.
    #[error("no site runs in {path}: start it with `tog run`")]
    NotRunning {
        /// The run directory.
        path: PathBuf,
    },
    /// The directory belongs to somebody else.
    #[error(
        "{path} belongs to user id {found}, expected {expected}: remove it, or set TOG_RUN_DIR"
    )]
    Foreign {
        /// The directory.
        path: PathBuf,
        /// Its owner.
        found: u32,
        /// Who we are.
        expected: u32,
    },
    /// Paths of sockets are limited by the system.
    #[error(
        "the run directory {path} is {found} bytes long, at most {} are possible: \
         set TOG_RUN_DIR to a shorter one",
        RUN_DIR_BYTES_MAX
    )]
    TooLong {
        /// The directory.
        path: PathBuf,
        /// Its length.
        found: usize,
    },
}

/// Longest run directory: a unix socket's path has 107 bytes, and iceoryx2 puts
/// `/x/<prefix of 16><id of up to 34 digits>.event` behind it.
pub const RUN_DIR_BYTES_MAX: usize = 107 - 3 - 16 - 34 - 6;

/// What a process is handed: everything that is decided once for all processes of a running site.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Instance {
    /// The site's name.
    pub site_name: String,
    /// Which host of the site this is; none for a site without hosts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub host: Option<String>,
    /// The run directory.
    pub run_dir: PathBuf,
    /// First part of the names of all our files in shared memory.
    pub prefix: String,
    /// Where relative paths of the site file begin.
    pub base_dir: PathBuf,
    /// Checkpoints, learnt maps, journal; absolute.
    pub state_dir: PathBuf,
    /// Where results go if somebody asked for them (`--out`); absolute.
    pub out_dir: Option<PathBuf>,
    /// Site time.
    pub clock: Clock,
    /// True if lasers replay as fast as the slowest reader, without losing a scan.
    pub lossless: bool,
    /// Process id of the owner.
    pub owner_pid: u32,
    /// Names this run: UNIX nanoseconds of its start.
    pub started_ns: u64,
    /// CLOCK_MONOTONIC at that moment, nanoseconds.
    pub started_mono_ns: u64,
}

impl Instance {
    /// Reads the instance of a run directory.
    ///
    /// # Errors
    /// If it is missing, too large or damaged.
    pub fn load(run_dir: &Path) -> Result<Self, InstanceError> {
        let path = run_dir.join("instance.json");
        if !path.exists() {
            return Err(InstanceError::NotRunning { path: run_dir.to_path_buf() });
        }
        read_json(&path)
    }

    /// The site, as the owner checked it.
    ///
    /// # Errors
    /// If the file is missing, too large or damaged.
    pub fn site(&self) -> Result<Site, InstanceError> {
        read_json(&self.site_path())
    }

    /// A path of the site file: relative ones begin at the site file's directory.
    #[must_use]
    pub fn resolve(&self, path: impl AsRef<Path>) -> PathBuf {
        self.base_dir.join(path)
    }

    /// The supervisor's status socket.
    #[must_use]
    pub fn control_socket(&self) -> PathBuf {
        self.run_dir.join("control.sock")
    }

    /// The lock that the owner holds.
    #[must_use]
    pub fn lock_file(&self) -> PathBuf {
        self.run_dir.join("lock")
    }

    pub(crate) fn iceoryx_config(&self) -> PathBuf {
        self.run_dir.join("iceoryx2.toml")
    }

    pub(crate) fn children_file(&self) -> PathBuf {
        self.run_dir.join("children")
    }

    pub(crate) fn iceoryx_root(&self) -> PathBuf {
        self.run_dir.join("x")
    }

    /// True if the site that runs is not this one: its file was changed since it was started.
    #[must_use]
    pub fn runs_another(&self, site: &Site) -> bool {
        let stored = fs::read_to_string(self.site_path());
        matches!((stored, json_of(site)), (Ok(stored), Ok(text)) if stored != text)
    }

    fn site_path(&self) -> PathBuf {
        self.run_dir.join("site.json")
    }

    pub(crate) fn store(&self, site: &Site) -> Result<(), InstanceError> {
        write_json(&self.site_path(), site)?;
        write_json(&self.run_dir.join("instance.json"), self)
    }
}

/// The directory that holds the run directories of this user: `$TOG_RUN_DIR`, else `/run/tog` if it
/// can be written, else `$XDG_RUNTIME_DIR/tog`, else `/tmp/tog-<uid>`.
#[must_use]
pub fn default_run_root() -> PathBuf {
    if let Some(path) = std::env::var_os("TOG_RUN_DIR").filter(|path| !path.is_empty()) {
        return PathBuf::from(path);
    }
    let system = PathBuf::from("/run/tog");
    if make_private_dir(&system).is_ok() {
        return system;
    }
    if let Some(path) = std::env::var_os("XDG_RUNTIME_DIR").filter(|path| !path.is_empty()) {
        return PathBuf::from(path).join("tog");
    }
    PathBuf::from(format!("/tmp/tog-{}", rustix::process::getuid().as_raw()))
}

/// The run directory of a site, from its name, or from the path of the directory itself.
#[must_use]
pub fn run_dir_of(site_name_or_dir: &str, run_root: &Path) -> PathBuf {
    let given = Path::new(site_name_or_dir);
    if given.join("instance.json").is_file() {
        return given.to_path_buf();
    }
    run_root.join(site_name_or_dir)
}

/// Makes a directory that only we can enter, and makes sure that it is ours.
pub(crate) fn make_private_dir(path: &Path) -> Result<(), InstanceError> {
    let io = |action, source| InstanceError::Io { action, path: path.to_path_buf(), source };
    let mut builder = fs::DirBuilder::new();
    builder.mode(0o700).recursive(true).create(path).map_err(|e| io("create", e))?;
    let found = fs::symlink_metadata(path).map_err(|e| io("examine", e))?;
    if !found.is_dir() {
        return Err(io("use", std::io::Error::other("it is not a directory")));
    }
    let expected = rustix::process::getuid().as_raw();
    if found.uid() != expected {
        return Err(InstanceError::Foreign {
            path: path.to_path_buf(),
            found: found.uid(),
            expected,
        });
    }
    if found.permissions().mode() & 0o077 != 0 {
        fs::set_permissions(path, fs::Permissions::from_mode(0o700))
            .map_err(|e| io("close to others", e))?;
    }
    Ok(())
}

fn read_json<T: for<'a> Deserialize<'a>>(path: &Path) -> Result<T, InstanceError> {
    let io = |source| InstanceError::Io { action: "read", path: path.to_path_buf(), source };
    let damaged = |reason| InstanceError::Damaged { path: path.to_path_buf(), reason };
    let length = fs::metadata(path).map_err(io)?.len();
    if length > FILE_BYTES_MAX {
        return Err(damaged(format!("{length} bytes, expected at most {FILE_BYTES_MAX}")));
    }
    let text = fs::read_to_string(path).map_err(io)?;
    serde_json::from_str(&text).map_err(|error| damaged(error.to_string()))
}

/// As it is in the files of a run directory.
fn json_of<T: Serialize>(value: &T) -> serde_json::Result<String> {
    serde_json::to_string_pretty(value)
}

/// Writes a file that is there completely or not at all.
fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), InstanceError> {
    let io = |source| InstanceError::Io { action: "write", path: path.to_path_buf(), source };
    let text = json_of(value).map_err(|error| io(error.into()))?;
    let unfinished = path.with_extension("unfinished");
    let mut file = fs::File::create(&unfinished).map_err(io)?;
    file.write_all(text.as_bytes()).map_err(io)?;
    drop(file);
    fs::rename(&unfinished, path).map_err(io)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_directory_that_others_could_enter_is_closed() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("open");
        fs::create_dir(&path).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        make_private_dir(&path).unwrap();
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o700);
    }

    #[test]
    fn a_damaged_instance_is_named() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("instance.json"), "{").unwrap();
        let error = Instance::load(dir.path()).unwrap_err().to_string();
        assert!(error.contains("instance.json is damaged"), "{error}");
    }
}
