//! Questions that are not answered.

use super::Asker;
use std::io;
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::thread;

/// Questions that wait for their end. Ending one takes microseconds while there is room to write.
const WAITING_MAX: usize = 4096;

/// Ends them on a thread of its own: the end of a question is a message to who asked, which waits for room,
/// and in a callback of zenoh nobody makes room meanwhile, for its thread reads and writes.
#[derive(Debug, Clone)]
pub(super) struct Refuser(SyncSender<Asker>);

impl Refuser {
    /// Starts the thread; it ends with the last of those who hand questions over.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub(super) fn start() -> io::Result<Self> {
        let (hand_over, handed_over) = sync_channel(WAITING_MAX);
        let end_all = move || handed_over.into_iter().for_each(drop::<Asker>);
        thread::Builder::new().name("refuse".to_owned()).spawn(end_all)?;
        Ok(Self(hand_over))
    }

    /// Ends a question; never waits in a callback.
    pub(super) fn end(&self, question: Asker) {
        let Err(TrySendError::Full(question) | TrySendError::Disconnected(question)) =
            self.0.try_send(question)
        else {
            return;
        };
        // Another thread reads and writes while this one waits.
        tokio::task::block_in_place(|| drop(question));
    }
}
