//! Sending: fill a message where it will be read, send it, ring the readers' doorbells.

use crate::bus::Opened;
use crate::clock::monotonic_ns;
use crate::credit::CreditAccount;
use crate::doorbell::EVENT_HELLO;
use crate::plan::{LOANS_MAX, TopicPlan};
use crate::ports::{BusError, Element, Ipc, Wire};
use crate::subscriber::Subscriber;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::port::{DegradationAction, LoanError};
use iceoryx2::prelude::EventId;
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use protocol::wire::{BytesHeader, Header};
use std::mem::MaybeUninit;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// What a publisher counted since it was opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Sent {
    /// Messages sent.
    pub messages: u64,
    /// Of these, messages that no reader was there for: normal while readers start.
    pub without_reader: u64,
    /// Messages that shared memory refused to carry.
    pub failed: u64,
    /// Readers that could not be connected, or whose queue was damaged by their death.
    pub connections_failed: u64,
}

/// The sending end of a topic.
#[derive(Debug)]
pub struct Publisher<H: Header, E: Element> {
    port: iceoryx2::port::publisher::Publisher<Ipc, [E], Wire<H>>,
    notifier: Notifier<Ipc>,
    topic: String,
    payload_len_max: usize,
    source: u32,
    session: u64,
    seq: u64,
    sent: Sent,
    connections_failed: Arc<AtomicU64>,
    credit: Option<Box<Credit>>,
}

#[derive(Debug)]
struct Credit {
    account: CreditAccount,
    readers: Subscriber<BytesHeader, u64>,
}

impl<H: Header, E: Element> Publisher<H, E> {
    pub(crate) fn new(
        opened: &Opened<H, E>,
        plan: &TopicPlan,
        source: u32,
        session: u64,
        credit: Option<Subscriber<BytesHeader, u64>>,
    ) -> Result<Self, BusError> {
        let messages = plan.messages_per_publisher();
        let connections_failed = Arc::new(AtomicU64::new(0));
        let counter = Arc::clone(&connections_failed);
        let notifier = opened.notifier(&plan.name)?;
        let port = opened
            .data
            .publisher_builder()
            .initial_max_slice_len(plan.payload_len_max)
            .max_loaned_samples(LOANS_MAX)
            // Slots for ports are many, memory is for the readers of the plan (see TopicPlan).
            .override_sample_preallocation(move |_| messages)
            .set_degradation_handler(move |_, _| {
                counter.fetch_add(1, Ordering::Relaxed);
                DegradationAction::Ignore // one dead reader must not cost the others a message
            })
            .create()
            .map_err(|error| BusError::Open {
                what: "a publisher",
                topic: plan.name.clone(),
                reason: error.to_string(),
            })?;
        let account = CreditAccount::new(source, session, plan.window(), plan.required_readers);
        let publisher = Self {
            port,
            notifier,
            topic: plan.name.clone(),
            payload_len_max: plan.payload_len_max,
            source,
            session,
            seq: 0,
            sent: Sent::default(),
            connections_failed,
            credit: credit.map(|readers| Box::new(Credit { account, readers })),
        };
        // Readers connect inside `receive`: wake them now, not at the first message.
        let _ = publisher.notifier.notify_with_custom_event_id(EventId::new(EVENT_HELLO));
        Ok(publisher)
    }

    /// True if a message may be sent now. Always true unless the site is lossless: then it is false
    /// while the required reader has half a buffer of unfinished messages, or is not there yet; the
    /// event loop wakes with `data` when that may have changed.
    pub fn may_send(&mut self) -> bool {
        self.sendable() > 0
    }

    /// How many messages may be sent now; `u64::MAX` unless the site is lossless.
    pub fn sendable(&mut self) -> u64 {
        let Some(credit) = &mut self.credit else { return u64::MAX };
        // An error here is counted by the subscriber; the next table says all again.
        while let Ok(Some(table)) = credit.readers.receive() {
            let envelope = *table.header().envelope();
            credit.account.heard(envelope.source, envelope.session, table.payload());
        }
        credit.account.available()
    }

    /// True if the site is not lossless, or the required reader has finished everything sent.
    pub fn all_finished(&mut self) -> bool {
        self.sendable();
        self.credit.as_ref().is_none_or(|credit| credit.account.all_finished())
    }

    /// A message of `len` elements to fill in place.
    ///
    /// # Errors
    /// If `len` is more than the topic's longest, or credit lacks.
    pub fn loan(&mut self, len: usize) -> Result<Loan<'_, H, E>, BusError> {
        if len > self.payload_len_max {
            return Err(BusError::TooLarge {
                topic: self.topic.clone(),
                found: len,
                expected: self.payload_len_max,
            });
        }
        if !self.may_send() {
            return Err(BusError::NoCredit { topic: self.topic.clone() });
        }
        let mut message = self.port.loan_slice_uninit(len).map_err(|error: LoanError| {
            BusError::Port { action: "loan", topic: self.topic.clone(), reason: error.to_string() }
        })?;
        *message.user_header_mut() = Wire(H::default());
        Ok(Loan { message, publisher: self })
    }

    /// Sends a copy of a header and a payload. The envelope is filled in, except its `flags`.
    ///
    /// # Errors
    /// As [`Self::loan`].
    pub fn send(&mut self, header: H, payload: &[E]) -> Result<(), BusError> {
        let mut loan = self.loan(payload.len())?;
        *loan.header_mut() = header;
        loan.payload_mut().copy_from_slice(payload);
        loan.send();
        Ok(())
    }

    /// Lets readers that came later have the history of the topic: to be called once a second or so
    /// where nothing is sent for long (collapsed maps).
    pub fn serve_late_readers(&mut self) {
        let _ = self.port.update_connections(); // a reader that cannot be connected was counted
    }

    /// What was counted since it was opened.
    #[must_use]
    pub fn sent(&self) -> Sent {
        Sent { connections_failed: self.connections_failed.load(Ordering::Relaxed), ..self.sent }
    }

    /// Longest payload in elements.
    #[must_use]
    pub fn payload_len_max(&self) -> usize {
        self.payload_len_max
    }
}

/// A message that is being filled. Dropped without [`Loan::send`], it was never there.
pub struct Loan<'p, H: Header, E: Element> {
    message: SampleMutUninit<Ipc, [MaybeUninit<E>], Wire<H>>,
    publisher: &'p mut Publisher<H, E>,
}

impl<H: Header, E: Element> Loan<'_, H, E> {
    /// The header, all zero at first. The envelope is filled by `send`, except its `flags`.
    pub fn header_mut(&mut self) -> &mut H {
        &mut self.message.user_header_mut().0
    }

    /// The payload, to be written completely: it is not zeroed, an older message of ours may still
    /// be in it.
    pub fn payload_mut(&mut self) -> &mut [E] {
        let payload = self.message.payload_mut();
        let (pointer, len) = (payload.as_mut_ptr().cast::<E>(), payload.len());
        // SAFETY: pointer and length are those of a unique borrow of `self`, with E's alignment. The
        // memory is initialised: a fresh shared-memory object is zero, and later only whole `Pod`
        // values without padding were written to it. Any bit pattern is a value of `E: Pod`.
        unsafe { std::slice::from_raw_parts_mut(pointer, len) }
    }

    /// Sends the message: fills the envelope, publishes, rings. A missing reader is normal, a
    /// failure is counted (see [`Publisher::sent`]): the next message is not held up by it.
    pub fn send(mut self) {
        let publisher = &mut *self.publisher;
        let flags = self.message.user_header().0.envelope().flags;
        *self.message.user_header_mut().0.envelope_mut() = protocol::wire::Envelope {
            seq: publisher.seq,
            session: publisher.session,
            source: publisher.source,
            flags,
            published_mono_ns: monotonic_ns(),
        };
        publisher.seq += 1;
        publisher.sent.messages += 1;
        // SAFETY: all elements are initialised, see `payload_mut`.
        let message = unsafe { self.message.assume_init() };
        match message.send() {
            Ok(0) => publisher.sent.without_reader += 1,
            Ok(_) => {}
            Err(_) => publisher.sent.failed += 1,
        }
        if let Some(credit) = &mut publisher.credit {
            credit.account.sent();
        }
        // MissedDeadline and the like are delivered all the same; an error leaves the message in the
        // queue, where the reader's next wake finds it.
        let _ = publisher.notifier.notify();
    }
}
