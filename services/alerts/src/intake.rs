//! In order, and nothing that is not an event: what arrives is checked, sorted per origin by
//! sequence number, and handed on without holes.
//!
//! A change behind a hole is held until the missing one comes (the origin sends again when it is
//! acknowledged), at most [`GAP_WAIT_NS`] or [`HELD_MAX`] changes. Then the hole is given up, which
//! the caller journals: late and with a warning, but never silent. Pure: time is an argument
//! (CLOCK_MONOTONIC, nanoseconds).

use protocol::event::{EventChange, begins_numbering};
use std::collections::BTreeMap;

/// Most origins: a site has at most 64 areas and a few hosts; the rest is for areas that were
/// renamed.
pub const ORIGINS_MAX: usize = 512;
/// Most changes held behind a hole, per origin: it writes a few a minute, so this is an hour.
pub const HELD_MAX: usize = 256;
/// How long a hole is waited for: an origin sends what is not acknowledged again every 5 s, and one
/// that restarts is back within 2 s; so it had two chances.
pub const GAP_WAIT_NS: u64 = 12 * protocol::time::SECOND_NS;

/// What became of a change.
#[derive(Debug, Clone, PartialEq)]
pub enum Offered {
    /// These changes are next, in order; often just the one.
    Ready(Vec<EventChange>),
    /// Held behind a hole. True if the hole is new: time to ask the origin again.
    Held(bool),
    /// Its number was handed on before, or given up.
    Before(Box<EventChange>),
    /// No room for another origin.
    TooManyOrigins,
}

/// A hole that nobody filled.
#[derive(Debug, Clone, PartialEq)]
pub struct GivenUp {
    /// Whose.
    pub origin: String,
    /// First missing sequence.
    pub first: u64,
    /// Last missing sequence.
    pub last: u64,
    /// What was held behind it and is next now, in order.
    pub ready: Vec<EventChange>,
}

#[derive(Debug)]
struct Origin {
    next: u64,
    held: BTreeMap<u64, EventChange>,
    waits_since_ns: u64,
}

impl Origin {
    fn take_ready(&mut self) -> Vec<EventChange> {
        let mut ready = Vec::new();
        while let Some(change) = self.held.remove(&self.next) {
            ready.push(change);
            self.next += 1;
        }
        ready
    }

    fn deadline_ns(&self) -> Option<u64> {
        let wait_ns = if self.held.len() >= HELD_MAX { 0 } else { GAP_WAIT_NS };
        (!self.held.is_empty()).then(|| self.waits_since_ns.saturating_add(wait_ns))
    }
}

/// The order of all origins.
#[derive(Debug, Default)]
pub struct Intake {
    origins: BTreeMap<String, Origin>,
}

impl Intake {
    /// An origin whose changes up to `through` are known already.
    pub fn know(&mut self, origin: &str, through: u64) {
        let next = through.saturating_add(1);
        let known = self.origins.entry(origin.to_owned()).or_insert_with(|| Origin {
            next,
            held: BTreeMap::new(),
            waits_since_ns: 0,
        });
        known.next = known.next.max(next);
    }

    /// The sequence that `origin` is expected to send next; none if it is unknown.
    #[must_use]
    pub fn next_of(&self, origin: &str) -> Option<u64> {
        self.origins.get(origin).map(|known| known.next)
    }

    /// All origins with the sequence expected next.
    pub fn expected(&self) -> impl Iterator<Item = (&str, u64)> {
        self.origins.iter().map(|(origin, known)| (origin.as_str(), known.next))
    }

    /// Takes a change that passed [`EventChange::check_fields`].
    pub fn offer(&mut self, change: EventChange, mono_ns: u64) -> Offered {
        if !self.origins.contains_key(&change.origin) {
            if self.origins.len() >= ORIGINS_MAX {
                return Offered::TooManyOrigins;
            }
            self.know(&change.origin, 0);
        }
        let Some(origin) = self.origins.get_mut(&change.origin) else {
            return Offered::TooManyOrigins;
        };
        if change.sequence < origin.next {
            return Offered::Before(Box::new(change));
        }
        if change.sequence == origin.next || begins_numbering(change.sequence) {
            // Where a numbering begins: what is missing before, its origin has forgotten.
            let later = origin.held.split_off(&change.sequence);
            let before = std::mem::replace(&mut origin.held, later).into_values();
            origin.next = change.sequence;
            origin.held.insert(change.sequence, change);
            return Offered::Ready(before.chain(origin.take_ready()).collect());
        }
        let is_new = origin.held.is_empty();
        if is_new {
            origin.waits_since_ns = mono_ns;
        }
        if origin.held.len() < HELD_MAX {
            origin.held.insert(change.sequence, change);
        }
        // What finds no room is not acknowledged, so its origin will send it again.
        Offered::Held(is_new)
    }

    /// When [`Intake::expire`] has something to do, if ever.
    #[must_use]
    pub fn deadline_ns(&self) -> Option<u64> {
        self.origins.values().filter_map(Origin::deadline_ns).min()
    }

    /// Gives up the holes whose time is over. A second hole behind the first waits anew.
    pub fn expire(&mut self, mono_ns: u64) -> Vec<GivenUp> {
        let mut given_up = Vec::new();
        for (name, origin) in &mut self.origins {
            if origin.deadline_ns().is_none_or(|deadline_ns| mono_ns < deadline_ns) {
                continue;
            }
            let Some((&sequence, _)) = origin.held.first_key_value() else { continue };
            let first = std::mem::replace(&mut origin.next, sequence);
            let ready = origin.take_ready();
            origin.waits_since_ns = mono_ns;
            given_up.push(GivenUp { origin: name.clone(), first, last: sequence - 1, ready });
        }
        given_up
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::testing::change;
    use proptest::prelude::*;

    fn sequences(changes: &[EventChange]) -> Vec<u64> {
        changes.iter().map(|change| change.sequence).collect()
    }

    #[test]
    fn an_origin_that_forgot_its_numbers_goes_on_at_once() {
        let mut intake = Intake::default();
        intake.know("foyer", 4);
        intake.offer(change("foyer", 6), 10);
        let (begin, _) = protocol::event::numbering(1_795_000_000_000_000_000);
        let Offered::Ready(ready) = intake.offer(change("foyer", begin + 1), 11) else { panic!() };
        assert_eq!(sequences(&ready), [6, begin + 1], "5 is forgotten");
        assert_eq!(intake.deadline_ns(), None);
        assert_eq!(intake.offer(change("foyer", begin + 3), 12), Offered::Held(true));
        assert!(matches!(intake.offer(change("foyer", 5), 13), Offered::Before(_)));
        let Offered::Ready(ready) = intake.offer(change("foyer", begin + 2), 14) else { panic!() };
        assert_eq!(sequences(&ready), [begin + 2, begin + 3]);
        let Offered::Ready(ready) = intake.offer(change("hall", begin + 1), 11) else { panic!() };
        assert_eq!(sequences(&ready), [begin + 1], "nobody has heard of it");
    }

    #[test]
    fn a_change_behind_a_hole_waits_for_the_missing_one() {
        let mut intake = Intake::default();
        intake.know("foyer", 4);
        assert_eq!(intake.offer(change("foyer", 7), 10), Offered::Held(true));
        assert_eq!(intake.offer(change("foyer", 6), 11), Offered::Held(false));
        assert_eq!(intake.deadline_ns(), Some(10 + GAP_WAIT_NS));
        let Offered::Ready(ready) = intake.offer(change("foyer", 5), 12) else { panic!() };
        assert_eq!(sequences(&ready), [5, 6, 7]);
        assert_eq!(intake.deadline_ns(), None);
        assert!(matches!(intake.offer(change("foyer", 6), 13), Offered::Before(_)));
    }

    #[test]
    fn a_hole_that_nobody_fills_is_given_up_and_the_next_hole_waits_anew() {
        let mut intake = Intake::default();
        for sequence in [3, 4, 9] {
            intake.offer(change("foyer", sequence), 100);
        }
        assert_eq!(intake.expire(100 + GAP_WAIT_NS - 1), []);
        let given_up = intake.expire(100 + GAP_WAIT_NS);
        assert_eq!((given_up[0].first, given_up[0].last), (1, 2));
        assert_eq!(sequences(&given_up[0].ready), [3, 4]);
        assert_eq!(intake.deadline_ns(), Some(100 + 2 * GAP_WAIT_NS));
        let given_up = intake.expire(100 + 2 * GAP_WAIT_NS);
        assert_eq!((given_up[0].first, given_up[0].last), (5, 8));
        assert_eq!(intake.next_of("foyer"), Some(10));
    }

    #[test]
    fn a_full_hold_is_given_up_at_once() {
        let mut intake = Intake::default();
        for sequence in 0..2 * HELD_MAX as u64 {
            intake.offer(change("foyer", sequence + 2), 100);
        }
        let given_up = intake.expire(100);
        assert_eq!((given_up[0].first, given_up[0].last), (1, 1));
        assert_eq!(given_up[0].ready.len(), HELD_MAX);
    }

    #[test]
    fn origins_are_bounded() {
        let mut intake = Intake::default();
        for n in 0..ORIGINS_MAX {
            intake.offer(change(&format!("area-{n}"), 1), 0);
        }
        assert_eq!(intake.offer(change("one-more", 1), 0), Offered::TooManyOrigins);
    }

    #[test]
    fn what_is_not_an_event_is_refused_in_words() {
        let broken = |edit: fn(&mut EventChange)| {
            let mut change = change("foyer", 1);
            edit(&mut change);
            change.check_fields().unwrap_err()
        };
        assert_eq!(change("foyer", 1).check_fields(), Ok(()));
        assert!(broken(|change| change.sequence = 0).contains("from 1"));
        assert!(broken(|change| change.origin.clear()).contains("empty"));
        assert!(broken(|change| change.stamp_ns = u64::MAX).contains("2^63"));
        assert!(broken(|change| change.area = "x".repeat(999)).contains("999 bytes"));
        assert!(broken(|change| change.zone = Some("a\u{1b}[2J".to_owned())).contains("control"));
    }

    proptest! {
        #[test]
        fn whatever_the_order_what_comes_out_counts_up_by_one(
            order in Just((1..=40_u64).collect::<Vec<_>>()).prop_shuffle(),
            doubles in proptest::collection::vec(1..=40_u64, 0..20),
        ) {
            let mut intake = Intake::default();
            let mut out = Vec::new();
            for sequence in order.into_iter().chain(doubles) {
                if let Offered::Ready(ready) = intake.offer(change("foyer", sequence), 0) {
                    out.extend(sequences(&ready));
                }
            }
            prop_assert_eq!(out, (1..=40).collect::<Vec<_>>());
        }
    }
}
