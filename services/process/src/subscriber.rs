//! Receiving: a message where it was written, and the count of those that never came.

use crate::bus::Opened;
use crate::credit::{FinishedTable, Receipt};
use crate::doorbell::Doorbell;
use crate::loss::{LossCounter, Losses};
use crate::ports::{BusError, Element, Ipc, Wire};
use crate::publisher::Publisher;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::{DegradationAction, ReceiveError};
use protocol::wire::{BytesHeader, FLAG_END_OF_STREAM, Header};
use std::io;
use std::os::fd::BorrowedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The receiving end of a topic.
#[derive(Debug)]
pub struct Subscriber<H: Header, E: Element> {
    port: iceoryx2::port::subscriber::Subscriber<Ipc, [E], Wire<H>>,
    doorbell: Arc<Doorbell>,
    topic: String,
    losses: LossCounter,
    connections_failed: Arc<AtomicU64>,
    credit: Option<Credit>,
}

#[derive(Debug)]
struct Credit {
    table: FinishedTable,
    step: u64,
    publisher: Publisher<BytesHeader, u64>,
}

impl Credit {
    fn announce(&mut self) {
        let words = self.table.words().min(self.publisher.payload_len_max());
        // A table that could not be sent is sent again, complete, with the next one.
        if let Ok(mut loan) = self.publisher.loan(words) {
            self.table.write(loan.payload_mut());
            loan.send();
        }
    }
}

impl<H: Header, E: Element> Subscriber<H, E> {
    pub(crate) fn new(
        opened: &Opened<H, E>,
        topic: &str,
        credit: Option<(Publisher<BytesHeader, u64>, u64)>,
        watch: impl FnOnce(Listener<Ipc>) -> io::Result<Arc<Doorbell>>,
    ) -> Result<Self, BusError> {
        let connections_failed = Arc::new(AtomicU64::new(0));
        let counter = Arc::clone(&connections_failed);
        // The bell before the port: what is published in between rings.
        let listener = opened.listener(topic)?;
        let doorbell = watch(listener)
            .map_err(|source| BusError::System { action: "watch a topic", source })?;
        let port = opened
            .data
            .subscriber_builder()
            .set_degradation_handler(move |_, _| {
                counter.fetch_add(1, Ordering::Relaxed);
                DegradationAction::Ignore // one dead publisher must not cost the others a message
            })
            .create()
            .map_err(|error| BusError::Open {
                what: "a subscriber",
                topic: topic.to_owned(),
                reason: error.to_string(),
            })?;
        let mut credit = credit.map(|(publisher, step)| Credit {
            table: FinishedTable::default(),
            step: step.max(1),
            publisher,
        });
        if let Some(credit) = &mut credit {
            credit.announce();
        }
        let losses = LossCounter::default();
        let topic = topic.to_owned();
        Ok(Self { port, doorbell, topic, losses, connections_failed, credit })
    }

    /// The next message, or `None` if there is none now, or if it is time to [`crate::EventLoop::wait`]
    /// again: after 64 messages the others have their turn (signals, deadlines, health), and that
    /// wait returns at once. The caller must check the payload's length
    /// against the header: nothing but the layout is guaranteed. Messages of one source come in
    /// order, those of several are not ordered among each other.
    ///
    /// # Errors
    /// If more messages are held than [`crate::plan::BORROWED_MAX`]: drop the older one first.
    pub fn receive(&mut self) -> Result<Option<Sample<H, E>>, BusError> {
        if self.doorbell.take_hello()
            && let Some(credit) = &mut self.credit
        {
            credit.publisher.serve_late_readers();
            credit.announce();
        }
        let received = if self.doorbell.may_take() { self.port.receive() } else { Ok(None) };
        match received {
            Ok(Some(message)) => {
                self.losses.observe(message.user_header().0.envelope());
                Ok(Some(Sample { message }))
            }
            Ok(None) => {
                if let Some(credit) = self.credit.as_mut().filter(|c| c.table.is_unpublished()) {
                    credit.announce();
                }
                Ok(None)
            }
            Err(ReceiveError::ConnectionFailure(_)) => {
                // A publisher died while it connected. The others are tried again at the next wake.
                self.connections_failed.fetch_add(1, Ordering::Relaxed);
                Ok(None)
            }
            Err(error @ ReceiveError::ExceedsMaxBorrows) => Err(BusError::Port {
                action: "receive",
                topic: self.topic.clone(),
                reason: error.to_string(),
            }),
        }
    }

    /// Readable when there may be something to receive; for who opened it for a task
    /// ([`crate::Bus::subscriber_of_task`]).
    #[must_use]
    pub fn descriptor(&self) -> BorrowedFd<'_> {
        self.doorbell.descriptor()
    }

    /// Silences the descriptor and begins a turn of at most 64 messages; for who opened it for a task.
    pub fn begin_turn(&self) {
        self.doorbell.begin_turn();
    }

    /// True once if the turn left messages behind: nothing will ring for them.
    pub fn take_unfinished(&self) -> bool {
        self.doorbell.take_unfinished()
    }

    /// Says that a message, and all before it of its source, is done with, so that a lossless
    /// publisher may send more. Does nothing without credit.
    pub fn finish(&mut self, receipt: &Receipt) {
        if let Some(credit) = &mut self.credit
            && credit.table.finish(receipt, credit.step)
        {
            credit.announce();
        }
    }

    /// What was received and lost, over all sources.
    #[must_use]
    pub fn losses(&self) -> Losses {
        self.losses.total()
    }

    /// What was received and lost of one source.
    #[must_use]
    pub fn losses_of(&self, source: u32) -> Losses {
        self.losses.of(source)
    }

    /// Publishers that could not be connected.
    #[must_use]
    pub fn connections_failed(&self) -> u64 {
        self.connections_failed.load(Ordering::Relaxed)
    }
}

/// A received message. Holds a place of the publisher's memory until it is dropped; keep at most
/// [`crate::plan::BORROWED_MAX`].
#[derive(Debug)]
pub struct Sample<H: Header, E: Element> {
    message: iceoryx2::sample::Sample<Ipc, [E], Wire<H>>,
}

impl<H: Header, E: Element> Sample<H, E> {
    /// The header.
    #[must_use]
    pub fn header(&self) -> &H {
        &self.message.user_header().0
    }

    /// The payload.
    #[must_use]
    pub fn payload(&self) -> &[E] {
        self.message.payload()
    }

    /// True if the publisher reached the end of its recording; the payload is empty.
    #[must_use]
    pub fn is_end_of_stream(&self) -> bool {
        self.header().envelope().flags & FLAG_END_OF_STREAM != 0
    }

    /// What is needed to [`Subscriber::finish`] it later.
    #[must_use]
    pub fn receipt(&self) -> Receipt {
        let envelope = self.header().envelope();
        Receipt {
            source: envelope.source,
            session: envelope.session,
            seq: envelope.seq,
            end_of_stream: self.is_end_of_stream(),
        }
    }
}
