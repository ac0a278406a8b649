//! Everything that waits for a disk, in a thread of its own: files get their names, remains of
//! killed recorders are recovered, old files go.
//!
//! Where parts were damaged the original is kept beside what was saved, as `<n>.mcap.damaged`.
//!
//! Only files are touched whose names say that a recorder of this site made them:
//! `<dir>/<site>_<begin>/<site>_<begin>_<n>.mcap[.active]`. One that is locked is being written by
//! somebody, and is left alone.

use process::wall_ns;
use recording::{
    BagDirectory, Kept, RecordedFile, RecordingError, Recovered, WrittenFile, recover, to_remove,
};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::thread::JoinHandle;

/// What is to be done.
#[derive(Debug)]
pub enum Order {
    /// Put a file on the disk, give it its name, write the metadata; then delete what is too much.
    Store(WrittenFile),
    /// Recover what was left, delete what is too much.
    TidyUp,
}

/// What was done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// A file is complete.
    Stored,
    /// A file of a killed recorder is complete.
    Recovered {
        /// What it holds.
        messages: u64,
    },
    /// An old file was deleted.
    Removed,
    /// Something could not be done; it is tried again with the next file.
    Failed(String),
}

/// Whose files are looked after.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Scope {
    /// Directory of all sessions.
    pub dir: PathBuf,
    /// What the names of sessions begin with: `<site>_`.
    pub prefix: String,
    /// What is kept of them.
    pub kept: Kept,
    /// Length of the file that is being written, when it is complete, bytes.
    pub open_bytes: u64,
}

/// The thread.
#[derive(Debug)]
pub struct Shelf {
    orders: Option<mpsc::Sender<Order>>,
    outcomes: mpsc::Receiver<Outcome>,
    thread: Option<JoinHandle<()>>,
}

impl Shelf {
    /// Starts it. With a scope it begins with recovering what was left there; without one it looks
    /// after nothing but the files that it is given.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn start(scope: Option<Scope>) -> std::io::Result<Self> {
        // Few orders: one a file, and files take seconds at least.
        let (orders, waiting) = mpsc::channel();
        let (tell, outcomes) = mpsc::channel();
        let mut keeper = Keeper { scope, tell, bags: BTreeMap::new() };
        let thread = std::thread::Builder::new().name("shelf".to_owned()).spawn(move || {
            keeper.tidy_up();
            for order in waiting {
                match order {
                    Order::Store(written) => keeper.store(written),
                    Order::TidyUp => keeper.tidy_up(),
                }
            }
        })?;
        Ok(Self { orders: Some(orders), outcomes, thread: Some(thread) })
    }

    /// Asks for something.
    pub fn order(&self, order: Order) {
        if let Some(orders) = &self.orders {
            // A thread that panicked is told of at the end; its files stay `.active`, and are
            // recovered.
            let _ = orders.send(order);
        }
    }

    /// The next thing that was done, if there is one.
    pub fn outcome(&self) -> Option<Outcome> {
        self.outcomes.try_recv().ok()
    }

    /// Waits until everything is done.
    pub fn finish(&mut self) {
        self.orders = None;
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that stores recordings died: the next start recovers them");
        }
    }
}

struct Keeper {
    scope: Option<Scope>,
    tell: mpsc::Sender<Outcome>,
    bags: BTreeMap<PathBuf, BagDirectory>,
}

impl Keeper {
    fn tell(&self, outcome: Outcome) {
        let _ = self.tell.send(outcome); // nobody listens any more: the recorder has ended
    }

    fn failed(&self, what: &str, error: &RecordingError) {
        self.tell(Outcome::Failed(format!("{what}: {error}")));
    }

    fn bag(&mut self, directory: &Path) -> Result<&mut BagDirectory, RecordingError> {
        match self.bags.entry(directory.to_owned()) {
            Entry::Occupied(known) => Ok(known.into_mut()),
            Entry::Vacant(place) => Ok(place.insert(BagDirectory::open(directory)?)),
        }
    }

    fn store(&mut self, written: WrittenFile) {
        let directory = written.path().parent().unwrap_or(Path::new(".")).to_owned();
        let stored = written.store().and_then(|facts| self.bag(&directory)?.add(facts));
        match stored {
            Ok(()) => self.tell(Outcome::Stored),
            Err(error) => self.failed("a complete recording is not safe yet", &error),
        }
        self.remove_old();
    }

    fn tidy_up(&mut self) {
        for directory in self.sessions() {
            let active = self.bag(&directory).and_then(|bag| bag.active());
            for path in active.unwrap_or_default() {
                self.recover(&directory, &path);
            }
        }
        self.remove_old();
    }

    /// Directories of the recorder of this site.
    fn sessions(&self) -> Vec<PathBuf> {
        let Some(scope) = &self.scope else { return Vec::new() };
        let entries = fs::read_dir(&scope.dir).into_iter().flatten().flatten();
        let ours = entries.filter(|entry| {
            entry.file_name().to_string_lossy().starts_with(&scope.prefix) && entry.path().is_dir()
        });
        let mut sessions: Vec<PathBuf> = ours.map(|entry| entry.path()).collect();
        sessions.sort();
        sessions
    }

    fn recover(&mut self, directory: &Path, active: &Path) {
        if is_locked(active) {
            return; // somebody writes it: this recorder, mostly
        }
        let complete = active.with_extension(""); // without `.active`
        let recovered = recover(active, &complete, |_, _| {}).and_then(|recovered| {
            let io = |action| {
                let path = active.to_owned();
                move |source| RecordingError::Io { path, action, source }
            };
            if recovered.was_complete {
                fs::rename(active, &complete).map_err(io("rename"))?;
            } else if recovered.damaged > 0 {
                // Somebody may get more out of it than we do.
                fs::rename(active, damaged_path(&complete)).map_err(io("rename"))?;
            } else {
                // The new file was read back and is on the disk.
                fs::remove_file(active).map_err(io("delete"))?;
            }
            let facts = recovered.facts.clone();
            self.bag(directory)?.add(facts)?;
            Ok(recovered)
        });
        match recovered {
            Ok(recovered) => {
                let messages = recovered.facts.messages;
                tell_recovered(&complete, &recovered);
                self.tell(Outcome::Recovered { messages });
            }
            Err(error) => self.failed("a recording of a killed recorder is not recovered", &error),
        }
    }

    fn remove_old(&mut self) {
        let Some(scope) = self.scope.clone() else { return };
        let mut files = Vec::new();
        for directory in self.sessions() {
            let Ok(bag) = self.bag(&directory) else { continue };
            files.extend(bag.files().iter().map(|file| RecordedFile {
                path: directory.join(&file.name),
                bytes: file.bytes,
                last_ns: file.last_ns,
            }));
        }
        for file in to_remove(files, scope.open_bytes, wall_ns(), scope.kept) {
            let (Some(directory), Some(name)) = (file.path.parent(), file.path.file_name()) else {
                continue;
            };
            let name = name.to_string_lossy();
            match self.bag(directory).and_then(|bag| bag.remove(&name)) {
                Ok(()) => {
                    tracing::info!("deleted {}: more is not kept", file.path.display());
                    self.tell(Outcome::Removed);
                }
                Err(error) => self.failed("an old recording is not deleted", &error),
            }
        }
    }
}

/// What a recording is called of which parts were left out, beside what was saved of it.
fn damaged_path(complete: &Path) -> PathBuf {
    let mut path = complete.to_owned().into_os_string();
    path.push(".damaged");
    PathBuf::from(path)
}

fn tell_recovered(complete: &Path, recovered: &Recovered) {
    let (name, messages) = (complete.display(), recovered.facts.messages);
    let lost = recovered.bytes_lost;
    let Some(first) = &recovered.first_damage else {
        return tracing::info!(
            "recovered {messages} messages of {name}; {lost} bytes behind its last whole second are \
             lost"
        );
    };
    tracing::warn!(
        "recovered {messages} messages of {name}; {} damaged parts ({} bytes) were left out, the \
         first {first}; {lost} bytes behind its last whole second are lost; the original is kept as \
         {}",
        recovered.damaged,
        recovered.bytes_damaged,
        damaged_path(complete).display()
    );
}

fn is_locked(path: &Path) -> bool {
    fs::File::open(path).is_ok_and(|file| file.try_lock_shared().is_err())
}
