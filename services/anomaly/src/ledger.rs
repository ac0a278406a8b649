//! The numbers and the common parts of every change.

use crate::place::{Bounds, millimetres, zone_at};
use crate::words;
use protocol::event::{EventChange, EventKind, EventState, TEXT_BYTES_MAX};
use protocol::site::Zone;

/// Gives every event its id and every change its sequence.
#[derive(Debug, Clone)]
pub(crate) struct Ledger {
    area: String,
    /// In whose name: the area's, unless told otherwise.
    pub(crate) origin: String,
    zones: Vec<Zone>,
    next_sequence: u64,
    next_number: u64,
}

/// What differs from change to change.
pub(crate) struct Entry {
    pub(crate) number: u64,
    pub(crate) kind: EventKind,
    pub(crate) state: EventState,
    pub(crate) stamp_ns: u64,
    pub(crate) first_ns: u64,
    pub(crate) at_m: [f64; 2],
    pub(crate) bounds: Bounds,
    pub(crate) score: f64,
    pub(crate) threshold: f64,
    pub(crate) extrapolated: bool,
    pub(crate) text: String,
}

impl Ledger {
    pub(crate) fn new(area: &str, zones: &[Zone]) -> Self {
        Self {
            area: area.to_owned(),
            origin: area.to_owned(),
            zones: zones.to_vec(),
            next_sequence: 1,
            next_number: 1,
        }
    }

    /// Goes on after what was told before a restart.
    pub(crate) fn resume(&mut self, last_sequence: u64, last_number: u64) {
        self.next_sequence = self.next_sequence.max(last_sequence.saturating_add(1));
        self.next_number = self.next_number.max(last_number.saturating_add(1));
    }

    /// The number of a new event.
    pub(crate) fn number(&mut self) -> u64 {
        let number = self.next_number;
        self.next_number += 1;
        number
    }

    /// A point in words.
    pub(crate) fn place(&self, at_m: [f64; 2]) -> String {
        words::place(&self.area, self.zone(at_m), at_m)
    }

    /// The zone of a point.
    fn zone(&self, at_m: [f64; 2]) -> Option<&str> {
        zone_at(&self.zones, at_m)
    }

    pub(crate) fn change(&mut self, entry: Entry) -> EventChange {
        let sequence = self.next_sequence;
        self.next_sequence += 1;
        let mut text = entry.text;
        let end = (0..=text.len().min(TEXT_BYTES_MAX)).rev().find(|at| text.is_char_boundary(*at));
        text.truncate(end.unwrap_or(0));
        EventChange {
            origin: self.origin.clone(),
            sequence,
            id: format!("{}-{}", self.origin, entry.number),
            kind: entry.kind,
            state: entry.state,
            stamp_ns: entry.stamp_ns,
            first_evidence_ns: entry.first_ns,
            area: self.area.clone(),
            zone: self.zone(entry.at_m).map(str::to_owned),
            x_m: entry.at_m[0],
            y_m: entry.at_m[1],
            bounds_m: entry.bounds,
            score: millimetres(entry.score),
            threshold: millimetres(entry.threshold),
            extrapolated: entry.extrapolated,
            text,
        }
    }
}

/// The number in the id `<origin>-<n>` of an event of this origin.
pub(crate) fn number_of(origin: &str, id: &str) -> Option<u64> {
    id.strip_prefix(origin)?.strip_prefix('-')?.parse().ok()
}
