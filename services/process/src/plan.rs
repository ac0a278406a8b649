//! Pure: the services of shared memory that a site needs, how many ports each has, and how much
//! memory that takes. The owner creates exactly this; workers find their limits here.

use crate::bus::{CreateTopic, create_topic};
use crate::ports::Element;
use crate::role::Role;
use protocol::site::{Area, RecordedTopics, Site};
use protocol::topic::{self, Topic};
use protocol::wire::Header;

/// Size of one topic. `buffer` is per publisher and reader.
#[derive(Debug, Clone)]
pub struct TopicPlan {
    /// Name of the topic.
    pub name: String,
    /// Processes that publish.
    pub publishers: usize,
    /// Readers whose memory is set aside: those of the plan and one more, a recorder or bridge.
    pub readers: usize,
    /// Messages that wait for a slow reader before the oldest is replaced.
    pub buffer: usize,
    /// Messages that a late reader still gets.
    pub history: usize,
    /// Longest payload, elements.
    pub payload_len_max: usize,
    /// Bytes of the longest message, header included.
    pub message_bytes_max: usize,
    /// Readers that a lossless publisher waits for; 0 if it waits for nobody.
    pub required_readers: usize,
    /// How the owner creates it, with the types of its messages.
    pub(crate) create: CreateTopic,
}

/// Messages that a reader holds at once: one in hand, and one kept while the next is looked at.
pub const BORROWED_MAX: usize = 2;
/// Messages that a publisher fills at once.
pub const LOANS_MAX: usize = 1;
/// Bytes that iceoryx2 puts before a message; rounded up.
const SAMPLE_HEADER_BYTES: usize = 64;
/// Registry, queues and event sets of one topic; measured below 100 kB for one of few ports.
const OVERHEAD_BYTES: u64 = 128 << 10;

/// 75 Hz through a stall of the reader of 0.8 s.
const SCAN_BUFFER: usize = 64;
/// 1.6 s of frames at 10 Hz, 0.2 s at 75 Hz: the mapper stalls only for a checkpoint's copy.
const FRAME_BUFFER: usize = 16;
/// Half of that: class maps are the largest messages of the hot path, and self-contained.
const CLASSES_BUFFER: usize = 8;
/// A burst of events while the journal waits for its disk; what overflows is sent again, because the
/// anomaly services keep what is not acknowledged.
const EVENT_BUFFER: usize = 256;
/// Health is a state: of a burst only the newest matters. The buffer is per publisher.
const HEALTH_BUFFER: usize = 4;
/// An encoded event change: texts are at most 2000 bytes, ids a few hundred.
const EVENT_BYTES_MAX: usize = 8 << 10;
/// An encoded acknowledgement: an id and a number.
const ACKNOWLEDGEMENT_BYTES_MAX: usize = 1 << 10;
/// An encoded ownership: 64 ids of 32 bytes.
const OWNERSHIP_BYTES_MAX: usize = 4 << 10;

impl TopicPlan {
    fn new<H: Header, E: Element>(topic: &Topic<H, E>, publishers: usize, readers: usize) -> Self {
        let payload_len_max = topic.payload_len_max();
        Self {
            name: topic.name().to_owned(),
            publishers,
            readers: readers + 1,
            buffer: 2,
            history: 0,
            payload_len_max,
            message_bytes_max: message_bytes::<H, E>(payload_len_max),
            required_readers: 0,
            create: create_topic::<H, E>,
        }
    }

    fn at_most<H: Header, E: Element>(mut self, _: &Topic<H, E>, payload_len_max: usize) -> Self {
        self.payload_len_max = payload_len_max;
        self.message_bytes_max = message_bytes::<H, E>(payload_len_max);
        self
    }

    fn buffered(mut self, buffer: usize, history: usize) -> Self {
        (self.buffer, self.history) = (buffer, history);
        self
    }

    fn lossless_for(mut self, readers: usize) -> Self {
        self.required_readers = readers;
        self
    }

    /// Messages for which a publisher has memory.
    #[must_use]
    pub fn messages_per_publisher(&self) -> usize {
        self.readers * (self.buffer + BORROWED_MAX) + self.history + LOANS_MAX
    }

    /// A lossless publisher is at most this far ahead of a reader: half the buffer, because a reader
    /// that comes back finds up to one window of its predecessor's messages already sent to it.
    #[must_use]
    pub fn window(&self) -> u64 {
        (self.buffer as u64 / 2).max(1)
    }

    /// Ports of publishers that may exist at once. A killed process keeps its port until the owner
    /// has swept up, and a node that dies while it starts may keep it for good; slots are cheap.
    #[must_use]
    pub fn publisher_slots(&self) -> usize {
        2 * self.publishers + 8
    }

    /// Ports of readers that may exist at once; see [`Self::publisher_slots`].
    #[must_use]
    pub fn reader_slots(&self) -> usize {
        2 * self.readers + 8
    }

    /// Shared memory in the worst case, bytes: every publisher's segment full, and one of a killed
    /// predecessor not yet swept up.
    #[must_use]
    pub fn bytes_max(&self) -> u64 {
        let segment = self.messages_per_publisher() as u64 * self.message_bytes_max as u64;
        (self.publishers as u64 + 1).saturating_mul(segment).saturating_add(OVERHEAD_BYTES)
    }
}

fn message_bytes<H, E>(payload_len_max: usize) -> usize {
    SAMPLE_HEADER_BYTES + size_of::<H>() + payload_len_max * size_of::<E>()
}

/// All topics of a site.
#[derive(Debug, Clone)]
pub struct Plan {
    /// One a topic.
    pub topics: Vec<TopicPlan>,
    /// Processes of the site.
    pub processes: usize,
}

impl Plan {
    /// The topics that the processes of `site` on `host` need (none for a site without hosts).
    #[must_use]
    pub fn new(site: &Site, host: Option<&str>) -> Self {
        let mut topics = Vec::new();
        // A bridge publishes the scans and events of other hosts, and reads scans and health here.
        let bridge = usize::from(site.has_bridges());
        // The recorder reads beside those for whom the messages are, and whoever is attached later.
        let recorder = |topics| {
            let wanted = site.recorder.as_ref().is_some_and(|recorder| recorder.records(topics));
            usize::from(wanted && site.records_on(host))
        };
        let (scans, maps) = (recorder(RecordedTopics::Scans), recorder(RecordedTopics::Maps));
        topics.extend(crossing_scans(site, host, scans));
        for area in site.areas_on(host) {
            let lasers = site.lasers.iter().filter(|laser| laser.area == area.id).count();
            // Of an area that may have to run elsewhere the bridge reads the scans, too.
            let shared = usize::from(area.standby.is_some());
            let scan = topic::scan(&area.id);
            let plan = TopicPlan::new(&scan, lasers, 1 + scans + shared).buffered(SCAN_BUFFER, 0);
            // A recording of a lossless replay has every scan as well.
            topics.push(plan.lossless_for(1 + scans));
            let [frames, classes, collapsed] = map_topics(area, 1 + bridge, 1 + maps + bridge);
            topics.extend([frames.lossless_for(1), classes.lossless_for(1), collapsed]);
        }
        for area in site.areas_followed_by(host) {
            topics.extend(map_topics(area, 0, maps)); // the bridge publishes them
        }
        let event = topic::event();
        let events = 1 + recorder(RecordedTopics::Events);
        let publishers = site.areas_on(host).count() + 1 + bridge;
        let plan = TopicPlan::new(&event, publishers, events).at_most(&event, EVENT_BYTES_MAX);
        topics.push(plan.buffered(EVENT_BUFFER, 0));
        // One acknowledgement an origin, so that each finds its own although others follow it.
        let acknowledgement = topic::event_acknowledgement();
        let standbys = site.areas.iter().filter(|area| area.standby.is_some()).count();
        let origins = site.areas.len() + standbys + 1 + bridge * site.hosts.len();
        let readers = site.areas_on(host).count() + 1 + bridge;
        let plan = TopicPlan::new(&acknowledgement, 1, readers)
            .at_most(&acknowledgement, ACKNOWLEDGEMENT_BYTES_MAX);
        topics.push(plan.buffered(2 * origins + 14, origins));
        let processes = Role::all(site, host).len();
        let health = TopicPlan::new(&topic::health(), processes, 1 + bridge);
        let health = health.buffered(HEALTH_BUFFER, 0);
        topics.push(health);
        if bridge > 0 {
            let ownership = topic::ownership();
            let plan = TopicPlan::new(&ownership, 1, 1).at_most(&ownership, OWNERSHIP_BYTES_MAX);
            topics.push(plan.buffered(2, 1)); // a state: the newest counts, a late reader gets it
        }
        Self { topics, processes }
    }

    /// The plan of a topic.
    #[must_use]
    pub fn topic(&self, name: &str) -> Option<&TopicPlan> {
        self.topics.iter().find(|topic| topic.name == name)
    }

    /// Nodes that a service must be able to know: every process, its predecessors that cannot be
    /// swept up (iceoryx2.md, section 3: up to 110 in 400 kills), tools.
    #[must_use]
    pub fn node_slots(&self) -> usize {
        2 * self.processes + 256
    }

    /// Shared memory in the worst case, bytes.
    #[must_use]
    pub fn bytes_max(&self) -> u64 {
        self.topics.iter().map(TopicPlan::bytes_max).fold(0, u64::saturating_add)
    }
}

/// Frames, class maps and collapsed maps of an area, for so many readers of the plan.
fn map_topics(area: &Area, of_frames: usize, of_maps: usize) -> [TopicPlan; 3] {
    let (id, grid) = (&area.id, area.grid());
    let frame = topic::frame(id, grid.plane_words());
    let classes = topic::classes(id, grid.cells());
    let collapsed = topic::collapsed(id, grid.cells(), area.class_names().len());
    // A message holds one context, so a late reader gets one of each.
    let contexts = area.contexts.len() + 1;
    [
        TopicPlan::new(&frame, 1, of_frames).buffered(FRAME_BUFFER, 0),
        TopicPlan::new(&classes, 1, of_maps).buffered(CLASSES_BUFFER, 0),
        TopicPlan::new(&collapsed, 1, of_maps).buffered(contexts.max(2), contexts),
    ]
}

/// Scans of lasers that run here for an area of another host: the bridge reads them, and a recorder.
fn crossing_scans(site: &Site, host: Option<&str>, recorders: usize) -> Vec<TopicPlan> {
    let elsewhere = site.areas.iter().filter(|area| !area.may_run_on(host));
    let plan = |area: &Area| {
        let lasers = site.lasers_on(host).filter(|laser| laser.area == area.id).count();
        let readers = 1 + recorders;
        let topic =
            || TopicPlan::new(&topic::scan(&area.id), lasers, readers).buffered(SCAN_BUFFER, 0);
        (lasers > 0).then(topic)
    };
    elsewhere.filter_map(plan).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn site(lasers: usize, side: u32) -> Site {
        let lasers: Vec<_> = (0..lasers)
            .map(|n| {
                serde_json::json!({ "id": format!("l{n}"), "area": "a", "x_m": 0.0, "y_m": 0.0,
                    "source": { "kind": "simulator", "scene": "none" } })
            })
            .collect();
        serde_json::from_value(serde_json::json!({
            "name": "s",
            "area": [{ "id": "a", "origin_m": [0.0, 0.0], "columns": side, "rows": side }],
            "laser": lasers,
        }))
        .unwrap()
    }

    #[test]
    fn a_foyer_of_two_lasers_fits_the_shared_memory_of_a_container() {
        let bytes = Plan::new(&site(2, 100), None).bytes_max();
        assert!(bytes < 64 << 20, "docker gives 64 MiB unless asked: {} MiB", bytes >> 20);
    }

    #[test]
    fn every_topic_of_the_vocabulary_is_planned_once() {
        let plan = Plan::new(&site(2, 10), None);
        let names: Vec<_> = plan.topics.iter().map(|topic| topic.name.as_str()).collect();
        let expected =
            ["scan/a", "frame/a", "classes/a", "collapsed/a", "event", "event-ack", "health"];
        assert_eq!(names, expected);
        assert_eq!(plan.processes, 1 + 3 + 2, "alerts, three of the area, two lasers");
        assert_eq!(plan.topic("scan/a").unwrap().publishers, 2);
    }

    #[test]
    fn a_recorder_has_a_place_of_its_own_at_what_it_records() {
        let mut recorded = site(2, 10);
        recorded.recorder = Some(protocol::site::Recorder {
            topics: vec![RecordedTopics::Scans, RecordedTopics::Events],
            ..Default::default()
        });
        let (without, with) = (Plan::new(&site(2, 10), None), Plan::new(&recorded, None));
        let more = |name: &str| {
            let of = |plan: &Plan| plan.topic(name).unwrap().readers;
            of(&with) - of(&without)
        };
        assert_eq!(["scan/a", "event", "classes/a", "collapsed/a"].map(more), [1, 1, 0, 0]);
        assert_eq!(with.topic("scan/a").unwrap().required_readers, 2);
        assert_eq!(with.processes, without.processes + 1);
    }

    #[test]
    fn two_windows_fit_a_buffer() {
        for topic in Plan::new(&site(1, 10), None).topics {
            assert!(topic.required_readers == 0 || 2 * topic.window() <= topic.buffer as u64);
        }
    }

    #[test]
    fn each_host_has_the_topics_of_its_own_processes() {
        let mut site = site(3, 10);
        let host = |id: &str, port: u16| protocol::site::Host {
            id: id.to_owned(),
            endpoint: format!("127.0.0.1:{port}"),
            transport: protocol::site::Transport::PlainTcp,
            desk: id == "desk",
            cores: 2,
            network_mbit_s: 1000,
            follows: Vec::new(),
            through: Vec::new(),
            certificate_number: 1,
        };
        site.hosts = vec![host("edge", 1), host("desk", 2)];
        site.areas[0].host = Some("desk".to_owned());
        for laser in &mut site.lasers[1..] {
            laser.host = Some("edge".to_owned());
        }
        let edge = Plan::new(&site, Some("edge"));
        let names: Vec<_> = edge.topics.iter().map(|topic| topic.name.as_str()).collect();
        assert_eq!(names, ["scan/a", "event", "event-ack", "health", "ownership"]);
        assert_eq!(edge.topic("scan/a").unwrap().publishers, 2);
        assert_eq!(edge.processes, 1 + 1 + 2, "alerts, bridge, two lasers");
        let desk = Plan::new(&site, Some("desk"));
        assert_eq!(desk.topics.len(), 8);
        let scans = desk.topic("scan/a").unwrap();
        assert_eq!(scans.publishers, 3, "its own laser, and two by the bridge");
        assert_eq!(desk.topic("event").unwrap().publishers, 1 + 1 + 1);
        assert_eq!(desk.processes, 1 + 1 + 3 + 1, "alerts, bridge, three of the area, a laser");
    }
}
