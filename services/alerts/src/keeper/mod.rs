//! The keeper: what arrives goes to disk, in order, and is handed on; and what then?
//!
//! While the disk cannot be written, changes stay in a bounded backlog in memory: told at once and
//! marked as not journaled, not acknowledged, written in order as soon as the disk takes them. The
//! disk is tried again at a deadline that doubles from 1 s to 30 s. A journal that shows damage is
//! set aside and a new one begun, while running as at the start.
//!
//! The keeper raises events of its own, under the origin [`ORIGIN`] unless told otherwise: a storage fault, a
//! host that is missed, and their ends.
//! Reads no clock: [`Now`] is an argument. It does not log: [`Report`] says what is to be said.

mod write;

use crate::intake::{Intake, Offered};
use crate::journal::{Entry, Filter, Journal, JournalError};
use protocol::event::{EventAcknowledgement, EventChange, EventKind, EventState};
use protocol::health::Fault;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::{Path, PathBuf};

/// Origin of the events of this service on the only host of a site: see
/// [`protocol::event::journal_origin`]. No area has a dot in its id.
pub const ORIGIN: &str = "host.alerts";
/// Before the id of the host that an event of this service is about: after a restart it is known again by
/// this.
const HOST_WORD: &str = "host ";
/// Most changes in memory while the disk cannot be written: at 1 to 4 kB each 4 to 16 MB, and days
/// of events. What finds no room is refused, and its origin keeps it.
pub const BACKLOG_MAX: usize = 4096;

/// The time of an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Now {
    /// UNIX nanoseconds.
    pub unix_ns: u64,
    /// CLOCK_MONOTONIC, nanoseconds.
    pub mono_ns: u64,
}

/// What an input led to.
#[derive(Debug, Default)]
pub struct Report {
    /// Changes that people are told now, and whether they are on disk.
    pub told: Vec<(EventChange, bool)>,
    /// Acknowledgements to publish.
    pub acknowledgements: Vec<EventAcknowledgement>,
    /// What an operator must know and no fault says: one sentence each.
    pub warnings: Vec<String>,
    /// Whether the faults are others than before.
    pub faults_changed: bool,
}

/// Totals since the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Changes that were accepted, doubles included.
    pub changes_in: u64,
    /// Rows written.
    pub changes_journaled: u64,
    /// Changes that came again.
    pub changes_duplicate: u64,
    /// Numbers that came again with another content.
    pub changes_conflicting: u64,
    /// Changes that nobody could deliver any more.
    pub changes_given_up: u64,
    /// Changes that broke a bound or found no room.
    pub changes_refused: u64,
    /// Writes that failed.
    pub writes_failed: u64,
}

/// A change that is told but not on disk.
#[derive(Debug, Clone, PartialEq)]
pub struct Pending {
    /// Grows by one a pending change, from 1, within this process.
    pub number: u64,
    /// UNIX nanoseconds.
    pub received_ns: u64,
    /// The change.
    pub change: EventChange,
}

impl Pending {
    /// A line of the feed: the change with `"journaled":false` and without a `journal_id`.
    #[must_use]
    pub fn line(&self) -> String {
        // A change is plain data: it always has a JSON form.
        let json = serde_json::to_string(&self.change).unwrap_or_default();
        let fields = json.strip_prefix('{').unwrap_or("}");
        let received_ns = self.received_ns;
        format!("{{\"journal_id\":null,\"journaled\":false,\"received_ns\":{received_ns},{fields}")
    }
}

/// The disk cannot be written.
#[derive(Debug)]
struct Trouble {
    fault: Fault,
    retry_at_ns: u64,
    wait_ns: u64,
    /// Whether the event of it was raised.
    is_raised: bool,
}

/// An event of this service that has no sequence number yet.
#[derive(Debug)]
struct Own {
    /// Which happening: its changes have one id.
    subject: String,
    kind: EventKind,
    state: EventState,
    stamp_ns: u64,
    text: String,
}

/// The journal and what is on its way to it.
#[derive(Debug)]
pub struct Keeper {
    path: PathBuf,
    /// Origin of the events of this service.
    origin: String,
    /// None while it cannot even be opened.
    journal: Option<Journal>,
    /// Highest row when the journal was opened: where a client begins that came before.
    head_at_open: u64,
    intake: Intake,
    /// An unknown origin may begin at any number: the rows before are in a journal set aside.
    adopts: bool,
    backlog: VecDeque<Pending>,
    pending_last: u64,
    /// Given up, but not noted yet: origin, first, last. Each has a change in the backlog.
    gaps: Vec<(String, u64, u64)>,
    /// Waits for the end of the input, or for a journal.
    own: VecDeque<Own>,
    own_last: u64,
    /// The ids of those events of this service that are not over, by their subject.
    own_events: BTreeMap<String, String>,
    trouble: Option<Trouble>,
    reused: Option<Fault>,
    counters: Counters,
}

impl Keeper {
    /// Opens the journal. A disk that cannot be written is trouble, not an error: the feed goes on.
    ///
    /// # Errors
    /// [`JournalError::Foreign`] and [`JournalError::Newer`]: a person must decide.
    pub fn open(path: &Path, now: Now) -> Result<(Self, Report), JournalError> {
        Self::open_as(ORIGIN, path, now)
    }

    /// As [`Keeper::open`], with an origin for the events of this service.
    ///
    /// # Errors
    /// As [`Keeper::open`].
    pub fn open_as(origin: &str, path: &Path, now: Now) -> Result<(Self, Report), JournalError> {
        let mut keeper = Self {
            path: path.to_owned(),
            origin: origin.to_owned(),
            journal: None,
            head_at_open: 0,
            intake: Intake::default(),
            adopts: false,
            backlog: VecDeque::new(),
            pending_last: 0,
            gaps: Vec::new(),
            own: VecDeque::new(),
            own_last: 0,
            own_events: BTreeMap::new(),
            trouble: None,
            reused: None,
            counters: Counters::default(),
        };
        let mut report = Report::default();
        match keeper.open_journal(now, &mut report) {
            Err(error @ (JournalError::Foreign { .. } | JournalError::Newer { .. })) => {
                return Err(error);
            }
            Err(error) => keeper.fail(&error, now, &mut report),
            Ok(()) => keeper.acknowledge_all(&mut report),
        }
        keeper.settle(now, &mut report);
        Ok((keeper, report))
    }

    /// Takes changes from outside, as they came; what is in order is one transaction.
    pub fn offer(&mut self, changes: Vec<EventChange>, now: Now) -> Report {
        let mut report = Report::default();
        let mut ready = Vec::new();
        for change in changes {
            if let Err(reason) = self.has_room_for(&change, ready.len()) {
                self.counters.changes_refused += 1;
                report.warnings.push(reason);
                continue;
            }
            self.counters.changes_in += 1;
            self.meet(&change, now, &mut report);
            let origin = change.origin.clone();
            match self.intake.offer(change, now.mono_ns) {
                Offered::Ready(changes) => ready.extend(changes),
                // The origin learns what is missing.
                Offered::Held(true) => self.acknowledge(&origin, &mut report),
                Offered::Held(false) => {}
                Offered::Before(change) => {
                    // A double of one that is ready must find it on disk.
                    self.store(std::mem::take(&mut ready), now, &mut report);
                    self.store_again(*change, now, &mut report);
                }
                Offered::TooManyOrigins => {
                    self.counters.changes_refused += 1;
                    report.warnings.push(format!(
                        "refused a change of {origin:?}: there are {} origins already",
                        crate::intake::ORIGINS_MAX
                    ));
                }
            }
        }
        self.store(ready, now, &mut report);
        self.settle(now, &mut report);
        report
    }

    fn has_room_for(&self, change: &EventChange, ready: usize) -> Result<(), String> {
        change.check_fields().map_err(|reason| format!("refused a change: {reason}"))?;
        if change.origin == self.origin {
            let own = &self.origin;
            return Err(format!("refused a change: {own} is the origin of the journal itself"));
        }
        if self.backlog.len() + ready >= BACKLOG_MAX {
            return Err(format!(
                "the journal cannot be written and the backlog of {BACKLOG_MAX} changes is full: \
                 change {} of {} is left with its origin: {}",
                change.sequence, change.origin, change.text
            ));
        }
        Ok(())
    }

    /// When [`Keeper::tick`] has something to do, CLOCK_MONOTONIC nanoseconds.
    #[must_use]
    pub fn deadline_ns(&self) -> Option<u64> {
        let retry_at_ns = self.trouble.as_ref().map(|trouble| trouble.retry_at_ns);
        retry_at_ns.into_iter().chain(self.intake.deadline_ns()).min()
    }

    /// Does what is due: gives up holes, tries the disk again.
    pub fn tick(&mut self, now: Now) -> Report {
        let mut report = Report::default();
        for given_up in self.intake.expire(now.mono_ns) {
            self.give_up(&given_up, now, &mut report);
            self.store(given_up.ready, now, &mut report);
        }
        if self.trouble.as_ref().is_some_and(|trouble| now.mono_ns >= trouble.retry_at_ns) {
            self.flush(now, &mut report);
        }
        self.settle(now, &mut report);
        report
    }

    /// Looks whether the journal is still in its place, and puts it back if somebody removed it: not
    /// only when the next event comes, which may be tomorrow. One look at a directory entry.
    pub fn look(&mut self, now: Now) -> Report {
        let mut report = Report::default();
        // In trouble, the next try of the disk looks.
        if self.trouble.is_none() {
            if let Err(error) = self.restore_if_removed(now, &mut report) {
                self.fail(&error, now, &mut report);
            }
            self.settle(now, &mut report);
        }
        report
    }

    /// What is wrong now.
    #[must_use]
    pub fn faults(&self) -> Vec<Fault> {
        let trouble = self.trouble.as_ref().map(|trouble| trouble.fault.clone());
        trouble.into_iter().chain(self.reused.clone()).collect()
    }

    /// What `origin` may forget; none if the journal cannot be read.
    #[must_use]
    pub fn acknowledgement(&self, origin: &str) -> Option<EventAcknowledgement> {
        let sequence = self.journal.as_ref()?.highest_contiguous(origin).ok()?;
        Some(EventAcknowledgement { origin: origin.to_owned(), sequence })
    }

    /// Totals since the start.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Changes that are told but not on disk.
    #[must_use]
    pub fn backlog_len(&self) -> usize {
        self.backlog.len()
    }

    /// Where the feed of a client begins that wants only what is new; none while there is no
    /// journal.
    ///
    /// # Errors
    /// If the journal cannot be read.
    pub fn head(&self) -> Result<Option<u64>, JournalError> {
        self.journal.as_ref().map(Journal::head).transpose()
    }

    /// Highest row when the journal was opened.
    #[must_use]
    pub fn head_at_open(&self) -> u64 {
        self.head_at_open
    }

    /// Up to `limit` rows after a cursor; none while there is no journal.
    ///
    /// # Errors
    /// If the journal cannot be read.
    pub fn after(&self, journal_id: u64, limit: usize) -> Result<Vec<Entry>, JournalError> {
        self.journal.as_ref().map_or(Ok(Vec::new()), |journal| journal.after(journal_id, limit))
    }

    /// The newest change of each event of these origins that is not over; none while the journal cannot
    /// be read, which is told elsewhere.
    #[must_use]
    pub fn open_of(&self, origins: &[String]) -> Vec<EventChange> {
        let rows = self.journal.as_ref().and_then(|journal| journal.list(&Filter::open()).ok());
        let changes = rows.into_iter().flatten().filter_map(|row| row.change().ok());
        changes.filter(|change| origins.contains(&change.origin)).collect()
    }

    /// Changes that are told but not on disk, with a number greater than `number`.
    pub fn pending_after(&self, number: u64) -> impl Iterator<Item = &Pending> {
        self.backlog.iter().skip_while(move |pending| pending.number <= number)
    }

    /// A host is missed, and why; or (none) it is heard of again.
    pub fn absence(&mut self, host: &str, missed: Option<String>, now: Now) -> Report {
        let mut report = Report::default();
        let state = if missed.is_some() { EventState::Raised } else { EventState::Cleared };
        let text = missed.unwrap_or_else(|| "it is heard of again".to_owned());
        self.own.push_back(Own {
            subject: host.to_owned(),
            kind: EventKind::CoverageLost,
            state,
            stamp_ns: now.unix_ns,
            text: format!("{HOST_WORD}{host}: {text}"),
        });
        self.settle(now, &mut report);
        report
    }

    /// The hosts that are missed, as far as was told.
    #[must_use]
    pub fn missed_hosts(&self) -> BTreeSet<String> {
        self.own_events.keys().filter(|subject| !subject.is_empty()).cloned().collect()
    }

    /// The feed met damage while it read: sets the journal aside and begins a new one.
    pub fn read_damage(&mut self, detail: String, now: Now) -> Report {
        let mut report = Report::default();
        if let Err(error) = self.begin_anew(detail, now, &mut report) {
            self.fail(&error, now, &mut report);
        }
        self.settle(now, &mut report);
        report
    }
}

#[cfg(test)]
mod tests;
