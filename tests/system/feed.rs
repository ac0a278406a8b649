//! What a site tells: the feed as a desk reads it, the journal as it is on disk, and a laser that
//! falls silent when a test wants something to be told.

use alerts::{JOURNAL_FILE, Journal};
use harness::{Running, Site, WATCHDOG, find, kill};
use protocol::event::{EventChange, EventKind, EventState, begins_numbering};
use rustix::process::Signal;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// The laser that falls silent.
const LASER: &str = "laser south";

/// A line of the feed.
#[derive(Debug, Clone, Deserialize)]
pub struct Told {
    /// Its row, if it is on disk.
    pub journal_id: Option<u64>,
    /// Whether it is.
    pub journaled: bool,
    /// What is told.
    #[serde(flatten)]
    pub change: EventChange,
}

impl Told {
    fn is(&self, kind: EventKind, state: EventState) -> bool {
        self.change.kind == kind && self.change.state == state
    }
}

/// Somebody who watches the alerts of a site, from the first.
pub struct Desk(Running);

impl Desk {
    /// Begins as soon as there is a feed.
    pub fn open(site: &mut Site) -> Self {
        site.wait_until_healthy();
        Self::open_while_degraded(site)
    }

    /// As [`Desk::open`], for a site that runs but has something to complain of.
    pub fn open_while_degraded(site: &Site) -> Self {
        Self(site.follow(&["alerts", "watch"], &["--from-start", "--format", "json"]))
    }

    /// All that it was told.
    pub fn told(&self) -> Vec<Told> {
        let lines = self.0.out.all();
        lines.iter().map(|line| serde_json::from_str(line).expect(line)).collect()
    }

    /// How much that is.
    pub fn count(&self) -> usize {
        self.0.out.count()
    }

    /// Waits for something behind the first `mark` lines.
    pub fn wait_for(&self, mark: usize, what: &str, pass: impl Fn(&Told) -> bool) -> Told {
        self.0.out.wait_after(mark, what, |line| {
            let told: Told = serde_json::from_str(line).expect(line);
            pass(&told).then_some(told)
        })
    }

    /// Holds a laser still, however often it is started again, until its silence is told behind the
    /// first `mark` lines.
    pub fn hold_laser_until_told(&self, site: &mut Site, mark: usize) -> Told {
        let (start, mut held) = (Instant::now(), None);
        loop {
            let pid = site.status().and_then(|report| find(&report, LASER).pid);
            if pid.is_some() && pid != held {
                pid.map(|pid| kill(pid, Signal::STOP));
                held = pid;
            }
            let told = self.told().into_iter().skip(mark);
            let mut raised = told.filter(|t| t.is(EventKind::LaserSilent, EventState::Raised));
            if let Some(told) = raised.next() {
                return told;
            }
            assert!(start.elapsed() < WATCHDOG, "its silence is never told: {:#?}", self.told());
            self.0.out.wait_a_moment(Duration::from_millis(5));
        }
    }

    /// Lets it go on, and waits until the end of the event is told.
    pub fn release_laser(&self, site: &mut Site, event: &str) {
        site.kill(LASER, Signal::CONT);
        let cleared = |told: &Told| {
            told.change.id == event && told.is(EventKind::LaserSilent, EventState::Cleared)
        };
        self.wait_for(0, "the end of the silence", cleared);
    }
}

/// Every row of the journal: its number and its change.
pub fn journal(site: &Site) -> Vec<(u64, EventChange)> {
    let journal = Journal::open_read_only(&site.dir.join("state").join(JOURNAL_FILE)).unwrap();
    let rows = journal.after(0, 100_000).unwrap();
    rows.iter().map(|row| (row.journal_id, row.change().unwrap())).collect()
}

/// Waits until the journal has all that was told, and everybody knows it.
pub fn wait_until_all_is_journaled(site: &mut Site) {
    site.wait_until("the last acknowledgement", |report| {
        let mut watches = report.services.iter().filter(|s| s.name.starts_with("anomaly"));
        let is_told = watches.all(|s| s.gauges.get("events_unacknowledged") == Some(&0.0));
        (report.is_healthy() && is_told).then_some(())
    });
}

/// Nothing is missing, nothing is there twice, and every event has one beginning; what has ended ends
/// again only after it came back.
pub fn assert_whole(rows: &[(u64, EventChange)]) {
    let mut next = BTreeMap::<&str, u64>::new();
    let mut stories = BTreeMap::<&str, Vec<EventState>>::new();
    for (n, (journal_id, change)) in rows.iter().enumerate() {
        assert_eq!(*journal_id, rows[0].0 + n as u64, "{rows:#?}");
        let next = next.entry(&change.origin).or_insert(1);
        if begins_numbering(change.sequence) {
            *next = change.sequence;
        }
        assert_eq!(change.sequence, *next, "{rows:#?}");
        *next += 1;
        stories.entry(&change.id).or_default().push(change.state);
    }
    for (id, story) in stories {
        let (first, rest) = story.split_first().unwrap();
        assert_eq!(*first, EventState::Raised, "{id}: {story:?}");
        assert!(!rest.contains(&EventState::Raised), "{id}: {story:?}");
        let cleared_twice = [EventState::Cleared, EventState::Cleared];
        assert!(!story.windows(2).any(|pair| pair == cleared_twice), "{id}: {story:?}");
    }
}
