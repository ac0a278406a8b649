//! A listener of a topic in an event loop, and the turns that a loop gives to data.

use crate::ports::Ipc;
use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::FileDescriptorBased;
use rustix::net::{RecvFlags, recv};
use std::os::fd::BorrowedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Event id of "there is data".
pub(crate) const EVENT_DATA: usize = 0;
/// Event id of "I am a new port of this topic: connect to me".
pub(crate) const EVENT_HELLO: usize = 1;

/// Messages of one subscriber between two waits. At the slowest that was measured, 20 ms a frame, that
/// is 1.3 s; at the fastest, microseconds a message, a wait costs little against 64 of them.
const MESSAGES_A_TURN: u64 = 64;

/// A listener that wakes a loop, or a task. Loop and subscriber are one thread, or one task: nothing
/// here is ordered against anything else, so all of it is relaxed.
#[derive(Debug)]
pub(crate) struct Doorbell {
    listener: Listener<Ipc>,
    hello: AtomicBool,
    turn: Arc<Turn>,
    turn_seen: AtomicU64,
    taken: AtomicU64,
}

/// Whose turn it is: the data's, or everything else's. A reader that is slower than its publisher would
/// otherwise never come back to its signals, deadlines and health.
#[derive(Debug, Default)]
pub(crate) struct Turn {
    number: AtomicU64,
    unfinished: AtomicBool,
}

impl Turn {
    /// Number of waits so far.
    pub(crate) fn number(&self) -> u64 {
        self.number.load(Ordering::Relaxed)
    }

    /// A wait is over.
    pub(crate) fn begin(&self) {
        self.number.fetch_add(1, Ordering::Relaxed);
    }

    /// True once after somebody had to leave messages behind in a turn.
    pub(crate) fn take_unfinished(&self) -> bool {
        self.unfinished.swap(false, Ordering::Relaxed)
    }
}

impl Doorbell {
    pub(crate) fn new(listener: Listener<Ipc>, turn: &Arc<Turn>) -> Self {
        Self {
            listener,
            hello: AtomicBool::new(true),
            turn: Arc::clone(turn),
            turn_seen: AtomicU64::new(0),
            taken: AtomicU64::new(0),
        }
    }

    /// True if one more message may be taken before the next wait; if not, that wait will return at
    /// once, with `data`.
    pub(crate) fn may_take(&self) -> bool {
        let turn = self.turn.number();
        if self.turn_seen.swap(turn, Ordering::Relaxed) != turn {
            self.taken.store(0, Ordering::Relaxed);
        }
        let taken = self.taken.load(Ordering::Relaxed);
        if taken >= MESSAGES_A_TURN {
            self.turn.unfinished.store(true, Ordering::Relaxed);
            return false;
        }
        self.taken.store(taken + 1, Ordering::Relaxed);
        true
    }

    /// True once after a new port of the topic said hello.
    pub(crate) fn take_hello(&self) -> bool {
        self.hello.swap(false, Ordering::Relaxed)
    }

    /// Of a task: silences it and begins a turn.
    pub(crate) fn begin_turn(&self) {
        self.empty();
        self.turn.begin();
    }

    /// Of a task: true once if messages were left behind in this turn.
    pub(crate) fn take_unfinished(&self) -> bool {
        self.turn.take_unfinished()
    }

    /// Silences it; true if somebody had rung. To be called now and then even if nobody seems to ring.
    ///
    /// Both for the sake of iceoryx2 0.10.0 (iceoryx2-cal, `event`). Its listener takes one byte only, though
    /// several ports may ring at once; what is left wakes a loop for nothing, and when as many bytes
    /// wait as the system allows nobody can ring any more, so that a task, which hears of new bytes
    /// only, sleeps for ever. And it takes the mark "somebody rang" away before it takes the byte: who
    /// rings in between sets the mark again, his byte is swallowed, and because of the mark nobody
    /// writes another one.
    pub(crate) fn empty(&self) -> bool {
        let mut bytes = [0u8; 8];
        while recv(self.descriptor(), &mut bytes, RecvFlags::DONTWAIT).is_ok() {}
        let rang = self.listener.try_wait(|activation| {
            if activation.id.as_value() == EVENT_HELLO {
                self.hello.store(true, Ordering::Relaxed);
            }
        });
        // An interrupted or failed drain is made up for by the next one.
        rang.is_ok_and(|events| events > 0)
    }

    pub(crate) fn descriptor(&self) -> BorrowedFd<'_> {
        // SAFETY: the descriptor is open as long as the listener lives, which `self` borrows; it is never
        // closed through this handle.
        unsafe { BorrowedFd::borrow_raw(self.listener.file_descriptor().native_handle()) }
    }
}
