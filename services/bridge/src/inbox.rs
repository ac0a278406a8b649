//! What came from other hosts and was not looked at yet: bounded queues that threads of the network
//! fill and the loop of the bridge empties.
//!
//! The policy of each: health, the newest win; pages of events and of files, what finds no room goes (it
//! is asked for again); questions, what finds no room goes unanswered (they are asked again); frames and
//! maps, the newest win; of whether a host is there and of its claims only the newest is kept, and never
//! lost. Scans do not wait here: see [`crate::scans`].

use crate::link::View;
use protocol::link::AreaFile;
use rustix::event::{EventfdFlags, eventfd};
use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Most messages of health that wait: a second of a site of a hundred processes, twice.
pub const HEALTH_MAX: usize = 256;
/// Most pages of events that wait, of all hosts: each is at most 256 kB.
pub const PAGES_MAX: usize = 32;
/// Most questions to the own journal that wait: one a desk, and some that were given up.
pub const ASKS_MAX: usize = 16;

/// Most pages of files that wait: one an area is asked for at a time.
pub const FILES_MAX: usize = 8;

/// Most frames, or maps of one kind, of an area that wait: 0.4 s of the fastest; without the oldest the
/// others are of no use until the next key frame.
pub const VIEWS_MAX: usize = 32;

/// What was thrown away because there was no room.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Dropped {
    /// Messages of health.
    pub health: u64,
    /// Pages of events.
    pub pages: u64,
    /// Questions.
    pub asks: u64,
    /// Frames and maps.
    pub maps: u64,
    /// Messages that were longer than any of their kind may be.
    pub too_long: u64,
    /// Questions that were not understood.
    pub not_understood: u64,
}

/// A question to the own journal: everything after a row, and how to answer.
#[derive(Debug)]
pub struct Ask<Q> {
    /// The rows wanted follow this one.
    pub after: u64,
    /// Whom to answer.
    pub query: Q,
}

/// A question for a part of a file of an area.
#[derive(Debug)]
pub struct FileAsk<Q> {
    /// The area's id.
    pub area: String,
    /// Which file.
    pub file: AreaFile,
    /// From where on.
    pub offset: u64,
    /// Whom to answer.
    pub query: Q,
}

/// Encoded frames and maps, in order, each with the index of the host that says it; by the number of the
/// followed area.
pub type Arriving = BTreeMap<(usize, View), VecDeque<(usize, Vec<u8>)>>;

#[derive(Debug)]
struct Queues<Q> {
    health: VecDeque<(usize, Vec<u8>)>,
    pages: VecDeque<(usize, Vec<u8>)>,
    asks: VecDeque<Ask<Q>>,
    alive: BTreeMap<usize, bool>,
    claims: BTreeMap<usize, Vec<u8>>,
    files: VecDeque<(usize, Vec<u8>)>,
    file_asks: VecDeque<FileAsk<Q>>,
    views: Arriving,
    wanted: BTreeMap<(usize, View), bool>,
    dropped: Dropped,
}

/// All that came and waits.
#[derive(Debug, Default)]
pub struct Arrived<Q> {
    /// Encoded health, and the index of the host that it is of.
    pub health: VecDeque<(usize, Vec<u8>)>,
    /// Encoded pages, and the index of the host that they are of.
    pub pages: VecDeque<(usize, Vec<u8>)>,
    /// Questions.
    pub asks: VecDeque<Ask<Q>>,
    /// By the index of a host: its token came, or went.
    pub alive: BTreeMap<usize, bool>,
    /// By the index of a host: its encoded claims.
    pub claims: BTreeMap<usize, Vec<u8>>,
    /// Encoded pages of files, and the index of the host that they are of.
    pub files: VecDeque<(usize, Vec<u8>)>,
    /// Questions for files.
    pub file_asks: VecDeque<FileAsk<Q>>,
    /// Frames and maps.
    pub views: Arriving,
}

/// The queues, and the descriptor that wakes the loop.
#[derive(Debug)]
pub struct Inbox<Q> {
    queues: Mutex<Queues<Q>>,
    bell: OwnedFd,
}

impl<Q> Inbox<Q> {
    /// Empty queues.
    ///
    /// # Errors
    /// If the system gives no descriptor.
    pub fn new() -> io::Result<Self> {
        let queues = Queues {
            health: VecDeque::new(),
            pages: VecDeque::new(),
            asks: VecDeque::new(),
            alive: BTreeMap::new(),
            claims: BTreeMap::new(),
            files: VecDeque::new(),
            file_asks: VecDeque::new(),
            views: BTreeMap::new(),
            wanted: BTreeMap::new(),
            dropped: Dropped::default(),
        };
        let bell = eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK)?;
        Ok(Self { queues: Mutex::new(queues), bell })
    }

    /// Readable while something waits.
    #[must_use]
    pub fn bell(&self) -> BorrowedFd<'_> {
        self.bell.as_fd()
    }

    /// Health of a host.
    pub fn health(&self, host: usize, bytes: Vec<u8>) {
        let mut queues = self.lock();
        let Queues { health, dropped, .. } = &mut *queues;
        dropped.health += push_newest(health, HEALTH_MAX, (host, bytes));
        self.ring(queues);
    }

    /// A page of events of a host.
    pub fn page(&self, host: usize, bytes: Vec<u8>) {
        let mut queues = self.lock();
        let Queues { pages, dropped, .. } = &mut *queues;
        dropped.pages += u64::from(push_first(pages, PAGES_MAX, (host, bytes)).is_some());
        self.ring(queues);
    }

    /// A question to the own journal; comes back if there is no room.
    #[must_use]
    pub fn ask(&self, ask: Ask<Q>) -> Option<Ask<Q>> {
        let mut queues = self.lock();
        let Queues { asks, dropped, .. } = &mut *queues;
        let refused = push_first(asks, ASKS_MAX, ask);
        dropped.asks += u64::from(refused.is_some());
        self.ring(queues);
        refused
    }

    /// The token of a host came, or went.
    pub fn alive(&self, host: usize, alive: bool) {
        let mut queues = self.lock();
        queues.alive.insert(host, alive);
        self.ring(queues);
    }

    /// Claims of a host.
    pub fn claims(&self, host: usize, bytes: Vec<u8>) {
        let mut queues = self.lock();
        queues.claims.insert(host, bytes);
        self.ring(queues);
    }

    /// A page of a file of a host.
    pub fn file(&self, host: usize, bytes: Vec<u8>) {
        let mut queues = self.lock();
        let Queues { files, dropped, .. } = &mut *queues;
        dropped.pages += u64::from(push_first(files, FILES_MAX, (host, bytes)).is_some());
        self.ring(queues);
    }

    /// A question for a file; comes back if there is no room.
    #[must_use]
    pub fn ask_file(&self, ask: FileAsk<Q>) -> Option<FileAsk<Q>> {
        let mut queues = self.lock();
        let Queues { file_asks, dropped, .. } = &mut *queues;
        let refused = push_first(file_asks, ASKS_MAX, ask);
        dropped.asks += u64::from(refused.is_some());
        self.ring(queues);
        refused
    }

    /// A frame or a map of the `place.0`th area that this host follows, from the host of this index.
    pub fn view(&self, place: (usize, View), host: usize, bytes: Vec<u8>) {
        let mut queues = self.lock();
        let Queues { views, dropped, .. } = &mut *queues;
        dropped.maps += push_newest(views.entry(place).or_default(), VIEWS_MAX, (host, bytes));
        self.ring(queues);
    }

    /// Somebody elsewhere listens, or nobody does any more, to a view of an area of this host.
    pub fn wanted(&self, place: (usize, View), is_wanted: bool) {
        let mut queues = self.lock();
        queues.wanted.insert(place, is_wanted);
        self.ring(queues);
    }

    /// What came to be wanted, or not to be, since the last call.
    #[must_use]
    pub fn take_wanted(&self) -> BTreeMap<(usize, View), bool> {
        std::mem::take(&mut self.lock().wanted)
    }

    /// Something was longer than it may be, and was not taken.
    pub fn too_long(&self) {
        self.lock().dropped.too_long += 1;
    }

    /// A question was none of ours, and was not taken.
    pub fn not_understood(&self) {
        self.lock().dropped.not_understood += 1;
    }

    /// Takes everything, and silences the bell.
    #[must_use]
    pub fn take(&self) -> Arrived<Q> {
        let mut count = [0; 8];
        let _ = rustix::io::read(&self.bell, &mut count); // it did not ring: nothing to silence
        let mut queues = self.lock();
        let Queues { health, pages, asks, alive, claims, files, file_asks, views, .. } =
            &mut *queues;
        Arrived {
            health: std::mem::take(health),
            pages: std::mem::take(pages),
            asks: std::mem::take(asks),
            alive: std::mem::take(alive),
            claims: std::mem::take(claims),
            files: std::mem::take(files),
            file_asks: std::mem::take(file_asks),
            views: std::mem::take(views),
        }
    }

    /// What was thrown away so far.
    #[must_use]
    pub fn dropped(&self) -> Dropped {
        self.lock().dropped
    }

    fn lock(&self) -> MutexGuard<'_, Queues<Q>> {
        // Whoever panicked left whole queues: each change is one call.
        self.queues.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn ring(&self, queues: MutexGuard<'_, Queues<Q>>) {
        drop(queues);
        // Full means that it rings already.
        let _ = rustix::io::write(&self.bell, &1u64.to_ne_bytes());
    }
}

/// Puts a value at the end; the oldest goes if there is no room. How many went.
fn push_newest<T>(queue: &mut VecDeque<T>, max: usize, value: T) -> u64 {
    let full = queue.len() >= max;
    if full {
        queue.pop_front();
    }
    queue.push_back(value);
    u64::from(full)
}

/// Puts a value at the end; it comes back if there is no room.
fn push_first<T>(queue: &mut VecDeque<T>, max: usize, value: T) -> Option<T> {
    if queue.len() >= max {
        return Some(value);
    }
    queue.push_back(value);
    None
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn of_too_many_frames_the_newest_stay_and_the_rest_is_counted() {
        let inbox = Inbox::<()>::new().unwrap();
        let place = (1, View::Frame);
        for n in 0..VIEWS_MAX + 3 {
            inbox.view(place, 0, vec![n as u8]);
        }
        inbox.view((0, View::Frame), 0, vec![7]);
        let arrived = inbox.take();
        assert_eq!(arrived.views[&place].len(), VIEWS_MAX);
        assert_eq!(arrived.views[&place][0], (0, vec![3]), "the three oldest are gone");
        assert_eq!(inbox.dropped(), Dropped { maps: 3, ..Dropped::default() });
        assert!(inbox.take().views.is_empty());
    }

    #[test]
    fn pages_and_questions_that_find_no_room_are_counted_and_the_first_stay() {
        let inbox = Inbox::new().unwrap();
        for n in 0..100u64 {
            inbox.page(0, vec![n as u8]);
            assert_eq!(inbox.ask(Ask { after: n, query: n }).is_some(), n >= ASKS_MAX as u64);
            inbox.health(0, vec![n as u8]);
        }
        let arrived = inbox.take();
        assert_eq!((arrived.pages.len(), arrived.asks.len()), (PAGES_MAX, ASKS_MAX));
        assert_eq!((arrived.pages[0].1[0], arrived.asks[0].after), (0, 0));
        assert_eq!(arrived.health.len(), 100);
        let dropped = inbox.dropped();
        assert_eq!((dropped.pages, dropped.asks), (68, 84));
    }

    #[test]
    fn the_bell_rings_until_everything_is_taken() {
        let inbox = Inbox::<()>::new().unwrap();
        let rings = |inbox: &Inbox<()>| {
            let mut descriptors =
                [rustix::event::PollFd::new(&inbox.bell, rustix::event::PollFlags::IN)];
            let now = rustix::time::Timespec { tv_sec: 0, tv_nsec: 0 };
            rustix::event::poll(&mut descriptors, Some(&now)).unwrap() == 1
        };
        assert!(!rings(&inbox));
        inbox.health(0, vec![1]);
        inbox.health(0, vec![2]);
        assert!(rings(&inbox));
        assert_eq!(inbox.take().health.len(), 2);
        assert!(!rings(&inbox));
    }
}
