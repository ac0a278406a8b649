//! Changes on their way to the journal: written down before they are told, kept until acknowledged.
//!
//! The pure part: what the bytes of the file `<area>.outbox` mean and which to add. The shell appends
//! and syncs *before* it publishes, so a process that is killed neither loses nor doubles a change: after a
//! restart the file says which sequence was the last, which events are open, and what nobody has
//! acknowledged yet, which is sent again. This file is the one owner of those three facts.
//!
//! Layout: [`MAGIC`], then records: length (u32, little endian) and CRC-32 (u32) of the body; body:
//! kind (u8) and content. Kind 1: an encoded `EventChange`. Kind 2, first in a compacted file: last
//! sequence, last event number, acknowledged sequence (u64, little endian). A compacted file holds the
//! last change of each open event and what is not acknowledged.

use crate::ledger::number_of;
use protocol::codec::{decode, encode};
use protocol::event::{EventChange, EventState, numbering};
use std::collections::{BTreeMap, VecDeque};

/// First bytes of the file: name and version.
const MAGIC: &[u8; 8] = b"TOGOUT\x001";
const KIND_CHANGE: u8 = 1;
const KIND_BASE: u8 = 2;
/// Longest record: a change is below 4 kB.
const RECORD_BYTES_MAX: usize = 1 << 16;
/// Most changes that wait for an acknowledgement: days of a journal that is down. More are given up,
/// oldest first, and counted.
const WAITING_MAX: usize = 16_384;
/// A file below this is not worth writing anew.
const COMPACT_BYTES: usize = 64 * 1024;

/// The state of an outbox.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outbox {
    area: String,
    last_sequence: u64,
    last_number: u64,
    acknowledged: u64,
    waiting: VecDeque<EventChange>,
    open: BTreeMap<u64, EventChange>,
    bytes: usize,
    given_up: u64,
}

/// An outbox that was read from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Loaded {
    /// What it says.
    pub outbox: Outbox,
    /// How many bytes of the file are good: the shell cuts the rest.
    pub good_bytes: usize,
    /// What was wrong, in words.
    pub notice: Option<String>,
}

impl Outbox {
    /// An empty outbox of an area.
    #[must_use]
    pub fn new(area: &str) -> Self {
        Self { area: area.to_owned(), ..Self::default() }
    }

    /// Reads a file. Everything up to the first damage counts; never panics, whatever the bytes.
    #[must_use]
    pub fn load(area: &str, bytes: &[u8]) -> Loaded {
        let mut outbox = Self::new(area);
        if bytes.is_empty() {
            return Loaded { outbox, good_bytes: 0, notice: None };
        }
        if !bytes.starts_with(MAGIC) {
            let notice = format!(
                "the first {} bytes are not those of an outbox of this version; none of its {} bytes \
                 are used",
                MAGIC.len(),
                bytes.len()
            );
            return Loaded { outbox, good_bytes: 0, notice: Some(notice) };
        }
        let mut at = MAGIC.len();
        let mut notice = None;
        while at < bytes.len() {
            match record(&bytes[at..]).and_then(|body| outbox.take(body).map(|()| body.len())) {
                Ok(length) => at += 8 + length,
                Err(reason) => {
                    notice = Some(format!(
                        "at byte {at} of {}: {reason}; the last {} bytes are cut off",
                        bytes.len(),
                        bytes.len() - at
                    ));
                    break;
                }
            }
        }
        outbox.bytes = at;
        Loaded { outbox, good_bytes: at, notice }
    }

    /// Where an outbox goes on whose file is new, although what its origin told may be elsewhere: see
    /// [`protocol::event::numbering`].
    pub fn begin_if_new(&mut self, unix_ns: u64) {
        if self.bytes == 0 {
            (self.last_sequence, self.last_number) = numbering(unix_ns);
        }
    }

    fn take(&mut self, body: &[u8]) -> Result<(), String> {
        match body.split_first() {
            Some((&KIND_CHANGE, content)) => {
                let change: EventChange = decode(content).map_err(|error| error.to_string())?;
                self.note(&change)
            }
            Some((&KIND_BASE, content)) if content.len() == 24 => {
                let word = |index: usize| {
                    let mut word = [0; 8];
                    word.copy_from_slice(&content[8 * index..8 * index + 8]);
                    u64::from_le_bytes(word)
                };
                self.last_sequence = self.last_sequence.max(word(0));
                self.last_number = self.last_number.max(word(1));
                self.acknowledged = self.acknowledged.max(word(2));
                Ok(())
            }
            _ => Err(format!("found a record of kind {:?}, expected 1 or 2", body.first())),
        }
    }

    /// Takes note of a change.
    fn note(&mut self, change: &EventChange) -> Result<(), String> {
        if change.origin != self.area {
            return Err(format!(
                "found a change of `{}`, expected one of `{}`",
                change.origin, self.area
            ));
        }
        let Some(number) = number_of(&self.area, &change.id) else {
            return Err(format!("`{}` is not the id of an event of `{}`", change.id, self.area));
        };
        self.last_sequence = self.last_sequence.max(change.sequence);
        self.last_number = self.last_number.max(number);
        if change.state == EventState::Cleared {
            self.open.remove(&number);
        } else {
            self.open.insert(number, change.clone());
        }
        if change.sequence > self.acknowledged {
            if self.waiting.len() >= WAITING_MAX {
                self.waiting.pop_front();
                self.given_up += 1;
            }
            self.waiting.push_back(change.clone());
        }
        Ok(())
    }

    /// Adds a change; returns the bytes to append to the file (with the file's first bytes, if it is
    /// empty). A change that cannot be encoded is an error in words; it is not added.
    ///
    /// # Errors
    /// If the change breaks the bounds of its message or is of another area.
    pub fn append(&mut self, change: &EventChange) -> Result<Vec<u8>, String> {
        let content = encode(change).map_err(|error| error.to_string())?;
        self.note(change)?;
        let mut out = if self.bytes == 0 { MAGIC.to_vec() } else { Vec::new() };
        push_record(&mut out, KIND_CHANGE, &content);
        self.bytes += out.len();
        Ok(out)
    }

    /// The journal has everything up to `sequence`. True if that was news.
    pub fn acknowledge(&mut self, sequence: u64) -> bool {
        if sequence <= self.acknowledged {
            return false;
        }
        self.acknowledged = sequence;
        // A journal that knows more than this file: the file lost its end. Go on behind it.
        self.last_sequence = self.last_sequence.max(sequence);
        while self.waiting.front().is_some_and(|change| change.sequence <= sequence) {
            self.waiting.pop_front();
        }
        true
    }

    /// The whole file anew, if most of it is of no use any more. The shell writes it beside the old
    /// one, syncs, and renames it; then calls [`Outbox::compacted`].
    #[must_use]
    pub fn compact(&self) -> Option<Vec<u8>> {
        if self.bytes < COMPACT_BYTES || !self.waiting.is_empty() {
            return None;
        }
        let bytes = self.whole();
        (2 * bytes.len() < self.bytes).then_some(bytes)
    }

    /// All that is to be kept, as a file.
    #[must_use]
    pub fn whole(&self) -> Vec<u8> {
        let mut out = MAGIC.to_vec();
        let base = [self.last_sequence, self.last_number, self.acknowledged];
        let base: Vec<u8> = base.iter().flat_map(|word| word.to_le_bytes()).collect();
        push_record(&mut out, KIND_BASE, &base);
        let first_waiting = self.waiting.front().map_or(u64::MAX, |change| change.sequence);
        let mut open: Vec<&EventChange> =
            self.open.values().filter(|change| change.sequence < first_waiting).collect();
        open.sort_by_key(|change| change.sequence);
        for change in open.into_iter().chain(&self.waiting) {
            if let Ok(content) = encode(change) {
                push_record(&mut out, KIND_CHANGE, &content);
            }
        }
        out
    }

    /// The file has this many bytes now.
    pub fn compacted(&mut self, bytes: usize) {
        self.bytes = bytes;
    }

    /// Changes that the journal has not acknowledged, oldest first.
    pub fn unacknowledged(&self) -> impl Iterator<Item = &EventChange> {
        self.waiting.iter()
    }

    /// The last change of every open event, by number.
    #[must_use]
    pub fn open_events(&self) -> Vec<EventChange> {
        self.open.values().cloned().collect()
    }

    /// The end of every open event: nobody here will see it end. Not yet appended.
    #[must_use]
    pub fn withdrawals(&self, stamp_ns: u64, text: &str) -> Vec<EventChange> {
        let end = |(n, open): (usize, &EventChange)| EventChange {
            sequence: self.last_sequence + 1 + n as u64,
            state: EventState::Cleared,
            stamp_ns: stamp_ns.max(open.stamp_ns),
            text: text.to_owned(),
            ..open.clone()
        };
        self.open.values().enumerate().map(end).collect()
    }

    /// The highest sequence that was ever given.
    #[must_use]
    pub fn last_sequence(&self) -> u64 {
        self.last_sequence
    }

    /// The highest number of an event that was ever given.
    #[must_use]
    pub fn last_number(&self) -> u64 {
        self.last_number
    }

    /// Changes that were given up, because too many waited.
    #[must_use]
    pub fn given_up(&self) -> u64 {
        self.given_up
    }
}

fn push_record(out: &mut Vec<u8>, kind: u8, content: &[u8]) {
    let mut crc = crc32fast::Hasher::new();
    crc.update(&[kind]);
    crc.update(content);
    out.extend_from_slice(&(content.len() as u32 + 1).to_le_bytes());
    out.extend_from_slice(&crc.finalize().to_le_bytes());
    out.push(kind);
    out.extend_from_slice(content);
}

/// The body of the record at the start of `bytes`.
fn record(bytes: &[u8]) -> Result<&[u8], String> {
    let Some((head, rest)) = bytes.split_first_chunk::<8>() else {
        return Err(format!("a record begins with 8 bytes, found {}", bytes.len()));
    };
    let [l0, l1, l2, l3, c0, c1, c2, c3] = *head;
    let length = u32::from_le_bytes([l0, l1, l2, l3]) as usize;
    if length == 0 || length > RECORD_BYTES_MAX {
        return Err(format!("found a record of {length} bytes, expected 1..={RECORD_BYTES_MAX}"));
    }
    let Some(body) = rest.get(..length) else {
        return Err(format!("a record of {length} bytes is cut, found {}", rest.len()));
    };
    if crc32fast::hash(body) != u32::from_le_bytes([c0, c1, c2, c3]) {
        return Err("the checksum of a record does not fit".to_owned());
    }
    Ok(body)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use protocol::event::EventKind;

    fn change(sequence: u64, number: u64, state: EventState) -> EventChange {
        EventChange {
            origin: "hall".to_owned(),
            sequence,
            id: format!("hall-{number}"),
            kind: EventKind::Loitering,
            state,
            stamp_ns: sequence * 1000,
            first_evidence_ns: number,
            area: "hall".to_owned(),
            zone: None,
            x_m: 1.0,
            y_m: 2.0,
            bounds_m: [0.0; 4],
            score: 12.0,
            threshold: 9.0,
            extrapolated: true,
            text: "Somebody stays.".to_owned(),
        }
    }

    fn story() -> (Outbox, Vec<u8>, Vec<usize>) {
        let mut outbox = Outbox::new("hall");
        let (mut file, mut ends) = (Vec::new(), Vec::new());
        for (sequence, (number, state)) in [
            (1, EventState::Raised),
            (2, EventState::Raised),
            (1, EventState::Updated),
            (2, EventState::Cleared),
        ]
        .into_iter()
        .enumerate()
        {
            file.extend(outbox.append(&change(sequence as u64 + 1, number, state)).unwrap());
            ends.push(file.len());
        }
        (outbox, file, ends)
    }

    #[test]
    fn what_was_appended_is_there_after_a_restart() {
        let (outbox, file, _) = story();
        let loaded = Outbox::load("hall", &file);
        assert_eq!(loaded.outbox, outbox);
        assert_eq!((loaded.good_bytes, loaded.notice), (file.len(), None));
        assert_eq!((outbox.last_sequence(), outbox.last_number()), (4, 2));
        let open: Vec<u64> = outbox.open_events().iter().map(|change| change.sequence).collect();
        assert_eq!(open, [3], "event 1 is open, its last change is 3");
        assert_eq!(outbox.unacknowledged().count(), 4);
    }

    #[test]
    fn every_cut_keeps_the_changes_before_it_and_says_so() {
        let (_, file, ends) = story();
        for cut in 1..file.len() {
            let loaded = Outbox::load("hall", &file[..cut]);
            let whole = ends.iter().filter(|end| **end <= cut).count();
            assert_eq!(loaded.outbox.unacknowledged().count(), whole, "cut at {cut}");
            let clean = ends.contains(&cut) || cut == MAGIC.len();
            assert_eq!(loaded.notice.is_none(), clean, "cut at {cut}: {:?}", loaded.notice);
            // What is appended after the cut is readable.
            let mut mended = loaded.outbox;
            let mut repaired = file[..loaded.good_bytes].to_vec();
            repaired.extend(mended.append(&change(9, 3, EventState::Raised)).unwrap());
            assert_eq!(Outbox::load("hall", &repaired).outbox, mended);
        }
    }

    #[test]
    fn acknowledged_changes_are_not_sent_again_and_open_events_survive_a_compaction() {
        let (mut outbox, _, _) = story();
        assert!(outbox.acknowledge(2));
        assert!(!outbox.acknowledge(2));
        let waiting: Vec<u64> = outbox.unacknowledged().map(|change| change.sequence).collect();
        assert_eq!(waiting, [3, 4]);
        outbox.acknowledge(4);
        let whole = outbox.whole();
        outbox.compacted(whole.len());
        assert_eq!(Outbox::load("hall", &whole).outbox, outbox);
    }

    #[test]
    fn a_new_outbox_whose_changes_went_elsewhere_begins_above_all_that_it_told() {
        let unix_ns = 1_795_000_000_000_000_000;
        let mut outbox = Outbox::new("hall");
        outbox.begin_if_new(unix_ns);
        let (sequence, number) = (outbox.last_sequence(), outbox.last_number());
        assert!(protocol::event::begins_numbering(sequence + 1));
        outbox.acknowledge(41);
        assert_eq!(outbox.last_sequence(), sequence, "an old journal is there");
        let file = outbox.append(&change(sequence + 1, number + 1, EventState::Raised)).unwrap();
        let mut again = Outbox::load("hall", &file).outbox;
        again.begin_if_new(unix_ns + 5_000_000_000);
        assert_eq!((again.last_sequence(), again.last_number()), (sequence + 1, number + 1));
        let mut later = Outbox::new("hall");
        later.begin_if_new(unix_ns + 1_000_000_000);
        assert!(later.last_sequence() > sequence + 1_000_000 && later.last_number() > number);
    }

    #[test]
    fn open_events_are_withdrawn_each_once() {
        let (mut outbox, mut file, _) = story();
        let ends = outbox.withdrawals(9_000, "watched elsewhere");
        let words: Vec<_> = ends
            .iter()
            .map(|end| (end.id.as_str(), end.sequence, end.state, end.stamp_ns))
            .collect();
        assert_eq!(words, [("hall-1", 5, EventState::Cleared, 9_000)], "event 2 was over");
        ends.iter().for_each(|end| file.extend(outbox.append(end).unwrap()));
        assert!(outbox.withdrawals(9_001, "again").is_empty());
        assert_eq!(Outbox::load("hall", &file).outbox, outbox);
    }

    #[test]
    fn a_journal_that_knows_more_moves_the_sequence_on() {
        let mut outbox = Outbox::new("hall");
        outbox.acknowledge(41);
        assert_eq!(outbox.last_sequence(), 41);
    }

    #[test]
    fn a_file_of_another_area_is_not_believed() {
        let (_, file, _) = story();
        let loaded = Outbox::load("yard", &file);
        assert_eq!(loaded.outbox, Outbox { bytes: 8, ..Outbox::new("yard") });
        assert!(loaded.notice.unwrap().contains("found a change of `hall`"));
    }

    proptest! {
        #[test]
        fn damage_anywhere_never_panics_and_never_invents_a_change(
            at in 0usize..2000, bits in 1u8.., tail in prop::collection::vec(any::<u8>(), 0..40),
        ) {
            let (outbox, mut file, _) = story();
            let at = at % file.len();
            file[at] ^= bits;
            file.extend(tail);
            let loaded = Outbox::load("hall", &file);
            let known: Vec<_> = outbox.unacknowledged().collect();
            for (found, expected) in loaded.outbox.unacknowledged().zip(known) {
                prop_assert_eq!(found, expected);
            }
            prop_assert!(loaded.outbox.unacknowledged().count() <= 4);
            prop_assert!(loaded.notice.is_some());
        }
    }
}
