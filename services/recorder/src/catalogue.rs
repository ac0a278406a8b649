//! Which topics a site has in a recording, and what they are called.

use protocol::site::{Area, RecordedTopics, Site, Source};
use recording::TopicSpec;
use recording::ros2::MessageType;
use std::collections::{BTreeMap, BTreeSet};

/// Name of the site's coordinates: the fixed frame that RViz and Nav2 expect.
pub const SITE_FRAME: &str = "map";
/// Highest value of an OccupancyGrid.
const FULL: usize = 100;

/// The topics of a recording; the numbers are those of [`Catalogue::topics`].
#[derive(Debug, Clone, PartialEq)]
pub struct Catalogue {
    /// All of them.
    pub topics: Vec<TopicSpec>,
    /// One a laser, in the order of the site file.
    pub lasers: Vec<LaserTopics>,
    /// One an area, in the order of the site file; empty if maps are not recorded.
    pub areas: Vec<AreaTopics>,
    /// Events, if they are recorded.
    pub events: Option<EventTopics>,
    /// Where the lasers are.
    pub tf_static: usize,
}

/// The topics of a laser.
#[derive(Debug, Clone, PartialEq)]
pub struct LaserTopics {
    /// Name of its coordinates.
    pub frame: String,
    /// Its scans and the share of echoes, if scans are recorded.
    pub scans: Option<(usize, usize)>,
    /// Time of a turn, seconds; 0 if the site file does not say.
    pub scan_time_s: f32,
}

/// The topics of an area.
#[derive(Debug, Clone, PartialEq)]
pub struct AreaTopics {
    /// The class map.
    pub classes: usize,
    /// One a context: the counts, then the percent of each class.
    pub contexts: Vec<(usize, Vec<usize>)>,
}

/// The topics of events.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EventTopics {
    /// Their words.
    pub log: usize,
    /// Their places.
    pub markers: usize,
    /// The zones.
    pub zones: usize,
}

/// Value of a class in the class map: evenly from 0 to 100, so that they are told apart in any
/// viewer and read back exactly.
#[must_use]
pub fn class_value(class: usize, classes: usize) -> u8 {
    let steps = classes.saturating_sub(1).max(1);
    (class * FULL / steps).min(FULL) as u8
}

impl Catalogue {
    /// The topics of a site of which these groups are recorded.
    #[must_use]
    pub fn new(site: &Site, groups: &[RecordedTopics]) -> Self {
        let mut topics = Topics::default();
        let tf_static = topics.add(latched("/tf_static".to_owned(), MessageType::TfMessage));
        let has = |group| groups.contains(&group);
        let mut names = Names::default();
        let lasers = site
            .lasers
            .iter()
            .map(|laser| {
                let frame = names.unique(format!("laser_{}", ros_name(&laser.id)));
                let scans = has(RecordedTopics::Scans).then(|| {
                    let scan = TopicSpec::new(format!("/{frame}/scan"), MessageType::LaserScan);
                    let share = format!("/{frame}/echo_share");
                    (topics.add(scan), topics.add(TopicSpec::new(share, MessageType::Float32)))
                });
                let scan_time_s = match laser.source {
                    Source::Simulator { rate_hz, .. } => (1.0 / rate_hz) as f32,
                    Source::Replay { .. } => 0.0,
                };
                LaserTopics { frame, scans, scan_time_s }
            })
            .collect();
        let areas = if has(RecordedTopics::Maps) { &site.areas[..] } else { &[] };
        let areas = areas.iter().map(|area| area_topics(area, &mut names, &mut topics)).collect();
        let events = has(RecordedTopics::Events).then(|| EventTopics {
            log: topics.add(TopicSpec::new("/events", MessageType::Log)),
            markers: topics.add(latched("/events/markers".to_owned(), MessageType::MarkerArray)),
            zones: topics.add(latched("/zones".to_owned(), MessageType::MarkerArray)),
        });
        Self { topics: topics.0, lasers, areas, events, tf_static }
    }
}

fn area_topics(area: &Area, names: &mut Names, topics: &mut Topics) -> AreaTopics {
    let prefix = names.unique(format!("area_{}", ros_name(&area.id)));
    let classes = area.class_names();
    let mut class_map = latched(format!("/{prefix}/classes"), MessageType::OccupancyGrid);
    for class in &classes {
        let value = class_value(usize::from(class.id), classes.len());
        class_map.notes.insert(format!("value_{value}"), class.name.clone());
    }
    let class_map = topics.add(class_map);
    let mut contexts_taken = Names::default();
    let contexts = area
        .context_names()
        .into_iter()
        .map(|context| {
            let context = contexts_taken.unique(ros_name(context));
            let base = format!("/{prefix}/maps/{context}");
            let counts = topics.add(latched(format!("{base}/counts"), MessageType::Grid));
            // `counts` is taken already, whatever the classes are called.
            let mut taken = Names(BTreeSet::from(["counts".to_owned()]));
            let of_class = classes.iter().map(|class| {
                let name = taken.unique(ros_name(&class.name));
                topics.add(latched(format!("{base}/{name}"), MessageType::OccupancyGrid))
            });
            (counts, of_class.collect())
        })
        .collect();
    AreaTopics { classes: class_map, contexts }
}

fn latched(name: String, message_type: MessageType) -> TopicSpec {
    TopicSpec { name, message_type, is_latched: true, notes: BTreeMap::new() }
}

#[derive(Default)]
struct Topics(Vec<TopicSpec>);

impl Topics {
    fn add(&mut self, topic: TopicSpec) -> usize {
        self.0.push(topic);
        self.0.len() - 1
    }
}

/// Names that were given.
#[derive(Default)]
struct Names(BTreeSet<String>);

impl Names {
    /// The name, or with a number behind it if it is taken: `a-b` and `a_b` are two ids, but one
    /// name.
    fn unique(&mut self, name: String) -> String {
        let numbered = (2..).map(|number| format!("{name}_{number}"));
        let mut candidates = std::iter::once(name.clone()).chain(numbered);
        let free = candidates.find(|candidate| !self.0.contains(candidate)).unwrap_or(name);
        self.0.insert(free.clone());
        free
    }
}

/// An id as a part of a name of ROS: letters, digits, `_`, and no digit in front.
fn ros_name(id: &str) -> String {
    let name: String =
        id.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if name.starts_with(|c: char| c.is_ascii_digit()) { format!("_{name}") } else { name }
}

#[cfg(test)]
pub(crate) mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// Two lasers whose ids are one name in ROS, an area of four cells, and a context.
    pub(crate) fn site() -> Site {
        let text = r#"
            name = "t"
            [recorder]
            [[area]]
            id = "hall-1"
            origin_m = [1.0, 2.0]
            cell_m = 0.5
            columns = 2
            rows = 2
            [[area.context]]
            name = "night"
            from = "22:00"
            to = "06:00"
            [[area.zone]]
            name = "door"
            polygon_m = [[1.0, 2.0], [2.0, 2.0], [2.0, 3.0]]
            [[laser]]
            id = "a-b"
            area = "hall-1"
            x_m = 1.5
            y_m = 2.5
            yaw_deg = 90
            source = { kind = "simulator", scene = "room", rate_hz = 10 }
            [[laser]]
            id = "a_b"
            area = "hall-1"
            x_m = 0
            y_m = 0
            source = { kind = "simulator", scene = "room", rate_hz = 10 }
        "#;
        Site::parse(text, "t.toml").unwrap_or_else(|errors| panic!("{errors}"))
    }

    const ALL: [RecordedTopics; 3] =
        [RecordedTopics::Scans, RecordedTopics::Maps, RecordedTopics::Events];

    #[test]
    fn every_name_is_one_that_ros_takes_and_no_two_are_the_same() {
        let catalogue = Catalogue::new(&site(), &ALL);
        let names: BTreeSet<&str> = catalogue.topics.iter().map(|t| t.name.as_str()).collect();
        assert_eq!(names.len(), catalogue.topics.len());
        for name in &names {
            let parts = name.strip_prefix('/').unwrap().split('/');
            for part in parts {
                assert!(part.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_'), "{name}");
                assert!(part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_'), "{name}");
            }
        }
        for wanted in [
            "/laser_a_b/scan",
            "/laser_a_b_2/scan",
            "/area_hall_1/classes",
            "/area_hall_1/maps/always/background",
            "/area_hall_1/maps/night/counts",
            "/events",
            "/tf_static",
        ] {
            assert!(names.contains(wanted), "{wanted} of {names:?}");
        }
    }

    #[test]
    fn what_is_not_recorded_has_no_topic() {
        let catalogue = Catalogue::new(&site(), &[RecordedTopics::Events]);
        let names: Vec<&str> = catalogue.topics.iter().map(|t| t.name.as_str()).collect();
        assert_eq!(names, ["/tf_static", "/events", "/events/markers", "/zones"]);
    }

    #[test]
    fn values_of_classes_are_all_different() {
        for classes in 1..=16 {
            let values: BTreeSet<u8> = (0..classes).map(|c| class_value(c, classes)).collect();
            assert_eq!(values.len(), classes);
            assert!(values.iter().all(|value| *value <= 100));
        }
    }
}
