//! Frames and maps of an area for other hosts: what is said of them, and what is made of it there.
//!
//! Frames and class maps: a key frame at the beginning, whenever somebody new asks, and once a second;
//! deltas between ([`protocol::carried`]). The newest wins: what the network drops is not sent again, and
//! who missed something waits for the next key frame. A collapsed map comes in parts; one that lacks a
//! part is left out, and the next one is due with the next checkpoint.
//!
//! An area that two hosts may run is told by the one that runs it. For the moment in which both do, a
//! reader stays with the one that it heard last, until that one is silent for a second.
//!
//! Pure: the time is an argument (CLOCK_MONOTONIC, nanoseconds).

use protocol::carried::{CarriedCounts, CarriedMap, Cells, apply, delta, key};
use protocol::time::SECOND_NS;

/// A key frame a second costs 1.5 kB for 40 000 cells; so long may a late reader wait.
const KEY_EVERY_NS: u64 = SECOND_NS;
/// Another host of the area is listened to when the one before was silent for so long.
const SILENT_NS: u64 = SECOND_NS;

/// Says a stream of maps.
#[derive(Debug)]
pub struct MapTeller<C> {
    before: Option<C>,
    now: C,
    seq: u64,
    key_due_ns: u64,
}

/// What is said of one map.
#[derive(Debug, PartialEq, Eq)]
pub struct Said {
    /// The number of the message.
    pub seq: u64,
    /// True for a key frame.
    pub is_key: bool,
    /// See [`protocol::carried`].
    pub codes: Vec<u32>,
}

impl<C: Cells> MapTeller<C> {
    /// `blank` has the size of the maps.
    pub fn new(blank: C) -> Self {
        Self { before: None, now: blank, seq: 0, key_due_ns: 0 }
    }

    /// Somebody new listens, or something was not sent: the next map is a key frame.
    pub fn want_key(&mut self) {
        self.before = None;
    }

    /// The next map; `fill` writes all of it.
    pub fn say(&mut self, now_ns: u64, fill: impl FnOnce(&mut C)) -> Said {
        fill(&mut self.now);
        let before = self.before.as_ref().filter(|_| now_ns < self.key_due_ns);
        let is_key = before.is_none();
        let codes = before.map_or_else(|| key(&self.now), |before| delta(before, &self.now));
        if is_key {
            self.key_due_ns = now_ns + KEY_EVERY_NS;
        }
        self.seq += 1;
        match &mut self.before {
            Some(before) => std::mem::swap(before, &mut self.now),
            none => *none = Some(self.now.clone()),
        }
        Said { seq: self.seq, is_key, codes }
    }
}

/// Where a stream of maps is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Place {
    host: usize,
    session: u64,
    seq: u64,
}

/// Reads a stream of maps.
#[derive(Debug)]
pub struct MapReader<C> {
    map: C,
    /// Symbols above this are of no class of the area.
    symbol_max: u32,
    /// Where it is; none until a key frame.
    place: Option<Place>,
    /// Who was heard last, what it said, and when.
    heard: Option<(Place, u64)>,
    missed: u64,
}

impl<C: Cells> MapReader<C> {
    /// `blank` has the size of the maps.
    pub fn new(blank: C, symbol_max: u32) -> Self {
        Self { map: blank, symbol_max, place: None, heard: None, missed: 0 }
    }

    /// The map, after [`Self::take`] said that it is one.
    pub fn map(&self) -> &C {
        &self.map
    }

    /// Messages that did not come, or came before a key frame.
    pub fn missed(&self) -> u64 {
        self.missed
    }

    /// Takes what `host` says. True if [`Self::map`] is that map now.
    ///
    /// # Errors
    /// If it does not fit the area: the next key frame begins anew.
    pub fn take(&mut self, host: usize, said: &CarriedMap, now_ns: u64) -> Result<bool, String> {
        let here = Place { host, session: said.session, seq: said.seq };
        if let Some((last, heard_ns)) = self.heard {
            if last.host != host && now_ns < heard_ns + SILENT_NS {
                return Ok(false); // both run it for the moment
            }
            if last.host == host && last.session == said.session {
                self.missed += said.seq.saturating_sub(last.seq + 1);
            }
        }
        self.heard = Some((here, now_ns));
        let follows = |place: Place| {
            place.host == host && place.session == said.session && place.seq + 1 == said.seq
        };
        if !said.is_key && !self.place.is_some_and(follows) {
            self.place = None;
            self.missed += 1;
            return Ok(false);
        }
        self.place = None;
        if let Some(code) = said.codes.iter().find(|code| **code % C::SYMBOLS > self.symbol_max) {
            let (found, expected) = (code % C::SYMBOLS, self.symbol_max);
            return Err(format!("symbol {found} in a map whose largest is {expected}"));
        }
        apply(&mut self.map, said.is_key, &said.codes)?;
        self.place = Some(here);
        Ok(true)
    }
}

/// Puts the parts of collapsed maps together, one map at a time.
#[derive(Debug)]
pub struct CountsReader {
    counts: Vec<u64>,
    /// Host, frame and context of the map that is being read, and how much of it is there.
    begun: Option<(usize, u64, u32)>,
    filled: usize,
    incomplete: u64,
}

impl CountsReader {
    /// For maps of `counts` counts.
    pub fn new(counts: usize) -> Self {
        Self { counts: vec![0; counts], begun: None, filled: 0, incomplete: 0 }
    }

    /// The counts, after [`Self::take`] said that they are complete.
    pub fn counts(&self) -> &[u64] {
        &self.counts
    }

    /// Maps of which a part did not come.
    pub fn incomplete(&self) -> u64 {
        self.incomplete
    }

    /// Takes a part of a map of this size from `host`. True if the map is complete now.
    pub fn take(&mut self, host: usize, part: &CarriedCounts) -> bool {
        let of = (host, part.number, part.context);
        if part.offset == 0 {
            self.incomplete += u64::from(self.begun.is_some());
            (self.begun, self.filled) = (Some(of), 0);
        }
        if self.begun != Some(of) || self.filled != part.offset as usize {
            self.incomplete += u64::from(self.begun.is_some());
            self.begun = None;
            return false;
        }
        part.write(&mut self.counts);
        self.filled += part.len();
        let is_complete = self.filled == self.counts.len();
        if is_complete {
            self.begun = None;
        }
        is_complete
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use protocol::carried::{COUNTS_PAGE_MAX, ClassIds, MapContent};

    const CELLS: usize = 50;

    fn message(session: u64, said: Said) -> CarriedMap {
        CarriedMap {
            host: String::new(),
            area: String::new(),
            content: MapContent::Classes,
            session,
            seq: said.seq,
            number: 0,
            period_ns: 1,
            lasers_present: 0,
            context: 0,
            classes: 6,
            columns: CELLS as u32,
            rows: 1,
            is_key: said.is_key,
            codes: said.codes,
        }
    }

    fn blank() -> ClassIds {
        ClassIds(vec![0; CELLS])
    }

    fn say(teller: &mut MapTeller<ClassIds>, value: u8, now_ns: u64) -> CarriedMap {
        message(1, teller.say(now_ns, |map| map.0[3] = value))
    }

    #[test]
    fn a_late_reader_waits_for_the_next_key_frame() {
        let (mut teller, mut reader) = (MapTeller::new(blank()), MapReader::new(blank(), 6));
        assert!(say(&mut teller, 1, 0).is_key);
        assert!(!reader.take(0, &say(&mut teller, 2, 1), 1).unwrap(), "a delta says too little");
        let key = say(&mut teller, 3, KEY_EVERY_NS);
        assert!(key.is_key && reader.take(0, &key, 2).unwrap());
        assert_eq!((reader.map().0[3], reader.missed()), (3, 1));
        teller.want_key();
        assert!(say(&mut teller, 3, KEY_EVERY_NS + 1).is_key);
    }

    #[test]
    fn of_two_hosts_the_one_is_followed_until_it_is_silent() {
        let mut reader = MapReader::new(blank(), 6);
        let (mut ours, mut theirs) = (MapTeller::new(blank()), MapTeller::new(blank()));
        assert!(reader.take(0, &say(&mut ours, 1, 0), 0).unwrap());
        assert!(!reader.take(1, &say(&mut theirs, 2, 0), SILENT_NS - 1).unwrap());
        theirs.want_key();
        assert!(reader.take(1, &say(&mut theirs, 4, 0), SILENT_NS).unwrap());
        assert_eq!((reader.map().0[3], reader.missed()), (4, 0));
    }

    #[test]
    fn a_class_that_the_area_has_not_is_refused() {
        let (mut teller, mut reader) = (MapTeller::new(blank()), MapReader::new(blank(), 6));
        let bad = say(&mut teller, 6, 0);
        assert!(
            reader.take(0, &bad, 0).unwrap_err().contains("symbol 7 in a map whose largest is 6")
        );
        assert!(!reader.take(0, &say(&mut teller, 5, 1), 1).unwrap());
    }

    #[test]
    fn a_collapsed_map_that_lacks_a_part_is_left_out() {
        let counts: Vec<u64> = (0..COUNTS_PAGE_MAX as u64 + 9).collect();
        let part = |number, offset| {
            let (host, area) = (String::new(), String::new());
            let (columns, rows, runs) = (counts.len() as u32, 1, Vec::new());
            let head = CarriedCounts {
                host,
                area,
                number,
                period_ns: 1,
                context: 0,
                classes: 1,
                columns,
                rows,
                offset: 0,
                runs,
            };
            head.part(&counts, offset)
        };
        let mut reader = CountsReader::new(counts.len());
        assert!(!reader.take(0, &part(1, 0)));
        assert!(!reader.take(0, &part(2, 0)), "another map begins");
        assert!(!reader.take(0, &part(1, COUNTS_PAGE_MAX)));
        assert_eq!(reader.incomplete(), 2);
        assert!(!reader.take(0, &part(2, COUNTS_PAGE_MAX)), "its beginning was left");
        assert!(!reader.take(0, &part(3, 0)) && reader.take(0, &part(3, COUNTS_PAGE_MAX)));
        assert_eq!(reader.counts(), counts);
    }

    proptest! {
        /// Whatever the network drops: what the reader calls a map is what was said.
        #[test]
        fn a_map_is_never_wrong(
            maps in proptest::collection::vec((0usize..CELLS, 0u8..6, 0u32..10), 1..200),
        ) {
            let (mut teller, mut reader) = (MapTeller::new(blank()), MapReader::new(blank(), 6));
            let (mut truth, mut seen) = (blank(), 0);
            for (step, (cell, class, fate)) in maps.iter().enumerate() {
                truth.0[*cell] = *class;
                let now_ns = step as u64 * KEY_EVERY_NS / 10;
                let said = message(7, teller.say(now_ns, |map| map.0.clone_from(&truth.0)));
                if *fate > 0 && reader.take(0, &said, now_ns).unwrap() {
                    prop_assert_eq!(reader.map(), &truth);
                    seen += 1;
                }
            }
            let dropped = maps.iter().filter(|(.., fate)| *fate == 0).count();
            prop_assert!(dropped > 0 || seen == maps.len());
        }
    }
}
