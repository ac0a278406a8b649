//! The only place with names of topics.
//!
//! | topic | message | publishers | readers |
//! |---|---|---|---|
//! | `scan/<area>` | scans | lasers of the area | fusion, recorder |
//! | `frame/<area>` | frames | fusion | mapper, recorder, bridge |
//! | `classes/<area>` | class maps | mapper | anomaly, recorder, bridge |
//! | `collapsed/<area>` | collapsed maps | mapper | anomaly, recorder, bridge |
//! | `event` | event changes | anomaly of each area, supervisor | alerts, recorder, bridge |
//! | `event-ack` | acknowledgements | alerts | anomaly, supervisor |
//! | `health` | health | everybody | supervisor, bridge |
//! | `ownership` | which areas run here | bridge | supervisor |
//!
//! Between hosts, as keys of zenoh (ids of a site file are chunks of keys as they are):
//!
//! | key | message | from | to |
//! |---|---|---|---|
//! | `tog/<site>/<host>/scan/<laser>` | `CarriedScan` | the laser's host | the area's host |
//! | `tog/<site>/<host>/health` | `HostHealth` | every host | every host |
//! | `tog/<site>/<host>/event/live` | `EventPage` | every host | desks |
//! | `tog/<site>/<host>/event/log?after=<n>` | `EventPage`, one reply | every host | who asks |
//! | `tog/<site>/<host>/frame/<area>` | `CarriedMap` | hosts of the area | who asks |
//! | `tog/<site>/<host>/classes/<area>` | `CarriedMap` | hosts of the area | who asks |
//! | `tog/<site>/<host>/collapsed/<area>` | `CarriedCounts` | hosts of the area | who asks |
//! | `tog/<site>/<host>/alive` | a liveliness token | hosts of areas with a standby | the other one |
//! | `tog/<site>/<host>/claim` | `Claims` | hosts of areas with a standby | the other one |
//! | `tog/<site>/<host>/replica/<area>?..` | `FilePage`, one reply | the owner | its standby |

use crate::event::EventHeader;
use crate::frame::FrameHeader;
use crate::grid::{ClassMapHeader, CollapsedMapHeader};
use crate::scan::ScanHeader;
use crate::wire::{BytesHeader, Header};
use bytemuck::Pod;
use std::fmt;
use std::marker::PhantomData;

/// A named stream of messages with header `H` and payload `[E]`.
pub struct Topic<H, E> {
    name: String,
    payload_len_max: usize,
    types: PhantomData<fn() -> (H, E)>,
}

impl<H: Header, E: Pod> Topic<H, E> {
    fn new(name: String, payload_len_max: usize) -> Self {
        Self { name, payload_len_max, types: PhantomData }
    }

    /// Its name, unique in the site.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Longest payload in elements; shared memory is laid out for it.
    #[must_use]
    pub fn payload_len_max(&self) -> usize {
        self.payload_len_max
    }
}

impl<H, E> Clone for Topic<H, E> {
    fn clone(&self) -> Self {
        Self { name: self.name.clone(), payload_len_max: self.payload_len_max, types: PhantomData }
    }
}

impl<H, E> fmt::Debug for Topic<H, E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "topic {}", self.name)
    }
}

/// Largest encoded health or event message, bytes.
pub const BYTES_MAX: usize = 64 * 1024;

/// Scans of the lasers of an area.
#[must_use]
pub fn scan(area: &str) -> Topic<ScanHeader, f32> {
    Topic::new(format!("scan/{area}"), crate::scan::BEAMS_MAX)
}

/// Frames of an area with bit planes of `plane_words` words.
#[must_use]
pub fn frame(area: &str, plane_words: usize) -> Topic<FrameHeader, u64> {
    Topic::new(format!("frame/{area}"), 2 * plane_words)
}

/// Class maps of an area of `cells` cells.
#[must_use]
pub fn classes(area: &str, cells: usize) -> Topic<ClassMapHeader, u8> {
    Topic::new(format!("classes/{area}"), cells)
}

/// Collapsed maps of an area of `cells` cells and `classes` classes.
#[must_use]
pub fn collapsed(area: &str, cells: usize, classes: usize) -> Topic<CollapsedMapHeader, u64> {
    Topic::new(format!("collapsed/{area}"), cells * classes)
}

/// Encoded `EventChange`s.
#[must_use]
pub fn event() -> Topic<EventHeader, u8> {
    Topic::new("event".to_owned(), BYTES_MAX)
}

/// Encoded `EventAcknowledgement`s.
#[must_use]
pub fn event_acknowledgement() -> Topic<BytesHeader, u8> {
    Topic::new("event-ack".to_owned(), BYTES_MAX)
}

/// Encoded `Health`.
#[must_use]
pub fn health() -> Topic<BytesHeader, u8> {
    Topic::new("health".to_owned(), BYTES_MAX)
}

/// Encoded `Ownership`.
#[must_use]
pub fn ownership() -> Topic<BytesHeader, u8> {
    Topic::new("ownership".to_owned(), BYTES_MAX)
}

/// Key of the scans of a laser between hosts.
#[must_use]
pub fn scan_key(site: &str, host: &str, laser: &str) -> String {
    format!("tog/{site}/{host}/scan/{laser}")
}

/// Key of the health of all services of a host.
#[must_use]
pub fn health_key(site: &str, host: &str) -> String {
    format!("tog/{site}/{host}/health")
}

/// Key of the events of a host as they come, and of the head of its journal.
#[must_use]
pub fn live_key(site: &str, host: &str) -> String {
    format!("tog/{site}/{host}/event/live")
}

/// Key under which the journal of a host answers.
#[must_use]
pub fn log_key(site: &str, host: &str) -> String {
    format!("tog/{site}/{host}/event/log")
}

/// Key of the frames of an area that `host` may run.
#[must_use]
pub fn frame_key(site: &str, host: &str, area: &str) -> String {
    format!("tog/{site}/{host}/frame/{area}")
}

/// Key of the class maps of an area that `host` may run.
#[must_use]
pub fn classes_key(site: &str, host: &str, area: &str) -> String {
    format!("tog/{site}/{host}/classes/{area}")
}

/// Key of the collapsed maps of an area that `host` may run, all contexts.
#[must_use]
pub fn collapsed_key(site: &str, host: &str, area: &str) -> String {
    format!("tog/{site}/{host}/collapsed/{area}")
}

/// Key of the liveliness token of a host.
#[must_use]
pub fn alive_key(site: &str, host: &str) -> String {
    format!("tog/{site}/{host}/alive")
}

/// Key of what a host says of the areas that it may run.
#[must_use]
pub fn claim_key(site: &str, host: &str) -> String {
    format!("tog/{site}/{host}/claim")
}

/// Key under which the files of an area are answered.
#[must_use]
pub fn replica_key(site: &str, host: &str, area: &str) -> String {
    format!("tog/{site}/{host}/replica/{area}")
}
