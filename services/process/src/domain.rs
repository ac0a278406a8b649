//! The shared-memory domain of an instance, and its one owner (iceoryx2.md, section 3).
//!
//! A process that is killed while it creates a service leaves a name that nobody can ever open
//! again. So one process, the owner, holds the lock, wipes what the dead of earlier runs left,
//! creates everything, sweeps up after each child's death, and removes all at the end. Workers
//! only open.

use crate::bus::{self, Bus, KeptAlive};
use crate::clock::{Clock, monotonic_ns, wall_ns};
use crate::descriptors;
use crate::event_loop::EventLoop;
use crate::instance::{Instance, InstanceError, RUN_DIR_BYTES_MAX, make_private_dir};
use crate::leftovers::{SHARED_MEMORY_DIR, kill_recorded, record_children, shared_memory_of, wipe};
use crate::logging;
use crate::name_lock::{NameLock, NameTaken};
use crate::node::{create_node, iceoryx_config_text};
use crate::plan::{Plan, TopicPlan};
use crate::ports::{BusError, Ipc};
use crate::state_lock::{StateError, StateLock};
use iceoryx2::prelude::Node;
use protocol::site::{Pace, Site, Source};
use rustix::fs::{FlockOperation, flock};
use rustix::process::{Pid, PidfdFlags, pidfd_open};
use std::fs::{self, File};
use std::io::{Read, Seek, Write};
use std::os::fd::OwnedFd;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// How long a sweep waits for a dead node that somebody else is sweeping: nobody else does.
const SWEEP_PATIENCE: Duration = Duration::from_millis(500);

/// Why an instance cannot be started.
#[derive(Debug, thiserror::Error)]
pub enum OwnerError {
    /// Another owner lives.
    #[error(
        "the site {site} already runs: process {pid} owns {run_dir}. Stop it first (Ctrl-C, or \
         `kill {pid}`), or give a second one a name and a `state_dir` of its own; another host of \
         the same site on this machine needs a TOG_RUN_DIR of its own"
    )]
    AlreadyRuns {
        /// The site's name.
        site: String,
        /// The owner's process id as it wrote it.
        pid: String,
        /// The run directory.
        run_dir: PathBuf,
    },
    /// Not enough shared memory: writing into a full one kills a process (SIGBUS).
    #[error(
        "the site needs up to {needed_mib} MiB of shared memory, but {SHARED_MEMORY_DIR} has \
         {free_mib} MiB free: enlarge it (docker: --shm-size), or watch fewer or smaller areas"
    )]
    SharedMemory {
        /// What the plan adds up to.
        needed_mib: u64,
        /// What is free.
        free_mib: u64,
    },
    /// A file.
    #[error("cannot {action} {path}: {source}")]
    Io {
        /// What was tried.
        action: &'static str,
        /// Where.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// Another site, or `tog learn`, writes the state directory.
    #[error(transparent)]
    State(#[from] StateError),
    /// The run directory.
    #[error(transparent)]
    Instance(#[from] InstanceError),
    /// Shared memory.
    #[error(transparent)]
    Bus(#[from] BusError),
}

/// What an owner needs to know beyond the site itself.
#[derive(Debug, Clone)]
pub struct OwnerOptions {
    /// Which host of the site this is; none for a site without hosts.
    pub host: Option<String>,
    /// Holds the run directories; [`crate::instance::default_run_root`] unless a test wants its own.
    pub run_root: PathBuf,
    /// Where relative paths of the site file begin.
    pub base_dir: PathBuf,
    /// Where results go, if asked for.
    pub out_dir: Option<PathBuf>,
    /// Site time.
    pub clock: Clock,
}

/// The owner of an instance: as long as it lives, workers can open; when it is dropped, nothing is
/// left.
pub struct Owner {
    instance: Instance,
    site: Site,
    // Dropped in this order: services, then the node, then (in `Drop`) the files, then the lock.
    factories: Vec<KeptAlive>,
    node: Option<Node<Ipc>>,
    lock: File,
    _name: NameLock,
    state_lock: Option<StateLock>,
    /// What must be there for workers to open: files that were made here.
    made: Vec<PathBuf>,
}

impl Owner {
    /// Takes the run directory of a site, wipes what dead runs left there, and creates its services.
    ///
    /// # Errors
    /// If another owner lives, memory is too small, or a file or service cannot be made.
    pub fn start(site: &Site, options: &OwnerOptions) -> Result<Self, OwnerError> {
        logging::speak(); // the owner before may have lost its files
        let plan = Plan::new(site, options.host.as_deref());
        let lossless = is_lossless(site);
        let topics = all_topics(&plan, lossless);
        make_private_dir(&options.run_root)?;
        let run_root = options.run_root.canonicalize().map_err(|source| OwnerError::Io {
            action: "resolve",
            path: options.run_root.clone(),
            source,
        })?;
        let run_dir = run_root.join(&site.name);
        let length = run_dir.as_os_str().len();
        if length > RUN_DIR_BYTES_MAX {
            return Err(InstanceError::TooLong { path: run_dir, found: length }.into());
        }
        let base_dir = absolute(&options.base_dir)?;
        let out_dir = options.out_dir.as_deref().map(absolute).transpose()?;
        let lock = take_lock(&site.name, &run_dir)?;
        let name = NameLock::take(&prefix_of(&run_dir)).map_err(|taken| {
            // Our lock in a directory that its owner has lost: nobody else shall take it for theirs.
            let _ = fs::remove_file(run_dir.join("lock"));
            let _ = fs::remove_dir(&run_dir);
            match taken {
                NameTaken::Process(pid) => OwnerError::AlreadyRuns {
                    site: site.name.clone(),
                    pid,
                    run_dir: run_dir.clone(),
                },
                NameTaken::Io(source) => {
                    OwnerError::Io { action: "take the name of", path: run_dir.clone(), source }
                }
            }
        })?;
        let instance = Instance {
            site_name: site.name.clone(),
            prefix: prefix_of(&run_dir),
            state_dir: site.state_dir_of(&base_dir, options.host.as_deref()),
            host: options.host.clone(),
            base_dir,
            out_dir,
            clock: options.clock,
            lossless,
            owner_pid: std::process::id(),
            started_ns: wall_ns(),
            started_mono_ns: monotonic_ns(),
            run_dir,
        };
        // From here on, whatever fails: dropping the owner removes what it made.
        let mut owner = Self {
            instance,
            site: site.clone(),
            factories: Vec::new(),
            node: None,
            lock,
            _name: name,
            state_lock: None,
            made: Vec::new(),
        };
        owner.state_lock = Some(StateLock::take(&owner.instance.state_dir)?);
        kill_recorded(&owner.instance.children_file());
        wipe(&owner.instance);
        check_budget(topics.iter().map(TopicPlan::bytes_max).fold(0, u64::saturating_add))?;
        owner.create_all(&topics, plan.node_slots())?;
        Ok(owner)
    }

    fn create_all(&mut self, topics: &[TopicPlan], node_slots: usize) -> Result<(), OwnerError> {
        make_private_dir(&self.instance.iceoryx_root())?;
        let config = self.instance.iceoryx_config();
        fs::write(&config, iceoryx_config_text(&self.instance))
            .map_err(|source| OwnerError::Io { action: "write", path: config.clone(), source })?;
        self.instance.store(&self.site)?;
        descriptors::raise_limit();
        let node = create_node(&self.instance).map_err(|reason| BusError::Open {
            what: "the owner's node",
            topic: self.instance.site_name.clone(),
            reason,
        })?;
        let node = self.node.insert(node);
        for topic in topics {
            self.factories.push((topic.create)(node, topic, node_slots)?);
        }
        self.made = vec![config, self.instance.iceoryx_root(), self.instance.lock_file()];
        self.made.extend(shared_memory_of(&self.instance.prefix));
        Ok(())
    }

    /// The first file of the domain that somebody has removed: processes that start could not open
    /// it, and those that run would wait for each other in vain. The instance must be made anew.
    #[must_use]
    pub fn first_missing(&self) -> Option<&Path> {
        self.made.iter().find(|path| !path.exists()).map(PathBuf::as_path)
    }

    /// See [`StateLock::look`].
    ///
    /// # Errors
    /// If somebody else writes the state directory now.
    pub fn look_at_state(&mut self) -> Result<Option<String>, StateError> {
        self.state_lock.as_mut().map_or(Ok(None), StateLock::look)
    }

    /// What workers are handed.
    #[must_use]
    pub fn instance(&self) -> &Instance {
        &self.instance
    }

    /// The site.
    #[must_use]
    pub fn site(&self) -> &Site {
        &self.site
    }

    /// Number of topics that were created.
    #[must_use]
    pub fn topics(&self) -> usize {
        self.factories.len()
    }

    /// A bus on which the owner itself publishes and reads (health, events).
    ///
    /// # Errors
    /// If its node cannot be created.
    pub fn bus(&self, events: &EventLoop) -> Result<Bus, BusError> {
        Bus::open_as_owner(&self.instance, &self.site, events)
    }

    /// Writes down the processes of this run, so that the next owner finds them if this one is
    /// killed. To be called whenever they change.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn record_children(&self, pids: impl Iterator<Item = u32>) -> std::io::Result<()> {
        record_children(&self.instance.children_file(), pids)
    }

    /// Frees what dead processes held: to be called after each child's exit. Returns how many dead
    /// were removed and how many could not be.
    pub fn sweep(&self) -> (u64, u64) {
        let Some(node) = &self.node else { return (0, 0) };
        let state = node.blocking_cleanup_dead_nodes(SWEEP_PATIENCE);
        (state.cleanups, state.failed_cleanups)
    }
}

impl std::fmt::Debug for Owner {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Owner").field("instance", &self.instance).finish_non_exhaustive()
    }
}

impl Drop for Owner {
    fn drop(&mut self) {
        self.factories.clear();
        self.node = None;
        wipe(&self.instance);
        // The lock's file goes last: who waits for it looks whether it is still the one in the directory.
        let _ = fs::remove_file(self.instance.lock_file());
        let _ = fs::remove_dir(&self.instance.run_dir);
        let _ = flock(&self.lock, FlockOperation::Unlock);
    }
}

fn absolute(path: &Path) -> Result<PathBuf, OwnerError> {
    // The empty path is the directory of a site file that was named without one.
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    let resolved = std::path::absolute(path);
    resolved.map_err(|source| OwnerError::Io { action: "resolve", path: path.into(), source })
}

/// True if the lasers of a site replay as fast as the slowest reader.
#[must_use]
pub fn is_lossless(site: &Site) -> bool {
    let lossless = |source: &Source| matches!(source, Source::Replay { pace: Pace::Lossless, .. });
    site.lasers.iter().any(|laser| lossless(&laser.source))
}

fn all_topics(plan: &Plan, lossless: bool) -> Vec<TopicPlan> {
    let credited = |topic: &&TopicPlan| lossless && topic.required_readers > 0;
    let credits: Vec<_> = plan.topics.iter().filter(credited).map(bus::credit_plan).collect();
    plan.topics.iter().cloned().chain(credits).collect()
}

/// A descriptor that becomes readable when the owner dies.
pub(crate) fn watch_owner(instance: &Instance) -> Result<OwnedFd, BusError> {
    let no_owner = || BusError::NoOwner {
        site: instance.site_name.clone(),
        run_dir: instance.run_dir.display().to_string(),
    };
    let pid = i32::try_from(instance.owner_pid).ok().and_then(Pid::from_raw);
    let owner =
        pidfd_open(pid.ok_or_else(no_owner)?, PidfdFlags::empty()).map_err(|_| no_owner())?;
    // The process id may have been given to somebody else; the lock cannot.
    let lock = File::open(instance.lock_file()).map_err(|_| no_owner())?;
    match flock(&lock, FlockOperation::NonBlockingLockShared) {
        Ok(()) => Err(no_owner()),
        Err(_) => Ok(owner),
    }
}

fn take_lock(site: &str, run_dir: &Path) -> Result<File, OwnerError> {
    let path = run_dir.join("lock");
    let io = |action| {
        let path = path.clone();
        move |source| OwnerError::Io { action, path, source }
    };
    loop {
        make_private_dir(run_dir)?;
        let opened =
            File::options().read(true).write(true).create(true).truncate(false).open(&path);
        let mut lock = match opened {
            // The last owner removed the directory between our two calls.
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => continue,
            opened => opened.map_err(io("open"))?,
        };
        if flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err() {
            let mut pid = String::new();
            let _ = (&lock).take(20).read_to_string(&mut pid);
            let pid = pid.trim().to_owned();
            let run_dir = run_dir.to_path_buf();
            return Err(OwnerError::AlreadyRuns { site: site.to_owned(), pid, run_dir });
        }
        let ours = lock.metadata().map_err(io("examine"))?.ino();
        // Between opening and locking, the last owner may have removed the file: then it is nobody's.
        if fs::metadata(&path).is_ok_and(|there| there.ino() == ours) {
            lock.set_len(0).map_err(io("write"))?;
            lock.rewind().map_err(io("write"))?;
            write!(lock, "{}", std::process::id()).map_err(io("write"))?;
            return Ok(lock);
        }
    }
}

/// `tog<12 hex digits>_`: of the run directory and the user, so that the next owner of the directory
/// finds what a killed one left, and nobody else's. FNV-1a: two directories of a host that
/// collide in 48 bits are not to be expected.
fn prefix_of(run_dir: &Path) -> String {
    let uid = rustix::process::getuid().as_raw().to_le_bytes();
    let bytes = run_dir.as_os_str().as_encoded_bytes().iter().chain(&uid);
    let hash = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |hash, &byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    format!("tog{:012x}_", (hash ^ hash >> 48) & 0xffff_ffff_ffff)
}

fn check_budget(needed: u64) -> Result<(), OwnerError> {
    let Ok(found) = rustix::fs::statvfs(SHARED_MEMORY_DIR) else { return Ok(()) };
    let free = found.f_bavail.saturating_mul(found.f_frsize);
    if needed > free {
        let (needed_mib, free_mib) = (needed.div_ceil(1 << 20), free >> 20);
        return Err(OwnerError::SharedMemory { needed_mib, free_mib });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn shared_memory_that_is_too_small_is_refused_with_both_numbers() {
        let text = check_budget(u64::MAX).unwrap_err().to_string();
        let numbers = text.split(' ').filter(|word| word.parse::<u64>().is_ok()).count();
        assert_eq!(numbers, 2, "{text}");
        check_budget(0).unwrap();
    }

    #[test]
    fn a_site_that_needs_too_much_memory_leaves_nothing() {
        let area = |n: u32| {
            serde_json::json!({ "id": format!("a{n}"), "origin_m": [0.0, 0.0],
                "columns": 2048, "rows": 2048 })
        };
        let areas: Vec<_> = (0..1000).map(area).collect();
        let site = serde_json::json!({ "name": "huge", "area": areas, "laser": [] });
        let site: Site = serde_json::from_value(site).unwrap();
        let (root, base) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let options = OwnerOptions {
            host: None,
            run_root: root.path().to_path_buf(),
            base_dir: base.path().to_path_buf(),
            out_dir: None,
            clock: Clock::Wall,
        };
        let error = Owner::start(&site, &options).unwrap_err();
        assert!(matches!(error, OwnerError::SharedMemory { .. }), "{error}");
        assert_eq!(fs::read_dir(root.path()).unwrap().count(), 0);
    }

    #[test]
    fn two_run_directories_have_two_prefixes() {
        let [a, b] = ["/run/tog/a", "/run/tog/b"].map(|path| prefix_of(Path::new(path)));
        assert_ne!(a, b);
        assert_eq!(a.len(), 16, "see RUN_DIR_BYTES_MAX: {a}");
    }
}
