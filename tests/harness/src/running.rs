//! A running `tog` and the lines that it writes.

use super::{LOOK, WATCHDOG, kill};
use rustix::process::Signal;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How long to wait for the last lines of a process that has ended.
const LAST_WORDS: Duration = Duration::from_secs(2);

/// The lines that a process writes, as they come.
#[derive(Default)]
pub struct Lines {
    lines: Mutex<Vec<String>>,
    more: Condvar,
    ended: AtomicBool,
}

impl Lines {
    fn lock(&self) -> MutexGuard<'_, Vec<String>> {
        self.lines.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reads `pipe` to its end in a thread.
    fn follow(self: &Arc<Self>, pipe: impl Read + Send + 'static) {
        let lines = Arc::clone(self);
        std::thread::spawn(move || {
            for line in BufReader::new(pipe).lines().map_while(Result::ok) {
                lines.lock().push(line);
                lines.more.notify_all();
            }
            let _lines = lines.lock();
            lines.ended.store(true, Ordering::Relaxed);
            lines.more.notify_all();
        });
    }

    /// Waits until the last line is here, for [`LAST_WORDS`] at most: a process that was started by the
    /// one that ended may still hold the pipe.
    fn wait_end(&self) {
        let goes_on = |_: &mut Vec<String>| !self.ended.load(Ordering::Relaxed);
        drop(self.more.wait_timeout_while(self.lock(), LAST_WORDS, goes_on));
    }

    /// All of them.
    pub fn all(&self) -> Vec<String> {
        self.lock().clone()
    }

    /// How many there are: a mark behind which to look for later ones.
    pub fn count(&self) -> usize {
        self.lock().len()
    }

    /// All of them as one text.
    pub fn text(&self) -> String {
        self.lock().join("\n")
    }

    /// The first line after the first `mark` lines that passes; waits for it.
    pub fn wait_after<T>(
        &self,
        mark: usize,
        what: &str,
        mut pass: impl FnMut(&str) -> Option<T>,
    ) -> T {
        let start = Instant::now();
        let (mut lines, mut next) = (self.lock(), mark);
        loop {
            while let Some(line) = lines.get(next) {
                next += 1;
                if let Some(value) = pass(line) {
                    return value;
                }
            }
            assert!(start.elapsed() < WATCHDOG, "{what} never came:\n{}", lines.join("\n"));
            lines = self.more.wait_timeout(lines, WATCHDOG).unwrap().0;
        }
    }

    /// The first line of all that contains `part`; waits for it.
    pub fn wait_for(&self, part: &str) -> String {
        self.wait_after(0, part, |line| line.contains(part).then(|| line.to_owned()))
    }

    /// Sleeps until there is a line more, or for `time`.
    pub fn wait_a_moment(&self, time: Duration) {
        drop(self.more.wait_timeout(self.lock(), time));
    }
}

/// A running `tog`, whatever its verb; killed when it goes.
pub struct Running {
    child: Child,
    /// What it writes to stdout.
    pub out: Arc<Lines>,
    /// What it writes to stderr.
    pub log: Arc<Lines>,
}

impl Running {
    /// Starts it.
    pub fn start(mut command: Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let (out, log) = (Arc::<Lines>::default(), Arc::<Lines>::default());
        out.follow(child.stdout.take().unwrap());
        log.follow(child.stderr.take().unwrap());
        Self { child, out, log }
    }

    /// Its process id.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Sends it a signal.
    pub fn signal(&self, signal: Signal) {
        kill(self.pid(), signal);
    }

    /// How it ended, if it did.
    pub fn try_wait(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().unwrap()
    }

    /// Waits for its end; unless a signal ended it, all that it wrote is here then.
    pub fn wait(&mut self) -> ExitStatus {
        let start = Instant::now();
        loop {
            if let Some(status) = self.try_wait() {
                if status.code().is_some() {
                    self.out.wait_end();
                    self.log.wait_end();
                }
                return status;
            }
            assert!(start.elapsed() < WATCHDOG, "it never ends:\n{}", self.log.text());
            self.log.wait_a_moment(LOOK);
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
