//! What a complete MCAP file says of itself: its index at the end, the attachments at its begin.
//! Reads these and nothing between.

use crate::cursor::Cursor;
use crate::error::RecordingError;
use crate::format::MCAP_MAGIC;
use crate::mcap_records::{Next, Place, body, place_at};
use crate::mcap_writer::{FileFacts, TopicFacts};
use mcap::records::op;
use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;

/// Footer record and the magic behind it.
const FOOTER_BYTES: u64 = 9 + 20 + 8;
/// Most bytes of an attachment that is read: a site file.
const ATTACHMENT_BYTES_MAX: usize = protocol::site::TEXT_BYTES_MAX;
/// Most records before the first chunk that are looked at: ours has three.
const HEAD_RECORDS_MAX: usize = 1000;

/// What a complete file holds, from its index.
///
/// # Errors
/// [`RecordingError::Io`]: it cannot be read, or has no index (it is cut: see [`crate::recover`]).
pub fn file_facts(path: &Path) -> Result<FileFacts, RecordingError> {
    let no_index = |reason: String| RecordingError::Io {
        path: path.to_owned(),
        action: "read the index of",
        source: io::Error::other(reason),
    };
    let (file, length) = open(path)?;
    let begin = summary_begin(&file, length).map_err(no_index)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut index = Index::default();
    index.read(&file, begin, length).map_err(no_index)?;
    let mut facts = index.facts().map_err(no_index)?;
    (facts.name, facts.bytes) = (name, length);
    Ok(facts)
}

fn open(path: &Path) -> Result<(Arc<File>, u64), RecordingError> {
    let io = |source| RecordingError::Io { path: path.to_owned(), action: "open", source };
    let metadata = std::fs::metadata(path).map_err(io)?;
    if !metadata.is_file() {
        return Err(io(io::Error::other("expected a file")));
    }
    Ok((Arc::new(File::open(path).map_err(io)?), metadata.len()))
}

/// Where the records behind the data begin, from the footer.
fn summary_begin(file: &File, length: u64) -> Result<u64, String> {
    let mut footer = [0; FOOTER_BYTES as usize];
    let at = length.checked_sub(FOOTER_BYTES).ok_or("the file is shorter than an index")?;
    file.read_exact_at(&mut footer, at).map_err(|error| error.to_string())?;
    if footer[0] != op::FOOTER || !footer.ends_with(MCAP_MAGIC) {
        return Err("the file ends without one: it is cut".to_owned());
    }
    match Cursor::packed(&footer[9..17]).u64("the footer")? {
        0 => Err("it was written without one".to_owned()),
        begin if begin >= at => Err(format!("it should begin at byte {begin} of {length}")),
        begin => Ok(begin),
    }
}

#[derive(Default)]
struct Index {
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, TopicFacts>,
    statistics: Option<(u64, u64, u64, BTreeMap<u16, u64>)>,
}

impl Index {
    fn read(&mut self, file: &Arc<File>, begin: u64, length: u64) -> Result<(), String> {
        let (mut offset, mut bytes) = (begin, Vec::new());
        loop {
            let next = place_at(file, offset, length).map_err(|error| error.to_string())?;
            let place = match next {
                Next::Record(place) if place.opcode == op::FOOTER => return Ok(()),
                Next::Record(place) => place,
                Next::Cut | Next::Garbage => return Err(format!("no record at byte {offset}")),
            };
            if matches!(place.opcode, op::SCHEMA | op::CHANNEL | op::STATISTICS) {
                body(file, place, &mut bytes)?;
                self.take(place, &bytes)?;
            }
            offset = place.end();
        }
    }

    fn take(&mut self, place: Place, bytes: &[u8]) -> Result<(), String> {
        let mut cursor = Cursor::packed(bytes);
        match place.opcode {
            op::SCHEMA => {
                let id = cursor.u16("the number of a schema")?;
                let name = cursor.string("the name of a schema")?.into_owned();
                self.schemas.insert(id, name);
            }
            op::CHANNEL => {
                let id = cursor.u16("the number of a channel")?;
                let schema = cursor.u16("the schema of a channel")?;
                let name = cursor.string("the topic of a channel")?.into_owned();
                let encoding = cursor.string("the encoding of a channel")?.into_owned();
                let mut notes = cursor.string_map("the notes of a channel")?;
                let message_type = self.schemas.get(&schema).cloned().unwrap_or_default();
                let qos = notes.remove("offered_qos_profiles").unwrap_or_default();
                let topic = TopicFacts { name, message_type, encoding, qos, messages: 0 };
                self.channels.insert(id, topic);
            }
            _ => {
                let messages = cursor.u64("the count of messages")?;
                cursor.slice(2 + 4 * 4, "the counts of other things")?;
                let first_ns = cursor.u64("the first time")?;
                let last_ns = cursor.u64("the last time")?;
                let length = cursor.u32("the counts of channels")? as usize;
                let counts = cursor.slice(length, "the counts of channels")?;
                let mut of_channel = BTreeMap::new();
                let mut cursor = Cursor::packed(counts);
                while cursor.left() > 0 {
                    let id = cursor.u16("a channel")?;
                    of_channel.insert(id, cursor.u64("its count")?);
                }
                self.statistics = Some((messages, first_ns, last_ns, of_channel));
            }
        }
        Ok(())
    }

    fn facts(self) -> Result<FileFacts, String> {
        let (messages, first_ns, last_ns, counts) =
            self.statistics.ok_or("it has no statistics")?;
        if last_ns < first_ns {
            return Err(format!("its messages end at {last_ns} ns, before {first_ns} ns"));
        }
        let with_count = |(id, topic)| {
            let messages = counts.get(&id).copied().unwrap_or(0);
            TopicFacts { messages, ..topic }
        };
        let topics = self.channels.into_iter().map(with_count).collect();
        Ok(FileFacts { messages, first_ns, last_ns, topics, ..FileFacts::default() })
    }
}

/// A file that was put into a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Attached {
    /// What it is: `application/toml`.
    pub media_type: String,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// The attachment of this name at the begin of an MCAP file, where recorders put their site file;
/// `None` if there is none, or if the file is of another kind.
///
/// # Errors
/// [`RecordingError::Io`].
pub fn attachment(path: &Path, name: &str) -> Result<Option<Attached>, RecordingError> {
    let (file, length) = open(path)?;
    let io = |source| RecordingError::Io { path: path.to_owned(), action: "read", source };
    let mut magic = [0; 8];
    let is_mcap = length >= 8 && file.read_exact_at(&mut magic, 0).is_ok() && magic == *MCAP_MAGIC;
    if !is_mcap {
        return Ok(None);
    }
    let (mut offset, mut bytes) = (8, Vec::new());
    for _ in 0..HEAD_RECORDS_MAX {
        let Next::Record(place) = place_at(&file, offset, length).map_err(io)? else { break };
        match place.opcode {
            op::CHUNK | op::MESSAGE | op::DATA_END => break,
            op::ATTACHMENT if place.length <= ATTACHMENT_BYTES_MAX as u64 => {
                let read = body(&file, place, &mut bytes);
                read.map_err(|reason| io(io::Error::other(reason)))?;
                if let Some(found) = named_attachment(&bytes, name) {
                    return Ok(Some(found));
                }
            }
            _ => {}
        }
        offset = place.end();
    }
    Ok(None)
}

fn named_attachment(bytes: &[u8], wanted: &str) -> Option<Attached> {
    let mut cursor = Cursor::packed(bytes);
    cursor.u64("log time").ok()?;
    cursor.u64("create time").ok()?;
    let name = cursor.string("name").ok()?;
    let media_type = cursor.string("media type").ok()?.into_owned();
    let length = usize::try_from(cursor.u64("length").ok()?).ok()?;
    let data = cursor.slice(length, "data").ok()?;
    (name == wanted).then(|| Attached { media_type, bytes: data.to_vec() })
}
