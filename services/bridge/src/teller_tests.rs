#![allow(clippy::unwrap_used)]
use super::*;
use protocol::event::{EventChange, EventKind, EventState};
use std::io::{BufRead, BufReader};
use std::os::unix::net::UnixListener;

const EPOCH: u64 = 77;

fn line(journal_id: u64) -> String {
    let change = EventChange {
        origin: "hall".to_owned(),
        sequence: journal_id,
        id: format!("hall-{journal_id}"),
        kind: EventKind::Loitering,
        state: EventState::Raised,
        stamp_ns: 1,
        first_evidence_ns: 1,
        area: "hall".to_owned(),
        zone: None,
        x_m: 0.0,
        y_m: 0.0,
        bounds_m: [0.0; 4],
        score: 2.0,
        threshold: 1.0,
        extrapolated: false,
        text: "Somebody stays.".to_owned(),
    };
    let json = serde_json::to_string(&change).unwrap();
    let head = format!("{{\"journal_id\":{journal_id},\"journaled\":true,\"received_ns\":5,");
    format!("{head}{}\n", &json[1..])
}

/// A feed as the alerts service offers it, written out by hand.
struct Feed {
    _directory: tempfile::TempDir,
    listener: UnixListener,
    events: EventLoop,
    teller: Teller<&'static str>,
    out: Vec<Tell<&'static str>>,
}

impl Feed {
    fn new() -> Self {
        let directory = tempfile::tempdir().unwrap();
        let listener = UnixListener::bind(directory.path().join(SOCKET_FILE)).unwrap();
        let events = EventLoop::new().unwrap();
        let teller = Teller::new("edge", directory.path(), &events, EPOCH);
        Self { _directory: directory, listener, events, teller, out: Vec::new() }
    }

    /// The next client, after its request.
    fn accept(&self, request: &str) -> UnixStream {
        let (stream, _) = self.listener.accept().unwrap();
        let mut found = String::new();
        BufReader::new(&stream).read_line(&mut found).unwrap();
        assert_eq!(found.trim_end(), request);
        stream
    }

    /// Waits until the teller has something to say.
    fn told(&mut self) -> Tell<&'static str> {
        while self.out.is_empty() {
            self.events.wait(None).unwrap();
            while let Some(token) = self.events.next_ready() {
                assert!(self.teller.ready(token, 1, &mut self.out));
            }
            self.teller.tick(1, &mut self.out);
        }
        self.out.remove(0)
    }

    /// A live connection, behind row `after`.
    fn live(&mut self, after: u64) -> UnixStream {
        self.teller.tick(0, &mut self.out);
        let mut stream = self.accept("{\"after\":null}");
        writeln!(stream, "{{\"feed\":1,\"after\":{after},\"reset\":false}}").unwrap();
        let Tell::Live(page) = self.told() else { panic!() };
        assert_eq!((page.after, page.head, page.rows.len()), (after, after, 0));
        stream
    }
}

#[test]
fn a_row_is_told_as_it_comes_and_says_which_one_was_before_it() {
    let mut feed = Feed::new();
    let mut stream = feed.live(4);
    stream.write_all(line(6).as_bytes()).unwrap(); // rows of a journal begun anew leave numbers out
    let Tell::Live(page) = feed.told() else { panic!() };
    page.check_order().unwrap();
    assert_eq!((page.epoch, page.after, page.head), (EPOCH, 4, 6));
    assert_eq!(page.rows[0].change.sequence, 6);
    assert_eq!(feed.teller.fault(u64::MAX), None);
}

#[test]
fn a_question_is_answered_with_the_rows_up_to_the_head() {
    let mut feed = Feed::new();
    let _stream = feed.live(3);
    let mut out = Vec::new();
    feed.teller.ask(Ask { after: 1, query: "who" }, 1, &mut out);
    assert!(out.is_empty(), "the journal is asked first");
    let mut page = feed.accept("{\"after\":1}");
    let text = format!("{{\"feed\":1,\"after\":1,\"reset\":false}}\n{}{}", line(2), line(3));
    page.write_all(text.as_bytes()).unwrap();
    let Tell::Answer("who", page) = feed.told() else { panic!() };
    page.check_order().unwrap();
    let rows: Vec<u64> = page.rows.iter().map(|row| row.journal_id).collect();
    assert_eq!((page.after, page.head, rows), (1, 3, vec![2, 3]));
    feed.teller.ask(Ask { after: 3, query: "who" }, 1, &mut feed.out);
    let Tell::Answer(_, page) = feed.told() else { panic!() };
    assert_eq!((page.after, page.head, page.rows.len()), (3, 3, 0), "there is nothing more");
}

#[test]
fn a_long_journal_is_told_in_pages() {
    let mut feed = Feed::new();
    let _stream = feed.live(1000);
    feed.teller.ask(Ask { after: 0, query: "who" }, 1, &mut feed.out);
    let mut stream = feed.accept("{\"after\":0}");
    let writer = std::thread::spawn(move || {
        let mut text = "{\"feed\":1,\"after\":0,\"reset\":false}\n".to_owned();
        text.extend((1..=1000).map(line));
        let _ = stream.write_all(text.as_bytes()); // it has its page, and goes away
    });
    let Tell::Answer(_, page) = feed.told() else { panic!() };
    writer.join().unwrap();
    page.check_order().unwrap();
    assert_eq!((page.rows.len(), page.head), (PAGE_ROWS_MAX, 1000));
}

#[test]
fn without_a_journal_a_question_stays_unanswered_and_is_counted() {
    let mut feed = Feed::new();
    feed.teller.ask(Ask { after: 0, query: "who" }, 1, &mut feed.out);
    assert_eq!((feed.out.len(), feed.teller.unanswered()), (0, 1));
    let stream = feed.live(5);
    feed.teller.ask(Ask { after: 0, query: "who" }, 1, &mut feed.out);
    drop(feed.accept("{\"after\":0}"));
    drop(stream);
    while feed.teller.fault(1 + START_NS).is_none() || feed.teller.unanswered() < 2 {
        feed.events.wait(None).unwrap();
        while let Some(token) = feed.events.next_ready() {
            feed.teller.ready(token, 1, &mut feed.out);
        }
    }
    assert!(feed.out.is_empty());
    assert_eq!(feed.teller.fault(START_NS), None, "it may be starting");
    assert_eq!(feed.teller.deadline_ns(), Some(1 + RETRY_NS), "it is looked for again");
}
