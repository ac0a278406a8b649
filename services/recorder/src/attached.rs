//! `tog bag record`: a recorder beside a running site, started by a person. The site's shared
//! memory has room for one more reader of everything; nobody waits for it.

use crate::core::{Counts, Recorder};
use crate::service::{head, limits};
use crate::shelf::Shelf;
use crate::tape::{Tape, TapeCounts};
use process::instance::InstanceError;
use process::{Bus, BusError, EventLoop, Instance, monotonic_ns, wall_ns};
use protocol::site::Recorder as Settings;
use protocol::time::SECOND_NS;
use std::io;
use std::path::PathBuf;

/// Progress is told so often.
const PROGRESS_NS: u64 = SECOND_NS / 4;

/// What is recorded, where, for how long.
#[derive(Debug, Clone, PartialEq)]
pub struct AttachedOptions {
    /// Run directory of the site.
    pub run_dir: PathBuf,
    /// The bag: a directory that does not exist, or is empty.
    pub out: PathBuf,
    /// Topics and splits; directory and retention are not used.
    pub settings: Settings,
    /// Ends by itself after so many seconds.
    pub seconds: Option<f64>,
}

/// How it goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Since the start, seconds.
    pub seconds: f64,
    /// What came.
    pub counts: Counts,
    /// What was written.
    pub tape: TapeCounts,
}

/// Why it cannot record.
#[derive(Debug, thiserror::Error)]
pub enum AttachError {
    /// The site does not run.
    #[error(transparent)]
    Instance(#[from] InstanceError),
    /// Shared memory.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// There is something already.
    #[error("{} exists and is not empty: name another directory for --out", path.display())]
    Exists {
        /// The directory.
        path: PathBuf,
    },
    /// The disk.
    #[error(
        "{problem}. The seconds before are in {}: `tog bag recover` makes a complete file of what is \
         called .active there",
        out.display()
    )]
    Disk {
        /// What is wrong with it.
        problem: String,
        /// The bag.
        out: PathBuf,
    },
    /// Somebody deleted the bag, or moved it away.
    #[error("{problem}; what came after that is in {}", out.display())]
    Lost {
        /// What is lost.
        problem: String,
        /// The bag that was begun anew.
        out: PathBuf,
    },
    /// The same, and nothing came after that.
    #[error("{problem}")]
    AllLost {
        /// What is lost.
        problem: String,
    },
    /// The system.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// Records until the time is over, a signal comes, the recordings of the site end, or the site
/// stops. `progress` is told how it goes, four times a second.
///
/// # Errors
/// See [`AttachError`]. What was written before is complete.
pub fn record_attached(
    options: &AttachedOptions,
    mut progress: impl FnMut(&Progress),
) -> Result<Progress, AttachError> {
    if std::fs::read_dir(&options.out).is_ok_and(|mut entries| entries.next().is_some()) {
        return Err(AttachError::Exists { path: options.out.clone() });
    }
    let instance = Instance::load(&options.run_dir)?;
    let (site, settings) = (instance.site()?, &options.settings);
    let host = instance.host.as_deref();
    let events = EventLoop::new()?;
    let bus = Bus::open(&instance, &events)?;
    let head = head(&site.part_on(host), settings, &instance.clock, "tog bag record", wall_ns());
    let tape = Tape::new(options.out.clone(), head, limits(settings), Shelf::start(None)?);
    let mut recorder = Recorder::open(&bus, (&site, host), settings, instance.clock, false, tape)?;
    let begin = monotonic_ns();
    let end = options.seconds.map(|seconds| begin + (seconds * SECOND_NS as f64) as u64);
    let report = |recorder: &Recorder| Progress {
        seconds: (monotonic_ns() - begin) as f64 / SECOND_NS as f64,
        counts: recorder.counts(),
        tape: recorder.tape().counts(),
    };
    let disk = |problem: &str| {
        let (problem, out) = (problem.to_owned(), options.out.clone());
        if out.exists() {
            AttachError::Disk { problem, out }
        } else {
            AttachError::AllLost { problem }
        }
    };
    let mut told = begin;
    loop {
        while recorder.take()? {}
        recorder.tick();
        if let Some(problem) = recorder.tape().unwritable() {
            return Err(disk(problem));
        }
        let now = monotonic_ns();
        if now >= told + PROGRESS_NS {
            told = now;
            progress(&report(&recorder));
        }
        if recorder.is_over() || end.is_some_and(|end| end <= now) {
            break;
        }
        let due = [recorder.deadline_mono_ns(), end, Some(told + PROGRESS_NS)];
        if events.wait(due.into_iter().flatten().min())?.stop {
            break;
        }
    }
    recorder.finish()?;
    let tape = recorder.tape();
    match (tape.unwritable().or(tape.unshelved()), tape.lost()) {
        (Some(problem), _) => Err(disk(problem)),
        (None, None) => Ok(report(&recorder)),
        (None, Some(problem)) => {
            let (problem, out) = (problem.to_owned(), options.out.clone());
            let has_more = tape.counts().messages_written > 0 && out.exists();
            Err(if has_more {
                AttachError::Lost { problem, out }
            } else {
                AttachError::AllLost { problem }
            })
        }
    }
}
