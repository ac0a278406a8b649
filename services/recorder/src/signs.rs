//! Events, zones and poses as messages.

use crate::catalogue::{Catalogue, SITE_FRAME};
use protocol::event::{EventChange, EventState};
use protocol::site::{Site, Zone};
use recording::ros2::{
    self, Color, EncodeError, Header, Log, Marker, MarkerArray, Point, Pose, Quaternion, TfMessage,
    Time, Transform, TransformStamped,
};
use std::collections::BTreeMap;

/// Most events that are open at once; the oldest is forgotten first. A desk has lost its way long
/// before.
const OPEN_MAX: usize = 256;
/// Most origins whose changes are told apart: areas and the host.
const ORIGINS_MAX: usize = protocol::site::AREAS_MAX + 1;
/// Height of the box round an event: a person's.
const BOX_HEIGHT_M: f64 = 1.8;
/// Smallest side of it, so that it can be seen.
const SIDE_MIN_M: f64 = 0.1;
/// Height of the letters.
const LETTERS_M: f64 = 0.25;
const ALERT: Color = Color { r: 0.84, g: 0.37, b: 0.0, a: 0.6 };
const FAULT: Color = Color { r: 0.9, g: 0.62, b: 0.0, a: 0.4 };
const ZONE: Color = Color { r: 0.0, g: 0.45, b: 0.7, a: 0.8 };
const LETTERS: Color = Color { r: 1.0, g: 1.0, b: 1.0, a: 1.0 };

/// The events that are open, and what was told already.
#[derive(Debug, Default)]
pub struct Events {
    open: BTreeMap<String, EventChange>,
    /// Highest sequence by origin: what comes again was asked for by the journal.
    told: BTreeMap<String, u64>,
}

impl Events {
    /// Takes note of a change; false if it came before.
    pub fn is_new(&mut self, change: &EventChange) -> bool {
        if self.told.get(&change.origin).is_some_and(|told| change.sequence <= *told) {
            return false;
        }
        if self.told.len() < ORIGINS_MAX || self.told.contains_key(&change.origin) {
            self.told.insert(change.origin.clone(), change.sequence);
        }
        true
    }

    /// A change as a line of a log. Raised events warn, the rest informs; a fault that is raised
    /// is an error.
    ///
    /// # Errors
    /// See [`ros2::encode`].
    pub fn log(change: &EventChange, stamp: Time, buffer: &mut Vec<u8>) -> Result<(), EncodeError> {
        let level = match change.state {
            EventState::Raised if change.kind.is_fault() => Log::ERROR,
            EventState::Raised => Log::WARN,
            EventState::Updated | EventState::Cleared => Log::INFO,
        };
        let name = format!("tog.{}", change.origin);
        let state = match change.state {
            EventState::Raised => "raised",
            EventState::Updated => "updated",
            EventState::Cleared => "cleared",
        };
        let function = format!("{} {state}", change.kind.words());
        let message = Log {
            stamp,
            level,
            name: &name,
            msg: &change.text,
            file: &change.id,
            function: &function,
            line: u32::try_from(change.sequence).unwrap_or(u32::MAX),
        };
        ros2::encode(&message, 256 + change.text.len(), buffer)
    }

    /// All open events after a change, and the end of one that it clears: every message stands
    /// alone.
    ///
    /// # Errors
    /// See [`ros2::encode`].
    pub fn markers(
        &mut self,
        change: &EventChange,
        stamp: Time,
        buffer: &mut Vec<u8>,
    ) -> Result<(), EncodeError> {
        let mut gone = None;
        if change.state == EventState::Cleared {
            self.open.remove(&change.id);
            gone = Some(change);
        } else {
            self.open.insert(change.id.clone(), change.clone());
        }
        if self.open.len() > OPEN_MAX {
            let oldest = self.open.values().min_by_key(|change| change.first_evidence_ns);
            if let Some(id) = oldest.map(|change| change.id.clone()) {
                self.open.remove(&id);
            }
        }
        let words: Vec<String> =
            self.open.values().map(|open| format!("{} ({})", open.kind.words(), open.id)).collect();
        let mut markers = Vec::new();
        for (open, words) in self.open.values().zip(&words) {
            markers.extend(event_markers(open, words, stamp));
        }
        for kind in ["box", "words"].into_iter().filter(|_| gone.is_some()) {
            let id = gone.map_or(0, |change| marker_id(&change.id));
            let header = Header { stamp, frame_id: SITE_FRAME };
            let action = Marker::DELETE;
            markers.push(Marker { header, ns: kind, id, action, ..Marker::default() });
        }
        ros2::encode(&MarkerArray { markers }, 1024, buffer)
    }
}

/// A box where it is, and what it is above it.
fn event_markers<'a>(change: &EventChange, words: &'a str, stamp: Time) -> [Marker<'a>; 2] {
    let [x_min, y_min, x_max, y_max] = change.bounds_m;
    let middle = |z| Point { x: (x_min + x_max) / 2.0, y: (y_min + y_max) / 2.0, z };
    let at = |z| Pose { position: middle(z), ..Pose::default() };
    let common = Marker {
        header: Header { stamp, frame_id: SITE_FRAME },
        id: marker_id(&change.id),
        action: Marker::ADD,
        ..Marker::default()
    };
    let cube = Marker {
        ns: "box",
        kind: Marker::CUBE,
        pose: at(BOX_HEIGHT_M / 2.0),
        scale: Point {
            x: (x_max - x_min).max(SIDE_MIN_M),
            y: (y_max - y_min).max(SIDE_MIN_M),
            z: BOX_HEIGHT_M,
        },
        color: if change.kind.is_fault() { FAULT } else { ALERT },
        ..common.clone()
    };
    let text = Marker {
        ns: "words",
        kind: Marker::TEXT_VIEW_FACING,
        pose: at(BOX_HEIGHT_M + LETTERS_M),
        scale: Point { x: 0.0, y: 0.0, z: LETTERS_M },
        color: LETTERS,
        text: words,
        ..common
    };
    [cube, text]
}

/// A number for an id, the same in all changes of an event: FNV-1a, as a positive i32. Two open
/// events of the same number would hide one another; 256 of them do so once in 65 000 times.
fn marker_id(id: &str) -> i32 {
    let hash = id
        .bytes()
        .fold(0x811c_9dc5_u32, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
    (hash >> 1) as i32
}

/// The zones of all areas: an outline and its name.
///
/// # Errors
/// See [`ros2::encode`].
pub fn zones(site: &Site, stamp: Time, buffer: &mut Vec<u8>) -> Result<(), EncodeError> {
    let zones = || site.areas.iter().flat_map(|area| &area.zones);
    let mut markers = Vec::new();
    for (zone, id) in zones().zip(0..) {
        markers.extend(zone_markers(zone, id, stamp));
    }
    ros2::encode(&MarkerArray { markers }, 4096, buffer)
}

fn zone_markers(zone: &Zone, id: i32, stamp: Time) -> [Marker<'_>; 2] {
    let corner = |[x, y]: &[f64; 2]| Point { x: *x, y: *y, z: 0.0 };
    let mut points: Vec<Point> = zone.polygon_m.iter().map(corner).collect();
    let count = points.len().max(1) as f64;
    let centre = points.iter().fold(Point::default(), |sum, point| Point {
        x: sum.x + point.x / count,
        y: sum.y + point.y / count,
        z: 0.0,
    });
    points.extend(points.first().copied()); // closed
    let common = Marker {
        header: Header { stamp, frame_id: SITE_FRAME },
        id,
        action: Marker::ADD,
        ..Marker::default()
    };
    let outline = Marker {
        ns: "outline",
        kind: Marker::LINE_STRIP,
        scale: Point { x: 0.03, y: 0.0, z: 0.0 }, // width of the line
        color: ZONE,
        points,
        ..common.clone()
    };
    let name = Marker {
        ns: "name",
        kind: Marker::TEXT_VIEW_FACING,
        pose: Pose { position: centre, ..Pose::default() },
        scale: Point { x: 0.0, y: 0.0, z: LETTERS_M },
        color: LETTERS,
        text: &zone.name,
        ..common
    };
    [outline, name]
}

/// Where the lasers are: `map` -> `laser_<id>`.
///
/// # Errors
/// See [`ros2::encode`].
pub fn transforms(
    site: &Site,
    catalogue: &Catalogue,
    stamp: Time,
    buffer: &mut Vec<u8>,
) -> Result<(), EncodeError> {
    let lasers = site.lasers.iter().zip(&catalogue.lasers);
    let transforms = lasers.map(|(laser, topics)| {
        let pose = laser.pose();
        TransformStamped {
            header: Header { stamp, frame_id: SITE_FRAME },
            child_frame_id: &topics.frame,
            transform: Transform {
                translation: Point { x: pose.x_m, y: pose.y_m, z: 0.0 },
                rotation: Quaternion::of_yaw(pose.yaw_rad),
            },
        }
    });
    ros2::encode(&TfMessage { transforms: transforms.collect() }, 1024, buffer)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use protocol::event::EventKind;

    fn change(id: &str, sequence: u64, state: EventState) -> EventChange {
        EventChange {
            origin: "hall".to_owned(),
            sequence,
            id: id.to_owned(),
            kind: EventKind::Loitering,
            state,
            stamp_ns: 0,
            first_evidence_ns: sequence,
            area: "hall".to_owned(),
            zone: None,
            x_m: 0.0,
            y_m: 0.0,
            bounds_m: [0.0, 0.0, 1.0, 1.0],
            score: 1.0,
            threshold: 1.0,
            extrapolated: false,
            text: "Somebody stands.".to_owned(),
        }
    }

    /// Count of the markers, in front of them.
    fn count(buffer: &[u8]) -> u32 {
        u32::from_le_bytes(buffer[4..8].try_into().unwrap())
    }

    #[test]
    fn a_change_that_is_sent_again_is_not_new() {
        let mut events = Events::default();
        assert!(events.is_new(&change("hall-1", 1, EventState::Raised)));
        assert!(events.is_new(&change("hall-1", 2, EventState::Updated)));
        assert!(!events.is_new(&change("hall-1", 1, EventState::Raised)));
        let other =
            EventChange { origin: "host".to_owned(), ..change("h-1", 1, EventState::Raised) };
        assert!(events.is_new(&other));
    }

    #[test]
    fn every_message_shows_all_open_events_and_takes_away_what_is_over() {
        let (mut events, mut buffer) = (Events::default(), Vec::new());
        let mut markers = |id, state| {
            events.markers(&change(id, 1, state), Time::default(), &mut buffer).unwrap();
            count(&buffer)
        };
        assert_eq!(markers("hall-1", EventState::Raised), 2);
        assert_eq!(markers("hall-2", EventState::Raised), 4);
        assert_eq!(markers("hall-2", EventState::Updated), 4);
        assert_eq!(markers("hall-1", EventState::Cleared), 2 + 2, "one stays, one is deleted");
        assert_eq!(markers("hall-2", EventState::Cleared), 2);
    }

    #[test]
    fn open_events_are_bounded() {
        let (mut events, mut buffer) = (Events::default(), Vec::new());
        for n in 0..2 * OPEN_MAX as u64 {
            let change = change(&format!("hall-{n}"), n + 1, EventState::Raised);
            events.markers(&change, Time::default(), &mut buffer).unwrap();
        }
        assert_eq!(count(&buffer) as usize, 2 * OPEN_MAX);
        assert!(events.open.contains_key("hall-511") && !events.open.contains_key("hall-0"));
    }
}
