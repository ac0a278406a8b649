//! The one place where a process sleeps: data, a deadline, a signal or a file descriptor wakes it.
//!
//! Deadlines are absolute moments of CLOCK_MONOTONIC in a timerfd, so a series of them does not
//! drift and is not rounded to milliseconds. Doorbells (iceoryx2 listeners) are emptied before `wait`
//! returns, so the loop never spins on data that the caller has not taken yet.

use crate::clock::monotonic_ns;
use crate::doorbell::{Doorbell, Turn};
use crate::ports::Ipc;
use iceoryx2::port::listener::Listener;
use rustix::buffer::spare_capacity;
use rustix::event::epoll;
use rustix::io::{Errno, read};
use rustix::pipe::{PipeFlags, pipe_with};
use rustix::time::{
    Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, Timespec, timerfd_create,
    timerfd_settime,
};
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::rc::Rc;
use std::sync::{Arc, Weak};

/// SIGHUP, SIGINT and SIGTERM as Linux numbers them on all its architectures.
const STOP_SIGNALS: [i32; 3] = [SIGHUP, 2, 15];
const SIGHUP: i32 = 1;
/// Events taken from the kernel at once; the rest comes with the next wait.
const EVENTS_MAX: usize = 64;
/// Most doorbells and file descriptors of one loop: a host's supervisor has a few a process.
const WATCHED_MAX: usize = 4096;

const SIGNAL: u64 = 0;
const TIMER: u64 = 1;
const FIRST_SLOT: u64 = 2;

/// Why [`EventLoop::wait`] returned. Several reasons can hold at once; none is ever lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Wake {
    /// SIGTERM, SIGINT, the end of the terminal, a call of [`EventLoop::request_stop`], or the owner died. Stays true, but
    /// only its first telling cuts a wait short.
    pub stop: bool,
    /// A subscriber (or the credit of a publisher) may have something: take all of it.
    pub data: bool,
    /// The deadline has passed.
    pub deadline: bool,
    /// File descriptors are ready: see [`EventLoop::next_ready`].
    pub descriptors: bool,
}

/// Names a watched file descriptor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Token(u64);

/// What a file descriptor is watched for. Errors and hang-ups always wake.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interest {
    /// Something can be read, or the other side closed.
    Read,
    /// Something can be written.
    Write,
    /// Either.
    ReadWrite,
}

impl Interest {
    fn flags(self) -> epoll::EventFlags {
        match self {
            Self::Read => epoll::EventFlags::IN,
            Self::Write => epoll::EventFlags::OUT,
            Self::ReadWrite => epoll::EventFlags::IN | epoll::EventFlags::OUT,
        }
    }
}

#[derive(Debug)]
enum Slot {
    Free,
    Doorbell(Weak<Doorbell>),
    Descriptor,
    /// Readable means: stop.
    Stop(OwnedFd),
}

struct Inner {
    epoll: OwnedFd,
    timer: OwnedFd,
    armed_mono_ns: Cell<Option<u64>>,
    signals: OwnedFd,
    signal_ids: Vec<signal_hook::SigId>,
    stop: Cell<bool>,
    stop_told: Cell<bool>,
    signals_seen: Cell<u64>,
    slots: RefCell<Vec<Slot>>,
    ready: RefCell<VecDeque<Token>>,
    events: RefCell<Vec<epoll::Event>>,
    turn: Arc<Turn>,
}

impl std::fmt::Debug for Inner {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("EventLoop").field("turn", &self.turn).finish_non_exhaustive()
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        for &id in &self.signal_ids {
            signal_hook::low_level::unregister(id);
        }
    }
}

/// The event loop of a process; a cheap handle that ports share.
#[derive(Debug, Clone)]
pub struct EventLoop {
    inner: Rc<Inner>,
}

impl EventLoop {
    /// A loop that SIGTERM and SIGINT stop, and SIGHUP unless `nohup` asked for it to be ignored.
    ///
    /// # Errors
    /// If the system gives no more file descriptors.
    pub fn new() -> io::Result<Self> {
        let epoll = epoll::create(epoll::CreateFlags::CLOEXEC)?;
        let flags = TimerfdFlags::CLOEXEC | TimerfdFlags::NONBLOCK;
        let timer = timerfd_create(TimerfdClockId::Monotonic, flags)?;
        let (signals, write_end) = pipe_with(PipeFlags::CLOEXEC | PipeFlags::NONBLOCK)?;
        let mut signal_ids = Vec::with_capacity(STOP_SIGNALS.len());
        let under_nohup = is_ignored(SIGHUP);
        for signal in STOP_SIGNALS.into_iter().filter(|s| *s != SIGHUP || !under_nohup) {
            let write_end = write_end.try_clone()?;
            signal_ids.push(signal_hook::low_level::pipe::register(signal, write_end)?);
        }
        for (fd, token) in [(&signals, SIGNAL), (&timer, TIMER)] {
            epoll::add(&epoll, fd, epoll::EventData::new_u64(token), epoll::EventFlags::IN)?;
        }
        let inner = Inner {
            epoll,
            timer,
            armed_mono_ns: Cell::new(None),
            signals,
            signal_ids,
            stop: Cell::new(false),
            stop_told: Cell::new(false),
            signals_seen: Cell::new(0),
            slots: RefCell::new(Vec::new()),
            ready: RefCell::new(VecDeque::new()),
            events: RefCell::new(Vec::with_capacity(EVENTS_MAX)),
            turn: Arc::default(),
        };
        Ok(Self { inner: Rc::new(inner) })
    }

    /// Sleeps until something happens, at the latest until `deadline_mono_ns` of
    /// [`monotonic_ns`]; without a deadline for as long as it takes. A deadline of the past returns at
    /// once, with whatever else there is. The very first call, and any wake by `data`, means: take
    /// everything from every subscriber.
    ///
    /// # Errors
    /// Only if the loop itself is broken (out of memory, a closed descriptor).
    pub fn wait(&self, deadline_mono_ns: Option<u64>) -> io::Result<Wake> {
        let inner = &*self.inner;
        let due = |now| deadline_mono_ns.is_some_and(|deadline| deadline <= now);
        let untold = inner.stop.get() && !inner.stop_told.get();
        let unfinished = inner.turn.take_unfinished();
        let at_once =
            untold || unfinished || !inner.ready.borrow().is_empty() || due(monotonic_ns());
        if !at_once {
            self.arm(deadline_mono_ns)?;
        }
        let mut wake = Wake { data: unfinished, ..Wake::default() };
        let mut events = inner.events.borrow_mut();
        events.clear();
        let zero = Timespec { tv_sec: 0, tv_nsec: 0 };
        match epoll::wait(&inner.epoll, spare_capacity(&mut events), at_once.then_some(&zero)) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
        inner.turn.begin();
        for event in events.iter() {
            self.take_note(event.data.u64(), &mut wake);
        }
        wake.stop = inner.stop.get();
        inner.stop_told.set(wake.stop);
        wake.deadline = due(monotonic_ns());
        if wake.deadline && !wake.data {
            wake.data = self.hear_what_was_missed();
        }
        wake.descriptors = !inner.ready.borrow().is_empty();
        Ok(wake)
    }

    fn take_note(&self, token: u64, wake: &mut Wake) {
        let inner = &*self.inner;
        let mut scratch = [0u8; 64];
        match token {
            SIGNAL => {
                while let Ok(bytes @ 1..) = read(&inner.signals, &mut scratch) {
                    inner.signals_seen.set(inner.signals_seen.get() + bytes as u64);
                }
                inner.stop.set(true);
            }
            TIMER => {
                let _ = read(&inner.timer, &mut scratch); // 8 bytes: how often it expired
                inner.armed_mono_ns.set(None);
            }
            slot => match inner.slots.borrow().get((slot - FIRST_SLOT) as usize) {
                Some(Slot::Doorbell(doorbell)) => {
                    if let Some(doorbell) = doorbell.upgrade() {
                        doorbell.empty();
                        wake.data = true;
                    }
                }
                Some(Slot::Descriptor) => inner.ready.borrow_mut().push_back(Token(slot)),
                Some(Slot::Stop(fd)) => {
                    inner.stop.set(true);
                    let _ = epoll::delete(&inner.epoll, fd); // it stays readable: once is enough
                }
                Some(Slot::Free) | None => {}
            },
        }
    }

    /// A doorbell that fell silent rings again: see [`Doorbell::empty`]. True if one had been rung.
    fn hear_what_was_missed(&self) -> bool {
        let slots = self.inner.slots.borrow();
        let doorbells = slots.iter().filter_map(|slot| match slot {
            Slot::Doorbell(doorbell) => doorbell.upgrade(),
            _ => None,
        });
        doorbells.filter(|doorbell| doorbell.empty()).count() > 0
    }

    fn arm(&self, deadline_mono_ns: Option<u64>) -> io::Result<()> {
        if self.inner.armed_mono_ns.get() == deadline_mono_ns {
            return Ok(());
        }
        let deadline_ns = deadline_mono_ns.unwrap_or(0); // zero disarms
        let it_value = Timespec {
            tv_sec: (deadline_ns / 1_000_000_000) as i64,
            tv_nsec: (deadline_ns % 1_000_000_000) as _,
        };
        let never = Timespec { tv_sec: 0, tv_nsec: 0 };
        let value = Itimerspec { it_interval: never, it_value };
        timerfd_settime(&self.inner.timer, TimerfdTimerFlags::ABSTIME, &value)?;
        self.inner.armed_mono_ns.set(deadline_mono_ns);
        Ok(())
    }

    /// Watches a file descriptor (a socket, a pidfd). It wakes the loop as long as it is ready: read it
    /// empty, or unwatch it. Unwatch before closing it.
    ///
    /// # Errors
    /// If it cannot be watched, or if too many are.
    pub fn watch(&self, fd: impl AsFd, interest: Interest) -> io::Result<Token> {
        self.insert(fd.as_fd(), interest.flags(), Slot::Descriptor)
    }

    /// Watches it for something else.
    ///
    /// # Errors
    /// If it is not watched.
    pub fn rewatch(&self, token: Token, fd: impl AsFd, interest: Interest) -> io::Result<()> {
        let data = epoll::EventData::new_u64(token.0);
        Ok(epoll::modify(&self.inner.epoll, fd, data, interest.flags())?)
    }

    /// Watches it no more.
    ///
    /// # Errors
    /// If it is not watched.
    pub fn unwatch(&self, token: Token, fd: impl AsFd) -> io::Result<()> {
        if let Some(slot) = self.inner.slots.borrow_mut().get_mut((token.0 - FIRST_SLOT) as usize) {
            *slot = Slot::Free;
        }
        self.inner.ready.borrow_mut().retain(|ready| *ready != token);
        Ok(epoll::delete(&self.inner.epoll, fd)?)
    }

    /// The next descriptor that is ready since the last wait; each is named once a wait.
    #[must_use]
    pub fn next_ready(&self) -> Option<Token> {
        self.inner.ready.borrow_mut().pop_front()
    }

    /// Stops the loop as a signal does.
    pub fn request_stop(&self) {
        self.inner.stop.set(true);
    }

    /// How many SIGTERMs and SIGINTs came: a second Ctrl-C means hurry.
    #[must_use]
    pub fn signals(&self) -> u64 {
        self.inner.signals_seen.get()
    }

    /// How often the process woke: the measure of "nothing polls".
    #[must_use]
    pub fn wakes(&self) -> u64 {
        self.inner.turn.number()
    }

    /// Stops the loop when `fd` becomes readable: the pidfd of the owner.
    pub(crate) fn stop_on(&self, fd: OwnedFd) -> io::Result<()> {
        let mut slots = self.inner.slots.borrow_mut();
        let token = FIRST_SLOT + slots.len() as u64;
        let data = epoll::EventData::new_u64(token);
        epoll::add(&self.inner.epoll, &fd, data, epoll::EventFlags::IN)?;
        slots.push(Slot::Stop(fd));
        Ok(())
    }

    pub(crate) fn listen(&self, listener: Listener<Ipc>) -> io::Result<Arc<Doorbell>> {
        let doorbell = Arc::new(Doorbell::new(listener, &self.inner.turn));
        let slot = Slot::Doorbell(Arc::downgrade(&doorbell));
        self.insert(doorbell.descriptor(), epoll::EventFlags::IN, slot)?;
        Ok(doorbell)
    }

    fn insert(
        &self,
        fd: BorrowedFd<'_>,
        flags: epoll::EventFlags,
        slot: Slot,
    ) -> io::Result<Token> {
        let mut slots = self.inner.slots.borrow_mut();
        let gone = |slot: &Slot| match slot {
            Slot::Free => true,
            Slot::Doorbell(doorbell) => doorbell.strong_count() == 0,
            Slot::Descriptor | Slot::Stop(_) => false,
        };
        let index = slots.iter().position(gone).unwrap_or(slots.len());
        if index >= WATCHED_MAX {
            return Err(io::Error::other(format!("more than {WATCHED_MAX} descriptors in a loop")));
        }
        let token = FIRST_SLOT + index as u64;
        epoll::add(&self.inner.epoll, fd, epoll::EventData::new_u64(token), flags)?;
        if index == slots.len() {
            slots.push(slot);
        } else {
            slots[index] = slot;
        }
        Ok(Token(token))
    }
}

/// True if a signal is ignored, which who started us decided.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal - 1) & 1 == 1
}
