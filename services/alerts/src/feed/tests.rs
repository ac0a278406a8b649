#![allow(clippy::unwrap_used)]
use super::*;
use proptest::prelude::*;
use serde_json::Value;

/// A journal and a backlog in memory.
#[derive(Default)]
struct Model {
    rows: Vec<Entry>,
    pending: Vec<(u64, String)>,
    pending_last: u64,
}

impl Model {
    fn append(&mut self, text_bytes: usize) {
        let journal_id = self.rows.len() as u64 + 1;
        let json = format!("{{\"text\":\"{}\"}}", "x".repeat(text_bytes));
        self.rows.push(Entry { journal_id, received_ns: 0, json });
    }

    fn tell_unwritten(&mut self) {
        self.pending_last += 1;
        let line = format!("{{\"journal_id\":null,\"pending\":{}}}", self.pending_last);
        self.pending.push((self.pending_last, line));
    }

    fn flush(&mut self) {
        for _ in 0..std::mem::take(&mut self.pending).len() {
            self.append(1);
        }
    }
}

impl Source for Model {
    fn head(&self) -> Result<Option<u64>, JournalError> {
        Ok(Some(self.rows.len() as u64))
    }
    fn head_at_open(&self) -> u64 {
        0
    }
    fn after(&self, journal_id: u64, limit: usize) -> Result<Vec<Entry>, JournalError> {
        Ok(self.rows.iter().skip(journal_id as usize).take(limit).cloned().collect())
    }
    fn pending_after(&self, number: u64, limit: usize) -> Vec<(u64, String)> {
        let new = self.pending.iter().filter(|(n, _)| *n > number);
        new.take(limit).cloned().collect()
    }
}

fn take(feed: &mut Feed, id: ClientId, bytes_max: usize, mono_ns: u64) -> Vec<u8> {
    let taken = feed.output(id)[..bytes_max.min(feed.output(id).len())].to_vec();
    feed.sent(id, taken.len(), mono_ns);
    taken
}

fn take_all(feed: &mut Feed, source: &Model, id: ClientId, mono_ns: u64) -> Vec<u8> {
    let mut all = Vec::new();
    loop {
        feed.pump(source, mono_ns).unwrap();
        let taken = take(feed, id, usize::MAX, mono_ns);
        if taken.is_empty() {
            return all;
        }
        all.extend(taken);
    }
}

fn lines(bytes: &[u8]) -> Vec<Value> {
    let text = std::str::from_utf8(bytes).unwrap();
    assert!(text.is_empty() || text.ends_with('\n'), "{text:?} is cut");
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn connect(feed: &mut Feed, request: &str) -> ClientId {
    let id = feed.connect(0).unwrap();
    feed.received(id, request.as_bytes(), 0);
    id
}

#[test]
fn a_client_gets_what_comes_after_its_cursor_and_then_what_is_new() {
    let (mut feed, mut source) = (Feed::default(), Model::default());
    (0..3).for_each(|_| source.append(1));
    let id = connect(&mut feed, "{\"after\": 1}\nand more that nobody reads");
    let history = lines(&take_all(&mut feed, &source, id, 0));
    assert_eq!(history[0], serde_json::json!({"feed": 1, "after": 1, "reset": false}));
    let ids: Vec<u64> =
        history[1..].iter().map(|line| line["journal_id"].as_u64().unwrap()).collect();
    assert_eq!(ids, [2, 3]);
    assert_eq!(history[1]["journaled"], true);
    source.append(1);
    assert_eq!(lines(&take_all(&mut feed, &source, id, 0))[0]["journal_id"], 4);
    assert_eq!(feed.deadline_ns(), None, "a quiet client is no reason to wake");
}

#[test]
fn a_client_without_a_cursor_gets_only_what_is_new() {
    let (mut feed, mut source) = (Feed::default(), Model::default());
    source.append(1);
    let id = connect(&mut feed, "{\"after\":null}\n");
    assert_eq!(lines(&take_all(&mut feed, &source, id, 0)).len(), 1, "the greeting");
    source.append(1);
    assert_eq!(lines(&take_all(&mut feed, &source, id, 0))[0]["journal_id"], 2);
}

#[test]
fn a_cursor_beyond_the_journal_begins_at_its_first_row_and_says_so() {
    let (mut feed, mut source) = (Feed::default(), Model::default());
    source.append(1);
    let id = connect(&mut feed, "{\"after\":99}\n");
    let all = lines(&take_all(&mut feed, &source, id, 0));
    assert_eq!(all[0], serde_json::json!({"feed": 1, "after": 0, "reset": true}));
    assert_eq!(all[1]["journal_id"], 1);
}

#[test]
fn garbage_is_answered_with_what_was_expected() {
    let long = "x".repeat(REQUEST_BYTES_MAX + 1);
    for request in ["hello\n", "{}\n", "{\"after\":-1}\n", "{\"after\":\"7\"}\n", "\u{0}\n", &long]
    {
        let (mut feed, source) = (Feed::default(), Model::default());
        let id = connect(&mut feed, request);
        let all = lines(&take_all(&mut feed, &source, id, 0));
        assert!(
            all[0]["closing"].as_str().unwrap().contains("expected {\"after\": 17}"),
            "{all:?}"
        );
        assert!(feed.is_over(id));
    }
}

#[test]
fn a_client_that_says_nothing_is_closed() {
    let (mut feed, source) = (Feed::default(), Model::default());
    let id = feed.connect(5).unwrap();
    assert_eq!(feed.deadline_ns(), Some(5 + GREETING_NS));
    assert!(feed.expire(4 + GREETING_NS).is_empty());
    assert!(!feed.is_over(id));
    assert!(feed.expire(5 + GREETING_NS).is_empty());
    let all = lines(&take_all(&mut feed, &source, id, 5 + GREETING_NS));
    assert!(all[0]["closing"].as_str().unwrap().contains("no request"), "{all:?}");
}

#[test]
fn a_client_that_takes_nothing_costs_a_bounded_queue_and_is_told_after_the_line_it_is_in() {
    let (mut feed, mut source) = (Feed::default(), Model::default());
    let id = connect(&mut feed, "{\"after\":0}\n");
    (0..2000).for_each(|_| source.append(300));
    feed.pump(&source, 0).unwrap();
    assert!(feed.output(id).len() < QUEUE_BYTES_MAX + PAGE_ROWS * 500);
    let mut got = take(&mut feed, id, 100, 7); // amid the second line
    assert_eq!(feed.deadline_ns(), Some(7 + STALL_NS));
    assert!(feed.expire(7 + STALL_NS).is_empty());
    assert_eq!(feed.stalled(), 1);
    got.extend(take_all(&mut feed, &source, id, 8 + STALL_NS));
    let all = lines(&got);
    assert_eq!(all[1]["journal_id"], 1);
    assert!(all[2]["closing"].as_str().unwrap().contains("last journal_id"), "{all:?}");
    assert!(all.len() == 3 && feed.is_over(id));
}

#[test]
fn a_client_that_does_not_even_take_its_last_line_is_dropped() {
    let mut feed = Feed::default();
    let id = connect(&mut feed, "garbage\n");
    assert_eq!(feed.deadline_ns(), Some(FAREWELL_NS));
    assert_eq!(feed.expire(FAREWELL_NS), [id]);
}

#[test]
fn the_client_after_the_last_place_is_told_so() {
    let mut feed = Feed::default();
    let ids: Vec<ClientId> = (0..CLIENTS_MAX).map(|_| feed.connect(0).unwrap()).collect();
    let refused = feed.connect(0).unwrap_err();
    assert!(lines(refused.as_bytes())[0]["closing"].as_str().unwrap().contains("32 places"));
    feed.disconnect(ids[3]);
    assert!(feed.connect(0).is_ok());
}

#[derive(Debug, Clone)]
enum Step {
    Append(usize),
    TellUnwritten,
    Flush,
    Connect(Option<u64>),
    Take(usize, usize),
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        3 => (0..40_000_usize).prop_map(Step::Append),
        1 => Just(Step::TellUnwritten),
        1 => Just(Step::Flush),
        2 => proptest::option::of(0..20_u64).prop_map(Step::Connect),
        6 => (0..8_usize, 0..60_000_usize).prop_map(|(client, bytes)| Step::Take(client, bytes)),
    ]
}

/// Rows without a hole or a double, early notices at most once and in order.
fn check_stream(bytes: &[u8], wanted: Option<u64>, head_at_connect: u64, head: u64) {
    let all = lines(bytes);
    let begin = all[0]["after"].as_u64().unwrap();
    match wanted {
        None => assert_eq!(begin, head_at_connect),
        Some(after) if after > head_at_connect => assert_eq!(begin, 0),
        Some(after) => assert_eq!(begin, after),
    }
    let ids: Vec<u64> = all[1..].iter().filter_map(|line| line["journal_id"].as_u64()).collect();
    assert_eq!(ids, (begin + 1..=head).collect::<Vec<_>>());
    let early: Vec<u64> = all[1..].iter().filter_map(|line| line["pending"].as_u64()).collect();
    assert!(early.is_sorted_by(|a, b| a < b), "{early:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn whatever_the_interleaving_every_client_gets_every_row_once(
        steps in proptest::collection::vec(step(), 1..80),
    ) {
        let (mut feed, mut source) = (Feed::default(), Model::default());
        let mut clients: Vec<(ClientId, Option<u64>, u64, Vec<u8>)> = Vec::new();
        for step in steps {
            match step {
                // As the keeper: while there is a backlog, changes go there.
                Step::Append(bytes) if source.pending.is_empty() => source.append(bytes),
                Step::Append(_) | Step::TellUnwritten => source.tell_unwritten(),
                Step::Flush => source.flush(),
                Step::Connect(after) if clients.len() < 8 => {
                    let request = serde_json::json!({ "after": after }).to_string() + "\n";
                    let id = connect(&mut feed, &request);
                    clients.push((id, after, source.rows.len() as u64, Vec::new()));
                }
                Step::Connect(_) => {}
                Step::Take(client, bytes) => {
                    if let Some((id, _, _, got)) = clients.get_mut(client) {
                        got.extend(take(&mut feed, *id, bytes, 0));
                    }
                }
            }
            feed.pump(&source, 0).unwrap();
        }
        source.flush();
        for (id, wanted, head_at_connect, mut got) in clients {
            got.extend(take_all(&mut feed, &source, id, 0));
            check_stream(&got, wanted, head_at_connect, source.rows.len() as u64);
        }
    }
}
