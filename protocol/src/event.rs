//! What the security desk is told: events and their life, `raised -> updated -> cleared`.
//!
//! An event is a happening; an [`EventChange`] is one line of its story and is what travels.
//! `(origin, sequence)` names a change for ever: readers drop doubles by it and ask "all after n".

use crate::wire::{ENVELOPE_BYTES, Envelope, header};
use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

/// Longest text of a change, bytes: a few sentences. Longer texts are refused by the codec.
pub const TEXT_BYTES_MAX: usize = 2000;

/// Longest name of an origin, area, zone or event, bytes. The site file allows 32 for an id.
pub const NAME_BYTES_MAX: usize = 256;

/// Header of an encoded [`EventChange`] in shared memory.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
pub struct EventHeader {
    /// Common part; `source` is the area's index in the site file.
    pub envelope: Envelope,
    /// CLOCK_MONOTONIC at the publication of the scan that completed the deciding frame,
    /// nanoseconds: for latency only. 0 if a deadline did, or if this is sent again.
    pub completed_by_mono_ns: u64,
}
header!(EventHeader, "tog.EventHeader.v1", ENVELOPE_BYTES + 8);

/// What happened. The kind of an unusual event follows from the classes seen against those expected;
/// the rest are faults: a fault is not an intrusion, and silence is not peace.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum EventKind {
    /// Movement or presence where or when it is not normal.
    UnusualActivity,
    /// Somebody stays where people pass.
    Loitering,
    /// Something stands where nothing stood.
    ObjectLeft,
    /// Background that is gone: furniture moved, a wall opened.
    ObjectMissing,
    /// A door that stays open.
    DoorHeldOpen,
    /// Far more people than usual.
    Crowd,
    /// A laser delivers nothing.
    LaserSilent,
    /// A laser repeats itself.
    LaserStuck,
    /// A laser sees something close in most directions.
    LaserBlocked,
    /// Too many invalid readings.
    LaserBlinded,
    /// A laser's background does not match its own past.
    LaserMoved,
    /// Part of the area is not observed any more.
    CoverageLost,
    /// A service died and was started again.
    ProcessRestarted,
    /// The journal or a recording cannot be written.
    StorageFault,
}

impl EventKind {
    /// True for faults of the system, false for happenings in the building.
    #[must_use]
    pub fn is_fault(self) -> bool {
        use EventKind::*;
        match self {
            UnusualActivity | Loitering | ObjectLeft | ObjectMissing | DoorHeldOpen | Crowd => {
                false
            }
            LaserSilent | LaserStuck | LaserBlocked | LaserBlinded | LaserMoved | CoverageLost
            | ProcessRestarted | StorageFault => true,
        }
    }

    /// The kind as a person says it: "unusual activity".
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::UnusualActivity => "unusual activity",
            Self::Loitering => "loitering",
            Self::ObjectLeft => "object left",
            Self::ObjectMissing => "object missing",
            Self::DoorHeldOpen => "door held open",
            Self::Crowd => "crowd",
            Self::LaserSilent => "laser silent",
            Self::LaserStuck => "laser stuck",
            Self::LaserBlocked => "laser blocked",
            Self::LaserBlinded => "laser blinded",
            Self::LaserMoved => "laser moved",
            Self::CoverageLost => "coverage lost",
            Self::ProcessRestarted => "process restarted",
            Self::StorageFault => "storage fault",
        }
    }
}

/// Where an event is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EventState {
    /// Told for the first time.
    Raised,
    /// Grew, moved or changed its kind.
    Updated,
    /// Over.
    Cleared,
}

/// One change of one event: a line of `events.jsonl`, a row of the journal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EventChange {
    /// Who tells: the area's id, or `host` for faults of the host.
    pub origin: String,
    /// Grows by one a change of this origin, from 1, across restarts; of an origin that forgot its numbers see
    /// [`numbering`].
    pub sequence: u64,
    /// One id for one happening, the same in all its changes: `<origin>-<n>`.
    pub id: String,
    /// What happened.
    pub kind: EventKind,
    /// Where it is in its life.
    pub state: EventState,
    /// Stamp of the frame that decided this change, UNIX nanoseconds.
    pub stamp_ns: u64,
    /// Stamp of the first evidence of the happening, UNIX nanoseconds.
    pub first_evidence_ns: u64,
    /// The area's id; empty for faults of the host.
    pub area: String,
    /// Name of the zone that holds the place, if one does.
    pub zone: Option<String>,
    /// Centre of the place in site coordinates, metres; of the area for a fault.
    pub x_m: f64,
    /// See `x_m`.
    pub y_m: f64,
    /// Smallest and largest x and y of the place: [x_min, y_min, x_max, y_max], metres.
    pub bounds_m: [f64; 4],
    /// How strong the evidence is, in the units of `threshold`.
    pub score: f64,
    /// The level that the score had to pass.
    pub threshold: f64,
    /// True if the threshold had to be extrapolated beyond what the normal recordings prove.
    pub extrapolated: bool,
    /// What was seen against what is normal, in words a guard reads.
    pub text: String,
}

impl EventChange {
    /// Bounds that a journal needs and the codec does not know.
    ///
    /// # Errors
    /// A sentence with what was found and what was expected.
    pub fn check_fields(&self) -> Result<(), String> {
        let zone = self.zone.as_deref().unwrap_or_default();
        let names = [
            ("origin", self.origin.as_str()),
            ("id", &self.id),
            ("area", &self.area),
            ("zone", zone),
        ];
        for (field, name) in names {
            if name.len() > NAME_BYTES_MAX {
                let found = name.len();
                return Err(format!("{field} of {found} bytes, expected at most {NAME_BYTES_MAX}"));
            }
            if name.chars().any(char::is_control) {
                return Err(format!("{field} {name:?} holds control characters"));
            }
        }
        if self.origin.is_empty() || self.id.is_empty() {
            return Err("an empty origin or id, expected a name".to_owned());
        }
        if self.sequence == 0 {
            return Err("sequence 0, expected numbers from 1".to_owned());
        }
        // SQLite's integers end here; a stamp of the year 2262 is an error, not a time.
        let numbers = [self.sequence, self.stamp_ns, self.first_evidence_ns];
        match numbers.into_iter().find(|&number| number >= i64::MAX as u64) {
            Some(number) => {
                Err(format!("{number} as a sequence or stamp, expected below 2^63 - 1"))
            }
            None => Ok(()),
        }
    }
}

/// A numbering counts so many changes before it runs into numbers of the next second.
const NUMBERING_BITS: u32 = 20;
/// 2026-01-01, UNIX seconds.
const NUMBERING_BEGIN_S: u64 = 1_767_225_600;

/// Where an origin goes on that may have told changes which it does not remember: its state is lost, but
/// desks on other hosts have what it told. The numbers before the first change and before the first event,
/// above all that it gave before (unless the clock was wrong, or it told a million changes a second).
///
/// Whoever keeps its numbers on the disk of its only journal begins at 0 instead.
#[must_use]
pub fn numbering(unix_ns: u64) -> (u64, u64) {
    let seconds = (unix_ns / crate::time::SECOND_NS).saturating_sub(NUMBERING_BEGIN_S);
    (seconds << NUMBERING_BITS, seconds)
}

/// True if this sequence is the first of a [`numbering`]: nothing is missing before it, although its
/// origin told lower ones.
#[must_use]
pub fn begins_numbering(sequence: u64) -> bool {
    sequence >> NUMBERING_BITS > 0 && sequence & NUMBERING_MASK == 1
}

/// The bits of a sequence that count within its numbering.
pub const NUMBERING_MASK: u64 = (1 << NUMBERING_BITS) - 1;

/// Origin of the faults that the journal of a host tells of itself: `host.alerts`, and
/// `host.<host>.alerts` where a site has several hosts. No area has a dot in its id.
#[must_use]
pub fn journal_origin(host: Option<&str>) -> String {
    host.map_or_else(|| "host.alerts".to_owned(), |host| format!("host.{host}.alerts"))
}

/// From the journal to an origin: everything up to `sequence` is on disk; send what comes after.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct EventAcknowledgement {
    /// Whose changes.
    pub origin: String,
    /// The highest sequence up to which the journal has all; 0 if none.
    pub sequence: u64,
}
