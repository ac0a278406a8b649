#![allow(clippy::unwrap_used)]
use super::*;
use proptest::prelude::*;
use protocol::event::{EventKind, EventState};
use protocol::link::{EventRow, PAGE_ROWS_MAX};
use std::collections::BTreeMap;

const EPOCH: u64 = 77;

fn change(origin: &str, sequence: u64) -> EventChange {
    EventChange {
        origin: origin.to_owned(),
        sequence,
        id: format!("{origin}-{sequence}"),
        kind: EventKind::Loitering,
        state: EventState::Raised,
        stamp_ns: sequence,
        first_evidence_ns: sequence,
        area: origin.to_owned(),
        zone: None,
        x_m: 0.0,
        y_m: 0.0,
        bounds_m: [0.0; 4],
        score: 2.0,
        threshold: 1.0,
        extrapolated: false,
        text: "Somebody stays.".to_owned(),
    }
}

/// A journal of one origin whose row n is its change n.
fn page(after: u64, rows: std::ops::RangeInclusive<u64>, head: u64) -> EventPage {
    let row = |n| EventRow { journal_id: n, change: change("hall", n) };
    EventPage { host: "edge".to_owned(), epoch: EPOCH, after, head, rows: rows.map(row).collect() }
}

#[allow(clippy::reversed_empty_ranges)]
const NONE: std::ops::RangeInclusive<u64> = 1..=0;

fn follower(row: u64) -> Follower {
    let cursor = Cursor { epoch: (row > 0).then_some(EPOCH), row };
    let own = BTreeSet::from(["hall".to_owned()]);
    Follower::new(cursor, Origins { own, elsewhere: BTreeSet::from(["yard".to_owned()]) }, 0)
}

fn sequences(changes: &[EventChange]) -> Vec<u64> {
    changes.iter().map(|change| change.sequence).collect()
}

#[test]
fn a_new_desk_asks_for_everything_and_moves_its_cursor_only_when_it_is_acknowledged() {
    let mut desk = follower(0);
    assert_eq!(desk.question(5), Some(0));
    assert_eq!(desk.question(6), None, "it has asked");
    let handed = desk.page(page(0, 1..=3, 3), 10).unwrap();
    assert_eq!(sequences(&handed), [1, 2, 3]);
    assert_eq!(desk.cursor(), Cursor { epoch: Some(EPOCH), row: 0 });
    desk.acknowledged("yard", 9);
    desk.acknowledged("hall", 2);
    assert_eq!((desk.cursor().row, desk.behind()), (2, 1));
    desk.acknowledged("hall", 3);
    assert_eq!((desk.cursor().row, desk.behind()), (3, 0));
    assert_eq!(desk.question(20), None, "nothing is missing");
}

#[test]
fn a_lost_live_row_is_asked_for_as_soon_as_the_next_one_or_the_head_tells_of_it() {
    let mut desk = follower(4);
    desk.question(0);
    desk.page(page(4, NONE, 4), 0).unwrap();
    assert_eq!(desk.page(page(5, 6..=6, 6), 10).unwrap(), [], "5 is missing");
    assert_eq!(desk.question(10), Some(4));
    assert_eq!(sequences(&desk.page(page(4, 5..=6, 6), 20).unwrap()), [5, 6]);
    desk.page(page(7, NONE, 7), 30).unwrap();
    assert_eq!(desk.question(30), Some(6), "the head says that there is a row 7");
}

#[test]
fn silence_and_a_question_without_an_answer_are_questions_again() {
    let mut desk = follower(4);
    assert_eq!(desk.question(0), Some(4));
    assert_eq!(desk.deadline_ns(), Some(ANSWER_NS));
    assert_eq!(desk.question(ANSWER_NS), Some(4), "nobody answered");
    desk.page(page(4, NONE, 4), ANSWER_NS).unwrap();
    assert_eq!(desk.deadline_ns(), Some(ANSWER_NS + SILENCE_NS));
    assert_eq!(desk.question(ANSWER_NS + SILENCE_NS), Some(4), "nobody says anything");
}

#[test]
fn what_is_not_acknowledged_is_handed_on_again_and_no_more_than_a_window_waits() {
    let mut desk = follower(0);
    desk.question(0);
    let first = PAGE_ROWS_MAX as u64;
    assert_eq!(desk.page(page(0, 1..=first, 200), 0).unwrap().len(), WINDOW);
    assert_eq!(desk.page(page(first, first + 1..=first + 9, 200), 1).unwrap(), []);
    assert_eq!(desk.question(10), None, "there is no room");
    assert_eq!(desk.resend(RESEND_NS - 1), []);
    assert_eq!(desk.resend(RESEND_NS).len(), WINDOW);
    desk.acknowledged("hall", first - 1);
    assert_eq!(sequences(&desk.resend(2 * RESEND_NS)), [first]);
    assert_eq!(desk.question(2 * RESEND_NS), Some(first), "now there is");
}

#[test]
fn another_journal_stops_the_desk_until_a_person_has_decided() {
    let mut desk = follower(4);
    let other = EventPage { epoch: EPOCH - 1, ..page(4, 5..=5, 5) };
    let told = desk.page(other, 0).unwrap_err();
    assert_eq!(told.reason, "found journal 76, expected 77");
    assert!(desk.page(page(4, 5..=5, 5), 1).is_err(), "it stays stopped");
    assert_eq!((desk.question(u64::MAX), desk.cursor().row), (None, 4));
    let mut desk = follower(4);
    let told = desk.page(page(4, NONE, 2), 0).unwrap_err();
    assert_eq!(told.reason, "it ends at row 2, but rows up to 4 came before");
}

#[test]
fn a_younger_journal_is_followed_from_its_first_row_behind_what_waits() {
    let (begin, _) = protocol::event::numbering(1_795_000_000_000_000_000);
    let mut desk = follower(0);
    desk.question(0);
    desk.page(page(0, 1..=6, 7), 1).unwrap();
    desk.acknowledged("hall", 4);
    // The host was restored up to its row 5, and numbers anew since.
    let younger = |after: u64, rows: &[(u64, u64)], head| {
        let row =
            |&(journal_id, n): &(u64, u64)| EventRow { journal_id, change: change("hall", n) };
        EventPage {
            epoch: EPOCH + 9,
            rows: rows.iter().map(row).collect(),
            ..page(after, NONE, head)
        }
    };
    assert_eq!(desk.page(younger(7, &[(8, begin + 1)], 8), 2), Ok(Vec::new()), "a word of it");
    assert_eq!(desk.replaced(), Some(Replaced { mono_ns: 2, row: 4, head: 7 }));
    assert_eq!(desk.question(3), Some(0));
    let all = [(1, 1), (2, 2), (3, 3), (4, 4), (5, 5), (8, begin + 1)];
    let handed = desk.page(younger(0, &all, 8), 4).unwrap();
    assert_eq!(sequences(&handed), [1, 2, 3, 4, 5], "the new numbers wait for the old ones");
    assert_eq!(desk.question(5), None, "and nobody asks meanwhile");
    assert_eq!(sequences(&desk.resend(4 + RESEND_NS)), [5, 6, 1, 2, 3, 4, 5]);
    desk.acknowledged("hall", 6);
    assert_eq!(desk.question(6 + RESEND_NS), Some(5));
    let handed = desk.page(younger(5, &[(8, begin + 1)], 8), 7 + RESEND_NS).unwrap();
    assert_eq!(sequences(&handed), [begin + 1]);
    desk.acknowledged("hall", begin + 1);
    let cursor = Cursor { epoch: Some(EPOCH + 9), row: 8 };
    assert_eq!((desk.cursor(), desk.behind(), desk.other()), (cursor, 0, None));
}

#[test]
fn a_twin_is_known_by_what_it_says() {
    let mut desk = follower(4);
    desk.page(page(4, 5..=6, 6), 0).unwrap();
    assert!(desk.page(page(4, 5..=6, 6), 1).is_ok(), "the same again");
    let mut twin = page(5, 6..=6, 6);
    twin.rows[0].change.stamp_ns += 1;
    assert_eq!(desk.page(twin, 2).unwrap_err().reason, "row 6 is another one than before");
    // A twin that is behind, and the one that is followed, by turns.
    let mut desk = follower(4);
    let mut words = 0;
    while desk.page(page(4, NONE, 4), words).is_ok() && desk.page(page(3, NONE, 3), words).is_ok() {
        words += 1;
    }
    assert_eq!(words, 11, "seconds");
    assert!(desk.other().unwrap().reason.starts_with("it ends at row 3"));
}

#[test]
fn a_change_of_an_origin_that_does_not_live_there_is_passed_over_and_counted_unless_a_copy() {
    let mut desk = follower(0);
    desk.question(0);
    let mut rows = page(0, 1..=4, 4);
    rows.rows[1].change = change("vault", 1);
    rows.rows[2].change = change("yard", 1);
    assert_eq!(sequences(&desk.page(rows, 0).unwrap()), [1, 4]);
    desk.acknowledged("hall", 4);
    assert_eq!((desk.foreign(), desk.cursor().row), (1, 4));
}

/// The journal of the desk: takes each origin in order, once; acknowledges what it has.
#[derive(Default)]
struct DeskJournal {
    rows: Vec<(String, u64)>,
    next: BTreeMap<String, u64>,
}

impl DeskJournal {
    fn take(&mut self, changes: &[EventChange]) {
        for change in changes {
            let next = self.next.entry(change.origin.clone()).or_insert(1);
            assert!(change.sequence <= *next, "a hole before {}", change.sequence);
            if change.sequence == *next {
                *next += 1;
                self.rows.push((change.origin.clone(), change.sequence));
            }
        }
    }
}

#[derive(Debug, Clone, Copy)]
enum Fate {
    Write,
    Live { arrives: bool },
    Head { arrives: bool },
    Answer { arrives: bool },
    Acknowledge { arrives: bool },
    Pass,
    Die,
}

fn fate() -> impl Strategy<Value = Fate> {
    prop_oneof![
        4 => Just(Fate::Write),
        4 => any::<bool>().prop_map(|arrives| Fate::Live { arrives }),
        2 => any::<bool>().prop_map(|arrives| Fate::Head { arrives }),
        4 => any::<bool>().prop_map(|arrives| Fate::Answer { arrives }),
        3 => any::<bool>().prop_map(|arrives| Fate::Acknowledge { arrives }),
        2 => Just(Fate::Pass),
        1 => Just(Fate::Die),
    ]
}

/// A source, a desk, its journal, and a network that loses whatever it likes.
#[derive(Default)]
struct World {
    written: Vec<EventChange>,
    counts: [u64; 2],
    stored: Cursor,
    journal: DeskJournal,
    mono_ns: u64,
    asked: Option<u64>,
}

const ORIGINS: [&str; 2] = ["hall", "yard"];

impl World {
    fn start(&self) -> Follower {
        let own = BTreeSet::from(ORIGINS.map(str::to_owned));
        Follower::new(self.stored, Origins { own, ..Origins::default() }, self.mono_ns)
    }

    fn read(&self, after: u64, limit: usize) -> EventPage {
        let row = |n: u64| EventRow { journal_id: n + 1, change: self.written[n as usize].clone() };
        let head = self.written.len() as u64;
        EventPage {
            host: "edge".to_owned(),
            epoch: EPOCH,
            after,
            head,
            rows: (after..head).map(row).take(limit).collect(),
        }
    }

    fn step(&mut self, desk: &mut Follower, fate: Fate) {
        self.mono_ns += SECOND_NS / 4;
        match fate {
            Fate::Write => {
                let origin = self.written.len() * 7 % 3 % 2;
                self.counts[origin] += 1;
                self.written.push(change(ORIGINS[origin], self.counts[origin]));
            }
            Fate::Live { arrives: true } if !self.written.is_empty() => {
                let page = self.read(self.written.len() as u64 - 1, 1);
                self.journal.take(&desk.page(page, self.mono_ns).unwrap());
            }
            Fate::Head { arrives: true } => {
                let head = self.written.len() as u64;
                self.journal.take(&desk.page(self.read(head, 0), self.mono_ns).unwrap());
            }
            Fate::Answer { arrives } => {
                if let Some(after) = self.asked.take().filter(|_| arrives) {
                    let page = self.read(after, PAGE_ROWS_MAX);
                    self.journal.take(&desk.page(page, self.mono_ns).unwrap());
                }
            }
            Fate::Acknowledge { arrives: true } => {
                for (origin, next) in &self.journal.next {
                    desk.acknowledged(origin, next - 1);
                }
                self.stored = desk.cursor();
            }
            Fate::Pass => self.mono_ns += 2 * SECOND_NS,
            Fate::Die => {
                *desk = self.start();
                self.asked = None;
            }
            _ => {} // lost on the way
        }
        self.journal.take(&desk.resend(self.mono_ns));
        self.asked = desk.question(self.mono_ns).or(self.asked);
    }
}

proptest! {
    #[test]
    fn whatever_is_lost_and_whoever_dies_the_desk_has_every_change_once_and_in_order(
        fates in proptest::collection::vec(fate(), 0..300),
    ) {
        let mut world = World::default();
        let mut desk = world.start();
        for fate in fates {
            world.step(&mut desk, fate);
        }
        // The network is whole again: a few questions later the desk has everything.
        for _ in 0..40 {
            world.step(&mut desk, Fate::Head { arrives: true });
            world.step(&mut desk, Fate::Answer { arrives: true });
            world.step(&mut desk, Fate::Acknowledge { arrives: true });
            world.step(&mut desk, Fate::Pass);
        }
        let written = world.written.iter();
        let expected: Vec<_> = written.map(|c| (c.origin.clone(), c.sequence)).collect();
        prop_assert_eq!(&world.journal.rows, &expected);
        prop_assert_eq!(desk.cursor().row, expected.len() as u64);
        prop_assert_eq!(desk.behind(), 0);
    }
}

#[test]
fn a_journal_that_was_deleted_is_followed_from_its_first_row_on() {
    let mut desk = follower(5);
    assert_eq!(desk.page(page(5, NONE, 0), 10), Ok(Vec::new()), "it is empty");
    assert_eq!((desk.other(), desk.behind()), (None, 0));
    let begin = 1_795_000_000_000;
    let handed = desk.page(page(0, begin + 1..=begin + 2, begin + 2), 20).unwrap();
    assert_eq!(sequences(&handed), [begin + 1, begin + 2]);
}
