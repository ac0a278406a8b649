//! The part of the keeper that writes, and what it does when that fails.

use super::{HOST_WORD, Keeper, Now, ORIGIN, Own, Pending, Report, Trouble};
use crate::intake::GivenUp;
use crate::journal::{Damage, Filter, Journal, JournalError};
use protocol::event::{
    EventAcknowledgement, EventChange, EventKind, EventState, begins_numbering, numbering,
};
use protocol::health::Fault;
use protocol::time::SECOND_NS;
use std::collections::BTreeSet;

/// Rows written in one transaction when the disk is back: a lost one costs little to repeat.
const FLUSH_ROWS: usize = 256;
const RETRY_FIRST_NS: u64 = SECOND_NS;
const RETRY_LONGEST_NS: u64 = 30 * SECOND_NS;

impl Own {
    fn storage(state: EventState, stamp_ns: u64, text: String) -> Self {
        Self { subject: String::new(), kind: EventKind::StorageFault, state, stamp_ns, text }
    }
}

impl Keeper {
    pub(super) fn open_journal(
        &mut self,
        now: Now,
        report: &mut Report,
    ) -> Result<(), JournalError> {
        let (journal, damage) = Journal::open(&self.path, now.unix_ns)?;
        self.adopt(journal, now.unix_ns)?;
        if let Some(damage) = damage {
            self.say_damage(&damage, now, report);
        }
        Ok(())
    }

    fn adopt(&mut self, journal: Journal, unix_ns: u64) -> Result<(), JournalError> {
        self.head_at_open = journal.head()?;
        for (origin, through) in journal.origins()? {
            self.intake.know(&origin, through);
        }
        self.own_last = self.own_last.max(journal.highest_contiguous(&self.origin)?);
        if self.own_last == 0 && self.origin != ORIGIN {
            // Desks on other hosts may have what a journal told that is lost.
            (self.own_last, _) = numbering(unix_ns);
        }
        let missed = Filter { kind: Some(EventKind::CoverageLost), ..Filter::open() };
        for change in journal.list(&missed)?.iter().filter_map(|row| row.change().ok()) {
            let of_host = change.text.strip_prefix(HOST_WORD).and_then(|text| text.split_once(':'));
            if let Some((host, _)) = of_host.filter(|_| change.origin == self.origin) {
                self.own_events.insert(host.to_owned(), change.id.clone());
            }
        }
        self.journal = Some(journal);
        Ok(())
    }

    /// An origin that nobody has heard of: after damage, and while there is no journal to ask, its
    /// first change is taken as the next one.
    pub(super) fn meet(&mut self, change: &EventChange, now: Now, report: &mut Report) {
        let is_known = self.intake.next_of(&change.origin).is_some();
        let is_first = change.sequence == 1 || begins_numbering(change.sequence);
        if is_known || is_first || !(self.adopts || self.journal.is_none()) {
            return;
        }
        let before = change.sequence - 1;
        self.intake.know(&change.origin, before);
        if self.adopts {
            self.note_gap(change.origin.clone(), 1, before, now, report);
        }
    }

    /// Journals changes that are next in order, or keeps them in the backlog; tells them.
    pub(super) fn store(&mut self, changes: Vec<EventChange>, now: Now, report: &mut Report) {
        if changes.is_empty() {
            return;
        }
        let mut error = None;
        if self.trouble.is_none() {
            let rows: Vec<_> = changes.iter().map(|change| (now.unix_ns, change)).collect();
            match self.write(now, report, |journal| journal.append_received(&rows)) {
                Ok(outcome) => {
                    self.counters.changes_journaled += outcome.appended as u64;
                    self.acknowledge_each(&changes, report);
                    report.told.extend(changes.into_iter().map(|change| (change, true)));
                    return;
                }
                Err(failure) => error = Some(failure),
            }
        }
        for change in changes {
            self.pending_last += 1;
            report.told.push((change.clone(), false));
            let number = self.pending_last;
            self.backlog.push_back(Pending { number, received_ns: now.unix_ns, change });
        }
        if let Some(error) = error {
            self.fail(&error, now, report);
        }
    }

    /// A number that was handed on before: a double, a conflict, or one given up that came after
    /// all.
    pub(super) fn store_again(&mut self, change: EventChange, now: Now, report: &mut Report) {
        if self.trouble.is_some() {
            // It is on disk, or in the backlog; if it is neither, its origin still has it.
            self.counters.changes_duplicate += 1;
            return;
        }
        let row = [(now.unix_ns, &change)];
        match self.write(now, report, |journal| journal.append_received(&row)) {
            Err(error) => self.fail(&error, now, report),
            Ok(outcome) if outcome.appended == 1 => {
                self.counters.changes_journaled += 1;
                report.told.push((change.clone(), true));
            }
            Ok(outcome) => {
                self.counters.changes_duplicate += 1;
                if outcome.conflicts > 0 {
                    self.conflict(&change, now, report);
                }
            }
        }
        // The origin sent again, so it does not know what is on disk.
        self.acknowledge(&change.origin, report);
    }

    fn conflict(&mut self, change: &EventChange, now: Now, report: &mut Report) {
        self.counters.changes_conflicting += 1;
        let text = format!(
            "{} sent number {} again with another content, so it lost count; not journaled: {} {}",
            change.origin,
            change.sequence,
            change.kind.words(),
            change.text
        );
        report.warnings.push(text.clone());
        report.faults_changed |= self.reused.is_none();
        let since_ns = self.reused.as_ref().map_or(now.unix_ns, |fault| fault.since_ns);
        self.reused = Some(Fault { code: "sequence_reused".to_owned(), text, since_ns });
    }

    pub(super) fn give_up(&mut self, given_up: &GivenUp, now: Now, report: &mut Report) {
        let GivenUp { origin, first, last, .. } = given_up;
        self.counters.changes_given_up += last - first + 1;
        report.warnings.push(format!(
            "changes {first} to {last} of {origin} never came and were given up: \
             what they told is lost"
        ));
        self.note_gap(origin.clone(), *first, *last, now, report);
    }

    fn note_gap(&mut self, origin: String, first: u64, last: u64, now: Now, report: &mut Report) {
        if self.trouble.is_none() {
            let noted = self
                .write(now, report, |journal| journal.give_up(&origin, first, last, now.unix_ns));
            match noted {
                Ok(()) => return,
                Err(error) => self.fail(&error, now, report),
            }
        }
        self.gaps.push((origin, first, last));
    }

    /// Tries the disk again: the whole backlog in order, then the gaps.
    pub(super) fn flush(&mut self, now: Now, report: &mut Report) {
        let kept = self.backlog.len();
        if let Err(error) = self.flush_all(now, report) {
            self.fail(&error, now, report);
            return;
        }
        let Some(trouble) = self.trouble.take() else { return };
        report.faults_changed = true;
        report.warnings.push(format!(
            "the journal is written again; {kept} changes that were kept in memory are on disk"
        ));
        let mut tell =
            |state, stamp_ns, text| self.own.push_back(Own::storage(state, stamp_ns, text));
        if !trouble.is_raised {
            tell(EventState::Raised, trouble.fault.since_ns, trouble.fault.text);
        }
        let text = "the journal is written again".to_owned();
        tell(EventState::Cleared, now.unix_ns, text);
        self.acknowledge_all(report);
    }

    fn flush_all(&mut self, now: Now, report: &mut Report) -> Result<(), JournalError> {
        if self.journal.is_none() {
            self.open_journal(now, report)?;
        }
        while !self.backlog.is_empty() {
            let chunk: Vec<Pending> = self.backlog.iter().take(FLUSH_ROWS).cloned().collect();
            let rows: Vec<_> =
                chunk.iter().map(|pending| (pending.received_ns, &pending.change)).collect();
            let outcome = self.write(now, report, |journal| journal.append_received(&rows))?;
            self.counters.changes_journaled += outcome.appended as u64;
            self.backlog.drain(..chunk.len());
        }
        while let Some((origin, first, last)) = self.gaps.last().cloned() {
            self.write(now, report, |journal| journal.give_up(&origin, first, last, now.unix_ns))?;
            self.gaps.pop();
        }
        Ok(())
    }

    /// Runs one write; if it meets damage, sets the journal aside, begins a new one, and repeats
    /// it.
    fn write<T>(
        &mut self,
        now: Now,
        report: &mut Report,
        operation: impl Fn(&mut Journal) -> Result<T, JournalError>,
    ) -> Result<T, JournalError> {
        self.restore_if_removed(now, report)?;
        let unusable = || JournalError::Missing { path: self.path.clone() };
        match operation(self.journal.as_mut().ok_or_else(unusable)?) {
            Err(JournalError::Damaged { detail, .. }) => {
                self.begin_anew(detail, now, report)?;
                let unusable = || JournalError::Missing { path: self.path.clone() };
                operation(self.journal.as_mut().ok_or_else(unusable)?)
            }
            outcome => outcome,
        }
    }

    /// A journal whose file somebody removed would take writes that nobody can ever read.
    pub(super) fn restore_if_removed(
        &mut self,
        now: Now,
        report: &mut Report,
    ) -> Result<(), JournalError> {
        let Some(journal) = &mut self.journal else { return Ok(()) };
        if !journal.restore_if_removed()? {
            return Ok(());
        }
        let text = format!(
            "the journal of events {} was removed while the site runs; nothing of it is lost, it is \
             written there again",
            self.path.display()
        );
        report.warnings.push(text.clone());
        let stamp_ns = now.unix_ns;
        self.own.push_back(Own::storage(EventState::Raised, stamp_ns, text));
        let text = "the journal of events is in its place again".to_owned();
        self.own.push_back(Own::storage(EventState::Cleared, stamp_ns, text));
        Ok(())
    }

    pub(super) fn begin_anew(
        &mut self,
        detail: String,
        now: Now,
        report: &mut Report,
    ) -> Result<(), JournalError> {
        self.journal = None;
        let (mut journal, damage) = Journal::begin_anew(&self.path, now.unix_ns, detail)?;
        // What was handed on before is in the old file, but for the backlog.
        let own = (self.origin.as_str(), self.own_last + 1);
        for (origin, next) in
            self.intake.expected().filter(|(origin, _)| *origin != self.origin).chain([own])
        {
            let of_origin = self.backlog.iter().filter(|pending| pending.change.origin == origin);
            let first = of_origin.map(|pending| pending.change.sequence).min();
            let through = first.map_or(next, |first| first.min(next)) - 1;
            if through > 0 {
                journal.give_up(origin, 1, through, now.unix_ns)?;
            }
        }
        self.adopt(journal, now.unix_ns)?;
        self.say_damage(&damage, now, report);
        Ok(())
    }

    fn say_damage(&mut self, damage: &Damage, now: Now, report: &mut Report) {
        self.adopts = true;
        let text = format!(
            "the journal of events was damaged ({}); it is kept as {}, and a new one was begun: \
             earlier events are in the old file (sqlite3 FILE .recover)",
            damage.reason,
            damage.kept_as.display()
        );
        report.warnings.push(text.clone());
        let stamp_ns = now.unix_ns;
        self.own.push_back(Own::storage(EventState::Raised, stamp_ns, text));
        let text = "the new journal of events is written".to_owned();
        self.own.push_back(Own::storage(EventState::Cleared, stamp_ns, text));
    }

    /// The disk did not take a write, or did not give a row.
    pub(super) fn fail(&mut self, error: &JournalError, now: Now, report: &mut Report) {
        self.counters.writes_failed += 1;
        let text = error.to_string();
        if let Some(trouble) = &mut self.trouble {
            trouble.wait_ns = (trouble.wait_ns * 2).min(RETRY_LONGEST_NS);
            trouble.retry_at_ns = now.mono_ns.saturating_add(trouble.wait_ns);
            report.faults_changed |= trouble.fault.text != text;
            trouble.fault.text = text;
            return;
        }
        report.faults_changed = true;
        let is_raised = self.journal.is_some();
        if is_raised {
            let (state, stamp_ns) = (EventState::Raised, now.unix_ns);
            self.own.push_back(Own::storage(state, stamp_ns, text.clone()));
        }
        self.trouble = Some(Trouble {
            fault: Fault { code: "journal_unwritable".to_owned(), text, since_ns: now.unix_ns },
            retry_at_ns: now.mono_ns.saturating_add(RETRY_FIRST_NS),
            wait_ns: RETRY_FIRST_NS,
            is_raised,
        });
    }

    /// Stores the events of this service itself. Without a journal nobody knows their next number:
    /// they wait for it.
    pub(super) fn settle(&mut self, now: Now, report: &mut Report) {
        while self.journal.is_some() {
            let Some(own) = self.own.pop_front() else { return };
            self.own_last += 1;
            let id = match own.state {
                EventState::Cleared => self.own_events.remove(&own.subject),
                _ => None,
            };
            let id = id.unwrap_or_else(|| format!("{}-{}", self.origin, self.own_last));
            if own.state != EventState::Cleared {
                self.own_events.insert(own.subject, id.clone());
            }
            let change = EventChange {
                origin: self.origin.clone(),
                sequence: self.own_last,
                id,
                kind: own.kind,
                state: own.state,
                stamp_ns: own.stamp_ns,
                first_evidence_ns: own.stamp_ns,
                area: String::new(),
                zone: None,
                x_m: 0.0,
                y_m: 0.0,
                bounds_m: [0.0; 4],
                score: 1.0,
                threshold: 1.0,
                extrapolated: false,
                text: shortened(own.text),
            };
            self.store(vec![change], now, report);
        }
    }

    pub(super) fn acknowledge(&mut self, origin: &str, report: &mut Report) {
        let Some(journal) = &self.journal else { return };
        if origin == self.origin {
            return;
        }
        match journal.highest_contiguous(origin) {
            Ok(sequence) => report
                .acknowledgements
                .push(EventAcknowledgement { origin: origin.to_owned(), sequence }),
            Err(error) => report.warnings.push(error.to_string()),
        }
    }

    fn acknowledge_each(&mut self, changes: &[EventChange], report: &mut Report) {
        let origins: BTreeSet<&str> = changes.iter().map(|change| change.origin.as_str()).collect();
        for origin in origins {
            self.acknowledge(origin, report);
        }
    }

    pub(super) fn acknowledge_all(&mut self, report: &mut Report) {
        let origins: Vec<String> =
            self.intake.expected().map(|(origin, _)| origin.to_owned()).collect();
        for origin in origins {
            self.acknowledge(&origin, report);
        }
    }
}

/// A text that the codec's bound lets pass.
fn shortened(mut text: String) -> String {
    while text.len() > protocol::event::TEXT_BYTES_MAX {
        text.pop();
    }
    text
}
