//! Pure: what a reader knows of losses, from the sequence numbers that it sees.
//!
//! Within one session of a source the sequence grows by one a message; a gap is a loss. A new session
//! is a restarted publisher: a loss only if its first messages are missing although the reader was
//! there before it.

use protocol::wire::Envelope;
use std::collections::BTreeMap;

/// Most sources that are told apart on a topic: far more than a site's lasers; beyond it messages
/// are handed on uncounted.
pub const SOURCES_MAX: usize = 1024;

/// What was counted on a topic, or of one of its sources.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Losses {
    /// Messages handed out.
    pub received: u64,
    /// Messages that were published and never seen.
    pub lost: u64,
    /// Messages seen twice.
    pub duplicates: u64,
    /// Times that a publisher came back under a new session.
    pub restarts: u64,
}

#[derive(Debug, Clone, Copy)]
struct Source {
    session: u64,
    next_seq: u64,
    counted: Losses,
}

/// Counts the losses of one subscriber.
#[derive(Debug, Default)]
pub struct LossCounter {
    sources: BTreeMap<u32, Source>,
    total: Losses,
}

impl LossCounter {
    /// Takes note of a message that was received.
    pub fn observe(&mut self, envelope: &Envelope) {
        let known = self.sources.len() < SOURCES_MAX || self.sources.contains_key(&envelope.source);
        self.total.received += 1;
        if !known {
            return;
        }
        let source = self.sources.entry(envelope.source).or_insert(Source {
            session: envelope.session,
            next_seq: envelope.seq,
            counted: Losses::default(),
        });
        let before = source.counted;
        source.counted.received += 1;
        if envelope.session > source.session {
            source.session = envelope.session;
            source.counted.restarts += 1;
            source.counted.lost = source.counted.lost.saturating_add(envelope.seq);
            source.next_seq = envelope.seq.saturating_add(1);
        } else if envelope.session == source.session {
            if envelope.seq >= source.next_seq {
                let missed = envelope.seq - source.next_seq;
                source.counted.lost = source.counted.lost.saturating_add(missed);
                source.next_seq = envelope.seq.saturating_add(1);
            } else {
                source.counted.duplicates += 1;
            }
        } // else: the rest of the queue of a publisher that died, after its successor's first
        let lost = source.counted.lost - before.lost;
        self.total.lost = self.total.lost.saturating_add(lost);
        self.total.duplicates += source.counted.duplicates - before.duplicates;
        self.total.restarts += source.counted.restarts - before.restarts;
    }

    /// Over all sources.
    #[must_use]
    pub fn total(&self) -> Losses {
        self.total
    }

    /// Of one source.
    #[must_use]
    pub fn of(&self, source: u32) -> Losses {
        self.sources.get(&source).map(|source| source.counted).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn see(counter: &mut LossCounter, source: u32, session: u64, seqs: &[u64]) {
        for &seq in seqs {
            counter.observe(&Envelope { seq, session, source, ..Envelope::default() });
        }
    }

    #[test]
    fn a_gap_is_a_loss_of_its_source_only() {
        let mut counter = LossCounter::default();
        see(&mut counter, 0, 1, &[5, 6, 9]);
        see(&mut counter, 1, 1, &[0, 1]);
        assert_eq!(counter.of(0).lost, 2);
        assert_eq!(counter.of(1).lost, 0);
        assert_eq!(counter.total().lost, 2);
        assert_eq!(counter.total().received, 5);
    }

    #[test]
    fn a_restarted_publisher_is_not_a_loss() {
        let mut counter = LossCounter::default();
        see(&mut counter, 0, 10, &[0, 1, 2]);
        see(&mut counter, 0, 20, &[0, 1]);
        assert_eq!(counter.total().lost, 0);
        assert_eq!(counter.total().restarts, 1);
    }

    #[test]
    fn the_missing_head_of_a_new_session_is_a_loss() {
        let mut counter = LossCounter::default();
        see(&mut counter, 0, 10, &[0]);
        see(&mut counter, 0, 20, &[3]);
        assert_eq!(counter.total().lost, 3);
    }

    #[test]
    fn numbers_that_nobody_counts_to_stop_nothing() {
        let mut counter = LossCounter::default();
        see(&mut counter, 0, 1, &[0, u64::MAX]);
        see(&mut counter, 0, 2, &[u64::MAX]);
        see(&mut counter, 0, 3, &[u64::MAX]);
        see(&mut counter, 1, 1, &[0, u64::MAX]);
        assert_eq!(counter.total().lost, u64::MAX);
        assert_eq!(counter.total().received, 6);
    }

    #[test]
    fn the_queue_of_the_dead_after_its_successor_changes_nothing() {
        let mut counter = LossCounter::default();
        see(&mut counter, 0, 20, &[0]);
        see(&mut counter, 0, 10, &[7, 8]);
        see(&mut counter, 0, 20, &[1, 1]);
        let total = counter.total();
        assert_eq!((total.lost, total.duplicates, total.restarts), (0, 1, 0));
    }
}
