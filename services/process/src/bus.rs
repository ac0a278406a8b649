//! The bus: a process's way into the shared memory of its instance. Opens what the owner created,
//! creates nothing.

use crate::clock::monotonic_ns;
use crate::domain;
use crate::doorbell::{Doorbell, EVENT_DATA, EVENT_HELLO};
use crate::event_loop::EventLoop;
use crate::instance::Instance;
use crate::node::create_node;
use crate::plan::{Plan, TopicPlan};
use crate::ports::{BusError, Element, Ipc, Wire};
use crate::publisher::Publisher;
use crate::subscriber::Subscriber;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::{EventId, Node, ServiceName};
use iceoryx2::service::port_factory::event::PortFactory as EventFactory;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use protocol::site::Site;
use protocol::topic::Topic;
use protocol::wire::{BytesHeader, Header};
use std::fmt::Debug;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

/// Services exist before any worker starts, so opening fails only while others start or are swept up
/// at the same moment: 40 x 25 ms is a second, then the supervisor may try again with a new process.
const OPEN_ATTEMPTS: u32 = 40;
const OPEN_PAUSE: Duration = Duration::from_millis(25);

/// A process's node in the shared memory of an instance.
#[derive(Debug)]
pub struct Bus {
    node: Node<Ipc>,
    plan: Plan,
    events: EventLoop,
    lossless: bool,
    session: u64,
}

/// One topic, opened.
pub(crate) struct Opened<H: Header, E: Element> {
    pub(crate) data: PortFactory<Ipc, [E], Wire<H>>,
    pub(crate) event: EventFactory<Ipc>,
}

impl Bus {
    /// Enters the shared memory of an instance. Ports that are opened on this bus wake `events`; so
    /// does the death of the owner, which stops it.
    ///
    /// # Errors
    /// If no owner lives, or the node cannot be created.
    pub fn open(instance: &Instance, events: &EventLoop) -> Result<Self, BusError> {
        let owner = domain::watch_owner(instance)?;
        events
            .stop_on(owner)
            .map_err(|source| BusError::System { action: "watch the supervisor", source })?;
        Self::enter(instance, Plan::new(&instance.site()?, instance.host.as_deref()), events)
    }

    pub(crate) fn open_as_owner(
        instance: &Instance,
        site: &Site,
        events: &EventLoop,
    ) -> Result<Self, BusError> {
        Self::enter(instance, Plan::new(site, instance.host.as_deref()), events)
    }

    fn enter(instance: &Instance, plan: Plan, events: &EventLoop) -> Result<Self, BusError> {
        let node = retry("the node", &instance.site_name, || create_node(instance))?;
        // UNIX nanoseconds, but counted from the start of the instance by the monotonic clock: a
        // restarted publisher has a later session even if the host's clock was set back.
        let since_start = monotonic_ns().saturating_sub(instance.started_mono_ns);
        let session = instance.started_ns.saturating_add(since_start);
        Ok(Self { node, plan, events: events.clone(), lossless: instance.lossless, session })
    }

    /// The loop that this bus wakes.
    #[must_use]
    pub fn events(&self) -> &EventLoop {
        &self.events
    }

    /// Opens a topic for sending. `source` is the publisher's index among its kind in the site (laser
    /// index, area index). In a lossless site publishers of scans, frames and class maps keep
    /// to the credit of their readers: see [`Publisher::may_send`].
    ///
    /// # Errors
    /// If the topic is not in the plan or cannot be opened within a second.
    pub fn publisher<H: Header, E: Element>(
        &self,
        topic: &Topic<H, E>,
        source: u32,
    ) -> Result<Publisher<H, E>, BusError> {
        let plan = self.plan_of(topic.name())?;
        let opened = self.open_topic::<H, E>(topic.name())?;
        let credit = if self.lossless && plan.required_readers > 0 {
            let name = credit_topic(topic.name());
            let opened = self.open_topic::<BytesHeader, u64>(&name)?;
            Some(self.read(&opened, &name, None)?)
        } else {
            None
        };
        Publisher::new(&opened, plan, source, self.session, credit)
    }

    /// Opens a topic for reading.
    ///
    /// # Errors
    /// If the topic is not in the plan or cannot be opened within a second.
    pub fn subscriber<H: Header, E: Element>(
        &self,
        topic: &Topic<H, E>,
    ) -> Result<Subscriber<H, E>, BusError> {
        self.plan_of(topic.name())?;
        self.read(&self.open_topic::<H, E>(topic.name())?, topic.name(), None)
    }

    /// Opens a topic for reading by a task of another runtime than this bus's loop: nothing wakes the
    /// loop; the task waits for [`Subscriber::descriptor`] and begins its turns itself.
    ///
    /// # Errors
    /// If the topic is not in the plan or cannot be opened within a second.
    pub fn subscriber_of_task<H: Header, E: Element>(
        &self,
        topic: &Topic<H, E>,
    ) -> Result<Subscriber<H, E>, BusError> {
        self.plan_of(topic.name())?;
        let opened = self.open_topic::<H, E>(topic.name())?;
        let doorbell = |listener| Ok(Arc::new(Doorbell::new(listener, &Arc::default())));
        Subscriber::new(&opened, topic.name(), None, doorbell)
    }

    /// Opens a topic for reading by the reader that a lossless publisher waits for: fusion for scans,
    /// the mapper for frames, the anomaly service for class maps. It must call
    /// [`Subscriber::finish`] for every message, in the order of each source. Where the site is not
    /// lossless this is [`Self::subscriber`], and `finish` does nothing.
    ///
    /// # Errors
    /// If the topic is not in the plan or cannot be opened within a second.
    pub fn subscriber_with_credit<H: Header, E: Element>(
        &self,
        topic: &Topic<H, E>,
    ) -> Result<Subscriber<H, E>, BusError> {
        self.subscriber_with_credit_as(topic, 0)
    }

    /// As [`Self::subscriber_with_credit`], for another reader that a lossless publisher waits for as
    /// well: `reader` is its index, 1 for the recorder.
    ///
    /// # Errors
    /// If the topic is not in the plan or cannot be opened within a second.
    pub fn subscriber_with_credit_as<H: Header, E: Element>(
        &self,
        topic: &Topic<H, E>,
        reader: u32,
    ) -> Result<Subscriber<H, E>, BusError> {
        let plan = self.plan_of(topic.name())?;
        let opened = self.open_topic::<H, E>(topic.name())?;
        let credit = if self.lossless && plan.required_readers > 0 {
            let credit_plan = credit_plan(plan);
            let credit = self.open_topic::<BytesHeader, u64>(&credit_plan.name)?;
            let publisher = Publisher::new(&credit, &credit_plan, reader, self.session, None)?;
            Some((publisher, plan.window() / 4))
        } else {
            None
        };
        self.read(&opened, topic.name(), credit)
    }

    fn read<H: Header, E: Element>(
        &self,
        opened: &Opened<H, E>,
        topic: &str,
        credit: Option<(Publisher<BytesHeader, u64>, u64)>,
    ) -> Result<Subscriber<H, E>, BusError> {
        Subscriber::new(opened, topic, credit, |listener| self.events.listen(listener))
    }

    fn plan_of(&self, topic: &str) -> Result<&TopicPlan, BusError> {
        self.plan.topic(topic).ok_or_else(|| BusError::UnknownTopic { topic: topic.to_owned() })
    }

    fn open_topic<H: Header, E: Element>(&self, name: &str) -> Result<Opened<H, E>, BusError> {
        let service = service_name(name)?;
        let data = retry("the service", name, || {
            self.node
                .service_builder(&service)
                .publish_subscribe::<[E]>()
                .user_header::<Wire<H>>()
                .open()
        })?;
        let event =
            retry("the event", name, || self.node.service_builder(&service).event().open())?;
        Ok(Opened { data, event })
    }
}

impl<H: Header, E: Element> Opened<H, E> {
    pub(crate) fn notifier(&self, topic: &str) -> Result<Notifier<Ipc>, BusError> {
        retry("a notifier", topic, || {
            self.event.notifier_builder().default_event_id(EventId::new(EVENT_DATA)).create()
        })
    }

    pub(crate) fn listener(&self, topic: &str) -> Result<Listener<Ipc>, BusError> {
        retry("a listener", topic, || self.event.listener_builder().create())
    }
}

/// What keeps a created topic alive.
pub(crate) type KeptAlive = Box<dyn std::any::Any>;
/// [`create_topic`] with its types filled in.
pub(crate) type CreateTopic = fn(&Node<Ipc>, &TopicPlan, usize) -> Result<KeptAlive, BusError>;

/// Creates a topic; only the owner does.
pub(crate) fn create_topic<H: Header, E: Element>(
    node: &Node<Ipc>,
    plan: &TopicPlan,
    node_slots: usize,
) -> Result<KeptAlive, BusError> {
    let service = service_name(&plan.name)?;
    let failed = |what, reason: String| BusError::Open { what, topic: plan.name.clone(), reason };
    let data = node
        .service_builder(&service)
        .publish_subscribe::<[E]>()
        .user_header::<Wire<H>>()
        .enable_safe_overflow(true)
        .max_publishers(plan.publisher_slots())
        .max_subscribers(plan.reader_slots())
        .max_nodes(node_slots)
        .subscriber_max_buffer_size(plan.buffer)
        .subscriber_max_borrowed_samples(crate::plan::BORROWED_MAX)
        .history_size(plan.history)
        .create()
        .map_err(|error| failed("a new service", error.to_string()))?;
    let event = node
        .service_builder(&service)
        .event()
        .max_notifiers(plan.publisher_slots())
        .max_listeners(plan.reader_slots())
        .max_nodes(node_slots)
        .event_id_max_value(EVENT_HELLO)
        .create()
        .map_err(|error| failed("a new event", error.to_string()))?;
    Ok(Box::new(Opened { data, event }))
}

/// Name of the topic on which the reader of `topic` publishes its credit.
fn credit_topic(topic: &str) -> String {
    format!("{topic}/credit")
}

/// The credit of a topic: the required readers publish it, all publishers of the topic read it.
pub(crate) fn credit_plan(topic: &TopicPlan) -> TopicPlan {
    let payload_len_max = topic.publisher_slots() * crate::credit::WORDS;
    TopicPlan {
        name: credit_topic(&topic.name),
        publishers: topic.required_readers,
        readers: topic.publishers + 1,
        buffer: 2, // a table is complete: only the newest matters
        history: 1,
        payload_len_max,
        message_bytes_max: 128 + payload_len_max * size_of::<u64>(),
        required_readers: 0,
        create: create_topic::<BytesHeader, u64>,
    }
}

fn service_name(topic: &str) -> Result<ServiceName, BusError> {
    ServiceName::new(topic).map_err(|error| BusError::Open {
        what: "the name",
        topic: topic.to_owned(),
        reason: format!("{error:?}"),
    })
}

fn retry<T, R: Debug>(
    what: &'static str,
    topic: &str,
    mut attempt: impl FnMut() -> Result<T, R>,
) -> Result<T, BusError> {
    let mut failures = 0;
    loop {
        match attempt() {
            Ok(value) => return Ok(value),
            Err(_) if failures < OPEN_ATTEMPTS => {
                failures += 1;
                thread::sleep(OPEN_PAUSE); // start-up only: no data flows yet
            }
            Err(error) => {
                let (topic, reason) = (topic.to_owned(), format!("{error:?}"));
                return Err(BusError::Open { what, topic, reason });
            }
        }
    }
}
