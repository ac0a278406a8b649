//! Live classes against the collapsed map: events.
