//! Lines of the feed of the own alerts service (its page says what they mean), and the bytes that
//! they come in.

use protocol::event::EventChange;
use protocol::link::EventRow;
use serde::Deserialize;

/// Longest line: a change is below 4 kB, as JSON with escapes below four times that.
pub const LINE_BYTES_MAX: usize = 32 * 1024;

/// What a line says.
#[derive(Debug, Clone, PartialEq)]
pub enum FeedLine {
    /// The first line: rows after this one follow.
    Begins(u64),
    /// A row of the journal.
    Row(Box<EventRow>),
    /// A change that is not on disk yet: it comes again when it is.
    NotYet,
    /// The feed ends, and says why.
    Closes(String),
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Line {
    Begins {
        #[serde(rename = "feed")]
        _feed: u64,
        after: u64,
    },
    Closes {
        closing: String,
    },
    Change {
        journal_id: Option<u64>,
        #[serde(flatten)]
        change: Box<EventChange>,
    },
}

/// Reads a line.
///
/// # Errors
/// What was found, in words.
pub fn parse(line: &[u8]) -> Result<FeedLine, String> {
    let parsed = serde_json::from_slice(line).map_err(|error| {
        let begin = String::from_utf8_lossy(&line[..line.len().min(80)]).into_owned();
        format!("cannot understand a line of the feed ({error}): {begin:?}")
    })?;
    Ok(match parsed {
        Line::Begins { after, .. } => FeedLine::Begins(after),
        Line::Closes { closing } => FeedLine::Closes(closing),
        Line::Change { journal_id: None, .. } => FeedLine::NotYet,
        Line::Change { journal_id: Some(journal_id), change } => {
            FeedLine::Row(Box::new(EventRow { journal_id, change: *change }))
        }
    })
}

/// Bytes that came and are no whole line yet.
#[derive(Debug, Default)]
pub struct LineBuffer {
    bytes: Vec<u8>,
}

impl LineBuffer {
    /// Takes bytes; returns the lines that are whole now, without their newlines.
    ///
    /// # Errors
    /// If a line is longer than [`LINE_BYTES_MAX`].
    pub fn take(&mut self, bytes: &[u8]) -> Result<Vec<Vec<u8>>, String> {
        let mut lines = Vec::new();
        for part in bytes.split_inclusive(|&byte| byte == b'\n') {
            if self.bytes.len() + part.len() > LINE_BYTES_MAX {
                return Err(format!("a line of the feed of more than {LINE_BYTES_MAX} bytes"));
            }
            self.bytes.extend_from_slice(part);
            if self.bytes.last() == Some(&b'\n') {
                self.bytes.pop();
                lines.push(std::mem::take(&mut self.bytes));
            }
        }
        Ok(lines)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CHANGE: &str = r#""origin":"hall","sequence":3,"id":"hall-1","kind":"loitering","state":"raised","stamp_ns":1795000000000000001,"first_evidence_ns":2,"area":"hall","zone":null,"x_m":0.1,"y_m":2.0,"bounds_m":[0.0,0.0,1.0,1.0],"score":9.3,"threshold":9.0,"extrapolated":false,"text":"Somebody \"stays\"."}"#;

    #[test]
    fn each_line_of_the_feed_is_understood() {
        let read = |line: &str| parse(line.as_bytes()).unwrap();
        assert_eq!(read(r#"{"feed":1,"after":17,"reset":false}"#), FeedLine::Begins(17));
        let line = format!(r#"{{"journal_id":18,"journaled":true,"received_ns":5,{CHANGE}"#);
        let FeedLine::Row(row) = read(&line) else { panic!() };
        assert_eq!((row.journal_id, row.change.sequence), (18, 3));
        assert_eq!((row.change.stamp_ns, row.change.x_m), (1_795_000_000_000_000_001, 0.1));
        let line = format!(r#"{{"journal_id":null,"journaled":false,"received_ns":5,{CHANGE}"#);
        assert_eq!(read(&line), FeedLine::NotYet);
        let closes = FeedLine::Closes("the site stops".to_owned());
        assert_eq!(read(r#"{"closing":"the site stops"}"#), closes);
        assert!(parse(b"{\"after\":1}").unwrap_err().contains("cannot understand"));
    }

    proptest! {
        #[test]
        fn however_the_bytes_come_the_lines_are_the_same(
            lines in proptest::collection::vec("[a-z]{0,9}", 0..9), cut in 1usize..7,
        ) {
            let bytes: Vec<u8> = lines.iter().flat_map(|line| format!("{line}\n").into_bytes()).collect();
            let mut buffer = LineBuffer::default();
            let parts = bytes.chunks(cut).flat_map(|part| buffer.take(part).unwrap());
            let found: Vec<String> = parts.map(|line| String::from_utf8(line).unwrap()).collect();
            prop_assert_eq!(found, lines);
        }

        #[test]
        fn no_bytes_are_a_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = parse(&bytes);
        }
    }

    #[test]
    fn a_line_without_an_end_is_refused_before_it_fills_the_memory() {
        let mut buffer = LineBuffer::default();
        let part = [b'x'; 1024];
        let refused = (0..64).find_map(|_| buffer.take(&part).err()).unwrap();
        assert!(refused.contains("more than 32768 bytes"), "{refused}");
    }
}
