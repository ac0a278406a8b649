//! What the tests of this crate share.

use protocol::event::{EventChange, EventKind, EventState, NUMBERING_MASK};

/// A change like those of a foyer; every field differs with `sequence`.
pub(crate) fn change(origin: &str, sequence: u64) -> EventChange {
    let n = sequence as f64;
    EventChange {
        origin: origin.to_owned(),
        sequence,
        id: format!("{origin}-{sequence}"),
        kind: EventKind::UnusualActivity,
        state: EventState::Raised,
        stamp_ns: 1_794_976_001_000_000_000 + (sequence & NUMBERING_MASK) * 100_000_000,
        first_evidence_ns: 1_794_976_000_000_000_000,
        area: "foyer".to_owned(),
        zone: Some("door".to_owned()),
        x_m: 1.0 + 0.1 * n,
        y_m: 2.0,
        bounds_m: [0.5, 1.5, 1.5 + 0.1 * n, 2.5],
        score: 12.3 + n,
        threshold: 9.0,
        extrapolated: false,
        text: "a person-sized area is lingering; here 99.7 % of 41 h is empty".to_owned(),
    }
}
