//! From shared memory to the tape: takes every message that is recorded, makes one of ROS of it,
//! and hands it on.

use crate::catalogue::{AreaTopics, Catalogue};
use crate::maps::MapMaker;
use crate::signs::{self, Events};
use crate::tape::{Stamps, Tape};
use process::{Bus, BusError, Clock, Subscriber, monotonic_ns, wall_ns};
use protocol::codec;
use protocol::event::{EventChange, EventHeader};
use protocol::grid::{ClassMapHeader, CollapsedMapHeader};
use protocol::scan::{Reading, ScanHeader, ScanView, reading};
use protocol::site::{Recorder as Settings, Site};
use protocol::time::SECOND_NS;
use protocol::topic;
use recording::ros2::{self, Float32, Time};

/// The share of echoes is told so often, nanoseconds of site time.
const SHARE_PERIOD_NS: u64 = SECOND_NS;
/// Index of the recorder among the readers that a lossless publisher waits for.
const READER: u32 = 1;

/// What came and what could not be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Messages taken from shared memory.
    pub messages_in: u64,
    /// Messages that were published and never seen.
    pub lost: u64,
    /// Messages that no recording can hold.
    pub refused: u64,
}

struct Lane {
    scan_topic: usize,
    share_topic: usize,
    ended: bool,
    share_due_ns: u64,
}

struct AreaPorts {
    topics: AreaTopics,
    maker: MapMaker,
    cells: usize,
    class_maps: Subscriber<ClassMapHeader, u8>,
    collapsed: Subscriber<CollapsedMapHeader, u64>,
    class_map_due_ns: u64,
    /// One a context.
    maps: Vec<MapSlot>,
}

/// The collapsed map of a context.
#[derive(Default)]
struct MapSlot {
    due_ns: u64,
    /// Stamp and counts of the latest that was not due.
    waiting: Option<(u64, Vec<u64>)>,
}

/// A recorder with its ports.
pub struct Recorder {
    site: Site,
    /// By the index of a laser in the whole site: its index in the part that is recorded.
    recorded: Vec<Option<usize>>,
    catalogue: Catalogue,
    clock: Clock,
    maps_period_ns: u64,
    classes_period_ns: u64,
    scans: Vec<Subscriber<ScanHeader, f32>>,
    lanes: Vec<Option<Lane>>,
    areas: Vec<AreaPorts>,
    changes: Option<Subscriber<EventHeader, u8>>,
    events: Events,
    tape: Tape,
    buffer: Vec<u8>,
    counts: Counts,
    first_refusal: Option<String>,
    latched: bool,
}

impl Recorder {
    /// Opens what is recorded: of the `whole` site the part that is to be heard on `host`. `is_awaited`: a
    /// lossless replay waits for this recorder too.
    ///
    /// # Errors
    /// If shared memory cannot be opened.
    pub fn open(
        bus: &Bus,
        (whole, host): (&Site, Option<&str>),
        settings: &Settings,
        clock: Clock,
        is_awaited: bool,
        tape: Tape,
    ) -> Result<Self, BusError> {
        let site = whole.part_on(host);
        let recorded = whole.lasers.iter();
        let recorded = recorded.map(|of| site.lasers.iter().position(|laser| laser.id == of.id));
        let recorded = recorded.collect();
        let catalogue = Catalogue::new(&site, &settings.topics);
        let mut scans = Vec::new();
        let lane = |(scan_topic, share_topic)| Lane {
            scan_topic,
            share_topic,
            ended: false,
            share_due_ns: 0,
        };
        let lanes: Vec<_> = catalogue.lasers.iter().map(|topics| topics.scans.map(lane)).collect();
        if lanes.iter().any(Option::is_some) {
            let has_laser = |id: &str| site.lasers.iter().any(|laser| laser.area == id);
            for area in site.areas.iter().filter(|area| has_laser(&area.id)) {
                let topic = topic::scan(&area.id);
                scans.push(if is_awaited {
                    bus.subscriber_with_credit_as(&topic, READER)?
                } else {
                    bus.subscriber(&topic)?
                });
            }
        }
        let mut areas = Vec::new();
        for (area, topics) in site.areas.iter().zip(&catalogue.areas) {
            if !whole.has_maps_on(host, &area.id) {
                continue; // its lasers are here, its maps are not
            }
            let (cells, classes) = (area.grid().cells(), area.class_names().len());
            areas.push(AreaPorts {
                maps: topics.contexts.iter().map(|_| MapSlot::default()).collect(),
                topics: topics.clone(),
                maker: MapMaker::new(area),
                cells,
                class_maps: bus.subscriber(&topic::classes(&area.id, cells))?,
                collapsed: bus.subscriber(&topic::collapsed(&area.id, cells, classes))?,
                class_map_due_ns: 0,
            });
        }
        let events = catalogue.events.is_some();
        Ok(Self {
            site,
            recorded,
            clock,
            maps_period_ns: (settings.maps_period_s * SECOND_NS as f64) as u64,
            classes_period_ns: (settings.classes_period_s * SECOND_NS as f64) as u64,
            scans,
            lanes,
            areas,
            changes: events.then(|| bus.subscriber(&topic::event())).transpose()?,
            events: Events::default(),
            tape,
            buffer: Vec::new(),
            counts: Counts::default(),
            first_refusal: None,
            latched: false,
            catalogue,
        })
    }

    /// The tape.
    #[must_use]
    pub fn tape(&self) -> &Tape {
        &self.tape
    }

    /// What came.
    #[must_use]
    pub fn counts(&self) -> Counts {
        let scans = self.scans.iter().map(|port| port.losses().lost);
        let maps = self.areas.iter().map(|area| area.collapsed.losses().lost);
        let events = self.changes.iter().map(|port| port.losses().lost);
        Counts { lost: scans.chain(maps).chain(events).sum(), ..self.counts }
    }

    /// The first message that could not be recorded, and why.
    #[must_use]
    pub fn first_refusal(&self) -> Option<&str> {
        self.first_refusal.as_deref()
    }

    /// True if every laser has reached the end of its recording.
    #[must_use]
    pub fn is_over(&self) -> bool {
        let mut lanes = self.lanes.iter().flatten().peekable();
        lanes.peek().is_some() && lanes.all(|lane| lane.ended)
    }

    /// Takes what is there; true if there was something.
    ///
    /// # Errors
    /// If shared memory breaks.
    pub fn take(&mut self) -> Result<bool, BusError> {
        let before = self.counts.messages_in;
        self.take_scans()?;
        for area in 0..self.areas.len() {
            self.take_class_maps(area)?;
            self.take_collapsed(area)?;
        }
        self.take_changes()?;
        Ok(self.counts.messages_in > before)
    }

    /// What is due. When [`Recorder::deadline_mono_ns`] has passed, or oftener.
    pub fn tick(&mut self) {
        let now_ns = self.clock.now_ns().unwrap_or_else(wall_ns);
        self.tape.tick(now_ns, monotonic_ns());
    }

    /// When [`Recorder::tick`] wants to be called, CLOCK_MONOTONIC nanoseconds.
    #[must_use]
    pub fn deadline_mono_ns(&self) -> Option<u64> {
        self.tape.deadline_mono_ns()
    }

    /// Writes the last maps, completes the file and waits for the disk.
    ///
    /// # Errors
    /// If shared memory breaks.
    pub fn finish(&mut self) -> Result<(), BusError> {
        while self.take()? {}
        for area in 0..self.areas.len() {
            for context in 0..self.areas[area].maps.len() {
                if let Some((stamp_ns, counts)) = self.areas[area].maps[context].waiting.take() {
                    self.write_maps(area, context, stamp_ns, &counts);
                }
            }
        }
        self.tape.finish(monotonic_ns());
        Ok(())
    }

    fn take_scans(&mut self) -> Result<(), BusError> {
        for area in 0..self.scans.len() {
            while let Some(scan) = self.scans[area].receive()? {
                self.counts.messages_in += 1;
                let (header, receipt) = (*scan.header(), scan.receipt());
                let laser = self.recorded.get(receipt.source as usize).copied().flatten();
                if let Some(laser) = laser
                    && let Some(Some(lane)) = self.lanes.get_mut(laser)
                {
                    if scan.is_end_of_stream() {
                        lane.ended = true;
                    } else {
                        let view = ScanView::from_wire(&header, scan.payload());
                        self.write_scan(laser, &view);
                    }
                }
                self.scans[area].finish(&receipt);
            }
        }
        Ok(())
    }

    fn write_scan(&mut self, laser: usize, scan: &ScanView<'_>) {
        let topics = &self.catalogue.lasers[laser];
        let encoded =
            recording::encode_scan(&topics.frame, topics.scan_time_s, scan, &mut self.buffer);
        let Some(Some(lane)) = self.lanes.get_mut(laser) else { return };
        let (scan_topic, share_topic) = (lane.scan_topic, lane.share_topic);
        let is_due = scan.stamp_ns >= lane.share_due_ns;
        if is_due {
            lane.share_due_ns = scan.stamp_ns.saturating_add(SHARE_PERIOD_NS);
        }
        if !self.put(scan_topic, scan.stamp_ns, encoded) || !is_due {
            return;
        }
        let is_echo = |range: &&f32| matches!(reading(**range, &scan.geometry), Reading::Echo(_));
        let echoes = scan.ranges_m.iter().filter(is_echo).count();
        let data = echoes as f32 / scan.ranges_m.len().max(1) as f32;
        let encoded = ros2::encode(&Float32 { data }, 4, &mut self.buffer);
        self.put(share_topic, scan.stamp_ns, encoded);
    }

    /// Writes what is in the buffer, if it could be encoded.
    fn put<E: ToString>(&mut self, topic: usize, stamp_ns: u64, encoded: Result<(), E>) -> bool {
        if let Err(error) = encoded {
            self.counts.refused += 1;
            let name = &self.catalogue.topics[topic].name;
            self.first_refusal.get_or_insert_with(|| format!("{name}: {}", error.to_string()));
            return false;
        }
        let log_ns = self.clock.now_ns().unwrap_or(stamp_ns);
        self.latch(log_ns);
        let stamps = Stamps { log_ns, publish_ns: stamp_ns };
        self.tape.write(topic, stamps, &self.buffer, monotonic_ns());
        true
    }

    /// What is told once: poses and zones, before the first message.
    fn latch(&mut self, now_ns: u64) {
        let Some(stamp) = Time::of(now_ns).filter(|_| !self.latched) else { return };
        self.latched = true;
        let (mut buffer, stamps) = (Vec::new(), Stamps { log_ns: now_ns, publish_ns: now_ns });
        if signs::transforms(&self.site, &self.catalogue, stamp, &mut buffer).is_ok() {
            self.tape.write(self.catalogue.tf_static, stamps, &buffer, monotonic_ns());
        }
        if let Some(events) = self.catalogue.events
            && signs::zones(&self.site, stamp, &mut buffer).is_ok()
        {
            self.tape.write(events.zones, stamps, &buffer, monotonic_ns());
        }
    }

    fn take_class_maps(&mut self, area: usize) -> Result<(), BusError> {
        while let Some(map) = self.areas[area].class_maps.receive()? {
            self.counts.messages_in += 1;
            let ports = &mut self.areas[area];
            let header = *map.header();
            let stamp_ns = header.number.saturating_mul(header.period_ns);
            let is_due = stamp_ns >= ports.class_map_due_ns && !map.is_end_of_stream();
            let (true, Some(stamp)) = (is_due, Time::of(stamp_ns)) else { continue };
            if map.payload().len() != ports.cells {
                self.counts.refused += 1;
                continue;
            }
            ports.class_map_due_ns = stamp_ns.saturating_add(self.classes_period_ns);
            let encoded = ports.maker.class_map(stamp, map.payload(), &mut self.buffer);
            let topic = ports.topics.classes;
            self.put(topic, stamp_ns, encoded);
        }
        Ok(())
    }

    fn take_collapsed(&mut self, area: usize) -> Result<(), BusError> {
        while let Some(map) = self.areas[area].collapsed.receive()? {
            self.counts.messages_in += 1;
            let header = *map.header();
            let ports = &mut self.areas[area];
            let fits = map.payload().len() == ports.cells * ports.maker.classes();
            let context = header.context as usize;
            let Some(slot) = ports.maps.get_mut(context).filter(|_| fits) else {
                self.counts.refused += 1;
                continue;
            };
            let stamp_ns = header.number.saturating_mul(header.period_ns);
            if stamp_ns < slot.due_ns {
                let (waiting_ns, counts) = slot.waiting.get_or_insert_default();
                *waiting_ns = stamp_ns;
                counts.clear();
                counts.extend_from_slice(map.payload());
                continue;
            }
            slot.due_ns = stamp_ns.saturating_add(self.maps_period_ns);
            slot.waiting = None;
            self.write_maps(area, context, stamp_ns, map.payload());
        }
        Ok(())
    }

    fn write_maps(&mut self, area: usize, context: usize, stamp_ns: u64, counts: &[u64]) {
        let Some(stamp) = Time::of(stamp_ns) else { return };
        let (of_counts, of_classes) = self.areas[area].topics.contexts[context].clone();
        let encoded = self.areas[area].maker.counts(stamp, counts, &mut self.buffer);
        self.put(of_counts, stamp_ns, encoded);
        for (class, topic) in of_classes.into_iter().enumerate() {
            let maker = &mut self.areas[area].maker;
            let encoded = maker.percent(stamp, counts, class, &mut self.buffer);
            self.put(topic, stamp_ns, encoded);
        }
    }

    fn take_changes(&mut self) -> Result<(), BusError> {
        let (Some(changes), Some(topics)) = (&mut self.changes, self.catalogue.events) else {
            return Ok(());
        };
        let mut taken = Vec::new();
        while let Some(change) = changes.receive()? {
            self.counts.messages_in += 1;
            taken.push(codec::decode::<EventChange>(change.payload()));
        }
        for change in taken {
            let change = match change {
                Ok(change) => change,
                Err(error) => {
                    self.put(topics.log, 0, Err(error));
                    continue;
                }
            };
            let Some(stamp) = Time::of(change.stamp_ns).filter(|_| self.events.is_new(&change))
            else {
                continue;
            };
            let encoded = Events::log(&change, stamp, &mut self.buffer);
            self.put(topics.log, change.stamp_ns, encoded);
            let encoded = self.events.markers(&change, stamp, &mut self.buffer);
            self.put(topics.markers, change.stamp_ns, encoded);
        }
        Ok(())
    }
}
