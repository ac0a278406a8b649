//! A listener of a topic in an event loop, and the turns that a loop gives to data.

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::{FileDescriptorBased, ipc};
use std::cell::Cell;
use std::os::fd::BorrowedFd;
use std::rc::Rc;

/// Event id of "there is data".
pub(crate) const EVENT_DATA: usize = 0;
/// Event id of "I am a new port of this topic: connect to me".
pub(crate) const EVENT_HELLO: usize = 1;

/// Messages of one subscriber between two waits. At the slowest that was measured, 20 ms a frame, that
/// is 1.3 s; at the fastest, microseconds a message, a wait costs little against 64 of them.
const MESSAGES_A_TURN: u64 = 64;
/// A listener that was put into a loop.
#[derive(Debug)]
pub(crate) struct Doorbell {
    listener: Listener<ipc::Service>,
    hello: Cell<bool>,
    turn: Rc<Turn>,
    turn_seen: Cell<u64>,
    taken: Cell<u64>,
}

/// Whose turn it is: the data's, or everything else's. A reader that is slower than its publisher would
/// otherwise never come back to its signals, deadlines and health.
#[derive(Debug, Default)]
pub(crate) struct Turn {
    /// Number of waits so far.
    pub(crate) number: Cell<u64>,
    /// Somebody had to leave messages behind in this turn.
    pub(crate) unfinished: Cell<bool>,
}

impl Doorbell {
    pub(crate) fn new(listener: Listener<ipc::Service>, turn: &Rc<Turn>) -> Self {
        Self {
            listener,
            hello: Cell::new(true),
            turn: Rc::clone(turn),
            turn_seen: Cell::new(0),
            taken: Cell::new(0),
        }
    }

    /// True if one more message may be taken before the next wait; if not, that wait will return at
    /// once, with `data`.
    pub(crate) fn may_take(&self) -> bool {
        if self.turn_seen.replace(self.turn.number.get()) != self.turn.number.get() {
            self.taken.set(0);
        }
        if self.taken.get() >= MESSAGES_A_TURN {
            self.turn.unfinished.set(true);
            return false;
        }
        self.taken.set(self.taken.get() + 1);
        true
    }

    /// True once after a new port of the topic said hello.
    pub(crate) fn take_hello(&self) -> bool {
        self.hello.replace(false)
    }

    pub(crate) fn empty(&self) {
        // An interrupted or failed drain leaves the descriptor readable: the next wait tries again.
        let _ = self.listener.try_wait(|activation| {
            if activation.id.as_value() == EVENT_HELLO {
                self.hello.set(true);
            }
        });
    }

    pub(crate) fn descriptor(&self) -> BorrowedFd<'_> {
        // SAFETY: the descriptor is open as long as the listener lives, which `self` borrows; it is
        // only registered in epoll, never closed or read through this handle.
        unsafe { BorrowedFd::borrow_raw(self.listener.file_descriptor().native_handle()) }
    }
}
