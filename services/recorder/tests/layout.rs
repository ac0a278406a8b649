//! The layout for Foxglove and Lichtblick shows what we write: every topic in it is one of the
//! recording of `deploy/foyer.toml`, of the type that its panel draws.
#![allow(clippy::unwrap_used)]

use protocol::site::{Recorder, Site};
use recorder::catalogue::Catalogue;
use recording::ros2::MessageType;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

fn deploy(file: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy").join(file);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Topics of the foyer's recording with their types, and the frames of its lasers.
fn written() -> (BTreeMap<String, MessageType>, Vec<String>) {
    let site = Site::parse(&deploy("foyer.toml"), "foyer.toml").unwrap();
    let catalogue = Catalogue::new(&site, &Recorder::default().topics);
    let topics = catalogue.topics.into_iter().map(|topic| (topic.name, topic.message_type));
    (topics.collect(), catalogue.lasers.into_iter().map(|laser| laser.frame).collect())
}

#[test]
fn every_topic_of_the_layout_is_one_that_we_write() {
    let layout: Value = serde_json::from_str(&deploy("foxglove-layout.json")).unwrap();
    let (topics, frames) = written();
    let panels = layout["configById"].as_object().unwrap();

    let plan = &panels["3D!plan"];
    let drawn = plan["topics"].as_object().unwrap();
    for topic in drawn.keys() {
        let drawable = [
            MessageType::LaserScan,
            MessageType::OccupancyGrid,
            MessageType::Grid,
            MessageType::MarkerArray,
        ];
        let found = topics.get(topic).unwrap_or_else(|| panic!("nobody writes {topic}"));
        assert!(drawable.contains(found), "{topic} is a {}", found.name());
    }
    for wanted in ["/laser_front/scan", "/area_foyer/classes", "/events/markers", "/zones"] {
        assert_eq!(drawn[wanted]["visible"], true, "{wanted}");
    }
    assert_eq!(plan["followTf"], recorder::catalogue::SITE_FRAME);
    for frame in plan["transforms"].as_object().unwrap().keys() {
        let frame = frame.strip_prefix("frame:").unwrap();
        assert!(frames.iter().any(|known| known == frame), "{frame} of {frames:?}");
    }

    let log = panels["RosOut!events"]["topicToRender"].as_str().unwrap();
    assert_eq!(topics[log], MessageType::Log);
    for path in panels["Plot!echoes"]["paths"].as_array().unwrap() {
        let topic = path["value"].as_str().unwrap().strip_suffix(".data").unwrap();
        assert_eq!(topics[topic], MessageType::Float32);
    }
}

#[test]
fn every_panel_of_the_layout_is_there_and_shown() {
    let layout: Value = serde_json::from_str(&deploy("foxglove-layout.json")).unwrap();
    fn shown<'a>(node: &'a Value, found: &mut Vec<&'a str>) {
        match node.as_str() {
            Some(panel) => found.push(panel),
            None => ["first", "second"].into_iter().for_each(|half| shown(&node[half], found)),
        }
    }
    let mut found = Vec::new();
    shown(&layout["layout"], &mut found);
    found.sort_unstable();
    let panels: Vec<&str> =
        layout["configById"].as_object().unwrap().keys().map(String::as_str).collect();
    assert_eq!(found, panels);
}
