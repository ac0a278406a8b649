//! Pure: credit, so that a lossless replay never overruns a reader.
//!
//! A reader publishes, as one self-contained table, how many messages it has *finished* of each
//! `(source, session)`. A publisher may send while `sent - finished < window` for every required
//! reader, and only after all of them announced themselves. A reader that comes back under a new
//! session starts with a clean sheet: what was under way to its predecessor is gone (and counted as
//! lost there), so the publisher goes on instead of waiting for the dead.
//!
//! The table travels as `[u64]`: source, session, finished, three words a source.

use std::collections::BTreeMap;

/// Most readers of an account: one is required today; nobody else publishes credit.
const READERS_MAX: usize = 16;

/// Words of the table per source.
pub const WORDS: usize = 3;

/// What a reader must know of a message to say later that it is done with it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Receipt {
    /// Who sent it.
    pub source: u32,
    /// In which session.
    pub session: u64,
    /// Its number in that session.
    pub seq: u64,
    /// True for the last message of a recording.
    pub end_of_stream: bool,
}

/// The reader's side.
#[derive(Debug, Default)]
pub struct FinishedTable {
    sources: BTreeMap<u32, (u64, u64)>,
    unpublished: u64,
}

impl FinishedTable {
    /// Takes note that a message, and all before it of its source, is finished. Returns true if the
    /// table should be published now: at every `step` messages, and at the end of a stream.
    pub fn finish(&mut self, receipt: &Receipt, step: u64) -> bool {
        let finished = receipt.seq.saturating_add(1);
        let entry = self.sources.entry(receipt.source).or_insert((receipt.session, 0));
        if receipt.session > entry.0 {
            *entry = (receipt.session, 0);
        }
        if receipt.session == entry.0 && finished > entry.1 {
            self.unpublished += finished - entry.1;
            entry.1 = finished;
        }
        receipt.end_of_stream || self.unpublished >= step
    }

    /// True if the publishers do not know all yet.
    #[must_use]
    pub fn is_unpublished(&self) -> bool {
        self.unpublished > 0
    }

    /// Writes the table and takes it for published. Returns the words written; sources that do not
    /// fit are left out.
    pub fn write(&mut self, words: &mut [u64]) -> usize {
        self.unpublished = 0;
        let mut written = 0;
        for (chunk, (&source, &(session, finished))) in
            words.chunks_exact_mut(WORDS).zip(&self.sources)
        {
            chunk.copy_from_slice(&[u64::from(source), session, finished]);
            written += WORDS;
        }
        written
    }

    /// Words of the whole table.
    #[must_use]
    pub fn words(&self) -> usize {
        self.sources.len() * WORDS
    }
}

#[derive(Debug, Clone, Copy)]
struct Reader {
    session: u64,
    finished: u64,
}

/// The publisher's side.
#[derive(Debug)]
pub struct CreditAccount {
    source: u32,
    session: u64,
    window: u64,
    required_readers: usize,
    sent: u64,
    readers: BTreeMap<u32, Reader>,
}

impl CreditAccount {
    /// An account of a publisher that may be `window` messages ahead of `required_readers` readers.
    #[must_use]
    pub fn new(source: u32, session: u64, window: u64, required_readers: usize) -> Self {
        Self { source, session, window, required_readers, sent: 0, readers: BTreeMap::new() }
    }

    /// Takes the table of a reader: its index, its session, its words.
    pub fn heard(&mut self, reader: u32, reader_session: u64, words: &[u64]) {
        let own = [u64::from(self.source), self.session];
        let finished = words
            .chunks_exact(WORDS)
            .find(|chunk| chunk[..2] == own)
            .map_or(0, |chunk| chunk[2].min(self.sent));
        let room = self.readers.len() < READERS_MAX;
        match self.readers.get_mut(&reader) {
            Some(known) if known.session == reader_session => {
                known.finished = known.finished.max(finished);
            }
            Some(known) if known.session > reader_session => {} // the last word of a dead reader
            Some(known) => *known = Reader { session: reader_session, finished: self.sent },
            None if room => {
                let reader_state = Reader { session: reader_session, finished };
                self.readers.insert(reader, reader_state);
            }
            None => {}
        }
    }

    /// Messages that may be sent now.
    #[must_use]
    pub fn available(&self) -> u64 {
        if self.readers.len() < self.required_readers {
            return 0;
        }
        let slowest = self.readers.values().map(|reader| reader.finished).min();
        let under_way = self.sent - slowest.unwrap_or(self.sent);
        self.window.saturating_sub(under_way)
    }

    /// Takes note of a message sent.
    pub fn sent(&mut self) {
        self.sent += 1;
    }

    /// True if the required readers have finished everything that was sent.
    #[must_use]
    pub fn all_finished(&self) -> bool {
        self.readers.len() >= self.required_readers
            && self.readers.values().all(|reader| reader.finished >= self.sent)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;
    use std::collections::VecDeque;

    const SOURCE: u32 = 3;
    const SESSION: u64 = 77;

    fn tell(table: &mut FinishedTable, account: &mut CreditAccount, reader_session: u64) {
        let mut words = vec![0; table.words()];
        let written = table.write(&mut words);
        account.heard(0, reader_session, &words[..written]);
    }

    fn receipt(seq: u64) -> Receipt {
        Receipt { source: SOURCE, session: SESSION, seq, end_of_stream: false }
    }

    #[test]
    fn nothing_is_sent_before_the_reader_announces_itself() {
        let mut account = CreditAccount::new(SOURCE, SESSION, 4, 1);
        assert_eq!(account.available(), 0);
        tell(&mut FinishedTable::default(), &mut account, 1);
        assert_eq!(account.available(), 4);
    }

    #[test]
    fn a_reader_that_comes_back_does_not_stall_the_publisher() {
        let mut account = CreditAccount::new(SOURCE, SESSION, 4, 1);
        tell(&mut FinishedTable::default(), &mut account, 1);
        (0..4).for_each(|_| account.sent());
        assert_eq!(account.available(), 0);
        tell(&mut FinishedTable::default(), &mut account, 2);
        assert_eq!(account.available(), 4);
        tell(&mut FinishedTable::default(), &mut account, 1);
        assert_eq!(account.available(), 4, "the last word of the dead changes nothing");
    }

    #[test]
    fn a_publisher_that_comes_back_starts_at_nothing_finished() {
        let mut table = FinishedTable::default();
        table.finish(&receipt(9), 1);
        table.finish(&Receipt { session: SESSION + 1, ..receipt(0) }, 1);
        let mut account = CreditAccount::new(SOURCE, SESSION + 1, 4, 1);
        tell(&mut table, &mut account, 1);
        account.sent();
        tell(&mut table, &mut account, 1);
        assert!(account.all_finished());
    }

    #[test]
    fn nonsense_from_a_reader_gives_no_credit() {
        let mut account = CreditAccount::new(SOURCE, SESSION, 4, 1);
        account.heard(0, 1, &[u64::from(SOURCE), SESSION, u64::MAX, 1, 2]);
        assert_eq!(account.available(), 4);
        (0..4).for_each(|_| account.sent());
        assert_eq!(account.available(), 0);
    }

    proptest! {
        /// Whatever the order of sending, taking, finishing and telling: the queue never overflows,
        /// and once the reader has finished all and told it, the publisher may send.
        #[test]
        fn the_buffer_never_overflows_and_never_locks(steps in prop::collection::vec(0u8..4, 1..400)) {
            let (buffer, window) = (16usize, 8u64);
            let mut account = CreditAccount::new(SOURCE, SESSION, window, 1);
            let mut table = FinishedTable::default();
            tell(&mut table, &mut account, 1);
            let mut queue = VecDeque::new();
            let mut held = VecDeque::new();
            let mut next = 0;
            for step in steps {
                match step {
                    0 if account.available() > 0 => {
                        queue.push_back(next);
                        account.sent();
                        next += 1;
                    }
                    1 => held.extend(queue.pop_front()),
                    2 => if let Some(seq) = held.pop_front()
                        && table.finish(&receipt(seq), window / 4) {
                            tell(&mut table, &mut account, 1);
                        },
                    _ => tell(&mut table, &mut account, 1),
                }
                prop_assert!(queue.len() <= buffer);
            }
            held.extend(queue.drain(..));
            for seq in held {
                if table.finish(&receipt(seq), window / 4) {
                    tell(&mut table, &mut account, 1);
                }
            }
            prop_assert!(account.available() > 0);
        }
    }
}
