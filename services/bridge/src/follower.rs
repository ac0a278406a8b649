//! A desk follows the journal of another host: everything, in order, once.
//!
//! ```text
//! page (as it comes, or asked for)   row after row `taken`: hand on, wait for the acknowledgement
//!                                    rows up to `taken`: known; a hole: ask for "all after taken"
//! head beyond `taken`, 3 s silence, start                    : ask for "all after taken"
//! acknowledgement of the own journal                         : `cursor` moves on, and is stored
//! ```
//!
//! `cursor <= taken <= head`: up to `cursor` the own journal has everything; from there to `taken` it
//! was handed on. A bridge that dies begins again at the stored cursor, and hands on again what was
//! not acknowledged: the journal knows an `(origin, sequence)` that it has. So nothing is lost and
//! nothing is there twice, whoever dies when.
//!
//! A younger journal of the host (its epoch is higher: its state was lost) is followed from its first row;
//! an older one, or one that says something else than before, stops the follower.
//!
//! Pure: the time is an argument (CLOCK_MONOTONIC, nanoseconds).

use protocol::event::{EventChange, begins_numbering};
use protocol::link::{EventPage, EventRow};
use protocol::time::SECOND_NS;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeSet, VecDeque};

/// Most changes that are handed on and not acknowledged: a quarter of what the journal's queue holds.
pub const WINDOW: usize = 64;
/// A question without an answer is asked again after this long: the network gives up after 3 s.
pub const ANSWER_NS: u64 = 3_500_000_000;
/// Without a word for so long a desk asks: the other side says where it is once a second.
pub const SILENCE_NS: u64 = 3 * SECOND_NS;
/// What is not acknowledged after this long is handed on again.
pub const RESEND_NS: u64 = 2 * SECOND_NS;
/// Rows that are known again if they come once more with another content: a second of a storm.
const RECENT_MAX: usize = 256;
/// A journal that ends before what was taken of it in more than every third of its words, for some ten
/// seconds, is another one.
const LOW_MAX: u32 = 12;

/// How far the own journal has the journal of another host; what is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Cursor {
    /// Names the journal; none before the first page.
    pub epoch: Option<u64>,
    /// Its last row that was acknowledged here.
    pub row: u64,
}

/// Who may speak from a host.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Origins {
    /// Those that live there: their changes are handed on.
    pub own: BTreeSet<String>,
    /// Those that live on other hosts of the site: if that host is a desk, its journal has copies of
    /// their changes, which are passed over; they come from where they live.
    pub elsewhere: BTreeSet<String>,
}

/// Another journal answers than the one that was followed so far.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OtherJournal {
    /// What was found, in words.
    pub reason: String,
}

#[derive(Debug)]
struct Waiting {
    row: u64,
    change: EventChange,
    done: bool,
}

/// One journal that is followed.
#[derive(Debug)]
pub struct Follower {
    cursor: Cursor,
    taken: u64,
    head: u64,
    origins: Origins,
    waiting: VecDeque<Waiting>,
    asked: Option<(u64, u64)>,
    synced: bool,
    heard_ns: u64,
    sent_ns: u64,
    foreign: u64,
    repeated: u64,
    /// What the last rows said, to know them again.
    recent: VecDeque<Mark>,
    /// Grows while the journal ends before what was taken of it.
    low: u32,
    /// A numbering begins behind what waits: until that is acknowledged nothing more is taken.
    holds: bool,
    replaced: Option<Replaced>,
    other: Option<OtherJournal>,
}

/// The host began a new journal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Replaced {
    /// When that was noticed, CLOCK_MONOTONIC, nanoseconds.
    pub mono_ns: u64,
    /// The last row of the old one that is here.
    pub row: u64,
    /// The last row of it that was heard of.
    pub head: u64,
}

/// A row, and which change it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Mark {
    row: u64,
    sequence: u64,
    stamp_ns: u64,
}

impl Mark {
    fn of(row: &EventRow) -> Self {
        let EventRow { journal_id, change } = row;
        Self { row: *journal_id, sequence: change.sequence, stamp_ns: change.stamp_ns }
    }
}

impl Follower {
    /// Goes on behind `cursor`.
    #[must_use]
    pub fn new(cursor: Cursor, origins: Origins, mono_ns: u64) -> Self {
        Self {
            cursor,
            taken: cursor.row,
            head: cursor.row,
            origins,
            waiting: VecDeque::new(),
            asked: None,
            synced: false,
            heard_ns: mono_ns,
            sent_ns: mono_ns,
            foreign: 0,
            repeated: 0,
            recent: VecDeque::new(),
            low: 0,
            holds: false,
            replaced: None,
            other: None,
        }
    }

    /// Takes a page that was decoded; returns what is to be handed to the own journal, in order.
    ///
    /// # Errors
    /// If another journal answers that is no younger one. From then on nothing is taken, until a person has
    /// decided.
    pub fn page(
        &mut self,
        page: EventPage,
        mono_ns: u64,
    ) -> Result<Vec<EventChange>, OtherJournal> {
        self.heard_ns = mono_ns;
        if let Some(other) = &self.other {
            return Err(other.clone());
        }
        if self.cursor.epoch.is_some_and(|epoch| page.epoch > epoch) {
            self.begin_anew(mono_ns);
        }
        self.compare(&page)?;
        self.cursor.epoch = Some(page.epoch);
        self.head = self.head.max(page.head);
        if self.asked.is_some_and(|(after, _)| after == page.after) {
            self.asked = None;
            self.synced = true;
        }
        if page.after > self.taken || self.holds {
            return Ok(Vec::new()); // rows between are missing: `question` asks for them
        }
        let mut changes = Vec::new();
        for row in page.rows {
            let mark = Mark::of(&row);
            if row.journal_id <= self.taken {
                self.repeated += 1;
                if self.recent.iter().any(|known| known.row == mark.row && *known != mark) {
                    let row = mark.row;
                    return Err(self.stop(format!("row {row} is another one than before")));
                }
                continue;
            }
            let origin = &row.change.origin;
            let waits = |waiting: &Waiting| !waiting.done && waiting.change.origin == *origin;
            self.holds = begins_numbering(row.change.sequence) && self.waiting.iter().any(waits);
            if self.waiting.len() >= WINDOW || self.holds {
                break; // asked for again when there is room
            }
            self.taken = row.journal_id;
            if self.recent.len() >= RECENT_MAX {
                self.recent.pop_front();
            }
            self.recent.push_back(mark);
            let done = !self.origins.own.contains(origin);
            self.foreign += u64::from(done && !self.origins.elsewhere.contains(origin));
            if !done {
                changes.push(row.change.clone());
            }
            self.waiting.push_back(Waiting { row: row.journal_id, change: row.change, done });
        }
        if !changes.is_empty() {
            self.sent_ns = mono_ns;
        }
        self.advance();
        Ok(changes)
    }

    /// Goes on with the first row of a younger journal. What was handed on still waits for its
    /// acknowledgement; what the old journal held besides is gone with it.
    fn begin_anew(&mut self, mono_ns: u64) {
        self.replaced = Some(Replaced { mono_ns, row: self.cursor.row, head: self.head });
        self.cursor = Cursor::default();
        self.waiting.iter_mut().for_each(|waiting| waiting.row = 0);
        (self.taken, self.head, self.low) = (0, 0, 0);
        (self.asked, self.synced) = (None, false);
        self.recent.clear();
    }

    fn stop(&mut self, reason: String) -> OtherJournal {
        self.other.insert(OtherJournal { reason }).clone()
    }

    fn compare(&mut self, page: &EventPage) -> Result<(), OtherJournal> {
        // The answer to a question may overtake a word said before it; a journal that ends too early again
        // and again lost rows, or is that of a twin.
        let ends_early = page.head < self.taken && page.head > 0;
        self.low = if ends_early { self.low + 2 } else { self.low.saturating_sub(1) };
        let reason = match self.cursor.epoch {
            Some(epoch) if epoch != page.epoch => {
                format!("found journal {}, expected {epoch}", page.epoch)
            }
            // An empty one is a new one: its rows will have ids above all that were before.
            _ if (page.head < page.after || self.low > LOW_MAX) && page.head > 0 => {
                let before = page.after.max(self.taken);
                format!("it ends at row {}, but rows up to {before} came before", page.head)
            }
            _ => return Ok(()),
        };
        Err(self.stop(reason))
    }

    /// The own journal has everything of `origin` up to `sequence`.
    pub fn acknowledged(&mut self, origin: &str, sequence: u64) {
        for waiting in &mut self.waiting {
            if waiting.change.origin == origin && waiting.change.sequence <= sequence {
                waiting.done = true;
            }
        }
        self.advance();
    }

    fn advance(&mut self) {
        while self.waiting.front().is_some_and(|waiting| waiting.done) {
            if let Some(waiting) = self.waiting.pop_front() {
                self.cursor.row = waiting.row;
            }
        }
        self.holds &= !self.waiting.is_empty();
    }

    /// The row after which the log is to be asked for, if it is time; counts as asked.
    pub fn question(&mut self, mono_ns: u64) -> Option<u64> {
        if self.question_due_ns().is_none_or(|due_ns| mono_ns < due_ns) {
            return None;
        }
        self.asked = Some((self.taken, mono_ns));
        Some(self.taken)
    }

    fn question_due_ns(&self) -> Option<u64> {
        if self.other.is_some() || self.holds || self.waiting.len() > WINDOW / 2 {
            return None;
        }
        let wants = !self.synced || self.head > self.taken;
        let due_ns = if wants { 0 } else { self.heard_ns.saturating_add(SILENCE_NS) };
        let patience_ns = self.asked.map_or(0, |(_, asked_ns)| asked_ns.saturating_add(ANSWER_NS));
        Some(due_ns.max(patience_ns))
    }

    /// What is to be handed on again, if it is time.
    pub fn resend(&mut self, mono_ns: u64) -> Vec<EventChange> {
        if self.waiting.is_empty() || mono_ns < self.sent_ns.saturating_add(RESEND_NS) {
            return Vec::new();
        }
        self.sent_ns = mono_ns;
        let left = self.waiting.iter().filter(|waiting| !waiting.done);
        left.map(|waiting| waiting.change.clone()).collect()
    }

    /// When [`Follower::question`] or [`Follower::resend`] has something to do, if ever.
    #[must_use]
    pub fn deadline_ns(&self) -> Option<u64> {
        let resend = self.sent_ns.saturating_add(RESEND_NS);
        let resend = (!self.waiting.is_empty()).then_some(resend);
        self.question_due_ns().into_iter().chain(resend).min()
    }

    /// What is to be stored.
    #[must_use]
    pub fn cursor(&self) -> Cursor {
        self.cursor
    }

    /// Rows that the other journal has and ours has not, as far as is known.
    #[must_use]
    pub fn behind(&self) -> u64 {
        self.head.saturating_sub(self.cursor.row)
    }

    /// Changes of origins that live nowhere in the site; they were not handed on.
    #[must_use]
    pub fn foreign(&self) -> u64 {
        self.foreign
    }

    /// Rows that came again: after a cut link, or from somebody who replays them.
    #[must_use]
    pub fn repeated(&self) -> u64 {
        self.repeated
    }

    /// The host began a new journal, if it did while this follows it.
    #[must_use]
    pub fn replaced(&self) -> Option<Replaced> {
        self.replaced
    }

    /// Why nothing is taken any more, if so.
    #[must_use]
    pub fn other(&self) -> Option<&OtherJournal> {
        self.other.as_ref()
    }
}

#[cfg(test)]
#[path = "follower_tests.rs"]
mod tests;
